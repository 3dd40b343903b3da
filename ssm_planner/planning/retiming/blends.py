"""Paths through several motions whose corners are rounded, so that the robot need not stop.

Corner i lies between the pieces i and i + 1, each with its own parameter from 0 to 1. The path
leaves piece i at 1 − a_i, where the tip is at the allowed distance from the corner's tip, and joins
piece i + 1 at b_i, at the same distance. Between them every joint is the quintic with the q, q' and
q'' of the pieces at both ends, so the whole path is twice continuously differentiable. q''' is
finite where it jumps, at the ends of the roundings, and so is the jerk.

Piece i is passed at the rate k_i with respect to the parameter of the whole path, and a rounding
takes 2 a_i / k_i = 2 b_i / k_{i+1} of that parameter. Between two lines that are straight in the
joints it is then the quintic whose direction turns without overshoot: q' = (1 − h) q'_i + h
q'_{i+1} with h = 3σ² − 2σ³.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics import Mechanism, tip_position
from ssm_planner.planning.retiming.paths import (
    FEW,
    MANY,
    ClosedPath,
    JointPath,
    PathSamples,
    joint_starts,
    sign_change,
)
from ssm_planner.planning.tolerances import ROUNDING, SAMPLES
from ssm_planner.trajectory import quintics
from ssm_planner.typing import Array, Mask, record

TURNS_BACK = 0.05
"""Smallest remaining share of |q'| in a corner.

A path that turns back by more than about 174° cannot be passed at speed.
"""


@record
class BlendedPath(JointPath):
    """Pieces that follow each other, with rounded corners.

    s from 0 to 1 is proportional to the parameter of the whole path.
    """

    mechanism: Mechanism
    pieces: tuple[ClosedPath, ...]
    distances: tuple[float, ...]
    """Distance of the tip from each corner within which the path is rounded, m."""
    cuts: Array
    """a and b of every corner: shares of the pieces before and behind it, (k, 2)."""

    @property
    def branch(self) -> int:
        """Branch of the inverse kinematics."""
        return self.pieces[0].branch

    @cached_property
    def _rates_and_breaks(self) -> tuple[Array, Array]:
        """Rates of all pieces with respect to s, (pieces,), and s at the ends of the parts."""
        behind = np.append(0.0, self.cuts[:, 1])
        rates = np.cumprod(np.append(1.0, self.cuts[:, 1] / self.cuts[:, 0]))
        lengths = np.zeros(2 * len(rates) - 1)
        lengths[::2] = (np.append(1 - self.cuts[:, 0], 1.0) - behind) / rates
        lengths[1::2] = 2 * self.cuts[:, 0] / rates[:-1]
        breaks = np.append(0.0, np.cumsum(lengths))
        return rates * breaks[-1], breaks / breaks[-1]

    @property
    def _rates(self) -> Array:
        return self._rates_and_breaks[0]

    @property
    def breaks(self) -> Array:
        """Values of s at the ends of pieces and roundings, (2 pieces,)."""
        return self._rates_and_breaks[1]

    def _on_piece(self, k: int, s: Array) -> Array:
        """Return q, q' and q'' at values of s (n,) on piece k, (3, n, 4)."""
        rate, first = self._rates[k], self.cuts[k - 1, 1] if k else 0.0
        samples = self.pieces[k].sample(first + rate * (s - self.breaks[2 * k]))
        return np.stack([samples.q, rate * samples.dq, rate**2 * samples.ddq])

    @cached_property
    def _roundings(self) -> Array:
        """Coefficients (k, 6, 4) of the quintics in s, counted from the start of each rounding."""
        starts, ends = self.breaks[1:-1:2], self.breaks[2:-1:2]
        leaving = [self._on_piece(k, starts[[k]]) for k in range(len(starts))]
        joining = [self._on_piece(k + 1, ends[[k]]) for k in range(len(ends))]
        return quintics(ends - starts, tuple(np.hstack(leaving)), tuple(np.hstack(joining)))

    def sample(self, s: Array) -> PathSamples:
        """Return q, q' and q'' at s (n,)."""
        s = np.asarray(s, dtype=float)
        values = np.zeros((3, len(s), 4))
        part = np.clip(np.searchsorted(self.breaks, s, side="right") - 1, 0, len(self.breaks) - 2)
        for k in np.unique(part):
            inside = part == k
            if k % 2 == 0:
                values[:, inside] = self._on_piece(k // 2, s[inside])
                continue
            polynomial = self._roundings[k // 2]
            for order in range(3):
                local = s[inside] - self.breaks[k]
                values[order, inside] = np.polynomial.polynomial.polyval(local, polynomial).T
                polynomial = np.polynomial.polynomial.polyder(polynomial)
        return PathSamples(s, *values)

    @cached_property
    def directions(self) -> tuple[Array, Array]:
        """Reversals of the joints: knots (m + 1,), and the signs of q' between them, (m, 4)."""
        return self.smooth_directions(self.pieces[0].watched)

    def starts(self, samples: PathSamples) -> Mask:
        """Return where joints start at s (n,), (n, 4), also those that stood before or reverse."""
        return joint_starts(samples, *self.directions)

    @property
    def intervals(self) -> int:
        """Number of grid intervals for TOPP-RA."""
        return int(np.clip(SAMPLES * (len(self.breaks) - 1), FEW, MANY))


def rounded(
    mechanism: Mechanism, pieces: Sequence[ClosedPath], distances: Sequence[float]
) -> BlendedPath:
    """Return the pieces as one path with rounded corners.

    `distances` are the distances of the tip from the corners within which the path may be rounded,
    m.

    Raises
    ------
    ProblemError
        If a rounding would take more than half of a piece, or if the path turns back on itself. Its
        key is the index of the corner.
    """
    cuts = []
    for k, ((incoming, outgoing), distance) in enumerate(
        zip(pairwise(pieces), distances, strict=True)
    ):
        shares = [
            _share(path, distance, from_end)
            for path, from_end in ((incoming, True), (outgoing, False))
        ]
        limit = min(reach for _, reach in shares)
        if not all(np.isfinite(share) for share, _ in shares):
            reason = "the rounding of the corner would take more than half of an adjacent motion"
            allowed = f"up to {np.floor(1e7 * limit) / 1e4:g} mm here"
            if limit <= ROUNDING:
                reason = "an adjacent motion does not move the tip, so the corner cannot be rounded"
                allowed = "motions that move the tip, or no blend"
            raise ProblemError(reason, key=str(k), allowed=allowed)
        cuts.append([share for share, _ in shares])
    path = BlendedPath(mechanism, tuple(pieces), tuple(distances), np.array(cuts))
    scale = np.abs(path.sample(np.linspace(0.0, 1.0, SAMPLES)).dq).max(axis=0) + ROUNDING
    for k, (start, end) in enumerate(zip(path.breaks[1:-1:2], path.breaks[2:-1:2], strict=True)):
        speed = np.linalg.norm(path.sample(np.linspace(start, end, SAMPLES)).dq / scale, axis=1)
        if speed.min() < TURNS_BACK * max(speed[0], speed[-1]):
            reason = (
                "the second motion goes back along the first, so the robot has to stop between them"
            )
            raise ProblemError(
                reason, key=str(k), allowed="motions in different directions, or no blend"
            )
    return path


def _share(path: ClosedPath, distance: float, from_end: bool) -> tuple[float, float]:
    """Return the share of a piece after which its tip is `distance` away from the corner.

    The share is infinite if the tip is nowhere that far away within half of the piece. The second
    value is the largest distance there, m.
    """

    def distance_from_corner(shares: Array) -> Array:
        tips = tip_position(path.mechanism, path.sample(1 - shares if from_end else shares).q)
        return np.asarray(np.linalg.norm(tips - corner, axis=1))

    corner = tip_position(path.mechanism, path.sample(np.array([1.0 if from_end else 0.0])).q)[0]
    shares = np.linspace(0.0, 0.5, SAMPLES)
    distances = distance_from_corner(shares)
    reach = float(distances.max())
    beyond = np.flatnonzero(distances >= distance)
    if not len(beyond):
        return np.inf, reach
    low, high = shares[beyond[0] - 1], shares[beyond[0]]
    return sign_change(lambda s: distance_from_corner(s) - distance, low, high), reach
