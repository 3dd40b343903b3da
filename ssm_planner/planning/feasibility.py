"""Phases that geometry allows, and reasons that it gives before any solver runs.

The reasons are ranges, the eye, velocities, and distances to stop. `infeasible_place` checks
straight paths and the points of other motions, and `with_boundary_rates` the velocities at both
ends of a motion.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import chain, pairwise, product

import numpy as np

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.errors import ProblemError
from ssm_planner.kinematics import (
    eye_limits,
    joint_rates,
    task_from_joints,
    task_of_joints,
    task_rates,
    tip_position,
)
from ssm_planner.planning.phases import (
    Phase,
    phases_from,
    reversal_ranges,
    start_configurations,
    straight_path,
)
from ssm_planner.planning.reason import Reason, exceeded
from ssm_planner.planning.retiming.constraints import braking_travel
from ssm_planner.planning.retiming.paths import PolylinePath
from ssm_planner.planning.tolerances import ROUNDING, SAME
from ssm_planner.problem import (
    TASK,
    Free,
    JointAcceleration,
    JointPosition,
    JointVelocity,
    LensClearance,
    Limit,
    Problem,
    RetinaClearance,
    TaskRange,
    in_words,
)
from ssm_planner.typing import Array, record

RATES = ("start_rate", "end_rate")
"""Keys of the velocities at both ends of a problem."""


@record
class _Places:
    """Joints q (n, 4) at s (n,) along a phase, where s counts the points of a free motion."""

    phase: Phase
    s: Array
    q: Array

    @classmethod
    def of_phase(cls, phase: Phase) -> _Places:
        """Return samples of a path, or the points of another motion."""
        if phase.path is None:
            return cls(phase, np.linspace(0.0, 1.0, len(phase.points)), phase.points)
        return cls(phase, phase.path.overview.s, phase.path.overview.q)

    def location(self, k: int) -> str:
        """Describe the place of sample k."""
        name, s = self.phase.motion.name, float(self.s[k])
        if s in (0.0, 1.0):
            return f"{name}, at its {'end' if s else 'start'}"
        if self.phase.path is None:
            return f"{name}, at point {k} on its way"
        return f"{name}, {100 * s:.0f} % of the way"

    def refined(self, k: int) -> _Places:
        """Return samples between the neighbours of sample k of a path."""
        if self.phase.path is None:
            return self
        beside = self.s[max(k - 1, 0) : k + 2]
        s = np.linspace(beside[0], beside[-1], len(self.s))
        return _Places(self.phase, s, self.phase.path.sample(s).q)


def _worst(limit: Limit, values: Array) -> tuple[int, float]:
    """Return the index of the value (n,) that exceeds a limit most, and the value."""
    k = int(np.argmax(np.maximum(limit.low - values, values - limit.high)))
    return k, float(values[k])


def _excess(
    places: _Places, limit: Limit, values: Array, words: str, tolerance: float = ROUNDING
) -> Reason | None:
    """Return the worst of values (n,) at places beyond a limit, or None.

    `words` is the message, with {value} and {bound} in the limit's unit.
    """
    k, worst = _worst(limit, values)
    return exceeded(limit, worst, places.location(k), words, tolerance)


def feasible_phases(
    problem: Problem,
) -> tuple[tuple[Phase, ...], Reason | None]:
    """Return the phases of a problem, or the reason why no start configuration allows them.

    Start configurations are tried in order, from the home branch and the one nearest to q = 0. The
    first one is taken whose joints stay in range on all phases. The phases contain the rates at
    both ends.

    Raises
    ------
    ProblemError
        If a point is out of reach, or if no motion goes anywhere.
    """
    reasons = []
    for q in start_configurations(problem):
        phases = phases_from(problem, q)
        reason = infeasible_place(phases)
        if reason is None:
            return with_boundary_rates(phases)
        reasons.append(reason)
        if isinstance(reason.limit, (RetinaClearance, LensClearance)):
            # All joint solutions bring the tip to the same place, so other start configurations
            # do not help.
            break
    return (), reasons[0]


def eye_forbids_target(problem: Problem) -> bool:
    """Return True if the eye forbids a place that the problem gives.

    Other joints cannot change that.
    """
    _, reason = feasible_phases(problem)
    return reason is not None and isinstance(reason.limit, (RetinaClearance, LensClearance))


def infeasible_place(phases: Sequence[Phase]) -> Reason | None:
    """Return the reason for the first place that a limit forbids, or None.

    The limits are the ranges of joints and task coordinates, the retina's clearance and the lens.
    """

    def reasons(phase: Phase) -> Iterator[Reason | None]:
        yield from _beyond_ranges(phase)
        yield from _past_boundary(phase)
        yield blocked_by_eye(phase)

    return _first_reason(chain.from_iterable(map(reasons, phases)))


def _first_reason(reasons: Iterable[Reason | None]) -> Reason | None:
    """Return the first reason that is not None, if there is one."""
    return next(filter(None, reasons), None)


def _beyond_ranges(phase: Phase) -> Iterator[Reason | None]:
    """Yield the reasons of joints and task coordinates, or None for those within their range."""
    places = _Places.of_phase(phase)
    ends = "{value}, but its range ends at {bound}"
    for joint, values in zip(phase.problem.robot.joints, places.q.T, strict=True):
        words = f"joint {joint.name} would have to reach {ends}"
        yield _excess(places, joint.limit(JointPosition), values, words)
    wrapped = task_from_joints(phase.mechanism, places.q)
    task = np.stack(task_of_joints(NUMPY, phase.mechanism, places.q.T), axis=1)
    continuous = task + 2 * np.pi * np.round((phase.start - task[0]) / (2 * np.pi)) * (1, 0, 1, 0)
    for limit in phase.problem.limits:
        if isinstance(limit, TaskRange):
            # A range of a turn or more excludes no angle, so values may be wrapped.
            of_turn = limit.high - limit.low >= 2 * np.pi
            values = (wrapped if of_turn else continuous)[:, TASK.index(limit.coordinate)]
            words = f"{limit.coordinate} would have to be {ends}"
            yield _excess(places, limit, values, words, SAME)


def _past_boundary(phase: Phase) -> Iterator[Reason | None]:
    """Yield the tilt range if joint 2 must leave it at the workspace boundary.

    Tilt depends on joint 2 alone. Its extremes are where the branches of the inverse kinematics
    meet, at δ + k π. Every motion between points on both sides of an extreme passes it.
    """
    mechanism, problem = phase.mechanism, phase.problem
    limit = problem.limit(TaskRange.name_of("tilt"), None)
    if phase.path is not None or limit is None:
        return
    for k, (start, end) in enumerate(pairwise(phase.points)):
        low, high = sorted((float(start[1]), float(end[1])))
        location = f"{phase.motion.name}, between its points {k} and {k + 1}"
        words = (
            f"joint {problem.robot.joints[1].name} passes the workspace boundary between "
            f"{in_words(low, 'rad')} and {in_words(high, 'rad')}, where tilt is {{value}}, "
            "but the range of tilt ends at {bound}"
        )
        first = np.ceil((low - mechanism.delta) / np.pi)
        extremes = mechanism.delta + np.pi * np.arange(first, (high - mechanism.delta) / np.pi)
        joints = np.tile(start, (len(extremes), 1))
        joints[:, 1] = extremes
        if len(extremes):
            tilt = _worst(limit, task_from_joints(mechanism, joints)[:, 1])[1]
            yield exceeded(limit, tilt, location, words, SAME)


def blocked_by_eye(phase: Phase) -> Reason | None:
    """Return the retina or the lens if a phase comes too near to it.

    A path is sampled again about its worst sample, because the distance has a sharp corner at the
    port.
    """
    eye = phase.problem.eye
    if eye is None:
        return None
    for limit in eye.limits:
        words = (
            "the tip would come within {value} of the retina, but the clearance is {bound}"
            if isinstance(limit, RetinaClearance)
            else "the shaft would touch the lens: it would pass at {value} times the size of the "
            "lens from its centre, but at least {bound} is required"
        )
        places = _Places.of_phase(phase)
        for _ in range(2):
            tips = tip_position(phase.mechanism, places.q)
            values, _ = eye_limits(NUMPY, eye, tips.T)[limit.name]
            reason = _excess(places, limit, values, words)
            if reason is not None:
                return reason
            places = places.refined(int(np.argmin(values)))
    return None


def nearest_to_eye(phase: Phase) -> Array:
    """Return the joints (4,) nearest to retina or lens, or deepest in them, between two points.

    The joints move along a straight line.
    """
    path = PolylinePath(phase.mechanism, phase.points)
    q = path.overview.q
    assert phase.problem.eye is not None
    limits = eye_limits(NUMPY, phase.problem.eye, tip_position(phase.mechanism, q).T).values()
    ratios = [values / smallest for values, smallest in limits if smallest > 0]
    return np.asarray(q[int(np.argmin(np.min(ratios, axis=0)))])


def straight_instead(phase: Phase) -> Phase | None:
    """Return a free phase from rest to rest as a straight line in task coordinates.

    None if the line is not possible, or if a limit forbids a place on it.
    """
    # The line in task coordinates must differ from the one in the joints.
    lines_differ = np.abs((phase.end - phase.start)[:2]).max() > ROUNDING
    if len(phase.points) != 2 or not phase.begins_and_ends_at_rest or not lines_differ:
        return None
    path = straight_path(phase.problem, phase.mechanism, phase.start, phase.end, phase.q_start)
    if np.abs(path.overview.q[-1] - phase.points[-1]).max() > ROUNDING:
        return None
    straight = replace(phase, path=path)
    return straight if infeasible_place((straight,)) is None else None


def with_boundary_rates(
    phases: tuple[Phase, ...],
) -> tuple[tuple[Phase, ...], Reason | None]:
    """Return the phases with q̇ at the start of the first and at the end of the last one.

    The reason is set if they cannot have these velocities.

    Raises
    ------
    ProblemError
        If a straight motion would leave its line.
    """
    first, last = _bearer(phases), len(phases) - 1 - _bearer(phases[::-1])
    result = list(phases)
    qd = _end_velocity(result[first], 0)
    acceleration = np.array(phases[0].problem.start_acceleration)
    result[first] = replace(result[first], qd_start=qd, qdd_start=acceleration)
    qd = _end_velocity(result[last], -1)
    result[last] = replace(result[last], qd_end=qd)
    reasons = chain(
        _too_fast(result[first], 0),
        _too_fast(result[last], -1),
        _too_near(result[first]),
        _too_near(result[last]),
    )
    return tuple(result), _first_reason(reasons)


def _bearer(phases: Sequence[Phase]) -> int:
    """Return the index of the phase that begins with the rates at the start.

    A motion to the present position takes no time, so the next motion has the rates. If that is a
    dwell, or if there is none, the robot leaves its position and returns to it freely.
    """
    lasting = (k for k, phase in enumerate(phases) if phase.motion.duration or not phase.stands)
    index = next(lasting, len(phases) - 1)
    free = (k for k in range(index + 1) if isinstance(phases[k].motion, Free))
    return next(free, index) if phases[index].stands else index


def _end_velocity(phase: Phase, side: int) -> Array:
    """Return q̇ (4,) at the start (side 0) or the end (side −1) of a phase, from the task rates.

    Raises ProblemError for rates that do not point along the path of the phase.
    """
    key = RATES[side]
    problem, mechanism = phase.problem, phase.mechanism
    rate = np.array([getattr(problem, key).get(name, 0.0) for name in TASK])
    if not rate.any():
        return np.zeros(4)
    if phase.stands and not isinstance(phase.motion, Free):
        raise ProblemError(
            "a dwell has no speed", file=problem.file, line=phase.motion.line, key=key
        )
    if phase.path is not None:
        sample = phase.path.sample(np.array([-float(side)]))
        direction = task_rates(mechanism, sample.q, sample.dq)[0]
        projection = direction * (direction @ rate) / (direction @ direction)
        off_line = np.abs(rate - projection).max() > ROUNDING * np.abs(rate).max()
        if direction @ rate < 0 or off_line:
            raise ProblemError(
                f"a straight motion ({phase.motion.name}) keeps to its line, towards its target",
                file=problem.file,
                key=key,
                allowed="rates along the line, in the direction of the motion",
            )
    qd = joint_rates(mechanism, phase.points[side], rate)
    still = np.abs(qd) < ROUNDING * problem.robot.velocities
    return np.where(still, 0.0, qd)


def _too_fast(phase: Phase, side: int) -> Iterator[Reason | None]:
    """Yield the limits that velocities at an end exceed: velocities, and the distance to stop."""
    qd = (phase.qd_start, phase.qd_end)[side]
    location = f"{phase.motion.name}, {RATES[side].replace('_', ' ')}"
    for joint, speed in zip(phase.problem.robot.joints, np.abs(qd).tolist(), strict=True):
        words = f"joint {joint.name} would move at {{value}}, but its limit is {{bound}}"
        limit = joint.limit(JointVelocity)
        yield exceeded(limit, speed, location, words, ROUNDING * limit.largest)
    stop = phase.problem.stop_travel
    if stop is not None:
        travel = braking_travel(
            phase.mechanism, phase.problem.robot, phase.points[[side]], qd[None]
        )
        words = "the tip needs {value} to stop, but only {bound} are allowed"
        yield exceeded(stop, float(travel[0]), location, words, ROUNDING * stop.largest)


def _too_near(phase: Phase) -> Iterator[Reason | None]:
    """Yield the limits of joints whose displacement is too short for their change of velocity.

    A path allows |q̇₁² − q̇₀²| ≤ 2 q̈_max |Δq|. A free motion may overshoot, and needs the range to
    do so.
    """
    if phase.path is None:
        yield from _ranges_exceeded(phase)
        return
    distances = np.abs(np.diff(phase.path.overview.q, axis=0)).sum(axis=0)
    changes = np.abs(phase.qd_start**2 - phase.qd_end**2)
    for i in np.flatnonzero(changes):
        joint = phase.problem.robot.joints[i]
        limit = joint.limit(JointAcceleration)
        distance = in_words(distances[i], joint.limit(JointPosition).unit)
        speeds = (
            in_words(abs(float(qd[i])), joint.limit(JointVelocity).unit)
            for qd in (phase.qd_start, phase.qd_end)
        )
        words = (
            f"joint {joint.name} has {distance} to change its velocity from {' to '.join(speeds)}. "
            "This requires {value}, but its limit is {bound}"
        )
        needed = float(changes[i] / (2 * distances[i]))
        yield exceeded(limit, needed, phase.motion.name, words, ROUNDING * limit.largest)


def _ranges_exceeded(phase: Phase) -> Iterator[Reason | None]:
    """Yield the ranges that joints must leave to stop, or to reach their velocity at the end.

    The range may be that of tilt or depth.
    """
    problem = phase.problem
    ranges = reversal_ranges(problem, phase.mechanism, phase.points)
    ends = (
        (phase.qd_start, 0, "cannot stop before"),
        (-phase.qd_end, -1, "would have to start from"),
    )
    for (qd, side, phrase), (i, joint) in product(ends, enumerate(problem.robot.joints)):
        reached = phase.points[side].copy()
        reached[i] += qd[i] * abs(qd[i]) / (2 * joint.acceleration)
        if ranges[0, i] - SAME <= reached[i] <= ranges[1, i] + SAME:
            continue
        limit: Limit = joint.limit(JointPosition)
        value, name = float(reached[i]), f"joint {joint.name}"
        coordinate = {1: "tilt", 3: "depth"}.get(i, "")
        task_range = problem.limit(TaskRange.name_of(coordinate), None)
        if limit.contains(value) and task_range is not None:
            # The task coordinate that follows this joint alone leaves its range.
            limit, name = task_range, coordinate
            value = float(task_from_joints(phase.mechanism, reached[None])[0, TASK.index(name)])
        speed = in_words(abs(float(qd[i])), joint.limit(JointVelocity).unit)
        acceleration = in_words(joint.acceleration, joint.limit(JointAcceleration).unit)
        words = (
            f"{name} {phrase} {{value}}, because joint {joint.name} moves at {speed} and "
            f"accelerates by at most {acceleration}, but its range ends at {{bound}}"
        )
        yield exceeded(limit, value, phase.motion.name, words, -np.inf)
