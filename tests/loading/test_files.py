"""Shipped robots, drives, motors and problems are found by name from any folder and in an installed
wheel.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

import ssm_planner
from ssm_planner.cli import main
from ssm_planner.errors import ProblemError
from ssm_planner.loading.files import shipped_files
from ssm_planner.loading.load import (
    load_drive,
    load_motor,
    load_motorisation,
    load_problem,
    load_robot,
)
from tests.support.paths import ROOT

EVERYTHING = """\
import ssm_planner as ssm
from pathlib import Path
from ssm_planner.loading.files import shipped_folder, shipped_files
assert Path(ssm.__file__).parent in shipped_folder().parents, shipped_folder()
for kind in ("problem", "robot", "drive", "motor"):
    load, names = getattr(ssm, "load_" + kind), shipped_files(kind + "s")
    assert names
    for name in names:
        load(name)
"""


def test_shipped_files_load_by_name_from_an_empty_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Shipped files are loaded by name from any folder."""
    monkeypatch.chdir(tmp_path)
    assert load_problem("tilt_insert").name == "tilt_insert"
    assert load_robot("vitreoretinal").name == "vitreoretinal"
    assert load_drive("rig3_worm").kind == "worm"
    assert load_motor("maxon_ecx_torque_22_m").nominal_torque > 0
    assert load_motorisation("paper").strokes


def test_a_file_of_that_name_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A local file takes precedence over a shipped file of the same name."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(shipped_files("motors")["rig_motor"], "maxon_ecx_torque_22_m")
    assert load_motor("maxon_ecx_torque_22_m").name == load_motor("rig_motor").name


def test_a_folder_of_that_name_does_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A local folder does not take precedence over a shipped file of the same name."""
    monkeypatch.chdir(tmp_path)
    Path("tilt_insert").mkdir()
    assert load_problem("tilt_insert").name == "tilt_insert"


def test_a_problem_file_may_name_a_shipped_robot(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    text = shipped_files("problems")["tilt_insert"].read_text(encoding="utf-8")
    file.write_text(text.replace("robots/vitreoretinal.yaml", "vitreoretinal"), encoding="utf-8")
    assert load_problem(file).robot.name == "vitreoretinal"


def test_an_unknown_name_is_answered_with_the_one_meant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        ProblemError, match=r"tilt_insret: no such file; did you mean 'tilt_insert'\?.*waypoints"
    ):
        load_problem("tilt_insret")
    assert main(["plan", "tilt_insret"]) == 2
    assert "did you mean 'tilt_insert'?" in capsys.readouterr().err
    shutil.copy(shipped_files("problems")["waypoints"], "around.yaml")
    with pytest.raises(
        ProblemError, match=r"arond\.yaml: no such file; did you mean 'around\.yaml'\?"
    ):
        load_problem("arond.yaml")


@pytest.mark.parametrize("target", ["loop.yaml", "missing.yaml"])
def test_a_link_that_leads_nowhere_is_named(target: str, tmp_path: Path) -> None:
    (tmp_path / "loop.yaml").symlink_to(target)
    with pytest.raises(ProblemError, match=r"loop\.yaml: a link that leads to no file \("):
        load_problem(tmp_path / "loop.yaml")


def test_the_tests_import_this_checkout() -> None:
    """An installation of another checkout does not win over PYTHONPATH."""
    assert Path(ssm_planner.__file__).is_relative_to(ROOT)


@pytest.mark.slow
def test_a_wheel_carries_them(tmp_path: Path) -> None:
    """An installed wheel contains the shipped files and loads each of them by name.

    The C compiler of this build fails, so the wheel has no compiled part and fits every system.
    """
    source, wheels, environment, empty = (
        tmp_path / name for name in ("source", "wheels", "environment", "empty")
    )
    source.mkdir()
    empty.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE", ".gitignore"):
        shutil.copy(ROOT / name, source)
    for name in ("ssm_planner", "problems", "examples", ".native"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    clean["CC"] = "no-such-compiler"

    def run(*command: str | Path) -> None:
        done = subprocess.run(command, cwd=empty, env=clean, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr[-2000:]

    run(sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "-w", wheels, source)
    run(sys.executable, "-m", "venv", "--without-pip", environment)
    python = next(environment.glob("*/python"))
    packages = next(environment.rglob("site-packages"))
    (wheel,) = wheels.glob("*-py3-none-any.whl")
    run(sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", packages, wheel)
    (packages / "dependencies.pth").write_text(
        sysconfig.get_path("purelib") + "\n", encoding="utf-8"
    )
    run(python, "-I", "-c", EVERYTHING)
    run(python, "-I", "-m", "ssm_planner", "check", ROOT / "results/tilt_insert", "--proof")
    assert (packages / "ssm_planner/checker/prove.py").is_file()
    assert not (packages / "ssm_planner/paper_reproduction").exists()
