"""Blocks of consecutive polynomial pieces of a motion, and the extremes of these polynomials.

Each piece is a polynomial of s, which runs from 0 at its start to 1 at its end. `check` goes
through a motion in blocks (`piece_blocks`), which bounds the memory for long motions.
`update_polynomial_extremes` then finds the exact worst values of positions, velocities,
accelerations, jerks and motor speeds.

The first axis of every array counts pieces. Arrays are in Fortran order, because the operations run
along values that are then adjacent in memory.
"""

from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import zip_longest

import numpy as np

from ssm_planner.dynamics import REST_FRACTION
from ssm_planner.problem import Robot
from ssm_planner.trajectory import DEGREE, Trajectory, blocks
from ssm_planner.typing import Array, Indices, Mask, record
from ssm_planner.verification import bernstein
from ssm_planner.verification.limits import WorstValue

JointState = tuple[Array, Array, Array]
"""Joint positions q, velocities qd and accelerations qdd, (…, 4) each, in SI units."""

PIECES_PER_BLOCK = 8192
"""Largest number of pieces that are evaluated together, which bounds the memory."""
EXTREME_ACCURACY = 1e-10
"""Accuracy of the extreme of a polynomial, as a share of half the width of its limit."""


@record
class PieceBlock:
    """m consecutive pieces as polynomials of s = (t − start)/length.

    Four joints have position q, velocity qd, acceleration qdd and jerk qddd.
    """

    start: Array
    """Start times (m,), s."""
    length: Array
    """Durations (m,), s."""
    powers: tuple[Array, ...]
    """Coefficients of the powers of s of q, qd, qdd and qddd, in SI units.

    The four arrays have the shapes (m, 6, 4), (m, 5, 4), (m, 4, 4) and (m, 3, 4): pieces, powers
    from the constant on, and joints.
    """

    @cached_property
    def bernstein_coefficients(self) -> tuple[Array, ...]:
        """Bernstein coefficients of positions, velocities, accelerations and jerks.

        The four arrays have the shapes of `powers`.
        """
        return tuple(bernstein.from_powers(powers) for powers in self.powers)

    @property
    def end_states(self) -> tuple[Array, Array]:
        """States of the joints at the start and at the end of every piece, (m, 3, 4) each.

        The second axis contains q, qd and qdd.
        """
        # A polynomial starts at its first Bernstein coefficient and ends at its last.
        starts, ends = (
            np.stack([values[:, end] for values in self.bernstein_coefficients[:3]], axis=1)
            for end in (0, -1)
        )
        return starts, ends

    @cached_property
    def coefficient_bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of positions, velocities, accelerations and jerks over all pieces.

        Both arrays have the shape (4, 4). The rows are the four quantities, and the columns are the
        joints. A polynomial lies between its smallest and its largest Bernstein coefficient.
        """
        lowest, highest = (
            np.stack([extreme(values, axis=(0, 1)) for values in self.bernstein_coefficients])
            for extreme in (np.min, np.max)
        )
        return lowest, highest

    def evaluate(
        self, index: Indices | slice, s: Array, results: Sequence[Array] | Array = ()
    ) -> JointState:
        """Evaluate the joint positions, velocities and accelerations at instants in n pieces.

        Parameters
        ----------
        index : (n,) array or slice
            Indices of the pieces. A piece may occur several times.
        s : (…, n) array
            Instants, as fractions of the pieces.
        results : three (4, … n) arrays, optional
            Arrays that receive the results, which avoids copies.

        Returns
        -------
        q, qd, qdd : (…, n, 4) arrays
            The values of the four joints, in SI units.
        """
        q, qd, qdd = [
            _evaluate_polynomials(powers.T[..., index], s, values)
            for powers, values in zip_longest(self.powers[:3], results)
        ]
        return q, qd, qdd

    def velocities_at(self, index: Indices, s: Array) -> Array:
        """Evaluate the joint velocities at instants in n pieces.

        Parameters
        ----------
        index : (n,) array
            Indices of the pieces.
        s : (…, n) array
            Instants, as fractions of the pieces.

        Returns
        -------
        (…, n, 4) array
            Joint velocities, rad/s, and m/s for joint 4.
        """
        return _evaluate_polynomials(self.powers[1].T[..., index], s)

    def times_at(self, index: Indices, s: Array) -> Array:
        """Convert fractions of n pieces into times.

        Parameters
        ----------
        index : (n,) array
            Indices of the pieces.
        s : (…, n) array
            Fractions of the pieces.

        Returns
        -------
        (…, n) array
            Times in the motion, s.
        """
        return self.start[index] + s * self.length[index]

    def moving_joints(self, robot: Robot) -> Mask:
        """Find the joints that move within each piece.

        Parameters
        ----------
        robot : Robot
            Robot whose velocity limits determine the rest speeds (see `rest_speeds`).

        Returns
        -------
        (m, 4) array of bool
            True if the joint moves. A speed below its rest speed is a rounding error.
        """
        return np.abs(self.bernstein_coefficients[1]).max(axis=1) > rest_speeds(robot)

    def split_at_reversals(self, robot: Robot) -> tuple[Indices, Array, Array]:
        """Cut the pieces into segments at the instants at which a joint reverses.

        Every joint keeps its direction within a segment, so its friction is a smooth function of
        time there.

        Parameters
        ----------
        robot : Robot
            Robot whose velocity limits determine the rest speeds (see `rest_speeds`).

        Returns
        -------
        piece : (k,) array
            Index of the piece that contains the segment.
        start, end : (k,) arrays
            Start and end of the segment as fractions of the piece.
        """
        indices = np.arange(len(self.start))
        # One row for each pair of joint and piece, all pieces of a joint after each other.
        speeds = self.bernstein_coefficients[1].T.swapaxes(0, 1).reshape(DEGREE, -1).T
        # `cuts` contains the indices of the rows with a reversal, so the remainder is the piece.
        cuts, s = bernstein.find_sign_changes(speeds, np.repeat(rest_speeds(robot), len(indices)))
        owner = np.concatenate([indices, cuts % len(indices)])
        start_s = np.concatenate([np.zeros(len(indices)), s])
        order = np.lexsort((start_s, owner))
        owner = owner[order]
        start_s = start_s[order]
        end = np.append(np.where(owner[1:] == owner[:-1], start_s[1:], 1.0), 1.0)
        keep = end > start_s
        return owner[keep], start_s[keep], end[keep]


def piece_blocks(trajectory: Trajectory) -> Iterator[PieceBlock]:
    """Yield the pieces of a trajectory in blocks of limited size.

    Parameters
    ----------
    trajectory : Trajectory
        The motion.

    Yields
    ------
    PieceBlock
        At most `PIECES_PER_BLOCK` pieces, in the order of time.
    """
    for block in blocks(len(trajectory.breaks) - 1, PIECES_PER_BLOCK):
        lengths = np.diff(trajectory.breaks[block.start : block.stop + 1])
        yield build_piece_block(trajectory.breaks[block], lengths, trajectory.pieces(block))


def build_piece_block(start: Array, length: Array, coefficients: Array) -> PieceBlock:
    """Build a block of pieces on s ∈ [0, 1] from polynomials in time.

    Parameters
    ----------
    start, length : (m,) arrays
        Start times and durations of the pieces, s.
    coefficients : (m, 6, 4) array
        Coefficients of powers of the time since the start of the piece.

    Returns
    -------
    PieceBlock
        The same polynomials in s = (t − start)/length, with their derivatives by time.
    """
    scales = (length ** np.arange(DEGREE + 1)[:, None]).T
    # In Fortran order, the values of one coefficient of one joint are adjacent in memory.
    powers = [np.asfortranarray(coefficients) * scales[:, :, None]]
    for order in range(3):
        exponents = np.arange(1, DEGREE + 1 - order)
        powers.append(powers[-1][:, 1:] * exponents[:, None] / length[:, None, None])
    return PieceBlock(start, length, tuple(powers))


def rest_speeds(robot: Robot) -> Array:
    """Return the speeds up to which the joints count as being at rest.

    Parameters
    ----------
    robot : Robot
        Robot with the velocity limits of its joints.

    Returns
    -------
    (4,) array
        The share `REST_FRACTION` of the velocity limits, which covers rounding errors, in rad/s and
        m/s.
    """
    return robot.velocities * REST_FRACTION


def jerk_limits(robot: Robot) -> Array:
    """Return the largest jerks of the joints, which are infinite without a limit.

    Parameters
    ----------
    robot : Robot
        Robot with the limits of its joints.

    Returns
    -------
    (4,) array
        Largest jerks, rad/s³, and m/s³ for joint 4.
    """
    return np.array([np.inf if joint.jerk is None else joint.jerk for joint in robot.joints])


def _evaluate_polynomials(powers: Array, s: Array, result: Array | None = None) -> Array:
    """Evaluate the polynomials Σ_k powers[:, k] s^k of four joints by Horner's rule.

    Parameters
    ----------
    powers : (4, degree + 1, n) array
        Coefficients of the powers for each joint and each of n pieces.
    s : (…, n) array
        Arguments.
    result : (4, … n) array, optional
        Array that receives the values.

    Returns
    -------
    (…, n, 4) array
        The values. The last axis counts joints.
    """
    # Additional axes of length 1 let NumPy broadcast the coefficients along those of s.
    shape = (4,) + (1,) * (s.ndim - 1) + powers.shape[-1:]
    descending = [powers[:, k].reshape(shape) for k in reversed(range(powers.shape[1]))]
    value = np.multiply(
        descending[0], s, out=None if result is None else result.reshape((4,) + s.shape)
    )
    value += descending[1]
    for coefficient in descending[2:]:
        value *= s
        value += coefficient
    return np.moveaxis(value, 0, -1)


def update_polynomial_extremes(pieces: PieceBlock, extremes: Sequence[WorstValue]) -> None:
    """Update the worst values of the polynomial quantities with a block of pieces.

    The Bernstein coefficients bound each quantity within the block. The exact extreme is computed
    only if this bound is worse than the worst value so far. Both ends of the permitted range are
    treated as upper bounds: the lower end as an upper bound of the negative quantity.

    Parameters
    ----------
    pieces : PieceBlock
        Polynomial pieces of the motion.
    extremes : sequence of WorstValue
        Worst values of all quantities, which the function updates. Quantities without `order` are
        not polynomials and are skipped.
    """
    lowest, highest = pieces.coefficient_bounds
    for order, coefficients in enumerate(pieces.bernstein_coefficients):
        # Worst values to improve, and signs with which their quantities have upper bounds
        candidates: list[tuple[WorstValue, float]] = []
        table = []  # joint, factor, upper bound, half width and value to exceed of each candidate
        for extreme in extremes:
            quantity = extreme.quantity
            if quantity.order != order:
                continue
            limit = quantity.limit
            joint = quantity.index
            for sign, bound in ((1.0, limit.high), (-1.0, -limit.low)):
                factor = sign * quantity.scale
                largest = max(factor * lowest[order, joint], factor * highest[order, joint])
                # Value of the quantity at which it is as bad as the worst value so far.
                threshold = bound + extreme.excess * limit.half_width
                if largest > threshold:
                    candidates.append((extreme, sign))
                    table.append((joint, factor, bound, limit.half_width, threshold))
        if not candidates:
            continue
        joints, factors, bounds, half_widths, thresholds = np.array(table).T
        groups = coefficients.T[joints.astype(int)] * factors[:, None, None]
        values, index, s = bernstein.find_group_maxima(
            groups, EXTREME_ACCURACY * half_widths, thresholds
        )
        excesses = (values - bounds) / half_widths
        times = pieces.times_at(index, s)
        for k, (extreme, sign) in enumerate(candidates):
            extreme.update(float(excesses[k]), float(sign * values[k]), float(times[k]))
