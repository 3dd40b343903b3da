"""Check, simulate and export a motion that another program computed as arrays."""

import tempfile

import numpy as np

from ssm_planner import Trajectory, check, export, load_robot, simulate

robot = load_robot("vitreoretinal")
t = np.linspace(0, 2, 401)
s = 10 * (t / 2) ** 3 - 15 * (t / 2) ** 4 + 6 * (t / 2) ** 5  # from rest to rest
q = np.array([0.0, 0.5, 0.0, 0.0]) + s[:, None] * np.array([0.1, 0.2, 0.0, -0.005])
motion = Trajectory.from_samples(t, q)
certificate = check(motion, robot)
print("passed:", certificate.passed, "closest limit:", certificate.worst.name)
played = simulate(motion, robot=robot)
worst = max(1e3 * tracking.worst for tracking in played.tracking[:2])
print(f"the simulated joints follow within {worst:.3f} mrad")
with tempfile.TemporaryDirectory() as folder:
    files, manifest = export(motion, "csv", folder + "/csv", robot=robot)
    print("files:", sorted(files))
