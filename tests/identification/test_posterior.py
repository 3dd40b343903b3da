"""Intervals of friction parameters agree with dense quadrature and are repeatable."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from ssm_planner.identification import fit as fit_module
from ssm_planner.identification.fit import MapFit, fit_map
from ssm_planner.identification.posterior import MapModel, most_likely
from ssm_planner.identification.sampling import sample_posterior, weighted_interval
from ssm_planner.identification.torque_map import read_torque_map
from ssm_planner.loading.load import load_drive
from ssm_planner.problem.posterior import FRICTION_LAWS, LOAD_OFFSET
from ssm_planner.typing import Array
from tests.support.cases import selected
from tests.support.paths import PROBLEMS

DRIVES = PROBLEMS / "drives"
CLOSE = 0.03
"""Largest allowed difference of two interval ends as a fraction of the interval length."""
LESS_CLOSE = {
    ("rig1_lead_screw", "coulomb"): 0.1,
    ("rig2_antibacklash_screw", "stribeck_exponential"): 0.35,
}
"""Larger tolerances for laws whose parameters the data of these rigs barely determine."""


def model_of(rig: str, **fixed: float) -> MapModel:
    """Return the Coulomb law on the shipped figures of a rig, with fixed parameters."""
    figures = read_torque_map(DRIVES / "rig_figures.csv", rig)
    drive = load_drive(DRIVES / f"{rig}.yaml")
    return MapModel(
        drive=drive,
        law="coulomb",
        names=tuple(n for n in ("b_c", "b_v", "mu", "b_oc", LOAD_OFFSET) if n not in fixed),
        fixed={"b_ov": 0.0, **fixed},
        reference=drive.rig.published,
        w=figures.w,
        tau=figures.tau,
        weight=np.ones(len(figures.w)),
        friction=figures.friction,
        elapsed=np.full(len(figures.w), np.nan),
        load=drive.rig.F_payload,
        scatter=0.1 * float(np.median(figures.tau_deviation)),
    )


def ends(model: MapModel, shift: float = 0.5) -> Array:
    """Return the ends (2, k) of the 95 % intervals of the k coordinates."""
    z, weight = sample_posterior(model, most_likely(model), shift).flat
    return np.transpose([weighted_interval(column, weight) for column in z.T])


@pytest.mark.parametrize("known", [{"b_v": 2e-5, "b_oc": 0.02}, {"b_c": 1e-3, "b_v": 2e-5}])
@pytest.mark.parametrize("rig", ["rig1_lead_screw", "rig2_antibacklash_screw"])
def test_intervals_are_those_of_a_dense_grid(rig: str, known: dict[str, float]) -> None:
    """The sampled intervals equal those of a dense grid.

    All but two parameters are fixed, so the posterior is a surface that the grid integrates.
    """
    model = model_of(rig, **known, load_offset=0.0)
    sampled = ends(model)
    middle, length = sampled.mean(axis=0), np.diff(sampled, axis=0)[0]
    axes = [np.linspace(m - 2 * h, m + 2 * h, 241) for m, h in zip(middle, length, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    density = np.exp(
        np.array([model.log_posterior(row) for row in grid])
        - model.log_posterior(most_likely(model)[None])
    )
    for k in range(2):
        marginal = np.cumsum(density.sum(axis=1 - k))
        exact = np.interp([0.025, 0.975], marginal / marginal[-1], axes[k])
        assert np.abs(sampled[:, k] - exact).max() < CLOSE * length[k]


def test_the_evidence_is_that_of_a_dense_grid() -> None:
    """The sampled evidence equals the integral of likelihood and normal prior on a dense grid."""
    model = model_of("rig1_lead_screw", b_v=2e-5, b_oc=0.02, load_offset=0.0)
    z = most_likely(model)
    axes = [np.linspace(middle - 3, middle + 3, 601) for middle in z]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    height = np.array([model.log_posterior(row) for row in grid])
    cell = (axes[0][1] - axes[0][0]) * (axes[1][1] - axes[1][0])
    exact = np.logaddexp.reduce(height, axis=None) + np.log(cell / (2 * np.pi))
    assert sample_posterior(model, z).log_evidence == pytest.approx(exact, abs=0.01)


@pytest.mark.parametrize("known", [{"mu": 0.2, "b_oc": 0.02}, {"b_c": 1e-3, "b_v": 2e-5}])
def test_models_with_only_linear_or_only_other_parameters_are_sampled(known) -> None:
    model = model_of("rig2_antibacklash_screw", **known, load_offset=0.6)
    assert np.all(np.diff(ends(model), axis=0) > 0)


def fitted(
    rig: str,
    shift: float,
    monkeypatch: pytest.MonkeyPatch,
    load: float | None,
    law: str = "auto",
) -> MapFit:
    """Return the fit of the figures of a rig, with its sequence of points shifted by `shift`."""
    monkeypatch.setattr(
        fit_module, "sample_posterior", lambda model, z: sample_posterior(model, z, shift)
    )
    drive, figures = load_drive(DRIVES / f"{rig}.yaml"), DRIVES / "rig_figures.csv"
    load = drive.rig.F_payload if load is None else load
    return fit_map(
        drive, read_torque_map(figures, rig), load, law=law, reference=drive.rig.published
    )


RIGS = ("rig1_lead_screw", "rig2_antibacklash_screw", "rig3_worm")
POINTS = selected(
    [
        ("rig1_lead_screw", "auto"),
        ("rig1_lead_screw", "coulomb"),
        ("rig2_antibacklash_screw", "stribeck_exponential"),
        ("rig3_worm", "stribeck_gaussian"),
    ],
    every=list(itertools.product(RIGS, ("auto", *FRICTION_LAWS))),
)


@pytest.mark.slow
@pytest.mark.parametrize(("rig", "law"), POINTS)
def test_intervals_do_not_depend_on_the_points(
    rig: str, law: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The intervals do not change if the sequence of points is shifted.

    By default, every rig, every law and the automatic choice of the law occur. EVERY_CASE=1 tests
    every rig with every law.
    """
    fits = [fitted(rig, shift, monkeypatch, None, law) for shift in (0.5, 0.123)]
    assert all("not reliable" not in note for fit in fits for note in fit.notes)
    for kind in ("estimates", "combinations"):
        first, second = (getattr(fit, kind) for fit in fits)
        for name, estimate in first.items():
            allowed = LESS_CLOSE.get((rig, law), CLOSE) * (estimate.high - estimate.low)
            assert abs(estimate.low - second[name].low) <= allowed, name
            assert abs(estimate.high - second[name].high) <= allowed, name


@pytest.mark.slow
def test_a_sample_that_a_few_sets_dominate_is_remarked(monkeypatch: pytest.MonkeyPatch) -> None:
    """A note says that the intervals are not reliable if a few parameter sets dominate the sample.

    With ten times the payload as load, the posterior is too narrow for the points.
    """
    fit = fitted("rig2_antibacklash_screw", 0.5, monkeypatch, 9.4)
    assert any("95 % intervals are not reliable" in note for note in fit.notes)
