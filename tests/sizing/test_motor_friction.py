"""The friction of a motor follows from its no-load current.

The friction of a drive contains that of its original motor, so only the excess of another motor is
added.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssm_planner.problem.motor import Motor
from ssm_planner.problem.robot import Robot
from ssm_planner.problem.serialization import robot_from_plain, robot_text, to_plain
from ssm_planner.sizing.assess import MotorVerdict, assess
from ssm_planner.sizing.duty import DutyCycle
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.motor_limits import Conditions, no_load_torque
from ssm_planner.sizing.requirements import torque_split
from tests.support.sizing_cases import COMPLETE, equipped, random_trajectory

KNOWN = Conditions(supply_voltage=24.0, current_limit=20.0)
OTHER = replace(COMPLETE, name="other", no_load_current=0.3)


@pytest.fixture(scope="module")
def load(robot: Robot) -> JointLoad:
    return DutyCycle.of_trajectory(random_trajectory(3), equipped(robot)).loads()[1]


def with_original(load: JointLoad, **figures: float | None) -> JointLoad:
    assert load.motor is not None
    return replace(load, motor=replace(load.motor, **figures))


def check_of(verdict: MotorVerdict, name: str):
    return next(check for check in verdict.checks if check.name == name)


def test_it_is_the_torque_of_the_no_load_current() -> None:
    """The friction of a motor is its no-load current times its torque constant."""
    assert no_load_torque(OTHER) == pytest.approx(0.3 * COMPLETE.torque_constant)
    for name in ("no_load_current", "torque_constant"):
        assert no_load_torque(replace(OTHER, **{name: None})) is None
    assert no_load_torque(None) is None


@pytest.mark.parametrize("original", [None, 0.1, 0.5])
def test_the_torque_is_that_of_a_drive_with_so_much_more_bearing_friction(
    load: JointLoad, original: float | None
) -> None:
    """The excess friction of another motor acts in the direction of motion, like the parameter b_c.

    The friction of the drive already contains that of the original motor.
    """
    load = with_original(load, no_load_current=original)
    extra = max(0.3 - (original or 0.0), 0.0) * COMPLETE.torque_constant
    verdict = assess(load, OTHER, KNOWN)
    friction = load.drive.friction
    assert friction is not None
    bearing = replace(load.drive, friction=replace(friction, b_c=friction.b_c + extra))
    by_hand = replace(load, drive=bearing)
    assert verdict.load.torque() == pytest.approx(by_hand.torque(), abs=1e-12)
    split = torque_split(verdict.load)
    assert sum(part for _, part in split.components()) == pytest.approx(verdict.load.torque())
    assert split.mesh_friction == pytest.approx(torque_split(load).mesh_friction, abs=1e-12)
    for name in ("peak_torque", "rms_torque", "joule_power"):
        expected = assess(by_hand, replace(by_hand.motor, no_load_current=None), KNOWN)
        assert getattr(verdict.requirement, name) == pytest.approx(
            getattr(expected.requirement, name)
        )


def test_the_own_motor_adds_nothing(load: JointLoad) -> None:
    """The friction of the drive already contains the friction of its original motor."""
    own = replace(COMPLETE, no_load_current=0.3)
    verdict = assess(with_original(load, no_load_current=0.3), own, KNOWN)
    assert verdict.load.motor_friction == (0.0, 0.0)
    assert verdict.load.torque() == pytest.approx(load.torque(), abs=1e-15)


def test_a_motor_without_the_figure_has_the_friction_of_the_drive(load: JointLoad) -> None:
    verdict = assess(load, replace(COMPLETE, name="other"), KNOWN)
    assert verdict.load.motor_friction == (0.0, 0.0)
    assumption = "no_load_current of other not stated: its friction is assumed"
    assert any(assumption in note for note in verdict.notes)
    for known in (OTHER, load.motor):
        assert not any("no_load_current" in note for note in assess(load, known, KNOWN).notes)


def test_between_the_ends_of_the_friction_the_answer_is_open(load: JointLoad) -> None:
    """The answer is open if it depends on the unknown friction of the original motor.

    The limit lies between the torque without and the torque with the whole friction of the
    candidate.
    """
    without = check_of(assess(load, replace(OTHER, no_load_current=None), KNOWN), "torque").worst
    with_all = check_of(assess(load, OTHER, KNOWN), "torque").worst
    assert with_all == pytest.approx(without + 0.3 * COMPLETE.torque_constant, rel=1e-3)
    answers = []
    for limit in (0.8 * without, (without + with_all) / 2, 1.001 * with_all):
        nominal = min(limit, COMPLETE.nominal_torque)
        candidate: Motor = replace(OTHER, max_torque=limit, nominal_torque=nominal)
        check = check_of(assess(load, candidate, KNOWN), "torque")
        answers.append(check.passed)
        if check.passed is None:
            assert "no_load_current of complete" in check.needs
    assert answers == [False, None, True]
    known = with_original(load, no_load_current=1e-6)
    candidate = replace(OTHER, max_torque=(without + with_all) / 2, nominal_torque=0.8 * without)
    assert check_of(assess(known, candidate, KNOWN), "torque").passed is False


def test_the_voltage_is_that_of_the_larger_current(load: JointLoad) -> None:
    verdict = assess(load, OTHER, KNOWN)
    torque, speed = verdict.load.torque(), verdict.load.speed()
    volts = []
    for temperature in (298.15, COMPLETE.max_winding_temperature):
        k = 0.026 * (1 - 0.0011 * (temperature - 298.15))
        ohm = 0.5 * (1 + 0.00393 * (temperature - 298.15))
        volts.append(np.abs(ohm * torque / k + k * speed).max())
    assert check_of(verdict, "voltage").nominal == pytest.approx(max(volts))


def test_plans_store_the_figure_and_certificates_without_it_stay_valid(robot: Robot) -> None:
    """The text of a robot in a certificate does not change if the no-load current is missing.

    Certificates of robots without this figure therefore stay valid.
    """
    assert "no_load_current" not in robot_text(robot)
    joints = [
        joint
        if joint.motor is None
        else replace(joint, motor=replace(joint.motor, no_load_current=0.1))
        for joint in robot.joints
    ]
    stated = replace(robot, joints=tuple(joints))
    assert "no_load_current" in robot_text(stated)
    assert robot_from_plain(to_plain(stated)) == stated
    assert robot_from_plain(to_plain(robot)) == robot
