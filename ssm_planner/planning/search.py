"""Search for the fastest motion of a phase among its candidates."""

from __future__ import annotations

from heapq import heappop, heappush
from itertools import count

import numpy as np

from ssm_planner.planning.candidates.candidate import Attempt
from ssm_planner.planning.candidates.listed import KINDS
from ssm_planner.planning.ocp.refinement import EFFORT
from ssm_planner.planning.phase_planner import PhasePlanner
from ssm_planner.planning.phase_task import PlannedPhase
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.tolerances import GAP

SearchResult = tuple[PlannedPhase | Reason, list[Attempt]]
"""The fastest motion, or the reason of the failure, and all attempts."""


def find_fastest(planner: PhasePlanner, cutoff: float = np.inf) -> SearchResult:
    """Return the fastest motion of a phase among its candidates.

    The search advances the candidate with the smallest known duration: from its bound to its
    estimate, and from there to its solution. Each result may suggest other candidates. The search
    ends when no candidate can be shorter than the best motion by a share of GAP.

    Parameters
    ----------
    planner : PhasePlanner
        The phase, its problem and the solvers.
    cutoff : float
        Duration in s. Motions that take as long or longer are of no use.

    Returns
    -------
    result : PlannedPhase or Reason
        The fastest motion, or the reason of the first candidate that failed.
    attempts : list of Attempt
        All candidates with their bounds, estimates and results.
    """
    attempts: list[Attempt] = []
    queue: list[tuple[float, int, Attempt]] = []
    order, solution = count(), None

    def suggest(attempt: Attempt | None) -> None:
        for kind in KINDS:
            for candidate in kind.suggested(planner, attempt):
                attempts.append(Attempt(candidate, candidate.bound))
                heappush(queue, (attempts[-1].cost, next(order), attempts[-1]))

    suggest(None)
    while queue:
        cost, _, attempt = heappop(queue)
        limit = cutoff if solution is None else min(cutoff, (1 - GAP) * solution.duration)
        if cost >= limit:
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
    longer = Reason(None, None, None, None, "no motion is short enough")
    return solution or (reasons[0] if reasons else longer), attempts
