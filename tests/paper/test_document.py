"""The document is complete, reproducible and equal to the committed document."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from paper_reproduction import document as paper_document
from paper_reproduction.document import write
from paper_reproduction.friction import friction_section, rig_result
from paper_reproduction.published import Inputs, read_inputs
from paper_reproduction.section import Section, wrapped
from paper_reproduction.workspace import design_section, workspace_section
from ssm_planner import reproduction
from ssm_planner.cli import main
from ssm_planner.display import format_number, format_percent, format_signed
from ssm_planner.reporting.figures.style import save_figure
from tests.support.paper_cases import Made
from tests.support.paths import ROOT
from tests.support.recordings import REAL, RECORDINGS

COMMITTED = ROOT / "results" / "paper"
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+−-]?\d+)?")
needs_recordings = pytest.mark.skipif(not REAL, reason="the recordings are not beside the project")


@pytest.mark.slow
def test_every_picture_is_there_as_png_and_pdf(made: Made) -> None:
    pictures = re.findall(r"\[!\[[^\]]+\]\((\w+)\.png\)\]\((\w+)\.pdf\)", made.text)
    assert len(pictures) >= 8
    assert all(png == pdf for png, pdf in pictures)
    names = {png for png, _ in pictures}
    assert {path.name for path in made.folder.iterdir()} == {"README.md"} | {
        f"{name}.{ending}" for name in names for ending in ("png", "pdf")
    }
    for name in names:
        assert (made.folder / f"{name}.png").read_bytes()[:4] == b"\x89PNG"
        assert (made.folder / f"{name}.pdf").read_bytes()[:5] == b"%PDF-"


def test_figures_are_not_empty_and_name_their_units(made: Made) -> None:
    units = ("mN·m", "rpm", "mm", "time (s)", "°", "by the Stribeck speed", "μ")
    for section in made.document.sections:
        for name, figure in section.figures.items():
            drawn = [
                artist
                for axes in figure.axes
                for artist in (*axes.lines, *axes.patches, *axes.collections)
            ]
            assert len(drawn) >= 2, name
            labels = [
                label
                for axes in figure.axes
                for label in (axes.get_xlabel(), axes.get_ylabel())
                if label
            ]
            assert all(any(unit in label for unit in units) for label in labels), (name, labels)
            for axes in figure.axes:
                for line in axes.lines:
                    assert np.all(np.isfinite(np.asarray(line.get_xydata(), dtype=float))), name


def test_tables_are_rectangular_and_sections_name_their_command(made: Made) -> None:
    blocks = re.findall(r"(?:^\|.*\|\n)+", made.text, re.MULTILINE)
    assert len(blocks) >= 15
    for block in blocks:
        assert len({line.count("|") for line in block.splitlines()}) == 1, block
    for section in made.text.split("\n## ")[1:-1]:
        assert "Made by `ssm-planner reproduce`" in section, section[:60]


def test_every_command_named_exists(made: Made) -> None:
    from ssm_planner.cli import COMMANDS

    named = re.findall(r"`ssm-planner ([^`]+)`", made.text)
    for command in named:
        words = command.split()
        assert words[0] in COMMANDS
        for word in words[1:]:
            assert "/" not in word or (ROOT / word).is_file(), word


def test_links_of_the_contents_lead_to_headings(made: Made) -> None:
    headings = re.findall(r"^## (.+)$", made.text, re.MULTILINE)
    links = re.findall(r"^\* \[(.+)\]\(#([^)]+)\)$", made.text, re.MULTILINE)
    assert [title for title, _ in links] == headings[:-1]
    for title, anchor in links:
        assert anchor == re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def test_nothing_of_this_machine_is_in_it(made: Made) -> None:
    for words in (str(made.folder), str(ROOT), str(RECORDINGS), "/tmp", "object at 0x", "nan"):
        assert words not in made.text, words


def test_the_command_writes_the_same_again(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(paper_document, "compute", lambda *_: made.document)
    monkeypatch.setattr(paper_document, "save_figures", _named_only)
    options = ["--problems", str(ROOT / "problems"), "--recordings", str(RECORDINGS)]
    assert main(["reproduce", "-o", str(tmp_path), *options]) == 0
    assert (tmp_path / "paper/README.md").read_text(encoding="utf-8") == made.text
    assert {path.name for path in (tmp_path / "paper").iterdir()} == set(made.files)


def _named_only(figures: dict[str, object], folder: Path) -> None:
    for name in figures:
        for ending in (".png", ".pdf"):
            (folder / name).with_suffix(ending).touch()


@pytest.mark.slow
@pytest.mark.parametrize("section", [workspace_section, design_section, friction_section])
def test_pictures_are_the_same_bytes_each_time(
    section: Callable[..., Section], made: Made, tmp_path: Path
) -> None:
    of = (made.inputs.robot, made.inputs.eye)[: len(inspect.signature(section).parameters)]
    for folder in ("one", "two"):
        for name, figure in section(*of).figures.items():
            save_figure(figure, tmp_path / folder / name)
    files = sorted((tmp_path / "one").iterdir())
    assert files
    for file in files:
        assert file.read_bytes() == (tmp_path / "two" / file.name).read_bytes(), file.name


@pytest.mark.slow
@needs_recordings
def test_the_command_writes_the_committed_document(made: Made) -> None:
    """The command writes the committed document except for the last digits of its numbers.

    The command fixes the numeric kernels, but the functions of the C library differ between
    systems.
    """
    documents = (COMMITTED / "README.md", made.folder / "README.md")
    flat = [re.sub(r"\s+", " ", path.read_text(encoding="utf-8")) for path in documents]
    assert NUMBER.sub("#", flat[0]) == NUMBER.sub("#", flat[1])
    values = [
        np.array([float(number.replace("−", "-")) for number in NUMBER.findall(words)])
        for words in flat
    ]
    error = np.abs(values[0] - values[1]) / (np.abs(values[0]) + 1e-3)
    assert np.mean(error < 0.02) > 0.97
    assert error.max() < 0.3
    names = [{file.name for file in path.parent.iterdir()} for path in documents]
    assert names[0] == names[1]


@pytest.mark.slow
@pytest.mark.usefixtures("few_points")
def test_without_recordings_their_rows_are_left_out_with_the_reason(
    inputs: Inputs, tmp_path: Path
) -> None:
    absent = read_inputs(inputs.folder, tmp_path / "nowhere")
    result = rig_result(absent, "rig2_antibacklash_screw")
    assert not result.tested
    assert "--recordings" in result.left_out
    folder = tmp_path / "drive2_antibacklash_screw" / "start_stop"
    folder.mkdir(parents=True)
    (folder / "50.csv").write_text("not a recording\n", encoding="utf-8")
    broken = rig_result(read_inputs(inputs.folder, tmp_path), "rig2_antibacklash_screw")
    assert not broken.tested
    assert "50.csv" in broken.left_out
    assert str(tmp_path) not in broken.left_out


def test_with_recordings_every_rig_is_predicted(made: Made) -> None:
    assert [len(rig.tested) for rig in made.document.rigs] == [1, 1, 1]
    assert not made.document.left_out


def test_bad_input_gives_status_2_and_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        main(["reproduce", "-o", str(tmp_path / "out"), "--problems", str(tmp_path / "none")]) == 2
    )
    message = capsys.readouterr().err
    assert "--problems" in message
    assert str(tmp_path)[:60] in message
    assert "Traceback" not in message
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_written_gives_status_2(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(paper_document, "compute", lambda *_: made.document)
    (tmp_path / "paper").write_text("a file", encoding="utf-8")
    assert main(["reproduce", "-o", str(tmp_path), "--problems", str(ROOT / "problems")]) == 2
    assert str(tmp_path / "paper") in capsys.readouterr().err
    assert (tmp_path / "paper").read_text(encoding="utf-8") == "a file"


def test_an_interrupted_writing_leaves_the_earlier_document(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "paper"
    folder.mkdir()
    (folder / "README.md").write_text("earlier", encoding="utf-8")

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(paper_document, "save_figures", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write(made.document, folder)
    assert (folder / "README.md").read_text(encoding="utf-8") == "earlier"
    assert [path.name for path in tmp_path.iterdir()] == ["paper"]


def test_numbers_and_lines_of_the_document() -> None:
    assert (format_number(-0.12345), format_number(1e-15), format_number(1234.5)) == (
        "−0.123",
        "0",
        "1.23e+03",
    )
    assert (format_signed(-0.0004, 3), format_signed(0.0004, 2), format_percent(-0.0125)) == (
        "0.000",
        "0.00",
        "−1.2 %",
    )
    lines = wrapped("a `command that stays whole` " * 12).splitlines()
    assert len(lines) > 2
    assert all(line.count("`") % 2 == 0 for line in lines)
    assert all(len(line) <= 120 for line in lines)


def test_an_installation_without_the_source_tree_has_no_reproduction(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(reproduction, "EXAMPLES_FOLDER", tmp_path)
    assert main(["reproduce", "-o", str(tmp_path / "out")]) == 2
    assert "needs the source tree" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
