"""Every export has a manifest that describes its files. Only plans that pass the check are exported
as verified, and a failed export leaves no partial files.
"""

from __future__ import annotations

import hashlib
import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ssm_planner.errors import ExportError, ProblemError, TrajectoryError
from ssm_planner.formats.export import export, recheck_plan
from ssm_planner.formats.format import FORMATS
from ssm_planner.formats.read import read_trajectory
from ssm_planner.plans import Plan
from ssm_planner.problem.robot import Robot
from ssm_planner.publishing import INCOMPLETE_KEY
from ssm_planner.verification.check import check
from ssm_planner.verification.stops import quickest_stops
from tests.support.cli import run
from tests.support.paths import ROOT

OPTIONS = {name: {"counts_per_turn": 4096} for name in ("epos4", "pvt")}


@pytest.mark.parametrize("to", FORMATS)
def test_every_export_carries_a_manifest(plan: Plan, tmp_path: Path, to: str) -> None:
    files, manifest = export(plan, to, tmp_path / to, **OPTIONS.get(to, {}))
    on_disk = json.loads((tmp_path / to / "manifest.json").read_text(encoding="utf-8"))
    assert on_disk == json.loads(json.dumps(manifest))
    assert manifest["verified"] is True
    assert manifest["kind"] == to
    assert manifest["plan"]["sha256"] == hashlib.sha256(plan.path.read_bytes()).hexdigest()
    assert manifest["certificate"]["passed"] is True
    assert {"ssm-planner", "casadi", "numpy"} <= set(manifest["software"])
    assert manifest["units"]
    assert "rate_hz" in manifest
    assert len(manifest["robot"]["sha256"]) == 64
    assert set(files) == {*manifest["files"], "manifest"}
    for name, digest in manifest["files"].items():
        assert hashlib.sha256((tmp_path / to / name).read_bytes()).hexdigest() == digest
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


@pytest.mark.parametrize("to", ["csv", "epos4"])
def test_stops_lie_beside_the_plan_one_after_the_other(plan: Plan, tmp_path: Path, to: str) -> None:
    """Each stop leads from the state of the motion to rest, with a row for each millisecond.

    Only exports for the EPOS4 contain increments.
    """
    _, manifest = export(plan, to, tmp_path, stops=6, **OPTIONS.get(to, {}))
    rows = np.loadtxt(tmp_path / "stops.csv", delimiter=",", skiprows=1)
    names = (tmp_path / "stops.csv").read_text(encoding="utf-8").splitlines()[0].split(",")
    axes = manifest.get("axes", {})
    scales = [axes.get(j.name, {}).get("increments_per_unit") for j in plan.robot.joints]
    units = [
        "inc" if scale else ("m" if joint.kind == "prismatic" else "rad")
        for joint, scale in zip(plan.robot.joints, scales, strict=True)
    ]
    assert units.count("inc") == (3 if to == "epos4" else 0)
    joints = [f"{j.name}_{unit}" for j, unit in zip(plan.robot.joints, units, strict=True)]
    assert names == ["from_s", "time_s", *joints]
    expected = quickest_stops(plan.motion, plan.robot, 6)
    stops = [stop for stop in expected.motions if stop is not None]
    starts = np.flatnonzero(rows[:, 1] == 0.0)
    parts = np.split(rows, starts[1:])
    assert len(parts) == len(stops) == 4  # The motion rests at both ends.
    for part, stop, start in zip(parts, stops, expected.time[1:], strict=False):
        assert part[:, 0] == pytest.approx(start, abs=1e-6)
        assert part[-1, 1] == pytest.approx(stop.duration, abs=1e-6)
        assert np.diff(part[:-1, 1]) == pytest.approx(1e-3)
        assert part[-1, 1] - part[-2, 1] <= 1e-3 + 1e-6
        exact = stop.sample(np.minimum(part[:, 1], stop.duration)).q
        for i, scale in enumerate(scales):
            column = part[:, 2 + i] / (scale or 1.0)
            assert column == pytest.approx(exact[:, i], abs=0.51 / abs(scale) if scale else 1e-8)
            assert scale is None or np.array_equal(part[:, 2 + i], np.round(part[:, 2 + i]))
    stated = manifest["stops"]
    assert (stated["file"], stated["instants"]) == ("stops.csv", 6)
    assert stated["longest_s"] == pytest.approx(expected.duration.max())
    assert stated["farthest_m"] == pytest.approx(expected.travel.max())
    assert "stops.csv" in manifest["files"]


@pytest.mark.parametrize(
    ("to", "stops", "fault"),
    [
        ("pvt", 5, "stops is not an option of the pvt export"),
        ("csv", 0, "stops = 0 is out of range .allowed: 1 or more"),
        ("epos4", -1, "stops = -1 is out of range"),
    ],
)
def test_stops_that_cannot_be_exported(
    plan: Plan, tmp_path: Path, to: str, stops: int, fault: str
) -> None:
    with pytest.raises(ExportError, match=fault):
        export(plan, to, tmp_path / "x", stops=stops, **OPTIONS.get(to, {}))


@pytest.mark.parametrize("force", [False, True])
def test_a_slower_export_is_the_slower_motion_with_a_certificate_of_its_own(
    plan: Plan, bad_plan: Plan, robot: Robot, tmp_path: Path, force: bool
) -> None:
    """The slower motion of a plan that exceeds its limits by 1 % passes the check, but its export
    is still not verified.
    """
    source = bad_plan if force else plan
    _, manifest = export(source, "csv", tmp_path, force=force, speed=0.5)
    assert manifest["speed"] == 0.5
    assert manifest["verified"] is not force
    assert manifest["certificate"]["passed"] is True
    assert manifest["plan"]["sha256"] == source.sha256
    assert manifest["plan"]["file"] == source.path.name
    assert manifest["plan"]["duration_s"] == pytest.approx(2 * source.motion.duration)
    reading = read_trajectory(tmp_path, robot)
    t = np.linspace(0.0, source.motion.duration, 200)
    slower, original = reading.trajectory.sample(2 * t), source.motion.sample(t)
    assert slower.q == pytest.approx(original.q, abs=1e-6)
    assert slower.qd == pytest.approx(original.qd / 2, abs=1e-4)
    _, complete = export(plan, "csv", tmp_path / "whole")
    assert "speed" not in complete
    for speed in (0.0, 1.5):
        with pytest.raises(ProblemError, match="speed"):
            export(plan, "csv", tmp_path / "x", speed=speed)


def test_rates_at_the_ends_are_slower_too_and_are_read_back(
    plan: Plan, robot: Robot, tmp_path: Path
) -> None:
    ends = {"start_rate": {"tilt": 0.02}, "end_rate": {"depth": -1e-3, "roll": 0.01}}
    moving = replace(plan, problem=replace(plan.problem, **ends))
    files, manifest = export(moving, "csv", tmp_path, force=True, speed=0.5)
    for key, rates in ends.items():
        assert manifest[key] == pytest.approx({name: rate / 2 for name, rate in rates.items()})
    reading = read_trajectory(tmp_path, robot)
    assert (reading.start_rate, reading.end_rate) == (manifest["start_rate"], manifest["end_rate"])
    for key in ends:
        for wrong in (3, ["tilt"], {"elbow": 1.0}, {"tilt": "1"}, {"tilt": True}, {"tilt": 1e3}):
            changed = json.dumps({**manifest, key: wrong})
            files["manifest"].write_text(changed, encoding="utf-8")
            with pytest.raises(TrajectoryError, match=f"{key}.* is not a "):
                read_trajectory(tmp_path, robot)
        fine = {**manifest, key: {"tilt": -999.0, "spin": 1}}
        files["manifest"].write_text(json.dumps(fine), encoding="utf-8")
        assert getattr(read_trajectory(tmp_path, robot), key) == {"tilt": -999.0, "spin": 1.0}


def test_a_manifest_that_does_not_fit_its_folder_is_refused(
    plan: Plan, robot: Robot, tmp_path: Path
) -> None:
    files, manifest = export(plan, "csv", tmp_path)
    (name,) = (name for name in manifest["files"] if name.endswith(".csv"))
    digest = manifest["files"][name]
    for changes, message in (
        ({"format": "another"}, "not the manifest of an export"),
        ({"files": None}, "list of files with their SHA-256 is missing"),
        ({INCOMPLETE_KEY: True}, "was interrupted"),
        ({"files": {**manifest["files"], "none.csv": digest}}, "the file is missing"),
        ({"files": {**manifest["files"], name: digest[::-1]}}, "was modified after"),
        ({"files": {"/tmp/x": digest}}, "is not the name of a file"),
        ({"files": {"a/../../x": digest}}, "is not the name of a file"),
        ({"files": {"a\\b": digest}}, "is not the name of a file"),
        ({"files": {"": digest}}, "is not the name of a file"),
        ({"files": {}}, "is not in the list of files"),
        ({"trajectory": None}, "trajectory is None, but the motion gives"),
    ):
        files["manifest"].write_text(json.dumps({**manifest, **changes}), encoding="utf-8")
        with pytest.raises(TrajectoryError, match=message):
            read_trajectory(tmp_path, robot)
    files["manifest"].write_text(json.dumps(manifest), encoding="utf-8")
    assert read_trajectory(tmp_path, robot).trajectory.duration > 0


@pytest.mark.parametrize("to", FORMATS)
def test_a_plan_without_a_passed_certificate_is_not_exported(
    bad_plan: Plan, tmp_path: Path, to: str
) -> None:
    with pytest.raises(ExportError, match=r"does not pass the check: .* by 1"):
        export(bad_plan, to, tmp_path / to, **OPTIONS.get(to, {}))
    assert not list(tmp_path.iterdir())
    files, manifest = export(bad_plan, to, tmp_path / to, force=True, **OPTIONS.get(to, {}))
    assert manifest["verified"] is False
    assert "UNVERIFIED" in manifest["warning"]
    named = [name for name in files if name != "manifest"]
    assert all("_unverified" in name for name in named)
    texts = [
        files[name].read_text(encoding="utf-8")
        for name in named
        if name.endswith((".yaml", ".urdf", ".c", ".h"))
    ]
    assert all("UNVERIFIED" in text for text in texts if "rosbag2_bagfile_information" not in text)


def test_a_certificate_that_somebody_wrote_in_does_not_open_the_door(
    bad_plan: Plan, tmp_path: Path
) -> None:
    """The plan is checked again, whatever its file states."""
    document = json.loads(bad_plan.path.read_text(encoding="utf-8"))
    document["certificate"]["passed"] = True
    for limit in document["certificate"]["limits"]:
        limit["margin"] = 1.0
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(ExportError, match="does not pass the check"):
        export(path, "csv", tmp_path / "csv")


def test_a_plan_that_was_never_checked_is_not_exported(plan: Plan, tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    path.write_text(json.dumps({**plan.to_dict(), "certificate": None}), encoding="utf-8")
    with pytest.raises(ExportError, match="has no certificate"):
        export(path, "csv", tmp_path / "csv")
    _, manifest = export(path, "csv", tmp_path / "csv", force=True)
    assert manifest["verified"] is False


def test_unknown_formats_and_options(plan: Plan, tmp_path: Path) -> None:
    with pytest.raises(ExportError, match=r"unknown export format .*csv, epos4"):
        export(plan, "dxf", tmp_path / "x")
    with pytest.raises(ExportError, match="mode is not an option of the csv export"):
        export(plan, "csv", tmp_path / "x", mode="csp")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("to", ["csv", "epos4", "ros2"])
@pytest.mark.parametrize("which", ["plan", "smooth_plan"])
def test_round_trip(
    to: str, which: str, request: pytest.FixtureRequest, robot: Robot, tmp_path: Path
) -> None:
    """After export and reading, the check has the same verdict and margins, within the rounding."""
    source: Plan = request.getfixturevalue(which)
    export(source, to, tmp_path / to, **OPTIONS.get(to, {}))
    readings = [read_trajectory(tmp_path / to, robot)]
    if to == "ros2":
        readings += [read_trajectory(tmp_path / to / name, robot) for name in ("goal.yaml", "bag")]
    original = {(limit.name, limit.joint): limit.margin for limit in source.certificate.limits}
    for reading in readings:
        result = check(
            reading.trajectory,
            robot,
            source.limits,
            resolution=reading.resolution,
            interpolation=reading.interpolation,
        )
        assert result.verdict == ("not judged" if to == "epos4" else "kept")
        compared = 0
        for limit in result.limits:
            if limit.name.endswith("jump") or (to == "epos4" and limit.name == "acceleration"):
                continue
            # The check judges the upper end of the torque band.
            if to == "epos4" and limit.name == "motor torque":
                assert limit.margin <= original[limit.name, limit.joint]
                continue
            compared += 1
            # Rounding to increments changes positions by up to half an increment, and speeds by up
            # to one increment per millisecond.
            allowed = 0.012 if to == "epos4" else 1e-4
            assert limit.margin == pytest.approx(original[limit.name, limit.joint], abs=allowed)
        assert compared >= (12 if to == "epos4" else 20)


def test_an_existing_export_is_replaced_and_other_files_stay(plan: Plan, tmp_path: Path) -> None:
    target = tmp_path / "csv"
    export(plan, "csv", target, rate=100.0)
    (target / "notes.txt").write_text("mine", encoding="utf-8")
    first = (target / "trajectory.csv").read_bytes()
    _, manifest = export(plan, "csv", target, rate=50.0)
    assert (target / "trajectory.csv").read_bytes() != first
    assert (target / "notes.txt").read_text(encoding="utf-8") == "mine"
    assert "notes.txt" not in manifest["files"]


def test_a_target_that_is_a_file_or_cannot_be_written(plan: Plan, tmp_path: Path) -> None:
    file = tmp_path / "taken"
    file.write_text("mine", encoding="utf-8")
    with pytest.raises(ExportError, match="is a file; a folder is needed"):
        export(plan, "csv", file)
    with pytest.raises(ExportError, match="cannot be written"):
        export(plan, "csv", file / "below")
    assert file.read_text(encoding="utf-8") == "mine"


def test_a_full_disk_leaves_nothing_and_what_was_there(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    export(plan, "csv", tmp_path / "csv", rate=100.0)
    before = {path.name: path.read_bytes() for path in (tmp_path / "csv").iterdir()}

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("ssm_planner.formats.csv.table_text", full)
    with pytest.raises(ExportError, match="No space left on device"):
        export(plan, "csv", tmp_path / "csv", rate=50.0)
    assert {path.name: path.read_bytes() for path in (tmp_path / "csv").iterdir()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["csv"]


@pytest.mark.parametrize("module", ["csv", "epos4", "pvt", "ros2"])
def test_an_interruption_midway_leaves_nothing(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str
) -> None:
    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    def after(count: int, function: Callable) -> Callable:
        calls = [0]

        def wrapped(*words: object, **options: object) -> object:
            calls[0] += 1
            return stop() if calls[0] > count else function(*words, **options)

        return wrapped

    # The interruption comes after the first of several files, or during the check of a single file.
    place, count = {
        "csv": ("_interpolation_notes", 0),
        "epos4": ("table_text", 2),
        "pvt": ("table_text", 2),
        "ros2": ("yaml_text", 1),
    }[module]
    target = f"ssm_planner.formats.{module}"
    monkeypatch.setattr(f"{target}.{place}", after(count, getattr(import_module(target), place)))
    with pytest.raises(KeyboardInterrupt):
        export(plan, module, tmp_path / module, **OPTIONS.get(module, {}))
    assert not list(tmp_path.iterdir())


def test_sigint_during_the_command(plan: Plan, tmp_path: Path) -> None:
    """SIGINT stops the command while it writes.

    The result is a message, the exit status 130 and no file.
    """
    code = (
        "import sys, time; from ssm_planner.formats import csv; text = csv.table_text\n"
        "def slow(*a):\n"
        "    yield from text(*a); print('writing', flush=True); time.sleep(30)\n"
        "csv.table_text = slow\n"
        "from ssm_planner.cli import main; sys.exit(main(sys.argv[1:]))"
    )
    words = ["export", str(plan.path), "--to", "csv", "-o", str(tmp_path / "csv")]
    with subprocess.Popen(
        [sys.executable, "-c", code, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "writing\n"
        time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=20)
    assert process.returncode == 130
    assert "interrupted" in errors
    assert "Traceback" not in errors
    assert not list(tmp_path.iterdir())


def test_the_commands(
    plan: Plan, bad_plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The commands accept a plan that passes the check, and mark or refuse a plan that does not."""
    out = tmp_path / "csv"
    assert run("export", plan.path, "--to", "csv", "-o", out, "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert Path(printed["files"]["trajectory.csv"]).is_file()
    robot = str(ROOT / "problems/robots/vitreoretinal.yaml")
    assert run("check", out, "--robot", robot, "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert document["passed"] is True
    assert {"name", "joint", "worst", "limit", "margin", "time"} <= set(document["limits"][0])
    assert run("check", plan.path) == 0
    assert "check: PASSED" in capsys.readouterr().out
    assert run("check", bad_plan.path) == 1
    assert "EXCEEDED" in capsys.readouterr().out
    words = [
        str(bad_plan.path),
        "--to",
        "epos4",
        "-o",
        str(tmp_path / "e"),
        "--force",
        "--counts-per-turn",
        "4096",
    ]
    assert run("export", *words) == 0
    assert "UNVERIFIED" in capsys.readouterr().out


@pytest.mark.parametrize("words", [["--rate", "-5"], ["--rate", "fast"], ["--to", "dxf"]])
def test_bad_words_on_the_command_line(
    plan: Plan, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        run("export", plan.path, "--to", "csv", *words)
    assert caught.value.code == 2
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize("counts", [["many"], ["4096", "roll=1024"], ["roll="]])
def test_bad_counts_on_the_command_line(plan: Plan, tmp_path: Path, counts: list[str]) -> None:
    with pytest.raises(ExportError, match="--counts-per-turn"):
        run("export", plan.path, "--to", "epos4", "-o", tmp_path, "--counts-per-turn", *counts)


def test_an_export_at_a_lower_speed_is_the_slower_motion(plan: Plan, tmp_path: Path) -> None:
    _, manifest = export(plan, "csv", tmp_path / "slow", speed=0.5)
    assert manifest["speed"] == 0.5
    _, normal = export(plan, "csv", tmp_path / "normal")
    assert "speed" not in normal
    slow, fast = (
        read_trajectory(tmp_path / name, plan.robot).trajectory for name in ("slow", "normal")
    )
    assert slow.duration == pytest.approx(2 * fast.duration)
    t = np.linspace(0.0, fast.duration, 50)
    assert slow.sample(2 * t).q == pytest.approx(fast.sample(t).q, abs=1e-9)
    assert slow.sample(2 * t).qd == pytest.approx(fast.sample(t).qd / 2, abs=1e-6)


def test_a_verified_manifest_has_no_warning_and_one_entry_a_line(
    plan: Plan, tmp_path: Path
) -> None:
    files, manifest = export(plan, "urdf", tmp_path)
    assert "warning" not in manifest
    assert (manifest["start_rate"], manifest["end_rate"]) == ({}, {})
    lines = files["manifest"].read_text(encoding="utf-8").splitlines()
    depth = {line.split(":")[0].strip(): len(line) - len(line.lstrip()) for line in lines}
    assert depth['"format"'] < depth['"sha256"']
    assert len(lines) > len(manifest)


def test_one_stop_can_be_exported(plan: Plan, tmp_path: Path) -> None:
    """The motion rests at the first instant, so the file has no rows."""
    _, manifest = export(plan, "csv", tmp_path, stops=1)
    assert manifest["stops"]["instants"] == 1
    assert (tmp_path / "stops.csv").read_text(encoding="utf-8").startswith("from_s,time_s,roll_rad")


@pytest.mark.parametrize(
    ("to", "options"),
    [
        ("csv", {}),
        ("csv", {"rate": 200.0, "columns": ["q"]}),
        ("csv", {"rate": 1000.0}),
        ("csv", {"columns": ["task"]}),
        ("epos4", {"counts_per_turn": 4096, "rate": 10.0}),
        ("epos4", {"counts_per_turn": 65536}),
    ],
)
@pytest.mark.parametrize("count", [1, 2, 40])
def test_stops_of_a_healthy_folder_are_accepted(
    plan: Plan, tmp_path: Path, to: str, options: dict[str, Any], count: int
) -> None:
    """The check accepts the stops of an unchanged export. It evaluates their limits if the table
    contains only positions.
    """
    export(plan, to, tmp_path, stops=count, **options)
    if "task" in options.get("columns", ()) or options.get("rate") == 1000:
        # A table without joints has no motion. Rows at 1000 Hz exceed a limit between them.
        return
    reading = read_trajectory(tmp_path, plan.robot)
    certificate = reading.check(plan.robot, reading.add_declared_rates(plan.limits))
    assert not certificate.violations
    played = [line for line in certificate.limits if line.name == "controlled stop"]
    assert len(played) == (count > 2 and reading.resolution is not None)


def test_stops_have_no_negative_zero(plan: Plan, tmp_path: Path) -> None:
    export(plan, "epos4", tmp_path, stops=4, counts_per_turn=4)
    text = (tmp_path / "stops.csv").read_text(encoding="utf-8")
    assert ",-0," not in text
    for line in text.splitlines()[1:]:
        roll, tilt, _, insertion = line.split(",")[2:]
        assert all(str(int(count)) == count for count in (roll, tilt, insertion))


@pytest.mark.parametrize("stored", ["none", "failed"])
def test_the_message_says_what_the_stored_certificate_lacks(
    plan: Plan, tmp_path: Path, stored: str
) -> None:
    assert plan.certificate is not None
    failed = replace(plan.certificate, limits=(replace(plan.certificate.limits[0], margin=-0.5),))
    changed = SimpleNamespace(
        motion=plan.motion, robot=plan.robot, limits=plan.limits, path=plan.path,
        certificate=None if stored == "none" else failed, uncertified_reason=None,
    )  # fmt: skip
    reason = {"none": "has no certificate", "failed": "has a certificate that did not pass"}[stored]
    with pytest.raises(ExportError, match=f"the plan {reason}: plan again, or use --force"):
        recheck_plan(changed, force=False)  # type: ignore[arg-type]
    assert recheck_plan(changed, force=True)[1] is False  # type: ignore[arg-type]


def test_the_message_states_the_worst_excess_of_the_plan(bad_plan: Plan) -> None:
    worst = check(bad_plan.motion, bad_plan.robot, bad_plan.limits).worst
    with pytest.raises(ExportError) as caught:
        recheck_plan(bad_plan, force=False)
    stated = re.search(r"exceeds the (.+) limit of (\S+) by (\S+) % at (\S+) s", str(caught.value))
    assert stated is not None
    assert stated.group(1, 2) == (worst.name, worst.joint)
    assert float(stated.group(3)) == pytest.approx(-100 * worst.margin, rel=1e-2)
    assert float(stated.group(4)) == pytest.approx(worst.time, abs=1e-4)


@pytest.mark.parametrize("to", FORMATS)
def test_files_of_a_verified_plan_carry_no_mark(plan: Plan, tmp_path: Path, to: str) -> None:
    files, manifest = export(plan, to, tmp_path, **OPTIONS.get(to, {}))
    assert not any("unverified" in name for name in manifest["files"])
    assert not any(b"UNVERIFIED" in path.read_bytes() for path in files.values())
