"""Search for the smallest change of limits that gives a problem without a motion a motion.

Such a change is called a *relaxation*. It is a looser bound of a limit, a pause at the end of the
motion, or lower rates at one end of it. `find_relaxation` starts from the reason of the failure,
which names a limit and the value that the motion would need. Each change is rounded to the digits
that are printed, and the problem is planned with the rounded value before the change is reported.
"""

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
from ssm_planner.problem.limit import replace_fields, round_away
from ssm_planner.typing import record
from ssm_planner.units import display_unit

CHANGE_FACTORS = (1.0, 1.1, 1.5, 3.0)
"""Factors on the change that the reason of a failure asks for, tried in turn.

The first factor that gives a motion is taken. A bisection then tries smaller changes.
"""
BISECTION_ACCURACY = 0.9
"""Largest change that does not suffice, divided by the smallest one that does, at the end.

The bisection ends when this ratio is reached. The reported change is thus at most 1 / 0.9, that is,
about 11 %, larger than necessary.
"""
TRIAL_SHARES = (0.1, 1.0)
"""Shares of the change that each limit proposes (`Limit.trials`), tried in turn.

They serve if the reason of the failure names no limit that can be relaxed.
"""
TRIAL_WORK = 0.1
"""Work (`Work.spent`) that a trial takes in addition to the solvers.

It stands for the tests of the changed problem and the independent check of the motion.
"""
OFFERED_SHARES = (1.0, 1.5, 2.0, 3.0)
"""Multiples of a relaxation that the page of a failed plan offers to the user."""
LIMITS_OF_END_RATES = (JointVelocity.name, JointAcceleration.name, StopTravel.name)
"""Names of the limits that the velocity at an end of the motion can exceed."""

End = Literal["start_rate", "end_rate"]
"""Field of a problem with the rates of the task coordinates at one end of the motion."""
Planner = Callable[[Problem], "float | Reason"]
"""Function that plans a problem. It returns the duration of a certified motion in s, or a reason.

A motion is certified if it has passed the independent check.
"""


@record
class Relaxation:
    """A change of a problem that may make a motion possible, in steps of any size.

    This class changes the bound of a limit from `present` towards `needed`. A *value* is a bound in
    between or beyond. Subclasses change something else, and define what their value means.
    """

    base: Problem
    """The problem without the change."""
    limit: Limit
    """The limit to be changed."""
    needed: float
    """Bound with which the motion should become possible, in SI units."""

    @property
    def present(self) -> float:
        """Present bound of the limit, in SI units."""
        return self.limit.bound(self.needed)

    def value(self, share: float) -> float:
        """Return the bound after a share of the change from `present` to `needed`.

        The share 0 gives `present`, and 1 gives `needed`. The bound is rounded to the digits that
        are printed.
        """
        return self.limit.rounded(self.present + share * (self.needed - self.present))

    def problem(self, value: float) -> Problem:
        """Return the problem in which the limit has another bound.

        Parameters
        ----------
        value : float
            The bound in SI units, from the method `value`.

        """
        relaxed = self.limit.relaxed(value)
        assert relaxed is not None  # `relaxation_for` and its callers make sure that it exists.
        return relaxed.on(self.base)

    def describe(self, value: float) -> str:
        """Describe the change from the present bound to another one in words."""
        return self.limit.described(value)


class Pause(Relaxation):
    """A relaxation that adds a dwell (a time at rest) after the motion, in which motors cool.

    The value of this change is the duration of the dwell in s. The field `needed` is the duration
    with which the motors should be cool enough.
    """

    present = 0.0

    def value(self, share: float) -> float:
        """Return the duration of the dwell in s, `share` times `needed`, rounded up."""
        return round_away(share * self.needed, self.present, digits=3)

    def problem(self, value: float) -> Problem:
        """Return the problem with a dwell of the duration `value` at the end.

        A requested duration of the whole problem grows by that of the dwell.
        """
        duration = None if self.base.duration is None else self.base.duration + value
        return replace(
            self.base, motion=(*self.base.motion, Dwell(value, "pause")), duration=duration
        )

    def describe(self, value: float) -> str:
        """Describe the dwell of the duration `value` in words."""
        return f"a dwell of {value:.6g} s at the end"


@record
class ReducedRates(Relaxation):
    """A relaxation that multiplies the requested rates at one end of the motion by a factor.

    The rates are those of the task coordinates (roll, tilt, spin and depth). The value of this
    change is the factor, from 1 (the requested rates) down to 0 (rest).
    """

    end: End = "start_rate"
    present = 1.0

    def value(self, share: float) -> float:
        """Return the factor 1 − `share`, rounded down to three digits."""
        return round_away(1 - share, self.present, digits=3)

    @property
    def rates(self) -> Mapping[str, float]:
        """Requested rates at this end by the name of the task coordinate, rad/s and m/s."""
        return self.base.start_rate if self.end == "start_rate" else self.base.end_rate

    def problem(self, value: float) -> Problem:
        """Return the problem whose rates at this end are multiplied by the factor `value`."""
        reduced = {name: value * rate for name, rate in self.rates.items()}
        return replace_fields(self.base, **{self.end: reduced})

    def describe(self, value: float) -> str:
        """Describe the reduced and the requested rates in words."""
        return f"{self.end} of {self._text(value)} instead of {self._text(1.0)}"

    def _text(self, share: float) -> str:
        """Return the rates multiplied by `share`, in the notation of a problem file."""
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
    """Value of the change that was tried, rounded to the digits that are printed."""
    outcome: float | Reason
    """Duration of the motion with the change, s, or the reason of the failure."""
    combined: tuple[str, ...] = ()
    """Descriptions of further changes, without which this one does not suffice."""
    alternatives: "tuple[TriedRelaxation, ...]" = ()
    """Other changes, each of which gives a motion alone."""

    @property
    def works(self) -> bool:
        """True if there is a motion with the change."""
        return isinstance(self.outcome, float)

    @property
    def problem(self) -> Problem:
        """The problem with the change."""
        return self.relaxation.problem(self.value)

    @property
    def key(self) -> tuple[Any, ...]:
        """Key of the limit, and True if its bound is lowered.

        A range has a lower and an upper bound. The direction of the change tells which one changes.
        """
        limit = self.relaxation.limit
        return limit.key, self.value < limit.bound(self.value)

    @property
    def description(self) -> str:
        """The change in words."""
        return self.relaxation.describe(self.value)

    @property
    def text(self) -> str:
        """The change and its outcome in words, followed by the alternatives."""
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

    Each change is rounded to the digits that are printed. The function `plan` then plans the
    problem with the rounded change before it is returned.

    Parameters
    ----------
    problem : Problem
        The problem, which is infeasible within its limits.
    reason : Reason
        Reason of the failure.
    plan : callable
        Function that plans a problem. It returns the duration of the motion in s, or a reason.
    duration : float or None
        Duration of the motion that exceeds a limit according to the check, s. None without a
        motion at all.
    feasible : callable or None
        Like `plan`, but faster, because it returns the first motion that it finds. None: `plan` is
        used.
    work : Work or None
        Counter of the work of `plan` and `feasible`.
    budget : float
        Work after which no further trial begins.

    Returns
    -------
    TriedRelaxation or None
        A change with its outcome, and other changes that give a motion as its `alternatives`. If no
        change gives a motion, the result is the change of the limit that the reason names, with the
        reason why it does not suffice. None if this change does not exist either.
    """
    relaxation = relaxation_for(problem, reason)
    if relaxation is None and eye_forbids_target(problem):
        return None
    work = work or Work()
    trials = _RelaxationSearch(plan, feasible or plan, work, work.spent + budget)
    # A pause, a longer duration and lower rates come first because they need few trials. The search
    # for the smallest change of the limit may take all remaining work.
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
    """Return problems whose limits are changed by multiples of a relaxation.

    The page of a failed plan offers them, because a looser limit may permit a faster motion.

    Parameters
    ----------
    problem : Problem
        The problem without a motion.
    relaxed : Problem
        The same problem with the smallest change of its limits that gives a motion.

    Returns
    -------
    dict
        For each of `OFFERED_SHARES`, all changes in words, and the problem with these changes.
        Shares from the first one on that is too large for a limit are left out. The result is empty
        if no limit differs, for example if the relaxation is a pause.
    """
    pairs = zip(problem.all_limits, relaxed.all_limits, strict=False)
    moved = [(a, b) for a, b in pairs if a != b and a.key == b.key]
    changes: dict[float, tuple[str, Problem]] = {}
    for share in OFFERED_SHARES if moved else ():
        changed, words = problem, []
        for limit, looser in moved:
            # If the upper bounds are equal, the lower bound was relaxed.
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
    """Function that plans a problem completely."""
    feasible: Planner
    """Like `plan`, but faster, because it returns the first motion that it finds."""
    work: Work
    """Counter of the work of both."""
    limit: float
    """Value of `work.spent` from which on no further trial begins."""

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
        """Find the smallest share of a relaxation (change of a limit) that gives a motion.

        A bisection with the faster function `feasible` comes first. A second bisection with the
        function `plan` starts from its result, because the change must suffice for a complete plan.
        Each ends when the largest share without a motion is at least `BISECTION_ACCURACY` times the
        smallest share with a motion, or when the work budget is spent.

        Parameters
        ----------
        relaxation : Relaxation
            The change.
        shares : sequence of float
            Increasing shares of the full change, tried in turn until one gives a motion.
        lower : float
            A share below all of these, which does not suffice.
        stop_if : callable
            Function that receives a failed attempt. It returns True if larger shares cannot help.

        Returns
        -------
        TriedRelaxation
            The smallest change that gives a motion, or the last one that was tried.
        """
        # dict.fromkeys leaves one function if both are the same.
        for plan in dict.fromkeys((self.feasible, self.plan)):
            for upper in shares:
                result = self._attempt(relaxation, upper, plan)
                if result.works or not self.has_budget or stop_if(result):
                    break
                lower = upper
            while result.works and self.has_budget and lower < BISECTION_ACCURACY * upper:
                # The first change is usually nearly the smallest one. A share a little below it
                # then ends the bisection at once.
                middle = (lower + upper) / 2 if lower else BISECTION_ACCURACY * upper
                trial = self._attempt(relaxation, middle, plan)
                if trial.works:
                    result, upper = trial, middle
                else:
                    lower = middle
            if not result.works:
                break
            shares = [upper, *(share for share in shares if share > upper)]
        return result

    def _attempt(self, relaxation: Relaxation, share: float, plan: Planner) -> TriedRelaxation:
        """Plan a problem with a share of a change of a limit, and count the work of the trial.

        Parameters
        ----------
        relaxation : Relaxation
            The change.
        share : float
            Share of the full change.
        plan : callable
            Function that plans a problem. It returns the duration of the motion in s, or a reason.

        Returns
        -------
        TriedRelaxation
            The change by this share, with its outcome.
        """
        self.work.spent += TRIAL_WORK
        value = relaxation.value(share)
        try:
            outcome = plan(relaxation.problem(value))
        # The problem forbids the change. For example, TOPP-RA cannot plan for a given duration.
        except ProblemError as error:
            outcome = Reason(message=str(error))
        return TriedRelaxation(relaxation, value, outcome)

    def smallest_change_of_limit(self, relaxation: Relaxation) -> TriedRelaxation | None:
        """Find the smallest change of one limit that gives a motion.

        The search tries the change that the reason of the failure asks for, and multiples of it
        (`CHANGE_FACTORS`), until there is a motion. A bisection then looks for a smaller change.

        Parameters
        ----------
        relaxation : Relaxation
            The change of the limit that the reason asks for.

        Returns
        -------
        TriedRelaxation or None
            The smallest change that gives a motion, or the last one that was tried. None if the
            limit cannot have any of these bounds.
        """
        # The small increase keeps rounding errors from making the first bound too tight.
        factors = [factor * (1 + EQUALITY_TOLERANCE) for factor in CHANGE_FACTORS]
        shares = [share for share in factors if relaxation.limit.relaxed(relaxation.value(share))]
        if not shares:
            return None
        return self.smallest_share(relaxation, shares, stop_if=_is_other_limit_to_blame)

    def smallest_joint_change(self, relaxation: Relaxation) -> TriedRelaxation | None:
        """Find changes of one limit, or of several limits together, that give a motion.

        If another limit prevents the motion after the first change, that limit is changed as well.
        This is repeated until there is a motion or the work budget is spent.

        Parameters
        ----------
        relaxation : Relaxation
            The change of the first limit, which the reason of the failure asks for.

        Returns
        -------
        TriedRelaxation or None
            The last change, with the others in its field `combined`. If they do not suffice, the
            result is the first change alone. None if the first limit cannot be changed so far.
        """
        initial = attempt = self.smallest_change_of_limit(relaxation)
        descriptions: dict[tuple[Any, ...], str] = {}
        while attempt is not None and isinstance(attempt.outcome, Reason) and self.has_budget:
            descriptions[attempt.key] = attempt.description
            following = relaxation_for(attempt.problem, attempt.outcome)
            attempt = None if following is None else self.smallest_change_of_limit(following)
        if attempt is None or not attempt.works:
            return initial
        # The last change may replace an earlier one of the same limit.
        descriptions.pop(attempt.key, None)
        return replace(attempt, combined=tuple(descriptions.values()))

    def first_change_that_helps(self, problem: Problem) -> TriedRelaxation | None:
        """Relax one limit after the other until there is a motion.

        It serves if the reason of the failure names no limit to relax. Each limit proposes a looser
        bound (`Limit.trials`). All limits are first relaxed one by one by the first of
        `TRIAL_SHARES` of this change, and then by the next share.

        Parameters
        ----------
        problem : Problem
            The problem without a motion.

        Returns
        -------
        TriedRelaxation or None
            The first limit whose relaxation gives a motion, with the smallest such change that a
            bisection finds. None if the search finds no motion before the work budget is spent.
        """
        # `short` is the previous share, which has given no motion.
        for short, share in pairwise((0.0, *TRIAL_SHARES)):
            for relaxation in all_relaxations(problem):
                if not self.has_budget:
                    return None
                result = self.smallest_share(relaxation, [share], short)
                if result.works:
                    return result
        return None


def relaxation_for(problem: Problem, reason: Reason) -> Relaxation | None:
    """Return the change of the limit that the reason of a failure names.

    Parameters
    ----------
    problem : Problem
        The problem without a motion.
    reason : Reason
        Reason of the failure, with the required and the available value of a limited quantity.

    Returns
    -------
    Relaxation or None
        The change from the present bound to one that allows the required value. None if the reason
        names no limit, or one that cannot be relaxed.
    """
    if reason.limit is None or reason.required is None or reason.available is None:
        return None
    limit = problem.limit(*reason.limit.key) or reason.limit
    # A floor is a lower bound, which the reason states as the required value. It is relaxed to the
    # available value.
    needed = limit.sufficient_bound(reason.available if limit.is_floor else reason.required)
    return None if limit.relaxed(needed) is None else Relaxation(problem, limit, needed)


def all_relaxations(problem: Problem) -> Iterator[Relaxation]:
    """Yield relaxations (changes to looser bounds) of all limits of a problem.

    Limits of joints come first, then those of the tool's speeds, then all others. They serve if the
    reason of a failure names no limit. Each limit proposes the looser bounds to try
    (`Limit.trials`).

    Parameters
    ----------
    problem : Problem
        The problem without a motion.

    Yields
    ------
    Relaxation
        The change of one limit to one of these bounds.
    """
    of_joints = (limit for joint in problem.robot.joints for limit in reversed(joint.limits))
    others = (limit for limit in problem.limits if limit not in problem.speeds)
    for limit in (*of_joints, *problem.speeds, *others):
        for value in limit.trials():
            yield Relaxation(problem, limit, value)


def _is_other_limit_to_blame(attempt: TriedRelaxation) -> bool:
    """Return True if a larger change of the same limit cannot help.

    This is the case if the reason of the failure names another limit that can be relaxed, or asks
    for a change of the same limit in the opposite direction.

    Parameters
    ----------
    attempt : TriedRelaxation
        A change of a limit that does not suffice.
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
    """Yield changes of the problem that keep the limits of the robot and the task.

    If a motor gets too hot, these are a pause and a longer duration. If the failure may be due to
    the velocity at an end of the motion, they are lower rates at each end that has rates.

    Parameters
    ----------
    problem : Problem
        The problem without a motion.
    reason : Reason
        Reason of the failure, with the required and the available value.
    duration : float or None
        Duration of the motion that exceeds a limit according to the check, s. None without a
        motion at all.

    Yields
    ------
    relaxation : Relaxation
        The change.
    shares : sequence of float
        Increasing shares of the full change, to be tried in turn.
    """
    limit, required, available = reason.limit, reason.required, reason.available
    if limit is None or required is None or available is None:
        return
    if isinstance(limit, ContinuousTorque) and duration is not None:
        # Without torque, a pause of `excess` times the duration reduces the mean heat to its limit.
        excess = (required / available) ** 2 - 1
        if not problem.end_rate:
            yield Pause(problem, limit, duration * excess), CHANGE_FACTORS
        if any(entry.duration is None for entry in problem.motion):
            yield Relaxation(problem, Duration(duration), 2 * duration), CHANGE_FACTORS
    if limit.name in LIMITS_OF_END_RATES:
        # A velocity is proportional to the rates, so this factor on the rates should suffice. Rest
        # is tried too.
        possible = available / required if required > available > 0 else 0.0
        shares = sorted({1 - possible, 1.0})
        for end in get_args(End):
            relaxation = ReducedRates(problem, limit, 0.0, end)
            if relaxation.rates:
                yield relaxation, shares
