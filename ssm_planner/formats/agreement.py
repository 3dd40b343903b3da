"""Compare an export folder with the content that follows from its motion.

An export and its reader make files and entries of the manifest with the same functions. The export
makes them from a plan, and the reader from the motion that it has read. A changed file or entry
therefore disagrees with the motion, even if the hashes in the manifest were made again.
"""

from __future__ import annotations

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

UNVERIFIED = "_unverified"
"""Suffix of the file names of an unverified plan."""
NOT_COMPARED = frozenset(
    ("note", "notes", "known", "reason", "encoder", "convention", "form", "not_verified")
    + ("certificate", "deviation", "spline")
)
"""Keys and columns that no client interprets."""
RELATIVE = 1e-10
ABSOLUTE = 1e-11
"""Differences within which two numbers count as equal, since machines round differently."""
DECIMAL = re.compile(r"-?\d+\.\d+(?:e[+-]?\d+)?")
"""Numbers with a decimal point in a text. All other text must be the same."""
DURATION_TOLERANCE = 1e-8
"""Rounding error of a duration, s."""


@record
class Content:
    """Entries of a manifest and texts of files that follow from a motion."""

    entries: JsonObject
    files: Mapping[str, Iterable[str] | None]
    """Text of each file by name, possibly in parts, which are used once.

    None if `require_agreement` does not compare the file.
    """

    def write(self, folder: Path) -> JsonObject:
        """Write the files, and return the entries."""
        for name, text in self.files.items():
            if text is not None:
                with (folder / name).open("w", encoding="utf-8", newline="") as file:
                    file.writelines([text] if isinstance(text, str) else text)
        return self.entries


def suffix_of(manifest: JsonObject) -> str:
    """Return the suffix that the names of all files in an export have."""
    return "" if manifest.get("verified") is True else UNVERIFIED


def stated_rate(folder: Path, manifest: JsonObject, largest: float) -> float:
    """Return the rate in a manifest, Hz. Raises TrajectoryError if it is not a rate."""
    rate = manifest.get("rate_hz")
    if isinstance(rate, (int, float)) and 0 < rate <= largest:
        return float(rate)
    raise TrajectoryError(f"{folder / MANIFEST}: rate_hz is not a rate: {str(rate)[:40]}")


def require_robot(folder: Path, manifest: JsonObject, robot: Robot) -> None:
    """Raise TrajectoryError if a folder was exported for another robot."""
    expected = {"name": robot.name, "sha256": robot_hash(robot)}
    if fault := difference(manifest.get("robot"), expected, "robot"):
        raise TrajectoryError(f"{folder / MANIFEST}: it was exported for another robot: {fault}")


def require_agreement(
    folder: Path, manifest: JsonObject, content: Content, duration: float
) -> None:
    """Raise TrajectoryError if files or entries do not follow from the motion.

    `duration` is that of the motion, s. A stream of setpoints may exceed the planned duration by
    less than one period.
    """
    stated = {key: manifest.get(key) for key in content.entries}
    fault = difference(stated, content.entries, MANIFEST)
    period = content.entries.get("interpolation_period_ms", 0) / 1000
    try:
        planned = manifest["plan"]["duration_s"] * manifest.get("stretch", 1.0)
        if not -DURATION_TOLERANCE <= duration - planned <= period + DURATION_TOLERANCE:
            fault = fault or f"plan.duration_s and stretch give {planned} s, not {duration} s"
    except (KeyError, TypeError):
        fault = fault or "plan.duration_s or stretch is not a number"
    fault = fault or difference(
        sorted(manifest["files"]), sorted(content.files), f"{MANIFEST}.files"
    )
    for name, parts in content.files.items():
        if fault is None and parts is not None:
            text = "".join(parts)
            read = (folder / name).read_bytes().decode("utf-8", "replace")
            if read != text:
                fault = difference(_without_explanations(read), _without_explanations(text), name)
    if fault:
        raise TrajectoryError(f"{folder}: changed after the export: {fault}")


def difference(stated: Any, derived: Any, place: str) -> str | None:
    """Describe the first difference between a document and its derivation, or return None.

    Documents consist of the types of JSON. The keys in `NOT_COMPARED` are ignored, a missing key
    equals null, and numbers are equal within
    `RELATIVE` and `ABSOLUTE`.
    """
    if isinstance(stated, dict) and isinstance(derived, dict):
        keys = sorted((stated.keys() | derived.keys()) - NOT_COMPARED)
        pairs = [(stated.get(key), derived.get(key), f"{place}.{key}") for key in keys]
    elif isinstance(stated, list) and isinstance(derived, list) and len(stated) == len(derived):
        pairs = [(value, derived[k], f"{place}[{k}]") for k, value in enumerate(stated)]
    elif _equal(stated, derived):
        return None
    else:
        shown = [repr(value)[:80] for value in (stated, derived)]
        return f"{place} is {shown[0]}, but the motion gives {shown[1]}"
    return next(filter(None, starmap(difference, pairs)), None)


def _equal(stated: Any, derived: Any) -> bool:
    if isinstance(stated, str) and isinstance(derived, str):
        texts = stated, derived
        first, second = ([float(number) for number in DECIMAL.findall(text)] for text in texts)
        bare, other = (DECIMAL.sub("", text) for text in texts)
        return bare == other and difference(first, second, "") is None
    if type(stated) in (int, float) and type(derived) in (int, float):
        return math.isclose(stated, derived, rel_tol=RELATIVE, abs_tol=ABSOLUTE)
    return type(stated) is type(derived) and bool(stated == derived)


def _without_explanations(text: str) -> list[Any]:
    """Return the lines of a file, or the rows of a table, without comments and explanations."""
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    columns = next(csv.reader(lines), [])
    explaining = [k for k, column in enumerate(columns) if column in NOT_COMPARED]
    if not explaining:
        return lines
    rows = list(csv.reader(lines))
    return [[cell for k, cell in enumerate(row) if k not in explaining] for row in rows]
