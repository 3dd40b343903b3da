"""Independent check of a trajectory against every limit, with the exact friction law.

The check knows nothing about the planner. Its input are polynomials in time. For quantities that
are polynomials themselves (position, velocity, acceleration, jerk, motor speed), it computes the
exact
extremes. It samples the other quantities densely, on both sides of every break and every reversal,
and refines the intervals in which a larger value may hide. Starts and reversals use static
friction. RMS motor torques are compared with the continuous torque of the motors.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ssm_planner.dynamics import self_locking_margin, spread_of
from ssm_planner.kinematics import Mechanism
from ssm_planner.problem import ENDS, JUMPS, ContinuousTorque, Joint, Robot, SelfLocking, TaskLimits
from ssm_planner.trajectory import BLOCK, Trajectory, blocks
from ssm_planner.typing import Array, Indices
from ssm_planner.verification.cases import worst_cases
from ssm_planner.verification.certificate import (
    Certificate,
    LimitCheck,
    Unjudged,
    sealed,
    worst_of_each,
)
from ssm_planner.verification.ends import Jumps, end_checks
from ssm_planner.verification.limits import Quantity, Worst, quantities
from ssm_planner.verification.pieces import find_extremes, pieces_of
from ssm_planner.verification.polylines import linear_limits
from ssm_planner.verification.promises import promises_kept, unchecked_lines
from ssm_planner.verification.sampled_extremes import SampledExtremes
from ssm_planner.verification.stops import StopMotions, quickest_stops
from ssm_planner.verification.torque_bands import torque_bands

RATE = 10_000.0
RATE_OF_STOPS = 1000.0
CLOSER = 21
"""Number of instants around the farthest stop that are evaluated again."""
INSTANTS = 3_000_000
"""Largest number of instants of the first pass.

Longer trajectories are sampled at a lower rate first.
"""
UNDEFINED = "not defined on straight pieces (linear interpolation)"
NONE = TaskLimits()


def check(
    trajectory: Trajectory,
    robot: Robot,
    limits: TaskLimits = NONE,
    rate: float = RATE,
    interpolation: str = "quintic polynomial pieces",
    resolution: Array | None = None,
    seal: bool = False,
) -> Certificate:
    """Check a trajectory against every limit of the robot and the task.

    Parameters
    ----------
    trajectory : Trajectory
    robot : Robot
    limits : TaskLimits
        Limits of the task. The motion must rest at both ends unless these declare end rates.
    rate : float
        Sampling rate of the second pass in Hz. The first pass has a fifth of it, and at least
        four instants in every piece.
    interpolation : str
        Description of the pieces for the certificate.
    resolution : (4,), optional
        Largest rounding error of the points of a piecewise linear trajectory (rad, m). Such a
        trajectory has no acceleration. None means that the pieces are smooth.
    seal : bool
        Add a hash of the input, which plans need.

    Returns
    -------
    Certificate
    """
    straight = resolution is not None
    jumps = Jumps(robot)
    rate = min(rate, INSTANTS / trajectory.duration)
    # on straight pieces what depends on the acceleration is not defined
    checked = [item for item in quantities(robot, limits) if not straight or item.limit.order < 2]
    checked += [] if straight else worst_cases(trajectory, robot, limits)
    checks, sampled = _worst_values(trajectory, robot, limits, checked, rate, jumps=jumps)
    unjudged: list[Unjudged] = []
    unchecked = [
        f"motor torque and speed of joint {joint.name}: {_lacking(joint)}"
        for joint in robot.joints
        if joint.drive is None or joint.motor is None
    ]
    if limits.duty is None:
        unchecked.append(
            "continuous torque: the motion is done once, and what motors may do for all time is no "
            "limit then"
        )
    else:
        checks += sampled.rms.checks(robot, trajectory, limits.duty)
    if resolution is not None:
        checks, rounded, unjudged = linear_limits(
            trajectory, robot, limits, resolution, dict(zip(checked, checks, strict=True))
        )
        unchecked += rounded
        dynamics, bands = _dynamics_of_table(trajectory, robot, limits, resolution, rate=rate)
        checks += dynamics
        unjudged += bands
    checks += jumps.checks(straight)
    checks += end_checks(trajectory, robot, limits, straight)
    checks += _locking(robot, limits.friction)
    if not straight:
        checks += _farthest_stop(trajectory, robot, limits)
    if trajectory.phases:
        mechanism = Mechanism.from_robot(robot)
        for promise in promises_kept(trajectory, mechanism, limits):
            checks += promise.checks
    elif limits.promising:
        unchecked.append(unchecked_lines(limits))
    certificate = Certificate(
        worst_of_each(checks),
        interpolation,
        sampled.instants,
        tuple(unchecked),
        unjudged=tuple(unjudged),
    )
    return sealed(certificate, trajectory, robot, limits) if seal else certificate


def _worst_values(
    trajectory: Trajectory,
    robot: Robot,
    limits: TaskLimits,
    checked: list[Quantity],
    rate: float,
    jumps: Jumps | None = None,
) -> tuple[list[LimitCheck], SampledExtremes]:
    """Return the check of each quantity, and the search that sampled the trajectory."""
    extremes = [Worst(quantity) for quantity in checked]
    sampled = SampledExtremes(trajectory, robot, extremes, rate=rate, eye=limits.eye)
    for pieces in pieces_of(trajectory):
        find_extremes(pieces, extremes)
        sampled.search(pieces)
        if jumps is not None:
            jumps.look(pieces)
    return [item.as_check() for item in extremes], sampled


def _dynamics_of_table(
    trajectory: Trajectory, robot: Robot, limits: TaskLimits, resolution: Array, *, rate: float
) -> tuple[list[LimitCheck], list[Unjudged]]:
    """Judge what depends on the acceleration in a table of points, as far as it is defined.

    Smooth pieces between the points define it. Positions alone leave bands of the motor torques.
    """
    every = blocks(len(trajectory.breaks) - 1, BLOCK)
    curved = [trajectory.pieces(block)[:, 2:].any(axis=(1, 2)) for block in every]
    smooth = np.flatnonzero(np.concatenate(curved))
    bands: list[LimitCheck] = []
    unjudged: list[Unjudged] = []
    if not len(smooth):
        bands, unjudged = torque_bands(trajectory, robot, limits, resolution, UNDEFINED)
    judged = {(band.name, band.joint) for band in bands}
    judged |= {(item.name, item.joint) for item in unjudged}
    for limit in (limit for owner in (*robot.joints, limits) for limit in owner.limits):
        is_asked = limits.duty is not None or type(limit) is not ContinuousTorque
        if limit.order > 1 and is_asked and (limit.name, limit.joint) not in judged:
            unjudged.append(Unjudged(limit.name, limit.joint, UNDEFINED))
    if len(smooth):
        bands = _dynamics_of_smooth_pieces(trajectory, smooth, robot, limits, rate=rate)
    return bands, unjudged


def _dynamics_of_smooth_pieces(
    trajectory: Trajectory, index: Indices, robot: Robot, limits: TaskLimits, *, rate: float
) -> list[LimitCheck]:
    """Check accelerations, jerks and torques on the pieces with index (n,), which are not linear.

    These pieces are joined without the linear ones, because each quantity depends on one piece.
    """
    breaks = np.append(0.0, np.cumsum(np.diff(trajectory.breaks)[index]))
    part = Trajectory(breaks, trajectory.pieces(index), ())
    checked = [item for item in quantities(robot, limits) if item.limit.order >= 2]
    checked += worst_cases(part, robot, limits)
    checks, _ = _worst_values(part, robot, limits, checked, rate)
    times = np.array([item.time for item in checks])
    piece = part.piece_of(times)
    times += trajectory.breaks[index[piece]] - breaks[piece]
    return [replace(item, time=float(t)) for item, t in zip(checks, times, strict=True)]


def _lacking(joint: Joint) -> str:
    """Return why the motor of a joint is not checked."""
    if joint.drive is not None:
        return "the robot file names no motor for it"
    if joint.motor is None:
        return "the robot file names no drive and no motor for it"
    return (
        f"the robot file names no drive for it, so its motor {joint.motor.name} counts for nothing"
    )


def _locking(robot: Robot, share: float | None) -> list[LimitCheck]:
    """Check φ_f > λ at the lowest plausible friction for every drive that must hold by itself.

    share: fraction of the friction range, if there is one.
    """
    checks = []
    for joint in robot.joints:
        limit = joint.find_limit(SelfLocking)
        drive = joint.drive
        if limit is None or drive is None:
            continue
        lowest = limit.friction
        case = None
        if share is not None:
            minimum = float(spread_of(drive).within(share).get("mu", np.array([lowest])).min())
            lowest, case = (minimum, f"mu {minimum:.4g}") if minimum < lowest else (lowest, None)
        in_mu = float(self_locking_margin(drive, lowest)[0])
        needed = lowest - in_mu
        margin = in_mu / needed
        result = LimitCheck(
            limit.name, limit.joint, lowest, needed, margin, time=0.0, unit=limit.unit, case=case
        )
        checks.append(result)
    return checks


def check_stops(
    stops: StopMotions, motion: Trajectory, robot: Robot, limits: TaskLimits
) -> Certificate:
    """Check all controlled stops together.

    The stops follow one another in one trajectory. Limits on a motion as a whole, and the
    transitions between two stops, are left out.
    """
    joined = stops.joined
    remaining = tuple(limit for limit in limits.limits if limit is not limits.stop_travel)
    limits = replace(limits, limits=remaining, motion=())
    certificate = check(motion if joined is None else joined, robot, limits, rate=RATE_OF_STOPS)
    excluded = (*JUMPS, ContinuousTorque.name, *ENDS)
    of_stops = tuple(
        limit_check for limit_check in certificate.limits if limit_check.name not in excluded
    )
    return replace(certificate, limits=of_stops)


def _farthest_stop(motion: Trajectory, robot: Robot, limits: TaskLimits) -> list[LimitCheck]:
    """Check the tip travel of the farthest controlled stop.

    Each stop keeps the other limits. The result is empty if the stop travel is not limited.
    """
    limit = limits.stop_travel
    if limit is None:
        return []
    stops = quickest_stops(motion, robot)
    k = int(np.argmax(stops.travel))
    neighbourhood = np.linspace(
        stops.time[max(k - 1, 0)], stops.time[min(k + 1, len(stops.time) - 1)], CLOSER
    )
    closer = quickest_stops(motion, robot, neighbourhood)
    travel = np.append(stops.travel, closer.travel)
    time = np.append(stops.time, closer.time)
    k = int(np.argmax(travel))
    result = LimitCheck.from_extreme(limit, float(travel[k]), float(motion.breaks[0] + time[k]))
    tightest = check_stops(stops, motion, robot, limits).worst
    if tightest.passed and stops.ends:
        return [result]
    reason = (
        f"a stop exceeds {tightest.name} of {tightest.joint or 'the tool'}"
        if stops.ends
        else "the motion ends moving"
    )
    return [
        replace(
            result,
            margin=min(result.margin, tightest.margin, 0.0 if stops.ends else -1.0),
            case=reason,
        )
    ]
