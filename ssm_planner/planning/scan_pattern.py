"""A scan as a sequence of free motions and dwells: spots on the retina, the tip at a constant distance from it.

The pattern lies in the plane that touches the retina where the tool's axis meets it in the middle of the pattern, its rows
along the direction in which roll turns the tool; the spots are projected onto the sphere from its centre. At each spot the
tool, which passes through the remote centre, points at it.
"""

from __future__ import annotations

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import pose_from_task
from ssm_planner.kinematics.workspace import tilt_interval
from ssm_planner.problem.limits import TASK
from ssm_planner.problem.motion import Dwell, Free, Motion, Scan, Tip
from ssm_planner.problem.problem import Eye, Problem
from ssm_planner.typing import Array


def expand_scans(problem: Problem, mechanism: Mechanism) -> tuple[Motion, ...]:
    """The motion list with every scan as free motions to, or through, its spots. Raises ProblemError."""
    result: list[Motion] = []
    for motion in problem.motion:
        if not isinstance(motion, Scan) or problem.eye is None:
            result.append(motion)
            continue
        task = _middle(problem, mechanism, motion)
        axis, side = _axis(mechanism, task)
        for k, plane in enumerate(pattern(motion), 1):
            tips = _tips(problem, motion, spots_on_retina(problem.eye, axis, side, plane), motion.distance)
            spots = [Tip((x, y, z), float(task[2]), motion.line) for x, y, z in tips.tolist()]
            name = motion.name if len(motion.diameters) < 2 else f"{motion.name} {k}"
            result += _visits(motion, name, spots)
    return tuple(result)


def pattern(scan: Scan) -> list[Array]:
    """Spots in the plane, m: one array (n, 2) for every ring, or one for the raster, in the order of the motion."""
    if scan.diameters:
        return [_ring(diameter, scan.spacing) for diameter in scan.diameters]
    x = (np.arange(scan.columns) - (scan.columns - 1) / 2) * scan.spacing
    y = (np.arange(scan.rows) - (scan.rows - 1) / 2) * scan.spacing
    # every other row runs back, so that no motion crosses the whole pattern
    rows = [np.stack([x if k % 2 == 0 else x[::-1], np.full_like(x, height)], axis=1) for k, height in enumerate(y)]
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
    problem: Problem, mechanism: Mechanism, tilt: float, *, line: int | None, key: str, file: str | None = None
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


def _tips(problem: Problem, motion: Motion, spots: Array, distance: float) -> Array:
    """Tip positions (n, 3) from which the tool points at spots (n, 3) on the retina, `distance` away from it."""
    assert problem.eye is not None
    direction = spots / np.linalg.norm(spots, axis=1, keepdims=True)
    depth = _reach(problem.eye, direction, problem.eye.radius - distance)
    if not np.all(depth > 0):
        raise ProblemError(
            "from the port no spot of this scan can be reached at that distance from the retina",
            file=problem.file,
            line=motion.line,
            key="scan",
            allowed="a direction in which the tool's axis meets the retina deeper in the eye",
        )
    return np.asarray(direction * depth[:, None])


def _visits(scan: Scan, name: str, spots: list[Tip]) -> list[Motion]:
    """Motions to the spots of one ring or raster: with a dwell at each, or through all of them; a ring is closed."""
    result: list[Motion] = []
    if scan.dwell > 0:
        for n, spot in enumerate(spots, 1):
            result.append(Free(spot, name=f"{name}, spot {n}", line=scan.line))
            result.append(Dwell(scan.dwell, f"{name}, laser {n}", scan.line))
        return result
    result.append(Free(spots[0], name=f"{name}, approach", line=scan.line))
    rest = spots[1:] + (spots[:1] if scan.diameters else [])
    if rest:
        result.append(Free(rest[-1], tuple(rest[:-1]), name=name, line=scan.line))
    return result


def _axis(mechanism: Mechanism, task: Array) -> tuple[Array, Array]:
    """Direction of the tool (3,) at these task coordinates, and the direction in which roll turns it (3,)."""
    (axis,) = pose_from_task(mechanism, [[*task[:3], 1.0]])[1]  # the tip at a depth of 1 m
    return axis, np.cross(mechanism.omega1, axis)
