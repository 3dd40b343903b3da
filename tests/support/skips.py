"""Reasons for which a test may be skipped, as regular expressions; `--listed-skips` fails others.

Each reason states what a machine lacks. A test without special requirements must not be skipped.
"""

from __future__ import annotations

import re

LISTED = (
    r"no Chromium installed",
    r"Playwright is not installed",
    r"the site is not built",
    r"no C compiler",
    r"without (its|the) compiled part",
    r"no address and undefined-behaviour sanitizers here",
    r"the recordings (of the rigs )?are not beside the project",
    r"the paper's source is not beside the project",
    r"no file system of 1 MB can be mounted here",
    r"no FIFOs on this system",
    r"signals as a terminal sends them",
    r"pybullet",  # newer Pythons have no wheels
    r"written by another CasADi",
    r"rerun-sdk is not installed",  # the package is too large for CI
)


def is_listed(reason: str) -> bool:
    """Return whether a reason for a skip is in the list."""
    return any(re.search(pattern, reason) for pattern in LISTED)
