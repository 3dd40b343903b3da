"""One style for all figures: units, legends, colours that survive colour blindness and grey print."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#000000")
"""Joints 1 to 4 (Okabe–Ito); line styles tell them apart in grey."""
DASHES = ("-", "--", "-.", ":")
LIMIT = {"color": "0.45", "linewidth": 0.9, "linestyle": (0, (4, 2))}
SIZE = 9.0


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, inches, without pyplot's global state."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def finish(axes: Axes, x: str, y: str) -> None:
    """Labels, light grid, no frame above and to the right."""
    axes.set_xlabel(x, fontsize=SIZE)
    axes.set_ylabel(y, fontsize=SIZE)
    axes.tick_params(labelsize=SIZE - 1)
    axes.grid(True, color="0.9", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
