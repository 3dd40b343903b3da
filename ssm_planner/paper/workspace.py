"""Table I (tilt range), the tilt disks and the reachable set, and the choice of α and β in §IV."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ssm_planner.kinematics.design import DesignRegion, design_region
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.workspace import joint_speed_per_tilt_speed, tilt_interval
from ssm_planner.paper import published
from ssm_planner.paper.section import NOTHING, Section, minus, percent, picture, signed, table, text
from ssm_planner.problem.robot import Robot
from ssm_planner.reporting.figures.style import DPI, LIMIT, SIZE, finish, new_figure
from ssm_planner.reporting.figures.workspace import design_region_figure, reachable_set_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
from ssm_planner.paper.published import TABLE_I, TABLE_I_MEASURED


@dataclass(frozen=True)
class TiltRow:
    """One row of the table; rad."""

    name: str
    theoretical: float
    measured: float
    paper: float
    """The theoretical value that the paper prints."""

    @property
    def agreement(self) -> float:
        """1 − |theoretical − measured| / |theoretical|."""
        return 1.0 - abs(self.theoretical - self.measured) / abs(self.theoretical)


def tilt_table(
    mechanism: Mechanism, measured: tuple[float, float] = TABLE_I_MEASURED
) -> tuple[TiltRow, TiltRow, TiltRow]:
    """Rows of extent, lower and upper end of the tilt range of a mechanism beside a measured interval, rad."""
    low, high = tilt_interval(mechanism)
    return (
        TiltRow("tilt range", high - low, measured[1] - measured[0], TABLE_I[1] - TABLE_I[0]),
        TiltRow("lower end", low, measured[0], TABLE_I[0]),
        TiltRow("upper end", high, measured[1], TABLE_I[1]),
    )


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
    for k, tilt in enumerate(TABLE_I_MEASURED):
        _ray(axes, tilt, 1.08, label=None if k else "measured (Table I)", **LIMIT)
    _ray(axes, mechanism.home_tilt, 1.0, color="black", linewidth=1.2, linestyle="-.", label="home")
    for tilt, measured in zip(interval, TABLE_I_MEASURED, strict=True):
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


@dataclass(frozen=True, eq=False)
class TiltRange:
    """Table I with β as printed and with the β that follows from the tool's first position."""

    printed: tuple[TiltRow, TiltRow, TiltRow]
    exact: tuple[TiltRow, TiltRow, TiltRow]
    beta: float


def tilt_range(robot: Robot) -> TiltRange:
    """Rows of extent, lower end, upper end, rad."""
    mechanism = Mechanism.from_geometry(robot.geometry)
    rounded = Mechanism.from_angles(published.ALPHA, published.BETA, published.FIRST_TILT)
    return TiltRange(tilt_table(rounded), tilt_table(mechanism), mechanism.beta)


def workspace_section(robot: Robot) -> Section:
    """Table I, why it differs, and the pictures."""
    found = tilt_range(robot)
    beta = f"β = {math.degrees(found.beta):.3f}°"
    rows = [
        (
            exact.name,
            degrees(exact.paper, 1),
            degrees(printed.theoretical),
            degrees(exact.theoretical),
            signed(math.degrees(exact.theoretical - exact.paper), 3, "°"),
            degrees(exact.measured, 1),
            f"{100 * printed.agreement:.1f} %",
            f"{100 * exact.agreement:.1f} %",
        )
        for printed, exact in zip(found.printed, found.exact, strict=True)
    ]
    head = (
        "Table I",
        "published, theoretical",
        "ours, β = 110°",
        f"ours, {beta}",
        "difference",
        "published, measured",
        "agreement, β = 110°",
        f"agreement, {beta}",
    )
    agreement = found.printed[0].agreement
    lines = [
        *table(head, rows),
        *text(
            "The ends are φ = ±(α ± β) (eq. 9). Why they differ: the paper sets the tool 23° beyond the perpendicular to ω₁ "
            f"and ω₂, which makes {beta}, and prints it as 110°; that shifts both ends by "
            f"{abs(math.degrees(published.BETA - found.beta)):.3f}° and leaves the extent. The paper prints an agreement of "
            f"{100 * published.TILT_AGREEMENT:.1f} % for the extent; ours is {100 * agreement:.1f} % (difference "
            f"{percent(agreement - published.TILT_AGREEMENT)}). The measured column is the paper's: its protractor readings "
            "cannot be recomputed."
        ),
        *picture("tilt_disks", "Tilt disks in the plane of ω₁ and the tool, with the limits measured on the prototype"),
        *picture(
            "reachable_set", "Reachable pointings on the unit sphere, and the tilt interval in the section through ω₁"
        ),
    ]
    mechanism = Mechanism.from_geometry(robot.geometry)
    return Section(
        "Table I: tilt range, and the workspace figure",
        lines,
        {"tilt_disks": tilt_disks(mechanism), "reachable_set": restyled(reachable_set_figure(mechanism))},
        ("ssm-planner workspace problems/robots/vitreoretinal.yaml",),
    )


def degrees(value: float, decimals: int = 3) -> str:
    """An angle given in rad."""
    return minus(f"{math.degrees(value):.{decimals}f}°")


@dataclass(frozen=True, eq=False)
class DesignChoice:
    """The (α, β) of smallest α that hold a tilt range; rad."""

    region: DesignRegion
    """For the tilt range that the paper prints."""
    least: tuple[float, float]
    """(α, β) for the required tilt alone, in the middle of the printed range."""
    spare: float
    """Tilt beyond either end of the required one, with the published α and β."""
    speed: tuple[float, float]
    """Joint 2 per tilt speed with the published α and β: at the worse end of the required tilt, and in its middle."""


def design_choice() -> DesignChoice:
    """From the required ranges to the axes."""
    middle = (TABLE_I[0] + TABLE_I[1]) / 2
    need = (middle - published.REQUIRED_TILT / 2, middle + published.REQUIRED_TILT / 2)
    chosen = Mechanism.from_angles(published.ALPHA, published.BETA)
    low, high = tilt_interval(chosen)
    rates = np.abs(joint_speed_per_tilt_speed(chosen, np.array([*need, middle]), chosen.home_branch)[:, 1])
    return DesignChoice(
        design_region(*TABLE_I),
        design_region(*need).smallest_alpha,
        min(need[0] - low, high - need[1]),
        (float(rates[:2].max()), float(rates[2])),
    )


def design_section(robot: Robot) -> Section:
    """The axes, the other required ranges, and what of the separation can be said."""
    choice = design_choice()
    alpha, beta = choice.region.smallest_alpha
    mechanism, stage = Mechanism.from_geometry(robot.geometry), robot.bodies[3]
    low, high = robot.joints[3].position
    beside = math.hypot(float(stage.com[0]), float(stage.com[1]))
    rows = [
        (
            "α",
            "30°",
            degrees(alpha, 2),
            signed(math.degrees(alpha - published.ALPHA), 2, "°"),
            "the smallest α that reaches −140° to −80°",
        ),
        (
            "β",
            "≈ 110°",
            degrees(beta, 2),
            signed(math.degrees(beta - published.BETA), 2, "°"),
            f"the β that goes with it; from the tool's −23° it is {degrees(mechanism.beta)}",
        ),
        (
            "least α for the required 50° of tilt",
            "not printed",
            degrees(choice.least[0], 2),
            NOTHING,
            f"half the range; the chosen 30° spare {degrees(choice.spare, 1)} at either end",
        ),
        (
            "speed of joint 2 by tilt speed",
            "not printed",
            f"{choice.speed[0]:.2f} at the ends, {choice.speed[1]:.2f} in the middle",
            NOTHING,
            "what the spare tilt buys: with the least α it is unbounded at the ends",
        ),
        (
            "roll 60°, spin 360°",
            "unrestricted",
            "unrestricted",
            NOTHING,
            "joints 1 and 3 give roll and spin one to one",
        ),
        (
            "translation",
            "30 mm",
            f"{1e3 * (high - low):.0f} mm",
            signed(1e3 * (high - low - published.REQUIRED_TRAVEL), 0, " mm"),
            "joint 4 of the robot file is given the requirement as its range",
        ),
        (
            "separation of tip and actuated parts",
            "≈ 100 mm",
            "not derivable",
            NOTHING,
            "follows from the lengths of links 1 and 2, which are in the CAD drawing only; the package has centres of mass: "
            f"that of the translation stage is {1e3 * stage.com[2]:.1f} mm out along the tool axis, {1e3 * beside:.1f} mm "
            "beside it",
        ),
    ]
    lines = [
        *table(("§IV-A, §IV-B", "published", "ours", "difference", "why"), rows, words=(4,)),
        *picture(
            "design", "All (α, β) that reach −140° to −80°, in closed form; the corner of smallest α is the paper's"
        ),
    ]
    figure = restyled(design_region_figure(choice.region, (mechanism.alpha, mechanism.beta)), (4.6, 4.6))
    return Section(
        "Choice of the axes (§IV)", lines, {"design": figure}, ("ssm-planner workspace --reach -140deg -80deg",)
    )
