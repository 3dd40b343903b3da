"""Bound the tilt rate of a motion from rest to rest by the accelerations of the joints."""

import numpy as np

from ssm_planner.errors import GeometryError
from ssm_planner.kinematics import Mechanism, joint_speed_per_tilt_speed, tilt_interval
from ssm_planner.problem import JOINTS
from ssm_planner.typing import Array, Range, frozen

GRID = 20001
"""Number of tilts at which the bound on the tilt rate is evaluated."""


@frozen
class TiltRateBound:
    """Bound on the tilt rate, and the place at which it applies."""

    rate: float
    """Bound on the magnitude of the tilt rate, rad/s."""
    tilt: float
    """Tilt at which the bound is reached, rad."""
    joint: str
    """Name of the joint that limits the rate."""


def tilt_rate_bound(mechanism: Mechanism, ends: Range, acceleration: float) -> TiltRateBound:
    """Bound the tilt rate of a motion from rest to rest between two tilts.

    Roll and spin are constant. A joint that starts or ends at rest satisfies q̇² ≤ 2 · q̈_max ·
    travel. Therefore φ̇ ≤ √(2 · q̈_max · min(travel to either end)) / |dq/dφ| for joints 1 to 3.

    Parameters
    ----------
    mechanism : Mechanism
        Axes of the robot.
    ends : (float, float)
        Tilts at both ends, rad.
    acceleration : float
        Largest acceleration q̈_max of every joint, rad/s².

    Raises
    ------
    GeometryError
        If a tilt is not inside the workspace. At its boundary, joint speeds are unbounded.
    """
    low, high = tilt_interval(mechanism)
    if not low < min(ends) < max(ends) < high:
        raise GeometryError(
            f"ends = [{ends[0]:.6g}, {ends[1]:.6g}] rad: two tilts inside the workspace "
            f"({low:.6g}, {high:.6g}) are needed"
        )
    tilt = np.linspace(min(ends), max(ends), GRID)
    half = [
        float(np.interp(column[-1] / 2, column, tilt)) for column in _travel(mechanism, tilt)[1].T
    ]
    # The speed that a joint can reach is largest in the middle of its travel.
    tilt = np.sort(np.append(tilt, half))
    slope, travel = _travel(mechanism, tilt)
    speed = np.sqrt(2 * acceleration * np.minimum(travel, travel[-1] - travel))
    rates = speed / np.maximum(slope, 1e-12)
    k = int(np.argmax(rates.min(axis=1)))
    return TiltRateBound(float(rates[k].min()), float(tilt[k]), JOINTS[int(np.argmin(rates[k]))])


def _travel(mechanism: Mechanism, tilt: Array) -> tuple[Array, Array]:
    """Return |dq/dφ| and the travel of joints 1 to 3 since the first tilt, each (n, 3).

    `tilt` (n,) contains monotonic tilts in rad. The travel in rad follows from the trapezoidal
    rule.
    """
    slope = np.abs(joint_speed_per_tilt_speed(mechanism, tilt, mechanism.home_branch))
    step = (slope[1:] + slope[:-1]) / 2 * np.abs(np.diff(tilt))[:, None]
    return slope, np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)])
