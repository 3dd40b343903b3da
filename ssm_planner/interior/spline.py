"""Splines of cubic elements whose unknowns satisfy the dynamics by construction.

On element k, the m coordinates are a cubic. It is described by z = (u, u̇, ü at its start, ü at its
end, h, u̇_b), where h is the length of the element and u̇_b is the middle Bernstein coefficient of
u̇. Each element depends on four row vectors c_j (m,) of unknowns, which it shares with its
neighbours:

    (u, u̇, ü_0, ü_1, u̇_b)_k = M(η_k) (c_f, …, c_{f+3}),   f = first(k)

The vector η_k contains lengths of time near the element. They are affine functions of the times
T (b,) of the blocks: η_k = E_k T + e. There are two kinds of splines:

`hermite`   The unknowns are u and u̇ S/S_0 at the nodes, with S = Σ T. Here f = 2 k, u and u̇ are
            continuous, and η = (h_k, S/S_0). A change of T therefore stretches the whole motion,
            and not only the cubics between fixed velocities. The factor S/S_0 is replaced by 1 if
            the motion begins or ends at speed.
`bspline`   The unknowns are coefficients over simple knots, which are threefold at both ends. Here
            f = k, ü is continuous as well, and η = (h_{k−2}, …, h_{k+2}), with 0 beyond the ends. M
            follows from the blossom of the spline (de Boor, A Practical Guide to Splines, ch. IX).

The C code in native/spline.c computes M and its derivatives with respect to η.
"""

from typing import Literal

import numpy as np

from ssm_planner.typing import Array, Indices, record

ROWS_PER_ELEMENT = 4
"""Number of rows of unknowns on which an element depends."""
Kind = Literal["hermite", "bspline"]
"""Kind of a spline."""


@record
class Spline:
    """A spline with n elements, m coordinates and b blocks."""

    kind: Kind
    coordinates: int
    fractions: Array
    """Length of every element relative to the length of its block, (n,)."""
    block: Indices
    """Index of the block of every element, (n,)."""
    stretched_from: float | None = None
    """Total time S_0 of Hermite nodes, s. None if the nodes contain u̇ itself."""

    @property
    def elements(self) -> int:
        """Number n of elements."""
        return len(self.fractions)

    @property
    def blocks(self) -> int:
        """Number b of blocks."""
        return int(self.block[-1]) + 1

    @property
    def stride(self) -> int:
        """Number of rows of unknowns by which neighbouring elements differ."""
        return 2 if self.kind == "hermite" else 1

    @property
    def rows(self) -> int:
        """Number of rows of unknowns."""
        return self.stride * (self.elements - 1) + ROWS_PER_ELEMENT

    @property
    def rows_of_elements(self) -> Indices:
        """Indices of the rows of unknowns of every element, (n, 4)."""
        return np.arange(self.elements)[:, None] * self.stride + np.arange(ROWS_PER_ELEMENT)

    def unknowns(self, u: Array, v: Array, acceleration: Array, h: Array) -> Array:
        """Return the unknowns of the spline that interpolates given nodes.

        Parameters
        ----------
        u, v, acceleration : (n + 1, m) arrays
            u, u̇ and ü at the nodes. A Hermite spline does not use ü.
        h : (n,) array
            Lengths of the elements.

        Returns
        -------
        (rows, m) array
            The unknowns c.
        """
        if self.kind == "hermite":
            stretch = 1.0 if self.stretched_from is None else h.sum() / self.stretched_from
            return np.stack([u, v * stretch], axis=1).reshape(self.rows, -1)
        previous = np.append(0.0, h)[:, None]
        following = np.append(h, 0.0)[:, None]
        inner = u + v * (following - previous) / 3 - acceleration * previous * following / 6
        return np.vstack([u[:1], inner, u[-1:]])
