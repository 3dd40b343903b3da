"""Names of `loading` that other packages use, and the modules that define them."""

from .catalogues import (
    CatalogueEntry as CatalogueEntry,
    catalogue_sizes as catalogue_sizes,
    drives_with_gears as drives_with_gears,
    number_or_text as number_or_text,
    read_catalogue as read_catalogue,
    read_gearheads as read_gearheads,
    read_motors as read_motors,
)
from .drives import drive_from as drive_from, drive_model as drive_model
from .files import (
    find_file as find_file,
    follow_reference as follow_reference,
    read_section as read_section,
    section_from_data as section_from_data,
    section_from_text as section_from_text,
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
    Key as Key,
    Model as Model,
    Reader as Reader,
    Reference as Reference,
    Text as Text,
    describe_keys as describe_keys,
    locate_errors as locate_errors,
    validate_section as validate_section,
)
from .tables import table_rows as table_rows
from .yaml_nodes import Section as Section, node_from_data as node_from_data
