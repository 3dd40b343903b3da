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
from array import array
from pathlib import Path
from secrets import token_hex
from typing import Any, BinaryIO, NoReturn

import numpy as np
from pydantic_core import from_json

from ssm_planner.errors import ProblemError, TrajectoryError
from ssm_planner.loading.files import decode_text, read_file_bytes
from ssm_planner.loading.yaml_nodes import LARGEST_DEPTH
from ssm_planner.publishing import sha256_of_open_file

PARTIAL_READ_BYTES = 20 * 2**20
"""File size in bytes above which the longest list is read in parts."""
BATCH_BYTES = 2**20
"""Number of bytes of the longest list that are converted together."""
LARGEST_WHOLE_BYTES = 2**28
"""Largest size in bytes of a file that is parsed at once, and of the rest of a larger file."""
_LAST_ENTRY_END = re.compile(rb".*\]\s*\]\s*(?=,)", re.DOTALL)
"""Text up to the end of the last complete entry of the longest list. An entry is a matrix."""
_LIST_END = re.compile(rb"\]\s*\]\s*(?=\])")
"""End of the last entry of the longest list."""
_NUMBER_MARKS = bytes.maketrans(b"0123456789+-.eE", b"d" * 15)
"""Translation of every character of a number to the same letter."""
_NO_BRACKETS = bytes.maketrans(b"[]", b"  ")
"""Translation of brackets to spaces."""
_FORBIDDEN_CHARACTER = re.compile("[\0\ud800-\udfff]")
"""NUL, or an unpaired surrogate."""
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


def read_json_in_parts(
    path: Path, max_size: int, long_key: tuple[str, ...], shape: tuple[int, int]
) -> tuple[Any, str]:
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
    shape : (int, int)
        Numbers of rows and columns of each matrix.

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
        with path.open("rb") as file:
            try:
                content = _parse_in_parts(path, file, long_key, shape)
            except (LookupError, TypeError, ValueError, TrajectoryError) as error:
                if path.stat().st_size > LARGEST_WHOLE_BYTES:
                    raise TrajectoryError(
                        f"{path}: invalid JSON, or not in the form that this program writes"
                    ) from error
                # The complete text also shows the faults of the file.
                file.seek(0)
                content = parse_json(path, file.read())
            # Another program may have replaced the file, so its path is not opened again.
            return content, sha256_of_open_file(file)
    except OSError as error:
        raise TrajectoryError(f"{path}: cannot be read: {error.strerror or error}") from error


def _parse_in_parts(
    path: Path, file: BinaryIO, long_key: tuple[str, ...], shape: tuple[int, int]
) -> Any:
    """Parse a JSON file, and convert its longest list to an array (n, rows, columns).

    A random mark replaces the list while the rest of the file is parsed.

    Parameters
    ----------
    path : Path
        File for messages.
    file : binary file
        The file, open for reading.
    long_key : tuple of str
        Keys that lead to the list.
    shape : (int, int)
        Numbers of rows and columns of each matrix.

    Returns
    -------
    object
        Content of the file, in which the array replaces the list.

    Raises
    ------
    LookupError, TypeError, ValueError, TrajectoryError
        If the file cannot be split in this way. The caller then parses it as a whole.
    """
    *outer_keys, key = long_key
    opening = re.compile(rb'"%b"\s*:\s*\[' % key.encode())
    before = b""
    while not (start := opening.search(before)):
        # Every block doubles the text, so the time of all searches is proportional to its length.
        before += _read_more(file, BATCH_BYTES + len(before))
    numbers = array("d")
    text = before[start.end() :]
    while not (end := _LIST_END.search(text)):
        if part := _LAST_ENTRY_END.match(text):
            numbers.frombytes(_matrix_numbers(part[0], shape))
            text = text[part.end() + 1 :]  # without the comma
        text += _read_more(file, BATCH_BYTES)
    numbers.frombytes(_matrix_numbers(text[: end.end()], shape))
    mark = token_hex(16)
    rest = text[end.end() + 1 :] + file.read(LARGEST_WHOLE_BYTES)
    mapping = document = parse_json(
        path, b'%b"%b"%b' % (before[: start.end() - 1], mark.encode(), rest)
    )
    for outer_key in outer_keys:
        mapping = mapping[outer_key]
    if mapping[key] != mark:
        raise ValueError("the list is not at these keys")
    mapping[key] = np.frombuffer(numbers).reshape(-1, *shape)
    return document


def _read_more(file: BinaryIO, size: int) -> bytes:
    """Read the next bytes of a file. Raises ValueError at its end, or if the size is too large."""
    block = file.read(size)
    if not block or size > LARGEST_WHOLE_BYTES:
        raise ValueError("no long list")
    return block


def _matrix_numbers(text: bytes, shape: tuple[int, int]) -> bytes:
    """Convert matrices in JSON to the bytes of their numbers.

    Parameters
    ----------
    text : bytes
        Matrices, separated by commas.
    shape : (int, int)
        Numbers of rows and columns of each matrix.

    Returns
    -------
    bytes
        Floats in native byte order, matrix by matrix and row by row.

    Raises
    ------
    ValueError
        If the text is not a sequence of matrices of finite numbers with this shape.
    """
    rows, columns = shape
    row = b"[%b]" % (b"," * (columns - 1))
    matrix = b"[%b]" % b",".join([row] * rows)
    # In this text, the letter d stands for every character of a number.
    marked = text.translate(_NUMBER_MARKS, b" \t\r\n")
    brackets = marked.translate(None, b"d")
    count = (len(brackets) + 1) // (len(matrix) + 1)
    if brackets != b",".join([matrix] * count) or b"d[" in marked or b"]d" in marked:
        raise ValueError("not matrices of this shape")
    numbers = np.array(from_json(b"[%b]" % text.translate(_NO_BRACKETS)))
    if numbers.dtype != float or not np.isfinite(numbers).all():
        raise ValueError("not finite floats")
    return numbers.tobytes()


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
            if type(item) is not float or not math.isfinite(item):
                _check_json_value(path, item, depth + 1)


def check_characters(path: Path, text: str) -> None:
    """Raise TrajectoryError if a text contains a NUL or an unpaired surrogate.

    Neither files nor file names can contain these characters. The error names the file `path`.
    """
    if _FORBIDDEN_CHARACTER.search(text):
        raise TrajectoryError(
            f"{path}: contains text with a character that no file can contain: {text[:40]!a}"
        )
