"""Scans as sequences of free motions and dwells at spots of the retina.

The tip keeps a constant distance from the retina. The pattern lies in the tangent plane of the
retina at the point where the tool axis meets it in the middle of the pattern. Its rows run in the
direction in which roll turns the tool. The spots are projected onto the sphere from its centre. At
each spot the tool, which passes through the remote centre, points at the spot.
"""

from __future__ import annotations

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics import (
    Mechanism,
    inverse_tip,
    pose_from_task,
    tilt_interval,
    tip_position,
)
from ssm_planner.planning.lower_bound import least_times
from ssm_planner.planning.tolerances import ROUNDING
from ssm_planner.problem import TASK, Dwell, Eye, Free, Motion, Problem, Scan, Tip
from ssm_planner.typing import Array, Indices

STARTS = 8
"""Number of first spots from which a short order is sought."""


def visits_of(problem: Problem, mechanism: Mechanism, scan: Scan, q: Array) -> list[Motion]:
    """Return the motions of a scan from the joints q (4,), with stops or passing through the spots.

    Raises ProblemError.
    """
    eye, task = problem.eye, _middle(problem, mechanism, scan)
    assert eye is not None  # A Problem with a scan has an eye.
    (axis,) = tool_axis(mechanism, task)
    # Rows run in the direction in which roll turns the tool.
    side = np.cross(mechanism.omega1, axis)
    planes = (spots_on_retina(eye, axis, side, plane) for plane in pattern(scan))
    runs = [tips_over_retina(problem, scan, spots, scan.distance) for spots in planes]
    spin = float(task[2])
    if scan.order == "fastest":
        tips = np.concatenate(runs)
        runs = [tips[_soonest(problem, mechanism, tips, spin, q)]]
    result: list[Motion] = []
    for k, tips in enumerate(runs, 1):
        name = scan.name if len(runs) == 1 else f"{scan.name} {k}"
        spots = [Tip((x, y, z), spin, scan.line) for x, y, z in tips.tolist()]
        result += _visits(scan, name, spots)
    return result


def pattern(scan: Scan) -> list[Array]:
    """Return the spots in the plane, m, in the order of the motion.

    There is one array (n, 2) for every ring, or one for a raster.
    """
    if scan.diameters:
        return [_ring(diameter, scan.spacing) for diameter in scan.diameters]
    x = (np.arange(scan.columns) - (scan.columns - 1) / 2) * scan.spacing
    y = (np.arange(scan.rows) - (scan.rows - 1) / 2) * scan.spacing
    # Every other row runs backwards, so that no motion crosses the whole pattern.
    rows = [
        np.stack([x if k % 2 == 0 else x[::-1], np.full_like(x, height)], axis=1)
        for k, height in enumerate(y)
    ]
    return [np.concatenate(rows)]


def spots_on_retina(eye: Eye, axis: Array, side: Array, plane: Array) -> Array:
    """Return points of the retina (n, 3) for spots (n, 2) in a tangent plane.

    `side` (3,) is the direction of the plane's first coordinate. Its component along the normal is
    removed.
    """
    middle = _reach(eye, axis[None, :], eye.radius)[0] * axis
    normal = (middle - eye.centre) / eye.radius
    row_axis = side - normal * (normal @ side)
    row_axis /= np.linalg.norm(row_axis)
    flat = middle + plane[:, :1] * row_axis + plane[:, 1:] * np.cross(normal, row_axis)
    outward = flat - eye.centre
    return eye.centre + eye.radius * outward / np.linalg.norm(outward, axis=1, keepdims=True)


def _ring(diameter: float, spacing: float) -> Array:
    """Return spots (n, 2) on a ring, m, with nearly the requested spacing."""
    count = max(3, round(np.pi * diameter / spacing))
    angle = 2 * np.pi * np.arange(count) / count
    return diameter / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _reach(eye: Eye, axis: Array, radius: float) -> Array:
    """Return the depth (n,) at which rays along axis (n, 3) leave a sphere about the eye's centre.

    The rays start at the remote centre. The depth is NaN if a ray misses the sphere.
    """
    projection = axis @ eye.centre
    with np.errstate(invalid="ignore"):
        return np.asarray(projection + np.sqrt(projection**2 - eye.centre @ eye.centre + radius**2))


def _middle(problem: Problem, mechanism: Mechanism, scan: Scan) -> Array:
    """Return the task coordinates (4,) at which the tool points at the middle of the pattern."""
    task = np.array([scan.at.set_coordinates.get(name, 0.0) for name in TASK])
    refuse_tilt(problem, mechanism, float(task[1]), line=scan.line, key="at.tilt")
    return task


def refuse_tilt(
    problem: Problem,
    mechanism: Mechanism,
    tilt: float,
    *,
    line: int | None,
    key: str,
    file: str | None = None,
) -> None:
    """Raise ProblemError for a tilt (rad) out of the mechanism's reach.

    `file` is None for the problem's own file.
    """
    low, high = tilt_interval(mechanism)
    if not low < tilt < high:
        raise ProblemError(
            "the mechanism cannot reach this tilt",
            file=file or problem.file,
            line=line,
            key=key,
            value=f"{np.degrees(tilt):.6g} deg",
            allowed=f"{np.degrees(low):.3f} deg to {np.degrees(high):.3f} deg, "
            "ends excluded (paper, eq. 9): there the speed of joint tilt grows without bound",
        )


def tips_over_retina(problem: Problem, motion: Motion, spots: Array, distance: float) -> Array:
    """Return tips (n, 3) at `distance` m from the retina for spots (n, 3) of the retina.

    Directions may be given in place of spots.
    """
    assert problem.eye is not None  # A Problem with a scan or a motion along the retina has an eye.
    direction = spots / np.linalg.norm(spots, axis=1, keepdims=True)
    depth = _reach(problem.eye, direction, problem.eye.radius - distance)
    if not np.all(depth > 0):
        name = motion.kind if isinstance(motion, Scan) else motion.name
        raise ProblemError(
            f"from the port no spot of this {name} can be reached at that distance from the retina",
            file=problem.file,
            line=motion.line,
            key="distance",
            value=f"{1e3 * distance:g} mm",
            allowed="a direction in which the tool's axis meets the retina deeper in the eye",
        )
    return np.asarray(direction * depth[:, None])


def _visits(scan: Scan, name: str, spots: list[Tip]) -> list[Motion]:
    """Return the motions to the spots of one run, with or without dwells.

    A ring in its given order is closed.
    """
    result: list[Motion] = []
    if scan.dwell > 0:
        for n, spot in enumerate(spots, 1):
            result.append(Free(spot, name=f"{name}, spot {n}", line=scan.line))
            result.append(Dwell(scan.dwell, f"{name}, laser {n}", scan.line))
        return result
    result.append(Free(spots[0], name=f"{name}, approach", line=scan.line))
    remaining = spots[1:] + (spots[:1] if scan.diameters and scan.order == "given" else [])
    if remaining:
        result.append(Free(remaining[-1], tuple(remaining[:-1]), name=name, line=scan.line))
    return result


def tool_axis(mechanism: Mechanism, task: Array) -> Array:
    """Return the tool's direction (1, 3) at task coordinates (4,)."""
    # The tip at a depth of 1 m gives the direction.
    return pose_from_task(mechanism, [[*task[:3], 1.0]])[1]


def _soonest(problem: Problem, mechanism: Mechanism, tips: Array, spin: float, q: Array) -> Indices:
    """Return the order in which tips (n, 3) are visited soonest from the joints q (4,).

    Durations are those of motions from rest to rest in which the slowest joint, or the tip,
    decides. Spots that the branch of q does not reach cause an error later.
    """
    limits = np.array([joint.position for joint in problem.robot.joints])
    solutions = inverse_tip(mechanism, tips, spin, limits=limits, reference=q)
    column = np.argmax(solutions.valid & (solutions.branch == mechanism.branch_of(q)), axis=1)
    joints = np.vstack([q, solutions.joints[np.arange(len(tips)), column]])
    positions = np.vstack([tip_position(mechanism, q[None]), tips])
    displacements = joints[:, None] - joints
    distances = np.linalg.norm(positions[:, None] - positions, axis=2)
    return shortest_order(least_times(problem.robot, displacements, distances, problem.task_limits))


def shortest_order(times: Array) -> Indices:
    """Return a short tour from place 0 through all others, as their order (n − 1,) without place 0.

    `times` (n, n) is symmetric. Tours are the places in their given order, and nearest-neighbour
    tours that begin at one of the STARTS places nearest to place 0. Each is improved by 2-opt and
    Or-opt (runs of up to three places are moved and reversed) until neither helps, and the shortest
    is returned.

    Source: D. S. Johnson, L. A. McGeoch, The Traveling Salesman Problem: A Case Study in Local
    Optimization, 1997.
    """
    nearest = np.argsort(times[0, 1:])[:STARTS] + 1
    tours = [np.arange(len(times)), *(_nearest_neighbours(times, int(k)) for k in nearest)]
    improved = [_improved(tour, times) for tour in tours]
    durations = [float(times[tour[:-1], tour[1:]].sum()) for tour in improved]
    return np.asarray(improved[int(np.argmin(durations))][1:] - 1)


def _nearest_neighbours(times: Array, first: int) -> Indices:
    """Return the tour from place 0 to `first`, and from there always to the nearest new place."""
    tour = [0, first]
    unvisited = np.ones(len(times), dtype=bool)
    unvisited[tour] = False
    while unvisited.any():
        tour.append(int(np.argmin(np.where(unvisited, times[tour[-1]], np.inf))))
        unvisited[tour[-1]] = False
    return np.array(tour)


def _improved(tour: Indices, times: Array) -> Indices:
    """Return an open tour (n,) after 2-opt and Or-opt. Its first place is fixed."""
    n = len(tour)
    # A place that takes no time from anywhere follows the last one, which leaves the end open.
    times = np.pad(times, (0, 1))
    tour = np.append(tour, n)
    previous = tour[:0]
    while not np.array_equal(tour, previous):
        previous = tour
        for i in range(1, n - 1):
            # Reverse the places i … j.
            j = np.arange(i + 1, n)
            gain = times[tour[i - 1], tour[i]] + times[tour[j], tour[j + 1]]
            gain = gain - times[tour[i - 1], tour[j]] - times[tour[i], tour[j + 1]]
            if gain.max() > ROUNDING:
                end = int(j[np.argmax(gain)])
                tour = np.concatenate([tour[:i], tour[i : end + 1][::-1], tour[end + 1 :]])
        for length in (1, 2, 3):
            for i in range(1, n - length + 1):
                tour = _move_run(tour, i, length, times)
    return tour[:-1]


def _move_run(tour: Indices, i: int, length: int, times: Array) -> Indices:
    """Return the tour with a run of `length` places from i moved to where it costs least."""
    run = tour[i : i + length]
    remaining = np.concatenate([tour[:i], tour[i + length :]])
    saved = (
        times[tour[i - 1], run[0]]
        + times[run[-1], tour[i + length]]
        - times[tour[i - 1], tour[i + length]]
    )
    predecessors, successors = remaining[:-1], remaining[1:]
    costs = [
        times[predecessors, order[0]]
        + times[order[-1], successors]
        - times[predecessors, successors]
        for order in (run, run[::-1])
    ]
    reverse = int(np.min(costs[1]) < np.min(costs[0]))
    k = int(np.argmin(costs[reverse]))
    if saved - costs[reverse][k] <= ROUNDING:
        return tour
    return np.concatenate([remaining[: k + 1], run[::-1] if reverse else run, remaining[k + 1 :]])
