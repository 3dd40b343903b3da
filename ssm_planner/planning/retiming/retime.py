"""TOPP-RA: the fastest motion along a given path, with friction as exact linear constraints.

A path q(s) is given, and TOPP-RA (time-optimal path parametrisation by reachability analysis)
computes its timing s(t). `retime` is the main function. constraints.py writes the limits as
constraints on s̈ and ṡ² at the points of a grid, where ṡ = ds/dt is the speed along the path.
reachability.py computes the fastest motion within linear constraints. This module calls one such
computation a pass. The terms of viscous friction are not linear but concave in ṡ². Each pass
replaces them by their tangents at the motion of the previous pass. A tangent is never smaller than
its term. Every pass thus gives a feasible motion, and the next motion is not slower.

Source: H. Pham, Q.-C. Pham, A New Approach to Time-Optimal Path Parameterization based on
Reachability Analysis, IEEE T-RO 34(3), 2018, and its interpolation scheme.
"""

from dataclasses import replace

import numpy as np

from ssm_planner.kinematics import tool_speed
from ssm_planner.planning.retiming.constraints import PathLimits
from ssm_planner.planning.retiming.paths import MIN_GRID_INTERVALS, JointPath, MotionPath
from ssm_planner.planning.retiming.reachability import fastest_profile
from ssm_planner.planning.tolerances import (
    EQUALITY_TOLERANCE,
    GAP,
    PATH_SAMPLES,
    ROUNDING_TOLERANCE,
)
from ssm_planner.problem import Robot, TaskLimits, TipSpeed
from ssm_planner.trajectory import Samples, Trajectory, quintic_coefficients
from ssm_planner.typing import Array, Indices, record

UNIFORM_WEIGHT = 0.1
"""Weight of uniform steps in s for the fine grid, from 0 to 1.

The rest of the weight is on uniform steps in time. With uniform steps in time alone, a fast part of
the motion would have too few grid points.
"""
MAX_PASSES = 12
"""Largest number of passes of TOPP-RA. A test with strong viscous friction needs ten."""
MAX_SPEED_RATIO = 10.0
"""Largest ratio of ṡ in the new timing of an existing motion to ṡ in that motion.

Where all joints rest, no limit of a joint bounds ṡ, so this ratio does.
"""
TANGENT_REDUCTION = 1 / 16
"""Factor on the ṡ² at which tangents are taken, after a pass that finds no motion.

The speed ṡ thus falls to a quarter.
"""
FAILURE = "TOPP-RA finds no motion along the path within the limits"
"""Message of the planner if TOPP-RA finds no motion along a path."""


@record
class Retiming:
    """Result of TOPP-RA: the timing of a path on a grid of n intervals of the path parameter s.

    ṡ = ds/dt is the speed along the path. ṡ² is linear in s on each interval, so s̈ is constant
    there.
    """

    s: Array
    """Path parameters at the grid points, (n + 1,)."""
    speed_squared: Array
    """ṡ² = (ds/dt)² at the grid points, (n + 1,), 1/s². All are 0 if there is no motion."""
    active: Indices
    """For each interval, the index of the constraint that limits the motion most, or −1, (n,).

    `LinearConstraints.active` defines the indices.
    """

    @property
    def solved(self) -> bool:
        """True if TOPP-RA found a motion."""
        return bool(self.speed_squared.any())

    @property
    def times(self) -> Array:
        """Time at each grid point, (n + 1,), s."""
        return _passing_times(self.s, self.speed_squared)

    @property
    def acceleration(self) -> Array:
        """s̈ on each interval, (n,), 1/s²."""
        return np.diff(self.speed_squared) / (2 * np.diff(self.s))

    @property
    def duration(self) -> float:
        """Duration of the motion, s. Infinite without a motion."""
        return float(self.times[-1]) if self.solved else np.inf


def retime(
    path: JointPath,
    robot: Robot,
    limits: TaskLimits = TaskLimits(),  # noqa: B008  frozen
    speeds: tuple[float, float] = (0.0, 0.0),
    points: int | None = None,
) -> Retiming:
    """Compute the time-optimal motion along a path by TOPP-RA.

    If the grid has many points, the function first calls itself with a coarse grid. The motion on
    the coarse grid determines where the points of the fine grid lie. It also gives the speeds at
    which the terms of viscous friction are first replaced by their tangents.

    Parameters
    ----------
    path : JointPath
        Joint path q(s) with the path parameter s from 0 to 1.
    robot : Robot
        The robot with its limits.
    limits : TaskLimits
        Limits on the tool and on rates of task coordinates.
    speeds : (float, float)
        ṡ at both ends, 1/s.
    points : int or None
        Number of grid intervals. None: the number that the path needs (`JointPath.grid_intervals`).

    Returns
    -------
    Retiming
        The motion. Its property `solved` is False if there is none.
    """
    points, few = points or path.grid_intervals, PATH_SAMPLES // 2
    coarse = retime(path, robot, limits, speeds, points=few) if points > few else None
    grid = _grid(path.directions[0], points, coarse)
    path_limits = PathLimits.on_grid(path, grid, robot, limits, moving=speeds[0] > 0.0)
    tangent = path_limits.ceiling
    if coarse is not None and coarse.solved:
        tangent = np.interp(grid, coarse.s, coarse.speed_squared)
    return _repeat_passes(grid, path_limits, tangent, speeds)


def holds_tip_speed(retiming: Retiming, path: JointPath, speed: float) -> bool:
    """Return True if the tip has a given speed in exactly one part of the motion.

    The tip then accelerates to this speed, keeps it, and slows down only at the end. The speed must
    be reached at three grid points at least.

    Parameters
    ----------
    retiming : Retiming
        The motion, as TOPP-RA has timed it.
    path : JointPath
        Joint path of the motion, q(s) with the path parameter s from 0 to 1.
    speed : float
        Speed of the tip, m/s. The motion is never faster, because this speed was its limit.
    """
    samples = path.sample(retiming.s)
    tip_speed = tool_speed(TipSpeed, path.mechanism, samples.q, samples.dq) * np.sqrt(
        retiming.speed_squared
    )
    at_speed = np.flatnonzero(tip_speed >= (1 - ROUNDING_TOLERANCE) * speed)
    # The grid points at this speed must be consecutive.
    return len(at_speed) > 2 and len(at_speed) == at_speed[-1] - at_speed[0] + 1


def retime_motion(
    path: MotionPath, robot: Robot, limits: TaskLimits, speed_ratio: float = 1.0
) -> Retiming:
    """Compute the time-optimal motion along the path of an existing motion by TOPP-RA.

    The planner calls it for a motion from which the tip cannot stop within a given distance. The
    new timing slows this motion down. Without such a limit on the distance, the result takes at
    most about as long as the existing motion.

    Parameters
    ----------
    path : MotionPath
        Path of the existing motion, with the path parameter s from 0 to 1.
    robot : Robot
        The robot with its limits.
    limits : TaskLimits
        Limits on the tool and on rates of task coordinates.
    speed_ratio : float
        ṡ = ds/dt at both ends of the new motion, divided by the constant ṡ of the existing motion.

    Returns
    -------
    Retiming
        The motion. Its property `solved` is False if there is none.
    """
    grid = path.grid(MIN_GRID_INTERVALS)
    speed = speed_ratio / path.trajectory.duration
    path_limits = PathLimits.on_grid(path, grid, robot, limits, moving=True)
    # Where all joints rest, their limits allow any ṡ.
    path_limits = replace(
        path_limits, ceiling=np.minimum(path_limits.ceiling, (MAX_SPEED_RATIO * speed) ** 2)
    )
    return _repeat_passes(grid, path_limits, np.full_like(grid, speed**2), (speed, speed))


def keeps_limits(path: MotionPath, robot: Robot, limits: TaskLimits) -> bool:
    """Return True if an existing motion satisfies the limits at the grid points of its path.

    The limits are those of joint velocity and acceleration, motor speed and torque, the speeds of
    the tool, and the rates of task coordinates. Limits on jerk and on the distance to stop are not
    examined.

    Parameters
    ----------
    path : MotionPath
        The path of the motion, which contains the motion itself.
    robot : Robot
        The robot with its limits.
    limits : TaskLimits
        Limits on the tool and on rates of task coordinates.
    """
    grid = path.grid(MIN_GRID_INTERVALS)
    # The motion itself has s = t / duration, so ṡ is constant and s̈ is 0.
    squares = np.full_like(grid, 1 / path.trajectory.duration**2)
    path_limits = PathLimits.on_grid(path, grid, robot, limits, moving=True)
    rows = replace(path_limits, braking_slopes=None).constraints(squares).tangent(squares)
    x = squares[:, None]
    peak = max((rows.b * x + rows.c).max(), (squares / rows.ceiling).max())
    return bool(peak <= 1 + EQUALITY_TOLERANCE)


def retimed_trajectory(path: MotionPath, retiming: Retiming) -> Trajectory:
    """Convert a new timing of an existing motion to joint polynomials, one on each grid interval.

    The grid has a point on either side of every break, where two polynomials of the existing motion
    meet. These two points are replaced by one on the break, at which the acceleration may jump.

    Parameters
    ----------
    path : MotionPath
        Path of the existing motion.
    retiming : Retiming
        New timing on the grid of the path, from `retime_motion`.

    Returns
    -------
    Trajectory
        The motion with the new timing.
    """
    motion = path.trajectory
    # Time in the existing motion. One point on each break replaces the two points beside it.
    grid = retiming.s * motion.duration
    inner_breaks = motion.breaks[1:-1]
    after_break = np.searchsorted(grid, inner_breaks)
    beside = np.append(after_break - 1, after_break)
    old_time = np.sort(np.append(np.delete(grid, beside), inner_breaks))
    # Squared ratio of the new velocities to the old ones, that is, θ̇² for the old time θ(t).
    rate_squared = np.interp(old_time, grid, retiming.speed_squared * motion.duration**2)
    timing = replace(retiming, s=old_time, speed_squared=rate_squared)
    acceleration = timing.acceleration[:, None]

    def states(samples: Samples, squares: Array) -> tuple[Array, Array, Array]:
        """Return q, q̇ and q̈ (n, 4) of the new motion at one end of each of its n intervals.

        With the old time θ(t), they are q, q' θ̇ and q' θ̈ + q'' θ̇². Primes denote derivatives of
        the old motion. θ̈ is `acceleration` of the enclosing function.

        Parameters
        ----------
        samples : Samples
            Positions, velocities and accelerations of the old motion at these ends.
        squares : (n,) array
            θ̇², the squared ratios of the new velocities to the old ones.
        """
        speed, square = np.sqrt(squares)[:, None], squares[:, None]
        return samples.q, samples.qd * speed, samples.qdd * square + samples.qd * acceleration

    breaks = timing.times
    starts = states(motion.sample(old_time[:-1], "right"), rate_squared[:-1])
    ends = states(motion.sample(old_time[1:], "left"), rate_squared[1:])
    return Trajectory(breaks, quintic_coefficients(np.diff(breaks), starts, ends), ())


def _repeat_passes(
    grid: Array, path_limits: PathLimits, tangent: Array, speeds: tuple[float, float]
) -> Retiming:
    """Repeat the passes of TOPP-RA on a grid until the tangents converge.

    A pass computes the fastest motion within linear constraints. Viscous friction is not linear in
    ṡ². Each pass therefore replaces its terms by their tangents at the motion of the previous pass,
    which overestimate them. The passes end when the duration changes by at most the share `GAP`, or
    when the motion reaches no limit whose constraint contains a tangent.

    Parameters
    ----------
    grid : (n,) array
        Values of the path parameter s.
    path_limits : PathLimits
        Limits at the grid points.
    tangent : (n,) array
        ṡ² at which the first tangents are taken, 1/s².
    speeds : (float, float)
        ṡ at both ends, 1/s.

    Returns
    -------
    Retiming
        The motion of the last pass that found one. Its property `solved` is False if none did.
    """
    result = Retiming(grid, np.zeros_like(grid), np.zeros(len(grid) - 1, dtype=int))
    for _ in range(MAX_PASSES):
        rows = path_limits.constraints(tangent)
        # The tangent of the square root is vertical at 0, so ṡ² is raised to a tiny positive value.
        linear = rows.tangent(np.maximum(tangent, 1e-12 * tangent.max()))
        speed_squared = fastest_profile(grid, linear, speeds)
        # The motion of an earlier pass remains valid.
        if speed_squared is None and result.solved:
            break
        if speed_squared is None:
            # A tangent at high speed overestimates viscous friction at low speed. With tangents
            # at lower speed there may be a motion.
            tangent = tangent * TANGENT_REDUCTION
            continue
        # Tangents only overestimate. If no row with a tangent binds, they do not change the motion.
        # The two entries at the end belong to the indices that stand for the ceiling, and for no
        # binding row (−1).
        has_tangent = np.append(rows.k.any(axis=0), [False, False])
        is_exact = not has_tangent[linear.active(grid, speed_squared)].any()
        motion = Retiming(grid, speed_squared, rows.active(grid, speed_squared))
        # Another pass would change the duration by about the square of the last change.
        converged = is_exact or abs(result.duration - motion.duration) <= GAP * motion.duration
        result = motion
        if converged:
            break
        tangent = speed_squared
    return result


def _passing_times(grid: Array, speed_squared: Array) -> Array:
    """Return the times at which a motion passes the grid points.

    ṡ² is linear in s between the grid points. The motion therefore covers the interval from s_i to
    s_{i+1} in the time 2 (s_{i+1} − s_i) / (ṡ_i + ṡ_{i+1}).

    Parameters
    ----------
    grid, speed_squared : (n + 1,) arrays
        s and ṡ² at the grid points.

    Returns
    -------
    (n + 1,) array
        Times, s. The first one is 0.
    """
    speed = np.sqrt(speed_squared)
    # 1e-300 prevents a division by zero where the motion rests.
    steps = 2 * np.diff(grid) / np.maximum(speed[1:] + speed[:-1], 1e-300)
    return np.append(0.0, np.cumsum(steps))


def _grid(knots: Array, points: int, coarse: Retiming | None) -> Array:
    """Choose the values of s from 0 to 1 at which TOPP-RA imposes its constraints.

    Without a coarse motion, the grid is uniform in s. With one, it is nearly uniform in time,
    because such a grid gives a faster motion. TOPP-RA uses one value of s̈ on each interval, and it
    must satisfy the constraints at both ends. The motion is therefore slightly slower than the
    fastest one, and this delay is largest in intervals that take much time. A grid with the same
    number of points that is uniform in time causes a quarter of the delay. In both cases, the grid
    points nearest to the knots are moved to the knots.

    Parameters
    ----------
    knots : (k,) array
        Values of s at which joints may reverse, with 0 and 1.
    points : int
        Number of grid intervals.
    coarse : Retiming or None
        Motion on a coarse grid.

    Returns
    -------
    (points + 1,) array
        Increasing values of s.
    """
    grid = np.linspace(0.0, 1.0, points + 1)
    # `shares` grows from 0 to 1 along the coarse grid, mostly with time. The fine grid is uniform
    # in it.
    if coarse is not None and coarse.solved:
        weighted_times = (1 - UNIFORM_WEIGHT) * coarse.times / coarse.duration
        shares = UNIFORM_WEIGHT * coarse.s + weighted_times
        grid[1:-1] = np.interp(grid, shares, coarse.s)[1:-1]
    inner_knots = knots[1:-1]
    nearest = np.rint(np.interp(inner_knots, grid, np.arange(points + 1))).astype(int)
    grid[nearest.clip(1, points - 1)] = inner_knots
    return grid
