"""Compute the tip error of an executed motion from the recordings of its axes.

The recorded positions are those of the motors. They show how far the motors are from the plan, but
not the errors between motor and tip: encoder, backlash, homing and deflection. For these errors,
the bound of `sizing.tip_error` is added.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ssm_planner.comparison.findings import AlignedAxis, check_sampling
from ssm_planner.kinematics import angle_between, fk
from ssm_planner.problem import JOINTS, Robot, get_attributes, unchecked_copy
from ssm_planner.sizing import TipError, tip_error
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import JsonObject, frozen


@frozen
class MeasuredTipError:
    """Tip error of an executed motion.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> comparison = ssm.compare("results/tilt_insert", {"roll": "roll.csv"})  # doctest: +SKIP
    >>> comparison.tip_error.missing  # doctest: +SKIP
    """

    largest: float
    """Largest distance of the tip from the plan, computed from the motor positions, m."""
    angle: float
    """Largest rotation of the tool from its planned orientation, from the same positions, rad."""
    unseen: TipError
    """Bounds on the errors between motor and tip, which the recordings do not show."""
    missing: tuple[str, ...]
    """Reasons why the recordings do not determine the tip error, or empty."""

    @property
    def total(self) -> float | None:
        """Bound on the tip error of this execution with 99 % confidence, m. None if unknown."""
        unseen = self.unseen.bound
        return None if self.missing or unseen is None else self.largest + unseen

    def to_dict(self) -> JsonObject:
        """Return the entry `tip_error` of `compare --json`, in SI units and rad."""
        errors = get_attributes(self, ("largest", "angle", "total"))
        if self.missing:
            errors = dict.fromkeys(errors)
        missing = self.missing + self.unseen.missing
        return {**errors, "unseen": self.unseen.bound, "missing": list(missing)}


def measured_tip_error(
    trajectory: Trajectory, robot: Robot, axes: Sequence[AlignedAxis], unrecorded: Sequence[str]
) -> MeasuredTipError:
    """Compute the tip error from the recorded motor positions.

    Parameters
    ----------
    trajectory : Trajectory
        The planned motion at the speed of execution.
    robot : Robot
        Robot of the plan.
    axes : sequence of AlignedAxis
        Recordings and predictions of the axes. Axes without a recording are at their planned
        positions.
    unrecorded : sequence of str
        Moving joints without a recording.

    Returns
    -------
    MeasuredTipError
        Largest errors and, if they are unknown, the reasons.
    """
    time = axes[0].plan.time
    planned = trajectory.sample(trajectory.breaks[0] + time).q
    measured = planned.copy()
    joints = list(robot.joints)
    for axis in axes:
        i = JOINTS.index(axis.measured.joint)
        measured[:, i] = np.interp(time, axis.t, axis.q)
        # The recording contains the tracking error.
        joints[i] = replace(joints[i], tracking_error=0.0)
    expected = fk(robot, planned)
    actual = fk(robot, measured)
    distances = np.linalg.norm(actual.position - expected.position, axis=1)
    angles = angle_between(actual.rotation, expected.rotation)
    missing = [f"{name}: no recording" for name in unrecorded]
    missing += _missing_data(axes)
    return MeasuredTipError(
        float(distances.max()),
        float(angles.max()),
        tip_error(trajectory, unchecked_copy(robot, joints=tuple(joints))),
        missing=tuple(missing),
    )


def _missing_data(axes: Sequence[AlignedAxis]) -> Iterator[str]:
    """Find the reasons why recordings do not determine the tip error.

    Parameters
    ----------
    axes : sequence of AlignedAxis
        Recordings and predictions of the axes.

    Yields
    ------
    str
        Joint and reason, such as "roll: no position channel".
    """
    for axis in axes:
        if axis.measured.q is None:
            yield f"{axis.measured.joint}: no position channel"
        for finding in check_sampling(axis):
            if finding.verdict != "held":
                yield f"{axis.measured.joint}: {finding.text}"
