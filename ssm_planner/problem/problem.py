"""Problems as frozen values: points, motions, the eye, limits. SI floats and radians, arrays read-only."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from ssm_planner.problem.limits import (
    TASK,
    LensClearance,
    Limit,
    Limited,
    RetinaClearance,
    TaskRange,
    task_limits,
)
from ssm_planner.problem.motion import (
    OF_TIP,
    Dwell,
    Follow,
    Free,
    Joints,
    Motion,
    Point,
    Scan,
    Straight,
    Task,
    Tip,
)
from ssm_planner.problem.robot import Robot, check_rotation
from ssm_planner.problem.value import (
    Interval,
    Matrix,
    Names,
    NotNegative,
    Positive,
    Quantity,
    Value,
    Vector,
    unchecked,
)
from ssm_planner.typing import Range
from ssm_planner.units import shown

MOST_OF_SPLINE = 20
"""Points of a spline that optimal control times."""
SLACK = 1e-9
"""rad or m, so that a point may sit on a limit."""


@dataclass(frozen=True, eq=False)
class Lens(Value):
    """An ellipsoid that the shaft keeps clear of, base frame, m."""

    centre: Annotated[Vector, Quantity("length")]
    """Base frame, m, (3,)."""
    semi_axes: Annotated[Vector, Quantity("length")]
    """m, (3,), along the columns of `frame`."""
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

    centre: Annotated[Vector, Quantity("length")]
    """Base frame, m, (3,)."""
    radius: Annotated[Positive, Quantity("length")]
    """Of the retina, m."""
    clearance: Annotated[NotNegative, Quantity("length")]
    """Least distance of the tip from the retina."""
    port: Annotated[Positive, Quantity("length")] = 3e-3
    """Within this distance of the remote centre there is no retina: the incision itself."""
    shaft_radius: Annotated[NotNegative, Quantity("length")] = 0.0
    """Added around the shaft where it passes the lens."""
    lens: Lens | None = None
    """What the shaft keeps clear of."""

    @cached_property
    def limits(self) -> tuple[Limit, ...]:
        """What it limits."""
        retina = RetinaClearance(self.clearance, self.radius)
        if self.lens is None:
            return (retina,)
        return retina, LensClearance(self.shaft_radius, float(self.lens.semi_axes.min()))

    def _check(self) -> None:
        if not self.clearance < self.radius:
            raise self._wrong(
                "clearance",
                "nothing is left of the eye",
                f"less than the radius, {_mm(self.radius)}",
            )
        if self.lens is not None:
            self._check_lens(self.lens)
        self._check_port()

    def _check_lens(self, lens: Lens) -> None:
        for i, length in enumerate(lens.semi_axes.tolist()):
            if not length < self.radius:
                allowed = f"above 0 and below {_mm(self.radius)}"
                raise self._wrong(f"lens.semi_axes[{i}]", "not the half of a lens", allowed, length)
        if np.linalg.norm(lens.centre - self.centre) > self.radius:
            allowed = f"within {_mm(self.radius)} of the eye's centre"
            raise self._wrong("lens.centre", "outside the eye", allowed, lens.centre.tolist())

    def _check_port(self) -> None:
        """A tool through the remote centre can work in this eye."""
        distance = float(np.linalg.norm(self.centre))
        if abs(distance - self.radius) > self.port:
            raise self._wrong(
                "centre",
                f"the remote centre is {_mm(distance)} from the centre of an eye of radius {_mm(self.radius)}, "
                f"so the port is not at its wall",
                f"{_mm(self.radius - self.port)} to {_mm(self.radius + self.port)} from the remote centre",
                self.centre.tolist(),
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


def _text(name: str, value: float) -> str:
    """A task coordinate or joint value as people read it."""
    unit, scale = shown("m" if name in ("depth", "insertion") else "rad")
    return f"{value * scale:.6g} {unit}"


def _range(name: str, ends: Range) -> str:
    return f"{_text(name, ends[0])} to {_text(name, ends[1])}"


@dataclass(frozen=True, eq=False)
class TaskLimits(Limited):
    """Limits on where the tool is and how fast it goes, beside those of the joints."""

    limits: tuple[Limit, ...] = ()
    eye: Eye | None = None
    start_rate: Mapping[str, float] | None = field(default_factory=dict)
    """Rates of task coordinates at the start, by name in TASK, 0 where not named; None: whatever the motion has."""
    end_rate: Mapping[str, float] | None = field(default_factory=dict)
    friction: float | None = None
    """Share of what is known of the drives' friction within which motor torques hold; None: friction as stated."""
    payload: Range | None = None
    """Point masses at the tip, kg, with all of which they hold; None: none."""
    duty: float | None = 0.0
    """Pause before the motion repeats, s; None: it is done once."""
    motion: tuple[Straight | Free | Follow | Dwell | Scan, ...] = ()
    """What the motion is made of, whose lines, rounded corners and constant speeds the check holds it against."""

    def within(self, robot: Robot) -> TaskLimits:
        """With the ranges of a robot: of two for a coordinate what both allow, or the robot's where that is nothing."""
        limits = list(self.limits)
        for own in robot.limits:
            if not isinstance(own, TaskRange):
                continue
            same = next((limit for limit in limits if limit.key == own.key), own)
            low, high = max(own.low, same.low), min(own.high, same.high)
            both = replace(own, lower=low, upper=high) if low < high else own
            limits = [*(limit for limit in limits if limit.key != own.key), both]
        return replace(self, limits=tuple(limits))

    def slower(self, stretch: float) -> TaskLimits:
        """Those of the motion run slower by a factor: its rates at both ends and its constant speeds are lower by as much."""
        if stretch == 1:
            return self
        motion = (
            unchecked(entry, constant_speed=entry.constant_speed / stretch)
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
    def promising(self) -> str:
        """Names of the motions along given lines."""
        lines = (
            each
            for each in self.motion
            if isinstance(each, Straight) or getattr(each, "curve", "") in OF_TIP
        )
        return ", ".join(dict.fromkeys(each.name for each in lines))

    @property
    def all_limits(self) -> tuple[Limit, ...]:
        """Those of the eye too."""
        return self.limits if self.eye is None else (*self.limits, *self.eye.limits)


Objective = Literal["time", "time then heat", "effort"]
Planner = Literal["optimal", "fast", "ipopt", "toppra"]


@dataclass(frozen=True, eq=False)
class Problem(Value, Limited):
    """A robot, where it starts, what it does, and within which limits. Raises ProblemError for what cannot be."""

    robot: Robot
    """Geometry, bodies, joint limits, drives and motors."""
    start: Task | Joints | Tip
    """Task coordinates that it does not name are 0."""
    motion: tuple[Straight | Free | Follow | Dwell | Scan, ...]
    """One motion after the other."""
    limits: tuple[Limit, ...] = ()
    """Of the task: ranges, rates and speeds; those of the joints are in robot.

    The robot's own ranges and the travel of joint 4 hold too: each range is what all of them leave.
    """
    objective: Objective = "time then heat"
    """What is made least: "time"; "time then heat", the coolest of the fastest motions; or in a given duration "effort"."""
    eye: Eye | None = None
    """Retina and lens that the tool keeps clear of."""
    start_rate: Annotated[Mapping[str, float], Names(TASK)] = field(default_factory=dict)
    """Rates of task coordinates at the very start, by name in TASK; 0 where not named."""
    start_acceleration: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    """Accelerations of the joints at the very start of a free motion, where jerk is limited; rad/s², m/s²."""
    end_rate: Annotated[Mapping[str, float], Names(TASK)] = field(default_factory=dict)
    """Rates of task coordinates at the very end, likewise."""
    duration: Annotated[Positive, Quantity("time")] | None = None
    """Of everything together where it is asked for, s."""
    duty: Annotated[NotNegative, Quantity("time")] | None = 0.0
    """Pause before the motion repeats, in which motors cool, s. Done once (None), continuous torque is no limit."""
    planner: Planner = "optimal"
    """"optimal": by the structured solver, whose optimum Ipopt confirms; by Ipopt alone where there is none to confirm.
    "fast": the same optimal control problems by the structured solver, Ipopt where that does not converge. "ipopt": by
    Ipopt alone. "toppra": straight motions timed by TOPP-RA alone, several times faster; without jerk limits."""
    friction: Positive | None = None
    """Share of what is known of the drives' friction within which motor torques hold, as 0.95; None: friction as stated."""
    payload: Interval | None = None
    """Least and largest point mass at the tip, kg, with all of which motor torques hold; None: none."""
    name: str = "problem"
    wider: Annotated[Mapping[str, Interval], Names(TASK)] = field(
        default_factory=dict, compare=False
    )
    """Ranges asked for that reach beyond the robot's, by name in TASK; filled in where `limits` are narrowed."""
    file: str | None = field(default=None, compare=False)
    from_dict: ClassVar[Callable[[Mapping[str, Any]], Problem]]
    """The problem that a mapping with the keys of a problem file describes. Raises ProblemError naming the key."""
    from_yaml: ClassVar[Callable[[str], Problem]]
    """The problem that the text of a problem file describes. Raises ProblemError naming line and key.

    Both are readers of files, so `loading/load` gives them to this class.
    """

    @cached_property
    def task_limits(self) -> TaskLimits:
        """Limits on where the tool is and how fast it goes."""
        return TaskLimits(
            self.limits,
            self.eye,
            self.start_rate,
            self.end_rate,
            friction=self.friction,
            payload=self.payload,
            duty=self.duty,
            motion=self.motion,
        )

    @property
    def all_limits(self) -> tuple[Limit, ...]:
        """Every limit that holds for a motion: those of joints and motors, of the task and of the eye."""
        of_joints = (limit for joint in self.robot.joints for limit in joint.limits)
        return (*of_joints, *self.task_limits.all_limits)

    def _check(self) -> None:
        task_limits(self.limits, "Problem.limits")
        others = (limit for limit in self.limits if not isinstance(limit, TaskRange))
        object.__setattr__(self, "limits", (*self._narrowed(), *others))
        if isinstance(self.start, Task):
            whole = Task(**{**dict.fromkeys(TASK, 0.0), **self.start.given}, line=self.start.line)
            object.__setattr__(self, "start", whole)
        if not self.motion:
            raise self._wrong("motion", "no entries", "at least one motion", "()")
        for i, entry in enumerate(self.motion):
            if isinstance(entry, Scan) or (
                isinstance(entry, Follow) and entry.distance is not None
            ):
                self._check_over_retina(entry, f"motion[{i}]")
        for place, point in self._points():
            self._check_point(place, point)
        self._check_blends()
        self._check_durations()
        self._check_range()
        self._check_stops()
        self._check_for_toppra()

    def _narrowed(self) -> list[TaskRange]:
        """The ranges of the robot, of the travel of joint 4 and of the problem, each narrowed by the others."""
        left = self.robot.ranges
        for name, (lower, upper) in (("depth", self.robot.travel), *self.ranges.items()):
            low, high = left.get(name, (-math.inf, math.inf))
            asked, (lower, upper) = (lower, upper), (max(low, lower), min(high, upper))
            if not lower < upper:
                reason, allowed = (
                    "nothing is left of the range that the robot allows",
                    _range(name, (low, high)),
                )
                raise self._wrong(
                    f"limits.{name}", reason, allowed, _range(name, self.ranges[name])
                )
            left[name] = lower, upper
            if name in self.ranges and (asked[0] < lower - SLACK or asked[1] > upper + SLACK):
                object.__setattr__(self, "wider", {**self.wider, name: self.ranges[name]})
        return [TaskRange(name, *ends) for name, ends in left.items()]

    def _points(self) -> Iterator[tuple[str, Point]]:
        """The points that are given, with their places."""
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

    def _check_point(self, place: str, point: Point) -> None:
        """What is given of a point is within its limits; what follows from it the planner looks at (feasibility)."""
        if isinstance(point, Task):
            for name, value in point.given.items():
                self._check_within(f"{place}.{name}", name, value)
        elif isinstance(point, Tip):
            distance, (low, high) = math.hypot(*point.position), self.ranges["depth"]
            if distance > max(abs(low), abs(high)) + SLACK:
                reason = (
                    f"{distance * 1e3:.4g} mm from the remote centre, outside the limits of depth"
                )
                raise self._wrong(
                    f"{place}.position", reason, _range("depth", (low, high)), list(point.position)
                )
            self._check_within(f"{place}.spin", "spin", point.spin)
        else:
            for i, (value, joint) in enumerate(zip(point.values, self.robot.joints, strict=True)):
                reason = f"outside the position limits of joint {i + 1} ({joint.name})"
                self._check_within(
                    f"{place}.values[{i}]", joint.name, value, joint.position, reason
                )
            depth = self.robot.geometry.insertion_sign * point.values[3]
            reason = f"gives a depth of {depth * 1e3:g} mm, outside the limits"
            self._check_within(f"{place}.values[3]", "depth", depth, None, reason)

    def _check_within(
        self,
        place: str,
        name: str,
        value: float,
        ends: Range | None = None,
        reason: str | None = None,
    ) -> None:
        low, high = ends or self.ranges.get(name, (-math.inf, math.inf))
        if not low - SLACK <= value <= high + SLACK:
            raise self._wrong(
                place,
                reason or f"outside the limits of {name}",
                _range(name, (low, high)),
                _text(name, value),
            )

    def _check_over_retina(self, scan: Scan | Follow, place: str) -> None:
        eye = self.eye
        if eye is None:
            reason = "the tip is to go along a retina, and no eye is given"
            if isinstance(scan, Scan):
                reason = "a scan is of spots on a retina, and no eye is given"
            raise self._wrong(place, reason, "a problem with an eye", scan.name)
        if scan.distance is not None and scan.distance < eye.clearance:
            allowed = f"at least the eye's clearance, {eye.clearance * 1e3:g} mm"
            raise self._wrong(
                f"{place}.distance",
                "nearer to the retina than the clearance",
                allowed,
                scan.distance,
            )
        if scan.distance is not None and scan.distance >= eye.radius:
            reason = "farther from the retina than the middle of the eye"
            raise self._wrong(
                f"{place}.distance", reason, f"below {_mm(eye.radius)}", scan.distance
            )
        for diameter in scan.diameters if isinstance(scan, Scan) else ():
            if diameter >= eye.radius:
                reason = "larger than the eye's radius"
                raise self._wrong(
                    f"{place}.diameters", reason, f"below {_mm(eye.radius)}", diameter
                )

    def _check_blends(self) -> None:
        """Corners are rounded between motions along given lines and arcs alone, of which none has a duration of its own."""
        for i, entry in enumerate(self.motion):
            if not isinstance(entry, (Straight, Follow)) or entry.blend is None:
                continue
            behind = self.motion[i + 1] if i + 1 < len(self.motion) else None
            allowed = "straight motions, lines and arcs one after the other; or no blend"
            if behind is None:
                raise self._wrong(
                    f"motion[{i}].blend", "no motion follows, so the robot stops", allowed
                )
            if not isinstance(behind, Straight) and not (
                isinstance(behind, Follow) and behind.blends
            ):
                reason = f"the robot stops before the next motion, a {behind.kind} ({behind.name})"
                raise self._wrong(f"motion[{i}].blend", reason, allowed, _mm(entry.blend))
            for k, each in ((i, entry), (i + 1, behind)):
                if each.duration is not None:
                    reason = "a motion that goes on into another one has no duration of its own"
                    allowed = "a duration of the whole problem, or no blend"
                    raise self._wrong(f"motion[{k}].duration", reason, allowed, each.duration)

    def _check_durations(self) -> None:
        """The objective has the durations that it needs."""
        timed = [entry.duration is not None for entry in self.motion]
        if self.objective == "effort" and self.duration is None and not all(timed):
            raise self._wrong(
                "objective",
                "the least effort has no duration of its own",
                "a duration of the whole problem, or one for every motion",
            )

    def _check_range(self) -> None:
        """Of friction and payload: something is known of the friction of every motor's drive."""
        if self.payload is not None and self.payload[0] < 0:
            raise self._wrong("payload", "not a mass", "[least, largest], from 0 kg")
        if self.friction is None:
            return
        if not 0.5 <= self.friction <= 0.999:
            raise self._wrong("friction", "not a share of what is known", "50 % to 99.9 %")
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
                reason = f"nothing is known of how far the friction of {drive.name} (joint {joint.name}) may be off"
                allowed = (
                    "drives with posterior, covariance or friction_ranges, or no range of friction"
                )
                raise self._wrong("friction", reason, allowed)

    def _check_stops(self) -> None:
        """The way of a stop can be limited: there is one from every instant, along the path, without jerk limits."""
        if self.stop_travel is None:
            return
        if any(self.end_rate.values()):
            reason = "a motion that ends while it moves leaves no path to stop on"
            raise self._wrong(
                "end_rate",
                reason,
                "a motion that ends at rest, or no stop_travel",
                dict(self.end_rate),
            )
        jerk = next((joint.name for joint in self.robot.joints if joint.jerk is not None), None)
        if jerk is not None:
            reason = f"the jerk of joint {jerk} is limited, and the quickest stop begins at once"
            raise self._wrong(
                "limits", reason, "a robot without jerk limits, or no stop_travel", "stop_travel"
            )

    def check_total(self) -> None:
        """Raises ProblemError where the duration of the whole contradicts those of its motions; the planner says so too."""
        if self.duration is None:
            return
        timed = [entry.duration is not None for entry in self.motion]
        fixed = sum(entry.duration or 0.0 for entry in self.motion)
        if all(timed):
            raise self._wrong(
                "duration",
                "every motion has a duration of its own already",
                "no duration of the whole",
            )
        if fixed >= self.duration:
            raise self._wrong(
                "duration", f"dwells and timed motions alone take {fixed:g} s", "more than that"
            )

    def _check_for_toppra(self) -> None:
        """TOPP-RA is asked for nothing but the fastest motion along a path, without jerk limits."""
        asks = [
            f"a jerk limit of joint {joint.name}"
            for joint in self.robot.joints
            if joint.jerk is not None
        ]
        if self.duration is not None or self.objective == "effort":
            asks.append("a duration or effort as the objective")
        if self.planner == "toppra":
            moving = [entry for entry in self.motion if not isinstance(entry, Dwell)]
            free = [each for each in moving if not isinstance(each, (Straight, Follow))]
            asks += [f"a {each.kind} motion ({each.name})" for each in free]
            asks += [f"a duration of {each.name}" for each in moving if each.duration is not None]
            if asks:
                allowed = "straight motions and paths as fast as possible"
                raise self._wrong("planner", f"TOPP-RA cannot take {asks[0]}", allowed)
        for i, entry in enumerate(self.motion):
            own = [*asks, *["a duration"] * (entry.duration is not None)]
            if not own or not isinstance(entry, Follow):
                continue
            reason = f"TOPP-RA alone times it, and cannot take {own[0]}"
            if entry.constant_speed is not None:
                allowed = "no constant_speed; or motions as fast as possible, without jerk limits"
                raise self._wrong(f"motion[{i}].constant_speed", reason, allowed)
            points = len(entry.through) + 1
            if entry.curve == "samples" or (entry.curve == "spline" and points > MOST_OF_SPLINE):
                allowed = f"a spline through {MOST_OF_SPLINE} points at most; or as fast as possible, without jerk limits"
                raise self._wrong(f"motion[{i}]", reason, allowed, f"{points} points")

    def by_optimal_control(self, motion: Motion) -> bool:
        """A spline that TOPP-RA does not time: where jerk is limited, or a duration or the least effort asked for."""
        if not isinstance(motion, Follow) or motion.curve != "spline":
            return False
        slower = (
            self.duration is not None or motion.duration is not None or self.objective == "effort"
        )
        return slower or any(joint.jerk is not None for joint in self.robot.joints)
