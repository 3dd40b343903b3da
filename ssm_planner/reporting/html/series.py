"""What the page plots: channels sampled in time, and panels that say which channels stand together with which limits."""

from __future__ import annotations

import base64

import numpy as np

from ssm_planner.formats.plan_json import PlanFile
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.problem.robot import JOINTS, Joint
from ssm_planner.reporting.html.motors import split_channels, split_panels, temperature_channels, temperature_panels
from ssm_planner.reporting.html.panels import Panel, in_display_units, mark_active, new_limit, new_panel
from ssm_planner.reporting.html.tool import tool_channels, tool_panels
from ssm_planner.sizing.joint_load import joint_loads
from ssm_planner.typing import Array

RATE, FEWEST, MOST = 400.0, 1200, 4000
"""Samples per second of motion, and how many a page holds."""
LOAD_RATE = 500.0
"""Hz at which the motors are computed, besides every instant at which a torque jumps."""


def time_grid(duration: float) -> Array:
    """Instants (n,) at which a page shows a motion of this duration, s."""
    return np.linspace(0.0, duration, int(np.clip(RATE * duration, FEWEST, MOST)))


def channels_of(plan: PlanFile, t: Array) -> dict[str, Array]:
    """Every plotted quantity at t (n,), SI, by name such as "qd2" (joint index); after the plan's end its last value."""
    trajectory = plan.trajectory
    samples = trajectory.sample(trajectory.breaks[0] + np.minimum(t, trajectory.duration))
    channels = {"t": t, **tool_channels(Mechanism.from_geometry(plan.robot.geometry), samples, plan.limits)}
    for name in ("q", "qd", "qdd", "qddd"):
        channels |= {f"{name}{i}": getattr(samples, name)[:, i] for i in range(4)}
    loads = joint_loads(trajectory, plan.robot, LOAD_RATE)
    for load in loads:
        i = JOINTS.index(load.joint)
        for name, values in (("w", load.speed()), ("tau", load.torque())):
            channels[f"{name}{i}"] = np.interp(t, load.t - load.t[0], values)
    return channels | split_channels(loads, t) | temperature_channels(loads, t)


def panels_of(plan: PlanFile, channels: dict[str, Array]) -> list[Panel]:
    """Panels in the order of the page, each with its channels, limits and the stretches where these are active."""
    joints = plan.robot.joints
    kinds = [(kind, [i for i, joint in enumerate(joints) if joint.kind == kind]) for kind in ("revolute", "prismatic")]
    tool = tool_panels(plan.limits)
    panels = [panel for panel in tool if panel["section"] == "Task coordinates"]
    for field, title, per, key in (
        ("q", "Position", "", "position"),
        ("qd", "Velocity", "/s", "velocity"),
        ("qdd", "Acceleration", "/s²", "acceleration"),
        ("qddd", "Jerk", "/s³", "jerk"),
    ):
        for kind, which in kinds:
            if which:
                panels.append(_joint_panel(joints, field, title, per, key, kind, which))
    panels += [panel for panel in tool if panel not in panels]
    panels += _motor_panels(joints, channels)
    panels += split_panels(channels)
    panels += temperature_panels(
        channels, {i: joint.motor for i, joint in enumerate(joints) if joint.motor is not None}
    )
    for panel in panels:
        mark_active(panel, channels)
        in_display_units(panel)
    return panels


def _joint_panel(
    joints: tuple[Joint, ...], field: str, title: str, per: str, key: str, kind: str, which: list[int]
) -> Panel:
    base = "rad" if kind == "revolute" else "m"
    named = ", ".join(joints[i].name for i in which)
    panel = new_panel("Joints", f"{title}: {named}", base + per, [(f"{field}{i}", joints[i].name, i) for i in which])
    unlimited = []
    for i in which:
        allowed = getattr(joints[i], key)
        if allowed is None:
            unlimited.append(joints[i].name)
            continue
        low, high = allowed if key == "position" else (-allowed, allowed)
        panel["limits"].append(new_limit(key, joints[i].name, i, low, high, f"{field}{i}"))
    if unlimited:
        panel["missing"].append(f"no {key} limit" + (f": {', '.join(unlimited)}" if panel["limits"] else ""))
    return panel


def _motor_panels(joints: tuple[Joint, ...], channels: dict[str, Array]) -> list[Panel]:
    panels = []
    driven = [i for i in range(4) if f"tau{i}" in channels]
    for name, title, unit in (("w", "Motor speed", "rpm"), ("tau", "Motor torque", "N·m")):
        for i in driven:
            joint, motor = joints[i], joints[i].motor
            panel = new_panel("Motors", f"{title}: {joint.name}", unit, [(f"{name}{i}", joint.name, i)])
            if motor is None:
                panel["missing"].append("no motor given")
            else:
                largest = motor.max_speed if name == "w" else motor.max_torque
                panel["limits"].append(new_limit(title.lower(), joint.name, i, -largest, largest, f"{name}{i}"))
            if motor is not None and name == "tau":
                nominal = motor.nominal_torque
                panel["limits"].append(new_limit("nominal torque", joint.name, i, -nominal, nominal, None))
            panels.append(panel)
    return panels


def encoded(channels: dict[str, Array]) -> dict[str, str]:
    """Channels as base64 of little-endian doubles: exact, and quick to read in a browser."""
    return {
        name: base64.b64encode(np.ascontiguousarray(values, dtype="<f8").tobytes()).decode("ascii")
        for name, values in channels.items()
    }
