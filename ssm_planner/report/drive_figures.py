"""Figures of drives: the torque–velocity map and predicted against measured torque."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ssm_planner.identify.fit import MapFit
    from ssm_planner.identify.prediction import Prediction
    from ssm_planner.identify.torque_map import TorqueMap

RPM = 30.0 / math.pi
MODEL = {"color": "#c1272d", "linestyle": (0, (5, 3)), "linewidth": 1.4}
MEASURED = {"color": "black", "linewidth": 0.8}
OUTLIER = {"color": "#c1272d", "marker": "x", "markersize": 7, "linestyle": "none"}


def map_figure(fit: MapFit, data: TorqueMap, load: float) -> Figure:
    """Torque–velocity map: measured circles, the fitted law dashed in both directions, outliers crossed.

    load: the constant effort of `fit_map`, N·m or N.
    """
    from ssm_planner.identify.parameters import map_torque

    figure, axes = _figure(4.6, 3.2)
    outliers = {name for name, _, _ in fit.outliers}
    apart = np.array([name in outliers for name in data.names])
    axes.plot(RPM * data.w, 1e3 * data.tau, "o", color="black", fillstyle="none", markersize=5, label="measured")
    if apart.any():
        axes.plot(RPM * data.w[apart], 1e3 * data.tau[apart], **OUTLIER, label="outlier, weighs less")
    for sign in (-1.0, 1.0):
        side = data.w[np.sign(data.w) == sign]
        w = sign * np.geomspace(np.abs(side).min(), np.abs(side).max(), 200)
        label = f"{fit.law.replace('_', ' ')}, NRMSD {fit.nrmsd:.3f}" if sign > 0 else None
        axes.plot(RPM * w, 1e3 * map_torque(fit.drive, w, load), **MODEL, label=label)
    axes.set_xlabel("motor speed [rpm]")
    axes.set_ylabel("motor torque [mN·m]")
    axes.set_title(fit.drive.name, fontsize=9)
    axes.axhline(0, color="0.8", linewidth=0.6, zorder=0)
    axes.axvline(0, color="0.8", linewidth=0.6, zorder=0)
    axes.legend(fontsize=7, frameon=False, loc="best")
    return figure


def prediction_figure(prediction: Prediction) -> Figure:
    """Measured and predicted motor torque over time, above the measured speed that the prediction took."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.6, 3.8), layout="constrained")
    torque, speed = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    recording = prediction.recording
    torque.plot(recording.time, 1e3 * recording.tau, **MEASURED, label="measured")
    torque.plot(recording.time, 1e3 * prediction.tau, **MODEL, label=f"predicted, NRMSD {prediction.nrmsd:.3f}")
    torque.set_ylabel("motor torque [mN·m]")
    torque.set_title(recording.name, fontsize=9)
    torque.legend(fontsize=7, frameon=False, loc="best")
    speed.plot(recording.time, RPM * recording.w, **MEASURED)
    speed.set_ylabel("speed [rpm]")
    speed.set_xlabel("time [s]")
    for axes in (torque, speed):
        _plain(axes)
        axes.axhline(0, color="0.8", linewidth=0.6, zorder=0)
    return figure


def save(figure: Figure, path: str | Path) -> str:
    """Write a figure; the suffix chooses the format. Returns the path written."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=160)
    return str(path)


def _figure(width: float, height: float) -> tuple[Figure, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots()
    _plain(axes)
    return figure, axes


def _plain(axes: Any) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)
    axes.xaxis.label.set_size(8)
    axes.yaxis.label.set_size(8)
