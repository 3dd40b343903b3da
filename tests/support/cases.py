"""How many cases tests run: a part of them, or all of them with EVERY_CASE=1 in the environment."""

from __future__ import annotations

import os
import random
from collections.abc import Sequence
from typing import TypeVar

Cases = TypeVar("Cases")
Case = TypeVar("Case")
EVERY_CASE = os.environ.get("EVERY_CASE") == "1"
DRAW = os.environ.get("DRAW", "0")
"""`.ci/run` sets it to the number of the commit, so every commit draws cases of its own."""


def selected(part: Cases, *, every: Cases) -> Cases:
    """Return the part, or all cases if the environment asks for every case."""
    return every if EVERY_CASE else part


def drawn(count: int, cases: Sequence[Case], of: str = "") -> list[Case]:
    """Return as many of the cases as asked for, in their order, or all with EVERY_CASE=1.

    The same DRAW in the environment, and the same name `of` what the cases are for, draw the same
    cases. They must be alike: a case that is the only one of its kind is not drawn but always run.
    """
    if EVERY_CASE:
        return list(cases)
    places = random.Random(DRAW + of).sample(range(len(cases)), count)
    return [cases[k] for k in sorted(places)]
