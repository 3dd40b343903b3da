"""The friction of a drive can change during a recording session.

The change is fitted if the order of the speeds allows it. Otherwise it widens the intervals.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssm_planner.identification.fit import MapFit, fit_map
from ssm_planner.identification.parameters import drive_with_parameters, map_torque
from ssm_planner.identification.session import LONG_PAUSE, session_progress
from ssm_planner.identification.torque_map import TorqueMap, read_torque_map
from ssm_planner.loading.load import load_drive
from tests.support.paths import PROBLEMS

DRIVES = PROBLEMS / "drives"
TRUTH = {"b_c": 5.5e-4, "b_v": 1.15e-5, "b_oc": 4e-3, "mu": 0.12}
SPEEDS = np.pi / 30 * np.array([200, 180, 140, 100, 80, 60, 40, 20, 10, 6, 4, 2.0])
WARM_UP = 0.15
"""Decrease of the friction during a session, as a fraction of the final friction."""


def session(order: str, seed: int, warm_up: float = WARM_UP) -> TorqueMap:
    """Return the torque map of a Coulomb drive whose friction decreases during the session."""
    rng = np.random.default_rng(seed)
    w = np.stack([SPEEDS, -SPEEDS], axis=1).ravel()
    w = {"fast to slow": w, "slow to fast": w[::-1], "random": rng.permutation(w)}[order]
    drive = load_drive(DRIVES / "rig3_worm.yaml")
    share = np.linspace(0, 1, len(w))
    factors = 1 + warm_up * (np.exp(-share / 0.4) - np.exp(-1 / 0.4)) / (1 - np.exp(-1 / 0.4))
    tau = [
        map_torque(
            drive_with_parameters(
                drive, "coulomb", {name: f * value for name, value in TRUTH.items()}
            ),
            np.array([speed]),
            drive.rig.F_payload,
        ).item()
        for speed, f in zip(w, factors, strict=True)
    ]
    tau *= 1 + 0.01 * rng.standard_normal(len(w))
    sequence = np.argsort(w)
    zero = np.zeros(len(w))
    names = tuple(f"{k}" for k in sequence)
    dates = 60.0 * sequence
    return TorqueMap(names, w[sequence], tau[sequence], zero, zero + 1e-9, zero, dates=dates)


def fitted(data: TorqueMap, law: str = "coulomb") -> MapFit:
    """Fit the map of a session of the worm rig."""
    drive = load_drive(DRIVES / "rig3_worm.yaml")
    return fit_map(drive, data, drive.rig.F_payload, law=law, reference=drive.rig.published)


def relative(fit: MapFit) -> tuple[float, float]:
    """Return the interval of b_v as a multiple of the truth."""
    estimate = fit.estimates["b_v"]
    return estimate.low / TRUTH["b_v"], estimate.high / TRUTH["b_v"]


@pytest.mark.usefixtures("few_points")
@pytest.mark.parametrize("order", ["fast to slow", "random", "slow to fast"])
def test_intervals_contain_the_truth_in_any_order(order: str) -> None:
    data = session(order, seed=3)
    fit = fitted(data)
    low, high = relative(fit)
    assert low <= 1 <= high
    drive = load_drive(DRIVES / "rig3_worm.yaml")
    true_drive = drive_with_parameters(drive, "coulomb", TRUTH)
    slow = map_torque(true_drive, np.array([1e-6, -1e-6]), drive.rig.F_payload)
    for estimate, torque in zip(fit.combinations.values(), slow, strict=True):
        assert estimate.low <= torque <= estimate.high
    changes = [note for note in fit.notes if "friction changed by" in note]
    assert len(changes) == (order != "fast to slow")


@pytest.mark.usefixtures("few_points")
def test_an_order_by_speed_widens_the_intervals() -> None:
    """Speeds in order of time widen the intervals.

    The same map without dates gives a narrow interval that does not contain the truth.
    """
    data = session("fast to slow", seed=3)
    low, high = relative(fitted(data))
    narrow_low, narrow_high = relative(fitted(replace(data, dates=None)))
    assert high - low > 1.5 * (narrow_high - narrow_low)
    assert narrow_low > 1.2
    random_low, random_high = relative(fitted(session("random", seed=3)))
    assert random_high - random_low < 0.5 * (high - low)


@pytest.mark.usefixtures("few_points")
def test_a_change_is_not_taken_for_a_stribeck_term() -> None:
    assert fitted(session("fast to slow", seed=5), law="auto").law == "coulomb"


def test_times_become_shares_of_the_session() -> None:
    times = np.array([30.0, np.nan, 0.0, 10.0, 20.0, 40.0])
    np.testing.assert_allclose(session_progress(times), [0.75, np.nan, 0.0, 0.25, 0.5, 1.0])
    late = np.append(times[:-1], 1e6)
    assert session_progress(late)[0] == pytest.approx(30.0 / (30.0 + LONG_PAUSE))
    assert np.isnan(session_progress(times[:4])).all()
    assert np.isnan(session_progress(np.zeros(9))).all()


@pytest.mark.usefixtures("few_points")
def test_a_law_is_judged_with_the_coefficient_that_it_may_have() -> None:
    """The fitted friction coefficient of rig 3 does not lie at its bound.

    Without a load offset, the best fit would be a worm that does not lock itself.
    """
    fit = fitted(read_torque_map(DRIVES / "rig_figures.csv", "rig3_worm"), "stribeck_exponential")
    assert fit.nrmsd < 0.0115
    assert fit.estimates["mu"].value == pytest.approx(0.103, abs=0.01)
    assert not fit.estimates["mu"].at_bound
