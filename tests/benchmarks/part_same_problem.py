"""Compare this planner with CasADi's Opti and rockit on the same optimal control problem.

The figures are the times of the first solve and of later solves, and the quality of the motion.
"""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ssm_planner.planning.ocp import free as free_ocp
from ssm_planner.planning.ocp import refinement
from ssm_planner.planning.ocp import straight as straight_ocp
from ssm_planner.planning.planner import plan_motion
from ssm_planner.problem.problem import Problem
from ssm_planner.trajectory import Trajectory
from tests.benchmarks.cases import (
    FREE,
    FREE_WEAK,
    STRAIGHT,
    WEAK,
    free_problem,
    limits_of,
    straight_problem,
    task_ends,
)
from tests.benchmarks.measuring import Spread, in_turns, timed
from tests.benchmarks.motions import certificate, excess
from tests.benchmarks.section import Section

OURS, FAST = "this planner, the whole plan", "this planner, the whole plan, `planner: fast`"
ALONE = "this planner, its optimal control solved once"
OPTI, ROCKIT = "CasADi Opti, default options", "rockit, default options"
OPTI_EXPANDED, ROCKIT_EXPANDED = "CasADi Opti, expand", "rockit, expand"
EXPANDED = {OPTI_EXPANDED: OPTI, ROCKIT_EXPANDED: ROCKIT}
WAYS = (OURS, FAST, ALONE, OPTI, OPTI_EXPANDED, ROCKIT, ROCKIT_EXPANDED)
MOTIONS = ("straight", "straight, weak motors", "free, weak motors")
COUNTS = {"straight": 72, "free": 40}
"""Number of elements in the meshes of the peers. It is the default of this planner."""
GUESS = {"straight": 2.0, "free": 1.5}
ASKED = {OPTI: 15.0, ROCKIT: 8.0}

INTRODUCTION = (
    "Time-optimal, from rest to rest, under velocity, acceleration and motor torque limits with the exact friction law for "
    "the known directions of motion (two rows per motor) and static friction at the start; Ipopt with MUMPS, tolerance "
    "1e-8. The peers get the same rows of the same model, at three points of each element, as parametric problems: "
    "cubic elements in Opti, multiple shooting with piecewise linear acceleration in rockit. A re-solve changes the target "
    "by a few degrees and the velocity limits by up to 10 %. Opti starts from its last solution. Their times are the solver "
    "call and setting the parameters. *Its optimal control solved once* is the same of this planner: choosing the rows, "
    "fitting the path and setting the parameters, and the first call of the structured solver, from its guess. *The whole "
    "plan* is all of `plan_motion`: inverse kinematics, TOPP-RA and its cross-check, that solve, tightening between nodes "
    "and solving again, Ipopt's confirmation (not with `planner: fast`), joint polynomials."
)
NOTES = (
    "`expand` is CasADi's option that turns the whole problem into one scalar graph: slower to build, faster to solve "
    "again. rockit solves from its first guess every time, because setting samples of the last solution as the guess costs "
    "it more Python time than it saves. First solves are in fresh processes, without the imports. The peers' answers are "
    "on meshes of equal elements and keep the limits at their nodes; *worst excess* is what the independent check finds in "
    "between, the largest over all re-solves."
)


@dataclass
class FirstSolves:
    """Recorder of the first structured solve of every optimisation.

    It records time in s and iterations from the start of the optimisation to the end of that solve.
    """

    begin: float | None = None
    found: list[tuple[float, int]] = field(default_factory=list)

    @contextmanager
    def driven(self) -> Iterator[None]:
        solve = refinement.solve_structured
        optimise = straight_ocp.find_fastest_motion

        def timed_solve(*arguments: Any, **named: Any) -> Any:
            answer = solve(*arguments, **named)
            if self.begin is not None:
                self.found.append((time.perf_counter() - self.begin, answer.iterations))
            self.begin = None
            return answer

        def timed_optimise(*arguments: Any, **named: Any) -> Any:
            self.begin = time.perf_counter()
            return optimise(*arguments, **named)

        refinement.solve_structured = timed_solve
        straight_ocp.find_fastest_motion = free_ocp.find_fastest_motion = timed_optimise
        try:
            yield
        finally:
            refinement.solve_structured = solve
            straight_ocp.find_fastest_motion = free_ocp.find_fastest_motion = optimise


@dataclass
class Way:
    """One program in one formulation.

    `solve` solves a change, and `trajectory` returns the motion of the last solve.
    """

    solve: Callable[[int], tuple[float, int]]
    trajectory: Callable[[], Trajectory]


def problems(motion: str, planner: str = "optimal") -> list[Problem]:
    """Return the problem of every change. The first one is solved first."""
    if motion.startswith("straight"):
        result = [
            straight_problem(change, WEAK if "weak" in motion else 1.0) for change in STRAIGHT
        ]
    else:
        result = [free_problem(change, FREE_WEAK) for change in FREE]
    return [dataclasses.replace(problem, planner=planner) for problem in result]


def make(name: str, motion: str) -> Way:
    """Return a program for the problems of a motion. Nothing is solved yet."""
    cases = problems(motion, "fast" if name == FAST else "optimal")
    if name in (OURS, FAST):
        return _ours(cases)
    peer = EXPANDED.get(name, name)
    options: dict[str, Any] = {"casadi": {"expand": True}} if name in EXPANDED else {}
    if motion.startswith("straight"):
        return _straight(peer, cases, options)
    return _free(peer, cases, options)


def _ours(cases: list[Problem]) -> Way:
    last: list[Any] = [None]

    def solve(k: int) -> tuple[float, int]:
        last[0] = planned = plan_motion(cases[k])
        if planned.trajectory is None:
            raise RuntimeError(f"no plan: {planned.reason}")
        return planned.trajectory.duration, sum(phase.motion.iterations for phase in planned.phases)

    return Way(solve, lambda: last[0].trajectory)


def _straight(peer: str, cases: list[Problem], options: dict[str, Any]) -> Way:
    from tests.benchmarks.opti_straight import OptiStraight
    from tests.benchmarks.rockit_straight import RockitStraight

    first = straight_path(cases[0])
    numbers = [(*task_ends(case), limits_of(case.robot)) for case in cases]
    kind: Any = OptiStraight if peer == OPTI else RockitStraight
    state: dict[str, Any] = {}

    def solve(k: int) -> tuple[float, int]:
        if "program" not in state:
            state["program"] = kind.build(
                cases[0].robot, first, COUNTS["straight"], options, GUESS["straight"]
            )
        state["case"] = cases[k]
        result: tuple[float, int] = state["program"].solve(*numbers[k])
        return result

    return Way(solve, lambda: state["program"].trajectory(straight_path(state["case"])))


def straight_path(problem: Problem) -> Any:
    """Return the path that this planner chooses for a straight problem.

    Its branch and the whole turns of its joints also hold for the peers.
    """
    return plan_motion(problem).phases[0].phase.path


def _free(peer: str, cases: list[Problem], options: dict[str, Any]) -> Way:
    from tests.benchmarks.opti_free import OptiFree
    from tests.benchmarks.rockit_free import RockitFree

    numbers = []
    for case in cases:
        target = case.motion[0].to
        numbers.append(
            (np.array(case.start.values), np.array(target.values), limits_of(case.robot))
        )
    kind: Any = OptiFree if peer == OPTI else RockitFree
    state: dict[str, Any] = {}

    def solve(k: int) -> tuple[float, int]:
        if "program" not in state:
            state["program"] = kind.build(cases[0].robot, COUNTS["free"], options, GUESS["free"])
        result: tuple[float, int] = state["program"].solve(*numbers[k])
        return result

    return Way(solve, lambda: state["program"].trajectory())


def run(quick: bool) -> Section:
    section = Section("The same optimal control problem")
    section.say(INTRODUCTION)
    for motion in MOTIONS[:1] if quick else MOTIONS:
        _compare(section, motion, first_rounds=1 if quick else 2, changes=3 if quick else 6)
    section.say(NOTES)
    return section


def _compare(section: Section, motion: str, first_rounds: int, changes: int) -> None:
    measured = [name for name in WAYS if name != ALONE]
    firsts, broken = _first_solves(measured, motion, first_rounds)
    ways = {}
    for name in measured:
        if name not in broken:
            way = make(name, motion)
            way.solve(0)
            if name in (OURS, FAST):
                way.solve(0)
            ways[name] = way
    judged: dict[str, list[tuple[float, str]]] = {name: [] for name in ways}

    def again(name: str) -> Callable[[int], tuple[float, int]]:
        return lambda k: ways[name].solve(k + 1)

    times: dict[str, list[float]] = {name: [] for name in ways}
    results: dict[str, list[tuple[float, int]]] = {name: [] for name in ways}
    alone = FirstSolves()
    cases = problems(motion, "fast")
    for k in range(changes):
        round_times, result = in_turns({name: again(name) for name in ways}, 1, first=k)
        with alone.driven():
            plan_motion(cases[k + 1])
        del alone.found[k + 1 :]  # keep the first optimisation of every plan
        for name, way in ways.items():
            times[name] += round_times[name].values
            results[name] += result[name]
            judged[name].append(excess(certificate(cases[k + 1], way.trajectory())))
    times[ALONE] = [seconds for seconds, _ in alone.found]
    results[ALONE] = [(0.0, count) for _, count in alone.found]
    rows = []
    complete, once = Spread.of(times[OURS]), Spread.of(times[ALONE])
    for name in WAYS:
        if name in broken:
            section.cannot.append((f"{name}, {motion}", broken[name]))
            continue
        spread = Spread.of(times[name])
        ours = name in (OURS, FAST, ALONE)
        longer = Spread.of(
            [a[0] / b[0] - 1 for a, b in zip(results[name], results[OURS], strict=True)]
        )
        rows.append(
            [
                name,
                "" if name == ALONE else Spread.of(firsts[name]).seconds(),
                spread.seconds(),
                "" if ours else spread.over(once).times(),
                "" if ours else spread.over(complete).times(),
                Spread.of([count for _, count in results[name]]).text(),
                "" if ours else longer.text("%", 100),
                "" if name == ALONE else max(judged[name])[1],
            ]
        )
        if not ours:
            section.faster(
                name, f"its solve against our whole plan, {motion}", spread.over(complete)
            )
            section.faster(name, f"its solve against our first, {motion}", spread.over(once))
    for name in (name for name in ASKED if name not in broken):
        own = {
            "one solve": once,
            "the whole plan": complete,
            "the whole plan, `fast`": Spread.of(times[FAST]),
        }
        _ask(section, motion, name, Spread.of(times[name]), own)
    section.say(f"**{motion[0].upper()}{motion[1:]}** ({COUNTS[motion.split(',')[0]]} elements)")
    head = (
        *("", "first solve", "re-solve", "÷ our solve", "÷ our plan", "iterations"),
        *("duration beyond ours", "worst excess at 10 kHz"),
    )
    section.table(head, rows)


def _first_solves(
    names: list[str], motion: str, rounds: int
) -> tuple[dict[str, list[float]], dict[str, str]]:
    """Return the times in s of the first solves of each planner, and the errors of failing ones."""
    seconds: dict[str, list[float]] = {name: [] for name in names}
    broken: dict[str, str] = {}
    for _ in range(rounds):
        for name in names:
            spent, error = first_solve(name, motion)
            if error:
                broken[name] = error
            seconds[name].append(spent)
    return seconds, broken


def _ask(section: Section, motion: str, name: str, theirs: Spread, ours: dict[str, Spread]) -> None:
    least = ASKED[name]
    for what, own in ours.items():
        ratio = theirs.over(own)
        words = f"re-planning, {motion}: {what}, times faster than one solve by {name}"
        section.asked(words, f"≥ {least:g}", ratio.text(), ratio.median >= least)


def first_solve(name: str, motion: str) -> tuple[float, str]:
    """Return the time in s of a first solve in a new process, without imports, and any error."""
    command = [sys.executable, "-m", "tests.benchmarks.part_same_problem", name, motion]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=180)
    except subprocess.TimeoutExpired:
        return float("nan"), "no first solution within 180 s"
    if done.returncode != 0:
        return float("nan"), (done.stderr.strip().splitlines() or ["it ended without a word"])[-1]
    return float(json.loads(done.stdout.splitlines()[-1])), ""


def main() -> None:
    name, motion = sys.argv[1:]
    way = make(name, motion)
    print(json.dumps(timed(lambda: way.solve(0))[0]))


if __name__ == "__main__":
    main()
