"""The thermal check of one motor: the RMS torque that this motion may have for all time, and the temperatures it gives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ssm_planner.problem.motor import Motor
from ssm_planner.sizing.demand import thinned
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.motor_limits import Conditions, figure, missing
from ssm_planner.sizing.thermal_network import (
    FIGURES,
    Cycle,
    ThermalModel,
    steady_state,
    time_until,
)

STEPS = 60
CLOSE = 1e-3
"""K by which the temperature that fixes the capacity may fall short of the limit."""


@dataclass(frozen=True, eq=False)
class Heat:
    """Steady state of the repeated motion; K, N·m, s."""

    capacity: float
    """RMS torque over motion and pause at which this motion, scaled, just reaches the winding's limit."""
    limit: float
    """Largest winding temperature."""
    nominal_winding: float | None
    """Peak winding temperature at the stated friction; None: no steady state."""
    winding: float | None
    """Peak winding temperature at the RMS torque of the stated confidence; None: no steady state."""
    model: ThermalModel
    cycle: Cycle
    """The motion with that RMS torque."""

    @cached_property
    def time_until_limit(self) -> float | None:
        """Time from cold until the winding reaches its limit at that torque, s; None where it never does."""
        return time_until(self.model, self.cycle, self.limit)

    def to_dict(self) -> dict[str, Any]:
        """JSON types; SI, kelvin."""
        return {
            "capacity": self.capacity if np.isfinite(self.capacity) else None,
            "limit": self.limit,
            "nominal_winding": self.nominal_winding,
            "winding": self.winding,
            "time_until_limit": self.time_until_limit,
        }


def heat_of(load: JointLoad, motor: Motor, conditions: Conditions, worst_rms: float) -> Heat | None:
    """Heat of the repeated motion whose RMS torque over motion and pause may reach worst_rms (N·m).

    None where the motor file lacks one of thermal_network.FIGURES.
    """
    if missing(motor, *FIGURES):
        return None
    limit = figure(motor, "max_winding_temperature")
    model = ThermalModel.from_motor(motor, conditions.ambient)
    few = thinned(load, load.drive)
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
    nominal, hot = steady_state(model, cycle), cycle.scaled(worst_rms / rms)
    worst = steady_state(model, hot)
    return Heat(
        _largest_factor(model, cycle, limit) * rms,
        limit,
        nominal_winding=nominal.peak if nominal.steady else None,
        winding=worst.peak if worst.steady else None,
        model=model,
        cycle=hot,
    )


def _largest_factor(model: ThermalModel, cycle: Cycle, limit: float) -> float:
    """Factor on the torque at which the steady winding temperature peaks at `limit`; 0 where the surroundings do.

    The rise is a convex function of the factor squared, so the chord undershoots and moves the lower end alone: regula falsi
    with the upper end's excess halved from the second such step on (Illinois), and bisection where that has no steady state.
    """
    allowed = limit - model.ambient
    if allowed <= 0:
        return 0.0

    def rise(square: float) -> float:
        reached = steady_state(model, cycle.scaled(np.sqrt(square)))
        return reached.peak - model.ambient if reached.steady else np.inf

    low, low_rise, high = 0.0, 0.0, 1.0
    high_rise = rise(high)
    while high_rise < allowed:
        low, low_rise, high = high, high_rise, 1.01 * high * allowed / high_rise
        high_rise = rise(high)
    undershot = False
    for _ in range(STEPS):
        share = (allowed - low_rise) / (high_rise - low_rise) if np.isfinite(high_rise) else 0.5
        middle = low + np.clip(share, 0.01, 0.99) * (high - low)
        middle_rise = rise(middle)
        if middle_rise <= allowed:
            low, low_rise = middle, middle_rise
            high_rise = allowed + (high_rise - allowed) / 2 if undershot else high_rise
        else:
            high, high_rise = middle, middle_rise
        undershot = middle_rise <= allowed
        if allowed - low_rise < CLOSE:
            break
    return float(np.sqrt(low))
