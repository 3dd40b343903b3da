"""Independent check of a trajectory against every limit, with the exact friction law.

The main function is `check`. It does not call the planner. It receives a motion as polynomials in
time, a robot and the limits of a task, and it returns a `Certificate`. Three methods find the worst
value of a limited quantity:

- The extremes of polynomials (position, velocity, acceleration, jerk, motor speed) are computed
  exactly from their Bernstein coefficients (`bernstein`).
- The other quantities are sampled densely, also on both sides of every break (where two polynomials
  meet) and of every reversal of a joint. Intervals between samples that may contain a larger value
  are divided (`sampled_extremes`).
- The RMS torque of a motor is an integral over the motion. It is compared with the continuous
  torque of the motor.

Joints that start from rest or reverse have static friction at that instant.
"""

from dataclasses import replace

import numpy as np

from ssm_planner.dynamics import friction_spread, self_locking_margin
from ssm_planner.kinematics import Mechanism
from ssm_planner.problem import (
    END_VELOCITY_NAMES,
    JUMP_NAMES,
    ContinuousTorque,
    Robot,
    SelfLocking,
    TaskLimits,
)
from ssm_planner.trajectory import PIECES_PER_BLOCK, Trajectory, blocks
from ssm_planner.typing import Array, Indices
from ssm_planner.verification.cases import worst_case_torques
from ssm_planner.verification.certificate import (
    Certificate,
    LimitCheck,
    Unjudged,
    with_seal,
    worst_result_per_limit,
)
from ssm_planner.verification.ends import JumpRecorder, check_end_velocities
from ssm_planner.verification.limits import LimitedQuantity, WorstValue, limited_quantities
from ssm_planner.verification.pieces import piece_blocks, update_polynomial_extremes
from ssm_planner.verification.polylines import check_linear_pieces
from ssm_planner.verification.promises import check_path_promises, unchecked_lines_remark
from ssm_planner.verification.sampled_extremes import SampledExtremes
from ssm_planner.verification.stops import StopMotions, quickest_stops
from ssm_planner.verification.torque_bands import check_torque_bands

SAMPLING_RATE = 10_000.0
"""Default sampling rate of a motion, Hz."""
STOP_SAMPLING_RATE = 1000.0
"""Sampling rate of the controlled stops of a motion, Hz."""
REFINEMENT_INSTANTS = 21
"""Number of additional stops that are computed near the farthest stop."""
MAX_INSTANTS = 3_000_000
"""Largest number of sampling instants. A motion that would need more has a lower sampling rate."""
LINEAR_PIECES_REASON = "not defined on straight pieces (linear interpolation)"
"""Reason why a limit of a table without velocities is not judged."""
NO_TASK_LIMITS = TaskLimits()
"""A task without limits, which is the default of `check`."""


def check(
    trajectory: Trajectory,
    robot: Robot,
    limits: TaskLimits = NO_TASK_LIMITS,
    rate: float = SAMPLING_RATE,
    interpolation: str = "quintic polynomial pieces",
    resolution: Array | None = None,
    seal: bool = False,
) -> Certificate:
    """Check a trajectory against every limit of the robot and the task.

    Motions of any origin can be checked: planned motions, motions that are read from files, and
    controlled stops. A trajectory with linear pieces is called a table below. Its points have
    positions but no velocities.

    Parameters
    ----------
    trajectory : Trajectory
        The motion as polynomials in time.
    robot : Robot
        The robot with its limits, drives and motors.
    limits : TaskLimits
        Limits of the task. The motion must rest at both ends unless the task declares velocities
        there.
    rate : float
        Sampling rate (Hz) where a quantity may be close to its worst value. Elsewhere, a fifth of
        this rate suffices. Every piece has at least four instants.
    interpolation : str
        Description of the pieces, which the certificate repeats.
    resolution : (4,) array, optional
        Largest rounding error of the points of a table (rad, m). The acceleration of a table is
        undefined. None means that the pieces are smooth.
    seal : bool
        True if the certificate gets a seal, that is, a hash of the checked motion, the robot and
        the limits. A plan needs a sealed certificate.

    Returns
    -------
    Certificate
        The worst value of every limit with its joint, time and margin, and the limits that could
        not be judged.

    Raises
    ------
    ProblemError
        If the limits require a range of friction and a drive does not state its uncertainty.
    """
    is_table = resolution is not None
    rate = min(rate, MAX_INSTANTS / trajectory.duration)
    quantities = list(limited_quantities(robot, limits))
    if is_table:
        # The acceleration of linear pieces is undefined, and so are quantities that depend on it.
        quantities = [item for item in quantities if item.limit.order < 2]
    else:
        quantities += worst_case_torques(trajectory, robot, limits)
    jumps = JumpRecorder(robot)
    checks, sampled = _worst_values(trajectory, robot, limits, quantities, rate, jumps=jumps)
    unchecked = _motor_remarks(robot)
    unjudged: list[Unjudged] = []
    if limits.duty is None:
        unchecked.append("continuous torque: it does not limit a motion that is performed once")
    else:
        checks += sampled.rms.results(robot, trajectory, limits.duty)
    if resolution is not None:
        sampled_checks = dict(zip(quantities, checks, strict=True))
        checks, remarks, unjudged = check_linear_pieces(
            trajectory, robot, limits, resolution, sampled_checks
        )
        unchecked += remarks
        dynamic_checks, unjudged_dynamics = _check_table_dynamics(
            trajectory, robot, limits, resolution, rate=rate
        )
        checks += dynamic_checks
        unjudged += unjudged_dynamics
    checks += jumps.results(is_table)
    checks += check_end_velocities(trajectory, robot, limits, is_table)
    checks += _check_self_locking(robot, limits.friction)
    if not is_table:
        checks += _check_stop_travel(trajectory, robot, limits)
    if trajectory.phases:
        mechanism = Mechanism.from_robot(robot)
        for promise in check_path_promises(trajectory, mechanism, limits):
            checks += promise.checks
    elif limits.promising:
        unchecked.append(unchecked_lines_remark(limits))
    certificate = Certificate(
        worst_result_per_limit(checks),
        interpolation,
        sampled.instants,
        tuple(unchecked),
        unjudged=tuple(unjudged),
    )
    return with_seal(certificate, trajectory, robot, limits) if seal else certificate


def _worst_values(
    trajectory: Trajectory,
    robot: Robot,
    limits: TaskLimits,
    quantities: list[LimitedQuantity],
    rate: float,
    jumps: JumpRecorder | None = None,
) -> tuple[list[LimitCheck], SampledExtremes]:
    """Find the worst value of each limited quantity over a motion.

    Parameters
    ----------
    trajectory : Trajectory
        Motion that is checked.
    robot : Robot
        Robot whose limits must hold.
    limits : TaskLimits
        Limits of the task.
    quantities : list of LimitedQuantity
        The quantities to evaluate.
    rate : float
        Sampling rate of the quantities that are not polynomials (`SampledExtremes`), Hz.
    jumps : JumpRecorder, optional
        Object that collects the jumps between consecutive pieces during the same pass.

    Returns
    -------
    checks : list of LimitCheck
        One result for each quantity, in the same order.
    sampled : SampledExtremes
        The completed search, which also provides the number of instants and the RMS torques.
    """
    extremes = [WorstValue(quantity) for quantity in quantities]
    sampled = SampledExtremes(trajectory, robot, extremes, rate=rate, eye=limits.eye)
    for pieces in piece_blocks(trajectory):
        update_polynomial_extremes(pieces, extremes)
        sampled.search(pieces)
        if jumps is not None:
            jumps.update(pieces)
    return [item.to_limit_check() for item in extremes], sampled


def _check_table_dynamics(
    trajectory: Trajectory, robot: Robot, limits: TaskLimits, resolution: Array, *, rate: float
) -> tuple[list[LimitCheck], list[Unjudged]]:
    """Check those limits of a table that depend on the acceleration.

    Pieces that are not linear define an acceleration, so they are checked as usual. If all pieces
    are linear, the points still bound the motor torques (`check_torque_bands`). All other limits
    that depend on the acceleration are not judged.

    Parameters
    ----------
    trajectory : Trajectory
        The table, which may also contain pieces that are not linear.
    robot : Robot
        Robot whose limits must hold.
    limits : TaskLimits
        Limits of the task.
    resolution : (4,) array
        Largest rounding error of a point, rad, and m for joint 4.
    rate : float
        Sampling rate of the pieces that are not linear, Hz.

    Returns
    -------
    checks : list of LimitCheck
        The results of the limits that could be judged.
    unjudged : list of Unjudged
        The limits that the points do not determine, with reasons.
    """
    # A piece is not linear if a coefficient of t² or of a higher power is not 0.
    index_blocks = blocks(len(trajectory.breaks) - 1, PIECES_PER_BLOCK)
    curved = [trajectory.pieces(block)[:, 2:].any(axis=(1, 2)) for block in index_blocks]
    smooth = np.flatnonzero(np.concatenate(curved))
    unjudged: list[Unjudged] = []
    settled_limits: set[tuple[str, str | None]] = set()
    if len(smooth):
        checks = _check_smooth_pieces(trajectory, smooth, robot, limits, rate=rate)
    else:
        checks, unjudged = check_torque_bands(
            trajectory, robot, limits, resolution, LINEAR_PIECES_REASON
        )
        settled_limits.update((item.name, item.joint) for item in checks)
        settled_limits.update((item.name, item.joint) for item in unjudged)
    # A limit of an order above 1 depends on the acceleration. The continuous torque counts only if
    # the motion is repeated (`duty`).
    all_limits = list(limits.limits)
    for joint in robot.joints:
        all_limits += joint.limits
    for limit in all_limits:
        is_limited = limits.duty is not None or type(limit) is not ContinuousTorque
        if limit.order > 1 and is_limited and (limit.name, limit.joint) not in settled_limits:
            unjudged.append(Unjudged(limit.name, limit.joint, LINEAR_PIECES_REASON))
    return checks, unjudged


def _check_smooth_pieces(
    trajectory: Trajectory, index: Indices, robot: Robot, limits: TaskLimits, *, rate: float
) -> list[LimitCheck]:
    """Check accelerations, jerks and torques on the pieces that are not linear.

    These pieces are joined into one motion without the linear pieces. Each quantity depends on one
    piece only, so the gaps between the pieces have no effect.

    Parameters
    ----------
    trajectory : Trajectory
        The motion with all its pieces.
    index : (n,) array
        Indices of the pieces that are not linear.
    robot : Robot
        Robot whose limits must hold.
    limits : TaskLimits
        Limits of the task.
    rate : float
        Sampling rate, Hz.

    Returns
    -------
    list of LimitCheck
        One result for each quantity. Its time refers to `trajectory`.
    """
    lengths = np.diff(trajectory.breaks)[index]
    breaks = np.append(0.0, np.cumsum(lengths))
    smooth_motion = Trajectory(breaks, trajectory.pieces(index), ())
    quantities = [item for item in limited_quantities(robot, limits) if item.limit.order >= 2]
    quantities += worst_case_torques(smooth_motion, robot, limits)
    checks, _ = _worst_values(smooth_motion, robot, limits, quantities, rate)
    times = np.array([item.time for item in checks])
    piece_index = smooth_motion.piece_of(times)
    # The joined motion omits the linear pieces, so its pieces start earlier than the original ones.
    times += trajectory.breaks[index[piece_index]] - breaks[piece_index]
    return [replace(item, time=float(t)) for item, t in zip(checks, times, strict=True)]


def _motor_remarks(robot: Robot) -> list[str]:
    """State for which joints the torque and the speed of the motor are not checked, and why.

    Parameters
    ----------
    robot : Robot
        Robot with the drives and motors of its joints.

    Returns
    -------
    list of str
        One remark for each joint without a drive or without a motor. The certificate repeats it.
    """
    remarks = []
    for joint in robot.joints:
        if joint.drive is None and joint.motor is None:
            reason = "the robot file names no drive and no motor for it"
        elif joint.motor is None:
            reason = "the robot file names no motor for it"
        elif joint.drive is None:
            reason = (
                f"the robot file names no drive for it, so its motor {joint.motor.name} is ignored"
            )
        else:
            continue
        remarks.append(f"motor torque and speed of joint {joint.name}: {reason}")
    return remarks


def _check_self_locking(robot: Robot, confidence: float | None) -> list[LimitCheck]:
    """Check that every drive that must hold its load without power is self-locking.

    A drive is self-locking if its friction angle exceeds its lead angle, so that no load can move
    it. Each drive has a smallest friction coefficient μ_lock at which this is the case. The margin
    of a friction coefficient μ is (μ − μ_lock) / μ_lock.

    Parameters
    ----------
    robot : Robot
        Robot whose limits must hold.
    confidence : float or None
        Confidence level of the friction, such as 0.95. The check uses the smallest coefficient
        within this confidence range if it is below the lowest plausible coefficient of the drive
        (`SelfLocking.friction`). None means the lowest plausible coefficient.

    Returns
    -------
    list of LimitCheck
        One result for each drive with such a limit.
    """
    checks = []
    for joint in robot.joints:
        limit = joint.find_limit(SelfLocking)
        drive = joint.drive
        if limit is None or drive is None:
            continue
        mu = limit.friction
        case = None
        if confidence is not None:
            coefficients = friction_spread(drive).within(confidence).get("mu")
            if coefficients is not None and coefficients.min() < mu:
                mu = float(coefficients.min())
                case = f"mu {mu:.4g}"
        mu_margin = float(self_locking_margin(drive, mu)[0])
        locking_mu = mu - mu_margin
        result = LimitCheck(
            limit.name,
            limit.joint,
            worst=mu,
            limit=locking_mu,
            margin=mu_margin / locking_mu,
            time=0.0,
            unit=limit.unit,
            case=case,
        )
        checks.append(result)
    return checks


def check_stops(
    stops: StopMotions, motion: Trajectory, robot: Robot, limits: TaskLimits
) -> Certificate:
    """Check all controlled stops of a motion together.

    The stops follow one another in one trajectory. This trajectory jumps from the end of a stop to
    the start of the next one, so the result contains no jumps, end velocities and RMS torques. It
    contains no limits on the path of the tip either, because a stop does not complete a motion.

    Parameters
    ----------
    stops : StopMotions
        The stops.
    motion : Trajectory
        The motion from which the stops start. If it always rests, no stop has pieces, and the
        motion itself is checked.
    robot : Robot
        Robot whose limits must hold.
    limits : TaskLimits
        Limits of the task. Its motions and its limit on the stop travel do not apply to stops.

    Returns
    -------
    Certificate
        The worst values over all stops. Times count from the start of the first stop.
    """
    remaining = tuple(limit for limit in limits.limits if limit is not limits.stop_travel)
    limits = replace(limits, limits=remaining, motion=())
    checked_motion = motion if stops.joined is None else stops.joined
    certificate = check(checked_motion, robot, limits, rate=STOP_SAMPLING_RATE)
    excluded = JUMP_NAMES + END_VELOCITY_NAMES + (ContinuousTorque.name,)
    remaining_checks = tuple(item for item in certificate.limits if item.name not in excluded)
    return replace(certificate, limits=remaining_checks)


def _check_stop_travel(motion: Trajectory, robot: Robot, limits: TaskLimits) -> list[LimitCheck]:
    """Check how far the tip travels in the farthest controlled stop.

    The stops start at evenly spaced instants of the motion, and at further instants around the
    farthest of them. A stop is valid only if it keeps the other limits and if the motion ends at
    rest. Otherwise, the check fails: the margin is at most that of the violated limit, or at most
    −1 if the motion does not end at rest.

    Parameters
    ----------
    motion : Trajectory
        Motion that is checked.
    robot : Robot
        Robot whose limits must hold.
    limits : TaskLimits
        Limits of the task.

    Returns
    -------
    list of LimitCheck
        One result. The list is empty if the task does not limit the stop travel.
    """
    limit = limits.stop_travel
    if limit is None:
        return []
    stops = quickest_stops(motion, robot)
    farthest = int(np.argmax(stops.travel))
    # The farthest stop may begin between two of the instants.
    previous = stops.time[max(farthest - 1, 0)]
    following = stops.time[min(farthest + 1, len(stops.time) - 1)]
    closer = quickest_stops(motion, robot, np.linspace(previous, following, REFINEMENT_INSTANTS))
    travel = np.append(stops.travel, closer.travel)
    time = motion.breaks[0] + np.append(stops.time, closer.time)
    worst = int(np.argmax(travel))
    result = LimitCheck.from_extreme(limit, float(travel[worst]), float(time[worst]))
    tightest = check_stops(stops, motion, robot, limits).worst
    if tightest.passed and stops.ends_at_rest:
        return [result]
    reason = f"a stop exceeds {tightest.name} of {tightest.joint or 'the tool'}"
    margin = min(result.margin, tightest.margin)
    if not stops.ends_at_rest:
        reason = "the motion does not end at rest"
        margin = min(margin, -1.0)
    return [replace(result, margin=min(margin, 0.0), case=reason)]
