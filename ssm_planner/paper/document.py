"""The whole document: every section in order, written with its pictures as one folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ssm_planner.atomic import staging
from ssm_planner.paper.departures import departures_section
from ssm_planner.paper.friction import friction_section, payload_section, payloads
from ssm_planner.paper.motions import SpeedRun, motions_section, speed_runs
from ssm_planner.paper.published import RIGS, Inputs
from ssm_planner.paper.rigs import RigResult, rig_result, rigs_section
from ssm_planner.paper.section import COMMAND, Section, table
from ssm_planner.paper.workspace import design_section, workspace_section
from ssm_planner.reporting.figures.style import save_figure

FILE = "README.md"
HEAD = f"""# The paper, recomputed

A. Mablekos-Alexiou, L. da Cruz, C. Bergeles, "Geometric Workspace Analysis and Transmission-Aware Dynamics of a Serial
Spherical Tool for Microsurgery": every table and figure of it that can be recomputed, ours beside the published value,
and why they differ where they do. This page and its pictures come from

```
{COMMAND}
```

run in the project's folder; `--recordings DIR` names the recordings of the rigs, without which their predictions are left
out. "The package" is the software that the paper cites, RViMLab/TRO2021-Dynamic-Modelling. Torques are at the motor;
pictures link to their PDF.
"""
NOT_HERE = (
    ("photograph of the tool, CAD drawings, eye sections, video snapshots", "pictures of things, nothing to compute"),
    ("circles of the torque–velocity maps; Table II's fit", "the prototype's recordings are not public"),
    ("NRMSD of Table III", "the prototype's recordings are not public"),
    ("measured tilt range of Table I", "protractor readings"),
    ("100 mm of separation", "link lengths are in the CAD drawing only"),
    ("numbers of the payload curves", "the figure is not in the paper's source, and no number is printed"),
)


@dataclass(frozen=True, eq=False)
class Document:
    """The sections, and the results that a program may want as values."""

    sections: tuple[Section, ...]
    runs: tuple[SpeedRun, ...]
    rigs: tuple[RigResult, ...]

    @property
    def passed(self) -> bool:
        """Every motion was planned and passed the independent check."""
        return all(run.plan.passed for run in self.runs)

    @property
    def left_out(self) -> tuple[str, ...]:
        """What is missing because its data is not here."""
        return tuple(f"{rig.title}: {rig.left_out}" for rig in self.rigs if rig.left_out)

    def markdown(self) -> str:
        """The same for the same inputs: no time, no date, no folder of this machine."""
        contents = [f"* [{section.title}](#{_anchor(section.title)})" for section in self.sections]
        body = [line for section in self.sections for line in section.markdown()]
        rest = ["## What is not here", "", *table(("of the paper", "why not"), NOT_HERE, words=(1,))]
        return "\n".join([HEAD, *contents, "", *body, *rest]).rstrip() + "\n"


def compute(inputs: Inputs, progress: Callable[[str], None] = lambda _: None) -> Document:
    """Every section, computed. Raises RecordingError where the rigs' table of figures cannot be read."""
    progress("Table I, workspace, choice of the axes")
    sections = [workspace_section(inputs.robot), design_section(inputs.robot)]
    progress("Table II and its maps")
    sections.append(friction_section(inputs.robot))
    rigs = []
    for name in RIGS:
        progress(f"identifying {name}")
        rigs.append(rig_result(inputs, name))
    progress("payload curves")
    payload = payload_section(payloads(inputs))
    runs = speed_runs(inputs.problem, progress)
    progress("departures of the package")
    found = tuple(rigs)
    sections += [
        rigs_section(found),
        payload,
        motions_section(inputs.problem, runs),
        departures_section(inputs, runs, found),
    ]
    return Document(tuple(sections), runs, found)


def write(document: Document, folder: Path) -> dict[str, Path]:
    """README.md and every picture as PNG and PDF, whole or not at all; paths by name. Raises ExportError."""
    with staging(folder, last=FILE) as temporary:
        for section in document.sections:
            for name, figure in section.figures.items():
                save_figure(figure, temporary / name)
        (temporary / FILE).write_text(document.markdown(), encoding="utf-8")
        names: Sequence[str] = sorted(path.name for path in temporary.iterdir())
    return {name: folder / name for name in names}


def _anchor(title: str) -> str:
    """As GitHub makes it of a heading."""
    kept = "".join(letter for letter in title.lower() if letter.isalnum() or letter in " -_")
    return kept.replace(" ", "-")
