"""Motions without equality constraints: cubic elements from unknowns with which the dynamics hold by construction.

On element k the m coordinates are a cubic with z = (u, u̇, ü at its start, ü at its end, h, u̇_b), h its length and u̇_b the
middle Bernstein coefficient of u̇. Row vectors c_j (m,) of unknowns give it, four to an element, shared with its neighbours:

    (u, u̇, ü_0, ü_1, u̇_b)_k = M(η_k) (c_f, …, c_{f+3}),   f = first(k)

η_k are lengths of time near the element, affine in the times T (b,) of the blocks: η_k = E_k T + e.

`Hermite`   u and u̇ S/S_0 at the nodes; f = 2 k; u, u̇ are continuous. η = (h_k, S/S_0), S = Σ T: with T the whole motion is
            stretched, not only the cubics between fixed velocities. Where the motion begins or ends at speed, S/S_0 is 1.
`BSpline`   coefficients over simple knots, threefold at both ends; f = k; ü is continuous too. η = (h_{k−2}, …, h_{k+2}), 0
            beyond the ends. M follows from the blossom (de Boor, A Practical Guide to Splines, ch. IX).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal

import casadi as ca
import numpy as np

from ssm_planner.codegen.mapped import Mapped
from ssm_planner.codegen.vectorised import dense
from ssm_planner.typing import Array, Indices

LOCAL = 4
"""Rows of unknowns of an element."""
GIVEN = 5
"""Rows of M."""
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

    @property
    def own(self) -> int:
        """Which of η is the element's own length."""
        return 0 if self.kind == "hermite" else 2

    def lengths(self) -> tuple[Array, Array]:
        """E (n, w, b) and e (w,)."""
        n, b = self.elements, self.blocks
        own = np.zeros((n, b))
        own[np.arange(n), self.block] = self.fractions
        if self.kind == "hermite":
            stretch = np.zeros((n, b)) if self.stretched_from is None else np.full((n, b), 1 / self.stretched_from)
            return np.stack([own, stretch], axis=1), np.array([0.0, float(self.stretched_from is None)])
        padded = np.vstack([np.zeros((2, b)), own, np.zeros((2, b))])
        return np.stack([padded[k : k + n] for k in range(5)], axis=1), np.zeros(5)

    def unknowns(self, u: Array, v: Array, acceleration: Array, h: Array) -> Array:
        """c (rows, m) of u, u̇, ü at the ends of the elements, (n + 1, m), whose lengths are h (n,)."""
        if self.kind == "hermite":
            stretch = 1.0 if self.stretched_from is None else h.sum() / self.stretched_from
            return np.stack([u, v * stretch], axis=1).reshape(self.rows, -1)
        before, after = np.append(0.0, h)[:, None], np.append(h, 0.0)[:, None]
        inner = u + v * (after - before) / 3 - acceleration * before * after / 6
        return np.vstack([u[:1], inner, u[-1:]])

    def maps(self) -> tuple[Mapped, Mapped]:
        """η (n, w) → M row by row (n, 20), and its first and second derivatives by η, (n, 20 w) and (n, 20 w w)."""
        value, derivatives = (Mapped(function, (), self.elements) for function in _maps(self.kind))
        return value, derivatives


@cache
def _maps(kind: Kind) -> tuple[ca.Function, ca.Function]:
    """η → M row by row (20,); ∂M/∂η, ∂²M/∂η² likewise, the last index running fastest."""
    eta = ca.SX.sym("eta", 2 if kind == "hermite" else 5)
    matrix, h = (_hermite(eta), eta[0]) if kind == "hermite" else (_bspline(eta), eta[2])
    matrix = ca.vertcat(matrix, matrix[1, :] + h * matrix[2, :] / 2)
    by_rows = ca.vec(matrix.T)
    first = ca.vec(ca.jacobian(by_rows, eta).T)
    second = ca.vec(ca.jacobian(first, eta).T)
    return dense("matrix", [eta], [by_rows]), dense("derivatives", [eta], [first, second])


def _hermite(eta: ca.SX) -> ca.SX:
    h, stretch = eta[0], eta[1]
    u, v = ca.DM([[1, 0, 0, 0]]), ca.DM([[0, 1, 0, 0]]) / stretch
    start = ca.horzcat(-6 / h**2, -4 / (h * stretch), 6 / h**2, -2 / (h * stretch))
    end = ca.horzcat(6 / h**2, 2 / (h * stretch), -6 / h**2, 4 / (h * stretch))
    return ca.vertcat(u, v, start, end)


def _bspline(eta: ca.SX) -> ca.SX:
    before2, before, h, after, after2 = ca.vertsplit(eta)
    c = ca.DM.eye(LOCAL)
    # velocity and acceleration are splines of degree 2 and 1 over the same knots
    speeds = [
        3 * (c[k + 1, :] - c[k, :]) / span
        for k, span in enumerate((before2 + before + h, before + h + after, h + after + after2))
    ]
    start, end = (2 * (speeds[k + 1] - speeds[k]) / span for k, span in enumerate((before + h, h + after)))
    v = (h * speeds[0] + before * speeds[1]) / (before + h)
    left = (h * c[0, :] + (before2 + before) * c[1, :]) / (before2 + before + h)
    right = ((h + after) * c[1, :] + before * c[2, :]) / (before + h + after)
    u = (h * left + before * right) / (before + h)
    return ca.vertcat(u, v, start, end)
