"""Search for the fastest motion among candidates.

A candidate is one way to move. The same search serves one phase, that is, one entry of the motion
list (`candidates/listed.py`), and a whole problem with other joints at a target
(`candidates/other_joints.py`). It is a best-first branch and bound. A candidate is solved only if
its lower bound, and then its estimate (an approximate motion), are shorter than the best motion.
"""

from collections.abc import Sequence

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
    work_limit: float = np.inf,
) -> tuple[R | Reason, list[Evaluation[P, R]]]:
    """Return the fastest motion among all candidates, that is, all ways to move.

    The search repeats one step. It takes the candidate with the smallest known duration and
    advances it: from its lower bound to its estimate (an approximate motion), or from its estimate
    to its solution. After each step, every kind of candidate may suggest more of them. The search
    ends when no remaining candidate can be shorter than the best motion by the share `gap`. Of
    candidates with equal durations, the one that was suggested first is advanced first.

    Parameters
    ----------
    kinds : sequence of subclasses of Candidate
        Kinds of ways to move. Their method `suggested` yields the candidates, in this order.
    planner : P
        The task and its solvers.
    work : Work
        Counter of the work that the planner spends. The search only reads it.
    cutoff : float
        Duration in s. Only motions that are shorter are of use.
    gap : float
        Share by which a motion must be shorter than the best one. With 1, the first motion ends the
        search.
    work_limit : float
        Value of `work.spent` from which on the search solves no further candidate, if it has a
        motion or a finite cutoff.

    Returns
    -------
    result : R or Reason
        The fastest motion. Without one, the first reason that names a limit, or else the first
        reason. Of several reasons that name this limit, the one that exceeds it least.
    evaluations : list of Evaluation
        All candidates with their bounds, estimates and results, in the order of suggestion.
    """
    evaluations: list[Evaluation[P, R]] = []
    solution = None

    def suggest(latest: Evaluation[P, R] | None) -> None:
        """Add the candidates that are suggested after an evaluation."""
        for kind in kinds:
            for candidate in kind.suggested(planner, latest):
                evaluations.append(Evaluation(candidate, candidate.bound))

    suggest(None)
    while True:
        limit = cutoff if solution is None else min(cutoff, (1 - gap) * solution.duration)
        promising = [
            item for item in evaluations if item.result is None and item.known_duration < limit
        ]
        if not promising:
            break
        # min returns the first of equal values: the candidate that was suggested first.
        evaluation = min(promising, key=lambda item: item.known_duration)
        if limit < np.inf and work.spent > work_limit:
            evaluation.result = Reason(message="not solved: the work budget is spent")
            continue
        spent = work.spent
        evaluation.advance(limit)
        evaluation.effort += work.spent - spent
        result = evaluation.result
        if result is not None and not isinstance(result, Reason) and result.duration < limit:
            solution = result
        suggest(evaluation)
    reasons = [evaluation.failed for evaluation in evaluations if evaluation.failed is not None]
    reasons.append(Reason(message="no motion is short enough"))
    # max returns the first of equal values: the first reason with a limit, if there is one.
    first = max(reasons, key=lambda reason: reason.limit is not None)
    # Several candidates can exceed the same limit. The one that exceeds it least is the answer.
    same_limit = [reason for reason in reasons if reason.limit == first.limit]
    return solution or min(same_limit, key=lambda reason: reason.excess), evaluations
