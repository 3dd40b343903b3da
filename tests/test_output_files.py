"""Every command and function keeps the files of others, and names an output that is impossible."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from ssm_planner import ExportError, ProblemError, export, load_plan, prove, report
from ssm_planner.cli import main
from ssm_planner.publishing import publishing
from ssm_planner.studies.store import write_table
from tests.support.paths import RESULTS

PLAN = RESULTS / "tilt_insert"
COMMANDS = {
    "page.html": ["report", str(PLAN), "-o"],
    "prove.py": ["check", str(PLAN), "--proof", "--checker"],
    "robot.yaml": ["new", "robot"],
}
FILM = {"film.gif": ["film", str(PLAN), "-o"]}
FUNCTIONS: dict[str, Callable[[Path], object]] = {
    "important.txt": lambda path: report(PLAN, path),
    "page.html": lambda path: report(PLAN, path),
    "comparison.html": lambda path: report(PLAN, path, PLAN),
    "prove.py": lambda path: prove(PLAN, path),
    "table.csv": lambda path: write_table((), path),
    "table.parquet": lambda path: write_table((), path),
}


@pytest.mark.parametrize("name", COMMANDS | FILM)
def test_a_command_keeps_a_foreign_file(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / name
    path.write_text("precious", encoding="utf-8")
    assert main([*(COMMANDS | FILM)[name], str(path)]) == 2
    assert f"{path}: " in capsys.readouterr().err
    assert path.read_text(encoding="utf-8") == "precious"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_keeps_a_foreign_file(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text("precious", encoding="utf-8")
    with pytest.raises(ExportError, match=name):
        FUNCTIONS[name](path)
    assert path.read_text(encoding="utf-8") == "precious"


def test_a_page_of_the_program_is_replaced_and_a_folder_gets_one(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    assert report(PLAN, page, PLAN) == page
    assert report(PLAN, page) == page
    assert "comparison" not in page.read_text(encoding="utf-8")[:1000]
    assert report(PLAN, tmp_path / "a.folder") == tmp_path / "a.folder/report.html"


@pytest.mark.parametrize(
    ("present", "is_replaced"),
    [
        ("# Friction identified from the figures of 24 recordings.\nname: a\n", True),
        ("# Test rig 1: a simple lead screw.\nname: mine\n", False),
        ("", False),
    ],
)
def test_results_without_a_manifest_only_replace_files_of_their_kind(
    present: str, is_replaced: bool, tmp_path: Path
) -> None:
    """`identify` and `size` write such results, for example a drive file."""
    path = tmp_path / "drive.yaml"
    path.write_text(present, encoding="utf-8")
    new = "# Friction identified from 3 recordings.\nname: b\n"

    def publish() -> None:
        with publishing(tmp_path) as temporary:
            (temporary / path.name).write_text(new, encoding="utf-8")
            (temporary / "map.pdf").write_text("%PDF", encoding="utf-8")

    if is_replaced:
        publish()
        assert path.read_text(encoding="utf-8") == new
        return
    with pytest.raises(ExportError, match=r"drive\.yaml is not from this program"):
        publish()
    assert path.read_text(encoding="utf-8") == present
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", COMMANDS)
def test_a_name_that_no_file_can_have_is_one_message(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*COMMANDS[name], str(tmp_path / ("x" * 300 + name))]) == 2
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert message.endswith("cannot be written: File name too long")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "words",
    [
        ["plan", "tilt_insert", "-o", ""],
        ["plan", ""],
        ["export", str(PLAN), "--to", "csv", "-o", ""],
    ],
)
def test_an_empty_path_is_refused(
    words: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    assert "an empty path" in capsys.readouterr().err
    with pytest.raises(ProblemError, match="path"):
        export(PLAN, "csv", "")
    with pytest.raises(ProblemError, match="path"):
        report(PLAN, "")
    assert not list(tmp_path.iterdir())


def test_a_result_folder_keeps_foreign_files_and_replaces_its_own(tmp_path: Path) -> None:
    plan = load_plan(PLAN)
    mine = tmp_path / "mine/report.html"
    mine.parent.mkdir()
    mine.write_text("precious", encoding="utf-8")
    with pytest.raises(ExportError, match=r"report\.html is not from this program"):
        report(plan, plan_copy(tmp_path, mine))
    assert mine.read_text(encoding="utf-8") == "precious"
    own = plan_copy(tmp_path, PLAN / "report.html")
    assert report(plan, own) == own


def plan_copy(folder: Path, page: Path) -> Path:
    """Copy the plan with a page, and return the path of this page."""
    copy = folder / page.parent.name
    if page.parent == PLAN:
        return Path(shutil.copytree(PLAN, copy)) / page.name
    manifest = (PLAN / "manifest.json").read_text(encoding="utf-8")
    text = manifest.replace('"report.html"', '"other.html"')
    (copy / "manifest.json").write_text(text, encoding="utf-8")
    return page
