"""The thermal model of winding and housing is compared with closed forms and an ODE solver.

The simulation of many cycles is the reference for its steady state.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ssm_planner.errors import ProblemError
from ssm_planner.sizing.thermal_network import (
    Cycle,
    ThermalModel,
    steady_state,
    time_until,
    warm_up,
)
from tests.support.sizing_cases import COMPLETE

MODEL = ThermalModel.from_motor(COMPLETE, 298.15)
LINEAR = replace(MODEL, copper=0.0, magnet=0.0)


def cycle_of(rms: float, period: float = 3.0, pause: float = 0.5, count: int = 2001) -> Cycle:
    t = np.linspace(0.0, period, count)
    shape = np.where(t < period / 2, 1.0, -0.6) * (1 + 0.3 * np.sin(14 * t / period))
    cycle = Cycle.from_torque(t, shape, pause)
    return cycle.scaled(rms / np.sqrt(cycle.mean(cycle.square)))


def closed_form(model: ThermalModel, power: float, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the temperature rises (n,) of winding and housing in K after a step of the power in W.

    The two time constants are the roots of the characteristic polynomial.
    """
    a, b, c, d = model.r_winding_housing, model.r_housing_ambient, model.c_winding, model.c_housing
    sum_, product = a * c + b * d + b * c, a * b * c * d
    slow = (sum_ + np.sqrt(sum_**2 - 4 * product)) / 2
    fast = product / slow
    # The conditions T_h(0) = 0 and T_h'(0) = 0 determine the two amplitudes.
    housing = (
        b * power * (1 - (slow * np.exp(-t / slow) - fast * np.exp(-t / fast)) / (slow - fast))
    )
    rate = b * power * (np.exp(-t / slow) - np.exp(-t / fast)) / (slow - fast)
    return housing + a * (d * rate + housing / b), housing


def test_capacities_are_those_of_the_datasheet() -> None:
    assert MODEL.c_winding * MODEL.r_winding_housing == pytest.approx(
        COMPLETE.time_constant_winding
    )
    assert MODEL.c_housing * MODEL.r_housing_ambient == pytest.approx(COMPLETE.time_constant_motor)


@given(st.floats(0.3, 5), st.floats(1, 40), st.floats(0.1, 30), st.floats(50, 1500))
@settings(max_examples=40, deadline=None)
def test_step_response(inner: float, outer: float, winding: float, motor: float) -> None:
    model = replace(
        LINEAR,
        r_winding_housing=inner,
        r_housing_ambient=outer,
        c_winding=winding / inner,
        c_housing=motor / outer,
    )
    t = np.linspace(0.0, 4 * motor, 400)
    cycle = Cycle(t, np.full(len(t), 0.01))
    reached = warm_up(model, cycle, (298.15, 298.15))
    expected = closed_form(model, model.loss * 0.01, t)
    for found, rise in zip((reached.winding, reached.housing), expected, strict=True):
        # The documented accuracy is 1e-3, and the method reaches 1e-8.
        assert np.abs(found - 298.15 - rise).max() <= 1e-3 * rise.max()
        assert np.abs(found - 298.15 - rise).max() <= 1e-8 * rise.max()


def test_nonlinear_loss_against_an_ode_solver() -> None:
    from scipy.integrate import solve_ivp

    cycle = cycle_of(0.09, period=40.0, pause=10.0)

    def balance(t: float, state: np.ndarray) -> list[float]:
        square = np.interp(t, cycle.t, cycle.square)
        heat = MODEL.power(square, state[0])[0] - (state[0] - state[1]) / MODEL.r_winding_housing
        out = (state[0] - state[1]) / MODEL.r_winding_housing - (
            state[1] - 298.15
        ) / MODEL.r_housing_ambient
        return [heat / MODEL.c_winding, out / MODEL.c_housing]

    solved = solve_ivp(
        balance, (0, cycle.period), [320.0, 310.0], rtol=1e-9, atol=1e-9, max_step=0.02
    )
    reached = warm_up(MODEL, cycle, (320.0, 310.0))
    assert np.abs(np.interp(solved.t, cycle.t, reached.winding) - solved.y[0]).max() < 0.01
    assert np.abs(np.interp(solved.t, cycle.t, reached.housing) - solved.y[1]).max() < 0.01


def simulated(model: ThermalModel, cycle: Cycle) -> np.ndarray:
    """Return the winding temperature (n,) in K over a cycle that follows many equal cycles.

    Heun's method, which is an explicit trapezoidal rule, integrates both temperatures.
    """
    steps, square = np.diff(cycle.t), cycle.square
    winding = housing = model.ambient
    repeats = int(20 * model.c_housing * model.r_housing_ambient / cycle.period)
    trace = np.zeros(len(cycle.t))
    for _ in range(repeats):
        trace[0] = winding
        for k, h in enumerate(steps):
            rates = []
            temperatures = (winding, housing)
            for s in (square[k], square[k + 1]):
                warm = temperatures[0] - 298.15
                grown = (1 + model.copper * warm) / (1 + model.magnet * warm) ** 2
                flow = (temperatures[0] - temperatures[1]) / model.r_winding_housing
                rates.append(
                    (
                        (model.loss * s * grown - flow) / model.c_winding,
                        (flow - (temperatures[1] - model.ambient) / model.r_housing_ambient)
                        / model.c_housing,
                    )
                )
                temperatures = (winding + h * rates[0][0], housing + h * rates[0][1])
            winding += h * (rates[0][0] + rates[1][0]) / 2
            housing += h * (rates[0][1] + rates[1][1]) / 2
            trace[k + 1] = winding
    return trace


def test_steady_state_is_what_simulating_ends_in() -> None:
    cycle = cycle_of(0.10, count=161, pause=0.0)
    trace = simulated(MODEL, cycle)
    result = steady_state(MODEL, cycle)
    assert result.steady
    assert result.peak - 298.15 > 50
    assert np.abs(result.winding - trace).max() <= 0.1


@given(st.floats(0.02, 0.11), st.floats(0.2, 60), st.floats(0, 30))
@settings(max_examples=40, deadline=None)
def test_steady_state_repeats_and_keeps_the_heat_balance(
    rms: float, period: float, pause: float
) -> None:
    cycle = cycle_of(rms, period, pause, count=801)
    found = steady_state(MODEL, cycle)
    if not found.steady:
        return
    again = warm_up(MODEL, cycle, (found.winding[0], found.housing[0]))
    assert np.abs(again.winding - found.winding).max() < 1e-4
    assert found.winding[-1] == pytest.approx(found.winding[0], abs=1e-5)
    # Over one cycle, all heat leaves through the housing.
    mean = np.sum(np.diff(cycle.t) * (found.housing[1:] + found.housing[:-1])) / 2 / cycle.period
    made = cycle.mean(MODEL.power(cycle.square, found.winding)[0])
    assert (mean - 298.15) / MODEL.r_housing_ambient == pytest.approx(made, rel=1e-3)


def test_there_is_no_steady_state_when_losses_outrun_the_cooling() -> None:
    cycle = cycle_of(0.16)
    result = steady_state(MODEL, cycle)
    assert not result.steady
    assert result.status == "no steady state"
    assert time_until(MODEL, cycle, 428.15) is not None


@pytest.mark.parametrize("rms", [0.128, 0.15, 0.3, 0.7])
def test_time_until_too_hot(rms: float) -> None:
    cycle = cycle_of(rms, count=401)
    result = time_until(MODEL, cycle, 428.15)
    start, cycles = (298.15, 298.15), 0
    while True:  # Each pass simulates one cycle.
        reached = warm_up(MODEL, cycle, start)
        if reached.winding.max() >= 428.15:
            break
        start, cycles = (reached.winding[-1], reached.housing[-1]), cycles + 1
        assert cycles < 3000
    first = cycle.t[np.argmax(reached.winding >= 428.15)]
    assert result == pytest.approx(
        cycles * cycle.period + first, abs=cycle.period if cycles > 50 else 0.02
    )


def test_a_sustainable_cycle_is_never_too_hot() -> None:
    assert time_until(MODEL, cycle_of(0.05), 428.15) is None


def test_missing_figures_are_named() -> None:
    for name in (
        "terminal_resistance",
        "time_constant_motor",
        "resistance_winding_housing",
        "torque_constant",
    ):
        with pytest.raises(ProblemError, match=name):
            ThermalModel.from_motor(replace(COMPLETE, **{name: None}), 298.15)
