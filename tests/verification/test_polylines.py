"""The check of linear pieces subtracts the part of speeds and jumps that rounding explains. The
reference is a direct computation from the points.
"""

from __future__ import annotations

import numpy as np
import pytest

from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.problem.limits import TaskRate, TipSpeed
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.verification import polylines
from ssm_planner.verification.certificate import Certificate, LimitCheck
from ssm_planner.verification.check import check

START = np.array([0.3, 1.15, 0.1, -0.01])
EXACT = np.zeros(4)


def through(points: np.ndarray, times: np.ndarray) -> Trajectory:
    """Return linear pieces through points (n, 4) at times (n,)."""
    coefficients = np.zeros((len(times) - 1, 6, 4))
    coefficients[:, 0] = points[:-1]
    coefficients[:, 1] = np.diff(points, axis=0) / np.diff(times)[:, None]
    return Trajectory(times, coefficients, ())


@pytest.fixture(scope="module")
def table() -> Trajectory:
    """Return a random walk at uneven times, which starts at 2 s."""
    rng = np.random.default_rng(6)
    times = 2.0 + np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 0.2, 12))])
    steps = rng.normal(size=(12, 4)) * [0.05, 0.05, 0.05, 5e-4]
    return through(START + np.vstack([np.zeros(4), np.cumsum(steps, axis=0)]), times)


def of_joint(certificate: Certificate, name: str, joint: str | None) -> LimitCheck:
    return next(c for c in certificate.limits if (c.name, c.joint) == (name, joint))


@pytest.mark.parametrize("resolution", [EXACT, np.array([1e-3, 2e-3, 1e-3, 1e-5])])
@pytest.mark.parametrize("block", [8192, 5, 4])
def test_speeds_and_jumps_are_those_of_the_points(
    table: Trajectory,
    robot: Robot,
    resolution: np.ndarray,
    block: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(polylines, "PIECES_PER_BLOCK", block)
    result = check(table, robot, resolution=resolution)
    length = np.diff(table.breaks)
    speed = table.pieces(slice(0, 12))[:, 1]
    rest = np.zeros((1, 4))
    jumps = np.diff(np.vstack([rest, speed, rest]), axis=0)
    before, after = np.append(0.0, length), np.append(length, 0.0)
    sum_of_inverses = np.array([1 / length[0], *(1 / length[:-1] + 1 / length[1:]), 1 / length[-1]])
    for i, joint in enumerate(robot.joints):
        fastest = np.maximum(np.abs(speed[:, i]) - 2 * resolution[i] / length, 0.0)
        line = of_joint(result, "velocity", joint.name)
        assert line.worst == pytest.approx(fastest.max(), rel=1e-6)
        assert line.time == pytest.approx(table.breaks[fastest.argmax()])
        assert line.margin == pytest.approx(1 - fastest.max() / joint.velocity, rel=1e-6)
        size = np.maximum(np.abs(jumps[:, i]) - 2 * resolution[i] * sum_of_inverses, 0.0)
        allowed = joint.acceleration * (before + after) / 2
        k = int(np.argmax(size / allowed))
        line = of_joint(result, "velocity jump", joint.name)
        assert line.worst == pytest.approx(size[k], rel=1e-6)
        assert line.limit == pytest.approx(allowed[k])
        assert line.time == pytest.approx(table.breaks[k])
    said = [note for note in result.unchecked if "rounding" in note]
    assert len(said) == bool(resolution.any())
    undefined = {u.name for u in result.unjudged if "not defined on straight pieces" in u.reason}
    assert undefined >= {"continuous torque"}
    assert all(not line.passed for line in result.limits if line.name == "acceleration")
    # Torques can only be kept if the accelerations are kept.
    torques = [line for line in result.limits if line.name == "motor torque"]
    assert all(not line.passed for line in torques) or not result.violations


def test_speeds_of_the_tool_are_reduced_by_what_rounding_explains(
    table: Trajectory, robot: Robot
) -> None:
    mechanism = Mechanism.from_geometry(robot.geometry)
    length = np.diff(table.breaks)
    q, qd = (table.pieces(slice(0, 12))[:, order] for order in (0, 1))
    h = 1e-6

    def tip_speed(where: np.ndarray, speed: np.ndarray) -> np.ndarray:
        ahead, behind = (tip_position(mechanism, where + side * h * speed) for side in (1, -1))
        return np.linalg.norm(ahead - behind, axis=1) / (2 * h)

    limits = TaskLimits((TipSpeed(1e-6), TaskRate("depth", 1e-6)))
    for resolution in (EXACT, np.array([0.0, 0.0, 0.0, 2e-5]), np.full(4, 1e-4)):
        result = check(table, robot, limits, resolution=resolution)
        wrong = 2 * resolution / length[:, None]
        explained = sum(tip_speed(q, np.eye(4)[i] * wrong) for i in range(4))
        starts = np.maximum(tip_speed(q, qd) - explained, 0.0)
        ends = np.maximum(tip_speed(q + qd * length[:, None], qd) - explained, 0.0)
        line = of_joint(result, "tip speed", None)
        assert starts.max() * (1 - 1e-6) <= line.worst <= max(*starts, *ends) * 1.001
        assert line.margin == pytest.approx(1 - line.worst / 1e-6)
        depth = np.maximum(np.abs(qd[:, 3]) - wrong[:, 3], 0.0).max()
        assert of_joint(result, TaskRate.name_of("depth"), None).worst == pytest.approx(
            depth, rel=1e-5
        )
    fast = TaskLimits((TipSpeed(10.0),))
    within = of_joint(check(table, robot, fast, resolution=np.full(4, 1e-3)), "tip speed", None)
    assert within.worst == pytest.approx(tip_speed(q, qd).max(), rel=0.05)  # not reduced


def test_the_tool_speed_that_rounding_leaves_may_be_of_another_piece(robot: Robot) -> None:
    """The fastest piece is so short that rounding explains most of its speed."""
    mechanism = Mechanism.from_geometry(robot.geometry)
    lengths = np.array([0.5, 0.4, 0.01, 0.3, 0.5])
    steps = np.array(
        [[0, 0, 0, 0], [0.02, 0.05, 0, 0], [6e-3, 0, 0, 0], [0, -0.06, 0, 1e-3], [0] * 4]
    )
    times = np.append(0.0, np.cumsum(lengths))
    moved = through(START + np.vstack([np.zeros(4), np.cumsum(steps, axis=0)]), times)
    resolution = np.array([2e-3, 1e-5, 1e-5, 1e-8])
    q, qd = moved.pieces(slice(0, 5))[:, 0], moved.pieces(slice(0, 5))[:, 1]

    def speed(where: np.ndarray, rates: np.ndarray) -> np.ndarray:
        h = 1e-6
        ahead, behind = (tip_position(mechanism, where + side * h * rates) for side in (1, -1))
        return np.linalg.norm(ahead - behind, axis=1) / (2 * h)

    wrong = 2 * resolution / lengths[:, None]
    left = np.maximum(speed(q, qd) - sum(speed(q, np.eye(4)[i] * wrong) for i in range(4)), 0.0)
    assert int(speed(q, qd).argmax()) == 2
    assert int(left.argmax()) == 3
    certificate = check(moved, robot, TaskLimits((TipSpeed(1e-6),)), resolution=resolution)
    line = of_joint(certificate, "tip speed", None)
    assert line.worst == pytest.approx(left[3], rel=1e-6)
    assert line.time == pytest.approx(times[3])


def test_points_with_velocities_are_judged_by_these(robot: Robot) -> None:
    """Pieces that are not linear have the speeds of their polynomials, for any rounding."""
    coefficients = np.zeros((2, 6, 4))
    coefficients[:, 0] = START
    coefficients[0, 2, 0], coefficients[0, 3, 0] = 0.3, -0.2  # q̇ = 0.6 t − 0.6 t², 0.15 at most
    coefficients[1, 0, 0] += 0.3 * 0.25 - 0.2 * 0.125
    coefficients[1, 1:3, 0] = 0.1, -0.1  # The speed jumps to 0.1 and falls to 0 in 0.5 s.
    motion = Trajectory(np.array([0.0, 0.5, 1.0]), coefficients, ())
    result = check(motion, robot, resolution=np.full(4, 1e-9))
    line = of_joint(result, "velocity", "roll")
    assert (line.worst, line.time) == (pytest.approx(0.15), pytest.approx(0.5))
    line = of_joint(result, "velocity jump", "roll")
    assert (line.worst, line.time) == (pytest.approx(0.05, rel=1e-5), 0.5)
    assert line.limit == pytest.approx(robot.joints[0].acceleration * 0.5)


def test_declared_speeds_at_the_ends_are_no_jumps(robot: Robot) -> None:
    """A steady motion jumps at an end where it must rest.

    It does not jump at an end where any speed is allowed.
    """
    times = np.linspace(0.0, 1.0, 5)
    steady = through(START + times[:, None] * np.array([0.2, 0.0, 0.0, 0.0]), times)
    line = of_joint(check(steady, robot, resolution=EXACT), "velocity jump", "roll")
    assert line.worst == pytest.approx(0.2)
    assert line.limit == pytest.approx(robot.joints[0].acceleration * 0.25 / 2)
    any_speed = TaskLimits(start_rate=None, end_rate=None)
    line = of_joint(check(steady, robot, any_speed, resolution=EXACT), "velocity jump", "roll")
    assert line.worst == pytest.approx(0.0, abs=1e-9)
    for missing in ("start_rate", "end_rate"):
        one = TaskLimits(**{missing: None})
        line = of_joint(check(steady, robot, one, resolution=EXACT), "velocity jump", "roll")
        assert line.worst == pytest.approx(0.2)
        assert line.time == (1.0 if missing == "start_rate" else 0.0)
