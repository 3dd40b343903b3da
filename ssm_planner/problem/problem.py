"""Problems as frozen values: points, motions, the eye, limits. SI floats and radians, arrays read-only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ssm_planner.problem.limits import TASK as TASK
from ssm_planner.problem.limits import LensClearance, Limit, Limited, RetinaClearance, task_limits
from ssm_planner.problem.robot import Robot, check_rotation
from ssm_planner.problem.value import Matrix, NotNegative, Positive, Value, Vector


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
class Lens(Value):
    """An ellipsoid that the shaft keeps clear of, base frame, m."""

    centre: Vector
    """(3,)."""
    semi_axes: Vector
    """(3,), along the columns of `frame`."""
    frame: Matrix
    """(3, 3), rotation base ← lens."""

    def _check(self) -> None:
        for i, length in enumerate(self.semi_axes.tolist()):
            if not length > 0:
                raise self._wrong(f"semi_axes[{i}]", "not the half of a lens", "above 0", length)
        check_rotation(self, "frame")


@dataclass(frozen=True, eq=False)
class Eye(Value):
    """The eye about the remote centre, base frame, m: the retina as a sphere, and the lens where there is one."""

    centre: Vector
    """(3,)."""
    radius: Positive
    clearance: NotNegative
    """Least distance of the tip from the retina."""
    port: Positive
    """Within this distance of the remote centre there is no retina: the incision itself."""
    shaft_radius: NotNegative = 0.0
    """Added around the shaft where it passes the lens."""
    lens: Lens | None = None

    @property
    def limits(self) -> tuple[Limit, ...]:
        """What it limits."""
        retina = RetinaClearance(self.clearance, self.radius)
        if self.lens is None:
            return (retina,)
        return retina, LensClearance(self.shaft_radius, float(self.lens.semi_axes.min()))

    def _check(self) -> None:
        if not self.clearance < self.radius:
            raise self._wrong("clearance", "nothing is left of the eye", f"less than the radius, {_mm(self.radius)}")
        if self.lens is None:
            return
        for i, length in enumerate(self.lens.semi_axes.tolist()):
            if not length < self.radius:
                allowed = f"above 0 and below {_mm(self.radius)}"
                raise self._wrong(f"lens.semi_axes[{i}]", "not the half of a lens", allowed, length)
        if np.linalg.norm(self.lens.centre - self.centre) > self.radius:
            allowed = f"within {_mm(self.radius)} of the eye's centre"
            raise self._wrong("lens.centre", "outside the eye", allowed, self.lens.centre.tolist())

    def check_port(self) -> None:
        """Raises ProblemError where a tool through the remote centre could not work in this eye."""
        distance = float(np.linalg.norm(self.centre))
        if abs(distance - self.radius) > self.port:
            raise self._wrong(
                "centre",
                f"the remote centre is {_mm(distance)} from the centre of an eye of radius {_mm(self.radius)}, "
                f"so the port is not at its wall",
                f"{_mm(self.radius - self.port)} to {_mm(self.radius + self.port)} from the remote centre",
            )
        # without this the tip could not get from the port into the eye and keep the clearance all the way
        room = self.port - (distance - self.radius)
        if not self.clearance < room:
            reason = "the tip cannot keep this distance from the wall where it leaves the port"
            raise self._wrong("clearance", reason, f"less than {_mm(room)}, or a larger port")
        if self.lens is None:
            return
        ratio = float(np.linalg.norm(self.lens.frame.T @ self.lens.centre / self.lens.semi_axes))
        least = 1 + self.shaft_radius / float(self.lens.semi_axes.min())
        if ratio <= least:
            raise self._wrong(
                "lens.centre",
                "the lens is where the shaft enters the eye",
                f"a place from where the lens, enlarged {least:.4g} times, does not reach the remote centre",
                self.lens.centre.tolist(),
            )


def _mm(length: float) -> str:
    return f"{1e3 * length:.5g} mm"


@dataclass(frozen=True, eq=False)
class TaskLimits(Limited):
    """Limits on where the tool is and how fast it goes, beside those of the joints."""

    limits: tuple[Limit, ...] = ()
    eye: Eye | None = None

    @property
    def all_limits(self) -> tuple[Limit, ...]:
        """Those of the eye too."""
        return self.limits if self.eye is None else (*self.limits, *self.eye.limits)


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
class Problem(Limited):
    """What is to be planned: a robot, where it starts, its motion phase after phase, and the limits it keeps."""

    name: str
    robot: Robot
    start: Target
    motion: tuple[Motion, ...]
    limits: tuple[Limit, ...] = ()
    """Of the task: ranges (the robot's, narrowed by the problem's), rates and speeds; those of the joints are in robot."""
    objective: Objective = "time then heat"
    file: str | None = None
    eye: Eye | None = None
    start_rate: Mapping[str, float] = field(default_factory=dict)
    """Rates of task coordinates at the very start, by name in TASK; 0 where not named."""
    end_rate: Mapping[str, float] = field(default_factory=dict)
    duration: float | None = None
    """Of everything together where it is asked for, s."""
    planner: Planner = "optimal"
    """"toppra": straight motions timed by TOPP-RA alone, several times faster; without jerk limits."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "limits", task_limits(self.limits))

    @property
    def task_limits(self) -> TaskLimits:
        return TaskLimits(self.limits, self.eye)

    @property
    def all_limits(self) -> tuple[Limit, ...]:
        """Every limit that holds for a motion: those of joints and motors, of the task and of the eye."""
        of_joints = (limit for joint in self.robot.joints for limit in joint.limits)
        return (*of_joints, *self.task_limits.all_limits)
