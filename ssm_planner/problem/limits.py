"""The limits that there are, a class for each kind; each knows its place in a problem."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

from ssm_planner.errors import ProblemError
from ssm_planner.problem.limit import (
    TIGHTENING,
    Between,
    P,
    Symmetric,
    in_words,
    outwards,
    replaced,
)
from ssm_planner.problem.limit import Limit as Limit
from ssm_planner.problem.value import Positive, unchecked
from ssm_planner.typing import Range
from ssm_planner.units import shown

if TYPE_CHECKING:
    from typing_extensions import Self

TASK = ("roll", "tilt", "spin", "depth")
"""Order of the task coordinates in every array."""
SPARE = 2e-3
"""Share by which a limit on stops is tightened beyond the excess; twice that is what one that is just enough leaves."""
TO_MOVE = 5e-3
"""Share of a torque or an acceleration beyond what is needed at least: with none the motion creeps, or is the only one."""


@dataclass(frozen=True)
class JointLimit(Symmetric):
    """|value| ≤ largest, of one joint or its motor."""

    field: ClassVar[str]
    """Where a Joint holds it."""
    of: str
    """Name of the joint."""
    largest: Positive
    prismatic: bool = False
    """The joint slides: m instead of rad."""

    @property
    def unit(self) -> str:
        return ("m" if self.prismatic else "rad") + ("", "/s", "/s²", "/s³")[self.order]

    @property
    def words(self) -> str:
        return f"{self.name} limit of joint {self.of} of"

    def on(self, problem: P) -> P:
        return _with_joint(problem, self.of, **{self.field: self.largest})


@dataclass(frozen=True)
class JointPosition(Between):
    """Range of a joint."""

    name = "position"
    of: str
    lower: float
    upper: float
    prismatic: bool = False

    @property
    def unit(self) -> str:
        return "m" if self.prismatic else "rad"

    @property
    def words(self) -> str:
        return f"range of joint {self.of} to"

    def on(self, problem: P) -> P:
        return _with_joint(problem, self.of, position=(self.lower, self.upper))


@dataclass(frozen=True)
class JointVelocity(JointLimit):
    """|q̇| of one joint, rad/s or m/s."""

    name = field = "velocity"
    order = 1

    def trials(self) -> tuple[float, ...]:
        return (2 * self.largest,)


@dataclass(frozen=True)
class JointAcceleration(JointLimit):
    """|q̈| of one joint, rad/s² or m/s²."""

    name = field = "acceleration"
    order = 2

    def enough(self, needed: float) -> float:
        return max(needed, self.largest) * (1 + TO_MOVE)


@dataclass(frozen=True)
class JointJerk(JointLimit):
    """Third derivative of one joint's position, by magnitude, rad/s³ or m/s³."""

    name = field = "jerk"
    order = 3


class MotorLimit(JointLimit):
    """|value| ≤ largest, of a joint's motor, which holds it under `field`."""

    @property
    def words(self) -> str:
        return f"largest {self.name} of joint {self.of} of"

    def on(self, problem: P) -> P:
        motor = _joint(problem, self.of).motor
        if motor is None:
            raise ProblemError(f"joint {self.of} has no motor")
        # a largest torque below the nominal one may be tried
        return _with_joint(problem, self.of, motor=unchecked(motor, **{self.field: self.largest}))


@dataclass(frozen=True)
class MotorSpeed(MotorLimit):
    """Speed of one joint's motor by magnitude, rad/s."""

    name = "motor speed"
    field = "max_speed"
    order = 1
    unit = "rad/s"


READ_IN = {MotorSpeed.name: "rpm"}
"""Units in which people read the values of limits, by their names, where that is not what follows from the SI unit."""


@dataclass(frozen=True)
class MotorTorque(MotorLimit):
    """Of the shaft, at every instant, breaking away included."""

    name = "motor torque"
    field = "max_torque"
    order = 2
    unit = "N·m"

    def enough(self, needed: float) -> float:
        return max(needed, self.largest) * (1 + TO_MOVE)

    def trials(self) -> tuple[float, ...]:
        return (2 * self.largest,)


@dataclass(frozen=True)
class ContinuousTorque(MotorLimit):
    """Of the root mean square of the motor torque over a motion."""

    name = "continuous torque"
    field = "nominal_torque"
    order = 2
    unit = "N·m"

    @property
    def words(self) -> str:
        return f"continuous torque of joint {self.of} of"

    def tightened(self, worst: float, bound: float) -> Self | None:
        return None


@dataclass(frozen=True)
class NutContact(Limit):
    """Both halves of a preloaded nut bear on the screw: the force between them stays positive."""

    name = "nut contact"
    order = 2
    of: str
    unit = "N"
    low = 0.0


@dataclass(frozen=True)
class SelfLocking(Limit):
    """The drive holds without torque: its friction coefficient is never below what its lead angle asks for."""

    name = "self-locking"
    of: str
    friction: Positive
    """Lowest plausible coefficient; what it has to be at least follows from the geometry (dynamics/transmission.py)."""
    unit = "μ"

    def bound(self, value: float) -> float:
        return self.friction

    def relaxed(self, value: float) -> SelfLocking:
        return replace(self, friction=max(self.friction, value))

    def described(self, value: float) -> str:
        return f"lowest friction coefficient μ of joint {self.of} of {value:.6g} instead of {self.friction:.6g}"

    def on(self, problem: P) -> P:
        drive = _joint(problem, self.of).drive
        if drive is None or drive.friction is None:
            raise ProblemError(f"joint {self.of} has no drive with friction")
        friction, lowest = drive.friction, self.friction
        raised = replace(
            friction,
            mu=max(friction.mu, lowest),
            mu_static=max(friction.mu_static, lowest),
            mu_lowest=lowest,
        )
        return _with_joint(problem, self.of, drive=replace(drive, friction=raised))


@dataclass(frozen=True)
class TaskRange(Between):
    """Range of one task coordinate."""

    coordinate: str
    """One of TASK."""
    lower: float
    upper: float

    def _check(self) -> None:
        super()._check()
        _coordinate(self, self.coordinate)

    @property
    def name(self) -> str:
        """Such as "tilt range"."""
        return self.name_of(self.coordinate)

    @staticmethod
    def name_of(coordinate: str) -> str:
        """The name of the limit on the range of a coordinate."""
        return f"{coordinate} range"

    @property
    def unit(self) -> str:
        """rad, or m for depth."""
        return "m" if self.coordinate == "depth" else "rad"

    @property
    def coupled(self) -> bool:
        """It may be left between two points inside it; tilt and depth follow one joint each."""
        return self.coordinate in ("roll", "spin")

    def tightened(self, worst: float, bound: float) -> TaskRange | None:
        inwards = TIGHTENING * abs(worst - bound)
        if not self.coupled or not 2 * inwards < self.upper - self.lower:
            return None
        if worst > bound:
            return replace(self, upper=self.upper - inwards)
        return replace(self, lower=self.lower + inwards)

    def trials(self) -> tuple[float, ...]:
        width = self.upper - self.lower
        return self.lower - width, self.upper + width

    def described(self, value: float) -> str:
        side = "from" if value < self.low else "to"
        return (
            f"range of {self.coordinate} {side} {in_words(value, self.unit)} "
            f"instead of {in_words(self.bound(value), self.unit)}"
        )

    def on(self, problem: P) -> P:
        """The robot's own range makes room where it is the narrower one."""
        whole: Any = problem
        limits = (
            replace(own, lower=min(own.lower, self.lower), upper=max(own.upper, self.upper))
            if own.key == self.key
            else own
            for own in whole.robot.limits
        )
        return _with_own(replaced(problem, robot=replace(whole.robot, limits=tuple(limits))), self)


@dataclass(frozen=True)
class ToolLimit(Symmetric):
    """|value| ≤ largest, of the tool as a whole. A subclass needs `name`, `field` and, where it is not m, `unit`."""

    name: ClassVar[str]
    field: ClassVar[str]
    """Its key in a problem file and in plan.json."""
    largest: Positive
    unit = "m"

    @classmethod
    def kinds(cls) -> tuple[type[ToolLimit], ...]:
        """Those that a problem may have."""
        return (*SpeedLimit.__subclasses__(), StopTravel)

    def trials(self) -> tuple[float, ...]:
        return (2 * self.largest,)

    def on(self, problem: P) -> P:
        return _with_own(problem, self)


@dataclass(frozen=True)
class SpeedLimit(ToolLimit):
    """|v| ≤ largest, v being linear in the joints' rates: kinematics/forward.py has the Jacobian.

    A subclass needs `name`, `field` and, where it is not m/s, `unit`.
    """

    order = 1
    unit = "m/s"


@dataclass(frozen=True)
class TaskRate(Symmetric):
    """|rate| of one task coordinate."""

    order = 1
    coordinate: str
    """One of TASK."""
    largest: Positive

    def _check(self) -> None:
        _coordinate(self, self.coordinate)

    @property
    def name(self) -> str:
        """Such as "tilt rate"; "insertion speed" for depth."""
        return self.name_of(self.coordinate)

    @staticmethod
    def name_of(coordinate: str) -> str:
        """The name of the limit on a coordinate's rate."""
        return "insertion speed" if coordinate == "depth" else f"{coordinate} rate"

    @staticmethod
    def field_of(coordinate: str) -> str:
        """The key of the limit on a coordinate's rate in a problem file."""
        return "insertion_speed" if coordinate == "depth" else f"{coordinate}_rate"

    @property
    def unit(self) -> str:
        """rad/s, or m/s for depth."""
        return "m/s" if self.coordinate == "depth" else "rad/s"

    def on(self, problem: P) -> P:
        return _with_own(problem, self)


@dataclass(frozen=True)
class TipSpeed(SpeedLimit):
    """Of the tool's tip through space."""

    name = "tip speed"
    field = "tip_speed"


@dataclass(frozen=True)
class StopTravel(ToolLimit):
    """Of the tip's distance from where it was, during the quickest controlled stop from any instant."""

    name = "stop travel"
    field = "stop_travel"
    order = 2

    def tightened(self, worst: float, bound: float) -> StopTravel:
        # the way of a stop goes with the planner's estimate of it, so that more than the excess is not needed
        return replace(self, largest=self.largest * min(bound / worst, 1.0) * (1 - SPARE))

    def enough(self, needed: float) -> float:
        return (1 + 2 * SPARE) * needed


@dataclass(frozen=True)
class RetinaClearance(Limit):
    """Distance of the tip from the retina."""

    name = "retina clearance"
    clearance: float
    radius: float
    """Of the retina."""
    unit = "m"

    @property
    def low(self) -> float:
        return self.clearance

    @property
    def half_width(self) -> float:
        return self.radius - self.clearance

    def tightened(self, worst: float, bound: float) -> RetinaClearance | None:
        clearance = self.clearance + TIGHTENING * max(bound - worst, 0.0)
        return replace(self, clearance=clearance) if clearance < self.radius else None

    def relaxed(self, value: float) -> RetinaClearance | None:
        # beyond the retina itself no clearance does
        return None if value < 0 else replace(self, clearance=min(self.clearance, value))

    @property
    def words(self) -> str:
        return "clearance from the retina of"

    def on(self, problem: P) -> P:
        return _with_eye(problem, clearance=self.clearance)


@dataclass(frozen=True)
class LensClearance(Limit):
    """The lens enlarged to just touch the shaft's axis, in sizes of the lens: 1 + shaft radius / its smallest semi-axis."""

    name = "lens clearance"
    shaft_radius: float
    thickness: float
    """Smallest semi-axis of the lens, m."""

    @property
    def low(self) -> float:
        return 1.0 + self.shaft_radius / self.thickness

    @property
    def half_width(self) -> float:
        return self.low

    def tightened(self, worst: float, bound: float) -> LensClearance:
        return replace(
            self,
            shaft_radius=self.shaft_radius + TIGHTENING * max(bound - worst, 0.0) * self.thickness,
        )

    def relaxed(self, value: float) -> LensClearance | None:
        # an axis that passes through the lens does so however thin the shaft
        return (
            None
            if value <= 1
            else replace(self, shaft_radius=min(self.shaft_radius, self._radius(value)))
        )

    def rounded(self, value: float) -> float:
        scale = shown("m")[1] * self.thickness
        return 1 + outwards(scale * (value - 1), scale * (self.low - 1)) / scale

    def described(self, value: float) -> str:
        return f"radius of the shaft of {in_words(self._radius(value), 'm')} instead of {in_words(self.shaft_radius, 'm')}"

    def on(self, problem: P) -> P:
        return _with_eye(problem, shaft_radius=self.shaft_radius)

    def _radius(self, ratio: float) -> float:
        return (ratio - 1) * self.thickness


@dataclass(frozen=True)
class Duration(Limit):
    """The duration asked for, of one motion or of all together: what a motion takes at least must not be longer."""

    name = "duration"
    largest: Positive
    motion: str | None = None
    """Name of the motion; None: all together."""
    asked: float | None = None
    """What the problem asks for of that motion; None: `largest`."""
    exact: bool = False
    """The motions have durations of their own: only their sum does."""
    unit = "s"

    @property
    def high(self) -> float:
        return self.largest

    def relaxed(self, value: float) -> Duration:
        longer = value if self.exact else max(self.largest, value)
        return replace(self, largest=longer, asked=self.asked or self.largest)

    def enough(self, needed: float) -> float:
        # with nothing to spare the least effort is the fastest motion, and hard to find
        return needed if self.exact else 1.002 * needed

    @property
    def words(self) -> str:
        return "a duration of"

    @property
    def key(self) -> tuple[str, str | None]:
        return self.name, self.motion

    def on(self, problem: P) -> P:
        whole: Any = problem
        asked = self.asked or self.largest
        short = [
            m.kind != "dwell" and (m.name, m.duration) == (self.motion, asked) for m in whole.motion
        ]
        if not any(short):  # a motion without one of its own has a share of that of all
            if self.motion is not None and whole.duration is None:
                raise ProblemError(f"no motion {self.motion} of {asked:g} s", key="duration")
            return replaced(problem, duration=self.largest)
        timed = (
            replace(m, duration=self.largest) if k else m
            for m, k in zip(whole.motion, short, strict=True)
        )
        return replaced(problem, motion=tuple(timed))


@dataclass(frozen=True)
class OfPath(Limit):
    """What a problem promises of the tip's way. The check alone holds it: nothing tightens or relaxes it."""

    largest: Positive
    unit = "m"

    @property
    def high(self) -> float:
        return self.largest


@dataclass(frozen=True)
class PathDeparture(OfPath):
    """Distance of the tip from the lines and arcs that it is to follow, but for rounded corners."""

    name = "path departure"


@dataclass(frozen=True)
class CornerRounding(OfPath):
    """Distance of the tip from a corner where it is off its lines."""

    name = "corner rounding"


@dataclass(frozen=True)
class RetinaDistance(OfPath):
    """Distance that the tip keeps from the retina all along a curve."""

    name = "retina distance"


@dataclass(frozen=True)
class ConstantSpeed(OfPath):
    """Of the tip all along a curve, but for ramps at its ends, with no other limit in the way."""

    name = "constant speed"
    unit = "m/s"


PROMISES = tuple(str(kind.name) for kind in OfPath.__subclasses__())
"""Names of what a problem promises of the tip's way."""
ENDS = ("start velocity", "end velocity")
JUMPS = (
    *(f"{kind.name} jump" for kind in (JointPosition, JointVelocity, JointAcceleration)),
    *ENDS,
)
"""Names of the limits on jumps, also from and to rest, which tables leave out while they are kept."""


@dataclass(frozen=True)
class FixedLimit(JointLimit):
    """A bound that the check alone holds: no problem has it, so nothing tightens or relaxes it."""

    def tightened(self, worst: float, bound: float) -> Self | None:
        return None

    def relaxed(self, value: float) -> Self | None:
        return None


@dataclass(frozen=True)
class Jump(FixedLimit):
    """Largest step of a joint's position, velocity or acceleration where two pieces of a trajectory meet."""

    derivative: int = 0
    """0, 1 or 2."""

    on = Limit.on

    @property
    def name(self) -> str:
        return JUMPS[self.derivative]

    @property
    def unit(self) -> str:
        return ("m" if self.prismatic else "rad") + ("", "/s", "/s²")[self.derivative]


@dataclass(frozen=True)
class EndVelocity(FixedLimit):
    """Largest difference of a joint's velocity, where the motion starts or ends, from what is declared there: rest."""

    order = 1
    at_end: bool = False

    @property
    def name(self) -> str:
        return ENDS[self.at_end]


OFFSETS = ("velocity offset", "torque offset")


@dataclass(frozen=True)
class FeedForward(FixedLimit):
    """Largest difference of a drive's velocity or torque offset from what its target positions ask for."""

    of_torque: bool = False

    @property
    def name(self) -> str:
        """One of OFFSETS."""
        return OFFSETS[self.of_torque]

    @property
    def unit(self) -> str:
        """SI."""
        return "N·m" if self.of_torque else ("m" if self.prismatic else "rad") + "/s"


class Limited:
    """What a value with `limits` says of them."""

    limits: tuple[Limit, ...]

    @property
    def ranges(self) -> dict[str, Range]:
        """Ranges of task coordinates, by name in TASK; rad or m."""
        return {
            limit.coordinate: (limit.low, limit.high)
            for limit in self.limits
            if isinstance(limit, TaskRange)
        }

    @property
    def rates(self) -> dict[str, float]:
        """Largest |rate| of task coordinates, by name in TASK; rad/s or m/s."""
        return {
            limit.coordinate: limit.largest for limit in self.limits if isinstance(limit, TaskRate)
        }

    @property
    def of_tool(self) -> tuple[ToolLimit, ...]:
        """Limits on speeds of the tool and on its stops."""
        return tuple(limit for limit in self.limits if isinstance(limit, ToolLimit))

    @property
    def speeds(self) -> tuple[SpeedLimit, ...]:
        """Limits on speeds of the tool."""
        return tuple(limit for limit in self.limits if isinstance(limit, SpeedLimit))

    @property
    def stop_travel(self) -> StopTravel | None:
        """On the way of the tip while it stops."""
        return next((limit for limit in self.limits if isinstance(limit, StopTravel)), None)

    @property
    def tip_speed(self) -> float | None:
        """m/s."""
        return next((limit.largest for limit in self.limits if isinstance(limit, TipSpeed)), None)


def task_limits(limits: Iterable[Limit], where: str = "limits") -> tuple[Limit, ...]:
    """Limits of the task as a tuple. Raises ProblemError for what is none, and for one given twice."""
    found = tuple(limits)
    for limit in found:
        if not isinstance(limit, (TaskRange, TaskRate, ToolLimit)):
            raise ProblemError(
                "not a limit of the task",
                key=where,
                value=limit,
                allowed="TaskRange, TaskRate, TipSpeed, StopTravel",
            )
        if [other.key for other in found].count(limit.key) > 1:
            raise ProblemError(
                "given twice", key=where, value=limit.name, allowed="each limit once"
            )
    return found


def _coordinate(limit: Limit, name: str) -> None:
    if name not in TASK:
        raise ProblemError(
            "unknown task coordinate",
            key=f"{type(limit).__name__}.coordinate",
            value=name,
            allowed=", ".join(TASK),
        )


def _joint(problem: Any, name: str) -> Any:
    for joint in problem.robot.joints:
        if joint.name == name:
            return joint
    raise ProblemError(
        "unknown joint",
        key="joint",
        value=name,
        allowed=", ".join(joint.name for joint in problem.robot.joints),
    )


def _with_joint(problem: P, name: str, **changes: Any) -> P:
    whole: Any = problem
    changed = replace(_joint(problem, name), **changes)
    joints = tuple(changed if joint.name == name else joint for joint in whole.robot.joints)
    return replaced(problem, robot=replace(whole.robot, joints=joints))


def _with_own(problem: P, limit: Limit) -> P:
    whole: Any = problem
    if all(other.key != limit.key for other in whole.limits):
        return replaced(problem, limits=(*whole.limits, limit))
    return replaced(
        problem, limits=tuple(limit if other.key == limit.key else other for other in whole.limits)
    )


def _with_eye(problem: P, **changes: Any) -> P:
    whole: Any = problem
    if whole.eye is None:
        raise ProblemError("the problem has no eye")
    return replaced(problem, eye=replace(whole.eye, **changes))
