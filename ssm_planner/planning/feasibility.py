"""Reasons that can be found without a solver: ranges, the eye, velocities, motors, durations.

`infeasible_place` checks straight paths and the points of other motions, `with_boundary_rates` the
velocities at both ends of a motion, and `motor_too_hot` the heat of the slowest motion. `no_motion`
looks for the cause after a solver has found no motion.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import compress, pairwise, product

import numpy as np

from ssm_planner.codegen.namespace import NUMPY
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
from ssm_planner.errors import ProblemError
from ssm_planner.kinematics import (
    Mechanism,
    eye_limits,
    joint_rates,
    task_from_joints,
    task_of_joints,
    task_rates,
    tip_position,
)
from ssm_planner.planning.lower_bound import lower_bound
from ssm_planner.planning.phases import Phase, reversal_ranges, straight_path
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.retiming.constraints import braking_travel
from ssm_planner.planning.retiming.paths import JointPath, PathSamples
from ssm_planner.planning.tolerances import ROUNDING, SAME, SAMPLES
from ssm_planner.problem import (
    TASK,
    ConstantSpeed,
    ContinuousTorque,
    Drive,
    Duration,
    JointAcceleration,
    JointPosition,
    JointVelocity,
    Limit,
    MotorTorque,
    Problem,
    RetinaClearance,
    Robot,
    TaskRange,
)
from ssm_planner.typing import Array, record
from ssm_planner.units import display_unit


def infeasible_place(
    problem: Problem, mechanism: Mechanism, phases: Sequence[Phase]
) -> Reason | None:
    """Return the reason for the first place that a limit forbids, or None.

    The limits are the ranges of joints and task coordinates, the retina's clearance and the lens.
    """
    for phase in phases:
        q = _joints(phase)
        reason = _beyond_range(problem, mechanism, phase, q) or _past_boundary(
            problem, mechanism, phase
        )
        reason = reason or blocked_by_eye(problem, mechanism, phase, q)
        if reason is not None:
            return reason
    return None


def _joints(phase: Phase) -> Array:
    """Return the joints along a path, or at the points of another motion, (n, 4)."""
    return phase.points if phase.path is None else phase.path.overview.q


def _location_text(phase: Phase, k: int, count: int) -> str:
    """Describe the place of sample k of `count` samples along a phase."""
    if phase.path is None and count == len(phase.points) and 0 < k < count - 1:
        return f"{phase.motion.name}, at point {k} on its way"
    if k in (0, count - 1):
        return f"{phase.motion.name}, at its {'end' if k else 'start'}"
    return f"{phase.motion.name}, {100 * k / (count - 1):.0f} % of the way"


def _beyond_range(problem: Problem, mechanism: Mechanism, phase: Phase, q: Array) -> Reason | None:
    """Return the first joint or task coordinate out of its range, at its worst sample.

    q (n, 4) are the joints along the phase.
    """

    def ranges() -> Iterator[tuple[Limit, str, Array, float]]:
        for i, joint in enumerate(problem.robot.joints):
            tolerance = ROUNDING * (joint.position[1] - joint.position[0])
            yield (
                joint.limit(JointPosition),
                f"joint {joint.name} would have to reach",
                q[:, i],
                tolerance,
            )
        wrapped = task_from_joints(mechanism, q)
        continuous = _continuous(mechanism, phase, q)
        for limit in problem.limits:
            if isinstance(limit, TaskRange):
                name = limit.coordinate
                task = (
                    wrapped if limit.high - limit.low >= 2 * np.pi else continuous
                    # A range of a turn or more excludes no angle, so values may be wrapped.
                )
                yield limit, f"{name} would have to be", task[:, TASK.index(name)], SAME

    for limit, description, values, tolerance in ranges():
        over = np.maximum(limit.low - values, values - limit.high)
        k = int(np.argmax(over))
        if over[k] > tolerance:
            value = float(values[k])
            bound = limit.bound(float(values[k]))
            location = _location_text(phase, k, len(values))
            unit, scale = display_unit(limit.unit)
            text = (
                f"{description} {value * scale:.6g} {unit}, but its range ends at "
                f"{bound * scale:.6g} {unit} ({location})"
            )
            return Reason(limit, location, value, bound, text)
    return None


def _continuous(mechanism: Mechanism, phase: Phase, q: Array) -> Array:
    """Return unwrapped task coordinates (n, 4) of joints along a phase."""
    task = np.stack(task_of_joints(NUMPY, mechanism, q.T), axis=1)
    return np.asarray(
        task + 2 * np.pi * np.round((phase.start - task[0]) / (2 * np.pi)) * (1, 0, 1, 0)
    )


def _past_boundary(problem: Problem, mechanism: Mechanism, phase: Phase) -> Reason | None:
    """Return the tilt range if joint 2 must leave it at the workspace boundary.

    Tilt depends on joint 2 alone. Its extremes are where the branches of the inverse kinematics
    meet, at δ + k π. Every motion between points on both sides of an extreme passes it.
    """
    limit = next(
        (item for item in problem.limits if item.key == (TaskRange.name_of("tilt"), None)), None
    )
    if phase.path is not None or limit is None:
        return None
    name = problem.robot.joints[1].name
    unit, scale = display_unit("rad")
    for k, (start, end) in enumerate(pairwise(phase.points)):
        low, high = sorted((float(start[1]), float(end[1])))
        turns = np.arange(
            np.ceil((low - mechanism.delta) / np.pi), (high - mechanism.delta) / np.pi
        )
        if not len(turns):
            continue
        there = np.tile(start, (len(turns), 1))
        there[:, 1] = mechanism.delta + np.pi * turns
        tilts = task_from_joints(mechanism, there)[:, 1]
        over = np.maximum(limit.low - tilts, tilts - limit.high)
        tilt = float(tilts[np.argmax(over)])
        if over.max() > SAME:
            location = f"{phase.motion.name}, between its points {k} and {k + 1}"
            text = (
                f"joint {name} passes the workspace boundary between {low * scale:.6g} {unit} and "
                f"{high * scale:.6g} {unit}, where tilt is {tilt * scale:.6g} {unit}, "
                f"but the range of tilt ends at {limit.bound(tilt) * scale:.6g} {unit}"
            )
            return Reason(limit, location, tilt, limit.bound(tilt), f"{text} ({location})")
    return None


def blocked_by_eye(problem: Problem, mechanism: Mechanism, phase: Phase, q: Array) -> Reason | None:
    """Return the retina or the lens if a sample q (n, 4) comes too near to it."""
    if problem.eye is None:
        return None
    values = eye_limits(NUMPY, problem.eye, tip_position(mechanism, q).T)
    for limit in problem.eye.limits:
        value, smallest = values[limit.name]
        k = int(np.argmin(value))
        distance = float(value[k])
        if distance >= smallest - ROUNDING:
            continue
        location = _location_text(phase, k, len(q))
        if isinstance(limit, RetinaClearance):
            text = (
                f"the tip would come within {1e3 * distance:.4g} mm of the retina, "
                f"but the clearance is {1e3 * smallest:.4g} mm"
            )
        else:
            text = (
                f"the shaft would touch the lens: it would pass at {distance:.4g} times the size "
                f"of the lens from its centre, but at least {smallest:.4g} is required"
            )
        return Reason(limit, location, smallest, distance, f"{text} ({location})")
    return None


def nearest_to_eye(problem: Problem, path: JointPath) -> Array:
    """Return the joints (4,) where a path is nearest to retina or lens, or deepest in them."""
    q = path.overview.q
    values = (
        []
        if problem.eye is None
        else eye_limits(NUMPY, problem.eye, tip_position(path.mechanism, q).T).values()
    )
    clearance = np.min(
        [value / smallest for value, smallest in values if smallest > 0] or np.zeros((1, len(q))),
        axis=0,
    )
    return np.asarray(q[int(np.argmin(clearance))])


def straight_instead(problem: Problem, mechanism: Mechanism, phase: Phase) -> Phase | None:
    """Return a free phase from rest to rest as a straight line in task coordinates.

    None if the line is not possible, or if a limit forbids a place on it.
    """
    # The line in task coordinates must differ from the one in the joints.
    ways_differ = np.abs((phase.end - phase.start)[:2]).max() > ROUNDING
    if len(phase.points) != 2 or phase.qd_start.any() or phase.qd_end.any() or not ways_differ:
        return None
    start, end = phase.points
    path = straight_path(problem, mechanism, phase.start, phase.end, start)
    if np.abs(path.sample(np.array([1.0])).q[0] - end).max() > ROUNDING:
        return None
    straight = replace(phase, path=path)
    if infeasible_place(problem, mechanism, (straight,)) is not None or _grazes_eye(problem, path):
        return None
    return straight


def _grazes_eye(problem: Problem, path: JointPath) -> bool:
    """Return True if a path comes too near to retina or lens between its samples.

    The distance has a sharp corner at the port, which samples may miss.
    """
    if problem.eye is None:
        return False
    for name in (limit.name for limit in problem.eye.limits):
        s = np.linspace(0.0, 1.0, SAMPLES)
        for _ in range(2):
            values, smallest = eye_limits(
                NUMPY, problem.eye, tip_position(path.mechanism, path.sample(s).q).T
            )[name]
            k = int(np.argmin(values))
            if values[k] < smallest - ROUNDING:
                return True
            s = np.linspace(s[max(k - 1, 0)], s[min(k + 1, len(s) - 1)], SAMPLES)
    return False


def with_boundary_rates(
    problem: Problem, mechanism: Mechanism, phases: tuple[Phase, ...]
) -> tuple[tuple[Phase, ...], Reason | None]:
    """Return the phases with q̇ at the start of the first and at the end of the last one.

    The reason is set if they cannot have these velocities.

    Raises
    ------
    ProblemError
        If a straight motion would leave its line.
    """
    # A motion to the present position takes no time, so its neighbours have the rates.
    moving = [
        k for k, phase in enumerate(phases) if phase.motion.duration is not None or not phase.stands
    ]
    for k, key in ((moving[0], "start_rate"), (moving[-1], "end_rate")):
        phase, reason = _with_rate(problem, mechanism, phases[k], key)
        if reason is not None:
            return phases, reason
        if key == "start_rate":
            phase = replace(phase, qdd_start=np.array(problem.start_acceleration))
        phases = (*phases[:k], phase, *phases[k + 1 :])
    return phases, next(
        (
            reason
            for phase in phases
            if (reason := _too_near(problem, mechanism, phase)) is not None
        ),
        None,
    )


def _with_rate(
    problem: Problem, mechanism: Mechanism, phase: Phase, key: str
) -> tuple[Phase, Reason | None]:
    """Return a phase with q̇ at one end from the requested task rates.

    `key` is start_rate or end_rate.
    """
    at_start = key == "start_rate"
    requested = problem.start_rate if at_start else problem.end_rate
    rate = np.array([requested.get(name, 0.0) for name in TASK])
    if not rate.any():
        return phase, None
    if phase.stands:
        raise ProblemError(
            "a dwell has no speed", file=problem.file, line=phase.motion.line, key=key
        )
    if phase.path is not None:
        _refuse_off_line(problem, mechanism, phase, key, rate)
    qd = joint_rates(mechanism, phase.points[0 if at_start else -1], rate)
    qd[np.abs(qd) < ROUNDING * np.array([joint.velocity for joint in problem.robot.joints])] = 0.0
    reason = _too_fast(problem, mechanism, (phase, key), qd)
    return replace(phase, qd_start=qd) if at_start else replace(phase, qd_end=qd), reason


def _refuse_off_line(
    problem: Problem, mechanism: Mechanism, phase: Phase, key: str, rate: Array
) -> None:
    """Raise ProblemError for task rates (4,) that do not point along the path at their end."""
    assert phase.path is not None
    sample = phase.path.sample(np.array([0.0 if key == "start_rate" else 1.0]))
    direction = task_rates(mechanism, sample.q, sample.dq)[0]
    projection = direction * (direction @ rate) / (direction @ direction)
    if direction @ rate < 0 or np.abs(rate - projection).max() > 1e-9 * np.abs(rate).max():
        raise ProblemError(
            f"a straight motion ({phase.motion.name}) keeps to its line, towards its target",
            file=problem.file,
            key=key,
            allowed="rates along the line, in the direction of the motion",
        )


def _too_fast(
    problem: Problem, mechanism: Mechanism, end: tuple[Phase, str], qd: Array
) -> Reason | None:
    """Return the limit that velocities at an end exceed: a velocity, or the distance to stop."""
    phase, key = end
    location = f"{phase.motion.name}, {key.replace('_', ' ')}"
    for i, joint in enumerate(problem.robot.joints):
        limit = joint.limit(JointVelocity)
        unit, scale = display_unit(limit.unit)
        if abs(qd[i]) > joint.velocity * (1 + ROUNDING):
            text = (
                f"joint {joint.name} would move at {scale * abs(qd[i]):.4g} {unit}, but its "
                f"limit is {scale * limit.largest:.4g} {unit} ({location})"
            )
            return Reason(limit, location, float(abs(qd[i])), limit.largest, text)
    return _too_far_to_stop(
        problem, mechanism, phase.points[0 if key == "start_rate" else -1], qd, location
    )


def _too_far_to_stop(
    problem: Problem, mechanism: Mechanism, q: Array, qd: Array, location: str
) -> Reason | None:
    """Return the limit if the tip travels too far before it can stop from qd (4,)."""
    limit = problem.stop_travel
    if limit is None:
        return None
    travel = float(braking_travel(mechanism, problem.robot, q[None], qd[None])[0])
    if travel <= limit.largest * (1 + ROUNDING):
        return None
    text = (
        f"the tip needs {1e3 * travel:.4g} mm to stop, but only "
        f"{1e3 * limit.largest:.4g} mm are allowed ({location})"
    )
    return Reason(limit, location, travel, limit.largest, text)


def _too_near(problem: Problem, mechanism: Mechanism, phase: Phase) -> Reason | None:
    """Return the limit of a joint whose displacement is too short for its change of velocity.

    A path allows |q̇₁² − q̇₀²| ≤ 2 q̈_max |Δq|. A free motion may overshoot, and needs the range to
    do so.
    """
    if phase.path is None:
        return _beyond_room(problem, mechanism, phase)
    if not (phase.qd_start.any() or phase.qd_end.any()):
        return None
    q = _joints(phase)
    for i, joint in enumerate(problem.robot.joints):
        initial = float(phase.qd_start[i])
        final = float(phase.qd_end[i])
        distance = float(np.abs(np.diff(q[:, i])).sum())
        needed = abs(initial**2 - final**2) / (2 * distance) if distance > 0 else 0.0
        if needed > joint.acceleration * (1 + ROUNDING):
            unit, scale = display_unit(joint.limit(JointPosition).unit)
            text = (
                f"joint {joint.name} has {scale * distance:.4g} {unit} to change its velocity from "
                f"{scale * abs(initial):.4g} to {scale * abs(final):.4g} {unit}/s. This requires "
                f"{scale * needed:.4g} {unit}/s², but its limit is "
                f"{scale * joint.acceleration:.4g} {unit}/s² ({phase.motion.name})"
            )
            return Reason(
                joint.limit(JointAcceleration), phase.motion.name, needed, joint.acceleration, text
            )
    return None


def _beyond_room(problem: Problem, mechanism: Mechanism, phase: Phase) -> Reason | None:
    """Return the range that a joint must leave to stop, or to reach its velocity at the end.

    The range may be that of tilt or depth.
    """
    ranges = reversal_ranges(problem, mechanism, phase.points)
    ends = (
        (phase.qd_start, 0, 1.0, "cannot stop before"),
        (phase.qd_end, -1, -1.0, "would have to start from"),
    )
    for (qd, side, sign, phrase), (i, joint) in product(ends, enumerate(problem.robot.joints)):
        there = phase.points[side].copy()
        there[i] += sign * qd[i] * abs(qd[i]) / (2 * joint.acceleration)
        if ranges[0, i] - SAME <= there[i] <= ranges[1, i] + SAME:
            continue
        limit: Limit = joint.limit(JointPosition)
        value, name = float(there[i]), f"joint {joint.name}"
        # The range of the task coordinate that follows this joint alone is exceeded.
        if limit.low <= value <= limit.high:
            name = {1: "tilt", 3: "depth"}[i]
            limit = next(
                item for item in problem.limits if item.key == (TaskRange.name_of(name), None)
            )
            value = float(task_from_joints(mechanism, there[None])[0, TASK.index(name)])
        unit, scale = display_unit(limit.unit)
        text = (
            f"{name} {phrase} {scale * value:.6g} {unit}, because joint {joint.name} moves at "
            f"{scale * abs(qd[i]):.4g} {unit}/s and accelerates by at most "
            f"{scale * joint.acceleration:.4g} {unit}/s², but its range ends at "
            f"{scale * limit.bound(value):.6g} {unit} ({phase.motion.name})"
        )
        return Reason(limit, phase.motion.name, value, limit.bound(value), text)
    return None


def no_motion(problem: Problem, phase: Phase, path: JointPath, message: str) -> Reason:
    """Return what prevents a motion: a weak motor, the eye, or the solver's message."""
    reason = motor_too_weak(problem, phase, path, SAMPLES)
    if reason is not None:
        return reason
    blocked = blocked_by_eye(problem, path.mechanism, phase, path.overview.q)
    if blocked is not None:
        text = f"{blocked.message}; no path around it was found ({message})"
        return replace(blocked, message=text)
    text = f"{phase.motion.name}: no motion found ({message})"
    return Reason(None, phase.motion.name, None, None, text)


def motor_too_weak(
    problem: Problem, phase: Phase, path: JointPath, samples: int = 0
) -> Reason | None:
    """Return a reason if a motor is too weak to start moving against gravity and friction.

    The reason names the weakest motor. It is None if all motors are strong enough. The knots of the
    path are tested, and `samples` evenly spaced points. A motor that is too weak at the knots of a
    free motion is too weak on every path between them.
    """
    knots, _ = path.directions
    s = np.union1d(np.linspace(0.0, 1.0, samples), knots)
    gravity = RigidBody.from_robot(problem.robot).gravity_load(path.sample(s).q)
    weakest: tuple[float, Reason] | None = None
    for i, drive, motor in motorised(problem.robot.joints):
        needed = _starting_torque(path, i, drive, s, gravity[:, i])
        k = int(np.argmax(needed))
        joint = problem.robot.joints[i]
        available = motor.max_torque
        ratio = float(needed[k] / available)
        if ratio > 1 and (weakest is None or ratio > weakest[0]):
            location = f"{phase.motion.name}, {100 * s[k]:.0f} % of the way"
            text = (
                f"the motor of joint {joint.name} is too weak to move at all: against gravity and "
                f"friction it needs {1e3 * needed[k]:.4g} mN·m, but it has only "
                f"{1e3 * available:.4g} mN·m ({location})"
            )
            weakest = (
                ratio,
                Reason(joint.limit(MotorTorque), location, float(needed[k]), available, text),
            )
    return None if weakest is None else weakest[1]


def motor_too_weak_to_brake(problem: Problem, phase: Phase) -> Reason | None:
    """Return the motor that is too weak at the velocity at which a phase begins.

    No accelerations within the limits help then. If the load resists, a motor that cannot hold the
    velocity would have to brake harder than its joint may. The torque in the direction of motion is
    convex in the effort, and the effort is linear in the accelerations. The minimum is bounded from
    below on a grid.
    """
    robot, qd = problem.robot, phase.qd_start
    accelerations = np.array([joint.acceleration for joint in robot.joints])
    pulls = np.vstack([np.zeros(4), np.diag(accelerations)])
    load = RigidBody.from_robot(robot).inverse_dynamics(
        np.tile(phase.q_start, (5, 1)), np.tile(qd, (5, 1)), pulls
    )
    for i, drive, motor in motorised(robot.joints):
        sign = float(np.sign(qd[i]))
        if not sign:
            continue
        reach = float(np.abs(load[1:, i] - load[0, i]).sum())
        efforts = np.linspace(load[0, i] - reach, load[0, i] + reach, SAMPLES)
        law, _ = drive_torque(
            drive, efforts, qd[i], -sign * accelerations[i], sign, breakaway=False
        )
        torque = sign * np.asarray(law)
        needed = float(torque.min() - np.abs(np.diff(torque)).max())
        if needed > motor.max_torque:
            joint = robot.joints[i]
            location = f"{phase.motion.name}, at its start"
            text = (
                f"the motor of joint {joint.name} is too weak for the speed at the start: even at "
                f"the largest deceleration of the joint it needs {1e3 * needed:.4g} mN·m, but it "
                f"has only {1e3 * motor.max_torque:.4g} mN·m ({location})"
            )
            return Reason(joint.limit(MotorTorque), location, needed, motor.max_torque, text)
    return None


def _starting_torque(path: JointPath, i: int, drive: Drive, s: Array, gravity: Array) -> Array:
    """Return the motor torque (n,) of joint i for infinitely slow motion at s (n,), N·m.

    `gravity` (n,) is the effort of gravity. Friction is static where the joint starts or reverses,
    and that of slow motion elsewhere.
    """
    friction = friction_of(drive)
    knots, signs = path.directions
    sign = signs[:, i]
    starts = knots[:-1][(sign != 0) & (sign != np.append(0.0, sign[:-1]))]
    mu = np.where(
        np.isin(s, starts),
        breakaway_coefficient(friction),
        np.asarray(friction_coefficient(friction, 0.0)),
    )
    # At a knot the joint must arrive as well as leave.
    arriving, leaving = (
        np.clip(np.searchsorted(knots, s, side=side) - 1, 0, len(sign) - 1)
        for side in ("left", "right")
    )
    torques = [
        np.abs(breakaway_torque(drive, gravity, sign[k], mu)) * np.abs(sign[k])
        for k in (arriving, leaving)
    ]
    return np.maximum(*torques)


def motor_too_hot(problem: Problem, phases: Sequence[Phase]) -> Reason | None:
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
    pause, robot = problem.duty, problem.robot
    if pause is None:
        return None
    hottest: tuple[float, Reason | None] = 1 + ROUNDING, None
    bounds = [phase.motion.duration or lower_bound(robot, phase.points) for phase in phases]
    slow = [_SlowMotion.from_phase(robot, phase) for phase in phases]
    untimed = [not phase.motion.duration for phase in phases]
    for i, drive, motor in motorised(robot.joints):
        means = [0.0 if motion is None else motion.least_mean_torque(i, drive) for motion in slow]
        moving = sum(mean**2 * bound for mean, bound in zip(means, bounds, strict=True))
        needed = min([math.sqrt(moving / (sum(bounds) + pause)), *compress(means, untimed)])
        ratio = needed / motor.nominal_torque
        if ratio > hottest[0]:
            joint = robot.joints[i]
            text = (
                f"the motor of joint {joint.name} would run at an RMS torque of at least "
                f"{1e3 * needed:.4g} mN·m, however slowly it moves, because of friction and load "
                f"alone; its continuous torque is {1e3 * motor.nominal_torque:.4g} mN·m"
            )
            reason = Reason(joint.limit(ContinuousTorque), None, needed, motor.nominal_torque, text)
            hottest = ratio, reason
    return hottest[1]


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
        if phase.path is None or phase.qd_start.any() or phase.qd_end.any():
            return None
        samples = phase.path.overview
        load = RigidBody.from_robot(robot).path_load(samples.q, samples.dq, samples.ddq)
        velocity = np.array([joint.velocity for joint in robot.joints])
        speed_limit = np.min(velocity / np.maximum(np.abs(samples.dq), 1e-12), axis=1)
        return cls(samples, phase.path.directions[1], load, speed_limit)

    def least_mean_torque(self, i: int, drive: Drive) -> float:
        """Return a lower bound of the mean torque of motor i, N·m.

        It is 0 if the joint may rest or reverse.

        The torque is the larger of two lines in the effort F. It is therefore above c F for every
        slope c between theirs, and c is chosen as that of slow motion. Over a motion from rest to
        rest, F = A s̈ + B ṡ² + C has the same mean as (B − A') ṡ² + C, and ṡ is at most what the
        joints' velocities allow.
        """
        signs = np.unique(self.signs[:, i])
        if drive.two_nuts or len(signs) != 1 or signs[0] == 0:
            return 0.0
        sign = float(signs[0])
        samples = self.samples
        speed_limit = self.speed_limit
        friction = friction_of(drive)
        inertia, speed, static = (term[:, i] for term in self.load)
        viscous = friction.b_ov * np.abs(samples.dq[:, i]) * speed_limit
        inertial = np.abs(speed - np.gradient(inertia, samples.s)) * speed_limit**2 + viscous
        # In the direction of motion the torque is b_c + max(up F, down F).
        effort = sign * static + friction.b_oc
        up, down = (
            float(slope) for slope in motor_torque_rows(drive, int(sign), friction.mu).slope
        )
        slope = up if effort.min() > 0 else down if effort.max() < 0 else min(max(0.0, down), up)
        bound = friction.b_c + slope * effort - abs(slope) * inertial
        return max(0.0, float(bound.min()))


def duration_too_short(name: str, requested: float, needed: float) -> Reason:
    """Return the reason for a requested duration that is shorter than the fastest motion."""
    text = (
        f"{name} takes at least {needed:.6g} s within the limits, "
        f"but the requested duration is {requested:.6g} s"
    )
    return Reason(Duration(requested, name), name, needed, requested, text)


def not_constant(name: str, requested: float, feasible: float) -> Reason:
    """Return the reason for a constant tip speed that other limits do not allow.

    `feasible` is the largest speed that they allow, m/s.
    """
    able = (
        f"it can keep up to {1e3 * feasible:.4g} mm/s"
        if feasible
        else "it cannot keep a lower speed either"
    )
    text = (
        f"the tip cannot keep {1e3 * requested:.4g} mm/s between speeding up and slowing down "
        f"({name}); {able}"
    )
    return Reason(ConstantSpeed(feasible or requested), name, requested, feasible, text)


def durations_disagree(requested: float, total: float) -> Reason:
    """Return the reason for a total duration that differs from the sum of all durations."""
    text = (
        f"the durations of the motions add up to {total:.6g} s, "
        f"but the requested total duration is {requested:.6g} s"
    )
    return Reason(Duration(requested, exact=True), "the whole motion", total, requested, text)
