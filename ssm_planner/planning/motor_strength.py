"""Motors that no motion can suit: too weak to move, to brake or to hold a speed, or too hot.

`no_motion` looks for the cause after a solver has found no motion.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import compress

import numpy as np

from ssm_planner.dynamics import (
    RigidBody,
    breakaway_coefficient,
    breakaway_torque,
    drive_torque,
    friction_coefficient,
    friction_of,
    motor_torque_rows,
    motorised,
)
from ssm_planner.planning.feasibility import blocked_by_eye, feasible_phases
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.reason import Reason, exceeded
from ssm_planner.planning.retiming.paths import JointPath, PathSamples, joint_starts
from ssm_planner.planning.tolerances import ROUNDING, SAMPLES
from ssm_planner.problem import ContinuousTorque, Drive, MotorTorque, Problem, Robot
from ssm_planner.typing import Array, record


def no_motion(phase: Phase, path: JointPath, message: str) -> Reason:
    """Return what prevents a motion: a weak motor, the eye, or the solver's message."""
    reason = motor_too_weak(phase, path, SAMPLES)
    if reason is not None:
        return reason
    blocked = blocked_by_eye(replace(phase, path=path))
    if blocked is not None:
        text = f"{blocked.message}, so the direct motion is blocked ({message})"
        return replace(blocked, message=text)
    text = f"{phase.motion.name}: no motion found ({message})"
    return Reason(None, phase.motion.name, None, None, text)


def _overloaded(
    robot: Robot,
    kind: type[MotorTorque | ContinuousTorque],
    needs: Iterable[tuple[int, float, str | None]],
    words: str,
) -> Reason | None:
    """Return the motor whose torque is exceeded by the largest factor, or None.

    `needs` are joint, needed torque (N·m) and place. `words` continues the message after the name
    of the joint, with {value} and {bound}.
    """
    worst, result = 0.0, None
    for i, needed, location in needs:
        limit = robot.joints[i].limit(kind)
        text = f"the motor of joint {robot.joints[i].name} {words}"
        reason = exceeded(limit, needed, location, text, ROUNDING * limit.largest)
        if reason is not None and needed / limit.largest > worst:
            worst, result = needed / limit.largest, reason
    return result


def motor_too_weak(phase: Phase, path: JointPath, samples: int = 0) -> Reason | None:
    """Return the motor that is too weak to start moving against gravity and friction, or None.

    The knots of the path are tested, and `samples` evenly spaced points. A motor that is too weak
    at the knots of a free motion is too weak on every path between them. Friction is static where
    the joint starts or reverses, and that of slow motion elsewhere.
    """
    knots, signs = path.directions
    at = path.sample(np.union1d(np.linspace(0.0, 1.0, samples), knots))
    robot = phase.problem.robot
    gravity = RigidBody.from_robot(robot).gravity_load(at.q)
    starts = joint_starts(at, knots, signs)
    # At a knot the joint must arrive as well as leave.
    segments = [
        np.clip(np.searchsorted(knots, at.s, side=side) - 1, 0, len(signs) - 1)
        for side in ("left", "right")
    ]

    def needs() -> Iterator[tuple[int, float, str]]:
        for i, drive, _ in motorised(robot.joints):
            friction = friction_of(drive)
            slow = np.asarray(friction_coefficient(friction, 0.0))
            mu = np.where(starts[:, i], breakaway_coefficient(friction), slow)
            torques = [
                np.abs(sign * breakaway_torque(drive, gravity[:, i], sign, mu))
                for sign in (signs[segment, i] for segment in segments)
            ]
            torque = np.maximum(*torques)
            k = int(np.argmax(torque))
            yield i, float(torque[k]), f"{phase.motion.name}, {100 * at.s[k]:.0f} % of the way"

    # On a free motion, other joints may move first and relieve the motor.
    task = "move at all" if phase.path is path else "move with the other joints there"
    return _overloaded(
        robot,
        MotorTorque,
        needs(),
        f"is too weak to {task}: against gravity and friction it needs {{value}}, but it has only "
        "{bound}",
    )


def motor_too_weak_to_brake(phase: Phase) -> Reason | None:
    """Return the motor that is too weak at the velocity at which a phase begins.

    No accelerations within the limits help then. If the load resists, a motor that cannot hold the
    velocity would have to brake harder than its joint may. The torque in the direction of motion is
    convex in the effort, and the effort is linear in the accelerations. The minimum is bounded from
    below on a grid.
    """
    robot, qd = phase.problem.robot, phase.qd_start
    if not qd.any():
        return None
    largest = robot.accelerations
    accelerations = np.vstack([np.zeros(4), np.diag(largest)])
    load = RigidBody.from_robot(robot).inverse_dynamics(
        np.tile(phase.q_start, (5, 1)), np.tile(qd, (5, 1)), accelerations
    )
    reach = np.abs(load[1:] - load[0]).sum(axis=0)

    def needs() -> Iterator[tuple[int, float, str]]:
        for i, drive, _ in motorised(robot.joints):
            sign = float(np.sign(qd[i]))
            if sign:
                efforts = load[0, i] + np.linspace(-reach[i], reach[i], SAMPLES)
                law, _ = drive_torque(
                    drive, efforts, qd[i], -sign * largest[i], sign, breakaway=False
                )
                torque = sign * np.asarray(law)
                needed = float(torque.min() - np.abs(np.diff(torque)).max())
                yield i, needed, f"{phase.motion.name}, at its start"

    return _overloaded(
        robot,
        MotorTorque,
        needs(),
        "is too weak for the speed at the start: even at the largest deceleration of the joint it "
        "needs {value}, but it has only {bound}",
    )


def motor_too_hot(phases: Sequence[Phase]) -> Reason | None:
    """Return the motor whose continuous torque every motion exceeds, however slow it is.

    None if not certain.

    In a straight phase from rest to rest in which a joint moves one way, its mean motor torque is
    at least a (`_SlowMotion`), so the mean square is at least a². A joint at rest has a = 0.
    For phases of durations T_k and a pause P,

        RMS² ≥ Σ a_k² T_k / (Σ T_k + P).

    The right side is monotone in each T_k, so its minimum has all T_k at their lower bounds, or one
    of them infinite. A phase without a given duration in which the joint may rest allows any RMS.
    Stribeck friction is taken at its smallest, and ripple is left out.
    """
    pause, robot = phases[0].problem.duty, phases[0].problem.robot
    if pause is None:
        return None
    bounds = [phase.motion.duration or phase.lower_bound for phase in phases]
    slow = [_SlowMotion.from_phase(robot, phase) for phase in phases]
    untimed = [not phase.motion.duration for phase in phases]

    def needs() -> Iterator[tuple[int, float, None]]:
        for i, drive, _ in motorised(robot.joints):
            means = [motion.least_mean_torque(i, drive) if motion else 0.0 for motion in slow]
            heat = np.square(means) @ bounds / (sum(bounds) + pause)
            yield i, min([math.sqrt(heat), *compress(means, untimed)]), None

    return _overloaded(
        robot,
        ContinuousTorque,
        needs(),
        "would run at an RMS torque of at least {value}, however slowly it moves, because of "
        "friction and load alone; its continuous torque is {bound}",
    )


def exceeds_thermal_bound(problem: Problem) -> Reason | None:
    """Return the motor whose continuous torque every motion exceeds, however slow it is.

    None if that is not certain without planning.
    """
    phases, reason = feasible_phases(problem)
    return None if reason is not None else motor_too_hot(phases)


@record
class _SlowMotion:
    """A straight phase from rest to rest at n samples."""

    samples: PathSamples
    signs: Array
    """Signs of the joints' motion between reversals, (k, 4)."""
    load: tuple[Array, Array, Array]
    """A, B, C of τ_rigid = A s̈ + B ṡ² + C, (n, 4) each."""
    speed_limit: Array
    """Largest ṡ that the joints' velocities allow, (n,)."""

    @classmethod
    def from_phase(cls, robot: Robot, phase: Phase) -> _SlowMotion | None:
        """Return the samples of a phase. None if it is not straight, or begins or ends at speed."""
        if phase.path is None or not phase.begins_and_ends_at_rest:
            return None
        samples = phase.path.overview
        load = RigidBody.from_robot(robot).path_load(samples.q, samples.dq, samples.ddq)
        velocity = robot.velocities
        with np.errstate(divide="ignore", over="ignore"):
            speed_limit = np.min(velocity / np.abs(samples.dq), axis=1)
        return cls(samples, phase.path.directions[1], load, speed_limit)

    def least_mean_torque(self, i: int, drive: Drive) -> float:
        """Return a lower bound of the mean torque of motor i, N·m.

        It is 0 if the joint may rest or reverse.

        The torque is the larger of two lines in the effort F. It is therefore above c F for every
        slope c between theirs. Over a motion from rest to rest, F = A s̈ + B ṡ² + C has the same
        mean as (B − A') ṡ² + C, and ṡ is at most what the joints' velocities allow.
        """
        signs = np.unique(self.signs[:, i])
        if drive.two_nuts or len(signs) != 1 or signs[0] == 0:
            return 0.0
        friction = friction_of(drive)
        inertia, speed, static = (term[:, i] for term in self.load)
        viscous = friction.b_ov * np.abs(self.samples.dq[:, i]) * self.speed_limit
        varying = np.abs(speed - np.gradient(inertia, self.samples.s)) * self.speed_limit**2
        # In the direction of motion the torque is b_c + max(up F, down F).
        effort = signs[0] * static + friction.b_oc
        up, down = motor_torque_rows(drive, int(signs[0]), friction.mu).slope
        slopes = np.array([up, down, np.clip(0.0, down, up)])[:, None]
        bounds = friction.b_c + slopes * effort - np.abs(slopes) * (varying + viscous)
        return max(0.0, float(bounds.min(axis=1).max()))
