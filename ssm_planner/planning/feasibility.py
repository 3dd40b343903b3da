"""What stands in the way of a motion, told without a solver: ranges, the eye, end speeds, weak motors, short durations.

`infeasible_place` looks along straight paths and at the points of other motions, `with_boundary_rates` at the speeds with
which all motions begin and end, `motor_too_hot` at the heat of the slowest motion, `no_motion`, where a solver found none,
at what may be the cause.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.dynamics.friction import breakaway_coefficient, friction_coefficient, friction_of
from ssm_planner.dynamics.motors import drive_torque, motorised
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.transmission import breakaway_torque, motor_torque_rows
from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.eye import eye_limits
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import joint_rates, task_from_joints, task_of_joints, task_rates
from ssm_planner.planning.lower_bound import lower_bound
from ssm_planner.planning.phases import Phase, joint_room, straight_path
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.retiming.constraints import braking_travel
from ssm_planner.planning.retiming.paths import JointPath, PathSamples
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.limits import (
    TASK,
    ConstantSpeed,
    ContinuousTorque,
    Duration,
    JointAcceleration,
    JointPosition,
    JointVelocity,
    Limit,
    MotorTorque,
    RetinaClearance,
    TaskRange,
)
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.typing import Array
from ssm_planner.units import shown

SAMPLES = 201
"""Of a path."""
CLOSE = 2001
"""Of a path that takes the place of a free motion beside an eye."""
TOLERANCE = 1e-9
"""Share of a range, or m and shares of the lens, by which a joint or the tip may miss it; of a speed or acceleration."""
AT_POINTS = 1e-6
"""rad or m by which a task coordinate that follows from joints may miss its range; the check of the motion is finer."""


def infeasible_place(
    problem: Problem, mechanism: Mechanism, phases: Sequence[Phase]
) -> Reason | None:
    """The first place that a limit forbids: range of a joint or of a task coordinate, the retina's clearance or the lens."""
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
    """Joints along a straight path, or at the points of another motion, (n, 4)."""
    return phase.points if phase.path is None else phase.path.overview.q


def _where(phase: Phase, k: int, count: int) -> str:
    """Words for sample k of `count` along a phase."""
    if phase.path is None and count == len(phase.points) and 0 < k < count - 1:
        return f"{phase.motion.name}, at point {k} on its way"
    if k in (0, count - 1):
        return f"{phase.motion.name}, at its {'end' if k else 'start'}"
    return f"{phase.motion.name}, {100 * k / (count - 1):.0f} % of the way"


def _beyond_range(problem: Problem, mechanism: Mechanism, phase: Phase, q: Array) -> Reason | None:
    """The first joint or task coordinate that leaves its range, where it does so most.

    Joints along the phase, (n, 4).
    """

    def ranges() -> Iterator[tuple[Limit, str, Array, float]]:
        for i, joint in enumerate(problem.robot.joints):
            tolerance = TOLERANCE * (joint.position[1] - joint.position[0])
            yield (
                joint.limit(JointPosition),
                f"joint {joint.name} would have to reach",
                q[:, i],
                tolerance,
            )
        wrapped, continuous = task_from_joints(mechanism, q), _continuous(mechanism, phase, q)
        for limit in problem.limits:
            if isinstance(limit, TaskRange):
                name = limit.coordinate
                task = (
                    wrapped if limit.high - limit.low >= 2 * np.pi else continuous
                )  # out of all else a turn leads
                yield limit, f"{name} would have to be", task[:, TASK.index(name)], AT_POINTS

    for limit, words, values, tolerance in ranges():
        over = np.maximum(limit.low - values, values - limit.high)
        k = int(np.argmax(over))
        if over[k] > tolerance:
            value, bound, where = (
                float(values[k]),
                limit.bound(float(values[k])),
                _where(phase, k, len(values)),
            )
            unit, scale = shown(limit.unit)
            text = f"{words} {value * scale:.6g} {unit}, its range ends at {bound * scale:.6g} {unit} ({where})"
            return Reason(limit, where, value, bound, text)
    return None


def _continuous(mechanism: Mechanism, phase: Phase, q: Array) -> Array:
    """Task coordinates (n, 4) of the joints along a phase, from its start on without wrapping: a whole turn is one."""
    task = np.stack(task_of_joints(NUMPY, mechanism, q.T), axis=1)
    return np.asarray(
        task + 2 * np.pi * np.round((phase.start - task[0]) / (2 * np.pi)) * (1, 0, 1, 0)
    )


def _past_boundary(problem: Problem, mechanism: Mechanism, phase: Phase) -> Reason | None:
    """A free motion on which joint 2 has to turn past the workspace boundary, where tilt is out of its range.

    Tilt follows joint 2 alone, and its extremes are where the branches of the inverse kinematics meet, at δ + k π: between
    two points that lie on either side of one, every motion passes it.
    """
    limit = next(
        (each for each in problem.limits if each.key == (TaskRange.name_of("tilt"), None)), None
    )
    if phase.path is not None or limit is None:
        return None
    name, (unit, scale) = problem.robot.joints[1].name, shown("rad")
    for k, (first, last) in enumerate(pairwise(phase.points)):
        low, high = sorted((float(first[1]), float(last[1])))
        turns = np.arange(
            np.ceil((low - mechanism.delta) / np.pi), (high - mechanism.delta) / np.pi
        )
        if not len(turns):
            continue
        there = np.tile(first, (len(turns), 1))
        there[:, 1] = mechanism.delta + np.pi * turns
        tilts = task_from_joints(mechanism, there)[:, 1]
        over = np.maximum(limit.low - tilts, tilts - limit.high)
        tilt = float(tilts[np.argmax(over)])
        if over.max() > AT_POINTS:
            where = f"{phase.motion.name}, between its points {k} and {k + 1}"
            text = (
                f"joint {name} passes the workspace boundary between {low * scale:.6g} {unit} and {high * scale:.6g} {unit}, "
                f"where tilt is {tilt * scale:.6g} {unit}; its range ends at {limit.bound(tilt) * scale:.6g} {unit}"
            )
            return Reason(limit, where, tilt, limit.bound(tilt), f"{text} ({where})")
    return None


def blocked_by_eye(problem: Problem, mechanism: Mechanism, phase: Phase, q: Array) -> Reason | None:
    """The retina or the lens where one of these samples (n, 4) comes too near, where it does so most."""
    if problem.eye is None:
        return None
    values = eye_limits(NUMPY, problem.eye, tip_position(mechanism, q).T)
    for each in problem.eye.limits:
        value, least = values[each.name]
        k = int(np.argmin(value))
        found = float(value[k])
        if found >= least - TOLERANCE:
            continue
        where = _where(phase, k, len(q))
        if isinstance(each, RetinaClearance):
            text = f"the tip would come within {1e3 * found:.4g} mm of the retina, the clearance is {1e3 * least:.4g} mm"
        else:
            text = f"the shaft would touch the lens: {found:.4g} of its size from its centre, at least {least:.4g} is free"
        return Reason(each, where, least, found, f"{text} ({where})")
    return None


def nearest_to_eye(problem: Problem, path: JointPath) -> Array:
    """Where a path comes nearest to retina or lens, or goes farthest through them: joints, (4,)."""
    q = path.overview.q
    values = (
        []
        if problem.eye is None
        else eye_limits(NUMPY, problem.eye, tip_position(path.mechanism, q).T).values()
    )
    room = np.min(
        [value / least for value, least in values if least > 0] or np.zeros((1, len(q))), axis=0
    )
    return np.asarray(q[int(np.argmin(room))])


def straight_instead(problem: Problem, mechanism: Mechanism, phase: Phase) -> Phase | None:
    """A free phase from rest to rest, straight in task coordinates; None where it cannot be, or a limit forbids a place."""
    # whether the line in task coordinates is another one than that in the joints
    ways_differ = np.abs((phase.end - phase.start)[:2]).max() > TOLERANCE
    if len(phase.points) != 2 or phase.qd_start.any() or phase.qd_end.any() or not ways_differ:
        return None
    first, last = phase.points
    path = straight_path(problem, mechanism, phase.start, phase.end, first)
    if np.abs(path.sample(np.array([1.0])).q[0] - last).max() > TOLERANCE:
        return None
    straight = replace(phase, path=path)
    if infeasible_place(problem, mechanism, (straight,)) is not None or _grazes_eye(problem, path):
        return None
    return straight


def _grazes_eye(problem: Problem, path: JointPath) -> bool:
    """Whether a path comes too near to retina or lens between its samples: at the port the distance has a sharp corner."""
    if problem.eye is None:
        return False
    for name in (limit.name for limit in problem.eye.limits):
        s = np.linspace(0.0, 1.0, CLOSE)
        for _ in range(2):
            values, least = eye_limits(
                NUMPY, problem.eye, tip_position(path.mechanism, path.sample(s).q).T
            )[name]
            k = int(np.argmin(values))
            if values[k] < least - TOLERANCE:
                return True
            s = np.linspace(s[max(k - 1, 0)], s[min(k + 1, len(s) - 1)], SAMPLES)
    return False


def with_boundary_rates(
    problem: Problem, mechanism: Mechanism, phases: tuple[Phase, ...]
) -> tuple[tuple[Phase, ...], Reason | None]:
    """The phases with q̇ at the start of the first and the end of the last, or the reason why they cannot have them.

    Raises ProblemError where a straight motion would leave its line.
    """
    # a motion to where the robot already is takes no time, so the rates are those of its neighbours
    lasting = [
        k for k, phase in enumerate(phases) if phase.motion.duration is not None or not phase.stands
    ]
    for k, key in ((lasting[0], "start_rate"), (lasting[-1], "end_rate")):
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
    """A phase with q̇ at one end, from the task rates that the problem asks for there; key: start_rate or end_rate."""
    at_start = key == "start_rate"
    asked = problem.start_rate if at_start else problem.end_rate
    rate = np.array([asked.get(name, 0.0) for name in TASK])
    if not rate.any():
        return phase, None
    if phase.stands:
        raise ProblemError(
            "a dwell has no speed", file=problem.file, line=phase.motion.line, key=key
        )
    if phase.path is not None:
        _refuse_off_line(problem, mechanism, phase, key, rate)
    qd = joint_rates(mechanism, phase.points[0 if at_start else -1], rate)
    qd[np.abs(qd) < TOLERANCE * np.array([joint.velocity for joint in problem.robot.joints])] = 0.0
    reason = _too_fast(problem, mechanism, (phase, key), qd)
    return replace(phase, qd_start=qd) if at_start else replace(phase, qd_end=qd), reason


def _refuse_off_line(
    problem: Problem, mechanism: Mechanism, phase: Phase, key: str, rate: Array
) -> None:
    """ProblemError for task rates (4,) that do not point along a path at the end where they are asked for."""
    assert phase.path is not None
    at = phase.path.sample(np.array([0.0 if key == "start_rate" else 1.0]))
    way = task_rates(mechanism, at.q, at.dq)[0]
    along = way * (way @ rate) / (way @ way)
    if way @ rate < 0 or np.abs(rate - along).max() > 1e-9 * np.abs(rate).max():
        raise ProblemError(
            f"a straight motion ({phase.motion.name}) keeps to its line, from its start to its target",
            file=problem.file,
            key=key,
            allowed="rates of the coordinates that the motion changes, in their ratio, and in its direction",
        )


def _too_fast(
    problem: Problem, mechanism: Mechanism, end: tuple[Phase, str], qd: Array
) -> Reason | None:
    """A joint faster than its limit; a tip that takes too far to stop."""
    phase, key = end
    place = f"{phase.motion.name}, {key.replace('_', ' ')}"
    for i, joint in enumerate(problem.robot.joints):
        limit = joint.limit(JointVelocity)
        unit, scale = shown(limit.unit)
        if abs(qd[i]) > joint.velocity * (1 + TOLERANCE):
            text = (
                f"joint {joint.name} would move at {scale * abs(qd[i]):.4g} {unit}, its limit is "
                f"{scale * limit.largest:.4g} {unit} ({place})"
            )
            return Reason(limit, place, float(abs(qd[i])), limit.largest, text)
    return _too_far_to_stop(
        problem, mechanism, phase.points[0 if key == "start_rate" else -1], qd, place
    )


def _too_far_to_stop(
    problem: Problem, mechanism: Mechanism, q: Array, qd: Array, place: str
) -> Reason | None:
    """Rates from which the tip travels too far until it can stand."""
    limit = problem.stop_travel
    if limit is None:
        return None
    travel = float(braking_travel(mechanism, problem.robot, q[None], qd[None])[0])
    if travel <= limit.largest * (1 + TOLERANCE):
        return None
    text = f"the tip needs {1e3 * travel:.4g} mm to stop, {1e3 * limit.largest:.4g} mm are allowed ({place})"
    return Reason(limit, place, travel, limit.largest, text)


def _too_near(problem: Problem, mechanism: Mechanism, phase: Phase) -> Reason | None:
    """A joint whose way is too short for its change of speed: |q̇₁² − q̇₀²| = 2 q̈ way at least needs more than q̈_max.

    A free motion overshoots, and needs the range to do so.
    """
    if phase.path is None:
        return _beyond_room(problem, mechanism, phase)
    if not (phase.qd_start.any() or phase.qd_end.any()):
        return None
    q = _joints(phase)
    for i, joint in enumerate(problem.robot.joints):
        first, last = float(phase.qd_start[i]), float(phase.qd_end[i])
        way = float(np.abs(np.diff(q[:, i])).sum())
        needed = abs(first**2 - last**2) / (2 * way) if way > 0 else 0.0
        if needed > joint.acceleration * (1 + TOLERANCE):
            unit, scale = shown(joint.limit(JointPosition).unit)
            text = (
                f"joint {joint.name} has {scale * way:.4g} {unit} to go from {scale * abs(first):.4g} to "
                f"{scale * abs(last):.4g} {unit}/s: that takes {scale * needed:.4g} {unit}/s², its limit is "
                f"{scale * joint.acceleration:.4g} {unit}/s² ({phase.motion.name})"
            )
            return Reason(
                joint.limit(JointAcceleration), phase.motion.name, needed, joint.acceleration, text
            )
    return None


def _beyond_room(problem: Problem, mechanism: Mechanism, phase: Phase) -> Reason | None:
    """A joint that leaves its range, or that of tilt or depth, before it can stand, or has to come from beyond it."""
    room = joint_room(problem, mechanism, phase.points)
    ends = (
        (phase.qd_start, 0, 1.0, "cannot stop before reaching"),
        (phase.qd_end, -1, -1.0, "would have to come from"),
    )
    for (qd, side, sign, words), (i, joint) in product(ends, enumerate(problem.robot.joints)):
        there = phase.points[side].copy()
        there[i] += sign * qd[i] * abs(qd[i]) / (2 * joint.acceleration)
        if room[0, i] - AT_POINTS <= there[i] <= room[1, i] + AT_POINTS:
            continue
        limit: Limit = joint.limit(JointPosition)
        value, name = float(there[i]), f"joint {joint.name}"
        if (
            limit.low <= value <= limit.high
        ):  # the range of the task coordinate that follows this joint alone
            name = {1: "tilt", 3: "depth"}[i]
            limit = next(
                each for each in problem.limits if each.key == (TaskRange.name_of(name), None)
            )
            value = float(task_from_joints(mechanism, there[None])[0, TASK.index(name)])
        unit, scale = shown(limit.unit)
        text = (
            f"{name} {words} {scale * value:.6g} {unit}, joint {joint.name} moving at {scale * abs(qd[i]):.4g} {unit}/s with "
            f"{scale * joint.acceleration:.4g} {unit}/s² at most; its range ends at {scale * limit.bound(value):.6g} {unit} "
            f"({phase.motion.name})"
        )
        return Reason(limit, phase.motion.name, value, limit.bound(value), text)
    return None


def no_motion(problem: Problem, phase: Phase, path: JointPath, message: str) -> Reason:
    """What stands in the way along a path: a motor that is too weak, or the eye; the solver's word where nothing does."""
    reason = motor_too_weak(problem, phase, path, SAMPLES)
    if reason is not None:
        return reason
    blocked = blocked_by_eye(problem, path.mechanism, phase, path.overview.q)
    if blocked is not None:
        text = f"{blocked.message}; no way around it was found ({message})"
        return replace(blocked, message=text)
    text = f"{phase.motion.name}: no motion found ({message})"
    return Reason(None, phase.motion.name, None, None, text)


def motor_too_weak(
    problem: Problem, phase: Phase, path: JointPath, samples: int = 0
) -> Reason | None:
    """The motor that is most too weak at the knots of a path or, with `samples`, between them too.

    A motor too weak at the knots of a free motion's path is so whatever way the motion takes between them.
    """
    knots, _ = path.directions
    s = np.union1d(np.linspace(0.0, 1.0, samples), knots)
    gravity = RigidBody.from_robot(problem.robot).gravity_load(path.sample(s).q)
    weakest: tuple[float, Reason] | None = None
    for i, drive, motor in motorised(problem.robot.joints):
        needed = _starting_torque(path, i, drive, s, gravity[:, i])
        k = int(np.argmax(needed))
        joint, available = problem.robot.joints[i], motor.max_torque
        ratio = float(needed[k] / available)
        if ratio > 1 and (weakest is None or ratio > weakest[0]):
            place = f"{phase.motion.name}, {100 * s[k]:.0f} % of the way"
            text = (
                f"motor of joint {joint.name} is too weak to move at all: against gravity and friction it needs "
                f"{1e3 * needed[k]:.4g} mN·m and has {1e3 * available:.4g} mN·m ({place})"
            )
            weakest = (
                ratio,
                Reason(joint.limit(MotorTorque), place, float(needed[k]), available, text),
            )
    return None if weakest is None else weakest[1]


def motor_too_weak_to_brake(problem: Problem, phase: Phase) -> Reason | None:
    """The motor that is too weak at the speed with which a phase begins, whatever the accelerations within their limits.

    Where the load resists, a motor that cannot hold the speed must brake harder than its joint may. The torque in the
    direction of motion is convex in the effort, the effort linear in the accelerations; its least is bounded on a grid.
    """
    robot, qd = problem.robot, phase.qd_start
    most = np.array([joint.acceleration for joint in robot.joints])
    pulls = np.vstack([np.zeros(4), np.diag(most)])
    load = RigidBody.from_robot(robot).inverse_dynamics(
        np.tile(phase.q_start, (5, 1)), np.tile(qd, (5, 1)), pulls
    )
    for i, drive, motor in motorised(robot.joints):
        sign = float(np.sign(qd[i]))
        if not sign:
            continue
        reach = float(np.abs(load[1:, i] - load[0, i]).sum())
        efforts = np.linspace(load[0, i] - reach, load[0, i] + reach, SAMPLES)
        law, _ = drive_torque(drive, efforts, qd[i], -sign * most[i], sign, breakaway=False)
        torque = sign * np.asarray(law)
        needed = float(torque.min() - np.abs(np.diff(torque)).max())
        if needed > motor.max_torque:
            joint, place = robot.joints[i], f"{phase.motion.name}, at its start"
            text = (
                f"motor of joint {joint.name} is too weak for the speed at the start: even braking as hard as the joint may "
                f"it needs {1e3 * needed:.4g} mN·m and has {1e3 * motor.max_torque:.4g} mN·m ({place})"
            )
            return Reason(joint.limit(MotorTorque), place, needed, motor.max_torque, text)
    return None


def _starting_torque(path: JointPath, i: int, drive: Drive, s: Array, gravity: Array) -> Array:
    """Motor torque (n,) that joint i needs for endlessly slow motion at s (n,), against gravity's effort (n,), N·m.

    The joint breaks away where it starts or turns back; elsewhere friction is that of slow motion.
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
    # at a knot the joint has to come, and to leave
    before, after = (
        np.clip(np.searchsorted(knots, s, side=side) - 1, 0, len(sign) - 1)
        for side in ("left", "right")
    )
    torques = [
        np.abs(breakaway_torque(drive, gravity, sign[k], mu)) * np.abs(sign[k])
        for k in (before, after)
    ]
    return np.maximum(*torques)


def motor_too_hot(problem: Problem, phases: Sequence[Phase]) -> Reason | None:
    """The motor whose continuous torque no motion keeps, however slowly it runs; None where that is not certain.

    In a straight phase from rest to rest that moves a joint one way, the mean of its motor torque is at least a
    (`_SlowMotion`), so the mean square is at least a². Over phases of durations T_k, of which a joint stands in
    those that have a = 0, and a pause P: RMS² ≥ Σ a_k² T_k / (Σ T_k + P). In each T_k that is monotone, so the least is at an
    end: with every T_k at its lower bound, or with one of them infinite. A phase without a duration asked for that the joint
    may stand in allows any RMS. Stribeck friction counts at its least, ripple not at all.
    """
    pause, robot = problem.duty, problem.robot
    if pause is None:
        return None
    worst: tuple[float, Reason] | None = None
    bounds = [phase.motion.duration or lower_bound(robot, phase.points) for phase in phases]
    slow = [_SlowMotion.along(robot, phase) for phase in phases]
    for i, drive, motor in motorised(robot.joints):
        moving = rest = 0.0
        slowest = np.inf
        for phase, least, motion in zip(phases, bounds, slow, strict=True):
            mean = 0.0 if motion is None else motion.least_mean_torque(i, drive)
            asked = phase.motion.duration
            moving, rest = moving + mean**2 * least, rest + least
            slowest = slowest if asked else min(slowest, mean)
        needed = min(slowest, math.sqrt(moving / (rest + pause)))
        if needed > motor.nominal_torque * (1 + TOLERANCE) and (
            worst is None or needed / motor.nominal_torque > worst[0]
        ):
            joint = robot.joints[i]
            text = (
                f"the motor of joint {joint.name} would run at an RMS torque of at least {1e3 * needed:.4g} mN·m however "
                "slowly it moves, against friction and load alone; it may do "
                f"{1e3 * motor.nominal_torque:.4g} mN·m for all time"
            )
            reason = Reason(joint.limit(ContinuousTorque), None, needed, motor.nominal_torque, text)
            worst = needed / motor.nominal_torque, reason
    return None if worst is None else worst[1]


@dataclass(frozen=True, eq=False)
class _SlowMotion:
    """A straight phase from rest to rest, n samples of it."""

    way: PathSamples
    signs: Array
    """Of the joints' motion between turning points, (k, 4)."""
    load: tuple[Array, Array, Array]
    """A, B, C of τ_rigid = A s̈ + B ṡ² + C, (n, 4) each."""
    fastest: Array
    """Largest ṡ that the joints' velocities allow, (n,)."""

    @classmethod
    def along(cls, robot: Robot, phase: Phase) -> _SlowMotion | None:
        """Of a phase; None where it is not straight, or begins or ends at speed."""
        if phase.path is None or phase.qd_start.any() or phase.qd_end.any():
            return None
        way = phase.path.overview
        load = RigidBody.from_robot(robot).path_load(way.q, way.dq, way.ddq)
        velocity = np.array([joint.velocity for joint in robot.joints])
        fastest = np.min(velocity / np.maximum(np.abs(way.dq), 1e-12), axis=1)
        return cls(way, phase.path.directions[1], load, fastest)

    def least_mean_torque(self, i: int, drive: Drive) -> float:
        """A torque, N·m, that the mean of motor i's does not fall below; 0 where the joint may stand or turn back.

        The load's share of the torque is the larger of two lines in F, so it is above c F of any slope c between theirs;
        here c is that of slow motion. Of F = A s̈ + B ṡ² + C the mean over a motion from rest to rest is that of
        (B − A') ṡ² + C, of all other inertia 0, and ṡ is at most what the joints' velocities allow.
        """
        signs = np.unique(self.signs[:, i])
        if drive.kind == "antibacklash_screw" or len(signs) != 1 or signs[0] == 0:
            return 0.0
        sign, way, fastest, friction = float(signs[0]), self.way, self.fastest, friction_of(drive)
        inertia, speed, static = (each[:, i] for each in self.load)
        viscous = friction.b_ov * np.abs(way.dq[:, i]) * fastest
        inertial = np.abs(speed - np.gradient(inertia, way.s)) * fastest**2 + viscous
        # in the direction of motion the torque is b_c + max(up E, down E)
        effort = sign * static + friction.b_oc
        up, down = (
            float(slope) for slope in motor_torque_rows(drive, int(sign), friction.mu).slope
        )
        slope = up if effort.min() > 0 else down if effort.max() < 0 else min(max(0.0, down), up)
        least = friction.b_c + slope * effort - abs(slope) * inertial
        return max(0.0, float(least.min()))


def duration_too_short(name: str, asked: float, needed: float) -> Reason:
    """A duration asked for that is shorter than the fastest motion."""
    text = f"{name} takes at least {needed:.6g} s within the limits; {asked:.6g} s were asked for"
    return Reason(Duration(asked, name), name, needed, asked, text)


def not_constant(name: str, asked: float, largest: float) -> Reason:
    """A constant speed of the tip, m/s, that other limits do not allow all along a curve; largest: one that they do."""
    able = (
        f"it can keep up to {1e3 * largest:.4g} mm/s"
        if largest
        else "nor can it keep a slower speed"
    )
    text = f"the tip cannot keep {1e3 * asked:.4g} mm/s between getting up to speed and slowing down ({name}); {able}"
    return Reason(ConstantSpeed(largest or asked), name, asked, largest, text)


def durations_disagree(asked: float, fixed: float) -> Reason:
    """A duration of the whole, where every motion has one of its own and they add up to another."""
    text = f"the motions have durations of their own, {fixed:.6g} s in all; {asked:.6g} s were asked for the whole"
    return Reason(Duration(asked, exact=True), "the whole motion", fixed, asked, text)
