"""Trajectory files of other programs are read, or they are refused with a message that names the
fault. The reference is the smooth trajectory that the files sample.
"""

from __future__ import annotations

import json
import math
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ssm_planner.errors import TrajectoryError
from ssm_planner.formats.joint_trajectory import controller_rejections, parse_message
from ssm_planner.formats.points import Points, interpolate_points
from ssm_planner.formats.read import read_trajectory
from ssm_planner.problem.robot import Robot
from ssm_planner.verification.certificate import Certificate
from ssm_planner.verification.check import check
from tests.support.plans import of_task, smooth

OWN = [
    "time_s",
    "q1_rad",
    "q2_rad",
    "q3_rad",
    "q4_m",
    "qd1_rad_per_s",
    "qd2_rad_per_s",
    "qd3_rad_per_s",
    "qd4_m_per_s",
]
ACCELERATIONS = ["qdd1_rad_per_s2", "qdd2_rad_per_s2", "qdd3_rad_per_s2", "qdd4_m_per_s2"]


def rows_of(robot: Robot, count: int = 101) -> np.ndarray:
    """Return rows (count, 13) with the time, q, qd and qdd of a smooth motion."""
    trajectory = smooth(robot)
    s = trajectory.sample(np.linspace(0, trajectory.duration, count))
    return np.column_stack([s.t, s.q, s.qd, s.qdd])


def write(path: Path, names: list[str], rows: np.ndarray, separator: str = ",") -> Path:
    lines = [separator.join(names), *(separator.join(f"{x:.15g}" for x in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def certificate_of(path: Path, robot: Robot) -> Certificate:
    """Return the certificate of the motion in a file."""
    reading = read_trajectory(path, robot)
    return check(
        reading.trajectory,
        robot,
        interpolation=reading.interpolation,
        resolution=reading.resolution,
    )


def margins(certificate: Certificate) -> dict[tuple[str, str | None], float]:
    """Return the margins by limit and joint, without those of jumps."""
    return {
        (limit.name, limit.joint): limit.margin
        for limit in certificate.limits
        if "jump" not in limit.name
    }


@pytest.mark.parametrize(
    ("columns", "word"),
    [(5, "linear"), (9, "cubic"), (13, "quintic")],
    ids=["q", "q qd", "q qd qdd"],
)
def test_points_are_joined_by_what_is_given(
    robot: Robot, tmp_path: Path, columns: int, word: str
) -> None:
    names = [*OWN, *ACCELERATIONS][:columns]
    result = certificate_of(
        write(tmp_path / "t.csv", names, rows_of(robot, 401)[:, :columns]), robot
    )
    assert result.interpolation.startswith(word)
    assert result.verdict == ("not judged" if word == "linear" else "kept")
    exact = margins(check(smooth(robot), robot))
    for (name, joint), margin in margins(result).items():
        if word == "linear" and name == "motor torque":  # the upper end of a torque band
            assert 0 < margin <= exact[name, joint]
        else:
            assert margin == pytest.approx(exact[name, joint], abs=5e-3)
    if word == "linear":
        assert not any(limit.name == "acceleration" for limit in result.limits)
        assert any("not defined" in line.reason for line in result.unjudged)


def test_names_and_units_of_others(robot: Robot, tmp_path: Path) -> None:
    """A table in other units, in another order and with another separator gives the same
    trajectory.

    The reading reports the columns that it does not use.
    """
    rows = rows_of(robot)
    deg, mm = 180 / math.pi, 1e3
    names = [
        "insertion [mm]", "Time (ms)", "spin position [deg]", "joint2 [rad]", "roll_deg", "temperature [degC]",
        "roll_velocity [deg/s]", "tilt velocity (rad/s)", "qd3_deg_per_s", "insertion speed [mm/s]",
    ]  # fmt: skip
    table = np.column_stack(
        [
            rows[:, 4] * mm, rows[:, 0] * 1e3, rows[:, 3] * deg, rows[:, 2], rows[:, 1] * deg, 20 + 0 * rows[:, 0],
            rows[:, 5] * deg, rows[:, 6], rows[:, 7] * deg, rows[:, 8] * mm,
        ]
    )  # fmt: skip
    path = write(tmp_path / "other.csv", names, table, separator=";")
    reading = read_trajectory(path, robot)
    assert reading.notes == ("columns not used: temperature [degC]",)
    ours = read_trajectory(write(tmp_path / "ours.csv", OWN, rows[:, :9]), robot)
    t = np.linspace(0, reading.trajectory.duration, 500)
    assert reading.trajectory.sample(t).q == pytest.approx(ours.trajectory.sample(t).q, abs=1e-12)
    assert reading.trajectory.sample(t).qd == pytest.approx(ours.trajectory.sample(t).qd, abs=1e-10)


def bad_csv(names: list[str], change) -> tuple[list[str], object]:
    return names, change


def at(row: int, column: int, value: float):
    def change(rows: np.ndarray) -> np.ndarray:
        rows[row, column] = value
        return rows

    return change


def nothing(rows: np.ndarray) -> np.ndarray:
    return rows


def renamed(old: str, new: str) -> list[str]:
    return [new if name == old else name for name in OWN]


def scaled(columns: list[int], factor: float):
    def change(rows: np.ndarray) -> np.ndarray:
        rows[:, columns] *= factor
        return rows

    return change


def swapped(a: int, b: int):
    def change(rows: np.ndarray) -> np.ndarray:
        rows[:, [a, b]] = rows[:, [b, a]]
        return rows

    return change


@pytest.mark.parametrize(
    ("names", "change", "message"),
    [
        (OWN, at(40, 0, 0.0), r"t\.csv:42: time goes back"),
        (OWN, lambda rows: np.insert(rows, 7, rows[7], axis=0), r"t\.csv:10: the same time twice"),
        (OWN, at(30, 3, math.nan), r"t\.csv:32: position is not a finite number"),
        (OWN, at(30, 6, math.inf), r"t\.csv:32: velocity is not a finite number"),
        (OWN, scaled([1, 2, 3, 5, 6, 7], 180 / math.pi), "are these degrees"),
        (
            OWN,
            scaled([5, 6, 7], 180 / math.pi),
            r"57\.\d+ times the slope of its positions: degrees where radians",
        ),
        (OWN, scaled([4, 8], 2000.0), "are these millimetres"),
        (
            OWN,
            scaled([8], 1e3),
            r"(999\.\d|1000) times the slope of its positions: millimetres where metres",
        ),
        (OWN, swapped(5, 6), "swapped columns"),
        (OWN, lambda rows: rows[:1], "at least two"),
        (OWN, lambda rows: rows[:0], "no row follows"),
        (renamed("q1_rad", "q1"), nothing, r"column 'q1': the unit is missing \(allowed: rad"),
        (renamed("q1_rad", "q1_mm"), nothing, "unit 'mm' is not allowed .* joint roll turns"),
        (renamed("q4_m", "q4_rad"), nothing, "joint insertion slides"),
        (renamed("q1_rad", "q2 [deg]"), nothing, "are the same quantity"),
        (renamed("q3_rad", "elbow_rad"), nothing, "no position of joint spin"),
        (renamed("qd3_rad_per_s", "comment"), nothing, "no velocity of joint spin"),
        (
            renamed("qd3_rad_per_s", "qd3_rad"),
            nothing,
            "the column is a velocity, but 'rad' is a unit of position",
        ),
        (
            [name if name == "time_s" else f"note {name}" for name in OWN],
            nothing,
            r"t\.csv:1: no position of joint roll, tilt, spin, insertion",
        ),
        (
            renamed("time_s", "time"),
            nothing,
            r"t\.csv:1: column 'time': the unit is missing \(allowed: s",
        ),
        (renamed("time_s", "t [h]"), nothing, "unit 'h' is not allowed"),
        (renamed("time_s", "index"), nothing, "no time column"),
    ],
)
def test_bad_csv_files(
    robot: Robot, tmp_path: Path, names: list[str], change, message: str
) -> None:
    path = write(tmp_path / "t.csv", names, change(rows_of(robot)[:, :9].copy()))
    with pytest.raises(TrajectoryError, match=message) as caught:
        read_trajectory(path, robot)
    assert (
        str(path) in str(caught.value)
        or "times the slope" in str(caught.value)
        or "swapped" in str(caught.value)
    )


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "the file is empty"),
        ("0.0,1,2,3,4\n0.1,1,2,3,4\n", "no header"),
        ("nothing here\n", "no columns"),
        (
            "time_s,q1_rad,q2_rad,q3_rad,q4_m\n0,0,0,0,0\n1,0,0,zero,0\n",
            r"t\.csv:3: q3_rad: 'zero' is not a number",
        ),
        (
            "time_s,q1_rad,q2_rad,q3_rad,q4_m\n0,0,0,0,0\n1,0,0\n2,0,0,0,0\n",
            r"t\.csv:3: the row has 3 columns, but the header has 5",
        ),
        (
            "time_s,q1_rad,q2_rad,q3_rad,q4_m\n0,0,0,0,0\n1,0,0,0,0\n2,0,0",
            r"t\.csv:4: the row has 3 columns",
        ),
        (
            "time_s,q1_rad,q2_rad,q3_rad,q4_m\n0,0,0\n1,0,0\n2,0,0",
            r"t\.csv:2: the row has 3 columns",
        ),
        (
            "time_s,q1_rad,q2_rad,q3_rad,q4_m\n" + "0," * 9 + "0\n" + "1," * 9 + "0\n",
            r"t\.csv:2: the row has 10 columns",
        ),
    ],
)
def test_text_that_is_no_table(robot: Robot, tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(TrajectoryError, match=message):
        read_trajectory(path, robot)


def test_bytes_and_places_that_are_no_file(robot: Robot, tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_bytes(b"time_s,q1_rad\n\xff\xfe\x00\x81")
    with pytest.raises(TrajectoryError, match="not a text file"):
        read_trajectory(path, robot)
    with pytest.raises(TrajectoryError, match="no such file"):
        read_trajectory(tmp_path / "none.csv", robot)
    with pytest.raises(TrajectoryError, match="not a rosbag2 and not an export"):
        read_trajectory(tmp_path, robot)
    (tmp_path / "t.xls").write_text("", encoding="utf-8")
    with pytest.raises(TrajectoryError, match="unknown file type"):
        read_trajectory(tmp_path / "t.xls", robot)


def test_a_motion_from_waypoints_at_rest_is_no_fault_of_its_velocities(robot: Robot) -> None:
    """Velocities of 0 at every point differ from the slopes, which is permitted."""
    q = np.cumsum(np.full((40, 4), 0.01) * [1, 1, 1, -0.05], axis=0) + [0, 0.5, 0, 0]
    points = Points(np.arange(40) * 0.5, q, np.zeros_like(q), np.zeros_like(q))
    assert check(interpolate_points(points, robot).trajectory, robot).passed


def test_straight_pieces_are_judged_by_their_velocity_jumps(robot: Robot) -> None:
    """A velocity jump that the acceleration limit permits within an interval passes.

    A larger jump does not pass.
    """
    joint, h = robot.joints[0], 0.01
    for share, passed in ((0.999, True), (1.001, False)):
        velocity = np.array([0.0, 0.5, 1.0, 0.5, 0.0]) * joint.acceleration * h * share * 2
        q = np.zeros((6, 4)) + [0.0, 0.5, 0.0, -0.01]
        q[1:, 0] += np.cumsum(velocity) * h
        reading = interpolate_points(Points(np.arange(6) * h, q), robot)
        result = check(reading.trajectory, robot, resolution=reading.resolution)
        assert result.verdict == ("not judged" if passed else "violated")
        if not passed:
            margins_of_violations = {(v.name, v.joint): v.margin for v in result.violations}
            assert margins_of_violations == {
                ("velocity jump", "roll"): pytest.approx(-0.001, rel=0.1),
                ("acceleration", "roll"): pytest.approx(-0.001, rel=0.1),
            }


def test_rounded_positions_are_not_charged_with_their_rounding(
    robot: Robot, tmp_path: Path
) -> None:
    rows = rows_of(robot, 2001)[:, :5]
    path = tmp_path / "t.csv"
    np.savetxt(
        path,
        rows,
        fmt=["%.6f", *["%.5f"] * 3, "%.7f"],
        delimiter=",",
        header=",".join(OWN[:5]),
        comments="",
    )
    reading = read_trajectory(path, robot)
    assert reading.resolution == pytest.approx([5e-6, 5e-6, 5e-6, 5e-8])
    result = check(reading.trajectory, robot, resolution=reading.resolution)
    assert not result.violations
    assert "velocity" not in {line.name for line in result.unjudged}
    assert not check(reading.trajectory, robot, resolution=np.zeros(4)).passed


def test_speeds_of_the_tool_are_not_charged_with_the_rounding_either(
    robot: Robot, tmp_path: Path
) -> None:
    """Rounded points keep limits just above the true speeds and violate limits below them."""
    exact = smooth(robot)
    loose = of_task(tip_speed=1.0, rates=dict.fromkeys(("roll", "tilt", "spin", "depth"), 10.0))
    worst = {limit.name: limit.worst for limit in check(exact, robot, loose).limits}
    rows = rows_of(robot, 2001)[:, :5]
    path = tmp_path / "t.csv"
    np.savetxt(
        path,
        rows,
        fmt=["%.7f", *["%.6f"] * 3, "%.8f"],
        delimiter=",",
        header=",".join(OWN[:5]),
        comments="",
    )
    reading = read_trajectory(path, robot)
    for factor, is_kept in ((1.0001, True), (0.98, False)):
        tight = of_task(
            tip_speed=factor * worst["tip speed"],
            rates={name: factor * worst[f"{name} rate"] for name in ("roll", "tilt", "spin")}
            | {"depth": factor * worst["insertion speed"]},
        )
        result = check(reading.trajectory, robot, tight, resolution=reading.resolution)
        names = {v.name for v in result.violations}
        assert names == (
            set()
            if is_kept
            else {"tip speed", "roll rate", "tilt rate", "spin rate", "insertion speed"}
        )
        for limit in result.limits:
            if limit.name in names:
                assert limit.worst == pytest.approx(worst[limit.name], rel=0.01)
        if is_kept:
            assert len(check(reading.trajectory, robot, tight).violations) >= 5


def yaml_of(robot: Robot, count: int = 11, **changes: object) -> dict:
    """Return the data of a JointTrajectory message of the smooth motion, with changed keys."""
    rows = rows_of(robot, count)
    names = [joint.name for joint in robot.joints]
    points = [
        {
            "positions": row[1:5].tolist(),
            "velocities": row[5:9].tolist(),
            "accelerations": [],
            "effort": [],
            "time_from_start": {"sec": int(row[0]), "nanosec": round((row[0] % 1) * 1e9)},
        }
        for row in rows
    ]
    return {"header": {"frame_id": "base"}, "joint_names": names, "points": points, **changes}


def write_yaml(path: Path, data: object) -> Path:
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


def test_joint_names_say_which_column_is_which(robot: Robot, tmp_path: Path) -> None:
    data = yaml_of(robot)
    plain = read_trajectory(write_yaml(tmp_path / "a.yaml", data), robot)
    order = [2, 0, 3, 1]
    data["joint_names"] = [data["joint_names"][i] for i in order]
    for point in data["points"]:
        for key in ("positions", "velocities"):
            point[key] = [point[key][i] for i in order]
    other = read_trajectory(write_yaml(tmp_path / "b.yaml", {"trajectory": data}), robot)
    assert np.array_equal(plain.trajectory.coefficients, other.trajectory.coefficients)
    assert plain.interpolation.startswith("cubic")


def test_points_with_and_without_velocities(robot: Robot, tmp_path: Path) -> None:
    data = yaml_of(robot)
    for point in data["points"][3:5]:
        point["velocities"] = []
    reading = read_trajectory(write_yaml(tmp_path / "t.yaml", data), robot)
    assert reading.interpolation == "mixed between points: 3 linear, 7 cubic"
    assert reading.resolution is not None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda d: d.update(joint_names=["roll", "tilt", "spin", "depth"]),
            "joint 'depth' is not one of",
        ),
        (lambda d: d.update(joint_names=["roll", "tilt", "spin"]), "joint 'insertion' is missing"),
        (lambda d: d.update(joint_names=["roll", "tilt", "spin", "roll"]), "named twice"),
        (lambda d: d.update(points=[]), "no points"),
        (
            lambda d: d["points"][4].update(positions=[1.0, 2.0]),
            "point 4: 2 positions for 4 joints",
        ),
        (lambda d: d["points"][4].update(velocities=[1.0]), "point 4: 1 velocities for 4 joints"),
        (
            lambda d: d["points"][4].update(positions=["a"] * 4),
            "point 4: positions is not a list of numbers",
        ),
        (
            lambda d: d["points"][4].update(time_from_start={"sec": 0, "nanosec": 0}),
            "time_from_start does not increase",
        ),
        (lambda d: d["points"][4].pop("time_from_start"), "point 4: time_from_start is None"),
        (lambda d: d["points"][0].update(time_from_start={"sec": -1}), "negative"),
        (lambda d: d.pop("points"), "not a JointTrajectory"),
        (lambda d: d["points"][4].update(positions=[90.0] * 4), "are these degrees"),
        (lambda d: [p.update(velocities=[57.3 * v for v in p["velocities"]]) for p in d["points"]], "times the slope"),
    ],
)  # fmt: skip
def test_bad_messages(robot: Robot, tmp_path: Path, change, message: str) -> None:
    data = yaml_of(robot, 41)
    change(data)
    with pytest.raises(TrajectoryError, match=message):
        read_trajectory(write_yaml(tmp_path / "t.yaml", data), robot)


def test_remarks_on_what_a_controller_may_refuse(robot: Robot, tmp_path: Path) -> None:
    data = yaml_of(robot)
    data["points"][-1]["velocities"] = [0.1, 0.0, 0.0, 0.0]
    data["points"][0]["effort"] = [0.0] * 4
    reading = read_trajectory(write_yaml(tmp_path / "t.yaml", data), robot)
    assert any("last velocity" in note for note in reading.notes)
    assert any("effort" in note for note in reading.notes)


@pytest.mark.parametrize(("last", "remarked"), [([], False), ([0.1, 0.0, 0.0, 0.0], True)])
def test_only_the_last_velocity_is_remarked(
    robot: Robot, last: list[float], remarked: bool
) -> None:
    names = [joint.name for joint in robot.joints]
    points: list[dict[str, Any]] = [
        {"time_from_start": {"sec": k}, "positions": [0.0] * 4} for k in range(3)
    ]
    points[-2]["velocities"] = [] if remarked else [0.2] * 4
    points[-1]["velocities"] = last
    message = parse_message({"joint_names": names, "points": points}, "t.yaml")
    faults, remarks = controller_rejections(message, names)
    assert not faults
    assert any("last velocity is 0.1" in remark for remark in remarks) == remarked


def test_text_that_is_no_yaml(robot: Robot, tmp_path: Path) -> None:
    path = tmp_path / "t.yaml"
    path.write_text("points: [1, 2\n", encoding="utf-8")
    with pytest.raises(TrajectoryError, match="not valid YAML"):
        read_trajectory(path, robot)


@pytest.mark.parametrize("columns", [5, 9, 13])
def test_a_long_file_is_judged_from_a_file_like_a_short_one_from_memory(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, columns: int
) -> None:
    """The certificate of a file that is read in blocks equals that of a file in memory to the bit.

    The message about a fault deep in the file names the same line.
    """
    names, rows = [*OWN, *ACCELERATIONS][:columns], rows_of(robot, 301)[:, :columns]
    path = write(tmp_path / "t.csv", names, rows)
    short = certificate_of(path, robot)
    rows[200, 0] = rows[100, 0]
    broken = write(tmp_path / "broken.csv", names, rows)
    in_blocks(monkeypatch, 17)
    assert certificate_of(path, robot) == short
    with pytest.raises(TrajectoryError, match=r"broken.csv:202: time goes back"):
        certificate_of(broken, robot)
    lines = broken.read_text(encoding="utf-8").splitlines()
    broken.write_text("\n".join([*lines[:251], lines[251] + ",5", *lines[252:]]), encoding="utf-8")
    with pytest.raises(
        TrajectoryError,
        match=rf"broken.csv:252: the row has {columns + 1} columns, but the header has {columns}",
    ):
        certificate_of(broken, robot)


@pytest.mark.slow
def test_memory_of_a_long_file_grows_with_its_times_alone(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Memory grows by at most four 8-byte numbers per row.

    A row itself has 104 bytes of numbers, and its polynomial piece has 192.
    """
    in_blocks(monkeypatch, 2048)

    def peak(count: int) -> int:
        path = write(tmp_path / "t.csv", [*OWN, *ACCELERATIONS], rows_of(robot, count))
        tracemalloc.start()
        try:
            assert certificate_of(path, robot).limits
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    peak(100)  # The first call allocates memory that later calls reuse.
    assert peak(75_000) - peak(25_000) < 50_000 * 4 * 8


def in_blocks(monkeypatch: pytest.MonkeyPatch, size: int) -> None:
    """Make the readers work in blocks of `size` rows, as they do for long files."""
    monkeypatch.setattr("ssm_planner.formats.points.IN_MEMORY_ROWS", size)
    for module in ("formats.csv", "formats.points", "trajectory"):
        monkeypatch.setattr(f"ssm_planner.{module}.PIECES_PER_BLOCK", size)
