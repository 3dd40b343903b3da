"""Read motor files, and detect wrong units by comparing the values with each other."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, NoReturn

from pydantic import Field

from ssm_planner.loading.schema import (
    SOURCE,
    Figure,
    Truth,
    located,
    model_of,
    quantity,
    sourced_field,
    validated,
)
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.problem import Bound, Motor
from ssm_planner.units import rpm


def _check(quantity_kind: str, description: str) -> Any:
    """Return the type of a quantity that is only compared with other quantities of the file."""
    hint = Annotated[Figure, sourced_field(quantity(quantity_kind, Bound(above=0.0)))]
    return hint | None, Field(None, description=description)


CHECKS = {
    "speed_constant": _check(
        "speed_constant", "Speed constant. It only serves to check the torque constant."
    ),
    "stall_torque": _check(
        "torque", "Stall torque. It only serves to check torque constant, voltage and resistance."
    ),
}
MotorModel = model_of(
    Motor,
    {
        "source": SOURCE,
        "placeholder": (Truth, Field(False, description="True if every figure is a placeholder.")),
        **CHECKS,
    },
    sourced=True,
)
"""Model of a motor file: the figures of a datasheet, each with its source."""

TORQUE = (1e-6, 5.0)
"""Range of plausible torques of a motor for a surgical tool, N·m.

Larger values are usually in mN·m.
"""
LARGEST_POWER = 2e3
"""Largest plausible product of nominal torque and largest speed, W."""
ACCELERATION = (1e2, 1e7)
"""Range of plausible ratios of nominal torque to rotor inertia, rad/s².

Small motors have 1e4 to 2e5.
"""
NO_LOAD_SPEED = (10.0, 2.5e4)
"""Plausible ratio of nominal voltage to torque constant, rad/s."""
NOMINAL_RISE = (0.1, 4.0)
"""Range of plausible ratios of the temperature rise at nominal current to the permitted rise.

The ratio is 1 in a consistent datasheet.
"""
REFERENCE_TEMPERATURE = 298.15
"""Temperature at which datasheets state resistance and torque constant, K."""
WINDING_TEMPERATURE = (330.0, 530.0)
"""Range of plausible temperature limits of a winding, K."""
TORQUE_AGREEMENT = 0.35
"""Tolerance between the nominal torque and the torque constant times the nominal current.

Losses cause a difference of up to 25 % in small fast motors.
"""
CONSTANT_AGREEMENT = 0.1
"""Tolerance of the product of torque constant and speed constant, which is 1 in SI units."""
STALL_AGREEMENT = 0.1
"""Tolerance between stall torque and torque constant × voltage / resistance.

On 95 % of 641 product pages the difference is at most 0.5 %.
"""


def motor_from(section: Section) -> Motor:
    """Build the motor that a section describes.

    Raises ProblemError if a value is invalid, implausible or without a source.
    """
    model: Any = validated(section, MotorModel)
    sourced = model.sourced_figures()
    for name, entry in sourced.items():
        if entry.source is None and model.source is None:
            allowed = "{value: …, source: …}, or one source: for the whole file"
            raise section.error("no source", name, allowed=allowed, show=False)
    values = {name: entry.value for name, entry in sourced.items()}
    _check_torque(section, values)
    _check_constants(section, values)
    _check_heat(section, values)
    with located(section):
        return Motor(
            model.name,
            sources={name: entry.source or model.source for name, entry in sourced.items()},
            placeholders=tuple(
                name for name, entry in sourced.items() if model.placeholder or entry.placeholder
            ),
            file=section.file_name,
            **{name: value for name, value in values.items() if name not in CHECKS},
        )


def _check_torque(section: Section, values: Mapping[str, float]) -> None:
    """Raise ProblemError if torques, power or inertia are implausible for a small motor.

    `values` contains the quantities of the file by key, in SI units.
    """
    nominal = values["nominal_torque"]
    peak_torque = values["max_torque"]
    for name in ("nominal_torque", "max_torque"):
        if not TORQUE[0] <= values[name] <= TORQUE[1]:
            reason = f"implausible for such a motor ({values[name]:g} N*m): check the unit (mN*m)"
            raise section.error(
                reason, name, allowed=f"{TORQUE[0] * 1e3:g} mN*m to {TORQUE[1]:g} N*m"
            )
    if peak_torque > 100 * nominal:
        reason = "more than 100 times nominal_torque: check the unit"
        raise section.error(reason, "max_torque", allowed=f"{nominal:g} N*m upwards")
    power = nominal * values["max_speed"]
    if power > LARGEST_POWER:
        reason = (
            f"nominal_torque × max_speed is {power:.3g} W, which is implausible: "
            "check the units (mN*m, rpm)"
        )
        raise section.error(reason, "nominal_torque", allowed=f"up to {LARGEST_POWER:g} W")
    low, high = ACCELERATION
    if (
        inertia := values.get("rotor_inertia")
    ) is not None and not low <= nominal / inertia <= high:
        reason = (
            "implausible beside nominal_torque, which would accelerate the rotor at "
            f"{nominal / inertia:.3g} rad/s^2: check the units (g*cm^2, mN*m)"
        )
        allowed = f"{nominal / high:.3g} to {nominal / low:.3g} kg*m^2"
        raise section.error(reason, "rotor_inertia", allowed=allowed)


def _check_constants(section: Section, values: Mapping[str, float]) -> None:
    """Raise ProblemError if the torque constant contradicts the other electrical quantities.

    `values` contains the quantities of the file by key, in SI units.
    """
    constant = values.get("torque_constant")
    nominal = values["nominal_torque"]
    if constant is None:
        return
    current, speed, voltage = (
        values.get(name) for name in ("nominal_current", "speed_constant", "nominal_voltage")
    )
    if current is not None and abs(constant * current / nominal - 1) > TORQUE_AGREEMENT:
        _contradicts(
            section, "nominal_torque", "nominal_current", constant * current, TORQUE_AGREEMENT
        )
    if speed is not None and abs(constant * speed - 1) > CONSTANT_AGREEMENT:
        reason = f"contradicts torque_constant, which gives {1 / constant / rpm:.4g} rpm/V"
        raise section.error(
            reason, "speed_constant", allowed="speed constant = 1 / torque constant in SI"
        )
    if voltage is None:
        return
    low, high = NO_LOAD_SPEED
    if not low <= voltage / constant <= high:
        no_load_speed = voltage / constant / rpm
        reason = (
            f"implausible with nominal_voltage: the motor would idle at {no_load_speed:.3g} "
            "rpm; check the unit (mN*m/A)"
        )
        raise section.error(
            reason, "torque_constant", allowed=f"{voltage / high:.3g} to {voltage / low:.3g} N*m/A"
        )
    stall = values.get("stall_torque")
    resistance = values.get("terminal_resistance")
    if stall is not None and resistance is not None:
        expected = constant * voltage / resistance
        if abs(stall / expected - 1) > STALL_AGREEMENT:
            formula = "nominal_voltage / terminal_resistance"
            _contradicts(section, "stall_torque", formula, expected, STALL_AGREEMENT)


def _contradicts(
    section: Section, name: str, formula: str, torque: float, share: float
) -> NoReturn:
    """Raise ProblemError for a torque that contradicts the torque constant.

    Parameters
    ----------
    section : Section
        The motor file.
    name : str
        Key of the torque.
    formula : str
        Factor by which the torque constant is multiplied, as text.
    torque : float
        Expected torque, N·m.
    share : float
        Relative tolerance.
    """
    reason = (
        f"contradicts torque_constant × {formula} = {torque * 1e3:.4g} mN*m by more than "
        f"{100 * share:g} %"
    )
    raise section.error(reason, name, allowed="figures of one datasheet and one winding")


def _check_heat(section: Section, values: Mapping[str, float]) -> None:
    """Raise ProblemError if the winding temperature in the file is implausible.

    This concerns the largest permitted temperature, and the temperature at the nominal current.
    `values` contains the quantities of the file by key, in SI units.
    """
    limit = values.get("max_winding_temperature")
    if limit is None:
        return
    low, high = WINDING_TEMPERATURE
    if not low <= limit <= high:
        allowed = f"{low - 273.15:.0f} degC to {high - 273.15:.0f} degC"
        reason = "implausible for a winding: check the unit (degC)"
        raise section.error(reason, "max_winding_temperature", allowed=allowed)
    required_names = (
        "nominal_current",
        "terminal_resistance",
        "resistance_winding_housing",
        "resistance_housing_ambient",
    )
    if any(name not in values for name in required_names):
        return
    current, resistance, inner, outer = (values[name] for name in required_names)
    share = current**2 * resistance * (inner + outer) / (limit - REFERENCE_TEMPERATURE)
    low, high = NOMINAL_RISE
    if not low <= share <= high:
        reason = (
            f"implausible: at nominal_current the winding would warm by {100 * share:.3g} % of the "
            "rise up to max_winding_temperature; a datasheet has about 100 %: check the units"
        )
        allowed = f"{low * resistance / share:.3g} to {high * resistance / share:.3g} ohm"
        raise section.error(reason, "terminal_resistance", allowed=allowed)
