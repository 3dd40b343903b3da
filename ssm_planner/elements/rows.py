"""Path constraints: limits at one instant as symbolic rows (value ≤ 1), and motor costs.

The limits of a robot are parameters of the program (`joint_limits`). All other properties of the
robot are constants in the expressions (`robot_key`).
"""

from __future__ import annotations

import pickle
from collections.abc import Iterable
from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np

from ssm_planner.dynamics import (
    breakaway_coefficient,
    friction_coefficient,
    friction_of,
    motor_torque_rows,
    motorised,
    motorless,
    output_effort,
)
from ssm_planner.kinematics import JACOBIANS, speed_bounds
from ssm_planner.problem import (
    Drive,
    Joint,
    JointAcceleration,
    JointJerk,
    JointVelocity,
    MotorTorque,
    Robot,
    SpeedLimit,
    StopTravel,
    TipSpeed,
    ToolLimit,
    unchecked,
)
from ssm_planner.typing import Array, Arrays, frozen

UNLIMITED = 1e9
"""Value of a limit that does not exist. It is so large that its row is never active."""
LIMITS = {
    "velocity": 4,
    "acceleration": 4,
    "jerk": 4,
    "torque": 4,
    "cooling": 4,
    "speeds": len(JACOBIANS),
    "stop": 1,
}
"""Names and lengths of the limits that are parameters: of joints, motors, tool speeds and stops.

`cooling` is not a limit. It is the cost of one second of a motor at its nominal torque, in seconds.
"""


TIP = list(JACOBIANS).index(TipSpeed)
"""Index of the tip speed among the tool speeds."""


def joint_limits(robot: Robot, cooling: Array | None = None) -> Arrays:
    """Return the limits of joints and motors by their names in LIMITS.

    The velocity limit is the smaller one of joint and motor.

    Parameters
    ----------
    robot : Robot
    cooling : (4,) array, optional
        Cost of one second of each motor at its nominal torque, s. The default is 0.

    Returns
    -------
    dict of (4,) arrays
        Limits in SI units.
    """
    joints = robot.joints
    limits = {
        "velocity": robot.velocities,
        "acceleration": robot.accelerations,
        "jerk": np.array([UNLIMITED if joint.jerk is None else joint.jerk for joint in joints]),
        "torque": np.full(4, UNLIMITED),
        "cooling": np.zeros(4) if cooling is None else cooling,
    }
    for i, drive, motor in motorised(joints):
        limits["velocity"][i] = min(limits["velocity"][i], motor.max_speed / drive.ratio)
        limits["torque"][i] = motor.max_torque
    return limits


def tool_limits(limits: Iterable[ToolLimit]) -> Arrays:
    """Return the limits of the tool by their names in LIMITS.

    Parameters
    ----------
    limits : iterable of ToolLimit
        Limits of a task. A limit that it does not contain is UNLIMITED.

    Returns
    -------
    dict of arrays
        `speeds` (kinds,) in SI units and in the order of JACOBIANS, and `stop` (1,) in m.
    """
    limits = tuple(limits)
    stop = next((limit.largest for limit in limits if isinstance(limit, StopTravel)), UNLIMITED)
    speeds = speed_bounds((limit for limit in limits if isinstance(limit, SpeedLimit)), UNLIMITED)
    return {"speeds": speeds, "stop": np.array([stop])}


def tool_names(limits: Iterable[ToolLimit], moving: Iterable[int]) -> set[RowName]:
    """Return the names of the rows of tool limits.

    Parameters
    ----------
    limits : iterable of ToolLimit
    moving : iterable of int
        Indices of the joints that move. Each of them has its own row for the stop travel.
    """
    joints = {limit.name: moving if isinstance(limit, StopTravel) else (None,) for limit in limits}
    return {
        (name, None if i is None else int(i)) for name, indices in joints.items() for i in indices
    }


def with_margin(robot: Robot, share: float) -> Robot:
    """Return the robot with smaller limits.

    Velocity, acceleration and motor torque are multiplied by 1 − share.
    """
    factor = 1 - share

    def reduced(joint: Joint) -> Joint:
        """Return a joint with smaller limits."""
        motor = (
            None
            if joint.motor is None
            else unchecked(joint.motor, max_torque=joint.motor.max_torque * factor)
        )
        return replace(
            joint,
            velocity=joint.velocity * factor,
            acceleration=joint.acceleration * factor,
            motor=motor,
        )

    joint_1, joint_2, joint_3, joint_4 = map(reduced, robot.joints)
    return replace(robot, joints=(joint_1, joint_2, joint_3, joint_4))


def robot_key(robot: Robot) -> bytes:
    """Return a key of all properties of a robot that are constants in an element model.

    These are geometry, bodies, gravity, drives and nominal torques. Limits are parameters. If two
    keys are equal, the robots have the same properties. The reverse need not hold, which only costs
    time.
    """
    drives = [joint.drive for joint in robot.joints]
    nominal = [
        None if joint.motor is None else joint.motor.nominal_torque for joint in robot.joints
    ]
    loads = [load.bodies for load in robot.loads]
    actuations = [robot.actuations(i) for i in range(4)] if robot.corners else None
    return pickle.dumps(
        (robot.geometry, robot.bodies, robot.gravity, drives, nominal, loads, actuations)
    )


def limits_jerk(robot: Robot) -> bool:
    """Return True if any joint has a jerk limit."""
    return any(joint.jerk is not None for joint in robot.joints)


BRAKING_SOFTNESS = 1e-3
"""Smoothing of the maximum of both torque functions in braking rows, relative to the limit.

The smoothed row is on the safe side.
"""
COST_SOFTNESS = 1e-2
"""The same smoothing in heat and effort, relative to the nominal torque.

The solver would oscillate at a kink of the cost.
"""


ACCELERATION_SHARE = 1e-3
"""Weight of the accelerations of joints without a motor, so small that motors come first."""


RowName = tuple[str, int | None]
"""Name of the limit and joint of a row.

For the torque with the k-th of `Robot.actuations`, the second entry is joint + 4 k. Each of these
rows can therefore be active without the others.
"""


RowPlace = tuple[str, int | None, int]
"""A RowName, and the index of the row in native/elements.c."""
JOINT_ROWS = 10
"""Number of rows of one joint along a path.

There are one row of the velocity and two rows of the stop in either direction, and one row each of
the acceleration and the jerk in either direction.
"""


@frozen
class PathConstraint:
    """One scaled inequality: value ≤ 1 keeps the limit `name` of `joint`.

    The joint has the form of the second entry of RowName. It is None for the whole arm.
    """

    name: str
    joint: int | None
    value: ca.SX


@frozen
class Instant:
    """Symbolic state of all joints at one instant, in SI units.

    All expressions have the shape (4,) unless stated otherwise.

    Attributes
    ----------
    qd, qdd, qddd : casadi.SX
        Velocities, accelerations and jerks.
    sigma : casadi.SX
        Direction of each joint: +1, −1, or 0 for a joint that does not move.
    """

    qd: ca.SX
    qd_hull: ca.SX
    """Velocities in the velocity rows.

    They are Bernstein coefficients, see `StraightElement.collocation_states`.
    """
    qdd: ca.SX
    qddd: ca.SX
    tau_rigid: ca.SX
    """Joint torques without friction, (4 loads,), one load of `Robot.loads` after the other."""
    speeds: ca.SX
    """Speeds of the tool in the order of JACOBIANS, (kinds,), for the velocities qd_hull."""
    sigma: ca.SX
    limits: SimpleNamespace
    """LIMITS as expressions, so that one program serves all values.

    The torque limit of a joint without a motor is unused.
    """


def kinematic_rows(instant: Instant, joints: tuple[Joint, ...], jerk: bool) -> list[PathConstraint]:
    """Return the rows of all kinematic limits along a path.

    They are the tool speeds, and the velocity, acceleration, jerk and stop of every joint. The rows
    of stops are those of `retiming.constraints.braking_travel`.

    Parameters
    ----------
    instant : Instant
    joints : tuple of Joint
    jerk : bool
        Include the rows of the jerk.
    """
    rows = speed_rows(instant)
    for i, joint in enumerate(joints):
        for sense in (1, -1) if joint.drive is None else (instant.sigma[i],):
            rows += sense_rows(instant, i, sense)
        rows += acceleration_rows(instant, i, jerk)
    return rows


def sense_rows(instant: Instant, i: int, sense: ca.SX | int) -> list[PathConstraint]:
    """Return the velocity row of joint i in one direction, and the two rows of its stop.

    With the tip speed v, the stop travel d and the acceleration limit a, the rows of the stop are
    v q̇/(2 d) ≤ a and v q̇/(2 d) − q̈ ≤ a. Here q̇ and q̈ count positive in this direction.

    Parameters
    ----------
    instant : Instant
    i : int
        Index of the joint.
    sense : casadi.SX or int
        Direction, +1 or −1.
    """
    bounds, speed = instant.limits, sense * instant.qd_hull[i]
    tip = instant.speeds[TIP] / (2 * bounds.stop)
    rows = [PathConstraint(JointVelocity.name, i, speed / bounds.velocity[i])]
    for braking in (0, -sense * instant.qdd[i]):
        rows.append(
            PathConstraint(StopTravel.name, i, (tip * speed + braking) / bounds.acceleration[i])
        )
    return rows


def acceleration_rows(instant: Instant, i: int, jerk: bool) -> list[PathConstraint]:
    """Return the acceleration rows of joint i and, if `jerk` is true, its jerk rows."""
    rows = []
    for side in (1, -1):
        rows.append(
            PathConstraint(
                JointAcceleration.name, i, side * instant.qdd[i] / instant.limits.acceleration[i]
            )
        )
        if jerk:
            rows.append(
                PathConstraint(JointJerk.name, i, side * instant.qddd[i] / instant.limits.jerk[i])
            )
    return rows


def speed_rows(instant: Instant) -> list[PathConstraint]:
    """Return the rows of all tool speeds that a problem may limit."""
    return [
        PathConstraint(limit_class.name, None, instant.speeds[k] / instant.limits.speeds[k])
        for k, limit_class in enumerate(JACOBIANS)
    ]


def torque_rows(instant: Instant, robot: Robot, *, breakaway: bool = False) -> list[PathConstraint]:
    """Return the torque rows of every motor, with exact friction in the direction of motion.

    Rows at the corners of a range of friction are included.

    Parameters
    ----------
    instant : Instant
    robot : Robot
    breakaway : bool
        Use the static friction coefficient, for an instant at which the joints start to move.
    """
    rows = []
    actuations = [(i, k, *item) for i in range(4) for k, item in enumerate(robot.actuations(i))]
    for i, k, load, drive, sides in actuations:
        torques = directed_torques(drive, instant, i, breakaway=breakaway, load=load)
        driving, braking = sides_of_torque(torques, instant.limits.torque[i])
        values = [*(driving if 1 in sides else ()), *(braking if -1 in sides else ())]
        rows += [PathConstraint(MotorTorque.name, i + 4 * k, value) for value in values]
    return rows


def sides_of_torque(
    torques: tuple[ca.SX, ca.SX], limit: ca.SX
) -> tuple[tuple[ca.SX, ca.SX], tuple[ca.SX]]:
    """Return the row values of a driving and of a braking motor.

    The torque σ τ in the direction of motion is the larger one of two functions. It is at most the
    limit if both functions are. It is at least −limit if the larger one is, which a smooth maximum
    expresses. This maximum never exceeds the exact one, so the row is on the safe side.

    Parameters
    ----------
    torques : tuple of two casadi.SX
        The functions, see `directed_torques`.
    limit : casadi.SX
        Torque limit, N·m.

    Returns
    -------
    driving : tuple of two casadi.SX
    braking : tuple of one casadi.SX
    """
    torque_1, torque_2 = torques
    # The smooth maximum in `resisting` never exceeds the exact one.
    half, soft = (torque_1 - torque_2) / (2 * limit), BRAKING_SOFTNESS
    resisting = (torque_1 + torque_2) / (2 * limit) + ca.sqrt(half**2 + soft**2) - soft
    return (torque_1 / limit, torque_2 / limit), (-resisting,)


def actuations_by_load(robot: Robot) -> list[tuple[int, int, int, Drive, tuple[int, ...]]]:
    """Return all combinations of drive and load, sorted by load.

    Each entry contains the joint, the index in `Robot.actuations`, the index of the load, the
    drive, and the sides of the torque limit (1 for driving, −1 for braking).
    """
    actuations = [(i, k, *item) for i in range(4) for k, item in enumerate(robot.actuations(i))]
    return sorted(actuations, key=lambda item: item[2])


def torque_places(robot: Robot, start: int) -> list[RowPlace]:
    """Return names and indices of the rows of `torque_rows`.

    Parameters
    ----------
    robot : Robot
    start : int
        Index of the first torque row in native/elements.c.
    """
    indices = {item[:2]: start + 3 * index for index, item in enumerate(actuations_by_load(robot))}
    return [
        (MotorTorque.name, i + 4 * k, indices[i, k] + side)
        for i in range(4)
        for k, (*_, sides) in enumerate(robot.actuations(i))
        for side in [0, 1] * (1 in sides) + [2] * (-1 in sides)
    ]


def joint_places(robot: Robot, jerk: bool) -> list[RowPlace]:
    """Return names and indices of the rows of `kinematic_rows`.

    Parameters
    ----------
    robot : Robot
    jerk : bool
        Include the rows of the jerk.
    """
    rows: list[RowPlace] = [(limit_class.name, None, k) for k, limit_class in enumerate(JACOBIANS)]
    for i, joint in enumerate(robot.joints):
        index = len(JACOBIANS) + JOINT_ROWS * i
        for side in range(2 if joint.drive is None else 1):
            names = JointVelocity.name, StopTravel.name, StopTravel.name
            rows += [(name, i, index + 3 * side + k) for k, name in enumerate(names)]
        for side in (0, 1):
            rows.append((JointAcceleration.name, i, index + 6 + 2 * side))
            rows += [(JointJerk.name, i, index + 7 + 2 * side)] * jerk
    return rows


def torque_names(robot: Robot, i: int) -> set[RowName]:
    """Return the names of the torque rows of joint i."""
    return {(MotorTorque.name, i + 4 * k) for k in range(len(robot.actuations(i)))}


def heat(instant: Instant, joints: tuple[Joint, ...]) -> ca.SX:
    """Return Σ (τ_motor/τ_nominal)², to which the heat of the windings is proportional."""
    return ca.sumsqr(_torques(instant, joints))


def cooling(instant: Instant, joints: tuple[Joint, ...]) -> ca.SX:
    """Return Σ cooling (τ_motor/τ_nominal)², the heat of the motors with weights."""
    weights = ca.vertcat(ca.SX(0, 1), *(instant.limits.cooling[i] for i, *_ in motorised(joints)))
    return ca.dot(weights, _torques(instant, joints) ** 2)


def effort(instant: Instant, slow: Instant, joints: tuple[Joint, ...]) -> ca.SX:
    """Return Σ ((τ_motor − τ_slow)/τ_nominal)² + ACCELERATION_SHARE Σ (q̈/q̈_max)².

    τ_slow is the torque of an infinitely slow motion at the same position. It overcomes friction
    and weight, which are present at any speed. If their heat counted, the cost would reward
    standing still where they are small. The second sum is over joints without a motor or drive,
    which have no torque to compare. Its weight is so small that the motors come first.

    Parameters
    ----------
    instant : Instant
    slow : Instant
        The same instant without velocity and acceleration.
    joints : tuple of Joint
    """
    accelerations = (instant.qdd[i] / instant.limits.acceleration[i] for i in motorless(joints))
    motorless_cost = ACCELERATION_SHARE * ca.sumsqr(ca.vertcat(ca.SX(0, 1), *accelerations))
    return ca.sumsqr(_torques(instant, joints) - _torques(slow, joints)) + motorless_cost


def _torques(instant: Instant, joints: tuple[Joint, ...]) -> ca.SX:
    """Return σ τ_motor/τ_nominal of every motor, (motors,), with a smooth maximum."""
    values = [
        smooth_torque(drive, instant, i, motor.nominal_torque)
        for i, drive, motor in motorised(joints)
    ]
    return ca.vertcat(ca.SX(0, 1), *values)


def smooth_torque(drive: Drive, instant: Instant, i: int, nominal: float) -> ca.SX:
    """Return σ τ_motor/τ_nominal of joint i.

    The exact torque is the larger one of two functions. A smooth function replaces this maximum:

        max(a, b) ≈ (a + b)/2 + √((a − b)²/4 + COST_SOFTNESS²).

    Parameters
    ----------
    drive : Drive
    instant : Instant
    i : int
        Index of the joint.
    nominal : float
        Nominal torque of the motor, N·m.
    """
    torque_1, torque_2 = (
        side / nominal for side in directed_torques(drive, instant, i, breakaway=False)
    )
    return (torque_1 + torque_2) / 2 + ca.sqrt((torque_1 - torque_2) ** 2 / 4 + COST_SOFTNESS**2)


def directed_torques(
    drive: Drive, instant: Instant, i: int, *, breakaway: bool, load: int = 0
) -> tuple[ca.SX, ca.SX]:
    """Return the two functions whose maximum is the motor torque σ τ_motor.

    Parameters
    ----------
    drive : Drive
    instant : Instant
    i : int
        Index of the joint.
    breakaway : bool
        Use the static friction coefficient.
    load : int
        Index of the payload.

    Returns
    -------
    tuple of two casadi.SX
        Torques in the direction of motion, N·m. Both are 0 for a joint that does not move.
    """
    friction = friction_of(drive)
    sigma = instant.sigma[i]
    w = drive.ratio * instant.qd[i]
    wd = drive.ratio * instant.qdd[i]
    mu = breakaway_coefficient(friction) if breakaway else friction_coefficient(friction, sigma * w)
    effort = output_effort(
        drive, instant.tau_rigid[4 * load + i], instant.qd[i], instant.qdd[i], sigma
    )
    rows = motor_torque_rows(drive, sigma, mu)
    torque_1, torque_2 = (sigma * rows.torque(slope * effort, w, wd) for slope in rows.slope)
    return torque_1, torque_2
