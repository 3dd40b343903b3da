"""The check of a task accepts a shipped motion for its own problem, and refuses it for others."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.loading.load import load_problem
from ssm_planner.plans import load_plan
from ssm_planner.problem.motion import Dwell, Follow, Free, Joints, Scan, Straight, Task, Tip
from ssm_planner.problem.problem import Problem
from ssm_planner.trajectory import Trajectory
from ssm_planner.verification.certificate import Certificate
from ssm_planner.verification.visits import with_task_results
from tests.support.cli import run
from tests.support.paths import PROBLEMS, ROOT

SHIPPED = ROOT / "results/tilt_insert"
EMPTY = Certificate((), "x", 0)
TILT, INSERT = load_problem(PROBLEMS / "tilt_insert.yaml").motion


@pytest.fixture(scope="module")
def problem() -> Problem:
    return load_problem(PROBLEMS / "tilt_insert.yaml")


@pytest.fixture(scope="module")
def table() -> Trajectory:
    """Return the shipped motion as a table without phases."""
    motion = load_plan(SHIPPED).motion
    return Trajectory(motion.breaks, motion.coefficients, ())


def broken(motion: Trajectory, problem: Problem) -> set[str]:
    return {line.name for line in with_task_results(EMPTY, motion, problem).violations}


def asking(problem: Problem, *motion: object, **changes: object) -> Problem:
    return replace(problem, motion=motion, **changes)


def holding(motion: Trajectory, pauses: Iterable[tuple[int, float]]) -> Trajectory:
    """Return a motion with rests before the pieces of the given indices.

    `pauses` has pairs of an index and a duration in s.
    """
    breaks, pieces = list(motion.breaks), list(motion.coefficients)
    for k, pause in sorted(pauses, reverse=True):
        rest = np.zeros((6, 4))
        rest[0] = motion.positions(motion.breaks[k : k + 1])[0]
        pieces.insert(k, rest)
        breaks = [*breaks[: k + 1], *(t + pause for t in breaks[k:])]
    return Trajectory(np.array(breaks), np.array(pieces), ())


def knot(motion: Trajectory) -> int:
    """Return the index of the break at which the robot rests between its two motions."""
    phase = load_plan(SHIPPED).motion.phases[0]
    return int(np.argmin(np.abs(motion.breaks - phase.end)))


def test_a_motion_does_what_its_problem_asks(table: Trajectory, problem: Problem) -> None:
    result = with_task_results(EMPTY, table, problem)
    assert result.verdict == "kept"
    assert {line.name for line in result.limits} == {"target", "path departure"}
    plan = load_plan(SHIPPED).motion
    assert with_task_results(EMPTY, plan, problem).verdict == "kept"


@pytest.mark.parametrize(
    "motion",
    [
        (Straight(tilt=np.deg2rad(-120.0)), Straight(depth=0.005)),
        (TILT, Straight(depth=0.0201)),
        (replace(TILT, tilt=TILT.tilt + 1e-3), INSERT),
        (INSERT, TILT),
        (TILT,),
        (TILT, INSERT, Straight(roll=0.1)),
        (TILT, INSERT, TILT, Straight(depth=0.0)),
        (TILT, Free(Task(depth=0.02, tilt=-1.5))),
    ],
)
def test_another_target_or_order_is_not_reached(
    table: Trajectory, problem: Problem, motion: tuple[object, ...]
) -> None:
    assert "target" in broken(table, asking(problem, *motion))


def test_another_start_is_refused(table: Trajectory, problem: Problem) -> None:
    start = replace(problem.start, roll=0.02)
    assert broken(table, replace(problem, start=start)) >= {"target"}


def test_points_of_every_kind_are_the_same_point(table: Trajectory, problem: Problem) -> None:
    """A target has joint positions, a tip position or task coordinates."""
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    end = table.positions(table.breaks[-1:])
    roll, tilt, spin, depth = task_from_joints(mechanism, end)[0]
    from ssm_planner.kinematics.forward import tip_position

    x, y, z = tip_position(mechanism, end)[0]
    kinds = (Joints(tuple(end[0])), Tip((x, y, z), spin), Task(roll, tilt, spin, depth))
    for to in kinds:
        assert not broken(table, asking(problem, TILT, Free(to)))
    for to in (Joints((*end[0, :3], end[0, 3] + 2e-5)), Tip((x + 2e-5, y, z), spin)):
        assert broken(table, asking(problem, TILT, Free(to))) == {"target"}
    turned = Tip((x, y, z), spin + 0.1)
    assert broken(table, asking(problem, TILT, Free(turned))) == {"target"}
    assert not broken(table, asking(problem, TILT, Free(turned, spin_free=True)))


def test_waypoints_are_passed_in_order(table: Trajectory, problem: Problem) -> None:
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    t = np.array([0.3, 0.55, 0.8]) * load_plan(SHIPPED).motion.phases[0].end
    on_way = [Task(tilt=float(task[1])) for task in task_from_joints(mechanism, table.positions(t))]
    through = Follow(TILT.to, through=tuple(on_way))
    assert not broken(table, asking(problem, through, INSERT))
    back = Follow(TILT.to, through=tuple(on_way[::-1]))
    assert broken(table, asking(problem, back, INSERT)) >= {"waypoint"}
    aside = Follow(TILT.to, through=(replace(on_way[1], roll=0.001),))
    assert broken(table, asking(problem, aside, INSERT)) >= {"waypoint"}


@pytest.mark.parametrize("pause", [0.2, 1.0])
def test_a_dwell_lasts_as_long_as_asked(table: Trajectory, problem: Problem, pause: float) -> None:
    k, n = knot(table), len(table.breaks) - 1
    request = asking(problem, TILT, Dwell(pause), INSERT)
    assert broken(table, request) == {"dwell"}
    assert broken(holding(table, [(k, 0.8 * pause)]), request) == {"dwell"}
    assert not broken(holding(table, [(k, pause)]), request)
    at_end = asking(problem, TILT, INSERT, Dwell(pause))
    assert broken(table, at_end) == {"dwell"}
    assert not broken(holding(table, [(n, pause)]), at_end)
    twice = asking(problem, TILT, Dwell(pause), Dwell(pause), INSERT)
    assert broken(holding(table, [(k, pause)]), twice) == {"dwell"}
    assert not broken(holding(table, [(k, 2 * pause)]), twice)


def test_durations_are_those_of_the_problem(table: Trajectory, problem: Problem) -> None:
    phase = load_plan(SHIPPED).motion.phases[0]
    length = phase.end - phase.start
    for factor, late in ((1.0, False), (0.9, True), (1.1, True)):
        timed = asking(problem, replace(TILT, duration=factor * length), INSERT)
        assert ("duration" in broken(table, timed)) == late


@pytest.mark.parametrize("factor", [0.5, 0.97, 1.03, 2.0])
def test_the_duration_of_the_whole_motion_counts(
    table: Trajectory, problem: Problem, factor: float
) -> None:
    request = replace(problem, objective="effort", duration=table.duration)
    assert not broken(table, request)
    late = replace(problem, objective="effort", duration=factor * table.duration)
    assert broken(table, late) == {"duration"}


@pytest.mark.parametrize("joint", [0, 2, 3])
@pytest.mark.parametrize("aside", [1e-5, 1e-3, 0.05])
def test_a_table_that_leaves_its_line_is_noticed(
    table: Trajectory, problem: Problem, joint: int, aside: float
) -> None:
    """Another joint moves back and forth during the tilt. The spin does not move the tip."""
    k = knot(table)
    coefficients = table.coefficients.copy()
    shares = np.linspace(0.0, np.pi, k + 1)
    values = np.append(aside * np.sin(shares) ** 2, np.zeros(len(table.breaks) - 1 - k))
    slopes = np.diff(values) / np.diff(table.breaks)
    coefficients[:, 0, joint] += values[:-1]
    coefficients[:, 1, joint] += slopes
    bent = Trajectory(table.breaks, coefficients, ())
    result = with_task_results(EMPTY, bent, problem)
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    from ssm_planner.kinematics.forward import tip_position

    tips = [
        tip_position(mechanism, motion.positions(table.breaks[: k + 1])) for motion in (bent, table)
    ]
    distance = np.linalg.norm(tips[0] - tips[1], axis=1).max()
    (departure,) = (line for line in result.limits if line.name == "path departure")
    assert departure.worst <= distance + 2e-6
    if joint == 0:  # The roll moves the tip across its line.
        assert departure.worst == pytest.approx(distance, rel=0.05, abs=1e-6)
        assert (departure.margin < 0) == (departure.worst > 1e-5)


def test_lines_of_a_plan_are_left_to_the_check(problem: Problem) -> None:
    """The check of a plan with phases judges its lines, so they are not judged twice."""
    result = with_task_results(EMPTY, load_plan(SHIPPED).motion, problem)
    assert "path departure" not in {line.name for line in result.limits}


def test_rounded_corners_and_constant_speeds_of_tables_are_not_judged(
    table: Trajectory, problem: Problem
) -> None:
    rounded = asking(problem, replace(TILT, blend=0.0005), INSERT)
    assert [u.name for u in with_task_results(EMPTY, table, rounded).unjudged] == [
        "corner rounding"
    ]


def test_targets_of_an_unknown_problem_are_not_judged(table: Trajectory, problem: Problem) -> None:
    """The targets and lines of a problem with a scan are not judged for a table."""
    eye = load_problem(PROBLEMS / "eye_approach.yaml").eye
    spots = Scan(Task(tilt=-2.0), 0.0015, rows=2, columns=2)
    result = with_task_results(EMPTY, table, asking(problem, TILT, spots, INSERT, eye=eye))
    assert [u.name for u in result.unjudged] == ["target", "path departure"]


def test_the_command_judges_the_task(tmp_path: Path) -> None:
    own = PROBLEMS / "tilt_insert.yaml"
    assert run("check", SHIPPED, "--problem", own) == 0
    other = tmp_path / "other.yaml"
    text = own.read_text(encoding="utf-8").replace("-135 deg", "-120 deg")
    other.write_text(text.replace("robots/", f"{PROBLEMS}/robots/"), encoding="utf-8")
    assert run("check", SHIPPED, "--problem", other) == 1


def test_joint_targets_are_positions_of_joints_and_not_poses(
    table: Trajectory, problem: Problem
) -> None:
    """A whole turn of the roll axis leads to the same pose, but not to the same joint positions."""
    first, last = (tuple(q) for q in table.positions(table.breaks[[0, -1]]).tolist())
    turned = (last[0] - 2 * np.pi, *last[1:])
    for target, expected in ((last, set()), (turned, {"target"})):
        request = asking(problem, Free(Joints(target)), start=Joints(first))
        assert broken(table, request) == expected
