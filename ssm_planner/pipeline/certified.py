"""Planning with an independent check of the motion.

`plan_and_check` plans a problem and checks the motion with the package `verification`, which
evaluates every limit without the planner. If the motion exceeds limits, they are made stricter, and
the problem is planned again, until `MAX_PLANNING_ROUNDS` motions have been planned.
"""

from collections.abc import Callable

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.planning.planner import PlannerResult, plan_motion
from ssm_planner.planning.reason import Reason
from ssm_planner.planning.work import Work
from ssm_planner.problem import (
    JUMP_NAMES,
    ContinuousTorque,
    Jump,
    Problem,
    SelfLocking,
    unchecked_copy,
)
from ssm_planner.progress import Progress, Step, silent
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, record
from ssm_planner.verification.certificate import Certificate
from ssm_planner.verification.check import check

MAX_PLANNING_ROUNDS = 4
"""Largest number of times that a problem is planned and checked, with stricter limits each time.

In all known problems, the fourth round failed whenever the third one had failed.
"""


@record
class Outcome:
    """A planned motion with the result of its check, or the reason why planning failed.

    A motion is certified if it has passed the independent check of all limits. Its certificate is
    the result of this check.
    """

    planned: PlannerResult
    """Result of the planner."""
    certificate: Certificate | None
    """Result of the check. None without a motion."""
    reason: Reason | None
    """Why the motion failed the check, or why planning failed. None if a motion passed."""

    @property
    def passed(self) -> bool:
        """True if there is a motion that passed the check."""
        return self.reason is None and self.planned.trajectory is not None

    @property
    def duration(self) -> float:
        """Duration of the certified motion, s. Infinite without one."""
        trajectory = self.planned.trajectory
        return trajectory.duration if self.passed and trajectory is not None else np.inf

    @property
    def excess_heat(self) -> float | None:
        """Relative excess of heat of the hottest motor, (RMS torque / continuous torque)² − 1.

        The heat of a motor is proportional to its squared RMS torque. The excess is negative if no
        motor gets too hot. It is None without a certificate, if the motion exceeds another
        limit, or if no motor is checked for heat.
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
    """Plan a motion for a problem and check it independently.

    If the check finds that the motion exceeds a limit, the planner gets a stricter limit and plans
    again, until `MAX_PLANNING_ROUNDS` motions have been planned. The check always uses the original
    limits.

    Parameters
    ----------
    problem : Problem
        The problem.
    work : Work
        Counter of the computational work of all solvers, to which this function adds.
    progress : callable
        Called with a message for each step.
    on_motion : callable
        Called with each motion before its check.
    cooling : (4,) array or None
        Weights of the motors' heat in the objective, s. A weight is the duration that is worth one
        second of the motor at its nominal torque. None: heat does not count.
    may_overheat : bool
        True if a motion is planned even if every possible motion makes a motor too hot.

    Returns
    -------
    Outcome
        The last motion with its certificate, and with a reason if it failed the check.
    """
    strict = problem
    for round_number in range(1, MAX_PLANNING_ROUNDS + 1):
        # The motion must keep the limits of the stricter robot. The points of the problem need only
        # keep those of the original robot, so the planner gets both.
        result = plan_motion(
            unchecked_copy(strict, robot=problem.robot),
            strict.robot,
            progress,
            cooling,
            may_overheat=may_overheat,
            work=work,
        )
        if result.trajectory is not None:
            on_motion(result.trajectory)
            attempt = f", attempt {round_number}" if round_number > 1 else ""
            progress(Step(f"independent check{attempt}"))
        outcome = check_result(problem, result)
        certificate = outcome.certificate
        # Further rounds only help if a limit that the motion exceeds can be tightened.
        stricter = None if certificate is None else tighten_limits(strict, certificate)
        if stricter is None:
            break
        strict = stricter
    return outcome


def check_result(problem: Problem, result: PlannerResult) -> Outcome:
    """Check a planned motion independently.

    Parameters
    ----------
    problem : Problem
        The problem with its original limits.
    result : PlannerResult
        Result of the planner, with a motion, or with the reason for the failure.

    Returns
    -------
    Outcome
        The motion with its certificate, and with a reason if it failed the check. Without a motion,
        the outcome has the planner's reason.
    """
    if result.trajectory is None:
        return Outcome(result, None, result.reason)
    certificate = check(result.trajectory, problem.robot, problem.task_limits, seal=True)
    reason = None if certificate.passed else violation_reason(problem, certificate)
    return Outcome(result, certificate, reason)


def tighten_limits(problem: Problem, certificate: Certificate) -> Problem | None:
    """Make those limits of a problem stricter that a planned motion exceeds.

    The planner evaluates most limits at fewer instants than the check, so a motion may exceed a
    limit between these instants. How much stricter a limit becomes depends on the excess
    (`Limit.tightened`).

    Parameters
    ----------
    problem : Problem
        The problem that was planned. Its limits may already be stricter than the original ones.
    certificate : Certificate
        Result of the check with the original limits.

    Returns
    -------
    Problem or None
        The problem with the stricter limits. None if none of the exceeded limits can be made
        stricter, or if a point of the problem would exceed a stricter limit.
    """
    strict = problem
    for violation in certificate.violations:
        limit = strict.limit(violation.name, violation.joint)
        stricter = None if limit is None else limit.tightened(violation.worst, violation.limit)
        if stricter is not None:
            try:
                strict = stricter.on(strict)
            # `on` refuses the limit if a point of the problem, or the port of the eye, lies between
            # the old and the stricter bound.
            except ProblemError:
                return None
    return None if strict is problem else strict


def violation_reason(problem: Problem, certificate: Certificate) -> Reason:
    """Describe why a motion failed the check, by the limit that it exceeds most.

    Parameters
    ----------
    problem : Problem
        The problem with its limits.
    certificate : Certificate
        Result of the check with at least one exceeded limit.

    Returns
    -------
    Reason
        The limit, the joint and the instant, with the value that the motion has and the value that
        is allowed.
    """
    violation = certificate.worst
    limit = problem.limit(violation.name, violation.joint)
    # Jumps of position, velocity and acceleration are not limits of a problem, so one is created.
    if violation.name in JUMP_NAMES and violation.joint is not None:
        limit = Jump(violation.joint, violation.limit, derivative=JUMP_NAMES.index(violation.name))
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
    # For a lower bound, the value of the motion is the available one, and the bound is required.
    if isinstance(limit, SelfLocking) or (limit is not None and limit.is_floor):
        required, available = available, required
    return Reason(limit, instant, required, available, text)
