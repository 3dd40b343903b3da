"""Model the arm as rigid bodies that self-locking drives move through springs and dampers.

If the drives were rigid, the motion of the arm would not be unique: the inertia of the load can
make the effective inertia of a drive negative (dynamics/transmission.py), as for joints 1 and 2 of
the published robot. Every real gearbox has some compliance and backlash at its output. With
compliance, each drive slides under a load that changes smoothly, so the model describes standstill,
breakaway and jamming exactly. Joints without a drive have prescribed accelerations.

The integrator takes midpoint steps in CasADi. It accumulates the energies, so that their balance
can be checked.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import field

import casadi as ca
import numpy as np

from ssm_planner.dynamics import RigidBody, friction_of
from ssm_planner.errors import GeometryError
from ssm_planner.problem import Drive, Robot
from ssm_planner.simulation.drive import drive_step, stalled
from ssm_planner.typing import Array, frozen, record

DAMPING_RATIO = 0.3
"""Assumed damping ratio of all joints with locked drives."""


@record
class Compliance:
    """Spring, damper and backlash between each drive and its joint. Arrays are (4,)."""

    stiffness: Array
    """Stiffness, N·m/rad, and N/m for joint 4."""
    damping: Array
    """Damping, N·m·s/rad, and N·s/m for joint 4."""
    backlash: Array = field(default_factory=lambda: np.zeros(4))
    """Free play from one flank to the other, rad, and m for joint 4."""

    @classmethod
    def of_frequency(
        cls,
        body: RigidBody,
        q: Array,
        frequency: Sequence[float] = (30.0, 30.0, 30.0, 100.0),
    ) -> Compliance:
        """Compute stiffness and damping from the natural frequencies of the joints.

        The default values and the damping ratio DAMPING_RATIO are assumptions, not measurements.
        The joints are free of backlash.

        Parameters
        ----------
        body
            Rigid bodies of the robot.
        q
            Joint positions at which the frequencies apply, (4,), rad and m.
        frequency
            Natural frequency of each joint with locked drives, Hz.
        """
        inertia = np.diag(body.mass_matrix(np.reshape(q, (1, 4)))[0])
        omega = 2.0 * math.pi * np.asarray(frequency)
        return cls(inertia * omega**2, 2.0 * DAMPING_RATIO * inertia * omega)

    def stretch(self, k: int, twist: ca.SX | Array) -> ca.SX | Array:
        """Return the deflection of a joint's spring.

        It is the twist between drive and joint without the free play, and 0 within the free play.

        Parameters
        ----------
        k
            Index of the joint, from 0.
        twist
            Position of the drive's output minus position of the joint, any shape, rad or m.
        """
        free = 0.5 * float(self.backlash[k])
        if free == 0.0:
            return twist
        xp = ca if isinstance(twist, ca.SX) else np
        return twist - xp.fmin(xp.fmax(twist, -free), free)


FRICTION = ("mu", "mu_static", "mu_stribeck", "b_c", "b_v", "b_oc", "b_ov")
"""Names of the parameters in Friction that may differ between simulations."""

Q, QD, MOTOR, W, INTEGRAL, REST, ENERGY = (slice(4 * k, 4 * k + 4) for k in range(7))
"""Slices of a state (28,).

They contain joint positions, joint velocities, motor angles, motor speeds, integral terms of the
controllers, times at rest, and energies. The four energies are those of motors, of prescribed
accelerations, of friction and of dampers.
"""
STATE = 28
"""Length of a state."""
STILL = 1e-12
"""Change of the twist in a step below which the twist counts as constant, rad or m."""
CORRECTIONS = 2
"""Number of times that the forces of a step are corrected for the resulting speeds.

Each correction reduces the error of the energy balance to a tenth.
"""


@frozen
class _Forces:
    """Efforts in a step and the resulting motion of the drives, as expressions (4,)."""

    load: ca.SX
    """Effort of spring and damper on each joint, N·m or N."""
    damper: ca.SX
    """Effort of the damper alone."""
    w: ca.SX
    """Motor speeds after the step, rad/s."""
    mean: ca.SX
    """Mean motor speeds in the step, rad/s."""
    rest: ca.SX
    """Times at rest after the step, s."""
    loss: ca.SX
    """Energy that friction dissipates in all drives, J, (1,)."""


class ArmPlant:
    """Simulation model of an arm with motor torques as inputs.

    Parameters
    ----------
    robot
        Robot with its drives.
    compliance
        Springs, dampers and backlash. None means the assumed values of `Compliance.of_frequency`.
    h
        Duration of a step, s.
    """

    def __init__(self, robot: Robot, compliance: Compliance | None, h: float) -> None:
        self.robot, self.h = robot, h
        self.body = RigidBody.from_robot(robot)
        self.compliance = compliance or Compliance.of_frequency(self.body, np.zeros(4))
        self.driven = tuple(k for k, joint in enumerate(robot.joints) if joint.drive is not None)

    def at_rest(self, q: Array) -> Array:
        """Return the state (28,) of the arm at rest at q (4,). The weight deflects the springs."""
        return self.in_motion(q, np.zeros(4), np.zeros(4))

    def in_motion(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Return the state (28,) of the arm in the motion q, qd, qdd (4,).

        The loads of this motion deflect the springs.
        """
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

    def step_function(self) -> ca.Function:
        """Build the CasADi function that advances a state by one step of the midpoint rule.

        The forces at the start give the positions and speeds in the middle of the step, and these
        give the forces of the step. The forces are then corrected CORRECTIONS times for the speeds
        that result from them. Inertia and weight are evaluated once, at the first estimate of the
        middle.

        The function has five arguments. The state (28,) and the motor torques (4,) come first. The
        third argument contains prescribed accelerations (4,), which apply to joints without a
        drive. The argument `blocked` (4,) is 1 for a blocked motor, and `friction` (28,) has the
        layout of the method `friction`. The function returns the state (28,) after the step.
        """
        h = self.h
        x, tau, locked = ca.SX.sym("x", STATE), ca.SX.sym("tau", 4), ca.SX.sym("locked", 4)
        blocked, friction = ca.SX.sym("blocked", 4), ca.SX.sym("friction", 4 * len(FRICTION))
        inputs = (x, tau, locked, blocked, friction)
        q, qd, w, motor = x[Q], x[QD], x[W], x[MOTOR]
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
        mean_qd = 0.5 * (qd + qd_after)
        effort = self.body.symbolic(middle_q, middle_qd, qdd)
        y = ca.vertcat(
            q + h * mean_qd,
            qd_after,
            motor + h * forces.mean,
            forces.w,
            x[INTEGRAL],
            forces.rest,
            x[ENERGY] + self._energies(tau, effort, forces, mean_qd),
        )
        return ca.Function("step", list(inputs), [y], {"cse": True})

    def _energies(self, tau: ca.SX, effort: ca.SX, forces: _Forces, mean_qd: ca.SX) -> ca.SX:
        """Return the four energies of a step, (4,), J, in the order of ENERGY.

        The arguments are (4,): motor torques, joint efforts, forces of the step, and mean joint
        velocities.
        """
        h = self.h
        work = h * ca.dot(tau, forces.mean)
        undriven = (effort[k] * mean_qd[k] for k in range(4) if k not in self.driven)
        dampers = (
            forces.damper[k] * (forces.mean[k] / self.drive(k).ratio - mean_qd[k])
            for k in self.driven
        )
        locked_work, damping = (h * sum(terms, ca.SX(0)) for terms in (undriven, dampers))
        return ca.vertcat(work, locked_work, forces.loss, damping)

    def _forces(
        self, inputs: tuple[ca.SX, ...], q: ca.SX, motor: ca.SX, qd: ca.SX, w: ca.SX
    ) -> _Forces:
        """Return the efforts in a step, and the motion of the drives that results from them.

        `inputs` are the arguments of the step function. The other arguments describe the middle of
        the step: joint positions, motor angles, joint velocities and motor speeds (4,).
        """
        x, tau, _, blocked, friction = inputs
        load, damper, speed, mean, rest = ([ca.SX(0)] * 4 for _ in range(5))
        loss = ca.SX(0)
        for k in self.driven:
            parameters = friction[k * len(FRICTION) : (k + 1) * len(FRICTION)]
            drive = _with_friction(self.drive(k), parameters)
            twist_start = x[MOTOR][k] / drive.ratio - x[Q][k]
            twist_middle = motor[k] / drive.ratio - q[k]
            stretch, contact = self._mean_stretch(k, twist_start, twist_middle)
            damper[k] = self.compliance.damping[k] * (w[k] / drive.ratio - qd[k]) * contact
            load[k] = self.compliance.stiffness[k] * stretch + damper[k]
            start, rest_time = x[W][k], x[REST][k]
            step = drive_step(drive, start, rest_time, tau[k], load[k], h=self.h, middle=w[k])
            step = stalled(drive, step, blocked[k], w=start, load=load[k], tau=tau[k], h=self.h)
            speed[k], mean[k], rest[k], loss = step.w, step.mean, step.rest, loss + step.loss
        columns = (ca.vertcat(*column) for column in (load, damper, speed, mean, rest))
        return _Forces(*[*columns, loss])

    def _mean_stretch(self, k: int, start: ca.SX, middle: ca.SX) -> tuple[ca.SX, ca.SX | float]:
        """Return the mean deflection of a spring over a step, and the share of the step in contact.

        The twist between drive and joint is linear in time, and `start` and `middle` are its values
        at the start and in the middle of the step. Contact therefore begins and ends at the exact
        position. The mean force times the change of the twist equals the change of the spring's
        energy. This is a discrete gradient (O. Gonzalez, Time Integration and Discrete Hamiltonian
        Systems, J. Nonlinear Sci. 6, 1996).
        """
        if not self.compliance.backlash[k] > 0:
            return middle, 1.0
        end = 2 * middle - start
        stretch_start, stretch_end = (self.compliance.stretch(k, twist) for twist in (start, end))
        constant = ca.fabs(end - start) < STILL
        ratio = (stretch_end - stretch_start) / ca.if_else(constant, 1, end - start)
        contact = ca.if_else(constant, stretch_start != 0, ratio)
        return contact * (stretch_start + stretch_end) / 2, contact

    def friction(self, scale: float = 1.0) -> Array:
        """Return the parameters FRICTION of every joint, one joint after the other, (28,).

        All of them are multiplied by `scale`. Joints without a drive have zeros.
        """
        values = np.zeros((4, len(FRICTION)))
        for k in self.driven:
            friction = friction_of(self.drive(k))
            values[k] = [scale * getattr(friction, name) for name in FRICTION]
        return values.ravel()

    def drive(self, k: int) -> Drive:
        """Return the drive of the joint with index k. Raises GeometryError if it is missing."""
        drive = self.robot.joints[k].drive
        if drive is None:
            raise GeometryError(f"joint {k + 1} has no drive")
        return drive

    def accelerations(self, q: ca.SX, qd: ca.SX, force: ca.SX, locked: ca.SX) -> ca.SX:
        """Return the joint accelerations (4,) as CasADi expressions.

        `force` (4,) is the effort on each joint in the state q, qd (4,). `locked` (4,) contains the
        prescribed accelerations of joints without a drive.
        """
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
    """Replace the parameters FRICTION of a drive by symbols (7,), without checking them."""
    friction, changed = copy.copy(friction_of(drive)), copy.copy(drive)
    for name, value in zip(FRICTION, ca.vertsplit(values), strict=True):
        object.__setattr__(friction, name, value)
    object.__setattr__(changed, "friction", friction)
    return changed
