"""Table I and the workspace figure."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ssm_planner.model.mechanism import Mechanism
from ssm_planner.paper import published
from ssm_planner.paper.section import Section, minus, percent, picture, signed, table, text
from ssm_planner.paper.tilt_disks import restyled, tilt_disks
from ssm_planner.problem.values import Robot
from ssm_planner.report.workspace_figures import reachable_set_figure
from ssm_planner.report.workspace_table import TiltRow, tilt_table


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
