"""Payload curves of joints 1, 2 and 4: the motorisation runs, with the friction of Table II and with the package's."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ssm_planner.paper.friction_maps import with_friction
from ssm_planner.paper.inputs import Inputs
from ssm_planner.paper.published import NUMBER, PACKAGE_FRICTION, TABLE_II, FrictionRow
from ssm_planner.paper.section import Section, number, picture, table
from ssm_planner.problem.motorisation import Motorisation
from ssm_planner.problem.values import Joint, Robot
from ssm_planner.report.sizing_figures import payload_curves
from ssm_planner.report.style import RPM
from ssm_planner.sizing.duty import Duty
from ssm_planner.sizing.size import JointSizing, Sizing, size

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure

SPEEDS = {"paper": "65 °/s, 200 °/s²; 20 mm/s, 100 mm/s²", "package": "2 rad/s, 10 rad/s²; 30 mm/s, 100 mm/s²"}
"""Speeds and accelerations of the runs by file name."""


@dataclass(frozen=True, eq=False)
class Payload:
    """One run at the friction of Table II and at the package's."""

    run: str
    identified: Sizing
    package: Sizing


def payloads(inputs: Inputs) -> tuple[Payload, ...]:
    """Both motorisation runs with both sets of friction."""
    return tuple(
        Payload(name, _sized(run, TABLE_II), _sized(run, PACKAGE_FRICTION))
        for name, run in inputs.motorisations.items()
    )


def payload_section(results: tuple[Payload, ...]) -> Section:
    """Peaks of the payload curves, and the curves at the paper's speeds."""
    rows = []
    for result in results:
        for mine, theirs in zip(result.identified.joints, result.package.joints, strict=True):
            rows.append(
                (
                    SPEEDS[result.run],
                    f"{NUMBER[mine.load.joint]}",
                    "figure only",
                    f"{RPM * mine.requirement.peak_speed:.0f}",
                    *_torques(theirs),
                    *_torques(mine),
                    f"{mine.requirement.peak_torque / theirs.requirement.peak_torque:.2f}",
                )
            )
    head = (
        "run, one joint at a time",
        "joint",
        "published",
        "speed (rpm)",
        "peak, the package's friction (mN·m)",
        "RMS",
        "peak, Table II (mN·m)",
        "RMS",
        "ratio of the peaks",
    )
    first = results[0]
    lines = [
        *table(head, rows),
        "The paper prints its payload curves as a figure without numbers, drawn before identification with the "
        "manufacturers' friction (§IV-C); the package's is what is known of that. Both are drawn here at the paper's speeds. "
        "With the friction identified later the motors must deliver more, by the last column. Static friction at every "
        "start counts here; the package sets the torque to zero at standstill.",
        "",
        *picture(
            "payload_curves_package", "Payload curves with the package's friction, as for the paper's motor selection"
        ),
        *picture("payload_curves_table_ii", "Payload curves with the friction of Table II"),
    ]
    figures: dict[str, Figure] = {
        "payload_curves_package": payload_curves(first.package),
        "payload_curves_table_ii": payload_curves(first.identified),
    }
    return Section(
        "Payload curves",
        "ssm-planner reproduce",
        lines,
        figures,
    )


def _torques(joint: JointSizing) -> tuple[str, str]:
    r = joint.requirement
    return number(1e3 * r.peak_torque), number(1e3 * r.rms_torque)


def _sized(run: Motorisation, rows: Mapping[str, FrictionRow]) -> Sizing:
    return size(Duty.of_motorisation(replace(run, robot=with_rows(run.robot, rows))))


def with_rows(robot: Robot, rows: Mapping[str, FrictionRow]) -> Robot:
    """The robot with published friction in its drives, by joint name."""

    def changed(joint: Joint) -> Joint:
        row = rows.get(joint.name)
        return joint if joint.drive is None or row is None else replace(joint, drive=with_friction(joint.drive, row))

    first, second, third, fourth = (changed(joint) for joint in robot.joints)
    return replace(robot, joints=(first, second, third, fourth))
