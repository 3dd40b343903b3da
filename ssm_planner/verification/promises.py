"""Check requirements on the path of the tip: lines, corners, speed and distance from the retina.

A problem prescribes the path of the tip for some motions. These requirements are called promises,
because the planner promises to satisfy them. A path consists of lines, which are straight lines and
arcs, with corners between them. The lines follow from the problem and from the position of the tip
at the start of the phase (the part of the trajectory for one motion of the problem).

`check` calls `check_path_promises` for a planned motion, whose phases are known. The module
`visits` calls `check_table_lines` for a table of points, which has no phases.
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
    TASK_COORDINATES,
    TIP_CURVES,
    ConstantSpeed,
    CornerRounding,
    Follow,
    Joints,
    Motion,
    PathDeparture,
    PathRequirement,
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

LINE_DEPARTURE = 1e-7
"""Distance of the tip from the prescribed lines beyond which it counts as having left them, m."""
PATH_TOLERANCE = 1e-6
"""Largest permitted distance from the lines, and error of the distance from the retina, m."""
CONSTANT_SPEED_TOLERANCE = 1e-6
"""Largest permitted relative error of a constant tip speed."""
CORNER_SLACK = 1e-9
"""Distance by which the zone around a corner is extended to cover rounding errors, m."""
CONSTANT_SPEED_INSTANTS = 8
"""Number of checked instants in every piece of a motion with a constant tip speed."""
PIECE_INSTANTS = 3
"""Number of checked instants in every piece of other motions."""
CORNER_RADIUS_FACTOR = 1.5
"""Radius around a corner in which more instants are checked, as a multiple of the zone's radius."""
CORNER_INSTANTS = 301
"""Number of additional instants that are checked around a corner."""
LINE_SEARCH_POINTS = 65
"""Number of points on a line that are compared to find a start for the nearest point."""
NEWTON_STEPS = 3
"""Number of Newton steps from there to the nearest point of the line."""
DIFFERENCE_STEP = 1e-7
"""Step of the difference quotients in the Newton steps, as a fraction of the line."""
INSTANTS_PER_BLOCK = 4096
"""Number of instants that are evaluated together, which bounds the memory."""

Curve = Callable[[Array], Array]
"""Function that converts fractions (n,) of a line, from 0 to 1, into tip positions (n, 3), m."""


@frozen
class PathPromise:
    """The requirements of a problem on the path of the tip in one phase of a motion.

    Attributes
    ----------
    span : Span
        Name, start and end of the phase (the part of the trajectory for these motions).
    """

    span: Span
    lines: tuple[Curve, ...]
    """Lines that the tip follows one after the other. Each line ends where the next one begins."""
    corner_distances: tuple[float, ...] = ()
    """Radius of the zone around each corner in which the tip may leave the lines, m."""
    speed: float | None = None
    """Constant speed that the tip must have, m/s. None without such a requirement."""
    retina: tuple[Array, float, float] | None = None
    """Centre (3,) and radius of the retina, and required distance of the tip from it, m.

    None without such a requirement.
    """

    @property
    def corners(self) -> Array:
        """Positions (k, 3) of the k corners between consecutive lines, m."""
        return np.array([line(np.ones(1))[0] for line in self.lines[:-1]]).reshape(-1, 3)


@frozen
class PromiseResult:
    """The result of checking the path of the tip in one phase, in SI units.

    Attributes
    ----------
    promise : PathPromise
        The requirements on the path.
    checks : tuple of LimitCheck
        One result for each requirement.
    """

    promise: PathPromise
    checks: tuple[LimitCheck, ...]
    departure: float
    """Largest distance of the tip from its lines, m."""
    constant_speed_span: tuple[float, float, float] | None = None
    """Start and end of the constant speed, and its largest relative error.

    The times count in s from the start of the phase. None if no constant speed is required.
    """

    @property
    def corner_reach(self) -> float | None:
        """Largest distance from a corner at which the tip has left the lines, m.

        None if the phase has no corners.
        """
        reaches = (check.worst for check in self.checks if check.name == CornerRounding.name)
        return next(reaches, None)


def check_path_promises(
    motion: Trajectory, mechanism: Mechanism, limits: TaskLimits
) -> list[PromiseResult]:
    """Check every phase of a planned motion for which the problem prescribes the path of the tip.

    Parameters
    ----------
    motion : Trajectory
        A trajectory with phases, which are the parts for the motions of the problem.
    mechanism : Mechanism
        The kinematics of the robot.
    limits : TaskLimits
        Limits that include the motions of the problem, which prescribe the paths, and the eye.

    Returns
    -------
    list of PromiseResult
        One result for each phase with a prescribed path, in the order of the phases.
    """
    promises = _path_promises(motion, mechanism, limits)
    return [_check_promise(motion, mechanism, promise) for promise in promises]


def check_table_lines(
    motion: Trajectory,
    mechanism: Mechanism,
    limits: TaskLimits,
    chain: list[Motion],
    span: Span,
    allowed: float,
) -> tuple[list[LimitCheck], list[Unjudged]]:
    """Check that a table of points follows the lines that consecutive motions prescribe.

    Motions form a chain if rounded corners join them, so that the robot does not stop between them.

    Parameters
    ----------
    motion : Trajectory
        The table.
    mechanism : Mechanism
        The kinematics of the robot.
    limits : TaskLimits
        Limits that include the eye.
    chain : list of Motion
        The motions of the chain, or a single motion.
    span : Span
        Name of the chain, and the times between which the table performs it.
    allowed : float
        Largest distance from the lines outside rounded corners, m.

    Returns
    -------
    checks : list of LimitCheck
        The largest distance from the lines. The list is empty if no lines are prescribed, or if
        the tip must follow the retina.
    unjudged : list of Unjudged
        Requirements that the points of a table do not determine.
    """
    if not _prescribes_lines(chain[0]):
        return [], []
    promise = replace(_path_promise(motion, mechanism, limits, chain, span), speed=None)
    checks = []
    names = []  # limits that remain unjudged
    if promise.corner_distances:
        names.append(CornerRounding.name)
    if promise.retina is None:
        departure = _check_promise(motion, mechanism, promise).checks[0]
        checks.append(
            LimitCheck.from_extreme(
                PathDeparture(allowed), departure.worst, departure.time, span.name
            )
        )
    else:
        names.append(PathDeparture.name)
    if getattr(chain[0], "constant_speed", None):
        names.append(ConstantSpeed.name)
    reason = f"the points of a table do not show whether {span.name} keeps it"
    return checks, [Unjudged(name, None, reason) for name in names]


def unchecked_lines_remark(limits: TaskLimits) -> str:
    """Return the remark for a certificate that the path of the tip was not checked.

    The certificate of a table of points contains this remark, because a table does not state the
    times of phases, and the lines belong to phases.

    Parameters
    ----------
    limits : TaskLimits
        Limits that name the motions with prescribed lines.

    Returns
    -------
    str
        The remark, with the names of the motions.
    """
    return (
        f"whether the tip follows the path of {limits.promising}: a table does not contain the "
        "times of phases"
    )


def _prescribes_lines(entry: Motion) -> bool:
    """Return True if a motion of a problem prescribes lines that the tip must follow.

    Parameters
    ----------
    entry : Motion
        An entry of `motion` in the problem file.

    Returns
    -------
    bool
        True for a straight motion, and for a curve that the tip follows in space ("line", "arc" or
        "retina").
    """
    return isinstance(entry, Straight) or (isinstance(entry, Follow) and entry.curve in TIP_CURVES)


def _path_promises(
    motion: Trajectory, mechanism: Mechanism, limits: TaskLimits
) -> Iterator[PathPromise]:
    """Assign the motions of a problem to phases, and yield the requirements on their paths.

    Motions and phases have the same names and the same order. A scan and a curve through samples
    consist of an unknown number of phases. After such a motion, the function searches the phase of
    the next motion by its name. A motion without a phase gets an empty phase, which fails the
    check. Motions without prescribed lines are skipped.

    Parameters
    ----------
    motion : Trajectory
        A trajectory with phases, which are the parts for the motions of the problem.
    mechanism : Mechanism
        Kinematics of the robot.
    limits : TaskLimits
        Limits that include the motions of the problem and the eye.

    Yields
    ------
    PathPromise
        The requirements on one phase.
    """
    index = 0
    counts_unknown = False
    spans = motion.phases
    names = [span.name for span in spans]
    for chain in _chains(limits.motion):
        head = chain[0]
        name = " + ".join(dict.fromkeys(entry.name for entry in chain))
        if isinstance(head, Scan) or (isinstance(head, Follow) and head.curve == "samples"):
            counts_unknown = True  # The planner chooses the number of phases.
            continue
        if counts_unknown and name in names[index:]:
            index = names.index(name, index)
        elif not counts_unknown and names[index : index + 1] == [f"{name}, approach"]:
            index += 1  # a curve along the retina has a phase that approaches it
        counts_unknown = False
        start = spans[index].start if index < len(spans) else motion.breaks[-1]
        span = Span(name, start, start)
        if names[index : index + 1] == [name]:
            span = spans[index]
        index += 1
        if _prescribes_lines(head):
            yield _path_promise(motion, mechanism, limits, chain, span)


def _chains(entries: Sequence[Motion]) -> Iterator[list[Motion]]:
    """Divide the motions of a problem into chains, between which the robot stops.

    Consecutive motions that are joined by rounded corners form one chain, and one phase of the
    trajectory. Every other motion is a chain by itself.

    Parameters
    ----------
    entries : sequence of Motion
        Motions of a problem in their order.

    Yields
    ------
    list of Motion
        The motions of one chain.
    """
    chain: list[Motion] = []
    for entry in entries:
        chain.append(entry)
        if not isinstance(entry, (Straight, Follow)) or entry.blend is None:
            yield chain
            chain = []


def _path_promise(
    motion: Trajectory, mechanism: Mechanism, limits: TaskLimits, chain: list[Motion], span: Span
) -> PathPromise:
    """Build the requirements on the path of the tip for one chain of motions.

    The first line starts where the tip is at the start of the phase. Each further line starts at
    the end of the previous line.

    Parameters
    ----------
    motion : Trajectory
        Motion that is checked. Only the start of the phase counts, and whole turns of the roll.
    mechanism : Mechanism
        Kinematics of the robot.
    limits : TaskLimits
        Limits that include the eye.
    chain : list of Motion
        Motions that are joined by rounded corners, or a single motion.
    span : Span
        Name, start and end of the phase (the part of the trajectory for these motions).

    Returns
    -------
    PathPromise
        Lines, corners, constant speed and distance from the retina.
    """
    task, branch = _initial_task(motion, mechanism, chain, span)
    lines: list[Curve] = []
    distances: list[float] = []
    retina: tuple[Array, float, float] | None = None
    for entry in chain:
        assert isinstance(entry, (Straight, Follow))
        tasks = [task]
        waypoints = entry.through if isinstance(entry, Follow) else ()
        for point in waypoints + (entry.to,):
            tasks.append(task_coordinates_of(mechanism, point, tasks[-1], branch))
        if isinstance(entry, Follow) and entry.distance is not None and limits.eye is not None:
            retina = limits.eye.centre, limits.eye.radius, entry.distance
            tasks[-1][3] = _depth_on_sphere(mechanism, tasks[-1], retina[0], retina[1] - retina[2])
        tips = tip_from_task(mechanism, np.array(tasks))
        if isinstance(entry, Straight):
            lines.append(partial(_task_line_points, mechanism, tasks[0], tasks[-1]))
        elif entry.curve == "line":
            lines.append(partial(_line_points, tips[0], tips[-1]))
        elif retina is None:
            lines.append(_circular_arc(tips, _circle_centre(tips), shorter=False))
        else:
            lines.append(_circular_arc(tips, retina[0], shorter=True))
        if entry.blend:
            distances.append(entry.blend)
        task = tasks[-1]
    speed = getattr(chain[0], "constant_speed", None)
    return PathPromise(span, tuple(lines), tuple(distances), speed, retina)


def _initial_task(
    motion: Trajectory, mechanism: Mechanism, chain: list[Motion], span: Span
) -> tuple[Array, int]:
    """Return the task coordinates and the branch of the inverse kinematics at the start of a phase.

    The roll angle is unique only up to whole turns. If the motions of the phase state a roll, the
    function adds whole turns to the initial roll, so that the phase ends near the last stated roll.

    Parameters
    ----------
    motion : Trajectory
        Motion that is checked.
    mechanism : Mechanism
        Kinematics of the robot.
    chain : list of Motion
        Motions of the problem that belong to the phase.
    span : Span
        Name, start and end of the phase (the part of the trajectory for these motions).

    Returns
    -------
    task : (4,) array
        Roll, tilt and spin in rad, and depth in m.
    branch : int
        Which of the two solutions of the inverse kinematics the joints have: positive for the first
        one.
    """
    final_roll = None
    for entry in chain:
        if isinstance(entry, Straight) and entry.to.roll is not None:
            final_roll = entry.to.roll
    # The breaks in between show how far the tool rolls during the phase.
    breaks = motion.breaks if final_roll is not None else np.zeros(0)
    inner = breaks[(breaks > span.start) & (breaks < span.end)]
    q = motion.positions(np.concatenate([[span.start], inner, [span.end]]))
    tasks = task_from_joints(mechanism, q)
    if final_roll is not None:
        rolls = np.unwrap(tasks[:, 0])
        tasks[0, 0] += 2 * np.pi * np.round((final_roll - rolls[-1]) / (2 * np.pi))
    return tasks[0], int(mechanism.branch_of(q[0]))


def task_coordinates_of(mechanism: Mechanism, point: Point, default: Array, branch: int) -> Array:
    """Convert a point of a problem to task coordinates.

    Parameters
    ----------
    mechanism : Mechanism
        The kinematics of the robot.
    point : Point
        Task coordinates, joint positions, or a position of the tip with a spin.
    default : (4,) array
        Values of the coordinates that the point does not state. Angles are chosen near them.
    branch : int
        Which of the two solutions of the inverse kinematics a tip position has: positive for the
        first one.

    Returns
    -------
    (4,) array
        Roll, tilt and spin in rad, and depth in m.
    """
    if isinstance(point, Task):
        task = default.copy()
        for k, name in enumerate(TASK_COORDINATES):
            task[k] = point.set_coordinates.get(name, default[k])
        return task
    if isinstance(point, Joints):
        q = np.array([point.values])
    else:
        solutions = inverse_tip(mechanism, [point.position], point.spin).joints
        branch_index = 0 if branch > 0 else 1
        q = solutions[:, branch_index]
    return task_from_joints(mechanism, q, near=default)[0]


def _depth_on_sphere(mechanism: Mechanism, task: Array, centre: Array, radius: float) -> float:
    """Compute the depth of the tool at which its tip lies on a sphere.

    The axis of the tool intersects the sphere at two depths, of which the larger one is returned.

    Parameters
    ----------
    mechanism : Mechanism
        Kinematics of the robot.
    task : (4,) array
        Task coordinates, whose angles give the direction of the tool.
    centre : (3,) array
        Centre of the sphere, m.
    radius : float
        Radius of the sphere, m.

    Returns
    -------
    float
        Depth, m.
    """
    direction = tip_from_task(mechanism, np.append(task[:3], 1.0)[None])[0]
    # The depth d solves |d · direction − centre| = radius.
    projection = direction @ centre
    discriminant = projection**2 - centre @ centre + radius**2
    return float(projection + np.sqrt(max(discriminant, 0.0)))


def _task_line_points(mechanism: Mechanism, start: Array, end: Array, s: Array) -> Array:
    """Compute tip positions on a line that is straight in task coordinates.

    Parameters
    ----------
    mechanism : Mechanism
        Kinematics of the robot.
    start, end : (4,) arrays
        Task coordinates of both ends: roll, tilt and spin in rad, and depth in m.
    s : (n,) array
        Fractions of the line, from 0 at its start to 1 at its end.

    Returns
    -------
    (n, 3) array
        Tip positions, m.
    """
    return tip_from_task(mechanism, _line_points(start, end, s))


def _line_points(start: Array, end: Array, s: Array) -> Array:
    """Compute tip positions on a straight line in space.

    Parameters
    ----------
    start, end : (3,) arrays
        Tip positions at both ends of the line, m.
    s : (n,) array
        Fractions of the line, from 0 at its start to 1 at its end.

    Returns
    -------
    (n, 3) array
        Tip positions, m.
    """
    return start + s[:, None] * (end - start)


def _circle_centre(tips: Array) -> Array:
    """Compute the centre of the circle through three points.

    The centre lies in the plane of the points, and in the planes that bisect two sides of their
    triangle perpendicularly. These are three linear equations.

    Parameters
    ----------
    tips : (3, 3) array
        The points (rows), m.

    Returns
    -------
    (3,) array
        The centre, m.
    """
    sides = tips[1:] - tips[0]
    normal = np.cross(sides[0], sides[1])
    plane_normals = np.vstack([sides, normal])
    bisecting_offsets = (sides * (tips[1:] + tips[0])).sum(axis=1) / 2
    offsets = np.append(bisecting_offsets, normal @ tips[0])
    return np.linalg.lstsq(plane_normals, offsets, rcond=None)[0]


def _circular_arc(tips: Array, centre: Array, *, shorter: bool) -> Curve:
    """Build the arc of a circle from the first tip position to the last one.

    Parameters
    ----------
    tips : (k, 3) array
        Tip positions on the circle, m.
    centre : (3,) array
        Centre of the circle, m.
    shorter : bool
        True selects the shorter arc. Otherwise, the arc passes through the second tip position.

    Returns
    -------
    Curve
        Function from fractions of the arc to tip positions.
    """
    radius = tips[0] - centre
    end = tips[-1] - centre
    normal = np.cross(radius, end)
    if not shorter:
        normal = np.cross(tips[1] - tips[0], tips[-1] - tips[0])
    size = np.linalg.norm(normal)
    # A point of the arc at angle φ from its start is centre + cos φ · radius + sin φ · tangent. If
    # the normal is 0, both ends coincide and the arc has no length.
    tangent = radius
    angle = 0.0
    if size:
        tangent = np.cross(normal / size, radius)
        angle = float(np.arctan2(end @ tangent, end @ radius)) % (2 * np.pi)

    def arc(s: Array) -> Array:
        """Return points (n, 3) at the fractions s (n,) of the arc."""
        angles = (angle * s)[:, None]
        return centre + np.cos(angles) * radius + np.sin(angles) * tangent

    return arc


def _distances_from_line(line: Curve, tips: Array) -> Array:
    """Compute the distances of tip positions from a line.

    For each tip position, the search starts at the nearest of `LINE_SEARCH_POINTS` points on the
    line and approaches the nearest point with Newton steps.

    Parameters
    ----------
    line : Curve
        The line.
    tips : (n, 3) array
        Tip positions, m.

    Returns
    -------
    (n,) array
        Distances, m.
    """
    shares = np.linspace(0.0, 1.0, LINE_SEARCH_POINTS)
    positions = line(shares)
    # |p − tip|² without its term |tip|², which is the same for all points p of the line.
    s = shares[np.argmin((positions**2).sum(axis=1) - 2 * tips @ positions.T, axis=1)]
    for _ in range(NEWTON_STEPS):
        nearest_points = line(s)
        tangent = (line(s + DIFFERENCE_STEP) - nearest_points) / DIFFERENCE_STEP
        square = np.maximum((tangent**2).sum(axis=1), np.finfo(float).tiny)
        s = np.clip(s + ((tips - nearest_points) * tangent).sum(axis=1) / square, 0.0, 1.0)
    return np.linalg.norm(tips - line(s), axis=1)


def _check_promise(motion: Trajectory, mechanism: Mechanism, promise: PathPromise) -> PromiseResult:
    """Check all requirements on the path of the tip in one phase.

    The tip must follow the lines, keep the required distance from the retina, and have the required
    constant speed.

    Parameters
    ----------
    motion : Trajectory
        Motion that is checked.
    mechanism : Mechanism
        Kinematics of the robot.
    promise : PathPromise
        The requirements.

    Returns
    -------
    PromiseResult
        One `LimitCheck` for each requirement, and the quantities that describe the path.
    """
    t = _checked_instants(motion, mechanism, promise)
    tips = np.empty((len(t), 3))
    distances = np.empty(len(t))
    for block in blocks(len(t), INSTANTS_PER_BLOCK):
        tips[block] = tip_position(mechanism, motion.positions(t[block]))
        line_distances = [_distances_from_line(line, tips[block]) for line in promise.lines]
        distances[block] = np.min(line_distances, axis=0)
    # The tip must also reach the end of the last line, so the error there counts as a distance.
    end_error = np.linalg.norm(tips[-1] - promise.lines[-1](np.ones(1))[0])
    with_end = np.append(distances[:-1], max(distances[-1], end_error))
    checks = _check_departure(promise, t, tips, with_end)
    if promise.retina is not None:
        centre, radius, distance = promise.retina
        heights = radius - np.linalg.norm(tips - centre, axis=1)
        checks.append(
            _check_required_value(RetinaDistance(distance), PATH_TOLERANCE, promise, t, heights)
        )
    constant_speed_span = None
    if promise.speed is not None:
        speeds = np.empty(len(t))
        for block in blocks(len(t), INSTANTS_PER_BLOCK):
            samples = motion.sample(t[block])
            speeds[block] = tool_speed(TipSpeed, mechanism, samples.q, samples.qd)
        check, constant_speed_span = _check_constant_speed(promise, promise.speed, t, speeds)
        checks.append(check)
    return PromiseResult(promise, tuple(checks), float(distances.max()), constant_speed_span)


def _checked_instants(motion: Trajectory, mechanism: Mechanism, promise: PathPromise) -> Array:
    """Choose the instants at which the path of the tip is checked in one phase.

    Every polynomial piece contains several instants. Further instants are added around corners.

    Parameters
    ----------
    motion : Trajectory
        Motion that is checked.
    mechanism : Mechanism
        Kinematics of the robot.
    promise : PathPromise
        The requirements on the path of the tip in the phase.

    Returns
    -------
    (n,) array
        Instants in ascending order, s.
    """
    start = promise.span.start
    end = promise.span.end
    first = np.searchsorted(motion.breaks, start, "right")
    last = np.searchsorted(motion.breaks, end)
    breaks = np.concatenate([[start], motion.breaks[first:last], [end]])
    count = CONSTANT_SPEED_INSTANTS if promise.speed else PIECE_INSTANTS
    shares = np.arange(count) / count
    t = np.append(breaks[:-1, None] + shares * np.diff(breaks)[:, None], end)
    if not promise.corner_distances:
        return t
    tips = tip_position(mechanism, motion.positions(t))
    distances = np.linalg.norm(tips[:, None] - promise.corners, axis=2)
    instants = [t]
    for is_near in (distances < CORNER_RADIUS_FACTOR * np.array(promise.corner_distances)).T:
        if is_near.any():
            indices = np.flatnonzero(is_near)
            previous = t[max(indices[0] - 1, 0)]
            following = t[min(indices[-1] + 1, len(t) - 1)]
            instants.append(np.linspace(previous, following, CORNER_INSTANTS))
    return np.unique(np.concatenate(instants))


def _check_departure(
    promise: PathPromise, t: Array, tips: Array, distances: Array
) -> list[LimitCheck]:
    """Check that the tip leaves the lines only within the permitted zones around corners.

    Parameters
    ----------
    promise : PathPromise
        The requirements on the path of the tip.
    t : (n,) array
        Instants, s.
    tips : (n, 3) array
        Tip positions at these instants, m.
    distances : (n,) array
        Distances of these tip positions from the lines, m.

    Returns
    -------
    list of LimitCheck
        The first check states the largest distance from the lines outside of all zones. If the
        phase has corners, a second check states how far from its corner the tip leaves the lines.
    """
    radii = np.array(promise.corner_distances)
    # Distances from the corners, (n, corners), and the same as multiples of the radii of the zones.
    # The nearest corner is the one with the smallest multiple.
    corner_distances = np.linalg.norm(tips[:, None] - promise.corners, axis=2)
    shares = corner_distances / radii
    outside = np.all(corner_distances > radii + CORNER_SLACK, axis=1)
    distances_away = np.where(outside, distances, 0.0)
    phase = promise.span.name
    worst = int(np.argmax(distances_away))
    limit = PathDeparture(PATH_TOLERANCE)
    checks = [LimitCheck.from_extreme(limit, float(distances_away[worst]), float(t[worst]), phase)]
    if promise.corner_distances:
        has_left = distances > LINE_DEPARTURE
        worst = int(np.argmax(np.where(has_left, shares.min(axis=1), 0.0)))
        nearest = int(np.argmin(shares[worst]))
        reach = float(corner_distances[worst, nearest]) if has_left[worst] else 0.0
        rounding = CornerRounding(promise.corner_distances[nearest])
        checks.append(LimitCheck.from_extreme(rounding, reach, float(t[worst]), phase))
    return checks


def _check_required_value(
    limit: PathRequirement, tolerance: float, promise: PathPromise, t: Array, values: Array
) -> LimitCheck:
    """Check that a quantity has a required value, up to a tolerance.

    Parameters
    ----------
    limit : PathRequirement
        The limit with the required value.
    tolerance : float
        Largest deviation from this value, in its unit.
    promise : PathPromise
        The requirements on the phase, whose name becomes the case of the result.
    t, values : (n,) arrays
        Instants in s, and the values of the quantity at these instants.

    Returns
    -------
    LimitCheck
        The value with the largest deviation. Its limit is the end of the tolerance on the same
        side.
    """
    errors = values - limit.largest
    worst = int(np.argmax(np.abs(errors)))
    error = float(errors[worst])
    bound = limit.largest + (tolerance if error >= 0 else -tolerance)
    return LimitCheck(
        limit.name,
        None,
        float(values[worst]),
        limit=bound,
        margin=1 - abs(error) / tolerance,
        time=float(t[worst]),
        unit=limit.unit,
        case=promise.span.name,
    )


def _check_constant_speed(
    promise: PathPromise, speed: float, t: Array, speeds: Array
) -> tuple[LimitCheck, tuple[float, float, float]]:
    """Check the tip speed in a phase that requires a constant speed.

    The tip must have the required speed from the first to the last instant at which it reaches
    this speed. Before and after this span, the tip accelerates and brakes, so it may be slower
    there but not faster.

    Parameters
    ----------
    promise : PathPromise
        The phase.
    speed : float
        Required speed, m/s.
    t, speeds : (n,) arrays
        Instants in s, and tip speeds at these instants in m/s.

    Returns
    -------
    check : LimitCheck
        The speed with the largest error.
    constant_speed_span : tuple of three floats
        Start and end of the constant speed in s from the start of the phase, and the largest
        relative error.
    """
    # A few instants at the speed may be a coincidence. All instants count then, and the check fails
    # because the tip is slower at the ends.
    at_speed = np.flatnonzero(np.abs(speeds / speed - 1) <= CONSTANT_SPEED_TOLERANCE)
    start_time = 0.0
    end_time = 0.0
    checked = speeds
    if len(at_speed) >= CONSTANT_SPEED_INSTANTS:
        start = at_speed[0]
        end = at_speed[-1]
        start_time = float(t[start] - t[0])
        end_time = float(t[end] - t[0])
        # Before and after the constant speed, only an excess counts.
        checked = np.maximum(speeds, speed)
        checked[start : end + 1] = speeds[start : end + 1]
    check = _check_required_value(
        ConstantSpeed(speed), CONSTANT_SPEED_TOLERANCE * speed, promise, t, checked
    )
    return check, (start_time, end_time, float(np.abs(checked / speed - 1).max()))
