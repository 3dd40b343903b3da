"""Common parts of commands: arguments, progress on stderr, results on stdout and in a folder."""

from __future__ import annotations

import argparse
import json
import re
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ssm_planner.cli.terminal import printed
from ssm_planner.display import columns
from ssm_planner.errors import ProblemError

OK, FAILED = 0, 1


def plan_argument(
    parser: argparse.ArgumentParser, text: str = "plan.json, or the result folder that contains it"
) -> None:
    """Add the argument PLAN."""
    parser.add_argument("plan", type=Path, help=text)


def output_arguments(
    parser: argparse.ArgumentParser,
    text: str | None = None,
    metavar: str = "DIR",
    default: Path | None = None,
) -> None:
    """Add --json, and --output for a command that writes files. text describes the files."""
    if text is not None:
        parser.add_argument(
            "-o", "--output", type=Path, metavar=metavar, default=default, help=text
        )
    parser.add_argument("--json", action="store_true", help="print the result as JSON on stdout")


def output_file(path: Path | None, suffix: str, default: Path) -> Path:
    """Return the path of the main file of a command.

    -o is the file if it has the suffix, otherwise its folder.
    """
    if path is None:
        return default
    return path if path.suffix.lower() == suffix and not path.is_dir() else path / default.name


def quantity_argument(kind: str) -> Callable[[str], float]:
    """Return an argparse type for a quantity with unit, such as `-140deg`.

    kind is a key of units.KINDS.
    """

    def convert(text: str) -> float:
        from ssm_planner.units import BadQuantity, quantity

        try:
            return quantity(text.strip(), kind)
        except BadQuantity as error:
            raise argparse.ArgumentTypeError(f"{text.strip()!r}: {error}") from error

    return convert


def rate_argument(text: str) -> float:
    """Return the rate in Hz for `500`, `500 Hz` or `1kHz`."""
    match = re.fullmatch(r"([0-9.eE+]+)\s*(k?Hz)?", text.strip(), re.I)
    try:
        value = float(match.group(1)) if match else -1.0
    except ValueError:
        value = -1.0
    if value <= 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a rate such as 500 or 1kHz")
    return value * (1000 if match is not None and (match.group(2) or "").lower() == "khz" else 1)


def part_quantity(option: str, text: str, kind: str, whole: str | None = None) -> float:
    """Return a quantity that is part of an option's value.

    whole is the complete value, for messages. Raises ProblemError.
    """
    from ssm_planner.units import BadQuantity, quantity

    try:
        return quantity(text.strip(), kind)
    except BadQuantity as error:
        value = text if whole is None else whole
        raise ProblemError(error.reason, key=option, value=value, allowed=error.allowed) from None


def share(text: str, option: str = "--speed") -> float:
    """Return 0.1 for the value `10%`, `10 %` or 0.1 of an option. Raises ProblemError."""
    word = text.strip()
    try:
        return float(word.removesuffix("%")) / 100 if word.endswith("%") else float(word)
    except ValueError:
        raise ProblemError(
            "invalid share", key=option, value=text, allowed="such as 10% or 0.1"
        ) from None


COUNTED = re.compile(r"\b(\d+) of (\d+)\b")
EVERY = 1.0
"""Interval in s between reports of counted steps after the first ones."""
FIRST = 5


def progress_reporter() -> Callable[[str], None]:
    """Return a function that reports each step on stderr with the elapsed time.

    Counted steps ("3 of 62") are reported with the remaining time.
    """
    begin = shown = time.perf_counter()
    first, series = 0, begin
    live = sys.stderr.isatty()

    def report(step: str) -> None:
        nonlocal shown, first, series
        now, left, end = time.perf_counter(), "", "\n"
        if found := COUNTED.search(step):
            number, count = int(found[1]), int(found[2])
            if number <= 1 or first == 0:
                first, series = number, now
            if FIRST < number < count and now - shown < EVERY:
                return
            if number > first and now - series > EVERY:
                left = (
                    f", about {(now - series) / (number - first) * (count - number + 1):.0f} s left"
                )
            end = "\r" if live else "\n"
        shown = now
        text = f"[{now - begin:6.2f} s] {step}{left}"
        print(
            f"\x1b[K{text[: columns() - 1]}" if live else text, file=sys.stderr, end=end, flush=True
        )

    return report


def show(as_json: bool, document: Any, lines: Callable[[], Iterable[str]]) -> None:
    """Print the result on stdout as one JSON document or as lines of text."""
    if as_json:
        print(_json(document))
    else:
        printed(lines())


def show_with_page(
    options: argparse.Namespace,
    name: str,
    document: Any,
    lines: Sequence[str],
    files: Iterable[str] = (),
) -> None:
    """Print a result that ends with its verdict, and write it as a page into the folder of -o.

    name: stem of the page. files: the PNG files among them appear in the page. Raises ExportError.
    """
    if options.output is not None:
        from ssm_planner.reporting.html.outcome import write_outcome

        page = output_file(options.output, ".yaml", Path(f"{name}.yaml")).with_suffix(".html")
        write_outcome(page, name, lines[-1], lines, figures=map(Path, files))
        lines = [*lines[:-1], f"file: {page}", lines[-1]]
    show(options.json, document, lambda: lines)


def write_results(
    folder: Path | None, name: str, document: Any, write: Callable[[Path], Mapping[str, Path]]
) -> dict[str, str]:
    """Write <name>.json and the files of `write` into the folder at once.

    It returns their paths by name, or no paths without a folder. Raises ExportError.
    """
    if folder is None:
        return {}
    from ssm_planner.publishing import publishing

    with publishing(folder) as temporary:
        written = write(temporary)
        file = temporary / f"{name}.json"
        file.write_text(_json(document) + "\n", encoding="utf-8")
    return {key: str(folder / path.name) for key, path in {name: file, **written}.items()}


def _json(document: Any) -> str:
    return json.dumps(document, indent=1, allow_nan=False)
