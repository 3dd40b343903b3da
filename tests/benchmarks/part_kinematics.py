"""Compare closed-form inverse kinematics of batches of poses with Pinocchio's iteration."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ssm_planner.kinematics.forward import forward
from ssm_planner.kinematics.mechanism import Mechanism
from tests.benchmarks.bench_kinematics import RATIO, iterative_inverse
from tests.benchmarks.measuring import Spread, in_turns
from tests.benchmarks.section import Section
from tests.support.pose_inverse import inverse

BATCH, ITERATIVE = 100_000, 300


def run(quick: bool) -> Section:
    section = Section("Inverse kinematics")
    mechanism = Mechanism.from_angles(
        math.radians(30.0), math.radians(109.778), math.radians(-113.0)
    )
    rng = np.random.default_rng(1)
    near = rng.uniform(-1.0, 1.0, (ITERATIVE, 4)) * [1.0, 0.7, 1.0, 0.01]
    wide = rng.uniform(-math.pi, math.pi, (BATCH, 4)) * [1.0, 1.0, 1.0, 0.01]
    rotations, positions = forward(mechanism, wide)
    inverse(mechanism, rotations, positions)
    ways: dict[str, Any] = {
        "batch": lambda _: inverse(mechanism, rotations, positions),
        "one": lambda _: [
            inverse(mechanism, rotations[k : k + 1], positions[k : k + 1]) for k in range(ITERATIVE)
        ],
        "iteration": lambda _: iterative_inverse(mechanism, near),
    }
    times, results = in_turns(ways, 3 if quick else 7)
    batch = Spread.of([value / BATCH for value in times["batch"].values])
    one = Spread.of([value / ITERATIVE for value in times["one"].values])
    iteration = Spread.of([seconds for seconds, _ in results["iteration"]])
    converged = min(part for _, part in results["iteration"])
    section.say(
        "Per pose, one process. The closed form returns all branches to machine precision; Pinocchio's damped Gauss–Newton "
        "iteration on SE(3) (functions of Pinocchio, loop in Python) returns one, to 1e-10, from a start 0.3 rad away."
    )
    ratio = iteration.over(batch)
    section.table(
        ("", "time per pose", "÷ batch", "solved"),
        [
            [f"this planner, batch of {BATCH}", batch.seconds(), "", "100 %, all branches"],
            [
                "this planner, one pose per call",
                one.seconds(),
                one.over(batch).times(),
                "100 %, all branches",
            ],
            [
                "Pinocchio's iteration",
                iteration.seconds(),
                ratio.times(),
                f"{100 * converged:.0f} %, one branch",
            ],
        ],
    )
    section.faster(
        "Pinocchio's iteration", "inverse kinematics, one pose per call", iteration.over(one)
    )
    section.asked(
        "inverse kinematics against Pinocchio's iteration",
        f"≥ {RATIO:g} ×",
        ratio.times(),
        ratio.median >= RATIO,
    )
    return section
