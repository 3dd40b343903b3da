"""The bands of the required torque are compared with Monte Carlo draws of the exact law.

Further tests cover ranges of friction parameters and invalid covariances.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssm_planner.dynamics.spread import drive_with_values, friction_spread
from ssm_planner.errors import ProblemError
from ssm_planner.problem.robot import Robot
from ssm_planner.sizing.demand import (
    DEMAND_NAMES,
    compute_demands,
    linear_band,
    monte_carlo,
    select_instants,
)
from ssm_planner.sizing.duty import back_and_forth
from ssm_planner.sizing.joint_load import JointLoad, joint_loads
from tests.support.sizing_cases import COMPLETE, random_trajectory, with_covariance

JUDGED = ("peak_torque", "rms_torque", "peak_voltage", "peak_effort", "continuous_effort")


@pytest.mark.parametrize("relative", [0.03, 0.12])
def test_linear_band_agrees_with_monte_carlo(loads: tuple[JointLoad, ...], relative: float) -> None:
    for load in loads:
        drive = with_covariance(load.drive, relative)
        spread = friction_spread(drive)
        driven = replace(load, drive=drive, motor=COMPLETE)
        linear = linear_band(driven, spread)
        drawn_band = monte_carlo(driven, spread, 10_000)
        for name in JUDGED:
            assert linear.high(name, 0.99) == pytest.approx(drawn_band.high(name, 0.99), rel=0.03)
            assert linear.low(name, 0.99) == pytest.approx(drawn_band.low(name, 0.99), rel=0.03)
            assert drawn_band.low(name, 0.99) <= drawn_band.nominal_value(name) * (1 + 1e-4)
            assert drawn_band.nominal_value(name) <= drawn_band.high(name, 0.99) * (1 + 1e-4)


def test_a_draw_is_the_exact_law(loads: tuple[JointLoad, ...]) -> None:
    """The demands of many drives computed together equal those of each drive computed alone."""
    load = loads[1]
    spread = friction_spread(with_covariance(load.drive))
    values = spread.values(spread.deviations(7))
    many = drive_with_values(load.drive, {name: value[:, None] for name, value in values.items()})
    together = compute_demands(replace(load, drive=many, motor=COMPLETE))
    for n in range(7):
        alone = replace(
            load.drive.friction,
            **{name: float(value[n]) for name, value in values.items()},
            mu_static=load.drive.friction.mu_static
            * float(values["mu"][n])
            / load.drive.friction.mu,
        )
        drive = replace(load.drive, friction=alone)
        expected = compute_demands(replace(load, drive=drive, motor=COMPLETE)).array()[0]
        assert together.array()[n] == pytest.approx(expected, rel=1e-12)


def test_draws_have_the_covariance(loads: tuple[JointLoad, ...]) -> None:
    spread = friction_spread(with_covariance(loads[0].drive))
    sample = spread.deviations(200_000)
    scale = np.outer(spread.sigma, spread.sigma)
    assert np.abs((np.cov(sample.T) - spread.covariance) / scale).max() < 0.02
    assert np.array_equal(spread.deviations(100), spread.deviations(100))


def test_the_few_instants_of_a_monte_carlo_suffice(robot: Robot) -> None:
    for seed in range(4):
        for load in joint_loads(random_trajectory(seed), robot):
            few = select_instants(load)
            assert len(few.t) < 1500
            full, part = (
                compute_demands(replace(item, motor=COMPLETE)).array()[0] for item in (load, few)
            )
            assert part == pytest.approx(full, rel=2e-3)


def test_ranges_are_mastered_at_every_corner(loads: tuple[JointLoad, ...]) -> None:
    for load in loads:
        f = load.drive.friction
        ranges = {"mu": (0.8 * f.mu, 1.3 * f.mu), "b_v": (0.5 * f.b_v, 2 * f.b_v)}
        drive = replace(load.drive, friction_ranges=ranges)
        driven = replace(load, drive=drive)
        band = linear_band(driven, friction_spread(drive))
        rng = np.random.default_rng(5)
        for _ in range(20):
            values = {name: float(rng.uniform(*ends)) for name, ends in ranges.items()}
            inside = compute_demands(replace(load, drive=drive_with_values(drive, values))).array()[
                0
            ]
            for name, value in zip(DEMAND_NAMES, inside, strict=True):
                if name != "peak_voltage":
                    assert (
                        band.low(name, 0.99) * (1 - 1e-9)
                        <= value
                        <= band.high(name, 0.99) * (1 + 1e-9)
                    )
        drawn_band = monte_carlo(driven, friction_spread(drive), 1000)
        assert drawn_band.high("peak_torque", 0.99) == pytest.approx(
            band.high("peak_torque", 0.99), rel=2e-3
        )


def test_a_stated_range_replaces_the_covariance_of_that_parameter(
    loads: tuple[JointLoad, ...],
) -> None:
    drive = with_covariance(loads[0].drive)
    drive = replace(drive, friction_ranges={"mu": (0.1, 0.2)})
    spread = friction_spread(drive, 0.5)
    assert spread.names == ("b_c", "b_v", "b_oc")
    assert spread.ranges["mu"] == (0.1, 0.2)
    assert spread.ranges["b_ov"] == pytest.approx(
        (0.5 * drive.friction.b_ov, 1.5 * drive.friction.b_ov)
    )
    assert spread.mu_ends(drive, 0.99) == (0.1, 0.2)


def test_the_static_coefficient_moves_with_the_kinetic_one(loads: tuple[JointLoad, ...]) -> None:
    drive = loads[0].drive
    f = drive.friction
    twice = drive_with_values(drive, {"mu": 2 * f.mu}).friction
    assert twice.mu_static == pytest.approx(2 * f.mu_static)
    assert drive_with_values(drive, {"mu": 0.2, "mu_static": 0.3}).friction.mu_static == 0.3


def test_nothing_known_is_no_band(loads: tuple[JointLoad, ...]) -> None:
    """A band without a stated uncertainty has no width and counts as unknown."""
    load = loads[0]
    spread = friction_spread(load.drive)
    assert not spread.is_stated
    for band in (linear_band(load, spread), monte_carlo(load, spread, 1000)):
        assert not band.known
        assert (
            band.high("peak_torque", 0.99)
            == band.nominal_value("peak_torque")
            == band.low("peak_torque", 0.99)
        )


def test_a_standing_joint_adds_nothing_but_its_load(robot: Robot) -> None:
    """The Monte Carlo and linear bands also agree for a motion that ends with a long rest."""
    from ssm_planner.problem.motion import Stroke
    from ssm_planner.trajectory import Trajectory, rest_coefficients

    stroke = back_and_forth(Stroke("tilt", 0.0, 0.3, 0.5, 2.0))
    rest = rest_coefficients(stroke.coefficients[0, 0])
    end = stroke.breaks[-1]
    breaks = np.append(stroke.breaks, end + 2.0)
    longer = Trajectory(breaks, np.concatenate([stroke.coefficients, rest]), ())
    for load in joint_loads(longer, robot):
        drive = with_covariance(load.drive)
        spread, driven = friction_spread(drive), replace(load, drive=drive)
        exact, linear = monte_carlo(driven, spread, 2000), linear_band(driven, spread)
        for name in ("rms_torque", "peak_effort"):
            assert exact.high(name, 0.99) == pytest.approx(linear.high(name, 0.99), rel=0.03)


@pytest.mark.parametrize(
    ("table", "reason"),
    [
        ({"mu": {"mu": -1e-6}}, "negative"),
        ({"mu": {"mu": 1e-4, "b_c": 1e-6}, "b_c": {"mu": -1e-6, "b_c": 1e-7}}, "not symmetric"),
        (
            {"mu": {"mu": 1e-4, "b_c": 1e-4}, "b_c": {"mu": 1e-4, "b_c": 1e-6}},
            "not positive semidefinite",
        ),
        ({"mu": {"mu": 1e-4}, "b_c": {"mu": 0.0, "b_c": 1e-6}}, "lacks the entry of b_c"),
        ({"nu": {"nu": 1e-4}}, "nu is not a parameter"),
        ({"stribeck_speed": {"stribeck_speed": 1.0}}, "lacks stribeck_speed"),
    ],
)
def test_an_invalid_covariance_is_refused(
    loads: tuple[JointLoad, ...], table: dict, reason: str
) -> None:
    """An invalid covariance is refused with the name of its file and key."""
    drive = loads[0].drive
    with pytest.raises(ProblemError, match=reason) as caught:
        friction_spread(replace(drive, friction=replace(drive.friction, covariance=table)))
    assert str(drive.file) in str(caught.value)
    assert "friction.covariance" in str(caught.value)
