"""Search over the joints that reach the targets of free motions.

A target in task coordinates, or of the tip, leaves open which joints reach it: on which branch of
the inverse kinematics, and with which whole turns. The planner takes the nearest joints on the
present branch. This module also plans the alternatives whose lower bounds leave them a chance. It
treats one target after the other, and everything that follows a target is reached with the nearest
joints again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np

from ssm_planner.atomic import first_interruption
from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.pipeline.certified import Outcome
from ssm_planner.pipeline.thermal import RESERVE, quickly
from ssm_planner.planning.cache import cached
from ssm_planner.planning.feasibility import infeasible_place, with_boundary_rates
from ssm_planner.planning.ocp.refinement import EFFORT
from ssm_planner.planning.phase_task import PlannedPhase
from ssm_planner.planning.phases import Phase, other_ends, phases_from, start_configurations
from ssm_planner.planning.planner import estimated_duration
from ssm_planner.planning.prechecks import (
    bounded_duration,
    eye_forbids_target,
    feasible_phases,
    geometry_of,
    least_duration,
)
from ssm_planner.planning.tolerances import GAP, ROUNDING, SAME
from ssm_planner.problem.motion import Free, Joints, Motion
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.value import unchecked
from ssm_planner.typing import Array, record

StopAt = Literal["shortest", "nearest", "any"]
RESCUES = 3
"""Number of alternatives that are planned for a target if the planner's joints give no motion."""
SPINS = 181
"""Number of spins whose bounds are compared."""
SHARES, HALVINGS = 4, 2
"""Number of parts of a range of spins between which motions are planned, and halvings of the step
about the best spin.
"""
FLAT = 1e-3
"""Relative difference below which estimated durations count as independent of the spin."""
SEARCH = 2.5
"""Effort after which no faster motion is looked for, if there is a motion."""
MAX_TARGETS = 8
"""Largest number of targets with alternatives, since each changes the path of all that follows."""


def on_any_branch(
    problem: Problem,
    attempt: Callable[[Problem], Outcome],
    progress: Callable[[str], None] = lambda _: None,
    *,
    stoppable: bool = False,
    stop_at: StopAt = "shortest",
) -> tuple[Outcome, Problem, bool]:
    """Return the shortest certified motion over all joints that reach the targets.

    Alternatives are estimated first, and planned if the estimate promises a shorter motion.

    Parameters
    ----------
    problem : Problem
        The problem.
    attempt : callable
        Plans and checks a problem.
    progress : callable
        Called with a message for every alternative, which states the best duration so far.
    stoppable : bool
        With a certified motion at hand, the first Ctrl-C ends the search.
    stop_at : str
        "shortest" searches all alternatives. "nearest" ends with a motion of the planner's own
        joints, and "any" with the first motion.

    Returns
    -------
    outcome : Outcome
        The best motion.
    problem : Problem
        The problem with the joints of that motion as targets.
    stopped : bool
        True if Ctrl-C ended the search.
    """
    search = _Search(problem, attempt, progress, any_suffices=stop_at == "any")
    stopped = False
    if search.incumbent.passed and stop_at != "shortest":
        return search.incumbent, search.incumbent_problem, stopped
    if stoppable and search.incumbent.passed and targets(problem):
        search.hint = "; Ctrl-C takes it"
        with first_interruption() as came:
            try:
                search.run()
            except KeyboardInterrupt:
                if not came():
                    raise
            stopped = came()
            if stopped:
                progress("stopped: the best motion so far is taken")
    else:
        search.run()
    return search.incumbent, search.incumbent_problem, stopped


class _Search:
    """Search over alternatives, one target after the other."""

    def __init__(
        self,
        problem: Problem,
        attempt: Callable[[Problem], Outcome],
        progress: Callable[[str], None],
        *,
        any_suffices: bool,
    ) -> None:
        self.problem = problem
        self.attempt = attempt
        self.progress = progress
        self.any_does = any_suffices
        self._incumbent = attempt(problem), problem
        self.hint = ""

    @property
    def incumbent(self) -> Outcome:
        """Best motion so far."""
        return self._incumbent[0]

    @property
    def incumbent_problem(self) -> Problem:
        """The problem with the joints of the best motion as targets."""
        return self._incumbent[1]

    def run(self) -> None:
        """Search until no faster motion is expected, or until the effort is spent.

        Alternatives are planned without Ipopt's confirmation. Ipopt confirms the best of them at
        the end.
        """
        self._search()
        problem = self.problem
        if problem.planner == "optimal" and self.incumbent_problem is not problem:
            confirmed = self.attempt(self.incumbent_problem)
            if confirmed.duration < (1 + RESERVE) * self.incumbent.duration:
                self._incumbent = confirmed, self.incumbent_problem

    def _search(self) -> None:
        """Plan the alternatives of one target after the other."""
        problem = self.problem
        attempt = self.attempt
        effort_start = EFFORT.spent
        open_targets = [] if eye_forbids_target(problem) else targets(problem)
        phases = _phases(self.incumbent_problem) if open_targets else ()
        for entry, index in open_targets:
            count = 0
            for bound, alternative in _alternatives(
                self.incumbent_problem, phases, (entry, index), self.incumbent
            ):
                cutoff = self.incumbent.duration * (1 - GAP)
                exhausted = (
                    count >= RESCUES
                    if not self.incumbent.passed
                    else EFFORT.beyond(effort_start, SEARCH)
                )
                if bound >= cutoff or exhausted:
                    break
                count += 1
                suffix = (
                    f", {self.incumbent.duration:.4f} s so far{self.hint}"
                    if self.incumbent.passed
                    else ""
                )
                self.progress(
                    f"other joints for {problem.motion[entry].name}, attempt {count}{suffix}"
                )
                if _estimated_duration(alternative, cutoff) >= cutoff:
                    continue
                outcome = attempt(quickly(alternative))
                if outcome.passed and outcome.duration < cutoff:
                    self._incumbent = outcome, alternative
                    if self.any_does:
                        return
            if (
                self.incumbent.passed
                and _frees_spin(problem, entry, index)
                and not EFFORT.beyond(effort_start, SEARCH)
            ):
                self._incumbent = _with_best_spin(
                    self.incumbent_problem, entry, self.incumbent, attempt
                )
            if self.incumbent_problem.motion[entry] is not problem.motion[entry]:
                phases = _phases(self.incumbent_problem)


def targets(problem: Problem) -> list[tuple[int, int]]:
    """Return the targets with open joints, as index of the motion and index among its targets.

    The list is empty if there are more than MAX_TARGETS.
    """
    result = [
        (entry, index)
        for entry, motion in enumerate(problem.motion)
        if isinstance(motion, Free)
        for index, target in enumerate((*motion.through, motion.to))
        if not isinstance(target, Joints)
    ]
    return result if len(result) <= MAX_TARGETS else []


def _estimated_duration(problem: Problem, cutoff: float) -> float:
    """Estimate the duration of a motion, s, by the structured solver alone.

    The result is infinite if the motion would not be shorter than `cutoff`, or if none is found.
    """
    return estimated_duration(unchecked(problem, friction=None, payload=None), cutoff)


def _phases(problem: Problem) -> tuple[Phase, ...]:
    """Return the planned phases, or those of the first start configuration."""
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    phases, reason = feasible_phases(problem, mechanism)
    return (
        phases
        if reason is None
        else phases_from(problem, mechanism, start_configurations(problem, mechanism)[0])
    )


def _alternatives(
    problem: Problem, phases: tuple[Phase, ...], target: tuple[int, int], incumbent: Outcome
) -> list[tuple[float, Problem]]:
    """Return the problem with each alternative for a target, and a lower bound of its duration, s.

    The smallest bound comes first. Alternatives out of range, or without a chance to be shorter
    than the best motion, are omitted. `target` is index of the motion and index among its targets.
    """
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    entry, index = target
    motion = problem.motion[entry]
    phase = next(item for item in phases if item.motion is motion)
    stops = isinstance(motion, Free) and index == len(motion.through) and not phase.qd_end.any()
    alternatives = []
    ends = other_ends(problem, mechanism, phase, index)
    if _frees_spin(problem, entry, index):
        ends = [_least_spun(problem, mechanism, phase, q) for q in [phase.points[-1], *ends]]
        ends = [q for q in ends if not np.array_equal(q, phase.points[-1])]
    velocity = np.array([joint.velocity for joint in problem.robot.joints])
    key = entry, phases[0].q_start.tobytes(), *geometry_of(problem)
    for q in ends:
        if np.max(np.abs(q - phase.q_start) / velocity) >= incumbent.duration:
            continue
        direct = replace(phase, points=np.stack([phase.q_start, q]))
        if stops and least_duration(problem, mechanism, direct) >= incumbent.duration:
            continue
        candidate = cached(
            (index, q.tobytes(), *key),
            partial(_Candidate.build, problem, mechanism, phases[0].q_start, target=target, q=q),
        )
        bound = candidate.bound(incumbent.planned.phases)
        in_time = problem.duration is None or bound <= problem.duration * (1 + SAME)
        if in_time and bound < incumbent.duration:
            alternatives.append(
                (
                    max(bound, problem.duration or 0.0),
                    unchecked(problem, motion=candidate.motion),
                    q,
                )
            )
    alternatives.sort(key=lambda item: item[0])
    if incumbent.passed or _frees_spin(problem, entry, index):
        return [(bound, alternative) for bound, alternative, _ in alternatives]
    by_posture: dict[tuple[float, ...], tuple[float, Problem]] = {}
    for bound, alternative, q in alternatives:
        by_posture.setdefault(tuple(q[:2].round(6)), (bound, alternative))
    by_posture.pop(tuple(phase.points[-1, :2].round(6)), None)
    return list(by_posture.values())


def _frees_spin(problem: Problem, entry: int, index: int) -> bool:
    """Return True if a target is the end of a free motion with a free spin."""
    motion = problem.motion[entry]
    return isinstance(motion, Free) and motion.spin_free and index == len(motion.through)


def _spins(problem: Problem, mechanism: Mechanism, phase: Phase, q: Array) -> tuple[Array, Array]:
    """Return joints (n, 4) that differ from q (4,) by a free spin, and bounds (n,), s.

    The first three have joint 3 as in q, as at the start, and where it comes to a stop.
    """
    low, high = problem.robot.joints[2].position
    start, speed = phase.q_start[2], phase.qd_start[2]
    spin = task_from_joints(mechanism, q[None], near=phase.start)[0, 2]
    ends = problem.ranges.get("spin", (-np.inf, np.inf))
    if ends[1] - ends[0] < 2 * np.pi:
        low = max(low, q[2] + ends[0] - spin)
        high = min(high, q[2] + ends[1] - spin)
    stop = start + speed * abs(speed) / (2 * problem.robot.joints[2].acceleration)
    values = np.append(
        [q[2], start, stop], np.linspace(max(low, start - np.pi), min(high, start + np.pi), SPINS)
    )
    configurations = np.tile(q, (len(values), 1))
    configurations[:, 2] = np.clip(values, low, high)
    tasks = task_from_joints(mechanism, configurations, near=phase.start)
    bounds = [
        least_duration(
            problem,
            mechanism,
            replace(phase, points=np.vstack([phase.points[:-1], joints]), end=task),
        )
        for joints, task in zip(configurations, tasks, strict=True)
    ]
    return configurations, np.array(bounds)


def _least_spun(problem: Problem, mechanism: Mechanism, phase: Phase, q: Array) -> Array:
    """Return the joints (4,) with the spin nearest to q among those of the smallest bound."""
    configurations, bounds = _spins(problem, mechanism, phase, q)
    smallest = configurations[bounds <= bounds.min() * (1 + ROUNDING)]
    return np.asarray(smallest[np.argmin(np.abs(smallest[:, 2] - q[2]))])


def _with_best_spin(
    problem: Problem, entry: int, incumbent: Outcome, attempt: Callable[[Problem], Outcome]
) -> tuple[Outcome, Problem]:
    """Return the fastest motion over a free spin, and the problem with that spin.

    The spin is searched if bounds leave it a chance. Durations of the other joints depend on joint
    3 only through their load, so a coarse search suffices.
    """
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    phases, _ = feasible_phases(problem, mechanism)
    phase = next(item for item in phases if item.motion is problem.motion[entry])
    q, motion = phase.points[-1], phase.motion
    assert isinstance(motion, Free)
    durations = (
        item.duration
        for item in incumbent.planned.phases
        if np.array_equal(item.phase.points, phase.points)
    )
    duration = next(durations, np.inf)
    configurations, bounds = _spins(problem, mechanism, phase, q)
    if motion.duration is not None or not bounds.min() < duration * (1 - GAP):
        return incumbent, problem
    spins = configurations[bounds < duration * (1 - GAP), 2]
    incumbent_problem = problem
    centre = float(q[2])
    step = (spins.max() - spins.min()) / SHARES
    offsets = np.arange(1, SHARES) * step + spins.min() - centre
    effort_start = EFFORT.spent
    for _ in range(HALVINGS + 1):
        flat, previous = False, incumbent.duration
        for value in centre + offsets:
            if not spins.min() <= value <= spins.max() or EFFORT.beyond(effort_start, SEARCH):
                continue
            alternative = _with_target(
                problem, entry, len(motion.through), np.array([q[0], q[1], value, q[3]])
            )
            cutoff = incumbent.duration * (1 - GAP)
            expected = _estimated_duration(alternative, (1 + FLAT) * cutoff)
            flat |= abs(expected - previous) < FLAT * previous
            if expected >= cutoff:
                continue
            outcome = attempt(quickly(alternative))
            if outcome.passed and outcome.duration < cutoff:
                incumbent = outcome
                incumbent_problem = alternative
                centre = float(value)
        # The duration does not depend on the spin, so other limits bind.
        if flat and incumbent.duration == previous:
            break
        step /= 2
        offsets = np.array([-step, step])
    return incumbent, incumbent_problem


@record
class _Candidate:
    """A motion list with other joints at one target, and its phases.

    Empty phases mean that it is infeasible.
    """

    motion: tuple[Motion, ...]
    phases: tuple[Phase, ...] = ()
    bounds: tuple[float, ...] = ()
    """Lower bounds of the phases, s. Infinite above the requested duration."""

    @classmethod
    def build(
        cls,
        problem: Problem,
        mechanism: Mechanism,
        start: Array,
        *,
        target: tuple[int, int],
        q: Array,
    ) -> _Candidate:
        """Build the candidate that begins at joints `start` (4,) and has q (4,) as a target."""
        alternative = _with_target(problem, *target, q)
        try:
            phases = phases_from(alternative, mechanism, start)
            if infeasible_place(problem, mechanism, phases) is not None:
                return cls(alternative.motion)
            phases, reason = with_boundary_rates(alternative, mechanism, phases)
        except ProblemError:  # A straight motion after the target has no line from there.
            return cls(alternative.motion)
        if reason is not None:
            return cls(alternative.motion)
        return cls(
            alternative.motion,
            phases,
            tuple(bounded_duration(problem, mechanism, phase) for phase in phases),
        )

    def bound(self, planned_phases: tuple[PlannedPhase, ...]) -> float:
        """Return a lower bound of the duration, s.

        Phases that are already planned count with their duration.

        The result is infinite if the candidate is infeasible.
        """
        if not self.phases:
            return np.inf
        return sum(
            _known_duration(phase, planned_phases, bound)
            for phase, bound in zip(self.phases, self.bounds, strict=True)
        )


def _known_duration(
    phase: Phase, planned_phases: tuple[PlannedPhase, ...], default: float
) -> float:
    """Return the duration of a phase if it has been planned, else `default`, s."""
    if phase.motion.duration is not None or phase.stands:
        return default
    same = (
        item.duration
        for item in planned_phases
        if item.phase.motion is phase.motion and np.array_equal(item.phase.points, phase.points)
    )
    return next(same, default)


def _with_target(problem: Problem, entry: int, index: int, q: Array) -> Problem:
    """Return the problem whose free motion `entry` has joints q (4,) as its target `index`."""
    motion = problem.motion[entry]
    assert isinstance(motion, Free)
    a, b, c, d = q.tolist()
    targets = [*motion.through, motion.to]
    targets[index] = Joints((a, b, c, d), targets[index].line)
    spin_free = motion.spin_free and index < len(motion.through)
    changed: Motion = unchecked(
        motion, through=tuple(targets[:-1]), to=targets[-1], spin_free=spin_free
    )
    return unchecked(
        problem, motion=(*problem.motion[:entry], changed, *problem.motion[entry + 1 :])
    )
