"""A joint motion as piecewise polynomials in time: the one form in which a motion is planned, checked and exported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.errors import TrajectoryError
from ssm_planner.typing import Array, Indices

DEGREE = 5
SHORTEST, LONGEST = 1e-12, 1e9
"""s: of pieces, and of times."""
LARGEST = 1e9
"""rad or m: more is no position of a joint, and derivatives of it overflow."""
BLOCK = 65_536
"""Pieces at a time: what is worked out of them stays small."""
Side = Literal["left", "right"]


@dataclass(frozen=True)
class Span:
    """A named stretch of a trajectory between two rests or waypoints; times in s."""

    name: str
    start: float
    end: float


@dataclass(frozen=True, eq=False)
class Samples:
    """A motion at n instants: t (n,), q, qd, qdd, qddd (n, 4); rad, m, s."""

    t: Array
    q: Array
    qd: Array
    qdd: Array
    qddd: Array


@dataclass(frozen=True, eq=False)
class Trajectory:
    """q(t) = Σ_k coefficients[i, k] (t − breaks[i])^k on piece i.

    breaks (m + 1,) in s, strictly increasing; coefficients (m, 6, 4) in rad/s^k and m/s^k, read-only, or what gives them
    block by block.
    """

    breaks: Array
    coefficients: Array
    phases: tuple[Span, ...]
    """One after the other; none where they are not known."""

    def __post_init__(self) -> None:
        pieces = len(self.breaks) - 1
        if pieces < 1 or self.coefficients.shape != (pieces, DEGREE + 1, 4):
            raise TrajectoryError(
                f"a trajectory of {pieces} pieces needs coefficients of shape ({pieces}, {DEGREE + 1}, 4), "
                f"got {self.coefficients.shape}"
            )
        length = np.diff(self.breaks)
        finite = bool(np.isfinite(self.breaks).all())
        if finite and length.min() <= 0:
            raise TrajectoryError("the breaks of a trajectory must increase")
        if finite and (length.min() < SHORTEST or np.abs(self.breaks[[0, -1]]).max() > LONGEST):
            raise TrajectoryError(
                f"a piece shorter than {SHORTEST:g} s, or times beyond {LONGEST:g} s"
            )
        for first in range(0, pieces, BLOCK):
            block = slice(first, first + BLOCK)
            coefficients = self.pieces(block)
            if not (finite and np.isfinite(coefficients).all()):
                raise TrajectoryError("a trajectory holds only finite numbers")
            with np.errstate(over="ignore"):
                moved = (
                    np.abs(coefficients)
                    * length[block, None, None] ** np.arange(DEGREE + 1)[:, None]
                )
            if moved.max() > LARGEST:
                raise TrajectoryError(
                    f"a piece moves by more than {LARGEST:g} rad or m: its coefficients are none"
                )
        self.breaks.setflags(write=False)
        if isinstance(self.coefficients, np.ndarray):
            self.coefficients.setflags(write=False)

    @property
    def duration(self) -> float:
        """From the first break to the last, s."""
        return float(self.breaks[-1] - self.breaks[0])

    def pieces(self, chosen: Indices | slice) -> Array:
        """Coefficients (n, 6, 4) of some pieces: what goes through a long trajectory asks for them block by block."""
        return self.coefficients[chosen]

    def piece_of(self, t: Array, side: Side = "right") -> Indices:
        """Index (n,) of the piece that holds each t (n,); at a break the one to its right or left."""
        where = np.searchsorted(self.breaks, t, side="right" if side == "right" else "left") - 1
        return np.clip(where, 0, len(self.breaks) - 2)

    def sample(self, t: ArrayLike, side: Side = "right") -> Samples:
        """The motion at times t (n,), or at one; one-sided limits at the breaks, where the acceleration may jump.

        The arrays of the answer have one row for each time, (n, 4), and (1, 4) for a single one.
        """
        t = np.atleast_1d(np.asarray(t, dtype=float))
        piece = self.piece_of(t, side)
        return self.sample_pieces(piece, t - self.breaks[piece])

    def sample_pieces(self, piece: Indices, local: Array) -> Samples:
        """The motion at local time (n,) after the start of each piece (n,)."""
        q, qd, qdd, qddd = self._derivatives(piece, local, 3)
        return Samples(self.breaks[piece] + local, q, qd, qdd, qddd)

    def positions(self, t: Array) -> Array:
        """q (n, 4) alone at times t (n,), as `sample` gives it."""
        piece = self.piece_of(t)
        return self._derivatives(piece, t - self.breaks[piece], 0)[0]

    def _derivatives(self, piece: Indices, local: Array, highest: int) -> list[Array]:
        """q and its derivatives up to an order, (n, 4) each, at local time (n,) after the start of each piece (n,)."""
        found = []
        # each coefficient's values lie together in memory: operations run along them
        coefficients = np.ascontiguousarray(self.pieces(piece).transpose(1, 2, 0))
        for order in range(highest + 1):
            value = coefficients[DEGREE - order].copy()
            for k in range(DEGREE - order - 1, -1, -1):
                value *= local
                value += coefficients[k]
            found.append(value.T)
            if order < highest:
                coefficients = coefficients[1:] * np.arange(1, DEGREE + 1 - order)[:, None, None]
        return found

    def uniform(self, rate: float) -> Samples:
        """Samples at a fixed rate in Hz from the start, at a break what follows it; the last one is the end exactly."""
        count = int(np.floor(self.duration * rate * (1 + 1e-12)))
        t = self.breaks[0] + np.arange(count + 1) / rate
        if self.breaks[-1] - t[-1] > 1e-9:
            t = np.append(t, self.breaks[-1])
        t[-1] = self.breaks[-1]
        return self.sample(t)

    def slower(self, speed: float) -> Trajectory:
        """The same path at a share of the speed; starts at the same time."""
        begin, powers = self.breaks[0], speed ** np.arange(DEGREE + 1)[None, :, None]
        spans = (
            Span(p.name, begin + (p.start - begin) / speed, begin + (p.end - begin) / speed)
            for p in self.phases
        )
        return Trajectory(
            begin + (self.breaks - begin) / speed, self.coefficients * powers, tuple(spans)
        )

    def to_dict(self) -> dict[str, Any]:
        """What plan.json holds: JSON types, s, rad, m."""
        return {
            "breaks_s": self.breaks.tolist(),
            "coefficients": self.pieces(slice(None)).tolist(),
            "phases": [{"name": p.name, "start_s": p.start, "end_s": p.end} for p in self.phases],
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Trajectory:
        """Read back what `to_dict` wrote. Raises TrajectoryError."""
        try:
            phases = tuple(
                Span(str(p["name"]), float(p["start_s"]), float(p["end_s"])) for p in data["phases"]
            )
            breaks = np.array(data["breaks_s"], dtype=float)
            coefficients = np.asarray(data["coefficients"], dtype=float)
            if breaks.ndim != 1 or coefficients.ndim != 3:
                raise ValueError(
                    "breaks_s is no list of numbers, or coefficients are no list of pieces"
                )
        except (KeyError, OverflowError, TypeError, ValueError) as error:
            raise TrajectoryError(f"not the pieces of a trajectory: {error}") from error
        found = cls(breaks, coefficients, phases)
        ends = np.array([(phase.start, phase.end) for phase in phases]).reshape(-1, 2)
        borders = np.concatenate([breaks[:1], ends[:, 1]])
        if not (
            len(ends)
            and np.allclose(ends[:, 0], borders[:-1], 0, SHORTEST)
            and borders[-1] == breaks[-1]
        ):
            raise TrajectoryError(
                "the phases of a trajectory follow one another from its start to its end"
            )
        return found


def hermite(
    breaks: Array, start: tuple[Array, Array, Array], end: tuple[Array, Array, Array]
) -> Array:
    """Quintic pieces with given q, qd, qdd at both ends of every piece.

    breaks (m + 1,); start and end hold (q, qd, qdd), each (m, 4). Returns coefficients (m, 6, 4).
    """
    return quintics(np.diff(breaks), start, end)


def quintics(
    length: Array, start: tuple[Array, Array, Array], end: tuple[Array, Array, Array]
) -> Array:
    """`hermite` for pieces of lengths (m,), which need not follow one another."""
    h = length[:, None]
    q0, v0, a0 = start
    q1, v1, a1 = end
    # remainders after the quadratic that matches the start
    dq = (q1 - q0 - v0 * h - a0 * h**2 / 2) / h**3
    dv = (v1 - v0 - a0 * h) / h**2
    da = (a1 - a0) / h
    c3 = 10 * dq - 4 * dv + da / 2
    c4 = (-15 * dq + 7 * dv - da) / h
    c5 = (6 * dq - 3 * dv + da / 2) / h**2
    return np.stack([q0, v0, a0 / 2, c3, c4, c5], axis=1)


@dataclass(frozen=True, eq=False)
class Cubic:
    """u(t) on 0 ≤ t ≤ h with acceleration linear in t, from its state at t = 0 and its acceleration at t = h.

    At the share c = t / h, with r = a1 − a0: ü = a0 + c r, u̇ = v + t (a0 + c r / 2), u(t) = u + t v + t² (a0 / 2 + c r / 6).
    NumPy arrays or CasADi expressions of shapes that go together.
    """

    u: Any
    v: Any
    a0: Any
    a1: Any
    h: Any

    def at(self, c: Any) -> tuple[Any, Any, Any]:
        """u, u̇ and ü at the share c of the length."""
        t, rise = c * self.h, self.a1 - self.a0
        return (
            self.u + t * (self.v + t * (self.a0 / 2 + c * rise / 6)),
            self.v + t * (self.a0 + c * rise / 2),
            self.a0 + c * rise,
        )

    def at_time(self, t: Any) -> tuple[Any, Any, Any]:
        """u, u̇ and ü at the time t."""
        a0, jerk = self.a0, self.jerk
        return (
            self.u + t * (self.v + t * (a0 / 2 + t * jerk / 6)),
            self.v + t * (a0 + t * jerk / 2),
            a0 + t * jerk,
        )

    @property
    def end(self) -> tuple[Any, Any]:
        """u and u̇ at c = 1."""
        h = self.h
        return self.u + h * self.v + h**2 * (self.a0 / 3 + self.a1 / 6), self.v + h * (
            self.a0 + self.a1
        ) / 2

    @property
    def middle_velocity(self) -> Any:
        """Second Bernstein coefficient of the quadratic u̇; the first and third are its values at both ends.

        While the three keep a bound, so does u̇ everywhere on the piece.
        """
        return self.v + self.h * self.a0 / 2

    @property
    def jerk(self) -> Any:
        """u⃛, constant."""
        return (self.a1 - self.a0) / self.h


def hold(q: Array) -> Array:
    """One piece at rest at q (4,); coefficients (1, 6, 4)."""
    coefficients = np.zeros((1, DEGREE + 1, 4))
    coefficients[0, 0] = q
    return coefficients


def join(parts: Sequence[tuple[str, Array, Array]]) -> Trajectory:
    """One trajectory out of phases, each (name, breaks from 0, coefficients)."""
    if not parts:
        raise TrajectoryError("a trajectory needs at least one phase")
    time = 0.0
    breaks = [np.zeros(1)]
    phases = []
    for name, local, _ in parts:
        breaks.append(time + local[1:])
        phases.append(Span(name, time, float(time + local[-1])))
        time = float(time + local[-1])
    return Trajectory(np.concatenate(breaks), np.concatenate([c for *_, c in parts]), tuple(phases))
