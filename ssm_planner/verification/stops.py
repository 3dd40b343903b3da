"""Quickest controlled stops of a motion, along its path unless the jerk is limited.

A controlled stop brings all joints to rest with working motors, for example after a stop command.
The main function is `quickest_stops`.

The path is q(s), and its parameter s is the time of the motion, so the motion itself has ṡ = 1.
Primes denote derivatives with respect to s. A stop reduces ṡ to 0 on the same path, with
q̇ = q' ṡ and q̈ = q' s̈ + q'' ṡ². At given s and ṡ, every limit on an acceleration or a motor
torque is a lower bound of s̈. The stop uses the largest of these bounds, that is, the hardest
braking that all limits allow.

This choice is optimal. Standing still and the motion itself keep all limits, and the limits are
convex in ṡ². Every slower motion between both therefore keeps the limits as well, so the largest
bound always leads to a state from which a stop exists. No stop along the path is shorter.

If the jerk of a joint is limited, every joint stops by itself (module `joint_stops`).
"""

from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval

from ssm_planner.dynamics import (
    RigidBody,
    TorqueRows,
    friction_coefficient,
    motor_torque_rows,
    motorised_joints,
    output_effort,
    required_friction,
)
from ssm_planner.kinematics import Mechanism, tip_position
from ssm_planner.problem import Joint, Robot, TaskLimits
from ssm_planner.trajectory import DEGREE, Trajectory, part_indices, quintic_coefficients
from ssm_planner.typing import Array, Indices, Mask, record
from ssm_planner.verification.joint_stops import compute_joint_stops
from ssm_planner.verification.pieces import rest_speeds

INSTANTS = 1000
"""Default number of instants of the motion at which a stop begins.

The same number of evenly spaced instants always divides the path, whichever stops are requested.
"""
MAX_STEP = 2e-3
"""Largest length of an interval in which s̈ is constant, in s of the motion."""
MAX_STEPS = 8
"""Largest number of intervals between two nodes of the path."""
LIMIT_REDUCTION = 1e-3
"""Share by which stops stay below the limits.

This reserve covers the jumps of s̈ between intervals, and the difference between the polynomials
and the exact stop.
"""
MIN_BREAK_DISTANCE = 2e-4
"""Distance from a node of the path (s) below which an instant is moved to the node.

A very short piece between the instant and the node would have inaccurate accelerations.
"""
MIN_LEG_PIECES = 1500
"""Smallest number of pieces in a leg, that is, in a part of the motion between two rests.

Each leg is processed separately, which bounds the memory for long motions.
"""


@record
class StopMotions:
    """The quickest stops from n instants of a motion.

    A stop without pieces starts at rest.
    """

    time: Array
    """Instants (n,) in s from the start of the motion."""
    duration: Array
    """Duration (n,) of each stop, that is, the time until all joints rest, s."""
    travel: Array
    """Largest distance (n,) of the tip during the stop from its position at the start of it, m."""
    pieces: tuple[Array, Array]
    """Polynomial pieces of all stops, one stop after the other.

    The first array contains the durations (m,) of the pieces, s. The second array contains the
    coefficients (m, 6, 4) of powers of the time since the start of the piece.
    """
    edges: Indices
    """Index of the first piece of each stop, followed by the number of all pieces, (n + 1,)."""
    ends_at_rest: bool
    """True if the motion ends at rest. Otherwise, a stop may still move where the path ends."""

    @cached_property
    def motions(self) -> tuple[Trajectory | None, ...]:
        """The stop from each instant as a trajectory, or None if all joints rest at the instant."""
        lengths, coefficients = self.pieces
        return tuple(
            _trajectory_from_pieces(lengths[start:end], coefficients[start:end].copy())
            for start, end in pairwise(self.edges.tolist())
        )

    @property
    def joined(self) -> Trajectory | None:
        """All stops as one trajectory, one after the other, with jumps of the position in between.

        The value is None if all joints rest at every instant.
        """
        lengths, coefficients = self.pieces
        return _trajectory_from_pieces(lengths, coefficients)


def _trajectory_from_pieces(lengths: Array, coefficients: Array) -> Trajectory | None:
    """Build a trajectory that starts at time 0 from polynomial pieces.

    Parameters
    ----------
    lengths : (m,) array
        Durations of the pieces, s.
    coefficients : (m, 6, 4) array
        Coefficients of each piece and joint, by powers of the time since the start of the piece.

    Returns
    -------
    Trajectory or None
        The trajectory, which has no phases. None if the number of pieces is 0.
    """
    if not len(lengths):
        return None
    return Trajectory(np.append(0.0, np.cumsum(lengths)), coefficients, ())


@record
class _StopPath:
    """The path of a motion at both ends of m short intervals.

    The arrays q, dq, ddq and those in `effort_terms` have the shape (2, m, 4). The first axis
    contains the value just after the start of the interval and the value just before its end. The
    other axes are the interval and the joint. Neighbouring intervals have different values at their
    common end where a quantity of the motion jumps.
    """

    s: Array
    """Starts of the intervals and end of the motion, (m + 1,), in s from the start of the motion.
    """
    lengths: Array
    """Lengths of the intervals in s, (m,)."""
    following: Indices
    """Index of the interval that follows each interval, (m,). It is m at the end of the motion."""
    q: Array
    dq: Array
    ddq: Array
    """Joint positions q and their derivatives q' and q'' with respect to s."""
    effort_terms: tuple[Array, Array, Array]
    """Coefficients a, b and c of the joint efforts a s̈ + b ṡ² + c, in N·m for a joint that turns
    and in N for a joint that slides.
    """
    rests: Mask
    """True if all joints rest in the motion at the instant in `s`, (m + 1,)."""

    @classmethod
    def from_motion(
        cls, motion: Trajectory, robot: Robot, instants: Array, stop_times: Array
    ) -> "_StopPath":
        """Sample the path of a motion at both ends of short intervals.

        The nodes of the path are all breaks of the motion and the given instants. The distance
        between two nodes is divided into intervals of at most `MAX_STEP`, but into at most
        `MAX_STEPS` intervals. The ends of these intervals are further nodes.

        Every stop also has an interval from its beginning to the next node. Therefore, the nodes
        and the stops do not depend on the beginnings of other stops.

        Parameters
        ----------
        motion : Trajectory
            The motion.
        robot : Robot
            Robot with its rigid-body dynamics.
        instants : (n,) array
            Instants that divide the path, in s from the start of the motion. An instant that is
            nearer to a break than `MIN_BREAK_DISTANCE` does not become a node.
        stop_times : (k,) array
            Instants at which a stop begins, in s from the start of the motion. An instant that is
            nearer to a node than `MIN_BREAK_DISTANCE` is moved to the node.

        Returns
        -------
        _StopPath
            The path with m intervals. The first k of them begin where the stops begin.
        """
        breaks = motion.breaks - motion.breaks[0]
        is_node = np.abs(_nearest_nodes(breaks, instants) - instants) >= MIN_BREAK_DISTANCE
        nodes = np.union1d(breaks, instants[is_node])
        distances = np.diff(nodes)
        # The small number prevents that rounding adds an interval to a multiple of MAX_STEP.
        steps = np.clip(np.ceil(distances / MAX_STEP - 1e-9), 1, MAX_STEPS).astype(int)
        interval, offset = part_indices(steps)
        nodes = np.append(offset * (distances / steps)[interval] + nodes[interval], nodes[-1])
        stop_times = np.clip(stop_times, 0.0, nodes[-1])
        nearest = _nearest_nodes(nodes, stop_times)
        stop_times = np.where(
            np.abs(nearest - stop_times) < MIN_BREAK_DISTANCE, nearest, stop_times
        )
        # A stop at the end of the motion has an empty interval.
        end_nodes = np.minimum(np.searchsorted(nodes, stop_times, "right"), len(nodes) - 1)
        s = np.append(stop_times, nodes)
        s_end = np.append(nodes[end_nodes], nodes[1:])
        following = np.append(end_nodes, np.arange(1, len(nodes))) + len(stop_times)
        starts = motion.sample(motion.breaks[0] + s[:-1], "right")
        ends = motion.sample(motion.breaks[0] + s_end, "left")
        q = np.stack([starts.q, ends.q])
        dq = np.stack([starts.qd, ends.qd])
        ddq = np.stack([starts.qdd, ends.qdd])
        body = RigidBody.from_robot(robot)
        path_load = body.path_load(q.reshape(-1, 4), dq.reshape(-1, 4), ddq.reshape(-1, 4))
        inertia, velocity, gravity = (term.reshape(q.shape) for term in path_load)
        node_speeds = np.abs(np.append(dq[0], dq[1, -1:], axis=0))
        rests = np.all(node_speeds <= rest_speeds(robot), axis=1)
        return cls(
            s,
            s_end - s[:-1],
            following,
            q,
            dq=dq,
            ddq=ddq,
            effort_terms=(inertia, velocity, gravity),
            rests=rests,
        )


def _nearest_nodes(nodes: Array, t: Array) -> Array:
    """Return the nearest of ordered nodes to each of n instants, (n,)."""
    return nodes[np.searchsorted((nodes[1:] + nodes[:-1]) / 2, t)]


def quickest_stops(
    motion: Trajectory,
    robot: Robot,
    instants: int | Array = INSTANTS,
    limits: TaskLimits | None = None,
) -> StopMotions:
    """Compute the quickest stops from instants of a motion.

    A stop never continues beyond an instant at which the motion rests. Long motions are therefore
    divided into legs between rests, which are processed one by one. A stop does not depend on the
    instants of the other stops.

    Parameters
    ----------
    motion : Trajectory
        The motion.
    robot : Robot
        The robot, whose limits of accelerations and motor torques the stops keep.
    instants : int or (n,) array
        Number of evenly spaced instants, or the instants in s from the start of the motion.
    limits : TaskLimits, optional
        Limits of the task, which the stops of a robot with jerk limits keep. Stops along the path
        keep all limits that the motion keeps. The default is the ranges of the robot.

    Returns
    -------
    StopMotions
        The stops in the order of time. Their instants may differ from the requested instants by
        less than `MIN_BREAK_DISTANCE`.
    """
    if isinstance(instants, int):
        instants = np.linspace(0.0, motion.duration, instants)
    times = np.sort(np.asarray(instants, float))
    if robot.jerk_limited:
        task_limits = limits or TaskLimits(robot.limits)
        pieces = compute_joint_stops(motion, robot, task_limits, times)
        return _measure_stops(times, pieces, robot, ends_at_rest=True)
    first_pieces = _leg_starts(motion, robot)
    starts = motion.breaks[first_pieces] - motion.breaks[0]
    grid = np.linspace(0.0, motion.duration, INSTANTS)
    inner_starts = starts[1:]
    times_of_legs = np.split(times, np.searchsorted(times, inner_starts))
    grids = np.split(grid, np.searchsorted(grid, inner_starts))
    piece_ranges = pairwise(first_pieces + [len(motion.breaks) - 1])
    legs = []
    for (first_piece, end_piece), start, leg_times, leg_grid in zip(
        piece_ranges, starts, times_of_legs, grids, strict=True
    ):
        breaks = motion.breaks[first_piece : end_piece + 1]
        leg_motion = Trajectory(breaks, motion.pieces(slice(first_piece, end_piece)), ())
        legs.append(_stops_of_leg(leg_motion, robot, leg_times - start, leg_grid - start))
    lengths = np.concatenate([leg.pieces[0] for leg in legs])
    coefficients = np.concatenate([leg.pieces[1] for leg in legs])
    piece_counts = np.concatenate([np.diff(leg.edges) for leg in legs])
    return StopMotions(
        np.concatenate([leg.time + start for leg, start in zip(legs, starts, strict=True)]),
        np.concatenate([leg.duration for leg in legs]),
        np.concatenate([leg.travel for leg in legs]),
        (lengths, coefficients),
        edges=np.append(0, np.cumsum(piece_counts)),
        ends_at_rest=legs[-1].ends_at_rest,
    )


def _leg_starts(motion: Trajectory, robot: Robot) -> list[int]:
    """Divide a motion into legs that begin at rest, with at least `MIN_LEG_PIECES` pieces each.

    Parameters
    ----------
    motion : Trajectory
        The motion.
    robot : Robot
        Robot whose velocity limits determine the rest speeds (see `rest_speeds`).

    Returns
    -------
    list of int
        Index of the first piece of each leg. The first entry is 0.
    """
    speeds = np.abs(motion.sample(motion.breaks).qd)
    first_pieces = [0]
    for break_index in np.flatnonzero((speeds <= rest_speeds(robot)).all(axis=1)):
        pieces_before = break_index - first_pieces[-1]
        breaks_after = len(motion.breaks) - break_index
        if pieces_before >= MIN_LEG_PIECES and breaks_after > MIN_LEG_PIECES:
            first_pieces.append(int(break_index))
    return first_pieces


def _stops_of_leg(motion: Trajectory, robot: Robot, times: Array, instants: Array) -> StopMotions:
    """Compute the quickest stops in one leg of a motion.

    A leg is a part of the motion that ends at a rest or at the end of the motion.

    Parameters
    ----------
    motion : Trajectory
        The leg as a trajectory.
    robot : Robot
        Robot whose limits must hold.
    times : (n,) array
        Instants at which the stops begin, in s from the start of the leg.
    instants : array
        Instants that divide the path, in s from the start of the leg.

    Returns
    -------
    StopMotions
        The stops. Times count from the start of the leg.
    """
    path = _StopPath.from_motion(motion, robot, instants, times)
    # Where no limit bounds s̈, divisions by 0 give infinite bounds.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        stops = _advance_stops(path, robot, len(times))
    return _measure_stops(path.s[: len(times)], stops, robot, ends_at_rest=bool(path.rests[-1]))


def _measure_stops(
    times: Array, stops: tuple[Array, Array, Indices], robot: Robot, *, ends_at_rest: bool
) -> StopMotions:
    """Compute the duration and the tip travel of n stops from their pieces.

    Parameters
    ----------
    times : (n,) array
        Instants at which the stops begin, s.
    stops : tuple
        Durations (m,) and coefficients (m, 6, 4) of the pieces of all stops, and index (n + 1,) of
        the first piece of each stop, with the number of pieces as its last entry.
    robot : Robot
        Robot whose kinematics determine the position of the tip.
    ends_at_rest : bool
        True if the motion ends at rest.

    Returns
    -------
    StopMotions
        The stops. The travel of a stop is the largest distance over its breaks.
    """
    lengths, coefficients, edges = stops
    duration = np.zeros(len(times))
    travel = np.zeros(len(times))
    moving = np.flatnonzero(np.diff(edges))
    if len(moving):
        first_pieces = edges[:-1][moving]
        last_pieces = edges[1:][moving] - 1
        final_pieces = coefficients[last_pieces].transpose(1, 2, 0)
        final_positions = polyval(lengths[last_pieces], final_pieces, tensor=False).T
        mechanism = Mechanism.from_robot(robot)
        tips = tip_position(mechanism, coefficients[:, 0])
        final_tips = tip_position(mechanism, final_positions)
        start_tips = tips[first_pieces]
        piece_counts = np.diff(edges)[moving]
        distances = np.linalg.norm(tips - np.repeat(start_tips, piece_counts, axis=0), axis=1)
        final_distances = np.linalg.norm(final_tips - start_tips, axis=1)
        duration[moving] = np.add.reduceat(lengths, first_pieces)
        travel[moving] = np.maximum(np.maximum.reduceat(distances, first_pieces), final_distances)
    return StopMotions(
        times, duration, travel, (lengths, coefficients), edges, ends_at_rest=ends_at_rest
    )


def _advance_stops(path: _StopPath, robot: Robot, count: int) -> tuple[Array, Array, Indices]:
    """Advance n stops from the first n intervals of a path until they rest.

    All stops advance together, by one interval of the path in each step. In an interval, s̈ is
    constant and has the smallest value that the limits allow. If the path is too short for a stop,
    the robot still moves at the end of this stop.

    Parameters
    ----------
    path : _StopPath
        Path of the motion.
    robot : Robot
        Robot whose limits must hold.
    count : int
        Number n of stops.

    Returns
    -------
    lengths : (m,) array
        Durations of the pieces, s.
    coefficients : (m, 6, 4) array
        Coefficients of powers of the time since the start of the piece.
    edges : (n + 1,) array
        Index of the first piece of each stop, and the number of pieces.
    """
    # A stop that begins at the end of the motion does not enter an interval.
    stop = np.flatnonzero(path.lengths[:count] > 0)
    k = stop
    x = np.ones(len(stop))
    bounds = _DecelerationBounds.from_path(path, robot)
    rows: list[tuple[Any, ...]] = []
    while True:
        # k is the interval that a stop enters, x = ṡ² at its start, and u = s̈ within it.
        going = ~path.rests[k] & (k < len(path.lengths)) & (x > 0)
        stop = stop[going]
        k = k[going]
        x = x[going]
        if not len(stop):
            break
        length = path.lengths[k]
        u = bounds.smallest_acceleration(k, x, ends=False)
        # d(ṡ²)/ds = 2 s̈, so a constant s̈ changes ṡ² by 2 s̈ times the length of the interval.
        ends = np.flatnonzero(x + 2 * u * length <= 0)
        if len(ends):
            u[ends] = np.maximum(u[ends], bounds.smallest_acceleration(k[ends], x[ends], ends=True))
        next_x = x + 2 * u * length
        ended = next_x <= 0
        next_x = np.where(ended, 0.0, next_x)
        travel = np.where(ended, x / np.where(ended, -2 * u, 1.0), length)
        rows.append((stop, k, x, u, next_x, travel))
        k = path.following[k]
        x = next_x
    if not rows:
        return np.zeros(0), np.zeros((0, DEGREE + 1, 4)), np.zeros(count + 1, dtype=int)
    columns = [np.concatenate(column) for column in zip(*rows, strict=True)]
    return _pieces_from_steps(path, count, columns)


@record
class _DecelerationBounds:
    """Lower bounds of s̈ on the m intervals of a path.

    Let x = ṡ². Each limit is evaluated at three states of an interval. These are its start with a
    given x, its end with the x that follows from s̈, and its end with a given x. Every acceleration
    and torque is linear in s̈, x and √x there, except for friction that depends on the speed.
    """

    path: _StopPath
    robot: Robot
    terms: Array
    """Coefficients c₀, c₁ and c₂ of the bounds s̈ ≥ c₀ + c₁ x + c₂ √x, (3, rows, 3 m).

    Each row belongs to a limit. The columns contain the first state of all intervals, then the
    second state, and then the third one.
    """
    single_rows: int
    """Number of leading rows that are bounds by themselves.

    The other rows belong to motors that brake. They form two halves, because the friction law is
    the larger of two linear functions. Of two rows at the same position of both halves, only the
    smaller one is a bound.
    """
    speed_dependent_joints: tuple[int, ...]
    """Joints whose friction depends on the speed. Their torques are not among the rows."""

    @classmethod
    def from_path(cls, path: _StopPath, robot: Robot) -> "_DecelerationBounds":
        """Compute the bounds that follow from all acceleration limits and torque limits.

        The torque in the direction of motion is the larger of two linear functions, because of
        friction. It must not exceed its limit when the motor drives, so both functions give a
        bound. When the motor brakes, the torque must not fall below the negative limit. This holds
        if one of both functions stays above it.

        Parameters
        ----------
        path : _StopPath
            Path of the motion with m intervals.
        robot : Robot
            Robot with its acceleration limits, drives and motors.

        Returns
        -------
        _DecelerationBounds
            The bounds on all intervals.
        """
        m = len(path.lengths)
        # The three states of an interval: its start, its end after s̈ has changed ṡ², and its end
        # with a given ṡ². Only in the second state does ṡ² grow with s̈.
        end = np.repeat([0, 1, 1], m)
        interval = np.tile(np.arange(m), 3)
        square_growth = np.concatenate([np.zeros(m), 2 * path.lengths, np.zeros(m)])
        dq = path.dq[end, interval]
        ddq = path.ddq[end, interval]
        # |a s̈ + q'' ṡ²| ≤ limit bounds s̈ from below by −limit/|a| − (q''/a) ṡ².
        a = dq + square_growth[:, None] * ddq
        limit = robot.accelerations * (1 - LIMIT_REDUCTION)
        moves = a != 0
        constant = np.where(moves, -limit / np.abs(a), -np.inf)
        with_square = np.where(moves, -ddq / a, 0.0)
        single_bounds = [np.stack([constant, with_square, np.zeros_like(a)])]
        # Rows of braking motors: bounds of the first and of the second linear function.
        halves: tuple[list[Array], list[Array]] = ([], [])
        speed_dependent: list[int] = []
        for i, drive, _ in motorised_joints(robot.joints):
            if required_friction(drive).stribeck_speed is not None:
                speed_dependent.append(i)
                continue
            motor = _MotorOnPath.from_joint(
                path, robot.joints[i], (end, interval, i), square_growth
            )
            zero = np.zeros(3 * m)
            ones = np.ones(3 * m)
            # The torques are linear in (s̈, ṡ², ṡ), so four evaluations give all coefficients.
            at_zero = motor.row_torques(zero, zero, zero)
            slopes = motor.row_torques(ones, zero, zero) - at_zero
            square_terms = motor.row_torques(zero, ones, zero) - at_zero
            root_terms = motor.row_torques(zero, zero, ones) - at_zero
            for row, slope in enumerate(slopes):
                offsets = np.stack([at_zero[row], square_terms[row], root_terms[row]])
                single_bounds.append(motor.acceleration_bound(slope, offsets)[:, :, None])
                halves[row].append(motor.acceleration_bound(-slope, -offsets)[:, :, None])
        all_rows = single_bounds + halves[0] + halves[1]
        terms = np.concatenate(all_rows, axis=2).transpose(0, 2, 1)
        count = sum(term.shape[2] for term in single_bounds)
        return cls(
            path,
            robot,
            np.ascontiguousarray(terms),
            single_rows=count,
            speed_dependent_joints=tuple(speed_dependent),
        )

    def smallest_acceleration(self, k: Indices, x: Array, *, ends: bool) -> Array:
        """Compute the smallest s̈ (the hardest braking) that keeps all limits on n intervals.

        Parameters
        ----------
        k : (n,) array
            Indices of the intervals.
        x : (n,) array
            ṡ² at the starts of these intervals.
        ends : bool
            True if the stop ends within each interval. The limits are then checked at the start of
            the interval with the given ṡ², and at both of its ends with ṡ = 0.

        Returns
        -------
        (n,) array
            The smallest s̈. The result is at most 0, because a stop never accelerates.
        """
        n = len(k)
        lengths = self.path.lengths
        m = len(lengths)
        at_rest = np.zeros(n)
        # States of the interval (0, 1 or 2, as in `terms`), and the value of ṡ² in each of them.
        states = (0, 2, 0) if ends else (0, 1)
        squares = [x, at_rest, at_rest] if ends else [x, x]
        square = np.concatenate(squares)
        columns = np.concatenate([state * m + k for state in states])
        # A column of `terms` contains the bounds by all limits in one state of one interval.
        c0, c1, c2 = self.terms[:, :, columns]
        values = c0 + c1 * square + c2 * np.sqrt(square)
        bound = values[: self.single_rows].max(axis=0)
        half = (len(values) - self.single_rows) // 2
        if half:
            first_half, second_half = np.split(values[self.single_rows :], 2)
            bound = np.maximum(bound, np.minimum(first_half, second_half).max(axis=0))
        end = np.repeat(np.minimum(states, 1), n)
        interval = np.tile(k, len(states))
        for i in self.speed_dependent_joints:
            square_growth = np.where(columns // m == 1, 2 * lengths[interval], 0.0)
            motor = _MotorOnPath.from_joint(
                self.path, self.robot.joints[i], (end, interval, i), square_growth, square
            )
            bound = np.maximum(bound, motor.smallest_acceleration(square))
        return np.minimum(bound.reshape(len(states), n).max(axis=0), 0.0)


@record
class _MotorOnPath:
    """A motor at n positions of a path, with the law of its torque.

    The law consists of two linear functions of the joint effort, called rows. The torque in the
    direction of motion is the larger one of both.

    Attributes
    ----------
    joint : Joint
        The joint with its drive and motor.
    rows : TorqueRows
        The friction law in the direction of motion.
    sigma : (n,) array
        Direction of the joint: −1, 0 or 1.
    dq, ddq : (n,) arrays
        First and second derivative of the joint position by the path parameter s.
    effort_terms : tuple of three (n,) arrays
        Coefficients a, b and c of the effort a s̈ + b ṡ² + c of the joint.
    """

    joint: Joint
    rows: TorqueRows
    sigma: Array
    dq: Array
    ddq: Array
    effort_terms: tuple[Array, Array, Array]
    square_growth: Array
    """Increase of ṡ² per unit of s̈ since the start of the interval, (n,). 0 if ṡ² is given."""

    @classmethod
    def from_joint(
        cls,
        path: _StopPath,
        joint: Joint,
        index: tuple[Indices, Indices, int],
        square_growth: Array,
        square: Array | float = 0.0,
    ) -> "_MotorOnPath":
        """Build the motor of one joint at n positions of a path.

        Parameters
        ----------
        path : _StopPath
            Path of the planned motion.
        joint : Joint
            A joint with a drive and a motor.
        index : tuple
            For each position, the end of its interval (0 for the start, 1 for the end, (n,)) and
            the index of its interval (n,). The last entry is the index of the joint.
        square_growth : (n,) array
            Increase of ṡ² per unit of s̈ since the start of the interval.
        square : (n,) array or float
            ṡ², which determines the motor speed and thereby the friction coefficient.

        Returns
        -------
        _MotorOnPath
            The motor with its friction law at these positions.
        """
        assert joint.drive is not None
        dq = path.dq[index]
        inertia, velocity, gravity = path.effort_terms
        sigma = np.sign(dq)
        motor_speed = joint.drive.ratio * dq * np.sqrt(square)
        mu = friction_coefficient(required_friction(joint.drive), motor_speed)
        return cls(
            joint,
            motor_torque_rows(joint.drive, sigma, mu),
            sigma,
            dq=dq,
            ddq=path.ddq[index],
            effort_terms=(inertia[index], velocity[index], gravity[index]),
            square_growth=square_growth,
        )

    def row_torques(self, u: Array, square: Array, root: Array) -> Array:
        """Compute the motor torque by both linear functions (rows) of its law.

        Parameters
        ----------
        u, square, root : (n,) arrays
            s̈, ṡ² and ṡ at the positions. They are independent arguments, so that the caller can
            determine the coefficient of each of them.

        Returns
        -------
        (2, n) array
            Motor torques in the direction of motion, N·m, one row for each function.
        """
        drive = self.joint.drive
        assert drive is not None
        inertia, velocity, gravity = self.effort_terms
        grown_square = square + self.square_growth * u
        speed = self.dq * root
        acceleration = self.dq * u + self.ddq * grown_square
        rigid_effort = inertia * u + velocity * grown_square + gravity
        effort = output_effort(drive, rigid_effort, speed, acceleration, self.sigma)
        motor_speed = drive.ratio * speed
        motor_acceleration = drive.ratio * acceleration
        torques = [
            self.rows.torque(slope * effort, motor_speed, motor_acceleration)
            for slope in self.rows.slope
        ]
        return self.sigma * np.array(torques)

    def acceleration_bound(self, slope: Array, offset: Array) -> Array:
        """Compute the smallest s̈ at which a torque slope · s̈ + offset does not exceed its limit.

        The offset is linear in other variables, and so is the result.

        Parameters
        ----------
        slope : (n,) array
            Change of the torque with s̈. s̈ is only bounded from below where it is negative.
        offset : (terms, n) array
            Constant part of the offset, and its coefficients of the other variables.

        Returns
        -------
        (terms, n) array
            The bound as a constant and the coefficients of the same variables. The constant is −∞
            if the torque does not bound s̈ from below.
        """
        assert self.joint.motor is not None
        limit = np.zeros((len(offset), 1))
        limit[0] = self.joint.motor.max_torque * (1 - LIMIT_REDUCTION)
        bounds = (slope < 0) & (self.sigma != 0)
        unbounded = np.zeros_like(limit)
        unbounded[0] = -np.inf
        return np.where(bounds, (limit - offset) / slope, unbounded)

    def smallest_acceleration(self, square: Array) -> Array:
        """Return the smallest s̈ that keeps the torque limit of the motor.

        The limit applies both to a driving motor and to a braking motor.

        Parameters
        ----------
        square : (n,) array
            ṡ² at the positions.

        Returns
        -------
        (n,) array
            Lower bounds of s̈, which are −∞ at positions where the torque does not bound s̈ from
            below.
        """
        root = np.sqrt(square)
        zero = np.zeros(len(square))
        driving = np.full(len(square), -np.inf)
        braking = np.full(len(square), np.inf)
        at_zero = self.row_torques(zero, square, root)
        slopes = self.row_torques(zero + 1, square, root) - at_zero
        for offset, slope in zip(at_zero, slopes, strict=True):
            driving = np.maximum(driving, self.acceleration_bound(slope, offset[None])[0])
            # Each row is a lower bound of the torque in the direction of motion.
            braking = np.minimum(braking, self.acceleration_bound(-slope, -offset[None])[0])
        return np.maximum(driving, braking)


def _pieces_from_steps(
    path: _StopPath, count: int, columns: list[Array]
) -> tuple[Array, Array, Indices]:
    """Build the polynomial pieces of all stops from their steps along the path of the motion.

    Parameters
    ----------
    path : _StopPath
        Path of the planned motion.
    count : int
        Number of stops.
    columns : list of six (m,) arrays
        For each of m steps: index of the stop, index of the interval, ṡ² before the step, s̈, ṡ²
        after the step, and length of the step in s of the motion.

    Returns
    -------
    lengths : (m,) array
        Durations of the pieces, s.
    coefficients : (m, 6, 4) array
        Coefficients of powers of the time since the start of the piece.
    edges : (count + 1,) array
        Index of the first piece of each stop, and the number of pieces.
    """
    order = np.argsort(columns[0], kind="stable")
    stop, k, x, u, end_x, travel = (column[order] for column in columns)
    # In Fortran order, the values of a joint are adjacent, so the operations below are fast.
    q, q_end = [np.asfortranarray(values[k]) for values in path.q]
    dq, dq_end = [np.asfortranarray(values[k]) for values in path.dq]
    ddq, ddq_end = [np.asfortranarray(values[k]) for values in path.ddq]
    h = path.lengths[k]
    # A stop may end within an interval. A quintic through both ends gives the path there.
    within = np.flatnonzero(travel < h)
    begins = (q[within], dq[within], ddq[within])
    ends = (q_end[within], dq_end[within], ddq_end[within])
    inner = quintic_coefficients(h[within], begins, ends).transpose(1, 2, 0)
    q_end[within] = polyval(travel[within], inner, tensor=False).T
    dq_end[within] = polyval(travel[within], polyder(inner), tensor=False).T
    root = np.sqrt(x)[:, None]
    end_root = np.sqrt(end_x)[:, None]
    u = u[:, None]
    # s̈ is constant in a step, so the mean of ṡ is the mean of its values at both ends.
    dt = 2 * travel / (root + end_root)[:, 0]
    # q̇ = q' ṡ and q̈ = q' s̈ + q'' ṡ² at both ends of each step
    start = q, dq * root, dq * u + ddq * x[:, None]
    finish = q_end, dq_end * end_root, dq_end * u + ddq_end * end_x[:, None]
    return dt, quintic_coefficients(dt, start, finish), np.searchsorted(stop, np.arange(count + 1))
