"""Define a class for each kind of limit, on joints, motors, task coordinates, tool and path.

A limit belongs to the robot, its motors and drives, the task or the eye. The planner converts
limits to constraints, and the check evaluates them on the planned motion. The base classes in
`limit.py` state the properties and methods that a limit must have. `Limited` is the base of all
values that contain limits.
"""

from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, ClassVar, TypeVar

from ssm_planner.errors import ProblemError
from ssm_planner.problem.limit import (
    TIGHTENING_FACTOR,
    P,
    RangeLimit,
    SymmetricLimit,
    format_quantity,
    replace_fields,
    round_away,
)
from ssm_planner.problem.limit import Limit as Limit
from ssm_planner.problem.value import NotNegative, Positive, check_name, unchecked_copy
from ssm_planner.typing import Range, frozen
from ssm_planner.units import display_unit

TASK_COORDINATES = ("roll", "tilt", "spin", "depth")
"""Order of the task coordinates in every array."""
STOP_RESERVE = 2e-3
"""Relative reserve of a limit on the travel of stops.

The limit is tightened by this share in addition to the excess. `sufficient_bound` adds twice this
share.
"""
FEASIBILITY_RESERVE = 5e-3
"""Relative amount by which a torque or acceleration limit exceeds the smallest necessary value.

Without this reserve, the motion would creep, or it would be the only feasible one.
"""


def derived_unit(slides: bool, order: int) -> str:
    """Return the SI unit of the time derivative of order 0 to 3 of a joint position.

    The position is a length if `slides` is true, and otherwise an angle.
    """
    return ("m" if slides else "rad") + ("", "/s", "/s²", "/s³")[order]


@frozen
class JointLimit(SymmetricLimit):
    """Limit |value| ≤ largest of one joint or its motor."""

    field: ClassVar[str]
    """Field of Joint or Motor that stores the limit."""
    of: str
    """Name of the joint."""
    largest: Positive
    prismatic: bool = False
    """True for a prismatic joint, whose values are in m instead of rad."""

    words = "{limit.name} limit of joint {limit.of} of"

    @property
    def unit(self) -> str:
        return derived_unit(self.prismatic, self.order)

    def on(self, problem: P) -> P:
        return _change_joint(problem, self.of, **{self.field: self.largest})

    def _with_reserve(self, needed: float) -> float:
        """Return the larger one of the needed value and the bound, increased by a reserve."""
        return max(needed, self.largest) * (1 + FEASIBILITY_RESERVE)


@frozen
class JointPosition(RangeLimit):
    """Range of one joint position, rad or m."""

    name = "position"
    of: str
    lower: float
    upper: float
    prismatic: bool = False

    words = "range of joint {limit.of} to"

    @property
    def unit(self) -> str:
        return derived_unit(self.prismatic, 0)

    def on(self, problem: P) -> P:
        return _change_joint(problem, self.of, position=(self.lower, self.upper))


class JointVelocity(JointLimit):
    """Largest |q̇| of one joint, rad/s or m/s."""

    name = field = "velocity"
    order = 1
    trials = SymmetricLimit.doubled


class JointAcceleration(JointLimit):
    """Largest |q̈| of one joint, rad/s² or m/s²."""

    name = field = "acceleration"
    order = 2
    sufficient_bound = JointLimit._with_reserve


class JointJerk(JointLimit):
    """Largest magnitude of the third derivative of one joint position, rad/s³ or m/s³."""

    name = field = "jerk"
    order = 3


class MotorLimit(JointLimit):
    """Limit |value| ≤ largest on the motor of one joint."""

    words = "largest {limit.name} of joint {limit.of} of"

    def on(self, problem: P) -> P:
        """Return a copy of a problem in which the motor of the joint has this limit."""
        motor = _joint_named(problem, self.of).motor
        if motor is None:
            raise ProblemError(f"joint {self.of} has no motor")
        # The checks of a motor are skipped, because a trial value of the largest torque may be
        # below the nominal torque.
        return _change_joint(
            problem, self.of, motor=unchecked_copy(motor, **{self.field: self.largest})
        )


@frozen
class MotorSpeed(MotorLimit):
    """Largest motor speed of one joint, rad/s."""

    name = "motor speed"
    field = "max_speed"
    order = 1
    unit = "rad/s"


MESSAGE_UNITS = {MotorSpeed.name: "rpm"}
"""Units of limits in messages, by the name of the limit.

Messages state other limits in the default unit for their SI unit.
"""


@frozen
class MotorTorque(MotorLimit):
    """Largest torque on the motor shaft at any instant, breakaway included, N·m."""

    name = "motor torque"
    field = "max_torque"
    order = 2
    unit = "N·m"
    sufficient_bound = JointLimit._with_reserve
    trials = SymmetricLimit.doubled


@frozen
class ContinuousTorque(MotorLimit):
    """Largest root mean square of the motor torque over a motion, N·m."""

    name = "continuous torque"
    field = "nominal_torque"
    order = 2
    unit = "N·m"
    words = "continuous torque of joint {limit.of} of"
    tightened = Limit.tightened


@frozen
class NutContact(Limit):
    """Condition that both halves of a preloaded nut bear on the screw with a positive force, N."""

    name = "nut contact"
    order = 2
    of: str
    preload: NotNegative
    """Spring force between the half nuts. A relaxation raises it by the missing contact force."""
    unit = "N"
    low = 0.0
    words = "preload of joint {limit.of} of"

    def bound(self, value: float) -> float:
        return self.preload

    def sufficient_bound(self, needed: float) -> float:
        return self.preload - needed

    def relaxed(self, value: float) -> "NutContact":
        return replace(self, preload=max(self.preload, value))

    def on(self, problem: P) -> P:
        """Return a copy of a problem in which the nut of the joint has this preload."""
        drive = _joint_named(problem, self.of).drive
        if drive is None:
            raise ProblemError(f"joint {self.of} has no drive with a preload")
        return _change_joint(problem, self.of, drive=replace(drive, preload=self.preload))


@frozen
class SelfLocking(Limit):
    """Limit on the friction coefficient of a drive that must hold without motor torque.

    The lowest plausible coefficient must suffice for this.
    """

    name = "self-locking"
    of: str
    friction: Positive
    """Lowest plausible coefficient.

    The geometry determines the coefficient that it must exceed (dynamics/transmission.py).
    """
    unit = "μ"

    def bound(self, value: float) -> float:
        return self.friction

    def relaxed(self, value: float) -> "SelfLocking":
        return replace(self, friction=max(self.friction, value))

    def described(self, value: float) -> str:
        return (
            f"lowest friction coefficient μ of joint {self.of} of {value:.6g} "
            f"instead of {self.friction:.6g}"
        )

    def on(self, problem: P) -> P:
        """Return a copy of a problem in which the friction of the drive has this lowest value."""
        drive = _joint_named(problem, self.of).drive
        if drive is None or drive.friction is None:
            raise ProblemError(f"joint {self.of} has no drive with friction")
        friction = drive.friction
        lowest_mu = self.friction
        raised_friction = replace(
            friction,
            mu=max(friction.mu, lowest_mu),
            mu_static=max(friction.mu_static, lowest_mu),
            mu_lowest=lowest_mu,
        )
        return _change_joint(problem, self.of, drive=replace(drive, friction=raised_friction))


class CoordinateLimit(Limit):
    """Base class of limits on one task coordinate, which is one of `TASK_COORDINATES`."""

    coordinate: str
    derivative: ClassVar[int]
    """Order of the time derivative of the coordinate that is limited."""

    def _check(self) -> None:
        super()._check()
        check_name(
            self.coordinate,
            TASK_COORDINATES,
            f"{type(self).__name__}.coordinate",
            "unknown task coordinate",
        )

    @staticmethod
    @abstractmethod
    def name_of(coordinate: str) -> str:
        """Return the name of the limit on a task coordinate."""

    @property
    def name(self) -> str:
        """Name such as "tilt range" or "tilt rate"."""
        return self.name_of(self.coordinate)

    @property
    def unit(self) -> str:
        """SI unit of the limited quantity, which is a length or its derivative for depth."""
        return derived_unit(self.coordinate == "depth", self.derivative)

    def on(self, problem: P) -> P:
        return _set_limit(problem, self)


@frozen
class TaskRange(CoordinateLimit, RangeLimit):
    """Range of one task coordinate, rad or m.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.TaskRange("depth", 0.0, 30 * ssm.mm).name
    'depth range'
    """

    coordinate: str
    """One of `TASK_COORDINATES`."""
    lower: float
    upper: float

    derivative = 0

    @staticmethod
    def name_of(coordinate: str) -> str:
        """Return the name of the limit on the range of a task coordinate, such as "tilt range"."""
        return f"{coordinate} range"

    @property
    def coupled(self) -> bool:
        """True if a motion between two points in the range can leave the range.

        This applies to roll and spin, which depend on several joints. Tilt and depth depend on one
        joint each.
        """
        return self.coordinate in ("roll", "spin")

    def tightened(self, worst: float, bound: float) -> "TaskRange | None":
        """Return a narrower range.

        The result is None if a motion between two points in the range cannot leave the range, or if
        the narrower range would be empty.
        """
        shift = TIGHTENING_FACTOR * abs(worst - bound)
        if not self.coupled or not 2 * shift < self.upper - self.lower:
            return None
        if worst > bound:
            return replace(self, upper=self.upper - shift)
        return replace(self, lower=self.lower + shift)

    def trials(self) -> tuple[float, ...]:
        width = self.upper - self.lower
        return self.lower - width, self.upper + width

    def described(self, value: float) -> str:
        side = "from" if value < self.low else "to"
        return (
            f"range of {self.coordinate} {side} {format_quantity(value, self.unit)} "
            f"instead of {format_quantity(self.bound(value), self.unit)}"
        )

    def on(self, problem: P) -> P:
        """Return a copy of a problem with this range.

        The range of the robot itself is widened if it does not contain this range.
        """
        current: Any = problem
        limits = (
            replace(
                robot_range,
                lower=min(robot_range.lower, self.lower),
                upper=max(robot_range.upper, self.upper),
            )
            if robot_range.key == self.key
            else robot_range
            for robot_range in current.robot.limits
        )
        return super().on(
            replace_fields(problem, robot=replace(current.robot, limits=tuple(limits)))
        )


@frozen
class ToolLimit(SymmetricLimit):
    """Limit |value| ≤ largest on a quantity of the tool.

    A subclass defines `name` and `field`, and `unit` if it is not m.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.StopTravel in ssm.ToolLimit.kinds(), ssm.StopTravel.field
    (True, 'stop_travel')
    """

    name: ClassVar[str]
    field: ClassVar[str]
    """Key in a problem file and in plan.json."""
    largest: Positive
    unit = "m"
    trials = SymmetricLimit.doubled

    @classmethod
    def kinds(cls) -> "tuple[type[ToolLimit], ...]":
        """Return the classes of limits on the tool that a problem can have."""
        return (*SpeedLimit.__subclasses__(), StopTravel)

    def on(self, problem: P) -> P:
        return _set_limit(problem, self)


class SpeedLimit(ToolLimit):
    """Limit |v| ≤ largest on a velocity v of the tool that is linear in the joint velocities.

    The module `kinematics/forward.py` contains the Jacobian of each subclass. A subclass defines
    `name` and `field`, and `unit` if it is not m/s.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> issubclass(ssm.TipSpeed, ssm.SpeedLimit)
    True
    """

    order = 1
    unit = "m/s"


@frozen
class TaskRate(CoordinateLimit, SymmetricLimit):
    """Largest |rate| of one task coordinate, rad/s or m/s.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> limit = ssm.TaskRate("depth", 20 * ssm.mm)
    >>> limit.name, limit.unit
    ('insertion speed', 'm/s')
    """

    order = derivative = 1
    coordinate: str
    """One of `TASK_COORDINATES`."""
    largest: Positive

    @staticmethod
    def name_of(coordinate: str) -> str:
        """Return the name of the limit on the rate of a task coordinate, such as "tilt rate"."""
        return "insertion speed" if coordinate == "depth" else f"{coordinate} rate"

    @staticmethod
    def field_of(coordinate: str) -> str:
        """Return the key of the limit on the rate of a task coordinate in a problem file."""
        return TaskRate.name_of(coordinate).replace(" ", "_")


class TipSpeed(SpeedLimit):
    """Largest speed of the tool tip in space, m/s.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> limit = ssm.TipSpeed(25 * ssm.mm)
    >>> limit.contains(0.02), limit.contains(0.03)
    (True, False)
    """

    name = "tip speed"
    field = "tip_speed"


class StopTravel(ToolLimit):
    """Largest distance of the tip from its position at the beginning of a stop, m.

    The stop is the quickest controlled stop along the path, and may begin at any instant.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> limit = ssm.StopTravel(0.5 * ssm.mm)
    >>> limit.contains(0.4 * ssm.mm)
    True
    """

    name = "stop travel"
    field = "stop_travel"
    order = 2

    def tightened(self, worst: float, bound: float) -> "StopTravel":
        """Return a limit that is smaller by the relative excess and `STOP_RESERVE`.

        The true travel is proportional to the planner's estimate of it, so the limit need not be
        tightened by a multiple of the excess.
        """
        return replace(self, largest=self.largest * min(bound / worst, 1.0) * (1 - STOP_RESERVE))

    def sufficient_bound(self, needed: float) -> float:
        return (1 + 2 * STOP_RESERVE) * needed


@frozen
class RetinaClearance(Limit):
    """Smallest distance of the tip from the retina, m."""

    name = "retina clearance"
    clearance: float
    radius: float
    """Radius of the retina, m."""
    unit = "m"
    words = "clearance from the retina of"

    @property
    def low(self) -> float:
        return self.clearance

    @property
    def half_width(self) -> float:
        return self.radius - self.clearance

    def tightened(self, worst: float, bound: float) -> "RetinaClearance | None":
        clearance = self.clearance + TIGHTENING_FACTOR * max(bound - worst, 0.0)
        return replace(self, clearance=clearance) if clearance < self.radius else None

    def relaxed(self, value: float) -> "RetinaClearance | None":
        # No clearance allows a tip beyond the retina.
        return None if value < 0 else replace(self, clearance=min(self.clearance, value))

    def on(self, problem: P) -> P:
        return _change_eye(problem, clearance=self.clearance)


@frozen
class LensClearance(Limit):
    """Smallest permitted ratio by which the lens must grow to touch the axis of the shaft.

    The lens is enlarged about its centre. The bound is 1 + shaft radius / smallest semi-axis of the
    lens.
    """

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

    def tightened(self, worst: float, bound: float) -> "LensClearance":
        return replace(
            self,
            shaft_radius=self.shaft_radius
            + TIGHTENING_FACTOR * max(bound - worst, 0.0) * self.thickness,
        )

    def relaxed(self, value: float) -> "LensClearance | None":
        # an axis through the lens violates the limit for every shaft radius
        if value <= 1:
            return None
        return replace(self, shaft_radius=min(self.shaft_radius, self._radius(value)))

    def rounded(self, value: float) -> float:
        scale = display_unit("m")[1] * self.thickness
        return 1 + round_away(scale * (value - 1), scale * (self.low - 1)) / scale

    def described(self, value: float) -> str:
        return (
            f"radius of the shaft of {format_quantity(self._radius(value), 'm')} "
            f"instead of {format_quantity(self.shaft_radius, 'm')}"
        )

    def on(self, problem: P) -> P:
        return _change_eye(problem, shaft_radius=self.shaft_radius)

    def _radius(self, ratio: float) -> float:
        """Return the shaft radius in m whose limit is the given ratio."""
        return (ratio - 1) * self.thickness


@frozen
class Duration(Limit):
    """Requested duration of one motion or of all motions together, s.

    The shortest possible duration must not exceed it.
    """

    name = "duration"
    largest: Positive
    motion: str | None = None
    """Name of the motion, or None for all motions together."""
    asked: float | None = None
    """Duration that the problem requests for that motion, or None for `largest`."""
    exact: bool = False
    """True if every motion has a duration of its own, so only their sum is possible."""
    unit = "s"
    words = "a duration of"

    @property
    def high(self) -> float:
        return self.largest

    def relaxed(self, value: float) -> "Duration":
        longer = value if self.exact else max(self.largest, value)
        return replace(self, largest=longer, asked=self.asked or self.largest)

    def sufficient_bound(self, needed: float) -> float:
        # Without a reserve of 0.2 %, only the fastest motion is feasible, and it is hard to find.
        return needed if self.exact else 1.002 * needed

    @property
    def key(self) -> tuple[str, str | None]:
        return self.name, self.motion

    def on(self, problem: P) -> P:
        """Return a copy of a problem in which the motion, or all motions, have this duration."""
        current: Any = problem
        requested = self.asked or self.largest
        is_limited = [
            entry.kind != "dwell" and (entry.name, entry.duration) == (self.motion, requested)
            for entry in current.motion
        ]
        if not any(is_limited):  # only the total duration of all motions is requested
            if self.motion is not None and current.duration is None:
                raise ProblemError(f"no motion {self.motion} of {requested:g} s", key="duration")
            return replace_fields(problem, duration=self.largest)
        motion = (
            replace(entry, duration=self.largest) if limited else entry
            for entry, limited in zip(current.motion, is_limited, strict=True)
        )
        return replace_fields(problem, motion=tuple(motion))


@frozen
class PathRequirement(Limit):
    """Base class of requirements on the path of the tip, which the planner fulfils by construction.

    Only the check evaluates them.
    """

    largest: Positive
    unit = "m"

    @property
    def high(self) -> float:
        return self.largest


class PathDeparture(PathRequirement):
    """Largest distance of the tip from its prescribed lines and arcs outside rounded corners, m."""

    name = "path departure"


class CornerRounding(PathRequirement):
    """Largest distance from a corner at which the tip is off its lines, m."""

    name = "corner rounding"


class RetinaDistance(PathRequirement):
    """Prescribed distance between the tip and the retina along a curve, m."""

    name = "retina distance"


class ConstantSpeed(PathRequirement):
    """Prescribed speed of the tip along a curve, except for the ramps at its ends, m/s."""

    name = "constant speed"
    unit = "m/s"


PATH_REQUIREMENTS = tuple(str(kind.name) for kind in PathRequirement.__subclasses__())
"""Names of the requirements on the path of the tip."""
END_VELOCITY_NAMES = ("start velocity", "end velocity")
"""Names of the limits on the difference from the declared velocity at the start and at the end."""
JUMP_NAMES = (
    *(f"{kind.name} jump" for kind in (JointPosition, JointVelocity, JointAcceleration)),
    *END_VELOCITY_NAMES,
)
"""Names of the limits on jumps, which include jumps from rest and to rest.

Tables omit these limits unless they are violated.
"""


class FixedLimit(JointLimit):
    """Limit with a fixed bound that only the check evaluates.

    No problem stores it, so it is never tightened or relaxed.
    """

    tightened = Limit.tightened
    relaxed = Limit.relaxed


@frozen
class Jump(FixedLimit):
    """Largest step of a joint's position, velocity or acceleration between two pieces."""

    derivative: int = 0
    """Order of the derivative: 0, 1 or 2."""

    on = Limit.on

    @property
    def name(self) -> str:
        return JUMP_NAMES[self.derivative]

    @property
    def unit(self) -> str:
        return derived_unit(self.prismatic, self.derivative)


@frozen
class EndVelocity(FixedLimit):
    """Largest difference between a joint's velocity at an end and the declared velocity."""

    order = 1
    at_end: bool = False

    @property
    def name(self) -> str:
        return END_VELOCITY_NAMES[self.at_end]


OFFSET_NAMES = ("velocity offset", "torque offset")
"""Names of the limits on the errors of feed-forward values."""


@frozen
class FeedForward(FixedLimit):
    """Largest difference between an offset of a drive and the values that its positions allow.

    The offset is the exported velocity offset or torque offset.
    """

    of_torque: bool = False

    @property
    def name(self) -> str:
        """Name of the offset, one of `OFFSET_NAMES`."""
        return OFFSET_NAMES[self.of_torque]

    @property
    def unit(self) -> str:
        """SI unit of the offset."""
        return "N·m" if self.of_torque else derived_unit(self.prismatic, 1)


L = TypeVar("L", bound=Limit)


class Limited:
    """Base class of values with a tuple of limits, which it sorts by kind."""

    limits: tuple[Limit, ...]

    @property
    def ranges(self) -> dict[str, Range]:
        """Ranges of task coordinates by name in `TASK_COORDINATES`, rad or m."""
        return {limit.coordinate: (limit.low, limit.high) for limit in self._of_type(TaskRange)}

    @property
    def rates(self) -> dict[str, float]:
        """Largest |rate| of task coordinates by name in `TASK_COORDINATES`, rad/s or m/s."""
        return {limit.coordinate: limit.largest for limit in self._of_type(TaskRate)}

    @property
    def of_tool(self) -> tuple[ToolLimit, ...]:
        """Limits on the tool: on its speeds and on the travel of stops."""
        return self._of_type(ToolLimit)

    @property
    def speeds(self) -> tuple[SpeedLimit, ...]:
        """Limits on speeds of the tool."""
        return self._of_type(SpeedLimit)

    @property
    def stop_travel(self) -> StopTravel | None:
        """Limit on the travel of the tip during a stop, or None without this limit."""
        return next(iter(self._of_type(StopTravel)), None)

    @property
    def tip_speed(self) -> float | None:
        """Largest permitted tip speed in m/s, or None without a limit."""
        return next((limit.largest for limit in self._of_type(TipSpeed)), None)

    def _of_type(self, limit_type: type[L]) -> tuple[L, ...]:
        """Return all limits of a given class."""
        return tuple(limit for limit in self.limits if isinstance(limit, limit_type))


def sorted_task_limits(limits: Iterable[Limit], location: str = "limits") -> tuple[Limit, ...]:
    """Check the limits of a task, and sort them in the order of plan.json.

    Parameters
    ----------
    limits : iterable of Limit
        Limits in any order.
    location : str
        Key of the limits for messages.

    Returns
    -------
    tuple of Limit
        First the ranges, then the rates, and then the limits on the tool.

    Raises
    ------
    ProblemError
        If a limit does not belong to the task or occurs twice.
    """
    unique = tuple(limits)
    for limit in unique:
        if not isinstance(limit, (TaskRange, TaskRate, ToolLimit)):
            raise ProblemError(
                "not a limit of the task",
                key=location,
                value=limit,
                allowed="TaskRange, TaskRate, TipSpeed, StopTravel",
            )
        if [item.key for item in unique].count(limit.key) > 1:
            raise ProblemError(
                "occurs twice", key=location, value=limit.name, allowed="each limit once"
            )
    kinds = (TaskRange, TaskRate, *ToolLimit.kinds())
    return tuple(sorted(unique, key=lambda limit: kinds.index(type(limit))))


def _joint_named(problem: Any, name: str) -> Any:
    """Return the joint of a problem with a given name. Raise ProblemError for an unknown name."""
    for joint in problem.robot.joints:
        if joint.name == name:
            return joint
    raise ProblemError(
        "unknown joint",
        key="joint",
        value=name,
        allowed=", ".join(joint.name for joint in problem.robot.joints),
    )


def _change_joint(problem: P, name: str, **changes: Any) -> P:
    """Return a copy of a problem in which some fields of one joint are changed.

    Parameters
    ----------
    problem : Problem
        Problem that is copied.
    name : str
        Name of the joint.
    **changes
        New values by field of Joint.

    Returns
    -------
    Problem
        The copy.
    """
    current: Any = problem
    changed = replace(_joint_named(problem, name), **changes)
    joints = tuple(changed if joint.name == name else joint for joint in current.robot.joints)
    return replace_fields(problem, robot=replace(current.robot, joints=joints))


def _set_limit(problem: P, limit: Limit) -> P:
    """Return a copy of a problem in which a limit is added or replaced.

    Parameters
    ----------
    problem : Problem
        Problem that is copied.
    limit : Limit
        Limit on the motion of the tool, such as a range of the tilt. It replaces a limit with the
        same key.

    Returns
    -------
    Problem
        The copy.
    """
    current: Any = problem
    if all(item.key != limit.key for item in current.limits):
        return replace_fields(problem, limits=(*current.limits, limit))
    return replace_fields(
        problem, limits=tuple(limit if item.key == limit.key else item for item in current.limits)
    )


def _change_eye(problem: P, **changes: Any) -> P:
    """Return a copy of a problem in which some fields of its eye are changed.

    Raises ProblemError if the problem has no eye.
    """
    current: Any = problem
    if current.eye is None:
        raise ProblemError("the problem has no eye")
    return replace_fields(problem, eye=replace(current.eye, **changes))
