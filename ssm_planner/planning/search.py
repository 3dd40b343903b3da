"""Search for the fastest motion among candidates."""

from collections.abc import Sequence
from heapq import heappop, heappush
from itertools import count

import numpy as np

from ssm_planner.planning.candidates.candidate import Candidate, Evaluation, P, R
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.tolerances import GAP
from ssm_planner.planning.work import Work


def find_fastest(
    kinds: Sequence[type[Candidate[P, R]]],
    planner: P,
    work: Work,
    cutoff: float = np.inf,
    *,
    gap: float = GAP,
    budget: float = np.inf,
) -> tuple[R | Reason, list[Evaluation[P, R]]]:
    """Return the fastest motion among the candidates.

    The search advances the candidate with the smallest known duration: from its bound to its
    estimate, and from there to its solution. Each result may suggest other candidates. The search
    ends when no candidate can be shorter than the best motion by a share of `gap`.

    Parameters
    ----------
    kinds : sequence of subclasses of Candidate
        They suggest the candidates, in this order.
    planner : P
        The task and its solvers.
    work : Work
        Counter of the planner's work.
    cutoff : float
        Duration in s. Motions that take as long or longer are of no use.
    gap : float
        Relative difference of durations that counts. With 1, the first motion ends the search.
    budget : float
        Work after which no faster motion is looked for, if there is a motion or a cutoff.

    Returns
    -------
    result : R or Reason
        The fastest motion, or the first reason of a failure, preferably one that names a limit.
    evaluations : list of Evaluation
        All candidates with their bounds, estimates and results.
    """
    evaluations: list[Evaluation[P, R]] = []
    queue: list[tuple[float, int, Evaluation[P, R]]] = []
    order, solution, begin = count(), None, work.spent

    def suggest(evaluation: Evaluation[P, R] | None) -> None:
        for kind in kinds:
            for candidate in kind.suggested(planner, evaluation):
                evaluations.append(Evaluation(candidate, candidate.bound))
                heappush(queue, (evaluations[-1].known_duration, next(order), evaluations[-1]))

    suggest(None)
    while queue:
        duration, _, evaluation = heappop(queue)
        limit = cutoff if solution is None else min(cutoff, (1 - gap) * solution.duration)
        if duration >= limit:
            continue
        if limit < np.inf and work.spent - begin > budget:
            evaluation.result = Reason(message="not solved: the work budget is spent")
            continue
        spent = work.spent
        evaluation.advance(limit)
        evaluation.effort += work.spent - spent
        if evaluation.result is None:
            heappush(queue, (evaluation.known_duration, next(order), evaluation))
        elif not isinstance(evaluation.result, Reason) and evaluation.result.duration < limit:
            solution = evaluation.result
        suggest(evaluation)
    reasons = [evaluation.failed for evaluation in evaluations if evaluation.failed is not None]
    reasons.append(Reason(message="no motion is short enough"))
    return solution or max(reasons, key=lambda reason: reason.limit is not None), evaluations
