"""Panels of the page: series that stand together, their limits, and the stretches where a limit is active."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ssm_planner.kinematics.eye import LENS, RETINA, lens_limit
from ssm_planner.plans import Plan
from ssm_planner.problem.motor import Motor
from ssm_planner.problem.problem import TASK, Eye, TaskLimits
from ssm_planner.problem.robot import JOINTS, Joint
from ssm_planner.reporting.figures.style import RPM, unit_of
from ssm_planner.reporting.html.channels import CELSIUS
from ssm_planner.sizing.motor_limits import Conditions, available_torque, continuous_torque, missing
from ssm_planner.sizing.requirements import PARTS
from ssm_planner.sizing.thermal_network import FIGURES
from ssm_planner.typing import Array, Range
from ssm_planner.verification.limits import INSERTION_SPEED, RATES

Panel = dict[str, Any]
NEAR = 0.005
"""A limit is active where the value is within this share of it, of a range within half this share of its width."""
GAP = 0.01
"""Stretches nearer to each other than this, s, are one."""
GROUPS = (([0, 1, 2], "rad", "Task: roll, tilt, spin"), ([3], "m", "Task: depth"))
RATE_NAMES = (*RATES, INSERTION_SPEED)
TEMPERATURE = "Temperature, the motion repeated without pause in surroundings of 25\N{NO-BREAK SPACE}°C"
POINTS = 81


def panels_of(plan: Plan, channels: dict[str, Array]) -> list[Panel]:
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


def new_panel(section: str, title: str, unit: str, series: list[tuple[str, str, int]]) -> Panel:
    """series: (channel, label, colour); unit: SI, or "rpm" for rad/s."""
    return {
        "section": section,
        "title": title,
        "unit": unit,
        "series": [{"channel": channel, "label": label, "joint": joint} for channel, label, joint in series],
        "limits": [],
        "missing": [],
        "active": [],
    }


def new_limit(
    name: str, joint: str, index: int, low: float, high: float, channel: str | None, size: float | None = None
) -> dict[str, Any]:
    """of: joint or coordinate; channel: the one whose active stretches are marked; None for a line that only orients.

    size: what margins are relative to, where that is not the limit itself or the width of the range.
    """
    return {"name": name, "of": joint, "joint": index, "low": low, "high": high, "channel": channel, "size": size}


def mark_active(panel: Panel, channels: dict[str, Array]) -> None:
    """Add the stretches in which a limit is active."""
    for limit in panel["limits"]:
        if limit["channel"] is None:
            continue
        own = limit["name"].removesuffix(" range") == limit["of"]
        label = limit["name"] if own or not limit["of"] else f"{limit['name']}, {limit['of']}"
        for start, end, side in active_stretches(
            channels["t"], channels[limit["channel"]], limit["low"], limit["high"], limit["size"]
        ):
            value = limit["high"] if side > 0 else limit["low"]
            stretch = {
                "label": label,
                "joint": limit["joint"],
                "start": start,
                "end": end,
                "side": side,
                "value": value,
            }
            panel["active"].append(stretch)


def in_display_units(panel: Panel) -> None:
    """Limits and stretches in the unit that is shown; channels stay SI and are scaled by the page."""
    panel["unit"], panel["scale"] = unit_of(panel["unit"])
    for limit in panel["limits"]:
        for end in ("low", "high"):
            limit[end] = panel["scale"] * limit[end] if np.isfinite(limit[end]) else None
    for stretch in panel["active"]:
        stretch["value"] *= panel["scale"]


def active_stretches(
    t: Array, values: Array, low: float, high: float, size: float | None = None
) -> Iterator[tuple[float, float, int]]:
    """(start, end, side) of each stretch of values (n,) at a limit; t (n,) in s, side +1 at high and −1 at low.

    size: of the limit, where it is not its value.
    """
    for side, end in ((1, high), (-1, low)):
        if np.isfinite(end):
            near = NEAR * (abs(end) if size is None else size)
            if np.isfinite(low) and np.isfinite(high):
                near = NEAR / 2 * (high - low)
            with np.errstate(invalid="ignore"):
                at = side * (end - values) <= near
            for start, stop in _runs(t, at):
                yield start, stop, side


def _runs(t: Array, at: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Start and end time of each run of true values, those close together joined."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], at.astype(int), [0]))))
    runs: list[tuple[float, float]] = []
    for first, after in zip(edges[::2], edges[1::2], strict=True):
        start, end = float(t[first]), float(t[after - 1])
        if runs and start - runs[-1][1] < GAP:
            start = runs.pop()[0]
        runs.append((start, end))
    return runs


def limit_rows(limits: TaskLimits) -> list[tuple[str, str, str, str]]:
    """(limit, from, to, unit) of everything that limits the tool."""
    found = [(f"{name} range", *ends, "m" if name == "depth" else "rad") for name, ends in limits.ranges.items()]
    for k, name in enumerate(TASK):
        if name in limits.rates:
            found.append((RATE_NAMES[k], -np.inf, limits.rates[name], "m/s" if name == "depth" else "rad/s"))
    if limits.tip_speed is not None:
        found.append(("tip speed", -np.inf, limits.tip_speed, "m/s"))
    eye = limits.eye
    if eye is not None:
        found.append((f"{RETINA}, radius {1e3 * eye.radius:g} mm", eye.clearance, np.inf, "m"))
        if eye.lens is not None:
            found.append((f"{LENS}, shaft radius {1e3 * eye.shaft_radius:g} mm", lens_limit(eye), np.inf, ""))
    rows = []
    for name, low, high, si in found:
        unit, scale = unit_of(si)
        start, end = (f"{scale * bound:.6g}" if np.isfinite(bound) else "" for bound in (low, high))
        rows.append((name, start, end, unit))
    return rows


def without_temperature(channels: dict[str, Array], motors: dict[int, Motor]) -> list[str]:
    """Why a motor has no temperature here."""
    reasons = []
    for i, motor in motors.items():
        if f"winding{i}" not in channels:
            lacking = missing(motor, *FIGURES)
            why = f"the motor file gives no {', '.join(lacking)}" if lacking else "no steady state, the motor overheats"
            reasons.append(f"{JOINTS[i]}: {why}".replace("_", " "))
    return reasons


def motor_map(i: int, motor: Motor) -> dict[str, Any]:
    """The motor's regions: largest and continuous torque (mN·m) over speed (rpm), at nominal voltage and 25 °C."""
    conditions = Conditions()
    speed = np.linspace(0.0, motor.max_speed, POINTS)
    largest = available_torque(motor, conditions, speed)
    lasting = np.minimum(largest, continuous_torque(motor, conditions.ambient) or 0.0)
    return {
        "joint": i,
        "motor": motor.name,
        "placeholder": motor.placeholder,
        "speed": (RPM * speed).tolist(),
        "largest": (1e3 * largest).tolist(),
        "continuous": (1e3 * lasting).tolist(),
    }


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


def split_panels(channels: dict[str, Array]) -> Iterator[Panel]:
    """One panel for each driven joint, a line for each part."""
    for i, joint in enumerate(JOINTS):
        if f"split{i}_{PARTS[0]}" in channels:
            series = [(f"split{i}_{name}", name.replace("_", " "), k) for k, name in enumerate(PARTS)]
            yield new_panel("What the motor torque is spent on", f"Torque split: {joint}", "N·m", series)


def temperature_panels(channels: dict[str, Array], motors: dict[int, Motor]) -> Iterator[Panel]:
    """Winding and housing of each motor; of one without the figures only what is missing."""
    for i, motor in motors.items():
        series = [(f"winding{i}", "winding", 1), (f"housing{i}", "housing", 0)]
        if f"winding{i}" not in channels:
            continue
        panel = new_panel(TEMPERATURE, f"Motor of {JOINTS[i]}", "°C", series)
        if motor.max_winding_temperature is not None:
            high = motor.max_winding_temperature - CELSIUS
            panel["limits"] = [new_limit("winding temperature", JOINTS[i], 1, -np.inf, high, f"winding{i}")]
        yield panel


def tool_panels(limits: TaskLimits) -> list[Panel]:
    """Panels of these channels; rates only where they are limited."""
    panels = []
    for which, unit, title in GROUPS:
        panels.append(new_panel("Task coordinates", title, unit, [(f"task{i}", TASK[i], i) for i in which]))
        panels[-1]["limits"] = _ranges(limits.ranges, which)
    for which, unit, _ in GROUPS:
        limited = [i for i in which if TASK[i] in limits.rates]
        if limited:
            named = "Insertion speed" if which == [3] else "Rate: " + ", ".join(TASK[i] for i in limited)
            series = [(f"task_rate{i}", TASK[i], i) for i in limited]
            panels.append(new_panel("Task coordinates", named, f"{unit}/s", series))
            panels[-1]["limits"] = [_rate(i, limits.rates[TASK[i]]) for i in limited]
    panels.append(new_panel("Tool tip", "Tip speed", "m/s", [("tip_speed", "tip", 3)]))
    if limits.tip_speed is not None:
        panels[-1]["limits"] = [new_limit("tip speed", "", 3, -np.inf, limits.tip_speed, "tip_speed")]
    return panels if limits.eye is None else panels + _eye_panels(limits.eye)


def _ranges(ranges: Mapping[str, Range], which: list[int]) -> list[dict[str, object]]:
    return [new_limit(f"{TASK[i]} range", TASK[i], i, *ranges[TASK[i]], f"task{i}") for i in which if TASK[i] in ranges]


def _rate(i: int, largest: float) -> dict[str, object]:
    return new_limit(RATE_NAMES[i], "", i, -largest, largest, f"task_rate{i}")


def _eye_panels(eye: Eye) -> list[Panel]:
    panels = [new_panel("Tool tip", "Tip to retina", "m", [("retina", "tip", 3)])]
    size = eye.radius - eye.clearance
    panels[0]["limits"] = [new_limit(RETINA, "", 3, eye.clearance, np.inf, "retina", size)]
    panels[0]["missing"].append(
        f"in the port ({1e3 * eye.port:g} mm): {1e3 * eye.clearance:g} mm plus the distance to its edge"
    )
    if eye.lens is not None:
        panels.append(new_panel("Tool tip", "Shaft to lens", "lens sizes", [("lens", "shaft", 3)]))
        panels[1]["limits"] = [new_limit(LENS, "", 3, lens_limit(eye), np.inf, "lens")]
    return panels
