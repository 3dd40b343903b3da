"""Intervals of friction parameters against dense quadrature and importance sampling."""

from __future__ import annotations

import numpy as np
import pytest

from ssm_planner.identification import posterior
from ssm_planner.identification.identify import _load, _reference
from ssm_planner.identification.parameters import names_of
from ssm_planner.identification.posterior import MapModel, most_likely
from ssm_planner.identification.torque_map import read_figures
from ssm_planner.loading.load import load_drive
from ssm_planner.problem.posterior import LOAD_OFFSET
from ssm_planner.typing import Array
from tests.support import importance_sampling
from tests.support.paths import PROBLEMS

DRIVES = PROBLEMS / "drives"
CLOSE = 0.03
"""Largest difference of two ends as a share of the interval's length."""


def model_of(rig: str, **fixed: float) -> MapModel:
    """Return the Coulomb law with a free load offset on the shipped figures of a rig."""
    figures = read_figures(DRIVES / "rig_figures.csv", rig)
    names = (*names_of("coulomb"), LOAD_OFFSET)
    drive = load_drive(DRIVES / f"{rig}.yaml")
    return MapModel(
        drive=drive,
        law="coulomb",
        names=tuple(name for name in names if name not in fixed and name != "b_ov"),
        fixed={"b_ov": 0.0, **fixed},
        reference=_reference(drive),
        w=figures.w,
        tau=figures.tau,
        weight=np.ones(len(figures.w)),
        load=_load(drive)[0],
        scatter=0.1 * float(np.median(figures.tau_deviation)),
    )


def ends(model: MapModel) -> Array:
    """Return the 95 % ends (2, k) by importance sampling."""
    sets = importance_sampling.sample(model)
    return np.transpose([sets.interval(k) for k in range(len(model.names))])


@pytest.mark.parametrize("rig", ["rig1_lead_screw", "rig2_antibacklash_screw"])
def test_intervals_are_those_of_a_dense_grid(rig: str) -> None:
    """With all but b_c and μ known, the posterior is a surface that a grid integrates."""
    known = {"b_v": 2e-5, "b_oc": 0.02, LOAD_OFFSET: 0.0}
    model = model_of(rig, **known)
    assert model.names == ("b_c", "mu")
    found = ends(model)
    middle, length = found.mean(axis=0), np.diff(found, axis=0)[0]
    axes = [np.linspace(m - 2 * h, m + 2 * h, 241) for m, h in zip(middle, length, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    density = np.exp(
        np.array([model.log_posterior(row) for row in grid])
        - model.log_posterior(most_likely(model)[None])
    )
    for k in range(2):
        marginal = np.cumsum(density.sum(axis=1 - k))
        exact = np.interp([0.025, 0.975], marginal / marginal[-1], axes[k])
        assert np.abs(found[:, k] - exact).max() < CLOSE * length[k]


@pytest.mark.slow
@pytest.mark.xfail(strict=True, reason="the walkers hardly reach the ridge of small b_c")
def test_the_walkers_reach_every_part_of_the_posterior() -> None:
    """On the antibacklash screw, `identify` states a lower end of b_c that is too high."""
    model = model_of("rig2_antibacklash_screw")
    column, exact = model.names.index("b_c"), ends(model)
    drawn = posterior.sample(model, most_likely(model), 1000)[0][:, column]
    low, high = exact[:, column]
    assert np.quantile(drawn, 0.025) - low < 0.1 * (high - low)
