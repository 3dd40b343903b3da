"""How many cases tests run: a part of them, or all of them with EVERY_CASE=1 in the environment."""

from __future__ import annotations

import os
from typing import TypeVar

Cases = TypeVar("Cases")
EVERY_CASE = os.environ.get("EVERY_CASE") == "1"


def selected(part: Cases, *, every: Cases) -> Cases:
    """Return the part, or all cases if the environment asks for every case."""
    return every if EVERY_CASE else part
