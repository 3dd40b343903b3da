"""Independent check of a trajectory against every limit, with the exact friction law.

The check knows nothing about the planner. It receives polynomials in time, a robot and the limits
of a task. Three methods find the worst value of a quantity:

- The extremes of polynomials (position, velocity, acceleration, jerk, motor speed) are computed
  exactly from their Bernstein coefficients (`bernstein`).
- The other quantities are sampled densely, on both sides of every break and of every reversal.
  Intervals that may contain a larger value are divided (`sampled_extremes`).
- The RMS torque of a motor is an integral over the motion. It is compared with the continuous
  torque of the motor.

Joints that start from rest or reverse have static friction at that instant.
"""

from dataclasses import replace

import numpy as np

from ssm_planner.dynamics import self_locking_margin, spread_of
from ssm_planner.kinematics import Mechanism
from ssm_planner.problem import (
    END_VELOCITY_NAMES,
    JUMP_NAMES,
    ContinuousTorque,
    Joint,
    Robot,
    SelfLocking,
    TaskLimits,
)
from ssm_planner.trajectory import BLOCK, Trajectory, blocks
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
STOP_SAMPLING_RATE = 1000.0
"""Sampling rates in Hz, of a motion and of the stops of a motion."""
REFINEMENT_INSTANTS = 21
"""Number of instants around the farthest stop that are evaluated again."""
MAX_INSTANTS = 3_000_000
"""Largest number of instants of the first pass.

Longer trajectories are sampled at a lower rate first.
"""
LINEAR_PIECES_REASON = "not defined on straight pieces (linear interpolation)"
"""Reason why a limit of a table without velocities is not judged."""
NO_TASK_LIMITS = TaskLimits()
"""A task that limits nothing, which is the default."""


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

    Parameters
    ----------
    trajectory : Trajectory
        The motion as polynomials in time.
    robot : Robot
        The robot with its limits, drives and motors.
    limits : TaskLimits
        Limits of the task. The motion must rest at both ends unless these declare end rates.
    rate : float
        Sampling rate of the second pass in Hz. The first pass has a fifth of it, and at least
        four instants in every piece.
    interpolation : str
        Description of the pieces for the certificate.
    resolution : (4,) array, optional
        Largest rounding error of the points of a piecewise linear trajectory (rad, m). The
        acceleration of such a trajectory is undefined. None means that the pieces are smooth.
    seal : bool
        Add a hash of the input, which plans need.

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
    jumps = JumpRecorder(robot)
    rate = min(rate, MAX_INSTANTS / trajectory.duration)
    # The acceleration of linear pieces is undefined, and so are quantities that depend on it.
    checked = [
        item for item in limited_quantities(robot, limits) if not is_table or item.limit.order < 2
    ]
    checked += [] if is_table else worst_case_torques(trajectory, robot, limits)
    checks, sampled = _worst_values(trajectory, robot, limits, checked, rate, jumps=jumps)
    unjudged: list[Unjudged] = []
    unchecked = [
        f"motor torque and speed of joint {joint.name}: {_missing_motor_reason(joint)}"
        for joint in robot.joints
        if joint.drive is None or joint.motor is None
    ]
    if limits.duty is None:
        unchecked.append("continuous torque: it does not limit a motion that is performed once")
    else:
        checks += sampled.rms.results(robot, trajectory, limits.duty)
    if resolution is not None:
        checks, rounded, unjudged = check_linear_pieces(
            trajectory, robot, limits, resolution, dict(zip(checked, checks, strict=True))
        )
        unchecked += rounded
        dynamics, bands = _check_table_dynamics(trajectory, robot, limits, resolution, rate=rate)
        checks += dynamics
        unjudged += bands
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
    checked: list[LimitedQuantity],
    rate: float,
    jumps: JumpRecorder | None = None,
) -> tuple[list[LimitCheck], SampledExtremes]:
    """Find the worst value of each quantity.

    Parameters
    ----------
    trajectory : Trajectory
        Motion that is checked.
    robot : Robot
        Robot whose limits must hold.
    limits : TaskLimits
        Limits of the task.
    checked : list of Quantity
        The quantities to evaluate.
    rate : float
        Sampling rate in Hz of the second, denser search (`SampledExtremes`).
    jumps : Jumps, optional
        Collects the jumps at the breaks while the pieces are read.

    Returns
    -------
    checks : list of LimitCheck
        One result for each quantity, in the same order.
    sampled : SampledExtremes
        The search, which contains the number of instants and the RMS torques.
    """
    extremes = [WorstValue(quantity) for quantity in checked]
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
    """Judge the limits of a table of points that depend on the acceleration.

    Pieces that are not linear define an acceleration, so they are checked as usual. If all pieces
    are linear, the points still bound the motor torques (`check_torque_bands`). All other limits of
    this kind are not judged.

    Returns
    -------
    checks : list of LimitCheck
        The limits that could be judged.
    unjudged : list of Unjudged
        The limits that the points leave open, with reasons.
    """
    index_blocks = blocks(len(trajectory.breaks) - 1, BLOCK)
    curved = [trajectory.pieces(block)[:, 2:].any(axis=(1, 2)) for block in index_blocks]
    smooth = np.flatnonzero(np.concatenate(curved))
    bands: list[LimitCheck] = []
    unjudged: list[Unjudged] = []
    if not len(smooth):
        bands, unjudged = check_torque_bands(
            trajectory, robot, limits, resolution, LINEAR_PIECES_REASON
        )
    judged_limits = {(band.name, band.joint) for band in bands}
    judged_limits |= {(item.name, item.joint) for item in unjudged}
    all_limits = list(limits.limits)
    for joint in robot.joints:
        all_limits += joint.limits
    for limit in all_limits:
        is_limited = limits.duty is not None or type(limit) is not ContinuousTorque
        if limit.order > 1 and is_limited and (limit.name, limit.joint) not in judged_limits:
            unjudged.append(Unjudged(limit.name, limit.joint, LINEAR_PIECES_REASON))
    if len(smooth):
        bands = _check_smooth_pieces(trajectory, smooth, robot, limits, rate=rate)
    return bands, unjudged


def _check_smooth_pieces(
    trajectory: Trajectory, index: Indices, robot: Robot, limits: TaskLimits, *, rate: float
) -> list[LimitCheck]:
    """Check accelerations, jerks and torques on the pieces that are not linear.

    index (n,) contains the numbers of these pieces. They are joined without the linear pieces,
    which is possible because each quantity depends on one piece only. The times of the results
    refer to the original trajectory.
    """
    breaks = np.append(0.0, np.cumsum(np.diff(trajectory.breaks)[index]))
    smooth_motion = Trajectory(breaks, trajectory.pieces(index), ())
    checked = [item for item in limited_quantities(robot, limits) if item.limit.order >= 2]
    checked += worst_case_torques(smooth_motion, robot, limits)
    checks, _ = _worst_values(smooth_motion, robot, limits, checked, rate)
    times = np.array([item.time for item in checks])
    piece_index = smooth_motion.piece_of(times)
    times += trajectory.breaks[index[piece_index]] - breaks[piece_index]
    return [replace(item, time=float(t)) for item, t in zip(checks, times, strict=True)]


def _missing_motor_reason(joint: Joint) -> str:
    """Return the reason why the motor of a joint is not checked."""
    if joint.drive is not None:
        return "the robot file names no motor for it"
    if joint.motor is None:
        return "the robot file names no drive and no motor for it"
    return f"the robot file names no drive for it, so its motor {joint.motor.name} is ignored"


def _check_self_locking(robot: Robot, share: float | None) -> list[LimitCheck]:
    """Check that every drive which must hold by itself is self-locking.

    A drive is self-locking if the friction angle φ_f exceeds the lead angle λ. The margin is the
    difference between the friction coefficient and the smallest coefficient that locks, divided by
    the latter.

    Parameters
    ----------
    robot : Robot
        Robot whose limits must hold.
    share : float or None
        Fraction of the friction range that the motion must be valid for. The check uses the
        smallest friction coefficient in it. None means the smallest plausible coefficient of the
        drive.

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
        if share is not None:
            coefficients = spread_of(drive).within(share).get("mu")
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
    the start of the next one, so jumps, end velocities and RMS torques are left out. Limits that
    concern the motion as a whole are left out as well.

    Parameters
    ----------
    stops : StopMotions
        The stops.
    motion : Trajectory
        The motion from which the stops start. It is checked in their place if it always rests.
    robot : Robot
        Robot whose limits must hold.
    limits : TaskLimits
        Limits of the task. Its motions and its limit on the stop travel do not apply to stops.

    Returns
    -------
    Certificate
        The worst values over all stops. Times count from the start of the first stop.
    """
    joined = stops.joined
    remaining = tuple(limit for limit in limits.limits if limit is not limits.stop_travel)
    limits = replace(limits, limits=remaining, motion=())
    certificate = check(
        motion if joined is None else joined, robot, limits, rate=STOP_SAMPLING_RATE
    )
    excluded = JUMP_NAMES + END_VELOCITY_NAMES + (ContinuousTorque.name,)
    remaining_checks = tuple(item for item in certificate.limits if item.name not in excluded)
    return replace(certificate, limits=remaining_checks)


def _check_stop_travel(motion: Trajectory, robot: Robot, limits: TaskLimits) -> list[LimitCheck]:
    """Check how far the tip travels in the farthest controlled stop.

    A stop counts only if it keeps the other limits, and if it ends at rest. Otherwise, the margin
    is at most that of the violated limit, or at most −1.

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
        One result, or none if the task does not limit the stop travel.
    """
    limit = limits.stop_travel
    if limit is None:
        return []
    stops = quickest_stops(motion, robot)
    k = int(np.argmax(stops.travel))
    previous = stops.time[max(k - 1, 0)]
    following = stops.time[min(k + 1, len(stops.time) - 1)]
    closer = quickest_stops(motion, robot, np.linspace(previous, following, REFINEMENT_INSTANTS))
    travel = np.append(stops.travel, closer.travel)
    time = np.append(stops.time, closer.time)
    k = int(np.argmax(travel))
    result = LimitCheck.from_extreme(limit, float(travel[k]), float(motion.breaks[0] + time[k]))
    tightest = check_stops(stops, motion, robot, limits).worst
    if tightest.passed and stops.ends_at_rest:
        return [result]
    reason = f"a stop exceeds {tightest.name} of {tightest.joint or 'the tool'}"
    margin = min(result.margin, tightest.margin)
    if not stops.ends_at_rest:
        reason = "the motion does not end at rest"
        margin = min(margin, -1.0)
    return [replace(result, margin=min(margin, 0.0), case=reason)]
