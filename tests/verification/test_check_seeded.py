"""The check finds a limit that is exceeded by 0.1 % between samples, and reports no other limit.

The program tests/benchmarks/bench_check.py repeats this test a thousand times.
"""

from __future__ import annotations

import numpy as np
import pytest

from ssm_planner.problem.robot import Robot
from ssm_planner.verification.check import check
from tests.support.seeded import EXCESS, KINDS, seeded

COUNT = 12


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_a_limit_broken_between_samples_is_found_and_nothing_else(robot: Robot, kind: str) -> None:
    rng = np.random.default_rng(KINDS.index(kind))
    for _ in range(COUNT):
        case = seeded(rng, robot, kind)
        broken = check(case.trajectory, case.robot_with(1 + EXCESS), case.task(1 + EXCESS))
        assert [(v.name, v.joint) for v in broken.violations] == [case.limit]
        assert broken.violations[0].margin == pytest.approx(-EXCESS, rel=0.05)
        assert case.interval[0] <= broken.violations[0].time <= case.interval[1]
        clean = check(case.trajectory, case.robot_with(1 - EXCESS), case.task(1 - EXCESS))
        assert clean.passed
