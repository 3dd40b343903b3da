"""Choice of the cases that tests run: some of them, or all with EVERY_CASE=1 in the environment."""

from __future__ import annotations

import os
import random
from collections.abc import Sequence
from typing import TypeVar

Cases = TypeVar("Cases")
Case = TypeVar("Case")
EVERY_CASE = os.environ.get("EVERY_CASE") == "1"
DRAW = os.environ.get("DRAW", "0")
"""Seed of the random choice. `.ci/run` sets it to the number of the commit."""


def selected(part: Cases, *, every: Cases) -> Cases:
    """Return the part, or all cases if the environment asks for every case."""
    return every if EVERY_CASE else part


def drawn(count: int, cases: Sequence[Case], of: str = "") -> list[Case]:
    """Return `count` random cases in their order, or all of them with EVERY_CASE=1.

    The variable DRAW of the environment and the purpose `of` are the seed. The cases must be alike.
    A case that is the only one of its kind must not be drawn but always run.
    """
    if EVERY_CASE:
        return list(cases)
    places = random.Random(DRAW + of).sample(range(len(cases)), count)
    return [cases[k] for k in sorted(places)]
