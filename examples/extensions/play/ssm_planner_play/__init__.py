"""Play an exported EPOS4 folder on CiA 402 drives, simulated ones by default.

The public names are loaded at their first use, so that the command can handle Ctrl-C from its first
moment.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

NAMES = {
    "DriveError": "client",
    "Outcome": "player",
    "Player": "player",
    "PlayError": "program",
    "Program": "program",
    "prepare": "program",
    "StopTable": "stops",
    "stop_table": "stops",
}
"""Module of each public name."""


def __getattr__(name: str) -> Any:
    """Load a public name."""
    if name not in NAMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{NAMES[name]}"), name)
