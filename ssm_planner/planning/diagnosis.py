"""When there is no motion along a path: which motor cannot start or carry it, where; or which duration is too short."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ssm_planner.dynamics.friction import breakaway_coefficient, friction_coefficient, friction_of
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.transmission import breakaway_torque
from ssm_planner.planning.feasibility import blocked_by_eye
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.retiming.paths import JointPath
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.limits import Duration, MotorTorque
from ssm_planner.problem.problem import Problem
from ssm_planner.typing import Array

SAMPLES = 201


def no_motion(problem: Problem, phase: Phase, path: JointPath, message: str) -> Reason:
    """What stands in the way along a path: a motor that is too weak, or the eye; the solver's word where nothing does."""
    reason = motor_too_weak(problem, phase, path, SAMPLES)
    if reason is not None:
        return reason
    blocked = blocked_by_eye(problem, path.mechanism, phase, path.sample(np.linspace(0.0, 1.0, SAMPLES)).q)
    if blocked is not None:
        text = f"{blocked.message}; no way around it was found ({message})"
        return replace(blocked, message=text)
    text = f"{phase.motion.name}: no motion found ({message})"
    return Reason(None, phase.motion.name, None, None, text)


def motor_too_weak(problem: Problem, phase: Phase, path: JointPath, samples: int = 0) -> Reason | None:
    """The motor that is most too weak at the knots of a path or, with `samples`, between them too.

    A motor too weak at the knots of a free motion's path is so whatever way the motion takes between them.
    """
    knots, _ = path.directions
    s = np.union1d(np.linspace(0.0, 1.0, samples), knots)
    gravity = RigidBody.from_robot(problem.robot).gravity_load(path.sample(s).q)
    weakest: tuple[float, Reason] | None = None
    for i, joint in enumerate(problem.robot.joints):
        if joint.drive is None or joint.motor is None:
            continue
        needed = _starting_torque(path, i, joint.drive, s, gravity[:, i])
        k = int(np.argmax(needed))
        available = joint.motor.max_torque
        ratio = float(needed[k] / available)
        if ratio > 1 and (weakest is None or ratio > weakest[0]):
            place = f"{phase.motion.name}, {100 * s[k]:.0f} % of the way"
            text = (
                f"motor of joint {joint.name} is too weak to move at all: against gravity and friction it needs "
                f"{1e3 * needed[k]:.4g} mN·m and has {1e3 * available:.4g} mN·m ({place})"
            )
            weakest = ratio, Reason(joint.limit(MotorTorque), place, float(needed[k]), available, text)
    return None if weakest is None else weakest[1]


def _starting_torque(path: JointPath, i: int, drive: Drive, s: Array, gravity: Array) -> Array:
    """Motor torque (n,) that joint i needs for endlessly slow motion at s (n,), against gravity's effort (n,), N·m.

    The joint breaks away where it starts or turns back; elsewhere friction is that of slow motion.
    """
    friction = friction_of(drive)
    knots, signs = path.directions
    sign = signs[:, i]
    starts = knots[:-1][(sign != 0) & (sign != np.append(0.0, sign[:-1]))]
    mu = np.where(np.isin(s, starts), breakaway_coefficient(friction), np.asarray(friction_coefficient(friction, 0.0)))
    # at a knot the joint has to come, and to leave
    before, after = (np.clip(np.searchsorted(knots, s, side=side) - 1, 0, len(sign) - 1) for side in ("left", "right"))
    torques = [np.abs(breakaway_torque(drive, gravity, sign[k], mu)) * np.abs(sign[k]) for k in (before, after)]
    return np.maximum(*torques)


def duration_too_short(name: str, asked: float, needed: float) -> Reason:
    """A duration asked for that is shorter than the fastest motion."""
    text = f"{name} takes at least {needed:.6g} s within the limits; {asked:.6g} s were asked for"
    return Reason(Duration(asked, name), name, needed, asked, text)


def durations_disagree(asked: float, fixed: float) -> Reason:
    """A duration of the whole, where every motion has one of its own and they add up to another."""
    text = f"the motions have durations of their own, {fixed:.6g} s in all; {asked:.6g} s were asked for the whole"
    return Reason(Duration(asked, exact=True), "the whole motion", fixed, asked, text)
