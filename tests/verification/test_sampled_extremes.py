"""The check samples intervals of a motion, brackets the values between the samples, and integrates
mean squares. The references are dense evaluations and closed forms.
"""

from __future__ import annotations

import numpy as np
import pytest

from ssm_planner.dynamics import RigidBody, motor_motion
from ssm_planner.problem.limits import ContinuousTorque, MotorTorque
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.verification.check import check as certify
from ssm_planner.verification.limits import LimitedQuantity
from ssm_planner.verification.pieces import piece_blocks
from ssm_planner.verification.sampled_extremes import RmsTorques, SampledIntervals, bracket_values
from tests.support.plans import trapezoids

THIRDS = np.array([0.0, 1.0, 2.0, 3.0]) / 3
SMOOTH = np.array([False])


def random_motion(seed: int) -> Trajectory:
    """Return seven random polynomials with jumps between them, which start at 3 s."""
    rng = np.random.default_rng(seed)
    breaks = 3.0 + np.concatenate([[0.0], np.cumsum(rng.uniform(0.2, 1.5, 7))])
    return Trajectory(breaks, rng.normal(size=(7, 6, 4)) * [0.5, 0.5, 0.5, 0.02], ())


def test_a_bracket_holds_the_cubic_twice_as_far_beyond_the_values() -> None:
    rng = np.random.default_rng(0)
    grid = np.linspace(0.0, 1.0, 2001)
    for _ in range(200):
        powers = rng.normal(size=4)
        values = np.polyval(powers[::-1], THIRDS)[:, None, None]
        (low,), (high,) = (side[:, 0] for side in bracket_values(values, SMOOTH))
        dense = np.polyval(powers[::-1], grid)
        over, under = dense.max() - values.max(), values.min() - dense.min()
        assert high >= values.max() + 2 * over - 1e-12
        assert low <= values.min() - 2 * under + 1e-12
        # The bracket doubles the excess of the inner Bernstein coefficients, which are a0 + a1/3
        # and a0 + 2 a1/3 + a2/3.
        inner = powers[0] + powers[1] / 3, powers[0] + 2 * powers[1] / 3 + powers[2] / 3
        assert high == pytest.approx(values.max() + 2 * max(*inner - values.max(), 0.0))
        assert low == pytest.approx(values.min() - 2 * max(*(values.min() - inner), 0.0))
        steepest = np.abs(np.diff(values[:, 0, 0])).max()
        (cornered_low,), (cornered_high,) = (
            side[:, 0] for side in bracket_values(values, np.array([True]))
        )
        assert cornered_high == pytest.approx(high + steepest)
        assert cornered_low == pytest.approx(low - steepest)


@pytest.fixture(scope="module")
def intervals(robot: Robot) -> tuple[Trajectory, SampledIntervals]:
    motion = random_motion(4)
    (pieces,) = piece_blocks(motion)
    segments = pieces.split_at_reversals(robot)
    return motion, SampledIntervals.from_segments(
        pieces, robot, *segments, rate=40.0, max_intervals=6
    )


def test_intervals_cover_the_segments_at_the_rate(
    intervals: tuple[Trajectory, SampledIntervals], robot: Robot
) -> None:
    motion, cut = intervals
    (pieces,) = piece_blocks(motion)
    piece, start, end = pieces.split_at_reversals(robot)
    edges = np.flatnonzero(np.append(True, ~cut.shares_end[:-1]))
    assert len(edges) == len(piece)
    last = np.append(edges[1:], len(cut.piece)) - 1
    assert np.array_equal(cut.piece[edges], piece)
    assert cut.begin[edges] == pytest.approx(start)
    assert cut.begin[last] + cut.width[last] == pytest.approx(end)
    assert not cut.shares_end[last].any()
    inner = cut.shares_end
    assert (cut.begin + cut.width)[inner] == pytest.approx(cut.begin[1:][inner[:-1]])
    length = (end - start) * pieces.length[piece]
    expected = np.clip(np.ceil(length * 40.0 / 3), 1, 6)
    assert np.array_equal(last - edges + 1, expected)
    assert {1, 6} < set(expected.astype(int).tolist())
    speeds = pieces.velocities_at(cut.piece, cut.begin + cut.width / 2)
    assert np.array_equal(cut.direction, np.sign(speeds))
    turning = np.abs(pieces.velocities_at(piece, np.stack([start, end]))) < 1e-9
    assert np.array_equal(cut.starting[edges], turning[0])
    assert not np.delete(cut.starting, edges, axis=0).any()
    slow = np.zeros(len(cut.piece), dtype=bool)
    slow[edges] |= turning[0].any(axis=1)
    slow[last] |= turning[1].any(axis=1)
    assert np.array_equal(cut.near_rest, slow)
    assert slow.any()
    assert not slow.all()


def test_parts_are_equal_and_some_in_a_row_end_by_themselves(
    intervals: tuple[Trajectory, SampledIntervals],
) -> None:
    _, cut = intervals
    begins = np.flatnonzero(cut.starting.any(axis=1))
    chosen = np.array([0, begins[-1], 3])
    parts = cut.split(chosen, 4)
    assert np.array_equal(parts.piece, np.repeat(cut.piece[chosen], 4))
    shares = np.tile(np.arange(4) / 4, 3)
    assert parts.begin == pytest.approx(
        np.repeat(cut.begin[chosen], 4) + shares * np.repeat(cut.width[chosen], 4)
    )
    assert parts.width == pytest.approx(np.repeat(cut.width[chosen], 4) / 4)
    assert parts.shares_end.tolist() == [True, True, True, False] * 3
    assert np.array_equal(parts.direction, np.repeat(cut.direction[chosen], 4, axis=0))
    assert np.array_equal(parts.starting[::4], cut.starting[chosen])
    assert not parts.starting.reshape(3, 4, 4)[:, 1:].any()
    assert np.array_equal(parts.near_rest, np.repeat(cut.near_rest[chosen], 4))
    row = cut.subset(slice(2, 5))
    assert not row.shares_end[-1]
    assert np.array_equal(row.shares_end[:-1], cut.shares_end[2:4])
    for name in ("piece", "begin", "width", "direction", "starting", "near_rest"):
        assert np.array_equal(getattr(row, name), getattr(cut, name)[2:5])


def test_means_of_squares_are_integrals(robot: Robot) -> None:
    """The square of a linear torque is a parabola, which both rules integrate exactly."""
    limits = [robot.joints[i].limit(MotorTorque) for i in (0, 1)]
    speed = LimitedQuantity(robot.joints[0].limits[0], 0, 0)
    rms = RmsTorques([speed, *(LimitedQuantity(limit, i) for i, limit in enumerate(limits))])
    rng = np.random.default_rng(3)
    start, slope, duration = rng.normal(size=(6, 3)), rng.normal(size=(6, 3)), rng.uniform(1, 2, 6)
    values = start + THIRDS[:, None, None] * slope
    starting = np.zeros((6, 4), dtype=bool)
    starting[2, 0] = True
    values[0, 2, 1] += 5.0  # static friction at an instant
    rms.add_intervals(values, starting, duration)
    square = start**2 + start * slope + slope**2 / 3
    expected = (duration[:, None] * square).sum(axis=0)[1:]
    assert rms.integrals == pytest.approx(expected)
    motion = random_motion(5)
    checks = rms.results(robot, motion, pause=0.5)
    complete = motion.breaks[-1] - motion.breaks[0] + 0.5
    assert [check.worst for check in checks] == pytest.approx(np.sqrt(expected / complete))
    assert [check.time for check in checks] == [motion.breaks[-1]] * 2
    for check, i in zip(checks, (0, 1), strict=True):
        assert check.limit == robot.joints[i].limit(ContinuousTorque).high


def test_intervals_with_uneven_squares_are_looked_at_again(robot: Robot) -> None:
    rms = RmsTorques([LimitedQuantity(robot.joints[0].limit(MotorTorque), 0)])
    even = np.sqrt(2.0 + THIRDS**2)  # its square is a parabola
    bent = np.sqrt(2.0 + THIRDS**3)
    values = np.stack([even, bent, bent], axis=1)[:, :, None]
    assert rms.needs_refinement(values, np.array([1.0, 1.0, 1e-12])).tolist() == [
        False,
        True,
        False,
    ]
    limits = [LimitedQuantity(robot.joints[i].limit(MotorTorque), i) for i in (0, 1)]
    one_of_two = np.stack([even, bent], axis=1)[:, None, :]
    assert RmsTorques(limits).needs_refinement(one_of_two, np.ones(1)).tolist() == [True]


@pytest.mark.parametrize("where", ["start", "reversal"])
def test_a_start_with_a_tiny_speed_has_static_friction_too(robot: Robot, where: str) -> None:
    """A velocity may jump by a millionth of its limit at a start or a reversal.

    Static friction counts there as well.
    """
    move = np.array([0.004, 0.0, 0.0, 0.0])
    motion = trapezoids(robot, (-move, move) if where == "start" else (move, -move))
    turning = 0 if where == "start" else 2
    coefficients = motion.coefficients.copy()
    coefficients[turning, 1, 0] -= 5e-7 * robot.joints[0].velocity
    creeping = Trajectory(motion.breaks, coefficients, ())
    name = MotorTorque.name, "roll"
    torque = certify(motion, robot)[name].worst
    first = motion.sample(motion.breaks[[turning]])
    sign = np.sign(first.qdd)
    static, kinetic = (
        abs(motor_motion(robot, RigidBody.from_robot(robot), first, sign, start).torque[0, 0])
        for start in (np.ones((1, 4)), np.zeros((1, 4)))
    )
    assert torque == pytest.approx(static)
    assert static > 1.1 * kinetic
    assert certify(creeping, robot)[name].worst == pytest.approx(torque, rel=1e-4)
