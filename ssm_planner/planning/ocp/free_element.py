"""One element of a free phase: the limits that couple the joints.

The coordinates are those of the moving joints, u = (q − q0) / d with d > 0; the state is x = (u, u̇, ü) of all four joints,
(12,), in scaled time. Every joint keeps its direction within an element, so the friction law enters exactly.
"""

from __future__ import annotations

import pickle
from collections.abc import Hashable
from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace

import casadi as ca

from ssm_planner.codegen.namespace import casadi_namespace
from ssm_planner.codegen.vectorised import Layout
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.kinematics.eye import eye_rows
from ssm_planner.kinematics.forward import JACOBIANS, tip_position_symbolic
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints_symbolic, task_rates_symbolic
from ssm_planner.planning.ocp.constraints import (
    LIMITS,
    Bounds,
    Instant,
    PathConstraint,
    robot_key,
    speed_rows,
    torque_rows,
)
from ssm_planner.planning.ocp.element import ElementModel, Parameter
from ssm_planner.problem.limits import TASK, RetinaClearance, TaskRange, TaskRate
from ssm_planner.problem.problem import Eye

WATCHED = ("roll", "spin")
"""Task coordinates that may leave their range between two points inside it; tilt and depth follow one joint each."""
RATED = ("roll", "tilt", "spin")
"""Task coordinates whose rate is no multiple of one joint's."""
PARAMETERS = Layout(
    q0=4,
    d=4,
    **LIMITS,
    range_centre=len(WATCHED),
    range_half_width=len(WATCHED),
    rate=len(RATED),
    retina_easing=1,
    time_scale=1,
)
"""First point and unit of the coordinates; limits; ranges of WATCHED; rates of RATED; by how much the retina's row may
exceed 1; length of a scaled second, s."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FreeElement(ElementModel):
    """Path constraints of one robot, and of an eye, for a set of moving joints: p = (σ (4,), PARAMETERS)."""

    mechanism: Mechanism
    moving: tuple[int, ...]
    eye: Eye | None = None

    state_size = 12
    positions = 4
    parameters = (Parameter(4, True), Parameter(PARAMETERS.size, False))

    @cached_property
    def key(self) -> tuple[Hashable, ...]:
        return "free", robot_key(self.robot), self.moving, self.active, pickle.dumps(self.eye), self.aim

    @property
    def coordinates(self) -> int:
        return len(self.moving)

    def state(self, z: ca.SX, c: float) -> ca.SX:
        x = ca.SX.zeros(12)
        for order, values in enumerate(self.cubic(z).at(c)):
            x[[4 * order + joint for joint in self.moving]] = values
        return x

    def instant(self, x: ca.SX, *p: ca.SX) -> tuple[Instant, Bounds]:
        sigma, packed = p
        parameters = PARAMETERS.unpack(packed)
        q, qd, qdd = _joints(x, parameters)
        at = Instant(
            qd=qd,
            qd_hull=qd,
            qdd=qdd,
            qddd=ca.SX.zeros(4),
            tau_rigid=RigidBody.from_robot(self.robot).symbolic(q, qd, qdd),
            # squared: the norm has no derivative at rest
            speeds=ca.vertcat(*(ca.sumsqr(jacobian(q) @ qd) for jacobian in self._jacobians)),
            sigma=sigma,
        )
        return at, replace(Bounds.of(parameters), speeds=parameters.speeds**2)

    def rows(self, x: ca.SX, *p: ca.SX) -> list[PathConstraint]:
        at, bounds = self.instant(x, *p)
        parameters = PARAMETERS.unpack(p[1])
        q, qd, _ = _joints(x, parameters)
        rows = [*speed_rows(at, bounds), *torque_rows(at, bounds, self.robot.joints)]
        task = task_from_joints_symbolic(self.mechanism, q)
        for k, name in enumerate(WATCHED):
            value = (task[TASK.index(name)] - parameters.range_centre[k]) / parameters.range_half_width[k]
            rows += [PathConstraint(TaskRange.name_of(name), None, side * value) for side in (1, -1)]
        rates = task_rates_symbolic(self.mechanism, q, qd)
        for k, name in enumerate(RATED):
            value = rates[TASK.index(name)] / parameters.rate[k]
            rows += [PathConstraint(TaskRate.name_of(name), None, side * value) for side in (1, -1)]
        if self.eye is not None:
            tip = tip_position_symbolic(self.mechanism, q)
            for name, value in eye_rows(casadi_namespace(), self.eye, (tip[0], tip[1], tip[2])).items():
                easing = parameters.retina_easing if name == RetinaClearance.name else 0
                rows.append(PathConstraint(name, None, value + 1 - easing))
        return rows

    @cached_property
    def _jacobians(self) -> list[ca.Function]:
        """q (4,) → J (k, 4) of every speed of the tool."""
        q = ca.SX.sym("q", 4)
        return [ca.Function("jacobian", [q], [jacobian(self.mechanism, q)]) for jacobian in JACOBIANS.values()]


def _joints(x: ca.SX, p: SimpleNamespace) -> tuple[ca.SX, ca.SX, ca.SX]:
    """q, q̇ and q̈ in SI units, (4,) each; p: PARAMETERS."""
    return p.q0 + p.d * x[:4], p.d * x[4:8] / p.time_scale, p.d * x[8:12] / p.time_scale**2
