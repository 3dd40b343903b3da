"""Only possible scenarios are accepted. The verdict on results that are written by hand names every
reason of a failure with its joint and time.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.formats.epos4_setup import drive_axes
from ssm_planner.problem.controller import Controller, JointCompliance
from ssm_planner.problem.robot import Robot
from ssm_planner.simulation import simulate as module
from ssm_planner.simulation.draws import Draws
from ssm_planner.simulation.playback import Commands, commands_from_setpoints, robot_compliance
from ssm_planner.simulation.recorder import _period_means, write_recordings
from ssm_planner.simulation.simulate import (
    ASSUMED_ENCODER_COUNTS,
    EVERYWHERE,
    MotorUse,
    PowerLosses,
    Scenario,
    SimulationResult,
    Tracking,
    select_periods,
)
from ssm_planner.units import rpm

DURATION = 2.0


@pytest.mark.parametrize(
    ("key", "good", "bad"),
    [
        ("speed", [1e-3, 0.5, 1.0], [0.0, -0.5, 1.001]),
        ("draws", [0, 1, 100_000], [-1, 100_001]),
        ("spread", [None, 0.0, 0.3, 0.999], [-0.001, 1.0, 1.2]),
        ("compliance", [1e-3, 2.0], [0.0, -1.0]),
        ("instants", [1, 1000], [0, 1.5]),
        ("supply", [None, 24.0], [0.0, -24.0]),
        ("payload", [0.0, 0.1], [-0.1]),
        ("travel", [None, 0.0], [-1e-6]),
        ("tip_error", [0.0], [-1e-6]),
        ("friction", [0.01, 1.0, 10.0], [0.0, -1.0, 10.01]),
        ("power_loss", [None, 0.0, 1.0, DURATION, EVERYWHERE], [-0.01, DURATION + 0.01]),
        ("dropped", [None, 0.0, DURATION], [-0.01, DURATION + 0.01]),
        ("payload_time", [0.0, DURATION], [-0.01, DURATION + 0.01]),
        ("stall", [None, ("roll", 0.0), ("tilt", DURATION)], [("roll", -0.1), ("roll", 2.1)]),
        ("stall", [("insertion", 1.0)], [("spin", 1.0), ("elbow", 1.0)]),
        ("wrong_direction", [None, "roll", "insertion"], ["spin", "elbow"]),
    ],
)
def test_only_possible_values_of_a_scenario_are_accepted(
    robot: Robot, key: str, good: list[Any], bad: list[Any]
) -> None:
    for value in good:
        Scenario(**{key: value}).check(robot, DURATION)
    for value in [*bad, "x", math.nan, []]:
        with pytest.raises(ProblemError) as caught:
            Scenario(**{key: value}).check(robot, DURATION)
        assert str(caught.value.key).removeprefix("Scenario.").partition("[")[0] == key


def test_a_payload_taken_up_late_goes_with_no_draws(robot: Robot) -> None:
    """A payload that is picked up during the motion cannot be combined with draws."""
    with pytest.raises(ProblemError, match="not possible with draws"):
        Scenario(draws=5, payload=0.1, payload_time=1.0).check(robot, DURATION)
    for fine in (
        Scenario(draws=5, payload=0.1),
        Scenario(payload=0.1, payload_time=1.0),
        Scenario(draws=5, payload_time=1.0),
    ):
        fine.check(robot, DURATION)


def test_an_instant_given_as_a_whole_number_is_one() -> None:
    """An integer instant is converted to a float."""
    assert isinstance(Scenario(power_loss=1).power_loss, float)
    assert Scenario(power_loss=EVERYWHERE).power_loss == EVERYWHERE
    assert Scenario().power_loss is None


MOTOR = MotorUse("tilt", 0.02, 0.05, False, False, 3.0, 50, False)


def result(robot: Robot, **changes: Any) -> SimulationResult:
    """Return a result with eight instants. The drives lose their power before the last two."""
    n = 8
    zero = np.zeros((n, 4))
    tip = np.array([0.0, 1.0, 5.0, 2.0, 1.0, 0.0, 80.0, 90.0]) * 1e-6
    losses = PowerLosses(np.array([0.5, 1.0, 1.5]), np.array([1e-4, 3e-4, 2e-4]), np.full(3, 0.1))
    output = SimulationResult(
        time=0.1 * np.arange(n),
        planned=zero,
        q=zero,
        qd=zero,
        motor_angle=zero,
        w=zero,
        torque=zero,
        tip=tip,
        following=zero,
        powered=np.array([True] * 6 + [False] * 2),
        tracking=(Tracking("roll", 1e-5, 5e-6),),
        motors=(MOTOR,),
        losses=losses,
        scenario=Scenario(),
        reasons=(),
        axes=drive_axes(robot, 4096),
    )
    return replace(output, **changes)


def reasons(robot: Robot, **changes: Any) -> list[str]:
    return module._failure_reasons(result(robot, **changes))


def test_a_result_states_its_largest_values(robot: Robot) -> None:
    output = result(robot)
    assert output.passed
    assert not replace(output, reasons=("x",)).passed
    assert output.tip_error == pytest.approx(5e-6)  # the largest error while the drives have power
    assert output.travel == 3e-4
    assert output.losses.worst == 1
    assert output.holds
    stated = json.loads(json.dumps(output.to_dict(), allow_nan=False))
    assert stated["tip_error"] == pytest.approx(5e-6)
    assert stated["power_loss"] == {
        "instants": 3,
        "worst_time": 1.0,
        "longest": 0.1,
        "not_held": 0,
    }
    assert stated["draws"] is None
    assert stated["tracking"] == [{"joint": "roll", "worst": 1e-5, "rms": 5e-6}]
    falls = replace(output.losses, standing=np.array([0.1, np.inf, np.inf]))
    stated = replace(output, losses=falls).to_dict()["power_loss"]
    assert (stated["longest"], stated["not_held"]) == (None, 2)
    dark = replace(output, powered=np.zeros(8, dtype=bool))
    assert dark.tip_error == 0.0


def test_nothing_wrong_gives_no_reason(robot: Robot) -> None:
    assert reasons(robot) == []
    assert reasons(robot, scenario=Scenario(travel=3e-4, tip_error=5.1e-6)) == []


def test_every_reason_names_its_joint_and_time(robot: Robot) -> None:
    diverged = np.full((8, 4), np.nan)
    assert reasons(robot, q=diverged) == [
        "the simulated motion diverged: the controller gains make the plant unstable"
    ]
    partly = np.zeros((8, 4))
    partly[7, 3] = np.inf
    assert reasons(robot, q=partly) == reasons(robot, q=diverged)
    following = np.zeros((8, 4))
    increment = 2 * np.pi / 4096
    following[3:, 1] = -49.9 * increment
    following[5:, 1] = -50.1 * increment
    (text,) = reasons(robot, motors=(replace(MOTOR, tripped=True),), following=following)
    assert text.startswith("joint tilt: the following error left its window of 50 increments")
    assert "at 0.5000 s" in text
    (text,) = reasons(robot, motors=(replace(MOTOR, saturated=True),))
    assert "(peak torque 20 mN·m, largest 50 mN·m)" in text
    (text,) = reasons(robot, scenario=Scenario(tip_error=4e-6))
    assert text == "the tip was 0.005 mm away from the plan at 0.2000 s (allowed: 0.004 mm)"
    (text,) = reasons(robot, scenario=Scenario(travel=2.9e-4))
    assert text == "without power at 1.0000 s the tip travels 0.3 mm (allowed: 0.29 mm)"
    falls = PowerLosses(np.array([0.5, 1.5]), np.zeros(2), np.array([0.1, np.inf]))
    (text,) = reasons(robot, losses=falls)
    assert text == "without power at 1.5000 s the arm does not stand within 1 s"


def draws(**changes: Any) -> Draws:
    no = np.zeros((4, 4), dtype=bool)
    output = Draws(
        np.zeros((4, 28)),
        np.array([1.0, 2.0, 3.0, 4.0]) * 1e-5,
        np.outer([1.0, 2.0, 3.0, 4.0], [1.0, 2.0, 0.0, 4.0]),
        np.zeros((4, 4)),
        saturated=no,
        tripped=no,
        tip_limit=1e-4,
    )
    return replace(output, **changes)


def test_draws_pass_within_the_limit_and_without_trips(robot: Robot) -> None:
    one = np.zeros((4, 4), dtype=bool)
    one[2, 1] = True
    assert draws().passed.all()
    assert draws(tip_limit=2e-5).passed.tolist() == [True, True, False, False]
    for key in ("saturated", "tripped"):
        output = draws(**{key: one})
        assert output.passed.tolist() == [True, True, False, True]
        assert output.to_dict()[key] == 1
        (text,) = reasons(robot, draws=output)
        assert text.startswith("with 1 of 4 drawn frictions")
    assert reasons(robot, draws=draws()) == []
    stated = draws().to_dict()
    assert (stated["count"], stated["passed"]) == (4, 4)
    assert stated["tip_error"] == pytest.approx([1.075e-5, 2.5e-5, 3.925e-5])
    assert [middle for _, middle, _ in stated["peak_torque"]] == [2.5, 5.0, 0.0, 10.0]
    assert result(robot, draws=draws()).to_dict()["draws"] == stated


def test_increments_come_from_the_motor_then_the_controller(robot: Robot) -> None:
    joints = list(robot.joints)
    assert joints[0].motor is not None
    assert joints[1].motor is not None
    joints[0] = replace(joints[0], motor=replace(joints[0].motor, encoder_counts=500))
    joints[1] = replace(joints[1], motor=replace(joints[1].motor, encoder_counts=None))
    robot = replace(robot, joints=tuple(joints))
    counts = module._encoder_counts(robot, Controller())
    assert counts["roll"] == 2000
    assert counts["tilt"] == counts["spin"] == ASSUMED_ENCODER_COUNTS
    assert module._encoder_counts(robot, Controller(counts_per_turn=777))["tilt"] == 777


def test_set_points_reach_the_drives_between_their_periods(robot: Robot) -> None:
    """Positions between set points are interpolated. Offsets are those of the next set point."""
    axes = {name: axis for name, axis in drive_axes(robot, 4096).items() if name == "tilt"}
    axis = axes["tilt"]
    stream = {
        "target_position_inc": np.array([0.0, 10.0, 30.0]),
        "velocity_offset_mrpm": np.array([0.0, 600.0, 3000.0]),
        "torque_offset_permille": np.array([5.0, 7.0, 11.0]),
    }
    t, prescribed = np.array([0.0, 0.4, 1.0, 1.6, 2.0, 2.4]) * 1e-3, np.arange(24.0).reshape(6, 4)
    period_commands = commands_from_setpoints(
        {"tilt": stream}, axes, Controller(), (t, prescribed), 1e-3
    )
    increment = axis.direction * 2 * np.pi / axis.counts_per_turn
    assert period_commands.demand[:, 1] == pytest.approx(
        increment * np.array([0, 4, 10, 22, 30, 30.0])
    )
    speed = axis.direction * np.array([0.6, 0.6, 3.0, 3.0, 3.0, 3.0]) * rpm
    assert period_commands.speed[:, 1] == pytest.approx(speed)
    bend = axis.direction * np.array([0.6, 0.6, 2.4, 2.4, 2.4, 2.4]) * rpm / 1e-3
    assert period_commands.acceleration[:5, 1] == pytest.approx(bend[:5])
    torque = axis.direction * np.array([7, 7, 11, 11, 11, 11]) * axis.rated_torque / 1000
    assert period_commands.torque[:, 1] == pytest.approx(torque)
    assert not period_commands.demand[:, [0, 2, 3]].any()
    assert np.array_equal(period_commands.prescribed, prescribed)
    assert period_commands.power.all()
    assert not period_commands.stalled.any()
    without = Controller(torque_offset=False)
    assert not commands_from_setpoints(
        {"tilt": stream}, axes, without, (t, prescribed), 1e-3
    ).torque.any()
    table = period_commands.table()
    assert table.shape == (6, 25)
    assert np.array_equal(table[:, 16:20], prescribed)
    assert table[:, 24].all()
    assert np.array_equal(select_periods(period_commands, slice(2, 4)).table(), table[2:4])
    assert isinstance(select_periods(period_commands, np.array([0])), Commands)


def test_springs_follow_frequency_and_scale(robot: Robot) -> None:
    base = robot_compliance(robot, Controller())
    twice = robot_compliance(robot, Controller(), 2.0)
    assert twice.stiffness == pytest.approx(2 * base.stiffness)
    assert twice.damping == pytest.approx(2 * base.damping)
    assert np.array_equal(twice.backlash, base.backlash)
    part = JointCompliance(frequency=60.0, damping_ratio=0.6, backlash=0.0)
    other = robot_compliance(robot, Controller(compliance={"tilt": part}))
    assert other.stiffness / base.stiffness == pytest.approx([1.0, 4.0, 1.0, 1.0])
    assert other.damping / base.damping == pytest.approx([1.0, 4.0, 1.0, 1.0])
    assert other.backlash.tolist() == [base.backlash[0], 0.0, *base.backlash[2:]]
    unchanged = robot_compliance(robot, Controller(compliance={"tilt": JointCompliance()}))
    assert unchanged.stiffness == pytest.approx(base.stiffness)
    assert unchanged.backlash == pytest.approx(base.backlash)


def test_recordings_are_averages_in_the_controller_s_units(robot: Robot, tmp_path: Any) -> None:
    n = 41
    time = 0.25e-3 * np.arange(n)
    w = np.outer(np.arange(n), np.ones(4)) * 10.0
    angle = np.outer(np.arange(n), np.ones(4)) * 0.01
    torque = np.full((n, 4), 2e-3)
    output = result(robot, time=time, w=w, torque=torque, motor_angle=angle)
    paths = write_recordings(output, tmp_path, sampling=1e-3)
    assert set(paths) == set(output.axes)
    for name, path in paths.items():
        axis, lines = output.axes[name], path.read_text(encoding="utf-8").splitlines()
        assert lines[1:4] == [
            "Max. samples:;11",
            "Recorded samples:;11",
            "Sampling period:;1.000",
        ]
        rows = np.loadtxt(lines[6:], delimiter=";")
        assert rows[:, 0] == pytest.approx(np.arange(11.0))
        first = np.arange(0, n, 4)
        mean = np.array([w[k : k + 4, 0].mean() for k in first])
        assert rows[:, 1] == pytest.approx(np.rint(axis.direction * mean * 30 / np.pi))
        assert rows[:, 2] == pytest.approx(
            np.full(11, np.round(axis.direction * 0.2 / axis.rated_torque, 1))
        )
        turns = axis.direction * angle[first, 0] / (2 * np.pi)
        assert rows[:, 3] == pytest.approx(np.floor(turns * axis.counts_per_turn + 0.5))


def test_averages_end_with_the_values() -> None:
    """The last average uses only the values up to the end."""
    values = np.array([1.0, 3.0, 5.0, 7.0, 9.0])
    assert _period_means(values, np.array([0, 2, 4])) == pytest.approx([2.0, 6.0, 9.0])
    assert _period_means(values, np.array([1])) == pytest.approx([3.0])
