"""Move the tip along a straight line by the inverse of the Jacobian, as velocity controllers do."""

import numpy as np

from ssm_planner import fk, ik, jacobian, load_robot

robot = load_robot("vitreoretinal")
q = ik(robot, tilt=np.radians(-110), depth=0.015).joints[0]
start, velocity, step = fk(robot, q).position, np.array([1e-3, 0.0, 0.0]), 1e-3
for _ in range(1000):
    J = jacobian(robot, q)[:3, [0, 1, 3]]  # the spin does not move the tip
    q[[0, 1, 3]] += step * np.linalg.solve(J, velocity)
error = fk(robot, q).position - (start + velocity)
print(f"departure from the line after 1 mm: {1e6 * np.linalg.norm(error):.2f} µm")
