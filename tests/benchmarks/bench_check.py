"""Measure the speed of the check on a plan and on a million samples, and run all seeded violations.

    python -m tests.benchmarks.bench_check [--quick]

The program prints one table. The exit status is 1 if a figure misses its target.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from ssm_planner.loading.load import load_robot
from ssm_planner.plans import load_plan
from ssm_planner.verification.check import check
from tests.support.paths import ROOT
from tests.support.seeded import EXCESS, KINDS, seeded

ROBOT = ROOT / "problems/robots/vitreoretinal.yaml"
SAMPLES = 1_000_000
HEADER = ",".join(
    ["time_s"]
    + [f"{symbol}{i + 1}_{'m' if i == 3 else 'rad'}{per}" for symbol, per in
       (("q", ""), ("qd", "_per_s"), ("qdd", "_per_s2")) for i in range(4)]
)  # fmt: skip


def plan_time(repeats: int = 7) -> tuple[float, float]:
    """Return the first and the shortest time in s of the check of the shipped plan."""
    plan = load_plan(ROOT / "results/tilt_insert/plan.json")
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        check(plan.trajectory, plan.robot, plan.limits)
        times.append(time.perf_counter() - start)
    return times[0], min(times)


def million(folder: Path, columns: int) -> tuple[float, float]:
    """Return time in s and memory in MB of `check` on a CSV of a million rows at 1 kHz.

    The columns are q (4 columns), q and qd (8), or q, qd and qdd (12).
    """
    rng = np.random.default_rng(1)
    t = np.arange(SAMPLES) * 1e-3
    rate, phase = rng.uniform(0.3, 0.8, (3, 4)), rng.uniform(0, 6, (3, 4))
    size = np.array([0.6, 0.5, 0.8, 0.012]) / 3
    q, qd, qdd = (np.zeros((SAMPLES, 4)) for _ in range(3))
    for w, p in zip(rate, phase, strict=True):
        angle = t[:, None] * w + p
        q += size * np.sin(angle)
        qd += size * w * np.cos(angle)
        qdd -= size * w**2 * np.sin(angle)
    q += [0.0, 0.3, 0.0, -0.015]
    path = folder / f"million_{columns}.csv"
    rows = np.column_stack([t, q, qd, qdd])[:, : columns + 1]
    header = ",".join(HEADER.split(",")[: columns + 1])
    np.savetxt(path, rows, fmt="%.12g", delimiter=",", header=header, comments="")
    code = (
        "import argparse, resource, sys, time; begin = time.perf_counter()\n"
        "from ssm_planner.cli import check, shared; parser = argparse.ArgumentParser()\n"
        "shared.add_arguments(parser, 'check')\n"
        "status = check.run_check(parser.parse_args(sys.argv[1:]))\n"
        "print('took', time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)\n"
        "sys.exit(status)"
    )
    command = [
        sys.executable,
        "-c",
        code,
        str(path),
        "--robot",
        str(ROBOT),
        "--tip-speed",
        "25 mm/s",
    ]
    result = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    took = [line for line in result.stdout.splitlines() if line.startswith("took")]
    if result.returncode not in (0, 1) or not took:
        raise SystemExit(result.stdout + result.stderr)
    seconds, megabytes = took[0].split()[1:]
    path.unlink()
    return float(seconds), float(megabytes)


def violations(count: int) -> tuple[int, int, int]:
    """Return the numbers of trajectories, of missed or misnamed violations, and of false ones."""
    robot = load_robot(ROBOT)
    missed = invented = total = 0
    for kind in KINDS:
        rng = np.random.default_rng([2024, KINDS.index(kind)])
        for _ in range(count // len(KINDS)):
            case = seeded(rng, robot, kind)
            broken = check(case.trajectory, case.robot_with(1 + EXCESS), case.task(1 + EXCESS))
            clean = check(case.trajectory, case.robot_with(1 - EXCESS), case.task(1 - EXCESS))
            missed += [(v.name, v.joint) for v in broken.violations] != [case.limit]
            invented += not clean.passed
            total += 1
    return total, missed, invented


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument(
        "--quick", action="store_true", help="80 seeded trajectories instead of 1000"
    )
    quick = parser.parse_args().quick
    rows: list[tuple[str, str, str, bool]] = []
    first, best = plan_time()
    rows.append(
        (
            "check of the shipped plan, first / best",
            "0.12 s",
            f"{first:.3f} / {best:.3f} s",
            best <= 0.12,
        )
    )
    with tempfile.TemporaryDirectory() as folder:
        for columns in (4, 8, 12):
            seconds, megabytes = million(Path(folder), columns)
            good = seconds <= 5 and megabytes <= 1024
            rows.append(
                (
                    f"10^6 rows, {columns} columns",
                    "5 s, 1024 MB",
                    f"{seconds:.2f} s, {megabytes:.0f} MB",
                    good,
                )
            )
    total, missed, invented = violations(80 if quick else 1000)
    rows.append((f"seeded violations missed, of {total}", "0", str(missed), missed == 0))
    rows.append((f"violations invented, on {total} clean ones", "0", str(invented), invented == 0))
    for name, expected, result, good in rows:
        print(f"{name:45s} {expected:>14s} {result:>22s} {'' if good else 'MISSED'}")
    print(
        f"peak memory of this process {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB"
    )
    return 0 if all(good for *_, good in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
