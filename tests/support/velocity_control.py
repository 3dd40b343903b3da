"""Simulate the whole arm with velocity-controlled motors, as in the experiments of the paper.

Joints without a drive follow their reference exactly. Several steps of the plant per control period, all periods in one
call.
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
"""Control period, s."""

_CHUNK = 100


@dataclass(frozen=True)
class Servo:
    """tau = kp·e + integral, limited to ±limit, with e = w_reference − w and d(integral)/dt = ki·e.

    At the limit the integral does not grow further in the direction that is cut off.
    """

    kp: float
    """N·m·s/rad."""
    ki: float
    """N·m/rad."""
    limit: float
    """Largest torque, N·m: the current limit times the torque constant."""


def servo_step(
    servo: Servo, error: ca.SX, integral: ca.SX, period: float, feedforward: ca.SX | float = 0.0
) -> tuple[ca.SX, ca.SX]:
    """(torque, integral after the period) of a sampled servo, in CasADi."""
    wanted = servo.kp * error + integral + feedforward
    torque = ca.fmin(ca.fmax(wanted, -servo.limit), servo.limit)
    winds = ca.logic_and(torque != wanted, wanted * error > 0)
    return torque, integral + ca.if_else(winds, 0, period * servo.ki * error)


def servo_for(drive: Drive, limit: float, bandwidth: float = 800.0) -> Servo:
    """PI gains for a velocity loop of the given bandwidth (rad/s) on the motor's own inertia, well damped.

    Sampled at 1 kHz, a bandwidth beyond 2000 rad/s is unstable; a slow loop lets a load-driven worm chatter.
    """
    kp = bandwidth * drive.input_inertia
    return Servo(kp, 0.25 * bandwidth * kp, limit)


class ArmSimulation(ArmPlant):
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
        super().__init__(robot, compliance, period / steps)
        self.period, self.steps = period, steps
        self.servos = _default_servos(robot) if servos is None else servos
        self.position_gain = position_gain
        self._run = self._period_function().mapaccum("arm", _CHUNK)

    def run(self, q: Array, qd: Array, feedforward: Array | None = None) -> ArmMotion:
        """Follow a reference given at the control instants, (n, 4) each; feedforward: motor torques (n, 4).

        Starts at q[0] at rest, every drive standing and its spring carrying the weight. Joints without a drive take the
        speeds of qd, linear in between.
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
        """Stay at q (4,) for a time (s): with servos holding it, or without power if there are none."""
        count = round(duration / self.period) + 1
        zero = np.zeros((count, 4))
        return self.run(np.tile(np.asarray(q, dtype=float), (count, 1)), zero)

    def _period_function(self) -> ca.Function:
        """(state, reference) → (state after one control period, motor torques in it)."""
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
            wanted = drive.ratio * qd[k] + self.position_gain * (drive.ratio * q[k] - x[MOTOR][k])
            error = wanted - x[W][k]
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
