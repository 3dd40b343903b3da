"""The time-optimal control problem of one free phase: the planner chooses the joint path.

variables   y, ẏ, ÿ at both ends of every element for the moving joints (q = q0 + d y); the time T
objective   T, and a trace of ∫ÿ² that smooths the joints which do not decide it
dynamics    y and ẏ continuous (ÿ too where jerk is limited), rest at both ends
limits      by construction: velocity by the Bernstein coefficients of ẏ, acceleration at both ends of every element,
            jerk its slope; positions lie between the ends because every joint moves one way
            at collocation points: motor torque, tip speed, roll and spin range, as far as they come near their limits
guess       closed form (free_guess.py)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.model.functions import call
from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.task import task_from_joints
from ssm_planner.planning.assembly import assemble, ipopt
from ssm_planner.planning.free_guess import FreeGuess, guess
from ssm_planner.planning.free_stage import COLLOCATION, DENSE, NUMBERS, WATCHED, FreeStage, RowName
from ssm_planner.planning.ocp import EXCESS, UNLIMITED, limit_table, status_of, tightening
from ssm_planner.planning.peaks import peaks
from ssm_planner.problem.values import TASK, Array, Problem

ELEMENTS = 40
NEAR = 0.9
"""A row whose guess stays below this share of its limit is left out until it is found exceeded."""
SMOOTHING = 1e-6
ROUNDS = 8
MOVES = 1e-9
"""A joint that has less than this to go (rad, m) stands."""
ANYWHERE = 1e3
"""Half width of a range that is not limited, rad."""


@dataclass(frozen=True, eq=False)
class FreeResult:
    """status: "solved", "infeasible" or "not converged"; breaks (n + 1,) in s; q, q̇, q̈ at both ends of elements, (n, 4)."""

    status: str
    message: str
    breaks: Array
    start: tuple[Array, Array, Array]
    end: tuple[Array, Array, Array]
    iterations: int

    @property
    def solved(self) -> bool:
        return self.status == "solved"


def solve_free(
    problem: Problem, mechanism: Mechanism, first: Array, last: Array, tighten: Array | None = None
) -> FreeResult:
    """Time-optimal motion from joints `first` to `last` (4,), both at rest; tighten as for `solve_straight`."""
    robot = problem.robot
    limits = limit_table(robot) * (1.0 if tighten is None else tighten)
    jerk = any(joint.jerk is not None for joint in robot.joints)
    delta = np.where(np.abs(last - first) > MOVES, last - first, 0.0)
    moving = tuple(np.flatnonzero(delta).tolist())
    begin = guess(np.abs(delta[list(moving)]), limits[:3, list(moving)], jerk, ELEMENTS)
    sigma = np.sign(delta)
    numbers = np.concatenate([first, delta, limits.ravel(), _ranges(problem, mechanism, first), [begin.duration]])
    everything = FreeStage(robot, mechanism, moving, _rows_of(problem, sigma))
    names = everything.names
    largest = _largest(everything, begin.elements, begin.fractions, sigma, numbers)
    kept = frozenset(name for name, worst in zip(names, largest.max(axis=0, initial=0.0), strict=True) if worst > NEAR)
    slack = np.zeros_like(largest)
    point: dict[str, Any] = {"x0": np.append(begin.elements.ravel(), 1.0)}
    program = None
    iterations = 0
    for _ in range(ROUNDS):
        if program is None:
            program = _Program.build(FreeStage(robot, mechanism, moving, kept), len(begin.fractions), jerk)
        shown = [name in kept for name in names]
        answer, stats = program.solve(point, numbers, sigma, begin.fractions, slack[:, shown])
        iterations += int(stats["iter_count"])
        x, message = answer["x"].full().ravel(), str(stats["return_status"])
        elements = x[:-1].reshape(len(begin.fractions), -1)
        if status_of(message) != "solved":
            break
        excess = _largest(everything, elements, begin.fractions * x[-1], sigma, numbers) - 1
        worst = excess.max(axis=0, initial=-1.0)
        if not np.any(worst > EXCESS):
            break
        missed = {name for name, value in zip(names, worst, strict=True) if value > EXCESS} - kept
        if missed:
            kept, program, point = kept | missed, None, {"x0": x}
        else:
            slack = slack + tightening(excess)
            point = {"x0": x, "lam_x0": answer["lam_x"], "lam_g0": answer["lam_g"]}
    return _result(message, elements, begin.instants * x[-1] * begin.duration, begin, first, delta, iterations)


def _rows_of(problem: Problem, sigma: Array) -> frozenset[RowName]:
    """The coupled limits that this problem has."""
    rows: set[RowName] = {(f"{name} range", None) for name in WATCHED if name in problem.limits}
    if problem.tip_speed is not None:
        rows.add(("tip speed", None))
    for i, joint in enumerate(problem.robot.joints):
        if sigma[i] and joint.drive is not None and joint.motor is not None:
            rows.add(("motor torque", i))
    return frozenset(rows)


def _ranges(problem: Problem, mechanism: Mechanism, first: Array) -> Array:
    """Tip speed, centre and half width of the watched ranges, in the turn of the closed form at the first joints."""
    from ssm_planner.model.closed_form import task_of_joints
    from ssm_planner.model.namespace import NUMPY

    unwrapped = task_of_joints(NUMPY, mechanism, tuple(first))
    wrapped = task_from_joints(mechanism, first[None, :])[0]
    values = [UNLIMITED if problem.tip_speed is None else problem.tip_speed]
    for name in WATCHED:
        k = TASK.index(name)
        low, high = problem.limits.get(name, (-ANYWHERE, ANYWHERE))
        values += [(low + high) / 2 + float(unwrapped[k]) - wrapped[k], (high - low) / 2]
    return np.array(values)


def _largest(stage: FreeStage, elements: Array, lengths: Array, sigma: Array, numbers: Array) -> Array:
    """Largest value of each row in each element, (n, rows)."""
    if not stage.names:
        return np.zeros((len(elements), 0))
    n = len(elements)
    x = np.column_stack([elements, lengths])
    rows = call(stage.between, x, np.tile(sigma, (n, 1)), np.tile(numbers, (n, 1)))[0]
    return peaks(rows.reshape(n, len(DENSE), -1).transpose(0, 2, 1))


def _result(
    message: str, elements: Array, breaks: Array, begin: FreeGuess, first: Array, delta: Array, iterations: int
) -> FreeResult:
    """Joint states in s at both ends of every element; neighbours share position and velocity to the last digit."""
    moving, scale = np.flatnonzero(delta), begin.duration
    parts = np.split(elements, 4, axis=1)
    ends = [np.vstack([parts[0][1:], np.ones(len(moving))]), np.vstack([parts[1][1:], np.zeros(len(moving))]), parts[3]]

    def joints(values: Array, order: int, offset: Array) -> Array:
        full = np.zeros((len(values), 4))
        full[:, moving] = values * delta[moving] / scale**order
        return full + offset

    still = np.zeros(4)
    start = joints(parts[0], 0, first), joints(parts[1], 1, still), joints(parts[2], 2, still)
    end = joints(ends[0], 0, first), joints(ends[1], 1, still), joints(ends[2], 2, still)
    return FreeResult(status_of(message), message, breaks, start, end, iterations)


@dataclass(frozen=True, eq=False)
class _Program:
    """The nonlinear program of one mesh and set of rows, all numbers being parameters."""

    stage: FreeStage
    jerk: bool
    cold: ca.Function
    warm: ca.Function
    equal: int
    hull: int
    slope: int
    rows: int

    @classmethod
    def build(cls, stage: FreeStage, n: int, jerk: bool) -> _Program:
        m = len(stage.moving)
        x, time = ca.MX.sym("x", 4 * m, n), ca.MX.sym("time")
        numbers, sigma, fractions = ca.MX.sym("numbers", NUMBERS), ca.MX.sym("sigma", 4), ca.MX.sym("fractions", 1, n)
        max_jerk = ca.MX.sym("max_jerk", m)
        h = time * fractions
        wide = ca.repmat(h, m, 1)
        y, v, a0, a1 = (x[k * m : (k + 1) * m, :] for k in range(4))
        next_y = ca.horzcat(y[:, 1:], ca.DM.ones(m, 1))
        next_v = ca.horzcat(v[:, 1:], ca.DM.zeros(m, 1))
        equal = [
            ca.vec(y + wide * v + wide**2 * (a0 / 3 + a1 / 6) - next_y),
            ca.vec(v + wide * (a0 + a1) / 2 - next_v),
        ]
        slopes = []
        if jerk:
            equal.append(ca.vec(a1[:, :-1] - a0[:, 1:]))
            room = ca.repmat(max_jerk, 1, n) * wide
            slopes = [ca.vec(a1 - a0 - room), ca.vec(a0 - a1 - room)]
        hull = ca.vec(v + wide * a0 / 2)
        plain = ca.vertcat(*equal, hull, *slopes)
        z = ca.vertcat(x, h)
        if any(name == "motor torque" for name, _ in stage.names):
            plain = ca.vertcat(plain, stage.breakaway(z[:, 0], sigma, numbers))
        energy = ca.sum2(ca.sum1(wide * (a0**2 + a0 * a1 + a1**2)))
        cold, warm, rows = assemble(
            ca.vertcat(ca.vec(x), time),
            ca.vertcat(numbers, sigma, fractions.T, max_jerk),
            time + SMOOTHING * energy,
            plain,
            stage.element,
            z,
            [sigma, numbers],
        )
        count = sum(part.numel() for part in equal)
        return cls(stage, jerk, cold, warm, count, hull.numel(), sum(part.numel() for part in slopes), rows)

    def solve(
        self, start: dict[str, Any], numbers: Array, sigma: Array, fractions: Array, slack: Array
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Ipopt's answer and statistics; slack (n, rows): by how much each element's rows are tightened."""
        moving, scale = list(self.stage.moving), numbers[-1]
        distance = np.abs(numbers[4:8][moving])
        speed, acceleration, jerk = (
            numbers[8 + 4 * k : 12 + 4 * k][moving] * scale ** (k + 1) / distance for k in range(3)
        )
        n, m = len(fractions), len(moving)
        lower = np.tile(np.concatenate([np.zeros(2 * m), -acceleration, -acceleration]), (n, 1))
        upper = np.tile(np.concatenate([np.ones(m), speed, acceleration, acceleration]), (n, 1))
        upper[0, : 2 * m] = 0.0
        if self.jerk:
            lower[0, 2 * m : 3 * m] = upper[0, 2 * m : 3 * m] = 0.0
            lower[-1, 3 * m :] = upper[-1, 3 * m :] = 0.0
        allowed = np.tile(1 - slack, (1, len(COLLOCATION))).ravel() if slack.size else np.ones(n)
        rest = self.rows - self.equal - self.hull - self.slope
        parts = (
            (np.zeros(self.equal), np.zeros(self.equal)),
            (np.zeros(self.hull), np.tile(speed, n)),
            (np.full(self.slope, -np.inf), np.zeros(self.slope)),
            (np.full(rest, -np.inf), np.concatenate([np.ones(rest - allowed.size), allowed])),
        )
        solver = self.warm if "lam_g0" in start else self.cold
        return ipopt(
            solver,
            **start,
            p=np.concatenate([numbers, sigma, fractions, jerk]),
            lbx=np.append(lower.ravel(), 0.1),
            ubx=np.append(upper.ravel(), np.inf),
            lbg=np.concatenate([low for low, _ in parts]),
            ubg=np.concatenate([high for _, high in parts]),
        )
