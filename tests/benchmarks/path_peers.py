"""Path parametrisation by toppra and copp-py with the same path and limits as this planner.

Both programs take inverse dynamics that are linear in (q̈, q̇²). For dry friction they take one
constant torque per joint that opposes the motion. This constant is the bearing torque of the motor
plus the mesh friction under a weight that the joint carries on the path. The remaining mesh torque
is that of the lead without friction. Neither program can represent viscous friction.
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
"""Torque limit in N·m of a joint without a motor, whose inverse dynamics are zero."""


@dataclass(frozen=True, eq=False)
class UserModel:
    """The model that a user gives to a path parametrisation.

    It has limits (4,), inverse dynamics on the motor side and dry friction torques.
    """

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
        """Build the model with friction under the mean or the largest weight along the path."""
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
        """Return the torque (4,) of a mesh without friction in N·m."""
        effort = self.pinocchio(*self.data, q, qd, qdd) + self.output_inertia * qdd
        return np.asarray(self.slope * effort + self.inertia * qdd)


def toppra_speeds(path: StraightPath, user: UserModel, points: int = POINTS) -> tuple[Array, Array]:
    """Return the grid s and the speeds ṡ that TOPP-RA finds with its interpolation scheme.

    Raises RuntimeError if TOPP-RA finds no motion.
    """
    import toppra
    from toppra import constraint
    from toppra.interpolator import AbstractGeometricPath

    toppra.setup_logging("CRITICAL")

    class Line(AbstractGeometricPath):  # type: ignore[misc]
        dof = 4
        path_interval = np.array([0.0, 1.0])
        waypoints = None

        def __call__(self, s: Array, order: int = 0) -> Array:
            samples = path.sample(np.atleast_1d(s))
            values = (samples.q, samples.dq, samples.ddq)[order]
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
    """Return copp-py's robot with path and limits, the grid and the joint positions on it.

    The torque limits are ±limit minus the friction along the motion.
    """
    import copp_py as copp

    grid = np.linspace(0, 1, points + 1)
    samples = path.sample(grid)
    robot = copp.Robot(4, capacity=len(grid), inverse_dynamics=user.motor_torque)
    robot.append_s(grid)
    h = 1e-5
    third = (path.sample(grid + h).ddq - path.sample(grid - h).ddq) / (2 * h)
    robot.set_q(
        *(np.ascontiguousarray(value) for value in (samples.q, samples.dq, samples.ddq)),
        0,
        dddq=third,
    )
    extent = {"start_idx_s": 0, "length": len(grid)}
    robot.add_velocity_limits(user.velocity, -user.velocity, **extent)
    robot.add_acceleration_limits(user.acceleration, -user.acceleration, **extent)
    shift = user.friction * np.sign(samples.dq)
    robot.add_torque_limits(user.torque - shift, -user.torque - shift, **extent)
    if user.jerk is not None:
        robot.add_jerk_limits(user.jerk, -user.jerk, **extent)
    return robot, grid, samples.q


def copp_speeds(path: StraightPath, user: UserModel) -> tuple[Array, Array]:
    """Return the grid s and the speeds ṡ that copp-py's reachability analysis finds."""
    import copp_py as copp

    robot, grid, _ = copp_robot(path, user)
    problem = copp.solver.topp2_ra.Problem(
        robot.constraints, idx_s_interval=(0, len(grid) - 1), a_boundary=(0.0, 0.0)
    )
    return grid, np.sqrt(
        np.asarray(copp.solver.topp2_ra.solve(problem, copp.solver.topp2_ra.Options()))
    )


def copp_jerk_limited(path: StraightPath, user: UserModel, rounds: int = 2) -> Trajectory:
    """Return the motion that copp-py's third-order cone program finds under jerk limits.

    The program is linearised about the reachability analysis first, then about its own solution.
    """
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
    samples, speed = path.sample(grid), np.sqrt(np.maximum(profile.a, 0.0))[:, None]
    states = (
        samples.q,
        samples.dq * speed,
        samples.ddq * speed**2 + samples.dq * np.asarray(profile.b)[:, None],
    )
    times = np.asarray(times) - times[0]
    starts, ends = tuple(x[:-1] for x in states), tuple(x[1:] for x in states)
    return Trajectory(times, quintic_coefficients(np.diff(times), starts, ends), ())


def elements_of(s: Array, speed: Array) -> Array:
    """Return elements of constant s̈ between grid points, in the format of `motions.along_path`."""
    length = 2 * np.diff(s) / (speed[1:] + speed[:-1])
    acceleration = np.diff(speed**2) / (2 * np.diff(s))
    return np.column_stack([s[:-1], speed[:-1], acceleration, acceleration, length])
