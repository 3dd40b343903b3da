"""Verify motions that are retimed along their own path, and rounded corners.

The paths are simple and built by hand.
"""

from __future__ import annotations

import numpy as np
import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.planning.retiming.blends import BlendedPath, blend_pieces
from ssm_planner.planning.retiming.paths import MotionPath, StraightPath
from ssm_planner.planning.retiming.retime import retime_motion, retimed_trajectory
from ssm_planner.planning.tolerances import PATH_SAMPLES
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory, quintic_coefficients

START = np.array([0.3, 1.15, 0.1, -0.01])
NONE = TaskLimits()


@pytest.fixture(scope="module")
def mechanism(robot: Robot) -> Mechanism:
    return Mechanism.from_geometry(robot.geometry)


def slow_motion(mechanism: Mechanism, way: float) -> MotionPath:
    """Return a motion of 3 s from rest to rest in two quintic pieces of different lengths.

    Joint 2 moves in the second piece alone.
    """
    zero = np.zeros((1, 4))
    first, second = np.array([way, 0, 0, 2e-3]), np.array([way, -0.1, 0, 1e-3])
    points = START + np.array([np.zeros(4), first, first + second])
    speed = np.array([[way / 2, 0.0, 0.0, 5e-4]])
    pieces = [
        quintic_coefficients(
            np.diff(np.array([0.0, 1.0])), (points[:1], zero, zero), (points[1:2], speed, zero)
        ),
        quintic_coefficients(
            np.diff(np.array([0.0, 2.0])), (points[1:2], speed, zero), (points[2:], zero, zero)
        ),
    ]
    motion = Trajectory(np.array([0.0, 1.0, 3.0]), np.concatenate(pieces), ())
    signs = np.array([[1.0, 0, 0, 1], [1, -1, 0, 1]])
    return MotionPath(mechanism, motion, np.array([0.0, 1 / 3, 1.0]), signs)


def test_a_slow_motion_is_faster_along_its_own_path(mechanism: Mechanism, robot: Robot) -> None:
    path = slow_motion(mechanism, 0.2)
    result = retime_motion(path, robot, NONE)
    assert result.solved
    assert result.duration < 3.0
    assert np.sqrt(result.speed_squared[[0, -1]]) == pytest.approx([1 / 3, 1 / 3])
    assert np.sqrt(result.speed_squared.max()) <= 10 / 3 * (1 + 1e-9)
    slower = retime_motion(path, robot, NONE, speed_ratio=0.5)
    assert np.sqrt(slower.speed_squared[[0, -1]]) == pytest.approx([1 / 6, 1 / 6])
    motion = retimed_trajectory(path, result)
    assert motion.duration == pytest.approx(result.duration, rel=1e-2)
    ends = motion.sample(motion.breaks[[0, -1]]).q
    assert ends == pytest.approx(path.trajectory.sample(np.array([0.0, 3.0])).q)
    # The two grid points beside the break become one.
    assert len(motion.breaks) == len(result.s) - 1
    # The squared speed of the retimed motion is linear in s, also near the break.
    t, x = 3.0 * result.s, 9.0 * result.speed_squared
    behind = int(np.searchsorted(t, 1.0))
    joined = motion.breaks[behind - 1]
    q, qd = (getattr(path.trajectory.sample(np.array([1.0])), key) for key in ("q", "qd"))
    passing = motion.sample(np.array([joined]))
    assert passing.q == pytest.approx(q)
    assert passing.qd == pytest.approx(qd * np.sqrt(np.interp(1.0, t, x)))
    original = path.trajectory.sample(np.linspace(0, 3, 601)).q
    for q in motion.sample(np.linspace(0, motion.duration, 40)).q:
        assert np.abs(original - q).max(axis=1).min() < 2e-3


def test_where_a_joint_rests_it_stands_still_on_the_path(mechanism: Mechanism) -> None:
    samples = slow_motion(mechanism, 0.2).sample(np.array([0.1, 0.6]))
    assert samples.dq[0, 1] == pytest.approx(0.0, abs=1e-12)
    assert samples.dq[1, 1] < -0.1
    assert not samples.dq[:, 2].any()


def corner(mechanism: Mechanism, distance: float, back: bool = False) -> BlendedPath:
    """Return the rounded corner between two straight lines in task coordinates.

    The first line changes the depth. The second changes roll and tilt or, with `back`, the depth in
    the opposite direction.
    """
    task = task_from_joints(mechanism, START[None])[0]
    middle = task + np.array([0.0, 0.0, 0.0, 0.006])
    end = task + np.array([0.0, 0.0, 0.0, 0.001]) if back else middle + [0.4, -0.05, 0.0, 0.0]
    branch = int(mechanism.branch_of(START))
    first = StraightPath(mechanism, task, middle, branch, START)
    joints = first.sample(np.ones(1)).q[0]
    return blend_pieces(
        mechanism, (first, StraightPath(mechanism, middle, end, branch, joints)), (distance,)
    )


@pytest.mark.parametrize("distance", [2e-4, 1e-3])
def test_a_corner_is_left_and_joined_at_its_distance(mechanism: Mechanism, distance: float) -> None:
    """The rounding is smooth and leaves its lines at the given distance from the corner."""
    path = corner(mechanism, distance)
    assert path.breaks.shape == (4,)
    assert (path.breaks[0], path.breaks[-1]) == (0.0, 1.0)
    tips = tip_position(mechanism, path.sample(path.breaks).q)
    before, behind = path.pieces
    corner_tip = tip_position(mechanism, before.sample(np.ones(1)).q)[0]
    assert np.linalg.norm(tips[1:3] - corner_tip, axis=1) == pytest.approx([distance] * 2, rel=1e-6)
    inside = np.linspace(path.breaks[1], path.breaks[2], 41)
    away = np.linalg.norm(tip_position(mechanism, path.sample(inside).q) - corner_tip, axis=1)
    assert away.max() <= distance * (1 + 1e-6)
    s, h = np.linspace(0.01, 0.99, 50), 1e-6
    samples, ahead, back = (path.sample(s + step) for step in (0.0, h, -h))
    scale = 1 + np.abs(samples.ddq).max()
    assert (ahead.q - back.q) / (2 * h) == pytest.approx(samples.dq, abs=1e-6 * scale)
    for order, name in enumerate(("q", "dq", "ddq")):
        left, right = (
            getattr(path.sample(path.breaks[1:3] + step), name) for step in (-1e-9, 1e-9)
        )
        assert left == pytest.approx(right, abs=1e-5 * scale**order)
    knots, signs = path.directions
    assert set(path.breaks.tolist()) <= set(knots.tolist())
    for low, high, sign in zip(knots[:-1], knots[1:], signs, strict=True):
        middle = path.sample(np.linspace(low, high, 12)[1:-1]).dq
        assert np.all(middle * sign >= -1e-7)
        assert np.array_equal(sign != 0, np.abs(middle[5]) > 1e-9)
    assert path.branch == before.branch == behind.branch
    assert path.grid_intervals == PATH_SAMPLES * 3
    turning = path.find_reversal
    for joint in range(4):
        for k in range(len(knots) - 2):
            if signs[k, joint] * signs[k + 1, joint] < 0:
                low, high = knots[k + 1] - 1e-3, knots[k + 1] + 1e-3
                assert turning(joint, low, high) == pytest.approx(knots[k + 1], abs=2e-6)


def test_corners_that_are_too_wide_or_turn_back_are_refused(mechanism: Mechanism) -> None:
    with pytest.raises(ProblemError, match="more than half") as caught:
        corner(mechanism, 4e-3)
    assert "up to 3 mm" in str(caught.value)
    with pytest.raises(ProblemError, match="goes back along"):
        corner(mechanism, 5e-4, back=True)
