"""The interior point: a monotone barrier, Newton steps on a small positive definite band, a filter line search.

With slacks s > 0 of the rows r(x) + s = 0 and multipliers λ > 0, of equalities e(x) = 0 and ν, the barrier problem of μ is

    min f(x) − μ Σ log s   s.t.  r(x) + s = 0,  e(x) = 0

Its Newton step has, with Σ = diag(λ / s), the slacks and multipliers of rows eliminated (`newton`):

    (∇²(f + λᵀr + νᵀe) + Jᵀ Σ J) dx + Aᵀ(ν + dν) = −(∇f + Jᵀ(μ/s + Σ (r + s))),   A dx = −e
    ds = −(r + s) − J dx,   dλ = μ/s − λ − Σ ds

Steps keep s and λ positive (fraction to the boundary τ) and are accepted by a filter on (θ, φ), the sum of the residuals and
the barrier function (Wächter and Biegler, Math. Program. 106, 2006, section 2.3); where the whole step is refused, slacks set
to −r are tried before it is halved. μ falls when the barrier problem is solved to BARRIER μ (their section 2.1).

Converged is where dual residual ∇f + Jᵀλ + Aᵀν, primal residual and s λ are all at most `tolerance`, as they stand, without
scaling by the size of the multipliers.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ssm_planner.interior.newton import System
from ssm_planner.interior.problem import Evaluator, Point, Program
from ssm_planner.typing import Array

TOLERANCE = 1e-8
COLD, WARM = 1e-4, 1e-7
"""First μ."""
PUSH, WARM_PUSH = 1e-2, 1e-8
"""Least first slack."""
NEAR = 1e4
"""Factor by which multipliers of a warm start may be off μ / s."""
BARRIER = 100.0
"""A barrier problem is solved to this many μ: to ten, as is usual, takes a twentieth more iterations."""
LINEAR, SUPERLINEAR = 0.2, 1.5
"""μ becomes the least of LINEAR μ and μ^SUPERLINEAR."""
LAST_BARRIER = 11.0
"""tolerance in the last μ."""
BOUNDARY = 0.995
"""τ: fraction to the boundary, 1 − μ later."""
SHORTER = 0.5
"""A step keeps this share of every time."""
MULTIPLIERS = 1e10
"""Largest factor of multipliers off μ / s."""
MARGIN, ARMIJO = 1e-5, 1e-8
"""Of the filter, and of sufficient decrease."""
HALVINGS, REFUSED = 12, 5
"""Of a step, and steps in a row that nothing accepts."""
SHORT, PATIENCE = 1e-2, 20
"""Share of a step that is a short one, and short ones in a row after which there is little hope."""
SMALL = 1e-10
"""θ that is none."""
WORST = 1e4
"""θ in that of the start which no step may reach."""


@dataclass(frozen=True, eq=False)
class State:
    """Where a solve ended; another one may start from there."""

    point: Point
    slacks: Array
    multipliers: Array
    equality_multipliers: Array

    def fits(self, evaluator: Evaluator) -> bool:
        """Whether it is a state of a program of this size."""
        sizes = self.point.c.shape, len(self.point.times), len(self.slacks), len(self.equality_multipliers)
        return sizes == (evaluator.program.free.shape, evaluator.b, evaluator.size, evaluator.equality_count)


@dataclass(frozen=True, eq=False)
class Outcome:
    """converged: the stopping test was met; else the state is the last one, and no solution."""

    converged: bool
    iterations: int
    state: State
    z: Array
    """The elements, (n, 5 m + 1)."""
    objective: float


def solve(
    program: Program, start: Point, *, warm: State | None = None, iterations: int = 300, tolerance: float = TOLERANCE
) -> Outcome:
    """A local minimum of the program from a point, or from where the solve of a neighbour ended, if that is of its size."""
    evaluator = Evaluator(program)
    if warm is not None and not warm.fits(evaluator):
        warm = None
    with np.errstate(all="ignore"):
        iteration = _Iteration(evaluator, start, warm, tolerance)
        for k in range(iterations):
            if iteration.converged():
                return iteration.outcome(True, k)
            if not iteration.step():
                return iteration.outcome(False, k)
        return iteration.outcome(iteration.converged(), iterations)


@dataclass
class _Filter:
    """Pairs (θ, φ) that no step may be worse than."""

    worst: float
    pairs: list[tuple[float, float]] = field(default_factory=list)

    def admits(self, theta: float, phi: float) -> bool:
        """Whether no pair forbids it."""
        return theta < self.worst and all(theta < (1 - MARGIN) * t or phi < p - MARGIN * t for t, p in self.pairs)

    def accepts(self, theta: float, phi: float, before: tuple[float, float], slope: float, length: float) -> str:
        """ "descent", "progress" (which enters the filter), or "" where the step is refused."""
        if not (np.isfinite(theta) and np.isfinite(phi) and self.admits(theta, phi)):
            return ""
        theta0, phi0 = before
        if slope < 0 and length * (-slope) ** 2.3 > theta0**1.1:
            return "descent" if phi <= phi0 + ARMIJO * length * slope + 1e-13 * abs(phi0) else ""
        better = theta <= (1 - MARGIN) * theta0 or phi <= phi0 - MARGIN * theta0 or theta < SMALL
        return "progress" if better else ""


class _Iteration:
    """The state of the iteration and what is known at its point."""

    def __init__(self, evaluator: Evaluator, start: Point, warm: State | None, tolerance: float) -> None:
        self.evaluator, self.system, self.tolerance = evaluator, System(evaluator), tolerance
        self.mask = evaluator.mask
        self.mu = COLD if warm is None else WARM
        self.point = start if warm is None else warm.point
        self.z = evaluator.z_of(self.point)
        self.rows, self.equal = evaluator.rows(self.point, self.z), evaluator.equalities(self.point, self.z)
        self.objective = evaluator.objective(self.point, self.z)
        self.slacks = np.maximum(-self.rows, PUSH if warm is None else WARM_PUSH)
        central = self.mu / self.slacks
        self.lam = central if warm is None else np.clip(warm.multipliers, central / NEAR, central * NEAR)
        self.nu = np.zeros(evaluator.equality_count) if warm is None else warm.equality_multipliers
        self.slacks, self.lam = np.where(self.mask, self.slacks, 1.0), np.where(self.mask, self.lam, 0.0)
        self.filter = _Filter(WORST * max(1.0, self.theta(self.rows, self.equal, self.slacks)))
        self.refused = self.short = 0
        self.differentiate()

    def differentiate(self) -> None:
        """Gradients at the point."""
        self.evaluator.differentiate(self.point, self.z)
        self.gradient = self.evaluator.gradient(self.point)
        self.jacobian = self.evaluator.equality_jacobian()
        self.dual = self.gradient + self.evaluator.transposed(self.lam) + self.jacobian.T @ self.nu
        self.dual[: self.system.size] *= self.system.free

    def theta(self, rows: Array, equal: Array, slacks: Array) -> float:
        """Sum of the residuals."""
        return float(np.abs(rows + slacks)[self.mask].sum() + np.abs(equal).sum())

    def phi(self, objective: float, slacks: Array) -> float:
        """The barrier function."""
        return objective - self.mu * float(np.log(slacks).sum())

    def error(self, mu: float) -> float:
        """Largest residual of the barrier problem of μ."""
        primal = np.abs(self.rows + self.slacks)[self.mask].max(initial=0.0)
        complementarity = np.abs(self.slacks * self.lam - mu)[self.mask].max(initial=0.0)
        return float(max(np.abs(self.dual).max(), primal, np.abs(self.equal).max(initial=0.0), complementarity))

    def converged(self) -> bool:
        """The stopping test."""
        return self.error(0.0) <= self.tolerance

    def outcome(self, converged: bool, iterations: int) -> Outcome:
        """What is known now."""
        state = State(self.point, self.slacks, self.lam, self.nu)
        return Outcome(converged, iterations, state, self.z, self.objective)

    def step(self) -> bool:
        """One iteration; False where there is no step to take."""
        least = self.tolerance / LAST_BARRIER
        while self.mu > least and self.error(self.mu) <= BARRIER * self.mu:
            self.mu = max(least, min(LINEAR * self.mu, self.mu**SUPERLINEAR))
            self.filter.pairs.clear()
        sigma = self.lam / self.slacks
        residual = np.where(self.mask, self.rows + self.slacks, 0.0)
        weights = np.where(self.mask, self.mu / self.slacks, 0.0) + sigma * residual
        quadratic = self.evaluator.quadratic(self.lam, sigma, self.nu)
        factors = self.system.factorise(quadratic, self.jacobian)
        if factors is None:
            return False
        right = self.gradient + self.evaluator.transposed(weights) + self.evaluator.stiffness(self.equal, self.jacobian)
        right[: self.system.size] *= self.system.free
        found = -factors.solve(np.concatenate([right, self.equal]))
        unknowns = self.system.size + self.evaluator.b
        if not np.isfinite(found).all():
            return False
        move = Point(found[: self.system.size].reshape(self.point.c.shape), found[self.system.size : unknowns])
        change, _ = self.evaluator.along(move)
        slacks_step = -residual - change
        lam_step = np.where(self.mask, self.mu / self.slacks - self.lam - sigma * slacks_step, 0.0)
        tau = max(BOUNDARY, 1 - self.mu)
        length = min(_longest(self.slacks, slacks_step, tau), _longest(self.point.times, move.times, SHORTER))
        slope = float(self.gradient @ found[:unknowns] - self.mu * (slacks_step / self.slacks).sum())
        length = self.search(move, slacks_step, slope, length, tau)
        self.lam = self.lam + _longest(self.lam, lam_step, tau) * lam_step
        self.nu = self.nu + length * (found[unknowns:] - self.nu)
        central = self.mu / self.slacks
        self.lam = np.where(self.mask, np.clip(self.lam, central / MULTIPLIERS, central * MULTIPLIERS), 0.0)
        self.differentiate()
        self.short = self.short + 1 if length < SHORT else 0
        return self.refused < REFUSED and self.short < PATIENCE

    def search(self, move: Point, slacks_step: Array, slope: float, length: float, tau: float) -> float:
        """Go along the step as far as the filter lets, and how far that was; a short way where it refuses everything."""
        before = self.theta(self.rows, self.equal, self.slacks), self.phi(self.objective, self.slacks)
        verdict = ""
        for k in range(HALVINGS):
            point = self.point.moved(move, length)
            z = self.evaluator.z_of(point)
            rows, equal = self.evaluator.rows(point, z), self.evaluator.equalities(point, z)
            objective = self.evaluator.objective(point, z)
            slacks = np.where(self.mask, np.maximum(self.slacks + length * slacks_step, -rows), 1.0)
            trials = [slacks]
            if k == 0:
                trials.append(np.where(self.mask, np.maximum(-rows, (1 - tau) * self.slacks), 1.0))
            for slacks in trials:
                after = self.theta(rows, equal, slacks), self.phi(objective, slacks)
                verdict = self.filter.accepts(*after, before, slope, length)
                if verdict:
                    break
            if verdict:
                break
            if k < HALVINGS - 1:
                length /= 2
        if verdict == "progress":
            self.filter.pairs.append(before)
        if not verdict:
            self.filter.pairs.clear()
        self.refused = 0 if verdict else self.refused + 1
        self.point, self.z, self.objective = point, z, objective
        self.rows, self.equal, self.slacks = rows, equal, slacks
        return length


def _longest(values: Array, step: Array, tau: float) -> float:
    """Largest share of a step, at most 1, that keeps 1 − τ of positive values."""
    fall = float(np.fmin.reduce(step / values))  # 0 / 0 where a row is masked
    return 1.0 if fall >= -tau else -tau / fall
