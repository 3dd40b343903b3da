"""The checks of gears and screws agree with closed forms of beam theory and hand calculations.

A check without a stated rating never passes.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ssm_planner.dynamics.spread import friction_spread
from ssm_planner.problem.drive import Ratings
from ssm_planner.sizing.checks import (
    BENDING_ROOTS,
    EFFECTIVE_LENGTH_FACTORS,
    STEEL_DENSITY,
    YOUNG_MODULUS,
    JointCase,
    buckling_load,
    critical_speed,
    gear_checks,
)
from ssm_planner.sizing.demand import linear_band
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.motor_limits import Conditions
from tests.support.sizing_cases import with_covariance

FREQUENCY = {
    "fixed-free": lambda x: math.cos(x) * math.cosh(x) + 1,
    "supported-supported": math.sin,
    "fixed-supported": lambda x: math.tan(x) - math.tanh(x),
    "fixed-fixed": lambda x: math.cos(x) * math.cosh(x) - 1,
}
"""Functions whose zeros are the values βL of the bending modes of a uniform beam."""


@pytest.mark.parametrize("ends", list(BENDING_ROOTS))
def test_bending_constants_are_roots_of_the_frequency_equation(ends) -> None:
    root = BENDING_ROOTS[ends]
    assert abs(FREQUENCY[ends](root)) < 1e-6
    # No sign change lies before the root, so it is the first root.
    before = [FREQUENCY[ends](x) for x in np.linspace(0.3, root - 1e-3, 400)]
    if ends != "fixed-supported":  # The tangent has a pole before the root.
        assert min(before) * max(before) > 0


def test_column_constants_are_roots_of_eulers_equation() -> None:
    x = math.pi / EFFECTIVE_LENGTH_FACTORS["fixed-supported"]
    assert math.tan(x) == pytest.approx(x, rel=1e-7)
    assert (
        EFFECTIVE_LENGTH_FACTORS["fixed-free"],
        EFFECTIVE_LENGTH_FACTORS["supported-supported"],
        EFFECTIVE_LENGTH_FACTORS["fixed-fixed"],
    ) == (
        2.0,
        1.0,
        0.5,
    )


@given(st.floats(0.02, 1), st.floats(0.001, 0.02), st.floats(1.1, 4))
@settings(max_examples=50, deadline=None)
def test_scaling_laws(length: float, diameter: float, factor: float) -> None:
    for ends in BENDING_ROOTS:
        assert critical_speed(factor * length, factor * diameter, ends) == pytest.approx(
            critical_speed(length, diameter, ends) / factor
        )
        assert buckling_load(factor * length, factor * diameter, ends) == pytest.approx(
            buckling_load(length, diameter, ends) * factor**2
        )


def test_against_a_textbook_beam() -> None:
    """A beam supported at both ends has ω = (π/L)²·√(EI/ρA) and F = π²EI/L²."""
    inertia, area = math.pi * 0.01**4 / 64, math.pi * 0.01**2 / 4
    expected = (math.pi / 0.5) ** 2 * math.sqrt(YOUNG_MODULUS * inertia / (STEEL_DENSITY * area))
    assert critical_speed(0.5, 0.01, "supported-supported") == pytest.approx(expected)
    assert buckling_load(0.5, 0.01, "supported-supported") == pytest.approx(
        math.pi**2 * YOUNG_MODULUS * inertia / 0.25
    )


def checks_of(
    load: JointLoad, ratings: Ratings | None, conditions: Conditions | None = None
) -> dict:
    load = replace(load, drive=replace(load.drive, ratings=ratings))
    conditions = conditions or Conditions()
    spread = friction_spread(load.drive, conditions.spread)
    band = linear_band(load, spread)
    return {check.name: check for check in gear_checks(JointCase(load, band, spread, conditions))}


def test_without_ratings_nothing_passes(loads: tuple[JointLoad, ...]) -> None:
    """A check without a rating is open and names the missing rating."""
    for load in loads:
        for name, check in checks_of(load, None).items():
            assert check.passed is None, name
            assert check.needs


def test_margins_by_hand(loads: tuple[JointLoad, ...]) -> None:
    """The margins of a gear equal those computed by hand from its ratings."""
    ratings = Ratings(0.4, 0.5, 200.0, 0.5, 0.06, 2.4e-3, "fixed-free")
    for load in loads:
        result = checks_of(load, ratings, Conditions(pause=1.0))
        peak = np.abs(load.effort()).max()
        assert result["gear_peak_output"].margin == pytest.approx((0.5 - peak) / 0.5)
        fast = np.abs(load.qd).max() * load.drive.ratio
        assert result["gear_speed"].margin == pytest.approx((200 - fast) / 200)
        share = load.moving_share * 3.0 / 4.0
        assert result["gear_duty"].worst == pytest.approx(share)
        moving = load.direction != 0
        cube = np.cbrt(
            load.weight[moving] @ np.abs(load.effort()[moving]) ** 3 / load.weight[moving].sum()
        )
        assert result["gear_continuous_output"].worst == pytest.approx(cube, rel=1e-9)
        if load.joint == "insertion":
            limit = 0.8 * critical_speed(0.06, 2.4e-3, "fixed-free")
            assert result["critical_speed"].margin == pytest.approx(1 - fast / limit)
            assert result["buckling"].worst == pytest.approx(peak)
        else:
            assert "buckling" not in result


def test_self_locking_at_the_lowest_plausible_friction(loads: tuple[JointLoad, ...]) -> None:
    load = loads[2]
    needed = math.cos(load.drive.pressure_angle) * math.tan(load.drive.lead_angle)
    low = replace(load.drive, friction=replace(load.drive.friction, mu_lowest=0.12))
    check = checks_of(replace(load, drive=low), None)["self_locking"]
    assert check.margin == pytest.approx(0.12 / needed - 1)
    identified = replace(load, drive=with_covariance(load.drive, 0.05))
    check = checks_of(identified, None)["self_locking"]
    mu = load.drive.friction.mu
    sigma = math.sqrt(math.log1p(0.05**2))
    assert check.worst == pytest.approx(
        mu * math.exp(-2.326347874 * sigma - sigma**2 / 2), rel=5e-3
    )
    # The answer is open if only one end of the friction range locks the drive. It is no if the
    # whole range lies below the necessary coefficient.
    straddling = checks_of(load, None, Conditions(spread=0.5))["self_locking"]
    assert straddling.passed is None
    assert "between 0.085 and 0.255" in straddling.needs
    slippery = replace(load.drive, friction=replace(load.drive.friction, mu=0.05))
    assert (
        checks_of(replace(load, drive=slippery), None, Conditions(spread=0.5))[
            "self_locking"
        ].passed
        is False
    )
    # Without an uncertainty the answer is open, but the check still states its figures.
    bare = checks_of(load, None)["self_locking"]
    assert (bare.passed, bare.nominal, bare.limit) == (None, mu, pytest.approx(needed))
    loose = replace(load, drive=replace(load.drive, self_locking=False))
    assert "self_locking" not in checks_of(loose, None)
