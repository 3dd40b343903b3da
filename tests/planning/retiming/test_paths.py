"""Verify the paths that TOPP-RA times: joint positions, derivatives by s, reversals and grids.

The references are finite differences and closed forms.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.planning.retiming import paths
from ssm_planner.planning.retiming.paths import (
    JointPath,
    MotionPath,
    PathSamples,
    PolylinePath,
    SplinePath,
    StraightPath,
    TipPath,
    add_knots,
    joint_starts,
    split_at_corners,
)
from ssm_planner.planning.tolerances import PATH_SAMPLES
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory

START = np.array([0.3, 1.15, 0.1, -0.01])
S = np.linspace(0.02, 0.98, 12)
H = 1e-5
ONES = np.ones(4)


@pytest.fixture(scope="module")
def mechanism(robot: Robot) -> Mechanism:
    return Mechanism.from_geometry(robot.geometry)


def straight(mechanism: Mechanism, way: tuple[float, ...], turns: int = 0) -> StraightPath:
    """Return the path from START along `way`, a line in task coordinates (4,), in rad and m.

    Its first position of joint 1 is shifted by `turns` revolutions.
    """
    first = START + np.array([2 * np.pi * turns, 0.0, 0.0, 0.0])
    task = task_from_joints(mechanism, START[None])[0]
    branch = int(mechanism.branch_of(START))
    return StraightPath(mechanism, task, task + np.array(way), branch, first)


def arc(mechanism: Mechanism, angle: float) -> TipPath:
    """Return a tip path around a centre 0.5 mm beside the tip at START, by the angle in rad.

    The arc lies in the plane of x and z. The tip also moves 0.4 mm along y.
    """
    tip = tip_position(mechanism, START[None])[0]
    u, v = np.array([5e-4, 0.0, 0.0]), np.array([0.0, 0.0, 5e-4])
    way = np.array([0.0, 4e-4, 0.0])
    terms = np.stack([tip - u, way, u, v])
    spin = task_from_joints(mechanism, START[None])[0, 2]
    branch = int(mechanism.branch_of(START))
    return TipPath(mechanism, terms, angle, (spin, spin + 0.3), branch, START)


def derivatives_hold(path: JointPath) -> None:
    """Assert that q' and q'' equal central differences of q and q'."""
    samples, ahead, behind = (path.sample(S + h) for h in (0.0, H, -H))
    scale = 1 + np.abs(samples.ddq).max()
    assert (ahead.q - behind.q) / (2 * H) == pytest.approx(samples.dq, abs=1e-6 * scale)
    assert (ahead.dq - behind.dq) / (2 * H) == pytest.approx(samples.ddq, abs=1e-5 * scale)


def directions_hold(path: JointPath) -> None:
    """Assert that no joint reverses between two knots, and that one reverses at each inner knot."""
    knots, signs = path.directions
    assert (knots[0], knots[-1]) == (0.0, 1.0)
    assert signs.shape == (len(knots) - 1, 4)
    for low, high, sign in zip(knots[:-1], knots[1:], signs, strict=True):
        s = low + (high - low) * np.linspace(0.01, 0.99, 21)
        assert np.all(path.sample(s).dq * sign >= -1e-9)
    for before, after in pairwise(signs):
        assert np.any(before * after < 0)


@pytest.mark.parametrize("turns", [0, 1, -2])
def test_a_straight_path_is_straight_in_task_coordinates(mechanism: Mechanism, turns: int) -> None:
    path = straight(mechanism, (0.5, -0.1, 0.2, 0.004), turns)
    samples = path.sample(S)
    task = task_from_joints(mechanism, samples.q)
    expected = path.start + S[:, None] * (path.end - path.start)
    assert np.cos(task[:, :3] - expected[:, :3]) == pytest.approx(np.ones((12, 3)), abs=1e-9)
    assert task[:, 3] == pytest.approx(expected[:, 3])
    assert path.sample(np.zeros(1)).q[0] == pytest.approx(path.first, abs=1e-9)
    derivatives_hold(path)
    directions_hold(path)


@pytest.mark.parametrize("angle", [0.0, 1.2, -2.5])
def test_a_path_of_the_tip_has_an_even_speed_along_its_arc(
    mechanism: Mechanism, angle: float
) -> None:
    path = arc(mechanism, angle)
    samples = path.sample(S)
    fixed, way, u, v = path.terms
    turn = (angle * S)[:, None]
    expected = fixed + S[:, None] * way + np.cos(turn) * u + np.sin(turn) * v
    assert path.tips(S) == pytest.approx(expected)
    assert tip_position(mechanism, samples.q) == pytest.approx(expected, abs=1e-9)
    spins = task_from_joints(mechanism, samples.q)[:, 2]
    assert np.ptp(np.unwrap(spins) - 0.3 * S) == pytest.approx(0.0, abs=1e-9)
    derivatives_hold(path)
    directions_hold(path)


def test_a_turning_point_that_rounding_hides_is_the_end_with_the_smaller_slope(
    mechanism: Mechanism,
) -> None:
    """If rounding hides a reversal, it is placed at the end with the smaller slope."""
    path = arc(mechanism, 1.2)
    slopes = path.sample(np.array([0.4, 0.6])).dq
    for joint in np.flatnonzero((slopes[0] * slopes[1] > 0) & (slopes[0] != slopes[1])):
        nearer = (0.4, 0.6)[int(np.argmin(np.abs(slopes[:, joint])))]
        assert path.find_reversal(int(joint), 0.4, 0.6) == nearer


@pytest.fixture(scope="module")
def spline(mechanism: Mechanism) -> SplinePath:
    rng = np.random.default_rng(8)
    points = START + rng.normal(size=(7, 4)) * [0.2, 0.1, 0.1, 2e-3]
    points[:, 2] = 0.1  # Joint 3 stands still.
    return SplinePath(mechanism, points, np.array([1.0, 1.0, 1.0, 0.01]))


def test_a_spline_passes_its_points_at_the_share_of_their_way(spline: SplinePath) -> None:
    """A spline passes its points at nodes in proportion to the distance along the points."""
    steps = np.linalg.norm(np.diff(spline.points, axis=0) / spline.scale, axis=1)
    assert spline.nodes == pytest.approx(np.append(0.0, np.cumsum(steps)) / steps.sum())
    assert spline.sample(spline.nodes).q == pytest.approx(spline.points)
    ends = spline.sample(np.array([0.0, 1.0]))
    assert ends.ddq == pytest.approx(np.zeros((2, 4)), abs=1e-9)
    assert not spline.sample(S).dq[:, 2].any()
    derivatives_hold(spline)
    directions_hold(spline)
    assert np.array_equal(spline.breaks, [0.0, 1.0])
    s = np.linspace(0.0, 1.0, 4001)
    lines = np.column_stack([np.interp(s, spline.nodes, p) for p in spline.points.T])
    off = np.abs(spline.sample(s).q - lines).max(axis=0)
    assert np.all(spline.deviation_from_lines <= off + 1e-12)
    assert spline.deviation_from_lines == pytest.approx(off, rel=0.05, abs=1e-9)


def test_pieces_of_a_spline_are_knots_where_they_are_told_apart(spline: SplinePath) -> None:
    """With `pieces=True`, each node of the spline is also a knot."""
    apart = SplinePath(spline.mechanism, spline.points, spline.scale, pieces=True)
    assert np.array_equal(apart.breaks, apart.nodes)
    knots, _ = apart.directions
    turning = spline.directions[0][1:-1]
    assert len(turning) > 0
    assert knots == pytest.approx(np.sort(np.concatenate([apart.nodes, turning])))
    many = SplinePath(spline.mechanism, np.tile(spline.points, (40, 1)), spline.scale)
    assert spline.grid_intervals == paths.MIN_GRID_INTERVALS
    assert many.grid_intervals == paths.INTERVALS_PER_POINT * 280


def test_a_polyline_is_straight_from_point_to_point(mechanism: Mechanism) -> None:
    points = START + np.array([[0, 0, 0, 0], [0.2, 0, 0, 0], [0.1, 0.1, 0, 0.001]])
    path = PolylinePath(mechanism, points)
    samples = path.sample(np.array([0.0, 0.25, 0.5, 0.75, 1.0]))
    assert samples.q[[0, 2, 4]] == pytest.approx(points)
    assert samples.q[[1, 3]] == pytest.approx((points[1:] + points[:-1]) / 2)
    assert samples.dq[1] == pytest.approx(2 * (points[1] - points[0]))
    assert samples.dq[4] == pytest.approx(2 * (points[2] - points[1]))
    assert not samples.ddq.any()
    knots, signs = path.directions
    assert knots.tolist() == [0.0, 0.5, 1.0]
    assert signs.tolist() == [[1, 0, 0, 0], [-1, 1, 0, 1]]


def test_curves_are_cut_where_they_turn_by_more_than_thirty_degrees() -> None:
    def run(*angles: float) -> list[int]:
        turned = np.cumsum(np.radians(angles))
        steps = np.column_stack([np.cos(turned), 2 * np.sin(turned), 0 * turned, 0 * turned])
        points = np.vstack([np.zeros(4), np.cumsum(steps, axis=0)])
        points = np.insert(points, 2, points[2], axis=0)  # A repeated point counts once.
        runs = split_at_corners(points, np.array([1.0, 2.0, 1.0, 1.0]))
        for before, after in pairwise(runs):
            assert np.array_equal(before[-1], after[0])
        return [len(part) for part in runs]

    assert run(0, 29, -29, 29) == [5]
    assert run(0, 31, 0, 0) == [2, 4]
    assert run(0, 0, 0, -31) == [4, 2]
    assert run(90, 90, 180, 0) == [2, 2, 3]
    assert split_at_corners(np.tile(START, (3, 1)), ONES) == []


def test_knots_that_are_close_are_one() -> None:
    knots = add_knots(np.array([0.0, 0.5, 1.0]), [0.7, 0.5 + 0.9e-6, 0.7 + 0.9e-6, 0.2, 1 - 1e-7])
    assert knots.tolist() == [0.0, 0.2, 0.5, 0.7, 1.0]
    assert len(add_knots(np.array([0.0, 1.0]), [1.1e-6])) == 3


def test_joints_begin_where_their_direction_changes() -> None:
    """A joint starts at the first sample and at samples where its direction changes."""
    s = np.linspace(0.0, 1.0, 5)
    dq = np.ones((5, 4))
    dq[0, 1] = 0.0
    signs = np.array([[1.0, 1, 0, 0], [1.0, -1, 1, 0]])
    samples, knots = PathSamples(s, dq, dq, dq), np.array([0.0, 0.5, 1.0])
    expected = np.zeros((5, 4), dtype=bool)
    expected[0, :2] = expected[2, 1:3] = True
    assert np.array_equal(joint_starts(samples, knots, signs), expected)
    expected[0, 0] = False  # The motion has speed at this start.
    assert np.array_equal(joint_starts(samples, knots, signs, moving=True), expected)


@pytest.fixture(scope="module")
def motion_path(mechanism: Mechanism) -> MotionPath:
    """Return the path of a motion of 2 s in which only joint 1 moves.

    Joint 1 reverses at 1 s, where its acceleration jumps.
    """
    coefficients = np.zeros((2, 6, 4))
    coefficients[:, 0] = START
    coefficients[0, 1:3, 0] = 0.4, -0.2
    coefficients[1, 0, 0] += 0.2
    coefficients[1, 2, 0] = -0.3
    trajectory = Trajectory(np.array([0.0, 1.0, 2.0]), coefficients, ())
    signs = np.array([[1.0, 0, 0, 0], [-1.0, 0, 0, 0]])
    return MotionPath(mechanism, trajectory, np.array([0.0, 0.5, 1.0]), signs)


def test_the_path_of_a_motion_is_the_motion(motion_path: MotionPath) -> None:
    samples = motion_path.sample(np.array([0.25, 0.75, 1.2]))
    expected = motion_path.trajectory.sample(np.array([0.5, 1.5, 2.0]))
    assert samples.q == pytest.approx(expected.q)
    assert samples.dq == pytest.approx(2 * expected.qd)
    assert samples.ddq == pytest.approx(4 * expected.qdd)
    assert not samples.dq[:, 1:].any()
    derivatives_hold(motion_path)
    grid = motion_path.grid(104)
    assert (grid[0], grid[-1]) == (0.0, 1.0)
    assert np.all(np.diff(grid) > 0)
    assert len(grid) == pytest.approx(104, abs=4)
    beside = np.sort(np.abs(grid - 0.5))[:2]
    assert beside == pytest.approx([0.5e-4, 0.5e-4])
    assert 0.5 not in grid
    starts = joint_starts(motion_path.sample(grid), *motion_path.directions, moving=True)
    assert starts[:, 0].sum() == 1
    assert np.abs(grid[np.argmax(starts[:, 0])] - 0.5) < 1e-3
    assert not starts[:, 1:].any()


def test_the_rate_along_a_path_follows_from_the_joints_speeds(spline: SplinePath) -> None:
    """The path speed follows from the joint velocities and the slopes of the path."""
    slope = spline.sample(np.array([0.4])).dq[0]
    assert spline.speed_at(0.4, 0.7 * slope) == pytest.approx(0.7)
    assert spline.speed_at(0.4, np.zeros(4)) == 0.0
    knots, signs = spline.directions
    starts = joint_starts(spline.sample(np.array([0.0, knots[1] / 2, 1.0])), knots, signs)
    assert starts[:2].tolist() == [(signs[0] != 0).tolist(), [False] * 4]
    assert spline.coarse_samples.q == pytest.approx(
        spline.sample(np.linspace(0, 1, PATH_SAMPLES)).q
    )


class Waves(paths.ClosedPath):
    """A path whose joints are sine waves of s, with known slopes.

    Joint 3 stands still, and joint 4 is not in `driven`.
    """

    branch = 1
    driven = (0, 1, 2)
    first = np.array([4 * np.pi, 0.0, 0.0, 0.0])
    turns = (3.0, 1.0, 0.0, 5.0)
    parameters = task = None  # The closed form is not a function of CasADi.

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism

    def _without_whole_turns(self, s: np.ndarray) -> tuple[np.ndarray, ...]:
        rate = np.pi * np.array(self.turns)
        phase = np.outer(s, rate)
        q = np.sin(phase) + [0.0, 0.1, 0.2, 0.3]
        return q, rate * np.cos(phase), -(rate**2) * np.sin(phase)


def test_knots_lie_where_driven_joints_reverse(mechanism: Mechanism) -> None:
    """A joint without a drive or without motion gets no direction and no knot."""
    path = Waves(mechanism)
    knots, signs = path.directions
    assert knots == pytest.approx([0.0, 1 / 6, 1 / 2, 5 / 6, 1.0], abs=1e-12)
    assert signs.tolist() == [[1, 1, 0, 0], [-1, 1, 0, 0], [1, -1, 0, 0], [-1, -1, 0, 0]]
    s = np.linspace(0.0, 1.0, 7)
    assert path.sample(s).q[:, 0] == pytest.approx(np.sin(3 * np.pi * s) + 4 * np.pi)
    assert path.sample(s).q[:, 3] == pytest.approx(np.sin(5 * np.pi * s) + 0.3)


@pytest.mark.parametrize("root", [0.2, 0.25, 0.7])
@pytest.mark.parametrize("swapped", [False, True])
def test_sign_changes_are_found_to_the_last_digits(root: float, swapped: bool) -> None:
    """The first end may be the larger one. Of several roots, the one nearest to it is returned."""
    low, high = (1.0, 0.1) if swapped else (0.1, 1.0)
    for sign in (1.0, -1.0):
        result = paths.find_sign_change(lambda s: sign * (s - root), low, high)  # noqa: B023
        assert result == pytest.approx(root, abs=1e-11)
    three = paths.find_sign_change(lambda s: (s - 0.2) * (s - 0.5) * (s - 0.8), low, high)
    assert three == pytest.approx(0.8 if swapped else 0.2, abs=1e-11)


@pytest.mark.parametrize("seed", range(4))
def test_reversals_of_a_spline_are_the_roots_of_its_slopes(mechanism: Mechanism, seed: int) -> None:
    """Between knots, every joint keeps the direction of its slope. A joint at rest has none."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(6, 4)) * [1, 1, 0, 1e-2]
    for pieces in (False, True):
        path = SplinePath(mechanism, points, np.array([1, 1, 1, 1e-2]), pieces)
        knots, signs = path.directions
        assert (knots[0], knots[-1]) == (0.0, 1.0)
        assert not signs[:, 2].any()
        for (low, high), sign in zip(pairwise(knots), signs, strict=True):
            inside = low + (high - low) * np.linspace(1e-3, 1 - 1e-3, 50)
            assert np.all(np.sign(path.sample(inside).dq) == sign)
        reversing = np.any(signs[1:] != signs[:-1], axis=1)
        assert np.all(reversing | np.isin(knots[1:-1], path.nodes)) or not pieces
        assert pieces or reversing.all()


@pytest.mark.parametrize("seed", range(5))
def test_a_joint_starts_at_the_first_sample_behind_its_knot(seed: int) -> None:
    rng = np.random.default_rng(seed)
    s = np.sort(rng.uniform(0.0, 0.9, 12))
    samples = paths.PathSamples(s, *np.zeros((3, 12, 4)))
    knots = np.array([0.0, *np.sort(rng.uniform(0.0, 1.0, 3)), 0.95, 1.0])
    signs = np.tile(np.array([[1.0], [-1.0]]), (3, 4))[: len(knots) - 1]
    expected = np.zeros((12, 4), dtype=bool)
    for knot in knots[:-1]:
        behind = [k for k in range(12) if s[k] >= knot]
        expected[behind[0] if behind else 11] = True
    assert np.array_equal(joint_starts(samples, knots, signs), expected)


def test_a_slope_that_vanishes_at_the_end_is_no_knot(mechanism: Mechanism) -> None:
    # The natural spline through (0, 0), (1/2, 5) and (1, 6) has the slope 0 at its end.
    points = np.zeros((3, 4))
    points[:, 0] = [0.0, 0.5, 1.0]
    points[:, 1] = [0.0, 5e-7, 6e-7]
    path = SplinePath(mechanism, points, np.ones(4))
    assert abs(path.sample(np.array([1.0])).dq[0, 1]) < 1e-15
    knots, signs = path.directions
    assert np.array_equal(knots, [0.0, 1.0])
    assert np.array_equal(signs[0], [1.0, 1.0, 0.0, 0.0])
