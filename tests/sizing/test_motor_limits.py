"""The speed–torque line, the operating regions and the derating of a motor obey their formulas.

Impossible conditions are refused.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ssm_planner.errors import ProblemError
from ssm_planner.sizing.motor_limits import (
    Conditions,
    available_torque,
    continuous_torque,
    operating_region_shares,
    resistance,
    torque_constant,
)
from tests.support.sizing_cases import COMPLETE


@given(st.floats(0, 1400), st.floats(260, 430), st.floats(6, 48), st.floats(1, 30))
@settings(max_examples=50, deadline=None)
def test_the_available_torque_needs_at_most_the_supply_voltage(
    speed: float, temperature: float, supply: float, current: float
) -> None:
    """The available torque needs at most the supply voltage.

    It needs the whole supply voltage unless the limit of torque or current is lower. It is zero
    only if the speed alone needs at least the supply voltage.
    """
    conditions = Conditions(supply_voltage=supply, current_limit=current)
    w = np.array([speed])
    torque = available_torque(COMPLETE, conditions, w, temperature)
    k = torque_constant(COMPLETE, temperature)
    assert torque[0] <= min(COMPLETE.max_torque, k * current) * (1 + 1e-12)
    needed = (resistance(COMPLETE, temperature) / k * torque + k * w)[0]
    if torque[0] == 0.0:
        assert k * speed >= supply * (1 - 1e-12)
    else:
        assert needed <= supply * (1 + 1e-9)
        if torque[0] < min(COMPLETE.max_torque, k * current) * (1 - 1e-12):
            assert needed == pytest.approx(supply, rel=1e-9)


def test_the_line_ends_at_stall_and_at_no_load() -> None:
    """The available torque falls linearly from the stall torque to zero at the no-load speed."""
    motor = replace(COMPLETE, max_torque=100.0, max_speed=1e4)
    stall, no_load = 24 / 0.5 * 0.026, 24 / 0.026
    torque = available_torque(motor, Conditions(), np.array([0.0, no_load / 2, no_load]))
    assert torque == pytest.approx([stall, stall / 2, 0.0], abs=1e-12)
    assert available_torque(COMPLETE, Conditions(), np.array([1501.0])) == 0.0


def test_copper_and_magnets_warm() -> None:
    """At a higher temperature, the resistance is larger and the torque constant is smaller."""
    assert resistance(COMPLETE, 398.15) == pytest.approx(0.5 * 1.393)
    assert torque_constant(COMPLETE, 398.15) == pytest.approx(0.026 * 0.89)
    assert (
        torque_constant(replace(COMPLETE, torque_constant_per_kelvin=None), 398.15) < 0.026 * 0.89
    )


def test_continuous_torque_falls_with_the_surroundings() -> None:
    assert continuous_torque(COMPLETE, 280.0) == COMPLETE.nominal_torque
    half_way = continuous_torque(COMPLETE, (298.15 + 428.15) / 2)
    assert half_way == pytest.approx(COMPLETE.nominal_torque * np.sqrt(0.5))
    assert continuous_torque(COMPLETE, 428.15) == 0.0
    assert continuous_torque(replace(COMPLETE, max_winding_temperature=None), 310.0) is None
    assert (
        continuous_torque(replace(COMPLETE, max_winding_temperature=None), 298.15)
        == COMPLETE.nominal_torque
    )


def test_shares_of_the_regions() -> None:
    speed = np.array([0.0, 100.0, 100.0, 1600.0])
    torque = np.array([0.05, -0.09, 0.2, 0.01])
    shares = operating_region_shares(
        COMPLETE, Conditions(), speed, torque, np.array([0.4, 0.3, 0.2, 0.1])
    )
    assert shares == pytest.approx({"continuous": 0.7, "short_term": 0.2, "beyond": 0.1})


@pytest.mark.parametrize(
    "given",
    [
        {"confidence": 1.0},
        {"confidence": 0.2},
        {"confidence": float("nan")},
        {"ambient": 25.0},
        {"pause": -1.0},
        {"draws": 10},
        {"spread": 1.5},
        {"supply_voltage": 0.0},
        {"current_limit": float("inf")},
    ],
)
def test_conditions_that_make_no_sense(given: dict) -> None:
    """An impossible condition is refused, and the message names it."""
    with pytest.raises(ProblemError, match=next(iter(given))):
        Conditions(**given)
