"""Measure speed and accuracy of the sizing on one core.

    python -m tests.benchmarks.bench_sizing [PLAN]

The program prints one table. The exit status is 1 if a figure misses its target.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from ssm_planner.dynamics.spread import friction_spread
from ssm_planner.loading.load import load_motor
from ssm_planner.plans import load_plan
from ssm_planner.sizing.demand import linear_band, monte_carlo
from ssm_planner.sizing.duty import DutyCycle
from ssm_planner.sizing.motor_limits import Conditions
from ssm_planner.sizing.size import size
from ssm_planner.sizing.thermal_network import Cycle, ThermalModel, steady_state, warm_up
from tests.support.paths import ROOT
from tests.support.sizing_cases import COMPLETE, with_covariance

DRAWS = 10_000


def best(function: Callable[[], object], repeats: int = 5) -> float:
    """Return the shortest time in s of some runs."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def repeated(model: ThermalModel, cycle: Cycle) -> tuple[float, float]:
    """Return the peak winding temperature after 25 motor time constants, and the time taken in s.

    The function simulates cycle by cycle. Each cycle is solved exactly in one step, so a simulation
    in many steps would be slower.
    """
    begin, start = time.perf_counter(), (model.ambient, model.ambient)
    for _ in range(int(25 * model.c_housing * model.r_housing_ambient / cycle.period)):
        reached = warm_up(model, cycle, start)
        start = (float(reached.winding[-1]), float(reached.housing[-1]))
    return reached.peak, time.perf_counter() - begin


def main() -> int:
    plan = load_plan(sys.argv[1] if len(sys.argv) > 1 else ROOT / "results/tilt_insert/plan.json")
    duty = DutyCycle.of_trajectory(plan.trajectory, plan.robot)
    loads = [replace(load, drive=with_covariance(load.drive)) for load in duty.loads()]
    rows: list[tuple[str, float, float, str]] = []

    def draw() -> list[object]:
        return [
            monte_carlo(replace(load, motor=COMPLETE), friction_spread(load.drive), DRAWS)
            for load in loads
        ]

    rows.append(
        (
            f"{DRAWS} draws over {plan.trajectory.duration:.2f} s, {len(loads)} joints",
            best(draw, 3),
            2.0,
            "s",
        )
    )
    off = 0.0
    for load in loads:
        spread = friction_spread(load.drive)
        driven = replace(load, motor=COMPLETE)
        linear, drawn = linear_band(driven, spread), monte_carlo(driven, spread, DRAWS)
        for demand in ("peak_torque", "rms_torque", "peak_voltage"):
            off = max(off, abs(linear.high(demand, 0.99) / drawn.high(demand, 0.99) - 1))
    rows.append(("99th percentile, linearised against draws", 100 * off, 3.0, "%"))
    load = loads[0]
    cycle = Cycle.from_torque(load.t, load.torque(), 0.5)
    cycle = cycle.scaled(0.1 / np.sqrt(cycle.mean(cycle.square)))
    model = ThermalModel.from_motor(COMPLETE, 298.15)
    quick, (peak, slow) = best(lambda: steady_state(model, cycle)), repeated(model, cycle)
    rows.append(("steady state found directly", 1e3 * quick, 100.0, "ms"))
    rows.append(
        (
            "steady state against cycle by cycle",
            abs(steady_state(model, cycle).peak - peak),
            0.1,
            "K",
        )
    )
    rows.append(("time of the direct way, share of the other", quick / slow, 0.01, ""))
    motors = [load_motor(path) for path in sorted((ROOT / "problems/motors").glob("*.yaml"))]
    candidates = {load.joint: motors for load in loads}
    judge = best(lambda: size(duty, candidates, Conditions(spread=0.1)), 2)
    rows.append((f"size with {len(motors)} motors on {len(loads)} joints", judge, 5.0, "s"))
    for text, value, limit, unit in rows:
        print(
            f"{text:48} {value:10.4g} {unit:3} (at most {limit:g}) {'' if value <= limit else 'TOO MUCH'}"
        )
    return int(any(value > limit for _, value, limit, _ in rows))


if __name__ == "__main__":
    sys.exit(main())
