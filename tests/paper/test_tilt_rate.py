"""A single joint at full acceleration reaches the bound of the tilt rate.

No motion exceeds this bound.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from paper_reproduction.tilt_rate import tilt_rate_bound
from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.workspace import joint_speed_per_tilt_speed, theta2_from_tilt
from tests.support.tilts import tilt_from_theta2


@pytest.fixture(scope="module")
def mechanism() -> Mechanism:
    return Mechanism.from_angles(math.radians(30.0), math.radians(110.0), math.radians(-113.0))


ENDS = (math.radians(-135.0), math.radians(-85.0))


def test_joint_2_at_full_acceleration_both_ways_meets_the_bound_that_it_sets(
    mechanism: Mechanism,
) -> None:
    """Joint 2 reaches the bound if it accelerates over half of the range and then decelerates.

    The reference is a simulation with the accelerations +a and −a.
    """
    a = 3.0
    start, end = (float(theta2_from_tilt(mechanism, tilt, mechanism.home_branch)) for tilt in ENDS)
    half = abs(end - start) / 2
    t = np.linspace(0.0, math.sqrt(2 * half / a), 20001)
    way = math.copysign(a / 2, end - start) * t**2
    speed, theta2 = np.tile(a * t, 2), np.concatenate([start + way, end - way])
    tilt = tilt_from_theta2(mechanism, theta2)
    per = np.abs(joint_speed_per_tilt_speed(mechanism, tilt, mechanism.home_branch)[:, 1])
    bound = tilt_rate_bound(mechanism, ENDS, a)
    assert bound.joint == "tilt"
    assert bound.rate == pytest.approx(float((speed / per).max()), rel=1e-6)


def test_the_bound_grows_with_the_root_of_the_acceleration_and_with_the_range(
    mechanism: Mechanism,
) -> None:
    bound = tilt_rate_bound(mechanism, ENDS, 2.0)
    assert tilt_rate_bound(mechanism, ENDS, 8.0).rate == pytest.approx(2.0 * bound.rate)
    back = tilt_rate_bound(mechanism, ENDS[::-1], 2.0)
    assert (back.rate, back.tilt) == pytest.approx((bound.rate, bound.tilt), rel=1e-4)
    assert tilt_rate_bound(mechanism, (ENDS[0] + 0.1, ENDS[1] - 0.1), 2.0).rate < bound.rate
    assert ENDS[0] < bound.tilt < ENDS[1]


@pytest.mark.parametrize("ends", [(-2.0, -2.0), (-3.0, -2.0), (-2.0, 1.0)])
def test_tilts_outside_the_workspace_are_refused(
    mechanism: Mechanism, ends: tuple[float, float]
) -> None:
    with pytest.raises(GeometryError, match="workspace"):
        tilt_rate_bound(mechanism, ends, 1.0)
