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
    exp: Any
    sign: Any
    arctan2: Any
    where: Any
    minimum: Any
    maximum: Any
    nonnegative: Any
    """Cuts rounding below zero where values are numbers; leaves symbols alone, so that a solver sees NaN outside."""


NUMPY = Namespace(
    sin=np.sin,
    cos=np.cos,
    sqrt=np.sqrt,
    exp=np.exp,
    sign=np.sign,
    arctan2=np.arctan2,
    where=np.where,
    minimum=np.minimum,
    maximum=np.maximum,
    nonnegative=lambda value: np.maximum(value, 0.0),
)


@cache
def casadi_namespace() -> Namespace:
    """The same for CasADi SX and MX expressions."""
    import casadi

    return Namespace(
        sin=casadi.sin,
        cos=casadi.cos,
        sqrt=casadi.sqrt,
        exp=casadi.exp,
        sign=casadi.sign,
        arctan2=casadi.atan2,
        where=casadi.if_else,
        minimum=casadi.fmin,
        maximum=casadi.fmax,
        nonnegative=lambda value: value,
    )


def namespace_of(*values: Any) -> Namespace:
    """CasADi's functions where one of the values is a CasADi expression, else NumPy's."""
    symbolic = any(type(value).__module__.startswith("casadi") for value in values)
    return casadi_namespace() if symbolic else NUMPY
