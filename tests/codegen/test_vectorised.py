"""A layout packs named parameters into one vector and unpacks them in NumPy and in CasADi. Wrong
names and counts are refused.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from ssm_planner.codegen.vectorised import Layout
from ssm_planner.errors import GeometryError

LAYOUT = Layout(gravity=3, limits=4, scale=1)
VALUES = {"gravity": [0.0, 0.0, -9.81], "limits": [[1.0, 2.0], [3.0, 4.0]], "scale": 0.5}


def test_numpy_gets_back_what_was_packed() -> None:
    vector = LAYOUT.pack(**VALUES)
    assert vector.shape == (LAYOUT.size,) == (8,)
    result = LAYOUT.unpack(np.tile(vector, (5, 1)))
    for name, value in VALUES.items():
        assert np.array_equal(getattr(result, name), np.tile(np.ravel(value), (5, 1)))


def test_casadi_gets_the_same_by_the_same_names() -> None:
    symbol = ca.SX.sym("p", LAYOUT.size)
    parts = LAYOUT.unpack(symbol)
    function = ca.Function("parts", [symbol], [getattr(parts, name) for name in VALUES])
    for value, result in zip(VALUES.values(), function(LAYOUT.pack(**VALUES)), strict=True):
        assert np.array_equal(result.full().ravel(), np.ravel(value))


@pytest.mark.parametrize("change", [{"scale": [1.0, 2.0]}, {"gravity": 9.81}, {"speed": 1.0}])
def test_a_wrong_name_or_count_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(GeometryError):
        LAYOUT.pack(**{**VALUES, **change})


def test_a_missing_name_is_refused() -> None:
    with pytest.raises(GeometryError):
        LAYOUT.pack(gravity=VALUES["gravity"], scale=1.0)
