"""Compare this planner with Ruckig on free rest-to-rest motions that the motors do not limit."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from ssm_planner.planning.planner import plan_motion
from ssm_planner.problem.motion import Joints
from ssm_planner.problem.problem import Problem
from tests.benchmarks.cases import FIRST, Change, free_problem, with_limits
from tests.benchmarks.measuring import Spread, in_turns
from tests.benchmarks.motions import certificate
from tests.benchmarks.section import Section

JERKS = (5.0, 35.0, 500.0)
ASKED = 1.002
INTRODUCTION = (
    "All four joints move between two configurations under velocity, acceleration and jerk limits (rad/s³; a tenth of it in "
    "m/s³); random targets. The motors are three times as strong as the robot's, so that they do not bind: Ruckig does not "
    "know them. Each joint then has a closed form, which Ruckig evaluates: **Ruckig wins the run time by orders of "
    "magnitude**, and is the tool to take where nothing couples the joints."
)


def run(quick: bool) -> Section:
    section = Section("Rest to rest without binding motors")
    section.say(INTRODUCTION)
    rng = np.random.default_rng(4)
    targets = np.array(FIRST) + rng.uniform(-1.2, 1.2, (3 if quick else 8, 4)) * [
        1.0,
        0.8,
        1.0,
        0.0,
    ]
    targets[:, 3] = -rng.uniform(0.004, 0.029, len(targets))
    rows = []
    for jerk in JERKS:
        problems = [_problem(target, jerk) for target in targets]
        plan_motion(problems[0])
        ruckig_duration(problems[0])
        ways: dict[str, Any] = {
            "ours": lambda k, problems=problems: plan_motion(problems[k]),
            "ruckig": lambda k, problems=problems: ruckig_duration(problems[k]),
        }
        times, results = in_turns(ways, len(problems))
        planned = results["ours"]
        missing = [str(plan.reason) for plan in planned if plan.trajectory is None]
        if missing:
            raise RuntimeError(missing[0])
        ratio = Spread.of(
            [
                plan.trajectory.duration / best
                for plan, best in zip(planned, results["ruckig"], strict=True)
            ]
        )
        limits_kept = all(
            certificate(problem, plan.trajectory).passed
            for problem, plan in zip(problems, planned, strict=True)
        )
        rows.append(
            [
                f"{jerk:g}",
                ", ".join(f"{duration:.3f}" for duration in results["ruckig"][:3]) + ", …",
                f"{ratio.median:.5f} ({min(ratio.values):.5f}–{max(ratio.values):.5f})",
                times["ours"].seconds(),
                times["ruckig"].seconds(),
                times["ours"].over(times["ruckig"]).text(),
                "yes" if limits_kept else "NO",
            ]
        )
        section.faster("Ruckig", f"run time, jerk {jerk:g}", times["ruckig"].over(times["ours"]))
        worst = max(ratio.values)
        section.asked(
            f"free rest-to-rest motion against Ruckig, jerk {jerk:g}",
            f"≤ {ASKED:g} ×",
            f"{worst:.5f} ×",
            worst <= ASKED,
        )
    section.table(
        (
            "jerk limit",
            "Ruckig's times of motion, s",
            "ours ÷ Ruckig's",
            "our run time",
            "Ruckig's",
            "ratio",
            "check passed",
        ),
        rows,
    )
    return section


def _problem(target: np.ndarray, jerk: float) -> Problem:
    problem = free_problem(Change())
    motion = dataclasses.replace(problem.motion[0], to=Joints(tuple(float(x) for x in target)))  # type: ignore[arg-type]
    return dataclasses.replace(
        problem, robot=with_limits(problem.robot, torque=3.0, jerk=jerk), motion=(motion,)
    )


def ruckig_duration(problem: Problem) -> float:
    import ruckig

    joints, target = problem.robot.joints, problem.motion[0].to
    task, outcome = ruckig.InputParameter(4), ruckig.Trajectory(4)
    task.current_position, task.target_position = list(problem.start.values), list(target.values)
    task.max_velocity = [joint.velocity for joint in joints]
    task.max_acceleration = [joint.acceleration for joint in joints]
    task.max_jerk = [joint.jerk for joint in joints]
    result = ruckig.Ruckig(4).calculate(task, outcome)
    if result != ruckig.Result.Working:
        raise RuntimeError(f"Ruckig: {result}")
    return float(outcome.duration)
