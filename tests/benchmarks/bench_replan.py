"""Measure the CPU time of one thread for planning a problem again with changed numbers.

    python -m tests.benchmarks.bench_replan [--against FOLDER] [--rounds N] [--kinds KIND …]
                                           [--fast | --compiled]

FOLDER is the root of another checkout of this project, for example a git worktree of an earlier
commit. The two checkouts run in turns. The table shows medians in ms by part. The first plan of
every kind builds its programs and is not counted.

--fast plans with `planner: fast` as a `Replanner` does, with all background compilation finished. A
checkout without this planner plans as it does by default. --compiled compiles the same code and
keeps the planner of the problem.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

ROOT = Path(__file__).parents[2]
KINDS = ("straight", "free", "jerk", "waypoints", "eye", "scan", "tilt_insert")
PARTS = {
    "solver": ("planning.ocp.refinement.solve_structured",),
    "Ipopt": ("planning.ocp.transcription.run_ipopt", "planning.ocp.transcription.ipopt"),
    "TOPP-RA": (
        "planning.phase_planner.retime",
        "planning.postprocess.retime_motion",
        "planning.ocp.mesh.retime",
    ),
    "check": ("pipeline.run.check",),
}
"""Functions whose time makes up a part of `run.plan`, also under the names of earlier checkouts.

A call from one of these functions to another counts once. The part `outside` is the time of the
plan without the solvers.
"""
JERK = 35.0
"""Jerk limit in rad/s³. A tenth of it is the limit in m/s³."""


def problem_of(kind: str, turn: int) -> Any:
    """Return the problem of a kind with the numbers of one turn."""
    from ssm_planner.loading.load import load_problem
    from tests.benchmarks.cases import (
        FREE_WEAK,
        Change,
        free_problem,
        straight_problem,
        with_limits,
    )

    slower = 1 - 1e-3 * turn
    if kind == "straight":
        return straight_problem(Change(velocity=slower), FREE_WEAK)
    if kind in ("free", "jerk"):
        problem = free_problem(Change(velocity=slower), FREE_WEAK)
        return (
            problem
            if kind == "free"
            else replace(problem, robot=with_limits(problem.robot, jerk=JERK))
        )
    name = {"eye": "eye_approach", "scan": "laser_scan"}.get(kind, kind)
    problem = load_problem(ROOT / f"problems/{name}.yaml")
    return replace(problem, robot=with_limits(problem.robot, velocity=slower))


def compiled() -> None:
    """Compile the functions at once that a background thread would compile, if the checkout can."""
    with suppress(ImportError):
        from ssm_planner.planning.ocp.compiled import function_store

        function_store.compile_all()
    with suppress(ImportError):
        from ssm_planner.planning.retiming.reachability import PASSES

        if PASSES.function is None:
            PASSES.compile()
            PASSES.wait()


def serve(fast: bool, compile_too: bool) -> None:
    """Answer requests "kind turn", one per line, with times in ms and the outcome as JSON."""
    from importlib import import_module

    from ssm_planner.errors import ProblemError
    from ssm_planner.pipeline import run
    from ssm_planner.sizing.size import size_motion

    spent: dict[str, float] = {}
    depth = 0

    def timed(part: str, function: Any) -> Any:
        def call(*given: Any, **named: Any) -> Any:
            nonlocal depth
            start, depth = time.thread_time(), depth + 1
            try:
                return function(*given, **named)
            finally:
                depth -= 1
                if not depth:
                    spent[part] = spent.get(part, 0.0) + 1e3 * (time.thread_time() - start)

        return call

    with ExitStack() as stack:
        for part, names in PARTS.items():
            for name in names:
                module, _, attribute = f"ssm_planner.{name}".rpartition(".")
                home = import_module(module)
                if hasattr(home, attribute):  # an earlier checkout may lack the function
                    stack.enter_context(
                        patch.object(home, attribute, timed(part, getattr(home, attribute)))
                    )
        for line in sys.stdin:
            kind, turn = line.split()
            problem = problem_of(kind, int(turn))
            if fast:
                with suppress(ProblemError):
                    problem = replace(problem, planner="fast")
            if (fast or compile_too) and turn == "0":
                run.plan(problem, relaxations=False)
                compiled()
                run.plan(problem, relaxations=False)
            spent.clear()
            start = time.thread_time()
            result = run.plan(problem, relaxations=not fast)
            middle = time.thread_time()
            if result.trajectory is not None:
                size_motion(result.trajectory, problem.robot)
            end = time.thread_time()
            complete = 1e3 * (middle - start)
            outside = complete - spent.get("solver", 0.0) - spent.get("Ipopt", 0.0)
            times = {"plan": complete, **spent, "outside": outside, "sizing": 1e3 * (end - middle)}
            duration = None if result.trajectory is None else result.trajectory.duration
            iterations = sum(phase.iterations for phase in result.phases)
            answer = {
                "times": times,
                "duration": duration,
                "passed": result.passed,
                "iterations": iterations,
            }
            print(json.dumps(answer), flush=True)


class Served:
    """A checkout that runs in a process of its own."""

    def __init__(self, root: Path, options: list[str]) -> None:
        threads = {"OPENBLAS_NUM_THREADS": "1", "SSM_PLANNER_COMPILE": "1" if options else "0"}
        environment = {**os.environ, "PYTHONPATH": str(root), **threads}
        pipe = subprocess.PIPE
        command = [sys.executable, __file__, "--serve", *options]
        self.process = subprocess.Popen(
            command, stdin=pipe, stdout=pipe, text=True, env=environment
        )

    def ask(self, kind: str, turn: int) -> dict[str, Any]:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        print(kind, turn, file=self.process.stdin, flush=True)
        return dict(json.loads(self.process.stdout.readline()))

    def end(self) -> None:
        self.process.communicate()


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--against", type=Path, help="root of another checkout")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--fast", action="store_true", help="planner: fast, compiled")
    parser.add_argument("--compiled", action="store_true")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        serve(options.fast, options.compiled)
        return 0
    roots = (
        {"this": ROOT}
        if options.against is None
        else {"before": options.against.resolve(), "this": ROOT}
    )
    chosen = [f"--{name}" for name in ("fast", "compiled") if vars(options)[name]]
    ways = {name: Served(root, chosen) for name, root in roots.items()}
    columns = ("plan", *PARTS, "outside", "sizing")
    print(
        f"{'':18s}"
        + "".join(f"{name:>9s}" for name in columns)
        + "   iterations   duration   certified"
    )
    for kind in options.kinds:
        result: dict[str, list[dict[str, Any]]] = {name: [] for name in ways}
        for turn in range(options.rounds + 1):
            for name, way in ways.items():
                result[name].append(way.ask(kind, turn))
        medians: dict[str, list[float]] = {}
        for name, answers in result.items():
            medians[name] = [
                statistics.median(a["times"].get(part, 0.0) for a in answers[1:])
                for part in columns
            ]
            durations = [a["duration"] or 0.0 for a in answers]
            print(
                f"{kind:10s}{name:8s}" + "".join(f"{value:9.1f}" for value in medians[name])
                + f"{statistics.median(a['iterations'] for a in answers[1:]):13.0f}{sum(durations) / len(durations):11.5f}"
                + f"{sum(a['passed'] for a in answers):9d} of {len(answers)}"
            )  # fmt: skip
        if "before" in medians:
            ratios = [
                old / new if new else 1.0
                for old, new in zip(medians["before"], medians["this"], strict=True)
            ]
            print(f"{'':10s}{'÷':8s}" + "".join(f"{ratio:9.2f}" for ratio in ratios))
    for way in ways.values():
        way.end()
    return 0


if __name__ == "__main__":
    sys.exit(main())
