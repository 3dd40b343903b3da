"""The reader refuses files and manifest entries that do not follow from the motion of an export,
even if their hashes match.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from ssm_planner.errors import TrajectoryError
from ssm_planner.formats.agreement import first_difference
from ssm_planner.formats.export import export
from ssm_planner.formats.read import read_trajectory
from ssm_planner.plans import Plan
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.publishing import MANIFEST, file_hashes

OPTIONS: dict[str, dict[str, Any]] = {
    "csv": {"rate": 100.0, "columns": ["q", "qd", "qdd", "torque", "counts"]},
    "epos4": {"counts_per_turn": 4096, "rate": 100.0},
    "pvt": {"counts_per_turn": 4096},
    "ros2": {"rate": 20.0},
    "csv with stops": {"stops": 9},
    "epos4 with stops": {"counts_per_turn": 4096, "rate": 200.0, "stops": 9},
}
Change = Callable[[Path, dict[str, Any]], None]


@pytest.fixture(scope="module")
def exports(plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Export the plan with every set of options, and return the folder of all exports."""
    root = tmp_path_factory.mktemp("exports")
    for kind, options in OPTIONS.items():
        export(plan, kind.split()[0], root / kind, **options)
    return root


def changed(source: Path, target: Path, change: Change) -> Path:
    """Return a copy of an export with one change, and with hashes that match it."""
    shutil.copytree(source, target)
    manifest = json.loads((target / MANIFEST).read_text(encoding="utf-8"))
    change(target, manifest)
    manifest["files"] = file_hashes(target)
    (target / MANIFEST).write_text(json.dumps(manifest), encoding="utf-8")
    return target


def entry(*keys: str, value: Any) -> Change:
    """Return a change of an entry of the manifest. A function receives the present value."""

    def change(_: Path, manifest: dict[str, Any]) -> None:
        place = manifest
        for key in keys[:-1]:
            place = place[key]
        place[keys[-1]] = value(place[keys[-1]]) if callable(value) else value

    return change


def replaced(name: str, old: str, new: str) -> Change:
    def change(folder: Path, _: dict[str, Any]) -> None:
        text = (folder / name).read_text(encoding="utf-8")
        assert old in text
        (folder / name).write_text(text.replace(old, new, 1), encoding="utf-8")

    return change


def scaled(name: str, factor: float) -> Change:
    """Return a change that multiplies the last column of a table and rounds the products."""

    def change(folder: Path, _: dict[str, Any]) -> None:
        head, *rows = (folder / name).read_text(encoding="utf-8").splitlines()
        cells = [row.rpartition(",") for row in rows]
        lines = [f"{first},{round(float(last) * factor)}" for first, _, last in cells]
        (folder / name).write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")

    return change


def removed(name: str) -> Change:
    return lambda folder, _: (folder / name).unlink()


def exchanged(first: str, second: str) -> Change:
    """Return a change that exchanges the contents of two files."""

    def change(folder: Path, _: dict[str, Any]) -> None:
        a, b = ((folder / name).read_bytes() for name in (first, second))
        (folder / first).write_bytes(b)
        (folder / second).write_bytes(a)

    return change


def axes_exchanged(_: Path, manifest: dict[str, Any]) -> None:
    axes = manifest["axes"]
    axes["roll"], axes["tilt"] = axes["tilt"], axes["roll"]


def another_bag(plan: Plan) -> Change:
    def change(folder: Path, _: dict[str, Any]) -> None:
        shutil.rmtree(folder / "bag")
        export(plan, "ros2", folder.parent / "slower", rate=20.0, speed=0.5)
        shutil.copytree(folder.parent / "slower/bag", folder / "bag")

    return change


EPOS4: dict[str, Change] = {
    "positions of a time_position file": scaled("tilt_time_position.csv", 3),
    "missing time_position file": removed("tilt_time_position.csv"),
    "missing objects": removed("objects.csv"),
    "period in the manifest": entry("interpolation_period_ms", value=1),
    "period of SYNC": entry("sync", "period_ms", value=1),
    "rate": entry("rate_hz", value=1000.0),
    "period object": replaced(
        "objects.csv", "interpolation time period,10", "interpolation time period,1"
    ),
    "no receive PDOs": entry("pdo", "receive", value=[]),
    "objects of a PDO": entry("pdo", "receive", value=lambda pdos: [pdos[0], pdos[2], pdos[1]]),
    "homing at zero": entry("axes", "tilt", "homing", "home_position", "value", value=0),
    "homing method": entry("axes", "tilt", "homing", "method", "value", value=35),
    "home offset": entry("axes", "tilt", "homing", "home_offset", "value", value=1000),
    "direction": entry("axes", "tilt", "direction", value=-1),
    "rated torque": entry("axes", "tilt", "rated_torque_Nm", value=lambda x: 2 * x),
    "axes exchanged": axes_exchanged,
    "streams exchanged": exchanged("roll.csv", "tilt.csv"),
    "mode": entry("mode", value="cst"),
    "rounding": entry("axes", "tilt", "rounding", "speed", value=1.0),
    "no rounding": entry("axes", "tilt", "rounding", value={"speed": None}),
    "duration of the plan": entry("plan", "duration_s", value=lambda x: 0.1 * x),
    "stretch": entry("stretch", value=2.0),
    "rate at the end": entry("end_rate", value={"tilt": 0.05}),
    "robot": entry("robot", "sha256", value="0" * 64),
}
PVT: dict[str, Change] = {
    "start": entry("axes", "tilt", "start", value=0.0),
    "end": entry("axes", "tilt", "end", value=0.0),
    "start velocity": entry("axes", "tilt", "start_velocity", value=100.0),
    "scale of velocities": entry("axes", "tilt", "mrpm_per_inc_per_s", value=lambda x: 10 * x),
    "axes exchanged": axes_exchanged,
    "tables exchanged": exchanged("roll.csv", "tilt.csv"),
    "unit": entry("units", "time", value="s"),
    "stretch": entry("stretch", value=1.5),
    "rate at the end": entry("end_rate", value={"tilt": 1e-3}),
}
ROS2: dict[str, Change] = {
    "position of the goal": replaced("goal.yaml", "positions: [0.3", "positions: [0.2"),
    "names of the goal": replaced("goal.yaml", '"roll", "tilt"', '"tilt", "roll"'),
    "stamp of the message": replaced("joint_trajectory.yaml", "sec: 0", "sec: 9"),
    "missing goal": removed("goal.yaml"),
    "rate of the states": entry("rate_hz", value=10.0),
    "duration of the plan": entry("plan", "duration_s", value=lambda x: 1.01 * x),
}
CSV: dict[str, Change] = {
    "increments": scaled("tilt_time_position.csv", 3),
    "torques": replaced("trajectory.csv", ",motor1_torque_Nm,motor2", ",motor2_torque_Nm,motor1"),
    "rate": entry("rate_hz", value=1000.0),
    "duration of the plan": entry("plan", "duration_s", value=lambda x: 1.01 * x),
}


def cell(row: int, column: int, change: Callable[[float], float]) -> Change:
    """Return a change of one number in the table of stops. Rows are counted from the end."""

    def changed(folder: Path, _: dict[str, Any]) -> None:
        rows = (folder / "stops.csv").read_text(encoding="utf-8").splitlines()
        cells = rows[-row].split(",")
        cells[column] = f"{change(float(cells[column])):.12g}"
        rows[-row] = ",".join(cells)
        (folder / "stops.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")

    return changed


def one_stop_less(folder: Path, _: dict[str, Any]) -> None:
    """Remove the rows of the first stop."""
    rows = (folder / "stops.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    begins = [row.split(",")[0] for row in rows[1:]]
    remaining = [row for row, start in zip(rows[1:], begins, strict=True) if start != begins[0]]
    (folder / "stops.csv").write_text(rows[0] + "".join(remaining), encoding="utf-8")


STOPS: dict[str, Change] = {
    "no stop from one instant": one_stop_less,
    "last row": cell(1, 3, lambda x: 1.001 * x),
    "jump": cell(20, 3, lambda x: 1.01 * x),
    "other joint": cell(12, 2, lambda x: x + 40),
    "time": cell(9, 1, lambda x: x + 2e-3),
    "end a little later": cell(1, 1, lambda x: x + 2e-3),
    "instant": cell(7, 0, lambda x: x + 0.1),
    "no rows": lambda folder, _: (folder / "stops.csv").write_text("from_s,time_s\n"),
    "number of instants": entry("stops", "instants", value=8),
    "longest": entry("stops", "longest_s", value=lambda x: 1.1 * x),
    "farthest": entry("stops", "farthest_m", value=lambda x: 0.9 * x),
    "name of the file": entry("stops", "file", value="objects.csv"),
    "no entry": lambda _, manifest: manifest.pop("stops"),
    "only its name": entry("stops", value="stops.csv"),
    "columns": replaced("stops.csv", "roll_", "tilt_"),
}
CASES = [
    (kind, name, change)
    for kind, cases in (
        ("epos4", EPOS4),
        ("pvt", PVT),
        ("ros2", ROS2),
        ("csv", CSV),
        ("csv with stops", STOPS),
        ("epos4 with stops", {name: STOPS[name] for name in STOPS if "est" not in name}),
    )
    for name, change in cases.items()
]


@pytest.mark.parametrize("kind", OPTIONS)
def test_healthy_folders_agree(exports: Path, robot: Robot, kind: str) -> None:
    reading = read_trajectory(exports / kind, robot)
    assert reading.trajectory.duration > 1


@pytest.mark.parametrize(("kind", "name", "change"), CASES, ids=[f"{k}: {n}" for k, n, _ in CASES])
def test_a_change_is_found_although_the_hashes_fit(
    exports: Path, tmp_path: Path, robot: Robot, kind: str, name: str, change: Change
) -> None:
    folder = changed(exports / kind, tmp_path / "x", change)
    try:
        reading = read_trajectory(folder, robot)
    except TrajectoryError:
        return
    certificate = reading.check(robot, reading.add_declared_rates(TaskLimits(robot.limits)))
    assert certificate.verdict == "violated"


def test_a_changed_bag_is_found(exports: Path, tmp_path: Path, plan: Plan, robot: Robot) -> None:
    pytest.importorskip("rosbags", reason="the package rosbags (extra ros2) reads bags")
    folder = changed(exports / "ros2", tmp_path / "x", another_bag(plan))
    with pytest.raises(TrajectoryError, match="bag"):
        read_trajectory(folder, robot)


def test_explanations_may_change(exports: Path, tmp_path: Path, robot: Robot) -> None:
    """A change of explanatory texts is accepted, because they do not affect a drive."""

    def change(folder: Path, manifest: dict[str, Any]) -> None:
        manifest["notes"] = ["other words"]
        manifest["sync"]["note"] = "other words"
        manifest["axes"]["tilt"]["homing"]["convention"] = "other words"
        manifest["axes"]["tilt"]["encoder"] = "other words"
        path = folder / "objects.csv"
        path.write_text(path.read_text(encoding="utf-8").replace("quoted", "confirmed"), "utf-8")

    folder = changed(exports / "epos4", tmp_path / "x", change)
    assert read_trajectory(folder, robot).trajectory.duration > 1


@pytest.mark.parametrize("texts", [(",5", "0.001,5"), ("1.5 2.5", "1.5 "), ("", "0.5")])
def test_texts_with_other_numbers_of_numbers_differ(texts: tuple[str, str]) -> None:
    assert first_difference(*texts, "row") is not None
    assert first_difference(*texts[::-1], "row") is not None
