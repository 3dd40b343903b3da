"""Find the arm angles α and β that reach a range of tilts."""

import numpy as np

from ssm_planner import design_region, load_robot, workspace

reached = np.degrees(workspace(load_robot("vitreoretinal")).tilt_range)
print("the shipped robot reaches", reached.round(1).tolist(), "degrees")
region = design_region(np.radians(30), np.radians(120))
alpha, beta = np.degrees(region.smallest_alpha)
print(f"30 to 120 degrees need at least α = {alpha:.1f}, then β = {beta:.1f} degrees")
