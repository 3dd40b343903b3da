"""Verify the maps from unknowns to elements in native/spline.c against the splines of SciPy.

Finite differences give the reference for the derivatives of the maps.
"""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
from scipy.interpolate import BSpline, CubicHermiteSpline

from ssm_planner.elements.compiled import compiled_library
from ssm_planner.interior.spline import Kind, Spline
from ssm_planner.native import library
from ssm_planner.typing import Array

pytestmark = pytest.mark.skipif(
    not compiled_library(), reason="the package is built without its compiled part"
)
TERMS, WIDEST = 9, 5
LOOKS: tuple[tuple[str, tuple[int, ...]], ...] = (("values", (TERMS,)), ("slopes", (TERMS, WIDEST)))

FRACTIONS = np.array([0.3, 0.2, 0.5, 0.1, 0.25, 0.35, 0.3])
BLOCK = np.array([0, 0, 0, 1, 1, 1, 1])
TIMES = np.array([1.3, 0.7])
H = FRACTIONS * TIMES[BLOCK]
ENDS = np.append(0.0, np.cumsum(H))


def spline(kind: Kind) -> Spline:
    return Spline(kind, 2, FRACTIONS, BLOCK, TIMES.sum() if kind == "hermite" else None)


def called(name: str, kind: Kind, eta: Array, shape: tuple[int, ...], *given: Array) -> Array:
    """Return the output of a function of native/spline.c."""
    result = np.zeros(shape)
    pointers = [
        values.ctypes.data_as(ctypes.c_void_p)
        for values in (np.ascontiguousarray(eta), *given, result)
    ]
    getattr(library.load(), name)(("hermite", "bspline").index(kind), *pointers)
    return result


def eta_of(one: Spline) -> Array:
    """Return the parameters of the map of every element, (n, 5).

    For B-splines, these are the durations of an element and of its four neighbours, in s.
    """
    if one.kind == "hermite":
        assert one.stretched_from is not None
        return np.column_stack([H, np.full((len(H), 4), TIMES.sum() / one.stretched_from)])
    padded = np.concatenate([[0.0, 0.0], H, [0.0, 0.0]])
    return np.stack([padded[k : k + 5] for k in range(len(H))])


def states_of(one: Spline, c: Array) -> Array:
    """Return the states of every element, (n, 5, 2)."""
    maps = [called("ssm_matrix", one.kind, eta, (5, 4)) for eta in eta_of(one)]
    return np.array(maps) @ c[one.rows_of_elements]


@pytest.mark.parametrize("kind", ["hermite", "bspline"])
def test_elements_are_scipys(kind: Kind) -> None:
    """The states of the elements agree with the splines and derivatives of SciPy."""
    one = spline(kind)
    c = np.random.default_rng(1).normal(size=(one.rows, 2))
    states = states_of(one, c)
    if kind == "hermite":
        reference = CubicHermiteSpline(ENDS, c[0::2], c[1::2])
    else:
        reference = BSpline(np.concatenate([[0.0] * 3, ENDS, [ENDS[-1]] * 3]), c, 3)
    inside = 1e-9 * H
    assert states[:, 0] == pytest.approx(reference(ENDS[:-1]), abs=1e-12)
    assert states[:, 1] == pytest.approx(reference.derivative()(ENDS[:-1]), abs=1e-9)
    for row, instants in ((2, ENDS[:-1] + inside), (3, ENDS[1:] - inside)):
        assert states[:, row] == pytest.approx(reference.derivative(2)(instants), abs=1e-4)
    # The fifth state is the middle Bernstein coefficient of the velocity, which is a parabola.
    velocity = reference.derivative()
    middle = (
        2 * velocity((ENDS[1:] + ENDS[:-1]) / 2) - (velocity(ENDS[:-1]) + velocity(ENDS[1:])) / 2
    )
    assert states[:, 4] == pytest.approx(middle, abs=1e-9)


@pytest.mark.parametrize("kind", ["hermite", "bspline"])
def test_unknowns_of_a_motion_give_it_back(kind: Kind) -> None:
    """The states of the elements give back the unknowns."""
    one = spline(kind)
    c = np.random.default_rng(2).normal(size=(one.rows, 2))
    states = states_of(one, c)
    last = states[-1]
    u = np.vstack([states[:, 0], last[0] + H[-1] * (last[1] + H[-1] * (last[2] / 3 + last[3] / 6))])
    v = np.vstack([states[:, 1], last[1] + H[-1] * (last[2] + last[3]) / 2])
    assert one.unknowns(u, v, np.vstack([states[:, 2], last[3]]), H) == pytest.approx(c, abs=1e-9)


@pytest.mark.parametrize("kind", ["hermite", "bspline"])
def test_derivatives_of_the_maps(kind: Kind) -> None:
    weights = np.random.default_rng(3).normal(size=TERMS)
    weights[8 if kind == "hermite" else TERMS :] = 0.0
    for eta in eta_of(spline(kind))[2:-2]:  # These elements have no neighbour of zero length.
        first = called("ssm_term_slopes", kind, eta, (TERMS, WIDEST))
        second = called("ssm_term_curvature", kind, eta, (WIDEST, WIDEST), weights)
        assert second == pytest.approx(second.T)
        for k in range(2 if kind == "hermite" else WIDEST):
            step = 1e-6 * (np.arange(WIDEST) == k)
            up, down = (
                [
                    called(f"ssm_term_{name}", kind, eta + side * step, shape)
                    for name, shape in LOOKS
                ]
                for side in (1, -1)
            )
            of_value, of_first = ((x - y) / 2e-6 for x, y in zip(up, down, strict=True))
            assert first[:, k] == pytest.approx(of_value, rel=1e-5, abs=1e-5)
            assert second[k] == pytest.approx(weights @ of_first, rel=1e-4, abs=1e-3)
