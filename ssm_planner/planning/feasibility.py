"""Reasons that geometry alone gives: ranges, the eye, velocities, and distances to stop.

`infeasible_place` checks straight paths and the points of other motions, and `with_boundary_rates`
the velocities at both ends of a motion.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import chain, pairwise, product

import numpy as np

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.errors import ProblemError
from ssm_planner.kinematics import (
    Mechanism,
    eye_limits,
    joint_rates,
    task_from_joints,
    task_of_joints,
    task_rates,
    tip_position,
)
from ssm_planner.planning.phases import Phase, reversal_ranges, straight_path
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.retiming.constraints import braking_travel
from ssm_planner.planning.retiming.paths import JointPath
from ssm_planner.planning.tolerances import ROUNDING, SAME
from ssm_planner.problem import (
    TASK,
    JointAcceleration,
    JointPosition,
    JointVelocity,
    Limit,
    Problem,
    RetinaClearance,
    TaskRange,
    in_words,
)
from ssm_planner.typing import Array, record


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


def _excess(
    places: _Places | str, limit: Limit, values: Array, tolerance: float, words: str
) -> Reason | None:
    """Return the worst of values (n,) beyond a limit. None if all are within a tolerance of it.

    `places` are the samples of the values, or the text that describes their place. `words` is the
    message, with {value} and {bound} in the limit's unit.
    """
    over = np.maximum(limit.low - values, values - limit.high)
    if over.max(initial=-np.inf) <= tolerance:
        return None
    k = int(np.argmax(over))
    value, location = float(values[k]), places if isinstance(places, str) else places.location(k)
    bound = limit.bound(value)
    shown = words.format(value=in_words(value, limit.unit), bound=in_words(bound, limit.unit))
    # A clearance that is too small is the available value, not the required one.
    required, available = (bound, value) if limit.is_floor else (value, bound)
    return Reason(limit, location, required, available, f"{shown} ({location})")


def infeasible_place(
    problem: Problem, mechanism: Mechanism, phases: Sequence[Phase]
) -> Reason | None:
    """Return the reason for the first place that a limit forbids, or None.

    The limits are the ranges of joints and task coordinates, the retina's clearance and the lens.
    """

    def reasons(phase: Phase) -> Iterator[Reason | None]:
        yield from _beyond_ranges(problem, mechanism, phase)
        yield _past_boundary(problem, mechanism, phase)
        yield blocked_by_eye(problem, mechanism, phase)

    return _first_reason(chain.from_iterable(map(reasons, phases)))


def _first_reason(reasons: Iterable[Reason | None]) -> Reason | None:
    """Return the first reason that is not None, if there is one."""
    return next(filter(None, reasons), None)


def _beyond_ranges(problem: Problem, mechanism: Mechanism, phase: Phase) -> Iterator[Reason | None]:
    """Yield the reasons of joints and task coordinates, or None for those within their range."""
    places = _Places.of_phase(phase)
    ends = "{value}, but its range ends at {bound}"
    for joint, values in zip(problem.robot.joints, places.q.T, strict=True):
        words = f"joint {joint.name} would have to reach {ends}"
        yield _excess(places, joint.limit(JointPosition), values, ROUNDING, words)
    wrapped = task_from_joints(mechanism, places.q)
    task = np.stack(task_of_joints(NUMPY, mechanism, places.q.T), axis=1)
    continuous = task + 2 * np.pi * np.round((phase.start - task[0]) / (2 * np.pi)) * (1, 0, 1, 0)
    for limit in problem.limits:
        if isinstance(limit, TaskRange):
            # A range of a turn or more excludes no angle, so values may be wrapped.
            of_turn = limit.high - limit.low >= 2 * np.pi
            values = (wrapped if of_turn else continuous)[:, TASK.index(limit.coordinate)]
            yield _excess(
                places, limit, values, SAME, f"{limit.coordinate} would have to be {ends}"
            )


def _past_boundary(problem: Problem, mechanism: Mechanism, phase: Phase) -> Reason | None:
    """Return the tilt range if joint 2 must leave it at the workspace boundary.

    Tilt depends on joint 2 alone. Its extremes are where the branches of the inverse kinematics
    meet, at δ + k π. Every motion between points on both sides of an extreme passes it.
    """
    limit = problem.limit(TaskRange.name_of("tilt"), None)
    if phase.path is not None or limit is None:
        return None
    for k, (start, end) in enumerate(pairwise(phase.points)):
        low, high = sorted((float(start[1]), float(end[1])))
        first = np.ceil((low - mechanism.delta) / np.pi)
        extremes = mechanism.delta + np.pi * np.arange(first, (high - mechanism.delta) / np.pi)
        joints = np.tile(start, (len(extremes), 1))
        joints[:, 1] = extremes
        location = f"{phase.motion.name}, between its points {k} and {k + 1}"
        words = (
            f"joint {problem.robot.joints[1].name} passes the workspace boundary between "
            f"{in_words(low, 'rad')} and {in_words(high, 'rad')}, where tilt is {{value}}, "
            "but the range of tilt ends at {bound}"
        )
        tilts = task_from_joints(mechanism, joints)[:, 1]
        reason = _excess(location, limit, tilts, SAME, words)
        if reason is not None:
            return reason
    return None


def blocked_by_eye(problem: Problem, mechanism: Mechanism, phase: Phase) -> Reason | None:
    """Return the retina or the lens if a phase comes too near to it.

    A path is sampled again about its worst sample, because the distance has a sharp corner at the
    port.
    """
    if problem.eye is None:
        return None
    for limit in problem.eye.limits:
        words = (
            "the tip would come within {value} of the retina, but the clearance is {bound}"
            if isinstance(limit, RetinaClearance)
            else "the shaft would touch the lens: it would pass at {value} times the size of the "
            "lens from its centre, but at least {bound} is required"
        )
        places = _Places.of_phase(phase)
        for _ in range(1 if phase.path is None else 2):
            values, _ = eye_limits(NUMPY, problem.eye, tip_position(mechanism, places.q).T)[
                limit.name
            ]
            reason = _excess(places, limit, values, ROUNDING, words)
            if reason is not None:
                return reason
            places = places.refined(int(np.argmin(values)))
    return None


def nearest_to_eye(problem: Problem, path: JointPath) -> Array:
    """Return the joints (4,) where a path is nearest to retina or lens, or deepest in them."""
    q = path.overview.q
    if problem.eye is None:
        return np.asarray(q[0])
    limits = eye_limits(NUMPY, problem.eye, tip_position(path.mechanism, q).T).values()
    ratios = [values / smallest for values, smallest in limits if smallest > 0]
    return np.asarray(q[int(np.argmin(np.min(ratios, axis=0)))]) if ratios else np.asarray(q[0])


def straight_instead(problem: Problem, mechanism: Mechanism, phase: Phase) -> Phase | None:
    """Return a free phase from rest to rest as a straight line in task coordinates.

    None if the line is not possible, or if a limit forbids a place on it.
    """
    # The line in task coordinates must differ from the one in the joints.
    lines_differ = np.abs((phase.end - phase.start)[:2]).max() > ROUNDING
    if len(phase.points) != 2 or not phase.begins_and_ends_at_rest or not lines_differ:
        return None
    path = straight_path(problem, mechanism, phase.start, phase.end, phase.q_start)
    if np.abs(path.overview.q[-1] - phase.points[-1]).max() > ROUNDING:
        return None
    straight = replace(phase, path=path)
    return straight if infeasible_place(problem, mechanism, (straight,)) is None else None


def with_boundary_rates(
    problem: Problem, mechanism: Mechanism, phases: tuple[Phase, ...]
) -> tuple[tuple[Phase, ...], Reason | None]:
    """Return the phases with q̇ at the start of the first and at the end of the last one.

    The reason is set if they cannot have these velocities.

    Raises
    ------
    ProblemError
        If a straight motion would leave its line.
    """
    # A motion to the present position takes no time, so its neighbours have the rates.
    moving = [
        k for k, phase in enumerate(phases) if phase.motion.duration is not None or not phase.stands
    ]
    result = list(phases)
    ends = ((moving[0], 0, "start_rate"), (moving[-1], -1, "end_rate"))
    for k, side, key in ends:
        qd = _end_velocity(problem, mechanism, (result[k], side), key)
        result[k] = replace(result[k], qd_end=qd) if side else replace(result[k], qd_start=qd)
    acceleration = np.array(problem.start_acceleration)
    result[moving[0]] = replace(result[moving[0]], qdd_start=acceleration)
    too_fast = (_too_fast(problem, mechanism, (result[k], side), key) for k, side, key in ends)
    too_near = (_too_near(problem, mechanism, result[k]) for k, *_ in ends)
    return tuple(result), _first_reason(chain(too_fast, too_near))


def _end_velocity(
    problem: Problem, mechanism: Mechanism, end: tuple[Phase, int], key: str
) -> Array:
    """Return q̇ (4,) at the start (side 0) or the end (side −1) of a phase, from the task rates.

    `end` is the phase with the side, and `key` is that of the rates in the problem file. Raises
    ProblemError for rates that do not point along the path of the phase.
    """
    phase, side = end
    rate = np.array([getattr(problem, key).get(name, 0.0) for name in TASK])
    if not rate.any():
        return np.zeros(4)
    if phase.stands:
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


def _too_fast(
    problem: Problem, mechanism: Mechanism, end: tuple[Phase, int], key: str
) -> Reason | None:
    """Return the limit that velocities at an end exceed: a velocity, or the distance to stop."""
    phase, side = end
    qd = phase.qd_end if side else phase.qd_start
    location = f"{phase.motion.name}, {key.replace('_', ' ')}"
    for joint, speed in zip(problem.robot.joints, np.abs(qd).tolist(), strict=True):
        limit = joint.limit(JointVelocity)
        if speed > joint.velocity * (1 + ROUNDING):
            text = (
                f"joint {joint.name} would move at {in_words(speed, limit.unit)}, but its limit is "
                f"{in_words(limit.largest, limit.unit)} ({location})"
            )
            return Reason(limit, location, speed, limit.largest, text)
    stop = problem.stop_travel
    if stop is None:
        return None
    travel = float(braking_travel(mechanism, problem.robot, phase.points[[side]], qd[None])[0])
    if travel <= stop.largest * (1 + ROUNDING):
        return None
    text = (
        f"the tip needs {in_words(travel, stop.unit)} to stop, but only "
        f"{in_words(stop.largest, stop.unit)} are allowed ({location})"
    )
    return Reason(stop, location, travel, stop.largest, text)


def _too_near(problem: Problem, mechanism: Mechanism, phase: Phase) -> Reason | None:
    """Return the limit of a joint whose displacement is too short for its change of velocity.

    A path allows |q̇₁² − q̇₀²| ≤ 2 q̈_max |Δq|. A free motion may overshoot, and needs the range to
    do so.
    """
    if phase.path is None:
        return _beyond_room(problem, mechanism, phase)
    distances = np.abs(np.diff(phase.path.overview.q, axis=0)).sum(axis=0)
    changes = np.abs(phase.qd_start**2 - phase.qd_end**2)
    for i, joint in enumerate(problem.robot.joints):
        if changes[i] <= 2 * joint.acceleration * distances[i] * (1 + ROUNDING):
            continue
        limit = joint.limit(JointAcceleration)
        needed = float(changes[i] / (2 * distances[i]))
        speeds = (
            in_words(abs(float(qd[i])), joint.limit(JointVelocity).unit)
            for qd in (phase.qd_start, phase.qd_end)
        )
        text = (
            f"joint {joint.name} has {in_words(distances[i], joint.limit(JointPosition).unit)} to "
            f"change its velocity from {' to '.join(speeds)}. This requires "
            f"{in_words(needed, limit.unit)}, but its limit is "
            f"{in_words(joint.acceleration, limit.unit)} ({phase.motion.name})"
        )
        return Reason(limit, phase.motion.name, needed, joint.acceleration, text)
    return None


def _beyond_room(problem: Problem, mechanism: Mechanism, phase: Phase) -> Reason | None:
    """Return the range that a joint must leave to stop, or to reach its velocity at the end.

    The range may be that of tilt or depth.
    """
    ranges = reversal_ranges(problem, mechanism, phase.points)
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
            value = float(task_from_joints(mechanism, reached[None])[0, TASK.index(name)])
        velocity, acceleration = joint.limit(JointVelocity), joint.limit(JointAcceleration)
        text = (
            f"{name} {phrase} {in_words(value, limit.unit)}, because joint {joint.name} moves at "
            f"{in_words(abs(float(qd[i])), velocity.unit)} and accelerates by at most "
            f"{in_words(joint.acceleration, acceleration.unit)}, but its range ends at "
            f"{in_words(limit.bound(value), limit.unit)} ({phase.motion.name})"
        )
        return Reason(limit, phase.motion.name, value, limit.bound(value), text)
    return None
