"""The base class of all candidates, and `Evaluation`, which records the results of a candidate.

A phase is one entry of the motion list of a problem. A candidate is one way to move a phase, or the
whole problem, for example directly or in two parts. To add one for phases, derive a class from
`PhaseCandidate` in a new file and add it to `listed.CANDIDATE_KINDS`. The class says

- when the candidate is worth trying (`suggested`),
- which duration its motion cannot beat (`bound`),
- how long its motion takes approximately (`estimate`, optional),
- and which motion it gives (`solution`).

The search (`search.find_fastest`) uses these members in this order. It stops the work on a
candidate as soon as another one is known to be faster. If a kind serves only where the direct
motion was not found, derive its class from `FallbackCandidate` instead.
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
    """A motion whose duration the search compares: that of a phase or of a whole problem."""

    @property
    def duration(self) -> float:
        """Duration, s."""


CandidateEntry = dict[str, str | float | None]
"""Entry of `candidates` in plan.json."""
P = TypeVar("P")
"""Class that holds what is to be planned, with the solvers for it."""
R = TypeVar("R", bound=Timed)
"""Class of the motions that the search compares."""


@record
class Candidate(ABC, Generic[P, R]):
    """One way to move, with a lower bound of its duration, an optional estimate, and a solution.

    P is the class of its planner, which is `PhasePlanner` for a phase (an entry of the motion list)
    and `JointsPlanner` for a whole problem. R is the class of its motions, which is `PlannedPhase`
    or `MissionMotion`.
    """

    planner: P
    """The phase or problem to be planned, with its solvers."""

    kind: ClassVar[str]
    """Name of the kind of candidate in reports and in plan.json."""

    @classmethod
    @abstractmethod
    def suggested(
        cls, planner: P, latest: "Evaluation[P, R] | None"
    ) -> "Iterator[Candidate[P, R]]":
        """Yield the candidates (ways to move) of this kind that are worth trying next.

        The search calls this method once at the beginning, and again whenever it has estimated or
        solved a candidate of any kind. The method must yield each candidate only once.

        Parameters
        ----------
        planner : P
            The phase or problem to be planned, with its solvers.
        latest : Evaluation or None
            The candidate (way to move) that the search has just estimated or solved, with its
            result. None at the beginning.

        Yields
        ------
        Candidate
            A candidate that the search shall consider from now on.
        """

    @property
    @abstractmethod
    def bound(self) -> float:
        """Duration that no motion of this candidate (way to move) can beat, s."""

    def estimate(self, cutoff: float) -> R | Reason | None:
        """Return an approximate motion of this candidate (way to move), or None for no estimate.

        A kind can omit the estimate if computing the solution at once takes no more work.

        Parameters
        ----------
        cutoff : float
            Duration in s. A motion that takes at least as long is of no use, so the solver may give
            up on it.

        Returns
        -------
        R, Reason or None
            The approximate motion, whose duration decides whether the candidate is solved. A
            reason states why the candidate fails. None: the search computes the solution
            at once.
        """
        return None

    @abstractmethod
    def solution(self, cutoff: float, estimate: R | None) -> R | Reason:
        """Return the motion of this candidate (way to move), or the reason why none was found.

        Parameters
        ----------
        cutoff : float
            Duration in s. A motion that takes at least as long is of no use, so the solver may give
            up on it.
        estimate : R or None
            The motion that the method `estimate` returned.

        Returns
        -------
        R or Reason
            The motion, or the reason why planning failed.
        """


@dataclass(eq=False)
class Evaluation(Generic[P, R]):
    """The state of a candidate (one way to move) in the search: its results and work so far.

    The search computes a candidate in steps. It begins with a lower bound of the duration, goes on
    to an estimate (an approximate motion), and ends with the solution. It skips the remaining steps
    if another candidate is faster.
    """

    candidate: Candidate[P, R]
    bound: float
    """Lower bound of the duration, s."""
    estimate: R | None = None
    """Approximate motion, if the candidate estimates it."""
    result: R | Reason | None = None
    """The solution, or the reason why planning failed. None until the candidate is solved.

    It remains None if another motion is shorter than the bound or the estimate of this candidate.
    """
    effort: float = 0.0
    """Work spent on the candidate (`Work`), approximately in seconds."""

    @property
    def known_duration(self) -> float:
        """Duration by which the search orders candidates (ways to move), s.

        It is the duration of the estimate, or the lower bound if that is larger or if there is no
        estimate yet.
        """
        return self.bound if self.estimate is None else max(self.estimate.duration, self.bound)

    @property
    def failed(self) -> Reason | None:
        """Reason why the candidate (way to move) fails.

        None if the candidate gives a motion, or if it was not solved.
        """
        return self.result if isinstance(self.result, Reason) else None

    def advance(self, cutoff: float) -> None:
        """Compute the next step of the candidate (way to move), an estimate or the solution.

        The first call computes the estimate and stores it in `estimate`. The second call computes
        the solution and stores it in `result`. If this kind of candidate is solved without
        an estimate, the first call computes the solution.

        Parameters
        ----------
        cutoff : float
            Duration in s. A motion that takes at least as long is of no use.
        """
        estimate = None if self.estimate is not None else self.candidate.estimate(cutoff)
        if estimate is None:
            self.result = self.candidate.solution(cutoff, self.estimate)
        elif isinstance(estimate, Reason):
            self.result = estimate
        else:
            self.estimate = estimate

    def to_dict(self, solution: R | Reason) -> CandidateEntry:
        """Return the entry of the candidate (way to move) in plan.json, with its outcome.

        Parameters
        ----------
        solution : R or Reason
            The result of the whole search, over all candidates.

        Returns
        -------
        dict
            The key `outcome` has the value "taken", "slower", "slower by its bound" or "slower by
            its estimate", or the message of the reason why the candidate fails. The
            other keys are `kind`, `bound`, `estimate` and `duration` (all three in s), and
            `effort`, the work spent. `estimate` and `duration` are None if they were not computed.
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
    """One way to move a phase, that is, an entry of the motion list of a problem.

    To add a kind, derive from this class, and define `kind`, `suggested` and `solution`.
    """

    @property
    def bound(self) -> float:
        """Duration that no motion of the phase (entry of the motion list) can beat, s."""
        return self.planner.phase.lower_bound


PhaseEvaluation = Evaluation[PhasePlanner, PlannedPhase]
"""State of a candidate for the motion of a phase in the search."""


class FallbackCandidate(PhaseCandidate):
    """A way to move a phase that serves if the direct motion was not found.

    The direct motion follows the given path, or is free with no more reversals than necessary. To
    add a kind of this class, derive from it, and define `kind`, `suggested_after_failure` and
    `solution`.
    """

    @classmethod
    def suggested(
        cls, planner: PhasePlanner, latest: PhaseEvaluation | None
    ) -> Iterator[PhaseCandidate]:
        """Yield the candidates of `suggested_after_failure` when the direct motion has failed.

        Parameters
        ----------
        planner : PhasePlanner
            The phase (an entry of the motion list with its joint positions) and its solvers.
        latest : Evaluation or None
            The candidate (way to move) that the search has just estimated or solved, with its
            result. None at the beginning.

        Yields
        ------
        PhaseCandidate
            Candidates, only right after the failure of the direct motion.
        """
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
            Reason why the direct motion was not found. The limit that it names tells whether this
            kind of candidate can help.

        Yields
        ------
        PhaseCandidate
            A candidate that the search shall consider.
        """
