"""Verify the reason that a failed plan states, and the relaxation that it suggests.

The reason names the limit, the joint, the motion, and the required and available values. A plan of
the relaxed problem must pass.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from ssm_planner.dynamics.friction import required_friction
from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.inverse import inverse_task
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.pipeline import run
from ssm_planner.pipeline.relaxation import TriedRelaxation, find_relaxation
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.planner import plan_motion
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.work import Work
from ssm_planner.plans import Plan
from ssm_planner.problem.limits import MotorTorque, TaskRange
from ssm_planner.problem.motion import Free, Joints, Motion, Straight, Task
from ssm_planner.problem.problem import Eye, Lens, Problem
from ssm_planner.problem.robot import Robot, read_only_array
from ssm_planner.problem.value import unchecked_copy

Weaker = Callable[[Robot, float], Robot]

START = {"roll": 0.0, "tilt": -1.6, "spin": 0.0, "depth": 0.004}
INSIDE = {"roll": 0.0, "tilt": -2.01, "spin": 0.0, "depth": 0.016}


def straight(**task: float) -> Motion:
    return Straight(**task, name="straight")


def with_joint(problem: Problem, i: int, **changes: Any) -> Problem:
    """Return the problem with changes of joint i."""
    joints = list(problem.robot.joints)
    joints[i] = dataclasses.replace(joints[i], **changes)
    return dataclasses.replace(
        problem, robot=dataclasses.replace(problem.robot, joints=tuple(joints))
    )


def weak(problem: Problem, i: int, factor: float) -> Problem:
    """Return the problem with `factor` times the largest motor torque of joint i."""
    motor = problem.robot.joints[i].motor
    assert motor is not None
    return with_joint(problem, i, motor=unchecked_copy(motor, max_torque=factor * motor.max_torque))


def narrow(problem: Problem) -> Problem:
    """Return the problem with a range of joint 2 that excludes a part of the motion.

    The range begins 0.1 rad above the smallest position.
    """
    q = plan(problem).trajectory.sample(plan(problem).trajectory.breaks).q[:, 1]
    return with_joint(problem, 1, position=(float(q.min()) + 0.1, float(q.max()) + 1.0))


def slippery(problem: Problem) -> Problem:
    """Return the problem with a lowest friction coefficient of 0.015 in the drive of joint 1."""
    drive = problem.robot.joints[0].drive
    assert drive is not None
    friction = dataclasses.replace(required_friction(drive), mu_lowest=0.015)
    return with_joint(problem, 0, drive=dataclasses.replace(drive, friction=friction))


def in_eye(problem: Problem, eye: Eye | None, to: dict[str, float]) -> Problem:
    """Return a problem with one straight motion from INSIDE, deep in the eye."""
    return dataclasses.replace(problem, eye=eye, start=Task(**INSIDE), motion=(straight(**to),))


def beside_lens(problem: Problem, eye: Eye | None) -> Problem:
    """Return an insertion whose tool axis passes a lens of 1.2 mm radius too closely.

    The axis is 1.1 radii from the centre of the lens. A shaft of 0.25 mm radius needs 1.21 radii.
    """
    assert eye is not None
    tilt, depth = START["tilt"], 0.0075
    aside = tilt - np.arcsin(1.1 * 1.2e-3 / depth)
    place = depth * np.array([-np.cos(aside), 0.0, np.sin(aside)])
    lens = Lens(
        read_only_array(place, (3,)),
        read_only_array([1.2e-3] * 3, (3,)),
        read_only_array(np.eye(3), (3, 3)),
    )
    return insertion(
        problem,
        0.012,
        eye=dataclasses.replace(eye, lens=lens, clearance=1e-4),
        start=Task(**{**START, "depth": 0.002}),
    )


def rolled(problem: Problem, _: Eye | None) -> Problem:
    """Return a motion to joints that roll the tool beyond the roll range of the problem.

    Each joint is within its own range.
    """
    mechanism, limits = (
        Mechanism.from_geometry(problem.robot.geometry),
        [j.position for j in problem.robot.joints],
    )
    result = inverse_task(
        mechanism, [[0.55, -1.9, 0.0, 0.001]], limits=limits, reference=np.zeros(4)
    )
    first, second, third, fourth = result.joints[0, int(np.argmax(result.valid[0]))].tolist()
    return tilt(problem, motion=(Free(Joints((first, second, third, fourth))),))


@dataclass(frozen=True)
class Case:
    """A problem without a plan, and what its reason must name."""

    problem: Callable[[Problem, Eye | None], Problem]
    constraint: str
    joint: str | None
    where: str


def tilt(problem: Problem, **changes: Any) -> Problem:
    """Return the problem with one short tilt motion."""
    start = Task(**START)
    return dataclasses.replace(
        problem, **{"start": start, "motion": (straight(tilt=-1.9),), **changes}
    )


def insertion(problem: Problem, depth: float = 0.015, **changes: Any) -> Problem:
    """Return the problem with one straight insertion to the depth in m."""
    start = Task(**START)
    return dataclasses.replace(
        problem, **{"start": start, "motion": (straight(depth=depth),), **changes}
    )


CASES = {
    "motor too weak on a line": Case(
        lambda p, _: weak(tilt(p), 0, 0.2), "motor torque", "roll", "straight"
    ),
    "motor too weak at a point": Case(
        lambda p, _: weak(
            dataclasses.replace(tilt(p), motion=(Free(Task(**{"tilt": -1.9, "depth": 0.01})),)),
            0,
            0.2,
        ),
        "motor torque",
        "roll",
        "free, ",
    ),
    "range of a joint": Case(lambda p, _: narrow(tilt(p)), "position", "tilt", "straight, at its"),
    "starts too fast": Case(
        lambda p, _: insertion(p, start_rate={"depth": 0.03}),
        "velocity",
        "insertion",
        "straight, start rate",
    ),
    "no room to stop": Case(
        lambda p, _: insertion(p, 0.0045, start_rate={"depth": 0.015}),
        "acceleration",
        "insertion",
        "straight",
    ),
    "too little time for a motion": Case(
        lambda p, _: insertion(
            p, motion=(dataclasses.replace(straight(depth=0.015), duration=0.3),)
        ),
        "duration",
        None,
        "straight",
    ),
    "too little time for all": Case(
        lambda p, _: insertion(p, objective="effort", duration=0.3),
        "duration",
        None,
        "the whole motion",
    ),
    "too near to the retina": Case(
        lambda p, eye: in_eye(p, eye, {"depth": 0.0203}),
        "retina clearance",
        None,
        "straight, at its end",
    ),
    "too near to the lens": Case(
        lambda p, eye: beside_lens(p, eye), "lens clearance", None, "straight, "
    ),
    "a range of the task at joints": Case(rolled, "roll range", None, "free, at its end"),
    "cannot stop before its range": Case(
        lambda p, _: insertion(
            p,
            motion=(Free(Task(**{"tilt": -1.7})),),
            start=Task(tilt=-1.425),
            start_rate={"tilt": 0.18},
        ),
        "tilt range",
        None,
        "free",
    ),
}


@dataclass(frozen=True)
class Outcome:
    plan: Plan
    cure: TriedRelaxation | None


Unplanned = Callable[[str], Outcome]


@pytest.fixture(scope="module")
def unplanned(tilt_insert: Problem, laser_scan: Problem) -> Iterator[Unplanned]:
    """Return a function that plans a case once and returns the plan and the relaxation."""
    outcomes: dict[str, Outcome] = {}
    cures: list[TriedRelaxation | None] = []

    def recording(*arguments: Any, **named: Any) -> TriedRelaxation | None:
        cures.append(find_relaxation(*arguments, **named))
        return cures[-1]

    def found(name: str) -> Outcome:
        if name not in outcomes:
            cures.clear()
            result = plan(CASES[name].problem(tilt_insert, laser_scan.eye))
            outcomes[name] = Outcome(result, cures[-1] if cures else None)
        return outcomes[name]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "find_relaxation", recording)
        yield found


@pytest.mark.parametrize("name", CASES)
def test_a_reason_says_what_where_and_by_how_much(unplanned: Unplanned, name: str) -> None:
    """The reason of each case names the expected limit, joint and motion, and two finite values."""
    case, result = CASES[name], unplanned(name).plan
    assert not result.passed
    assert result.reason is not None
    reason = result.reason
    assert (reason.constraint, reason.joint) == (case.constraint, case.joint)
    assert reason.where is not None
    assert reason.where.startswith(case.where)
    assert np.isfinite([reason.required, reason.available]).all()
    assert reason.required != reason.available
    assert reason.message
    if case.joint is not None:
        assert f"joint {case.joint}" in reason.message
    if case.constraint != "self-locking":
        assert result.status == "infeasible"
        assert result.trajectory is None


@pytest.mark.parametrize("name", [name for name in CASES if CASES[name].constraint != "direction"])
def test_the_relaxation_suffices_and_five_per_cent_less_does_not(
    unplanned: Unplanned, name: str
) -> None:
    """The suggested relaxation makes the problem solvable, and 95 % of the change does not."""
    result, cure = unplanned(name).plan, unplanned(name).cure
    assert cure is not None
    assert cure.works
    assert result.reason is not None
    assert result.reason.relaxation == cure.text
    assert f"takes {cure.outcome:.4g} s" in cure.text
    less = cure.relaxation.present + 0.95 * (cure.value - cure.relaxation.present)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "find_relaxation", lambda *_, **__: None)
        again = plan(cure.relaxation.problem(less))
    assert not again.passed
    assert again.reason is not None
    assert again.reason.constraint == result.reason.constraint


def test_the_problem_relaxed_is_solved(unplanned: Unplanned) -> None:
    cure = unplanned("range of a joint").cure
    assert cure is not None
    again = plan(cure.problem)
    assert again.passed
    assert again.duration == cure.outcome


def test_a_problem_that_no_limit_can_repair_is_refused(tilt_insert: Problem) -> None:
    """A problem that no other limit can repair raises a ProblemError."""
    timed = (dataclasses.replace(straight(depth=0.015), duration=2.0),)
    timed_twice = insertion(tilt_insert, motion=timed, objective="effort", duration=3.0)
    with pytest.raises(ProblemError, match="every motion already has a duration"):
        timed_twice.check_total()
    drive = slippery(tilt_insert).robot.joints[0].drive
    assert drive is not None
    with pytest.raises(ProblemError, match="the drive is not self-locking"):
        drive.check_locking()


def test_two_limits_in_the_way_are_relaxed_together(tilt_insert: Problem) -> None:
    """A problem with two weak motors gets one relaxation that states both torques.

    The search first relaxes the limit that the reason names, and then the limit that prevents the
    relaxed plan.
    """
    problem = tilt(tilt_insert, motion=(straight(tilt=-1.9, depth=0.01),))
    for i, torque in ((0, 0.0156), (3, 0.00011)):
        problem = weak(problem, i, torque / problem.robot.joints[i].motor.max_torque)
    reason = plan(problem).reason
    assert reason is not None
    assert reason.joint in ("roll", "insertion")
    other = {"roll": "insertion", "insertion": "roll"}[reason.joint]
    assert reason.relaxation is not None
    for joint in (reason.joint, other):
        assert reason.relaxation.count(f"largest motor torque of joint {joint} of") == 1
    assert "tried together, takes" in reason.relaxation


def test_the_workspace_boundary_is_named_with_the_joint_whose_speed_grows(
    tilt_insert: Problem,
) -> None:
    robot = dataclasses.replace(tilt_insert.robot, limits=())
    problem = dataclasses.replace(
        tilt_insert, robot=robot, limits=(), motion=(straight(tilt=np.radians(-140)),)
    )
    with pytest.raises(ProblemError, match="the speed of joint tilt grows without bound") as caught:
        plan(problem)
    assert "-139.778 deg to -79.778 deg" in str(caught.value)


def test_a_whole_turn_out_of_the_roll_range_is_named_before_anything_is_solved(
    tilt_insert: Problem,
) -> None:
    # Joint 1 cannot move beyond its range, and moving back would turn the tool by almost a
    # revolution.
    start = Joints((np.radians(294.1), np.radians(73.2), np.radians(39.4), -0.01))
    target = Free(Task(np.radians(16.7), np.radians(-136.5), np.radians(35.0), 0.01))
    result = plan_motion(dataclasses.replace(tilt_insert, start=start, motion=(target,)))
    assert result.reason is not None
    assert result.reason.limit == next(
        item for item in tilt_insert.limits if item.name == TaskRange.name_of("roll")
    )
    assert result.reason.message.startswith(
        "roll would have to be -343.3 deg, but its range ends at -30 deg"
    )


def test_the_clock_does_not_bound_what_is_searched(
    tilt_insert: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The work of the search for a relaxation is limited, and its time is not."""
    problems: list[Problem] = []
    work = Work()

    def never(problem: Problem) -> Reason:
        problems.append(problem)
        work.spent += 1.0
        return Reason(None, None, None, None, "no")

    monkeypatch.setattr("time.process_time", lambda: 1e3 * len(problems))
    assert (
        find_relaxation(
            tilt_insert,
            Reason(None, "insert", None, None, "no motion found"),
            never,
            work=work,
            budget=10.0,
        )
        is None
    )
    assert 9 <= len(problems) <= 10


def test_patience_bounds_what_is_search(tilt_insert: Problem) -> None:
    """With a budget of zero, the search tries one value of the limit that the reason names.

    It tries nothing if the reason names no limit.
    """
    problems: list[Problem] = []

    def never(problem: Problem) -> Reason:
        problems.append(problem)
        return Reason(None, None, None, None, "no")

    nameless = Reason(None, "insert", None, None, "no motion found")
    assert find_relaxation(tilt_insert, nameless, never, budget=0.0) is None
    assert not problems
    named = Reason(tilt_insert.robot.joints[0].limit(MotorTorque), "insert", 0.2, 0.1, "too weak")
    result = find_relaxation(tilt_insert, named, never, budget=0.0)
    assert result is not None
    assert not result.works
    assert len(problems) == 1
    assert find_relaxation(tilt_insert, nameless, never) is None
    # The search changes the torque and the velocity of every joint that has them and both sides of
    # three ranges. It changes each by a tenth and by the full amount.
    assert len(problems) == 1 + 2 * (3 + 4 + 6)


@pytest.mark.parametrize(("begin", "end"), [(-177.8, 160.0), (-170.0, 150.0), (120.0, -100.0)])
def test_joint_2_past_the_workspace_boundary_is_named_before_anything_is_solved(
    tilt_insert: Problem, begin: float, end: float
) -> None:
    """On the second branch, joint 2 must pass the workspace boundary at a tilt of -79.778 deg.

    The range of joint 2 allows no motion in the other direction.
    """
    start, target = (Joints((0.0, np.radians(angle), 0.0, -0.004)) for angle in (begin, end))
    problem = dataclasses.replace(
        tilt_insert, start=start, motion=(Free(target),), limits=(), objective="time"
    )
    robot = dataclasses.replace(
        problem.robot, limits=tuple(x for x in problem.robot.limits if x.name == "tilt range")
    )
    result = plan(
        dataclasses.replace(
            problem, robot=robot, limits=(TaskRange("tilt", *np.radians([-139, -81])),)
        )
    )
    assert result.status == "infeasible"
    reason = result.reason
    assert (reason.constraint, reason.joint) == ("tilt range", None)
    assert "passes the workspace boundary" in reason.message
    assert np.degrees(reason.required) == pytest.approx(-79.778, abs=1e-3)
