"""Check that a motion performs a task: its targets, waypoints, lines, dwells and durations.

The check searches the earliest instant at which each point is reached after the one before it. It
needs no phases, so it judges any table.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ssm_planner.kinematics import Mechanism, task_from_joints
from ssm_planner.problem import Dwell, Joints, Motion, PathDeparture, Point, Problem, Scan
from ssm_planner.trajectory import BLOCK, Span, Trajectory, blocks
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import Certificate, LimitCheck, Unjudged, worst_of_each
from ssm_planner.verification.promises import lines_kept, task_at, unchecked_lines

NEAR = np.array([2e-4, 2e-4, 2e-4, 1e-5])
"""Largest error at a point, rad and m: 0.01° and 10 µm."""
STILL = 0.1
"""Largest motion during a dwell, as a share of NEAR."""
TIMELY = 0.02
"""Largest relative error of a requested duration."""
INSTANTS = 20_000
MOST = 64
"""Least number of instants of a motion of many pieces, and the largest number in a piece."""
ROW = 5e-3
"""Time that a table without rows at the ends of a dwell may hide at each of them, s."""


def with_task(certificate: Certificate, motion: Trajectory, problem: Problem) -> Certificate:
    """Return a certificate with the points, lines, dwells and durations of a problem.

    The results are named "target", "waypoint", "dwell" and "duration". The worst value of a point
    is its error as a multiple of NEAR. `check` has judged the lines of a motion with phases.
    """
    limits = problem.task_limits
    unchecked = [text for text in certificate.unchecked if text != unchecked_lines(limits)]
    unjudged = list(certificate.unjudged)
    chain: list[Motion] = []
    path = _Path(motion, Mechanism.from_robot(problem.robot))
    _, error = path.nearest_index(path.errors(problem.start)[:1], 0)
    checks = [_of_point("target", "start", error, path.t[0])]
    begin = last = 0
    scanned = False
    for entry in problem.motion:
        if isinstance(entry, Dwell):
            stay, last = path.stay(last, entry.duration)
            checks.append(_timed("dwell", entry.name, min(stay, entry.duration), entry.duration))
        elif isinstance(entry, Scan):
            path.held = np.full(4, np.nan)
            scanned = True
        else:
            for point in getattr(entry, "through", ()):
                last, error = path.nearest_index(path.errors(point), last)
                checks.append(_of_point("waypoint", entry.name, error, path.t[last]))
            errors = path.errors(entry.to)
            is_open = getattr(entry, "spin_free", False), getattr(entry, "distance", 0)
            path.held[2:][np.array(is_open, bool)] = np.nan
            errors[:, np.isnan(path.held)] = np.nan
            chain.append(entry)
            if getattr(entry, "blend", None) is not None:
                continue
            final = entry is problem.motion[-1]
            last, error = path.nearest_index(errors, len(path.t) - 1 if final else last)
            checks.append(_of_point("target", entry.name, error, path.t[last]))
            if begin < last and not (scanned or motion.phases):
                span = Span(entry.name, float(path.t[begin]), float(path.t[last]))
                lines = lines_kept(motion, path.mechanism, limits, chain, span, allowed=NEAR[3])
                checks += lines[0]
                unjudged += lines[1]
            chain = []
            if entry.duration is not None:
                actual = float(path.t[last] - path.t[begin])
                checks.append(_timed("duration", entry.name, actual, entry.duration))
        begin = last
    if isinstance(problem.motion[-1], Dwell):
        _, error = path.nearest_index(errors, len(path.t) - 1)
        checks.append(_of_point("target", "end", error, path.t[-1]))
    if problem.duration is not None:
        checks.append(_timed("duration", problem.name, motion.duration, problem.duration))
    if scanned:
        reason = "the check does not know the spots of a scan"
        unjudged += [Unjudged(name, None, reason) for name in ("target", PathDeparture.name)]
    certificate = certificate.with_more(worst_of_each(checks))
    return replace(certificate, unchecked=tuple(unchecked), unjudged=tuple(unjudged))


def _of_point(name: str, entry: str, error: float, time: float) -> LimitCheck:
    return LimitCheck(
        name, None, error, limit=1.0, margin=1 - error, time=float(time), unit="", case=entry
    )


def _timed(name: str, entry: str, actual: float, asked: float) -> LimitCheck:
    margin = 1 - abs(actual / asked - 1) / TIMELY
    return LimitCheck(
        name, None, actual, limit=asked, margin=margin, time=0.0, unit="s", case=entry
    )


class _Path:
    """Instants of a motion, and where the robot is then."""

    def __init__(self, motion: Trajectory, mechanism: Mechanism) -> None:
        lengths = np.diff(motion.breaks)
        count = int(np.clip(INSTANTS / len(lengths), 1, MOST))
        inner = motion.breaks[:-1, None] + np.arange(count) / count * lengths[:, None]
        self.t = np.append(inner, motion.breaks[-1])
        every = blocks(len(self.t), BLOCK)
        self.q = np.concatenate([motion.positions(self.t[block]) for block in every])
        self.tasks = task_from_joints(mechanism, self.q)
        self.mechanism = mechanism
        self.branch = int(mechanism.branch_of(self.q[0]))
        self.held = self.tasks[0]
        """Task coordinates of the last point, (4,). Open ones are NaN."""

    def errors(self, point: Point) -> Array:
        """Return the errors (n, 4) of a point at all instants in multiples of NEAR.

        Coordinates that a pose does not state keep their values. Joint positions are compared as
        they are, because the same pose can have others.
        """
        self.held = task_at(self.mechanism, point, self.held, self.branch)
        if isinstance(point, Joints):
            return (self.q - point.values) / NEAR
        return ((self.tasks - self.held + np.pi) % (2 * np.pi) - np.pi) / NEAR

    def nearest_index(self, errors: Array, first: int) -> tuple[int, float]:
        """Return the first instant from `first` at which a point is reached, and the error.

        It is the first instant of the first stay within NEAR whose error is the smallest up to
        STILL, or the best of all instants. Between two instants the error is linear. Open
        coordinates keep the values that they have there.
        """
        error = np.nan_to_num(errors[first:])
        step = np.diff(error, axis=0, append=error[-1:])
        square = np.maximum((step**2).sum(axis=1), np.finfo(float).tiny)
        share = np.clip(-(error * step).sum(axis=1) / square, 0.0, 1.0)
        distance = np.linalg.norm(error + share[:, None] * step, axis=1)
        near = np.flatnonzero(distance <= 1)
        if len(near):
            stay = near[near - near[0] == np.arange(len(near))]
            distance = distance[: stay[-1] + 1]
            distance[: stay[0]] = np.inf
        best = int(np.argmax(distance <= distance.min() + STILL))
        self.held = np.where(np.isnan(self.held), self.tasks[first + best], self.held)
        return first + best, float(distance[best])

    def stay(self, first: int, duration: float) -> tuple[float, int]:
        """Return how long the joints rest from an instant, s, and the instant after a duration.

        ROW at both ends is added, because tables need not have rows there.
        """
        apart = (self.tasks[first:] - self.tasks[first]) / NEAR
        moved = np.linalg.norm(apart, axis=1) > 2 * STILL
        last = first + int(moved.argmax()) - 1 if moved.any() else len(self.t) - 1
        after = int(np.searchsorted(self.t, self.t[first] + duration))
        return float(self.t[last] - self.t[first]) + 2 * ROW, min(after, last)
