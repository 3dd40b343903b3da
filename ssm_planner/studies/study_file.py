"""Load a study file, and the files of the robot, motions and catalogues that it names.

`load_study` is the entry. `StudyModel` describes the keys of a study file for the loader, the JSON
schema and the documentation.
"""

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
    Reader,
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
from ssm_planner.loading.missions import expand_abbreviations
from ssm_planner.loading.schema import Nested, build_class_model
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
from ssm_planner.units import BadQuantity, parse_share


def _parse_margin(value: object) -> float:
    """Convert a fraction (0.2) or a percentage ("20 %") to a fraction from 0 to below 1.

    Raises BadQuantity for all other values.
    """
    margin = parse_share(value)
    if 0 <= margin < 1:
        return margin
    raise BadQuantity("not a share", "0 to 1, or 0 % to 100 %")


class SearchModel(Model):
    """How candidates are generated."""

    method: Literal["sobol", "grid", "tpe", "nsga2"] = "sobol"
    """Scrambled Sobol' points, a grid, or TPE or NSGA-II of the optional package `optuna`."""
    points: Annotated[int, Field(ge=1, le=MAX_CANDIDATES)] = 256
    """Number of candidates, at least 1. For a grid, the number of values in each range."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of the random numbers. The same seed gives the same candidates."""


_MARGIN_FIELD = Reader(
    _parse_margin, {"type": ["number", "string"]}, allowed="0 to 1, or 0 % to 100 %"
)
RequirementsModel = build_class_model(
    Requirements, {"motor_margin": (Annotated[float, _MARGIN_FIELD], 0.0)}
)
"""Model of the keys under `require`, in which the motor margin may be a percentage."""


class StudyModel(Model):
    """Keys of a study file."""

    name: Text | None = None
    """Name of the study. The default is the name of the file without its ending."""
    robot: Reference
    """Robot file that the candidates vary."""
    motions: Annotated[list[Text], Field(min_length=1, max_length=50)]
    """Problem files or names of shipped problems. The candidate replaces their robot."""
    vary: JsonObject
    """Dotted paths of the robot file, or `pace`. Each path has a range {from: …, to: …}, a list
    {choices: …}, or {catalogue: FILE}, with {select: mass} to select by rank.
    """
    require: Annotated[Any, Nested(RequirementsModel)] = RequirementsModel()
    """Conditions that a candidate must meet."""
    minimise: Annotated[list[Literal[OBJECTIVES]], Field(min_length=1)]  # type: ignore[valid-type]
    """Objectives. Margins are maximised, all other objectives are minimised."""
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
    """Convert the content of a study file to a study.

    Parameters
    ----------
    section : Section
        Content of the file. It knows the lines of its keys, which errors state.

    Returns
    -------
    Study
        The study with the contents of all files that it names.

    Raises
    ------
    ProblemError
        If the content is invalid, or if a file that it names is missing or invalid.
    """
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
    """Load the problem files of a study.

    Included motions are expanded, and the paths of tables become absolute, so that the result does
    not depend on other problem files.

    Parameters
    ----------
    section : Section
        Content of the study file.
    names : sequence of str
        Entries of the key `motions`.

    Returns
    -------
    dict
        Content of each problem file without its robot and name, by name of the file.

    Raises
    ------
    ProblemError
        If a file is missing, invalid or named twice.
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
    """Return the content of a robot file in a form that does not depend on other files.

    The contents of drive and motor files replace the names of these files. The interactive view of
    a robot uses this function as well.

    Parameters
    ----------
    robot : Section
        Content of the robot file.

    Returns
    -------
    dict
        Content with the contents of all drives and motors.

    Raises
    ------
    ProblemError
        If the robot or one of these files is invalid.
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
    """Convert one entry of the key `vary` to a variable.

    Parameters
    ----------
    section : Section
        Content of the entry.
    path : str
        Key of the entry, which is a path of the robot file.
    robot : dict
        Content of the robot file.

    Returns
    -------
    Varied or Choice
        A range of a quantity, or a choice among several entries.

    Raises
    ------
    ProblemError
        If the robot does not have the path, or if the form of the entry is not permitted.
    """
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
    """Return the content of each entry of a list of choices, by name of the entry.

    Parameters
    ----------
    section : Section
        Content with the key `choices`.
    key : str
        Last key of the path, such as "motor". A text in a list of drives or motors names a file,
        and the content of this file replaces the text.

    Returns
    -------
    dict
        Content of each entry by its name. The name is the key `name` of the entry, the text of the
        entry, or the index of an entry without a name.

    Raises
    ------
    ProblemError
        If the list is empty or is not a list, or if a file is invalid.
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
    """Check the entries of a study file that select a motor or a gear instead of searching it.

    For such an entry, each candidate receives the best motor or gear of a catalogue, ranked for
    instance by mass, that can execute all its motions. At least one other entry must be searched.
    Only motors and gears can be selected. The pace is a factor by which the durations of the
    motions may grow, so that weaker motors and gears suffice. It must be at least 1, and it has an
    effect only if a motor or gear is selected.

    Parameters
    ----------
    section : Section
        Content of the study file, for messages.
    vary : sequence of Variable
        All variables.
    selected : sequence of Choice
        The variables whose motor or gear is selected by rank after the motions are planned.

    Raises
    ------
    ProblemError
        If a condition is violated.
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
    """Return True if all values that a variable permits for the pace are finite and at least 1.

    The pace is a factor by which the durations of the motions grow.

    Parameters
    ----------
    variable : Varied or Choice
        Variable with the path `PACE_PATH`.
    """
    # A range begins with its smallest value.
    paces = variable.contents if isinstance(variable, Choice) else [variable.value_at(0.0)]
    try:
        return all(1.0 <= float(text) < math.inf for text in paces)
    except ValueError:
        return False


def _parse_range(section: Section, path: str) -> Varied:
    """Convert the keys `from` and `to` of an entry of `vary` to a range.

    Parameters
    ----------
    section : Section
        Content of the entry. Both keys have a number and the same unit, such as "26 deg".
    path : str
        Path of the quantity in the robot file.

    Returns
    -------
    Varied
        Range of the quantity in the unit of the file.

    Raises
    ------
    ProblemError
        If an end is not a number, if the units differ, or if `from` is not below `to`.
    """
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
    """Load the catalogue of motors or gears from which a variable of a study takes its values.

    Parameters
    ----------
    section : Section
        Content with the key `catalogue`, which names a CSV file or a folder of YAML files.
    path : str
        Path of the robot file. Its last key tells whether the catalogue contains gears or motors.

    Returns
    -------
    contents : dict
        Contents of all entries by name.
    sizes : dict
        Mass (kg) and length (m) of each entry by name, as far as the catalogue states them.

    Raises
    ------
    ProblemError
        If the catalogue is missing or invalid.
    """
    folder = Path() if section.file is None else section.file.parent
    file = folder / str(section.value["catalogue"])
    try:
        return read_catalogue(file, gear=path.split(".")[-1] in GEAR_KEYS), catalogue_sizes(file)
    except ProblemError as error:
        # An error in the catalogue has a line of its own. Other errors concern the key.
        if error.line is not None:
            raise
        raise section.error(str(error), "catalogue", show=False) from None


def _check_first_candidate(section: Section, study: Study) -> None:
    """Check that the candidate with the first value of each variable is a valid robot.

    An invalid value is thus reported with its line before any candidate is evaluated. Errors that
    no path of the study explains are ignored here, because other candidates may still be valid.

    Parameters
    ----------
    section : Section
        Content of the study file, for messages.
    study : Study
        Study whose first candidate is built.

    Raises
    ------
    ProblemError
        If this robot is invalid because of a path of the study, which the message names.
    """
    tree = study.resolved(study.design([0.0] * len(study.vary)))
    try:
        robot_from(section_from_data(tree))
    except ProblemError as error:
        for path in study.paths:
            if error.key is not None and path.rsplit(".", 1)[-1] in error.key:
                raise section.error(f"invalid robot: {error}", "vary", path, show=False) from None
