"""Joint paths through several motions with rounded corners, so that the robot need not stop.

The path consists of pieces, one for each motion, and of roundings between them. Each piece has its
own parameter from 0 to 1. Corner i lies between the pieces i and i + 1. The path leaves piece i at
the parameter 1 − a_i of that piece, where the tip is at the allowed distance from the corner. It
joins piece i + 1 at the parameter b_i, at the same distance from the corner. On the rounding in
between, every joint position is the polynomial of degree 5 (quintic) that has the q, q' and q'' of
the pieces at both ends. The whole path is thus twice continuously differentiable. q''' jumps at the
ends of the roundings but is finite, so the jerk of a motion along the path is finite too.

The parameter of piece i grows at the constant rate k_i with the parameter s of the whole path. The
rounding of corner i covers a range of s of the length 2 a_i / k_i = 2 b_i / k_{i+1}. With this
length, the direction turns without overshoot if both pieces are straight in the joints. It is then
q' = (1 − h) q'_i + h q'_{i+1} with h = 3σ² − 2σ³, where σ grows from 0 to 1 along the rounding.
"""

from collections.abc import Sequence
from functools import cached_property, partial

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics import Mechanism, tip_position
from ssm_planner.planning.retiming.paths import (
    ClosedPath,
    JointPath,
    PathSamples,
    find_sign_change,
)
from ssm_planner.planning.tolerances import PATH_SAMPLES, ROUNDING_TOLERANCE
from ssm_planner.trajectory import Trajectory, quintic_coefficients
from ssm_planner.typing import Array, record

MIN_SLOPE_RATIO = 0.05
"""Smallest ratio of |q'| within a rounding to |q'| at its ends.

If two straight pieces meet at the angle θ, the smallest ratio is cos(θ/2), so the ratio 0.05
corresponds to 174°. At a larger angle, the robot must almost stop, so a rounding is of no use.
"""


@record
class BlendedPath(JointPath):
    """A joint path that consists of several pieces, whose corners are rounded.

    The module's docstring describes the shape of the roundings and the choice of the path parameter
    s, which is scaled here to run from 0 to 1.
    """

    mechanism: Mechanism
    """Geometry of the robot."""
    pieces: tuple[ClosedPath, ...]
    """The pieces. Each begins where the previous one ends."""
    cuts: Array
    """Parts of the pieces that the roundings replace, (k, 2) for k corners.

    The first column contains a, the share of the piece before the corner. The second column
    contains b, the share of the piece behind it. Both lie between 0 and 0.5.
    """

    @property
    def branch(self) -> int:
        """Branch of the inverse kinematics on which all pieces lie: +1 or −1."""
        return self.pieces[0].branch

    @property
    def driven(self) -> tuple[int, ...]:
        """Indices of the joints with a drive."""
        return self.pieces[0].driven

    @cached_property
    def _rates_and_breaks(self) -> tuple[Array, Array]:
        """Derivatives of the parameters of the pieces with respect to s, and the ends of all parts.

        The derivatives are the constant rates k_i of the module's docstring, (p,) for p pieces. The
        ends (2 p,) are the values of s at which the pieces and the roundings end, in their order
        along the path. They begin with 0, the start of the first piece.
        """
        cut_from_start = np.append(0.0, self.cuts[:, 1])
        # The rates satisfy a_i / k_i = b_i / k_{i+1} in each corner, with k_1 = 1.
        rates = np.cumprod(np.append(1.0, self.cuts[:, 1] / self.cuts[:, 0]))
        # Ranges of s of all parts, before s is scaled to end at 1. Pieces have even indices, and
        # roundings odd ones.
        lengths = np.zeros(2 * len(rates) - 1)
        lengths[::2] = (np.append(1 - self.cuts[:, 0], 1.0) - cut_from_start) / rates
        lengths[1::2] = 2 * self.cuts[:, 0] / rates[:-1]
        breaks = np.append(0.0, np.cumsum(lengths))
        return rates * breaks[-1], breaks / breaks[-1]

    @property
    def breaks(self) -> Array:
        """Values of s at the ends of the p pieces and the roundings, (2 p,). The first is 0."""
        return self._rates_and_breaks[1]

    def _on_piece(self, k: int, s: Array) -> Array:
        """Evaluate the joint positions and their derivatives at n points of one piece.

        Parameters
        ----------
        k : int
            Index of the piece, from 0.
        s : (n,) array
            Values of the parameter of the whole path.

        Returns
        -------
        (3, n, 4) array
            q, q' and q'', with derivatives with respect to the parameter of the whole path.
        """
        # `start` is the piece's own parameter where the rounding before it ends.
        rate, start = self._rates_and_breaks[0][k], self.cuts[k - 1, 1] if k else 0.0
        samples = self.pieces[k].sample(start + rate * (s - self.breaks[2 * k]))
        # The factors follow from the chain rule.
        return np.stack([samples.q, rate * samples.dq, rate**2 * samples.ddq])

    @cached_property
    def _roundings(self) -> list[Trajectory]:
        """Polynomials that round the corners of the path.

        A rounding is the part of the path that replaces a corner. On it, each joint position is a
        quintic polynomial. The path parameter s takes the place of the time.
        """
        roundings = []
        for k in range(len(self.cuts)):
            # Piece 0 lies between the breaks 0 and 1, the first rounding between 1 and 2.
            ends = self.breaks[2 * k + 1 : 2 * k + 3]
            leaving, joining = self._on_piece(k, ends[:1]), self._on_piece(k + 1, ends[1:])
            polynomials = quintic_coefficients(np.diff(ends), tuple(leaving), tuple(joining))
            roundings.append(Trajectory(ends, polynomials, ()))
        return roundings

    def sample(self, s: Array) -> PathSamples:
        """Evaluate the joint positions and their derivatives with respect to the path parameter.

        Parameters
        ----------
        s : (n,) array
            Path parameters from 0 to 1.

        Returns
        -------
        PathSamples
            Joint positions q, and the derivatives q' = dq/ds and q'' = d²q/ds², (n, 4) each.
        """
        s = np.asarray(s, dtype=float)
        values = np.zeros((3, len(s), 4))
        # Index of the piece or rounding that contains s. Clipping assigns s = 1 to the last piece.
        part = np.clip(np.searchsorted(self.breaks, s, side="right") - 1, 0, len(self.breaks) - 2)
        for k in np.unique(part):
            on_part = part == k
            # Even parts are pieces, odd parts are roundings.
            if k % 2 == 0:
                values[:, on_part] = self._on_piece(k // 2, s[on_part])
            else:
                samples = self._roundings[k // 2].sample(s[on_part])
                values[:, on_part] = samples.q, samples.qd, samples.qdd
        return PathSamples(s, *values)


def blend_pieces(
    mechanism: Mechanism, pieces: Sequence[ClosedPath], distances: Sequence[float]
) -> BlendedPath:
    """Join the paths of several motions into one path, and round the corners between them.

    Parameters
    ----------
    mechanism : Mechanism
        Geometry of the robot.
    pieces : sequence of ClosedPath
        Paths of the motions in their order. Each begins where the previous one ends.
    distances : sequence of float
        For each corner, the distance of the tip from it at which the rounding begins and ends, m.

    Returns
    -------
    BlendedPath
        The path with its roundings.

    Raises
    ------
    ProblemError
        If a rounding would take more than half of a piece, or if the path turns back on itself at a
        corner. The `key` of the error is the index of the corner as text.
    """
    cuts, shares = [], np.linspace(0.0, 0.5, PATH_SAMPLES)
    for k, distance in enumerate(distances):
        # Distances of the tip from the corner on both sides of it, less the required distance.
        margins = [
            partial(_distance_from_end, pieces[k], 1.0, distance),
            partial(_distance_from_end, pieces[k + 1], 0.0, distance),
        ]
        limit = distance + min(float(margin(shares).max()) for margin in margins)
        if limit < distance:
            reason = "the rounding of the corner would take more than half of an adjacent motion"
            # The limit in m becomes mm, rounded down to 0.1 µm so that the printed value works.
            allowed = f"up to {np.floor(1e7 * limit) / 1e4:g} mm here"
            if limit <= ROUNDING_TOLERANCE:
                reason = "an adjacent motion does not move the tip, so the corner cannot be rounded"
                allowed = "motions that move the tip, or no blend"
            raise ProblemError(reason, key=str(k), allowed=allowed)
        cuts.append([find_sign_change(margin, 0.0, 0.5) for margin in margins])
    path = BlendedPath(mechanism, tuple(pieces), np.array(cuts))
    # The joints are divided by their largest |q'|, which makes rad and m comparable. The small
    # summand prevents a division by zero for joints at rest.
    largest_slope = (
        np.abs(path.sample(np.linspace(0.0, 1.0, PATH_SAMPLES)).dq).max(axis=0) + ROUNDING_TOLERANCE
    )
    for k, (start, end) in enumerate(zip(path.breaks[1:-1:2], path.breaks[2:-1:2], strict=True)):
        slope = np.linalg.norm(
            path.sample(np.linspace(start, end, PATH_SAMPLES)).dq / largest_slope, axis=1
        )
        if slope.min() < MIN_SLOPE_RATIO * max(slope[0], slope[-1]):
            reason = (
                "the second motion goes back along the first, so the robot has to stop between them"
            )
            raise ProblemError(
                reason, key=str(k), allowed="motions in different directions, or no blend"
            )
    return path


def _distance_from_end(path: ClosedPath, end: float, distance: float, shares: Array) -> Array:
    """Return by how much the tip is farther from one end of a path than a given distance, m.

    Parameters
    ----------
    path : ClosedPath
        The path.
    end : float
        Path parameter of the end: 0 or 1.
    distance : float
        The given distance, m.
    shares : (n,) array
        Parts of the path between this end and the points at which the tip is evaluated.

    Returns
    -------
    (n,) array
        Differences of the distances, m.
    """
    s = np.append(end, np.abs(end - shares))
    tips = tip_position(path.mechanism, path.sample(s).q)
    return np.asarray(np.linalg.norm(tips[1:] - tips[0], axis=1) - distance)
