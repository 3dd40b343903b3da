"""Compare plans for a range of friction and payload with the nominal plan.

    python -m tests.benchmarks.bench_robust [PROBLEM …]

The figures are CPU time and duration. The CPU time is that of all of `plan`: the plan, its check,
and for a range also the nominal plan. It is the median of some runs, taken in turns after a first
run that builds the programs. No solutions are kept. The program prints one table. The exit status
is 1 if a ratio exceeds MOST.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from statistics import median

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from ssm_planner.pipeline.run import plan
from ssm_planner.plans import Plan
from ssm_planner.problem.problem import Problem
from tests.planning.test_corners import PAYLOAD, stated, weakened

CASES = (
    ("tilt_insert", "ranges", None),
    ("tilt_insert", "ranges", 1.12),
    ("tilt_insert", "covariance", 1.03),
    ("waypoints", "ranges", None),
    ("waypoints", "ranges", 1.15),
    ("waypoints", "covariance", 1.06),
    ("eye_approach", "ranges", None),
    ("eye_approach", "ranges", 1.15),
    ("laser_scan", "ranges", None),
    ("laser_scan", "ranges", 1.15),
)
"""Problem, description of its friction, and largest motor torque relative to the nominal motion.

None keeps the motors as shipped.
"""
MOST = 2.5
"""Largest CPU time relative to that of the nominal plan."""
RUNS = 3


def medians(problems: Mapping[str, Problem]) -> dict[str, tuple[float, Plan]]:
    """Return the median CPU time in s after a first run, and the plan, by label."""
    times: dict[str, list[float]] = {label: [] for label in problems}
    result = {}
    for _ in range(RUNS + 1):
        for label, problem in problems.items():
            start = time.process_time()
            result[label] = plan(problem, relaxations=False)
            times[label].append(time.process_time() - start)
            assert result[label].passed, result[label].reason
    return {label: (median(taken[1:]), result[label]) for label, taken in times.items()}


def main() -> int:
    worst = 0.0
    print(f"{'':46}{'time':>9}{'ratio':>8}{'duration':>11}")
    for name, kind, factor in CASES:
        if sys.argv[1:] and name not in sys.argv[1:]:
            continue
        problem = stated(name, kind) if factor is None else weakened(name, kind, factor)
        label = (
            f"{name}, {kind}, motors as shipped"
            if factor is None
            else f"{name}, {kind}, motors × {factor}"
        )
        result = medians(
            {
                label: replace(problem, friction=None, payload=None),
                "  friction 95 %": replace(problem, friction=0.95, payload=None),
                "  friction 95 %, payload": replace(problem, friction=0.95, payload=PAYLOAD),
            }
        )
        nominal, _ = result[label]
        for case, (taken, planned) in result.items():
            worst = max(worst, taken / nominal)
            print(
                f"{case:46}{taken:7.3f} s{taken / nominal:8.2f}{planned.duration:9.4f} s",
                flush=True,
            )
    return int(worst > MOST)


if __name__ == "__main__":
    sys.exit(main())
