"""A plan against recordings of its execution: one clock for all axes, limits that know the noise, three answers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ssm_planner.comparison.clock import Alignment, Clock, align, clock_of
from ssm_planner.comparison.findings import (
    ALIKE,
    DRIFT,
    AlignedAxis,
    Finding,
    Kept,
    Verdict,
    agrees,
    findings_of,
    limits_of,
    of_the_clock,
    place,
    stalled,
    worst_of,
)
from ssm_planner.comparison.measured import Measured
from ssm_planner.comparison.predicted import predicted
from ssm_planner.errors import RecordingError
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import Certificate

LAG = 10e-3
"""Time by which a joint may be behind at its largest speed, s: the following error window that the export sets."""


@dataclass(frozen=True)
class Difference:
    """Planned minus measured over the samples within the motion; nrmsd = rms / (max − min of the measured)."""

    rms: float
    largest: float
    nrmsd: float | None
    """None where the measured value does not change."""

    @classmethod
    def of(cls, planned: Array, measured: Array) -> Difference:
        """From values (n,)."""
        error = planned - measured
        rms, spread = float(np.sqrt(np.mean(error**2))), float(np.ptp(measured))
        return cls(rms, float(np.abs(error).max()), rms / spread if spread > 0 else None)


@dataclass(frozen=True, eq=False)
class AxisComparison:
    """What one recording says of one axis."""

    joint: str
    recording: str
    alignment: Alignment
    covered: float
    """Share of the motion that the recording holds."""
    differences: dict[str, Difference]
    """By position, speed (motor), torque (motor)."""
    limits: tuple[Kept, ...]
    notes: tuple[str, ...] = field(default_factory=tuple)
    findings: tuple[Finding, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """Of this axis alone."""
        return worst_of(
            [
                *(finding.verdict for finding in self.findings),
                *(limit.verdict for limit in self.limits),
            ]
        )

    @property
    def held(self) -> bool:
        """Every limit was kept, as far as the noise lets one tell, and the plan was followed."""
        return self.verdict == "held"

    def to_dict(self) -> dict[str, Any]:
        """An entry of `axes` in what `compare --json` prints; SI."""
        return {
            "joint": self.joint,
            "recording": self.recording,
            "delay": self.alignment.delay,
            "correlation": self.alignment.correlation,
            "covered": self.covered,
            "nrmsd": {name: each.nrmsd for name, each in self.differences.items()},
            "rms": {name: each.rms for name, each in self.differences.items()},
            "largest": {name: each.largest for name, each in self.differences.items()},
            "limits": [vars(limit) for limit in self.limits],
            "held": self.held,
            "verdict": self.verdict,
            "findings": [vars(finding) for finding in self.findings],
            "notes": list(self.notes),
        }


@dataclass(frozen=True, eq=False)
class Comparison:
    """A plan against the recordings of its axes, which one gets by iterating."""

    axes: tuple[AxisComparison, ...]
    clock: Clock
    findings: tuple[Finding, ...] = ()
    """Of all recordings together."""

    @property
    def verdict(self) -> Verdict:
        """Held, not held, or cannot tell."""
        return worst_of(
            [*(finding.verdict for finding in self.findings), *(axis.verdict for axis in self.axes)]
        )

    @property
    def held(self) -> bool:
        """The verdict is "held"."""
        return self.verdict == "held"

    def __iter__(self) -> Iterator[AxisComparison]:
        return iter(self.axes)

    def __len__(self) -> int:
        return len(self.axes)

    def __getitem__(self, k: int) -> AxisComparison:
        return self.axes[k]

    def to_dict(self) -> dict[str, Any]:
        """What `compare --json` prints; SI."""
        return {
            "held": self.held,
            "verdict": self.verdict,
            "clock": {
                name: value if np.isfinite(value) else None
                for name, value in vars(self.clock).items()
            },
            "findings": [vars(finding) for finding in self.findings],
            "axes": [axis.to_dict() for axis in self.axes],
        }


def compare(
    trajectory: Trajectory,
    robot: Robot,
    certificate: Certificate | None,
    recordings: Sequence[Measured],
    lag: float = LAG,
) -> Comparison:
    """Compare a planned motion with recordings of its axes, which share one clock.

    lag: time by which a joint may be behind at its largest speed, s; a larger tracking error does not hold. Raises
    RecordingError where a recording is not one of this motion.
    """
    if not recordings:
        raise RecordingError("no recording to compare with")
    plans = predicted(trajectory, robot, [each.joint for each in recordings])
    alignments = [
        align(plan.time, plan.speed, each.time, each.w)
        for plan, each in zip(plans, recordings, strict=True)
    ]
    clock = clock_of(alignments, DRIFT)
    axes = [
        place(*each[:2], clock, each[2]) for each in zip(plans, recordings, alignments, strict=True)
    ]
    for axis in axes:
        _refuse_other_motion(axis)
    return Comparison(
        tuple(_compare_axis(axis, certificate, lag) for axis in axes),
        clock,
        tuple(of_the_clock(clock, axes)),
    )


def _refuse_other_motion(axis: AlignedAxis) -> None:
    alignment, measured = axis.alignment, axis.measured
    if alignment.correlation >= ALIKE or stalled(axis) is not None or agrees(axis):
        return
    hint = "is it another joint's or another motion's?"
    if alignment.reversed_correlation > max(ALIKE, alignment.correlation):
        hint = "reversed it is; motor_direction of the joint in the robot file, or the recording's sign, is wrong"
    raise RecordingError(
        f"{measured.name}: its speed is not the planned one of joint {measured.joint} (correlation "
        f"{alignment.correlation:.2f}, at least {ALIKE:g} needed): {hint}"
    )


def _compare_axis(axis: AlignedAxis, certificate: Certificate | None, lag: float) -> AxisComparison:
    plan, measured, t = axis.plan, axis.measured, axis.t
    inside = (t >= 0) & (t <= plan.duration)
    covered = float(min(t[-1], plan.duration) - max(t[0], 0.0)) / plan.duration
    if covered <= 0 or np.count_nonzero(inside) < 3:
        raise RecordingError(f"{measured.name}: holds nothing of the motion")
    notes = list(measured.repairs)
    if axis.integrated:
        notes.append(
            "no position channel: position is the integral of the measured speed, from the planned start"
        )
    planned = {"position": plan.position, "speed": plan.speed, "torque": plan.torque}
    channels = {"position": axis.q, "speed": measured.w, "torque": measured.tau}
    return AxisComparison(
        measured.joint,
        measured.name,
        alignment=axis.alignment,
        covered=covered,
        differences={
            name: Difference.of(np.interp(t[inside], plan.time, planned[name]), values[inside])
            for name, values in channels.items()
        },
        limits=limits_of(axis, certificate),
        notes=tuple(notes),
        findings=findings_of(axis, lag),
    )
