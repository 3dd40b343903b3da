"""The shipped files contain the values of their sources, load without heavy libraries and fit the
published schema. The reference for the robot is the paper.
"""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from ssm_planner.loading.files import read_section
from ssm_planner.loading.load import file_keys, json_schema, load_drive, load_motor, load_robot
from tests.support.cli import python
from tests.support.paths import PROBLEMS

SHIPPED = PROBLEMS
KEYS = cache(file_keys)


@pytest.mark.parametrize("path", sorted(SHIPPED.glob("drives/*.yaml")), ids=lambda path: path.stem)
def test_drives(path: Path) -> None:
    drive = load_drive(path)
    if not drive.threaded:  # tests/dynamics/test_efficiencies.py tests them
        assert drive.sources
        return
    # Without friction, a drive transmits the whole power, so γ · tan λ · ratio = 1.
    assert drive.gamma * math.tan(drive.lead_angle) * drive.ratio == pytest.approx(1, rel=1e-12)
    assert set(drive.sources) >= {"input_inertia", "output_inertia", "thread_angle"}
    if drive.friction is not None:
        assert set(drive.sources) >= {"mu", "mu_static", "b_c", "b_v", "b_oc", "b_ov"}


@pytest.mark.parametrize("path", sorted(SHIPPED.glob("motors/*.yaml")), ids=lambda path: path.stem)
def test_motors(path: Path) -> None:
    motor = load_motor(path)
    assert all(motor.sources.values())
    assert motor.max_torque >= motor.nominal_torque > 0


def test_the_robot_is_the_published_one() -> None:
    robot = load_robot(SHIPPED / "robots/vitreoretinal.yaml")
    roll, tilt, spin, insertion = robot.joints
    for joint in (roll, tilt, spin):
        assert joint.velocity == pytest.approx(math.radians(65))
        assert joint.acceleration == pytest.approx(math.radians(200))
    assert (insertion.velocity, insertion.acceleration) == pytest.approx((0.02, 0.1))
    table2 = {  # paper, Table II
        "roll": (0.13, 0.15, 3.82e-3, 7.18e-5),
        "tilt": (0.12, 0.13, 3.54e-3, 3.69e-5),
        "insertion": (0.17, 0.17, 0.11e-3, 0.62e-5),
    }
    for joint in (roll, tilt, insertion):
        friction = joint.drive.friction
        assert (friction.mu, friction.mu_static, friction.b_c, friction.b_v) == pytest.approx(
            table2[joint.name]
        )
        assert friction.b_oc == pytest.approx(4e-3)
        assert friction.b_ov == pytest.approx(2.2e-12)
    assert spin.drive is None
    assert spin.motor is None
    assert [joint.drive.ratio for joint in (roll, tilt)] == [120, 120]
    assert math.degrees(roll.drive.lead_angle) == pytest.approx(1.432, abs=1e-3)
    assert math.degrees(insertion.drive.lead_angle) == pytest.approx(6.969, abs=1e-3)
    assert [body.mass for body in robot.bodies] == [0.72278480, 0.37375585, 0, 0.09964338]


@cache
def keys_of(path: Path) -> set[str]:
    """Return every key of a YAML file, on all levels."""
    return _keys(read_section(path).value)


@pytest.mark.slow
def test_every_key_of_the_shipped_files_is_in_the_json_schema() -> None:
    for kind, folder in (
        ("problem", "."),
        ("robot", "robots"),
        ("drive", "drives"),
        ("motor", "motors"),
    ):
        schema = json_schema(kind)
        known = _properties(schema)
        for path in (SHIPPED / folder).glob("*.yaml"):
            assert keys_of(path) <= known, path


@pytest.mark.slow
def test_every_key_of_the_shipped_files_is_listed() -> None:
    folders = {
        "problem": ".",
        "robot": "robots",
        "drive": "drives",
        "motor": "motors",
        "controller": "controllers",
    }
    free = {
        "posterior",
        "draws",
        "covariance",
        "value",
        "source",
        "placeholder",
    }  # keys of values and of identification results
    for kind, folder in folders.items():
        listed = {part.removesuffix("[]") for key in KEYS(kind) for part in key.path.split(".")}
        for path in (SHIPPED / folder).glob("*.yaml"):
            assert keys_of(path) - free <= listed, path


@pytest.mark.slow
def test_a_listed_key_has_unit_bound_default_and_meaning() -> None:
    motor, controller, robot, problem = (
        {key.path: key for key in KEYS(kind)}
        for kind in ("motor", "controller", "robot", "problem")
    )
    assert motor["nominal_torque"][1:] == ("mN*m", "above 0", "required", "Continuous torque.")
    assert motor["rotor_inertia"][1:4] == ("g*cm^2", "above 0", "")
    assert controller["loop_period"][1:4] == ("s", "above 0", "0.0004 s")
    assert controller["counts_per_turn"].allowed == "a whole number above 0"
    assert [robot[f"joints.{name}.jerk"].unit for name in ("roll", "insertion")] == [
        "deg/s^3",
        "mm/s^3",
    ]
    assert problem["motion[].scan.spacing"][1:4] == ("mm", "above 0", "0.6 mm")
    assert problem["planner"].allowed == "'optimal' or 'fast' or 'ipopt' or 'toppra'"
    assert problem["limits.tilt"].allowed == "[lower, upper]"


def test_a_problem_loads_without_the_heavy_libraries() -> None:
    code = f"""
import sys
from ssm_planner.loading.load import load_problem
heavy = {{"scipy.optimize", "matplotlib", "toppra", "casadi"}}
assert not ({{"pint"}} | heavy) & set(sys.modules)
load_problem({str(SHIPPED / "tilt_insert.yaml")!r})
assert not heavy & set(sys.modules)
"""
    done = python("-c", code)
    assert done.returncode == 0, done.stderr


def _properties(schema: Any) -> set[str]:
    result: set[str] = set()
    if isinstance(schema, dict):
        result |= set(schema.get("properties", {}))
        for value in schema.values():
            result |= _properties(value)
    elif isinstance(schema, list):
        for value in schema:
            result |= _properties(value)
    return result


def _keys(value: Any) -> set[str]:
    if isinstance(value, dict):
        return set(value).union(*(_keys(part) for part in value.values()))
    if isinstance(value, list):
        return set().union(*(_keys(part) for part in value))
    return set()
