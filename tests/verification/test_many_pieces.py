"""The check finds every short dip of the speed in tables with more than 20 000 pieces. The
reference is a denser check of the pieces around the dip.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ssm_planner.loading.load import load_robot
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory, quintic_coefficients
from ssm_planner.verification.check import check

COUNT = 20_200
ANY_SPEED = TaskLimits(start_rate=None, end_rate=None)


def sticking(law: str, speed: float, rise: float) -> Robot:
    """Return a robot whose roll drive has a friction that rises below a motor speed in rad/s."""
    robot = load_robot("vitreoretinal")
    roll = robot.joints[0]
    assert roll.drive is not None
    friction = dataclasses.replace(
        roll.drive.friction,
        mu=0.05,
        mu_static=0.05 + rise,
        mu_stribeck=rise,
        stribeck_speed=speed,
        law=law,
    )
    drive = dataclasses.replace(roll.drive, friction=friction)
    joints = (dataclasses.replace(roll, drive=drive), *robot.joints[1:])
    return dataclasses.replace(robot, joints=joints)


def dipping(
    length: float, low: float, high: float, width: int, angle: float, shift: float
) -> Trajectory:
    """Return uniform pieces in which the roll joint slows down once to `low`, at `angle`.

    `width` is the number of pieces before and after the dip. `shift` is the distance of the slowest
    instant from the knot in the middle, in lengths of a piece.
    """
    index = np.arange(COUNT + 1)
    t = index * length
    apart = (index - COUNT // 2 - shift) / width
    x = np.minimum(np.abs(apart), 1.0)
    q = np.tile([0.0, 1.2, 0.1, -0.01], (COUNT + 1, 1))
    qd, qdd = np.zeros_like(q), np.zeros_like(q)
    qd[:, 0] = low + (high - low) * (1 - (1 - x) ** 2)
    qdd[:, 0] = 2 * (high - low) * (1 - x) * np.sign(apart) / (width * length)
    q[1:, 0] = np.cumsum((qd[1:, 0] + qd[:-1, 0]) / 2 * length)
    q[:, 0] += angle - q[COUNT // 2, 0]
    q[:, 2], qd[:, 2], qdd[:, 2] = 0.05 * np.sin(t), 0.05 * np.cos(t), -0.05 * np.sin(t)
    ends = [tuple(x[side] for x in (q, qd, qdd)) for side in (slice(None, -1), slice(1, None))]
    return Trajectory(t, quintic_coefficients(np.diff(t), *ends), ())


def agrees(robot: Robot, motion: Trajectory) -> bool:
    """Return whether the check finds the torque of the 200 pieces in the middle.

    The reference samples these pieces 20 times as densely.
    """
    k = len(motion.breaks) // 2
    few = Trajectory(motion.breaks[k - 100 : k + 101], motion.pieces(slice(k - 100, k + 100)), ())
    alone = check(few, robot, ANY_SPEED, rate=200_000.0)["motor torque", "roll"]
    complete = check(motion, robot, ANY_SPEED)["motor torque", "roll"]
    return bool(complete.worst >= alone.worst * (1 - 1e-4))


@pytest.mark.parametrize(
    ("law", "speed", "motion"),
    [
        ("stribeck_gaussian", 0.2154, (5e-3, 9.3e-6, 0.0111, 1, 0.96, 0.0)),
        ("stribeck_exponential", 0.0666, (1e-3, 4.5e-5, 0.0248, 4, 1.367, 0.0)),
        ("stribeck_gaussian", 0.0561, (1e-2, 1.6e-4, 0.0245, 7, 0.305, 0.0)),
    ],
)
def test_a_dip_of_speed_at_a_knot_is_found(
    law: str, speed: float, motion: tuple[float, float, float, int, float, float]
) -> None:
    """Samples in the middles of pieces, and slopes at extreme states, miss most of these dips."""
    assert agrees(sticking(law, speed, 0.15), dipping(*motion))


@settings(deadline=None, max_examples=6)
@given(
    law=st.sampled_from(["stribeck_exponential", "stribeck_gaussian"]),
    speed=st.floats(-2.0, 0.5),
    rise=st.floats(0.05, 0.3),
    length=st.sampled_from([1e-3, 5e-3, 1e-2]),
    low=st.floats(-6.0, -2.5),
    high=st.floats(-2.5, -1.5),
    width=st.integers(1, 30),
    angle=st.floats(-1.6, 1.6),
    shift=st.floats(-0.5, 0.5),
)
def test_dips_are_found_wherever_they_are(
    law: str,
    speed: float,
    rise: float,
    length: float,
    low: float,
    high: float,
    width: int,
    angle: float,
    shift: float,
) -> None:
    motion = dipping(length, 10.0**low, 10.0**high, width, angle, shift)
    assert agrees(sticking(law, 10.0**speed, rise), motion)
