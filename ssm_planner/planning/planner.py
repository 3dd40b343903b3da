"""From a problem to a trajectory: phases, TOPP-RA and optimal control per phase, joined."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.planning.corners import with_corners
from ssm_planner.planning.feasibility import (
    duration_too_short,
    durations_disagree,
    infeasible_place,
    motor_too_hot,
    motor_too_weak,
    motor_too_weak_to_brake,
    nearest_to_eye,
    no_motion,
    not_constant,
    straight_instead,
)
from ssm_planner.planning.kept import SameObject, kept
from ssm_planner.planning.ocp.constraints import limits_jerk, with_margin
from ssm_planner.planning.ocp.free import ELEMENTS, FINER_ELEMENTS, solve_free
from ssm_planner.planning.ocp.natively import compiled
from ssm_planner.planning.ocp.nlp import Method, PhaseSolution
from ssm_planner.planning.ocp.refinement import LONGER as LONGER_FOR_HEAT
from ssm_planner.planning.ocp.straight import retimed_pieces, solve_straight
from ssm_planner.planning.outlook import LONGER, bounded_duration, feasible_phases, least_duration
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.retiming.constraints import braking_travel
from ssm_planner.planning.retiming.paths import (
    JointPath,
    MotionPath,
    PolylinePath,
    SplinePath,
    StraightPath,
)
from ssm_planner.planning.retiming.retime import (
    COARSE,
    POINTS,
    Retiming,
    motion_along,
    retime,
    retime_motion,
    stays_at,
)
from ssm_planner.planning.turning_points import (
    PAYS,
    PAYS_IPOPT,
    SKETCHED,
    Turns,
    best_turns,
    passing_turns,
)
from ssm_planner.problem.limits import Duration, LensClearance, RetinaClearance, TipSpeed
from ssm_planner.problem.motion import Follow, Free, Motion, Scan
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.problem.value import unchecked
from ssm_planner.trajectory import Trajectory, hold, join
from ssm_planner.typing import Array

METHODS: dict[str, Method] = {"optimal": "confirmed", "fast": "structured", "ipopt": "Ipopt"}
"""By planner."""
TOPPRA = "TOPP-RA"
"""Named as the solver of a motion that has its pace."""
CREEPING = 10.0
"""TOPP-RA's duration in lower bounds beyond which its motion is no guess."""
LONGER_THAN_TOPPRA = 1.003
"""Times TOPP-RA's duration, beyond which a motion of the structured solver is planned by Ipopt alone too, and then takes
TOPP-RA's pace along its path."""
FAR = 1.001
"""TOPP-RA's duration in that of the motion beyond which it is worked out along the motion too."""
SHORTER = 1e-5
"""Share by which a straight motion has to be shorter than a free one to take its place."""
NEARLY = 1.005
"""TOPP-RA's duration on a coarse grid, in that of a free motion, up to which the straight one is worked out."""
DRAWN_BACK = (0.7, 0.55, 0.4, 0.85, 0.25)
"""Depths, as shares of that of the ends, to which a guess draws the tool back where something is in its way."""
ROOM = 1.1
"""Shares of the shortest braking way that joints get to stop, where nothing else is found."""
SAME = 1e-5
"""Share by which durations may differ that are meant to be the same."""
PACES = 2e-4
"""Share of the constant speed asked for to which the largest is found that can be had."""
BETWEEN = 2e-5
"""By how much TOPP-RA's motion keeps off the limits, for what happens between its grid points."""


@dataclass(frozen=True, eq=False)
class PlannedPhase:
    """A phase with its motion, TOPP-RA's duration for the same path and limits, and a bound."""

    phase: Phase
    motion: PhaseSolution
    toppra_duration: float | None
    """None where TOPP-RA finds no motion along the path that was taken, or does not converge, or a duration was asked for."""
    lower_bound: float
    """A duration that no motion within the same limits can beat."""
    paced: bool = False
    """It took TOPP-RA's pace in place of its own, which was slower."""

    @property
    def duration(self) -> float:
        """s."""
        return self.motion.duration

    @property
    def turns_back(self) -> bool:
        """A free motion from rest to rest on which joints turn back between its points."""
        phase = self.phase
        at_rest = not (phase.qd_start.any() or phase.qd_end.any())
        return phase.path is None and at_rest and len(self.motion.borders) > len(phase.points)


@dataclass(frozen=True, eq=False)
class PlannerResult:
    """status: "solved", "infeasible" or "not converged"; trajectory None and a reason unless solved."""

    status: str
    trajectory: Trajectory | None
    phases: tuple[PlannedPhase, ...]
    reason: Reason | None


def plan_motion(
    problem: Problem,
    strict: Robot | None = None,
    progress: Callable[[str], None] = lambda _: None,
    cooling: Array | None = None,
    *,
    warm: bool = True,
    turning: bool = True,
    paced: bool = True,
) -> PlannerResult:
    """Plan every phase of a problem, each from rest to rest but for the speeds asked for at the two ends of all.

    strict: the problem's robot with stricter limits, which the motion is to keep; None: its own. cooling: time that is to be
    spent on less heat, by motor (4,), as in `ocp/constraints.LIMITS`. warm: also where a motor is hopelessly hot.
    turning: joints may turn back between points. paced: where TOPP-RA is faster along its path, a motion takes that pace.
    Raises ProblemError for a point out of reach or a motion that goes nowhere.
    """
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    robot = with_corners(problem, problem.robot)
    stated, problem = problem, unchecked(problem, robot=robot)
    strict = unchecked(strict or robot, corners=robot.corners, lightest=robot.lightest)
    planner = _PhasePlanner(problem, mechanism, strict, cooling, turning=turning, paced=paced)
    phases, reason = feasible_phases(problem, mechanism)
    if reason is None and not warm:
        reason = motor_too_hot(stated, phases)
    if reason is None and problem.duration is not None:
        phases, reason = _with_durations(phases, problem.duration, planner, progress)
    if reason is not None:
        return PlannerResult("infeasible", None, (), reason)
    planned: list[PlannedPhase] = []
    for k, phase in enumerate(phases, 1):
        progress(
            phase.motion.name if len(phases) == 1 else f"{phase.motion.name} ({k} of {len(phases)})"
        )
        found = planner.plan(phase)
        if isinstance(found, Reason):
            return PlannerResult(
                "not converged" if found.limit is None else "infeasible",
                None,
                tuple(planned),
                found,
            )
        planned.append(planner.cross_checked(found))
    trajectory = join(
        [(each.phase.motion.name, each.motion.breaks, each.motion.coefficients) for each in planned]
    )
    return PlannerResult("solved", trajectory, tuple(planned), None)


def sketched_duration(problem: Problem, longest: float = np.inf) -> float:
    """About how long a motion of a problem takes, s, quickly; infinite where that is not less than `longest`.

    By the structured solver or not at all, and without turning points. A duration asked for is what it takes.
    """
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    phases, reason = feasible_phases(problem, mechanism)
    longest = min(longest, np.inf if problem.duration is None else problem.duration * (1 + LONGER))
    planner = _PhasePlanner(
        unchecked(problem, objective="time"), mechanism, problem.robot, turning=False, paced=False
    )
    takes = [bounded_duration(problem, mechanism, phase) for phase in phases]
    if reason is not None or sum(takes) >= longest or any(map(planner.is_hopeless, phases)):
        return np.inf
    # along a line it is soon known whether there is a motion
    for k in sorted(range(len(phases)), key=lambda k: phases[k].path is None):
        takes[k] = planner.sketched(phases[k], longest - sum(takes) + takes[k])
        if sum(takes) >= longest:
            return np.inf
    return problem.duration or sum(takes)


def _with_durations(
    phases: tuple[Phase, ...],
    duration: float,
    planner: _PhasePlanner,
    progress: Callable[[str], None],
) -> tuple[tuple[Phase, ...], Reason | None]:
    """The phases with durations that add up to the one asked for: what has none of its own is slowed down in proportion."""
    fastest = replace(planner, problem=replace(planner.problem, objective="time"))
    if sum(
        bounded_duration(planner.problem, planner.mechanism, phase) for phase in phases
    ) > duration * (1 + LONGER):
        fastest = planner._quick  # it is too short, and how long it takes is to be told
    least = []
    for phase in phases:
        progress(f"{phase.motion.name}, fastest")
        if phase.motion.duration is not None:
            least.append(0.0)
            continue
        found = fastest.plan(phase)
        if isinstance(found, Reason):
            return phases, found
        least.append(found.duration)
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
    cooling: Array | None = None
    turning: bool = True
    paced: bool = True
    sketch: float | None = None
    """A duration from which on a sketch is of no use, s; None: no sketch."""

    def sketched(self, phase: Phase, useless: float) -> float:
        """About how long a phase takes, s; infinite where that is not less than `useless`.

        Other joints at one target leave most phases as they are, so what is known of them is kept.
        """
        if phase.stands:
            return phase.motion.duration or 0.0
        problem, path = self.problem, phase.path
        by_ends = path is None or isinstance(path, StraightPath)
        arrays = phase.points, phase.start, phase.end, phase.qd_start, phase.qd_end, phase.qdd_start
        key = (
            "sketch",
            *map(SameObject, (problem.robot, problem.eye, None if by_ends else path)),
            *(problem.limits, problem.planner, phase.motion.duration, path is None),
            *(each.tobytes() for each in arrays),
        )
        known: list[tuple[float, float]] = kept(key, list)
        for before, duration in known:
            if duration < before or useless <= before:
                return duration if duration < useless else np.inf
        found = replace(self, sketch=useless).plan(phase)
        known.append((useless, np.inf if isinstance(found, Reason) else found.duration))
        return known[-1][1] if known[-1][1] < useless else np.inf

    def is_hopeless(self, phase: Phase) -> bool:
        """A free phase from rest to rest in which a motor is too weak to move at all, whatever way it takes."""
        if phase.stands or phase.path is not None or phase.qd_start.any() or phase.qd_end.any():
            return False
        return (
            motor_too_weak(self.problem, phase, PolylinePath(self.mechanism, phase.points))
            is not None
        )

    def plan(self, phase: Phase) -> PlannedPhase | Reason:
        """The motion of a phase, or the reason why there is none."""
        if phase.stands:
            duration = phase.motion.duration or 0.0
            motion = np.array([0.0, duration]), hold(phase.q_start)
            rest = PhaseSolution("solved", "", 0, *(motion if duration else ()))
            return PlannedPhase(phase, rest, toppra_duration=duration, lower_bound=duration)
        if phase.path is None:
            return self._free(phase)
        if isinstance(phase.motion, Follow) and phase.motion.constant_speed is not None:
            return self._at_constant_speed(phase, phase.path, phase.motion.constant_speed)
        # along a curve the rates of task coordinates limit the speed from place to place, which optimal control does roughly
        rated = bool(self.problem.rates) and self._may_be_retimed(phase)
        samples = isinstance(phase.path, SplinePath) and not phase.path.pieces
        if self.problem.planner != "toppra" and not samples and not rated:
            return self._straight(phase, phase.path)
        return self._retimed(phase, phase.path)

    def cross_checked(self, planned: PlannedPhase) -> PlannedPhase:
        """With TOPP-RA's duration along the path that a free motion took; a straight one has it from its guess.

        Where that is too far off, for its first interval is a long time to a motor that barely starts, it gets one too.
        """
        phase, guess, motion = planned.phase, planned.toppra_duration, planned.motion
        if phase.stands or phase.motion.duration is not None:
            return planned
        if phase.path is None or not (guess is None or guess <= FAR * motion.duration):
            again = retime_motion(
                self._way(phase, motion), self.problem.robot, self.problem.task_limits
            )
            planned = replace(planned, toppra_duration=again.duration if again.converged else None)
        reached = planned.toppra_duration
        if reached is None or motion.duration <= LONGER_THAN_TOPPRA * reached:
            return planned
        if limits_jerk(self.problem.robot):  # of which TOPP-RA knows nothing
            return planned
        if motion.confirmation is not None:
            by_ipopt = replace(self, problem=unchecked(self.problem, planner="ipopt"))
            alone = by_ipopt.plan(phase)
            if not isinstance(alone, Reason) and alone.duration < motion.duration:
                return by_ipopt.cross_checked(alone)
        return (
            planned
            if self.cooling is not None or not self.paced
            else self._as_fast_as_toppra(planned)
        )

    def _as_fast_as_toppra(self, planned: PlannedPhase) -> PlannedPhase:
        """The same path at TOPP-RA's pace, where the optimal control stopped at a slower one."""
        if planned.phase.path is not None:
            timed = self._retimed(planned.phase, planned.phase.path)
            if isinstance(timed, Reason) or timed.duration >= planned.duration:
                return planned
            return replace(timed, paced=True)
        path = self._way(planned.phase, planned.motion)
        found, motion = self._paced(planned.phase, planned.motion, path)
        if not found.converged or motion.duration >= planned.duration:
            return planned
        again = retime_motion(
            self._way(planned.phase, motion), self.problem.robot, self.problem.task_limits
        )
        motion = replace(motion, solver=TOPPRA, confirmation=None)
        return replace(
            planned,
            motion=motion,
            toppra_duration=again.duration if again.converged else None,
            paced=True,
        )

    def _way(self, phase: Phase, motion: PhaseSolution) -> MotionPath:
        """The path that a motion of the phase takes."""
        trajectory = Trajectory(motion.breaks, motion.coefficients, ())
        signs = motion.directions if phase.path is None else phase.path.directions[1]
        return MotionPath(self.mechanism, trajectory, motion.borders / trajectory.duration, signs)

    def _slowed_to_stop(self, phase: Phase, motion: PhaseSolution) -> PhaseSolution:
        """A free motion timed again by TOPP-RA, along its own path, where the tip would travel too far to stop."""
        limit = self.problem.stop_travel
        if limit is None or not motion.solved:
            return motion
        path = self._way(phase, motion)
        samples = path.trajectory.sample(np.linspace(0.0, motion.duration, POINTS))
        if (
            braking_travel(self.mechanism, self.problem.robot, samples.q, samples.qd).max()
            <= limit.largest
        ):
            return motion
        return self._paced(phase, motion, path)[1]

    def _paced(
        self, phase: Phase, motion: PhaseSolution, path: MotionPath
    ) -> tuple[Retiming, PhaseSolution]:
        """A motion timed again by TOPP-RA along the path that it took."""
        # at rest the pace is that of nothing, and the motion's own leaves no margin
        pace = 1.0 if phase.qd_start.any() else 1 - 2 * BETWEEN
        found = retime_motion(
            path, with_margin(self.strict, BETWEEN), self.problem.task_limits, pace=pace
        )
        if not found.solved:
            return found, replace(motion, status=found.status, message=found.message)
        paced = motion_along(path, found)
        if phase.motion.duration is not None:
            paced = paced.slower(min(paced.duration / phase.motion.duration, 1.0))
        borders = np.interp(path.knots, found.s, found.times) * paced.duration / found.duration
        timed = replace(
            motion, breaks=paced.breaks, coefficients=paced.coefficients, borders=borders
        )
        return found, timed

    def _retimed(self, phase: Phase, path: JointPath) -> PlannedPhase | Reason:
        """A straight or curved motion timed by TOPP-RA alone."""
        speeds = path.speed_at(0.0, phase.qd_start), path.speed_at(1.0, phase.qd_end)
        robot = with_margin(self.strict, BETWEEN)
        retiming = retime(path, robot, path.intervals, self.problem.task_limits, speeds)
        if not retiming.solved:
            return no_motion(self.problem, phase, path, retiming.message)
        motion = PhaseSolution(
            "solved", "", 0, *retimed_pieces(path, retiming, speeds[1]), solver=TOPPRA
        )
        return PlannedPhase(phase, motion, retiming.duration, self._lower_bound(phase))

    def _at_constant_speed(
        self, phase: Phase, path: JointPath, speed: float
    ) -> PlannedPhase | Reason:
        """Along a line or an arc at a constant speed of the tip, m/s, that TOPP-RA gets to and leaves as fast as it can."""

        def paced(pace: float) -> _PhasePlanner:
            own = (limit.largest for limit in self.problem.limits if isinstance(limit, TipSpeed))
            others = (limit for limit in self.problem.limits if not isinstance(limit, TipSpeed))
            limits = (*others, TipSpeed(min(pace, *own, pace)))
            return replace(self, problem=unchecked(self.problem, limits=limits))

        def keeps(pace: float) -> bool:
            planner = paced(pace)
            robot = with_margin(self.strict, BETWEEN)
            found = retime(path, robot, path.intervals, planner.problem.task_limits, (0.0, 0.0))
            return found.solved and stays_at(found, path, pace)

        if keeps(speed):
            return paced(speed)._retimed(phase, path)
        slow, fast = 0.0, speed
        while fast - slow > PACES * speed:
            middle = (slow + fast) / 2
            slow, fast = (middle, fast) if keeps(middle) else (slow, middle)
        return not_constant(phase.motion.name, speed, slow)

    def _straight(self, phase: Phase, path: JointPath) -> PlannedPhase | Reason:
        """A motion along a path by optimal control, with TOPP-RA's as guess."""
        problem, asked = self.problem, phase.motion.duration
        speeds = path.speed_at(0.0, phase.qd_start), path.speed_at(1.0, phase.qd_end)
        retiming = self._retime(path, problem.robot, speeds)
        if not retiming.solved:
            return no_motion(problem, phase, path, retiming.message)
        guess, bound = retiming, self._lower_bound(phase)
        if retiming.duration > CREEPING * bound:
            # a motor that barely starts creeps over TOPP-RA's first interval, where a real one breaks away at a point
            kinetic = self._retime(path, problem.robot, speeds, static=False)
            guess = kinetic if kinetic.solved else retiming
        solve = partial(
            solve_straight,
            problem.robot,
            path,
            guess,
            limits=problem.task_limits,
            strict=self.strict,
            cooling=self.cooling,
            objective=problem.objective,
            duration=asked,
            speeds=speeds,
        )
        motion = self._solved(solve)
        found = self._planned(phase, path, motion, None if asked else retiming.duration, bound)
        return (
            self._retimed(phase, path)
            if isinstance(found, Reason) and self._may_be_retimed(phase)
            else found
        )

    def _may_be_retimed(self, phase: Phase) -> bool:
        """TOPP-RA alone may time it: along a curve or with rounded corners, neither in a duration nor with jerk limits."""
        curved = phase.path is not None and not isinstance(phase.path, StraightPath)
        return curved and phase.motion.duration is None and not limits_jerk(self.problem.robot)

    def _solved(
        self,
        solve: Callable[..., PhaseSolution],
        *,
        needed: bool = True,
        coarser: int | None = None,
    ) -> PhaseSolution:
        """By the planner asked for; by Ipopt alone where the structured solver finds nothing that Ipopt confirms.

        needed: it is worth Ipopt's time, for there is no other motion yet, or a much longer one. coarser: elements that Ipopt
        would take, fewer than those on which it confirms, so that both may do on these.
        """
        method: Method = "sketched" if self.sketch is not None else METHODS[self.problem.planner]
        found = solve(method=method if compiled() is not None else "Ipopt")
        given_up = (
            needed and not found.solved and found.solver == "structured" and self.sketch is None
        )
        if given_up and coarser is not None and method == "confirmed":
            found = solve(method=method, count=coarser)
        return solve(method="Ipopt") if given_up and not found.solved else found

    def _free(self, phase: Phase) -> PlannedPhase | Reason:
        """A free motion, never longer than the straight one to the same target, where that keeps the limits."""
        reason = motor_too_weak_to_brake(self.problem, phase)
        if reason is not None:
            return reason
        motion, turning = phase.motion, None
        if (
            len(phase.points) > 2
            and isinstance(motion, Free)
            and motion.duration is None
            and self.cooling is None
        ):
            turning = self._turning_at_points(phase) if self._may_turn else None
        # which of both is the faster is known before they are worked out to the end
        about = self._may_turn and motion.duration is None and self.cooling is None
        free = turning or self._without_turns(phase, about=about)
        if not isinstance(free, Reason) and (
            self.cooling is not None or free.duration <= (1 + SHORTER) * free.lower_bound
        ):
            return self._worked_out(phase, free)
        free = turning or self._worked_out(phase, self._turning_back(phase, free))
        if isinstance(free, Reason) and isinstance(free.limit, (RetinaClearance, LensClearance)):
            free = self._drawn_back(phase) or free
        straight = straight_instead(self.problem, self.mechanism, phase)
        if straight is None or not isinstance(straight.path, StraightPath):
            return free
        if not isinstance(free, Reason):
            rough = retime(straight.path, self.problem.robot, COARSE, self.problem.task_limits)
            if not rough.duration < NEARLY * free.duration:
                return free
        found = self._straight(straight, straight.path)
        if isinstance(found, Reason):
            return free
        shorter = LONGER_FOR_HEAT if self.problem.objective == "time then heat" else SHORTER
        if isinstance(free, Reason) or found.duration < (1 - shorter) * free.duration:
            return found
        return free

    def _without_turns(self, phase: Phase, *, about: bool = False) -> PlannedPhase | Reason:
        """A free motion whose joints turn back where they have to; if need be on a finer mesh, or after a stop.

        about: about the fastest, for `_worked_out`.
        """
        useless = np.inf if self.sketch is None else self.sketch
        free = self._free_by_optimal_control(phase, useless=useless, about=about)
        if isinstance(free, Reason) and free.limit is None and self.sketch is None:
            free = self._free_by_optimal_control(phase, count=FINER_ELEMENTS)
        if isinstance(free, Reason) and phase.qd_start.any() and phase.motion.duration is None:
            free = self._stopped_first(phase) or free
        return free

    def _worked_out(self, phase: Phase, found: PlannedPhase | Reason) -> PlannedPhase | Reason:
        """A free motion to the end, if it is about the fastest so far."""
        rest = None if isinstance(found, Reason) else found.motion.rest
        if rest is None:
            return found
        whole = self._planned(phase, PolylinePath(self.mechanism, phase.points), rest(), None, None)
        return self._without_turns(phase) if isinstance(whole, Reason) else whole

    @property
    def _may_turn(self) -> bool:
        """Joints may turn back where they need not."""
        return self.turning and self.problem.stop_travel is None

    @property
    def _quick(self) -> _PhasePlanner:
        """Of the fastest motions, not confirmed: tells which one is to be worked out."""
        planner = "fast" if self.problem.planner == "optimal" else self.problem.planner
        return replace(self, problem=unchecked(self.problem, planner=planner, objective="time"))

    def _turning_back(self, phase: Phase, found: PlannedPhase | Reason) -> PlannedPhase | Reason:
        """The motion of a free phase, or a faster one in which joints turn back between its points."""
        too_short = isinstance(found, Reason) and isinstance(found.limit, Duration)
        if not (self._may_turn and isinstance(phase.motion, Free)):
            return found
        if not too_short and (isinstance(found, Reason) or phase.motion.duration is not None):
            return found
        pays = PAYS if len(phase.points) > 2 else SKETCHED
        if not isinstance(found, Reason) and (1 - pays) * found.duration <= found.lower_bound:
            return found
        if len(phase.points) > 2:
            return (self._turning_at_points(phase) if too_short else None) or found
        if phase.qd_start.any() or phase.qd_end.any():
            return found
        fastest = replace(self, problem=replace(self.problem, objective="time"))
        untimed = replace(phase, motion=replace(phase.motion, duration=None))
        solved: list[tuple[Turns, PlannedPhase]] = []

        def solve(turns: Turns, useless: float) -> PhaseSolution | None:
            planned = fastest._free_by_optimal_control(untimed, turns, useless=useless)
            if isinstance(planned, Reason):
                return None
            solved.append((turns, planned))
            return planned.motion

        first: PhaseSolution | None
        if isinstance(found, Reason) or (
            self.problem.objective != "time" and found.motion.rest is None
        ):
            first = solve(Turns(phase.points), np.inf)
        else:
            first = found.motion
        turns = (
            None
            if first is None
            else best_turns(self.problem, self.mechanism, phase, first, solve, strict=self.strict)
        )
        if turns is None:
            return found
        if self.problem.objective == "time" and phase.motion.duration is None:
            return next(replace(planned, phase=phase) for each, planned in solved if each is turns)
        better = self._free_by_optimal_control(phase, turns)
        return found if isinstance(better, Reason) else better

    def _turning_at_points(self, phase: Phase) -> PlannedPhase | None:
        """A motion of a free phase with points on its way in which joints turn back beside them; None where none pays.

        Without a duration asked for it has to be faster than the one without, which is planned quickly to know that.
        """
        ends = (each.tobytes() for each in (phase.points, phase.qd_start, phase.qd_end))
        robot = SameObject(self.problem.robot), self.problem.limits
        turns = kept(("turns", *robot, *ends), lambda: passing_turns(self.problem, phase))
        if turns is None:
            return None
        enough = np.inf
        if phase.motion.duration is None:
            without = self._quick._free_by_optimal_control(phase)
            if isinstance(without, Reason) or (1 - PAYS) * without.duration <= without.lower_bound:
                return None
            enough = (1 - PAYS) * without.duration
        found = self._free_by_optimal_control(phase, turns, useless=enough)
        return None if isinstance(found, Reason) or not found.duration < enough else found

    def _stopped_first(self, phase: Phase) -> PlannedPhase | None:
        """A free motion that begins at speed, as a stop and a motion from rest, named so; None where one is not found."""
        first, strongest = (
            phase.points[0],
            np.array([joint.acceleration for joint in self.problem.robot.joints]),
        )
        stop = first + ROOM * phase.qd_start * np.abs(phase.qd_start) / (2 * strongest)
        begin = replace(phase, points=np.stack([first, stop]), qd_end=np.zeros(4))
        rest = np.zeros(4)
        onward = replace(
            phase, points=np.vstack([stop, phase.points[1:]]), qd_start=rest, qdd_start=rest
        )
        if infeasible_place(self.problem, self.mechanism, (begin, onward)) is not None:
            return None
        parts = [self._free_by_optimal_control(begin)]
        if not isinstance(parts[0], Reason):
            onwards = self._free_by_optimal_control(onward)
            eye = isinstance(onwards, Reason) and isinstance(
                onwards.limit, (RetinaClearance, LensClearance)
            )
            parts.append((self._drawn_back(onward) if eye else None) or onwards)
        motions = [part.motion for part in parts if not isinstance(part, Reason)]
        if len(motions) < 2:
            return None
        trajectory = join([("", motion.breaks, motion.coefficients) for motion in motions])
        borders = np.append(motions[0].borders, motions[0].duration + motions[1].borders[1:])
        motion = replace(
            motions[1],
            breaks=trajectory.breaks,
            coefficients=trajectory.coefficients,
            borders=borders,
            directions=np.vstack([each.directions for each in motions]),
        )
        named = replace(
            phase, motion=replace(phase.motion, name=f"{phase.motion.name}, stops first")
        )
        return PlannedPhase(named, motion, None, self._lower_bound(phase))

    def _drawn_back(self, phase: Phase) -> PlannedPhase | None:
        """A free motion over what is in the way, where joints turn back at one place; None where none was found.

        There the guess draws the tool back to a share of the lesser depth at the two ends: of those tried the first that
        leads to a motion.
        """
        if len(phase.points) != 2:
            return None
        first, last = phase.points
        over = nearest_to_eye(self.problem, PolylinePath(self.mechanism, phase.points))
        least = min(first[3], last[3], key=abs)
        for share in DRAWN_BACK:
            turns = Turns(np.stack([first, np.append(over[:3], share * least), last]), (1,))
            found = self._free_by_optimal_control(phase, turns)
            if not isinstance(found, Reason):
                return found
        return None

    def _free_by_optimal_control(
        self,
        phase: Phase,
        turns: Turns | None = None,
        *,
        useless: float = np.inf,
        count: int | None = None,
        about: bool = False,
    ) -> PlannedPhase | Reason:
        """Its path is the solver's. useless: a duration from which on a motion is not worked out to the last digit, s.

        count: of elements. about: about the fastest, with the `rest` of the work.
        """
        direct = PolylinePath(self.mechanism, phase.points)
        moving = bool(phase.qd_start.any() or phase.qd_end.any())
        # joints that move already need not break away, and may come from the other side
        reason = None if moving else motor_too_weak(self.problem, phase, direct)
        if reason is not None:
            return reason
        solve = partial(
            solve_free,
            self.problem,
            self.mechanism,
            phase.points if turns is None else turns.points,
            strict=self.strict,
            cooling=self.cooling,
            duration=phase.motion.duration,
            speeds=(phase.qd_start, phase.qd_end),
            pull=phase.qdd_start,
            loose=() if turns is None else turns.loose,
            passing=None if turns is None else turns.passing,
            useless=useless,
            count=count,
            sketch=None if turns is None else turns.sketch,
            about=about,
        )
        passing = (
            len(phase.points) > 2
            and count is None
            and not (moving and limits_jerk(self.problem.robot))
        )
        needed = turns is None or turns.sketch is None or turns.gain > PAYS_IPOPT
        motion = self._solved(solve, needed=needed, coarser=ELEMENTS if passing else None)
        return self._planned(phase, direct, self._slowed_to_stop(phase, motion), None, None)

    def _retime(
        self, path: JointPath, robot: Robot, speeds: tuple[float, float], *, static: bool = True
    ) -> Retiming:
        return retime(path, robot, path.intervals, self.problem.task_limits, speeds, static=static)

    def _planned(
        self,
        phase: Phase,
        path: JointPath,
        motion: PhaseSolution,
        toppra_duration: float | None,
        bound: float | None,
    ) -> PlannedPhase | Reason:
        """The phase with a solver's motion, or why that is none of the phase: it was not found, or takes too long.

        bound: the lower bound where it is known.
        """
        if not motion.solved:
            if self.sketch is not None:
                return Reason(None, None, None, None, motion.message)
            return no_motion(self.problem, phase, path, motion.message)
        asked = phase.motion.duration
        if asked is not None and motion.duration > asked * (1 + LONGER):
            return duration_too_short(phase.motion.name, asked, motion.duration)
        return PlannedPhase(
            phase, motion, toppra_duration, asked or bound or self._lower_bound(phase)
        )

    def _lower_bound(self, phase: Phase) -> float:
        """A duration that no motion between the ends of the phase can beat, s."""
        return least_duration(self.problem, self.mechanism, phase)


def _lasting(motion: Motion, duration: float) -> Motion:
    return motion if isinstance(motion, Scan) else replace(motion, duration=duration)
