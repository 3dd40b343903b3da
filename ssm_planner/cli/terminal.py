"""Print on the terminal: wrap lines, colour verdicts, and suggest corrections of typing errors."""

import argparse
import os
import re
import sys
from collections.abc import Iterable, Iterator
from textwrap import wrap
from typing import NoReturn

from ssm_planner.display import terminal_width
from ssm_planner.errors import SsmPlannerError, suggestion

LABEL_PATTERN = re.compile(r"\s*\S+(?: \S+)*\s{2,}|\s*")
"""Pattern of the beginning of a line: its label and the spaces after it, or its indentation."""
MAX_LABEL_WIDTH = 20
"""Largest width of a label with which continuation lines are aligned, characters."""
MAX_LINES, LAST_LINES = 25, 6
"""Largest number of lines of a shortened text, and the number of last lines that it keeps."""
RED, GREEN, YELLOW = 31, 32, 33
"""ANSI codes of the colours."""
VERDICT_COLOURS = (
    (
        RED,
        r"NOT \w+|DOES NOT HOLD|FAILED|EXCEEDED|BEYOND|OUTSIDE|SATURATED|TRIPPED|UNVERIFIED|NO|no "
        r"plan",
    ),
    (GREEN, r"PASSED|held in reality|suffices?"),
    (YELLOW, r"not known|not checked|not decided|placeholder figures|CANNOT TELL"),
)
"""Colour of the words that state a verdict: ANSI code and pattern."""
VERDICT_PATTERN = re.compile(
    "|".join(rf"(?P<c{colour}>\b(?:{pattern})\b)" for colour, pattern in VERDICT_COLOURS)
)
"""Pattern of all words that state a verdict. The name of the matching group is "c" and the code."""
UNKNOWN_OPTION_PATTERN = re.compile(r"unrecognized arguments: (.*)")
"""Pattern of the message with which argparse reports unknown options."""


class UsageError(SsmPlannerError):
    """Error for invalid command-line arguments."""


class Parser(argparse.ArgumentParser):
    """Argument parser that raises UsageError instead of ending the process."""

    def error(self, message: str) -> NoReturn:
        """Raise UsageError with the message, the usage and a suggestion for an unknown option."""
        hint = ""
        match = UNKNOWN_OPTION_PATTERN.fullmatch(message)
        if match:
            option = match[1].split()[0].partition("=")[0]
            hint = suggestion(option, self.options())
        raise UsageError(f"{message}{hint}\n{self.format_usage().strip()}")

    def options(self) -> Iterator[str]:
        """Yield every option of the parser and of the commands whose arguments were added."""
        for action in self._actions:
            yield from action.option_strings
            if isinstance(action, argparse._SubParsersAction):
                for parser in action.choices.values():
                    yield from parser.options()


def wrap_line(line: str, width: int) -> list[str]:
    """Wrap a line without breaking words.

    Continuation lines start below the first character after the label of the line, if it has one. A
    line that names a file is not wrapped, so that its path can be copied.

    Parameters
    ----------
    line : str
        Line to wrap.
    width : int
        Largest number of characters in a line.

    Returns
    -------
    list of str
        The lines.
    """
    if len(line) <= width or line.startswith("file  "):
        return [line]
    label = LABEL_PATTERN.match(line)
    end = label.end() if label is not None else 0
    indent = end if 0 < end <= MAX_LABEL_WIDTH else len(line) - len(line.lstrip()) + 2
    return wrap(
        line, width, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False
    )


def shorten(lines: Iterable[str]) -> list[str]:
    """Wrap lines to the width of the terminal, and shorten a long text.

    Parameters
    ----------
    lines : iterable of str
        Lines of the text.

    Returns
    -------
    list of str
        At most `MAX_LINES` lines. The middle of a longer text is omitted. The last `LAST_LINES`
        lines remain, because they contain the verdict.
    """
    wrapped: list[str] = []
    for line in lines:
        wrapped += wrap_line(line, terminal_width())
    if len(wrapped) <= MAX_LINES:
        return wrapped
    return wrapped[: MAX_LINES - LAST_LINES - 1] + ["… (-v prints all)"] + wrapped[-LAST_LINES:]


def print_lines(lines: Iterable[object]) -> None:
    """Print lines, wrapped to the width of the terminal and with coloured verdicts.

    Colours are omitted if stdout is not a terminal, or if the variable NO_COLOR is set.

    Parameters
    ----------
    lines : iterable of str and Table
        Texts of one or more lines, and tables.
    """
    has_colours = sys.stdout.isatty() and os.environ.get("TERM") != "dumb"
    has_colours = has_colours and not os.environ.get("NO_COLOR")
    for block in lines:
        for line in str(block).splitlines() or [""]:
            for text in wrap_line(line, terminal_width()):
                print(VERDICT_PATTERN.sub(_colour_match, text) if has_colours else text)


def _colour_match(match: re.Match[str]) -> str:
    """Add the ANSI codes of its colour to a matched word of a verdict."""
    return f"\x1b[{(match.lastgroup or '')[1:]}m{match[0]}\x1b[0m"
