"""The set-up of EPOS4 drives follows from the robot. The expected axes, windows, objects and PDO
mappings are calculated by hand.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ssm_planner.errors import ExportError
from ssm_planner.formats import epos4_setup as module
from ssm_planner.formats.epos4 import period_ms
from ssm_planner.formats.epos4_setup import (
    INT16_MAX,
    check_integer_range,
    drive_axes,
    encoder_notes,
    following_error_window,
    homing_objects,
    pdo_mapping,
    rounding_bounds,
    setup_objects,
    sync_setup,
)
from ssm_planner.problem.robot import Robot


def test_increments_follow_from_drive_encoder_and_direction(robot: Robot) -> None:
    joint = robot.joints[0]
    assert joint.drive is not None
    assert joint.motor is not None
    turned = replace(joint, motor_direction=-1)
    axes = drive_axes(replace(robot, joints=(turned, *robot.joints[1:])), 4096)
    assert list(axes) == ["roll", "tilt", "insertion"]
    axis = axes["roll"]
    expected = -joint.drive.ratio * 4096 / (2 * math.pi)
    assert axis.increments_per_unit == pytest.approx(expected)
    assert axis.direction == -1
    assert axis.rated_torque == joint.motor.nominal_torque
    q = np.array([0.0, 0.1, -0.2])
    assert np.array_equal(axis.increments(q), np.round(q * expected))
    assert not np.signbit(axis.increments(np.array([1e-12]))).any()
    assert axis.to_dict()["increments_per_motor_turn"] == 4096
    window = following_error_window(axis, 2)
    assert window == math.ceil(joint.velocity * 10 * 2e-3 * abs(expected))
    still = replace(axis, increments_per_unit=1e-6)
    assert following_error_window(still, 1) == 2
    assert homing_objects(axis, -12.0)["home_position"]["value"] == -12


def test_counts_come_from_the_option_the_motor_or_are_missing(robot: Robot) -> None:
    joints = [
        joint
        if joint.motor is None
        else replace(joint, motor=replace(joint.motor, encoder_counts=k))
        for joint, k in zip(robot.joints, (500, None, None, 1000), strict=True)
    ]
    assert joints[3].motor is not None
    guessed = replace(joints[3].motor, placeholders=("encoder_counts",))
    joints[3] = replace(joints[3], motor=guessed)
    assert joints[0].motor is not None
    joints[0] = replace(joints[0], motor=replace(joints[0].motor, placeholders=()))
    robot = replace(robot, joints=tuple(joints))
    axes = drive_axes(robot, {"tilt": 777})
    assert [axis.counts_per_turn for axis in axes.values()] == [2000, 777, 4000]
    assert axes["tilt"].encoder == "given with the export"
    assert axes["insertion"].encoder.startswith("PLACEHOLDER: ")
    assert not axes["roll"].encoder.startswith("PLACEHOLDER: ")
    notes = encoder_notes(axes)
    assert any("insertion" in note for note in notes)
    assert not any("roll" in note for note in notes)
    assert drive_axes(robot, 64)["roll"].counts_per_turn == 64
    assert drive_axes(robot, 1)["roll"].counts_per_turn == 1
    with pytest.raises(ExportError, match="encoder_counts is missing for the motor of joint tilt"):
        drive_axes(robot, None)
    with pytest.raises(ExportError, match="--counts-per-turn 0"):
        drive_axes(robot, 0)


def test_numbers_fit_up_to_the_largest_either_way() -> None:
    values = np.array([-0.0, INT16_MAX, -INT16_MAX])
    result = check_integer_range(values, INT16_MAX, "roll", "torque", "per mille")
    assert np.array_equal(result, values)
    for bad in (INT16_MAX + 1.0, -INT16_MAX - 1.0, np.nan, np.inf):
        with pytest.raises(ExportError, match="joint roll: torque of"):
            check_integer_range(np.array([0.0, bad]), INT16_MAX, "roll", "torque", "per mille")


def test_rounding_moves_positions_speeds_and_accelerations(robot: Robot) -> None:
    """Rounding errors of random positions keep within the bounds, and the largest errors exceed 0.9
    times the bounds.
    """
    rng = np.random.default_rng(0)
    axis = drive_axes(robot, 4096)["roll"]
    bounds = rounding_bounds(axis, 2)
    q = rng.uniform(-1.0, 1.0, (3000, 3))
    error = axis.increments(q) / axis.increments_per_unit - q
    for order, bound in enumerate(bounds.values()):
        largest = np.abs(np.diff(error, order, axis=1)).max() / 2e-3**order
        assert 0.9 * bound <= largest <= bound * (1 + 1e-9)


@pytest.mark.parametrize(("rate", "period"), [(1000.0, 1), (10.0, 100), (125.0, 8), (40.0, 25)])
def test_periods_are_whole_milliseconds(rate: float, period: int) -> None:
    assert period_ms(rate) == period
    for bad in (2 * 1000.0, 1000 / 101, 300.0, 0.0, -5.0, math.nan, math.inf):
        with pytest.raises(ExportError):
            period_ms(bad)


@pytest.mark.parametrize("mode", ["csp", "csv", "cst"])
def test_objects_of_each_pdo_fill_at_most_eight_bytes(mode: str) -> None:
    mapping = pdo_mapping(mode)
    for way, base, mapped, cob in (
        ("receive", 0x1400, 0x1600, 0x200),
        ("transmit", 0x1800, 0x1A00, 0x180),
    ):
        for k, pdo in enumerate(mapping[way]):
            assert pdo["communication"] == f"0x{base + k:04X}"
            assert pdo["mapping"] == f"0x{mapped + k:04X}"
            assert pdo["cob_id"] == f"0x{cob + 0x100 * k:03X} + node ID"
            assert sum(entry["bits"] for entry in pdo["objects"]) <= 64
            for entry in pdo["objects"]:
                assert (
                    entry["value"]
                    == f"0x{entry['object'][2:6]}{entry['object'][7:]}{entry['bits']:02X}"
                )
                assert entry["bits"] in (8, 16, 32)
    first = mapping["receive"][0]["transmission_type"]
    assert first == mapping["transmit"][0]["transmission_type"]
    assert all(pdo["transmission_type"] != first for pdo in mapping["receive"][1:])
    assert sync_setup(4)["period_ms"] == 4


def test_setup_objects_are_the_limits_of_the_joint_in_the_units_of_the_drive(robot: Robot) -> None:
    joint = robot.joints[3]
    assert joint.motor is not None
    motor = replace(joint.motor, torque_constant=0.02, max_torque=0.05, max_speed=100.0)
    for direction in (1, -1):
        turned = replace(joint, motor_direction=direction, motor=motor)
        axis = drive_axes(replace(robot, joints=(*robot.joints[:3], turned)), 4096)["insertion"]
        rows = {row["object"]: row for row in setup_objects(axis, "csp", 4)}
        values = {key: int(row["value"], 0) for key, row in rows.items()}
        per_metre = 60 * abs(axis.increments_per_unit) / 4096  # rpm of the motor
        low, high = sorted(axis.increments_per_unit * end for end in joint.position)
        assert values["0x6060:00"] == 8
        assert (values["0x60C2:01"], values["0x60C2:02"]) == (4, -3)
        assert values["0x6076:00"] == round(motor.nominal_torque * 1e6)
        assert low - 1 < values["0x607D:01"] <= low + 1e-6
        assert high - 1e-6 <= values["0x607D:02"] < high + 1
        assert values["0x6065:00"] == following_error_window(axis, 4)
        allowed = joint.velocity + rounding_bounds(axis, 4)["speed"]
        speed = 1000 * allowed * per_metre
        assert 0 <= values["0x607F:00"] - speed < 1
        assert values["0x6080:00"] == math.ceil(100.0 * 30 / math.pi)
        assert 0 <= values["0x60C5:00"] - joint.acceleration * per_metre < 1
        assert values["0x3001:02"] == 2500  # mA
        assert rows["0x60A9:00"]["value"] == "0xFDB44700"
        assert {row["joint"] for row in rows.values()} == {"insertion"}
        assert [key for key, row in rows.items() if row["known"] != "quoted"] == ["0x6080:00"]
        unknown = replace(turned, motor=replace(motor, torque_constant=None))
        other = drive_axes(replace(robot, joints=(*robot.joints[:3], unknown)), 4096)["insertion"]
        rest = setup_objects(other, "csv", 4)
        assert {row["object"] for row in rest} == set(rows) - {"0x3001:02"}
    fast = replace(axis, joint=replace(turned, acceleration=1e12))
    with pytest.raises(ExportError, match=r"joint insertion: .* \(0x60C5:00\) = \d+ does not fit"):
        setup_objects(fast, "csp", 4)
    without = replace(robot, joints=(replace(robot.joints[0], motor=None), *robot.joints[1:]))
    with pytest.raises(ExportError, match=r"joints\.roll\.motor is missing"):
        drive_axes(without, 4096)
    bare = tuple(replace(item, drive=None) for item in robot.joints)
    with pytest.raises(ExportError, match="no joint of robot"):
        drive_axes(replace(robot, joints=bare), 4096)


def test_values_fit_their_objects_up_to_the_largest(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    axis = drive_axes(robot, 4096)["insertion"]
    rows = {row["object"]: int(row["value"], 0) for row in setup_objects(axis, "csp", 4)}
    for key in ("0x60C2:02", "0x6065:00", "0x607D:01"):
        largest = abs(rows[key])
        for reduced, fits in ((0, True), (1, False)):
            table = tuple(
                (k, name, unit, str(largest - reduced) if k == key else most, reason)
                for k, name, unit, most, reason in module.SETUP_OBJECTS
            )
            monkeypatch.setattr(module, "SETUP_OBJECTS", table)
            if fits:
                assert len(setup_objects(axis, "csp", 4)) == len(rows)
                continue
            message = rf"= {rows[key]} does not fit \(allowed: up to {largest - 1}\)"
            with pytest.raises(ExportError, match=message):
                setup_objects(axis, "csp", 4)
        monkeypatch.undo()


def test_the_current_limit_of_the_drive_is_not_above_that_of_the_motor(robot: Robot) -> None:
    """The current limit is rounded down, because it protects the motor."""
    joint = robot.joints[3]
    assert joint.motor is not None
    for constant in (0.03, 0.007, 0.0123):
        motor = replace(joint.motor, torque_constant=constant)
        changed = replace(robot, joints=(*robot.joints[:3], replace(joint, motor=motor)))
        rows = setup_objects(drive_axes(changed, 4096)["insertion"], "csp", 1)
        (value,) = (int(row["value"]) for row in rows if row["object"] == "0x3001:02")
        assert value <= 1000 * motor.max_torque / constant < value + 1
