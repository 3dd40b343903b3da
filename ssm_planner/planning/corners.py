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
from itertools import product

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
    loaded = [with_payload(robot, mass) for mass in (0.0, *(problem.payload or ())[1:])]

    def with_drives(drives: list[Drive | None]) -> tuple[Robot, ...]:
        pairs = zip(robot.joints, drives, strict=True)
        joints = tuple(unchecked(joint, drive=drive) for joint, drive in pairs)
        return tuple(unchecked(load, joints=joints) for load in loaded)

    bounding = [_drives(joint, problem.friction) for joint in robot.joints]
    corners: tuple[Robot, ...] = ()
    for k in range(max(map(len, bounding)) - 1):
        corners += with_drives([drives[min(k, len(drives) - 2)] for drives in bounding])
    return unchecked(
        robot, corners=corners, lightest=with_drives([drives[-1] for drives in bounding])
    )


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
    friction = friction_of(drive)
    without_spread = unchecked(friction, posterior=None, covariance=None)
    plain_drive = unchecked(drive, friction=without_spread, friction_ranges={})
    needed = np.minimum(_torques(plain_drive, sets, speed, torque), torque)
    envelope = needed.max(axis=0)
    bound = np.full(len(envelope), -np.inf)
    selected: list[int] = []
    while np.max(envelope - bound) > EASE * torque:
        worst = np.argmax(envelope - bound)
        selected.append(int(np.argmax(needed[:, worst])))
        bound = np.maximum(bound, needed[selected[-1]])
    excess = 1.15 * float(np.max(envelope - bound))
    drives = []
    for k in selected:
        values = {name: float(column[k]) for name, column in sets.items()}
        values["b_c"] = values.get("b_c", friction.b_c) + excess
        drives.append(drive_with(plain_drive, values))
    smallest = {name: float(column.min()) for name, column in sets.items()}
    if LAW in smallest:
        smallest[LAW] = float(LAWS.index("coulomb"))
    return (*drives, drive_with(plain_drive, smallest))


def _torques(drive: Drive, sets: dict[str, Array], speed: float, torque: float) -> Array:
    """Return σ τ of every set on a grid, (sets, grid points), N·m.

    The grid contains motor speeds, efforts and directions, in motion and at breakaway. Apart from
    Stribeck friction, the torque is linear in the speed.
    """
    up, _ = mesh_coefficients(drive, sets.get("mu", np.array([friction_of(drive).mu])))
    efforts = torque / float(np.min(up)) * EFFORTS
    stribeck = np.unique(sets.get("stribeck_speed", []))[::50]
    speeds = np.concatenate([np.linspace(0.0, speed, 5), 0.3 * stribeck, stribeck, 2 * stribeck])
    states = [(0.0, True), *((w, False) for w in speeds.tolist())]
    grid = [(*state, effort, sign) for state, effort, sign in product(states, efforts, (-1.0, 1.0))]
    w, start, effort, direction = np.array(grid).T
    of_sets = drive_with(drive, {name: column[:, None] for name, column in sets.items()})
    torques, _ = drive_torque(
        of_sets,
        direction * effort,
        direction * w / drive.ratio,
        np.zeros_like(w),
        direction,
        breakaway=start > 0,
    )
    return np.atleast_2d(direction * torques)
