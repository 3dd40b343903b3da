"""The choice of α and β in §IV from the required ranges, in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ssm_planner.kinematics.design import DesignRegion, design_region
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.workspace import joint_speed_per_tilt_speed, tilt_interval
from ssm_planner.paper import published
from ssm_planner.paper.section import NOTHING, Section, picture, signed, table
from ssm_planner.paper.workspace import PAPER, degrees, restyled
from ssm_planner.problem.robot import Robot
from ssm_planner.reporting.figures.workspace import design_region_figure


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
    middle = (PAPER[0] + PAPER[1]) / 2
    need = (middle - published.REQUIRED_TILT / 2, middle + published.REQUIRED_TILT / 2)
    chosen = Mechanism.from_angles(published.ALPHA, published.BETA)
    low, high = tilt_interval(chosen)
    rates = np.abs(joint_speed_per_tilt_speed(chosen, np.array([*need, middle]), chosen.home_branch)[:, 1])
    return DesignChoice(
        design_region(*PAPER),
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
