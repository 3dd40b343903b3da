"""Optimal control problem of a motion along a given path.

The unknown is the timing s(t) of the path parameter s, as cubic polynomials on the elements of a
mesh. The guess is the motion of TOPP-RA along the path, and the mesh follows its switching points.
Every joint keeps its direction between two reversals, so the sign of its friction is known.

`solve_straight` is the main entry. `joint_polynomials` converts a timing to joint polynomials, also
for motions that TOPP-RA alone times.
"""

from collections.abc import Mapping
from functools import cached_property

import numpy as np

from ssm_planner.dynamics import RigidBody
from ssm_planner.elements.element import shared_model
from ssm_planner.elements.rows import (
    UNLIMITED,
    RowName,
    joint_limits,
    limits_jerk,
    tool_limits,
    tool_row_names,
    torque_row_names,
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
    JointAcceleration,
    JointJerk,
    JointVelocity,
    Robot,
    ToolLimit,
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
"""Factor on the number of elements of a jerk-limited motion that Ipopt confirms."""
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
    """Compute the motion along a path that is best for the objective of a phase.

    Parameters
    ----------
    phase : Phase
        The phase with its problem, velocities at both ends and requested duration.
    path : JointPath
        The path q(s) of the joints.
    guess : Retiming
        Motion along the path whose timing TOPP-RA has computed on a grid of s.
    strict : Robot or None
        The robot with tighter limits, which the motion must keep. None: that of the problem.
    cooling : (4,) array or None
        Weights of the motors' heat relative to time, as in `rows.LIMIT_SIZES`.
    count : int or None
        Number of elements. None: chosen by the path.
    method : str
        Solution method: "Ipopt" alone, "structured" (the structured solver alone), "confirmed" (the
        structured solver, whose result Ipopt confirms), or "estimated" (only the duration counts).
    work : Work or None
        Counter of the computational work.

    Returns
    -------
    PhaseSolution
        Joint polynomials of the motion, or the status of the failure.
    """
    robot, limits, duration = phase.problem.robot, phase.problem.task_limits, phase.motion.duration
    # ṡ at both ends, 1/s.
    speeds = phase.speeds_along(path)
    jerk = limits_jerk(robot)
    knots, signs = path.directions
    # Number of elements, which grows with the number of smooth pieces of the path.
    elements_per_break = (
        ELEMENTS_PER_SPLINE_BREAK if isinstance(path, SplinePath) else MIN_ELEMENTS // 2
    )
    if count is None:
        finer = FINE_MESH_FACTOR if jerk and method == "confirmed" else 1
        count = finer * max(len(path.breaks) * elements_per_break, MIN_ELEMENTS)
    mesh = Mesh.from_retiming(
        guess, knots, count, _path_jerk_limits(robot, path, guess.s) if jerk else None
    )
    # Unit of time: the duration of the guess, or a lower bound if that is longer.
    scale = max(guess.duration, lower_bound(robot, path.sample(np.array([0.0, 1.0])).q))
    speed_limit = path_speed_limits(path, limits.rates) * scale
    # Each interval between two reversals is a segment and a block.
    sizes = tuple(np.bincount(mesh.interval).tolist())
    structure = NlpStructure(
        moves=((True,),) * len(sizes),
        segment_sizes=sizes,
        block_sizes=sizes,
        has_continuous_acceleration=jerk,
        velocity_limits=bool(speed_limit.min() < UNLIMITED),
        coordinates_are_joints=False,
    )
    problem = _StraightProblem(
        structure=structure,
        lengths=np.diff(mesh.instants) / mesh.instants[-1],
        joint_limits=joint_limits(strict or robot, cooling),
        time_scale=scale,
        method=method,
        directions=signs,
        robot=robot,
        path=path,
        limits_of_tool=limits.of_tool,
        speed_limit=speed_limit,
        end_speeds=np.array(speeds) * scale,
        starts_at_rest=np.full(4, speeds[0] == 0.0),
        work=work or Work(),
    )
    scaled_duration = None if duration is None else duration / scale
    fastest = find_fastest_motion(problem, mesh.elements(guess), scaled_duration)
    return problem.result(
        find_best_motion(fastest, phase.problem.objective, scaled_duration), speeds[1]
    )


def retimed_polynomials(
    path: JointPath, retiming: Retiming, end_speed: float
) -> tuple[Array, Array]:
    """Convert a motion of TOPP-RA to joint polynomials.

    In this motion, ṡ² is linear in s between grid points, so s̈ is constant there.

    Parameters
    ----------
    path : JointPath
        Joint path q(s) with the path parameter s from 0 to 1.
    retiming : Retiming
        Motion of TOPP-RA along the path, with n + 1 grid points.
    end_speed : float
        ṡ at the end, 1/s.

    Returns
    -------
    breaks : (n + 1,) array
        Ends of the pieces, s.
    coefficients : (n, 6, 4) array
        Coefficients of the pieces by powers of the time since their start.
    """
    accelerations = [retiming.acceleration, retiming.acceleration]
    states = [retiming.s[:-1], np.sqrt(retiming.speed_squared[:-1])]
    elements = np.column_stack([*states, *accelerations, np.diff(retiming.times)])
    return joint_polynomials(path, elements, 1, end_speed)


@keyword_record
class _StraightProblem(OcpProblem):
    """Optimal control problem of the timing s(t) along a path. Its only coordinate is s."""

    robot: Robot
    """The robot, with the true limits."""
    path: JointPath
    """The path q(s) of the joints."""
    limits_of_tool: tuple[ToolLimit, ...]
    """Limits of the tool: of its speeds and of the distance that it travels during a stop."""
    speed_limit: Array
    """Largest ṡ that the limited rates of task coordinates allow, in scaled time, (k,).

    There is one value for each interval between two knots of the path.
    """
    end_speeds: Array
    """ṡ at both ends, in scaled time, (2,)."""

    def result(self, solution: NlpSolution, end_speed: float) -> PhaseSolution:
        """Convert a solution of the program to joint polynomials in SI units.

        Parameters
        ----------
        solution : NlpSolution
            Solution in scaled time.
        end_speed : float
            ṡ at the end, 1/s. It replaces the solver's value, which contains rounding.

        Returns
        -------
        PhaseSolution
            The motion with `POLYNOMIALS_PER_ELEMENT` polynomials in each element, or the status and
            message of the failure.
        """
        if not solution.solved:
            return PhaseSolution.from_solver(solution)
        scale = self.time_scale
        # From scaled time to seconds.
        elements = solution.elements * np.array([1.0, 1 / scale, 1 / scale**2, 1 / scale**2, scale])
        breaks, coefficients = joint_polynomials(
            self.path, elements, POLYNOMIALS_PER_ELEMENT, end_speed
        )
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
        """Values of s at the reversals of joints, and ṡ at both ends, in scaled time."""
        knots, signs = self.path.directions
        return BoundaryConditions(
            knots[:, None], np.ones((len(signs), 1)), self.end_speeds[:1], self.end_speeds[1:]
        )

    @property
    def limits(self) -> tuple[Array, Array, Array]:
        """Limits of ṡ in each element (n, 1), and of s̈ and s⃛, (1,) each. The latter are infinite.

        The joints limit s̈ and s⃛ by path constraints.
        """
        return (
            self.speed_limit[self.structure.segment][:, None],
            np.array([np.inf]),
            np.array([np.inf]),
        )

    @cached_property
    def complete_element(self) -> StraightElement:
        """Functions of one element, with the path constraints of joints, motors and the tool.

        Joints that rest on the whole path have no constraints on velocity, acceleration and jerk.
        """
        moving = np.abs(self.path.coarse_samples.dq).max(axis=0) > 0
        rows: set[RowName] = set().union(*(torque_row_names(self.robot, i) for i in range(4)))
        for i in np.flatnonzero(moving):
            rows |= {(JointVelocity.name, int(i)), (JointAcceleration.name, int(i))}
            if self.robot.joints[i].jerk is not None:
                rows.add((JointJerk.name, int(i)))
        rows |= tool_row_names(self.limits_of_tool, np.flatnonzero(moving))
        return shared_model(
            StraightElement(robot=self.robot, jerk=limits_jerk(self.robot), active=frozenset(rows))
        )

    @cached_property
    def always_active(self) -> frozenset[RowName]:
        """Names of the jerk constraints, which are always part of the program.

        The guess of TOPP-RA ignores jerk, so it does not show which of them bind.
        """
        return frozenset(name for name in self.row_names if name[0] == JointJerk.name)

    def element_parameters(self, elements: Array) -> tuple[Array, ...]:
        """Return the constants with which the functions of the elements are evaluated.

        Parameters
        ----------
        elements : (n, 5) array
            Latest motion: s, ṡ, s̈ at the start, s̈ at the end, and length of each element.

        Returns
        -------
        tuple of arrays
            Directions σ (n, 4) of the joints, polynomials (n, size) that approximate the path near
            the elements (`path_fit.fit_path`), and limits (size,).
        """
        limits = StraightElement.layout.pack(
            **self.joint_limits, **tool_limits(self.limits_of_tool), time_scale=self.time_scale
        )
        starts = elements[:, 0]
        polynomials = fit_path(self.path, self._bodies, starts, np.append(starts[1:], 1.0))
        return self.sigma, polynomials, limits

    @cached_property
    def _bodies(self) -> tuple[RigidBody, ...]:
        """Rigid-body model of the arm with each load."""
        return tuple(RigidBody.from_robot(load) for load in self.robot.loads)


def path_speed_limits(path: JointPath, rates: Mapping[str, float]) -> Array:
    """Compute the largest ṡ that limited rates of task coordinates allow.

    Parameters
    ----------
    path : JointPath
        Joint path q(s) with the path parameter s from 0 to 1.
    rates : mapping of str to float
        Limited rates by the names of the task coordinates, rad/s and m/s.

    Returns
    -------
    (k,) array
        Largest ṡ between two knots of the path (reversals of joints), 1/s. `UNLIMITED` without a
        limit.
    """
    knots = path.directions[0]
    ceiling = np.full(len(knots) - 1, UNLIMITED)
    if not rates:
        return ceiling
    s = knots[:-1, None] + np.linspace(0.0, 1.0, PATH_SAMPLES) * np.diff(knots)[:, None]
    samples = path.sample(s.ravel())
    slopes = np.abs(task_rates(path.mechanism, samples.q, samples.dq)).reshape(*s.shape, 4)
    for name, rate in rates.items():
        steepest = slopes[:, :, TASK_COORDINATES.index(name)].max(axis=1)
        ceiling = np.minimum(ceiling, rate / np.maximum(steepest, rate / UNLIMITED))
    return ceiling


def _path_jerk_limits(robot: Robot, path: JointPath, s: Array) -> Array:
    """Return the largest s⃛ that the jerk limits of the joints allow while ṡ is small.

    The jerk of joint i is q'_i s⃛ + 3 q''_i ṡ s̈ + q'''_i ṡ³, with primes for derivatives with
    respect to s. For small ṡ, only the first term matters.

    Parameters
    ----------
    robot : Robot
        The robot.
    path : JointPath
        Joint path q(s) with the path parameter s from 0 to 1.
    s : (n,) array
        Path parameters.

    Returns
    -------
    (n,) array
        min_i jerk_i / |dq_i/ds|, 1/s³.
    """
    with np.errstate(divide="ignore"):
        return np.asarray((joint_limits(robot)["jerk"] / np.abs(path.sample(s).dq)).min(axis=1))


def joint_polynomials(
    path: JointPath, elements: Array, subdivision: int, end_speed: float
) -> tuple[Array, Array]:
    """Convert a timing s(t) to quintic joint polynomials.

    The polynomials have exact values of q, q̇ and q̈ at both ends of every piece.

    Parameters
    ----------
    path : JointPath
        Joint path q(s) with the path parameter s from 0 to 1.
    elements : (n, 5) array
        s, ṡ, s̈ at the start, s̈ at the end and length of every element. Time is in s.
    subdivision : int
        Number of pieces of every element.
    end_speed : float
        ṡ at the end, 1/s.

    Returns
    -------
    breaks : (m + 1,) array
        Ends of the m = n · subdivision pieces, s.
    coefficients : (m, 6, 4) array
        Coefficients of the pieces by powers of the time since their start.
    """
    lengths = elements[:, 4:]
    shares = np.arange(subdivision) / subdivision
    element_ends = np.concatenate([[0.0], np.cumsum(lengths)])
    breaks = np.append((element_ends[:-1, None] + lengths * shares).ravel(), element_ends[-1])
    ends = [
        _joint_motion_at(path, elements, shares + offset, end_speed)
        for offset in (0.0, 1.0 / subdivision)
    ]
    return breaks, quintic_coefficients(np.diff(breaks), ends[0], ends[1])


def _joint_motion_at(
    path: JointPath, elements: Array, shares: Array, end_speed: float
) -> tuple[Array, Array, Array]:
    """Evaluate q, q̇ and q̈ at given instants of every element.

    Parameters
    ----------
    path : JointPath
        Joint path q(s) with the path parameter s from 0 to 1.
    elements : (n, 5) array
        s, ṡ, s̈ at the start, s̈ at the end and length of every element.
    shares : (k,) array
        Instants as shares of the element's length. If the last one is 1, the motion ends exactly at
        s = 1 with `end_speed`.
    end_speed : float
        ṡ at the end, 1/s.

    Returns
    -------
    q, qd, qdd : (n k, 4) arrays
        Joint positions, velocities and accelerations.
    """
    s, speed, acceleration = (value.ravel() for value in as_cubics(elements).evaluate(shares))
    s = np.clip(s, 0.0, 1.0)
    if shares[-1] == 1.0:  # The end is exact. The solver's values contain rounding.
        s[-1], speed[-1] = 1.0, end_speed
    sample = path.sample(s)
    speed = speed[:, None]
    acceleration = acceleration[:, None]
    return sample.q, sample.dq * speed, sample.ddq * speed**2 + sample.dq * acceleration
