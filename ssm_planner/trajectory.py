"""Represent joint motions as piecewise polynomials in time.

The planner writes this form, the check judges it, and the exports sample it.
"""

import json
from collections.abc import Iterator, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

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
"""Largest displacement within a piece, rad or m. Derivatives of larger displacements overflow."""
PIECES_PER_BLOCK = 65_536
"""Number of pieces that are evaluated together, which bounds the memory in use."""
TIME_ROUNDING = 1e-9
"""Relative rounding error by which a time may lie outside the trajectory."""
Side = Literal["left", "right"]
"""Side of a break on which a motion is evaluated."""


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
    """Motion that is sampled at n times: t (n,), q, qd, qdd and qddd (n, 4), in rad, m and s.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> samples = ssm.load_plan("results/tilt_insert").motion.sample([0.1, 0.2, 0.3])
    >>> samples.q.shape, samples.qd.shape
    ((3, 4), (3, 4))
    """

    t: Array
    q: Array
    qd: Array
    qdd: Array
    qddd: Array

    def to_dataframe(self) -> Any:
        """Return a pandas DataFrame with the columns t, q1 … q4, qd1 … qddd4 in rad, m and s.

        Raises SsmPlannerError if pandas is not installed.
        """
        columns = {"t": self.t}
        for name in ("q", "qd", "qdd", "qddd"):
            values = getattr(self, name)
            columns |= {f"{name}{i + 1}": values[:, i] for i in range(4)}
        return data_frame(columns)


@record
class Trajectory:
    """Joint motion of m polynomial pieces: q(t) = Σ_k coefficients[i, k] (t − breaks[i])^k.

    Parameters
    ----------
    breaks : (m + 1,)
        Strictly increasing times in s.
    coefficients : (m, 6, 4)
        Coefficients in rad/s^k and m/s^k, or an object that returns them block by block.
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

    def __post_init__(self) -> None:
        pieces = len(self.breaks) - 1
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
        """Raise TrajectoryError unless the breaks increase and are in the permitted range."""
        shortest = np.diff(self.breaks).min()
        if shortest <= 0:
            raise TrajectoryError("the breaks of a trajectory must increase")
        if shortest < SHORTEST_PIECE or np.abs(self.breaks[[0, -1]]).max() > LARGEST_TIME:
            raise TrajectoryError(
                f"a piece shorter than {SHORTEST_PIECE:g} s, or times beyond {LARGEST_TIME:g} s"
            )

    def _check_pieces(self, block: slice) -> None:
        """Raise TrajectoryError if pieces are not finite or move by more than
        `LARGEST_DISPLACEMENT`.
        """
        coefficients = self.pieces(block)
        if not (np.isfinite(self.breaks).all() and np.isfinite(coefficients).all()):
            raise TrajectoryError("a trajectory holds only finite numbers")
        lengths = np.diff(self.breaks)[block, None, None]
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
    ) -> "Trajectory":
        """Interpolate samples of a joint motion.

        Parameters
        ----------
        t : (n,)
            Strictly increasing times in s.
        q, qd, qdd : (n, 4)
            Joint positions, velocities and accelerations in rad, m and s. Missing velocities are
            those of a cubic spline through the positions that is at rest at both ends. Without
            accelerations, every piece is a cubic polynomial.

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
        """Return the duration and the phases as HTML for notebooks."""
        return f"<p>{self.duration:.6g} s</p>{html_table([vars(span) for span in self.phases])}"

    @property
    def duration(self) -> float:
        """Time between the first and the last break, s."""
        return float(self.breaks[-1] - self.breaks[0])

    def pieces(self, index: Indices | slice) -> Array:
        """Return the coefficients (n, 6, 4) of the pieces with these indices, rad/s^k and m/s^k."""
        return self.coefficients[index]

    def piece_of(self, t: Array, side: Side = "right") -> Indices:
        """Return the index (n,) of the piece that contains each time t (n,) in s.

        At a break, `side` selects the piece to its right or to its left.
        """
        index = np.searchsorted(self.breaks, t, side) - 1
        return np.clip(index, 0, len(self.breaks) - 2)

    def sample(self, t: ArrayLike, side: Side = "right", *, clamp: bool = False) -> Samples:
        """Evaluate the motion and its derivatives.

        Parameters
        ----------
        t : (n,) or float
            Times in s between the first and the last break.
        side : {"right", "left"}
            One-sided limit at a break, where the acceleration may jump.
        clamp : bool
            Replace a time outside the trajectory by the nearest end instead of raising an error.

        Returns
        -------
        Samples
            Arrays with one row for each time: (n, 4), and (1, 4) for a single time.

        Raises
        ------
        TrajectoryError
            If a time is NaN, or if `clamp` is false and a time lies outside the trajectory.
        """
        times = np.atleast_1d(np.asarray(t, dtype=float))
        start, end = self.breaks[[0, -1]]
        clipped = np.clip(times, start, end)
        distance = np.abs(times - clipped)
        tolerance = np.inf if clamp else TIME_ROUNDING * max(1.0, abs(start), abs(end))
        if np.isnan(distance).any() or distance.max(initial=0.0) > tolerance:
            raise TrajectoryError(
                f"t = {times[distance.argmax()]:g} s is not between {start:g} s and {end:g} s, "
                "the first and the last time of this trajectory"
            )
        index = self.piece_of(clipped, side)
        return self.sample_pieces(index, clipped - self.breaks[index])

    def sample_pieces(self, index: Indices, local: Array) -> Samples:
        """Evaluate given pieces and their derivatives.

        Parameters
        ----------
        index : (n,)
            Indices of the pieces.
        local : (n,)
            Times since the beginning of each piece, s.

        Returns
        -------
        Samples
            Motion at these n times.
        """
        q, qd, qdd, qddd = self._derivatives(index, local, 3)
        return Samples(self.breaks[index] + local, q, qd, qdd, qddd)

    def positions(self, t: Array) -> Array:
        """Return the joint positions q (n, 4) in rad and m at times t (n,) in s."""
        q = np.empty((len(t), 4), order="F")  # the order of the results of `_derivatives`
        for block in blocks(len(t), PIECES_PER_BLOCK):
            index = self.piece_of(t[block])
            q[block] = self._derivatives(index, t[block] - self.breaks[index], 0)[0]
        return q

    def _derivatives(self, index: Indices, local: Array, highest: int) -> list[Array]:
        """Evaluate q and its derivatives up to order `highest`, each (n, 4), by Horner's method.

        `index` (n,) contains the pieces, and `local` (n,) the times since their beginning in s.
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
                coefficients = coefficients[1:] * np.arange(1, DEGREE + 1 - order)[:, None, None]
        return derivatives

    def uniform(self, rate: float) -> Samples:
        """Sample the motion at a fixed rate in Hz. The last sample is the end of the trajectory."""
        count = int(np.floor(self.duration * rate * (1 + 1e-12)))
        t = self.breaks[0] + np.arange(count + 1) / rate
        if self.breaks[-1] - t[-1] > 1e-9:
            t = np.append(t, self.breaks[-1])
        t[-1] = self.breaks[-1]
        return self.sample(t)

    def slower(self, speed: float) -> "Trajectory":
        """Return the motion along the same path at a share `speed` of its speed.

        The start time does not change.
        """
        start = self.breaks[0]

        def later(time: Any) -> Any:
            """Return the time at which the slower motion reaches the position of a time."""
            return start + (time - start) / speed

        powers = speed ** np.arange(DEGREE + 1)[None, :, None]
        phases = [Span(phase.name, later(phase.start), later(phase.end)) for phase in self.phases]
        return Trajectory(later(self.breaks), self.coefficients * powers, tuple(phases))

    def to_dict(self) -> JsonObject:
        """Convert the trajectory to JSON types, in s, rad and m, as plan.json contains it."""
        return {
            "breaks_s": self.breaks.tolist(),
            "coefficients": self.pieces(slice(None)).tolist(),
            "phases": self._spans(),
        }

    def _spans(self) -> list[JsonObject]:
        """Return the phases as JSON types."""
        return [
            {"name": phase.name, "start_s": phase.start, "end_s": phase.end}
            for phase in self.phases
        ]

    def json_parts(self) -> Iterator[str]:
        """Yield the result of `to_dict` as JSON in parts, with one line for each piece."""
        yield f'{{"breaks_s": {json.dumps(self.breaks.tolist())}, "coefficients": '
        separator = "["
        for block in blocks(len(self.breaks) - 1, PIECES_PER_BLOCK // 64):
            pieces = json.dumps(self.pieces(block).tolist())
            yield separator + pieces[1:-1].replace("]], [[", "]],\n  [[")
            separator = ",\n  "
        yield f'], "phases": {json.dumps(self._spans())}}}'

    @classmethod
    def from_dict(cls, data: JsonObject) -> "Trajectory":
        """Build a trajectory from the result of `to_dict`.

        Raises TrajectoryError if the data are invalid, or if the phases do not cover the
        trajectory.
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
    """Convert nested lists of numbers to an array. Raises TypeError for other entries."""
    if not isinstance(data, np.ndarray):
        data = np.array(data, dtype=object)
        if not {int, float}.issuperset(map(type, data.flat)):
            raise TypeError("an entry is not a number, or lists differ in length")
    return np.asarray(data, dtype=float)


def _sample_arrays(t: ArrayLike, values: Sequence[ArrayLike]) -> tuple[Array, list[Array]]:
    """Convert times (n,) and states (n, 4) of a motion to arrays.

    Raises TrajectoryError if there are fewer than two samples, the shapes disagree, the times do
    not increase, or a number is not finite.
    """
    try:
        times = np.atleast_1d(np.array(t, dtype=float))
        states = [np.asarray(value, dtype=float) for value in values]
    except (TypeError, ValueError) as error:
        raise TrajectoryError(f"samples are not arrays of numbers: {error}") from error
    if len(times) < 2 or any(x.shape != (len(times), 4) for x in states):
        raise TrajectoryError("samples need at least two times t (n,), and rows of four joints")
    if not (np.diff(times) > 0).all() or not np.isfinite(states).all():
        raise TrajectoryError("samples need increasing times and finite numbers")
    return times, states


def blocks(count: int, size: int) -> Iterator[slice]:
    """Divide range(count) into consecutive slices of at most `size` entries."""
    return (slice(start, min(start + size, count)) for start in range(0, count, size))


def part_indices(counts: Indices) -> tuple[Indices, Indices]:
    """Return the indices of all parts into which polynomial pieces are divided.

    Parameters
    ----------
    counts : (m,)
        Number of parts of each piece.

    Returns
    -------
    piece, part : (n,)
        Index of the piece of each part, and index of the part within its piece.
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
        Joint positions, velocities and accelerations at the start and at the end of every piece
        (rad, m and s).

    Returns
    -------
    (m, 6, 4) array
        Coefficients c_0 to c_5 of every piece and joint (rad/s^k and m/s^k).
    """
    h = length[:, None]
    q0, v0, a0 = start
    q1, v1, a1 = end
    # scaled differences at the end from the quadratic polynomial that matches the start
    dq = (q1 - q0 - v0 * h - a0 * h**2 / 2) / h**3
    dv = (v1 - v0 - a0 * h) / h**2
    da = (a1 - a0) / h
    c3 = 10 * dq - 4 * dv + da / 2
    c4 = (-15 * dq + 7 * dv - da) / h
    c5 = (6 * dq - 3 * dv + da / 2) / h**2
    return np.stack([q0, v0, a0 / 2, c3, c4, c5], axis=1)


def cubic_coefficients(length: Array, start: tuple[Array, ...], end: tuple[Array, ...]) -> Array:
    """Compute cubic polynomials with given position and velocity at both ends.

    Parameters
    ----------
    length : (m,)
        Durations of the pieces, s.
    start, end : two arrays (m, 4)
        q and q̇ at the start and at the end of every piece.

    Returns
    -------
    (m, 6, 4)
        Coefficients of the pieces.
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
    """Cubic polynomial u(t) on 0 ≤ t ≤ h, with given state at t = 0 and acceleration at both ends.

    With c = t / h and r = a1 − a0:

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
        """Return u, u̇ and ü at the time c · h, where c is between 0 and 1."""
        t = c * self.h
        rise = self.a1 - self.a0
        return (
            self.u + t * (self.v + t * (self.a0 / 2 + c * rise / 6)),
            self.v + t * (self.a0 + c * rise / 2),
            self.a0 + c * rise,
        )

    def at_time(self, t: Any) -> tuple[Any, Any, Any]:
        """Return u, u̇ and ü at the time t in s."""
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
    """Return the coefficients (1, 6, 4) of one piece at rest at joint positions q (4,)."""
    coefficients = np.zeros((1, DEGREE + 1, 4))
    coefficients[0, 0] = q
    return coefficients


def join_sections(sections: Sequence[tuple[str, Array, Array]]) -> Trajectory:
    """Join phases to one trajectory, one after the other.

    Parameters
    ----------
    sections : sequence of (str, (m + 1,), (m, 6, 4))
        Name, breaks in s and coefficients of each phase. The breaks of each phase start at 0.

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
