"""Derive the thresholds of the guard from the limits of a robot and from its plan."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ssm_planner.comparison.compare import DEFAULT_LAG
from ssm_planner.comparison.predicted import ASSUMED_TORQUE_DEVIATION, predict_axes
from ssm_planner.errors import ExportError
from ssm_planner.formats.epos4_setup import drive_axes
from ssm_planner.plans import Plan
from ssm_planner.problem import Controller, Joint
from ssm_planner.simulation.cascade import DERIVATIVE_FILTER, loop_gains, motor_electrics
from ssm_planner.typing import Array, Mask

TORQUE_NOISE = 0.03
"""Standard deviation of a measured torque, as a share of the largest planned torque.

It is the largest noise of the recordings with which `ssm-planner compare` was tested.
"""
DEVIATIONS = 6.0
"""Number of standard deviations beyond which a value is not noise.

Normal noise exceeds it once in 5·10⁸ values, which is once in two days for three axes at 1 kHz.
"""
INCREMENTS = 2.0
"""Position noise in encoder increments: rounding of the set point and of the measurement."""
MOST_ROWS = 64
"""Largest number of ticks within the lag, which bounds the memory of the guard."""


@dataclass(frozen=True)
class Thresholds:
    """Thresholds of the guard. Arrays are (4,) by joint, in rad, m, s and N·m at the motor."""

    period: float
    """Time between two ticks, s."""
    lag: float
    """Time by which a drive may follow late, and for which a measurement may be missing, s."""
    rows: int
    """Number of ticks whose set points the drive may still execute."""
    driven: Mask
    """True for a joint with a drive. The guard ignores all others."""
    position_min: Array
    position_max: Array
    position_margin: Array
    """Distance from a position that the plan has within the lag.

    It is the way that the joint makes within the lag at its largest acceleration, plus the
    rounding to increments.
    """
    velocity_max: Array
    velocity_margin: Array
    """Difference from a velocity that the plan has within the lag.

    It is the change of the velocity within the lag at the largest acceleration, plus one increment
    per tick, which is the error of a velocity from rounded positions.
    """
    torque_max: Array
    """Largest torque of the motor."""
    torque_noise: Array
    """Noise of one measured torque, and the reaction of the controller to one increment."""
    torque_margin: Array
    """Difference of the mean torque over the lag from the band of the friction law.

    It is the noise of the mean, the reaction of the position loop to one increment, and the band of
    the posterior if the drive file has one.
    """
    torque_spread: Array
    """Relative width of the band of the friction if the drive file has no posterior."""


def thresholds_of(
    plan: Plan, period: float, counts_per_turn: dict[str, int] | int | None = None
) -> Thresholds:
    """Return the thresholds for a plan.

    Parameters
    ----------
    plan : Plan
    period : float
        Time between two ticks, s.
    counts_per_turn : int or mapping from joint to int, optional
        Increments per motor turn, see `ssm_planner.formats.epos4_setup.drive_axes`.

    Raises
    ------
    ExportError
        If a period is longer than the lag, or so short that the memory of the guard is too small.
    """
    rows = math.ceil(DEFAULT_LAG / period - 1e-9) + 1
    if not 2 <= rows <= MOST_ROWS or period > DEFAULT_LAG * (1 + 1e-9):
        low, high = 1 / DEFAULT_LAG, (MOST_ROWS - 1) / DEFAULT_LAG
        raise ExportError(
            f"the guard cannot tick {1 / period:g} times per second (allowed: {low:g} to {high:g}: "
            f"a drive may follow {1000 * DEFAULT_LAG:g} ms late)"
        )
    joints = plan.robot.joints
    axes = drive_axes(plan.robot, counts_per_turn)
    driven = np.array([joint.name in axes for joint in joints])
    increment = np.zeros(4)
    torque_max, noise, margin, spread = (np.zeros(4) for _ in range(4))
    for k, joint in enumerate(joints):
        if not driven[k]:
            continue
        increment[k] = 1 / abs(axes[joint.name].increments_per_unit)
        assert joint.motor is not None
        torque_max[k] = joint.motor.max_torque
        increment_at_motor = 2 * np.pi / axes[joint.name].counts_per_turn
        noise[k], margin[k], spread[k] = _torque(plan, joint, rows, increment_at_motor)
    accelerations = plan.robot.accelerations
    return Thresholds(
        period=period,
        lag=DEFAULT_LAG,
        rows=rows,
        driven=driven,
        position_min=np.array([joint.position[0] for joint in joints]),
        position_max=np.array([joint.position[1] for joint in joints]),
        position_margin=accelerations * DEFAULT_LAG**2 / 2 + INCREMENTS * increment,
        velocity_max=plan.robot.velocities,
        velocity_margin=accelerations * DEFAULT_LAG + increment / period,
        torque_max=torque_max,
        torque_noise=noise,
        torque_margin=margin,
        torque_spread=spread,
    )


def _torque(plan: Plan, joint: Joint, rows: int, increment: float) -> tuple[float, float, float]:
    """Return the noise of one torque, the margin of the mean and the relative band of a joint.

    The position loop amplifies the rounding of the encoder, which is up to one `increment` (rad at
    the motor). The gains are those that `ssm-planner simulate` computes. The derivative term adds
    DERIVATIVE_FILTER times the proportional term, but not to the mean.
    """
    (axis,) = predict_axes(plan.motion, plan.robot, [joint.name])
    controller = Controller()
    electrics = motor_electrics(joint, controller)
    gain = loop_gains(joint, controller, electrics).p * electrics.torque_constant
    reaction = gain * increment
    noise = DEVIATIONS * TORQUE_NOISE * float(np.abs(axis.torque).max())
    mean = noise / math.sqrt(rows) + reaction
    single = noise + (1 + DERIVATIVE_FILTER) * reaction
    if not axis.has_posterior:
        return single, mean, ASSUMED_TORQUE_DEVIATION
    band = float(np.maximum(axis.high - axis.torque, axis.torque - axis.low).max())
    return single, mean + band, 0.0
