"""Read JSON files safely.

plan.json and manifests come from other computers, so a reader must not trust them. For any content
of a file, the result is either data with finite numbers and limited nesting, or an error that names
the file and the fault. Long lists of numbers in large files are converted to arrays in parts, which
saves memory.
"""

import hashlib
import json
import math
import re
from itertools import islice, pairwise
from mmap import ACCESS_READ, mmap
from pathlib import Path
from secrets import token_hex
from typing import Any, NoReturn

import numpy as np

from ssm_planner.errors import ProblemError, TrajectoryError
from ssm_planner.loading.files import decode_text, read_file_bytes
from ssm_planner.loading.yaml_nodes import LARGEST_DEPTH
from ssm_planner.typing import Array

PARTIAL_READ_BYTES = 20 * 2**20
"""File size in bytes above which the longest list is read in parts."""
BATCH_ENTRIES = 4096
"""Number of entries of the longest list that are converted together."""
LARGEST_WHOLE_BYTES = 2**28
"""Largest size in bytes of a file that is parsed at once, that is, not in parts."""
_ENTRY_END = re.compile(rb"\]\s*\]\s*,")
"""End of an entry of the longest list. An entry is a list of lists."""
_LIST_END = re.compile(rb"\]\s*\]\s*\]")
"""End of the longest list."""
_NUMBER_LISTS = re.compile(r"[][\s0-9eE+.,-]*")
"""Text that consists only of nested lists of numbers."""
LARGEST_INTEGER_DIGITS = 18
"""Largest number of digits of an integer, which fits 64 bits."""


def read_json(path: Path, max_size: int) -> Any:
    """Read a JSON file of limited size.

    Parameters
    ----------
    path : Path
        File to read.
    max_size : int
        Largest permitted size, bytes.

    Returns
    -------
    object
        Dictionaries, lists and single values.

    Raises
    ------
    TrajectoryError
        If the file is invalid. The message names the file and the fault.
    """
    return parse_json(path, read_bytes(path, max_size))


def read_json_in_parts(path: Path, max_size: int, long_key: tuple[str, ...]) -> tuple[Any, str]:
    """Read a JSON file that may contain a long list of matrices, and compute its SHA-256.

    In a large file, this list is converted to an array in parts. Python objects for all its numbers
    would need four times the memory of the array.

    Parameters
    ----------
    path : Path
        File to read.
    max_size : int
        Largest permitted size, bytes.
    long_key : tuple of str
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
    if not path.is_file() or not PARTIAL_READ_BYTES < path.stat().st_size <= max_size:
        data = read_bytes(path, max_size)
        return parse_json(path, data), hashlib.sha256(data).hexdigest()
    try:
        with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
            return _parse_in_parts(path, content, long_key), hashlib.sha256(content).hexdigest()
    except OSError as error:
        raise TrajectoryError(f"{path}: cannot be read: {error.strerror or error}") from error


def _parse_in_parts(path: Path, data: mmap, long_key: tuple[str, ...]) -> Any:
    """Parse a JSON file, and convert its longest list to an array (n, …).

    A random mark replaces the list while the rest of the file is parsed. A file that cannot be
    split in this way is parsed as a whole. This also finds and describes faults of the file.

    Parameters
    ----------
    path : Path
        File for messages.
    data : mmap
        Content of the file.
    long_key : tuple of str
        Keys that lead to the list.

    Returns
    -------
    object
        Content of the file, in which the array replaces the list.
    """
    *outer_keys, key = long_key
    start = re.search(rb'"%b"\s*:\s*(?=\[)' % key.encode(), data)
    end = _LIST_END.search(data, start.end()) if start else None
    if not start or not end:
        return _parse_whole(path, data)
    mark = token_hex(16)
    try:
        array = _read_array(path, data, start.end() + 1, end.end() - 1)
        shortened = b'%b"%b"%b' % (data[: start.end()], mark.encode(), data[end.end() :])
        mapping = document = parse_json(path, shortened)
        for outer_key in outer_keys:
            mapping = mapping[outer_key]
        if mapping[key] != mark:  # the list is not at these keys
            return _parse_whole(path, data)
    except (LookupError, TypeError, ValueError, OverflowError, RecursionError, TrajectoryError):
        return _parse_whole(path, data)
    mapping[key] = array
    return document


def _parse_whole(path: Path, data: mmap) -> Any:
    """Parse a file at once.

    Raises TrajectoryError if the file is invalid or larger than `LARGEST_WHOLE_BYTES`.
    """
    if len(data) > LARGEST_WHOLE_BYTES:
        raise TrajectoryError(f"{path}: invalid JSON, or not in the form that this program writes")
    return parse_json(path, data[:])


def _read_array(path: Path, data: mmap, start: int, end: int) -> Array:
    """Convert a part of a file to an array in batches.

    Parameters
    ----------
    path : Path
        File for messages.
    data : mmap
        Content of the file.
    start, end : int
        Positions of the first byte of the list's entries, and after their last byte.

    Returns
    -------
    (n, …) array
        Entries of the list.

    Raises
    ------
    ValueError, TypeError, OverflowError, RecursionError, TrajectoryError
        If the entries are not lists of finite numbers with equal shapes. The caller then parses the
        whole file.
    """
    decoder = _strict_decoder(path)
    entries = _ENTRY_END.finditer(data, start, end)
    borders = [
        start,
        *(entry.end() for entry in islice(entries, BATCH_ENTRIES - 1, None, BATCH_ENTRIES)),
        end,
    ]
    batches = []
    for begin, stop in pairwise(borders):
        text = data[begin:stop].decode().rstrip().removesuffix(",")
        if _NUMBER_LISTS.fullmatch(text) is None:
            raise ValueError("not numbers")
        batch = np.array(decoder.decode(f"[{text}]"), dtype=float)
        if not np.isfinite(batch).all():
            raise ValueError("not finite")
        batches.append(batch)
    return np.concatenate(batches)


def read_bytes(path: Path, max_size: int) -> bytes:
    """Read a regular file of at most `max_size` bytes.

    Raises TrajectoryError if the file is missing, too large or unreadable.
    """
    try:
        return read_file_bytes(path, max_size)
    except ProblemError as error:
        raise TrajectoryError(str(error)) from error


def parse_json(path: Path, data: bytes) -> Any:
    """Parse the content of a JSON file.

    Parameters
    ----------
    path : Path
        File, for messages.
    data : bytes
        Content of the file.

    Returns
    -------
    object
        Dictionaries, lists and single values.

    Raises
    ------
    TrajectoryError
        If the content is invalid.
    """

    decoder = _strict_decoder(path)
    try:
        text = decode_text(path, data)
        content = decoder.decode(text)
    except ProblemError as error:
        raise TrajectoryError(str(error)) from error
    except json.JSONDecodeError as error:
        is_truncated = error.pos >= len(text.rstrip())
        fault = "the file ends early: truncated" if is_truncated and text.strip() else "not JSON"
        raise TrajectoryError(f"{path}:{error.lineno}: {fault} ({error.msg})") from error
    except RecursionError as error:
        raise TrajectoryError(
            f"{path}: nested too deeply (allowed: {LARGEST_DEPTH} levels)"
        ) from error
    _check_json_value(path, content, 0)
    return content


def _strict_decoder(path: Path) -> json.JSONDecoder:
    """Return a JSON decoder that refuses NaN, infinity and integers with too many digits.

    Parameters
    ----------
    path : Path
        File that the error messages of the decoder name.

    Returns
    -------
    json.JSONDecoder
        Decoder that raises TrajectoryError for these values.
    """

    def refuse(constant: str) -> NoReturn:
        raise TrajectoryError(f"{path}: contains {constant[:40]}; only finite numbers are allowed")

    def parse_integer(digits: str) -> int:
        if len(digits) <= LARGEST_INTEGER_DIGITS + 1:
            return int(digits)
        return refuse(f"{digits[:12]}… ({len(digits)} digits)")

    return json.JSONDecoder(parse_constant=refuse, parse_int=parse_integer)


def _check_json_value(path: Path, value: Any, depth: int) -> None:
    """Raise TrajectoryError if a value is nested too deeply, not finite, or contains invalid text.

    The parser reads a number such as 1e999 as infinity without an error, so that the values must be
    checked afterwards.

    Parameters
    ----------
    path : Path
        File for messages.
    value : object
        Value that the parser has returned.
    depth : int
        Number of levels above the value.
    """
    if isinstance(value, float):
        if not math.isfinite(value):
            raise TrajectoryError(
                f"{path}: contains a number beyond 1e308; only finite numbers are allowed"
            )
        return
    if depth > LARGEST_DEPTH:
        raise TrajectoryError(f"{path}: nested too deeply (allowed: {LARGEST_DEPTH} levels)")
    if isinstance(value, str):
        check_characters(path, value)
    elif isinstance(value, dict):
        for key, item in value.items():
            check_characters(path, key)
            _check_json_value(path, item, depth + 1)
    elif isinstance(value, list):
        for item in value:
            _check_json_value(path, item, depth + 1)


def check_characters(path: Path, text: str) -> None:
    """Raise TrajectoryError if a text contains a NUL or an unpaired surrogate.

    Neither files nor file names can contain these characters. The error names the file `path`.
    """
    if any("\ud800" <= character <= "\udfff" or character == "\0" for character in text):
        raise TrajectoryError(
            f"{path}: contains text with a character that no file can contain: {text[:40]!a}"
        )
