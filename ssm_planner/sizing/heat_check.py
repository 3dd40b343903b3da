"""Compute how hot the winding of a motor becomes in a motion that repeats forever.

The main entry is `compute_heat`. It finds the largest RMS torque that the winding permits, and the
peak temperatures of the winding. `thermal_network` contains the thermal model.
"""

from functools import cached_property

import numpy as np

from ssm_planner.problem import Motor, get_attributes
from ssm_planner.sizing.demand import select_instants
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.motor_limits import Conditions, missing_data, require_value
from ssm_planner.sizing.thermal_network import (
    THERMAL_DATA,
    Cycle,
    ThermalModel,
    steady_state,
    time_until,
)
from ssm_planner.typing import JsonObject, record

CAPACITY_TOLERANCE = 1e-6
"""Relative tolerance of the squared torque with which the winding reaches its limit."""


@record
class Heat:
    """Thermal steady state of the repeated motion, in K, N·m and s.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> motor = ssm.load_motor("maxon_ecx_speed_13_m")
    >>> sizing = ssm.size("results/tilt_insert", {"insertion": [motor]})
    >>> [verdict.heat is None for verdict in sizing.verdicts]
    [True, True, False]
    """

    capacity: float
    """RMS torque over motion and pause with which the winding just reaches its limit."""
    limit: float
    """Largest permitted winding temperature."""
    nominal_winding: float | None
    """Peak winding temperature at the stated friction. None if the motor has no steady state."""
    winding: float | None
    """Peak winding temperature at the RMS torque that friction does not exceed with the required
    confidence. None if the motor has no steady state.
    """
    model: ThermalModel
    cycle: Cycle
    """The repeated motion. Its torque is scaled to the RMS torque at the required confidence."""

    @cached_property
    def time_until_limit(self) -> float | None:
        """Time until the winding of the cold motor reaches its limit at this torque, s.

        None if it never reaches the limit.
        """
        return time_until(self.model, self.cycle, self.limit)

    def to_dict(self) -> JsonObject:
        """Return the result as JSON types in SI units. Temperatures are in kelvin."""
        return {
            "capacity": self.capacity if np.isfinite(self.capacity) else None,
            **get_attributes(self, ("limit", "nominal_winding", "winding", "time_until_limit")),
        }


def compute_heat(
    load: JointLoad, motor: Motor, conditions: Conditions, worst_rms: float
) -> Heat | None:
    """Compute the temperatures of a motor that repeats a motion forever.

    Parameters
    ----------
    load : JointLoad
        Motion and load of the joint.
    motor : Motor
        Motor with its thermal data.
    conditions : Conditions
        Operating conditions with the ambient temperature and the pause after each repetition.
    worst_rms : float
        RMS torque over motion and pause that is not exceeded with the required confidence, N·m.

    Returns
    -------
    Heat or None
        None if the motor file lacks data of `thermal_network.THERMAL_DATA`.
    """
    if missing_data(motor, *THERMAL_DATA):
        return None
    limit = require_value(motor, "max_winding_temperature")
    model = ThermalModel.from_motor(motor, conditions.ambient)
    selected_load = select_instants(load)
    cycle = Cycle.from_torque(selected_load.t, selected_load.torque(), conditions.pause)
    rms = float(np.sqrt(cycle.mean(cycle.square)))
    hot = cycle
    capacity = np.inf  # nothing limits a motor without torque
    if rms > 0:
        hot = cycle.scaled(worst_rms / rms)
        capacity = _largest_torque_factor(model, cycle, limit) * rms
    nominal = steady_state(model, cycle)
    hot_state = steady_state(model, hot)
    return Heat(
        capacity,
        limit,
        nominal_winding=nominal.peak if nominal.steady else None,
        winding=hot_state.peak if hot_state.steady else None,
        model=model,
        cycle=hot,
    )


def _largest_torque_factor(model: ThermalModel, cycle: Cycle, limit: float) -> float:
    """Return the factor on the torque with which the winding temperature peaks at its limit.

    Brent's method finds the square of the factor, because the heat is proportional to the square of
    the torque. If a motor with too much torque has no steady state, its temperature rise counts as
    twice the permitted one.

    Parameters
    ----------
    model : ThermalModel
        Thermal model of the motor.
    cycle : Cycle
        Motor torque over one repetition.
    limit : float
        Largest permitted winding temperature, K.

    Returns
    -------
    float
        Factor. It is 0 if the ambient temperature reaches the limit.
    """
    from scipy.optimize import brentq  # SciPy's optimisers take long to import.

    allowed = limit - model.ambient
    if allowed <= 0:
        return 0.0

    def excess(square: float) -> float:
        """Compute by how much (K) the winding exceeds its limit for a squared torque factor."""
        temperatures = steady_state(model, cycle.scaled(np.sqrt(square)))
        rise = temperatures.peak - model.ambient if temperatures.steady else np.inf
        return min(rise, 2 * allowed) - allowed

    high = 1.0
    while excess(high) < 0:
        high *= 2
    square = brentq(excess, 0.0, high, xtol=CAPACITY_TOLERANCE * high, rtol=CAPACITY_TOLERANCE)
    # The limit is kept at both ends of the final bracket.
    return float(np.sqrt((1 - 2 * CAPACITY_TOLERANCE) * square))
