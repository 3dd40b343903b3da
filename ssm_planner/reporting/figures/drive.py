"""Figures of drives: the torque–velocity map and predicted against measured torque."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ssm_planner.reporting.figures.style import AXIS, COLOURS, SIZE, finish, new_figure
from ssm_planner.units import RPM

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ssm_planner.identification.fit import MapFit
    from ssm_planner.identification.prediction import Prediction
    from ssm_planner.identification.torque_map import TorqueMap


MODEL: dict[str, Any] = {"color": COLOURS[1], "linestyle": (0, (5, 3)), "linewidth": 1.4}
MEASURED: dict[str, Any] = {"color": "black", "linewidth": 0.8}
OUTLIER: dict[str, Any] = {"color": COLOURS[1], "marker": "x", "markersize": 7, "linestyle": "none"}


def map_figure(fit: MapFit, data: TorqueMap, load: float) -> Figure:
    """Torque–velocity map: measured circles, the fitted law dashed in both directions, outliers crossed.

    load: the constant effort of `fit_map`, N·m or N.
    """
    from ssm_planner.identification.parameters import map_torque

    figure = new_figure(6.0, 3.8)
    axes = figure.subplots()
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
    finish(axes, "motor speed (rpm)", "motor torque (mN·m)")
    axes.set_title(fit.drive.name, fontsize=SIZE)
    axes.axhline(0.0, **AXIS)
    axes.axvline(0.0, **AXIS)
    axes.legend(fontsize=SIZE - 1, frameon=False, loc="best")
    return figure


def prediction_figure(prediction: Prediction) -> Figure:
    """Measured and predicted motor torque over time, above the measured speed that the prediction took."""
    figure = new_figure(7.2, 4.4)
    torque, speed = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    recording = prediction.recording
    torque.plot(recording.time, 1e3 * recording.tau, **MEASURED, label="measured")
    torque.plot(recording.time, 1e3 * prediction.tau, **MODEL, label=f"predicted, NRMSD {prediction.nrmsd:.3f}")
    speed.plot(recording.time, RPM * recording.w, **MEASURED)
    finish(torque, "", "motor torque (mN·m)")
    finish(speed, "time (s)", "motor speed\n(rpm)")
    torque.set_title(recording.name, fontsize=SIZE)
    torque.legend(fontsize=SIZE - 1, frameon=False, loc="best")
    for axes in (torque, speed):
        axes.axhline(0.0, **AXIS)
    return figure
