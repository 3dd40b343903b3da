"""A nonlinear program on a mesh of cubic elements.

    min   w_t Σ T + w_c Σ_k L(z_k) + Σ_k h_k Σ_i p_i (a_0² + a_0 a_1 + a_1²)_i + e var(T / T_least)
    s.t.  G_j(z_k) ≤ bound of every group j at its elements k,   A z_k ≤ bound,   T ≥ T_least,
          low ≤ Σ T ≤ high,   z_k[i] = value for a few (k, i),   some unknowns are fixed

z_k (5 m + 1,) is element k (`spline`). G and L depend on all its entries except the last m. The
unknowns are x = (c, T). C code evaluates values and derivatives: native/program.c and
derivatives.c.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from dataclasses import field
from typing import Any, Protocol

import casadi as ca
import numpy as np

from ssm_planner.codegen import Mapped
from ssm_planner.interior.spline import Spline
from ssm_planner.typing import Array, Indices, keyword_record, record

_P, _L = ctypes.c_void_p, ctypes.c_long
_Values = ctypes.CFUNCTYPE(ctypes.c_int, _P, _P, _P, _P)
_Derivatives = ctypes.CFUNCTYPE(ctypes.c_int, *[_P] * 4, ctypes.POINTER(_P))


class ElementGroup(ctypes.Structure):
    """The struct of this name in native/elements.h."""

    _fields_ = (
        *(("context", _P), ("size_z", _L), ("rows", _L), ("costs", _L), ("count", _L)),
        *(("values_of", _Values), ("derivatives_of", _Derivatives)),
    )

    @classmethod
    def from_library(
        cls, library: ctypes.CDLL, context: ctypes.Structure, sizes: tuple[int, int, int, int]
    ) -> ElementGroup:
        """Build a group that elements.c evaluates.

        The caller must keep `context` alive. `sizes` are the sizes of z, rows, costs and elements.
        """
        values = ctypes.cast(library.ssm_values_of, _Values)
        derivatives = ctypes.cast(library.ssm_derivatives_of, _Derivatives)
        return cls(ctypes.addressof(context), *sizes, values, derivatives)


class NativeGroup(Protocol):
    """An object that owns an ElementGroup and all memory to which it points."""

    group: ElementGroup


@record
class RowGroup:
    """Rows G(z, p) ≤ bound at some of the elements."""

    functions: Mapping[str, ca.Function]
    """CasADi functions of one element.

    `rows` maps (z, *p) to G (r,), `jacobian` to (r, 4 m + 1), and `hessian` maps (z, *p,
    multipliers) to (4 m + 1, 4 m + 1). With a cost, `cost` maps to L and `gradient` to L and ∇L.
    The weight of the cost is then the last multiplier.
    """
    parameters: tuple[Array, ...]
    """Arrays (size,), or (q, size) with a row for every element of the group."""
    elements: Indices
    """Indices (q,) of the elements: all in order, or a selection that may repeat an element."""
    bound: Array
    """Bounds (q, r). Infinite for rows without a bound."""
    cost_weight: float = 0.0
    native: NativeGroup | None = None
    """The same functions in C. Then `functions` is empty."""


class Called:
    """Callbacks through which C evaluates a group.

    Values are stored row by row, one element after the other.
    """

    def __init__(self, group: RowGroup) -> None:
        self.failures: list[BaseException] = []
        """Exceptions of the callbacks, which C cannot pass on."""
        if group.native is not None:
            self.functions = group.native.group
            return
        count = len(group.elements)
        self._mapped = {
            name: Mapped(function, group.parameters, count)
            for name, function in group.functions.items()
        }
        size = group.functions["rows"].size1_in(0)
        rows = group.bound.shape[1]
        self._shape = count, rows, size
        calls = _Values(self._guarded(self._values)), _Derivatives(self._guarded(self._derivatives))
        sizes = size, rows, int("cost" in self._mapped), count
        self.functions = ElementGroup(None, *sizes, *calls)

    def _guarded(self, function: Callable[..., None]) -> Callable[..., int]:
        """Return a callback that stores exceptions and returns their number."""

        def call(_: int, *addresses: Any) -> int:
            try:
                function(*addresses)
            except BaseException as error:  # noqa: BLE001
                self.failures.append(error)
            return len(self.failures)

        return call

    def _values(self, z: int, rows: int, cost: int) -> None:
        """Store the values of rows and cost."""
        self._mapped["rows"].evaluate_at_addresses(z, rows)
        if "cost" in self._mapped:
            self._mapped["cost"].evaluate_at_addresses(z, cost)

    def _derivatives(self, z: int, multipliers: int, sigma: int, results: Any) -> None:
        """Store Jacobian, gradient and Hessian, with σ ∇r ∇rᵀ of the rows added to the Hessian."""
        count, rows, size = self._shape
        self._mapped["jacobian"].evaluate_at_addresses(z, results[0])
        if "gradient" in self._mapped:
            self._mapped["gradient"].evaluate_at_addresses(z, results[1])
        self._mapped["hessian"].evaluate_at_addresses(z, multipliers, results[2])
        jacobian = _array(results[0], (count, rows, size))
        hessian = _array(results[2], (count, size, size))
        hessian += np.einsum("kr,kri,krj->kij", _array(sigma, (count, rows)), jacobian, jacobian)


def _array(address: int, shape: tuple[int, ...]) -> Array:
    """View doubles of C at an address as an array."""
    return np.ctypeslib.as_array(ctypes.cast(address, ctypes.POINTER(ctypes.c_double)), shape)


@keyword_record
class Program:
    """A program with n elements, m coordinates and b blocks."""

    spline: Spline
    groups: tuple[RowGroup, ...]
    matrix: Array
    """A, (l, 5 m + 1)."""
    bound: Array
    """Bounds (n, l) of A z. Infinite for rows without a bound."""
    free: Array
    """True for unknowns that are not fixed, (rows, m)."""
    equal: tuple[Indices, Indices, Array] = field(
        default_factory=lambda: (*np.zeros((2, 0), dtype=int), np.zeros(0))
    )
    """Fixed entries (element, entry of z, value), (q,) each."""
    least_times: Array
    duration: tuple[float, float] = (0.0, np.inf)
    """Bounds (low, high) of Σ T. Equal bounds fix the duration."""
    time_weight: float = 1.0
    smoothing: Array
    """Weights p, (m,)."""
    even: float = 0.0

    @property
    def sizes(self) -> tuple[int, int]:
        """Number of inequality rows (groups, A and times), and number of equalities."""
        low, high = self.duration
        has_duration = low == high
        of_times = self.spline.blocks + (
            0 if has_duration else int(np.isfinite(high)) + int(low > 0)
        )
        rows = sum(group.bound.size for group in self.groups) + self.bound.size + of_times
        return rows, len(self.equal[2]) + int(has_duration)


@record
class Point:
    """An iterate: unknowns c (rows, m) and T (b,)."""

    c: Array
    times: Array
