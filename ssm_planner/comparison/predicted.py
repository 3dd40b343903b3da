"""Predict position, motor speed and motor torque of each axis from a plan."""

from collections.abc import Sequence

import numpy as np

from ssm_planner.dynamics import (
    RigidBody,
    drive_torque,
    drive_with_values,
    motion_directions,
    motor_motion,
    required_friction,
)
from ssm_planner.errors import RecordingError
from ssm_planner.problem import CONFIDENCE, JOINTS, LOAD_OFFSET, Drive, Joint, Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, record

PLAN_RATE = 2000.0
"""Sampling rate of the prediction at the planned speed, Hz."""
ASSUMED_TORQUE_DEVIATION = 0.25
"""Assumed relative deviation of the torque if the drive file contains no posterior distribution."""
SCATTER_DEVIATIONS = 1.96
"""Half width of the band in standard deviations of the scatter between recordings."""


@record
class AxisPrediction:
    """The prediction of one axis. Arrays are (n,), in SI units.

    Speed and torque are those of the motor.
    """

    joint: Joint
    ratio: float
    time: Array
    """Time since the start of the motion, s."""
    position: Array
    """Joint position, rad or m."""
    speed: Array
    torque: Array
    low: Array
    """Lower end of the torque's band."""
    high: Array
    """Upper end of the torque's band."""
    has_posterior: bool
    """True if the band follows from the posterior of the drive file.

    Otherwise, the band is the torque ± `ASSUMED_TORQUE_DEVIATION` times the torque.
    """

    @property
    def peak(self) -> float:
        """Largest motor speed, rad/s."""
        return float(np.abs(self.speed).max())

    @property
    def duration(self) -> float:
        """Duration of the motion, s."""
        return float(self.time[-1])


def predict_axes(
    trajectory: Trajectory, robot: Robot, joints: Sequence[str], speed: float = 1.0
) -> list[AxisPrediction]:
    """Predict position, motor speed and motor torque of the given joints.

    Parameters
    ----------
    trajectory : Trajectory
        The planned motion.
    robot : Robot
        Robot with its drives.
    joints : sequence of str
        Names of the joints.
    speed : float
        Speed of execution, as a multiple of the planned speed.

    Returns
    -------
    list of AxisPrediction
        One prediction for each name, in the same order.

    Raises
    ------
    RecordingError
        If a joint has no drive.
    """
    trajectory = trajectory.slower(speed)
    samples = trajectory.uniform(PLAN_RATE * speed)
    direction, breakaway = motion_directions(robot, samples, 1)
    body = RigidBody.from_robot(robot)
    motor = motor_motion(robot, body, samples, direction, breakaway)
    rigid = body.inverse_dynamics(samples.q, samples.qd, samples.qdd)
    predictions = []
    for name in joints:
        i = JOINTS.index(name)
        joint = robot.joints[i]
        if joint.drive is None:
            raise RecordingError(f"joint {name} has no drive in the robot file")
        torque = motor.torque[:, i]
        qd = samples.qd[:, i]
        qdd = samples.qdd[:, i]
        band = _posterior_band(
            joint.drive, rigid[:, i], qd, qdd, direction[:, i], breakaway=breakaway[:, i]
        )
        margin = ASSUMED_TORQUE_DEVIATION * np.abs(torque)
        low, high = (torque - margin, torque + margin) if band is None else band
        predictions.append(
            AxisPrediction(
                joint,
                joint.drive.ratio,
                time=samples.t - trajectory.breaks[0],
                position=samples.q[:, i],
                speed=motor.speed[:, i],
                torque=torque,
                low=low,
                high=high,
                has_posterior=band is not None,
            )
        )
    return predictions


def _posterior_band(
    drive: Drive, rigid: Array, qd: Array, qdd: Array, direction: Array, breakaway: Array
) -> tuple[Array, Array] | None:
    """Compute the band that contains the motor torque in 95 % of recordings.

    The band follows from the parameter sets of the posterior distribution and from the scatter
    between recordings.

    Parameters
    ----------
    drive : Drive
        Drive of the joint.
    rigid : (n,) array
        Effort of the rigid-body dynamics on the joint, N·m or N.
    qd, qdd : (n,) arrays
        Velocity (rad/s or m/s) and acceleration (rad/s² or m/s²) of the joint.
    direction : (n,) array
        Direction of the joint: −1, 0 or 1.
    breakaway : (n,) array
        True where the joint starts from rest.

    Returns
    -------
    (low, high) or None
        Ends of the band, (n,) each, N·m. None if the drive file contains no posterior distribution.
    """
    friction = required_friction(drive)
    if friction.posterior is None:
        return None
    parameters = {name: column[:, None] for name, column in friction.posterior.values().items()}
    parameters.pop(LOAD_OFFSET, None)
    sampled_drive = drive_with_values(drive, parameters)
    torque, _ = drive_torque(sampled_drive, rigid, qd, qdd, direction, breakaway=breakaway)
    low, high = np.quantile(torque, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], axis=0)
    scatter = SCATTER_DEVIATIONS * friction.posterior.scatter
    return low - scatter, high + scatter
