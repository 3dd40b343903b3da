"""A program on a mesh of cubic elements, in the terms of its elements, and its values and derivatives.

    min   w_t Σ T + w_c Σ_k L(z_k) + Σ_k h_k Σ_i p_i (a_0² + a_0 a_1 + a_1²)_i + e var(T / T_least)
    s.t.  G_j(z_k) ≤ bound of every group j at its elements k,   A z_k ≤ bound,   T ≥ T_least,   low ≤ Σ T ≤ high
          z_k[i] = value for a few (k, i);   some unknowns fixed

z_k (5 m + 1,) is element k (`spline`), of which G and L take all but its last m entries; the unknowns are x = (c, T).
Everything is differentiated by z first, where the expressions stand, and brought to the unknowns of an element,
(c_f … c_{f+3}, η), by one congruence, and from η to T.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np

from ssm_planner.codegen.mapped import Mapped
from ssm_planner.interior.spline import GIVEN, LOCAL, Spline
from ssm_planner.typing import Array, Indices

NOTHING = 1e-9
"""An element's state that depends on an unknown by less than this share does not depend on it."""

STIFF = 1e3
"""Of the springs that hold what equalities give: without them the matrix of the elements alone is nearly singular there."""


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

    @cached_property
    def mapped(self) -> dict[str, Mapped]:
        """The functions at the elements of the group."""
        return {
            name: Mapped(function, self.parameters, len(self.elements)) for name, function in self.functions.items()
        }

    def add_to(self, whole: Array, values: Array) -> None:
        """Add the values (q, …) of the elements of the group to those of all, (n, …)."""
        if len(self.elements) == len(whole):  # the group of all of them
            whole += values
        else:
            np.add.at(whole, self.elements, values)

    def multipliers(self, lam: Array) -> Array:
        """Of the Hessian."""
        if "cost" not in self.functions:
            return lam
        return np.column_stack([lam, np.full(len(lam), self.cost_weight)])


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
    equal: tuple[Indices, Indices, Array] = field(default_factory=lambda: (*np.zeros((2, 0), dtype=int), np.zeros(0)))
    """(element, entry of z, value), (q,) each."""
    least_times: Array
    duration: tuple[float, float] = (0.0, np.inf)
    """low = high: Σ T is given."""
    time_weight: float = 1.0
    smoothing: Array
    """p, (m,)."""
    even: float = 0.0

    @property
    def fixed_duration(self) -> bool:
        """Whether Σ T is given."""
        return self.duration[0] == self.duration[1]


@dataclass(frozen=True, eq=False)
class Point:
    """Where the iteration is: unknowns c (rows, m) and T (b,)."""

    c: Array
    times: Array

    def moved(self, step: Point, length: float) -> Point:
        """Along a step."""
        return Point(self.c + length * step.c, self.times + length * step.times)


@dataclass(frozen=True, eq=False)
class Quadratic:
    """The Newton matrix (band, border, corner) of a Hessian in the unknowns; local: (n, 4, m, 4, m)."""

    local: Array
    border: Array
    """(rows · m, b)."""
    corner: Array
    """(b, b)."""


class Evaluator:
    """Values of one program and, at a point chosen by `differentiate`, its first and second derivatives.

    Rows stand in one vector: those of every group, the linear ones, the times. What has no bound, or does not depend on an
    unknown that is free, is masked: a row that is identically zero would keep its slack at zero.
    """

    def __init__(self, program: Program) -> None:
        self.program = program
        spline = program.spline
        self.m, self.n, self.b, self.local = spline.coordinates, spline.elements, spline.blocks, spline.local
        self.shares, self.offset = spline.lengths()
        self._matrix_at, self._by_eta = spline.maps()
        self.free = program.free[self.local]
        self._scale = np.where(np.isfinite(program.bound) & (program.bound > 0), program.bound, 1.0)
        low, high = program.duration
        bounded = np.array([np.isfinite(high), low > 0]) & (not program.fixed_duration)
        total = [
            np.full(self.b, side)
            for side, is_bounded in ((1 / high, bounded[0]), (-1 / (low or 1.0), bounded[1]))
            if is_bounded
        ]
        self._time_rows = np.vstack([-np.diag(1 / program.least_times), *total])
        self._time_bounds = np.concatenate([-np.ones(self.b), *(np.sign(row[:1]) for row in total)])
        even = (np.eye(self.b) - 1 / self.b) / program.least_times
        self._even = 2 * program.even / self.b * even.T @ even
        self._outer = (program.matrix[:, :, None] * program.matrix[:, None, :]).reshape(len(program.matrix), -1)
        self._smoothing = np.kron(np.array([[2.0, 1.0], [1.0, 2.0]]), np.diag(program.smoothing))
        equal_at, equal_entry, self._equal_value = program.equal
        self._equal = equal_at, equal_entry
        ends = np.cumsum(
            [0, *(group.bound.size for group in program.groups), program.bound.size, len(self._time_bounds)]
        )
        self._parts = [slice(*pair) for pair in pairwise(ends)]
        self.size = int(ends[-1])
        self._weighted: tuple[Array, Array] | None = None
        self.equality_count = len(self._equal_value) + program.fixed_duration

    # ---- values

    def z_of(self, point: Point) -> Array:
        """Elements (n, 5 m + 1)."""
        eta = self.shares @ point.times + self.offset
        z, length = np.empty((self.n, GIVEN * self.m + 1)), LOCAL * self.m
        states = (self._matrix_of(eta) @ point.c[self.local]).reshape(self.n, -1)
        z[:, :length], z[:, length + 1 :] = states[:, :length], states[:, length:]
        z[:, length] = eta[:, self.program.spline.own]
        return z

    def _matrix_of(self, eta: Array) -> Array:
        """M, (n, 5, 4)."""
        return self._matrix_at(eta)[0].reshape(self.n, GIVEN, LOCAL)

    def rows(self, point: Point, z: Array) -> Array:
        """Value − bound of every row, −1 of those without."""
        program = self.program
        values = [group.mapped["rows"](z[group.elements])[0] - group.bound for group in program.groups]
        values.append((z @ program.matrix.T - program.bound) / self._scale)
        values.append(self._time_rows @ point.times - self._time_bounds)
        found = np.concatenate([value.ravel() for value in values])
        return np.where(self.mask, found, -1.0)

    def equalities(self, point: Point, z: Array) -> Array:
        """Residuals of the equalities."""
        residual = z[self._equal] - self._equal_value
        return np.append(residual, (point.times.sum() - self.program.duration[0],) * self.program.fixed_duration)

    def objective(self, point: Point, z: Array) -> float:
        """f."""
        program, m = self.program, self.m
        a0, a1, h = z[:, 2 * m : 3 * m], z[:, 3 * m : 4 * m], z[:, 4 * m]
        value = program.time_weight * point.times.sum() + point.times @ self._even @ point.times / 2
        value += h @ ((a0**2 + a0 * a1 + a1**2) @ program.smoothing)
        for group in program.groups:
            if group.cost_weight:
                value += group.cost_weight * group.mapped["cost"](z[group.elements])[0].sum()
        return float(value)

    @cached_property
    def mask(self) -> Array:
        """Which rows count."""
        program, m = self.program, self.m
        eta = self.shares @ program.least_times + self.offset
        matrix = self._matrix_of(eta)
        matrix = np.abs(matrix) / np.abs(matrix).max(axis=2, keepdims=True)
        taken = np.abs(np.delete(program.matrix, LOCAL * m, axis=1)).reshape(-1, GIVEN, m)
        of_local = np.einsum("loi,noj->nlji", taken, np.where(matrix > NOTHING, matrix, 0.0))
        depends = (of_local * self.free[:, None]).any(axis=(2, 3))
        at, entry = self._equal
        depends[at] &= ~(program.matrix[:, entry] != 0).T
        groups = (np.isfinite(group.bound).ravel() for group in program.groups)
        return np.concatenate(
            [*groups, (np.isfinite(program.bound) & depends).ravel(), np.ones(len(self._time_bounds), bool)]
        )

    # ---- derivatives

    def differentiate(self, point: Point, z: Array) -> None:
        """Choose the point of the derivatives."""
        m, n = self.m, self.n
        eta = self.shares @ point.times + self.offset
        matrix, size = self._matrix_of(eta), LOCAL * m
        first, second = self._by_eta(eta)
        c, w = point.c[self.local], eta.shape[1]
        self._c, self._first, self._second = (
            c,
            first.reshape(n, GIVEN, LOCAL, w),
            second.reshape(n, GIVEN, LOCAL, w * w),
        )
        by_c = np.zeros((n, GIVEN, m, LOCAL, m))
        for i in range(m):
            by_c[:, :, i, :, i] = matrix
        of_c = (by_c * self.free[:, None, None]).reshape(n, GIVEN * m, size)
        # (n, o, w, j) (n, 1, j, i) → (n, o, w, i)
        by_eta = (self._first.transpose(0, 1, 3, 2) @ c[:, None]).transpose(0, 1, 3, 2).reshape(n, GIVEN * m, w)
        self._chain = np.zeros((n, GIVEN * m + 1, size + w))
        for rows, taken in ((slice(None, size), slice(None, size)), (slice(size + 1, None), slice(size, None))):
            self._chain[:, rows, :size], self._chain[:, rows, size:] = of_c[:, taken], by_eta[:, taken]
        self._chain[:, size, size + self.program.spline.own] = 1.0
        self._z, self._weighted = z, None
        self._jacobians = [group.mapped["jacobian"](z[group.elements])[0] for group in self.program.groups]
        self._objective_by_z = self._slope_of_objective()

    def gradient(self, point: Point) -> Array:
        """∇f, (rows · m + b,)."""
        gradient = self._pulled(self._objective_by_z)
        gradient[-self.b :] += self.program.time_weight + self._even @ point.times
        return gradient

    def _slope_of_objective(self) -> Array:
        """∂f/∂z (n, 5 m + 1), times themselves aside."""
        program, z = self.program, self._z
        first, last, length = self._entries
        a0, a1, h = z[:, first], z[:, last], z[:, length, None]
        by_z = np.zeros_like(z)
        by_z[:, first] = h * program.smoothing * (2 * a0 + a1)
        by_z[:, last] = h * program.smoothing * (2 * a1 + a0)
        by_z[:, length] = (a0**2 + a0 * a1 + a1**2) @ program.smoothing
        for group in program.groups:
            if group.cost_weight:
                slope = group.cost_weight * group.mapped["gradient"](z[group.elements])[1]
                group.add_to(by_z[:, : slope.shape[1]], slope)
        return by_z

    def transposed(self, weights: Array) -> Array:
        """Jᵀ weights, (rows · m + b,)."""
        gradient = self._pulled(self._transposed_by_z(weights))
        gradient[-self.b :] += self._time_rows.T @ weights[self._parts[-1]]
        return gradient

    def _transposed_by_z(self, weights: Array) -> Array:
        """Jᵀ weights by the elements; the last is kept, for the Newton matrix takes that of the dual residual."""
        if self._weighted is not None and self._weighted[0] is weights:
            return self._weighted[1]
        program = self.program
        by_z = (weights[self._parts[-2]].reshape(self.n, -1) / self._scale) @ program.matrix
        for group, part, jacobian in zip(program.groups, self._parts, self._jacobians, strict=False):
            here = (weights[part].reshape(len(jacobian), 1, -1) @ jacobian)[:, 0]
            group.add_to(by_z[:, : here.shape[1]], here)
        self._weighted = weights, by_z
        return by_z

    def _pulled(self, by_z: Array) -> Array:
        """A gradient by the elements as one by the unknowns."""
        local = (by_z[:, None] @ self._chain)[:, 0]
        size = self.program.free.size
        of_c = np.bincount(self._flat.ravel(), local[:, : LOCAL * self.m].ravel(), size)
        return np.concatenate([of_c, local[:, LOCAL * self.m :].ravel() @ self.shares.reshape(-1, self.b)])

    @cached_property
    def _flat(self) -> Indices:
        """Index of every element's unknowns among all, (n, 4 m)."""
        return (self.local[:, :, None] * self.m + np.arange(self.m)).reshape(self.n, -1)

    def along(self, step: Point) -> tuple[Array, Array]:
        """J step and the equalities' Jacobian times step."""
        local = np.column_stack([step.c[self.local].reshape(self.n, -1), self.shares @ step.times])
        dz = (self._chain @ local[:, :, None])[..., 0]
        program = self.program
        values = [
            (jacobian @ dz[group.elements, : jacobian.shape[2], None]).ravel()
            for group, jacobian in zip(program.groups, self._jacobians, strict=True)
        ]
        values += [((dz @ program.matrix.T) / self._scale).ravel(), self._time_rows @ step.times]
        equal = dz[self._equal]
        if program.fixed_duration:
            equal = np.append(equal, step.times.sum())
        return np.where(self.mask, np.concatenate(values), 0.0), equal

    def equality_jacobian(self) -> Array:
        """(q, rows · m + b)."""
        at, entry = self._equal
        found = np.zeros((self.equality_count, self.program.free.size + self.b))
        if len(at):
            chain = self._chain[at, entry]
            np.put_along_axis(found[: len(at)], self._flat[at], chain[:, : LOCAL * self.m], axis=1)
            found[: len(at), -self.b :] = np.einsum("qw,qwb->qb", chain[:, LOCAL * self.m :], self.shares[at])
        if self.program.fixed_duration:
            found[-1, -self.b :] = 1.0
        return found

    def quadratic(self, lam: Array, sigma: Array, nu: Array) -> Quadratic:
        """∇²(f + λᵀ rows + νᵀ equalities) + Jᵀ diag(σ) J + STIFF Aᵀ A of the equalities in elements (`stiffness`)."""
        program, m, z, n = self.program, self.m, self._z, self.n
        size, states = LOCAL * m, GIVEN * m + 1
        hessian = self._smoothing_hessian()
        for group, part, jacobian in zip(program.groups, self._parts, self._jacobians, strict=False):
            rows, k = (len(group.elements), -1), jacobian.shape[2]
            here = group.mapped["hessian"](z[group.elements], group.multipliers(lam[part].reshape(rows)))[0]
            here += jacobian.transpose(0, 2, 1) @ (sigma[part].reshape(*rows, 1) * jacobian)
            group.add_to(hessian[:, :k, :k], here)
        weights = sigma[self._parts[-2]].reshape(n, -1) / self._scale**2
        hessian += (weights @ self._outer).reshape(n, states, states)
        at, entry = self._equal
        if len(at):
            np.add.at(hessian, (at, entry, entry), STIFF)
        whole = self._chain.transpose(0, 2, 1) @ (hessian @ self._chain)
        # M depends on η
        by_z = self._objective_by_z + self._transposed_by_z(lam)
        if len(at):
            np.add.at(by_z, self._equal, nu[: len(at)])
        slope = np.concatenate([by_z[:, :size], by_z[:, size + 1 :]], axis=1).reshape(n, GIVEN, m)
        w = self.shares.shape[1]
        mixed = slope.transpose(0, 2, 1) @ self._first.reshape(n, GIVEN, -1)
        mixed = mixed.reshape(n, m, LOCAL, w).transpose(0, 2, 1, 3) * self.free[..., None]
        whole[:, :size, size:] += mixed.reshape(n, size, w)
        through = (slope @ self._c.transpose(0, 2, 1)).reshape(n, 1, -1) @ self._second.reshape(n, -1, w * w)
        whole[:, size:, size:] += through.reshape(n, w, w)
        of_times = (whole[:, :, size:] @ self.shares).reshape(n, -1, self.b)
        border = np.empty((program.free.size, self.b))
        for block in range(self.b):
            border[:, block] = np.bincount(self._flat.ravel(), of_times[:, :size, block].ravel(), len(border))
        corner = self.shares.reshape(-1, self.b).T @ of_times[:, size:].reshape(-1, self.b)
        corner += self._time_rows.T @ (sigma[self._parts[-1], None] * self._time_rows) + self._even
        return Quadratic(whole[:, :size, :size], border, corner)

    def stiffness(self, residual: Array, jacobian: Array) -> Array:
        """STIFF Aᵀ e: with it on the right-hand side the step is the same as without STIFF Aᵀ A in the matrix."""
        within = len(self._equal_value)
        return np.asarray(STIFF * jacobian[:within].T @ residual[:within])

    def _smoothing_hessian(self) -> Array:
        """Of Σ h p (a_0² + a_0 a_1 + a_1²), by element (n, 5 m + 1, 5 m + 1)."""
        m, z, weights = self.m, self._z, self.program.smoothing
        hessian = np.zeros((self.n, GIVEN * m + 1, GIVEN * m + 1))
        if not weights.any():
            return hessian
        first, last, length = self._entries
        a0, a1, h = z[:, first], z[:, last], z[:, length, None, None]
        hessian[:, 2 * m : 4 * m, 2 * m : 4 * m] = h * self._smoothing
        slope = np.hstack([weights * (2 * a0 + a1), weights * (2 * a1 + a0)])
        hessian[:, 2 * m : 4 * m, length] = hessian[:, length, 2 * m : 4 * m] = slope
        return hessian

    @property
    def _entries(self) -> tuple[slice, slice, int]:
        """Of z: ü at the start, ü at the end, h."""
        m = self.m
        return slice(2 * m, 3 * m), slice(3 * m, 4 * m), 4 * m
