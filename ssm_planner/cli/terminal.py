"""Print on the terminal: wrap lines, colour verdicts, and suggest corrections of typing errors."""

import argparse
import os
import re
import sys
from collections.abc import Iterable, Iterator
from textwrap import wrap
from typing import NoReturn

from ssm_planner.display import columns
from ssm_planner.errors import SsmPlannerError, suggestion

LABEL = re.compile(r"\s*\S+(?: \S+)*\s{2,}|\s*")
"""Beginning of a line: a label that at least two spaces follow, or only the indentation."""
WIDEST_LABEL = 20
"""Largest number of characters of a label with which continuation lines are aligned."""
SHORT, LAST = 25, 6
"""Largest number of lines of a shortened text, and the number of last lines that it keeps."""
RED, GREEN, YELLOW = 31, 32, 33
"""ANSI codes of the colours."""
COLOURS = (
    (
        RED,
        r"NOT \w+|DOES NOT HOLD|FAILED|EXCEEDED|BEYOND|OUTSIDE|SATURATED|TRIPPED|UNVERIFIED|NO|no "
        r"plan",
    ),
    (GREEN, r"PASSED|held in reality|suffices?"),
    (YELLOW, r"not known|not checked|not decided|placeholder figures|CANNOT TELL"),
)
"""Colours of the words of a verdict."""
VERDICT = re.compile("|".join(rf"(?P<c{colour}>\b(?:{pattern})\b)" for colour, pattern in COLOURS))
OPTION = re.compile(r"unrecognized arguments: (.*)")


class UsageError(SsmPlannerError):
    """Error for invalid command-line arguments."""


class Parser(argparse.ArgumentParser):
    """Argument parser that raises UsageError with the usage and a suggestion."""

    def error(self, message: str) -> NoReturn:
        """Raise UsageError with the message, the usage and a suggestion for unknown options."""
        hint = ""
        match = OPTION.fullmatch(message)
        if match:
            option = match[1].split()[0].partition("=")[0]
            hint = suggestion(option, self.options())
        raise UsageError(f"{message}{hint}\n{self.format_usage().strip()}")

    def options(self) -> Iterator[str]:
        """Yield every option of the parser, and those of all commands whose modules were loaded."""
        for action in self._actions:
            yield from action.option_strings
            if isinstance(action, argparse._SubParsersAction):
                for parser in action.choices.values():
                    yield from parser.options()


def wrap_line(line: str, width: int) -> list[str]:
    """Wrap a line to at most `width` characters, without breaking words.

    Continuation lines start below the first character after the label of the line, if it has one. A
    line that names a file is not wrapped, so that its path can be copied.
    """
    if len(line) <= width or line.startswith("file  "):
        return [line]
    label = LABEL.match(line)
    end = label.end() if label is not None else 0
    indent = end if 0 < end <= WIDEST_LABEL else len(line) - len(line.lstrip()) + 2
    return wrap(
        line, width, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False
    )


def shorten(lines: Iterable[str]) -> list[str]:
    """Wrap lines to the terminal, and omit the middle of a text of more than `SHORT` lines.

    The last LAST lines remain, because they contain the verdict.
    """
    wrapped: list[str] = []
    for line in lines:
        wrapped += wrap_line(line, columns())
    if len(wrapped) <= SHORT:
        return wrapped
    return wrapped[: SHORT - LAST - 1] + ["… (-v prints all)"] + wrapped[-LAST:]


def print_lines(lines: Iterable[str]) -> None:
    """Print lines, wrapped to the width of the terminal and with coloured verdicts.

    Colours are omitted if stdout is not a terminal.
    """
    has_colours = sys.stdout.isatty() and os.environ.get("TERM") != "dumb"
    if os.environ.get("NO_COLOR"):
        has_colours = False
    for block in lines:
        for line in block.splitlines() or [""]:
            for text in wrap_line(line, columns()):
                print(VERDICT.sub(_coloured, text) if has_colours else text)


def _coloured(match: re.Match[str]) -> str:
    """Add the ANSI codes of its colour to a word. The name of the matched group is the code."""
    return f"\x1b[{(match.lastgroup or '')[1:]}m{match[0]}\x1b[0m"
