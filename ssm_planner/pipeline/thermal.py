"""Search for the fastest motion whose motors keep their continuous torque.

The problem is to minimise T subject to

    h_i ≤ T + P,   h_i = ∫ (τ_i/n_i)² dt,

for every motor i with its nominal torque n_i, over all phases, with the pause P before the motion
repeats. With one multiplier λ in [0, 1) for the constraints of the hot motors, every phase
minimises T_k + λ/(1 − λ) Σ_i h_ik by itself (Lagrangian relaxation). The phases share only λ, and
the excess of heat falls with λ.

Towards λ = 1, time costs nothing, and every phase takes the time in which it produces the least
heat. Beyond that, motors only cool if they rest or move more slowly. The phases in which the hot
motors rest are then stretched, or all phases if there is none. One number, λ and then the stretch,
thus leads from the fastest to the coolest motion. The excess of heat falls with it, and the
required motion is where the excess is zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from ssm_planner.pipeline.certified import Outcome, checked
from ssm_planner.planning.planner import joined
from ssm_planner.planning.tolerances import SAME
from ssm_planner.problem import Follow, Motion, Problem, Scan, unchecked
from ssm_planner.typing import Array

MULTIPLIERS: tuple[float, ...] = (0.5, 0.8, 0.95)
"""Values of λ that are tried in turn until the motors are cool enough."""
STRETCHES: tuple[float, ...] = (1.2, 2.0, 5.0)
"""Stretches of all phases that are tried in turn if the hot motors rest in no phase."""
RESERVE, STEPS = 2e-3, 6
"""Share of the allowed heat that may remain unused, and number of trials to reach it."""


def quickly(problem: Problem) -> Problem:
    """Return the problem for the structured solver alone, without Ipopt's confirmation."""
    return unchecked(problem, planner="fast") if problem.planner == "optimal" else problem


@dataclass(eq=False)
class ThermalSearch:
    """Search for the fastest motion in which no motor gets too hot."""

    problem: Problem
    initial: Outcome
    """Motion without any weight of heat."""
    plan: Callable[[Problem, Array], Outcome]
    """Plans and checks a problem with weights of the motors' heat, (4,)."""
    hot: set[str] = field(default_factory=set)
    coolest: tuple[float, Outcome] | None = None
    """Multiplier and motion with the smallest sum of duration and necessary rest so far."""

    def run(self) -> Outcome | None:
        """Return the fastest certified motion, or None if none was found.

        Only the last motion is confirmed by Ipopt.
        """
        problem, quick = self.problem, quickly(self.problem)
        self.hot |= self.initial.hot_joints
        timed = problem.duration is not None or all(motion.duration for motion in problem.motion)
        # If every duration is given, weights can only shift heat from one instant to another.
        numbers = MULTIPLIERS[:1] if timed else MULTIPLIERS
        over = self.initial.excess_heat or 0.0
        result = self._first_cool(
            partial(self._weighted, quick), numbers, (0.0, over), narrow=not timed
        )
        if result is not None:
            number, outcome = result
            confirmed = outcome if problem is quick else self._weighted(problem, number)
            return _confirmed_unless_longer(confirmed, outcome)
        return None if timed or self.coolest is None else self._stretch(*self.coolest)

    def _stretch(self, number: float, coolest: Outcome) -> Outcome | None:
        """Return the coolest motion, which has this multiplier, made longer until it is cool."""
        problem = self.problem
        stretched = self._stretched_until_cool(coolest)
        if stretched is None or problem is quickly(problem):
            return stretched and stretched[1]
        factor, outcome = stretched
        repeated = None
        if factor is None:
            repeated = self._stretched_until_cool(self._weighted(problem, number))
        confirmed = repeated[1] if repeated else self._slower(problem, coolest, factor or 1.0)
        return _confirmed_unless_longer(confirmed, outcome)

    def _first_cool(
        self,
        motion: Callable[[float], Outcome],
        numbers: tuple[float, ...],
        low: tuple[float, float],
        *,
        narrow: bool = True,
    ) -> tuple[float, Outcome] | None:
        """Return the first of increasing numbers that gives a cool motion, and that motion.

        None if none does.

        `low` is a smaller number that does not, with its excess of heat. `narrow` refines the
        number between the two.
        """
        for number in numbers:
            outcome = motion(number)
            if outcome.passed:
                high = number, outcome
                return _narrowed(motion, low, high) if narrow else high
            if outcome.excess_heat is None:
                return None
            low = number, outcome.excess_heat
        return None

    def _weighted(self, problem: Problem, multiplier: float) -> Outcome:
        """Plan with a multiplier of the heat of the hot motors."""
        weight = multiplier / (1 - multiplier)
        weights = [weight * (joint.name in self.hot) for joint in problem.robot.joints]
        outcome = self.plan(problem, np.array(weights))
        self.hot |= outcome.hot_joints
        smallest = np.inf if self.coolest is None else self._rested(self.coolest[1])
        if outcome.excess_heat is not None and self._rested(outcome) < smallest:
            self.coolest = multiplier, outcome
        return outcome

    def _stretched_until_cool(self, base: Outcome) -> tuple[float | None, Outcome] | None:
        """Make phases longer until the motors are cool enough.

        If the hot motors rest in some phases, only these take longer, by the time in which the
        motors cool. Otherwise, all phases do. Returns the factor of all phases (None if only some
        take longer) and the motion. Returns None if the motion does not pass its check.
        """
        phases = base.planned.phases
        may = [
            phase.phase.motion.duration is None and phase.phase.begins_and_ends_at_rest
            for phase in phases
        ]
        joints = self.problem.robot.joints
        hot = [i for i, joint in enumerate(joints) if joint.name in self.hot]
        standing = [
            free and not phase.motion.coefficients[:, 1:, hot].any()
            for free, phase in zip(may, phases, strict=True)
        ]
        standing_time = sum(
            phase.duration * stands for phase, stands in zip(phases, standing, strict=True)
        )
        if standing_time:
            longer = 1 + self._time_to_cool(base) / standing_time
            outcome = self._stretched(base, standing, longer)
            return (None, outcome) if outcome.passed else None
        return self._first_cool(
            partial(self._slower, quickly(self.problem), base),
            STRETCHES,
            (1.0, base.excess_heat or 0.0),
        )

    def _slower(self, problem: Problem, base: Outcome, factor: float) -> Outcome:
        """Plan for the least heat, with the durations of a motion multiplied by `factor`."""
        weights = [float(joint.name in self.hot) for joint in problem.robot.joints]
        phases = base.planned.phases
        if len(phases) != len(problem.motion):  # A scan, or rounded corners.
            return self._stretched(base, [True] * len(phases), factor)
        durations = [factor * phase.duration for phase in phases]
        motion = tuple(map(_with_duration, problem.motion, durations))
        outcome = self.plan(unchecked(problem, motion=motion), np.array(weights))
        # The durations belong to the search, so the lower bounds are those of the fastest motion.
        bounds = zip(outcome.planned.phases, phases, strict=False)
        slower = tuple(replace(new, lower_bound=old.lower_bound) for new, old in bounds)
        return replace(outcome, planned=replace(outcome.planned, phases=slower))

    def _stretched(self, base: Outcome, stretched: list[bool], factor: float) -> Outcome:
        """Check a motion in which some phases take `factor` times as long."""
        phases = tuple(
            replace(phase, motion=phase.motion.slower(factor)) if longer else phase
            for phase, longer in zip(base.planned.phases, stretched, strict=True)
        )
        return checked(
            self.problem, replace(base.planned, phases=phases, trajectory=joined(phases))
        )

    def _time_to_cool(self, outcome: Outcome) -> float:
        """Return the rest after which the hottest motor of a motion is cool, s."""
        duration = sum(phase.duration for phase in outcome.planned.phases)
        excess = max(outcome.excess_heat or 0.0, 0.0) + SAME
        return excess * (duration + (self.problem.duty or 0.0))

    def _rested(self, outcome: Outcome) -> float:
        """Return the duration of a motion with its necessary rest, s."""
        return sum(phase.duration for phase in outcome.planned.phases) + self._time_to_cool(outcome)


def _confirmed_unless_longer(confirmed: Outcome, outcome: Outcome) -> Outcome:
    """Return the confirmed motion, or the other one if it is shorter.

    Among motions of little heat, Ipopt may converge to one that is far longer.
    """
    return confirmed if confirmed.duration < (1 + RESERVE) * outcome.duration else outcome


def _narrowed(
    motion: Callable[[float], Outcome], low: tuple[float, float], high: tuple[float, Outcome]
) -> tuple[float, Outcome]:
    """Return the smallest number that gives a cool motion, by the method of false position.

    `low` is a number that does not, with its excess of heat.
    """
    (lower, over), (upper, solution) = low, high
    for _ in range(STEPS):
        under = -(solution.excess_heat or 0.0)
        if under < RESERVE:
            break
        middle = lower + float(np.clip(over / (over + under), 0.1, 0.9)) * (upper - lower)
        outcome = motion(middle)
        if outcome.passed:
            upper, solution = middle, outcome
            over /= 2  # Illinois modification: halve the retained value.
        else:
            lower, over = middle, outcome.excess_heat or over
    return upper, solution


def _with_duration(entry: Motion, duration: float) -> Motion:
    """Return a motion with a duration, unless it has one or cannot have one."""
    if entry.duration is not None or isinstance(entry, (Follow, Scan)) or not duration:
        return entry
    return replace(entry, duration=duration)
