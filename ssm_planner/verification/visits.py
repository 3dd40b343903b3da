"""Check that a motion performs a task: its targets, waypoints, lines, dwells and durations.

`check` only judges the limits. The function `with_task_results` of this module judges whether the
motion visits all points of a problem in their order. It searches the earliest instant at which each
point is reached after the previous one. It does not need the times of phases, so it can judge any
table of points.
"""

from dataclasses import replace

import numpy as np

from ssm_planner.kinematics import Mechanism, task_from_joints
from ssm_planner.problem import (
    Dwell,
    Follow,
    Free,
    Joints,
    Motion,
    PathDeparture,
    Point,
    Problem,
    Scan,
    Straight,
)
from ssm_planner.trajectory import Span, Trajectory
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import (
    Certificate,
    LimitCheck,
    Unjudged,
    worst_result_per_limit,
)
from ssm_planner.verification.promises import (
    check_table_lines,
    task_coordinates_of,
    unchecked_lines_remark,
)

POINT_TOLERANCE = np.array([2e-4, 2e-4, 2e-4, 1e-5])
"""Largest permitted error at a point for the four coordinates, rad and m: 0.01° and 10 µm."""
DWELL_TOLERANCE = 0.1
"""Largest error of the position during a dwell, as a share of `POINT_TOLERANCE`."""
DURATION_TOLERANCE = 0.02
"""Largest permitted relative error of a requested duration."""
MIN_INSTANTS = 20_000
"""Approximate number of sampled instants of a motion."""
MAX_PIECE_INSTANTS = 64
"""Largest number of sampled instants in a piece."""
OMITTED_DWELL_TIME = 5e-3
"""Duration by which a table may shorten a dwell at each end, s.

The rows of a table have distances in time, so the first and the last row at a point need not mark
the exact start and end of the dwell.
"""


def with_task_results(
    certificate: Certificate, motion: Trajectory, problem: Problem
) -> Certificate:
    """Judge whether a motion visits all points of a problem, and add the results to a certificate.

    The new results are named "target", "waypoint", "dwell" and "duration". The worst value of a
    point is its error as a multiple of `POINT_TOLERANCE`. The lines of the problem are judged too,
    unless the motion has phases, because `check` has already judged their lines.

    Parameters
    ----------
    certificate : Certificate
        Result of `check` for the motion.
    motion : Trajectory
        The motion, or a table of points.
    problem : Problem
        The problem that the motion must solve.

    Returns
    -------
    Certificate
        The certificate with the new results.
    """
    limits = problem.task_limits
    unchecked = [text for text in certificate.unchecked if text != unchecked_lines_remark(limits)]
    unjudged = list(certificate.unjudged)
    path = _TaskProgress(motion, Mechanism.from_robot(problem.robot))
    _, error = path.first_visit(path.errors(problem.start)[:1], 0)
    checks = [_point_result("target", "start", error, path.t[0])]
    begin_index = index = 0  # instants at which the current entry begins and ends
    chain: list[Motion] = []  # consecutive motions without a stop between them
    scanned = False
    for entry in problem.motion:
        if isinstance(entry, Dwell):
            stay, index = path.measure_rest(index, entry.duration)
            # A longer rest is not an error.
            counted_stay = min(stay, entry.duration)
            checks.append(_duration_result("dwell", entry.name, counted_stay, entry.duration))
        elif isinstance(entry, Scan):
            # The position at the end of a scan is not known here, so all coordinates are open.
            path.last_task = np.full(4, np.nan)
            scanned = True
        else:
            for point in getattr(entry, "through", ()):
                index, error = path.first_visit(path.errors(point), index)
                checks.append(_point_result("waypoint", entry.name, error, path.t[index]))
            errors = path.target_errors(entry)
            chain.append(entry)
            if getattr(entry, "blend", None) is not None:
                continue  # the next motion follows without a stop, so its target counts
            # The last target must be reached at the end of the motion.
            is_last = entry is problem.motion[-1]
            first_index = len(path.t) - 1 if is_last else index
            index, error = path.first_visit(errors, first_index)
            checks.append(_point_result("target", entry.name, error, path.t[index]))
            if begin_index < index and not (scanned or motion.phases):
                span = Span(entry.name, float(path.t[begin_index]), float(path.t[index]))
                line_checks, unjudged_lines = check_table_lines(
                    motion, path.mechanism, limits, chain, span, allowed=POINT_TOLERANCE[3]
                )
                checks += line_checks
                unjudged += unjudged_lines
            chain = []
            if entry.duration is not None:
                actual = float(path.t[index] - path.t[begin_index])
                checks.append(_duration_result("duration", entry.name, actual, entry.duration))
        begin_index = index
    if isinstance(problem.motion[-1], Dwell):
        _, error = path.first_visit(errors, len(path.t) - 1)
        checks.append(_point_result("target", "end", error, path.t[-1]))
    if problem.duration is not None:
        checks.append(_duration_result("duration", problem.name, motion.duration, problem.duration))
    if scanned:
        reason = "the check does not know the spots of a scan"
        unjudged += [Unjudged(name, None, reason) for name in ("target", PathDeparture.name)]
    certificate = certificate.with_more(worst_result_per_limit(checks))
    return replace(certificate, unchecked=tuple(unchecked), unjudged=tuple(unjudged))


def _point_result(name: str, entry: str, error: float, time: float) -> LimitCheck:
    """Build the result for a target or waypoint.

    The limit of the error is 1, because the error is a multiple of the tolerance.

    Parameters
    ----------
    name : str
        "target" or "waypoint".
    entry : str
        Name of the motion.
    error : float
        Distance from the point as a multiple of `POINT_TOLERANCE`.
    time : float
        Instant of this distance, s.

    Returns
    -------
    LimitCheck
        The result with the margin 1 − error.
    """
    return LimitCheck(
        name, None, error, limit=1.0, margin=1 - error, time=float(time), unit="", case=entry
    )


def _duration_result(name: str, entry: str, actual: float, requested: float) -> LimitCheck:
    """Build the result for the duration of a motion or dwell.

    Parameters
    ----------
    name : str
        "dwell" or "duration".
    entry : str
        Name of the motion.
    actual, requested : float
        Actual and requested duration, s. The relative error of the actual duration must be at most
        `DURATION_TOLERANCE`.

    Returns
    -------
    LimitCheck
        The result, whose limit is the requested duration.
    """
    margin = 1 - abs(actual / requested - 1) / DURATION_TOLERANCE
    return LimitCheck(
        name, None, actual, limit=requested, margin=margin, time=0.0, unit="s", case=entry
    )


class _TaskProgress:
    """A motion that is sampled at n instants, and the point that the search has reached last.

    Attributes
    ----------
    t : (n,) array
        Instants, s.
    q, tasks : (n, 4) arrays
        Joint positions and task coordinates.
    branch : int
        Which of the two solutions of the inverse kinematics the joints have at the start: positive
        for the first one.
    """

    def __init__(self, motion: Trajectory, mechanism: Mechanism) -> None:
        """Sample a motion at all breaks, and at further instants within its pieces.

        Parameters
        ----------
        motion : Trajectory
            The motion, or a table of points.
        mechanism : Mechanism
            Kinematics of the robot.
        """
        lengths = np.diff(motion.breaks)
        count = int(np.clip(MIN_INSTANTS / len(lengths), 1, MAX_PIECE_INSTANTS))
        inner = motion.breaks[:-1, None] + np.arange(count) / count * lengths[:, None]
        self.t = np.append(inner, motion.breaks[-1])
        self.q = motion.positions(self.t)
        self.tasks = task_from_joints(mechanism, self.q)
        self.mechanism = mechanism
        self.branch = int(mechanism.branch_of(self.q[0]))
        self.last_task = self.tasks[0]
        """Task coordinates of the last point, (4,), rad and m.

        A coordinate that the task leaves open is NaN until the motion reaches the point.
        """

    def errors(self, point: Point) -> Array:
        """Compute the distance of the motion from a point at all instants.

        A coordinate that the point does not state keeps its value from the previous point. Joint
        positions are compared directly, because several joint positions can have the same pose.

        Parameters
        ----------
        point : Point
            Task coordinates, joint positions, or a position of the tip with a spin.

        Returns
        -------
        (n, 4) array
            Errors of the four coordinates, in multiples of `POINT_TOLERANCE`.
        """
        self.last_task = task_coordinates_of(self.mechanism, point, self.last_task, self.branch)
        if isinstance(point, Joints):
            return (self.q - point.values) / POINT_TOLERANCE
        # Angles that differ by whole turns are equal. The same formula leaves differences of the
        # depth unchanged, because they are far below π m.
        return ((self.tasks - self.last_task + np.pi) % (2 * np.pi) - np.pi) / POINT_TOLERANCE

    def target_errors(self, entry: Straight | Free | Follow) -> Array:
        """Compute the distance of the motion from the target of an entry at all instants.

        An entry may leave the spin open, and a curve along the retina leaves the depth open.

        Parameters
        ----------
        entry : Straight, Free or Follow
            Motion of the problem with its target.

        Returns
        -------
        (n, 4) array
            Errors of the four coordinates, in multiples of `POINT_TOLERANCE`. NaN for an open one.
        """
        errors = self.errors(entry.to)
        for k, attribute in ((2, "spin_free"), (3, "distance")):
            if getattr(entry, attribute, None):
                self.last_task[k] = np.nan
        errors[:, np.isnan(self.last_task)] = np.nan
        return errors

    def first_visit(self, errors: Array, first_index: int) -> tuple[int, float]:
        """Find the first instant at which the motion reaches a point.

        A visit is a sequence of consecutive instants with an error of at most 1. Within the first
        visit, the result is the earliest instant whose error exceeds the smallest error by at most
        `DWELL_TOLERANCE`. If the motion never reaches the point, the result is the instant with the
        smallest error. The error is assumed to be linear between two instants. Open coordinates
        (NaN in `last_task`) take their values at the result.

        Parameters
        ----------
        errors : (n, 4) array
            Errors at all instants, in multiples of `POINT_TOLERANCE`. NaN means that the coordinate
            is open.
        first_index : int
            Index of the instant at which the search starts.

        Returns
        -------
        index : int
            Index of the instant.
        error : float
            Error there, in multiples of `POINT_TOLERANCE`.
        """
        # The error at the fraction λ of a step is |error + λ step|, which is smallest at `share`.
        error = np.nan_to_num(errors[first_index:])
        step = np.diff(error, axis=0, append=error[-1:])
        square = np.maximum((step**2).sum(axis=1), np.finfo(float).tiny)
        share = np.clip(-(error * step).sum(axis=1) / square, 0.0, 1.0)
        distance = np.linalg.norm(error + share[:, None] * step, axis=1)
        near_indices = np.flatnonzero(distance <= 1)
        if len(near_indices):
            # Only consecutive instants belong to the first visit.
            stay = near_indices[near_indices - near_indices[0] == np.arange(len(near_indices))]
            distance = distance[: stay[-1] + 1]
            distance[: stay[0]] = np.inf
        best_index = int(np.argmax(distance <= distance.min() + DWELL_TOLERANCE))
        self.last_task = np.where(
            np.isnan(self.last_task), self.tasks[first_index + best_index], self.last_task
        )
        return first_index + best_index, float(distance[best_index])

    def measure_rest(self, first_index: int, duration: float) -> tuple[float, int]:
        """Measure how long the robot rests, beginning with a given instant.

        Parameters
        ----------
        first_index : int
            Index of the instant.
        duration : float
            Requested duration of the rest, s.

        Returns
        -------
        stay : float
            Duration of the rest, s. It includes `OMITTED_DWELL_TIME` at both ends.
        end_index : int
            Index of the instant after the requested duration, or of the end of the rest if it is
            earlier.
        """
        displacement = (self.tasks[first_index:] - self.tasks[first_index]) / POINT_TOLERANCE
        has_moved = np.linalg.norm(displacement, axis=1) > 2 * DWELL_TOLERANCE
        rest_index = len(self.t) - 1
        if has_moved.any():
            rest_index = first_index + int(has_moved.argmax()) - 1
        end_index = int(np.searchsorted(self.t, self.t[first_index] + duration))
        stay = float(self.t[rest_index] - self.t[first_index]) + 2 * OMITTED_DWELL_TIME
        return stay, min(end_index, rest_index)
