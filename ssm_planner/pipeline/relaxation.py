"""The smallest change of one limit that makes a problem solvable, found by trying."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from ssm_planner.planning.reason import Reason
from ssm_planner.problem.limits import ContinuousTorque, JointVelocity, Limit, MotorTorque
from ssm_planner.problem.problem import Problem

GROWTH = (1.0, 1.03, 1.1, 1.3, 2.0)
"""By how much a relaxation that is needed at least is enlarged until a motion is found."""
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
class Relaxation:
    """A limit of a problem that may be moved, from `present` to `needed` at least."""

    base: Problem
    limit: Limit
    needed: float

    @property
    def present(self) -> float:
        """Where the bound stands that is to be moved."""
        return self.limit.bound(self.needed)

    def value(self, share: float) -> float:
        """The value that lies so far on the way from `present` to `needed`."""
        return self.present + share * (self.needed - self.present)

    def problem(self, value: float) -> Problem:
        """The problem with the limit at a value. Raises ValueError where the limit cannot stand there."""
        relaxed = self.limit.relaxed(value)
        if relaxed is None:
            raise ValueError(f"no {self.limit.name} of {value}")
        return relaxed.on(self.base)


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
        words = self.relaxation.limit.described(self.value)
        if isinstance(self.outcome, Reason):
            return f"{words}: tried, still infeasible alone: {self.outcome.message}"
        return f"{words}: tried, takes {self.outcome:.4g} s"


def search(problem: Problem, reason: Reason, attempt: Attempt, patience: float = PATIENCE) -> Cure | None:
    """The smallest change of one limit with which a motion was found, or why that of the limit in the reason is not enough.

    None where nothing that was tried gave a motion. patience: process time after which no other attempt is begun, s.
    """
    # the fastest motion is found soonest, but runs warmer than the one asked for
    quick = problem.objective == "time then heat" and not isinstance(reason.limit, ContinuousTorque)
    fast = replace(problem, objective="time") if quick else problem
    known = relaxation_for(fast, reason)
    begin = time.process_time()

    def patient() -> bool:
        return time.process_time() - begin < patience

    return _any(fast, attempt, patient) if known is None else _least(known, attempt, patient)


def relaxation_for(problem: Problem, reason: Reason) -> Relaxation | None:
    """Of the limit that the reason names; None where moving it does not help."""
    if reason.limit is None or reason.required is None or reason.available is None:
        return None
    limit = next((own for own in problem.all_limits if own.key == reason.limit.key), reason.limit)
    # of a floor the bound is what is required, and comes down to what there is
    needed = limit.enough(reason.available if limit.is_floor else reason.required)
    return None if limit.relaxed(needed) is None else Relaxation(problem, limit, needed)


def all_relaxations(problem: Problem) -> Iterator[Relaxation]:
    """Of every limit that may stand in the way: joint by joint, then of the tool."""
    order: list[Limit] = []
    for joint in problem.robot.joints:
        for kind in (MotorTorque, JointVelocity):
            order += (limit for limit in joint.limits if isinstance(limit, kind))
    order += problem.speeds
    order += (limit for limit in problem.limits if limit not in problem.speeds)
    for limit in order:
        for value in limit.trials():
            yield Relaxation(problem, limit, value)


def _least(relaxation: Relaxation, attempt: Attempt, patient: Callable[[], bool]) -> Cure | None:
    """The least value of one relaxation with which there is a motion, to a few per cent of the way beyond `needed`."""

    def cure(growth: float) -> Cure:
        value = relaxation.value(growth * (1 + BARELY))
        return Cure(relaxation, value, attempt(relaxation.problem(value)))

    limit = relaxation.limit
    growths = [each for each in GROWTH if limit.relaxed(relaxation.value(each * (1 + BARELY))) is not None]
    if not growths:
        return None
    short = 0.0
    for growth in growths:
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
        for relaxation in all_relaxations(problem):
            if not patient():
                return None
            value = relaxation.value(share)
            found = Cure(relaxation, value, attempt(relaxation.problem(value)))
            if found.works:
                return found
    return None
