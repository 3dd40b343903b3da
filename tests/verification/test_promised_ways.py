"""Promised lines, arcs and distances agree with closed forms."""

from __future__ import annotations

import itertools
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.problem.motion import Dwell, Follow, Joints, Straight
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Span, Trajectory
from ssm_planner.verification import promises
from ssm_planner.verification.promises import PathPromise

SHARES = np.linspace(0.0, 1.0, 41)
JOINTS = Joints((0.0, 0.0, 0.0, 0.0))


def on_circle(angles: list[float], radius: float = 0.02) -> tuple[np.ndarray, np.ndarray]:
    """Return the centre (3,) and tips (n, 3) at angles on a tilted circle, m."""
    centre = np.array([0.01, -0.02, 0.03])
    first, second = np.array([0.6, 0.8, 0.0]), np.array([0.0, 0.0, 1.0])
    cosine, sine = np.cos(angles)[:, None], np.sin(angles)[:, None]
    return centre, centre + radius * (cosine * first + sine * second)


@given(
    st.floats(-3.0, 3.0),
    st.floats(0.1, 6.1),
    st.floats(0.1, 0.9),
    st.sampled_from([-1.0, 1.0]),
)
def test_an_arc_goes_by_its_middle_at_an_even_pace(
    start: float, turn: float, share: float, way: float
) -> None:
    """The arc may be longer than half a turn."""
    centre, tips = on_circle([start, start + way * share * turn, start + way * turn])
    assert promises._circle_centre(tips) == pytest.approx(centre, abs=1e-9)
    places = promises._circular_arc(tips, centre, shorter=False)(SHARES)
    expected = on_circle((start + way * turn * SHARES).tolist())[1]
    assert places == pytest.approx(expected, abs=1e-9)


@given(st.floats(-3.0, 3.0), st.floats(0.1, 3.0), st.sampled_from([-1.0, 1.0]))
def test_the_shorter_arc_is_below_half_a_turn(start: float, turn: float, way: float) -> None:
    centre, tips = on_circle([start, start + way * turn])
    places = promises._circular_arc(tips, centre, shorter=True)(SHARES)
    assert places == pytest.approx(on_circle((start + way * turn * SHARES).tolist())[1], abs=1e-9)


def test_an_arc_to_where_it_begins_stays_there() -> None:
    centre, tips = on_circle([0.4, 0.4])
    assert promises._circular_arc(tips, centre, shorter=True)(SHARES) == pytest.approx(
        np.tile(tips[0], (41, 1))
    )


def test_distances_from_lines_and_arcs_are_those_of_geometry() -> None:
    rng = np.random.default_rng(1)
    start, end = np.array([0.0, 0.0, 0.01]), np.array([0.03, 0.0, 0.01])
    tips = rng.normal(size=(60, 3)) * [0.03, 0.003, 0.003] + [0.015, 0.0, 0.01]
    along = np.clip((tips - start) @ (end - start) / 0.03**2, 0.0, 1.0)
    expected = np.linalg.norm(tips - start - along[:, None] * (end - start), axis=1)
    assert len(set(along.tolist()) & {0.0, 1.0}) == 2

    def line(s: np.ndarray) -> np.ndarray:
        return promises._line_points(start, end, s)

    assert promises._distances_from_line(line, tips) == pytest.approx(expected, abs=1e-12)
    centre, ends = on_circle([0.0, 1.5, 3.0])
    curve = promises._circular_arc(ends, centre, shorter=False)
    angles = rng.uniform(0.1, 2.9, 40)
    _, near = on_circle(angles.tolist(), radius=0.0203)
    assert promises._distances_from_line(curve, near) == pytest.approx(np.full(40, 3e-4), abs=1e-9)


def test_motions_between_rounded_corners_are_one_phase() -> None:
    a, b, c = (
        Straight(tilt=-1.8, blend=1e-3),
        Follow(JOINTS, curve="line", blend=2e-3),
        Straight(tilt=-1.9),
    )
    dwell = Dwell(0.1)
    assert list(promises._chains([dwell, a, b, c, dwell])) == [[dwell], [a, b, c], [dwell]]
    assert list(promises._chains([c, c])) == [[c], [c]]


def way(**changes: object) -> PathPromise:
    """Return a promise of two lines along x and y, rounded within 1 mm at the origin."""
    lines = tuple(
        (lambda s, p=p, q=q: promises._line_points(np.array(p), np.array(q), s))
        for p, q in (((-0.01, 0.0, 0.0), (0.0,) * 3), ((0.0,) * 3, (0.0, 0.01, 0.0)))
    )
    return PathPromise(Span("way", 1.0, 2.0), lines, (1e-3,), **changes)  # type: ignore[arg-type]


def test_leaving_the_lines_counts_near_a_corner_by_its_reach() -> None:
    t = np.linspace(1.0, 2.0, 5)
    x = np.array([-9e-3, -2e-3, -0.8e-3, -0.2e-3, 0.0])
    tips = np.column_stack([x, 0 * x, 0 * x])
    assert way().corners.tolist() == [[0.0, 0.0, 0.0]]
    off = np.array([0.0, 0.0, 1e-5, 2e-5, 0.0])
    departure, rounding = promises._check_departure(way(), t, tips, off)
    assert departure.worst == 0.0
    assert rounding.worst == pytest.approx(0.8e-3)
    assert (rounding.time, rounding.case) == (t[2], "way")
    assert rounding.passed
    off = np.array([0.0, 3e-6, 1e-5, 2e-5, 0.0])
    departure, rounding = promises._check_departure(way(), t, tips, off)
    assert (departure.worst, departure.time) == (3e-6, t[1])
    assert not departure.passed
    assert rounding.worst == pytest.approx(2e-3)
    assert rounding.margin == pytest.approx(-1.0)
    departure, rounding = promises._check_departure(way(), t, tips, np.full(5, 0.9e-7))
    assert departure.passed
    assert rounding.worst == 0.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_value_to_be_kept_may_be_off_by_its_tolerance_either_way(sign: float) -> None:
    limit = promises.RetinaDistance(2e-3)
    t, values = np.array([1.0, 1.5, 2.0]), 2e-3 + sign * np.array([0.0, 4e-7, -1e-7])
    result = promises._check_required_value(limit, 1e-6, way(), t, values)
    assert result.margin == pytest.approx(0.6)
    assert (result.worst, result.time) == (values[1], 1.5)
    assert result.limit == pytest.approx(2e-3 + sign * 1e-6)
    assert not promises._check_required_value(limit, 3e-7, way(), t, values).passed


def test_a_value_that_is_kept_exactly_has_the_whole_margin() -> None:
    t, values = np.array([1.0, 2.0]), np.full(2, promises.RetinaDistance(2e-3).largest)
    result = promises._check_required_value(promises.RetinaDistance(2e-3), 1e-6, way(), t, values)
    assert (result.margin, result.worst, result.time) == (1.0, values[0], 1.0)
    assert result.limit == values[0] + 1e-6


def test_a_constant_speed_holds_from_its_first_to_its_last_instant() -> None:
    t = np.linspace(1.0, 2.0, 21)
    ramp = np.minimum(np.minimum(t - 1.0, 2.0 - t) / 0.2, 1.0)
    check, (begins, ends, error) = promises._check_constant_speed(way(), 5e-3, t, 5e-3 * ramp)
    assert (begins, ends) == pytest.approx((0.2, 0.8))
    assert error == pytest.approx(0.0, abs=1e-9)
    assert check.passed
    dented = 5e-3 * ramp
    dented[10] *= 0.99
    check, (*_, error) = promises._check_constant_speed(way(), 5e-3, t, dented)
    assert not check.passed
    assert (check.time, error) == (pytest.approx(1.5), pytest.approx(0.01))
    exceeded = 5e-3 * ramp
    exceeded[2] = 6e-3  # within the ramp
    assert not promises._check_constant_speed(way(), 5e-3, t, exceeded)[0].passed
    slow = promises._check_constant_speed(way(), 5e-3, t, 0.5 * 5e-3 * ramp)
    assert slow[1][:2] == (0.0, 0.0)
    assert not slow[0].passed


def test_instants_are_denser_about_corners_and_at_constant_speed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Motion:
        """The tip moves from −10 mm to 10 mm along x between 1 s and 2 s."""

        def __init__(self, count: int) -> None:
            self.breaks = np.linspace(0.5, 2.5, count + 1)

        def positions(self, t: np.ndarray) -> np.ndarray:
            return np.column_stack([0.02 * (t - 1.5), 0 * t, 0 * t])

    monkeypatch.setattr(promises, "tip_position", lambda mechanism, q: q)
    plain = PathPromise(Span("way", 1.0, 2.0), way().lines[:1])
    looks = {}
    for name, given_way in (
        ("plain", plain),
        ("steady", PathPromise(plain.span, plain.lines, speed=1.0)),
    ):
        t = promises._checked_instants(Motion(4), None, given_way)  # type: ignore[arg-type]
        assert (t[0], t[-1]) == (1.0, 2.0)
        assert np.diff(t) == pytest.approx(np.full(len(t) - 1, t[1] - t[0]))
        assert 1.5 in t
        looks[name] = len(t) - 1
    assert looks == {"plain": 6, "steady": 16}
    corners = {"middle": 0.0, "begin": -9.9e-3, "end": 9.9e-3}
    for corner in corners.values():
        ends = [np.array([x, 0.0, 0.0]) for x in (-0.02, corner, 0.02)]
        lines = tuple(partial(promises._line_points, p, q) for p, q in itertools.pairwise(ends))
        turning = PathPromise(Span("way", 1.0, 2.0), lines, (1e-3,))
        t = promises._checked_instants(Motion(40), None, turning)  # type: ignore[arg-type]
        assert len(t) > promises.CORNER_INSTANTS
        # The dense instants go from the last regular instant before the neighbourhood to the first
        # one after it.
        even = np.linspace(1.0, 2.0, 61)
        near = np.flatnonzero(np.abs(0.02 * (even - 1.5) - corner) < 1.5e-3)
        start, end = even[max(near[0] - 1, 0)], even[min(near[-1] + 1, 60)]
        dense = t[:-1][np.diff(t) < 1e-3 * (1 + 1e-9)]
        assert (dense.min(), t[t > dense.max()][0]) == pytest.approx((start, end))
        assert np.diff(t).max() == pytest.approx(1 / 60)
        assert (t[0], t[-1]) == (1.0, 2.0)


def test_each_corner_counts_with_its_own_distance() -> None:
    """Two corners are 10 mm apart along x, and are rounded within 1 mm and 2 mm."""
    ends = [np.array([x, 0.0, 0.0]) for x in (-0.01, 0.0, 0.01, 0.02)]
    lines = tuple(
        (lambda s, p=p, q=q: promises._line_points(p, q, s)) for p, q in itertools.pairwise(ends)
    )
    both = PathPromise(Span("way", 1.0, 2.0), lines, (1e-3, 2e-3))
    assert both.corners == pytest.approx(np.array(ends[1:3]))
    t = np.array([1.0, 1.2, 1.6, 2.0])
    x = np.array([-9e-3, 0.4e-3, 8.5e-3, 15e-3])
    tips = np.column_stack([x, 0 * x, 0 * x])
    off = np.array([0.0, 1e-5, 1e-5, 0.0])
    departure, rounding = promises._check_departure(both, t, tips, off)
    assert departure.worst == 0.0
    assert (rounding.worst, rounding.limit) == (pytest.approx(1.5e-3), 2e-3)
    assert rounding.time == 1.6
    off[3] = 2e-6
    assert promises._check_departure(both, t, tips, off)[0].worst == 2e-6


def test_a_phase_begins_on_the_branch_and_turn_of_its_motion(robot: Robot) -> None:
    """The turns of the roll are counted so that the last roll equals the roll in the problem."""
    mechanism = Mechanism.from_geometry(robot.geometry)
    start = np.array([0.3, 1.15, 0.1, -0.01])
    coefficients = np.zeros((1, 6, 4))
    coefficients[0, 0], coefficients[0, 1, 0] = start, 0.5
    motion = Trajectory(np.array([0.0, 2.0]), coefficients, ())
    task = task_from_joints(mechanism, motion.positions(np.array([0.0, 2.0])))
    span = Span("way", 0.0, 2.0)
    for turns in (-1, 0, 1):
        roll = float(task[1, 0] + 2 * np.pi * turns)
        result, branch = promises._initial_task(motion, mechanism, [Straight(roll=roll)], span)
        assert result[0] == pytest.approx(roll - 1.0)
        assert result[1:] == pytest.approx(task[0, 1:])
        assert branch == mechanism.branch_of(start)
    assert promises._initial_task(motion, mechanism, [Straight(tilt=-1.8)], span)[
        0
    ] == pytest.approx(task[0])
    coefficients = coefficients.copy()
    coefficients[0, 1, 1] = 2 * (mechanism.delta - start[1]) / 2.0  # moves to the other branch
    across = Trajectory(np.array([0.0, 2.0]), coefficients, ())
    _, branch = promises._initial_task(across, mechanism, [Straight(tilt=-1.8)], span)
    assert branch == mechanism.branch_of(start)
