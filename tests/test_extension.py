"""Kinds of drives and export formats: the examples of docs/architecture.md, and registries."""

from __future__ import annotations

import inspect
import json
import logging
import re
import shutil
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml

from ssm_planner.errors import ProblemError
from ssm_planner.formats.format import FORMATS
from ssm_planner.loading.load import load_drive
from ssm_planner.problem.transmissions import TRANSMISSIONS
from ssm_planner.registry import Registry
from tests.extension import polynomials, rack
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
    """A folder in which a package with a drive and a format is installed."""
    folder = tmp_path / "site"
    info = folder / "acme-1.0.dist-info"
    info.mkdir(parents=True)
    for name in ("rack.py", "polynomials.py"):
        shutil.copy(EXAMPLES / name, folder)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[ssm_planner.drives]\nrack = rack:Rack\n"
        "[ssm_planner.formats]\npolynomials = polynomials:POLYNOMIALS\n"
    )
    return folder


def problem_with_a_rack(folder: Path) -> Path:
    """The shipped problem without gears, whose slide hangs on a rack instead of a cable."""
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
    """Every command knows both, and a rack moves like a cable on a pulley of its diameter."""
    problem = problem_with_a_rack(tmp_path)
    installed = environment(PYTHONPATH=f"{ROOT}:{site}")

    def command(*words: object, status: int = 0) -> str:
        done = python("-m", "ssm_planner", *words, cwd=tmp_path, env=installed)
        assert done.returncode == status, done.stdout + done.stderr
        return done.stdout + done.stderr

    plans = {}
    for kind, key in (("rack", "pinion"), ("cable_slide", "pulley")):
        text = (tmp_path / "rack.yaml").read_text(encoding="utf-8")
        text = re.sub(r"kind: \w+", f"kind: {kind}", text)
        text = re.sub(r"\w+_diameter", f"{key}_diameter", text)
        (tmp_path / "rack.yaml").write_text(text, encoding="utf-8")
        command("plan", problem, "-o", tmp_path / kind)
        plans[kind] = json.loads((tmp_path / kind / "plan.json").read_text(encoding="utf-8"))
    assert plans["rack"]["duration"] == plans["cable_slide"]["duration"] > 0
    assert plans["rack"]["problem"]["robot"]["joints"][3]["drive"]["kind"] == "rack"

    folder = tmp_path / "out"
    command("check", tmp_path / "rack")
    assert "a rack drive does not lock itself" in " ".join(plans["rack"]["notes"])
    assert "insertion" in command("size", tmp_path / "rack")
    words = "--to", "polynomials", "-o", folder, "--compressed", "yes"
    command("export", tmp_path / "rack", *words)
    assert "polynomials" in command("check", folder, "--robot", tmp_path / "robot.yaml")
    assert '"const": "rack"' in command("schema", "drive")
    assert "pinion_diameter" in command("schema", "drive")
    assert "polynomials" in command("export", "--help")


def test_without_the_package_its_drive_and_format_are_refused(tmp_path: Path) -> None:
    drive = shipped("drives/direct_drive_capstan.yaml").replace("cable_slide", "rack")
    (tmp_path / "rack.yaml").write_text(drive, encoding="utf-8")
    with pytest.raises(ProblemError, match="kind = rack: unknown kind of drive") as refused:
        load_drive(tmp_path / "rack.yaml")
    assert refused.value.line == 3
    assert refused.value.allowed == ", ".join(TRANSMISSIONS)


@pytest.mark.parametrize("module", [rack, polynomials])
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
