"""The whole program: problem → plan → check → requirements → files. The command line is a skin over this."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.pipeline.folder import write_folder
from ssm_planner.pipeline.relaxation import search
from ssm_planner.planning.planner import PlannedPhase, PlannerResult, plan_motion
from ssm_planner.planning.reason import Reason
from ssm_planner.plans import PhaseSummary, Plan
from ssm_planner.problem.limits import JUMPS, ContinuousTorque, Jump, Limit, MotorTorque, SelfLocking
from ssm_planner.problem.problem import Problem
from ssm_planner.reporting.figures.process import FigureProcess
from ssm_planner.trajectory import Trajectory
from ssm_planner.verification.certificate import Certificate
from ssm_planner.verification.check import check

ATTEMPTS = 4
MOST_HEAT = 0.25
"""Excess of a continuous torque beyond which smaller accelerations would hardly cure it, and take for ever."""
HELPS = 0.5
"""Share of that excess that may remain after a tightening for another one to be tried."""

Progress = Callable[[str], None]
Outcome = tuple[PlannerResult, Certificate | None, Reason | None]
"""What was planned, its certificate, and the reason where it is none that passed."""


def plan(
    problem: Problem,
    progress: Progress = lambda _: None,
    found: Callable[[Trajectory], None] = lambda _: None,
    relaxations: bool = True,
) -> Plan:
    """Plan a problem, check the plan by code that did not make it.

    Where the check finds a limit exceeded between the planner's nodes, that limit is tightened by the excess and the motion
    planned again. found: called with each motion before it is checked. Never raises for an infeasible problem: the plan
    then holds the reason, and unless `relaxations` is false the smallest change of a limit with which there is a motion.
    """
    begin = time.perf_counter()
    planned, certificate, reason = _attempt(problem, progress, found)
    if reason is not None and relaxations:
        progress("looking for a relaxation")
        duration = None if planned.trajectory is None else planned.trajectory.duration
        cure = search(problem, reason, _duration_or_reason, duration)
        reason = reason if cure is None else replace(reason, relaxation=cure.text)
    return Plan(
        problem=problem,
        status=planned.status,
        trajectory=planned.trajectory,
        phases=tuple(map(_summary, planned.phases)),
        certificate=certificate,
        reason=reason,
        nominal_duration=_nominal(problem, progress) if reason is None else None,
        solve_time=time.perf_counter() - begin,
    )


def _nominal(problem: Problem, progress: Progress) -> float | None:
    """Duration of the motion for friction as stated and an empty tip, where the plan holds for a range of them."""
    if problem.friction is None and problem.payload is None:
        return None
    progress("for comparison without the range")
    planned = plan_motion(replace(problem, friction=None, payload=None))
    return None if planned.trajectory is None else planned.trajectory.duration


def _summary(planned: PlannedPhase) -> PhaseSummary:
    phase = planned.phase
    return PhaseSummary(
        name=phase.motion.name,
        duration=planned.duration,
        toppra_duration=planned.toppra_duration,
        lower_bound=planned.lower_bound,
        task_start=tuple(phase.start.tolist()),
        task_end=tuple(phase.end.tolist()),
        branch=phase.branch,
        iterations=planned.motion.iterations,
    )


def _attempt(problem: Problem, progress: Progress, found: Callable[[Trajectory], None]) -> Outcome:
    """Plan and check, tightening what is exceeded; the reason why there is no certified motion where there is none."""
    strict: Strictness | None = Strictness(problem)
    first: Outcome | None = None
    attempt = 1
    while True:
        assert strict is not None
        planned = plan_motion(replace(strict.problem, robot=problem.robot), strict.problem.robot, progress)
        if planned.trajectory is None:
            return _blamed(first, (planned, None, planned.reason))
        found(planned.trajectory)
        progress("independent check" if attempt == 1 else f"independent check, attempt {attempt}")
        certificate = check(planned.trajectory, problem.robot, problem.task_limits, seal=True)
        strict = strict.more(certificate)
        outcome = planned, certificate, None if certificate.passed else _exceeded(problem, certificate)
        if certificate.passed:
            return outcome
        if attempt == ATTEMPTS or strict is None:
            return _blamed(first, outcome)
        first = first or outcome
        attempt += 1


@dataclass(frozen=True, eq=False)
class Strictness:
    """A problem with stricter limits for the planner where the check found one exceeded between the planner's points."""

    problem: Problem
    heat: Mapping[str | None, float] = field(default_factory=dict)
    """Margin of the continuous torque before the last tightening, by joint."""

    def more(self, certificate: Certificate) -> Strictness | None:
        """Stricter by what is exceeded; None where nothing that is exceeded can be tightened."""
        problem, held, heat = self.problem, False, dict(self.heat)
        for found in certificate.violations:
            limits = {limit.key: limit for limit in problem.all_limits}
            limit = limits.get((found.name, found.joint))
            stricter: Limit | None
            if isinstance(limit, ContinuousTorque) and found.margin > -MOST_HEAT:
                # a smaller peak helps only where acceleration makes the heat; against friction and weight nothing does
                if found.margin < HELPS * heat.get(found.joint, -np.inf):
                    return None
                heat[found.joint] = found.margin
                peak = limits[MotorTorque.name, found.joint]
                assert isinstance(peak, MotorTorque)
                largest = min(peak.largest, _peak(certificate, peak))
                stricter = replace(peak, largest=largest).tightened(found.worst, found.limit)
            else:
                stricter = None if limit is None else limit.tightened(found.worst, found.limit)
            if stricter is not None:
                try:
                    problem, held = stricter.on(problem), True
                except ProblemError:  # a point, or the port of the eye, lies between the two bounds
                    return None
        return Strictness(problem, heat) if held else None


def _peak(certificate: Certificate, limit: MotorTorque) -> float:
    """The largest value that was found of a motor torque."""
    return max((found.worst for found in certificate.limits if (found.name, found.joint) == limit.key), default=np.inf)


def _blamed(first: Outcome | None, last: Outcome) -> Outcome:
    """Of an attempt under the problem's own limits and one under stricter ones, that whose reason is to be given.

    Where a motor gets too hot over the whole motion, smaller peaks may not help, and what stands in the way of a motion
    with these is no limit of the problem.
    """
    if first is not None and first[2] is not None and isinstance(first[2].limit, ContinuousTorque):
        return first
    return last


def _duration_or_reason(problem: Problem) -> float | Reason:
    planned, _, reason = _attempt(problem, lambda _: None, lambda _: None)
    if reason is not None or planned.trajectory is None:
        return reason or Reason(None, None, None, None, "no motion found")
    return planned.trajectory.duration


def plan_to_folder(
    problem: Problem, folder: Path, progress: Progress = lambda _: None, drawer: FigureProcess | None = None
) -> tuple[Plan, dict[str, Path]]:
    """Plan and write plan.json, trajectory.csv and the figures; drawer as in `write_folder`.

    Nothing is written without a plan that has passed the check, so that no unchecked motion leaves the program.
    """

    def found(trajectory: Trajectory) -> None:
        if drawer is not None:
            drawer.draw("motion", trajectory, problem.robot)

    result = plan(problem, progress, found)
    if not result.passed:
        return result, {}
    progress("writing results")
    return result, write_folder(result, folder, drawer)


def _exceeded(problem: Problem, certificate: Certificate) -> Reason:
    """The worst violation that the check found and tightening did not cure."""
    worst = certificate.worst
    limit: Limit | None = next((own for own in problem.all_limits if own.key == (worst.name, worst.joint)), None)
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
