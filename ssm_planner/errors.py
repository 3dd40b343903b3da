"""Every exception that this program raises on purpose."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class SsmPlannerError(Exception):
    """Base of all errors that are the user's to mend; the command line prints them and exits with 2."""


class ProblemError(SsmPlannerError):
    """Something the user wrote cannot be used.

    The message names, as far as known, the file, the line, the key, the value found and what is allowed.
    """

    def __init__(
        self,
        reason: str,
        *,
        file: str | Path | None = None,
        line: int | None = None,
        key: str | None = None,
        value: object = None,
        allowed: str | None = None,
    ) -> None:
        self.reason = reason
        self.file = None if file is None else str(file)
        self.line = line
        self.key = key
        self.value = value
        self.allowed = allowed
        self.others: tuple[ProblemError, ...] = ()
        """Further faults of the same file."""
        self.unshown = 0
        """How many more there are."""
        super().__init__(reason)

    def __str__(self) -> str:
        place = ":".join(str(part) for part in (self.file, self.line) if part is not None)
        if self.file is None and self.line is not None:
            place = f"line {self.line}"
        text = f"{place}: " if place else ""
        if self.key is not None:
            text += f"{self.key}"
            if self.value is not None:
                text += f" = {_shorten(self.value)}"
            text += ": "
        text += self.reason
        if self.allowed is not None:
            text += f" (allowed: {self.allowed})"
        lines = [text, *(str(other) for other in self.others)]
        if self.unshown:
            lines.append(f"… and {self.unshown} more")
        return "\n".join(lines)


@contextmanager
def within(place: str) -> Iterator[None]:
    """Problem errors raised here name their key below a place such as motion[0].tilt."""
    try:
        yield
    except ProblemError as error:
        error.key = f"{place}.{error.key}" if error.key else place
        raise


class GeometryError(SsmPlannerError, ValueError):
    """An array argument is not what the function takes: the message names the argument, its shape and its fault."""


class RecordingError(SsmPlannerError):
    """A recording cannot be read or does not hold what the identification needs."""


class TrajectoryError(SsmPlannerError):
    """A trajectory file cannot be read, or does not describe a trajectory."""


class ExportError(SsmPlannerError):
    """A plan cannot be written in the form asked for."""


def _shorten(value: object, width: int = 80) -> str:
    text = value if isinstance(value, str) else repr(value)
    return text if len(text) <= width else text[: width - 1] + "…"
