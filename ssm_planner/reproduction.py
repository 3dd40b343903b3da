"""Reproduce the paper by the program in `examples/paper_reproduction`."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path

from ssm_planner.arguments import checked
from ssm_planner.errors import ProblemError
from ssm_planner.progress import Progress, Step, silent
from ssm_planner.typing import frozen

PROGRAM_PACKAGE = "paper_reproduction"
"""Name of the program, which is a Python package in the folder of examples."""
EXAMPLES_FOLDER = Path(__file__).resolve().parent.parent / "examples"


@frozen
class Reproduction:
    """Outcome of a reproduction of the paper.

    Attributes
    ----------
    files : Mapping[str, Path]
        Written files by name: README.md and every picture.
    passed : bool
        True if every motion was planned and passed the independent check.
    left_out : tuple of str
        Descriptions of the parts that are missing because their recordings are missing.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.reproduce("results/paper").left_out  # doctest: +SKIP
    """

    files: Mapping[str, Path]
    passed: bool
    left_out: tuple[str, ...]


@checked
def reproduce(
    folder: str | Path,
    problems: str | Path = "problems",
    recordings: str | Path = "../shared/recordings",
    progress: Progress = silent,
) -> Reproduction:
    """Compute the tables and figures of the paper, and write them as one document.

    The computation is an example of the use of the package. It is part of the source tree, and not
    of the installed package.

    Parameters
    ----------
    folder : str or Path
        Folder of README.md and of the pictures.
    problems : str or Path
        The project's folder of problem files.
    recordings : str or Path
        Folder of the recordings of the three rigs. Rows without their recordings are left out.
    progress : callable
        Called with each step.

    Returns
    -------
    Reproduction
        Written files, and whether the motions passed their check.

    Raises
    ------
    ProblemError, RecordingError or ExportError
        If the package is installed without its source tree, if a file of the project is invalid, or
        if a result cannot be written.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.reproduce("results/paper").passed  # doctest: +SKIP
    """
    if not (EXAMPLES_FOLDER / PROGRAM_PACKAGE).is_dir():
        raise ProblemError(
            f"no folder {EXAMPLES_FOLDER / PROGRAM_PACKAGE}: the reproduction of the paper needs "
            "the source tree of ssm_planner",
            allowed="an installation by `pip install -e` from the source tree",
        )
    if str(EXAMPLES_FOLDER) not in sys.path:
        sys.path.append(str(EXAMPLES_FOLDER))
    progress(Step("reading the problem files"))
    files, passed, left_out = import_module(f"{PROGRAM_PACKAGE}.document").reproduce(
        Path(folder), Path(problems), Path(recordings), progress
    )
    return Reproduction(files, passed, left_out)
