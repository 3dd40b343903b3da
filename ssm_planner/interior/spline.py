"""Splines of cubic elements, whose coefficients make the motion continuous by construction.

An element is an interval of time in which the m coordinates u are cubic polynomials. The structured
solver needs no constraints that join neighbouring elements, because its unknowns are the
coefficients of a spline. The vector z = (u, u̇, ü_0, ü_1, h, u̇_b) describes an element. It
contains u and u̇ at the start, ü at the start and at the end, the length h, and the middle
Bernstein coefficient u̇_b of the parabola u̇. z depends on four consecutive rows of unknowns
c_j (m,), some of which also belong to the neighbouring elements:

    (u, u̇, ü_0, ü_1, u̇_b)_k = M(η_k) (c_f, …, c_{f+3}),   f = first(k)

The vector η_k contains the lengths of elements on which M depends. They are affine functions η_k =
E_k T + e of the durations T (b,) of the blocks, which are groups of elements. There are two kinds
of splines:

`hermite`   The unknowns are u and u̇ S/S_0 at the nodes (the ends of the elements), with S = Σ T
            and a constant reference S_0. Here f = 2 k, u and u̇ are continuous, and η = (h_k,
            S/S_0). With fixed unknowns, a change of T stretches the whole motion in time. If the
            motion begins or ends at speed, 1 replaces the factor S/S_0.
`bspline`   The unknowns are coefficients of B-splines over simple knots, which are threefold at
            both ends. Here f = k, ü is continuous as well, and η = (h_{k−2}, …, h_{k+2}), with 0
            beyond the ends. M follows from the blossom of the spline (de Boor, A Practical Guide to
            Splines, ch. IX).

The C code in native/spline.c computes M and its derivatives with respect to η.
"""

from typing import Literal

import numpy as np

from ssm_planner.typing import Array, Indices, record

ROWS_PER_ELEMENT = 4
"""Number of rows of unknowns on which the vector z of one element depends."""
Kind = Literal["hermite", "bspline"]
"""Kind of a spline. "hermite" has continuous u and u̇, and "bspline" has continuous ü as well."""


@record
class Spline:
    """A spline with n elements, m coordinates and b blocks (groups of neighbouring elements).

    The module's docstring explains the symbols.
    """

    kind: Kind
    """Kind of the spline."""
    coordinates: int
    """Number m of coordinates."""
    fractions: Array
    """Length of every element as a share of the duration of its block, (n,)."""
    block: Indices
    """Index of the block of every element, (n,)."""
    stretched_from: float | None = None
    """Constant reference S_0 of the duration in scaled time.

    If it is None, the unknowns of a Hermite spline contain u̇ itself. A B-spline does not use S_0.
    """

    @property
    def elements(self) -> int:
        """Number n of elements (intervals of time)."""
        return len(self.fractions)

    @property
    def blocks(self) -> int:
        """Number b of blocks."""
        return int(self.block[-1]) + 1

    @property
    def stride(self) -> int:
        """Difference between the first rows of unknowns of two neighbouring elements."""
        return 2 if self.kind == "hermite" else 1

    @property
    def rows(self) -> int:
        """Number of rows c_j of unknowns."""
        return self.stride * (self.elements - 1) + ROWS_PER_ELEMENT

    @property
    def rows_of_elements(self) -> Indices:
        """Indices of the four rows of unknowns on which each element (interval) depends, (n, 4)."""
        return np.arange(self.elements)[:, None] * self.stride + np.arange(ROWS_PER_ELEMENT)

    def unknowns(self, u: Array, v: Array, acceleration: Array, h: Array) -> Array:
        """Compute the unknowns of the spline from a motion at the ends of its elements (intervals).

        Parameters
        ----------
        u, v, acceleration : (n + 1, m) arrays
            Coordinates, velocities and accelerations at the ends of the elements, in scaled time. A
            Hermite spline does not use the accelerations.
        h : (n,) array
            Lengths of the elements in scaled time.

        Returns
        -------
        (rows, m) array
            The unknowns c.
        """
        if self.kind == "hermite":
            stretch = 1.0 if self.stretched_from is None else h.sum() / self.stretched_from
            return np.stack([u, v * stretch], axis=1).reshape(self.rows, -1)
        # The coefficient c_j is the blossom of the cubic at three neighbouring knots. It follows
        # from the value and the first two derivatives at the middle knot, and from the lengths of
        # the elements before and after it.
        previous = np.append(0.0, h)[:, None]
        following = np.append(h, 0.0)[:, None]
        inner = u + v * (following - previous) / 3 - acceleration * previous * following / 6
        return np.vstack([u[:1], inner, u[-1:]])
