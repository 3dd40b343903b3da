"""Base class of all candidates, and the record of how far a candidate was computed.

A phase is one entry of the motion list of a problem. A candidate is one way to move a phase, or the
whole problem, for example directly or in two parts. To add one for phases, derive a class from
`PhaseCandidate` in a new file and add it to `listed.CANDIDATE_KINDS`. The class says

- when the candidate is worth trying (`suggested`),
- which duration it cannot beat (`bound`),
- how long it takes approximately (`estimate`, optional),
- and which motion it gives (`solution`).

The search (`search.find_fastest`) uses these members in this order, and stops as soon as another
candidate is known to be faster. A class whose motion only replaces a direct motion that was not
found derives from `FallbackCandidate` instead.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Generic, Protocol, TypeVar

from ssm_planner.planning.phase_planner import PhasePlanner
from ssm_planner.planning.planned_phase import PlannedPhase
from ssm_planner.planning.reason import Reason
from ssm_planner.typing import record


class Timed(Protocol):
    """A result whose durations the search compares: a phase or a whole mission with its motion."""

    @property
    def duration(self) -> float:
        """Duration, s."""


CandidateEntry = dict[str, str | float | None]
"""Entry of `candidates` in plan.json."""
P = TypeVar("P")
"""Class of the planner: the task of the search with its solvers."""
R = TypeVar("R", bound=Timed)
"""Class of the motions that the search compares."""


@record
class Candidate(ABC, Generic[P, R]):
    """One way to move, with a lower bound, an optional estimate, and a solution.

    P is the class of its planner: `PhasePlanner` for a phase, `JointsPlanner` for a whole problem.
    R is the class of its motions: `PlannedPhase` or `MissionMotion`.
    """

    planner: P
    """The task and its solvers."""

    kind: ClassVar[str]
    """Name of the kind of candidate in reports and in plan.json."""

    @classmethod
    @abstractmethod
    def suggested(
        cls, planner: P, latest: "Evaluation[P, R] | None"
    ) -> "Iterator[Candidate[P, R]]":
        """Yield the candidates that the latest evaluation suggests.

        The search calls this method once at the beginning, and again after each estimate and each
        solution of any kind. The method must therefore yield the same candidate only once.

        Parameters
        ----------
        planner : P
            The task and its solvers.
        latest : Evaluation or None
            The candidate that the search has just estimated or solved, with its result. None at the
            beginning.
        """

    @property
    @abstractmethod
    def bound(self) -> float:
        """Duration that no motion of this candidate can beat, s."""

    def estimate(self, cutoff: float) -> R | Reason | None:
        """Return an approximate motion, or None if the solution would be as cheap.

        Parameters
        ----------
        cutoff : float
            Duration in s from which on a motion is of no use. The solver may give up on it.

        Returns
        -------
        R, Reason or None
            The approximate motion, whose duration decides whether the candidate is solved. A
            reason ends the candidate. None: the search goes on to the solution.
        """
        return None

    @abstractmethod
    def solution(self, cutoff: float, estimate: R | None) -> R | Reason:
        """Return the motion of this candidate, or the reason why none was found.

        Parameters
        ----------
        cutoff : float
            Duration in s from which on a motion is of no use.
        estimate : R or None
            The motion that the method `estimate` returned.
        """


@dataclass(eq=False)
class Evaluation(Generic[P, R]):
    """A candidate (way to move) during the search, with its bound, estimate, result and work.

    The search computes a candidate in steps, from its lower bound to an estimate (an approximate
    motion), and from there to its solution. It stops as soon as another candidate is faster.
    """

    candidate: Candidate[P, R]
    bound: float
    """Lower bound of the duration, s."""
    estimate: R | None = None
    """Approximate motion, if the candidate estimates it."""
    result: R | Reason | None = None
    """Solution, or the reason why there is none. None while the candidate is not solved.

    It remains None if another motion is faster than the bound or the estimate of this candidate.
    """
    effort: float = 0.0
    """Work spent on the candidate (`Work`), approximately in seconds."""

    @property
    def known_duration(self) -> float:
        """Duration by which the search orders candidates, s: the estimate, or else the bound."""
        return self.bound if self.estimate is None else max(self.estimate.duration, self.bound)

    @property
    def failed(self) -> Reason | None:
        """Reason why the candidate gives no motion.

        None if the candidate gives a motion, or if it was not solved.
        """
        return self.result if isinstance(self.result, Reason) else None

    def advance(self, cutoff: float) -> None:
        """Compute the estimate if there is none yet, or else the solution.

        If the candidate has no estimate, the solution follows at once.

        Parameters
        ----------
        cutoff : float
            Duration in s from which on a motion is of no use.
        """
        estimate = None if self.estimate is not None else self.candidate.estimate(cutoff)
        if estimate is None:
            self.result = self.candidate.solution(cutoff, self.estimate)
        elif isinstance(estimate, Reason):
            self.result = estimate
        else:
            self.estimate = estimate

    def to_dict(self, solution: R | Reason) -> CandidateEntry:
        """Return the entry of the candidate in plan.json, which states why it was taken or not.

        Parameters
        ----------
        solution : R or Reason
            The result of the whole search.

        Returns
        -------
        dict
            Kind, lower bound, estimate and duration (s) of the candidate, the outcome in words
            ("taken", "slower", "slower by its bound", "slower by its estimate", or the message of a
            reason), and the work spent on it.
        """
        duration = None
        if self.result is None:
            outcome = "slower by its bound" if self.estimate is None else "slower by its estimate"
        elif isinstance(self.result, Reason):
            outcome = self.result.message
        else:
            outcome = "taken" if solution is self.result else "slower"
            duration = self.result.duration
        estimate = None if self.estimate is None else self.estimate.duration
        return {
            "kind": self.candidate.kind,
            "bound": self.bound,
            "estimate": estimate,
            "outcome": outcome,
            "duration": duration,
            "effort": self.effort,
        }


class PhaseCandidate(Candidate[PhasePlanner, PlannedPhase]):
    """One way to move a phase (entry of the motion list). Its motions are `PlannedPhase` values.

    Derive from this class to add a kind, and define `kind`, `suggested` and `solution`.
    """

    @property
    def bound(self) -> float:
        """Duration that no motion between the ends of the phase can beat, s."""
        return self.planner.phase.lower_bound


PhaseEvaluation = Evaluation[PhasePlanner, PlannedPhase]


class FallbackCandidate(PhaseCandidate):
    """A candidate that replaces the direct motion if that was not found.

    Derive from this class to add such a kind, and define `kind`, `suggested_after_failure` and
    `solution`.
    """

    @classmethod
    def suggested(
        cls, planner: PhasePlanner, latest: PhaseEvaluation | None
    ) -> Iterator[PhaseCandidate]:
        """Yield the candidates of `suggested_after_failure` after the direct motion has failed."""
        if latest is not None and latest.candidate.kind == "direct" and latest.failed is not None:
            yield from cls.suggested_after_failure(planner, latest.failed)

    @classmethod
    @abstractmethod
    def suggested_after_failure(
        cls, planner: PhasePlanner, reason: Reason
    ) -> Iterator[PhaseCandidate]:
        """Yield the candidates that may succeed where the direct motion failed.

        Parameters
        ----------
        planner : PhasePlanner
            The phase (an entry of the motion list with its joint positions) and its solvers.
        reason : Reason
            Reason why the direct motion was not found. Its limit decides whether a kind can help.
        """
