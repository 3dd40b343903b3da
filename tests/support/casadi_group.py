"""Group of rows for the structured solver with functions of CasADi."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.codegen.mapped import MappedFunction
from ssm_planner.interior.problem import ElementGroup, _Derivatives, _Values
from ssm_planner.typing import Array


class CasadiGroup:
    """A group of rows for the structured solver (`NativeGroup`) whose functions are CasADi's.

    The functions have the names and arguments of `ElementFunctions`, for n elements without
    parameters.
    """

    def __init__(self, functions: Mapping[str, ca.Function], count: int) -> None:
        self._mapped = {
            name: MappedFunction(function, (), count) for name, function in functions.items()
        }
        self._shape = count, functions["rows"].size1_out(0), functions["rows"].size1_in(0)
        _, rows, size = self._shape
        calls = _Values(self._values), _Derivatives(self._derivatives)
        self.group = ElementGroup(None, size, rows, 0, count, *calls)

    def _values(self, context: Any, z: int, rows: int, _: Any) -> int:
        """Store the values of the rows."""
        count, number, size = self._shape
        _array(rows, (count, number))[:] = self._mapped["rows"](_array(z, (count, size)))[0]
        return 0

    def _derivatives(self, context: Any, z: int, multipliers: int, sigma: int, results: Any) -> int:
        """Store Jacobian and Hessian, with σ ∇r ∇rᵀ of the rows added to the Hessian."""
        count, rows, size = self._shape
        points = _array(z, (count, size))
        jacobian = self._mapped["jacobian"](points)[0]
        hessian = self._mapped["hessian"](points, _array(multipliers, (count, rows)))[0]
        stiff = np.einsum("kr,kri,krj->kij", _array(sigma, (count, rows)), jacobian, jacobian)
        _array(results[0], jacobian.shape)[:] = jacobian
        _array(results[2], hessian.shape)[:] = hessian + stiff
        return 0


def _array(address: int, shape: tuple[int, ...]) -> Array:
    """View doubles of C at an address as an array."""
    return np.ctypeslib.as_array(ctypes.cast(address, ctypes.POINTER(ctypes.c_double)), shape)
