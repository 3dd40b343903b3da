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
from typing import Protocol

import numpy as np

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
    """Rows G(z) ≤ bound at some of the elements."""

    native: NativeGroup
    """The functions G and L with their derivatives."""
    elements: Indices
    """Indices (q,) of the elements: all in order, or a selection that may repeat an element."""
    bound: Array
    """Bounds (q, r). Infinite for rows without a bound."""
    cost_weight: float = 0.0


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
    equal: tuple[Indices, Indices, Array]
    """Fixed entries (element, entry of z, value), (q,) each."""
    least_times: Array
    duration: tuple[float, float]
    """Bounds (low, high) of Σ T. Equal bounds fix the duration."""
    time_weight: float
    smoothing: Array
    """Weights p, (m,)."""
    even: float

    @property
    def sizes(self) -> tuple[int, int]:
        """Number of inequality rows (groups, A and times), and number of equalities."""
        low, high = self.duration
        has_duration = low == high
        bounds_of_duration = 0 if has_duration else int(np.isfinite(high)) + int(low > 0)
        of_groups = sum(group.bound.size for group in self.groups)
        rows = of_groups + self.bound.size + self.spline.blocks + bounds_of_duration
        return rows, len(self.equal[2]) + int(has_duration)


@record
class Point:
    """An iterate: unknowns c (rows, m) and T (b,)."""

    c: Array
    times: Array
