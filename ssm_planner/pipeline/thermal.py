"""Search for the fastest motion in which no motor gets too hot.

The windings of a motor get too hot if its RMS torque over the motion exceeds its continuous torque.
If the fastest motion violates this limit, `ThermalSearch` searches a slower one that keeps it. It
minimises the duration T subject to

    h_i ≤ T + P,   h_i = ∫ (τ_i/n_i)² dt,

for every motor i with the torque τ_i and the continuous torque n_i. The integral is over the whole
motion, and P is the pause before the motion repeats. h_i is called the heat of the motor.

The constraints are replaced by a price for heat (Lagrangian relaxation). All hot motors have the
same multiplier λ, 0 ≤ λ < 1. Each phase k (entry of the motion list) then minimises its own
T_k + λ/(1 − λ) Σ_i h_ik, where the sum is over the hot motors. The excess of heat
e = max_i h_i/(T + P) − 1 falls with λ, so the search looks for the λ at which e = 0. Near it,
dT = −λ/(1 − λ) dh, so a motion with e = −GAP takes longer than the fastest one by a share of less
than GAP.

Towards λ = 1, time costs nothing, and every phase takes the time in which it produces the least
heat. If motors are still too hot then, they only cool if they rest or move more slowly. First, the
phases in which the hot motors rest take longer, because that adds no heat. If the hot motors never
rest, or if longer rests do not suffice, all phases take longer and are planned again for the least
heat.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ssm_planner.pipeline.certified import Outcome, check_result, plan_and_check
from ssm_planner.planning.planned_phase import PlannedPhase
from ssm_planner.planning.planner import join_phases, with_duration
from ssm_planner.planning.tolerances import EQUALITY_TOLERANCE, GAP
from ssm_planner.planning.work import Work
from ssm_planner.problem import Dwell, Free, Problem, Straight, unchecked_copy
from ssm_planner.typing import Array

HEAT_MULTIPLIERS: tuple[float, ...] = (0.5, 0.8, 0.95)
"""Multipliers λ of the heat (module's docstring), tried in turn until the motors are cool enough.

The search that follows looks for the smallest sufficient λ between the last two of them. λ = 1
would ignore time.
"""
SLOWDOWN_SHARES: tuple[float, ...] = (0.2, 1.0, 4.0)
"""Shares by which all phases take longer, tried in turn until the motors are cool enough.

The search that follows looks for the smallest sufficient share between the last two of them.
"""


def with_fast_planner(problem: Problem) -> Problem:
    """Return the problem with the planner `fast` in place of `optimal`.

    The structured solver of this package then finds the motion, and Ipopt does not confirm it.
    Problems with other planners are returned unchanged.
    """
    return unchecked_copy(problem, planner="fast") if problem.planner == "optimal" else problem


@dataclass(eq=False)
class ThermalSearch:
    """Search for the fastest motion in which no motor gets too hot.

    It begins with a motion in which the RMS torque of a motor exceeds its continuous torque. This
    motion must keep all other limits. `run` returns the result.
    """

    problem: Problem
    """The problem."""
    initial: Outcome
    """The motion that was planned without any weight of heat."""
    work: Work
    """Counter of the computational work, to which the search adds."""

    def __post_init__(self) -> None:
        """Set the state of the search to the initial motion."""
        self.hot = set(self.initial.hot_joints)
        """Names of the joints whose motors were too hot in any motion so far."""
        self.best = 0.0, self.initial
        """The best motion so far, after its multiplier λ of the heat.

        It has the smallest sum of its duration and of the rest that the hottest motor needs.
        """

    def run(self) -> Outcome | None:
        """Search the fastest motion in which no motor gets too hot.

        Three families of motions are tried in turn. The first one gives heat a weight, the second
        one makes the rests of the hot motors longer, and the third one makes all phases (entries of
        the motion list) slower. The fast planner is used until a motion is found. Ipopt then
        confirms that motion, if the problem asks for it.

        Returns
        -------
        Outcome or None
            The motion, which has passed the check. None if all motions are too hot or exceed
            another limit.
        """
        problem, quick = self.problem, with_fast_planner(self.problem)
        if problem.duration is not None or all(motion.duration for motion in problem.motion):
            # All durations are prescribed, so a weight of heat cannot make the motion slower. It
            # only moves heat from one instant to another, and its size does not matter.
            outcome = self._plan_with_multiplier(problem, HEAT_MULTIPLIERS[0])
            return outcome if outcome.passed else None
        families = (
            (self._plan_with_multiplier, HEAT_MULTIPLIERS),
            (self._extend_rests, (1.0,)),
            (self._plan_for_least_heat, SLOWDOWN_SHARES),
        )
        for plan_with, settings in families:
            result = _find_smallest_cool(partial(plan_with, quick), settings, self.best[1])
            if result is not None:
                setting, outcome = result
                confirmed = outcome if problem is quick else plan_with(problem, setting)
                # Among motions of little heat, Ipopt may converge to one that is far longer.
                longer = confirmed.duration > (1 + GAP) * outcome.duration
                return outcome if longer else confirmed
        return None

    def _plan_with_multiplier(self, problem: Problem, multiplier: float) -> Outcome:
        """Plan with a multiplier λ of the heat of the hot motors.

        The method adds the motors that are too hot in the result to `hot`, and updates `best`.

        Parameters
        ----------
        problem : Problem
            The problem, with the planner that computes the motion.
        multiplier : float
            Multiplier λ, from 0 (only time counts) to less than 1 (only heat counts).

        Returns
        -------
        Outcome
            The motion with its certificate, or the reason of the failure.
        """
        weights = self._hot_weights(multiplier / (1 - multiplier))
        outcome = plan_and_check(problem, self.work, cooling=weights)
        self.hot |= outcome.hot_joints
        candidates = (self.best, (multiplier, outcome))
        self.best = min(candidates, key=lambda item: self._duration_with_rest(item[1]))
        return outcome

    def _extend_rests(self, problem: Problem, share: float) -> Outcome:
        """Make those phases of the best motion longer in which all hot motors rest.

        A phase is an entry of the motion list. Without such a phase, the motion is returned
        unchanged.

        Parameters
        ----------
        problem : Problem
            The problem, with the planner that computes the motion. If it is not the fast planner,
            the best motion is planned again first.
        share : float
            Share of the necessary rest. With 1, the hottest motor becomes just cool enough.

        Returns
        -------
        Outcome
            The checked motion.
        """
        multiplier, base = self.best
        if problem is not with_fast_planner(problem):
            base = self._plan_with_multiplier(problem, multiplier)
        hot = self._hot_weights(1.0) > 0
        # A joint rests if all coefficients of its polynomials except for the constant ones are 0.
        resting = [
            _may_take_longer(phase) and not phase.motion.coefficients[:, 1:, hot].any()
            for phase in base.planned.phases
        ]
        durations = [phase.duration for phase in base.planned.phases]
        duration = float(np.dot(durations, resting))
        if not duration:
            return base
        rest = self._duration_with_rest(base) - sum(durations)
        return self._check_slower_phases(base, resting, 1 + share * rest / duration)

    def _plan_for_least_heat(self, problem: Problem, share: float) -> Outcome:
        """Plan for the least heat in phases that take longer than those of the best motion so far.

        Some motions cannot be planned for a given duration, for example those along tables of
        points or with rounded corners. The best motion is slowed down along its path instead then.

        Parameters
        ----------
        problem : Problem
            The problem, with the planner that computes the motion.
        share : float
            Share by which each phase takes longer, for example 0.2 for 20 %.

        Returns
        -------
        Outcome
            The checked motion.
        """
        base = self.best[1]
        phases = base.planned.phases
        replannable = all(isinstance(entry, (Free, Straight, Dwell)) for entry in problem.motion)
        # Entries of the motion list with rounded corners between them form one phase, so the
        # numbers of phases and entries may differ.
        if not replannable or len(phases) != len(problem.motion):
            return self._check_slower_phases(base, list(map(_may_take_longer, phases)), 1 + share)
        durations = [(1 + share) * phase.duration for phase in phases]
        motion = tuple(map(with_duration, problem.motion, durations))
        slower_problem = unchecked_copy(problem, motion=motion)
        outcome = plan_and_check(slower_problem, self.work, cooling=self._hot_weights(1.0))
        # The search has chosen the durations, not the user. The lower bounds must therefore be
        # those of the phases without prescribed durations.
        bounds = zip(outcome.planned.phases, phases, strict=False)
        slower = tuple(replace(new, lower_bound=old.lower_bound) for new, old in bounds)
        return replace(outcome, planned=replace(outcome.planned, phases=slower))

    def _check_slower_phases(self, base: Outcome, longer: list[bool], factor: float) -> Outcome:
        """Slow some phases (entries of the motion list) of a motion down, and check the result.

        Parameters
        ----------
        base : Outcome
            The motion that is slowed down.
        longer : list of bool
            For each phase, True if it is slowed down.
        factor : float
            Factor on the durations of these phases.

        Returns
        -------
        Outcome
            The slower motion with its certificate.
        """
        phases = tuple(
            replace(phase, motion=phase.motion.slower(factor)) if stretched else phase
            for phase, stretched in zip(base.planned.phases, longer, strict=True)
        )
        return check_result(
            self.problem, replace(base.planned, phases=phases, trajectory=join_phases(phases))
        )

    def _hot_weights(self, weight: float) -> Array:
        """Give every motor that was too hot in any motion the same weight of its heat.

        Parameters
        ----------
        weight : float
            Weight of these motors relative to time, for example λ / (1 − λ).

        Returns
        -------
        (4,) array
            Weights of all motors. Those that were never too hot have the weight 0.
        """
        return weight * np.array([joint.name in self.hot for joint in self.problem.robot.joints])

    def _duration_with_rest(self, outcome: Outcome) -> float:
        """Return the duration of a motion and of the rest that its hottest motor needs, s.

        The robot rests after the motion until the hottest motor is cool enough. A rest adds no
        heat. With the excess of heat e, the duration T and the pause P before the motion repeats,
        the rest must therefore take e (T + P).

        Parameters
        ----------
        outcome : Outcome
            A planned motion with its certificate, or a failure.

        Returns
        -------
        float
            Duration T + e (T + P), s. Infinite without a motion, or if the motion exceeds
            another limit.
        """
        if outcome.excess_heat is None:
            return np.inf
        duration = sum(phase.duration for phase in outcome.planned.phases)
        # The small increase keeps rounding errors from making the rest too short.
        excess = max(outcome.excess_heat, 0.0) + EQUALITY_TOLERANCE
        return duration + excess * (duration + (self.problem.duty or 0.0))


def _find_smallest_cool(
    plan_with: Callable[[float], Outcome], settings: tuple[float, ...], hottest: Outcome
) -> tuple[float, Outcome] | None:
    """Find the smallest setting with which no motor gets too hot, and the motion with it.

    A *setting* is one number that slows the motion down: a multiplier of heat, a share of the
    necessary rest, or a share by which all phases take longer. A larger setting gives less heat.
    The excess of heat is h / (T + P) − 1, with the symbols of the module's docstring.

    The given settings are tried in turn until a motion passes the check. The setting before it was
    too small. Between these two, Brent's method finds the setting at which the excess is 0. It ends
    when the unused share of the permitted heat, or the interval of the settings, is at most `GAP`.

    Parameters
    ----------
    plan_with : callable
        Function that plans and checks the motion with a setting.
    settings : tuple of float
        Increasing settings.
    hottest : Outcome
        Motion with the setting 0, which is too hot.

    Returns
    -------
    tuple of float and Outcome, or None
        The setting and its motion. None if all motions are too hot, if the excess changes by at
        most `GAP` from one setting to the next, or if a motion exceeds another limit.
    """
    from scipy.optimize import brentq  # SciPy's optimisers take long to import.

    outcomes = {0.0: hottest}

    def excess(setting: float) -> float:
        """Return the excess of heat with a setting. It is 0 if the permitted heat is used."""
        if setting not in outcomes:
            outcomes[setting] = plan_with(setting)
        outcome = outcomes[setting]
        # A motion that exceeds another limit counts as too hot.
        heat = 1.0 if outcome.excess_heat is None else outcome.excess_heat
        uses_permitted_heat = outcome.passed and heat >= -GAP
        return 0.0 if uses_permitted_heat else heat

    lower = 0.0
    for upper in settings:
        if excess(upper) <= 0.0:
            break
        # The first setting may be too small to have an effect.
        has_no_effect = lower > 0.0 and excess(lower) - excess(upper) <= GAP
        if has_no_effect or outcomes[upper].excess_heat is None:
            return None
        lower = upper
    else:
        return None
    brentq(excess, lower, upper, xtol=GAP)
    smallest = min(setting for setting, outcome in outcomes.items() if outcome.passed)
    return smallest, outcomes[smallest]


def _may_take_longer(phase: PlannedPhase) -> bool:
    """Return True if a phase may be slowed down.

    This requires a phase without a prescribed duration or constant speed
    (entry of the motion list), and that it begins and ends at rest.

    Parameters
    ----------
    phase : PlannedPhase
        The phase with its motion.
    """
    motion = phase.phase.motion
    prescribed = motion.duration or getattr(motion, "constant_speed", None)
    return not prescribed and phase.phase.begins_and_ends_at_rest
