"""What a plan predicts of one axis: position, motor speed, and motor torque with the band it should stay within."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ssm_planner.dynamics.friction import friction_of
from ssm_planner.dynamics.motors import directions, drive_torque, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.spread import drawn
from ssm_planner.errors import RecordingError
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.posterior import CONFIDENCE, LOAD_OFFSET
from ssm_planner.problem.robot import Joint, Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array

PLAN_RATE = 2000.0
SPREAD = 0.25
"""Share by which torque is assumed to depart from the predicted where the drive file gives no posterior."""
TAIL = 1.96
"""Standard deviations of the scatter between recordings that the band holds."""


@dataclass(frozen=True, eq=False)
class Predicted:
    """One axis at PLAN_RATE, (n,) each; SI, motor side but for the position."""

    joint: Joint
    ratio: float
    time: Array
    """From 0."""
    position: Array
    speed: Array
    torque: Array
    low: Array
    """Lower end of the torque's band."""
    high: Array
    known: bool
    """The band is the posterior of the drive file; else SPREAD is assumed."""

    @property
    def peak(self) -> float:
        """Largest speed, rad/s."""
        return float(np.abs(self.speed).max())

    @property
    def duration(self) -> float:
        """s."""
        return float(self.time[-1])


def predicted(trajectory: Trajectory, robot: Robot, joints: Sequence[str]) -> list[Predicted]:
    """What is expected of each of the named joints. Raises RecordingError for one without a drive."""
    samples = trajectory.uniform(PLAN_RATE)
    way, away = directions(robot, samples, 1)
    body = RigidBody.from_robot(robot)
    motor = motor_motion(robot, body, samples, way, away)
    rigid = body.inverse_dynamics(samples.q, samples.qd, samples.qdd)
    found = []
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
            way[:, i],
            breakaway=away[:, i],
        )
        low, high = (
            (torque - SPREAD * np.abs(torque), torque + SPREAD * np.abs(torque))
            if band is None
            else band
        )
        found.append(
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
    return found


def _band(
    drive: Drive, rigid: Array, qd: Array, qdd: Array, way: Array, *, breakaway: Array
) -> tuple[Array, Array] | None:
    """(low, high) motor torque (n,) at 95 % by the sets of the posterior; None where the drive has none."""
    friction = friction_of(drive)
    if friction.posterior is None:
        return None
    sets: dict[str, Any] = {
        name: column[:, None]
        for name, column in friction.posterior.values().items()
        if name != LOAD_OFFSET
    }
    torque = np.asarray(
        drive_torque(drawn(drive, sets), rigid, qd, qdd, way, breakaway=breakaway)[0]
    )
    low, high = np.quantile(torque, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], axis=0)
    return low - TAIL * friction.posterior.scatter, high + TAIL * friction.posterior.scatter
