"""A study as a frozen value: what varies, over which motions, what a candidate must do and what is to be small."""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.problem.value import NotNegative, Value
from ssm_planner.typing import Array, Range
from ssm_planner.units import BadQuantity, quantity

Design = Mapping[str, str]
"""One choice for each path that varies: a quantity with its unit, or the name of a catalogue's entry."""
OBJECTIVES = ("duration", "motor_mass", "motor_margin", "peak_torque", "reach_margin")
"""What `minimise` may name; the margins are made large."""
GEARS = ("worm", "screw")
"""Ends of a path that stand for the gear of a drive: `joints.tilt.drive.worm`."""
PACE = "pace"
"""A path of no robot: by how much slower than the fastest motion the motion is that parts are selected for, 1 or more."""


@dataclass(frozen=True)
class Varied:
    """A quantity between two values, in the unit of the file."""

    path: str
    low: float
    high: float
    unit: str

    def at(self, place: float) -> str:
        """The choice at a place in [0, 1]."""
        return f"{self.low + place * (self.high - self.low):.8g} {self.unit}".rstrip()

    def grid(self, count: int) -> list[str]:
        """`count` choices from end to end."""
        return [self.at(place) for place in np.linspace(0, 1, count)]


@dataclass(frozen=True)
class Choice:
    """One of several entries; contents: what the file says in the place of the path, by the entry's name."""

    path: str
    contents: Mapping[str, Any]
    select: str | None = None
    """Not searched: the first of this rank that holds what the fastest motion, at the candidate's pace, demands."""
    beside: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Mass (kg) and length (m) that a catalogue states of an entry, by the entry's name."""

    def at(self, place: float) -> str:
        """The choice at a place in [0, 1]."""
        names = list(self.contents)
        return names[min(int(place * len(names)), len(names) - 1)]

    def grid(self, count: int) -> list[str]:
        """Every entry."""
        return list(self.contents)


Variable = Varied | Choice


@dataclass(frozen=True, eq=False)
class Requirements(Value):
    """What a candidate must do to be a result."""

    reach: Range | None = None
    """Signed tilts that its workspace must hold, rad."""
    reach_margin: NotNegative = 0.0
    """Tilt beyond both ends, rad."""
    self_locking: bool = False
    motor_margin: NotNegative = 0.0
    """Smallest margin of torque and continuous torque of every motor."""


@dataclass(frozen=True)
class Search:
    """How candidates are chosen. points: how many, or for a grid how many of each span."""

    method: Literal["sobol", "grid", "tpe", "nsga2"] = "sobol"
    points: int = 256
    seed: int = 0

    @property
    def adaptive(self) -> bool:
        """Later candidates depend on what was found of earlier ones."""
        return self.method in ("tpe", "nsga2")


@dataclass(frozen=True, eq=False)
class Study:
    """A robot as its file says it, references followed; motions as theirs do, without their robot."""

    name: str
    robot: Mapping[str, Any]
    motions: Mapping[str, Mapping[str, Any]]
    vary: tuple[Variable, ...]
    """What is searched."""
    require: Requirements
    minimise: tuple[str, ...]
    search: Search
    file: str | None = None
    selected: tuple[Choice, ...] = ()
    """Motors and gears that follow from the demands of a candidate's motions."""

    @cached_property
    def paths(self) -> tuple[str, ...]:
        """What varies."""
        return tuple(variable.path for variable in self.vary)

    @property
    def notes(self) -> list[str]:
        """What a reader of the results has to know."""
        fixed = [body["name"] for body in self.robot["bodies"] if "parts" not in body]
        paths = [*self.paths, *(choice.path for choice in self.selected)]
        if not fixed or not any(
            path.startswith("geometry.") or path.endswith(".motor") for path in paths
        ):
            return []
        return [
            f"Bodies as the robot file gives them ({', '.join(fixed)}): they turn with the axes, but keep mass, centre and "
            "inertia whatever geometry and motors are chosen; bodies given by parts would follow."
        ]

    @property
    def own_words(self) -> str:
        """What the study's own robot is, to which candidates are compared."""
        if self.selected:
            return "The study's own robot with motors and gears selected in the same way, at pace 1"
        return "The study's own robot as it stands"

    def whole(self, design: Design, figures: Mapping[str, Any]) -> dict[str, str]:
        """What was chosen for a candidate, and what was selected for it as its figures say."""
        return {
            **design,
            **{each.path: figures[each.path] for each in self.selected if each.path in figures},
        }

    def designs(self) -> Iterator[Design]:
        """The candidates of a search that is not adaptive, in order."""
        search = self.search
        if search.method == "grid":
            for choices in itertools.product(
                *(variable.grid(search.points) for variable in self.vary)
            ):
                yield dict(zip(self.paths, choices, strict=True))
            return
        for place in sobol(len(self.vary), search.points, search.seed):
            yield self.design(place)

    def design(self, place: Sequence[float] | Array) -> Design:
        """The candidate at a place (d,) in the unit cube, one number in [0, 1] for each variable."""
        return {
            variable.path: variable.at(float(x))
            for variable, x in zip(self.vary, place, strict=True)
        }

    def resolved(self, design: Design) -> dict[str, Any]:
        """What the robot file of a candidate says; with an empty design the study's own robot."""
        tree = copy.deepcopy(dict(self.robot))
        for variable in (*self.vary, *self.selected):
            if variable.path not in design or variable.path == PACE:
                continue
            chosen = design[variable.path]
            _put(
                tree,
                variable.path,
                variable.contents[chosen] if isinstance(variable, Choice) else chosen,
            )
        for path in design:
            if path.startswith("joints.") and path.endswith(".motor"):
                _with_rotor(
                    tree["joints"][path.split(".")[1]], self.robot["joints"][path.split(".")[1]]
                )
        return tree


def sobol(dimensions: int, points: int, seed: int) -> Array:
    """Places (points, dimensions) in the unit cube: a scrambled Sobol' sequence, the same for the same seed."""
    from scipy.stats import qmc

    sampler = qmc.Sobol(dimensions, scramble=True, seed=seed)
    return np.asarray(sampler.random_base2(math.ceil(math.log2(max(points, 1)))))[:points]


def _put(tree: dict[str, Any], path: str, content: Any) -> None:
    """Set what stands at a dotted path; a mapping of a gear or of dotted keys goes into what is there."""
    parts = path.split(".")
    gear = parts.pop() if parts[-1] in GEARS else None
    node: Any = tree
    for part in parts[:-1]:
        node = node[int(part)] if isinstance(node, list) else node.setdefault(part, {})
    place: Any = int(parts[-1]) if isinstance(node, list) else parts[-1]
    if gear is None:
        node[place] = content
        return
    drive = node[place] = dict(node[place])
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


def _with_rotor(joint: dict[str, Any], own: Mapping[str, Any]) -> None:
    """Puts the motor's rotor into the drive's input inertia, in the place of that of the study's own robot.

    Where that states no rotor the new one is added whole, which is an upper bound.
    """
    if "drive" not in joint:
        return
    inertia = _inertia(joint["drive"], "input_inertia") - _inertia(
        own.get("motor"), "rotor_inertia"
    )
    inertia += _inertia(joint["motor"], "rotor_inertia")
    source = "the drive's, with the rotor of the motor chosen"
    joint["drive"] = {
        **joint["drive"],
        "input_inertia": {"value": f"{inertia:.12g} kg*m^2", "source": source},
    }


def _inertia(part: Mapping[str, Any] | None, key: str) -> float:
    """kg·m²; 0 where it is not given, or is none: then the motor's own reading says so."""
    given = (part or {}).get(key)
    value = given.get("value") if isinstance(given, Mapping) else given
    try:
        return 0.0 if value is None else quantity(value, "inertia")
    except BadQuantity:
        return 0.0


def _nested(tree: dict[str, Any], parts: list[str], value: Any) -> None:
    for part in parts[:-1]:
        tree[part] = dict(tree.get(part) or {})
        tree = tree[part]
    tree[parts[-1]] = value


def known(tree: Mapping[str, Any], path: str) -> bool:
    """Whether a path leads to something in a robot file's tree, its last key excepted."""
    node: Any = tree
    parts = path.split(".")
    for part in parts[: -1 if parts[-1] not in GEARS else None]:
        if part in GEARS and part == parts[-1]:
            return isinstance(node, Mapping) and "geometry" in node
        try:
            node = node[int(part)] if isinstance(node, list) else node[part]
        except (KeyError, IndexError, ValueError, TypeError):
            return False
    return isinstance(node, (Mapping, list))


def check_objectives(names: Sequence[str]) -> None:
    """Raises ProblemError for a name that is no objective."""
    for name in names:
        if name not in OBJECTIVES:
            raise ProblemError(
                "not an objective known here",
                key="minimise",
                value=name,
                allowed=", ".join(OBJECTIVES),
            )
