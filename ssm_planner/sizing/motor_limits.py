"""Compute the limits of a motor: speed–torque line, current limit, continuous torque.

The electrical model is the steady balance U = R·I + k·w of the voltage U, with the resistance R,
the current I, the torque constant k and the speed w. The torque is k·I. The model omits the
inductance. The friction of a drive includes the friction and the iron losses of the joint's own
motor, because it was identified together with this motor. `no_load_torque` gives them for others.
"""

import math
from typing import Annotated

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.problem import Bound, Motor, NotNegative, Value
from ssm_planner.problem.value import Positive
from ssm_planner.typing import Array, Range, record

REFERENCE_TEMPERATURE = 298.15
"""Temperature at which datasheets state resistance, torque constant and nominal torque, K."""
COPPER_COEFFICIENT = 0.00393
"""Relative increase of the resistance of copper, 1/K."""
ELECTRICAL_DATA = ("torque_constant", "terminal_resistance", "max_winding_temperature")
"""Data that the voltage check needs from a motor file."""
MAGNET_COEFFICIENT = -0.0012
"""Relative change of the torque constant if the motor file does not state it, 1/K.

It is the least favourable value for neodymium magnets.
"""


@record
class Conditions(Value):
    """Operating conditions of the motors, and the required confidence of the answer.

    Raises ProblemError if a value is not in its range.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> conditions = ssm.Conditions(supply_voltage=24.0, pause=1.0)
    >>> ssm.size("results/tilt_insert", supply_voltage=24.0, pause=1.0).conditions == conditions
    True
    """

    ambient: Annotated[float, Bound(at_least=200.0, at_most=400.0)] = REFERENCE_TEMPERATURE
    """Ambient temperature, K."""
    supply_voltage: Positive | None = None
    """Supply voltage of the motor controller, V. None means the motor's nominal voltage."""
    current_limit: Positive | None = None
    """Current limit of the motor controller, A. None means that it is not checked."""
    pause: NotNegative = 0.0
    """Rest after each repetition of the motion, s."""
    confidence: Annotated[float, Bound(at_least=0.5, at_most=0.999)] = 0.99
    """Probability with which "adequate" is claimed."""
    draws: Annotated[int, Bound(at_least=0, at_most=1_000_000)] = 0
    """Number of Monte Carlo draws of the friction, at least 1000.

    0 means a linearised calculation.
    """
    spread: Annotated[float, Bound(at_least=0.0, at_most=math.nextafter(1.0, 0.0))] | None = None
    """Relative range of friction parameters without a range or covariance in the drive file."""

    def _check(self) -> None:
        if 0 < self.draws < 1000:
            raise self._field_error("draws", "too few", "0, or 1000 to 1000000")


def missing_data(motor: Motor, *names: str) -> tuple[str, ...]:
    """Return the names of the values that a motor file does not state.

    Parameters
    ----------
    motor : Motor
        The motor.
    *names : str
        Names of its attributes.

    Returns
    -------
    tuple of str
        Those of the names whose value is None.
    """
    return tuple(name for name in names if getattr(motor, name) is None)


def require_value(motor: Motor, name: str) -> float:
    """Return a value of a motor, which its file must state.

    Parameters
    ----------
    motor : Motor
        The motor.
    name : str
        Name of the attribute.

    Returns
    -------
    float
        Value in SI units.

    Raises
    ------
    ProblemError
        If the file does not state the value.
    """
    value = getattr(motor, name)
    if value is None:
        raise ProblemError("missing: this value is needed", file=motor.file, key=name)
    return float(value)


SMALLEST_STARTING_ACCELERATION = 2e4
"""Smallest plausible nominal torque divided by rotor inertia, rad/s².

48 motors of 13 to 22 mm diameter have 2.9e4 to 1.9e5 (manufacturers' pages, 2020).
"""


def rotor_range(motor: Motor) -> Range:
    """Compute the range of the rotor inertia that is possible.

    If the motor file states the inertia, both ends are equal to it. Otherwise, the range extends
    from 0 to the nominal torque divided by `SMALLEST_STARTING_ACCELERATION`.

    Parameters
    ----------
    motor : Motor
        Motor with its nominal torque and, if known, its rotor inertia.

    Returns
    -------
    smallest, largest : float
        Inertias, kg·m².
    """
    inertia = motor.rotor_inertia
    if inertia is None:
        return 0.0, motor.nominal_torque / SMALLEST_STARTING_ACCELERATION
    return inertia, inertia


def no_load_torque(motor: Motor | None) -> float | None:
    """Compute the friction torque of a motor from its no-load current.

    The torque is M_R = k·I_0.

    Without a load, the motor torque k·I_0, with the torque constant k and the no-load current I_0,
    only overcomes bearing friction, brush friction and iron losses (maxon, "Key information on
    maxon DC and EC motors": iron losses are treated as an additional friction torque, and torque
    equals current times torque constant). The no-load current applies at the no-load speed. These
    losses grow with speed, so M_R is an upper bound for lower speeds.

    Parameters
    ----------
    motor : Motor or None
        Motor, or None.

    Returns
    -------
    float or None
        Torque, N·m. None if the motor file lacks the current or the torque constant.
    """
    if motor is None or missing_data(motor, "no_load_current", "torque_constant"):
        return None
    return require_value(motor, "no_load_current") * torque_constant(motor)


def resistance(motor: Motor, temperature: float = REFERENCE_TEMPERATURE) -> float:
    """Compute the terminal resistance of a motor at a temperature.

    Parameters
    ----------
    motor : Motor
        Motor with its terminal resistance.
    temperature : float
        Temperature of the winding, K.

    Returns
    -------
    float
        Resistance, ohm.

    Raises
    ------
    ProblemError
        If the motor file does not state the resistance.
    """
    growth = COPPER_COEFFICIENT * (temperature - REFERENCE_TEMPERATURE)
    return require_value(motor, "terminal_resistance") * (1 + growth)


def torque_constant(motor: Motor, temperature: float = REFERENCE_TEMPERATURE) -> float:
    """Compute the torque constant of a motor at a temperature.

    Parameters
    ----------
    motor : Motor
        Motor with its torque constant.
    temperature : float
        Temperature of the magnets, K.

    Returns
    -------
    float
        Torque constant, N·m/A.

    Raises
    ------
    ProblemError
        If the motor file does not state the torque constant.
    """
    growth = magnet_coefficient(motor) * (temperature - REFERENCE_TEMPERATURE)
    return require_value(motor, "torque_constant") * (1 + growth)


def magnet_coefficient(motor: Motor) -> float:
    """Return the relative change of the torque constant of a motor per kelvin.

    Parameters
    ----------
    motor : Motor
        The motor.

    Returns
    -------
    float
        Coefficient, 1/K. It is `MAGNET_COEFFICIENT` if the motor file does not state it.
    """
    coefficient = motor.torque_constant_per_kelvin
    return MAGNET_COEFFICIENT if coefficient is None else coefficient


def available_torque(
    motor: Motor, conditions: Conditions, speed: Array, temperature: float | None = None
) -> Array:
    """Return the largest motor torque in the direction of motion.

    It is the smallest of three limits: the largest torque in the motor file, the torque at the
    current limit, and the speed–torque line at the supply voltage, k·(U − k·w)/R, with the voltage
    U, the torque constant k, the resistance R and the speed w. Limits without data are ignored. The
    torque is 0 above the largest speed.

    Parameters
    ----------
    motor, conditions : Motor, Conditions
        The motor and its operating conditions.
    speed : array of any shape
        Motor speeds ≥ 0, rad/s.
    temperature : float, optional
        Temperature of winding and magnets, K. The default is 25 °C.

    Returns
    -------
    array with the shape of speed
        Torques, N·m.
    """
    temperature = REFERENCE_TEMPERATURE if temperature is None else temperature
    speed = np.asarray(speed, dtype=float)
    torque = np.full(speed.shape, motor.max_torque)
    voltage = available_voltage(motor, conditions)
    if not missing_data(motor, "torque_constant"):
        k = torque_constant(motor, temperature)
        if conditions.current_limit is not None:
            torque = np.minimum(torque, k * conditions.current_limit)
        if voltage is not None and not missing_data(motor, "terminal_resistance"):
            torque = np.minimum(torque, k * (voltage - k * speed) / resistance(motor, temperature))
    return np.where(speed > motor.max_speed, 0.0, np.maximum(torque, 0.0))


def continuous_torque(motor: Motor, ambient: float) -> float | None:
    """Compute the torque that the motor can sustain at an ambient temperature.

    Up to 25 °C, it is the nominal torque. Above, it is the nominal torque times √(ΔT/ΔT₂₅), where
    ΔT is the permitted rise of the winding above this ambient temperature and ΔT₂₅ the one above 25
    °C.

    Parameters
    ----------
    motor : Motor
        Motor with its nominal torque.
    ambient : float
        Ambient temperature, K.

    Returns
    -------
    float or None
        Torque, N·m. None if the motor file lacks the largest winding temperature.
    """
    if ambient <= REFERENCE_TEMPERATURE:
        return motor.nominal_torque
    if motor.max_winding_temperature is None:
        return None
    permitted_rise = max(motor.max_winding_temperature - ambient, 0.0)
    reference_rise = motor.max_winding_temperature - REFERENCE_TEMPERATURE
    return motor.nominal_torque * math.sqrt(permitted_rise / reference_rise)


def operating_region_shares(
    motor: Motor, conditions: Conditions, speed: Array, torque: Array, weight: Array
) -> dict[str, float] | None:
    """Compute which fraction of the time the motor spends in each operating region.

    The region "continuous" contains torques that the motor can sustain, "short_term" larger torques
    that it can still produce at its speed, and "beyond" all others. The motor is assumed to have
    its largest permitted temperature.

    Parameters
    ----------
    motor, conditions : Motor, Conditions
        The motor and its operating conditions.
    speed, torque : (n,)
        Motor speed, rad/s, and motor torque, N·m.
    weight : (n,)
        Fraction of the time that each instant represents.

    Returns
    -------
    dict[str, float] or None
        Fractions by region. None if the continuous torque or the speed–torque line is unknown.
    """
    steady = continuous_torque(motor, conditions.ambient)
    has_voltage = available_voltage(motor, conditions) is not None
    if steady is None or missing_data(motor, *ELECTRICAL_DATA) or not has_voltage:
        return None
    size = np.abs(torque)
    available = available_torque(motor, conditions, np.abs(speed), motor.max_winding_temperature)
    within = size <= available
    return {
        "continuous": float(weight @ (within & (size <= steady))),
        "short_term": float(weight @ (within & (size > steady))),
        "beyond": float(weight @ ~within),
    }


def voltage_factors(motor: Motor | None) -> Array:
    """Return the voltage that a motor needs per torque and per speed, cold and hot.

    The voltage is U = (R/k)·tau + k·w with the resistance R, the torque constant k, the torque tau
    and the speed w. The cold motor has a larger k and thus a larger back-EMF k·w. The hot motor has
    more resistance and needs more current. Either can need the larger voltage.

    Parameters
    ----------
    motor : Motor or None
        Motor, or None.

    Returns
    -------
    (2, 2) array
        Rows for the motor at 25 °C and at its largest winding temperature, columns R/k in V/(N·m)
        and k in V·s/rad. The values are NaN if data are missing.
    """
    if motor is None or missing_data(motor, *ELECTRICAL_DATA):
        return np.full((2, 2), np.nan)
    factors = []
    for temperature in (REFERENCE_TEMPERATURE, require_value(motor, "max_winding_temperature")):
        constant = torque_constant(motor, temperature)
        factors.append((resistance(motor, temperature) / constant, constant))
    return np.array(factors)


def available_voltage(motor: Motor, conditions: Conditions) -> float | None:
    """Return the voltage that a controller can apply to a motor.

    Parameters
    ----------
    motor, conditions : Motor, Conditions
        The motor and its operating conditions.

    Returns
    -------
    float or None
        Supply voltage or, if it is not stated, the nominal voltage of the motor, V. None if neither
        is stated.
    """
    return motor.nominal_voltage if conditions.supply_voltage is None else conditions.supply_voltage
