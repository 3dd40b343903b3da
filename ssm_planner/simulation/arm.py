"""Forward simulation of the whole arm: rigid bodies, self-locking drives, velocity-controlled motors.

Each drive carries its joint through a spring and a damper. With rigid drives the arm would have no unique motion
wherever a load's inertia makes a drive's effective inertia negative (dynamics/forward.py), which is so at joints 1 and
2 of the published robot; with some compliance at the output, as every gearbox has, every drive is a sliding mesh of its
own under a smooth load, and standstill, breakaway and jamming are exact at each of them. Joints without a drive follow
their reference exactly.

Leapfrog steps in CasADi, several per control period, all periods in one call. The energies that went where are kept, so
that a motion can be held against their balance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ssm_planner.dynamics.forward import always_unique
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.errors import GeometryError
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.robot import Robot
from ssm_planner.simulation.drive import NOT_UNIQUE, Servo, drive_step, moving_inertia, servo_for, servo_step
from ssm_planner.typing import Array


@dataclass(frozen=True, eq=False)
class Compliance:
    """Spring and damper between each drive and its joint, (4,): N·m/rad and N·m·s/rad, N/m and N·s/m for joint 4."""

    stiffness: Array
    damping: Array

    @classmethod
    def of_frequency(
        cls,
        body: RigidBody,
        q: Array,
        frequency: tuple[float, float, float, float] = (30.0, 30.0, 30.0, 100.0),
        damping_ratio: float = 0.3,
    ) -> Compliance:
        """Stiffness from the natural frequency (Hz) of each joint with its drive locked, at q (4,).

        The default figures are assumptions, not measurements.
        """
        inertia = np.diag(body.mass_matrix(np.reshape(q, (1, 4)))[0])
        omega = 2.0 * math.pi * np.asarray(frequency)
        return cls(inertia * omega**2, 2.0 * damping_ratio * inertia * omega)


@dataclass(frozen=True, eq=False)
class ArmMotion:
    """A simulated motion at the control instants: arrays (n,) and (n, 4), SI; motor columns are NaN without a drive."""

    time: Array
    q: Array
    qd: Array
    motor_angle: Array
    w: Array
    tau: Array
    """Motor torque during the period that begins at each instant."""
    work: Array
    """Energy put in by the motors, and by what moves the joints without a drive, since the start, J."""
    friction_loss: Array
    damping_loss: Array
    kinetic: Array
    potential: Array
    """Of gravity and of the springs, J."""
    status: str
    """`done`, or what makes the motion worthless."""

    @property
    def energy_error(self) -> float:
        """Largest |work − (kinetic + potential + dissipated)| over the largest of these."""
        stored = self.kinetic + self.potential
        lost = self.friction_loss + self.damping_loss
        error = self.work - (stored - stored[0]) - lost
        scale = max(float(np.abs(x).max()) for x in (self.work, lost, stored - stored[0]))
        return float(np.abs(error).max() / scale) if scale > 1e-12 else 0.0


PERIOD = 1e-3
"""Control period, s."""

_CHUNK = 100
_Q, _QD, _MOTOR, _W, _INTEGRAL, _REST, _ENERGY = (slice(4 * k, 4 * k + 4) for k in range(7))
_STATE = 28
_WORK, _LOCKED_WORK, _FRICTION, _DAMPING = range(4)


class ArmSimulation:
    """The arm of a robot with its servos; built once, run on any number of references."""

    def __init__(
        self,
        robot: Robot,
        *,
        servos: tuple[Servo | None, ...] | None = None,
        compliance: Compliance | None = None,
        position_gain: float = 0.0,
        period: float = PERIOD,
        steps: int = 2,
    ) -> None:
        """servos: one per joint, None for a motor without power; default one per driven joint, limited to the motor's
        largest torque. position_gain: of an outer position loop on the motor angle, 1/s. steps: per control period.
        """
        self.robot, self.period, self.steps = robot, period, steps
        self.body = RigidBody.from_robot(robot)
        self.servos = _default_servos(robot) if servos is None else servos
        self.compliance = compliance or Compliance.of_frequency(self.body, np.zeros(4))
        self.position_gain = position_gain
        self.driven = tuple(k for k, joint in enumerate(robot.joints) if joint.drive is not None)
        self._run = self._period_function().mapaccum("arm", _CHUNK)

    def run(self, q: Array, qd: Array, feedforward: Array | None = None) -> ArmMotion:
        """Follow a reference given at the control instants, (n, 4) each; feedforward: motor torques (n, 4).

        Starts at q[0] at rest, every drive standing and its spring carrying the weight. Joints without a drive take the
        speeds of qd, linear in between.
        """
        columns = [
            np.asarray(c, dtype=float) for c in (q, qd, np.zeros_like(q) if feedforward is None else feedforward)
        ]
        shapes = [c.shape for c in columns]
        if len(set(shapes)) > 1 or len(shapes[0]) != 2 or shapes[0][1] != 4 or not shapes[0][0]:
            raise GeometryError(f"references must be (n, 4) arrays of one length, not {shapes}")
        reference = np.hstack([*columns, np.diff(columns[1], axis=0, append=columns[1][-1:]) / self.period])
        states, torques = [self.at_rest(q[0])[:, None]], []
        padded = np.vstack([reference, np.repeat(reference[-1:], -len(reference) % _CHUNK, axis=0)])
        for first in range(0, len(padded), _CHUNK):
            after, tau = self._run(states[-1][:, -1], padded[first : first + _CHUNK].T)
            states.append(after.full())
            torques.append(tau.full())
        state = np.hstack(states)[:, : len(q)].T
        time = self.period * np.arange(len(state), dtype=float)
        return self.motion(time, state, np.hstack(torques)[:, : len(q)].T)

    def hold(self, q: Array, duration: float) -> ArmMotion:
        """Stay at q (4,) for a time (s): with servos holding it, or without power if there are none."""
        count = round(duration / self.period) + 1
        zero = np.zeros((count, 4))
        return self.run(np.tile(np.asarray(q, dtype=float), (count, 1)), zero)

    def at_rest(self, q: Array) -> Array:
        """State (28,) at q (4,) with every drive standing and its spring carrying the weight."""
        weight = self.body.gravity_load(np.reshape(q, (1, 4)))[0]
        state = np.zeros(_STATE)
        state[_Q] = q
        for k in self.driven:
            state[_MOTOR][k] = self.drive(k).ratio * (q[k] + weight[k] / self.compliance.stiffness[k])
        state[_REST] = 1e6
        return state

    def motion(self, time: Array, x: Array, tau: Array) -> ArmMotion:
        """States (n, 28) at times (n,) as a result, energies computed."""
        driven = list(self.driven)
        kinetic, potential = self.body.energy(x[:, _Q], x[:, _QD])
        for k in driven:
            drive = self.drive(k)
            motor, w = x[:, _MOTOR][:, k], x[:, _W][:, k]
            kinetic = kinetic + 0.5 * moving_inertia(drive) * w**2
            potential = potential + 0.5 * self.compliance.stiffness[k] * (motor / drive.ratio - x[:, k]) ** 2
        energy = x[:, _ENERGY]
        columns = {name: np.full((len(x), 4), np.nan) for name in ("motor", "w", "tau")}
        for name, values in (("motor", x[:, _MOTOR]), ("w", x[:, _W]), ("tau", tau)):
            columns[name][:, driven] = values[:, driven]
        return ArmMotion(
            time=time,
            q=x[:, _Q],
            qd=x[:, _QD],
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

    def _period_function(self) -> ca.Function:
        """(state, reference) → (state after one control period, motor torques in it)."""
        x, u = ca.SX.sym("x", _STATE), ca.SX.sym("u", 16)
        tau, integral = self._control(x, u[:4], u[4:8], u[8:12])
        y = ca.vertcat(x[: _INTEGRAL.start], integral, x[_REST], x[_ENERGY])
        step = self._step_function()
        for _ in range(self.steps):
            y = step(y, tau, u[12:16])
        return ca.Function("period", [x, u], [y, tau], {"cse": True})

    def _control(self, x: ca.SX, q: ca.SX, qd: ca.SX, feedforward: ca.SX) -> tuple[ca.SX, ca.SX]:
        torques, integrals = [ca.SX(0)] * 4, [ca.SX(0)] * 4
        for k in self.driven:
            servo, drive = self.servos[k], self.drive(k)
            if servo is None:
                continue
            wanted = drive.ratio * qd[k] + self.position_gain * (drive.ratio * q[k] - x[_MOTOR][k])
            error = wanted - x[_W][k]
            torques[k], integrals[k] = servo_step(servo, error, x[_INTEGRAL][k], self.period, feedforward[k])
        return ca.vertcat(*torques), ca.vertcat(*integrals)

    def _step_function(self) -> ca.Function:
        """One leapfrog step: positions to the middle, forces there, speeds over the whole step, positions to the end."""
        h = self.period / self.steps
        x, tau, locked = ca.SX.sym("x", _STATE), ca.SX.sym("tau", 4), ca.SX.sym("locked", 4)
        q, qd, w = x[_Q] + 0.5 * h * x[_QD], x[_QD], x[_W]
        motor = x[_MOTOR] + 0.5 * h * w
        spring, damper, drives = [ca.SX(0)] * 4, [ca.SX(0)] * 4, {}
        for k in self.driven:
            drive = self.drive(k)
            spring[k] = self.compliance.stiffness[k] * (motor[k] / drive.ratio - q[k])
            damper[k] = self.compliance.damping[k] * (w[k] / drive.ratio - qd[k])
            drives[k] = drive_step(drive, w[k], x[_REST][k], tau[k], spring[k] + damper[k], h=h)
        qdd = self.accelerations(q, qd, ca.vertcat(*spring) + ca.vertcat(*damper), locked)
        qd_after = qd + h * qdd
        w_after = ca.vertcat(*(drives[k].w if k in drives else 0 for k in range(4)))
        rest = ca.vertcat(*(drives[k].rest if k in drives else 0 for k in range(4)))
        mean_qd, mean_w = 0.5 * (qd + qd_after), 0.5 * (w + w_after)
        effort = self.body.symbolic(q, qd, qdd)
        work = h * ca.dot(tau, mean_w)
        locked_work = h * sum((effort[k] * mean_qd[k] for k in range(4) if k not in drives), ca.SX(0))
        friction = sum((d.loss for d in drives.values()), ca.SX(0))
        stretch = [damper[k] * (mean_w[k] / self.drive(k).ratio - mean_qd[k]) for k in self.driven]
        energy = x[_ENERGY] + ca.vertcat(work, locked_work, friction, h * sum(stretch, ca.SX(0)))
        q_after, motor_after = q + 0.5 * h * qd_after, motor + 0.5 * h * w_after
        y = ca.vertcat(q_after, qd_after, motor_after, w_after, x[_INTEGRAL], rest, energy)
        return ca.Function("step", [x, tau, locked], [y], {"cse": True})

    def drive(self, k: int) -> Drive:
        """The drive of joint k, counted from 0."""
        drive = self.robot.joints[k].drive
        if drive is None:
            raise GeometryError(f"joint {k + 1} has no drive")
        return drive

    def accelerations(self, q: ca.SX, qd: ca.SX, force: ca.SX, locked: ca.SX) -> ca.SX:
        """Accelerations of the driven joints under the spring forces, the locked ones as given."""
        free = list(self.driven)
        held = [k for k in range(4) if k not in free]
        probe = ca.SX.sym("qdd", 4)
        effort = self.body.symbolic(q, qd, probe)
        mass = ca.densify(ca.jacobian(effort, probe))
        given = ca.SX.zeros(4)
        for k in held:
            given[k] = locked[k]
        bias = ca.substitute(effort, probe, given)
        solved = ca.ldl_solve(force[free] - bias[free], *ca.ldl(mass[free, free]))
        qdd = ca.SX(given)
        for place, k in enumerate(free):
            qdd[k] = solved[place]
        return qdd


def _default_servos(robot: Robot) -> tuple[Servo | None, ...]:
    servos: list[Servo | None] = []
    for joint in robot.joints:
        if joint.drive is None or joint.motor is None:
            servos.append(None)
        else:
            servos.append(servo_for(joint.drive, joint.motor.max_torque))
    return tuple(servos)
