"""Search for the fastest certified motion over all joint positions that reach the targets.

Several joint positions reach a target of a free motion that is given in task coordinates, or as a
position of the tip. They are called alternatives. The problem is first planned with the nearest
ones. `plan_mission` then treats
one target after the other and searches the fastest motion of the whole problem among other joint
positions there. `planning/candidates/other_joints.py` contains these candidates, and
`planning/search.py` the search.
"""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from itertools import count

from ssm_planner.atomic import first_interruption
from ssm_planner.pipeline.certified import Outcome
from ssm_planner.pipeline.thermal import with_fast_planner
from ssm_planner.planning.candidates.candidate import CandidateEntry
from ssm_planner.planning.candidates.other_joints import JointsPlanner, MissionMotion, OtherJoints
from ssm_planner.planning.feasibility import eye_forbids_target, feasible_phases
from ssm_planner.planning.phases import Phase, build_phases, start_configurations
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.search import find_fastest
from ssm_planner.planning.tolerances import GAP
from ssm_planner.planning.work import SEARCH_BUDGET, Work
from ssm_planner.problem import Free, Joints, Problem
from ssm_planner.progress import Progress, Step, silent

MAX_TARGETS = 8
"""Largest number of targets in a problem whose alternatives are searched.

Each alternative changes the motion to all later targets, so the work grows with the square of the
number of targets.
"""


def plan_mission(
    problem: Problem,
    plan: Callable[[Problem], Outcome],
    work: Work,
    progress: Progress = silent,
    *,
    stoppable: bool = False,
    first_suffices: bool = False,
) -> tuple[Outcome, Problem, bool]:
    """Return the shortest certified motion over all joint positions that reach the targets.

    Several joint positions reach a target in task coordinates, or of the tip. The problem is
    planned with the nearest ones first. The others, called alternatives, are then tried at one
    target after the other. A motion is certified if it has passed the independent check.

    Parameters
    ----------
    problem : Problem
        The problem.
    plan : callable
        Plans and checks a problem.
    work : Work
        Counter of the work of `plan`.
    progress : callable
        Called with a message for every alternative, which states the best duration so far.
    stoppable : bool
        True if the first Ctrl-C ends the search as soon as there is a certified motion.
    first_suffices : bool
        True if the search ends with the first certified motion.

    Returns
    -------
    outcome : Outcome
        The best motion. Its `candidates` (ways to move that were tried) include the alternatives.
    problem : Problem
        The problem with the joints of that motion as targets.
    stopped : bool
        True if Ctrl-C ended the search.
    """
    search = _Search(
        problem,
        plan,
        work,
        progress,
        first_suffices,
        best=plan(problem),
        best_problem=problem,
    )
    stoppable = stoppable and search.best.passed
    search.hint = "; Ctrl-C takes it" if stoppable else ""
    with first_interruption() if stoppable else nullcontext(lambda: False) as came:
        try:
            search.run()
        except KeyboardInterrupt:
            if not came():
                raise
        stopped = came()
    if stopped:
        progress(Step("stopped: the best motion so far is taken"))
    return search.outcome, search.best_problem, stopped


@dataclass
class _Search:
    """Search over other joint positions at the targets of free motions, one target after the other.

    The fields `best` and `best_problem` change whenever a shorter certified motion is found.
    """

    problem: Problem
    """The problem as it was requested."""
    plan: Callable[[Problem], Outcome]
    """Plans and checks a problem."""
    work: Work
    """Counter of the work of `plan`."""
    progress: Progress
    """Called with a message for every alternative."""
    first_suffices: bool
    """True if the search ends with the first certified motion."""
    best: Outcome
    """The shortest certified motion so far, or the failure of the first attempt."""
    best_problem: Problem
    """The problem of that motion, in which joint positions replace some targets."""
    hint: str = ""
    """End of the messages, which says how the user can stop the search."""
    entries: dict[int, list[CandidateEntry]] = field(default_factory=dict)
    """Alternatives by the index of their phase, as the entries of `candidates` in plan.json."""

    @property
    def outcome(self) -> Outcome:
        """The best motion. Its candidates (ways to move) include all alternatives."""
        planned = self.best.planned
        candidates = list(planned.candidates)
        candidates += [()] * (max(self.entries, default=-1) + 1 - len(candidates))
        for k, alternatives in self.entries.items():
            candidates[k] += tuple(alternatives)
        return replace(self.best, planned=replace(planned, candidates=tuple(candidates)))

    def run(self) -> None:
        """Search until no faster motion is expected, or until the work budget is spent.

        Alternatives (other joint positions at a target) are planned without Ipopt's confirmation.
        Ipopt confirms the best of them at the end. If the confirmed motion is longer by more than
        the share `GAP`, the unconfirmed one remains.
        """
        problem, limit = self.problem, self.work.spent + SEARCH_BUDGET
        for target in [] if eye_forbids_target(problem) else open_targets(problem):
            if self.first_suffices and self.best.passed:
                return
            self._search(target, limit)
        if problem.planner == "optimal" and self.best_problem is not problem:
            confirmed = self.plan(self.best_problem)
            if confirmed.duration < (1 + GAP) * self.best.duration:
                self.best = confirmed

    def _search(self, target: tuple[int, int], limit: float) -> None:
        """Search over the joint positions at one target, and remember the best motion.

        Parameters
        ----------
        target : (int, int)
            Index of the free motion in the motion list, and index among its targets. These are the
            points between start and end, and the end.
        limit : float
            Work at which the search ends (`Work.spent`).
        """
        problem, best = self.best_problem, self.best
        phases = _phases_to_search(problem)
        name, number = problem.motion[target[0]].name, count(1)

        def report() -> None:
            """Report the next attempt and the best duration so far."""
            found = f", {self.best.duration:.4f} s so far{self.hint}" if self.best.passed else ""
            self.progress(Step(f"other joints for {name}, attempt {next(number)}{found}"))

        def plan(alternative: Problem) -> MissionMotion | Reason:
            """Plan an alternative, and remember its motion if it is the shortest so far.

            Differences below the share `GAP` are too small to count.
            """
            outcome = self.plan(with_fast_planner(alternative))
            if outcome.reason is not None:
                return outcome.reason
            if outcome.duration < self.best.duration * (1 - GAP):
                self.best, self.best_problem = outcome, alternative
            return MissionMotion(outcome.duration, outcome.planned.phases)

        known = MissionMotion(best.duration, best.planned.phases) if best.passed else None
        planner = JointsPlanner(
            problem, phases, target, known, plan=plan, work=self.work, report=report
        )
        solution, evaluations = find_fastest(
            [OtherJoints],
            planner,
            self.work,
            best.duration * (1 - GAP),
            gap=1.0 if self.first_suffices else GAP,
            budget=limit - self.work.spent,
        )
        self.entries.setdefault(phases.index(planner.phase), []).extend(
            item.to_dict(solution) for item in evaluations
        )


def open_targets(problem: Problem) -> list[tuple[int, int]]:
    """Return the targets of free motions that are not given as joint positions.

    Parameters
    ----------
    problem : Problem
        The problem.

    Returns
    -------
    list of (int, int)
        Index of the motion in the motion list, and index among its via points and its end. Empty if
        there are more than `MAX_TARGETS` targets.
    """
    result = [
        (entry, index)
        for entry, motion in enumerate(problem.motion)
        if isinstance(motion, Free)
        for index, target in enumerate((*motion.through, motion.to))
        if not isinstance(target, Joints)
    ]
    return result if len(result) <= MAX_TARGETS else []


def _phases_to_search(problem: Problem) -> tuple[Phase, ...]:
    """Return the phases of the problem, even if geometry forbids all of its start configurations.

    A start configuration is one of the joint positions that reach a start in task coordinates. If a
    limit forbids a place with each of them, the phases are those of the first one. The search for
    other joint positions at the targets needs them.

    Parameters
    ----------
    problem : Problem
        The problem.
    """
    phases, _ = feasible_phases(problem)
    return phases or build_phases(problem, start_configurations(problem)[0])
