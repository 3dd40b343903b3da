"""Limits of a problem that can be moved, each as one value: those that a reason names, and all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from ssm_planner.planning.reason import Reason
from ssm_planner.problem.limits import TaskRange, TipSpeed
from ssm_planner.problem.problem import Eye, Problem
from ssm_planner.problem.robot import Joint

TO_MOVE = 5e-3
"""Share of a torque or an acceleration beyond what is needed at least: with none the motion creeps, or is the only one."""
DEGREE = 57.29577951308232
UNITS = {
    **{f"rad{per}": (f"deg{per}", DEGREE) for per in ("", "/s", "/s²")},
    **{f"m{per}": (f"mm{per}", 1e3) for per in ("", "/s", "/s²")},
    "N·m": ("mN·m", 1e3),
    "s": ("s", 1.0),
    "": ("", 1.0),
}
"""Unit and scale in words, by SI unit."""


@dataclass(frozen=True, eq=False)
class Relaxation:
    """One limit that may be moved: from `present` to `needed` at least; problem(value) is the problem with it moved."""

    what: str
    unit: str
    present: float
    needed: float
    problem: Callable[[float], Problem]

    def text(self, value: float) -> str:
        unit, scale = UNITS[self.unit]
        return (
            f"{self.what} {scale * value:.6g} {unit}".rstrip()
            + f" instead of {scale * self.present:.6g} {unit}".rstrip()
        )


def named(problem: Problem, reason: Reason) -> Relaxation | None:
    """The limit that the reason names."""
    if reason.required is None or reason.available is None:
        return None
    names = [joint.name for joint in problem.robot.joints]
    if reason.joint in names:
        i = names.index(str(reason.joint))
        joint = problem.robot.joints[i]
        make = _OF_JOINT.get(reason.constraint)
        return None if make is None else make(problem, i, joint, reason.required)
    if reason.constraint == "duration":
        return _duration(problem, reason)
    name = reason.constraint.removesuffix(" range")
    if name != reason.constraint and name in problem.ranges:
        low, high = problem.ranges[name]
        lower, upper = _widened(problem, name, low, high)
        return replace(lower if reason.required < low else upper, needed=reason.required)
    if problem.eye is not None and reason.constraint in ("retina clearance", "lens clearance"):
        return _eye(problem, problem.eye, reason)
    return None


def _torque(problem: Problem, i: int, joint: Joint, needed: float) -> Relaxation | None:
    motor = joint.motor
    if motor is None:
        return None

    def changed(value: float) -> Problem:
        return _with_joint(problem, i, motor=replace(motor, max_torque=value))

    enough = max(needed, motor.max_torque) * (1 + TO_MOVE)
    return Relaxation(f"largest motor torque of joint {joint.name} of", "N·m", motor.max_torque, enough, changed)


def _continuous_torque(problem: Problem, i: int, joint: Joint, needed: float) -> Relaxation | None:
    motor = joint.motor
    if motor is None:
        return None

    def changed(value: float) -> Problem:
        return _with_joint(problem, i, motor=replace(motor, nominal_torque=value))

    what = f"continuous torque of joint {joint.name} of"
    return Relaxation(what, "N·m", motor.nominal_torque, needed, changed)


def _position(problem: Problem, i: int, joint: Joint, needed: float) -> Relaxation:
    low, high = joint.position
    side = 0 if needed < low else 1

    def changed(value: float) -> Problem:
        return _with_joint(problem, i, position=(value, high) if side == 0 else (low, value))

    unit = "rad" if joint.kind == "revolute" else "m"
    return Relaxation(f"range of joint {joint.name} to", unit, joint.position[side], needed, changed)


def _velocity(problem: Problem, i: int, joint: Joint, needed: float) -> Relaxation:
    unit = "rad/s" if joint.kind == "revolute" else "m/s"
    what = f"velocity limit of joint {joint.name} of"
    return Relaxation(what, unit, joint.velocity, needed, lambda value: _with_joint(problem, i, velocity=value))


def _acceleration(problem: Problem, i: int, joint: Joint, needed: float) -> Relaxation:
    unit = "rad/s²" if joint.kind == "revolute" else "m/s²"
    what = f"acceleration limit of joint {joint.name} of"
    enough = max(needed, joint.acceleration) * (1 + TO_MOVE)
    return Relaxation(what, unit, joint.acceleration, enough, lambda value: _with_joint(problem, i, acceleration=value))


def _friction(problem: Problem, i: int, joint: Joint, needed: float) -> Relaxation | None:
    drive = joint.drive
    if drive is None or drive.friction is None:
        return None
    friction = drive.friction

    def changed(value: float) -> Problem:
        raised = replace(
            friction, mu=max(friction.mu, value), mu_static=max(friction.mu_static, value), mu_lowest=value
        )
        return _with_joint(problem, i, drive=replace(drive, friction=raised))

    present = friction.mu if friction.mu_lowest is None else friction.mu_lowest
    return Relaxation(f"lowest friction coefficient μ of joint {joint.name} of", "", present, needed, changed)


_OF_JOINT: dict[str, Callable[[Problem, int, Joint, float], Relaxation | None]] = {
    "motor torque": _torque,
    "continuous torque": _continuous_torque,
    "position": _position,
    "velocity": _velocity,
    "acceleration": _acceleration,
    "self-locking": _friction,
}


def _duration(problem: Problem, reason: Reason) -> Relaxation | None:
    if reason.required is None or reason.available is None:
        return None
    motions = problem.motion

    def changed(value: float) -> Problem:
        if problem.duration is not None:
            return replace(problem, duration=value)
        short = (m.kind != "dwell" and (m.name, m.duration) == (reason.where, reason.available) for m in motions)
        timed = (replace(m, duration=value) if is_short else m for m, is_short in zip(motions, short, strict=True))
        return replace(problem, motion=tuple(timed))

    # with nothing to spare the least effort is the fastest motion, and hard to find
    spare = 1.0 if problem.duration is not None and all(m.duration is not None for m in motions) else 1.002
    return Relaxation("a duration of", "s", reason.available, spare * reason.required, changed)


def _eye(problem: Problem, eye: Eye, reason: Reason) -> Relaxation | None:
    if reason.required is None or reason.available is None:
        return None
    if reason.constraint == "retina clearance":
        if reason.available < 0:  # beyond the retina itself: no clearance does
            return None
        return Relaxation(
            "clearance from the retina of",
            "m",
            eye.clearance,
            reason.available,
            lambda value: replace(problem, eye=replace(eye, clearance=value)),
        )
    if reason.available <= 1 or eye.lens is None:
        return None
    thickness = float(min(eye.lens.semi_axes))
    return Relaxation(
        "radius of the shaft of",
        "m",
        eye.shaft_radius,
        (reason.available - 1) * thickness,
        lambda value: replace(problem, eye=replace(eye, shaft_radius=value)),
    )


def every(problem: Problem) -> Iterator[Relaxation]:
    """All limits, each with twice its value as what is needed."""
    for i, joint in enumerate(problem.robot.joints):
        for make, present in ((_torque, joint.motor.max_torque if joint.motor else 0.0), (_velocity, joint.velocity)):
            relaxation = make(problem, i, joint, 2 * present)
            if relaxation is not None:
                yield relaxation
    speed = problem.tip_speed
    if speed is not None:
        yield Relaxation("tip speed of", "m/s", speed, 2 * speed, lambda value: TipSpeed(value).on(problem))
    for name, (low, high) in problem.ranges.items():
        yield from _widened(problem, name, low, high)


def _widened(problem: Problem, name: str, low: float, high: float) -> Iterator[Relaxation]:
    """A range of a task coordinate, on either side."""
    unit, width = "m" if name == "depth" else "rad", high - low

    def to(value: float, *, lower: bool) -> Problem:
        return TaskRange(name, value if lower else low, high if lower else value).on(problem)

    yield Relaxation(f"range of {name} from", unit, low, low - width, lambda value: to(value, lower=True))
    yield Relaxation(f"range of {name} to", unit, high, high + width, lambda value: to(value, lower=False))


def _with_joint(problem: Problem, i: int, **changes: Any) -> Problem:
    joints = list(problem.robot.joints)
    joints[i] = replace(joints[i], **changes)
    first, second, third, fourth = joints
    return replace(problem, robot=replace(problem.robot, joints=(first, second, third, fourth)))
