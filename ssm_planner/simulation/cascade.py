"""Model the control cascade of a motor controller in CasADi.

The cascade consists of a position PID loop with feed-forward, a current loop, the supply voltage
and the encoder. The position loop (maxon, EPOS4 Application Notes, "Controller Architecture")
computes the demanded current from the error e = demanded − measured motor angle:

    i_demand = P·e + I·∫e dt + D·ė filtered + FF_v·w + FF_a·ẇ + torque offset / k

w is the demanded motor speed, and k the torque constant. The filter of the derivative has the time
constant D / (10 P). The current i follows its demand with a lag. The power stage limits the
current. The supply voltage U limits it as well: with the winding resistance R and the back-EMF k·w,
|k·w + R·i| ≤ U.
"""

import math
from dataclasses import replace
from functools import lru_cache

import casadi as ca
import numpy as np

from ssm_planner.dynamics import required_friction
from ssm_planner.errors import ProblemError
from ssm_planner.problem import Controller, Joint, get_attributes
from ssm_planner.typing import frozen

DEFAULT_PHASE_MARGIN = 30.0
"""Phase margin of the default position loop of an unloaded motor, degrees.

It is the smallest usual value, because a worm gear that its load drives needs a fast loop.
"""
LOOP_DAMPING_RATIO = 0.7
"""Damping ratio of the default position loop."""
DERIVATIVE_FILTER = 10.0
"""Constant of the derivative filter, whose time constant is D / (DERIVATIVE_FILTER · P)."""
INTEGRAL_GAIN_RATIO = 0.1
"""Ratio I / (ω P) of the default gains, with the bandwidth ω in rad/s."""


@frozen
class MotorElectrics:
    """Electrical data of the motor winding and of the power stage of one drive."""

    torque_constant: float
    """Torque constant k, N·m/A, which is also the back-EMF constant, V·s/rad."""
    resistance: float
    """Resistance R of the winding, ohm. 0 if the motor file does not state it."""
    voltage: float
    """Largest voltage U at the motor, V. Infinite if no file states it."""
    max_current: float
    """Largest current, A."""
    lag: float
    """Time constant of the closed current loop, s."""


@frozen
class LoopGains:
    """Gains of one position loop, in A and rad at the motor."""

    p: float
    """Proportional gain P, A/rad."""
    i: float
    """Integral gain I, A/(rad·s)."""
    d: float
    """Derivative gain D, A·s/rad."""
    ff_velocity: float
    """Velocity feed-forward FF_v, A·s/rad."""
    ff_acceleration: float
    """Acceleration feed-forward FF_a, A·s²/rad."""


@frozen
class LoopStep:
    """State of the loop after one period, as CasADi expressions."""

    current: ca.SX
    """Motor current, A."""
    saturated: ca.SX
    """1 if the demanded current exceeds the possible current."""
    integral: ca.SX
    """Integral term of the demanded current, A."""
    derivative: ca.SX
    """Derivative term of the demanded current, A."""


def motor_electrics(joint: Joint, controller: Controller) -> MotorElectrics:
    """Collect the electrical data of a joint's motor and of its supply.

    The controller file has priority over the motor file for the supply voltage and the largest
    current.

    Parameters
    ----------
    joint : Joint
        Joint with a motor.
    controller : Controller
        The motor controller.

    Returns
    -------
    MotorElectrics
        Torque constant, winding resistance, voltage, largest current, and lag of the current.

    Raises
    ------
    ProblemError
        If the joint lacks a motor, or the motor file lacks the torque constant.
    """
    motor = joint.motor
    if motor is None or motor.torque_constant is None:
        raise ProblemError(
            f"missing for the motor of joint {joint.name}: the torque of a current depends on it",
            file=None if motor is None else motor.file,
            key="torque_constant",
            allowed="a torque constant such as 14.8 mN*m/A",
        )
    supply = controller.supply or motor.nominal_voltage
    return MotorElectrics(
        torque_constant=motor.torque_constant,
        resistance=motor.terminal_resistance or 0.0,
        voltage=math.inf if supply is None else controller.output_share * supply,
        max_current=controller.axis(joint.name).max_current
        or motor.max_torque / motor.torque_constant,
        lag=controller.current_lag,
    )


@lru_cache
def default_bandwidth(period: float, lag: float) -> float:
    """Compute the bandwidth of the default position loop.

    At this bandwidth, the loop has the phase margin `DEFAULT_PHASE_MARGIN`. The phase margin falls
    as the bandwidth grows, because half a sampling period and the lag of the current delay the
    loop. Bisection finds the bandwidth.

    Parameters
    ----------
    period : float
        Sampling period of the position loop, s.
    lag : float
        Time constant of the current loop, s.

    Returns
    -------
    float
        Bandwidth, Hz.

    Notes
    -----
    With the gains of `loop_gains`, the inertia cancels out of the open loop, which is
        (ω² + 2ζω s / (1 + T_f s) + 0.1 ω³ / s) / s²
    with ω = 2π · bandwidth, the damping ratio ζ = LOOP_DAMPING_RATIO and the time constant T_f of
    the derivative filter. The delay multiplies it by exp(−s · period / 2) / (1 + lag · s).
    """
    low = 1e-3 / period
    high = 1.0 / period
    for _ in range(60):  # Each step halves the interval of the logarithm.
        middle = math.sqrt(low * high)
        if phase_margin(middle, period, lag) > DEFAULT_PHASE_MARGIN:
            low = middle
        else:
            high = middle
    return low


def phase_margin(bandwidth: float, period: float, lag: float) -> float:
    """Compute the phase margin of the default position loop.

    The closed loop is unstable if the margin is negative. The open loop is stated in the notes of
    `default_bandwidth`.

    Parameters
    ----------
    bandwidth : float
        Bandwidth of the loop, Hz.
    period : float
        Sampling period of the position loop, s.
    lag : float
        Time constant of the current loop, s.

    Returns
    -------
    float
        Phase margin, degrees.
    """
    omega = 2.0 * math.pi * bandwidth
    # The gain falls to 1 at a frequency in this range around the bandwidth.
    s = 1j * omega * np.geomspace(0.3, 10.0, 2000)
    filtered = 1.0 + 2.0 * LOOP_DAMPING_RATIO / (DERIVATIVE_FILTER * omega) * s
    derivative = 2.0 * LOOP_DAMPING_RATIO * omega * s / filtered
    gain = omega**2 + derivative + INTEGRAL_GAIN_RATIO * omega**3 / s
    delay = np.exp(-s * period / 2.0) / (1.0 + lag * s)
    loop = gain / s**2 * delay
    # The margin is the phase at the last frequency with a gain above 1, plus 180 degrees.
    crossing = int(np.flatnonzero(np.abs(loop) > 1.0).max(initial=0))
    phase = np.degrees(np.unwrap(np.angle(loop)))
    # The phase of the integral and both poles at 0 begins at −270 degrees.
    return float(180.0 + phase[crossing] - 360.0 * round((phase[0] + 180.0) / 360.0))


def loop_gains(joint: Joint, controller: Controller, electrics: MotorElectrics) -> LoopGains:
    """Compute the gains of a joint's position loop that the controller file does not state.

    With the torque constant k, the input inertia J, the viscous friction b_v and ω = 2π ·
    bandwidth, the default gains are P = J·ω²/k, D = 2·0.7·J·ω/k and I = 0.1·ω·P. If the controller
    receives no torque offsets with its set points, FF_v = b_v/k and FF_a = J/k. Otherwise both
    feed-forward gains are 0, because the torque offsets contain these torques.

    Parameters
    ----------
    joint : Joint
        Joint with a drive.
    controller : Controller
        The motor controller. Gains that its file states replace the default gains.
    electrics : MotorElectrics
        Electrical data of the motor, with the torque constant k.

    Returns
    -------
    LoopGains
        Gains of the position loop.

    Raises
    ------
    ProblemError
        If the joint lacks a drive, or if the drive file does not state the inertia that the default
        gains need.
    """
    drive = joint.drive
    axis = controller.axis(joint.name)
    if drive is None:
        raise ProblemError("has no drive", key=f"joints.{joint.name}")
    bandwidth = axis.bandwidth or default_bandwidth(controller.loop_period, controller.current_lag)
    omega = 2.0 * math.pi * bandwidth
    inertia = drive.input_inertia / electrics.torque_constant
    if inertia == 0.0 and (axis.p is None or axis.d is None):
        raise ProblemError(
            f"the drive of joint {joint.name} has no input inertia, from which default gains "
            "follow",
            file=controller.file,
            key=f"joints.{joint.name}",
            allowed="p and d, or an input_inertia in the drive file",
        )
    feedforward = 0.0 if controller.torque_offset else 1.0
    tuned = LoopGains(
        p=inertia * omega**2,
        i=INTEGRAL_GAIN_RATIO * omega * inertia * omega**2,
        d=2.0 * LOOP_DAMPING_RATIO * inertia * omega,
        ff_velocity=feedforward * required_friction(drive).b_v / electrics.torque_constant,
        ff_acceleration=feedforward * inertia,
    )
    gains = get_attributes(axis, vars(tuned))
    return replace(tuned, **{name: gain for name, gain in gains.items() if gain is not None})


def current_range(electrics: MotorElectrics, w: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Compute the smallest and the largest possible motor current at a motor speed.

    The power stage limits the current, and so does the supply voltage minus the back-EMF. If the
    resistance of the winding is not known (0), the voltage only prevents currents that would
    accelerate the motor beyond its no-load speed.

    Parameters
    ----------
    electrics : MotorElectrics
        Electrical data of the motor and its supply.
    w : expression
        Motor speed, rad/s.

    Returns
    -------
    low, high : expressions
        Smallest and largest possible current, A.
    """
    low = ca.SX(-electrics.max_current)
    high = ca.SX(electrics.max_current)
    voltage = electrics.voltage
    if not math.isfinite(voltage):
        return low, high
    back_emf = electrics.torque_constant * w
    if electrics.resistance == 0.0:
        low = ca.if_else(back_emf <= -voltage, 0, low)
        return low, ca.if_else(back_emf >= voltage, 0, high)
    lowest = (-voltage - back_emf) / electrics.resistance
    highest = (voltage - back_emf) / electrics.resistance
    return ca.fmax(low, ca.fmin(lowest, high)), ca.fmin(high, ca.fmax(highest, low))


def advance_loops(
    gains: LoopGains,
    electrics: MotorElectrics,
    period: float,
    *,
    error: ca.SX,
    previous: ca.SX,
    w: ca.SX,
    feedforward: ca.SX,
) -> LoopStep:
    """Advance the position loop and the current loop of a motor by one period, in CasADi.

    While the current is limited, the integral term changes only if this reduces the demanded
    current (anti-windup).

    Parameters
    ----------
    gains, electrics : LoopGains, MotorElectrics
        Gains of the position loop, and electrical data of motor and supply.
    period : float
        Sampling period of the loop, s.
    error : (2,)
        Demanded − measured motor angle now and one period ago, rad.
    previous : (3,)
        Current, integral term and derivative term after the last period, A.
    w : expression
        Motor speed, rad/s.
    feedforward : expression
        Feed-forward current, A.

    Returns
    -------
    LoopStep
        State of the loops after the period.
    """
    current, integral, derivative = ca.vertsplit(previous)
    filter_time = gains.d / (DERIVATIVE_FILTER * gains.p) if gains.p > 0 else period
    error_change = error[0] - error[1]
    derivative = (filter_time * derivative + gains.d * error_change) / (filter_time + period)
    demanded = gains.p * error[0] + integral + derivative + feedforward
    low, high = current_range(electrics, w)
    limited = ca.fmin(ca.fmax(demanded, low), high)
    winds_up = ca.logic_and(limited != demanded, demanded * error[0] > 0)
    integral = integral + ca.if_else(winds_up, 0, period * gains.i * error[0])
    lag_share = 1.0 - math.exp(-period / electrics.lag)
    current = ca.fmin(ca.fmax(current + lag_share * (limited - current), low), high)
    return LoopStep(current, limited != demanded, integral, derivative)


def round_to_increments(angle: ca.SX, counts_per_turn: int) -> ca.SX:
    """Round a motor angle to the nearest increment of an encoder.

    Parameters
    ----------
    angle : expression
        Motor angle, rad.
    counts_per_turn : int
        Increments of the encoder per motor turn.

    Returns
    -------
    expression
        The angle that the encoder measures, rad.
    """
    increment = 2.0 * math.pi / counts_per_turn
    return increment * ca.floor(angle / increment + 0.5)
