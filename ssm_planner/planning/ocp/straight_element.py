"""One element of a straight phase as CasADi Functions: the limits at its collocation points, from s(t) alone.

Time is scaled: t = scale · t̂. An element is (s, ṡ, s̈ at its start, s̈ at its end, length) in scaled time; it is a
stage of planning/program.py with one coordinate.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from ssm_planner.planning.ocp.compiled import cache_key
from ssm_planner.planning.ocp.constraints import (
    Bounds,
    Instant,
    PathConstraint,
    effort,
    heat,
    kinematic_rows,
    torque_rows,
)
from ssm_planner.planning.ocp.element import COLLOCATION
from ssm_planner.planning.ocp.path_fit import LOCAL, PathFit
from ssm_planner.planning.ocp.transcription import DENSE, Aim, RowName
from ssm_planner.problem.robot import Robot

NUMBERS = 16 + 1 + 1
"""Length of the parameter vector: limits (velocity, acceleration, jerk, torque by joint), tip speed, scale."""


@dataclass(frozen=True, eq=False)
class StraightElement:
    """Functions of one robot; path, load, limits and directions are parameters. `kept` names the rows that are wanted.

    All take (element (5), sigma (4), local (LOCAL), numbers (NUMBERS)).
    """

    robot: Robot
    jerk: bool
    kept: frozenset[RowName] | None = None
    """None: all."""
    aim: Aim = "time"

    size = 5
    arguments = ((4, True), (LOCAL, True), (NUMBERS, False))

    @cached_property
    def key(self) -> tuple[Any, ...]:
        return "straight", cache_key(self.robot), self.jerk, self.kept, self.aim

    @cached_property
    def names(self) -> list[RowName]:
        """Limit and joint of every row, in order."""
        state, (_, *parameters) = ca.SX.sym("state", 5), self._inputs()
        return [(row.name, row.joint) for row in self._rows(state, *parameters)]

    def states(self, z: ca.SX) -> list[ca.SX]:
        """`element_state` at the collocation points."""
        return [element_state(z, c) for c in COLLOCATION]

    @cached_property
    def point(self) -> ca.Function:
        """Rows ≤ 1 at one `element_state`."""
        state, (_, *parameters) = ca.SX.sym("state", 5), self._inputs()
        rows = self._rows(state, *parameters)
        values = [row.value for row in rows]
        return ca.Function("point", [state, *parameters], [ca.vertcat(ca.SX(0, 1), *values)])

    @cached_property
    def cost(self) -> ca.Function | None:
        """Heat or effort at one `element_state`, where that is the aim."""
        if self.aim == "time":
            return None
        state, (_, *parameters) = ca.SX.sym("state", 5), self._inputs()
        at, _ = self._instant(state, *parameters)
        slow, _ = self._instant(ca.vertcat(state[0], ca.SX.zeros(4)), *parameters)
        joints = self.robot.joints
        value = heat(at, joints) if self.aim == "heat" else effort(at, slow, joints)
        return ca.Function("cost", [state, *parameters], [value])

    @cached_property
    def between(self) -> ca.Function:
        """The same rows at the points DENSE, one after the other."""
        x, *parameters = self._inputs()
        values = []
        for c in DENSE:
            state = element_state(x, c)
            state[4] = state[1]
            values.append(self.point(state, *parameters))
        return ca.Function("between", [x, *parameters], [ca.vertcat(ca.SX(0, 1), *values)])

    @cached_property
    def breakaway(self) -> ca.Function:
        """Torque rows at the element's start with the static friction coefficient."""
        x, *parameters = self._inputs()
        at, bounds = self._instant(element_state(x, 0.0), *parameters)
        rows = torque_rows(at, bounds, self.robot.joints, breakaway=True)
        return ca.Function("breakaway", [x, *parameters], [ca.vertcat(*(row.value for row in rows))])

    @cached_property
    def breakaway_joints(self) -> list[int]:
        """Joint of every breakaway row."""
        return breakaway_joints(self.robot)

    def _rows(self, state: ca.SX, sigma: ca.SX, local: ca.SX, numbers: ca.SX) -> list[PathConstraint]:
        """The named limits at one instant of the path."""
        at, bounds = self._instant(state, sigma, local, numbers)
        joints = self.robot.joints
        rows = [*kinematic_rows(at, bounds, joints, self.jerk), *torque_rows(at, bounds, joints)]
        return [row for row in rows if self.kept is None or (row.name, row.joint) in self.kept]

    def _inputs(self) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        sizes = {"x": 5, "sigma": 4, "local": LOCAL, "numbers": NUMBERS}
        x, sigma, local, numbers = (ca.SX.sym(name, size) for name, size in sizes.items())
        return x, sigma, local, numbers

    def _instant(self, state: ca.SX, sigma: ca.SX, local: ca.SX, numbers: ca.SX) -> tuple[Instant, Bounds]:
        scale = numbers[17]
        speed, acceleration, jerk = state[1] / scale, state[2] / scale**2, state[3] / scale**3
        dq, ddq, dddq, (inertia, velocity, gravity), tip = PathFit(local).at(state[0], self.jerk)
        at = Instant(
            qd=dq * speed,
            qd_hull=dq * state[4] / scale,
            qdd=ddq * speed**2 + dq * acceleration,
            qddd=dddq * speed**3 + 3 * ddq * speed * acceleration + dq * jerk,
            tau_rigid=inertia * acceleration + velocity * speed**2 + gravity,
            tip_speed=tip * state[4] / scale,
            sigma=sigma,
        )
        velocity, acceleration, jerk_limit, torque = (numbers[4 * k : 4 * k + 4] for k in range(4))
        return at, Bounds(velocity, acceleration, jerk_limit, torque, tip_speed=numbers[16])


def breakaway_joints(robot: Robot) -> list[int]:
    """Joint of every row of `torque_rows` with static friction."""
    driven = (i for i, joint in enumerate(robot.joints) if joint.drive is not None and joint.motor is not None)
    return [i for i in driven for _ in range(3)]


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
