"""Paths from one motion into the next without a stop: their corners are rounded.

Corner i lies between pieces i and i + 1, each with a parameter of its own from 0 to 1. The path leaves piece i at 1 − a_i,
where the tip is at the distance that is allowed from the corner's tip, and joins piece i + 1 at b_i, likewise. Between them
every joint is the quintic that has q, q' and q'' of the pieces at both ends, so the whole is twice continuously
differentiable: where q''' jumps, at the ends of roundings, it stays finite, and with it the jerk. Piece i is passed at a rate
k_i by the parameter of the whole, and a rounding takes 2 a_i / k_i = 2 b_i / k_{i+1} of it: between two straight lines in the
joints it is then the quintic whose direction turns from one to the other without overshoot, q' = (1 − h) q'_i + h q'_{i+1}
with h = 3σ² − 2σ³.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.planning.retiming.paths import (
    FEW,
    LOOKS,
    MANY,
    STILL,
    ClosedPath,
    JointPath,
    PathSamples,
    begun,
    with_knots,
)
from ssm_planner.trajectory import quintics
from ssm_planner.typing import Array, Mask

HALF = 0.5
"""Share of a piece that one rounding may take."""
TURNS_BACK = 0.05
"""Share of q' that has to be left in a corner: one that turns back by more than about 174° cannot be passed at speed."""
PER_PIECE = 400
"""Grid intervals of TOPP-RA for every piece and every rounding."""
HALVINGS = 50


@dataclass(frozen=True, eq=False)
class BlendedPath(JointPath):
    """Pieces one after the other, corners rounded; s from 0 to 1 in proportion to the parameter of the whole."""

    mechanism: Mechanism
    pieces: tuple[ClosedPath, ...]
    distances: tuple[float, ...]
    """Within which of a corner the path is rounded, m."""
    cuts: Array
    """a and b of every corner: shares of the pieces before and behind it, (k, 2)."""

    @property
    def branch(self) -> int:
        """Of the inverse kinematics."""
        return self.pieces[0].branch

    @cached_property
    def _rates(self) -> Array:
        """k of every piece by s, (pieces,)."""
        rates = np.cumprod(np.append(1.0, self.cuts[:, 1] / self.cuts[:, 0]))
        first, last = np.append(0.0, self.cuts[:, 1]), np.append(1 - self.cuts[:, 0], 1.0)
        whole = ((last - first) / rates).sum() + (2 * self.cuts[:, 0] / rates[:-1]).sum()
        return np.asarray(rates * whole)

    @cached_property
    def breaks(self) -> Array:
        """s of the ends of pieces and roundings by turns, (2 pieces,)."""
        rates = self._rates
        first, last = np.append(0.0, self.cuts[:, 1]), np.append(1 - self.cuts[:, 0], 1.0)
        lengths = np.zeros(2 * len(rates) - 1)
        lengths[::2], lengths[1::2] = (last - first) / rates, 2 * self.cuts[:, 0] / rates[:-1]
        found = np.append(0.0, np.cumsum(lengths))
        found[-1] = 1.0
        return found

    @cached_property
    def _roundings(self) -> Array:
        """Coefficients of the quintics by the s from the start of each, (k, 6, 4)."""
        ends = []
        for side in (0, 1):
            states = []
            for i, cut in enumerate(self.cuts):
                at, rate = (
                    self.pieces[i + side].sample(np.array([cut[1] if side else 1 - cut[0]])),
                    self._rates[i + side],
                )
                states.append((at.q[0], rate * at.dq[0], rate**2 * at.ddq[0]))
            ends.append(tuple(np.array(part) for part in zip(*states, strict=True)))
        return quintics(np.diff(self.breaks)[1::2], ends[0], ends[1])  # type: ignore[arg-type]

    def sample(self, s: Array) -> PathSamples:
        s = np.asarray(s, dtype=float)
        values = np.zeros((3, len(s), 4))
        place = np.clip(np.searchsorted(self.breaks, s, side="right") - 1, 0, len(self.breaks) - 2)
        first = np.append(0.0, self.cuts[:, 1])
        for k in np.unique(place):
            here, piece = place == k, k // 2
            local = s[here] - self.breaks[k]
            if k % 2:
                polynomial = self._roundings[piece]
                for order in range(3):
                    values[order][here] = np.polynomial.polynomial.polyval(local, polynomial).T
                    polynomial = np.polynomial.polynomial.polyder(polynomial)
                continue
            rate = self._rates[piece]
            at = self.pieces[piece].sample(first[piece] + rate * local)
            values[:, here] = at.q, rate * at.dq, rate**2 * at.ddq
        return PathSamples(s, *values)

    @cached_property
    def directions(self) -> tuple[Array, Array]:
        grid = np.unique(
            np.concatenate([np.linspace(a, b, LOOKS) for a, b in pairwise(self.breaks)])
        )
        dq = self.sample(grid).dq
        moving = (np.abs(dq).max(axis=0) > STILL) & np.isin(np.arange(4), self.pieces[0].watched)
        # a joint that stands on a piece and goes on begins where the piece ends, which is a knot anyway
        signs = np.where(np.abs(dq) > STILL, np.sign(dq), 0.0)
        turns = signs[1:] * signs[:-1] < 0
        found = (
            self._turning_point(int(i), grid[k], grid[k + 1])
            for k, i in np.argwhere(turns & moving)
        )
        knots = with_knots(self.breaks, found)
        middle = self.sample((knots[1:] + knots[:-1]) / 2).dq
        return knots, np.where(np.abs(middle) > STILL, np.sign(middle), 0.0) * moving

    def _turning_point(self, joint: int, low: float, high: float) -> float:
        """The root of q'(s) of one joint between two points where its signs differ."""
        sign = np.sign(self.sample(np.array([low])).dq[0, joint])
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            if np.sign(self.sample(np.array([middle])).dq[0, joint]) == sign:
                low = middle
            else:
                high = middle
        return (low + high) / 2

    def starts(self, samples: PathSamples) -> Mask:
        """Also where a joint goes on that stood, or turns back."""
        return begun(samples, *self.directions)

    @property
    def intervals(self) -> int:
        return int(np.clip(PER_PIECE * (len(self.breaks) - 1), FEW, MANY))


def rounded(
    mechanism: Mechanism, pieces: Sequence[ClosedPath], distances: Sequence[float]
) -> BlendedPath:
    """The pieces as one path, each corner rounded within a distance of the tip from it, m.

    Raises ProblemError, its key the number of the corner, where a rounding would take more than half of a piece, or the path
    turns back on itself.
    """
    cuts = []
    for k, ((before, behind), distance) in enumerate(zip(pairwise(pieces), distances, strict=True)):
        shares = [
            _share(path, distance, from_end) for path, from_end in ((before, True), (behind, False))
        ]
        room = min(most for _, most in shares)
        if not all(0 < share <= HALF for share, _ in shares):
            reason = "the corner would be rounded over more than half of one of the motions that meet there"
            allowed = f"up to {np.floor(1e7 * room) / 1e4:g} mm here"
            if room <= STILL:
                reason = "one of the motions that meet there does not move the tip, so there is no corner"
                allowed = "motions that move the tip, or no blend"
            raise ProblemError(reason, key=str(k), allowed=allowed)
        cuts.append([share for share, _ in shares])
    path = BlendedPath(mechanism, tuple(pieces), tuple(distances), np.array(cuts))
    scale = np.abs(path.sample(np.linspace(0.0, 1.0, LOOKS)).dq).max(axis=0) + STILL
    for k, (start, end) in enumerate(zip(path.breaks[1:-1:2], path.breaks[2:-1:2], strict=True)):
        speed = np.linalg.norm(path.sample(np.linspace(start, end, LOOKS)).dq / scale, axis=1)
        if speed.min() < TURNS_BACK * max(speed[0], speed[-1]):
            reason = "the second motion goes back the way of the first, so the robot has to stop between them"
            raise ProblemError(
                reason, key=str(k), allowed="motions in different directions, or no blend"
            )
    return path


def _share(path: ClosedPath, distance: float, from_end: bool) -> tuple[float, float]:
    """Share of a piece after which its tip is first so far from the corner, inf where never; how far it gets within half."""

    def far(shares: Array) -> Array:
        tips = tip_position(path.mechanism, path.sample(1 - shares if from_end else shares).q)
        return np.asarray(np.linalg.norm(tips - corner, axis=1))

    corner = tip_position(path.mechanism, path.sample(np.array([1.0 if from_end else 0.0])).q)[0]
    shares = np.linspace(0.0, 1.0, LOOKS)
    away = far(shares)
    most = float(away[shares <= HALF].max())
    beyond = np.flatnonzero(away >= distance)
    if not len(beyond):
        return np.inf, most
    low, high = shares[beyond[0] - 1], shares[beyond[0]]
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if far(np.array([middle]))[0] < distance else (low, middle)
    return float(high), most
