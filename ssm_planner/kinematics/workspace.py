"""Workspace in closed form (paper, §II-B): extremes of f(θ2), tilt intervals, which (α, β) reach them, tilt rates.

Tilt is the angle φ between ω1 and the tool, signed; it depends on θ2 alone. For each tilt inside the workspace there
are two θ2, one on each branch; the branches meet at the extremes of φ, where dφ/dθ2 = 0.

|φ| runs from |α − β| to α + β, folded at π (eq. 9). So a range with a = min |φ| and b = max |φ| is reached by all (α, β)
with |α − β| ≤ a and b ≤ α + β ≤ 2π − b: a rectangle whose sides are at 45° to the α and β axes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.forward import space_jacobian
from ssm_planner.kinematics.mechanism import (
    PARALLEL,
    Mechanism,
    check_angles,
    elbow_squares,
    tilt_magnitude,
)
from ssm_planner.problem.robot import JOINTS
from ssm_planner.typing import Array

GRID = 20001
"""Tilts at which the bound on the tilt rate is looked for."""


@dataclass(frozen=True, eq=False)
class Extreme:
    """A configuration of extreme tilt (paper, eqs. 6–9)."""

    theta2: float
    """θ_r, in (−π, π]."""
    c1: float
    c2: float
    """e^{ω̂2 θ_r} v4 = c1 ω1 + c2 ω2."""
    direction: Array
    """e^{ω̂2 θ_r} v4, (3,)."""
    tilt: float
    """|φ_r|, in [0, π]."""


def tilt_magnitudes(alpha: float, beta: float) -> tuple[float, float]:
    """Smallest and largest |φ|, in [0, π]: |α − β| and α + β, folded at π (paper, eq. 9).

    α and β in [0, π], any: with one of them 0 or π the two are equal.
    """
    return abs(alpha - beta), min(alpha + beta, 2.0 * math.pi - (alpha + beta))


def tilt_interval(mechanism: Mechanism) -> tuple[float, float]:
    """(lo, hi) of the signed tilt on the home side; the vitreoretinal robot: (−139.778°, −79.778°)."""
    low, high = tilt_magnitudes(mechanism.alpha, mechanism.beta)
    return (low, high) if mechanism.side > 0 else (-high, -low)


def extremes(mechanism: Mechanism) -> tuple[Extreme, Extreme]:
    """The configurations of smallest and of largest |φ| (paper, eq. 8):

    e^{ω̂2 θ_r} v4 = ± (sin β / sin α) ω1 + (sin(α ∓ β) / sin α) ω2, upper signs first.
    GeometryError where ω1 and ω2, or ω2 and ω3, are parallel: then φ is constant.
    """
    alpha, beta = mechanism.alpha, mechanism.beta
    if min(math.sin(alpha), math.sin(beta)) < PARALLEL:
        raise GeometryError(
            f"alpha = {alpha:.6g}, beta = {beta:.6g} rad: two axes are parallel, the tilt is constant"
        )
    found = []
    for sign, tilt in zip((1, -1), tilt_magnitudes(alpha, beta), strict=True):
        c1, c2 = (
            sign * math.sin(beta) / math.sin(alpha),
            math.sin(alpha - sign * beta) / math.sin(alpha),
        )
        theta2 = math.remainder(mechanism.delta + (0.0 if sign > 0 else math.pi), 2.0 * math.pi)
        direction = c1 * mechanism.omega1 + c2 * mechanism.omega2
        found.append(Extreme(theta2, c1, c2, direction, tilt))
    return found[0], found[1]


def tilt_from_theta2(mechanism: Mechanism, theta2: ArrayLike) -> Array:
    """φ(θ2) on the home side, any shape."""
    x = np.asarray(theta2, dtype=float) - mechanism.delta
    tilt: Array = mechanism.side * tilt_magnitude(NUMPY, mechanism.alpha, mechanism.beta, x)
    return tilt


def theta2_from_tilt(mechanism: Mechanism, tilt: ArrayLike, branch: int) -> Array:
    """θ2(φ) in δ + branch · [0, π], any shape; branch is +1 or −1, the sign of sin(θ2 − δ).

    Outside the workspace the θ2 of the nearest tilt.
    """
    low, high = tilt_magnitudes(mechanism.alpha, mechanism.beta)
    half = np.clip(np.abs(np.asarray(tilt, dtype=float)), low, high) / 2.0
    cosine2, sine2 = elbow_squares(
        NUMPY, mechanism.alpha, mechanism.beta, np.cos(half), np.sin(half)
    )
    x = 2.0 * np.arctan2(np.sqrt(np.maximum(sine2, 0.0)), np.sqrt(np.maximum(cosine2, 0.0)))
    theta2: Array = mechanism.delta + check_branch(branch) * x
    return theta2


def magnitude_range(name: str, tilt_range: tuple[float, float]) -> tuple[float, float]:
    """Smallest and largest |φ| of a signed tilt range, checked."""
    low, high = (float(end) for end in tilt_range)
    if not -math.pi <= low <= high <= math.pi:
        raise GeometryError(
            f"{name} = [{low:.6g}, {high:.6g}]: lower must not exceed upper, both in [-pi, pi] rad, not degrees"
        )
    return (0.0 if low < 0.0 < high else min(abs(low), abs(high))), max(abs(low), abs(high))


def check_branch(branch: int) -> int:
    """Refuse anything but +1 and −1."""
    if branch not in (1, -1):
        raise GeometryError(
            f"branch = {branch!r}: must be 1 or -1, the sign of sin(theta2 - delta)"
        )
    return branch


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

    With x = θ2 − δ and P, E of mechanism.py:
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
        raise GeometryError(
            f"tilt of shape {tilts.shape}: must be finite and in [-pi, pi] rad, not degrees"
        )
    return tilts


@dataclass(frozen=True)
class TiltRateBound:
    """A tilt rate (rad/s) that is not exceeded, the tilt (rad) that allows it, and the joint that sets it."""

    rate: float
    tilt: float
    joint: str


def tilt_rate_bound(
    mechanism: Mechanism, ends: tuple[float, float], acceleration: float
) -> TiltRateBound:
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


ROUNDING = 1e-12
"""rad by which a corner of a region may fall outside it."""


@dataclass(frozen=True, eq=False)
class DesignRegion:
    """All (α, β) whose workspace holds a tilt range with a margin; rad."""

    tilt_range: tuple[float, float]
    margin: float
    vertices: Array
    """(4, 2): corners (α, β) in order, the smallest α first; (0, 2) where nothing reaches the range."""

    @property
    def empty(self) -> bool:
        """Nothing reaches the range with the margin."""
        return len(self.vertices) == 0

    @property
    def smallest_alpha(self) -> tuple[float, float]:
        """The (α, β) of smallest α, the most compact; (nan, nan) if the region is empty."""
        return (
            (math.nan, math.nan)
            if self.empty
            else (float(self.vertices[0, 0]), float(self.vertices[0, 1]))
        )

    def contains(self, alpha: float, beta: float) -> bool:
        """Does (α, β) reach the range with the margin?"""
        return design_margin(alpha, beta, self.tilt_range) >= self.margin - ROUNDING


def design_region(tilt_low: float, tilt_high: float, margin: float = 0.0) -> DesignRegion:
    """All (α, β) that reach the signed tilts [tilt_low, tilt_high], rad, with `margin` rad beyond either end.

    The corner of smallest α is ((b − a)/2 + margin, (a + b)/2): (30°, 110°) for (−140°, −80°). A range that passes
    through φ = 0 needs α = β. Without margin that corner has the ends of the range on the workspace boundary, where
    joint speed is unbounded: a design to be built needs a margin.
    """
    low, high = magnitude_range("tilt range", (tilt_low, tilt_high))
    if not 0.0 <= margin <= math.pi:
        raise GeometryError(f"margin = {margin!r}: must be in [0, pi] rad")
    difference, least = low - margin, high + margin
    if difference < 0.0 or least > math.pi:
        return DesignRegion((tilt_low, tilt_high), margin, np.empty((0, 2)))
    most = 2.0 * math.pi - least
    corners = ((least, -difference), (least, difference), (most, difference), (most, -difference))
    vertices = np.array([((total + gap) / 2.0, (total - gap) / 2.0) for total, gap in corners])
    return DesignRegion((tilt_low, tilt_high), margin, vertices)


def design_margin(alpha: float, beta: float, tilt_range: tuple[float, float]) -> float:
    """Tilt, rad, by which the workspace of (α, β) goes beyond both ends of a range; negative: not reached."""
    check_angles(alpha, beta)
    low, high = magnitude_range("tilt_range", tilt_range)
    nearest, farthest = tilt_magnitudes(alpha, beta)
    return min(low - nearest, farthest - high)
