"""The limits along a path as rows that are linear in (s̈, ṡ²), friction exact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ssm_planner.dynamics.friction import friction_coefficient, friction_of
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.transmission import motor_torque_rows
from ssm_planner.kinematics.task import task_rates
from ssm_planner.planning.retiming.paths import JointPath, PathSamples
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.problem import TASK, TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.typing import Array

ACTIVE = 0.998
"""A row counts as binding from this share of its limit on."""


@dataclass(frozen=True, eq=False)
class LinearConstraints:
    """a s̈ + b ṡ² + c + k √(ṡ²) ≤ 1, every row scaled by its limit, (n, rows) each; and ṡ² ≤ ceiling, (n,)."""

    a: Array
    b: Array
    c: Array
    k: Array
    ceiling: Array

    def active(self, grid: Array, speed_squared: Array) -> Array:
        """Which row binds on each grid interval, as in `Retiming.active`."""
        acceleration = (np.diff(speed_squared) / (2 * np.diff(grid)))[:, None]
        x = ((speed_squared[1:] + speed_squared[:-1]) / 2)[:, None]

        def middle(values: Array) -> Array:
            return (values[1:] + values[:-1]) / 2

        value = middle(self.a) * acceleration + middle(self.b) * x + middle(self.c) + middle(self.k) * np.sqrt(x)
        value = np.column_stack([value, x[:, 0] / middle(self.ceiling)])
        row = np.argmax(value, axis=1)
        row[row == value.shape[1] - 1] = -1
        return np.where(value.max(axis=1) > ACTIVE, row, -2)


@dataclass(frozen=True, eq=False)
class PathLoad:
    """τ_rigid = inertia s̈ + velocity ṡ² + gravity along a path, (n, 4) each."""

    inertia: Array
    velocity: Array
    gravity: Array

    @classmethod
    def along(cls, body: RigidBody, samples: PathSamples) -> PathLoad:
        return cls(*body.path_load(samples.q, samples.dq, samples.ddq))


def speed_ceiling(path: JointPath, samples: PathSamples, robot: Robot, limits: TaskLimits) -> Array:
    """Largest ṡ² that joint, motor and tip speeds and the rates of task coordinates allow at each sample, (n,)."""
    limit = np.array([joint.velocity for joint in robot.joints])
    for i, joint in enumerate(robot.joints):
        if joint.drive is not None and joint.motor is not None:
            limit[i] = min(limit[i], joint.motor.max_speed / joint.drive.ratio)
    with np.errstate(divide="ignore"):
        speed = (limit / np.abs(samples.dq)).min(axis=1)
        if limits.tip_speed is not None:
            speed = np.minimum(speed, limits.tip_speed / np.linalg.norm(path.tip_slope(samples), axis=1))
        if limits.rates:
            slope = np.abs(task_rates(path.mechanism, samples.q, samples.dq))
            for name, rate in limits.rates.items():
                speed = np.minimum(speed, rate / slope[:, TASK.index(name)])
    return np.asarray(speed**2)


def linear_constraints(
    robot: Robot,
    samples: PathSamples,
    load: PathLoad,
    signs: Array,
    ceiling: Array,
    speed_squared: Array,
    *,
    starts: bool,
) -> LinearConstraints:
    """Acceleration and motor-torque limits as rows, the friction coefficient taken at the speed of the last pass.

    starts: from rest, so that friction at the first sample is static.
    """
    rows = _RowList([], [], [], [])
    zero = np.zeros(len(samples.s))
    for i, joint in enumerate(robot.joints):
        for side in (1.0, -1.0):
            rows.add(side * samples.dq[:, i], side * samples.ddq[:, i], zero, zero, joint.acceleration)
        if joint.drive is not None and joint.motor is not None:
            _add_torque_rows(
                rows, joint.drive, joint.motor.max_torque, i, samples, load, signs[:, i], ceiling, speed_squared, starts
            )
    a, b, c, k = (np.stack(column, axis=1) for column in (rows.a, rows.b, rows.c, rows.k))
    return LinearConstraints(a, b, c, k, ceiling)


@dataclass(frozen=True)
class _RowList:
    a: list[Array]
    b: list[Array]
    c: list[Array]
    k: list[Array]

    def add(self, a: Array, b: Array, c: Array, k: Array, limit: float) -> None:
        for column, value in zip((self.a, self.b, self.c, self.k), (a, b, c, k), strict=True):
            column.append(value / limit)


def _add_torque_rows(
    rows: _RowList,
    drive: Drive,
    limit: float,
    i: int,
    samples: PathSamples,
    load: PathLoad,
    sigma: Array,
    ceiling: Array,
    speed_squared: Array,
    starts: bool,
) -> None:
    """σ τ_motor ≤ limit as two rows, and −σ τ_motor ≤ limit as one on the safe side."""
    friction, r = friction_of(drive), drive.ratio
    dq, ddq = samples.dq[:, i], samples.ddq[:, i]
    moving = np.abs(sigma)
    mu = friction_coefficient(friction, r * np.abs(dq) * np.sqrt(speed_squared))
    mu = np.where((samples.s == 0.0) & starts, np.maximum(mu, friction.mu_static), mu)
    forward, backward = motor_torque_rows(drive, 1, mu), motor_torque_rows(drive, -1, mu)
    effort_a = sigma * (load.inertia[:, i] + drive.output_inertia * dq)
    effort_b = sigma * (load.velocity[:, i] + drive.output_inertia * ddq)
    effort_c = sigma * load.gravity[:, i] + moving * friction.b_oc
    effort = effort_b * speed_squared + effort_c
    inertia = np.where(sigma > 0, forward.inertia, backward.inertia) * sigma * r
    coulomb = np.where(sigma > 0, forward.coulomb, -backward.coulomb) * moving
    slopes = [np.where(sigma > 0, forward.slope[k], backward.slope[k]) for k in (0, 1)]
    for slope in slopes:
        root = (forward.viscous * r + slope * friction.b_ov) * np.abs(dq)
        rows.add(
            inertia * dq + slope * effort_a,
            inertia * ddq + slope * effort_b,
            coulomb + slope * effort_c,
            np.maximum(root, 0.0),
            limit,
        )
    # The torque is the larger of the two, so either one bounds it from below; √x ≥ x/√ceiling there.
    slope = np.where(slopes[0] * effort > slopes[1] * effort, slopes[0], slopes[1])
    chord = np.maximum(forward.viscous * r + slope * friction.b_ov, 0.0) * np.abs(dq) / np.sqrt(ceiling)
    rows.add(
        -(inertia * dq + slope * effort_a),
        -(inertia * ddq + slope * effort_b + chord),
        -(coulomb + slope * effort_c),
        np.zeros_like(dq),
        limit,
    )
