"""Model the arm as rigid bodies that self-locking drives move through springs and dampers.

With rigid drives, the motion of the arm would not be unique, because the inertia of the load can
make the effective inertia of a drive negative (dynamics/transmission.py). Joints 1 and 2 of the
published robot are such cases. Every real gearbox has some compliance and backlash at its output.
With compliance, each drive slides under a load that changes smoothly, so the model determines
standstill, breakaway and jamming uniquely. The accelerations of joints without a drive are
prescribed.

The integrator takes midpoint steps in CasADi. It sums up the energies, so that their balance can be
checked.
"""

import math
from collections.abc import Sequence
from dataclasses import field

import casadi as ca
import numpy as np

from ssm_planner.dynamics import RigidBody, required_friction
from ssm_planner.errors import GeometryError
from ssm_planner.problem import Drive, Robot, unchecked_copy
from ssm_planner.simulation.drive import drive_step, with_blocked_motor
from ssm_planner.typing import Array, Keywords, frozen, record

DAMPING_RATIO = 0.3
"""Assumed damping ratio of each joint while its drive is locked."""
JOINT_FREQUENCIES = (30.0, 30.0, 30.0, 100.0)
"""Assumed natural frequencies of the four joints while their drives are locked, Hz."""


@record
class Compliance:
    """Springs, dampers and backlash between the drives and the joints, arrays (4,)."""

    stiffness: Array
    """Stiffness, N·m/rad, and N/m for joint 4."""
    damping: Array
    """Damping, N·m·s/rad, and N·s/m for joint 4."""
    backlash: Array = field(default_factory=lambda: np.zeros(4))
    """Free play from one flank to the other, rad, and m for joint 4."""

    @classmethod
    def from_frequencies(
        cls, body: RigidBody, q: Array, frequency: Sequence[float] = JOINT_FREQUENCIES
    ) -> "Compliance":
        """Compute stiffness and damping from the natural frequencies of the joints.

        The default values and the damping ratio `DAMPING_RATIO` are assumptions, not measurements.

        Parameters
        ----------
        body : RigidBody
            Rigid bodies of the robot.
        q : (4,) array
            Joint positions at which the frequencies apply, rad, and m for joint 4.
        frequency : sequence of four floats
            Natural frequency of each joint while its drive is locked, Hz.

        Returns
        -------
        Compliance
            Springs and dampers without backlash.

        Notes
        -----
        With the inertia J of a joint, its frequency ω in rad/s and the damping ratio ζ, the
        stiffness is J ω² and the damping is 2 ζ J ω.
        """
        inertia = np.diag(body.mass_matrix(np.reshape(q, (1, 4)))[0])
        omega = 2.0 * math.pi * np.asarray(frequency)
        return cls(inertia * omega**2, 2.0 * DAMPING_RATIO * inertia * omega)

    def deflection(self, k: int, twist: ca.SX | Array) -> ca.SX | Array:
        """Compute the deflection of the spring of a joint.

        The spring deflects by the part of the twist that exceeds half the backlash. Within the
        backlash, the deflection is 0.

        Parameters
        ----------
        k : int
            Index of the joint, from 0.
        twist : array or expression
            Position of the drive's output minus position of the joint, rad or m.

        Returns
        -------
        array or expression
            Deflection in the shape of `twist`, rad or m.
        """
        half_backlash = 0.5 * float(self.backlash[k])
        if half_backlash == 0.0:
            return twist
        xp = ca if isinstance(twist, ca.SX) else np
        return twist - xp.fmin(xp.fmax(twist, -half_backlash), half_backlash)


FRICTION_PARAMETERS = ("mu", "mu_static", "mu_stribeck", "b_c", "b_v", "b_oc", "b_ov")
"""Names of the friction parameters that are inputs of the step function."""

Q, QD, MOTOR, W, INTEGRAL, REST, ENERGY = (slice(4 * k, 4 * k + 4) for k in range(7))
"""Slices of the state of the arm, an array of 28 numbers. Each slice has four entries.

The first six slices have one entry for each joint: joint positions (rad, m), joint velocities
(rad/s, m/s), motor angles (rad), motor speeds (rad/s), integral terms of the controllers (A), and
times since the drives stopped (s). The last slice contains energies (J) since the start: the work
of the motors, the work of prescribed accelerations, and the losses in the friction and in the
dampers.
"""
STATE_SIZE = 28
"""Number of entries of a state of the arm."""
CONSTANT_TWIST = 1e-12
"""Change of the twist in a step below which the twist counts as constant, rad or m.

The twist is the position of the drive's output minus the position of the joint.
"""
FORCE_CORRECTIONS = 2
"""Number of times that the forces of a step are corrected for the resulting speeds.

Each correction reduces the error of the energy balance to a tenth.
"""


@frozen
class _Forces:
    """Efforts on the joints in a step, and the resulting motion of the drives.

    The fields are CasADi expressions with one entry for each joint.
    """

    load: ca.SX
    """Effort of spring and damper on each joint, N·m or N."""
    damper: ca.SX
    """Effort of the damper alone on each joint, N·m or N."""
    w: ca.SX
    """Motor speeds after the step, rad/s."""
    mean: ca.SX
    """Mean motor speeds in the step, rad/s."""
    rest_time: ca.SX
    """Times at rest after the step, s."""
    loss: ca.SX
    """Energy that friction dissipates in all drives, J, (1,)."""


class ArmPlant:
    """Simulation model of an arm whose inputs are the motor torques.

    Parameters
    ----------
    robot : Robot
        Robot with its drives.
    compliance : Compliance or None
        Springs, dampers and backlash. None means the assumed values of
        `Compliance.from_frequencies`.
    h : float
        Duration of a time step, s.
    """

    def __init__(self, robot: Robot, compliance: Compliance | None, h: float) -> None:
        self.robot = robot
        self.h = h
        self.body = RigidBody.from_robot(robot)
        self.compliance = compliance or Compliance.from_frequencies(self.body, np.zeros(4))
        self.driven = tuple(k for k, joint in enumerate(robot.joints) if joint.drive is not None)

    def state_at_rest(self, q: Array) -> Array:
        """Return the state of the arm at rest at given joint positions.

        The springs are deflected such that they carry the weight.

        Parameters
        ----------
        q : (4,) array
            Joint positions, rad, and m for joint 4.

        Returns
        -------
        (28,) array
            State with the slices `Q` to `ENERGY`.
        """
        return self.state_in_motion(q, np.zeros(4), np.zeros(4))

    def state_in_motion(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Return the state of an arm that already moves.

        The springs are deflected such that they transmit the efforts of the motion: the output of
        each drive is ahead of its joint by effort / stiffness plus half the backlash.

        Parameters
        ----------
        q, qd, qdd : (4,) arrays
            Joint positions, velocities and accelerations in rad, rad/s and rad/s² (joint 4: m, m/s
            and m/s²).

        Returns
        -------
        (28,) array
            State with the slices `Q` to `ENERGY`.
        """
        effort = self.body.inverse_dynamics(q[None], qd[None], qdd[None])[0]
        state = np.zeros(STATE_SIZE)
        state[Q] = q
        state[QD] = qd
        for k in self.driven:
            backlash = 0.5 * self.compliance.backlash[k] * np.sign(effort[k])
            twist = effort[k] / self.compliance.stiffness[k] + backlash
            state[MOTOR][k] = self.drive(k).ratio * (q[k] + twist)
            state[W][k] = self.drive(k).ratio * qd[k]
        # A drive at rest has rested long enough for its static friction to be fully developed.
        state[REST] = np.where(state[W] == 0.0, 1e6, 0.0)
        return state

    def step_function(self) -> ca.Function:
        """Build the CasADi function that advances the arm by one step of the midpoint rule.

        The forces at the start of the step give the positions and speeds in its middle, and these
        give the forces of the step. The forces are then corrected `FORCE_CORRECTIONS` times for the
        speeds that result from them. Inertia and weight are evaluated once, at the first estimate
        of the middle.

        Returns
        -------
        casadi.Function
            It returns the state after the step (28,), for these arguments:

            x : (28,)
                State before the step, with the slices `Q` to `ENERGY`.
            tau : (4,)
                Motor torques, N·m.
            locked : (4,)
                Prescribed accelerations of joints without a drive, rad/s² or m/s².
            blocked : (4,)
                1 for a blocked motor, otherwise 0.
            friction : (28,)
                Friction parameters in the layout of `ArmPlant.friction_parameters`.
        """
        h = self.h
        half = 0.5 * h
        x = ca.SX.sym("x", STATE_SIZE)
        tau = ca.SX.sym("tau", 4)
        locked = ca.SX.sym("locked", 4)
        blocked = ca.SX.sym("blocked", 4)
        friction = ca.SX.sym("friction", 4 * len(FRICTION_PARAMETERS))
        inputs = (x, tau, locked, blocked, friction)
        q = x[Q]
        qd = x[QD]
        w = x[W]
        motor = x[MOTOR]
        predictor = self._forces(inputs, q + half * qd, motor + half * w, qd, w)
        middle_qd = qd + half * self.accelerations(q + half * qd, qd, predictor.load, locked)
        middle_w = predictor.mean
        middle_q = q + half * middle_qd
        middle_motor = motor + half * middle_w
        forces = self._forces(inputs, middle_q, middle_motor, middle_qd, middle_w)
        qdd = self.accelerations(middle_q, middle_qd, forces.load, locked)
        for _ in range(FORCE_CORRECTIONS):
            mean_qd = qd + half * qdd
            mean_w = forces.mean
            mean_q = q + half * mean_qd
            mean_motor = motor + half * mean_w
            forces = self._forces(inputs, mean_q, mean_motor, mean_qd, mean_w)
            qdd = self.accelerations(middle_q, middle_qd, forces.load, locked)
        qd_after = qd + h * qdd
        mean_qd = 0.5 * (qd + qd_after)
        effort = self.body.symbolic(middle_q, middle_qd, qdd)
        state_after = ca.vertcat(
            q + h * mean_qd,
            qd_after,
            motor + h * forces.mean,
            forces.w,
            x[INTEGRAL],
            forces.rest_time,
            x[ENERGY] + self._energies(tau, effort, forces, mean_qd),
        )
        return ca.Function("step", list(inputs), [state_after], {"cse": True})

    def _energies(self, tau: ca.SX, effort: ca.SX, forces: _Forces, mean_qd: ca.SX) -> ca.SX:
        """Build the expressions of the energies that a step adds to the state.

        Parameters
        ----------
        tau : (4,)
            Motor torques, N·m.
        effort : (4,)
            Efforts that move the joints, N·m or N.
        forces : _Forces
            Efforts and motion of the drives in the step.
        mean_qd : (4,)
            Mean joint velocities in the step, rad/s, and m/s for joint 4.

        Returns
        -------
        (4,) expression
            Work of the motors, work of prescribed accelerations, loss in the friction, and loss in
            the dampers, J.
        """
        motor_power = ca.dot(tau, forces.mean)
        prescribed_power = ca.SX(0)
        damper_power = ca.SX(0)
        for k in range(4):
            if k in self.driven:
                output_speed = forces.mean[k] / self.drive(k).ratio
                damper_power += forces.damper[k] * (output_speed - mean_qd[k])
            else:
                prescribed_power += effort[k] * mean_qd[k]
        h = self.h
        return ca.vertcat(h * motor_power, h * prescribed_power, forces.loss, h * damper_power)

    def _forces(
        self, inputs: tuple[ca.SX, ...], q: ca.SX, motor: ca.SX, qd: ca.SX, w: ca.SX
    ) -> _Forces:
        """Compute the efforts on the joints in a step, and the resulting motion of the drives.

        Parameters
        ----------
        inputs : tuple
            Arguments of the function that `step_function` builds.
        q, motor : (4,)
            Joint positions (rad, m) and motor angles (rad) in the middle of the step.
        qd, w : (4,)
            Joint velocities (rad/s, m/s) and motor speeds (rad/s) in the middle of the step.

        Returns
        -------
        _Forces
            Efforts of springs and dampers, motor speeds after and within the step, times at rest,
            and the loss in the friction.
        """
        x, tau, _, blocked, friction = inputs
        load = ca.SX.zeros(4)
        damper = ca.SX.zeros(4)
        speed = ca.SX.zeros(4)
        mean = ca.SX.zeros(4)
        rest_time = ca.SX.zeros(4)
        loss = ca.SX(0)
        for k in self.driven:
            parameters = friction[k * len(FRICTION_PARAMETERS) : (k + 1) * len(FRICTION_PARAMETERS)]
            drive = _with_friction(self.drive(k), parameters)
            twist_start = x[MOTOR][k] / drive.ratio - x[Q][k]
            twist_middle = motor[k] / drive.ratio - q[k]
            deflection, contact = self._mean_deflection(k, twist_start, twist_middle)
            damper[k] = self.compliance.damping[k] * (w[k] / drive.ratio - qd[k]) * contact
            load[k] = self.compliance.stiffness[k] * deflection + damper[k]
            start = x[W][k]
            step = drive_step(drive, start, x[REST][k], tau[k], load[k], h=self.h, middle=w[k])
            step = with_blocked_motor(
                drive, step, blocked[k], w=start, load=load[k], tau=tau[k], h=self.h
            )
            speed[k] = step.w
            mean[k] = step.mean
            rest_time[k] = step.rest_time
            loss += step.loss
        return _Forces(load, damper, speed, mean, rest_time=rest_time, loss=loss)

    def _mean_deflection(self, k: int, start: ca.SX, middle: ca.SX) -> tuple[ca.SX, ca.SX | float]:
        """Return the mean deflection of a spring over a step, and the fraction of contact.

        The spring deflects only while the flanks of drive and joint are in contact, that is, while
        the twist exceeds half the backlash. The twist is the position of the drive's output minus
        that of the joint. It is linear in time within the step. With the twist θ and the deflection
        δ(θ) at the start (0) and at the end (1) of the step, the fraction of contact is

            c = (δ(θ₁) − δ(θ₀)) / (θ₁ − θ₀)

        and the mean deflection is c · (δ(θ₀) + δ(θ₁)) / 2. The mean force times the change of the
        twist then equals the change of the spring's energy, which makes this a discrete gradient
        (O. Gonzalez, Time Integration and Discrete Hamiltonian Systems, J. Nonlinear Sci. 6, 1996).

        Parameters
        ----------
        k : int
            Index of the joint, from 0.
        start, middle : expression
            Twist at the start and in the middle of the step, rad or m.

        Returns
        -------
        deflection : expression
            Mean deflection, rad or m. Without backlash, it is the twist in the middle of the step.
        contact : expression or float
            Fraction of contact, from 0 to 1. Without backlash, it is 1.
        """
        if not self.compliance.backlash[k] > 0:
            return middle, 1.0
        end = 2 * middle - start
        stretch_start = self.compliance.deflection(k, start)
        stretch_end = self.compliance.deflection(k, end)
        constant = ca.fabs(end - start) < CONSTANT_TWIST
        ratio = (stretch_end - stretch_start) / ca.if_else(constant, 1, end - start)
        contact = ca.if_else(constant, stretch_start != 0, ratio)
        return contact * (stretch_start + stretch_end) / 2, contact

    def friction_parameters(self, scale: float = 1.0) -> Array:
        """Return the friction parameters of all joints in the order that the step function expects.

        Parameters
        ----------
        scale : float
            Factor on all parameters.

        Returns
        -------
        (28,) array
            The seven parameters `FRICTION_PARAMETERS` of joint 1, then those of joint 2, and so on.
            Joints without a drive have zeros.
        """
        values = np.zeros((4, len(FRICTION_PARAMETERS)))
        for k in self.driven:
            friction = required_friction(self.drive(k))
            values[k] = [scale * getattr(friction, name) for name in FRICTION_PARAMETERS]
        return values.ravel()

    def drive(self, k: int) -> Drive:
        """Return the drive of a joint.

        Parameters
        ----------
        k : int
            Index of the joint, from 0.

        Returns
        -------
        Drive
            The drive.

        Raises
        ------
        GeometryError
            If the joint has no drive.
        """
        drive = self.robot.joints[k].drive
        if drive is None:
            raise GeometryError(f"joint {k + 1} has no drive")
        return drive

    def accelerations(self, q: ca.SX, qd: ca.SX, force: ca.SX, locked: ca.SX) -> ca.SX:
        """Compute the joint accelerations from the efforts of the springs and dampers, in CasADi.

        The accelerations q̈_p of joints without a drive are prescribed. Those of the joints with a
        drive, q̈_d, follow from the equations of motion M_dd · q̈_d + b = force. M_dd contains the
        rows and columns of the mass matrix for the joints with a drive. The efforts b are those of
        the motion with q̈_d = 0 and the prescribed q̈_p. They contain the weight.

        Parameters
        ----------
        q, qd : (4,)
            Joint positions and velocities.
        force : (4,)
            Efforts of the springs and dampers on the joints, N·m or N.
        locked : (4,)
            Prescribed accelerations of joints without a drive, rad/s² or m/s².

        Returns
        -------
        (4,) expression
            Accelerations of all joints, rad/s² or m/s².
        """
        free = list(self.driven)
        # The effort is linear in the accelerations, so its derivative is the mass matrix.
        probe = ca.SX.sym("qdd", 4)
        effort = self.body.symbolic(q, qd, probe)
        mass = ca.densify(ca.jacobian(effort, probe))
        prescribed = ca.SX.zeros(4)
        for k in set(range(4)) - set(free):
            prescribed[k] = locked[k]
        bias = ca.substitute(effort, probe, prescribed)
        solved = ca.ldl_solve(force[free] - bias[free], *ca.ldl(mass[free, free]))
        qdd = ca.SX(prescribed)
        for row, k in enumerate(free):
            qdd[k] = solved[row]
        return qdd


def _with_friction(drive: Drive, values: ca.SX) -> Drive:
    """Return a copy of a drive whose friction parameters are CasADi symbols.

    The constructor of `Drive` would refuse symbols, so the values of the copy are not checked.

    Parameters
    ----------
    drive : Drive
        The drive.
    values : (7,)
        Symbols for the parameters in the order of `FRICTION_PARAMETERS`.

    Returns
    -------
    Drive
        The copy.
    """
    parameters: Keywords = dict(zip(FRICTION_PARAMETERS, ca.vertsplit(values), strict=True))
    return unchecked_copy(drive, friction=unchecked_copy(required_friction(drive), **parameters))
