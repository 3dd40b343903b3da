"""Independent reference model of the mechanism in Pinocchio, built from the bodies of a robot."""

from __future__ import annotations

import numpy as np

from ssm_planner.problem.robot import Robot


def build(robot: Robot):
    """Return a Pinocchio model with the same base frame, joints and bodies."""
    import pinocchio as pin

    model = pin.Model()
    model.gravity.linear = np.array(robot.gravity)
    placed, parent = np.eye(3), 0
    for i, body in enumerate(robot.bodies):
        placement = pin.SE3(placed.T @ body.frame, np.zeros(3))
        joint = pin.JointModelRZ() if i < 3 else pin.JointModelPZ()
        parent = model.addJoint(parent, joint, placement, f"joint{i + 1}")
        placed = body.frame
        com, mass = np.array(body.com), body.mass
        about_com = body.inertia - mass * (com @ com * np.eye(3) - np.outer(com, com))
        model.appendBodyToJoint(parent, pin.Inertia(mass, com, about_com), pin.SE3.Identity())
    return model
