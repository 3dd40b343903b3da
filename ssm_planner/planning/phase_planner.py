"""Solvers for the motion of one phase, that is, of one entry of the motion list.

The different ways to move a phase (candidates) ask a `PhasePlanner` for motions: along a given path
(`along_path`) or along a path that the solver chooses (`free`). The planner selects optimal control
or TOPP-RA, which only times a given path. It calls Ipopt where the structured solver (the faster
solver of this package) fails, and turns every failure into a `Reason`.
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
from ssm_planner.planning.ocp.straight import retimed_polynomials, solve_straight
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.planned_phase import PlannedPhase
from ssm_planner.planning.postprocess import GRID_MARGIN, limit_stop_travel
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
"""Solution method of optimal control for each value of the key `planner` of a problem.

The planner "toppra" also needs one, because TOPP-RA cannot plan a free motion, such as the one to
the first point of a table.
"""


@record
class PhasePlanner:
    """Requirements on the motion of a phase, and the solvers for it.

    A phase is an entry of the motion list with its joint positions. Each way to move it (candidate)
    calls `along_path` for a motion along a given path, or `free` for one whose path the solver
    chooses.
    """

    strict: Robot
    """Robot with the limits that the motion must keep.

    After a failed check they are stricter than those of the problem (`pipeline/certified.py`).
    """
    phase: Phase
    """Phase to be planned."""
    cooling: Array | None = None
    """Weights of the heat of the motors, (4,). None: heat does not count.

    A weight is the duration in s that is worth one second of a motor at its nominal torque.
    """
    approximate: bool = False
    """True if an estimate of the duration suffices.

    The structured solver then computes the motion in few rounds, without an attempt by Ipopt.
    """
    may_reverse: bool = True
    """True if joints may reverse where they need not, to save time."""
    work: Work = field(default_factory=Work)
    """Counter of the work of all solvers."""

    @property
    def problem(self) -> Problem:
        """Problem of the phase."""
        return self.phase.problem

    def with_problem(self, **changes: Any) -> "PhasePlanner":
        """Return a copy whose problem has some fields changed.

        Parameters
        ----------
        **changes
            New values by the name of the field of `Problem`. They are not validated.
        """
        problem = unchecked_copy(self.problem, **changes)
        return replace(self, phase=replace(self.phase, problem=problem))

    @property
    def without_duration(self) -> "PhasePlanner":
        """Copy that plans the fastest motion of the phase, for any requested duration.

        Ipopt does not confirm the motion.
        """
        untimed = replace(self.phase, motion=unchecked_copy(self.phase.motion, duration=None))
        planner = "fast" if self.problem.planner == "optimal" else self.problem.planner
        return replace(self, phase=untimed).with_problem(objective="time", planner=planner)

    def along_path(self, path: JointPath) -> PlannedPhase | Reason:
        """Return the motion along a path, by optimal control or with the timing of TOPP-RA alone.

        TOPP-RA alone times motions at a constant speed, tables of points, splines that need no
        optimal control (`Problem.by_optimal_control`), and curves with limits on rates of task
        coordinates. It times all paths if the problem asks for the planner "toppra".

        Parameters
        ----------
        path : JointPath
            The path. It may differ from the path of the phase, because a candidate (way to
            move the phase) may choose another one (`candidates/task_line.py`).

        Returns
        -------
        PlannedPhase or Reason
            The phase (entry of the motion list) with its motion, or the reason why planning failed.
        """
        motion = self.phase.motion
        if isinstance(motion, Follow) and motion.constant_speed is not None:
            return self._at_constant_speed(path, motion.constant_speed)
        # Along a curve, limits on task rates bound the speed at every point by another value.
        # Optimal control uses one bound between two turning points, so TOPP-RA is more accurate.
        rated = bool(self.problem.rates) and self._toppra_suffices(path)
        # A spline that is not divided into its cubic pieces is left to TOPP-RA.
        is_table = isinstance(path, SplinePath) and not path.pieces
        if self.problem.planner == "toppra" or is_table or rated:
            return self._by_toppra(path)
        return self._by_optimal_control(path)

    def free(
        self,
        borders: Borders | None = None,
        *,
        cutoff: float = np.inf,
        count: int | None = None,
        fastest_only: bool = False,
    ) -> PlannedPhase | Reason:
        """Return a motion of the phase whose path the solver chooses.

        Parameters
        ----------
        borders : Borders or None
            Positions at which joints may reverse, with a guess. None: joints may only reverse at
            the points of the phase.
        cutoff : float
            Duration in s. A motion that takes longer is returned without further refinement.
        count : int or None
            Number of elements (time intervals) of the mesh. None: the solver chooses it by the kind
            of motion.
        fastest_only : bool
            True for the fastest motion as the first solver finds it, without Ipopt's confirmation
            and without reducing heat. `best_free` continues from such a motion.

        Returns
        -------
        PlannedPhase or Reason
            The phase (entry of the motion list) with its motion, or the reason why planning failed.
        """
        phase = self.phase
        # The test assumes that joints start from rest and move towards their targets. A joint that
        # already moves need not break away, and may reach its target from the other side.
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
        # Borders with a guess stem from the search for reversals. If the structured solver fails
        # with them, they are given up without an attempt by Ipopt.
        has_guess = borders is not None and borders.guess is not None
        return self._free_result(self._solve(solve, by_ipopt=not has_guess))

    def best_free(self, fastest: PlannedPhase, cutoff: float) -> PlannedPhase | Reason:
        """Complete the fastest free motion to the motion for the objective of the problem.

        Parameters
        ----------
        fastest : PlannedPhase
            Result of `free` with `fastest_only`.
        cutoff : float
            Duration in s. A motion that takes longer is returned without further refinement.

        Returns
        -------
        PlannedPhase or Reason
            The phase (entry of the motion list) with its motion, or the reason why planning failed.
        """
        return self._free_result(find_best_free(fastest.motion, cutoff))

    def _free_result(self, motion: PhaseSolution) -> PlannedPhase | Reason:
        """Return the phase with a free motion, slowed down where the tip could not stop in time.

        Parameters
        ----------
        motion : PhaseSolution
            Result of the solver: a motion, or the status of a failure.

        Returns
        -------
        PlannedPhase or Reason
            The phase (entry of the motion list) with its motion, or the reason why planning failed.
        """
        return self.phase_result(
            self._direct_path, limit_stop_travel(self.phase, self.strict, motion)
        )

    @property
    def _direct_path(self) -> JointPath:
        """Straight lines in joint space from point to point of the phase."""
        return PolylinePath(self.phase.mechanism, self.phase.points)

    def phase_result(self, path: JointPath, motion: PhaseSolution) -> PlannedPhase | Reason:
        """Return the phase with the motion of a solver, or the reason why it has none.

        A reason means that the solver found no motion, or that the motion takes longer than
        requested.

        Parameters
        ----------
        path : JointPath
            Path of the motion, or the direct path of a free motion. It is only used to find the
            cause of a failure.
        motion : PhaseSolution
            Result of the solver.

        Returns
        -------
        PlannedPhase or Reason
            The phase with the motion and a lower bound on its duration, or the reason.
        """
        if not motion.solved:
            # An estimate only serves to compare durations, so the cause is not needed.
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
        """Solve with the method of the problem's planner, and by Ipopt alone if this fails.

        Parameters
        ----------
        solve : callable
            Computes a motion. Its keyword `method` selects the solution method (`nlp.Method`).
        by_ipopt : bool
            False if Ipopt does not get the second attempt. An estimate never gets one.

        Returns
        -------
        PhaseSolution
            The solution of the last attempt. The field `status` states whether it has a motion.
        """
        method: Method = "estimated" if self.approximate else METHODS[self.problem.planner]
        # The structured solver needs compiled code. Without it, Ipopt solves alone.
        solution = solve(method=method if compiled_library() else "Ipopt")
        failed = not solution.solved and solution.solver == "structured"
        return solve(method="Ipopt") if failed and by_ipopt and not self.approximate else solution

    def _at_constant_speed(self, path: JointPath, speed: float) -> PlannedPhase | Reason:
        """Return a motion whose tip reaches a given speed, and keeps it until it has to slow down.

        The requested speed becomes a limit on the tip speed, and TOPP-RA times the path within all
        limits. If another limit prevents the tip from keeping the speed, a bisection finds the
        largest speed that it can keep. The reason states this speed.

        Parameters
        ----------
        path : JointPath
            Joint path q(s) with the path parameter s from 0 to 1.
        speed : float
            Requested speed of the tip, m/s.

        Returns
        -------
        PlannedPhase or Reason
            The phase with its motion. A reason with the largest speed that the tip can keep if this
            is less than the requested one.
        """

        def with_tip_speed(limit_speed: float) -> "PhasePlanner":
            """Return a copy whose problem limits the speed of the tip, m/s."""
            return self.with_problem(limits=(*self.problem.limits, TipSpeed(limit_speed)))

        def is_feasible(limit_speed: float) -> bool:
            """Return True if the tip can keep a speed (m/s) when this speed is its limit."""
            limits = with_tip_speed(limit_speed).problem.task_limits
            robot = with_margin(self.strict, GRID_MARGIN)
            retiming = retime(path, robot, limits)
            return retiming.solved and holds_tip_speed(retiming, path, limit_speed)

        if is_feasible(speed):
            return with_tip_speed(speed)._by_toppra(path)
        # The tip can keep the speed `slow`, and not the speed `fast`.
        slow, fast = 0.0, speed
        while fast - slow > GAP * speed:
            middle = (slow + fast) / 2
            slow, fast = (middle, fast) if is_feasible(middle) else (slow, middle)
        return constant_speed_reason(self.phase.motion.name, speed, slow)

    def _by_optimal_control(self, path: JointPath) -> PlannedPhase | Reason:
        """Return a motion along a path by optimal control. Its guess is the motion of TOPP-RA.

        TOPP-RA computes the fastest timing of the path on a grid, without jerk limits. If optimal
        control fails, the motion of TOPP-RA is the result where it meets all requirements
        (`_toppra_suffices`).

        Parameters
        ----------
        path : JointPath
            Joint path q(s) with the path parameter s from 0 to 1.

        Returns
        -------
        PlannedPhase or Reason
            The phase (entry of the motion list) with its motion, or the reason why planning failed.
        """
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
        if isinstance(result, Reason) and self._toppra_suffices(path):
            return self._by_toppra(path)
        return result

    def _by_toppra(self, path: JointPath) -> PlannedPhase | Reason:
        """Return the fastest motion along a path, timed by TOPP-RA without optimal control.

        Parameters
        ----------
        path : JointPath
            Joint path q(s) with the path parameter s from 0 to 1.

        Returns
        -------
        PlannedPhase or Reason
            The phase with its motion, or the reason why TOPP-RA found none.
        """
        robot, speeds = with_margin(self.strict, GRID_MARGIN), self.phase.speeds_along(path)
        retiming = retime(path, robot, self.problem.task_limits, speeds)
        if not retiming.solved:
            return explain_failure(self.phase, path, FAILURE)
        pieces = retimed_polynomials(path, retiming, speeds[1])
        motion = PhaseSolution("solved", "", 0, *pieces, solver="TOPP-RA")
        return PlannedPhase(self.phase, motion, self.phase.lower_bound)

    def _toppra_suffices(self, path: JointPath) -> bool:
        """Return True if TOPP-RA alone may time the path.

        It may time curves and rounded corners, but not straight lines in task coordinates, which
        are left to optimal control. TOPP-RA cannot keep jerk limits or a requested duration, so
        there must be none.

        Parameters
        ----------
        path : JointPath
            Joint path q(s) with the path parameter s from 0 to 1.
        """
        curved = not isinstance(path, StraightPath)
        return curved and self.phase.motion.duration is None and not limits_jerk(self.problem.robot)
