"""Problems as frozen values: points, motions, the eye, limits. SI floats and radians, arrays read-only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from ssm_planner.problem.robot import Robot
from ssm_planner.typing import Array, Range

TASK = ("roll", "tilt", "spin", "depth")
"""Order of the task coordinates in every array."""


@dataclass(frozen=True, eq=False)
class Target:
    """One point of a motion: any subset of task coordinates (the rest held), joint values, or a tip position."""

    task: Mapping[str, float] | None = None
    joints: tuple[float, float, float, float] | None = None
    tip: tuple[float, float, float] | None = None
    spin: float | None = None
    """Used with tip."""
    line: int | None = None
    """Line of the problem file, for messages."""


@dataclass(frozen=True, eq=False)
class Lens:
    """An ellipsoid that the shaft keeps clear of, base frame, m."""

    centre: Array
    """(3,)."""
    semi_axes: Array
    """(3,), along the columns of `frame`."""
    frame: Array
    """(3, 3), rotation base ← lens."""


@dataclass(frozen=True, eq=False)
class Eye:
    """The eye about the remote centre, base frame, m: the retina as a sphere, and the lens where there is one."""

    centre: Array
    """(3,)."""
    radius: float
    clearance: float
    """Least distance of the tip from the retina."""
    port: float
    """Within this distance of the remote centre there is no retina: the incision itself."""
    shaft_radius: float = 0.0
    """Added around the shaft where it passes the lens."""
    lens: Lens | None = None


@dataclass(frozen=True, eq=False)
class TaskLimits:
    """Limits on where the tool is and how fast it goes, beside those of the joints."""

    ranges: Mapping[str, Range] = field(default_factory=dict)
    """By name in TASK, rad or m."""
    tip_speed: float | None = None
    """m/s."""
    rates: Mapping[str, float] = field(default_factory=dict)
    """Largest |rate| of task coordinates by name in TASK, rad/s or m/s."""
    eye: Eye | None = None


@dataclass(frozen=True)
class Scan:
    """Spots on the retina: a raster, or rings one after the other, about the point where the tool's axis meets it."""

    diameters: tuple[float, ...]
    """Of the rings, m; none for a raster."""
    rows: int
    columns: int
    """Of a raster."""
    spacing: float
    """Between neighbouring spots, m; on a ring as nearly as a whole number of spots allows."""
    distance: float
    """Of the tip from the retina, m."""
    dwell: float
    """At every spot, s; 0: the spots are passed without stopping."""


MotionKind = Literal["straight", "free", "dwell", "scan"]


@dataclass(frozen=True, eq=False)
class Motion:
    """One entry of the motion list."""

    kind: MotionKind
    name: str
    """The key in the file: tilt, roll, spin, insert, straight, free, dwell."""
    target: Target | None = None
    duration: float | None = None
    """Of a dwell; of another motion where it is asked for, s."""
    line: int | None = None
    through: tuple[Target, ...] = ()
    """Points that a free motion passes without stopping, in order, before its target."""
    scan: Scan | None = None
    """Its target is the task coordinates at which the tool points to the middle of the pattern."""


Objective = Literal["time", "time then heat", "effort"]
Planner = Literal["optimal", "toppra"]


@dataclass(frozen=True, eq=False)
class Problem:
    name: str
    robot: Robot
    start: Target
    motion: tuple[Motion, ...]
    limits: Mapping[str, Range] = field(default_factory=dict)
    """Ranges of task coordinates, by name in TASK: the robot's, narrowed by the problem's."""
    tip_speed: float | None = None
    objective: Objective = "time then heat"
    file: str | None = None
    rates: Mapping[str, float] = field(default_factory=dict)
    """Largest |rate| of task coordinates by name in TASK, rad/s or m/s."""
    eye: Eye | None = None
    start_rate: Mapping[str, float] = field(default_factory=dict)
    """Rates of task coordinates at the very start, by name in TASK; 0 where not named."""
    end_rate: Mapping[str, float] = field(default_factory=dict)
    duration: float | None = None
    """Of everything together where it is asked for, s."""
    planner: Planner = "optimal"
    """"toppra": straight motions timed by TOPP-RA alone, several times faster; without jerk limits."""

    @property
    def task_limits(self) -> TaskLimits:
        return TaskLimits(self.limits, self.tip_speed, self.rates, self.eye)
