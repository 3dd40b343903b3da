"""Optimal control problem of a motion along a given path.

The joint path q(s) with the path parameter s from 0 to 1 is given. Only the timing s(t) is unknown.
It is a cubic polynomial on each element (time interval) of a mesh. The optimisation starts at the
motion that TOPP-RA (`planning.retiming`) computes along the path, and the elements end where the
acceleration of this motion jumps. The path determines where each joint reverses. Every joint keeps
its direction between two reversals, so the sign of its friction is known.

`solve_straight` is the main entry. `joint_polynomials` converts a timing to polynomials of the
joints. `retimed_polynomials` does so for a motion whose timing comes from TOPP-RA alone.
"""

from collections.abc import Mapping
from functools import cached_property

import numpy as np

from ssm_planner.dynamics import RigidBody
from ssm_planner.elements.rows import (
    RowName,
    joint_limits,
    limits_jerk,
    tool_limits,
)
from ssm_planner.elements.straight_element import StraightElement
from ssm_planner.kinematics import task_rates
from ssm_planner.planning.lower_bound import lower_bound
from ssm_planner.planning.ocp.mesh import Mesh
from ssm_planner.planning.ocp.motion import PhaseSolution
from ssm_planner.planning.ocp.nlp import (
    BoundaryConditions,
    Method,
    NlpSolution,
    NlpStructure,
    as_cubics,
)
from ssm_planner.planning.ocp.objectives import find_best_motion, find_fastest_motion
from ssm_planner.planning.ocp.path_fit import fit_path
from ssm_planner.planning.ocp.problem import OcpProblem
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.retiming.paths import JointPath, SplinePath
from ssm_planner.planning.retiming.retime import Retiming
from ssm_planner.planning.tolerances import PATH_SAMPLES
from ssm_planner.planning.work import Work
from ssm_planner.problem import (
    TASK_COORDINATES,
    JointJerk,
    Robot,
)
from ssm_planner.trajectory import quintic_coefficients
from ssm_planner.typing import Array, keyword_record

MIN_ELEMENTS = 84
"""Number of elements of a path that is one smooth piece, and the smallest number of any path.

A path of several pieces, for example with rounded corners, gets half as many for each of
`JointPath.breaks`, the ends of the pieces.
"""
ELEMENTS_PER_SPLINE_BREAK = 18
"""Number of elements for each of `JointPath.breaks` of a path that is a spline."""
FINE_MESH_FACTOR = 3
"""Factor on the number of elements of a jerk-limited motion that Ipopt confirms.

It also applies if Ipopt solves alone.
"""
POLYNOMIALS_PER_ELEMENT = 4
"""Number of quintic polynomials of each joint in an element.

Between their ends, the motion then deviates from the path by about 1e-9 rad.
"""


def solve_straight(
    phase: Phase,
    path: JointPath,
    guess: Retiming,
    *,
    strict: Robot | None = None,
    cooling: Array | None = None,
    count: int | None = None,
    method: Method = "Ipopt",
    work: Work | None = None,
) -> PhaseSolution:
    """Compute the motion along a given path that is best for the objective of a phase.

    A phase is an entry of the problem's motion list with its joint positions. Only the timing of
    the motion along the path is unknown.

    Parameters
    ----------
    phase : Phase
        The phase with its problem, velocities at both ends and requested duration.
    path : JointPath
        Joint path q(s) with the path parameter s from 0 to 1.
    guess : Retiming
        Motion along the path, which TOPP-RA has timed on a grid of s.
    strict : Robot or None
        The robot with tighter limits, which the motion must keep. None: that of the problem.
    cooling : (4,) array or None
        Weights of the motors' heat relative to time, for a problem whose motors get too hot: the
        seconds of duration that are worth one second of a motor at its nominal torque.
    count : int or None
        Number of mesh elements (time intervals). None: chosen by the path.
    method : str
        Solution method: "Ipopt" alone, "structured" (the structured solver alone), "confirmed" (the
        structured solver, whose result Ipopt confirms), or "estimated" (only the duration counts).
    work : Work or None
        Counter to which the computational work is added. None: the work is not counted.

    Returns
    -------
    PhaseSolution
        Joint polynomials of the motion, or the status of the failure.
    """
    robot = phase.problem.robot
    jerk = limits_jerk(robot)
    knots, signs = path.directions
    # Number of elements, which grows with the number of smooth pieces of the path.
    elements_per_break = (
        ELEMENTS_PER_SPLINE_BREAK if isinstance(path, SplinePath) else MIN_ELEMENTS // 2
    )
    if count is None:
        finer = FINE_MESH_FACTOR if jerk and method in ("confirmed", "Ipopt") else 1
        count = finer * max(len(path.breaks) * elements_per_break, MIN_ELEMENTS)
    mesh = Mesh.from_retiming(
        guess, knots, count, _path_jerk_limits(robot, path, guess.s) if jerk else None
    )
    # Unit of time: the duration of the guess, or a lower bound if that is longer.
    scale = max(guess.duration, lower_bound(robot, path.sample(np.array([0.0, 1.0])).q))
    # Each interval between two reversals is a segment (no joint reverses in it) and a block (its
    # elements share one unknown duration). The only coordinate, s, moves in every segment.
    sizes = tuple(np.bincount(mesh.interval).tolist())
    structure = NlpStructure(
        moves=((True,),) * len(sizes),
        segment_sizes=sizes,
        block_sizes=sizes,
        has_continuous_acceleration=jerk,
        limits_jerk=False,
    )
    problem = _StraightProblem(
        phase=phase,
        structure=structure,
        lengths=np.diff(mesh.instants) / mesh.instants[-1],
        joint_limits=joint_limits(strict or robot, cooling),
        time_scale=scale,
        method=method,
        directions=signs,
        path=path,
        work=work or Work(),
    )
    return problem.result(find_best_motion(find_fastest_motion(problem, mesh.elements(guess))))


def retimed_polynomials(
    path: JointPath, retiming: Retiming, end_speed: float
) -> tuple[Array, Array]:
    """Convert a motion that TOPP-RA has timed to polynomials of the joints.

    The result has one quintic polynomial of each joint for each grid interval.

    Parameters
    ----------
    path : JointPath
        Joint path q(s) with the path parameter s from 0 to 1.
    retiming : Retiming
        Motion along the path, which TOPP-RA has timed on a grid of n + 1 values of s.
    end_speed : float
        ṡ at the end of the motion, 1/s.

    Returns
    -------
    breaks : (n + 1,) array
        Times at the grid points, which are the ends of the polynomials, s.
    coefficients : (n, 6, 4) array
        Coefficients of the polynomials by powers of the time since their start. The axes are grid
        interval, power and joint.
    """
    # TOPP-RA makes ṡ² linear in s on each grid interval, so s̈ is constant there. It is thus the
    # same at the start and at the end of an element. The columns of `elements` are s, ṡ, s̈ at the
    # start, s̈ at the end, and length.
    accelerations = [retiming.acceleration, retiming.acceleration]
    states = [retiming.s[:-1], np.sqrt(retiming.speed_squared[:-1])]
    elements = np.column_stack([*states, *accelerations, np.diff(retiming.times)])
    return joint_polynomials(path, elements, 1, end_speed)


@keyword_record
class _StraightProblem(OcpProblem):
    """Optimal control problem of the timing s(t) along a path. Its only coordinate is s.

    It has n elements (time intervals of the mesh) and k segments. A segment is a part of the motion
    in which no joint reverses.
    """

    path: JointPath
    """The path q(s) of the joints."""

    def result(self, solution: NlpSolution) -> PhaseSolution:
        """Convert a solution of the nonlinear program to joint polynomials in SI units.

        Parameters
        ----------
        solution : NlpSolution
            Timing of the path in scaled time.

        Returns
        -------
        PhaseSolution
            The motion with `POLYNOMIALS_PER_ELEMENT` polynomials of each joint in each element
            (time interval), or the status and message of the failure.
        """
        if not solution.solved:
            return PhaseSolution.from_solver(solution)
        scale = self.time_scale
        # From scaled time to seconds. The columns are s, ṡ, s̈ at the start, s̈ at the end, length.
        elements = solution.elements * np.array([1.0, 1 / scale, 1 / scale**2, 1 / scale**2, scale])
        _, end_speed = self.phase.speeds_along(self.path)
        breaks, coefficients = joint_polynomials(
            self.path, elements, POLYNOMIALS_PER_ELEMENT, end_speed
        )
        # The instants of the reversals follow from their values of s. `breaks` also contains times
        # within the elements. Only every POLYNOMIALS_PER_ELEMENT-th break is an end of an element.
        positions = np.append(elements[:, 0], 1.0)
        borders = np.interp(self.path.directions[0], positions, breaks[::POLYNOMIALS_PER_ELEMENT])
        return PhaseSolution.from_solver(
            solution,
            breaks=breaks,
            coefficients=coefficients,
            border_instants=borders,
        )

    @property
    def boundary(self) -> BoundaryConditions:
        """Values of s at the start, the reversals of joints and the end, and ṡ at both ends.

        All values of s are given, because the path determines where the joints reverse. s increases
        in every segment. ṡ is the derivative with respect to scaled time.
        """
        knots, signs = self.path.directions
        start, end = np.array(self.phase.speeds_along(self.path))[:, None] * self.time_scale
        return BoundaryConditions(knots[:, None], np.ones((len(signs), 1)), start, end)

    @property
    def limits(self) -> tuple[Array, Array, Array]:
        """Limits of ṡ in each element (n, 1), and of |s̈| and |s⃛|, (1,) each, in scaled time.

        The limits of ṡ are infinite without limited rates of task coordinates. Those of s̈ and s⃛
        are always infinite, because path constraints limit the acceleration and jerk of the joints.
        """
        velocity = self._speed_limits[self.structure.segment, None]
        return velocity, np.array([np.inf]), np.array([np.inf])

    @cached_property
    def _speed_limits(self) -> Array:
        """Largest ṡ in each segment that the limited rates of task coordinates allow, (k,).

        ṡ is the derivative with respect to scaled time.
        """
        return path_speed_limits(self.path, self.phase.problem.rates) * self.time_scale

    @property
    def element_model(self) -> StraightElement:
        """Functions of one element (time interval), with all path constraints that it can have.

        They are the limits of joints, motors and the tool.
        """
        robot = self.phase.problem.robot
        return StraightElement(robot=robot, jerk=limits_jerk(robot))

    @cached_property
    def always_active(self) -> frozenset[RowName]:
        """Names and joints of the jerk constraints, which are always part of the program.

        Other path constraints become part of it when the guess comes close to their limits. The
        guess is a motion of TOPP-RA, which ignores jerk, so it does not show which jerk constraints
        matter.
        """
        return frozenset(name for name in self.row_names if name[0] == JointJerk.name)

    def element_parameters(self, elements: Array) -> tuple[Array, ...]:
        """Return the parameter vectors of the functions that evaluate one element.

        Parameters
        ----------
        elements : (n, 5) array
            Latest motion: s, ṡ, s̈ at the start, s̈ at the end, and length of each element (time
            interval). Only the positions s are used, near which the path is approximated.

        Returns
        -------
        sigma : (n, 4) array
            Direction of each joint in each element: +1, −1 or 0.
        polynomials : (n, size) array
            Coefficients of polynomials in s that approximate the path, the torques and the tool
            speeds near each element (`path_fit.fit_path`).
        limits : (size,) array
            Limits of joints, motors and tool in the order of `StraightElement.layout`, the same for
            all elements.
        """
        limits = StraightElement.layout.pack(
            **self.joint_limits,
            **tool_limits(self.phase.problem.of_tool),
            time_scale=self.time_scale,
        )
        starts = elements[:, 0]
        polynomials = fit_path(self.path, self._bodies, starts, np.append(starts[1:], 1.0))
        return self.sigma, polynomials, limits

    @cached_property
    def _bodies(self) -> tuple[RigidBody, ...]:
        """Rigid-body model of the arm with each payload in `Robot.loads`."""
        return tuple(RigidBody.from_robot(load) for load in self.phase.problem.robot.loads)


def path_speed_limits(path: JointPath, rates: Mapping[str, float]) -> Array:
    """Compute the largest path speed ṡ that limited rates of task coordinates allow.

    The rate of a task coordinate x is |dx/ds| ṡ. It is smaller than a limit r everywhere if ṡ is at
    most r / max |dx/ds|. The maximum is taken over samples of the path.

    Parameters
    ----------
    path : JointPath
        Joint path q(s) with the path parameter s from 0 to 1. Its k + 1 knots are values of s
        between which no joint reverses.
    rates : mapping of str to float
        Largest rates by the names of the limited task coordinates, rad/s and m/s.

    Returns
    -------
    (k,) array
        Largest ṡ between each pair of neighbouring knots, 1/s. Infinite without a limit.
    """
    knots = path.directions[0]
    ceiling = np.full(len(knots) - 1, np.inf)
    if not rates:
        return ceiling
    # PATH_SAMPLES values of s between each pair of neighbouring knots, (k, PATH_SAMPLES).
    s = knots[:-1, None] + np.linspace(0.0, 1.0, PATH_SAMPLES) * np.diff(knots)[:, None]
    samples = path.sample(s.ravel())
    slopes = np.abs(task_rates(path.mechanism, samples.q, samples.dq)).reshape(*s.shape, 4)
    for name, rate in rates.items():
        steepest = slopes[:, :, TASK_COORDINATES.index(name)].max(axis=1)
        # A coordinate that does not change imposes no limit.
        with np.errstate(divide="ignore"):
            ceiling = np.minimum(ceiling, rate / steepest)
    return ceiling


def _path_jerk_limits(robot: Robot, path: JointPath, s: Array) -> Array:
    """Compute the largest s⃛ that the jerk limits of the joints allow while ṡ is small.

    The jerk of joint i is q'_i s⃛ + 3 q''_i ṡ s̈ + q'''_i ṡ³, with primes for derivatives with
    respect to s. For small ṡ only the first term matters. This estimate suffices for the mesh.

    Parameters
    ----------
    robot : Robot
        The robot with its jerk limits.
    path : JointPath
        Joint path q(s) with the path parameter s from 0 to 1.
    s : (n,) array
        Path parameters.

    Returns
    -------
    (n,) array
        min_i jerk_i / |dq_i/ds|, 1/s³. Infinite where no joint moves.
    """
    with np.errstate(divide="ignore"):
        return np.asarray((joint_limits(robot)["jerk"] / np.abs(path.sample(s).dq)).min(axis=1))


def joint_polynomials(
    path: JointPath, elements: Array, subdivision: int, end_speed: float
) -> tuple[Array, Array]:
    """Convert a timing s(t) of a path to quintic polynomials of the joints.

    Each element (time interval, on which s is a cubic polynomial of time) is divided into pieces of
    equal duration. At both ends of a piece, the polynomials have exactly the q, q̇ and q̈ of the
    motion along the path. In between, they approximate it.

    Parameters
    ----------
    path : JointPath
        Joint path q(s) with the path parameter s from 0 to 1.
    elements : (n, 5) array
        s, ṡ, s̈ at the start, s̈ at the end and length of every element. Time is in seconds.
    subdivision : int
        Number of pieces of every element.
    end_speed : float
        ṡ at the end of the motion, 1/s.

    Returns
    -------
    breaks : (n · subdivision + 1,) array
        Start of the first piece, and ends of all pieces, s.
    coefficients : (n · subdivision, 6, 4) array
        Coefficients of the pieces by powers of the time since their start. The axes are piece,
        power and joint.
    """
    # s, ṡ and s̈ at the ends of all pieces of an element, (n, subdivision + 1).
    shares = np.linspace(0.0, 1.0, subdivision + 1)
    s, speed, acceleration = as_cubics(elements).evaluate(shares)
    s = np.clip(s, 0.0, 1.0)
    # The solver's values at the end contain rounding.
    s[-1, -1], speed[-1, -1] = 1.0, end_speed
    sample = path.sample(s.ravel())
    speed, acceleration = speed.reshape(-1, 1), acceleration.reshape(-1, 1)
    # With primes for derivatives with respect to s, q̇ = q' ṡ and q̈ = q'' ṡ² + q' s̈.
    qd = sample.dq * speed
    qdd = sample.ddq * speed**2 + sample.dq * acceleration
    states = [values.reshape(len(elements), -1, 4) for values in (sample.q, qd, qdd)]
    starts = tuple(values[:, :-1].reshape(-1, 4) for values in states)
    ends = tuple(values[:, 1:].reshape(-1, 4) for values in states)
    lengths = np.repeat(elements[:, 4] / subdivision, subdivision)
    breaks = np.append(0.0, np.cumsum(lengths))
    return breaks, quintic_coefficients(lengths, starts, ends)
