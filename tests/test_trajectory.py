"""Trajectories agree with finite differences and polynomials, and invalid ones are refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssm_planner.errors import TrajectoryError
from ssm_planner.trajectory import (
    CubicPiece,
    Trajectory,
    join_sections,
    quintic_coefficients,
    rest_coefficients,
)


def random_trajectory(seed: int, pieces: int = 5) -> Trajectory:
    rng = np.random.default_rng(seed)
    breaks = np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 0.5, pieces))])
    states = [rng.normal(size=(pieces + 1, 4)) for _ in range(3)]
    start, end = tuple(x[:-1] for x in states), tuple(x[1:] for x in states)
    return join_sections(
        [
            ("move", breaks, quintic_coefficients(np.diff(breaks), start, end)),
            ("rest", np.array([0.0, 0.3]), rest_coefficients(states[0][-1])),
        ]
    )


@given(seed=st.integers(0, 1000))
def test_hermite_pieces_meet_their_ends(seed: int) -> None:
    trajectory = random_trajectory(seed)
    inner = trajectory.breaks[1:-2]
    left, right = trajectory.sample(inner, side="left"), trajectory.sample(inner, side="right")
    for name in ("q", "qd", "qdd"):
        assert np.allclose(getattr(left, name), getattr(right, name), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("length", [1e-4, 1e-3, 1e-2, 0.3])
def test_rounded_positions_do_not_change_the_jerk_of_a_short_piece(length: float) -> None:
    """At 1.6 rad, a rounding error of 2e-16 rad would change the jerk by 1 % after 1e-4 s."""
    jerk, acceleration, speed = 0.02, 1e-3, 1e-3
    end = (
        1.6 + speed * length + acceleration * length**2 / 2 + jerk * length**3 / 6,
        speed + acceleration * length + jerk * length**2 / 2,
        acceleration + jerk * length,
    )
    for error in (-8, 0, 8):
        states = [
            tuple(np.full((1, 4), value) for value in values)
            for values in ((1.6, speed, acceleration), (end[0] + error * 2.2e-16, *end[1:]))
        ]
        piece = quintic_coefficients(np.array([length]), *states)
        trajectory = Trajectory(np.array([0.0, length]), piece, ())
        sampled = trajectory.sample(np.linspace(0.0, length, 9)).qddd
        assert sampled == pytest.approx(jerk, rel=1e-6)


@given(seed=st.integers(0, 1000))
def test_derivatives_are_those_of_the_position(seed: int) -> None:
    trajectory = random_trajectory(seed)
    t = np.linspace(0.01, trajectory.breaks[-2] - 0.01, 37)
    t = t[np.abs(t[:, None] - trajectory.breaks).min(axis=1) > 2e-5]
    h = 1e-5
    low, here, high = (trajectory.sample(t + step) for step in (-h, 0.0, h))
    for value, derivative in (("q", "qd"), ("qd", "qdd"), ("qdd", "qddd")):
        numeric = (getattr(high, value) - getattr(low, value)) / (2 * h)
        exact = getattr(here, derivative)
        assert np.allclose(numeric, exact, rtol=1e-5, atol=1e-4 * np.abs(exact).max())


def test_round_trip_through_json_is_exact() -> None:
    trajectory = random_trajectory(3)
    again = Trajectory.from_dict(json.loads(json.dumps(trajectory.to_dict())))
    assert np.array_equal(again.coefficients, trajectory.coefficients)
    assert np.array_equal(again.breaks, trajectory.breaks)
    assert again.phases == trajectory.phases


@pytest.mark.parametrize("rate", [1000.0, 137.0, 3.0])
def test_uniform_samples_end_exactly_at_the_end(rate: float) -> None:
    trajectory = random_trajectory(1)
    samples = trajectory.uniform(rate)
    assert samples.t[-1] == trajectory.breaks[-1]
    assert np.allclose(np.diff(samples.t)[:-1], 1 / rate)
    assert np.all(np.diff(samples.t) > 0)


@pytest.mark.parametrize(
    ("breaks", "coefficients"),
    [
        ([0.0, 1.0], np.zeros((2, 6, 4))),
        ([0.0, 0.0], np.zeros((1, 6, 4))),
        ([0.0, 1.0], np.full((1, 6, 4), np.nan)),
        ([0.0], np.zeros((0, 6, 4))),
    ],
)
def test_an_invalid_trajectory_is_refused(breaks: list[float], coefficients: np.ndarray) -> None:
    with pytest.raises(TrajectoryError):
        Trajectory(np.array(breaks), coefficients, ())


@given(seed=st.integers(0, 1000), c=st.floats(0.0, 1.0))
def test_a_cubic_is_the_integral_of_its_linear_acceleration(seed: int, c: float) -> None:
    """A cubic piece agrees with the integrals of its linear acceleration.

    The reference is NumPy's polynomials. The state at the end, the jerk and the Bernstein
    coefficients of the velocity agree too.
    """
    u, v, a0, a1 = np.random.default_rng(seed).normal(size=4)
    h = 0.7
    cubic = CubicPiece(u, v, a0, a1, h)
    acceleration = np.polynomial.Polynomial([a0, (a1 - a0) / h])
    velocity = acceleration.integ(k=[v])
    position = velocity.integ(k=[u])
    exact = [polynomial(c * h) for polynomial in (position, velocity, acceleration)]
    assert np.allclose(cubic.evaluate(c), exact, rtol=1e-12, atol=1e-12)
    assert np.allclose(cubic.at_time(c * h), exact, rtol=1e-12, atol=1e-12)
    assert np.allclose(cubic.end, cubic.evaluate(1.0)[:2], rtol=1e-12, atol=1e-12)
    assert cubic.jerk == pytest.approx(acceleration.deriv()(0.0))
    bernstein = np.array([v, cubic.middle_velocity, cubic.end[1]])
    assert np.array([(1 - c) ** 2, 2 * c * (1 - c), c**2]) @ bernstein == pytest.approx(
        exact[1], rel=1e-9, abs=1e-12
    )


@pytest.mark.parametrize("t", [-1e-6, 1.31, 99.0, np.nan, [0.1, np.inf]])
def test_a_time_outside_the_trajectory_is_an_error(t: float | list[float]) -> None:
    trajectory = join_sections([("rest", np.array([0.0, 1.3]), rest_coefficients(np.ones(4)))])
    with pytest.raises(TrajectoryError, match=r"not between 0 s and 1\.3 s"):
        trajectory.sample(t)


def test_clamped_times_give_the_ends() -> None:
    trajectory = random_trajectory(2)
    ends = trajectory.sample([-5.0, 1e6], clamp=True)
    assert np.array_equal(ends.q, trajectory.sample(trajectory.breaks[[0, -1]]).q)
    with pytest.raises(TrajectoryError):
        trajectory.sample(np.nan, clamp=True)


@given(seed=st.integers(0, 1000), orders=st.integers(1, 3))
def test_samples_are_interpolated(seed: int, orders: int) -> None:
    """A trajectory through samples of a motion has the sampled derivatives at the samples."""
    motion = random_trajectory(seed)
    samples = motion.uniform(50.0)
    states = [samples.q, samples.qd, samples.qdd][:orders]
    trajectory = Trajectory.from_samples(samples.t + 7.0, *states)
    again = trajectory.sample(samples.t[:-1] + 7.0)
    for values, interpolated in zip(states, (again.q, again.qd, again.qdd), strict=False):
        assert np.allclose(interpolated, values[:-1], rtol=1e-9, atol=1e-7)


def test_positions_alone_give_a_smooth_motion_from_rest_to_rest() -> None:
    """The trajectory through samples of a cubic that rests at both ends is that cubic."""
    t = np.linspace(0.0, 1.0, 8)
    q = np.outer(3 * t**2 - 2 * t**3, [1.0, -2.0, 0.0, 0.01])
    trajectory = Trajectory.from_samples(t, q)
    fine = np.linspace(0.0, 1.0, 50)
    expected = np.outer(6 - 12 * fine, [1.0, -2.0, 0.0, 0.01])
    assert np.allclose(trajectory.sample(fine).qdd, expected, atol=1e-12)


@pytest.mark.parametrize(
    "samples",
    [
        ([0.0], np.zeros((1, 4))),
        ([0.0, 1.0], np.zeros((2, 3))),
        ([0.0, 1.0], np.zeros((4, 2))),
        ([0.0, 0.0], np.zeros((2, 4))),
        ([0.0, 1.0], [[0, 0, 0, np.nan], [0, 0, 0, 0]]),
        ([0.0, 1.0], np.zeros((2, 4)), None, np.zeros((2, 4))),
        ([0.0, 1.0], [[0.0] * 4, [0.0] * 3]),
        (3.0, np.zeros((1, 4))),
        (None, np.zeros((1, 4))),
        (np.zeros((2, 2)), np.zeros((2, 4))),
        (["a", "b"], np.zeros((2, 4))),
    ],
)
def test_samples_that_are_no_motion_are_refused(samples: tuple[object, ...]) -> None:
    with pytest.raises(TrajectoryError, match="samples"):
        Trajectory.from_samples(*samples)
