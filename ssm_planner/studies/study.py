"""Define a study as an immutable value: variables, motions, requirements and objectives.

A study compares many robots that differ from the robot of the study file in some values, such as
the angle between two axes or the motor of a joint. Each of these robots is called a candidate, and
the values that distinguish it are called its design. `study_file.load_study` reads a `Study` from
YAML, and `run.study` evaluates its candidates.
"""

import copy
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np

from ssm_planner.deprecation import Renamed
from ssm_planner.errors import ProblemError
from ssm_planner.loading import number_or_text
from ssm_planner.problem import Interval, NotNegative, Value
from ssm_planner.typing import Array, Fields, JsonObject, frozen, record
from ssm_planner.units import BadQuantity, parse_quantity

Design = Mapping[str, str]
"""Values that define a candidate, by the path of the robot file at which they vary.

A value is a quantity with its unit, such as "30 deg", or the name of an entry of a `Choice`. The
robot of the study file itself has an empty design.
"""
OBJECTIVES = ("duration", "motor_mass", "motor_margin", "peak_torque", "reach_margin")
"""Results that `minimise` can name. Results whose name ends with "margin" are maximised."""
GEAR_KEYS = ("worm", "screw")
"""Last keys of a path that replaces the gear of a drive, such as `joints.tilt.drive.worm`."""
MAX_CANDIDATES = 10_000_000
"""Largest number of candidates. The results of more candidates would not fit into memory."""
SOBOL_BLOCK_SIZE = 4096
"""Number of points of a Sobol' sequence that are drawn at once. It must be a power of 2."""
PACE_PATH = "pace"
"""Path of the pace, a factor of at least 1 by which motions are slowed down.

The pace is not a key of the robot file. A slower motion permits weaker motors and gears.
"""


@frozen
class Varied:
    """A quantity that varies between two values.

    Parameters
    ----------
    path : str
        Dotted path of the quantity in the robot file, such as "geometry.alpha".
    low, high : float
        Ends of the range, in `unit`.
    unit : str
        Unit in the robot file, such as "deg". It is empty for a quantity without a unit.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.Varied("geometry.alpha", 26.0, 34.0, "deg").value_at(0.5)
    '30 deg'
    """

    path: str
    low: float
    high: float
    unit: str

    def value_at(self, position: float) -> str:
        """Return a value of the range with its unit.

        Parameters
        ----------
        position : float
            Position in the range, from 0 (`low`) to 1 (`high`).

        Returns
        -------
        str
            Value such as "30 deg".
        """
        return f"{self.low + position * (self.high - self.low):.8g} {self.unit}".rstrip()

    def grid(self, count: int) -> list[str]:
        """Return `count` equidistant values with their unit, from `low` to `high`."""
        return [self.value_at(position) for position in np.linspace(0, 1, count)]

    at = Renamed("value_at")


@frozen
class Choice:
    """A choice among several entries, such as the motors of a catalogue.

    The search selects an entry for every candidate. If `select` is set, the entry is selected only
    after the motions of the candidate have been planned: it is the first entry in the ranking by
    `select` whose motor or gear can execute all motions.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> choice = ssm.Choice("joints.roll.motor", {"small": {}, "large": {}})
    >>> choice.value_at(0.9)
    'large'
    """

    path: str
    contents: Fields
    """Content of each entry in the form of the robot file, by name of the entry."""
    select: str | None = None
    """Quantity that ranks the suitable entries, such as "mass". None lets the search choose."""
    beside: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Mass (kg) and length (m) that the catalogue states in addition, by name of the entry."""

    @property
    def joint(self) -> str:
        """Name of the joint in a path such as "joints.roll.motor"."""
        return self.path.split(".")[1]

    def value_at(self, position: float) -> str:
        """Return the name of an entry.

        Parameters
        ----------
        position : float
            Position from 0 (first entry) to 1 (last entry). Each entry occupies an equal part.
        """
        names = list(self.contents)
        return names[min(int(position * len(names)), len(names) - 1)]

    def grid(self, count: int) -> list[str]:
        """Return the names of all entries, for any `count`, because a grid contains every entry."""
        return list(self.contents)

    at = Renamed("value_at")


Variable = Varied | Choice


@record
class Requirements(Value):
    """Conditions that a candidate must meet.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.Requirements(reach=(-135 * ssm.deg, -85 * ssm.deg), motor_margin=0.2).self_locking
    False
    """

    reach: Annotated[Interval, "angle"] | None = None
    """Range of signed tilt angles that the workspace must contain, rad."""
    reach_margin: Annotated[NotNegative, "angle"] = 0.0
    """Additional tilt that the workspace must contain beyond each end of this range, rad."""
    self_locking: bool = False
    """True if every drive must hold its load without motor torque."""
    motor_margin: NotNegative = 0.0
    """Smallest margin of every motor in torque, speed, heat and voltage, relative to the limit."""


@frozen
class Search:
    """The method that generates the candidates.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.Search("grid", points=5).adaptive
    False
    """

    method: Literal["sobol", "grid", "tpe", "nsga2"] = "sobol"
    points: int = 256
    """Number of candidates. For a grid, the number of values in each range."""
    seed: int = 0
    """Seed of the random numbers. The same seed gives the same candidates."""

    @property
    def adaptive(self) -> bool:
        """True if the results of earlier candidates determine later ones."""
        return self.method in ("tpe", "nsga2")


@record
class Study:
    """A comparison of many robots, the candidates, which all perform the same motions.

    The candidates are the robot of the study file with other values of the variables.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> study = ssm.load_study("vitreoretinal")
    >>> study.paths[0], study.minimise
    ('geometry.alpha', ('duration', 'motor_margin', 'motor_mass'))
    """

    name: str
    robot: Fields
    """Content of the robot file. The contents of drive and motor files replace their names."""
    motions: Mapping[str, Fields]
    """Contents of the problem files without their robot, by name of the motion."""
    vary: tuple[Variable, ...]
    """Variables for which the search chooses values."""
    require: Requirements
    minimise: tuple[str, ...]
    search: Search
    file: str | None = None
    selected: tuple[Choice, ...] = ()
    """Choices of motors and gears whose entries are selected after the motions are planned."""

    def __post_init__(self) -> None:
        if not 1 <= self.count <= MAX_CANDIDATES:
            raise ProblemError(
                f"the {self.search.method} search has {self.count:.6g} candidates",
                key="search.points",
                value=self.search.points,
                allowed=f"1 to {MAX_CANDIDATES} candidates",
            )

    @property
    def count(self) -> int:
        """Number of candidates that the search generates.

        A grid combines all values of all variables. Other searches have `search.points` candidates.
        """
        if self.search.method != "grid":
            return self.search.points
        return math.prod(
            len(variable.contents) if isinstance(variable, Choice) else self.search.points
            for variable in self.vary
        )

    @cached_property
    def paths(self) -> tuple[str, ...]:
        """Paths of the robot file for which the search chooses values."""
        return tuple(variable.path for variable in self.vary)

    @property
    def notes(self) -> list[str]:
        """Remarks that a reader of the results must know.

        The only remark concerns bodies (links) with a stated mass and inertia. They keep these
        values although the geometry or the motors of the candidates differ.
        """
        fixed_bodies = [body["name"] for body in self.robot["bodies"] if "parts" not in body]
        paths = [variable.path for variable in self.vary + self.selected]
        affecting = [
            path for path in paths if path.startswith("geometry.") or path.endswith(".motor")
        ]
        if not fixed_bodies or not affecting:
            return []
        return [
            f"Bodies as the robot file gives them ({', '.join(fixed_bodies)}): they turn with the "
            "axes, but keep mass, centre and inertia whatever geometry and motors are chosen; "
            "bodies given by parts would follow."
        ]

    @property
    def own_words(self) -> str:
        """Description of the original robot, with which the page compares the candidates."""
        if self.selected:
            return "The study's own robot with motors and gears selected in the same way, at pace 1"
        return "The study's own robot as it stands"

    def complete_design(self, design: Design, figures: Fields) -> dict[str, str]:
        """Add the selected motors and gears to the design of a candidate.

        Parameters
        ----------
        design : Design
            Values that the search chose.
        figures : mapping
            Results of the candidate. They contain the name of each motor and gear that was selected
            from a catalogue, under the path of its choice.

        Returns
        -------
        dict of str
            Values and names of motors and gears by path.
        """
        result = dict(design)
        for choice in self.selected:
            if choice.path in figures:
                result[choice.path] = figures[choice.path]
        return result

    def designs(self) -> Iterator[Design]:
        """Yield the designs of all candidates in the order of their numbers.

        The search must not be adaptive, because the designs of an adaptive search depend on
        results.
        """
        search = self.search
        if search.method == "grid":
            grids = [variable.grid(search.points) for variable in self.vary]
            for values in itertools.product(*grids):
                yield dict(zip(self.paths, values, strict=True))
            return
        yield from map(self.design, sobol_points(len(self.vary), search.points, search.seed))

    def design(self, point: Sequence[float] | Array) -> Design:
        """Return the design that belongs to a point of the unit cube.

        Each coordinate of the point selects the value of one variable.

        Parameters
        ----------
        point : (d,) array
            Position of each of the d variables of `vary` in its range, from 0 to 1.

        Returns
        -------
        Design
            Value of each variable by its path.
        """
        return {
            variable.path: variable.value_at(float(x))
            for variable, x in zip(self.vary, point, strict=True)
        }

    def resolved(self, design: Design) -> JsonObject:
        """Return the content of the robot file that describes a candidate.

        Parameters
        ----------
        design : Design
            Values that distinguish the candidate, by path. An empty design gives the original
            robot.

        Returns
        -------
        dict
            Content of the robot file with the values of the design.
        """
        contents = {
            variable.path: variable.contents
            for variable in self.vary + self.selected
            if isinstance(variable, Choice)
        }
        return robot_with_design(self.robot, contents, design)

    whole = Renamed("complete_design")


def robot_with_design(robot: Fields, contents: Mapping[str, Fields], design: Design) -> JsonObject:
    """Replace values in the content of a robot file by those of a candidate.

    If the design changes the motor of a joint, the function also exchanges the rotor inertia in the
    input inertia of its drive.

    Parameters
    ----------
    robot : mapping
        Original content. The contents of drive and motor files replace their names.
    contents : mapping of str to mapping
        Contents of the entries of each choice by name. The key is the path of the choice.
    design : Design
        Values by path.

    Returns
    -------
    dict
        Content of the robot file of the candidate.

    Raises
    ------
    ProblemError
        If a choice does not have the entry that the design names.
    """
    tree = copy.deepcopy(dict(robot))
    for path, text in design.items():
        if path in contents and text not in contents[path]:
            raise ProblemError("no such entry", key=path, value=text)
        if path == PACE_PATH:
            continue  # The pace is not a key of the robot file.
        value = contents[path][text] if path in contents else number_or_text(text)
        _set_at_path(tree, path, value)
    for path in design:
        if path.startswith("joints.") and path.endswith(".motor"):
            joint = path.split(".")[1]
            _replace_rotor(tree["joints"][joint], robot["joints"][joint])
    return tree


def sobol_points(dimensions: int, points: int, seed: int) -> Iterator[Array]:
    """Yield the points of a scrambled Sobol' sequence.

    These points fill the unit cube more evenly than random points.

    Parameters
    ----------
    dimensions : int
        Number of coordinates of a point.
    points : int
        Number of points.
    seed : int
        Seed of the scrambling.

    Yields
    ------
    (dimensions,) array
        Coordinates from 0 to 1.
    """
    from scipy.stats import qmc

    sampler = qmc.Sobol(dimensions, scramble=True, seed=seed)
    for start in range(0, points, SOBOL_BLOCK_SIZE):
        yield from sampler.random(SOBOL_BLOCK_SIZE)[: points - start]


def _set_at_path(tree: JsonObject, path: str, content: Any) -> None:
    """Set the content at a dotted path of a robot file's content, in place.

    If the path ends with a key of `GEAR_KEYS`, `content` describes a gear, and its entries are set
    in the existing drive. If they contain dimensions, the old dimensions of the gear are removed
    first, except for the thread angle.

    Parameters
    ----------
    tree : dict
        Content of the robot file, which is changed.
    path : str
        Dotted path. A number stands for an index of a list.
    content : object
        New value, or the entries of a gear by their path in the drive.
    """
    keys = path.split(".")
    final_key = keys.pop()
    node: Any = tree
    for key in keys:
        node = node[int(key)] if isinstance(node, list) else node.setdefault(key, {})
    if final_key not in GEAR_KEYS:
        node[int(final_key) if isinstance(node, list) else final_key] = copy.deepcopy(content)
        return
    if any(key.startswith("geometry.") for key in content):
        dimensions = node["geometry"].items()
        node["geometry"] = {key: value for key, value in dimensions if key == "thread_angle"}
    for key, value in content.items():
        _set_at_path(node, key, value)


def _replace_rotor(joint: JsonObject, original: Fields) -> None:
    """Exchange the rotor inertia in the input inertia of a drive, in place.

    The input inertia of a drive includes the rotor of its motor. If the file of the original motor
    does not state a rotor inertia, the new rotor inertia is only added, which gives an upper bound.

    Parameters
    ----------
    joint : dict
        Content of the candidate's joint, whose drive is changed.
    original : mapping
        Content of the same joint of the original robot.
    """
    if "drive" not in joint:
        return
    old_rotor = _stated_inertia(original.get("motor"), "rotor_inertia")
    new_rotor = _stated_inertia(joint.get("motor"), "rotor_inertia")
    inertia = _stated_inertia(joint["drive"], "input_inertia") - old_rotor + new_rotor
    source = "the drive's, with the rotor of the motor chosen"
    joint["drive"] = {
        **joint["drive"],
        "input_inertia": {"value": f"{inertia:.12g} kg*m^2", "source": source},
    }


def _stated_inertia(mapping: Fields | None, key: str) -> float:
    """Return the inertia that a drive or motor states under a key.

    Parameters
    ----------
    mapping : mapping or None
        Content of a drive or motor file. None for a joint without a motor.
    key : str
        Key of the inertia, such as "rotor_inertia".

    Returns
    -------
    float
        Inertia, kg·m². Missing and invalid values count as 0. The loader of the robot reports
        invalid values later.
    """
    entry = (mapping or {}).get(key)
    value = entry.get("value") if isinstance(entry, Mapping) else entry
    try:
        return 0.0 if value is None else parse_quantity(value, "inertia")
    except BadQuantity:
        return 0.0


def leads_to_container(tree: Fields, path: str) -> bool:
    """Return True if a path leads to an existing mapping or list of a robot file.

    The last key of the path may be new. If it is a gear, the drive must already contain the
    geometry of a gear.

    Parameters
    ----------
    tree : mapping
        Content of the robot file.
    path : str
        Dotted path, such as "joints.tilt.drive.worm". A number stands for an index of a list.
    """
    node: Any = tree
    keys = path.split(".")
    final_key = keys.pop()
    for key in keys:
        try:
            node = node[int(key)] if isinstance(node, list) else node[key]
        except (KeyError, IndexError, ValueError, TypeError):
            return False
    if final_key in GEAR_KEYS:
        return isinstance(node, Mapping) and "geometry" in node
    return isinstance(node, (Mapping, list))
