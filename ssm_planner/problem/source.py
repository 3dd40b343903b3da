"""Files as the user wrote them: sections of plain data that can say where each value stands."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ssm_planner.errors import ProblemError
from ssm_planner.problem.tree import Node, parse

LARGEST_FILE = 10_000_000
"""Bytes; no problem file written by hand comes near it."""


@dataclass(frozen=True)
class Section:
    """A part of a file, by the path of keys and list positions that leads to it."""

    file: Path
    root: Node
    path: tuple[str | int, ...] = ()

    @property
    def value(self) -> Any:
        return self._locate(())[1].value

    def sub(self, *path: str | int) -> Section:
        """The part below; the path need not exist (messages then point at the deepest part that does)."""
        return Section(self.file, self.root, (*self.path, *path))

    def holds(self, part: str | int) -> bool:
        """Whether there is a value under this key or list position."""
        _, node, complete = self._locate(())
        return complete and part in node.children

    def line(self, *path: str | int) -> int:
        """Line of the key that holds the value, or of the value itself in a list; counted from 1."""
        return self._locate(path)[0]

    def error(self, reason: str, *path: str | int, allowed: str | None = None, show: bool = True) -> ProblemError:
        """A ProblemError that names file, line, key path and (unless show is false) the value found there."""
        line, node, complete = self._locate(path)
        value = _written(node.value) if complete and show else None
        key = key_text((*self.path, *path)) or None
        return ProblemError(reason, file=self.file, line=line, key=key, value=value, allowed=allowed)

    def _locate(self, path: tuple[str | int, ...]) -> tuple[int, Node, bool]:
        node, line = self.root, self.root.line
        for part in (*self.path, *path):
            if part not in node.children:
                return line, node, False
            line = node.key_lines[part]
            node = node.children[part]
        return line, node, True


def key_text(path: tuple[str | int, ...]) -> str:
    """`motion[2].tilt.to` for ("motion", 2, "tilt", "to"); list positions count from 0."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else ("." if text else "") + part
    return text


def read(path: str | Path) -> Section:
    """The YAML mapping in a file. Raises ProblemError for everything that is not one readable mapping."""
    file = Path(path)
    root = parse(file, _text(file))
    if not isinstance(root.value, dict):
        raise ProblemError(
            f"the file holds {_kind(root.value)}", file=file, line=root.line, allowed="a mapping of key: value lines"
        )
    return Section(file, root)


def follow(section: Section, *path: str | int) -> Section:
    """The mapping that a key holds, or that the file named there holds (relative to the file that names it)."""
    here = section.sub(*path)
    if isinstance(here.value, dict):
        return here
    target = Path(os.path.normpath(section.file.parent / here.value))
    try:
        problem = "" if target.is_file() else "is not a file" if target.exists() else "does not exist"
    except (OSError, ValueError) as error:
        problem = f"cannot be read: {error}"
    if problem:
        raise here.error(f"the file {target} {problem}", allowed="a file, named relative to this one")
    return read(target)


def _text(file: Path) -> str:
    try:
        if file.is_dir():
            raise ProblemError("this is a directory, not a file", file=file)
        if not file.exists():
            raise ProblemError("no such file", file=file)
        if not file.is_file():
            raise ProblemError("not a regular file", file=file)
        size = file.stat().st_size
        if size > LARGEST_FILE:
            raise ProblemError(
                f"the file has {size} bytes, too large for a file of this kind", file=file, allowed="at most 10 MB"
            )
        data = file.read_bytes()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise ProblemError(f"cannot be read: {reason}", file=file) from None
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise ProblemError("not a text file in UTF-8", file=file, line=line) from None
    if not text.strip():
        raise ProblemError("the file is empty", file=file, line=1)
    return text


def _kind(value: object) -> str:
    if value is None:
        return "nothing"
    return "a list" if isinstance(value, list) else f"only the text {str(value)[:40]!r}"


def _written(value: object) -> str | None:
    """A value as the user wrote it; None for a mapping, unless it is a figure with its value."""
    if isinstance(value, dict):
        return _written(value["value"]) if "value" in value else None
    if isinstance(value, list):
        return "[" + ", ".join(_written(item) or "{…}" for item in value) + "]"
    return value if isinstance(value, str) else repr(value)
