"""Largest value between samples, by parabolas.

Solve, look between the collocation points on the true path, tighten or add what was found exceeded, solve again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ssm_planner.planning.ocp.nlp import NlpData, NlpSolution, NlpStructure, split
from ssm_planner.planning.ocp.transcription import Aim, ElementModel, RowName, Transcription, point_of
from ssm_planner.problem.problem import Objective
from ssm_planner.typing import Array


def parabolic_peak(values: Array) -> Array:
    """Largest value over the last axis (evenly spaced samples, at least 3) of the parabolas through the largest one.

    Returns an array without the last axis; never less than the largest sample.
    """
    last = values.shape[-1] - 1
    best = np.argmax(values, axis=-1)[..., None]
    middle = np.clip(best, 1, last - 1)
    left, here, right = (np.take_along_axis(values, middle + k, axis=-1) for k in (-1, 0, 1))
    slope, bend = (right - left) / 2, right - 2 * here + left
    with np.errstate(divide="ignore", invalid="ignore"):
        where = np.clip(np.nan_to_num(-slope / bend), -1.0, 1.0)
    vertex = here + where * (slope + where * bend / 2)
    return np.maximum(values.max(axis=-1), vertex[..., 0])


NEAR = 0.8
"""A row that stays below this share of its limit in the guess is left out until it is found exceeded."""
EXCESS = 5e-7
"""Where a row exceeds its limit between collocation points by more than this share, its element is tightened."""
ROUGH = 4e-3
"""Where it does so by more than this, the element is cut instead."""
ASTRAY = 1.0
"""Where a row that was left out is exceeded by more than this, the answer is no guess: the first one is taken again."""
PARTS = 3
CUTS = 2
"""Rounds that may cut elements; they start cold."""
MOST_ELEMENTS = 3
"""Times their first number."""
BACKOFF = 2.0
"""Tightening per excess found."""
BESIDE, REACH = 0.4, 6
"""Share of an element's tightening that its neighbours get, and so on from one to the next for so many elements."""
LITTLE = 2e-3
"""Tightening beyond which neighbours get no more: there the elements are too long, which is a matter of one element."""
SHORTEST = 0.2
"""Least time of a block, as a share of the guess's."""
ROUNDS = 12
HEAT_ROUNDS = 4
"""The fastest motion is a good one already: what takes longer to cool it is not worth the wait."""
HOPELESS = 1.01
"""Times the duration asked for: where the fastest motion takes longer, it is not worked out to the last digit."""
LONGER = 1e-3
"""By how much the motion of least heat may be longer than the fastest."""


class Task(Protocol):
    """An optimal control problem in the form that `optimise` takes."""

    @property
    def shape(self) -> NlpStructure: ...

    @property
    def names(self) -> list[RowName]:
        """All rows that its stage can have."""

    @property
    def always(self) -> frozenset[RowName]:
        """Rows that a guess says nothing about."""

    def stage(self, kept: frozenset[RowName], aim: Aim) -> ElementModel: ...

    def question(self, elements: Array, backoff: Array) -> NlpData:
        """The program's numbers near these elements; backoff (n, rows kept)."""

    def largest(self, elements: Array) -> Array:
        """Largest value of every row in every element, (n, all rows)."""

    def refined(self, chosen: Array) -> Task:
        """The same problem with the chosen elements (n,) cut into PARTS."""


@dataclass(frozen=True, eq=False)
class Start:
    """A guess: states (n, 4 m), times (b,), lengths of the elements (n,), in scaled time."""

    states: Array
    times: Array
    lengths: Array

    @classmethod
    def at(cls, answer: NlpSolution) -> Start:
        return cls(answer.elements[:, :-1], answer.times, answer.elements[:, -1])

    @property
    def elements(self) -> Array:
        return np.column_stack([self.states, self.lengths])

    def stretched(self, factor: float) -> Start:
        """The same motion in `factor` times its time."""
        m = self.states.shape[1] // 4
        orders = np.repeat([0, 1, 2, 2], m)
        return Start(self.states / factor**orders, self.times * factor, self.lengths * factor)


def optimise(task: Task, start: Start, objective: Objective, duration: float | None = None) -> NlpSolution:
    """The fastest motion; for "time then heat" the one of least heat among those hardly longer.

    duration: asked for, in scaled time; then the motion of least effort that takes it, or the fastest if that is longer.
    """
    fastest, found = _rounds(task, start, "time", hopeless=None if duration is None else HOPELESS * duration)
    total = float(fastest.times.sum())
    if not fastest.solved or (objective == "time" and duration is None) or (duration is not None and duration < total):
        return fastest
    begin = Start.at(fastest)
    if duration is None:
        least, last = _rounds(found.task, begin, "heat", (0.0, (1 + LONGER) * total), found)
        if not (least.solved and last.keeps):
            return fastest
    else:
        slow, exactly = begin.stretched(duration / total), (duration, duration)
        least, _ = _rounds(found.task, slow, "effort", exactly)
        if not least.solved:  # then any motion that takes as long
            least, _ = _rounds(found.task, slow, "time", exactly)
    return replace(least, iterations=fastest.iterations + least.iterations)


@dataclass(frozen=True, eq=False)
class _Found:
    """What an answer needed: the task on its mesh, the rows kept and by how much they were tightened."""

    task: Task
    kept: frozenset[RowName]
    backoff: Array
    keeps: bool
    """Nothing is exceeded between the collocation points."""


def _rounds(
    task: Task,
    start: Start,
    aim: Aim,
    time: tuple[float, float] | None = None,
    found: _Found | None = None,
    hopeless: float | None = None,
) -> tuple[NlpSolution, _Found]:
    """time: bounds of the duration, where it is not the aim; found: for a motion near this one.

    hopeless: a duration beyond which a motion is of no use, for tightening only makes it longer.
    """
    names = task.names
    elements = start.elements
    if found is None:
        near = task.largest(elements).max(axis=0, initial=0.0) > NEAR
        kept = task.always | {name for name, is_near in zip(names, near, strict=True) if is_near}
        backoff = np.zeros((len(elements), len(names)))
    else:
        kept, backoff = found.kept, found.backoff
    begin = point_of(start.states, start.times)
    most = MOST_ELEMENTS * len(elements)
    iterations, keeps = 0, False
    last = HEAT_ROUNDS if aim == "heat" else ROUNDS
    for rounds in range(1, last + 1):
        program = Transcription.of(task.shape, task.stage(kept, aim))
        question = task.question(elements, backoff[:, [name in kept for name in names]])
        answer = program.solve(question if time is None else question.within(time), begin)
        iterations += answer.iterations
        elements = answer.elements
        if not answer.solved or (hopeless is not None and answer.times.sum() > hopeless):
            break
        excess = task.largest(elements) - 1
        worst = excess.max(axis=0, initial=-1.0)
        keeps = bool(worst.max(initial=-1.0) <= EXCESS)
        if keeps or rounds == last:
            break
        missed = frozenset(name for name, value in zip(names, worst, strict=True) if value > EXCESS) - kept
        rough = excess.max(axis=1) > ROUGH
        if missed and worst.max() > ASTRAY and len(elements) == len(start.elements):
            kept, begin, elements = kept | missed, point_of(start.states, start.times), start.elements
        elif missed:
            kept, begin = kept | missed, {"x0": answer.point["x0"]}
        elif aim != "heat" and rough.any() and rounds <= CUTS and len(elements) + (PARTS - 1) * rough.sum() <= most:
            task, elements = task.refined(rough), split(elements, rough, PARTS)
            backoff = np.repeat(backoff, np.where(rough, PARTS, 1), axis=0)
            begin = point_of(elements[:, :-1], answer.times)
        else:
            backoff = backoff + min(1.4 ** max(rounds - 2, 0), 3.0) * tightening(excess)
            begin = answer.point
    return replace(answer, iterations=iterations), _Found(task, kept, backoff, keeps)


def tightening(excess: Array) -> Array:
    """By how much to lower rows that were found exceeded between the collocation points."""
    own = np.where(excess > 0, BACKOFF * excess + EXCESS, 0.0)
    # what is pressed down in one element comes up beside it
    spread = np.minimum(own, LITTLE)
    for _ in range(min(REACH, len(own) - 1)):
        before, after = spread[:-1].copy(), spread[1:].copy()
        np.maximum(spread[1:], BESIDE * before, out=spread[1:])
        np.maximum(spread[:-1], BESIDE * after, out=spread[:-1])
    return np.asarray(np.maximum(own, spread))
