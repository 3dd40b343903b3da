"""Draw the figures of a study: its Pareto front, and the stages that rejected candidates.

A candidate is one of the robots that the study compares. A stage is a step of its evaluation, such
as the test of the reach or the planning.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ssm_planner.reporting import (
    COLOURS,
    FIFTH_COLOUR,
    draw_legend,
    finish_axes,
    new_figure,
    save_figures,
)
from ssm_planner.studies.page import axis_title, displayed_result, variable_column
from ssm_planner.studies.store import Candidate, Candidates
from ssm_planner.studies.study import Study
from ssm_planner.typing import Files

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKERS = ("o", "s", "^", "D", "v", "P", "X")
"""Markers of the states and stages in the figure `map`."""
STAGE_COLOURS = ("0.45", COLOURS[1], COLOURS[2], FIFTH_COLOUR, COLOURS[3])
"""Colours of the stages that reject candidates in the figure `map`."""


def write_study_figures(
    study: Study, reference: Candidate, rows: Candidates, front: Candidates, folder: Path
) -> Files:
    """Write the figures `front` and `map` as PNG and PDF.

    The figure `front` shows the first two objectives of all candidates, and requires at least two
    objectives. The figure `map` shows the state of every candidate over the first two variables,
    and requires at least two variables.

    Parameters
    ----------
    study : Study
        Study that is shown.
    reference : Candidate
        Result of the original robot.
    rows : sequence of Candidate
        Results of all candidates.
    front : sequence of Candidate
        Results of the candidates on the front.
    folder : Path
        Folder of the files.

    Returns
    -------
    dict
        Paths by name, such as "front_figure" for a PNG and "front_pdf" for a PDF.

    Raises
    ------
    ExportError
        If a file cannot be written.
    """
    plots: dict[str, Figure] = {}
    names = [
        name for name in study.minimise if any(row.figures.get(name) is not None for row in front)
    ]
    if len(names) > 1:
        plots["front"] = new_figure(5.5, 4.0)
        _plot_front(plots["front"].add_subplot(), rows, reference, front, names)
    if len(study.vary) > 1 and rows:
        plots["map"] = new_figure(6.5, 4.0)
        _plot_map(plots["map"].add_subplot(), study, rows)
    return save_figures(plots, folder)


def _plot_front(
    axes: "Axes", rows: Candidates, reference: Candidate, front: Candidates, names: list[str]
) -> None:
    """Plot two objectives of all planned candidates, of the front and of the original robot.

    A line connects the front of two objectives. With more objectives, the front is a surface, whose
    points have no order in the plane of two of them.

    Parameters
    ----------
    axes : Axes
        Plot of matplotlib in which the function draws.
    rows : sequence of Candidate
        Results of all candidates.
    reference : Candidate
        Result of the original robot.
    front : sequence of Candidate
        Results of the candidates on the front.
    names : list of str
        Names of the objectives. The first two are on the horizontal and on the vertical axis.
    """

    def plot(candidates: Candidates, style: str, size: int, colour: str, label: str) -> None:
        """Plot candidates with the first objective to the right and the second one upwards."""
        x = [displayed_result(names[0], row.figures) for row in candidates]
        y = [displayed_result(names[1], row.figures) for row in candidates]
        # Missing values become NaN, which the plot leaves out.
        points = np.array([x, y], dtype=float)
        axes.plot(points[0], points[1], style, markersize=size, color=colour, label=label)

    finished = [row for row in rows if row.state == "done"]
    plot(finished, "o", 3, "0.6", f"planned, {len(finished)}")
    style = "o-" if len(names) == 2 else "o"
    plot(front, style, 5, COLOURS[0], f"front, {len(front)}")
    if reference.state == "done":
        plot([reference], "*", 12, COLOURS[1], "the study's own robot")
    finish_axes(axes, axis_title(names[0]), axis_title(names[1]))
    draw_legend(axes)


def _plot_map(axes: "Axes", study: Study, rows: Candidates) -> None:
    """Plot the state of every candidate over the first two variables of a study.

    Parameters
    ----------
    axes : Axes
        Plot of matplotlib in which the function draws.
    study : Study
        Study with at least two variables.
    rows : sequence of Candidate
        Results of all candidates. Rejected candidates are marked by the stage that rejected them.
    """
    horizontal = variable_column(study, study.paths[0], rows)
    vertical = variable_column(study, study.paths[1], rows)
    points: dict[str, list[tuple[float, float]]] = {}
    for x, y, row in zip(horizontal["at"], vertical["at"], rows, strict=True):
        points.setdefault(row.rejection or row.state, []).append((x, y))
    for k, state in enumerate(sorted(points, key=lambda state: (state != "done", state))):
        colour = COLOURS[0] if state == "done" else STAGE_COLOURS[k % len(STAGE_COLOURS)]
        x_values, y_values = zip(*points[state], strict=True)
        marker = MARKERS[k % len(MARKERS)]
        label = f"{state}, {len(points[state])}"
        axes.plot(x_values, y_values, marker, markersize=4, color=colour, label=label)
    finish_axes(axes, horizontal["title"], vertical["title"])
    draw_legend(axes, loc="center left", bbox_to_anchor=(1.0, 0.5))
