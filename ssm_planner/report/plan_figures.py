"""Figures of a plan: the motion with its limits, and what it requires of the motors."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ssm_planner.export.atomic import replacing
from ssm_planner.plan import Plan
from ssm_planner.problem.values import Array
from ssm_planner.report.style import COLOURS, DASHES, LIMIT, SIZE, finish, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SAMPLES = 1200
DPI = 110


def write_figures(plan: Plan, folder: Path) -> dict[str, Path]:
    """motion.png and motors.png; returns their paths by name."""
    if plan.trajectory is None:
        return {}
    paths = {}
    for name, figure in (("motion", motion_figure(plan)), ("motors", motors_figure(plan))):
        paths[f"{name}_figure"] = folder / f"{name}.png"
        with replacing(paths[f"{name}_figure"]) as temporary:
            figure.savefig(temporary, dpi=DPI, format="png")
    return paths


def motion_figure(plan: Plan) -> Figure:
    """Joint positions, velocities and accelerations over time, revolute left, translation right, limits dashed."""
    assert plan.trajectory is not None
    trajectory, robot = plan.trajectory, plan.problem.robot
    t = np.linspace(0.0, trajectory.duration, SAMPLES)
    samples = trajectory.sample(t)
    figure = new_figure(9.0, 6.2)
    panels = figure.subplots(3, 2, sharex=True)
    rows = (("q", "position", "", None), ("qd", "velocity", "/s", "velocity"), ("qdd", "acceleration", "/s²", "acceleration"))
    for row, (field, name, per, limit) in enumerate(rows):
        for column, (kind, unit, scale) in enumerate((("revolute", "°", 180 / np.pi), ("prismatic", "mm", 1e3))):
            axes = panels[row, column]
            _phases(axes, plan)
            for i, joint in enumerate(robot.joints):
                if joint.kind != kind:
                    continue
                axes.plot(t, scale * getattr(samples, field)[:, i], DASHES[i], color=COLOURS[i], label=_label(plan, i))
                if limit is not None:
                    for side in (1, -1):
                        axes.axhline(side * scale * getattr(joint, limit), **LIMIT)
            finish(axes, "time (s)" if row == 2 else "", f"{name} ({unit}{per})")
    for column in (0, 1):
        panels[0, column].legend(fontsize=SIZE - 1, frameon=False, loc="best")
    return figure


def motors_figure(plan: Plan) -> Figure:
    """Motor torque over time and against speed for every driven joint; a limit is drawn where it is near."""
    assert plan.trajectory is not None
    requirements = plan.requirements
    figure = new_figure(9.0, 2.2 * len(requirements) + 0.2)
    panels = figure.subplots(len(requirements), 2, squeeze=False, sharey="row")
    names = [joint.name for joint in plan.problem.robot.joints]
    for row, requirement in enumerate(requirements):
        i = names.index(requirement.joint)
        torque = 1e3 * requirement.torque
        over_time, against_speed = panels[row]
        _phases(over_time, plan)
        over_time.plot(requirement.t, torque, color=COLOURS[i], label="torque")
        rms = 1e3 * requirement.rms_torque
        over_time.axhline(rms, color="0.2", linewidth=1.0, linestyle=":", label=f"RMS {rms:.3g} mN·m")
        against_speed.plot(requirement.speed * 30 / np.pi, torque, color=COLOURS[i])
        over_time.legend(fontsize=SIZE - 1, frameon=False, loc="best", ncols=2)
        last = row == len(requirements) - 1
        finish(over_time, "time (s)" if last else "", f"{_label(plan, i)}\nmotor torque (mN·m)")
        finish(against_speed, "motor speed (rpm)" if last else "", "")
        against_speed.set_title(_limit_text(requirement.motor), fontsize=SIZE - 1, loc="right", pad=2)
    return figure


def _limit_text(motor: object) -> str:
    from ssm_planner.problem.values import Motor

    if not isinstance(motor, Motor):
        return "no motor given"
    mark = " — placeholder figures" if motor.placeholder else ""
    return f"{motor.name}: nominal {1e3 * motor.nominal_torque:.3g}, largest {1e3 * motor.max_torque:.3g} mN·m{mark}"


def _label(plan: Plan, i: int) -> str:
    return f"joint {i + 1} ({plan.problem.robot.joints[i].name})"


def _phases(axes: Axes, plan: Plan) -> None:
    """Shade every other phase and name it at the top."""
    assert plan.trajectory is not None
    for k, phase in enumerate(plan.trajectory.phases):
        if k % 2:
            axes.axvspan(phase.start, phase.end, color="0.95", zorder=0, linewidth=0)


def _margin(values: Array) -> float:
    return float(np.ptp(values)) * 0.05
