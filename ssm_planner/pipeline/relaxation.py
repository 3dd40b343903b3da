"""The smallest change of one limit that makes a problem solvable, found by trying."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from ssm_planner.pipeline.relaxations import Relaxation, every, named
from ssm_planner.planning.reason import Reason
from ssm_planner.problem.problem import Problem

GROWTH = (1.0, 1.03, 1.1, 1.3, 2.0)
"""By how much a relaxation that is needed at least is enlarged until it does."""
HALVINGS = 2
BARELY = 1e-6
"""Share by which a relaxation goes beyond the value that is needed, so that rounding does not spoil it."""
SHARES = (0.1, 1.0)
"""By how much limits are relaxed one by one where it is not known which one stands in the way."""
PATIENCE = 4.0
"""Process time after which no other relaxation is tried, s."""

Attempt = Callable[[Problem], "float | Reason"]
"""Duration of a certified plan, or why there is none."""


@dataclass(frozen=True, eq=False)
class Cure:
    """A relaxation tried at one value; outcome: the duration of the motion that it gives, or the reason why there is none."""

    relaxation: Relaxation
    value: float
    outcome: float | Reason

    @property
    def works(self) -> bool:
        return isinstance(self.outcome, float)

    @property
    def problem(self) -> Problem:
        """The problem with the value tried."""
        return self.relaxation.problem(self.value)

    @property
    def text(self) -> str:
        if isinstance(self.outcome, Reason):
            return f"{self.relaxation.text(self.value)}: tried, does not do alone: {self.outcome.message}"
        return f"{self.relaxation.text(self.value)}: tried, takes {self.outcome:.4g} s"


def tried(problem: Problem, reason: Reason, attempt: Attempt, patience: float = PATIENCE) -> Cure | None:
    """The smallest change of one limit that was found to do, or what the limit that the reason names does not do alone.

    None where nothing that was tried did. patience: process time after which no other attempt is begun, s.
    """
    # the fastest motion is found soonest, but runs warmer than the one asked for
    quick = problem.objective == "time then heat" and reason.constraint != "continuous torque"
    fast = replace(problem, objective="time") if quick else problem
    known = named(fast, reason)
    begin = time.process_time()

    def patient() -> bool:
        return time.process_time() - begin < patience

    return _any(fast, attempt, patient) if known is None else _least(known, attempt, patient)


def _least(relaxation: Relaxation, attempt: Attempt, patient: Callable[[], bool]) -> Cure | None:
    """The least value of one relaxation that does, to a few per cent of the way beyond what is needed at least."""

    def cure(growth: float) -> Cure:
        step = relaxation.needed - relaxation.present
        value = relaxation.present + step * growth * (1 + BARELY)
        return Cure(relaxation, value, attempt(relaxation.problem(value)))

    short = 0.0
    for growth in GROWTH:
        found = cure(growth)
        if found.works or not patient():
            break
        short = growth
    for _ in range(HALVINGS if short and found.works else 0):
        if not patient():
            break
        less = cure((short + growth) / 2)
        if less.works:
            found, growth = less, (short + growth) / 2
        else:
            short = (short + growth) / 2
    return found


def _any(problem: Problem, attempt: Attempt, patient: Callable[[], bool]) -> Cure | None:
    """The relaxation by the smallest share, of all limits one by one."""
    for share in SHARES:
        for relaxation in every(problem):
            if not patient():
                return None
            value = relaxation.present + share * (relaxation.needed - relaxation.present)
            found = Cure(relaxation, value, attempt(relaxation.problem(value)))
            if found.works:
                return found
    return None
