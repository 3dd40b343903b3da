"""Tests that reject motors with which no motion is possible.

Such a motor is too weak to move, to brake or to hold a speed, or every motion makes it too hot. The
tests are much cheaper than a solver, and they name the motor. Each of them returns a `Reason`, or
None if a motion may exist. `explain_failure` looks for the cause after a solver has not found a
motion.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import compress
from operator import itemgetter

import numpy as np

from ssm_planner.dynamics import (
    RigidBody,
    breakaway_coefficient,
    breakaway_torque,
    drive_torque,
    friction_coefficient,
    motor_torque_rows,
    motorised_joints,
    required_friction,
)
from ssm_planner.planning.feasibility import check_eye_clearance, feasible_phases
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.reason import Reason, check_limit
from ssm_planner.planning.retiming.constraints import PathLimits
from ssm_planner.planning.retiming.paths import JointPath, joint_starts
from ssm_planner.planning.tolerances import PATH_SAMPLES
from ssm_planner.problem import ContinuousTorque, Drive, MotorTorque, Problem, Robot


def explain_failure(phase: Phase, path: JointPath, message: str) -> Reason:
    """Return the reason why a solver found no motion of a phase.

    The reason names a motor that is too weak somewhere on the path, or a place that the eye
    forbids. Otherwise, the reason contains only the solver's message.

    Parameters
    ----------
    phase : Phase
        Entry of the motion list with its problem and joint positions.
    path : JointPath
        The path that the solver tried. For a free motion, straight lines between its points.
    message : str
        Message of the solver.

    Returns
    -------
    Reason
        The cause. Its field `limit` is None if only the solver's message is known.
    """
    reason = check_motor_torque(phase, path, PATH_SAMPLES)
    if reason is not None:
        return reason
    blocked = check_eye_clearance(replace(phase, path=path))
    if blocked is not None:
        text = f"{blocked.message}, so the direct motion is blocked ({message})"
        return replace(blocked, message=text)
    text = f"{phase.motion.name}: no motion found ({message})"
    return Reason(None, phase.motion.name, None, None, text)


def _most_overloaded_motor(
    robot: Robot,
    kind: type[MotorTorque | ContinuousTorque],
    needs: Iterable[tuple[int, float, str | None]],
    template: str,
) -> Reason | None:
    """Return a reason for the motor that exceeds its limit by the largest factor.

    Returns None if no motor exceeds its limit.

    Parameters
    ----------
    robot : Robot
        The robot with its motors.
    kind : type of Limit
        Kind of the limit: the largest or the continuous torque.
    needs : iterable of (int, float, str or None)
        For each motor the index of its joint, the torque in N·m that it needs, and the place on the
        motion. None instead of the place stands for the whole motion. Lower bounds on a torque may
        be negative, and then give no reason.
    template : str
        Continuation of the message after the name of the joint, with the fields {value} and
        {bound}.

    Returns
    -------
    Reason or None
        The limit and the place, with the needed and the available torque.
    """
    overloads: list[tuple[float, Reason]] = []
    for i, needed, location in needs:
        limit = robot.joints[i].limit(kind)
        text = f"the motor of joint {robot.joints[i].name} {template}"
        reason = check_limit(limit, needed, location, text)
        if reason is not None and needed > 0:
            overloads.append((needed / limit.largest, reason))
    return max(overloads, key=itemgetter(0), default=(0.0, None))[1]


def check_motor_torque(phase: Phase, path: JointPath, samples: int = 0) -> Reason | None:
    """Return a reason if a motor cannot move its joint against gravity and friction, or None.

    The needed torque is that of a motion so slow that inertia and viscous friction vanish. Friction
    is static where the joint starts or reverses, and that of slow motion elsewhere. The test covers
    the knots of the path (the ends and all reversals) and evenly spaced points. A motor that is too
    weak at the ends of a free motion is too weak on every path between them.

    Parameters
    ----------
    phase : Phase
        Entry of the motion list with its problem and joint positions.
    path : JointPath
        Path of the phase, or a path that stands for a free motion between the same points.
    samples : int
        Number of evenly spaced points. With 0, only the knots are tested.

    Returns
    -------
    Reason or None
        None if every motor is strong enough at all places that are tested.
    """
    knots, signs = path.directions
    places = path.sample(np.union1d(np.linspace(0.0, 1.0, samples), knots))
    robot = phase.problem.robot
    gravity = RigidBody.from_robot(robot).gravity_load(places.q)
    starts = joint_starts(places, knots, signs)
    # Directions of the joints at all places. At a knot, they are those before it ("left") and those
    # behind it ("right"), because the motor must move the joint in both directions.
    directions = [
        signs[np.clip(np.searchsorted(knots, places.s, side=side) - 1, 0, len(signs) - 1)]
        for side in ("left", "right")
    ]

    def needs() -> Iterator[tuple[int, float, str]]:
        """Yield the index of each joint, the torque (N·m) that its motor needs, and the place."""
        for i, drive, _ in motorised_joints(robot.joints):
            friction = required_friction(drive)
            slow_mu = np.asarray(friction_coefficient(friction, 0.0))
            mu = np.where(starts[:, i], breakaway_coefficient(friction), slow_mu)
            # The factor 0 of a joint at rest removes its torque.
            torque = np.max(
                [
                    np.abs(sign * breakaway_torque(drive, gravity[:, i], sign, mu))
                    for sign in (direction[:, i] for direction in directions)
                ],
                axis=0,
            )
            k = int(np.argmax(torque))
            yield i, float(torque[k]), f"{phase.motion.name}, {100 * places.s[k]:.0f} % of the way"

    # On a free motion, other joints may move first and relieve the motor, so the message only
    # concerns the present positions of the other joints.
    task = "move at all" if phase.path is path else "move with the other joints there"
    return _most_overloaded_motor(
        robot,
        MotorTorque,
        needs(),
        f"is too weak to {task}: against gravity and friction it needs {{value}}, but it has only "
        "{bound}",
    )


def check_braking_torque(phase: Phase) -> Reason | None:
    """Return a reason if a motor is too weak for the velocity at which a phase begins, or None.

    The motor is too weak if every joint acceleration within the limits needs more than its largest
    torque. For example, a motor that cannot hold the velocity against a load that resists the
    motion would let the joint slow down harder than its limit allows.

    The needed torque is bounded from below. Let the effort be the torque or force at the output of
    the drive. The motor torque in the direction of motion is convex in the effort, and the effort
    is linear in the joint accelerations. On a grid of efforts, the smallest torque minus the
    largest step between neighbours is therefore a lower bound.

    Parameters
    ----------
    phase : Phase
        A free phase (entry of the motion list without a given path) with joint velocities at its
        start.

    Returns
    -------
    Reason or None
        None if the phase begins at rest, or if a motion may exist.
    """
    robot, qd = phase.problem.robot, phase.qd_start
    if not qd.any():
        return None
    deceleration_limits = robot.accelerations
    # Row 0 is for no acceleration, and row 1 + j for the largest acceleration of joint j alone.
    accelerations = np.vstack([np.zeros(4), np.diag(deceleration_limits)])
    load = RigidBody.from_robot(robot).inverse_dynamics(
        np.tile(phase.q_start, (5, 1)), np.tile(qd, (5, 1)), accelerations
    )
    # The efforts at all accelerations within the limits lie within load[0] ± reach.
    reach = np.abs(load[1:] - load[0]).sum(axis=0)

    def needs() -> Iterator[tuple[int, float, str]]:
        """Yield the index of each moving joint, a lower bound on its torque (N·m) and the place."""
        for i, drive, _ in motorised_joints(robot.joints):
            sign = float(np.sign(qd[i]))
            if sign:
                # The drive's own inertia needs the least torque at the largest deceleration.
                efforts = load[0, i] + np.linspace(-reach[i], reach[i], PATH_SAMPLES)
                motor_torque, _ = drive_torque(
                    drive, efforts, qd[i], -sign * deceleration_limits[i], sign, breakaway=False
                )
                torque = sign * np.asarray(motor_torque)
                needed = float(torque.min() - np.abs(np.diff(torque)).max())
                yield i, needed, f"{phase.motion.name}, at its start"

    return _most_overloaded_motor(
        robot,
        MotorTorque,
        needs(),
        "is too weak for the speed at the start: even at the largest deceleration of the joint it "
        "needs {value}, but it has only {bound}",
    )


def check_motor_heat(phases: Sequence[Phase]) -> Reason | None:
    """Return a reason if every motion of the phases exceeds a motor's continuous torque, or None.

    Consider a phase along a given path from rest to rest in which a joint moves in one direction.
    The mean torque of its motor is at least a (`_least_mean_torque`), so the mean square is at
    least a². In all other phases a = 0. For phases of durations T_k and a pause P,

        RMS² ≥ Σ a_k² T_k / (Σ T_k + P).

    The right side is monotone in each T_k. Its minimum therefore has all T_k at their lower bounds,
    or one of them infinite. Stribeck friction is taken at its smallest, and torque ripple is left
    out, so the bound stays below the true RMS torque.

    Parameters
    ----------
    phases : sequence of Phase
        All phases (entries of the motion list) of a problem. Its key `duty` gives the pause before
        the motion repeats.

    Returns
    -------
    Reason or None
        None if the motion does not repeat, or if a slower motion may suffice.
    """
    problem = phases[0].problem
    pause, robot = problem.duty, problem.robot
    if pause is None:
        return None
    least_durations = [phase.motion.duration or phase.lower_bound for phase in phases]
    has_free_duration = [not phase.motion.duration for phase in phases]
    limits = [
        PathLimits.on_grid(phase.path, phase.path.coarse_samples.s, robot, problem.task_limits)
        if phase.path is not None and phase.begins_and_ends_at_rest
        else None
        for phase in phases
    ]

    def needs() -> Iterator[tuple[int, float, None]]:
        """Yield the index of each joint, a lower bound on its RMS torque (N·m), and no place."""
        for i, drive, _ in motorised_joints(robot.joints):
            means = [_least_mean_torque(along, i, drive) if along else 0.0 for along in limits]
            mean_square = np.square(means) @ least_durations / (sum(least_durations) + pause)
            # All durations are at their lower bounds, or a free duration is infinite.
            yield i, min([math.sqrt(mean_square), *compress(means, has_free_duration)]), None

    return _most_overloaded_motor(
        robot,
        ContinuousTorque,
        needs(),
        "would run at an RMS torque of at least {value}, however slowly it moves, because of "
        "friction and load alone; its continuous torque is {bound}",
    )


def check_thermal_bound(problem: Problem) -> Reason | None:
    """Return a reason if every motion of a problem exceeds a motor's continuous torque, or None.

    No motion is planned. None means that a slower motion may suffice, that the motion does not
    repeat, or that the problem has no feasible phases (entries of the motion list).
    """
    phases, reason = feasible_phases(problem)
    return None if reason is not None else check_motor_heat(phases)


def _least_mean_torque(along: PathLimits, i: int, drive: Drive) -> float:
    """Return a lower bound on the mean torque of a motor over a motion from rest to rest, N·m.

    The motion follows a path q(s) with the path parameter s. The bound holds for any speed
    ṡ = ds/dt within the speed limits.
    The torque in the direction of motion is the larger of two linear functions of the effort F,
    that is, the torque or force at the output of the drive. It is therefore at least c F for every
    slope c between the slopes of the two functions. Integration by parts over a motion from rest to
    rest replaces the unknown s̈. With primes for derivatives with respect to s,

        F = A s̈ + B ṡ² + C,   mean of F = mean of (B − A') ṡ² + C.

    Parameters
    ----------
    along : PathLimits
        Loads and limits at n points of the path.
    i : int
        Index of the joint.
    drive : Drive
        Its drive.

    Returns
    -------
    float
        The bound. 0 if the joint rests or reverses, or if the drive has two nuts.
    """
    signs = np.unique(along.directions[:, i])
    if drive.two_nuts or len(signs) != 1 or signs[0] == 0:
        return 0.0
    friction = required_friction(drive)
    inertia, square_term, static_term = (term[:, i] for term in along.loads[0])
    # Largest magnitudes of the effort of viscous friction and of the term with ṡ².
    viscous = friction.b_ov * np.abs(along.samples.dq[:, i]) * np.sqrt(along.ceiling)
    varying = np.abs(square_term - np.gradient(inertia, along.samples.s)) * along.ceiling
    # In the direction of motion the torque is b_c + max(raising · F, lowering · F).
    effort = signs[0] * static_term + friction.b_oc
    raising, lowering = motor_torque_rows(drive, int(signs[0]), friction.mu).slope
    # Three admissible slopes c, (3, 1). The best of the three bounds is the result.
    slopes = np.array([raising, lowering, np.clip(0.0, lowering, raising)])[:, None]
    bounds = friction.b_c + slopes * effort - np.abs(slopes) * (varying + viscous)
    return max(0.0, float(bounds.min(axis=1).max()))
