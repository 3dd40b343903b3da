"""Promises about the path of the tip: lines, corners, constant speed, distance from the retina.

A problem prescribes the lines of some motions. They follow from the problem and from the position
of the tip where the phase begins, by kinematics alone. The check compares the tip with them.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ssm_planner.kinematics import (
    Mechanism,
    inverse_tip,
    task_from_joints,
    tip_from_task,
    tip_position,
    tool_speed,
)
from ssm_planner.problem import (
    OF_TIP,
    TASK,
    ConstantSpeed,
    CornerRounding,
    Follow,
    Joints,
    Motion,
    OfPath,
    PathDeparture,
    Point,
    RetinaDistance,
    Scan,
    Straight,
    Task,
    TaskLimits,
    TipSpeed,
)
from ssm_planner.trajectory import Span, Trajectory, blocks
from ssm_planner.typing import Array, frozen
from ssm_planner.verification.certificate import LimitCheck, Unjudged

OFF = 1e-7
"""Distance from its lines, m, beyond which the tip has left them."""
ON = 1e-6
"""Largest distance from the lines, and largest error of the distance to the retina, m."""
CONSTANT = 1e-6
"""Largest relative error of a constant speed."""
SLACK = 1e-9
"""Extra distance, m, from a corner at which the tip may leave its lines."""
LOOKS = 8
"""Number of instants in every piece of a motion at constant speed."""
FEW = 3
"""Number of instants in every piece of other motions."""
ABOUT = 1.5
"""Radius around a corner with more instants, as a multiple of its allowed distance."""
INSTANTS = 301
"""Number of these instants."""
COARSE = 65
"""Number of points of a line from which the search of the nearest point starts."""
STEPS = 3
"""Number of its Newton steps."""
STEP = 1e-7
"""Step of its difference quotients, as a fraction of the line."""
SOME = 4096
"""Number of instants that are evaluated together."""

Curve = Callable[[Array], Array]
"""Function from fractions (n,) of a line to tip positions (n, 3)."""


@frozen
class Way:
    """The promises about one phase of a motion.

    Attributes
    ----------
    span : Span
        Name, start and end of the phase.
    """

    span: Span
    lines: tuple[Curve, ...]
    """Lines that the tip follows one after the other."""
    distances: tuple[float, ...] = ()
    """Distance from each corner within which the tip may leave the lines, m."""
    speed: float | None = None
    """Speed that the tip keeps, m/s."""
    over: tuple[Array, float, float] | None = None
    """Centre (3,) and radius of a retina and the distance that the tip keeps from it, m."""

    @property
    def corners(self) -> Array:
        """Corners between the lines, (k, 3)."""
        return np.array([line(np.ones(1))[0] for line in self.lines[:-1]]).reshape(-1, 3)


@frozen
class WayKept:
    """The result of checking the promises of one phase, in SI units.

    Attributes
    ----------
    way : Way
        The promises.
    checks : tuple of LimitCheck
        One result for each promise.
    """

    way: Way
    checks: tuple[LimitCheck, ...]
    departure: float
    """Largest distance of the tip from its lines, m."""
    stretch: tuple[float, float, float] | None = None
    """Start and end of the constant speed in s from the start of the phase, and its relative error.

    None if the phase promises no constant speed.
    """

    @property
    def reach(self) -> float | None:
        """Largest distance from a corner at which the tip is off its lines, m.

        None without corners.
        """
        return next(
            (check.worst for check in self.checks if check.name == CornerRounding.name), None
        )


def promises_kept(motion: Trajectory, mechanism: Mechanism, limits: TaskLimits) -> list[WayKept]:
    """Check every phase whose motion promises something about the path of the tip.

    Parameters
    ----------
    motion : Trajectory
        A trajectory with phases.
    mechanism : Mechanism
        The kinematics of the robot.
    limits : TaskLimits
        The limits with the motions of the problem and the eye.

    Returns
    -------
    list of WayKept
        One result for each such phase, in their order.
    """
    return [
        _compare(motion, mechanism, promise)
        for promise in _path_promises(motion, mechanism, limits)
    ]


def lines_kept(
    motion: Trajectory,
    mechanism: Mechanism,
    limits: TaskLimits,
    chain: list[Motion],
    span: Span,
    allowed: float,
) -> tuple[list[LimitCheck], list[Unjudged]]:
    """Check that a table follows the lines of motions without a stop between them.

    Parameters
    ----------
    motion : Trajectory
        The table.
    mechanism : Mechanism
        The kinematics of the robot.
    limits : TaskLimits
        The limits with the eye.
    chain : list of Motion
        Motions joined by rounded corners, or one motion.
    span : Span
        Times between which the table performs them.
    allowed : float
        Largest distance from the lines outside rounded corners, m.

    Returns
    -------
    checks : list of LimitCheck
        The largest distance from the lines. Empty if the motions do not have lines.
    unjudged : list of Unjudged
        Promises that the points of a table cannot show.
    """
    if not _has_lines(chain[0]):
        return [], []
    promise = replace(_path_promise(motion, mechanism, limits, chain, span), speed=None)
    names = [CornerRounding.name] * bool(promise.distances)
    checks = []
    if promise.over is None:
        departure = _compare(motion, mechanism, promise).checks[0]
        checks.append(_check(PathDeparture(allowed), promise, departure.worst, departure.time))
    else:
        names.append(PathDeparture.name)
    names += [ConstantSpeed.name] * bool(getattr(chain[0], "constant_speed", None))
    reason = f"the points of a table do not show whether {span.name} keeps it"
    return checks, [Unjudged(name, None, reason) for name in names]


def unchecked_lines(limits: TaskLimits) -> str:
    """Return a remark which states that the check did not examine the lines of the motions."""
    return (
        f"whether the tip follows the path of {limits.promising}: a table does not contain the "
        "times of phases"
    )


def _has_lines(entry: Motion) -> bool:
    """Return whether the tip follows lines that a motion prescribes."""
    return isinstance(entry, Straight) or (isinstance(entry, Follow) and entry.curve in OF_TIP)


def _path_promises(motion: Trajectory, mechanism: Mechanism, limits: TaskLimits) -> Iterator[Way]:
    """Yield the promises of each motion that prescribes lines.

    The phases of a trajectory have the names and the order of the motions. A scan, and a curve
    through samples, have an unknown number of phases, so the next motion is searched by its name. A
    motion whose phase is missing gets an empty phase, which fails the check.
    """
    index = 0
    counts_unknown = False
    spans = motion.phases
    for chain in _chains(limits.motion):
        head = chain[0]
        name = " + ".join(dict.fromkeys(entry.name for entry in chain))
        if isinstance(head, Scan) or (isinstance(head, Follow) and head.curve == "samples"):
            counts_unknown = True  # The planner chooses the number of phases.
            continue
        if isinstance(head, Follow) and head.curve == "retina" and not counts_unknown:
            index += index < len(spans) and spans[index].name == f"{name}, approach"
        if counts_unknown:
            index = next((k for k in range(index, len(spans)) if spans[k].name == name), index)
        span = spans[index] if index < len(spans) else None
        index += 1
        counts_unknown = False
        if _has_lines(head):
            start = motion.breaks[-1] if span is None else span.start
            is_phase = span is not None and span.name == name
            yield _path_promise(
                motion,
                mechanism,
                limits,
                chain,
                span if is_phase and span else Span(name, start, start),
            )


def _chains(entries: Sequence[Motion]) -> Iterator[list[Motion]]:
    """Yield the motions of a problem in chains.

    Motions joined by rounded corners form one chain. Every other motion is a chain by itself.
    """
    chain: list[Motion] = []
    for entry in entries:
        chain.append(entry)
        if not isinstance(entry, (Straight, Follow)) or entry.blend is None:
            yield chain
            chain = []


def _path_promise(
    motion: Trajectory, mechanism: Mechanism, limits: TaskLimits, chain: list[Motion], span: Span
) -> Way:
    """Return the lines of the motions that form one phase.

    The first line starts where the tip is when the phase begins. Each further line starts at the
    end of the line before it.
    """
    task, branch = _initial_task(motion, mechanism, chain, span)
    lines: list[Curve] = []
    retina: tuple[Array, float, float] | None = None
    for entry in chain:
        assert isinstance(entry, (Straight, Follow))
        tasks = [task]
        for point in (*(entry.through if isinstance(entry, Follow) else ()), entry.to):
            tasks.append(task_at(mechanism, point, tasks[-1], branch))
        if isinstance(entry, Follow) and entry.distance is not None and limits.eye is not None:
            retina = limits.eye.centre, limits.eye.radius, entry.distance
            tasks[-1][3] = _depth_in(mechanism, tasks[-1], retina[0], retina[1] - retina[2])
        tips = tip_from_task(mechanism, np.array(tasks))
        if isinstance(entry, Straight):
            lines.append(partial(_in_task, mechanism, tasks[0], tasks[-1]))
        elif entry.curve == "line":
            lines.append(partial(_line, tips[0], tips[-1]))
        else:
            lines.append(
                _circle(
                    tips, _middle(tips) if retina is None else retina[0], shorter=retina is not None
                )
            )
        task = tasks[-1]
    distances = tuple(
        entry.blend for entry in chain if isinstance(entry, (Straight, Follow)) and entry.blend
    )
    return Way(
        span,
        tuple(lines),
        distances,
        chain[0].constant_speed if isinstance(chain[0], Follow) else None,
        retina,
    )


def _initial_task(
    motion: Trajectory, mechanism: Mechanism, chain: list[Motion], span: Span
) -> tuple[Array, int]:
    """Return the task coordinates (4,) and the branch where a phase begins.

    The roll angle is unique only up to whole turns. If the motions give a roll, the result counts
    turns so that the phase ends near the last roll that they give.
    """
    rolls_given = [
        entry.to.roll
        for entry in chain
        if isinstance(entry, Straight) and entry.to.roll is not None
    ]
    inner = (
        motion.breaks[(motion.breaks > span.start) & (motion.breaks < span.end)]
        if rolls_given
        else ()
    )
    q = motion.positions(np.array([span.start, *inner, span.end]))
    tasks = task_from_joints(mechanism, q)
    if rolls_given:
        rolls = np.unwrap(tasks[:, 0])
        tasks[0, 0] += 2 * np.pi * np.round((rolls_given[-1] - rolls[-1]) / (2 * np.pi))
    return tasks[0], int(mechanism.branch_of(q[0]))


def task_at(mechanism: Mechanism, point: Point, default: Array, branch: int) -> Array:
    """Return the task coordinates of a point.

    Parameters
    ----------
    mechanism : Mechanism
        The kinematics of the robot.
    point : Point
        Task coordinates, joint positions, or a position of the tip with a spin.
    default : (4,) array
        Values of the coordinates that the point does not state. Angles are chosen near them.
    branch : int
        Solution of the inverse kinematics for a tip position: positive for the first one.

    Returns
    -------
    (4,) array
        Roll, tilt and spin in rad, and depth in m.
    """
    if isinstance(point, Task):
        return np.array(
            [point.set_coordinates.get(name, default[k]) for k, name in enumerate(TASK)]
        )
    if isinstance(point, Joints):
        return task_from_joints(mechanism, [point.values], near=default)[0]
    return task_from_joints(
        mechanism,
        inverse_tip(mechanism, [point.position], point.spin).joints[:, 0 if branch > 0 else 1],
        near=default,
    )[0]


def _depth_in(mechanism: Mechanism, task: Array, centre: Array, radius: float) -> float:
    """Return the depth in m at which the tip is on a sphere.

    Parameters
    ----------
    mechanism : Mechanism
    task : (4,) array
        Task coordinates, whose angles give the direction of the tool.
    centre : (3,) array
        Centre of the sphere, m.
    radius : float
        Radius of the sphere, m.
    """
    direction = tip_from_task(mechanism, np.array([[*task[:3], 1.0]]))[0]
    return float(
        direction @ centre
        + np.sqrt(max((direction @ centre) ** 2 - centre @ centre + radius**2, 0.0))
    )


def _in_task(mechanism: Mechanism, start: Array, end: Array, s: Array) -> Array:
    """Return tip positions (n, 3) on a straight line between two points in task coordinates.

    Parameters
    ----------
    mechanism : Mechanism
    start, end : (4,) arrays
        Task coordinates of both points.
    s : (n,) array
        Fractions of the line.
    """
    return tip_from_task(mechanism, start + s[:, None] * (end - start))


def _line(start: Array, end: Array, s: Array) -> Array:
    """Return points (n, 3) at the fractions s (n,) of a straight line between two tips (3,)."""
    return start + s[:, None] * (end - start)


def _middle(tips: Array) -> Array:
    """Return the centre (3,) of the circle through three points (3, 3).

    It is the intersection of the perpendicular bisecting planes of two sides and the points' plane.
    """
    sides = tips[1:] - tips[0]
    normal = np.cross(tips[1] - tips[0], tips[2] - tips[0])
    half = (sides * (tips[1:] + tips[0])).sum(axis=1) / 2
    return np.linalg.lstsq(
        np.vstack([sides, normal]), np.append(half, normal @ tips[0]), rcond=None
    )[0]


def _circle(tips: Array, centre: Array, *, shorter: bool) -> Curve:
    """Return an arc of a circle from the first tip to the last.

    Parameters
    ----------
    tips : (k, 3) array
        Tip positions on the circle, m.
    centre : (3,) array
        Centre of the circle, m.
    shorter : bool
        Select the shorter arc. Otherwise, the arc passes the second tip.
    """
    radius = tips[0] - centre
    end = tips[-1] - centre
    normal = np.cross(radius, end) if shorter else np.cross(tips[1] - tips[0], tips[-1] - tips[0])
    size = np.linalg.norm(normal)
    tangent = np.cross(normal / size, radius) if size else radius
    angle = float(np.arctan2(end @ tangent, end @ radius)) % (2 * np.pi) if size else 0.0
    return lambda s: (
        centre + np.cos(angle * s)[:, None] * radius + np.sin(angle * s)[:, None] * tangent
    )


def _off(line: Curve, tips: Array) -> Array:
    """Return the distances (n,) of tips (n, 3) from the nearest points of a line.

    The search starts at the nearest of COARSE points and continues with Newton steps.
    """
    shares = np.linspace(0.0, 1.0, COARSE)
    positions = line(shares)
    s = shares[np.argmin((positions**2).sum(axis=1) - 2 * tips @ positions.T, axis=1)]
    for _ in range(STEPS):
        positions_at, ahead = np.split(line(np.concatenate([s, s + STEP])), 2)
        slope = (ahead - positions_at) / STEP
        square = np.maximum((slope**2).sum(axis=1), np.finfo(float).tiny)
        s = np.clip(s + ((tips - positions_at) * slope).sum(axis=1) / square, 0.0, 1.0)
    return np.linalg.norm(tips - line(s), axis=1)


def _compare(motion: Trajectory, mechanism: Mechanism, promise: Way) -> WayKept:
    """Check that the tip follows the lines of one phase and keeps its height and its speed.

    The result contains the checks and the largest distance of the tip from its lines. For a
    constant speed, it also contains the times between which the tip has this speed, and the largest
    relative error.
    """
    t = _instants(motion, mechanism, promise)
    instants = [t[block] for block in blocks(len(t), SOME)]
    block_tips = [tip_position(mechanism, motion.positions(block)) for block in instants]
    distances = np.concatenate(
        [np.min([_off(line, tips) for line in promise.lines], axis=0) for tips in block_tips]
    )
    tips = np.vstack(block_tips)
    end_error = float(np.linalg.norm(tips[-1] - promise.lines[-1](np.ones(1))[0]))
    checks = _leaving(promise, t, tips, np.append(distances[:-1], max(distances[-1], end_error)))
    if promise.over is not None:
        centre, radius, distance = promise.over
        heights = radius - np.linalg.norm(tips - centre, axis=1)
        checks.append(_farthest_off(RetinaDistance(distance), ON, promise, t, heights))
    stretch = None
    if promise.speed is not None:
        samples = map(motion.sample, instants)
        speeds = np.concatenate(
            [tool_speed(TipSpeed, mechanism, sample.q, sample.qd) for sample in samples]
        )
        check, stretch = _at_speed(promise, promise.speed, t, speeds)
        checks.append(check)
    return WayKept(promise, tuple(checks), float(distances.max()), stretch)


def _instants(motion: Trajectory, mechanism: Mechanism, promise: Way) -> Array:
    """Return instants (n,) in every piece of a phase, with more of them near its corners."""
    start = promise.span.start
    end = promise.span.end
    breaks = np.concatenate(
        [[start], motion.breaks[(motion.breaks > start) & (motion.breaks < end)], [end]]
    )
    count = LOOKS if promise.speed else FEW
    t = np.append(
        (breaks[:-1, None] + np.arange(count) / count * np.diff(breaks)[:, None]).ravel(), end
    )
    if not promise.distances:
        return t
    distances = np.linalg.norm(
        tip_position(mechanism, motion.positions(t))[:, None] - promise.corners, axis=2
    )
    instants = [t]
    for is_near in (distances < ABOUT * np.array(promise.distances)).T:
        if is_near.any():
            start_index, end_index = np.flatnonzero(is_near)[[0, -1]]
            instants.append(
                np.linspace(t[max(start_index - 1, 0)], t[min(end_index + 1, len(t) - 1)], INSTANTS)
            )
    return np.unique(np.concatenate(instants))


def _leaving(promise: Way, t: Array, tips: Array, distances: Array) -> list[LimitCheck]:
    """Check how far the tips leave the lines.

    Parameters
    ----------
    promise : Way
    t : (n,) array
        Instants, s.
    tips : (n, 3) array
        Positions of the tip, m.
    off : (n,) array
        Distances from the lines, m.

    Returns
    -------
    list of LimitCheck
        The largest distance from the lines away from corners. If there are corners, also the
        largest distance from a corner at which the tip is off the lines.
    """
    shares = np.linalg.norm(tips[:, None] - promise.corners, axis=2) / np.array(promise.distances)
    outside = np.all(shares * promise.distances > np.array(promise.distances) + SLACK, axis=1)
    distances_away = np.where(outside, distances, 0.0)
    k = int(np.argmax(distances_away))
    checks = [_check(PathDeparture(ON), promise, float(distances_away[k]), float(t[k]))]
    if promise.distances:
        nearest_corner = np.argmin(shares, axis=1)
        k = int(np.argmax(np.where(distances > OFF, shares.min(axis=1), 0.0)))
        allowed = promise.distances[int(nearest_corner[k])]
        reach = allowed * float(shares[k].min()) if distances[k] > OFF else 0.0
        checks.append(_check(CornerRounding(allowed), promise, reach, float(t[k])))
    return checks


def _check(limit: OfPath, promise: Way, value: float, time: float) -> LimitCheck:
    """Return the result of a limit on the path. Its case is the name of the phase."""
    return replace(LimitCheck.from_extreme(limit, value, time), case=promise.span.name)


def _farthest_off(
    limit: OfPath, tolerance: float, promise: Way, t: Array, values: Array
) -> LimitCheck:
    """Check values that must equal `limit.largest` up to a tolerance.

    Parameters
    ----------
    limit : OfPath
        The limit with the required value.
    tolerance : float
        Largest deviation from this value, in its unit.
    promise : Way
        The phase.
    t, values : (n,) arrays
        Instants in s, and the values at these instants.

    Returns
    -------
    LimitCheck
        The value with the largest deviation. Its limit is the end of the tolerance on the same
        side.
    """
    error = values - limit.largest
    k = int(np.argmax(np.abs(error)))
    bound = limit.largest + tolerance * float(np.sign(error[k]) or 1.0)
    margin = 1 - float(abs(error[k])) / tolerance
    result = LimitCheck(
        limit.name,
        None,
        float(values[k]),
        limit=bound,
        margin=margin,
        time=float(t[k]),
        unit=limit.unit,
    )
    return replace(result, case=promise.span.name)


def _at_speed(
    promise: Way, speed: float, t: Array, speeds: Array
) -> tuple[LimitCheck, tuple[float, float, float]]:
    """Check the tip speeds (n,) of a phase that promises a constant speed.

    The speed must be constant between the first and the last instant at which it has the promised
    value. It must never exceed this value.

    Returns
    -------
    check : LimitCheck
        The speed with the largest error.
    stretch : tuple of three floats
        Start and end of the constant speed in s from the start of the phase, and the largest
        relative error.
    """
    at_speed = np.flatnonzero(np.abs(speeds / speed - 1) <= CONSTANT)
    ends = (0.0, 0.0)
    checked = speeds
    if len(at_speed) >= LOOKS:
        start = at_speed[0]
        end = at_speed[-1]
        ends = float(t[start] - t[0]), float(t[end] - t[0])
        checked = np.maximum(speeds, speed)
        checked[start : end + 1] = speeds[start : end + 1]
    check = _farthest_off(ConstantSpeed(speed), CONSTANT * speed, promise, t, checked)
    return check, (*ends, float(np.abs(checked / speed - 1).max()))
