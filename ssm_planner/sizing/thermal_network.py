"""Compute the temperatures of a motor with a thermal model of two bodies, winding and housing.

    C_w dT_w/dt = P(t, T_w) − (T_w − T_h)/R_wh          P = R(T_w)·(tau/k(T_w))²
    C_h dT_h/dt = (T_w − T_h)/R_wh − (T_h − T_a)/R_ha

T_w, T_h and T_a are the temperatures of winding, housing and surroundings, C_w and C_h heat
capacities, R_wh and R_ha the thermal resistances from winding to housing and from housing to
ambient, P the heat in the winding, R its electrical resistance, k the torque constant and tau the
motor torque. The capacities follow from the time constants of datasheets:
C_w = time_constant_winding / R_wh and C_h = time_constant_motor / R_ha. R grows by 0.393 %/K. The
magnets are assumed to be as hot as the winding, which is the safe assumption.

Only P(T_w) is nonlinear, so P is linearised repeatedly about the temperatures of the previous pass.
Each pass solves the equations exactly in their two modes, for a power that is piecewise linear in
time.
"""

import math

import numpy as np

from ssm_planner.problem import Motor
from ssm_planner.sizing.motor_limits import (
    COPPER_COEFFICIENT,
    REFERENCE_TEMPERATURE,
    magnet_coefficient,
    require_value,
    resistance,
    torque_constant,
)
from ssm_planner.typing import Array, frozen, record

SERIES_THRESHOLD = 1e-4
"""Threshold of |x| below which `_exponential_quotients` uses power series."""


@record
class ThermalModes:
    """The two independent modes of the thermal model x' = A x + b P.

    The vector x contains the temperatures of the inner body (winding) and of the outer body
    (housing) above ambient, in K, and P is the power in the inner body, in W. Each mode z is a
    combination of both temperatures that satisfies a scalar equation z' = rate·z + input·P.

    Attributes
    ----------
    rates : (2,) array
        Rates of the modes, 1/s. A negative rate means that the mode settles.
    input : (2,) array
        Effect of the power on each mode.
    shape : (2, 2) array
        Matrix that gives the temperatures, x = shape @ z.
    inverse : (2, 2) array
        Inverse of `shape`, so that z = inverse @ x.
    """

    rates: Array
    input: Array
    shape: Array
    inverse: Array

    @classmethod
    def from_network(
        cls, r_inner: float, r_outer: float, c_inner: float, c_outer: float, gain: float = 0.0
    ) -> "ThermalModes":
        """Compute the modes of two bodies that exchange heat.

        The temperatures are scaled by the square roots of the capacities. This makes the matrix of
        the equations symmetric, so that its eigenvectors are orthogonal.

        Parameters
        ----------
        r_inner, r_outer : float
            Thermal resistances from the inner to the outer body, and from the outer body to
            ambient, K/W.
        c_inner, c_outer : float
            Heat capacities, J/K.
        gain : float
            Additional power per kelvin of the inner body, W/K. It represents the loss that grows
            with the winding temperature.

        Returns
        -------
        ThermalModes
            Both modes.
        """
        # With y = √C T, the equations become y' = symmetric y + (power in the inner body) / √C.
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
    def is_unstable(self) -> bool:
        """True if a mode does not settle because the losses grow faster than the heat leaves."""
        return bool(self.rates.max() >= 0.0)

    def decay(self, t: Array | float) -> Array:
        """Compute the fraction of each mode that remains after given times without power.

        Parameters
        ----------
        t : float or (n,) array
            Times, s.

        Returns
        -------
        (2, n) array
            Fractions. n is 1 for a single time.
        """
        return np.exp(self.rates[:, None] * np.atleast_1d(t))

    def temperatures(self, states: Array) -> Array:
        """Convert modes into temperatures.

        Parameters
        ----------
        states : (2, n) array
            Values of both modes at n instants.

        Returns
        -------
        (2, n) array
            Temperatures of the inner and the outer body above ambient, K.
        """
        return self.shape @ states

    def states(self, rise: Array) -> Array:
        """Convert temperatures into modes.

        Parameters
        ----------
        rise : (2,) array
            Temperatures of the inner and the outer body above ambient, K.

        Returns
        -------
        (2,) array
            Values of both modes.
        """
        return self.inverse @ rise


def simulate_modes(modes: ThermalModes, t: Array, power: Array) -> Array:
    """Compute how the modes of the thermal model respond to a given power.

    All modes start at zero, that is, winding and housing start at ambient temperature. The solution
    is exact for a power that is linear between the instants.

    Parameters
    ----------
    modes : ThermalModes
        Modes of the thermal model.
    t : (n,) array
        Instants, s.
    power : (n,) array
        Power in the winding at the instants, W.

    Returns
    -------
    (2, n) array
        Modes z at the instants.
    """
    step = np.diff(t)
    x = modes.rates[:, None] * step
    order_one, order_two = _exponential_quotients(x)
    gained = modes.input[:, None] * step * (order_one * power[:-1] + order_two * np.diff(power))
    states = np.zeros((2, len(t)))
    states[:, 1:] = _solve_recursion(np.exp(x), gained)
    return states


def _solve_recursion(factor: Array, gained: Array) -> Array:
    """Solve a linear recursion of first order for two modes.

    The recursion is z_k = factor_k·z_(k−1) + gained_k with z_0 = 0 for k = 1 to n.

    Each step doubles the number of combined terms, so log2(n) operations on arrays suffice.

    Parameters
    ----------
    factor, gained : (2, n) arrays
        Coefficients of the recursion for each of the two modes.

    Returns
    -------
    (2, n) array
        Values z_1 to z_n.
    """
    factor = factor.copy()
    result = gained.copy()
    reach = 1
    while reach < result.shape[1]:
        result[:, reach:] = result[:, reach:] + factor[:, reach:] * result[:, :-reach]
        factor[:, reach:] = factor[:, reach:] * factor[:, :-reach]
        reach *= 2
    return result


def _exponential_quotients(x: Array) -> tuple[Array, Array]:
    """Compute two quotients of the exponential function without loss of digits near 0.

    They are (eˣ − 1)/x and (eˣ − 1 − x)/x².

    The quotients are the responses of a mode to a constant and to a linearly growing power.

    Parameters
    ----------
    x : array
        Arguments, of any shape.

    Returns
    -------
    order_one, order_two : arrays of the same shape
        Both quotients. Power series replace them for |x| below `SERIES_THRESHOLD`, where the
        differences lose all digits.
    """
    is_small = np.abs(x) < SERIES_THRESHOLD
    safe = np.where(is_small, 1.0, x)
    order_one = np.where(is_small, 1.0 + x / 2 + x * x / 6, np.expm1(safe) / safe)
    order_two = np.where(is_small, 0.5 + x / 6 + x * x / 24, (np.expm1(safe) - safe) / safe**2)
    return order_one, order_two


THERMAL_DATA = (
    "torque_constant",
    "terminal_resistance",
    "resistance_winding_housing",
    "resistance_housing_ambient",
    "time_constant_winding",
    "time_constant_motor",
    "max_winding_temperature",
)
"""Data that the thermal check needs from a motor file."""
TEMPERATURE_TOLERANCE = 1e-6
"""Tolerance of the iterations, K."""
MOST_ITERATIONS = 60
"""Largest number of passes in an iteration."""
LARGEST_TEMPERATURE = 1500.0
"""Temperature (K) above which a steady state is rejected."""
PAUSE_INSTANTS = 300
"""Number of instants in a pause."""
PAUSE_INTERVAL_RATIO = 1e4
"""Ratio of the last to the first interval of a pause, minus 1."""
LARGEST_TEMPERATURE_CHANGE = 2.0
"""Largest change of the temperatures over the cycles that are computed at once, K."""


@frozen
class ThermalModel:
    """Thermal resistances and capacities of a motor, and its heat loss, in SI units.

    The equations are at the top of this module. Temperatures are in K, resistances in K/W, and
    capacities in J/K.

    Examples
    --------
    >>> import numpy as np
    >>> import ssm_planner as ssm
    >>> model = ssm.ThermalModel(
    ...     r_winding_housing=2.5,
    ...     r_housing_ambient=20.0,
    ...     c_winding=1.0,
    ...     c_housing=20.0,
    ...     ambient=298.15,
    ...     loss=100.0,
    ... )
    >>> model.copper > 0
    True
    """

    r_winding_housing: float
    r_housing_ambient: float
    c_winding: float
    c_housing: float
    ambient: float
    """Ambient temperature, K."""
    loss: float
    """R/k² at 25 °C, W/(N·m)²."""
    copper: float = COPPER_COEFFICIENT
    """Relative change of the winding resistance, 1/K."""
    magnet: float = 0.0
    """Relative change of the torque constant, 1/K."""

    @classmethod
    def from_motor(cls, motor: Motor, ambient: float) -> "ThermalModel":
        """Build the model from the data of a motor file.

        Parameters
        ----------
        motor : Motor
            Motor with electrical and thermal data.
        ambient : float
            Ambient temperature, K.

        Returns
        -------
        ThermalModel
            Resistances, capacities and heat loss of the motor.

        Raises
        ------
        ProblemError
            If data of `THERMAL_DATA` other than the temperature limit are missing.
        """
        inner = require_value(motor, "resistance_winding_housing")
        outer = require_value(motor, "resistance_housing_ambient")
        return cls(
            inner,
            outer,
            c_winding=require_value(motor, "time_constant_winding") / inner,
            c_housing=require_value(motor, "time_constant_motor") / outer,
            ambient=ambient,
            loss=resistance(motor) / torque_constant(motor) ** 2,
            copper=COPPER_COEFFICIENT,
            magnet=magnet_coefficient(motor),
        )

    def power(self, square: Array, winding: Array) -> tuple[Array, Array]:
        """Compute the heat in the winding and its derivative by the winding temperature.

        The heat is P = loss·tau²·(1 + copper·ΔT) / (1 + magnet·ΔT)², where ΔT is the winding
        temperature minus 25 °C and loss, copper and magnet are the attributes of this model. The
        factor of the magnets is at least 0.05, and temperatures above `LARGEST_TEMPERATURE` count
        as this temperature, so that the iterations stay finite.

        Parameters
        ----------
        square : array
            Squared motor torques tau², (N·m)².
        winding : array with the shape of square
            Winding temperatures, K.

        Returns
        -------
        power, slope : arrays with the shape of square
            Heat P (W) and derivative dP/dT_w (W/K).
        """
        warm = np.minimum(winding, LARGEST_TEMPERATURE) - REFERENCE_TEMPERATURE
        copper = 1 + self.copper * warm
        magnet = np.maximum(1 + self.magnet * warm, 0.05)
        growth = self.copper / magnet**2 - 2 * self.magnet * copper / magnet**3
        cold = self.loss * square
        return cold * (copper / magnet**2), cold * growth


@record
class Cycle:
    """Motor torque over one repetition of a motion and its pause.

    Examples
    --------
    >>> import numpy as np
    >>> import ssm_planner as ssm
    >>> cycle = ssm.Cycle(t=np.linspace(0.0, 1.0, 5), square=np.ones(5))
    >>> float(cycle.square.mean())
    1.0
    """

    t: Array
    """Instants (n,) from 0 to the end of the pause, s."""
    square: Array
    """Squared motor torque tau² (n,), which is linear between the instants, (N·m)²."""

    @classmethod
    def from_torque(cls, t: Array, torque: Array, pause: float = 0.0) -> "Cycle":
        """Build a cycle from the torque of a motion.

        The torque is zero during the pause.

        Parameters
        ----------
        t : (n,) array
            Instants of the motion, s.
        torque : (n,) array
            Motor torques, N·m.
        pause : float
            Duration of the pause after the motion, s.

        Returns
        -------
        Cycle
            The cycle, which begins at time 0.
        """
        t = t - t[0]
        square = np.square(torque)
        if pause > 0:
            # The instants are densest at the start of the pause, where the winding cools fastest.
            exponents = np.linspace(0.0, np.log1p(PAUSE_INTERVAL_RATIO), PAUSE_INSTANTS)
            share = np.expm1(exponents) / PAUSE_INTERVAL_RATIO
            t = np.append(t, t[-1] + pause * share)
            square = np.append(square, np.zeros(PAUSE_INSTANTS))
        return cls(t, square)

    @property
    def period(self) -> float:
        """Duration of motion and pause, s."""
        return float(self.t[-1])

    def scaled(self, factor: float) -> "Cycle":
        """Return the cycle with another torque of the same shape.

        Parameters
        ----------
        factor : float
            New torque divided by the present one.

        Returns
        -------
        Cycle
            The cycle with the squared torque multiplied by factor².
        """
        return Cycle(self.t, factor**2 * self.square)

    def mean(self, value: Array) -> float:
        """Compute the mean of a quantity over one period.

        Parameters
        ----------
        value : (n,) array
            Values at the instants `t`.

        Returns
        -------
        float
            Mean in the unit of the values, by the trapezoidal rule.
        """
        return float(np.trapezoid(value, self.t) / self.period)


@record
class Temperatures:
    """Temperatures of winding and housing over one cycle."""

    winding: Array
    """Winding temperatures (n,) at the instants of the cycle, K. Infinite without a steady state.
    """
    housing: Array
    """Housing temperatures (n,) at the instants of the cycle, K."""
    status: str = "steady"
    """"steady" if the temperatures repeat with the cycle, "warming up", or "no steady state"."""

    @property
    def steady(self) -> bool:
        """True if the temperatures repeat with the cycle."""
        return self.status == "steady"

    @property
    def peak(self) -> float:
        """Largest winding temperature, K."""
        return float(self.winding.max())


def steady_state(model: ThermalModel, cycle: Cycle) -> Temperatures:
    """Compute the temperatures that repeat with the cycle, without a simulation of the warm-up.

    A Newton iteration first finds the temperature at the mean loss. Each following pass linearises
    the loss about the temperatures of the previous pass and solves the periodic problem exactly,
    until the temperatures change by less than `TEMPERATURE_TOLERANCE`. The linear problem includes
    the mean effect of the temperature on the loss.

    Parameters
    ----------
    model : ThermalModel
        Thermal model of the motor.
    cycle : Cycle
        Motor torque over one repetition.

    Returns
    -------
    Temperatures
        Temperatures at the instants of the cycle. They are infinite, with the status "no steady
        state", if the loss grows faster than the heat can leave.
    """
    mean = _mean_temperature(model, cycle)
    if mean is None:
        return _no_steady_state(cycle)
    return _iterate_temperatures(model, cycle, mean)


def _no_steady_state(cycle: Cycle) -> Temperatures:
    """Build infinite temperatures for a motor that becomes hotter without end.

    Parameters
    ----------
    cycle : Cycle
        Motor torque over one repetition.

    Returns
    -------
    Temperatures
        Temperatures with the status "no steady state".
    """
    infinite = np.full(len(cycle.t), np.inf)
    return Temperatures(infinite, infinite, "no steady state")


def _iterate_temperatures(
    model: ThermalModel, cycle: Cycle, guess: float, start: Array | None = None
) -> Temperatures:
    """Linearise the loss repeatedly until the temperatures over one cycle no longer change.

    Parameters
    ----------
    model : ThermalModel
        Thermal model of the motor.
    cycle : Cycle
        Motor torque over one repetition.
    guess : float
        First guess of the winding temperature, K.
    start : (2,) array, optional
        Temperatures of winding and housing above ambient at the start of the cycle, K. By default,
        the temperatures are those that repeat with the cycle.

    Returns
    -------
    Temperatures
        Temperatures with the status "warming up" if `start` is given, and otherwise "steady" or "no
        steady state".
    """
    is_periodic = start is None
    winding = np.full(len(cycle.t), guess)
    housing = winding
    for _ in range(MOST_ITERATIONS):
        modes, power = _linearise_loss(model, cycle, winding)
        if is_periodic and modes.is_unstable:
            break
        free = simulate_modes(modes, cycle.t, power)
        # A mode that starts at z₀ ends at free + decay · z₀, which equals z₀ if it repeats.
        initial = free[:, -1] / (1.0 - modes.decay(cycle.period)[:, 0])
        if start is not None:
            initial = modes.states(start)
        states = free + modes.decay(cycle.t) * initial[:, None]
        previous = winding
        winding, housing = model.ambient + modes.temperatures(states)
        change = float(np.abs(winding - previous).max())
        if change < TEMPERATURE_TOLERANCE:
            return Temperatures(winding, housing, "steady" if is_periodic else "warming up")
        if not np.isfinite(change) or winding.max() > LARGEST_TEMPERATURE:
            break
    if is_periodic:
        return _no_steady_state(cycle)
    return Temperatures(winding, housing, "warming up")


def _linearise_loss(
    model: ThermalModel, cycle: Cycle, winding: Array
) -> tuple[ThermalModes, Array]:
    """Linearise the loss about given winding temperatures.

    `steady_state` repeats this step, each time about the temperatures of the previous pass. The
    loss is replaced by power + slope·(T_w − T_a), where slope is the mean of dP/dT_w over the
    cycle, T_w the winding temperature and T_a the ambient temperature.

    Parameters
    ----------
    model : ThermalModel
        Thermal model of the motor.
    cycle : Cycle
        Motor torque at n instants.
    winding : (n,) array
        Winding temperatures of the previous pass, K.

    Returns
    -------
    modes
        Modes of the thermal model, which include the slope.
    power : (n,) array
        Part of the loss that does not depend on the temperature, W.
    """
    power, slope = model.power(cycle.square, winding)
    mean = cycle.mean(slope)
    modes = ThermalModes.from_network(
        model.r_winding_housing, model.r_housing_ambient, model.c_winding, model.c_housing, mean
    )
    return modes, power - mean * (winding - model.ambient)


def _mean_temperature(model: ThermalModel, cycle: Cycle) -> float | None:
    """Compute the winding temperature at which the mean loss and the outflow of heat balance.

    It is the smallest solution of T = T_a + R·P(mean(tau²), T), where T_a is the ambient
    temperature, R the thermal resistance from winding to ambient, P the loss and tau the torque.
    Newton's method starts at T_a.

    Parameters
    ----------
    model : ThermalModel
        Thermal model of the motor.
    cycle : Cycle
        Motor torque over one repetition.

    Returns
    -------
    float or None
        Temperature, K. None if there is no solution.
    """
    square = np.array([cycle.mean(cycle.square)])
    total = model.r_winding_housing + model.r_housing_ambient
    temperature = np.array([model.ambient])
    for _ in range(MOST_ITERATIONS):
        power, growth = (total * value[0] for value in model.power(square, temperature))
        if growth >= 1.0 or temperature[0] > LARGEST_TEMPERATURE:
            return None
        step = (model.ambient + power - temperature[0]) / (1.0 - growth)
        temperature = temperature + step
        if abs(step) < TEMPERATURE_TOLERANCE:
            return float(temperature[0])
    return None


def warm_up(model: ThermalModel, cycle: Cycle, start: tuple[float, float]) -> Temperatures:
    """Compute the temperatures over one cycle from given initial temperatures.

    Parameters
    ----------
    model : ThermalModel
        Thermal model of the motor.
    cycle : Cycle
        Motor torque at n instants of one repetition.
    start : (float, float)
        Temperatures of winding and housing at the start of the cycle, K.

    Returns
    -------
    Temperatures
        Temperatures (n,) at the instants of the cycle, with the status "warming up".
    """
    return _iterate_temperatures(model, cycle, start[0], np.array(start) - model.ambient)


def time_until(model: ThermalModel, cycle: Cycle, limit: float) -> float | None:
    """Compute the time until the winding of a cold motor first reaches a temperature.

    The motor starts at ambient temperature and repeats the cycle. If the temperatures change little
    from one cycle to the next, many cycles are computed at once: as many as warm the motor by
    `LARGEST_TEMPERATURE_CHANGE`. If the winding reaches the limit after such a step, the step is
    repeated with half as many cycles, until the cycle that reaches the limit is found.

    Parameters
    ----------
    model : ThermalModel
        Thermal model of the motor.
    cycle : Cycle
        Motor torque over one repetition.
    limit : float
        Winding temperature, K.

    Returns
    -------
    float or None
        Time, s. None if the winding never reaches the limit.
    """
    steady = steady_state(model, cycle)
    if steady.steady and steady.peak < limit:
        return None
    # The search ends after 60 times the slowest possible time constant.
    thermal_resistance = model.r_winding_housing + model.r_housing_ambient
    horizon = 60.0 * thermal_resistance * (model.c_winding + model.c_housing)
    cycles = previous_cycles = 0
    current = previous = np.full(2, model.ambient)
    max_stride = 1 << 40  # no bound before the first step that is too long
    while cycles * cycle.period <= horizon:
        temperatures = warm_up(model, cycle, tuple(current))
        hot = np.flatnonzero(temperatures.winding >= limit)
        stride = cycles - previous_cycles
        if len(hot) and stride <= 1:
            crossing = _crossing_time(cycle.t, temperatures.winding, int(hot[0]), limit)
            return cycles * cycle.period + crossing
        if len(hot):
            cycles = previous_cycles
            current = previous
            max_stride = stride // 2
            temperatures = warm_up(model, cycle, tuple(current))
        previous_cycles = cycles
        previous = current
        stride, current = _advance_cycles(model, cycle, temperatures, current, max_stride)
        cycles += stride
    return None


def _advance_cycles(
    model: ThermalModel, cycle: Cycle, temperatures: Temperatures, start: Array, max_stride: int
) -> tuple[int, Array]:
    """Compute the temperatures after several repetitions of a cycle at once.

    The loss is linearised about the temperatures over the first repetition. Each repetition then
    changes the modes in the same way, and the sum over all repetitions is a geometric series.

    Parameters
    ----------
    model : ThermalModel
        Thermal model of the motor.
    cycle : Cycle
        Motor torque at n instants of one repetition.
    temperatures : Temperatures
        Temperatures (n,) over the first repetition.
    start : (2,) array
        Temperatures of winding and housing at the start of the first repetition, K.
    max_stride : int
        Largest number of repetitions.

    Returns
    -------
    stride : int
        Number of repetitions, with which the temperatures change by about
        `LARGEST_TEMPERATURE_CHANGE`.
    temperatures : (2,) array
        Temperatures of winding and housing after these repetitions, K.
    """
    change = abs(np.array([temperatures.winding[-1], temperatures.housing[-1]]) - start).max()
    stride = int(max(min(max_stride, LARGEST_TEMPERATURE_CHANGE / max(change, 1e-12)), 1))
    modes, power = _linearise_loss(model, cycle, temperatures.winding)
    decay = modes.decay(cycle.period)[:, 0]
    gained_states = simulate_modes(modes, cycle.t, power)[:, -1]
    # Σ decay^i for i = 0 … stride − 1 is (decay^stride − 1)/(decay − 1).
    series = np.expm1(stride * np.log(decay))
    initial = modes.states(start - model.ambient)
    state = decay**stride * initial + gained_states * series / (decay - 1.0)
    return stride, model.ambient + modes.temperatures(state)


def _crossing_time(t: Array, winding: Array, k: int, limit: float) -> float:
    """Return the time at which the winding temperature reaches a limit, by linear interpolation.

    Parameters
    ----------
    t : (n,) array
        Instants, s.
    winding : (n,) array
        Winding temperatures at the instants, K.
    k : int
        Index of the first instant with at least the limit.
    limit : float
        Temperature, K.

    Returns
    -------
    float
        Time between the instants k − 1 and k, s.
    """
    around = slice(max(k - 1, 0), k + 1)
    return float(np.interp(limit, winding[around], t[around]))
