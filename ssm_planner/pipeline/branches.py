"""Other joints that reach the targets of free motions, planned where they may be faster: the other branch, whole turns.

A target in task coordinates, or of the tip, leaves open with which joints it is reached. The planner takes the nearest ones
on the branch where the motion is. Here the others are planned too, as far as their lower bounds leave them a chance, one
target after the other: what comes after it is reached with the nearest joints again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from ssm_planner.atomic import first_interruption
from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.planning.feasibility import infeasible_place, with_boundary_rates
from ssm_planner.planning.kept import kept
from ssm_planner.planning.ocp.refinement import EFFORT
from ssm_planner.planning.outlook import (
    LONGER,
    bounded_duration,
    feasible_phases,
    geometry_of,
    least_duration,
)
from ssm_planner.planning.phases import Phase, other_ends, phases_from, start_configurations
from ssm_planner.planning.planner import PlannedPhase, PlannerResult, sketched_duration
from ssm_planner.planning.reason import Reason
from ssm_planner.problem.motion import Free, Joints, Motion
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.value import unchecked
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import Certificate

Enough = Literal["shortest", "nearest", "any"]
Outcome = tuple[PlannerResult, Certificate | None, Reason | None]
"""What was planned, its certificate, and the reason where it is none that passed."""
SHORTER = 1e-5
"""Share by which a motion with other joints has to be shorter to be taken."""
RESCUES = 3
"""Other joints that are planned for a target where those of the planner give no motion."""
SPINS, ROUNDING = 181, 1e-9
"""Spins that are compared by their bounds, and share by which bounds that are the same may differ."""
LEAST_GAIN = 1e-4
"""Share by which a bound has to be shorter for a free spin to be searched."""
SHARES, HALVINGS = 4, 2
"""Parts of the room of a free spin between which motions are planned, and how often the step is halved about the best."""
FLAT = 1e-3
"""Share by which durations that do not depend on the spin may differ, on the meshes of sketches."""
SEARCH = 2.5
"""Effort beyond which nothing faster is looked for where there is a motion."""
MOST = 8
"""Targets of a problem up to which other joints are tried: every change of one is another way of all that follows."""


def on_any_branch(
    problem: Problem,
    attempt: Callable[[Problem], Outcome],
    progress: Callable[[str], None] = lambda _: None,
    *,
    stoppable: bool = False,
    enough: Enough = "shortest",
) -> tuple[Outcome, Problem, bool]:
    """The shortest certified motion over the joints that reach the free targets of a problem, and the problem with these.

    attempt: plans and checks one. Others are sketched first, and planned where that promises a shorter motion. progress: told
    which is tried, and how long the best so far takes. stoppable: with a certified motion at hand the first Ctrl-C ends the
    search, and the last value is True. enough: whether one with the nearest joints, or with any, is taken where there is one.
    """
    search, stopped = _Search(problem, attempt, progress, any_does=enough == "any"), False
    if search.best[2] is None and enough != "shortest":
        return search.best, search.settled, stopped
    if stoppable and search.best[2] is None and targets(problem):
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
    return search.best, search.settled, stopped


class _Search:
    """Over other joints, one target after the other; best and settled: the best so far, and the problem with its joints."""

    def __init__(
        self,
        problem: Problem,
        attempt: Callable[[Problem], Outcome],
        progress: Callable[[str], None],
        *,
        any_does: bool,
    ) -> None:
        self.problem, self.attempt, self.progress, self.any_does = (
            problem,
            attempt,
            progress,
            any_does,
        )
        self.found = attempt(problem), problem
        self.hint = ""

    @property
    def best(self) -> Outcome:
        return self.found[0]

    @property
    def settled(self) -> Problem:
        return self.found[1]

    def run(self) -> None:
        """Until nothing faster is to be expected, or enough has been tried."""
        problem, attempt, begin = self.problem, self.attempt, EFFORT.spent
        open_targets = targets(problem)
        phases = _phases(self.settled) if open_targets else ()
        for entry, place in open_targets:
            tried = 0
            for bound, other in _others(self.settled, phases, (entry, place), self.best):
                longest = _duration(self.best) * (1 - SHORTER)
                enough = (
                    tried >= RESCUES if self.best[2] is not None else EFFORT.beyond(begin, SEARCH)
                )
                if bound >= longest or enough:
                    break
                tried += 1
                known = (
                    f", {_duration(self.best):.4f} s so far{self.hint}"
                    if self.best[2] is None
                    else ""
                )
                self.progress(
                    f"other joints for {problem.motion[entry].name}, attempt {tried}{known}"
                )
                if _sketched(other, longest) >= longest:
                    continue
                found = attempt(other)
                if found[2] is None and _duration(found) < longest:
                    self.found = found, other
                    if self.any_does:
                        return
            if (
                self.best[2] is None
                and _frees_spin(problem, entry, place)
                and not EFFORT.beyond(begin, SEARCH)
            ):
                self.found = _with_best_spin(self.settled, entry, self.best, attempt)
            if self.settled.motion[entry] is not problem.motion[entry]:
                phases = _phases(self.settled)


def targets(problem: Problem) -> list[tuple[int, int]]:
    """Targets that leave their joints open, as entry of the motion list and place among its targets; none of very many."""
    found = [
        (entry, place)
        for entry, motion in enumerate(problem.motion)
        if isinstance(motion, Free)
        for place, target in enumerate((*motion.through, motion.to))
        if not isinstance(target, Joints)
    ]
    return found if len(found) <= MOST else []


def _duration(outcome: Outcome) -> float:
    """Of a certified motion, s; infinite where there is none."""
    trajectory = outcome[0].trajectory
    return np.inf if outcome[2] is not None or trajectory is None else trajectory.duration


def _sketched(problem: Problem, longest: float) -> float:
    """About the duration of a motion, s, by the structured solver alone; infinite where that finds none that is shorter."""
    return sketched_duration(unchecked(problem, friction=None, payload=None), longest)


def _phases(problem: Problem) -> tuple[Phase, ...]:
    """As they are planned, or from the first start configuration where nothing can be planned."""
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    phases, reason = feasible_phases(problem, mechanism)
    return (
        phases
        if reason is None
        else phases_from(problem, mechanism, start_configurations(problem, mechanism)[0])
    )


def _others(
    problem: Problem, phases: tuple[Phase, ...], at: tuple[int, int], best: Outcome
) -> list[tuple[float, Problem]]:
    """The problem with each of the other joints that reach a target of its free motion, and a bound of its duration, s.

    The least bound first; those that keep no range, or cannot be shorter than the best, are left out.
    """
    mechanism, (entry, place) = Mechanism.from_geometry(problem.robot.geometry), at
    motion = problem.motion[entry]
    phase = next(each for each in phases if each.motion is motion)
    stops = isinstance(motion, Free) and place == len(motion.through) and not phase.qd_end.any()
    found = []
    ends = other_ends(problem, mechanism, phase, place)
    if _frees_spin(problem, entry, place):
        ends = [_least_spun(problem, mechanism, phase, q) for q in [phase.points[-1], *ends]]
        ends = [q for q in ends if not np.array_equal(q, phase.points[-1])]
    velocity = np.array([joint.velocity for joint in problem.robot.joints])
    known = entry, phases[0].q_start.tobytes(), *geometry_of(problem)
    for q in ends:
        if np.max(np.abs(q - phase.q_start) / velocity) >= _duration(best):
            continue
        own = replace(phase, points=np.stack([phase.q_start, q]))
        if stops and least_duration(problem, mechanism, own) >= _duration(best):
            continue
        way = kept(
            (place, q.tobytes(), *known),
            partial(_Way.to, problem, mechanism, phases[0].q_start, at=at, q=q),
        )
        bound = way.bound(best[0].phases)
        in_time = problem.duration is None or bound <= problem.duration * (1 + LONGER)
        if in_time and bound < _duration(best):
            found.append(
                (max(bound, problem.duration or 0.0), unchecked(problem, motion=way.motion), q)
            )
    found.sort(key=lambda each: each[0])
    if best[2] is None or _frees_spin(problem, entry, place):
        return [(bound, other) for bound, other, _ in found]
    nearest: dict[tuple[float, ...], tuple[float, Problem]] = {}
    for bound, other, q in found:
        nearest.setdefault(tuple(q[:2].round(6)), (bound, other))
    nearest.pop(tuple(phase.points[-1, :2].round(6)), None)
    return list(nearest.values())


def _frees_spin(problem: Problem, entry: int, place: int) -> bool:
    motion = problem.motion[entry]
    return isinstance(motion, Free) and motion.spin_free and place == len(motion.through)


def _spins(problem: Problem, mechanism: Mechanism, phase: Phase, q: Array) -> tuple[Array, Array]:
    """Joints (n, 4) that are q (4,) but for a free spin, and bounds (n,) of the duration of a phase that ends with them, s.

    The first are with joint 3 as it is in q, as it is at the start, and where it comes to stand.
    """
    low, high = problem.robot.joints[2].position
    first, speed = phase.q_start[2], phase.qd_start[2]
    spin = task_from_joints(mechanism, q[None], near=phase.start)[0, 2]
    ends = problem.ranges.get("spin", (-np.inf, np.inf))
    if ends[1] - ends[0] < 2 * np.pi:
        low, high = max(low, q[2] + ends[0] - spin), min(high, q[2] + ends[1] - spin)
    stop = first + speed * abs(speed) / (2 * problem.robot.joints[2].acceleration)
    values = np.append(
        [q[2], first, stop], np.linspace(max(low, first - np.pi), min(high, first + np.pi), SPINS)
    )
    turned = np.tile(q, (len(values), 1))
    turned[:, 2] = np.clip(values, low, high)
    tasks = task_from_joints(mechanism, turned, near=phase.start)
    bounds = [
        least_duration(
            problem,
            mechanism,
            replace(phase, points=np.vstack([phase.points[:-1], joints]), end=task),
        )
        for joints, task in zip(turned, tasks, strict=True)
    ]
    return turned, np.array(bounds)


def _least_spun(problem: Problem, mechanism: Mechanism, phase: Phase, q: Array) -> Array:
    """Of the joints that differ by a free spin, (4,), those nearest to q among those of the least bound."""
    turned, bounds = _spins(problem, mechanism, phase, q)
    least = turned[bounds <= bounds.min() * (1 + ROUNDING)]
    return np.asarray(least[np.argmin(np.abs(least[:, 2] - q[2]))])


def _with_best_spin(
    problem: Problem, entry: int, best: Outcome, attempt: Callable[[Problem], Outcome]
) -> tuple[Outcome, Problem]:
    """The fastest motion over a free spin, searched where bounds leave it a chance, and the problem with it.

    How long the other joints take depends on joint 3 through their load alone, so a coarse search does.
    """
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    phases, _ = feasible_phases(problem, mechanism)
    phase = next(each for each in phases if each.motion is problem.motion[entry])
    q, motion = phase.points[-1], phase.motion
    assert isinstance(motion, Free)
    planned = (
        each.duration for each in best[0].phases if np.array_equal(each.phase.points, phase.points)
    )
    longest = next(planned, np.inf)
    turned, bounds = _spins(problem, mechanism, phase, q)
    if motion.duration is not None or not bounds.min() < longest * (1 - LEAST_GAIN):
        return best, problem
    room = turned[bounds < longest * (1 - LEAST_GAIN), 2]
    settled, centre, step = problem, float(q[2]), (room.max() - room.min()) / SHARES
    offsets = np.arange(1, SHARES) * step + room.min() - centre
    begin = EFFORT.spent
    for _ in range(HALVINGS + 1):
        flat, before = False, _duration(best)
        for value in centre + offsets:
            if not room.min() <= value <= room.max() or EFFORT.beyond(begin, SEARCH):
                continue
            other = _with_target(
                problem, entry, len(motion.through), np.array([q[0], q[1], value, q[3]])
            )
            longest = _duration(best) * (1 - SHORTER)
            expected = _sketched(other, (1 + FLAT) * longest)
            flat |= abs(expected - before) < FLAT * before
            if expected >= longest:
                continue
            found = attempt(other)
            if found[2] is None and _duration(found) < longest:
                best, settled, centre = found, other, float(value)
        if flat and _duration(best) == before:  # as long with another spin: others bind
            break
        step /= 2
        offsets = np.array([-step, step])
    return best, settled


@dataclass(frozen=True, eq=False)
class _Way:
    """A motion with other joints at one target, and its phases; none where it cannot be."""

    motion: tuple[Motion, ...]
    phases: tuple[Phase, ...] = ()
    least: tuple[float, ...] = ()
    """What they take at least, s, infinite where that is more than was asked for."""

    @classmethod
    def to(
        cls, problem: Problem, mechanism: Mechanism, start: Array, *, at: tuple[int, int], q: Array
    ) -> _Way:
        """From joints `start` (4,) on, with q (4,) as a target; at: of which entry, and which of its targets."""
        other = _with_target(problem, *at, q)
        try:
            phases = phases_from(other, mechanism, start)
            if infeasible_place(problem, mechanism, phases) is not None:
                return cls(other.motion)
            phases, reason = with_boundary_rates(other, mechanism, phases)
        except ProblemError:  # a straight motion after it has no line there
            return cls(other.motion)
        if reason is not None:
            return cls(other.motion)
        return cls(
            other.motion,
            phases,
            tuple(bounded_duration(problem, mechanism, each) for each in phases),
        )

    def bound(self, planned: tuple[PlannedPhase, ...]) -> float:
        """Of the duration, s: where a phase has been planned already, what it takes; infinite where there is no motion."""
        if not self.phases:
            return np.inf
        return sum(
            _planned(each, planned, least)
            for each, least in zip(self.phases, self.least, strict=True)
        )


def _planned(phase: Phase, planned: tuple[PlannedPhase, ...], otherwise: float) -> float:
    """How long a phase takes that has been planned, s."""
    if phase.motion.duration is not None or phase.stands:
        return otherwise
    same = (
        each.duration
        for each in planned
        if each.phase.motion is phase.motion and np.array_equal(each.phase.points, phase.points)
    )
    return next(same, otherwise)


def _with_target(problem: Problem, entry: int, place: int, q: Array) -> Problem:
    """The problem whose free motion has joints (4,) as a target; place: of which of its targets."""
    motion = problem.motion[entry]
    assert isinstance(motion, Free)
    a, b, c, d = q.tolist()
    targets = [*motion.through, motion.to]
    targets[place] = Joints((a, b, c, d), targets[place].line)
    spin_free = motion.spin_free and place < len(motion.through)
    changed: Motion = unchecked(
        motion, through=tuple(targets[:-1]), to=targets[-1], spin_free=spin_free
    )
    return unchecked(
        problem, motion=(*problem.motion[:entry], changed, *problem.motion[entry + 1 :])
    )
