"""Numbers as people and spreadsheets write them, and the list of what had to be mended to read them."""

from __future__ import annotations

import math
import re
from pathlib import Path

from ssm_planner.errors import RecordingError

NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(,\d{3})+(\.\d+)?")
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")
_EDITED = re.compile(r"([^,]+),,?\s*was\s+([+-]?[\d.]+)", re.IGNORECASE)


class Notes:
    """Repairs of one file, equal ones counted."""

    def __init__(self, path: Path, decimal_point: bool) -> None:
        self.path, self.decimal_point = path, decimal_point
        self.single: list[str] = []
        self.counted: dict[str, list[int]] = {}

    def add(self, text: str) -> None:
        self.single.append(text)

    def count(self, text: str, line: int) -> None:
        self.counted.setdefault(text, []).append(line + 1)

    def number(self, text: str, line: int) -> float:
        """The number a field holds, its local habits undone; NaN for an empty field or a stated nan."""
        text = text.strip().strip('"').strip()
        if text.lower() in ("", "nan", "inf", "-inf", "+inf", "null", "none", "#n/a"):
            return math.nan
        if NUMBER.fullmatch(text):
            return float(text)
        edited = _EDITED.fullmatch(text)
        if edited:
            value, before = edited.group(1).strip(), edited.group(2)
            self.add(f"line {line + 1}: edited value {value} restored to {before}, which the file states it was")
            return float(before)
        if _THOUSANDS.fullmatch(text) and self.decimal_point:
            self.count("numbers with thousands separators read without them", line)
            return float(text.replace(",", ""))
        if _DECIMAL_COMMA.fullmatch(text):
            self.count("numbers with a decimal comma read as such", line)
            return float(text.replace(",", "."))
        head = text.split(",", 1)[0].strip()
        if "," in text and NUMBER.fullmatch(head):
            self.add(f"line {line + 1}: text after the number {head} ignored ({text[:40]!r})")
            return float(head)
        raise RecordingError(f"{self.path}:{line + 1}: {text[:40]!r} is not a number")

    def all(self) -> list[str]:
        counted = [f"{len(at)} {text} (first: line {at[0]})" for text, at in self.counted.items()]
        return self.single + counted
