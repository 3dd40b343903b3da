"""A scan as a sequence of free motions and dwells: spots on the retina, the tip at a constant distance from it.

The pattern lies in the plane that touches the retina where the tool's axis meets it in the middle of the pattern, its rows
along the direction in which roll turns the tool; the spots are projected onto the sphere from its centre. At each spot the
tool, which passes through the remote centre, points at it.
"""

from __future__ import annotations

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.inverse import inverse_tip
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import pose_from_task
from ssm_planner.kinematics.workspace import tilt_interval
from ssm_planner.planning.lower_bound import least_times
from ssm_planner.problem.limits import TASK
from ssm_planner.problem.motion import Dwell, Free, Motion, Scan, Tip
from ssm_planner.problem.problem import Eye, Problem
from ssm_planner.typing import Array, Indices

STARTS, MANY = 8, 300
"""Spots nearest to where the robot is from which an order is sought; beyond so many spots in all only the first of them."""
SWEEPS, LEAST_GAIN = 50, 1e-9
"""Rounds of improvement, and what counts as one, s."""


def visits_of(problem: Problem, mechanism: Mechanism, scan: Scan, q: Array) -> list[Motion]:
    """A scan as free motions to, or through, its spots, from the joints q (4,) on. Raises ProblemError."""
    eye, task = problem.eye, _middle(problem, mechanism, scan)
    assert eye is not None  # a Problem sees to that
    axis, side = _axis(mechanism, task)
    planes = (spots_on_retina(eye, axis, side, plane) for plane in pattern(scan))
    runs = [tips_over_retina(problem, scan, spots, scan.distance) for spots in planes]
    names = [scan.name] if len(runs) == 1 else [f"{scan.name} {k}" for k in range(1, len(runs) + 1)]
    if scan.order == "fastest":
        tips = np.concatenate(runs)
        runs, names = [tips[_soonest(problem, mechanism, tips, float(task[2]), q)]], [scan.name]
    result: list[Motion] = []
    for name, tips in zip(names, runs, strict=True):
        result += _visits(
            scan, name, [Tip((x, y, z), float(task[2]), scan.line) for x, y, z in tips.tolist()]
        )
    return result


def pattern(scan: Scan) -> list[Array]:
    """Spots in the plane, m: one array (n, 2) for every ring, or one for the raster, in the order of the motion."""
    if scan.diameters:
        return [_ring(diameter, scan.spacing) for diameter in scan.diameters]
    x = (np.arange(scan.columns) - (scan.columns - 1) / 2) * scan.spacing
    y = (np.arange(scan.rows) - (scan.rows - 1) / 2) * scan.spacing
    # every other row runs back, so that no motion crosses the whole pattern
    rows = [
        np.stack([x if k % 2 == 0 else x[::-1], np.full_like(x, height)], axis=1)
        for k, height in enumerate(y)
    ]
    return [np.concatenate(rows)]


def spots_on_retina(eye: Eye, axis: Array, side: Array, plane: Array) -> Array:
    """Points of the retina (n, 3) for spots (n, 2) in the plane that touches it where the axis (3,) meets it.

    side (3,): direction of the plane's first coordinate, made perpendicular to the plane's normal.
    """
    middle = _reach(eye, axis[None, :], eye.radius)[0] * axis
    normal = (middle - eye.centre) / eye.radius
    first = side - normal * (normal @ side)
    first /= np.linalg.norm(first)
    flat = middle + plane[:, :1] * first + plane[:, 1:] * np.cross(normal, first)
    outward = flat - eye.centre
    return eye.centre + eye.radius * outward / np.linalg.norm(outward, axis=1, keepdims=True)


def _ring(diameter: float, spacing: float) -> Array:
    count = max(3, round(np.pi * diameter / spacing))
    angle = 2 * np.pi * np.arange(count) / count
    return diameter / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _reach(eye: Eye, axis: Array, radius: float) -> Array:
    """Depth (n,) at which rays from the remote centre along axis (n, 3) leave the sphere of this radius; NaN: never."""
    along = axis @ eye.centre
    with np.errstate(invalid="ignore"):
        return np.asarray(along + np.sqrt(along**2 - eye.centre @ eye.centre + radius**2))


def _middle(problem: Problem, mechanism: Mechanism, scan: Scan) -> Array:
    """Task coordinates (4,) in which the tool points at the middle of the pattern."""
    task = np.array([scan.at.given.get(name, 0.0) for name in TASK])
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
    """ProblemError for a tilt (rad) out of the mechanism's reach; file: not the problem's own."""
    low, high = tilt_interval(mechanism)
    if not low < tilt < high:
        raise ProblemError(
            "the mechanism cannot reach this tilt",
            file=file or problem.file,
            line=line,
            key=key,
            value=f"{np.degrees(tilt):.6g} deg",
            allowed=f"{np.degrees(low):.3f} deg to {np.degrees(high):.3f} deg, ends excluded (paper, eq. 9): there the "
            "speed of joint tilt grows without bound",
        )


def tips_over_retina(problem: Problem, motion: Motion, spots: Array, distance: float) -> Array:
    """Tips (n, 3) from which the tool points at spots (n, 3) of the retina, or along directions, `distance` m from it."""
    assert problem.eye is not None  # a Problem sees to that
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
    """Motions to the spots of one run: with a dwell at each, or through all of them; a ring in its own order is closed."""
    result: list[Motion] = []
    if scan.dwell > 0:
        for n, spot in enumerate(spots, 1):
            result.append(Free(spot, name=f"{name}, spot {n}", line=scan.line))
            result.append(Dwell(scan.dwell, f"{name}, laser {n}", scan.line))
        return result
    result.append(Free(spots[0], name=f"{name}, approach", line=scan.line))
    rest = spots[1:] + (spots[:1] if scan.diameters and scan.order == "given" else [])
    if rest:
        result.append(Free(rest[-1], tuple(rest[:-1]), name=name, line=scan.line))
    return result


def _axis(mechanism: Mechanism, task: Array) -> tuple[Array, Array]:
    """Direction of the tool (3,) at these task coordinates, and the direction in which roll turns it (3,)."""
    (axis,) = pose_from_task(mechanism, [[*task[:3], 1.0]])[1]  # the tip at a depth of 1 m
    return axis, np.cross(mechanism.omega1, axis)


def _soonest(problem: Problem, mechanism: Mechanism, tips: Array, spin: float, q: Array) -> Indices:
    """The order in which tips (n, 3) are visited soonest from the joints q (4,) on.

    Durations are those of motions from rest to rest on which the slowest joint, or the tip, decides; spots that the branch
    of q does not reach are an error later.
    """
    limits = np.array([joint.position for joint in problem.robot.joints])
    found = inverse_tip(mechanism, tips, spin, limits=limits, reference=q)
    first = np.argmax(found.valid & (found.branch == mechanism.branch_of(q)), axis=1)
    joints = np.vstack([q, found.joints[np.arange(len(tips)), first]])
    places = np.vstack([tip_position(mechanism, q[None]), tips])
    times = np.array(
        [
            least_times(
                problem.robot,
                joints - here,
                np.linalg.norm(places - place, axis=1),
                problem.task_limits,
            )
            for here, place in zip(joints, places, strict=True)
        ]
    )
    return shortest_order(times)


def shortest_order(times: Array) -> Indices:
    """A short way from place 0 through all others, in which order (n − 1,), counted without it; times (n, n) symmetric.

    The shorter of two: the places as they are numbered, and always on to the nearest one (with each of the STARTS nearest
    ones as the first), either improved by 2-opt and Or-opt (stretches of up to three places moved, and turned round) until
    neither helps.
    Source: D. S. Johnson, L. A. McGeoch, The Traveling Salesman Problem: A Case Study in Local Optimization, 1997.
    """
    ways = [np.arange(len(times))]
    for first in np.argsort(times[0, 1:])[: STARTS if len(times) <= MANY else 1] + 1:
        way, left = [0, int(first)], np.ones(len(times), dtype=bool)
        left[way] = False
        while left.any():
            way.append(int(np.argmin(np.where(left, times[way[-1]], np.inf))))
            left[way[-1]] = False
        ways.append(np.array(way))
    improved = [_improved(way, times) for way in ways]
    return np.asarray(min(improved, key=lambda way: float(times[way[:-1], way[1:]].sum()))[1:] - 1)


def _improved(way: Indices, times: Array) -> Indices:
    """An open way (n,) whose first place stays, after 2-opt and Or-opt."""
    n = len(way)
    # a place behind the last one that is no time from anywhere: it leaves the end open
    times = np.pad(times, (0, 1))
    way = np.append(way, n)
    for _ in range(SWEEPS):
        before = way
        for i in range(1, n - 1):
            # turn i … j round
            j = np.arange(i + 1, n)
            gain = times[way[i - 1], way[i]] + times[way[j], way[j + 1]]
            gain = gain - times[way[i - 1], way[j]] - times[way[i], way[j + 1]]
            if gain.max() > LEAST_GAIN:
                end = int(j[np.argmax(gain)])
                way = np.concatenate([way[:i], way[i : end + 1][::-1], way[end + 1 :]])
        for length in (1, 2, 3):
            for i in range(1, n - length + 1):
                way = _moved(way, i, length, times)
        if np.array_equal(way, before):
            break
    return way[:-1]


def _moved(way: Indices, i: int, length: int, times: Array) -> Indices:
    """The way with the stretch of so many places from i on where it costs least, either way round."""
    stretch, rest = way[i : i + length], np.concatenate([way[:i], way[i + length :]])
    saved = (
        times[way[i - 1], stretch[0]]
        + times[stretch[-1], way[i + length]]
        - times[way[i - 1], way[i + length]]
    )
    here, after = rest[:-1], rest[1:]
    costs = [
        times[here, each[0]] + times[each[-1], after] - times[here, after]
        for each in (stretch, stretch[::-1])
    ]
    turned = int(np.min(costs[1]) < np.min(costs[0]))
    k = int(np.argmin(costs[turned]))
    if saved - costs[turned][k] <= LEAST_GAIN:
        return way
    return np.concatenate([rest[: k + 1], stretch[::-1] if turned else stretch, rest[k + 1 :]])
