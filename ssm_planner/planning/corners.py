"""Drives that bound a range of friction and payload.

A motion whose torques hold for each of these drives holds for the whole range. In the direction of
motion σ, the motor torque σ τ is at every instant a convex function of the load, and it grows with
μ, with both bearing parameters and with the preload (dynamics/transmission.py). It follows that

* the load is linear in a mass at the tip, so one end of the range of masses is the worst;
* few of the sets of friction parameters that span the range (`FrictionSpread.within`) are the
  worst anywhere. They are selected greedily on a grid of speeds and efforts that the motor can
  meet, until no other set exceeds them by more than EASE of the largest torque. The remaining
  excess is added to their bearing friction;
* braking is bounded by the smallest value of every parameter at once.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ssm_planner.dynamics import (
    drive_torque,
    drive_with,
    friction_of,
    mesh_coefficients,
    spread_of,
    with_payload,
)
from ssm_planner.problem import LAW, LAWS, Drive, Joint, Problem, Robot, unchecked
from ssm_planner.typing import Array

EASE = 0.01
"""Share of the largest torque by which sets may exceed the selected ones, which are then raised by
the excess.
"""
BEYOND = 1.1
"""Multiple of the largest torque up to which sets are distinguished."""
MOST = 8
"""Largest number of sets selected for a drive."""
SPEEDS = np.array([0.0, 0.01, 0.1, 0.25, 0.5, 0.75, 1.0])
"""Grid of speeds, divided by the largest motor speed."""
EFFORTS = np.linspace(-1.6, 1.6, 33)
"""Grid of efforts, divided by the effort at which the smallest friction takes the motor's largest
torque.
"""


def with_corners(problem: Problem, robot: Robot) -> Robot:
    """Return the robot with the corners of the problem's range of friction and payload.

    The corners include the empty tip. Without a range the robot is returned unchanged.
    """
    if problem.friction is None and problem.payload is None:
        return robot
    drives = [_drives(joint, problem.friction) for joint in robot.joints]
    loaded = [with_payload(robot, mass) for mass in (0.0, *(problem.payload or ())[1:])]

    def with_drives(k: int) -> tuple[Robot, ...]:
        pairs = zip(robot.joints, drives, strict=True)
        joints = tuple(
            unchecked(joint, drive=choices[min(k, len(choices) - 2)] if k >= 0 else choices[-1])
            for joint, choices in pairs
        )
        return tuple(unchecked(load, joints=joints) for load in loaded)

    corners = [corner for k in range(max(map(len, drives)) - 1) for corner in with_drives(k)]
    return unchecked(robot, corners=tuple(corners), lightest=with_drives(-1))


def _drives(joint: Joint, share: float | None) -> tuple[Drive | None, ...]:
    """Return the drives that a motor must move, and last the drive that it must brake."""
    drive, motor = joint.drive, joint.motor
    if drive is None or motor is None or share is None:
        return (drive, drive)
    speed = min(joint.velocity * drive.ratio, motor.max_speed)
    return bounding_drives(drive, share, speed=speed, torque=motor.max_torque)


@lru_cache(maxsize=64)
def bounding_drives(
    drive: Drive, share: float, *, speed: float, torque: float
) -> tuple[Drive, ...]:
    """Return drives that bound the motor torque of all sets, and last the one that needs least.

    Parameters
    ----------
    drive : Drive
        The drive with its distribution of friction parameters.
    share : float
        Share of the equally likely sets that the range contains.
    speed, torque : float
        Largest speed (rad/s) and torque (N·m) of the motor.
    """
    sets = spread_of(drive).within(share)
    plain_drive = unchecked(
        drive,
        friction=unchecked(friction_of(drive), posterior=None, covariance=None),
        friction_ranges={},
    )
    needed = np.minimum(_torques(plain_drive, sets, speed, torque), BEYOND * torque)
    envelope = needed.max(axis=0)
    bound = np.full(needed.shape[1], -np.inf)
    selected: list[int] = []
    while len(selected) < MOST and np.max(envelope - bound) > EASE * torque:
        selected.append(int(np.argmax(needed[:, int(np.argmax(envelope - bound))])))
        bound = np.maximum(bound, needed[selected[-1]])
    beyond = 1.15 * float(np.max(envelope - bound))
    drives = [
        _raised(plain_drive, {name: float(column[k]) for name, column in sets.items()}, beyond)
        for k in selected
    ]
    smallest = {name: float(column.min()) for name, column in sets.items()}
    if LAW in smallest:
        smallest[LAW] = float(LAWS.index("coulomb"))
    return (*drives, drive_with(plain_drive, smallest))


def _raised(drive: Drive, values: dict[str, float], torque: float) -> Drive:
    """Return the drive with these friction parameters, and bearing friction raised by `torque`."""
    b_c = values.get("b_c", friction_of(drive).b_c) + torque
    return drive_with(drive, {**values, "b_c": b_c})


def _torques(drive: Drive, sets: dict[str, Array], speed: float, torque: float) -> Array:
    """Return σ τ of every set on a grid, (sets, grid points), N·m.

    The grid contains motor speeds, efforts and directions, in motion and at breakaway.
    """
    up, _ = mesh_coefficients(drive, sets.get("mu", np.array([friction_of(drive).mu])))
    speeds = {*(speed * SPEEDS).tolist()}
    speeds |= {
        factor * value
        for value in np.unique(sets.get("stribeck_speed", []))[::50]
        for factor in (0.3, 1.0, 2.0)
    }
    w, effort, direction, start = (
        grid.ravel()
        for grid in np.meshgrid(
            sorted(speeds), torque / float(np.min(up)) * EFFORTS, [-1.0, 1.0], [0.0, 1.0]
        )
    )
    keep = (start == 0.0) | (w == 0.0)
    w = w[keep]
    effort = effort[keep]
    direction = direction[keep]
    start = start[keep]
    columns = {name: column[:, None] for name, column in sets.items()}
    motion = direction * w / drive.ratio, np.zeros_like(w), direction
    torques, _ = drive_torque(
        drive_with(drive, columns), direction * effort, *motion, breakaway=start > 0
    )
    return np.asarray(
        direction * np.broadcast_to(torques, (len(next(iter(sets.values()), [0])), len(w)))
    )
