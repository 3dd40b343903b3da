"""Elementary functions for NumPy arrays and for CasADi expressions under the same names.

The package writes each closed form (a kinematic relation, a friction law) once, with a namespace of
functions as an argument or from `namespace_of`. The formula then serves numbers and symbols.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

FUNCTION_NAMES = ("sin", "cos", "sqrt", "exp", "sign", "arctan2", "where", "minimum", "maximum")
"""Names of the functions in a `Namespace`, which are NumPy's names."""
CASADI_NAMES = {"arctan2": "atan2", "where": "if_else", "minimum": "fmin", "maximum": "fmax"}
"""CasADi's names of functions that have other names in NumPy."""


class Namespace(SimpleNamespace):
    """Elementary functions for arrays or for expressions, with the names in `FUNCTION_NAMES`.

    The additional function `nonnegative` serves arguments of square roots. In NumPy it replaces
    negative numbers, which are rounding errors there, by 0. For symbols it changes nothing, so that
    a solver sees NaN outside the domain of a formula.
    """


NUMPY = Namespace(
    **{name: getattr(np, name) for name in FUNCTION_NAMES},
    nonnegative=lambda value: np.maximum(value, 0.0),
)
"""The functions for NumPy arrays."""


@cache
def casadi_namespace() -> Namespace:
    """Return the functions for CasADi expressions, that is, for SX and MX."""
    import casadi  # It takes long to import, and NumPy formulas do not need it.

    functions = {name: getattr(casadi, CASADI_NAMES.get(name, name)) for name in FUNCTION_NAMES}
    return Namespace(**functions, nonnegative=lambda value: value)


def namespace_of(*values: Any) -> Namespace:
    """Return the functions that suit given values.

    Parameters
    ----------
    *values : any
        Numbers, arrays or CasADi expressions.

    Returns
    -------
    Namespace
        Functions of CasADi if at least one value is a CasADi expression, otherwise those of NumPy.
    """
    symbolic = any(type(value).__module__.startswith("casadi") for value in values)
    return casadi_namespace() if symbolic else NUMPY
