"""A command that ends with status 0 or 1 and writes a folder also writes a page.

The page begins with the conclusion of the command.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from ssm_planner.cli import main
from ssm_planner.plans import load_plan
from ssm_planner.reporting.html.outcome import write_outcome
from tests.support.paths import ROOT

PLAN = str(ROOT / "results/tilt_insert")
CATALOGUE = str(ROOT / "problems/catalogues/motors_24v.csv")
RIG = str(ROOT / "problems/drives/rig1_lead_screw.yaml")
WRITTEN = {
    "sizing": (["size", PLAN], r"Motors suffice with [\d.]+ % margin"),
    "selection": (["size", PLAN, "--catalogue", CATALOGUE], "Every joint has a suitable motor"),
    "workspace": (["workspace", "vitreoretinal"], "Tilt range +"),
    "design_region": (["workspace", "--reach", " -140deg", " -80deg"], "Smallest alpha"),
    "rig1_lead_screw": (["identify", RIG, "--law", "coulomb"], "Friction law coulomb, map NRMSD"),
}


def first_sentence(page: Path) -> str:
    text = page.read_text(encoding="utf-8").partition("<body>")[2]
    return re.sub(r"<[^>]*>", "", text).strip().splitlines()[0]


@pytest.mark.parametrize("name", WRITTEN)
@pytest.mark.slow
@pytest.mark.usefixtures("few_points")
def test_a_folder_has_a_page_that_begins_with_its_conclusion(name: str, tmp_path: Path) -> None:
    words, conclusion = WRITTEN[name]
    assert main([*words, "-o", str(tmp_path)]) in (0, 1)
    page = tmp_path / f"{name}.html"
    assert re.match(conclusion, first_sentence(page))
    text = page.read_text(encoding="utf-8")
    assert "-----" not in text, "the tables are those of HTML"
    assert ".png" not in text, "files are named in the terminal only"
    pictures = len(list(tmp_path.glob("*.png")))
    assert text.count("<img") == pictures


def test_a_page_escapes_its_words(tmp_path: Path) -> None:
    words = "<script>alert(1)</script>"
    text = write_outcome(tmp_path / "page.html", words, words, [words]).read_text(encoding="utf-8")
    assert "<script" not in text
    assert text.count("&lt;script&gt;") == 4


def test_a_plan_removes_the_page_of_an_infeasible_problem(tmp_path: Path) -> None:
    (tmp_path / "no_plan.html").touch()
    load_plan(PLAN).save(tmp_path)
    assert not (tmp_path / "no_plan.html").exists()


def test_an_infeasible_problem_has_a_slider_of_changes_that_were_planned(tmp_path: Path) -> None:
    """Every text of the slider names a limit and the duration of the motion within this limit."""
    text = (ROOT / "problems/eye_approach.yaml").read_text(encoding="utf-8")
    text = text.replace("-17.66 mm", "-18.4 mm").replace(
        "robots/vitreoretinal.yaml", "vitreoretinal"
    )
    (tmp_path / "close.yaml").write_text(text, encoding="utf-8")
    assert main(["plan", str(tmp_path / "close.yaml"), "-o", str(tmp_path)]) == 1
    page = (tmp_path / "no_plan.html").read_text(encoding="utf-8")
    steps = re.findall(r"<li>(.*?)</li>", page)
    assert f'max="{len(steps) - 1}"' in page
    assert len(steps) > 1
    for step in steps:
        assert re.search(r"clearance from the retina .* the motion takes [\d.]+ s$", step)


def test_a_page_without_changes_has_no_script(tmp_path: Path) -> None:
    text = write_outcome(tmp_path / "page.html", "title", "conclusion").read_text(encoding="utf-8")
    assert "script" not in text.partition("<body>")[2]
    assert "script-src" not in text
