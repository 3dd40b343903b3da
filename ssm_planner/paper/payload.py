"""Payload curves of joints 1, 2 and 4: the motorisation runs, with the friction of Table II and with the package's."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ssm_planner.paper.friction_maps import with_friction
from ssm_planner.paper.inputs import Inputs
from ssm_planner.paper.published import NUMBER, PACKAGE_FRICTION, TABLE_II, FrictionRow
from ssm_planner.paper.section import Section, number, picture, table, text
from ssm_planner.problem.motorisation import Motorisation, Stroke
from ssm_planner.problem.robot import Joint, Robot
from ssm_planner.reporting.figures.sizing import payload_curves
from ssm_planner.reporting.figures.style import RPM
from ssm_planner.sizing.duty import DutyCycle
from ssm_planner.sizing.size import JointSizing, Sizing, size

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure


SPEEDS = {"paper": "the paper's speeds", "package": "the package's speeds"}
"""What the runs are called, by file name."""


@dataclass(frozen=True, eq=False)
class Payload:
    """One run at the friction of Table II and at the package's."""

    run: Motorisation
    identified: Sizing
    package: Sizing


def payloads(inputs: Inputs) -> tuple[Payload, ...]:
    """Both motorisation runs with both sets of friction."""
    return tuple(
        Payload(run, _sized(run, TABLE_II), _sized(run, PACKAGE_FRICTION)) for run in inputs.motorisations.values()
    )


def payload_section(results: tuple[Payload, ...]) -> Section:
    """Peaks of the payload curves, and the curves at the paper's speeds."""
    rows = []
    for result in results:
        for stroke, mine, theirs in zip(
            result.run.strokes, result.identified.joints, result.package.joints, strict=True
        ):
            ratio = mine.requirement.peak_torque / theirs.requirement.peak_torque
            rows.append(
                (
                    _speeds(stroke),
                    "figure only",
                    f"{RPM * mine.requirement.peak_speed:.0f}",
                    *_torques(theirs),
                    *_torques(mine),
                    f"{ratio:.2f}",
                )
            )
    head = (
        "one joint at a time",
        "published",
        "motor speed (rpm)",
        "ours, package's friction: peak (mN·m)",
        "RMS",
        "ours, Table II: peak (mN·m)",
        "RMS",
        "ratio of the peaks",
    )
    first = results[0]
    lines = [
        *table(head, rows),
        *text(
            "The paper prints its payload curves as a figure without numbers, so there is no published value to subtract. It "
            "drew them before identification, with manufacturers' friction (§IV-C); of that, the package's parameters are "
            "what is known. With those of Table II, identified later, the peaks are the last column times as large. The "
            "first three rows are the speeds that the paper requires, the others those of the package's script."
        ),
        *picture(
            "payload_curves_package", "Payload curves with the package's friction, as for the paper's motor selection"
        ),
        *picture("payload_curves_table_ii", "Payload curves with the friction of Table II"),
    ]
    figures: dict[str, Figure] = {
        "payload_curves_package": payload_curves(first.package),
        "payload_curves_table_ii": payload_curves(first.identified),
    }
    also = [f"ssm-planner size problems/motorisation/{name}.yaml" for name in SPEEDS]
    return Section("Payload curves", lines, figures, also)


def _speeds(stroke: Stroke) -> str:
    """Such as `joint 1, 65°/s, 200°/s²`."""
    scale, unit = (1e3, " mm") if stroke.joint == "insertion" else (180.0 / math.pi, "°")
    speed, bend = (f"{scale * value:.4g}{unit}" for value in (stroke.velocity, stroke.acceleration))
    return f"joint {NUMBER[stroke.joint]}, {speed}/s, {bend}/s²"


def _torques(joint: JointSizing) -> tuple[str, str]:
    r = joint.requirement
    return number(1e3 * r.peak_torque), number(1e3 * r.rms_torque)


def _sized(run: Motorisation, rows: Mapping[str, FrictionRow]) -> Sizing:
    return size(DutyCycle.of_motorisation(replace(run, robot=with_rows(run.robot, rows))))


def with_rows(robot: Robot, rows: Mapping[str, FrictionRow]) -> Robot:
    """The robot with published friction in its drives, by joint name."""

    def changed(joint: Joint) -> Joint:
        row = rows.get(joint.name)
        return joint if joint.drive is None or row is None else replace(joint, drive=with_friction(joint.drive, row))

    first, second, third, fourth = (changed(joint) for joint in robot.joints)
    return replace(robot, joints=(first, second, third, fourth))
