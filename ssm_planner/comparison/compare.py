"""Compare a plan with recordings of its execution, and give a verdict.

`compare` predicts position, speed and torque of each axis from the plan, aligns the recordings with
the prediction, and collects the findings on each axis. All recordings must share one clock.
"""

from collections.abc import Iterator, Sequence
from dataclasses import field

import numpy as np

from ssm_planner.comparison.clock import (
    Alignment,
    Clock,
    align_axis,
    estimate_clock,
    estimate_speed,
)
from ssm_planner.comparison.findings import (
    MAX_CLOCK_DRIFT,
    AlignedAxis,
    Finding,
    Kept,
    Verdict,
    check_clock,
    check_limits,
    check_speed,
    find_faults,
    find_other_motion,
    map_to_clock,
    worst_verdict,
)
from ssm_planner.comparison.measured import AxisRecording
from ssm_planner.comparison.predicted import AxisPrediction, predict_axes
from ssm_planner.comparison.tip import MeasuredTipError, measured_tip_error
from ssm_planner.deprecation import Renamed
from ssm_planner.errors import RecordingError
from ssm_planner.identification import largest_magnitude, rms
from ssm_planner.problem import Robot, get_attributes
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, JsonObject, frozen, record
from ssm_planner.verification import Certificate

DEFAULT_LAG = 10e-3
"""Permitted delay at the largest speed, s. It equals the following error window of the export."""


@frozen
class Difference:
    """Statistics of the differences between planned and measured values of one quantity.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.Difference(rms=1e-3, largest=4e-3, nrmsd=0.02).nrmsd
    0.02
    """

    rms: float
    """Root of the mean squared difference, in the unit of the quantity."""
    largest: float
    """Largest magnitude of the differences, in the unit of the quantity."""
    nrmsd: float | None
    """RMS divided by the range of the measured values. None if the measured value is constant."""

    @classmethod
    def from_samples(cls, planned: Array, measured: Array) -> "Difference":
        """Compute the statistics from planned and measured values.

        Parameters
        ----------
        planned, measured : (n,) arrays
            Values at the same instants, in any unit.

        Returns
        -------
        Difference
            Statistics in the unit of the values.
        """
        error = planned - measured
        size = rms(error)
        spread = float(np.ptp(measured))
        return cls(size, largest_magnitude(error), size / spread if spread > 0 else None)

    of = Renamed("from_samples")


@record
class AxisComparison:
    """The comparison of one axis with its plan.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> comparison = ssm.compare("results/tilt_insert", {"roll": "roll.csv"})  # doctest: +SKIP
    >>> comparison.axes[0].differences["torque"].nrmsd  # doctest: +SKIP
    """

    joint: str
    recording: str
    """Name of the recording."""
    alignment: Alignment
    covered: float
    """Share of the motion that the recording contains."""
    differences: dict[str, Difference]
    """Differences of the joint position, the motor speed and the motor torque, by name."""
    limits: tuple[Kept, ...]
    notes: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    visible: dict[str, float] = field(default_factory=dict)
    """Shortest and smallest fault that the recording can show.

    `duration` is the longest interval between two samples during the motion, s. A shorter fault can
    lie between two samples. `speed` and `torque` are the smallest faults of a single sample, rad/s
    and N·m at the motor, and `position` is the smallest fault of the joint, rad or m.
    """

    @property
    def verdict(self) -> Verdict:
        """The worst verdict of all findings and limits of this axis."""
        return worst_verdict(self.findings, self.limits)

    @property
    def followed(self) -> bool:
        """True if the axis followed the plan and kept every limit, within the noise."""
        return self.verdict == "held"

    def to_dict(self) -> JsonObject:
        """Return an entry of `axes` in the output of `compare --json`, in SI units."""
        statistics: JsonObject = {}
        for key in ("nrmsd", "rms", "largest"):
            statistics[key] = {name: getattr(item, key) for name, item in self.differences.items()}
        return {
            **get_attributes(self, ("joint", "recording", "covered", "verdict", "visible")),
            **get_attributes(self.alignment, ("delay", "correlation")),
            **statistics,
            "limits": [vars(limit) for limit in self.limits],
            "held": self.followed,
            "findings": [vars(finding) for finding in self.findings],
            "notes": list(self.notes),
        }

    held = Renamed("followed")


@record
class Comparison:
    """Comparison of a plan with recordings of its axes. Iteration yields the axes.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> comparison = ssm.compare("results/tilt_insert", {"roll": "roll.csv"})  # doctest: +SKIP
    >>> comparison.verdict  # doctest: +SKIP
    """

    axes: tuple[AxisComparison, ...]
    clock: Clock
    tip_error: MeasuredTipError
    """Distance of the tip from the plan, and the bounds that the robot file implies."""
    findings: tuple[Finding, ...] = ()
    """Findings that concern all recordings."""
    speed: float = 1.0
    """Speed of execution, as a multiple of the planned speed, at which the axes are compared."""
    unjudged: tuple[str, ...] = ()
    """Limits of the certificate that the comparison does not judge, with their joints."""

    @property
    def verdict(self) -> Verdict:
        """The worst verdict of all findings and axes: "held", "cannot tell" or "not held"."""
        return worst_verdict(self.findings, self.axes)

    @property
    def followed(self) -> bool:
        """True if the verdict is "held"."""
        return self.verdict == "held"

    def __iter__(self) -> Iterator[AxisComparison]:
        return iter(self.axes)

    def __len__(self) -> int:
        return len(self.axes)

    def __getitem__(self, k: int) -> AxisComparison:
        return self.axes[k]

    def to_dict(self) -> JsonObject:
        """Return the output of `compare --json`, in SI units."""
        clock = vars(self.clock).items()
        return {
            "held": self.followed,
            "verdict": self.verdict,
            "speed": self.speed,
            "clock": {name: value if np.isfinite(value) else None for name, value in clock},
            "findings": [vars(finding) for finding in self.findings],
            "unjudged": list(self.unjudged),
            "tip_error": self.tip_error.to_dict(),
            "axes": [axis.to_dict() for axis in self.axes],
        }

    held = Renamed("followed")


def compare(
    trajectory: Trajectory,
    robot: Robot,
    certificate: Certificate | None,
    recordings: Sequence[AxisRecording],
    lag: float = DEFAULT_LAG,
    speed: float | None = None,
) -> Comparison:
    """Compare a planned motion with recordings of its axes.

    Parameters
    ----------
    trajectory : Trajectory
        The planned motion.
    robot : Robot
        Robot of the plan.
    certificate : Certificate or None
        Certificate of the plan with its margins. None leaves the planned margins unknown.
    recordings : sequence of AxisRecording
        One recording for each axis. All of them share one clock.
    lag : float
        Delay of a joint (s) that is permitted at its largest speed. It determines the permitted
        tracking error.
    speed : float, optional
        Speed at which the motion was meant to be executed, as a multiple of the planned speed. None
        means the planned speed. An execution at any other speed gets the verdict "not held", but
        its differences and limits refer to the speed of execution.

    Returns
    -------
    Comparison
        Differences, limits, findings and the verdict.

    Raises
    ------
    RecordingError
        If the list of recordings is empty, or if the lag or the speed is out of range.
    """
    if not recordings:
        raise RecordingError("no recording to compare with")
    if not 0 < lag <= 1:
        raise RecordingError(f"the lag {lag:g} s is out of range (allowed: above 0, up to 1 s)")
    if speed is not None and not 0 < speed <= 1:
        raise RecordingError(f"the speed {speed:g} is out of range (allowed: above 0, up to 1)")
    joints = [recording.joint for recording in recordings]
    driven = (joint.name for joint in robot.joints if joint.drive is not None)
    joints += [name for name in driven if name not in joints]
    plans = predict_axes(trajectory, robot, joints)
    missing = [plan.joint.name for plan in plans[len(recordings) :] if plan.peak > 0]
    alignments, clock, played_speed = _align_axes(plans, recordings, speed or 1.0)
    if played_speed != 1.0:
        plans = predict_axes(trajectory, robot, joints, played_speed)
    margins = certificate if played_speed == 1.0 else None
    axes = [
        map_to_clock(plan, recording, alignment, clock)
        for plan, recording, alignment in zip(plans, recordings, alignments, strict=False)
    ]
    findings = list(check_clock(clock, axes))
    findings += check_speed(clock, played_speed, speed)
    if missing:
        text = f"no recording of {', '.join(missing)}, which the plan moves"
        findings.append(Finding("missing recording", "cannot tell", text, len(missing), 0))
    comparisons = [_compare_axis(axis, plans, margins, lag) for axis in axes]
    unjudged = []
    if certificate is not None:
        judged_limits = {(limit.name, axis.joint) for axis in comparisons for limit in axis.limits}
        for check in certificate.limits:
            if (check.name, check.joint) not in judged_limits:
                unjudged.append(f"{check.name} {check.joint or ''}".strip())
    return Comparison(
        tuple(comparisons),
        clock,
        measured_tip_error(trajectory.slower(played_speed), robot, axes, missing),
        tuple(findings),
        played_speed,
        unjudged=tuple(unjudged),
    )


def _align_axes(
    plans: list[AxisPrediction], recordings: Sequence[AxisRecording], intended: float
) -> tuple[list[Alignment], Clock, float]:
    """Align all recordings with the plan, and estimate their clock and the speed of execution.

    Parameters
    ----------
    plans : list of AxisPrediction
        Predictions at the planned speed. The first ones belong to the recordings.
    recordings : sequence of AxisRecording
        The recordings.
    intended : float
        Intended speed of execution, as a multiple of the planned speed. A speed close to it counts
        as the intended speed.

    Returns
    -------
    alignments : list of Alignment
        One alignment for each recording.
    clock : Clock
        Common clock of all recordings.
    speed : float
        Speed of execution, as a multiple of the planned speed.
    """

    def align_at(speed: float) -> tuple[list[Alignment], Clock, float]:
        """Align all axes with the plan that is executed at a given speed.

        Parameters
        ----------
        speed : float
            Speed of execution, as a multiple of the planned speed.

        Returns
        -------
        alignments : list of Alignment
            One alignment for each recording.
        clock : Clock
            Common clock of all recordings.
        speed : float
            The given speed.
        """
        alignments = [
            align_axis(plan.time / speed, plan.speed * speed, recording.time, recording.w)
            for plan, recording in zip(plans, recordings, strict=False)
        ]
        return alignments, estimate_clock(alignments, MAX_CLOCK_DRIFT), speed

    measured_speeds = [(recording.time, recording.w) for recording in recordings]
    planned_speeds = [(plan.time / intended, plan.speed * intended) for plan in plans]
    factor = estimate_speed(planned_speeds, measured_speeds)
    alignments, clock, speed = align_at(intended * factor)
    if clock.slower and speed != intended:
        return align_at(speed * clock.estimated_rate)
    return alignments, clock, speed


def _compare_axis(
    axis: AlignedAxis, plans: Sequence[AxisPrediction], certificate: Certificate | None, lag: float
) -> AxisComparison:
    """Compare one axis with its plan.

    Parameters
    ----------
    axis : AlignedAxis
        Recording and prediction of the axis on the common clock.
    plans : sequence of AxisPrediction
        Predictions of all axes, with which a recording of another axis is recognised.
    certificate : Certificate or None
        Certificate of the plan, or None if its margins do not apply.
    lag : float
        Permitted delay at the largest speed, s.

    Returns
    -------
    AxisComparison
        Differences, limits and findings of this axis.
    """
    plan = axis.plan
    measured = axis.measured
    t = axis.t
    is_planned = (t >= 0) & (t <= plan.duration)
    notes = measured.repairs
    if measured.q is None:
        notes += (
            "no position channel: position is the integral of the measured speed, from the planned "
            "start",
        )
    differences = {}
    if is_planned.any():
        for name, planned_values, values in (
            ("position", plan.position, axis.q),
            ("speed", plan.speed, measured.w),
            ("torque", plan.torque, measured.tau),
        ):
            expected = axis.interpolate_plan(planned_values)[is_planned]
            differences[name] = Difference.from_samples(expected, values[is_planned])
    other_motion = find_other_motion(axis, plans)
    return AxisComparison(
        measured.joint,
        measured.name,
        axis.alignment,
        axis.covered,
        differences=differences,
        limits=check_limits(axis, certificate),
        notes=notes,
        findings=tuple(find_faults(axis, lag)) if other_motion is None else (other_motion,),
        visible=axis.visible,
    )
