"""The smallest change of one limit that makes a problem solvable, found by trying."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from ssm_planner.planning.reason import Reason
from ssm_planner.problem.values import Eye, Joint, Problem

GROWTH = (1.0, 1.03, 1.1, 1.3, 2.0)
"""By how much a relaxation that is needed at least is enlarged until it does."""
HALVINGS = 2
BARELY = 1e-6
"""Share by which a relaxation goes beyond the value that is needed, so that rounding does not spoil it."""
TO_MOVE = 5e-3
"""Share of a torque or an acceleration beyond what is needed at least: with none the motion creeps, or is the only one."""
SHARES = (0.1, 1.0)
"""By how much limits are relaxed one by one where it is not known which one stands in the way."""
PATIENCE = 4.0
"""Process time after which no other relaxation is tried, s."""
UNITS = {"rad": ("deg", 57.29577951308232), "m": ("mm", 1e3), "N·m": ("mN·m", 1e3), "s": ("s", 1.0), "": ("", 1.0)}

Attempt = Callable[[Problem], "float | Reason"]
"""Duration of a certified plan, or why there is none."""


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


@dataclass(frozen=True, eq=False)
class Cure:
    """A relaxation tried at one value; outcome: the duration of the motion that it gives, or the reason why there is none."""

    relaxation: Relaxation
    value: float
    outcome: float | Reason

    @property
    def works(self) -> bool:
        return isinstance(self.outcome, float)

    @property
    def problem(self) -> Problem:
        """The problem with the value tried."""
        return self.relaxation.problem(self.value)

    @property
    def text(self) -> str:
        if isinstance(self.outcome, Reason):
            return f"{self.relaxation.text(self.value)}: tried, does not do alone: {self.outcome.message}"
        return f"{self.relaxation.text(self.value)}: tried, takes {self.outcome:.4g} s"


def tried(problem: Problem, reason: Reason, attempt: Attempt, patience: float = PATIENCE) -> Cure | None:
    """The smallest change of one limit that was found to do, or what the limit that the reason names does not do alone.

    None where nothing that was tried did. patience: process time after which no other attempt is begun, s.
    """
    fast = replace(problem, objective="time" if problem.objective == "time then heat" else problem.objective)
    known = _known(fast, reason)
    begin = time.process_time()

    def patient() -> bool:
        return time.process_time() - begin < patience

    return _any(fast, attempt, patient) if known is None else _least(known, attempt, patient)


def _least(relaxation: Relaxation, attempt: Attempt, patient: Callable[[], bool]) -> Cure | None:
    """The least value of one relaxation that does, to a few per cent of the way beyond what is needed at least."""

    def cure(growth: float) -> Cure:
        step = relaxation.needed - relaxation.present
        value = relaxation.present + step * growth * (1 + BARELY)
        return Cure(relaxation, value, attempt(relaxation.problem(value)))

    short = 0.0
    for growth in GROWTH:
        found = cure(growth)
        if found.works or not patient():
            break
        short = growth
    for _ in range(HALVINGS if short and found.works else 0):
        if not patient():
            break
        less = cure((short + growth) / 2)
        if less.works:
            found, growth = less, (short + growth) / 2
        else:
            short = (short + growth) / 2
    return found


def _any(problem: Problem, attempt: Attempt, patient: Callable[[], bool]) -> Cure | None:
    """The relaxation by the smallest share, of all limits one by one."""
    for share in SHARES:
        for relaxation in _every(problem):
            if not patient():
                return None
            value = relaxation.present + share * (relaxation.needed - relaxation.present)
            found = Cure(relaxation, value, attempt(relaxation.problem(value)))
            if found.works:
                return found
    return None


def _known(problem: Problem, reason: Reason) -> Relaxation | None:
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
    if name != reason.constraint and name in problem.limits:
        low, high = problem.limits[name]
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
    unit = "rad" if joint.kind == "revolute" else "m"
    what = f"velocity limit of joint {joint.name} (per second) of"
    return Relaxation(what, unit, joint.velocity, needed, lambda value: _with_joint(problem, i, velocity=value))


def _acceleration(problem: Problem, i: int, joint: Joint, needed: float) -> Relaxation:
    unit = "rad" if joint.kind == "revolute" else "m"
    what = f"acceleration limit of joint {joint.name} (per second squared) of"
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

    return Relaxation("a duration of", "s", reason.available, reason.required, changed)


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


def _every(problem: Problem) -> Iterator[Relaxation]:
    """All limits, each with twice its value as what is needed."""
    for i, joint in enumerate(problem.robot.joints):
        for make, present in ((_torque, joint.motor.max_torque if joint.motor else 0.0), (_velocity, joint.velocity)):
            relaxation = make(problem, i, joint, 2 * present)
            if relaxation is not None:
                yield relaxation
    speed = problem.tip_speed
    if speed is not None:
        what = "tip speed (per second) of"
        yield Relaxation(what, "m", speed, 2 * speed, lambda value: replace(problem, tip_speed=value))
    for name, (low, high) in problem.limits.items():
        yield from _widened(problem, name, low, high)


def _widened(problem: Problem, name: str, low: float, high: float) -> Iterator[Relaxation]:
    """A range of a task coordinate, on either side."""
    unit, width = "m" if name == "depth" else "rad", high - low

    def to(value: float, *, lower: bool) -> Problem:
        return replace(problem, limits={**problem.limits, name: (value, high) if lower else (low, value)})

    yield Relaxation(f"range of {name} from", unit, low, low - width, lambda value: to(value, lower=True))
    yield Relaxation(f"range of {name} to", unit, high, high + width, lambda value: to(value, lower=False))


def _with_joint(problem: Problem, i: int, **changes: Any) -> Problem:
    joints = list(problem.robot.joints)
    joints[i] = replace(joints[i], **changes)
    first, second, third, fourth = joints
    return replace(problem, robot=replace(problem.robot, joints=(first, second, third, fourth)))
