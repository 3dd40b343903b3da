"""Advance a simulated drive by one time step, with numbers, arrays or CasADi expressions.

A drive slides, or comes to a stop within the step, or rests (stiction). These are the three modes
of Coulomb friction.
"""

from ssm_planner.codegen import namespace_of
from ssm_planner.dynamics import (
    breakaway_torque,
    friction_coefficient,
    motor_acceleration,
    moving_torque,
    required_friction,
    static_coefficient,
)
from ssm_planner.problem import Drive
from ssm_planner.typing import Expression, frozen


@frozen
class DriveStep:
    """State of a drive after one step, in the kind of numbers of the arguments."""

    w: Expression
    """Motor speed, rad/s."""
    mean: Expression
    """Mean motor speed in the step, rad/s."""
    rest_time: Expression
    """Time since the drive stopped, s. 0 while it moves."""
    loss: Expression
    """Energy that friction dissipates in the step, J."""


def drive_step(
    drive: Drive,
    w: Expression,
    rest_time: Expression,
    tau: Expression,
    load: Expression,
    *,
    h: Expression,
    middle: Expression | None = None,
) -> DriveStep:
    """Advance a drive by one time step with constant motor torque and constant load.

    If the sign of the speed would change, the step ends at speed zero, and the next step determines
    whether the drive stays at rest. The speed is linear within a step, so the mean speed determines
    the energies of the step. The model neglects frictional memory.

    Parameters
    ----------
    drive : Drive
        Drive with its friction.
    w : float, array or expression
        Motor speed at the start of the step, rad/s. Exactly 0 means that the drive rests.
    rest_time : float, array or expression
        Time since the drive stopped, s.
    tau : float, array or expression
        Motor torque, N·m.
    load : float, array or expression
        Effort on the output of the drive, N·m or N.
    h : float or expression
        Duration of the step, s.
    middle : float, array or expression, optional
        Motor speed at which friction is evaluated, rad/s. The default is `w`. With the speed in the
        middle of the step, the method is of second order.

    Returns
    -------
    DriveStep
        State after the step.

    Examples
    --------
    >>> from ssm_planner import laws, load_drive
    >>> drive = load_drive("vitreoretinal_joint1_worm")
    >>> step = laws.drive_step(drive, w=60.0, rest_time=0.0, tau=0.0, load=0.2, h=1e-3)
    >>> 0 < step.w < 60.0
    True
    """
    xp = namespace_of(w, rest_time, tau, load)
    friction = required_friction(drive)
    speed = w if middle is None else middle
    mu = friction_coefficient(friction, speed)
    # Static friction grows during a rest from the smaller of these two coefficients.
    mu_slow = xp.minimum(friction_coefficient(friction, 0.0), friction.mu_static)
    mu_rest = static_coefficient(friction, rest_time, mu_slow)
    # A resting drive starts if the motor torque exceeds the breakaway torque of a direction.
    forward_torque = breakaway_torque(drive, load, 1.0, mu_rest)
    backward_torque = breakaway_torque(drive, load, -1.0, mu_rest)
    backward_start = xp.where(tau < backward_torque, -1, 0)
    start = xp.where(tau > forward_torque, 1, backward_start)
    sign = xp.where(w == 0, start, xp.sign(w))
    wd, effort = motor_acceleration(drive, tau, w=speed, load=load, direction=sign, mu=mu)
    free_speed = w + h * wd
    stops = sign * free_speed <= 0  # also true at rest
    end_speed = xp.where(stops, 0, free_speed)
    # A drive that stops reaches speed zero before the step ends.
    stop_share = -w / xp.where(wd == 0, 1, h * wd)
    # The speed is linear in time, so its mean over the moving part is that of both ends.
    moving_share = xp.where(stops, xp.minimum(xp.maximum(stop_share, 0), 1), 1)
    mean = 0.5 * (w + end_speed) * moving_share
    qd = mean / drive.ratio
    qdd = wd / drive.ratio
    torque = moving_torque(drive, effort, speed, wd, direction=sign, mu=mu)
    # The energy that leaves the drive or accelerates the output and the second nut is not lost.
    transmitted = load + (drive.output_inertia + drive.second_nut_mass) * qdd
    loss_sliding = h * ((torque - drive.input_inertia * wd) * mean - transmitted * qd)
    loss_stopping = h * (tau * mean - load * qd) + 0.5 * inertia_at_motor(drive) * w**2
    loss = xp.where(sign == 0, 0, xp.where(stops, loss_stopping, loss_sliding))
    return DriveStep(end_speed, mean, xp.where(end_speed == 0, rest_time + h, 0), loss)


def with_blocked_motor(
    drive: Drive,
    step: DriveStep,
    blocked: Expression,
    *,
    w: Expression,
    load: Expression,
    tau: Expression,
    h: float,
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
    w : float, array or expression
        Motor speed before the step, rad/s.
    load : float, array or expression
        Effort on the output of the drive, N·m or N.
    tau : float, array or expression
        Motor torque, N·m.
    h : float
        Duration of the step, s.

    Returns
    -------
    DriveStep
        Step with final motor speed 0 for a blocked motor, and `step` for a free motor.
    """
    xp = namespace_of(blocked, w, tau, load)
    mean = 0.5 * w
    loss = h * (tau * mean - load * mean / drive.ratio) + 0.5 * inertia_at_motor(drive) * w**2
    return DriveStep(
        w=xp.where(blocked, 0, step.w),
        mean=xp.where(blocked, mean, step.mean),
        rest_time=xp.where(blocked, step.rest_time + h, step.rest_time),
        loss=xp.where(blocked, loss, step.loss),
    )


def inertia_at_motor(drive: Drive) -> float:
    """Compute the inertia that the motor accelerates, reduced to its shaft.

    The inertia contains the input, the output and the second nut of the drive.

    Parameters
    ----------
    drive : Drive
        The drive.

    Returns
    -------
    float
        Inertia, kg·m².
    """
    return drive.input_inertia + (drive.output_inertia + drive.second_nut_mass) / drive.ratio**2
