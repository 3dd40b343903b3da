"""What a motor can give: speed–torque line at a supply voltage, current limit, continuous and short-term regions.

Steady electrical balance U = R·I + k·w with torque k·I (the inductance and the motor's own losses left out: the friction
of the drive was identified with the motor on it).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.problem.motor import Motor
from ssm_planner.typing import Array, Range

REFERENCE_TEMPERATURE = 298.15
"""Datasheets state resistance, torque constant and nominal torque at 25 °C, K."""
COPPER = 0.00393
"""Relative rise of the resistance of copper, 1/K."""
MAGNET = -0.0012
"""Relative change of the torque constant assumed where the motor file gives none, 1/K: the worse end for neodymium."""


@dataclass(frozen=True)
class Conditions:
    """How and where the motors run, and how sure the answer has to be."""

    ambient: float = REFERENCE_TEMPERATURE
    """K."""
    supply_voltage: float | None = None
    """Of the motor controller, V; None: the motor's nominal voltage."""
    current_limit: float | None = None
    """Of the motor controller, A; None: not looked at."""
    pause: float = 0.0
    """Rest after each repetition of the motion, s."""
    confidence: float = 0.99
    """Probability with which "adequate" is claimed."""
    draws: int = 0
    """Monte Carlo draws of the friction; 0: linearised."""
    spread: float | None = None
    """Relative range of every friction parameter for which the drive file gives neither range nor covariance."""

    def __post_init__(self) -> None:
        if not 0.5 <= self.confidence <= 0.999:
            raise ProblemError(
                "not a confidence", key="confidence", value=self.confidence, allowed="0.5 to 0.999"
            )
        if self.spread is not None and not 0 <= self.spread < 1:
            raise ProblemError(
                "not a relative range", key="spread", value=self.spread, allowed="0 up to below 1"
            )
        if self.draws and not 1000 <= self.draws <= 1_000_000:
            raise ProblemError(
                "too few or too many",
                key="draws",
                value=self.draws,
                allowed="1000 to 1000000, or 0",
            )
        if not 200.0 <= self.ambient <= 400.0:
            raise ProblemError(
                "not a surrounding of a motor",
                key="ambient",
                value=self.ambient,
                allowed="200 K to 400 K",
            )
        if not (math.isfinite(self.pause) and self.pause >= 0):
            raise ProblemError(
                "not a pause", key="pause", value=self.pause, allowed="0 s or longer"
            )
        for name in ("supply_voltage", "current_limit"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise ProblemError("not greater than zero", key=name, value=value)


def missing(motor: Motor, *names: str) -> tuple[str, ...]:
    """Those of the named figures that the motor file does not give."""
    return tuple(name for name in names if getattr(motor, name) is None)


def figure(motor: Motor, name: str) -> float:
    """A figure of the motor. Raises ProblemError where the file does not give it."""
    value = getattr(motor, name)
    if value is None:
        raise ProblemError("missing: this figure is needed", file=motor.file, key=name)
    return float(value)


SLOWEST_START = 2e4
"""rad/s², nominal torque by rotor inertia; 48 motors of 13 to 22 mm (maker's pages, 2020) have 2.9e4 to 1.9e5."""


def rotor_range(motor: Motor) -> Range:
    """Rotor inertia, kg·m²: as stated, else from 0 to a bound by the nominal torque of motors of this class."""
    stated = motor.rotor_inertia
    return (0.0, motor.nominal_torque / SLOWEST_START) if stated is None else (stated, stated)


def resistance(motor: Motor, temperature: float = REFERENCE_TEMPERATURE) -> float:
    """Terminal resistance with the winding at a temperature (K), ohm."""
    return figure(motor, "terminal_resistance") * (
        1 + COPPER * (temperature - REFERENCE_TEMPERATURE)
    )


def torque_constant(motor: Motor, temperature: float = REFERENCE_TEMPERATURE) -> float:
    """Torque constant with the magnets at a temperature (K), N·m/A."""
    return figure(motor, "torque_constant") * (
        1 + magnet_drift(motor) * (temperature - REFERENCE_TEMPERATURE)
    )


def magnet_drift(motor: Motor) -> float:
    """Relative change of the torque constant per kelvin; MAGNET where the file gives none."""
    return MAGNET if motor.torque_constant_per_kelvin is None else motor.torque_constant_per_kelvin


def available_torque(
    motor: Motor, conditions: Conditions, speed: Array, temperature: float | None = None
) -> Array:
    """Largest motor torque in the direction of motion at speeds ≥ 0 (rad/s, shape kept), N·m.

    The least of the file's largest torque, the current limit, and the speed–torque line at the supply voltage, as far as
    the file has the figures; 0 beyond the largest speed. temperature: of winding and magnets, K.
    """
    temperature = REFERENCE_TEMPERATURE if temperature is None else temperature
    speed = np.asarray(speed, dtype=float)
    torque = np.full(speed.shape, motor.max_torque)
    voltage = supply(motor, conditions)
    if not missing(motor, "torque_constant"):
        k = torque_constant(motor, temperature)
        if conditions.current_limit is not None:
            torque = np.minimum(torque, k * conditions.current_limit)
        if voltage is not None and not missing(motor, "terminal_resistance"):
            torque = np.minimum(torque, k * (voltage - k * speed) / resistance(motor, temperature))
    return np.where(speed > motor.max_speed, 0.0, np.maximum(torque, 0.0))


def continuous_torque(motor: Motor, ambient: float) -> float | None:
    """Torque that the motor can give for all time in this surrounding, N·m; None where it takes a missing figure.

    The nominal torque, in hotter surroundings than the datasheet's 25 °C reduced by √(ΔT / ΔT at 25 °C).
    """
    if ambient <= REFERENCE_TEMPERATURE:
        return motor.nominal_torque
    if motor.max_winding_temperature is None:
        return None
    spare = motor.max_winding_temperature - ambient
    return motor.nominal_torque * math.sqrt(
        max(spare, 0.0) / (motor.max_winding_temperature - REFERENCE_TEMPERATURE)
    )


def operating_shares(
    motor: Motor, conditions: Conditions, speed: Array, torque: Array, weight: Array
) -> dict[str, float] | None:
    """Shares of the time (weight (n,), sum 1) in the continuous region, in the short-term region, and beyond both.

    With the motor as hot as it may get, where the file says how hot that is. None where the continuous torque is unknown.
    """
    steady = continuous_torque(motor, conditions.ambient)
    if steady is None:
        return None
    size = np.abs(torque)
    within = size <= available_torque(
        motor, conditions, np.abs(speed), motor.max_winding_temperature
    )
    return {
        "continuous": float(weight @ (within & (size <= steady))),
        "short_term": float(weight @ (within & (size > steady))),
        "beyond": float(weight @ ~within),
    }


def required_voltage(torque: Array, speed: Array, motor: Motor, temperature: float) -> Array:
    """|R·I + k·w| for a torque (n,) or (draws, n) at motor speeds (n,), V."""
    k = torque_constant(motor, temperature)
    return np.abs(resistance(motor, temperature) / k * torque + k * speed)


def supply(motor: Motor, conditions: Conditions) -> float | None:
    """Supply voltage, V: the controller's, else the motor's nominal one."""
    return motor.nominal_voltage if conditions.supply_voltage is None else conditions.supply_voltage
