"""Joint paths q(s), 0 ≤ s ≤ 1, along which TOPP-RA and optimal control plan motions.

A path states which joint positions the robot passes, but not when. q contains the four joint
positions, and s is the path parameter, which has no unit. The paths are lines in task coordinates
(roll, tilt, spin and depth of the tool), lines and arcs of the tip, splines, polylines, and the
paths of existing motions. All are subclasses of `JointPath`. Primes denote derivatives with respect
to s.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.codegen.vectorised import call
from ssm_planner.kinematics import (
    Mechanism,
    joints_from_task_symbolic,
    roll_of_tip,
    task_of_tip_symbolic,
)
from ssm_planner.planning.tolerances import EQUALITY_TOLERANCE, PATH_SAMPLES, ROUNDING_TOLERANCE
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, Mask, record

MIN_GRID_INTERVALS, MAX_GRID_INTERVALS = 1000, 20_000
"""Smallest and largest number of grid intervals on which TOPP-RA times a path.

More intervals give a faster motion, but the computing time grows in proportion to their number.
"""
INTERVALS_PER_POINT = 8
"""Number of grid intervals for each point of a spline, whose curvature changes between points."""
CORNER_ANGLE = np.radians(30)
"""Angle between two sides of a polyline above which the robot stops at their corner, rad.

At a sharper corner, a spline would leave the polyline far. The joints are divided by their
velocity limits first, which makes rad and m comparable.
"""
BREAK_OFFSET = 1e-4
"""Distance of a grid point from the end of a polynomial piece, as a share of the piece's length.

q'' jumps at the ends of the pieces, so it must not be evaluated exactly there.
"""


def _limited_grid_size(intervals: int) -> int:
    """Return a number of grid intervals within `MIN_GRID_INTERVALS` and `MAX_GRID_INTERVALS`."""
    return min(max(intervals, MIN_GRID_INTERVALS), MAX_GRID_INTERVALS)


@record
class PathSamples:
    """Joint positions and their derivatives at n values of the path parameter s."""

    s: Array
    """Path parameters, (n,)."""
    q: Array
    """Joint positions, (n, 4), rad and m."""
    dq: Array
    """First derivatives q' = dq/ds, (n, 4)."""
    ddq: Array
    """Second derivatives q'' = d²q/ds², (n, 4)."""


class JointPath(ABC):
    """A joint path q(s), 0 ≤ s ≤ 1, in rad and m.

    A new kind of path is a frozen dataclass with a field `mechanism`, and with `sample`. If it is
    not smooth, it also has `breaks`.
    """

    mechanism: Mechanism
    """Geometry of the robot."""

    @abstractmethod
    def sample(self, s: Array) -> PathSamples:
        """Evaluate the joint positions and their first two derivatives with respect to s.

        Parameters
        ----------
        s : (n,) array
            Path parameters from 0 to 1.

        Returns
        -------
        PathSamples
            q, q' and q'' at these values, (n, 4) each.
        """

    @property
    def driven(self) -> tuple[int, ...]:
        """Indices of the joints with a drive. Only drives have friction."""
        return (0, 1, 2, 3)

    @cached_property
    def directions(self) -> tuple[Array, Array]:
        """Knots of s at which joints reverse, and the directions of the joints between them.

        The knots (m + 1,) increase from 0 to 1, and no joint reverses between two of them. The
        directions (m, 4) are the signs of q' between the knots, and 0 for a joint at rest or
        without a drive. They determine the direction of the friction.

        The signs of q' at many samples of each smooth part show between which samples a joint
        reverses. A search for the root of q' then gives the value of s.
        """
        s = np.unique(
            np.concatenate([np.linspace(a, b, PATH_SAMPLES) for a, b in pairwise(self.breaks)])
        )
        dq = self.sample(s).dq
        rests = np.abs(dq) <= ROUNDING_TOLERANCE
        moving = ~rests.all(axis=0) & np.isin(np.arange(4), self.driven)
        # A change of sign between two samples at rest is rounding. No start after a rest is missed,
        # because a joint can only start at a break of the path, and every break is a knot.
        reverses = (np.signbit(dq[1:]) != np.signbit(dq[:-1])) & ~(rests[1:] & rests[:-1])
        roots = (
            round(self.find_reversal(int(i), s[k], s[k + 1]), 12)
            for k, i in np.argwhere(reverses & moving)
        )
        knots = add_knots(self.breaks, roots)
        middle = self.sample((knots[1:] + knots[:-1]) / 2).dq
        return knots, np.where(np.abs(middle) > ROUNDING_TOLERANCE, np.sign(middle), 0.0) * moving

    @cached_property
    def coarse_samples(self) -> PathSamples:
        """Samples at `PATH_SAMPLES` evenly spaced values of s."""
        return self.sample(np.linspace(0.0, 1.0, PATH_SAMPLES))

    @property
    def breaks(self) -> Array:
        """Values of s between which the path is smooth, (k + 1,), from 0 to 1.

        Each of them is also a knot of `directions`.
        """
        return np.array([0.0, 1.0])

    @property
    def grid_intervals(self) -> int:
        """Number of grid intervals that TOPP-RA needs, which grows with the number of breaks."""
        return _limited_grid_size(PATH_SAMPLES * (len(self.breaks) - 1))

    def speed_at(self, s: float, qd: Array) -> float:
        """Return the path speed ds/dt at which the joints have given velocities.

        Because q̇ = q' ṡ, ṡ is the projection of q̇ on q'.

        Parameters
        ----------
        s : float
            Path parameter.
        qd : (4,) array
            Joint velocities, which must point along the path, rad/s and m/s.

        Returns
        -------
        float
            Path speed ṡ, 1/s.
        """
        if not qd.any():
            return 0.0
        slope = self.sample(np.array([s])).dq[0]
        return float(slope @ qd / (slope @ slope))

    def find_reversal(self, joint: int, low: float, high: float) -> float:
        """Find the value of s at which a joint reverses, that is, where its q' changes its sign.

        Parameters
        ----------
        joint : int
            Index of the joint, from 0.
        low, high : float
            Values of s at which q' of the joint has different signs.

        Returns
        -------
        float
            The first such value between `low` and `high`.
        """
        return find_sign_change(lambda s: np.asarray(self.sample(s).dq[:, joint]), low, high)


class ClosedPath(JointPath):
    """A smooth joint path that a CasADi function computes from a curve of the tool in closed form.

    The inverse kinematics has two solutions, called the branches +1 and −1. The whole path lies on
    one of them. The path is differentiable while the tilt stays away from the boundary of the
    workspace (paper, eq. 9), where the branches meet.
    """

    branch: int
    """Branch of the inverse kinematics: +1 or −1."""
    first: Array
    """Joint positions at s = 0, (4,), rad and m.

    The closed form gives angles only up to whole turns, which these positions determine.
    """

    @property
    @abstractmethod
    def parameters(self) -> list[float]:
        """Numbers that determine the curve of the tool."""

    @staticmethod
    @abstractmethod
    def task(mechanism: Mechanism, s: ca.SX, parameters: ca.SX) -> ca.SX:
        """Return the task coordinates roll, tilt, spin and depth on the curve as an expression.

        Parameters
        ----------
        mechanism : Mechanism
            Geometry of the robot.
        s : symbol
            Path parameter from 0 to 1.
        parameters : vector of symbols
            Numbers that determine the curve.

        Returns
        -------
        (4,) expression
            Task coordinates, rad and m.
        """

    def sample(self, s: Array) -> PathSamples:
        """Evaluate q, q' and q'' at n path parameters, with whole turns counted from `first`."""
        s = np.asarray(s, dtype=float)
        q, dq, ddq = self._without_whole_turns(s)
        return PathSamples(s, q + self._whole_turns, dq, ddq)

    def _without_whole_turns(self, s: Array) -> tuple[Array, ...]:
        """Evaluate the closed form of q, q' and q'' at n path parameters, (n, 4) each."""
        parameters = np.tile(self.parameters, (len(s), 1))
        function = _path_function(self.mechanism, self.branch, self.task, parameters.shape[1])
        return call(function, s[:, None], parameters)

    @cached_property
    def _whole_turns(self) -> Array:
        """Angles in rad (1, 4) that are added to the closed form so that it begins at `first`.

        They are multiples of 2π, and 0 for joint 4, which slides.
        """
        q = self._without_whole_turns(np.zeros(1))[0]
        turns = 2 * np.pi * np.round((self.first - q) / (2 * np.pi))
        turns[:, 3] = 0.0
        return turns


@lru_cache(maxsize=32)
def _path_function(
    mechanism: Mechanism, branch: int, task: Callable[..., ca.SX], count: int
) -> ca.Function:
    """Build the CasADi function that evaluates the joint path along a curve of the tool.

    Parameters
    ----------
    mechanism : Mechanism
        Geometry of the robot.
    branch : int
        Branch +1 or −1, that is, which of the two solutions of the inverse kinematics q follows.
    task : callable
        Method `ClosedPath.task` of the kind of curve.
    count : int
        Number of parameters of the curve.

    Returns
    -------
    ca.Function
        Function of s and of the parameters. It returns the joint positions q except for whole
        turns, and their derivatives q' and q'' with respect to s.
    """
    s, parameters = ca.SX.sym("s"), ca.SX.sym("parameters", count)
    joints = joints_from_task_symbolic(mechanism, task(mechanism, s, parameters), branch)
    slope: Any = ca.jacobian(joints, s)
    return ca.Function("path", [s, parameters], ca.cse([joints, slope, ca.jacobian(slope, s)]))


@record
class StraightPath(ClosedPath):
    """Joint path along a straight line in task coordinates, task(s) = start + s (end − start)."""

    mechanism: Mechanism
    start: Array
    """Task coordinates roll, tilt, spin (rad) and depth (m) at s = 0, (4,)."""
    end: Array
    """Task coordinates at s = 1, (4,)."""
    branch: int
    first: Array
    driven: tuple[int, ...] = (0, 1, 2, 3)

    @property
    def parameters(self) -> list[float]:
        """Task coordinates at the start, and their displacement to the end."""
        return [*self.start, *(self.end - self.start)]

    @staticmethod
    def task(mechanism: Mechanism, s: ca.SX, parameters: ca.SX) -> ca.SX:
        """Return the task coordinates on the line as an expression."""
        return parameters[:4] + s * parameters[4:]


@record
class TipPath(ClosedPath):
    """Joint path on which the tip of the tool follows a line or an arc.

    The tip is at p(s) = fixed + s line + cos(s angle) u + sin(s angle) v. A line has u = v = 0, and
    an arc has line = 0. The length that the tip has covered, and the change of the spin (rotation
    of the tool about its own axis), are proportional to s. The curve must avoid the remote centre
    and the axis of joint 1, where the tip determines no unique joint positions.
    """

    mechanism: Mechanism
    terms: Array
    """The vectors fixed, line, u and v, (4, 3), m."""
    angle: float
    """Angle of the arc, rad. 0 for a line."""
    spins: tuple[float, float]
    """Spins at both ends, rad."""
    branch: int
    first: Array
    driven: tuple[int, ...] = (0, 1, 2, 3)

    def tips(self, s: Array) -> Array:
        """Return the positions of the tip (n, 3) in m at the path parameters `s` (n,)."""
        turn = self.angle * s
        return np.asarray(
            np.column_stack([np.ones_like(s), s, np.cos(turn), np.sin(turn)]) @ self.terms
        )

    @property
    def parameters(self) -> list[float]:
        """The four vectors of `terms`, the angle, both spins, and the roll in the middle."""
        return [*self.terms.ravel(), self.angle, *self.spins, self._middle_roll]

    @staticmethod
    def task(mechanism: Mechanism, s: ca.SX, parameters: ca.SX) -> ca.SX:
        """Return the task coordinates of the tip's curve as an expression."""
        terms = ca.reshape(parameters[:12], 3, 4)
        angle, first_spin, last_spin, middle_roll = ca.vertsplit(parameters[12:])
        tip = terms @ ca.vertcat(1, s, ca.cos(s * angle), ca.sin(s * angle))
        spin = first_spin + s * (last_spin - first_spin)
        return task_of_tip_symbolic(mechanism, tip, middle_roll, spin)

    @cached_property
    def _middle_roll(self) -> float:
        """Roll (rotation of the tool about joint 1) in the middle of the path, rad.

        The closed form returns rolls within half a turn of this value, so that the roll does not
        jump by a whole turn along the path.
        """
        return roll_of_tip(self.mechanism, self.tips(np.array([0.5]))[0])


def find_sign_change(function: Callable[[Array], Array], low: float, high: float) -> float:
    """Find the root of a function between two points at which it has different signs.

    The function is sampled at `PATH_SAMPLES` points of the interval. The first part between two
    samples with a change of sign becomes the next interval, and so on. This needs fewer calls than
    a bisection, because the function takes arrays.

    Parameters
    ----------
    function : callable
        Function of s (n,) that returns (n,) values.
    low, high : float
        Ends of the interval.

    Returns
    -------
    float
        The root, to within 1e-13 of the length of the interval.
    """
    # Each round divides the interval by 400. Five rounds reduce it to 1e-13 of its length.
    for _ in range(5):
        s = np.linspace(low, high, PATH_SAMPLES)
        values = function(s)
        roots = np.flatnonzero(np.signbit(values[1:]) != np.signbit(values[:-1]))
        if not len(roots):  # The root is within rounding of one of the ends.
            return low if abs(values[0]) < abs(values[-1]) else high
        low, high = s[roots[0]], s[roots[0] + 1]
    return float(low + high) / 2


def add_knots(knots: Array, candidates: Iterable[float]) -> Array:
    """Add the values of s at which joints reverse to the knots of a path.

    A value that is at most `EQUALITY_TOLERANCE` away from a knot is left out. Joints that reverse
    together thus give one knot.

    Parameters
    ----------
    knots : (k,) array
        Values of s between which the path is smooth.
    candidates : iterable of float
        Values of s at which a joint reverses.

    Returns
    -------
    (m,) array
        The knots and the values that were added, in increasing order.
    """
    for knot in sorted(candidates):
        if np.abs(knots - knot).min() > EQUALITY_TOLERANCE:
            knots = np.append(knots, knot)
    return np.sort(knots)


@record
class MotionPath(JointPath):
    """The path of an existing motion, q(s) with s = t / duration, to be given a new timing.

    The joint positions are the polynomials of the motion. The existing motion thus has the constant
    path speed ṡ = ds/dt = 1 / duration. Where the robot rests, q' is 0 but ṡ is not. A new timing
    from rest to rest therefore begins and ends with this ṡ, and not with 0.
    """

    mechanism: Mechanism
    trajectory: Trajectory
    """The motion as joint polynomials."""
    knots: Array
    """Values of s between which no joint reverses, (k + 1,)."""
    signs: Array
    """Directions +1, −1 or 0 of the joints between the knots, (k, 4)."""

    @property
    def directions(self) -> tuple[Array, Array]:
        """Knots of s between which no joint reverses, and the directions of the joints.

        The knots (k + 1,) increase from 0 to 1. The directions (k, 4) between them are +1, −1, or 0
        for a joint at rest.
        """
        return self.knots, self.signs

    def grid(self, points: int) -> Array:
        """Return values of s from 0 to 1 at which TOPP-RA evaluates the limits.

        q'' jumps at the breaks of the motion, the ends of its polynomials. A grid point therefore
        lies close to each side of every break, and the others lie between the breaks.

        Parameters
        ----------
        points : int
            Approximate number of grid points.

        Returns
        -------
        (n,) array
            Increasing values of s. n exceeds `points` if the motion has many breaks.
        """
        breaks = self.trajectory.breaks / self.trajectory.duration
        remaining = max(points - 2 * (len(breaks) - 1), 0)
        grid = [0.0]
        for start, end in pairwise(breaks):
            count = max(round((end - start) * remaining), 1)
            shares = np.linspace(BREAK_OFFSET, 1 - BREAK_OFFSET, count + 1)
            grid.extend(start + (end - start) * shares)
        return np.append(grid, 1.0)

    def sample(self, s: Array) -> PathSamples:
        """Evaluate the joint positions and their derivatives with respect to the path parameter.

        Parameters
        ----------
        s : (n,) array
            Path parameters. Values outside of 0 to 1 count as the nearest end.

        Returns
        -------
        PathSamples
            Joint positions q, and the derivatives q' = dq/ds and q'' = d²q/ds², (n, 4) each.
        """
        s = np.asarray(s, dtype=float)
        duration = self.trajectory.duration
        samples = self.trajectory.sample(np.clip(s, 0.0, 1.0) * duration)
        dq, ddq = samples.qd * duration, samples.qdd * duration**2
        # Rounding of the polynomials must not move a joint at rest.
        at_rest = ~self.signs.any(axis=0)
        dq[:, at_rest] = ddq[:, at_rest] = 0.0
        return PathSamples(s, samples.q, dq, ddq)


def joint_starts(
    samples: PathSamples, knots: Array, directions: Array, *, moving: bool = False
) -> Mask:
    """Mark the samples of a path at which joints start to move after a rest or a reversal.

    Friction is static there.

    Parameters
    ----------
    samples : PathSamples
        q, q' and q'' at n values of s.
    knots : (m + 1,) array
        Values of s between which no joint reverses.
    directions : (m, 4) array
        Directions +1, −1 or 0 of the joints between the knots.
    moving : bool
        True if ṡ is not 0 at s = 0. A joint then starts there only if its q' is 0.

    Returns
    -------
    (n, 4) mask
        True for a joint and a sample if the joint starts at a knot, and if the sample is the first
        one at or behind this knot.
    """
    before = np.vstack([np.zeros(4), directions[:-1]])
    begins = (directions != 0.0) & (directions != before)
    if moving:
        begins[0] &= samples.dq[0] == 0.0
    # Index of the first sample at or behind each knot.
    first = np.minimum(np.searchsorted(samples.s, knots[:-1]), len(samples.s) - 1)
    starts = np.zeros((len(samples.s), 4), dtype=bool)
    starts[first] = begins
    return starts


@record
class SplinePath(JointPath):
    """The natural cubic spline q(s) through given joint positions.

    The value of s at a point is the length of the polyline from the first point to this one, as a
    share of the length of the whole polyline. The joint positions are divided by `scale` before
    lengths are measured. No two consecutive points may be equal.
    """

    mechanism: Mechanism
    points: Array
    """Joint positions, (k + 1, 4), rad and m."""
    scale: Array
    """Divisors that make rad and m comparable, (4,), for example the velocity limits."""
    pieces: bool = False
    """True if `breaks` contains the ends of the cubic pieces, at which q''' jumps.

    Optimal control needs these ends, while TOPP-RA alone does not.
    """

    @property
    def breaks(self) -> Array:
        """Values of s between which the path counts as smooth, in increasing order.

        They are those of all points if the field `pieces` is true, and otherwise 0 and 1.
        """
        return self.nodes if self.pieces else super().breaks

    @cached_property
    def nodes(self) -> Array:
        """Values of s at the points, (k + 1,)."""
        distance = np.cumsum(np.linalg.norm(np.diff(self.points, axis=0) / self.scale, axis=1))
        return np.append(0.0, distance / distance[-1])

    @cached_property
    def _spline(self) -> Any:
        """The spline q(s) with second derivative 0 at both ends."""
        from scipy.interpolate import CubicSpline  # It loads slowly, and few paths are splines.

        return CubicSpline(self.nodes, self.points, axis=0, bc_type="natural")

    @property
    def grid_intervals(self) -> int:
        """Number of grid intervals that TOPP-RA needs, which grows with the number of points."""
        return _limited_grid_size(INTERVALS_PER_POINT * len(self.points))

    def sample(self, s: Array) -> PathSamples:
        """Evaluate q, q' = dq/ds and q'' = d²q/ds² at n path parameters, (n, 4) each."""
        s = np.asarray(s, dtype=float)
        q, dq, ddq = (self._spline(s, order) for order in range(3))
        # Rounding of the spline must not move a joint whose points are all equal.
        at_rest = np.ptp(self.points, axis=0) < ROUNDING_TOLERANCE
        dq[:, at_rest] = ddq[:, at_rest] = 0.0
        return PathSamples(s, q, dq, ddq)

    @cached_property
    def directions(self) -> tuple[Array, Array]:
        """Knots of s at which joints reverse, and the directions of the joints between them.

        The knots (m + 1,) increase from 0 to 1. The directions (m, 4) are the signs of q' = dq/ds,
        and 0 for a joint at rest.
        """
        moving = np.flatnonzero(np.ptp(self.points, axis=0) >= ROUNDING_TOLERANCE)
        roots = self._spline.derivative().roots(extrapolate=False)
        reversals = np.concatenate([roots[i] for i in moving])
        # For an interval in which q' is 0 everywhere, SciPy's list contains a NaN.
        knots = add_knots(self.breaks, reversals[np.isfinite(reversals)])
        return knots, np.sign(self.sample((knots[1:] + knots[:-1]) / 2).dq)

    @property
    def deviation_from_lines(self) -> Array:
        """Largest deviation of each joint from the polyline through the points, (4,), rad and m.

        Spline and polyline are compared at `INTERVALS_PER_POINT` samples between two points. A
        sample divides the range of s between its two points in the same ratio as the line.
        """
        count = len(self.points) - 1
        share = np.linspace(0.0, 1.0, INTERVALS_PER_POINT * count + 1)
        s = np.interp(share, np.linspace(0.0, 1.0, count + 1), self.nodes)
        lines = PolylinePath(self.mechanism, self.points).sample(share)
        return np.asarray(np.abs(self.sample(s).q - lines.q).max(axis=0))


def split_at_corners(points: Array, scale: Array) -> list[Array]:
    """Split a sequence of points at the corners that a smooth curve cannot follow closely.

    At such a corner, the direction of the polyline through the points changes by more than
    `CORNER_ANGLE`. The point at the corner belongs to both parts. Of consecutive points that are
    less than `EQUALITY_TOLERANCE` apart, one is kept, because the direction between them is noise.

    Parameters
    ----------
    points : (n, 4) array
        Joint positions, rad and m.
    scale : (4,) array
        Divisors of the joints, which make rad and m comparable in distances and angles. The
        planner uses the velocity limits.

    Returns
    -------
    list of (k, 4) arrays
        The parts with at least two points each. Empty if all points coincide.
    """
    scaled = points / scale
    kept = [0]
    for k in range(1, len(scaled)):
        if np.linalg.norm(scaled[k] - scaled[kept[-1]]) > EQUALITY_TOLERANCE:
            kept.append(k)
    # The last point replaces an equal one, so that the motion ends exactly there.
    if len(kept) > 1:
        kept[-1] = len(points) - 1
    points = points[kept]
    steps = np.diff(scaled[kept], axis=0)
    directions = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    cosine = np.einsum("ij,ij->i", directions[1:], directions[:-1])
    cuts = [0, *(np.flatnonzero(cosine < np.cos(CORNER_ANGLE)) + 1).tolist(), len(points) - 1]
    return [points[a : b + 1] for a, b in pairwise(cuts) if b > a]


@record
class PolylinePath(JointPath):
    """The polyline in joint space through given points. All its lines take equal parts of s.

    Its second derivative counts as 0 everywhere, although the direction jumps at the points.
    """

    mechanism: Mechanism
    points: Array
    """Joint positions, (k + 1, 4), rad and m."""

    @property
    def directions(self) -> tuple[Array, Array]:
        """Values of s at the points, (k + 1,), and directions of the joints on the lines, (k, 4).

        A direction is +1, −1, or 0 for a joint that does not move on the line.
        """
        return np.linspace(0.0, 1.0, len(self.points)), np.sign(np.diff(self.points, axis=0))

    def sample(self, s: Array) -> PathSamples:
        """Evaluate the joint positions and their derivatives with respect to the path parameter.

        Parameters
        ----------
        s : (n,) array
            Path parameters from 0 to 1.

        Returns
        -------
        PathSamples
            q, q' = dq/ds and q'' = d²q/ds² = 0, (n, 4) each.
        """
        s = np.asarray(s, dtype=float)
        count = len(self.points) - 1
        # Index of the line that contains s. Clipping assigns s = 1 to the last line.
        index = np.clip((s * count).astype(int), 0, count - 1)
        displacement = np.diff(self.points, axis=0)[index]
        q = self.points[index] + (s * count - index)[:, None] * displacement
        return PathSamples(s, q, count * displacement, 0 * displacement)
