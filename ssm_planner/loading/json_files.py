"""JSON files, guarded: whatever their bytes are, there is data of finite numbers or one message that names the file."""

from __future__ import annotations

import codecs
import hashlib
import json
import math
import re
from pathlib import Path
from typing import IO, Any, NoReturn

import numpy as np

from ssm_planner.errors import TrajectoryError
from ssm_planner.typing import Array

IN_PARTS = 20 * 2**20
"""Bytes of a file beyond which its longest list is read in parts."""
CHUNK = 2**22
"""Bytes read at a time."""
BATCH = 4096
"""Entries of the longest list that are made numbers together."""
LARGEST_VALUE = 2**28
"""Characters of one value outside the longest list."""
_NUMBER = re.compile(r"[-+.eE0-9]*")
"""What may follow where a number is cut."""
_SPACE = re.compile(r"[ \t\n\r]*")
DEEPEST = 30
"""Levels of nesting."""
LONGEST_INTEGER = 18
"""Digits."""


def read_json(path: Path, largest: int) -> Any:
    """What a JSON file of at most `largest` bytes holds. Raises TrajectoryError naming file and fault."""
    return parse_json(path, read_bytes(path, largest))


def read_json_in_parts(path: Path, largest: int, longest: tuple[str, ...]) -> tuple[Any, str]:
    """What a JSON file holds, and its SHA-256; of a large file the list under the keys `longest` as an array.

    Its numbers then never are Python's, which take four times as much memory as an array, beside the text. Raises
    TrajectoryError naming file and fault.
    """
    if not path.is_file() or path.stat().st_size <= IN_PARTS:
        data = read_bytes(path, largest)
        return parse_json(path, data), hashlib.sha256(data).hexdigest()
    if path.stat().st_size > largest:
        read_bytes(path, largest)  # says so
    with path.open("rb") as file:
        stream = _Stream(path, file)
        try:
            found = stream.mapping(longest)
            if stream.peek():
                stream.refuse("more than one value")
        except UnicodeDecodeError as error:
            raise TrajectoryError(f"{path}: not a text file in UTF-8") from error
        except RecursionError as error:
            raise TrajectoryError(
                f"{path}: nested too deeply (allowed: {DEEPEST} levels)"
            ) from error
        except OSError as error:
            raise TrajectoryError(f"{path}: cannot be read: {error.strerror or error}") from error
    _check(path, found, 0)
    return found, stream.digest.hexdigest()


class _Stream:
    """The text of a JSON file as it comes, taken value by value."""

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        self.path, self.file = path, file
        self.decoder = _decoder(path)
        self.text, self.at, self.line = "", 0, 1
        self.digest, self.decoded = hashlib.sha256(), codecs.getincrementaldecoder("utf-8-sig")()

    def more(self) -> bool:
        """Read on, as much again as there is, so that a long value is not begun too often; False at the end."""
        data = self.file.read(max(CHUNK, len(self.text) - self.at))
        self.digest.update(data)
        self.line += self.text.count("\n", 0, self.at)
        self.text, self.at = self.text[self.at :] + self.decoded.decode(data, not data), 0
        return bool(data)

    def peek(self) -> str:
        """The next character that is no space; empty at the end."""
        while True:
            self.at = _SPACE.match(self.text, self.at).end()  # type: ignore[union-attr]
            if self.at < len(self.text) or not self.more():
                return self.text[self.at : self.at + 1]

    def take(self, allowed: str) -> str:
        """The next character, which must be one of these."""
        found = self.peek()
        if not found or found not in allowed:
            self.refuse(
                f"{found!r} where one of {allowed} is due"
                if found
                else "ends in the middle: truncated"
            )
        self.at += 1
        return found

    def value(self) -> Any:
        """The next value, whole."""
        self.peek()
        while True:
            fault = None
            try:
                found, end = self.decoder.raw_decode(self.text, self.at)
            except json.JSONDecodeError as error:
                fault, end = error, len(self.text)
            if _NUMBER.match(self.text, end).end() < len(self.text):  # type: ignore[union-attr]
                break
            if len(self.text) - self.at > LARGEST_VALUE or not self.more():
                break
        if fault is not None:
            self.refuse(fault.msg)
        self.at = end
        return found

    def mapping(self, longest: tuple[str, ...]) -> dict[str, Any]:
        """The next value, a mapping, with the list under the keys `longest` as an array."""
        self.take("{")
        found: dict[str, Any] = {}
        while self.peek() != "}" or found:
            key = self.value()
            if not isinstance(key, str):
                self.refuse("a key that is no text")
            self.take(":")
            first = self.peek()
            if (key,) == longest and first == "[":
                found[key] = self.array()
            elif key == longest[0] and len(longest) > 1 and first == "{":
                found[key] = self.mapping(longest[1:])
            else:
                found[key] = self.value()
            if self.take(",}") == "}":
                return found
        self.take("}")
        return found

    def array(self) -> Any:
        """The next value, a list of numbers or of lists of equal shape."""
        self.take("[")
        parts: list[Array] = []
        entries: list[Any] = []
        going = True
        while going:
            entries.append(self.value())
            going = self.take(",]") == ","
            if len(entries) == BATCH or not going:
                try:
                    part = np.array(entries, dtype=float)
                    if parts and part.shape[1:] != parts[0].shape[1:]:
                        raise ValueError("entries of unequal shape")
                except (OverflowError, TypeError, ValueError) as error:
                    self.refuse(f"no array of numbers: {error}")
                if not np.isfinite(part).all():
                    self.refuse(
                        "holds a number beyond 1e308, or null; only finite numbers are allowed"
                    )
                parts.append(part)
                entries = []
        return np.concatenate(parts)

    def refuse(self, fault: str) -> NoReturn:
        line = self.line + self.text.count("\n", 0, self.at)
        raise TrajectoryError(f"{self.path}:{line}: not JSON as a plan has it ({fault})")


def read_bytes(path: Path, largest: int) -> bytes:
    """A regular file of at most `largest` bytes. Raises TrajectoryError."""
    try:
        if path.is_dir():
            raise TrajectoryError(f"{path}: is a folder, not a file")
        if path.exists() and not path.is_file():
            raise TrajectoryError(f"{path}: not a regular file")
        size = path.stat().st_size
        if size > largest:
            raise TrajectoryError(
                f"{path}: {size} bytes are too many for a file of this kind (allowed: {largest})"
            )
        return path.read_bytes()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise TrajectoryError(f"{path}: cannot be read: {reason}") from error


def parse_json(path: Path, data: bytes) -> Any:
    """What JSON bytes hold; path: named in messages. Raises TrajectoryError."""

    decoder = _decoder(path)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise TrajectoryError(f"{path}:{line}: not a text file in UTF-8") from error
    try:
        found = decoder.decode(text)
    except json.JSONDecodeError as error:
        cut = error.pos >= len(text.rstrip())
        what = "ends in the middle: truncated" if cut and text.strip() else "not JSON"
        raise TrajectoryError(f"{path}:{error.lineno}: {what} ({error.msg})") from error
    except RecursionError as error:
        raise TrajectoryError(f"{path}: nested too deeply (allowed: {DEEPEST} levels)") from error
    _check(path, found, 0)
    return found


def _decoder(path: Path) -> json.JSONDecoder:
    """Of finite numbers alone."""

    def refuse(constant: str) -> NoReturn:
        raise TrajectoryError(f"{path}: holds {constant[:40]}; only finite numbers are allowed")

    def whole(digits: str) -> int:
        return (
            int(digits)
            if len(digits) <= LONGEST_INTEGER + 1
            else refuse(f"{digits[:12]}… ({len(digits)} digits)")
        )

    return json.JSONDecoder(parse_constant=refuse, parse_int=whole)


def _check(path: Path, value: Any, depth: int) -> None:
    """Raises TrajectoryError for what is nested too deeply, infinite (1e999), or text that no file can hold."""
    if isinstance(value, float):
        if not math.isfinite(value):
            raise TrajectoryError(
                f"{path}: holds a number beyond 1e308; only finite numbers are allowed"
            )
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
        raise TrajectoryError(
            f"{path}: holds a text with a character that no file can hold: {text[:40]!a}"
        )
