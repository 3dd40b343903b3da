"""Draw figures of motors and drives: requirements of a motion, friction maps, predicted torques."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ssm_planner.display import plain_words
from ssm_planner.problem.robot import JOINTS
from ssm_planner.reporting.figures.style import (
    COLOURS,
    DASHES,
    LIMIT,
    SIZE,
    finish,
    legend,
    legend_above,
    new_figure,
    save_figures,
    zero_lines,
)
from ssm_planner.sizing.motor_limits import available_torque, continuous_torque
from ssm_planner.sizing.requirements import PARTS
from ssm_planner.typing import Array, Indices
from ssm_planner.units import RPM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ssm_planner.identification.fit import MapFit
    from ssm_planner.identification.prediction import Prediction
    from ssm_planner.identification.torque_map import TorqueMap
    from ssm_planner.problem.drive import Drive
    from ssm_planner.sizing.assess import MotorVerdict
    from ssm_planner.sizing.size import JointSizing, Sizing


PART_COLOURS = ("#56B4E9", "#009E73", "#0072B2", "#D55E00", "#E69F00")
PART_DASHES = ("--", "-.", ":", "-", (0, (6, 2)))


def write_sizing_figures(sizing: Sizing, folder: Path) -> dict[str, Path]:
    """Write the sizing figures as PNG and PDF and return their paths by name.

    The figures are payload_curves, torque_split and, if motors are assessed, operating_regions.
    There are no figures if the motion moves no driven joint.
    """
    if not sizing.joints:
        return {}
    figures = {
        "payload_curves": payload_curves(sizing),
        "torque_split": torque_split_figure(sizing),
    }
    if sizing.verdicts:
        figures["operating_regions"] = operating_regions(sizing)
    return save_figures(figures, folder)


def payload_curves(sizing: Sizing) -> Figure:
    """Draw motor torque over motor speed.

    Rotary joints are on the left and the translation is on the right. A broad bar shows the band of
    the peak at the stated confidence.
    """
    groups = [
        [joint for joint in sizing.joints if not joint.load.drive.slides],
        [joint for joint in sizing.joints if joint.load.drive.slides],
    ]
    groups = [group for group in groups if group]
    figure = new_figure(3.6 * len(groups) + 0.4, 3.3)
    for axes, group in zip(figure.subplots(1, len(groups), squeeze=False)[0], groups, strict=True):
        for joint in group:
            _curve(axes, joint, sizing.conditions.confidence)
        zero_lines(axes, down=True)
        axes.locator_params(axis="x", nbins=5)
        finish(axes, "motor speed (rpm)", "motor torque (mN·m)")
        legend(axes, loc="upper left")
    return figure


def torque_split_figure(sizing: Sizing) -> Figure:
    """Draw the torque of every joint over time with its parts."""
    figure = new_figure(7.2, 2.2 * len(sizing.joints) + 0.5)
    panels = figure.subplots(len(sizing.joints), 1, squeeze=False)[:, 0]
    for axes, joint in zip(panels, sizing.joints, strict=True):
        t = joint.load.t - joint.load.t[0]
        axes.plot(t, 1e3 * joint.requirement.torque, color="black", linewidth=1.6, label="torque")
        parts = dict(joint.requirement.split.components())
        for name, colour, dash in zip(PARTS, PART_COLOURS, PART_DASHES, strict=True):
            axes.plot(
                t,
                1e3 * parts[name],
                linestyle=dash,
                color=colour,
                linewidth=1.2,
                label=plain_words(name),
            )
        finish(
            axes, "time (s)" if axes is panels[-1] else "", f"{_label(joint)}\nmotor torque (mN·m)"
        )
    legend_above(figure, panels[0], 3)
    return figure


def operating_regions(sizing: Sizing) -> Figure:
    """Draw every motion in the speed–torque plane of every candidate motor.

    The continuous region is shaded and the short-term region is outlined.
    """
    verdicts = sizing.verdicts
    across = min(len(verdicts), 3)
    down = -(-len(verdicts) // across)
    figure = new_figure(3.3 * across, 2.8 * down + 0.5)
    panels = figure.subplots(down, across, squeeze=False).ravel()
    for axes, verdict in zip(panels, verdicts, strict=False):
        _region(axes, verdict, sizing)
    for axes in panels[len(verdicts) :]:
        axes.set_visible(False)
    for axes in panels[: len(verdicts)]:
        axes.locator_params(axis="x", nbins=5)
        finish(axes, "motor speed (rpm)", "|torque| (mN·m)")
    legend_above(figure, panels[0], 4)
    return figure


def _region(axes: Axes, verdict: MotorVerdict, sizing: Sizing) -> None:
    motor, load, conditions = verdict.motor, verdict.load, sizing.conditions
    speed = np.linspace(0.0, motor.max_speed, 400)
    hot = motor.max_winding_temperature
    short = 1e3 * available_torque(motor, conditions, speed, hot)
    steady = continuous_torque(motor, conditions.ambient)
    if steady is not None:
        axes.fill_between(
            RPM * speed, 0.0, np.minimum(short, 1e3 * steady), color="0.88", label="continuous"
        )
    (outline,) = axes.plot([*(RPM * speed), RPM * speed[-1]], [*short, 0.0], label="short-term")
    outline.set(**LIMIT)
    i = JOINTS.index(verdict.joint)
    torque = 1e3 * np.abs(verdict.requirement.torque)
    speeds = RPM * np.abs(load.speed())
    for stretch in _stretches(load.direction):
        axes.plot(speeds[stretch], torque[stretch], color=COLOURS[i], linewidth=1.0)
    rms = 1e3 * verdict.requirement.rms_torque
    axes.plot(
        [0.0, RPM * motor.max_speed],
        [rms, rms],
        ":",
        color="0.2",
        linewidth=1.0,
        label="RMS of the motion",
    )
    top = 1.15 * max(torque.max(), 0.0 if steady is None else 1e3 * steady, 1e-9)
    axes.set_ylim(0.0, max(top, min(1.05 * short.max(), 3 * top)))
    axes.set_xlim(0.0, min(1.05 * RPM * motor.max_speed, 3 * float(speeds.max())))
    mark = ", placeholder figures" if motor.placeholder else ""
    answer = {True: "suffices", False: "does not suffice", None: "not known"}[verdict.adequate]
    axes.set_title(f"{verdict.joint}: {motor.name}\n{answer}{mark}", fontsize=SIZE - 1.5)


def _curve(axes: Axes, joint: JointSizing, confidence: float) -> None:
    i = JOINTS.index(joint.load.joint)
    speed, torque = RPM * joint.requirement.speed, 1e3 * joint.requirement.torque
    for part, stretch in enumerate(_stretches(joint.load.direction)):
        axes.plot(
            speed[stretch],
            torque[stretch],
            DASHES[i],
            color=COLOURS[i],
            label=_label(joint) if part == 0 else None,
        )
    if joint.band.known:
        peak = int(np.argmax(np.abs(torque)))
        ends = [1e3 * end("peak_torque", confidence) for end in (joint.band.low, joint.band.high)]
        axes.plot(
            [speed[peak]] * 2,
            np.copysign(ends, torque[peak]),
            "_-",
            color=COLOURS[i],
            linewidth=3,
            alpha=0.45,
        )


def _stretches(direction: Array) -> list[Indices]:
    """Return runs of instants with one direction, so that no line connects two directions."""
    cut = np.flatnonzero(np.diff(direction) != 0) + 1
    moving = direction != 0
    return [part for part in np.split(np.arange(len(moving)), cut) if moving[part[0]]]


def _label(joint: JointSizing) -> str:
    return f"joint {JOINTS.index(joint.load.joint) + 1} ({joint.load.joint})"


MODEL: dict[str, Any] = {"color": COLOURS[1], "linestyle": (0, (5, 3)), "linewidth": 1.4}
MEASURED: dict[str, Any] = {"color": "black", "linewidth": 0.8}
OUTLIER: dict[str, Any] = {"color": COLOURS[1], "marker": "x", "markersize": 7, "linestyle": "none"}


def map_figure(fit: MapFit, data: TorqueMap, load: float) -> Figure:
    """Draw a torque–velocity map: measurements, fitted law with bands, and outliers.

    load: constant effort of `fit_map`, N·m or N. The bands are those of a new recording, as in
    `predict`: one for its mean and one for its samples with ripple and noise.
    """
    from ssm_planner.identification.parameters import map_torque

    figure = new_figure(6.0, 3.8)
    axes = figure.subplots()
    outliers = {name for name, _, _ in fit.outliers}
    apart = np.array([name in outliers for name in data.names])
    axes.plot(
        RPM * data.w,
        1e3 * data.tau,
        "o",
        color="black",
        fillstyle="none",
        markersize=5,
        label="measured",
    )
    if apart.any():
        axes.plot(
            RPM * data.w[apart], 1e3 * data.tau[apart], **OUTLIER, label="outlier (lower weight)"
        )
    label = f"{plain_words(fit.law)}, NRMSD {fit.nrmsd:.3f}"
    for w, named in zip(speeds_of_map(data.w), (None, label), strict=True):
        _bands(axes, fit.drive, w, load, named is not None)
        axes.plot(RPM * w, 1e3 * map_torque(fit.drive, w, load), **MODEL, label=named)
    finish(axes, "motor speed (rpm)", "motor torque (mN·m)", fit.drive.name)
    zero_lines(axes, down=True)
    legend(axes, loc="best")
    return figure


def _bands(axes: Axes, drive: Drive, w: Array, load: float, named: bool) -> None:
    """Draw the bands of 95 % of new recordings at constant speeds (n,).

    A drive without a posterior has no bands.
    """
    from ssm_planner.dynamics.friction import friction_of
    from ssm_planner.identification.parameters import map_torque
    from ssm_planner.identification.prediction import Motion, band_of, departure

    friction = friction_of(drive)
    if friction.posterior is None:
        return
    quiet = replace(friction.posterior, forwards=None, backwards=None)
    smooth = replace(drive, friction=replace(friction, posterior=quiet))
    motion = Motion(np.arange(len(w), dtype=float), w, np.zeros(len(w)), np.sign(w), ())
    tau = map_torque(drive, w, load) + departure(drive, motion, load)
    for known, alpha, of in ((drive, 0.18, "samples"), (smooth, 0.35, "means")):
        band = band_of(known, motion, tau, load)
        if band is not None:
            shade: dict[str, Any] = {
                "alpha": alpha,
                "linewidth": 0,
                "label": f"95 % of {of}" if named else None,
            }
            axes.fill_between(RPM * w, 1e3 * band.low, 1e3 * band.high, color=COLOURS[1], **shade)


def speeds_of_map(w: Array) -> tuple[Array, Array]:
    """Return backward and forward speeds (200,) for a curve through the measured speeds (n,)."""
    sides = (np.abs(w[np.sign(w) == sign]) for sign in (-1.0, 1.0))
    backward, forward = (np.geomspace(side.min(), side.max(), 200) for side in sides)
    return -backward, forward


def prediction_figure(prediction: Prediction) -> Figure:
    """Draw measured and predicted motor torque over time above the measured speed."""
    figure = new_figure(7.2, 4.4)
    torque, speed = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    recording = prediction.recording
    torque.plot(recording.time, 1e3 * recording.tau, **MEASURED, label="measured")
    torque.plot(
        recording.time,
        1e3 * prediction.tau,
        **MODEL,
        label=f"predicted, NRMSD {prediction.nrmsd:.3f}",
    )
    if prediction.band is not None:
        band = [1e3 * end for end in (prediction.band.low, prediction.band.high)]
        torque.fill_between(
            recording.time,
            *band,
            color=COLOURS[1],
            alpha=0.18,
            linewidth=0,
            label="95 % of samples",
        )
        low, high = (1e3 * (end - prediction.tau.mean()) for end in prediction.band.mean)
        moving = np.where(prediction.rest, np.nan, 1e3 * prediction.tau)
        shade: dict[str, Any] = {
            "color": COLOURS[1],
            "alpha": 0.35,
            "linewidth": 0,
            "label": "95 % of the mean",
        }
        torque.fill_between(recording.time, moving + low, moving + high, **shade)
    speed.plot(recording.time, RPM * recording.w, **MEASURED)
    finish(torque, "", "motor torque (mN·m)", recording.name)
    finish(speed, "time (s)", "motor speed\n(rpm)")
    legend(torque, loc="best")
    for axes in (torque, speed):
        zero_lines(axes)
    return figure
