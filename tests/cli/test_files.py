"""New files load unchanged, every key has a meaning, and the schema agrees with the loader."""

from __future__ import annotations

import json
import re
import runpy
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

from ssm_planner import templates
from ssm_planner.cli import main
from ssm_planner.loading import load
from ssm_planner.studies.study_file import load_study
from ssm_planner.templates import (
    EXAMPLE_FILES,
    FILE_KINDS,
    FILE_REFERENCE_KEYS,
    file_keys,
    schema,
    template,
)
from tests.support.paths import ROOT

KEYS, SCHEMA, LOADED_KEYS = cache(file_keys), cache(schema), cache(load.file_keys)
"""These functions take long, and several tests call them for the same kind of file."""
LOADERS: dict[str, Callable[[Path], Any]] = {
    "problem": load.load_problem,
    "robot": load.load_robot,
    "drive": load.load_drive,
    "screw": load.load_drive,
    "motor": load.load_motor,
    "motorisation": load.load_motorisation,
    "controller": load.load_controller,
    "study": load_study,
}


@pytest.fixture(autouse=True)
def _once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(templates, "file_keys", KEYS)
    monkeypatch.setattr("ssm_planner.loading.file_keys", LOADED_KEYS)
    monkeypatch.setattr("ssm_planner.cli.files.schema", SCHEMA)


@pytest.mark.parametrize("kind", LOADERS)
def test_a_new_file_loads_as_it_stands(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.yaml"
    assert main(["new", kind, str(file)]) == 0
    assert str(file) in capsys.readouterr().out
    result = LOADERS[kind](file)
    assert result.name == "mine"
    assert max(map(len, file.read_text(encoding="utf-8").splitlines())) <= 120
    if kind in EXAMPLE_FILES:
        shipped = yaml.safe_load(
            (ROOT / f"problems/{EXAMPLE_FILES[kind]}.yaml").read_text(encoding="utf-8")
        )
        assert _by_stem(yaml.safe_load(file.read_text(encoding="utf-8"))) == _by_stem(
            {**shipped, "name": "mine"}
        )


@pytest.mark.parametrize("kind", LOADERS)
def test_a_comment_names_no_unit_beside_a_value_that_has_one(kind: str) -> None:
    """A comment in a file names no SI unit, because the value beside it has a unit of its own.

    The docstrings in Python describe the keys in SI units.
    """
    for key in KEYS(kind):
        if key.unit:
            assert not re.search(r", (rad|m|s|kg|N|V|A|K)\b[^ ,]*(\.|$)", key.description), key


def _by_stem(value: Any, reference: bool = False) -> Any:
    if isinstance(value, dict):
        return {key: _by_stem(item, key in FILE_REFERENCE_KEYS) for key, item in value.items()}
    if isinstance(value, list):
        return [_by_stem(item, reference) for item in value]
    return Path(value).stem if reference else value


@pytest.mark.parametrize("kind", LOADERS)
@pytest.mark.slow
def test_a_new_file_names_every_key_of_its_first_two_levels(kind: str) -> None:
    text = template(kind, "mine")
    keys = {key.path for key in KEYS(kind) if key.path.count(".") == 0}
    assert all(f"{key}:" in text for key in keys), text


def test_a_new_file_replaces_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("precious", encoding="utf-8")
    assert main(["new", "robot", str(file)]) == 2
    assert "the file exists and is not overwritten" in capsys.readouterr().err
    assert file.read_text(encoding="utf-8") == "precious"


@pytest.mark.parametrize("kind", FILE_KINDS)
@pytest.mark.slow
def test_the_schema_describes_every_key(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema", kind]) == 0
    schema = json.loads(capsys.readouterr().out)
    lacking: list[str] = []

    def visit(part: Any, path: str) -> None:
        if isinstance(part, dict):
            for name, entry in part.get("properties", {}).items():
                figure = {"value", "source", "placeholder"} == set(part["properties"])
                if not figure and not entry.get("description"):
                    lacking.append(f"{path}.{name}")
            for name, inner in part.items():
                visit(inner, f"{path}.{name}")
        elif isinstance(part, list):
            for inner in part:
                visit(inner, path)

    visit(schema, kind)
    assert not lacking


@pytest.mark.parametrize("kind", LOADERS)
@pytest.mark.slow
def test_the_schema_accepts_a_new_file_and_refuses_an_unknown_key(kind: str) -> None:
    validator = jsonschema.Draft202012Validator
    known = validator(SCHEMA("drive" if kind == "screw" else kind))
    data = yaml.safe_load(template(kind, "mine"))
    assert not [error.message for error in known.iter_errors(data)]
    assert [*known.iter_errors({**data, "nonsense": 1})]


@pytest.mark.slow
def test_the_page_of_keys_is_current_and_describes_every_key(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    script = runpy.run_path(str(ROOT / "docs/make_reference.py"))
    grouped = cache(script["grouped"])
    functions = {"grouped": grouped, "file_keys": LOADED_KEYS}
    for name, function in functions.items():
        monkeypatch.setitem(script["page"].__globals__, name, function)
    assert script["TARGET"].read_text(encoding="utf-8") == script["page"](), "run `make api`"
    for kind in FILE_KINDS:
        for path, rows in grouped(kind).items():
            assert all(row.description for row in rows), (kind, path)
