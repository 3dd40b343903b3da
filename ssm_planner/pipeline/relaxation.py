"""The smallest change of one limit, or of several together, that makes a problem solvable, found by trying."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any, Literal

from ssm_planner.planning.ocp.refinement import EFFORT
from ssm_planner.planning.reason import Reason
from ssm_planner.problem.limits import (
    ContinuousTorque,
    Duration,
    JointAcceleration,
    JointVelocity,
    Limit,
    MotorTorque,
    StopTravel,
)
from ssm_planner.problem.motion import Dwell
from ssm_planner.problem.problem import Problem
from ssm_planner.units import shown

GROWTH = (1.0, 1.03, 1.1, 1.3, 2.0)
"""By how much a relaxation that is needed at least is enlarged until a motion is found."""
HALVINGS = 2
SHARP = 0.9
"""Share of a relaxation which by itself gives no motion, as far as patience goes."""
BARELY = 1e-6
"""Share by which a relaxation goes beyond the value that is needed, so that rounding does not spoil it."""
SHARES = (0.1, 1.0)
"""By how much limits are relaxed one by one where it is not known which one stands in the way."""
TOGETHER = 4
"""Most limits that are relaxed together, where one after the other stands in the way."""
PATIENCE, TRIAL = 4.0, 0.1
"""Effort after which no other relaxation is tried, and that of a trial beside what it takes to solve it."""
PACES = (2.5, 5.0)
"""Times the duration in which a motion that runs too warm is tried."""
PAUSES = (1.0, 1.5, 3.0)
"""Times the pause that one motor needs to cool; others may need more."""
RATES = (1.0, 0.9, 0.7, 0.5, 0.25, 0.0)
"""Shares of the rate that a joint can have which are tried at an end."""
OF_RATES = (JointVelocity.name, JointAcceleration.name, StopTravel.name)
"""Limits in whose way the rates at the two ends are."""

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
        """The value, as it is printed, that lies so far on the way from `present` to `needed`."""
        return self.limit.rounded(self.present + share * (self.needed - self.present))

    def problem(self, value: float) -> Problem:
        """The problem with the limit at a value. Raises ValueError where the limit cannot stand there."""
        relaxed = self.limit.relaxed(value)
        if relaxed is None:
            raise ValueError(f"no {self.limit.name} of {value}")
        return relaxed.on(self.base)

    def described(self, value: float) -> str:
        """In words."""
        return self.limit.described(value)


@dataclass(frozen=True, eq=False)
class Pause(Relaxation):
    """A dwell at the end, in which motors cool; its value is in s."""

    present = 0.0

    def problem(self, value: float) -> Problem:
        whole = None if self.base.duration is None else self.base.duration + value
        return replace(self.base, motion=(*self.base.motion, Dwell(value, "pause")), duration=whole)

    def described(self, value: float) -> str:
        return f"a dwell of {value:.6g} s at the end"


@dataclass(frozen=True, eq=False)
class LessRate(Relaxation):
    """Rates at one end of everything, all of them less by one factor, which is the value."""

    end: Literal["start_rate", "end_rate"] = "start_rate"
    present = 1.0

    @property
    def rates(self) -> Mapping[str, float]:
        """What is asked for, by task coordinate."""
        return self.base.start_rate if self.end == "start_rate" else self.base.end_rate

    def problem(self, value: float) -> Problem:
        less = {name: value * rate for name, rate in self.rates.items()}
        return (
            replace(self.base, start_rate=less)
            if self.end == "start_rate"
            else replace(self.base, end_rate=less)
        )

    def described(self, value: float) -> str:
        return f"{self.end} of {self._text(value)} instead of {self._text(1.0)}"

    def _text(self, share: float) -> str:
        words = []
        for name, rate in self.rates.items():
            unit, scale = shown("m/s" if name == "depth" else "rad/s")
            words.append(f"{name}: {share * rate * scale:.12g} {unit}")
        return "{" + ", ".join(words) + "}"


@dataclass(frozen=True, eq=False)
class Cure:
    """A relaxation tried at one value; outcome: the duration of the motion that it gives, or the reason why there is none."""

    relaxation: Relaxation
    value: float
    outcome: float | Reason
    before: tuple[str, ...] = ()
    """What is relaxed beside it, in words."""
    others: tuple[Cure, ...] = ()
    """Other cures that work, each alone."""

    @property
    def works(self) -> bool:
        return isinstance(self.outcome, float)

    @property
    def problem(self) -> Problem:
        """The problem with the value tried."""
        return self.relaxation.problem(self.value)

    @property
    def words(self) -> str:
        """What is relaxed."""
        return self.relaxation.described(self.value)

    @property
    def text(self) -> str:
        """What is relaxed, that it was tried, and what came of it."""
        if isinstance(self.outcome, Reason):
            own = f"{self.words}: tried, still infeasible alone: {self.outcome.message}"
        else:
            together = " together" if self.before else ""
            own = f"{' and '.join((*self.before, self.words))}: tried{together}, takes {self.outcome:.4g} s"
        return "; or ".join((own, *(other.text for other in self.others)))


def search(
    problem: Problem,
    reason: Reason,
    attempt: Attempt,
    duration: float | None = None,
    patience: float = PATIENCE,
    *,
    feasible: Attempt | None = None,
) -> Cure | None:
    """The smallest change of one limit, or of several together, with which a motion was found, and other cures.

    Where none is found, why that of the limit in the reason is not enough; None where nothing that was tried gave a motion.
    Every value is tried as it is printed. duration: of the motion in which a limit was found exceeded, s. patience:
    effort after which no other attempt is begun. feasible: tells sooner than `attempt` whether there is a motion; that is
    then planned with the values found alone.
    """
    begin = EFFORT.spent
    # the fastest motion is found soonest, but runs warmer than the one asked for
    quick = None if isinstance(reason.limit, ContinuousTorque) else feasible

    def patient() -> bool:
        return EFFORT.spent - begin < patience

    def tried(changed: Problem) -> float | Reason:
        EFFORT.spent += TRIAL
        return (quick or attempt)(changed)

    known = relaxation_for(problem, reason)
    cure = _any(problem, tried, patient) if known is None else _together(known, tried, patient)
    others = tuple(_others(problem, reason, duration, tried, patient))
    working = [each for each in (cure, *others) if each is not None and each.works]
    if not working:
        return cure
    if quick is not None:
        working = [replace(each, outcome=attempt(each.problem)) for each in working]
        if not all(each.works for each in working):
            return search(problem, reason, attempt, duration, patience - (EFFORT.spent - begin))
    return replace(working[0], others=tuple(working[1:]))


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


def _together(relaxation: Relaxation, attempt: Attempt, patient: Callable[[], bool]) -> Cure | None:
    """The least value of one relaxation, and of others too while another limit then stands in the way."""
    first = cure = _least(relaxation, attempt, patient)
    before: dict[tuple[Any, ...], str] = {}
    for _ in range(TOGETHER - 1):
        if cure is None or not isinstance(cure.outcome, Reason) or not patient():
            break
        limit = cure.relaxation.limit
        before[limit.key, cure.value < limit.bound(cure.value)] = cure.words
        following = relaxation_for(cure.problem, cure.outcome)
        cure = None if following is None else _least(following, attempt, patient)
    if cure is None or not cure.works:
        return first
    limit = cure.relaxation.limit
    before.pop((limit.key, cure.value < limit.bound(cure.value)), None)
    return replace(cure, before=tuple(before.values()))


def _least(relaxation: Relaxation, attempt: Attempt, patient: Callable[[], bool]) -> Cure | None:
    """The least value of one relaxation with which there is a motion, to a few per cent of the way beyond `needed`."""

    def cure(growth: float) -> Cure:
        value = relaxation.value(growth * (1 + BARELY))
        return Cure(relaxation, value, attempt(relaxation.problem(value)))

    limit = relaxation.limit
    growths = [
        each for each in GROWTH if limit.relaxed(relaxation.value(each * (1 + BARELY))) is not None
    ]
    if not growths:
        return None
    short = 0.0
    for growth in growths:
        found = cure(growth)
        if found.works or not patient() or _is_enough(found):
            break
        short = growth
    return _sharpened(cure, found, (short, growth), patient) if found.works else found


def _sharpened(
    cure: Callable[[float], Cure],
    found: Cure,
    between: tuple[float, float],
    patient: Callable[[], bool],
) -> Cure:
    """A cure so small that SHARP of its relaxation does not work.

    between: shares of the relaxation that do not work (0: that of the problem), and that do, which gave what was found.
    """
    short, enough = between
    halvings = HALVINGS if short else 0
    middle = (short + enough) / 2 if short else SHARP * enough
    while patient() and (halvings > 0 or short < SHARP * enough):
        less = cure(middle)
        if less.works:
            found, enough = less, middle
        else:
            short = middle
        middle, halvings = (short + enough) / 2, halvings - 1
    return found


def _is_enough(cure: Cure) -> bool:
    """Another limit, or the other end of its range, stands in the way then: no more of this one helps."""
    if not isinstance(cure.outcome, Reason) or cure.outcome.limit is None:
        return False
    following = relaxation_for(cure.problem, cure.outcome)
    if following is None or following.limit.key != cure.relaxation.limit.key:
        return following is not None
    upwards = following.needed > following.present
    return upwards != (cure.value > cure.relaxation.present)


def _any(problem: Problem, attempt: Attempt, patient: Callable[[], bool]) -> Cure | None:
    """The relaxation by the smallest share, of all limits one by one."""

    def cure(relaxation: Relaxation, share: float) -> Cure:
        value = relaxation.value(share)
        return Cure(relaxation, value, attempt(relaxation.problem(value)))

    for short, share in pairwise((0.0, *SHARES)):
        for relaxation in all_relaxations(problem):
            if not patient():
                return None
            found = cure(relaxation, share)
            if found.works:
                return _sharpened(partial(cure, relaxation), found, (short, share), patient)
    return None


def _others(
    problem: Problem,
    reason: Reason,
    duration: float | None,
    attempt: Attempt,
    patient: Callable[[], bool],
) -> Iterator[Cure]:
    """Cures that move no limit: of each kind the first of its values that gives a motion."""

    def cure(relaxation: Relaxation, most: float, share: float) -> Cure:
        value = relaxation.present + share * (most - relaxation.present)
        value = _up(value) if most > relaxation.present else _down(value)
        return Cure(relaxation, value, attempt(relaxation.problem(value)))

    for relaxation, values in _other_relaxations(problem, reason, duration):
        short = 0.0
        for value in values:
            if not patient():
                return
            found = cure(relaxation, value, 1.0)
            if found.works:
                less = short / (value - relaxation.present)
                yield _sharpened(partial(cure, relaxation, value), found, (less, 1.0), patient)
                break
            short = value - relaxation.present


def _other_relaxations(
    problem: Problem, reason: Reason, duration: float | None
) -> Iterator[tuple[Relaxation, tuple[float, ...]]]:
    """What else may be tried, with its values: more time for motors that get too warm, less of the rates at an end."""
    limit, required, available = reason.limit, reason.required, reason.available
    if limit is None or required is None or available is None:
        return
    if isinstance(limit, ContinuousTorque) and duration is not None:
        pause = duration * ((required / available) ** 2 - 1)
        if not problem.end_rate:
            yield Pause(problem, limit, pause), tuple(_up(each * pause) for each in PAUSES)
        if any(entry.duration is None for entry in problem.motion):
            slower = Relaxation(problem, Duration(duration), duration)
            yield slower, tuple(_up(each * duration) for each in PACES)
    if limit.name in OF_RATES:
        possible = min(available / required, 1.0) if required > available > 0 else 0.0
        for end in ("start_rate", "end_rate"):
            relaxation = LessRate(problem, limit, possible, end)
            if relaxation.rates:
                yield relaxation, tuple(dict.fromkeys(_down(each * possible) for each in RATES))


def _up(value: float) -> float:
    """Rounded up to three digits."""
    return -_down(-value)


def _down(value: float) -> float:
    """Rounded down to three digits."""
    if value == 0.0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(abs(value))) - 2)
    return round(math.floor(round(value / unit, 6)) * unit, 12)
