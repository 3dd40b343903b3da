"""Solve, look between the collocation points on the true path, tighten or add what was found exceeded, solve again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ssm_planner.planning.course import Answer, Question, Shape
from ssm_planner.planning.program import Aim, Program, RowName, Stage, point_of
from ssm_planner.problem.values import Array, Objective

NEAR = 0.85
"""A row that stays below this share of its limit in the guess is left out until it is found exceeded."""
EXCESS = 2e-7
"""Where a row exceeds its limit between collocation points by more than this share, its element is tightened."""
BACKOFF = 1.2
"""Tightening per excess found."""
ROUNDS = 12
LONGER = 1e-3
"""By how much the motion of least heat may be longer than the fastest."""


class Task(Protocol):
    """An optimal control problem in the form that `optimise` takes."""

    @property
    def shape(self) -> Shape: ...

    @property
    def names(self) -> list[RowName]:
        """All rows that its stage can have."""

    @property
    def always(self) -> frozenset[RowName]:
        """Rows that a guess says nothing about."""

    def stage(self, kept: frozenset[RowName], aim: Aim) -> Stage: ...

    def question(self, elements: Array, slack: Array) -> Question:
        """The program's numbers near these elements; slack (n, rows kept)."""

    def largest(self, elements: Array) -> Array:
        """Largest value of every row in every element, (n, all rows)."""


@dataclass(frozen=True, eq=False)
class Start:
    """A guess: states (n, 4 m), times (k,), lengths of the elements (n,), in scaled time."""

    states: Array
    times: Array
    lengths: Array

    @property
    def elements(self) -> Array:
        return np.column_stack([self.states, self.lengths])

    def stretched(self, factor: float) -> Start:
        """The same motion in `factor` times its time."""
        m = self.states.shape[1] // 4
        orders = np.repeat([0, 1, 2, 2], m)
        return Start(self.states / factor**orders, self.times * factor, self.lengths * factor)


def optimise(task: Task, start: Start, objective: Objective, duration: float | None = None) -> Answer:
    """The fastest motion; for "time then heat" the one of least heat among those hardly longer.

    duration: asked for, in scaled time; then the motion of least effort that takes it, or the fastest if that is longer.
    """
    fastest = _rounds(task, start, "time")
    total = float(fastest.times.sum())
    if not fastest.solved or (objective == "time" and duration is None) or (duration is not None and duration < total):
        return fastest
    m = task.shape.coordinates
    begin = Start(fastest.elements[:, : 4 * m], fastest.times, fastest.elements[:, 4 * m])
    if duration is None:
        least = _rounds(task, begin, "heat", (0.0, (1 + LONGER) * total))
        if not least.solved:
            return fastest
    else:
        least = _rounds(task, begin.stretched(duration / total), "effort", (duration, duration))
    return Answer(least.message, least.elements, least.times, fastest.iterations + least.iterations, least.point)


def _rounds(task: Task, start: Start, aim: Aim, time: tuple[float, float] | None = None) -> Answer:
    """time: bounds of the duration, where it is not the aim."""
    names = task.names
    elements = start.elements
    largest = task.largest(elements)
    near = largest.max(axis=0, initial=0.0) > NEAR
    kept = task.always | {name for name, is_near in zip(names, near, strict=True) if is_near}
    slack = np.zeros_like(largest)

    def question(elements: Array, slack: Array) -> Question:
        asked = task.question(elements, slack)
        return asked if time is None else asked.within(time)

    begin = point_of(start.states, start.times)
    iterations = 0
    for rounds in range(1, ROUNDS + 1):
        program = Program.of(task.shape, task.stage(kept, aim))
        shown = [name in kept for name in names]
        answer = program.solve(question(elements, slack[:, shown]), begin)
        iterations += answer.iterations
        elements = answer.elements
        if not answer.solved:
            break
        excess = task.largest(elements) - 1
        worst = excess.max(axis=0, initial=-1.0)
        if worst.max(initial=-1.0) <= EXCESS or rounds == ROUNDS:
            break
        missed = frozenset(name for name, value in zip(names, worst, strict=True) if value > EXCESS) - kept
        if missed:
            kept, begin = kept | missed, {"x0": answer.point["x0"]}
        else:
            slack = slack + rounds**0.5 * tightening(excess)
            begin = answer.point
    return Answer(answer.message, elements, answer.times, iterations, answer.point)


def tightening(excess: Array) -> Array:
    """By how much to lower rows that were found exceeded between the collocation points."""
    return np.asarray(np.where(excess > 0, BACKOFF * excess + EXCESS, 0.0))
