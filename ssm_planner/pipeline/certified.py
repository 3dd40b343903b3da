"""Planning with an independent check of the motion.

`plan_and_check` plans a problem and checks the motion with the package `verification`, which shares
no code with the planner. After a failed check, the limits that the motion exceeds are tightened by
their excess, and the problem is planned again, up to `MAX_PLANNING_ROUNDS` times.
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
"""Largest number of rounds of planning and checking.

In all known problems, a fourth round failed if the third one failed.
"""


@record
class Outcome:
    """A planned motion with its certificate, or the reason why there is no certified motion.

    The certificate is the result of the independent check of all limits.
    """

    planned: PlannerResult
    """Result of the planner."""
    certificate: Certificate | None
    """Result of the check. None without a motion."""
    reason: Reason | None
    """Why the motion failed the check, or why there is none. None if it passed."""

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

        It is negative if no motor gets too hot. None if there is no certificate, if the motion
        exceeds another limit, or if no motor is checked for heat.
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

    If the check finds that the motion exceeds a limit, the limit is tightened by the excess, and
    the problem is planned again, up to `MAX_PLANNING_ROUNDS` times.

    Parameters
    ----------
    problem : Problem
        The problem.
    work : Work
        Counter of the work of all solvers.
    progress : callable
        Called with a message for each step.
    on_motion : callable
        Called with each motion before its check.
    cooling : (4,) array or None
        Weights of the motors' heat relative to time in the objective. None: heat does not count.
    may_overheat : bool
        True if a motion is planned even if every motion makes a motor too hot.

    Returns
    -------
    Outcome
        The last motion, with its certificate, and with the reason if it failed.
    """
    strict = problem
    for round_number in range(1, MAX_PLANNING_ROUNDS + 1):
        # The planner gets both the robot itself and the robot with stricter limits.
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
        The problem with its limits.
    result : PlannerResult
        Result of the planner.

    Returns
    -------
    Outcome
        The motion with its certificate. Without a motion, the outcome has the planner's reason.
    """
    if result.trajectory is None:
        return Outcome(result, None, result.reason)
    certificate = check(result.trajectory, problem.robot, problem.task_limits, seal=True)
    reason = None if certificate.passed else violation_reason(problem, certificate)
    return Outcome(result, certificate, reason)


def tighten_limits(problem: Problem, certificate: Certificate) -> Problem | None:
    """Return the problem with stricter limits, after a check has found limits exceeded.

    The planner evaluates most limits at fewer instants than the check, so a motion may exceed a
    limit between these instants. Each limit that is exceeded is tightened by its excess.

    Parameters
    ----------
    problem : Problem
        The problem that was planned.
    certificate : Certificate
        Result of the check with the original limits.

    Returns
    -------
    Problem or None
        None if no exceeded limit can be tightened, or if a point of the problem exceeds a stricter
        limit.
    """
    strict = problem
    for violation in certificate.violations:
        limit = strict.limit(violation.name, violation.joint)
        stricter = None if limit is None else limit.tightened(violation.worst, violation.limit)
        if stricter is not None:
            try:
                strict = stricter.on(strict)
            # A point, or the port of the eye, lies between the old and the stricter bound.
            except ProblemError:
                return None
    return None if strict is problem else strict


def violation_reason(problem: Problem, certificate: Certificate) -> Reason:
    """Return the reason for a failed check: the limit that the motion exceeds most.

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
    # The limit is a lower bound here, so the found value is the available one.
    if isinstance(limit, SelfLocking) or (limit is not None and limit.is_floor):
        required, available = available, required
    return Reason(limit, instant, required, available, text)
