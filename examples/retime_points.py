"""Give an array of joint positions the fastest timing that keeps every limit."""

import numpy as np

from ssm_planner import retime

s = np.linspace(0, 1, 30)
path = np.column_stack([0.3 * s, 0.5 + 0.3 * np.sin(np.pi * s), 0 * s, -0.01 * s])
plan = retime(path, "vitreoretinal")
print(f"passed: {plan.passed}, duration {plan.duration:.3f} s")
samples = plan.trajectory.sample(np.arange(0, plan.duration, 0.5))
print("tilt joint every 0.5 s:", samples.q[:, 1].round(3).tolist())
