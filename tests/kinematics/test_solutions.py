"""Solutions are chosen by joint limits, distance to a reference and continuity along a path."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.forward import forward
from ssm_planner.kinematics.inverse import inverse_task
from ssm_planner.kinematics.solutions import JOINT_DISTANCE_WEIGHTS, nearest_turn
from ssm_planner.kinematics.task import pose_from_task
from tests.support.pose_inverse import inverse

WIDE = np.array([(-2.0 * math.pi, 2.0 * math.pi)] * 3 + [(-0.03, 0.0)])


def poses(rng: np.random.Generator, mech, count: int):
    q = rng.uniform(-math.pi, math.pi, (count, 4)) * [1.0, 1.0, 1.0, 0.009]
    return forward(mech, q)


def test_limits_mark_and_whole_turns_move_solutions_inside(vitreoretinal):
    rng = np.random.default_rng(21)
    rotations, positions = poses(rng, vitreoretinal, 500)
    limits = np.array([(2.0, 7.0), (-1.5, 2.5), (-7.0, -2.0), (-0.03, 0.03)])
    free = inverse(vitreoretinal, rotations, positions)
    result = inverse(vitreoretinal, rotations, positions, limits=limits)
    inside = np.all((result.joints >= limits[:, 0]) & (result.joints <= limits[:, 1]), axis=2)
    assert np.array_equal(result.in_limits, inside)
    assert 0 < np.count_nonzero(result.valid) < result.valid.size
    turns = (result.joints - free.joints)[..., :3] / (2.0 * math.pi)
    assert np.abs(turns - turns.round()).max() < 1e-12
    # A solution is outside the limits only if whole turns cannot bring each joint inside.
    shifted = free.joints[..., :3, np.newaxis] + 2.0 * math.pi * np.arange(-3, 4)
    low, high = limits[:3, 0, np.newaxis], limits[:3, 1, np.newaxis]
    possible = np.all(np.any((shifted >= low) & (shifted <= high), axis=-1), axis=-1)
    assert np.array_equal(result.in_limits, possible & (np.abs(free.joints[..., 3]) <= 0.03))


def test_solutions_are_ordered_by_distance_over_whole_turns(vitreoretinal):
    rng = np.random.default_rng(22)
    rotations, positions = poses(rng, vitreoretinal, 300)
    reference = rng.uniform(-9.0, 9.0, (300, 4))
    result = inverse(vitreoretinal, rotations, positions, reference=reference)
    distance = np.linalg.norm(
        (result.joints - reference[:, np.newaxis]) * JOINT_DISTANCE_WEIGHTS, axis=2
    )
    assert np.all(np.diff(distance, axis=1) >= 0.0)
    assert np.all(np.abs(result.joints - reference[:, np.newaxis])[..., :3] <= math.pi + 1e-12)
    assert np.array_equal(
        result.branch, np.sign(np.sin(result.joints[..., 1] - vitreoretinal.delta))
    )
    for k in range(2):
        assert np.abs(forward(vitreoretinal, result.joints[:, k])[0] - rotations).max() < 1e-12


def test_valid_solutions_come_first(vitreoretinal):
    rng = np.random.default_rng(23)
    rotations, positions = poses(rng, vitreoretinal, 300)
    limits = np.array([*WIDE[:3], (-0.03, 0.03)])
    limits[1] = (-1.36, 1.78)
    result = inverse(vitreoretinal, rotations, positions, limits=limits, reference=np.full(4, 2.5))
    assert np.all(result.valid[:, 0] >= result.valid[:, 1])
    assert result.valid[:, 0].all()
    assert not result.valid[:, 1].all()


def test_the_nearest_turn_is_within_half_a_turn():
    rng = np.random.default_rng(24)
    angle, centre = rng.uniform(-50.0, 50.0, (2, 1000))
    moved = nearest_turn(angle, centre)
    assert np.all((moved > centre - math.pi - 1e-12) & (moved <= centre + math.pi + 1e-12))
    assert np.abs(np.sin((moved - angle) / 2.0)).max() < 1e-12


def test_each_solution_keeps_its_branch_along_a_path_and_never_jumps(vitreoretinal):
    way = np.linspace(0.0, 1.0, 2001)
    task = np.column_stack((9.0 * way, -1.5 - 0.9 * np.sin(3.0 * way) ** 2, -8.0 * way, 0.02 * way))
    result = inverse(vitreoretinal, *pose_from_task(vitreoretinal, task))
    for k, branch in enumerate((1, -1)):
        path = result.joints[:, k].copy()
        path[:, :3] = np.unwrap(path[:, :3], axis=0)
        assert np.abs(np.diff(path, axis=0)).max() < 0.05
        assert np.all(np.sign(np.sin(path[:, 1] - vitreoretinal.delta)) == branch)
        reached = forward(vitreoretinal, path)
        for a, b in zip(reached, pose_from_task(vitreoretinal, task), strict=True):
            assert np.abs(a - b).max() < 1e-12
    assert inverse_task(vitreoretinal, np.empty((0, 4))).joints.shape == (0, 2, 4)


def test_bad_arguments_are_named(vitreoretinal):
    task = [[0.0, -2.0, 0.0, 0.0]]
    with pytest.raises(GeometryError, match=r"limits has shape \(2, 4\).*transposed"):
        inverse_task(vitreoretinal, task, limits=WIDE.T)
    with pytest.raises(GeometryError, match=r"limits\[1\] = \[-180.0, 180.0\].*not degrees"):
        inverse_task(vitreoretinal, task, limits=[WIDE[0], (-180.0, 180.0), WIDE[2], WIDE[3]])
    with pytest.raises(GeometryError, match=r"limits\[0\] .*must not exceed"):
        inverse_task(vitreoretinal, task, limits=[(1.0, -1.0), *WIDE[1:]])
    with pytest.raises(GeometryError, match=r"limits\[2\] .*must not exceed"):
        inverse_task(vitreoretinal, task, limits=[*WIDE[:2], (math.nan, 1.0), WIDE[3]])
    with pytest.raises(GeometryError, match=r"reference has shape \(3, 4\)"):
        inverse_task(vitreoretinal, task, reference=np.zeros((3, 4)))


def test_joints_without_limits_may_turn_without_end(vitreoretinal):
    """Joints without limits take the number of whole turns that is nearest to the reference."""
    unlimited = [(-math.inf, math.inf)] * 3 + [(-0.03, 0.0)]
    result = inverse_task(
        vitreoretinal, [[40.0, -2.0, 0.0, 0.02]], limits=unlimited, reference=np.full(4, 37.0)
    )
    assert result.valid.all()
    assert np.abs(result.joints[..., :3] - 37.0).max() <= math.pi
