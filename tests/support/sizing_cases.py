"""Motions, drives and robots for tests of the sizing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ssm_planner.problem.drive import Drive, Ratings
from ssm_planner.problem.motor import Motor
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Span, Trajectory, quintic_coefficients

COMPLETE = Motor(
    name="complete",
    nominal_torque=0.10,
    max_torque=0.40,
    max_speed=1500.0,
    nominal_voltage=24.0,
    nominal_current=4.0,
    torque_constant=0.026,
    terminal_resistance=0.5,
    rotor_inertia=4e-7,
    resistance_winding_housing=1.0,
    resistance_housing_ambient=6.0,
    time_constant_winding=4.0,
    time_constant_motor=500.0,
    max_winding_temperature=428.15,
    torque_constant_per_kelvin=-0.0011,
)


def random_trajectory(seed: int, duration: float = 3.0, pieces: int = 12) -> Trajectory:
    """Return a random motion from rest to rest, in which every joint reverses several times."""
    rng = np.random.default_rng(seed)
    breaks = np.linspace(0.0, duration, pieces + 1)
    scale = np.array([0.2, 0.17, 0.27, 0.006])
    q = rng.uniform(-1, 1, (pieces + 1, 4)) * scale
    q[:, 3] -= 0.015
    rate = rng.uniform(-1, 1, (pieces + 1, 4)) * scale / 2
    bend = rng.uniform(-1, 1, (pieces + 1, 4)) * scale
    rate[[0, -1]] = 0.0
    coefficients = quintic_coefficients(
        np.diff(breaks), (q[:-1], rate[:-1], bend[:-1]), (q[1:], rate[1:], bend[1:])
    )
    return Trajectory(breaks, coefficients, (Span("random", 0.0, duration),))


def with_covariance(drive: Drive, relative: float = 0.08) -> Drive:
    """Return the drive with uncertain friction of relative standard deviation `relative`.

    μ is negatively correlated with the friction of the output, and so are the bearing torque and
    its viscous part.
    """
    friction = drive.friction
    sigma = {name: relative * getattr(friction, name) for name in ("b_c", "b_v", "mu", "b_oc")}
    tied = {("mu", "b_oc"): -0.6, ("b_c", "b_v"): -0.7}
    table = {
        a: {
            b: sigma[a] * sigma[b] * (1.0 if a == b else tied.get((a, b), tied.get((b, a), 0.0)))
            for b in sigma
        }
        for a in sigma
    }
    return replace(drive, friction=replace(friction, covariance=table, identified_speed=20.0))


def rated(drive: Drive) -> Drive:
    """Return the drive with generous ratings of its gear."""
    ratings = Ratings(
        continuous_output=50.0,
        peak_output=100.0,
        input_speed=500.0,
        duty=1.0,
        free_length=0.05,
        root_diameter=2.4e-3,
        ends="fixed-supported",
    )
    return replace(drive, ratings=ratings)


def equipped(robot: Robot, motor: Motor = COMPLETE, ratings: bool = True) -> Robot:
    """Return the robot with a complete motor on every drive.

    Its friction has a covariance, and its gears have generous ratings.
    """
    joints = []
    for joint in robot.joints:
        if joint.drive is None:
            joints.append(joint)
            continue
        drive = with_covariance(rated(joint.drive) if ratings else joint.drive, 0.03)
        # The input inertia of the drive includes the rotor.
        drive = replace(
            drive, input_inertia=max(drive.input_inertia, 1.25 * (motor.rotor_inertia or 0.0))
        )
        joints.append(replace(joint, drive=drive, motor=motor))
    return replace(robot, joints=tuple(joints))
