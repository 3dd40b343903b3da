"""Motors as frozen values: a datasheet's figures, SI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Motor:
    """A motor's datasheet figures; None where the file gives none."""

    name: str
    nominal_torque: float
    """Continuous torque, N·m."""
    max_torque: float
    """Largest usable torque, N·m: what a plan may use at any instant."""
    max_speed: float
    """rad/s."""
    nominal_voltage: float | None = None
    nominal_current: float | None = None
    torque_constant: float | None = None
    terminal_resistance: float | None = None
    rotor_inertia: float | None = None
    resistance_winding_housing: float | None = None
    resistance_housing_ambient: float | None = None
    time_constant_winding: float | None = None
    time_constant_motor: float | None = None
    max_winding_temperature: float | None = None
    """K."""
    torque_constant_per_kelvin: float | None = None
    """Relative change of the torque constant with the magnets' temperature, 1/K, negative."""
    encoder_counts: int | None = None
    sources: Mapping[str, str] = field(default_factory=dict)
    placeholders: tuple[str, ...] = ()
    """Names of the figures that nobody could source for this motor; sources says what stands in and why."""
    file: str | None = None

    @property
    def placeholder(self) -> bool:
        return bool(self.placeholders)
