"""A proven lower bound of the duration along the path of a motion, by weak duality.

Let y = ṡ and x = y², so that 2 s̈ = x', and let the rows a_r s̈ + b_r y² + c_r + k_r y ≤ 1 and the
speed limit y ≤ F(s) hold on the path 0 ≤ s ≤ S. For any multipliers λ_r(s) ≥ 0 with μ = Σ λ_r a_r /
2, every motion has

    T = ∫ 1/y ds ≥ ∫ [1/y + Σ λ_r (a_r x'/2 + b_r y² + c_r + k_r y − 1)] ds
      = [μ x] − Σ x Δμ + ∫ [1/y + p y² + κ y + Σ λ_r (c_r − 1)] ds,

with p = Σ λ_r b_r − μ', κ = Σ λ_r k_r and the jumps Δμ of μ, after integration by parts. At every
s, the smallest value of 1/y + p y² + κ y for y ≤ F gives a bound that no timing can beat. At a
jump, x Δμ is at most F² Δμ, or 0 if Δμ < 0. x is 1 at an end where the motion has a speed, and μ is
0 at an end where it rests. No grid of speeds or accelerations is involved, and Simpson's rule
computes the integral.

If a timing y₀ is optimal, 2p y₀³ + κ y₀² = 1 wherever y₀ < F, and λ_r = 0 wherever row r does not
bind. The bound then equals its duration. A linear program therefore searches piecewise linear λ_r
that nearly satisfy this equation with the least ∫ Σ λ_r (1 − row_r) ds for toppra's timing. λ_r may
jump where the speed limit binds. The bound is valid whatever λ_r the program finds.

A row may be left out. This module leaves out the torque of braking motors, whose friction brakes,
and the torque of a joint where it reverses. Friction has its smallest coefficient at any speed.

Source: S. Boyd, L. Vandenberghe, Convex Optimization, 2004, §5.1 (weak duality).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ssm_planner.dynamics import friction_coefficient, friction_of, motorised
from ssm_planner.problem import Robot, TaskLimits
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, Mask, record
from ssm_planner.verification.path_rows import PathRows, coefficients

SHARES = (0.0, 0.5, 1.0)
"""Points of an interval."""
WEIGHTS = np.array([1.0, 4.0, 1.0]) / 6
"""Weights of Simpson's rule."""
DERIVATIVES = np.array([[-3.0, 4.0, -1.0], [-1.0, 0.0, 1.0], [1.0, -4.0, 3.0]])
"""Derivatives of a parabola at the points from its values there, times the length."""
NEAR = 0.1
"""Largest distance of a row, or of the speed, from its limit, as a share, that may bind."""
PENALTIES = ((0.02, 0.1), (0.3, None))
"""Cost of δ = |2p y₀³ + κ y₀² − 1| in pieces (rate, length). The bound loses about δ² / 6 y₀."""
CONTINUOUS = 1e-6
"""Largest jump of a between intervals, relative to its largest value, that is rounding."""
TINY = 1e-30
"""Smallest −p that is divided by."""
BISECTIONS = 80
"""Number of bisections for y, from the speed limit."""


def path_bound(
    trajectory: Trajectory,
    robot: Robot,
    limits: TaskLimits,
    span: tuple[float, float],
    squares: Array | None = None,
) -> float | None:
    """Return a duration that no motion along the path of a motion between two times can beat.

    Parameters
    ----------
    trajectory : Trajectory
        The motion. It only serves as a path.
    robot : Robot
        The robot with its limits.
    limits : TaskLimits
        Limits on task rates and on the speed of the tool.
    span : (float, float)
        Times in s, at breaks of the trajectory.
    squares : (n + 1,) array, optional
        ṡ² of a nearly optimal timing at the grid points, by default that of the motion.

    Returns
    -------
    float or None
        Bound in s, or None if the linear program has no solution.
    """
    path = PathRows.from_trajectory(trajectory, robot, span, SHARES)
    fastest = np.where(path.direction.any(axis=1), 1 / path.speed_use(limits), 1.0)
    squares = np.ones(len(path.width) + 1) if squares is None else squares
    program = _Program.from_rows(path, fastest, squares)
    multipliers = program.multipliers()
    return None if multipliers is None else program.bound(multipliers)


@record
class _Program:
    """Linear functions of the unknown multipliers λ, as matrices, at the 3n points of a path."""

    y: Array
    """Timing y₀, (3n,)."""
    fastest: Array
    """Speed limit F, (3n,)."""
    weights: Array
    """Weights of the integral over s, (3n,)."""
    p: Any
    kappa: Any
    mu: Any
    """p, κ and μ."""
    excess: Any
    """Σ λ_r (c_r − 1)."""
    slack: Any
    """Σ λ_r (1 − row_r) for the timing."""
    jump: Any
    """Jumps of μ at m grid points."""
    top: Array
    """F² at these points, (m,)."""
    reached: Array
    """y₀² at these points, (m,)."""

    @classmethod
    def from_rows(cls, path: PathRows, fastest: Array, squares: Array) -> _Program:
        """Return the program of a path for the timing with ṡ² = squares (n + 1,)."""
        from scipy.sparse import diags, eye, hstack, vstack

        count = len(path.width)
        gained = np.diff(squares)
        square = np.concatenate([squares[:-1] + share * gained for share in SHARES])
        push = np.tile(gained / (2 * path.width), len(SHARES))[:, None]
        a, b, c, k = coefficients(np.stack(_rows(path), axis=2))
        slack = 1 - (a * push + b * square[:, None] + c + k * np.sqrt(square)[:, None])
        slope = np.tensordot(DERIVATIVES, a.reshape(len(SHARES), count, -1), 1)
        slope = (slope / path.width[:, None]).reshape(a.shape)
        top = np.minimum(fastest[1:count], fastest[-count:-1]) ** 2
        at_limit = squares[1:-1] >= (1 - NEAR) ** 2 * top
        unknowns = _unknowns(a, slack, at_limit)
        begin: Any = eye(count, count + 1)
        finish: Any = eye(count, count + 1, 1)
        value = vstack([hstack([(1 - share) * begin, share * finish]) for share in SHARES])
        change = vstack([diags(1 / path.width) @ hstack([-begin, finish])] * len(SHARES))

        def linear(factors: Array, of: Any = value) -> Any:
            """Return the matrix of Σ factor · λ at all points, or of λ' with `of=change`."""
            return hstack([diags(row) @ of for row in factors.T]).tocsr() @ unknowns

        mu = linear(a / 2)
        return cls(
            y=np.sqrt(square),
            fastest=fastest,
            weights=np.outer(WEIGHTS, path.width).ravel(),
            p=linear(b - slope / 2) - linear(a / 2, change),
            kappa=linear(k),
            mu=mu,
            excess=linear(c - 1),
            slack=linear(slack),
            jump=(mu[1:count] - mu[-count:-1])[at_limit],
            top=top[at_limit],
            reached=squares[1:-1][at_limit],
        )

    def multipliers(self) -> Array | None:
        """Return the unknowns that nearly satisfy the conditions of an optimum, or None."""
        from scipy.optimize import linprog
        from scipy.sparse import bmat, csr_matrix, diags, eye, hstack

        y, fastest, size, jumps = self.y, self.fastest, len(self.y), len(self.top)
        part: Any = eye(size)
        step: Any = eye(jumps)
        # δ is a sum of parts (sign, cost, length). The first is the multiplier of the speed limit.
        limit_cost = np.clip((fastest - y) / y**2, 0.0, 1 / y)
        parts: list[tuple[int, Array, float | None]] = [(1, limit_cost, None)]
        parts += [(sign, rate / y, end) for rate, end in PENALTIES for sign in (1, -1)]
        bounds: list[tuple[int, float | None]] = [(0, None)] * (self.p.shape[1] + 2 * jumps)
        bounds += [(0, end) for _, _, end in parts for _ in range(size)]
        costs = [self.weights * cost for _, cost, _ in parts]
        signed = [sign * part for sign, _, _ in parts]
        optimality = diags(2 * y**3) @ self.p + diags(y**2) @ self.kappa
        # The value at y = F is not smaller than at y₀ if p + κ / (y₀ + F) reaches a threshold. A
        # deviation lowers it.
        threshold = 1 / (y * fastest * (y + fastest))
        lowered = [diags(-threshold) if sign > 0 else 0 * part for sign, _, _ in parts]
        at_fastest = self.p + diags(1 / (y + fastest)) @ self.kappa
        result = linprog(
            np.concatenate(
                [self.slack.T @ self.weights, self.top - self.reached, self.reached, *costs]
            ),
            A_eq=bmat(
                [
                    [optimality, None, None, *signed],
                    [self.jump, -step, step, *[None] * len(parts)],
                ]
            ),
            b_eq=np.append(np.ones(size), np.zeros(jumps)),
            A_ub=hstack([-at_fastest, csr_matrix((size, 2 * jumps)), *lowered]),
            b_ub=-threshold,
            bounds=bounds,
        )
        return None if result.x is None else np.asarray(result.x[: self.p.shape[1]])

    def bound(self, multipliers: Array) -> float:
        """Return the bound for given unknowns, s."""
        least = _least(self.p @ multipliers, self.kappa @ multipliers, self.fastest)
        mu = self.mu @ multipliers
        lost = self.top @ np.maximum(self.jump @ multipliers, 0.0)
        return float(self.weights @ (least + self.excess @ multipliers) + mu[-1] - mu[0] - lost)


def _rows(path: PathRows) -> list[Array]:
    """Return the rows of accelerations and torques at the PROBES, (4, points) each."""
    rows = path.accelerations()
    for i, drive, motor in motorised(path.robot.joints):
        friction, fastest = friction_of(drive), drive.ratio * path.robot.joints[i].velocity
        mu = min(float(friction_coefficient(friction, speed)) for speed in (0.0, fastest))
        direction = path.direction[:, i]
        reverses = (direction * path.speed[2, :, i]).reshape(len(SHARES), -1) < 0
        keeps = np.tile(~reverses.any(axis=0), len(SHARES))
        torques = path.torques(i, drive, motor, np.full(len(direction), mu))
        rows += [keeps * side for side in torques]
    return rows


def _unknowns(a: Array, slack: Array, at_limit: Mask) -> Any:
    """Return the matrix from the unknowns to λ.

    For every row, λ has values at the starts and then at the ends of the intervals, with a blank
    for the start after the last interval and the end before the first. The two values at a grid
    point are one unknown, or two where the speed limit binds. λ is 0 where the row is far from its
    limit, or where its coefficient a (3n, rows) jumps.
    """
    from scipy.sparse import block_diag, bmat, eye

    count = len(at_limit) + 1
    nearest = np.full((2, count + 1, a.shape[1]), np.inf)
    nearest[0, :-1], nearest[1, 1:] = slack[:count], slack[-count:]
    near = nearest < NEAR
    apart = np.concatenate([[True], at_limit, [True]])[:, None]
    jumps = np.zeros_like(near[0])
    jumps[1:-1] = np.abs(a[1:count] - a[-count:-1]) > CONTINUOUS * np.abs(a).max(axis=0)
    common = near.any(axis=0) & ~apart & ~jumps
    points: Any = eye(count + 1).tocsc()
    blocks = []
    for both, start, end in zip(common.T, *(near & apart).transpose(0, 2, 1), strict=True):
        shared = points[:, both]
        blocks.append(bmat([[shared, points[:, start], None], [shared, None, points[:, end]]]))
    return block_diag(blocks).tocsr()


def _least(p: Array, kappa: Array, fastest: Array) -> Array:
    """Return the smallest values of 1/y + p y² + κ y for 0 < y ≤ fastest, (points,) each.

    The function is convex up to y³ = −1/p, or everywhere if p ≥ 0, and concave beyond.
    """
    convex = np.minimum(fastest, np.cbrt(1 / np.maximum(-p, TINY)))
    low, high = np.zeros_like(p), np.where(p < 0, convex, fastest)
    for _ in range(BISECTIONS):
        y = (low + high) / 2
        rises = 2 * p * y**3 + kappa * y**2 > 1
        low, high = np.where(rises, low, y), np.where(rises, y, high)
    values = [1 / y + p * y**2 + kappa * y for y in (high, fastest)]
    return np.asarray(np.minimum(*values))
