"""Gear stages between motor and drive obey the torque law and never create power.

The C code receives equivalent figures.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from examples import prove
from ssm_planner import load_drive, load_problem, load_robot, plan, rpm
from ssm_planner.dynamics import transmission as tr
from ssm_planner.elements.compiled import _drive_values
from ssm_planner.errors import ProblemError
from ssm_planner.problem import Gearhead
from ssm_planner.problem.drive import Drive, Friction
from tests.dynamics.test_transmission import screw, worm

shares = st.floats(0.2, 1.0)
stages = st.builds(
    Gearhead,
    st.just("stage"),
    st.floats(0.3, 50.0),
    shares,
    shares,
)
efforts = st.floats(-0.5, 0.5)
mus = st.floats(0.0, 0.5)
signs = st.sampled_from([-1.0, 1.0])


def staged(drive: Drive, *parts: Gearhead) -> Drive:
    """Return the drive with stages before it.

    All figures of the drive except its ratio must already refer to the motor shaft.
    """
    ratio = drive.ratio * math.prod(stage.ratio for stage in parts)
    names = ("gearhead", "belt")[: len(parts)]
    return replace(drive, ratio=ratio, **dict(zip(names, parts, strict=True)))


@given(effort=efforts, sign=signs, mu=mus)
def test_a_stage_without_ratio_and_losses_changes_nothing(effort, sign, mu):
    for drive in (worm(), screw("antibacklash_screw")):
        same = staged(drive, Gearhead("none", 1.0, 1.0))
        values = [
            tr.motor_torque(x, effort, 3.0 * sign, 20.0, mu=mu, direction=sign)
            for x in (drive, same)
        ]
        assert values[0] == values[1]


@given(first=stages, second=stages, effort=efforts, sign=signs, mu=mus)
def test_the_law_is_that_of_each_stage_in_turn(first, second, effort, sign, mu):
    drive = worm()
    w, wd = 7.0 * sign, -30.0
    phi = math.atan(mu / math.cos(drive.pressure_angle))
    torque = drive.gamma * math.tan(drive.lead_angle + math.copysign(phi, effort * sign)) * effort
    for stage in (second, first):
        loss = 1 / stage.efficiency if torque * sign > 0 else stage.backward_efficiency
        torque *= loss / stage.ratio
    expected = torque + drive.input_inertia * wd + drive.friction.b_c * sign
    expected += drive.friction.b_v * w
    actual = tr.motor_torque(staged(drive, first, second), effort, w, wd, mu=mu)
    assert actual == pytest.approx(expected, rel=1e-12, abs=1e-18)


@given(stage=stages, effort=efforts, sign=signs, mu=mus)
def test_a_stage_never_creates_power(stage, effort, sign, mu):
    drive = staged(screw(), stage)
    free = replace(drive, friction=replace(drive.friction, b_c=0.0, b_v=0.0))
    w = 5.0 * sign
    power = tr.motor_torque(free, effort, w, 0.0, mu=mu) * w
    assert power >= effort * w / drive.ratio - 1e-15


@given(stage=stages, sign=signs, effort=efforts, mu=st.floats(0.0, 0.3))
def test_the_c_code_gets_a_thread_with_the_same_slopes(stage, sign, effort, mu):
    friction = Friction(mu=mu, mu_static=mu, b_c=0.0, b_v=0.0)
    drive = staged(worm(friction=friction, self_locking=False), stage)
    _, gamma, lead, wedging, *_ = values = _drive_values(drive)
    tangent = values[8] * wedging
    slopes = (
        gamma * (lead + tangent) / (1 - lead * tangent),
        gamma * (lead - tangent) / (1 + lead * tangent),
    )
    assert slopes == pytest.approx(tr.mesh_coefficients(drive, mu), rel=1e-9, abs=1e-12)


def test_a_thread_that_may_unlock_at_speed_needs_constant_friction():
    friction = Friction(
        mu=0.01,
        mu_static=0.3,
        b_c=0.0,
        b_v=0.0,
        law="stribeck_gaussian",
        mu_stribeck=0.2,
        stribeck_speed=1.0,
    )
    drive = staged(worm(friction=friction, self_locking=False), Gearhead("g", 4.0, 0.8))
    with pytest.raises(ProblemError, match="constant friction"):
        _drive_values(drive)


FILE = """
name: worm with stages
kind: worm
geometry: {ratio: 40, worm_diameter: 6 mm, lead: 0.9424778 mm, thread_angle: 40 deg}
input_inertia: 6.5e-7 kg*m^2
output_inertia: 0 kg*m^2
friction: {mu: 0.13, mu_static: 0.15, b_c: 0.3 mN*m, b_v: 1e-7 N*m*s/rad}
gearhead:
  name: planetary
  ratio: 4
  efficiency: 0.8
  backlash: 1 deg
  placeholder: true
  ratings: {continuous_output: 200 mN*m, input_speed: 8000 rpm}
belt: {name: belt, ratio: 2, efficiency: 0.95, backlash: 0.5 deg}
"""


def test_a_file_states_the_stages(tmp_path):
    (tmp_path / "worm.yaml").write_text(FILE, encoding="utf-8")
    drive = load_drive(tmp_path / "worm.yaml")
    assert drive.ratio == pytest.approx(320)
    assert list(drive.stages) == ["gearhead", "belt"]
    assert drive.placeholders == ("gearhead",)
    assert drive.gearhead.ratings.input_speed == pytest.approx(8000 * rpm)
    assert drive.gearhead.backwards == pytest.approx(0.2)
    degree = math.pi / 180
    # A placeholder does not count as a known backlash. The belt turns the worm, which reduces 40
    # times.
    joint = replace(load_robot("vitreoretinal").joints[0], drive=drive, motor=None)
    plays = joint.plays()
    assert plays.pop("gearhead backlash") is None
    assert plays == {"belt backlash": pytest.approx(0.5 * degree / 40)}


@pytest.mark.parametrize(
    ("key", "value"), [("ratio", "-4"), ("efficiency", "1.1"), ("mass", "80 kg"), ("ratoi", "4")]
)
def test_a_faulty_stage_is_refused_by_its_key(tmp_path, key, value):
    stated = {"ratio": "ratio: 4\n", "efficiency": "efficiency: 0.8\n"}
    line = stated.get(key, "backlash: 1 deg\n")
    text = FILE.replace(line, f"{key}: {value}\n", 1)
    (tmp_path / "worm.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(ProblemError, match=key):
        load_drive(tmp_path / "worm.yaml")


def test_a_plan_with_a_gearhead_is_proven_by_the_separate_checker(tmp_path):
    problem = load_problem("problems/tilt_insert.yaml")
    joints = list(problem.robot.joints)
    own = joints[0].drive
    friction = replace(own.friction, b_c=own.friction.b_c / 4, b_v=own.friction.b_v / 16)
    joints[0] = replace(
        joints[0], drive=staged(replace(own, friction=friction), Gearhead("g", 4.0, 0.8))
    )
    robot = replace(problem.robot, joints=tuple(joints))
    result = plan(replace(problem, robot=robot))
    assert result.certificate.passed
    file = result.write(tmp_path / "plan.json")
    claims = prove.prove(json.loads(file.read_text(encoding="utf-8")))
    assert {claim.verdict for claim in claims} == {"PROVEN"}
    (torque,) = (x for x in claims if (x.name, x.joint) == ("motor torque", "roll"))
    largest = max(abs(torque.low), abs(torque.high))
    assert largest == pytest.approx(result.requirements[0].peak_torque, rel=1e-6)
