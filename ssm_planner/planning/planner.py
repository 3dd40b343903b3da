"""Planning of all phases of a problem, joined to a trajectory.

A phase is an entry of the problem's motion list with its joint positions. A candidate is one way to
move a phase, for example directly or with a rest in between. `plan_motion` is the main entry. It
builds the phases, tests them without a solver, and searches for the fastest candidate of each
phase. `pipeline/certified.py` calls it and checks the result.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ssm_planner.planning.candidates.candidate import CandidateEntry, PhaseEvaluation
from ssm_planner.planning.candidates.listed import CANDIDATE_KINDS
from ssm_planner.planning.corners import with_corners
from ssm_planner.planning.feasibility import feasible_phases
from ssm_planner.planning.motor_strength import check_braking_torque, check_motor_heat
from ssm_planner.planning.phase_planner import PhasePlanner
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.planned_phase import PlannedPhase, planned_rest
from ssm_planner.planning.reason import Reason, duration_sum_reason, short_duration_reason
from ssm_planner.planning.search import find_fastest
from ssm_planner.planning.tolerances import EQUALITY_TOLERANCE
from ssm_planner.planning.work import Work
from ssm_planner.problem import Motion, Problem, Robot, Scan, unchecked_copy
from ssm_planner.progress import Progress, Step, silent
from ssm_planner.trajectory import Trajectory, join_sections
from ssm_planner.typing import Array, record


@record
class PlannerResult:
    """Result of planning a problem.

    Unless `status` is "solved", `trajectory` is None and `reason` is set.
    """

    status: str
    """Status "solved", "infeasible" or "not converged"."""
    trajectory: Trajectory | None
    """Motion of the whole problem. None if a phase has no motion."""
    phases: tuple[PlannedPhase, ...]
    """Phases with their motions. After a failure, those before the phase that failed."""
    reason: Reason | None
    """Why there is no motion. None if there is one."""
    candidates: tuple[tuple[CandidateEntry, ...], ...] = ()
    """Candidates (ways to move) of every phase that was searched, see `Evaluation.to_dict`."""


def plan_motion(
    problem: Problem,
    strict: Robot | None = None,
    progress: Progress = silent,
    cooling: Array | None = None,
    *,
    may_overheat: bool = True,
    may_reverse: bool = True,
    work: Work | None = None,
) -> PlannerResult:
    """Plan every phase (entry of the motion list) of a problem, and join their motions.

    Each phase starts and ends at rest, except for the rates that the problem states at both ends.
    If the problem requests a total duration, the phases share it in proportion to the durations of
    their fastest motions.

    Parameters
    ----------
    problem : Problem
        The problem.
    strict : Robot or None
        The problem's robot with tighter limits, which the motion must keep. None: its own limits.
    progress : callable
        Called with a `Step` for every phase.
    cooling : (4,) array or None
        Weights of the heat of the motors: the seconds of duration that are worth one second of a
        motor at its nominal torque (`elements.rows.LIMIT_SIZES`). None: heat does not count.
    may_overheat : bool
        True to plan a motion even if a bound shows that a motor cannot stay cool enough.
    may_reverse : bool
        True if joints may reverse between points to save time. Without effect if the problem limits
        the distance to stop.
    work : Work or None
        Counter of the work of all solvers. None: a new counter.

    Returns
    -------
    PlannerResult
        The trajectory and its phases, or the reason why a phase has no motion.

    Raises
    ------
    ProblemError
        If a point is out of reach, or if no motion goes anywhere.
    """
    robot = with_corners(problem, problem.robot)
    problem = unchecked_copy(problem, robot=robot)
    strict = unchecked_copy(strict or robot, corners=robot.corners, lightest=robot.lightest)
    # The limit on the distance to stop is applied afterwards (`limit_stop_travel`). Reversals that
    # save time before it need not save any after it.
    may_reverse = may_reverse and problem.stop_travel is None
    work = work or Work()

    def planner(phase: Phase) -> PhasePlanner:
        """Return the planner of one phase."""
        return PhasePlanner(strict, phase, cooling, may_reverse=may_reverse, work=work)

    phases, reason = feasible_phases(problem)
    if reason is None and not may_overheat:
        reason = check_motor_heat(phases)
    if reason is None and problem.duration is not None:
        phases, reason = _with_durations(phases, problem.duration, planner, progress)
    if reason is not None:
        return PlannerResult("infeasible", None, (), reason)
    return _plan_phases(list(map(planner, phases)), progress)


def _plan_phases(planners: list[PhasePlanner], progress: Progress) -> PlannerResult:
    """Plan all phases, one after the other, until one of them has no motion.

    Parameters
    ----------
    planners : list of PhasePlanner
        One planner for each phase (entry of the motion list).
    progress : callable
        Called with a `Step` before every phase.

    Returns
    -------
    PlannerResult
        The trajectory and its phases. After a failure, its reason and the phases before it.
    """
    solutions: list[PlannedPhase] = []
    entries = []
    for k, planner in enumerate(planners):
        # 0 stands for a step that counts no items.
        count = len(planners) if len(planners) > 1 else 0
        progress(Step(planner.phase.motion.name, k, count))
        solution, evaluations = plan_phase(planner)
        entries.append(tuple(item.to_dict(solution) for item in evaluations))
        if isinstance(solution, Reason):
            status = "not converged" if solution.limit is None else "infeasible"
            return PlannerResult(status, None, tuple(solutions), solution, tuple(entries))
        solutions.append(solution)
    return PlannerResult("solved", join_phases(solutions), tuple(solutions), None, tuple(entries))


def plan_phase(planner: PhasePlanner) -> tuple[PlannedPhase | Reason, list[PhaseEvaluation]]:
    """Search for the fastest motion of a phase among its candidates, that is, its ways to move.

    Parameters
    ----------
    planner : PhasePlanner
        The phase (an entry of the motion list with its joint positions) and its solvers.

    Returns
    -------
    result : PlannedPhase or Reason
        The phase with its fastest motion, or the reason why it has none.
    evaluations : list of Evaluation
        All candidates with their results. Empty if the robot rests, or if a motor is too weak for
        the velocity at the start of a free motion.
    """
    phase = planner.phase
    if phase.is_at_rest:
        return planned_rest(phase), []
    # This test is only made for free motions.
    reason = check_braking_torque(phase) if phase.path is None else None
    if reason is not None:
        return reason, []
    return find_fastest(CANDIDATE_KINDS, planner, planner.work)


def join_phases(phases: Sequence[PlannedPhase]) -> Trajectory:
    """Return the trajectory in which the motions of the phases follow each other."""
    return join_sections(
        [(item.phase.motion.name, item.motion.breaks, item.motion.coefficients) for item in phases]
    )


def estimated_duration(problem: Problem, cutoff: float = np.inf, work: Work | None = None) -> float:
    """Estimate how long the motion of a problem takes, s.

    The structured solver alone computes the estimate, without additional reversals. The search over
    other joints at a target uses it to compare problems.

    Parameters
    ----------
    problem : Problem
        The problem.
    cutoff : float
        Duration in s. Only shorter motions are of use, so the estimate ends once its sum reaches
        this value.
    work : Work or None
        Counter of the work. None: a new counter.

    Returns
    -------
    float
        The requested duration of the problem, or else the sum of the estimates of all phases
        (entries of the motion list). Infinite if the motion would not be shorter than `cutoff`, if
        it cannot keep the requested duration, or if planning a phase fails.
    """
    of_time = unchecked_copy(problem, objective="time")
    phases, reason = feasible_phases(of_time)
    if reason is not None:
        return np.inf
    if problem.duration is not None:
        cutoff = min(cutoff, problem.duration * (1 + EQUALITY_TOLERANCE))
    work = work or Work()
    # The estimates replace the lower bounds one by one.
    durations = [phase.minimum_duration for phase in phases]
    # A motion along a given path is estimated sooner than a free motion, so paths come first.
    for k in sorted(range(len(phases)), key=lambda k: phases[k].path is None):
        if sum(durations) >= cutoff:
            return np.inf
        result, _ = plan_phase(
            PhasePlanner(problem.robot, phases[k], approximate=True, may_reverse=False, work=work)
        )
        durations[k] = np.inf if isinstance(result, Reason) else result.duration
    return np.inf if sum(durations) >= cutoff else problem.duration or sum(durations)


def _with_durations(
    phases: tuple[Phase, ...],
    duration: float,
    planner: Callable[[Phase], PhasePlanner],
    progress: Progress,
) -> tuple[tuple[Phase, ...], Reason | None]:
    """Give the phases durations that add up to the requested duration of the problem.

    Phases with a duration of their own keep it. The others share the remaining time in proportion
    to the durations of their fastest motions, which are planned for this purpose.

    Parameters
    ----------
    phases : tuple of Phase
        The phases (entries of the motion list with their joint positions) of the problem.
    duration : float
        Requested duration, s.
    planner : callable
        Returns the planner of a phase.
    progress : callable
        Called with a `Step` for every phase.

    Returns
    -------
    phases : tuple of Phase
        The phases with their durations, or the given phases if there is a reason.
    reason : Reason or None
        Why the durations cannot add up to the requested one. None if they do.
    """
    given = sum(phase.motion.duration or 0.0 for phase in phases)
    fastest = []
    for phase in phases:
        progress(Step(f"{phase.motion.name}, fastest"))
        if phase.motion.duration is not None:
            fastest.append(0.0)
            continue
        result, _ = plan_phase(planner(phase).without_duration)
        if isinstance(result, Reason):
            return phases, result
        fastest.append(result.duration)
    free, needed = duration - given, sum(fastest)
    # No phase can take more time, because each has a duration of its own or does not move.
    if needed == 0.0:
        agrees = abs(free) <= EQUALITY_TOLERANCE * duration
        return phases, None if agrees else duration_sum_reason(duration, given)
    if free < needed:
        return phases, short_duration_reason("the whole motion", duration, given + needed)
    timed = (
        replace(phase, motion=with_duration(phase.motion, minimum * free / needed))
        for phase, minimum in zip(phases, fastest, strict=True)
    )
    return tuple(timed), None


def with_duration(motion: Motion, duration: float) -> Motion:
    """Return a motion with a requested duration, unless it already has one or cannot have one.

    A scan, and a motion of no length (duration 0), cannot have one. They are returned unchanged.

    Parameters
    ----------
    motion : Motion
        Entry of the motion list.
    duration : float
        Duration, s.
    """
    if motion.duration is not None or isinstance(motion, Scan) or not duration:
        return motion
    return replace(motion, duration=duration)
