"""Guesses of the velocities at via points, for joints that reverse near a point.

A via point is a given point between the start and the end of a free motion. A via velocity is the
velocity of a joint there. A joint that is faster than the others may use its spare time to pass a
via point at speed. It then moves beyond the point and returns, or it first moves backwards and
accelerates towards the point (a run-up).

`suggest_via_velocities` finds such joints without a solver of the whole problem. It considers each
joint as if it were alone, with unknown velocities at the via points. Closed forms then give the
duration of each segment, that is, of the motion from one point to the next. The velocities that
minimise the sum of the durations show at which points a joint should pass at speed instead of
resting there.
"""

import numpy as np

from ssm_planner.planning.lower_bound import kinematic_limits, minimum_times
from ssm_planner.planning.ocp.motion import Borders
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.tolerances import EQUALITY_TOLERANCE
from ssm_planner.typing import Array, record

MIN_SAVING = 2e-3
"""Share of the duration that velocities at via points must save, or the planner ignores them.

It is larger than `GAP`, because the closed forms neglect motor torques. With twice the value, a
motion of the benchmark takes 2.6 % longer (`results/constants.md`).
"""
MAX_SLSQP_ITERATIONS = 60
"""Largest number of iterations of the optimisation, which computes only a guess."""
IDLE_TOLERANCE = 5e-4
"""Share of the duration that all velocities that are set to 0 may cost together.

It is a quarter of `MIN_SAVING`, so most of the saving remains. Each velocity that is not 0 forces a
reversal, which makes the optimal control problem larger.
"""


def suggest_via_velocities(phase: Phase) -> Borders | None:
    """Suggest reversals for joints that should pass a via point at speed where they could rest.

    A segment is the motion from one point to the next. Let d_jk be the displacement of joint j in
    segment k, and v_jk its unknown velocity at the end of the segment. The least total duration is

        min_v Σ_k max_j t(d_jk; v_j,k−1, v_jk),

    where t is the shortest time of one joint in closed form (`lower_bound.minimum_times`). The
    saving is the time that is lost if the joints that must reverse beside a point rest there
    instead.

    Parameters
    ----------
    phase : Phase
        An entry of the motion list whose path the solver may choose, with its problem and points.

    Returns
    -------
    Borders or None
        The points with the velocities there, from which the solver's first guess is built. None if
        reversals between the points save less than the share `MIN_SAVING` of the duration.
    """
    problem = phase.problem
    velocity, acceleration, _ = kinematic_limits(problem.robot, problem.task_limits)
    displacements = np.diff(phase.points, axis=0)
    joints = _ViaVelocityProblem(
        displacements, (phase.qd_start, phase.qd_end), velocity, acceleration
    )
    speeds = joints.minimise_duration()
    # A joint need not reverse beside a point that it passes in the direction of both displacements.
    passes = np.minimum(speeds * displacements[:-1], speeds * displacements[1:]) > 0
    without_reversals = np.where(passes, speeds, 0.0)
    if joints.duration(speeds) > (1 - MIN_SAVING) * joints.duration(without_reversals):
        return None
    return Borders(phase.points, via_velocity=joints.without_idle_velocities(speeds))


@record
class _ViaVelocityProblem:
    """Joints that pass the via points at the same instants, each limited as if it were alone.

    The motion has n segments, one from each point to the next. It therefore has n − 1 via points,
    which are the points between start and end.
    """

    displacements: Array
    """Displacements from point to point, (n, 4), rad and m."""
    ends: tuple[Array, Array]
    """Joint velocities at the start and at the end of the motion, (4,) each."""
    velocity: Array
    """Largest velocities of the joints, (4,)."""
    acceleration: Array
    """Largest accelerations of the joints, (4,)."""

    def times(self, speeds: Array) -> Array:
        """Return the shortest time in which each joint alone can cover each segment.

        A segment is the motion from one point to the next.

        Parameters
        ----------
        speeds : (..., n − 1, 4) array
            Joint velocities at the via points (between start and end), rad/s and m/s.

        Returns
        -------
        (..., n, 4) array
            Times, s.
        """
        start, end = (np.broadcast_to(end, (*speeds.shape[:-2], 1, 4)) for end in self.ends)
        starts = np.concatenate([start, speeds], axis=-2)
        ends = np.concatenate([speeds, end], axis=-2)
        return minimum_times(self.displacements, self.velocity, self.acceleration, (starts, ends))

    def duration(self, speeds: Array) -> float:
        """Return the total duration, s. In every segment, the slowest joint determines the time.

        A segment is the motion from one point to the next.

        Parameters
        ----------
        speeds : (n − 1, 4) array
            Joint velocities at the via points (between start and end), rad/s and m/s.
        """
        return float(self.times(speeds).max(axis=1).sum())

    def minimise_duration(self) -> Array:
        """Find the joint velocities at the via points that minimise the total duration.

        The unknowns are the duration T_k of each segment and the velocities. SLSQP, a method of
        sequential quadratic programming, minimises Σ T_k subject to T_k ≥ t_jk, with the time t_jk
        that joint j needs for segment k. It starts with joints that rest at all via points.

        Returns
        -------
        (n − 1, 4) array
            Velocities at the via points, rad/s and m/s. All are 0 if SLSQP finds nothing faster.
        """
        from scipy.optimize import fmin_slsqp

        segments = len(self.displacements)
        at_rest = np.zeros((segments - 1, 4))
        # The unknowns are T_k / unit, then the velocities divided by their limits.
        unit = self.duration(at_rest)
        start = np.append(self.times(at_rest).max(axis=1) / unit, at_rest)
        gradient = np.append(np.ones(segments), at_rest)

        def total_gradient(_: Array) -> Array:
            """Return the gradient of the objective Σ T_k, which is constant."""
            return gradient

        def speeds(unknowns: Array) -> Array:
            """Return the velocities (..., n − 1, 4) at the via points, rad/s and m/s."""
            shares = unknowns[..., segments:].reshape(*unknowns.shape[:-1], -1, 4)
            return np.asarray(shares * self.velocity)

        def margins(unknowns: Array) -> Array:
            """Return the margins (T_k − t_jk) / unit, (..., 4 n), which must not be negative.

            The joints j of segment 1 come first, then those of segment 2, and so on.
            """
            differences = unknowns[..., :segments, None] - self.times(speeds(unknowns)) / unit
            return np.asarray(differences.reshape(*unknowns.shape[:-1], -1))

        def margin_gradients(unknowns: Array) -> Array:
            """Return the finite differences of `margins` by all unknowns, (4 n, n + 4 (n − 1))."""
            steps = EQUALITY_TOLERANCE * np.eye(len(unknowns))
            return (margins(unknowns + steps) - margins(unknowns)).T / EQUALITY_TOLERANCE

        solution = fmin_slsqp(
            gradient.dot,
            start,
            fprime=total_gradient,
            bounds=[*[(0.0, np.inf)] * segments, *[(-1.0, 1.0)] * at_rest.size],
            f_ieqcons=margins,
            fprime_ieqcons=margin_gradients,
            iter=MAX_SLSQP_ITERATIONS,
            acc=EQUALITY_TOLERANCE,
            iprint=0,
        )
        # SLSQP may return values slightly beyond the bounds.
        result = np.clip(speeds(solution), -self.velocity, self.velocity)
        return result if self.duration(result) < unit else at_rest

    def without_idle_velocities(self, speeds: Array) -> Array:
        """Set velocities at via points to 0 if they save almost no time.

        A joint that passes a point at speed where it could rest must reverse before or after the
        point. This reversal makes the optimal control problem larger. The velocities are set to 0
        one after the other, the smallest shares of the limits first. A velocity is kept if the
        total duration would otherwise exceed that of `speeds` by more than the share
        `IDLE_TOLERANCE`.

        Parameters
        ----------
        speeds : (n − 1, 4) array
            Joint velocities at the via points (between start and end), rad/s and m/s.

        Returns
        -------
        (n − 1, 4) array
            The remaining velocities, and 0 for the others.
        """
        result = speeds.copy()
        longest = (1 + IDLE_TOLERANCE) * self.duration(speeds)
        order = np.argsort(np.abs(speeds / self.velocity), axis=None)
        for k, j in zip(*np.unravel_index(order, speeds.shape), strict=True):
            trial = result.copy()
            trial[k, j] = 0.0
            if self.duration(trial) <= longest:
                result = trial
        return result
