"""Advance a simulated drive that slides, stops or stands by one step, in CasADi."""

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
    """State after one step: speed, mean speed in the step, time at rest, and friction loss."""

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
    """Advance a drive by one step under a constant torque and a constant effort on its output.

    The step ends at zero speed if the sign of the speed would change. The next step then decides
    whether the drive stays at rest. Speed is linear within a step, so the energies of the step
    follow from its mean speed. Frictional memory is not modelled.

    Parameters
    ----------
    drive
        The drive.
    w
        Motor speed, rad/s. Exactly 0 means that the drive stands still.
    rest
        Time since the drive stopped, s.
    tau
        Motor torque, N·m.
    load
        Effort on the output, N·m or N.
    h
        Duration of the step, s.
    middle
        Speed at which friction is evaluated. The default is `w`. With the speed in the middle of
        the step, the step is of second order.

    Returns
    -------
    DriveStep
        State after the step.
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
    # A drive that stops does so before the step ends.
    share = ca.if_else(stops, ca.fmin(ca.fmax(-w / ca.if_else(wd == 0, 1, h * wd), 0), 1), 1)
    mean = 0.5 * (w + after) * share
    qd, qdd = mean / drive.ratio, wd / drive.ratio
    sliding = (
        moving_torque(drive, effort, felt, wd, direction=sign, mu=mu) - drive.input_inertia * wd
    )
    # The energy that leaves the drive or accelerates the output and the second nut is not lost.
    transmitted = load + (drive.output_inertia + drive.second_nut_mass) * qdd
    slid = h * (sliding * mean - transmitted * qd)
    stopped = h * (tau * mean - load * qd) + 0.5 * moving_inertia(drive) * w**2
    loss = ca.if_else(sign == 0, 0, ca.if_else(stops, stopped, slid))
    return DriveStep(after, mean, ca.if_else(after == 0, rest + h, 0), loss)


def stalled(
    drive: Drive, step: DriveStep, blocked: ca.SX, *, w: ca.SX, load: ca.SX, tau: ca.SX, h: float
) -> DriveStep:
    """Select the step for a motor that is blocked (`blocked` is 1) or free (`blocked` is 0).

    The blocking body takes the energy of the motor.
    """
    mean = 0.5 * w
    loss = h * (tau * mean - load * mean / drive.ratio) + 0.5 * moving_inertia(drive) * w**2
    return DriveStep(
        w=ca.if_else(blocked, 0, step.w),
        mean=ca.if_else(blocked, mean, step.mean),
        rest=ca.if_else(blocked, step.rest + h, step.rest),
        loss=ca.if_else(blocked, loss, step.loss),
    )


def moving_inertia(drive: Drive) -> float:
    """Return the inertia (kg·m²) of all parts that move with the motor, at its shaft."""
    return drive.input_inertia + (drive.output_inertia + drive.second_nut_mass) / drive.ratio**2
