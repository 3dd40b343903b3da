"""Search for the fastest motion among candidates.

A candidate is one way to move. The same search serves one phase, that is, one entry of the motion
list (`candidates/listed.py`), and a whole problem with other joints at a target
(`candidates/other_joints.py`). It is a best-first branch and bound: the lower bound of a candidate,
and later its estimate (an approximate motion), decide whether the candidate is solved at all.
"""

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

    The search repeats one step. It takes the candidate with the smallest known duration, and
    advances it: from its lower bound to its estimate, or from its estimate to its solution. After
    each step, all kinds may suggest further candidates. The search ends when no candidate can be
    shorter than the best motion by a share of `gap`. Among candidates of equal duration, the one
    that was suggested first comes first.

    Parameters
    ----------
    kinds : sequence of subclasses of Candidate
        Kinds of ways to move. Their method `suggested` yields the candidates, in this order.
    planner : P
        The task and its solvers.
    work : Work
        Counter of the work that the planner spends. The search reads it.
    cutoff : float
        Duration in s. Motions that take as long or longer are of no use.
    gap : float
        Share by which a motion must be shorter than the best one. With 1, the first motion ends
        the search.
    budget : float
        Work after which the search solves no further candidate, if it has a motion or a cutoff.

    Returns
    -------
    result : R or Reason
        The fastest motion. If there is none, the first reason that names a limit, or else the
        first reason.
    evaluations : list of Evaluation
        All candidates with their bounds, estimates and results, in the order of suggestion.
    """
    evaluations: list[Evaluation[P, R]] = []
    queue: list[tuple[float, int, Evaluation[P, R]]] = []
    # The number of suggestion keeps the heap from comparing two evaluations.
    order, solution, begin = count(), None, work.spent

    def suggest(evaluation: Evaluation[P, R] | None) -> None:
        """Put the candidates that all kinds suggest after an evaluation into the queue."""
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
