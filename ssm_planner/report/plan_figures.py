"""Figures of a plan: the motion with its limits, and what it requires of the motors."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ssm_planner.errors import ExportError
from ssm_planner.export.atomic import replacing
from ssm_planner.model.trajectory import Trajectory
from ssm_planner.plan import Plan
from ssm_planner.problem.values import Motor
from ssm_planner.report.style import COLOURS, DASHES, LIMIT, SIZE, finish, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SAMPLES = 1200
DPI = 110


def write_figures(plan: Plan, folder: Path) -> dict[str, Path]:
    """motion.png and motors.png; returns their paths by name."""
    paths = {}
    for name, figure in (("motion", motion_figure(plan)), ("motors", motors_figure(plan))):
        paths[f"{name}_figure"] = folder / f"{name}.png"
        with replacing(paths[f"{name}_figure"]) as temporary:
            figure.savefig(temporary, dpi=DPI, format="png")
    return paths


def motion_figure(plan: Plan) -> Figure:
    """Joint positions, velocities and accelerations over time, revolute left, translation right, limits dashed."""
    trajectory, robot = _trajectory(plan), plan.problem.robot
    t = np.linspace(0.0, trajectory.duration, SAMPLES)
    samples = trajectory.sample(t)
    figure = new_figure(9.0, 6.4)
    panels = figure.subplots(3, 2, sharex=True)
    rows = (
        ("q", "position", "", None),
        ("qd", "velocity", "/s", "velocity"),
        ("qdd", "acceleration", "/s²", "acceleration"),
    )
    for row, (field, name, per, limit) in enumerate(rows):
        for column, (kind, unit, scale) in enumerate((("revolute", "°", 180 / np.pi), ("prismatic", "mm", 1e3))):
            axes = panels[row, column]
            _phases(axes, plan, named=row == 0)
            for i, joint in enumerate(robot.joints):
                if joint.kind != kind:
                    continue
                axes.plot(t, scale * getattr(samples, field)[:, i], DASHES[i], color=COLOURS[i], label=_label(plan, i))
                for side in (1, -1) if limit else ():
                    axes.axhline(side * scale * getattr(joint, str(limit)), **LIMIT)
            finish(axes, "time (s)" if row == 2 else "", f"{name} ({unit}{per})")
    lines = [line for axes in panels[0] for line in axes.get_lines()]
    (limit_line,) = panels[1, 0].plot([], [], **LIMIT, label="limit")
    figure.legend(handles=[*lines, limit_line], loc="outside upper center", ncols=5, fontsize=SIZE, frameon=False)
    return figure


def motors_figure(plan: Plan) -> Figure:
    """Motor torque over time and against speed for every driven joint, with the RMS torque and the motor's figures."""
    requirements = plan.requirements
    figure = new_figure(9.0, 2.3 * len(requirements) + 0.2)
    panels = figure.subplots(len(requirements), 2, squeeze=False, sharey="row")
    names = [joint.name for joint in plan.problem.robot.joints]
    for row, requirement in enumerate(requirements):
        i = names.index(requirement.joint)
        torque = 1e3 * requirement.torque
        over_time, against_speed = panels[row]
        _phases(over_time, plan, named=row == 0)
        over_time.plot(requirement.t, torque, color=COLOURS[i])
        against_speed.plot(requirement.speed * 30 / np.pi, torque, color=COLOURS[i])
        rms = 1e3 * requirement.rms_torque
        for axes in (over_time, against_speed):
            axes.axhline(np.copysign(rms, requirement.mean_torque), color="0.3", linewidth=1.0, linestyle=":")
        last = row == len(requirements) - 1
        finish(over_time, "time (s)" if last else "", f"{_label(plan, i)}\nmotor torque (mN·m)")
        finish(against_speed, "motor speed (rpm)" if last else "", "")
        text = f"RMS {rms:.3g} (dotted), peak {1e3 * requirement.peak_torque:.3g} mN·m"
        against_speed.set_title(f"{text}\n{_limit_text(requirement.motor)}", fontsize=SIZE - 1, loc="right", pad=3)
    return figure


def _limit_text(motor: Motor | None) -> str:
    if motor is None:
        return "no motor given"
    mark = ", placeholder figures" if motor.placeholder else ""
    return f"{motor.name}{mark}: nominal {1e3 * motor.nominal_torque:.3g}, largest {1e3 * motor.max_torque:.3g} mN·m"


def _label(plan: Plan, i: int) -> str:
    return f"joint {i + 1} ({plan.problem.robot.joints[i].name})"


def _phases(axes: Axes, plan: Plan, named: bool) -> None:
    """Shade every other phase and, where asked for, name it above the panel."""
    for k, phase in enumerate(_trajectory(plan).phases):
        if k % 2:
            axes.axvspan(phase.start, phase.end, color="0.95", zorder=0, linewidth=0)
        if named:
            middle = (phase.start + phase.end) / 2
            axes.text(middle, 1.02, phase.name, transform=axes.get_xaxis_transform(), ha="center", fontsize=SIZE - 1)


def _trajectory(plan: Plan) -> Trajectory:
    if plan.trajectory is None:
        raise ExportError("there is no trajectory to draw: the problem has no plan")
    return plan.trajectory
