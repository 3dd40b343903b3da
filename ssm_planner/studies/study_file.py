"""Load a study file, and the files of the robot, motions and catalogues that it names."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from ssm_planner.arguments import checked
from ssm_planner.errors import ProblemError
from ssm_planner.loading import (
    Model,
    Reference,
    Section,
    Text,
    catalogue_sizes,
    find_file,
    follow_reference,
    locate_errors,
    read_catalogue,
    read_section,
    robot_from,
    section_from_data,
    validate_section,
)
from ssm_planner.loading import Reader as Share
from ssm_planner.loading.missions import expand_abbreviations
from ssm_planner.loading.schema import Nested as Keys
from ssm_planner.loading.schema import build_class_model
from ssm_planner.sizing import RANKS
from ssm_planner.studies.study import (
    GEAR_KEYS,
    MAX_CANDIDATES,
    OBJECTIVES,
    PACE_PATH,
    Choice,
    Requirements,
    Search,
    Study,
    Variable,
    Varied,
    leads_to_container,
)
from ssm_planner.typing import JsonObject
from ssm_planner.units import BadQuantity, share


def _parse_margin(value: object) -> float:
    """Return a share from 0 to below 1. Raises BadQuantity."""
    margin = share(value)
    if 0 <= margin < 1:
        return margin
    raise BadQuantity("not a share", "0 to 1, or 0 % to 100 %")


class SearchModel(Model):
    """How candidates are generated."""

    method: Literal["sobol", "grid", "tpe", "nsga2"] = "sobol"
    """Scrambled Sobol points; a grid; or with the extra `optuna` TPE or NSGA-II."""
    points: Annotated[int, Field(ge=1, le=MAX_CANDIDATES)] = 256
    """Number of candidates, at least 1; for a grid, values per range."""
    seed: Annotated[int, Field(ge=0)] = 0
    """The same seed gives the same candidates."""


_MARGIN_FIELD = Share(
    _parse_margin, {"type": ["number", "string"]}, allowed="0 to 1, or 0 % to 100 %"
)
RequirementsModel = build_class_model(
    Requirements, {"motor_margin": (Annotated[float, _MARGIN_FIELD], 0.0)}
)


class StudyModel(Model):
    """Keys of a study file."""

    name: Text | None = None
    """Name of the study; default: the file's name without its ending."""
    robot: Reference
    """Robot file from which the candidates differ."""
    motions: Annotated[list[Text], Field(min_length=1, max_length=50)]
    """Problem files or shipped names; the candidate replaces their robot."""
    vary: JsonObject
    """Dotted paths of the robot file, each {from: …, to: …}, {choices: [ … ]} or {catalogue: FILE,
    select: mass}; pace.
    """
    require: Annotated[Any, Keys(RequirementsModel)] = RequirementsModel()
    """Conditions that a candidate must meet."""
    minimise: Annotated[list[Literal[OBJECTIVES]], Field(min_length=1)]  # type: ignore[valid-type]
    """Objectives; margins are maximised."""
    search: SearchModel = SearchModel()
    """How candidates are generated."""


@checked
def load_study(name: str | Path) -> Study:
    """Load a study and all files that it names.

    Parameters
    ----------
    name : str or Path
        Path of a YAML file, or the name of a shipped study.

    Returns
    -------
    Study
        The study with the contents of all its files.

    Raises
    ------
    ProblemError
        If a file is missing or invalid.

    Examples
    --------
    >>> from ssm_planner import load_study
    >>> load_study("vitreoretinal").search.method
    'sobol'
    """
    return study_from(read_section(find_file(name, "studies")))


def study_from(section: Section) -> Study:
    """Convert the content of a study file to a study. Raises ProblemError if it is invalid."""
    model = validate_section(section, StudyModel)
    robot = resolved_robot_content(follow_reference(section, "robot"))
    motions = _load_motions(section, model.motions)
    if not model.vary:
        raise section.error(
            "the study varies nothing", "vary", allowed="at least one path of the robot file"
        )
    vary = tuple(_parse_variable(section.sub("vary", path), path, robot) for path in model.vary)
    selected = tuple(
        variable
        for variable in vary
        if isinstance(variable, Choice) and variable.select is not None
    )
    _check_selection(section, vary, selected)
    with locate_errors(section):
        study = Study(
            name=model.name or section.name,
            robot=robot,
            motions=motions,
            vary=tuple(variable for variable in vary if variable not in selected),
            selected=selected,
            require=Requirements(**dict(model.require)),
            minimise=tuple(model.minimise),
            search=Search(**dict(model.search)),
            file=None if section.file is None else str(section.file),
        )
    _check_first_candidate(section, study)
    return study


def _load_motions(section: Section, names: Sequence[str]) -> JsonObject:
    """Return the contents of problem files without robot and name, by the names of the files.

    Included motions are expanded, and the paths of tables are absolute. Raises ProblemError if a
    file is missing, invalid or named twice.
    """
    motions: JsonObject = {}
    for i, name in enumerate(names):
        problem = expand_abbreviations(follow_reference(section, "motions", i, file_kind="problem"))
        label = Path(name).stem
        if label in motions:
            raise section.error("given twice", "motions", i)
        for entry in problem.value.get("motion", ()):
            if problem.file and isinstance(entry, dict) and isinstance(entry.get("path"), str):
                entry["path"] = os.path.abspath(problem.file.parent / entry["path"])
        motions[label] = problem.value
        for key in ("robot", "name"):
            problem.value.pop(key, None)
    return motions


def resolved_robot_content(robot: Section) -> JsonObject:
    """Return the content of a robot file, in which drives and motors replace the names of files.

    Raises ProblemError if the robot is invalid.
    """
    robot_from(robot)
    tree = {**robot.value, "joints": {}}
    for name, joint in robot.value["joints"].items():
        references = {
            key: follow_reference(robot, "joints", name, key).value
            for key in ("drive", "motor")
            if key in joint
        }
        if "alternatives" in joint:
            references["alternatives"] = [
                follow_reference(robot, "joints", name, "alternatives", i, file_kind="motor").value
                for i in range(len(joint["alternatives"]))
            ]
        tree["joints"][name] = {**joint, **references}
    return tree


def _parse_variable(section: Section, path: str, robot: JsonObject) -> Variable:
    """Convert the entry for a path to a variable. Raises ProblemError if the entry is invalid."""
    if not leads_to_container(robot, path):
        raise section.error(
            "the robot file does not contain this path",
            show=False,
            allowed="such as geometry.alpha",
        )
    value = section.value
    forms = ({"from", "to"}, {"choices"}, {"catalogue"}, {"catalogue", "select"})
    if not isinstance(value, dict) or set(value) not in forms:
        allowed = (
            "{from: …, to: …}, {choices: [ … ]}, {catalogue: FILE} or {catalogue: FILE, "
            "select: mass}"
        )
        raise section.error("not a variation", allowed=allowed)
    if "from" in value:
        return _parse_range(section, path)
    if "choices" in value:
        return Choice(path, _listed_contents(section, path.split(".")[-1]))
    select = value.get("select")
    if select is not None and select not in RANKS:
        raise section.error("unknown rank", "select", allowed=", ".join(RANKS))
    contents, sizes = _load_catalogue(section, path)
    return Choice(path, contents, select, sizes if select else {})


def _listed_contents(section: Section, key: str) -> JsonObject:
    """Return the contents of listed choices by name.

    The contents of files replace the names of drives and motors. `key` is the last key of the
    path, such as "motor". Raises ProblemError if the list is invalid.
    """
    choices = section.value["choices"]
    if not isinstance(choices, list) or not choices:
        raise section.error("not a list of choices", "choices")
    contents = {}
    for i, choice in enumerate(choices):
        label = str(choice.get("name", i) if isinstance(choice, dict) else choice)
        contents[label] = choice
        if isinstance(choice, str) and key in ("drive", "motor"):
            contents[label] = follow_reference(section, "choices", i, file_kind=key).value
    return contents


def _check_selection(
    section: Section, vary: Sequence[Variable], selected: Sequence[Choice]
) -> None:
    """Check the variables of a study. Raises ProblemError if they are invalid.

    At least one variable must be searched, only motors and gears can be selected, and every pace
    must be at least 1.
    """
    if len(selected) == len(vary):
        raise section.error(
            "nothing is searched", "vary", show=False, allowed="at least one path without select"
        )
    for choice in selected:
        keys = choice.path.split(".")
        if keys[0] != "joints" or not (keys[-1] == "motor" or keys[-1] in GEAR_KEYS):
            raise section.error(
                "only motors and gears can be selected", "vary", choice.path, show=False
            )
    for variable in vary:
        if variable.path == PACE_PATH and not (selected and _is_valid_pace(variable)):
            reason = (
                "invalid pace" if selected else "without a selected part, the pace has no effect"
            )
            allowed = "numbers of at least 1, beside {catalogue: …, select: …}"
            raise section.error(reason, "vary", PACE_PATH, allowed=allowed)


def _is_valid_pace(variable: Variable) -> bool:
    """Return True if all values of a pace are finite and at least 1."""
    # A range begins with its smallest value.
    paces = variable.contents if isinstance(variable, Choice) else [variable.value_at(0.0)]
    try:
        return all(1.0 <= float(text) < math.inf for text in paces)
    except ValueError:
        return False


def _parse_range(section: Section, path: str) -> Varied:
    """Convert the keys `from` and `to` to a range. Raises ProblemError if they are invalid."""
    numbers = []
    units = []
    for end in ("from", "to"):
        text = str(section.value[end])
        number, _, unit = text.strip().partition(" ")
        try:
            numbers.append(float(number))
        except ValueError:
            raise section.error("not a number with a unit", end, allowed="such as 26 deg") from None
        units.append(unit.strip())
    if units[0] != units[1]:
        raise section.error(
            f"unit differs from that of the key from ({units[0] or 'none'})",
            "to",
            allowed="one unit for both",
        )
    low, high = numbers
    if not low < high:
        raise section.error("not above from", "to", allowed=f"above {section.value['from']}")
    return Varied(path, low, high, units[0])


def _load_catalogue(section: Section, path: str) -> tuple[JsonObject, dict[str, dict[str, float]]]:
    """Read the catalogue that an entry names, which is a CSV file or a folder of YAML files.

    Returns the contents of all entries by name, and their masses (kg) and lengths (m) if the
    catalogue states them. Raises ProblemError if the catalogue is invalid.
    """
    folder = Path() if section.file is None else section.file.parent
    file = folder / str(section.value["catalogue"])
    try:
        return read_catalogue(file, gear=path.split(".")[-1] in GEAR_KEYS), catalogue_sizes(file)
    except ProblemError as error:
        if error.line is not None:
            raise
        raise section.error(str(error), "catalogue", show=False) from None


def _check_first_candidate(section: Section, study: Study) -> None:
    """Check that the robot is valid with the first value of each variable.

    Raises ProblemError, which names the path of the invalid value.
    """
    tree = study.resolved(study.design([0.0] * len(study.vary)))
    try:
        robot_from(section_from_data(tree))
    except ProblemError as error:
        for path in study.paths:
            if error.key is not None and path.rsplit(".", 1)[-1] in error.key:
                raise section.error(f"invalid robot: {error}", "vary", path, show=False) from None
