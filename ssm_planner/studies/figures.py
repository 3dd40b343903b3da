"""Draw the front of a study's first two objectives, and the stages that rejected candidates."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ssm_planner.reporting.figures.style import (
    COLOURS,
    FIFTH,
    finish,
    legend,
    new_figure,
    save_figures,
)
from ssm_planner.studies.page import choices_at, scaled, title_of
from ssm_planner.studies.store import Candidate
from ssm_planner.studies.study import Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKERS = ("o", "s", "^", "D", "v", "P", "X")
STAGE_COLOURS = ("0.45", *COLOURS[1:3], FIFTH, COLOURS[3])


def write_study_figures(
    study: Study,
    reference: Candidate,
    rows: Sequence[Candidate],
    front: Sequence[Candidate],
    folder: Path,
) -> dict[str, Path]:
    """Write `front` and `map` as PNG and PDF if they have content; return the paths by name.

    Raises ExportError.
    """
    plots: dict[str, Figure] = {}
    names = [
        name for name in study.minimise if any(row.figures.get(name) is not None for row in front)
    ]
    if len(names) > 1:
        plots["front"] = new_figure(5.5, 4.0)
        _front(plots["front"].add_subplot(), study, rows, reference, front, names=names)
    if len(study.vary) > 1 and rows:
        plots["map"] = new_figure(6.5, 4.0)
        _map(plots["map"].add_subplot(), study, rows)
    return save_figures(plots, folder)


def _front(
    axes: Axes,
    study: Study,
    rows: Sequence[Candidate],
    reference: Candidate,
    front: Sequence[Candidate],
    names: list[str],
) -> None:
    """Plot planned candidates, the front and the study's own robot by the first two objectives."""

    def coordinates(candidates: Sequence[Candidate]) -> Any:
        return (
            np.array(
                [[scaled(name, row.figures) for name in names[:2]] for row in candidates],
                dtype=float,
            )
            .reshape(-1, 2)
            .T
        )

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


def _map(axes: Axes, study: Study, rows: Sequence[Candidate]) -> None:
    """Plot the state of every candidate by its first two variables."""
    across, up = (choices_at(study, path, rows) for path in study.paths[:2])
    states = [
        row.state if row.state in ("done", "waiting") else row.stage or row.state for row in rows
    ]
    kinds = sorted(set(states), key=lambda state: (state != "done", state))
    for k, row_state in enumerate(kinds):
        points = [
            (x, y)
            for x, y, state in zip(across["at"], up["at"], states, strict=True)
            if state == row_state
        ]
        colour = COLOURS[0] if row_state == "done" else STAGE_COLOURS[k % len(STAGE_COLOURS)]
        marker = MARKERS[k % len(MARKERS)]
        label = f"{row_state}, {len(points)}"
        axes.plot(*zip(*points, strict=True), marker, markersize=4, color=colour, label=label)
    finish(axes, across["title"], up["title"])
    legend(axes, loc="center left", bbox_to_anchor=(1.0, 0.5))
