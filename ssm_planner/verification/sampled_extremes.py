"""Extremes of quantities that are not polynomials in time.

These quantities are the motor torques, the contact of nuts, the task coordinates and their rates,
the speeds of the tool, and the distances in an eye. `check` passes the blocks of a motion to
`SampledExtremes.search`.

Sampling: Every piece is cut where a joint reverses, and then into intervals. The quantities are
evaluated at four instants of each interval: at its start, at a third, at two thirds and at its end.
The joints keep their directions within an interval, so the friction is smooth there.

Bracketing: A bracket is a lower and an upper bound of a quantity within an interval. The cubic
through the four values lies between its Bernstein coefficients. The search assumes that a quantity
exceeds the four values by at most `OVERSHOOT_FACTOR` times as much as these coefficients do. A
quantity with kinks (`LimitedQuantity.has_kinks`) may also continue with the slope between two of
the instants.

Refinement: The intervals of the first pass are `FIRST_PASS_PARTS` times as wide as the rate
requires. The search cuts three kinds of intervals into `FIRST_PASS_PARTS` parts: those whose
bracket exceeds the worst value so far, those in which the square of a torque is not close to a
parabola, and those next to a start, a stop or a reversal, where friction changes quickly. It then
halves the intervals whose brackets exceed the worst value by more than `BRACKET_TOLERANCE` times
the limit, until none is left. According to the brackets, no other interval contains a worse value.

`RmsTorques` integrates the torques at these instants.
"""

import math
from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

from ssm_planner.codegen import VectorisedFunction, casadi_namespace, dense_function
from ssm_planner.dynamics import (
    REST_FRACTION,
    RigidBody,
    drive_torque,
    motor_torque_symbolic,
    nut_contact_force,
    with_payload,
)
from ssm_planner.kinematics import (
    SPEED_JACOBIANS,
    Mechanism,
    eye_limits,
    nearest_turn,
    task_from_joints_symbolic,
    task_rates_symbolic,
    tip_position_symbolic,
)
from ssm_planner.problem import (
    ContinuousTorque,
    Eye,
    Limit,
    MotorTorque,
    NutContact,
    Robot,
    SpeedLimit,
    TaskRange,
    TaskRate,
    unchecked_copy,
)
from ssm_planner.trajectory import Trajectory, blocks, part_indices
from ssm_planner.typing import Array, Indices, Mask, record
from ssm_planner.verification.certificate import LimitCheck
from ssm_planner.verification.limits import JUMP_TOLERANCE, LimitedQuantity, WorstCase, WorstValue
from ssm_planner.verification.pieces import JointState, PieceBlock, rest_speeds

BRACKET_TOLERANCE = 1e-8
"""Largest possible excess over the worst value, relative to the limit, at the end of the search."""
OVERSHOOT_FACTOR = 2.0
"""Ratio of the assumed overshoot of a quantity to that of the cubic through its four values.

The overshoot is the distance by which a function exceeds its sampled values.
"""
FIRST_PASS_PARTS = 5
"""Number of parts into which an interval of the first pass may be cut."""
MEAN_SQUARE_TOLERANCE = 1e-8
"""Relative contribution to a mean square torque above which an interval is refined."""
MAX_DIVISIONS = 10
"""Largest number of divisions of an interval after the first pass."""
MAX_FIRST_PASS_INTERVALS = 40_000
"""Approximate largest number of intervals of a trajectory in the first pass.

A slow quintic is as smooth as a fast one, so the cost grows with the number of pieces and not with
the duration.
"""
PIECE_INTERVALS_RANGE = (64, 512)
"""Smallest and largest value that the bound on the number of intervals in a piece can have.

The bound is `MAX_FIRST_PASS_INTERVALS` divided by the number of pieces.
"""
MAX_HALVED_INTERVALS = 2048
"""Largest number of intervals that are halved in one pass.

If more intervals could contain a worse value, those with the worst brackets are halved.
"""
INTERVALS_PER_BLOCK = 2500
"""Number of intervals that are sampled together, so that the arrays fit into the cache."""
INTERVAL_FRACTIONS = np.array([0.0, 1.0, 2.0, 3.0])[:, None] / 3
"""Instants of an interval as fractions of its width."""
SIMPSON_WEIGHTS = np.array([1.0, 3.0, 3.0, 1.0]) / 8
"""Weights of the four instants for the mean over an interval (Simpson's 3/8 rule).

The mean is exact for cubics.
"""
RADAU_WEIGHTS = np.array([0.0, 3.0, 0.0, 1.0]) / 4
"""Weights for the mean without the first instant (Radau's rule with two points).

The mean is exact for parabolas.
"""


class SampledExtremes:
    """Searches the worst values of the sampled quantities of a robot, block by block.

    The sampled quantities are those that are not polynomials in time, such as motor torques. An
    array with the values of k quantities has the shape (n, k) for n instants, or (4, n, k) for the
    four instants of n intervals.

    Attributes
    ----------
    worst_values : list of WorstValue
        The worst values of the sampled quantities, which the search updates.
    rms : RmsTorques
        The mean square torques.
    instants : int
        Number of instants that were sampled.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        robot: Robot,
        extremes: Sequence[WorstValue],
        *,
        rate: float,
        eye: Eye | None,
    ) -> None:
        """Prepare the search.

        Parameters
        ----------
        trajectory : Trajectory
            Motion that is checked.
        robot : Robot
            Robot whose limits must hold.
        extremes : sequence of WorstValue
            Worst values of all quantities. The search updates those that are not polynomials.
        rate : float
            Sampling rate of the second pass, Hz. The first pass has a fifth of it.
        eye : Eye or None
            The eye, whose distances are limited.
        """
        self.robot = robot
        self.rate = rate
        self.worst_values = [item for item in extremes if item.quantity.order is None]
        self.quantities = tuple(item.quantity for item in self.worst_values)
        keys = tuple(
            (type(item.limit), item.limit.name, item.index, item.case) for item in self.quantities
        )
        # These keys, the robot and the eye determine the compiled function. The values of the
        # limits do not matter.
        self._evaluate_quantities: VectorisedFunction | None = None
        if keys:
            self._evaluate_quantities = _quantity_function(_without_limits(robot), eye, keys)
        self.has_kinks = np.array([quantity.has_kinks for quantity in self.quantities])
        self.rms = RmsTorques(self.quantities)
        self.instants = 0
        intervals_per_piece = MAX_FIRST_PASS_INTERVALS // (len(trajectory.breaks) - 1)
        smallest, largest = PIECE_INTERVALS_RANGE
        self.max_piece_intervals = int(np.clip(intervals_per_piece, smallest, largest))

    def search(self, pieces: PieceBlock) -> None:
        """Update the worst values and the mean square torques with a block of pieces.

        The search samples the block in intervals. It then divides those intervals that may contain
        a worse value, until no such interval is left (see the docstring of this module).

        Parameters
        ----------
        pieces : PieceBlock
            The polynomial pieces that follow those of the previous call.
        """
        if not self.quantities:
            return
        piece_index, start, end = pieces.split_at_reversals(self.robot)
        rate = self.rate / FIRST_PASS_PARTS
        most_intervals = math.ceil(self.max_piece_intervals / FIRST_PASS_PARTS)
        intervals = SampledIntervals.from_segments(
            pieces, self.robot, piece_index, start, end, rate=rate, max_intervals=most_intervals
        )
        for level in range(MAX_DIVISIONS + 1):
            if not len(intervals.piece):
                break
            values = self._sample(pieces, intervals)
            lowest, highest = bracket_values(values, self.has_kinks)
            gain = self._gain(lowest, highest)
            duration = intervals.width * pieces.length[intervals.piece]
            if level == 0:
                is_inaccurate = self.rms.needs_refinement(values, duration)
                open_indices = np.flatnonzero((gain > 0) | intervals.near_rest | is_inaccurate)
                duration[open_indices] = 0.0  # the parts of these intervals are integrated instead
            else:
                open_indices = np.flatnonzero(gain > 0)
                if len(open_indices) > MAX_HALVED_INTERVALS:
                    order = np.argsort(gain[open_indices])
                    open_indices = open_indices[order[-MAX_HALVED_INTERVALS:]]
            if level < 2:  # later intervals are parts of integrated intervals
                self.rms.add_intervals(values, intervals.starting, duration)
            intervals = intervals.split(open_indices, FIRST_PASS_PARTS if level == 0 else 2)

    def evaluate(self, state: JointState, direction: Array, breakaway: Array) -> Array:
        """Compute the values of all quantities at n states.

        Parameters
        ----------
        state : tuple of three (n, 4) arrays
            q, qd and qdd.
        direction : (n, 4) array
            Direction of each joint: −1, 0 or 1.
        breakaway : (n, 4) array
            1 where the joint starts from rest, so that its friction is static. 0 elsewhere.

        Returns
        -------
        (n, k) array
            Values in SI units, in the order of the quantities.
        """
        assert self._evaluate_quantities is not None
        values = self._evaluate_quantities(*state, direction, breakaway)[0]
        for k, quantity in enumerate(self.quantities):
            # Angles that differ by whole turns are equal. The one within half a turn of 0 counts.
            if isinstance(quantity.limit, TaskRange):
                values[:, k] = nearest_turn(values[:, k], 0.0)
            elif isinstance(quantity.limit, NutContact):
                drive = self.robot.joints[quantity.index].drive
                if drive is not None:
                    motor_acceleration = drive.ratio * state[2][:, quantity.index]
                    values[:, k] = nut_contact_force(drive, values[:, k], motor_acceleration)
        return values

    def _sample(self, pieces: PieceBlock, intervals: "SampledIntervals") -> Array:
        """Evaluate the quantities at the four instants of n intervals, and update the worst values.

        Parameters
        ----------
        pieces : PieceBlock
            The block that contains the intervals.
        intervals : SampledIntervals
            The intervals.

        Returns
        -------
        (4, n, k) array
            Values of the k quantities in SI units.
        """
        values = np.empty((len(self.quantities), 4, len(intervals.piece))).transpose(1, 2, 0)
        for block in blocks(len(intervals.piece), INTERVALS_PER_BLOCK):
            self._sample_block(pieces, intervals.subset(block), values[:, block])
        return values

    def _sample_block(
        self, pieces: PieceBlock, intervals: "SampledIntervals", values: Array
    ) -> None:
        """Evaluate the quantities in a block of n intervals, and update the worst values.

        An interval whose end is the start of the next one is evaluated at three instants only. Its
        fourth value is the first value of the next interval.

        Parameters
        ----------
        pieces : PieceBlock
            The block of pieces that contains the intervals.
        intervals : SampledIntervals
            The intervals.
        values : (4, n, k) array
            Array that receives the values of the k quantities.
        """
        final = np.flatnonzero(~intervals.shares_end)
        s = intervals.begin + INTERVAL_FRACTIONS[:3] * intervals.width
        end = np.minimum(intervals.begin[final] + intervals.width[final], 1.0)
        states = np.empty((3, 4, s.size + len(final)))
        pieces.evaluate(intervals.piece, s, states[..., : s.size])
        pieces.evaluate(intervals.piece[final], end, states[..., s.size :])
        q, qd, qdd = (state.T for state in states)
        # Each interval has three instants, and a final interval has a fourth one.
        columns = [intervals.direction.T] * 3 + [intervals.direction[final].T]
        direction = np.concatenate(columns, axis=1).T
        static = np.zeros_like(direction)
        static[: len(intervals.piece)] = intervals.starting
        results = self.evaluate((q, qd, qdd), direction, static)
        time = np.append(
            pieces.times_at(intervals.piece, s), pieces.times_at(intervals.piece[final], end)
        )
        self.instants += len(time)
        for entry, value in zip(self.worst_values, results.T, strict=True):
            excess = entry.quantity.excess(value, value)
            k = int(np.argmax(excess))
            entry.update(float(excess[k]), float(value[k]), float(time[k]))
        values[:3] = results[: s.size].reshape(3, len(intervals.piece), -1)
        values[3, :-1] = values[0, 1:]
        values[3, final] = results[s.size :]

    def _gain(self, lowest: Array, highest: Array) -> Array:
        """Compute by how much n intervals may exceed the worst values found so far.

        Parameters
        ----------
        lowest, highest : (n, k) arrays
            Bounds of the k quantities within the intervals.

        Returns
        -------
        (n,) array
            Largest increase of the relative excess over a limit (`LimitedQuantity.excess`), minus
            `BRACKET_TOLERANCE`. An interval with a positive value must be divided.
        """
        gains = [
            item.quantity.excess(low, high) - item.excess - BRACKET_TOLERANCE
            for item, low, high in zip(self.worst_values, lowest.T, highest.T, strict=True)
        ]
        return np.max(gains, axis=0)


def bracket_values(values: Array, has_kinks: Mask) -> tuple[Array, Array]:
    """Estimate lower and upper bounds of quantities within intervals.

    The estimate assumes that the quantities resemble cubics. The cubic through the values v0 … v3
    has the inner Bernstein coefficients

        (−5 v0 + 18 v1 − 9 v2 + 2 v3)/6   and   (2 v0 − 9 v1 + 18 v2 − 5 v3)/6.

    The upper bound is the largest value plus `OVERSHOOT_FACTOR` times the amount by which these
    coefficients exceed it. The lower bound is formed in the same way. For a quantity with kinks,
    the largest difference of neighbouring values widens both bounds.

    Parameters
    ----------
    values : (4, n, k) array
        Values of k quantities at the `INTERVAL_FRACTIONS` of n intervals.
    has_kinks : (k,) array of bool
        True for quantities that may have a kink within an interval.

    Returns
    -------
    lowest, highest : (n, k) arrays
        Bounds of each quantity in each interval.
    """
    v0, v1, v2, v3 = values
    near_start = (-5 * v0 + 18 * v1 - 9 * v2 + 2 * v3) / 6
    near_end = (2 * v0 - 9 * v1 + 18 * v2 - 5 * v3) / 6
    highest = values.max(axis=0)
    lowest = values.min(axis=0)
    over = np.maximum(np.maximum(near_start, near_end) - highest, 0.0)
    under = np.maximum(lowest - np.minimum(near_start, near_end), 0.0)
    corner = has_kinks * np.abs(np.diff(values, axis=0)).max(axis=0)
    return lowest - OVERSHOOT_FACTOR * under - corner, highest + OVERSHOOT_FACTOR * over + corner


@record
class SampledIntervals:
    """n intervals of time, each within one piece of a motion, for which quantities are sampled.

    Each joint keeps its direction within an interval.
    """

    piece: Indices
    """Index of the piece that contains the interval, (n,)."""
    begin: Array
    """Start of the interval as a fraction of the piece, (n,)."""
    width: Array
    """Width of the interval as a fraction of the piece, (n,)."""
    direction: Array
    """Direction of each joint: −1, 1, or 0 at rest, (n, 4)."""
    starting: Mask
    """True if the joint starts from rest where the interval begins, (n, 4).

    Its friction is static at this instant.
    """
    shares_end: Mask
    """True if the interval ends where the next one in the arrays begins, (n,).

    The quantities have the same values on both sides of this instant.
    """
    near_rest: Mask
    """True if a joint starts, stops or reverses at an end of the interval, (n,)."""

    @classmethod
    def from_segments(
        cls,
        pieces: PieceBlock,
        robot: Robot,
        piece: Indices,
        start: Array,
        end: Array,
        *,
        rate: float,
        max_intervals: int,
    ) -> "SampledIntervals":
        """Cut m segments of pieces into intervals of equal width.

        Each joint keeps its direction within a segment (`PieceBlock.split_at_reversals`).

        Parameters
        ----------
        pieces : PieceBlock
            Polynomial pieces of the motion.
        robot : Robot
            Robot whose limits must hold.
        piece : (m,) array
            Index of the piece of each segment.
        start, end : (m,) arrays
            Ends of each segment as fractions of its piece.
        rate : float
            Sampling rate (Hz), which determines the number of intervals.
        max_intervals : int
            Largest number of intervals in a segment.

        Returns
        -------
        SampledIntervals
            The intervals, in the order of the segments.
        """
        # No joint reverses within a segment, so its direction is that of its speed in the middle.
        at_begin, middle, at_end = pieces.velocities_at(
            piece, np.stack([start, (start + end) / 2, end])
        )
        direction = np.sign(middle) * pieces.moving_joints(robot)[piece]
        # Where a joint changes its direction, the velocity may jump by JUMP_TOLERANCE, so the joint
        # may start with such a speed.
        previous_direction = np.vstack([np.zeros(4), direction[:-1]])
        rest_multiple = np.where(
            direction == previous_direction, 1.0, JUMP_TOLERANCE / REST_FRACTION
        )
        start_speed = rest_multiple * rest_speeds(robot)
        starting = (np.abs(at_begin) <= start_speed) & (direction != 0)
        stopping = (np.abs(at_end) <= start_speed) & (direction != 0)
        # An interval of four instants spans three sampling periods.
        # The small number prevents that rounding adds an interval.
        periods = (end - start) * pieces.length[piece] * rate
        counts = np.clip(np.ceil(periods / 3 - 1e-3).astype(int), 1, max_intervals)
        segment, offset = part_indices(counts)
        width = ((end - start) / counts)[segment]
        is_first = offset == 0
        is_last = offset == counts[segment] - 1
        starts_slowly = is_first & starting.any(axis=1)[segment]
        ends_slowly = is_last & stopping.any(axis=1)[segment]
        return cls(
            piece[segment],
            start[segment] + offset * width,
            width,
            direction[segment],
            starting=starting[segment] & is_first[:, None],
            shares_end=~is_last,
            near_rest=starts_slowly | ends_slowly,
        )

    def subset(self, selection: slice) -> "SampledIntervals":
        """Select the intervals of a slice.

        Parameters
        ----------
        selection : slice
            Positions of the selected intervals in the arrays.

        Returns
        -------
        SampledIntervals
            The intervals. `shares_end` is False for the last one, because the interval that starts
            at its end is not selected.
        """
        columns = {name: values[selection] for name, values in vars(self).items()}
        columns["shares_end"] = np.append(columns["shares_end"][:-1], False)
        return SampledIntervals(**columns)

    def split(self, indices: Indices, count: int) -> "SampledIntervals":
        """Select intervals, and cut each of them into equal parts.

        Parameters
        ----------
        indices : (n,) array
            Indices of the intervals.
        count : int
            Number of parts of each interval.

        Returns
        -------
        SampledIntervals
            The parts. Those of one interval follow each other.
        """
        parent = np.repeat(indices, count)
        offset = np.tile(np.arange(count), len(indices))
        width = self.width[parent] / count
        is_first = offset == 0
        return SampledIntervals(
            self.piece[parent],
            self.begin[parent] + offset * width,
            width,
            self.direction[parent],
            starting=self.starting[parent] & is_first[:, None],
            shares_end=offset < count - 1,
            near_rest=self.near_rest[parent],
        )


class RmsTorques:
    """Integrates the square of every motor torque over a motion.

    The mean of the squared torque determines the heat in the motor. A start from rest takes no
    time. Its static friction counts as a peak torque, but it does not contribute to the heat.

    Attributes
    ----------
    torques : dict of LimitedQuantity
        The motor torques by their index among the quantities.
    integrals : array
        ∫ τ² dt of each motor torque so far, N²·m²·s.
    """

    def __init__(self, quantities: Sequence[LimitedQuantity]) -> None:
        """Select the motor torques among the quantities, and start with empty integrals.

        Parameters
        ----------
        quantities : sequence of LimitedQuantity
            The sampled quantities, in the order of their columns.
        """
        self.torques = {
            k: quantity
            for k, quantity in enumerate(quantities)
            if isinstance(quantity.limit, MotorTorque)
        }
        self.integrals = np.zeros(len(self.torques))

    def needs_refinement(self, values: Array, duration: Array) -> Mask:
        """Find the intervals in which the square of a torque is not nearly a parabola.

        The numerical integral of such an interval is inaccurate, so the search divides it.

        Parameters
        ----------
        values : (4, n, k) array
            Values of all quantities at the instants of n intervals.
        duration : (n,) array
            Durations of the intervals, s.

        Returns
        -------
        (n,) array of bool
            True where the third difference of the squares, times the duration of the interval,
            exceeds `MEAN_SQUARE_TOLERANCE` times the integral over all intervals.
        """
        squares = values[:, :, list(self.torques)] ** 2
        # The third difference v0 − 3 v1 + 3 v2 − v3 of a parabola is 0.
        third = np.abs(squares[0] - squares[3] + 3 * (squares[2] - squares[1])) * duration[:, None]
        return np.any(third > MEAN_SQUARE_TOLERANCE * (duration @ squares[1]), axis=1)

    def add_intervals(self, values: Array, starting: Mask, duration: Array) -> None:
        """Add the integrals of the squared torques over n intervals.

        Parameters
        ----------
        values : (4, n, k) array
            Values of all quantities at the instants of the intervals.
        starting : (n, 4) array of bool
            True if the joint starts from rest there. Its torque at the first instant does not
            count.
        duration : (n,) array
            Durations of the intervals, s. Intervals with 0 add nothing.
        """
        for i, (column, quantity) in enumerate(self.torques.items()):
            square = values[:, :, column] ** 2
            starts = starting[:, quantity.index]
            mean = np.where(starts, RADAU_WEIGHTS @ square, SIMPSON_WEIGHTS @ square)
            self.integrals[i] += (mean * duration).sum()

    def results(self, robot: Robot, trajectory: Trajectory, pause: float) -> list[LimitCheck]:
        """Compare the RMS torque of each motor with its continuous torque.

        Call this method after all pieces were added.

        Parameters
        ----------
        robot : Robot
            Robot whose limits must hold.
        trajectory : Trajectory
            Motion that is checked.
        pause : float
            Time before the motion repeats, s. It counts as time without torque.

        Returns
        -------
        list of LimitCheck
            One result for each motor and each case of friction and payload. Its time is the end of
            the motion.
        """
        checks = []
        end = float(trajectory.breaks[-1])
        for quantity, integral in zip(self.torques.values(), self.integrals, strict=True):
            limit = robot.joints[quantity.index].limit(ContinuousTorque)
            rms = float(np.sqrt(integral / (trajectory.duration + pause)))
            case = None if quantity.case is None else quantity.case.description
            checks.append(LimitCheck.from_extreme(limit, rms, end, case))
        return checks


def _without_limits(robot: Robot) -> Robot:
    """Return a copy of a robot without limits and motors.

    The values of the sampled quantities do not depend on limits and motors. Robots that differ only
    in these therefore share one compiled function (see `_quantity_function`).

    Parameters
    ----------
    robot : Robot
        The robot.

    Returns
    -------
    Robot
        The copy, whose values are not checked.
    """
    joints = tuple(
        unchecked_copy(
            joint,
            position=(0.0, 0.0),
            velocity=0.0,
            acceleration=0.0,
            jerk=None,
            motor=None,
            alternatives=(),
        )
        for joint in robot.joints
    )
    return unchecked_copy(robot, joints=joints, limits=())


@lru_cache(maxsize=8)
def _quantity_function(
    robot: Robot, eye: Eye | None, keys: tuple[tuple[type[Limit], str, int, WorstCase | None], ...]
) -> VectorisedFunction:
    """Build the compiled function that evaluates all sampled quantities.

    The functions for the last eight arguments are cached, because compiling takes long.

    Parameters
    ----------
    robot : Robot
        Robot without limits and motors.
    eye : Eye or None
        Eye that limits the tool, if the task states one.
    keys : tuple
        One entry for each of k quantities: type and name of its limit, index of its joint or task
        coordinate, and its worst case or None.

    Returns
    -------
    VectorisedFunction
        Function of five (n, 4) arrays: joint positions, velocities and accelerations, directions
        (−1, 0 or 1), and 1 where a joint starts from rest (0 elsewhere). It returns the values
        (n, k) in SI units. For a nut contact, the value is the effort that the drive transmits.
    """
    arguments = [ca.SX.sym(name, 4) for name in ("q", "qd", "qdd", "direction", "breakaway")]
    q, qd, qdd, direction, breakaway = arguments
    mechanism = Mechanism.from_robot(robot)
    tau, torque, effort = motor_torque_symbolic(robot, q, qd, qdd, direction, breakaway=breakaway)
    task = task_from_joints_symbolic(mechanism, q)
    rates = task_rates_symbolic(mechanism, q, qd)
    tip = tip_position_symbolic(mechanism, q)
    eye_values = {}
    if eye is not None:
        eye_values = eye_limits(casadi_namespace(), eye, tuple(ca.vertsplit(tip)))
    rows: list[ca.SX] = []
    loads = {0.0: tau}
    for limit_type, name, i, case in keys:
        if case is not None:
            if case.payload not in loads:
                body = RigidBody.from_robot(with_payload(robot, case.payload))
                loads[case.payload] = body.symbolic(q, qd, qdd)
            load = loads[case.payload][i]
            case_torque, *_ = drive_torque(
                case.drive, load, qd[i], qdd[i], direction[i], breakaway=breakaway[i]
            )
            rows.append(case_torque)
        elif issubclass(limit_type, MotorTorque):
            rows.append(torque[i])
        elif issubclass(limit_type, NutContact):
            rows.append(effort[i])
        elif issubclass(limit_type, SpeedLimit):
            rows.append(ca.norm_2(SPEED_JACOBIANS[limit_type](mechanism, q) @ qd))
        elif issubclass(limit_type, TaskRate):
            rows.append(rates[i])
        elif issubclass(limit_type, TaskRange):
            rows.append(task[i])
        else:
            rows.append(eye_values[name][0])
    return VectorisedFunction(dense_function("limits", arguments, [ca.vertcat(*rows)]))
