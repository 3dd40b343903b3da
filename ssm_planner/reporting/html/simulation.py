"""A simulated playback on a page: the arm as simulated, a ghost, beside the planned one, with its tracking errors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.display import number
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.plans import Plan
from ssm_planner.problem.limits import MotorTorque
from ssm_planner.problem.robot import JOINTS
from ssm_planner.reporting.figures.style import COLOURS
from ssm_planner.reporting.html.channels import channels_of, encoded, time_grid
from ssm_planner.reporting.html.page import render, write_page
from ssm_planner.reporting.html.panels import (
    Panel,
    in_display_units,
    limit_line,
    new_limit,
    new_panel,
)
from ssm_planner.reporting.html.scene import scene_of
from ssm_planner.reporting.text import simulation_tables
from ssm_planner.simulation.simulate import SimulationResult
from ssm_planner.typing import Array

PLANNED, SIMULATED = range(2)
"""Sides of the page."""


def write_simulation_page(plan: Plan, result: SimulationResult, out: Path) -> Path:
    """Write the page of a playback of a plan. Raises ExportError."""
    return write_page(out, simulation_page(plan, result), plan.sha256)


def simulation_page(plan: Plan, result: SimulationResult) -> str:
    """The page of a playback of a plan as an HTML document."""
    verdict = [
        ("good" if result.passed else "bad", "passed" if result.passed else "not passed", "")
    ]
    losses = result.losses
    stands = f"{'the arm holds' if result.holds else 'the arm does not hold'}, the tip travels {1e3 * result.travel:.4f} mm"
    return render(
        "simulation.html",
        simulation_data(plan, result),
        title=f"{plan.problem.name} – simulated playback",
        name=plan.problem.name,
        robot=plan.robot.name,
        marks=[*verdict, *(("bad", "", reason) for reason in result.reasons)],
        notes=result.notes,
        tip=number(1e3 * result.tip_error, 4),
        loss=f"{stands} (power lost at {float(losses.time[losses.worst]):.3f} s)",
        tables=simulation_tables(result),
    )


def simulation_data(plan: Plan, result: SimulationResult) -> dict[str, Any]:
    """What the page's scripts read; both motions on one time grid, the plan held at its end."""
    if result.scenario.speed != 1.0:
        plan = replace(plan, trajectory=plan.motion.slower(result.scenario.speed))
    t = time_grid(float(result.time[-1]))
    channels = channels_of(plan, t), _simulated(plan, result, t)
    panels = list(_panels(plan, result))
    for panel in panels:
        in_display_units(panel)
    return {
        "duration": float(t[-1]),
        "ends": [plan.motion.duration, float(t[-1])],
        "names": ["planned", "simulated"],
        "colours": list(COLOURS),
        "joints": [{"name": joint.name, "kind": joint.kind} for joint in plan.robot.joints],
        "panels": panels,
        "scenes": [scene_of(plan.robot, plan.limits)] * 2,
        "channels": [encoded(each) for each in channels],
    }


def _simulated(plan: Plan, result: SimulationResult, t: Array) -> dict[str, Array]:
    """The simulated motion at t (n,), SI, by the names of `channels_of`; errors are simulated minus planned."""

    def at(values: Array) -> Array:
        return np.column_stack([np.interp(t, result.time, column) for column in values.T])

    q = at(result.q)
    tip = tip_position(Mechanism.from_geometry(plan.robot.geometry), q)
    channels = {"t": t, "tip_error": at(result.tip[:, None])[:, 0]}
    for name, values in (
        ("q", q),
        ("qd", at(result.qd)),
        ("error", at(result.q - result.planned)),
        ("tip", tip),
    ):
        channels |= {f"{name}{i}": values[:, i] for i in range(values.shape[1])}
    driven = [JOINTS.index(motor.joint) for motor in result.motors]
    return channels | {
        f"tau{i}": values for i, values in zip(driven, at(result.torque[:, driven]).T, strict=True)
    }


def _panels(plan: Plan, result: SimulationResult) -> list[Panel]:
    """Of the tip, then joint by joint the tracking error, then motor by motor the torque with its limit."""
    tip = _panel("Tracking error", "Tip, away from the plan", "m", "tip_error", (SIMULATED,))
    tip["limits"] = [
        new_limit("allowed", "", index=0, low=-np.inf, high=result.scenario.tip_error, channel=None)
    ]
    panels = [tip]
    for i, joint in enumerate(plan.robot.joints):
        unit = "rad" if joint.kind == "revolute" else "m"
        panels.append(_panel("Tracking error", joint.name, unit, f"error{i}", (SIMULATED,)))
    for motor in result.motors:
        i = JOINTS.index(motor.joint)
        panel = _panel("Motor torque", motor.joint, "N·m", f"tau{i}", (PLANNED, SIMULATED))
        panel["limits"] = [
            limit_line(each, i, f"tau{i}")
            for each in plan.robot.joints[i].limits
            if isinstance(each, MotorTorque)
        ]
        panels.append(panel)
    return panels


def _panel(section: str, title: str, unit: str, channel: str, sides: tuple[int, ...]) -> Panel:
    return {
        **new_panel(section, title, unit, [(channel, title, 0)]),
        "channel": channel,
        "sides": list(sides),
    }
