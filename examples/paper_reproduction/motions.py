"""Compute motor torques of complete motions, for Table III and for the payload curves."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from paper_reproduction import published
from paper_reproduction.friction import with_rows
from paper_reproduction.published import (
    DRIVEN,
    NUMBER,
    PACKAGE_FRICTION,
    TABLE_II,
    TABLE_III,
    FrictionRow,
    Inputs,
    SpeedRow,
)
from paper_reproduction.section import Section
from paper_reproduction.tilt_rate import tilt_rate_bound
from ssm_planner.kinematics import Mechanism, joint_speed_per_tilt_speed, task_rates
from ssm_planner.pipeline.run import plan
from ssm_planner.plans import Plan
from ssm_planner.problem import (
    JOINTS,
    TASK_COORDINATES,
    Free,
    Motorisation,
    Problem,
    Robot,
    Straight,
    Stroke,
    Task,
)
from ssm_planner.reporting import (
    COLOURS,
    FONT_SIZE,
    LIMIT_STYLE,
    finish_axes,
    new_figure,
    payload_curves_figure,
    shade_phases,
)
from ssm_planner.sizing import DutyCycle, JointLoad, MotorRequirement, joint_loads
from ssm_planner.sizing.size import Sizing, size
from ssm_planner.typing import Range, record
from ssm_planner.units import RPM

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@record
class SpeedRun:
    """Planned motion of one row of Table III, with the loads of its drives."""

    row: SpeedRow
    """Row of the table."""
    plan: Plan
    """Motion within the speeds of this row."""
    loads: tuple[JointLoad, ...]
    """Loads of the driven joints. Empty if no motion was found."""

    def envelope(self, joint: str) -> Range:
        """Return the smallest and the largest motor torque of a joint while it moves, N·m."""
        load = self.load(joint)
        torque = load.torque()[load.direction != 0]
        return float(torque.min()), float(torque.max())

    def load(self, joint: str) -> JointLoad:
        """Return the load of the joint with this name."""
        return next(load for load in self.loads if load.joint == joint)

    def top_speed(self, joint: str) -> float:
        """Return the largest motor speed of a joint, rpm."""
        return RPM * float(np.abs(self.load(joint).speed()).max())

    def tilt_rate(self, robot: Robot) -> float:
        """Return the largest tilt rate of the motion in rad/s, or NaN without a motion."""
        if self.plan.trajectory is None:
            return math.nan
        samples = self.plan.trajectory.uniform(1000.0)
        rates = task_rates(Mechanism.from_robot(robot), samples.q, samples.qd)
        return float(np.abs(rates[:, TASK_COORDINATES.index("tilt")]).max())

    def reaches(self) -> bool:
        """Return True if a rotary joint and joint 4 both reach the speeds of the row."""
        trajectory = self.plan.trajectory
        if trajectory is None:
            return False
        speeds = np.abs(trajectory.uniform(1000.0).qd).max(axis=0)
        return bool(
            speeds[:3].max() > 0.999 * self.row.tilt and speeds[3] > 0.999 * self.row.insertion
        )


def at_speeds(problem: Problem, row: SpeedRow) -> Problem:
    """Return a problem whose joint velocities are limited to the speeds of a row of Table III."""
    speed = {"revolute": row.tilt, "prismatic": row.insertion}
    joint1, joint2, joint3, joint4 = (
        replace(joint, velocity=speed[joint.kind]) for joint in problem.robot.joints
    )
    robot = replace(problem.robot, joints=(joint1, joint2, joint3, joint4))
    return replace(problem, name=f"Table III, {row.label}", robot=robot)


def speed_runs(
    problem: Problem, progress: Callable[[str], None] = lambda _: None
) -> tuple[SpeedRun, ...]:
    """Plan the motion of each row of Table III within the published accelerations.

    `progress` is called with a text before each row.
    """
    runs = []
    for row in TABLE_III:
        progress(f"Table III: {row.label}")
        limited = at_speeds(problem, row)
        outcome = plan(limited)
        loads = () if outcome.trajectory is None else joint_loads(outcome.trajectory, limited.robot)
        runs.append(SpeedRun(row, outcome, loads))
    return tuple(runs)


def tilts_of(problem: Problem) -> Range:
    """Return the smallest and the largest tilt among the points of a problem, rad."""
    values = _values(problem, "tilt")
    return min(values), max(values)


def depth_of(problem: Problem) -> float:
    """Return the largest depth among the points of a problem, m."""
    return max(_values(problem, "depth"))


def _values(problem: Problem, name: str) -> list[float]:
    """Return the values of a task coordinate at the start and at the targets of a problem."""
    points = [
        problem.start,
        *(motion.to for motion in problem.motion if isinstance(motion, (Straight, Free))),
    ]
    return [
        point.set_coordinates[name]
        for point in points
        if isinstance(point, Task) and name in point.set_coordinates
    ]


def motions_section(problem: Problem, runs: tuple[SpeedRun, ...]) -> Section:
    """Build the section about Table III from the planned motions."""
    mechanism = Mechanism.from_robot(problem.robot)
    allowed = problem.robot.ranges["tilt"]
    tilts = tilts_of(problem)
    limit = published.ROTARY_ACCELERATION
    per_tilt = np.abs(
        joint_speed_per_tilt_speed(mechanism, np.linspace(*tilts, 501), mechanism.home_branch)
    )
    values = {
        "runs": runs,
        "robot": problem.robot,
        "tilts": tilts,
        "depth": depth_of(problem),
        "fastest": per_tilt.max(axis=0),
        "slowest": per_tilt[:, 1].min(),
        "bound": tilt_rate_bound(mechanism, tilts, limit),
        "allowed": allowed,
        "allowed_bound": tilt_rate_bound(mechanism, allowed, limit),
        "reached": sum(run.reaches() for run in runs),
        "passed": sum(run.plan.passed for run in runs),
    }
    solved = tuple(run for run in runs if run.loads)
    return Section("motions", values, {"motions": _plot(solved)} if solved else {})


def _plot(runs: tuple[SpeedRun, ...]) -> "Figure":
    """Draw the motor torques of all motions over time."""
    figure = new_figure(9.6, 5.6)
    panels = figure.subplots(len(DRIVEN), len(runs), sharex="col", sharey="row", squeeze=False)
    for column, run in enumerate(runs):
        for row, joint in enumerate(DRIVEN):
            axes = panels[row, column]
            load = run.load(joint)
            shade_phases(axes, run.plan.motion)
            axes.plot(
                load.t, 1e3 * load.torque(), color=COLOURS[JOINTS.index(joint)], linewidth=1.1
            )
            for end in run.envelope(joint):
                axes.axhline(1e3 * end, **LIMIT_STYLE)
            label = f"joint {NUMBER[joint]} ({joint})\nmotor torque (mN·m)" if column == 0 else ""
            finish_axes(axes, "time (s)" if row == len(DRIVEN) - 1 else "", label)
        panels[0, column].set_title(run.row.label, fontsize=FONT_SIZE)
    return figure


RUNS = {"paper": "the paper's speeds", "package": "the package's speeds"}
"""Names of the runs by file name."""


@record
class Payload:
    """Sizing of one motorisation, with the friction of Table II and with that of the package."""

    run: Motorisation
    """Strokes of the joints."""
    identified: Sizing
    """Required torques with the friction of Table II."""
    package: Sizing
    """Required torques with the friction of the package."""

    def rows(self) -> Iterator[tuple[str, MotorRequirement, MotorRequirement]]:
        """Yield the label of every stroke, and its motor requirements for both frictions."""
        for stroke, ours, theirs in zip(
            self.run.strokes, self.identified.joints, self.package.joints, strict=True
        ):
            yield _label(stroke), ours.requirement, theirs.requirement


def payloads(inputs: Inputs) -> tuple[Payload, ...]:
    """Size both motorisations with both frictions."""
    return tuple(
        Payload(run, _sized(run, TABLE_II), _sized(run, PACKAGE_FRICTION))
        for run in inputs.motorisations.values()
    )


def payload_section(results: tuple[Payload, ...]) -> Section:
    """Build the section about the payload curves."""
    figures = {
        "payload_curves_package": payload_curves_figure(results[0].package),
        "payload_curves_table_ii": payload_curves_figure(results[0].identified),
    }
    return Section("payload", {"payloads": results}, figures)


def _label(stroke: Stroke) -> str:
    """Return the label of a stroke, such as `joint 1, 65°/s, 200°/s²`."""
    scale, unit = (1e3, " mm") if stroke.joint == "insertion" else (180.0 / math.pi, "°")
    speed, acceleration = (
        f"{scale * value:.4g}{unit}" for value in (stroke.velocity, stroke.acceleration)
    )
    return f"joint {NUMBER[stroke.joint]}, {speed}/s, {acceleration}/s²"


def _sized(run: Motorisation, rows: Mapping[str, FrictionRow]) -> Sizing:
    """Size a motorisation with the friction of a published table, by joint."""
    return size(DutyCycle.of_motorisation(replace(run, robot=with_rows(run.robot, rows))))
