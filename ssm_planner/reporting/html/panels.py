"""Build the panels of a page: series, limits, and intervals in which limits are active."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ssm_planner.plans import Plan
from ssm_planner.problem.limits import (
    TASK,
    JointAcceleration,
    JointJerk,
    JointPosition,
    JointVelocity,
    Limit,
    MotorSpeed,
    MotorTorque,
    RetinaClearance,
    SpeedLimit,
    TaskRange,
    TaskRate,
)
from ssm_planner.problem.motor import Motor
from ssm_planner.problem.problem import Eye, TaskLimits
from ssm_planner.problem.robot import JOINTS, Joint
from ssm_planner.reporting.figures.style import unit_of
from ssm_planner.reporting.html.channels import CELSIUS, limited_speeds
from ssm_planner.sizing.motor_limits import Conditions, available_torque, continuous_torque, missing
from ssm_planner.sizing.requirements import PARTS
from ssm_planner.sizing.thermal_network import FIGURES
from ssm_planner.typing import Array
from ssm_planner.units import RPM

Panel = dict[str, Any]
T = TypeVar("T", TaskRange, TaskRate)
NEAR = 0.005
"""Tolerance for an active limit, relative to the limit or to a range's half width."""
GAP = 0.01
"""Active intervals with a smaller gap than this (s) are merged."""
GROUPS = (([0, 1, 2], "rad", "Task: roll, tilt, spin"), ([3], "m", "Task: depth"))
TEMPERATURE = "Steady-state temperature of the repeated motion at 25\N{NO-BREAK SPACE}°C ambient"
POINTS = 81


def panels_of(plan: Plan, channels: dict[str, Array]) -> list[Panel]:
    """Return the panels in the order of the page, with channels, limits and active intervals.

    channels: arrays (n,) by name.
    """
    joints = plan.robot.joints
    kinds = [
        (kind, [i for i, joint in enumerate(joints) if joint.kind == kind])
        for kind in ("revolute", "prismatic")
    ]
    tool = tool_panels(plan.limits)
    panels = [panel for panel in tool if panel["section"] == "Task coordinates"]
    fields = (
        ("q", "", JointPosition),
        ("qd", "/s", JointVelocity),
        ("qdd", "/s²", JointAcceleration),
    )
    for field, per, limited in (*fields, ("qddd", "/s³", JointJerk)):
        for kind, which in kinds:
            # Without a jerk limit the acceleration jumps, and its derivative would be solver noise.
            if which and (
                limited is not JointJerk or any(joints[i].jerk is not None for i in which)
            ):
                unit = ("rad" if kind == "revolute" else "m") + per
                panels.append(_joint_panel([(i, joints[i]) for i in which], field, unit, limited))
    panels += [panel for panel in tool if panel not in panels]
    panels += _motor_panels(joints, channels)
    panels += split_panels(channels)
    panels += temperature_panels(
        channels, {i: j.motor for i, j in enumerate(joints) if j.motor is not None}
    )
    for panel in panels:
        mark_active(panel, channels)
        in_display_units(panel)
    return panels


def new_panel(section: str, title: str, unit: str, series: list[tuple[str, str, int]]) -> Panel:
    """Return an empty panel.

    series: (channel, label, colour index). unit: SI unit, or "rpm" for values in rad/s.
    """
    return {
        "section": section,
        "title": title,
        "unit": unit,
        "series": [
            {"channel": channel, "label": label, "joint": joint} for channel, label, joint in series
        ],
        "limits": [],
        "missing": [],
        "active": [],
    }


def new_limit(
    name: str,
    of: str,
    index: int,
    low: float,
    high: float,
    channel: str | None,
    size: float | None = None,
) -> dict[str, Any]:
    """Return a limit as the page reads it.

    Parameters
    ----------
    name : str
    of : str
        Joint or coordinate.
    index : int
        Index of the colour.
    low, high : float
    channel : str or None
        Channel for which active intervals are marked.
    size : float, optional
        Reference of the margin. The default is the limit itself, or the width of a range.
    """
    ends = {"low": low, "high": high, "channel": channel, "size": size}
    return {
        "name": name,
        "of": of,
        "label": f"{name}, {of}" if of else name,
        "joint": index,
        **ends,
    }


def limit_line(limit: Limit, index: int, channel: str) -> dict[str, Any]:
    """Return a limit as the page draws it. index: index of the colour."""
    low = -np.inf if isinstance(limit, SpeedLimit) else limit.low  # A speed is never negative.
    size = limit.half_width if isinstance(limit, RetinaClearance) else None
    of = limit.coordinate if isinstance(limit, TaskRange) else limit.joint or ""
    line = new_limit(
        limit.name, of, index=index, low=low, high=limit.high, channel=channel, size=size
    )
    # The name of a range contains its coordinate.
    return {**line, "label": limit.name} if isinstance(limit, TaskRange) else line


def mark_active(panel: Panel, channels: dict[str, Array]) -> None:
    """Add the intervals in which a limit on one of the channels (n,) is active."""
    for limit in panel["limits"]:
        if limit["channel"] is None:
            continue
        values, low, high = channels[limit["channel"]], limit["low"], limit["high"]
        for start, end, side in active_stretches(channels["t"], values, low, high, limit["size"]):
            stretch = {"start": start, "end": end, "side": side, "value": high if side > 0 else low}
            names = {key: limit[key] for key in ("label", "name", "joint")}
            panel["active"].append({**names, **stretch})


def in_display_units(panel: Panel) -> None:
    """Convert limits and intervals to display units.

    The page scales the channels, which remain SI.
    """
    panel["unit"], panel["scale"] = unit_of(panel["unit"])
    for limit in panel["limits"]:
        for end in ("low", "high"):
            limit[end] = panel["scale"] * limit[end] if np.isfinite(limit[end]) else None
    for stretch in panel["active"]:
        stretch["value"] *= panel["scale"]


def active_stretches(
    t: Array, values: Array, low: float, high: float, size: float | None = None
) -> Iterator[tuple[float, float, int]]:
    """Yield (start, end, side) of each interval in which values (n,) are at a limit.

    t (n,): time, s. side: +1 at high and −1 at low. size: reference of the tolerance; the default
    is the limit itself.
    """
    for side, end in ((1, high), (-1, low)):
        if np.isfinite(end):
            near = NEAR * (abs(end) if size is None else size)
            if np.isfinite(low) and np.isfinite(high):
                near = NEAR / 2 * (high - low)
            with np.errstate(invalid="ignore"):
                active = side * (end - values) <= near
            for start, stop in _runs(t, active):
                yield start, stop, side


def _runs(t: Array, active: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return start and end time of each run of true values. Runs with short gaps are merged."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], active.astype(int), [0]))))
    runs: list[tuple[float, float]] = []
    for begin, stop in zip(edges[::2], edges[1::2], strict=True):
        start, end = float(t[begin]), float(t[stop - 1])
        if runs and start - runs[-1][1] < GAP:
            start = runs.pop()[0]
        runs.append((start, end))
    return runs


def limit_rows(limits: TaskLimits) -> list[tuple[str, str, str, str]]:
    """Return (limit, from, to, unit) of every limit on the tool."""
    entries = [
        (limit.name, limit.low, limit.high, limit.unit)
        for limit in limits.limits
        if isinstance(limit, TaskRange)
    ]
    rates = sorted(
        (r for r in limits.limits if isinstance(r, TaskRate)),
        key=lambda r: TASK.index(r.coordinate),
    )
    entries += [
        (limit.name, -np.inf, limit.high, limit.unit) for limit in (*rates, *limits.of_tool)
    ]
    eye = limits.eye
    if eye is not None:
        sizes = (f"radius {1e3 * eye.radius:g} mm", f"shaft radius {1e3 * eye.shaft_radius:g} mm")
        for limit, size in zip(eye.limits, sizes, strict=False):
            entries.append((f"{limit.name}, {size}", limit.low, limit.high, limit.unit))
    rows = []
    for name, low, high, si in entries:
        unit, scale = unit_of(si)
        start, end = (f"{scale * bound:.6g}" if np.isfinite(bound) else "" for bound in (low, high))
        rows.append((name, start, end, unit))
    return rows


def without_temperature(channels: dict[str, Array], motors: dict[int, Motor]) -> list[str]:
    """Return why the channels (n,) lack the temperatures of some motors."""
    reasons = []
    for i, motor in motors.items():
        if f"winding{i}" not in channels:
            missing_values = missing(motor, *FIGURES)
            reason = (
                f"the motor file gives no {', '.join(missing_values)}"
                if missing_values
                else "the motor overheats and has no steady state"
            )
            reasons.append(f"{JOINTS[i]}: {reason}".replace("_", " "))
    return reasons


def motor_map(i: int, motor: Motor) -> dict[str, Any]:
    """Return the largest and the continuous torque of a motor over its speed.

    Torques are in mN·m and speeds in rpm, at nominal voltage and 25 °C.
    """
    conditions = Conditions()
    speed = np.linspace(0.0, motor.max_speed, POINTS)
    largest = available_torque(motor, conditions, speed)
    continuous = np.minimum(largest, continuous_torque(motor, conditions.ambient) or 0.0)
    return {
        "joint": i,
        "motor": motor.name,
        "placeholder": motor.placeholder,
        "speed": (RPM * speed).tolist(),
        "largest": (1e3 * largest).tolist(),
        "continuous": (1e3 * continuous).tolist(),
    }


def _joint_panel(
    joints: list[tuple[int, Joint]],
    field: str,
    unit: str,
    limited: type[JointPosition | JointVelocity | JointAcceleration | JointJerk],
) -> Panel:
    """Build the panel of one derivative of the joints (index, joint) with limits of one kind."""
    title = f"{limited.name.capitalize()}: {', '.join(joint.name for _, joint in joints)}"
    panel = new_panel(
        "Joints", title, unit, [(f"{field}{i}", joint.name, i) for i, joint in joints]
    )
    unlimited = []
    for i, joint in joints:
        limit = next((bound for bound in joint.limits if isinstance(bound, limited)), None)
        if limit is None:
            unlimited.append(joint.name)
        else:
            panel["limits"].append(limit_line(limit, i, f"{field}{i}"))
    if unlimited:
        panel["missing"].append(
            f"no {limited.name} limit" + (f": {', '.join(unlimited)}" if panel["limits"] else "")
        )
    return panel


def _motor_panels(joints: tuple[Joint, ...], channels: dict[str, Array]) -> list[Panel]:
    panels = []
    driven = [i for i in range(4) if f"tau{i}" in channels]
    for name, limited, unit in (("w", MotorSpeed, "rpm"), ("tau", MotorTorque, "N·m")):
        for i in driven:
            joint, motor = joints[i], joints[i].motor
            title = f"{limited.name.capitalize()}: {joint.name}"
            panel = new_panel("Motors", title, unit, [(f"{name}{i}", joint.name, i)])
            if motor is None:
                panel["missing"].append("no motor given")
            else:
                panel["limits"].append(limit_line(joint.limit(limited), i, f"{name}{i}"))
            if motor is not None and name == "tau":
                nominal = motor.nominal_torque
                panel["limits"].append(
                    new_limit(
                        "nominal torque",
                        joint.name,
                        index=i,
                        low=-nominal,
                        high=nominal,
                        channel=None,
                    )
                )
            panels.append(panel)
    return panels


def split_panels(channels: dict[str, Array]) -> Iterator[Panel]:
    """Yield one panel per driven joint with a line for each part of the torque. channels: (n,)."""
    for i, joint in enumerate(JOINTS):
        if f"split{i}_{PARTS[0]}" in channels:
            series = [
                (f"split{i}_{name}", name.replace("_", " "), k) for k, name in enumerate(PARTS)
            ]
            yield new_panel("Parts of the motor torque", f"Torque split: {joint}", "N·m", series)


def temperature_panels(channels: dict[str, Array], motors: dict[int, Motor]) -> Iterator[Panel]:
    """Yield the winding and housing temperatures of each motor that has channels (n,) for them."""
    for i, motor in motors.items():
        series = [(f"winding{i}", "winding", 1), (f"housing{i}", "housing", 0)]
        if f"winding{i}" not in channels:
            continue
        panel = new_panel(TEMPERATURE, f"Motor of {JOINTS[i]}", "°C", series)
        if motor.max_winding_temperature is not None:
            high = motor.max_winding_temperature - CELSIUS
            panel["limits"] = [
                new_limit(
                    "winding temperature",
                    JOINTS[i],
                    index=1,
                    low=-np.inf,
                    high=high,
                    channel=f"winding{i}",
                )
            ]
        yield panel


def tool_panels(limits: TaskLimits) -> list[Panel]:
    """Return the panels of the tool. Rates appear only if they are limited."""
    panels = []
    for which, unit, title in GROUPS:
        panels.append(
            new_panel("Task coordinates", title, unit, [(f"task{i}", TASK[i], i) for i in which])
        )
        panels[-1]["limits"] = [
            limit_line(limit, TASK.index(limit.coordinate), f"task{TASK.index(limit.coordinate)}")
            for limit in _in_order(limits, TaskRange, which)
        ]
    for which, unit, _ in GROUPS:
        rates = _in_order(limits, TaskRate, which)
        if rates:
            heading = (
                rates[0].name.capitalize()
                if which == [3]
                else "Rate: " + ", ".join(r.coordinate for r in rates)
            )
            indices = [TASK.index(rate.coordinate) for rate in rates]
            series = [(f"task_rate{i}", TASK[i], i) for i in indices]
            panels.append(new_panel("Task coordinates", heading, f"{unit}/s", series))
            lines = zip(rates, indices, strict=True)
            panels[-1]["limits"] = [limit_line(rate, i, f"task_rate{i}") for rate, i in lines]
    for kind in limited_speeds(limits):
        limit = next((each for each in limits.speeds if type(each) is kind), None)
        panels.append(
            new_panel("Tool tip", kind.name.capitalize(), kind.unit, [(kind.field, "tip", 3)])
        )
        panels[-1]["limits"] = [] if limit is None else [limit_line(limit, 3, kind.field)]
    return panels if limits.eye is None else panels + _eye_panels(limits.eye)


def _in_order(limits: TaskLimits, kind: type[T], indices: list[int]) -> list[T]:
    """Return the limits of one kind on the selected coordinates, in the order of TASK."""
    by_coordinate = {limit.coordinate: limit for limit in limits.limits if isinstance(limit, kind)}
    return [by_coordinate[TASK[i]] for i in indices if TASK[i] in by_coordinate]


def _eye_panels(eye: Eye) -> list[Panel]:
    retina, *lens = eye.limits
    panels = [new_panel("Tool tip", "Tip to retina", retina.unit, [("retina", "tip", 3)])]
    panels[0]["limits"] = [limit_line(retina, 3, "retina")]
    panels[0]["missing"].append(
        f"in the port ({1e3 * eye.port:g} mm): {1e3 * eye.clearance:g} mm plus distance to its edge"
    )
    for limit in lens:
        panels.append(
            new_panel(
                "Tool tip", "Shaft to lens", "semi-axes from its centre", [("lens", "shaft", 3)]
            )
        )
        panels[1]["limits"] = [limit_line(limit, 3, "lens")]
    return panels
