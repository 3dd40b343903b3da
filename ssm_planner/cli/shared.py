"""Functions that several commands use.

They add arguments to parsers, convert values, report progress on stderr, and print or write
results.
"""

import csv
import json
import math
import os
import re
import sys
import time
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from ssm_planner.cli.terminal import print_lines
from ssm_planner.display import terminal_width
from ssm_planner.errors import ProblemError
from ssm_planner.progress import Progress, Step
from ssm_planner.typing import Files, Keywords

OK, FAILED, UNJUDGED = 0, 1, 4
"""Exit statuses: all checks passed, a check failed, and a limit could not be judged."""
LARGEST_RATE = 100_000.0
"""Largest rate of written files, Hz. A file with a higher rate would not fit into memory."""


def quantity_argument(kind: str, allowed: str | None = None) -> Callable[[str], float]:
    """Return a function with which argparse converts a quantity such as `-140deg` to SI units.

    Parameters
    ----------
    kind : str
        Kind of quantity, a key of units.QUANTITY_KINDS such as "length".
    allowed : str, optional
        Smallest and largest value, such as "0deg to 180deg". The default allows any quantity.

    Returns
    -------
    callable
        Function from a text to a number in SI units. It raises ArgumentTypeError for other texts.
    """

    def convert(text: str) -> float:
        """Convert the text of an argument to SI units."""
        from ssm_planner.units import BadQuantity, parse_quantity

        try:
            value = parse_quantity(text.strip(), kind)
            bounds = [parse_quantity(bound, kind) for bound in (allowed or text).split(" to ")]
            if not bounds[0] <= value <= bounds[-1]:
                raise BadQuantity("out of range", "")
        except BadQuantity as error:
            # A shell would divide an example such as "20 mm" into two arguments.
            values = allowed or re.sub(r"(?<=\d) (?=[a-zA-Z])", "", error.allowed)
            reason = f"{text.strip()!r}: {error.reason} (allowed: {values})"
            raise ArgumentTypeError(reason) from error
        return value

    return convert


def rate_argument(text: str) -> float:
    """Convert a text such as `500`, `500 Hz` or `1kHz` to a rate in Hz, for argparse.

    Parameters
    ----------
    text : str
        Value of the option.

    Returns
    -------
    float
        Rate, Hz.

    Raises
    ------
    ArgumentTypeError
        If the text is not a rate, or if the rate exceeds `LARGEST_RATE`.
    """
    match = re.fullmatch(r"([0-9.e+]+)\s*(?:(k?)hz)?", text.strip().lower())
    rate = 0.0
    if match is not None:
        with suppress(ValueError):
            rate = float(match[1]) * (1000 if match[2] else 1)
    if not 0 < rate <= LARGEST_RATE:
        raise ArgumentTypeError(
            f"{text.strip()!r} is not a rate such as 500 or 1kHz, up to {LARGEST_RATE / 1000:g}kHz"
        )
    return rate


def path_argument(text: str) -> Path:
    """Convert the text of an argument to a path. The text must not be empty."""
    if not text:
        raise ArgumentTypeError("an empty path")
    return Path(text)


ARGUMENTS = Path(__file__).with_name("arguments.csv")
"""Table of the arguments of all commands.

The column `kind` states the type of the value: a key of `VALUE_TYPES` or of `units.QUANTITY_KINDS`,
"flag", the allowed words with "|" between them, or the object that contains them as `module:name`.
The column `number` contains the number of values in the form of argparse, "append" or "required".
At most one argument of a group can be used. The column `needs` names another option, without which
the option has no effect. The column `range` contains the smallest and the largest quantity.
"""
VALUE_TYPES: dict[str, Callable[[str], Any]] = {
    "path": path_argument,
    "text": str,
    "int": int,
    "float": float,
    "rate": rate_argument,
}
"""Function that converts the text of a value, by its type in arguments.csv."""


def add_arguments(parser: ArgumentParser, command: str) -> None:
    """Add the arguments of a command, which arguments.csv lists, to its parser.

    Parameters
    ----------
    parser : ArgumentParser
        Parser of the command.
    command : str
        Name of the command, such as "plan".
    """
    groups: dict[str, Any] = {"": parser}
    needs = {}
    with ARGUMENTS.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            if command in row["commands"].split():
                group = row["group"]
                if group not in groups:
                    groups[group] = parser.add_mutually_exclusive_group()
                groups[group].add_argument(*row["argument"].split(), **_argument_settings(row))
                if row["needs"]:
                    needs[row["argument"]] = row["needs"]
    parser.set_defaults(needs=needs)


def check_needs(options: Namespace) -> None:
    """Raise ProblemError if an option was given without the option that it needs.

    Parameters
    ----------
    options : Namespace
        Parsed arguments of a command.
    """
    given = {
        f"--{name.replace('_', '-')}"
        for name, value in vars(options).items()
        if value is not False and value not in (None, [])  # 0 is a value, although 0 == False
    }
    for option, needed in options.needs.items():
        if option in given and needed not in given:
            raise ProblemError(f"needs {needed}", key=option)


def _argument_settings(row: Mapping[str, str]) -> Keywords:
    """Convert one row of arguments.csv to the keyword arguments of argparse's `add_argument`.

    Parameters
    ----------
    row : mapping of str
        Cells by name of the column. `kind` and `number` have the values that `ARGUMENTS` describes.

    Returns
    -------
    dict
        Keyword arguments such as help, type, choices and nargs.
    """
    value_type = row["kind"]
    number = row["number"]
    metavars = row["metavar"].split()
    settings: Keywords = {"help": row["help"].replace("%", "%%"), "default": row["default"] or None}
    if value_type == "flag":
        return {**settings, "action": "store_true", "default": False}
    if ":" in value_type:
        settings["choices"] = list(resolve_name(value_type))
    elif "|" in value_type:
        settings["choices"] = value_type.split("|")
    elif value_type in VALUE_TYPES:
        settings["type"] = VALUE_TYPES[value_type]
    else:
        settings |= {
            "type": quantity_argument(value_type, row["range"]),
            "metavar": value_type.upper(),
        }
    if metavars:
        settings["metavar"] = metavars[0] if len(metavars) == 1 else tuple(metavars)
    if number in ("append", "+"):
        settings["default"] = []
    if number == "append":
        settings["action"] = "append"
    elif number == "required":
        settings["required"] = True
    elif number:
        settings["nargs"] = int(number) if number.isdigit() else number
    return settings


def parse_option_quantity(option: str, text: str, kind: str, whole: str | None = None) -> float:
    """Convert a quantity that is part of an option's value.

    Parameters
    ----------
    option : str
        Name of the option, for messages.
    text : str
        The quantity with its unit.
    kind : str
        Kind of quantity, a key of units.QUANTITY_KINDS.
    whole : str, optional
        Complete value of the option, for messages. The default is `text`.

    Returns
    -------
    float
        The quantity in SI units.

    Raises
    ------
    ProblemError
        If the text is not such a quantity.
    """
    from ssm_planner.units import BadQuantity, parse_quantity

    try:
        return parse_quantity(text.strip(), kind)
    except BadQuantity as error:
        raise ProblemError(
            error.reason, key=option, value=whole or text, allowed=error.allowed
        ) from None


def parse_speed(text: str) -> float:
    """Convert the value of `--speed`, a percentage or a fraction, to a fraction.

    `10%`, `10 %` and `0.1` all give 0.1. The function raises ProblemError for other texts.
    """
    return parse_option_quantity("--speed", text, "share")


REPORT_INTERVAL = 1.0
"""Shortest interval between two reports of a step that counts items, s."""
ALWAYS_REPORTED_STEPS = 5
"""Number of the first counted items that are always reported."""


def progress_reporter(message: str = "") -> Progress:
    """Return a function that prints each step of a command on stderr with the elapsed time.

    If a step counts items, an estimate of the remaining time is added. On a terminal, such a step
    replaces the line of the previous one.

    Parameters
    ----------
    message : str
        Description of a first step, which is printed at once. It may be empty.

    Returns
    -------
    callable
        Function with one argument, the `Step` that begins.
    """
    start = last_report = series_start = time.perf_counter()
    first_done = -1
    is_terminal = sys.stderr.isatty()

    def report(step: Step) -> None:
        """Print a step and the estimated remaining time.

        In a long series of steps, only the first few and the last step are always printed. The
        others are left out if less than `REPORT_INTERVAL` seconds have passed since the last line.

        Parameters
        ----------
        step : Step
            Step that has just been reached.
        """
        nonlocal last_report, first_done, series_start
        now = time.perf_counter()
        estimate = ""
        if step.total:
            if step.done == 0 or first_done < 0:
                first_done = step.done
                series_start = now
            is_last = step.done + 1 >= step.total
            if (
                step.done >= ALWAYS_REPORTED_STEPS
                and not is_last
                and now - last_report < REPORT_INTERVAL
            ):
                return
            elapsed = now - series_start
            newly_done = step.done - first_done
            if newly_done > 0 and elapsed > REPORT_INTERVAL:
                remaining = elapsed / newly_done * (step.total - step.done)
                estimate = f", about {remaining:.0f} s left"
        last_report = now
        text = f"[{now - start:6.2f} s] {step}{estimate}"
        if is_terminal:
            text = f"\x1b[K{text[: terminal_width() - 1]}"  # the code clears the line
        end = "\r" if is_terminal and step.total else "\n"
        print(text, file=sys.stderr, end=end, flush=True)

    if message:
        report(Step(message))
    return report


def fill_in_template(template: str, **values: Any) -> list[str]:
    """Fill in a template of cli/templates, and return the lines of the text.

    Parameters
    ----------
    template : str
        File name of the template.
    **values
        Values of the variables in the template.
    """
    from ssm_planner.display import jinja_environment, render_template

    templates = jinja_environment("ssm_planner.cli", escape=False, degrees=math.degrees)
    return render_template(templates, template, **values).splitlines()


def print_result(options: Namespace, document: Any, lines: Iterable[object]) -> None:
    """Print a result on stdout: as JSON with the option --json, otherwise as lines of text.

    Parameters
    ----------
    options : Namespace
        Options of the command, of which this function reads `json`.
    document : object
        Result for --json. It consists of JSON types and paths.
    lines : iterable of str and Table
        The same result as text and tables for the terminal.
    """
    if options.json:
        print(_to_json(document))
    else:
        print_lines(lines)


def print_result_with_page(
    options: Namespace,
    name: str,
    document: Any,
    lines: Sequence[Any],
    files: Iterable[Path] = (),
) -> None:
    """Print a result, and write it as an HTML page if the option --output is set.

    Parameters
    ----------
    options : Namespace
        Options of the command, with `output` and `json`.
    name : str
        Title of the page, and name of its file without suffix.
    document : object
        Result as JSON types and paths.
    lines : sequence of str and Table
        Result as text and tables. The last line is the verdict.
    files : iterable of Path
        Paths of written files. The page shows the PNG files among them, and it leaves out the lines
        that end with one of these paths.

    Raises
    ------
    ExportError
        If the page cannot be written.
    """
    if options.output is not None:
        from ssm_planner.atomic import output_file
        from ssm_planner.reporting import write_outcome

        page = output_file(options.output, ".yaml", Path(f"{name}.yaml")).with_suffix(".html")
        *others, verdict = lines
        paths = tuple(map(str, files))
        parts = [line for line in others if not str(line).endswith(paths)]
        write_outcome(page, name, verdict, parts, files)
        lines = [*others, f"file: {page}", verdict]
    print_result(options, document, lines)


def write_results(
    folder: Path | None, name: str, document: Any, write: Callable[[Path], Mapping[str, Path]]
) -> Files:
    """Write <name>.json and further files into a folder, all at once or not at all.

    Parameters
    ----------
    folder : Path or None
        Destination. None writes nothing, and the result is empty.
    name : str
        Name of the JSON file without suffix.
    document : object
        Content of the JSON file as JSON types and paths.
    write : callable
        Function that writes the further files into a folder and returns their paths by name.

    Returns
    -------
    dict
        Paths of all files by name.

    Raises
    ------
    ExportError
        If a file cannot be written.
    """
    if folder is None:
        return {}
    from ssm_planner.publishing import publishing

    with publishing(folder) as temporary:
        files = {name: temporary / f"{name}.json"}
        files |= write(temporary)
        files[name].write_text(_to_json(document) + "\n", encoding="utf-8")
    return {key: folder / path.name for key, path in files.items()}


def _to_json(document: Any) -> str:
    """Format a document of JSON types and paths as JSON text.

    The function raises ValueError for infinite and undefined numbers.
    """
    return json.dumps(document, indent=1, allow_nan=False, default=os.fspath)
