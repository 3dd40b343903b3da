"""Base class of all candidates, and the record of how far a candidate was computed.

A candidate is one way to move a phase, or the whole problem. To add one for phases, derive a class
from `PhaseCandidate` in a new file and add it to `listed.CANDIDATE_KINDS`. The class says when it
is worth trying (`suggested`), which duration it cannot beat (`bound`), how long it takes approximately
(`estimate`) and which motion it gives (`solution`). The search calls these methods in this order
and stops as soon as another candidate is known to be faster.
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
    """A motion with a duration."""

    @property
    def duration(self) -> float:
        """Duration, s."""


CandidateEntry = dict[str, str | float | None]
"""Entry of `candidates` in plan.json."""
P = TypeVar("P")
R = TypeVar("R", bound=Timed)


@record
class Candidate(ABC, Generic[P, R]):
    """One way to move. P is the class of its planner, and R the class of its motions."""

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
        solution.

        Parameters
        ----------
        planner : P
            The task and its solvers.
        latest : Evaluation or None
            The latest evaluation. None at the beginning.
        """

    @property
    @abstractmethod
    def bound(self) -> float:
        """Duration that no motion of this candidate can beat, s."""

    def estimate(self, cutoff: float) -> R | Reason | None:
        """Return an approximate motion, or None if the solution would be as cheap.

        A motion that takes `cutoff` seconds or longer is of no use, so the solver may give up on
        it.
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
            The motion that `estimate` returned.
        """


@dataclass(eq=False)
class Evaluation(Generic[P, R]):
    """A candidate, how far it was computed, and the result."""

    candidate: Candidate[P, R]
    bound: float
    """Lower bound of the duration, s."""
    estimate: R | None = None
    """Approximate motion, if the candidate estimates it."""
    result: R | Reason | None = None
    """Final result. None if another candidate is faster than the bound or the estimate of this one.
    """
    effort: float = 0.0
    """Work spent on the candidate, approximately in seconds."""

    @property
    def known_duration(self) -> float:
        """Smallest possible duration: the estimate if there is one, else the bound, s."""
        return self.bound if self.estimate is None else max(self.estimate.duration, self.bound)

    @property
    def failed(self) -> Reason | None:
        """Reason why there is no motion.

        None if there is one, or if the candidate was not solved.
        """
        return self.result if isinstance(self.result, Reason) else None

    def advance(self, cutoff: float) -> None:
        """Compute the next result: the estimate first, then the solution."""
        estimate = None if self.estimate is not None else self.candidate.estimate(cutoff)
        if estimate is None:
            self.result = self.candidate.solution(cutoff, self.estimate)
        elif isinstance(estimate, Reason):
            self.result = estimate
        else:
            self.estimate = estimate

    def to_dict(self, solution: R | Reason) -> CandidateEntry:
        """Return the entry of `candidates` in plan.json.

        `solution` is the result of the whole search.
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
    """One way to move a phase."""

    @property
    def bound(self) -> float:
        """Duration that no motion between the ends of the phase can beat, s."""
        return self.planner.phase.lower_bound


PhaseEvaluation = Evaluation[PhasePlanner, PlannedPhase]


class FallbackCandidate(PhaseCandidate):
    """A candidate that the failure of the direct motion may suggest."""

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
        """Yield the candidates, in view of the reason why there is no direct motion."""
