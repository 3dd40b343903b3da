"""Kinematics as CasADi expressions: the same closed forms that the NumPy functions evaluate."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ssm_planner.codegen.namespace import casadi_namespace
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.rotations import exponential_terms
from ssm_planner.kinematics.task import joints_of_task, task_of_joints, task_rates_of_joints

if TYPE_CHECKING:
    import casadi


def forward_symbolic(mechanism: Mechanism, q: casadi.SX) -> tuple[casadi.SX, casadi.SX]:
    """(R (3, 3), p (3, 1)) of joints q (4, 1) (paper, eq. 2)."""
    axes = (mechanism.omega1, mechanism.omega2, mechanism.omega3)
    one, two, three = (_rotation(axis, q[i]) for i, axis in enumerate(axes))
    elbow = one @ two
    return elbow @ three @ _constant(mechanism.tool_home), elbow @ _constant(mechanism.omega3) * q[3]


def tip_position_symbolic(mechanism: Mechanism, q: casadi.SX) -> casadi.SX:
    """p (3, 1) of joints q (4, 1)."""
    return forward_symbolic(mechanism, q)[1]


def space_jacobian_symbolic(mechanism: Mechanism, q: casadi.SX) -> casadi.SX:
    """Columns ξ'_i as (v, omega), (6, 4), of joints q (4, 1)."""
    import casadi

    one = _rotation(mechanism.omega1, q[0])
    tool = one @ _rotation(mechanism.omega2, q[1]) @ _constant(mechanism.omega3)
    none = casadi.SX.zeros(3)
    angular = (_constant(mechanism.omega1), one @ _constant(mechanism.omega2), tool)
    return casadi.horzcat(*(casadi.vertcat(none, axis) for axis in angular), casadi.vertcat(tool, none))


def body_jacobian_symbolic(mechanism: Mechanism, q: casadi.SX) -> casadi.SX:
    """Columns Ad(g⁻¹) ξ'_i as (v, omega), (6, 4), of joints q (4, 1)."""
    import casadi

    rotation, position = forward_symbolic(mechanism, q)
    space = space_jacobian_symbolic(mechanism, q)
    linear = space[:3, :] - casadi.skew(position) @ space[3:, :]
    return casadi.vertcat(rotation.T @ linear, rotation.T @ space[3:, :])


def pose_from_task_symbolic(mechanism: Mechanism, task: casadi.SX) -> tuple[casadi.SX, casadi.SX]:
    """(R (3, 3), p (3, 1)) of (roll, tilt, spin, depth) (4, 1), any sign of tilt; formula at task.pose_from_task."""
    pointing = _rotation(mechanism.omega1, task[0]) @ _rotation(mechanism.tilt_axis, task[1])
    rotation = pointing @ _constant(mechanism.tool_on_omega1) @ _rotation((0.0, 0.0, 1.0), task[2])
    return rotation, pointing @ _constant(mechanism.omega1) * (mechanism.insertion_sign * task[3])


def joints_from_task_symbolic(
    mechanism: Mechanism, task: casadi.SX, branch: int, reference: Any | None = None
) -> casadi.SX:
    """Joints (4, 1) of (roll, tilt, spin, depth) on a branch: +1 or −1, the sign of sin(θ2 − δ).

    δ (`mechanism.delta`) is the θ2 at which cos φ is largest. The result is continuous along any path inside the
    workspace with roll and spin as given, not wrapped, so no unwrapping is needed; with `reference` (4, 1) each
    revolute joint is moved by whole turns to the equivalent nearest to it. Outside the workspace the value is NaN; at
    its boundary the derivative is infinite, as the mechanism's is.
    """
    import casadi

    parts = (task[0], task[1], task[2], task[3])
    joints = list(joints_of_task(casadi_namespace(), mechanism, parts, branch))
    if reference is not None:
        for i in range(3):
            turns = casadi.floor((reference[i] - joints[i]) / (2.0 * math.pi) + 0.5)
            joints[i] = joints[i] + 2.0 * math.pi * turns
    return casadi.vertcat(*joints)


def task_from_joints_symbolic(mechanism: Mechanism, q: casadi.SX) -> casadi.SX:
    """(roll, tilt, spin, depth) (4, 1) of joints (4, 1), tilt on the home side; roll and spin are not wrapped."""
    import casadi

    return casadi.vertcat(*task_of_joints(casadi_namespace(), mechanism, (q[0], q[1], q[2], q[3])))


def task_rates_symbolic(mechanism: Mechanism, q: casadi.SX, qd: casadi.SX) -> casadi.SX:
    """Rates of (roll, tilt, spin, depth) (4, 1) of joints and joint rates (4, 1), rad/s and m/s; any branch."""
    import casadi

    parts = (q[0], q[1], q[2], q[3]), (qd[0], qd[1], qd[2], qd[3])
    return casadi.vertcat(*task_rates_of_joints(casadi_namespace(), mechanism, *parts))


def _rotation(axis: Any, angle: Any) -> Any:
    import casadi

    terms = [_constant(term) for term in exponential_terms(axis)]
    return terms[0] + casadi.cos(angle) * terms[1] + casadi.sin(angle) * terms[2]


def _constant(value: Any) -> Any:
    """A CasADi constant without the zeros, and without the rounding that stands for zeros."""
    import casadi

    matrix = np.array(value, dtype=float)
    matrix[np.abs(matrix) < 1e-15] = 0.0
    return casadi.sparsify(casadi.DM(matrix))
