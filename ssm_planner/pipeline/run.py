"""The complete program: plan a motion, check it, and write the results to files.

`plan` returns the plan of a problem. `Replanner` plans a problem repeatedly with other starts and
targets. `plan_to_folder` also writes plan.json, the report and the figures. The command line calls
these functions.
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

from ssm_planner.arguments import check_methods, checked
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
"""Lock with which only one thread plans at a time.

All threads share the optimisation problems that were built, and their solutions. Two threads would
not be faster, since Python runs only one of them at a time.
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

    A problem without a motion within the limits does not raise an exception. The plan then contains
    the reason and, unless `relaxations` is False, the smallest change of a limit that gives a
    motion. Several threads may call this function. They wait for each other.

    Parameters
    ----------
    problem : Problem or file
        The problem, its file, or the name of a shipped problem.
    progress : callable
        Called with each step. The logger "ssm_planner" receives the steps too. An exception that
        the function raises cancels the planning.
    on_solution : callable
        Called with each motion before it is checked.
    relaxations : bool
        True if the planner looks for a change of a limit where planning fails.
    on_relaxation : callable
        Called with the problem with the changed limit, if it has a motion.
    stoppable : bool
        True if the first Ctrl-C ends the search over other joint positions at the targets. The
        result is then the best plan so far, with `Plan.stopped` set.

    Returns
    -------
    Plan
        The motion with its certificate, or the reason why planning failed.

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
        """Pass a step of the planning to the logger and to the caller's function `progress`."""
        logging.getLogger("ssm_planner").info(step)
        progress(step)

    work = Work()
    motions: list[Trajectory] = []

    def _show(trajectory: Trajectory) -> None:
        """Append a motion to `motions` before its check, and pass it to the caller."""
        motions.append(trajectory)
        on_solution(trajectory)

    # Some relaxations (changes of a limit) are computed from a motion that gets too warm. Such a
    # motion is only planned if relaxations are wanted.
    def _plan_candidate(candidate: Problem) -> Outcome:
        """Plan and check the problem, in which joint positions may replace some targets."""
        return _plan_check_and_cool(candidate, work, _report, _show, may_overheat=relaxations)

    with _ONE_AT_A_TIME:
        start = time.perf_counter()
        outcome, final_problem, stopped = plan_mission(
            problem, _plan_candidate, work, _report, stoppable=stoppable
        )
        result, reason = outcome.planned, outcome.reason
        # The caller must receive the final motion last, which need not be the last one planned.
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
    """Search a change of a limit that gives a motion, and add it to the reason of a failure.

    Parameters
    ----------
    problem : Problem
        The problem without a motion within its limits.
    outcome : Outcome
        The failure, perhaps with a motion that failed its check.
    reason : Reason
        Reason of the failure.
    work : Work
        Counter of the computational work, to which this function adds.
    on_relaxation : callable
        Called with the problem with the changed limit, if it has a motion.

    Returns
    -------
    Reason
        The reason, whose field `relaxation` describes the change in words. The field remains None
        if the search finds nothing.
    """
    trajectory = outcome.planned.trajectory
    attempt = find_relaxation(
        problem,
        reason,
        partial(_duration_or_reason, work=work),
        None if trajectory is None else trajectory.duration,
        feasible=partial(_find_any_motion, work=work),
        work=work,
    )
    if attempt is None:
        return reason
    if attempt.works:
        on_relaxation(attempt.problem)
    return replace(reason, relaxation=attempt.text)


@check_methods
@frozen
class Replanner:
    """Planner for one problem with changing starts and targets, for control loops and studies.

    If the problem has the planner `optimal`, `fast` takes its place. The structured solver of this
    package then computes the motion, and Ipopt does not confirm it.

    The optimisation problems and compiled functions are built once and kept for the last dozen
    kinds of motions, so the memory does not grow. Earlier plans do not change a single bit of later
    ones. Several threads may share a replanner.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> replanner = ssm.Replanner(ssm.load_problem("tilt_insert"))
    >>> replanner.problem.name
    'tilt_insert'
    """

    problem: Problem
    """The problem. The arguments of `plan` replace its start, rates and target."""

    def plan(
        self,
        start: Point | None = None,
        target: Point | None = None,
        rates: Mapping[str, float] | None = None,
    ) -> Plan:
        """Plan the problem with another start, other rates there, or another target.

        The plan is checked independently. If planning fails, no change of a limit is searched.

        Parameters
        ----------
        start : Point, optional
            Start of the motion, rad and m. Task coordinates that a `Task` omits are those of the
            problem. By default the start of the problem.
        target : Point, optional
            Target of the last motion that has one, rad and m. Task coordinates that a `Task` omits
            are those of the problem. By default the target of the problem.
        rates : mapping of str to float, optional
            Rates of the task coordinates at the start by name, rad/s and m/s. Rates that are not
            named are 0. By default those of the problem.

        Returns
        -------
        Plan
            The motion with its certificate, or the reason why planning failed.

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
        """Plan the problem from an instant of a motion, with the velocities at this instant.

        The plan is checked independently. If planning fails, no change of a limit is searched.

        Parameters
        ----------
        motion : Plan or Trajectory
            Motion that the robot executes.
        at : float
            Time since the start of this motion, s.
        target : Point, optional
            Target of the last motion of the problem that has one, rad and m. Task coordinates that
            it omits are those of the problem. By default the target of the problem.

        Returns
        -------
        Plan
            The motion with its certificate, or the reason why planning failed.

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
        """Return the motion list of the problem with another target.

        Only free and straight motions have a target. That of the last of them is replaced.

        Parameters
        ----------
        target : Point
            The new target. Task coordinates that it omits are those of the present target.

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
    """Return the problem with the state of a moving robot at one instant as its start.

    `Replanner.plan_from` calls this function, for example if a robot gets a new target while it
    moves. Only a free motion (whose path the planner chooses) can begin at any velocity. If the
    first motion of the problem is of another kind, a free motion named "stop" is put before it. Its
    target is the position at which the joints come to rest when each of them brakes nearly as hard
    as it can. If this position is outside of a range of task coordinates, the target is the end of
    the quickest stop along the path of the present motion instead.

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
        The problem with the joint positions and the rates of the task coordinates at that instant
        as its start. If the robot has limits on jerk, the start also has the joint accelerations.

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
    # The check accepts jumps of velocity up to this share of the velocity limit. A joint that is
    # slower counts as a joint at rest.
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
    """Return True if the task coordinates of joint positions are within the ranges of a problem.

    Parameters
    ----------
    problem : Problem
        The problem with its ranges of task coordinates (roll, tilt, spin and depth).
    mechanism : Mechanism
        Geometry of the robot.
    q : (4,) array
        Joint positions, rad and m.
    """
    task = task_from_joints(mechanism, q[None])[0]
    ranges = problem.ranges.items()
    return all(low <= task[TASK_COORDINATES.index(name)] <= high for name, (low, high) in ranges)


def _complete_point(base: Point, point: Point) -> Point:
    """Add the missing task coordinates of a point from another point.

    Task coordinates are roll, tilt, spin and depth. A point that is given in another way, for
    example by joint positions, is complete and is returned unchanged.

    Parameters
    ----------
    base : Point
        Point that provides the missing coordinates.
    point : Point
        Point that may omit some task coordinates.

    Returns
    -------
    Point
        The complete point.
    """
    if isinstance(base, Task) and isinstance(point, Task):
        return unchecked_copy(base, **point.set_coordinates)
    return point


def _nominal_duration(problem: Problem, progress: Progress) -> float | None:
    """Plan the problem without ranges of friction and payload, and return the duration.

    The report compares it with the duration of the plan, to show how much slower the motion is
    because it allows for the ranges.

    Parameters
    ----------
    problem : Problem
        The problem.
    progress : callable
        Called with a message before the motion is planned.

    Returns
    -------
    float or None
        Duration, s. None without such a range, or if planning without it fails.
    """
    if problem.friction is None and problem.payload is None:
        return None
    progress(Step("for comparison without the range"))
    result = plan_motion(replace(problem, friction=None, payload=None))
    return None if result.trajectory is None else result.trajectory.duration


def _summaries(problem: Problem, result: PlannerResult) -> tuple[PhaseSummary, ...]:
    """Summarise all planned phases for plan.json and the report.

    A phase is an entry of the motion list with its motion. A summary contains its duration, data
    about the solver, the distance of the tip from rounded corners, and the deviation of its speed
    from a constant speed.

    Parameters
    ----------
    problem : Problem
        The problem.
    result : PlannerResult
        Result of the planner. If a phase lacks a motion, no deviations are measured.

    Returns
    -------
    tuple of PhaseSummary
        One summary for each planned phase.
    """
    if result.trajectory is None:
        return tuple(_summary(phase, None) for phase in result.phases)
    mechanism = Mechanism.from_robot(problem.robot)
    # A promise is a property of the path that a phase must have, for example a straight line. It is
    # assigned to its phase by the span of time.
    kept = check_path_promises(result.trajectory, mechanism, problem.task_limits)
    promises = {item.promise.span: item for item in kept}
    spans = result.trajectory.phases
    return tuple(
        _summary(phase, promises.get(span))
        for phase, span in zip(result.phases, spans, strict=True)
    )


def _summary(phase_result: PlannedPhase, promise: PromiseResult | None) -> PhaseSummary:
    """Summarise one phase (entry of the motion list) for plan.json and the report.

    Parameters
    ----------
    phase_result : PlannedPhase
        The phase with its motion.
    promise : PromiseResult or None
        Measured deviations of the motion from its line, corners and constant speed. None if the
        problem prescribes none of them, or if they were not measured.

    Returns
    -------
    PhaseSummary
        Duration and lower bound, start and end, data about the solver, and measured deviations.
    """
    phase = phase_result.phase
    confirmation = phase_result.motion.confirmation
    # Start and end of the interval in which the tip keeps a constant speed, s, and the relative
    # error of the speed there.
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
        Counter of the computational work, to which this function adds.
    progress : callable
        Called with a message for each step.
    on_motion : callable
        Called with each motion before its check, except for those of the search for less heat.
    may_overheat : bool
        True if a motion is planned even if every possible motion makes a motor too hot.

    Returns
    -------
    Outcome
        The motion with its certificate, and with a reason if it failed the check. Without a motion,
        only the reason.
    """
    outcome = plan_and_check(problem, work, progress, on_motion, may_overheat=may_overheat)
    # `excess_heat` is None if the motion exceeds other limits too. Less heat does not help then.
    too_hot = outcome.hot_joints and outcome.excess_heat is not None
    if not too_hot or check_thermal_bound(problem) is not None:
        return outcome
    progress(Step("slowing down because a motor gets too hot"))
    return ThermalSearch(problem, outcome, work).run() or outcome


def _duration_or_reason(
    problem: Problem, work: Work, *, first_suffices: bool = False
) -> float | Reason:
    """Plan a problem with other limits, and return the duration or the reason of the failure.

    Parameters
    ----------
    problem : Problem
        The problem.
    work : Work
        Counter of the computational work, to which this function adds.
    first_suffices : bool
        True if the search ends with the first motion that passes the check.

    Returns
    -------
    float or Reason
        Duration in s, or the reason why there is no certified motion.
    """
    attempt = partial(_plan_check_and_cool, work=work)
    outcome, _, _ = plan_mission(problem, attempt, work, first_suffices=first_suffices)
    return outcome.reason or outcome.duration


def _find_any_motion(problem: Problem, work: Work) -> float | Reason:
    """Find any motion of a problem that passes the check, and return its duration or a reason.

    The search for a change of a limit uses it, because it is faster than a complete plan. The
    motion need not have little heat.

    Parameters
    ----------
    problem : Problem
        The problem.
    work : Work
        Counter of the computational work, to which this function adds.

    Returns
    -------
    float or Reason
        Duration in s, or the reason why there is no certified motion.
    """
    fastest = unchecked_copy(with_fast_planner(problem), objective="time")
    return _duration_or_reason(fastest, work, first_suffices=True)


def _larger_changes(problem: Problem, relaxed: Problem) -> Iterator[tuple[str, float]]:
    """Plan a problem with larger and larger changes of its limits, and yield the durations.

    The changes are multiples of the smallest change that gives a motion. The page of the failed
    plan shows them. The function stops after the first change that saves no time.

    Parameters
    ----------
    problem : Problem
        The problem without a motion.
    relaxed : Problem
        The same problem with the smallest change of its limits that gives a motion.

    Yields
    ------
    words : str
        Description of the changes in words.
    duration : float
        Duration of the motion with these changes, s.
    """
    shortest = math.inf
    for words, changed in changes_of_limits(problem, relaxed).values():
        outcome = _find_any_motion(changed, Work())
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

    If no motion has passed the check, only the page no_plan.html is written. While the planner
    already has a motion and searches for a faster one, the first Ctrl-C ends the search.

    Parameters
    ----------
    problem : Problem
        The problem.
    folder : Path
        Folder of the results.
    progress : callable
        Function that is called with each step.
    drawer : FigureProcess, optional
        Another process, which draws the figures and judges the motion while this process continues.
        By default, this process does both.
    rate : float, optional
        Rows of trajectory.csv per second, Hz. By default, `write_csv` chooses the rate.

    Returns
    -------
    plan : Plan
        The plan.
    paths : dict
        Paths of the files that were written, by name.
    """

    def draw(trajectory: Trajectory) -> None:
        """Let the other process draw a motion, and judge it if the planner is `optimal`.

        Without another process, nothing happens.
        """
        if drawer is not None:
            if problem.planner == "optimal":
                drawer.judge(trajectory, problem)
            drawer.draw("motion", trajectory, problem.robot)

    changes: list[tuple[str, float]] = []

    def relax_further(relaxed: Problem) -> None:
        """Append larger changes of the limits to `changes` for the page of a failed plan."""
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
