"""Optimal control problem of a phase along a given path: its timing s(t) in cubic elements.

The guess is the motion of TOPP-RA along the path, and the mesh follows its switching points. Every
joint keeps its direction between reversals, so the friction law is exact. `joint_pieces` converts
s(t) to joint polynomials.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np

from ssm_planner.dynamics import RigidBody
from ssm_planner.elements.element import shared
from ssm_planner.elements.rows import (
    UNLIMITED,
    RowName,
    joint_limits,
    limits_jerk,
    tool_limits,
    tool_names,
    torque_names,
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
    cubics,
)
from ssm_planner.planning.ocp.objectives import find_best_motion, find_fastest_motion
from ssm_planner.planning.ocp.path_fit import fit
from ssm_planner.planning.ocp.problem import OcpProblem
from ssm_planner.planning.retiming.paths import JointPath, SplinePath, StraightPath
from ssm_planner.planning.retiming.retime import Retiming
from ssm_planner.planning.tolerances import SAMPLES
from ssm_planner.planning.work import Work
from ssm_planner.problem import (
    TASK,
    JointAcceleration,
    JointJerk,
    JointVelocity,
    Objective,
    Robot,
    TaskLimits,
    ToolLimit,
)
from ssm_planner.trajectory import hermite
from ssm_planner.typing import Array, keyword_record

ELEMENTS = 84
"""Number of elements of a smooth path.

A path with rounded corners has half as many for every end of a rounding.
"""
OF_PIECE = 18
"""Number of elements of every piece of a spline."""
FINER = 3
"""Factor on the number of elements of a jerk-limited motion that Ipopt confirms."""
SUBDIVISION = 4
"""Quintic pieces per element. The path between their ends is then followed to about 1e-9 rad."""


def solve_straight(
    robot: Robot,
    path: JointPath,
    guess: Retiming,
    *,
    limits: TaskLimits = TaskLimits(),  # noqa: B008  frozen
    strict: Robot | None = None,
    cooling: Array | None = None,
    objective: Objective = "time",
    duration: float | None = None,
    speeds: tuple[float, float] = (0.0, 0.0),
    count: int | None = None,
    method: Method = "Ipopt",
    work: Work | None = None,
) -> PhaseSolution:
    """Return the motion along a path that is best for an objective.

    Parameters
    ----------
    robot : Robot
        The robot.
    path : JointPath
        The path.
    guess : Retiming
        Motion of TOPP-RA along the path.
    limits : TaskLimits
        Limits on the tool and on task rates.
    strict : Robot or None
        The robot with tighter limits, which the motion must keep.
    cooling : (4,) array or None
        Weights of the motors' heat relative to time, as in `rows.LIMITS`.
    objective : str
        "time", "time then heat" or "effort".
    duration : float or None
        Requested duration, s.
    speeds : (float, float)
        ṡ at both ends, 1/s.
    count : int or None
        Number of elements. None: chosen by the path.
    method : str
        Solution method, see `nlp.Method`.
    work : Work or None
        Counter of the work.

    Returns
    -------
    PhaseSolution
        Joint polynomials, or the status of the failure.
    """
    jerk = limits_jerk(robot)
    knots, signs = path.directions
    per_piece = OF_PIECE if isinstance(path, SplinePath) else ELEMENTS // 2
    if count is None:
        finer = FINER if jerk and method == "confirmed" else 1
        count = finer * max(len(path.breaks) * per_piece, ELEMENTS)
    mesh = Mesh.from_retiming(
        guess, knots, count, _path_jerk(robot, path, guess.s) if jerk else None
    )
    scale = max(guess.duration, lower_bound(robot, path.sample(np.array([0.0, 1.0])).q))
    speed_limit = rate_ceiling(path, limits.rates) * scale
    problem = _StraightProblem(
        structure=_structure(
            mesh, smooth=jerk, velocity_limits=bool(speed_limit.min() < UNLIMITED)
        ),
        lengths=np.diff(mesh.instants) / mesh.instants[-1],
        joint_limits=joint_limits(strict or robot, cooling),
        time_scale=scale,
        method=method,
        directions=signs,
        robot=robot,
        path=path,
        limited=limits.of_tool,
        speed_limit=speed_limit,
        speeds=np.array(speeds) * scale,
        starting=np.full(4, speeds[0] == 0.0),
        work=work or Work(),
    )
    takes = None if duration is None else duration / scale
    fastest = find_fastest_motion(problem, mesh.elements(guess), takes)
    return problem.result(find_best_motion(fastest, objective, takes), speeds[1])


def retimed_pieces(path: JointPath, retiming: Retiming, end_speed: float) -> tuple[Array, Array]:
    """Return the joint polynomials of TOPP-RA's motion: breaks (n + 1,) and coefficients (n, 6, 4).

    ṡ² is linear in s between grid points, so s̈ is constant there.
    """
    s, speed = retiming.s, np.sqrt(retiming.speed_squared)
    acceleration = np.diff(retiming.speed_squared) / (2 * np.diff(s))
    elements = np.column_stack(
        [s[:-1], speed[:-1], acceleration, acceleration, np.diff(retiming.times)]
    )
    return joint_pieces(path, elements, 1, end_speed)


def _structure(mesh: Mesh, *, smooth: bool, velocity_limits: bool) -> NlpStructure:
    """Return the structure of a program on a mesh."""
    sizes = mesh.interval_sizes
    return NlpStructure(
        moves=((True,),) * len(sizes),
        segment_sizes=sizes,
        block_sizes=sizes,
        smooth=smooth,
        velocity_limits=velocity_limits,
        joints=False,
    )


@keyword_record
class _StraightProblem(OcpProblem):
    """Optimal control problem of the timing s(t) along a path."""

    robot: Robot
    path: JointPath
    limited: tuple[ToolLimit, ...]
    speed_limit: Array
    """Largest ṡ within the rates of task coordinates between the knots, in scaled time, (k,)."""
    speeds: Array
    """ṡ at both ends, in scaled time, (2,)."""

    def result(self, solution: NlpSolution, end_speed: float) -> PhaseSolution:
        """Return the solution as joint polynomials. It ends with ṡ = `end_speed`, 1/s."""
        if not solution.solved:
            return PhaseSolution(
                solution.status, solution.message, solution.iterations, solver=solution.solver
            )
        scale = self.time_scale
        elements = solution.elements * np.array([1.0, 1 / scale, 1 / scale**2, 1 / scale**2, scale])
        breaks, coefficients = joint_pieces(self.path, elements, SUBDIVISION, end_speed)
        positions = np.append(elements[:, 0], 1.0)
        borders = np.interp(self.path.directions[0], positions, breaks[::SUBDIVISION])
        return PhaseSolution(
            "solved",
            solution.message,
            solution.iterations,
            breaks,
            coefficients,
            solver=solution.solver,
            border_instants=borders,
            confirmation=solution.confirmation,
        )

    @property
    def boundary(self) -> BoundaryConditions:
        """Boundary conditions of s."""
        knots, signs = self.path.directions
        return BoundaryConditions(
            knots[:, None], np.ones((len(signs), 1)), self.speeds[:1], self.speeds[1:]
        )

    @property
    def limits(self) -> tuple[Array, Array, Array]:
        """Limits of ṡ, s̈ and s⃛, (1,) each, for every segment."""
        return (
            self.speed_limit[self.structure.segment][:, None],
            np.array([np.inf]),
            np.array([np.inf]),
        )

    @cached_property
    def complete_element(self) -> StraightElement:
        """Element model with the rows of moving joints and of existing limits."""
        moving = np.abs(self.path.overview.dq).max(axis=0) > 0
        rows: set[RowName] = set().union(*(torque_names(self.robot, i) for i in range(4)))
        for i in np.flatnonzero(moving):
            rows |= {(JointVelocity.name, int(i)), (JointAcceleration.name, int(i))}
            if self.robot.joints[i].jerk is not None:
                rows.add((JointJerk.name, int(i)))
        rows |= tool_names(self.limited, np.flatnonzero(moving))
        return shared(
            StraightElement(robot=self.robot, jerk=limits_jerk(self.robot), active=frozenset(rows))
        )

    @cached_property
    def always_active(self) -> frozenset[RowName]:
        """Jerk rows, because the guess of TOPP-RA ignores jerk."""
        return frozenset(name for name in self.row_names if name[0] == JointJerk.name)

    def element_parameters(self, elements: Array) -> tuple[Array, ...]:
        """Return σ, the fits around the elements, and the limits."""
        limits = StraightElement.layout.pack(
            **self.joint_limits, **tool_limits(self.limited), time_scale=self.time_scale
        )
        low = elements[:, 0]
        fits = fit(self.path, self._bodies, low, np.append(low[1:], 1.0))
        return self.sigma, fits, limits

    @cached_property
    def _bodies(self) -> tuple[RigidBody, ...]:
        """Bodies with every load."""
        return tuple(RigidBody.from_robot(load) for load in self.robot.loads)


def rate_ceiling(path: JointPath, rates: Mapping[str, float]) -> Array:
    """Return the largest ṡ (k,) within the task rates between two knots of the path, 1/s."""
    knots = path.directions[0]
    if isinstance(path, StraightPath) or not rates:
        slopes = (
            np.abs(path.end - path.start)[None, None]
            if isinstance(path, StraightPath)
            else np.zeros((1, 1, 4))
        )
    else:
        s = knots[:-1, None] + np.linspace(0.0, 1.0, SAMPLES) * np.diff(knots)[:, None]
        samples = path.sample(s.ravel())
        slopes = np.abs(task_rates(path.mechanism, samples.q, samples.dq)).reshape(*s.shape, 4)
    ceilings = [np.full((len(slopes), 1), UNLIMITED)]
    with np.errstate(divide="ignore"):
        ceilings += [rate / slopes[:, :, TASK.index(name)] for name, rate in rates.items()]
    ceiling = np.minimum(np.hstack(ceilings).min(axis=1), UNLIMITED)
    return np.asarray(np.broadcast_to(ceiling, (len(knots) - 1,)))


def _path_jerk(robot: Robot, path: JointPath, s: Array) -> Array:
    """Return the largest s⃛ that the jerk limits of the joints allow at low speed, (n,)."""
    with np.errstate(divide="ignore"):
        return np.asarray((joint_limits(robot)["jerk"] / np.abs(path.sample(s).dq)).min(axis=1))


def joint_pieces(
    path: JointPath, elements: Array, subdivision: int, end_speed: float
) -> tuple[Array, Array]:
    """Return quintic joint polynomials that follow the path.

    q, q̇ and q̈ are exact at both ends of every piece.

    Parameters
    ----------
    path : JointPath
        The path.
    elements : (n, 5) array
        s, ṡ, s̈ at the start, s̈ at the end and length of every element, in 1 and s.
    subdivision : int
        Number of pieces of every element.
    end_speed : float
        ṡ at the end, 1/s.

    Returns
    -------
    breaks : (m + 1,) array
        Ends of the pieces, s.
    coefficients : (m, 6, 4) array
        Coefficients of the pieces.
    """
    lengths = elements[:, 4:]
    share = np.arange(subdivision) / subdivision
    starts = np.concatenate([[0.0], np.cumsum(lengths)])
    breaks = np.append((starts[:-1, None] + lengths * share).ravel(), starts[-1])
    ends = [
        _joint_state(path, elements, share + offset, end_speed)
        for offset in (0.0, 1.0 / subdivision)
    ]
    return breaks, hermite(breaks, ends[0], ends[1])


def _joint_state(
    path: JointPath, elements: Array, share: Array, end_speed: float
) -> tuple[Array, Array, Array]:
    """Return q, q̇ and q̈ at the given shares of every element, (n · shares, 4) each."""
    s, speed, acceleration = (value.ravel() for value in cubics(elements).evaluate(share))
    s = np.clip(s, 0.0, 1.0)
    if share[-1] == 1.0:  # Removes the rounding of the solver.
        s[-1], speed[-1] = 1.0, end_speed
    sample = path.sample(s)
    speed = speed[:, None]
    acceleration = acceleration[:, None]
    return sample.q, sample.dq * speed, sample.ddq * speed**2 + sample.dq * acceleration
