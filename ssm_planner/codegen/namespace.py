"""Provide the elementary functions of the closed forms for NumPy arrays and CasADi expressions."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

FUNCTION_NAMES = ("sin", "cos", "sqrt", "exp", "sign", "arctan2", "where", "minimum", "maximum")
"""Names of the functions in NumPy."""
CASADI_NAMES = {"arctan2": "atan2", "where": "if_else", "minimum": "fmin", "maximum": "fmax"}
"""CasADi's names of functions that have other names in NumPy."""


class Namespace(SimpleNamespace):
    """Elementary functions for one kind of numbers, with NumPy's names (FUNCTION_NAMES).

    Each closed form of the package is written once with these functions. The function `nonnegative`
    replaces negative numbers, which are rounding errors, by 0. It does not change symbols, so that
    a solver sees NaN outside the domain.
    """


NUMPY = Namespace(
    **{name: getattr(np, name) for name in FUNCTION_NAMES},
    nonnegative=lambda value: np.maximum(value, 0.0),
)
"""The functions for NumPy arrays."""


@cache
def casadi_namespace() -> Namespace:
    """Return the functions for expressions of CasADi (SX and MX)."""
    import casadi

    functions = {name: getattr(casadi, CASADI_NAMES.get(name, name)) for name in FUNCTION_NAMES}
    return Namespace(**functions, nonnegative=lambda value: value)


def namespace_of(*values: Any) -> Namespace:
    """Return the functions for the given values.

    They are those of CasADi if one of the values is a CasADi expression, and otherwise those of
    NumPy.
    """
    symbolic = any(type(value).__module__.startswith("casadi") for value in values)
    return casadi_namespace() if symbolic else NUMPY
