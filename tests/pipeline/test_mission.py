"""Verify that free motions use the fastest joint configuration at their target.

The cases cover the other branch of the inverse kinematics, whole turns, free spin, and
interruptions.
"""

from __future__ import annotations

import signal
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.inverse import inverse_task
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.loading.load import load_problem
from ssm_planner.pipeline import certified, run
from ssm_planner.pipeline.run import plan
from ssm_planner.planning import phase_planner
from ssm_planner.planning.planner import estimated_duration
from ssm_planner.planning.tolerances import GAP
from ssm_planner.plans import Plan, load_plan
from ssm_planner.problem.limits import TaskRange
from ssm_planner.problem.motion import Dwell, Free, Joints, Straight, Task, Tip
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.progress import Progress, Step


def turning(
    problem: Problem, *, tilt: float, roll: tuple[float, float], limits: tuple[TaskRange, ...] = ()
) -> Problem:
    """Return a problem with a free roll motion at a constant tilt, all in deg.

    The robot has no task ranges except `limits`.
    """
    start = Task(roll=np.radians(roll[0]), tilt=np.radians(tilt), spin=0.0, depth=5e-3)
    motion = (Free(Task(roll=np.radians(roll[1]))),)
    robot = replace(problem.robot, limits=())
    return replace(
        problem, robot=robot, start=start, motion=motion, limits=limits, objective="time"
    )


def weaker(robot: Robot, strength: float) -> Robot:
    """Return the robot with motors of `strength` times their largest torque.

    The nominal torque is only 1 mN m.
    """
    joints = []
    for joint in robot.joints:
        motor = joint.motor
        if motor is not None:
            motor = replace(motor, max_torque=strength * motor.max_torque, nominal_torque=1e-3)
        joints.append(replace(joint, motor=motor))
    return replace(robot, joints=tuple(joints))


def ends(made: Plan) -> np.ndarray:
    """Return the joint positions at both ends of the plan, (2, 4), each times 180/π."""
    return np.degrees(made.motion.sample(np.array([0.0, made.motion.duration])).q)


def test_a_sketch_that_is_too_long_is_given_up(
    tilt_insert: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The estimate of a duration gives up as soon as the motion must be too long.

    It does so by lower bounds before any phase is solved, or when the solved phases take too long.
    """
    target = Free(Task(tilt=np.radians(-120.0), depth=0.01))
    problem = replace(
        tilt_insert, motion=(target, Straight(depth=0.002), Straight(depth=0.02)), objective="time"
    )
    complete = estimated_duration(problem)
    assert np.isfinite(complete)
    assert estimated_duration(problem, 1.001 * complete) == pytest.approx(complete, rel=1e-6)
    assert estimated_duration(problem, 0.999 * complete) == np.inf
    assert estimated_duration(replace(problem, duration=2 * complete)) == 2 * complete
    solved: list[str] = []
    for name in ("solve_free", "solve_straight"):
        solve = getattr(phase_planner, name)
        monkeypatch.setattr(
            phase_planner,
            name,
            lambda *a, name=name, solve=solve, **k: [solved.append(name), solve(*a, **k)][1],
        )
    assert estimated_duration(replace(problem, duration=0.3 * complete)) == np.inf
    assert solved == []
    assert estimated_duration(problem) == complete
    assert solved[:2] == ["solve_straight", "solve_straight"]


def test_the_other_branch_is_taken_where_it_is_faster(tilt_insert: Problem) -> None:
    """The plan uses the faster branch, and no other candidate is faster by more than GAP."""
    steps: list[Step] = []
    result = plan(turning(tilt_insert, tilt=-138.5, roll=(30, -30)), steps.append)
    assert result.passed
    assert result.duration == pytest.approx(0.7653, abs=1e-4)
    assert any(
        step.step.startswith("other joints for free, attempt 1, ")
        and step.step.endswith("s so far")
        for step in steps
    )
    assert result.lower_bound == pytest.approx(result.duration, rel=1e-5)
    others = [item for item in result.candidates[0] if item["kind"] == "other joints"]
    assert [item["outcome"] for item in others].count("taken") == 1
    for item in others:
        known = [item[name] for name in ("bound", "estimate", "duration") if item[name] is not None]
        assert max(known) >= result.duration * (1 - GAP)
    assert "free: goes from branch -1 of the inverse kinematics to branch +1" in result.notes
    back = turning(tilt_insert, tilt=-138.5, roll=(30, -30))
    first, _ = ends(result)
    straight = plan(
        replace(
            back,
            motion=(Free(Joints((np.radians(first[0] - 60), *np.radians(first[1:3]), -5e-3))),),
        )
    )
    assert straight.duration == pytest.approx(1.2481, abs=1e-4)
    assert not any("branch" in note for note in straight.notes)


def test_a_branch_beyond_the_tilt_range_is_not_taken(tilt_insert: Problem) -> None:
    """The faster branch is not used if it exceeds the tilt range."""
    within = (TaskRange("tilt", np.radians(-139), np.radians(-81)),)
    result = plan(turning(tilt_insert, tilt=-138.5, roll=(30, -30), limits=within))
    assert result.passed
    assert result.duration == pytest.approx(1.2481, abs=1e-4)


def test_a_branch_is_found_where_the_nearest_joints_give_no_motion(tilt_insert: Problem) -> None:
    """If joint 1 cannot reach the target on the starting branch, the plan uses the other branch."""
    free = turning(tilt_insert, tilt=-138.5, roll=(30, -30))
    first, _ = ends(plan(free))
    roll = replace(free.robot.joints[0], position=tuple(np.radians([first[0] - 40, first[0] + 10])))
    narrow = replace(free, robot=replace(free.robot, joints=(roll, *free.robot.joints[1:])))
    assert plan(narrow).duration == pytest.approx(0.7653, abs=1e-4)


def test_nothing_more_is_planned_where_no_other_joints_can_be_faster(
    tilt_insert: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The planner solves one plan if no other joint configuration can be faster."""
    planned = []
    attempt = run._plan_check_and_cool
    monkeypatch.setattr(
        run,
        "_plan_check_and_cool",
        lambda problem, *rest, **how: (planned.append(problem), attempt(problem, *rest, **how))[1],
    )
    plan(turning(tilt_insert, tilt=-138.5, roll=(-30, 30)))
    assert len(planned) == 1


@pytest.mark.parametrize("seed", range(4))
def test_no_branch_planned_by_itself_is_faster(tilt_insert: Problem, seed: int) -> None:
    """No other joint configuration at the target gives a faster plan."""
    rng = np.random.default_rng(seed)
    near = np.radians([rng.uniform(-139.7, -136), rng.uniform(-84, -80)])
    start = Task(
        roll=rng.uniform(-1, 1), tilt=rng.choice(near), spin=rng.uniform(-1, 1), depth=5e-3
    )
    to = Task(
        roll=rng.uniform(-1, 1),
        tilt=rng.choice(near),
        spin=rng.uniform(-1, 1),
        depth=rng.uniform(0, 0.02),
    )
    robot = replace(tilt_insert.robot, limits=())
    motion = (Free(to), Dwell(0.1), Straight(depth=1e-3))
    free = replace(
        tilt_insert, robot=robot, start=start, motion=motion, limits=(), objective="time"
    )
    output = plan(free)
    assert output.passed
    mechanism = Mechanism.from_geometry(robot.geometry)
    goal = [[to.roll, to.tilt, to.spin, to.depth]]
    first = np.radians(ends(output)[0]) * (1, 1, 1, np.pi / 180)
    result = inverse_task(
        mechanism, goal, limits=[joint.position for joint in robot.joints], reference=first
    )
    for q in result.joints[0, result.valid[0]]:
        alone = plan(
            replace(free, motion=(Free(Joints(tuple(q.tolist()))), *motion[1:])), relaxations=False
        )
        assert alone.duration is None or output.duration <= alone.duration * (1 + 1e-5)


def freely(problem: Problem, to: Task, *, spin_free: bool = True) -> Problem:
    """Return a problem with one free motion from a tilt of -85 deg."""
    start = Task(roll=0.0, tilt=np.radians(-85), spin=0.0, depth=0.0)
    return replace(problem, start=start, motion=(Free(to, spin_free=spin_free),), objective="time")


@pytest.mark.parametrize("strength", [1.0, pytest.param(0.35, marks=pytest.mark.slow)])
def test_no_spin_is_faster_than_a_free_one(tilt_insert: Problem, strength: float) -> None:
    """A plan with free spin is at least as fast as plans with three fixed spins.

    Strong motors keep the present spin, because no other spin is faster. Weak motors use a spin
    that makes their load easier to move.
    """
    weak = replace(
        tilt_insert, robot=weaker(tilt_insert.robot, strength), duty=None, planner="fast"
    )
    to = Task(tilt=np.radians(-135))
    result = plan(freely(weak, to))
    assert result.passed
    for spin in np.radians([-60, 0, 30]):
        fixed = plan(
            freely(weak, replace(to, spin=float(spin)), spin_free=False), relaxations=False
        )
        assert result.duration <= fixed.duration * (1 + 1e-5)
    spin = result.phases[0].task_end[2]
    assert (abs(spin) < 1e-9) == (strength == 1.0)


def test_a_tip_may_be_reached_with_a_free_spin(tilt_insert: Problem) -> None:
    to = Tip((9e-3, 0.0, -17.5e-3), 3.0)
    result = plan(replace(tilt_insert, motion=(Free(to, spin_free=True),)))
    assert result.passed
    assert result.phases[0].task_end[2] == pytest.approx(0.0, abs=1e-9)
    tip = tip_position(
        Mechanism.from_geometry(result.robot.geometry),
        result.motion.sample(result.motion.duration).q,
    )[0]
    assert tip == pytest.approx(to.position, abs=1e-9)


def test_a_free_spin_is_read_written_and_refused_elsewhere(
    tilt_insert: Problem, tmp_path: Path
) -> None:
    text = "robot: vitreoretinal\nstart: {{roll: 0 deg, tilt: -85 deg, spin: 0 deg, depth: 0 mm}}\nmotion:\n  - {}\n"
    problem = Problem.from_yaml(text.format("free: {to: {tilt: -120 deg, spin: free}}"))
    (motion,) = problem.motion
    assert isinstance(motion, Free)
    assert motion.spin_free
    result = replace(plan(replace(tilt_insert, motion=(Straight(depth=2e-3),))), problem=problem)
    assert (
        Plan.from_json(result.to_json().encode(), tmp_path / "plan.json")
        .problem.motion[0]
        .spin_free
    )
    for other in (
        "straight: {to: {spin: free}}",
        "free: {to: {tilt: -120 deg, spin: any}}",
        "spin: {to: free}",
    ):
        with pytest.raises(ProblemError, match="an angle such as"):
            Problem.from_yaml(text.format(other))
    with pytest.raises(ProblemError, match="joints fix the spin"):
        Free(Joints((0.0, 0.0, 0.0, 0.0)), spin_free=True)


def test_a_weak_motor_goes_the_other_way_round(tilt_insert: Problem) -> None:
    """Joint 1 cannot lift the arm on the nearest path, but can lower it on another path."""
    robot = replace(weaker(tilt_insert.robot, 0.45), limits=())
    start = Task(roll=-1.8326, tilt=-1.6714, spin=-1.901, depth=0.025)
    motion = (Free(Task(roll=-1.6099, tilt=-2.3619, spin=0.8735, depth=0.0155)),)
    anyway = replace(
        tilt_insert, robot=robot, limits=(), start=start, motion=motion, objective="time", duty=None
    )
    result = plan(anyway, relaxations=False)
    assert result.passed
    assert result.duration < 3.3


def interrupting(times: int) -> Progress:
    """Return a progress callback that raises SIGINT at most `times` times.

    It raises the signal when other joints are tried.
    """
    left = [times]

    def tell(step: Step) -> None:
        if step.step.startswith("other joints") and left[0]:
            left[0] -= 1
            signal.raise_signal(signal.SIGINT)

    return tell


@pytest.mark.skipif(
    threading.current_thread() is not threading.main_thread(),
    reason="signals go to the main thread",
)
def test_a_search_that_is_stopped_gives_the_best_so_far(
    tilt_insert: Problem, tmp_path: Path
) -> None:
    """The first Ctrl-C during the search returns the best plan so far in `plan_to_folder`."""
    problem = turning(tilt_insert, tilt=-138.5, roll=(30, -30))
    complete = plan(problem)
    before = signal.getsignal(signal.SIGINT)
    steps: list[Step] = []

    def tell(step: Step) -> None:
        steps.append(step)
        press(step)

    press = interrupting(1)
    stopped, files = run.plan_to_folder(problem, tmp_path / "out", tell)
    assert stopped.passed
    assert stopped.stopped
    assert not complete.stopped
    assert complete.duration is not None
    assert stopped.duration is not None
    assert stopped.duration > 1.1 * complete.duration
    assert any("Ctrl-C takes it" in str(step) for step in steps)
    assert "the search was stopped" in " ".join(stopped.notes)
    assert load_plan(files["plan"]).stopped
    assert "stopped" not in complete.summary()
    assert signal.getsignal(signal.SIGINT) is before
    with pytest.raises(KeyboardInterrupt):
        plan(problem, interrupting(1))


def test_nothing_is_certified_yet_when_the_first_motion_is_planned(
    tilt_insert: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An interruption ends the program if no motion has passed the check yet."""
    problem = turning(tilt_insert, tilt=-138.5, roll=(30, -30))

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(certified, "plan_motion", interrupted)
    with pytest.raises(KeyboardInterrupt):
        plan(problem, stoppable=True)


@pytest.mark.parametrize("depth", [0.0208, 0.0235])
def test_no_other_joints_are_tried_for_a_target_in_the_retina(depth: float) -> None:
    """For a target in the retina, the plan does not try other joints or another limit.

    The tip position at the target does not depend on the joints that reach it.
    """
    eye_approach = load_problem(Path(__file__).parents[2] / "problems/eye_approach.yaml")
    joints = tuple(
        replace(joint, position=(-2 * np.pi, 2 * np.pi)) if k < 3 else joint
        for k, joint in enumerate(eye_approach.robot.joints)
    )
    motion = tuple(Free(Task(roll=0.0, tilt=-2.0, depth=depth), name=name) for name in "abc")
    robot = replace(eye_approach.robot, joints=joints, limits=())
    limits = (TaskRange("depth", 0.0, 0.03),)
    problem = replace(eye_approach, robot=robot, motion=motion, limits=limits)
    steps: list[Step] = []
    result = plan(problem, steps.append, relaxations=depth > 0.022)
    assert result.reason is not None
    assert result.reason.constraint == "retina clearance"
    assert result.reason.relaxation is None
    assert not any(step.step.startswith("other joints") for step in steps)
