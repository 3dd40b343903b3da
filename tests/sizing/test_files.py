"""The reader of motor and drive files refuses figures that contradict each other.

It also reads ratings and friction ranges, and plan.json preserves them.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.loading.load import load_drive, load_motor
from ssm_planner.problem.drive import Ratings
from ssm_planner.problem.robot import Robot
from ssm_planner.problem.serialization import robot_from_plain, to_plain
from tests.support.paths import PROBLEMS
from tests.support.sizing_cases import equipped

SHIPPED = PROBLEMS
MOTOR = SHIPPED / "motors/maxon_ec_max_22_25w.yaml"
SCREW = SHIPPED / "drives/vitreoretinal_joint4_screw.yaml"
WORM = SHIPPED / "drives/vitreoretinal_joint1_worm.yaml"
RATINGS = """
ratings:
  source: a test
  continuous_output: 20 N
  peak_output: 60 N
  input_speed: 3000 rpm
  duty: 0.5
  free_length: 60 mm
  root_diameter: 2.4 mm
  ends: fixed-supported
friction_ranges:
  source: lubricant between 10 and 40 degC
  mu: [0.14, 0.2]
  b_v: [4e-6 N*m*s/rad, 9e-6 N*m*s/rad]
"""


def written(path: Path, folder: Path, *edits: tuple[str, str], append: str = "") -> Path:
    text = path.read_text(encoding="utf-8")
    for old, new in edits:
        assert old in text
        text = text.replace(old, new, 1)
    copy = folder / path.name
    copy.write_text(text + append, encoding="utf-8")
    return copy


@pytest.mark.parametrize(
    ("edits", "key", "reason"),
    [
        (
            [("rotor_inertia: 4.45 g*cm^2", "rotor_inertia: 4.45 kg*m^2")],
            "rotor_inertia",
            "implausible",
        ),
        (
            [("terminal_resistance: 0.955 ohm", "terminal_resistance: 955 ohm")],
            "terminal_resistance",
            "% of the rise",
        ),
        (
            [("max_winding_temperature: 155 degC", "max_winding_temperature: 155 K")],
            "max_winding_temperature",
            "check the unit (degC)",
        ),
        (
            [("time_constant_winding: 1.99 s", "time_constant_winding: 1990 s")],
            "time_constant_winding",
            "exchanged",
        ),
        ([("nominal_current: 2.71 A", "nominal_current: 27.1 A")], "nominal_torque", "contradicts"),
        (
            [("speed_constant: 1050 rpm/V", "speed_constant: 105 rpm/V")],
            "speed_constant",
            "contradicts",
        ),
        (
            [("nominal_torque: 23 mN*m", "nominal_torque: 23 N*m")],
            "nominal_torque",
            "check the unit (mN*m)",
        ),
        (
            [("nominal_torque: 23 mN*m", "nominal_torque: -23 mN*m")],
            "nominal_torque",
            "not greater than zero",
        ),
        (
            [("terminal_resistance: 0.955 ohm", "terminal_resistance: 0 ohm")],
            "terminal_resistance",
            "not greater",
        ),
        (
            [("max_speed:", "torque_constant_per_kelvin: 0.0011\nmax_speed:")],
            "torque_constant_per_kelvin",
            "weaken",
        ),
        (
            # The torques are far too large, and without the nominal current only the power reveals
            # this.
            [
                ("nominal_torque: 23 mN*m", "nominal_torque: 2.3 N*m"),
                ("value: 114 mN*m", "value: 4.9 N*m"),
                ("nominal_current: 2.71 A\n", ""),
            ],
            "nominal_torque",
            "W, which is implausible",
        ),
        (
            [
                ("torque_constant: 9.1 mN*m/A", "torque_constant: 9.1 N*m/A"),
                ("nominal_current: 2.71 A\n", ""),
                ("speed_constant: 1050 rpm/V\n", ""),
            ],
            "torque_constant",
            "idle at",
        ),
    ],
)
def test_slips_in_a_motor_file(
    tmp_path: Path, edits: list[tuple[str, str]], key: str, reason: str
) -> None:
    path = written(MOTOR, tmp_path, *edits)
    with pytest.raises(ProblemError) as caught:
        load_motor(path)
    message = str(caught.value)
    line = next(
        n
        for n, text in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if text.startswith(f"{key}:")
    )
    assert message.startswith(f"{path}:{line}: {key}")
    assert reason in message
    assert "allowed" in message


def test_real_motors_are_shipped_with_their_order_numbers(robot: Robot, tmp_path: Path) -> None:
    """The shipped motors state their order numbers.

    The paper does not name the winding of joint 4. The robot has the standard winding and lists the
    high-power winding as an alternative.
    """
    insertion = robot.joints[3]
    orders = {"standard": "ECXZ13M1VF40N1IL1D561A", "high-power": "ECXZ13M2KN48N1IL1D497A"}
    for motor, (winding, order) in zip(
        (insertion.motor, *insertion.alternatives), orders.items(), strict=True
    ):
        assert winding in motor.name
        assert motor.placeholders == ("encoder_counts",)
        assert all(
            order in motor.sources[name]
            for name in ("nominal_torque", "rotor_inertia", "stall_torque", "mass")
        )
        assert "no rating" in motor.sources["max_torque"]
    rig = load_motor(SHIPPED / "motors/rig_motor.yaml")
    assert (rig.encoder_counts, rig.mass, rig.placeholders) == (1024, pytest.approx(0.072), ())
    assert "inferred" in rig.sources["rotor_inertia"]
    path = written(
        Path(insertion.motor.file), tmp_path, ("stall_torque: 28.4 mN*m", "stall_torque: 83.9 mN*m")
    )
    with pytest.raises(ProblemError, match=r"stall_torque.*contradicts .* 28.44 mN\*m"):
        load_motor(path)
    again = robot_from_plain(json.loads(json.dumps(to_plain(robot))))
    assert again.joints[3].alternatives == insertion.alternatives


def test_the_complete_motor_file() -> None:
    motor = load_motor(MOTOR)
    assert motor.placeholders == ()
    assert motor.max_winding_temperature == pytest.approx(428.15)
    assert motor.rotor_inertia == pytest.approx(4.45e-7)


def test_ratings_and_ranges_are_read(tmp_path: Path) -> None:
    drive = load_drive(written(SCREW, tmp_path, append=RATINGS))
    assert drive.ratings.free_length == pytest.approx(0.06)
    assert drive.ratings.ends == "fixed-supported"
    assert drive.ratings.input_speed == pytest.approx(314.159, rel=1e-5)
    assert drive.friction_ranges == {"mu": (0.14, 0.2), "b_v": (4e-6, 9e-6)}
    assert drive.sources["free_length"] == "a test"
    assert "lubricant" in drive.sources["friction_ranges"]
    assert load_drive(SCREW).ratings is None
    assert load_drive(SCREW).friction_ranges == {}


@pytest.mark.parametrize(
    ("edit", "key", "reason"),
    [
        (
            ("peak_output: 60 N", "peak_output: 6 N"),
            "ratings.peak_output",
            "smaller than continuous_output",
        ),
        (
            ("peak_output: 60 N", "peak_output: 60 N*m"),
            "ratings.peak_output",
            "a torque, not a force",
        ),
        (("duty: 0.5", "duty: 50"), "ratings.duty", "at most 1"),
        (
            ("root_diameter: 2.4 mm", "root_diameter: 240 mm"),
            "ratings.root_diameter",
            "the diameter exceeds the length",
        ),
        (
            ("free_length: 60 mm", "free_length: 0 mm"),
            "ratings.free_length",
            "not greater than zero",
        ),
        (("ends: fixed-supported", "ends: welded"), "ratings.ends", "unknown value"),
        (
            ("mu: [0.14, 0.2]", "mu: [0.18, 0.2]"),
            "friction_ranges.mu",
            "does not contain the value",
        ),
        (("mu: [0.14, 0.2]", "mu: [0.1, 0.2]"), "friction_ranges.mu", "is not self-locking"),
        (("mu: [0.14, 0.2]", "mu: 0.2"), "friction_ranges.mu", ""),
        (
            ("b_v: [4e-6 N*m*s/rad,", "b_v: [-4e-6 N*m*s/rad,"),
            "friction_ranges.b_v",
            "cannot be negative",
        ),
        (("  source: lubricant between 10 and 40 degC\n", ""), "friction_ranges.source", "missing"),
        (("  b_v: [4e", "  b_vv: [4e"), "friction_ranges.b_vv", "did you mean 'b_v'"),
    ],
)
def test_slips_in_ratings_and_ranges(
    tmp_path: Path, edit: tuple[str, str], key: str, reason: str
) -> None:
    path = written(SCREW, tmp_path, append=RATINGS.replace(*edit))
    with pytest.raises(ProblemError) as caught:
        load_drive(path)
    message = str(caught.value)
    assert message.startswith(f"{path}:")
    assert key in message
    assert reason in message


def test_a_worm_has_no_ends(tmp_path: Path) -> None:
    with pytest.raises(ProblemError, match=r"ratings\.ends"):
        load_drive(written(WORM, tmp_path, append="\nratings: {ends: fixed-free}\n"))


def test_ratings_and_ranges_survive_plan_json(robot: Robot) -> None:
    full = equipped(robot)
    drive = replace(full.joints[0].drive, friction_ranges={"mu": (0.1, 0.2)})
    full = replace(full, joints=(replace(full.joints[0], drive=drive), *full.joints[1:]))
    again = robot_from_plain(json.loads(json.dumps(to_plain(full))))
    assert isinstance(again.joints[0].drive.ratings, Ratings)
    assert again.joints[0].drive.friction_ranges["mu"] == (0.1, 0.2)
    assert to_plain(again) == to_plain(full)
    older = to_plain(full)
    for joint in older["joints"]:
        if joint["drive"]:
            del joint["drive"]["ratings"], joint["drive"]["friction_ranges"]
    assert robot_from_plain(older).joints[0].drive.ratings is None
