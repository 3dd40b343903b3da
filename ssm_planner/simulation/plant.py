"""The arm as a plant: rigid bodies, self-locking drives, and a spring, damper and backlash at each.

With rigid drives the motion of the arm is not unique wherever the inertia of a load makes the
effective inertia of a drive negative (dynamics/transmission.py). This is the case for joints 1 and
2 of the published robot. Every real gearbox has some compliance at its output. With it, each drive
is a separate sliding mesh under a smooth load, and standstill, breakaway and jamming are exact.
Joints without a drive have prescribed accelerations.

The integrator takes midpoint steps in CasADi. It accumulates the energies, so that their balance
can be checked.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from ssm_planner.dynamics.friction import friction_of
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.transmission import always_unique
from ssm_planner.errors import GeometryError
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.robot import Robot
from ssm_planner.simulation.drive import NOT_UNIQUE, drive_step, moving_inertia, stalled
from ssm_planner.typing import Array, record


@record
class Compliance:
    """Spring, damper and backlash between each drive and its joint.

    All arrays are (4,): N·m/rad, N·m·s/rad and rad, or N/m, N·s/m and m for joint 4.
    """

    stiffness: Array
    damping: Array
    backlash: Array = field(default_factory=lambda: np.zeros(4))
    """Free play from one flank to the other."""

    @classmethod
    def of_frequency(
        cls,
        body: RigidBody,
        q: Array,
        frequency: tuple[float, float, float, float] = (30.0, 30.0, 30.0, 100.0),
        damping_ratio: float = 0.3,
        backlash: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
    ) -> Compliance:
        """Compute stiffness and damping from natural frequencies (Hz) with locked drives at q (4,).

        The default values are assumptions, not measurements.
        """
        inertia = np.diag(body.mass_matrix(np.reshape(q, (1, 4)))[0])
        omega = 2.0 * math.pi * np.asarray(frequency)
        return cls(
            inertia * omega**2,
            2.0 * damping_ratio * inertia * omega,
            np.asarray(backlash, dtype=float),
        )

    def stretch(self, k: int, twist: ca.SX | Array) -> ca.SX | Array:
        """Return the deflection of the spring of joint k (counted from 0) at a twist of the drive.

        It has the shape of `twist`.
        """
        free = 0.5 * float(self.backlash[k])
        if free == 0.0:
            return twist
        xp = ca if isinstance(twist, ca.SX) else np
        return twist - xp.fmin(xp.fmax(twist, -free), free)


@record
class ArmMotion:
    """A simulated motion at the control instants. Arrays are (n,) and (n, 4), in SI units.

    Motor columns are NaN for joints without a drive.
    """

    time: Array
    q: Array
    qd: Array
    motor_angle: Array
    w: Array
    tau: Array
    """Motor torque during the period that begins at each instant."""
    work: Array
    """Energy since the start from the motors and from prescribed accelerations, J."""
    friction_loss: Array
    damping_loss: Array
    kinetic: Array
    potential: Array
    """Energy of gravity and of the springs, J."""
    status: str
    """`done`, or the reason why the motion is invalid."""


FRICTION = ("mu", "mu_static", "mu_stribeck", "b_c", "b_v", "b_oc", "b_ov")
"""Names in Friction of the parameters that may differ from run to run."""

Q, QD, MOTOR, W, INTEGRAL, REST, ENERGY = (slice(4 * k, 4 * k + 4) for k in range(7))
STATE = 28
"""Length of a state: four numbers for each of the slices above."""
STILL = 1e-12
"""Change of twist per step (rad or m) below which the twist counts as constant."""
CORRECTIONS = 2
"""Corrections of the forces in a step for the resulting speeds.

Each correction reduces the error of the energy balance to a tenth.
"""
_WORK, _LOCKED_WORK, _FRICTION, _DAMPING = range(4)


@dataclass(frozen=True)
class _Forces:
    """Forces of the springs and dampers on the joints (4,), and the motion of the drives."""

    load: ca.SX
    damper: ca.SX
    w: ca.SX
    mean: ca.SX
    rest: ca.SX
    loss: ca.SX


class ArmPlant:
    """The arm of a robot under motor torques, in steps of h seconds."""

    def __init__(self, robot: Robot, compliance: Compliance | None, h: float) -> None:
        self.robot, self.h = robot, h
        self.body = RigidBody.from_robot(robot)
        self.compliance = compliance or Compliance.of_frequency(self.body, np.zeros(4))
        self.driven = tuple(k for k, joint in enumerate(robot.joints) if joint.drive is not None)

    def at_rest(self, q: Array) -> Array:
        """Return the state (28,) at rest at q (4,), with the weight on the springs."""
        return self.in_motion(q, np.zeros(4), np.zeros(4))

    def in_motion(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Return the state (28,) in a motion q, qd, qdd (4,), with its loads on the springs."""
        load = self.body.inverse_dynamics(*(np.reshape(x, (1, 4)) for x in (q, qd, qdd)))[0]
        state = np.zeros(STATE)
        state[Q], state[QD] = q, qd
        for k in self.driven:
            backlash = 0.5 * self.compliance.backlash[k] * np.sign(load[k])
            twist = load[k] / self.compliance.stiffness[k] + backlash
            state[MOTOR][k] = self.drive(k).ratio * (q[k] + twist)
            state[W][k] = self.drive(k).ratio * qd[k]
        state[REST] = np.where(state[W] == 0.0, 1e6, 0.0)
        return state

    def motion(self, time: Array, x: Array, tau: Array) -> ArmMotion:
        """Build a result with energies from states (n, 28) at times (n,)."""
        driven = list(self.driven)
        kinetic, potential = self.body.energy(x[:, Q], x[:, QD])
        for k in driven:
            drive = self.drive(k)
            motor, w = x[:, MOTOR][:, k], x[:, W][:, k]
            kinetic = kinetic + 0.5 * moving_inertia(drive) * w**2
            stretch = np.asarray(self.compliance.stretch(k, motor / drive.ratio - x[:, k]))
            potential = potential + 0.5 * self.compliance.stiffness[k] * stretch**2
        energy = x[:, ENERGY]
        columns = {name: np.full((len(x), 4), np.nan) for name in ("motor", "w", "tau")}
        for name, values in (("motor", x[:, MOTOR]), ("w", x[:, W]), ("tau", tau)):
            columns[name][:, driven] = values[:, driven]
        return ArmMotion(
            time=time,
            q=x[:, Q],
            qd=x[:, QD],
            motor_angle=columns["motor"],
            w=columns["w"],
            tau=columns["tau"],
            work=energy[:, _WORK] + energy[:, _LOCKED_WORK],
            friction_loss=energy[:, _FRICTION],
            damping_loss=energy[:, _DAMPING],
            kinetic=kinetic,
            potential=potential,
            status=self._status(x),
        )

    def _status(self, x: Array) -> str:
        if not np.all(np.isfinite(x)):
            return "diverged"
        return "done" if all(always_unique(self.drive(k)) for k in self.driven) else NOT_UNIQUE

    def step_function(self) -> ca.Function:
        """Build the function of one step.

        It maps (state, motor torques, prescribed accelerations, blocked, friction) to the state one
        step later by the midpoint rule. Forces at the start give speeds and positions of the
        middle, which give the forces of the step. They are corrected CORRECTIONS times with the
        speeds that result from them. Inertia and weight are those of the first middle. The
        prescribed accelerations (4,) apply to joints without a drive. `blocked` (4,) is 1 for a
        blocked motor. `friction` (28,) has the layout of the method `friction`.
        """
        h = self.h
        x, tau, locked = ca.SX.sym("x", STATE), ca.SX.sym("tau", 4), ca.SX.sym("locked", 4)
        blocked, friction = ca.SX.sym("blocked", 4), ca.SX.sym("friction", 4 * len(FRICTION))
        inputs = (x, tau, locked, blocked, friction)
        q, qd, w, motor = x[Q], x[QD], x[W], x[MOTOR]
        # Forces at the initial speeds give the speeds of the middle. These give the forces of the
        # step.
        predictor = self._forces(inputs, q + 0.5 * h * qd, motor + 0.5 * h * w, qd, w)
        middle_qd = qd + 0.5 * h * self.accelerations(q + 0.5 * h * qd, qd, predictor.load, locked)
        middle_w = predictor.mean
        middle_q, middle_motor = q + 0.5 * h * middle_qd, motor + 0.5 * h * middle_w
        forces = self._forces(inputs, middle_q, middle_motor, middle_qd, middle_w)
        qdd = self.accelerations(middle_q, middle_qd, forces.load, locked)
        for _ in range(CORRECTIONS):
            mean_qd, mean_w = qd + 0.5 * h * qdd, forces.mean
            forces = self._forces(
                inputs, q + 0.5 * h * mean_qd, motor + 0.5 * h * mean_w, mean_qd, mean_w
            )
            qdd = self.accelerations(middle_q, middle_qd, forces.load, locked)
        qd_after = qd + h * qdd
        mean_qd, mean_w = 0.5 * (qd + qd_after), forces.mean
        effort = self.body.symbolic(middle_q, middle_qd, qdd)
        work = h * ca.dot(tau, mean_w)
        locked_work = h * sum(
            (effort[k] * mean_qd[k] for k in range(4) if k not in self.driven), ca.SX(0)
        )
        bent = [
            forces.damper[k] * (mean_w[k] / self.drive(k).ratio - mean_qd[k]) for k in self.driven
        ]
        energy = x[ENERGY] + ca.vertcat(work, locked_work, forces.loss, h * sum(bent, ca.SX(0)))
        y = ca.vertcat(
            q + h * mean_qd,
            qd_after,
            motor + h * mean_w,
            forces.w,
            x[INTEGRAL],
            forces.rest,
            energy,
        )
        return ca.Function("step", list(inputs), [y], {"cse": True})

    def _forces(
        self, inputs: tuple[ca.SX, ...], q: ca.SX, motor: ca.SX, qd: ca.SX, w: ca.SX
    ) -> _Forces:
        """Return the forces at the middle of the step (4,), and the motion of the drives."""
        x, tau, _, blocked, friction = inputs
        load, damper, speed, mean, rest = ([ca.SX(0)] * 4 for _ in range(5))
        loss = ca.SX(0)
        for k in self.driven:
            drive = _with_friction(
                self.drive(k), friction[k * len(FRICTION) : (k + 1) * len(FRICTION)]
            )
            stretch, contact = self._mean_stretch(
                k, x[MOTOR][k] / drive.ratio - x[Q][k], motor[k] / drive.ratio - q[k]
            )
            damper[k] = self.compliance.damping[k] * (w[k] / drive.ratio - qd[k]) * contact
            load[k] = self.compliance.stiffness[k] * stretch + damper[k]
            speed_before, rest_time = x[W][k], x[REST][k]
            step = drive_step(
                drive, speed_before, rest_time, tau[k], load[k], h=self.h, middle=w[k]
            )
            step = stalled(
                drive, step, blocked[k], w=speed_before, load=load[k], tau=tau[k], h=self.h
            )
            speed[k], mean[k], rest[k], loss = step.w, step.mean, step.rest, loss + step.loss
        parts = [ca.vertcat(*column) for column in (load, damper, speed, mean, rest)]
        return _Forces(parts[0], parts[1], w=parts[2], mean=parts[3], rest=parts[4], loss=loss)

    def _mean_stretch(self, k: int, start: ca.SX, middle: ca.SX) -> tuple[ca.SX, ca.SX | float]:
        """Return the mean deflection of the spring over a step, and the share with contact.

        The twist between drive and joint changes linearly from `start` through `middle`, so contact
        begins and ends at its exact position. The mean force times the travel is the change of the
        spring's energy (a discrete gradient; O. Gonzalez, Time Integration and Discrete Hamiltonian
        Systems, J. Nonlinear Sci. 6, 1996).
        """
        if not self.compliance.backlash[k] > 0:
            return middle, 1.0
        end = 2 * middle - start
        first, last = self.compliance.stretch(k, start), self.compliance.stretch(k, end)
        still = ca.fabs(end - start) < STILL
        contact = ca.if_else(still, first != 0, (last - first) / ca.if_else(still, 1, end - start))
        return contact * (first + last) / 2, contact

    def friction(self, scale: float = 1.0) -> Array:
        """Return FRICTION of every joint, joint after joint, (28,), multiplied by `scale`."""
        values = np.zeros((4, len(FRICTION)))
        for k in self.driven:
            friction = friction_of(self.drive(k))
            values[k] = [scale * getattr(friction, name) for name in FRICTION]
        return values.ravel()

    def drive(self, k: int) -> Drive:
        """Return the drive of joint k, counted from 0. Raises GeometryError if it has none."""
        drive = self.robot.joints[k].drive
        if drive is None:
            raise GeometryError(f"joint {k + 1} has no drive")
        return drive

    def accelerations(self, q: ca.SX, qd: ca.SX, force: ca.SX, locked: ca.SX) -> ca.SX:
        """Return the joint accelerations (4,), with `locked` for joints without a drive."""
        free = list(self.driven)
        undriven = [k for k in range(4) if k not in free]
        probe = ca.SX.sym("qdd", 4)
        effort = self.body.symbolic(q, qd, probe)
        mass = ca.densify(ca.jacobian(effort, probe))
        prescribed = ca.SX.zeros(4)
        for k in undriven:
            prescribed[k] = locked[k]
        bias = ca.substitute(effort, probe, prescribed)
        solved = ca.ldl_solve(force[free] - bias[free], *ca.ldl(mass[free, free]))
        qdd = ca.SX(prescribed)
        for row, k in enumerate(free):
            qdd[k] = solved[row]
        return qdd


def _with_friction(drive: Drive, values: ca.SX) -> Drive:
    """Return the drive with symbols for FRICTION, without the checks of user input."""
    friction, changed = copy.copy(friction_of(drive)), copy.copy(drive)
    for name, value in zip(FRICTION, ca.vertsplit(values), strict=True):
        object.__setattr__(friction, name, value)
    object.__setattr__(changed, "friction", friction)
    return changed
