"""The thermal check of one motor.

It finds the RMS torque that the motion may have forever, and the temperatures that result.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ssm_planner.problem.motor import Motor
from ssm_planner.representation import ShortRepr
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
CLOSE = 1e-3
"""Tolerance (K) by which the temperature at the capacity may fall short of the limit."""


@record
class Heat(ShortRepr):
    """Thermal steady state of the repeated motion, in K, N·m and s."""

    capacity: float
    """RMS torque over motion and pause at which the winding just reaches its limit."""
    limit: float
    """Largest permitted winding temperature."""
    nominal_winding: float | None
    """Peak winding temperature at the stated friction. None if there is no steady state."""
    winding: float | None
    """Peak winding temperature at the RMS torque of the required confidence. None as above."""
    model: ThermalModel
    cycle: Cycle
    """The motion, scaled to that RMS torque."""

    @cached_property
    def time_until_limit(self) -> float | None:
        """Time (s) from cold until the winding reaches its limit at that torque.

        None if it never does.
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
    """Compute the thermal steady state of a repeated motion at an RMS torque `worst_rms` (N·m).

    The RMS is taken over motion and pause. The result is None if the motor file lacks data that
    `thermal_network.FIGURES` names.
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
    """Return the factor on the torque at which the steady winding temperature peaks at `limit`.

    It is 0 if the ambient temperature reaches the limit. The temperature rise is a convex function
    of the factor squared. The chord therefore undershoots and moves only the lower end of the
    bracket. The search is regula falsi. From the second undershoot in a row it halves the excess at
    the upper end (Illinois method). It bisects if the upper end has no steady state.
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
    undershot = False
    for _ in range(STEPS):
        share = (allowed - low_rise) / (high_rise - low_rise) if np.isfinite(high_rise) else 0.5
        middle = low + np.clip(share, 0.01, 0.99) * (high - low)
        middle_rise = rise(middle)
        if middle_rise <= allowed:
            low = middle
            low_rise = middle_rise
            high_rise = allowed + (high_rise - allowed) / 2 if undershot else high_rise
        else:
            high = middle
            high_rise = middle_rise
        undershot = middle_rise <= allowed
        if allowed - low_rise < CLOSE:
            break
    return float(np.sqrt(low))
