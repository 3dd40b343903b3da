"""The sign of the package's products of inertia: what it does to the bodies and to the motor torques."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ssm_planner.model.rigid_body import RigidBody
from ssm_planner.model.trajectory import Trajectory
from ssm_planner.paper.published import DRIVEN
from ssm_planner.problem.bodies import possible, principal_moments
from ssm_planner.problem.values import Array, Body, Robot, frozen
from ssm_planner.sizing.joint_load import JointLoad, joint_loads


@dataclass(frozen=True, eq=False)
class BodyMoments:
    """Principal moments about the centre of mass, ascending, kg·m², (3,) each."""

    name: str
    as_tensor: Array
    """The published products taken as entries of the tensor, as the toolbox takes them."""
    as_cad: Array
    """Taken with the CAD program's sign, as the robot file does."""

    @property
    def possible(self) -> tuple[bool, bool]:
        """Whether a body can have them."""
        return possible(self.as_tensor), possible(self.as_cad)


def flipped(robot: Robot) -> Robot:
    """The robot with all products of inertia negated: the package's reading of its own figures."""
    first, second, third, fourth = (_flipped(body) for body in robot.bodies)
    return replace(robot, bodies=(first, second, third, fourth))


def body_moments(robot: Robot) -> tuple[BodyMoments, ...]:
    """Of every body with mass."""
    return tuple(
        BodyMoments(
            body.name,
            principal_moments(body.mass, body.com, _flipped(body).inertia),
            principal_moments(body.mass, body.com, body.inertia),
        )
        for body in robot.bodies
        if body.mass > 0
    )


def joint_inertia(robot: Robot) -> Array:
    """Diagonal of the mass matrix at home, (4,), kg·m² and kg."""
    return np.diagonal(RigidBody.from_robot(robot).mass_matrix(np.zeros((1, 4)))[0]).copy()


def torque_change(robot: Robot, trajectory: Trajectory) -> dict[str, float]:
    """Largest change of motor torque at any instant of a motion through the flipped sign, N·m, by driven joint."""
    return largest_change(joint_loads(trajectory, robot), joint_loads(trajectory, flipped(robot)))


def largest_change(before: Sequence[JointLoad], after: Sequence[JointLoad]) -> dict[str, float]:
    """Largest change of motor torque between loads of the same instants, N·m, by joint; 0 for joints without one."""
    change = dict.fromkeys(DRIVEN, 0.0)
    for a, b in zip(before, after, strict=True):
        change[a.joint] = max(change[a.joint], float(np.abs(b.torque() - a.torque()).max()))
    return change


def _flipped(body: Body) -> Body:
    diagonal = np.diag(np.diag(body.inertia))
    return replace(body, inertia=frozen(2 * diagonal - body.inertia, (3, 3)))
