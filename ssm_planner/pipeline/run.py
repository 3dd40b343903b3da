"""The whole program: problem → plan → check → requirements → files. The command line is a skin over this."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import zip_longest
from pathlib import Path
from threading import RLock

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_rates
from ssm_planner.pipeline.branches import Enough, Outcome, on_any_branch
from ssm_planner.pipeline.folder import write_folder
from ssm_planner.pipeline.relaxation import search
from ssm_planner.planning.kept import keeping
from ssm_planner.planning.outlook import hopelessly_hot
from ssm_planner.planning.planner import PlannedPhase, PlannerResult, plan_motion
from ssm_planner.planning.reason import Reason
from ssm_planner.plans import PhaseSummary, Plan
from ssm_planner.problem.limits import JUMPS, TASK, ContinuousTorque, Jump, Limit, SelfLocking
from ssm_planner.problem.motion import Follow, Free, Joints, Motion, Point, Scan, Straight, Task
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.value import unchecked
from ssm_planner.reporting.figures.process import FigureProcess
from ssm_planner.trajectory import Span, Trajectory
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import Certificate
from ssm_planner.verification.check import check
from ssm_planner.verification.limits import JUMP
from ssm_planner.verification.promises import WayKept, promises_kept

ATTEMPTS = 4
MULTIPLIERS = (0.5, 0.8, 0.95)
"""Of the continuous torque, tried one after the other until the motors keep it."""
HELPS = 0.05
"""Share of its excess that a larger multiplier has to take away for the next one to be tried."""
CERTAIN = 2e-3
"""Share by which a motion that Ipopt has not confirmed gets warmer than is allowed, where that is not done either."""
RESERVE, STEPS = 2e-3, 6
"""Share of the heat allowed that the fastest motion may leave, and trials to find it."""
ROUNDING = 1e-12
"""Share of the largest rate below which a rate is none."""
ROOM = 1.1
"""Shares of the shortest braking way that joints get to stop."""
BARELY = 1e-6
"""Share by which a rest is longer than what cools, for rounding."""

_ONE_AT_A_TIME = RLock()
"""Programs and solutions that plans share are for one thread at a time; two would not be faster, for Python runs one."""

Progress = Callable[[str], None]


def plan(
    problem: Problem,
    progress: Progress = lambda _: None,
    found: Callable[[Trajectory], None] = lambda _: None,
    relaxations: bool = True,
    cured: Callable[[Problem], None] = lambda _: None,
    stoppable: bool = False,
) -> Plan:
    """Plan a problem, check the plan by code that did not make it.

    Where the check finds a limit exceeded between the planner's nodes, that limit is tightened by the excess and the motion
    planned again. found: called with each motion before it is checked; cured: with the problem that a relaxation gives.
    Never raises for an infeasible problem: the plan then holds the reason, and unless `relaxations` is false the smallest
    change of a limit with which there is a motion. stoppable: the first Ctrl-C during the search for other joints ends that
    search, and the plan is the best one until then (`Plan.stopped`). Threads may call it; they wait for each other.
    """
    with _ONE_AT_A_TIME, keeping():
        return _plan(problem, progress, found, cured, relaxations=relaxations, stoppable=stoppable)


def _plan(
    problem: Problem,
    progress: Progress,
    found: Callable[[Trajectory], None],
    cured: Callable[[Problem], None],
    *,
    relaxations: bool,
    stoppable: bool,
) -> Plan:
    begin = time.perf_counter()
    shown: list[Trajectory] = []

    def show(trajectory: Trajectory) -> None:
        shown.append(trajectory)
        found(trajectory)

    # what gives cures is the motion that runs too warm: where none are asked for, none is planned
    def attempt(other: Problem) -> Outcome:
        return _attempt(other, progress, show, warm=relaxations)

    outcome, settled, stopped = on_any_branch(problem, attempt, progress, stoppable=stoppable)
    planned, certificate, reason = outcome
    if planned.trajectory is not None and shown[-1] is not planned.trajectory:
        found(planned.trajectory)
    if reason is not None and relaxations:
        progress("looking for a relaxation")
        duration = None if planned.trajectory is None else planned.trajectory.duration
        cure = search(
            problem, reason, _duration_or_reason, duration, feasible=_any_duration_or_reason
        )
        if cure is not None:
            reason = replace(reason, relaxation=cure.text)
            if cure.works:
                cured(cure.problem)
    return Plan(
        problem=problem,
        status=planned.status,
        trajectory=planned.trajectory,
        phases=_summaries(problem, planned),
        certificate=certificate,
        reason=reason,
        nominal_duration=_nominal(settled, progress) if reason is None else None,
        solve_time=time.perf_counter() - begin,
        stopped=stopped,
    )


def quickly(problem: Problem) -> Problem:
    """The problem for the structured solver alone, where Ipopt would confirm what that finds: for trials and re-planning."""
    return unchecked(problem, planner="fast") if problem.planner == "optimal" else problem


@dataclass(frozen=True)
class Replanner:
    """Plans one problem again and again, from other starts and to other targets: for control loops and studies.

    By the structured solver without Ipopt's confirmation, as with `planner: fast`, unless the problem names another planner.

    What does not depend on those, programs and compiled functions, is built once and kept, of the last dozen structures of
    motions: memory does not grow. A plan is the same to the last bit whatever was planned before. Threads may share it.
    """

    problem: Problem
    """Everything but what `plan` is given."""

    def plan(
        self,
        start: Point | None = None,
        target: Point | None = None,
        rates: Mapping[str, float] | None = None,
    ) -> Plan:
        """Plan from another start, at other rates there, to another target of the last motion that has one; SI.

        Task coordinates that a Task does not name are those of the problem's own; rates not named are 0. The plan has passed
        the check, or holds the reason, without a search for limits that would help. Raises ProblemError for points that
        cannot be, and for a target where no motion has one, or only task coordinates belong.
        """
        first = self.problem.start if start is None else _merged(self.problem.start, start)
        motion = self.problem.motion if target is None else self._to(target)
        begins = self.problem.start_rate if rates is None else rates
        return plan(
            quickly(replace(self.problem, start=first, start_rate=begins, motion=motion)),
            relaxations=False,
        )

    def plan_from(self, motion: Plan | Trajectory, at: float, target: Point | None = None) -> Plan:
        """Plan on from an instant of a motion, s, as fast as the robot then moves; otherwise as `plan`."""
        there = begun_at(
            replace(self.problem, motion=self._to(target)) if target else self.problem, motion, at
        )
        return plan(quickly(there), relaxations=False)

    def _to(self, target: Point) -> tuple[Motion, ...]:
        motions = list(self.problem.motion)
        last = next(
            (k for k in reversed(range(len(motions))) if isinstance(motions[k], (Straight, Free))),
            None,
        )
        entry = None if last is None else motions[last]
        if last is None or not isinstance(entry, (Straight, Free)):
            raise ProblemError("no motion of this problem has a target", key="target", value=target)
        if isinstance(entry, Free):
            motions[last] = replace(entry, to=_merged(entry.to, target))
        elif isinstance(target, Task):
            motions[last] = unchecked(entry, **target.given)
        else:
            reason = "a straight motion is one of task coordinates"
            raise ProblemError(
                reason, key="target", value=target, allowed="roll, tilt, spin, depth"
            )
        return tuple(motions)


def begun_at(problem: Problem, motion: Plan | Trajectory, at: float) -> Problem:
    """The problem begun from an instant of a motion of its robot, s after its start, as fast as the robot then moves.

    Only a free motion begins at any speed: where the problem begins with another, a free motion named stop goes first, to
    where every joint stands that brakes nearly as hard as it may. Raises ProblemError for an instant that there is not.
    """
    motion = motion.motion if isinstance(motion, Plan) else motion
    if not 0 <= at <= motion.duration:
        allowed = f"0 s to {motion.duration:.6g} s"
        raise ProblemError(
            "not an instant of this motion", key="at", value=f"{at:g} s", allowed=allowed
        )
    state = motion.sample(motion.breaks[0] + at)
    robot = problem.robot
    fastest, strongest = np.array(
        [(joint.velocity, joint.acceleration) for joint in robot.joints]
    ).T
    q, qd = state.q[0], state.qd[0]
    qd = np.where(np.abs(qd) > JUMP * fastest, qd, 0.0)  # below it is no step to the check
    rates = task_rates(Mechanism.from_geometry(robot.geometry), q[None], qd[None])[0]
    entries, most = problem.motion, np.abs(rates).max()
    if qd.any() and not isinstance(entries[0], Free):
        stop = q + ROOM * qd * np.abs(qd) / (2 * strongest)
        entries = (Free(Joints(_four(stop)), name="stop"), *entries)
    start_rate = {
        name: float(rate)
        for name, rate in zip(TASK, rates, strict=True)
        if abs(rate) > ROUNDING * most
    }
    jerk = any(joint.jerk is not None for joint in robot.joints)
    pulls = _four(state.qdd[0]) if jerk and qd.any() else (0.0, 0.0, 0.0, 0.0)
    start = Joints(_four(q))
    return replace(
        problem, start=start, start_rate=start_rate, start_acceleration=pulls, motion=entries
    )


def _four(values: Array) -> tuple[float, float, float, float]:
    a, b, c, d = values.tolist()
    return a, b, c, d


def _merged(own: Point, other: Point) -> Point:
    """The other point, with what it leaves out of task coordinates."""
    if isinstance(own, Task) and isinstance(other, Task):
        return unchecked(own, **other.given)
    return other


def _nominal(problem: Problem, progress: Progress) -> float | None:
    """Duration of the motion for friction as stated and an empty tip, where the plan holds for a range of them."""
    if problem.friction is None and problem.payload is None:
        return None
    progress("for comparison without the range")
    planned = plan_motion(replace(problem, friction=None, payload=None))
    return None if planned.trajectory is None else planned.trajectory.duration


def _summaries(problem: Problem, planned: PlannerResult) -> tuple[PhaseSummary, ...]:
    """Of the phases, with how they keep what is promised of their paths."""
    kept: dict[Span, WayKept] = {}
    told = any(
        getattr(each, "blend", None) or getattr(each, "constant_speed", None)
        for each in problem.motion
    )
    if planned.trajectory is not None and told:
        mechanism = Mechanism.from_geometry(problem.robot.geometry)
        kept = {
            each.way.span: each
            for each in promises_kept(planned.trajectory, mechanism, problem.task_limits)
        }
    spans = () if planned.trajectory is None else planned.trajectory.phases
    return tuple(
        _summary(each, kept.get(span)) for each, span in zip_longest(planned.phases, spans)
    )


def _summary(planned: PlannedPhase, kept: WayKept | None) -> PhaseSummary:
    phase, confirmation = planned.phase, planned.motion.confirmation
    start, end, error = (kept and kept.stretch) or (None, None, None)
    return PhaseSummary(
        name=phase.motion.name,
        duration=planned.duration,
        toppra_duration=planned.toppra_duration,
        lower_bound=planned.lower_bound,
        task_start=tuple(phase.start.tolist()),
        task_end=tuple(phase.end.tolist()),
        branch=phase.branch,
        iterations=planned.motion.iterations,
        solver=planned.motion.solver,
        confirmation_iterations=None if confirmation is None else confirmation.iterations,
        confirmation_difference=None if confirmation is None else confirmation.difference,
        corner_departure=kept.departure if kept and kept.way.distances else None,
        corner_reach=kept.reach if kept else None,
        constant_speed=kept.way.speed if kept else None,
        constant_from=start,
        constant_to=end,
        constant_error=error,
    )


def _attempt(
    problem: Problem,
    progress: Progress,
    found: Callable[[Trajectory], None],
    *,
    warm: bool = True,
    turning: bool = True,
) -> Outcome:
    """Plan, check, and where a motor gets too hot trade time for heat; the reason where there is no certified motion.

    warm: plan a motion even where no motion is cool enough. turning: joints may turn back between points.
    """
    outcome = _tightened(problem, progress, found, warm=warm, turning=turning)
    if not _excess(outcome) or hopelessly_hot(problem) is not None:
        return outcome
    progress("slowing down, for a motor gets too hot")
    return _Cooling(problem, progress, found, outcome).best() or outcome


def _tightened(
    problem: Problem,
    progress: Progress,
    found: Callable[[Trajectory], None],
    cooling: Array | None = None,
    *,
    warm: bool = True,
    turning: bool = True,
) -> Outcome:
    """Plan and check, tightening what is exceeded; where that does not help, without turning points of its own.

    A motion at TOPP-RA's pace that exceeds a limit between TOPP-RA's points is planned without that pace first.
    """
    strict, turned, paced = problem, False, True
    for attempt in range(1, ATTEMPTS + 1):
        planned = plan_motion(
            unchecked(strict, robot=problem.robot),
            strict.robot,
            progress,
            cooling,
            warm=warm,
            turning=turning,
            paced=paced,
        )
        turned = turned or any(phase.turns_back for phase in planned.phases)
        outcome: Outcome = planned, None, planned.reason
        if planned.trajectory is None:
            break
        found(planned.trajectory)
        progress("independent check" if attempt == 1 else f"independent check, attempt {attempt}")
        certificate = check(planned.trajectory, problem.robot, problem.task_limits, seal=True)
        outcome = (
            planned,
            certificate,
            None if certificate.passed else _exceeded(problem, certificate),
        )
        if not certificate.passed and any(phase.paced for phase in planned.phases):
            paced = False
            continue
        stricter = (
            None if certificate.passed or attempt == ATTEMPTS else tightened(strict, certificate)
        )
        if stricter is None:
            break
        strict = stricter
    if turned and outcome[2] is not None:
        return _tightened(problem, progress, found, cooling, warm=warm, turning=False)
    return outcome


def tightened(problem: Problem, certificate: Certificate) -> Problem | None:
    """The problem with stricter limits, by what the check found exceeded between the planner's points.

    None where nothing that is exceeded can be tightened.
    """
    strict = problem
    for found in certificate.violations:
        limit = next(
            (each for each in strict.all_limits if each.key == (found.name, found.joint)), None
        )
        stricter = None if limit is None else limit.tightened(found.worst, found.limit)
        if stricter is not None:
            try:
                strict = stricter.on(strict)
            except ProblemError:  # a point, or the port of the eye, lies between the two bounds
                return None
    return None if strict is problem else strict


def _excess(outcome: Outcome) -> dict[str, float]:
    """(RMS/limit)² − 1 of the motors whose continuous torque is exceeded, by joint; empty where something else is, too."""
    certificate = outcome[1]
    if certificate is None:
        return {}
    if any(each.name != ContinuousTorque.name for each in certificate.violations):
        return {}
    # of several cases of friction and payload the last and worst counts
    worst = sorted(certificate.violations, key=lambda each: -each.margin)
    return {str(each.joint): (each.worst / each.limit) ** 2 - 1 for each in worst}


@dataclass(eq=False)
class _Cooling:
    """The search for the fastest motion in which no motor gets too hot: min T subject to E_i ≤ n_i² (T + pause).

    E_i is ∫ τ_i² dt over all phases, n_i the nominal torque. With a multiplier λ in [0, 1) of the constraint every phase by
    itself minimises T + λ/(1 − λ) Σ E_i/n_i² (Lagrangian relaxation; the phases share λ alone), and λ is found by the check's
    RMS torques: at λ = 1 time is worth nothing, so nothing is gained beyond, but motors cool in phases in which they stand.
    """

    problem: Problem
    progress: Progress
    found: Callable[[Trajectory], None]
    first: Outcome
    """Without cooling."""
    hot: set[str] = field(default_factory=set)

    def best(self) -> Outcome | None:
        """The fastest certified motion; None where none was found."""
        excess = _excess(self.first)
        self.hot |= set(excess)
        low, over = 0.0, max(excess.values())
        last = self.first
        timed = self.problem.duration is not None or all(
            entry.duration is not None for entry in self.problem.motion
        )
        for multiplier in MULTIPLIERS[:1] if timed else MULTIPLIERS:
            outcome = self._with(multiplier)
            if outcome[2] is None:
                return outcome if timed else self._between((low, over), multiplier, outcome)
            excess = _excess(outcome)
            if not excess:
                break
            last, least = outcome, max(excess.values())
            self.hot |= set(excess)
            if least > (1 - HELPS) * over and low > 0:
                break
            low, over = multiplier, least
        return self._resting(last)

    def _with(self, multiplier: float) -> Outcome:
        weight = multiplier / (1 - multiplier)
        cooling = np.array(
            [weight if joint.name in self.hot else 0.0 for joint in self.problem.robot.joints]
        )
        if self.problem.planner == "optimal":
            quick = _tightened(quickly(self.problem), _ignore, _ignore, cooling)
            if max(_excess(quick).values(), default=0.0) > CERTAIN:
                return quick
        return _tightened(self.problem, self.progress, self.found, cooling)

    def _between(self, low: tuple[float, float], high: float, best: Outcome) -> Outcome:
        """The least multiplier with which the motion passes, by false position; low: one that does not do, and its excess."""
        left, over = low
        under = self._reserve(best)
        for _ in range(STEPS):
            if under < RESERVE:
                break
            share = float(np.clip(over / (over + under), 0.1, 0.9))
            middle = left + share * (high - left)
            outcome = self._with(middle)
            if outcome[2] is None:
                high, best, under = middle, outcome, self._reserve(outcome)
                over /= 2  # Illinois
            else:
                left, over = middle, max(_excess(outcome).values(), default=over)
        return best

    def _reserve(self, outcome: Outcome) -> float:
        """1 − (RMS/limit)² of the hottest of the motors."""
        limits = () if outcome[1] is None else outcome[1].limits
        mine = (
            each for each in limits if each.name == ContinuousTorque.name and each.joint in self.hot
        )
        return 1 - max(((each.worst / each.limit) ** 2 for each in mine), default=0.0)

    def _resting(self, outcome: Outcome) -> Outcome | None:
        """The same motion, slower where the hot motors stand, so that they cool by the end; None where they never do."""
        planned, excess, problem = outcome[0], _excess(outcome), self.problem
        if (
            problem.duration is not None
            or len(planned.phases) != len(problem.motion)
            or planned.trajectory is None
        ):
            return None
        hot = [i for i, joint in enumerate(problem.robot.joints) if joint.name in self.hot]
        standing = [
            entry.duration is None
            and not isinstance(entry, (Follow, Scan))
            and not phase.motion.coefficients[:, 1:, hot].any()
            for entry, phase in zip(problem.motion, planned.phases, strict=True)
        ]
        least = sum(
            phase.duration for phase, stands in zip(planned.phases, standing, strict=True) if stands
        )
        if not least:
            return None
        more = (
            max(excess.values())
            * (1 + BARELY)
            * (planned.trajectory.duration + (problem.duty or 0.0))
        )
        durations = [
            phase.duration * (1 + more / least) if stands and phase.duration else None
            for phase, stands in zip(planned.phases, standing, strict=True)
        ]
        motion = tuple(map(_lasting, problem.motion, durations))
        found = replace(self, problem=replace(problem, motion=motion))._with(MULTIPLIERS[-1])
        if found[2] is not None:
            return None
        # the durations are ours, so bounds and cross-checks are those of the fastest motion
        phases = tuple(
            replace(new, lower_bound=old.lower_bound)
            for new, old in zip(found[0].phases, planned.phases, strict=True)
        )
        return replace(found[0], phases=phases), found[1], None


def _lasting(entry: Motion, duration: float | None) -> Motion:
    return (
        entry
        if duration is None or isinstance(entry, (Follow, Scan))
        else replace(entry, duration=duration)
    )


def _ignore(_: object) -> None:
    pass


def _duration_or_reason(problem: Problem) -> float | Reason:
    return _tried(quickly(problem), partial(_attempt, progress=_ignore, found=_ignore), "nearest")


def _any_duration_or_reason(problem: Problem) -> float | Reason:
    """Of a motion, or the reason why there is none, with no effort to make it fast or cool."""
    timed = problem.duration is not None or any(
        entry.duration is not None for entry in problem.motion
    )
    if problem.objective == "time then heat":
        problem = unchecked(problem, objective="time")
    # where joints turn back a motion may be short enough
    return _tried(
        quickly(problem), partial(_attempt, progress=_ignore, found=_ignore, turning=timed), "any"
    )


def _tried(
    problem: Problem, attempt: Callable[[Problem], Outcome], enough: Enough
) -> float | Reason:
    (planned, _, reason), _, _ = on_any_branch(problem, attempt, enough=enough)
    if reason is not None or planned.trajectory is None:
        return reason or Reason(None, None, None, None, "no motion found")
    return planned.trajectory.duration


def plan_to_folder(
    problem: Problem,
    folder: Path,
    progress: Progress = lambda _: None,
    drawer: FigureProcess | None = None,
    rate: float | None = None,
) -> tuple[Plan, dict[str, Path]]:
    """Plan and write plan.json, trajectory.csv and the figures; drawer and rate as in `write_folder`.

    Nothing is written without a plan that has passed the check, so that no unchecked motion leaves the program. The first
    Ctrl-C during a search for something faster ends that search.
    """

    def found(trajectory: Trajectory) -> None:
        if drawer is not None:
            drawer.draw("motion", trajectory, problem.robot)

    result = plan(problem, progress, found, stoppable=True)
    if not result.passed:
        return result, {}
    progress("writing results")
    return result, write_folder(result, folder, drawer, rate)


def _exceeded(problem: Problem, certificate: Certificate) -> Reason:
    """The worst violation that the check found and tightening did not cure."""
    worst = certificate.worst
    limit: Limit | None = next(
        (own for own in problem.all_limits if own.key == (worst.name, worst.joint)), None
    )
    if worst.name in JUMPS and worst.joint is not None:
        limit = Jump(worst.joint, worst.limit, derivative=JUMPS.index(worst.name))
    joint = "" if worst.joint is None else f" of joint {worst.joint}"
    text = (
        f"the independent check found {worst.name}{joint} exceeded: {worst.worst:.6g} {worst.unit} against "
        f"{worst.limit:.6g} {worst.unit} at t = {worst.time:.4f} s; the motion is not written"
    )
    required, available = worst.worst, worst.limit
    if isinstance(limit, SelfLocking) or (limit is not None and limit.is_floor):
        required, available = available, required
    if isinstance(limit, SelfLocking):
        text = (
            f"the drive{joint} does not hold by itself: its friction coefficient may be as low as {available:.4g}, "
            f"self-locking needs {required:.4g}; the load would drive it back"
        )
    where: str | None = f"t = {worst.time:.4f} s"
    if isinstance(limit, ContinuousTorque):
        where = None
        text = (
            f"the motor{joint} would run at an RMS torque of {1e3 * required:.6g} mN·m, it may do "
            f"{1e3 * available:.6g} mN·m for all time; the motion is not written"
        )
    return Reason(limit, where, required, available, text)
