"""Draw the figures of a study: its front, and the stages that rejected candidates."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ssm_planner.reporting import COLOURS, FIFTH, finish, legend, new_figure, save_figures
from ssm_planner.studies.page import choices_at, scaled, title_of
from ssm_planner.studies.store import Candidate, Candidates
from ssm_planner.studies.study import Study
from ssm_planner.typing import Files, Keywords

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKERS = ("o", "s", "^", "D", "v", "P", "X")
STAGE_COLOURS = ("0.45", *COLOURS[1:3], FIFTH, COLOURS[3])


def write_study_figures(
    study: Study,
    reference: Candidate,
    rows: Candidates,
    front: Candidates,
    folder: Path,
) -> Files:
    """Write the figures `front` and `map` as PNG and PDF, and return the paths by name.

    The figure `front` needs two objectives, and the figure `map` two variables. Raises ExportError
    if a file cannot be written.

    Parameters
    ----------
    study
        The study.
    reference
        Result of the study's own robot.
    rows
        Results of all candidates.
    front
        Results of the candidates on the front.
    folder
        Folder of the files.
    """
    plots: dict[str, Figure] = {}
    names = [
        name for name in study.minimise if any(row.figures.get(name) is not None for row in front)
    ]
    if len(names) > 1:
        plots["front"] = new_figure(5.5, 4.0)
        _front(plots["front"].add_subplot(), rows, reference, front, names)
    if len(study.vary) > 1 and rows:
        plots["map"] = new_figure(6.5, 4.0)
        _map(plots["map"].add_subplot(), study, rows)
    return save_figures(plots, folder)


def _front(
    axes: "Axes", rows: Candidates, reference: Candidate, front: Candidates, names: list[str]
) -> None:
    """Plot the planned candidates, the front and the study's own robot over two objectives."""

    def coordinates(candidates: Candidates) -> Any:
        values = [[scaled(name, row.figures) for name in names[:2]] for row in candidates]
        return np.array(values, dtype=float).reshape(-1, 2).T

    finished = [row for row in rows if row.state == "done"]
    axes.plot(
        *coordinates(finished), "o", markersize=3, color="0.6", label=f"planned, {len(finished)}"
    )
    axes.plot(
        *coordinates(front), "o-", markersize=5, color=COLOURS[0], label=f"front, {len(front)}"
    )
    if reference.state == "done":
        axes.plot(
            *coordinates([reference]),
            "*",
            markersize=12,
            color=COLOURS[1],
            label="the study's own robot",
        )
    finish(axes, *(title_of(name) for name in names[:2]))
    legend(axes)


def _map(axes: "Axes", study: Study, rows: Candidates) -> None:
    """Plot the state of every candidate over the first two variables."""
    horizontal, vertical = (choices_at(study, path, rows) for path in study.paths[:2])
    points: dict[str, list[tuple[float, float]]] = {}
    for x, y, row in zip(horizontal["at"], vertical["at"], rows, strict=True):
        points.setdefault(row.rejection or row.state, []).append((x, y))
    for k, state in enumerate(sorted(points, key=lambda state: (state != "done", state))):
        colour = COLOURS[0] if state == "done" else STAGE_COLOURS[k % len(STAGE_COLOURS)]
        style: Keywords = {"color": colour, "label": f"{state}, {len(points[state])}"}
        x_values, y_values = zip(*points[state], strict=True)
        axes.plot(x_values, y_values, MARKERS[k % len(MARKERS)], markersize=4, **style)
    finish(axes, horizontal["title"], vertical["title"])
    legend(axes, loc="center left", bbox_to_anchor=(1.0, 0.5))
