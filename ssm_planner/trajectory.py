"""Represent joint motions as piecewise polynomials in time.

The planner computes motions in this form, the check verifies them, and the exports evaluate them at
many times. The main class is `Trajectory`. The functions at the end of the module compute
polynomial coefficients from the states at the ends of a piece, and join phases to a trajectory.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.arguments import check_methods
from ssm_planner.errors import TrajectoryError
from ssm_planner.representation import data_frame, html_table
from ssm_planner.typing import Array, Indices, JsonObject, frozen, record

DEGREE = 5
"""Degree of the polynomials."""
SHORTEST_PIECE = 1e-12
"""Smallest duration of a piece, s."""
LARGEST_TIME = 1e9
"""Largest absolute time, s."""
LARGEST_DISPLACEMENT = 1e9
"""Largest displacement (rad or m) that one term of a polynomial may give within its piece.

The derivatives of larger terms overflow.
"""
PIECES_PER_BLOCK = 65_536
"""Number of pieces that are evaluated together, which bounds the memory in use."""
LARGEST_SAMPLE_COUNT = 10_000_000
"""Largest number of samples of a motion, whose arrays need about 1.5 GB."""
TIME_ROUNDING = 1e-9
"""Rounding error by which a time may lie outside the trajectory.

It is relative to the largest absolute time of the trajectory, or to 1 s for smaller times.
"""
Side = Literal["left", "right"]
"""Side from which a motion is evaluated at a break, where its acceleration may jump."""


@frozen
class Span:
    """Named section of a trajectory between two times in s.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.load_plan("results/tilt_insert").motion.phases[0].name
    'tilt'
    """

    name: str
    """Name of the motion in the problem."""
    start: float
    """Time at the start, s."""
    end: float
    """Time at the end, s."""


@record
class Samples:
    """Motion of the four joints, evaluated at n times.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> samples = ssm.load_plan("results/tilt_insert").motion.sample([0.1, 0.2, 0.3])
    >>> samples.q.shape, samples.qd.shape
    ((3, 4), (3, 4))
    """

    t: Array
    """Times (n,), s."""
    q: Array
    """Joint positions (n, 4), rad for joints 1 to 3 and m for joint 4."""
    qd: Array
    """Joint velocities (n, 4), rad/s for joints 1 to 3 and m/s for joint 4."""
    qdd: Array
    """Joint accelerations (n, 4), rad/s² for joints 1 to 3 and m/s² for joint 4."""
    qddd: Array
    """Joint jerks (n, 4), rad/s³ for joints 1 to 3 and m/s³ for joint 4."""

    def to_dataframe(self) -> Any:
        """Return the samples as a pandas DataFrame with one row for each time.

        The columns are t (s), q1 … q4, qd1 … qd4, qdd1 … qdd4 and qddd1 … qddd4: positions in rad
        (joints 1 to 3) and m (joint 4), and their first three derivatives with respect to s.

        Raises
        ------
        SsmPlannerError
            If pandas is not installed.
        """
        columns = {"t": self.t}
        for name in ("q", "qd", "qdd", "qddd"):
            values = getattr(self, name)
            columns |= {f"{name}{i + 1}": values[:, i] for i in range(4)}
        return data_frame(columns)


@check_methods
@record
class Trajectory:
    """Joint motion of m polynomial pieces: q(t) = Σ_k coefficients[i, k] (t − breaks[i])^k.

    Parameters
    ----------
    breaks : (m + 1,) array
        Strictly increasing times in s. The piece i begins at breaks[i].
    coefficients : (m, 6, 4) array
        Coefficients of each piece, power k and joint, in rad/s^k for joints 1 to 3 and in m/s^k for
        joint 4. An object that returns them for a slice of pieces is accepted, too.
    phases : tuple of Span
        Named sections that follow one another. Empty if the sections are not named.

    Raises
    ------
    TrajectoryError
        If the shapes disagree, the breaks do not increase, or a number is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from ssm_planner import Trajectory
    >>> t = np.linspace(0.0, 1.0, 11)
    >>> q = 0.1 * np.outer(3 * t**2 - 2 * t**3, [1.0, 1.0, 0.0, 0.01])
    >>> trajectory = Trajectory.from_samples(t, q)
    >>> trajectory.duration
    1.0
    >>> trajectory.sample(0.5).q.round(6).tolist()
    [[0.05, 0.05, 0.0, 0.0005]]
    """

    breaks: Array
    coefficients: Array
    phases: tuple[Span, ...]

    _array_error = TrajectoryError

    def __post_init__(self) -> None:
        pieces = self.breaks.size - 1
        if pieces < 1 or self.coefficients.shape != (pieces, DEGREE + 1, 4):
            raise TrajectoryError(
                f"a trajectory of {pieces} pieces needs coefficients of shape "
                f"({pieces}, {DEGREE + 1}, 4), got {self.coefficients.shape}"
            )
        if np.isfinite(self.breaks).all():
            self._check_breaks()
        for block in blocks(pieces, PIECES_PER_BLOCK):
            self._check_pieces(block)
        self.breaks.setflags(write=False)
        if isinstance(self.coefficients, np.ndarray):
            self.coefficients.setflags(write=False)

    def _check_breaks(self) -> None:
        """Check that the breaks increase and are in the permitted range.

        Raises
        ------
        TrajectoryError
            If the breaks do not increase, a piece is shorter than `SHORTEST_PIECE`, or a time is
            beyond `LARGEST_TIME`.
        """
        shortest = np.diff(self.breaks).min()
        if shortest <= 0:
            raise TrajectoryError("the breaks of a trajectory must increase")
        if shortest < SHORTEST_PIECE or np.abs(self.breaks[[0, -1]]).max() > LARGEST_TIME:
            raise TrajectoryError(
                f"a piece shorter than {SHORTEST_PIECE:g} s, or times beyond {LARGEST_TIME:g} s"
            )

    def _check_pieces(self, block: slice) -> None:
        """Check the coefficients of some pieces.

        Parameters
        ----------
        block : slice
            Indices of the pieces.

        Raises
        ------
        TrajectoryError
            If a break or a coefficient is not finite, or if a term of a polynomial exceeds
            `LARGEST_DISPLACEMENT` at the end of its piece.
        """
        coefficients = self.pieces(block)
        if not (np.isfinite(self.breaks).all() and np.isfinite(coefficients).all()):
            raise TrajectoryError("a trajectory holds only finite numbers")
        lengths = np.diff(self.breaks[block.start : block.stop + 1])[:, None, None]
        with np.errstate(over="ignore"):
            shifted = np.abs(coefficients) * lengths ** np.arange(DEGREE + 1)[:, None]
        if shifted.max() > LARGEST_DISPLACEMENT:
            raise TrajectoryError(
                f"a piece moves by more than {LARGEST_DISPLACEMENT:g} rad or m: "
                "its coefficients are invalid"
            )

    @classmethod
    def from_samples(
        cls, t: ArrayLike, q: ArrayLike, qd: ArrayLike | None = None, qdd: ArrayLike | None = None
    ) -> Trajectory:
        """Interpolate samples of a joint motion.

        Parameters
        ----------
        t : (n,) array-like
            Strictly increasing times in s.
        q : (n, 4) array-like
            Joint positions, in rad for joints 1 to 3 and in m for joint 4.
        qd : (n, 4) array-like, optional
            Joint velocities in rad/s and m/s. By default, they are those of a cubic spline through
            the positions that is at rest at both ends.
        qdd : (n, 4) array-like, optional
            Joint accelerations in rad/s² and m/s². Without them, every piece is a cubic polynomial.

        Returns
        -------
        Trajectory
            Motion with one piece between each two samples.

        Raises
        ------
        TrajectoryError
            If there are fewer than two samples, the shapes disagree, accelerations are given
            without velocities, a number is not finite, or the times do not increase.
        """
        if qd is None and qdd is not None:
            raise TrajectoryError("samples with accelerations qdd need velocities qd")
        times, states = _sample_arrays(t, [x for x in (q, qd, qdd) if x is not None])
        if qd is None:
            from scipy.interpolate import CubicSpline

            states.append(CubicSpline(times, states[0], bc_type="clamped")(times, 1))
        interpolate = cubic_coefficients if qdd is None else quintic_coefficients
        starts = tuple(values[:-1] for values in states)
        ends = tuple(values[1:] for values in states)
        return cls(times, interpolate(np.diff(times), starts, ends), ())

    def _repr_html_(self) -> str:
        """Return the duration and a table of the phases as HTML, which notebooks display."""
        return f"<p>{self.duration:.6g} s</p>{html_table([vars(span) for span in self.phases])}"

    @property
    def duration(self) -> float:
        """Time between the first and the last break, s."""
        return float(self.breaks[-1] - self.breaks[0])

    def pieces(self, index: Indices | slice) -> Array:
        """Return the coefficients of some pieces.

        Parameters
        ----------
        index : (n,) array or slice
            Indices of the pieces.

        Returns
        -------
        (n, 6, 4) array
            Coefficients of each piece, power k and joint, in rad/s^k for joints 1 to 3 and in m/s^k
            for joint 4.
        """
        return self.coefficients[index]

    def piece_of(self, t: Array, side: Side = "right") -> Indices:
        """Return the index of the piece that contains each of n times.

        Parameters
        ----------
        t : (n,) array
            Times (s). A time outside the trajectory belongs to the first or to the last piece.
        side : {"right", "left"}
            Piece to which a time exactly at a break belongs: the piece after or before the break.

        Returns
        -------
        (n,) array
            Indices of the pieces.
        """
        index = np.searchsorted(self.breaks, t, side) - 1
        return np.clip(index, 0, len(self.breaks) - 2)

    def sample(self, t: ArrayLike, side: Side = "right", *, clamp: bool = False) -> Samples:
        """Evaluate the motion and its first three derivatives at given times.

        Parameters
        ----------
        t : (n,) array or float
            Times (s) between the first and the last break.
        side : {"right", "left"}
            Side from which the motion is evaluated at a break, where the acceleration may jump.
        clamp : bool
            True to replace a time outside the trajectory by the nearest end instead of raising an
            error.

        Returns
        -------
        Samples
            Arrays (n, 4) with one row for each time, and (1, 4) for a single time.

        Raises
        ------
        TrajectoryError
            If a time is NaN, or if `clamp` is false and a time lies outside the trajectory.
        """
        times = self._clipped_times(t, clamp)
        index = self.piece_of(times, side)
        return self.sample_pieces(index, times - self.breaks[index])

    def _clipped_times(self, t: ArrayLike, clamp: bool = False) -> Array:
        """Return times as an array (n,), and replace those outside the trajectory by its ends.

        Parameters
        ----------
        t : (n,) array or float
            Times (s).
        clamp : bool
            True to accept any time. Otherwise, a time may lie outside by `TIME_ROUNDING`.

        Raises
        ------
        TrajectoryError
            If the shape is wrong, a time is NaN, or a time lies outside.
        """
        times = np.atleast_1d(np.asarray(t, dtype=float))
        if times.ndim != 1:
            raise TrajectoryError(f"t has shape {times.shape}: must be one time, or (n,)")
        start, end = self.breaks[[0, -1]]
        clipped = np.clip(times, start, end)
        distance = np.abs(times - clipped)
        tolerance = np.inf if clamp else TIME_ROUNDING * max(1.0, abs(start), abs(end))
        if np.isnan(distance).any() or distance.max(initial=0.0) > tolerance:
            raise TrajectoryError(
                f"t = {times[distance.argmax()]:g} s is not between {start:g} s and {end:g} s, "
                "the first and the last time of this trajectory"
            )
        return clipped

    def sample_pieces(self, index: Indices, local: Array) -> Samples:
        """Evaluate the motion and its first three derivatives within given pieces.

        Unlike `sample`, the function does not search the piece of each time.

        Parameters
        ----------
        index : (n,) array
            Indices of the pieces.
        local : (n,) array
            Times since the beginning of each piece (s).

        Returns
        -------
        Samples
            Motion at these n times.
        """
        q, qd, qdd, qddd = self._derivatives(index, local, 3)
        return Samples(self.breaks[index] + local, q, qd, qdd, qddd)

    def positions(self, t: Array) -> Array:
        """Evaluate the joint positions without derivatives, in blocks that need little memory.

        Parameters
        ----------
        t : (n,) array
            Times (s) within the trajectory.

        Returns
        -------
        (n, 4) array
            Joint positions, rad for joints 1 to 3 and m for joint 4.

        Raises
        ------
        TrajectoryError
            If a time lies outside the trajectory.
        """
        t = self._clipped_times(t)
        q = np.empty((len(t), 4), order="F")  # the order of the results of `_derivatives`
        for block in blocks(len(t), PIECES_PER_BLOCK):
            index = self.piece_of(t[block])
            q[block] = self._derivatives(index, t[block] - self.breaks[index], 0)[0]
        return q

    def _derivatives(self, index: Indices, local: Array, highest: int) -> list[Array]:
        """Evaluate the joint positions and their derivatives by Horner's method.

        Parameters
        ----------
        index : (n,) array
            Indices of the pieces.
        local : (n,) array
            Times since the beginning of each piece (s).
        highest : int
            Highest order of the derivatives.

        Returns
        -------
        list of (n, 4) array
            Positions and their derivatives up to this order. Positions are in rad for joints 1 to 3
            and in m for joint 4, and times are in s.
        """
        derivatives = []
        # The values of one coefficient are contiguous in memory, which makes the loop fast.
        coefficients = np.ascontiguousarray(self.pieces(index).transpose(1, 2, 0))
        for order in range(highest + 1):
            value = coefficients[DEGREE - order].copy()
            for k in range(DEGREE - order - 1, -1, -1):
                value *= local
                value += coefficients[k]
            derivatives.append(value.T)
            if order < highest:
                # Coefficients of the next derivative: d/dt c_k t^k = k c_k t^(k − 1).
                coefficients = coefficients[1:] * np.arange(1, DEGREE + 1 - order)[:, None, None]
        return derivatives

    def uniform(self, rate: float) -> Samples:
        """Sample the motion at a fixed rate.

        The last sample is the end of the trajectory, so the last interval may be shorter than the
        others.

        Parameters
        ----------
        rate : float
            Samples per second (Hz).

        Returns
        -------
        Samples
            Motion at the times start, start + 1/rate, … and end.

        Raises
        ------
        TrajectoryError
            If the rate is not above 0, or gives more than `LARGEST_SAMPLE_COUNT` samples.
        """
        if not 0 < rate <= LARGEST_SAMPLE_COUNT / self.duration:
            raise TrajectoryError(
                f"rate = {rate:g} Hz: no sampling rate for {self.duration:g} s "
                f"(allowed: above 0, for at most {LARGEST_SAMPLE_COUNT:,} samples)"
            )
        # The factor compensates for rounding if the duration is a multiple of the interval.
        count = int(np.floor(self.duration * rate * (1 + 1e-12)))
        t = self.breaks[0] + np.arange(count + 1) / rate
        if self.breaks[-1] - t[-1] > 1e-9:
            t = np.append(t, self.breaks[-1])
        t[-1] = self.breaks[-1]
        return self.sample(t)

    def slower(self, speed: float) -> Trajectory:
        """Return the motion along the same path at a constant fraction of its speed.

        The position at the time t is that of the original motion at start + speed · (t − start).
        The start time does not change, and the duration is divided by `speed`.

        Parameters
        ----------
        speed : float
            Speed as a multiple of the original speed, above 0.

        Returns
        -------
        Trajectory
            The slower motion with the same phases.

        Raises
        ------
        TrajectoryError
            If the speed is not above 0, or if the slower motion takes too long.
        """
        if not 0 < speed < np.inf:
            raise TrajectoryError(f"speed = {speed:g}: no speed of a motion (allowed: above 0)")
        start = self.breaks[0]

        def later(time: Any) -> Any:
            """Return the time at which the slower motion has the position of the given time (s)."""
            return start + (time - start) / speed

        # The k-th coefficient is multiplied by speed^k, since local times are stretched.
        powers = speed ** np.arange(DEGREE + 1)[None, :, None]
        phases = [Span(phase.name, later(phase.start), later(phase.end)) for phase in self.phases]
        return Trajectory(later(self.breaks), self.coefficients * powers, tuple(phases))

    def to_dict(self) -> JsonObject:
        """Convert the trajectory to JSON types, as plan.json contains it.

        The keys are "breaks_s" (s), "coefficients" (rad/s^k and m/s^k) and "phases", a list of
        mappings with "name", "start_s" and "end_s" (s).
        """
        return {
            "breaks_s": self.breaks.tolist(),
            "coefficients": self.pieces(slice(None)).tolist(),
            "phases": self._spans(),
        }

    def _spans(self) -> list[JsonObject]:
        """Return the phases as a list of mappings with the keys name, start_s and end_s (s)."""
        return [
            {"name": phase.name, "start_s": phase.start, "end_s": phase.end}
            for phase in self.phases
        ]

    def json_parts(self) -> Iterator[str]:
        """Yield the result of `to_dict` as JSON text in parts.

        A long motion therefore needs little memory. The coefficients of each piece are on one line.
        """
        yield f'{{"breaks_s": {json.dumps(self.breaks.tolist())}, "coefficients": '
        separator = "["
        for block in blocks(len(self.breaks) - 1, PIECES_PER_BLOCK // 64):
            pieces = json.dumps(self.pieces(block).tolist())
            yield separator + pieces[1:-1].replace("]], [[", "]],\n  [[")
            separator = ",\n  "
        yield f'], "phases": {json.dumps(self._spans())}}}'

    @classmethod
    def from_dict(cls, data: JsonObject) -> Trajectory:
        """Build a trajectory from the result of `to_dict`.

        Parameters
        ----------
        data : dict
            Mapping with the keys "breaks_s", "coefficients" and "phases".

        Returns
        -------
        Trajectory
            Motion with at least one phase.

        Raises
        ------
        TrajectoryError
            If a key is missing or a value is invalid, or if the phases do not follow one another
            from the start to the end of the trajectory.
        """
        try:
            phases = tuple(
                Span(str(phase["name"]), float(phase["start_s"]), float(phase["end_s"]))
                for phase in data["phases"]
            )
            breaks = _numbers(data["breaks_s"])
            coefficients = _numbers(data["coefficients"])
            if breaks.ndim != 1 or coefficients.ndim != 3:
                raise ValueError(
                    "breaks_s must be a list of numbers, and coefficients a list of pieces"
                )
        except (KeyError, OverflowError, TypeError, ValueError) as error:
            raise TrajectoryError(f"not the pieces of a trajectory: {error}") from error
        trajectory = cls(breaks, coefficients, phases)
        starts = np.array([phase.start for phase in phases])
        ends = np.array([phase.end for phase in phases])
        # Each phase starts where the phase before it ends.
        is_contiguous = np.allclose(starts, np.append(breaks[0], ends)[:-1], 0, SHORTEST_PIECE)
        if not (phases and is_contiguous and ends[-1] == breaks[-1]):
            raise TrajectoryError(
                "the phases of a trajectory follow one another from its start to its end"
            )
        return trajectory


def _numbers(data: Any) -> Array:
    """Convert nested lists of numbers to an array of floats.

    Parameters
    ----------
    data : nested lists or array
        Numbers. All lists on one level must have the same length.

    Returns
    -------
    array
        The numbers, with one axis for each level of the lists.

    Raises
    ------
    TypeError
        If an entry is not an int or a float, or lists differ in length.
    """
    if not isinstance(data, np.ndarray):
        data = np.array(data, dtype=object)
        if not {int, float}.issuperset(map(type, data.flat)):
            raise TypeError("an entry is not a number, or lists differ in length")
    return np.asarray(data, dtype=float)


def _sample_arrays(t: ArrayLike, values: Sequence[ArrayLike]) -> tuple[Array, list[Array]]:
    """Check the samples of a motion, and convert them to arrays.

    Parameters
    ----------
    t : (n,) array-like
        Times (s).
    values : sequence of (n, 4) array-like
        Joint positions and, if given, their first and second derivatives, in rad (joints 1 to 3), m
        (joint 4) and s.

    Returns
    -------
    times : (n,) array
        The times (s).
    states : list of (n, 4) array
        The positions and their derivatives.

    Raises
    ------
    TrajectoryError
        If there are fewer than two samples, the shapes disagree, the times do not increase, or a
        number is not finite.
    """
    times = np.atleast_1d(np.array(t, dtype=float))
    states = [np.asarray(value, dtype=float) for value in values]
    if len(times) < 2 or any(x.shape != (len(times), 4) for x in states):
        raise TrajectoryError("samples need at least two times t (n,), and rows of four joints")
    if not (np.diff(times) > 0).all() or not np.isfinite(states).all():
        raise TrajectoryError("samples need increasing times and finite numbers")
    return times, states


def blocks(count: int, size: int) -> Iterator[slice]:
    """Divide the indices 0, …, count − 1 into consecutive slices.

    Functions that process many items need less memory if they process one slice after the other.

    Parameters
    ----------
    count : int
        Number of indices.
    size : int
        Largest number of indices in a slice.

    Returns
    -------
    iterator of slice
        The slices. All except the last have `size` indices.
    """
    return (slice(start, min(start + size, count)) for start in range(0, count, size))


def part_indices(counts: Indices) -> tuple[Indices, Indices]:
    """Number the parts into which polynomial pieces are divided.

    For example, the counts (2, 1) give the pieces (0, 0, 1) and the parts (0, 1, 0).

    Parameters
    ----------
    counts : (m,) array
        Number of parts of each of m pieces. Their sum is n.

    Returns
    -------
    piece : (n,) array
        Index of the piece to which each part belongs.
    part : (n,) array
        Index of each part within its piece.
    """
    piece = np.repeat(np.arange(len(counts)), counts)
    number_of_earlier_parts = np.cumsum(counts) - counts
    return piece, np.arange(len(piece)) - number_of_earlier_parts[piece]


def quintic_coefficients(length: Array, start: tuple[Array, ...], end: tuple[Array, ...]) -> Array:
    """Compute quintic polynomials with given states at both ends (Hermite interpolation).

    The three conditions at each end determine the six coefficients c_k of the polynomial
    q(τ) = Σ_k c_k τ^k for 0 ≤ τ ≤ h, where h is the duration of the piece. The pieces need not
    follow one another.

    Parameters
    ----------
    length : (m,) array
        Durations h of the pieces (s).
    start, end : three (m, 4) arrays each
        Joint positions, velocities and accelerations at the start and at the end of every piece, in
        rad (joints 1 to 3), m (joint 4) and s.

    Returns
    -------
    (m, 6, 4) array
        Coefficients c_0 to c_5 of every piece and joint, in rad/s^k for joints 1 to 3 and in m/s^k
        for joint 4.
    """
    h = length[:, None]
    q0, v0, a0 = start
    q1, v1, a1 = end
    # The quadratic polynomial that matches the start misses the end by these scaled differences.
    dq = (q1 - q0 - v0 * h - a0 * h**2 / 2) / h**3
    dv = (v1 - v0 - a0 * h) / h**2
    da = (a1 - a0) / h
    # In a short piece, the rounding of the positions dominates the jerk. If velocities and
    # accelerations give the same displacement within this rounding, they give it more exactly.
    exact = dv / 2 - da / 12
    rounding = 32 * np.finfo(float).eps * np.abs(q1) / h**3
    dq = np.where(np.abs(dq - exact) <= rounding, exact, dq)
    c3 = 10 * dq - 4 * dv + da / 2
    c4 = (-15 * dq + 7 * dv - da) / h
    c5 = (6 * dq - 3 * dv + da / 2) / h**2
    return np.stack([q0, v0, a0 / 2, c3, c4, c5], axis=1)


def cubic_coefficients(length: Array, start: tuple[Array, ...], end: tuple[Array, ...]) -> Array:
    """Compute cubic polynomials with given positions and velocities at both ends.

    By Hermite interpolation with q0 and v0 at the start, q1 and v1 at the end, and the duration h
    of a piece,

        q(τ) = q0 + v0 τ + c2 τ² + c3 τ³   for 0 ≤ τ ≤ h
        c2 = (3 (q1 − q0)/h − 2 v0 − v1) / h
        c3 = (v0 + v1 − 2 (q1 − q0)/h) / h².

    Parameters
    ----------
    length : (m,) array
        Durations h of the pieces (s).
    start, end : two (m, 4) arrays each
        Joint positions and velocities at the start and at the end of every piece, in rad (joints 1
        to 3), m (joint 4) and s.

    Returns
    -------
    (m, 6, 4) array
        Coefficients c_0 to c_5 of every piece and joint, in rad/s^k for joints 1 to 3 and in m/s^k
        for joint 4. c_4 and c_5 are zero.
    """
    h = length[:, None]
    q0, v0 = start
    q1, v1 = end
    slope = (q1 - q0) / h
    zero = np.zeros_like(q0)
    c2 = (3 * slope - 2 * v0 - v1) / h
    c3 = (v0 + v1 - 2 * slope) / h**2
    return np.stack([q0, v0, c2, c3, zero, zero], axis=1)


@record
class CubicPiece:
    """Cubic polynomial u(t) on 0 ≤ t ≤ h with linear acceleration.

    The position u and the velocity v at t = 0, and the accelerations a0 at t = 0 and a1 at t = h
    determine it. With c = t / h and r = a1 − a0:

        ü = a0 + c r
        u̇ = v + t (a0 + c r / 2)
        u(t) = u + t v + t² (a0 / 2 + c r / 6)

    The fields are NumPy arrays or CasADi expressions of compatible shapes.
    """

    u: Any
    """Position at t = 0."""
    v: Any
    """Velocity at t = 0."""
    a0: Any
    """Acceleration at t = 0."""
    a1: Any
    """Acceleration at t = h."""
    h: Any
    """Duration, s."""

    def evaluate(self, c: Any) -> tuple[Any, Any, Any]:
        """Return the position, the velocity and the acceleration at a fraction of the duration.

        Parameters
        ----------
        c : array or expression
            Time as a fraction of the duration h, between 0 and 1.

        Returns
        -------
        position, velocity, acceleration : array or expression
            Values of u, u̇ and ü at this time.
        """
        t = c * self.h
        rise = self.a1 - self.a0
        return (
            self.u + t * (self.v + t * (self.a0 / 2 + c * rise / 6)),
            self.v + t * (self.a0 + c * rise / 2),
            self.a0 + c * rise,
        )

    def at_time(self, t: Any) -> tuple[Any, Any, Any]:
        """Return the position, the velocity and the acceleration at a time within the piece.

        Parameters
        ----------
        t : array or expression
            Time since the start of the piece (s).

        Returns
        -------
        position, velocity, acceleration : array or expression
            Values of u, u̇ and ü at this time.
        """
        a0 = self.a0
        jerk = self.jerk
        return (
            self.u + t * (self.v + t * (a0 / 2 + t * jerk / 6)),
            self.v + t * (a0 + t * jerk / 2),
            a0 + t * jerk,
        )

    @property
    def end(self) -> tuple[Any, Any]:
        """Position u and velocity u̇ at t = h."""
        h = self.h
        position = self.u + h * self.v + h**2 * (self.a0 / 3 + self.a1 / 6)
        velocity = self.v + h * (self.a0 + self.a1) / 2
        return position, velocity

    @property
    def middle_velocity(self) -> Any:
        """Second Bernstein coefficient of the quadratic u̇.

        The first and the third coefficient are the values of u̇ at both ends. A bound that all
        three coefficients satisfy applies to u̇ on the whole piece.
        """
        return self.v + self.h * self.a0 / 2

    @property
    def jerk(self) -> Any:
        """Third derivative of u, which is constant."""
        return (self.a1 - self.a0) / self.h


def rest_coefficients(q: Array) -> Array:
    """Return the coefficients of one piece in which all joints rest.

    Parameters
    ----------
    q : (4,) array
        Joint positions, rad for joints 1 to 3 and m for joint 4.

    Returns
    -------
    (1, 6, 4) array
        Coefficients for `Trajectory`. All except the constant ones are zero.
    """
    coefficients = np.zeros((1, DEGREE + 1, 4))
    coefficients[0, 0] = q
    return coefficients


def join_sections(sections: Sequence[tuple[str, Array, Array]]) -> Trajectory:
    """Join phases to one trajectory, one after the other, from the time 0.

    Parameters
    ----------
    sections : sequence of (str, (m + 1,) array, (m, 6, 4) array)
        Name, breaks (s) and coefficients of each phase with m pieces. The coefficients are in
        rad/s^k for joints 1 to 3 and in m/s^k for joint 4. The breaks of each phase start at 0.

    Returns
    -------
    Trajectory
        Motion with one named phase for each entry.

    Raises
    ------
    TrajectoryError
        If there are no phases.
    """
    if not sections:
        raise TrajectoryError("a trajectory needs at least one phase")
    start = 0.0
    breaks = [np.zeros(1)]
    coefficients = []
    phases = []
    for name, local_breaks, local_coefficients in sections:
        end = float(start + local_breaks[-1])
        breaks.append(start + local_breaks[1:])
        coefficients.append(local_coefficients)
        phases.append(Span(name, start, end))
        start = end
    return Trajectory(np.concatenate(breaks), np.concatenate(coefficients), tuple(phases))
