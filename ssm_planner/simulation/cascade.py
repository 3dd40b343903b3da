"""The cascade of a motor controller in CasADi: position PID with feed-forward, current loop, supply voltage, encoder.

Position loop (maxon, EPOS4 Application Notes, "Controller Architecture"), e = demanded − measured motor angle:

    i_demand = P·e + I·∫e dt + D·ė filtered + FF_v·w + FF_a·ẇ + torque offset / k

The derivative's filter has the time constant D / (10 P). The current follows its demand with a lag, within the largest
current and within what the supply drives through the winding against the back-EMF: |k·w + R·i| ≤ U.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from ssm_planner.dynamics.friction import friction_of
from ssm_planner.errors import ProblemError
from ssm_planner.problem.controller import Controller
from ssm_planner.problem.robot import Joint

MARGIN = 30.0
"""Phase margin of the default position loop on the motor's own inertia, degrees: the least that is usual, because a worm that
its load drives needs a fast loop."""
DAMPING = 0.7
FILTER = 10.0
"""The derivative's filter: D / (FILTER · P)."""
INTEGRAL_SHARE = 0.1
"""Of the bandwidth at which the integral takes over."""


@dataclass(frozen=True)
class Electrics:
    """Motor winding and power stage of one drive."""

    torque_constant: float
    """k, N·m/A, and V·s/rad."""
    resistance: float
    """R of the winding, ohm; 0: unknown, its voltage drop is left out."""
    voltage: float
    """U, the largest that reaches the motor, V; infinite where no voltage is known."""
    max_current: float
    lag: float
    """Time constant of the closed current loop, s."""


@dataclass(frozen=True)
class Gains:
    """Of one position loop, in A and rad at the motor."""

    p: float
    i: float
    d: float
    ff_velocity: float
    ff_acceleration: float


@dataclass(frozen=True)
class LoopStep:
    """After one period of the position loop: current, whether more was demanded, and what the loop remembers."""

    current: ca.SX
    saturated: ca.SX
    integral: ca.SX
    derivative: ca.SX


def electrics_of(joint: Joint, controller: Controller) -> Electrics:
    """Winding and supply of a joint's motor. Raises ProblemError where its torque constant is missing."""
    motor = joint.motor
    if motor is None or motor.torque_constant is None:
        raise ProblemError(
            f"missing for the motor of joint {joint.name}: a current has no torque without it",
            file=None if motor is None else motor.file,
            key="torque_constant",
            allowed="a torque constant such as 14.8 mN*m/A",
        )
    supply = controller.supply or motor.nominal_voltage
    return Electrics(
        torque_constant=motor.torque_constant,
        resistance=motor.terminal_resistance or 0.0,
        voltage=math.inf if supply is None else controller.output_share * supply,
        max_current=controller.axis(joint.name).max_current
        or motor.max_torque / motor.torque_constant,
        lag=controller.current_lag,
    )


@lru_cache
def bandwidth_of(period: float, lag: float) -> float:
    """The bandwidth, Hz, at which a position loop sampled every `period` (s) keeps MARGIN on an inertia; lag: of the current.

    With P, I and D as `gains_of` makes them the inertia cancels out of the open loop
    (ω² + 2ζω s / (1 + T_f s) + 0.1 ω³ / s) / s², which half a period of sampling and the current's lag follow.
    """
    low, high = 1e-3 / period, 1.0 / period
    for _ in range(60):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if phase_margin(middle, period, lag) > MARGIN else (low, middle)
    return low


def phase_margin(bandwidth: float, period: float, lag: float) -> float:
    """Of the default position loop with a bandwidth (Hz), degrees; −180 where it is not stable at all."""
    omega = 2.0 * math.pi * bandwidth
    s = 1j * omega * np.geomspace(0.3, 10.0, 2000)
    derivative = 2.0 * DAMPING * omega * s / (1.0 + 2.0 * DAMPING / (FILTER * omega) * s)
    loop = (
        (omega**2 + derivative + INTEGRAL_SHARE * omega**3 / s)
        / s**2
        / (1.0 + lag * s)
        * np.exp(-s * period / 2.0)
    )
    crossing = int(np.flatnonzero(np.abs(loop) > 1.0).max(initial=0))
    phase = np.degrees(np.unwrap(np.angle(loop)))
    # the integral and both poles at 0 begin at −270 degrees
    return float(180.0 + phase[crossing] - 360.0 * round((phase[0] + 180.0) / 360.0))


def gains_of(joint: Joint, controller: Controller, electrics: Electrics) -> Gains:
    """The file's gains, and for the rest those that give the loop its bandwidth on the motor's own inertia.

    With J the drive's input inertia and ω = 2π·bandwidth: P = J·ω²/k, D = 2·0.7·J·ω/k, I = 0.1·ω·P; where the drive adds
    no torque offsets, FF_v = b_v/k and FF_a = J/k, else 0, for the offsets hold both.
    """
    drive, axis = joint.drive, controller.axis(joint.name)
    if drive is None:
        raise ProblemError("has no drive", key=f"joints.{joint.name}")
    omega = (
        2.0
        * math.pi
        * (axis.bandwidth or bandwidth_of(controller.loop_period, controller.current_lag))
    )
    inertia = drive.input_inertia / electrics.torque_constant
    if inertia == 0.0 and (axis.p is None or axis.d is None):
        raise ProblemError(
            f"the drive of joint {joint.name} has no input inertia to tune gains from",
            file=controller.file,
            key=f"joints.{joint.name}",
            allowed="p and d, or an input_inertia in the drive file",
        )
    without = 0.0 if controller.torque_offset else 1.0
    tuned = Gains(
        p=inertia * omega**2,
        i=INTEGRAL_SHARE * omega * inertia * omega**2,
        d=2.0 * DAMPING * inertia * omega,
        ff_velocity=without * friction_of(drive).b_v / electrics.torque_constant,
        ff_acceleration=without * inertia,
    )
    given = {name: getattr(axis, name) for name in vars(tuned)}
    return Gains(
        **{name: getattr(tuned, name) if value is None else value for name, value in given.items()}
    )


def current_range(electrics: Electrics, w: ca.SX) -> tuple[ca.SX, ca.SX]:
    """(least, largest) current at motor speed w, A: by the power stage, and by the supply against the back-EMF."""
    low, high = ca.SX(-electrics.max_current), ca.SX(electrics.max_current)
    if not math.isfinite(electrics.voltage):
        return low, high
    back = electrics.torque_constant * w
    if electrics.resistance == 0.0:
        return ca.if_else(back <= -electrics.voltage, 0, low), ca.if_else(
            back >= electrics.voltage, 0, high
        )
    below, above = (
        (sign * electrics.voltage - back) / electrics.resistance for sign in (-1.0, 1.0)
    )
    return ca.fmax(low, ca.fmin(below, high)), ca.fmin(high, ca.fmax(above, low))


def loop_step(
    gains: Gains,
    electrics: Electrics,
    period: float,
    *,
    error: ca.SX,
    before: ca.SX,
    w: ca.SX,
    feedforward: ca.SX,
) -> LoopStep:
    """One period of the position loop and the current after it.

    error (2,): demanded − measured motor angle now and one period ago, rad; before (3,): current, integral and derivative
    terms, A; w: motor speed; feedforward: current, A. While the current is limited the integral does not grow further.
    """
    current, integral, derivative = ca.vertsplit(before)
    delay = gains.d / (FILTER * gains.p) if gains.p > 0 else period
    derivative = (delay * derivative + gains.d * (error[0] - error[1])) / (delay + period)
    demanded = gains.p * error[0] + integral + derivative + feedforward
    low, high = current_range(electrics, w)
    limited = ca.fmin(ca.fmax(demanded, low), high)
    winds = ca.logic_and(limited != demanded, demanded * error[0] > 0)
    integral = integral + ca.if_else(winds, 0, period * gains.i * error[0])
    follows = 1.0 - math.exp(-period / electrics.lag)
    current = ca.fmin(ca.fmax(current + follows * (limited - current), low), high)
    return LoopStep(current, limited != demanded, integral, derivative)


def encoder(angle: ca.SX, counts_per_turn: int) -> ca.SX:
    """The motor angle as an encoder of so many increments reads it, rad."""
    increment = 2.0 * math.pi / counts_per_turn
    return increment * ca.floor(angle / increment + 0.5)
