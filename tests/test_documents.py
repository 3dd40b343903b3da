"""Documents that hold: links lead somewhere, commands and options exist, examples load, the tutorial does what it says."""

from __future__ import annotations

import argparse
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from ssm_planner.cli import COMMANDS, _parser
from ssm_planner.loading.load import load_problem

ROOT = Path(__file__).parent.parent
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").glob("*.md"))]
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]
LINK = re.compile(r"!?\[[^\]\n]*\]\(([^)\s]+)\)")
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.M | re.S)
MADE = {"docs/gallery.md"}


def outside_code(text: str) -> str:
    return re.sub(r"`[^`\n]*`", "", BLOCK.sub("", text))


def anchors(page: Path) -> set[str]:
    headings = re.findall(r"^#+ (.+)$", BLOCK.sub("", page.read_text(encoding="utf-8")), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("name", NAMES)
def test_links_lead_somewhere(name: str) -> None:
    page = ROOT / name
    for target in LINK.findall(outside_code(page.read_text(encoding="utf-8"))):
        if target.startswith("http"):
            continue
        path, _, anchor = target.partition("#")
        found = page if not path else page.parent / path
        assert found.exists() or str(found.relative_to(ROOT)) in MADE, (name, target)
        if anchor:
            assert anchor in anchors(found), (name, target)


def commands(page: Path) -> Iterator[list[str]]:
    """Every `ssm-planner …` of a page that is a whole command, without comments and output."""
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
        parser = _parser([words[0]])
        (subparsers,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
        known = set(subparsers.choices[words[0]]._option_string_actions)
        given = {word.partition("=")[0] for word in words if re.match(r"-(-\w|[a-z]$)", word)}
        assert given <= known, (name, words)


@pytest.mark.parametrize("name", NAMES)
def test_blocks_of_yaml_can_be_read_and_problems_load(name: str, tmp_path: Path) -> None:
    for k, (kind, block) in enumerate(BLOCK.findall((ROOT / name).read_text(encoding="utf-8"))):
        if kind != "yaml":
            continue
        data = yaml.safe_load(block)
        if isinstance(data, dict) and {"robot", "start", "motion"} <= set(data):
            file = tmp_path / f"{k}.yaml"
            file.write_text(block.replace("robots/vitreoretinal.yaml", "vitreoretinal"), encoding="utf-8")
            load_problem(file)


def test_python_in_the_readme_runs(tmp_path: Path) -> None:
    (tmp_path / "problems").symlink_to(ROOT / "problems")
    for kind, block in BLOCK.findall((ROOT / "README.md").read_text(encoding="utf-8")):
        if kind == "python":
            done = run([sys.executable, "-c", block], tmp_path)
            assert done.returncode == 0, done.stderr
            assert (tmp_path / "results/mine/plan.json").exists()


def test_messages_of_the_faq_are_the_programs() -> None:
    source = "".join(file.read_text(encoding="utf-8") for file in (ROOT / "ssm_planner").rglob("*.py"))
    for heading in re.findall(r"^## (.+)$", (ROOT / "docs/faq.md").read_text(encoding="utf-8"), re.M):
        assert heading in source, heading


def test_every_page_is_in_the_site() -> None:
    listed = set((ROOT / "docs/index.md").read_text(encoding="utf-8").split())
    assert {page.stem for page in (ROOT / "docs").glob("*.md")} - {"index"} <= listed
    assert all((ROOT / "docs" / f"{name}.md").exists() for name in listed & {"tutorial", "cad", "glossary", "faq"})


def run(words: list[str], folder: Path, text: str | None = None) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "100"}
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, input=text)


def test_the_tutorial_does_what_it_says(tmp_path: Path) -> None:
    """Every command in an empty folder; every line below it is in its output, whatever the spaces."""
    text = (ROOT / "docs/tutorial.md").read_text(encoding="utf-8")
    start = f'ssm-planner() {{ {shlex.quote(sys.executable)} -m ssm_planner "$@"; }}\n'
    for block in (block for kind, block in BLOCK.findall(text) if kind == "console"):
        for part in block.split("$ ")[1:]:
            command, *expected = part.splitlines()
            done = run(["bash", "-c", start + command], tmp_path)
            status = 0
            if expected and (found := re.fullmatch(r"status (\d+)", expected[0])):
                status, expected = int(found[1]), expected[1:]
            assert done.returncode == status, (command, done.stderr)
            said = " ".join((done.stdout + done.stderr).split())
            for line in expected:
                assert " ".join(line.split()) in said, (command, line, said[:3000])
