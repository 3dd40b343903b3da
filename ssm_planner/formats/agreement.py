"""Compare an export folder with the content that follows from its motion.

A reader of an export must notice when somebody edited one of its files. The hashes in the manifest
do not suffice, because they can be updated as well. Therefore, the functions that compute the files
and the entries of the manifest serve both the export and its reader: The export applies them to the
plan, and the reader applies them to the motion that it has read. A changed file or entry then
disagrees with the motion. The main function is `check_export_content`.
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
UNVERIFIED_WARNING = "UNVERIFIED: the plan has no passed certificate; do not run it on a machine"
"""Warning in the manifest and in the JointTrajectory files of an unverified plan."""
EXPLANATORY_KEYS = frozenset(
    ("note", "notes", "known", "reason", "encoder", "convention", "form", "not_verified")
    + ("certificate", "deviation", "spline")
)
"""Keys and columns that only explain the export to a reader. Controllers ignore them."""
RELATIVE_TOLERANCE = 1e-10
"""Relative difference up to which two numbers count as equal."""
ABSOLUTE_TOLERANCE = 1e-11
"""Absolute difference up to which two numbers count as equal.

The processor and the libraries of another computer may round differently.
"""
DECIMAL_NUMBER = re.compile(r"-?\d+\.\d+(?:e[+-]?\d+)?")
"""Pattern of a number with a decimal point in a text. All other text must be the same."""
DURATION_TOLERANCE = 1e-8
"""Largest rounding error of a duration in a manifest, s."""


@record
class ExportContent:
    """Part of an export folder that follows from its motion: files, and entries of the manifest.

    An export writes this content. A reader derives it again from the motion that it has read, and
    compares it with the folder (`check_export_content`).
    """

    entries: JsonObject
    """Entries of the manifest."""
    files: Mapping[str, Iterable[str] | None]
    """Text of each file by file name, as one text or as consecutive parts that are iterated once.

    The value is None for a file that `check_export_content` does not compare.
    """

    def write(self, folder: Path) -> JsonObject:
        """Write the files that have a text into a folder.

        Parameters
        ----------
        folder : Path
            Existing folder. Files with the same names are replaced.

        Returns
        -------
        dict
            Entries of the manifest, so that a caller can write and add them in one step.
        """
        for name, text in self.files.items():
            if text is not None:
                with (folder / name).open("w", encoding="utf-8", newline="") as file:
                    file.writelines([text] if isinstance(text, str) else text)
        return self.entries


def file_name_suffix(manifest: JsonObject) -> str:
    """Return the text before the extension in the names of all files of an export.

    Parameters
    ----------
    manifest : dict
        Content of the manifest.json of the export.

    Returns
    -------
    str
        "" if the manifest states that the plan was verified, and `UNVERIFIED_SUFFIX` otherwise.
    """
    return "" if manifest.get("verified") is True else UNVERIFIED_SUFFIX


def read_rate(folder: Path, manifest: JsonObject, maximum: float) -> float:
    """Return the rate of the rows in Hz that a manifest states.

    Parameters
    ----------
    folder : Path
        Export folder, for messages.
    manifest : dict
        Content of the manifest.json of the folder.
    maximum : float
        Largest rate that the format allows, Hz.

    Returns
    -------
    float
        Rows per second, Hz.

    Raises
    ------
    TrajectoryError
        If the entry `rate_hz` is not a number above 0 and up to `maximum`.
    """
    rate = manifest.get("rate_hz")
    if isinstance(rate, (int, float)) and 0 < rate <= maximum:
        return float(rate)
    raise TrajectoryError(f"{folder / MANIFEST}: rate_hz is not a rate: {str(rate)[:40]}")


def require_same_robot(folder: Path, manifest: JsonObject, robot: Robot) -> None:
    """Raise TrajectoryError if a folder was exported for another robot.

    The name of the robot and the SHA-256 of its data must equal those in the manifest.

    Parameters
    ----------
    folder : Path
        Export folder, for messages.
    manifest : dict
        Content of the manifest.json of the folder.
    robot : Robot
        Robot that shall perform the motion.
    """
    expected = {"name": robot.name, "sha256": robot_hash(robot)}
    fault = first_difference(manifest.get("robot"), expected, "robot")
    if fault:
        raise TrajectoryError(f"{folder / MANIFEST}: it was exported for another robot: {fault}")


def check_export_content(
    folder: Path, manifest: JsonObject, content: ExportContent, duration: float
) -> None:
    """Raise TrajectoryError if files or entries of an export contradict its motion.

    The motion of an export determines the expected content of the folder. The check has three
    parts. The entries of the manifest and its list of files must be the expected ones. The text of
    each file must equal the expected text, except for rounding and explanations. The duration of
    the motion must be that of the exported plan.

    Parameters
    ----------
    folder : Path
        Export folder.
    manifest : dict
        Content of the manifest.json of the folder.
    content : ExportContent
        Expected files and entries, which were computed from the motion.
    duration : float
        Duration of the motion that was read, s. It may exceed the duration of the plan by up to one
        interpolation period, because setpoints lie at multiples of this period.
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
    """Describe the first difference between a document and the document that it should equal.

    Both documents consist of JSON types. The keys in `EXPLANATORY_KEYS` are ignored. A missing key
    equals a key with the value null. Numbers are equal within `RELATIVE_TOLERANCE` and
    `ABSOLUTE_TOLERANCE`.

    Parameters
    ----------
    actual, derived : JSON types
        The document in the folder, and the document that follows from the motion.
    location : str
        Name of the document. The description starts with it.

    Returns
    -------
    str or None
        Description of the first difference, or None if the documents are equal.
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
    """Return True if two JSON values are equal, with tolerances for numbers.

    The tolerances are `RELATIVE_TOLERANCE` and `ABSOLUTE_TOLERANCE`. They also apply to numbers
    with a decimal point within texts. The rest of two texts must be the same. An integer and a
    float may be equal, but all other values of different types are different.

    Parameters
    ----------
    actual, derived : JSON values
        Value in the folder, and value that follows from the motion. `first_difference` itself
        compares two dictionaries, and two lists of the same length.
    """
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
    """Return the lines of a text file without comments and explanations.

    Comments are lines that start with "#". Explanations are the columns of a CSV table whose names
    are in `EXPLANATORY_KEYS`.

    Parameters
    ----------
    text : str
        Content of the file.

    Returns
    -------
    list of str, or list of lists of str
        Lines of the file or, if it is a table with columns of explanations, the other cells of each
        row.
    """
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    columns = next(csv.reader(lines), [])
    explaining = [k for k, column in enumerate(columns) if column in EXPLANATORY_KEYS]
    if not explaining:
        return lines
    rows = list(csv.reader(lines))
    return [[cell for k, cell in enumerate(row) if k not in explaining] for row in rows]
