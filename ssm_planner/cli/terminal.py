"""Terminal output: wrapped lines, coloured verdicts and parser messages with suggestions."""

from __future__ import annotations

import argparse
import difflib
import os
import re
import sys
from collections.abc import Iterable, Iterator
from textwrap import wrap
from typing import NoReturn, TextIO

from ssm_planner.display import columns
from ssm_planner.errors import SsmPlannerError

LABEL = re.compile(r"\s*\S+(?: \S+)*\s{2,}|\s*")
"""Beginning of a wrapped line: a label and at least two spaces, or the indentation."""
WIDEST_LABEL = 20
SHORT, LAST = 25, 6
"""Largest number of lines of a short text, and number of lines at its end that it keeps."""
RED, GREEN, YELLOW = 31, 32, 33
COLOURS = (
    (
        RED,
        r"NOT \w+|DOES NOT HOLD|FAILED|EXCEEDED|BEYOND|OUTSIDE|SATURATED|TRIPPED|UNVERIFIED|NO|no "
        r"plan",
    ),
    (GREEN, r"PASSED|held in reality|suffices?"),
    (YELLOW, r"not known|not checked|not decided|placeholder figures|CANNOT TELL"),
)
VERDICT = re.compile("|".join(rf"(?P<c{colour}>\b(?:{words})\b)" for colour, words in COLOURS))
OPTION = re.compile(r"unrecognized arguments: (.*)")


class UsageError(SsmPlannerError):
    """Error for invalid command-line arguments."""


class Parser(argparse.ArgumentParser):
    """Argument parser that raises UsageError with usage and a suggestion."""

    def error(self, message: str) -> NoReturn:
        """Raise UsageError."""
        hint = ""
        if found := OPTION.fullmatch(message):
            hint = suggestion(found[1].split()[0].partition("=")[0], list(self.options()))
        raise UsageError(f"{message}{hint}\n{self.format_usage().strip()}")

    def options(self) -> Iterator[str]:
        """Return every option, including those of the commands that were loaded."""
        for action in self._actions:
            yield from action.option_strings
            for parser in (
                action.choices.values() if isinstance(action, argparse._SubParsersAction) else ()
            ):
                yield from parser.options()


def suggestion(word: str, known: Iterable[str]) -> str:
    """Return the most similar known word as the end of a message, or "" if none is similar."""
    close = difflib.get_close_matches(word, list(known), n=1)
    return f"; did you mean {close[0]!r}?" if close else ""


def wrapped(line: str, width: int) -> list[str]:
    """Return a line as lines of at most this width without broken words.

    Continuation lines are aligned with the text of the first one. A line with a file stays one
    line, so that its path can be copied.
    """
    if len(line) <= width or line.startswith("file  "):
        return [line]
    label = LABEL.match(line)
    end = label.end() if label is not None else 0
    indent = end if 0 < end <= WIDEST_LABEL else len(line) - len(line.lstrip()) + 2
    return wrap(
        line, width, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False
    )


def shortened(lines: Iterable[str]) -> list[str]:
    """Return lines, wrapped, without the middle of what exceeds SHORT lines. The end stays whole."""
    shown = [part for line in lines for part in wrapped(line, columns())]
    if len(shown) <= SHORT:
        return shown
    return [*shown[: SHORT - LAST - 1], "… (-v prints all)", *shown[-LAST:]]


def printed(lines: Iterable[str], stream: TextIO | None = None) -> None:
    """Print lines on a stream (default stdout), wrapped and coloured if the terminal supports it."""
    stream = sys.stdout if stream is None else stream
    colour = stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
    for block in lines:
        for line in block.splitlines() or [""]:
            for part in wrapped(line, columns()):
                print(VERDICT.sub(_coloured, part) if colour else part, file=stream)


def _coloured(match: re.Match[str]) -> str:
    return f"\x1b[{(match.lastgroup or '')[1:]}m{match[0]}\x1b[0m"
