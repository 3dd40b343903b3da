"""Draw the figures of a plan: its motion with limits, the motor requirements, and its simulation.

A playback is the simulated execution of a plan by the arm and its motor controllers.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING

import numpy as np

from ssm_planner.problem import (
    JOINTS,
    JointAcceleration,
    JointPosition,
    JointVelocity,
    Limit,
    Motor,
    Robot,
)
from ssm_planner.reporting.figures.style import (
    COLOURS,
    DOT_STEP,
    DOT_STYLE,
    FONT_SIZE,
    LETTER_WIDTH,
    LIMIT_STYLE,
    LINE_DASHES,
    display_unit_of,
    draw_legend_above,
    finish_axes,
    joint_label,
    new_figure,
    new_panels,
    save_figures,
    shade_phases,
)
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, Files, Range
from ssm_planner.units import RPM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ssm_planner.simulation.simulate import SimulationResult
    from ssm_planner.sizing import MotorRequirement

SAMPLE_COUNT = 1200
"""Number of samples of a curve."""
DEFAULT_WIDTH = 9.0
"""Width of the figures that `plan` writes, inches."""
MIN_TWO_COLUMN_WIDTH = 5.0
"""Width below which the plots of a figure form a single column, inches."""
MIN_FIVE_ENTRY_WIDTH = 8.0
"""Width below which the legend has three instead of five columns, inches."""
NAMED_WIDTHS = {"single": 3.5, "double": 7.16, "slide": 8.0}
"""Widths of one and two columns of a journal page and of a slide, inches."""
MAX_LIMIT_DISTANCE = 2.0
"""Largest distance of a drawn limit from its curve, in multiples of the range of the curve."""


def motion_figure(trajectory: Trajectory, robot: Robot, width: float = DEFAULT_WIDTH) -> "Figure":
    """Draw joint positions, velocities and accelerations over time, with dashed limits.

    Revolute joints are on the left, and the translation is on the right. In figures narrower than
    `MIN_TWO_COLUMN_WIDTH`, the six plots form a single column.

    Parameters
    ----------
    trajectory : Trajectory
        Motion that is drawn.
    robot : Robot
        Robot that performs the motion.
    width : float
        Width of the figure, inches.

    Returns
    -------
    Figure
        Figure with six plots.
    """
    t = np.linspace(0.0, trajectory.duration, SAMPLE_COUNT)
    samples = trajectory.sample(t)
    if width < MIN_TWO_COLUMN_WIDTH:
        separator = "\n"
        height, rows, columns, legend_columns = 8.6, 6, 1, 2
        left_edge, top_edge = 0.85, 0.85
    else:
        separator = " "
        height, rows, columns, legend_columns = min(6.4, 0.78 * width), 3, 2, 5
        left_edge, top_edge = 0.75, 0.55
        if width < MIN_FIVE_ENTRY_WIDTH:
            legend_columns, top_edge = 3, 0.7
    figure, panels = new_panels(
        width,
        height,
        rows=rows,
        columns=columns,
        edges=(left_edge, 0.1, 0.5, top_edge),
        gaps=(0.85, 0.2),
        sharex=True,
    )
    quantities: tuple[tuple[str, str, str, type[Limit]], ...] = (
        ("q", "position", "", JointPosition),
        ("qd", "velocity", "/s", JointVelocity),
        ("qdd", "acceleration", "/s²", JointAcceleration),
    )
    for row, (field, name, per_time, limit_type) in enumerate(quantities):
        for column, (kind, base) in enumerate((("revolute", "rad"), ("prismatic", "m"))):
            unit, scale = display_unit_of(base)
            axes = panels.flat[2 * row + column]
            shade_phases(axes, trajectory, with_names=axes in panels[0])
            for i, joint in enumerate(robot.joints):
                if joint.kind != kind:
                    continue
                values = scale * getattr(samples, field)[:, i]
                axes.plot(
                    t, values, LINE_DASHES[i], color=COLOURS[i], label=joint_label(joint.name)
                )
                for limit in joint.limits:
                    if isinstance(limit, limit_type):
                        _draw_limit(axes, (scale * limit.low, scale * limit.high), values)
            time_label = "time (s)" if axes in panels[-1] else ""
            finish_axes(axes, time_label, f"{name}{separator}({unit}{per_time})")
    handles = []
    for axes in panels.flat[:2]:
        handles += axes.get_legend_handles_labels()[0]
    handles += panels.flat[2].plot([], [], **LIMIT_STYLE, label="limit")
    figure.legend(
        handles=handles,
        loc="upper center",
        ncols=legend_columns,
        fontsize=FONT_SIZE,
        frameon=False,
    )
    return figure


def _draw_limit(axes: "Axes", ends: Range, values: Array) -> None:
    """Draw the bounds that are close to a curve.

    Distant bounds are left out, because the curve would otherwise be too flat to read.

    Parameters
    ----------
    axes : Axes
        Plot of matplotlib in which the function draws.
    ends : (float, float)
        Lower and upper bound in the unit of the plot.
    values : (n,) array
        Values of the curve.
    """
    # The curve of a resting joint has no range. It counts as 2 % of the limit.
    curve_range = max(float(np.ptp(values)), 0.02 * max(map(abs, ends)))
    distance = MAX_LIMIT_DISTANCE * curve_range
    for end in ends:
        if values.min() - distance <= end <= values.max() + distance:
            axes.axhline(end, **LIMIT_STYLE)


def motors_figure(
    trajectory: Trajectory,
    robot: Robot,
    requirements: "Sequence[MotorRequirement]",
    width: float = DEFAULT_WIDTH,
) -> "Figure":
    """Draw the motor torque over time and over motor speed for every driven joint.

    Each joint has two plots, which also show the RMS torque and the ratings of the motor. The right
    plot has translucent dots at equal intervals of time, which are darker where the motion stays
    longer. In figures narrower than `MIN_TWO_COLUMN_WIDTH`, the plots form a single column.

    Parameters
    ----------
    trajectory : Trajectory
        Motion that is drawn.
    robot : Robot
        Robot that performs the motion.
    requirements : sequence of MotorRequirement
        Required torques and speeds, one for each driven joint.
    width : float
        Width of the figure, inches.

    Returns
    -------
    Figure
        Figure with two plots for each driven joint.
    """
    is_narrow = width < MIN_TWO_COLUMN_WIDTH
    columns = 1 if is_narrow else 2
    rows = len(requirements) * 2 // columns
    top_edge, gap = (0.6, 0.9) if width < MIN_FIVE_ENTRY_WIDTH else (0.55, 0.8)
    # Number of letters in a line of a title. An inch has 72 points, and the labels of the vertical
    # axis take the space of eight letters.
    letters = int(width / columns * 72 / (LETTER_WIDTH * FONT_SIZE)) - 8
    figure, panels = new_panels(
        width,
        2.3 * rows + 0.2,
        rows=rows,
        columns=columns,
        edges=(0.85, 0.1, 0.5, top_edge),
        gaps=(0.35, 1.0 if is_narrow else gap),
        sharey=False if is_narrow else "row",
    )
    for row, requirement in enumerate(requirements):
        i = JOINTS.index(requirement.joint)
        torque = 1e3 * requirement.torque
        over_time, against_speed = panels.flat[2 * row : 2 * row + 2]
        shade_phases(over_time, trajectory, with_names=row == 0)
        over_time.plot(requirement.t, torque, color=COLOURS[i])
        speed = RPM * requirement.speed
        against_speed.plot(speed, torque, color=COLOURS[i], linewidth=0.8)
        against_speed.scatter(speed[::DOT_STEP], torque[::DOT_STEP], **DOT_STYLE, color=COLOURS[i])
        rms = 1e3 * requirement.rms_torque
        for axes in (over_time, against_speed):
            axes.axhline(
                np.copysign(rms, requirement.mean_torque), color="0.3", linewidth=1.0, linestyle=":"
            )
        time_label, speed_label = "", ""
        if row == len(requirements) - 1 or is_narrow:
            time_label, speed_label = "time (s)", "motor speed (rpm); darker: longer there"
        finish_axes(over_time, time_label, f"{joint_label(requirement.joint)}\nmotor torque (mN·m)")
        finish_axes(against_speed, speed_label, "motor torque (mN·m)" if is_narrow else "")
        text = f"RMS {rms:.3g} (dotted), peak {1e3 * requirement.peak_torque:.3g} mN·m"
        lines = [text] + wrap(_ratings_text(requirement.motor), letters)
        against_speed.set_title("\n".join(lines), fontsize=FONT_SIZE - 1, loc="right", y=1.0, pad=3)
    return figure


PLAN_FIGURES: "dict[str, Callable[..., Figure]]" = {
    "motion": motion_figure,
    "motors": motors_figure,
}
"""Function that draws each figure of a plan, by file name."""


def write_simulation_figures(result: "SimulationResult", folder: Path) -> Files:
    """Write the figures of a simulation as PNG and PDF.

    The figures are "playback" and, if the simulation contains several power losses, "power_loss".

    Parameters
    ----------
    result : SimulationResult
        Result of the simulation.
    folder : Path
        Folder of the files.

    Returns
    -------
    Files
        Paths by name, such as "playback_figure" for a PNG and "playback_pdf" for a PDF.

    Raises
    ------
    ExportError
        If a file cannot be written.
    """
    figures = {"playback": playback_figure(result)}
    if len(result.losses.time) > 1:
        figures["power_loss"] = power_loss_figure(result)
    return save_figures(figures, folder)


def playback_figure(result: "SimulationResult") -> "Figure":
    """Draw how a simulated arm follows the plan.

    The figure has three plots over time. They show the following errors (demanded minus measured
    motor angle) in encoder increments, the motor torques relative to the largest permitted ones,
    and the distance of the tip from the plan.

    Parameters
    ----------
    result : SimulationResult
        Result of the simulation.

    Returns
    -------
    Figure
        Figure with three plots.
    """
    figure = new_figure(7.2, 6.6)
    errors, torques, tip = figure.subplots(3, 1, sharex=True)
    for motor in result.motors:
        k = JOINTS.index(motor.joint)
        style = {
            "color": COLOURS[k],
            "linestyle": LINE_DASHES[k],
            "linewidth": 1.1,
            "label": motor.joint,
        }
        counts = result.axes[motor.joint].counts_per_turn
        errors.plot(result.time, result.following[:, k] * counts / (2 * np.pi), **style)
        torques.plot(result.time, 100 * result.torque[:, k] / motor.limit, **style)
    for level in (-100, 100):
        torques.axhline(level, **LIMIT_STYLE)
    tip.plot(result.time, 1e3 * result.tip, color="black", linewidth=1.3)
    finish_axes(errors, "", "following error\n(increments)")
    finish_axes(torques, "", "motor torque\n(% of largest)")
    finish_axes(tip, "time (s)", "distance of tip\nfrom plan (mm)")
    draw_legend_above(figure, errors, 4)
    return figure


def power_loss_figure(result: "SimulationResult") -> "Figure":
    """Draw the tip travel and the time to standstill over the instant of the power loss.

    The simulation contains a separate loss of power of all drives at each of these instants. The
    travel is the largest distance of the tip from its position at the loss. The time to standstill
    is left out where the arm does not come to rest.

    Parameters
    ----------
    result : SimulationResult
        Result of a simulation with power losses at several instants.

    Returns
    -------
    Figure
        Figure with the travel above and the time below.
    """
    losses = result.losses
    figure = new_figure(7.2, 4.2)
    travel, standstill = figure.subplots(2, 1, sharex=True)
    travel.plot(losses.time, 1e3 * losses.travel, color="black", linewidth=1.2)
    times = np.where(np.isfinite(losses.standing), losses.standing, np.nan)
    standstill.plot(losses.time, 1e3 * times, color="black")
    finish_axes(travel, "", "tip travel (mm)")
    finish_axes(standstill, "power lost at (s)", "time to standstill (ms)")
    return figure


def _ratings_text(motor: Motor | None) -> str:
    """Describe the motor and its rated torques in mN·m."""
    if motor is None:
        return "no motor given"
    mark = ", placeholder figures" if motor.placeholder else ""
    nominal, maximum = 1e3 * motor.nominal_torque, 1e3 * motor.max_torque
    return f"{motor.name}{mark}: nominal {nominal:.3g}, largest {maximum:.3g} mN·m"
