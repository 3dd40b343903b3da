"""The joints of the inverse kinematics reach the given pose on every branch.

Special cases are the boundary of the workspace, unreachable targets, depth 0, tip targets and
invalid input.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.forward import forward
from ssm_planner.kinematics.inverse import inverse_task, inverse_tip
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.rotations import rotation
from ssm_planner.kinematics.solutions import Solutions
from ssm_planner.kinematics.task import pose_from_task, task_from_joints
from ssm_planner.kinematics.workspace import tilt_interval
from tests.support.paden_kahan import subproblem_1, subproblem_2, subproblem_3_prime
from tests.support.pose_inverse import LEVER, inverse


def worst_miss(
    mech: Mechanism, found: Solutions, rotations: np.ndarray, positions: np.ndarray
) -> float:
    """Return the largest difference between the given poses and the poses of all branches."""
    worst = 0.0
    for k in range(found.joints.shape[1]):
        reached = forward(mech, found.joints[:, k])
        worst = max(
            worst, np.abs(reached[0] - rotations).max(), np.abs(reached[1] - positions).max()
        )
    return worst


def angle_gap(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.abs(np.remainder(a - b + math.pi, 2.0 * math.pi) - math.pi)


def test_a_million_random_poses_of_random_mechanisms(random_mechanism):
    """Both branches reach each of a million random poses.

    The mechanisms are random too. One of the branches gives the joints from which the pose was
    computed.
    """
    rng = np.random.default_rng(11)
    for _ in range(500):
        mech = random_mechanism(rng)
        q = rng.uniform(-math.pi, math.pi, (2000, 4)) * [1.0, 1.0, 1.0, 0.1]
        rotations, positions = forward(mech, q)
        result = inverse(mech, rotations, positions)
        assert result.reachable.all()
        assert worst_miss(mech, result, rotations, positions) < 1e-10
        assert max(result.orientation_error.max(), result.tip_error.max()) < 1e-10
        branch = np.sin(result.joints[..., 1] - mech.delta)
        assert np.all(branch[:, 0] >= 0.0)
        assert np.all(branch[:, 1] <= 0.0)
        assert np.all(
            angle_gap(result.joints[..., :3], q[:, np.newaxis, :3]).max(axis=2).min(axis=1) < 1e-5
        )


def test_task_and_pose_agree_on_every_branch(random_mechanism):
    rng = np.random.default_rng(12)
    for _ in range(100):
        mech = random_mechanism(rng)
        task = rng.uniform(-math.pi, math.pi, (200, 4))
        magnitude = rng.uniform(*sorted(np.abs(tilt_interval(mech))), 200)
        task[:, 1] = magnitude * rng.choice([-1.0, 1.0], 200)
        from_pose = inverse(mech, *pose_from_task(mech, task))
        from_task = inverse_task(mech, task)
        assert np.array_equal(from_pose.branch, from_task.branch)
        assert from_task.reachable.all()
        assert worst_miss(mech, from_task, *pose_from_task(mech, task)) < 1e-10
        # Near the boundary, only half of the digits of θ2 are accurate.
        gap = angle_gap(from_pose.joints[..., :3], from_task.joints[..., :3]).max(axis=(1, 2))
        inside = np.minimum(
            magnitude - np.abs(tilt_interval(mech)).min(),
            np.abs(tilt_interval(mech)).max() - magnitude,
        )
        assert np.all(gap[inside > 1e-2] < 1e-11)


@pytest.mark.parametrize("shape", ["any", "equal", "supplementary"])
def test_within_a_microradian_of_the_boundary(random_mechanism, shape):
    rng = np.random.default_rng(13)
    for _ in range(100):
        alpha = rng.uniform(0.1, math.pi - 0.1)
        beta = {"any": None, "equal": alpha, "supplementary": math.pi - alpha}[shape]
        mech = random_mechanism(rng, alpha, beta)
        low, high = tilt_interval(mech)
        task = rng.uniform(-3.0, 3.0, (400, 4)) * [1.0, 1.0, 1.0, 0.03]
        task[:200, 1] = low + rng.uniform(0.0, 1e-6, 200) * rng.choice([1.0, 1e-3, 1e-6, 0.0], 200)
        task[200:, 1] = high - rng.uniform(0.0, 1e-6, 200) * rng.choice([1.0, 1e-3, 1e-6, 0.0], 200)
        rotations, positions = pose_from_task(mech, task)
        for result in (inverse(mech, rotations, positions), inverse_task(mech, task)):
            assert result.reachable.all()
            assert worst_miss(mech, result, rotations, positions) < 1e-7


def test_steps_of_the_paper_give_the_same_joints(random_mechanism):
    rng = np.random.default_rng(14)
    mech = random_mechanism(rng, 0.7, 1.8)
    zero = np.zeros(3)
    for q in rng.uniform(-3.0, 3.0, (50, 4)):
        rotations, positions = forward(mech, q)
        turned = rotations[0] @ mech.tool_home.T  # g_d g_0⁻¹ = (turned, positions)
        theta4, count = subproblem_3_prime(mech.omega3, zero, zero, np.linalg.norm(positions[0]))
        assert count == 2
        tool = turned @ mech.omega3
        chosen = theta4[np.argmin([np.linalg.norm(tool * item - positions[0]) for item in theta4])]
        p2 = mech.omega3
        q2 = turned @ (p2 - mech.omega3 * chosen) + positions[0]
        theta1, theta2, _ = subproblem_2(mech.omega1, mech.omega2, p2, q2)
        result = inverse(mech, rotations, positions)
        for k in range(2):
            p3 = mech.tool_home[:, 0]
            elbow = rotation(mech.omega1, theta1[k]) @ rotation(mech.omega2, theta2[k])
            theta3 = subproblem_1(mech.omega3, p3, elbow.T @ turned @ p3)
            joints = np.array([theta1[k], theta2[k], theta3, chosen])
            gap = np.append(
                angle_gap(result.joints[0, k, :3], joints[:3]), result.joints[0, k, 3] - chosen
            )
            assert np.abs(gap).max() < 1e-10


def test_joints_from_task_are_continuous_along_a_path(random_mechanism):
    rng = np.random.default_rng(15)
    way = np.linspace(0.0, 1.0, 4001)
    for _ in range(30):
        mech = random_mechanism(rng, rng.uniform(0.3, 2.8), rng.uniform(0.3, 2.8))
        low, high = tilt_interval(mech)
        task = np.column_stack(
            (12.0 * way, low + (high - low) * (0.02 + 0.96 * way), -9.0 * way, way)
        )
        joints = inverse_task(mech, task).joints
        assert np.abs(np.diff(joints[..., :3], axis=0)).max() < 0.2


def test_an_unreachable_pointing_is_moved_to_the_nearest(random_mechanism):
    rng = np.random.default_rng(16)
    grid = np.linspace(-math.pi, math.pi, 121)
    for _ in range(20):
        mech = random_mechanism(rng, rng.uniform(0.3, 1.2), rng.uniform(0.3, 1.2))
        high = np.abs(tilt_interval(mech)).max()
        tilt = high + rng.uniform(0.05, math.pi - high - 0.1, 5)
        task = np.column_stack(
            (*rng.uniform(-3.0, 3.0, (1, 5)), tilt, rng.uniform(-3.0, 3.0, 5), np.full(5, 0.02))
        )
        rotations, positions = pose_from_task(mech, task)
        places = (
            rotation(mech.omega1, grid)[:, np.newaxis]
            @ (rotation(mech.omega2, grid) @ mech.omega3)[..., np.newaxis]
        )
        for result in (inverse(mech, rotations, positions), inverse_task(mech, task)):
            assert not result.reachable.any()
            assert not result.reaches.any()
            assert np.abs(result.orientation_error - (tilt - high)).max() < 1e-12
            for k in range(2):
                reached, tips = forward(mech, result.joints[:, k])
                turned = Rotation.from_matrix(np.swapaxes(reached, 1, 2) @ rotations).magnitude()
                assert np.abs(turned - result.orientation_error).max() < 1e-7
                assert (
                    np.abs(np.linalg.norm(tips - positions, axis=1) - result.tip_error).max()
                    < 1e-12
                )
            for i in range(5):
                nearest = np.linalg.norm(places[..., 0] - rotations[i, :, 2], axis=-1).min()
                assert 2.0 * math.sin(result.orientation_error[i] / 2.0) <= nearest + 1e-12


def test_a_pose_whose_axis_misses_the_rcm(vitreoretinal):
    rng = np.random.default_rng(17)
    q = rng.uniform(-1.0, 1.0, (100, 4)) * [1.0, 0.5, 1.0, 0.01] - [0.0, 0.0, 0.0, 0.02]
    rotations, positions = forward(vitreoretinal, q)
    shifted = positions + rng.uniform(-1e-3, 1e-3, (100, 3))
    result = inverse(vitreoretinal, rotations, shifted)
    assert not result.reachable.any()
    for k in range(2):
        reached, tips = forward(vitreoretinal, result.joints[:, k])
        turned = Rotation.from_matrix(np.swapaxes(reached, 1, 2) @ rotations).magnitude()
        assert np.abs(turned - result.orientation_error).max() < 1e-7
        assert np.abs(np.linalg.norm(tips - shifted, axis=1) - result.tip_error).max() < 1e-12
    # No neighbouring pointing with the same θ4 has a smaller cost.
    theta4 = np.sum(shifted * rotations[:, :, 2], axis=1, keepdims=True)

    def cost(pointing: np.ndarray) -> np.ndarray:
        tip = np.sum((shifted - theta4 * pointing) ** 2, axis=1)
        return tip + LEVER**2 * np.sum((pointing - rotations[:, :, 2]) ** 2, axis=1)

    chosen = forward(vitreoretinal, result.joints[:, 0])[0][:, :, 2]
    for _ in range(20):
        other = chosen + 1e-3 * rng.standard_normal((100, 3))
        other /= np.linalg.norm(other, axis=1, keepdims=True)
        assert np.all(cost(chosen) <= cost(other) + 1e-18)


def test_the_orientation_alone_determines_the_joints_at_depth_zero(vitreoretinal):
    task = np.array([[0.3, -2.0, 0.4, 0.0]])
    rotations, positions = pose_from_task(vitreoretinal, task)
    assert np.array_equal(positions, np.zeros((1, 3)))
    result = inverse(vitreoretinal, rotations, positions)
    assert result.reachable.all()
    assert worst_miss(vitreoretinal, result, rotations, positions) < 1e-14
    # Noise of a micrometre at the tip turns the tool by microradians.
    noisy = inverse(vitreoretinal, rotations, np.array([1e-6, -1e-6, 1e-6]))
    assert np.abs(noisy.joints[..., :3] - result.joints[..., :3]).max() < 1e-5


def test_tip_targets_have_up_to_four_solutions():
    mech = Mechanism.from_angles(math.radians(60.0), math.radians(85.0))
    tip = pose_from_task(mech, np.array([[0.4, math.radians(-80.0), 0.2, 0.02]]))[1]
    result = inverse_tip(mech, tip, 0.2)
    assert result.reaches.tolist() == [[True] * 4]
    for k in range(4):
        task = task_from_joints(mech, result.joints[:, k])[0]
        assert np.abs(forward(mech, result.joints[:, k])[1] - tip).max() < 1e-15
        assert task[2] == pytest.approx(0.2, abs=1e-12)
        assert task[3] == pytest.approx(0.02 if k < 2 else -0.02, abs=1e-15)
    assert len(np.unique(result.joints[0].round(9), axis=0)) == 4


def test_tip_targets_out_of_reach_are_flagged(vitreoretinal):
    on_roll_axis = np.array([[0.01, 0.0, 0.0]])
    result = inverse_tip(vitreoretinal, on_roll_axis)
    assert not result.reachable[0]
    misses = [
        np.linalg.norm(forward(vitreoretinal, result.joints[:, k])[1] - on_roll_axis)
        for k in range(4)
    ]
    assert min(misses) == pytest.approx(float(result.tip_error[0]), abs=1e-15)
    assert result.tip_error[0] == pytest.approx(
        0.01 * math.sin(math.radians(180.0 - 139.7783933)), abs=1e-9
    )


def test_a_tip_at_the_rcm_keeps_the_pointing(vitreoretinal):
    home = inverse_tip(vitreoretinal, np.zeros((1, 3)), 0.1)
    assert home.reaches.tolist() == [[True, True, False, False]]
    assert np.abs(home.joints[0, 1] - [0.0, 0.0, 0.1, 0.0]).max() < 1e-12
    reference = np.array([0.3, -0.2, 0.1, -0.01])
    solutions = inverse_tip(vitreoretinal, np.zeros((1, 3)), 0.1, reference=reference)
    assert np.abs(solutions.joints[0, 0, :2] - reference[:2]).max() < 1e-12


def test_parallel_axes_have_no_inverse():
    with pytest.raises(
        GeometryError, match=r"beta = 3.14159 rad: joints 2 and 3 turn about one axis"
    ):
        inverse_task(Mechanism.from_angles(1.0, math.pi), np.zeros(4))


def test_bad_tip_targets_name_the_argument(vitreoretinal):
    with pytest.raises(GeometryError, match=r"spin has shape \(3,\): must be \(2,\)"):
        inverse_tip(vitreoretinal, np.zeros((2, 3)), np.zeros(3))
    with pytest.raises(GeometryError, match=r"spin of shape \(\) is not finite"):
        inverse_tip(vitreoretinal, np.zeros((2, 3)), math.nan)


def test_an_empty_batch_is_a_batch(vitreoretinal):
    """An empty batch of targets gives an empty batch of solutions."""
    assert inverse(vitreoretinal, np.empty((0, 3, 3)), np.empty((0, 3))).joints.shape == (0, 2, 4)
    assert inverse_task(vitreoretinal, np.empty((0, 4))).joints.shape == (0, 2, 4)
    assert inverse_tip(vitreoretinal, np.empty((0, 3))).joints.shape == (0, 4, 4)
