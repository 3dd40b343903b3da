"""Search for the fastest motion among candidates."""

from __future__ import annotations

from collections.abc import Sequence
from heapq import heappop, heappush
from itertools import count

import numpy as np

from ssm_planner.planning.candidates.candidate import Attempt, Candidate, P, R
from ssm_planner.planning.ocp.refinement import EFFORT
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.tolerances import GAP


def find_fastest(
    kinds: Sequence[type[Candidate[P, R]]],
    planner: P,
    cutoff: float = np.inf,
    *,
    gap: float = GAP,
    budget: float = np.inf,
) -> tuple[R | Reason, list[Attempt[P, R]]]:
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
    cutoff : float
        Duration in s. Motions that take as long or longer are of no use.
    gap : float
        Relative difference of durations that counts. With 1, the first motion ends the search.
    budget : float
        Effort after which no faster motion is looked for, if there is a motion or a cutoff.

    Returns
    -------
    result : R or Reason
        The fastest motion, or the reason of the first candidate that failed.
    attempts : list of Attempt
        All candidates with their bounds, estimates and results.
    """
    attempts: list[Attempt[P, R]] = []
    queue: list[tuple[float, int, Attempt[P, R]]] = []
    order, solution, begin = count(), None, EFFORT.spent

    def suggest(attempt: Attempt[P, R] | None) -> None:
        for kind in kinds:
            for candidate in kind.suggested(planner, attempt):
                attempts.append(Attempt(candidate, candidate.bound))
                heappush(queue, (attempts[-1].cost, next(order), attempts[-1]))

    suggest(None)
    while queue:
        cost, _, attempt = heappop(queue)
        limit = cutoff if solution is None else min(cutoff, (1 - gap) * solution.duration)
        if cost >= limit:
            continue
        if limit < np.inf and EFFORT.beyond(begin, budget):
            attempt.result = Reason(message="not solved: the work budget is spent")
            continue
        spent = EFFORT.spent
        attempt.advance(limit)
        attempt.effort += EFFORT.spent - spent
        if attempt.result is None:
            heappush(queue, (attempt.cost, next(order), attempt))
        elif not isinstance(attempt.result, Reason) and attempt.result.duration < limit:
            solution = attempt.result
        suggest(attempt)
    reasons = [attempt.failed for attempt in attempts if attempt.failed is not None]
    longer = Reason(message="no motion is short enough")
    return solution or (reasons[0] if reasons else longer), attempts
