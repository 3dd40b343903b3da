"""Packages can add kinds of drives, motions and export formats.

The tests use the examples of docs/architecture.md as such packages. They also test the registries.
"""

from __future__ import annotations

import inspect
import json
import logging
import re
import shutil
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import yaml

from ssm_planner.errors import ProblemError
from ssm_planner.formats.format import FORMATS
from ssm_planner.loading import motions
from ssm_planner.loading.load import load_drive, load_problem
from ssm_planner.loading.motions import MotionKey
from ssm_planner.problem.transmissions import TRANSMISSIONS
from ssm_planner.registry import Registry
from tests.extension import polynomials, rack, swing
from tests.support.cli import environment, python
from tests.support.paths import ROOT

EXAMPLES = ROOT / "tests/extension"
PULLEY = "geometry: {pulley_diameter: {value: 10 mm, placeholder: true}}"


class Thing(NamedTuple):
    name: str


def shipped(place: str) -> str:
    return (ROOT / "problems" / place).read_text(encoding="utf-8")


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """Return a folder in which a package with a drive, a motion and a format is installed."""
    folder = tmp_path / "site"
    info = folder / "acme-1.0.dist-info"
    info.mkdir(parents=True)
    for name in ("rack.py", "swing.py", "polynomials.py"):
        shutil.copy(EXAMPLES / name, folder)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[ssm_planner.drives]\nrack = rack:Rack\n"
        "[ssm_planner.motions]\nswing = swing:SWING\n"
        "[ssm_planner.formats]\npolynomials = polynomials:POLYNOMIALS\n"
    )
    return folder


RUN_EACH = """
import contextlib, io, json, sys
from ssm_planner.cli import main

printed = []
for words in json.load(sys.stdin):
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            status = main(words)
        except SystemExit as end:
            status = end.code or 0
    printed.append((status, said.getvalue()))
json.dump(printed, sys.stdout)
"""
WITHOUT_FIGURES = """
from ssm_planner.reporting.figures import process

process._start_process = lambda: None
process.write_figures = lambda *_: {}
"""


class Commands(NamedTuple):
    """A folder for commands that run in a process in which the package is installed."""

    site: Path
    folder: Path

    def run(self, *commands: tuple[object, ...], figures: bool = True) -> list[str]:
        """Run the commands one after the other and return the text that each of them printed."""
        program = RUN_EACH if figures else WITHOUT_FIGURES + RUN_EACH
        installed = environment(PYTHONPATH=f"{ROOT}:{self.site}")
        words = json.dumps([[str(word) for word in command] for command in commands])
        done = python("-c", program, cwd=self.folder, env=installed, input=words)
        assert done.returncode == 0, done.stderr
        printed = json.loads(done.stdout)
        assert [status for status, _ in printed] == [0] * len(commands), printed
        return [said for _, said in printed]


def problem_with_a_rack(folder: Path) -> Path:
    """Write the shipped problem without gears, but with a rack, and return its file.

    The rack replaces the cable of the insertion.
    """
    drive = shipped("drives/direct_drive_capstan.yaml").replace("cable_slide", "rack")
    assert PULLEY in drive
    drive = drive.replace("pulley_diameter", "pinion_diameter")
    (folder / "rack.yaml").write_text(drive, encoding="utf-8")
    robot = yaml.safe_load(shipped("robots/direct_drive.yaml"))
    for joint in robot["joints"].values():
        for key in ("drive", "motor"):
            joint[key] = str((ROOT / "problems/robots" / joint[key]).resolve())
    robot["joints"]["insertion"]["drive"] = "rack.yaml"
    (folder / "robot.yaml").write_text(yaml.safe_dump(robot), encoding="utf-8")
    problem = yaml.safe_load(shipped("direct_reach.yaml")) | {"robot": "robot.yaml"}
    problem["motion"] = problem["motion"][:1]
    file = folder / "reach.yaml"
    file.write_text(yaml.safe_dump(problem), encoding="utf-8")
    return file


@pytest.mark.slow
def test_an_installed_package_adds_a_drive_and_a_format(site: Path, tmp_path: Path) -> None:
    """Every command knows the drive and the format of an installed package.

    A rack moves like a cable on a pulley with the diameter of the pinion.
    """
    problem = problem_with_a_rack(tmp_path)
    command = Commands(site, tmp_path)
    plans = {}
    for kind, key in (("cable_slide", "pulley"), ("rack", "pinion")):
        text = (tmp_path / "rack.yaml").read_text(encoding="utf-8")
        text = re.sub(r"kind: \w+", f"kind: {kind}", text)
        text = re.sub(r"\w+_diameter", f"{key}_diameter", text)
        (tmp_path / "rack.yaml").write_text(text, encoding="utf-8")
        command.run(("plan", problem, "-o", tmp_path / kind), figures=kind == "rack")
        plans[kind] = json.loads((tmp_path / kind / "plan.json").read_text(encoding="utf-8"))
    assert plans["rack"]["duration"] == plans["cable_slide"]["duration"] > 0
    assert plans["rack"]["problem"]["robot"]["joints"][3]["drive"]["kind"] == "rack"

    folder = tmp_path / "out"
    assert "a rack drive does not lock itself" in " ".join(plans["rack"]["notes"])
    said = command.run(
        ("check", tmp_path / "rack"),
        ("size", tmp_path / "rack"),
        ("export", tmp_path / "rack", "--to", "polynomials", "-o", folder, "--compressed", "yes"),
        ("check", folder, "--robot", tmp_path / "robot.yaml"),
        ("schema", "drive"),
        ("export", "--help"),
    )
    assert "insertion" in said[1]
    assert "polynomials" in said[3]
    assert '"const": "rack"' in said[4]
    assert "pinion_diameter" in said[4]
    assert "polynomials" in said[5]


def test_without_the_package_its_drive_and_format_are_refused(tmp_path: Path) -> None:
    drive = shipped("drives/direct_drive_capstan.yaml").replace("cable_slide", "rack")
    (tmp_path / "rack.yaml").write_text(drive, encoding="utf-8")
    with pytest.raises(ProblemError, match="kind = rack: unknown kind of drive") as refused:
        load_drive(tmp_path / "rack.yaml")
    assert refused.value.line == 3
    assert refused.value.allowed == ", ".join(TRANSMISSIONS)


WORDS = "swing: {low: -120 deg, high: -100 deg, times: 2}"


@pytest.mark.slow
def test_an_installed_package_adds_a_motion(site: Path, tmp_path: Path) -> None:
    """A motion of an installed package is planned exactly like the motions that it stands for.

    The plan is checked and exported without the package. The schema describes the motion.
    """
    command = Commands(site, tmp_path)
    tilts = "\n".join(f"  - tilt: {{to: {tilt} deg}}" for tilt in (-120, -100, -120, -100))
    for name, motion in (("swing", f"  - {WORDS}"), ("tilts", tilts)):
        text = shipped("tilt_insert.yaml").replace("robots/", f"{ROOT}/problems/robots/")
        text = re.sub(r"motion:\n(  - .*\n)+", f"motion:\n{motion}\n", text)
        (tmp_path / f"{name}.yaml").write_text(text, encoding="utf-8")
    *_, schema = command.run(
        ("plan", tmp_path / "swing.yaml", "-o", tmp_path / "swing"),
        ("plan", tmp_path / "tilts.yaml", "-o", tmp_path / "tilts"),
        ("schema", "problem"),
        figures=False,
    )
    plans = [
        json.loads((tmp_path / name / "plan.json").read_text(encoding="utf-8"))
        for name in ("swing", "tilts")
    ]
    assert plans[0]["trajectory"]["coefficients"] == plans[1]["trajectory"]["coefficients"]
    # These commands run without the package.
    Commands(tmp_path, tmp_path).run(
        ("check", tmp_path / "swing"),
        ("export", tmp_path / "swing", "--to", "csv", "-o", tmp_path / "out"),
    )
    assert "Motions to and fro between two tilts." in schema
    assert "Number of motions to and fro." in schema


@pytest.fixture
def with_swing(monkeypatch: pytest.MonkeyPatch) -> None:
    keys = (*motions.MOTIONS.values(), swing.SWING)
    monkeypatch.setattr(motions, "MOTIONS", Registry("nobody.provides", "motion", *keys))
    monkeypatch.setattr("ssm_planner.loading.problems.MOTIONS", motions.MOTIONS)


def problem_with(motion: str, folder: Path) -> Path:
    text = shipped("tilt_insert.yaml").replace("robots/", f"{ROOT}/problems/robots/")
    file = folder / "problem.yaml"
    file.write_text(re.sub(r"motion:\n", f"motion:\n  - {motion}\n", text), encoding="utf-8")
    return file


@pytest.mark.usefixtures("with_swing")
def test_one_entry_can_mean_several_motions(tmp_path: Path) -> None:
    problem = load_problem(problem_with(WORDS, tmp_path))
    tilts = [getattr(motion, "tilt", None) for motion in problem.motion]
    assert np.degrees(tilts[:4]).round(9).tolist() == [-120, -100, -120, -100]
    assert [motion.name for motion in problem.motion] == [*["swing"] * 4, "tilt", "insert"]
    lines = (tmp_path / "problem.yaml").read_text(encoding="utf-8").splitlines()
    assert {lines[motion.line - 1].strip() for motion in problem.motion[:4]} == {f"- {WORDS}"}


@pytest.mark.usefixtures("with_swing")
@pytest.mark.parametrize(
    ("words", "key"),
    [
        ("swing: {low: -100 deg, high: -120 deg}", "motion[0].swing.high"),
        ("swing: {low: -300 deg, high: -120 deg}", "motion[0].swing.tilt"),
        ("swing: {low: -120 deg, high: -100 deg, times: 0}", "motion[0].swing.times"),
        ("swing: {low: -120 mm, high: -100 deg}", "motion[0].swing.low"),
        ("swing: {low: -120 deg}", "motion[0].swing.high"),
        ("swing: {low: -120 deg, high: -100 deg, time: 2}", "motion[0].swing.time"),
    ],
)
def test_the_faults_of_a_motion_name_its_place_in_the_file(
    words: str, key: str, tmp_path: Path
) -> None:
    file = problem_with(words, tmp_path)
    with pytest.raises(ProblemError) as refused:
        load_problem(file)
    assert refused.value.key == key
    assert refused.value.line == 1 + file.read_text(encoding="utf-8").splitlines().index(
        f"  - {words}"
    )


@pytest.mark.usefixtures("with_swing")
def test_a_motion_after_one_entry_for_several_is_found_in_the_file(tmp_path: Path) -> None:
    file = problem_with(WORDS, tmp_path)
    text = file.read_text(encoding="utf-8").replace("insert: {to: 20 mm}", "insert: {to: 90 mm}")
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ProblemError) as refused:
        load_problem(file)
    assert refused.value.key == "motion[2].insert.to"


def test_without_the_package_its_motion_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ProblemError, match="unknown key") as refused:
        load_problem(problem_with(WORDS, tmp_path))
    assert refused.value.key == "motion[0].swing"
    assert set(motions.BUILT_IN_KEYS) < set(str(refused.value.allowed).split(", "))


def test_every_motion_is_declared_once() -> None:
    keys: list[MotionKey] = list(motions.MOTIONS.values())
    assert [key.name for key in keys] == list(motions.BUILT_IN_KEYS)
    page = (ROOT / "docs/motions.md").read_text(encoding="utf-8")
    assert all(f"`{key.name}" in page for key in keys)


@pytest.mark.parametrize("module", [rack, swing, polynomials])
def test_the_guide_shows_the_examples(module: Any) -> None:
    text = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    source = inspect.getsource(module)
    assert source.partition("annotations\n\n")[2] in text
    assert len(source.splitlines()) <= 40


def test_the_formats_declare_the_options_of_their_writers() -> None:
    for form in FORMATS.values():
        module, _, name = form.writer.partition(":")
        writer = getattr(__import__(module, fromlist=[name]), name)
        options = [name for name in form.options if name != "stops"]
        assert options == list(inspect.signature(writer).parameters)[4:]


def test_the_pages_list_every_kind_and_format() -> None:
    drives = (ROOT / "docs/drives.md").read_text(encoding="utf-8")
    formats = (ROOT / "docs/export.md").read_text(encoding="utf-8")
    assert set(TRANSMISSIONS) <= set(re.findall(r"`(?:kind: )?(\w+)`", drives))
    assert re.findall(r"^\| `(\w+)` \|", formats, re.M)[: len(FORMATS)] == list(FORMATS)


def test_a_name_is_taken_once() -> None:
    registry = Registry("nobody.provides", "thing", Thing("one"))
    assert registry.add(Thing("two")) is registry["two"]
    with pytest.raises(ValueError, match="the thing 'one' exists already"):
        registry.add(Thing("one "[:3]))
    with pytest.raises(ProblemError, match=r"unknown thing; did you mean 'two'.*one, two"):
        registry.find("twoo")
    assert registry.get("three") is None


def test_a_broken_package_costs_only_its_own_object(
    site: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (site / "acme-1.0.dist-info/entry_points.txt").write_text("[a.group]\nlost = nowhere:THING\n")
    monkeypatch.syspath_prepend(site)
    registry = Registry("a.group", "thing", Thing("one"))
    with caplog.at_level(logging.WARNING, "ssm_planner"):
        assert list(registry) == ["one"]
    assert "the thing 'lost' of another package is not available: No module" in caplog.text
