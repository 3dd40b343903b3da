"""Optimisation of free motions, in which the solver chooses the joint path between given points.

`solve_free` builds the mesh and the initial guess, and solves the optimal control problem
(`free_problem`). `phase_planner` calls it for each candidate, that is, for each way to make a free
motion, for example with other reversals of joints.
"""

from dataclasses import replace

import numpy as np

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.elements.rows import UNLIMITED, joint_limits, limits_jerk
from ssm_planner.kinematics import retina_constraint, tip_position
from ssm_planner.planning.ocp.free_problem import FreeProblem
from ssm_planner.planning.ocp.guesses import (
    KINEMATIC_LIMITS,
    guess_between,
    sampled_guesses,
)
from ssm_planner.planning.ocp.motion import Borders, PhaseSolution
from ssm_planner.planning.ocp.nlp import Method
from ssm_planner.planning.ocp.objectives import find_best_motion, find_fastest_motion
from ssm_planner.planning.ocp.segments import SegmentChain
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.work import Work
from ssm_planner.problem import Robot
from ssm_planner.typing import Array

DEFAULT_ELEMENTS = 40
"""Default number of mesh elements (time intervals) of a motion."""
FINE_MESH_FACTOR = 2
"""Factor on `DEFAULT_ELEMENTS` for motions that need a finer mesh, see `_default_count`."""
ACCELERATION_RAMP_SHARE = 5e-4
"""Time in which a joint without a jerk limit reaches its largest acceleration.

It is a share of the mean time between two borders. It applies if other joints have a jerk limit.
"""


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
    robot = phase.problem.robot
    borders = borders or Borders(phase.points)
    limits = _limits_of_free_motion(phase, joint_limits(strict or robot, cooling), borders)
    count = count or _default_count(phase, borders, method)
    chain = _segment_chain(phase, borders, limits, count)
    # Lengths of all elements of the guess in s, (n,). Their sum is the unit of time.
    lengths = np.concatenate([guess.elements.h[:, 0] for guess in chain.guesses])
    ocp = FreeProblem(
        phase=phase,
        structure=chain.structure(
            one_block_per_segment=_has_one_block_per_segment(phase, borders, chain, method),
            has_continuous_acceleration=limits_jerk(robot),
        ),
        lengths=lengths / lengths.sum(),
        joint_limits=limits,
        time_scale=float(lengths.sum()),
        method=method,
        chain=chain,
        directions=chain.directions,
        work=work or Work(),
    )
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


def _limits_of_free_motion(
    phase: Phase, limits: dict[str, Array], borders: Borders
) -> dict[str, Array]:
    """Add the limits that a free motion imposes on all joints to the limits of the joints.

    The rate of depth is the velocity of joint 4. The nonlinear program limits the jerk of either
    all joints or none. If only some joints have a jerk limit, the others get a large one. With it,
    they reach their largest acceleration in the share `ACCELERATION_RAMP_SHARE` of the mean time
    between two borders.

    Parameters
    ----------
    phase : Phase
        The phase with its problem and the lower bound on its duration.
    limits : dict of (4,) arrays
        Limits of the joints by their names in `elements.rows.LIMIT_SIZES`, in SI units.
    borders : Borders
        Positions between which no joint reverses.

    Returns
    -------
    dict of (4,) arrays
        The limits of the program. Those of jerk are infinite if no joint has a jerk limit.
    """
    velocity, jerk = limits["velocity"].copy(), limits["jerk"]
    velocity[3] = min(velocity[3], phase.problem.rates.get("depth", np.inf))
    ramp = ACCELERATION_RAMP_SHARE * phase.lower_bound / len(borders.displacements)
    unstated = limits["acceleration"] / ramp if limits_jerk(phase.problem.robot) else np.inf
    return {**limits, "velocity": velocity, "jerk": np.where(jerk < UNLIMITED, jerk, unstated)}


def _default_count(phase: Phase, borders: Borders, method: Method) -> int:
    """Return the default number of mesh elements (time intervals) of a motion.

    Two kinds of motions get a finer mesh. One is a motion from rest to rest between two points, if
    Ipopt confirms it. The other is a jerk-limited motion that begins or ends at speed, because its
    initial acceleration must end within one element.

    Parameters
    ----------
    phase : Phase
        The phase with its problem and velocities at both ends.
    borders : Borders
        Positions between which no joint reverses.
    method : str
        Solution method: "Ipopt", "structured", "confirmed" or "estimated".
    """
    if phase.begins_and_ends_at_rest:
        is_fine = method == "confirmed" and len(borders.displacements) == 1
    else:
        is_fine = limits_jerk(phase.problem.robot)
    return FINE_MESH_FACTOR * DEFAULT_ELEMENTS if is_fine else DEFAULT_ELEMENTS


def _segment_chain(
    phase: Phase, borders: Borders, limits: dict[str, Array], count: int
) -> SegmentChain:
    """Build all segments of the motion with their initial guesses.

    A segment is a part of the motion in which no joint reverses. If the velocities at two borders
    make a joint reverse between them, several segments lie between these borders. A segment also
    ends where the tip passes the port (incision) of an eye, because the distance to the retina is
    only limited inside the eye.

    Parameters
    ----------
    phase : Phase
        The phase with its problem, and velocities and acceleration at its ends.
    borders : Borders
        Positions between which no joint reverses, and possibly an earlier motion as the guess.
    limits : dict of (4,) arrays
        Limits of the joints by name, in SI units.
    count : int
        Approximate number of elements (time intervals) of a motion between two borders. A motion
        through more borders has about 2 · `count` elements, shared out equally.

    Returns
    -------
    SegmentChain
        The segments in the order of time.
    """
    parts = len(borders.displacements)
    per_part = count if parts == 1 else max(2 * count // parts, 8)
    if borders.guess is not None:
        chains = sampled_guesses(borders, count=per_part * parts)
    else:
        inner = np.zeros((parts - 1, 4)) if borders.via_velocity is None else borders.via_velocity
        speeds = np.vstack([phase.qd_start, inner, phase.qd_end])
        accelerations = np.zeros((parts, 4))
        accelerations[0] = phase.qdd_start
        kinematic_limits = np.stack([limits[name] for name in KINEMATIC_LIMITS])
        chains = [
            guess_between(
                borders.points[k],
                borders.displacements[k],
                speeds[k : k + 2],
                kinematic_limits,
                accelerations[k],
                count=per_part,
            )
            for k in range(parts)
        ]
    chain = SegmentChain.joined(chains, borders.free)
    eye, mechanism = phase.problem.eye, phase.mechanism
    if eye is None:
        return chain

    def is_outside(q: Array) -> bool:
        """Return True if the tip is closer to the retina than allowed, or outside of the eye.

        Only the port of the eye permits such a position. The function reads `eye` and `mechanism`
        from the enclosing function.

        Parameters
        ----------
        q : (4,) array
            Joint positions, rad and m.
        """
        return bool(retina_constraint(NUMPY, eye, tip_position(mechanism, q[None])[0]) > 0)

    return chain.divided_at_port(eye.port, is_outside)


def _has_one_block_per_segment(
    phase: Phase, borders: Borders, chain: SegmentChain, method: Method
) -> bool:
    """Decide whether the duration of each segment is a single unknown of the program.

    A segment is a part of the motion in which no joint reverses. With a single unknown, the
    joints switch at the same fractions of the segment's duration as in the guess. The
    structured solver then converges more often, but the motion may be longer. Otherwise each
    arc has a duration of its own. An arc lies between two switching points, that is, instants
    at which the acceleration of a joint (with a jerk limit: its jerk) jumps in the guess.

    Parameters
    ----------
    phase : Phase
        The phase with its problem and the acceleration at its start.
    borders : Borders
        Positions between which no joint reverses, and possibly an earlier motion as the guess.
    chain : SegmentChain
        Segments of the motion.
    method : str
        Solution method: "Ipopt", "structured", "confirmed" or "estimated".

    Returns
    -------
    bool
        True for a single unknown, False for one unknown for each arc.
    """
    # Ipopt gets one unknown for each arc. Estimates, and motions whose guess is an earlier
    # motion, get a single unknown for each segment.
    if method in ("Ipopt", "estimated") or borders.guess is not None:
        return method != "Ipopt"
    # Joints reverse at borders with a free position, except at ports.
    reverses = not np.delete(chain.fixed, chain.ports, axis=0).all()
    # With a single unknown for each segment, a jerk-limited motion through several points would
    # be up to 0.13 % longer, and one that begins with an acceleration up to 4 %.
    needs_arcs = len(borders.displacements) > 1 or phase.qdd_start.any()
    return not (reverses or (limits_jerk(phase.problem.robot) and needs_arcs))
