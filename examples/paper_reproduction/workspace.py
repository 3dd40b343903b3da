"""Compare the workspace with the paper: Table I, reachable set, and the choice of α and β (§IV)."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from paper_reproduction import published
from paper_reproduction.published import TABLE_I, TABLE_I_MEASURED
from paper_reproduction.section import Section
from ssm_planner.display import use_minus_signs
from ssm_planner.kinematics import (
    DesignRegion,
    Mechanism,
    design_region,
    joint_speed_per_tilt_speed,
    tilt_interval,
)
from ssm_planner.problem import Eye, Robot
from ssm_planner.reporting import (
    COLOURS,
    FONT_SIZE,
    LIMIT_STYLE,
    axes_figure,
    design_region_figure,
    draw_legend,
    draw_legend_above,
    finish_axes,
    new_figure,
    reachable_set_figure,
    tool_directions,
)
from ssm_planner.typing import Array, Range, frozen, record

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@frozen
class TiltRow:
    """Row of Table I: an end or the width of the tilt range, rad."""

    name: str
    """Name of the row."""
    theoretical: float
    """Value that follows from the geometry."""
    measured: float
    """Value that the authors measured."""
    paper: float
    """Theoretical value that the paper states."""

    @property
    def agreement(self) -> float:
        """Agreement of theory and measurement: 1 − |theoretical − measured| / |theoretical|."""
        return 1.0 - abs(self.theoretical - self.measured) / abs(self.theoretical)


def tilt_table(mechanism: Mechanism) -> tuple[TiltRow, TiltRow, TiltRow]:
    """Compute the rows of Table I: width, lower end and upper end of the tilt range."""
    low, high = tilt_interval(mechanism)
    measured = TABLE_I_MEASURED
    return (
        TiltRow("tilt range", high - low, measured[1] - measured[0], TABLE_I[1] - TABLE_I[0]),
        TiltRow("lower end", low, measured[0], TABLE_I[0]),
        TiltRow("upper end", high, measured[1], TABLE_I[1]),
    )


def tilt_disks(mechanism: Mechanism) -> "Figure":
    """Draw the tilts that the tool reaches, as two sectors that are symmetric about ω₁.

    The measured limits of Table I are drawn as lines.
    """
    figure = new_figure(5.2, 4.4)
    axes = figure.subplots()
    interval = tilt_interval(mechanism)
    _sector(axes, interval, -1.0, facecolor="0.72", label="reachable at roll 0°")
    _sector(axes, interval, 1.0, facecolor="0.88", label="reachable at roll 180°")
    angles = np.linspace(0.0, 2.0 * math.pi, 361)
    axes.plot(np.cos(angles), np.sin(angles), color="0.8", linewidth=0.8, zorder=0)
    for k, tilt in enumerate(TABLE_I_MEASURED):
        _ray(axes, tilt, 1.08, label=None if k else "measured (Table I)", **LIMIT_STYLE)
    _ray(axes, mechanism.home_tilt, 1.0, color="black", linewidth=1.2, linestyle="-.", label="home")
    for tilt, measured in zip(interval, TABLE_I_MEASURED, strict=True):
        text = use_minus_signs(
            f"{math.degrees(tilt):.2f}°\n(measured {math.degrees(measured):.1f}°)"
        )
        side = "right" if math.cos(tilt) < 0 else "left"
        x, y = 1.14 * math.cos(tilt), -1.14 * math.sin(tilt)
        axes.text(x, y, text, ha=side, va="center", fontsize=FONT_SIZE - 1)
    axes.annotate("", (1.3, 0.0), (0.0, 0.0), arrowprops={"arrowstyle": "->"})
    axes.text(1.36, 0.0, "ω₁", ha="left", va="center", fontsize=FONT_SIZE)
    finish_axes(axes, "", "")
    axes.set(xlim=(-1.75, 1.6), ylim=(-1.15, 1.35), aspect="equal")
    axes.set_axis_off()
    draw_legend(axes, loc="upper center", bbox_to_anchor=(0.5, 0.02), ncols=2)
    return figure


def _sector(axes: "Axes", interval: Range, sign: float, **style: Any) -> None:
    """Draw a sector of tilts with its label.

    The tilts are those of `interval` in rad, times `sign`.
    """
    from matplotlib.patches import Wedge

    ends = sorted(sign * math.degrees(end) for end in interval)
    axes.add_patch(Wedge((0.0, 0.0), 1.0, *ends, edgecolor="0.3", linewidth=0.8, **style))
    # The label must not cover the line of the home position.
    angle = sign * (0.28 * interval[0] + 0.72 * interval[1])
    x, y = 0.75 * math.cos(angle), 0.75 * math.sin(angle)
    axes.text(x, y, "2α", ha="center", va="center", fontsize=FONT_SIZE)


def _ray(axes: "Axes", tilt: float, length: float, **style: Any) -> None:
    """Draw a line of the given length from the centre in the direction of a tilt in rad."""
    axes.plot([0.0, length * math.cos(tilt)], [0.0, -length * math.sin(tilt)], **style)


@record
class TiltRange:
    """Table I for two values of β: the rounded one in the paper, and that of the robot file."""

    printed: tuple[TiltRow, TiltRow, TiltRow]
    """Rows with the rounded β."""
    exact: tuple[TiltRow, TiltRow, TiltRow]
    """Rows with the β of the robot file."""
    beta: float
    """β of the robot file, rad."""


def tilt_range(robot: Robot) -> TiltRange:
    """Compute Table I for the β that the paper prints and for that of the robot file, rad."""
    mechanism = Mechanism.from_robot(robot)
    rounded = Mechanism.from_angles(published.ALPHA, published.BETA, published.FIRST_TILT)
    return TiltRange(tilt_table(rounded), tilt_table(mechanism), mechanism.beta)


def workspace_section(robot: Robot) -> Section:
    """Build the section about Table I, with the reason for its differences and with figures."""
    mechanism = Mechanism.from_robot(robot)
    figures = {
        "axes": axes_figure(mechanism),
        "tilt_disks": tilt_disks(mechanism),
        "reachable_set": reachable_set_figure(mechanism),
    }
    return Section("workspace", {"tilt": tilt_range(robot)}, figures)


@record
class DesignChoice:
    """Smallest α with which a mechanism reaches the required tilts, and its margin, rad."""

    region: DesignRegion
    """Region for the printed tilt range."""
    least: tuple[float, float]
    """Angles (α, β) with the smallest α that reach the required tilts, without a margin."""
    spare: float
    """Margin at both ends of the required tilt range with the published α and β."""
    speed: tuple[float, float]
    """Ratio of the speed of joint 2 to the tilt speed.

    The first value applies at the less favourable end of the required range, the second in its
    middle.
    """


def design_choice() -> DesignChoice:
    """Compute the angles α and β for the required tilt range, and compare them with the paper.

    The required range is in the middle of the range in Table I.
    """
    middle = (TABLE_I[0] + TABLE_I[1]) / 2
    required = (middle - published.REQUIRED_TILT / 2, middle + published.REQUIRED_TILT / 2)
    mechanism = Mechanism.from_angles(published.ALPHA, published.BETA)
    low, high = tilt_interval(mechanism)
    rates = np.abs(
        joint_speed_per_tilt_speed(mechanism, np.array([*required, middle]), mechanism.home_branch)[
            :, 1
        ]
    )
    return DesignChoice(
        design_region(*TABLE_I),
        design_region(*required).smallest_alpha,
        min(required[0] - low, high - required[1]),
        (float(rates[:2].max()), float(rates[2])),
    )


def design_section(robot: Robot, eye: Eye) -> Section:
    """Build the section about the choice of the axes, the other required ranges, and the eye."""
    choice = design_choice()
    mechanism = Mechanism.from_robot(robot)
    low, high = robot.joints[3].position
    across, offset, axial = robot.bodies[3].com
    values = {
        "choice": choice,
        "built_beta": mechanism.beta,
        "travel": high - low,
        "along": axial,
        "beside": math.hypot(across, offset),
    }
    figure = design_region_figure(choice.region, (mechanism.alpha, mechanism.beta), size=(4.6, 4.6))
    return Section(
        "design", values, {"design": figure, "eye_sections": eye_sections(mechanism, eye)}
    )


def eye_sections(mechanism: Mechanism, eye: Eye) -> "Figure":
    """Draw the eye with the required ranges of tilt and roll, from the port to the retina, in mm.

    The tilt range is drawn at roll 0, and the roll range at the middle tilt.
    """
    figure = new_figure(7.2, 4.2)
    left, right = figure.subplots(1, 2, sharey=True)
    middle = (TABLE_I[0] + TABLE_I[1]) / 2.0
    sweep = np.linspace(-0.5, 0.5, 91)
    tilts = middle + published.REQUIRED_TILT * sweep
    rolls = published.REQUIRED_ROLL * sweep
    sign = mechanism.insertion_sign
    about_tilt = sign * tool_directions(mechanism, tilts, np.zeros(len(sweep))).T
    about_roll = sign * tool_directions(mechanism, middle, rolls).T
    tilt, roll = (math.degrees(x) for x in (published.REQUIRED_TILT, published.REQUIRED_ROLL))
    title = f"tilt {tilt:.0f}°, section through ω₁, roll 0°"
    _eye_section(left, eye, 0, about_tilt, ("along ω₁ (mm)", "up (mm)", title))
    title = f"roll {roll:.0f}°, seen along ω₁"
    _eye_section(right, eye, 1, about_roll, ("across ω₁ (mm)", "", title))
    draw_legend_above(figure, left, 5)
    return figure


def _eye_section(
    axes: "Axes", eye: Eye, i: int, directions: Array, labels: tuple[str, str, str]
) -> None:
    """Draw a section of the eye, with a range of tool directions.

    Parameters
    ----------
    axes : Axes
        Axes of the figure.
    eye : Eye
        The eye.
    i : int
        Index of the horizontal component of the base frame. The vertical component is z.
    directions : (n, 3)
        Unit vectors from the port to the retina.
    labels : (str, str, str)
        Titles of the horizontal axis, of the vertical axis and of the section.
    """
    from matplotlib.patches import Circle, Ellipse, Polygon

    centre = _mm(eye.centre, i)
    radius, clear_radius = 1e3 * eye.radius, 1e3 * (eye.radius - eye.clearance)
    dashed: Any = {"edgecolor": "0.45", "linestyle": (0, (4, 2))}
    axes.add_patch(Circle(centre, radius, fill=False, edgecolor="black", label="retina"))
    axes.add_patch(Circle(centre, clear_radius, fill=False, label="clearance", **dashed))
    if eye.lens is not None:
        # The projection of an ellipsoid on an axis has the half width √(Σ (R_ik a_k)²).
        widths = _mm(2 * np.sqrt(eye.lens.frame**2 @ eye.lens.semi_axes**2), i)
        lens = Ellipse(_mm(eye.lens.centre, i), *widths, color="0.6", linewidth=0, label="lens")
        axes.add_patch(lens)
    ends = 1e3 * (directions * _to_retina(eye, directions)[:, None])[:, [i, 2]]
    outline = np.vstack([np.zeros(2), ends])
    area: Any = {"color": COLOURS[0], "alpha": 0.25, "linewidth": 0}
    axes.add_patch(Polygon(outline, label="required range", **area))
    for end in ends[[0, -1]]:
        axes.plot(*zip((0.0, 0.0), end, strict=True), color=COLOURS[0], linewidth=1.0)
    axes.plot([0.0], [0.0], "o", color="black", markersize=4, label="port, RCM")
    finish_axes(axes, *labels)
    axes.set(xlim=(centre[0] - 13.0, centre[0] + 13.0), ylim=(-21.0, 5.0), aspect="equal")


def _mm(vector: Array, i: int) -> tuple[float, float]:
    """Return component `i` and the height z of a vector (3,) in m, converted to mm."""
    return 1e3 * float(vector[i]), 1e3 * float(vector[2])


def _to_retina(eye: Eye, directions: Array) -> Array:
    """Return the distances (n,) in m from the port to the retina along unit vectors (n, 3)."""
    projection = directions @ eye.centre
    return projection + np.sqrt(projection**2 - eye.centre @ eye.centre + eye.radius**2)
