"""What of a robot stands as constants in a stage, as a key: two robots with the same key share compiled programs."""

from __future__ import annotations

import pickle

from ssm_planner.problem.values import Robot


def robot_key(robot: Robot) -> bytes:
    """Geometry, bodies, gravity, drives and nominal torques; not the limits, which are parameters.

    Equal keys mean equal content; equal content may have different keys, which only costs time.
    """
    joints = [(joint.drive, None if joint.motor is None else joint.motor.nominal_torque) for joint in robot.joints]
    return pickle.dumps((robot.geometry, robot.bodies, robot.gravity, joints))
