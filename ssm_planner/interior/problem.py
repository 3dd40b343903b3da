"""A program on a mesh of cubic elements, in the terms of its elements.

    min   w_t Σ T + w_c Σ_k L(z_k) + Σ_k h_k Σ_i p_i (a_0² + a_0 a_1 + a_1²)_i + e var(T / T_least)
    s.t.  G_j(z_k) ≤ bound of every group j at its elements k,   A z_k ≤ bound,   T ≥ T_least,   low ≤ Σ T ≤ high
          z_k[i] = value for a few (k, i);   some unknowns fixed

z_k (5 m + 1,) is element k (`spline`), of which G and L take all but its last m entries; the unknowns are x = (c, T).
Values and derivatives are taken in C: native/program.c and derivatives.c.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import casadi as ca
import numpy as np

from ssm_planner.codegen.mapped import Mapped
from ssm_planner.interior.spline import Spline
from ssm_planner.typing import Array, Indices

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
    def of(
        cls, library: ctypes.CDLL, context: ctypes.Structure, sizes: tuple[int, int, int, int]
    ) -> ElementGroup:
        """Elements of elements.c, by their context, which has to be kept; size of z, rows, costs, elements."""
        values = ctypes.cast(library.ssm_values_of, _Values)
        derivatives = ctypes.cast(library.ssm_derivatives_of, _Derivatives)
        return cls(ctypes.addressof(context), *sizes, values, derivatives)


class NativeGroup(Protocol):
    """What holds an ElementGroup and all that it points to."""

    group: ElementGroup


@dataclass(frozen=True, eq=False)
class RowGroup:
    """Rows G(z, p) ≤ bound at some of the elements."""

    functions: Mapping[str, ca.Function]
    """rows (z, *p) → G (r,); jacobian → (r, 4 m + 1); hessian (z, *p, multipliers) → (4 m + 1, 4 m + 1); and where there is a
    cost, cost → L, gradient → L, ∇L, and its weight is the last multiplier."""
    parameters: tuple[Array, ...]
    """(size,), or (q, size) of every element of the group."""
    elements: Indices
    """(q,): all of them in order, or fewer, of which one may come twice."""
    bound: Array
    """(q, r); infinite where there is none."""
    cost_weight: float = 0.0
    native: NativeGroup | None = None
    """The same functions in C; then there are none of CasADi."""


class Called:
    """A group's functions as C calls them. Their numbers stand row by row, those of one element after the other's."""

    def __init__(self, group: RowGroup) -> None:
        self.failures: list[BaseException] = []
        """What they raised, for C passes no exceptions on."""
        if group.native is not None:
            self.functions = group.native.group
            return
        count = len(group.elements)
        self._mapped = {
            name: Mapped(function, group.parameters, count)
            for name, function in group.functions.items()
        }
        size, rows = group.functions["rows"].size1_in(0), group.bound.shape[1]
        self._shape = count, rows, size
        calls = _Values(self._caught(self._values)), _Derivatives(self._caught(self._derivatives))
        sizes = size, rows, int("cost" in self._mapped), count
        self.functions = ElementGroup(None, *sizes, *calls)

    def _caught(self, function: Callable[..., None]) -> Callable[..., int]:
        def call(_: int, *addresses: Any) -> int:
            try:
                function(*addresses)
            except BaseException as error:  # noqa: BLE001
                self.failures.append(error)
            return len(self.failures)

        return call

    def _values(self, z: int, rows: int, cost: int) -> None:
        self._mapped["rows"].at(z, rows)
        if "cost" in self._mapped:
            self._mapped["cost"].at(z, cost)

    def _derivatives(self, z: int, multipliers: int, sigma: int, found: Any) -> None:
        count, rows, size = self._shape
        self._mapped["jacobian"].at(z, found[0])
        if "gradient" in self._mapped:
            self._mapped["gradient"].at(z, found[1])
        self._mapped["hessian"].at(z, multipliers, found[2])
        jacobian, hessian = (
            _array(found[0], (count, rows, size)),
            _array(found[2], (count, size, size)),
        )
        hessian += np.einsum("kr,kri,krj->kij", _array(sigma, (count, rows)), jacobian, jacobian)


def _array(address: int, shape: tuple[int, ...]) -> Array:
    """Doubles of C at an address."""
    return np.ctypeslib.as_array(ctypes.cast(address, ctypes.POINTER(ctypes.c_double)), shape)


@dataclass(frozen=True, eq=False, kw_only=True)
class Program:
    """The program; n elements, m coordinates, b blocks."""

    spline: Spline
    groups: tuple[RowGroup, ...]
    matrix: Array
    """A, (l, 5 m + 1)."""
    bound: Array
    """Of A z, (n, l); infinite where there is none."""
    free: Array
    """Which unknowns are not fixed, (rows, m), bool."""
    equal: tuple[Indices, Indices, Array] = field(
        default_factory=lambda: (*np.zeros((2, 0), dtype=int), np.zeros(0))
    )
    """(element, entry of z, value), (q,) each."""
    least_times: Array
    duration: tuple[float, float] = (0.0, np.inf)
    """low = high: Σ T is given."""
    time_weight: float = 1.0
    smoothing: Array
    """p, (m,)."""
    even: float = 0.0

    @property
    def sizes(self) -> tuple[int, int]:
        """Of all rows (those of every group, A's, the times'), of all equalities."""
        low, high = self.duration
        fixed = low == high
        of_times = self.spline.blocks + (0 if fixed else int(np.isfinite(high)) + int(low > 0))
        rows = sum(group.bound.size for group in self.groups) + self.bound.size + of_times
        return rows, len(self.equal[2]) + int(fixed)


@dataclass(frozen=True, eq=False)
class Point:
    """Where the iteration is: unknowns c (rows, m) and T (b,)."""

    c: Array
    times: Array
