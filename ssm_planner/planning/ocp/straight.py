"""The optimal control problem of one phase along a given path: when to be where, s(t) in cubic elements.

The guess is TOPP-RA's motion along the same path, and the mesh is aligned with its switching points. Between turning points
every joint keeps its direction, so the friction law enters exactly. `joint_pieces` makes joint polynomials of s(t).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.kinematics.task import task_rates
from ssm_planner.planning.lower_bound import lower_bound
from ssm_planner.planning.ocp.constraints import (
    UNLIMITED,
    RowName,
    joint_limits,
    limits_jerk,
    tool_limits,
    tool_names,
    torque_names,
)
from ssm_planner.planning.ocp.element import shared
from ssm_planner.planning.ocp.mesh import Mesh
from ssm_planner.planning.ocp.models import StraightElement, fit, fit_of, fits_hold
from ssm_planner.planning.ocp.nlp import (
    BoundaryConditions,
    Guess,
    Method,
    NlpSolution,
    NlpStructure,
    PhaseSolution,
    cubics,
)
from ssm_planner.planning.ocp.refinement import OcpProblem, optimise
from ssm_planner.planning.retiming.paths import JointPath, SplinePath, StraightPath
from ssm_planner.planning.retiming.retime import Retiming
from ssm_planner.problem.limits import TASK, JointAcceleration, JointJerk, JointVelocity, ToolLimit
from ssm_planner.problem.problem import Objective, TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import hermite
from ssm_planner.typing import Array

ELEMENTS = 72
"""Of a smooth path; of one whose corners are rounded half as many for every end of a rounding too."""
OF_PIECE = 18
"""Of every piece of a spline."""
FINER = 2
"""Times as many where jerk is limited, on the mesh made for the motion found first."""
SUBDIVISION = 4
"""Quintic pieces per element: the path between their ends is then followed to about 1e-9 rad."""
LOOKS = 101
"""Points between two knots at which rates of task coordinates are looked at."""


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
) -> PhaseSolution:
    """Motion along the path, from TOPP-RA's motion as guess.

    strict: the robot with stricter limits on its joints, which the motion is to keep; None: its own.
    cooling: as in constraints.LIMITS, (4,).
    duration: asked for, s; speeds: ṡ at both ends, 1/s. count: of elements. method: by which solver.
    """
    jerk = limits_jerk(robot)
    knots, signs = path.directions
    each = OF_PIECE if isinstance(path, SplinePath) else ELEMENTS // 2
    count = count or max(len(path.breaks) * each, ELEMENTS)
    mesh = Mesh.along(guess, knots, count, _path_jerk(robot, path, guess.s) if jerk else None)
    scale = max(guess.duration, lower_bound(robot, path.sample(np.array([0.0, 1.0])).q))
    fastest = rate_ceiling(path, limits.rates) * scale
    problem = _StraightProblem(
        structure=_structure(mesh, smooth=jerk, velocity_limits=bool(fastest.min() < UNLIMITED)),
        fractions=mesh.fractions,
        times=mesh.times,
        joint_limits=joint_limits(strict or robot, cooling),
        time_scale=scale,
        method=method,
        directions=signs,
        robot=robot,
        path=path,
        limited=limits.of_tool,
        fastest=fastest,
        speeds=np.array(speeds) * scale,
        starting=np.full(4, speeds[0] == 0.0),
    )
    begin = Guess(mesh.elements(guess), mesh.times)
    solution = optimise(problem, begin, objective, None if duration is None else duration / scale)
    if not solution.solved:
        return PhaseSolution(
            solution.status, solution.message, solution.iterations, solver=solution.solver
        )
    elements = solution.elements * np.array([1.0, 1 / scale, 1 / scale**2, 1 / scale**2, scale])
    breaks, coefficients = joint_pieces(path, elements, SUBDIVISION, speeds[1])
    borders = np.interp(knots, np.append(elements[:, 0], 1.0), breaks[::SUBDIVISION])
    return PhaseSolution(
        "solved",
        solution.message,
        solution.iterations,
        breaks,
        coefficients,
        solver=solution.solver,
        borders=borders,
        confirmation=solution.confirmation,
    )


def retimed_pieces(path: JointPath, retiming: Retiming, end_speed: float) -> tuple[Array, Array]:
    """`joint_pieces` of TOPP-RA's motion: breaks (n + 1,) and coefficients (n, 6, 4).

    Between its grid points ṡ² is linear in s, so that s̈ is constant.
    """
    s, speed = retiming.s, np.sqrt(retiming.speed_squared)
    acceleration = np.diff(retiming.speed_squared) / (2 * np.diff(s))
    elements = np.column_stack(
        [s[:-1], speed[:-1], acceleration, acceleration, np.diff(retiming.times)]
    )
    return joint_pieces(path, elements, 1, end_speed)


def _structure(mesh: Mesh, *, smooth: bool, velocity_limits: bool) -> NlpStructure:
    """Of elements on a mesh."""
    sizes = mesh.interval_sizes
    return NlpStructure(
        moves=((True,),) * len(sizes),
        segment_sizes=sizes,
        block_sizes=sizes,
        smooth=smooth,
        velocity_limits=velocity_limits,
        joints=False,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _StraightProblem(OcpProblem):
    robot: Robot
    path: JointPath
    limited: tuple[ToolLimit, ...]
    fastest: Array
    """Largest ṡ that the rates of the task coordinates allow between the knots, in scaled time, (k,)."""
    speeds: Array
    """ṡ at both ends, in scaled time, (2,)."""

    @property
    def boundary(self) -> BoundaryConditions:
        knots, signs = self.path.directions
        return BoundaryConditions(
            knots[:, None], np.ones((len(signs), 1)), self.speeds[:1], self.speeds[1:]
        )

    @property
    def limits(self) -> tuple[Array, Array, Array]:
        return self.fastest[self.structure.segment][:, None], np.array([np.inf]), np.array([np.inf])

    def remeshed(self, solution: NlpSolution) -> tuple[OcpProblem, Guess] | None:
        """With jerk limits: constant within an element, the jerk falls short of a limit that changes there."""
        if not self.structure.smooth or self.method != "confirmed":
            return None
        mesh = Mesh.on(solution.elements, self.structure.segment, FINER * self.structure.elements)
        times = mesh.times * mesh.instants[-1]
        structure = _structure(mesh, smooth=True, velocity_limits=self.structure.velocity_limits)
        problem = replace(self, structure=structure, fractions=mesh.fractions, times=times)
        return problem, Guess(mesh.moved(solution.elements), times)

    @cached_property
    def complete_element(self) -> StraightElement:
        """With the rows of what moves and has a limit."""
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
        """Jerk: TOPP-RA's motion has none."""
        return frozenset(name for name in self.row_names if name[0] == JointJerk.name)

    def element_parameters(self, elements: Array) -> tuple[Array, ...]:
        limits = StraightElement.layout.pack(
            **self.joint_limits, **tool_limits(self.limited), time_scale=self.time_scale
        )
        return self.sigma, self._fitted(elements), limits

    @cached_property
    def _bodies(self) -> tuple[RigidBody, ...]:
        return tuple(RigidBody.from_robot(load) for load in self.robot.loads)

    @cached_property
    def _fits(self) -> Array:
        return np.full((self.structure.elements, fit_of(len(self._bodies)).size), np.nan)

    def _fitted(self, elements: Array) -> Array:
        """Fits of path and load around these elements, (n, size of `fit_of`); renewed where elements have left theirs."""
        low, high = elements[:, 0], np.append(elements[1:, 0], 1.0)
        left = np.logical_not(fits_hold(self._fits, low, high))
        if left.any():
            self._fits[left] = fit(self.path, self._bodies, low[left], high[left])
        return self._fits


def rate_ceiling(path: JointPath, rates: Mapping[str, float]) -> Array:
    """Largest ṡ at which every task coordinate keeps its rate between two knots of the path, (k,), 1/s."""
    knots = path.directions[0]
    if isinstance(path, StraightPath) or not rates:
        ways = (
            np.abs(path.end - path.start)[None, None]
            if isinstance(path, StraightPath)
            else np.zeros((1, 1, 4))
        )
    else:
        s = knots[:-1, None] + np.linspace(0.0, 1.0, LOOKS) * np.diff(knots)[:, None]
        samples = path.sample(s.ravel())
        ways = np.abs(task_rates(path.mechanism, samples.q, samples.dq)).reshape(*s.shape, 4)
    fastest = [np.full((len(ways), 1), UNLIMITED)]
    with np.errstate(divide="ignore"):
        fastest += [rate / ways[:, :, TASK.index(name)] for name, rate in rates.items()]
    ceiling = np.minimum(np.hstack(fastest).min(axis=1), UNLIMITED)
    return np.asarray(np.broadcast_to(ceiling, (len(knots) - 1,)))


def _path_jerk(robot: Robot, path: JointPath, s: Array) -> Array:
    """Largest s⃛ that the jerk limits of the joints allow at low speed, (n,)."""
    with np.errstate(divide="ignore"):
        return np.asarray((joint_limits(robot)["jerk"] / np.abs(path.sample(s).dq)).min(axis=1))


def joint_pieces(
    path: JointPath, elements: Array, subdivision: int, end_speed: float
) -> tuple[Array, Array]:
    """Quintic joint polynomials that follow the path: exact q, q̇, q̈ at both ends of every piece.

    elements: s, ṡ, s̈ at the start, s̈ at the end and length of every element, (n, 5), s; each gives `subdivision` pieces.
    end_speed: ṡ at the end, 1/s. Returns breaks (m + 1,) and coefficients (m, 6, 4).
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
    """q, q̇, q̈ at the given shares of every element, (n · shares, 4) each."""
    s, speed, acceleration = (value.ravel() for value in cubics(elements).at(share))
    s = np.clip(s, 0.0, 1.0)
    if share[-1] == 1.0:  # without the solver's rounding
        s[-1], speed[-1] = 1.0, end_speed
    at, speed, acceleration = path.sample(s), speed[:, None], acceleration[:, None]
    return at.q, at.dq * speed, at.ddq * speed**2 + at.dq * acceleration
