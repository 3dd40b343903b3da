"""Friction parameters are identified from torque maps with known or published parameters.

Exact maps give back their parameters. Intervals cover the truth as often as they claim, and
parameters that the data cannot separate are reported. The script tests/benchmarks/bench_coverage.py
counts over many fits how often separable intervals cover a known truth.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ssm_planner.dynamics.friction import required_friction
from ssm_planner.dynamics.spread import drive_with_values, friction_spread
from ssm_planner.errors import ProblemError, RecordingError
from ssm_planner.identification import fit as fit_module
from ssm_planner.identification.fit import SMALLEST_LAW_PROBABILITY, fit_map
from ssm_planner.identification.parameters import drive_with_parameters, map_torque
from ssm_planner.identification.posterior import PRIOR_DEVIATIONS
from ssm_planner.identification.torque_map import TorqueMap, find_outliers, read_torque_map
from ssm_planner.loading.load import load_drive
from ssm_planner.planning.corners import bounding_drives
from ssm_planner.problem.posterior import FRICTION_LAWS, LAW_COLUMN, LOAD_OFFSET
from tests.support.cases import selected
from tests.support.paths import PROBLEMS

DRIVES = PROBLEMS / "drives"
RPM = np.pi / 30
SPEEDS = RPM * np.array(
    [1, 2, 4, 6, 8, 10, 13, 17, 20, 25, 40, 50, 60, 80, 90, 100, 140, 180, 200.0]
)
WORM = {"b_c": 5.5e-4, "b_v": 1.15e-5, "b_oc": 4e-3, "mu": 0.12}
STRIBECK = {**WORM, "mu_stribeck": 0.06, "stribeck_speed": 0.688}
SCREW = {
    "b_c": 1e-3,
    "b_v": 3e-5,
    "b_oc": 3e-2,
    "mu": 0.27,
    "mu_stribeck": 0.1,
    "stribeck_speed": 6.4,
}
CASES = {
    f"{name}, load offset {offset:g}": (rig, law, {**truth, LOAD_OFFSET: offset})
    for name, rig, law, truth, offsets in (
        ("Coulomb worm", "rig3_worm", "coulomb", WORM, (0.0, 0.004)),
        ("Stribeck worm", "rig3_worm", "stribeck_exponential", STRIBECK, (0.0, 0.004)),
        ("Gaussian worm", "rig3_worm", "stribeck_gaussian", STRIBECK, (0.0,)),
        ("lead screw", "rig1_lead_screw", "stribeck_exponential", SCREW, (0.0, 0.2)),
    )
    for offset in offsets
}
RIGS = ("rig1_lead_screw", "rig2_antibacklash_screw", "rig3_worm")


def rig(name: str):
    drive = load_drive(DRIVES / f"{name}.yaml")
    return drive, drive.rig.F_payload


def synthetic(drive, load, law, truth, noise=0.0, rng=None, speeds=SPEEDS) -> TorqueMap:
    w = np.sort(np.concatenate([-speeds, speeds]))
    tau = map_torque(drive_with_parameters(drive, law, truth), w, load)
    if noise:
        tau = tau + rng.normal(0.0, noise * np.ptp(tau), len(w))
    zero = np.zeros(len(w))
    return TorqueMap(tuple(f"{v:.2f}" for v in w), w, tau, zero, zero, zero)


@pytest.mark.usefixtures("few_points")
@pytest.mark.parametrize(
    ("name", "law", "truth", "fixed"),
    [
        ("rig3_worm", "coulomb", WORM, {"b_oc": 4e-3}),
        ("rig3_worm", "coulomb", WORM, {"mu": 0.12}),
        ("rig3_worm", "stribeck_exponential", STRIBECK, {}),
        ("rig3_worm", "stribeck_gaussian", STRIBECK, {"b_oc": 4e-3}),
        (
            "rig1_lead_screw",
            "stribeck_exponential",
            {
                "b_c": 1e-3,
                "b_v": 3e-5,
                "b_oc": 3e-2,
                "mu": 0.27,
                "mu_stribeck": 0.1,
                "stribeck_speed": 6.4,
            },
            {"b_oc": 3e-2},
        ),
    ],
)
def test_exact_maps_give_back_the_truth(name, law, truth, fixed):
    drive, load = rig(name)
    fit = fit_map(drive, synthetic(drive, load, law, truth), load, law=law, fixed=fixed)
    for parameter, value in truth.items():
        assert fit.estimates[parameter].value == pytest.approx(value, rel=1e-5), parameter
    assert fit.nrmsd < 1e-7
    assert fit.outliers == ()


@pytest.mark.slow
@pytest.mark.usefixtures("few_points")
@pytest.mark.parametrize(("law", "truth"), [("coulomb", WORM), ("stribeck_exponential", STRIBECK)])
def test_intervals_cover_the_truth_as_often_as_they_say(law, truth):
    drive, load = rig("rig3_worm")
    rng = np.random.default_rng(7)
    trials, hits = 60, dict.fromkeys(truth, 0)
    for _ in range(trials):
        data = synthetic(drive, load, law, truth, 0.01, rng)
        fit = fit_map(drive, data, load, law=law, fixed={"b_oc": 4e-3, "load_offset": 0.0})
        for name in hits:
            estimate = fit.estimates[name]
            hits[name] += estimate.low <= truth[name] <= estimate.high
            assert estimate.low <= estimate.value <= estimate.high
    del hits["b_oc"]
    # Of 60 intervals of 95 %, 57 cover the truth on average. Fewer than 51 cover it less than once
    # in 300 cases.
    assert min(hits.values()) >= 51, hits
    assert 0.92 * trials <= np.mean(list(hits.values())) <= 0.985 * trials, hits


def test_inseparable_parameters_are_reported():
    """Parameters that the map determines only together are reported as inseparable.

    Their combinations, which are the torques of slow motion, have narrow intervals.
    """
    drive, load = rig("rig3_worm")
    fit = fit_map(
        drive,
        synthetic(drive, load, "coulomb", WORM, 0.005, np.random.default_rng(1)),
        load,
        law="coulomb",
    )
    assert [set(group) for group in fit.inseparable] == [{"b_c", "mu", "b_oc"}]
    assert not fit.estimates["mu"].separable
    assert fit.estimates["b_v"].separable
    k = fit.correlation_names.index("mu")
    assert abs(fit.correlation[k, fit.correlation_names.index("b_c")]) > 0.99
    for way, torque in zip(
        ("forwards", "backwards"), map_torque(fit.drive, np.array([1e-6, -1e-6]), load), strict=True
    ):
        known = fit.combinations[way]
        assert known.low <= torque <= known.high
        assert (
            known.high - known.low
            < 0.05 * abs(torque)
            < fit.estimates["b_c"].high - fit.estimates["b_c"].low
        )
    # Two torques of slow motion determine b_c and b_oc, but not a load offset too.
    held = fit_map(
        drive,
        synthetic(drive, load, "coulomb", WORM),
        load,
        law="coulomb",
        fixed={"mu": 0.12, LOAD_OFFSET: 0.0},
    )
    assert held.inseparable == ()
    assert held.estimates["mu"].fixed


def test_preload_and_mu_of_the_antibacklash_screw_trade_off():
    """The preload and mu of the antibacklash screw are highly correlated."""
    drive, load = rig("rig2_antibacklash_screw")
    truth = {"b_c": 2e-3, "b_v": 3e-5, "b_oc": 2e-2, "mu": 0.2, "preload": 0.8}
    data = synthetic(drive, load, "coulomb", truth, 0.005, np.random.default_rng(2))
    fit = fit_map(
        drive, data, load, law="coulomb", fixed={"b_c": 2e-3, "b_oc": 2e-2}, free=("preload",)
    )
    k, j = (fit.correlation_names.index(n) for n in ("mu", "preload"))
    assert abs(fit.correlation[k, j]) > 0.98
    assert fit.estimates["preload"].low <= 0.8 <= fit.estimates["preload"].high


def test_lost_contact_of_the_half_nuts_is_reported():
    drive, load = rig("rig2_antibacklash_screw")
    data = read_torque_map(DRIVES / "rig_figures.csv", "rig2_antibacklash_screw")
    loaded = fit_map(drive, data, load, law="coulomb").notes
    assert not any("contact" in note for note in loaded)
    lifted = fit_map(drive, data, -load, law="coulomb").notes
    assert any("contact" in note for note in lifted)


@pytest.mark.usefixtures("few_points")
def test_reference_values_decide_only_what_the_data_leave_open():
    """Reference values change only the parameters that the data do not determine."""
    drive, load = rig("rig3_worm")
    data = synthetic(drive, load, "coulomb", WORM, 0.005, np.random.default_rng(3))
    alone = fit_map(drive, data, load, law="coulomb")
    with_reference = fit_map(drive, data, load, law="coulomb", reference={"mu": 0.07, "b_v": 1.0})
    # The undetermined mu moves to within half of its prior deviation from the reference. The
    # determined b_v does not move, although its reference is over 7 prior deviations away.
    assert abs(np.log(with_reference.estimates["mu"].value / 0.07)) < 0.5 * PRIOR_DEVIATIONS["mu"]
    known = alone.estimates["b_v"]
    assert with_reference.estimates["b_v"].value == pytest.approx(
        known.value, abs=0.1 * (known.high - known.low)
    )
    np.testing.assert_allclose(
        with_reference.predicted, alone.predicted, atol=0.02 * np.ptp(data.tau) / 10
    )


@pytest.mark.slow
@pytest.mark.usefixtures("few_points")
def test_the_criterion_finds_the_law():
    """The criterion selects the friction law that generated the map."""
    drive, load = rig("rig1_lead_screw")
    rng = np.random.default_rng(4)
    truth = {
        "b_c": 1e-3,
        "b_v": 3e-5,
        "b_oc": 3e-2,
        "mu": 0.27,
        "mu_stribeck": 0.1,
        "stribeck_speed": 6.4,
    }
    for law in ("coulomb", "stribeck_exponential", "stribeck_gaussian"):
        fit = fit_map(drive, synthetic(drive, load, law, truth, 0.003, rng), load, law="auto")
        assert fit.law == law, fit.criterion
        assert min(fit.criterion, key=fit.criterion.get) == law


@pytest.mark.slow
def test_every_set_has_its_law_wherever_sets_are_drawn():
    """Each parameter set of a posterior is evaluated with the friction law that belongs to it."""
    drive, load = rig("rig2_antibacklash_screw")
    fit = fit_map(
        drive, read_torque_map(DRIVES / "rig_figures.csv", "rig2_antibacklash_screw"), load
    )
    posterior = fit.drive.friction.posterior
    assert len(fit.law_shares) == 3
    assert sum(fit.law_shares.values()) == pytest.approx(1.0)
    w = RPM * np.array([-199.0, -20.0, -1.0, 0.0, 1.0, 5.0, 50.0, 199.0])
    sets = {name: column for name, column in posterior.values().items() if name != LOAD_OFFSET}
    torque = map_torque(
        drive_with_values(fit.drive, {name: column[:, None] for name, column in sets.items()}),
        w,
        load,
    )
    for k in range(0, 1000, 25):
        one = {name: float(column[k]) for name, column in sets.items()}
        law = FRICTION_LAWS[int(one.pop(LAW_COLUMN))]
        apart = map_torque(drive_with_parameters(fit.drive, law, one), w, load)
        np.testing.assert_allclose(torque[k], apart, rtol=1e-12)
        np.testing.assert_allclose(
            map_torque(
                drive_with_values(fit.drive, {**one, LAW_COLUMN: FRICTION_LAWS.index(law)}), w, load
            ),
            apart,
            rtol=1e-12,
        )
    # The bounding drives enclose the friction of all sets in the 95 % range, whatever their laws.
    most = 1.2 * float(np.abs(torque).max())
    *upper, least = bounding_drives(fit.drive, 0.95, speed=float(w.max()), torque=most)
    inside = friction_spread(fit.drive).within(0.95)
    assert len(np.unique(inside[LAW_COLUMN])) == 3
    taken = np.sign(w) * map_torque(
        drive_with_values(fit.drive, {name: column[:, None] for name, column in inside.items()}),
        w,
        load,
    )
    bound = np.max([np.sign(w) * map_torque(item, w, load) for item in upper], axis=0)
    assert np.all(taken.max(axis=0) <= bound + 1e-6 * most)
    assert np.all(taken.min(axis=0) >= np.sign(w) * map_torque(least, w, load) - 1e-6 * most)
    with pytest.raises(ProblemError, match=r"not the index of a friction law.*0 \(coulomb\)"):
        replace(
            posterior, draws=np.where(np.array(posterior.names) == LAW_COLUMN, 3.0, posterior.draws)
        )


@pytest.mark.usefixtures("few_points")
@pytest.mark.parametrize("law", FRICTION_LAWS[1:])
def test_the_law_chosen_has_sets_however_unlikely_its_evidence(law, monkeypatch):
    """The chosen law has parameter sets in the posterior even if its evidence is very small."""
    drive, load = rig("rig3_worm")
    data = synthetic(
        drive,
        load,
        "stribeck_gaussian",
        {**STRIBECK, "mu_stribeck": 0.2},
        0.005,
        np.random.default_rng(6),
    )
    monkeypatch.setattr(
        fit_module, "simplest_model", lambda models, _: [model.law for model in models].index(law)
    )
    fit = fit_map(drive, data, load)
    assert fit.law == law
    assert fit.law_shares[law] >= 0.9 * SMALLEST_LAW_PROBABILITY
    assert fit.law_shares["stribeck_gaussian"] > 0.9
    assert set(fit.correlation_names) <= set(fit.estimates)


@pytest.mark.usefixtures("few_points")
def test_an_outlier_is_listed_and_hardly_counts():
    drive, load = rig("rig3_worm")
    data = synthetic(drive, load, "coulomb", WORM, 0.002, np.random.default_rng(5))
    clean = fit_map(drive, data, load, law="coulomb", fixed={"b_oc": 4e-3})
    tau = data.tau.copy()
    tau[[9, 30]] += np.array([0.4, -0.3]) * np.ptp(tau)
    fit = fit_map(drive, replace(data, tau=tau), load, law="coulomb", fixed={"b_oc": 4e-3})
    assert [name for name, _, _ in fit.outliers] == [data.names[9], data.names[30]]
    for name in ("b_c", "b_v", "mu"):
        assert fit.estimates[name].value == pytest.approx(clean.estimates[name].value, rel=0.005)


def test_a_law_that_fits_badly_makes_no_outliers():
    """A smooth deviation from a law does not count as outliers."""
    w = np.sort(np.concatenate([-SPEEDS, SPEEDS]))
    assert (
        find_outliers(w, np.sign(w) * (1.0 + 3.0 * np.exp(-np.abs(w))) + 1e-3 * np.sin(40 * w))
        == []
    )


@pytest.mark.usefixtures("few_points")
@pytest.mark.parametrize("name", RIGS)
def test_shipped_figures_are_fitted_within_two_percent(name):
    drive, load = rig(name)
    data = read_torque_map(DRIVES / "rig_figures.csv", name)
    fit = fit_map(drive, data, load, reference=drive.rig.published)
    assert fit.nrmsd <= 0.02
    assert (
        required_friction(fit.drive).identified_speed
        == np.abs(data.w).max()
        == pytest.approx(200 * RPM, rel=0.01)
    )


def test_coulomb_fit_of_the_worm_rig_gives_the_published_numbers():
    drive, load = rig("rig3_worm")
    data = read_torque_map(DRIVES / "rig_figures.csv", "rig3_worm")
    fit = fit_map(drive, data, load, law="coulomb", reference=drive.rig.published)
    for name, published, apart in [
        ("b_c", 5.5e-4, 5.5e-4),
        ("b_v", 1.15e-5, 1.2e-5),
        ("mu", 0.12, 0.116),
        ("b_oc", 4e-3, 3.7e-3),
    ]:
        assert fit.estimates[name].low <= published <= fit.estimates[name].high, name
        # The value `apart` comes from an independent fit and is rounded.
        assert fit.estimates[name].value == pytest.approx(apart, rel=0.025), name
    # The law is linear in the torques of slow motion and in b_v.
    columns = np.column_stack([data.w > 0, data.w < 0, data.w]).astype(float)
    forwards, backwards, b_v = np.linalg.lstsq(columns, data.tau, rcond=None)[0]
    assert fit.combinations["forwards"].value == pytest.approx(forwards, rel=1e-3)
    assert fit.combinations["backwards"].value == pytest.approx(backwards, rel=1e-3)
    assert fit.estimates["b_v"].value == pytest.approx(b_v, rel=2e-3)


@pytest.mark.usefixtures("few_points")
def test_maps_that_cannot_support_a_fit_are_refused():
    drive, load = rig("rig3_worm")
    data = synthetic(drive, load, "coulomb", WORM)

    def part(mask):
        columns = {
            n: getattr(data, n)[mask]
            for n in ("w", "tau", "w_deviation", "tau_deviation", "samples")
        }
        return TorqueMap(tuple(np.array(data.names)[mask]), **columns)

    with pytest.raises(RecordingError, match="positive direction"):
        fit_map(drive, part(data.w > 0), load)
    with pytest.raises(RecordingError, match="at least 5 speeds"):
        fit_map(drive, part(np.isin(np.arange(38), [0, 1, 36, 37])), load, law="coulomb")
    with pytest.raises(RecordingError, match="unknown friction law"):
        fit_map(drive, data, load, law="viscous")
    with pytest.raises(RecordingError, match="cannot fix 'nu'"):
        fit_map(drive, data, load, fixed={"nu": 1.0})
    with pytest.raises(RecordingError, match="no figures of 'rig9'"):
        read_torque_map(DRIVES / "rig_figures.csv", "rig9")


def check_coverage(counts: dict[str, tuple[int, int]]) -> None:
    for name, (hits, called) in counts.items():
        # If 95 % of the intervals cover the truth, so few hits occur less than once in 1000 cases.
        chance = sum(math.comb(called, k) * 0.95**k * 0.05 ** (called - k) for k in range(hits + 1))
        assert chance >= 1e-3, (name, hits, called)


@pytest.mark.slow
@pytest.mark.usefixtures("few_points")
@pytest.mark.parametrize("case", CASES)
def test_intervals_called_separable_cover_the_truth(case):
    counts = coverage(case, 4, "given")
    assert counts["forwards"][1] == 4, "the intervals of both combinations are always counted"
    check_coverage(counts)


@pytest.mark.slow
@pytest.mark.usefixtures("few_points")
def test_they_cover_it_whichever_law_is_chosen():
    """The intervals also cover the truth if the program chooses the law.

    The counts of all cases are added because the few fits of one case could miss every interval by
    chance.
    """
    together = {}
    for case in CASES:
        for name, counted in coverage(case, selected(1, every=2), "auto").items():
            together[name] = tuple(np.add(together.get(name, (0, 0)), counted).tolist())
    assert together["forwards"][1] >= len(CASES)
    check_coverage(together)


def coverage(case: str, fits: int, told: str, seed: int = 7) -> dict[str, tuple[int, int]]:
    """Return (covered, called separable) of each parameter, counted over several fits of one case.

    The fit uses the true law if `told` is `given`, and chooses the law if it is `auto`.
    """
    rng, counts = np.random.default_rng(seed), {}
    for _ in range(fits):
        for name, hit in covered(case, told, rng).items():
            hits, called = counts.get(name, (0, 0))
            counts[name] = (hits + hit, called + 1)
    return counts


def covered(case: str, told: str, rng: np.random.Generator) -> dict[str, bool]:
    """Fit one random map, and return whether each interval covers the truth.

    The result contains the parameters that the fit calls separable and the two combinations.
    """
    rig, law, truth = CASES[case]
    drive = load_drive(DRIVES / f"{rig}.yaml")
    load = drive.rig.F_payload + truth[LOAD_OFFSET]
    data = synthetic(drive, load, law, truth, 0.01, rng)
    fit = fit_map(drive, data, drive.rig.F_payload, law=law if told == "given" else told)
    result = {
        name: fit.estimates[name]
        for name in truth
        if name in fit.estimates and fit.estimates[name].separable
    }
    slow = map_torque(
        drive_with_parameters(drive, law, truth), 1e-3 * SPEEDS[0] * np.array([1.0, -1.0]), load
    )
    true = {**truth, **dict(zip(("forwards", "backwards"), slow, strict=True))}
    return {
        name: item.low <= true[name] <= item.high
        for name, item in {**result, **fit.combinations}.items()
    }
