"""Verify the structured solver against Ipopt, which solves the same programs on the same mesh.

The tests also verify that Ipopt confirms its optimum, that Ipopt replaces it if it does not
converge, and that the plan and its report name the solver.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from ssm_planner.elements.compiled import compiled_library
from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.loading.load import load_problem
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.lower_bound import rest_to_rest
from ssm_planner.planning.ocp import refinement, straight
from ssm_planner.planning.ocp.free import find_best_free, solve_free
from ssm_planner.planning.ocp.nlp import NlpSolution, stretched
from ssm_planner.planning.ocp.structured import NOT_CONVERGED, solve_structured
from ssm_planner.planning.ocp.transcription import Transcription
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.planner import plan_motion
from ssm_planner.planning.search import GAP
from ssm_planner.problem.limits import TaskRate, TipSpeed
from ssm_planner.problem.motion import Free, Joints, Straight, Task
from ssm_planner.problem.problem import Planner, Problem
from ssm_planner.problem.value import unchecked_copy
from ssm_planner.reporting.text import solver_and_condition_lines
from tests.support.cases import drawn
from tests.support.random_problems import random_problem

pytestmark = pytest.mark.skipif(
    not compiled_library(), reason="the package is built without its compiled part"
)
SAME = 1e-6
"""Relative tolerance for the durations of the two solvers."""
Solve = tuple[Any, Any, Any, Any, NlpSolution | None, NlpSolution]


@pytest.fixture
def solves(monkeypatch: pytest.MonkeyPatch) -> list[Solve]:
    """Return a list that records the arguments and the solution of every structured solve."""
    result: list[Solve] = []

    def noted(structure: Any, element: Any, data: Any, start: Any, **options: Any) -> NlpSolution:
        solution = solve_structured(structure, element, data, start, **options)
        result.append((structure, element, data, start, options.get("warm"), solution))
        return solution

    monkeypatch.setattr(refinement, "solve_structured", noted)
    return result


def fast(problem: Problem) -> Problem:
    """Return the problem with the planner that uses the structured solver alone."""
    return unchecked_copy(problem, planner="fast")


def gives_up(structure: Any, element: Any, data: Any, start: Any, **options: Any) -> NlpSolution:
    """Solve the program, but return the solution marked as not converged."""
    solution = solve_structured(structure, element, data, start, **options)
    return dataclasses.replace(solution, message=NOT_CONVERGED)


def agree(solves: list[Solve]) -> tuple[int, int]:
    """Assert that no converged solve is slower than Ipopt's optimum of the same program.

    Return the number of converged solves, and the number of those that Ipopt solved too. Only
    programs that minimise the time are compared.
    """
    converged = compared = 0
    for structure, element, data, start, _, own in solves:
        if not own.solved:
            continue
        converged += 1
        ipopt = Transcription.build(structure, element).solve(data, start)
        if ipopt.solved and element.aim == "time":
            compared += 1
            assert own.duration <= (1 + SAME) * ipopt.duration
    return converged, compared


@pytest.mark.parametrize(
    ("name", "jerk"),
    [
        ("tilt_insert", None),
        ("tilt_insert", 35.0),
        ("waypoints", None),
        ("waypoints", 35.0),
        ("laser_scan", None),
    ],
)
def test_shipped_problems(
    name: str, jerk: float | None, solves: list[Solve], with_jerk: Any
) -> None:
    """Every solve of the shipped problems converges and is no slower than Ipopt's."""
    problem = dataclasses.replace(load_problem(f"problems/{name}.yaml"), objective="time")
    if jerk is not None:
        problem = unchecked_copy(problem, robot=with_jerk(problem.robot, jerk, jerk / 10))
    planned = plan_motion(
        fast(problem), may_reverse=False
    )  # Ipopt alone solves motions with turning points
    assert planned.status == "solved"
    assert {phase.motion.solver for phase in planned.phases} <= {"structured", ""}
    converged, compared = agree(solves)
    assert converged == len(solves)
    assert compared


@pytest.mark.parametrize("seed", drawn(6, range(12)))
def test_random_problems(seed: int, solves: list[Solve], tilt_insert: Problem) -> None:
    """Each seed uses its first random problem that has a solve to compare with Ipopt's."""
    for more in range(10):
        try:
            problem = random_problem(tilt_insert, 100 + seed + 1000 * more, most=1)
        except ProblemError:
            continue
        plan_motion(fast(problem))
        if agree(solves)[1]:
            return
    pytest.fail("no solve was compared")


def test_a_plan_of_the_structured_solver_is_certified_and_names_its_solver(
    tilt_insert: Problem,
) -> None:
    """A plan by the structured solver passes the check, and its report names the solver."""
    ours, ipopts = (
        plan(dataclasses.replace(tilt_insert, planner=planner)) for planner in ("fast", "ipopt")
    )
    assert ours.certificate is not None
    assert ours.certificate.passed
    assert ours.duration == pytest.approx(ipopts.duration, rel=SAME)
    assert [phase.solver for phase in ours.phases] == ["structured"] * len(ours.phases)
    assert any(
        line.split() == ["solver", "structured"] for line in solver_and_condition_lines(ours)
    )
    assert not any(
        line.startswith(("solver", "confirmed")) for line in solver_and_condition_lines(ipopts)
    )


def test_ipopt_solves_where_it_does_not_converge(
    tilt_insert: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If the structured solver does not converge, Ipopt solves every phase."""
    monkeypatch.setattr(refinement, "solve_structured", gives_up)
    result = plan(fast(tilt_insert))
    assert result.certificate is not None
    assert result.certificate.passed
    assert {phase.solver for phase in result.phases} == {"Ipopt"}
    assert any(line.split() == ["solver", "Ipopt"] for line in solver_and_condition_lines(result))


def test_joints_that_turn_back_at_points_need_no_ipopt(
    monkeypatch: pytest.MonkeyPatch, solves: list[Solve]
) -> None:
    """A motion whose joints reverse at waypoints is solved although Ipopt cannot be called."""
    monkeypatch.delattr(Transcription, "solve")
    planned = plan_motion(fast(load_problem("problems/waypoints.yaml")))
    assert planned.status == "solved"
    assert any(structure.coordinates > 1 and len(structure.moves) > 4 for structure, *_ in solves)
    assert all(own.solved for *_, own in solves)


@pytest.mark.parametrize("planner", ["fast", "optimal"])
def test_ipopt_solves_alone_without_the_compiled_part(
    planner: Planner, tilt_insert: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without the compiled part, Ipopt solves every phase and confirms nothing."""
    problem = dataclasses.replace(tilt_insert, objective="time")
    monkeypatch.setenv("SSM_PLANNER_NATIVE", "0")
    result = plan(dataclasses.replace(problem, planner=planner))
    assert result.passed
    assert {phase.solver for phase in result.phases} == {"Ipopt"}
    assert result.confirmation is None
    assert result.duration == pytest.approx(sum(durations(problem, planner="ipopt")), rel=SAME)


@pytest.mark.parametrize(("tilt", "speed"), [(-95.0, 8e-3), (-95.0, 0.012), (-125.0, 0.012)])
def test_a_solution_is_where_its_neighbour_starts(
    tilt: float, speed: float, solves: list[Solve], tilt_insert: Problem
) -> None:
    """A solve that starts from a similar solution converges in at most 20 iterations."""
    to = Task(roll=0.3, tilt=np.radians(tilt), spin=-0.4, depth=0.02)
    problem = dataclasses.replace(
        tilt_insert,
        motion=(Free(to),),
        limits=(*tilt_insert.limits, TipSpeed(speed)),
        objective="time",
    )
    assert plan_motion(fast(problem)).status == "solved"
    warmly = [own for *_, warm, own in solves if warm is not None]
    assert warmly
    assert all(own.solved and own.iterations <= 20 for own in warmly)


def durations(problem: Problem, **changes: Any) -> list[float]:
    """Return the durations of all phases of a plan, in s."""
    return [phase.duration for phase in plan_motion(dataclasses.replace(problem, **changes)).phases]


@pytest.mark.parametrize("name", ["tilt_insert", "direct_reach"])
def test_ipopt_confirms_in_a_few_iterations_and_says_so(name: str) -> None:
    """Ipopt confirms each phase within 8 iterations, and the report states this."""
    problem = load_problem(f"problems/{name}.yaml")
    result = plan(problem)
    assert result.passed
    assert {phase.solver for phase in result.phases} == {"structured"}
    for phase in result.phases:
        # The solver computes the fastest motion first, and then the motion with the least heat.
        assert phase.confirmation_iterations is not None
        assert 0 <= phase.confirmation_iterations <= 8
        assert phase.confirmation_difference is not None
        assert abs(phase.confirmation_difference) <= SAME
        assert phase.confirmation_residual is not None
        assert 0 <= phase.confirmation_residual <= SAME
        assert phase.iterations > phase.confirmation_iterations
    assert result.duration == pytest.approx(sum(durations(problem, planner="ipopt")), rel=SAME)
    said = [line for line in solver_and_condition_lines(result) if line.startswith("confirmed")]
    assert len(said) == 1
    assert "Ipopt confirms" in said[0]
    assert "agree within" in said[0]


def free_phase(problem: Problem) -> Phase:
    """Return a phase with a free motion of all four joints from rest to rest."""
    points = np.array([[-0.5, 0.6, 0.0, 0.0], [0.3, -0.2, 0.5, -0.015]])
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    start, end = task_from_joints(mechanism, points)
    return Phase(problem, Free(Joints.from_array(points[1])), start, end, points)


def test_a_motion_above_the_cutoff_is_neither_cooled_nor_confirmed(
    tilt_insert: Problem, monkeypatch: pytest.MonkeyPatch, solves: list[Solve]
) -> None:
    """A motion longer than the cutoff of 1 ms is neither cooled nor confirmed by Ipopt."""
    monkeypatch.delattr(Transcription, "solve")
    phase = free_phase(tilt_insert)
    result = solve_free(phase, method="confirmed", cutoff=1e-3)
    assert result.solved
    assert result.duration > 1e-3
    assert [element.aim for _, element, *_ in solves] == ["time"]


def test_ipopt_confirms_joints_that_turn_back_at_points() -> None:
    waypoints = load_problem("problems/waypoints.yaml")
    planned = plan_motion(dataclasses.replace(waypoints, motion=waypoints.motion[:1])).phases[0]
    assert len(planned.motion.border_instants) > len(planned.phase.points)
    assert planned.motion.solver == "structured"
    assert planned.motion.confirmation is not None
    assert planned.motion.confirmation.iterations <= 8
    assert abs(planned.motion.confirmation.difference) <= SAME


def test_a_motion_without_torque_limits_that_bind_takes_the_time_of_its_slowest_joint(
    tilt_insert: Problem, weaker: Any
) -> None:
    """If no torque limit binds, the duration is the closed form of the slowest joint."""
    phase = free_phase(tilt_insert)
    result = solve_free(phase, method="confirmed")
    limits = ((joint.velocity, joint.acceleration) for joint in tilt_insert.robot.joints)
    alone = [
        rest_to_rest(abs(way), *most).duration
        for way, most in zip(phase.points[1] - phase.points[0], limits, strict=True)
    ]
    assert result.duration == pytest.approx(max(alone), rel=1e-6)
    weak = dataclasses.replace(tilt_insert, robot=weaker(tilt_insert.robot, 0.35))
    assert solve_free(free_phase(weak), method="confirmed").duration > 1.01 * max(alone)


def test_the_fastest_motion_is_confirmed_later_to_the_same_result(
    tilt_insert: Problem, weaker: Any
) -> None:
    """A fastest motion that is confirmed later has the bits of a motion confirmed at once."""
    problem = dataclasses.replace(
        tilt_insert, robot=weaker(tilt_insert.robot, 0.35), objective="time"
    )
    phase = free_phase(problem)
    complete = solve_free(phase, method="confirmed")
    fastest = solve_free(phase, method="confirmed", fastest_only=True)
    assert fastest.confirmation is None
    confirmed = find_best_free(fastest)
    assert confirmed.confirmation == complete.confirmation
    assert confirmed.coefficients.tobytes() == complete.coefficients.tobytes()
    assert fastest.duration == pytest.approx(complete.duration, rel=1e-6)


def test_ipopt_alone_where_there_is_nothing_to_confirm(
    tilt_insert: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If the confirmation or the structured solver fails, the plan is that of Ipopt alone."""
    problem = dataclasses.replace(
        tilt_insert, objective="time", motion=tilt_insert.motion[1:], start=tilt_insert.motion[0].to
    )
    alone = plan(dataclasses.replace(problem, planner="ipopt"))
    solve = Transcription.solve

    def does_not_confirm(self: Transcription, *given: Any, confirming: bool = False) -> NlpSolution:
        result = solve(self, *given, confirming=confirming)
        return (
            dataclasses.replace(result, message="Maximum_Iterations_Exceeded")
            if confirming
            else result
        )

    with monkeypatch.context() as patch:
        patch.setattr(Transcription, "solve", does_not_confirm)
        unconfirmed = plan(problem)
    with monkeypatch.context() as patch:
        patch.setattr(refinement, "solve_structured", gives_up)
        unsolved = plan(problem)
    for result in (unconfirmed, unsolved):
        assert result.passed
        assert result.confirmation is None
        assert result.motion.coefficients.tobytes() == alone.motion.coefficients.tobytes()


def test_the_shorter_motion_is_taken(tilt_insert: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    """If Ipopt's confirmation is 0.1 % slower, the plan keeps the structured motion."""
    problem = dataclasses.replace(tilt_insert, objective="time")
    solve = Transcription.solve

    def longer(self: Transcription, *given: Any, confirming: bool = False) -> NlpSolution:
        result = solve(self, *given, confirming=confirming)
        if not confirming:
            return result
        return dataclasses.replace(result, elements=stretched(result.elements, 1.001))

    monkeypatch.setattr(Transcription, "solve", longer)
    result = plan(problem)
    assert result.passed
    assert {phase.solver for phase in result.phases} == {"structured"}
    assert result.duration == pytest.approx(sum(durations(problem, planner="fast")), rel=1e-12)
    assert any(
        "differ by up to 1e-03: the shorter motion is used" in line
        for line in solver_and_condition_lines(result)
    )


@pytest.mark.parametrize("planner", ["fast", "optimal"])
def test_same_bits_in_any_order(tilt_insert: Problem, planner: Planner) -> None:
    """A plan has the same bits if another problem was planned in between."""
    other = load_problem("problems/waypoints.yaml")
    chosen = dataclasses.replace(tilt_insert, planner=planner)
    first = plan_motion(chosen).trajectory
    plan_motion(dataclasses.replace(other, planner=planner))
    again = plan_motion(chosen).trajectory
    assert first is not None
    assert again is not None
    assert np.asarray(first.coefficients).tobytes() == np.asarray(again.coefficients).tobytes()


@pytest.mark.parametrize("exceeds", [False, True])
def test_a_better_motion_of_ipopts_is_taken_if_it_keeps_every_row(
    exceeds: bool, tilt_insert: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A shorter motion of Ipopt replaces the structured one unless it exceeds a row.

    If it exceeds a row between the collocation points, the plan has no confirmation: Ipopt solves
    the problem alone and refines the mesh.
    """
    problem = dataclasses.replace(tilt_insert, objective="time", motion=tilt_insert.motion[:1])
    solve = Transcription.solve

    def shorter(self: Transcription, *given: Any, confirming: bool = False) -> NlpSolution:
        result = solve(self, *given, confirming=confirming)
        if not confirming:
            return result
        elements = result.elements.copy()
        elements[:, 1:4] *= 1.01 if exceeds else 1.0
        elements[:, -1] *= 1 - 1e-5
        return dataclasses.replace(result, elements=elements)

    monkeypatch.setattr(Transcription, "solve", shorter)
    result = plan(problem)
    assert result.passed
    assert {phase.solver for phase in result.phases} == {"Ipopt"}
    if exceeds:
        assert result.confirmation is None
    else:
        assert result.confirmation is not None
        assert result.confirmation[1] == pytest.approx(-1e-5, rel=0.1)


@pytest.mark.slow
def test_at_the_port_of_an_eye(solves: list[Solve]) -> None:
    """The row of the retina begins at a border between two segments, at the port."""
    problem = load_problem("eye_approach")
    quick, long = plan(fast(problem)), plan(unchecked_copy(problem, planner="ipopt"))
    assert quick.passed
    assert quick.duration <= (1 + 1e-4) * long.duration
    # The two solvers refine their meshes differently.
    assert quick.duration == pytest.approx(long.duration, rel=5e-4)
    assert solves
    assert all(solution.solved for *_, solution in solves)
    assert {phase.solver for phase in quick.phases} == {"structured"}
    confirmed = plan(problem)
    assert confirmed.confirmation is not None
    assert abs(confirmed.confirmation[1]) <= SAME
    assert confirmed.duration == pytest.approx(quick.duration, rel=2e-4)


@pytest.mark.parametrize("clearance", [5e-4, 1e-3])
@pytest.mark.parametrize("strength", [0.6, 1.0])
def test_into_an_eye_and_out_again(clearance: float, strength: float) -> None:
    """The structured solver alone plans the motion into the eye and back in the same time.

    The cases vary the clearance from the retina and the motor torque, and have no limits of task
    rates.
    """
    problem = load_problem("eye_approach")
    assert problem.eye is not None
    joints = tuple(
        joint
        if joint.motor is None
        else dataclasses.replace(
            joint, motor=unchecked_copy(joint.motor, max_torque=strength * joint.motor.max_torque)
        )
        for joint in problem.robot.joints
    )
    robot = dataclasses.replace(problem.robot, joints=joints)
    limits = tuple(item for item in problem.limits if not isinstance(item, TaskRate))
    eye = dataclasses.replace(problem.eye, clearance=clearance, lens=None)
    deep = Task(roll=-0.1, tilt=-2.05, spin=0.3, depth=0.016)
    durations = []
    for start, goal in ((problem.start, deep), (deep, problem.start)):
        outward = dataclasses.replace(
            problem, robot=robot, limits=limits, eye=eye, start=start, motion=(Free(goal),)
        )
        result = plan(fast(outward), relaxations=False)
        assert result.passed
        assert {phase.solver for phase in result.phases} == {"structured"}
        durations.append(result.duration)
    assert durations[0] == pytest.approx(durations[1], rel=GAP)


def faster_starting(problem: Problem, times: float, **to: float) -> Problem:
    """Return a problem with one straight motion and high jerk limits.

    Every joint can reach its largest acceleration in 1/times s.
    """
    joints = tuple(
        unchecked_copy(joint, jerk=times * joint.acceleration) for joint in problem.robot.joints
    )
    start = Task(tilt=np.radians(-85.0), depth=0.0)
    robot = unchecked_copy(problem.robot, joints=joints)
    return dataclasses.replace(
        problem, robot=robot, start=start, motion=(Straight(**to),), objective="time"
    )


@pytest.mark.parametrize(("depth", "times"), [(6e-3, 3.0), (29e-3, 10.0), (15e-3, 30.0)])
def test_a_jerk_limited_insertion_is_that_of_its_joint_alone(
    tilt_insert: Problem, depth: float, times: float
) -> None:
    """A straight insertion takes the closed-form time of the sliding joint under its jerk limit."""
    problem = faster_starting(tilt_insert, times, depth=depth)
    own = problem.robot.joints[3]
    result = plan(problem)
    assert result.certificate is not None
    assert result.certificate.passed
    closed_form = rest_to_rest(depth, own.velocity, own.acceleration, own.jerk).duration
    assert closed_form <= result.duration <= (1 + 1.5e-4) * closed_form


@pytest.mark.parametrize("to", [{"depth": 6e-3}, {}])
def test_jerk_limited_joints_in_step_are_as_fast_as_on_a_fine_mesh(
    tilt_insert: Problem, to: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The plan is at most 0.05 % slower than a plan on a mesh with four times as many elements."""
    problem = faster_starting(tilt_insert, 3.0, tilt=np.radians(-120.0), **to)
    result = plan(problem)
    monkeypatch.setattr(straight, "MIN_ELEMENTS", 4 * straight.MIN_ELEMENTS)
    fine = plan(fast(problem))
    assert result.duration <= (1 + 5e-4) * fine.duration
