"""The few elementary functions that the closed forms need, for NumPy arrays and CasADi expressions alike."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Namespace:
    """Elementary functions of one kind of number; the closed forms are written once against this."""

    sin: Any
    cos: Any
    sqrt: Any
    arctan2: Any
    where: Any
    nonnegative: Any
    """Cuts rounding below zero where values are numbers; leaves symbols alone, so that a solver sees NaN outside."""


NUMPY = Namespace(np.sin, np.cos, np.sqrt, np.arctan2, np.where, lambda value: np.maximum(value, 0.0))


@cache
def casadi_namespace() -> Namespace:
    """The same for CasADi SX and MX expressions."""
    import casadi

    return Namespace(casadi.sin, casadi.cos, casadi.sqrt, casadi.atan2, casadi.if_else, nonnegative=lambda value: value)
