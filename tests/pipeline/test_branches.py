"""Free motions over all joints that reach their targets: the other branch of the inverse kinematics, and whole turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssm_planner.kinematics.inverse import inverse_task
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.pipeline import run
from ssm_planner.pipeline.run import plan
from ssm_planner.plans import Plan
from ssm_planner.problem.limits import TaskRange
from ssm_planner.problem.motion import Dwell, Free, Joints, Straight, Task
from ssm_planner.problem.problem import Problem


def turning(problem: Problem, *, tilt: float, roll: tuple[float, float], limits: tuple[TaskRange, ...] = ()) -> Problem:
    """Roll freely at a tilt, deg; the robot has no ranges but these."""
    start = Task(roll=np.radians(roll[0]), tilt=np.radians(tilt), spin=0.0, depth=5e-3)
    motion = (Free(Task(roll=np.radians(roll[1]))),)
    robot = replace(problem.robot, limits=())
    return replace(problem, robot=robot, start=start, motion=motion, limits=limits, objective="time")


def ends(made: Plan) -> np.ndarray:
    return np.degrees(made.motion.sample(np.array([0.0, made.motion.duration])).q)


def test_the_other_branch_is_taken_where_it_is_faster(tilt_insert: Problem) -> None:
    made = plan(turning(tilt_insert, tilt=-138.5, roll=(30, -30)))
    assert made.passed
    assert made.duration == pytest.approx(0.7653, abs=1e-4)
    assert made.lower_bound == pytest.approx(made.duration, rel=1e-5)
    assert "free: goes from branch -1 of the inverse kinematics to branch +1" in made.notes
    here = turning(tilt_insert, tilt=-138.5, roll=(30, -30))
    first, _ = ends(made)
    straight = plan(replace(here, motion=(Free(Joints((np.radians(first[0] - 60), *np.radians(first[1:3]), -5e-3))),)))
    assert straight.duration == pytest.approx(1.2481, abs=1e-4)
    assert not any("branch" in note for note in straight.notes)


def test_a_branch_beyond_the_tilt_range_is_not_taken(tilt_insert: Problem) -> None:
    within = (TaskRange("tilt", np.radians(-139), np.radians(-81)),)
    made = plan(turning(tilt_insert, tilt=-138.5, roll=(30, -30), limits=within))
    assert made.passed
    assert made.duration == pytest.approx(1.2481, abs=1e-4)


def test_a_branch_is_found_where_the_nearest_joints_give_no_motion(tilt_insert: Problem) -> None:
    """The joints of the branch of the start lie beyond the range of joint 1."""
    free = turning(tilt_insert, tilt=-138.5, roll=(30, -30))
    first, _ = ends(plan(free))
    roll = replace(free.robot.joints[0], position=tuple(np.radians([first[0] - 40, first[0] + 10])))
    narrow = replace(free, robot=replace(free.robot, joints=(roll, *free.robot.joints[1:])))
    assert plan(narrow).duration == pytest.approx(0.7653, abs=1e-4)


def test_nothing_more_is_planned_where_no_other_joints_can_be_faster(
    tilt_insert: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    planned = []
    attempt = run._attempt
    monkeypatch.setattr(
        run, "_attempt", lambda problem, *rest, **how: (planned.append(problem), attempt(problem, *rest, **how))[1]
    )
    plan(turning(tilt_insert, tilt=-138.5, roll=(-30, 30)))
    assert len(planned) == 1


@pytest.mark.parametrize("seed", range(4))
def test_no_branch_planned_by_itself_is_faster(tilt_insert: Problem, seed: int) -> None:
    rng = np.random.default_rng(seed)
    near = np.radians([rng.uniform(-139.7, -136), rng.uniform(-84, -80)])
    start = Task(roll=rng.uniform(-1, 1), tilt=rng.choice(near), spin=rng.uniform(-1, 1), depth=5e-3)
    to = Task(roll=rng.uniform(-1, 1), tilt=rng.choice(near), spin=rng.uniform(-1, 1), depth=rng.uniform(0, 0.02))
    robot = replace(tilt_insert.robot, limits=())
    motion = (Free(to), Dwell(0.1), Straight(depth=1e-3))
    free = replace(tilt_insert, robot=robot, start=start, motion=motion, limits=(), objective="time")
    made = plan(free)
    assert made.passed
    mechanism = Mechanism.from_geometry(robot.geometry)
    goal = [[to.roll, to.tilt, to.spin, to.depth]]
    first = np.radians(ends(made)[0]) * (1, 1, 1, np.pi / 180)
    found = inverse_task(mechanism, goal, limits=[joint.position for joint in robot.joints], reference=first)
    for q in found.joints[0, found.valid[0]]:
        alone = plan(replace(free, motion=(Free(Joints(tuple(q.tolist()))), *motion[1:])), relaxations=False)
        assert alone.duration is None or made.duration <= alone.duration * (1 + 1e-5)
