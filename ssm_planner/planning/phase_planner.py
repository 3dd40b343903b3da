"""Solvers for the motion of one phase.

Candidates ask these methods for motions: along a path or freely, by optimal control or by TOPP-RA
alone.
"""

from collections.abc import Callable
from dataclasses import field, replace
from functools import partial
from typing import Any

import numpy as np

from ssm_planner.elements.compiled import compiled_library
from ssm_planner.elements.rows import limits_jerk, with_margin
from ssm_planner.planning.motor_strength import check_motor_torque, explain_failure
from ssm_planner.planning.ocp.free import find_best_free, solve_free
from ssm_planner.planning.ocp.motion import Borders, PhaseSolution
from ssm_planner.planning.ocp.nlp import Method
from ssm_planner.planning.ocp.straight import solve_straight
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.planned_phase import PlannedPhase
from ssm_planner.planning.postprocess import GRID_MARGIN, limit_stop_travel, plan_by_toppra
from ssm_planner.planning.reason import Reason, constant_speed_reason, short_duration_reason
from ssm_planner.planning.retiming.paths import JointPath, PolylinePath, SplinePath, StraightPath
from ssm_planner.planning.retiming.retime import FAILURE, holds_tip_speed, retime
from ssm_planner.planning.tolerances import EQUALITY_TOLERANCE, GAP
from ssm_planner.planning.work import Work
from ssm_planner.problem import Follow, Problem, Robot, TipSpeed, unchecked_copy
from ssm_planner.typing import Array, record

METHODS: dict[str, Method] = {
    "optimal": "confirmed",
    "fast": "structured",
    "ipopt": "Ipopt",
    "toppra": "structured",
}
"""Solution methods by the name of the planner. "toppra" needs one for the motion to a table."""


@record
class PhasePlanner:
    """Requirements on the motion of a phase, and the solvers for it."""

    strict: Robot
    """The robot with the limits that the motion must keep.

    They may be tighter than those of the problem.
    """
    phase: Phase
    cooling: Array | None = None
    """Weights (4,) of the motors' heat relative to time. None: heat does not count."""
    approximate: bool = False
    """True if an estimate of the duration by the structured solver in few rounds suffices."""
    may_reverse: bool = True
    """True if joints may reverse where they need not."""
    work: Work = field(default_factory=Work)

    @property
    def problem(self) -> Problem:
        """Problem of the phase."""
        return self.phase.problem

    def with_problem(self, **changes: Any) -> "PhasePlanner":
        """Return a copy with changes of the problem."""
        problem = unchecked_copy(self.problem, **changes)
        return replace(self, phase=replace(self.phase, problem=problem))

    @property
    def without_duration(self) -> "PhasePlanner":
        """Copy that looks for the fastest motion, without a requested duration.

        Ipopt does not confirm it.
        """
        untimed = replace(self.phase, motion=unchecked_copy(self.phase.motion, duration=None))
        planner = "fast" if self.problem.planner == "optimal" else self.problem.planner
        return replace(self, phase=untimed).with_problem(objective="time", planner=planner)

    def along_path(self, path: JointPath) -> PlannedPhase | Reason:
        """Return the motion along a path, by optimal control or timed by TOPP-RA alone."""
        motion = self.phase.motion
        if isinstance(motion, Follow) and motion.constant_speed is not None:
            return self._at_constant_speed(path, motion.constant_speed)
        # Limits on task rates bound the speed point by point along a curve. Optimal control only
        # knows one bound between two turning points, so TOPP-RA is more accurate here.
        rated = bool(self.problem.rates) and self._may_be_retimed(path)
        samples = isinstance(path, SplinePath) and not path.pieces
        if self.problem.planner == "toppra" or samples or rated:
            return plan_by_toppra(self.phase, self.strict, path)
        return self._by_optimal_control(path)

    def free(
        self,
        borders: Borders | None = None,
        *,
        cutoff: float = np.inf,
        count: int | None = None,
        fastest_only: bool = False,
    ) -> PlannedPhase | Reason:
        """Return a motion whose path the solver chooses.

        Parameters
        ----------
        borders : Borders or None
            Where joints reverse, and a guess. None: only where they must.
        cutoff : float
            Duration in s beyond which a motion is not refined any further.
        count : int or None
            Number of elements. None: chosen by the kind of motion.
        fastest_only : bool
            Return the fastest motion as the first solver finds it. `best_free` makes it final.
        """
        phase = self.phase
        # Joints that already move need not break away, and may come from the other side.
        if phase.begins_and_ends_at_rest:
            reason = check_motor_torque(phase, self._direct_path)
            if reason is not None:
                return reason
        solve = partial(
            solve_free,
            phase,
            strict=self.strict,
            cooling=self.cooling,
            borders=borders,
            cutoff=cutoff,
            count=count,
            fastest_only=fastest_only,
            work=self.work,
        )
        guessed = borders is not None and borders.guess is not None
        motion = self._solve(solve, by_ipopt=not guessed)
        return self._free_result(motion)

    def best_free(self, fastest: PlannedPhase, cutoff: float) -> PlannedPhase | Reason:
        """Return the motion for the objective from a free motion with `fastest_only`."""
        return self._free_result(find_best_free(fastest.motion, cutoff))

    def _free_result(self, motion: PhaseSolution) -> PlannedPhase | Reason:
        """Return the phase with a free motion, from which the tip can always stop in time."""
        return self.phase_result(
            self._direct_path, limit_stop_travel(self.phase, self.strict, motion)
        )

    @property
    def _direct_path(self) -> JointPath:
        """Straight lines from point to point."""
        return PolylinePath(self.phase.mechanism, self.phase.points)

    def phase_result(self, path: JointPath, motion: PhaseSolution) -> PlannedPhase | Reason:
        """Return the phase with the motion of a solver.

        The result is a reason if the solver found no motion, or if the motion takes longer than
        requested.
        """
        if not motion.solved:
            if self.approximate:
                return Reason(message=motion.message)
            return explain_failure(self.phase, path, motion.message)
        duration = self.phase.motion.duration
        if duration is not None and motion.duration > duration * (1 + EQUALITY_TOLERANCE):
            return short_duration_reason(self.phase.motion.name, duration, motion.duration)
        return PlannedPhase(self.phase, motion, duration or self.phase.lower_bound)

    def _solve(
        self, solve: Callable[..., PhaseSolution], *, by_ipopt: bool = True
    ) -> PhaseSolution:
        """Solve by the structured solver, with the confirmation that the planner asks for.

        If it fails and `by_ipopt` is true, solve by Ipopt alone.
        """
        method: Method = "estimated" if self.approximate else METHODS[self.problem.planner]
        solution = solve(method=method if compiled_library() else "Ipopt")
        failed = not solution.solved and solution.solver == "structured"
        return solve(method="Ipopt") if failed and by_ipopt and not self.approximate else solution

    def _at_constant_speed(self, path: JointPath, speed: float) -> PlannedPhase | Reason:
        """Return a motion that reaches a constant tip speed, m/s, and leaves it as fast as it can.

        If other limits do not allow that speed, a bisection finds the largest one that they allow.
        """

        def with_tip_speed(limit_speed: float) -> "PhasePlanner":
            return self.with_problem(limits=(*self.problem.limits, TipSpeed(limit_speed)))

        def is_feasible(limit_speed: float) -> bool:
            limits = with_tip_speed(limit_speed).problem.task_limits
            robot = with_margin(self.strict, GRID_MARGIN)
            retiming = retime(path, robot, limits)
            return retiming.solved and holds_tip_speed(retiming, path, limit_speed)

        if is_feasible(speed):
            return plan_by_toppra(with_tip_speed(speed).phase, self.strict, path)
        slow, fast = 0.0, speed
        while fast - slow > GAP * speed:
            middle = (slow + fast) / 2
            slow, fast = (middle, fast) if is_feasible(middle) else (slow, middle)
        return constant_speed_reason(self.phase.motion.name, speed, slow)

    def _by_optimal_control(self, path: JointPath) -> PlannedPhase | Reason:
        """Return a motion along a path by optimal control. The guess is the motion of TOPP-RA."""
        problem = self.problem
        speeds = self.phase.speeds_along(path)
        retiming = retime(path, problem.robot, problem.task_limits, speeds)
        if not retiming.solved:
            return explain_failure(self.phase, path, FAILURE)
        solve = partial(
            solve_straight,
            self.phase,
            path,
            retiming,
            strict=self.strict,
            cooling=self.cooling,
            work=self.work,
        )
        result = self.phase_result(path, self._solve(solve))
        if isinstance(result, Reason) and self._may_be_retimed(path):
            return plan_by_toppra(self.phase, self.strict, path)
        return result

    def _may_be_retimed(self, path: JointPath) -> bool:
        """Return True if TOPP-RA alone may time the path.

        This holds for curves and rounded corners without a requested duration and without jerk
        limits.
        """
        curved = not isinstance(path, StraightPath)
        return curved and self.phase.motion.duration is None and not limits_jerk(self.problem.robot)
