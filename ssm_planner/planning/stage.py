"""One element of a straight phase as CasADi Functions: the limits at its collocation points, from s(t) alone.

Time is scaled: t = scale · t̂. An element is (s, ṡ, s̈ at its start, s̈ at its end, length) in scaled time.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.rigid_body import RigidBody
from ssm_planner.model.symbolic import joints_from_task_symbolic
from ssm_planner.planning.rows import Bounds, Instant, Row, kinematic_rows, torque_rows
from ssm_planner.problem.values import Robot

COLLOCATION = (0.0, 0.5, 1.0)
"""Where in an element the limits are kept; both ends, because the acceleration may jump there."""

DENSE = tuple(k / 8 for k in range(9))
"""Where the planner looks for limits exceeded between the collocation points."""

NUMBERS = 4 + 4 + 16 + 1
"""Length of the parameter vector: task start, task difference, limits (velocity, acceleration, jerk, torque), scale."""


@dataclass(frozen=True, eq=False)
class StraightStage:
    """Functions of one robot and IK branch; everything else is a parameter."""

    mechanism: Mechanism
    robot: Robot
    branch: int
    jerk: bool

    @cached_property
    def element(self) -> ca.Function:
        """(element (5), sigma (4), numbers) → rows ≤ 1 at all collocation points."""
        x, sigma, numbers = ca.SX.sym("x", 5), ca.SX.sym("sigma", 4), ca.SX.sym("numbers", NUMBERS)
        values = [self._point(element_state(x, c), sigma, numbers) for c in COLLOCATION]
        return ca.Function("element", [x, sigma, numbers], [ca.vertcat(*values)])

    @cached_property
    def between(self) -> ca.Function:
        """(element (5), sigma (4), numbers) → largest value of every row over the element, looked at densely."""
        x, sigma, numbers = ca.SX.sym("x", 5), ca.SX.sym("sigma", 4), ca.SX.sym("numbers", NUMBERS)
        values = []
        for c in DENSE:
            state = element_state(x, c)
            state[4] = state[1]
            values.append(self._point(state, sigma, numbers))
        return ca.Function("between", [x, sigma, numbers], [_rowwise_max(values)])

    @cached_property
    def breakaway(self) -> ca.Function:
        """(element (5), sigma (4), numbers) → torque rows at its start with the static friction coefficient."""
        x, sigma, numbers = ca.SX.sym("x", 5), ca.SX.sym("sigma", 4), ca.SX.sym("numbers", NUMBERS)
        at, bounds = self._instant(element_state(x, 0.0), sigma, numbers)
        rows = torque_rows(at, bounds, self.robot.joints, breakaway=True)
        return ca.Function("breakaway", [x, sigma, numbers], [ca.vertcat(*(row.value for row in rows))])

    @cached_property
    def _point(self) -> ca.Function:
        """(`element_state`, sigma, numbers) → rows ≤ 1."""
        state, sigma, numbers = ca.SX.sym("state", 5), ca.SX.sym("sigma", 4), ca.SX.sym("numbers", NUMBERS)
        rows = self.rows(state, sigma, numbers)
        return ca.Function("point", [state, sigma, numbers], [ca.vertcat(*(row.value for row in rows))])

    def rows(self, state: ca.SX, sigma: ca.SX, numbers: ca.SX) -> list[Row]:
        """The named limits at one instant of the path."""
        at, bounds = self._instant(state, sigma, numbers)
        joints = self.robot.joints
        return [*kinematic_rows(at, bounds, joints, self.jerk), *torque_rows(at, bounds, joints)]

    def _instant(self, state: ca.SX, sigma: ca.SX, numbers: ca.SX) -> tuple[Instant, Bounds]:
        start, delta, scale = numbers[:4], numbers[4:8], numbers[24]
        s = ca.SX.sym("s")
        q = joints_from_task_symbolic(self.mechanism, start + s * delta, self.branch)
        dq = ca.jacobian(q, s)
        ddq = ca.jacobian(dq, s)
        dddq = ca.jacobian(ddq, s) if self.jerk else ca.SX.zeros(4)
        path = ca.Function("path", [s, numbers], [q, dq, ddq, dddq])
        q, dq, ddq, dddq = path(state[0], numbers)
        speed, acceleration, jerk = state[1] / scale, state[2] / scale**2, state[3] / scale**3
        qd, qd_hull = dq * speed, dq * state[4] / scale
        qdd = ddq * speed**2 + dq * acceleration
        qddd = dddq * speed**3 + 3 * ddq * speed * acceleration + dq * jerk
        tau = RigidBody.from_robot(self.robot).symbolic(q, qd, qdd)
        limits = [numbers[8 + 4 * k : 12 + 4 * k] for k in range(4)]
        return Instant(q, qd, qd_hull, qdd, qddd, tau, sigma), Bounds(*limits)


def element_state(x: ca.SX, c: float) -> ca.SX:
    """s, its three derivatives, and the hull of ṡ at the share c of an element's length; s̈ is linear, s cubic.

    ṡ is a quadratic with the Bernstein coefficients ṡ(0), ṡ(0) + h s̈(0)/2, ṡ(1): while these three keep a bound, so does
    ṡ everywhere between. They stand in for ṡ in the velocity rows at the start, the middle and the end.
    """
    s, speed, start, end, h = (x[i] for i in range(5))
    t, rise = c * h, end - start
    here = speed + t * (start + c * rise / 2)
    hull = speed + h * start / 2 if c == 0.5 else here
    return ca.vertcat(s + t * (speed + t * (start / 2 + c * rise / 6)), here, start + c * rise, rise / h, hull)


def _rowwise_max(columns: list[ca.SX]) -> ca.SX:
    largest = columns[0]
    for column in columns[1:]:
        largest = ca.fmax(largest, column)
    return largest
