"""The optimisation problem (program) of a motion, in the form that the structured solver reads.

A mesh divides the motion into elements, intervals of time in which all coordinates are cubic
polynomials. The program is

    min   w_t Σ T + w_c Σ_k L(z_k) + Σ_k h_k Σ_i p_i (a_0² + a_0 a_1 + a_1²)_i + e var(T / T_least)
    s.t.  G_j(z_k) ≤ bound of every group j at its elements k,   A z_k ≤ bound,   T ≥ T_least,
          low ≤ Σ T ≤ high,   z_k[i] = value for a few (k, i),   some unknowns are fixed

The unknowns are the coefficients c of a spline (`spline.Spline`) and the durations T of the blocks,
which are groups of neighbouring elements. They determine the vector z_k (5 m + 1,) of every element
k. It contains the m coordinates u, their derivatives, the length h_k, and the middle Bernstein
coefficients of u̇. The rows G (path constraints) and the cost L depend on all entries of z_k except
for the last m. a_0 and a_1 are ü of a coordinate at both ends of the element, and the sum with the
weights p_i is 3 ∫ p_i ü² dt.

`planning.ocp.structured` builds programs, and `solve` solves them. The C code in native/program.c
and derivatives.c evaluates their values and derivatives.
"""

import ctypes
from typing import Any, Protocol

import numpy as np

from ssm_planner.interior.spline import Spline
from ssm_planner.typing import Array, Indices, keyword_record, record

_P = ctypes.c_void_p
_L = ctypes.c_long
_Values = ctypes.CFUNCTYPE(ctypes.c_int, _P, _P, _P, _P)
_Derivatives = ctypes.CFUNCTYPE(ctypes.c_int, *[_P] * 4, ctypes.POINTER(_P))


def c_fields(c_type: Any, names: str) -> list[tuple[str, Any]]:
    """Describe fields of a C struct that have the same type.

    Parameters
    ----------
    c_type : ctypes type
        Type of the fields.
    names : str
        Names of the fields in their order, separated by spaces.

    Returns
    -------
    list of (str, ctypes type)
        Name and type of each field, as `ctypes.Structure` expects them.
    """
    return [(name, c_type) for name in names.split()]


class ElementGroup(ctypes.Structure):
    """C functions that evaluate the rows G and the cost L of several elements.

    The struct has the same name in native/elements.h.
    """

    _fields_ = (
        c_fields(_P, "context")
        + c_fields(_L, "size_z rows costs count")
        + c_fields(_Values, "values_of")
        + c_fields(_Derivatives, "derivatives_of")
    )

    @classmethod
    def from_library(
        cls, library: ctypes.CDLL, context: ctypes.Structure, sizes: tuple[int, int, int, int]
    ) -> "ElementGroup":
        """Build a group whose functions native/elements.c evaluates.

        Parameters
        ----------
        library : ctypes.CDLL
            The compiled part of the package.
        context : ctypes.Structure
            Struct with the data that the C functions read. The caller must keep it alive.
        sizes : tuple of four int
            Length of z without its last m entries, and numbers of rows, costs and elements.

        Returns
        -------
        ElementGroup
            The group, which points to the library and to the context.
        """
        values = ctypes.cast(library.ssm_values_of, _Values)
        derivatives = ctypes.cast(library.ssm_derivatives_of, _Derivatives)
        return cls(ctypes.addressof(context), *sizes, values, derivatives)


class NativeGroup(Protocol):
    """An object that keeps the C functions of a group and all their data alive."""

    group: ElementGroup
    """The C functions."""


@record
class RowGroup:
    """Rows G(z) ≤ bound at q elements, and the cost L of these elements."""

    native: NativeGroup
    """C functions for G and L with their derivatives."""
    elements: Indices
    """Indices of the elements in any order, (q,). An element may occur several times."""
    bound: Array
    """Upper bounds of the r rows at each element, (q, r). Infinite where a row is unlimited."""
    cost_weight: float = 0.0
    """Weight w_c of the cost L of these elements."""


@keyword_record
class Program:
    """An optimisation problem with n elements, m coordinates and b blocks.

    The module's docstring states it and explains the symbols.
    """

    spline: Spline
    """Relation between the unknowns and the vectors z of the elements."""
    groups: tuple[RowGroup, ...]
    """Nonlinear constraints and costs of the elements."""
    matrix: Array
    """Matrix A of l linear constraints that all elements have in common, (l, 5 m + 1)."""
    bound: Array
    """Upper bounds of A z for each element, (n, l). Infinite where a row is unlimited."""
    free: Array
    """True for unknowns of the spline that the solver may change, (spline.rows, m)."""
    equal: tuple[Indices, Indices, Array]
    """Equality constraints z_k[i] = value: the indices k and i, and the values, (q,) each."""
    least_times: Array
    """Smallest durations T_least of the blocks, (b,)."""
    duration: tuple[float, float]
    """Bounds (low, high) of the total duration Σ T. Equal bounds fix it."""
    time_weight: float
    """Weight w_t of the duration."""
    smoothing: Array
    """Weights p of the squared accelerations, (m,)."""
    block_variance_weight: float
    """Weight e of the variance of T/T_least, which makes the durations of the blocks unique."""

    @property
    def sizes(self) -> tuple[int, int]:
        """Number of inequality constraints, and number of equality constraints.

        The inequality constraints are, in this order, the rows of the groups, those of A, T ≥
        T_least, and the finite bounds of the duration. A fixed duration is an equality constraint.
        """
        low, high = self.duration
        is_fixed = low == high
        duration_bounds = 0 if is_fixed else int(np.isfinite(high)) + int(low > 0)
        group_rows = sum(group.bound.size for group in self.groups)
        rows = group_rows + self.bound.size + self.spline.blocks + duration_bounds
        return rows, len(self.equal[2]) + int(is_fixed)


@record
class Point:
    """Values of all unknowns of a program."""

    c: Array
    """Unknowns of the spline, (spline.rows, m)."""
    times: Array
    """Durations T of the blocks, (b,)."""
