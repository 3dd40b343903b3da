"""An arm with controllers starts in equilibrium, and has half steps after a breakaway. Set points,
offsets and compliance are converted as the drives use them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ssm_planner.dynamics.robot_dynamics import motor_torque
from ssm_planner.formats.epos4_setup import drive_axes
from ssm_planner.problem.controller import Controller, JointCompliance
from ssm_planner.problem.robot import Robot
from ssm_planner.simulation import playback as module
from ssm_planner.simulation.cascade import loop_gains
from ssm_planner.simulation.plant import INTEGRAL, MOTOR, QD, REST, Q, W
from ssm_planner.simulation.playback import (
    _MAX_BREAKAWAY_PERIODS,
    _PERIODS_PER_CHUNK,
    CURRENT,
    TRIP,
    Commands,
    ControlledArm,
    robot_compliance,
)

COUNTS = 2**22
"""Counts per turn of an encoder that is so fine that its rounding is negligible."""
QA = np.array([0.3, 1.15, 0.1, -0.005])
QD_A = np.array([0.4, -0.3, 0.2, -0.004])
QDD_A = np.array([1.5, -1.0, 0.5, -0.02])
WITH_OFFSETS, WITHOUT_OFFSETS = Controller(), Controller(torque_offset=False)


def arm(robot: Robot, controller: Controller) -> ControlledArm:
    axes = drive_axes(robot, COUNTS)
    return ControlledArm(robot, controller, axes, dict.fromkeys(axes, 1.0))


@pytest.fixture(scope="module")
def arms(robot: Robot) -> dict[bool, ControlledArm]:
    return {c.torque_offset: arm(robot, c) for c in (WITH_OFFSETS, WITHOUT_OFFSETS)}


def commands(
    made: ControlledArm, qd: np.ndarray, qdd: np.ndarray, periods: int, torque: Any = None
) -> Commands:
    """Return commands with a constant acceleration qdd and, if given, torque offsets in N·m."""
    t = made.period * np.arange(periods + 0.0)[:, None]
    ratios = np.array([made.drive(k).ratio if k in made.driven else 0.0 for k in range(4)])
    one, zero = np.ones((periods, 1)), np.zeros((periods, 4))
    return Commands(
        demand=ratios * (QA + t * qd + t**2 / 2 * qdd),
        speed=ratios * (qd + t * qdd),
        acceleration=one * (ratios * qdd),
        torque=zero if torque is None else one * torque,
        prescribed=one * qdd,
        power=np.ones(periods),
        stalled=zero,
    )


@pytest.mark.parametrize("offsets", [True, False])
def test_an_arm_that_begins_in_motion_is_in_equilibrium(
    robot: Robot, arms: dict[bool, ControlledArm], offsets: bool
) -> None:
    """The first periods keep the currents, the following errors and the accelerations."""
    result = arms[offsets]
    needed = np.nan_to_num(motor_torque(robot, QA, QD_A, QDD_A))
    period_commands = commands(result, QD_A, QDD_A, 8, needed if offsets else None)
    state = result.initial_state(QA, QD_A, QDD_A, period_commands)
    constants = np.array([result.electrics[k].torque_constant for k in result.driven])
    driven = list(result.driven)
    assert state[CURRENT][driven] * constants == pytest.approx(needed[driven])
    assert (state[INTEGRAL][driven] == pytest.approx(0.0, abs=1e-12)) == offsets
    assert np.array_equal(state[QD], QD_A)
    assert not state[REST][driven].any()
    assert not state[TRIP].any()
    played = result.play(
        state, period_commands, result.encoder_offsets(QA), result.friction_parameters()
    )
    states = played.states[:, :]
    for k in driven:
        drift = np.ptp(states[:, CURRENT][:, k]) / abs(state[CURRENT][k])
        assert drift <= 0.03
        ratio = result.drive(k).ratio
        expected = ratio * (QD_A[k] + result.period * 8 * QDD_A[k])
        assert states[-1, W][k] == pytest.approx(expected, rel=2e-3)
        increment = 2 * np.pi / COUNTS
        assert abs(played.error[0, k]) <= 0.51 * increment
        lag = abs(ratio * QDD_A[k]) * result.period**2
        assert np.abs(played.error[:, k]).max() <= increment + 10 * lag


def test_only_moving_drives_have_a_current_at_the_start(
    arms: dict[bool, ControlledArm],
) -> None:
    result = arms[True]
    qd = np.array([0.0, 0.3, 0.0, 0.0])
    moving = result.initial_state(QA, qd, np.zeros(4), commands(result, qd, np.zeros(4), 1))
    still = result.initial_state(QA, np.zeros(4), np.zeros(4), commands(result, qd * 0, qd * 0, 1))
    assert np.array_equal(still[: len(still) - 16], result.state_at_rest(QA))
    assert not still[len(still) - 16 :].any()
    assert np.flatnonzero(moving[CURRENT]).tolist() == [1]
    assert moving[REST][1] == 0.0
    assert moving[REST][0] == still[REST][0] > 1e5
    assert np.array_equal(moving[MOTOR], still[MOTOR])
    # The motion changes the loads, which deflect the joints.
    deflection = moving[Q] - still[Q]
    assert deflection[2] == 0.0
    assert 0 < np.abs(deflection).max() < 1e-4


def test_a_drive_without_load_is_in_the_middle_of_its_backlash(robot: Robot) -> None:
    weightless = replace(robot, gravity=np.zeros(3))
    result = arm(weightless, WITH_OFFSETS)
    state = result.state_at_rest(QA)
    for k in result.driven:
        assert state[MOTOR][k] == pytest.approx(result.drive(k).ratio * QA[k], rel=1e-12)


def test_periods_after_a_breakaway_run_in_half_steps(arms: dict[bool, ControlledArm]) -> None:
    """A chunk of periods has half steps if a drive starts in it or shortly before it."""
    result, periods = arms[True], 6 * _PERIODS_PER_CHUNK - 7
    for first in (
        1,
        2 * _PERIODS_PER_CHUNK + 3,
        3 * _PERIODS_PER_CHUNK - 1,
        3 * _PERIODS_PER_CHUNK - _MAX_BREAKAWAY_PERIODS,
    ):
        period_commands = commands(result, np.zeros(4), np.zeros(4), periods)
        period_commands.speed[first : first + 2 * _PERIODS_PER_CHUNK, 1] = 5.0
        halved = result.half_step_periods(period_commands)
        assert halved.shape == (periods,)
        chunks = np.arange(periods) // _PERIODS_PER_CHUNK
        expected = {
            first // _PERIODS_PER_CHUNK,
            (first + _MAX_BREAKAWAY_PERIODS) // _PERIODS_PER_CHUNK,
        }
        assert set(chunks[halved].tolist()) == expected
        assert set(chunks[~halved].tolist()) == set(range(6)) - expected
    moving = commands(result, QD_A, np.zeros(4), periods)
    assert set(
        (np.flatnonzero(result.half_step_periods(moving)) // _PERIODS_PER_CHUNK).tolist()
    ) == {0}


def test_the_integrals_make_up_for_what_the_first_commands_lack(
    arms: dict[bool, ControlledArm],
) -> None:
    """Only the first commands determine the integrals, and later commands do not."""
    result, rng = arms[True], np.random.default_rng(3)
    period_commands = commands(result, QD_A, QDD_A, 3, np.zeros(4))
    for column in (period_commands.speed, period_commands.acceleration, period_commands.torque):
        column[:] = rng.normal(size=(3, 4)) * [[1.0], [5.0], [9.0]]
    state = result.initial_state(QA, QD_A, QDD_A, period_commands)
    for k in result.driven:
        electrics = result.electrics[k]
        gains = loop_gains(result.robot.joints[k], result.controller, electrics)
        forward = gains.ff_velocity * period_commands.speed[0, k]
        forward += gains.ff_acceleration * period_commands.acceleration[0, k]
        forward += period_commands.torque[0, k] / electrics.torque_constant
        assert state[CURRENT][k] == pytest.approx(state[INTEGRAL][k] + forward)


@pytest.mark.parametrize("period", [1e-3, 4e-3])
def test_offsets_hold_for_a_period_and_positions_are_interpolated(
    robot: Robot, period: float
) -> None:
    """A drive uses the offsets of the set point at the end of the period."""
    axis = replace(drive_axes(robot, 1000)["tilt"], direction=-1)
    sent = np.arange(6.0)
    stream = {
        "target_position_inc": 1000 * sent**2,
        "velocity_offset_mrpm": 60_000 * sent,
        "torque_offset_permille": 100 * sent,
    }
    steps = 4
    t = period / steps * np.arange(5 * steps + 3)
    accelerations = np.random.default_rng(1).normal(size=(len(t), 4))
    for with_offset in (True, False):
        period_commands = module.commands_from_setpoints(
            {"tilt": stream}, {"tilt": axis}, Controller(torque_offset=with_offset),
            (t, accelerations), period,
        )  # fmt: skip
        after = np.minimum(np.arange(len(t)) // steps + 1, 5)
        share = np.minimum(t / period, 5.0)
        inside = np.floor(share)
        position = inside**2 + (share - inside) * ((inside + 1) ** 2 - inside**2)
        turns = np.where(share >= 5, 25.0, position)
        assert period_commands.demand[:, 1] == pytest.approx(-2 * np.pi * turns)
        assert period_commands.speed[:, 1] == pytest.approx(-2 * np.pi * after)
        rate = np.where(after - 1 < 5, -2 * np.pi / period, 0.0)
        assert period_commands.acceleration[:, 1] == pytest.approx(rate)
        torque = -0.1 * after * axis.rated_torque
        assert period_commands.torque[:, 1] == pytest.approx(torque if with_offset else 0.0)
        assert np.array_equal(period_commands.prescribed, accelerations)
        assert period_commands.power.all()
        others = [0, 2, 3]
        for column in (
            period_commands.demand,
            period_commands.speed,
            period_commands.acceleration,
            period_commands.torque,
            period_commands.stalled,
        ):
            assert not column[:, others].any()
        table = period_commands.table()
        assert table.shape == (len(t), 25)
        assert np.array_equal(table[:, 1], period_commands.demand[:, 1])
        assert np.array_equal(table[:, 24], period_commands.power)


def test_compliance_comes_from_the_controller_or_is_assumed(robot: Robot) -> None:
    """The stiffness is proportional to the square of the frequency.

    The damping is proportional to the product of frequency and damping ratio.
    """
    plain = robot_compliance(robot, Controller())
    assert plain.backlash == pytest.approx(module.ASSUMED_BACKLASH)
    part = JointCompliance(
        frequency=2 * module.JOINT_FREQUENCIES[1], backlash=0.0, damping_ratio=0.6
    )
    stated = robot_compliance(robot, Controller(compliance={"tilt": part}))
    others = [0, 2, 3]
    assert stated.stiffness[1] == pytest.approx(4 * plain.stiffness[1])
    assert stated.damping[1] == pytest.approx(4 * plain.damping[1])
    assert stated.backlash[1] == 0.0
    for name in ("stiffness", "damping", "backlash"):
        assert getattr(stated, name)[others] == pytest.approx(getattr(plain, name)[others])
    scaled = robot_compliance(robot, Controller(), 3.0)
    assert scaled.stiffness == pytest.approx(3 * plain.stiffness)
    assert scaled.damping == pytest.approx(3 * plain.damping)
    assert scaled.backlash == pytest.approx(plain.backlash)
