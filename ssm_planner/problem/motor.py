"""Define the figures of a motor's datasheet, in SI units.

`loading/motors.py` reads motors from files and compares their figures with each other.
"""

from collections.abc import Mapping
from dataclasses import field
from typing import Annotated

from ssm_planner.problem.value import (
    Bound,
    Current,
    Positive,
    Speed,
    Time,
    Torque,
    Value,
    uncompared_field,
)
from ssm_planner.typing import record

LARGEST_TORQUE_CONSTANT_DRIFT = -0.01
"""Largest plausible decrease of the torque constant with temperature, 1/K (a negative number)."""


@record
class Motor(Value):
    """Datasheet figures of a motor. A value is None if the file does not state it.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> motor = ssm.Motor("M1", nominal_torque=2e-3, max_torque=5e-3, max_speed=5000 * ssm.rpm)
    >>> round(motor.max_speed, 1)
    523.6
    """

    name: str
    """Name such as the manufacturer's designation."""
    nominal_torque: Torque
    """Continuous torque, N·m."""
    max_torque: Torque
    """Largest torque that a plan may use at any instant, N·m."""
    max_speed: Speed
    """Largest permissible speed, rad/s."""
    nominal_voltage: Annotated[Positive, "voltage"] | None = None
    """Nominal voltage, V. It is the default supply of the controller."""
    nominal_current: Current | None = None
    """Continuous current, A."""
    no_load_current: Current | None = None
    """Current without a load at nominal voltage, A. It gives the friction torque of the motor."""
    torque_constant: Annotated[Positive, "torque_constant"] | None = None
    """Torque constant, N·m/A."""
    terminal_resistance: Annotated[Positive, "resistance"] | None = None
    """Phase-to-phase resistance at 25 °C, Ω."""
    rotor_inertia: Annotated[Positive, "inertia"] | None = None
    """Rotor inertia, kg·m²."""
    resistance_winding_housing: Annotated[Positive, "thermal_resistance"] | None = None
    """Thermal resistance from winding to housing, K/W."""
    resistance_housing_ambient: Annotated[Positive, "thermal_resistance"] | None = None
    """Thermal resistance from housing to ambient, K/W."""
    time_constant_winding: Time | None = None
    """Thermal time constant of the winding, s."""
    time_constant_motor: Time | None = None
    """Thermal time constant of the motor, s."""
    max_winding_temperature: Annotated[Positive, "temperature"] | None = None
    """Largest permissible temperature of the winding, K."""
    torque_constant_per_kelvin: Annotated[float, "number"] | None = None
    """Relative change of the torque constant with magnet temperature, 1/K, negative."""
    mass: Annotated[Positive, "mass"] | None = None
    """Mass, kg."""
    encoder_counts: Annotated[int, Bound(above=0, at_most=1e8), "number"] | None = None
    """Counts (lines) per turn. Each count has four increments of position."""
    sources: Mapping[str, str] = field(default_factory=dict)
    placeholders: tuple[str, ...] = ()
    """Names of the figures without a source for this motor.

    `sources` states the substitute and the reason.
    """
    file: str | None = uncompared_field()

    @property
    def placeholder(self) -> bool:
        """True if a figure other than `encoder_counts` is a placeholder.

        The verdicts on the motor then depend on a placeholder.
        """
        return any(name != "encoder_counts" for name in self.placeholders)

    @property
    def increments(self) -> int | None:
        """Increments of the position per turn, four for each line of the encoder.

        None if the file does not state the lines.
        """
        return None if self.encoder_counts is None else 4 * self.encoder_counts

    @property
    def encoder_known(self) -> bool:
        """True if the file states encoder_counts and the value is not a placeholder."""
        return self.encoder_counts is not None and "encoder_counts" not in self.placeholders

    def _check(self) -> None:
        """Raise ProblemError if figures contradict each other."""
        if self.max_torque < self.nominal_torque:
            raise self._field_error(
                "max_torque", "smaller than nominal_torque", f"at least {self.nominal_torque:g} N*m"
            )
        drift = self.torque_constant_per_kelvin
        if drift is not None and not LARGEST_TORQUE_CONSTANT_DRIFT <= drift <= 0:
            reason = "magnets weaken as they warm" if drift > 0 else "too small"
            raise self._field_error(
                "torque_constant_per_kelvin",
                reason,
                f"{LARGEST_TORQUE_CONSTANT_DRIFT:g} to 0, such as -0.0011",
            )
        winding = self.time_constant_winding
        motor = self.time_constant_motor
        if winding is not None and motor is not None and winding >= motor:
            raise self._field_error(
                "time_constant_winding",
                "longer than time_constant_motor, but the winding warms faster than the motor: "
                "check for exchanged values",
                f"less than {motor:g} s",
            )
