"""Every example runs alone in an empty folder, prints its result, writes no file and is listed."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.paths import ROOT

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
ARGUMENTS = {"prove": [ROOT / "results/eye_approach/plan.json"]}


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs(example: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, example, *ARGUMENTS.get(example.stem, [])],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout
    assert not done.stderr
    assert not list(tmp_path.iterdir())


def test_examples_use_public_names_alone_and_are_listed() -> None:
    listed = (ROOT / "examples/README.md").read_text(encoding="utf-8")
    assert len(EXAMPLES) >= 12
    for example in EXAMPLES:
        source = example.read_text(encoding="utf-8")
        assert f"`{example.name}`" in listed
        assert not re.search(r"ssm_planner\.\w+ import|\._(?!_)\w|import ssm_planner\.", source), (
            example
        )
