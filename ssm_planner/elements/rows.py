"""Path constraints: limits at one instant as symbolic rows (value ≤ 1), and motor costs.

The limits of a robot are parameters of the program (`joint_limits`). All other properties of the
robot are constants in the expressions (`robot_key`).
"""

from __future__ import annotations

import pickle
from collections.abc import Collection, Iterable
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
    unchecked_copy,
)
from ssm_planner.typing import Array, Arrays, frozen

UNLIMITED = 1e9
"""Value of a limit that does not exist. It is so large that its row is never active."""
LIMIT_SIZES = {
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


TIP_SPEED_INDEX = list(JACOBIANS).index(TipSpeed)
"""Index of the tip speed among the tool speeds."""


def joint_limits(robot: Robot, cooling: Array | None = None) -> Arrays:
    """Return the limits of joints and motors by their names in `LIMIT_SIZES`.

    The velocity limit is the smaller one of joint and motor.

    Parameters
    ----------
    robot : Robot
        The robot.
    cooling : (4,) array, optional
        Weight of the heat of each motor in the objective: the seconds of duration that are worth
        one second at the nominal torque. The default is 0.

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
    """Return the limits of the tool by their names in `LIMIT_SIZES`.

    Parameters
    ----------
    limits : iterable of ToolLimit
        Limits of a task. A limit that it does not contain is `UNLIMITED`.

    Returns
    -------
    dict of arrays
        `speeds` (kinds,) in SI units and in the order of `JACOBIANS`, and `stop` (1,) in m.
    """
    limits = tuple(limits)
    stop = next((limit.largest for limit in limits if isinstance(limit, StopTravel)), UNLIMITED)
    speeds = speed_bounds((limit for limit in limits if isinstance(limit, SpeedLimit)), UNLIMITED)
    return {"speeds": speeds, "stop": np.array([stop])}


def tool_row_names(limits: Iterable[ToolLimit], moving: Collection[int]) -> set[RowName]:
    """Return the names of the rows of tool limits.

    Parameters
    ----------
    limits : iterable of ToolLimit
        Limits of the tool.
    moving : collection of int
        Indices of the joints that move. Each of them has its own row for the stop travel.
    """
    names: set[RowName] = set()
    for limit in limits:
        if isinstance(limit, StopTravel):
            names |= {(limit.name, int(i)) for i in moving}
        else:
            names.add((limit.name, None))
    return names


def with_margin(robot: Robot, share: float) -> Robot:
    """Return the robot with smaller limits.

    Velocity, acceleration and motor torque are multiplied by 1 − share.
    """
    factor = 1 - share

    def reduced(joint: Joint) -> Joint:
        """Return a joint with smaller limits."""
        motor = joint.motor
        if motor is not None:
            motor = unchecked_copy(motor, max_torque=motor.max_torque * factor)
        return replace(
            joint,
            velocity=joint.velocity * factor,
            acceleration=joint.acceleration * factor,
            motor=motor,
        )

    joint_1, joint_2, joint_3, joint_4 = robot.joints
    joints = (reduced(joint_1), reduced(joint_2), reduced(joint_3), reduced(joint_4))
    return replace(robot, joints=joints)


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


BRAKING_ROW_SMOOTHING = 1e-3
"""Smoothing of the maximum of both torque functions in braking rows, relative to the limit.

The smoothed row is on the safe side.
"""
COST_SMOOTHING = 1e-2
"""The same smoothing in heat and effort, relative to the nominal torque.

The solver would oscillate at a kink of the cost.
"""


MOTORLESS_COST_WEIGHT = 1e-3
"""Weight of the accelerations of joints without a motor, so small that motors come first."""


RowName = tuple[str, int | None]
"""Name of the limit and joint of a row.

For the torque with the k-th of `Robot.actuations`, the second entry is joint + 4 k. Each of these
rows can therefore be active without the others.
"""


IndexedRow = tuple[str, int | None, int]
"""A RowName, and the index of the row in native/elements.c."""
ROWS_PER_JOINT = 10
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
    """Speeds of the tool in the order of `JACOBIANS`, (kinds,), for the velocities qd_hull."""
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
        Motion and loads at one instant.
    joints : tuple of Joint
        Joints of the robot.
    jerk : bool
        Include the rows of the jerk.
    """
    rows = speed_rows(instant)
    for i, joint in enumerate(joints):
        for sense in (1, -1) if joint.drive is None else (instant.sigma[i],):
            rows += velocity_and_stop_rows(instant, i, sense)
        rows += acceleration_rows(instant, i, jerk)
    return rows


def velocity_and_stop_rows(instant: Instant, i: int, sense: ca.SX | int) -> list[PathConstraint]:
    """Return the velocity row of joint i in one direction, and the two rows of its stop.

    With the tip speed v, the stop travel d and the acceleration limit a, the rows of the stop are
    v q̇/(2 d) ≤ a and v q̇/(2 d) − q̈ ≤ a. Here q̇ and q̈ count positive in this direction.

    Parameters
    ----------
    instant : Instant
        Motion and loads at one instant.
    i : int
        Index of the joint.
    sense : casadi.SX or int
        Direction, +1 or −1.
    """
    bounds = instant.limits
    speed = sense * instant.qd_hull[i]
    tip = instant.speeds[TIP_SPEED_INDEX] / (2 * bounds.stop)
    rows = [PathConstraint(JointVelocity.name, i, speed / bounds.velocity[i])]
    for braking in (0, -sense * instant.qdd[i]):
        value = (tip * speed + braking) / bounds.acceleration[i]
        rows.append(PathConstraint(StopTravel.name, i, value))
    return rows


def acceleration_rows(instant: Instant, i: int, jerk: bool) -> list[PathConstraint]:
    """Return the acceleration rows of joint i and, if `jerk` is true, its jerk rows."""
    rows = []
    for side in (1, -1):
        value = side * instant.qdd[i] / instant.limits.acceleration[i]
        rows.append(PathConstraint(JointAcceleration.name, i, value))
        if jerk:
            value = side * instant.qddd[i] / instant.limits.jerk[i]
            rows.append(PathConstraint(JointJerk.name, i, value))
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
        Motion and loads at one instant.
    robot : Robot
        Robot whose limits the rows represent.
    breakaway : bool
        Use the static friction coefficient, for an instant at which the joints start to move.
    """
    rows = []
    for i, k, load, drive, sides in _actuations(robot):
        torques = directed_torques(drive, instant, i, breakaway=breakaway, load=load)
        driving, braking = torque_row_values(torques, instant.limits.torque[i])
        values: list[ca.SX] = []
        if 1 in sides:
            values += driving
        if -1 in sides:
            values += braking
        rows += [PathConstraint(MotorTorque.name, i + 4 * k, value) for value in values]
    return rows


def torque_row_values(
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
    half = (torque_1 - torque_2) / (2 * limit)
    root = ca.sqrt(half**2 + BRAKING_ROW_SMOOTHING**2)
    smooth_maximum = (torque_1 + torque_2) / (2 * limit) + root - BRAKING_ROW_SMOOTHING
    return (torque_1 / limit, torque_2 / limit), (-smooth_maximum,)


Actuation = tuple[int, int, int, Drive, tuple[int, ...]]
"""A combination of drive and load.

It contains the joint, the index in `Robot.actuations`, the index of the load, the drive, and the
sides of the torque limit (1 for driving, −1 for braking).
"""


def _actuations(robot: Robot) -> list[Actuation]:
    """Return all combinations of drive and load, sorted by joint."""
    actuations = []
    for i in range(4):
        for k, (load, drive, sides) in enumerate(robot.actuations(i)):
            actuations.append((i, k, load, drive, sides))
    return actuations


def actuations_by_load(robot: Robot) -> list[Actuation]:
    """Return all combinations of drive and load, sorted by load."""
    return sorted(_actuations(robot), key=lambda item: item[2])


def indexed_torque_rows(robot: Robot, start: int) -> list[IndexedRow]:
    """Return names and indices of the rows of `torque_rows`.

    Parameters
    ----------
    robot : Robot
        Robot whose limits the rows represent.
    start : int
        Index of the first torque row in native/elements.c.
    """
    indices = {}
    for position, (i, k, *_) in enumerate(actuations_by_load(robot)):
        indices[i, k] = start + 3 * position
    rows: list[IndexedRow] = []
    for i, k, _, _, sides in _actuations(robot):
        # The two rows of a driving motor come first, then the row of a braking motor.
        offsets = ([0, 1] if 1 in sides else []) + ([2] if -1 in sides else [])
        rows += [(MotorTorque.name, i + 4 * k, indices[i, k] + offset) for offset in offsets]
    return rows


def indexed_kinematic_rows(robot: Robot, jerk: bool) -> list[IndexedRow]:
    """Return names and indices of the rows of `kinematic_rows`.

    Parameters
    ----------
    robot : Robot
        Robot whose limits the rows represent.
    jerk : bool
        Include the rows of the jerk.
    """
    rows: list[IndexedRow] = [
        (limit_class.name, None, k) for k, limit_class in enumerate(JACOBIANS)
    ]
    for i, joint in enumerate(robot.joints):
        index = len(JACOBIANS) + ROWS_PER_JOINT * i
        for side in range(2 if joint.drive is None else 1):
            names = JointVelocity.name, StopTravel.name, StopTravel.name
            rows += [(name, i, index + 3 * side + k) for k, name in enumerate(names)]
        for side in (0, 1):
            rows.append((JointAcceleration.name, i, index + 6 + 2 * side))
            if jerk:
                rows.append((JointJerk.name, i, index + 7 + 2 * side))
    return rows


def torque_row_names(robot: Robot, i: int) -> set[RowName]:
    """Return the names of the torque rows of joint i."""
    return {(MotorTorque.name, i + 4 * k) for k in range(len(robot.actuations(i)))}


def heat_cost(instant: Instant, joints: tuple[Joint, ...]) -> ca.SX:
    """Return Σ (τ_motor/τ_nominal)², to which the heat of the windings is proportional."""
    return ca.sumsqr(_relative_torques(instant, joints))


def cooling_cost(instant: Instant, joints: tuple[Joint, ...]) -> ca.SX:
    """Return Σ cooling (τ_motor/τ_nominal)², the heat of the motors with weights."""
    weights = [instant.limits.cooling[i] for i, *_ in motorised(joints)]
    return ca.dot(ca.vertcat(ca.SX(0, 1), *weights), _relative_torques(instant, joints) ** 2)


def effort_cost(instant: Instant, slow: Instant, joints: tuple[Joint, ...]) -> ca.SX:
    """Return Σ ((τ_motor − τ_slow)/τ_nominal)² + MOTORLESS_COST_WEIGHT Σ (q̈/q̈_max)².

    τ_slow is the torque of an infinitely slow motion at the same position. It overcomes friction
    and weight, which are present at any speed. If their heat counted, the cost would reward
    standing still where they are small. The second sum is over joints without a motor or drive,
    which have no torque to compare. Its weight is so small that the motors come first.

    Parameters
    ----------
    instant : Instant
        Motion and loads at one instant.
    slow : Instant
        The same instant without velocity and acceleration.
    joints : tuple of Joint
        Joints of the robot.
    """
    accelerations = [instant.qdd[i] / instant.limits.acceleration[i] for i in motorless(joints)]
    motorless_cost = MOTORLESS_COST_WEIGHT * ca.sumsqr(ca.vertcat(ca.SX(0, 1), *accelerations))
    return (
        ca.sumsqr(_relative_torques(instant, joints) - _relative_torques(slow, joints))
        + motorless_cost
    )


def _relative_torques(instant: Instant, joints: tuple[Joint, ...]) -> ca.SX:
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
        Drive of the joint.
    instant : Instant
        Motion and loads at one instant.
    i : int
        Index of the joint.
    nominal : float
        Nominal torque of the motor, N·m.
    """
    torque_1, torque_2 = directed_torques(drive, instant, i, breakaway=False)
    torque_1 = torque_1 / nominal
    torque_2 = torque_2 / nominal
    return (torque_1 + torque_2) / 2 + ca.sqrt((torque_1 - torque_2) ** 2 / 4 + COST_SMOOTHING**2)


def directed_torques(
    drive: Drive, instant: Instant, i: int, *, breakaway: bool, load: int = 0
) -> tuple[ca.SX, ca.SX]:
    """Return the two functions whose maximum is the motor torque σ τ_motor.

    Parameters
    ----------
    drive : Drive
        Drive of the joint.
    instant : Instant
        Motion and loads of all joints at one instant.
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
    tau_rigid = instant.tau_rigid[4 * load + i]
    effort = output_effort(drive, tau_rigid, instant.qd[i], instant.qdd[i], sigma)
    rows = motor_torque_rows(drive, sigma, mu)
    torque_1 = sigma * rows.torque(rows.slope[0] * effort, w, wd)
    torque_2 = sigma * rows.torque(rows.slope[1] * effort, w, wd)
    return torque_1, torque_2
