"""Draw figures of the workspace, with angles in degrees.

They show the reachable part of the sphere, θ2 over tilt, joint speeds and the design region.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.display import use_minus_signs
from ssm_planner.kinematics import (
    DesignRegion,
    Mechanism,
    design_region,
    joint_speed_per_tilt_speed,
    smallest_singular_value,
    theta2_from_tilt,
    tilt_interval,
)
from ssm_planner.publishing import publishing
from ssm_planner.reporting.figures.style import (
    COLOURS,
    FONT_SIZE,
    LINE_DASHES,
    draw_legend,
    finish_axes,
    new_figure,
    save_figures,
)
from ssm_planner.typing import Array, Files, Keywords

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AXIS_LABELS = ("ω₁\nθ₁ roll", "ω₂\nθ₂", "ω₃\nθ₃ spin\nθ₄ insertion")
"""Label of each axis with its joints."""
CENTRED_TEXT: Keywords = {"ha": "center", "va": "center", "fontsize": FONT_SIZE}
"""Style of a label whose middle is at the given position."""


def workspace_figures(mechanism: Mechanism) -> "dict[str, Figure]":
    """Draw all figures of a mechanism.

    Parameters
    ----------
    mechanism : Mechanism
        Kinematics of the robot.

    Returns
    -------
    dict of Figure
        Figures by file name: "axes", "reachable_set", "theta2_against_tilt" and "joint_speeds".
    """
    return {
        "axes": axes_figure(mechanism),
        "reachable_set": reachable_set_figure(mechanism),
        "theta2_against_tilt": theta2_figure(mechanism),
        "joint_speeds": joint_speed_figure(mechanism),
    }


def publish_figures(figures: "Mapping[str, Figure]", directory: str | Path) -> Files:
    """Write each figure as PNG and PDF into a folder, all at once or not at all.

    Parameters
    ----------
    figures : mapping of str to Figure
        Figures by file name.
    directory : str or Path
        Folder, which is created if it does not exist.

    Returns
    -------
    Files
        Paths by name: `<name>` for a PNG file, and `<name>_pdf` for a PDF file.

    Raises
    ------
    ExportError
        If a file cannot be written.
    """
    folder = Path(directory)
    paths: Files = {}
    with publishing(folder) as temporary:
        save_figures(figures, temporary)
    for name in figures:
        paths[name] = folder / f"{name}.png"
        paths[f"{name}_pdf"] = folder / f"{name}.pdf"
    return paths


def axes_figure(mechanism: Mechanism) -> "Figure":
    """Draw the joint axes at q = 0, which meet in the remote centre of motion (RCM).

    Arcs show the angle α between the axes ω1 and ω2, the angle β between ω2 and ω3, and the tilt φ
    between ω1 and ω3. An arrow shows the direction of insertion.

    Parameters
    ----------
    mechanism : Mechanism
        Kinematics of the robot.

    Returns
    -------
    Figure
        Figure with one plot in three dimensions.
    """
    figure = new_figure(5.2, 4.6)
    axes = figure.add_subplot(projection="3d")
    directions = (mechanism.omega1, mechanism.omega2, mechanism.omega3)
    for k, (axis, name) in enumerate(zip(directions, AXIS_LABELS, strict=True)):
        line = np.outer(axis, (0.0, 1.15))
        axes.plot(*line, color=COLOURS[k], linestyle=LINE_DASHES[k], linewidth=1.6)
        axes.text(*(1.3 * axis), name, color=COLOURS[k], **CENTRED_TEXT)
    alpha, beta = np.degrees((mechanism.alpha, mechanism.beta))
    tilt = use_minus_signs(f"φ = {np.degrees(mechanism.home_tilt):.2f}°")
    label: Keywords = {"va": "center", "fontsize": FONT_SIZE - 1}
    angles = ((0, 1, 0.8, f"α = {alpha:.2f}°"), (1, 2, 0.7, f"β = {beta:.2f}°"), (0, 2, 0.25, tilt))
    for i, j, radius, name in angles:
        arc = radius * great_circle_arc(directions[i], directions[j])
        axes.plot(*arc.T, color="black", linewidth=1.0)
        label_position = arc[len(arc) // 2] * (1 + 0.08 / radius)
        axes.text(*label_position, name, ha="left", **label)
    axes.plot([0.0], [0.0], [0.0], "o", color="black", markersize=6)
    label_position = -0.1 * mechanism.omega1 - 0.08 * mechanism.omega3
    axes.text(*label_position, "RCM, port", ha="right", **label)
    inwards = mechanism.insertion_sign * mechanism.omega3
    arrow = np.append(np.zeros(3), 0.35 * inwards)
    axes.quiver(*arrow, color=COLOURS[3], linewidth=1.3, arrow_length_ratio=0.25)
    axes.text(*(0.48 * inwards), "depth", ha="center", **label)
    points = np.vstack([1.3 * np.array(directions), 0.48 * inwards])
    middle = (points.max(axis=0) + points.min(axis=0)) / 2
    half = np.ptp(points, axis=0).max() / 2
    axes.set_box_aspect((1.0, 1.0, 1.0), zoom=1.3)
    x, y, z = np.column_stack([middle - half, middle + half])
    axes.set(xlim=x, ylim=y, zlim=z)
    axes.set_axis_off()
    axes.view_init(elev=38.0, azim=-68.0)
    return figure


def great_circle_arc(start: Array, end: Array) -> Array:
    """Interpolate along the shortest arcs between unit vectors.

    With the fraction s of an arc, from 0 to 1, the weights of its start and its end are
    sin((1 − s) θ)/sin θ and sin(s θ)/sin θ, where θ is the angle between both ends (K. Shoemake,
    Animating rotation with quaternion curves, SIGGRAPH 1985).

    Parameters
    ----------
    start, end : (..., 3) arrays
        Unit vectors at both ends of each arc, which must not be parallel.

    Returns
    -------
    (..., 61, 3) array
        Unit vectors at equal distances along each arc.
    """
    angle = np.arccos(np.clip(np.sum(start * end, axis=-1), -1.0, 1.0))[..., None, None]
    s = np.linspace(0.0, 1.0, 61)[:, None]
    weights = np.sin((1.0 - s) * angle), np.sin(s * angle)
    arc = weights[0] * start[..., None, :] + weights[1] * end[..., None, :]
    return np.asarray(arc / np.sin(angle))


def reachable_set_figure(mechanism: Mechanism) -> "Figure":
    """Draw the directions that the tool axis reaches, on a sphere and in a section through axis 1.

    Parameters
    ----------
    mechanism : Mechanism
        Kinematics of the robot.

    Returns
    -------
    Figure
        Figure with the sphere on the left and the section on the right.
    """
    figure = new_figure(9.0, 4.4)
    sphere = figure.add_subplot(1, 2, 1, projection="3d")
    _draw_sphere(sphere, mechanism)
    section = figure.add_subplot(1, 2, 2)
    _draw_section(section, mechanism)
    return figure


def theta2_figure(mechanism: Mechanism) -> "Figure":
    """Draw the position θ2 of joint 2 over the tilt on both branches of the inverse kinematics.

    Each tilt is reached at two positions of joint 2, which are called branches. They meet at the
    ends of the tilt range.

    Parameters
    ----------
    mechanism : Mechanism
        Kinematics of the robot.

    Returns
    -------
    Figure
        Figure with one plot.
    """
    figure = new_figure(6.0, 4.2)
    axes = figure.add_subplot()
    tilt = _dense_tilts(mechanism)
    for k, branch in enumerate((1, -1)):
        theta2 = theta2_from_tilt(mechanism, tilt, branch)
        label = use_minus_signs(f"branch {branch:+d}")
        if branch == mechanism.home_branch:
            label += " (home)"
        axes.plot(
            np.degrees(tilt), np.degrees(theta2), LINE_DASHES[k], color=COLOURS[k], label=label
        )
    axes.plot([np.degrees(mechanism.home_tilt)], [0.0], "o", color="black", label="home")
    _draw_tilt_limits(axes, mechanism)
    finish_axes(axes, "tilt φ (°)", "θ₂ (°)", _title_with_angles("θ₂ against tilt", mechanism))
    draw_legend(axes)
    return figure


def joint_speed_figure(mechanism: Mechanism) -> "Figure":
    """Draw the joint speeds per tilt speed, and the smallest singular value of the Jacobian.

    The horizontal axis is the tilt φ. The upper plot shows |dθᵢ/dφ| of joints 1 to 3 on the branch
    of the inverse kinematics that contains the home position, while roll and spin are constant.

    Parameters
    ----------
    mechanism : Mechanism
        Kinematics of the robot.

    Returns
    -------
    Figure
        Figure with two plots.
    """
    figure = new_figure(6.0, 5.6)
    speeds, singular = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    tilt = _dense_tilts(mechanism)[1:-1]
    rates = np.abs(joint_speed_per_tilt_speed(mechanism, tilt, mechanism.home_branch))
    for i in range(3):
        speeds.semilogy(
            np.degrees(tilt), rates[:, i], LINE_DASHES[i], color=COLOURS[i], label=f"joint {i + 1}"
        )
    speeds.axhline(1.0, color="0.8", linewidth=0.8, zorder=0)
    speeds.set_ylim(max(rates.min() / 1.5, 1e-2), min(rates.max() * 1.5, 1e3))
    q = np.zeros((len(tilt), 4))
    q[:, 1] = theta2_from_tilt(mechanism, tilt, mechanism.home_branch)
    singular.plot(np.degrees(tilt), smallest_singular_value(mechanism, q), color="black")
    singular.set_ylim(bottom=0.0)
    finish_axes(
        speeds,
        "",
        "joint speed by tilt speed, |dθᵢ/dφ|",
        _title_with_angles("Joint speed per tilt speed", mechanism),
    )
    finish_axes(singular, "tilt φ (°)", "smallest\nsingular value")
    draw_legend(speeds, ncols=3, loc="upper center")
    for axes in (speeds, singular):
        _draw_tilt_limits(axes, mechanism)
    return figure


def design_region_figure(
    region: DesignRegion,
    built: tuple[float, float] | None = None,
    size: tuple[float, float] = (5.6, 5.4),
) -> "Figure":
    """Draw the region of all designs that reach a tilt range, for several margins.

    A design consists of the angles α and β between neighbouring joint axes.

    Parameters
    ----------
    region : DesignRegion
        Region in rad. Its smallest α is marked.
    built : (float, float), optional
        Another design (α, β) to mark, rad.
    size : (float, float)
        Width and height of the figure, inches.

    Returns
    -------
    Figure
        Figure with one plot of β over α. Each margin has its own shade.
    """
    from matplotlib.patches import Polygon

    figure = new_figure(*size)
    axes = figure.add_subplot()
    finish_axes(axes, "α (°)", "β (°)")
    for extra, grey in zip(np.radians((0.0, 10.0, 20.0)), ("0.85", "0.7", "0.55"), strict=True):
        smaller = design_region(*region.tilt_range, region.margin + float(extra))
        if not smaller.empty:
            label = f"margin {np.degrees(smaller.margin):.3g}°"
            corners = np.degrees(smaller.vertices)
            axes.add_patch(
                Polygon(corners, label=label, facecolor=grey, edgecolor="black", zorder=2)
            )
    if not region.empty:
        alpha, beta = np.degrees(region.smallest_alpha)
        label = f"smallest α: ({alpha:.4g}°, {beta:.4g}°)"
        axes.plot([alpha], [beta], "o", color=COLOURS[0], markersize=8, label=label, zorder=3)
    if built is not None:
        alpha, beta = np.degrees(built)
        label = f"as given: ({alpha:.4g}°, {beta:.4g}°)"
        axes.plot([alpha], [beta], "x", color="black", markersize=11, label=label, zorder=4)
    low, high = np.degrees(region.tilt_range)
    axes.set_title(
        use_minus_signs(f"(α, β) that reach tilt {low:.4g}° to {high:.4g}°"), fontsize=FONT_SIZE
    )
    axes.set(xlim=(0.0, 180.0), ylim=(0.0, 180.0), aspect="equal")
    ticks = range(0, 181, 30)
    axes.set(xticks=ticks, yticks=ticks)
    if not region.empty or built is not None:
        draw_legend(axes, loc="upper right")
    return figure


def _draw_sphere(axes: Any, mechanism: Mechanism) -> None:
    """Draw the unit sphere as a grid, with the joint axes and the directions that the tool reaches.

    The reachable directions form a band between two circles of constant tilt.

    Parameters
    ----------
    axes : Axes3D
        Plot of matplotlib in which the function draws.
    mechanism : Mechanism
        Kinematics of the robot.
    """
    ends = np.abs(tilt_interval(mechanism))
    around = np.linspace(0.0, 2.0 * np.pi, 121)
    for tilt in np.linspace(0.0, np.pi, 13):
        axes.plot(*tool_directions(mechanism, tilt, around), color="0.85", linewidth=0.6)
    band = tool_directions(mechanism, *np.meshgrid(np.linspace(ends.min(), ends.max(), 25), around))
    axes.plot_surface(
        *band, rstride=1, cstride=1, color="0.75", linewidth=0, antialiased=False, zorder=2
    )
    for tilt in ends:
        axes.plot(*tool_directions(mechanism, tilt, around), color="black", linewidth=1.0, zorder=3)
    directions = (mechanism.omega1, mechanism.omega2, mechanism.omega3)
    for axis, name in zip(directions, ("ω₁", "ω₂", "ω₃"), strict=True):
        axes.plot(*np.outer(axis, (1.0, 1.4)), color="black", linewidth=1.3, zorder=4)
        axes.text(*(1.5 * axis), name, zorder=5, **CENTRED_TEXT)
    axes.set_title("reachable pointings on the unit sphere", fontsize=FONT_SIZE)
    axes.set_box_aspect((1.0, 1.0, 1.0), zoom=1.1)
    axes.set(**dict.fromkeys(("xlim", "ylim", "zlim"), (-1.1, 1.1)))
    axes.set_axis_off()
    axes.view_init(elev=18.0, azim=-55.0)


def _draw_section(axes: Any, mechanism: Mechanism) -> None:
    """Draw the section of the unit sphere that contains the axis ω1 and the tool at roll 0.

    The axis ω1 points to the right, where the tilt is 0. The tilt range at roll 0 is bold, and that
    at roll 180° is grey. A dashed line shows the home position.

    Parameters
    ----------
    axes : Axes
        Plot of matplotlib in which the function draws.
    mechanism : Mechanism
        Kinematics of the robot.
    """

    def ray(tilt: float) -> Array:
        """Return the coordinates (2, 2) of the line from the centre in the direction of a tilt."""
        return np.outer((np.cos(tilt), -np.sin(tilt)), (0.0, 1.0))

    around = np.linspace(0.0, 2.0 * np.pi, 361)
    axes.plot(np.cos(around), np.sin(around), color="0.75", linewidth=0.8)
    low, high = tilt_interval(mechanism)
    for sign, width, label in ((1.0, 5.0, "tilt interval"), (-1.0, 2.0, "the same at roll 180°")):
        arc = sign * np.linspace(low, high, 181)
        colour = "black" if sign > 0.0 else "0.6"
        axes.plot(
            np.cos(arc),
            -np.sin(arc),
            color=colour,
            linewidth=width,
            solid_capstyle="butt",
            label=label,
        )
    for tilt in (low, high):
        axes.plot(*ray(tilt), color="black", linewidth=0.7)
        # Next to ω1 the label would overlap its arrow.
        height = -1.16 * np.sin(tilt) if abs(np.sin(tilt)) > 0.15 else 0.17
        text = use_minus_signs(f"{round(float(np.degrees(tilt)), 2) + 0.0:.2f}°")
        axes.text(1.3 * np.cos(tilt), height, text, **CENTRED_TEXT)
    home = ray(mechanism.home_tilt)
    axes.plot(*home, color="black", linewidth=1.2, linestyle="--", label="home")
    axes.annotate("", (1.3, 0.0), (0.0, 0.0), arrowprops={"arrowstyle": "->"})
    axes.text(1.4, 0.0, "ω₁", **CENTRED_TEXT)
    axes.set(xlim=(-1.6, 1.6), ylim=(-1.6, 1.35), aspect="equal")
    axes.set_axis_off()
    axes.set_title(_title_with_angles("section through ω₁", mechanism), fontsize=FONT_SIZE)
    draw_legend(axes, loc="lower center", ncols=3, handlelength=1.6, columnspacing=1.0)


def tool_directions(mechanism: Mechanism, tilt: ArrayLike, roll: Array) -> Array:
    """Return the directions of the tool axis ω3 in the base frame.

    Parameters
    ----------
    mechanism : Mechanism
        Kinematics of the robot.
    tilt : array_like
        Tilt angles, rad. They must broadcast to the shape of `roll`.
    roll : (...) array
        Roll angles, rad.

    Returns
    -------
    (3, ...) array
        Unit vectors.
    """
    # Spherical coordinates about the axis ω1. The columns of `mechanism.frame` are its axes.
    tilt = np.broadcast_to(np.asarray(tilt, dtype=float), roll.shape)
    points = np.stack((np.cos(tilt), np.sin(tilt) * np.sin(roll), -np.sin(tilt) * np.cos(roll)))
    return np.tensordot(mechanism.frame, points, axes=1)


def _dense_tilts(mechanism: Mechanism) -> Array:
    """Return tilt angles (721,) over the tilt range in rad, which are denser towards its ends.

    Curves over the tilt are steep at the ends of the range, where both branches of the inverse
    kinematics meet.
    """
    low, high = tilt_interval(mechanism)
    # These are Chebyshev points: the cosines of equidistant angles.
    return (low + high) / 2.0 - (high - low) / 2.0 * np.cos(np.linspace(0.0, np.pi, 721))


def _draw_tilt_limits(axes: Any, mechanism: Mechanism) -> None:
    """Draw vertical lines at both ends of the tilt range."""
    for tilt in np.degrees(tilt_interval(mechanism)):
        axes.axvline(tilt, color="0.7", linewidth=0.8, zorder=0)


def _title_with_angles(content: str, mechanism: Mechanism) -> str:
    """Return a title that states the angles α and β of a mechanism."""
    alpha, beta = np.degrees((mechanism.alpha, mechanism.beta))
    return f"{content} (α = {alpha:.2f}°, β = {beta:.2f}°)"
