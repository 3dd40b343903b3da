"""Verify the search among the candidates for a phase.

The class `Halfway` is the additional candidate that docs/architecture.md shows.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from ssm_planner.pipeline.run import plan
from ssm_planner.planning.candidates import listed
from ssm_planner.planning.candidates.candidate import (
    Candidate,
    Evaluation,
    PhaseCandidate,
    PhaseEvaluation,
)
from ssm_planner.planning.ocp.motion import Borders
from ssm_planner.planning.phase_planner import PhasePlanner
from ssm_planner.planning.planned_phase import PlannedPhase
from ssm_planner.planning.reason import Reason, short_duration_reason
from ssm_planner.planning.search import GAP, find_fastest
from ssm_planner.planning.work import Work
from ssm_planner.problem.limits import TipSpeed
from ssm_planner.problem.motion import Free, Task
from ssm_planner.problem.problem import Problem


class Halfway(PhaseCandidate):
    """A motion through the middle between both ends, where every joint may reverse."""

    kind: ClassVar[str] = "halfway"

    @classmethod
    def suggested(
        cls, planner: PhasePlanner, latest: PhaseEvaluation | None
    ) -> Iterator[PhaseCandidate]:
        """Yield the candidate if the direct motion was estimated or found."""
        if latest is None or latest.candidate.kind != "direct" or latest.failed is not None:
            return
        first_result = latest.estimate is None or latest.result is None
        if first_result and planner.phase.path is None and len(planner.phase.points) == 2:
            yield cls(planner)

    def solution(self, cutoff: float, estimate: PlannedPhase | None) -> PlannedPhase | Reason:
        """Return the motion."""
        first, last = self.planner.phase.points
        middle = Borders(np.stack([first, (first + last) / 2, last]), (1,))
        return self.planner.free(middle, cutoff=cutoff)


def swing(problem: Problem) -> Problem:
    """Return a problem with one free motion."""
    motion = (Free(Task(roll=0.2, tilt=np.radians(-110), depth=0.01)),)
    return replace(problem, motion=motion, objective="time", planner="fast")


def test_a_new_way_to_move_is_a_class_and_a_line(tilt_insert: Problem) -> None:
    """A new kind of candidate needs only a class and an entry in a list."""
    listed.CANDIDATE_KINDS.append(Halfway)
    try:
        made = plan(swing(tilt_insert))
    finally:
        listed.CANDIDATE_KINDS.remove(Halfway)
    assert made.passed
    text = (Path(__file__).parents[2] / "docs/architecture.md").read_text("utf-8")
    assert inspect.getsource(Halfway) in text
    assert "halfway" in [each["kind"] for each in made.candidates[0]]


def test_every_plan_lists_its_candidates_and_takes_the_shortest(tilt_insert: Problem) -> None:
    made = plan(swing(tilt_insert))
    (candidates,) = made.candidates
    assert candidates[0]["kind"] == "direct"
    taken = [each for each in candidates if each["outcome"] == "taken"]
    assert len(taken) == 1
    for each in candidates:
        known = [each[name] for name in ("bound", "estimate", "duration") if each[name] is not None]
        others = each["duration"] is not None or str(each["outcome"]).startswith("slower")
        if others:
            assert max(known) >= (1 - GAP) * taken[0]["duration"]
    assert made.summary()["candidates"][0] == [dict(each) for each in candidates]


class Failing(Candidate[list[Reason], PlannedPhase]):
    """A candidate that fails for a given reason. The planner is the list of all reasons."""

    kind: ClassVar[str] = "failing"
    bound = 0.0

    def __init__(self, reason: Reason) -> None:
        self.reason = reason

    @classmethod
    def suggested(
        cls, planner: list[Reason], latest: Evaluation[list[Reason], PlannedPhase] | None
    ) -> Iterator[Failing]:
        """Yield one candidate for each reason at the beginning."""
        if latest is None:
            yield from map(cls, planner)

    def solution(self, cutoff: float, estimate: PlannedPhase | None) -> Reason:
        """Return the reason."""
        return self.reason


def test_without_a_motion_the_reason_asks_for_the_smallest_change() -> None:
    """Of several candidates that exceed the same limit, the one that exceeds it least counts."""
    reasons = [
        Reason(message="no limit is named"),
        short_duration_reason("free", 3.0, 6.0),
        Reason(TipSpeed(1.0), None, 1.1, 1.0, "another limit"),
        short_duration_reason("free", 3.0, 5.5),
    ]
    result, evaluations = find_fastest([Failing], reasons, Work())
    assert result is reasons[3]
    assert len(evaluations) == 4
