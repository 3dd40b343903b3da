"""Compare this planner with toppra and copp-py on the same path and limits.

The figures are the duration, the run time and the largest excess over a limit.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from ssm_planner.pipeline.run import plan
from ssm_planner.planning.retiming.retime import retime
from ssm_planner.problem.problem import Problem
from ssm_planner.trajectory import Trajectory
from tests.benchmarks.cases import WEAK, Change, straight_problem, with_limits
from tests.benchmarks.measuring import in_turns
from tests.benchmarks.motions import along_path, certificate, excess
from tests.benchmarks.section import Section

JERK = 35.0
TOLERANCE = 1e-6
"""Relative excess over a limit up to which the limit counts as kept."""
SHARES = (("motors at full torque", 1.0), ("motors × 0.35", 0.35), (f"motors × {WEAK:g}", WEAK))
EXACT = "TOPP-RA, exact friction (this project)"
TOPPRA = {
    EXACT: "TOPP-RA as this project calls it",
    "toppra, friction at the mean weight": "toppra's own constraints",
}
"""Programs whose duration is the reference for this planner where the motors do not limit it."""
INTRODUCTION = (
    "The shipped robot tilts from −85° to −135° along a straight line in task space, under velocity, acceleration and motor "
    "torque limits; the peers on 1 000 grid intervals. Users of toppra and copp-py pass dry friction as one constant torque "
    "per joint; it is taken at the mean, or at the largest, weight that the mesh carries along the path. Both get the "
    "motors' inverse dynamics from Pinocchio. *TOPP-RA, exact friction* is `retime` of this project: two sides of the mesh "
    "as rows, viscous friction by repeated tangents, static friction at the start. *This planner* is the whole of "
    "`run.plan`, its check included. Excesses are what the independent check "
    "finds at 10 kHz with the exact friction law."
)


def run(quick: bool) -> Section:
    section = Section("The same path and the same limits")
    section.say(INTRODUCTION)
    for title, share in SHARES[1:2] if quick else SHARES:
        _compare(section, title, straight_problem(Change(), share), 2 if quick else 5)
    section.cannot += [
        ("toppra with jerk limits", "its constraints are of second order"),
        (
            "toppra and copp-py with exact friction by their own means",
            "their torque constraint takes one constant per joint; friction that depends on the load and on its direction, "
            "static friction, and viscous friction (∝ ṡ, while their rows are linear in ṡ² and s̈) are left to the user",
        ),
    ]
    jerk = straight_problem(Change())
    jerk = dataclasses.replace(jerk, robot=with_limits(jerk.robot, jerk=JERK))
    _compare(section, f"motors at full torque, jerk limit {JERK:g} rad/s³", jerk, 1 if quick else 3)
    return section


def _compare(section: Section, title: str, problem: Problem, rounds: int) -> None:
    from tests.benchmarks.part_same_problem import straight_path
    from tests.benchmarks.path_peers import (
        UserModel,
        copp_jerk_limited,
        copp_speeds,
        elements_of,
        toppra_speeds,
    )

    path: Any = straight_path(problem)
    users = {
        which: UserModel.of(problem.robot, path, largest=which == "largest")
        for which in ("mean", "largest")
    }

    def ours(_: int) -> Any:
        return plan(problem).trajectory

    def exact(_: int) -> Any:
        result = retime(path, problem.robot)
        if not result.solved:
            raise RuntimeError("no motion along the path keeps the limits")
        return result.s, np.sqrt(result.speed_squared)

    ways: dict[str, Callable[[int], Any]] = {"this planner": ours}
    if problem.robot.joints[0].jerk is None:
        ways[EXACT] = exact
        for which, user in users.items():
            ways[f"toppra, friction at the {which} weight"] = lambda _, user=user: toppra_speeds(
                path, user
            )
            ways[f"copp-py, friction at the {which} weight"] = lambda _, user=user: copp_speeds(
                path, user
            )
    else:
        ways["copp-py, cone program, 2 rounds"] = lambda _: copp_jerk_limited(path, users["mean"])
    able = {}
    for name, way in ways.items():
        try:
            way(0)
            able[name] = way
        except Exception as error:  # noqa: BLE001 - any error of a peer is its result
            section.cannot.append((f"{name}, {title}", str(error).splitlines()[0]))
    times, results = in_turns(able, rounds)
    base = times["this planner"]
    rows = []
    for name, spread in times.items():
        answer = results[name][-1]
        trajectory = (
            answer if isinstance(answer, Trajectory) else along_path(path, elements_of(*answer), 1)
        )
        result = certificate(problem, trajectory)
        rows.append(
            [
                name,
                f"{trajectory.duration:.4f} s",
                spread.seconds(),
                "" if name == "this planner" else spread.over(base).times(),
                excess(result, "motor torque")[1],
                excess(result)[1],
            ]
        )
        if not name.startswith("this") and not name.startswith("TOPP"):
            over = excess(result)
            beyond = f"; its motion exceeds a limit by {over[1]}" if over[0] > TOLERANCE else ""
            section.faster(name, f"run time on the same path, {title}{beyond}", spread.over(base))
        if name == "this planner":
            worst = excess(result, "motor torque")
            section.asked(
                f"torque above limit at 10 kHz, {title}",
                "≤ 1e-6",
                f"{max(worst[0], 0.0):.1g}",
                worst[0] <= TOLERANCE,
            )
        if "full" in title and name in TOPPRA:
            ratio = results["this planner"][-1].duration / trajectory.duration
            section.asked(
                f"acceleration-limited straight motion against {TOPPRA[name]}, 1 000 points",
                "1.0000–1.0005 ×",
                f"{ratio:.5f} ×, its worst excess {excess(result)[1]}",
                1 <= ratio <= 1.0005,
            )
    section.say(f"**{title[0].upper()}{title[1:]}**")
    section.table(
        ("", "time of motion", "run time", "÷ ours", "torque excess", "worst excess"), rows
    )
