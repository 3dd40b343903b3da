"""What the page shows of the motors beyond torque and speed: regions, torque split and temperature."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ssm_planner.problem.motor import Motor
from ssm_planner.problem.robot import JOINTS
from ssm_planner.reporting.figures.style import RPM
from ssm_planner.reporting.html.panels import Panel, new_limit, new_panel
from ssm_planner.sizing.heat import FIGURES, Cycle, ThermalModel, steady_state
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.motor_limits import Conditions, available_torque, continuous_torque, missing
from ssm_planner.sizing.torque_breakdown import PARTS, torque_split
from ssm_planner.typing import Array

CELSIUS = 273.15
TEMPERATURE = "Temperature, the motion repeated without pause in surroundings of 25\N{NO-BREAK SPACE}°C"
POINTS = 81


def split_channels(loads: Sequence[JointLoad], t: Array) -> dict[str, Array]:
    """Parts of each motor's torque at t (n,), N·m, by name such as "split0_load"."""
    return {
        f"split{JOINTS.index(load.joint)}_{name}": np.interp(t, load.t - load.t[0], part)
        for load in loads
        for name, part in torque_split(load).parts()
    }


def temperature_channels(loads: Sequence[JointLoad], t: Array) -> dict[str, Array]:
    """Winding and housing, °C, of the motors whose file has the figures, once the repeated motion is in its steady state."""
    channels = {}
    for load in loads:
        if load.motor is None or missing(load.motor, *FIGURES):
            continue
        cycle = Cycle.from_torque(load.t, load.torque())
        found = steady_state(ThermalModel.from_motor(load.motor, Conditions().ambient), cycle)
        if found.steady:
            for name, values in (("winding", found.winding), ("housing", found.housing)):
                channels[f"{name}{JOINTS.index(load.joint)}"] = np.interp(t, cycle.t, values) - CELSIUS
    return channels


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
