"""The complete program: plan, check, determine motor requirements, and write files.

`plan` plans a problem in memory, `Replanner` plans it repeatedly with other starts and targets, and
`plan_to_folder` writes the results. The command line calls these functions.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import RLock

import numpy as np

from ssm_planner.arguments import checked
from ssm_planner.deprecation import renamed_arguments
from ssm_planner.errors import ProblemError
from ssm_planner.kinematics import Mechanism, task_from_joints, task_rates
from ssm_planner.loading.load import load_problem
from ssm_planner.pipeline.certified import Outcome, plan_and_check
from ssm_planner.pipeline.folder import NO_PLAN, write_folder
from ssm_planner.pipeline.mission import plan_mission
from ssm_planner.pipeline.relaxation import changes_of_limits, find_relaxation
from ssm_planner.pipeline.thermal import ThermalSearch, with_fast_planner
from ssm_planner.planning.candidates.stop_first import stopping_point
from ssm_planner.planning.motor_strength import check_thermal_bound
from ssm_planner.planning.planned_phase import PlannedPhase
from ssm_planner.planning.planner import PlannerResult, plan_motion
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.tolerances import GAP, ROUNDING_TOLERANCE
from ssm_planner.planning.work import Work
from ssm_planner.plans import PhaseSummary, Plan
from ssm_planner.problem import (
    TASK_COORDINATES,
    ContinuousTorque,
    Free,
    Joints,
    Motion,
    Point,
    Problem,
    Straight,
    Task,
    unchecked_copy,
)
from ssm_planner.progress import Progress, Step, silent
from ssm_planner.reporting.figures.process import FigureProcess
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, frozen
from ssm_planner.verification.limits import JUMP_TOLERANCE
from ssm_planner.verification.promises import PromiseResult, check_path_promises
from ssm_planner.verification.stops import quickest_stops

_ONE_AT_A_TIME = RLock()
"""Plans share programs and solutions, so only one thread plans at a time.

Two threads would not be faster, since Python runs one of them.
"""


@renamed_arguments(found="on_solution", cured="on_relaxation")
@checked
def plan(
    problem: Problem | str | Path,
    progress: Progress = silent,
    on_solution: Callable[[Trajectory], None] = lambda _: None,
    relaxations: bool = True,
    on_relaxation: Callable[[Problem], None] = lambda _: None,
    stoppable: bool = False,
) -> Plan:
    """Plan a problem, and check the motion by independent code.

    An infeasible problem does not raise. The plan then holds the reason and, unless `relaxations`
    is false, the smallest change of a limit that gives a motion. Threads may call this function.
    They wait for each other.

    Parameters
    ----------
    problem : Problem or file
        The problem, its file, or the name of a shipped problem.
    progress : callable
        Called with each step, which the logger "ssm_planner" receives too. An exception that it
        raises cancels the planning.
    on_solution : callable
        Called with each motion before it is checked.
    relaxations : bool
        Look for a change of a limit if there is no motion.
    on_relaxation : callable
        Called with the relaxed problem, which has a motion.
    stoppable : bool
        The first Ctrl-C during the search for alternative joints ends that search. The plan is then
        the best one so far, with `Plan.stopped` set.

    Returns
    -------
    Plan
        The plan, or the reason of the failure.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> plan = ssm.plan("tilt_insert")
    >>> plan.passed, round(plan.duration, 3)
    (True, 3.349)
    """
    if not isinstance(problem, Problem):
        problem = load_problem(problem)

    def _report(step: Step) -> None:
        """Pass a step to the logger and to the caller."""
        logging.getLogger("ssm_planner").info(step)
        progress(step)

    work = Work()
    motions: list[Trajectory] = []

    def _show(trajectory: Trajectory) -> None:
        """Remember a motion before its check, and pass it to the caller."""
        motions.append(trajectory)
        on_solution(trajectory)

    # Some relaxations follow from the motion that gets too warm. Without relaxations it is not
    # needed.
    def _plan_candidate(candidate: Problem) -> Outcome:
        """Plan and check a problem with some joints at its targets."""
        return _plan_check_and_cool(candidate, work, _report, _show, may_overheat=relaxations)

    with _ONE_AT_A_TIME:
        start = time.perf_counter()
        outcome, final_problem, stopped = plan_mission(
            problem, _plan_candidate, work, _report, stoppable=stoppable
        )
        result, reason = outcome.planned, outcome.reason
        if result.trajectory is not None and motions[-1] is not result.trajectory:
            on_solution(result.trajectory)
        if reason is not None and relaxations:
            _report(Step("looking for a relaxation"))
            reason = _with_relaxation(problem, outcome, reason, work, on_relaxation)
        return Plan(
            problem=problem,
            status=result.status,
            trajectory=result.trajectory,
            phases=_summaries(problem, result),
            certificate=outcome.certificate,
            reason=reason,
            nominal_duration=_nominal_duration(final_problem, _report) if reason is None else None,
            solve_time=time.perf_counter() - start,
            stopped=stopped,
            candidates=result.candidates,
        )


def _with_relaxation(
    problem: Problem,
    outcome: Outcome,
    reason: Reason,
    work: Work,
    on_relaxation: Callable[[Problem], None],
) -> Reason:
    """Return the reason of a failure, with the smallest change of a limit that gives a motion.

    Parameters
    ----------
    problem : Problem
        The problem.
    outcome : Outcome
        The failure, perhaps with a motion that failed its check.
    reason : Reason
        Reason of the failure.
    work : Work
        Counter of the work.
    on_relaxation : callable
        Called with the relaxed problem if it has a motion.

    Returns
    -------
    Reason
        The reason, whose field `relaxation` describes the change in words. The field remains None
        if the search finds nothing.
    """
    trajectory = outcome.planned.trajectory
    # The fastest motion is planned soonest, but it is warmer than the requested one.
    any_suffices = not isinstance(reason.limit, ContinuousTorque)
    attempt = find_relaxation(
        problem,
        reason,
        partial(_duration_or_reason, work=work),
        None if trajectory is None else trajectory.duration,
        feasible=partial(_find_any_motion, work=work, any_suffices=any_suffices),
        work=work,
    )
    if attempt is None:
        return reason
    if attempt.works:
        on_relaxation(attempt.problem)
    return replace(reason, relaxation=attempt.text)


@frozen
class Replanner:
    """Planner for one problem with changing starts and targets, for control loops and studies.

    It uses the structured solver without Ipopt's confirmation, as `planner: fast` does, unless the
    problem names another planner.

    Programs and compiled functions are built once and cached for the last dozen structures of
    motions, so memory does not grow. A plan does not depend on earlier plans, to the last bit.
    Threads may share a replanner.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> replanner = ssm.Replanner(ssm.load_problem("tilt_insert"))
    >>> replanner.problem.name
    'tilt_insert'
    """

    problem: Problem
    """Everything except for the arguments of `plan`."""

    def plan(
        self,
        start: Point | None = None,
        target: Point | None = None,
        rates: Mapping[str, float] | None = None,
    ) -> Plan:
        """Plan from another start, with other rates there, or to another target. SI units.

        The target replaces that of the last motion that has one. Task coordinates that a Task does
        not name are those of the problem. Rates that are not named are 0. The plan has passed the
        check, or holds the reason, without a search for relaxations.

        Parameters
        ----------
        start : Point, optional
            Start of the motion. By default that of the problem.
        target : Point, optional
            Target of the last motion that has one. By default that of the problem.
        rates : mapping of str to float, optional
            Rates of the task coordinates at the start by name, rad/s and m/s. By default those of
            the problem.

        Returns
        -------
        Plan
            The plan, or the reason of the failure.

        Raises
        ------
        ProblemError
            If a point is impossible, if no motion has a target, or if the target must be given in
            task coordinates.
        """
        origin = self.problem.start if start is None else _complete_point(self.problem.start, start)
        motion = self.problem.motion if target is None else self._motions_to(target)
        begins = self.problem.start_rate if rates is None else rates
        return plan(
            with_fast_planner(
                replace(self.problem, start=origin, start_rate=begins, motion=motion)
            ),
            relaxations=False,
        )

    def plan_from(self, motion: Plan | Trajectory, at: float, target: Point | None = None) -> Plan:
        """Plan from an instant of a motion, with the velocity that the robot has then.

        The plan has passed the check, or holds the reason, without a search for relaxations.

        Parameters
        ----------
        motion : Plan or Trajectory
            Motion that the robot executes.
        at : float
            Time since the start of this motion, s.
        target : Point, optional
            Target of the last motion of the problem that has one. Task coordinates that it omits
            keep their values. By default the target of the problem.

        Returns
        -------
        Plan
            The plan, or the reason of the failure.

        Raises
        ------
        ProblemError
            If `at` is not an instant of the motion, if no motion has a target, or if the target
            must be given in task coordinates.
        """
        there = starting_from(
            replace(self.problem, motion=self._motions_to(target)) if target else self.problem,
            motion,
            at,
        )
        return plan(with_fast_planner(there), relaxations=False)

    def _motions_to(self, target: Point) -> tuple[Motion, ...]:
        """Return the motion list of the problem with another target of its last motion.

        Parameters
        ----------
        target : Point
            Target of the last motion that has one. Task coordinates that it omits keep their
            values.

        Returns
        -------
        tuple of Motion
            The motion list, in which only the target of one motion differs.

        Raises
        ------
        ProblemError
            If no motion has a target, or if the target of a straight motion is not given in task
            coordinates.
        """
        motions = list(self.problem.motion)
        has_target = [isinstance(entry, (Straight, Free)) for entry in motions]
        if not any(has_target):
            raise ProblemError("no motion of this problem has a target", key="target", value=target)
        last = int(np.flatnonzero(has_target)[-1])
        entry = motions[last]
        if isinstance(entry, Free):
            motions[last] = replace(entry, to=_complete_point(entry.to, target))
        elif isinstance(target, Task):
            motions[last] = unchecked_copy(entry, **target.set_coordinates)
        else:
            reason = "a straight motion is one of task coordinates"
            raise ProblemError(
                reason, key="target", value=target, allowed="roll, tilt, spin, depth"
            )
        return tuple(motions)


def starting_from(problem: Problem, motion: Plan | Trajectory, at: float) -> Problem:
    """Return the problem with an instant of a motion as its start.

    `Replanner.plan_from` calls this function, for example if a robot gets a new target while it
    moves. Only a free motion (whose path the planner chooses) can begin at any velocity. If the
    first motion of the problem is of another kind, a free motion named "stop" precedes it, in which
    every joint brakes nearly as hard as it can. If this motion would leave a range of task
    coordinates, it ends at the end of the quickest stop along the path of the present motion
    instead.

    Parameters
    ----------
    problem : Problem
        The problem, whose start is replaced.
    motion : Plan or Trajectory
        Motion that the robot executes.
    at : float
        Time since the start of this motion, s.

    Returns
    -------
    Problem
        The problem with the joint positions and rates at that instant as its start, and with the
        joint accelerations if the robot has limits of jerk.

    Raises
    ------
    ProblemError
        If `at` is not an instant of the motion.
    """
    motion = motion.motion if isinstance(motion, Plan) else motion
    if not 0 <= at <= motion.duration:
        allowed = f"0 s to {motion.duration:.6g} s"
        raise ProblemError(
            "not an instant of this motion", key="at", value=f"{at:g} s", allowed=allowed
        )
    state = motion.sample(motion.breaks[0] + at)
    robot = problem.robot
    velocity = robot.velocities
    q, qd = state.q[0], state.qd[0]
    # The check accepts velocity jumps up to this share of the velocity limit.
    qd = np.where(np.abs(qd) > JUMP_TOLERANCE * velocity, qd, 0.0)
    mechanism = Mechanism.from_robot(robot)
    rates = task_rates(mechanism, q[None], qd[None])[0]
    entries, largest_rate = problem.motion, np.abs(rates).max()
    jerk = any(joint.jerk is not None for joint in robot.joints)
    qdd = state.qdd[0] * (jerk and qd.any())
    if qd.any() and not isinstance(entries[0], Free):
        stop = stopping_point(robot, q, qd, qdd)
        if not _within_ranges(problem, mechanism, stop):
            (along_path,) = quickest_stops(motion, robot, np.array([at])).motions
            stop = stop if along_path is None else along_path.positions(along_path.breaks[-1:])[0]
        entries = (Free(Joints.from_array(stop), name="stop"), *entries)
    start_rate = {
        name: float(rate)
        for name, rate in zip(TASK_COORDINATES, rates, strict=True)
        if abs(rate) > ROUNDING_TOLERANCE * largest_rate
    }
    a, b, c, d = qdd.tolist()
    start = Joints.from_array(q)
    return replace(
        problem, start=start, start_rate=start_rate, start_acceleration=(a, b, c, d), motion=entries
    )


def _within_ranges(problem: Problem, mechanism: Mechanism, q: Array) -> bool:
    """Return True if the task coordinates of joint positions (4,) are within their ranges."""
    task = task_from_joints(mechanism, q[None])[0]
    ranges = problem.ranges.items()
    return all(low <= task[TASK_COORDINATES.index(name)] <= high for name, (low, high) in ranges)


def _complete_point(base: Point, point: Point) -> Point:
    """Return a point with its missing task coordinates taken from another point.

    Points in other coordinates have no missing ones, so they are returned unchanged.

    Parameters
    ----------
    base : Point
        Point that provides the missing coordinates.
    point : Point
        Point that may omit some of roll, tilt, spin and depth.
    """
    if isinstance(base, Task) and isinstance(point, Task):
        return unchecked_copy(base, **point.set_coordinates)
    return point


def _nominal_duration(problem: Problem, progress: Progress) -> float | None:
    """Return the duration of the motion without ranges of friction and payload, s.

    The report compares it with the duration of the plan, to show what the ranges cost.

    Parameters
    ----------
    problem : Problem
        The problem.
    progress : callable
        Called with a message before the motion is planned.

    Returns
    -------
    float or None
        None if the problem has no such range, or if there is no motion without it.
    """
    if problem.friction is None and problem.payload is None:
        return None
    progress(Step("for comparison without the range"))
    result = plan_motion(replace(problem, friction=None, payload=None))
    return None if result.trajectory is None else result.trajectory.duration


def _summaries(problem: Problem, result: PlannerResult) -> tuple[PhaseSummary, ...]:
    """Return the summaries of all planned phases for plan.json and the report.

    A phase is an entry of the motion list with its motion. A summary contains the duration, the
    solver's data, and how far the tip deviates from a rounded corner or from a constant speed.

    Parameters
    ----------
    problem : Problem
        The problem.
    result : PlannerResult
        Result of the planner. Without a complete motion, no deviations are measured.

    Returns
    -------
    tuple of PhaseSummary
        One summary for each planned phase.
    """
    if result.trajectory is None:
        return tuple(_summary(phase, None) for phase in result.phases)
    mechanism = Mechanism.from_robot(problem.robot)
    kept = check_path_promises(result.trajectory, mechanism, problem.task_limits)
    promises = {item.promise.span: item for item in kept}
    spans = result.trajectory.phases
    return tuple(
        _summary(phase, promises.get(span))
        for phase, span in zip(result.phases, spans, strict=True)
    )


def _summary(phase_result: PlannedPhase, promise: PromiseResult | None) -> PhaseSummary:
    """Return the summary of one phase for plan.json and the report.

    Parameters
    ----------
    phase_result : PlannedPhase
        The phase with its motion.
    promise : PromiseResult or None
        Measured deviation of the phase from its line, corners and constant speed. None if the
        problem prescribes none of them.

    Returns
    -------
    PhaseSummary
        Duration, bounds, solver and measured deviations of the phase.
    """
    phase = phase_result.phase
    confirmation = phase_result.motion.confirmation
    # The interval in which the tip keeps a constant speed, s, and the relative error there.
    start, end, error = (promise and promise.constant_speed_span) or (None, None, None)
    return PhaseSummary(
        name=phase.motion.name,
        duration=phase_result.duration,
        toppra_duration=None,
        lower_bound=phase_result.lower_bound,
        task_start=tuple(phase.start.tolist()),
        task_end=tuple(phase.end.tolist()),
        branch=phase.branch,
        iterations=phase_result.motion.iterations,
        solver=phase_result.motion.solver,
        confirmation_iterations=getattr(confirmation, "iterations", None),
        confirmation_difference=getattr(confirmation, "difference", None),
        confirmation_residual=getattr(confirmation, "residual", None),
        reversal_multiplier=phase_result.motion.reversal_multiplier,
        corner_departure=promise.departure
        if promise and promise.promise.corner_distances
        else None,
        corner_reach=promise.corner_reach if promise else None,
        constant_speed=promise.promise.speed if promise else None,
        constant_from=start,
        constant_to=end,
        constant_error=error,
    )


def _plan_check_and_cool(
    problem: Problem,
    work: Work,
    progress: Progress = silent,
    on_motion: Callable[[Trajectory], None] = silent,
    *,
    may_overheat: bool = True,
) -> Outcome:
    """Plan and check a problem. If a motor gets too hot, search a slower motion with less heat.

    Parameters
    ----------
    problem : Problem
        The problem.
    work : Work
        Counter of the work.
    progress : callable
        Called with a message for each step.
    on_motion : callable
        Called with each motion before its check, except for those of the search for less heat.
    may_overheat : bool
        True if a motion is planned even if no motion keeps the motors cool enough.

    Returns
    -------
    Outcome
        The motion with its certificate, or the reason of the failure.
    """

    def plan_cooler(candidate: Problem, weights: Array) -> Outcome:
        """Plan and check a problem with weights (4,) of the motors' heat."""
        return plan_and_check(candidate, work, cooling=weights)

    outcome = plan_and_check(problem, work, progress, on_motion, may_overheat=may_overheat)
    too_hot = outcome.hot_joints and outcome.excess_heat is not None
    if not too_hot or check_thermal_bound(problem) is not None:
        return outcome
    progress(Step("slowing down because a motor gets too hot"))
    return ThermalSearch(problem, outcome, plan_cooler).run() or outcome


def _duration_or_reason(
    problem: Problem, work: Work, *, first_suffices: bool = False
) -> float | Reason:
    """Return the duration of the plan of a problem in s, or the reason of the failure.

    Parameters
    ----------
    problem : Problem
        The problem.
    work : Work
        Counter of the work.
    first_suffices : bool
        True if the first certified motion suffices.

    Returns
    -------
    float or Reason
        Duration in s, or the reason why there is no certified motion.
    """
    attempt = partial(_plan_check_and_cool, work=work)
    outcome, _, _ = plan_mission(problem, attempt, work, first_suffices=first_suffices)
    return outcome.reason or outcome.duration


def _find_any_motion(problem: Problem, work: Work, *, any_suffices: bool) -> float | Reason:
    """Return the duration of any motion of a problem in s, or the reason of the failure.

    The search for a relaxation calls it, because it is faster than a complete plan.

    Parameters
    ----------
    problem : Problem
        The problem.
    work : Work
        Counter of the work.
    any_suffices : bool
        True if the motion need not have little heat, even if the objective asks for it.

    Returns
    -------
    float or Reason
        Duration in s, or the reason why there is no certified motion.
    """
    if any_suffices and problem.objective == "time then heat":
        problem = unchecked_copy(problem, objective="time")
    return _duration_or_reason(with_fast_planner(problem), work, first_suffices=True)


def _larger_changes(problem: Problem, relaxed: Problem) -> Iterator[tuple[str, float]]:
    """Yield changes of limits, in words, and the durations of the motions that they permit, s.

    The changes are multiples of the relaxation that gives a motion. The page of the failed plan
    shows them. The last change is the largest one, or one that saves no time.

    Parameters
    ----------
    problem : Problem
        The problem without a motion.
    relaxed : Problem
        The problem with the smallest change that gives a motion.

    Yields
    ------
    words : str
        Description of the changes.
    duration : float
        Duration of the motion with these changes, s.
    """
    shortest = math.inf
    for words, changed in changes_of_limits(problem, relaxed).values():
        outcome = _find_any_motion(changed, Work(), any_suffices=True)
        if isinstance(outcome, float):
            yield words, outcome
            if outcome > (1 - GAP) * shortest:
                break
            shortest = outcome


def plan_to_folder(
    problem: Problem,
    folder: Path,
    progress: Progress = silent,
    drawer: FigureProcess | None = None,
    rate: float | None = None,
) -> tuple[Plan, dict[str, Path]]:
    """Plan a problem, and write plan.json, trajectory.csv, the report and the figures.

    If the plan has not passed the check, only the page no_plan.html is written. If the planner has
    a motion and searches for a faster one, the first Ctrl-C ends the search.

    Parameters
    ----------
    problem : Problem
        The problem.
    folder : Path
        Folder of the results.
    progress : callable
        Function that receives each step.
    drawer : FigureProcess, optional
        Process that draws the figures and judges the motion meanwhile.
    rate : float, optional
        Rows per second of trajectory.csv, Hz.

    Returns
    -------
    plan : Plan
        The plan.
    paths : dict
        Paths of the files by name.
    """

    def draw(trajectory: Trajectory) -> None:
        """Draw a motion in the other process while this process checks it."""
        if drawer is not None:
            if problem.planner == "optimal":
                drawer.judge(trajectory, problem)
            drawer.draw("motion", trajectory, problem.robot)

    changes: list[tuple[str, float]] = []

    def relax_further(relaxed: Problem) -> None:
        """Collect larger changes of the limits for the page of a failed plan."""
        changes.extend(_larger_changes(problem, relaxed))

    result = plan(problem, progress, draw, stoppable=True, on_relaxation=relax_further)
    progress(Step("writing results"))
    if drawer is not None and result.passed and result.requirements:
        figures = [requirement.figure_data() for requirement in result.requirements]
        drawer.draw("motors", result.motion, problem.robot, figures)
    result = result.cross_checked() if drawer is None else result.cross_checked(drawer.judgement)
    if not result.passed:
        from ssm_planner.reporting.html.report import write_no_plan

        return result, {"page": write_no_plan(result, folder / NO_PLAN, changes)}
    return result, write_folder(result, folder, drawer, rate)
