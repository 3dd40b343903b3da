"""Free motions: the mesh and the guess of the optimal control problem, and its solution."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.elements.rows import joint_limits, limits_jerk
from ssm_planner.kinematics import Mechanism, retina_row, tip_position
from ssm_planner.planning.ocp.free_problem import FreeProblem
from ssm_planner.planning.ocp.guesses import (
    KINEMATIC,
    guess_between,
    jerk_for_all,
    sampled_guesses,
)
from ssm_planner.planning.ocp.motion import Borders, PhaseSolution
from ssm_planner.planning.ocp.nlp import Method
from ssm_planner.planning.ocp.objectives import find_best_motion, find_fastest_motion
from ssm_planner.planning.ocp.segments import SegmentChain
from ssm_planner.planning.tolerances import ROUNDING
from ssm_planner.planning.work import Work
from ssm_planner.problem import Objective, Problem, Robot
from ssm_planner.typing import Array, keyword_record

ELEMENTS = 40
"""Number of elements of a motion. Some motions need FINER times as many."""
FINER = 2


def solve_free(
    problem: Problem,
    mechanism: Mechanism,
    points: Array,
    *,
    strict: Robot | None = None,
    cooling: Array | None = None,
    duration: float | None = None,
    speeds: tuple[Array, Array] | None = None,
    count: int | None = None,
    method: Method = "Ipopt",
    start_acceleration: Array | None = None,
    borders: Borders | None = None,
    cutoff: float = np.inf,
    fastest_only: bool = False,
    work: Work | None = None,
) -> PhaseSolution:
    """Return a motion through the joints `points` (k + 1, 4).

    Parameters
    ----------
    problem : Problem
        The problem with its objective and limits.
    mechanism : Mechanism
        Geometry of the robot.
    points : (k + 1, 4) array
        Joints at both ends and at the via points.
    strict : Robot or None
        The robot with tighter limits, which the motion must keep.
    cooling : (4,) array or None
        Weights of the motors' heat relative to time.
    duration : float or None
        Requested duration, s.
    speeds : ((4,), (4,)) arrays or None
        q̇ at both ends. None: at rest.
    count : int or None
        Approximate number of elements. None: chosen by the kind of motion.
    method : str
        Solution method, see `nlp.Method`.
    start_acceleration : (4,) array or None
        q̈ at the start if jerk is limited. None: 0.
    borders : Borders or None
        Borders at which joints reverse. They replace the points.
    cutoff : float
        Duration in s beyond which a motion is not refined any further.
    fastest_only : bool
        Return the fastest motion as the first solver finds it. `find_best_free` makes it final.
    work : Work or None
        Counter of the work.

    Returns
    -------
    PhaseSolution
        Joint polynomials, or the status of the failure.
    """
    borders = borders or Borders(points)
    displacements = np.diff(borders.points, axis=0)
    displacements[np.abs(displacements) <= ROUNDING] = 0.0
    ends = speeds or (np.zeros(4), np.zeros(4))
    limits = joint_limits(strict or problem.robot, cooling)
    if "depth" in problem.rates:  # The rate of depth is the velocity of joint 4.
        limits["velocity"][3] = min(limits["velocity"][3], problem.rates["depth"])
    if limits_jerk(problem.robot):
        limits["jerk"] = jerk_for_all(limits, displacements, ends)
    builder = _FreeProblemBuilder(
        problem=problem,
        mechanism=mechanism,
        displacements=displacements,
        limits=limits,
        ends=ends,
        start_acceleration=np.zeros(4) if start_acceleration is None else start_acceleration,
        method=method,
        borders=borders,
        work=work or Work(),
    )
    ocp = builder.build(count)
    takes = None if duration is None else duration / ocp.time_scale
    fastest = find_fastest_motion(ocp, ocp.guess, takes, cutoff=cutoff / ocp.time_scale)
    motion = replace(ocp.result(fastest.solution), refined=fastest)
    return motion if fastest_only else find_best_free(motion, problem.objective, duration, cutoff)


def find_best_free(
    motion: PhaseSolution,
    objective: Objective,
    duration: float | None = None,
    cutoff: float = np.inf,
) -> PhaseSolution:
    """Return the motion for an objective from the fastest one, confirmed if the method asks for it.

    Parameters
    ----------
    motion : PhaseSolution
        Result of `solve_free` with `fastest_only`.
    objective : str
        "time", "time then heat" or "effort".
    duration : float or None
        Requested duration, s.
    cutoff : float
        Duration in s beyond which a motion is of no use.
    """
    assert motion.refined is not None
    ocp = motion.refined.state.problem
    assert isinstance(ocp, FreeProblem)
    takes = None if duration is None else duration / ocp.time_scale
    return ocp.result(
        find_best_motion(motion.refined, objective, takes, cutoff=cutoff / ocp.time_scale)
    )


@keyword_record
class _FreeProblemBuilder:
    """Builder of the problem of a free motion on its mesh. The fields are those of `solve_free`."""

    problem: Problem
    mechanism: Mechanism
    displacements: Array
    """Displacements from point to point, (k, 4)."""
    limits: dict[str, Array]
    """Limits of the joints, by the names in LIMITS."""
    ends: tuple[Array, Array]
    start_acceleration: Array
    method: Method
    borders: Borders
    work: Work

    @property
    def jerk(self) -> bool:
        """True if jerk is limited."""
        return limits_jerk(self.problem.robot)

    @property
    def at_rest(self) -> bool:
        """True if the joints are at rest at both ends."""
        return not (self.ends[0].any() or self.ends[1].any())

    @property
    def is_structured(self) -> bool:
        """True if the structured solver is tried.

        With a jerk limit it can only begin at q̈ = 0.
        """
        return self.method == "estimated" or (
            self.method != "Ipopt" and not self.start_acceleration.any()
        )

    @property
    def least_count(self) -> int:
        """Smallest number of elements between two switching points."""
        return 2 if len(self.displacements) < 16 else 1

    @property
    def default_count(self) -> int:
        """Number of elements.

        A mesh is finer between two points if Ipopt confirms the motion. It is also finer for
        jerk-limited motions at speed, because the initial acceleration must end within one element.
        """
        confirmed = self.method == "confirmed" and self.at_rest and not self.borders.free
        between_two_points = len(self.displacements) == 1
        at_speed = self.jerk and not self.at_rest
        return FINER * ELEMENTS if at_speed or (confirmed and between_two_points) else ELEMENTS

    def elements_per_segment(self, count: int) -> int:
        """Return the number of elements between two points, of `count` elements in all."""
        return (
            max(2 * count // len(self.displacements), 8) if len(self.displacements) > 1 else count
        )

    def chain(self, per_segment: int) -> SegmentChain:
        """Return the segments and their guesses, with about `per_segment` elements between points.

        Where the tip passes an eye's port, there is a border too.
        """
        chain = SegmentChain.joined(self._chains(per_segment), self.borders.free)
        if self.problem.eye is None:
            return chain
        is_outside = partial(_is_outside, self.problem, self.mechanism)
        return chain.cut_at(self.problem.eye.port, is_outside, self.least_count)

    def _chains(self, per_segment: int) -> list[SegmentChain]:
        """Return the segments from point to point."""
        displacements, borders = self.displacements, self.borders
        if borders.guess is not None:
            count = per_segment * len(displacements)
            return sampled_guesses(borders, count=count, least_count=self.least_count)
        within = borders.via_velocity
        if within is None:
            within = np.zeros((len(displacements) - 1, 4))
        speeds = np.vstack([self.ends[0], within, self.ends[1]])
        table = np.stack([self.limits[name] for name in KINEMATIC])
        return [
            guess_between(
                borders.points[k],
                displacements[k],
                speeds[k : k + 2],
                table,
                jerk=self.jerk,
                start_acceleration=self.start_acceleration * (k == 0),
                count=per_segment,
                least_count=self.least_count,
            )
            for k in range(len(displacements))
        ]

    def build(self, count: int | None) -> FreeProblem:
        """Build the problem on the mesh of its guess, with the guess's duration as the unit of time.

        The mesh has about `count` elements, or a suitable number.
        """
        chain = self.chain(self.elements_per_segment(count or self.default_count))
        one_time_per_segment = self._one_time_per_segment(chain)
        structure = chain.structure(one_time_per_segment=one_time_per_segment, smooth=self.jerk)
        lengths = np.concatenate([guess.elements.h[:, 0] for guess in chain.guesses])
        return FreeProblem(
            structure=structure,
            lengths=lengths / lengths.sum(),
            joint_limits=self.limits,
            time_scale=float(lengths.sum()),
            method=self.method if self.is_structured else "Ipopt",
            problem=self.problem,
            mechanism=self.mechanism,
            chain=chain,
            directions=chain.directions,
            speeds=self.ends,
            start_acceleration=self.start_acceleration,
            starting=self.ends[0] == 0.0,
            work=self.work,
        )

    def _one_time_per_segment(self, chain: SegmentChain) -> bool:
        """Return True if each segment, instead of each arc, has one time.

        Joints that reverse then switch where the guess does.
        """
        if not self.is_structured or self.method == "estimated" or self.borders.guess is not None:
            return self.is_structured
        # With one time for each segment, jerk-limited motions are up to 0.13 % longer.
        reverses = not np.delete(chain.fixed, chain.ports, axis=0).all()
        return not reverses and not (self.jerk and len(self.displacements) > 1)


def _is_outside(problem: Problem, mechanism: Mechanism, q: Array) -> bool:
    """Return True if only the port allows the tip of joints (4,) to be where it is."""
    assert problem.eye is not None
    return bool(retina_row(NUMPY, problem.eye, tip_position(mechanism, q[None])[0]) > 0)
