"""From a problem to a trajectory: phases, TOPP-RA and optimal control per phase, joined."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.planning.feasibility import (
    duration_too_short,
    durations_disagree,
    infeasible_place,
    motor_too_weak,
    no_motion,
    straight_instead,
    with_boundary_rates,
)
from ssm_planner.planning.lower_bound import lower_bound, rate_bound
from ssm_planner.planning.ocp.constraints import with_margin
from ssm_planner.planning.ocp.free import FreeResult, solve_free
from ssm_planner.planning.ocp.refinement import LONGER as LONGER_FOR_HEAT
from ssm_planner.planning.ocp.straight import PathMotion, joint_pieces, solve_straight
from ssm_planner.planning.phases import Phase, phases_from, start_configurations
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.retiming.paths import JointPath, MotionPath, PolylinePath, StraightPath
from ssm_planner.planning.retiming.retime import COARSE, Retiming, retime, retime_motion
from ssm_planner.problem.motion import Motion, Scan
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory, hermite, hold, join
from ssm_planner.typing import Array

CREEPING = 10.0
"""TOPP-RA's duration in lower bounds beyond which its motion is no guess."""
FAR = 1.001
"""TOPP-RA's duration in that of the motion beyond which it is worked out along the motion too."""
SHORTER = 1e-5
"""Share by which a straight motion has to be shorter than a free one to take its place."""
NEARLY = 1.005
"""TOPP-RA's duration on a coarse grid, in that of a free motion, up to which the straight one is worked out."""
SAME = 1e-5
"""Share by which durations may differ that are meant to be the same."""
LONGER = 1e-6
"""Share by which a motion may take longer than the duration asked for."""
BETWEEN = 2e-5
"""By how much TOPP-RA's motion keeps off the limits, for what happens between its grid points."""


@dataclass(frozen=True, eq=False)
class PlannedPhase:
    """A phase with its duration, TOPP-RA's duration for the same path and limits, and the solver's account."""

    phase: Phase
    duration: float
    toppra_duration: float | None
    """None where TOPP-RA finds no motion along the path that was taken, or does not converge, or a duration was asked for."""
    lower_bound: float
    """A duration that no motion within the same limits can beat."""
    iterations: int
    borders: Array = field(default_factory=lambda: np.zeros(0))
    """Instants between which no joint turns back, (k + 1,), s; those at which a free motion passes its points."""


@dataclass(frozen=True, eq=False)
class PlannerResult:
    """status: "solved", "infeasible" or "not converged"; trajectory None and a reason unless solved."""

    status: str
    trajectory: Trajectory | None
    phases: tuple[PlannedPhase, ...]
    reason: Reason | None


@dataclass(frozen=True, eq=False)
class PhaseMotion:
    """A planned phase with its joint polynomials: breaks (n + 1,) from 0, s, and coefficients (n, 6, 4)."""

    planned: PlannedPhase
    breaks: Array
    coefficients: Array


def plan_motion(
    problem: Problem, strict: Robot | None = None, progress: Callable[[str], None] = lambda _: None
) -> PlannerResult:
    """Plan every phase of a problem, each from rest to rest but for the speeds asked for at the two ends of all.

    strict: the problem's robot with stricter limits, which the motion is to keep; None: its own.
    Raises ProblemError for a point out of reach or a motion that goes nowhere.
    """
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    planner = _PhasePlanner(problem, mechanism, strict or problem.robot)
    phases, reason = feasible_phases(problem, mechanism)
    if reason is None and problem.duration is not None:
        phases, reason = _with_durations(phases, problem.duration, planner, progress)
    if reason is not None:
        return PlannerResult("infeasible", None, (), reason)
    motions: list[PhaseMotion] = []
    for k, phase in enumerate(phases, 1):
        progress(phase.motion.name if len(phases) == 1 else f"{phase.motion.name} ({k} of {len(phases)})")
        motion = planner.plan(phase)
        if isinstance(motion, Reason):
            status = "not converged" if motion.limit is None else "infeasible"
            return PlannerResult(status, None, tuple(m.planned for m in motions), motion)
        motions.append(planner.cross_checked(motion))
    trajectory = join([(m.planned.phase.motion.name, m.breaks, m.coefficients) for m in motions])
    return PlannerResult("solved", trajectory, tuple(m.planned for m in motions), None)


def feasible_phases(problem: Problem, mechanism: Mechanism) -> tuple[tuple[Phase, ...], Reason | None]:
    """The phases of a problem with the speeds at both ends, or the reason why no start configuration carries it.

    Start configurations are tried from the home branch and the one nearest to q = 0 on; the first whose joints stay in
    range all along is taken. Raises ProblemError for a point out of reach or a motion that goes nowhere.
    """
    reasons = []
    for q in start_configurations(problem, mechanism):
        phases = phases_from(problem, mechanism, q)
        reason = infeasible_place(problem, mechanism, phases)
        if reason is None:
            return with_boundary_rates(problem, mechanism, phases)
        reasons.append(reason)
    return (), reasons[0]


def _with_durations(
    phases: tuple[Phase, ...], duration: float, planner: _PhasePlanner, progress: Callable[[str], None]
) -> tuple[tuple[Phase, ...], Reason | None]:
    """The phases with durations that add up to the one asked for: what has none of its own is slowed down in proportion."""
    fastest = replace(planner, problem=replace(planner.problem, objective="time"))
    least = []
    for phase in phases:
        progress(f"{phase.motion.name}, fastest")
        if phase.motion.duration is not None:
            least.append(0.0)
            continue
        motion = fastest.plan(phase)
        if isinstance(motion, Reason):
            return phases, motion
        least.append(motion.planned.duration)
    fixed = sum(phase.motion.duration or 0.0 for phase in phases)
    free, needed = duration - fixed, sum(least)
    if needed == 0.0:
        return phases, None if abs(free) <= SAME * duration else durations_disagree(duration, fixed)
    if free < needed:
        return phases, duration_too_short("the whole motion", duration, fixed + needed)
    timed = (
        phase if own == 0.0 else replace(phase, motion=_lasting(phase.motion, own * free / needed))
        for phase, own in zip(phases, least, strict=True)
    )
    return tuple(timed), None


@dataclass(frozen=True, eq=False)
class _PhasePlanner:
    """Plans one phase at a time; strict: the robot with the limits that the motion is to keep."""

    problem: Problem
    mechanism: Mechanism
    strict: Robot

    def plan(self, phase: Phase) -> PhaseMotion | Reason:
        """The motion of a phase, or the reason why there is none."""
        if phase.motion.kind == "dwell":
            return self._dwell(phase)
        if phase.path is None:
            return self._free(phase)
        if self.problem.planner == "toppra":
            return self._retimed(phase, phase.path)
        return self._straight(phase, phase.path)

    def cross_checked(self, motion: PhaseMotion) -> PhaseMotion:
        """With TOPP-RA's duration along the path that a free motion took; a straight one has it from its guess.

        Where that is too far off, for its first interval is a long time to a motor that barely starts, it gets one too.
        """
        phase, guess = motion.planned.phase, motion.planned.toppra_duration
        if phase.motion.kind == "dwell" or phase.motion.duration is not None:
            return motion
        if phase.path is not None and (guess is None or guess <= FAR * motion.planned.duration):
            return motion
        trajectory = Trajectory(motion.breaks, motion.coefficients, ())
        signs = np.sign(np.diff(phase.points, axis=0)) if phase.path is None else phase.path.directions[1]
        path = MotionPath(self.mechanism, trajectory, motion.planned.borders / trajectory.duration, signs)
        again = retime_motion(path, self.problem.robot, self.problem.task_limits)
        planned = replace(motion.planned, toppra_duration=again.duration if again.converged else None)
        return replace(motion, planned=planned)

    def _dwell(self, phase: Phase) -> PhaseMotion:
        duration = float(phase.motion.duration or 0.0)
        planned = PlannedPhase(phase, duration, toppra_duration=duration, lower_bound=duration, iterations=0)
        return PhaseMotion(planned, np.array([0.0, duration]), hold(phase.q_start))

    def _retimed(self, phase: Phase, path: StraightPath) -> PhaseMotion | Reason:
        """A straight motion timed by TOPP-RA alone."""
        speeds = path.speed_at(0.0, phase.qd_start), path.speed_at(1.0, phase.qd_end)
        retiming = self._retime(path, with_margin(self.strict, BETWEEN), speeds)
        if not retiming.solved:
            return no_motion(self.problem, phase, path, retiming.message)
        duration, bound = retiming.duration, self._lower_bound(phase)
        planned = PlannedPhase(phase, duration, toppra_duration=duration, lower_bound=bound, iterations=0)
        pieces = joint_pieces(path, PathMotion.of(retiming), subdivision=1, end_speed=speeds[1])
        return PhaseMotion(planned, *pieces)

    def _straight(self, phase: Phase, path: StraightPath) -> PhaseMotion | Reason:
        """A straight motion by optimal control, with TOPP-RA's as guess."""
        problem, asked = self.problem, phase.motion.duration
        speeds = path.speed_at(0.0, phase.qd_start), path.speed_at(1.0, phase.qd_end)
        bound = self._lower_bound(phase)
        retiming = self._retime(path, problem.robot, speeds)
        if not retiming.solved:
            return no_motion(problem, phase, path, retiming.message)
        guess = retiming
        if retiming.duration > CREEPING * bound:
            # a motor that barely starts creeps over TOPP-RA's first interval, where a real one breaks away at a point
            kinetic = self._retime(path, problem.robot, speeds, static=False)
            guess = kinetic if kinetic.solved else retiming
        motion = solve_straight(
            problem.robot,
            path,
            guess,
            limits=problem.task_limits,
            strict=self.strict,
            objective=problem.objective,
            duration=asked,
            speeds=speeds,
        )
        reason = self._not_planned(phase, path, motion)
        if reason is not None:
            return reason
        planned = PlannedPhase(
            phase,
            motion.duration,
            toppra_duration=None if asked else retiming.duration,
            lower_bound=asked or bound,
            iterations=motion.iterations,
            borders=motion.instants(path.directions[0]),
        )
        return PhaseMotion(planned, *joint_pieces(path, motion, end_speed=speeds[1]))

    def _free(self, phase: Phase) -> PhaseMotion | Reason:
        """A free motion, never longer than the straight one to the same target, where that keeps the limits."""
        free = self._free_by_optimal_control(phase)
        if not isinstance(free, Reason) and free.planned.duration <= (1 + SHORTER) * free.planned.lower_bound:
            return free
        straight = straight_instead(self.problem, self.mechanism, phase)
        if straight is None or straight.path is None:
            return free
        if not isinstance(free, Reason):
            rough = retime(straight.path, self.problem.robot, COARSE, self.problem.task_limits)
            if not rough.duration < NEARLY * free.planned.duration:
                return free
        motion = self._straight(straight, straight.path)
        if isinstance(motion, Reason):
            return free
        if isinstance(free, Reason) or motion.planned.duration < (1 - self._shorter) * free.planned.duration:
            return motion
        return free

    @property
    def _shorter(self) -> float:
        """Share by which one motion has to be shorter than another to be preferred."""
        return LONGER_FOR_HEAT if self.problem.objective == "time then heat" else SHORTER

    def _free_by_optimal_control(self, phase: Phase) -> PhaseMotion | Reason:
        """Its path is the solver's."""
        asked = phase.motion.duration
        direct = PolylinePath(self.mechanism, phase.points)
        reason = motor_too_weak(self.problem, phase, direct)
        if reason is not None:
            return reason
        motion = solve_free(
            self.problem,
            self.mechanism,
            phase.points,
            strict=self.strict,
            duration=asked,
            speeds=(phase.qd_start, phase.qd_end),
        )
        reason = self._not_planned(phase, direct, motion)
        if reason is not None:
            return reason
        planned = PlannedPhase(
            phase,
            motion.duration,
            toppra_duration=None,
            lower_bound=asked or self._lower_bound(phase),
            iterations=motion.iterations,
            borders=motion.borders,
        )
        return PhaseMotion(planned, motion.breaks, hermite(motion.breaks, motion.start, motion.end))

    def _retime(self, path: JointPath, robot: Robot, speeds: tuple[float, float], *, static: bool = True) -> Retiming:
        return retime(path, robot, limits=self.problem.task_limits, speeds=speeds, static=static)

    def _not_planned(self, phase: Phase, path: JointPath, motion: PathMotion | FreeResult) -> Reason | None:
        """Why a solver's answer is no motion of the phase: there is none, or it takes longer than asked for."""
        if not motion.solved:
            return no_motion(self.problem, phase, path, motion.message)
        asked = phase.motion.duration
        if asked is not None and motion.duration > asked * (1 + LONGER):
            return duration_too_short(phase.motion.name, asked, motion.duration)
        return None

    def _lower_bound(self, phase: Phase) -> float:
        """A duration that no motion between the ends of the phase can beat, s."""
        at_rest = not (phase.qd_start.any() or phase.qd_end.any())
        rates = rate_bound(phase.start, phase.end, self.problem.rates)
        return max(lower_bound(self.problem.robot, phase.points, at_rest=at_rest), rates)


def _lasting(motion: Motion, duration: float) -> Motion:
    return motion if isinstance(motion, Scan) else replace(motion, duration=duration)
