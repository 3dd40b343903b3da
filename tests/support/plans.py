"""Plans that are built without the planner: trapezoidal and smooth motions, and files with them."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.plans import PLAN_FORMAT, PLAN_VERSION, Plan, load_plan
from ssm_planner.problem.limits import Limit, TaskRange, TaskRate, TipSpeed
from ssm_planner.problem.motion import Free, Joints
from ssm_planner.problem.problem import Eye, Problem, TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.problem.serialization import to_plain
from ssm_planner.trajectory import Span, Trajectory, quintic_coefficients
from ssm_planner.typing import Range
from ssm_planner.verification.check import check

START = np.array([0.3, 1.15, 0.1, 0.0])
MOVES = (np.array([0.4, -0.5, -0.3, 0.0]), np.array([-0.1, 0.05, 0.2, -0.012]))
SHARE = 0.97
"""Fraction of the velocity and acceleration limits that the slowest joint uses."""
NONE = TaskLimits()


def of_task(
    ranges: Mapping[str, Range] | None = None,
    tip_speed: float | None = None,
    rates: Mapping[str, float] | None = None,
    eye: Eye | None = None,
) -> TaskLimits:
    """Return limits of the task from ranges, the tip speed, rates and an eye."""
    limits: list[Limit] = [TaskRange(name, *ends) for name, ends in (ranges or {}).items()]
    limits += [TaskRate(name, rate) for name, rate in (rates or {}).items()]
    limits += [] if tip_speed is None else [TipSpeed(tip_speed)]
    return TaskLimits(tuple(limits), eye)


def trapezoids(
    robot: Robot, moves: tuple[np.ndarray, ...] = MOVES, share: float = SHARE
) -> Trajectory:
    """Return one trapezoidal motion after another, with all joints in proportion.

    `share` is the fraction of the limits that is used. The acceleration jumps at the breaks.
    """
    velocity = np.array([joint.velocity for joint in robot.joints]) * share
    acceleration = np.array([joint.acceleration for joint in robot.joints]) * share
    q, time = START.copy(), 0.0
    breaks, pieces, phases = [0.0], [], []
    for number, move in enumerate(moves):
        # s from 0 to 1 with |s'| ≤ v, |s''| ≤ a
        v = float(np.min(velocity[move != 0] / np.abs(move[move != 0])))
        a = float(np.min(acceleration[move != 0] / np.abs(move[move != 0])))
        v = min(v, np.sqrt(a))
        ramp, cruise = v / a, 1 / v - v / a
        knots = [(0.0, 0.0), (a * ramp**2 / 2, v), (a * ramp**2 / 2 + v * cruise, v), (1.0, 0.0)]
        for k, (length, rate) in enumerate(((ramp, a), (cruise, 0.0), (ramp, -a))):
            if length < 1e-9:
                continue
            (s0, v0), (s1, v1) = knots[k], knots[k + 1]
            local = np.array([0.0, length])
            ends = [
                tuple(np.array([x]) for x in (q + s * move, w * move, rate * move))
                for s, w in ((s0, v0), (s1, v1))
            ]
            pieces.append(quintic_coefficients(np.diff(local), ends[0], ends[1]))
            breaks.append(breaks[-1] + length)
        q = q + move
        phases.append(Span(f"move {number + 1}", time, breaks[-1]))
        time = breaks[-1]
    return Trajectory(np.array(breaks), np.concatenate(pieces), tuple(phases))


def smooth(robot: Robot, moves: tuple[np.ndarray, ...] = MOVES, share: float = 0.9) -> Trajectory:
    """Return rest-to-rest quintics, whose acceleration has no jumps."""
    velocity = np.array([joint.velocity for joint in robot.joints]) * share
    acceleration = np.array([joint.acceleration for joint in robot.joints]) * share
    q, breaks, pieces = START.copy(), [0.0], []
    zero = np.zeros((1, 4))
    for move in moves:
        duration = max(
            float(np.max(15 / 8 * np.abs(move) / velocity)),
            float(np.sqrt(np.max(10 / np.sqrt(3) * np.abs(move) / acceleration))),
        )
        pieces.append(
            quintic_coefficients(
                np.diff(np.array([0.0, duration])),
                (q[None], zero, zero),
                ((q + move)[None], zero, zero),
            )
        )
        q = q + move
        breaks.append(breaks[-1] + duration)
    return Trajectory(np.array(breaks), np.concatenate(pieces), (Span("smooth", 0.0, breaks[-1]),))


def write_plan(
    path: Path, robot: Robot, trajectory: Trajectory, limits: TaskLimits = NONE, **changes: Any
) -> Path:
    """Write a plan.json of a trajectory with its certificate.

    `changes` replaces keys of the document.
    """
    first, last = (
        Joints(tuple(q)) for q in trajectory.sample(trajectory.breaks[[0, -1]]).q.tolist()
    )
    problem = Problem(
        robot,
        first,
        (Free(last),),
        limits.limits,
        eye=limits.eye,
        name=path.stem,
        start_rate=limits.start_rate or {},
        end_rate=limits.end_rate or {},
    )
    document = {
        "format": PLAN_FORMAT,
        "version": PLAN_VERSION,
        "status": "solved",
        "problem": to_plain(problem),
        "certificate": check(trajectory, robot, problem.task_limits, seal=True).to_dict(),
        "trajectory": trajectory.to_dict(),
        **changes,
    }
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def read_back(path: Path, robot: Robot, trajectory: Trajectory, **more: Any) -> Plan:
    return load_plan(write_plan(path, robot, trajectory, **more))


def certified(plan: Plan) -> Plan:
    """Return a plan that was changed in Python with a new certificate."""
    return dataclasses.replace(
        plan, certificate=check(plan.motion, plan.robot, plan.limits, seal=True)
    )
