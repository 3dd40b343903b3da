"""Text on a terminal: wrapped to its width, verdicts in colour; messages of the parser with what was probably meant."""

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
"""What stands before the text of a line that is wrapped: a label and at least two spaces, or the indentation."""
WIDEST_LABEL = 20
RED, GREEN, YELLOW = 31, 32, 33
COLOURS = (
    (
        RED,
        r"NOT \w+|DOES NOT HOLD|FAILED|EXCEEDED|BEYOND|OUTSIDE|SATURATED|TRIPPED|UNVERIFIED|NO|no plan",
    ),
    (GREEN, r"PASSED|held in reality|suffices?"),
    (YELLOW, r"not known|not checked|not decided|placeholder figures|CANNOT TELL"),
)
VERDICT = re.compile("|".join(rf"(?P<c{colour}>\b(?:{words})\b)" for colour, words in COLOURS))
OPTION = re.compile(r"unrecognized arguments: (.*)")


class UsageError(SsmPlannerError):
    """Arguments that no command takes."""


class Parser(argparse.ArgumentParser):
    """Raises UsageError with usage and what was probably meant."""

    def error(self, message: str) -> NoReturn:
        """Raises UsageError."""
        hint = ""
        if found := OPTION.fullmatch(message):
            hint = suggestion(found[1].split()[0].partition("=")[0], list(self.options()))
        raise UsageError(f"{message}{hint}\n{self.format_usage().strip()}")

    def options(self) -> Iterator[str]:
        """Every option, those of the commands that were loaded too."""
        for action in self._actions:
            yield from action.option_strings
            for parser in (
                action.choices.values() if isinstance(action, argparse._SubParsersAction) else ()
            ):
                yield from parser.options()


def suggestion(word: str, known: Iterable[str]) -> str:
    """The word that was probably meant, as the end of a message; empty where none is near."""
    close = difflib.get_close_matches(word, list(known), n=1)
    return f"; did you mean {close[0]!r}?" if close else ""


def wrapped(line: str, width: int) -> list[str]:
    """A line in lines of at most this width, words whole; what follows the first stands under its text."""
    if len(line) <= width:
        return [line]
    label = LABEL.match(line)
    end = label.end() if label is not None else 0
    indent = end if 0 < end <= WIDEST_LABEL else len(line) - len(line.lstrip()) + 2
    return wrap(
        line, width, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False
    )


def printed(lines: Iterable[str], stream: TextIO | None = None) -> None:
    """Lines on a stream (stdout), wrapped, and coloured where it is a terminal that shows colours."""
    stream = sys.stdout if stream is None else stream
    colour = stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
    for block in lines:
        for line in block.splitlines() or [""]:
            for part in wrapped(line, columns()):
                print(VERDICT.sub(_coloured, part) if colour else part, file=stream)


def _coloured(found: re.Match[str]) -> str:
    return f"\x1b[{(found.lastgroup or '')[1:]}m{found[0]}\x1b[0m"
