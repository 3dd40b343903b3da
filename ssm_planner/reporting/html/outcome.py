"""Write the page of a command that uses the general template of a page."""

import base64
from collections.abc import Iterable, Sequence
from pathlib import Path

from ssm_planner.atomic import write_text
from ssm_planner.reporting.html.page import PAGE_MARK, render_page
from ssm_planner.reporting.text import Table


def write_outcome(
    path: Path,
    title: str,
    conclusion: str,
    parts: Iterable[str | Table] = (),
    figures: Iterable[Path] = (),
    steps: Sequence[str] = (),
) -> Path:
    """Write a page that begins with its conclusion, and return its path.

    Parameters
    ----------
    path : Path
        File of the page.
    title : str
        Title of the page.
    conclusion : str
        First sentence of the page. It must not be empty.
    parts : iterable of str and Table
        Lines of text and tables, in the order in which the page shows them.
    figures : iterable of Path
        PNG files that become part of the page. Other files are ignored.
    steps : sequence of str
        Texts of a slider.

    Raises
    ------
    ExportError
        If the page cannot be written.
    """
    images = [
        (file.stem, base64.b64encode(file.read_bytes()).decode("ascii"))
        for file in figures
        if file.suffix == ".png"
    ]
    text = render_page(
        "outcome.html",
        None,
        title=title,
        conclusion=conclusion[0].upper() + conclusion[1:],
        parts=parts,
        figures=images,
        steps=steps,
    )
    write_text(path, text, PAGE_MARK)
    return path
