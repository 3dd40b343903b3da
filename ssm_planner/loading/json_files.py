"""JSON files, guarded: whatever their bytes are, there is data of finite numbers or one message that names the file."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, NoReturn

from ssm_planner.errors import TrajectoryError

DEEPEST = 30
"""Levels of nesting."""
LONGEST_INTEGER = 18
"""Digits."""


def read_json(path: Path, largest: int) -> Any:
    """What a JSON file of at most `largest` bytes holds. Raises TrajectoryError naming file and fault."""
    return parse_json(path, read_bytes(path, largest))


def read_bytes(path: Path, largest: int) -> bytes:
    """A regular file of at most `largest` bytes. Raises TrajectoryError."""
    try:
        if path.is_dir():
            raise TrajectoryError(f"{path}: is a folder, not a file")
        if path.exists() and not path.is_file():
            raise TrajectoryError(f"{path}: not a regular file")
        size = path.stat().st_size
        if size > largest:
            raise TrajectoryError(f"{path}: {size} bytes are too many for a file of this kind (allowed: {largest})")
        return path.read_bytes()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise TrajectoryError(f"{path}: cannot be read: {reason}") from error


def parse_json(path: Path, data: bytes) -> Any:
    """What JSON bytes hold; path: named in messages. Raises TrajectoryError."""

    def refuse(constant: str) -> NoReturn:
        raise TrajectoryError(f"{path}: holds {constant[:40]}; only finite numbers are allowed")

    def whole(digits: str) -> int:
        return int(digits) if len(digits) <= LONGEST_INTEGER + 1 else refuse(f"{digits[:12]}… ({len(digits)} digits)")

    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise TrajectoryError(f"{path}:{line}: not a text file in UTF-8") from error
    try:
        found = json.loads(text, parse_constant=refuse, parse_int=whole)
    except json.JSONDecodeError as error:
        cut = error.pos >= len(text.rstrip())
        what = "ends in the middle: truncated" if cut and text.strip() else "not JSON"
        raise TrajectoryError(f"{path}:{error.lineno}: {what} ({error.msg})") from error
    except RecursionError as error:
        raise TrajectoryError(f"{path}: nested too deeply (allowed: {DEEPEST} levels)") from error
    _check(path, found, 0)
    return found


def _check(path: Path, value: Any, depth: int) -> None:
    """Raises TrajectoryError for what is nested too deeply, infinite (1e999), or text that no file can hold."""
    if isinstance(value, float):
        if not math.isfinite(value):
            raise TrajectoryError(f"{path}: holds a number beyond 1e308; only finite numbers are allowed")
        return
    if depth > DEEPEST:
        raise TrajectoryError(f"{path}: nested too deeply (allowed: {DEEPEST} levels)")
    if isinstance(value, str):
        check_text(path, value)
    elif isinstance(value, dict):
        for key, item in value.items():
            check_text(path, key)
            _check(path, item, depth + 1)
    elif isinstance(value, list):
        for item in value:
            _check(path, item, depth + 1)


def check_text(path: Path, text: str) -> None:
    """Raises TrajectoryError for a text with half a surrogate pair or a NUL: no name or file can hold it."""
    if any("\ud800" <= character <= "\udfff" or character == "\0" for character in text):
        raise TrajectoryError(f"{path}: holds a text with a character that no file can hold: {text[:40]!a}")
