"""Element model of a free motion, in which the solver chooses the path of the joints.

An element is an interval of time in which every joint position is a cubic polynomial of time. The
coordinates of an element are u = (q − q0)/d for the joints that move. q0 is the position of the
joint at the start of the motion, and d > 0 is a unit in rad or m. The state x = (u, u̇, ü) contains
all four joints, (12,), in scaled time. Every joint keeps its direction within an element, so the
friction law is exact.
"""

import pickle
from collections.abc import Hashable
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import casadi as ca

from ssm_planner.codegen import Layout, casadi_namespace
from ssm_planner.dynamics import RigidBody
from ssm_planner.elements.element import ElementModel, Parameter
from ssm_planner.elements.rows import (
    LIMIT_SIZES,
    IndexedRow,
    Instant,
    PathConstraint,
    indexed_torque_rows,
    robot_key,
    speed_rows,
    torque_rows,
)
from ssm_planner.kinematics import (
    SPEED_JACOBIANS,
    Mechanism,
    eye_constraints,
    task_from_joints_symbolic,
    task_rates_symbolic,
    tip_position_symbolic,
)
from ssm_planner.problem import (
    TASK_COORDINATES,
    Eye,
    LensClearance,
    RetinaClearance,
    TaskRange,
    TaskRate,
)
from ssm_planner.typing import keyword_record

RANGE_LIMITED_COORDINATES = ("roll", "spin")
"""Task coordinates whose range is a path constraint.

A motion may leave a range of roll or spin although all its given points lie inside. Tilt and depth
cannot leave their range between two points, because each of them depends on one joint, which keeps
its direction there.
"""
RATE_LIMITED_COORDINATES = ("roll", "tilt", "spin")
"""Task coordinates whose limited rate is a path constraint.

The rate of depth is the velocity of joint 4, so its limit is a bound of that velocity instead.
"""


@keyword_record
class FreeElement(ElementModel):
    """Path constraints of a free motion: limits of the robot, the task coordinates and the eye.

    The parameter vectors are the directions σ (4,) of the joints and the vector of `layout`.
    """

    mechanism: Mechanism
    """Kinematics of the robot."""
    moving: tuple[int, ...]
    """Indices of the joints that move. They are the coordinates of the elements."""
    eye: Eye | None = None
    """Eye with the retina and the lens, which the tool must not touch. None without an eye."""

    state_size = 12
    position_count = 4
    layout = Layout(
        q0=4,
        d=4,
        **LIMIT_SIZES,
        range_centre=len(RANGE_LIMITED_COORDINATES),
        range_half_width=len(RANGE_LIMITED_COORDINATES),
        rate=len(RATE_LIMITED_COORDINATES),
        retina_easing=1,
        time_scale=1,
    )
    """Names and lengths of the entries of the second parameter vector.

    `q0` and `d` are the origins and units of the coordinates u. The entries of `LIMIT_SIZES` are
    the limits of joints and tool. `range_centre` and `range_half_width` describe the ranges of
    `RANGE_LIMITED_COORDINATES`, and `rate` contains the largest rates of
    `RATE_LIMITED_COORDINATES`. `retina_easing` is the amount by which the row of the retina may
    exceed 1. `time_scale` is the unit of scaled time, s.
    """

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Sizes of the directions σ, and of the vector in the order of `layout`."""
        return Parameter(4, True), Parameter(self.layout.size, False)

    @cached_property
    def key(self) -> tuple[Hashable, ...]:
        """Kind of motion, key of the robot, moving joints, active rows, eye and cost.

        Models with the same key share their CasADi Functions.
        """
        return (
            "free",
            robot_key(self.robot),
            self.moving,
            self.active,
            pickle.dumps(self._active_eye),
            self.aim,
        )

    @property
    def coordinates(self) -> int:
        """Number of moving joints."""
        return len(self.moving)

    def state(self, z: ca.SX, c: float) -> ca.SX:
        """Build the expression of u, u̇ and ü of all joints at one instant of an element.

        Parameters
        ----------
        z : (4 m + 1,) casadi.SX
            Vector that describes the element (an interval of time) with m moving joints.
        c : float
            Fraction of the length of the element, from 0 to 1.

        Returns
        -------
        (12,) casadi.SX
            u, u̇ and ü of the four joints. They are 0 for joints that do not move.
        """
        x = ca.SX.zeros(12)
        # The entries 0 to 3 of x are u, 4 to 7 are u̇, and 8 to 11 are ü.
        for order, values in enumerate(self.cubic(z).evaluate(c)):
            x[[4 * order + joint for joint in self.moving]] = values
        return x

    def instant(self, x: ca.SX, *p: ca.SX) -> Instant:
        """Build the expressions of the motion and the limits of the joints in one state.

        The speeds of the tool and their limits are squared, because the derivative of a speed
        does not exist at rest. A speed is a norm.

        Parameters
        ----------
        x : (12,) casadi.SX
            State: u, u̇ and ü of the four joints.
        *p : casadi.SX
            Directions σ (4,) of the joints, and the vector in the order of `layout`.

        Returns
        -------
        Instant
            Expressions in SI units.
        """
        sigma, packed = p
        limits = self.layout.unpack(packed)
        q, qd, qdd = _joint_motion(x, limits)
        bodies = [RigidBody.from_robot(load) for load in self.robot.loads]
        efforts = [body.symbolic(q, qd, qdd) for body in bodies]
        limits.speeds = limits.speeds**2
        squared_speeds = [ca.sumsqr(jacobian(q) @ qd) for jacobian in self._jacobians]
        return Instant(
            qd=qd,
            qd_hull=qd,
            qdd=qdd,
            qddd=ca.SX.zeros(4),
            tau_rigid=ca.vertcat(*efforts),
            speeds=ca.vertcat(*squared_speeds),
            sigma=sigma,
            limits=limits,
        )

    def rows(self, x: ca.SX, *p: ca.SX) -> list[PathConstraint]:
        """Build the path constraints (rows) in one state.

        The limits of joint velocity and acceleration are not among them, because they are linear
        constraints of the optimisation problem.

        Parameters
        ----------
        x : (12,) casadi.SX
            State: u, u̇ and ü of the four joints.
        *p : casadi.SX
            Directions σ (4,) of the joints, and the vector in the order of `layout`.

        Returns
        -------
        list of PathConstraint
            Rows of tool speeds, motor torques, task ranges, task rates and the eye.
        """
        instant = self.instant(x, *p)
        parameters = self.layout.unpack(p[1])
        q, qd, _ = _joint_motion(x, parameters)
        rows = speed_rows(instant) + torque_rows(instant, self.robot)
        rows += range_rows(self.mechanism, q, parameters)
        rows += rate_rows(self.mechanism, q, qd, parameters)
        if self._active_eye is not None:
            rows += clearance_rows(self._active_eye, self.mechanism, q, parameters.retina_easing)
        return rows

    @property
    def first_actuation(self) -> int:
        """Index of the first row (path constraint) of a torque in native/elements.c.

        The rows before it are those of the tool speeds, two for each range and rate of task
        coordinates, and two of the eye (retina and lens).
        """
        return (
            len(SPEED_JACOBIANS)
            + 2 * (len(RANGE_LIMITED_COORDINATES) + len(RATE_LIMITED_COORDINATES))
            + 2
        )

    @cached_property
    def all_indexed_rows(self) -> list[IndexedRow]:
        """Name, joint and index in native/elements.c of each of `rows` (path constraints)."""
        rows: list[IndexedRow] = [
            (speed_class.name, None, k) for k, speed_class in enumerate(SPEED_JACOBIANS)
        ]
        rows += indexed_torque_rows(self.robot, self.first_actuation)
        names = [TaskRange.name_of(name) for name in RANGE_LIMITED_COORDINATES]
        names += [TaskRate.name_of(name) for name in RATE_LIMITED_COORDINATES]
        # Each range and each rate has two rows, one for each sign.
        for k, name in enumerate(names):
            index = len(SPEED_JACOBIANS) + 2 * k
            rows += [(name, None, index), (name, None, index + 1)]
        eye = self._active_eye
        if eye is not None:
            rows.append((RetinaClearance.name, None, self.first_actuation - 2))
            if eye.lens is not None:
                rows.append((LensClearance.name, None, self.first_actuation - 1))
        return rows

    @property
    def _active_eye(self) -> Eye | None:
        """The eye if one of its rows is active, otherwise None.

        Models for different eyes are thus equal if none of the rows of the eye is active.
        """
        if self.eye is None or self.active is None:
            return self.eye
        rows = {(limit.name, None) for limit in self.eye.limits}
        return self.eye if rows & self.active else None

    @cached_property
    def _jacobians(self) -> list[ca.Function]:
        """Functions q (4,) → J(q) (k, 4), one for each tool speed, which is the norm of J q̇."""
        q = ca.SX.sym("q", 4)
        return [
            ca.Function("jacobian", [q], [jacobian(self.mechanism, q)])
            for jacobian in SPEED_JACOBIANS.values()
        ]


def range_rows(mechanism: Any, q: ca.SX, parameters: SimpleNamespace) -> list[PathConstraint]:
    """Build the rows (path constraints, at most 1) that keep roll and spin in their ranges.

    The coordinates are those of `RANGE_LIMITED_COORDINATES`.

    Parameters
    ----------
    mechanism : Mechanism
        Kinematics of the robot.
    q : (4,) casadi.SX
        Joint positions, rad, and m for joint 4.
    parameters : SimpleNamespace
        Values of `FreeElement.layout`.

    Returns
    -------
    list of PathConstraint
        Two rows for each range, +(value − centre)/half_width and −(value − centre)/half_width.
    """
    rows = []
    task = task_from_joints_symbolic(mechanism, q)
    for k, coordinate in enumerate(RANGE_LIMITED_COORDINATES):
        distance = task[TASK_COORDINATES.index(coordinate)] - parameters.range_centre[k]
        value = distance / parameters.range_half_width[k]
        name = TaskRange.name_of(coordinate)
        rows += [PathConstraint(name, None, value), PathConstraint(name, None, -value)]
    return rows


def rate_rows(
    mechanism: Any, q: ca.SX, qd: ca.SX, parameters: SimpleNamespace
) -> list[PathConstraint]:
    """Build the rows (path constraints, at most 1) that limit the rates of roll, tilt and spin.

    The coordinates are those of `RATE_LIMITED_COORDINATES`.

    Parameters
    ----------
    mechanism : Mechanism
        Kinematics of the robot.
    q, qd : (4,) casadi.SX
        Joint positions in rad and velocities in rad/s (joint 4: m and m/s).
    parameters : SimpleNamespace
        Values of `FreeElement.layout`.

    Returns
    -------
    list of PathConstraint
        Two rows for each rate, +rate/limit and −rate/limit.
    """
    rows = []
    rates = task_rates_symbolic(mechanism, q, qd)
    for k, coordinate in enumerate(RATE_LIMITED_COORDINATES):
        value = rates[TASK_COORDINATES.index(coordinate)] / parameters.rate[k]
        name = TaskRate.name_of(coordinate)
        rows += [PathConstraint(name, None, value), PathConstraint(name, None, -value)]
    return rows


def clearance_rows(eye: Any, mechanism: Any, q: ca.SX, easing: ca.SX) -> list[PathConstraint]:
    """Build the rows (path constraints) that keep the tip away from the retina and the lens.

    Parameters
    ----------
    eye : Eye
        Eye with the clearances that the tip must keep.
    mechanism : Mechanism
        Kinematics of the robot.
    q : (4,) casadi.SX
        Joint positions, rad, and m for joint 4.
    easing : casadi.SX
        Amount by which the row of the retina may exceed 1. It is subtracted from the row.

    Returns
    -------
    list of PathConstraint
        One row for the retina and, if the eye has a lens, one for the lens.
    """
    rows = []
    tip = tip_position_symbolic(mechanism, q)
    for name, value in eye_constraints(casadi_namespace(), eye, (tip[0], tip[1], tip[2])).items():
        # The expressions of the eye are at most 0, and a row is at most 1.
        excess = easing if name == RetinaClearance.name else 0
        rows.append(PathConstraint(name, None, value + 1 - excess))
    return rows


def _joint_motion(x: ca.SX, p: SimpleNamespace) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Convert the state of a free motion to joint positions, velocities and accelerations.

    Parameters
    ----------
    x : (12,) casadi.SX
        State u, u̇ and ü of all joints in scaled time.
    p : SimpleNamespace
        Values of `FreeElement.layout`. Its q0, d and time_scale define the scaled units.

    Returns
    -------
    q, qd, qdd : (4,) casadi.SX
        Positions, velocities and accelerations in SI units.
    """
    return p.q0 + p.d * x[:4], p.d * x[4:8] / p.time_scale, p.d * x[8:12] / p.time_scale**2
