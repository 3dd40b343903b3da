"""Table III: tilt and insertion at the printed speeds, planned within them, and the motor torques that this predicts."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ssm_planner.model.measures import joint_speed_per_tilt_speed
from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.workspace import tilt_from_theta2
from ssm_planner.paper import published
from ssm_planner.paper.published import DRIVEN, NUMBER, TABLE_III, SpeedRow
from ssm_planner.paper.section import NOTHING, Section, number, picture, table
from ssm_planner.plan import Plan
from ssm_planner.problem.values import JOINTS, Array, Problem, Robot, Target
from ssm_planner.report.style import COLOURS, RPM, SIZE, finish, new_figure
from ssm_planner.run import plan
from ssm_planner.sizing.joint_load import JointLoad, joint_loads

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class SpeedRun:
    """One row of Table III, planned; loads are those of the driven joints, empty without a plan."""

    row: SpeedRow
    plan: Plan
    loads: tuple[JointLoad, ...]

    def envelope(self, joint: str) -> tuple[float, float]:
        """Least and largest motor torque while the joint moves, N·m."""
        load = self.load(joint)
        torque = load.torque()[load.direction != 0]
        return float(torque.min()), float(torque.max())

    def load(self, joint: str) -> JointLoad:
        return next(load for load in self.loads if load.joint == joint)

    def tilt_rate(self, robot: Robot) -> float:
        """Largest tilt rate, rad/s."""
        trajectory = self.plan.trajectory
        if trajectory is None:
            return math.nan
        mechanism, samples = Mechanism.from_geometry(robot.geometry), trajectory.uniform(1000.0)
        tilt = tilt_from_theta2(mechanism, samples.q[:, 1])
        per = joint_speed_per_tilt_speed(mechanism, tilt, mechanism.home_branch)[:, 1]
        return float(np.abs(samples.qd[:, 1] / per).max())


def at_speeds(problem: Problem, row: SpeedRow) -> Problem:
    """The problem with every rotary joint limited to the printed rotary speed and joint 4 to the printed translation."""
    speed = {"revolute": row.tilt, "prismatic": row.insertion}
    first, second, third, fourth = (replace(joint, velocity=speed[joint.kind]) for joint in problem.robot.joints)
    robot = replace(problem.robot, joints=(first, second, third, fourth))
    return replace(problem, name=f"Table III, {row.label}", robot=robot)


def speed_runs(problem: Problem, progress: Callable[[str], None] = lambda _: None) -> tuple[SpeedRun, ...]:
    """All rows of Table III, planned within the published accelerations."""
    runs = []
    for row in TABLE_III:
        progress(f"Table III: {row.label}")
        here = at_speeds(problem, row)
        outcome = plan(here)
        loads = () if outcome.trajectory is None else joint_loads(outcome.trajectory, here.robot)
        runs.append(SpeedRun(row, outcome, loads))
    return tuple(runs)


@dataclass(frozen=True)
class TiltRateBound:
    """A tilt rate (rad/s) that no motion from rest to rest beats, where it is (tilt, rad), and the joint that sets it."""

    rate: float
    tilt: float
    joint: str


def tilt_rate_bound(mechanism: Mechanism, ends: tuple[float, float], acceleration: float) -> TiltRateBound:
    """Largest tilt rate within a joint acceleration (rad/s²) between two tilts (rad) at rest.

    A joint that starts or ends at rest has q̇² ≤ 2·q̈_max·travel, so φ̇ ≤ √(2 q̈_max·min(travel to either end)) / |dq/dφ|,
    for each of joints 1 to 3.
    """
    tilt = np.linspace(*ends, 20001)
    slope = np.abs(joint_speed_per_tilt_speed(mechanism, tilt, mechanism.home_branch))
    step = (slope[1:] + slope[:-1]) / 2 * abs(tilt[1] - tilt[0])
    travel = np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)])
    speed = np.sqrt(2 * acceleration * np.minimum(travel, travel[-1] - travel))
    rates = speed / np.maximum(slope, 1e-12)
    k = int(np.argmax(rates.min(axis=1)))
    joint = JOINTS[int(np.argmin(rates[k]))]
    return TiltRateBound(float(rates[k].min()), float(tilt[k]), joint)


def motions_section(problem: Problem, runs: tuple[SpeedRun, ...]) -> Section:
    """The reading chosen, Table III and the torques over time."""
    lines = [*_reading(problem, runs), *_table(runs), *_notes(runs)]
    solved = tuple(run for run in runs if run.loads)
    figures = {}
    if solved:
        lines += picture(
            "motions", "Predicted motor torque over time: rows joints 1, 2 and 4, columns the speeds of Table III"
        )
        figures = {"motions": _figure(solved)}
    return Section(
        "Table III: tilt and insertion",
        "ssm-planner reproduce",
        lines,
        figures,
    )


def _reading(problem: Problem, runs: tuple[SpeedRun, ...]) -> list[str]:
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    low, high = tilts_of(problem)
    per = np.abs(joint_speed_per_tilt_speed(mechanism, np.linspace(low, high, 501), mechanism.home_branch))
    stated, bend = published.ROTARY_SPEED, published.ROTARY_ACCELERATION
    rows = []
    for run in runs:
        fastest, slowest = run.row.tilt * per.max(axis=0), run.row.tilt * per[:, 1].min()
        rows.append(
            (
                run.row.label,
                f"{math.degrees(slowest):.0f} … {math.degrees(fastest[1]):.0f}°/s",
                f"{math.degrees(fastest[0]):.0f}°/s",
                f"{max(fastest[:2]) / stated:.1f}",
                f"{run.row.tilt / stated:.2f}",
                f"{math.degrees(run.tilt_rate(problem.robot)):.1f}°/s",
            )
        )
    head = (
        "printed speeds",
        "as tilt rate: joint 2",
        "joint 1 up to",
        "times the stated 65°/s",
        "as joint speed: times 65°/s",
        "tilt rate this gives, up to",
    )
    bound = tilt_rate_bound(mechanism, (low, high), bend)
    limits = problem.robot.limits["tilt"]
    wide = tilt_rate_bound(mechanism, limits, bend)
    return [
        "**The reading chosen.** The paper prints a tilt and an insertion speed for each motion and does not say whether "
        "the former is the rate of the tilt angle or the speed of the joints. It is read here as the largest speed of the "
        "rotary joints. Read as a tilt rate it would ask of the joints, at some tilt between "
        f"{_deg(low)} and {_deg(high)}:",
        "",
        *table(head, rows),
        f"Within the {math.degrees(bend):.0f}°/s² that the paper states, no motion from rest to rest between these tilts "
        f"reaches more than {math.degrees(bound.rate):.0f}°/s of tilt (closed form; joint {NUMBER[bound.joint]} sets it, at "
        f"{_deg(bound.tilt)}), so a tilt rate of 80°/s cannot be reached at all; between {_deg(limits[0])} and "
        f"{_deg(limits[1])} it is {math.degrees(wide.rate):.0f}°/s for an instant. As joint speed every row fits. The last "
        "row then exceeds the stated 65°/s, and 40 mm/s the stated 20 mm/s, so the limits of the robot file are replaced "
        "by the printed speeds. The paper does not print how far it tilted and inserted: the motion is that of "
        f"`problems/tilt_insert.yaml`, {_deg(high)} to {_deg(low)}, then {_depth(problem):.0f} mm.",
        "",
    ]


def _table(runs: tuple[SpeedRun, ...]) -> list[str]:
    rows = []
    for run in runs:
        printed = " / ".join(f"{run.row.nrmsd[joint]:.2f}" for joint in DRIVEN)
        if not run.loads:
            rows.append((run.row.label, printed, NOTHING, f"no plan: {_reason(run)}", *[NOTHING] * 4))
            continue
        envelopes = [" … ".join(number(1e3 * end) for end in run.envelope(joint)) for joint in DRIVEN]
        speeds = " / ".join(f"{RPM * float(np.abs(run.load(joint).speed()).max()):.0f}" for joint in DRIVEN)
        duration = f"{run.plan.duration:.3f} s"
        rows.append((run.row.label, printed, "not public", duration, *envelopes, speeds))
    head = (
        "Table III",
        "published NRMSD, joints 1 / 2 / 4",
        "ours",
        "duration, ours",
        *(f"joint {NUMBER[joint]} torque (mN·m)" for joint in DRIVEN),
        "motor speeds up to (rpm)",
    )
    return table(head, rows)


def _notes(runs: tuple[SpeedRun, ...]) -> list[str]:
    passed = sum(run.plan.passed for run in runs)
    return [
        "The paper's torque recordings are not public, so its NRMSD cannot be recomputed and no number stands in for it; "
        "for the recordings that are public it is computed in the section on the rigs. What can be predicted is the "
        "envelope: least and largest motor torque while the joint moves, Table II's friction, static friction at starts "
        f"included. {passed} of {len(runs)} motions pass the independent check of every limit at 10 kHz.",
        "",
    ]


def tilts_of(problem: Problem) -> tuple[float, float]:
    """Lower and upper tilt of the motion, rad."""
    ends = [target.task["tilt"] for target in _targets(problem) if target.task and "tilt" in target.task]
    return min(ends), max(ends)


def _depth(problem: Problem) -> float:
    """mm."""
    return 1e3 * max(target.task["depth"] for target in _targets(problem) if target.task and "depth" in target.task)


def _targets(problem: Problem) -> list[Target]:
    return [problem.start, *(motion.target for motion in problem.motion if motion.target is not None)]


def _reason(run: SpeedRun) -> str:
    return run.plan.status if run.plan.reason is None else run.plan.reason.message


def _deg(angle: float) -> str:
    return f"{math.degrees(angle):.0f}°".replace("-", "−")


def _figure(runs: tuple[SpeedRun, ...]) -> Figure:
    figure = new_figure(9.6, 5.6)
    panels = figure.subplots(len(DRIVEN), len(runs), sharex="col", sharey="row", squeeze=False)
    for column, run in enumerate(runs):
        trajectory = run.plan.trajectory
        for row, joint in enumerate(DRIVEN):
            axes, load = panels[row, column], run.load(joint)
            if trajectory is not None:
                for phase in trajectory.phases[1::2]:
                    axes.axvspan(phase.start, phase.end, color="0.95", linewidth=0, zorder=0)
            axes.plot(load.t, 1e3 * load.torque(), color=COLOURS[JOINTS.index(joint)], linewidth=1.1)
            moving = load.direction != 0
            ends: Array = 1e3 * load.torque()[moving]
            for end in (ends.min(), ends.max()):
                axes.axhline(end, color="0.45", linewidth=0.8, linestyle=(0, (4, 2)))
            last = row == len(DRIVEN) - 1
            label = f"joint {NUMBER[joint]} ({joint})\nmotor torque (mN·m)" if column == 0 else ""
            finish(axes, "time (s)" if last else "", label)
        panels[0, column].set_title(run.row.label, fontsize=SIZE)
    return figure
