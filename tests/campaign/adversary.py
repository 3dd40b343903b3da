"""Search for motions that `check` accepts although an independent oracle finds a violated limit.

Each case writes one file, reads it and checks it. A case fails if `check` reports that every limit
is kept while tests/support/oracle.py finds a value that exceeds a limit by more than ALLOWED. The
search is a hill climb: it changes the files that come closest to such a failure.
"""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
import tempfile
import traceback
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from tests.support import oracle

from .rows import ROBOT, Count, Hang, Row, watchdog

Array = np.ndarray
ALLOWED = 1e-3 + 1e-5
"""Excess over a limit, relative to the limit, that is tolerated: 0.1 % plus rounding."""
KEEP = 4
"""Number of cases kept for each limit. New cases are made from the kept ones."""
FRESH = 0.08
"""Fraction of the cases that start from the healthy motion again."""
AIMED = 0.3
"""Fraction of the cases that scale the speed of a motion so that it just meets a limit."""
TEMPO = 1.2
"""Width of the interval from which the logarithm of a speed factor is drawn."""
ORDERS = {
    "velocity": 1,
    "motor speed": 1,
    "tip speed": 1,
    "steps of position": 1,
    "acceleration": 2,
    "motor torque": 2,
    "continuous torque": 2,
    "steps of velocity": 2,
    "jerk": 3,
}
"""Power of the speed with which each limited quantity grows."""
HIDDEN = 1e-7
"""Smallest relative excess by which the oracle exceeds `check` beyond rounding."""
MOST_GENES = 6
MOST_ROWS = 250
MOST_PIECES = 260
SLACKS = (1e-3, 0.3)
"""Range of the relative margins of torque, tilt range and tip speed over the healthy motion."""
DYNAMIC = ("acceleration", "motor torque", "continuous torque", "jerk", "nut contact")
"""Limits that `check --allow-unjudged` leaves unjudged on straight lines."""
SPEEDS = (1.0, 0.98, 0.9, 0.8, 0.65, 0.5, 0.35)
"""Speed factors at which a healthy motion is tried, one after the other."""
TENS = 10.0


class Gene(NamedTuple):
    """A change of a motion or of its table.

    `kind` names the function that makes the change. `u` holds the numbers from 0 to 1 that this
    function reads.
    """

    kind: str
    u: tuple[float, ...]


Genes = tuple[Gene, ...]


class Motion(NamedTuple):
    """The pieces of a motion: breaks (m + 1,) in s and coefficients (m, 6, 4)."""

    breaks: Array
    coefficients: Array


class Table(NamedTuple):
    """Rows of a motion: times (n,) and states (n, 4). NaN marks a quantity that a row omits."""

    t: Array
    q: Array
    qd: Array
    qdd: Array


class Outcome(NamedTuple):
    """The verdict of `check` on a file, and the excesses that the oracle finds in the motion."""

    verdict: str
    excess: float
    """Relative excess over the worst limit according to `check`."""
    found: dict[oracle.Key, float]
    checked: dict[oracle.Key, float]
    """Relative excess over each limit according to `check`."""
    smooth: bool
    """True if the motion has no straight lines.

    On straight lines `check` subtracts from the speed the part that rounding explains.
    """

    @property
    def worst(self) -> tuple[oracle.Key, float]:
        return max(self.found.items(), key=lambda item: item[1])

    @property
    def fault(self) -> str | None:
        """Return a description of the violation that `check` misses, or None."""
        (name, joint), excess = self.worst
        missed = self.verdict == "kept" and excess > ALLOWED
        return f"{name} of {joint}: {excess:.3e} too large, but kept" if missed else None


def run(count: int, seed: int) -> list[Row]:
    """Run one climb for each of the six formats. Each climb gets a sixth of the count."""
    return list(climbs(count, seed))


def climbs(count: int, seed: int) -> Iterator[Row]:
    """Yield the row of each format when its climb ends."""
    for number, form in enumerate(FORMS):
        counted = Count(f"adversary: {form}")
        with tempfile.TemporaryDirectory() as name:
            climb = Climb(form, Path(name), np.random.default_rng((seed, number)))
            for case in range(count // len(FORMS)):
                genes, fault = climb.step()
                counted.add(fault and f"seed {seed} {form} case {case}: {fault}; {shown(genes)}")
        yield counted.row


def shown(genes: Genes) -> str:
    return "; ".join(f"{gene.kind} {[round(x, 4) for x in gene.u]}" for gene in genes)


class Climb:
    """A climb on files of one format. It keeps and further changes the best cases of each limit."""

    def __init__(self, form: str, folder: Path, rng: np.random.Generator) -> None:
        self.form, self.folder, self.rng = form, folder, rng
        self.case = self.healthy()
        self.kinds = [*MOTION_GENES, *(TABLE_GENES if form != "plan" else ())]
        if self.case.targets:
            self.kinds.append("target")
        self.best: dict[str, list[tuple[float, Genes, float]]] = {}

    def healthy(self) -> Case:
        """Return a case whose unchanged file violates no limit.

        The motion is slowed down where the rows of the format, or its rounding, make this
        necessary.
        """
        while True:
            case = healthy_case(self.rng, self.form)
            for speed in SPEEDS:
                motion = faster(case.motion, 0, len(case.motion.coefficients), speed)
                slower = case._replace(motion=motion)
                outcome = evaluate(slower, self.form, (), self.folder)
                if outcome is not None and outcome.verdict != "violated":
                    return slower

    def step(self) -> tuple[Genes, str | None]:
        """Write and check one file, and remember its genes if they are among the best."""
        genes = self.child()
        try:
            with watchdog():
                outcome = evaluate(self.case, self.form, genes, self.folder)
        except Hang:
            return genes, "hangs"
        except Exception as error:  # noqa: BLE001 - any is a finding
            last = traceback.extract_tb(error.__traceback__)[-1]
            return genes, f"{type(error).__name__}: {str(error)[:80]} ({last.name}:{last.lineno})"
        if outcome is not None:
            self.remember(genes, outcome)
        return genes, outcome and outcome.fault

    def remember(self, genes: Genes, outcome: Outcome) -> None:
        """Offer the genes for every limit, ranked by the excess that the oracle finds.

        A violation that `check` reports lowers the rank. The genes are also ranked by the
        difference between the oracle and `check`, because a growing difference precedes a missed
        violation.
        """
        penalty = 10 * max(outcome.excess - 1e-6, 0.0) if outcome.verdict == "violated" else 0.0
        for key, excess in outcome.found.items():
            self.offer(key[0], min(excess, 1.0) - penalty, genes, excess)
            hidden = excess - outcome.checked.get(key, np.inf)
            if outcome.smooth and outcome.verdict != "violated" and hidden > HIDDEN:
                self.offer(f"hidden {key[0]}", hidden, genes, excess)

    def offer(self, name: str, score: float, genes: Genes, excess: float) -> None:
        """Keep the genes if their score is among the best for this name."""
        ranked = [*self.best.get(name, []), (score, genes, excess)]
        self.best[name] = sorted(ranked, key=lambda entry: -entry[0])[:KEEP]

    def child(self) -> Genes:
        """Return a small change of one of the best cases, or a new random case."""
        rng = self.rng
        if not self.best or rng.random() < FRESH:
            return (random_gene(str(rng.choice(self.kinds)), rng),)
        names = sorted(self.best)
        name = names[int(rng.integers(len(names)))]
        ranked = self.best[name]
        _, chosen, excess = ranked[int(rng.integers(len(ranked)))]
        order = ORDERS.get(name.removeprefix("hidden "))
        if order is not None and -0.6 < excess < ALLOWED and rng.random() < AIMED:
            return aimed(chosen, excess, order, rng)
        genes = list(chosen)
        way = rng.random()
        if (way < 0.25 and len(genes) < MOST_GENES) or not genes:
            genes.insert(
                int(rng.integers(len(genes) + 1)), random_gene(str(rng.choice(self.kinds)), rng)
            )
        elif way < 0.35 and len(genes) > 1:
            del genes[int(rng.integers(len(genes)))]
        else:
            k = int(rng.integers(len(genes)))
            genes[k] = nudged(genes[k], rng)
        return tuple(genes)


def random_gene(kind: str, rng: np.random.Generator) -> Gene:
    return Gene(kind, tuple(rng.random(6).tolist()))


def aimed(genes: Genes, excess: float, order: int, rng: np.random.Generator) -> Genes:
    """Return the genes with a speed at which the motion slightly exceeds or just keeps a limit."""
    goal = log(rng.random(), 1e-3, 1e-2) * (1 if rng.random() < 0.8 else -1)
    factor = ((1 + goal) / (1 + excess)) ** (1 / order)
    remaining = list(genes)
    if remaining and remaining[-1].kind == "tempo" and remaining[-1].u[1] >= 0.5:
        factor *= np.exp(TEMPO * (remaining.pop().u[0] - 0.5))
    place = float(np.clip(0.5 + np.log(factor) / TEMPO, 0.0, 1.0))
    return (*remaining, Gene("tempo", (place, 1.0, 0.0, 0.0, 0.0, 0.0)))


def nudged(gene: Gene, rng: np.random.Generator) -> Gene:
    """Return the gene with one or two of its numbers changed by a random amount."""
    u = np.array(gene.u)
    for k in rng.integers(6, size=int(rng.integers(1, 3))):
        u[k] += rng.normal() * TENS ** rng.uniform(-4, -0.5)
    return Gene(gene.kind, tuple(np.abs(1 - np.abs(1 - u % 2)).tolist()))


# --- healthy motions ---


class Case(NamedTuple):
    """A robot with its limits, and a motion that keeps them."""

    robot: Any
    motion: Motion
    limits: Any
    ranges: dict[str, tuple[float, float]]
    tip: float
    targets: tuple[Array, ...]
    """Joint positions to reach. Empty if the motion is checked without a problem."""
    counts: int
    """Increments per motor turn."""


@lru_cache(maxsize=1)
def _shipped() -> tuple[Any, tuple[Motion, ...]]:
    """Return the shipped robot, its shipped plan and plans of random problems."""
    from ssm_planner.loading.load import load_robot
    from ssm_planner.plans import load_plan

    plan = load_plan(ROBOT.parents[2] / "results/tilt_insert")
    planned = [plan.motion, *random_plans()]
    return load_robot(ROBOT), tuple(Motion(item.breaks, item.coefficients) for item in planned)


@lru_cache(maxsize=1)
def random_plans(count: int = 3) -> tuple[Any, ...]:
    """Return motions that the planner finds between random positions of the shipped robot."""
    from ssm_planner.loading.load import load_robot
    from ssm_planner.pipeline.run import plan
    from ssm_planner.problem import Free, Joints, Problem, unchecked_copy

    robot, rng, motions = load_robot(ROBOT), np.random.default_rng(5), []
    for k in range(count):
        points = [Joints(tuple(position(rng).tolist())) for _ in range(3)]
        problem = Problem(robot, points[0], tuple(Free(p) for p in points[1:]), name=f"random {k}")
        motions.append(plan(unchecked_copy(problem, planner="fast"), relaxations=False).motion)
    return tuple(motions)


def position(rng: np.random.Generator) -> Array:
    """Return joint positions (4,) well within the ranges of the shipped robot."""
    return np.append(rng.uniform((-1, 0.7, -1), (1, 1.4, 1)), rng.uniform(-0.028, -0.002))


def healthy_case(rng: np.random.Generator, form: str) -> Case:
    """Return a motion near its limits, with a robot of random friction, jerk, torque and ranges."""
    from ssm_planner.problem import TaskLimits, TaskRange, TipSpeed
    from tests.support.plans import smooth, trapezoids

    robot, planned = _shipped()
    way = rng.random()
    jerk = form == "plan" and way > 0.85
    joints = [varied(joint, rng, jerk) for joint in robot.joints]
    robot = dataclasses.replace(robot, joints=tuple(joints))
    if way < 0.2:
        motion = planned[int(rng.integers(len(planned)))]
    else:
        make = trapezoids if way < 0.7 else smooth
        moves = np.array([position(rng) for _ in range(3)]) * [1, 0.2, 1, 1]
        start = np.array([0.3, 1.15, 0.1, 0.0])
        steps = np.diff(np.vstack([[0, 0.23, 0, 0], moves]), axis=0)[: int(rng.integers(1, 4))]
        output = make(robot, tuple(steps * rng.choice((1.0, 0.3, 0.05))))
        motion = Motion(output.breaks, output.coefficients)
        assert np.allclose(motion.coefficients[0, 0], start)
    played = oracle.from_pieces(*motion)
    result = oracle.violations(played, robot, ranges={"tilt": (-3.0, 0.0)}, tip=1.0)
    slack = {key: 1 + log(rng.random(), *SLACKS) for key in ("torque", "tilt", "tip")}
    joints = []
    for joint in robot.joints:
        if joint.motor is not None and rng.random() < 0.7:
            peak = (1 + result["motor torque", joint.name]) * joint.motor.max_torque
            joint = weaker(joint, peak * slack["torque"])
        joints.append(joint)
    robot = dataclasses.replace(robot, joints=tuple(joints), limits=())
    angles = oracle.tilt(robot, oracle.sampled(played).states[0].reshape(-1, 4))
    spare = (slack["tilt"] - 1) * (np.ptp(angles) + 1e-3)
    ranges = {"tilt": (float(angles.min() - spare), float(angles.max() + spare))}
    tip = float((1 + result["tip speed", None]) * slack["tip"]) + 1e-6
    limits = TaskLimits((TaskRange("tilt", *ranges["tilt"]), TipSpeed(tip)))
    ends = oracle.sampled(played).states[0][[0, -1], [0, -1]]
    targets = tuple(ends) if rng.random() < 0.4 else ()
    counts = int(rng.choice((1024, 4096, 65536)))
    return Case(robot, motion, limits, ranges, tip, targets, counts)


def varied(joint: Any, rng: np.random.Generator, jerk: bool) -> Any:
    """Return the joint, sometimes with Stribeck friction or a jerk limit."""
    from ssm_planner.problem import unchecked_copy

    drive = joint.drive
    if drive is not None and rng.random() < 0.35:
        friction = dataclasses.replace(
            drive.friction,
            law=str(rng.choice(("stribeck_exponential", "stribeck_gaussian"))),
            mu_stribeck=float(rng.uniform(0.02, 0.1)),
            stribeck_speed=float(TENS ** rng.uniform(-1, 2)),
        )
        drive = unchecked_copy(drive, friction=friction)
    largest = joint.acceleration * float(TENS ** rng.uniform(1, 3)) if jerk else None
    return dataclasses.replace(joint, drive=drive, jerk=largest)


def weaker(joint: Any, torque: float) -> Any:
    """Return the joint with a motor of the given peak torque in N·m."""
    from ssm_planner.problem import unchecked_copy

    nominal = min(joint.motor.nominal_torque, float(torque))
    motor = unchecked_copy(joint.motor, max_torque=float(torque), nominal_torque=nominal)
    return dataclasses.replace(joint, motor=motor)


# --- changes of a motion ---


def log(u: float, low: float, high: float) -> float:
    return float(low * (high / low) ** u)


def pick(u: float, count: int) -> int:
    return min(int(u * count), count - 1)


def bounds(robot: Any) -> Array:
    """Return rows (3, 4): ones for positions, the velocity limits and the acceleration limits."""
    joints = robot.joints
    return np.array([np.ones(4), [j.velocity for j in joints], [j.acceleration for j in joints]])


def tempo(case: Case, motion: Motion, u: tuple[float, ...]) -> Motion:
    """Play the whole motion faster or slower."""
    factor = np.exp((u[0] - 0.5) * (0.02 if u[1] < 0.5 else TEMPO))
    return faster(motion, 0, len(motion.breaks) - 1, factor)


def stretch(case: Case, motion: Motion, u: tuple[float, ...]) -> Motion:
    """Play a part of the motion faster or slower.

    The part lies between two pieces at rest, or between two arbitrary breaks.
    """
    ends = [0, len(motion.breaks) - 1]
    if u[1] < 0.6:
        moving = np.abs(motion.coefficients[:, 1]).max(axis=1) > 1e-9
        ends += np.flatnonzero(~moving).tolist()
    else:
        ends += [pick(u[2], len(motion.breaks)), pick(u[3], len(motion.breaks))]
    stops = sorted(set(ends))
    k = pick(u[0], len(stops) - 1)
    return faster(
        motion, stops[k], stops[k + 1], np.exp((u[4] - 0.5) * (0.02 if u[5] < 0.5 else 0.6))
    )


def faster(motion: Motion, first: int, last: int, factor: float) -> Motion:
    """Play the pieces first … last − 1 faster by a factor."""
    lengths, coefficients = np.diff(motion.breaks), motion.coefficients.copy()
    lengths[first:last] /= factor
    coefficients[first:last] *= (factor ** np.arange(6))[:, None]
    return Motion(np.append(0.0, np.cumsum(lengths)), coefficients)


def cut(motion: Motion, piece: int, places: list[float]) -> Motion:
    """Cut one piece at the given times in s since its start."""
    from .violations import shifted

    parts = [shifted(motion.coefficients[piece], place) for place in (0.0, *places)]
    times = motion.breaks[piece] + np.array(places)
    return Motion(
        np.concatenate([motion.breaks[: piece + 1], times, motion.breaks[piece + 1 :]]),
        np.concatenate(
            [motion.coefficients[:piece], np.stack(parts), motion.coefficients[piece + 1 :]]
        ),
    )


def place_in(motion: Motion, u: float, v: float, width: float) -> tuple[int, float, float]:
    """Return a piece, and the start and width in s of an interval within it."""
    lengths = np.diff(motion.breaks)
    piece = pick(u, len(lengths))
    width = min(width, 0.9 * lengths[piece])
    return piece, float(0.02 * lengths[piece] + v * (0.96 * lengths[piece] - width)), width


def pulse(case: Case, motion: Motion, u: tuple[float, ...]) -> Motion:
    """Add a pulse of 1 µs to 10 ms to one joint or to all joints."""
    piece, start, width = place_in(motion, u[0], u[1], log(u[2], 1e-6, 1e-2))
    if width < 5e-7 or start < 1e-9:
        return motion
    shape = pick(u[5], 6)
    joints = [pick(u[3], 5)] if u[3] < 0.8 else [0, 1, 2, 3]
    sign = 1.0 if u[4] >= 0.5 else -1.0
    amount = 2 * abs(u[4] - 0.5)
    limit = bounds(case.robot)
    halved = [start, start + width / 2, start + width] if shape == 2 else [start, start + width]
    motion = cut(motion, piece, halved)
    part, later = motion.coefficients[piece + 1], motion.coefficients[piece + len(halved) :]
    for joint in joints:
        _, v, a = limit[:, joint]
        if shape == 0:  # q + A s² (1 − s)²
            size = sign * 3 * amount * a * width**2 / 2
            part[2:5, joint] += size * np.array([1 / width**2, -2 / width**3, 1 / width**4])
        elif shape == 1:  # q̇ + A s (1 − s), the acceleration jumps at both ends
            size = sign * 3 * amount * a * width**2
            part[2:4, joint] += size * np.array([1 / width**2 / 2, -1 / width**3 / 3])
            motion.coefficients[piece + 2 :, 0, joint] += size / 6
        elif shape == 2:  # q̈ + A in the first half, q̈ − A in the second
            bend = sign * 3 * amount * a
            part[2, joint] += bend / 2
            second = motion.coefficients[piece + 2]
            second[0, joint] += bend * width**2 / 8
            second[1, joint] += bend * width / 2
            second[2, joint] -= bend / 2
            later[:, 0, joint] += bend * width**2 / 4
        elif shape == 3:  # q̇ + A
            speed = sign * v * log(amount, 1e-9, 1.0)
            part[1, joint] += speed
            later[:, 0, joint] += speed * width
        elif shape == 4:  # q + A
            part[0, joint] += sign * log(amount, 1e-10, 1e-3)
        else:  # q̇ + A 16 s² (1 − s)², a smooth dip or peak
            speed = sign * v * 1.2 * amount * 16
            part[3:6, joint] += speed * np.array(
                [1 / width**2 / 3, -1 / width**3 / 2, 1 / width**4 / 5]
            )
            later[:, 0, joint] += speed * width / 30
    return motion


def dip(case: Case, motion: Motion, u: tuple[float, ...]) -> Motion:
    """Slow a joint down towards standstill and speed it up again within one piece."""
    piece, start, width = place_in(motion, u[0], u[1], log(u[2], 1e-3, 0.5))
    if width < 1e-5:
        return motion
    motion = cut(motion, piece, [start, start + width])
    part = motion.coefficients[piece + 1]
    joints = [pick(u[3], 5)] if u[3] < 0.8 else [0, 1, 2, 3]
    for joint in joints:
        middle = sum(k * part[k, joint] * (width / 2) ** (k - 1) for k in range(1, 6))
        size = -1.3 * u[4] * middle * 16
        part[3:6, joint] += size * np.array([1 / width**2 / 3, -1 / width**3 / 2, 1 / width**4 / 5])
        motion.coefficients[piece + 2 :, 0, joint] += size * width / 30
    return motion


def jump(case: Case, motion: Motion, u: tuple[float, ...]) -> Motion:
    """Let position, velocity or acceleration jump at one break or at many breaks."""
    coefficients = motion.coefficients.copy()
    count = len(coefficients)
    joint, order, way = pick(u[1], 4), pick(u[2], 3), pick(u[4], 4)
    size = log(u[3], 1e-9, 1e-3 if order < 2 else 1.0) * bounds(case.robot)[order, joint]
    size *= 1 if u[5] < 0.5 else -1
    first = pick(u[0], count)
    if order == 0:
        steps = np.zeros(count + 1)
        steps[
            [
                slice(first, first + 1),
                slice(first, None),
                slice(first, None, 2),
                slice(first, None, 7),
            ][way]
        ] = size
        if way and u[5] * 10 % 1 < 0.3:
            steps[::2] *= -1
        coefficients[:, 0, joint] += np.cumsum(steps)[:count]
        return Motion(motion.breaks, coefficients)
    chosen = [
        slice(first, first + 1),
        slice(first, None),
        slice(first, None, 2),
        slice(first, None, 7),
    ][way]
    change = np.zeros(count)
    change[chosen] = size / order
    h = np.diff(motion.breaks)
    coefficients[:, order, joint] += change
    drift = np.cumsum(change * h**order)
    coefficients[1:, 0, joint] += drift[:-1]
    return Motion(motion.breaks, coefficients)


def divide(case: Case, motion: Motion, u: tuple[float, ...]) -> Motion:
    """Cut one piece, or a short part of it, into many tiny pieces."""
    count = min(int(log(u[1], 2, 200)), MOST_PIECES - len(motion.coefficients))
    if count < 2:
        return motion
    length = float(np.diff(motion.breaks)[pick(u[0], len(motion.coefficients))])
    piece, start, width = place_in(
        motion, u[0], u[2], length if u[3] < 0.5 else log(u[4], 1e-5, 1e-1)
    )
    if width / count < 1e-7:
        return motion
    return cut(motion, piece, [start + width * k / count for k in range(count + 1)])


MOTION_GENES: dict[str, Callable[[Case, Motion, tuple[float, ...]], Motion]] = {
    "tempo": tempo, "stretch": stretch, "pulse": pulse, "dip": dip, "jump": jump, "divide": divide,
}  # fmt: skip


# --- changes of a table ---


def state_of(motion: Motion, t: Array) -> Table:
    """Return rows of a motion at times (n,) in s. At a break, the piece that begins counts."""
    piece = np.clip(np.searchsorted(motion.breaks, t, side="right") - 1, 0, len(motion.breaks) - 2)
    local = t - motion.breaks[piece]
    rows, coefficients = [], motion.coefficients[piece]
    for _ in range(3):
        powers = local[:, None] ** np.arange(coefficients.shape[1])
        rows.append(np.einsum("nk,nkj->nj", powers, coefficients))
        coefficients = coefficients[:, 1:] * np.arange(1, coefficients.shape[1])[:, None]
    return Table(t, *rows)


def times_of(motion: Motion, gene: Gene | None) -> Array:
    """Return the times of the rows in s.

    They are breaks, uniform or jittered times, and times close together.
    """
    end = float(motion.breaks[-1])
    if gene is None:
        t = motion.breaks
    else:
        u = gene.u
        rate = min(log(u[1], 5, 2000), MOST_ROWS / end)
        uniform = np.append(np.arange(int(end * rate) + 1) / rate, end)
        jitter = np.random.default_rng(int(u[3] * 1e6)).uniform(-0.45, 0.45, len(uniform)) / rate
        uniform = np.clip(uniform + jitter * (u[2] if u[5] < 0.5 else 0.0), 0.0, end)
        t = uniform if u[0] < 0.4 else np.union1d(motion.breaks, uniform)
        near = t[pick(u[4], len(t))] + log(u[2], 1e-6, 1e-2)
        t = np.union1d(t, [near] if u[0] > 0.7 and near < end else [0.0, end])
    t = np.union1d(t, [0.0, end])
    if len(t) > MOST_ROWS:
        t = t[np.unique(np.linspace(0, len(t) - 1, MOST_ROWS).astype(int))]
    return t[np.append(np.diff(t) > 2e-7, True)]


def bump(case: Case, table: Table, u: tuple[float, ...]) -> Table:
    """Change one number in one row or in two rows."""
    order, joint, row = pick(u[2], 3), pick(u[1], 4), pick(u[0], len(table.t))
    largest = (1e-3, 1.0, 3.0)[order] * bounds(case.robot)[order, joint]
    values = [table.q.copy(), table.qd.copy(), table.qdd.copy()]
    size = log(abs(2 * u[3] - 1), 1e-9, 1.0) * largest * (1 if u[3] > 0.5 else -1)
    values[order][row : row + (1 if u[4] < 0.7 else 2), joint] += size
    return Table(table.t, *values)


def digits(case: Case, table: Table, u: tuple[float, ...]) -> Table:
    """Round one quantity, or all of them, to fewer digits."""
    places = int(3 + 13 * u[1])
    values = [
        np.round(x, places) if u[0] > 0.75 or pick(u[0] / 0.75, 3) == k else x
        for k, x in enumerate(table[1:])
    ]
    return Table(table.t, *values)


def omit(case: Case, table: Table, u: tuple[float, ...]) -> Table:
    """Omit velocities or accelerations from some rows."""
    qd, qdd = table.qd.copy(), table.qdd.copy()
    first = pick(u[0], len(table.t))
    rows = slice(first, first + 1 + pick(u[1] ** 2, len(table.t)))
    if u[2] < 0.2:
        rows = slice(None, None, 2)
    (qd if u[3] < 0.35 else qdd)[rows] = np.nan
    return Table(table.t, table.q, qd, qdd)


def swap(case: Case, table: Table, u: tuple[float, ...]) -> Table:
    """Exchange two joints in one quantity, in all rows or in some of them."""
    values = [table.q.copy(), table.qd.copy(), table.qdd.copy()]
    first, last = sorted((pick(u[2], len(table.t)), pick(u[3], len(table.t))))
    rows = slice(None) if u[4] < 0.3 else slice(first, last + 1)
    pair = [pick(u[0], 4), pick(u[1], 4)]
    chosen = values[pick(u[5], 3)]
    chosen[rows, pair] = chosen[rows, pair[::-1]]
    return Table(table.t, *values)


def clock(case: Case, table: Table, u: tuple[float, ...]) -> Table:
    """Shift the time stamps by a fraction of the time between the rows."""
    rng = np.random.default_rng(int(u[1] * 1e6))
    moved = table.t + rng.uniform(-0.45, 0.45, len(table.t)) * log(u[0], 1e-6, 1.0) * np.gradient(
        table.t
    )
    moved[0] = table.t[0]
    if u[2] < 0.5:
        moved = np.where(np.arange(len(moved)) == pick(u[3], len(moved)), moved, table.t)
    keep = np.all(np.diff(moved) > 1e-7)
    return table._replace(t=moved) if keep else table


TABLE_GENES: dict[str, Callable[[Case, Table, tuple[float, ...]], Table] | None] = {
    "times": None, "bump": bump, "digits": digits, "omit": omit, "swap": swap, "clock": clock,
}  # fmt: skip


# --- evaluation ---


def evaluate(case: Case, form: str, genes: Genes, folder: Path) -> Outcome | None:
    """Write the file, check it and judge the motion by the oracle.

    Returns None if no file is written, or if reading or checking refuses the file.
    """
    from ssm_planner.errors import SsmPlannerError
    from ssm_planner.problem import Free, Joints, Problem
    from ssm_planner.verification.visits import with_task_results

    motion = Motion(case.motion.breaks.copy(), case.motion.coefficients.copy())
    for gene in genes:
        if gene.kind in MOTION_GENES:
            motion = MOTION_GENES[gene.kind](case, motion, gene.u)
    try:
        output = FORMS[form](case, motion, genes, folder)
        if output is None:
            return None
        path, played, more = output
        reading, robot, limits = read(case, form, path)
        certificate = reading.check(robot, limits)
        targets = moved_targets(case, genes)
        if targets:
            points = [Joints(tuple(point.tolist())) for point in targets]
            problem = Problem(robot, points[0], tuple(map(Free, points[1:])), limits=limits.limits)
            certificate = with_task_results(certificate, reading.trajectory, problem)
    except SsmPlannerError:
        return None
    straight = not played.curved.all()
    if straight:  # as with --allow-unjudged
        certificate = certificate.allowing(*DYNAMIC)
    result = oracle.violations(played, case.robot, ranges=case.ranges, tip=case.tip) | more
    if straight:
        open_ = {name for text in certificate.unchecked for name in DYNAMIC if name in text}
        result = {key: value for key, value in result.items() if key[0] not in open_ or key in more}
    if targets:
        result["target", None] = oracle.missed(played, targets)
    checked = {(limit.name, limit.joint): -limit.margin for limit in certificate.limits}
    return Outcome(certificate.verdict, -certificate.worst.margin, result, checked, not straight)


def read(case: Case, form: str, path: Path) -> tuple[Any, Any, Any]:
    """Return the motion, the robot and the limits that the command `check` reads."""
    from ssm_planner.cli import check as command
    from ssm_planner.formats.read import read_trajectory

    if form == "plan":
        reading, robot, limits = command.read_with_robot(path, None)
    else:
        reading, robot, limits = read_trajectory(path, case.robot), case.robot, case.limits
    return reading, robot, reading.add_declared_rates(limits)


def moved_targets(case: Case, genes: Genes) -> list[Array]:
    """Return the targets of the problem, moved by about their tolerance."""
    targets = [target.copy() for target in case.targets]
    for gene in genes:
        if gene.kind == "target" and targets:
            targets[pick(gene.u[4], 2)] += (2 * np.array(gene.u[:4]) - 1) * oracle.TARGET * 1.2
    return targets


Written = tuple[Path, oracle.Played, dict[oracle.Key, float]] | None
"""A file, the motion that its client plays, and excesses over limits that only the file states."""


def table_of(case: Case, motion: Motion, genes: Genes) -> Table:
    """Return the rows of the motion with all changes of tables applied."""
    gene = next((gene for gene in genes if gene.kind == "times"), None)
    table = state_of(motion, times_of(motion, gene))
    table.qd[-1] = np.where(np.abs(table.qd[-1]) < 1e-9, 0.0, table.qd[-1])
    for gene in genes:
        change = TABLE_GENES.get(gene.kind)
        if change is not None:
            table = change(case, table, gene.u)
    return table


def columns_of(genes: Genes) -> int:
    """Return how many quantities a table has: 1 to 3. The usual number is 2, for cubics."""
    gene = next((gene for gene in genes if gene.kind in ("times", "digits")), None)
    return 2 if gene is None else (1, 2, 2, 3)[pick(gene.u[5], 4)]


def write_plan_file(case: Case, motion: Motion, genes: Genes, folder: Path) -> Written:
    """Write a plan.json. Its certificate belongs to another motion."""
    document = plan_document(case, folder)
    phases = [{"name": "move", "start_s": 0.0, "end_s": float(motion.breaks[-1])}]
    pieces = {"breaks_s": motion.breaks.tolist(), "coefficients": motion.coefficients.tolist()}
    path = folder / "plan.json"
    path.write_text(json.dumps({**document, "trajectory": {**pieces, "phases": phases}}))
    return path, oracle.from_pieces(*motion), {}


_latest: list[Any] = [None, {}]
"""The limits of the case whose plan.json was made last, and that document."""


def plan_document(case: Case, folder: Path) -> dict[str, Any]:
    """Return the parts of a plan.json that stay the same in a climb.

    Their certificate belongs to another motion.
    """
    from tests.support.plans import smooth, write_plan

    if _latest[0] is not case.limits:
        path = write_plan(folder / "plan.json", case.robot, smooth(case.robot), case.limits)
        _latest[:] = case.limits, json.loads(path.read_text(encoding="utf-8"))
    document: dict[str, Any] = _latest[1]
    return document


def write_csv_file(case: Case, motion: Motion, genes: Genes, folder: Path) -> Written:
    """Write a CSV with positions.

    Velocities and accelerations are added if no row lacks them.
    """
    table = table_of(case, motion, genes)
    count = columns_of(genes)
    tables = list(table[1 : 1 + count])
    while len(tables) > 1 and np.isnan(tables[-1]).any():
        tables.pop()
    names = [f"q{{}}{i + 1}_{'rad' if i < 3 else 'm'}{{}}" for i in range(4)]
    units = (("", ""), ("d", "_per_s"), ("dd", "_per_s2"))
    header = [
        name.format("", unit).replace("q", "q" + d, 1)
        for d, unit in units[: len(tables)]
        for name in names
    ]
    rows = np.column_stack([table.t, *tables])
    path = folder / "points.csv"
    lines = [",".join(["time_s", *header]), *(",".join(map(repr, row)) for row in rows.tolist())]
    path.write_text("\n".join(lines) + "\n")
    return path, oracle.through(table.t, *tables), {}


def ticked(table: Table) -> Table:
    """Return the table with times rounded to whole nanoseconds."""
    ticks = np.round(table.t * 1e9)
    return table._replace(t=ticks / 1e9)


def lists_of(rows: Array) -> list[list[float]]:
    return [[] if np.isnan(row).any() else row.tolist() for row in rows]


def message_of(case: Case, motion: Motion, genes: Genes) -> tuple[Table, dict[str, Any]] | None:
    """Return a table and its JointTrajectory message as a document.

    Returns None if two rounded times coincide.
    """
    table = ticked(table_of(case, motion, genes))
    if np.any(np.diff(table.t) <= 0):
        return None
    count = columns_of(genes)
    for k in (2, 3):
        if count < k:
            table[k][:] = np.nan
    fields = {
        name: lists_of(rows)
        for name, rows in zip(("positions", "velocities", "accelerations"), table[1:], strict=True)
    }
    ticks = np.round(table.t * 1e9).astype(int).tolist()
    points = [
        {
            **{name: rows[k] for name, rows in fields.items()},
            "effort": [],
            "time_from_start": {"sec": tick // 10**9, "nanosec": tick % 10**9},
        }
        for k, tick in enumerate(ticks)
    ]
    names = [joint.name for joint in case.robot.joints]
    return table, {"joint_names": names, "points": points}


def write_yaml_file(case: Case, motion: Motion, genes: Genes, folder: Path) -> Written:
    """Write a JointTrajectory as JSON, which is valid YAML."""
    result = message_of(case, motion, genes)
    if result is None:
        return None
    table, document = result
    path = folder / "goal.yaml"
    text = json.dumps(document)
    # YAML reads 1e-05 as a string
    text = re.sub(r"(?<![\d.])(-?\d+)e([+-]?\d+)", r"\1.0e\2", text)
    path.write_text(text)
    return path, oracle.through(*table), {}


def write_bag_file(case: Case, motion: Motion, genes: Genes, folder: Path) -> Written:
    """Write a rosbag2 that contains only the JointTrajectory."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    from ssm_planner.formats import ros2

    result = message_of(case, motion, genes)
    if result is None:
        return None
    table, document = result
    store = _store(Stores.ROS2_HUMBLE, get_typestore)
    points = [
        SimpleNamespace(
            time_from_start=SimpleNamespace(**point.pop("time_from_start")),
            **{name: np.array(values, dtype=float) for name, values in point.items()},
        )
        for point in document["points"]
    ]
    stamp = SimpleNamespace(sec=0, nanosec=0)
    message = SimpleNamespace(
        header=SimpleNamespace(stamp=stamp, frame_id="base"),
        joint_names=document["joint_names"],
        points=points,
    )
    path = folder / "bag"
    shutil.rmtree(path, ignore_errors=True)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/joint_trajectory", ros2.TRAJECTORY_TYPE, typestore=store)
        writer.write(topic, 0, store.serialize_cdr(message, topic.msgtype))
    return path, oracle.through(*table), {}


@lru_cache(maxsize=1)
def _store(kind: Any, get: Callable[[Any], Any]) -> Any:
    return get(kind)


def sealed(folder: Path, manifest: dict[str, Any]) -> None:
    """Write the manifest with fresh hashes of all files."""
    from ssm_planner.publishing import file_hashes

    (folder / "manifest.json").unlink(missing_ok=True)
    text = json.dumps({**manifest, "files": file_hashes(folder)})
    (folder / "manifest.json").write_text(text)


def manifest_of(case: Case, kind: str, duration: float, entries: dict[str, Any]) -> dict[str, Any]:
    from ssm_planner.problem import robot_hash
    from ssm_planner.publishing import EXPORT_FORMAT, MANIFEST_VERSION

    return {
        "format": EXPORT_FORMAT,
        "version": MANIFEST_VERSION,
        "kind": kind,
        "verified": True,
        "robot": {"name": case.robot.name, "sha256": robot_hash(case.robot)},
        "plan": {"duration_s": duration},
        "stretch": 1.0,
        **entries,
    }


def emptied(folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    for file in folder.iterdir():
        file.unlink()
    return folder


def write_epos4_folder(case: Case, motion: Motion, genes: Genes, folder: Path) -> Written:
    """Write streams of positions with the offsets of the motion, and a matching manifest."""
    from ssm_planner.formats import epos4
    from ssm_planner.formats.epos4_setup import drive_axes
    from ssm_planner.problem import TaskLimits
    from ssm_planner.trajectory import Trajectory

    gene = next((gene for gene in genes if gene.kind == "times"), None)
    period = 10 if gene is None else round(log(gene.u[1], 4, 60))
    period = max(period, int(np.ceil(motion.breaks[-1] * 1000 / MOST_ROWS)))
    axes = drive_axes(case.robot, case.counts)
    plan: Any = SimpleNamespace(robot=case.robot, motion=Trajectory(*motion, ()))
    t, stretched = epos4.setpoint_times(plan, period)
    moved = epos4._sample_motors(plan, t, stretched)
    table = Table(t, moved["q"], np.zeros_like(moved["q"]), np.zeros_like(moved["q"]))
    for gene in genes:
        if gene.kind in ("bump", "digits", "swap"):
            change = TABLE_GENES[gene.kind]
            assert change is not None
            table = change(case, table, gene.u)
    q = table.q
    points = epos4.Setpoints(
        robot=case.robot,
        axes=axes,
        mode="csp",
        period=period,
        q=q,
        streams=epos4._integer_streams(axes, {**moved, "q": q}, "csp"),
        limits=TaskLimits(),
    )
    target = emptied(folder / "epos4")
    entries = points.content("").write(target)
    duration = float(np.arange(len(t))[-1] * (period / 1000))
    sealed(target, manifest_of(case, "epos4", duration, entries))
    more: dict[oracle.Key, float] = {}
    for i, joint in enumerate(case.robot.joints):
        if joint.name in axes:
            unit = joint.drive.ratio * case.counts / (2 * np.pi) * joint.motor_direction
            counts, _, permille = points.streams[joint.name].values()
            q[:, i] = counts / unit
            torque = (np.abs(permille).max() - 0.5) / 1000 * joint.motor.nominal_torque
            more["motor torque", joint.name] = float(torque / joint.motor.max_torque - 1)
    played = oracle.through(np.arange(len(t)) * (period / 1000), q)
    return target, played, more


def _same() -> np.random.Generator:
    """Return a generator with a fixed seed for the times of a healthy file."""
    return np.random.default_rng(3)


def write_pvt_folder(case: Case, motion: Motion, genes: Genes, folder: Path) -> Written:
    """Write rows in whole milliseconds and increments, and a matching manifest."""
    from ssm_planner.formats import pvt
    from ssm_planner.formats.epos4_setup import drive_axes
    from ssm_planner.problem import TaskLimits

    axes = drive_axes(case.robot, case.counts)
    gene = next((gene for gene in genes if gene.kind == "times"), random_gene("times", _same()))
    last, interval = float(motion.breaks[-1] * 1000), log(gene.u[1], 15, 200)
    ms = np.linspace(0, np.ceil(last), max(int(last / interval), 2) + 1)
    jitter = np.random.default_rng(int(gene.u[3] * 1e6)).uniform(-0.4, 0.4, len(ms)) * interval
    ms[1:-1] += jitter[1:-1] * (gene.u[2] if gene.u[5] < 0.5 else 0.0)
    ms = np.unique(np.round(ms).astype(int))
    if len(ms) < 3 or np.diff(ms).max() > pvt.LARGEST_ROW_MS:
        return None
    t = ms / 1000
    rows = state_of(motion, np.minimum(t, motion.breaks[-1]))
    rows.qd[-1] = 0.0
    for gene in genes:
        if gene.kind in ("bump", "digits", "swap"):
            change = TABLE_GENES[gene.kind]
            assert change is not None
            rows = change(case, rows, gene.u)
    state, tables = [rows.q.copy(), rows.qd.copy()], {}
    for i, joint in enumerate(case.robot.joints):
        values = [rows.q[:, i], rows.qd[:, i]]
        if joint.name in axes:
            unit = joint.drive.ratio * case.counts / (2 * np.pi) * joint.motor_direction
            values = [np.round(x * unit) + 0.0 for x in values]
            for order in range(2):
                state[order][:, i] = values[order] / unit
        tables[joint.name] = values[0], values[1]
    target = emptied(folder / "pvt")
    content = pvt.pvt_content(case.robot, axes, t, tables, limits=TaskLimits(), suffix="")
    entries = content.write(target)
    sealed(
        target,
        manifest_of(case, "pvt", float(np.cumsum(np.diff(ms, prepend=0))[-1] / 1000), entries),
    )
    played = oracle.through(np.cumsum(np.diff(ms, prepend=0)) / 1000, *state)
    return target, played, {}


FORMS: dict[str, Callable[[Case, Motion, Genes, Path], Written]] = {
    "plan": write_plan_file,
    "csv": write_csv_file,
    "yaml": write_yaml_file,
    "bag": write_bag_file,
    "epos4": write_epos4_folder,
    "pvt": write_pvt_folder,
}
