"""A playback sends the right commands to the arm, and evaluates the motion of the arm. The
reference is a fake arm whose motion is known.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.plans import Plan
from ssm_planner.problem.controller import AxisController, Controller
from ssm_planner.problem.motion import Free, Joints
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import JOINTS, Robot
from ssm_planner.progress import Step
from ssm_planner.simulation import simulate as module
from ssm_planner.simulation.plant import MOTOR, QD, Q, W
from ssm_planner.simulation.playback import CONTROLLED_STATE_SIZE, CURRENT, TRIP, Commands, Playback
from ssm_planner.simulation.simulate import (
    ASSUMED_ENCODER_COUNTS,
    EVERYWHERE,
    HOLDING_TIME,
    MAX_STOPPING_TIME,
    REST_SPEED_RATIO,
    STANDSTILL_TIME,
    PowerLosses,
    Scenario,
    _Simulation,
)
from ssm_planner.trajectory import Span, Trajectory, quintic_coefficients

START = np.array([0.3, 1.15, 0.1, -0.005])
END = START + np.array([0.05, -0.04, 0.1, -0.003])
DURATION = 0.4
FINE = Controller(counts_per_turn=ASSUMED_ENCODER_COUNTS)


@pytest.fixture(scope="module")
def plan(robot: Robot) -> Plan:
    """Return a plan of one quintic from rest to rest."""
    zero, breaks = np.zeros((1, 4)), np.array([0.0, DURATION])
    piece = quintic_coefficients(
        np.diff(breaks), (START[None], zero, zero), (END[None], zero, zero)
    )
    first, last = (Joints(tuple(q.tolist())) for q in (START, END))
    problem = Problem(robot, first, (Free(last),), name="by hand")
    return Plan(problem, "solved", Trajectory(breaks, piece, (Span("all", 0.0, DURATION),)))


class FakeArm:
    """The fake arm records its commands and initial states.

    `moves` computes the states of n periods from the initial state. Without `moves`, the state
    stays constant.
    """

    torque_constants = np.ones(4)

    def __init__(self, moves: Any = None) -> None:
        self.commands: list[Commands] = []
        self.begun: list[np.ndarray] = []
        self.moves = moves

    def initial_state(self, q: np.ndarray, *motion: Any) -> np.ndarray:
        state = np.zeros(CONTROLLED_STATE_SIZE)
        state[Q] = q
        return state

    def encoder_offsets(self, q: np.ndarray) -> np.ndarray:
        return np.arange(4.0)

    def friction_parameters(self, scale: float) -> np.ndarray:
        return np.full(28, scale)

    def play(
        self, state: np.ndarray, command: Commands, offsets: np.ndarray, friction: np.ndarray
    ) -> Playback:
        self.commands.append(command)
        self.begun.append(state)
        n = len(command.power)
        states = np.tile(state, (n + 1, 1))
        if self.moves is not None:
            states = self.moves(state, n)
        return Playback(states, np.full((n, 4), len(self.commands)), np.zeros((n, 4)))


def stage(plan: Plan, **scenario: Any) -> _Simulation:
    return _Simulation(plan, Scenario(**scenario), FINE)


def test_the_playback_ends_after_the_target_was_held_or_after_the_loss_of_power(plan: Plan) -> None:
    for scenario, end in (
        ({}, DURATION + HOLDING_TIME),
        ({"power_loss": EVERYWHERE}, DURATION + HOLDING_TIME),
        ({"power_loss": 0.1}, 0.1 + MAX_STOPPING_TIME),
    ):
        result = stage(plan, **scenario)
        assert result.time[-1] + result.period == pytest.approx(end)
        assert np.diff(result.time) == pytest.approx(result.period)
        moving = result.time <= DURATION
        assert result.planned[moving] == pytest.approx(plan.motion.sample(result.time[moving]).q)
        assert result.planned[~moving] == pytest.approx(np.tile(END, (int((~moving).sum()), 1)))
        assert len(result.commands.power) == len(result.time)


def test_disturbances_change_the_commands_that_they_name_and_no_others(plan: Plan) -> None:
    plain = stage(plan)
    time = plain.time

    def differing(made: _Simulation) -> dict[str, np.ndarray]:
        own, other = vars(made.commands), vars(plain.commands)
        return {key: own[key] for key in own if not np.array_equal(own[key], other[key])}

    assert differing(stage(plan)) == {}
    assert plain.commands.power.all()
    assert not plain.commands.stalled.any()
    stalled = differing(stage(plan, stall=("tilt", 0.1)))
    assert set(stalled) == {"stalled"}
    expected = np.zeros((len(time), 4))
    expected[time >= 0.1 - 1e-9, 1] = 1.0
    assert np.array_equal(stalled["stalled"], expected)
    cut = vars(stage(plan, power_loss=0.1).commands)["power"]
    assert np.array_equal(cut, stage(plan, power_loss=0.1).time < 0.1 - 1e-9)
    turned = differing(stage(plan, wrong_direction="tilt"))
    assert set(turned) == {"demand", "speed", "acceleration", "torque"}
    for key, column in turned.items():
        own = getattr(plain.commands, key).copy()
        first = own[0, 1] if key == "demand" else 0.0
        own[:, 1] = 2 * first - own[:, 1]
        assert column == pytest.approx(own)
    lost = differing(stage(plan, dropped=0.1))
    assert set(lost) == {"demand", "speed", "acceleration", "torque"}
    # The lost set point repeats the one before it, and the drives interpolate on both sides of it.
    demand = lost["demand"]
    changed = np.flatnonzero((demand != plain.commands.demand).any(axis=1))
    assert time[changed].min() > 0.099 - 1e-9
    assert time[changed].max() < 0.101 + 1e-9
    position, before = (int(np.argmin(np.abs(time - t))) for t in (0.1, 0.099))
    increment = np.abs(np.diff(plain.commands.demand, axis=0)).max(axis=0)
    assert np.all(np.abs(demand[position] - plain.commands.demand[before]) <= increment)
    last = differing(stage(plan, dropped=DURATION))
    assert np.flatnonzero((last["speed"] != plain.commands.speed).any(axis=1)).size > 0


def test_joints_without_a_drive_are_prescribed_what_the_plan_accelerates_them_by(
    plan: Plan,
) -> None:
    result = stage(plan)
    moving = result.time < DURATION - 2e-3
    middle = plan.motion.sample(result.time[moving] + result.period / 2).qdd
    assert result.commands.prescribed[moving] == pytest.approx(middle, rel=1e-3, abs=1e-2)
    assert not result.commands.prescribed[result.time > DURATION].any()
    speed = np.cumsum(result.commands.prescribed[:, 2]) * result.period
    assert speed[-1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("pick", [0.0, 0.1])
def test_a_payload_hangs_on_the_arm_from_its_time_on(plan: Plan, pick: float) -> None:
    """The arm has no payload until a given time, and has the payload afterwards."""
    result = stage(plan, payload=0.05, payload_time=pick, friction=2.0)
    empty, loaded = FakeArm(lambda s, n: s + np.arange(n + 1.0)[:, None]), FakeArm()
    result.arms = {0.0: empty, 0.05: loaded}  # type: ignore[dict-item]
    played = result.play()
    n, change = len(result.time), round(pick / result.period)
    assert np.array_equal(result.friction, np.full(28, 2.0))
    assert np.array_equal(result.offsets, np.arange(4.0))
    assert [len(part.power) for part in empty.commands] == ([change] if change else [])
    assert [len(part.power) for part in loaded.commands] == [n - change]
    assert played.states.shape == (n + 1, CONTROLLED_STATE_SIZE)
    assert played.error.shape == played.saturated.shape == (n, 4)
    start = loaded.begun[0]
    assert start[Q] == pytest.approx(result.planned[0] + change)
    assert np.array_equal(played.states[change], start)
    demand = np.vstack([arm.demand for arm in (*empty.commands, *loaded.commands)])
    assert np.array_equal(demand, result.commands.demand)
    # If the power is lost before the payload is picked up, the empty arm stops.
    off = Commands(**{key: column[:1000] for key, column in vars(result.commands).items()})
    for instant, arm in ((0.05, loaded if pick == 0.0 else empty), (0.2, loaded)):
        count = len(arm.commands)
        result._stop_without_power(arm.initial_state(START), off, instant)
        assert len(arm.commands) > count


def falling(seconds: float, period: float) -> Any:
    """Return a function that moves joint 4 by 2 mm at constant speed within some seconds.

    The last element of a state counts the periods since the start.
    """

    def moves(state: np.ndarray, n: int) -> np.ndarray:
        states = np.tile(state, (n + 1, 1))
        age = state[-1] + np.arange(n + 1)
        states[:, -1] = age
        sliding = age * period < seconds - 1e-9
        states[:, 3] = START[3] - 2e-3 * np.minimum(age * period / seconds, 1.0)
        states[:, QD][:, 3] = np.where(sliding, -2e-3 / seconds, 0.0)
        return states

    return moves


@pytest.mark.parametrize("seconds", [0.03, 0.21, 0.7, 0.93, 0.97, 2.0])
def test_after_a_loss_of_power_travel_and_time_are_those_of_the_motion(
    plan: Plan, seconds: float
) -> None:
    result = stage(plan, power_loss=0.1)
    arm = FakeArm(falling(seconds, result.period))
    result.arms = {0.0: arm}  # type: ignore[dict-item]
    played = result.play()
    played.states[:] = arm.initial_state(START)
    losses = result.simulate_power_losses(played, lambda text: None)
    assert losses.time.tolist() == [0.1]
    stands = seconds < MAX_STOPPING_TIME - STANDSTILL_TIME
    assert losses.holds is stands
    if stands:
        assert losses.standing[0] == pytest.approx(seconds, abs=2 * result.period)
    ways = np.array([START, START])
    ways[1, 3] -= 2e-3 * min(MAX_STOPPING_TIME / seconds, 1.0)
    tips = tip_position(Mechanism.from_geometry(plan.robot.geometry), ways)
    assert losses.travel[0] == pytest.approx(np.linalg.norm(tips[1] - tips[0]), rel=1e-2)
    last_commands = arm.commands[-1]
    assert not last_commands.power.any()
    assert np.array_equal(
        last_commands.demand, np.tile(result.commands.demand[0], (len(last_commands.power), 1))
    )


def test_travel_counts_from_the_loss_of_power(plan: Plan) -> None:
    """The largest distance counts: the tip slides by 2 mm and returns by 1 mm before it stands."""
    result = stage(plan, power_loss=0.1)

    def moves(state: np.ndarray, n: int) -> np.ndarray:
        states = np.tile(state, (n + 1, 1))
        age = state[-1] + np.arange(n + 1)
        states[:, -1] = age
        slid = np.interp(age, [0, 100, 200], [0.0, 2e-3, 1e-3])
        states[:, 3] = START[3] - slid
        states[:, QD][:, 3] = np.where(age < 200, 1.0, 0.0)
        return states

    arm = FakeArm(moves)
    result.arms = {0.0: arm}  # type: ignore[dict-item]
    played = result.play()
    played.states[:] = arm.initial_state(START)
    said: list[Step] = []
    losses = result.simulate_power_losses(played, said.append)
    ends = np.array([START, START - [0, 0, 0, 2e-3]])
    tips = tip_position(Mechanism.from_geometry(plan.robot.geometry), ends)
    assert losses.travel[0] == pytest.approx(np.linalg.norm(tips[1] - tips[0]), rel=1e-3)
    assert losses.standing[0] == pytest.approx(200 * result.period)
    assert said == []  # Few instants report no progress.


def test_tracking_counts_from_the_first_period_and_ends_with_the_power(plan: Plan) -> None:
    for loss, periods in ((0.0, 1), (0.1, 250)):
        output = stage(plan, power_loss=loss)
        output.arms = {0.0: FakeArm()}  # type: ignore[dict-item]
        played = output.play()
        played.states[:, Q][:-1] = output.planned
        played.states[0, 0] += 3e-3
        played.states[1:periods, 0] += 1e-3
        played.states[periods:, 0] += 9e-3
        result = output.result(played, PowerLosses(*np.zeros((3, 1))))
        assert int(result.powered.sum()) == (0 if loss == 0.0 else periods)
        assert result.tracking[0].worst == pytest.approx(3e-3)
        expected = np.sqrt((9e-6 + (periods - 1) * 1e-6) / periods)
        assert result.tracking[0].rms == pytest.approx(expected)


def test_power_is_lost_at_even_instants_from_the_states_there(plan: Plan) -> None:
    result = stage(plan, power_loss=EVERYWHERE, instants=501)
    arm = FakeArm()
    result.arms = {0.0: arm}  # type: ignore[dict-item]
    played = result.play()
    played.states[:, 0] = np.arange(len(played.states))
    said: list[Step] = []
    losses = result.simulate_power_losses(played, said.append)
    assert losses.time == pytest.approx(np.linspace(0.0, DURATION, 501))
    begun = np.array([state[0] for state in arm.begun[1:]])
    assert begun == pytest.approx(np.round(losses.time / result.period))
    assert losses.travel.max() <= 1e-15
    assert not losses.standing.any()
    assert said == [Step("losing power at all instants", k, 501) for k in (0, 250, 500)]


def test_standing_means_that_every_motor_rests_and_no_joint_moves(plan: Plan) -> None:
    result = stage(plan)
    states = np.zeros((9, CONTROLLED_STATE_SIZE))
    for k, joint in enumerate(plan.robot.joints):
        states[k, QD.start + k] = -1.01 * REST_SPEED_RATIO * joint.velocity
        states[4 + k, QD.start + k] = 0.99 * REST_SPEED_RATIO * joint.velocity
    assert result._is_at_rest(states).tolist() == [False] * 4 + [True] * 5
    states = np.zeros((4, CONTROLLED_STATE_SIZE))
    states[:, W] = 1e-9 * np.eye(4)
    assert not result._is_at_rest(states).any()


def played_by_hand(made: _Simulation) -> Playback:
    """Return a playback in which joint 1 is 2 µrad away from the plan.

    The currents grow evenly, one drive saturates, and one drive trips in the middle of the motion.
    """
    n = len(made.time)
    states = np.zeros((n + 1, CONTROLLED_STATE_SIZE))
    states[:-1, Q], states[-1, Q] = made.planned, made.planned[-1]
    states[:, 0] += 2e-6
    states[:, CURRENT] = np.arange(n + 1.0)[:, None] / n * [1.0, -2.0, 0.0, 0.5]
    states[n // 2 :, TRIP.start + 1] = 1.0
    states[:, MOTOR] = 7.0
    error, saturated = np.zeros((n, 4)), np.zeros((n, 4))
    error[n // 4, 1], error[-1, 1] = -0.3, 0.9
    saturated[3, 3] = 1.0
    return Playback(states, error, saturated)


def test_a_result_states_what_was_played_while_there_was_power(plan: Plan) -> None:
    output = stage(plan)
    output.offsets = np.arange(4.0)
    n, none = len(output.time), PowerLosses(*np.zeros((3, 1)))
    result = output.result(played_by_hand(output), none)
    assert np.array_equal(result.powered, np.arange(n) < n // 2)
    roll = result.tracking[0]
    assert [item.joint for item in result.tracking] == list(JOINTS)
    assert (roll.worst, roll.rms) == pytest.approx((2e-6, 2e-6))
    assert result.tracking[1].worst == 0.0
    assert result.motor_angle == pytest.approx(np.tile(7.0 - np.arange(4.0), (n, 1)))
    assert [motor.joint for motor in result.motors] == ["roll", "tilt", "insertion"]
    for motor, k in zip(result.motors, (0, 1, 3), strict=True):
        known = plan.robot.joints[k].motor
        assert known is not None
        current = np.abs([1.0, -2.0, 0.0, 0.5])[k] / n
        # The current of a period is the current of the state at its end.
        assert motor.peak_torque == pytest.approx(current * (n // 2) * known.torque_constant)
        assert motor.limit == known.max_torque
        assert motor.saturated is (k == 3)
        assert motor.tripped is (k == 1)
        assert motor.window == output.windows[motor.joint]
    counts = output.axes["tilt"].counts_per_turn
    assert result.motors[1].following_error == pytest.approx(0.3 * counts / (2 * np.pi))
    assert not result.torque[:, 2].any()
    mechanism = Mechanism.from_geometry(plan.robot.geometry)
    off = tip_position(mechanism, result.q) - tip_position(mechanism, result.planned)
    assert result.tip == pytest.approx(np.linalg.norm(off, axis=1))
    assert any("tilt: the following error left" in reason for reason in result.reasons)


def test_windows_and_notes_follow_from_controller_and_motors(plan: Plan) -> None:
    with_error = Controller(joints={"roll": AxisController(following_error=0.01)})
    result = _Simulation(plan, Scenario(), with_error)
    axis = result.axes["roll"]
    assert result.windows["roll"] == round(0.01 * abs(axis.increments_per_unit))
    tiny = Controller(joints={"roll": AxisController(following_error=1e-12)})
    assert _Simulation(plan, Scenario(), tiny).windows["roll"] == 1
    joints = list(plan.robot.joints)
    known = {"encoder_counts": 500, "terminal_resistance": 1.0, "placeholders": ()}
    for k, changes in (
        (0, {"encoder_counts": None}),
        (1, {"terminal_resistance": None}),
        (3, {"placeholders": ("encoder_counts",)}),
    ):
        assert joints[k].motor is not None
        joints[k] = replace(joints[k], motor=replace(joints[k].motor, **{**known, **changes}))
    robot = replace(plan.robot, joints=tuple(joints))
    changed = replace(plan, problem=replace(plan.problem, robot=robot))

    def notes(controller: Controller) -> set[tuple[str, str]]:
        every = _Simulation(changed, Scenario(), controller)._assumptions()[1:]
        words = ("no encoder", "is not known", "counts is a placeholder", "figures of motor")
        return {(n.split(":")[0], word) for n in every for word in words if word in n}

    own = {
        ("joint tilt", "is not known"),
        ("joint insertion", "counts is a placeholder"),
    }
    assert notes(FINE) == own
    assert notes(Controller()) == {*own, ("joint roll", "no encoder")}


def test_an_arm_gets_its_windows_in_radians_and_its_payload(
    plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    built: list[tuple[Robot, dict[str, float]]] = []

    def arm(robot: Robot, controller: Any, axes: Any, windows: dict[str, float], **_: Any) -> Any:
        built.append((robot, windows))
        return FakeArm()

    monkeypatch.setattr(module, "ControlledArm", arm)
    result = stage(plan)
    assert result.arm(0.0) is result.arm(0.0)
    result.arm(0.05)
    (empty, windows), (loaded, same) = built
    assert windows == same
    for name, window in windows.items():
        turn = result.axes[name].counts_per_turn
        assert window == pytest.approx(2 * np.pi * result.windows[name] / turn)
    masses = [sum(body.mass for body in robot.bodies) for robot in (empty, loaded)]
    assert masses[1] - masses[0] == pytest.approx(0.05)


def test_draws_play_the_same_commands_under_scaled_frictions(
    plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[Any] = []
    monkeypatch.setattr(
        module,
        "draw_frictions",
        lambda *given: (calls.append(given), (np.ones((3, 28)), ("n",)))[1],
    )
    monkeypatch.setattr(module, "play_draws", lambda *given, **named: (given, named))
    result = stage(plan, draws=3, spread=0.2, friction=1.5, payload=0.05, tip_error=2e-4)
    arm = FakeArm()
    result.arms = {0.0: arm, 0.05: arm}  # type: ignore[dict-item]
    result.play()
    played: Any = result.draws(print)
    (used, state, played_commands), named = played
    assert (used, played_commands, named["progress"]) == (arm, result.commands, print)
    assert calls == [(plan.robot, 3, 0.2)]
    assert np.array_equal(state, arm.initial_state(result.planned[0]))
    assert np.array_equal(named["friction"], np.full((3, 28), 1.5))
    assert np.array_equal(named["offsets"], np.arange(4.0))
    assert np.array_equal(named["planned"], result.planned)
    assert named["tip_limit"] == 2e-4
    assert result.unknown == ("n",)
    assert stage(plan).draws(print) is None


@pytest.mark.parametrize(("dropped", "lost"), [(0.0, 1), (0.1, 100), (DURATION, 400)])
def test_a_lost_set_point_repeats_the_one_before(plan: Plan, dropped: float, lost: int) -> None:
    """A set point holds for one period of the stream, and the last one holds to the end."""
    plain, result = stage(plan), stage(plan, dropped=dropped)
    speed, period = plain.commands.speed, round(1e-3 / plain.period)
    expected = speed.copy()
    changed = np.flatnonzero((result.commands.speed != speed).any(axis=1))
    expected[changed] = speed[changed[0] - period] if lost > 1 else 0.0
    assert result.commands.speed == pytest.approx(expected, abs=1e-12)
    first, last = plain.time[changed[[0, -1]]]
    assert first == pytest.approx(1e-3 * (lost - 1), abs=1.1 * plain.period)
    end = plain.time[-1] if dropped == DURATION else 1e-3 * lost - plain.period
    assert last == pytest.approx(end, abs=1.1 * plain.period)
