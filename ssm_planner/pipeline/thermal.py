"""Search for the fastest motion whose motors keep their continuous torque.

The RMS torque of a motor over the motion must not exceed its continuous torque, or its windings get
too hot. If the fastest motion violates this limit, `ThermalSearch` trades time for heat. It
minimises the duration T subject to

    h_i ≤ T + P,   h_i = ∫ (τ_i/n_i)² dt,

for every motor i with its torque τ_i and its continuous torque n_i, over all phases, with the pause
P before the motion repeats. With one multiplier λ in [0, 1) for the constraints of the hot motors,
every phase minimises T_k + λ/(1 − λ) Σ_i h_ik by itself (Lagrangian relaxation). The phases share
only λ, and the excess of heat e = max_i h_i/(T + P) − 1 falls with λ. Near the optimum,
dT = −λ/(1 − λ) dh, so a motion with e = −GAP takes longer than the fastest one by a share of less
than GAP.

Towards λ = 1, time costs nothing, and every phase (entry of the motion list) takes the time in
which it produces the least heat. If the motors are still too hot then, they only cool if they rest
or move more slowly. First, the phases in which the hot motors rest take longer, because that adds
no heat. If the hot motors never rest, or if longer rests do not suffice, all phases take longer and
are planned again for the least heat.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ssm_planner.pipeline.certified import Outcome, check_result
from ssm_planner.planning.planned_phase import PlannedPhase
from ssm_planner.planning.planner import join_phases, with_duration
from ssm_planner.planning.tolerances import EQUALITY_TOLERANCE, GAP
from ssm_planner.problem import Dwell, Free, Problem, Straight, unchecked_copy
from ssm_planner.typing import Array

HEAT_MULTIPLIERS: tuple[float, ...] = (0.5, 0.8, 0.95)
"""Values of the multiplier λ that are tried in turn until the motors are cool enough.

They bracket the root for the search that follows. λ = 1 would ignore time.
"""
SLOWDOWN_SHARES: tuple[float, ...] = (0.2, 1.0, 4.0)
"""Shares by which all phases take longer, tried in turn until the motors are cool enough.

They bracket the root for the search that follows.
"""


def with_fast_planner(problem: Problem) -> Problem:
    """Return the problem with the planner `fast` in place of `optimal`.

    The structured solver then finds the motion, and Ipopt does not confirm it.
    """
    return unchecked_copy(problem, planner="fast") if problem.planner == "optimal" else problem


@dataclass(eq=False)
class ThermalSearch:
    """Search for the fastest motion in which no motor gets too hot.

    It begins with a motion that keeps all other limits, but in which the RMS torque of a motor
    exceeds its continuous torque. `run` returns the result.
    """

    problem: Problem
    """The problem."""
    initial: Outcome
    """Motion without any weight of heat."""
    plan: Callable[[Problem, Array], Outcome]
    """Plans and checks a problem with weights of the motors' heat, (4,)."""

    def __post_init__(self) -> None:
        """Begin with the motion without any weight of heat."""
        self.hot = set(self.initial.hot_joints)
        """Names of the joints whose motors were too hot in any motion."""
        self.best = 0.0, self.initial
        """Multiplier λ and motion with the smallest sum of duration and necessary rest so far."""

    def run(self) -> Outcome | None:
        """Return the fastest certified motion, or None if none was found.

        Three families of motions are tried in turn: with a weight of heat, with longer rests of the
        hot motors, and with all phases slower. Ipopt confirms only the last motion.

        Returns
        -------
        Outcome or None
            The checked motion. None if all motions are too hot or exceed another limit.
        """
        problem, quick = self.problem, with_fast_planner(self.problem)
        if problem.duration is not None or all(motion.duration for motion in problem.motion):
            # Weights of any size only shift heat from one instant to another.
            outcome = self._plan_with_multiplier(problem, HEAT_MULTIPLIERS[0])
            return outcome if outcome.passed else None
        families = (
            (self._plan_with_multiplier, HEAT_MULTIPLIERS),
            (self._extend_rests, (1.0,)),
            (self._plan_for_least_heat, SLOWDOWN_SHARES),
        )
        for family, numbers in families:
            result = _find_smallest_cool(partial(family, quick), numbers, self.best[1])
            if result is not None:
                number, outcome = result
                confirmed = outcome if problem is quick else family(problem, number)
                # Among motions of little heat, Ipopt may converge to one that is far longer.
                longer = confirmed.duration > (1 + GAP) * outcome.duration
                return outcome if longer else confirmed
        return None

    def _plan_with_multiplier(self, problem: Problem, multiplier: float) -> Outcome:
        """Plan with a multiplier λ of the heat of the hot motors, and remember the best motion.

        The best motion is the one with the shortest sum of its duration and of the rest after which
        the hottest motor is cool enough.

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
        outcome = self.plan(problem, self._hot_weights(multiplier / (1 - multiplier)))
        self.hot |= outcome.hot_joints
        candidates = (self.best, (multiplier, outcome))
        self.best = min(candidates, key=lambda item: self._duration_with_rest(item[1]))
        return outcome

    def _extend_rests(self, problem: Problem, share: float) -> Outcome:
        """Return the best motion, with longer phases in which all hot motors rest.

        Without such phases, the motion is returned unchanged.

        Parameters
        ----------
        problem : Problem
            The problem, with the planner that computes the motion.
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
        """Plan for the least heat, in phases that take longer by a share than in the best motion.

        If the motions cannot be planned one by one, the best motion is slowed down instead.

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
        if not replannable or len(phases) != len(problem.motion):  # Corners join phases.
            return self._check_slower_phases(base, list(map(_may_take_longer, phases)), 1 + share)
        durations = [(1 + share) * phase.duration for phase in phases]
        motion = tuple(map(with_duration, problem.motion, durations))
        outcome = self.plan(unchecked_copy(problem, motion=motion), self._hot_weights(1.0))
        # The durations belong to the search, so the lower bounds are those of the fastest motion.
        bounds = zip(outcome.planned.phases, phases, strict=False)
        slower = tuple(replace(new, lower_bound=old.lower_bound) for new, old in bounds)
        return replace(outcome, planned=replace(outcome.planned, phases=slower))

    def _check_slower_phases(self, base: Outcome, longer: list[bool], factor: float) -> Outcome:
        """Slow some phases of a motion down along their paths, and check the result.

        Parameters
        ----------
        base : Outcome
            The motion.
        longer : list of bool
            True for each phase that is slowed down.
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
        """Return the weights of the motors' heat relative to time, (4,).

        Parameters
        ----------
        weight : float
            Weight of every motor that was too hot in any motion. The others have the weight 0.
        """
        return weight * np.array([joint.name in self.hot for joint in self.problem.robot.joints])

    def _duration_with_rest(self, outcome: Outcome) -> float:
        """Return the duration with a rest that makes the hottest motor cool enough, s.

        A rest adds no heat. With the excess of heat e, the duration T and the pause P before the
        motion repeats, the rest takes e (T + P).

        Parameters
        ----------
        outcome : Outcome
            A planned motion with its certificate.

        Returns
        -------
        float
            Duration, s. Infinite if there is no motion, or if the motion exceeds another limit.
        """
        if outcome.excess_heat is None:
            return np.inf
        duration = sum(phase.duration for phase in outcome.planned.phases)
        excess = max(outcome.excess_heat, 0.0) + EQUALITY_TOLERANCE
        return duration + excess * (duration + (self.problem.duty or 0.0))


def _find_smallest_cool(
    motion: Callable[[float], Outcome], numbers: tuple[float, ...], hottest: Outcome
) -> tuple[float, Outcome] | None:
    """Find the smallest number for which no motor gets too hot, and the motion for this number.

    The number is a multiplier of heat, a share of the necessary rest, or a share by which all
    phases take longer. A motion is called cool if it passes the check. The excess of heat,
    h / (T + P) − 1 with the symbols of the module's docstring, falls with the number. Its root is
    bracketed between two of the `numbers` and found by the Illinois method, a variant of false
    position. The result is on the cool side of the root, with an excess above −GAP, or within GAP
    of a number whose motion is too hot.

    Parameters
    ----------
    motion : callable
        Returns the checked motion for a number.
    numbers : tuple of float
        Increasing numbers, tried in turn until one gives a cool motion.
    hottest : Outcome
        Motion for the number 0.

    Returns
    -------
    tuple of float and Outcome, or None
        The number and its motion. None if no number gives a cool motion, if the excess changes by
        less than `GAP` from one number to the next, or if a motion exceeds another limit.
    """
    # The root lies between `lower`, whose motion has the excess `excess_at_lower` > 0, and `upper`,
    # whose motion stays below the allowed heat by the share `margin_at_upper` ≥ 0.
    lower, excess_at_lower = 0.0, hottest.excess_heat or 0.0
    for upper in numbers:
        outcome = motion(upper)
        if outcome.passed:
            break
        excess = outcome.excess_heat
        if excess is None or (lower and abs(excess - excess_at_lower) <= GAP):
            return None
        lower, excess_at_lower = upper, excess
    else:
        return None
    margin_at_upper, last = -(outcome.excess_heat or 0.0), ""
    while upper - lower > GAP and -(outcome.excess_heat or 0.0) > GAP:
        secant = excess_at_lower / (excess_at_lower + margin_at_upper)
        middle = lower + float(np.clip(secant, 0.02, 0.98)) * (upper - lower)
        trial = motion(middle)
        # The Illinois method halves the value of an end of the interval that stays twice.
        if trial.passed:
            upper, outcome, margin_at_upper = middle, trial, -(trial.excess_heat or 0.0)
            excess_at_lower, last = excess_at_lower / (2 if last == "cool" else 1), "cool"
        else:
            lower, excess_at_lower = middle, trial.excess_heat or excess_at_lower
            margin_at_upper, last = margin_at_upper / (2 if last == "hot" else 1), "hot"
    return upper, outcome


def _may_take_longer(phase: PlannedPhase) -> bool:
    """Return True if nothing prescribes the duration or the speed of a phase."""
    motion = phase.phase.motion
    prescribed = motion.duration or getattr(motion, "constant_speed", None)
    return not prescribed and phase.phase.begins_and_ends_at_rest
