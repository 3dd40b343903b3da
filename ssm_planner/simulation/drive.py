"""One step of a simulated drive in CasADi: the servo that commands its torque, and the drive that slides, stops or stands."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from ssm_planner.dynamics.friction import friction_coefficient, friction_of, static_coefficient
from ssm_planner.dynamics.transmission import breakaway_torque, motor_acceleration, moving_torque
from ssm_planner.problem.drive import Drive

NOT_UNIQUE = (
    "the effective inertia with the load driving is negative: a rigid drive has no unique motion"
)


@dataclass(frozen=True)
class DriveStep:
    """After one step: speed, its mean in the step, time at rest, and the energy that friction took in it."""

    w: ca.SX
    mean: ca.SX
    rest: ca.SX
    loss: ca.SX


def drive_step(
    drive: Drive,
    w: ca.SX,
    rest: ca.SX,
    tau: ca.SX,
    load: ca.SX,
    *,
    h: float,
    middle: ca.SX | None = None,
) -> DriveStep:
    """Advance a drive by h (s) under a torque and an effort on its output that are constant over the step.

    w: motor speed; exactly 0 means that the drive stands. rest: time it has stood, s. The step ends at zero speed where
    the sign of w would change: the next one decides whether the drive stays. Speed is linear within a step, so the
    energies of the step (J) are those of its mean speed. middle: speed of the friction, default w; where it is that of the
    step's middle the step is of second order. Frictional memory is left out.
    """
    f, felt = friction_of(drive), w if middle is None else middle
    mu = friction_coefficient(f, felt)
    mu_rest = static_coefficient(f, rest, ca.fmin(friction_coefficient(f, 0.0), f.mu_static))
    forwards, backwards = (breakaway_torque(drive, load, sign, mu_rest) for sign in (1.0, -1.0))
    starts = ca.if_else(tau > forwards, 1, ca.if_else(tau < backwards, -1, 0))
    sign = ca.if_else(w == 0, starts, ca.sign(w))
    wd, effort = motor_acceleration(drive, tau, w=felt, load=load, direction=sign, mu=mu)
    free = w + h * wd
    stops = sign * free <= 0
    after = ca.if_else(ca.logic_or(sign == 0, stops), 0, free)
    # a drive that stops does so before the step ends
    share = ca.if_else(stops, ca.fmin(ca.fmax(-w / ca.if_else(wd == 0, 1, h * wd), 0), 1), 1)
    mean = 0.5 * (w + after) * share
    qd, qdd = mean / drive.ratio, wd / drive.ratio
    sliding = (
        moving_torque(drive, effort, felt, wd, direction=sign, mu=mu) - drive.input_inertia * wd
    )
    # what leaves the drive, and what speeds the output and the second nut up, is not lost
    transmitted = load + (drive.output_inertia + drive.second_nut_mass) * qdd
    slid = h * (sliding * mean - transmitted * qd)
    stopped = h * (tau * mean - load * qd) + 0.5 * moving_inertia(drive) * w**2
    loss = ca.if_else(sign == 0, 0, ca.if_else(stops, stopped, slid))
    return DriveStep(after, mean, ca.if_else(after == 0, rest + h, 0), loss)


def stalled(
    drive: Drive, moved: DriveStep, held: ca.SX, *, w: ca.SX, load: ca.SX, tau: ca.SX, h: float
) -> DriveStep:
    """The step where `held` is 0; where it is 1 something holds the motor fast, and takes its energy."""
    mean = 0.5 * w
    loss = h * (tau * mean - load * mean / drive.ratio) + 0.5 * moving_inertia(drive) * w**2
    return DriveStep(
        w=ca.if_else(held, 0, moved.w),
        mean=ca.if_else(held, mean, moved.mean),
        rest=ca.if_else(held, moved.rest + h, moved.rest),
        loss=ca.if_else(held, loss, moved.loss),
    )


def moving_inertia(drive: Drive) -> float:
    """Inertia of all that moves with the motor, at its shaft, kg·m²."""
    return drive.input_inertia + (drive.output_inertia + drive.second_nut_mass) / drive.ratio**2


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
