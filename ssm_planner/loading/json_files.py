"""Read JSON files safely.

For any content of a file, the result is either data with finite numbers or an error that names the
file and the fault.
"""

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
from ssm_planner.typing import Array, JsonObject

IN_PARTS = 20 * 2**20
"""File size in bytes above which the longest list is read in parts."""
CHUNK = 2**22
"""Number of bytes per read."""
BATCH = 4096
"""Number of entries of the longest list that are converted together."""
LARGEST_VALUE = 2**28
"""Largest number of characters of a value outside the longest list."""
_NUMBER = re.compile(r"[-+.eE0-9]*")
"""Characters that may continue a number at the end of a chunk."""
_SPACE = re.compile(r"[ \t\n\r]*")
DEEPEST = 30
"""Largest number of nested levels."""
LONGEST_INTEGER = 18
"""Largest number of digits of an integer."""


def read_json(path: Path, max_size: int) -> Any:
    """Read a JSON file of at most `max_size` bytes.

    Raises TrajectoryError, which names the file and the fault, if the file is invalid.
    """
    return parse_json(path, read_bytes(path, max_size))


def read_json_in_parts(path: Path, max_size: int, long_key: tuple[str, ...]) -> tuple[Any, str]:
    """Read a JSON file that may contain a long list of numbers, and compute its SHA-256.

    The list of a large file is converted to an array in parts. Python objects for all its numbers
    would need four times the memory of the array.

    Parameters
    ----------
    path : Path
        File to read.
    max_size : int
        Largest permitted size, bytes.
    long_key : tuple[str, ...]
        Keys that lead to the long list.

    Returns
    -------
    content
        Content of the file.
    sha256 : str
        Hash of the file.

    Raises
    ------
    TrajectoryError
        If the file is invalid. The message names the file and the fault.
    """
    if not path.is_file() or path.stat().st_size <= IN_PARTS:
        data = read_bytes(path, max_size)
        return parse_json(path, data), hashlib.sha256(data).hexdigest()
    if path.stat().st_size > max_size:
        read_bytes(path, max_size)  # raises the appropriate error
    with path.open("rb") as file:
        stream = _Stream(path, file)
        try:
            content = stream.mapping(long_key)
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
    _check(path, content, 0)
    return content, stream.digest.hexdigest()


class _Stream:
    """Incremental parser of a JSON file."""

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        self.path = path
        self.file = file
        self.decoder = _decoder(path)
        self.text = ""
        self.at = 0
        self.line = 1
        self.digest = hashlib.sha256()
        self.decoded = codecs.getincrementaldecoder("utf-8-sig")()

    def read_more(self) -> bool:
        """Read more text into the buffer. Returns False at the end of the file.

        The size of the buffer doubles, so that long values are rarely parsed twice.
        """
        data = self.file.read(max(CHUNK, len(self.text) - self.at))
        self.digest.update(data)
        self.line += self.text.count("\n", 0, self.at)
        self.text = self.text[self.at :] + self.decoded.decode(data, not data)
        self.at = 0
        return bool(data)

    def peek(self) -> str:
        """Return the next character that is not a space, or "" at the end."""
        while True:
            self.at = _SPACE.match(self.text, self.at).end()  # type: ignore[union-attr]
            if self.at < len(self.text) or not self.read_more():
                return self.text[self.at : self.at + 1]

    def take(self, allowed: str) -> str:
        """Consume and return the next character. It must be one of the allowed characters."""
        character = self.peek()
        if not character or character not in allowed:
            self.refuse(
                f"{character!r} instead of one of {allowed}"
                if character
                else "the file ends early: truncated"
            )
        self.at += 1
        return character

    def value(self) -> Any:
        """Consume and return the next value."""
        self.peek()
        while True:
            fault = None
            try:
                value, end = self.decoder.raw_decode(self.text, self.at)
            except json.JSONDecodeError as error:
                fault = error
                end = len(self.text)
            if _NUMBER.match(self.text, end).end() < len(self.text):  # type: ignore[union-attr]
                break
            if len(self.text) - self.at > LARGEST_VALUE or not self.read_more():
                break
        if fault is not None:
            self.refuse(fault.msg)
        self.at = end
        return value

    def mapping(self, long_key: tuple[str, ...]) -> JsonObject:
        """Consume and return the next mapping, in which the long list becomes an array."""
        self.take("{")
        mapping: JsonObject = {}
        while self.peek() != "}" or mapping:
            key = self.value()
            if not isinstance(key, str):
                self.refuse("a key is not text")
            self.take(":")
            character = self.peek()
            if (key,) == long_key and character == "[":
                mapping[key] = self.array()
            elif key == long_key[0] and len(long_key) > 1 and character == "{":
                mapping[key] = self.mapping(long_key[1:])
            else:
                mapping[key] = self.value()
            if self.take(",}") == "}":
                return mapping
        self.take("}")
        return mapping

    def array(self) -> Any:
        """Consume the next list and return it as an array.

        The list contains numbers, or lists of equal shape.
        """
        self.take("[")
        batches: list[Array] = []
        entries: list[Any] = []
        going = True
        while going:
            entries.append(self.value())
            going = self.take(",]") == ","
            if len(entries) == BATCH or not going:
                try:
                    batch = np.array(entries, dtype=float)
                    if batches and batch.shape[1:] != batches[0].shape[1:]:
                        raise ValueError("entries have different shapes")
                except (OverflowError, TypeError, ValueError) as error:
                    self.refuse(f"not an array of numbers: {error}")
                if not np.isfinite(batch).all():
                    self.refuse(
                        "contains a number beyond 1e308, or null; only finite numbers are allowed"
                    )
                batches.append(batch)
                entries = []
        return np.concatenate(batches)

    def refuse(self, fault: str) -> NoReturn:
        line = self.line + self.text.count("\n", 0, self.at)
        raise TrajectoryError(f"{self.path}:{line}: invalid JSON ({fault})")


def read_bytes(path: Path, max_size: int) -> bytes:
    """Return the content of a regular file of at most `max_size` bytes.

    Raises TrajectoryError if the file is missing, too large or unreadable.
    """
    try:
        if path.is_dir():
            raise TrajectoryError(f"{path}: is a folder, not a file")
        if path.exists() and not path.is_file():
            raise TrajectoryError(f"{path}: not a regular file")
        size = path.stat().st_size
        if size > max_size:
            raise TrajectoryError(
                f"{path}: {size} bytes are too many for this kind of file (allowed: {max_size})"
            )
        return path.read_bytes()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise TrajectoryError(f"{path}: cannot be read: {reason}") from error


def parse_json(path: Path, data: bytes) -> Any:
    """Parse the content of a JSON file.

    Raises TrajectoryError, which names the file `path`, if the content is invalid.
    """

    decoder = _decoder(path)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise TrajectoryError(f"{path}:{line}: not a text file in UTF-8") from error
    try:
        content = decoder.decode(text)
    except json.JSONDecodeError as error:
        cut = error.pos >= len(text.rstrip())
        fault = "the file ends early: truncated" if cut and text.strip() else "not JSON"
        raise TrajectoryError(f"{path}:{error.lineno}: {fault} ({error.msg})") from error
    except RecursionError as error:
        raise TrajectoryError(f"{path}: nested too deeply (allowed: {DEEPEST} levels)") from error
    _check(path, content, 0)
    return content


def _decoder(path: Path) -> json.JSONDecoder:
    """Return a decoder that accepts finite numbers only."""

    def refuse(constant: str) -> NoReturn:
        raise TrajectoryError(f"{path}: contains {constant[:40]}; only finite numbers are allowed")

    def parse_integer(digits: str) -> int:
        if len(digits) <= LONGEST_INTEGER + 1:
            return int(digits)
        return refuse(f"{digits[:12]}… ({len(digits)} digits)")

    return json.JSONDecoder(parse_constant=refuse, parse_int=parse_integer)


def _check(path: Path, value: Any, depth: int) -> None:
    """Raise TrajectoryError if a value is nested too deeply, not finite, or contains invalid text.

    A number such as 1e999 is not finite.
    """
    if isinstance(value, float):
        if not math.isfinite(value):
            raise TrajectoryError(
                f"{path}: contains a number beyond 1e308; only finite numbers are allowed"
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
    """Raise TrajectoryError for half a surrogate pair or a NUL, which no file or name can
    contain.
    """
    if any("\ud800" <= character <= "\udfff" or character == "\0" for character in text):
        raise TrajectoryError(
            f"{path}: contains text with a character that no file can contain: {text[:40]!a}"
        )
