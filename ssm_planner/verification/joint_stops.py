"""Quickest stops of robots with limits on the jerk.

If the jerk is limited, a stop along the path of the motion has no closed form. Each joint therefore
stops by itself, and the tip leaves the path. Let a joint have the velocity v and the acceleration
a, both in the direction in which it would come to rest too late. Its acceleration falls to −P,
stays there, and returns to 0, with the jerks −J, 0 and J. Both ramps reduce the velocity by
(2 P² − a²) / (2 J), and the stop takes the time

    T = (a + P) / J + (v + a² / (2 J)) / P.

It is shortest for P² = J v + a²/2, or for the largest P that the limit of the acceleration allows.
Two variants exist: all joints stop as quickly as they can, or all stop at the same time. In the
second, P is the smaller solution of the equation for T.

If limits of the task or of the motors forbid both variants, the robot first continues its motion,
until a stop is possible or until the motion ends.
"""

from math import comb

import numpy as np

from ssm_planner.problem import Robot, TaskLimits
from ssm_planner.trajectory import DEGREE, Samples, Trajectory
from ssm_planner.typing import Array, Indices
from ssm_planner.verification.limits import WorstValue, limited_quantities
from ssm_planner.verification.pieces import jerk_limits, rest_speeds
from ssm_planner.verification.sampled_extremes import SampledExtremes

STOP_VARIANTS = ((0.999, False), (0.999, True), (0.5, False), (0.5, True), (0.25, True))
"""Shares of the acceleration limits that stops use, and whether all joints stop together.

They are tried in this order, and the first stop that keeps all limits is used. Weak motors need the
smaller shares. The largest share is below 1, because a stop may be written to a table with rounded
numbers.
"""
GRID_INSTANTS = 1000
"""Number of additional instants at which a stop may begin after the motion has continued."""
MIN_PIECE_DURATION = 1e-9
"""Duration below which a piece is left out, s."""
LIMIT_SAMPLE_FRACTIONS = np.linspace(0.0, 1.0, 40) ** 3
"""Fractions of a piece at which limits are evaluated.

They are dense at its start, because a stop often begins at a limit.
"""
STARTING_SPEED_FRACTION = 1e-3
"""Share of the velocity limit below which the friction of a joint counts as static."""
EXCESS_TOLERANCE = 1e-7
"""Largest relative excess over a limit at which a stop counts as possible."""

StopPieces = tuple[Array, Array]
"""Lengths (m,) in s, and coefficients (m, 6, 4) of powers of the time since their starts."""


def compute_joint_stops(
    motion: Trajectory, robot: Robot, limits: TaskLimits, times: Array
) -> tuple[Array, Array, Indices]:
    """Compute the stops of a robot with jerk limits from n instants of a motion.

    `quickest_stops` calls this function if the jerk of a joint is limited.

    Parameters
    ----------
    motion : Trajectory
        The motion. It must keep all limits.
    robot : Robot
        The robot, whose limits of acceleration and jerk the stops keep.
    limits : TaskLimits
        Limits of the task, which the stops keep.
    times : (n,) array
        Instants in s from the start of the motion.

    Returns
    -------
    lengths : (m,) array
        Durations of the pieces of all stops, s.
    coefficients : (m, 6, 4) array
        Coefficients of powers of the time since the start of each piece.
    edges : (n + 1,) array
        Index of the first piece of each stop, and the number of pieces.
    """
    # A stop that is not possible at a requested instant may begin at one of the later instants.
    instants = np.union1d(times, np.linspace(0.0, motion.duration, GRID_INSTANTS))
    stops: list[StopPieces | None] = [None] * len(instants)
    for share, together in STOP_VARIANTS:
        missing = [i for i, stop in enumerate(stops) if stop is None]
        times_of_missing = np.minimum(motion.breaks[0] + instants[missing], motion.breaks[-1])
        states = motion.sample(times_of_missing)
        candidates = _stops_from_states(states, robot, share, together=together)
        is_possible = _limit_excesses(candidates, robot, limits) <= EXCESS_TOLERANCE
        for i, stop, is_usable in zip(missing, candidates, is_possible, strict=True):
            stops[i] = stop if is_usable else None
    selected_stops = [
        _earliest_stop(motion, instants, stops, int(i)) for i in instants.searchsorted(times)
    ]
    sizes = [len(lengths) for lengths, _ in selected_stops]
    lengths, coefficients = map(np.concatenate, zip(*selected_stops, strict=True))
    return lengths, coefficients, np.append(0, np.cumsum(sizes))


def _earliest_stop(
    motion: Trajectory, instants: Array, stops: list[StopPieces | None], first: int
) -> StopPieces:
    """Build the pieces of the first possible stop at or after an instant.

    If no stop is possible at this instant, the robot continues its motion until one is possible, or
    until the motion ends.

    Parameters
    ----------
    motion : Trajectory
        The motion.
    instants : (k,) array
        Instants at which a stop may begin, in s from the start of the motion.
    stops : list of k StopPieces or None
        The stop from each instant. None if it would violate a limit.
    first : int
        Index of the instant at which the stop is requested.

    Returns
    -------
    StopPieces
        Durations (m,) in s and coefficients (m, 6, 4) of the pieces, with the continued motion.
    """
    possible = [k for k in range(first, len(stops)) if stops[k] is not None]
    stop_index = possible[0] if possible else len(stops) - 1
    no_pieces = np.zeros(0), np.zeros((0, DEGREE + 1, 4))
    stop_lengths, stop_coefficients = stops[stop_index] or no_pieces
    if stop_index == first:
        return stop_lengths, stop_coefficients
    lengths, coefficients = _motion_between(motion, instants[first], instants[stop_index])
    return (np.append(lengths, stop_lengths), np.concatenate([coefficients, stop_coefficients]))


def _motion_between(motion: Trajectory, start: float, end: float) -> StopPieces:
    """Cut the pieces of a motion between two instants.

    The first piece is shifted in time if it begins within a piece of the motion.

    Parameters
    ----------
    motion : Trajectory
        The motion.
    start, end : float
        Instants in s from the start of the motion.

    Returns
    -------
    StopPieces
        Durations (m,) in s and coefficients (m, 6, 4) of the pieces.
    """
    breaks = motion.breaks - motion.breaks[0]
    inner = breaks[(breaks > start + MIN_PIECE_DURATION) & (breaks < end - MIN_PIECE_DURATION)]
    nodes = np.array([start, *inner, end])
    index = motion.piece_of(motion.breaks[0] + (nodes[1:] + nodes[:-1]) / 2)
    coefficients = motion.pieces(index).copy()
    shift = nodes[0] - breaks[index[0]]
    # Only the first piece may begin within a piece of the motion.
    powers = shift ** np.arange(DEGREE + 1)
    for k in range(DEGREE + 1):
        # (t + shift)^i contains comb(i, k) shift^(i − k) t^k.
        factors = [comb(i, k) * powers[i - k] for i in range(k, DEGREE + 1)]
        coefficients[0, k] = factors @ coefficients[0, k:]
    return np.diff(nodes), coefficients


def _stops_from_states(
    states: Samples, robot: Robot, share: float, *, together: bool
) -> list[StopPieces]:
    """Compute stops from n states without regard to limits of the task and of the motors.

    The equations and their symbols are those in the docstring of this module.

    Parameters
    ----------
    states : Samples
        n states of the motion.
    robot : Robot
        Robot whose limits of acceleration and jerk the stops keep.
    share : float
        Share of the limits of the acceleration that the stops use.
    together : bool
        True if all joints stop at the same time. Otherwise, each joint stops as quickly as it can.

    Returns
    -------
    list of n StopPieces
        Durations (m,) in s and coefficients (m, 6, 4) of the pieces of each stop.
    """
    jerk = jerk_limits(robot)
    rests = (np.abs(states.qd) <= rest_speeds(robot)) & (states.qdd == 0.0)
    velocity = np.where(rests, 0.0, states.qd)
    side = np.sign(velocity + states.qdd * np.abs(states.qdd) / (2 * jerk))
    # v and a count in the direction in which the joint would come to rest too late.
    v = side * velocity
    a = side * states.qdd
    # Velocity that the deceleration must remove, with the part that a adds until it has fallen to
    # 0.
    loss = v + a**2 / (2 * jerk)
    # Without a limit on the jerk, the product of 0 and infinity is 0.
    square = np.where(loss > 0, loss, 0.0) * np.where(loss > 0, jerk, 0.0)
    quickest = np.minimum(np.sqrt(square), np.maximum(share * robot.accelerations, -a))
    peak = quickest  # the largest deceleration P
    if together:
        hold = np.divide(loss, quickest, out=np.zeros_like(v), where=quickest > 0)
        duration = ((a + quickest) / jerk + hold).max(axis=1, keepdims=True)
        # The equation for T is P²/J − b P + loss = 0. This form of its smaller solution is
        # accurate.
        b = duration - a / jerk
        root = np.sqrt(np.maximum(b**2 - 4 * loss / jerk, 0.0))
        peak = np.divide(2 * loss, b + root, out=np.zeros_like(v), where=loss > 0)
        peak = np.clip(peak, np.minimum(np.maximum(-a, 0.0), quickest), quickest)
    velocity_to_lose = v - (2 * peak**2 - a**2) / (2 * jerk)
    hold = np.divide(velocity_to_lose, peak, out=np.zeros_like(v), where=peak > 0)
    durations = np.stack([(a + peak) / jerk, np.maximum(hold, 0.0), peak / jerk])
    ramp = side * np.where(np.isinf(jerk), 0.0, jerk)
    zero = np.zeros_like(v)
    # Accelerations and jerks of the three phases and of the rest after them
    accelerations = np.stack([states.qdd, -side * peak, -side * peak, zero])
    jerks = np.stack([-ramp, zero, ramp, zero])
    return _pieces_of_phases(states.q, velocity, accelerations, jerks, durations)


def _pieces_of_phases(
    q: Array, velocity: Array, accelerations: Array, jerks: Array, durations: Array
) -> list[StopPieces]:
    """Build the pieces of n stops from the phases of their joints.

    A stop of one joint has three phases of constant jerk. The joints change their phases at
    different times, so a new piece begins whenever any joint changes its phase.

    Parameters
    ----------
    q, velocity : (n, 4) arrays
        Positions (rad, m) and velocities of the four joints at the starts of the stops.
    accelerations, jerks : (4, n, 4) arrays
        Accelerations at the starts of three phases and of the rest after them, and their jerks.
    durations : (3, n, 4) array
        Durations of the phases of each joint, s.

    Returns
    -------
    list of n StopPieces
        Durations (m,) in s and coefficients (m, 6, 4) of the pieces of each stop.
    """
    # Positions and velocities at the start of each phase, and of the rest after the last phase
    positions = [q]
    velocities = [velocity]
    for phase, t in enumerate(durations):
        x = positions[phase]
        dx = velocities[phase]
        ddx = accelerations[phase]
        dddx = jerks[phase]
        positions.append(x + dx * t + ddx * t**2 / 2 + dddx * t**3 / 6)
        velocities.append(dx + ddx * t + dddx * t**2 / 2)
    # The rest after the last phase has no velocity, also after rounding.
    velocities[-1] = np.zeros_like(velocity)
    starts = np.concatenate([np.zeros_like(q)[None], np.cumsum(durations, axis=0)])
    phases = np.stack([positions, velocities, accelerations / 2, jerks / 6])
    stops = []
    for i in range(len(q)):
        nodes = np.unique(starts[:, i])
        nodes = nodes[np.append(True, np.diff(nodes) > MIN_PIECE_DURATION)]
        middles = (nodes[1:] + nodes[:-1]) / 2
        # Phase of each joint in each piece, from the number of phases that have ended before it.
        index = (starts[1:, i] <= middles[:, None, None]).sum(axis=1)
        joint = np.arange(4)
        x, dx, ddx, dddx = phases[:, index, i, joint]
        t = nodes[:-1, None] - starts[index, i, joint]
        # Taylor coefficients of each joint's phase at the start t of the piece within the phase.
        # ddx and dddx are already divided by 2 and 6.
        coefficients = np.zeros((len(t), DEGREE + 1, 4))
        coefficients[:, 0] = x + dx * t + ddx * t**2 + dddx * t**3
        coefficients[:, 1] = dx + 2 * ddx * t + 3 * dddx * t**2
        coefficients[:, 2] = ddx + 3 * dddx * t
        coefficients[:, 3] = dddx
        stops.append((np.diff(nodes), coefficients))
    return stops


def _limit_excesses(stops: list[StopPieces], robot: Robot, limits: TaskLimits) -> Array:
    """Compute by how much each stop exceeds the limit that it violates most.

    Parameters
    ----------
    stops : list of n StopPieces
        The stops.
    robot : Robot
        Robot whose limits must hold.
    limits : TaskLimits
        Limits of the task.

    Returns
    -------
    (n,) array
        Distance beyond the nearer end of the permitted range, divided by half the width of the
        range. It is at most 0 if all limits hold, and −∞ for a stop without pieces.
    """
    counts = [len(lengths) for lengths, _ in stops]
    excess = np.full(len(stops), -np.inf)
    if not any(counts):
        return excess
    lengths, coefficients = map(np.concatenate, zip(*stops, strict=True))
    joined = Trajectory(np.append(0.0, np.cumsum(lengths)), coefficients, ())
    index = np.repeat(np.arange(len(lengths)), len(LIMIT_SAMPLE_FRACTIONS))
    samples = joined.sample_pieces(index, np.outer(lengths, LIMIT_SAMPLE_FRACTIONS).ravel())
    limited = [WorstValue(quantity) for quantity in limited_quantities(robot, limits)]
    # Only its method `evaluate` is used, so the sampling rate does not matter.
    law = SampledExtremes(joined, robot, limited, rate=1.0, eye=limits.eye)
    direction = np.where(np.abs(samples.qd) > rest_speeds(robot), np.sign(samples.qd), 0.0)
    # Near a reversal, the friction may be static.
    static = (direction != 0) & (np.abs(samples.qd) <= STARTING_SPEED_FRACTION * robot.velocities)
    state = samples.q, samples.qd, samples.qdd
    derivatives = (*state, samples.qddd)
    # `evaluate` returns a column for each quantity that is not a polynomial in time.
    columns = iter(law.evaluate(state, direction, static.astype(float)).T)
    # Index of the stop to which each sample belongs
    owner = np.repeat(np.arange(len(stops)), counts)[index]
    for extreme in limited:
        quantity = extreme.quantity
        if quantity.order is None:
            value = next(columns)
        else:
            derivative = derivatives[quantity.order]
            value = quantity.scale * derivative[:, quantity.index]
        np.maximum.at(excess, owner, quantity.excess(value, value))
    return excess
