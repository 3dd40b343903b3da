"""Compare an export folder with the content that follows from its motion.

The same functions compute the files and the entries of the manifest for an export and for its
reader. The export computes them from a plan, and the reader from the motion that it has read. A
changed file or entry therefore disagrees with the motion, even if somebody also updated the hashes
in the manifest.
"""

import csv
import math
import re
from collections.abc import Iterable, Mapping
from itertools import starmap
from pathlib import Path
from typing import Any

from ssm_planner.errors import TrajectoryError
from ssm_planner.problem import Robot, robot_hash
from ssm_planner.publishing import MANIFEST
from ssm_planner.typing import JsonObject, record

UNVERIFIED_SUFFIX = "_unverified"
"""Suffix of the file names of an unverified plan."""
EXPLANATORY_KEYS = frozenset(
    ("note", "notes", "known", "reason", "encoder", "convention", "form", "not_verified")
    + ("certificate", "deviation", "spline")
)
"""Keys and columns that only explain the export to a reader. Controllers ignore them."""
RELATIVE_TOLERANCE = 1e-10
ABSOLUTE_TOLERANCE = 1e-11
"""Differences up to which two numbers count as equal, because machines round differently."""
DECIMAL_NUMBER = re.compile(r"-?\d+\.\d+(?:e[+-]?\d+)?")
"""Numbers with a decimal point in a text. All other text must be the same."""
DURATION_TOLERANCE = 1e-8
"""Rounding error of a duration, s."""


@record
class ExportContent:
    """The part of an export folder that follows from its motion.

    An export writes it. A reader derives it again from the motion that it has read, and compares it
    with the folder (`check_export_content`).
    """

    entries: JsonObject
    """Entries of the manifest."""
    files: Mapping[str, Iterable[str] | None]
    """Text of each file by name, possibly in parts, which are used once.

    None if `check_export_content` does not compare the file.
    """

    def write(self, folder: Path) -> JsonObject:
        """Write the files, and return the entries."""
        for name, text in self.files.items():
            if text is not None:
                with (folder / name).open("w", encoding="utf-8", newline="") as file:
                    file.writelines([text] if isinstance(text, str) else text)
        return self.entries


def file_name_suffix(manifest: JsonObject) -> str:
    """Return the suffix that the names of all files in an export have."""
    return "" if manifest.get("verified") is True else UNVERIFIED_SUFFIX


def read_rate(folder: Path, manifest: JsonObject, maximum: float) -> float:
    """Return the rate that a manifest states, Hz.

    Raises TrajectoryError if the entry is not a number above 0 and up to `maximum`.
    """
    rate = manifest.get("rate_hz")
    if isinstance(rate, (int, float)) and 0 < rate <= maximum:
        return float(rate)
    raise TrajectoryError(f"{folder / MANIFEST}: rate_hz is not a rate: {str(rate)[:40]}")


def require_same_robot(folder: Path, manifest: JsonObject, robot: Robot) -> None:
    """Raise TrajectoryError if a folder was exported for another robot."""
    expected = {"name": robot.name, "sha256": robot_hash(robot)}
    fault = first_difference(manifest.get("robot"), expected, "robot")
    if fault:
        raise TrajectoryError(f"{folder / MANIFEST}: it was exported for another robot: {fault}")


def check_export_content(
    folder: Path, manifest: JsonObject, content: ExportContent, duration: float
) -> None:
    """Raise TrajectoryError if files or entries do not follow from the motion.

    Parameters
    ----------
    folder : Path
        The export folder.
    manifest : dict
        Its manifest.
    content : Content
        Files and entries that follow from the motion.
    duration : float
        Duration of the motion, s. A stream of set points may be longer than the plan by less than
        one period.
    """
    entries = {key: manifest.get(key) for key in content.entries}
    fault = first_difference(entries, content.entries, MANIFEST)
    period = content.entries.get("interpolation_period_ms", 0) / 1000
    try:
        plan_time = manifest["plan"]["duration_s"] * manifest.get("stretch", 1.0)
        if not -DURATION_TOLERANCE <= duration - plan_time <= period + DURATION_TOLERANCE:
            fault = fault or f"plan.duration_s and stretch give {plan_time} s, not {duration} s"
    except (KeyError, TypeError):
        fault = fault or "plan.duration_s or stretch is not a number"
    fault = fault or first_difference(
        sorted(manifest["files"]), sorted(content.files), f"{MANIFEST}.files"
    )
    for name, lines in content.files.items():
        if fault is None and lines is not None:
            derived = "".join(lines)
            text = (folder / name).read_bytes().decode("utf-8", "replace")
            if text != derived:
                rows = _without_explanations(text)
                fault = first_difference(rows, _without_explanations(derived), name)
    if fault:
        raise TrajectoryError(f"{folder}: changed after the export: {fault}")


def first_difference(actual: Any, derived: Any, location: str) -> str | None:
    """Describe the first difference between a document and the derived document.

    Documents consist of the types of JSON. The keys in `EXPLANATORY_KEYS` are ignored. A missing
    key
    equals null. Numbers are equal within `RELATIVE_TOLERANCE` and `ABSOLUTE_TOLERANCE`.

    Parameters
    ----------
    actual, derived : JSON types
        The document in the folder, and the document that follows from the motion.
    location : str
        Name of the document for the description.

    Returns
    -------
    str or None
        The description, or None if the documents are equal.
    """
    if isinstance(actual, dict) and isinstance(derived, dict):
        keys = sorted((actual.keys() | derived.keys()) - EXPLANATORY_KEYS)
        pairs = [(actual.get(key), derived.get(key), f"{location}.{key}") for key in keys]
    elif isinstance(actual, list) and isinstance(derived, list) and len(actual) == len(derived):
        pairs = [(value, derived[k], f"{location}[{k}]") for k, value in enumerate(actual)]
    elif _nearly_equal(actual, derived):
        return None
    else:
        return f"{location} is {actual!r:.80}, but the motion gives {derived!r:.80}"
    return next(filter(None, starmap(first_difference, pairs)), None)


def _nearly_equal(actual: Any, derived: Any) -> bool:
    """Return True if two values are equal, with tolerances for numbers and numbers in texts."""
    if isinstance(actual, str) and isinstance(derived, str):
        if DECIMAL_NUMBER.sub("", actual) != DECIMAL_NUMBER.sub("", derived):
            return False
        numbers = list(map(float, DECIMAL_NUMBER.findall(actual)))
        derived_numbers = list(map(float, DECIMAL_NUMBER.findall(derived)))
        return first_difference(numbers, derived_numbers, "") is None
    if type(actual) in (int, float) and type(derived) in (int, float):
        return math.isclose(actual, derived, rel_tol=RELATIVE_TOLERANCE, abs_tol=ABSOLUTE_TOLERANCE)
    return type(actual) is type(derived) and bool(actual == derived)


def _without_explanations(text: str) -> list[Any]:
    """Return the lines of a file, or the rows of a table, without comments and explanations."""
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    columns = next(csv.reader(lines), [])
    explaining = [k for k, column in enumerate(columns) if column in EXPLANATORY_KEYS]
    if not explaining:
        return lines
    rows = list(csv.reader(lines))
    return [[cell for k, cell in enumerate(row) if k not in explaining] for row in rows]
