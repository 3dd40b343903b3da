"""Predict one axis from a plan: position, motor speed, motor torque and the band of the torque."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ssm_planner.dynamics.friction import friction_of
from ssm_planner.dynamics.motors import directions, drive_torque, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.spread import drive_with
from ssm_planner.errors import RecordingError
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.posterior import CONFIDENCE, LOAD_OFFSET
from ssm_planner.problem.robot import Joint, Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, record

PLAN_RATE = 2000.0
SPREAD = 0.25
"""Assumed relative deviation of the torque if the drive file contains no posterior."""
TAIL = 1.96
"""Standard deviations of the scatter between recordings that the band contains."""


@record
class Predicted:
    """Prediction of one axis at PLAN_RATE, arrays (n,); SI, on the motor side except for the
    position.
    """

    joint: Joint
    ratio: float
    time: Array
    """Time from the start of the motion, s."""
    position: Array
    speed: Array
    torque: Array
    low: Array
    """Lower end of the torque's band."""
    high: Array
    known: bool
    """The band comes from the posterior of the drive file; otherwise it is ±SPREAD."""

    @property
    def peak(self) -> float:
        """Return the largest speed, rad/s."""
        return float(np.abs(self.speed).max())

    @property
    def duration(self) -> float:
        """Return the duration of the motion, s."""
        return float(self.time[-1])


def predict_axes(trajectory: Trajectory, robot: Robot, joints: Sequence[str]) -> list[Predicted]:
    """Predict each of the named joints. Raises RecordingError for a joint without a drive."""
    samples = trajectory.uniform(PLAN_RATE)
    direction, breakaway = directions(robot, samples, 1)
    body = RigidBody.from_robot(robot)
    motor = motor_motion(robot, body, samples, direction, breakaway)
    rigid = body.inverse_dynamics(samples.q, samples.qd, samples.qdd)
    predictions = []
    for name in joints:
        i = [joint.name for joint in robot.joints].index(name)
        joint = robot.joints[i]
        if joint.drive is None:
            raise RecordingError(f"joint {name} has no drive in the robot file")
        torque = motor.torque[:, i]
        band = _band(
            joint.drive,
            rigid[:, i],
            samples.qd[:, i],
            samples.qdd[:, i],
            direction[:, i],
            breakaway=breakaway[:, i],
        )
        low, high = (
            (torque - SPREAD * np.abs(torque), torque + SPREAD * np.abs(torque))
            if band is None
            else band
        )
        predictions.append(
            Predicted(
                joint,
                joint.drive.ratio,
                time=samples.t - trajectory.breaks[0],
                position=samples.q[:, i],
                speed=motor.speed[:, i],
                torque=torque,
                low=low,
                high=high,
                known=band is not None,
            )
        )
    return predictions


def _band(
    drive: Drive, rigid: Array, qd: Array, qdd: Array, direction: Array, *, breakaway: Array
) -> tuple[Array, Array] | None:
    """Return the (low, high) motor torque (n,) at 95 % over the sets of the posterior, N·m.

    rigid, qd, qdd, way, breakaway (n,): load, velocity, acceleration, direction and breakaway of
    the joint. Returns None if the drive file contains no posterior.
    """
    friction = friction_of(drive)
    if friction.posterior is None:
        return None
    sets = {
        name: column[:, None]
        for name, column in friction.posterior.values().items()
        if name != LOAD_OFFSET
    }
    torque = np.asarray(
        drive_torque(drive_with(drive, sets), rigid, qd, qdd, direction, breakaway=breakaway)[0]
    )
    low, high = np.quantile(torque, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], axis=0)
    return low - TAIL * friction.posterior.scatter, high + TAIL * friction.posterior.scatter
