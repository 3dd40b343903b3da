"""The time-optimal control problem of one straight phase: cubic pieces s(t), solved by Ipopt.

    variables   s, ṡ, s̈ at the start and s̈ at the end of every element; the time T_m between turning points
    objective   Σ T_m, every element keeping its share of its interval
    dynamics    s and ṡ continuous (s̈ too where jerk is limited), rest at both ends, s at the turning points
    limits      rows ≤ 1 at the collocation points of every element; static friction where a joint starts or turns
    guess       TOPP-RA's motion along the same path

Between turning points every joint keeps its direction, so the friction law enters exactly (planning/rows.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.model.functions import call
from ssm_planner.model.rigid_body import RigidBody
from ssm_planner.planning.assembly import assemble, ipopt
from ssm_planner.planning.bound import lower_bound
from ssm_planner.planning.local_path import LOCAL, fit
from ssm_planner.planning.mesh import Mesh
from ssm_planner.planning.path import StraightPath
from ssm_planner.planning.peaks import peaks
from ssm_planner.planning.retiming import Retiming
from ssm_planner.planning.stage import COLLOCATION, DENSE, NUMBERS, StraightStage
from ssm_planner.problem.values import Array, Robot

ELEMENTS = 64
UNLIMITED = 1e9
EXCESS = 2e-7
"""Where a row exceeds its limit between collocation points by more than this share, its element is tightened."""
BACKOFF = 1.2
"""Tightening per excess found."""
ROUNDS = 5


@dataclass(frozen=True, eq=False)
class PathMotion:
    """s(t) as elements (n, 5): s, ṡ, s̈ at the start, s̈ at the end, length; s, and s ∈ [0, 1]."""

    elements: Array

    @property
    def duration(self) -> float:
        return float(self.elements[:, 4].sum())


@dataclass(frozen=True, eq=False)
class OcpResult:
    """status: "solved", "infeasible" or "not converged", with Ipopt's own word as message."""

    status: str
    message: str
    motion: PathMotion
    iterations: int

    @property
    def solved(self) -> bool:
        return self.status == "solved"


def solve_straight(
    robot: Robot,
    path: StraightPath,
    guess: Retiming,
    tip_speed: float | None = None,
    tighten: Array | None = None,
    count: int = ELEMENTS,
) -> OcpResult:
    """Time-optimal motion along the path, from TOPP-RA's motion as guess.

    tighten (4, 4): factors on the velocity, acceleration, jerk and torque limits (rows) of the joints (columns).
    """
    jerk = any(joint.jerk is not None for joint in robot.joints)
    knots, signs = path.directions
    mesh = Mesh.along(guess, knots, count, _path_jerk(robot, path, guess.s) if jerk else None)
    scale = max(guess.duration, lower_bound(robot, *path.sample(np.array([0.0, 1.0])).q))
    problem = _Problem.build(StraightStage(robot, jerk), mesh.share)
    limits = limit_table(robot) * (1.0 if tighten is None else tighten)
    sigma = signs[mesh.interval]
    start = mesh.guess(guess)
    times = np.bincount(mesh.interval, np.diff(mesh.instants)) / mesh.instants[-1]
    numbers = np.concatenate([limits.ravel(), [UNLIMITED if tip_speed is None else tip_speed, scale]])
    body = RigidBody.from_robot(robot)
    local = fit(path, body, start[:, 0], np.append(start[1:, 0], 1.0))
    point: dict[str, Any] = {"x0": np.concatenate([start.ravel(), times])}
    allowed = np.ones((len(mesh.interval), problem.stage.between.size1_out(0) // len(DENSE)))
    iterations = 0
    for _ in range(ROUNDS):
        p = np.concatenate([numbers, sigma.ravel(), local.ravel(), mesh.fractions, knots[1:-1]])
        answer, stats = problem.solve(point, p, allowed)
        x = answer["x"].full().ravel()
        point = {"x0": answer["x"], "lam_x0": answer["lam_x"], "lam_g0": answer["lam_g"]}
        iterations += int(stats["iter_count"])
        states, times = x[: start.size].reshape(-1, 4), x[start.size :]
        elements = np.column_stack([states, times[mesh.interval] * mesh.fractions])
        local = fit(path, body, elements[:, 0], np.append(elements[1:, 0], 1.0))
        rows = call(problem.stage.between, elements, sigma, local, np.tile(numbers, (len(elements), 1)))[0]
        excess = peaks(rows.reshape(len(elements), len(DENSE), -1).transpose(0, 2, 1)) - 1
        if status_of(str(stats["return_status"])) != "solved" or excess.max() <= EXCESS:
            break
        allowed -= tightening(excess)
    elements *= np.array([1.0, 1 / scale, 1 / scale**2, 1 / scale**2, scale])
    message = str(stats["return_status"])
    return OcpResult(status_of(message), message, PathMotion(elements), iterations)


def _path_jerk(robot: Robot, path: StraightPath, s: Array) -> Array:
    """Largest s⃛ that the jerk limits of the joints allow at low speed, (n,)."""
    limit = np.array([UNLIMITED if joint.jerk is None else joint.jerk for joint in robot.joints])
    with np.errstate(divide="ignore"):
        return np.asarray((limit / np.abs(path.sample(s).dq)).min(axis=1))


def limit_table(robot: Robot) -> Array:
    """Velocity, acceleration, jerk and motor-torque limits (rows) of the joints (columns), (4, 4)."""
    table = np.full((4, 4), UNLIMITED)
    for i, joint in enumerate(robot.joints):
        table[0, i], table[1, i] = joint.velocity, joint.acceleration
        if joint.jerk is not None:
            table[2, i] = joint.jerk
        if joint.drive is not None and joint.motor is not None:
            table[0, i] = min(joint.velocity, joint.motor.max_speed / joint.drive.ratio)
            table[3, i] = joint.motor.max_torque
    return table


@dataclass(frozen=True, eq=False)
class _Problem:
    """The nonlinear program of one mesh, all numbers being parameters, and the bounds of its variables."""

    stage: StraightStage
    cold: ca.Function
    warm: ca.Function
    lower: Array
    upper: Array
    equal: int
    """Rows that are equations; then come those ≤ 1, the last of them the elements'."""
    rows: int

    def solve(self, start: dict[str, Any], p: Array, allowed: Array) -> tuple[dict[str, Any], dict[str, Any]]:
        """Ipopt's answer and statistics, from variables x0 alone or a whole earlier answer (x0, lam_x0, lam_g0).

        allowed (n, rows of an instant): what each element's rows may reach.
        """
        lower = np.concatenate([np.zeros(self.equal), np.full(self.rows - self.equal, -np.inf)])
        element_rows = np.tile(allowed, (1, len(COLLOCATION))).ravel()
        upper = np.concatenate(
            [np.zeros(self.equal), np.ones(self.rows - self.equal - element_rows.size), element_rows]
        )
        solver = self.warm if "lam_g0" in start else self.cold
        return ipopt(solver, **start, p=p, lbx=self.lower, ubx=self.upper, lbg=lower, ubg=upper)

    @classmethod
    def build(cls, stage: StraightStage, share: tuple[int, ...]) -> _Problem:
        """share: elements between turning points."""
        n, intervals = sum(share), len(share)
        x, time = ca.MX.sym("x", 4, n), ca.MX.sym("time", intervals)
        numbers, sigma = ca.MX.sym("numbers", NUMBERS), ca.MX.sym("sigma", 4, n)
        local, knots = ca.MX.sym("local", LOCAL, n), ca.MX.sym("knots", intervals - 1)
        fractions = ca.MX.sym("fractions", n)
        h = fractions * ca.vertcat(*(ca.repmat(time[i], k, 1) for i, k in enumerate(share)))
        elements = ca.vertcat(x, h.T)
        s, v, a0, a1 = (x[i, :].T for i in range(4))
        equal = [
            s + h * v + h**2 * (a0 / 3 + a1 / 6) - ca.vertcat(s[1:], 1.0),
            v + h * (a0 + a1) / 2 - ca.vertcat(v[1:], 0.0),
        ]
        if stage.jerk:
            equal.append(a1[:-1] - a0[1:])
        first = [0, *np.cumsum(share)[:-1].tolist()]
        equal += [s[k] - knots[i] for i, k in enumerate(first[1:])]
        variables = ca.vertcat(ca.vec(x), time)
        parameters = ca.vertcat(numbers, ca.vec(sigma), ca.vec(local), fractions, knots)
        loose = [stage.breakaway(elements[:, 0], sigma[:, 0], local[:, 0], numbers)]
        for k in first[1:]:  # the joint may turn back either way
            loose += [stage.breakaway(elements[:, k], sigma[:, k - side], local[:, k], numbers) for side in (0, 1)]
        equal_rows, loose_rows = ca.vertcat(*equal), ca.vertcat(*loose)
        cold, warm, rows = assemble(
            variables,
            parameters,
            ca.sum1(time),
            ca.vertcat(equal_rows, loose_rows),
            stage.element,
            elements,
            [sigma, local, numbers],
        )
        lower = np.tile([0.0, 0.0, -np.inf, -np.inf], (n, 1))
        upper = np.tile([1.0, np.inf, np.inf, np.inf], (n, 1))
        upper[0, :2] = 0.0
        if stage.jerk:
            lower[0, 2] = upper[0, 2] = lower[-1, 3] = upper[-1, 3] = 0.0
        return cls(
            stage,
            cold,
            warm,
            np.append(lower.ravel(), np.full(intervals, 1e-3)),
            np.append(upper.ravel(), np.full(intervals, np.inf)),
            equal_rows.numel(),
            rows,
        )


def tightening(excess: Array) -> Array:
    """By how much to lower rows that were found exceeded between the collocation points."""
    return np.asarray(np.where(excess > 0, BACKOFF * excess + EXCESS, 0.0))


def status_of(ipopt: str) -> str:
    if ipopt in ("Solve_Succeeded", "Solved_To_Acceptable_Level"):
        return "solved"
    if ipopt == "Infeasible_Problem_Detected":
        return "infeasible"
    return "not converged"
