"""The closed forms of the workspace are compared with sweeps of the product of exponentials."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.rotations import rotation
from ssm_planner.kinematics.workspace import (
    design_margin,
    design_region,
    extremes,
    theta2_from_tilt,
    tilt_interval,
    tilt_magnitudes,
)
from tests.support.tilts import tilt_from_theta2

axis_angles = st.floats(0.0, math.pi)


def tilt_cosine(
    mechanism: Mechanism, theta2: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return f(θ2) = ω1ᵀ e^{ω̂2θ2} v4 = cos φ and its first two derivatives.

    These are equations 4 and 5 of the paper. The results have the shape of `theta2`.
    """
    angle = np.asarray(theta2, dtype=float)[..., np.newaxis]
    still, cosine, sine = mechanism.exponentials[1] @ mechanism.omega3 @ mechanism.omega1
    f = still + cosine * np.cos(angle) + sine * np.sin(angle)
    first = sine * np.cos(angle) - cosine * np.sin(angle)
    return f[..., 0], first[..., 0], (still - f)[..., 0]


def swept_tilt(alpha: np.ndarray, beta: np.ndarray, theta2: np.ndarray) -> np.ndarray:
    """Return the angle between ω1 = x and e^{ω̂2 θ2} v4 in rad, by Rodrigues' formula.

    The angles `alpha` and `beta` broadcast to the shape of `theta2`.
    """
    ones, zeros = np.ones_like(theta2), np.zeros_like(theta2)
    omega2 = np.stack((np.cos(alpha) * ones, np.sin(alpha) * ones, zeros), axis=-1)
    v4 = np.stack((np.cos(alpha + beta) * ones, np.sin(alpha + beta) * ones, zeros), axis=-1)
    cosine, sine = np.cos(theta2)[..., np.newaxis], np.sin(theta2)[..., np.newaxis]
    along = np.sum(omega2 * v4, axis=-1, keepdims=True) * omega2
    tool = along + cosine * (v4 - along) + sine * np.cross(omega2, v4)
    return np.arctan2(np.hypot(tool[..., 1], tool[..., 2]), tool[..., 0])


def swept_extreme(alpha: np.ndarray, beta: np.ndarray, sign: int) -> np.ndarray:
    """Return the largest (sign +1) or smallest (sign −1) tilt of a sweep, in rad.

    The sweep narrows around its best sample.
    """
    best, width = np.zeros_like(alpha), math.pi
    for _ in range(9):
        theta2 = best[:, np.newaxis] + np.linspace(-width, width, 201)
        tilt = swept_tilt(alpha[:, np.newaxis], beta[:, np.newaxis], theta2)
        best = np.take_along_axis(theta2, np.argmax(sign * tilt, axis=1)[:, np.newaxis], axis=1)[
            :, 0
        ]
        width /= 30.0
    return swept_tilt(alpha, beta, best)


def test_limits_are_the_extremes_of_a_dense_sweep():
    rng = np.random.default_rng(1)
    alpha, beta = rng.uniform(0.0, math.pi, (2, 1000))
    alpha[:8] = [0.0, math.pi, 1.0, 1.0, 1.0, math.pi - 1.0, math.pi / 2, 0.0]
    beta[:8] = [1.0, 1.0, 0.0, math.pi, 1.0, 1.0, math.pi / 2, math.pi]
    closed = np.array([tilt_magnitudes(a, b) for a, b in zip(alpha, beta, strict=True)])
    assert np.abs(closed[:, 0] - swept_extreme(alpha, beta, -1)).max() < 1e-9
    assert np.abs(closed[:, 1] - swept_extreme(alpha, beta, 1)).max() < 1e-9


def test_published_robot(vitreoretinal):
    """The rounded angles α = 30° and β = 110° give tilts from −140° to −80°.

    With its unrounded angles, the published robot has almost the same interval.
    """
    assert np.degrees(tilt_interval(vitreoretinal)) == pytest.approx(
        [-139.778393, -79.778393], abs=1e-6
    )
    assert tilt_interval(
        Mechanism.from_angles(math.radians(30.0), math.radians(110.0))
    ) == pytest.approx([math.radians(-140.0), math.radians(-80.0)], abs=1e-14)


@pytest.mark.parametrize(
    ("alpha", "beta", "expected"),
    [
        (1.0, 1.0, (0.0, 2.0)),
        (2.0, 2.0, (0.0, 2.0 * math.pi - 4.0)),
        (2.5, 1.5, (1.0, 2.0 * math.pi - 4.0)),
        (2.0, 0.5, (1.5, 2.5)),
        (0.0, 1.2, (1.2, 1.2)),
        (math.pi, 1.2, (math.pi - 1.2, math.pi - 1.2)),
        (1.2, 0.0, (1.2, 1.2)),
        (1.2, math.pi, (math.pi - 1.2, math.pi - 1.2)),
        (math.pi / 2, math.pi / 2, (0.0, math.pi)),
    ],
)
def test_beyond_the_easy_case(alpha, beta, expected):
    """The limits of the tilt also hold for α = β, for α + β > π and for angles of 0 and π."""
    assert tilt_magnitudes(alpha, beta) == pytest.approx(expected, abs=1e-15)
    mech = Mechanism.from_angles(alpha, beta)
    low, high = tilt_interval(mech)
    assert (-high, -low) == pytest.approx(expected, abs=1e-14)
    sweep = tilt_from_theta2(mech, np.linspace(-math.pi, math.pi, 1001))
    assert sweep.min() >= low - 1e-14
    assert sweep.max() <= high + 1e-14


def test_f_and_its_derivatives(random_mechanism):
    rng = np.random.default_rng(2)
    step = 1e-4
    for _ in range(50):
        mech = random_mechanism(rng)
        theta2 = rng.uniform(-math.pi, math.pi, 20)
        f, first, second = tilt_cosine(mech, theta2)
        tool = rotation(mech.omega2, theta2) @ mech.omega3
        assert np.abs(f - tool @ mech.omega1).max() < 1e-14
        assert np.abs(first - tool @ np.cross(mech.omega1, mech.omega2)).max() < 1e-14
        assert np.abs(np.cos(tilt_from_theta2(mech, theta2)) - f).max() < 1e-14
        after, before = tilt_cosine(mech, theta2 + step)[1], tilt_cosine(mech, theta2 - step)[1]
        assert np.abs(second - (after - before) / (2.0 * step)).max() < 1e-8


def test_extreme_configurations(random_mechanism):
    rng = np.random.default_rng(3)
    for _ in range(100):
        mech = random_mechanism(rng)
        for item in extremes(mech):
            turned = rotation(mech.omega2, item.theta2) @ mech.omega3
            assert np.abs(turned - item.direction).max() < 1e-11
            assert abs(tilt_cosine(mech, item.theta2)[1]) < 1e-12
            assert abs(math.cos(item.tilt) - mech.omega1 @ turned) < 1e-14
        nearest, farthest = extremes(mech)
        assert tilt_cosine(mech, nearest.theta2)[2] < 0.0 < tilt_cosine(mech, farthest.theta2)[2]


def test_extremes_of_a_constant_tilt_are_refused():
    with pytest.raises(GeometryError, match="the tilt is constant"):
        extremes(Mechanism.from_angles(0.0, 1.0))


@pytest.mark.parametrize("branch", [1, -1])
def test_theta2_and_tilt_are_inverse_on_a_branch(random_mechanism, branch):
    rng = np.random.default_rng(4)
    for _ in range(100):
        mech = random_mechanism(rng)
        low, high = tilt_interval(mech)
        tilt = np.linspace(low, high, 101)
        theta2 = theta2_from_tilt(mech, tilt, branch)
        assert np.abs(tilt_from_theta2(mech, theta2) - tilt).max() < 1e-12
        assert np.all(branch * np.sin(theta2 - mech.delta)[1:-1] > 0.0)
        assert np.all(np.diff(theta2) * np.sign(theta2[-1] - theta2[0]) > 0.0)


def test_degrees_and_other_branches_are_refused(vitreoretinal):
    """Angles in degrees and a branch other than 1 or −1 are refused."""
    with pytest.raises(GeometryError, match="degrees"):
        design_region(-140.0, -80.0)
    with pytest.raises(GeometryError, match="branch = 2"):
        theta2_from_tilt(vitreoretinal, -1.5, 2)


def test_the_design_question_returns_the_published_design():
    """The required tilts from −140° to −80° give the published angles α = 30° and β = 110°."""
    region = design_region(math.radians(-140.0), math.radians(-80.0))
    assert np.degrees(region.smallest_alpha) == pytest.approx([30.0, 110.0], abs=1e-12)
    assert not region.empty
    assert design_margin(*region.smallest_alpha, region.tilt_range) == pytest.approx(0.0, abs=1e-14)


@settings(max_examples=300, deadline=None)
@given(
    st.floats(-math.pi, math.pi),
    st.floats(-math.pi, math.pi),
    st.floats(0.0, 0.5),
    axis_angles,
    axis_angles,
)
def test_design_region_holds_exactly_the_mechanisms_that_reach(one, other, margin, alpha, beta):
    low, high = min(one, other), max(one, other)
    region = design_region(low, high, margin)
    nearest, farthest = tilt_magnitudes(alpha, beta)
    asked = np.abs(np.linspace(low, high, 3))
    spare = (
        min(farthest - asked.max(), (0.0 if low < 0.0 < high else asked.min()) - nearest) - margin
    )
    assume(abs(spare) > 1e-9)
    reaches = spare > 0.0
    assert region.contains(alpha, beta) == reaches
    assert all(region.contains(*corner) for corner in region.vertices)
    if region.empty:
        assert not reaches
        return
    # A point inside the polygon lies on the same side of every edge, whatever the order of the
    # corners.
    corners = region.vertices
    edges, offsets = np.roll(corners, -1, axis=0) - corners, np.array([alpha, beta]) - corners
    turns = edges[:, 0] * offsets[:, 1] - edges[:, 1] * offsets[:, 0]
    inside = np.all(turns >= 1e-9) or np.all(turns <= -1e-9)
    outside = np.any(turns > 1e-9) and np.any(turns < -1e-9)
    assert not (inside and not reaches)
    assert not (outside and reaches)
    if reaches:
        assert alpha >= region.smallest_alpha[0] - 1e-12


def test_no_mechanism_reaches_too_much():
    """The design region is empty if no mechanism reaches the required tilts."""
    region = design_region(math.radians(-170.0), math.radians(-5.0), margin=math.radians(11.0))
    assert region.empty
    assert math.isnan(region.smallest_alpha[0])
    assert not region.contains(1.0, 1.0)
    with pytest.raises(GeometryError, match="degrees"):
        design_region(-140.0, -80.0)
    with pytest.raises(GeometryError, match="margin"):
        design_region(-2.0, -1.0, margin=-0.1)
