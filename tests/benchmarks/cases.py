"""Motions that all programs plan, and the changes of their numbers from one solve to the next."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cache

import numpy as np

from ssm_planner.loading.load import load_problem
from ssm_planner.problem.limits import TASK_COORDINATES, TaskRange
from ssm_planner.problem.motion import Free, Joints
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.typing import Array
from tests.support.paths import ROOT

PROBLEM = ROOT / "problems/tilt_insert.yaml"
NO_MOTOR = 1e9
"""Torque limit that stands for a joint without a motor."""
WEAK, FREE_WEAK = 0.3, 0.35
"""Factors on the motor torque at which it limits the straight and the free motion."""


@dataclass(frozen=True)
class Change:
    """Numbers of one solve.

    They are the target tilt in degrees, an additional displacement of the joints, and a factor on
    the velocity limits.
    """

    tilt: float = -135.0
    joints: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    velocity: float = 1.0


STRAIGHT = (
    Change(-135),
    Change(-133),
    Change(-130),
    Change(-134, velocity=0.9),
    Change(-132, velocity=0.9),
    Change(-136, velocity=0.95),
    Change(-128),
    Change(-131, velocity=0.97),
)
FREE = (
    Change(),
    Change(joints=(0.03, 0.0, 0.0, 0.0)),
    Change(joints=(0.0, -0.05, 0.03, 0.0)),
    Change(velocity=0.9),
    Change(joints=(-0.03, 0.04, 0.0, 0.002)),
    Change(joints=(0.05, 0.0, -0.04, 0.0), velocity=0.95),
    Change(joints=(0.0, 0.03, 0.0, -0.003)),
    Change(joints=(0.02, 0.02, 0.02, 0.0), velocity=0.97),
)
"""Changes in the order of the solves. The first entry is the first solve."""
FIRST, LAST = (-0.5, 0.6, 0.0, 0.0), (0.3, -0.2, 0.5, -0.015)


@cache
def shipped() -> Problem:
    """Return the shipped problem without its eye, for the shortest time."""
    return dataclasses.replace(load_problem(PROBLEM), objective="time", eye=None)


def straight_problem(change: Change, torque: float = 1.0) -> Problem:
    """Return the tilt motion of the shipped problem with another target."""
    problem = shipped()
    motion = dataclasses.replace(problem.motion[0], tilt=float(np.radians(change.tilt)))
    robot = with_limits(problem.robot, velocity=change.velocity, torque=torque)
    return dataclasses.replace(problem, robot=robot, motion=(motion,))


def free_problem(change: Change, torque: float = 1.0) -> Problem:
    """Return a problem with a free motion of all four joints."""
    problem = shipped()
    last = Joints(tuple(float(x) for x in np.add(LAST, change.joints)))  # type: ignore[arg-type]
    robot = with_limits(problem.robot, velocity=change.velocity, torque=torque)
    motion = (Free(last),)
    return dataclasses.replace(
        problem,
        robot=robot,
        start=Joints(FIRST),
        motion=motion,
        limits=(TaskRange("depth", 0.0, 0.03),),
    )


def with_limits(
    robot: Robot, velocity: float = 1.0, torque: float = 1.0, jerk: float | None = None
) -> Robot:
    """Return the robot with scaled velocity limits and motors.

    `jerk` is in rad/s³ for revolute joints. A tenth of it in m/s³ applies to the prismatic joint.
    """
    joints = []
    for joint in robot.joints:
        motor = joint.motor
        if motor is not None:
            largest = torque * motor.max_torque
            motor = dataclasses.replace(
                motor, max_torque=largest, nominal_torque=min(motor.nominal_torque, largest)
            )
        bound = joint.jerk if jerk is None else jerk if joint.kind == "revolute" else 0.1 * jerk
        joints.append(
            dataclasses.replace(joint, velocity=velocity * joint.velocity, motor=motor, jerk=bound)
        )
    return dataclasses.replace(robot, joints=tuple(joints))  # type: ignore[arg-type]


def limits_of(robot: Robot) -> Array:
    """Return velocity, acceleration and torque limits (12,). Velocities respect the motor speed."""
    velocity, acceleration, torque = [], [], []
    for joint in robot.joints:
        slowest = joint.velocity
        if joint.drive is not None and joint.motor is not None:
            slowest = min(slowest, joint.motor.max_speed / joint.drive.ratio)
        velocity.append(slowest)
        acceleration.append(joint.acceleration)
        torque.append(NO_MOTOR if joint.motor is None else joint.motor.max_torque)
    return np.array([*velocity, *acceleration, *torque])


def task_ends(problem: Problem) -> tuple[Array, Array]:
    """Return the task coordinates (4,) at start and end of a problem with one task motion."""
    start = np.array(
        [(problem.start.set_coordinates or {}).get(name, 0.0) for name in TASK_COORDINATES]
    )
    target = problem.motion[0].to.set_coordinates
    return start, np.array([target.get(name, start[k]) for k, name in enumerate(TASK_COORDINATES)])
