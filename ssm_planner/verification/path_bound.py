"""Compute a lower bound on the duration of every motion along a path, by weak duality.

Let y = ṡ be the speed on the path 0 ≤ s ≤ S, and let x = y². Then 2 s̈ = x', the derivative of x
with respect to s. Every limit r of acceleration or torque is a row a_r s̈ + b_r y² + c_r + k_r y ≤
1, and all limits of speed together are y ≤ F(s). Choose any functions λ_r(s) ≥ 0, the multipliers,
and define μ = ½ Σ λ_r a_r. The duration T of every motion within the limits then satisfies

    T = ∫ 1/y ds ≥ ∫ [1/y + Σ λ_r (a_r x'/2 + b_r y² + c_r + k_r y − 1)] ds
      = [μ x] − Σ x Δμ + ∫ [1/y + p y² + κ y + Σ λ_r (c_r − 1)] ds.

The second line follows by integration by parts, with p = Σ λ_r b_r − μ', κ = Σ λ_r k_r and the
jumps Δμ of μ. The bound uses the minimum of 1/y + p y² + κ y over 0 < y ≤ F at every s. At a jump,
x lies between 0 and F², so x Δμ ≤ F² max(Δμ, 0). The bound holds for motions that have the same
speed as this motion at both ends, where x = 1, never move backwards, and keep the duration of
rests. At an end at rest, μ = 0 and the term vanishes.

If a timing y₀ is optimal, there are multipliers for which 2p y₀³ + κ y₀² = 1 wherever y₀ < F, and
λ_r = 0 wherever row r does not bind. With them, the bound equals the duration of y₀. A linear
program therefore looks for piecewise linear λ_r. They nearly satisfy this equation for toppra's
timing y₀ in the middle of every interval, and they minimise ∫ Σ λ_r (1 − row_r) ds. They may jump
at points where y₀ reaches the speed limit, or where a coefficient a_r jumps. The bound is valid for
every λ_r ≥ 0, so errors of the program or of toppra can only make it smaller.

Simpson's rule evaluates the integral. The bound is reduced by the difference between the rule on
intervals and on half intervals.

The bound stays valid if rows are left out. This module leaves out the torque limit of a motor that
brakes, because friction does most of the braking, and the torque limit of a joint in an interval
where it reverses. At every speed, the friction coefficient is the smallest that the joint can have.

The multipliers are also the sensitivities of the duration. If the limit of row r grows by a share
ε, the row may reach 1 + ε, so the bound decreases by ε ∫ λ_r ds. If the speed limit F grows by ε,
it decreases by ε ∫ ν/F ds, where ν = 1 − 2p F³ − κ F² wherever the minimum is at y = F, and by
2 ε F² Δμ at a jump. At an optimal motion, the duration along the fixed path and the duration of the
best path have the same derivative (envelope theorem).

Sources: S. Boyd, L. Vandenberghe, Convex Optimization, 2004, §5.1 (weak duality) and §5.6
(sensitivity). P. Milgrom, I. Segal, Envelope theorems for arbitrary choice sets, Econometrica
70(2), 2002.
"""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np

from ssm_planner.dynamics import friction_coefficient, motorised_joints, required_friction
from ssm_planner.problem import JointAcceleration, MotorTorque, TaskLimits
from ssm_planner.typing import Array, Mask, frozen, record
from ssm_planner.verification.path_rows import (
    POINT_POSITIONS,
    SIMPSON_WEIGHTS,
    LimitKey,
    PathRows,
    row_coefficients,
)

QUARTIC_DERIVATIVES = (
    np.array(
        [
            [-25.0, 48.0, -36.0, 16.0, -3.0],
            [-3.0, -10.0, 18.0, -6.0, 1.0],
            [1.0, -8.0, 0.0, 8.0, -1.0],
            [-1.0, 6.0, -18.0, 10.0, 3.0],
            [3.0, -16.0, 36.0, -48.0, 25.0],
        ]
    )
    / 3
)
"""Matrix that computes derivatives of a quartic at the five points from its values there.

The result must be divided by the length of the interval.
"""
BINDING_MARGIN = 0.1
"""Largest distance of a quantity from its limit, as a share of the limit, at which it may bind."""
OPTIMALITY_PENALTY = 0.1
"""Cost factor of the deviation δ = |2p y₀³ + κ y₀² − 1| from the condition of an optimum.

A deviation makes the bound smaller by about δ²/(6 y₀). The cost in the linear program must be
linear, so it is this factor times δ/y₀.
"""
COEFFICIENT_JUMP_TOLERANCE = 1e-6
"""Largest jump of a coefficient between intervals that counts as rounding.

It is a share of the largest magnitude of the coefficient.
"""
MIN_DIVISOR = 1e-30
"""Lower limit of −p in the division 1 / −p, which prevents a division by 0."""
MULTIPLIER_JUMP_TOLERANCE = 1e-12
"""Largest jump of μ that counts as rounding."""
BISECTION_STEPS = 24
"""Number of bisections that find the best y in the interval (0, F)."""
SENSITIVITY_STEP = 0.01
"""Share by which a limit grows in the definition of a sensitivity: one percent."""


@frozen
class Sensitivity:
    """Change of the duration of a motion with one of its limits, to first order.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> plan = ssm.load_plan("results/tilt_insert")
    >>> [(item.limit, item.joint) for item in plan.sensitivities[:2]]
    [('velocity', 'tilt'), ('velocity', 'insertion')]
    """

    limit: str
    """Name of the limit, as in the certificate."""
    joint: str | None
    """Name of the joint. None for a limit of the tool or of the task."""
    seconds_per_percent: float
    """Change of the duration if the limit grows by one percent, s. It is negative."""


def path_bound(
    path: PathRows, limits: TaskLimits, squares: Array | None = None
) -> tuple[float | None, tuple[Sensitivity, ...] | None]:
    """Compute a lower bound on the duration of every motion along a path.

    Parameters
    ----------
    path : PathRows
        The path with n intervals. The bound holds for motions that keep its rests.
    limits : TaskLimits
        Limits on task rates and on the speed of the tool.
    squares : (n + 1,) array, optional
        ṡ² of a timing at the ends of the n intervals of the path. The default is the timing of the
        motion. The bound is closest if the timing is nearly optimal.

    Returns
    -------
    bound : float or None
        Bound in s, or None if the linear program is infeasible.
    sensitivities : tuple of Sensitivity or None
        Changes of the bound if one of the limits that bind grows. None without a bound.
    """
    max_speed = np.where(path.moves, 1 / path.largest_speed_ratio(limits), 1.0)
    squares = np.ones(len(path.lengths) + 1) if squares is None else squares
    names, rows = zip(*_named_rows(path), strict=True)
    program = _DualProgram.from_rows(path, rows, max_speed, squares)
    multipliers = program.multipliers()
    if multipliers is None:
        return None, None
    bound, by_row, by_point = program.evaluate(multipliers)
    changes: dict[LimitKey, float] = defaultdict(float)
    for name, change in zip(names, by_row.tolist(), strict=True):
        changes[name] += change
    # At each point, the change by the speed limit F belongs to the limit that determines F.
    speed_ratios = path.speed_ratios(limits)
    binding = np.argmax(np.stack(list(speed_ratios.values())), axis=0)
    for k, name in enumerate(speed_ratios):
        changes[name] += float(by_point[path.moves & (binding == k)].sum())
    binding_limits = (Sensitivity(*name, change) for name, change in changes.items() if change)
    return bound, tuple(binding_limits)


@record
class _DualProgram:
    """The linear program for the multipliers λ of one path with n intervals.

    Its unknowns are the values of the multipliers at the ends of the intervals. Between them, the
    multipliers are linear in s. Each matrix maps the unknowns to the values of a quantity at the 5n
    points. The module's docstring defines the symbols.
    """

    y: Array
    """Speeds ṡ of the timing y₀, (5n,)."""
    max_speed: Array
    """Speed limits F of ṡ, (5n,)."""
    weights: Array
    """Weights of the coarse and the fine rule for integrals over s, (2, 5n)."""
    p: Any
    kappa: Any
    mu: Any
    """Matrices of p, κ and μ, (5n, unknowns) each."""
    excess: Any
    """Matrix of Σ λ_r (c_r − 1), (5n, unknowns)."""
    slack: Any
    """Matrix of Σ λ_r (1 − row_r) for the timing y₀, (5n, unknowns)."""
    jump: Any
    """Matrix of the jumps of μ at the inner grid points, (n − 1, unknowns)."""
    may_jump_at: Mask
    """True at inner grid points where λ may jump, (n − 1,).

    The speed limit may bind there, or a coefficient of s̈ jumps.
    """
    max_speed_squared: Array
    """F² at the inner grid points, (n − 1,)."""
    lengths: Array
    """Lengths of the intervals, (n,)."""
    unknowns: Array
    """Number of the unknown multiplier of each row at the start and at the end of each interval,
    (2, n, rows). It is −1 where the multiplier is 0.
    """

    @classmethod
    def from_rows(
        cls, path: PathRows, rows: Sequence[Array], max_speed: Array, squares: Array
    ) -> "_DualProgram":
        """Build the linear program of a path.

        Parameters
        ----------
        path : PathRows
            The path, sampled at five points of n intervals.
        rows : sequence of (4, 5n) arrays
            Values of each row at the four pairs (s̈, ṡ) in `path_rows.PROBE_STATES`.
        max_speed : (5n,) array
            Speed limits F.
        squares : (n + 1,) array
            ṡ² of the timing y₀ at the ends of the intervals.

        Returns
        -------
        _DualProgram
            Matrices and vectors of the program.
        """
        from scipy.sparse import csr_matrix  # It takes long to import.

        count = len(path.lengths)
        # s̈ is constant in an interval, so ṡ² is linear in s and grows by 2 s̈ times the length.
        gained = np.diff(squares)
        speed_squared = np.concatenate([squares[:-1] + share * gained for share in POINT_POSITIONS])
        speed_squared = np.minimum(speed_squared, max_speed**2)
        acceleration = np.tile(gained / (2 * path.lengths), len(POINT_POSITIONS))[:, None]
        a, b, c, k = row_coefficients(np.stack(rows, axis=2))
        y = np.sqrt(speed_squared)
        slack = 1 - (a * acceleration + b * speed_squared[:, None] + c + k * y[:, None])
        a_derivative = np.tensordot(
            QUARTIC_DERIVATIVES, a.reshape(len(POINT_POSITIONS), count, -1), 1
        )
        a_derivative = (a_derivative / path.lengths[:, None]).reshape(a.shape)
        max_speed_squared = np.minimum(max_speed[1:count], max_speed[-count:-1]) ** 2
        largest_rounding = COEFFICIENT_JUMP_TOLERANCE * np.abs(a).max(axis=0)
        jumps = np.abs(a[1:count] - a[-count:-1]) > largest_rounding
        is_fast = squares[1:-1] >= (1 - BINDING_MARGIN) ** 2 * max_speed_squared
        may_jump_at = is_fast | jumps.any(axis=1)
        unknowns = _number_unknowns(slack, may_jump_at)
        side, interval, row = np.nonzero(unknowns >= 0)
        points = np.arange(len(y)).reshape(-1, count)[:, interval]
        columns = np.broadcast_to(unknowns[side, interval, row], points.shape)
        entries: Any = points.ravel(), columns.ravel()
        shape = len(y), unknowns.max(initial=-1) + 1
        positions = np.array(POINT_POSITIONS)[:, None]
        value = np.where(side, positions, 1 - positions)
        change = (2 * side - 1) / path.lengths[interval]

        def linear(factors: Array, basis: Array = value) -> Any:
            """Build the matrix (5n, unknowns) of Σ_r factor_r λ_r at all points.

            Parameters
            ----------
            factors : (5n, rows) array
                Factors of the multipliers.
            basis : (5, k) array
                Values at the points of the linear functions that belong to the k unknowns. With
                their derivatives (`change`), the matrix is that of Σ_r factor_r λ_r'.
            """
            values = basis * factors.reshape(len(positions), count, -1)[:, interval, row]
            return csr_matrix((values.ravel(), entries), shape)

        mu = linear(a / 2)
        return cls(
            y=y,
            max_speed=max_speed,
            weights=np.multiply.outer(SIMPSON_WEIGHTS, path.lengths).reshape(2, -1),
            p=linear(b - a_derivative / 2) - linear(a / 2, change),
            kappa=linear(k),
            mu=mu,
            excess=linear(c - 1),
            slack=linear(slack),
            jump=mu[1:count] - mu[-count:-1],
            may_jump_at=may_jump_at,
            max_speed_squared=max_speed_squared,
            lengths=path.lengths,
            unknowns=unknowns,
        )

    def multipliers(self) -> Array | None:
        """Find the multipliers that give a large bound, by the linear program.

        Returns
        -------
        (unknowns,) array or None
            Multipliers that nearly satisfy the conditions of an optimum. None if the program is
            infeasible.
        """
        from scipy.optimize import linprog  # It takes long to import.
        from scipy.sparse import bmat, csr_matrix, diags, eye, hstack, kron

        # The program has one condition for the middle of every interval.
        size = len(self.lengths)
        first_middle = POINT_POSITIONS.index(0.5) * size
        middles = slice(first_middle, first_middle + size)
        y, max_speed = self.y[middles], self.max_speed[middles]
        p, kappa = self.p[middles], self.kappa[middles]
        limit_squares = self.y[1:size][self.may_jump_at] ** 2
        jumps = len(limit_squares)
        step: Any = eye(jumps)
        # δ is the sum of the multiplier of the speed limit and of two errors of opposite signs.
        signs = np.array([[1.0, 1.0, -1.0]])
        limit_cost = np.clip((max_speed - y) / y**2, 0.0, 1 / y)
        error_cost = OPTIMALITY_PENALTY / y
        optimality = diags(2 * y**3) @ p + diags(y**2) @ kappa
        # The value at F is at least that at y₀ if p + κ / (y₀ + F) is at least this threshold. A
        # positive δ lowers the threshold.
        threshold = 1 / (y * max_speed * (y + max_speed))
        at_max_speed = p + diags(1 / (y + max_speed)) @ kappa
        lowered = kron(signs > 0, diags(-threshold))
        jump_cost = self.max_speed_squared[self.may_jump_at] - limit_squares
        costs = [self.slack[middles].T @ self.lengths, jump_cost, limit_squares]
        costs += [self.lengths * cost for cost in (limit_cost, error_cost, error_cost)]
        optimality_rows = [optimality, None, None, kron(signs, eye(size))]
        jump_rows = [self.jump[self.may_jump_at], -step, step, None]
        inequality = [-at_max_speed, csr_matrix((size, 2 * jumps)), lowered]
        # The unknowns are the multipliers, the jumps of μ above and below 0, and the parts of δ.
        result = linprog(
            np.concatenate(costs),
            A_eq=bmat([optimality_rows, jump_rows]),
            b_eq=np.append(np.ones(size), np.zeros(jumps)),
            A_ub=hstack(inequality),
            b_ub=-threshold,
        )
        return None if result.x is None else np.maximum(result.x[: p.shape[1]], 0.0)

    def evaluate(self, multipliers: Array) -> tuple[float, Array, Array]:
        """Compute the lower bound for given multipliers, and its changes with the limits.

        The bound is the last line of the equation in the docstring of this module, minus the
        estimated error of Simpson's rule. The changes are those if a limit grows by one percent.

        Parameters
        ----------
        multipliers : (unknowns,) array
            Any values that are at least 0.

        Returns
        -------
        bound : float
            The bound, s.
        by_row : (rows,) array
            Changes that the limit of each row causes, s.
        by_point : (5n,) array
            Contributions of the points to the change that the speed limit causes, s.
        """
        p, kappa, mu = self.p @ multipliers, self.kappa @ multipliers, self.mu @ multipliers
        y, end = _minimise_integrand(p, kappa, self.max_speed), self.max_speed
        values = _integrand(y, p, kappa) + self.excess @ multipliers
        coarse_integral, fine_integral = self.weights @ values
        integration_error = abs(fine_integral - coarse_integral)
        # The jumps of μ may reduce the bound by F² max(Δμ, 0).
        jump = self.jump @ multipliers
        losses = self.max_speed_squared * np.where(jump > MULTIPLIER_JUMP_TOLERANCE, jump, 0.0)
        bound = fine_integral - integration_error + mu[-1] - mu[0] - losses.sum()
        # The number −1 stands for a multiplier that is 0.
        ends = np.append(multipliers, 0.0)[self.unknowns]
        integrals = np.einsum("enr,n->r", ends, self.lengths) / 2
        speed_multiplier = np.where(y == end, 1 - 2 * p * end**3 - kappa * end**2, 0.0)
        by_point = self.weights[0] * np.maximum(speed_multiplier, 0.0) / end
        by_point[1 : len(self.lengths)] += 2 * losses
        return float(bound), -SENSITIVITY_STEP * integrals, -SENSITIVITY_STEP * by_point


def _named_rows(path: PathRows) -> list[tuple[LimitKey, Array]]:
    """Compute the rows (limits, at most 1) of all accelerations and motor torques for the bound.

    Torque rows use the smallest friction coefficient. They are 0 in an interval in which the joint
    reverses, so that they limit nothing there.

    Parameters
    ----------
    path : PathRows
        The path, sampled at several points of its intervals.

    Returns
    -------
    list of (LimitKey, array)
        Pairs of a limit and the values (4, points) of its row at the four pairs (s̈, ṡ) in
        `path_rows.PROBE_STATES`.
    """
    # Each joint has two acceleration rows, one for either direction.
    names = [(JointAcceleration.name, joint.name) for joint in path.robot.joints for _ in range(2)]
    rows: list[tuple[LimitKey, Array]] = list(zip(names, path.acceleration_rows(), strict=True))
    for i, drive, motor in motorised_joints(path.robot.joints):
        speeds = np.array([0.0, drive.ratio * path.robot.joints[i].velocity])
        smallest = friction_coefficient(required_friction(drive), speeds).min()
        name = MotorTorque.name, path.robot.joints[i].name
        rows += [(name, side) for side in path.torque_rows(i, drive, motor, smallest)]
    return rows


def _number_unknowns(slack: Array, may_jump_at: Mask) -> Array:
    """Number the unknown multipliers of the linear program.

    The end of an interval and the start of the next one share an unknown. They have two unknowns
    where λ may jump. Where a row is far from its limit, its multiplier is 0 and not an unknown.

    Parameters
    ----------
    slack : (5n, rows) array
        Distances of the rows from their limits.
    may_jump_at : (n − 1,) array of bool
        True at inner grid points where λ may jump.

    Returns
    -------
    (2, n, rows) array
        Numbers of the unknowns at the starts and at the ends of the intervals, or −1.
    """
    count = len(may_jump_at) + 1
    end_slack = np.full((2, count + 1, slack.shape[1]), np.inf)
    end_slack[0, :-1], end_slack[1, 1:] = slack[:count], slack[-count:]
    may_bind = end_slack < BINDING_MARGIN
    may_jump = np.concatenate([[True], may_jump_at, [True]])[:, None]
    shared = may_bind.any(axis=0) & ~may_jump
    single = may_bind & may_jump
    numbers = np.full(may_bind.shape, -1)
    numbers[:, shared] = np.arange(shared.sum())
    numbers[single] = shared.sum() + np.arange(single.sum())
    return np.stack([numbers[0, :-1], numbers[1, 1:]])


def _minimise_integrand(p: Array, kappa: Array, max_speed: Array) -> Array:
    """Find the speed at which the integrand of the bound is smallest, at every point of the path.

    The integrand is 1/y + p y² + κ y for 0 < y ≤ max_speed. It is convex for y³ ≤ −1/p, or
    everywhere if p ≥ 0, and concave beyond. Its minimum is therefore in the convex part, where
    bisection finds it, or at y = max_speed.

    Parameters
    ----------
    p, kappa : (points,) arrays
        Coefficients at each point of the path.
    max_speed : (points,) array
        Largest value of y at each point.

    Returns
    -------
    (points,) array
        y at each point. It is equal to max_speed if no smaller speed is better.
    """
    end_of_convex_part = np.minimum(max_speed, np.cbrt(1 / np.maximum(-p, MIN_DIVISOR)))
    low = np.zeros_like(p)
    high = np.where(p < 0, end_of_convex_part, max_speed)
    # The derivative −1/y² + 2 p y + κ is positive where 2 p y³ + κ y² > 1.
    for _ in range(BISECTION_STEPS):
        y = (low + high) / 2
        rises = 2 * p * y**3 + kappa * y**2 > 1
        low = np.where(rises, low, y)
        high = np.where(rises, y, high)
    is_inner = _integrand(high, p, kappa) < _integrand(max_speed, p, kappa)
    return np.where(is_inner, high, max_speed)


def _integrand(y: Array, p: Array, kappa: Array) -> Array:
    """Evaluate the integrand of the bound, 1/y + p y² + κ y.

    Parameters
    ----------
    y : (points,) array
        Speeds on the path.
    p, kappa : (points,) arrays
        Coefficients of the integrand at each point.

    Returns
    -------
    (points,) array
        Values, s.
    """
    return 1 / y + p * y**2 + kappa * y
