"""Pieces of a trajectory, and their use in the check, agree with samples of the trajectory."""

from __future__ import annotations

import numpy as np
import pytest

from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Span, Trajectory
from ssm_planner.verification import pieces as module
from ssm_planner.verification.ends import JumpRecorder
from ssm_planner.verification.limits import WorstValue, limited_quantities
from ssm_planner.verification.pieces import (
    PieceBlock,
    piece_blocks,
    rest_speeds,
    update_polynomial_extremes,
)

COUNT = 7
GRID = np.linspace(0.0, 1.0, 201)


def random_motion(seed: int, count: int = COUNT) -> Trajectory:
    """Return random polynomials with jumps between them, which start at 3 s."""
    rng = np.random.default_rng(seed)
    breaks = 3.0 + np.concatenate([[0.0], np.cumsum(rng.uniform(0.2, 1.5, count))])
    coefficients = rng.normal(size=(count, 6, 4)) * [0.5, 0.5, 0.5, 0.02]
    return Trajectory(breaks, coefficients, (Span("random", breaks[0], breaks[-1]),))


@pytest.fixture(scope="module")
def motion() -> Trajectory:
    return random_motion(1)


@pytest.fixture(scope="module")
def whole(motion: Trajectory) -> PieceBlock:
    (pieces,) = piece_blocks(motion)
    return pieces


def test_values_and_times_are_those_of_the_trajectory(
    motion: Trajectory, whole: PieceBlock
) -> None:
    piece = np.array([2, 0, 6, 2])
    s = np.array([[0.0, 0.3, 1.0, 0.7], [0.5, 0.1, 0.2, 0.9]])
    for row in s:
        expected = motion.sample_pieces(piece, row * np.diff(motion.breaks)[piece])
        result = whole.evaluate(piece, row)
        for values, name in zip(result, ("q", "qd", "qdd"), strict=True):
            assert values == pytest.approx(getattr(expected, name), rel=1e-9, abs=1e-9)
        assert whole.velocities_at(piece, row) == pytest.approx(expected.qd, rel=1e-9, abs=1e-9)
    both = whole.evaluate(piece, s)[0]
    assert both.shape == (2, 4, 4)
    assert both[1] == pytest.approx(whole.evaluate(piece, s[1])[0])
    expected_time = motion.breaks[piece] + s[0] * np.diff(motion.breaks)[piece]
    assert whole.times_at(piece, s[0]) == pytest.approx(expected_time)
    out = np.empty((3, 4, 4))
    whole.evaluate(piece, s[0], out)
    assert whole.velocities_at(piece, s[0]) == pytest.approx(out[1].T)


def test_ends_are_values_there(whole: PieceBlock) -> None:
    every = np.arange(COUNT)
    for ends, s in zip(whole.end_states, (0.0, 1.0), strict=True):
        for order, values in enumerate(whole.evaluate(every, np.full(COUNT, s))):
            assert ends[:, order] == pytest.approx(values, rel=1e-9, abs=1e-9)


def test_bounds_hold_every_value(whole: PieceBlock) -> None:
    lowest, highest = whole.coefficient_bounds
    for order in range(3):
        values = whole.evaluate(np.arange(COUNT), np.tile(GRID[:, None], COUNT))[order]
        assert np.all(values.min(axis=(0, 1)) >= lowest[order] - 1e-9)
        assert np.all(values.max(axis=(0, 1)) <= highest[order] + 1e-9)


def test_segments_cover_every_piece_and_speeds_keep_their_signs(
    whole: PieceBlock, robot: Robot
) -> None:
    piece, start, end = whole.split_at_reversals(robot)
    for k in range(COUNT):
        mine = piece == k
        assert start[mine][0] == 0.0
        assert end[mine][-1] == 1.0
        assert np.array_equal(start[mine][1:], end[mine][:-1])
        assert np.all(end[mine] > start[mine])
        dense = whole.velocities_at(np.full(201, k), GRID)
        turns = np.count_nonzero(np.diff(np.sign(dense), axis=0))
        assert mine.sum() == turns + 1
    inside = start + np.array([[0.01], [0.5], [0.99]]) * (end - start)
    signs = np.sign(whole.velocities_at(piece, inside))
    assert np.all(signs == signs[1])


def test_a_joint_stands_while_it_stays_below_its_threshold(robot: Robot) -> None:
    coefficients = np.zeros((2, 6, 4))
    coefficients[0, 1] = 0.99 * rest_speeds(robot)
    coefficients[1, 1] = -1.01 * rest_speeds(robot)
    (pieces,) = piece_blocks(Trajectory(np.array([0.0, 1.0, 3.0]), coefficients, ()))
    assert pieces.moving_joints(robot).tolist() == [[False] * 4, [True] * 4]


@pytest.mark.parametrize("seed", range(1, 5))
def test_extremes_of_polynomials_are_those_of_dense_evaluation(
    seed: int, robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    motion = random_motion(seed)

    def extremes() -> list[WorstValue]:
        judged = [
            item for item in limited_quantities(robot, TaskLimits()) if item.order is not None
        ]
        worst = [WorstValue(quantity) for quantity in judged]
        for pieces in piece_blocks(motion):
            update_polynomial_extremes(pieces, worst)
        return worst

    worst = extremes()
    assert {item.quantity.order for item in worst} == {0, 1, 2}
    t = np.concatenate(
        [a + GRID * (b - a) for a, b in zip(motion.breaks[:-1], motion.breaks[1:], strict=True)]
    )
    piece = np.repeat(np.arange(COUNT), len(GRID))
    samples = motion.sample_pieces(piece, t - motion.breaks[piece])
    for item in worst:
        quantity = item.quantity
        name = ("q", "qd", "qdd")[quantity.order or 0]
        values = quantity.scale * getattr(samples, name)[:, quantity.index]
        dense = quantity.excess(values, values)
        assert item.excess >= dense.max() - 1e-9
        assert item.excess <= dense.max() + 1e-2 * abs(dense.max())
        k = np.argmin(np.abs(t - item.time))
        assert item.value == pytest.approx(values[k], rel=0.05, abs=0.05)
        exactly = quantity.excess(np.array([item.value]), np.array([item.value]))
        assert exactly[0] == pytest.approx(item.excess, rel=1e-9, abs=1e-9)
    monkeypatch.setattr(module, "PIECES_PER_BLOCK", 2)
    assert len(list(piece_blocks(motion))) == 4
    for one, other in zip(worst, extremes(), strict=True):
        assert (one.excess, one.time) == pytest.approx((other.excess, other.time))


def test_jumps_are_the_differences_at_the_breaks(
    motion: Trajectory, robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    inner = motion.breaks[1:-1]
    before, after = motion.sample(inner, "left"), motion.sample(inner, "right")
    jerky = Robot(**{**vars_of(robot), "joints": with_jerk(robot)})
    for block in (8192, 2):
        monkeypatch.setattr(module, "PIECES_PER_BLOCK", block)
        jumps = JumpRecorder(jerky)
        for pieces in piece_blocks(motion):
            jumps.update(pieces)
        checks = jumps.results()
        assert len(checks) == 9
        assert len(jumps.results(is_table=True)) == 4
        for order, name in enumerate(("q", "qd", "qdd")):
            size = np.abs(getattr(after, name) - getattr(before, name))
            assert jumps.worst[order] == pytest.approx(size.max(axis=0), rel=1e-9)
            assert jumps.time[order] == pytest.approx(inner[size.argmax(axis=0)])
        assert [check.worst for check in checks if check.joint == "spin"] == pytest.approx(
            jumps.worst[:2, 2]
        )


def vars_of(robot: Robot) -> dict[str, object]:
    """Return the fields of a robot by name."""
    names = ("name", "geometry", "bodies", "joints", "gravity", "limits")
    return {name: getattr(robot, name) for name in names}


def with_jerk(robot: Robot) -> tuple[object, ...]:
    """Return the joints of a robot. The jerk of the first joint is limited."""
    from dataclasses import replace

    return (replace(robot.joints[0], jerk=100.0), *robot.joints[1:])
