"""How fast the tool can tilt: a bound from the joints' acceleration that no motion between two rests beats."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ssm_planner.errors import GeometryError
from ssm_planner.model.measures import joint_speed_per_tilt_speed
from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.workspace import tilt_interval
from ssm_planner.problem.values import JOINTS, Array

GRID = 20001


@dataclass(frozen=True)
class TiltRateBound:
    """A tilt rate (rad/s) that is not exceeded, the tilt (rad) that allows it, and the joint that sets it."""

    rate: float
    tilt: float
    joint: str


def tilt_rate_bound(mechanism: Mechanism, ends: tuple[float, float], acceleration: float) -> TiltRateBound:
    """Largest tilt rate between two tilts (rad) at rest, roll and spin held, within a joint acceleration (rad/s²).

    A joint that starts or ends at rest has q̇² ≤ 2·q̈_max·travel, so φ̇ ≤ √(2·q̈_max·min(travel to either end)) / |dq/dφ|
    for each of joints 1 to 3. GeometryError unless both tilts are inside the workspace, where joint speed is bounded.
    """
    low, high = tilt_interval(mechanism)
    if not low < min(ends) < max(ends) < high:
        raise GeometryError(
            f"ends = [{ends[0]:.6g}, {ends[1]:.6g}] rad: two tilts inside the workspace ({low:.6g}, {high:.6g}) are needed"
        )
    tilt = np.linspace(min(ends), max(ends), GRID)
    half = [float(np.interp(each[-1] / 2, each, tilt)) for each in _travel(mechanism, tilt)[1].T]
    tilt = np.sort(np.append(tilt, half))  # joints are fastest half way
    slope, travel = _travel(mechanism, tilt)
    speed = np.sqrt(2 * acceleration * np.minimum(travel, travel[-1] - travel))
    rates = speed / np.maximum(slope, 1e-12)
    k = int(np.argmax(rates.min(axis=1)))
    return TiltRateBound(float(rates[k].min()), float(tilt[k]), JOINTS[int(np.argmin(rates[k]))])


def _travel(mechanism: Mechanism, tilt: Array) -> tuple[Array, Array]:
    """|dq/dφ| and the travel from the first tilt on, of joints 1 to 3, (n, 3) each; tilt (n,), monotonic."""
    slope = np.abs(joint_speed_per_tilt_speed(mechanism, tilt, mechanism.home_branch))
    step = (slope[1:] + slope[:-1]) / 2 * np.abs(np.diff(tilt))[:, None]
    return slope, np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)])
