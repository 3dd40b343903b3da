"""Limits of a motion at one instant as symbolic path constraints, and the costs of the motors.

A path constraint, also called a row, is a scaled expression that must not exceed 1, for example
|q̇_i| / limit_i. The element models (`free_element`, `straight_element`) build their constraints
from the functions of this module, with CasADi symbols for the motion (`Instant`). The limits of a
robot are parameters of the optimisation problem (program), so one program serves robots with
different limits (`joint_limits`). All other properties of the robot are constants in the
expressions (`robot_key`).
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
    joints_without_motor,
    motor_torque_rows,
    motorised_joints,
    output_effort,
    required_friction,
)
from ssm_planner.kinematics import SPEED_JACOBIANS, speed_bounds
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
"""Value that stands for a missing limit, in any unit. No motion of a robot reaches it."""
LIMIT_SIZES = {
    "velocity": 4,
    "acceleration": 4,
    "jerk": 4,
    "torque": 4,
    "cooling": 4,
    "speeds": len(SPEED_JACOBIANS),
    "stop": 1,
}
"""Names and lengths of the vectors of limits that are parameters of the optimisation problem.

Their values are in SI units. `velocity`, `acceleration` and `jerk` are limits of the joints.
`torque` contains the largest motor torques, `speeds` the largest speeds of the tool, and `stop` the
largest distance in m that the tip may travel while the robot stops. `cooling` is not a limit. It
contains the weights of the heat of the motors. A weight is the duration in s that is worth one
second of the motor at its nominal torque.
"""


TIP_SPEED_INDEX = list(SPEED_JACOBIANS).index(TipSpeed)
"""Index of the speed of the tip in `speeds`, which has the order of `SPEED_JACOBIANS`."""


def joint_limits(robot: Robot, cooling: Array | None = None) -> Arrays:
    """Collect the limits of joints and motors, which are parameters of the optimisation problem.

    The velocity limit of a joint is the smaller one of its own limit and of the one that follows
    from the largest speed of its motor. Missing limits are `UNLIMITED`.

    Parameters
    ----------
    robot : Robot
        The robot.
    cooling : (4,) array, optional
        Weights of the heat of the motors in the objective, s. A weight is the duration that is
        worth one second of the motor at its nominal torque. The default is 0.

    Returns
    -------
    dict of (4,) arrays
        Limits in SI units, and the weights, by the names in `LIMIT_SIZES`.
    """
    joints = robot.joints
    limits = {
        "velocity": robot.velocities,
        "acceleration": robot.accelerations,
        "jerk": np.array([UNLIMITED if joint.jerk is None else joint.jerk for joint in joints]),
        "torque": np.full(4, UNLIMITED),
        "cooling": np.zeros(4) if cooling is None else cooling,
    }
    for i, drive, motor in motorised_joints(joints):
        limits["velocity"][i] = min(limits["velocity"][i], motor.max_speed / drive.ratio)
        limits["torque"][i] = motor.max_torque
    return limits


def tool_limits(limits: Iterable[ToolLimit]) -> Arrays:
    """Collect the limits of the tool, which are parameters of the optimisation problem.

    Parameters
    ----------
    limits : iterable of ToolLimit
        Limits of a task. Missing limits are `UNLIMITED` in the result.

    Returns
    -------
    dict of arrays
        `speeds` (k,) in SI units, one for each of `SPEED_JACOBIANS`, and `stop` (1,), the largest
        distance that the tip may travel while the robot stops, m.
    """
    limits = tuple(limits)
    stop = next((limit.largest for limit in limits if isinstance(limit, StopTravel)), UNLIMITED)
    speeds = speed_bounds((limit for limit in limits if isinstance(limit, SpeedLimit)), UNLIMITED)
    return {"speeds": speeds, "stop": np.array([stop])}


def with_margin(robot: Robot, share: float) -> Robot:
    """Return the robot with smaller limits, for motions that shall not reach the true limits.

    Parameters
    ----------
    robot : Robot
        The robot.
    share : float
        Share by which the limits of velocity, acceleration and motor torque are reduced.

    Returns
    -------
    Robot
        The changed robot.
    """
    factor = 1 - share

    def reduced(joint: Joint) -> Joint:
        """Return a joint with smaller limits of velocity, acceleration and motor torque."""
        motor = joint.motor
        if motor is not None:
            motor = unchecked_copy(motor, max_torque=motor.max_torque * factor)
        return replace(
            joint,
            velocity=joint.velocity * factor,
            acceleration=joint.acceleration * factor,
            motor=motor,
        )

    joint_1, joint_2, joint_3, joint_4 = map(reduced, robot.joints)
    return replace(robot, joints=(joint_1, joint_2, joint_3, joint_4))


def robot_key(robot: Robot) -> bytes:
    """Compute a key of all properties of a robot that are constants in the path constraints.

    These are geometry, bodies, gravity, drives and nominal torques. Limits are not among them,
    because they are parameters. Two robots with the same key can share their CasADi Functions.

    Parameters
    ----------
    robot : Robot
        The robot.

    Returns
    -------
    bytes
        The key. Equal keys mean equal properties. Robots with equal properties may have different
        keys, and the Functions are then built twice.
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
    """Return whether any joint of a robot has a jerk limit.

    Parameters
    ----------
    robot : Robot
        The robot.

    Returns
    -------
    bool
        True if at least one joint has such a limit.
    """
    return any(joint.jerk is not None for joint in robot.joints)


BRAKING_ROW_SMOOTHING = 1e-3
"""Width of the smooth transition in the rows of braking motors, as a share of the torque limit.

A smooth function replaces the maximum of two torques in these rows, because the solver needs
derivatives (`torque_row_values`). It is smaller than the maximum by at most this share.
"""
COST_SMOOTHING = 1e-2
"""Width of such a transition in the costs of heat and effort, as a share of the nominal torque.

At a kink of the cost, the iterations of the solver would oscillate (`smooth_torque`).
"""


MOTORLESS_COST_WEIGHT = 1e-3
"""Weight of the squared relative accelerations of joints without a motor in the cost of effort.

It is so small that these joints hardly change the motion of joints with motors.
"""


RowName = tuple[str, int | None]
"""Name of a row: the name of its limit, and the index of its joint (None for the whole arm).

A motor has torque rows for each entry k of `Robot.actuations`, that is, for each payload and
extreme of the friction. The second entry of these rows is joint + 4 k. The rows of one k can thus
be part of an optimisation problem without those of another one.
"""


IndexedRow = tuple[str, int | None, int]
"""The two entries of a RowName, and the index of the row in native/elements.c."""
ROWS_PER_JOINT = 10
"""Number of kinematic rows of one joint along a path in native/elements.c.

Each of the two directions has one row of the velocity, two rows of the distance to stop, one row of
the acceleration and one row of the jerk.
"""


@frozen
class PathConstraint:
    """One path constraint, also called a row: a limit is kept if `value` is at most 1."""

    name: str
    """Name of the limit."""
    joint: int | None
    """Index of the joint in the form of `RowName`. None for the whole arm."""
    value: ca.SX
    """Scaled expression of the limited quantity."""


@frozen
class Instant:
    """Symbolic motion and limits of all joints at one instant, in SI units.

    All expressions have the shape (4,) unless stated otherwise.
    """

    qd: ca.SX
    """Joint velocities."""
    qd_hull: ca.SX
    """Velocities that appear in the velocity rows in place of `qd`.

    Along a path they are Bernstein coefficients, whose bounds hold for `qd` in the whole element
    (`StraightElement.collocation_states`). In a free motion they equal `qd`.
    """
    qdd: ca.SX
    """Joint accelerations."""
    qddd: ca.SX
    """Joint jerks."""
    tau_rigid: ca.SX
    """Joint torques without friction, (4 loads,).

    `Robot.loads` lists the variants of the payload. The four torques for the first one come first,
    then those for the second one, and so on.
    """
    speeds: ca.SX
    """Speeds of the tool in the order of `SPEED_JACOBIANS` for the velocities qd_hull.

    In a free motion, they and their limits are squared, because a norm has no derivative at rest.
    """
    sigma: ca.SX
    """Direction of each joint: +1, −1, or 0 for a joint that does not move."""
    limits: SimpleNamespace
    """Limits with the names and lengths of `LIMIT_SIZES`.

    The torque limit of a joint without a motor is unused.
    """


def kinematic_rows(instant: Instant, joints: tuple[Joint, ...], jerk: bool) -> list[PathConstraint]:
    """Build the rows (path constraints, at most 1) of all kinematic limits along a path.

    They limit the tool speeds, the velocity, acceleration and jerk of every joint, and the distance
    in which the tip can stop. `retiming.constraints.braking_travel` derives the rows of this
    distance. A joint with a drive moves only in its direction σ, so it needs velocity rows for this
    direction alone.

    Parameters
    ----------
    instant : Instant
        Motion and limits at one instant.
    joints : tuple of Joint
        Joints of the robot.
    jerk : bool
        True if the rows of the jerk are included.

    Returns
    -------
    list of PathConstraint
        Rows of the tool speeds, followed by those of each joint.
    """
    rows = speed_rows(instant)
    for i, joint in enumerate(joints):
        for sense in (1, -1) if joint.drive is None else (instant.sigma[i],):
            rows += velocity_and_stop_rows(instant, i, sense)
        rows += acceleration_rows(instant, i, jerk)
    return rows


def velocity_and_stop_rows(instant: Instant, i: int, sense: ca.SX | int) -> list[PathConstraint]:
    """Build the rows of velocity and distance to stop of one joint in one direction.

    Let d be the limit on the distance in which the tip can stop, v the speed of the tip, and a the
    acceleration limit of the joint. The rows of the distance are v q̇/(2 d) ≤ a and
    v q̇/(2 d) − q̈ ≤ a. q̇ and q̈ count as positive in the given direction.

    Parameters
    ----------
    instant : Instant
        Motion and limits at one instant.
    i : int
        Index of the joint.
    sense : casadi.SX or int
        Direction, +1 or −1.

    Returns
    -------
    list of three PathConstraint
        Row of the velocity, and both rows of the distance to stop, each at most 1.
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
    """Build the rows (path constraints, at most 1) of acceleration and jerk of one joint.

    Parameters
    ----------
    instant : Instant
        Motion and limits at one instant.
    i : int
        Index of the joint.
    jerk : bool
        True if the jerk is limited.

    Returns
    -------
    list of two or four PathConstraint
        Row of the acceleration, and row of the jerk if it is limited, in the positive direction,
        followed by the same rows in the negative one.
    """
    rows = []
    for side in (1, -1):
        value = side * instant.qdd[i] / instant.limits.acceleration[i]
        rows.append(PathConstraint(JointAcceleration.name, i, value))
        if jerk:
            value = side * instant.qddd[i] / instant.limits.jerk[i]
            rows.append(PathConstraint(JointJerk.name, i, value))
    return rows


def speed_rows(instant: Instant) -> list[PathConstraint]:
    """Build the rows (path constraints, at most 1) of all tool speeds that a problem may limit.

    Parameters
    ----------
    instant : Instant
        Motion and limits at one instant.

    Returns
    -------
    list of PathConstraint
        One row for each tool speed in the order of `SPEED_JACOBIANS`.
    """
    return [
        PathConstraint(limit_class.name, None, instant.speeds[k] / instant.limits.speeds[k])
        for k, limit_class in enumerate(SPEED_JACOBIANS)
    ]


def torque_rows(instant: Instant, robot: Robot, *, breakaway: bool = False) -> list[PathConstraint]:
    """Build the rows (path constraints, at most 1) of the motor torques, with exact friction.

    If the friction or the payload of the robot is a range, there are rows for each of its extremes.

    Parameters
    ----------
    instant : Instant
        Motion and limits at one instant.
    robot : Robot
        Robot with its drives and motors.
    breakaway : bool
        True for an instant at which the joints start to move. The static friction coefficient then
        applies.

    Returns
    -------
    list of PathConstraint
        For each joint and each of its entries in `Robot.actuations`, two rows of a driving motor,
        one row of a braking motor, or all three.
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
    """Compute the values of the torque rows of a driving and of a braking motor.

    The torque σ τ in the direction of motion is the larger one of two functions τ_1 and τ_2. A
    driving motor keeps its limit if both functions are at most the limit. A braking motor keeps it
    if the larger function is at least −limit. A smooth function replaces the larger function in
    this row. It never exceeds the exact maximum, so the row is slightly too strict.

    Parameters
    ----------
    torques : tuple of two casadi.SX
        The functions τ_1 and τ_2 of `directed_torques`, N·m.
    limit : casadi.SX
        Torque limit, N·m.

    Returns
    -------
    driving : tuple of two casadi.SX
        Values of the rows of a driving motor.
    braking : tuple of one casadi.SX
        Value of the row of a braking motor.

    Notes
    -----
    With the relative torques r = τ / limit, and with ε = `BRAKING_ROW_SMOOTHING`, the maximum is
        max(r_1, r_2) ≈ (r_1 + r_2)/2 + √((r_1 − r_2)²/4 + ε²) − ε.
    """
    torque_1, torque_2 = torques
    half = (torque_1 - torque_2) / (2 * limit)
    root = ca.sqrt(half**2 + BRAKING_ROW_SMOOTHING**2)
    smooth_maximum = (torque_1 + torque_2) / (2 * limit) + root - BRAKING_ROW_SMOOTHING
    return (torque_1 / limit, torque_2 / limit), (-smooth_maximum,)


Actuation = tuple[int, int, int, Drive, tuple[int, ...]]
"""A joint with one drive and one payload, for which its motor must be strong enough.

The friction of the drive and the payload may be extremes of ranges. The entries are the index of
the joint, the index k in its `Robot.actuations`, the index of the payload in `Robot.loads`, the
drive, and the torque limits to be kept (1 if the motor drives, −1 if it brakes).
"""


def _actuations(robot: Robot) -> list[Actuation]:
    """List the combinations of drive and payload of all joints, sorted by joint.

    Parameters
    ----------
    robot : Robot
        The robot.

    Returns
    -------
    list of Actuation
        One entry for each joint with a motor and each entry of its `Robot.actuations`.
    """
    actuations = []
    for i in range(4):
        for k, (load, drive, sides) in enumerate(robot.actuations(i)):
            actuations.append((i, k, load, drive, sides))
    return actuations


def actuations_by_load(robot: Robot) -> list[Actuation]:
    """List the combinations of drive and payload of all joints, sorted by payload.

    native/elements.c has this order, because it computes the torques of one payload after another.

    Parameters
    ----------
    robot : Robot
        The robot.

    Returns
    -------
    list of Actuation
        One entry for each joint with a motor and each entry of its `Robot.actuations`.
    """
    return sorted(_actuations(robot), key=lambda item: item[2])


def indexed_torque_rows(robot: Robot, start: int) -> list[IndexedRow]:
    """Return the names of the rows of `torque_rows`, and their indices in native/elements.c.

    Parameters
    ----------
    robot : Robot
        Robot with its drives and motors.
    start : int
        Index of the first torque row in native/elements.c.

    Returns
    -------
    list of IndexedRow
        Name, joint and index of each row, in the order of `torque_rows`.
    """
    indices = {}
    for position, (i, k, *_) in enumerate(actuations_by_load(robot)):
        # Each actuation has three rows: two of a driving motor and one of a braking motor.
        indices[i, k] = start + 3 * position
    rows: list[IndexedRow] = []
    for i, k, _, _, sides in _actuations(robot):
        # The two rows of a driving motor come first, then the row of a braking motor.
        offsets = ([0, 1] if 1 in sides else []) + ([2] if -1 in sides else [])
        rows += [(MotorTorque.name, i + 4 * k, indices[i, k] + offset) for offset in offsets]
    return rows


def indexed_kinematic_rows(robot: Robot, jerk: bool) -> list[IndexedRow]:
    """Return the names of the rows of `kinematic_rows`, and their indices in native/elements.c.

    The C code has places for the velocity rows of both directions and for the rows of the jerk,
    also where they are not used.

    Parameters
    ----------
    robot : Robot
        Robot with its joints and drives.
    jerk : bool
        True if the rows of the jerk are included.

    Returns
    -------
    list of IndexedRow
        Name, joint and index of each row, in the order of `kinematic_rows`.
    """
    rows: list[IndexedRow] = [
        (limit_class.name, None, k) for k, limit_class in enumerate(SPEED_JACOBIANS)
    ]
    for i, joint in enumerate(robot.joints):
        # A joint has 10 places. The first three are for velocity and stop in its direction σ, or in
        # the positive one, and the next three for the negative one. The last four are for
        # acceleration and jerk in the positive, then in the negative direction.
        index = len(SPEED_JACOBIANS) + ROWS_PER_JOINT * i
        for side in range(2 if joint.drive is None else 1):
            names = JointVelocity.name, StopTravel.name, StopTravel.name
            rows += [(name, i, index + 3 * side + k) for k, name in enumerate(names)]
        for side in (0, 1):
            rows.append((JointAcceleration.name, i, index + 6 + 2 * side))
            if jerk:
                rows.append((JointJerk.name, i, index + 7 + 2 * side))
    return rows


def heat_cost(instant: Instant, joints: tuple[Joint, ...]) -> ca.SX:
    """Build the cost of the heat of all motors at one instant.

    The cost is Σ (τ_motor/τ_nominal)² over the motors, because the heat in the windings of a motor
    is proportional to the square of its torque.

    Parameters
    ----------
    instant : Instant
        Motion and limits at one instant.
    joints : tuple of Joint
        Joints of the robot.

    Returns
    -------
    casadi.SX
        Cost (dimensionless).
    """
    return ca.sumsqr(_relative_torques(instant, joints))


def cooling_cost(instant: Instant, joints: tuple[Joint, ...]) -> ca.SX:
    """Build the cost of the heat of the motors at one instant, with one weight for each motor.

    The cost is Σ w (τ_motor/τ_nominal)² over the motors, with the weights w = `limits.cooling`.

    Parameters
    ----------
    instant : Instant
        Motion and limits at one instant, with the weights.
    joints : tuple of Joint
        Joints of the robot.

    Returns
    -------
    casadi.SX
        Cost (dimensionless).
    """
    weights = [instant.limits.cooling[i] for i, *_ in motorised_joints(joints)]
    return ca.dot(ca.vertcat(ca.SX(0, 1), *weights), _relative_torques(instant, joints) ** 2)


def effort_cost(instant: Instant, slow: Instant, joints: tuple[Joint, ...]) -> ca.SX:
    """Build the cost of the torque that the speed of the motion needs at one instant.

    The cost compares the torque of each motor with that of an infinitely slow motion at the same
    position. The latter overcomes friction and weight, which are present at any speed. If this part
    counted, a motion with a given duration would linger where friction and weight are small. Joints
    without a motor or drive have no torque to compare, so their accelerations count instead.

    Parameters
    ----------
    instant : Instant
        Motion and limits at one instant.
    slow : Instant
        The same instant without velocity and acceleration.
    joints : tuple of Joint
        Joints of the robot.

    Returns
    -------
    casadi.SX
        Cost (dimensionless).

    Notes
    -----
    The cost is Σ ((τ_motor − τ_slow)/τ_nominal)² + MOTORLESS_COST_WEIGHT Σ (q̈/q̈_max)², where the
    first sum is over the motors, and the second one over the joints without a motor or drive.
    """
    accelerations = [
        instant.qdd[i] / instant.limits.acceleration[i] for i in joints_without_motor(joints)
    ]
    motorless_cost = MOTORLESS_COST_WEIGHT * ca.sumsqr(ca.vertcat(ca.SX(0, 1), *accelerations))
    return (
        ca.sumsqr(_relative_torques(instant, joints) - _relative_torques(slow, joints))
        + motorless_cost
    )


def _relative_torques(instant: Instant, joints: tuple[Joint, ...]) -> ca.SX:
    """Build the smoothed torque of every motor, relative to its nominal torque.

    Parameters
    ----------
    instant : Instant
        Motion and limits at one instant.
    joints : tuple of Joint
        Joints of the robot.

    Returns
    -------
    (motors,) casadi.SX
        σ τ_motor/τ_nominal of each motor, positive in the direction of motion (`smooth_torque`).
    """
    values = [
        smooth_torque(drive, instant, i, motor.nominal_torque)
        for i, drive, motor in motorised_joints(joints)
    ]
    return ca.vertcat(ca.SX(0, 1), *values)


def smooth_torque(drive: Drive, instant: Instant, i: int, nominal: float) -> ca.SX:
    """Build the smoothed torque of one motor, relative to its nominal torque.

    The exact torque is the larger one of two functions. It has a kink where both are equal, so a
    smooth function replaces the maximum.

    Parameters
    ----------
    drive : Drive
        Drive of the joint.
    instant : Instant
        Motion and limits at one instant.
    i : int
        Index of the joint.
    nominal : float
        Nominal torque of the motor, N·m.

    Returns
    -------
    casadi.SX
        σ τ_motor/τ_nominal, the relative torque in the direction of motion.

    Notes
    -----
    With the values a and b of both functions, relative to the nominal torque, the maximum is
        max(a, b) ≈ (a + b)/2 + √((a − b)²/4 + COST_SMOOTHING²).
    """
    torque_1, torque_2 = directed_torques(drive, instant, i, breakaway=False)
    torque_1 = torque_1 / nominal
    torque_2 = torque_2 / nominal
    return (torque_1 + torque_2) / 2 + ca.sqrt((torque_1 - torque_2) ** 2 / 4 + COST_SMOOTHING**2)


def directed_torques(
    drive: Drive, instant: Instant, i: int, *, breakaway: bool, load: int = 0
) -> tuple[ca.SX, ca.SX]:
    """Build the two functions whose maximum is the motor torque in the direction of motion.

    One function applies while the motor drives the mesh of the worm or thread, and the other one
    while the load drives the mesh (`dynamics.motor_torque_rows`). For a drive with two nuts both
    are equal, because the direction of motion alone decides which side of the thread a nut touches.

    Parameters
    ----------
    drive : Drive
        Drive of the joint.
    instant : Instant
        Motion of all joints at one instant.
    i : int
        Index of the joint.
    breakaway : bool
        True if the static friction coefficient applies, because the joint starts to move.
    load : int
        Index of the payload in `Robot.loads`.

    Returns
    -------
    tuple of two casadi.SX
        Torques of the motor in the direction of motion, N·m. Both are 0 for a joint that does not
        move.
    """
    friction = required_friction(drive)
    sigma = instant.sigma[i]
    # Velocity and acceleration of the motor, rad/s and rad/s².
    w = drive.ratio * instant.qd[i]
    wd = drive.ratio * instant.qdd[i]
    mu = breakaway_coefficient(friction) if breakaway else friction_coefficient(friction, sigma * w)
    # The four efforts with the first payload precede those with the second one, and so on.
    tau_rigid = instant.tau_rigid[4 * load + i]
    effort = output_effort(drive, tau_rigid, instant.qd[i], instant.qdd[i], sigma)
    rows = motor_torque_rows(drive, sigma, mu)
    torque_1 = sigma * rows.torque(rows.slope[0] * effort, w, wd)
    torque_2 = sigma * rows.torque(rows.slope[1] * effort, w, wd)
    return torque_1, torque_2
