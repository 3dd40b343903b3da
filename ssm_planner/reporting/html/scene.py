"""Build the scene of the 3D view: axes, links, tilt bands and eye.

A tilt band is the part of a sphere around the RCM through which the tool axis can pass, because of
the geometry of the robot or because of the limits of the task.

All coordinates are in m in the base frame, whose origin is the remote centre of motion (RCM).
"""

import math
from collections.abc import Mapping

import numpy as np

from ssm_planner.kinematics import Mechanism, pose_from_task, tilt_interval
from ssm_planner.problem import JOINTS, Eye, Robot, TaskLimits, to_plain
from ssm_planner.typing import Array, JsonObject, Range

LINK_RADIUS = 0.11
"""Radius of the drawn links, m. Robot files do not contain the shapes of links."""
BAND_RADIUS = 0.075
"""Radius of the sphere on which the tilt band is drawn, m."""
MAX_VERTEX_ANGLE = math.radians(5.0)
"""Largest angle between two neighbouring vertices of the band, rad."""


def robot_scene(robot: Robot, limits: TaskLimits) -> JsonObject:
    """Return the 3D scene of a robot: its mechanism, the ranges of task coordinates, and the eye.

    Parameters
    ----------
    robot : Robot
        Robot that is drawn.
    limits : TaskLimits
        Limits of the task, with the eye.

    Returns
    -------
    dict
        Scene as JSON types, in m and rad in the base frame.
    """
    mechanism = Mechanism.from_robot(robot)
    scene = mechanism_scene(mechanism, limits.ranges, link_sides(robot, mechanism), limits.eye)
    scene["names"] = [joint.name for joint in robot.joints]
    return scene


def mechanism_scene(
    mechanism: Mechanism,
    ranges: Mapping[str, Range],
    sides: list[int] | None = None,
    eye: Eye | None = None,
) -> JsonObject:
    """Return the scene of a mechanism as JSON types, in m and rad in the base frame.

    Parameters
    ----------
    mechanism : Mechanism
        Kinematics of the robot.
    ranges : mapping of str to (float, float)
        Permitted ranges of task coordinates, rad or m.
    sides : list of int, optional
        Side of the RCM on which joints 1 and 2 are drawn. It is +1 in the direction of the joint
        axis, and −1 opposite to it (default).
    eye : Eye, optional
        Eye with the retina and the lens.

    Returns
    -------
    dict
        `axes` are the unit vectors of joint axes 1 to 3. `insertion_sign` is the factor, +1 or −1,
        that converts the position of joint 4 to the depth. `bands` are the reachable and the
        allowed tilt band, and `link` is the radius of the drawn links.
    """
    low, high = tilt_interval(mechanism)
    bands = [{"name": "reachable", **tilt_band(mechanism, (low, high), (-math.pi, math.pi))}]
    if "tilt" in ranges:
        allowed = max(ranges["tilt"][0], low), min(ranges["tilt"][1], high)
        if allowed[0] < allowed[1]:
            roll = ranges.get("roll", (-math.pi, math.pi))
            bands.append({"name": "allowed", **tilt_band(mechanism, allowed, roll)})
    return {
        "axes": [mechanism.omega1.tolist(), mechanism.omega2.tolist(), mechanism.omega3.tolist()],
        "sides": [-1, -1] if sides is None else sides,
        "names": list(JOINTS),
        "link": LINK_RADIUS,
        "insertion_sign": mechanism.insertion_sign,
        "bands": bands,
        "eye": None if eye is None else to_plain(eye),
    }


def tilt_band(mechanism: Mechanism, tilt: Range, roll: Range) -> JsonObject:
    """Return the part of a sphere around the RCM through which the tool axis passes.

    The part belongs to given ranges of tilt and roll, and is called a tilt band. Its vertices form
    a grid whose rows have equal tilt.

    Parameters
    ----------
    mechanism : Mechanism
        Kinematics of the robot.
    tilt, roll : (float, float)
        Ranges of these coordinates, rad.

    Returns
    -------
    dict
        `rows` and `columns` are the numbers of vertices in the directions of tilt and roll.
        `vertices` contains the coordinates of all vertices in m, one after the other.
    """
    tilts = _angle_grid(tilt[0], tilt[1])
    rolls = _angle_grid(max(roll[0], -math.pi), min(roll[1], math.pi))
    task = np.zeros((len(tilts) * len(rolls), 4))
    task[:, 0] = np.tile(rolls, len(tilts))
    task[:, 1] = np.repeat(tilts, len(rolls))
    rotations, _ = pose_from_task(mechanism, task)
    vertices = np.round(BAND_RADIUS * rotations[:, :, 2], 6)  # The tool axis is the third column.
    return {"rows": len(tilts), "columns": len(rolls), "vertices": vertices.ravel().tolist()}


def _angle_grid(low: float, high: float) -> Array:
    """Return evenly spaced angles (n,) in rad with steps of at most `MAX_VERTEX_ANGLE`."""
    return np.linspace(low, high, max(2, math.ceil((high - low) / MAX_VERTEX_ANGLE) + 1))


def link_sides(robot: Robot, mechanism: Mechanism) -> list[int]:
    """Return the sides of the remote centre of motion on which links 1 and 2 are drawn.

    A link is drawn on the side of its centre of mass.

    Parameters
    ----------
    robot : Robot
        Robot with the bodies of its links.
    mechanism : Mechanism
        Kinematics of the robot.

    Returns
    -------
    list of two int
        +1 in the direction of the joint axis, and −1 opposite to it.
    """
    return [
        1 if axis @ (body.frame @ body.com) > 0 else -1
        for axis, body in zip((mechanism.omega1, mechanism.omega2), robot.bodies, strict=False)
    ]
