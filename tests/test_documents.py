"""The links, commands, options, examples and printed output in the documents match the program."""

from __future__ import annotations

import argparse
import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image, ImageSequence

from ssm_planner.cli import COMMANDS, _build_parser, main
from ssm_planner.loading.load import load_problem
from ssm_planner.studies.study_file import load_study
from tests.support.paths import ROOT

PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").glob("*.md"))]
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]
LINK = re.compile(r"!?\[[^\]\n]*\]\(([^)\s]+)\)")
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.M | re.S)
MADE = {"docs/gallery.md"}
WITH_OUTPUT = {"tutorial": "docs/tutorial.md", "README": "README.md"}
"""Pages whose commands run in an empty folder. Their printed output is compared with the page."""


def outside_code(text: str) -> str:
    return re.sub(r"`[^`\n]*`", "", BLOCK.sub("", text))


def anchors(page: Path) -> set[str]:
    headings = re.findall(r"^#+ (.+)$", BLOCK.sub("", page.read_text(encoding="utf-8")), re.M)
    return {
        re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings
    }


@pytest.mark.parametrize("name", NAMES)
def test_links_lead_somewhere(name: str) -> None:
    page = ROOT / name
    for target in LINK.findall(outside_code(page.read_text(encoding="utf-8"))):
        if target.startswith("http"):
            continue
        path, _, anchor = target.partition("#")
        result = page if not path else page.parent / path
        assert result.exists() or str(result.relative_to(ROOT)) in MADE, (name, target)
        if anchor:
            assert anchor in anchors(result), (name, target)


def commands(page: Path) -> Iterator[list[str]]:
    """Yield the words of each `ssm-planner …` command on a page, without comments and output."""
    text = page.read_text(encoding="utf-8")
    lines = [line for _, block in BLOCK.findall(text) for line in block.splitlines()]
    lines += re.findall(r"`(ssm-planner [^`\n]*)`", outside_blocks(text))
    for line in lines:
        words = re.split(r"\s{2,}|\s[#>|]", line.removeprefix("$ ").strip())[0]
        if words.startswith("ssm-planner ") and not words.startswith("ssm-planner --"):
            yield shlex.split(words.replace("[", " ").replace("]", " "))[1:]


def outside_blocks(text: str) -> str:
    return BLOCK.sub("", text)


@pytest.mark.parametrize("name", NAMES)
def test_commands_and_their_options_exist(name: str) -> None:
    for words in commands(ROOT / name):
        if words[0] in ("KIND", "COMMAND", "…"):
            continue
        assert words[0] in COMMANDS, (name, words)
        parser = _build_parser([words[0]])
        (subparsers,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
        known = set(subparsers.choices[words[0]]._option_string_actions)
        options = {word.partition("=")[0] for word in words if re.match(r"-(-\w|[a-z]$)", word)}
        assert options <= known, (name, words)


@pytest.mark.parametrize("name", NAMES)
def test_blocks_of_yaml_can_be_read_and_problems_load(name: str, tmp_path: Path) -> None:
    """Every block of YAML can be parsed, and every problem and study loads.

    The missing keys of an incomplete problem come from a shipped problem.
    """
    for k, (kind, block) in enumerate(BLOCK.findall((ROOT / name).read_text(encoding="utf-8"))):
        if kind != "yaml":
            continue
        data = yaml.safe_load(block)
        if isinstance(data, dict) and "vary" in data:
            (tmp_path / "study.yaml").write_text(block, encoding="utf-8")
            for catalogue in (ROOT / "problems/catalogues").glob("*.csv"):
                shutil.copy(catalogue, tmp_path)
            assert load_study(tmp_path / "study.yaml").vary
        elif isinstance(data, dict) and {"start", "limits", "eye"} & set(data):
            complete = {"robot", "start", "motion"} <= set(data)
            rest = (
                {}
                if complete
                else yaml.safe_load(
                    (ROOT / "problems/tilt_insert.yaml").read_text(encoding="utf-8")
                )
            )
            total = {**rest, **data}
            named = ROOT / "problems/robots" / Path(total["robot"]).name
            file = tmp_path / f"{k}.yaml"
            robot = named.stem if named.is_file() else "vitreoretinal"
            file.write_text(yaml.safe_dump({**total, "robot": robot}), encoding="utf-8")
            load_problem(file)


STANDS_FOR = {
    "PLAN": "results/tilt_insert",
    "A": "results/tilt_insert",
    "B": "results/tilt_insert",
    "OTHER": "results/tilt_insert",
    "PROBLEM": "problems/tilt_insert.yaml",
    "ROBOT": "problems/robots/vitreoretinal.yaml",
    "TRAJECTORY": "results/tilt_insert/plan.json",
    "DRIVE": "problems/drives/rig1_lead_screw.yaml",
    "LAW": "coulomb",
    "NAME=VALUE": "mu=0.12",
    "KIND": "drive",
    "A.yaml": "maxon_ecx_torque_22_m",
    "B.yaml": "maxon_ecx_torque_22_xl",
    "tilt=C.yaml": "tilt=maxon_ecx_torque_22_m",
    "my_drives.yaml": "problems/controllers/epos4.yaml",
    "csv|epos4|pvt|ros2|urdf|c": "csv",
    "TIME": "1s",
    "PERCENT": "50%",
    **{
        name: f"problems/catalogues/{name}"
        for name in ("motors_24v.csv", "worms.csv", "screws.csv")
    },
}
"""Values that the tests use for the placeholders, and for files that a reader would have."""
FILES = {"retime": "path.csv", "new": "made.yaml", "identify": "identified.yaml"}
PATH = "time_s,q1_rad,q2_rad,q3_rad,q4_m\n0,0,0.2,0,0\n1,0.1,0.4,0,-0.005\n2,0.2,0.6,0,-0.01\n"
CATALOGUE = "problems/catalogues/motors_24v.csv"
NOT_RUN = {
    "view": "serves until it is ended: tests/browser/test_view.py",
    "reproduce": "takes minutes: tests/paper",
    "study": "takes minutes; `show` and `compare` need its store: tests/studies",
    "predict": "needs recordings, which are not part of the project: tests/identification/test_prediction.py",
    "compare": "needs recordings of the plan: tests/comparison",
    "plan problems/eye_approach.yaml": "takes long: `make docs` plans it",
    "identify problems/drives/rig": "takes long: tests/identification",
    "identify DRIVE RECORDING …": "the same with an option that fixes what may be fixed is run",
    "simulate PLAN --power-loss everywhere": "takes a minute: tests/simulation",
    "simulate PLAN --draws": "takes minutes: tests/simulation",
    "simulate PLAN --speed": "takes ten times as long as the motion: tests/cli/test_simulate.py",
    "size problems/motorisation/paper.yaml": "takes long: tests/paper",
    "report results/tilt_insert --figures": "`report PLAN OTHER --figures DIR` draws them",
    "report PLAN --figures": "`report PLAN OTHER --figures DIR` draws them",
    "plan PROBLEM -o DIR --json": "`plan PROBLEM` is run",
    "film results/eye_approach": "the test of the README's film runs it",
}
"""Beginnings of the commands that no test in this file runs, with the reasons."""
FAILING = {
    "simulate PLAN --stall tilt@1s": 1,
    "check results/tilt_insert/epos4 --robot vitreoretinal --key public.pem": 4,
}
"""Exit statuses of the commands that do not end with 0."""


def whole_commands() -> list[str]:
    """Return every command of the documents once, without bare names of commands."""
    lines = [
        " ".join(words)
        for page in PAGES
        if page.stem not in WITH_OUTPUT  # Another test runs these and compares the output.
        for words in commands(page)
    ]
    alone = {
        *COMMANDS,
        "new robot robot.yaml",
        "workspace robot.yaml",
    }  # The tutorial runs these two.
    return sorted({line for line in lines if line not in alone and line.split()[0] in COMMANDS})


def filled(line: str) -> list[str]:
    """Return the words of a command with values in place of the placeholders."""
    words = []
    for before, word in pairwise(["", *line.split()]):
        if word == "FILE":
            word = CATALOGUE if before == "--catalogue" else FILES[words[0]]
        if word not in ("…", "RECORDING"):
            words.append(STANDS_FOR.get(word, word))
    return words


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """Return a new folder that resembles a checkout.

    Commands overwrite the results in it, so that each test needs a new folder.
    """
    folder = tmp_path
    (folder / "problems").symlink_to(ROOT / "problems")
    shutil.copytree(ROOT / "results/tilt_insert", folder / "results/tilt_insert")
    (folder / FILES["retime"]).write_text(PATH, encoding="utf-8")
    return folder


def test_commands_that_are_not_run_occur_in_the_documents() -> None:
    assert WITH_FIGURES in RUN.values()
    assert all(any(line.startswith(start) for line in whole_commands()) for start in NOT_RUN)


def write_keys(private: Path, public: Path) -> None:
    """Write a new pair of keys for signatures."""
    from cryptography.hazmat.primitives import serialization as form
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    key, pem = Ed25519PrivateKey.generate(), form.Encoding.PEM
    unencrypted = form.NoEncryption()
    private.write_bytes(key.private_bytes(pem, form.PrivateFormat.PKCS8, unencrypted))
    kind = form.PublicFormat.SubjectPublicKeyInfo
    public.write_bytes(key.public_key().public_bytes(pem, kind))


WITH_FIGURES = "plan problems/tilt_insert.yaml"
RUN = {
    " ".join(filled(line)): line for line in whole_commands() if not line.startswith(tuple(NOT_RUN))
}
"""Lines of the documents by the commands that they run. Equal commands are run once."""


@pytest.mark.parametrize("line", sorted(RUN.values()))
@pytest.mark.slow
def test_a_command_of_the_documents_runs(
    line: str, place: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A command of the documents ends with the expected exit status.

    Commands run in this process, in a folder that resembles a checkout. Only one command draws the
    figures of its plan.
    """
    if line != WITH_FIGURES:
        request.getfixturevalue("no_figures")
    if line.startswith("identify"):
        request.getfixturevalue("few_points")
    monkeypatch.chdir(place)
    folder = f"out/{line.split()[0]}"
    if "key.pem" in line or "public.pem" in line:
        write_keys(Path("key.pem"), Path("public.pem"))
    if "public.pem" in line:
        assert main(["export", "results/tilt_insert", "--to", "epos4", "--sign", "key.pem"]) == 0
    assert main([folder if word == "DIR" else word for word in filled(line)]) == FAILING.get(
        line, 0
    )


def test_the_readme_prints_what_it_shows(tmp_path: Path) -> None:
    """The Python block of the README prints exactly the text block below it."""
    blocks = BLOCK.findall((ROOT / "README.md").read_text(encoding="utf-8"))
    (k,) = (k for k, (kind, _) in enumerate(blocks) if kind == "python")
    assert blocks[k + 1][0] == "text"
    process = run([sys.executable, "-c", blocks[k][1]], tmp_path)
    assert process.returncode == 0, process.stderr
    assert process.stdout == blocks[k + 1][1]
    assert (tmp_path / "stream/roll.csv").exists()


def test_the_readme_is_short() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 120
    assert len(text.split()) <= 800
    assert (ROOT / "docs/film.gif").stat().st_size <= 500_000


def test_the_comparison_in_the_readme_is_from_the_benchmarks() -> None:
    """Every measured value of the README's table, with its unit, is in results/benchmarks.md."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    table = text.partition("## Comparison")[2].partition("\n##")[0]
    measured = (ROOT / "results/benchmarks.md").read_text(encoding="utf-8")
    values = re.findall(r"(?<![\w.])[\d.]+ (?:ms|µs|s|%)(?!\w)", table)
    assert len(values) >= 8
    for value in values:
        assert re.search(rf"(?<![\d.]){re.escape(value)}", measured) or value == "35 %", value
    assert "Motors × 0.35" in measured


def test_the_film_of_the_readme_is_that_of_the_plan(tmp_path: Path) -> None:
    """The committed film equals a newly drawn film, and the Makefile contains its command.

    Other versions of the libraries may change the size by one pixel and the fonts.
    """
    (line,) = (line for line in whole_commands() if line.endswith("-o docs/film.gif"))
    words = line.replace("docs/film.gif", str(tmp_path / "film.gif")).split()
    assert main([word.replace("results/", f"{ROOT}/results/") for word in words]) == 0
    assert line in (ROOT / "Makefile").read_text(encoding="utf-8")
    drawn, committed = (
        [
            np.asarray(picture.convert("L"), float)
            for picture in list(ImageSequence.all_frames(film))[::8]
        ]
        for film in (Image.open(folder / "film.gif") for folder in (tmp_path, ROOT / "docs"))
    )
    assert len(drawn) == len(committed)
    rows, columns = (min(drawn[0].shape[k], committed[0].shape[k]) for k in (0, 1))
    for a, b in zip(drawn, committed, strict=True):
        assert np.abs(np.subtract(a.shape, b.shape)).max() <= 1
        assert np.abs(a[:rows, :columns] - b[:rows, :columns]).mean() < 2.5


def test_the_python_page_runs(tmp_path: Path) -> None:
    (tmp_path / "problems").symlink_to(ROOT / "problems")
    blocks = BLOCK.findall((ROOT / "docs/python.md").read_text(encoding="utf-8"))
    programs = [block for kind, block in blocks if kind == "python"]
    assert programs
    for program in programs:
        process = run([sys.executable, "-c", program], tmp_path)
        assert process.returncode == 0, process.stderr
        assert (tmp_path / "results/mine/plan.json").exists()
        assert (tmp_path / "out").is_dir()


def test_messages_of_the_faq_are_the_programs() -> None:
    source = "".join(
        file.read_text(encoding="utf-8") for file in (ROOT / "ssm_planner").rglob("*.py")
    )
    headings = re.findall(r"^## (.+)$", (ROOT / "docs/faq.md").read_text(encoding="utf-8"), re.M)
    assert headings
    for heading in headings:
        assert heading in source, heading


def test_every_page_is_in_the_site() -> None:
    listed = set((ROOT / "docs/index.md").read_text(encoding="utf-8").split())
    assert {page.stem for page in (ROOT / "docs").glob("*.md")} - {"index"} <= listed
    assert all(
        (ROOT / "docs" / f"{name}.md").exists()
        for name in listed & {"tutorial", "cad", "glossary", "faq"}
    )


def run(
    words: list[str], folder: Path, text: str | None = None
) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "100"}
    return subprocess.run(
        words, cwd=folder, env=environment, capture_output=True, text=True, input=text
    )


@pytest.mark.parametrize("name", WITH_OUTPUT.values())
@pytest.mark.slow
def test_commands_print_what_the_page_shows(name: str, tmp_path: Path) -> None:
    """Every command of a page prints the lines that the page shows below it.

    The commands run one after the other in an empty folder. Runs of spaces count as one space, and
    "…" stands for any text.
    """
    text = (ROOT / name).read_text(encoding="utf-8")
    start = f'ssm-planner() {{ {shlex.quote(sys.executable)} -m ssm_planner "$@"; }}\n'
    blocks = [block for kind, block in BLOCK.findall(text) if kind == "console"]
    assert blocks
    for block in blocks:
        for part in block.split("$ ")[1:]:
            command, *expected = part.splitlines()
            process = run(["bash", "-c", start + command], tmp_path)
            status = 0
            if expected and (match := re.fullmatch(r"status (\d+)", expected[0])):
                status, expected = int(match[1]), expected[1:]
            assert process.returncode == status, (command, process.stderr)
            output = " ".join((process.stdout + process.stderr).split())
            for line in expected:
                pieces = [re.escape(" ".join(piece.split())) for piece in line.split("…")]
                assert re.search(".*".join(pieces), output), (command, line, output[:3000])


GUIDE = [
    name
    for caption in ("Start", "Use")
    for name in re.findall(
        rf":caption: {caption}\n(.*?)```",
        (ROOT / "docs/index.md").read_text(encoding="utf-8"),
        re.S,
    )[0].split()
    if f"docs/{name}.md" not in MADE
]
FIGURE = re.compile(r"!\[([^\]]+)\]\(([^)\s]+)\)")


@pytest.mark.parametrize("name", GUIDE)
def test_every_page_of_the_guide_has_a_figure_in_words_too(name: str) -> None:
    """Every page of the guide has figures of at most 300 kB with a description in words."""
    figures = FIGURE.findall((ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8"))
    assert figures
    for words, path in figures:
        assert len(words.split()) > 3, path
        assert (ROOT / "docs" / path).stat().st_size <= 300_000, path


def test_the_site_teaches_by_figures_and_equations() -> None:
    texts = [page.read_text(encoding="utf-8") for page in (ROOT / "docs").glob("*.md")]
    figures = {path for text in texts for _, path in FIGURE.findall(text)}
    assert len(figures) >= 25
    assert sum(text.count("\n$$\n") for text in texts) >= 2 * 30


def test_drawn_figures_are_those_of_their_script() -> None:
    """Every figure in docs/figures has a function that draws it and a page that shows it."""
    names = {
        draw.__name__ for draw in runpy.run_path(str(ROOT / "docs/make_figures.py"))["FIGURES"]
    }
    assert names == {file.stem for file in (ROOT / "docs/figures").iterdir()}
    pages = "".join(page.read_text(encoding="utf-8") for page in (ROOT / "docs").glob("*.md"))
    for name in names:
        assert f"(figures/{name}.png)" in pages


@pytest.mark.slow
@pytest.mark.parametrize("name", ["friction_law", "certificate"])
def test_a_committed_figure_is_what_the_script_draws(name: str, tmp_path: Path) -> None:
    """A committed figure equals the figure that the script draws.

    Other versions of matplotlib may change the size by two pixels and the fonts.
    """
    script = runpy.run_path(str(ROOT / "docs/make_figures.py"))
    script["save_figure"](script[name](), tmp_path / name, pdf=False)
    drawn, committed = (
        np.asarray(Image.open(folder / f"{name}.png").convert("L"), float)
        for folder in (tmp_path, ROOT / "docs/figures")
    )
    rows, columns = np.minimum(drawn.shape, committed.shape)
    assert np.abs(np.subtract(drawn.shape, committed.shape)).max() <= 2
    assert np.abs(drawn[:rows, :columns] - committed[:rows, :columns]).mean() < 3.0
