"""Define problems, the eye, and the limits of a task, in SI units and radians.

A `Problem` is the input of the planner: a robot, a start, motions and limits. Its constructor
rejects values that contradict each other, before any planning. `TaskLimits` is the part of a
problem that a check of an arbitrary trajectory needs.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import field, replace
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from ssm_planner.arguments import check_methods
from ssm_planner.deprecation import Renamed
from ssm_planner.problem.limits import (
    TASK_COORDINATES,
    LensClearance,
    Limit,
    Limited,
    RetinaClearance,
    TaskRange,
    sorted_task_limits,
)
from ssm_planner.problem.motion import (
    TIP_CURVES,
    Dwell,
    Follow,
    Free,
    Motion,
    Point,
    Scan,
    Straight,
    Task,
    Tip,
)
from ssm_planner.problem.robot import Robot, check_rotation
from ssm_planner.problem.value import (
    Delay,
    Interval,
    Length,
    Matrix,
    Names,
    NotNegative,
    Position,
    Positive,
    Time,
    Value,
    field_hints,
    get_attributes,
    unchecked_copy,
    uncompared_field,
)
from ssm_planner.typing import Numbers, Range, record
from ssm_planner.units import display_unit

MAX_SPLINE_POINTS = 20
"""Largest number of points of a spline that optimal control can time."""
POSITION_TOLERANCE = 1e-9
"""Tolerance for points on a limit, rad or m."""


@record
class Lens(Value):
    """Ellipsoid that the shaft must not touch, in the base frame, m.

    Examples
    --------
    >>> import numpy as np
    >>> import ssm_planner as ssm
    >>> ssm.Lens([0.0, 0.0, -5 * ssm.mm], [4.5e-3, 4.5e-3, 2e-3], np.eye(3)).semi_axes.tolist()
    [0.0045, 0.0045, 0.002]
    """

    centre: Position
    """Centre in the base frame, m, (3,)."""
    semi_axes: Position
    """Semi-axes along the columns of `frame`, m, (3,)."""
    frame: Matrix
    """Rotation base ← lens, (3, 3)."""

    def _check(self) -> None:
        """Raise ProblemError if a semi-axis is not positive or the frame is not a rotation."""
        for i, length in enumerate(self.semi_axes.tolist()):
            if not length > 0:
                raise self._field_error(f"semi_axes[{i}]", "not positive", "above 0", length)
        check_rotation(self, "frame")


@record
class Eye(Value):
    """Eye around the remote centre: a spherical retina and an optional lens. Base frame, m.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.Eye(centre=[0.0, 0.0, -0.012], radius=0.012, clearance=1e-3).lens is None
    True
    """

    centre: Position
    """Centre in the base frame, m, (3,)."""
    radius: Length
    """Radius of the retina, m."""
    clearance: Annotated[NotNegative, "length"]
    """Smallest allowed distance of the tip from the retina, m."""
    port: Length = 3e-3
    """Radius of the incision around the remote centre, m. The retina has a hole of this radius."""
    shaft_radius: Annotated[NotNegative, "length"] = 0.0
    """Distance that the axis of the shaft keeps from the lens, m."""
    lens: Lens | None = None
    """Lens that the shaft must not touch, or None."""

    @cached_property
    def limits(self) -> tuple[Limit, ...]:
        """Limits on the tool that the eye requires."""
        retina = RetinaClearance(self.clearance, self.radius)
        if self.lens is None:
            return (retina,)
        return retina, LensClearance(self.shaft_radius, float(self.lens.semi_axes.min()))

    def _check(self) -> None:
        """Raise ProblemError if the clearance, the lens or the port do not fit the eye."""
        if not self.clearance < self.radius:
            raise self._field_error(
                "clearance",
                "the clearance leaves no room in the eye",
                f"less than the radius, {_format_mm(self.radius)}",
            )
        if self.lens is not None:
            self._check_lens(self.lens)
        self._check_port()

    def _check_lens(self, lens: Lens) -> None:
        """Raise ProblemError if the lens does not fit the eye.

        Parameters
        ----------
        lens : Lens
            The lens. Its semi-axes must be shorter than the radius of the eye, and its centre must
            be inside the eye.
        """
        for i, length in enumerate(lens.semi_axes.tolist()):
            if not length < self.radius:
                allowed = f"above 0 and below {_format_mm(self.radius)}"
                raise self._field_error(
                    f"lens.semi_axes[{i}]", "larger than the eye", allowed, length
                )
        if np.linalg.norm(lens.centre - self.centre) > self.radius:
            allowed = f"within {_format_mm(self.radius)} of the eye's centre"
            raise self._field_error("lens.centre", "outside the eye", allowed, lens.centre.tolist())

    def _check_port(self) -> None:
        """Raise ProblemError if a tool through the remote centre cannot work in this eye.

        The remote centre, about which the tool turns, must be in the port, that is, in the incision
        through the wall of the eye. The tip must be able to enter with the required clearance, and
        the lens must not block the shaft.
        """
        distance = float(np.linalg.norm(self.centre))
        if abs(distance - self.radius) > self.port:
            raise self._field_error(
                "centre",
                f"the remote centre is {_format_mm(distance)} from the centre of an eye of radius "
                f"{_format_mm(self.radius)}, so the port is not on its wall",
                f"{_format_mm(self.radius - self.port)} to {_format_mm(self.radius + self.port)} "
                "from the remote centre",
                self.centre.tolist(),
            )
        # The tip must be able to enter the eye through the port with the required clearance.
        radial_play = self.port - (distance - self.radius)
        if not self.clearance < radial_play:
            reason = "the tip cannot keep this distance from the wall when it leaves the port"
            raise self._field_error(
                "clearance", reason, f"less than {_format_mm(radial_play)}, or a larger port"
            )
        if self.lens is None:
            return
        # Factor by which the lens must grow about its centre to contain the remote centre.
        ratio = float(np.linalg.norm(self.lens.frame.T @ self.lens.centre / self.lens.semi_axes))
        smallest_ratio = 1 + self.shaft_radius / float(self.lens.semi_axes.min())
        if ratio <= smallest_ratio:
            raise self._field_error(
                "lens.centre",
                "the lens blocks the shaft where it enters the eye",
                f"a position where the lens, enlarged {smallest_ratio:.4g} times, does not contain "
                "the remote centre",
                self.lens.centre.tolist(),
            )


def _format_mm(length: float) -> str:
    """Format a length in m as text in mm."""
    return f"{1e3 * length:.5g} mm"


def _format_coordinate(name: str, value: float) -> str:
    """Format a task coordinate or joint position in rad or m as text with its unit."""
    unit, scale = display_unit("m" if name in ("depth", "insertion") else "rad")
    return f"{value * scale:.6g} {unit}"


def _format_range(name: str, ends: Range) -> str:
    """Format a range of a task coordinate or joint position in rad or m as text with units."""
    return f"{_format_coordinate(name, ends[0])} to {_format_coordinate(name, ends[1])}"


@check_methods
@record
class TaskLimits(Limited):
    """Limits on the pose and speed of the tool in addition to those of the joints.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> limits = ssm.TaskLimits((ssm.TipSpeed(25 * ssm.mm),))
    >>> ssm.check("results/tilt_insert/plan.json", limits=limits).verdict
    'kept'
    """

    limits: tuple[Limit, ...] = ()
    eye: Eye | None = None
    start_rate: Numbers | None = field(default_factory=dict)
    """Rates of task coordinates at the start by name in `TASK_COORDINATES`, 0 for missing names.

    None allows any rate.
    """
    end_rate: Numbers | None = field(default_factory=dict)
    """Rates of task coordinates at the end, in the same form."""
    friction: float | None = None
    """Confidence level of the drives' friction at which motor torques must hold.

    None uses the nominal friction.
    """
    payload: Range | None = None
    """Range of the point mass at the tip for which motor torques must hold, kg.

    None means no payload.
    """
    duty: float | None = 0.0
    """Pause before the motion repeats, s. None means that the motion is done once."""
    motion: tuple[Motion, ...] = ()
    """Motions with lines, rounded corners and constant speeds that the check evaluates."""

    def within(self, robot: Robot) -> "TaskLimits":
        """Add the ranges of task coordinates that a robot declares to these limits.

        Parameters
        ----------
        robot : Robot
            Robot with ranges of task coordinates.

        Returns
        -------
        TaskLimits
            Limits with the ranges of the robot. If these limits also contain a range of a
            coordinate, the result has the intersection of both, or the range of the robot if the
            intersection is empty.
        """
        limits = list(self.limits)
        for robot_range in robot.limits:
            if not isinstance(robot_range, TaskRange):
                continue
            same = next((limit for limit in limits if limit.key == robot_range.key), robot_range)
            low = max(robot_range.low, same.low)
            high = min(robot_range.high, same.high)
            common = replace(robot_range, lower=low, upper=high) if low < high else robot_range
            limits = [*(limit for limit in limits if limit.key != robot_range.key), common]
        return replace(self, limits=tuple(limits))

    def slower(self, stretch: float) -> "TaskLimits":
        """Return the limits that apply to a slower execution of the same motion.

        Parameters
        ----------
        stretch : float
            Duration of the slower motion divided by the duration of the motion.

        Returns
        -------
        TaskLimits
            Limits in which the declared rates at both ends and the constant speeds are divided by
            `stretch`. All other limits are unchanged.
        """
        if stretch == 1:
            return self
        motion = (
            unchecked_copy(entry, constant_speed=entry.constant_speed / stretch)
            if isinstance(entry, Follow) and entry.constant_speed is not None
            else entry
            for entry in self.motion
        )
        start, end = (
            None if rate is None else {name: value / stretch for name, value in rate.items()}
            for rate in (self.start_rate, self.end_rate)
        )
        return replace(self, start_rate=start, end_rate=end, motion=tuple(motion))

    @property
    def declared_rates(self) -> dict[str, dict[str, float]]:
        """Rates of task coordinates at both ends, by the key of a problem or a manifest.

        The mapping of an end is empty if the motion rests there or may have any rates.
        """
        return {"start_rate": dict(self.start_rate or {}), "end_rate": dict(self.end_rate or {})}

    @property
    def promising(self) -> str:
        """Names of the motions whose tip must follow a prescribed curve, separated by commas."""
        lines = (
            entry
            for entry in self.motion
            if isinstance(entry, Straight) or getattr(entry, "curve", "") in TIP_CURVES
        )
        return ", ".join(dict.fromkeys(entry.name for entry in lines))

    @property
    def all_limits(self) -> tuple[Limit, ...]:
        """Limits of the task together with those of the eye."""
        return self.limits if self.eye is None else (*self.limits, *self.eye.limits)


Rates = Annotated[Numbers, Names(TASK_COORDINATES)]
"""Rates of task coordinates by name in `TASK_COORDINATES`."""
Objective = Literal["time", "time then heat", "effort"]
Planner = Literal["optimal", "fast", "ipopt", "toppra"]


@record
class Problem(Value, Limited):
    """Robot, start, motions and limits of one planning task.

    Raises ProblemError if the fields contradict each other.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> problem = ssm.Problem(
    ...     ssm.load_robot("vitreoretinal"),
    ...     start=ssm.Task(tilt=-85 * ssm.deg),
    ...     motion=[ssm.Straight(tilt=-110 * ssm.deg), ssm.Dwell(0.2)],
    ...     limits=[ssm.TipSpeed(25 * ssm.mm)],
    ... )
    >>> problem.tip_speed
    0.025
    """

    robot: Robot
    """Geometry, bodies, joint limits, drives and motors."""
    start: Point
    """Start point. Missing task coordinates are 0."""
    motion: tuple[Motion, ...]
    """Motions in order."""
    limits: tuple[Limit, ...] = ()
    """Limits of the task: ranges, rates and speeds. The limits of the joints are in `robot`.

    Each range is narrowed to the robot's own range and the travel of joint 4.
    """
    objective: Objective = "time then heat"
    """Objective of the plan.

    "time" minimises the duration. "time then heat" selects the coolest of the fastest motions.
    "effort" minimises the effort in a requested duration.
    """
    eye: Eye | None = None
    """Retina and lens that the tool must not touch, or None."""
    start_rate: Rates = field(default_factory=dict)
    """Rates of task coordinates at the start by name in `TASK_COORDINATES`, 0 for missing names."""
    start_acceleration: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    """Joint accelerations at the start of a free motion with jerk limits, rad/s² and m/s²."""
    end_rate: Rates = field(default_factory=dict)
    """Rates of task coordinates at the end by name in `TASK_COORDINATES`, 0 for missing names."""
    duration: Time | None = None
    """Requested duration of all motions together, s."""
    duty: Delay | None = 0.0
    """Pause before the motion repeats, s. The motors cool during it.

    None means that the motion is done once, and the limits on continuous torque do not apply.
    """
    planner: Planner = "optimal"
    """Solvers to use.

    "optimal" uses the structured solver and confirms its optimum with Ipopt. If it finds no
    solution, Ipopt solves the problem alone. "fast" uses the structured solver, and Ipopt only if
    that does not converge. "ipopt" uses Ipopt alone. "toppra" times straight motions with TOPP-RA
    alone, which is several times faster and does not support jerk limits.
    """
    friction: Positive | None = None
    """Confidence level of the drives' friction at which motor torques must hold, such as 0.95.

    None uses the nominal friction.
    """
    payload: Interval | None = None
    """Range of the point mass at the tip for which motor torques must hold, kg.

    None means no payload.
    """
    name: str = "problem"
    excess_ranges: Annotated[Mapping[str, Interval], Names(TASK_COORDINATES)] = field(
        default_factory=dict, compare=False
    )
    """Requested ranges that exceed those of the robot, by name in `TASK_COORDINATES`.

    The constructor computes them.
    """
    file: str | None = uncompared_field()
    from_dict: "ClassVar[Callable[[Mapping[str, Any]], Problem]]"
    """Return the problem that a mapping with the keys of a problem file describes.

    Raises ProblemError, which names the key.
    """
    from_yaml: "ClassVar[Callable[[str], Problem]]"
    """Return the problem that the text of a problem file describes.

    Raises ProblemError, which names the line and the key. The module `loading/load` defines both
    functions because they read files.
    """

    @cached_property
    def task_limits(self) -> TaskLimits:
        """Limits on the pose and speed of the tool."""
        return TaskLimits(**get_attributes(self, field_hints(TaskLimits)))

    @cached_property
    def all_limits(self) -> tuple[Limit, ...]:
        """All limits on a motion: of joints, motors, drives, the task and the eye."""
        of_joints = (limit for joint in self.robot.joints for limit in joint.limits)
        return (*of_joints, *self.task_limits.all_limits)

    def limit(self, name: str, joint: str | None) -> Limit | None:
        """Return the limit with a given name on a joint or, if `joint` is None, on the tool.

        The result is None if the problem does not have this limit.
        """
        return next((item for item in self.all_limits if item.key == (name, joint)), None)

    def _check(self) -> None:
        """Narrow the ranges to those of the robot, complete the start, and check all fields.

        Raises ProblemError if fields contradict each other.
        """
        limits = sorted_task_limits(self.limits, "Problem.limits")
        other_limits = (limit for limit in limits if not isinstance(limit, TaskRange))
        object.__setattr__(self, "limits", (*self._narrow_ranges(), *other_limits))
        if isinstance(self.start, Task):
            start = Task(
                **{**dict.fromkeys(TASK_COORDINATES, 0.0), **self.start.set_coordinates},
                line=self.start.line,
            )
            object.__setattr__(self, "start", start)
        if not self.motion:
            raise self._field_error("motion", "no entries", "at least one motion", "()")
        for i, entry in enumerate(self.motion):
            if isinstance(entry, Scan) or (
                isinstance(entry, Follow) and entry.distance is not None
            ):
                self._check_retina_motion(entry, f"motion[{i}]")
        for key, point in self._points():
            self._check_point(key, point)
        self._check_blends()
        self._check_durations()
        self._check_robustness()
        self._check_stops()
        self._check_for_toppra()

    def _narrow_ranges(self) -> list[TaskRange]:
        """Intersect the ranges of the problem with those of the robot and with joint 4's travel.

        The ranges of the problem that exceed these intersections are stored in `excess_ranges`, so
        that reports can mention them.

        Returns
        -------
        list of TaskRange
            The intersections, one for each task coordinate with a range.

        Raises
        ------
        ProblemError
            If an intersection is empty.
        """
        ranges = self.robot.ranges
        for name, requested in (("depth", self.robot.travel), *self.ranges.items()):
            low, high = ranges.get(name, (-math.inf, math.inf))
            lower, upper = max(low, requested[0]), min(high, requested[1])
            if not lower < upper:
                reason = "no overlap with the range that the robot allows"
                allowed = _format_range(name, (low, high))
                raise self._field_error(
                    f"limits.{name}", reason, allowed, _format_range(name, self.ranges[name])
                )
            ranges[name] = lower, upper
            if name in self.ranges and (
                requested[0] < lower - POSITION_TOLERANCE
                or requested[1] > upper + POSITION_TOLERANCE
            ):
                object.__setattr__(
                    self, "excess_ranges", {**self.excess_ranges, name: self.ranges[name]}
                )
        return [TaskRange(name, *ends) for name, ends in ranges.items()]

    def _points(self) -> Iterator[tuple[str, Point]]:
        """Yield every point of the start and of the motions.

        Yields
        ------
        key : str
            Key of the point for messages, such as "motion[0].to".
        point : Task, Joints or Tip
            The point.
        """
        yield "start", self.start
        for i, entry in enumerate(self.motion):
            if isinstance(entry, Straight):
                yield f"motion[{i}]", entry.to
            elif isinstance(entry, Scan):
                yield f"motion[{i}].at", entry.at
            elif isinstance(entry, (Free, Follow)):
                yield f"motion[{i}].to", entry.to
                yield from (
                    (f"motion[{i}].through[{k}]", point) for k, point in enumerate(entry.through)
                )

    def _check_point(self, key: str, point: Point) -> None:
        """Raise ProblemError if a coordinate that a point states is outside its limits.

        The module `planning/feasibility` checks the coordinates that follow from the stated ones.

        Parameters
        ----------
        key : str
            Key of the point for messages, such as "motion[0].to".
        point : Task, Joints or Tip
            The point.
        """
        if isinstance(point, Task):
            for name, value in point.set_coordinates.items():
                self._check_in_range(f"{key}.{name}", name, value)
        elif isinstance(point, Tip):
            distance, (low, high) = math.hypot(*point.position), self.ranges["depth"]
            if distance > max(abs(low), abs(high)) + POSITION_TOLERANCE:
                reason = (
                    f"{distance * 1e3:.4g} mm from the remote centre, outside the limits of depth"
                )
                raise self._field_error(
                    f"{key}.position",
                    reason,
                    _format_range("depth", (low, high)),
                    list(point.position),
                )
            self._check_in_range(f"{key}.spin", "spin", point.spin)
        else:
            for i, (value, joint) in enumerate(zip(point.values, self.robot.joints, strict=True)):
                reason = f"outside the position limits of joint {i + 1} ({joint.name})"
                self._check_in_range(
                    f"{key}.values[{i}]", joint.name, value, joint.position, reason
                )
            depth = self.robot.geometry.insertion_sign * point.values[3]
            reason = f"gives a depth of {depth * 1e3:g} mm, outside the limits"
            self._check_in_range(f"{key}.values[3]", "depth", depth, None, reason)

    def _check_in_range(
        self,
        key: str,
        name: str,
        value: float,
        ends: Range | None = None,
        reason: str | None = None,
    ) -> None:
        """Raise ProblemError if the value of a coordinate is outside its range.

        Parameters
        ----------
        key : str
            Key of the value for messages, such as "motion[0].to.tilt".
        name : str
            Name of the task coordinate or joint.
        value : float
            Value, m for the depth and the insertion, and otherwise rad.
        ends : (float, float), optional
            Range in the same unit. The default is the range of the task coordinate `name`.
        reason : str, optional
            Beginning of the message. The default says that the value is outside the limits of
            `name`.
        """
        low, high = ends or self.ranges.get(name, (-math.inf, math.inf))
        if not low - POSITION_TOLERANCE <= value <= high + POSITION_TOLERANCE:
            raise self._field_error(
                key,
                reason or f"outside the limits of {name}",
                _format_range(name, (low, high)),
                _format_coordinate(name, value),
            )

    def _check_retina_motion(self, scan: Scan | Follow, key: str) -> None:
        """Raise ProblemError if a motion along the retina does not fit the eye.

        Parameters
        ----------
        scan : Scan or Follow
            Motion with a prescribed distance from the retina.
        key : str
            Key of the motion for messages.
        """
        eye = self.eye
        if eye is None:
            reason = "a motion along the retina needs an eye"
            raise self._field_error(key, reason, "a problem with an eye", scan.name)
        if scan.distance is not None and scan.distance < eye.clearance:
            allowed = f"at least the eye's clearance, {eye.clearance * 1e3:g} mm"
            raise self._field_error(
                f"{key}.distance",
                "smaller than the clearance from the retina",
                allowed,
                scan.distance,
            )
        if scan.distance is not None and scan.distance >= eye.radius:
            reason = "farther from the retina than the centre of the eye"
            raise self._field_error(
                f"{key}.distance", reason, f"below {_format_mm(eye.radius)}", scan.distance
            )
        for diameter in scan.diameters if isinstance(scan, Scan) else ():
            if diameter >= eye.radius:
                reason = "larger than the eye's radius"
                raise self._field_error(
                    f"{key}.diameters", reason, f"below {_format_mm(eye.radius)}", diameter
                )

    def _check_blends(self) -> None:
        """Raise ProblemError if a corner cannot be rounded.

        A rounded corner joins two straight motions, lines or arcs that have no durations.
        """
        for i, entry in enumerate(self.motion):
            if not isinstance(entry, (Straight, Follow)) or entry.blend is None:
                continue
            following = self.motion[i + 1] if i + 1 < len(self.motion) else None
            allowed = "straight motions, lines and arcs one after the other; or no blend"
            if following is None:
                raise self._field_error(
                    f"motion[{i}].blend",
                    "the last motion cannot have a blend because the robot stops",
                    allowed,
                )
            if not isinstance(following, Straight) and not (
                isinstance(following, Follow) and following.blends
            ):
                reason = (
                    f"the robot stops before the next motion, a {following.kind} ({following.name})"
                )
                raise self._field_error(
                    f"motion[{i}].blend", reason, allowed, _format_mm(entry.blend)
                )
            for k, neighbour in ((i, entry), (i + 1, following)):
                if neighbour.duration is not None:
                    reason = "a motion with a rounded corner cannot have a duration"
                    allowed = "a duration of the whole problem, or no blend"
                    raise self._field_error(
                        f"motion[{k}].duration", reason, allowed, neighbour.duration
                    )

    def _check_durations(self) -> None:
        """Raise ProblemError if the objective needs a duration that is missing."""
        timed = [entry.duration is not None for entry in self.motion]
        if self.objective == "effort" and self.duration is None and not all(timed):
            raise self._field_error(
                "objective",
                "the objective effort needs a duration",
                "a duration of the whole problem, or one for every motion",
            )

    def _check_robustness(self) -> None:
        """Raise ProblemError if the payload or the confidence level of friction is invalid.

        A confidence level requires uncertainty data for the drive of every motor.
        """
        if self.payload is not None and self.payload[0] < 0:
            raise self._field_error(
                "payload", "a mass cannot be negative", "[least, largest], from 0 kg"
            )
        if self.friction is None:
            return
        if not 0.5 <= self.friction <= 0.999:
            raise self._field_error("friction", "not a valid confidence level", "50 % to 99.9 %")
        for joint in self.robot.joints:
            drive = joint.drive
            if (
                drive is None
                or joint.motor is None
                or drive.friction is None
                or drive.friction_ranges
            ):
                continue
            if drive.friction.posterior is None and not drive.friction.covariance:
                reason = f"the friction of {drive.name} (joint {joint.name}) has no uncertainty"
                allowed = (
                    "drives with posterior, covariance or friction_ranges, or no range of friction"
                )
                raise self._field_error("friction", reason, allowed)

    def _check_stops(self) -> None:
        """Raise ProblemError if the travel of stops is limited, but stops are not always possible.

        The motion must end at rest. Jerk limits are excluded, because a stop begins with a jump of
        the acceleration.
        """
        if self.stop_travel is None:
            return
        if any(self.end_rate.values()):
            reason = "a motion that does not end at rest leaves no path for a stop"
            raise self._field_error(
                "end_rate",
                reason,
                "a motion that ends at rest, or no stop_travel",
                dict(self.end_rate),
            )
        if joints := self.robot.jerk_limited:
            reason = (
                f"the jerk of joint {joints[0]} is limited, so the acceleration cannot jump to stop"
            )
            raise self._field_error(
                "limits", reason, "a robot without jerk limits, or no stop_travel", "stop_travel"
            )

    def check_total(self) -> None:
        """Raise ProblemError if the total duration contradicts the durations of the motions.

        The planner calls this method as well, after it has replaced scans by motions.
        """
        if self.duration is None:
            return
        timed = [entry.duration is not None for entry in self.motion]
        fixed_duration = sum(entry.duration or 0.0 for entry in self.motion)
        if all(timed):
            raise self._field_error(
                "duration",
                "every motion already has a duration",
                "no duration of the whole problem",
            )
        if fixed_duration >= self.duration:
            raise self._field_error(
                "duration",
                f"dwells and timed motions alone take {fixed_duration:g} s",
                "more than that",
            )

    def _check_for_toppra(self) -> None:
        """Raise ProblemError if only TOPP-RA can plan a motion, but does not support a request.

        TOPP-RA computes the fastest timing along a given path. It does not support jerk limits,
        requested durations or the objective "effort". It plans all motions of the planner
        `toppra`. With every planner, it plans motions at constant speed, tables of points, and
        splines through many points.
        """
        requests = [f"a jerk limit of joint {name}" for name in self.robot.jerk_limited]
        if self.duration is not None or self.objective == "effort":
            requests.append("a duration or effort as the objective")
        if self.planner == "toppra":
            moving = [entry for entry in self.motion if not isinstance(entry, Dwell)]
            free = [entry for entry in moving if not isinstance(entry, (Straight, Follow))]
            requests += [f"a {entry.kind} motion ({entry.name})" for entry in free]
            requests += [
                f"a duration of {entry.name}" for entry in moving if entry.duration is not None
            ]
            if requests:
                allowed = "straight motions and paths as fast as possible"
                raise self._field_error(
                    "planner", f"TOPP-RA does not support {requests[0]}", allowed
                )
        for i, entry in enumerate(self.motion):
            unsupported = requests + (["a duration"] if entry.duration is not None else [])
            if not unsupported or not isinstance(entry, Follow):
                continue
            reason = f"only TOPP-RA can time it, and does not support {unsupported[0]}"
            if entry.constant_speed is not None:
                allowed = "no constant_speed; or motions as fast as possible, without jerk limits"
                raise self._field_error(f"motion[{i}].constant_speed", reason, allowed)
            points = len(entry.through) + 1
            if entry.curve == "samples" or (entry.curve == "spline" and points > MAX_SPLINE_POINTS):
                allowed = (
                    f"a spline through {MAX_SPLINE_POINTS} points at most; "
                    f"or as fast as possible, without jerk limits"
                )
                raise self._field_error(f"motion[{i}]", reason, allowed, f"{points} points")

    def by_optimal_control(self, motion: Motion) -> bool:
        """Return True if a motion is a spline that only optimal control can time.

        TOPP-RA, the faster method for a given path, supports neither jerk limits nor requested
        durations, and it does not minimise effort.

        Parameters
        ----------
        motion : Motion
            Motion of this problem.
        """
        if not isinstance(motion, Follow) or motion.curve != "spline":
            return False
        has_duration = self.duration is not None or motion.duration is not None
        return has_duration or self.objective == "effort" or bool(self.robot.jerk_limited)

    wider = Renamed("excess_ranges")
