"""A study file → Study: what varies, with the robot, motions and catalogues that it names."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from ssm_planner.errors import ProblemError
from ssm_planner.loading.catalogues import entries, stated_beside
from ssm_planner.loading.files import find, follow, of_data, read
from ssm_planner.loading.robots import robot_from
from ssm_planner.loading.schema import Field as Share
from ssm_planner.loading.schema import (
    Model,
    Reference,
    Text,
    Truth,
    interval,
    located,
    quantity,
    validated,
    wrong,
)
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.problem.value import Bound
from ssm_planner.sizing.selection import RANKS
from ssm_planner.studies.study import (
    GEARS,
    OBJECTIVES,
    PACE,
    Choice,
    Requirements,
    Search,
    Study,
    Variable,
    Varied,
    known,
)


def _share(value: object) -> float:
    """A number, or a percentage such as `20 %`."""
    text = str(value).strip()
    try:
        share = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError:
        share = -1.0
    if not 0 <= share < 1:
        raise wrong("not a share", "0 to 1, or 0 % to 100 %")
    return share


class SearchModel(Model):
    """How candidates are chosen."""

    method: Literal["sobol", "grid", "tpe", "nsga2"] = "sobol"
    """Scrambled Sobol points; a grid; or with the extra `optuna` TPE or NSGA-II."""
    points: Annotated[int, Field(ge=1, le=10_000_000)] = 256
    """Candidates, at least 1; of a grid, values of each span."""
    seed: Annotated[int, Field(ge=0)] = 0
    """The same seed gives the same candidates."""


class RequirementsModel(Model):
    """What a candidate must do."""

    reach: Annotated[tuple[float, float], interval("angle")] | None = None
    """Tilts that the mechanism has to reach."""
    reach_margin: Annotated[float, quantity("angle", Bound(at_least=0.0))] = 0.0
    """To spare at both ends of reach."""
    self_locking: Truth = False
    """Every drive holds without torque."""
    motor_margin: Annotated[
        float, Share(_share, {"type": ["number", "string"]}, allowed="0 to 1, or 0 % to 100 %")
    ] = 0.0
    """Least margin of torque, continuous torque, speed, heat and voltage."""


class StudyModel(Model):
    """What a study file may say."""

    name: Text | None = None
    """By default the file's name without its ending."""
    robot: Reference
    """Where the candidates start from."""
    motions: Annotated[list[Text], Field(min_length=1, max_length=50)]
    """Problem files, or shipped names; the candidate takes the place of their robot."""
    vary: dict[str, Any]
    """Dotted paths of the robot file, each {from: …, to: …}, {choices: [ … ]} or {catalogue: FILE, select: mass}; pace."""
    require: RequirementsModel = RequirementsModel()
    """What a candidate must do."""
    minimise: Annotated[list[Literal[OBJECTIVES]], Field(min_length=1)]  # type: ignore[valid-type]  # a tuple of texts
    """Margins are made large."""
    search: SearchModel = SearchModel()
    """How candidates are chosen."""


def load_study(name: str | Path) -> Study:
    """The study in a YAML file, or the shipped one of this name, with all that it names. Raises ProblemError."""
    return study_from(read(find(name, "studies")))


def study_from(section: Section) -> Study:
    """The study that a section describes. Raises ProblemError."""
    model = validated(section, StudyModel)
    robot = _tree(follow(section, "robot"))
    motions: dict[str, Any] = {}
    for i, name in enumerate(model.motions):
        motion = follow(section, "motions", i, kind="problem")
        label = Path(name).stem
        if label in motions:
            raise section.error("given twice", "motions", i)
        motions[label] = {
            key: value for key, value in motion.value.items() if key not in ("robot", "name")
        }
    if not model.vary:
        raise section.error("nothing varies", "vary", allowed="at least one path of the robot file")
    vary = tuple(_variable(section.sub("vary", path), path, robot) for path in model.vary)
    selected = tuple(each for each in vary if isinstance(each, Choice) and each.select is not None)
    _check_selection(section, vary, selected)
    with located(section):
        study = Study(
            name=model.name or section.name,
            robot=robot,
            motions=motions,
            vary=tuple(each for each in vary if each not in selected),
            selected=selected,
            require=Requirements(**dict(model.require)),
            minimise=tuple(model.minimise),
            search=Search(**dict(model.search)),
            file=None if section.file is None else str(section.file),
        )
    _check_paths(section, study)
    return study


def _tree(robot: Section) -> dict[str, Any]:
    """What the robot file says, drives and motors in the place of their files' names. Raises ProblemError."""
    robot_from(robot)
    tree: dict[str, Any] = {**robot.value, "joints": {}}
    for name, joint in robot.value["joints"].items():
        parts = {
            part: follow(robot, "joints", name, part).value
            for part in ("drive", "motor")
            if part in joint
        }
        tree["joints"][name] = {
            key: value for key, value in {**joint, **parts}.items() if key != "alternatives"
        }
    return tree


def _variable(section: Section, path: str, robot: dict[str, Any]) -> Variable:
    if not known(robot, path):
        raise section.error(
            "the robot file has no such place", show=False, allowed="such as geometry.alpha"
        )
    value = section.value
    ways = ({"from", "to"}, {"choices"}, {"catalogue"}, {"catalogue", "select"})
    if not isinstance(value, dict) or set(value) not in ways:
        allowed = "{from: …, to: …}, {choices: [ … ]}, {catalogue: FILE} or {catalogue: FILE, select: mass}"
        raise section.error("not a way to vary", allowed=allowed)
    if "from" in value:
        return _span(section, path)
    if "choices" in value:
        choices = value["choices"]
        if not isinstance(choices, list) or not choices:
            raise section.error("not a list of choices", "choices")
        contents = {}
        for i, choice in enumerate(choices):
            file = isinstance(choice, str) and path.split(".")[-1] in ("drive", "motor")
            content = (
                follow(section, "choices", i, kind=path.split(".")[-1]).value if file else choice
            )
            contents[
                str(choice) if not isinstance(choice, dict) else str(choice.get("name", i))
            ] = content
        return Choice(path, contents)
    select = value.get("select")
    if select is not None and select not in RANKS:
        raise section.error("not a rank known here", "select", allowed=", ".join(RANKS))
    contents, beside = catalogue(section, path)
    return Choice(path, contents, select, beside if select else {})


def _check_selection(
    section: Section, vary: Sequence[Variable], selected: Sequence[Choice]
) -> None:
    """Raises ProblemError where only what is selected varies, or a pace is none."""
    if len(selected) == len(vary):
        raise section.error(
            "nothing is searched", "vary", show=False, allowed="at least one path without select"
        )
    for choice in selected:
        if not choice.path.startswith("joints.") or choice.path.split(".")[-1] not in (
            "motor",
            *GEARS,
        ):
            raise section.error(
                "no motor and no gear: not selected", "vary", choice.path, show=False
            )
    for pace in (each for each in vary if each.path == PACE):
        given = (
            [pace.at(0.0)] if isinstance(pace, Varied) else [str(each) for each in pace.contents]
        )
        try:
            good = all(1.0 <= float(each) < math.inf for each in given)
        except ValueError:
            good = False
        if not good or not selected:
            reason = (
                "not a pace" if selected else "nothing is selected, so the pace changes nothing"
            )
            raise section.error(
                reason,
                "vary",
                PACE,
                allowed="numbers of at least 1, beside {catalogue: …, select: …}",
            )


def _span(section: Section, path: str) -> Varied:
    numbers, found = [], []
    for end in ("from", "to"):
        text = str(section.value[end])
        number, _, unit = text.strip().partition(" ")
        try:
            numbers.append(float(number))
        except ValueError:
            raise section.error("not a number with a unit", end, allowed="such as 26 deg") from None
        found.append(unit.strip())
    if found[0] != found[1]:
        raise section.error(
            f"another unit than from has ({found[0] or 'none'})", "to", allowed="one unit for both"
        )
    low, high = numbers
    if not low < high:
        raise section.error("not above from", "to", allowed=f"above {section.value['from']}")
    return Varied(path, low, high, found[0])


def catalogue(section: Section, path: str) -> tuple[dict[str, Any], dict[str, dict[str, float]]]:
    """What the entries of a catalogue, a CSV or a folder of YAML files, say by name; mass and length where stated."""
    file = (Path() if section.file is None else section.file.parent) / str(
        section.value["catalogue"]
    )
    try:
        return entries(file, gear=path.split(".")[-1] in GEARS), stated_beside(file)
    except ProblemError as error:
        if error.line is not None:
            raise
        raise section.error(str(error), "catalogue", show=False) from None


def _check_paths(section: Section, study: Study) -> None:
    """The robot with each variable at its first value can be read: else the message says which of them cannot be."""
    first = {variable.path: variable.at(0.0) for variable in study.vary}
    tree = study.resolved(first)
    try:
        robot_from(of_data(tree))
    except ProblemError as error:
        for path in study.paths:
            if error.key is not None and path.rsplit(".", 1)[-1] in error.key:
                raise section.error(f"cannot be: {error}", "vary", path, show=False) from None
