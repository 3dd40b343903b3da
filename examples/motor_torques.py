"""Compute joint efforts and motor torques along a sine of the tilt joint."""

import numpy as np

from ssm_planner import inverse_dynamics, load_robot, motor_torque

robot = load_robot("vitreoretinal")
t = np.linspace(0, 2, 201)[:, None]
amplitude, w = np.array([0.0, 0.2, 0.0, 0.0]), np.pi
q, qd, qdd = (
    amplitude * np.sin(w * t),
    amplitude * w * np.cos(w * t),
    -amplitude * w**2 * np.sin(w * t),
)
effort = inverse_dynamics(robot, q, qd, qdd)[:, 1]
torque = motor_torque(robot, q, qd, qdd)[:, 1]
drive = robot.joints[1].drive
without_friction = np.abs(effort).max() / drive.ratio
print(f"largest motor torque: {1e3 * np.abs(torque).max():.2f} mN·m")
print(f"the joint effort through the gear without friction: {1e3 * without_friction:.2f} mN·m")
