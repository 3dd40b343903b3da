"""Write JSON schemas of the YAML files, and templates in which a comment describes every key.

Users of the program begin with a template (`template`). Editors complete and check the files with a
schema (`schema`). Both use the descriptions of the keys in the package `loading`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import yaml

from ssm_planner.arguments import checked
from ssm_planner.problem import check_name
from ssm_planner.typing import JsonObject

if TYPE_CHECKING:
    from ssm_planner.loading import Key

FILE_KINDS = ("problem", "robot", "drive", "motor", "motorisation", "controller", "study")
"""Kinds of YAML files that have a JSON schema."""
EXAMPLE_FILES = {
    "problem": "tilt_insert",
    "robot": "robots/vitreoretinal",
    "drive": "drives/vitreoretinal_joint1_worm",
    "screw": "drives/vitreoretinal_joint4_screw",
    "motor": "motors/maxon_ecx_speed_13_m",
    "motorisation": "motorisation/package",
    "controller": "controllers/epos4",
    "study": "studies/geometry",
}
"""Shipped files whose values appear in the templates, by the kind of template."""
FILE_REFERENCE_KEYS = ("robot", "drive", "motor", "alternatives")
"""Keys whose values are names of files."""
COMMENT_COLUMN, LINE_WIDTH = 44, 116
"""Column at which comments begin, and largest width of a line with a comment, characters."""


@checked
def schema(kind: str) -> JsonObject:
    """Return the JSON schema of a kind of YAML file, as JSON types.

    Parameters
    ----------
    kind : str
        "problem", "robot", "drive", "motor", "motorisation", "controller" or "study".

    Returns
    -------
    dict
        The schema.

    Raises
    ------
    ProblemError
        If the kind is unknown.

    Examples
    --------
    >>> import ssm_planner
    >>> ssm_planner.schema("motor")["title"]
    'ssm_planner motor file'
    """
    check_name(kind, FILE_KINDS, "kind", "unknown kind of file")
    from ssm_planner.loading import json_schema
    from ssm_planner.studies.study_file import StudyModel

    is_study = kind == "study"
    document = StudyModel.model_json_schema() if is_study else json_schema(kind)  # type: ignore
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **document,
        "title": f"ssm_planner {kind} file",
    }


def file_keys(kind: str) -> tuple[Key, ...]:
    """Return every key of a kind of file with its description.

    Parameters
    ----------
    kind : str
        Kind of file. "drive" means the drive file of a worm gear, and "screw" that of a lead screw.

    Returns
    -------
    tuple of Key
        The keys, whose paths contain dots, such as "joints.roll.velocity", and "[]" for each entry
        of a list.
    """
    from ssm_planner.loading import describe_keys, drive_model, file_keys
    from ssm_planner.studies.study_file import StudyModel

    models = {"drive": drive_model("worm"), "screw": drive_model("lead_screw"), "study": StudyModel}
    if kind in models:
        return tuple(describe_keys(models[kind]))
    return file_keys(kind)  # type: ignore[arg-type]


@checked
def template(kind: str, name: str) -> str:
    """Return the text of a valid YAML file, in which optional keys are comments.

    Parameters
    ----------
    kind : str
        "problem", "robot", "drive" (a worm gear), "screw" (a lead screw), "motor", "motorisation",
        "controller" or "study".
    name : str
        Value of the key `name`.

    Returns
    -------
    str
        Text of the file.

    Raises
    ------
    ProblemError
        If the kind is unknown.

    Examples
    --------
    >>> import ssm_planner
    >>> print(ssm_planner.template("motor", "mine").splitlines()[3].split("#")[0].strip())
    name: mine
    """
    check_name(kind, tuple(EXAMPLE_FILES), "kind", "unknown kind of file")
    from ssm_planner.loading import read_section, shipped_folder

    keys = {key.path: key for key in file_keys(kind)}
    example = EXAMPLE_FILES[kind]
    data = read_section(shipped_folder() / f"{example}.yaml").value
    kind = "drive" if kind == "screw" else kind
    lines = [
        f"# A {kind} file with the figures of the shipped {example}. Replace them with yours.",
        "# Text after # is a comment. Keys in comments are optional. Every figure has its unit.",
        f"# Editors can complete and check it with the output of `ssm-planner schema {kind}`.",
    ]
    # The first "name" puts the key at the top, and the second replaces the name of the example.
    lines += _TemplateWriter(keys).mapping({"name": name} | data | {"name": name}, "", 0)
    return "\n".join(lines) + "\n"


class _TemplateWriter:
    """Writer of a YAML template that describes each key at its first occurrence.

    Parameters
    ----------
    keys : mapping
        Descriptions of the keys of a file by the path of the key.
    """

    def __init__(self, keys: Mapping[str, Key]) -> None:
        self.keys = keys
        self.described: set[str] = set()

    def mapping(self, data: JsonObject, parent: str, depth: int) -> Iterator[str]:
        """Yield the lines of a mapping: its keys, and then the other possible keys as comments.

        Parameters
        ----------
        data : dict
            Content of the mapping.
        parent : str
            Path of the mapping with a final dot, or "" for the whole file.
        depth : int
            Level of indentation.

        Yields
        ------
        str
            Lines of YAML without newlines at their ends.
        """
        for name, value in data.items():
            yield from self._entry(name, value, parent, depth)
        for path, key in self.keys.items():
            name = path[len(parent) :]
            is_child = path.startswith(parent) and "." not in name
            if is_child and name not in data and self._describe(path):
                default = f" {key.default}"
                if key.default in ("", "required"):
                    default = f" … {key.unit}".rstrip()
                yield _add_comment(f"{'  ' * depth}# {name}:{default}", key)

    def _entry(self, name: str, value: Any, parent: str, depth: int) -> Iterator[str]:
        """Yield the lines of one key and of the mappings below it.

        Parameters
        ----------
        name : str
            Name of the key.
        value : object
            Value of the key as YAML data.
        parent : str
            Path of the mapping that contains the key, with a final dot, or "" for the whole file.
        depth : int
            Level of indentation.

        Yields
        ------
        str
            Lines of YAML without newlines at their ends.
        """
        pad, path = "  " * depth, f"{parent}{name}"
        key = self.keys.get(path) if self._describe(path) else None
        if isinstance(value, dict) and any(other.startswith(f"{path}.") for other in self.keys):
            yield _add_comment(f"{pad}{name}:", key)
            yield from self.mapping(value, f"{path}.", depth + 1)
            return
        if isinstance(value, list) and value and isinstance(value[0], dict):
            yield _add_comment(f"{pad}{name}:", key)
            for item in value:
                lines = list(self.mapping(item, f"{path}[].", depth + 2))
                yield f"{pad}  - {lines[0].lstrip()}"
                yield from lines[1:]
            return
        yield _add_comment(f"{pad}{name}: {_flow_text(value, name in FILE_REFERENCE_KEYS)}", key)

    def _describe(self, path: str) -> bool:
        """Return True if a key still needs a description, and mark it as described.

        The three revolute joints share the descriptions of their keys, so only those of the first
        joint are written.

        Parameters
        ----------
        path : str
            Path of the key.
        """
        if path.startswith(("joints.", "compliance.")):
            path = re.sub(r"\b(tilt|spin)\.", "roll.", path)
        is_new = path not in self.described
        self.described.add(path)
        return is_new


def _add_comment(line: str, key: Key | None) -> str:
    """Add the description of a key to a line of YAML as a comment.

    The comment is at the end of the line if both are short enough, and otherwise above the line.

    Parameters
    ----------
    line : str
        Line of YAML.
    key : Key or None
        Key to describe. None leaves the line unchanged.

    Returns
    -------
    str
        One or more lines.
    """
    if key is None:
        return line
    allowed = "" if key.allowed in ("", "a text") else f" ({key.allowed})"
    text = f"{key.description}{allowed}"
    if len(line) < COMMENT_COLUMN and COMMENT_COLUMN + len(text) < LINE_WIDTH:
        return f"{line.ljust(COMMENT_COLUMN)}# {text}"
    pad = " " * (len(line) - len(line.lstrip()))
    comments = wrap(text, LINE_WIDTH, initial_indent=f"{pad}# ", subsequent_indent=f"{pad}# ")
    return "\n".join(comments + [line])


def _flow_text(value: Any, reference: bool = False, nested: bool = False) -> str:
    """Format a value in YAML's flow style, that is, on one line with brackets and braces.

    Text that YAML would read as another value, such as "yes", gets quotes.

    Parameters
    ----------
    value : object
        Value as YAML data.
    reference : bool
        True if the value is the path of a shipped file. Only the name of the file is written,
        because the name is valid in any folder.
    nested : bool
        True for a value within a list or mapping.

    Returns
    -------
    str
        Text of the value.
    """
    if isinstance(value, dict):
        items = [
            f"{key}: {_flow_text(item, key in FILE_REFERENCE_KEYS, True)}"
            for key, item in value.items()
        ]
        return "{" + ", ".join(items) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(_flow_text(item, reference, True) for item in value) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    text = Path(value).stem if reference else str(value)
    # Text that YAML would read as another value needs quotes.
    document = f"key: [{text}]" if nested else f"key: {text}"
    value_read = yaml.safe_load(document)["key"]
    read_back = value_read[0] if nested else value_read
    is_same = str(read_back) == text or isinstance(value, float)
    if is_same and not (nested and "," in text):
        return text
    return json.dumps(text, ensure_ascii=False)
