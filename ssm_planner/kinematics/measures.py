"""Measures along the workspace: distance to the boundary, singular value, joint speed that a tilt speed needs.

How fast the tool can tilt: a bound from the joints' acceleration that no motion between two rests beats.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.forward import space_jacobian
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.triangle import elbow_squares
from ssm_planner.kinematics.workspace import check_branch, tilt_interval, tilt_magnitudes
from ssm_planner.problem.robot import JOINTS
from ssm_planner.typing import Array


def boundary_distance(mechanism: Mechanism, tilt: ArrayLike) -> Array:
    """Angle, rad, from tilts of any shape to the nearer end of the workspace; negative outside."""
    low, high = tilt_magnitudes(mechanism.alpha, mechanism.beta)
    magnitude = np.abs(_tilts(tilt))
    distance: Array = np.minimum(magnitude - low, high - magnitude)
    return distance


def smallest_singular_value(mechanism: Mechanism, q: ArrayLike) -> Array:
    """σ_min (n,) of the angular part of the space Jacobian, its columns the three revolute axes; q (n, 4).

    Without unit; 0 at the workspace boundary, where the axes lie in one plane. It depends on θ2 alone.
    """
    values = np.linalg.svd(space_jacobian(mechanism, q)[:, 3:, :3], compute_uv=False)
    return np.asarray(values[:, 2], dtype=float)


def joint_speed_per_tilt_speed(mechanism: Mechanism, tilt: ArrayLike, branch: int) -> Array:
    """(dθ1/dφ, dθ2/dφ, dθ3/dφ) at constant roll and spin; tilts (...) to (..., 3).

    With x = θ2 − δ and P, E of triangle.py:
    dθ2/dφ = sin φ / (sin α sin β sin x),  dθ1/dφ = E / (sin α sin x sin φ),  dθ3/dφ = −P / (sin β sin x sin φ),
    for the |φ| of the home side. Infinite at the workspace boundary, NaN outside.
    """
    alpha, beta = mechanism.alpha, mechanism.beta
    tilts = _tilts(tilt)
    half = np.abs(tilts) / 2.0
    c2, s2 = elbow_squares(NUMPY, alpha, beta, np.cos(half), np.sin(half))
    # at a tilt that is the end of the interval, rounding must not decide between infinite and outside
    c2, s2 = (np.where((part < 0.0) & (part > -1e-15), 0.0, part) for part in (c2, s2))
    with np.errstate(divide="ignore", invalid="ignore"):
        product = math.sin(alpha) * math.sin(beta)
        sin_x = check_branch(branch) * 2.0 * np.sqrt(c2 * s2) / product
        sin_x = np.where((c2 < 0.0) | (s2 < 0.0), np.nan, sin_x)
        on_t = (math.sin(alpha - beta) * c2 + math.sin(alpha + beta) * s2) / product
        toward = (math.sin(alpha - beta) * c2 - math.sin(alpha + beta) * s2) / product
        sine = np.sin(np.abs(tilts))
        first = toward / (math.sin(alpha) * sin_x * sine)
        second = sine / (product * sin_x)
        third = -on_t / (math.sin(beta) * sin_x * sine)
    side = np.where(tilts < 0.0, -1.0, 1.0)
    speeds: Array = np.stack((first, second, third), axis=-1) * side[..., np.newaxis]
    return speeds


def _tilts(value: ArrayLike) -> Array:
    tilts = np.asarray(value, dtype=float)
    if not np.all(np.abs(tilts) <= math.pi + 1e-9):
        raise GeometryError(f"tilt of shape {tilts.shape}: must be finite and in [-pi, pi] rad, not degrees")
    return tilts


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
