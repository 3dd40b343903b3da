"""Meshes and guesses: where the elements of a motion end, and the motion that the optimisation begins from.

A straight phase begins from TOPP-RA's motion along its path; its elements end where that switches from one binding limit to
the next, or where jerk is limited, where that of a first solution jumps (`Mesh`). A free phase begins from a motion in closed
form that keeps velocity, acceleration and jerk limits and rests at every point (`closed_form_guess`), or where that is far
from keeping the other limits, from TOPP-RA's (`retimed_guess`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.polynomial.chebyshev import chebder, chebval, chebvander

from ssm_planner.planning.lower_bound import rest_to_rest
from ssm_planner.planning.ocp.nlp import cubics
from ssm_planner.planning.retiming.paths import PolylinePath
from ssm_planner.planning.retiming.retime import Retiming, retime
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Cubic, Trajectory
from ssm_planner.typing import Array, Indices

SHORTEST_ARC = 0.01
"""Arcs shorter than this share of the duration join their neighbour..."""
UP_TO_SPEED = 0.5
"""... but for those at either end on which ṡ gets to this share of its largest: slow motions spend little time on them."""
FEWEST = 5
"""Elements of the shortest arc."""
SAMPLES = 33
"""At which the density of elements is evaluated in an arc."""
DEGREE = 6
"""Of the fits of s̈ within an arc."""
EDGE = 0.02
"""Share of an arc at either end that its fit leaves out: there the guess is between two arcs."""
EVEN = 1.5
"""Share of the mean density that every place gets."""
JUMP, LEAST_JUMP = 0.5, 0.05
"""A change of s⃛ over two elements is a jump beyond these shares of its larger value there, and of its largest at all."""
DENSEST = 5.0
"""Times the mean density that no place gets more of: jerk in shorter elements drowns in rounding."""
ROUNDING = 1 + 1e-12
RETIMED_GRID = 200
"""Grid intervals of the re-timed guess."""
Side = Literal["left", "right"]
"""Of an instant."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """n elements between the instants (n + 1,); interval (n,): the stretch between turning points that each lies in.

    The elements of an interval share its time in fixed proportion: intervals are the blocks of the program.
    """

    instants: Array
    interval: Indices

    @property
    def interval_sizes(self) -> tuple[int, ...]:
        """Elements of each interval."""
        return tuple(np.bincount(self.interval).tolist())

    @property
    def times(self) -> Array:
        """Duration of each interval, in all 1."""
        return np.bincount(self.interval, np.diff(self.instants)) / float(self.instants[-1])

    @property
    def fractions(self) -> Array:
        """Length of every element as a share of its interval, (n,)."""
        lengths = np.diff(self.instants)
        return np.asarray(lengths / np.bincount(self.interval, lengths)[self.interval])

    @classmethod
    def along(cls, guess: Retiming, knots: Array, count: int, jerk: Array | None = None) -> Mesh:
        """`count` elements, or a few more, along a re-timed motion whose joints turn back at the knots s_k.

        jerk: largest s⃛ at the grid points of the motion, (n + 1,), where jerk is limited: then every jump of s̈ gets the
        time that it needs, taken from the arc after it, as in the jerk-limited motion of a single joint.
        """
        times = guess.times
        turns = np.interp(knots, guess.s, times)
        speed = np.sqrt(guess.speed_squared)
        begins = _short_start(times, speed, guess.active)
        stops = [
            times[-1] - t
            for t in _short_start(times[-1] - times[::-1], speed[::-1], guess.active[::-1])
        ]
        ends = [*turns, *begins, *stops]
        for switch in times[1:-1][guess.active[1:] != guess.active[:-1]]:
            if np.min(np.abs(np.array(ends) - switch)) > SHORTEST_ARC * times[-1]:
                ends.append(float(switch))
        borders = np.array(sorted(ends))
        duration = times[-1]
        if jerk is not None:
            borders, turns = _with_ramps(borders, turns, guess, jerk)
            duration = borders[-1]
        pieces = _pieces(borders, _density(guess, borders), count)
        instants = np.append(np.concatenate(pieces), duration)
        return cls(instants, _interval(instants, turns))

    def elements(self, motion: Retiming) -> Array:
        """s, ṡ, s̈ at both ends and length of the elements, (n, 5), of a re-timed motion; time scaled to a duration of 1."""
        scale = motion.duration
        shares = self.instants / self.instants[-1]
        s = np.interp(shares * scale, motion.times, motion.s)
        speed = np.sqrt(np.interp(s, motion.s, motion.speed_squared)) * scale
        acceleration = np.diff(speed) / np.diff(shares)
        return np.stack([s[:-1], speed[:-1], acceleration, acceleration, np.diff(shares)], axis=1)

    @classmethod
    def on(cls, elements: Array, interval: Indices, count: int) -> Mesh:
        """`count` elements, or a few more, on a solution (n, 5), where s⃛ is limited: they end where that jumps.

        interval: of its elements, (n,). Between two jumps they are as `_pieces` says. An element of the solution across a
        jump has the mean of both sides, which tells where in it the jump is.
        """
        lengths = elements[:, 4]
        times = np.append(0.0, np.cumsum(lengths))
        jerk = np.diff(elements[:, 2:4])[:, 0] / lengths
        before, after = np.append(jerk[0], jerk[:-1]), np.append(jerk[1:], jerk[-1])
        jumps = np.abs(after - before)
        is_jump = jumps > np.maximum(
            JUMP * np.maximum(np.abs(after), np.abs(before)), LEAST_JUMP * np.abs(jerk).max()
        )
        share = np.clip((jerk - after) / np.where(jumps > 0, before - after, 1.0), 0.0, 1.0)
        turns = np.append(times[:-1][np.diff(interval, prepend=-1) > 0], times[-1])
        ends = turns.tolist()
        for k in sorted(np.flatnonzero(is_jump).tolist(), key=lambda k: -jumps[k]):
            end = times[k] + share[k] * lengths[k]
            if np.abs(np.array(ends) - end).min() > max(lengths[k], SHORTEST_ARC / 2 * times[-1]):
                ends.append(float(end))
        borders = np.array(sorted(ends))
        middles = (times[1:] + times[:-1]) / 2
        slope = np.abs(np.diff(jerk)) / np.diff(middles)
        # of neighbours within one arc, neither of which a jump is in
        arc = [
            np.searchsorted(borders, side)
            for side in (times[:-1] + EDGE * lengths, times[1:] - EDGE * lengths)
        ]
        within = (arc[0][:-1] == arc[0][1:]) & (arc[0] == arc[1])[1:] & (arc[0] == arc[1])[:-1]
        densities = np.zeros((len(borders) - 1, SAMPLES))
        for k, (start, end) in enumerate(pairwise(borders)):
            own = within & (arc[0][1:] == k + 1)
            if own.any():
                places = np.linspace(start, end, SAMPLES)
                densities[k] = np.sqrt(np.interp(places, times[1:-1][own], slope[own]))
        densities = np.minimum(densities, DENSEST * densities.mean())
        instants = np.append(np.concatenate(_pieces(borders, densities, count)), times[-1])
        return cls(instants, _interval(instants, turns))

    def moved(self, elements: Array) -> Array:
        """The motion of a solution (n, 5) in the elements of this mesh, which is on it."""
        times = np.append(0.0, np.cumsum(elements[:, 4]))
        k = np.clip(np.searchsorted(times, self.instants, side="right") - 1, 0, len(elements) - 1)
        share = (self.instants - times[k]) / elements[k, 4]
        s, speed, acceleration = (value[:, 0] for value in cubics(elements[k]).at(share[:, None]))
        columns = s[:-1], speed[:-1], acceleration[:-1], acceleration[1:], np.diff(self.instants)
        return np.stack(columns, axis=1)


def _interval(instants: Array, turns: Array) -> Indices:
    """Between which turning points each element lies."""
    middles = (instants[1:] + instants[:-1]) / 2
    return np.clip(np.searchsorted(turns, middles) - 1, 0, len(turns) - 2)


def _short_start(times: Array, speed: Array, active: Array) -> list[float]:
    """When a motion is up to speed, s, where that is within SHORTEST_ARC of its start; [] else.

    times, speed: at the grid points; active: what binds between them. The switch lies behind the last point before it.
    """
    fast = speed[1:-1] >= UP_TO_SPEED * speed.max()
    for k in 1 + np.flatnonzero(
        fast & (active[1:] != active[:-1]) & (times[1:-1] <= SHORTEST_ARC * times[-1])
    ):
        pull = (speed[k] - speed[k - 1]) / (times[k] - times[k - 1])
        if pull > 0:
            return [float(min(times[k] + max(speed[k + 1] - speed[k], 0.0) / pull, times[k + 1]))]
    return []


def _pieces(borders: Array, density: Array, count: int) -> list[Array]:
    """Starts of the elements of every arc: `count` in all, or FEWEST for each where that is more.

    s̈ is linear within an element, which costs h² |d²s̈/dt²|: elements are short where √|d²s̈/dt²| (`density`, at SAMPLES
    points of every arc) is large. Their number is the same for most motions, so that a compiled program serves many of them.
    """
    lengths = np.diff(borders)
    places = np.linspace(0.0, 1.0, SAMPLES)
    mean = (np.trapezoid(density, places, axis=1) * lengths).sum() / lengths.sum()
    density = density + (EVEN * mean if mean > 0 else 1.0)
    weight = np.trapezoid(density, places, axis=1) * lengths
    to_share = max(count, FEWEST * len(lengths)) - FEWEST * len(lengths)
    shared = np.round(np.cumsum(weight / weight.sum()) * to_share).astype(int)
    pieces = []
    for start, length, here, more in zip(
        borders, lengths, density, np.diff(shared, prepend=0), strict=False
    ):
        integral = np.concatenate([[0.0], np.cumsum((here[1:] + here[:-1]) / 2)])
        n = FEWEST + int(more)
        pieces.append(start + length * np.interp(np.arange(n) / n, integral / integral[-1], places))
    return pieces


def _accelerations(guess: Retiming) -> tuple[Array, Array]:
    """Instants in the middle of the grid intervals of a re-timed motion, and s̈ there."""
    return (guess.times[1:] + guess.times[:-1]) / 2, np.diff(guess.speed_squared) / (
        2 * np.diff(guess.s)
    )


def _density(guess: Retiming, borders: Array) -> Array:
    """√|d²s̈/dt²| at SAMPLES points of every arc, (arcs, SAMPLES), from smooth fits of the guess's s̈."""
    middle, acceleration = _accelerations(guess)
    densities = []
    for start, end in pairwise(borders):
        inside = (middle > start + EDGE * (end - start)) & (middle < end - EDGE * (end - start))
        if np.count_nonzero(inside) < 4 * DEGREE:
            densities.append(np.zeros(SAMPLES))
            continue
        t = middle[inside]
        centre, half = (t[-1] + t[0]) / 2, (t[-1] - t[0]) / 2
        terms = np.linalg.lstsq(
            chebvander((t - centre) / half, DEGREE), acceleration[inside], rcond=None
        )[0]
        places = np.clip((np.linspace(start, end, SAMPLES) - centre) / half, -1.0, 1.0)
        densities.append(np.sqrt(np.abs(chebval(places, chebder(terms, 2)))) / half)
    return np.array(densities)


def _with_ramps(borders: Array, turns: Array, guess: Retiming, jerk: Array) -> tuple[Array, Array]:
    """Borders with one more behind each jump of s̈, and the turning points moved along; the motion grows by the last ramp."""
    middle, acceleration = _accelerations(guess)
    window = SHORTEST_ARC / 2 * guess.duration
    ends = np.append(borders[1:], np.inf)
    result = []
    for border, end in zip(borders, ends, strict=True):
        before = acceleration[(middle < border) & (middle > border - window)]
        after = acceleration[(middle > border) & (middle < border + window)]
        jump = abs((after.mean() if len(after) else 0.0) - (before.mean() if len(before) else 0.0))
        ramp = jump / float(np.interp(border, guess.times, jerk))
        result.append(border)
        if SHORTEST_ARC * guess.duration / 4 < ramp and border + ramp < end - window:
            result.append(border + ramp)
    return np.array(result), np.append(turns[:-1], result[-1])


@dataclass(frozen=True, eq=False)
class SegmentGuess:
    """The guess of one segment of a free motion, n elements."""

    duration: float
    """s."""
    instants: Array
    """Ends of the elements, (n + 1,), s."""
    states: tuple[Array, Array, Array, Array]
    """q − start, q̇, q̈ at the start and q̈ at the end of every element, (n, joints)."""
    arcs: tuple[int, ...]
    """Elements between two switching points."""

    def halves(
        self, joint: int, place: float, fewest: int
    ) -> tuple[tuple[SegmentGuess, SegmentGuess], Array]:
        """Those between which this joint passes q − start = place, faster or slower before and after; q − start there."""
        positions = np.append(
            self.states[0][:, joint], self._at(self.instants[-1:], "left")[0][0, joint]
        )
        side, middle = np.sign(positions[-1]), self.duration / 2
        passes = float(np.interp(side * place, side * positions, self.instants))
        first, reached = self._part((0.0, middle), joint, (0.0, passes), fewest)
        second, _ = self._part((middle, self.duration), joint, (passes, self.duration), fewest)
        reached[joint] = place
        return (first, second), reached

    def _part(
        self, span: tuple[float, float], joint: int, own: tuple[float, float], fewest: int
    ) -> tuple[SegmentGuess, Array]:
        """What happens in a span of time, and with one joint in a span of its own; q − start at its end, (joints,)."""
        begin, end = span
        gap, switches = SHORTEST_ARC * self.duration, self.instants[np.cumsum(self.arcs)]
        inside = [float(t) for t in switches if begin + gap < t < end - gap]
        arcs, t = elements_between([begin, *inside, end], sum(self.arcs) / self.duration, fewest)
        pace = (own[1] - own[0]) / (end - begin)

        def paced(instants: Array, side: Side) -> tuple[Array, ...]:
            states, of_joint = (
                self._at(at, side) for at in (instants, own[0] + pace * (instants - begin))
            )
            for order in range(3):
                states[order][:, joint] = pace**order * of_joint[order][:, joint]
            return states

        (q, qd, first), (reached, _, last) = paced(t[:-1], "right"), paced(t[1:], "left")
        return SegmentGuess(end - begin, t - begin, (q - q[0], qd, first, last), arcs), reached[-1]

    def _at(self, t: Array, side: Side) -> tuple[Array, Array, Array]:
        """q − start, q̇ and q̈ at instants (n,), on one side of them, (n, joints)."""
        k = np.clip(np.searchsorted(self.instants, t, side) - 1, 0, len(self.instants) - 2)
        q, qd, first, last = (state[k] for state in self.states)
        return Cubic(q, qd, first, last, np.diff(self.instants)[k, None]).at_time(
            (t - self.instants[k])[:, None]
        )


def elements_between(
    switches: Sequence[float], density: float, fewest: int
) -> tuple[tuple[int, ...], Array]:
    """Of elements between switching points (k,), s, about `density` a second: numbers (k − 1,), and ends (n + 1,), s."""
    arcs = tuple(max(fewest, round(density * (end - start))) for start, end in pairwise(switches))
    parts = (
        np.linspace(start, end, n + 1)[1:]
        for (start, end), n in zip(pairwise(switches), arcs, strict=True)
    )
    return arcs, np.concatenate([switches[:1], *parts])


def closed_form_guess(
    way: Array, limits: Array, jerk: bool, count: int, fewest: int
) -> SegmentGuess:
    """For joints that move by `way` (m,), some of them by 0, under limits (3, m): velocity, acceleration, jerk.

    The slowest joint moves as fast as it can alone; the others move in step with it where that keeps their limits, else by
    their own fastest motion stretched to its time. Without other limits that is optimal. About `count` elements, at least
    `fewest` between two switching points.
    """
    moving = np.flatnonzero(way)
    distances = np.abs(way)
    velocity, acceleration, jerks = limits.tolist()
    alone = {
        k: rest_to_rest(
            float(distances[k]), velocity[k], acceleration[k], jerks[k] if jerk else None
        )
        for k in moving
    }
    slowest = max(moving, key=lambda k: alone[k].duration)
    leader = alone[slowest]
    instants, arcs = [np.zeros(1)], []
    for start, end in pairwise(leader.switches):
        n = max(fewest, round(count * (end - start) / leader.duration))
        arcs.append(n)
        instants.append(np.linspace(start, end, n + 1)[1:])
    t = np.concatenate(instants)
    middle = (t[1:] + t[:-1]) / 2
    size = len(middle), len(way)
    states = np.zeros(size), np.zeros(size), np.zeros(size), np.zeros(size)
    for k in moving:
        in_step = leader.scaled(distances[k] / distances[slowest])
        fits = all(
            peak <= limit * ROUNDING
            for peak, limit in zip(in_step.peaks[: 2 + jerk], limits[:, k], strict=False)
        )
        profile = in_step if fits else alone[k].stretched(leader.duration)
        (q, qd, _), qdd = profile.at(t), profile.at(middle)[2]
        half_rise = 0.5 * np.diff(t) * profile.jerk_at(middle)
        values = q[:-1], qd[:-1], qdd - half_rise, qdd + half_rise
        for state, value in zip(states, values, strict=True):
            state[:, k] = np.sign(way[k]) * value
    return SegmentGuess(leader.duration, t, states, tuple(arcs))


def sampled_guess(motion: Trajectory, start: float, end: float, count: int) -> SegmentGuess:
    """The part of a motion between two instants, by `count` elements of equal length."""
    t = np.linspace(start, end, count + 1)
    begin, stop = motion.sample(t[:-1]), motion.sample(t[1:], side="left")
    return SegmentGuess(
        end - start, t - start, (begin.q - begin.q[0], begin.qd, begin.qdd, stop.qdd), (count,)
    )


def retimed_guess(
    robot: Robot, limits: TaskLimits, path: PolylinePath, count: int
) -> SegmentGuess | None:
    """TOPP-RA's motion on a straight line in joint space, which keeps torques, rates and tip speed too; None without one."""
    motion = retime(path, robot, RETIMED_GRID, limits)
    if not motion.solved:
        return None
    mesh = Mesh.along(motion, path.directions[0], count)
    way = path.points[-1] - path.points[0]
    orders = (0, 1, 2, 2)
    position, velocity, start, end = (
        (state / motion.duration**order)[:, None] * way
        for state, order in zip(mesh.elements(motion).T, orders, strict=False)
    )
    states = position, velocity, start, end
    return SegmentGuess(motion.duration, mesh.instants, states, (len(mesh.instants) - 1,))
