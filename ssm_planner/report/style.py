"""One style for all figures: units, legends, colours that survive colour blindness and grey print."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from ssm_planner.export.atomic import replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#000000")
"""Joints 1 to 4 (Okabe–Ito); line styles tell them apart in grey."""
FIFTH = "#A0457E"
"""For a fifth curve, with a dash of its own."""
DASHES = ("-", "--", "-.", ":")
LIMIT = {"color": "0.45", "linewidth": 0.9, "linestyle": (0, (4, 2))}
SIZE = 9.0
DPI = 110
RPM = 30.0 / math.pi
SHOWN = {"rad": ("°", 180.0 / math.pi), "m": ("mm", 1e3), "N·m": ("mN·m", 1e3), "rpm": ("rpm", RPM)}


def unit_of(unit: str) -> tuple[str, float]:
    """The unit in which an SI quantity is shown, and the factor to it: rad/s → (°/s, 180/π); "rpm" takes rad/s."""
    base, slash, per = unit.partition("/")
    name, scale = SHOWN.get(base, (base, 1.0))
    return name + slash + per, scale


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


def save_figure(figure: Figure, path: Path, pdf: bool = True) -> dict[str, Path]:
    """Write path.png and, if wanted, path.pdf (TrueType fonts embedded), the same bytes each time; paths by name."""
    from matplotlib import rc_context

    paths = {}
    for ending, key in (("png", "figure"), ("pdf", "pdf"))[: 1 + pdf]:
        paths[f"{path.name}_{key}"] = target = path.with_suffix(f".{ending}")
        metadata = {"CreationDate": None} if ending == "pdf" else None
        with replacing(target) as temporary, rc_context({"pdf.fonttype": 42}):
            figure.savefig(temporary, dpi=DPI, format=ending, metadata=metadata)
    return paths
