"""Write a page for the outcome of a command that has no page of its own."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from pathlib import Path

from ssm_planner.atomic import replacing
from ssm_planner.reporting.html.page import render
from ssm_planner.reporting.text import Table


def write_outcome(
    path: Path,
    title: str,
    conclusion: str,
    lines: Iterable[str] = (),
    tables: Iterable[Table] = (),
    figures: Iterable[Path] = (),
) -> Path:
    """Write a page that begins with its conclusion. Raises ExportError.

    Parameters
    ----------
    path : Path
        The page.
    title : str
    conclusion : str
        First sentence of the page.
    lines : Iterable[str]
        Text as in the terminal.
    tables : Iterable[Table]
    figures : Iterable[Path]
        PNG files that the page contains. Other files are ignored.
    """
    images = [
        (file.stem, base64.b64encode(file.read_bytes()).decode("ascii"))
        for file in figures
        if file.suffix == ".png"
    ]
    text = render(
        "outcome.html",
        None,
        title=title,
        conclusion=conclusion[0].upper() + conclusion[1:],
        text="\n".join(lines),
        tables=tables,
        figures=images,
    )
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path
