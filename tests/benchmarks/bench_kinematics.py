"""Compare batch kinematics on one core with Pinocchio's iterative inverse kinematics.

    python -m tests.benchmarks.bench_kinematics

The program prints one table. The exit status is 1 if a figure misses its target.
"""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Callable

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from ssm_planner.kinematics.forward import forward, space_jacobian
from ssm_planner.kinematics.inverse import inverse_task
from ssm_planner.kinematics.mechanism import Mechanism
from tests.support.pose_inverse import inverse

BATCH = 300_000
ITERATIVE = 300
INVERSE, FORWARD, RATIO = 3e6, 2e6, 50.0


def best(function: Callable[[], object], repeats: int = 7) -> float:
    """Return the shortest time in s of some runs."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def iterative_inverse(mechanism: Mechanism, joints: np.ndarray) -> tuple[float, float]:
    """Return the time in s per pose with Pinocchio, and the fraction of the poses that converge.

    The method (CLIK) makes damped Gauss–Newton steps on SE(3). Each pose is reached to 1e-10 from a
    start up to 0.3 rad and a few mm away. A loop in Python calls Pinocchio's functions, as a
    planner in Python would.
    """
    import pinocchio as pin

    model = pin.Model()
    joint = 0
    for i, axis in enumerate((mechanism.omega1, mechanism.omega2, mechanism.omega3)):
        joint = model.addJoint(
            joint, pin.JointModelRevoluteUnaligned(axis), pin.SE3.Identity(), f"revolute{i}"
        )
    joint = model.addJoint(
        joint, pin.JointModelPrismaticUnaligned(mechanism.omega3), pin.SE3.Identity(), "slide"
    )
    placement = pin.SE3(np.array(mechanism.tool_home), np.zeros(3))
    frame = model.addFrame(pin.Frame("tool", joint, placement, pin.FrameType.OP_FRAME))
    data = model.createData()
    rotations, positions = forward(mechanism, joints)
    targets = [pin.SE3(r, p) for r, p in zip(rotations, positions, strict=True)]
    starts = joints + np.random.default_rng(2).uniform(-1.0, 1.0, joints.shape) * [
        0.3,
        0.3,
        0.3,
        0.005,
    ]
    damping = 1e-12 * np.eye(4)
    solved = 0
    begin = time.perf_counter()
    for target, start in zip(targets, starts, strict=True):
        q = start.copy()
        for _ in range(50):
            pin.framesForwardKinematics(model, data, q)
            error = pin.log6(data.oMf[frame].actInv(target)).vector
            if error @ error < 1e-20:
                solved += 1
                break
            jacobian = pin.computeFrameJacobian(model, data, q, frame, pin.ReferenceFrame.LOCAL)
            q = q + np.linalg.solve(jacobian.T @ jacobian + damping, jacobian.T @ error)
    return (time.perf_counter() - begin) / len(targets), solved / len(targets)


def main() -> int:
    mechanism = Mechanism.from_angles(
        math.radians(30.0), math.radians(109.778), math.radians(-113.0)
    )
    rng = np.random.default_rng(1)
    q = rng.uniform(-math.pi, math.pi, (BATCH, 4)) * [1.0, 1.0, 1.0, 0.01]
    rotations, positions = forward(mechanism, q)
    task = np.column_stack((q[:, 0], rng.uniform(-2.43, -1.40, BATCH), q[:, 2], q[:, 3]))
    rates = {
        "inverse kinematics of poses, all branches": BATCH
        / best(lambda: inverse(mechanism, rotations, positions)),
        "inverse kinematics of task coordinates": BATCH
        / best(lambda: inverse_task(mechanism, task)),
        "forward kinematics with Jacobian": BATCH
        / best(lambda: (forward(mechanism, q), space_jacobian(mechanism, q))),
        "forward kinematics": BATCH / best(lambda: forward(mechanism, q)),
    }
    needed = {
        "inverse kinematics of poses, all branches": INVERSE,
        "forward kinematics with Jacobian": FORWARD,
    }
    failed = False
    for name, rate in rates.items():
        least = needed.get(name)
        failed |= least is not None and rate < least
        print(
            f"{name:44s} {rate / 1e6:8.2f} million/s"
            + (f"   (needs {least / 1e6:g})" if least else "")
        )
    near_home = rng.uniform(-1.0, 1.0, (ITERATIVE, 4)) * [1.0, 0.7, 1.0, 0.01]
    seconds, converged = iterative_inverse(mechanism, near_home)
    ratio = seconds * rates["inverse kinematics of poses, all branches"]
    failed |= ratio < RATIO
    print(
        f"{'Pinocchio, iterative, one branch':44s} {1e-6 / seconds:8.4f} million/s, {converged:.0%} converged"
    )
    print(f"{'closed form over iterative':44s} {ratio:8.0f} times       (needs {RATIO:g})")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
