"""A table may have linear and smooth pieces. The smooth pieces must keep every limit of their
dynamics.
"""

from __future__ import annotations

import numpy as np
import pytest

from ssm_planner.formats.points import Points, interpolate_points
from ssm_planner.problem.robot import Robot
from ssm_planner.verification.check import check

PERIOD = 0.02
"""Time between the points, s."""


def roll_sine(robot: Robot, share: float, lacking: list[int]) -> Points:
    """Return points of a sinusoidal roll motion.

    The largest acceleration is `share` times the limit. The points with the indices `lacking` have
    neither a velocity nor an acceleration.
    """
    rate = 8.0
    amplitude = share * robot.joints[0].acceleration / rate**2
    t = np.arange(0.0, 2 * np.pi / rate, PERIOD)
    q, qd, qdd = np.zeros((3, len(t), 4))
    q[:, 0] = amplitude * np.sin(rate * t)
    qd[:, 0] = amplitude * rate * np.cos(rate * t)
    qdd[:, 0] = -amplitude * rate**2 * np.sin(rate * t)
    has = np.ones(len(t), dtype=bool)
    has[lacking] = False
    return Points(t, q, qd, qdd, has_qd=has, has_qdd=has)


@pytest.mark.parametrize("lacking", [[-1], [0], [10, 20], list(range(28))])
def test_linear_pieces_do_not_excuse_the_smooth_ones(robot: Robot, lacking: list[int]) -> None:
    """Linear pieces of a table do not hide an excessive acceleration of the smooth pieces."""

    def limits(
        share: float, missing: list[int]
    ) -> dict[tuple[str, str | None], tuple[float, float, bool]]:
        reading = interpolate_points(roll_sine(robot, share, missing), robot)
        certificate = check(reading.trajectory, robot, resolution=reading.resolution)
        return {
            (limit.name, limit.joint): (limit.worst, limit.time, limit.passed)
            for limit in certificate.limits
        }

    complete, part = limits(10.0, []), limits(10.0, lacking)
    worst, time, passed = part["acceleration", "roll"]
    assert not passed
    # The remaining smooth pieces contain at least one of the two peaks.
    assert worst == pytest.approx(complete["acceleration", "roll"][0], rel=1e-6)
    peaks = np.array([0.5, 1.5]) * np.pi / 8.0
    assert np.abs(time - peaks).min() < PERIOD
    name = "motor torque", "roll"
    assert name in part or name not in complete
    slow = limits(0.5, lacking)
    assert slow["acceleration", "roll"][2]


def test_a_table_of_positions_alone_has_no_dynamics(robot: Robot) -> None:
    points = roll_sine(robot, 0.5, [])
    reading = interpolate_points(Points(points.t, points.q), robot)
    certificate = check(reading.trajectory, robot, resolution=reading.resolution)
    assert not any(limit.name == "acceleration" for limit in certificate.limits)
    assert "acceleration" in {line.name for line in certificate.unjudged}
