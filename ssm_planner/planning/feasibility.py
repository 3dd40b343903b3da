"""Tests of a problem by geometry and kinematics, before any solver runs.

They cover ranges of joints and task coordinates, the eye, velocities, and distances to stop.
`feasible_phases` is the main entry. `check_places` tests all samples of given paths, and the points
of free motions, whose paths are not known yet. `with_end_velocities` tests the velocities at both
ends of the whole motion. A failed test returns a `Reason`.
"""

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
    build_phases,
    start_configurations,
    straight_path,
)
from ssm_planner.planning.reason import Reason, check_limit
from ssm_planner.planning.retiming.constraints import braking_travel
from ssm_planner.planning.retiming.paths import PolylinePath
from ssm_planner.planning.tolerances import EQUALITY_TOLERANCE, ROUNDING_TOLERANCE
from ssm_planner.problem import (
    TASK_COORDINATES,
    Free,
    JointAcceleration,
    JointPosition,
    JointVelocity,
    LensClearance,
    Limit,
    Problem,
    RetinaClearance,
    TaskRange,
    format_quantity,
)
from ssm_planner.typing import Array, record

RATE_KEYS = ("start_rate", "end_rate")
"""Keys in the problem file for the rates of task coordinates at the start and at the end."""


@record
class _PhaseSamples:
    """Joint positions along a phase at which limits are tested.

    A phase is an entry of the motion list with its joint positions. Without a given path,
    the samples are its points, and s is spaced evenly from point to point.
    """

    phase: Phase
    """The phase."""
    s: Array
    """Path parameters, (n,), from 0 to 1."""
    q: Array
    """Joint positions at the path parameters, (n, 4), rad and m."""

    @classmethod
    def of_phase(cls, phase: Phase) -> "_PhaseSamples":
        """Return samples of the given path of a phase, or its points if it has no path."""
        if phase.path is None:
            return cls(phase, np.linspace(0.0, 1.0, len(phase.points)), phase.points)
        return cls(phase, phase.path.coarse_samples.s, phase.path.coarse_samples.q)

    def location(self, k: int) -> str:
        """Describe in words where a sample lies on the motion, for messages.

        Parameters
        ----------
        k : int
            Index of the sample.

        Returns
        -------
        str
            Name of the motion and the place on it, for example "insert, 40 % of the way".
        """
        name, s = self.phase.motion.name, float(self.s[k])
        if s in (0.0, 1.0):
            return f"{name}, at its {'end' if s else 'start'}"
        if self.phase.path is None:
            return f"{name}, at point {k} on its way"
        return f"{name}, {100 * s:.0f} % of the way"

    def refined(self, k: int) -> "_PhaseSamples":
        """Sample the path again, from the sample before sample k to the sample after it.

        The number of samples remains the same. Without a given path, it cannot be sampled
        between its points, and the samples are returned unchanged.

        Parameters
        ----------
        k : int
            Index of a sample.

        Returns
        -------
        _PhaseSamples
            The samples of this part of the path.
        """
        if self.phase.path is None:
            return self
        neighbours = self.s[max(k - 1, 0) : k + 2]
        s = np.linspace(neighbours[0], neighbours[-1], len(self.s))
        return _PhaseSamples(self.phase, s, self.phase.path.sample(s).q)


def _worst_index(limit: Limit, values: Array) -> int:
    """Return the index of the value (n,) that exceeds a limit most, or that is nearest to it."""
    return int(np.argmax(np.maximum(limit.low - values, values - limit.high)))


def _check_samples(
    places: _PhaseSamples,
    limit: Limit,
    values: Array,
    template: str,
    tolerance: float = ROUNDING_TOLERANCE,
) -> Reason | None:
    """Return the reason for the largest excess over a limit, or None if all samples keep it.

    Parameters
    ----------
    places : _PhaseSamples
        Samples along a phase (entry of the motion list).
    limit : Limit
        The limit.
    values : (n,) array
        Values of the limited quantity at the samples, in SI units.
    template : str
        Message with the fields {value} and {bound}.
    tolerance : float
        Excess that is allowed, in SI units.
    """
    k = _worst_index(limit, values)
    return check_limit(limit, float(values[k]), places.location(k), template, tolerance)


def feasible_phases(
    problem: Problem,
) -> tuple[tuple[Phase, ...], Reason | None]:
    """Return the phases of a problem for the first start configuration that geometry allows.

    If the problem gives its start in task coordinates, several joint positions (start
    configurations) reach it. They are tried in the order of `start_configurations`. The first one
    is taken with which all phases stay in the ranges and away from the eye. The phases that are
    returned contain the velocities at both ends of the motion.

    Parameters
    ----------
    problem : Problem
        The problem with its robot, start, motion list and limits.

    Returns
    -------
    phases : tuple of Phase
        The phases (entries of the motion list with their joint positions). Empty if no start
        configuration is possible.
    reason : Reason or None
        Why the first start configuration is impossible, or why the robot cannot have the velocities
        at the ends. None if all tests pass.

    Raises
    ------
    ProblemError
        If the mechanism cannot reach a point, or if no motion goes anywhere.
    """
    first_reason = None
    for q in start_configurations(problem):
        phases = build_phases(problem, q)
        reason = check_places(phases)
        if reason is None:
            return with_end_velocities(phases)
        first_reason = first_reason or reason
        if isinstance(reason.limit, (RetinaClearance, LensClearance)):
            # All start configurations have the tip at the same places, so others do not help.
            break
    return (), first_reason


def eye_forbids_target(problem: Problem) -> bool:
    """Return True if the retina or the lens forbids a place that the problem prescribes.

    The tip is at this place whatever the joint positions are, so no other joint positions help.
    """
    _, reason = feasible_phases(problem)
    return reason is not None and isinstance(reason.limit, (RetinaClearance, LensClearance))


def check_places(phases: Sequence[Phase]) -> Reason | None:
    """Return the reason for the first place along the phases that a limit forbids, or None.

    The limits are the ranges of joints and task coordinates, the distance to the retina, and the
    lens.

    Parameters
    ----------
    phases : sequence of Phase
        Phases (entries of the motion list with their joint positions). All samples of a given path
        are tested. Of a free phase, whose path is not known yet, the points are tested.

    Returns
    -------
    Reason or None
        The limit, the place, and the required and the available value. None if no place is
        forbidden.
    """

    def reasons(phase: Phase) -> Iterator[Reason | None]:
        """Yield the result of every test of a phase: a reason, or None if it passes."""
        yield from _check_ranges(phase)
        yield from _check_tilt_extremes(phase)
        yield check_eye_clearance(phase)

    return _first_reason(chain.from_iterable(map(reasons, phases)))


def _first_reason(reasons: Iterable[Reason | None]) -> Reason | None:
    """Return the first reason that is not None. None if there is no reason."""
    return next(filter(None, reasons), None)


def _check_ranges(phase: Phase) -> Iterator[Reason | None]:
    """Yield one result for each range of a joint or task coordinate.

    The result is a reason if the phase leaves the range, or None if it keeps the range. Roll and
    spin count continuously from the start of the phase, so they may exceed a whole turn.

    Parameters
    ----------
    phase : Phase
        The phase (entry of the motion list). Without a given path, only its points are tested.

    Yields
    ------
    Reason or None
        Results for the ranges of all joints, then for those of the task coordinates.
    """
    places = _PhaseSamples.of_phase(phase)
    phrase = "{value}, but its range ends at {bound}"
    for joint, values in zip(phase.problem.robot.joints, places.q.T, strict=True):
        template = f"joint {joint.name} would have to reach {phrase}"
        yield _check_samples(places, joint.limit(JointPosition), values, template)
    wrapped = task_from_joints(phase.mechanism, places.q)
    task = np.stack(task_of_joints(NUMPY, phase.mechanism, places.q.T), axis=1)
    # Whole turns of roll and spin move the first sample to the start of the phase.
    continuous = task + 2 * np.pi * np.round((phase.start - task[0]) / (2 * np.pi)) * (1, 0, 1, 0)
    for limit in phase.problem.limits:
        if isinstance(limit, TaskRange):
            # A range of a turn or more excludes no angle, so values may be wrapped.
            is_whole_turn = limit.high - limit.low >= 2 * np.pi
            values = (wrapped if is_whole_turn else continuous)[
                :, TASK_COORDINATES.index(limit.coordinate)
            ]
            template = f"{limit.coordinate} would have to be {phrase}"
            yield _check_samples(places, limit, values, template, EQUALITY_TOLERANCE)


def _check_tilt_extremes(phase: Phase) -> Iterator[Reason | None]:
    """Yield a reason if a free motion must pass an extreme of tilt that is outside its range.

    Tilt depends on the position θ2 of joint 2 alone. It has its extremes where the two solutions of
    the inverse kinematics (the branches) are equal, at θ2 = δ + k π with the constant δ of the
    mechanism and any integer k. Every free motion between points on both sides of such an extreme
    passes it.

    Parameters
    ----------
    phase : Phase
        The phase (entry of the motion list). One with a given path is not tested here, because
        `check_places` tests all samples of its path.

    Yields
    ------
    Reason or None
        One result for each pair of consecutive points between which tilt has an extreme. None if
        the extreme is within the range.
    """
    mechanism, problem = phase.mechanism, phase.problem
    limit = problem.limit(TaskRange.name_of("tilt"), None)
    if phase.path is not None or limit is None:
        return
    for k, (start, end) in enumerate(pairwise(phase.points)):
        low, high = sorted((float(start[1]), float(end[1])))
        location = f"{phase.motion.name}, between its points {k} and {k + 1}"
        template = (
            f"joint {problem.robot.joints[1].name} passes the workspace boundary between "
            f"{format_quantity(low, 'rad')} and {format_quantity(high, 'rad')}, where tilt is {{value}}, "
            "but the range of tilt ends at {bound}"
        )
        # All extremes δ + k π between the positions of joint 2 at both points.
        first = np.ceil((low - mechanism.delta) / np.pi)
        extremes = mechanism.delta + np.pi * np.arange(first, (high - mechanism.delta) / np.pi)
        # Tilt depends on joint 2 alone, so the other joints may have any position.
        joints = np.tile(start, (len(extremes), 1))
        joints[:, 1] = extremes
        tilts = task_from_joints(mechanism, joints)[:, 1]
        if len(tilts):
            tilt = float(tilts[_worst_index(limit, tilts)])
            yield check_limit(limit, tilt, location, template, EQUALITY_TOLERANCE)


def check_eye_clearance(phase: Phase) -> Reason | None:
    """Return the reason if the tip comes too close to the retina, or the shaft to the lens.

    The distances are evaluated at samples of the given path, and then at samples near the worst
    one. This is necessary because the distance has a sharp minimum at the edge of the port, the
    hole of the retina through which the tool enters.

    Parameters
    ----------
    phase : Phase
        The phase (entry of the motion list). Without a given path, only its points are tested.

    Returns
    -------
    Reason or None
        The limit and the place. None if the distances suffice, or if the problem has no eye.
    """
    eye = phase.problem.eye
    if eye is None:
        return None
    for limit in eye.limits:
        template = (
            "the clearance of the tip from the retina would be {value}, but at least {bound} is "
            "required"
            if isinstance(limit, RetinaClearance)
            else "the shaft would touch the lens: it would pass at {value} times the size of the "
            "lens from its centre, but at least {bound} is required"
        )
        places = _PhaseSamples.of_phase(phase)
        # The second round samples the neighbourhood of the worst sample.
        for _ in range(2):
            tips = tip_position(phase.mechanism, places.q)
            values, _ = eye_limits(NUMPY, eye, tips.T)[limit.name]
            reason = _check_samples(places, limit, values, template)
            if reason is not None:
                return reason
            places = places.refined(int(np.argmin(values)))
    return None


def joints_nearest_to_eye(phase: Phase) -> Array:
    """Find the place on the direct motion that is nearest to the retina or the lens.

    On the direct motion, the joints move along straight lines between the points of the phase. The
    tool may touch the eye there. The search for a detour around the eye begins at this place
    (`candidates/detour.py`).

    Parameters
    ----------
    phase : Phase
        Entry of the motion list whose path the solver chooses (a free motion). Its problem has an
        eye.

    Returns
    -------
    (4,) array
        Joint positions, in rad for joints 1 to 3 and in m for joint 4.
    """
    path = PolylinePath(phase.mechanism, phase.points)
    q = path.coarse_samples.q
    assert phase.problem.eye is not None
    limits = eye_limits(NUMPY, phase.problem.eye, tip_position(phase.mechanism, q).T).values()
    # Divided by their smallest permitted values, the distances become comparable.
    ratios = [values / smallest for values, smallest in limits if smallest > 0]
    return np.asarray(q[int(np.argmin(np.min(ratios, axis=0)))])


def replace_by_task_line(phase: Phase) -> Phase | None:
    """Replace a free motion by a motion along a straight line in task coordinates.

    The task coordinates are roll, tilt, spin and depth. A motion along a given path is easier to
    compute than a free motion, whose path the solver chooses. The planner therefore tries the line
    if it found no free motion (`candidates/task_line.py`).

    Parameters
    ----------
    phase : Phase
        Entry of the motion list whose path the solver chooses (a free motion).

    Returns
    -------
    Phase or None
        The phase with the line. None in these cases:

        - The phase has via points (points between start and end), or begins or ends at speed.
        - The line is the same as in joint coordinates, or does not end at the target joints.
        - Some position on the line exceeds a limit.
    """
    # The line differs from the one in joint coordinates only if roll or tilt changes. They are the
    # coordinates [:2].
    lines_differ = np.abs((phase.end - phase.start)[:2]).max() > ROUNDING_TOLERANCE
    if len(phase.points) != 2 or not phase.begins_and_ends_at_rest or not lines_differ:
        return None
    path = straight_path(phase.problem, phase.mechanism, phase.start, phase.end, phase.q_start)
    if np.abs(path.coarse_samples.q[-1] - phase.points[-1]).max() > ROUNDING_TOLERANCE:
        return None
    line_phase = replace(phase, path=path)
    return line_phase if check_places((line_phase,)) is None else None


def with_end_velocities(
    phases: tuple[Phase, ...],
) -> tuple[tuple[Phase, ...], Reason | None]:
    """Return the phases with the joint velocities at the start and at the end of the motion.

    The velocities follow from the rates of task coordinates in the problem (`start_rate`,
    `end_rate`). The phase at the start also gets the joint accelerations there
    (`start_acceleration`).

    Parameters
    ----------
    phases : tuple of Phase
        All phases (entries of the motion list) of the problem, without velocities.

    Returns
    -------
    phases : tuple of Phase
        The phases with q̇ at the start of the first and at the end of the last moving phase.
    reason : Reason or None
        Why the robot cannot have these velocities. None if it can.

    Raises
    ------
    ProblemError
        If the velocity would make a motion leave its given path, or if a dwell would have a
        velocity.
    """
    first, last = (
        _index_of_phase_with_rates(phases),
        len(phases) - 1 - _index_of_phase_with_rates(phases[::-1]),
    )
    result = list(phases)
    qd = _end_velocity(result[first], 0)
    acceleration = np.array(phases[0].problem.start_acceleration)
    result[first] = replace(result[first], qd_start=qd, qdd_start=acceleration)
    qd = _end_velocity(result[last], -1)
    result[last] = replace(result[last], qd_end=qd)
    reasons = chain(
        _check_end_velocity(result[first], 0),
        _check_end_velocity(result[last], -1),
        _check_velocity_change(result[first]),
        _check_velocity_change(result[last]),
    )
    return tuple(result), _first_reason(reasons)


def _index_of_phase_with_rates(phases: Sequence[Phase]) -> int:
    """Return the index of the phase at whose start the robot has the rates that the problem gives.

    It is the first phase that takes time. If this phase is a dwell, or if all phases take no time,
    it is the first free motion up to there, which leaves its position and returns to it.

    Parameters
    ----------
    phases : sequence of Phase
        The phases (entries of the motion list) in their order, or in reverse to find the phase at
        the end of the motion.
    """
    lasting = (k for k, phase in enumerate(phases) if phase.motion.duration or not phase.is_at_rest)
    index = next(lasting, len(phases) - 1)
    free = (k for k in range(index + 1) if isinstance(phases[k].motion, Free))
    return next(free, index) if phases[index].is_at_rest else index


def _end_velocity(phase: Phase, side: int) -> Array:
    """Convert the task rates at one end of the motion to joint velocities q̇.

    Parameters
    ----------
    phase : Phase
        The first or the last phase (entry of the motion list) that moves.
    side : int
        0 for the start of the phase, −1 for its end.

    Returns
    -------
    (4,) array
        Joint velocities, rad/s and m/s. Velocities that are mere rounding errors are 0.

    Raises
    ------
    ProblemError
        If the phase is a dwell (a pause), or if the robot cannot move along the given path of the
        phase at these rates, because they have another direction.
    """
    key = RATE_KEYS[side]
    problem, mechanism = phase.problem, phase.mechanism
    rate = np.array([getattr(problem, key).get(name, 0.0) for name in TASK_COORDINATES])
    if not rate.any():
        return np.zeros(4)
    if phase.is_at_rest and not isinstance(phase.motion, Free):
        raise ProblemError(
            "a dwell has no speed", file=problem.file, line=phase.motion.line, key=key
        )
    if phase.path is not None:
        # The path parameter s is 0 at the start and 1 at the end.
        sample = phase.path.sample(np.array([-float(side)]))
        direction = task_rates(mechanism, sample.q, sample.dq)[0]
        # Part of the rate that points along the path.
        projection = direction * (direction @ rate) / (direction @ direction)
        off_line = np.abs(rate - projection).max() > ROUNDING_TOLERANCE * np.abs(rate).max()
        if direction @ rate < 0 or off_line:
            raise ProblemError(
                f"this speed leads away from the line of the straight motion ({phase.motion.name})",
                file=problem.file,
                key=key,
                allowed="rates along the line, in the direction of the motion",
            )
    qd = joint_rates(mechanism, phase.points[side], rate)
    at_rest = np.abs(qd) < ROUNDING_TOLERANCE * problem.robot.velocities
    return np.where(at_rest, 0.0, qd)


def _check_end_velocity(phase: Phase, side: int) -> Iterator[Reason | None]:
    """Yield one result for each limit on the velocities at one end of a phase.

    The limits are the velocities of the joints, and the distance in which the tip must be able to
    stop. The result is a reason, or None if the limit is kept.

    Parameters
    ----------
    phase : Phase
        Entry of the motion list with its problem and joint positions.
    side : int
        0 for its start, −1 for its end.

    Yields
    ------
    Reason or None
        Results for the four joints, then for the distance to stop if it is limited.
    """
    qd = (phase.qd_start, phase.qd_end)[side]
    location = f"{phase.motion.name}, {RATE_KEYS[side].replace('_', ' ')}"
    for joint, speed in zip(phase.problem.robot.joints, np.abs(qd).tolist(), strict=True):
        template = f"joint {joint.name} would move at {{value}}, but its limit is {{bound}}"
        yield check_limit(joint.limit(JointVelocity), speed, location, template)
    stop = phase.problem.stop_travel
    if stop is not None:
        travel = braking_travel(
            phase.mechanism, phase.problem.robot, phase.points[[side]], qd[None]
        )
        template = "the tip needs {value} to stop, but only {bound} are allowed"
        yield check_limit(stop, float(travel[0]), location, template)


def _check_velocity_change(phase: Phase) -> Iterator[Reason | None]:
    """Yield a reason for each joint that cannot change its velocity within the phase.

    On a given path, a joint needs at least the acceleration |q̇₁² − q̇₀²| / (2 d), with the
    velocities q̇₀ and q̇₁ at both ends and the length d of the way that it covers. None is yielded if
    its limit suffices. Without a given path, a joint may move beyond its target, for which it needs
    a part of its range (`_check_stopping_ranges`).

    Parameters
    ----------
    phase : Phase
        The phase (entry of the motion list) at the start or at the end of the motion, with its end
        velocities.

    Yields
    ------
    Reason or None
        One result for each joint whose velocity differs between both ends.
    """
    if phase.path is None:
        yield from _check_stopping_ranges(phase)
        return
    # The joints may reverse on the path, so the lengths of all samples' steps are added.
    distances = np.abs(np.diff(phase.path.coarse_samples.q, axis=0)).sum(axis=0)
    changes = np.abs(phase.qd_start**2 - phase.qd_end**2)
    for i in np.flatnonzero(changes):
        joint = phase.problem.robot.joints[i]
        distance = format_quantity(distances[i], joint.limit(JointPosition).unit)
        speeds = (
            format_quantity(abs(float(qd[i])), joint.limit(JointVelocity).unit)
            for qd in (phase.qd_start, phase.qd_end)
        )
        template = (
            f"joint {joint.name} has {distance} to change its velocity from {' to '.join(speeds)}. "
            "This requires {value}, but its limit is {bound}"
        )
        needed = float(changes[i] / (2 * distances[i]))
        yield check_limit(joint.limit(JointAcceleration), needed, phase.motion.name, template)


def _check_stopping_ranges(phase: Phase) -> Iterator[Reason | None]:
    """Yield a reason for each range that a joint must leave in order to stop or to start.

    A joint that begins at the velocity q̇ covers at least q̇²/(2 q̈_max) until it stops, with its
    largest acceleration q̈_max. It needs the same distance to reach a velocity at the end. The range
    may also be that of tilt or depth, which depend on one joint alone.

    Parameters
    ----------
    phase : Phase
        The phase (entry of the motion list) at the start or at the end of the motion, with its end
        velocities. The solver chooses its path.

    Yields
    ------
    Reason or None
        One result for each end, joint with a velocity there, and range. None if the range suffices.
    """
    problem = phase.problem
    ends = (
        (phase.qd_start, 0, "cannot stop before"),
        (-phase.qd_end, -1, "would have to start from"),
    )
    for (qd, side, phrase), (i, joint) in product(ends, enumerate(problem.robot.joints)):
        if not qd[i]:
            continue
        turning_q = phase.points[side].copy()
        # Position at which the joint stops, or from which it starts: q ± q̇²/(2 q̈_max).
        turning_q[i] += qd[i] * abs(qd[i]) / (2 * joint.acceleration)
        position: Limit = joint.limit(JointPosition)
        limits = [(position, f"joint {joint.name}", float(turning_q[i]))]
        # The task coordinate that depends on this joint alone.
        coordinate = {1: "tilt", 3: "depth"}.get(i, "")
        task_range = problem.limit(TaskRange.name_of(coordinate), None)
        if task_range is not None:
            task = task_from_joints(phase.mechanism, turning_q[None])[0]
            value = float(task[TASK_COORDINATES.index(coordinate)])
            limits.append((task_range, coordinate, value))
        speed = format_quantity(abs(float(qd[i])), joint.limit(JointVelocity).unit)
        acceleration = format_quantity(joint.acceleration, joint.limit(JointAcceleration).unit)
        for limit, name, value in limits:
            template = (
                f"{name} {phrase} {{value}}, because joint {joint.name} moves at {speed} and "
                f"accelerates by at most {acceleration}, but its range ends at {{bound}}"
            )
            yield check_limit(limit, value, phase.motion.name, template, EQUALITY_TOLERANCE)
