"""One element of a free phase as CasADi Functions: the limits that couple the joints, at its collocation points.

The coordinates are u = (q − q0) / d of the moving joints, d > 0. Every joint keeps its direction within an element, so
the friction law enters exactly (planning/rows.py). It is a stage of planning/program.py.
"""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from ssm_planner.codegen.namespace import casadi_namespace
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.kinematics.eye import RETINA, eye_rows
from ssm_planner.kinematics.forward import tip_position_symbolic
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints_symbolic, task_rates_symbolic
from ssm_planner.planning.ocp.compiled import cache_key
from ssm_planner.planning.ocp.constraints import Bounds, Instant, PathConstraint, effort, heat, torque_rows
from ssm_planner.planning.ocp.element import COLLOCATION
from ssm_planner.planning.ocp.straight_element import breakaway_joints
from ssm_planner.planning.ocp.transcription import DENSE, Aim, RowName
from ssm_planner.problem.problem import TASK, Eye
from ssm_planner.problem.robot import Robot

WATCHED = ("roll", "spin")
"""Task coordinates that may leave their range between two points inside it; tilt and depth follow one joint each."""
RATED = ("roll", "tilt", "spin")
"""Task coordinates whose rate is no multiple of one joint's."""
NUMBERS = 4 + 4 + 16 + 1 + 2 * len(WATCHED) + len(RATED) + 1 + 1
"""q0, d, limits (velocity, acceleration, jerk, torque by joint), tip speed, centre and half width of the watched ranges,
rates, easing of the retina's row, scale."""


@dataclass(frozen=True, eq=False)
class FreeElement:
    """Functions of one robot for a set of moving joints; `kept` names the rows that are wanted.

    All take (element (4 · moving + 1), sigma (4), numbers (NUMBERS)).
    """

    robot: Robot
    mechanism: Mechanism
    moving: tuple[int, ...]
    kept: frozenset[RowName]
    eye: Eye | None = None
    aim: Aim = "time"

    arguments = ((4, True), (NUMBERS, False))

    @cached_property
    def key(self) -> tuple[Any, ...]:
        return "free", cache_key(self.robot), self.moving, self.kept, pickle.dumps(self.eye), self.aim

    @property
    def size(self) -> int:
        """Length of an element."""
        return 4 * len(self.moving) + 1

    @cached_property
    def names(self) -> list[RowName]:
        """Name and joint of every kept row, in order."""
        return [(row.name, row.joint) for row in self._kept(self._rows(*self._symbols()))]

    def states(self, z: ca.SX) -> list[ca.SX]:
        """`state` at the collocation points."""
        return [self.state(z, c) for c in COLLOCATION]

    @cached_property
    def point(self) -> ca.Function:
        """Kept rows ≤ 1 at one `state`."""
        state, sigma, numbers = self._symbols()
        values = [row.value for row in self._kept(self._rows(state, sigma, numbers))]
        return ca.Function("point", [state, sigma, numbers], [ca.vertcat(ca.SX(0, 1), *values)])

    @cached_property
    def cost(self) -> ca.Function | None:
        """Heat or effort at one `state`, where that is the aim."""
        if self.aim == "time":
            return None
        state, sigma, numbers = self._symbols()
        at, _, _ = self._instant(state, sigma, numbers)
        joints = self.robot.joints
        if self.aim == "heat":
            return ca.Function("cost", [state, sigma, numbers], [heat(at, joints)])
        slow, _, _ = self._instant(ca.vertcat(state[:4], ca.SX.zeros(8)), sigma, numbers)
        return ca.Function("cost", [state, sigma, numbers], [effort(at, slow, joints)])

    @cached_property
    def breakaway(self) -> ca.Function:
        """Torque rows at the element's start with the static friction coefficient."""
        x, *parameters = self._inputs()
        at, bounds, _ = self._instant(self.state(x, 0.0), *parameters)
        rows = torque_rows(at, bounds, self.robot.joints, breakaway=True)
        return ca.Function("breakaway", [x, *parameters], [ca.vertcat(*(row.value for row in rows))])

    @cached_property
    def breakaway_joints(self) -> list[int]:
        """Joint of every breakaway row."""
        return breakaway_joints(self.robot)

    @cached_property
    def between(self) -> ca.Function:
        """The rows of `element` at the points DENSE, one after the other."""
        x, *parameters = self._inputs()
        values = [self.point(self.state(x, c), *parameters) for c in DENSE]
        return ca.Function("between", [x, *parameters], [ca.vertcat(ca.SX(0, 1), *values)])

    def state(self, x: ca.SX, c: float) -> ca.SX:
        """u, u̇, ü of all joints at the share c of an element's length, (12,); ü is linear, u cubic."""
        m = len(self.moving)
        u, speed, start, end, h = (x[k * m : (k + 1) * m] for k in range(5))
        t, rise = c * h, end - start
        values = ca.SX.zeros(12)
        for k, joint in enumerate(self.moving):
            a0, slope = start[k], c * rise[k]
            values[joint] = u[k] + t * (speed[k] + t * (a0 / 2 + slope / 6))
            values[4 + joint] = speed[k] + t * (a0 + slope / 2)
            values[8 + joint] = a0 + slope
        return values

    def _kept(self, rows: list[PathConstraint]) -> list[PathConstraint]:
        return [row for row in rows if (row.name, row.joint) in self.kept]

    def _rows(self, state: ca.SX, sigma: ca.SX, numbers: ca.SX) -> list[PathConstraint]:
        at, bounds, q = self._instant(state, sigma, numbers)
        # squared: the norm has no derivative at rest
        rows = [PathConstraint("tip speed", None, at.tip_speed / bounds.tip_speed**2)]
        rows += torque_rows(at, bounds, self.robot.joints)
        task = task_from_joints_symbolic(self.mechanism, q)
        for k, name in enumerate(WATCHED):
            centre, half = numbers[25 + 2 * k], numbers[26 + 2 * k]
            value = (task[TASK.index(name)] - centre) / half
            rows += [PathConstraint(f"{name} range", None, value), PathConstraint(f"{name} range", None, -value)]
        rates = task_rates_symbolic(self.mechanism, q, at.qd)
        for k, name in enumerate(RATED):
            value = rates[TASK.index(name)] / numbers[29 + k]
            rows += [PathConstraint(f"{name} rate", None, value), PathConstraint(f"{name} rate", None, -value)]
        if self.eye is not None:
            tip = tip_position_symbolic(self.mechanism, q)
            for name, value in eye_rows(casadi_namespace(), self.eye, (tip[0], tip[1], tip[2])).items():
                rows.append(PathConstraint(name, None, value + 1 - (numbers[NUMBERS - 2] if name == RETINA else 0)))
        return rows

    def _instant(self, state: ca.SX, sigma: ca.SX, numbers: ca.SX) -> tuple[Instant, Bounds, ca.SX]:
        d, scale = numbers[4:8], numbers[NUMBERS - 1]
        q = numbers[:4] + d * state[:4]
        qd, qdd = d * state[4:8] / scale, d * state[8:12] / scale**2
        tau = RigidBody.from_robot(self.robot).symbolic(q, qd, qdd)
        tip_speed_squared = ca.sumsqr(self._tip_jacobian(q) @ qd)
        at = Instant(qd, qd, qdd, ca.SX.zeros(4), tau, tip_speed_squared, sigma)
        velocity, acceleration, jerk, torque = (numbers[8 + 4 * k : 12 + 4 * k] for k in range(4))
        return at, Bounds(velocity, acceleration, jerk, torque, numbers[24]), q

    @cached_property
    def _tip_jacobian(self) -> ca.Function:
        q = ca.SX.sym("q", 4)
        return ca.Function("tip_jacobian", [q], [ca.jacobian(tip_position_symbolic(self.mechanism, q), q)])

    def _symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        return ca.SX.sym("state", 12), ca.SX.sym("sigma", 4), ca.SX.sym("numbers", NUMBERS)

    def _inputs(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        return ca.SX.sym("x", self.size), ca.SX.sym("sigma", 4), ca.SX.sym("numbers", NUMBERS)
