"""The limits of a robot as the optimisation takes them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ssm_planner.problem.values import Array, Robot

UNLIMITED = 1e9


def limit_table(robot: Robot) -> Array:
    """Velocity, acceleration, jerk and motor-torque limits (rows) of the joints (columns), (4, 4)."""
    table = np.full((4, 4), UNLIMITED)
    for i, joint in enumerate(robot.joints):
        table[0, i], table[1, i] = joint.velocity, joint.acceleration
        if joint.jerk is not None:
            table[2, i] = joint.jerk
        if joint.drive is not None and joint.motor is not None:
            table[0, i] = min(joint.velocity, joint.motor.max_speed / joint.drive.ratio)
            table[3, i] = joint.motor.max_torque
    return table


def tightened(robot: Robot, factors: Array | None) -> Robot:
    """The robot with factors (4, 4) on velocity, acceleration, jerk and motor-torque limits (rows) of its joints."""
    if factors is None:
        return robot
    joints = []
    for joint, (velocity, acceleration, jerk, torque) in zip(robot.joints, factors.T, strict=True):
        motor = joint.motor
        joints.append(
            replace(
                joint,
                velocity=joint.velocity * velocity,
                acceleration=joint.acceleration * acceleration,
                jerk=None if joint.jerk is None else joint.jerk * jerk,
                motor=None if motor is None else replace(motor, max_torque=motor.max_torque * torque),
            )
        )
    first, second, third, fourth = joints
    return replace(robot, joints=(first, second, third, fourth))


def limits_jerk(robot: Robot) -> bool:
    return any(joint.jerk is not None for joint in robot.joints)
