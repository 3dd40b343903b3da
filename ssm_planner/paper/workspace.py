"""Table I, the extremes of eq. 9 and the workspace figure; the choice of α and β in §IV."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ssm_planner.model.design import DesignRegion, design_region
from ssm_planner.model.measures import joint_speed_per_tilt_speed
from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.workspace import tilt_interval
from ssm_planner.paper import published
from ssm_planner.paper.section import Section, minus, picture, signed, table, text
from ssm_planner.problem.values import Robot
from ssm_planner.report.workspace_figures import design_region_figure, reachable_set_figure
from ssm_planner.report.workspace_table import PAPER, TiltRow, tilt_table


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
    """Table I and the workspace figure."""
    found = tilt_range(robot)
    rows = []
    for printed, exact in zip(found.printed, found.exact, strict=True):
        difference = exact.theoretical - exact.paper
        rows.append(
            (
                exact.name,
                _degrees(exact.paper, 1),
                _degrees(printed.theoretical),
                _degrees(exact.theoretical),
                signed(math.degrees(difference), 3, "°"),
                _degrees(exact.measured, 1),
                f"{100 * printed.agreement:.1f} %",
                f"{100 * exact.agreement:.1f} %",
            )
        )
    head = (
        "Table I",
        "published, theoretical",
        "ours, β = 110°",
        f"ours, β = {math.degrees(found.beta):.3f}°",
        "difference",
        "published, measured",
        "agreement, β = 110°",
        f"agreement, β = {math.degrees(found.beta):.3f}°",
    )
    agreement = found.printed[0].agreement
    lines = [
        *table(head, rows),
        f"The ends are φ = ±(α ± β) (eq. 9). Why they differ: the paper sets the tool 23° beyond the perpendicular to ω₁ "
        f"and ω₂, which makes β = {math.degrees(found.beta):.3f}°, and prints it as 110°; that shifts both ends by "
        f"{abs(math.degrees(published.BETA - found.beta)):.3f}° and leaves the extent. The published agreement is "
        f"{100 * published.TILT_AGREEMENT:.1f} %, of the extent; ours of the same figures is {100 * agreement:.1f} % "
        f"(difference {signed(100 * (agreement - published.TILT_AGREEMENT), 1, ' %')}). "
        "The measured column is the paper's: its protractor readings cannot be recomputed.",
        "",
        *picture(
            "workspace",
            "The paper's workspace figure: reachable pointings, and the tilt disks as arcs of the section through ω₁",
        ),
    ]
    mechanism = Mechanism.from_geometry(robot.geometry)
    return Section(
        "Table I: tilt range, and the workspace figure",
        "ssm-planner reproduce",
        lines,
        {"workspace": reachable_set_figure(mechanism)},
    )


@dataclass(frozen=True, eq=False)
class DesignChoice:
    """The (α, β) of smallest α that hold the required tilt, with growing spare tilt at both ends; rad."""

    region: DesignRegion
    """For the tilt range that the paper prints."""
    least: tuple[float, float]
    """For the required tilt alone, centred in the printed range."""
    spare: float
    """Beyond either end of the required tilt, with the α that was chosen."""
    speed: tuple[float, float]
    """Joint 2 per tilt speed at the ends of the required tilt: largest, and at the middle."""


def design_choice() -> DesignChoice:
    """§IV-A and §IV-B from the required ranges, in closed form."""
    middle = (PAPER[0] + PAPER[1]) / 2
    need = (middle - published.REQUIRED_TILT / 2, middle + published.REQUIRED_TILT / 2)
    chosen = Mechanism.from_angles(published.ALPHA, published.BETA)
    low, high = tilt_interval(chosen)
    spare = min(need[0] - low, high - need[1])
    rates = joint_speed_per_tilt_speed(chosen, np.array([*need, middle]), chosen.home_branch)[:, 1]
    return DesignChoice(
        design_region(*PAPER),
        design_region(*need).smallest_alpha,
        spare,
        (float(np.abs(rates[:2]).max()), float(abs(rates[2]))),
    )


def design_section(robot: Robot) -> Section:
    """The choice of α and β, the other required ranges, and what of the separation can be said."""
    choice = design_choice()
    alpha, beta = choice.region.smallest_alpha
    mechanism = Mechanism.from_geometry(robot.geometry)
    stage = robot.bodies[3]
    low, high = robot.joints[3].position
    rows = [
        (
            "α",
            "30°",
            _degrees(alpha, 2),
            signed(math.degrees(alpha - published.ALPHA), 2, "°"),
            "smallest α that reaches −140° to −80°",
        ),
        (
            "β",
            "≈ 110°",
            _degrees(beta, 2),
            signed(math.degrees(beta - published.BETA), 2, "°"),
            f"the β that goes with it; from −23° it is {_degrees(mechanism.beta)}",
        ),
        (
            "least α for 50° of tilt",
            "not printed",
            _degrees(choice.least[0], 2),
            "–",
            f"half the range; α = 30° spares {_degrees(choice.spare, 1)} at either end",
        ),
        (
            "joint 2 per tilt speed",
            "not printed",
            f"{choice.speed[0]:.2f} at the ends, {choice.speed[1]:.2f} in the middle",
            "–",
            "what the spare tilt buys: with α = 25° it is unbounded at the ends",
        ),
        ("roll 60°, spin 360°", "unrestricted", "unrestricted", "–", "joints 1 and 3 turn roll and spin one to one"),
        (
            "translation",
            "30 mm",
            f"{1e3 * (high - low):.0f} mm",
            signed(1e3 * (high - low - published.REQUIRED_TRAVEL), 0, " mm"),
            "range of joint 4 in the robot file, set to the requirement",
        ),
        (
            "separation of tip and actuated parts",
            "≈ 100 mm",
            "not derivable",
            "–",
            "it follows from the lengths of links 1 and 2, which are in the CAD drawing only. The package gives centres "
            f"of mass: that of the translation stage lies {1e3 * stage.com[2]:.1f} mm out along the tool axis and "
            f"{1e3 * math.hypot(stage.com[0], stage.com[1]):.1f} mm beside it",
        ),
    ]
    lines = [
        *table(("§IV-A, §IV-B", "published", "ours", "difference", "why"), rows),
        *picture(
            "design", "All (α, β) that reach −140° to −80°, in closed form; the corner of smallest α is the paper's"
        ),
    ]
    figure = design_region_figure(choice.region, (mechanism.alpha, mechanism.beta))
    return Section(
        "Choice of the axes (§IV)",
        "ssm-planner reproduce",
        lines,
        {"design": figure},
    )


def _degrees(value: float, decimals: int = 3) -> str:
    return f"{math.degrees(value):.{decimals}f}°".replace("-", "−")
