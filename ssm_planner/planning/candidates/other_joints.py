"""Motions that reach a target of a free motion with other joint positions than the nearest ones.

Several joint positions reach a target that is given in task coordinates (roll, tilt, spin, depth)
or as a position of the tip. They differ in whole turns of the revolute joints, and in the branch.
The inverse kinematics has two solutions, called the branches +1 and −1, which differ in the side to
which joint 2 is bent. If the problem leaves the spin (rotation of the tool about its own axis)
open, they also differ in the spin.

The planner takes the nearest joint positions on the present branch. Each candidate (way to move) of
this module takes other ones. All later targets are then reached with the nearest joints again, so a
candidate changes the motion of the whole problem. `pipeline/mission.py` runs the search.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics import task_from_joints
from ssm_planner.planning.candidates.candidate import Candidate, Evaluation
from ssm_planner.planning.feasibility import feasible_phases
from ssm_planner.planning.phases import Phase, alternative_joints
from ssm_planner.planning.planned_phase import PlannedPhase
from ssm_planner.planning.planner import estimated_duration
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.tolerances import GAP, ROUNDING_TOLERANCE
from ssm_planner.planning.work import Work
from ssm_planner.problem import Free, Joints, Motion, Problem, unchecked_copy
from ssm_planner.typing import Array, record

MAX_RESCUES = 3
"""Largest number of other joint positions that are planned if the nearest ones fail.

The search usually drops candidates that cannot be faster than the best motion. Without a motion,
only their number limits the work.
"""


@record
class MissionMotion:
    """The duration of the motion of a whole problem, with its phases if they are planned.

    A phase is an entry of the motion list with its joint positions.
    """

    duration: float
    """Duration, s."""
    phases: tuple[PlannedPhase, ...] = ()
    """Planned phases. Empty if the duration is only an estimate."""


@record
class JointsPlanner:
    """A target that several joint positions reach, and functions to plan the whole problem.

    `pipeline/mission.py` searches the fastest motion over these joint positions. The candidates
    (ways to move) of that search receive a value of this class.
    """

    problem: Problem
    """The problem that contains the target."""
    phases: tuple[Phase, ...]
    """Phases of the problem (entries of the motion list), with the nearest joint positions."""
    target: tuple[int, int]
    """Index of the free motion in the motion list, and index of the target in that motion.

    The targets of a motion are its via points and its end, in this order.
    """
    best: MissionMotion
    """Shortest motion so far that has passed the independent check.

    Without a motion, the duration is infinite.
    """
    plan: Callable[[Problem], MissionMotion | Reason]
    """Plans and checks a problem in which joint positions replace the target."""
    work: Work
    """Counter of the work of `plan`."""
    report: Callable[[], None]
    """Reports progress to the user. Each candidate calls it before it is estimated."""

    @property
    def motion(self) -> Free:
        """The free motion to the target."""
        motion = self.problem.motion[self.target[0]]
        assert isinstance(motion, Free)
        return motion

    @cached_property
    def phase(self) -> Phase:
        """The phase (entry of the motion list) that leads to the target."""
        return next(phase for phase in self.phases if phase.motion is self.motion)

    @property
    def spin_free(self) -> bool:
        """True if the planner may choose the spin (rotation about the tool axis) at the target.

        The problem file states it by `spin: free`. Only the end of a motion can have a free spin,
        not its via points.
        """
        return self.motion.spin_free and self.target[1] == len(self.motion.through)

    def joints(self) -> list[Array]:
        """Return all joint positions that reach the target, except those that the phase has.

        They differ in the branch of the inverse kinematics (+1 or −1) and in whole turns of the
        revolute joints. If the spin (rotation of the tool about its own axis) is free, each of them
        has the spin for which the lower bound of the duration is smallest.

        Returns
        -------
        list of (4,) arrays
            Joint positions, rad and m.
        """
        present = self.phase.points[-1]
        ends = alternative_joints(self.phase, self.target[1])
        if not self.spin_free:
            return ends
        ends = [self._with_best_spin(q) for q in [present, *ends]]
        return [q for q in ends if not np.array_equal(q, present)]

    def spin_alternatives(self, q: Array) -> tuple[Array, Array]:
        """Return joint positions that differ from given ones only in the spin, with lower bounds.

        Joint 3 rotates the tool about its own axis, so only its angle changes. In the first three
        rows, it has its angle in `q`, its angle at the start of the phase, and the angle at which
        it comes to a stop from its velocity there. The other rows divide one turn, half of it on
        either side of the start, into steps of two degrees. All angles are limited to the range of
        joint 3, and to the range of the spin.

        Parameters
        ----------
        q : (4,) array
            Joint positions at the target, rad and m.

        Returns
        -------
        joints : (n, 4) array
            Joint positions, rad and m.
        bounds : (n,) array
            Lower bounds on the durations of motions to them, s.
        """
        phase, problem = self.phase, self.problem
        low, high = problem.robot.joints[2].position
        start, speed = phase.q_start[2], phase.qd_start[2]
        # Index 2 of the task coordinates is the spin. A change of joint 3 changes it equally.
        spin = task_from_joints(phase.mechanism, q[None], near=phase.start)[0, 2]
        ends = problem.ranges.get("spin", (-np.inf, np.inf))
        if ends[1] - ends[0] < 2 * np.pi:
            low = max(low, q[2] + ends[0] - spin)
            high = min(high, q[2] + ends[1] - spin)
        # With the deceleration a, a joint with the velocity v stops after the distance v |v| / 2a.
        stop = start + speed * abs(speed) / (2 * problem.robot.joints[2].acceleration)
        # Each entry is an angle of joint 3, rad.
        turn = start + np.radians(np.arange(-180, 181, 2))
        values = np.clip([q[2], stop, *turn], low, high)
        configurations = np.tile(q, (len(values), 1))
        configurations[:, 2] = values
        tasks = task_from_joints(phase.mechanism, configurations, near=phase.start)
        bounds = [
            replace(phase, points=np.vstack([phase.points[:-1], joints]), end=task).lower_bound
            for joints, task in zip(configurations, tasks, strict=True)
        ]
        return configurations, np.array(bounds)

    def _with_best_spin(self, q: Array) -> Array:
        """Return the joint positions with the spin that has the smallest lower bound of duration.

        The spin is the rotation of the tool about its own axis. Of several spins with the same
        bound, the one nearest to that of `q` is taken.

        Parameters
        ----------
        q : (4,) array
            Joint positions at the target, rad and m.

        Returns
        -------
        (4,) array
            Joint positions that differ from `q` only in joint 3.
        """
        configurations, bounds = self.spin_alternatives(q)
        smallest = configurations[bounds <= bounds.min() * (1 + ROUNDING_TOLERANCE)]
        return np.asarray(smallest[np.argmin(np.abs(smallest[:, 2] - q[2]))])


@record
class OtherJoints(Candidate[JointsPlanner, MissionMotion]):
    """A candidate (way to move) that reaches one target with other joint positions."""

    problem: Problem
    """The problem in which these joint positions replace the target."""
    q: Array
    """The joint positions at the target, (4,), rad and m."""
    duration_bound: float
    """Lower bound of the duration of the whole problem, s."""
    only_spin_differs: bool = False
    """True if joint positions that differ from `q` only in the spin were tried before."""
    kind: ClassVar[str] = "other joints"

    @property
    def bound(self) -> float:
        """Duration of the whole problem that no motion with these joint positions can beat, s."""
        return self.duration_bound

    @classmethod
    def suggested(
        cls, planner: JointsPlanner, latest: Evaluation[JointsPlanner, MissionMotion] | None
    ) -> "Iterator[OtherJoints]":
        """Yield candidates at the beginning of the search, and more of them after each motion.

        Those at the beginning differ in the branch of the inverse kinematics and in whole turns. If
        the spin is free, each motion that passes the check suggests further spins.

        Parameters
        ----------
        planner : JointsPlanner
            The target and the planner of the problem.
        latest : Evaluation or None
            The candidate that the search has just estimated or solved, with its result. None at the
            beginning.

        Yields
        ------
        OtherJoints
            Candidates (ways to move). At the beginning, those with the smallest lower bounds come
            first.
        """
        if latest is not None:
            candidate, motion = latest.candidate, latest.result
            # Spins are not varied again around a candidate that is itself such a variation.
            if isinstance(candidate, OtherJoints) and not candidate.only_spin_differs:
                yield from cls._candidates_with_other_spins(planner, candidate.q, motion)
            return
        options = [
            option for q in planner.joints() for option in cls._feasible_candidate(planner, q)
        ]
        options.sort(key=lambda option: option.bound)
        if planner.best.duration == np.inf:
            yield from cls._rescues(planner, options)
            return
        yield from options
        yield from cls._candidates_with_other_spins(planner, planner.phase.points[-1], planner.best)

    @classmethod
    def _rescues(cls, planner: JointsPlanner, options: "list[OtherJoints]") -> "list[OtherJoints]":
        """Select a few candidates (ways to move) for a problem whose nearest joints have failed.

        Of candidates with the same positions of joints 1 and 2 (the same posture), only the one
        with the smallest lower bound is kept. The others differ in whole turns of joint 3, which do
        not change the load of the motors, so they would mostly fail for the same reason.

        Parameters
        ----------
        planner : JointsPlanner
            The target and the planner of the problem.
        options : list of OtherJoints
            All candidates, those with the smallest lower bounds first.

        Returns
        -------
        list of OtherJoints
            At most `MAX_RESCUES` candidates.
        """
        # Rounding to 1e-6 rad makes angles equal that differ only by rounding errors.
        postures: dict[tuple[float, ...], OtherJoints] = {}
        for option in options:
            postures.setdefault(tuple(option.q[:2].round(6)), option)
        # The posture of the nearest joint positions has failed. Another spin might still succeed.
        if not planner.spin_free:
            postures.pop(tuple(planner.phase.points[-1, :2].round(6)), None)
        return list(postures.values())[:MAX_RESCUES]

    @classmethod
    def _feasible_candidate(
        cls, planner: JointsPlanner, q: Array, *, only_spin_differs: bool = False
    ) -> "Iterator[OtherJoints]":
        """Yield the candidate with given joint positions if it may give a shorter motion.

        A candidate is one way to move the problem. Its lower bound is the sum of the least
        durations of all phases (entries of the motion list), or the requested duration if that is
        longer. No candidate is yielded if simple checks exclude a motion, or if the bound is not
        below the duration of the best motion.

        Parameters
        ----------
        planner : JointsPlanner
            The target and the planner of the problem.
        q : (4,) array
            Joint positions at the target, rad and m.
        only_spin_differs : bool
            True if joint positions that differ only in the spin were tried before.

        Yields
        ------
        OtherJoints
            At most one candidate.
        """
        # For the test, the start is given by its joint positions, so that it is unique.
        start = Joints.from_array(planner.phases[0].q_start)
        problem = _replace_target(unchecked_copy(planner.problem, start=start), *planner.target, q)
        try:
            phases, _ = feasible_phases(problem)
        except ProblemError:  # A straight motion cannot begin at these joints.
            return
        bound = max(sum(phase.minimum_duration for phase in phases), problem.duration or 0.0)
        if phases and bound < planner.best.duration:
            # The candidate has the original start again.
            problem = unchecked_copy(planner.problem, motion=problem.motion)
            yield cls(planner, problem, q, bound, only_spin_differs)

    @classmethod
    def _candidates_with_other_spins(
        cls, planner: JointsPlanner, q: Array, motion: MissionMotion | Reason | None
    ) -> "Iterator[OtherJoints]":
        """Yield candidates (ways to move) with other spins than given joint positions.

        The spin is the rotation of the tool about its own axis. A spin may be faster if its lower
        bound is below the known duration. Three spins, evenly spaced between the outermost of
        these, are tried. Such a coarse search suffices, because the other joints depend on joint 3
        only through their load.

        Parameters
        ----------
        planner : JointsPlanner
            The target and the planner of the problem.
        q : (4,) array
            Joint positions at the target, rad and m.
        motion : MissionMotion, Reason or None
            The motion of the problem with these joint positions, which has passed the check. There
            are no candidates without a motion.

        Yields
        ------
        OtherJoints
            At most three candidates.
        """
        is_fastest_wanted = planner.spin_free and planner.motion.duration is None
        if not is_fastest_wanted or not isinstance(motion, MissionMotion):
            return
        # Durations of the phases that end at q, of which the first one counts.
        durations = (
            item.duration for item in motion.phases if np.array_equal(item.phase.points[-1], q)
        )
        configurations, bounds = planner.spin_alternatives(q)
        spins = configurations[bounds < next(durations, 0.0) * (1 - GAP), 2]
        if spins.size:
            # Without both ends of the interval, at which the lower bound leaves little to gain.
            for spin in np.linspace(spins.min(), spins.max(), 5)[1:-1]:
                yield from cls._feasible_candidate(
                    planner, np.array([*q[:2], spin, q[3]]), only_spin_differs=True
                )

    def estimate(self, cutoff: float) -> MissionMotion | Reason | None:
        """Estimate the duration of the problem by the structured solver alone, without Ipopt.

        The estimate lets joints reverse only where they must. It ignores ranges of friction and
        payload, because these make the solver slower. The method also reports progress.

        Parameters
        ----------
        cutoff : float
            Duration in s. A motion that takes at least as long is of no use.

        Returns
        -------
        MissionMotion or Reason
            A `MissionMotion` that contains only the duration. A reason if the duration is not
            shorter than `cutoff`. None does not occur. The base class permits it for candidates
            that are solved without one.
        """
        self.planner.report()
        nominal = unchecked_copy(self.problem, friction=None, payload=None)
        duration = estimated_duration(nominal, cutoff, self.planner.work)
        if duration < cutoff:
            return MissionMotion(duration)
        return Reason(message="no shorter motion is expected")

    def solution(self, cutoff: float, estimate: MissionMotion | None) -> MissionMotion | Reason:
        """Plan the whole problem, and check its motion independently.

        Parameters
        ----------
        cutoff : float
            Duration in s. It is not used, because `plan` computes the complete motion.
        estimate : MissionMotion or None
            The estimate. It is not used, because it contains no motion.

        Returns
        -------
        MissionMotion or Reason
            The motion that has passed the check, or the reason why planning failed.
        """
        return self.planner.plan(self.problem)


def _replace_target(problem: Problem, entry: int, index: int, q: Array) -> Problem:
    """Return a problem with one target of a free motion replaced by joint positions.

    Parameters
    ----------
    problem : Problem
        The problem.
    entry : int
        Index of the free motion in the motion list.
    index : int
        Index of the target in that motion. Its targets are the via points and the end, in this
        order.
    q : (4,) array
        Joint positions, rad and m.

    Returns
    -------
    Problem
        The changed problem, which is not validated again. If the end of the motion is replaced, its
        spin is no longer free.
    """
    motion = problem.motion[entry]
    assert isinstance(motion, Free)
    targets = [*motion.through, motion.to]
    targets[index] = replace(Joints.from_array(q), line=targets[index].line)
    spin_free = motion.spin_free and index < len(motion.through)
    changed: Motion = unchecked_copy(
        motion, through=tuple(targets[:-1]), to=targets[-1], spin_free=spin_free
    )
    motions = list(problem.motion)
    motions[entry] = changed
    return unchecked_copy(problem, motion=tuple(motions))
