"""How hot a motor gets: two bodies, winding and housing, with losses that grow as the winding warms.

    C_w dT_w/dt = P(t, T_w) − (T_w − T_h)/R_wh          P = R(T_w)·(tau/k(T_w))²
    C_h dT_h/dt = (T_w − T_h)/R_wh − (T_h − T_a)/R_ha

with C_w = time_constant_winding / R_wh and C_h = time_constant_motor / R_ha, as datasheets compute their time constants;
R grows by 0.393 %/K, and the magnets are taken to be as hot as the winding (the safe side). Linear but for P(T_w): within
one cycle the bodies are solved exactly in their two modes for a power that is piecewise straight in time, and P is
linearised about the temperatures found so far.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ssm_planner.problem.motor import Motor
from ssm_planner.sizing.motor_limits import (
    COPPER,
    REFERENCE_TEMPERATURE,
    figure,
    magnet_drift,
    resistance,
    torque_constant,
)
from ssm_planner.typing import Array

SMALL = 1e-4
"""Below it the functions of `_phi` are taken from their series."""


@dataclass(frozen=True, eq=False)
class Modes:
    """x' = A x + b P of (winding, housing) above ambient, as two independent modes z' = rate·z + input·P.

    rates (2,) in 1/s, negative where the mode settles; input (2,); shape (2, 2): x = shape @ z.
    """

    rates: Array
    input: Array
    shape: Array
    inverse: Array

    @classmethod
    def of(
        cls, r_inner: float, r_outer: float, c_inner: float, c_outer: float, gain: float = 0.0
    ) -> Modes:
        """Thermal resistances (K/W) and capacities (J/K); gain: power that each kelvin of the inner body adds, W/K."""
        exchange = 1.0 / (r_inner * math.sqrt(c_inner * c_outer))
        symmetric = np.array(
            [
                [(gain - 1.0 / r_inner) / c_inner, exchange],
                [exchange, -(1.0 / r_inner + 1.0 / r_outer) / c_outer],
            ]
        )
        rates, vectors = np.linalg.eigh(symmetric)
        root = np.sqrt([c_inner, c_outer])
        inverse = vectors.T * root
        return cls(rates, inverse[:, 0] / c_inner, vectors / root[:, None], inverse)

    @property
    def growing(self) -> bool:
        """A mode does not settle: the losses grow faster than the heat leaves."""
        return bool(self.rates.max() >= 0.0)

    def decay(self, t: Array | float) -> Array:
        """What is left of the modes after t (n,), (2, n)."""
        return np.exp(self.rates[:, None] * np.atleast_1d(t))

    def temperatures(self, states: Array) -> Array:
        """(inner, outer) above ambient for modes (2, n), K."""
        return np.asarray(self.shape @ states)

    def states(self, rise: Array) -> Array:
        """Modes (2,) of temperatures (2,) above ambient, K."""
        return np.asarray(self.inverse @ rise)


def follow(modes: Modes, t: Array, power: Array) -> Array:
    """Modes (2, n) at t (n,) from zero under a power (n,) in W that is straight between the instants; exact."""
    step = np.diff(t)
    x = modes.rates[:, None] * step
    first, second = _phi(x)
    gained = modes.input[:, None] * step * (first * power[:-1] + second * np.diff(power))
    states = np.zeros((2, len(t)))
    states[:, 1:] = _running(np.exp(x), gained)
    return states


def _running(factor: Array, gained: Array) -> Array:
    """z_k = factor_k·z_(k−1) + gained_k for all k, z_0 = 0, by doubling: log2(n) steps on whole arrays."""
    factor, result = factor.copy(), gained.copy()
    reach = 1
    while reach < result.shape[1]:
        result[:, reach:] = result[:, reach:] + factor[:, reach:] * result[:, :-reach]
        factor[:, reach:] = factor[:, reach:] * factor[:, :-reach]
        reach *= 2
    return result


def _phi(x: Array) -> tuple[Array, Array]:
    """(eˣ − 1)/x and (eˣ − 1 − x)/x²."""
    near = np.abs(x) < SMALL
    safe = np.where(near, 1.0, x)
    first = np.where(near, 1.0 + x / 2 + x * x / 6, np.expm1(safe) / safe)
    second = np.where(near, 0.5 + x / 6 + x * x / 24, (np.expm1(safe) - safe) / safe**2)
    return first, second


FIGURES = (
    "torque_constant",
    "terminal_resistance",
    "resistance_winding_housing",
    "resistance_housing_ambient",
    "time_constant_winding",
    "time_constant_motor",
    "max_winding_temperature",
)
"""What the thermal check needs of a motor file."""
SETTLED = 1e-6
"""K."""
PASSES = 60
HOTTEST = 1500.0
"""K; a steady state beyond it is none."""
PAUSE_INSTANTS, PAUSE_RANGE = 300, 1e4
"""Instants in a pause, and how much longer its last interval is than its first."""
STEP = 2.0
"""K by which the mean temperature may change over cycles that are taken at once."""


@dataclass(frozen=True)
class ThermalModel:
    """Constants of the two bodies and of the loss; SI, temperatures in K."""

    r_winding_housing: float
    r_housing_ambient: float
    c_winding: float
    c_housing: float
    ambient: float
    loss: float
    """R/k² at 25 °C, W/(N·m)²."""
    copper: float = COPPER
    magnet: float = 0.0

    @classmethod
    def from_motor(cls, motor: Motor, ambient: float) -> ThermalModel:
        """Raises ProblemError where one of FIGURES but the temperature limit is missing."""
        inner, outer = (
            figure(motor, f"resistance_{name}") for name in ("winding_housing", "housing_ambient")
        )
        return cls(
            inner,
            outer,
            c_winding=figure(motor, "time_constant_winding") / inner,
            c_housing=figure(motor, "time_constant_motor") / outer,
            ambient=ambient,
            loss=resistance(motor) / torque_constant(motor) ** 2,
            copper=COPPER,
            magnet=magnet_drift(motor),
        )

    def power(self, square: Array, winding: Array) -> Array:
        """Heat in the winding for tau² (n,) at winding temperatures (n,), W."""
        return self.loss * square * self._growth(winding)[0]

    def slope(self, square: Array, winding: Array) -> Array:
        """dP/dT_w, W/K, for squared torques and winding temperatures of any shape."""
        return self.loss * square * self._growth(winding)[1]

    def _growth(self, winding: Array) -> tuple[Array, Array]:
        """R/k² by its value at 25 °C, and its derivative."""
        warm = np.minimum(winding, HOTTEST) - REFERENCE_TEMPERATURE
        copper, magnet = 1 + self.copper * warm, np.maximum(1 + self.magnet * warm, 0.05)
        value = copper / magnet**2
        return value, self.copper / magnet**2 - 2 * self.magnet * copper / magnet**3


@dataclass(frozen=True, eq=False)
class Cycle:
    """Motor torque over one repetition: t (n,) from 0, s; square = tau² (n,), taken as straight between the instants."""

    t: Array
    square: Array

    @classmethod
    def from_torque(cls, t: Array, torque: Array, pause: float = 0.0) -> Cycle:
        """A motion, t (n,) and torque (n,), and the pause after it, in which the motor is without current."""
        t, square = t - t[0], np.square(torque)
        if pause > 0:
            # dense where the winding cools fastest
            share = np.expm1(np.linspace(0.0, np.log1p(PAUSE_RANGE), PAUSE_INSTANTS)) / PAUSE_RANGE
            t, square = (
                np.append(t, t[-1] + pause * share),
                np.append(square, np.zeros(PAUSE_INSTANTS)),
            )
        return cls(t, square)

    @property
    def period(self) -> float:
        """Duration of motion and pause, s."""
        return float(self.t[-1])

    def scaled(self, factor: float) -> Cycle:
        """With `factor` times the torque."""
        return Cycle(self.t, factor**2 * self.square)

    def mean(self, value: Array) -> float:
        """Over one period, of a value (n,) at the instants t."""
        return float(np.trapezoid(value, self.t) / self.period)


@dataclass(frozen=True, eq=False)
class Temperatures:
    """Winding and housing over one cycle, K, (n,) each; status "steady" or "no steady state" (then of no use)."""

    winding: Array
    housing: Array
    status: str = "steady"

    @property
    def steady(self) -> bool:
        return self.status == "steady"

    @property
    def peak(self) -> float:
        return float(self.winding.max())


def steady_state(model: ThermalModel, cycle: Cycle) -> Temperatures:
    """The temperatures that repeat with the cycle, found directly.

    Newton on the mean temperature, then the linear periodic problem about the temperatures of the pass before, in which
    the mean feedback of the temperature on the loss is part of the bodies, until they change by less than 1e-6 K.
    """
    mean = _mean_temperature(model, cycle)
    none = Temperatures(
        np.full(len(cycle.t), np.inf), np.full(len(cycle.t), np.inf), "no steady state"
    )
    if mean is None:
        return none
    winding = np.full(len(cycle.t), mean)
    for _ in range(PASSES):
        modes, power = _linearised(model, cycle, winding)
        if modes.growing:
            return none
        free = follow(modes, cycle.t, power)
        decay = modes.decay(cycle.period)
        states = free + modes.decay(cycle.t) * (free[:, -1:] / (1.0 - decay))
        rise, housing = modes.temperatures(states)
        change, winding = float(np.abs(model.ambient + rise - winding).max()), model.ambient + rise
        if not np.isfinite(change) or winding.max() > HOTTEST:
            return none
        if change < SETTLED:
            return Temperatures(winding, model.ambient + housing)
    return none


def _linearised(model: ThermalModel, cycle: Cycle, winding: Array) -> tuple[Modes, Array]:
    """The bodies with the mean slope of the loss counted in, and the power that is left to drive them."""
    power, slope = model.power(cycle.square, winding), model.slope(cycle.square, winding)
    mean = cycle.mean(slope)
    modes = Modes.of(
        model.r_winding_housing, model.r_housing_ambient, model.c_winding, model.c_housing, mean
    )
    return modes, power - mean * (winding - model.ambient)


def _mean_temperature(model: ThermalModel, cycle: Cycle) -> float | None:
    """Smallest T = T_a + R·mean(tau²)·loss(T), K; None where there is none."""
    square = np.array([cycle.mean(cycle.square)])
    total = model.r_winding_housing + model.r_housing_ambient
    temperature = np.array([model.ambient])
    for _ in range(PASSES):
        slope = 1.0 - total * model.slope(square, temperature)[0]
        if slope <= 0 or temperature[0] > HOTTEST:
            return None
        step = (
            model.ambient + total * model.power(square, temperature)[0] - temperature[0]
        ) / slope
        temperature = temperature + step
        if abs(step) < SETTLED:
            return float(temperature[0])
    return None


def warm_up(model: ThermalModel, cycle: Cycle, start: tuple[float, float]) -> Temperatures:
    """Temperatures over one cycle that starts with winding and housing at `start`, K."""
    winding = np.full(len(cycle.t), start[0])
    rise = np.array(start) - model.ambient
    for _ in range(PASSES):
        modes, power = _linearised(model, cycle, winding)
        states = follow(modes, cycle.t, power) + modes.decay(cycle.t) * modes.states(rise)[:, None]
        warmer, housing = modes.temperatures(states)
        change, winding = (
            float(np.abs(model.ambient + warmer - winding).max()),
            model.ambient + warmer,
        )
        if change < SETTLED or winding.max() > HOTTEST:
            break
    return Temperatures(winding, model.ambient + housing, "warming up")


def time_until(model: ThermalModel, cycle: Cycle, limit: float) -> float | None:
    """Time from cold until the winding of a repeated cycle first reaches `limit` (K), s; None where it never does.

    Where little changes from one cycle to the next many are taken at once: as many as warm the motor by STEP.
    """
    steady = steady_state(model, cycle)
    if steady.steady and steady.peak < limit:
        return None
    longest = (
        60.0
        * (model.r_winding_housing + model.r_housing_ambient)
        * (model.c_winding + model.c_housing)
    )
    here = back = _Start(0, model.ambient, model.ambient)
    most = 1 << 40
    while here.cycles * cycle.period <= longest:
        reached = warm_up(model, cycle, (here.winding, here.housing))
        hot = np.flatnonzero(reached.winding >= limit)
        taken = here.cycles - back.cycles
        if len(hot) and taken <= 1:
            return here.cycles * cycle.period + _crossing(
                cycle.t, reached.winding, int(hot[0]), limit
            )
        if len(hot):
            here, most = back, taken // 2
            reached = warm_up(model, cycle, (here.winding, here.housing))
        back, here = here, _later(model, cycle, reached, here, most)
    return None


@dataclass(frozen=True)
class _Start:
    """Temperatures at the start of a repetition, K, and how many went before."""

    cycles: int
    winding: float
    housing: float


def _later(
    model: ThermalModel, cycle: Cycle, reached: Temperatures, start: _Start, most: int
) -> _Start:
    """The start of a later repetition, at most `most` on: the loss linearised about the temperatures `reached`."""
    change = max(
        abs(reached.winding[-1] - start.winding), abs(reached.housing[-1] - start.housing), 1e-12
    )
    stride = int(max(min(most, STEP / change), 1))
    if stride == 1:
        return _Start(start.cycles + 1, float(reached.winding[-1]), float(reached.housing[-1]))
    modes, power = _linearised(model, cycle, reached.winding)
    decay = modes.decay(cycle.period)[:, 0]
    first = modes.states(np.array([start.winding, start.housing]) - model.ambient)
    gained = follow(modes, cycle.t, power)[:, -1]
    state = decay**stride * first + gained * np.expm1(stride * np.log(decay)) / (decay - 1.0)
    winding, housing = model.ambient + modes.temperatures(state)
    return _Start(start.cycles + stride, float(winding), float(housing))


def _crossing(t: Array, winding: Array, k: int, limit: float) -> float:
    if k == 0 or winding[k] == winding[k - 1]:
        return float(t[k])
    share = (limit - winding[k - 1]) / (winding[k] - winding[k - 1])
    return float(t[k - 1] + share * (t[k] - t[k - 1]))
