"""Drives that bound the motor torques of a whole range of friction and payload.

A problem may state a range of friction and of payload instead of single values. The planner cannot
plan for every value, so this module selects a few drives, called corners. A motion that keeps the
torque limit with each of them keeps it in the whole range.

Let σ = ±1 be the direction of motion and τ the motor torque. At every instant, σ τ is a convex
function of the load. It grows with the friction coefficient μ, with both bearing parameters and
with the preload (dynamics/transmission.py). Three rules follow:

- The load is linear in a mass at the tip, so one of the two limits of the mass is the worst case.
- Many sets of friction parameters span the range (`FrictionSpread.within`), but few of them need
  the largest torque anywhere. They are selected one after the other on a grid of motor speeds and
  efforts. The selection ends when no other set needs more than the selected ones by more than
  `ENVELOPE_TOLERANCE` of the largest torque. This remaining excess is added to their bearing
  friction.
- If the motor brakes, friction helps it. The set with the smallest value of every parameter is then
  the worst case.

An effort is the torque or force at the output of a drive.
"""

from functools import lru_cache
from itertools import product

import numpy as np

from ssm_planner.dynamics import (
    drive_torque,
    drive_with_values,
    friction_spread,
    mesh_coefficients,
    required_friction,
    with_payload,
)
from ssm_planner.problem import (
    FRICTION_LAWS,
    LAW_COLUMN,
    Drive,
    Joint,
    Problem,
    Robot,
    unchecked_copy,
)
from ssm_planner.typing import Array

ENVELOPE_TOLERANCE = 0.01
"""Share of the motor's largest torque by which a parameter set may exceed the selected sets.

A smaller value selects more sets, and every set adds rows to the optimal control problem. The
excess is added to the friction of the selected sets, so the bound stays valid with any value.
"""
STRIBECK_SPEED_COUNT = 60
"""Number of motor speeds at which Stribeck friction is evaluated, on a logarithmic scale.

Stribeck friction is a friction coefficient that falls as the speed grows from 0.
"""
RELATIVE_EFFORTS = 1.6 * np.linspace(-1.0, 1.0, 41) ** 3
"""Efforts (torque or force at the output of the drive) at which torques are evaluated, (41,).

The unit is the effort at which the motor reaches its largest torque with the least friction.
Magnitudes above 1 matter for loads that drive the motor, which need less torque. The cubes make the
grid dense at 0, where the torques have kinks.
"""


def with_corners(problem: Problem, robot: Robot) -> Robot:
    """Return the robot with the corners of the problem's range of friction and payload.

    A corner is a copy of the robot whose drives bound the motor torques of the range, with the
    largest payload or with an empty tip. `Robot.corners` contains the copies that need the most
    torque to drive, and `Robot.lightest` those that need the least, which are the worst case for a
    motor that brakes. Without a range, the robot is returned unchanged.

    Parameters
    ----------
    problem : Problem
        The problem with its range.
    robot : Robot
        The robot with its nominal friction.

    Returns
    -------
    Robot
        The robot with its corners. Its own limits and nominal values do not change.
    """
    if problem.friction is None and problem.payload is None:
        return robot
    # An empty tip, and the largest payload. `problem.payload` is the pair (smallest, largest).
    loaded = [with_payload(robot, mass) for mass in (0.0, *(problem.payload or ())[1:])]

    def with_drives(drives: list[Drive | None]) -> tuple[Robot, ...]:
        """Return one robot for each load, with the given drives of its joints."""
        pairs = zip(robot.joints, drives, strict=True)
        joints = tuple(unchecked_copy(joint, drive=drive) for joint, drive in pairs)
        return tuple(unchecked_copy(load, joints=joints) for load in loaded)

    # Each joint has its bounding drives, and as last entry the drive with the least friction.
    drives_by_joint = [_bounding_drives_of_joint(joint, problem.friction) for joint in robot.joints]
    corners: tuple[Robot, ...] = ()
    for k in range(max(map(len, drives_by_joint)) - 1):
        # Joints with fewer drives repeat their last bounding drive.
        corners += with_drives([drives[min(k, len(drives) - 2)] for drives in drives_by_joint])
    return unchecked_copy(
        robot, corners=corners, lightest=with_drives([drives[-1] for drives in drives_by_joint])
    )


def _bounding_drives_of_joint(joint: Joint, share: float | None) -> tuple[Drive | None, ...]:
    """Return the drives of a joint that need the most and the least motor torque.

    The friction of the drive is uncertain. The planner plans with these drives instead of all
    possible ones, because their torques enclose the torque of every drive in the range.

    Parameters
    ----------
    joint : Joint
        The joint with its drive and motor.
    share : float or None
        Confidence level of the range of friction: the fraction of the equally likely parameter sets
        that the range contains, between 0 and 1. None without a range in the problem.

    Returns
    -------
    tuple of Drive or None
        The drives that need the most torque, and as last one the drive that needs the least.
        Without a range, a drive or a motor, the tuple contains the joint's own drive (or None)
        twice.
    """
    drive, motor = joint.drive, joint.motor
    if drive is None or motor is None or share is None:
        return (drive, drive)
    speed = min(joint.velocity * drive.ratio, motor.max_speed)
    return bounding_drives(drive, share, speed=speed, torque=motor.max_torque)


@lru_cache(maxsize=64)
def bounding_drives(
    drive: Drive, share: float, *, speed: float, torque: float
) -> tuple[Drive, ...]:
    """Select the drives that bound the motor torque of a range of friction parameters.

    The selection is greedy. It looks for the grid point (speed and effort) at which the selected
    parameter sets fall short of the largest torque most, and adds the set that needs this torque.
    It ends when they fall short nowhere by more than `ENVELOPE_TOLERANCE` of the motor's largest
    torque.

    Parameters
    ----------
    drive : Drive
        The drive with its distribution of friction parameters.
    share : float
        Fraction of the equally likely parameter sets that the range contains, between 0 and 1.
    speed, torque : float
        Largest speed (rad/s) and torque (N·m) of the motor.

    Returns
    -------
    tuple of Drive
        The drives that need the most torque, and as last one the drive that needs the least.
    """
    sets = friction_spread(drive).within(share)
    friction = required_friction(drive)
    without_spread = unchecked_copy(friction, posterior=None, covariance=None)
    plain_drive = unchecked_copy(drive, friction=without_spread, friction_ranges={})
    # A torque above the motor's largest one is infeasible, however much larger it is.
    torques = np.minimum(_torque_table(plain_drive, sets, speed, torque), torque)
    # The largest torque of all sets, and of the selected sets, at each grid point.
    envelope = torques.max(axis=0)
    bound = np.full(len(envelope), -np.inf)
    selected: list[int] = []
    while np.max(envelope - bound) > ENVELOPE_TOLERANCE * torque:
        worst = np.argmax(envelope - bound)
        selected.append(int(np.argmax(torques[:, worst])))
        bound = np.maximum(bound, torques[selected[-1]])
    # The excess may be larger between the grid points. The factor 1.15 is an allowance for that.
    excess = 1.15 * float(np.max(envelope - bound))
    drives = []
    for k in selected:
        values = {name: float(column[k]) for name, column in sets.items()}
        values["b_c"] = values.get("b_c", friction.b_c) + excess
        drives.append(drive_with_values(plain_drive, values))
    # The smallest values need the least torque. The Coulomb law is a μ that does not vary with
    # speed.
    smallest = {name: float(column.min()) for name, column in sets.items()}
    if LAW_COLUMN in smallest:
        smallest[LAW_COLUMN] = float(FRICTION_LAWS.index("coulomb"))
    return (*drives, drive_with_values(plain_drive, smallest))


def _torque_table(drive: Drive, sets: dict[str, Array], speed: float, torque: float) -> Array:
    """Compute the motor torques σ τ of all sets of friction parameters on a grid.

    σ = ±1 is the direction of motion, and τ the torque of the motor.

    A grid point is a motor speed, an effort (torque or force at the output) and a direction, in
    motion or at breakaway. The torque is linear in the speed, so few speeds suffice. Only Stribeck
    friction, where μ falls as the speed grows from 0, needs more of them.

    Parameters
    ----------
    drive : Drive
        The drive.
    sets : dict of (sets,) arrays
        Values of each friction parameter, by name. A set is one combination of values of all
        friction parameters.
    speed, torque : float
        Largest speed (rad/s) and torque (N·m) of the motor.

    Returns
    -------
    (sets, grid points) array
        Motor torques in the direction of motion, N·m. Negative where the motor brakes.
    """
    raising_coefficients, _ = mesh_coefficients(
        drive, sets.get("mu", np.array([required_friction(drive).mu]))
    )
    # The coefficients are the torques per effort of a load that opposes the motion.
    efforts = torque / float(np.min(raising_coefficients)) * RELATIVE_EFFORTS
    speeds = np.linspace(0.0, speed, 5)
    if "stribeck_speed" in sets:
        stribeck = sets["stribeck_speed"]
        lowest, highest = stribeck.min() / 10, 3 * stribeck.max()
        speeds = np.append(speeds, np.geomspace(lowest, highest, STRIBECK_SPEED_COUNT))
    # A state is a motor speed (rad/s) and a flag, which is True at breakaway.
    states = [(0.0, True), *((w, False) for w in speeds.tolist())]
    grid = [(*state, effort, sign) for state, effort, sign in product(states, efforts, (-1.0, 1.0))]
    w, start, effort, direction = np.array(grid).T
    # Columns (sets, 1) of parameters broadcast against the grid to one row of torques for each set.
    drive_of_sets = drive_with_values(
        drive, {name: column[:, None] for name, column in sets.items()}
    )
    torques, _ = drive_torque(
        drive_of_sets,
        direction * effort,
        direction * w / drive.ratio,
        np.zeros_like(w),
        direction,
        breakaway=start > 0,
    )
    return np.atleast_2d(direction * torques)
