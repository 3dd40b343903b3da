"""A motor file → Motor: slips of unit are found by holding its figures against each other."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from ssm_planner.loading.faults import located, validated
from ssm_planner.loading.schema.common import Figure, Text, Truth, figure, model_of
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.problem.motor import Motor
from ssm_planner.units import rpm

MotorModel = model_of(
    Motor,
    {
        "name": (Text, ...),
        "source": (Text | None, None),  # of every figure that names none of its own
        "placeholder": (Truth, False),  # every figure stands in for an unknown one
        "nominal_torque": "torque",
        "max_torque": "torque",
        "max_speed": "motor_speed",
        "nominal_voltage": "voltage",
        "nominal_current": "current",
        "torque_constant": "torque_constant",
        # only checks the torque constant
        "speed_constant": (Annotated[Figure, figure("speed_constant", above=0)] | None, None),
        # only checks torque constant, voltage and resistance
        "stall_torque": (Annotated[Figure, figure("torque", above=0)] | None, None),
        "terminal_resistance": "resistance",
        "rotor_inertia": "inertia",
        "resistance_winding_housing": "thermal_resistance",
        "resistance_housing_ambient": "thermal_resistance",
        "time_constant_winding": "time",
        "time_constant_motor": "time",
        "max_winding_temperature": "temperature",
        "torque_constant_per_kelvin": "number",
        "mass": "mass",
        "encoder_counts": "number",
    },
    figures=True,
)
"""What a motor file may say: the figures of a datasheet, each with its source."""

LARGEST_POWER = 2e3
"""W, nominal torque times largest speed, of a motor that moves a surgical tool."""
ACCELERATION = (1e2, 1e7)
"""Nominal torque by rotor inertia, rad/s²; small motors have 1e4 to 2e5."""
NO_LOAD_SPEED = (10.0, 2.5e4)
"""Nominal voltage by torque constant, rad/s."""
NOMINAL_RISE = (0.1, 4.0)
"""Temperature rise at nominal current by the rise that the winding may have; 1 in a consistent datasheet."""
REFERENCE_TEMPERATURE = 298.15
"""At which datasheets state resistance and torque constant, K."""
WINDING_TEMPERATURE = (330.0, 530.0)


def check_plausible(section: Section, values: Mapping[str, float]) -> None:
    """Raises ProblemError for a figure that the others show to be off by orders of magnitude; values: SI, by key."""
    _check_power(section, values)
    _check_voltage(section, values)
    _check_heat(section, values)


def _check_power(section: Section, values: Mapping[str, float]) -> None:
    torque = values["nominal_torque"]
    power = torque * values["max_speed"]
    if power > LARGEST_POWER:
        raise section.error(
            f"nominal_torque × max_speed is {power:.3g} W, implausible here: is the unit of torque mN*m, of speed rpm?",
            "nominal_torque",
            allowed=f"up to {LARGEST_POWER:g} W",
        )
    inertia = values.get("rotor_inertia")
    if inertia is not None and not ACCELERATION[0] <= torque / inertia <= ACCELERATION[1]:
        raise section.error(
            f"implausible beside nominal_torque, which would accelerate the rotor at {torque / inertia:.3g} rad/s^2: "
            "are the units right, g*cm^2 and mN*m?",
            "rotor_inertia",
            allowed=f"{torque / ACCELERATION[1]:.3g} to {torque / ACCELERATION[0]:.3g} kg*m^2",
        )


def _check_voltage(section: Section, values: Mapping[str, float]) -> None:
    voltage, constant = values.get("nominal_voltage"), values.get("torque_constant")
    if voltage is None or constant is None:
        return
    speed = voltage / constant
    if not NO_LOAD_SPEED[0] <= speed <= NO_LOAD_SPEED[1]:
        raise section.error(
            f"implausible beside nominal_voltage: the motor would idle at {speed / rpm:.3g} rpm: "
            "is the unit right, mN*m/A?",
            "torque_constant",
            allowed=f"{voltage / NO_LOAD_SPEED[1]:.3g} to {voltage / NO_LOAD_SPEED[0]:.3g} N*m/A",
        )
    stall, resistance = values.get("stall_torque"), values.get("terminal_resistance")
    if stall is None or resistance is None:
        return
    expected = constant * voltage / resistance
    if abs(stall / expected - 1) > STALL_AGREEMENT:
        raise section.error(
            f"contradicts torque_constant × nominal_voltage / terminal_resistance = {expected * 1e3:.4g} mN*m by more "
            f"than {100 * STALL_AGREEMENT:g} %",
            "stall_torque",
            allowed="figures of one datasheet and one winding",
        )


def _check_heat(section: Section, values: Mapping[str, float]) -> None:
    limit = values.get("max_winding_temperature")
    if limit is not None and not WINDING_TEMPERATURE[0] <= limit <= WINDING_TEMPERATURE[1]:
        raise section.error(
            "implausible for a winding: is the unit right, degC?",
            "max_winding_temperature",
            allowed=f"{WINDING_TEMPERATURE[0] - 273.15:.0f} degC to {WINDING_TEMPERATURE[1] - 273.15:.0f} degC",
        )
    needed = ("nominal_current", "terminal_resistance", "resistance_winding_housing", "resistance_housing_ambient")
    if limit is None or any(name not in values for name in needed):
        return
    current, resistance, inner, outer = (values[name] for name in needed)
    share = current**2 * resistance * (inner + outer) / (limit - REFERENCE_TEMPERATURE)
    if not NOMINAL_RISE[0] <= share <= NOMINAL_RISE[1]:
        raise section.error(
            f"implausible: at nominal_current the winding would warm by {100 * share:.3g} % of what "
            "max_winding_temperature allows; a datasheet has about 100 %: are all units right, of one winding?",
            "terminal_resistance",
            allowed=f"{NOMINAL_RISE[0] * resistance / share:.3g} to {NOMINAL_RISE[1] * resistance / share:.3g} ohm",
        )


LARGEST_TORQUE = 5.0
"""N·m, of a motor that moves a surgical tool; a larger figure has lost its milli."""
SMALLEST_TORQUE = 1e-6
TORQUE_AGREEMENT = 0.35
"""Torque constant times nominal current against nominal torque: the rest are losses, up to 25 % in small fast motors."""
CONSTANT_AGREEMENT = 0.1
"""Torque constant times speed constant, which is 1 in SI."""
STALL_AGREEMENT = 0.1
"""Stall torque against torque constant × voltage / resistance; of 641 product pages 95 % agree within 0.5 %."""


def motor_from(section: Section) -> Motor:
    """The motor that a section describes. Raises ProblemError."""
    model = validated(section, MotorModel)
    figures = dict(model.figures())
    values = {name: each.value for name, each in figures.items()}
    for name, each in figures.items():
        if each.source is None and model.source is None:
            raise section.error(
                "no source", name, allowed="{value: …, source: …}, or one source: for the whole file", show=False
            )
    _check(section, values)
    check_plausible(section, values)
    sources = {name: each.source or model.source or "" for name, each in figures.items()}
    placeholders = tuple(name for name, each in figures.items() if model.placeholder or each.placeholder)
    for name in ("speed_constant", "stall_torque"):
        values.pop(name, None)
    counts = values.get("encoder_counts")
    if counts is not None and counts.is_integer():
        values["encoder_counts"] = int(counts)
    with located(section):
        return Motor(
            name=model.name,
            sources=sources,
            placeholders=placeholders,
            file=None if section.file is None else str(section.file),
            **values,
        )


def _check(section: Section, values: dict[str, float]) -> None:
    nominal, largest = values["nominal_torque"], values["max_torque"]
    for name in ("nominal_torque", "max_torque"):
        if not SMALLEST_TORQUE <= values[name] <= LARGEST_TORQUE:
            raise section.error(
                f"implausible for a motor of this size ({values[name]:g} N*m): is the unit right, mN*m?",
                name,
                allowed=f"{SMALLEST_TORQUE * 1e3:g} mN*m to {LARGEST_TORQUE:g} N*m",
            )
    if largest > 100 * nominal:
        raise section.error(
            "more than 100 times nominal_torque: is the unit right?", "max_torque", allowed=f"{nominal:g} N*m upwards"
        )
    constant, current = values.get("torque_constant"), values.get("nominal_current")
    if constant is not None and current is not None and abs(constant * current / nominal - 1) > TORQUE_AGREEMENT:
        raise section.error(
            f"contradicts torque_constant × nominal_current = {constant * current * 1e3:.4g} mN*m by more than "
            f"{100 * TORQUE_AGREEMENT:g} %",
            "nominal_torque",
            allowed="figures of one datasheet and one winding",
        )
    speed = values.get("speed_constant")
    if constant is not None and speed is not None and abs(constant * speed - 1) > CONSTANT_AGREEMENT:
        raise section.error(
            f"contradicts torque_constant, which gives {1 / constant / rpm:.4g} rpm/V",
            "speed_constant",
            allowed="speed constant = 1 / torque constant in SI",
        )
