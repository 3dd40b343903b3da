"""A nonlinear program on a mesh of cubic elements.

    min   w_t Σ T + w_c Σ_k L(z_k) + Σ_k h_k Σ_i p_i (a_0² + a_0 a_1 + a_1²)_i + e var(T / T_least)
    s.t.  G_j(z_k) ≤ bound of every group j at its elements k,   A z_k ≤ bound,   T ≥ T_least,
          low ≤ Σ T ≤ high,   z_k[i] = value for a few (k, i),   some unknowns are fixed

The vector z_k (5 m + 1,) is element k of a `spline`, and a_0 and a_1 are ü at its ends. G and L
depend on all entries of z_k except the last m. The unknowns are x = (c, T). The C code in
native/program.c and derivatives.c evaluates values and derivatives.
"""

import ctypes
from typing import Protocol

import numpy as np

from ssm_planner.interior.spline import Spline
from ssm_planner.typing import Array, Indices, keyword_record, record

_P, _L = ctypes.c_void_p, ctypes.c_long
_Values = ctypes.CFUNCTYPE(ctypes.c_int, _P, _P, _P, _P)
_Derivatives = ctypes.CFUNCTYPE(ctypes.c_int, *[_P] * 4, ctypes.POINTER(_P))


class ElementGroup(ctypes.Structure):
    """The C struct of this name in native/elements.h: functions of several elements."""

    _fields_ = (
        *(("context", _P), ("size_z", _L), ("rows", _L), ("costs", _L), ("count", _L)),
        *(("values_of", _Values), ("derivatives_of", _Derivatives)),
    )

    @classmethod
    def from_library(
        cls, library: ctypes.CDLL, context: ctypes.Structure, sizes: tuple[int, int, int, int]
    ) -> "ElementGroup":
        """Build a group that native/elements.c evaluates.

        Parameters
        ----------
        library : ctypes.CDLL
            The compiled library.
        context : ctypes.Structure
            Data of the functions. The caller must keep it alive.
        sizes : tuple of four int
            Sizes of z, rows, costs and elements.
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
    """Indices (q,) of the elements, in any order. An element may occur several times."""
    bound: Array
    """Bounds (q, r). The bound of an unlimited row is infinite."""
    cost_weight: float = 0.0
    """Weight w_c of the cost L of these elements."""


@keyword_record
class Program:
    """A program with n elements, m coordinates and b blocks."""

    spline: Spline
    groups: tuple[RowGroup, ...]
    matrix: Array
    """A, (l, 5 m + 1)."""
    bound: Array
    """Bounds (n, l) of A z. The bound of an unlimited row is infinite."""
    free: Array
    """True for unknowns that are variable, (rows, m)."""
    equal: tuple[Indices, Indices, Array]
    """Fixed entries of elements: index of the element, index in z, and value, (q,) each."""
    least_times: Array
    """Smallest times T_least of the blocks, (b,)."""
    duration: tuple[float, float]
    """Bounds (low, high) of Σ T. Equal bounds fix the duration."""
    time_weight: float
    """Weight w_t of the duration."""
    smoothing: Array
    """Weights p, (m,)."""
    block_variance_weight: float
    """Weight e of the variance of T/T_least, which favours equal blocks."""

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of inequality rows and of equalities.

        The inequality rows are those of the groups, of A, of the times, and of the duration.
        """
        low, high = self.duration
        has_duration = low == high
        bounds_of_duration = 0 if has_duration else int(np.isfinite(high)) + int(low > 0)
        group_rows = sum(group.bound.size for group in self.groups)
        rows = group_rows + self.bound.size + self.spline.blocks + bounds_of_duration
        return rows, len(self.equal[2]) + int(has_duration)


@record
class Point:
    """An iterate of the solver.

    Attributes
    ----------
    c : (rows, m) array
        Unknowns of the spline.
    times : (b,) array
        Times T of the blocks.
    """

    c: Array
    times: Array
