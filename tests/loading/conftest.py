"""The fixture `files` provides a copy of the shipped files that a test may change."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.loading.load import load_drive, load_motor, load_problem, load_robot
from tests.support.paths import PROBLEMS

SHIPPED = PROBLEMS
LOADERS = {"robots": load_robot, "drives": load_drive, "motors": load_motor}


@dataclass
class Files:
    """Edit and load files of the copy."""

    root: Path

    def edit(self, name: str, old: str, new: str) -> Path:
        """Replace the first `old` in a file by `new`, and return the path."""
        path = self.root / name
        text = path.read_text(encoding="utf-8")
        assert old in text, f"{old!r} is not in {name}"
        path.write_text(text.replace(old, new, 1), encoding="utf-8")
        return path

    def without_eye(self, name: str) -> None:
        """Remove the eye of a problem, which precedes the objective."""
        path = self.root / name
        text = path.read_text(encoding="utf-8")
        start, end = text.index("eye:"), text.index("objective:")
        path.write_text(text[:start] + text[end:], encoding="utf-8")

    def load(self, name: str) -> object:
        """Load a file with the loader of its folder."""
        folder = Path(name).parent.name
        return LOADERS.get(folder, load_problem)(self.root / name)

    def rejection(self, name: str, old: str, new: str, at: str | None = None) -> str:
        """Return the message of the error that an edit causes.

        The message must name the edited line, or the first line that contains `at`.
        """
        before = (self.root / name).read_text(encoding="utf-8")
        path = self.edit(name, old, new)
        with pytest.raises(ProblemError) as caught:
            self.load(name)
        message = str(caught.value)
        after = path.read_text(encoding="utf-8")
        place = before.index(old) if at is None else after.index(at)
        line = after.count("\n", 0, place) + 1
        assert message.startswith(f"{path}:{line}: "), (message, line)
        return message


@pytest.fixture
def files(tmp_path: Path) -> Files:
    """Copy the shipped files to a temporary folder."""
    root = tmp_path / "problems"
    shutil.copytree(SHIPPED, root)
    return Files(root)
