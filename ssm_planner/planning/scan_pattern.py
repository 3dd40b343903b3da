"""Scans of the retina as sequences of free motions and dwells at spots.

The tip keeps a constant distance from the retina. The pattern of spots is defined in a plane that
touches the retina where the tool axis meets it in the middle of the pattern. Its rows run in the
direction in which roll turns the tool. The spots are projected onto the spherical retina from its
centre. The tool always passes through the remote centre, and it points at each spot.
"""

from dataclasses import replace

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics import (
    Mechanism,
    inverse_tip,
    pose_from_task,
    tilt_interval,
    tip_position,
)
from ssm_planner.planning.lower_bound import slowest_joint_times
from ssm_planner.planning.tolerances import ROUNDING_TOLERANCE
from ssm_planner.problem import TASK_COORDINATES, Dwell, Eye, Free, Motion, Problem, Scan, Task, Tip
from ssm_planner.typing import Array, Indices

TOUR_TRIALS = 200
"""Number of random changes that the search for a short order of the spots tries.

The time of the search is proportional to this number.
"""


def scan_motions(problem: Problem, mechanism: Mechanism, scan: Scan, q: Array) -> list[Motion]:
    """Return the motions that visit all spots of a scan.

    If the scan has a dwell, the robot stops at each spot. Otherwise it passes through the spots.

    Parameters
    ----------
    problem : Problem
        The problem with its eye.
    mechanism : Mechanism
        Geometry of the robot.
    scan : Scan
        Entry of the motion list.
    q : (4,) array
        Joint positions before the scan, rad and m.

    Returns
    -------
    list of Motion
        Free motions and dwells in the order of time. A free motion leads to one spot, or through
        all spots of a ring or raster.

    Raises
    ------
    ProblemError
        If the mechanism cannot reach the middle of the pattern, or if a spot cannot be reached at
        the distance from the retina.
    """
    eye, middle = problem.eye, replace(scan.at, line=scan.line)
    assert eye is not None  # A Problem with a scan has an eye.
    task = complete_task(problem, mechanism, middle, np.zeros(4), key="at.tilt")
    (axis,) = tool_axis(mechanism, task)
    # Rows run in the direction in which roll turns the tool.
    side = np.cross(mechanism.omega1, axis)
    spots_by_run = (spots_on_retina(eye, axis, side, plane) for plane in spots_in_plane(scan))
    runs = [tips_over_retina(problem, scan, spots, scan.distance) for spots in spots_by_run]
    spin = float(task[2])
    # All rings together form one run, so that the order may change between them.
    if scan.order == "fastest":
        tips = np.concatenate(runs)
        runs = [tips[_fast_spot_order(problem, mechanism, tips, spin, q)]]
    result: list[Motion] = []
    for k, tips in enumerate(runs, 1):
        name = scan.name if len(runs) == 1 else f"{scan.name} {k}"
        spots = [Tip((x, y, z), spin, scan.line) for x, y, z in tips.tolist()]
        result += _run_motions(scan, name, spots)
    return result


def spots_in_plane(scan: Scan) -> list[Array]:
    """Return the spots of a scan in the tangent plane of the retina, in the order of the motion.

    The origin is the middle of the pattern.

    Parameters
    ----------
    scan : Scan
        Entry of the motion list: concentric rings, or a raster of rows and columns.

    Returns
    -------
    list of (n, 2) arrays
        Spots of each ring, or of the raster, m. The first coordinate runs along the rows.
    """
    if scan.diameters:
        return [_ring_spots(diameter, scan.spacing) for diameter in scan.diameters]
    x = (np.arange(scan.columns) - (scan.columns - 1) / 2) * scan.spacing
    y = (np.arange(scan.rows) - (scan.rows - 1) / 2) * scan.spacing
    spots = np.stack(np.meshgrid(x, y), axis=-1)
    # Every other row runs backwards, so that no motion crosses the whole pattern.
    spots[1::2] = spots[1::2, ::-1]
    return [spots.reshape(-1, 2)]


def spots_on_retina(eye: Eye, axis: Array, side: Array, plane: Array) -> Array:
    """Project spots of the tangent plane onto the retina.

    The plane touches the spherical retina where the tool axis meets it in the middle of the
    pattern. The projection is from the centre of the sphere.

    Parameters
    ----------
    eye : Eye
        The eye.
    axis : (3,) array
        Unit vector of the tool axis in the middle of the pattern.
    side : (3,) array
        Direction of the first coordinate of the plane. Its component normal to the plane is
        removed.
    plane : (n, 2) array
        Spots in the plane, m, with the middle of the pattern as origin.

    Returns
    -------
    (n, 3) array
        Points of the retina, m. The origin is the remote centre.
    """
    middle = _exit_depths(eye, axis[None, :], eye.radius)[0] * axis
    normal = (middle - eye.centre) / eye.radius
    row_axis = side - normal * (normal @ side)
    row_axis /= np.linalg.norm(row_axis)
    plane_points = middle + plane[:, :1] * row_axis + plane[:, 1:] * np.cross(normal, row_axis)
    from_centre = plane_points - eye.centre
    distances = np.linalg.norm(from_centre, axis=1, keepdims=True)
    return eye.centre + eye.radius * from_centre / distances


def _ring_spots(diameter: float, spacing: float) -> Array:
    """Return evenly spaced spots on a circle about the origin, (n, 2), m. There are at least 3.

    Parameters
    ----------
    diameter : float
        Diameter of the circle, m.
    spacing : float
        Approximate distance between neighbouring spots along the circle, m. It is rounded so that a
        whole number of spots fits.
    """
    count = max(3, round(np.pi * diameter / spacing))
    angle = 2 * np.pi * np.arange(count) / count
    return diameter / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _exit_depths(eye: Eye, axis: Array, radius: float) -> Array:
    """Return the depths at which rays from the remote centre leave a sphere.

    The depth t of the unit vector a satisfies |t a − c| = R, with the centre c and the radius R of
    the sphere. The larger solution is t = a · c + √((a · c)² − |c|² + R²).

    Parameters
    ----------
    eye : Eye
        The eye, whose centre is the centre of the sphere. The remote centre is the origin.
    axis : (n, 3) array
        Unit vectors of the rays.
    radius : float
        Radius of the sphere, m.

    Returns
    -------
    (n,) array
        Depths, m. NaN where the ray and its extension backwards miss the sphere.
    """
    projection = axis @ eye.centre
    with np.errstate(invalid="ignore"):
        return np.asarray(projection + np.sqrt(projection**2 - eye.centre @ eye.centre + radius**2))


def complete_task(
    problem: Problem,
    mechanism: Mechanism,
    target: Task,
    defaults: Array,
    *,
    key: str = "tilt",
    file: str | None = None,
) -> Array:
    """Return the task coordinates of a target, with default values for omitted coordinates.

    Parameters
    ----------
    problem : Problem
        The problem, for its file name.
    mechanism : Mechanism
        Geometry of the robot.
    target : Task
        The target.
    defaults : (4,) array
        Task coordinates that replace omitted ones, rad and m.
    key : str
        Key of the tilt in the file, for error messages.
    file : str or None
        File of the target, for error messages. None for the problem's own file.

    Returns
    -------
    (4,) array
        Roll, tilt and spin (rad), and depth (m).

    Raises
    ------
    ProblemError
        If the tilt is outside the mechanism's range, or at one of its ends.
    """
    task = np.array(
        [target.set_coordinates.get(name, defaults[k]) for k, name in enumerate(TASK_COORDINATES)]
    )
    low, high = tilt_interval(mechanism)
    if not low < task[1] < high:
        raise ProblemError(
            "the mechanism cannot reach this tilt",
            file=file or problem.file,
            line=target.line,
            key=key,
            value=f"{np.degrees(task[1]):.6g} deg",
            allowed=f"{np.degrees(low):.3f} deg to {np.degrees(high):.3f} deg, "
            "ends excluded (paper, eq. 9): there the speed of joint tilt grows without bound",
        )
    return task


def tips_over_retina(problem: Problem, motion: Motion, spots: Array, distance: float) -> Array:
    """Return the positions of the tip at a given distance from the retina, in given directions.

    The tool passes through the remote centre and points in each of the directions.

    Parameters
    ----------
    problem : Problem
        The problem with its eye.
    motion : Motion
        Entry of the motion list, for error messages.
    spots : (n, 3) array
        Points of the retina, or any vectors from the remote centre towards them.
    distance : float
        Distance of the tip from the retina, m.

    Returns
    -------
    (n, 3) array
        Positions of the tip, m. The origin is the remote centre.

    Raises
    ------
    ProblemError
        If the tip cannot be at this distance from the retina in one of the directions.
    """
    assert problem.eye is not None  # A Problem with a scan or a motion along the retina has an eye.
    direction = spots / np.linalg.norm(spots, axis=1, keepdims=True)
    depth = _exit_depths(problem.eye, direction, problem.eye.radius - distance)
    if not np.all(depth > 0):
        name = motion.kind if isinstance(motion, Scan) else motion.name
        raise ProblemError(
            f"the tool in the port cannot reach a spot of this {name} at this distance",
            file=problem.file,
            line=motion.line,
            key="distance",
            value=f"{1e3 * distance:g} mm",
            allowed="a direction in which the tool's axis meets the retina deeper in the eye",
        )
    return np.asarray(direction * depth[:, None])


def _run_motions(scan: Scan, name: str, spots: list[Tip]) -> list[Motion]:
    """Return the motions that visit the spots of one run, with dwells if the scan has any.

    A run is one ring, or all spots of a raster. Without dwells, the tip passes through the spots in
    one motion, after a motion to the first of them. A ring in its given order ends at its first
    spot.

    Parameters
    ----------
    scan : Scan
        Entry of the motion list.
    name : str
        Name of the run, from which the names of the motions are formed.
    spots : list of Tip
        Positions of the tip in their order.

    Returns
    -------
    list of Motion
        Free motions and dwells in the order of time.
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
    """Return the unit vector of the tool's direction at given task coordinates.

    Parameters
    ----------
    mechanism : Mechanism
        Geometry of the robot.
    task : (4,) array
        Roll, tilt and spin, rad. The depth is not used.

    Returns
    -------
    (1, 3) array
        Unit vector.
    """
    # The tip at a depth of 1 m is a unit vector from the remote centre.
    return pose_from_task(mechanism, [[*task[:3], 1.0]])[1]


def _fast_spot_order(
    problem: Problem, mechanism: Mechanism, tips: Array, spin: float, q: Array
) -> Indices:
    """Find an order in which the tip visits all given positions in a short time.

    The time from one position to another is that of a motion from rest to rest. The slowest joint
    or the speed of the tip determines it. The order is found by `search_short_tour`.

    Parameters
    ----------
    problem : Problem
        The problem with its limits.
    mechanism : Mechanism
        Geometry of the robot.
    tips : (n, 3) array
        Positions of the tip, m.
    spin : float
        Spin at all positions, rad.
    q : (4,) array
        Joint positions at the start, rad and m.

    Returns
    -------
    (n,) int array
        Indices of the positions in the order of the visits.
    """
    limits = np.array([joint.position for joint in problem.robot.joints])
    solutions = inverse_tip(mechanism, tips, spin, limits=limits, reference=q)
    # First solution of each position on the present branch (one of the two solutions of the inverse
    # kinematics). A position without one gets column 0, which only affects the order.
    column = np.argmax(solutions.valid & (solutions.branch == mechanism.branch_of(q)), axis=1)
    joints = np.vstack([q, solutions.joints[np.arange(len(tips)), column]])
    positions = np.vstack([tip_position(mechanism, q[None]), tips])
    # Entry [k, j] is the difference between the positions k and j. Position 0 is the present one.
    displacements = joints[:, None] - joints
    distances = np.linalg.norm(positions[:, None] - positions, axis=2)
    return search_short_tour(
        slowest_joint_times(problem.robot, displacements, distances, problem.task_limits)
    )


def search_short_tour(times: Array) -> Indices:
    """Search for a short tour from place 0 through all others (travelling salesman problem).

    A tour is an order of the places. It ends at the last place and does not return to place 0. The
    search is an iterated local search. It begins with the places in their given order, improved by
    `_improve_tour`. In each of `TOUR_TRIALS` trials it exchanges two neighbouring parts of the
    shortest tour so far at random, and improves the result. The random numbers are the same in
    every search.

    Parameters
    ----------
    times : (n, n) array
        Symmetric table of the times between places, s.

    Returns
    -------
    (n − 1,) int array
        Order in which the tour visits the places 1 … n − 1. Their indices are counted from 0.

    Notes
    -----
    Source: D. S. Johnson, L. A. McGeoch, The Traveling Salesman Problem: A Case Study in Local
    Optimization, 1997.
    """

    def duration(order: Indices) -> float:
        """Return the time of a tour (n,), s."""
        return float(times[order[:-1], order[1:]].sum())

    random = np.random.default_rng(0)
    place_count = len(times)
    tour = _improve_tour(np.arange(place_count), times)
    longest_part = place_count // 4 + 1
    for _ in range(TOUR_TRIALS):
        # Position of the first part in the tour, and lengths of both parts.
        part = random.integers(1, (place_count, longest_part + 1, longest_part + 1))
        start, middle, end = np.cumsum(part)
        exchanged = [tour[:start], tour[middle:end], tour[start:middle], tour[end:]]
        trial = _improve_tour(np.concatenate(exchanged), times)
        # min keeps the present tour if the trial takes the same time.
        tour = min(tour, trial, key=duration)
    return np.asarray(tour[1:] - 1)


def _improve_tour(tour: Indices, times: Array) -> Indices:
    """Improve a tour by 2-opt, which reverses a part of the tour, until no reversal shortens it.

    The tour begins at its first place and may end anywhere.

    Parameters
    ----------
    tour : (n,) int array
        Indices of the places in their order. The first place stays where it is.
    times : (n, n) array
        Times between places, s.

    Returns
    -------
    (n,) int array
        The improved tour, with the same first place.
    """
    # An artificial last place, to which all ways take no time, leaves the end of the tour open.
    times, tour = np.pad(times, (0, 1)), np.append(tour, len(tour))
    while True:
        between = times[np.ix_(tour, tour)]
        steps = np.diag(between, 1)
        # If the places i … j are reversed, two new ways replace those from i − 1 to i and from j to
        # j + 1. Rows stand for i and columns for j, both from 1 to n − 1.
        gain = np.triu(steps[:-1, None] + steps[1:] - between[:-2, 1:-1] - between[1:-1, 2:])
        i, j = np.unravel_index(np.argmax(gain), gain.shape)
        if gain[i, j] <= ROUNDING_TOLERANCE:
            return tour[:-1]
        # Index 0 of the table stands for position 1 in the tour.
        tour[i + 1 : j + 2] = tour[i + 1 : j + 2][::-1].copy()
