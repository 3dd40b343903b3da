"""Optimisation of free motions, in which the solver chooses the joint path between given points.

`solve_free` builds the mesh and the initial guess, and solves the optimal control problem
(`free_problem`). `phase_planner` calls it for each candidate, that is, for each way to make a free
motion, for example with other reversals of joints.
"""

from dataclasses import replace

import numpy as np

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.elements.rows import joint_limits, limits_jerk
from ssm_planner.kinematics import retina_constraint, tip_position
from ssm_planner.planning.ocp.free_problem import FreeProblem
from ssm_planner.planning.ocp.guesses import (
    KINEMATIC_LIMITS,
    guess_between,
    jerk_limits_of_all_joints,
    sampled_guesses,
)
from ssm_planner.planning.ocp.motion import Borders, PhaseSolution
from ssm_planner.planning.ocp.nlp import Method
from ssm_planner.planning.ocp.objectives import find_best_motion, find_fastest_motion
from ssm_planner.planning.ocp.segments import SegmentChain
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.tolerances import ROUNDING_TOLERANCE
from ssm_planner.planning.work import Work
from ssm_planner.problem import Robot
from ssm_planner.typing import Array, keyword_record

DEFAULT_ELEMENTS = 40
"""Default number of mesh elements (time intervals) of a motion."""
FINE_MESH_FACTOR = 2
"""Factor on `DEFAULT_ELEMENTS` for motions that need a finer mesh, see `default_count`."""


def solve_free(
    phase: Phase,
    *,
    strict: Robot | None = None,
    cooling: Array | None = None,
    count: int | None = None,
    method: Method = "Ipopt",
    borders: Borders | None = None,
    cutoff: float = np.inf,
    fastest_only: bool = False,
    work: Work | None = None,
) -> PhaseSolution:
    """Compute the free motion of a phase that is best for the objective of its problem.

    A phase is an entry of the problem's motion list with its joint positions. In a free motion, the
    solver chooses the joint path between the points of the phase.

    Parameters
    ----------
    phase : Phase
        The phase with its problem, points, velocities at both ends and requested duration.
    strict : Robot or None
        The robot with tighter limits, which the motion must keep. None: that of the problem.
    cooling : (4,) array or None
        Weights of the motors' heat relative to time, for a problem whose motors get too hot: the
        seconds of duration that are worth one second of a motor at its nominal torque.
    count : int or None
        Approximate number of mesh elements (time intervals). None: chosen by the kind of motion.
    method : str
        Solution method: "Ipopt" alone, "structured" (the structured solver alone), "confirmed" (the
        structured solver, whose result Ipopt confirms), or "estimated" (only the duration counts).
    borders : Borders or None
        Positions between which no joint reverses. They include the points of the phase. None: only
        these points, so joints reverse nowhere else.
    cutoff : float
        Duration in s beyond which a motion is of no use. Such a motion is not refined further, so
        it may violate limits.
    fastest_only : bool
        True to return the fastest motion without confirmation, for example to compare different
        ways to make the motion. `find_best_free` continues from this result.
    work : Work or None
        Counter to which the computational work is added. None: the work is not counted.

    Returns
    -------
    PhaseSolution
        Joint polynomials of the motion, or the status of the failure.
    """
    problem = phase.problem
    borders = borders or Borders(phase.points)
    displacements = np.diff(borders.points, axis=0)
    # A joint rests between two points whose positions differ only by rounding.
    displacements[np.abs(displacements) <= ROUNDING_TOLERANCE] = 0.0
    limits = joint_limits(strict or problem.robot, cooling)
    if "depth" in problem.rates:  # The rate of depth is the velocity of joint 4.
        limits["velocity"][3] = min(limits["velocity"][3], problem.rates["depth"])
    if limits_jerk(problem.robot):
        # The nonlinear program limits the jerk of all joints if it limits that of one.
        limits["jerk"] = jerk_limits_of_all_joints(
            limits, displacements, (phase.qd_start, phase.qd_end)
        )
    builder = _FreeProblemBuilder(
        phase=phase,
        displacements=displacements,
        limits=limits,
        method=method,
        borders=borders,
        work=work or Work(),
    )
    ocp = builder.build(count)
    fastest = find_fastest_motion(ocp, ocp.guess, cutoff)
    motion = replace(ocp.result(fastest.solution), refined=fastest)
    return motion if fastest_only else find_best_free(motion, cutoff)


def find_best_free(motion: PhaseSolution, cutoff: float = np.inf) -> PhaseSolution:
    """Compute the free motion that is best for the objective, starting from the fastest motion.

    If the solution method of the fastest motion is "confirmed", Ipopt confirms the result.

    Parameters
    ----------
    motion : PhaseSolution
        The fastest motion, a result of `solve_free` with `fastest_only`.
    cutoff : float
        Duration in s beyond which a motion is of no use. If the fastest motion takes longer, it is
        the result.

    Returns
    -------
    PhaseSolution
        Joint polynomials of the motion, or the status of the failure.
    """
    assert motion.refined is not None
    ocp = motion.refined.state.problem
    assert isinstance(ocp, FreeProblem)
    return ocp.result(find_best_motion(motion.refined, cutoff))


@keyword_record
class _FreeProblemBuilder:
    """Builder of the optimal control problem of a free motion, with its mesh and initial guess.

    The mesh divides the motion into elements (time intervals). The method `build` returns the
    problem.
    """

    phase: Phase
    """The phase with its problem, points and velocities at both ends."""
    displacements: Array
    """Displacements of the joints from each point to the next one, (k, 4), rad and m."""
    limits: dict[str, Array]
    """Limits of the joints by their names in `elements.rows.LIMIT_SIZES`, (4,) each, SI units."""
    method: Method
    """Solution method "Ipopt", "structured", "confirmed" or "estimated"."""
    borders: Borders
    """Positions between which no joint reverses: the points of the phase, and reversals."""
    work: Work
    """Counter of the computational work."""

    @property
    def jerk(self) -> bool:
        """True if the robot has a jerk limit."""
        return limits_jerk(self.phase.problem.robot)

    @property
    def default_count(self) -> int:
        """Default number of mesh elements (time intervals) of the motion.

        Two kinds of motions get a finer mesh. One is a motion from rest to rest between two points
        without free reversals, if Ipopt confirms it. The other is a jerk-limited motion that begins
        or ends at speed, because its initial acceleration must end within one element.
        """
        at_rest = self.phase.begins_and_ends_at_rest
        confirmed = self.method == "confirmed" and at_rest and not self.borders.free
        between_two_points = len(self.displacements) == 1
        at_speed = self.jerk and not at_rest
        return (
            FINE_MESH_FACTOR * DEFAULT_ELEMENTS
            if at_speed or (confirmed and between_two_points)
            else DEFAULT_ELEMENTS
        )

    def elements_per_segment(self, count: int) -> int:
        """Compute the approximate number of elements between two neighbouring points of the motion.

        A motion between two points has `count` elements (time intervals). A motion through more
        points has about 2 · `count` elements in total. Each part between two neighbouring points
        has the same number of them, which is at least 8.

        Parameters
        ----------
        count : int
            Number of elements of a motion between two points.

        Returns
        -------
        int
            Number of elements between two neighbouring points.
        """
        return (
            max(2 * count // len(self.displacements), 8) if len(self.displacements) > 1 else count
        )

    def chain(self, per_segment: int) -> SegmentChain:
        """Build all segments of the motion with their initial guesses.

        A segment is a part of the motion in which no joint reverses. A segment also ends where the
        tip passes the port (incision) of an eye, because the distance to the retina is only limited
        inside the eye.

        Parameters
        ----------
        per_segment : int
            Approximate number of elements (time intervals) between two points of the motion.

        Returns
        -------
        SegmentChain
            The segments in the order of time.
        """
        chain = SegmentChain.joined(self._chains(per_segment), self.borders.free)
        eye, mechanism = self.phase.problem.eye, self.phase.mechanism
        if eye is None:
            return chain

        def is_outside(q: Array) -> bool:
            """Return True if the tip is closer to the retina than allowed, or outside of the eye.

            Only the port of the eye permits such a position. The function reads `eye` and
            `mechanism` from the enclosing method.

            Parameters
            ----------
            q : (4,) array
                Joint positions, rad and m.
            """
            return bool(retina_constraint(NUMPY, eye, tip_position(mechanism, q[None])[0]) > 0)

        return chain.divided_at_port(eye.port, is_outside)

    def _chains(self, per_segment: int) -> list[SegmentChain]:
        """Build the segments and guesses between each pair of neighbouring borders.

        The borders are the points of the motion, and further reversals. A segment is a part of the
        motion in which no joint reverses. If the velocities at two borders make a joint reverse
        between them, several segments lie between these borders.

        Parameters
        ----------
        per_segment : int
            Approximate number of elements (time intervals) between two borders.

        Returns
        -------
        list of SegmentChain
            The segments between the first two borders, then those between the next two, and so on.
            Each chain begins where the previous one ends.
        """
        displacements, borders = self.displacements, self.borders
        # If an earlier motion has suggested the reversals, the guess is sampled from this motion.
        if borders.guess is not None:
            count = per_segment * len(displacements)
            return sampled_guesses(borders, count=count)
        via_velocity = borders.via_velocity
        if via_velocity is None:
            via_velocity = np.zeros((len(displacements) - 1, 4))
        phase = self.phase
        # Joint velocities at all borders, (k + 1, 4), and limits of velocity, acceleration and jerk
        # of the joints, (3, 4).
        speeds = np.vstack([phase.qd_start, via_velocity, phase.qd_end])
        kinematic_limits = np.stack([self.limits[name] for name in KINEMATIC_LIMITS])
        if not self.jerk:
            kinematic_limits[2] = np.inf
        return [
            guess_between(
                borders.points[k],
                displacements[k],
                speeds[k : k + 2],
                kinematic_limits,
                phase.qdd_start if k == 0 else None,
                count=per_segment,
            )
            for k in range(len(displacements))
        ]

    def build(self, count: int | None) -> FreeProblem:
        """Build the optimal control problem of the motion, with its mesh and its initial guess.

        The guess is a motion in closed form, or an earlier motion that suggested reversals of
        joints. Its duration is the unit of time of the problem. In this unit, the duration of the
        solution is about 1.

        Parameters
        ----------
        count : int or None
            Approximate number of mesh elements (time intervals). None: `default_count`.

        Returns
        -------
        FreeProblem
            The problem. Its property `guess` contains the initial guess.
        """
        chain = self.chain(self.elements_per_segment(count or self.default_count))
        one_block_per_segment = self._has_one_block_per_segment(chain)
        structure = chain.structure(
            one_block_per_segment=one_block_per_segment, has_continuous_acceleration=self.jerk
        )
        # Lengths of all elements of the guess in s, (n,). Their sum is the unit of time.
        lengths = np.concatenate([guess.elements.h[:, 0] for guess in chain.guesses])
        return FreeProblem(
            structure=structure,
            lengths=lengths / lengths.sum(),
            joint_limits=self.limits,
            time_scale=float(lengths.sum()),
            method=self.method,
            phase=self.phase,
            chain=chain,
            directions=chain.directions,
            work=self.work,
        )

    def _has_one_block_per_segment(self, chain: SegmentChain) -> bool:
        """Decide whether the duration of each segment is a single unknown of the program.

        A segment is a part of the motion in which no joint reverses. With a single unknown, the
        joints switch at the same fractions of the segment's duration as in the guess. The
        structured solver then converges more often, but the motion may be longer. Otherwise each
        arc has a duration of its own. An arc lies between two switching points, that is, instants
        at which the acceleration of a joint (with a jerk limit: its jerk) jumps in the guess.

        Parameters
        ----------
        chain : SegmentChain
            Segments of the motion.

        Returns
        -------
        bool
            True for a single unknown, False for one unknown for each arc.
        """
        # Ipopt gets one unknown for each arc. Estimates, and motions whose guess is an earlier
        # motion, get a single unknown for each segment.
        if self.method in ("Ipopt", "estimated") or self.borders.guess is not None:
            return self.method != "Ipopt"
        # Joints reverse at borders with a free position, except at ports.
        reverses = not np.delete(chain.fixed, chain.ports, axis=0).all()
        # With a single unknown for each segment, a jerk-limited motion through several points would
        # be up to 0.13 % longer, and one that begins with an acceleration up to 4 %.
        needs_arcs = len(self.displacements) > 1 or self.phase.qdd_start.any()
        return not (reverses or (self.jerk and needs_arcs))
