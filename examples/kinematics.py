"""Compute forward and inverse kinematics of many points at once."""

import numpy as np

from ssm_planner import fk, ik, jacobian, load_robot

robot = load_robot("vitreoretinal")
tilt = np.radians(np.linspace(-130, -85, 10))
solutions = ik(robot, tilt=tilt, depth=0.01)
joints = solutions.joints[:, 0]  # the solution that is nearest to home
print("largest error of FK∘IK:", np.abs(fk(robot, joints).task[:, 1] - tilt).max().round(12))
manipulability = np.linalg.svd(jacobian(robot, joints)[:, 3:, :3])[1][:, -1]
print("best conditioned tilt:", np.degrees(tilt[manipulability.argmax()]).round(1), "degrees")
