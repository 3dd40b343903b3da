"""Build the scene of the 3D view: axes, links, tilt band and eye, in m in the base frame."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import pose_from_task
from ssm_planner.kinematics.workspace import tilt_interval
from ssm_planner.problem.problem import Eye, TaskLimits
from ssm_planner.problem.robot import JOINTS, Robot
from ssm_planner.problem.serialization import plain
from ssm_planner.typing import Array, Range

LINK = 0.11
"""Radius of the drawn links, m. A robot file contains no shapes."""
BAND = 0.075
"""Radius of the tilt band, m."""
STEP = math.radians(5.0)


def scene_of(robot: Robot, limits: TaskLimits) -> dict[str, Any]:
    """Return the scene of a robot with its ranges of task coordinates and the eye."""
    mechanism = Mechanism.from_geometry(robot.geometry)
    scene = mechanism_scene(mechanism, limits.ranges, link_sides(robot, mechanism), limits.eye)
    scene["names"] = [joint.name for joint in robot.joints]
    return scene


def mechanism_scene(
    mechanism: Mechanism,
    ranges: Mapping[str, Range],
    sides: list[int] | None = None,
    eye: Eye | None = None,
) -> dict[str, Any]:
    """Return the scene of a mechanism.

    Parameters
    ----------
    mechanism : Mechanism
    ranges : Mapping[str, Range]
        Allowed ranges of task coordinates.
    sides : list[int], optional
        Side of the RCM on which joints 1 and 2 are, +1 along their axis.
    eye : Eye, optional
    """
    low, high = tilt_interval(mechanism)
    bands = [{"name": "reachable", **band(mechanism, (low, high), (-math.pi, math.pi))}]
    if "tilt" in ranges:
        allowed = max(ranges["tilt"][0], low), min(ranges["tilt"][1], high)
        if allowed[0] < allowed[1]:
            roll = ranges.get("roll", (-math.pi, math.pi))
            bands.append({"name": "allowed", **band(mechanism, allowed, roll)})
    return {
        "axes": [mechanism.omega1.tolist(), mechanism.omega2.tolist(), mechanism.omega3.tolist()],
        "sides": [-1, -1] if sides is None else sides,
        "names": list(JOINTS),
        "link": LINK,
        "insertion_sign": mechanism.insertion_sign,
        "bands": bands,
        "eye": None if eye is None else plain(eye),
    }


def band(mechanism: Mechanism, tilt: Range, roll: Range) -> dict[str, Any]:
    """Return the vertices of the part of a sphere about the RCM that the tool axis reaches.

    The vertices form rows of equal tilt.
    """
    roll = max(roll[0], -math.pi), min(roll[1], math.pi)
    rows, columns = (max(2, math.ceil((ends[1] - ends[0]) / STEP) + 1) for ends in (tilt, roll))
    tilts, rolls = np.linspace(*tilt, rows), np.linspace(*roll, columns)
    task = np.zeros((rows * columns, 4))
    task[:, 0], task[:, 1] = np.tile(rolls, rows), np.repeat(tilts, columns)
    axes: Array = pose_from_task(mechanism, task)[0][:, :, 2]
    return {"rows": rows, "columns": columns, "vertices": np.round(BAND * axes, 6).ravel().tolist()}


def link_sides(robot: Robot, mechanism: Mechanism) -> list[int]:
    """Return the sides of the RCM on which links 1 and 2 have their mass.

    A side is +1 or −1 along the joint axis.
    """
    axes = mechanism.omega1, mechanism.omega2
    return [
        1 if float(axis @ (body.frame @ body.com)) > 0 else -1
        for axis, body in zip(axes, robot.bodies, strict=False)
    ]
