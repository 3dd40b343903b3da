"""Names of `loading` that other packages use, and the modules that define them."""

from .catalogues import (
    Part as Part,
    entries as entries,
    gearheads_of as gearheads_of,
    gears_of as gears_of,
    motors_of as motors_of,
    number_or_text as number_or_text,
    stated_beside as stated_beside,
)
from .drives import drive_from as drive_from, drive_model as drive_model
from .files import (
    find as find,
    follow as follow,
    of_data as of_data,
    of_text as of_text,
    read as read,
    shipped_folder as shipped_folder,
)
from .json_files import parse_json as parse_json, read_json_in_parts as read_json_in_parts
from .load import (
    file_keys as file_keys,
    json_schema as json_schema,
    load_drive as load_drive,
    load_motor as load_motor,
    load_motorisation as load_motorisation,
    load_problem as load_problem,
    load_robot as load_robot,
    problem_from_dict as problem_from_dict,
)
from .motors import motor_from as motor_from
from .problems import problem_from as problem_from
from .robots import robot_from as robot_from
from .schema import (
    Field as Field,
    Key as Key,
    Model as Model,
    Reference as Reference,
    Text as Text,
    keys as keys,
    located as located,
    validated as validated,
)
from .tables import table_rows as table_rows
from .yaml_nodes import Section as Section, plain_node as plain_node
