"""Motions without equality constraints: cubic elements from unknowns with which the dynamics hold by construction.

On element k the m coordinates are a cubic with z = (u, u̇, ü at its start, ü at its end, h, u̇_b), h its length and u̇_b the
middle Bernstein coefficient of u̇. Row vectors c_j (m,) of unknowns give it, four to an element, shared with its neighbours:

    (u, u̇, ü_0, ü_1, u̇_b)_k = M(η_k) (c_f, …, c_{f+3}),   f = first(k)

η_k are lengths of time near the element, affine in the times T (b,) of the blocks: η_k = E_k T + e.

`Hermite`   u and u̇ S/S_0 at the nodes; f = 2 k; u, u̇ are continuous. η = (h_k, S/S_0), S = Σ T: with T the whole motion is
            stretched, not only the cubics between fixed velocities. Where the motion begins or ends at speed, S/S_0 is 1.
`BSpline`   coefficients over simple knots, threefold at both ends; f = k; ü is continuous too. η = (h_{k−2}, …, h_{k+2}), 0
            beyond the ends. M follows from the blossom (de Boor, A Practical Guide to Splines, ch. IX).

M and its derivatives by η are in C: native/spline.c.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ssm_planner.typing import Array, Indices

LOCAL = 4
"""Rows of unknowns of an element."""
Kind = Literal["hermite", "bspline"]


@dataclass(frozen=True, eq=False)
class Spline:
    """n elements, m coordinates, b blocks."""

    kind: Kind
    coordinates: int
    fractions: Array
    """Length of every element as a share of its block, (n,)."""
    block: Indices
    """Block of every element, (n,)."""
    stretched_from: float | None = None
    """S_0 of Hermite nodes; None: they hold u̇ itself."""

    @property
    def elements(self) -> int:
        """n."""
        return len(self.fractions)

    @property
    def blocks(self) -> int:
        """b."""
        return int(self.block[-1]) + 1

    @property
    def stride(self) -> int:
        """Rows of unknowns from one element to the next."""
        return 2 if self.kind == "hermite" else 1

    @property
    def rows(self) -> int:
        """Rows of unknowns in all."""
        return self.stride * (self.elements - 1) + LOCAL

    @property
    def local(self) -> Indices:
        """Rows of unknowns of every element, (n, 4)."""
        return np.arange(self.elements)[:, None] * self.stride + np.arange(LOCAL)

    def unknowns(self, u: Array, v: Array, acceleration: Array, h: Array) -> Array:
        """c (rows, m) of u, u̇, ü at the ends of the elements, (n + 1, m), whose lengths are h (n,)."""
        if self.kind == "hermite":
            stretch = 1.0 if self.stretched_from is None else h.sum() / self.stretched_from
            return np.stack([u, v * stretch], axis=1).reshape(self.rows, -1)
        before, after = np.append(0.0, h)[:, None], np.append(h, 0.0)[:, None]
        inner = u + v * (after - before) / 3 - acceleration * before * after / 6
        return np.vstack([u[:1], inner, u[-1:]])
