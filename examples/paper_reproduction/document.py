"""Compute all sections of the document, and write it with its pictures into one folder."""

import itertools
from collections.abc import Sequence
from pathlib import Path

from paper_reproduction.departures import departures_section
from paper_reproduction.friction import RigResult, friction_section, rig_result, rigs_section
from paper_reproduction.motions import (
    SpeedRun,
    motions_section,
    payload_section,
    payloads,
    speed_runs,
)
from paper_reproduction.published import RIGS, TABLE_III, Inputs, read_inputs
from paper_reproduction.section import Section, render
from paper_reproduction.workspace import design_section, workspace_section
from ssm_planner.progress import Progress, Step, silent
from ssm_planner.publishing import publishing
from ssm_planner.reporting import save_figures
from ssm_planner.typing import Files, record

FILE = "README.md"


@record
class Document:
    """Document with all its sections, and the results that they present."""

    sections: tuple[Section, ...]
    runs: tuple[SpeedRun, ...]
    rigs: tuple[RigResult, ...]

    @property
    def is_certified(self) -> bool:
        """True if every motion was planned and passed the independent check."""
        return all(run.plan.passed for run in self.runs)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Descriptions of the parts that are missing because their data are missing."""
        return tuple(f"{rig.title}: {rig.left_out}" for rig in self.rigs if rig.left_out)

    def markdown(self) -> str:
        """Return the text of the document. It depends on the inputs, but not on time or folders."""
        return render("document", sections=self.sections)


def reproduce(
    folder: Path, problems: Path, recordings: Path, progress: Progress
) -> tuple[Files, bool, tuple[str, ...]]:
    """Compute the document, and write it into a folder.

    Parameters
    ----------
    folder, problems, recordings, progress
        Arguments of `ssm_planner.reproduce`.

    Returns
    -------
    files, passed, left_out
        Attributes of `ssm_planner.Reproduction`.
    """
    document = compute(read_inputs(problems, recordings), progress)
    files = write(document, folder, progress)
    return files, document.is_certified, document.left_out


def compute(inputs: Inputs, progress: Progress = silent) -> Document:
    """Compute all sections of the document.

    Raises RecordingError if the table of the test rigs cannot be read.
    """
    number = itertools.count()
    steps = 4 + len(RIGS) + len(TABLE_III)

    def report_step(step: str) -> None:
        progress(Step(step, next(number), steps))

    report_step("Table I, workspace, choice of the axes")
    sections = [workspace_section(inputs.robot), design_section(inputs.robot, inputs.eye)]
    report_step("Table II and its maps")
    sections.append(friction_section(inputs.robot))
    rigs = []
    for name in RIGS:
        report_step(f"identifying {name}")
        rigs.append(rig_result(inputs, name))
    report_step("payload curves")
    payload = payload_section(payloads(inputs))
    runs = speed_runs(inputs.problem, report_step)
    report_step("departures of the package")
    rig_results = tuple(rigs)
    sections += [
        rigs_section(rig_results),
        payload,
        motions_section(inputs.problem, runs),
        departures_section(inputs, runs, rig_results),
    ]
    return Document(tuple(sections), runs, rig_results)


def write(document: Document, folder: Path, progress: Progress = silent) -> Files:
    """Write README.md and every picture as PNG and PDF, and return the paths by name.

    All files are written together or not at all. Raises ExportError if a file cannot be written.
    """
    with publishing(folder) as temporary:
        for k, section in enumerate(document.sections):
            progress(Step("drawing sections", k, len(document.sections)))
            save_figures(section.figures, temporary)
        (temporary / FILE).write_text(document.markdown(), encoding="utf-8")
        names: Sequence[str] = sorted(path.name for path in temporary.iterdir())
    return {name: folder / name for name in names}
