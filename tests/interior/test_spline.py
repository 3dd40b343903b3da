"""The maps from unknowns to elements against SciPy's splines, and their derivatives against differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline, CubicHermiteSpline

from ssm_planner.interior.spline import Kind, Spline

FRACTIONS = np.array([0.3, 0.2, 0.5, 0.1, 0.25, 0.35, 0.3])
BLOCK = np.array([0, 0, 0, 1, 1, 1, 1])
TIMES = np.array([1.3, 0.7])
H = FRACTIONS * TIMES[BLOCK]
ENDS = np.append(0.0, np.cumsum(H))


def spline(kind: Kind) -> Spline:
    return Spline(kind, 2, FRACTIONS, BLOCK, TIMES.sum() if kind == "hermite" else None)


@pytest.mark.parametrize("kind", ["hermite", "bspline"])
def test_elements_are_scipys(kind: Kind) -> None:
    one = spline(kind)
    c = np.random.default_rng(1).normal(size=(one.rows, 2))
    shares, offset = one.lengths()
    states = one.maps()[0](shares @ TIMES + offset)[0].reshape(-1, 5, 4) @ c[one.local]
    if kind == "hermite":
        reference = CubicHermiteSpline(ENDS, c[0::2], c[1::2])
    else:
        reference = BSpline(np.concatenate([[0.0] * 3, ENDS, [ENDS[-1]] * 3]), c, 3)
    inside = 1e-9 * H
    assert states[:, 0] == pytest.approx(reference(ENDS[:-1]), abs=1e-12)
    assert states[:, 1] == pytest.approx(reference.derivative()(ENDS[:-1]), abs=1e-9)
    for row, at in ((2, ENDS[:-1] + inside), (3, ENDS[1:] - inside)):
        assert states[:, row] == pytest.approx(reference.derivative(2)(at), abs=1e-4)
    # the middle Bernstein coefficient of a parabola
    velocity = reference.derivative()
    middle = 2 * velocity((ENDS[1:] + ENDS[:-1]) / 2) - (velocity(ENDS[:-1]) + velocity(ENDS[1:])) / 2
    assert states[:, 4] == pytest.approx(middle, abs=1e-9)


@pytest.mark.parametrize("kind", ["hermite", "bspline"])
def test_unknowns_of_a_motion_give_it_back(kind: Kind) -> None:
    one = spline(kind)
    c = np.random.default_rng(2).normal(size=(one.rows, 2))
    shares, offset = one.lengths()
    states = one.maps()[0](shares @ TIMES + offset)[0].reshape(-1, 5, 4) @ c[one.local]
    last = states[-1]
    u = np.vstack([states[:, 0], last[0] + H[-1] * (last[1] + H[-1] * (last[2] / 3 + last[3] / 6))])
    v = np.vstack([states[:, 1], last[1] + H[-1] * (last[2] + last[3]) / 2])
    assert one.unknowns(u, v, np.vstack([states[:, 2], last[3]]), H) == pytest.approx(c, abs=1e-9)


@pytest.mark.parametrize("kind", ["hermite", "bspline"])
def test_derivatives_of_the_maps(kind: Kind) -> None:
    one = spline(kind)
    shares, offset = one.lengths()
    eta = shares @ TIMES + offset
    value, derivatives = one.maps()
    w = eta.shape[1]
    first, second = (x.reshape(len(eta), 20, -1) for x in derivatives(eta))
    for k in range(w):
        step = np.zeros(w)
        step[k] = 1e-6
        numbers = [(value(eta + side * step)[0], derivatives(eta + side * step)[0]) for side in (1, -1)]
        of_value, of_first = ((up - down) / 2e-6 for up, down in zip(*numbers, strict=True))
        inner = slice(2, -2)  # where no length is zero
        assert first[inner, :, k] == pytest.approx(of_value[inner], rel=1e-5, abs=1e-5)
        of_first = of_first.reshape(len(eta), 20, w)
        assert second.reshape(len(eta), 20, w, w)[inner, :, :, k] == pytest.approx(of_first[inner], rel=1e-4, abs=1e-3)
