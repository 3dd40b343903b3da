"""Define a study as an immutable value: variables, motions, requirements and objectives."""

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
from ssm_planner.units import BadQuantity, quantity

Design = Mapping[str, str]
"""Value at each varied path of the robot file: a quantity with unit, or the name of an entry."""
OBJECTIVES = ("duration", "motor_mass", "motor_margin", "peak_torque", "reach_margin")
"""Results that `minimise` can name. Margins are maximised."""
GEAR_KEYS = ("worm", "screw")
"""Last key of a path that replaces the gear of a drive, such as `joints.tilt.drive.worm`."""
MAX_CANDIDATES = 10_000_000
"""Largest number of candidates. The results of more would not fit into memory."""
SOBOL_BLOCK_SIZE = 4096
"""Number of points of a Sobol' sequence that are drawn at once, a power of 2."""
PACE_PATH = "pace"
"""Path of the factor (at least 1) by which motions are slowed down for the selection of parts."""


@frozen
class Varied:
    """A quantity that varies between two values, in the unit of the file.

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
        """Return the value with its unit at a position from 0 (`low`) to 1 (`high`)."""
        return f"{self.low + position * (self.high - self.low):.8g} {self.unit}".rstrip()

    def grid(self, count: int) -> list[str]:
        """Return `count` equidistant values with their unit, including both ends."""
        return [self.value_at(position) for position in np.linspace(0, 1, count)]

    at = Renamed("value_at")


@frozen
class Choice:
    """A choice among several entries, such as the motors of a catalogue.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> choice = ssm.Choice("joints.roll.motor", {"small": {}, "large": {}})
    >>> choice.value_at(0.9)
    'large'
    """

    path: str
    contents: Fields
    """Content that an entry has in the robot file, by name of the entry."""
    select: str | None = None
    """Rank by which the first suitable entry is selected. None means that entries are searched."""
    beside: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Mass (kg) and length (m) that a catalogue states, by name of the entry."""

    def value_at(self, position: float) -> str:
        """Return the name of the entry at a position from 0 to 1."""
        names = list(self.contents)
        return names[min(int(position * len(names)), len(names) - 1)]

    def grid(self, count: int) -> list[str]:
        """Return the names of all entries, for any `count`."""
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
    """Range of signed tilts that the workspace must contain, rad."""
    reach_margin: Annotated[NotNegative, "angle"] = 0.0
    """Additional tilt at both ends of this range, rad."""
    self_locking: bool = False
    """True if every drive must hold its load without torque."""
    motor_margin: NotNegative = 0.0
    """Smallest margin that every motor must keep in torque, speed, heat and voltage, as a share."""


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
    """Seed of the random numbers. Equal seeds give equal candidates."""

    @property
    def adaptive(self) -> bool:
        """True if later candidates depend on the results of earlier ones."""
        return self.method in ("tpe", "nsga2")


@record
class Study:
    """A comparison of many variants of a robot, the candidates, over a set of motions.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> study = ssm.load_study("vitreoretinal")
    >>> study.paths[0], study.minimise
    ('geometry.alpha', ('duration', 'motor_mass'))
    """

    name: str
    robot: Fields
    """Content of the robot file, in which drives and motors replace the names of their files."""
    motions: Mapping[str, Fields]
    """Contents of problem files without their robot, by name."""
    vary: tuple[Variable, ...]
    """Variables of the search."""
    require: Requirements
    minimise: tuple[str, ...]
    search: Search
    file: str | None = None
    selected: tuple[Choice, ...] = ()
    """Choices of motors and gears that follow from the motions of a candidate."""

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
        """Number of candidates."""
        if self.search.method != "grid":
            return self.search.points
        return math.prod(
            len(variable.contents) if isinstance(variable, Choice) else self.search.points
            for variable in self.vary
        )

    @cached_property
    def paths(self) -> tuple[str, ...]:
        """Paths of the robot file that vary."""
        return tuple(variable.path for variable in self.vary)

    @property
    def notes(self) -> list[str]:
        """Remarks that a reader of the results must know."""
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
        """Description of the study's own robot, with which the candidates are compared."""
        if self.selected:
            return "The study's own robot with motors and gears selected in the same way, at pace 1"
        return "The study's own robot as it stands"

    def complete_design(self, design: Design, figures: Fields) -> dict[str, str]:
        """Add the selected motors and gears to the design of a candidate.

        `figures` are the results of the candidate, which contain the names of the selected parts.
        """
        result = dict(design)
        for choice in self.selected:
            if choice.path in figures:
                result[choice.path] = figures[choice.path]
        return result

    def designs(self) -> Iterator[Design]:
        """Yield the designs of all candidates. The search must not be adaptive."""
        search = self.search
        if search.method == "grid":
            grids = [variable.grid(search.points) for variable in self.vary]
            for values in itertools.product(*grids):
                yield dict(zip(self.paths, values, strict=True))
            return
        yield from map(self.design, sobol_points(len(self.vary), search.points, search.seed))

    def design(self, point: Sequence[float] | Array) -> Design:
        """Return the design at a point (d,) of the unit cube, with one coordinate per variable."""
        return {
            variable.path: variable.value_at(float(x))
            for variable, x in zip(self.vary, point, strict=True)
        }

    def resolved(self, design: Design) -> JsonObject:
        """Return the content of a candidate's robot file.

        An empty design gives the study's own robot.
        """
        contents = {
            variable.path: variable.contents
            for variable in self.vary + self.selected
            if isinstance(variable, Choice)
        }
        return robot_with_design(self.robot, contents, design)

    whole = Renamed("complete_design")


def robot_with_design(robot: Fields, contents: Mapping[str, Fields], design: Design) -> JsonObject:
    """Return the content of a robot file with the values of a design.

    `robot` is the original content, in which drives and motors replace the names of their files.
    `contents` has the contents of all entries by name, by the path of a choice. Raises ProblemError
    if a choice has no such entry.
    """
    tree = copy.deepcopy(dict(robot))
    for path, text in design.items():
        if path in contents and text not in contents[path]:
            raise ProblemError("no such entry", key=path, value=text)
        if path == PACE_PATH:
            continue  # The pace is not a key of the robot file.
        _set_at_path(tree, path, contents[path][text] if path in contents else number_or_text(text))
    for path in design:
        if path.startswith("joints.") and path.endswith(".motor"):
            joint = path.split(".")[1]
            _replace_rotor(tree["joints"][joint], robot["joints"][joint])
    return tree


def sobol_points(dimensions: int, points: int, seed: int) -> Iterator[Array]:
    """Yield the points (dimensions,) of a scrambled Sobol' sequence in the unit cube."""
    from scipy.stats import qmc

    sampler = qmc.Sobol(dimensions, scramble=True, seed=seed)
    for start in range(0, points, SOBOL_BLOCK_SIZE):
        yield from sampler.random(SOBOL_BLOCK_SIZE)[: points - start]


def _set_at_path(tree: JsonObject, path: str, content: Any) -> None:
    """Set the content at a dotted path of a robot file's content, in place.

    If the path ends with a gear, the content is merged into the existing drive.
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
    """Replace the rotor inertia that a drive's input inertia contains by that of the new motor.

    `original` is the joint of the study's own robot. If the file of its motor does not state the
    rotor inertia, the new rotor inertia is added, which gives an upper bound.
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
    """Return the inertia that a drive or motor states under a key, kg·m².

    Missing and invalid values count as 0, because the loader of motors reports invalid values.
    """
    entry = (mapping or {}).get(key)
    value = entry.get("value") if isinstance(entry, Mapping) else entry
    try:
        return 0.0 if value is None else quantity(value, "inertia")
    except BadQuantity:
        return 0.0


def leads_to_container(tree: Fields, path: str) -> bool:
    """Return True if a path leads to an existing mapping or list of a robot file.

    The last key of the path may be new.
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
