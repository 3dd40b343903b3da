"""Search for the fastest certified motion over all joint positions that reach the targets.

A motion is certified if it has passed the independent check of all limits. Several joint positions
reach a target of a free motion that is given in task coordinates, or as a position of the tip. The
problem is first planned with the nearest ones. The others are called alternatives. `plan_mission`
treats one target after the other, and searches for the alternative there that makes the motion of
the whole problem fastest. Each alternative is a candidate of the search in `planning/search.py`.
`planning/candidates/other_joints.py` contains these candidates.
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
from ssm_planner.planning.phases import build_phases, start_configurations
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.search import find_fastest
from ssm_planner.planning.tolerances import GAP
from ssm_planner.planning.work import SEARCH_BUDGET, Work
from ssm_planner.problem import Free, Joints, Problem
from ssm_planner.progress import Progress, Step, silent

MAX_TARGETS = 8
"""Largest number of targets in a problem for which other joint positions are tried.

Other joint positions at one target change the motions to all later targets. The work therefore
grows with the square of the number of targets.
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
    """Search the fastest certified motion over all joint positions that reach the targets.

    A motion is certified if it has passed the independent check. Several joint positions reach a
    target that is given in task coordinates or as a position of the tip. The problem is planned
    with the nearest ones first. The others, called alternatives, are then tried at one target after
    the other.

    Parameters
    ----------
    problem : Problem
        The problem.
    plan : callable
        Function that plans and checks a problem.
    work : Work
        Counter of the work of `plan`. The search ends after the work `SEARCH_BUDGET`.
    progress : callable
        Called with a message for every alternative, which states the best duration so far.
    stoppable : bool
        True if the first Ctrl-C during the search ends it with the best motion so far. This
        requires that the nearest joint positions give a certified motion.
    first_suffices : bool
        True if the search ends with the first certified motion.

    Returns
    -------
    outcome : Outcome
        The fastest certified motion, or the failure without one. The `candidates` (ways to
        move that were tried) of its field `planned` include the alternatives.
    problem : Problem
        The problem of that motion, in which joint positions replace some targets.
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
        # `came` tells whether the user has pressed Ctrl-C in this block. An interruption that it
        # does not know of ends the program.
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

    Other joint positions at a target are called alternatives. The fields `best` and `best_problem`
    change whenever an alternative gives a faster certified motion.
    """

    problem: Problem
    """The problem as the user requested it."""
    plan: Callable[[Problem], Outcome]
    """Function that plans and checks a problem."""
    work: Work
    """Counter of the work of `plan`."""
    progress: Progress
    """Called with a message for every alternative."""
    first_suffices: bool
    """True if the search ends with the first certified motion."""
    best: Outcome
    """The fastest certified motion so far, or the failure of the first attempt."""
    best_problem: Problem
    """The problem of that motion, in which joint positions replace some targets."""
    hint: str = ""
    """End of the progress messages, which says how the user can stop the search. It may be empty.
    """
    entries: dict[int, list[CandidateEntry]] = field(default_factory=dict)
    """Alternatives that were tried, as entries of `candidates` in plan.json.

    The keys are the indices of the phases (entries of the motion list) that lead to the targets.
    """

    @property
    def outcome(self) -> Outcome:
        """The best motion, with all alternatives added to its candidates (ways to move)."""
        planned = self.best.planned
        candidates = list(planned.candidates)
        # A failed plan may lack the candidates of later phases.
        candidates += [()] * (max(self.entries, default=-1) + 1 - len(candidates))
        for k, alternatives in self.entries.items():
            candidates[k] += tuple(alternatives)
        return replace(self.best, planned=replace(planned, candidates=tuple(candidates)))

    def run(self) -> None:
        """Search until no faster motion is expected, or until the work budget is spent.

        The method changes `best` and `best_problem`. Alternatives (other joint positions at a
        target) are planned without Ipopt's confirmation. Ipopt confirms the best of them at the
        end. If the motion that Ipopt confirms is longer by at least the share `GAP`, the
        unconfirmed motion remains.
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
        """Search over the joint positions at one target.

        The method changes `best` and `best_problem` if it finds a faster motion that passes the
        check, and adds the joint positions that were tried to `entries`.

        Parameters
        ----------
        target : (int, int)
            Index of the free motion in the motion list, and index of the target in that motion. Its
            targets are the via points and the end, in this order.
        limit : float
            Value of `Work.spent` at which the search ends.
        """
        problem, best = self.best_problem, self.best
        # If a limit forbids a point with all joint positions at the start, the search begins with
        # the first ones, because other joint positions at a target may avoid the limit.
        phases = feasible_phases(problem)[0]
        phases = phases or build_phases(problem, start_configurations(problem)[0])
        name, number = problem.motion[target[0]].name, count(1)

        def report() -> None:
            """Report the next attempt with its number, and the best duration so far."""
            found = f", {self.best.duration:.4f} s so far{self.hint}" if self.best.passed else ""
            self.progress(Step(f"other joints for {name}, attempt {next(number)}{found}"))

        def plan(alternative: Problem) -> MissionMotion | Reason:
            """Plan and check an alternative, and remember its motion if it is the fastest so far.

            The motion replaces `best` only if it is shorter by the share `GAP`. The candidates of
            the search call this function.

            Parameters
            ----------
            alternative : Problem
                The problem with other joint positions at the target.

            Returns
            -------
            MissionMotion or Reason
                The certified motion, or the reason why planning failed.
            """
            outcome = self.plan(with_fast_planner(alternative))
            if outcome.reason is not None:
                return outcome.reason
            if outcome.duration < self.best.duration * (1 - GAP):
                self.best, self.best_problem = outcome, alternative
            return MissionMotion(outcome.duration, outcome.planned.phases)

        known = MissionMotion(best.duration, best.planned.phases)
        planner = JointsPlanner(
            problem, phases, target, known, plan=plan, work=self.work, report=report
        )
        solution, evaluations = find_fastest(
            [OtherJoints],
            planner,
            self.work,
            best.duration * (1 - GAP),
            # With a gap of 1, the first certified motion ends the search.
            gap=1.0 if self.first_suffices else GAP,
            work_limit=limit,
        )
        self.entries.setdefault(phases.index(planner.phase), []).extend(
            item.to_dict(solution) for item in evaluations
        )


def open_targets(problem: Problem) -> list[tuple[int, int]]:
    """List the targets of free motions that are not given as joint positions.

    Parameters
    ----------
    problem : Problem
        The problem.

    Returns
    -------
    list of (int, int)
        For each target, the index of its motion in the motion list, and the index of the target in
        this motion. The targets of a motion are its via points and its end, in this order. The list
        is empty if there are more than `MAX_TARGETS` targets.
    """
    result = [
        (entry, index)
        for entry, motion in enumerate(problem.motion)
        if isinstance(motion, Free)
        for index, target in enumerate((*motion.through, motion.to))
        if not isinstance(target, Joints)
    ]
    return result if len(result) <= MAX_TARGETS else []
