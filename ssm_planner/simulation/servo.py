"""A velocity-controlled motor as in the experiments: PI controller, current limit, no winding up."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from ssm_planner.problem.drive import Drive


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
