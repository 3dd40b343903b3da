"""Define the result of planning, and read and write its file plan.json.

The planner returns a `Plan`. It contains the problem, the trajectory, a summary of each phase and
the certificate, from which further results follow, such as the sizing of the motors. `Plan.write`
and `Plan.save` write it, and `load_plan` reads it.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, field, replace
from functools import cache, cached_property
from importlib import metadata
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

import numpy as np

from ssm_planner.arguments import check_methods, checked
from ssm_planner.atomic import locked, replacing
from ssm_planner.deprecation import Renamed
from ssm_planner.errors import ExportError, ProblemError, TrajectoryError
from ssm_planner.kinematics import Mechanism
from ssm_planner.loading import parse_json, read_json_in_parts
from ssm_planner.problem import (
    JOINTS,
    Free,
    Joints,
    Limit,
    Problem,
    Robot,
    TaskLimits,
    TaskRange,
    convert_value,
    format_quantity,
    get_attributes,
    problem_from_plain,
    to_plain,
)
from ssm_planner.publishing import PLAN_FILE, check_generation, file_name
from ssm_planner.representation import html_table
from ssm_planner.sizing import (
    MotorRequirement,
    Sizing,
    TipError,
    extrapolation_notes,
    pause_after_motion,
    size_motion,
    tip_error,
)
from ssm_planner.stopping import Stops, controlled_stops
from ssm_planner.trajectory import DEGREE, Span, Trajectory
from ssm_planner.typing import Array, JsonObject, frozen, record
from ssm_planner.units import display_unit
from ssm_planner.verification import Certificate, seal_error
from ssm_planner.verification.check import check
from ssm_planner.verification.path_bound import Sensitivity
from ssm_planner.verification.proof import Proof, unproven_limits
from ssm_planner.verification.second_opinion import (
    GRID_TOLERANCE,
    Opinion,
    second_opinions_and_proofs,
)

if TYPE_CHECKING:  # the check reads plans and must not load the planner
    from matplotlib.axes import Axes

    from ssm_planner.planning.reason import Reason

PLAN_FORMAT = "ssm_planner plan"
"""Value of the key `format` of a plan.json."""
PLAN_VERSION = 1
"""Version of the format of a plan.json."""
PLOT_RATE = 200.0
"""Samples per second of a plotted motion."""
LARGEST_FILE = 2_000_000_000
"""Largest size of a plan.json in bytes."""
FOLDER_WRITER = "ssm_planner.pipeline.folder:write_folder"
"""Function that writes result folders.

A result folder contains pages and figures, whose modules depend on this one. `Plan.save` therefore
finds the function by its name when a plan is saved, in any process.
"""
PLAN_UNITS = {
    "time": "s",
    "q": ["rad", "rad", "rad", "m"],
    "coefficients": "q(t) = sum_k coefficients[piece][k][joint] * (t - breaks_s[piece])^k, in "
    "rad/s^k and m/s^k",
    "torque": "N*m on the motor side",
    "motor speed": "rad/s",
    "everything else": "SI, radians",
}
"""Value of the key `units` of a plan.json, which explains the file to its readers."""


def software() -> dict[str, str]:
    """Return the versions of the packages that determine the figures of a plan, by name."""
    return {name: _package_version(name) for name in ("ssm-planner", "casadi", "numpy", "scipy")}


@cache
def _package_version(package: str) -> str:
    """Return the version of an installed package, or "unknown"."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "unknown"


@frozen
class PhaseSummary:
    """Summary of one phase of a plan, with its duration and reference durations in SI units.

    A phase is an entry of the motion list of the problem.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> [phase.name for phase in ssm.load_plan("results/tilt_insert").phases]
    ['tilt', 'insert']
    """

    name: str
    """Name of the motion in the problem."""
    duration: float
    """Duration of the phase, s."""
    toppra_duration: float | None
    """Shortest duration along the path of the phase by the package toppra, s.

    None if toppra was not called or cannot compute a duration for the phase.
    """
    lower_bound: float
    """Lower bound of the duration of any motion within the same limits, s."""
    task_start: tuple[float, float, float, float]
    """Roll, tilt and spin (rad), and depth (m) at the start."""
    task_end: tuple[float, float, float, float]
    """Roll, tilt and spin (rad), and depth (m) at the end."""
    branch: int | None
    """Branch of the inverse kinematics, ±1, or None for a phase without a path."""
    iterations: int
    """Number of iterations of the solvers."""
    solver: str = "Ipopt"
    """Solver that found the motion: "Ipopt", "structured", "TOPP-RA", or "" for a pause.

    Ipopt confirms "structured" unless the planner is `fast`.
    """
    confirmation_iterations: int | None = None
    """Iterations in which Ipopt confirmed the structured solver.

    None if only one of the two solvers was used.
    """
    confirmation_difference: float | None = None
    """Relative difference between the durations of Ipopt and of the structured solver.

    The shorter motion is used.
    """
    confirmation_residual: float | None = None
    """Largest violation of the optimality conditions (KKT residual) in Ipopt's confirmation."""
    reversal_multiplier: float | None = None
    """Fraction of the duration that a further reversal of a joint would save, to first order.

    It is the largest Lagrange multiplier of the constraints on the directions in which the joints
    move. None for motions along paths.
    """
    corner_departure: float | None = None
    """Largest distance of the tip from its lines between rounded corners, m."""
    corner_reach: float | None = None
    """Largest distance between a corner and a tip position that is off the lines, m."""
    constant_speed: float | None = None
    """Constant speed of the tip between the ramps at both ends, m/s."""
    constant_from: float | None = None
    """Start of the interval with constant speed, s from the start of the phase."""
    constant_to: float | None = None
    """End of the interval with constant speed, s from the start of the phase."""
    constant_error: float | None = None
    """Largest relative error of the speed in the interval with constant speed."""
    not_judged: str | None = None
    """Reason why toppra gives no duration for the phase."""
    path_bound: float | None = None
    """Lower bound of the duration along the path of the phase, s. None if toppra was not called."""
    sensitivities: tuple[Sensitivity, ...] | None = None
    """Changes of the duration with the limits. None if toppra gives no duration for the phase."""

    def to_dict(self) -> JsonObject:
        """Convert the summary to JSON types. Fields that do not apply to this phase are omitted."""
        data = to_plain(asdict(self))
        return {
            name: value
            for name, value in data.items()
            if value is not None or name not in OPTIONAL_PHASE_FIELDS
        }

    @property
    def difference(self) -> float:
        """Relative difference of the duration from toppra's duration, or 0 without the latter."""
        return self.duration / self.toppra_duration - 1 if self.toppra_duration else 0.0

    def with_opinion(self, opinion: Opinion) -> PhaseSummary:
        """Add the result of the cross-check by toppra to the summary.

        toppra is an independent program that computes the shortest duration along a given path.

        A duration by toppra below the proven lower bound of the phase shows an error of toppra. The
        returned summary then has no such duration, and `not_judged` states the reason. A duration
        that is below the bound by a relative difference of at most `GRID_TOLERANCE`, the error of
        toppra's duration, is replaced by the bound.

        Parameters
        ----------
        opinion : Opinion
            Result of the cross-check of this phase by toppra.

        Returns
        -------
        PhaseSummary
            The summary with the fields `toppra_duration`, `path_bound`, `sensitivities` and
            `not_judged`.
        """
        duration, reason = opinion.duration, opinion.not_judged
        if duration is not None and duration < (1 - GRID_TOLERANCE) * self.lower_bound:
            reason = f"its {duration:.6g} s are below the lower bound of {self.lower_bound:.6g} s"
            duration = None
        # A duration of None stays None.
        duration = duration and max(duration, self.lower_bound)
        # If a motion is slower than its path allows, limits that toppra does not consider slow it
        # down, and toppra's sensitivities do not apply.
        is_slowed = duration is None or self.duration > (1 + TOO_SLOW_DIFFERENCE) * duration
        return replace(
            self,
            toppra_duration=duration,
            path_bound=opinion.bound and max(opinion.bound, self.lower_bound),
            sensitivities=None if is_slowed else opinion.sensitivities,
            not_judged=reason,
        )


SUMMARY_FIELDS = (
    "status",
    "duration",
    "lower_bound",
    "gap",
    "toppra_duration",
    "path_bound",
    "nominal_duration",
    "passed",
    "solve_time",
)
"""Attributes of a plan with which its summary begins."""
OPTIONAL_PHASE_FIELDS = (
    "reversal_multiplier",
    "corner_departure",
    "corner_reach",
    "constant_speed",
    "constant_from",
    "constant_to",
    "constant_error",
    "not_judged",
    "path_bound",
    "sensitivities",
)
"""Fields of PhaseSummary that plan.json omits if they are None.

They apply only to free motions, to phases with rounded corners or constant speed, or to plans that
toppra has cross-checked.
"""
TOO_FAST_DIFFERENCE = 1e-4
"""Relative difference to toppra's duration above which a motion is faster than its path allows."""
TOO_SLOW_DIFFERENCE = 1e-3
"""Relative difference to toppra's duration above which a motion is slower than necessary."""
SMALLEST_SENSITIVITY = 1e-4
"""Smallest sensitivity that is significant, as a fraction of the duration.

The duration of a plan has about this accuracy.
"""
HEAT_OBJECTIVE_ALLOWANCE = 1e-3
"""Fraction of the duration that the objective "time then heat" may add."""
LIMITS_IGNORED_BY_TOPPRA = ("continuous torque", "nut contact", "self-locking")
"""Names of limits that toppra does not consider."""
BINDING_MARGIN = 0.01
"""Relative margin below which a limit of `LIMITS_IGNORED_BY_TOPPRA` can slow a motion down."""


@check_methods
@record
class Plan:
    """Planned motion with its certificate, or the reason for a failure, in SI units and radians.

    Further properties follow from the trajectory, the robot and the certificate. They are computed
    on first use.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> plan = ssm.load_plan("results/tilt_insert")
    >>> plan.passed, plan.motion.sample(0.1).q.shape
    (True, (1, 4))
    """

    problem: Problem
    status: str
    """"solved", "infeasible" or "not converged"."""
    trajectory: Trajectory | None
    """Trajectory, or None unless the status is "solved"."""
    phases: tuple[PhaseSummary, ...] = ()
    certificate: Certificate | None = None
    """Result of the independent check.

    None unless the plan is solved and the certificate belongs to this trajectory, robot and limits.
    """
    reason: Reason | None = None
    """Reason why no motion is certified."""
    nominal_duration: float | None = None
    """Duration of the plan for nominal friction and no payload at the tip, s.

    None unless this plan is valid for a range of friction or payload.
    """
    solve_time: float | None = None
    """Solve time in s. It is not stored, so it is None for a loaded plan."""
    stopped: bool = False
    """True if the user ended the search for a faster motion."""
    candidates: tuple[tuple[Mapping[str, Any], ...], ...] = ()
    """Candidate motions of each phase that the planner tried.

    Each mapping contains the kind, bound, estimate, duration (s), outcome and effort of one
    candidate.
    """
    proof: tuple[Proof, ...] = ()
    """Bounds of each limit over continuous time. Empty if no proof was computed."""
    software: Mapping[str, str] = field(default_factory=software)
    """Versions of the software that made the plan."""
    file: Path | None = field(default=None, init=False)
    """File plan.json from which the plan was loaded, or None if Python made or changed the plan."""
    file_sha256: str | None = field(default=None, init=False)
    """SHA-256 of `file` in hexadecimal."""
    uncertified_reason: str | None = field(default=None, init=False)
    """Reason why the certificate in the file does not belong to this plan."""

    def __post_init__(self) -> None:
        if self.certificate is None or self.trajectory is None:
            object.__setattr__(self, "certificate", None)
            return
        reason = seal_error(self.certificate, self.trajectory, self.robot, self.limits)
        if reason is not None:
            object.__setattr__(self, "uncertified_reason", reason)
            object.__setattr__(self, "certificate", None)

    @property
    def robot(self) -> Robot:
        """The problem's robot."""
        return self.problem.robot

    @property
    def limits(self) -> TaskLimits:
        """Limits of the task that the problem states."""
        return self.problem.task_limits

    @property
    def motion(self) -> Trajectory:
        """Trajectory of a plan that must have one.

        Raises
        ------
        TrajectoryError
            If the plan has no trajectory.
        """
        if self.trajectory is None:
            origin = self.problem.name if self.file is None else self.file
            raise TrajectoryError(f"{origin}: this plan has no trajectory (status: {self.status})")
        return self.trajectory

    @classmethod
    def from_trajectory(cls, trajectory: Trajectory, robot: Robot, name: str = "motion") -> Plan:
        """Build the plan of a motion that another program computed, with its certificate.

        The problem of the plan is a free motion from the first to the last position of the
        trajectory.

        Parameters
        ----------
        trajectory : Trajectory
            The motion.
        robot : Robot
            Robot whose limits must hold. The motion must begin and end at rest.
        name : str
            Name of the plan, which is also the name of its result folder.

        Returns
        -------
        Plan
            Solved plan with one named section. The start time of its trajectory is 0.

        Raises
        ------
        TrajectoryError, ProblemError
            If an end of the motion is outside the joint ranges.

        Examples
        --------
        >>> import numpy as np
        >>> from ssm_planner import Plan, Trajectory, load_robot
        >>> t = np.linspace(0, 2, 101)
        >>> q = np.outer(0.05 * (1 - np.cos(np.pi * t / 2)), [1, 1, 0, 0])
        >>> qd = np.outer(0.025 * np.pi * np.sin(np.pi * t / 2), [1, 1, 0, 0])
        >>> motion = Trajectory.from_samples(t, q, qd)
        >>> Plan.from_trajectory(motion, load_robot("vitreoretinal")).duration
        2.0
        """
        start, target = trajectory.sample(trajectory.breaks[[0, -1]]).q.tolist()
        free_motion = Free(Joints(tuple(target)))
        problem = Problem(robot, Joints(tuple(start)), (free_motion,), name=name)
        times = trajectory.breaks - trajectory.breaks[0]
        phases = (Span(problem.motion[0].name or "1", 0.0, float(times[-1])),)
        motion = Trajectory(times, trajectory.coefficients, phases)
        certificate = check(motion, robot, problem.task_limits, seal=True)
        return cls(problem, "solved", motion, certificate=certificate)

    def __bool__(self) -> bool:
        """Raise TypeError, because a plan may exist without having passed its check."""
        raise TypeError("a plan is neither true nor false: ask for plan.passed")

    def _repr_html_(self) -> str:
        """Return the summary and the limits as HTML tables for notebooks."""
        limits = self.certificate._repr_html_() if self.certificate else ""
        return html_table([get_attributes(self, SUMMARY_FIELDS)]) + limits

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw the joint positions over time with matplotlib, in deg and mm.

        Parameters
        ----------
        axes : matplotlib.axes.Axes, optional
            Axes to draw on. The default is the current axes of pyplot.

        Returns
        -------
        matplotlib.axes.Axes
            The axes with one line for each joint.

        Raises
        ------
        TrajectoryError
            If the plan lacks a trajectory.
        ProblemError
            If `axes` are not axes of matplotlib.
        """
        from matplotlib import axes as types_of_axes
        from matplotlib import pyplot

        samples = self.motion.uniform(PLOT_RATE)
        axes = pyplot.gca() if axes is None else axes
        if not isinstance(axes, types_of_axes.Axes):
            raise ProblemError("no axes", key="axes", value=axes, allowed="matplotlib Axes")
        for joint, values in zip(self.robot.joints, samples.q.T, strict=True):
            unit, scale = display_unit(joint.unit)
            axes.plot(samples.t, scale * values, label=f"{joint.name} ({unit})")
        axes.set_xlabel("time (s)")
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
        return axes

    @property
    def passed(self) -> bool:
        """True if the motion passed the check, and neither proof nor cross-check contradicts."""
        certified = self.certificate is not None and self.certificate.passed
        return certified and not self.disagreements

    def cross_checked(
        self,
        ask: Callable[[], tuple[Sequence[Opinion], tuple[Proof, ...]] | None] = lambda: None,
    ) -> Plan:
        """Return the plan with toppra's durations along its paths, and the proof of its limits.

        The program toppra computes the shortest duration along a given path. The proof bounds each
        limited quantity over continuous time. The command `plan` and the method `save` call this
        method, but the function `plan` does not.

        Parameters
        ----------
        ask : callable
            Function that returns the result of `second_opinions_and_proofs` from a second process,
            or None. If it returns None, this process does the work.

        Returns
        -------
        Plan
            Plan with cross-checked phases, the proof and the version of toppra. If toppra or the
            proof contradicts the check, the plan has a `reason`. The plan is returned unchanged if
            it did not pass the check, if it has no phases, if another planner than `optimal` made
            it, or if toppra has checked it already.
        """
        is_requested = self.problem.planner == "optimal" and "toppra" not in self.software
        if not (is_requested and self.passed and self.phases):
            return self
        # These two results are computed while the second process works, and are kept.
        results = {"sizing": self.sizing, "stops": self.stops}
        opinions, proof = ask() or second_opinions_and_proofs(self.motion, self.problem)
        phases = map(PhaseSummary.with_opinion, self.phases, opinions)
        versions = {**self.software, "toppra": _package_version("toppra")}
        judged_plan = replace(self, phases=tuple(phases), software=versions, proof=proof)
        if judged_plan.disagreements:
            from ssm_planner.planning.reason import Reason

            return replace(judged_plan, reason=Reason(message="; ".join(judged_plan.disagreements)))
        vars(judged_plan).update(results)
        return judged_plan

    @property
    def duration(self) -> float | None:
        """Duration in s, or None without a trajectory."""
        return None if self.trajectory is None else self.trajectory.duration

    @property
    def cross_check(self) -> JsonObject | None:
        """Result of the cross-check by toppra, or None if toppra gave no duration.

        The mapping contains the program ("by"), the sum of its durations in s ("duration"), and the
        relative difference of the plan from it ("difference"). Only the phases for which toppra
        gave a duration count.
        """
        phases = [phase for phase in self.phases if phase.toppra_duration]
        if "toppra" not in self.software or not any(phase.solver for phase in phases):
            return None
        duration = float(sum(phase.toppra_duration or 0.0 for phase in phases))
        return {
            "by": f"toppra {self.software['toppra']}",
            "duration": duration,
            "difference": sum(phase.duration for phase in phases) / duration - 1,
        }

    @property
    def toppra_duration(self) -> float | None:
        """Shortest duration along the same paths by toppra, s. None if a phase lacks it."""
        return self._total("toppra_duration")

    @property
    def path_bound(self) -> float | None:
        """Lower bound of the duration along the same paths, s. None if a phase lacks it."""
        return self._total("path_bound")

    @property
    def sensitivities(self) -> tuple[Sensitivity, ...] | None:
        """Changes of the duration with the limits, the largest first. None if a phase lacks them.

        The changes of all phases are added for each limit. Sums below the fraction
        `SMALLEST_SENSITIVITY` of the duration are left out, because they are not significant.
        """
        changes: dict[tuple[str, str | None], float] = defaultdict(float)
        for phase in self.phases:
            if phase.sensitivities is None:
                return None
            for item in phase.sensitivities:
                changes[item.limit, item.joint] += item.seconds_per_percent
        smallest = SMALLEST_SENSITIVITY * (self.duration or 0.0)
        significant = [
            Sensitivity(limit, joint, change)
            for (limit, joint), change in changes.items()
            if change < -smallest
        ]
        significant.sort(key=lambda item: item.seconds_per_percent)
        return tuple(significant) if self.phases else None

    @property
    def confirmation(self) -> tuple[int, float] | None:
        """Number of iterations and largest relative difference of Ipopt's confirmations.

        Ipopt confirms the result of the structured solver. The iterations are those of all phases.
        The difference is that of `PhaseSummary.confirmation_difference` with the largest magnitude.
        None if Ipopt confirmed no phase.
        """
        iterations = 0
        differences = []
        for phase in self.phases:
            if phase.confirmation_difference is not None:
                iterations += phase.confirmation_iterations or 0
                differences.append(phase.confirmation_difference)
        return (iterations, max(differences, key=abs)) if differences else None

    @property
    def lower_bound(self) -> float | None:
        """Lower bound of the duration of any motion within the same limits, s."""
        return self._total("lower_bound")

    def _total(self, name: str) -> float | None:
        """Return the sum of a field over all phases.

        The result is None if the plan lacks a trajectory or phases, or if the field of a phase is
        None.

        Parameters
        ----------
        name : str
            Name of a field of `PhaseSummary`.
        """
        values = [getattr(phase, name) for phase in self.phases]
        is_complete = self.trajectory is not None and values and None not in values
        return float(sum(values)) if is_complete else None

    @property
    def gap(self) -> float | None:
        """Relative gap (duration − lower bound) / lower bound."""
        if self.duration is None or not self.lower_bound:
            return None
        return (self.duration - self.lower_bound) / self.lower_bound

    @cached_property
    def sizing(self) -> Sizing | None:
        """Check of the robot's motors and gears at an ambient temperature of 25 °C.

        The pause after each motion is that of the problem's duty. None without a trajectory.
        """
        if self.trajectory is None:
            return None
        return size_motion(self.trajectory, self.robot, pause_after_motion(self.problem))

    @cached_property
    def stops(self) -> Stops | None:
        """Quickest controlled stops from many instants of the motion.

        None for a plan that did not pass.
        """
        return controlled_stops(self.motion, self.robot, self.limits) if self.passed else None

    @property
    def requirements(self) -> tuple[MotorRequirement, ...]:
        """Torque, speed and power that the motion requires of the motor of every driven joint."""
        if self.sizing is None:
            return ()
        return tuple(joint.requirement for joint in self.sizing.joints)

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on missing data, assumptions, and limits that were not checked or not proven."""
        notes = []
        if self.uncertified_reason is not None:
            notes.append(f"not certified: {self.uncertified_reason}: plan it again")
        for requirement in self.requirements:
            notes += _motor_notes(requirement)
            notes += _friction_notes(self.robot, requirement)
        notes += _range_notes(self.problem)
        skipped_phases = ", ".join(phase.name for phase in self.phases if not phase.duration)
        if skipped_phases:
            notes.append(f"skipped because the robot is already at the end: {skipped_phases}")
        if self.trajectory is not None:
            notes += _start_notes(self.problem, self.trajectory)
            notes += _turn_notes(self.problem, self.trajectory, self.phases)
        notes += self._slow_phases()
        if self.tip_error is not None and self.tip_error.missing:
            notes.append(self.tip_error.reason)
        if self.stopped:
            notes.append("the search was stopped: other joints may be faster")
        if self.certificate is not None:
            notes += [f"not checked: {subject}" for subject in self.certificate.unchecked]
        if self.unproven:
            limits = [f"{name} of {joint}" if joint else name for name, joint in self.unproven]
            notes.append(
                f"checked by samples, but not proven at every instant: {', '.join(limits)}"
            )
        return tuple(notes)

    @property
    def unproven(self) -> list[tuple[str, str | None]]:
        """Names and joints of the limits that the proof does not cover.

        The list is empty if the plan was not proven at all, or has no certificate.
        """
        if self.certificate is None or not self.proof:
            return []
        keys = [(limit.name, limit.joint) for limit in self.certificate.limits]
        return unproven_limits(self.proof, keys)

    @cached_property
    def tip_error(self) -> TipError | None:
        """Bound on the distance of the real tip from the planned tip. None without a trajectory."""
        return None if self.trajectory is None else tip_error(self.trajectory, self.robot)

    def limit_differences(self, robot: Robot) -> tuple[str, ...]:
        """Return one sentence for each limit that differs between the plan's robot and another one.

        Parameters
        ----------
        robot : Robot
            Robot with which the plan is used.

        Returns
        -------
        tuple of str
            Sentences with the name and both bounds of the limit.
        """
        robot_limits = {limit.key: limit for limit in _limits_of(robot)}
        plan_limits = {limit.key: limit for limit in _limits_of(self.robot)}
        notes = []
        for key in {**plan_limits, **robot_limits}:
            plan_limit = plan_limits.get(key)
            robot_limit = robot_limits.get(key)
            if plan_limit == robot_limit:
                continue
            name, joint = key
            description = f"{name} of joint {joint}" if joint else name
            notes.append(
                f"the plan was made for another limit: {description}: {_bounds_text(plan_limit)}; "
                f"the robot given has {_bounds_text(robot_limit)}"
            )
        return tuple(notes)

    @property
    def disagreements(self) -> tuple[str, ...]:
        """Remarks on limits that the proof refutes, and on phases that are too fast for toppra.

        A phase is too fast if its duration is shorter than toppra's by a relative difference of
        more than `TOO_FAST_DIFFERENCE`. One of the two programs must then be wrong. The tuple is
        empty if nothing contradicts the check.
        """
        refuted = tuple(
            f"the proof refutes a limit: {proof.name} {proof.joint or ''} at {proof.time:.4f} s"
            for proof in self.proof
            if proof.verdict == "REFUTED"
        )
        return refuted + tuple(
            f"the cross-check failed: {phase.name} takes {phase.duration:.5f} s, and toppra finds "
            f"no motion of less than {phase.toppra_duration:.5f} s along its path"
            for phase in self.phases
            if "toppra" in self.software and phase.difference < -TOO_FAST_DIFFERENCE
        )

    def _slow_phases(self) -> list[str]:
        """Return remarks on phases for which toppra finds a shorter motion along the path.

        toppra is an independent program that computes the shortest duration along a path.

        There are no remarks if a limit that toppra does not consider can slow the motion down. With
        the objective "time then heat", the planner deliberately adds up to
        `HEAT_OBJECTIVE_ALLOWANCE` to the duration, so only larger differences cause a remark.
        """
        limits = self.certificate.limits if self.certificate else ()
        is_slowed = any(
            limit.name in LIMITS_IGNORED_BY_TOPPRA and limit.margin < BINDING_MARGIN
            for limit in limits
        )
        allowed = TOO_SLOW_DIFFERENCE + HEAT_OBJECTIVE_ALLOWANCE * (
            self.problem.objective == "time then heat"
        )
        return [
            f"toppra finds a motion along the path of {phase.name} that is "
            f"{100 * phase.difference:.2f} % shorter"
            for phase in self.phases
            if "toppra" in self.software and not is_slowed and phase.difference > allowed
        ]

    @property
    def path(self) -> Path:
        """File plan.json of a loaded plan, or the file that the command would write."""
        return self.file or Path("results") / file_name(self.problem.name) / PLAN_FILE

    @cached_property
    def sha256(self) -> str:
        """SHA-256 in hexadecimal of the loaded plan.json, or of the text that `write` writes."""
        return self.file_sha256 or self._serialise(len)

    def summary(self) -> JsonObject:
        """Return the content of the output of `plan --json`, in SI units and radians.

        It begins with the attributes `SUMMARY_FIELDS`. The trajectory, the complete certificate and
        the stops are only in plan.json.

        Returns
        -------
        dict
            Attributes `SUMMARY_FIELDS`, and then results of the check, the sizing and the phases as
            JSON types.
        """
        summary = {
            **get_attributes(self, SUMMARY_FIELDS),
            "cross_check": self.cross_check,
            "sensitivities": to_plain(self.sensitivities),
            "motors": [requirement.to_dict() for requirement in self.requirements],
            "sizing": None if self.sizing is None else self.sizing.to_dict(),
            "limits": self.certificate.to_dict()["limits"] if self.certificate else [],
            "tip_error": None if self.tip_error is None else self.tip_error.to_dict(),
            "reason": None if self.reason is None else self.reason.to_dict(),
            "notes": list(self.notes),
            "phases": [phase.to_dict() for phase in self.phases],
        }
        if self.stopped:
            summary["stopped"] = True
        if self.candidates:
            summary["candidates"] = to_plain(self.candidates)
        if self.proof:
            summary["proof"] = [proof.to_dict() for proof in self.proof]
        return summary

    def to_dict(self) -> JsonObject:
        """Convert the plan to the content of plan.json as JSON types, in SI units and radians.

        The same plan always gives the same content.
        """
        trajectory = None if self.trajectory is None else self.trajectory.to_dict()
        return {**self._content(), "trajectory": trajectory}

    def _content(self) -> JsonObject:
        """Return the content of plan.json with None as the trajectory.

        The trajectory is the last key, so that `_text_parts` can write it after the other content.
        """
        summary = self.summary()
        phases = summary.pop("phases")
        return {
            "format": PLAN_FORMAT,
            "version": PLAN_VERSION,
            "units": PLAN_UNITS,
            "software": dict(self.software),
            **summary,
            "solve_time": None,
            "problem": to_plain(self.problem),
            "phases": phases,
            "certificate": None if self.certificate is None else self.certificate.to_dict(),
            "stops": None if self.stops is None else self.stops.to_dict(),
            "trajectory": None,
        }

    def _text_parts(self) -> Iterator[str]:
        """Yield the text of plan.json in parts, so that a long motion needs little memory.

        Each polynomial piece of the motion is on one line. The other content precedes the
        trajectory.
        """
        text = json.dumps(self._content(), indent=1, allow_nan=False)
        if self.trajectory is None:
            yield text + "\n"
            return
        # The text ends with "trajectory": null, in which the parts of the trajectory replace null.
        yield text.removesuffix("null\n}")
        yield from self.trajectory.json_parts()
        yield "\n}\n"

    def _serialise(self, write: Callable[[bytes], object]) -> str:
        """Write the text of plan.json in parts, and compute its hash.

        Parameters
        ----------
        write : callable
            Function that receives each part in UTF-8, such as the method `write` of a file.

        Returns
        -------
        str
            SHA-256 of the text in hexadecimal.
        """
        digest = hashlib.sha256()
        for text in self._text_parts():
            data = text.encode()
            digest.update(data)
            write(data)
        return digest.hexdigest()

    def to_json(self) -> str:
        """Return the text of plan.json."""
        return "".join(self._text_parts())

    @classmethod
    def from_json(cls, data: bytes, file: Path) -> Plan:
        """Build the plan from the text of a plan.json.

        Parameters
        ----------
        data : bytes
            Content of the file.
        file : Path
            Name of the file for messages.

        Returns
        -------
        Plan
            The plan with the attributes `file` and `file_sha256`.

        Raises
        ------
        TrajectoryError
            If the version is unknown or the trajectory is missing.
        ProblemError
            If the problem is invalid.
        """
        return cls._from_document(parse_json(file, data), hashlib.sha256(data).hexdigest(), file)

    @classmethod
    def _from_document(cls, data: Any, sha256: str, file: Path) -> Plan:
        """Build the plan from the content of a plan.json.

        Parameters
        ----------
        data : object
            Content of the file as JSON types. The coefficients of the trajectory may also be an
            array (m, 6, 4).
        sha256 : str
            SHA-256 of the file in hexadecimal.
        file : Path
            Name of the file.

        Returns
        -------
        Plan
            Plan with the attributes `file` and `file_sha256`.

        Raises
        ------
        TrajectoryError
            If the format or the version is unknown, or the trajectory is missing or invalid.
        ProblemError
            If the problem or another entry is invalid.
        """
        document = _check_document(data, file)
        problem = problem_from_plain(_required_mapping(document, "problem", file), file=str(file))
        if document.get("trajectory") is None:
            raise TrajectoryError(
                f"{file}: this plan has no trajectory (status: {document.get('status')})"
            )
        try:
            trajectory = Trajectory.from_dict(_required_mapping(document, "trajectory", file))
            tables = {
                key: convert_value(table_type, document.get(key) or [], key, build=True)
                for key, table_type in _TABLES.items()
            }
            certificate = None
            if document.get("certificate") is not None:
                certificate = Certificate.from_dict(document["certificate"])
            nominal_duration = convert_value(
                float | None, document.get("nominal_duration"), "nominal_duration"
            )
            candidates = tuple(tuple(map(vars, row)) for row in tables.pop("candidates"))
            software_versions = convert_value(
                Mapping[str, str], document.get("software") or {}, "software"
            )
            plan = cls(
                problem=problem,
                status=str(document.get("status")),
                trajectory=trajectory,
                certificate=certificate,
                nominal_duration=nominal_duration,
                stopped=document.get("stopped") is True,
                candidates=candidates,
                software=software_versions,
                **tables,
            )
        except TrajectoryError as error:
            raise TrajectoryError(f"{file}: {error}") from error
        except ProblemError as error:
            error.file = str(file)
            raise
        object.__setattr__(plan, "file", file)
        object.__setattr__(plan, "file_sha256", sha256)
        return plan

    def write(self, path: Path) -> Path:
        """Write plan.json alone, without the other files of a result folder.

        Parameters
        ----------
        path : Path
            File to write.

        Returns
        -------
        Path
            The same path.

        Raises
        ------
        ExportError
            If the file cannot be written.
        """
        with replacing(path) as temporary, temporary.open("wb") as file:
            sha256 = self._serialise(file.write)
        if self.file_sha256 is None:
            vars(self)["sha256"] = sha256  # so that the property does not serialise again
        return path

    def save(self, folder: str | Path) -> dict[str, Path]:
        """Write the result folder that `ssm-planner plan` writes.

        The folder contains plan.json, report.html, trajectory.csv and figures. The method
        `cross_checked` first compares the plan with toppra and proves its limits.

        Parameters
        ----------
        folder : str or Path
            Folder of the results.

        Returns
        -------
        dict
            Paths of the written files by name.

        Raises
        ------
        ExportError
            If a file cannot be written, or if the plan did not pass its check.
        """
        plan = self.cross_checked()
        if not plan.passed:
            raise ExportError(
                f"{self.problem.name}: the plan has no passed certificate (status: {self.status}): "
                "not written"
            )
        write_folder = resolve_name(FOLDER_WRITER)
        return write_folder(plan, Path(folder))

    doubt = Renamed("uncertified_reason")
    limits_unlike = Renamed("limit_differences")


@frozen
class _CandidateRow:
    """Entry of `Plan.candidates`, for the check of a plan.json."""

    kind: str
    bound: float | None
    estimate: float | None
    outcome: str
    duration: float | None
    effort: float


_TABLES: dict[str, Any] = {
    "phases": tuple[PhaseSummary, ...],
    "proof": tuple[Proof, ...],
    "candidates": tuple[tuple[_CandidateRow, ...], ...],
}
"""Types of the lists in a plan.json, by their keys."""


@checked
def load_plan(path: str | Path) -> Plan:
    """Load the plan in a plan.json, or in the result folder that contains one.

    Parameters
    ----------
    path : str or Path
        File or result folder.

    Returns
    -------
    Plan
        The plan. Its certificate is None if it does not belong to the content of the file.

    Raises
    ------
    TrajectoryError
        If the file cannot be read, has an unknown version or lacks a trajectory, or if the folder
        contains files of several plans.
    ProblemError
        If the problem in the file is invalid.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> plan = ssm.load_plan("results/tilt_insert")
    >>> plan.status, round(plan.duration, 4)
    ('solved', 3.3493)
    """
    path = Path(path)
    try:
        file = path / PLAN_FILE if path.is_dir() else path
    except (OSError, ValueError) as error:
        raise TrajectoryError(f"{path}: cannot be read: {error}") from error
    with locked(file.parent):  # no other process may replace the results
        data, sha256 = read_json_in_parts(
            file, LARGEST_FILE, ("trajectory", "coefficients"), (DEGREE + 1, len(JOINTS))
        )
        check_generation(file.parent)
    return Plan._from_document(data, sha256, file)


def as_plan(motion: Plan | Trajectory | str | Path, robot: Robot | None = None) -> Plan:
    """Convert the argument of a public function to a plan.

    Parameters
    ----------
    motion : Plan, Trajectory, str or Path
        A plan, which is returned unchanged, a trajectory, or the file of a plan.
    robot : Robot, optional
        Robot of the trajectory.

    Returns
    -------
    Plan
        For a trajectory, the plan of `Plan.from_trajectory`.

    Raises
    ------
    TrajectoryError
        If a trajectory lacks a robot, and for the reasons of `load_plan`.
    ProblemError
        If the problem in the file is invalid.
    """
    if isinstance(motion, Trajectory):
        if robot is None:
            raise TrajectoryError("a trajectory does not name a robot: pass robot")
        return Plan.from_trajectory(motion, robot)
    return motion if isinstance(motion, Plan) else load_plan(motion)


def _check_document(document: Any, path: Path) -> JsonObject:
    """Check that data are the content of a plan.json, and return them unchanged.

    Parameters
    ----------
    document : object
        Content of the file as JSON types.
    path : Path
        Name of the file for messages.

    Returns
    -------
    dict
        The same data.

    Raises
    ------
    TrajectoryError
        If the format, the version or the units are not those that this program writes.
    """
    if not isinstance(document, dict) or document.get("format") != PLAN_FORMAT:
        raise TrajectoryError(f"{path}: not a plan.json (its format key is not {PLAN_FORMAT!r})")
    if document.get("version") != PLAN_VERSION:
        raise TrajectoryError(
            f"{path}: plan.json of version {document.get('version')!r}; this program reads version "
            f"{PLAN_VERSION}"
        )
    if document.get("units", PLAN_UNITS) != PLAN_UNITS:
        raise TrajectoryError(f"{path}: units are not those that this program writes")
    return document


def _required_mapping(data: JsonObject, key: str, path: Path) -> JsonObject:
    """Return the mapping under a key of a plan.json.

    Parameters
    ----------
    data : dict
        Content of the file.
    key : str
        Key of the mapping.
    path : Path
        Name of the file for the message.

    Returns
    -------
    dict
        The mapping.

    Raises
    ------
    TrajectoryError
        If the key is missing, or its value is not a mapping.
    """
    value = data.get(key)
    if not isinstance(value, dict):
        raise TrajectoryError(f"{path}: {key} is missing or not a mapping: incomplete plan.json")
    return value


def _limits_of(robot: Robot) -> list[Limit]:
    """Return the limits of a robot's joints and tool."""
    limits = [limit for joint in robot.joints for limit in joint.limits]
    return limits + list(robot.limits)


def _bounds_text(limit: Limit | None) -> str:
    """Describe the bounds of a limit, which is None for a robot without it."""
    return f"{limit.low:.6g} to {limit.high:.6g} {limit.unit}" if limit else "none"


def _range_notes(problem: Problem) -> list[str]:
    """Return remarks on requested ranges of task coordinates that exceed those of the robot.

    The ranges of the robot then apply.

    Parameters
    ----------
    problem : Problem
        Problem with its requested ranges.

    Returns
    -------
    list of str
        One remark for each such range.
    """

    def text(name: str, ends: tuple[float, float]) -> str:
        """Format a range of a task coordinate with units."""
        unit = TaskRange(name, *ends).unit
        return " to ".join(format_quantity(end, unit) for end in ends)

    return [
        f"range of {name} of {text(name, requested)} asked for: the robot allows "
        f"{text(name, problem.ranges[name])}, which holds"
        for name, requested in problem.excess_ranges.items()
        if name in problem.ranges
    ]


def _long_turns(robot: Robot, turns: Array) -> Iterator[tuple[str, float, float]]:
    """Yield the joints whose angle exceeds half a turn.

    Parameters
    ----------
    robot : Robot
        Robot with the joints.
    turns : (4,) array
        Angles by which joints 1 to 3 turn, or at which they are, rad. The value of joint 4, which
        slides, is ignored.

    Yields
    ------
    name : str
        Name of the joint.
    angle : float
        Its angle, deg.
    equivalent : float
        The angle of smaller magnitude that differs by a whole turn, deg.
    """
    for joint, angle in zip(robot.joints, np.degrees(turns).tolist(), strict=True):
        if not joint.slides and abs(angle) > 180.0 + 1e-6:
            yield joint.name, angle, angle - math.copysign(360.0, angle)


def _start_notes(problem: Problem, trajectory: Trajectory) -> list[str]:
    """Return remarks on joints whose start position is a whole turn away from a smaller angle.

    If the problem states the start in task coordinates, the planner may choose such an angle,
    because the motion would otherwise leave the joint range. A start in joint positions causes no
    remark.

    Parameters
    ----------
    problem : Problem
        Problem with its start.
    trajectory : Trajectory
        Planned motion.

    Returns
    -------
    list of str
        One remark for each such joint.
    """
    if isinstance(problem.start, Joints):
        return []
    return [
        f"joint {name} starts at {angle:.6g} deg, a whole turn from {equivalent:.6g} deg: from "
        "there the motion would leave its range"
        for name, angle, equivalent in _long_turns(problem.robot, trajectory.sample(0.0).q[0])
    ]


def _turn_notes(
    problem: Problem, trajectory: Trajectory, phases: tuple[PhaseSummary, ...]
) -> list[str]:
    """Return remarks on phases that change the branch, or turn a joint by more than half a turn.

    Only problems with free motions have such remarks, because the path of the other motions
    determines how the joints turn.

    Parameters
    ----------
    problem : Problem
        Problem with its list of motions.
    trajectory : Trajectory
        Planned motion.
    phases : tuple of PhaseSummary
        Phases of the motion with their durations.

    Returns
    -------
    list of str
        Remarks in the order of the phases.
    """
    if not any(isinstance(entry, Free) for entry in problem.motion):
        return []
    end_times = np.cumsum([0.0] + [phase.duration for phase in phases])
    instants = trajectory.breaks[0] + np.minimum(end_times, trajectory.duration)
    positions = trajectory.sample(instants).q
    branches = Mechanism.from_robot(problem.robot).branch_of(positions)
    notes = []
    for i, phase in enumerate(phases):
        if branches[i] != branches[i + 1]:
            notes.append(
                f"{phase.name}: goes from branch {branches[i]:+d} of the inverse kinematics to "
                f"branch {branches[i + 1]:+d}"
            )
        for name, angle, equivalent in _long_turns(problem.robot, positions[i + 1] - positions[i]):
            notes.append(
                f"{phase.name}: joint {name} turns by {angle:.6g} deg, not by {equivalent:.6g} deg"
            )
    return notes


def _motor_notes(requirement: MotorRequirement) -> list[str]:
    """Return a remark if a joint lacks a motor, or if data of its motor are placeholders.

    Parameters
    ----------
    requirement : MotorRequirement
        Requirement of the joint, with its motor.

    Returns
    -------
    list of str
        At most one remark.
    """
    joint, motor = requirement.joint, requirement.motor
    if motor is None:
        return [f"joint {joint}: no motor given, its torque is not limited"]
    if not motor.placeholder:
        return []
    names = ", ".join(motor.placeholders)
    return [f"joint {joint}: motor {motor.name} has placeholder figures ({names})"]


def _friction_notes(robot: Robot, requirement: MotorRequirement) -> list[str]:
    """Return remarks on the friction of the drive of a joint.

    A drive without a worm or screw thread is not self-locking: without motor power, the load moves
    it, and the remark says so. For other drives, a remark states that the motion is faster than the
    motions from which the friction was identified.

    Parameters
    ----------
    robot : Robot
        Robot with its drives.
    requirement : MotorRequirement
        Requirement of the joint, with the largest speed of its motor.

    Returns
    -------
    list of str
        At most one remark.
    """
    drive = robot.joints[JOINTS.index(requirement.joint)].drive
    if drive is None or drive.friction is None:
        return []
    if not drive.threaded:
        return [
            f"joint {requirement.joint}: a {drive.kind} drive does not lock itself: without power "
            "its load moves it"
        ]
    return extrapolation_notes(requirement.joint, drive, requirement.peak_speed)
