"""Define a study as a frozen value: variables, motions, requirements and objectives."""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np

from ssm_planner.deprecation import Renamed
from ssm_planner.problem.value import NotNegative, Value
from ssm_planner.representation import ShortRepr
from ssm_planner.typing import Array, JsonObject, Range, record
from ssm_planner.units import BadQuantity, quantity

Design = Mapping[str, str]
"""One choice for each path: a quantity with its unit, or the name of a catalogue entry."""
OBJECTIVES = ("duration", "motor_mass", "motor_margin", "peak_torque", "reach_margin")
"""Values that `minimise` may name; the search maximises margins."""
GEARS = ("worm", "screw")
"""Last keys of a path that replace the gear of a drive, such as `joints.tilt.drive.worm`."""
PACE = "pace"
"""Path of the factor, at least 1, by which the motion for the selection of parts is slowed down."""


@dataclass(frozen=True)
class Varied:
    """A quantity between two values, in the unit of the file."""

    path: str
    low: float
    high: float
    unit: str

    def value_at(self, position: float) -> str:
        """Return the choice at a position in [0, 1]: a quantity with its unit."""
        return f"{self.low + position * (self.high - self.low):.8g} {self.unit}".rstrip()

    def grid(self, count: int) -> list[str]:
        """Return `count` equidistant choices, including both ends."""
        return [self.value_at(position) for position in np.linspace(0, 1, count)]

    at = Renamed("value_at")


@dataclass(frozen=True)
class Choice(ShortRepr):
    """One of several entries.

    contents: the value that the robot file gets at the path, by the entry's name.
    """

    path: str
    contents: Mapping[str, Any]
    select: str | None = None
    """Rank for selection instead of search; the first entry that meets the demands wins."""
    beside: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Mass (kg) and length (m) that a catalogue states, by the entry's name."""

    def value_at(self, position: float) -> str:
        """Return the name of the entry at a position in [0, 1]."""
        names = list(self.contents)
        return names[min(int(position * len(names)), len(names) - 1)]

    def grid(self, count: int) -> list[str]:
        """Return the names of all entries; `count` has no influence."""
        return list(self.contents)

    at = Renamed("value_at")


Variable = Varied | Choice


@record
class Requirements(Value):
    """Conditions that a candidate must meet."""

    reach: Range | None = None
    """Signed tilts that its workspace must contain, rad."""
    reach_margin: NotNegative = 0.0
    """Tilt beyond both ends, rad."""
    self_locking: bool = False
    motor_margin: NotNegative = 0.0
    """Smallest permitted margin of every motor in torque, continuous torque, speed, heat and
    voltage.
    """


@dataclass(frozen=True)
class Search:
    """Method that generates the candidates.

    points: their number, or for a grid the number per range.
    """

    method: Literal["sobol", "grid", "tpe", "nsga2"] = "sobol"
    points: int = 256
    seed: int = 0

    @property
    def adaptive(self) -> bool:
        """Return whether later candidates depend on the results of earlier ones."""
        return self.method in ("tpe", "nsga2")


@record
class Study(ShortRepr):
    """A robot as in its file, with resolved references, and motions without their robot."""

    name: str
    robot: Mapping[str, Any]
    motions: Mapping[str, Mapping[str, Any]]
    vary: tuple[Variable, ...]
    """Variables of the search."""
    require: Requirements
    minimise: tuple[str, ...]
    search: Search
    file: str | None = None
    selected: tuple[Choice, ...] = ()
    """Motors and gears that follow from the demands of a candidate's motions."""

    @cached_property
    def paths(self) -> tuple[str, ...]:
        """Return the paths of the robot file that vary."""
        return tuple(variable.path for variable in self.vary)

    @property
    def notes(self) -> list[str]:
        """Return remarks that a reader of the results must know."""
        fixed_bodies = [body["name"] for body in self.robot["bodies"] if "parts" not in body]
        paths = [*self.paths, *(choice.path for choice in self.selected)]
        if not fixed_bodies or not any(
            path.startswith("geometry.") or path.endswith(".motor") for path in paths
        ):
            return []
        return [
            f"Bodies as the robot file gives them ({', '.join(fixed_bodies)}): they turn with the "
            "axes, but keep mass, centre and inertia whatever geometry and motors are chosen; "
            "bodies given by parts would follow."
        ]

    @property
    def own_words(self) -> str:
        """Describe the study's own robot, with which candidates are compared."""
        if self.selected:
            return "The study's own robot with motors and gears selected in the same way, at pace 1"
        return "The study's own robot as it stands"

    def complete_design(self, design: Design, figures: Mapping[str, Any]) -> dict[str, str]:
        """Return all choices of a candidate by path: its design and the parts selected for it.

        figures: the candidate's results, which contain the selected parts.
        """
        return {
            **design,
            **{
                choice.path: figures[choice.path]
                for choice in self.selected
                if choice.path in figures
            },
        }

    def designs(self) -> Iterator[Design]:
        """Generate the candidates of a search that is not adaptive, in order."""
        search = self.search
        if search.method == "grid":
            for choices in itertools.product(
                *(variable.grid(search.points) for variable in self.vary)
            ):
                yield dict(zip(self.paths, choices, strict=True))
            return
        for point in sobol(len(self.vary), search.points, search.seed):
            yield self.design(point)

    def design(self, point: Sequence[float] | Array) -> Design:
        """Return the candidate at a point (d,) of the unit cube, one number per variable."""
        return {
            variable.path: variable.value_at(float(x))
            for variable, x in zip(self.vary, point, strict=True)
        }

    def resolved(self, design: Design) -> JsonObject:
        """Return the content of a candidate's robot file.

        An empty design gives the study's own robot.
        """
        tree = copy.deepcopy(dict(self.robot))
        for variable in (*self.vary, *self.selected):
            if variable.path not in design or variable.path == PACE:
                continue
            entry = design[variable.path]
            _put(
                tree,
                variable.path,
                variable.contents[entry] if isinstance(variable, Choice) else entry,
            )
        for path in design:
            if path.startswith("joints.") and path.endswith(".motor"):
                _with_rotor(
                    tree["joints"][path.split(".")[1]], self.robot["joints"][path.split(".")[1]]
                )
        return tree

    whole = Renamed("complete_design")


def sobol(dimensions: int, points: int, seed: int) -> Array:
    """Return points (points, dimensions) of a scrambled Sobol' sequence in the unit cube."""
    from scipy.stats import qmc

    sampler = qmc.Sobol(dimensions, scramble=True, seed=seed)
    return np.asarray(sampler.random_base2(math.ceil(math.log2(max(points, 1)))))[:points]


def _put(tree: JsonObject, path: str, content: Any) -> None:
    """Set the value at a dotted path of `tree`.

    The mapping of a gear, or a mapping with dotted keys, is merged into the existing drive.
    """
    keys = path.split(".")
    gear = keys.pop() if keys[-1] in GEARS else None
    node: Any = tree
    for name in keys[:-1]:
        node = node[int(name)] if isinstance(node, list) else node.setdefault(name, {})
    key: Any = int(keys[-1]) if isinstance(node, list) else keys[-1]
    if gear is None:
        node[key] = content
        return
    drive = node[key] = dict(node[key])
    geometry = {
        key.removeprefix("geometry."): value
        for key, value in content.items()
        if key.startswith("geometry.")
    }
    if geometry:
        thread = drive["geometry"].get("thread_angle")
        drive["geometry"] = geometry if thread is None else {"thread_angle": thread, **geometry}
    for key, value in content.items():
        if not key.startswith("geometry."):
            _nested(drive, key.split("."), value)


def _with_rotor(joint: JsonObject, original: Mapping[str, Any]) -> None:
    """Replace the rotor inertia in a drive's input inertia by that of the joint's motor.

    own: the joint of the study's own robot. If its motor states no rotor inertia, the new one is
    added, which is an upper bound.
    """
    if "drive" not in joint:
        return
    inertia = _inertia(joint["drive"], "input_inertia") - _inertia(
        original.get("motor"), "rotor_inertia"
    )
    inertia += _inertia(joint["motor"], "rotor_inertia")
    source = "the drive's, with the rotor of the motor chosen"
    joint["drive"] = {
        **joint["drive"],
        "input_inertia": {"value": f"{inertia:.12g} kg*m^2", "source": source},
    }


def _inertia(mapping: Mapping[str, Any] | None, key: str) -> float:
    """Return the inertia that a drive or motor states under `key`, kg·m².

    Missing and invalid values count as 0; the loader of motors reports invalid ones.
    """
    entry = (mapping or {}).get(key)
    value = entry.get("value") if isinstance(entry, Mapping) else entry
    try:
        return 0.0 if value is None else quantity(value, "inertia")
    except BadQuantity:
        return 0.0


def _nested(tree: JsonObject, keys: list[str], value: Any) -> None:
    """Set a value below nested mappings; copy every mapping on the way."""
    for key in keys[:-1]:
        tree[key] = dict(tree.get(key) or {})
        tree = tree[key]
    tree[keys[-1]] = value


def path_exists(tree: Mapping[str, Any], path: str) -> bool:
    """Return whether a path leads to an existing part of a robot file; its last key may be new."""
    node: Any = tree
    keys = path.split(".")
    for key in keys[: -1 if keys[-1] not in GEARS else None]:
        if key in GEARS and key == keys[-1]:
            return isinstance(node, Mapping) and "geometry" in node
        try:
            node = node[int(key)] if isinstance(node, list) else node[key]
        except (KeyError, IndexError, ValueError, TypeError):
            return False
    return isinstance(node, (Mapping, list))
