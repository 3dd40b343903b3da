"""A tightened limit never allows more, and a relaxed limit never allows less. A limit that is set
on a problem replaces its counterpart only, and impossible limits are refused.
"""

from __future__ import annotations

import dataclasses
import json
import math
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ssm_planner.errors import ProblemError
from ssm_planner.problem.limits import (
    TASK_COORDINATES,
    ContinuousTorque,
    Duration,
    JointAcceleration,
    JointJerk,
    JointPosition,
    JointVelocity,
    Jump,
    LensClearance,
    Limit,
    MotorSpeed,
    MotorTorque,
    NutContact,
    RetinaClearance,
    SelfLocking,
    TaskRange,
    TaskRate,
    TipSpeed,
)
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.serialization import robot_from_plain, task_limits_from_plain, to_plain
from tests.support.paths import ROOT

bounds = st.floats(1e-3, 1e3)
ordered = st.tuples(st.floats(-10, 10), st.floats(1e-3, 10)).map(
    lambda ends: (ends[0], ends[0] + ends[1])
)
limits = st.one_of(
    *(
        st.builds(kind, st.just("tilt"), bounds)
        for kind in (
            JointVelocity,
            JointAcceleration,
            JointJerk,
            MotorSpeed,
            MotorTorque,
            ContinuousTorque,
        )
    ),
    ordered.map(lambda ends: JointPosition("tilt", *ends)),
    st.builds(
        lambda name, ends: TaskRange(name, *ends), st.sampled_from(TASK_COORDINATES), ordered
    ),
    st.builds(TaskRate, st.sampled_from(TASK_COORDINATES), bounds),
    st.builds(TipSpeed, bounds),
    st.builds(lambda clearance, more: RetinaClearance(clearance, clearance + more), bounds, bounds),
    st.builds(LensClearance, st.floats(0, 1), bounds),
    st.builds(Duration, bounds),
)
values = st.floats(-2e3, 2e3)


@given(limits, values, st.lists(values, max_size=20))
def test_tightened_never_allows_what_the_limit_forbids(
    limit: Limit, worst: float, others: list[float]
) -> None:
    if limit.contains(worst):
        return
    stricter = limit.tightened(worst, limit.bound(worst))
    if stricter is None:
        return
    assert type(stricter) is type(limit)
    assert stricter.key == limit.key
    assert not stricter.contains(worst)
    for value in (*others, stricter.low, stricter.high):
        if stricter.contains(value) and math.isfinite(value):
            assert limit.contains(value)
    # The stricter limit also excludes the bound of the original limit.
    assert not stricter.contains(limit.bound(worst))


@given(limits, values, values)
def test_relaxed_allows_the_value_and_all_that_the_limit_allows(
    limit: Limit, value: float, other: float
) -> None:
    looser = limit.relaxed(value)
    if looser is None:
        assert isinstance(limit, (RetinaClearance, LensClearance))
        return
    assert looser.contains(value) or looser.bound(value) == pytest.approx(value, rel=1e-12)
    assert looser.contains(other) or not limit.contains(other)
    assert looser.key == limit.key
    again = looser.relaxed(value)
    assert again is not None
    assert (again.low, again.high) == pytest.approx((looser.low, looser.high), rel=1e-12)


def test_every_limit_of_a_problem_put_back_in_its_place_changes_nothing(
    tilt_insert: Problem, laser_scan: Problem
) -> None:
    for problem in (tilt_insert, laser_scan):
        assert {type(limit) for limit in problem.all_limits} >= {
            JointPosition,
            MotorTorque,
            ContinuousTorque,
            TaskRange,
        }
        for limit in problem.all_limits:
            if not isinstance(limit, (NutContact, SelfLocking)):
                assert limit.on(problem).all_limits == problem.all_limits


@settings(max_examples=25)
@given(st.floats(1.01, 3.0))
def test_a_limit_put_on_a_problem_replaces_its_own_and_no_other(
    laser_scan: Problem, factor: float
) -> None:
    problem = laser_scan
    before = {limit.key: limit for limit in problem.all_limits}
    assert len(before) == len(problem.all_limits)
    for limit in problem.all_limits:
        side = limit.bound(math.inf if math.isfinite(limit.high) else -math.inf)
        moved = limit.relaxed(side + (factor - 1) * abs(side) * (1 if side == limit.high else -0.5))
        if moved is None or isinstance(limit, SelfLocking):
            continue
        after = {each.key: each for each in moved.on(problem).all_limits}
        assert after == {**before, limit.key: after[limit.key]}
        low, high = moved.low, moved.high
        if limit.name == "depth range":  # The travel of joint 4 bounds the depth.
            low, high = max(low, problem.robot.travel[0]), min(high, problem.robot.travel[1])
        assert (after[limit.key].low, after[limit.key].high) == pytest.approx((low, high))


def test_limits_of_the_task_are_added_where_a_problem_has_none(tilt_insert: Problem) -> None:
    for limit in (TipSpeed(0.01), TaskRate("spin", 0.2), TaskRange("spin", -1.0, 1.0)):
        assert limit not in tilt_insert.limits
        assert set(limit.on(tilt_insert).limits) == {*tilt_insert.limits, limit}


def test_a_range_that_is_relaxed_makes_room_in_the_robot_too(tilt_insert: Problem) -> None:
    (own,) = tilt_insert.robot.limits
    relaxed = own.relaxed(own.upper + 0.01)
    assert relaxed is not None
    assert relaxed.on(tilt_insert).ranges["tilt"] == (own.lower, own.upper + 0.01)
    narrowed = dataclasses.replace(own, upper=own.upper - 0.01)
    assert narrowed.on(tilt_insert).robot.limits == (own,)


def test_self_locking_raises_the_friction_and_never_lowers_it(tilt_insert: Problem) -> None:
    limit = tilt_insert.robot.joints[0].limit(SelfLocking)
    for lowest in (0.5 * limit.friction, 0.9):
        raised = limit.relaxed(lowest).on(tilt_insert).robot.joints[0]
        friction = raised.drive.friction
        assert friction.mu_lowest == max(lowest, limit.friction)
        assert friction.mu >= friction.mu_lowest
        assert friction.mu_static >= friction.mu_lowest


def test_a_duration_finds_its_motion(tilt_insert: Problem) -> None:
    """A relaxed duration replaces that of its motion, or else the total duration."""
    motion = tuple(
        dataclasses.replace(m, duration=2.0 + k) for k, m in enumerate(tilt_insert.motion)
    )
    timed = dataclasses.replace(tilt_insert, motion=motion)
    longer = Duration(2.0, motion[0].name).relaxed(5.0).on(timed)
    assert [m.duration for m in longer.motion] == [5.0, *(m.duration for m in motion[1:])]
    complete = dataclasses.replace(timed, motion=tilt_insert.motion, duration=4.0)
    assert Duration(4.0).relaxed(6.0).on(complete).duration == 6.0
    assert (
        Duration(3.0, motion[0].name).relaxed(6.0).on(complete).duration == 6.0
    )  # the motion has a share of the total duration
    both = Duration(2.0, motion[0].name).relaxed(5.0).on(dataclasses.replace(timed, duration=4.0))
    assert (both.duration, [m.duration for m in both.motion]) == (
        4.0,
        [5.0, *(m.duration for m in motion[1:])],
    )
    with pytest.raises(ProblemError, match="no motion other of 2 s"):
        Duration(2.0, "other").on(timed)


@pytest.mark.parametrize(
    ("limit", "value", "words"),
    [
        (
            MotorTorque("roll", 0.01),
            0.012,
            "largest motor torque of joint roll of 12 mN·m instead of 10 mN·m",
        ),
        (
            ContinuousTorque("tilt", 0.01),
            0.02,
            "continuous torque of joint tilt of 20 mN·m instead of 10 mN·m",
        ),
        (
            JointVelocity("insertion", 0.01, True),
            0.02,
            "velocity limit of joint insertion of 20 mm/s instead of 10 mm/s",
        ),
        (
            JointAcceleration("spin", math.radians(100)),
            math.radians(150),
            "acceleration limit of joint spin of 150 deg/s² instead of 100 deg/s²",
        ),
        (
            JointPosition("roll", -1.0, math.radians(30)),
            math.radians(40),
            "range of joint roll to 40 deg instead of 30 deg",
        ),
        (TaskRange("depth", 0.0, 0.03), 0.04, "range of depth to 40 mm instead of 30 mm"),
        (TaskRange("depth", 0.0, 0.03), -0.01, "range of depth from -10 mm instead of 0 mm"),
        (TipSpeed(0.02), 0.025, "tip speed of 25 mm/s instead of 20 mm/s"),
        (TaskRate("depth", 0.02), 0.025, "insertion speed of 25 mm/s instead of 20 mm/s"),
        (
            RetinaClearance(0.001, 0.012),
            0.0005,
            "clearance from the retina of 0.5 mm instead of 1 mm",
        ),
        (LensClearance(0.0005, 0.002), 1.2, "radius of the shaft of 0.4 mm instead of 0.5 mm"),
        (
            SelfLocking("roll", 0.1),
            0.15,
            "lowest friction coefficient μ of joint roll of 0.15 instead of 0.1",
        ),
        (Duration(2.0), 3.0, "a duration of 3 s instead of 2 s"),
    ],
)
def test_a_limit_says_what_it_would_be_instead(limit: Limit, value: float, words: str) -> None:
    assert limit.described(value) == words


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (
            lambda: TaskRange("tlt", -1, 1),
            ("TaskRange.coordinate = tlt", "roll, tilt, spin, depth"),
        ),
        (lambda: TaskRange("tilt", 1, -1), ("TaskRange.lower = 1", "below -1")),
        (lambda: TaskRange("tilt", math.nan, 1), ("TaskRange.lower = nan",)),
        (lambda: TaskRate("yaw", 1), ("TaskRate.coordinate = yaw",)),
        (lambda: TaskRate("roll", -1), ("TaskRate.largest = -1", "above 0")),
        (lambda: TipSpeed(0), ("TipSpeed.largest = 0", "above 0")),
        (lambda: TipSpeed(math.nan), ("TipSpeed.largest = nan",)),
        (lambda: JointVelocity("roll", -2.0), ("JointVelocity.largest = -2.0",)),
        (lambda: JointPosition("roll", 1.0, 1.0), ("JointPosition.lower = 1.0",)),
    ],
)
def test_an_impossible_limit_is_refused(make, told) -> None:
    with pytest.raises(ProblemError) as caught:
        make()
    for part in told:
        assert part in str(caught.value)


def test_a_problem_refuses_limits_of_joints_among_its_own_and_one_given_twice(
    tilt_insert: Problem,
) -> None:
    for wrong, message in (
        ((MotorTorque("roll", 1.0),), "not a limit of the task"),
        ((TipSpeed(1.0), TipSpeed(2.0)), "occurs twice"),
        ((TaskRange("roll", -1, 1), TaskRange("roll", -2, 2)), "roll range"),
    ):
        with pytest.raises(ProblemError, match=message):
            dataclasses.replace(tilt_insert, limits=wrong)
        with pytest.raises(ProblemError, match=message):
            dataclasses.replace(tilt_insert.robot, limits=wrong)
    with pytest.raises(ProblemError, match="unknown joint"):
        JointVelocity("elbow", 1.0).on(tilt_insert)


def test_limits_survive_plan_json(laser_scan: Problem) -> None:
    problem = TaskRate("roll", 0.5).on(TipSpeed(0.02).on(laser_scan))
    document = json.loads(json.dumps(to_plain(problem)))
    assert {"limits", "tip_speed", "rates", "eye"} <= set(document)
    assert set(task_limits_from_plain(document).all_limits) == set(problem.task_limits.all_limits)
    robot = robot_from_plain(document["robot"])
    assert robot.limits == problem.robot.limits
    assert [joint.limits for joint in robot.joints] == [
        joint.limits for joint in problem.robot.joints
    ]


def test_names_are_those_of_results() -> None:
    assert [TaskRate(name, 1.0).name for name in TASK_COORDINATES] == [
        "roll rate",
        "tilt rate",
        "spin rate",
        "insertion speed",
    ]
    assert [TaskRange(name, 0.0, 1.0).name for name in TASK_COORDINATES] == [
        f"{name} range" for name in TASK_COORDINATES
    ]
    assert [Jump("roll", 1.0, derivative=k).name for k in range(3)] == [
        "position jump",
        "velocity jump",
        "acceleration jump",
    ]


@pytest.mark.parametrize("kind", ["straight", "free"])
@pytest.mark.slow
def test_a_new_limit_on_a_speed_of_the_tool_takes_two_places_of_code(
    kind: str, tmp_path: Path
) -> None:
    """new_limit.py defines such a limit in two places.

    The limit is planned, checked, written, read back, drawn, tightened and described.
    """
    script, problem = Path(__file__).parent / "new_limit.py", ROOT / "problems/tilt_insert.yaml"
    command = [sys.executable, str(script), str(problem), kind, "0.3", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["passed"]
    assert result["read back"]
    assert result["checked again"]
    assert result["on the page"]
    assert result["slower"] > 1.2
    assert result["worst"] == pytest.approx(1.0, abs=1e-5)
    assert 0.9 < result["tightened"] < 1
    assert result["in words"] == "axis speed of 34.3775 deg/s instead of 17.1887 deg/s"


def test_a_jump_has_no_place_in_a_problem(tilt_insert: Problem) -> None:
    with pytest.raises(ProblemError, match="position jump cannot be set"):
        Jump("roll", 1e-6).on(tilt_insert)
