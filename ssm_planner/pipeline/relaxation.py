"""Search for the smallest change of limits that makes a problem solvable.

A *relaxation* is a limit with a weaker bound, a pause, or a lower rate at an end of the motion.
`find_relaxation` starts from the reason of the failure, which names a limit and the value that the
motion would need. Every change is rounded as it will be printed, and planned with this value before
it is reported.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, Literal, get_args

from ssm_planner.errors import ProblemError
from ssm_planner.planning.feasibility import eye_forbids_target
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.tolerances import EQUALITY_TOLERANCE
from ssm_planner.planning.work import SEARCH_BUDGET, Work
from ssm_planner.problem import (
    ContinuousTorque,
    Duration,
    Dwell,
    JointAcceleration,
    JointVelocity,
    Limit,
    Problem,
    StopTravel,
)
from ssm_planner.problem.limit import replace_fields
from ssm_planner.typing import record
from ssm_planner.units import display_unit

CHANGE_FACTORS = (1.0, 1.1, 1.5, 3.0)
"""Factors on the change that the reason asks for, tried in turn until there is a motion.

If the first factor gives a motion, smaller changes are tried too.
"""
BISECTION_ACCURACY = 0.9
"""The bisection ends when a motion is impossible with this share of the smallest change found.

The reported change is thus at most about 11 % too large.
"""
TRIAL_SHARES = (0.1, 1.0)
"""Shares by which limits are relaxed one by one if the reason names none that can be relaxed."""
TRIAL_WORK = 0.1
"""Work of a trial without its solves: the checks of the problem and the independent check."""
OFFERED_SHARES = (1.0, 1.5, 2.0, 3.0)
"""Multiples of a relaxation that the page of a failed plan offers."""
LIMITS_OF_END_RATES = (JointVelocity.name, JointAcceleration.name, StopTravel.name)
"""Names of the limits that the velocity at an end of the motion can exceed."""

End = Literal["start_rate", "end_rate"]
Planner = Callable[[Problem], "float | Reason"]
"""Returns the duration of a certified plan, or the reason of the failure."""


@record
class Relaxation:
    """A limit of a problem that may be changed from `present` to at least `needed`.

    Subclasses change something else than a limit. Their value is not a bound then.
    """

    base: Problem
    """The problem without the change."""
    limit: Limit
    """The limit to be changed."""
    needed: float
    """Bound of the limit that the motion needs at least, in SI units."""

    @property
    def present(self) -> float:
        """Present bound of the limit, in SI units."""
        return self.limit.bound(self.needed)

    def value(self, share: float) -> float:
        """Return the bound after a share of the change from `present` to `needed`.

        It is rounded as it will be printed. A share above 1 exceeds `needed`.
        """
        return self.limit.rounded(self.present + share * (self.needed - self.present))

    def problem(self, value: float) -> Problem:
        """Return the problem with the limit at a value.

        Raises
        ------
        ValueError
            If the limit cannot have this value.
        """
        relaxed = self.limit.relaxed(value)
        if relaxed is None:
            raise ValueError(f"no {self.limit.name} of {value}")
        return relaxed.on(self.base)

    def describe(self, value: float) -> str:
        """Describe the change to a value in words."""
        return self.limit.described(value)


class Pause(Relaxation):
    """A dwell (a time at rest) at the end of the motion, in which motors cool.

    The value of this change is the duration of the dwell in s.
    """

    present = 0.0

    def value(self, share: float) -> float:
        """Return the duration, rounded up to three digits."""
        return -_round_down(-share * self.needed)

    def problem(self, value: float) -> Problem:
        """Return the problem with a dwell at the end."""
        duration = None if self.base.duration is None else self.base.duration + value
        return replace(
            self.base, motion=(*self.base.motion, Dwell(value, "pause")), duration=duration
        )

    def describe(self, value: float) -> str:
        """Describe the dwell."""
        return f"a dwell of {value:.6g} s at the end"


@record
class ReducedRates(Relaxation):
    """Requested rates of task coordinates at one end of the motion, reduced by a common factor.

    The value of this change is the factor, from 1 (the requested rates) down to 0.
    """

    end: End = "start_rate"
    present = 1.0

    def value(self, share: float) -> float:
        """Return the factor, rounded down to three digits."""
        return _round_down(1 - share)

    @property
    def rates(self) -> Mapping[str, float]:
        """Requested rates by task coordinate."""
        return self.base.start_rate if self.end == "start_rate" else self.base.end_rate

    def problem(self, value: float) -> Problem:
        """Return the problem with the reduced rates."""
        reduced = {name: value * rate for name, rate in self.rates.items()}
        return replace_fields(self.base, **{self.end: reduced})

    def describe(self, value: float) -> str:
        """Describe the rates."""
        return f"{self.end} of {self._text(value)} instead of {self._text(1.0)}"

    def _text(self, share: float) -> str:
        """Return the rates multiplied by a factor, as they are written in a problem file."""
        entries = []
        for name, rate in self.rates.items():
            unit, scale = display_unit("m/s" if name == "depth" else "rad/s")
            entries.append(f"{name}: {share * rate * scale:.12g} {unit}")
        return "{" + ", ".join(entries) + "}"


@record
class TriedRelaxation:
    """A relaxation (change of a limit) that was planned with one value, and the outcome."""

    relaxation: Relaxation
    """The change."""
    value: float
    """Value that was tried, as it is printed."""
    outcome: float | Reason
    """Duration of the motion with the change, s, or the reason of the failure."""
    combined: tuple[str, ...] = ()
    """Descriptions of the limits that are relaxed together with it."""
    alternatives: "tuple[TriedRelaxation, ...]" = ()
    """Other attempts, each of which works alone."""

    @property
    def works(self) -> bool:
        """True if the relaxation gives a motion."""
        return isinstance(self.outcome, float)

    @property
    def problem(self) -> Problem:
        """The problem with the relaxed limit."""
        return self.relaxation.problem(self.value)

    @property
    def key(self) -> tuple[Any, ...]:
        """The limit and the direction of its change."""
        limit = self.relaxation.limit
        return limit.key, self.value < limit.bound(self.value)

    @property
    def description(self) -> str:
        """Description of the change."""
        return self.relaxation.describe(self.value)

    @property
    def text(self) -> str:
        """Description of the change and of its result, and of the other attempts."""
        if isinstance(self.outcome, Reason):
            sentence = f"{self.description}: tried, still infeasible alone: {self.outcome.message}"
        else:
            together = " together" if self.combined else ""
            changes = " and ".join((*self.combined, self.description))
            sentence = f"{changes}: tried{together}, takes {self.outcome:.4g} s"
        return "; or ".join((sentence, *(attempt.text for attempt in self.alternatives)))


def find_relaxation(
    problem: Problem,
    reason: Reason,
    plan: Planner,
    duration: float | None = None,
    *,
    feasible: Planner | None = None,
    work: Work | None = None,
    budget: float = SEARCH_BUDGET,
) -> TriedRelaxation | None:
    """Find the smallest change of one limit, or of several together, that gives a motion.

    Values are rounded as printed before they are tried, and planned by `plan` before they are
    returned.

    Parameters
    ----------
    problem : Problem
        The problem.
    reason : Reason
        Reason why it cannot be planned.
    plan : callable
        Plans a problem. Returns its duration or a reason.
    duration : float or None
        Duration of the motion in which the check found a limit exceeded, s.
    feasible : callable or None
        Like `plan`, but returns the first motion that it finds. None: `plan` itself.
    work : Work or None
        Counter of the work of `plan`.
    budget : float
        Work after which no further trial begins.

    Returns
    -------
    TriedRelaxation or None
        The change and other attempts. If no change gives a motion, the change of the limit in the
        reason, with the reason why it does not suffice. None if nothing was found.
    """
    relaxation = relaxation_for(problem, reason)
    if relaxation is None and eye_forbids_target(problem):
        return None
    work = work or Work()
    trials = _RelaxationSearch(plan, feasible or plan, work, work.spent + budget)
    # The other relaxations come first because they need few trials. The search for the smallest
    # change of the limit may take all remaining work.
    others = [
        trials.smallest_share(*other)
        for other in _other_relaxations(problem, reason, duration)
        if trials.has_budget
    ]
    attempt = (
        trials.first_change_that_helps(problem)
        if relaxation is None
        else trials.smallest_joint_change(relaxation)
    )
    working = [item for item in (attempt, *others) if item is not None and item.works]
    return replace(working[0], alternatives=tuple(working[1:])) if working else attempt


def changes_of_limits(problem: Problem, relaxed: Problem) -> dict[float, tuple[str, Problem]]:
    """Return multiples of the changes by which a relaxed problem differs from a problem.

    The page of a failed plan offers them. Shares that a limit cannot follow are left out. Durations
    are not changed.

    Parameters
    ----------
    problem : Problem
        The problem without a motion.
    relaxed : Problem
        The problem with the smallest change of its limits that gives a motion.

    Returns
    -------
    dict
        For each of `OFFERED_SHARES`, the changes in words and the problem that they give.
    """
    pairs = zip(problem.all_limits, relaxed.all_limits, strict=False)
    moved = [(a, b) for a, b in pairs if a != b and a.key == b.key]
    changes: dict[float, tuple[str, Problem]] = {}
    for share in OFFERED_SHARES if moved else ():
        changed, words = problem, []
        for limit, looser in moved:
            needed = looser.low if looser.high == limit.high else looser.high
            relaxation = Relaxation(changed, limit, needed)
            value = relaxation.value(share)
            if limit.relaxed(value) is None:
                return changes
            changed = relaxation.problem(value)
            words.append(relaxation.describe(value))
        changes[share] = " and ".join(words), changed
    return changes


@record
class _RelaxationSearch:
    """Search for the smallest changes of limits (relaxations) that give a motion."""

    plan: Planner
    """Plans a problem completely."""
    feasible: Planner
    """Like `plan`, but returns the first motion that it finds."""
    work: Work
    """Counter of the work of both."""
    limit: float
    """Work (the field `spent` of the counter) after which no further trial begins."""

    @property
    def has_budget(self) -> bool:
        """True if another trial may begin."""
        return self.work.spent < self.limit

    def smallest_share(
        self,
        relaxation: Relaxation,
        shares: Sequence[float],
        lower: float = 0.0,
        *,
        stop_if: Callable[[TriedRelaxation], bool] = lambda _: False,
    ) -> TriedRelaxation:
        """Find the smallest share of a relaxation that gives a complete plan.

        A bisection with the cheaper function `feasible` comes first. A second bisection with `plan`
        starts from its result.

        Parameters
        ----------
        relaxation : Relaxation
            The change.
        shares : sequence of float
            Increasing shares of the change, tried in turn until one gives a motion.
        lower : float
            A share that gives no motion.
        stop_if : callable
            Returns True for a failed attempt if larger shares cannot help either.

        Returns
        -------
        TriedRelaxation
            The smallest change that gives a motion, or the last one that was tried.
        """
        lower, upper, attempt = self._bisect_share(
            relaxation, shares, lower, self.feasible, stop_if
        )
        if attempt.works and self.plan is not self.feasible:
            remaining = [upper, *(share for share in shares if share > upper)]
            _, _, attempt = self._bisect_share(relaxation, remaining, lower, self.plan, stop_if)
        return attempt

    def _bisect_share(
        self,
        relaxation: Relaxation,
        shares: Sequence[float],
        lower: float,
        plan: Planner,
        stop_if: Callable[[TriedRelaxation], bool],
    ) -> tuple[float, float, TriedRelaxation]:
        """Find the smallest share of a relaxation with which a motion exists, by bisection.

        A share is the part of the full change of the limit. The bisection ends when the largest
        share without a motion is at least `BISECTION_ACCURACY` times the smallest share with a
        motion.

        Parameters
        ----------
        relaxation : Relaxation
            The change.
        shares : sequence of float
            Increasing shares of the change, tried in turn until one gives a motion.
        lower : float
            A share that gives no motion.
        plan : callable
            Plans a problem. Returns the duration of its motion or a reason.
        stop_if : callable
            Returns True for a failed attempt if larger shares cannot help either.

        Returns
        -------
        lower : float
            The largest share without a motion.
        upper : float
            The smallest share with a motion, or the last one that was tried.
        attempt : TriedRelaxation
            The relaxation by the share `upper`.
        """

        def attempt(share: float) -> TriedRelaxation:
            """Try a share of the change."""
            self.work.spent += TRIAL_WORK
            return _try_relaxation(relaxation, relaxation.value(share), plan)

        for upper in shares:
            result = attempt(upper)
            if result.works or not self.has_budget or stop_if(result):
                break
            lower = upper
        while result.works and self.has_budget and lower < BISECTION_ACCURACY * upper:
            middle = (lower + upper) / 2 if lower else BISECTION_ACCURACY * upper
            trial = attempt(middle)
            if trial.works:
                result, upper = trial, middle
            else:
                lower = middle
        return lower, upper, result

    def smallest_change_of_limit(self, relaxation: Relaxation) -> TriedRelaxation | None:
        """Find the smallest change of one limit that gives a motion.

        The search begins at the change that the reason of the failure asks for, and continues with
        multiples of this change (`CHANGE_FACTORS`).

        Parameters
        ----------
        relaxation : Relaxation
            The limit with the bound that the reason asks for.

        Returns
        -------
        TriedRelaxation or None
            The smallest change that gives a motion, or the last one that was tried. None if the
            limit cannot have such a bound.
        """
        limit, growth = (
            relaxation.limit,
            [factor * (1 + EQUALITY_TOLERANCE) for factor in CHANGE_FACTORS],
        )
        shares = [share for share in growth if limit.relaxed(relaxation.value(share)) is not None]
        return (
            self.smallest_share(relaxation, shares, stop_if=_is_other_limit_to_blame)
            if shares
            else None
        )

    def smallest_joint_change(self, relaxation: Relaxation) -> TriedRelaxation | None:
        """Find the smallest change of one limit, or of several together, that gives a motion.

        If another limit prevents the motion after the first change, that limit is changed as well,
        and so on until there is a motion or the work budget is spent.

        Parameters
        ----------
        relaxation : Relaxation
            The first limit with the bound that the reason asks for.

        Returns
        -------
        TriedRelaxation or None
            The last change, with the others in its field `combined`. Without a motion, the first
            change alone. None if the first limit cannot have such a bound.
        """
        initial = attempt = self.smallest_change_of_limit(relaxation)
        descriptions: dict[tuple[Any, ...], str] = {}
        while attempt is not None and isinstance(attempt.outcome, Reason) and self.has_budget:
            descriptions[attempt.key] = attempt.description
            following = relaxation_for(attempt.problem, attempt.outcome)
            attempt = None if following is None else self.smallest_change_of_limit(following)
        if attempt is None or not attempt.works:
            return initial
        descriptions.pop(attempt.key, None)
        return replace(attempt, combined=tuple(descriptions.values()))

    def first_change_that_helps(self, problem: Problem) -> TriedRelaxation | None:
        """Return the first relaxation of a single limit that gives a motion.

        All limits are relaxed one by one by the first of `TRIAL_SHARES`, then by the next one. A
        share is the part of the full change that the limit proposes (`Limit.trials`).

        Parameters
        ----------
        problem : Problem
            The problem without a motion.

        Returns
        -------
        TriedRelaxation or None
            The relaxation with the smallest change that a bisection finds. None if none gives a
            motion before the work budget is spent.
        """
        for short, share in pairwise((0.0, *TRIAL_SHARES)):
            for relaxation in all_relaxations(problem):
                if not self.has_budget:
                    return None
                result = self.smallest_share(relaxation, [share], short)
                if result.works:
                    return result
        return None


def _try_relaxation(relaxation: Relaxation, value: float, plan: Planner) -> TriedRelaxation:
    """Plan a problem with a changed limit, and return the outcome.

    The problem may forbid the change. For example, the planner `toppra` supports no requested
    duration. The outcome is a reason then.

    Parameters
    ----------
    relaxation : Relaxation
        The change.
    value : float
        Value of the change, as it is printed.
    plan : callable
        Plans a problem. Returns the duration of its motion or a reason.

    Returns
    -------
    TriedRelaxation
        The relaxation with this value and its outcome.
    """
    try:
        outcome = plan(relaxation.problem(value))
    except ProblemError as error:
        outcome = Reason(message=str(error))
    return TriedRelaxation(relaxation, value, outcome)


def relaxation_for(problem: Problem, reason: Reason) -> Relaxation | None:
    """Return the relaxation of the limit that a reason names.

    Parameters
    ----------
    problem : Problem
        The problem without a motion.
    reason : Reason
        Reason of the failure, with the required and the available value.

    Returns
    -------
    Relaxation or None
        None if the reason names no limit, or one that cannot be relaxed.
    """
    if reason.limit is None or reason.required is None or reason.available is None:
        return None
    limit = problem.limit(*reason.limit.key) or reason.limit
    # For a floor, the required value is the bound, which is lowered to the available value.
    needed = limit.sufficient_bound(reason.available if limit.is_floor else reason.required)
    return None if limit.relaxed(needed) is None else Relaxation(problem, limit, needed)


def all_relaxations(problem: Problem) -> Iterator[Relaxation]:
    """Yield relaxations of all limits of a problem, joints first, then the tool.

    They serve if the reason of a failure names no limit. Each limit states the looser bounds to try
    (`Limit.trials`).

    Parameters
    ----------
    problem : Problem
        The problem without a motion.

    Yields
    ------
    Relaxation
        A limit with one of its looser bounds.
    """
    of_joints = (limit for joint in problem.robot.joints for limit in reversed(joint.limits))
    others = (limit for limit in problem.limits if limit not in problem.speeds)
    for limit in (*of_joints, *problem.speeds, *others):
        for value in limit.trials():
            yield Relaxation(problem, limit, value)


def _is_other_limit_to_blame(attempt: TriedRelaxation) -> bool:
    """Return True if a larger change of the same limit cannot help.

    This is the case if the reason of the failure names another limit, or the same limit in the
    opposite direction.

    Parameters
    ----------
    attempt : TriedRelaxation
        A change of a limit with its outcome.
    """
    if not isinstance(attempt.outcome, Reason) or attempt.outcome.limit is None:
        return False
    following = relaxation_for(attempt.problem, attempt.outcome)
    if following is None or following.limit.key != attempt.relaxation.limit.key:
        return following is not None
    upwards = following.needed > following.present
    return upwards != (attempt.value > attempt.relaxation.present)


def _other_relaxations(
    problem: Problem, reason: Reason, duration: float | None
) -> Iterator[tuple[Relaxation, Sequence[float]]]:
    """Yield relaxations that change no limit of the robot or the task, with shares to try.

    If a motor gets too hot, they are a pause and a longer duration. If the velocity at an end of
    the motion exceeds a limit, they are lower rates at this end.

    Parameters
    ----------
    problem : Problem
        The problem without a motion.
    reason : Reason
        Reason of the failure, with the required and the available value.
    duration : float or None
        Duration of the motion in which the check found a limit exceeded, s. None without a motion.

    Yields
    ------
    relaxation : Relaxation
        The change.
    shares : sequence of float
        Increasing shares of the change, to be tried in turn.
    """
    limit, required, available = reason.limit, reason.required, reason.available
    if limit is None or required is None or available is None:
        return
    if isinstance(limit, ContinuousTorque) and duration is not None:
        yield from _more_time(problem, limit, duration, (required / available) ** 2 - 1)
    if limit.name in LIMITS_OF_END_RATES:
        possible = available / required if required > available > 0 else 0.0
        shares = sorted({1 - possible, 1.0})
        ends = (ReducedRates(problem, limit, 0.0, end) for end in get_args(End))
        yield from ((relaxation, shares) for relaxation in ends if relaxation.rates)


def _more_time(
    problem: Problem, limit: Limit, duration: float, excess: float
) -> Iterator[tuple[Relaxation, Sequence[float]]]:
    """Yield a pause and a longer duration for a motion that makes a motor too hot.

    Parameters
    ----------
    problem : Problem
        The problem.
    limit : Limit
        Limit on the continuous torque of the motor.
    duration : float
        Duration of the motion, s.
    excess : float
        Relative excess of heat, (RMS torque / continuous torque)² − 1.
    """
    if not problem.end_rate:
        yield Pause(problem, limit, duration * excess), CHANGE_FACTORS
    if any(entry.duration is None for entry in problem.motion):
        yield Relaxation(problem, Duration(duration), 2 * duration), CHANGE_FACTORS


def _round_down(value: float) -> float:
    """Round down to three digits."""
    if value == 0.0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(abs(value))) - 2)
    return round(math.floor(round(value / unit, 6)) * unit, 12)
