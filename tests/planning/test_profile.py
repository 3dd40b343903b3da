"""Verify the fastest profiles of one joint from rest to rest against Ruckig and their limits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ssm_planner.planning.lower_bound import rest_to_rest

positive = st.floats(1e-2, 1e2)


@settings(deadline=None, max_examples=300)
@given(distance=positive, velocity=positive, acceleration=positive, jerk=positive)
def test_jerk_limited_motion_is_ruckigs(
    distance: float, velocity: float, acceleration: float, jerk: float
) -> None:
    ruckig = pytest.importorskip("ruckig", reason="Ruckig is not installed")
    profile = rest_to_rest(distance, velocity, acceleration, jerk)
    task = ruckig.InputParameter(1)
    task.current_position, task.target_position = [0.0], [distance]
    task.max_velocity, task.max_acceleration, task.max_jerk = [velocity], [acceleration], [jerk]
    reference = ruckig.Trajectory(1)
    assume(ruckig.Ruckig(1).calculate(task, reference) == ruckig.Result.Working)
    assert profile.duration == pytest.approx(reference.duration, rel=1e-6)


@given(distance=positive, velocity=positive, acceleration=positive, jerk=st.none() | positive)
def test_the_profile_arrives_at_rest_within_its_limits(
    distance: float, velocity: float, acceleration: float, jerk: float | None
) -> None:
    profile = rest_to_rest(distance, velocity, acceleration, jerk)
    position, speed, _ = profile.evaluate(np.array([0.0, profile.duration]))
    assert position == pytest.approx([0.0, distance], rel=1e-6)
    _, largest, _ = profile.evaluate(profile.switching_times)
    assert np.abs(speed).max() <= 1e-6 * np.abs(largest).max()
    assert np.abs(largest).max() <= velocity * (1 + 1e-6)
    assert np.abs([profile.start, profile.end]).max() <= acceleration * (1 + 1e-6)
    if jerk is not None:
        slopes = (profile.end - profile.start) / profile.lengths
        jumps = np.append(profile.start, 0.0) - np.append(0.0, profile.end)
        assert np.abs(slopes).max() <= jerk * (1 + 1e-6)
        assert np.abs(jumps).max() <= 1e-9 * acceleration


@given(distance=positive, velocity=positive, acceleration=positive)
def test_the_limit_of_large_jerk_is_the_trapezoid(
    distance: float, velocity: float, acceleration: float
) -> None:
    without = rest_to_rest(distance, velocity, acceleration)
    almost = rest_to_rest(
        distance, velocity, acceleration, 1e9 * acceleration * max(1.0, acceleration / velocity)
    )
    assert almost.duration == pytest.approx(without.duration, rel=1e-4)
