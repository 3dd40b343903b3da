"""The package toppra computes the fastest timing on the paths of plans, without code of the
planner.

A plan that is faster than toppra breaks a limit. A plan that is slower is not optimal.
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from ssm_planner import Plan, Problem, load_plan, load_problem, plan
from ssm_planner.plans import (
    HEAT_OBJECTIVE_ALLOWANCE,
    LIMITS_IGNORED_BY_TOPPRA,
    TOO_FAST_DIFFERENCE,
)
from ssm_planner.problem import Dwell, Free, Robot
from ssm_planner.problem.value import unchecked_copy
from ssm_planner.trajectory import Trajectory, join_sections, rest_coefficients
from ssm_planner.verification import path_rows
from ssm_planner.verification.path_rows import PathRows
from ssm_planner.verification.second_opinion import (
    GRID_TOLERANCE,
    second_opinions,
    shortest_path_duration,
)
from tests.campaign.opinions import judged, weakened, with_friction
from tests.support.cases import drawn
from tests.support.paths import ROOT
from tests.support.random_problems import random_problem

SLOWER = 5e-4
"""Largest relative difference by which a plan on a given path is slower."""
SLOW_ERROR = 0.01
"""Relative error of durations along the paths of motions that are several times too slow."""
FREE_SLOWER = 2e-3
"""Largest relative difference of free motions on the coarser meshes of the planner `fast`."""


def assert_agreement(made: Plan) -> int:
    """Assert that toppra agrees with a certified plan. Return the number of judged phases."""
    assert made.passed, made.reason
    result = judged(made)
    assert result.passed, result.reason
    margins = {limit.name: limit.margin for limit in result.certificate.limits}  # type: ignore[union-attr]
    slowed = any(margins.get(name, 1.0) < 0.01 for name in LIMITS_IGNORED_BY_TOPPRA)
    traded = HEAT_OBJECTIVE_ALLOWANCE * (made.problem.objective == "time then heat")
    moving = [phase for phase in result.phases if phase.solver and phase.toppra_duration]
    for phase in moving:
        assert phase.toppra_duration >= phase.lower_bound  # type: ignore[operator]
        assert phase.path_bound is not None
        assert phase.lower_bound <= phase.path_bound <= (1 + TOO_FAST_DIFFERENCE) * phase.duration
        slower = traded + (FREE_SLOWER if phase.branch is None else SLOWER)
        assert phase.difference >= -TOO_FAST_DIFFERENCE
        assert slowed or made.problem.task_limits.rates or phase.difference <= slower, phase
    assert not any("lower bound" in (phase.not_judged or "") for phase in result.phases)
    return len(moving)


@pytest.mark.parametrize("name", ["tilt_insert", "eye_approach"])
def test_shipped_plans_are_as_fast_as_their_paths_allow(name: str) -> None:
    result = load_plan(ROOT / "results" / name)
    assert assert_agreement(result) == len(result.problem.motion)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["direct_reach", "laser_scan", "raven_reach", "rounded_corners", "waypoints"]
)
def test_other_shipped_problems(name: str) -> None:
    """Free motions of a requested duration are not judged."""
    result = plan(unchecked_copy(load_problem(name), planner="fast"))
    timed = sum(isinstance(entry, Free) and bool(entry.duration) for entry in result.problem.motion)
    assert assert_agreement(result) == sum(bool(phase.solver) for phase in result.phases) - timed


@pytest.mark.slow
@pytest.mark.parametrize("first", drawn(1, [0, 6]))
def test_random_plans(first: int) -> None:
    """No duration is below a proven bound, and toppra does not find a certified plan too fast."""
    base = load_problem("tilt_insert")
    count = 0
    for seed in range(first, first + 6 + first // 2):
        problem = unchecked_copy(random_problem(base, 94000 + seed), planner="fast")
        if problem.duration is None and not problem.robot.jerk_limited:
            result = plan(problem, relaxations=False)
            count += assert_agreement(result) if result.passed else 0
    assert count >= 4


@pytest.mark.parametrize("speed", [0.85, 0.5])
def test_the_timing_of_a_motion_does_not_count(speed: float) -> None:
    """The fastest duration depends on the path of a motion, and not on its timing."""
    result = load_plan(ROOT / "results/tilt_insert")
    motions = result.motion, result.motion.slower(speed)
    durations = [
        shortest_path_duration(
            motion, result.robot, result.limits, (0.0, motion.phases[0].end)
        ).duration
        for motion in motions
    ]
    assert durations[0] == pytest.approx(durations[1], rel=SLOW_ERROR)


def bang_bang(robot: Robot, joint: int, distance: float) -> tuple[Trajectory, float]:
    """Return a slow cubic motion of one joint, and the duration of its fastest motion."""
    limits = robot.joints[joint]
    q = np.zeros((2, 4)) + [0.3, 1.15, 0.1, 0.0]
    q[1, joint] += distance
    motion = Trajectory.from_samples([0.0, 1.5], q, np.zeros((2, 4)))
    cruise = distance / limits.velocity - limits.velocity / limits.acceleration
    if cruise < 0:
        return motion, 2 * np.sqrt(distance / limits.acceleration)
    return motion, 2 * limits.velocity / limits.acceleration + cruise


@pytest.mark.parametrize("distance", [0.1, 0.9])
def test_a_joint_without_a_drive_counts(distance: float) -> None:
    """The spin of the shipped robot has no drive, and only its own limits bind."""
    problem = load_problem("tilt_insert")
    assert problem.robot.joints[2].drive is None
    motion, expected = bang_bang(problem.robot, 2, distance)
    duration = shortest_path_duration(
        motion, problem.robot, problem.task_limits, (0.0, 1.5)
    ).duration
    assert duration == pytest.approx(expected, rel=SLOW_ERROR)


def test_rests_within_a_phase_keep_their_duration() -> None:
    problem = load_problem("tilt_insert")
    motion, expected = bang_bang(problem.robot, 2, 0.4)
    rest = np.array([0.0, 0.7]), rest_coefficients(motion.sample([1.5]).q[0])
    both = join_sections([("", motion.breaks, motion.coefficients), ("", *rest)])
    duration = shortest_path_duration(both, problem.robot, problem.task_limits, (0.0, 2.2)).duration
    assert duration == pytest.approx(expected + 0.7, rel=SLOW_ERROR)


@pytest.mark.parametrize("joint", [0, 2])
@pytest.mark.parametrize("distance", [0.05, 0.1, 0.4, 0.9])
def test_a_bang_bang_motion_has_its_exact_duration(joint: int, distance: float) -> None:
    problem = load_problem("tilt_insert")
    motion, expected = bang_bang(problem.robot, joint, distance)
    opinion = shortest_path_duration(motion, problem.robot, problem.task_limits, (0.0, 1.5))
    assert opinion.duration == pytest.approx(expected, rel=GRID_TOLERANCE)


def test_motions_before_and_after_a_rest_have_their_exact_durations() -> None:
    """The path speed may jump in a rest, and the rest keeps its duration."""
    problem = load_problem("tilt_insert")
    motion, expected = bang_bang(problem.robot, 2, 0.4)
    ends = motion.sample([1.5, 0.0]).q
    back = Trajectory.from_samples([0.0, 0.9], ends, np.zeros((2, 4)))
    parts = [(motion.breaks, motion.coefficients), ([0.0, 0.7], rest_coefficients(ends[0]))]
    parts.append((back.breaks, back.coefficients))
    whole = join_sections([("", np.array(breaks), pieces) for breaks, pieces in parts])
    span = 0.0, float(whole.breaks[-1])
    opinion = shortest_path_duration(whole, problem.robot, problem.task_limits, span)
    assert opinion.duration == pytest.approx(2 * expected + 0.7, rel=GRID_TOLERANCE)


@pytest.mark.parametrize("count", [400, 800, 1600])
@pytest.mark.parametrize("pieces_per_wave", [4, 8])
def test_oscillations_of_the_polynomials_do_not_change_the_duration(
    count: int, pieces_per_wave: int
) -> None:
    """The acceleration oscillates by 1 % of its limit, but the path of the joint is the same."""
    problem = load_problem("tilt_insert")
    motion, expected = bang_bang(problem.robot, 2, 0.4)
    t = np.linspace(0.0, 1.5, count + 1)
    samples = motion.sample(t)
    frequency = 2 * np.pi * count / (1.5 * pieces_per_wave)
    size = 0.01 * problem.robot.joints[2].acceleration / frequency**2
    window = 2 * np.pi / 1.5
    # The product of (1 − cos) / 2 and a sine is a sum of three sines.
    for state, order in ((samples.q, 0), (samples.qd, 1), (samples.qdd, 2)):
        for share, rate in (
            (0.5, frequency),
            (-0.25, frequency - window),
            (-0.25, frequency + window),
        ):
            wave = np.sin(rate * t + 0.7 + order * np.pi / 2)
            state[:, 2] += size * share * rate**order * wave
    oscillating = Trajectory.from_samples(t, samples.q, samples.qd, samples.qdd)
    opinion = shortest_path_duration(oscillating, problem.robot, problem.task_limits, (0.0, 1.5))
    assert opinion.duration == pytest.approx(expected, rel=GRID_TOLERANCE)


def test_a_phase_at_rest_keeps_its_duration() -> None:
    """Toppra and the bound give the duration of a dwell, because no joint moves."""
    problem = load_problem("tilt_insert")
    breaks, coefficients = np.array([0.0, 0.2]), rest_coefficients(np.array([0.3, 1.15, 0.1, 0.0]))
    motion = Trajectory(breaks, coefficients, ())
    opinion = shortest_path_duration(motion, problem.robot, problem.task_limits, (0.0, 0.2))
    assert opinion.duration == pytest.approx(0.2, rel=1e-6)
    assert opinion.bound == pytest.approx(0.2, rel=1e-6)


@pytest.mark.parametrize("name", ["tilt_insert", "eye_approach"])
def test_the_duration_does_not_depend_on_the_grid(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The error of toppra's extrapolated duration is at most GRID_TOLERANCE."""
    result = load_plan(ROOT / "results" / name)
    durations = []
    for intervals in (path_rows.PATH_INTERVALS, 500):
        monkeypatch.setattr(path_rows, "PATH_INTERVALS", intervals)
        opinions = second_opinions(result.motion, result.problem)
        durations.append([opinion.duration for opinion in opinions])
    assert durations[0] == pytest.approx(durations[1], rel=GRID_TOLERANCE)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [471100016004, 471100071007])
def test_a_duration_below_a_proven_bound_is_computed_on_finer_grids(seed: int) -> None:
    """Coarse grids of these motions converge to a duration that is 1.1e-5 or 1.6e-5 too short."""
    problem = unchecked_copy(random_problem(load_problem("tilt_insert"), seed), planner="fast")
    result = judged(plan(problem, relaxations=False))
    assert [phase.not_judged for phase in result.phases] == [None] * len(result.phases)


def test_sections_end_where_the_acceleration_jumps_or_a_joint_reverses() -> None:
    """Intervals cross a break only if the motion is smooth there and no joint turns."""
    problem = load_problem("tilt_insert")
    motion, _ = bang_bang(problem.robot, 2, 0.4)
    t = np.linspace(0.0, 1.5, 403)  # the joint reverses within a group of 8 pieces
    samples = motion.sample(t)
    smooth = Trajectory.from_samples(t, samples.q, samples.qd, samples.qdd)
    back = smooth.sample(t[::-1])
    there_and_back = Trajectory.from_samples(
        np.append(t, 1.5 + t[1:]),
        np.vstack([samples.q, back.q[1:]]),
        np.vstack([samples.qd, -back.qd[1:]]),
        np.vstack([samples.qdd, back.qdd[1:]]),
    )
    for whole in (smooth, there_and_back):
        end = float(whole.breaks[-1])
        path = PathRows.from_trajectory(whole, problem.robot, (0.0, end), 1)
        pieces = len(whole.breaks) - 1
        # Every group of eight pieces is a section, whose number of intervals is rounded up.
        density = max(path_rows.PATH_INTERVALS, pieces / path_rows.PIECES_PER_INTERVAL)
        assert len(path.lengths) <= 1.1 * (density + pieces / 8)
        assert path.lengths.sum() == pytest.approx(end)
        assert (np.abs(path.direction[:, 2]) == 1).all()


@pytest.mark.parametrize(
    "strength", [0.86, 0.94, *(pytest.param(s, marks=pytest.mark.slow) for s in (0.9, 0.98))]
)
def test_friction_that_the_planner_underestimates_is_noticed(strength: float) -> None:
    """The planner sees 1 % less friction than the robot has, and torque limits the motion."""
    problem = weakened(strength)
    honest = judged(plan(problem, relaxations=False))
    assert honest.passed
    smooth = with_friction(problem.robot, 0.99)
    wrong = judged(plan(replace(problem, robot=smooth), relaxations=False), problem.robot)
    assert not wrong.passed
    assert wrong.reason is not None
    assert "the cross-check failed: tilt takes" in wrong.reason.message


def test_it_says_why_it_cannot_judge() -> None:
    """The result names the reason for each phase that is not judged."""
    result = load_plan(ROOT / "results/tilt_insert")
    problem = result.problem
    joints = problem.robot.joints
    jerky = replace(problem.robot, joints=(replace(joints[0], jerk=1e3), *joints[1:]))
    tilt, insert = problem.motion
    for changes, reasons in (
        ({"robot": jerky}, ["toppra ignores limits on jerk"] * 2),
        ({"payload": (0.0, 0.01)}, ["toppra ignores ranges of friction and payload"] * 2),
        ({"duration": 9.0}, ["a duration is requested"] * 2),
        ({"motion": (tilt, replace(insert, duration=2.0))}, [None, "a duration is requested"]),
        ({"motion": (tilt, Dwell(1.2))}, [None, None]),
    ):
        opinions = second_opinions(result.motion, unchecked_copy(problem, **changes))
        assert [opinion.not_judged for opinion in opinions] == reasons


def test_nothing_of_the_planner_is_loaded_on_its_way() -> None:
    """A new process judges a stored motion without loading the modules of the planner."""
    code = (
        "import json, sys\n"
        "from ssm_planner.problem.serialization import problem_from_plain\n"
        "from ssm_planner.trajectory import Trajectory\n"
        "from ssm_planner.verification.second_opinion import second_opinions\n"
        "data = json.load(open(sys.argv[1], encoding='utf-8'))\n"
        "problem = problem_from_plain(data['problem'], file='plan.json')\n"
        "opinions = second_opinions(Trajectory.from_dict(data['trajectory']), problem)\n"
        "rooms = ('planning', 'elements', 'interior', 'pipeline')\n"
        "loaded = [m for m in sys.modules if m.startswith(tuple(f'ssm_planner.{r}' for r in rooms))]\n"
        "print(json.dumps([[o.duration for o in opinions], loaded]))\n"
    )
    command = [sys.executable, "-c", code, str(ROOT / "results/tilt_insert/plan.json")]
    result = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert result.returncode == 0, result.stderr
    opinions, loaded = json.loads(result.stdout)
    assert not loaded
    assert all(isinstance(duration, float) for duration in opinions)


def test_a_phase_that_takes_no_time_has_the_duration_0(tilt_insert: Problem) -> None:
    output = plan(replace(tilt_insert, motion=(*tilt_insert.motion, tilt_insert.motion[-1])))
    assert output.phases[-1].duration == 0.0
    assert second_opinions(output.motion, output.problem)[-1].duration == 0.0
    result = judged(output)
    assert result.passed
    assert result.path_bound == pytest.approx(
        output.duration, rel=SLOWER + HEAT_OBJECTIVE_ALLOWANCE
    )
