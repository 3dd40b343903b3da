"""Motors as frozen values: a datasheet's figures, SI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from ssm_planner.problem.value import Bound, Positive, Quantity, Value

LARGEST_DRIFT = -0.01
"""1/K."""


@dataclass(frozen=True, eq=False)
class Motor(Value):
    """A motor's datasheet figures; None where the file gives none."""

    name: str
    """Such as the manufacturer's designation."""
    nominal_torque: Annotated[Positive, Quantity("torque")]
    """Continuous torque, N·m."""
    max_torque: Annotated[Positive, Quantity("torque")]
    """Largest usable torque, N·m: what a plan may use at any instant."""
    max_speed: Annotated[Positive, Quantity("motor_speed")]
    """Largest permissible speed, rad/s."""
    nominal_voltage: Annotated[Positive, Quantity("voltage")] | None = None
    """V; the default of the controller's supply."""
    nominal_current: Annotated[Positive, Quantity("current")] | None = None
    """A, continuous."""
    torque_constant: Annotated[Positive, Quantity("torque_constant")] | None = None
    """N·m/A."""
    terminal_resistance: Annotated[Positive, Quantity("resistance")] | None = None
    """Ω, from phase to phase, at 25 °C."""
    rotor_inertia: Annotated[Positive, Quantity("inertia")] | None = None
    """kg·m²."""
    resistance_winding_housing: Annotated[Positive, Quantity("thermal_resistance")] | None = None
    """Thermal resistance, K/W."""
    resistance_housing_ambient: Annotated[Positive, Quantity("thermal_resistance")] | None = None
    """Thermal resistance, K/W."""
    time_constant_winding: Annotated[Positive, Quantity("time")] | None = None
    """Thermal time constant of the winding, s."""
    time_constant_motor: Annotated[Positive, Quantity("time")] | None = None
    """Thermal time constant of the motor, s."""
    max_winding_temperature: Annotated[Positive, Quantity("temperature")] | None = None
    """Largest permissible temperature of the winding, K."""
    torque_constant_per_kelvin: Annotated[float, Quantity("number")] | None = None
    """Relative change of the torque constant with the magnets' temperature, 1/K, negative."""
    mass: Annotated[Positive, Quantity("mass")] | None = None
    """kg."""
    encoder_counts: Annotated[int, Bound(above=0), Quantity("number")] | None = None
    """Counts (lines) per turn; a position has four increments for each."""
    sources: Mapping[str, str] = field(default_factory=dict)
    placeholders: tuple[str, ...] = ()
    """Names of the figures that nobody could source for this motor; sources says what stands in and why."""
    file: str | None = field(default=None, compare=False)

    @property
    def placeholder(self) -> bool:
        """Some figures that a verdict rests on, the encoder being none of them, stand in for unknown ones."""
        return any(name != "encoder_counts" for name in self.placeholders)

    @property
    def encoder_known(self) -> bool:
        """The encoder is given, and not by a figure that stands in."""
        return self.encoder_counts is not None and "encoder_counts" not in self.placeholders

    def _check(self) -> None:
        if self.max_torque < self.nominal_torque:
            raise self._wrong(
                "max_torque", "smaller than nominal_torque", f"at least {self.nominal_torque:g} N*m"
            )
        drift = self.torque_constant_per_kelvin
        if drift is not None and not LARGEST_DRIFT <= drift <= 0:
            reason = "magnets weaken as they warm" if drift > 0 else "too small"
            raise self._wrong(
                "torque_constant_per_kelvin", reason, f"{LARGEST_DRIFT:g} to 0, such as -0.0011"
            )
        winding, motor = self.time_constant_winding, self.time_constant_motor
        if winding is not None and motor is not None and winding >= motor:
            raise self._wrong(
                "time_constant_winding",
                "longer than time_constant_motor: the winding warms faster than the motor as a whole; are they exchanged?",
                f"less than {motor:g} s",
            )
