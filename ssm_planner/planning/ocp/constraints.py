"""Path constraints: the limits at one instant of a motion as symbolic rows, value ≤ 1, and the costs of the motors.

Of a robot, its limits are parameters of the program (`joint_limits`), the rest are constants in the expressions
(`robot_key`).
"""

from __future__ import annotations

import pickle
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, replace
from operator import is_
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.dynamics.friction import breakaway_coefficient, friction_coefficient, friction_of
from ssm_planner.dynamics.motors import motorised
from ssm_planner.dynamics.transmission import motor_torque_rows, output_effort
from ssm_planner.kinematics.forward import JACOBIANS, speed_bounds
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.limits import (
    JointAcceleration,
    JointJerk,
    JointVelocity,
    MotorTorque,
    SpeedLimit,
    StopTravel,
    TipSpeed,
    ToolLimit,
)
from ssm_planner.problem.robot import Joint, Robot
from ssm_planner.problem.value import unchecked
from ssm_planner.typing import Array

UNLIMITED = 1e9
LIMITS = {
    "velocity": 4,
    "acceleration": 4,
    "jerk": 4,
    "torque": 4,
    "cooling": 4,
    "speeds": len(JACOBIANS),
    "stop": 1,
}
"""Limits as parameters, with their lengths: of the joints, of their motors, of the speeds of the tool and of its stops.
cooling: what a second of every motor at its nominal torque costs, in seconds."""


TIP = list(JACOBIANS).index(TipSpeed)


def joint_limits(robot: Robot, cooling: Array | None = None) -> dict[str, Array]:
    """Velocity, acceleration, jerk and motor-torque limits of the joints by their names in LIMITS, and cooling, (4,) each."""
    joints = robot.joints
    limits = {
        "velocity": np.array([joint.velocity for joint in joints]),
        "acceleration": np.array([joint.acceleration for joint in joints]),
        "jerk": np.array([UNLIMITED if joint.jerk is None else joint.jerk for joint in joints]),
        "torque": np.full(4, UNLIMITED),
        "cooling": np.zeros(4) if cooling is None else cooling,
    }
    for i, drive, motor in motorised(joints):
        limits["velocity"][i] = min(limits["velocity"][i], motor.max_speed / drive.ratio)
        limits["torque"][i] = motor.max_torque
    return limits


def tool_limits(limits: Iterable[ToolLimit]) -> dict[str, Array]:
    """The limits of the tool by their names in LIMITS: speeds (kinds,), stop (1,)."""
    limits = tuple(limits)
    stop = next((limit.largest for limit in limits if isinstance(limit, StopTravel)), UNLIMITED)
    speeds = speed_bounds((limit for limit in limits if isinstance(limit, SpeedLimit)), UNLIMITED)
    return {"speeds": speeds, "stop": np.array([stop])}


def tool_names(limits: Iterable[ToolLimit], moving: Iterable[int]) -> set[RowName]:
    """Of the rows of these limits; moving: the joints that move."""
    joints = {limit.name: moving if isinstance(limit, StopTravel) else (None,) for limit in limits}
    return {(name, None if i is None else int(i)) for name, each in joints.items() for i in each}


def with_margin(robot: Robot, share: float) -> Robot:
    """The robot with velocity, acceleration and motor torque of its joints limited to a share below what they are."""
    kept = 1 - share

    def reduced(joint: Joint) -> Joint:
        motor = (
            None
            if joint.motor is None
            else unchecked(joint.motor, max_torque=joint.motor.max_torque * kept)
        )
        return replace(
            joint,
            velocity=joint.velocity * kept,
            acceleration=joint.acceleration * kept,
            motor=motor,
        )

    first, second, third, fourth = map(reduced, robot.joints)
    return replace(robot, joints=(first, second, third, fourth))


def robot_key(robot: Robot) -> bytes:
    """What of a robot stands as constants in an element model: geometry, bodies, gravity, drives and nominal torques.

    Its limits are parameters. Equal keys mean equal content; equal content may have different keys, which only costs time.
    """
    drives = tuple(joint.drive for joint in robot.joints)
    nominal = [
        None if joint.motor is None else joint.motor.nominal_torque for joint in robot.joints
    ]
    parts = robot.geometry, *robot.bodies, *drives, robot.corners, robot.lightest
    numbers = nominal, robot.gravity.tobytes()  # every robot copies its gravity
    for known in tuple(_known):
        if known[1] == numbers and all(map(is_, known[0], parts)):
            return known[2]
    joints = list(zip(drives, nominal, strict=True))
    corners = (
        [load.bodies for load in robot.loads],
        [robot.actuations(i) for i in range(4)] if robot.corners else None,
    )
    key = pickle.dumps((robot.geometry, robot.bodies, robot.gravity, joints, corners))
    _known.appendleft((parts, numbers, key))
    return key


_known: deque[tuple[tuple[Any, ...], tuple[list[float | None], bytes], bytes]] = deque(maxlen=4)
"""Parts of the robots that were asked for last, their nominal torques and gravity, and their keys."""


def limits_jerk(robot: Robot) -> bool:
    """Whether any joint has a jerk limit."""
    return any(joint.jerk is not None for joint in robot.joints)


BRAKING_SOFTNESS = 1e-3
"""Smoothing of the mesh's larger side in the braking rows, as a share of the torque limit (on the safe side)."""
COST_SOFTNESS = 1e-2
"""The same in heat and effort, as a share of the nominal torque: at a sharp edge of the cost the solver goes to and fro."""


RowName = tuple[str, int | None]
"""Limit and joint of a row; of the torque with the k-th of `Robot.actuations` joint + 4 k, so that each is active alone."""


RowPlace = tuple[str, int | None, int]
"""The same, and the place of the row among all that native/elements.c knows."""
JOINT_ROWS = 10
"""Places of a joint: velocity and two of its stop in either sense, acceleration and jerk in either."""


@dataclass(frozen=True)
class PathConstraint:
    """One scaled inequality: value ≤ 1 keeps the limit `name` of `joint` (as in RowName; None for the whole arm)."""

    name: str
    joint: int | None
    value: ca.SX


@dataclass(frozen=True)
class Instant:
    """Symbolic state of all joints, (4,) each; sigma: direction of each joint's motion, +1, −1 or 0 (does not move)."""

    qd: ca.SX
    qd_hull: ca.SX
    """Stands in for qd in the velocity rows (`models.StraightElement.collocation_states`)."""
    qdd: ca.SX
    qddd: ca.SX
    tau_rigid: ca.SX
    """(4,) for each of `Robot.loads`, the robot's own first."""
    speeds: ca.SX
    """Speeds of the tool in the order of JACOBIANS; of the hull where qd_hull is."""
    sigma: ca.SX
    limits: SimpleNamespace
    """LIMITS, as expressions, so that one program serves all values; torque of joints without motor unused."""


def kinematic_rows(at: Instant, joints: tuple[Joint, ...], jerk: bool) -> list[PathConstraint]:
    """Speeds of the tool; velocity, acceleration and, where asked for, jerk of every joint; how far the tip goes to stop
    (`retiming.constraints.braking_travel`)."""
    rows = speed_rows(at)
    for i, joint in enumerate(joints):
        for sense in (1, -1) if joint.drive is None else (at.sigma[i],):
            rows += sense_rows(at, i, sense)
        rows += acceleration_rows(at, i, jerk)
    return rows


def sense_rows(at: Instant, i: int, sense: ca.SX | int) -> list[PathConstraint]:
    """Velocity of joint i in one sense, ±1, and how far the tip goes to stop, by its speed and by its braking."""
    bounds, speed = at.limits, sense * at.qd_hull[i]
    tip = at.speeds[TIP] / (2 * bounds.stop)
    rows = [PathConstraint(JointVelocity.name, i, speed / bounds.velocity[i])]
    for braking in (0, -sense * at.qdd[i]):
        rows.append(
            PathConstraint(StopTravel.name, i, (tip * speed + braking) / bounds.acceleration[i])
        )
    return rows


def acceleration_rows(at: Instant, i: int, jerk: bool) -> list[PathConstraint]:
    """Acceleration and, where asked for, jerk of joint i."""
    rows = []
    for side in (1, -1):
        rows.append(
            PathConstraint(JointAcceleration.name, i, side * at.qdd[i] / at.limits.acceleration[i])
        )
        if jerk:
            rows.append(PathConstraint(JointJerk.name, i, side * at.qddd[i] / at.limits.jerk[i]))
    return rows


def speed_rows(at: Instant) -> list[PathConstraint]:
    """Every speed of the tool that a problem may limit."""
    return [
        PathConstraint(kind.name, None, at.speeds[k] / at.limits.speeds[k])
        for k, kind in enumerate(JACOBIANS)
    ]


def torque_rows(at: Instant, robot: Robot, *, breakaway: bool = False) -> list[PathConstraint]:
    """Motor torque of every driven joint under the exact friction law for the known direction of motion; at corners too.

    breakaway: with the static coefficient, for instants at which a joint starts to move.
    """
    rows = []
    each = [(i, k, *one) for i in range(4) for k, one in enumerate(robot.actuations(i))]
    for i, k, load, drive, sides in each:
        torques = directed_torques(drive, at, i, breakaway=breakaway, load=load)
        driving, braking = sides_of_torque(torques, at.limits.torque[i])
        values = [*(driving if 1 in sides else ()), *(braking if -1 in sides else ())]
        rows += [PathConstraint(MotorTorque.name, i + 4 * k, value) for value in values]
    return rows


def sides_of_torque(
    torques: tuple[ca.SX, ca.SX], limit: ca.SX
) -> tuple[tuple[ca.SX, ca.SX], tuple[ca.SX]]:
    """Values of the rows of a motor that drives, and of one that brakes; torques: the two of `directed_torques`."""
    first, second = torques
    # σ τ is the larger of the two; the smooth maximum below never exceeds it
    half, soft = (first - second) / (2 * limit), BRAKING_SOFTNESS
    resisting = (first + second) / (2 * limit) + ca.sqrt(half**2 + soft**2) - soft
    return (first / limit, second / limit), (-resisting,)


def actuations_by_load(robot: Robot) -> list[tuple[int, int, int, Drive, tuple[int, ...]]]:
    """Joint, its k-th of `Robot.actuations`, load, drive and sides of all, by load."""
    each = [(i, k, *one) for i in range(4) for k, one in enumerate(robot.actuations(i))]
    return sorted(each, key=lambda one: one[2])


def torque_places(robot: Robot, first: int) -> list[RowPlace]:
    """Of the rows of `torque_rows`; first: the place of the first of them all."""
    places = {one[:2]: first + 3 * at for at, one in enumerate(actuations_by_load(robot))}
    return [
        (MotorTorque.name, i + 4 * k, places[i, k] + side)
        for i in range(4)
        for k, (*_, sides) in enumerate(robot.actuations(i))
        for side in [0, 1] * (1 in sides) + [2] * (-1 in sides)
    ]


def joint_places(robot: Robot, jerk: bool) -> list[RowPlace]:
    """Of the rows of `kinematic_rows`."""
    rows: list[RowPlace] = [(kind.name, None, k) for k, kind in enumerate(JACOBIANS)]
    for i, joint in enumerate(robot.joints):
        place = len(JACOBIANS) + JOINT_ROWS * i
        for side in range(2 if joint.drive is None else 1):
            names = JointVelocity.name, StopTravel.name, StopTravel.name
            rows += [(name, i, place + 3 * side + k) for k, name in enumerate(names)]
        for side in (0, 1):
            rows.append((JointAcceleration.name, i, place + 6 + 2 * side))
            rows += [(JointJerk.name, i, place + 7 + 2 * side)] * jerk
    return rows


def torque_names(robot: Robot, i: int) -> set[RowName]:
    """Of the rows of the motor torque of joint i."""
    return {(MotorTorque.name, i + 4 * k) for k in range(len(robot.actuations(i)))}


def heat(at: Instant, joints: tuple[Joint, ...]) -> ca.SX:
    """Σ (τ_motor / τ_nominal)²: what warms the windings."""
    return ca.sumsqr(_torques(at, joints))


def cooling(at: Instant, joints: tuple[Joint, ...]) -> ca.SX:
    """Σ cooling (τ_motor / τ_nominal)²: heat of the motors, each weighted by what it costs."""
    weights = ca.vertcat(ca.SX(0, 1), *(at.limits.cooling[i] for i, *_ in motorised(joints)))
    return ca.dot(weights, _torques(at, joints) ** 2)


def effort(at: Instant, slow: Instant, joints: tuple[Joint, ...]) -> ca.SX:
    """Σ ((τ_motor − that of endlessly slow motion in the same place) / τ_nominal)².

    What inertia and speed ask of the motors. Friction and weight have to be overcome at any speed; counting their heat
    would reward standing still wherever they are small. slow: the same instant without speed and acceleration.
    """
    return ca.sumsqr(_torques(at, joints) - _torques(slow, joints))


def _torques(at: Instant, joints: tuple[Joint, ...]) -> ca.SX:
    """σ τ_motor / τ_nominal of every motor, the larger side of the mesh smoothed."""
    values = [
        smooth_torque(drive, at, i, motor.nominal_torque) for i, drive, motor in motorised(joints)
    ]
    return ca.vertcat(ca.SX(0, 1), *values)


def smooth_torque(drive: Drive, at: Instant, i: int, nominal: float) -> ca.SX:
    """σ τ_motor / τ_nominal of joint i, the larger side of the mesh smoothed."""
    first, second = (side / nominal for side in directed_torques(drive, at, i, breakaway=False))
    return (first + second) / 2 + ca.sqrt((first - second) ** 2 / 4 + COST_SOFTNESS**2)


def directed_torques(
    drive: Drive, at: Instant, i: int, *, breakaway: bool, load: int = 0
) -> tuple[ca.SX, ca.SX]:
    """The two values of σ τ_motor whose larger is the motor torque in the direction of motion; 0 without motion."""
    friction = friction_of(drive)
    sigma, w, wd = at.sigma[i], drive.ratio * at.qd[i], drive.ratio * at.qdd[i]
    mu = breakaway_coefficient(friction) if breakaway else friction_coefficient(friction, sigma * w)
    effort = output_effort(drive, at.tau_rigid[4 * load + i], at.qd[i], at.qdd[i], sigma)
    rows = motor_torque_rows(drive, sigma, mu)
    first, second = (sigma * rows.torque(slope * effort, w, wd) for slope in rows.slope)
    return first, second
