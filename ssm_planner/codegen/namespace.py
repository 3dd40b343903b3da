"""The few elementary functions that the closed forms need, for NumPy arrays and CasADi expressions alike."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

NAMES = ("sin", "cos", "sqrt", "exp", "sign", "arctan2", "where", "minimum", "maximum")
IN_CASADI = {"arctan2": "atan2", "where": "if_else", "minimum": "fmin", "maximum": "fmax"}
"""What CasADi calls differently."""


class Namespace(SimpleNamespace):
    """The functions NAMES of one kind of number, as NumPy names them; the closed forms are written once against this.

    nonnegative cuts rounding below zero where values are numbers; it leaves symbols alone, so that a solver sees NaN outside.
    """


NUMPY = Namespace(
    **{name: getattr(np, name) for name in NAMES}, nonnegative=lambda value: np.maximum(value, 0.0)
)


@cache
def casadi_namespace() -> Namespace:
    """The same for CasADi SX and MX expressions."""
    import casadi

    functions = {name: getattr(casadi, IN_CASADI.get(name, name)) for name in NAMES}
    return Namespace(**functions, nonnegative=lambda value: value)


def namespace_of(*values: Any) -> Namespace:
    """CasADi's functions where one of the values is a CasADi expression, else NumPy's."""
    symbolic = any(type(value).__module__.startswith("casadi") for value in values)
    return casadi_namespace() if symbolic else NUMPY
