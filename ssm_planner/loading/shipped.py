"""Files that travel with the package: found by name from anywhere."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Literal

from ssm_planner.errors import ProblemError

Folder = Literal["problems", "robots", "drives", "motors", "motorisation", "controllers"]
_PACKAGE = Path(__file__).parents[1]


def shipped_folder() -> Path:
    """Where the shipped files stand: within the installed package, or beside it in a checkout."""
    within = _PACKAGE / "problems"
    return within if within.is_dir() else _PACKAGE.parent / "problems"


def shipped_names(folder: Folder) -> dict[str, Path]:
    """The shipped files of one kind by name, such as tilt_insert among the problems."""
    place = shipped_folder() if folder == "problems" else shipped_folder() / folder
    return {file.stem: file for file in sorted(place.glob("*.yaml"))}


def find(name: str | Path, folder: Folder) -> Path:
    """The file of this path, or the shipped file of this name. Raises ProblemError where there is neither."""
    path = Path(name)
    try:
        exists = path.is_file() or (path.exists() and str(name) not in shipped_names(folder))
    except (OSError, ValueError):
        return path  # reading it says what is wrong
    if exists:
        return path
    names = shipped_names(folder)
    if str(name) in names:
        return names[str(name)]
    beside = [file.name for file in path.parent.glob("*.yaml")] if path.parent.is_dir() else []
    close = difflib.get_close_matches(path.name, [*names, *beside], n=1)
    hint = f"; did you mean {close[0]!r}?" if close else ""
    raise ProblemError(f"no such file{hint}", file=path, allowed=f"a file, or a shipped name: {', '.join(names)}")
