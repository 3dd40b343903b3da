"""Robots that bound a range of friction and payload: a motion whose torques hold with each of them holds within it.

In a direction of motion σ the motor torque σ τ is, for every instant, a convex function of the load, and grows with μ,
with both bearing figures and with the preload (dynamics/transmission.py). So

* a mass at the tip, in which the load is linear, is worst at one end of its range;
* of the sets of friction parameters that span the range (`FrictionSpread.within`), few are the worst anywhere. They are
  found one after the other on a grid of speeds and efforts that the motor can meet, the worst left out first, until the
  others exceed them by no more than EASE of its largest torque; what is left is added to their bearing friction;
* braking is bounded by the least of every parameter at once.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ssm_planner.dynamics.friction import friction_of
from ssm_planner.dynamics.motors import drive_torque
from ssm_planner.dynamics.rigid_body import with_payload
from ssm_planner.dynamics.spread import drawn, spread_of
from ssm_planner.dynamics.transmission import mesh_coefficients
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.posterior import LAW, LAWS
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Joint, Robot
from ssm_planner.problem.value import unchecked
from ssm_planner.typing import Array

EASE = 0.01
"""Share of the largest torque by which a set may exceed the chosen ones before these are raised."""
BEYOND = 1.1
"""Largest torques up to which sets are told apart."""
MOST = 8
"""Sets chosen for a drive."""
SPEEDS = np.array([0.0, 0.01, 0.1, 0.25, 0.5, 0.75, 1.0])
"""Of the largest motor speed."""
EFFORTS = np.linspace(-1.6, 1.6, 33)
"""Of the effort at which the least friction takes the motor's largest torque."""


def with_corners(problem: Problem, robot: Robot) -> Robot:
    """The robot with the corners of the problem's range of friction and payload, from an empty tip on; itself without one."""
    if problem.friction is None and problem.payload is None:
        return robot
    drives = [_drives(joint, problem.friction) for joint in robot.joints]
    loaded = [with_payload(robot, mass) for mass in (0.0, *(problem.payload or ())[1:])]

    def with_drives(k: int) -> tuple[Robot, ...]:
        pairs = zip(robot.joints, drives, strict=True)
        joints = tuple(
            unchecked(joint, drive=each[min(k, len(each) - 2)] if k >= 0 else each[-1])
            for joint, each in pairs
        )
        return tuple(unchecked(each, joints=joints) for each in loaded)

    corners = [corner for k in range(max(map(len, drives)) - 1) for corner in with_drives(k)]
    return unchecked(robot, corners=tuple(corners), lightest=with_drives(-1))


def _drives(joint: Joint, share: float | None) -> tuple[Drive | None, ...]:
    """The drives of a joint with which its motor has to manage, and last the one with which it has to brake."""
    drive, motor = joint.drive, joint.motor
    if drive is None or motor is None or share is None:
        return (drive, drive)
    speed = min(joint.velocity * drive.ratio, motor.max_speed)
    return bounding_drives(drive, share, speed=speed, torque=motor.max_torque)


@lru_cache(maxsize=64)
def bounding_drives(
    drive: Drive, share: float, *, speed: float, torque: float
) -> tuple[Drive, ...]:
    """Drives that together take at least the motor torque of every set within the share, and a last one that takes least.

    speed (rad/s) and torque (N·m): of the motor, the largest.
    """
    sets = spread_of(drive).within(share)
    bare = unchecked(
        drive,
        friction=unchecked(friction_of(drive), posterior=None, covariance=None),
        friction_ranges={},
    )
    needed = np.minimum(_torques(bare, sets, speed, torque), BEYOND * torque)
    envelope, reached = needed.max(axis=0), np.full(needed.shape[1], -np.inf)
    chosen: list[int] = []
    while len(chosen) < MOST and np.max(envelope - reached) > EASE * torque:
        chosen.append(int(np.argmax(needed[:, int(np.argmax(envelope - reached))])))
        reached = np.maximum(reached, needed[chosen[-1]])
    beyond = 1.15 * float(np.max(envelope - reached))
    found = [
        _raised(bare, {name: float(column[k]) for name, column in sets.items()}, beyond)
        for k in chosen
    ]
    least = {name: float(column.min()) for name, column in sets.items()}
    if LAW in least:
        least[LAW] = float(LAWS.index("coulomb"))
    return (*found, drawn(bare, least))


def _raised(drive: Drive, values: dict[str, float], torque: float) -> Drive:
    b_c = values.get("b_c", friction_of(drive).b_c) + torque
    return drawn(drive, {**values, "b_c": b_c})


def _torques(drive: Drive, sets: dict[str, Array], speed: float, torque: float) -> Array:
    """σ τ of every set (rows) at a grid of motor speeds, efforts and directions, moving and breaking away."""
    up, _ = mesh_coefficients(drive, sets.get("mu", np.array([friction_of(drive).mu])))
    at = {*(speed * SPEEDS).tolist()}
    at |= {
        factor * value
        for value in np.unique(sets.get("stribeck_speed", []))[::100]
        for factor in (0.3, 1.0, 2.0)
    }
    w, effort, way, start = (
        grid.ravel()
        for grid in np.meshgrid(
            sorted(at), torque / float(np.min(up)) * EFFORTS, [-1.0, 1.0], [0.0, 1.0]
        )
    )
    keep = (start == 0.0) | (w == 0.0)
    w, effort, way, start = w[keep], effort[keep], way[keep], start[keep]
    columns = {name: column[:, None] for name, column in sets.items()}
    motion = way * w / drive.ratio, np.zeros_like(w), way
    taken, _ = drive_torque(drawn(drive, columns), way * effort, *motion, breakaway=start > 0)
    return np.asarray(way * np.broadcast_to(taken, (len(next(iter(sets.values()), [0])), len(w))))
