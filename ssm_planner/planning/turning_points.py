"""Turning points on free motions: joints that turn back because the motion is faster for it.

Between two borders of a free motion every joint moves one way. A joint that goes out and comes back, or goes beyond an end,
may loosen a limit that binds: drawn back, the tool swings faster under a limit of the tip's speed. Such a motion has one
border more, whose positions are unknowns (`ocp/free`, `loose`).

Which joint turns, and to which side, is seen without a solver. T(q) is TOPP-RA's time along a path q(s). Among motions with
their directions an optimal one gains nothing, to first order, from a displacement that keeps these directions. So where
T(q + A b e_j) < T(q) for a small A and a smooth b(s) that is 0 at the points, it is a displacement that turns joint j back.
The reverse does not hold: where several limits bind at once, T falls only where the displacement loosens all of them.

Through points joints turn back for each other: one that has time to spare before a point goes beyond it, or takes a run-up,
and passes it at speed in the direction of its way from there (`passing_turns`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.planning.feasibility import infeasible_place
from ssm_planner.planning.lower_bound import fastest_times
from ssm_planner.planning.ocp.nlp import PhaseSolution
from ssm_planner.planning.ocp.reversals import reversals, sketched
from ssm_planner.planning.phases import Phase, joint_room
from ssm_planner.planning.retiming.paths import MotionPath, PathSamples
from ssm_planner.planning.retiming.retime import durations
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array

SAMPLES, GRID = 101, 200
"""Of a path, and about the grid intervals of TOPP-RA."""
STEP, DOUBLED = 0.05, 4
"""The first displacement, as the time (s) that a joint takes for it at its largest velocity, and how often it is doubled."""
GAIN = 5e-5
"""Share of TOPP-RA's time by which the first displacement has to shorten it: it says more of the sign than of the size."""
PART = 0.75
"""Share of the way between two points, from its start or to its end, on which a joint that moves is displaced."""
THIRD = float(np.arctan(2**0.5) / np.pi)
"""Share of a displacement to both sides where it is largest."""
BESIDE = 0.01
"""Share of the way between two points that displacements leave out at either end, where the pace is given."""
EDGE = 1e-9
"""By how much samples may be outside the room of joints, rad or m."""
PACE = 0.999
"""Of both ends in that of the motion, which may be at its limits there."""
TURNS, TRIED, COMPARABLE = 3, 2, 0.5
"""Most turning points of a motion, how many of the promising ones are worked out for each, and what these promise at least,
as a share of the best."""
PAYS, SKETCHED, PAYS_IPOPT = 2e-3, 5e-4, 1e-2
"""Share of the duration that a turning point has to save; that those of a sketch have to, which cost less to look for; and
that a sketch has to promise where Ipopt alone would solve it."""
LEAST, SPARE = (2e-4, 1e-2), 0.3
"""Shares of what a joint moves at its largest velocity by which those of a sketch turn back at least; share of what that
saves beyond which the second is tried too."""
SOLVES, ENOUGH, DIFFERENCE, IDLE = 60, 1e-6, 1e-6, 5e-4
"""Of the speeds at points: iterations, precision, difference for slopes, and the share of the time that those left out
save."""


@dataclass(frozen=True, eq=False)
class Turns:
    """A free motion that may have turning points."""

    points: Array
    """Its borders in joints, (k + 1, 4): points, and places where joints turn back."""
    loose: tuple[int, ...] = ()
    """Which of these are the latter."""
    gain: float = 0.0
    """Share of the time that this one is expected to save."""
    passing: Array | None = None
    """q̇ at the points within, (k − 1, 4), where these tell between which of them joints turn back."""
    sketch: tuple[Trajectory, Array] | None = None
    """A motion that passes the borders, and when, (k + 1,), s."""


def best_turns(
    problem: Problem,
    mechanism: Mechanism,
    phase: Phase,
    first: PhaseSolution,
    solve: Callable[[Turns, float], PhaseSolution | None],
    *,
    strict: Robot,
) -> Turns | None:
    """The turning points with which a free phase is fastest; None where none pays.

    first: the motion without. solve: the fastest motion with turning points, None without one; beyond a duration, s, it is of
    no use. strict: the robot with the limits to keep. A sketch tells which they are; without one they are found one after the
    other.
    """
    sketch = sketched(problem, mechanism, phase.points, first, strict)
    if sketch is not None:
        return _sketched_turns(problem, phase, sketch, first.duration, solve)
    motion, turns = first, None
    for _ in range(TURNS):
        enough = (1 - PAYS) * motion.duration
        tried = []
        for each in _promising(
            problem, mechanism, phase, motion, () if turns is None else turns.loose
        ):
            found = solve(each, enough)
            if found is not None and found.duration < enough:
                tried.append((found, each))
        if not tried:
            break
        motion, turns = min(tried, key=lambda pair: pair[0].duration)
    return turns


def _sketched_turns(
    problem: Problem,
    phase: Phase,
    sketch: Trajectory,
    longest: float,
    solve: Callable[[Turns, float], PhaseSolution | None],
) -> Turns | None:
    """The turning points of a sketch, with those that are small or without, where they pay; longest: without any, s."""
    enough = (1 - SKETCHED) * longest
    if sketch.duration >= enough:
        return None
    velocity = np.array([joint.velocity for joint in problem.robot.joints])
    found: list[tuple[float, Turns]] = []
    known: list[int] = []
    for least in LEAST:
        within = reversals(sketch, least * sketch.duration * velocity)
        if not len(within) or len(within) in known:
            continue
        known.append(len(within))
        instants = np.concatenate([[0.0], within, [sketch.duration]])
        points = sketch.sample(instants).q
        points[[0, -1]] = phase.points
        gain = 1 - sketch.duration / longest
        turns = Turns(points, tuple(range(1, len(within) + 1)), gain, None, (sketch, instants))
        motion = solve(turns, enough)
        if motion is not None and motion.duration < enough:
            found.append((motion.duration, turns))
            if motion.duration < sketch.duration + SPARE * (longest - sketch.duration):
                break
    return min(found, key=lambda pair: pair[0])[1] if found else None


def _promising(
    problem: Problem,
    mechanism: Mechanism,
    phase: Phase,
    motion: PhaseSolution,
    loose: tuple[int, ...],
) -> list[Turns]:
    """Motions with one turning point more than this one of the phase, which has some already; the best expected first."""
    screen = _Screen.of(problem, mechanism, phase, motion)
    path, found = screen.path, []
    ways = pairwise([k for k in range(len(path.knots)) if k not in loose])
    small = [
        (way, each) for way in ways for each in screen.displacements(*way) if screen.has_room(each)
    ]
    own, *times = screen.times([path, *(each for _, each in small)])
    for ((first, last), displaced), time in zip(small, times, strict=True):
        chosen, gain = screen.farthest(displaced, 1 - time / own, own)
        if not gain:
            continue
        at, moved = path.knots, list(loose)
        for place, peak in enumerate(chosen.peaks):
            k = int(np.clip(np.searchsorted(at, peak), first + 1, last + place))
            at, moved = np.insert(at, k, peak), [*(i + (i >= k) for i in moved), k]
        points = chosen.sample(at).q
        points[[i for i in range(len(at)) if i not in moved]] = phase.points
        found.append(Turns(points, tuple(sorted(moved)), gain))
    found.sort(key=lambda each: -each.gain)
    return [each for each in found[:TRIED] if each.gain > COMPARABLE * found[0].gain]


def passing_turns(problem: Problem, phase: Phase) -> Turns | None:
    """Turning points of a free phase with points on its way, of joints that pass beyond one or take a run-up to the next.

    The joints alone, with their speeds q̇_j(k) at the points unknown, give the durations of the ways: the least Σ_k max_j of
    the closed forms, once with the directions of the ways kept and once without. None where that saves too little.
    """
    velocity, acceleration = np.array(
        [(joint.velocity, joint.acceleration) for joint in problem.robot.joints]
    ).T
    velocity[3] = min(velocity[3], problem.rates.get("depth", np.inf))
    way = np.diff(phase.points, axis=0)
    alone = _Passing(way, (phase.qd_start, phase.qd_end), velocity, acceleration)
    kept = alone.fastest(np.zeros((len(way) - 1, 4)), turning=False)
    free = alone.fastest(kept, turning=True)
    least = alone.duration(kept)
    if alone.duration(free) > (1 - PAYS) * least:
        return None
    return Turns(
        phase.points, gain=1 - alone.duration(free) / least, passing=alone.without_idle(free)
    )


@dataclass(frozen=True, eq=False)
class _Passing:
    """Joints that pass points, each as if it were alone, at the same instants."""

    way: Array
    """From point to point, (n, 4)."""
    ends: tuple[Array, Array]
    """q̇ at both ends, (4,)."""
    velocity: Array
    acceleration: Array
    """Limits, (4,)."""

    def times(self, speeds: Array) -> Array:
        """Of every joint over every way, (n, 4), with q̇ (n − 1, 4) at the points within."""
        whole = np.vstack([self.ends[0], speeds, self.ends[1]])
        return fastest_times(self.way, self.velocity, self.acceleration, (whole[:-1], whole[1:]))

    def duration(self, speeds: Array) -> float:
        """Of all, s."""
        return float(self.times(speeds).max(axis=1).sum())

    def fastest(self, speeds: Array, *, turning: bool) -> Array:
        """q̇ with which all takes least, from others on; not turning: joints that do not go on in their direction rest."""
        from scipy.optimize import fmin_slsqp

        n, most = len(self.way), np.broadcast_to(self.velocity, speeds.shape)
        signs = np.sign(self.way)
        low, high = (
            np.where(
                turning | (np.minimum(side * signs[:-1], side * signs[1:]) > 0), side * most, 0.0
            )
            for side in (-1, 1)
        )
        unit = self.duration(speeds)

        def total(x: Array) -> float:
            return float(x[:n].sum())

        def total_slope(x: Array) -> Array:
            return np.append(np.ones(n), np.zeros(len(x) - n))

        def spare(x: Array) -> Array:
            return np.asarray(x[:n, None] - self.times(x[n:].reshape(-1, 4) * most) / unit).ravel()

        def spare_slope(x: Array) -> Array:
            return self._slopes(x[n:].reshape(-1, 4), unit)

        found = fmin_slsqp(
            total,
            np.concatenate([self.times(speeds).max(axis=1) / unit, (speeds / most).ravel()]),
            fprime=total_slope,
            bounds=[
                *[(0.0, np.inf)] * n,
                *zip((low / most).ravel(), (high / most).ravel(), strict=True),
            ],
            f_ieqcons=spare,
            fprime_ieqcons=spare_slope,
            iter=SOLVES,
            acc=ENOUGH,
            iprint=0,
        )
        reached = np.clip(found[n:].reshape(-1, 4) * most, low, high)
        return reached if self.duration(reached) < self.duration(speeds) else speeds

    def _slopes(self, shares: Array, unit: float) -> Array:
        """Of T_k − t_jk, in units of time, by T and by the speeds as shares of the largest, (4 n, n + 4 (n − 1))."""
        n, here = len(self.way), self.times(shares * self.velocity)
        slopes = np.zeros((n, 4, n + shares.size))
        slopes[np.arange(n), :, np.arange(n)] = 1.0
        for first in (0, 1):  # a speed bears on the ways before and after it alone
            moved = shares.copy()
            moved[first::2] += DIFFERENCE
            change = (here - self.times(moved * self.velocity)) / (DIFFERENCE * unit)
            for k in range(first, n - 1, 2):
                for j in range(4):
                    slopes[[k, k + 1], j, n + 4 * k + j] = change[[k, k + 1], j]
        return slopes.reshape(4 * n, -1)

    def without_idle(self, speeds: Array) -> Array:
        """Without those that hardly save time, the smallest first: joints turn back for them."""
        kept = speeds.copy()
        longest = (1 + IDLE) * self.duration(speeds)
        order = np.argsort(np.abs(speeds / self.velocity), axis=None)
        for k, j in zip(*np.unravel_index(order, speeds.shape), strict=True):
            less = kept.copy()
            less[k, j] = 0.0
            if self.duration(less) <= longest:
                kept = less
        return kept


@dataclass(frozen=True, eq=False)
class _Displaced(MotionPath):
    """The path of a motion with A b(s) added to one joint.

    With θ from 0 to π over an interval of s, b is sin² θ, or, to one side and the other, 3 √3/2 sin² θ cos θ.
    """

    joint: int = 0
    far: float = 0.0
    """A, rad or m."""
    interval: tuple[float, float] = (0.0, 1.0)
    both: bool = False
    """To one side, then to the other."""

    @property
    def peaks(self) -> tuple[float, ...]:
        """s where b is 1 or −1."""
        start, end = self.interval
        return tuple(
            start + share * (end - start) for share in ((THIRD, 1 - THIRD) if self.both else (0.5,))
        )

    def sample(self, s: Array) -> PathSamples:
        found, (start, end) = super().sample(s), self.interval
        rate = np.pi / (end - start)
        angle = rate * (np.clip(s, start, end) - start)
        sine, cosine = np.sin(angle), np.cos(angle)
        inside = (s > start) & (s < end)
        if self.both:
            far = 3**1.5 / 2 * self.far
            wave = (
                sine**2 * cosine,
                (3 * cosine**2 - 1) * sine,
                (9 * cosine**3 - 7 * cosine) * inside,
            )
        else:
            far, wave = self.far, (sine**2, 2 * sine * cosine, 2 * (cosine**2 - sine**2) * inside)
        for order, (values, part) in enumerate(
            zip((found.q, found.dq, found.ddq), wave, strict=True)
        ):
            values[:, self.joint] += far * rate**order * part
        return found

    @cached_property
    def directions(self) -> tuple[Array, Array]:
        grid = np.linspace(0.0, 1.0, GRID + 1)
        slope = self.sample((grid[1:] + grid[:-1]) / 2).dq[:, self.joint]
        turns = grid[1:-1][np.sign(slope[1:]) != np.sign(slope[:-1])]
        knots = np.union1d(self.knots, turns)
        return knots, np.sign(self.sample((knots[1:] + knots[:-1]) / 2).dq)


@dataclass(frozen=True, eq=False)
class _Screen:
    """Looks for displacements of the path of a motion that shorten it."""

    problem: Problem
    phase: Phase
    path: MotionPath
    room: Array
    """Of the joints, (2, 4)."""

    @classmethod
    def of(
        cls, problem: Problem, mechanism: Mechanism, phase: Phase, motion: PhaseSolution
    ) -> _Screen:
        trajectory = Trajectory(motion.breaks, motion.coefficients, ())
        path = MotionPath(
            mechanism, trajectory, motion.borders / trajectory.duration, motion.directions
        )
        return cls(problem, phase, path, joint_room(problem, mechanism, phase.points))

    def displacements(self, first: int, last: int) -> Iterator[_Displaced]:
        """Small ones between two borders that turn a joint back that does not turn back yet; one that stands, twice too."""
        path, (start, end) = self.path, self.path.knots[[first, last]].tolist()
        beside = BESIDE * (end - start)
        start, end = start + beside, end - beside
        part = PART * (end - start)
        for joint, limits in enumerate(self.problem.robot.joints):
            signs = set(np.sign(path.signs[first:last, joint]).tolist()) - {0.0}
            for side in (-1, 1) if len(signs) < 2 else ():
                interval = (
                    (start, end)
                    if not signs
                    else (end - part, end)
                    if side in signs
                    else (start, start + part)
                )
                far = side * STEP * limits.velocity
                for both in (False, True) if not signs else (False,):
                    moved = {"joint": joint, "far": far, "interval": interval, "both": both}
                    yield _Displaced(
                        path.mechanism, path.trajectory, path.knots, path.signs, **moved
                    )  # type: ignore[arg-type]

    def has_room(self, displaced: _Displaced) -> bool:
        """Whether the joints stay in their room."""
        q = displaced.sample(np.linspace(0.0, 1.0, SAMPLES)).q
        return bool(((q >= self.room[0] - EDGE) & (q <= self.room[1] + EDGE)).all())

    def is_allowed(self, displaced: _Displaced) -> bool:
        """Whether no limit forbids a place on the path."""
        way = replace(self.phase, points=displaced.sample(np.linspace(0.0, 1.0, SAMPLES)).q)
        return infeasible_place(self.problem, self.path.mechanism, (way,)) is None

    def farthest(self, displaced: _Displaced, gain: float, own: float) -> tuple[_Displaced, float]:
        """A displacement doubled as long as that shortens the motion more, and the share of its own time that it saves.

        gain: the share that the first one saves.
        """
        chosen, most, further = displaced, 0.0, displaced
        for _ in range(DOUBLED + 1):
            if gain <= max(most, GAIN) or not self.is_allowed(further):
                break
            chosen, most = further, gain
            further = replace(further, far=2 * further.far)
            if not self.has_room(further):
                break
            gain = 1 - self.times([further])[0] / own
        return chosen, most

    def times(self, paths: Sequence[MotionPath]) -> list[float]:
        """TOPP-RA's along paths that differ by displacements, s; infinite where it finds no motion."""
        return durations(paths, self.problem.robot, self.problem.task_limits, GRID, PACE)
