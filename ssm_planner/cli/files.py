"""`ssm-planner schema KIND` and `ssm-planner new KIND`: keys of files, and templates."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import yaml

from ssm_planner.cli.shared import OK
from ssm_planner.errors import ExportError

if TYPE_CHECKING:
    from ssm_planner.loading.schema import Key

KINDS = ("problem", "robot", "drive", "motor", "motorisation", "controller", "study")
EXAMPLES = {
    "problem": "tilt_insert",
    "robot": "robots/vitreoretinal",
    "drive": "drives/vitreoretinal_joint1_worm",
    "screw": "drives/vitreoretinal_joint4_screw",
    "motor": "motors/maxon_ecx_speed_13_m",
    "motorisation": "motorisation/package",
    "controller": "controllers/epos4",
}
"""Shipped files that provide the figures of templates."""
STUDY = {
    "robot": "vitreoretinal",
    "motions": ["tilt_insert"],
    "vary": {"geometry.alpha": {"from": "28 deg", "to": "34 deg"}},
    "require": {"reach": ["-135 deg", "-85 deg"], "self_locking": True},
    "minimise": ["duration", "motor_margin"],
    "search": {"method": "sobol", "points": 64},
}
REFERENCES = ("robot", "drive", "motor", "alternatives")
COLUMN, WIDTH = 44, 116


def schema_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("kind", choices=KINDS, help="kind of file")


def run_schema(options: argparse.Namespace) -> int:
    print(json.dumps(schema(options.kind), indent=1, ensure_ascii=False))
    return OK


def new_arguments(parser: argparse.ArgumentParser) -> None:
    kinds = *EXAMPLES, "study"
    parser.add_argument(
        "kind", choices=kinds, help="kind of file (drive: worm gear, screw: lead screw)"
    )
    parser.add_argument(
        "file", type=Path, nargs="?", help="file to write (default: on stdout); it must not exist"
    )


def run_new(options: argparse.Namespace) -> int:
    name = options.file.stem if options.file is not None else f"my_{options.kind}"
    text = template(options.kind, name)
    if options.file is None:
        print(text, end="")
        return OK
    from ssm_planner.atomic import replacing

    if options.file.exists():
        raise ExportError(
            f"{options.file}: the file exists and is not overwritten: name another file"
        )
    with replacing(options.file) as temporary:
        temporary.write_text(text, encoding="utf-8")
    print(f"file: {options.file}")
    return OK


def schema(kind: str) -> dict[str, Any]:
    """Return the JSON schema of a kind of file."""
    from ssm_planner.loading.load import json_schema
    from ssm_planner.studies.study_file import StudyModel

    document = StudyModel.model_json_schema() if kind == "study" else json_schema(kind)  # type: ignore[arg-type]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **document,
        "title": f"ssm_planner {kind} file",
    }


def file_keys(kind: str) -> tuple[Key, ...]:
    """Return every key of a kind of file. drive means worm gears and screw means lead screws."""
    from ssm_planner.loading.drives import drive_model
    from ssm_planner.loading.load import file_keys
    from ssm_planner.loading.schema import keys
    from ssm_planner.studies.study_file import StudyModel

    models = {"drive": drive_model("worm"), "screw": drive_model("lead_screw"), "study": StudyModel}
    return tuple(keys(models[kind])) if kind in models else file_keys(kind)  # type: ignore[arg-type]


def template(kind: str, name: str) -> str:
    """Return a valid file of this kind, in which optional keys are comments."""
    from ssm_planner.loading.files import read, shipped_folder

    known = {key.path: key for key in file_keys(kind)}
    data = STUDY if kind == "study" else read(shipped_folder() / f"{EXAMPLES[kind]}.yaml").value
    figures = (
        "an example study" if kind == "study" else f"the figures of the shipped {EXAMPLES[kind]}"
    )
    kind = "drive" if kind == "screw" else kind
    head = [
        f"# A {kind} file with {figures}. Replace them with yours.",
        "# Text after # is a comment. Keys in comments are optional. Every figure has its unit.",
        f"# Editors can complete and check it with the output of `ssm-planner schema {kind}`.",
    ]
    writer = _Writer(known)
    return "\n".join([*head, *writer.mapping({"name": name} | data | {"name": name}, "", 0)]) + "\n"


class _Writer:
    """Writer of YAML lines that describes each key at its first occurrence."""

    def __init__(self, known: Mapping[str, Key]) -> None:
        self.known = known
        self.said: set[str] = set()

    def mapping(self, data: Mapping[str, Any], path: str, depth: int) -> Iterator[str]:
        """Yield the given keys, and the optional ones as comments."""
        for name, value in data.items():
            yield from self._entry(name, value, path, depth)
        for place, key in self.known.items():
            name = place[len(path) :]
            if place.startswith(path) and "." not in name and name not in data and self._new(place):
                default = (
                    f" {key.default}"
                    if key.default not in ("", "required")
                    else f" … {key.unit}".rstrip()
                )
                yield _commented(f"{'  ' * depth}# {name}:{default}", key)

    def _entry(self, name: str, value: Any, path: str, depth: int) -> Iterator[str]:
        pad, inside = "  " * depth, f"{path}{name}"
        key = self.known.get(inside) if self._new(inside) else None
        if isinstance(value, dict) and any(place.startswith(f"{inside}.") for place in self.known):
            yield _commented(f"{pad}{name}:", key)
            yield from self.mapping(value, f"{inside}.", depth + 1)
            return
        if isinstance(value, list) and value and isinstance(value[0], dict):
            yield _commented(f"{pad}{name}:", key)
            for entry in value:
                first, *rest = self.mapping(entry, f"{inside}[].", depth + 2)
                yield from (f"{pad}  - {first.lstrip()}", *rest)
            return
        yield _commented(f"{pad}{name}: {_flow(value, name in REFERENCES)}", key)

    def _new(self, path: str) -> bool:
        """Return True if a key was not described yet. Revolute joints share their keys."""
        place = (
            re.sub(r"\b(tilt|spin)\.", "roll.", path)
            if path.startswith(("joints.", "compliance."))
            else path
        )
        self.said, before = self.said | {place}, place in self.said
        return not before


def _commented(line: str, key: Key | None) -> str:
    """Return the line with the meaning of its key beside it, or above it if the text is long."""
    if key is None:
        return line
    allowed = "" if key.allowed in ("", "a text") else f" ({key.allowed})"
    text = f"{key.description}{allowed}"
    if len(line) < COLUMN and COLUMN + len(text) < WIDTH:
        return f"{line.ljust(COLUMN)}# {text}"
    pad = " " * (len(line) - len(line.lstrip()))
    return "\n".join(
        [*wrap(text, WIDTH, initial_indent=f"{pad}# ", subsequent_indent=f"{pad}# "), line]
    )


def _flow(value: Any, reference: bool = False, inside: bool = False) -> str:
    """Return a value on one line.

    Shipped files are given by name because names work in any folder.
    """
    if isinstance(value, dict):
        return (
            "{"
            + ", ".join(
                f"{key}: {_flow(item, key in REFERENCES, True)}" for key, item in value.items()
            )
            + "}"
        )
    if isinstance(value, list):
        return "[" + ", ".join(_flow(item, reference, True) for item in value) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    text = Path(value).stem if reference else str(value)
    read_back = yaml.safe_load(f"[{text}]")[0] if inside else yaml.safe_load(f"key: {text}")["key"]
    same = str(read_back) == text or isinstance(value, float)
    return text if same and not (inside and "," in text) else json.dumps(text, ensure_ascii=False)
