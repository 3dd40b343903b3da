"""The kinds of quantity that files contain."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Kind:
    """A kind of quantity: how messages call it, an example, the SI unit, what else may be written, and its bound."""

    name: str
    example: str
    unit: str
    others: tuple[str, ...] = ()
    """Further units of another dimension that mean the same (N*m*s for N*m*s/rad)."""
    largest: float = math.inf
    """Magnitude in SI beyond which the value must be a slip."""
    slip: str = ""
    """The unit that was probably meant then."""

    @property
    def expected(self) -> str:
        return f"{self.name} such as {self.example}"


KINDS = {
    "angle": Kind("an angle", "-110 deg", "rad", largest=4 * math.pi * (1 + 1e-9), slip="deg"),
    "length": Kind("a length", "20 mm", "m", largest=1.0, slip="mm"),
    "angular_velocity": Kind("a speed", "65 deg/s", "rad/s", largest=20.0, slip="deg/s"),
    "angular_acceleration": Kind("an acceleration", "200 deg/s^2", "rad/s^2", largest=1e4, slip="deg/s^2"),
    "angular_jerk": Kind("a jerk", "5000 deg/s^3", "rad/s^3", largest=1e8, slip="deg/s^3"),
    "velocity": Kind("a speed", "20 mm/s", "m/s", largest=2.0, slip="mm/s"),
    "acceleration": Kind("an acceleration", "100 mm/s^2", "m/s^2", largest=99.0, slip="mm/s^2"),
    "jerk": Kind("a jerk", "2000 mm/s^3", "m/s^3", largest=1e5, slip="mm/s^3"),
    "motor_speed": Kind("a motor speed", "8000 rpm", "rad/s", largest=2.1e4, slip="rpm"),
    "time": Kind("a time", "0.2 s", "s", largest=3600.0, slip="ms"),
    "rate": Kind("a rate", "200 1/s", "1/s"),
    "mass": Kind("a mass", "0.35 kg", "kg", largest=100.0, slip="g"),
    "inertia": Kind("a moment of inertia", "0.165 g*cm^2", "kg*m^2", largest=1e3, slip="g*cm^2"),
    "force": Kind("a force", "0.8 N", "N", largest=1e5, slip="mN"),
    "torque": Kind("a torque", "80 mN*m", "N*m", largest=1e3, slip="mN*m"),
    "rotary_viscosity": Kind("a viscous coefficient", "1.2e-5 N*m*s/rad", "N*m*s/rad", others=("N*m*s",)),
    "linear_viscosity": Kind("a viscous coefficient", "0.1 N*s/m", "N*s/m"),
    "voltage": Kind("a voltage", "24 V", "V", largest=1e3, slip="mV"),
    "current": Kind("a current", "2480 mA", "A", largest=500.0, slip="mA"),
    "resistance": Kind("a resistance", "0.763 ohm", "ohm", largest=1e6, slip="ohm"),
    "torque_constant": Kind("a torque constant", "14.8 mN*m/A", "N*m/A", largest=10.0, slip="mN*m/A"),
    "speed_constant": Kind("a speed constant", "645 rpm/V", "rad/s/V", largest=1e5, slip="rpm/V"),
    "thermal_resistance": Kind("a thermal resistance", "32 K/W", "K/W", largest=1e4, slip="K/W"),
    "temperature": Kind("a temperature", "155 degC", "K", largest=2000.0, slip="degC"),
}
"""Kinds of quantity by the name that the schema uses."""
