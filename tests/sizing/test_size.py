"""A verdict of sizing never passes an unknown figure, and it names the binding check.

The smallest adequate motor is selected.
"""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from ssm_planner.dynamics.spread import friction_spread
from ssm_planner.errors import ProblemError
from ssm_planner.problem.drive import Ratings
from ssm_planner.problem.motor import Motor
from ssm_planner.problem.robot import Robot
from ssm_planner.sizing.assess import assess
from ssm_planner.sizing.checks import combine_answers
from ssm_planner.sizing.duty import DutyCycle
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.motor_limits import Conditions
from ssm_planner.sizing.size import Sizing, size
from tests.support.sizing_cases import COMPLETE, equipped, random_trajectory

KNOWN = Conditions(supply_voltage=24.0, current_limit=20.0)
OPTIONAL = (
    "torque_constant",
    "terminal_resistance",
    "resistance_winding_housing",
    "resistance_housing_ambient",
    "time_constant_winding",
    "time_constant_motor",
    "max_winding_temperature",
)


@pytest.fixture(scope="module")
def sizing(complete: DutyCycle) -> Sizing:
    return size(complete, None, KNOWN)


def test_when_everything_is_known_and_within_it_is_adequate(sizing: Sizing) -> None:
    """A motor is adequate if every figure is known and every check passes."""
    assert [verdict.adequate for verdict in sizing.verdicts] == [True] * 3
    assert sizing.adequate is True
    for verdict in sizing.verdicts:
        assert verdict.probability == 1.0
        for check in (*verdict.checks, *verdict.gear):
            assert check.margin >= 0
            assert check.needs is None


@pytest.mark.parametrize("name", OPTIONAL)
def test_a_missing_figure_is_never_passed(complete: DutyCycle, name: str) -> None:
    load = complete.loads()[1]
    motor = replace(COMPLETE, **{name: None})
    verdict = assess(load, motor, KNOWN)
    assert verdict.adequate is None
    unknown = {check.name: check.needs for check in verdict.checks if check.passed is None}
    assert "heat" in unknown
    assert all(name in needs for needs in unknown.values())
    assert "confidence" in unknown
    assert verdict.probability is None
    assert not {"torque_constant", "terminal_resistance", "max_winding_temperature"} & {name} or (
        verdict.regions is None
    )


@pytest.mark.parametrize(
    "name", ["continuous_output", "peak_output", "input_speed", "duty", "root_diameter", "ends"]
)
def test_a_missing_rating_leaves_the_whole_unknown(robot: Robot, name: str) -> None:
    """A missing rating of a gear leaves the verdicts on its joint and on the robot open."""
    full = equipped(robot)
    joints = [
        joint
        if joint.drive is None
        else replace(
            joint, drive=replace(joint.drive, ratings=replace(joint.drive.ratings, **{name: None}))
        )
        for joint in full.joints
    ]
    result = size(
        DutyCycle.of_trajectory(random_trajectory(3), replace(full, joints=tuple(joints))),
        None,
        KNOWN,
    )
    assert result.adequate is None
    document = result.to_dict()
    assert name in json.dumps(document["gears"])
    lacking = {gear["joint"] for gear in document["gears"] if gear["not_checked"]}
    for verdict, row in zip(result.verdicts, document["motors"], strict=True):
        assert all(check.passed for check in verdict.checks)
        assert verdict.adequate is (None if verdict.joint in lacking else True)
        assert (name in json.dumps(row["not_checked"])) is (verdict.joint in lacking)
        assert (document["smallest"][verdict.joint] is None) is (verdict.joint in lacking)


def test_without_uncertainty_nothing_is_claimed(robot: Robot, trajectory) -> None:
    """Without a stated uncertainty, the verdict is open and has no probability."""
    duty = DutyCycle.of_trajectory(trajectory, robot)
    motors = {name: [COMPLETE] for name in ("roll", "tilt", "insertion")}
    for verdict in size(duty, motors, KNOWN).verdicts:
        assert verdict.probability is None
        assert verdict.adequate is None
        assert any(check.name == "confidence" and check.needs for check in verdict.checks)


def test_a_failing_check_says_no_whatever_else_is_missing(robot: Robot, trajectory) -> None:
    """A failed check gives the verdict no even if other figures are missing."""
    weak = Motor("weak", nominal_torque=1e-5, max_torque=1e-5, max_speed=1.0)
    result = size(DutyCycle.of_trajectory(trajectory, robot), {"tilt": [weak]})
    (verdict,) = [item for item in result.verdicts if item.joint == "tilt"]
    assert verdict.adequate is False
    assert verdict.binds in ("torque", "speed", "continuous_torque")
    assert result.adequate is False


def test_an_overloaded_gear_fails_every_motor(robot: Robot, trajectory) -> None:
    full = equipped(robot)
    joints = list(full.joints)
    joints[1] = replace(
        joints[1], drive=replace(joints[1].drive, ratings=Ratings(peak_output=1e-3))
    )
    result = size(
        DutyCycle.of_trajectory(trajectory, replace(full, joints=tuple(joints))), None, KNOWN
    )
    (verdict,) = [item for item in result.verdicts if item.joint == "tilt"]
    assert verdict.adequate is False
    assert verdict.binds == "gear_peak_output"
    assert result.adequate is False


def test_margins_by_hand(sizing: Sizing) -> None:
    """Margins and limits equal hand calculations, and the check with the smallest margin binds."""
    for verdict in sizing.verdicts:
        margins = {check.name: check for check in verdict.checks}
        load, motor = verdict.load, verdict.motor
        assert margins["speed"].margin == pytest.approx(
            1 - np.abs(load.speed()).max() / motor.max_speed
        )
        hot = motor.torque_constant * (1 - 0.0011 * 130)
        assert margins["torque"].limit == pytest.approx(min(motor.max_torque, 20 * hot))
        assert margins["torque"].nominal == pytest.approx(np.abs(load.torque()).max())
        assert margins["torque"].worst > margins["torque"].nominal
        assert (
            verdict.binds
            == min(
                (check for check in (*verdict.checks, *verdict.gear) if check.name != "confidence"),
                key=lambda check: check.margin,
            ).name
        )


def test_three_answers_by_the_share_of_the_draws_that_hold(complete: DutyCycle) -> None:
    """The fraction of draws that keep a limit decides between yes, open and no.

    A limit at or above the demand at 99 % gives yes, and a limit below the demand at 1 % gives no.
    A limit between them leaves the answer open, and the check names the recordings that would
    decide.
    """
    load = complete.loads()[1]
    band = assess(load, COMPLETE, KNOWN).band
    ends = band.low("peak_torque", 0.99), band.high("peak_torque", 0.99)
    cases = ((1.0, 1.0, True), (1.0, 0.999, None), (0.0, 1.001, None), (0.0, 0.999, False))
    for end, factor, expected in cases:
        largest = ends[int(end)] * factor
        result = assess(
            load, replace(COMPLETE, nominal_torque=largest, max_torque=largest), Conditions()
        )
        torque = next(check for check in result.checks if check.name == "torque")
        assert torque.passed is expected
        assert result.adequate is expected
        assert (torque.probability >= 0.99) is (expected is True)
        assert (torque.needs is not None) is (expected is None)
        if expected is None:
            assert "recordings at motor speeds up to" in torque.needs
            assert result.to_dict()["not_checked"]["torque"] == torque.needs


def test_more_confidence_leaves_less_margin(complete: DutyCycle) -> None:
    load = complete.loads()[0]
    levels = [
        assess(load, COMPLETE, replace(KNOWN, confidence=level))
        for level in (0.5, 0.9, 0.99, 0.999)
    ]
    for name in ("torque", "continuous_torque", "heat", "voltage"):
        margins = [
            next(check.margin for check in item.checks if check.name == name) for item in levels
        ]
        assert margins == sorted(margins, reverse=True)
        assert margins[0] > margins[-1]


def test_a_pause_helps_the_heat_and_nothing_else(complete: DutyCycle) -> None:
    """A pause increases the margins of heat and RMS torque and no other margin."""
    load = complete.loads()[0]
    without, with_pause = (
        assess(load, COMPLETE, KNOWN),
        assess(load, COMPLETE, replace(KNOWN, pause=3.0)),
    )
    for a, b in zip(without.checks, with_pause.checks, strict=True):
        if a.name in ("heat", "continuous_torque"):
            assert b.margin > a.margin
        else:
            assert b.margin == a.margin
    assert with_pause.requirement.rms_torque == without.requirement.rms_torque
    rms = next(check.worst for check in with_pause.checks if check.name == "continuous_torque")
    assert rms == pytest.approx(
        next(c.worst for c in without.checks if c.name == "continuous_torque") / np.sqrt(2)
    )


def test_heat_capacity_gives_exactly_the_limit(complete: DutyCycle) -> None:
    """Torques scaled by the heat capacity heat the winding exactly to its limit."""
    from ssm_planner.sizing.demand import select_instants
    from ssm_planner.sizing.thermal_network import Cycle, ThermalModel, steady_state

    load = complete.loads()[0]
    heat = assess(load, COMPLETE, KNOWN).heat
    few = select_instants(load)
    cycle = Cycle.from_torque(few.t, few.torque())
    scaled = cycle.scaled(heat.capacity / np.sqrt(cycle.mean(cycle.square)))
    result = steady_state(ThermalModel.from_motor(COMPLETE, KNOWN.ambient), scaled)
    assert result.peak == pytest.approx(COMPLETE.max_winding_temperature, abs=2e-3)


def test_too_hot_says_when(complete: DutyCycle) -> None:
    """A verdict that fails by heat states the time until the winding reaches its limit."""
    load = complete.loads()[0]
    rms = load.rms(load.torque())
    small = replace(COMPLETE, resistance_housing_ambient=900.0, nominal_torque=10 * float(rms))
    verdict = assess(load, small, KNOWN)
    assert verdict.adequate is False
    assert verdict.binds == "heat"
    assert 0 < verdict.heat.time_until_limit < 3600


def test_the_candidates_rotor_takes_the_place_of_the_old_one(complete: DutyCycle) -> None:
    for load in complete.loads():
        heavier = replace(COMPLETE, name="heavier", rotor_inertia=COMPLETE.rotor_inertia + 3e-7)
        verdict = assess(load, heavier, KNOWN)
        added = verdict.requirement.torque - load.torque()
        assert added == pytest.approx(3e-7 * load.acceleration(), abs=1e-15)
        assert verdict.adequate is not None
        assert assess(load, COMPLETE, KNOWN).requirement.torque == pytest.approx(
            load.torque(), abs=0
        )


@pytest.mark.parametrize("which", ["original", "candidate", "none"])
def test_an_unknown_rotor_counts_whole_and_leaves_open_only_what_it_decides(
    complete: DutyCycle, which: str
) -> None:
    """An unknown rotor inertia is assumed such that the total inertia is largest.

    The answer is open only if it depends on the value of this inertia.
    """
    load = complete.loads()[0]
    original: Motor | None = replace(COMPLETE, name="original")
    candidate, bound = COMPLETE, COMPLETE.nominal_torque / 2e4
    inertia = load.drive.input_inertia
    low, high = inertia - COMPLETE.rotor_inertia, inertia
    if which == "original":
        original = replace(original, rotor_inertia=None)
        low, high = (
            max(inertia - bound, 0.0) + COMPLETE.rotor_inertia,
            inertia + COMPLETE.rotor_inertia,
        )
    elif which == "candidate":
        candidate = replace(COMPLETE, rotor_inertia=None)
        high = low + bound
    else:
        original = None
        low, high = COMPLETE.rotor_inertia, inertia + COMPLETE.rotor_inertia
    load = replace(load, motor=original)
    verdict = assess(load, candidate, KNOWN)
    assert verdict.adequate is True
    assert verdict.load.drive.input_inertia == pytest.approx(high)
    assert any("rotor" in note for note in verdict.notes)
    peaks, least = [], []
    for value in np.linspace(low, high, 9):
        known = replace(
            load,
            drive=replace(load.drive, input_inertia=float(value)),
            motor=replace(COMPLETE, name="own"),
        )
        band = assess(known, replace(COMPLETE, name="own"), KNOWN).band
        peaks.append(band.high("peak_torque", 0.99))
        least.append(band.low("peak_torque", 0.99))
    slack = (high - low) / 2 * np.abs(load.acceleration()).max()
    for torque, expected in (
        (1.001 * max(peaks), True),
        (np.mean(peaks), None),
        (0.999 * min(least) - slack, False),
    ):
        motor = replace(candidate, nominal_torque=float(torque), max_torque=float(torque))
        check = next(
            item for item in assess(load, motor, Conditions()).checks if item.name == "torque"
        )
        # The bound on an unknown rotor inertia depends on the nominal torque.
        if which != "candidate":
            assert check.passed is expected
            assert expected is not None or "rotor" in check.needs


def test_a_motor_that_the_joint_may_have_instead_is_judged_beside_it(
    robot: Robot, trajectory
) -> None:
    duty = DutyCycle.of_trajectory(trajectory, robot)
    result = size(duty)
    (other,) = result.to_dict()["alternatives"]
    assert other["joint"] == "insertion"
    assert other["motor"] == robot.joints[3].alternatives[0].name
    assert {**other, "file": None} == {
        **size(duty, {"insertion": robot.joints[3].alternatives}).joints[2].candidates[0].to_dict(),
        "file": None,
    }
    weak = replace(robot.joints[3].alternatives[0], max_torque=1e-5, nominal_torque=1e-5)
    joints = (*robot.joints[:3], replace(robot.joints[3], alternatives=(weak,)))
    beside = size(DutyCycle.of_trajectory(trajectory, replace(robot, joints=joints)))
    assert beside.to_dict()["alternatives"][0]["adequate"] is False
    assert beside.adequate is result.adequate
    with pytest.raises(ProblemError, match="alternatives need a motor"):
        replace(robot.joints[3], motor=None)


def test_the_smallest_that_suffices(complete: DutyCycle) -> None:
    weak = replace(COMPLETE, name="weak", nominal_torque=1e-5, max_torque=2e-5)
    strong = replace(COMPLETE, name="strong", nominal_torque=0.3, max_torque=0.5)
    vague = replace(COMPLETE, name="vague", nominal_torque=0.05, terminal_resistance=None)
    result = size(complete, {"tilt": [strong, COMPLETE, weak, vague]}, KNOWN)
    tilt = result.joints[1]
    assert [item.motor.name for item in tilt.candidates] == ["weak", "vague", "complete", "strong"]
    assert [item.adequate for item in tilt.candidates] == [False, None, True, True]
    assert tilt.smallest.motor.name == "complete"
    assert result.to_dict()["smallest"]["tilt"] == "complete"
    assert result.adequate is True
    assert size(complete, {"tilt": [weak, vague]}, KNOWN).adequate is None
    assert size(complete, {"tilt": [weak]}, KNOWN).adequate is False


def test_monte_carlo_and_linear_verdicts_agree(complete: DutyCycle) -> None:
    load = complete.loads()[0]
    linear, drawn = (
        assess(load, COMPLETE, KNOWN),
        assess(load, COMPLETE, replace(KNOWN, draws=5000)),
    )
    for a, b in zip(linear.checks, drawn.checks, strict=True):
        assert a.margin == pytest.approx(b.margin, abs=0.01)
    assert friction_spread(load.drive).is_stated


def test_extrapolation_and_placeholders_are_said(complete: DutyCycle) -> None:
    """The notes of a verdict name extrapolated friction and assumed figures."""
    load = complete.loads()[0]
    doubtful = replace(COMPLETE, placeholders=("max_speed",))
    verdict = assess(load, doubtful, KNOWN)
    text = " ".join(verdict.notes)
    assert "extrapolated" in text
    assert "placeholder" in text
    assert verdict.to_dict()["placeholder"] is True


def test_a_motor_for_a_joint_without_a_drive(robot: Robot, trajectory) -> None:
    with pytest.raises(ProblemError, match=r"joints\.spin\.motor.*no drive"):
        size(DutyCycle.of_trajectory(trajectory, robot), {"spin": [COMPLETE]})
    spin = replace(robot.joints[2], motor=COMPLETE)
    joints = (*robot.joints[:2], spin, robot.joints[3])
    with pytest.raises(ProblemError, match=r"vitreoretinal\.yaml.*joints\.spin\.motor"):
        size(DutyCycle.of_trajectory(trajectory, replace(robot, joints=joints)))
    with pytest.raises(ProblemError, match="elbow"):
        size(DutyCycle.of_trajectory(trajectory, robot), {"elbow": [COMPLETE]})


def test_json(sizing: Sizing) -> None:
    document = json.loads(json.dumps(sizing.to_dict(), allow_nan=False))
    assert document["adequate"] is True
    assert document["confidence"] == 0.99
    for row in document["motors"]:
        assert set(row) >= {"joint", "motor", "adequate", "binds", "margins", "placeholder"}
        assert all(isinstance(margin, float) for margin in row["margins"].values())
        assert sum(row["regions"].values()) == pytest.approx(1.0)
    for row in document["requirements"]:
        low, high = row["band"]["peak_torque"]
        assert low < row["peak_torque"] < high


def test_a_motion_at_rest_asks_nothing(robot: Robot) -> None:
    from ssm_planner.trajectory import Trajectory

    still = np.zeros((1, 6, 4))
    still[0, 0] = [0.3, -0.2, 0.1, -0.01]
    duty = DutyCycle.of_trajectory(Trajectory(np.array([0.0, 1.0]), still, ()), equipped(robot))
    result = size(duty, None, replace(KNOWN, draws=1000))
    json.dumps(result.to_dict(), allow_nan=False)
    assert result.adequate is True


def test_three_valued_and() -> None:
    assert combine_answers([True, True]) is True
    assert combine_answers([True, None]) is None
    assert combine_answers([None, False, True]) is False
    assert combine_answers([]) is True


def test_load_of_one_joint_only(robot: Robot) -> None:
    from ssm_planner.problem.motion import Motorisation, Stroke

    strokes = (Stroke("tilt", 0.0, 1.0, 1.0, 3.0),)
    duty = DutyCycle.of_motorisation(Motorisation("one", robot, strokes))
    loads: tuple[JointLoad, ...] = duty.loads()
    assert [load.joint for load in loads] == ["tilt"]
    with pytest.raises(ProblemError, match="does not move this joint"):
        size(duty, {"roll": [COMPLETE]})
