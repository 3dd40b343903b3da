"""The same path and limits given to toppra and copp-py, friction as their interfaces take it.

Both take inverse dynamics that are linear in (q̈, q̇²) and, for dry friction, one constant torque per joint against the
motion. Here the constant of each motor is its bearing torque plus the mesh friction under a weight that it carries on the
path; the rest of the mesh is its lead, without friction. Viscous friction has no place in either.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ssm_planner.dynamics.friction import required_friction
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.transmission import mesh_coefficients
from ssm_planner.planning.retiming.paths import StraightPath
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory, quintic_coefficients
from ssm_planner.typing import Array
from tests.support.pinocchio_model import build

POINTS = 1000
UNLIMITED = 1.0
"""Torque limit, N·m, of a joint whose inverse dynamics are left at zero because it has no motor."""


@dataclass(frozen=True, eq=False)
class UserModel:
    """What a user of a path parametrisation has: limits (4,), motor-side inverse dynamics, and a dry friction torque."""

    velocity: Array
    acceleration: Array
    jerk: Array | None
    torque: Array
    friction: Array
    slope: Array
    inertia: Array
    output_inertia: Array
    pinocchio: Any
    data: Any

    @classmethod
    def of(cls, robot: Robot, path: StraightPath, largest: bool = False) -> UserModel:
        """Friction under the mean weight along the path, or under the largest."""
        import pinocchio

        weight = RigidBody.from_robot(robot).gravity_load(path.sample(np.linspace(0, 1, 101)).q)
        velocity = np.array([joint.velocity for joint in robot.joints])
        torque, friction = np.full(4, UNLIMITED), np.zeros(4)
        slope, inertia, output_inertia = np.zeros(4), np.zeros(4), np.zeros(4)
        for i, joint in enumerate(robot.joints):
            drive = joint.drive
            if drive is None or joint.motor is None:
                continue
            law = required_friction(drive)
            up, down = mesh_coefficients(drive, law.mu)
            velocity[i] = min(velocity[i], joint.motor.max_speed / drive.ratio)
            torque[i] = joint.motor.max_torque
            carried = np.abs(weight[:, i])
            friction[i] = law.b_c + (up - down) / 2 * float(
                carried.max() if largest else carried.mean()
            )
            slope[i] = drive.gamma * np.tan(drive.lead_angle)
            inertia[i] = drive.input_inertia * drive.ratio
            output_inertia[i] = drive.output_inertia
        jerk = (
            None
            if robot.joints[0].jerk is None
            else np.array([joint.jerk for joint in robot.joints], dtype=float)
        )
        model = build(robot)
        acceleration = np.array([joint.acceleration for joint in robot.joints])
        limits = (velocity, acceleration, jerk, torque)
        return cls(
            *limits,
            friction,
            slope,
            inertia,
            output_inertia,
            pinocchio.rnea,
            (model, model.createData()),
        )

    def motor_torque(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Torque of a mesh without friction, (4,)."""
        effort = self.pinocchio(*self.data, q, qd, qdd) + self.output_inertia * qdd
        return np.asarray(self.slope * effort + self.inertia * qdd)


def toppra_speeds(path: StraightPath, user: UserModel, points: int = POINTS) -> tuple[Array, Array]:
    """Grid s and ṡ by TOPP-RA with its own constraints, interpolation scheme; RuntimeError where it finds no motion."""
    import toppra
    from toppra import constraint
    from toppra.interpolator import AbstractGeometricPath

    toppra.setup_logging("CRITICAL")

    class Line(AbstractGeometricPath):  # type: ignore[misc]
        dof = 4
        path_interval = np.array([0.0, 1.0])
        waypoints = None

        def __call__(self, s: Array, order: int = 0) -> Array:
            at = path.sample(np.atleast_1d(s))
            values = (at.q, at.dq, at.ddq)[order]
            return values if np.ndim(s) else values[0]

    def both(limit: Array) -> Array:
        return np.stack([-limit, limit], axis=1)

    scheme = constraint.DiscretizationType.Interpolation
    rows = [
        constraint.JointVelocityConstraint(both(user.velocity)),
        constraint.JointAccelerationConstraint(
            both(user.acceleration), discretization_scheme=scheme
        ),
        constraint.JointTorqueConstraint(
            user.motor_torque, both(user.torque), user.friction, scheme
        ),
    ]
    grid = np.linspace(0, 1, points + 1)
    algorithm = toppra.algorithm.TOPPRA(rows, Line(), grid, solver_wrapper="seidel")
    _, speed, _, _ = algorithm.compute_parameterization(0.0, 0.0, return_data=True)
    if speed is None or not np.all(np.isfinite(speed)):
        raise RuntimeError("TOPP-RA finds no motion")
    return grid, np.asarray(speed, dtype=float)


def copp_robot(
    path: StraightPath, user: UserModel, points: int = POINTS
) -> tuple[Any, Array, Array]:
    """copp-py's robot with path and limits on a grid; and ±(limits) on torque less friction along the motion."""
    import copp_py as copp

    grid = np.linspace(0, 1, points + 1)
    at = path.sample(grid)
    robot = copp.Robot(4, capacity=len(grid), inverse_dynamics=user.motor_torque)
    robot.append_s(grid)
    h = 1e-5
    third = (path.sample(grid + h).ddq - path.sample(grid - h).ddq) / (2 * h)
    robot.set_q(*(np.ascontiguousarray(value) for value in (at.q, at.dq, at.ddq)), 0, dddq=third)
    whole = {"start_idx_s": 0, "length": len(grid)}
    robot.add_velocity_limits(user.velocity, -user.velocity, **whole)
    robot.add_acceleration_limits(user.acceleration, -user.acceleration, **whole)
    shift = user.friction * np.sign(at.dq)
    robot.add_torque_limits(user.torque - shift, -user.torque - shift, **whole)
    if user.jerk is not None:
        robot.add_jerk_limits(user.jerk, -user.jerk, **whole)
    return robot, grid, at.q


def copp_speeds(path: StraightPath, user: UserModel) -> tuple[Array, Array]:
    """Grid s and ṡ by copp-py's reachability analysis."""
    import copp_py as copp

    robot, grid, _ = copp_robot(path, user)
    problem = copp.solver.topp2_ra.Problem(
        robot.constraints, idx_s_interval=(0, len(grid) - 1), a_boundary=(0.0, 0.0)
    )
    return grid, np.sqrt(
        np.asarray(copp.solver.topp2_ra.solve(problem, copp.solver.topp2_ra.Options()))
    )


def copp_jerk_limited(path: StraightPath, user: UserModel, rounds: int = 2) -> Trajectory:
    """copp-py's third-order cone program, linearised about its reachability analysis, then about its own answer."""
    import copp_py as copp

    robot, grid, _ = copp_robot(path, user)
    problem = copp.solver.topp2_ra.Problem(
        robot.constraints, idx_s_interval=(0, len(grid) - 1), a_boundary=(0.0, 0.0)
    )
    speeds = np.asarray(copp.solver.topp2_ra.solve(problem, copp.solver.topp2_ra.Options()))
    robot.constraints.amax_substitute(speeds, 0)
    around: dict[str, Any] = {"a_linearization": speeds}
    for _ in range(rounds):
        third = copp.solver.topp3_socp.Problem(robot.constraints, **around, num_stationary_max=1)
        profile = copp.solver.topp3_socp.solve(third)
        around = {"a_linearization": profile.a, "b_linearization": profile.b}
    _, times = copp.interpolation.s_to_t_topp3(grid, profile)
    at, speed = path.sample(grid), np.sqrt(np.maximum(profile.a, 0.0))[:, None]
    states = at.q, at.dq * speed, at.ddq * speed**2 + at.dq * np.asarray(profile.b)[:, None]
    times = np.asarray(times) - times[0]
    starts, ends = tuple(x[:-1] for x in states), tuple(x[1:] for x in states)
    return Trajectory(times, quintic_coefficients(np.diff(times), starts, ends), ())


def elements_of(s: Array, speed: Array) -> Array:
    """Elements of constant s̈ between grid points, as `motions.along_path` takes them."""
    length = 2 * np.diff(s) / (speed[1:] + speed[:-1])
    acceleration = np.diff(speed**2) / (2 * np.diff(s))
    return np.column_stack([s[:-1], speed[:-1], acceleration, acceleration, length])
