"""Check the temperatures of one motor.

The check finds the largest permitted RMS torque of a motion that repeats forever, and the
temperatures of the winding.
"""

from functools import cached_property

import numpy as np

from ssm_planner.problem import Motor
from ssm_planner.sizing.demand import thinned
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.motor_limits import Conditions, missing, require_value
from ssm_planner.sizing.thermal_network import (
    FIGURES,
    Cycle,
    ThermalModel,
    steady_state,
    time_until,
)
from ssm_planner.typing import JsonObject, record

STEPS = 60
"""Largest number of steps of the search."""
CLOSE = 1e-3
"""Tolerance of the temperature at the capacity, K."""


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
    """Peak winding temperature at the stated friction. None without a steady state."""
    winding: float | None
    """Peak winding temperature at the RMS torque with the required confidence, or None."""
    model: ThermalModel
    cycle: Cycle
    """The motion with its torque scaled to this RMS torque."""

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
            "limit": self.limit,
            "nominal_winding": self.nominal_winding,
            "winding": self.winding,
            "time_until_limit": self.time_until_limit,
        }


def heat_of(load: JointLoad, motor: Motor, conditions: Conditions, worst_rms: float) -> Heat | None:
    """Compute the thermal steady state of a repeated motion.

    Parameters
    ----------
    load
        Motion and load of the joint.
    motor
        The motor.
    conditions
        Operating conditions with the ambient temperature and the pause.
    worst_rms
        RMS torque over motion and pause at the required confidence, N·m.

    Returns
    -------
    Heat or None
        None if the motor file lacks data of `thermal_network.FIGURES`.
    """
    if missing(motor, *FIGURES):
        return None
    limit = require_value(motor, "max_winding_temperature")
    model = ThermalModel.from_motor(motor, conditions.ambient)
    few = thinned(load)
    cycle = Cycle.from_torque(few.t, few.torque(), conditions.pause)
    rms = float(np.sqrt(cycle.mean(cycle.square)))
    if rms == 0.0:
        return Heat(
            np.inf,
            limit,
            nominal_winding=conditions.ambient,
            winding=conditions.ambient,
            model=model,
            cycle=cycle,
        )
    nominal = steady_state(model, cycle)
    hot = cycle.scaled(worst_rms / rms)
    hot_state = steady_state(model, hot)
    return Heat(
        _largest_factor(model, cycle, limit) * rms,
        limit,
        nominal_winding=nominal.peak if nominal.steady else None,
        winding=hot_state.peak if hot_state.steady else None,
        model=model,
        cycle=hot,
    )


def _largest_factor(model: ThermalModel, cycle: Cycle, limit: float) -> float:
    """Return the factor on the torque with which the winding temperature peaks at `limit` (K).

    The factor is 0 if the ambient temperature reaches the limit. The search is regula falsi over
    the square of the factor. The temperature rise is a convex function of it, so the chord moves
    only the lower end of the bracket. Therefore, the excess at the upper end is halved from the
    second such step on (Illinois method). The search bisects while the upper end lacks a
    steady state.
    """
    allowed = limit - model.ambient
    if allowed <= 0:
        return 0.0

    def rise(square: float) -> float:
        temperatures = steady_state(model, cycle.scaled(np.sqrt(square)))
        return temperatures.peak - model.ambient if temperatures.steady else np.inf

    low = 0.0
    low_rise = 0.0
    high = 1.0
    high_rise = rise(high)
    while high_rise < allowed:
        low = high
        low_rise = high_rise
        high = 1.01 * high * allowed / high_rise
        high_rise = rise(high)
    was_below = False
    for _ in range(STEPS):
        share = (allowed - low_rise) / (high_rise - low_rise) if np.isfinite(high_rise) else 0.5
        middle = low + np.clip(share, 0.01, 0.99) * (high - low)
        middle_rise = rise(middle)
        if middle_rise <= allowed:
            low = middle
            low_rise = middle_rise
            high_rise = allowed + (high_rise - allowed) / 2 if was_below else high_rise
        else:
            high = middle
            high_rise = middle_rise
        was_below = middle_rise <= allowed
        if allowed - low_rise < CLOSE:
            break
    return float(np.sqrt(low))
