"""The paper's tilt disks: the sectors that the tool sweeps in a plane through ω₁."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.workspace import tilt_interval
from ssm_planner.report.style import DPI, LIMIT, SIZE, finish, new_figure
from ssm_planner.report.workspace_table import MEASURED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def tilt_disks(mechanism: Mechanism) -> Figure:
    """Both sectors, 2α each, symmetric about ω₁; the home side darker, the measured limits dashed."""
    from matplotlib.patches import Wedge

    figure = new_figure(5.2, 4.4)
    axes = figure.subplots()
    interval = tilt_interval(mechanism)
    low, high = (math.degrees(end) for end in interval)
    for sign, grey, label in ((-1.0, "0.72", "reachable at roll 0°"), (1.0, "0.88", "reachable at roll 180°")):
        ends = sorted((sign * low, sign * high))
        axes.add_patch(Wedge((0.0, 0.0), 1.0, *ends, facecolor=grey, edgecolor="0.3", linewidth=0.8, label=label))
        inside = sign * (0.28 * interval[0] + 0.72 * interval[1])  # beside the line of home
        axes.text(0.75 * math.cos(inside), 0.75 * math.sin(inside), "2α", ha="center", va="center", fontsize=SIZE)
    around = np.linspace(0.0, 2.0 * math.pi, 361)
    axes.plot(np.cos(around), np.sin(around), color="0.8", linewidth=0.8, zorder=0)
    for k, tilt in enumerate(MEASURED):
        _ray(axes, tilt, 1.08, label=None if k else "measured (Table I)", **LIMIT)
    _ray(axes, mechanism.home_tilt, 1.0, color="black", linewidth=1.2, linestyle="-.", label="home")
    for tilt, measured in zip(interval, MEASURED, strict=True):
        shown = f"{math.degrees(tilt):.2f}°\n(measured {math.degrees(measured):.1f}°)".replace("-", "−")
        side = "right" if math.cos(tilt) < 0 else "left"
        axes.text(1.14 * math.cos(tilt), -1.14 * math.sin(tilt), shown, ha=side, va="center", fontsize=SIZE - 1)
    axes.annotate("", (1.3, 0.0), (0.0, 0.0), arrowprops={"arrowstyle": "->"})
    axes.text(1.36, 0.0, "ω₁", ha="left", va="center", fontsize=SIZE)
    finish(axes, "", "")
    axes.set(xlim=(-1.75, 1.6), ylim=(-1.15, 1.35), aspect="equal")
    axes.set_axis_off()
    axes.legend(fontsize=SIZE - 1, frameon=False, loc="upper center", bbox_to_anchor=(0.5, 0.02), ncols=2)
    return figure


def restyled(figure: Figure, size: tuple[float, float] | None = None) -> Figure:
    """A figure of another room with the text sizes and resolution of this document; size in inches."""
    figure.set_dpi(DPI)
    if size is not None:
        figure.set_size_inches(*size)
    for axes in figure.axes:
        axes.tick_params(labelsize=SIZE - 1)
        axes.title.set_fontsize(SIZE)
        axes.xaxis.label.set_fontsize(SIZE)
        axes.yaxis.label.set_fontsize(SIZE)
        for words in axes.texts:
            words.set_fontsize(SIZE)
        legend = axes.get_legend()
        for words in () if legend is None else legend.get_texts():
            words.set_fontsize(SIZE - 1)
    return figure


def _ray(axes: Axes, tilt: float, length: float, **style: Any) -> None:
    axes.plot([0.0, length * math.cos(tilt)], [0.0, -length * math.sin(tilt)], **style)
