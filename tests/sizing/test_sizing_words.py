"""The texts about motors on the web page and in the terminal follow from the sizing.

They name the figures on which the verdict depends.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from ssm_planner.problem.motor import Motor
from ssm_planner.problem.robot import Robot
from ssm_planner.reporting.text import skipped_checks, summarise_sizing
from ssm_planner.sizing.duty import DutyCycle
from ssm_planner.sizing.size import size, size_motion
from ssm_planner.trajectory import Trajectory
from tests.support.sizing_cases import COMPLETE, equipped

CONFIRMED = replace(COMPLETE, placeholders=())


def with_motor(robot: Robot, name: str, motor: Motor | None) -> Robot:
    joints = tuple(
        replace(joint, motor=motor) if joint.name == name else joint for joint in robot.joints
    )
    return replace(robot, joints=joints)


def locking(robot: Robot) -> Robot:
    """Return a robot whose lowest friction coefficient is stated and still locks its drives."""
    joints = []
    for joint in equipped(robot, CONFIRMED).joints:
        if joint.drive is not None and joint.drive.friction is not None:
            friction = replace(joint.drive.friction, mu_lowest=joint.drive.friction.mu)
            joint = replace(joint, drive=replace(joint.drive, friction=friction))
        joints.append(joint)
    return replace(robot, joints=tuple(joints))


@pytest.fixture(scope="module")
def known(robot: Robot) -> Robot:
    return locking(robot)


def said(robot: Robot, trajectory: Trajectory) -> tuple[str, str, str]:
    return summarise_sizing(size_motion(trajectory, robot).to_dict())


def test_the_verdict_on_a_motion_is_that_of_the_command(
    robot: Robot, trajectory: Trajectory
) -> None:
    by_command = size(DutyCycle.of_trajectory(trajectory, robot)).to_dict()
    assert size_motion(trajectory, robot).to_dict() == by_command


def test_good_only_where_all_is_known_and_within(known: Robot, trajectory: Trajectory) -> None:
    """The state is good if every motor is known to suffice."""
    assert size_motion(trajectory, known).adequate is True
    state, word, reason = said(known, trajectory)
    assert state == "good"
    assert "suffice" in word
    assert "99 %" in reason


CHANGES: dict[str, tuple[Callable[[Motor], Motor | None], str, list[str]]] = {
    "weak": (
        lambda motor: replace(motor, max_torque=1e-5, nominal_torque=1e-5),
        "bad",
        ["tilt: torque", "tilt: continuous torque"],
    ),
    "slow": (lambda motor: replace(motor, max_speed=1.0), "bad", ["tilt: speed"]),
    "no heat": (
        lambda motor: replace(motor, time_constant_winding=None),
        "open",
        ["Not checked", "heat"],
    ),
    "placeholder": (
        lambda motor: replace(motor, placeholders=("max_torque",)),
        "open",
        ["Stand-in figures: tilt max torque (may be"],
    ),
    "no motor": (lambda motor: None, "open", ["no motor given for tilt"]),
}


@pytest.mark.parametrize("change", CHANGES)
def test_the_reason_names_the_failed_or_unknown_figure(
    change: str, known: Robot, trajectory: Trajectory
) -> None:
    """The reason names the failed check or the unknown figure of the changed motor."""
    changed, expected, parts = CHANGES[change]
    state, word, reason = said(with_motor(known, "tilt", changed(CONFIRMED)), trajectory)
    assert state == expected
    assert all(part in reason for part in parts), reason
    assert "roll" not in reason.partition("tightest check. ")[2]
    assert state != "bad" or "not" in word


def test_a_conditional_verdict_holds_up_to_the_error_that_it_permits(
    known: Robot, trajectory: Trajectory
) -> None:
    """A conditional verdict states by how much an assumed figure may be lower.

    The motor passes if its figure is lower by slightly less, and fails if it is lower by slightly
    more.
    """
    stand_in = replace(CONFIRMED, placeholders=("nominal_torque",))
    sizing = size_motion(trajectory, with_motor(known, "tilt", stand_in)).to_dict()
    state, word, reason = summarise_sizing(sizing)
    assert (state, sizing["adequate"]) == ("open", None)
    assert re.fullmatch(r"Motors suffice with [\d.]+ % margin if 1 stand-in figure holds", word)
    (spare,) = re.findall(r"tilt nominal torque \(may be ([\d.]+) % lower\)", reason)
    for change, passed in ((-0.1, True), (0.1, False)):
        factor = 1 - (float(spare) + change) / 100
        weaker = replace(CONFIRMED, nominal_torque=factor * CONFIRMED.nominal_torque)
        (tilt,) = (
            motor
            for motor in size_motion(trajectory, with_motor(known, "tilt", weaker)).to_dict()[
                "motors"
            ]
            if motor["joint"] == "tilt"
        )
        (check,) = (check for check in tilt["checks"] if check["name"] == "continuous_torque")
        assert (check["passed"] is True) is passed


def test_a_weak_gear_is_named(known: Robot, trajectory: Trajectory) -> None:
    joints = list(known.joints)
    assert joints[0].drive is not None
    assert joints[0].drive.ratings is not None
    ratings = replace(joints[0].drive.ratings, peak_output=1e-6, continuous_output=None)
    joints[0] = replace(joints[0], drive=replace(joints[0].drive, ratings=ratings))
    state, _, reason = said(replace(known, joints=tuple(joints)), trajectory)
    assert state == "bad"
    assert "roll: gear peak output" in reason


def test_every_missing_figure_is_listed_with_its_joint(
    robot: Robot, trajectory: Trajectory
) -> None:
    sizing: dict[str, Any] = size_motion(trajectory, robot).to_dict()
    assert sizing["adequate"] is not True
    rows = list(skipped_checks(sizing))
    for part, owner in (
        *((m, m["motor"]) for m in sizing["motors"]),
        *((g, g["drive"]) for g in sizing["gears"]),
    ):
        of_part = [row for row in rows if row[:2] == (part["joint"], owner)]
        for check, needs in part["not_checked"].items():
            listed = [
                row
                for row in rows
                if row[0] == part["joint"] and check.replace("_", " ") in row[2].split(", ")
            ]
            assert listed
            assert all(figure in listed[0][3] for figure in needs.split(" and "))
        assert len(of_part) <= 1
