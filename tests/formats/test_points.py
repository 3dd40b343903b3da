"""Points are joined to a trajectory whose pieces match the given values, and faulty points are
refused with a message. The references are sines with their exact derivatives.
"""

from __future__ import annotations

import numpy as np
import pytest

from ssm_planner.errors import TrajectoryError
from ssm_planner.formats import points as module
from ssm_planner.formats.points import (
    Points,
    Reading,
    check_magnitudes,
    describe_interpolation,
    interpolate_points,
)
from ssm_planner.formats.trajectory_csv import identify_columns
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory

T = np.linspace(0.0, 2.0, 25)
RATE = np.array([1.0, 1.3, 0.7, 0.01])


def curves(order: int) -> np.ndarray:
    """Return sines of different rates and their derivatives, (n, 4)."""
    phase = np.outer(T, [1.0, 2.0, 1.5, 3.0]) + order * np.pi / 2 + np.array([0.0, 1.0, 2.0, 0.5])
    return np.sin(phase) * np.array([1.0, 2.0, 1.5, 3.0]) ** order * [0.5, 0.4, 0.3, 0.01]


@pytest.mark.parametrize("order", [0, 1, 2])
def test_pieces_take_up_what_the_points_give(robot: Robot, order: int) -> None:
    inputs = [curves(k) if k <= order else None for k in range(3)]
    reading = interpolate_points(Points(T, *inputs), robot)
    for side, time in (("right", T[:-1]), ("left", T[1:])):
        samples = reading.trajectory.sample(time, side)
        rows = slice(None, -1) if side == "right" else slice(1, None)
        for values, name in zip(inputs, ("q", "qd", "qdd"), strict=True):
            if values is not None:
                assert getattr(samples, name) == pytest.approx(values[rows], abs=1e-9)
    degree = (1, 3, 5)[order]
    coefficients = reading.trajectory.pieces(slice(0, 24))
    assert coefficients[:, degree].any()
    assert not coefficients[:, degree + 1 :].any()
    assert (reading.resolution is None) == (order > 0)
    assert reading.interpolation.startswith(("linear", "cubic", "quintic")[order])


def test_points_of_different_kinds_are_joined_by_the_lesser(robot: Robot) -> None:
    has_qd = np.ones(25, dtype=bool)
    has_qd[3] = False
    has_qdd = has_qd.copy()
    has_qdd[10] = False
    points = Points(T, curves(0), curves(1), curves(2), has_qd, has_qdd, np.full(4, 1e-5))
    reading = interpolate_points(points, robot)
    coefficients = reading.trajectory.pieces(slice(0, 24))
    assert np.flatnonzero(~coefficients[:, 2:].any(axis=(1, 2))).tolist() == [2, 3]
    assert np.flatnonzero(~coefficients[:, 4:].any(axis=(1, 2))).tolist() == [2, 3, 9, 10]
    assert reading.interpolation == "mixed between points: 2 linear, 2 cubic, 20 quintic"
    assert np.array_equal(reading.resolution, np.full(4, 1e-5))
    none, some = np.zeros(2, dtype=bool), np.array([True, False])
    assert describe_interpolation(some, none) == "mixed between points: 1 linear, 1 cubic"
    assert describe_interpolation(~none, some) == "mixed between points: 1 cubic, 1 quintic"


def test_a_long_table_makes_its_pieces_when_they_are_asked_for(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    complete = interpolate_points(Points(T, curves(0), curves(1)), robot).trajectory
    for block in (10, 3):
        monkeypatch.setattr(module, "PIECES_PER_BLOCK", block)
        lazy = interpolate_points(Points(T, curves(0), curves(1)), robot).trajectory
        assert not isinstance(lazy.coefficients, np.ndarray)
        for chosen in (slice(0, 5), slice(20, 24), slice(2, 23), np.array([3, 1, 23])):
            assert np.array_equal(lazy.pieces(chosen), complete.pieces(chosen))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t, q, qd: (t[:1], q[:1], qd[:1]), "1 point; a trajectory needs at least two"),
        (lambda t, q, qd: (np.where(np.arange(25) == 4, t[3], t), q, qd), "point 4: the same time twice"),
        (lambda t, q, qd: (np.where(np.arange(25) == 4, t[2], t), q, qd), "point 4: time goes back"),
        (lambda t, q, qd: (np.where(np.arange(25) == 7, np.nan, t), q, qd), "point 7: time is not"),
        (lambda t, q, qd: (t, np.where(q == q[5], np.inf, q), qd), "point 5: position is not"),
        (lambda t, q, qd: (t, q, np.where(qd == qd[6], np.nan, qd)), "point 6: velocity is not"),
        (lambda t, q, qd: (t, q, np.degrees(qd)), r"of joint roll are 57\.\d+ times the slope .* degrees"),
        (lambda t, q, qd: (t, q, qd[:, [1, 0, 2, 3]]), "for joint tilt are those of joint roll"),
        (lambda t, q, qd: (t, q, qd * [1, 1, 1, 1000]), "of joint insertion are 99.* times .* millimetres"),
        (lambda t, q, qd: (t, q + 1e3, qd), "position of joint roll = .* are these degrees"),
        (lambda t, q, qd: (t, q * [1, 1, 1, 1e3], qd), "joint insertion = .* millimetres"),
    ],
)  # fmt: skip
def test_faults_of_points_are_named(robot: Robot, change, message: str) -> None:
    t, q, qd = change(T, curves(0), curves(1))
    with pytest.raises(TrajectoryError, match=message):
        interpolate_points(Points(t, q, qd), robot)


@pytest.mark.parametrize("block", [4, 1000])
@pytest.mark.parametrize("row", [0, 1, 4, 24])
def test_every_row_must_be_finite(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, row: int, block: int
) -> None:
    monkeypatch.setattr(module, "PIECES_PER_BLOCK", block)
    for k, name in enumerate(("time", "position", "velocity", "acceleration")):
        table = [T.copy(), *(curves(order) for order in range(3))]
        table[k][row] = np.nan
        with pytest.raises(TrajectoryError, match=f"point {row}: {name} is not a finite number"):
            interpolate_points(Points(*table), robot)


@pytest.mark.parametrize(
    ("factors", "message"),
    [
        ((1.0, 57.3, 1.0), "velocities of joint roll .* times the slope of its positions: degrees where radians"),
        ((57.3, 1.0, 1.0), "velocities of joint roll are 0.017.* degrees where radians are meant in the positions"),
        ((1000.0, 1.0, 1.0), "velocities of joint insertion are .* millimetres where metres are meant in the positions"),
        ((1.0, 1.0, 57.3), "accelerations of joint roll .* times the slope of its velocities: degrees"),
        ((1.0, 1.0, 1 / 57.3), "accelerations of joint roll .* in the velocities"),
        ((1.0, 5.0, 1.0), "velocities of joint roll are 4.99. times the slope of its positions$"),
    ],
)  # fmt: skip
def test_a_wrong_unit_of_a_derivative_is_named_with_its_side(
    robot: Robot, factors: tuple[float, float, float], message: str
) -> None:
    # The positions are so small that they are plausible in degrees and millimetres as well.
    columns = [curves(order) * np.array([1, 1, 1, 0.01]) / 60 for order in range(3)]
    selected = [3] if factors[0] == 1000.0 else [0, 1, 2]
    for column, factor in zip(columns, factors, strict=True):
        column[:, selected] *= factor
    with pytest.raises(TrajectoryError, match=message):
        interpolate_points(Points(T, *columns), robot)


def test_accelerations_of_another_joint_are_recognised(robot: Robot) -> None:
    swapped = curves(2)[:, [1, 0, 2, 3]]
    with pytest.raises(
        TrajectoryError, match=r"accelerations given for joint tilt .* of joint roll"
    ):
        interpolate_points(Points(T, curves(0), curves(1), swapped), robot)
    interpolate_points(Points(T, curves(0), curves(1), curves(2)), robot)


def test_magnitudes_are_those_of_the_kind_of_joint(robot: Robot) -> None:
    q = np.zeros((3, 4))
    check_magnitudes(q, robot, "row {}".format, 10)
    for joint, largest in ((0, module.LARGEST_ANGLE), (3, module.LARGEST_STROKE)):
        for sign in (1, -1):
            q = np.zeros((3, 4))
            q[1, joint] = sign * largest
            check_magnitudes(q, robot, "row {}".format, 10)
            q[1, joint] *= 1.001
            with pytest.raises(TrajectoryError, match="row 11"):
                check_magnitudes(q, robot, "row {}".format, 10)


def test_rates_that_a_file_declares_give_way_to_those_asked_for() -> None:
    trajectory = Trajectory(np.array([0.0, 1.0]), np.zeros((1, 6, 4)), ())
    reading = Reading(trajectory, "x", None, start_rate={"tilt": 0.1}, end_rate={"roll": 0.2})
    taken = reading.add_declared_rates(TaskLimits())
    assert (taken.start_rate, taken.end_rate) == ({"tilt": 0.1}, {"roll": 0.2})
    limits = reading.add_declared_rates(TaskLimits(start_rate=None, end_rate={"roll": 0.3}))
    assert (limits.start_rate, limits.end_rate) == (None, {"roll": 0.3})


@pytest.mark.parametrize(
    ("name", "key", "factor"),
    [
        ("time_s", (-1, 0), 1.0),
        ("t [ms]", (-1, 0), 1e-3),
        ("q1_rad", (0, 0), 1.0),
        ("roll [deg]", (0, 0), np.pi / 180),
        ("joint4_position_mm", (0, 3), 1e-3),
        ("tilt velocity [deg/s]", (1, 1), np.pi / 180),
        ("qd3_rad_per_s", (1, 2), 1.0),
        ("qdd4_m_per_s2", (2, 3), 1.0),
        ("axis 2 [rad]", (0, 1), 1.0),
        ("joint 2 velocity [deg/s]", (1, 1), np.pi / 180),
    ],
)
def test_headings_tell_joint_derivative_and_unit(
    robot: Robot, name: str, key: tuple[int, int], factor: float
) -> None:
    others = ["time_s", *(f"q{i}_{'m' if i == 4 else 'rad'}" for i in (1, 2, 3, 4))]
    if key[0] > 0:
        others += [f"qd{i}_{'m' if i == 4 else 'rad'}_per_s" for i in (1, 2, 3, 4)]
    if key[0] > 1:
        others += [f"qdd{i}_{'m' if i == 4 else 'rad'}_per_s2" for i in (1, 2, 3, 4)]
    place = 0 if key[0] < 0 else 1 + 4 * key[0] + key[1]
    others[place] = name
    result, ignored = identify_columns([*others, "current_A", "remark"], robot, "file")
    assert ignored == ["current_A", "remark"]
    assert result[key].column == place
    assert result[key].name == name
    assert result[key].factor == pytest.approx(factor)
    with pytest.raises(TrajectoryError, match="are the same quantity"):
        identify_columns([*others, name], robot, "file")
    if key[0] >= 0:
        with pytest.raises(TrajectoryError, match=f"joint {robot.joints[key[1]].name}"):
            identify_columns([other for other in others if other != name], robot, "file")


def test_the_first_of_several_faults_is_named(robot: Robot) -> None:
    t, q, qd = T.copy(), curves(0), curves(1)
    qd[[9, 20], 2] = np.nan
    with pytest.raises(TrajectoryError, match="point 9: velocity is not a finite number"):
        interpolate_points(Points(t, q, qd), robot)
    t[[6, 7, 15]] = t[3]
    with pytest.raises(TrajectoryError, match=r"point 6: time goes back: 0\.25 s after 0\.41"):
        interpolate_points(Points(t, q), robot)
    t = T.copy()
    t[6] = t[5]
    with pytest.raises(
        TrajectoryError, match=r"point 6: the same time twice: 0\.41\d* s after 0\.41\d* s"
    ):
        interpolate_points(Points(t, q), robot)


def test_two_points_are_a_trajectory(robot: Robot) -> None:
    reading = interpolate_points(
        Points(np.array([0.5, 2.5]), np.array([[0.0] * 4, [0.2] * 4])), robot
    )
    assert reading.trajectory.duration == 2.0
    assert reading.trajectory.sample([1.5]).q == pytest.approx(0.1)
    with pytest.raises(TrajectoryError, match="point 0: 1 point; a trajectory needs at least two"):
        interpolate_points(Points(np.zeros(1), np.zeros((1, 4))), robot)


@pytest.mark.parametrize(("count", "compared"), [(20, False), (21, True)])
def test_few_points_are_not_compared_with_their_slopes(
    robot: Robot, count: int, compared: bool
) -> None:
    assert count - compared == module.SHORT_TABLE_POINTS
    t, q, qd = (table[:count] for table in (T, curves(0), np.degrees(curves(1))))
    if not compared:
        interpolate_points(Points(t, q, qd), robot)
        return
    with pytest.raises(TrajectoryError, match="times the slope"):
        interpolate_points(Points(t, q, qd), robot)


@pytest.mark.parametrize("interval", [0, 1, 12, 22, 23])
def test_every_interval_is_compared(robot: Robot, interval: int) -> None:
    """A joint that moves in a single interval reveals a wrong unit in that interval."""
    q, qd = np.zeros((2, 25, 4))
    q[interval + 1 :, 1] = 0.1
    slope = 0.1 / (T[1] - T[0])
    j = np.arange(25)
    sign = (-1.0) ** np.where(j <= interval, interval - j, j - interval - 1)
    for factor, fault in ((1.0, False), (57.3, True)):
        # The mean velocity vanishes in all intervals except one.
        qd[:, 1] = factor * slope * sign
        means = (qd[1:, 1] + qd[:-1, 1]) / 2
        assert np.flatnonzero(np.abs(means) > 1e-12).tolist() == [interval]
        if not fault:
            interpolate_points(Points(T, q, qd), robot)
            continue
        with pytest.raises(TrajectoryError, match=r"velocities of joint tilt are 57\.3 times"):
            interpolate_points(Points(T, q, qd), robot)


@pytest.mark.parametrize(
    ("factor", "fault"),
    [(0.51, None), (1.9, None), (0.49, ""), (2.1, ""), (-1.0, ""), (30.0, "degrees"), (110.0, "degrees"),
     (27.0, ""), (130.0, ""), (520.0, "milli"), (1900.0, "milli"), (480.0, ""), (2100.0, "")],
)  # fmt: skip
def test_a_factor_up_to_two_is_no_other_unit(
    robot: Robot, factor: float, fault: str | None
) -> None:
    """A factor is refused whether it scales the positions or the velocities."""
    small = 1e-5 * np.array([1.0, 1.0, 1.0, 0.1])
    q, qd = curves(0) * small, curves(1) * small
    if fault is None:
        interpolate_points(Points(T, q, factor * qd), robot)
        return
    for by_positions in (False, True):
        tables = (factor * q, qd) if by_positions else (q, factor * qd)
        with pytest.raises(TrajectoryError, match="times the slope of its positions") as caught:
            interpolate_points(Points(T, *tables), robot)
        text = str(caught.value).partition("positions")[2]
        assert text.startswith(f": {fault}") == bool(fault)
        assert ("in the positions" in text) == (bool(fault) and by_positions)


def test_columns_are_alike_up_to_a_twentieth(robot: Robot) -> None:
    """Residual and factor of proportional columns agree with a calculation by hand."""
    slope = np.array([1.0, 0.0])
    for across, residual in ((0.0, 0.0), (1.0, 0.5**0.5)):
        factor, result = module._fit_factor(slope, np.array([1.0, across]))
        assert (factor, result) == pytest.approx((1.0, residual))
    assert module._fit_factor(slope, np.zeros(2)) == (0.0, 1.0)
    assert module._fit_factor(2 * slope, np.array([3.0, 0.0])) == pytest.approx((1.5, 0.0))
    for factor, residual, same in (
        (1.049, 0.049, True),
        (0.951, 0.0, True),
        (1.051, 0.0, False),
        (0.949, 0.0, False),
        (1.0, 0.051, False),
    ):
        assert module._columns_agree(factor, residual) is same
