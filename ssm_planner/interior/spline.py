"""Splines of cubic elements whose unknowns satisfy the dynamics by construction.

On element k the m coordinates are a cubic, described by z = (u, u̇, ü at its start, ü at its end,
h, u̇_b). h is its length and u̇_b the middle Bernstein coefficient of u̇. Each element depends on
four row vectors c_j (m,) of unknowns, which it shares with its neighbours:

(u, u̇, ü_0, ü_1, u̇_b)_k = M(η_k) (c_f, …, c_{f+3}), f = first(k)

η_k are lengths of time near the element, affine in the times T (b,) of the blocks: η_k = E_k T + e.

`Hermite`   The unknowns are u and u̇ S/S_0 at the nodes, with S = Σ T; f = 2 k; u and u̇ are
            continuous; η = (h_k, S/S_0). A change of T thus stretches the whole motion, not only
            the cubics between fixed velocities. S/S_0 is 1 if the motion begins or ends at speed.
`BSpline`   The unknowns are coefficients over simple knots, threefold at both ends; f = k; ü is
            continuous too; η = (h_{k−2}, …, h_{k+2}), 0 beyond the ends. M follows from the blossom
            (de Boor, A Practical Guide to Splines, ch. IX).

C code computes M and its derivatives with respect to η: native/spline.c.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from ssm_planner.typing import Array, Indices, record

LOCAL = 4
"""Number of rows of unknowns on which an element depends."""
Kind = Literal["hermite", "bspline"]


@record
class Spline:
    """A spline with n elements, m coordinates and b blocks."""

    kind: Kind
    coordinates: int
    fractions: Array
    """Length of every element divided by the length of its block, (n,)."""
    block: Indices
    """Block of every element, (n,)."""
    stretched_from: float | None = None
    """S_0 of Hermite nodes. None if the nodes hold u̇ itself."""

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
        """Offset between the rows of unknowns of neighbouring elements."""
        return 2 if self.kind == "hermite" else 1

    @property
    def rows(self) -> int:
        """Number of rows of unknowns."""
        return self.stride * (self.elements - 1) + LOCAL

    @property
    def local(self) -> Indices:
        """Rows of unknowns of every element, (n, 4)."""
        return np.arange(self.elements)[:, None] * self.stride + np.arange(LOCAL)

    def unknowns(self, u: Array, v: Array, acceleration: Array, h: Array) -> Array:
        """Return c (rows, m) from u, u̇ and ü (n + 1, m) at nodes and element lengths h (n,)."""
        if self.kind == "hermite":
            stretch = 1.0 if self.stretched_from is None else h.sum() / self.stretched_from
            return np.stack([u, v * stretch], axis=1).reshape(self.rows, -1)
        previous = np.append(0.0, h)[:, None]
        following = np.append(h, 0.0)[:, None]
        inner = u + v * (following - previous) / 3 - acceleration * previous * following / 6
        return np.vstack([u[:1], inner, u[-1:]])
