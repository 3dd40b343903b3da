"""Draw figures of motors and drives.

They show the requirements of a motion, friction maps of drives, and predicted motor torques.
"""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ssm_planner.display import plain_words
from ssm_planner.problem import JOINTS
from ssm_planner.reporting.figures.style import (
    COLOURS,
    DOT_STEP,
    DOT_STYLE,
    FONT_SIZE,
    LIMIT_STYLE,
    LINE_DASHES,
    draw_legend,
    draw_legend_above,
    draw_zero_lines,
    finish_axes,
    joint_label,
    new_figure,
    save_figures,
)
from ssm_planner.sizing import available_torque, continuous_torque
from ssm_planner.typing import Array, Files, Indices, Keywords
from ssm_planner.units import RPM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ssm_planner.identification import MapFit, Prediction, TorqueMap
    from ssm_planner.problem import Drive
    from ssm_planner.sizing import JointSizing, MotorVerdict, Sizing


PART_COLOURS = ("#56B4E9", "#009E73", "#0072B2", "#D55E00", "#E69F00")
"""Colours of the parts of a motor torque."""
PART_DASHES = ("--", "-.", ":", "-", (0, (6, 2)))
"""Line styles of the parts of a motor torque."""


def write_sizing_figures(sizing: "Sizing", folder: Path) -> Files:
    """Write the figures of a sizing as PNG and PDF.

    A sizing states the torques and speeds that a motion requires of the motors. The figures are
    payload_curves, torque_split and, if motors are judged, operating_regions.

    Parameters
    ----------
    sizing : Sizing
        Requirements of the motion, and verdicts on the motors.
    folder : Path
        Folder of the files.

    Returns
    -------
    Files
        Paths by name, such as "torque_split_figure" for a PNG and "torque_split_pdf" for a PDF. It
        is empty if the sizing contains no joint.

    Raises
    ------
    ExportError
        If a file cannot be written.
    """
    if not sizing.joints:
        return {}
    figures = {
        "payload_curves": payload_curves_figure(sizing),
        "torque_split": torque_split_figure(sizing),
    }
    if sizing.verdicts:
        figures["operating_regions"] = operating_regions_figure(sizing)
    return save_figures(figures, folder)


def payload_curves_figure(sizing: "Sizing") -> "Figure":
    """Draw the motor torque of a motion over the motor speed.

    Rotary joints are on the left, and the translation is on the right. A broad bar at the peak
    shows the range of the peak torque that results from uncertain friction, at the confidence of
    the sizing.

    Parameters
    ----------
    sizing : Sizing
        Torque and speed that the motion requires of each motor.

    Returns
    -------
    Figure
        Figure with one plot for each kind of joint.
    """
    rotary = [joint for joint in sizing.joints if not joint.load.drive.slides]
    sliding = [joint for joint in sizing.joints if joint.load.drive.slides]
    groups = [group for group in (rotary, sliding) if group]
    figure = new_figure(3.6 * len(groups) + 0.4, 3.3)
    panels = figure.subplots(1, len(groups), squeeze=False)[0]
    for axes, group in zip(panels, groups, strict=True):
        for joint in group:
            _draw_torque_curve(axes, joint, sizing.conditions.confidence)
        draw_zero_lines(axes, down=True)
        axes.locator_params(axis="x", nbins=5)
        finish_axes(axes, "motor speed (rpm)", "motor torque (mN·m)")
        draw_legend(axes, loc="upper left")
    return figure


def torque_split_figure(sizing: "Sizing") -> "Figure":
    """Draw the motor torque of every joint and its parts over time.

    A part is the contribution of one cause, such as friction or inertia.

    Parameters
    ----------
    sizing : Sizing
        Torques that the motion requires of each motor.

    Returns
    -------
    Figure
        Figure with one plot for each driven joint.
    """
    figure = new_figure(7.2, 2.2 * len(sizing.joints) + 0.5)
    panels = figure.subplots(len(sizing.joints), 1, squeeze=False)[:, 0]
    for axes, joint in zip(panels, sizing.joints, strict=True):
        t = joint.load.t - joint.load.t[0]
        axes.plot(t, 1e3 * joint.requirement.torque, color="black", linewidth=1.6, label="torque")
        split = joint.requirement.split.components()
        for (name, torque), colour, dash in zip(split, PART_COLOURS, PART_DASHES, strict=True):
            label = plain_words(name)
            axes.plot(t, 1e3 * torque, linestyle=dash, color=colour, linewidth=1.2, label=label)
        time_label = "time (s)" if axes is panels[-1] else ""
        finish_axes(axes, time_label, f"{joint_label(joint.load.joint)}\nmotor torque (mN·m)")
    draw_legend_above(figure, panels[0], 3)
    return figure


def operating_regions_figure(sizing: "Sizing") -> "Figure":
    """Draw the motion of each joint in the speed–torque plane of each candidate motor.

    The continuous region of the motor is shaded, and the short-term region is outlined. A dotted
    line shows the RMS torque of the motion. Translucent dots at equal intervals of time are darker
    where the motion stays longer.

    Parameters
    ----------
    sizing : Sizing
        Verdict on each candidate motor.

    Returns
    -------
    Figure
        Figure with one plot for each candidate motor.
    """
    verdicts = sizing.verdicts
    columns = min(len(verdicts), 3)
    rows = -(-len(verdicts) // columns)
    figure = new_figure(3.3 * columns, 2.8 * rows + 0.5)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, verdict in zip(panels, verdicts, strict=False):
        _draw_operating_region(axes, verdict, sizing)
        axes.locator_params(axis="x", nbins=5)
        finish_axes(axes, "motor speed (rpm)", "|torque| (mN·m)")
    for axes in panels[len(verdicts) :]:
        axes.set_visible(False)
    draw_legend_above(figure, panels[0], 4)
    return figure


def _draw_operating_region(axes: "Axes", verdict: "MotorVerdict", sizing: "Sizing") -> None:
    """Draw the operating regions of one motor, and the motion of its joint, in one panel.

    Parameters
    ----------
    axes : Axes
        Plot of matplotlib in which the function draws.
    verdict : MotorVerdict
        Verdict on the motor, with the load of its joint.
    sizing : Sizing
        Sizing that contains the verdict, with the operating conditions.
    """
    motor = verdict.motor
    conditions = sizing.conditions
    speed = np.linspace(0.0, motor.max_speed, 400)
    temperature = motor.max_winding_temperature
    peak_limit = 1e3 * available_torque(motor, conditions, speed, temperature)
    continuous_limit = continuous_torque(motor, conditions.ambient)
    if continuous_limit is not None:
        continuous_region = np.minimum(peak_limit, 1e3 * continuous_limit)
        axes.fill_between(RPM * speed, 0.0, continuous_region, color="0.88", label="continuous")
    # A vertical line at the largest speed closes the region.
    outline_speeds = RPM * np.append(speed, speed[-1])
    axes.plot(outline_speeds, np.append(peak_limit, 0.0), label="short-term", **LIMIT_STYLE)
    i = JOINTS.index(verdict.joint)
    torque = 1e3 * np.abs(verdict.requirement.torque)
    speeds = RPM * np.abs(verdict.load.speed())
    for run in _runs_of_direction(verdict.load.direction):
        axes.plot(speeds[run], torque[run], color=COLOURS[i], linewidth=1.0)
    dots = axes.scatter(speeds[::DOT_STEP], torque[::DOT_STEP], **DOT_STYLE, color=COLOURS[i])
    dots.set_label("darker: longer there")
    rms = 1e3 * verdict.requirement.rms_torque
    axes.axhline(rms, linestyle=":", color="0.2", linewidth=1.0, label="RMS of the motion")
    # Show the motion and the continuous region, and at most three times as much of a large
    # short-term region.
    top = 1.15 * max(torque.max(), 1e3 * (continuous_limit or 0.0), 1e-9)
    axes.set_ylim(0.0, max(top, min(1.05 * peak_limit.max(), 3 * top)))
    axes.set_xlim(0.0, min(1.05 * RPM * motor.max_speed, 3 * float(speeds.max())))
    mark = ", placeholder figures" if motor.placeholder else ""
    answer = "suffices" if verdict.adequate else "does not suffice"
    if verdict.adequate is None:
        answer = "not known"
    stages = "".join(f"{stage.name}: " for stage in verdict.load.drive.stages.values())
    axes.set_title(
        f"{verdict.joint}: {motor.name}\n{stages}{answer}{mark}, up to "
        f"{RPM * motor.max_speed:.0f} rpm",
        fontsize=FONT_SIZE - 1.5,
    )


def _draw_torque_curve(axes: "Axes", joint: "JointSizing", confidence: float) -> None:
    """Draw torque over speed for one joint, and the range of its peak torque.

    Parameters
    ----------
    axes : Axes
        Plot of matplotlib in which the function draws.
    joint : JointSizing
        Sizing of the joint.
    confidence : float
        Probability that the peak torque lies in the range.
    """
    i = JOINTS.index(joint.load.joint)
    speed, torque = RPM * joint.requirement.speed, 1e3 * joint.requirement.torque
    label: str | None = joint_label(joint.load.joint)
    for run in _runs_of_direction(joint.load.direction):
        axes.plot(speed[run], torque[run], LINE_DASHES[i], color=COLOURS[i], label=label)
        label = None
    if joint.band.known:
        peak = int(np.argmax(np.abs(torque)))
        band = joint.band
        ends = [1e3 * end("peak_torque", confidence) for end in (band.low, band.high)]
        bar = np.copysign(ends, torque[peak])
        axes.plot([speed[peak]] * 2, bar, "_-", color=COLOURS[i], linewidth=3, alpha=0.45)


def _runs_of_direction(direction: Array) -> list[Indices]:
    """Return the indices of successive instants during which a joint moves in one direction.

    A curve is drawn separately for each of these runs, so that no line connects both directions.

    Parameters
    ----------
    direction : (n,) array
        Direction of the joint at each instant, +1, −1 or 0.

    Returns
    -------
    list of arrays of int
        Indices of each run. Instants at rest are left out.
    """
    changes = np.flatnonzero(np.diff(direction) != 0) + 1
    runs = np.split(np.arange(len(direction)), changes)
    return [run for run in runs if direction[run[0]] != 0]


MODEL_STYLE: Keywords = {"color": COLOURS[1], "linestyle": (0, (5, 3)), "linewidth": 1.4}
"""Style of the fitted law."""
MEASURED_STYLE: Keywords = {"color": "black", "linewidth": 0.8}
"""Style of measurements."""
OUTLIER_STYLE: Keywords = {"color": COLOURS[1], "marker": "x", "markersize": 7, "linestyle": "none"}
"""Style of outliers."""


def map_figure(fit: "MapFit", data: "TorqueMap", load: float) -> "Figure":
    """Draw a torque–velocity map: measurements, outliers, and the fitted friction law.

    A torque–velocity map contains the mean motor torques of recordings at constant motor speeds.
    Two bands contain 95 % of new recordings. The inner band applies to the mean torque of a
    recording, and the outer band to its single values, which contain ripple and noise.

    Parameters
    ----------
    fit : MapFit
        Drive with the fitted friction law, and the outliers.
    data : TorqueMap
        Measured torques at motor speeds.
    load : float
        Constant effort of the load on the drive during the measurements, N·m or N.

    Returns
    -------
    Figure
        Figure with one plot.
    """
    from ssm_planner.identification import map_torque

    figure = new_figure(6.0, 3.8)
    axes = figure.subplots()
    outliers = {name for name, _, _ in fit.outliers}
    is_outlier = np.array([name in outliers for name in data.names])
    speed, torque = RPM * data.w, 1e3 * data.tau
    axes.plot(speed, torque, "o", color="black", fillstyle="none", markersize=5, label="measured")
    if is_outlier.any():
        axes.plot(
            speed[is_outlier], torque[is_outlier], **OUTLIER_STYLE, label="outlier (lower weight)"
        )
    law = f"{plain_words(fit.law)}, NRMSD {fit.nrmsd:.3f}"
    for w, label in zip(map_speeds(data.w), (None, law), strict=True):
        _draw_bands(axes, fit.drive, w, load, label is not None)
        axes.plot(RPM * w, 1e3 * map_torque(fit.drive, w, load), **MODEL_STYLE, label=label)
    finish_axes(axes, "motor speed (rpm)", "motor torque (mN·m)", fit.drive.name)
    draw_zero_lines(axes, down=True)
    draw_legend(axes, loc="best")
    return figure


def _draw_bands(axes: "Axes", drive: "Drive", w: Array, load: float, with_labels: bool) -> None:
    """Draw the bands that contain 95 % of new recordings at constant motor speeds.

    A drive without a posterior, that is, without known uncertainty of its friction, is drawn
    without bands.

    Parameters
    ----------
    axes : Axes
        Plot of matplotlib in which the function draws.
    drive : Drive
        Drive with its friction.
    w : (n,) array
        Motor speeds, rad/s.
    load : float
        Constant effort of the load on the drive, N·m or N.
    with_labels : bool
        Add the bands to the legend.
    """
    from ssm_planner.dynamics import required_friction
    from ssm_planner.identification import (
        RecordedMotion,
        law_correction,
        map_torque,
        prediction_band,
    )

    friction = required_friction(drive)
    if friction.posterior is None:
        return
    # The mean torque of a recording does not contain the ripple, which depends on the direction.
    without_ripple = replace(friction.posterior, forwards=None, backwards=None)
    smooth = replace(drive, friction=replace(friction, posterior=without_ripple))
    # The points of the map form a fictitious recording without accelerations.
    motion = RecordedMotion(np.arange(len(w), dtype=float), w, np.zeros(len(w)), np.sign(w), ())
    tau = map_torque(drive, w, load) + law_correction(drive, motion, load)
    for variant, alpha, content in ((drive, 0.18, "samples"), (smooth, 0.35, "means")):
        band = prediction_band(variant, motion, tau, load)
        if band is not None:
            axes.fill_between(
                RPM * w,
                1e3 * band.low,
                1e3 * band.high,
                color=COLOURS[1],
                alpha=alpha,
                linewidth=0,
                label=f"95 % of {content}" if with_labels else None,
            )


def map_speeds(w: Array) -> tuple[Array, Array]:
    """Return the backward and the forward speeds at which the fitted law is drawn.

    Parameters
    ----------
    w : (n,) array
        Measured motor speeds in both directions, rad/s.

    Returns
    -------
    backward, forward : (200,) arrays
        Speeds with logarithmic spacing over the measured range, rad/s.
    """
    backward = w[w < 0]
    forward = w[w > 0]
    return (
        np.geomspace(backward.max(), backward.min(), 200),
        np.geomspace(forward.min(), forward.max(), 200),
    )


def prediction_figure(prediction: "Prediction") -> "Figure":
    """Draw the measured and the predicted motor torque over time, and the speed below.

    If the drive states a posterior, that is, the uncertainty of its friction, two shaded bands are
    drawn. The wide band contains 95 % of the single torque values. The narrow band is the predicted
    curve, shifted so that its mean covers the interval that contains the mean torque of the
    recording with a probability of 95 %.

    Parameters
    ----------
    prediction : Prediction
        Recording of a drive, and the torque that its friction law predicts.

    Returns
    -------
    Figure
        Figure with the torque above and the speed below.
    """
    figure = new_figure(7.2, 4.4)
    torque, speed = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    recording = prediction.recording
    label = f"predicted, NRMSD {prediction.nrmsd:.3f}"
    torque.plot(recording.time, 1e3 * recording.tau, **MEASURED_STYLE, label="measured")
    torque.plot(recording.time, 1e3 * prediction.tau, **MODEL_STYLE, label=label)
    if prediction.band is not None:
        band = prediction.band
        deviation = np.where(prediction.rest, np.nan, prediction.tau - prediction.tau.mean())
        low, high = (deviation + end for end in band.mean)
        for lower, upper, alpha, content in (
            (band.low, band.high, 0.18, "samples"),
            (low, high, 0.35, "the mean"),
        ):
            torque.fill_between(
                recording.time,
                1e3 * lower,
                1e3 * upper,
                alpha=alpha,
                label=f"95 % of {content}",
                color=COLOURS[1],
                linewidth=0,
            )
    speed.plot(recording.time, RPM * recording.w, **MEASURED_STYLE)
    finish_axes(torque, "", "motor torque (mN·m)", recording.name)
    finish_axes(speed, "time (s)", "motor speed\n(rpm)")
    draw_legend(torque, loc="best")
    for axes in (torque, speed):
        draw_zero_lines(axes)
    return figure
