"""Planning time and duration of plans that hold for a range of friction and payload, beside the nominal plan.

    python tests/benchmarks/bench_robust.py

Processor time of the whole of `plan` (plan, check, and for a range the nominal plan for comparison), the best of some runs
after a first one. Prints one table; exits with 1 where a ratio is above MOST.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "planning"))

from test_range import PAYLOAD, weakened

from ssm_planner.pipeline.run import plan
from ssm_planner.plans import Plan

CASES = (("tilt_insert", "ranges", 1.12), ("tilt_insert", "covariance", 1.03), ("waypoints", "ranges", 1.15))
MOST = 2.5
"""Times the nominal plan's processor time."""
RUNS = 3


def best(function: Callable[[], Plan]) -> tuple[float, Plan]:
    """Shortest processor time of some runs after a first one, s, and the plan."""
    made, times = function(), []
    for _ in range(RUNS):
        start = time.process_time()
        made = function()
        times.append(time.process_time() - start)
    return min(times), made


def main() -> int:
    worst = 0.0
    print(f"{'':32}{'time':>9}{'ratio':>8}{'duration':>11}")
    for name, kind, factor in CASES:
        problem = weakened(name, kind, factor)
        nominal, made = best(lambda p=problem: plan(p, relaxations=False))
        print(f"{f'{name}, {kind}':32}{nominal:7.3f} s{1.0:8.2f}{made.duration:9.4f} s")
        for label, payload in (("friction 95 %", None), ("friction 95 %, payload", PAYLOAD)):
            ranged = replace(problem, friction=0.95, payload=payload)
            taken, made = best(lambda p=ranged: plan(p, relaxations=False))
            assert made.passed, made.reason
            worst = max(worst, taken / nominal)
            print(f"{f'  {label}':32}{taken:7.3f} s{taken / nominal:8.2f}{made.duration:9.4f} s")
    return int(worst > MOST)


if __name__ == "__main__":
    sys.exit(main())
