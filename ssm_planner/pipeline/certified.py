"""Planning with a check: plan, check, and tighten the limits that the check finds exceeded."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.planning.planner import PlannerResult, plan_motion
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.work import Work
from ssm_planner.problem import JUMPS, ContinuousTorque, Jump, Problem, SelfLocking, unchecked
from ssm_planner.progress import Progress, Step, silent
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, record
from ssm_planner.verification.certificate import Certificate
from ssm_planner.verification.check import check

PLANNING_ROUNDS = 4
"""Largest number of rounds of planning and checking.

A fourth round has never helped where the third did not.
"""


@record
class Outcome:
    """A planned motion, its certificate, and the reason why it is rejected."""

    planned: PlannerResult
    certificate: Certificate | None
    reason: Reason | None
    """None if the motion passed the check."""

    @property
    def passed(self) -> bool:
        """True if the motion is certified."""
        return self.reason is None and self.planned.trajectory is not None

    @property
    def duration(self) -> float:
        """Duration, s. Infinite without a certified motion."""
        trajectory = self.planned.trajectory
        return trajectory.duration if self.passed and trajectory is not None else np.inf

    @property
    def duration_or_reason(self) -> float | Reason:
        """Duration of the certified motion, s, or the reason why there is none."""
        return self.reason or self.duration

    @property
    def excess_heat(self) -> float | None:
        """(RMS/limit)² − 1 of the hottest motor.

        None if another limit is exceeded, or if nothing was checked.
        """
        certificate = self.certificate
        if certificate is None:
            return None
        if any(limit.name != ContinuousTorque.name for limit in certificate.violations):
            return None
        rms = [limit for limit in certificate.limits if limit.name == ContinuousTorque.name]
        return max(((limit.worst / limit.limit) ** 2 - 1 for limit in rms), default=None)

    @property
    def hot_joints(self) -> set[str]:
        """Names of the joints whose motors exceed their continuous torque."""
        violations = () if self.certificate is None else self.certificate.violations
        return {str(limit.joint) for limit in violations if limit.name == ContinuousTorque.name}


def plan_and_check(
    problem: Problem,
    work: Work,
    progress: Progress = silent,
    on_motion: Callable[[Trajectory], None] = silent,
    cooling: Array | None = None,
    *,
    may_overheat: bool = True,
) -> Outcome:
    """Plan a problem and check the motion.

    If the check finds a limit exceeded, the limit is tightened by the excess and the problem is
    planned again.

    Parameters
    ----------
    problem : Problem
        The problem.
    work : Work
        Counter of the work.
    progress : callable
        Called with messages.
    on_motion : callable
        Called with each motion before its check.
    cooling : (4,) array or None
        Weights of the motors' heat, as in `plan_motion`.
    may_overheat : bool
        Plan a motion even if no motion keeps the motors cool enough.

    Returns
    -------
    Outcome
        The last motion, with its certificate and the reason if it failed.
    """
    strict = problem
    for number in range(1, PLANNING_ROUNDS + 1):
        result = plan_motion(
            unchecked(strict, robot=problem.robot),
            strict.robot,
            progress,
            cooling,
            may_overheat=may_overheat,
            work=work,
        )
        if result.trajectory is not None:
            on_motion(result.trajectory)
            attempt = f", attempt {number}" if number > 1 else ""
            progress(Step(f"independent check{attempt}"))
        outcome = checked(problem, result)
        certificate = outcome.certificate
        stricter = None if certificate is None else tightened(strict, certificate)
        if stricter is None:
            break
        strict = stricter
    return outcome


def checked(problem: Problem, result: PlannerResult) -> Outcome:
    """Check a motion, and return it with its certificate."""
    if result.trajectory is None:
        return Outcome(result, None, result.reason)
    certificate = check(result.trajectory, problem.robot, problem.task_limits, seal=True)
    reason = None if certificate.passed else exceeded(problem, certificate)
    return Outcome(result, certificate, reason)


def tightened(problem: Problem, certificate: Certificate) -> Problem | None:
    """Return the problem with tighter limits, by the excess that the check found between nodes.

    None if no exceeded limit can be tightened.
    """
    strict = problem
    for violation in certificate.violations:
        limit = strict.limit(violation.name, violation.joint)
        stricter = None if limit is None else limit.tightened(violation.worst, violation.limit)
        if stricter is not None:
            try:
                strict = stricter.on(strict)
            except ProblemError:  # A point, or the port of the eye, lies between the two bounds.
                return None
    return None if strict is problem else strict


def exceeded(problem: Problem, certificate: Certificate) -> Reason:
    """Return the worst violation, which tightening did not cure, as a reason."""
    violation = certificate.worst
    limit = problem.limit(violation.name, violation.joint)
    if violation.name in JUMPS and violation.joint is not None:
        limit = Jump(violation.joint, violation.limit, derivative=JUMPS.index(violation.name))
    joint = "" if violation.joint is None else f" of joint {violation.joint}"
    required, available = violation.worst, violation.limit
    instant: str | None = f"t = {violation.time:.4f} s"
    if isinstance(limit, ContinuousTorque):
        instant = None
        text = (
            f"the motor{joint} would run at an RMS torque of {1e3 * required:.6g} mN·m, but "
            f"its continuous torque is {1e3 * available:.6g} mN·m; the motion is not written"
        )
    elif isinstance(limit, SelfLocking):
        text = (
            f"the drive{joint} is not self-locking: its friction coefficient may be as low as "
            f"{required:.4g}, but self-locking requires {available:.4g}; "
            "the load would drive it back"
        )
    else:
        text = (
            f"the independent check found {violation.name}{joint} exceeded: {required:.6g} "
            f"{violation.unit} against {available:.6g} {violation.unit} at {instant}; "
            "the motion is not written"
        )
    if isinstance(limit, SelfLocking) or (limit is not None and limit.is_floor):
        required, available = available, required
    return Reason(limit, instant, required, available, text)
