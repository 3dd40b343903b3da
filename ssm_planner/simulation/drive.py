"""Advance a simulated drive by one time step, in CasADi.

A drive slides, or comes to a stop within the step, or rests (stiction). These are the three modes
of Coulomb friction.
"""

import casadi as ca

from ssm_planner.dynamics import (
    breakaway_torque,
    friction_coefficient,
    friction_of,
    motor_acceleration,
    moving_torque,
    static_coefficient,
)
from ssm_planner.problem import Drive
from ssm_planner.typing import frozen


@frozen
class DriveStep:
    """State of a drive after one step, as CasADi expressions."""

    w: ca.SX
    """Motor speed, rad/s."""
    mean: ca.SX
    """Mean motor speed in the step, rad/s."""
    rest_time: ca.SX
    """Time since the drive stopped, s. 0 while it moves."""
    loss: ca.SX
    """Energy that friction dissipates in the step, J."""


def drive_step(
    drive: Drive,
    w: ca.SX,
    rest_time: ca.SX,
    tau: ca.SX,
    load: ca.SX,
    *,
    h: float,
    middle: ca.SX | None = None,
) -> DriveStep:
    """Advance a drive by one time step with constant motor torque and constant load.

    If the sign of the speed would change, the step ends at speed zero, and the next step determines
    whether the drive stays at rest. The speed is linear within a step, so the mean speed determines
    the energies of the step. The model neglects frictional memory.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    w : expression
        Motor speed, rad/s. Exactly 0 means that the drive rests.
    rest_time : expression
        Time since the drive stopped, s.
    tau : expression
        Motor torque, N·m.
    load : expression
        Effort on the output of the drive, N·m or N.
    h : float
        Duration of the step, s.
    middle : expression, optional
        Motor speed at which friction is evaluated, rad/s. The default is `w`. With the speed in the
        middle of the step, the method is of second order.

    Returns
    -------
    DriveStep
        State after the step.
    """
    friction = friction_of(drive)
    speed = w if middle is None else middle
    mu = friction_coefficient(friction, speed)
    mu_slow = ca.fmin(friction_coefficient(friction, 0.0), friction.mu_static)
    mu_rest = static_coefficient(friction, rest_time, mu_slow)
    # A resting drive starts if the motor torque exceeds the breakaway torque of a direction.
    forward_torque = breakaway_torque(drive, load, 1.0, mu_rest)
    backward_torque = breakaway_torque(drive, load, -1.0, mu_rest)
    starts = ca.if_else(tau > forward_torque, 1, ca.if_else(tau < backward_torque, -1, 0))
    sign = ca.if_else(w == 0, starts, ca.sign(w))
    wd, effort = motor_acceleration(drive, tau, w=speed, load=load, direction=sign, mu=mu)
    free_speed = w + h * wd
    stops = sign * free_speed <= 0
    end_speed = ca.if_else(ca.logic_or(sign == 0, stops), 0, free_speed)
    # A drive that stops reaches speed zero before the step ends.
    moving_share = ca.if_else(stops, ca.fmin(ca.fmax(-w / ca.if_else(wd == 0, 1, h * wd), 0), 1), 1)
    mean = 0.5 * (w + end_speed) * moving_share
    qd = mean / drive.ratio
    qdd = wd / drive.ratio
    torque = moving_torque(drive, effort, speed, wd, direction=sign, mu=mu)
    # The energy that leaves the drive or accelerates the output and the second nut is not lost.
    transmitted = load + (drive.output_inertia + drive.second_nut_mass) * qdd
    loss_sliding = h * ((torque - drive.input_inertia * wd) * mean - transmitted * qd)
    loss_stopping = h * (tau * mean - load * qd) + 0.5 * moving_inertia(drive) * w**2
    loss = ca.if_else(sign == 0, 0, ca.if_else(stops, loss_stopping, loss_sliding))
    return DriveStep(end_speed, mean, ca.if_else(end_speed == 0, rest_time + h, 0), loss)


def stalled(
    drive: Drive, step: DriveStep, blocked: ca.SX, *, w: ca.SX, load: ca.SX, tau: ca.SX, h: float
) -> DriveStep:
    """Replace the step of a drive whose motor is blocked.

    A blocked motor stops at once and loses its kinetic energy.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    step : DriveStep
        Step of the drive with a free motor.
    blocked : expression
        1 for a blocked motor, 0 for a free one. The step of a free motor is returned unchanged.
    w, load, tau, h
        Motor speed before the step in rad/s, effort on the output in N·m or N, motor torque in N·m,
        and duration of the step in s.
    """
    mean = 0.5 * w
    loss = h * (tau * mean - load * mean / drive.ratio) + 0.5 * moving_inertia(drive) * w**2
    return DriveStep(
        w=ca.if_else(blocked, 0, step.w),
        mean=ca.if_else(blocked, mean, step.mean),
        rest_time=ca.if_else(blocked, step.rest_time + h, step.rest_time),
        loss=ca.if_else(blocked, loss, step.loss),
    )


def moving_inertia(drive: Drive) -> float:
    """Return the inertia that the motor accelerates, reduced to its shaft, kg·m².

    It contains the input, the output and the second nut of the drive.
    """
    return drive.input_inertia + (drive.output_inertia + drive.second_nut_mass) / drive.ratio**2
