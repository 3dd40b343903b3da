"""Points joined to a trajectory: pieces by what is given, and the faults of points."""

from __future__ import annotations

import numpy as np
import pytest

from ssm_planner.errors import TrajectoryError
from ssm_planner.formats import points as module
from ssm_planner.formats.points import Points, Reading, check_magnitudes, describe, join_points
from ssm_planner.formats.trajectory_csv import headings
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory

T = np.linspace(0.0, 2.0, 25)
RATE = np.array([1.0, 1.3, 0.7, 0.01])


def curves(order: int) -> np.ndarray:
    """Sines of different rates, and their derivatives, (n, 4)."""
    phase = np.outer(T, [1.0, 2.0, 1.5, 3.0]) + order * np.pi / 2 + np.array([0.0, 1.0, 2.0, 0.5])
    return np.sin(phase) * np.array([1.0, 2.0, 1.5, 3.0]) ** order * [0.5, 0.4, 0.3, 0.01]


@pytest.mark.parametrize("order", [0, 1, 2])
def test_pieces_take_up_what_the_points_give(robot: Robot, order: int) -> None:
    given = [curves(k) if k <= order else None for k in range(3)]
    reading = join_points(Points(T, *given), robot)
    for side, at in (("right", T[:-1]), ("left", T[1:])):
        samples = reading.trajectory.sample(at, side)
        rows = slice(None, -1) if side == "right" else slice(1, None)
        for values, name in zip(given, ("q", "qd", "qdd"), strict=True):
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
    reading = join_points(points, robot)
    coefficients = reading.trajectory.pieces(slice(0, 24))
    assert np.flatnonzero(~coefficients[:, 2:].any(axis=(1, 2))).tolist() == [2, 3]
    assert np.flatnonzero(~coefficients[:, 4:].any(axis=(1, 2))).tolist() == [2, 3, 9, 10]
    assert reading.interpolation == "mixed between points: 2 linear, 2 cubic, 20 quintic"
    assert np.array_equal(reading.resolution, np.full(4, 1e-5))
    none, some = np.zeros(2, dtype=bool), np.array([True, False])
    assert describe(some, none) == "mixed between points: 1 linear, 1 cubic"
    assert describe(~none, some) == "mixed between points: 1 cubic, 1 quintic"


def test_a_long_table_makes_its_pieces_when_they_are_asked_for(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = join_points(Points(T, curves(0), curves(1)), robot).trajectory
    monkeypatch.setattr(module, "LONG", 10)
    lazy = join_points(Points(T, curves(0), curves(1)), robot).trajectory
    for block in (module.BLOCK, 3):
        monkeypatch.setattr(module, "BLOCK", block)
        for chosen in (slice(0, 5), slice(20, 24), slice(2, 23), np.array([3, 1, 23])):
            assert np.array_equal(lazy.pieces(chosen), whole.pieces(chosen))


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
        join_points(Points(t, q, qd), robot)


@pytest.mark.parametrize("block", [4, 1000])
@pytest.mark.parametrize("row", [0, 1, 4, 24])
def test_every_row_must_be_finite(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, row: int, block: int
) -> None:
    monkeypatch.setattr(module, "BLOCK", block)
    for k, name in enumerate(("time", "position", "velocity", "acceleration")):
        table = [T.copy(), *(curves(order) for order in range(3))]
        table[k][row] = np.nan
        with pytest.raises(TrajectoryError, match=f"point {row}: {name} is not a finite number"):
            join_points(Points(*table), robot)


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
        join_points(Points(T, *columns), robot)


def test_accelerations_of_another_joint_are_recognised(robot: Robot) -> None:
    swapped = curves(2)[:, [1, 0, 2, 3]]
    with pytest.raises(
        TrajectoryError, match=r"accelerations given for joint tilt .* of joint roll"
    ):
        join_points(Points(T, curves(0), curves(1), swapped), robot)
    join_points(Points(T, curves(0), curves(1), curves(2)), robot)


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
    taken = reading.ends_on(TaskLimits())
    assert (taken.start_rate, taken.end_rate) == ({"tilt": 0.1}, {"roll": 0.2})
    kept = reading.ends_on(TaskLimits(start_rate=None, end_rate={"roll": 0.3}))
    assert (kept.start_rate, kept.end_rate) == (None, {"roll": 0.3})


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
    found, ignored = headings([*others, "current_A", "remark"], robot, "file")
    assert ignored == ["current_A", "remark"]
    assert found[key].column == place
    assert found[key].name == name
    assert found[key].factor == pytest.approx(factor)
    with pytest.raises(TrajectoryError, match="are the same quantity"):
        headings([*others, name], robot, "file")
    if key[0] >= 0:
        with pytest.raises(TrajectoryError, match=f"joint {robot.joints[key[1]].name}"):
            headings([other for other in others if other != name], robot, "file")
