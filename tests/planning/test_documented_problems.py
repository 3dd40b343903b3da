"""Verify that the shipped problems and the problem files in the documents are read and planned."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from ssm_planner.loading.load import load_problem
from ssm_planner.pipeline.run import plan
from ssm_planner.problem.problem import Problem
from tests.support.paths import ROOT

Load = Callable[[str], Problem]
BASE = """robot: robots/vitreoretinal.yaml
start: {roll: 0 deg, tilt: -85 deg, spin: 0 deg, depth: 0 mm}
"""
KEYS = {
    "motion": "motion: [{insert: {to: 20 mm}}]\n",
    "limits": "limits: {depth: [0 mm, 30 mm]}\n",
    "eye": "eye: {centre: [9.07 mm, 0 mm, -7.86 mm], radius: 11.3 mm, clearance: 1 mm}\n",
}


def blocks(document: str) -> list[str]:
    """Return the YAML blocks of a document."""
    return re.findall(
        r"```yaml\n(.*?)```", (ROOT / document).read_text(encoding="utf-8"), re.DOTALL
    )


@pytest.fixture
def load(tmp_path: Path) -> Load:
    shutil.copytree(ROOT / "problems", tmp_path / "problems")
    (tmp_path / "problems/scan.csv").write_text(
        "tilt [deg],depth_mm\n-120,12\n-118,13\n-115,13\n", encoding="utf-8"
    )

    def made(text: str) -> Problem:
        """Return the problem of one block, with default values for missing keys."""
        if not text.startswith("robot:"):
            text = ("motion:\n" if text.startswith("  -") else "") + text
            text = (
                BASE
                + text
                + "".join(
                    line for key, line in KEYS.items() if not re.search(f"^{key}:", text, re.M)
                )
            )
        path = tmp_path / "problems/written.yaml"
        path.write_text(text, encoding="utf-8")
        return load_problem(path)

    return made


@pytest.mark.parametrize("name", ["waypoints", "laser_scan"])
def test_a_shipped_problem_is_planned(name: str) -> None:
    result = plan(load_problem(ROOT / f"problems/{name}.yaml"))
    assert result.passed
    assert result.gap < 0.3


@pytest.mark.parametrize("document", ["docs/problem_file.md", "docs/motions.md"])
def test_what_a_document_shows_is_read(document: str, load: Load) -> None:
    result = blocks(document)
    assert len(result) >= 2
    for text in result:
        assert load(text).motion


def test_the_second_example_of_the_problem_page_is_planned(load: Load) -> None:
    problem = load(blocks("docs/problem_file.md")[1])
    assert problem.eye is not None
    result = plan(problem)
    assert result.passed
    assert result.phases[-1].duration == pytest.approx(2.0, rel=1e-9)
