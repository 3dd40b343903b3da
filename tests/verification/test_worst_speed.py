"""The search for the worst speed in a range finds the known maxima of given torques."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from ssm_planner.dynamics.motors import motion_directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.problem.limits import ContinuousTorque, MotorTorque
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import JOINTS, Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.verification import slower
from ssm_planner.verification.check import check
from ssm_planner.verification.slower import SpeedRange, check_speeds


class Limits:
    duty = 0.7


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Replace the torques by given functions, and return a list of the speeds that are checked.

    The peak torque has a maximum at 0.3 and grows beyond full speed. The RMS torque has a maximum
    at 0.02.
    """
    speeds: list[float] = []

    def torques(motion: object, robot: object, factors: np.ndarray, pause: float) -> object:
        assert pause == Limits.duty
        peak = np.exp(-(((factors - 0.3) / 0.1) ** 2)) + 0.9 * factors**8
        rms = np.exp(-(((np.log(factors) - np.log(0.02)) / 0.3) ** 2))
        return np.tile(peak[:, None], 4), np.tile(rms[:, None], 4)

    def check_slower(motion: object, robot: object, limits: object, speed: float) -> object:
        speeds.append(speed)
        kinds = (MotorTorque.name, ContinuousTorque.name, "velocity")
        every = [(kind, joint) for kind in kinds for joint in JOINTS]
        limits = [SimpleNamespace(name=kind, joint=joint) for kind, joint in every]
        return SimpleNamespace(limits=limits, passed=speed > 0.05)

    monkeypatch.setattr(slower, "_peak_and_rms_torques", torques)
    monkeypatch.setattr(slower, "check_slower", check_slower)
    return speeds


def test_no_speed_beyond_full_speed_is_the_worst(robot: Robot, asked: list[float]) -> None:
    result = check_speeds(
        Trajectory(np.arange(2.0), np.zeros((1, 6, 4)), ()), robot, Limits(), 0.01
    )  # type: ignore[arg-type]
    assert asked == sorted(asked)
    assert asked == pytest.approx([0.01, 0.02, 0.3, 1.0], rel=1e-3)
    assert [speed for speed, _ in result.certificates] == asked
    assert not result.passed
    assert SpeedRange(0.1, (), result.certificates[2:]).passed
    # The result has a line for each kind and each joint with a motor. The line belongs to the
    # certificate at its worst speed.
    driven = [joint.name for joint in robot.joints if joint.motor is not None]
    expected = [
        (kind, name) for kind in (MotorTorque.name, ContinuousTorque.name) for name in driven
    ]
    assert [(item.found.name, item.found.joint) for item in result.worst] == expected
    assert [item.speed for item in result.worst] == pytest.approx([0.3] * 3 + [0.02] * 3, rel=1e-3)
    by_speed = dict(result.certificates)
    assert all(item.found in by_speed[item.speed].limits for item in result.worst)


def test_torques_of_a_slower_motion_are_those_of_its_samples(robot: Robot) -> None:
    """One joint accelerates and brakes evenly.

    Its torques are those of the slowed motion, and a pause lowers the RMS torque.
    """
    coefficients = np.zeros((2, 6, 4))
    coefficients[:, 0] = [0.3, 1.15, 0.1, -0.01]
    coefficients[0, 2, 0] = coefficients[1, 2, 0] = 0.4
    coefficients[1, 0, 0] += 0.4
    coefficients[1, 1, 0], coefficients[1, 2, 0] = 0.8, -0.4
    motion = Trajectory(np.array([0.0, 1.0, 2.0]), coefficients, ())
    factors = np.array([0.1, 0.5, 1.0])
    peak, rms = slower._peak_and_rms_torques(motion, robot, factors, 0.0)
    _, cooled = slower._peak_and_rms_torques(motion, robot, factors, 3.0)
    assert peak.shape == rms.shape == (3, 4)
    assert cooled == pytest.approx(rms * np.sqrt(2.0 / (2.0 + 3.0 * factors))[:, None])
    for k, factor in enumerate(factors):
        alone = slower._peak_and_rms_torques(motion.slower(factor), robot, np.array([1.0]), 0.0)
        assert peak[k] == pytest.approx(alone[0][0], rel=1e-9)
        assert rms[k] == pytest.approx(alone[1][0], rel=1e-9)
    body = RigidBody.from_robot(robot)
    for side, time in ((1, np.linspace(0.0, 2.0, 1501)), (-1, np.array([1.0, 2.0]))):
        samples = motion.sample(time, "right" if side > 0 else "left")
        torque = motor_motion(robot, body, samples, *motion_directions(robot, samples, side)).torque
        torque = np.nan_to_num(torque)
        assert np.all(peak[2] >= np.abs(torque).max(axis=0) - 1e-12)
        if side > 0:
            assert rms[2] == pytest.approx(np.sqrt(np.mean(torque**2, axis=0)))
    assert not peak[:, 2].any()


@pytest.mark.parametrize("last", [True, False])
def test_a_jump_of_acceleration_counts_on_both_its_sides(robot: Robot, last: bool) -> None:
    """A short piece with high acceleration lies between two of the evenly spaced instants."""
    h = 1e-4
    breaks = np.array([0.0, 1.0, 1.0 + h]) if last else np.array([0.0, h, 1.0 + h])
    coefficients = np.zeros((2, 6, 4))
    coefficients[:, 0] = [0.3, 1.15, 0.1, -0.01]
    short = 1 if last else 0
    coefficients[short, 1:4, 0] = (
        0.0,
        0.0,
        500.0 / h,
    )  # The acceleration grows to 3000 rad/s² at its end.
    motion = Trajectory(breaks, coefficients, ())
    peak, _ = slower._peak_and_rms_torques(motion, robot, np.array([1.0]), 0.0)
    samples = motion.sample(breaks[short + 1 : short + 2], "left")
    body = RigidBody.from_robot(robot)
    torque = motor_motion(robot, body, samples, *motion_directions(robot, samples, -1)).torque
    assert peak[0, 0] == pytest.approx(abs(torque[0, 0]))


def test_the_worst_speed_is_found_on_either_side_of_the_grid(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    grid = np.geomspace(0.01, 1.0, slower.GRID_SPEEDS)
    for place in np.concatenate([grid[20:24] * 1.03, grid[20:24] * 0.97]):

        def torques(
            m: object, r: object, factors: np.ndarray, pause: float, at: float = place
        ) -> object:
            value = np.tile(-np.abs(np.log(factors / at))[:, None], 4)
            return value, value

        monkeypatch.setattr(slower, "_peak_and_rms_torques", torques)
        values = torques(None, None, grid, 0.0)[0][:, 0]  # type: ignore[index]
        result = slower._worst_speed(None, robot, grid, values, (False, 0), pause=0.0)  # type: ignore[arg-type]
        assert result == pytest.approx(place, rel=1e-3)


@pytest.mark.parametrize("best", [0.0, 0.3, 0.62, 1.0])
def test_the_worst_factor_is_sought_between_the_neighbours_of_the_largest_value(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, best: float
) -> None:
    """Each round searches between the factors before and after the largest value."""
    looks = []
    low, high = 0.1, 1.0
    worst = low * (high / low) ** best

    def torques(_: object, __: object, factors: np.ndarray, ___: float) -> object:
        looks.append(factors)
        peak = -np.abs(np.log(factors / worst))
        other = np.zeros((len(factors), 4))
        return other, np.column_stack([other[:, :2], peak, other[:, :1]])

    monkeypatch.setattr(slower, "_peak_and_rms_torques", torques)
    factors = np.geomspace(low, high, 8)
    values = -np.abs(np.log(factors / worst))
    result = slower._worst_speed(None, robot, factors, values, (True, 2), pause=0.0)  # type: ignore[arg-type]
    assert len(looks) == slower.SPEED_REFINEMENTS
    for before, after in zip([factors, *looks], looks, strict=False):
        k = int(np.argmin(np.abs(np.log(before / worst))))
        ends = before[max(k - 1, 0)], before[min(k + 1, len(before) - 1)]
        assert (after[0], after[-1]) == pytest.approx(ends)
        assert len(after) == 13
    step = np.diff(np.log(looks[-1])).max()
    assert abs(np.log(result / worst)) <= step


def test_a_slower_motion_may_end_at_the_slower_rate(robot: Robot) -> None:
    coefficients = np.zeros((1, 6, 4))
    coefficients[0, 0], coefficients[0, 2] = [0.3, 1.15, 0.1, -0.01], [0.05, 0.0, 0.0, 0.0]
    motion = Trajectory(np.array([0.0, 1.0]), coefficients, ())
    limits = TaskLimits(end_rate={"roll": 0.1})
    for speed in (1.0, 0.5):
        assert slower.check_slower(motion, robot, limits, speed).passed
        same = check(motion.slower(speed), robot, limits)
        assert same.passed is (speed == 1.0)
