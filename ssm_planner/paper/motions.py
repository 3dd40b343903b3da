"""Table III: tilt and insertion planned at the printed speeds, and the motor torques over time that this predicts."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_rates
from ssm_planner.kinematics.workspace import joint_speed_per_tilt_speed, tilt_rate_bound
from ssm_planner.paper import published
from ssm_planner.paper.published import DRIVEN, NUMBER, TABLE_III, SpeedRow
from ssm_planner.paper.section import NOTHING, Section, number, picture, table, text
from ssm_planner.paper.workspace import degrees
from ssm_planner.pipeline.run import plan
from ssm_planner.plans import Plan
from ssm_planner.problem.limits import TASK
from ssm_planner.problem.motion import Free, Straight, Task
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import JOINTS, Robot
from ssm_planner.reporting.figures.style import COLOURS, LIMIT, SIZE, finish, new_figure
from ssm_planner.sizing.joint_load import JointLoad, joint_loads
from ssm_planner.units import RPM

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

    def reaches(self) -> bool:
        """Whether a rotary joint and the translation both come up to the printed speeds."""
        trajectory = self.plan.trajectory
        if trajectory is None:
            return False
        fastest = np.abs(trajectory.uniform(1000.0).qd).max(axis=0)
        return bool(fastest[:3].max() > 0.999 * self.row.tilt and fastest[3] > 0.999 * self.row.insertion)

    def tilt_rate(self, robot: Robot) -> float:
        """Largest tilt rate, rad/s."""
        trajectory = self.plan.trajectory
        if trajectory is None:
            return math.nan
        samples = trajectory.uniform(1000.0)
        rates = task_rates(Mechanism.from_geometry(robot.geometry), samples.q, samples.qd)
        return float(np.abs(rates[:, TASK.index("tilt")]).max())


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


def tilts_of(problem: Problem) -> tuple[float, float]:
    """Lower and upper tilt that the problem names, rad."""
    values = _values(problem, "tilt")
    return min(values), max(values)


def depth_of(problem: Problem) -> float:
    """Largest depth that the problem names, m."""
    return max(_values(problem, "depth"))


def _values(problem: Problem, name: str) -> list[float]:
    points = [problem.start, *(motion.to for motion in problem.motion if isinstance(motion, (Straight, Free)))]
    return [point.given[name] for point in points if isinstance(point, Task) and name in point.given]


def motions_section(problem: Problem, runs: tuple[SpeedRun, ...]) -> Section:
    """Table III."""
    lines = [*_reading(problem, runs), *_table(runs), *_notes(runs)]
    solved = tuple(run for run in runs if run.loads)
    figures = {}
    if solved:
        lines += picture(
            "motions",
            "Predicted motor torque of joints 1, 2 and 4 at the speeds of Table III; shaded: insertion, dashed: envelope "
            "while the joint moves",
        )
        figures = {"motions": _figure(solved)}
    return Section("Table III: tilt and insertion", lines, figures)


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
                f"{math.degrees(slowest):.0f} … {degrees(float(fastest[1]), 0)}/s",
                f"{degrees(float(fastest[0]), 0)}/s",
                f"{max(fastest[:2]) / stated:.2f}",
                f"{run.row.tilt / stated:.2f}",
                f"{degrees(run.tilt_rate(problem.robot), 1)}/s" if run.loads else NOTHING,
            )
        )
    head = (
        "printed speeds",
        "read as tilt rate: joint 2",
        "joint 1 up to",
        "times the stated 65°/s",
        "read as joint speed: times 65°/s",
        "tilt rate then up to",
    )
    bound, wide = (tilt_rate_bound(mechanism, ends, bend) for ends in ((low, high), problem.robot.ranges["tilt"]))
    ends = [degrees(end, 0) for end in (low, high, *problem.robot.ranges["tilt"])]
    reached = sum(run.reaches() for run in runs)
    return [
        *text(
            "**The reading chosen.** The paper prints a tilt and an insertion speed for each motion and does not say whether "
            "the former is the rate of the tilt angle or a speed of joints. It is read here as the largest speed of the "
            f"rotary joints. Between {ends[0]} and {ends[1]} of tilt the two readings ask for:"
        ),
        *table(head, rows),
        *text(
            f"Within the {degrees(bend, 0)}/s² that the paper states, no motion from rest to rest between these tilts "
            f"passes {degrees(bound.rate, 0)}/s of tilt (closed form; joint {NUMBER[bound.joint]} sets it, at "
            f"{degrees(bound.tilt, 0)}), so a tilt rate of 80°/s is out of reach; between {ends[2]} and {ends[3]} the bound "
            f"is {degrees(wide.rate, 0)}/s, for an instant. As a joint speed {reached} of {len(runs)} rows are reached. "
            "The last row then exceeds the stated 65°/s, and 40 mm/s the stated 20 mm/s, so the speed limits of the robot "
            "file give way to the printed ones; its accelerations stay. The paper does not print how far it tilted and "
            f"inserted; the motion is that of `problems/tilt_insert.yaml`, {ends[1]} to {ends[0]}, then "
            f"{1e3 * depth_of(problem):.0f} mm."
        ),
    ]


def _table(runs: tuple[SpeedRun, ...]) -> list[str]:
    rows = []
    for run in runs:
        printed = " / ".join(f"{run.row.nrmsd[joint]:.2f}" for joint in DRIVEN)
        if not run.loads:
            reason = run.plan.status if run.plan.reason is None else run.plan.reason.message
            rows.append((run.row.label, printed, NOTHING, f"no plan: {reason}", *[NOTHING] * 4))
            continue
        envelopes = [" … ".join(number(1e3 * end) for end in run.envelope(joint)) for joint in DRIVEN]
        speeds = " / ".join(f"{RPM * float(np.abs(run.load(joint).speed()).max()):.0f}" for joint in DRIVEN)
        rows.append((run.row.label, printed, "not public", f"{run.plan.duration:.2f} s", *envelopes, speeds))
    head = (
        "Table III",
        "NRMSD, published: joints 1 / 2 / 4",
        "NRMSD, ours",
        "duration, ours",
        *(f"torque of joint {NUMBER[joint]} (mN·m)" for joint in DRIVEN),
        "motor speeds up to (rpm)",
    )
    return table(head, rows)


def _notes(runs: tuple[SpeedRun, ...]) -> list[str]:
    passed = sum(run.plan.passed for run in runs)
    return text(
        "The paper's torque recordings are not public: its NRMSD cannot be recomputed, and no number stands in for it. For "
        "the recordings that are public it is in the section on the rigs. What can be predicted is the envelope: least and "
        "largest motor torque while the joint moves, with the friction of Table II and static friction at starts. "
        f"{passed} of {len(runs)} motions pass the independent check of every limit at 10 kHz."
    )


def _figure(runs: tuple[SpeedRun, ...]) -> Figure:
    figure = new_figure(9.6, 5.6)
    panels = figure.subplots(len(DRIVEN), len(runs), sharex="col", sharey="row", squeeze=False)
    for column, run in enumerate(runs):
        phases = () if run.plan.trajectory is None else run.plan.trajectory.phases
        for row, joint in enumerate(DRIVEN):
            axes, load = panels[row, column], run.load(joint)
            for phase in phases[1::2]:
                axes.axvspan(phase.start, phase.end, color="0.95", linewidth=0, zorder=0)
            axes.plot(load.t, 1e3 * load.torque(), color=COLOURS[JOINTS.index(joint)], linewidth=1.1)
            for end in run.envelope(joint):
                axes.axhline(1e3 * end, **LIMIT)
            label = f"joint {NUMBER[joint]} ({joint})\nmotor torque (mN·m)" if column == 0 else ""
            finish(axes, "time (s)" if row == len(DRIVEN) - 1 else "", label)
        panels[0, column].set_title(run.row.label, fontsize=SIZE)
    return figure
