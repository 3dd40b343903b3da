"""A simulated playback balances energy and momentum, and uses the exported set points. Impossible
scenarios are refused, harmful scenarios fail with their reason, and `compare` accepts the
recordings of a healthy run.
"""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from ssm_planner.api import compare
from ssm_planner.errors import ProblemError
from ssm_planner.formats.epos4 import sample_setpoints
from ssm_planner.formats.epos4_setup import drive_axes
from ssm_planner.formats.export import export
from ssm_planner.pipeline import run as pipeline
from ssm_planner.plans import Plan, load_plan
from ssm_planner.problem.controller import AxisController, Controller, JointCompliance
from ssm_planner.problem.motion import Straight
from ssm_planner.problem.posterior import Posterior
from ssm_planner.simulation.cascade import motor_electrics
from ssm_planner.simulation.draws import draw_frictions, play_draws
from ssm_planner.simulation.plant import FRICTION_PARAMETERS, MOTOR, QD, STATE_SIZE, Q
from ssm_planner.simulation.playback import (
    CURRENT,
    STEPS_PER_PERIOD,
    ControlledArm,
    robot_compliance,
)
from ssm_planner.simulation.recorder import write_recordings
from ssm_planner.simulation.simulate import Scenario, _Simulation, simulate
from ssm_planner.trajectory import Trajectory
from tests.support.arm_motion import arm_motion, energy_error
from tests.support.paths import RESULTS
from tests.support.velocity_control import ArmSimulation

PLAN = RESULTS / "tilt_insert" / "plan.json"
DRIVEN = ("roll", "tilt", "insertion")


@pytest.fixture(scope="module")
def plan():
    return load_plan(PLAN)


@pytest.fixture(scope="module")
def nominal(plan):
    return simulate(plan)


@pytest.fixture(scope="module")
def short(plan):
    """Return a plan of half a second in which every motor moves."""
    motion = (Straight(roll=0.04, tilt=plan.problem.start.tilt - 0.05, depth=0.003),)
    return pipeline.plan(replace(plan.problem, motion=motion))


def without_controller(loop_period=4e-4):
    """Return a controller without feedback and feed-forward, with a wide following-error window."""
    axis = AxisController(p=0, i=0, d=0, ff_velocity=0, ff_acceleration=0, following_error=10.0)
    return Controller(
        loop_period=loop_period, torque_offset=False, joints=dict.fromkeys(DRIVEN, axis)
    )


def stage_of(plan, controller, steps):
    """Return a simulation whose arm takes a number of steps in each period of the position loop."""
    stage = _Simulation(plan, Scenario(), controller)
    windows = {
        name: 2 * np.pi / axis.counts_per_turn * stage.windows[name]
        for name, axis in stage.axes.items()
    }
    springs = robot_compliance(plan.robot, controller)
    stage.arms[0.0] = ControlledArm(
        plan.robot, controller, stage.axes, windows, compliance=springs, steps=steps
    )
    return stage


def momentum_error(arm, x):
    """Return the largest error of the momentum about joint 1, relative to the sum of its impulses.

    The kinetic energy does not depend on the angle of joint 1, so dp/dt = effort − gravity. Between
    two states, the twist changes at a constant rate. The mean effort of the spring and the impulse
    of the damper, damping · Δstretch, therefore have closed forms.
    """
    h, q, qd = arm.period, x[:, Q], x[:, QD]
    p = np.einsum("nij,nj->ni", arm.body.mass_matrix(q), qd)[:, 0]
    twist = x[:, MOTOR][:, 0] / arm.drive(0).ratio - q[:, 0]
    way, stretch = np.diff(twist), arm.compliance.deflection(0, twist)
    share = np.where(way == 0, stretch[1:] != 0, np.diff(stretch) / np.where(way == 0, 1.0, way))
    effort = arm.compliance.stiffness[0] * share * (stretch[1:] + stretch[:-1]) / 2
    weight = arm.body.gravity_load((q[:-1] + q[1:]) / 2)[:, 0]
    impulse = h * (effort - weight) + arm.compliance.damping[0] * np.diff(stretch)
    error = p[1:] - p[0] - np.cumsum(impulse)
    return np.abs(error).max() / np.abs(impulse).sum()


@pytest.mark.parametrize("torques", [False, True])
def test_energy_and_momentum_balance_without_feedback(plan, torques):
    """The motors have no torque or the planned torques, and the steps have the usual length."""
    controller = without_controller(Controller().loop_period / STEPS_PER_PERIOD)
    stage = stage_of(plan, replace(controller, torque_offset=torques), 1)
    played = stage.play()
    arm = stage.arm(0.0)
    motion = arm_motion(
        arm,
        arm.period * np.arange(len(played.states)),
        played.states[:, :STATE_SIZE],
        np.zeros((1, 4)),
    )
    assert np.ptp(motion.q[:, 2]) > 0.2  # Joint 3 has no drive, and its motion moves the others.
    assert (np.ptp(motion.q[:, 0]) > 1.0) == torques
    assert energy_error(motion) <= 1e-6
    assert momentum_error(arm, played.states) <= 1e-6


@pytest.mark.parametrize("torques", [True, False])
def test_a_motion_that_begins_in_motion_continues_it(plan, torques):
    """A re-plan that begins in motion starts from the state of an arm that has tracked the plan."""
    controller, start = Controller(torque_offset=torques), 1.2
    complete = simulate(plan, controller=controller)
    t = np.append(np.arange(start, plan.motion.duration, 1e-3), plan.motion.duration)
    s = plan.motion.sample(t)
    assert np.all(np.abs(s.qd[0, :2]) > 0.3)
    rest = Plan.from_trajectory(Trajectory.from_samples(t - start, s.q, s.qd, s.qdd), plan.robot)
    part = simulate(rest, controller=controller)
    skipped = round(start / controller.loop_period)
    assert part.passed
    for a, b in zip(part.motors, complete.motors, strict=True):
        assert a.following_error <= b.following_error + 3
        assert a.peak_torque <= 1.05 * b.peak_torque
    errors = [(result.q - result.planned)[:, :2] for result in (part, complete)]
    count = round(0.5 / controller.loop_period)
    difference = errors[0][:count] - errors[1][skipped:][:count]
    # The zero positions of the encoders differ, so the difference may have a constant part.
    assert np.ptp(difference, axis=0).max() <= 5e-5


def test_halving_the_step_changes_the_torque_little_and_four_times_less_each_time(plan):
    t = np.arange(0.0, plan.motion.duration, 1e-3)
    s = plan.motion.sample(t)
    runs = [
        ArmSimulation(plan.robot, steps=steps).run(s.q, s.qd).tau[:, [0, 1, 3]]
        for steps in (2, 4, 8)
    ]
    peak = np.abs(runs[-1]).max(axis=0)
    errors = [np.abs(a - b).max(axis=0) / peak for a, b in pairwise(runs)]
    assert errors[1].max() <= 1e-4
    assert np.all(errors[1] < errors[0] / 3)


def with_fine_encoders(plan):
    """Return the plan with encoders of negligible rounding, whose counts still fit into 32 bits."""
    counts = {"roll": 2**23, "tilt": 2**23, "insertion": 2**24}
    fine = [
        j if j.motor is None else replace(j, motor=replace(j.motor, encoder_counts=counts[j.name]))
        for j in plan.robot.joints
    ]
    return replace(
        plan, problem=replace(plan.problem, robot=replace(plan.robot, joints=tuple(fine)))
    )


def test_halving_the_step_of_the_cascade_changes_its_torque_little(plan):
    plan = with_fine_encoders(plan)
    controller = Controller(joints={name: AxisController(i=0.0) for name in DRIVEN})
    runs = [
        stage_of(plan, controller, steps).play().states[:, CURRENT][:, [0, 1, 3]]
        for steps in (STEPS_PER_PERIOD, 2 * STEPS_PER_PERIOD)
    ]
    assert np.all(np.abs(runs[0] - runs[1]).max(axis=0) <= 1e-4 * np.abs(runs[1]).max(axis=0))


def test_the_set_points_are_the_exported_ones(plan, tmp_path):
    files, _ = export(plan, "epos4", tmp_path / "out", counts_per_turn=4096)
    streams = sample_setpoints(plan, drive_axes(plan.robot, 4096), "csp", 1)[0].streams
    assert set(streams) == set(DRIVEN)
    for joint, stream in streams.items():
        file = next(
            path
            for path in files.values()
            if path.name in (f"{joint}.csv", f"{joint}_unverified.csv")
        )
        names = file.read_text(encoding="utf-8").split("\n", 1)[0].split(",")[1:]
        rows = np.loadtxt(file, delimiter=",", skiprows=1)
        assert list(stream) == names
        np.testing.assert_array_equal(rows[:, 1:], np.column_stack(list(stream.values())))


def test_the_shipped_motion_is_followed_and_held(nominal, plan):
    assert nominal.passed, nominal.reasons
    assert nominal.holds
    assert nominal.tip_error < 2e-5
    planned = plan.motion.sample(np.minimum(nominal.time, plan.motion.duration)).q
    np.testing.assert_array_equal(nominal.planned, planned)
    for item, motor in zip(nominal.motors, ("roll", "tilt", "insertion"), strict=True):
        assert item.joint == motor
        assert item.peak_torque < item.limit
        assert item.following_error < 10 < item.window


def test_without_torque_offsets_the_feedback_has_to_do_what_they_did(nominal, plan):
    """Without torque offsets, the following errors are much larger."""
    without = Controller(torque_offset=False)
    fine = with_fine_encoders(plan)
    errors = [simulate(fine).following, simulate(fine, controller=without).following]
    helped, unhelped = (np.mean(item[:, [0, 1, 3]] ** 2, axis=0) for item in errors)
    assert np.all(unhelped > 10 * helped)
    alone = simulate(plan, controller=without)
    # With the real encoder of the insertion, both errors are rounding errors of set point and
    # encoder. They depend on the positions of the increments.
    increment = 2 * np.pi / nominal.axes["insertion"].counts_per_turn
    rounding = [np.sqrt(np.mean(item.following[:, 3] ** 2)) for item in (alone, nominal)]
    assert rounding[0] == pytest.approx(rounding[1], rel=0.15)
    assert max(rounding) < increment / 2
    assert max(np.abs(item.following[:, 3]).max() for item in (alone, nominal)) < 2.5 * increment
    assert alone.motors[0].following_error > 2 * nominal.motors[0].following_error


@pytest.mark.parametrize(
    ("scenario", "word"),
    [
        (Scenario(stall=("tilt", 1.0)), "joint tilt: the following error left its window"),
        (Scenario(wrong_direction="tilt"), "the tip was"),
        (Scenario(supply=1.5), "saturated"),
        (Scenario(friction=4.0), "saturated"),
        (Scenario(power_loss=1.0, travel=1e-7), "the tip travels"),
    ],
)
def test_a_harmful_scenario_fails_with_its_reason(plan, scenario, word):
    """A harmful scenario fails, and the result names the reason."""
    result = simulate(plan, scenario)
    assert not result.passed
    assert any(word in reason for reason in result.reasons), result.reasons


def test_a_low_supply_is_kept_to(plan):
    controller = Controller(supply=6.0)
    result = simulate(plan, controller=controller)
    for k in (0, 1):
        electrics = motor_electrics(plan.robot.joints[k], controller)
        current = result.torque[1:, k] / electrics.torque_constant
        voltage = electrics.torque_constant * result.w[1:, k] + electrics.resistance * current
        assert np.abs(voltage).max() <= 1.02 * electrics.voltage


def test_a_payload_bends_the_arm_by_its_weight(plan, nominal):
    heavy = simulate(plan, Scenario(payload=0.2, payload_time=1.0))
    before = nominal.time < 1.0
    np.testing.assert_array_equal(heavy.q[before], nominal.q[before])
    assert heavy.tip_error > 2 * nominal.tip_error


@pytest.mark.slow
def test_power_lost_everywhere_stops_the_arm_soonest_at_rest(plan):
    """An arm at rest does not travel after a loss of power.

    The loss with the longest travel gives the same travel as a single scenario.
    """
    result = simulate(plan, Scenario(power_loss="everywhere", instants=40))
    assert result.holds
    assert result.losses.travel[0] < 1e-9  # The arm is at rest before the start.
    single = simulate(plan, Scenario(power_loss=float(result.losses.time[result.losses.worst])))
    assert single.travel == pytest.approx(result.travel, rel=0.05)
    assert Scenario(power_loss=1).power_loss == 1.0
    assert isinstance(Scenario(power_loss=1).power_loss, float)


@pytest.mark.slow
def test_half_the_step_gives_the_same_standstills_without_power(plan):
    """Losses of power from the same states have the same standstills with both lengths of a step.

    The travels of the tip agree within a thousandth of the largest travel.
    """
    stages = [
        stage_of(plan, Controller(), steps) for steps in (STEPS_PER_PERIOD, 2 * STEPS_PER_PERIOD)
    ]
    for stage in stages:
        stage.scenario = Scenario(power_loss="everywhere", instants=40)
        played = stage.play()
    coarse, fine = (stage.simulate_power_losses(played, lambda _: None) for stage in stages)
    assert coarse.holds
    np.testing.assert_array_equal(np.isfinite(coarse.standing), np.isfinite(fine.standing))
    np.testing.assert_allclose(coarse.travel, fine.travel, atol=1e-3 * fine.travel.max())


def test_an_arm_that_does_not_lock_falls_without_power(plan):
    result = simulate(plan, Scenario(friction=0.1))
    assert not result.holds
    assert any("does not stand" in reason for reason in result.reasons)


def test_a_slower_playback_goes_the_same_way(plan):
    """A slower motion has the same positions at later times, and lower velocities."""
    slow = plan.motion.slower(0.1)
    assert slow.duration == pytest.approx(10 * plan.motion.duration)
    t = np.linspace(0, plan.motion.duration, 50)
    planned, played = plan.motion.sample(t), slow.sample(10 * t)
    np.testing.assert_allclose(played.q, planned.q, atol=1e-12)
    np.testing.assert_allclose(played.qd, planned.qd / 10, atol=1e-9)


def test_a_lost_set_point_is_felt(plan, nominal):
    """A lost set point increases the following error."""
    lost = simulate(plan, Scenario(dropped=1.0))
    assert lost.motors[0].following_error > 3 * nominal.motors[0].following_error


@pytest.mark.parametrize("scale", [0.3, 3.0])
def test_the_compliance_matters_as_a_spring_does(plan, nominal, scale):
    """A lower stiffness increases the tracking errors, and a higher stiffness reduces them."""
    result = simulate(plan, Scenario(compliance=scale))
    worst = [item.rms for item in result.tracking][:2]
    known = [item.rms for item in nominal.tracking][:2]
    assert all((a > b) == (scale < 1) for a, b in zip(worst, known, strict=True))


def test_backlash_is_free_play(plan):
    """A twist within the backlash does not deflect the spring."""
    stiff = {name: JointCompliance(backlash=0.0) for name in DRIVEN}
    loose = {
        name: JointCompliance(backlash=0.01 if name != "insertion" else 2e-5) for name in DRIVEN
    }
    arms = [
        _Simulation(plan, Scenario(), Controller(compliance=item)).arm(0.0)
        for item in (stiff, loose)
    ]
    twist = np.linspace(-0.02, 0.02, 9)
    np.testing.assert_allclose(arms[0].compliance.deflection(0, twist), twist)
    np.testing.assert_allclose(
        arms[1].compliance.deflection(0, twist),
        np.sign(twist) * np.maximum(np.abs(twist) - 0.005, 0),
    )


def test_recordings_are_read_back(nominal, plan, tmp_path):
    files = write_recordings(nominal, tmp_path)
    assert set(files) == set(DRIVEN)
    result = compare(plan, files, counts_per_turn=4096)
    assert result.verdict == "held"
    for axis in result:
        assert axis.alignment.correlation > 0.999
        assert axis.differences["position"].nrmsd < 1e-3


@pytest.mark.parametrize(
    "scenario",
    [
        Scenario(stall=("spin", 1.0)),
        Scenario(power_loss=99.0),
        Scenario(wrong_direction="elbow"),
    ],
)
def test_an_impossible_scenario_is_refused(plan, scenario):
    with pytest.raises(ProblemError):
        simulate(plan, scenario)


def test_a_second_with_controllers_takes_twenty_million_instructions_at_most(plan):
    """If CasADi needs 2.5 ns for each instruction, one simulated second takes at most 50 ms."""
    stage = _Simulation(plan, Scenario(), Controller())
    assert stage.arm(0.0).control_step.n_instructions() / stage.period < 20e6


def test_draws_are_what_single_playbacks_are(short):
    """A draw with the nominal friction agrees with the single playback."""
    nominal = simulate(short)
    frictions, notes = draw_frictions(short.robot, 6, 0.15)
    assert notes == ()
    stage = _Simulation(short, Scenario(), Controller())
    played = stage.play()
    frictions[0] = stage.friction
    result = play_draws(
        stage.arm(0.0),
        played.states[0],
        stage.commands,
        offsets=stage.offsets,
        friction=frictions,
        planned=stage.planned,
        tip_limit=1e-4,
    )
    assert result.passed.all()
    assert result.tip_error[0] == pytest.approx(nominal.tip_error, rel=0.01)
    for k, motor in zip((0, 1, 3), nominal.motors, strict=True):
        assert result.peak_torque[0, k] == pytest.approx(motor.peak_torque, rel=1e-9)
    assert np.ptp(result.peak_torque[:, 0]) > 1e-3
    assert json.loads(json.dumps(result.to_dict(), allow_nan=False))["count"] == 6


def test_frictions_are_drawn_from_the_posterior_or_said_to_be_as_stated(plan, short):
    """Frictions are drawn from the posterior of a drive. A note names each drive without a
    posterior.
    """
    drive = plan.robot.joints[0].drive
    sets = np.column_stack([np.linspace(0.12, 0.14, 50), np.full(50, 3e-3)])
    known = replace(
        drive, friction=replace(drive.friction, posterior=Posterior(("mu", "b_c"), sets))
    )
    robot = replace(
        plan.robot, joints=(replace(plan.robot.joints[0], drive=known), *plan.robot.joints[1:])
    )
    frictions, notes = draw_frictions(robot, 100)
    mu, b_c = (
        frictions[:, FRICTION_PARAMETERS.index("mu")],
        frictions[:, FRICTION_PARAMETERS.index("b_c")],
    )
    assert set(np.round(mu, 12)) == set(np.round(sets[:, 0], 12))
    assert np.all(b_c == 3e-3)
    assert [note.split(":")[0] for note in notes] == ["joint tilt", "joint insertion"]
    ratio = drive.friction.mu_static / drive.friction.mu
    np.testing.assert_allclose(frictions[:, FRICTION_PARAMETERS.index("mu_static")], ratio * mu)
    assert any("as stated" in note for note in simulate(short, Scenario(draws=2)).notes)
    with pytest.raises(ProblemError):
        simulate(plan, Scenario(draws=-1))
