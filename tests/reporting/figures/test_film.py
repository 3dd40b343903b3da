"""The film lasts as long as the motion and shows the mechanism where the kinematics places it.

A missing encoder is reported.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

from ssm_planner import film, fk, load_plan
from ssm_planner.cli import main
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.reporting.figures.film import PROJECTION, project_mechanism
from ssm_planner.reporting.figures.workspace import great_circle_arc
from tests.support.paths import ROOT

PLAN = ROOT / "results/eye_approach"


def test_a_film_lasts_as_long_as_the_motion(tmp_path: Path) -> None:
    plan = load_plan(PLAN)
    for speed in (1.0, 2.0):
        path = film(plan, tmp_path / f"{speed}.gif", speed)[f"{speed}.gif"]
        frames = [
            (frame.info["duration"], np.asarray(frame.convert("L"), float))
            for frame in ImageSequence.Iterator(Image.open(path))
        ]
        total = sum(duration for duration, _ in frames[:-1])
        assert total == pytest.approx(1000 * plan.duration / speed, abs=21)
        for (_, a), (_, b) in zip(frames[:-1:8], frames[8::8], strict=False):
            assert not np.array_equal(a, b), "the tool moves"


def test_the_lines_are_where_the_kinematics_says() -> None:
    plan = load_plan(PLAN)
    mechanism = Mechanism.from_geometry(plan.robot.geometry)
    q = plan.motion.sample(np.linspace(0.0, plan.duration, 7)).q
    first, second, tool = project_mechanism(plan.robot, q)
    np.testing.assert_allclose(tool[:, 0], fk(plan.robot, q).position @ PROJECTION.T, atol=1e-12)
    np.testing.assert_allclose(first[:, -1], second[:, 0], atol=1e-12)
    assert np.ptp(first[:, 0], axis=0).max() < 1e-12, "joint 1 stands still"
    # The tool passes through the port at the origin and through the end of link 2, so that both
    # lines are parallel.
    for line in (second[:, -1], tool[:, 0]):
        across = np.cross(np.c_[tool[:, 1] - tool[:, 0], 0 * q[:, 0]], np.c_[line, 0 * q[:, 0]])
        assert np.abs(across).max() < 1e-12
    assert np.linalg.norm(PROJECTION @ PROJECTION.T - np.eye(2)) < 1e-12
    arc = great_circle_arc(mechanism.omega1, mechanism.omega2)
    length = np.linalg.norm(np.diff(arc, axis=0), axis=1).sum()
    assert length == pytest.approx(mechanism.alpha, rel=1e-3)


def test_a_missing_encoder_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert main(["film", str(PLAN), "--speed", "400%", "-o", str(tmp_path / "film")]) == 0
    names = {path.name for path in (tmp_path / "film").iterdir()}
    assert {"film.gif", "strip.png", "picture_1.png", "picture_5.png"} <= names
    assert "film.mp4" not in names
    assert "ffmpeg is not on the PATH" in capsys.readouterr().out
    assert main(["film", str(PLAN), "-o", str(tmp_path / "film.mp4")]) == 2
    assert "ffmpeg" in capsys.readouterr().err
    assert main(["film", str(PLAN), "--speed", "fast"]) == 2


def test_the_encoder_gets_the_film(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The encoder receives the film.

    A program named ffmpeg copies its input to its output in place of the encoder.
    """
    program = tmp_path / "ffmpeg"
    code = "import shutil, sys; shutil.copy(sys.argv[sys.argv.index('-i') + 1], sys.argv[-1])"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -c "{code}" "$@"\n', encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    files = film(PLAN, tmp_path / "film", 4.0)
    assert files["film.mp4"].read_bytes() == files["film.gif"].read_bytes()
    with Image.open(files["film.gif"]) as picture:
        assert picture.width % 2 == picture.height % 2 == 0, "MP4 needs even sizes"
    program.write_text("#!/bin/sh\nexit 1\n", encoding="utf-8")
    assert main(["film", str(PLAN), "-o", str(tmp_path / "film.mp4")]) == 2
