"""Simulation of the whole arm with velocity-controlled motors, as in the experiments of the paper.

Joints without a drive follow their reference exactly. Every control period has several steps of the
plant. One call runs all periods.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ssm_planner.errors import GeometryError
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.robot import Robot
from ssm_planner.simulation.plant import (
    ENERGY,
    INTEGRAL,
    MOTOR,
    REST,
    STATE_SIZE,
    ArmPlant,
    Compliance,
    W,
)
from ssm_planner.typing import Array
from tests.support.arm_motion import ArmMotion, arm_motion

PERIOD = 1e-3
"""Control period in s."""

_CHUNK = 100


@dataclass(frozen=True)
class Servo:
    """Gains of a servo with tau = kp·e + integral, limited to ±limit.

    The error is e = w_reference − w, and d(integral)/dt = ki·e. At the limit the integral does not
    grow in the direction that is cut off.
    """

    kp: float
    """Proportional gain in N·m·s/rad."""
    ki: float
    """Integral gain in N·m/rad."""
    limit: float
    """Largest torque in N·m: the current limit times the torque constant."""


def servo_step(
    servo: Servo, error: ca.SX, integral: ca.SX, period: float, feedforward: ca.SX | float = 0.0
) -> tuple[ca.SX, ca.SX]:
    """Return the torque, and the integral after the period, of a sampled servo in CasADi."""
    expected = servo.kp * error + integral + feedforward
    torque = ca.fmin(ca.fmax(expected, -servo.limit), servo.limit)
    winds = ca.logic_and(torque != expected, expected * error > 0)
    return torque, integral + ca.if_else(winds, 0, period * servo.ki * error)


def servo_for(drive: Drive, limit: float, bandwidth: float = 800.0) -> Servo:
    """Return well-damped PI gains of a velocity loop on the inertia of the motor.

    `bandwidth` is in rad/s. At a sampling rate of 1 kHz, a bandwidth above 2000 rad/s is unstable.
    A slow loop lets a load-driven worm chatter.
    """
    kp = bandwidth * drive.input_inertia
    return Servo(kp, 0.25 * bandwidth * kp, limit)


class ArmSimulation(ArmPlant):
    """The arm of a robot with its servos. One instance can follow any number of references."""

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
        """Build the simulation.

        `servos` holds one servo per joint, or None for a motor without power. By default every
        driven joint has a servo that is limited to the largest torque of its motor. `position_gain`
        in 1/s belongs to an outer position loop on the motor angle. `steps` is the number of steps
        per control period.
        """
        super().__init__(robot, compliance, period / steps)
        self.period, self.steps = period, steps
        self.servos = _default_servos(robot) if servos is None else servos
        self.position_gain = position_gain
        self._run = self._period_function().mapaccum("arm", _CHUNK)

    def run(self, q: Array, qd: Array, feedforward: Array | None = None) -> ArmMotion:
        """Follow a reference with positions and speeds (n, 4) at the control instants.

        `feedforward` holds motor torques (n, 4). The arm starts at rest at q[0]. Every drive stands
        still, and its spring carries the weight. Joints without a drive follow the speeds qd, with
        linear interpolation.
        """
        columns = [
            np.asarray(c, dtype=float)
            for c in (q, qd, np.zeros_like(q) if feedforward is None else feedforward)
        ]
        shapes = [c.shape for c in columns]
        if len(set(shapes)) > 1 or len(shapes[0]) != 2 or shapes[0][1] != 4 or not shapes[0][0]:
            raise GeometryError(f"references must be (n, 4) arrays of one length, not {shapes}")
        reference = np.hstack(
            [*columns, np.diff(columns[1], axis=0, append=columns[1][-1:]) / self.period]
        )
        states, torques = [self.state_at_rest(q[0])[:, None]], []
        padded = np.vstack([reference, np.repeat(reference[-1:], -len(reference) % _CHUNK, axis=0)])
        for first in range(0, len(padded), _CHUNK):
            after, tau = self._run(states[-1][:, -1], padded[first : first + _CHUNK].T)
            states.append(after.full())
            torques.append(tau.full())
        state = np.hstack(states)[:, : len(q)].T
        time = self.period * np.arange(len(state), dtype=float)
        return arm_motion(self, time, state, np.hstack(torques)[:, : len(q)].T)

    def hold(self, q: Array, duration: float) -> ArmMotion:
        """Stay at q (4,) for a time in s.

        Servos hold the position. Without servos the motors have no power.
        """
        count = round(duration / self.period) + 1
        zero = np.zeros((count, 4))
        return self.run(np.tile(np.asarray(q, dtype=float), (count, 1)), zero)

    def _period_function(self) -> ca.Function:
        """Return the function of one control period.

        It maps the state and the reference to the state after the period and the motor torques in
        it.
        """
        x, u = ca.SX.sym("x", STATE_SIZE), ca.SX.sym("u", 16)
        tau, integral = self._control(x, u[:4], u[4:8], u[8:12])
        y = ca.vertcat(x[: INTEGRAL.start], integral, x[REST], x[ENERGY])
        step, friction = self.step_function(), self.friction_parameters()
        for _ in range(self.steps):
            y = step(y, tau, u[12:16], 0, friction)
        return ca.Function("period", [x, u], [y, tau], {"cse": True})

    def _control(self, x: ca.SX, q: ca.SX, qd: ca.SX, feedforward: ca.SX) -> tuple[ca.SX, ca.SX]:
        torques, integrals = [ca.SX(0)] * 4, [ca.SX(0)] * 4
        for k in self.driven:
            servo, drive = self.servos[k], self.drive(k)
            if servo is None:
                continue
            expected = drive.ratio * qd[k] + self.position_gain * (drive.ratio * q[k] - x[MOTOR][k])
            error = expected - x[W][k]
            torques[k], integrals[k] = servo_step(
                servo, error, x[INTEGRAL][k], self.period, feedforward[k]
            )
        return ca.vertcat(*torques), ca.vertcat(*integrals)


def _default_servos(robot: Robot) -> tuple[Servo | None, ...]:
    servos: list[Servo | None] = []
    for joint in robot.joints:
        if joint.drive is None or joint.motor is None:
            servos.append(None)
        else:
            servos.append(servo_for(joint.drive, joint.motor.max_torque))
    return tuple(servos)
