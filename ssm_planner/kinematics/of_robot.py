"""The kinematics of a robot as users ask for them: poses of joints, joints of task coordinates, the workspace."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssm_planner.kinematics.forward import forward
from ssm_planner.kinematics.inverse import inverse_task
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.kinematics.workspace import Extreme, boundary_distance, extremes, tilt_interval
from ssm_planner.problem.robot import Robot
from ssm_planner.typing import Array

SAME = 1e-7
"""Two solutions count as one, as at the workspace boundary, if no joint differs by more (rad, m)."""


@dataclass(frozen=True, eq=False)
class ToolPose:
    """Where the tool is, in the base frame; rad and m, for one configuration or for n."""

    rotation: Array
    """Base ← tool, (3, 3) or (n, 3, 3)."""
    position: Array
    """Of the tip, (3,) or (n, 3)."""
    task: Array
    """Roll, tilt, spin, depth; (4,) or (n, 4)."""


@dataclass(frozen=True, eq=False)
class JointSolutions:
    """All joints of one point in task coordinates, those within the joint ranges first; rad and m."""

    joints: Array
    """(k, 4); those of the nearest point in the workspace where the point itself is outside."""
    in_limits: NDArray[np.bool_]
    """(k,): within the joint ranges."""
    reachable: bool
    """The point is in the workspace."""
    orientation_error: float
    """Angle by which the joints miss the point, rad."""
    tip_error: float
    """Distance by which they miss it, m."""
    boundary_distance: float
    """Tilt between the point and the workspace boundary, rad; negative outside."""

    def to_dict(self) -> dict[str, Any]:
        """The object that `ik --json` prints."""
        return {
            "reachable": self.reachable,
            "branches": self.joints.tolist(),
            "in_limits": self.in_limits.tolist(),
            "error": {"orientation": self.orientation_error, "tip": self.tip_error},
            "boundary_distance": self.boundary_distance,
        }


@dataclass(frozen=True, eq=False)
class Workspace:
    """What a robot's tool can point at; rad."""

    alpha: float
    """Angle between the axes of joints 1 and 2."""
    beta: float
    """Angle between the axis of joint 2 and the tool."""
    tilt_range: tuple[float, float]
    home_roll: float
    """At q = 0."""
    home_tilt: float
    extremes: tuple[Extreme, ...]
    """Configurations of least and largest tilt."""
    side: int
    """Sign of the tilt on the home side."""

    def to_dict(self) -> dict[str, Any]:
        """The object that `workspace --json` prints."""
        return {
            "alpha": self.alpha,
            "beta": self.beta,
            "tilt_range": list(self.tilt_range),
            "home": {"roll": self.home_roll, "tilt": self.home_tilt},
            "extremes": [
                {"theta2": each.theta2, "tilt": self.side * each.tilt, "c1": each.c1, "c2": each.c2}
                for each in self.extremes
            ],
        }


def fk(robot: Robot, q: ArrayLike) -> ToolPose:
    """Forward kinematics: the tool's pose at joints q, (4,) or (n, 4), rad and m. Raises GeometryError."""
    joints = np.asarray(q, dtype=float)
    mechanism = Mechanism.from_geometry(robot.geometry)
    rows = joints[None] if joints.ndim == 1 else joints
    rotation, position = forward(mechanism, rows)
    task = task_from_joints(mechanism, rows)
    return (
        ToolPose(rotation[0], position[0], task[0])
        if joints.ndim == 1
        else ToolPose(rotation, position, task)
    )


def ik(
    robot: Robot,
    roll: float = 0.0,
    tilt: float = 0.0,
    spin: float = 0.0,
    depth: float = 0.0,
    *,
    within_limits: bool = False,
    reference: ArrayLike | None = None,
) -> JointSolutions:
    """Inverse kinematics: every solution for one point in task coordinates, rad and m (paper, §II-C).

    reference (4,): the solutions are ordered by distance to it, revolute joints moved by whole turns to be near it; None:
    home. within_limits: leave out solutions beyond the joint ranges. Raises GeometryError.
    """
    mechanism = Mechanism.from_geometry(robot.geometry)
    limits = np.array([joint.position for joint in robot.joints])
    found = inverse_task(
        mechanism,
        [[roll, tilt, spin, depth]],
        limits=limits,
        reference=np.zeros(4) if reference is None else reference,
    )
    kept: list[int] = []
    for k, joints in enumerate(found.joints[0]):
        allowed = bool(found.in_limits[0, k]) or not within_limits
        if allowed and not any(
            np.abs(joints - found.joints[0, other]).max() <= SAME for other in kept
        ):
            kept.append(k)
    return JointSolutions(
        joints=found.joints[0, kept],
        in_limits=found.in_limits[0, kept],
        reachable=bool(found.reachable[0]),
        orientation_error=float(found.orientation_error[0]),
        tip_error=float(found.tip_error[0]),
        boundary_distance=float(boundary_distance(mechanism, tilt)),
    )


def workspace(robot: Robot) -> Workspace:
    """Tilts that a robot reaches, in closed form (paper, §II-B). `design_region` answers which robots reach given ones."""
    mechanism = Mechanism.from_geometry(robot.geometry)
    return Workspace(
        alpha=mechanism.alpha,
        beta=mechanism.beta,
        tilt_range=tilt_interval(mechanism),
        home_roll=mechanism.home_roll,
        home_tilt=mechanism.home_tilt,
        extremes=tuple(extremes(mechanism)),
        side=int(mechanism.side),
    )
