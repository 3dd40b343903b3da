"""Compute the workspace in closed form (paper, §II-B): extreme tilts, design regions, tilt rates.

Tilt is the signed angle φ between ω1 and the tool. It depends on θ2 alone. Each tilt inside the
workspace has two solutions θ2, one on each branch. The branches meet at the extremes of φ, where
dφ/dθ2 = 0.

The magnitude |φ| ranges from |α − β| to α + β, folded at π (eq. 9). The angles (α, β) reach a
range with a = min |φ| and b = max |φ| if |α − β| ≤ a and b ≤ α + β ≤ 2π − b. In the plane of α and
β, this is a rectangle whose sides are at 45° to the axes.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.arguments import checked
from ssm_planner.codegen import NUMPY
from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.forward import space_jacobian
from ssm_planner.kinematics.mechanism import PARALLEL, Mechanism, check_angles, elbow_squares
from ssm_planner.problem import JOINTS
from ssm_planner.representation import ShortRepr
from ssm_planner.typing import Array, Range, frozen, record

GRID = 20001
"""Number of tilts at which the bound on the tilt rate is evaluated."""


@record
class Extreme(ShortRepr):
    """A configuration of extreme tilt (paper, eqs. 6–9).

    Examples
    --------
    >>> import numpy as np
    >>> import ssm_planner as ssm
    >>> extremes = ssm.workspace(ssm.load_robot("vitreoretinal")).extremes
    >>> np.degrees([extreme.tilt for extreme in extremes]).round(2).tolist()
    [79.78, 139.78]
    """

    theta2: float
    """Angle θ_r in (−π, π]."""
    c1: float
    c2: float
    """Coefficients in e^{ω̂2 θ_r} v4 = c1 ω1 + c2 ω2."""
    direction: Array
    """Tool axis e^{ω̂2 θ_r} v4, (3,)."""
    tilt: float
    """Magnitude |φ_r| in [0, π]."""


def tilt_magnitudes(alpha: float, beta: float) -> Range:
    """Return the smallest and the largest |φ| in [0, π] (paper, eq. 9).

    They are |α − β| and α + β, folded at π, for any α and β in [0, π]. If one of the angles is 0 or
    π, both results are equal.
    """
    return abs(alpha - beta), min(alpha + beta, 2.0 * math.pi - (alpha + beta))


def tilt_interval(mechanism: Mechanism) -> Range:
    """Return the range (low, high) of the signed tilt on the home side.

    For the vitreoretinal robot it is (−139.778°, −79.778°).
    """
    low, high = tilt_magnitudes(mechanism.alpha, mechanism.beta)
    return (low, high) if mechanism.side > 0 else (-high, -low)


def extremes(mechanism: Mechanism) -> tuple[Extreme, Extreme]:
    """Return the configurations with the smallest and the largest |φ| (paper, eq. 8).

    e^{ω̂2 θ_r} v4 = ± (sin β / sin α) ω1 + (sin(α ∓ β) / sin α) ω2, with the upper signs for the
    smallest |φ|. Raises GeometryError if ω1 and ω2, or ω2 and ω3, are parallel, because φ is then
    constant.
    """
    alpha = mechanism.alpha
    beta = mechanism.beta
    if min(math.sin(alpha), math.sin(beta)) < PARALLEL:
        raise GeometryError(
            f"alpha = {alpha:.6g}, beta = {beta:.6g} rad: two axes are parallel, the tilt is "
            "constant"
        )
    results = []
    for sign, tilt in zip((1, -1), tilt_magnitudes(alpha, beta), strict=True):
        c1 = sign * math.sin(beta) / math.sin(alpha)
        c2 = math.sin(alpha - sign * beta) / math.sin(alpha)
        theta2 = math.remainder(mechanism.delta + (0.0 if sign > 0 else math.pi), 2.0 * math.pi)
        direction = c1 * mechanism.omega1 + c2 * mechanism.omega2
        results.append(Extreme(theta2, c1, c2, direction, tilt))
    return results[0], results[1]


def theta2_from_tilt(mechanism: Mechanism, tilt: ArrayLike, branch: int) -> Array:
    """Return the θ2 with a tilt φ, in the interval δ + branch · [0, π] and in the shape of `tilt`.

    The branch is +1 or −1, the sign of sin(θ2 − δ). A tilt outside the workspace gives the θ2 of
    the nearest tilt inside.
    """
    low, high = tilt_magnitudes(mechanism.alpha, mechanism.beta)
    half = np.clip(np.abs(np.asarray(tilt, dtype=float)), low, high) / 2.0
    cosine2, sine2 = elbow_squares(
        NUMPY, mechanism.alpha, mechanism.beta, np.cos(half), np.sin(half)
    )
    x = 2.0 * np.arctan2(np.sqrt(np.maximum(sine2, 0.0)), np.sqrt(np.maximum(cosine2, 0.0)))
    return mechanism.delta + check_branch(branch) * x


def magnitude_range(name: str, tilt_range: Range) -> Range:
    """Return the smallest and the largest |φ| of a signed tilt range.

    Raises GeometryError if the range is invalid.
    """
    low, high = (float(end) for end in tilt_range)
    if not -math.pi <= low <= high <= math.pi:
        raise GeometryError(
            f"{name} = [{low:.6g}, {high:.6g}]: lower must not exceed upper, both in [-pi, pi] "
            "rad, not degrees"
        )
    return (0.0 if low < 0.0 < high else min(abs(low), abs(high))), max(abs(low), abs(high))


def check_branch(branch: int) -> int:
    """Return the branch. Raises GeometryError unless it is +1 or −1."""
    if branch not in (1, -1):
        raise GeometryError(
            f"branch = {branch!r}: must be 1 or -1, the sign of sin(theta2 - delta)"
        )
    return branch


def boundary_distance(mechanism: Mechanism, tilt: ArrayLike) -> Array:
    """Return the angle in rad from tilts of any shape to the nearer end of the workspace.

    The angle is negative outside the workspace.
    """
    low, high = tilt_magnitudes(mechanism.alpha, mechanism.beta)
    magnitude = np.abs(_tilts(tilt))
    return np.minimum(magnitude - low, high - magnitude)


def smallest_singular_value(mechanism: Mechanism, q: ArrayLike) -> Array:
    """Return the smallest singular value (n,) of the Jacobian's angular part at q (n, 4).

    The columns of the angular part are the three revolute axes. The value is dimensionless, depends
    on θ2 alone, and is zero at the workspace boundary, where the axes are coplanar.
    """
    values = np.linalg.svd(space_jacobian(mechanism, q)[:, 3:, :3], compute_uv=False)
    return np.asarray(values[:, 2], dtype=float)


def joint_speed_per_tilt_speed(mechanism: Mechanism, tilt: ArrayLike, branch: int) -> Array:
    """Return (dθ1/dφ, dθ2/dφ, dθ3/dφ) (..., 3) at constant roll and spin for tilts (...).

    With x = θ2 − δ and P, E of mechanism.py, for |φ| on the home side:

        dθ2/dφ = sin φ / (sin α sin β sin x)
        dθ1/dφ = E / (sin α sin x sin φ)
        dθ3/dφ = −P / (sin β sin x sin φ)

    The result is infinite at the workspace boundary and NaN outside.
    """
    alpha = mechanism.alpha
    beta = mechanism.beta
    tilts = _tilts(tilt)
    half = np.abs(tilts) / 2.0
    c2, s2 = elbow_squares(NUMPY, alpha, beta, np.cos(half), np.sin(half))
    # At a tilt on the boundary, rounding errors must not turn the infinite result into NaN.
    c2, s2 = (np.where((square < 0.0) & (square > -1e-15), 0.0, square) for square in (c2, s2))
    with np.errstate(divide="ignore", invalid="ignore"):
        product = math.sin(alpha) * math.sin(beta)
        sin_x = check_branch(branch) * 2.0 * np.sqrt(c2 * s2) / product
        sin_x = np.where((c2 < 0.0) | (s2 < 0.0), np.nan, sin_x)
        on_t = (math.sin(alpha - beta) * c2 + math.sin(alpha + beta) * s2) / product
        tilted_component = (math.sin(alpha - beta) * c2 - math.sin(alpha + beta) * s2) / product
        sin_tilt = np.sin(np.abs(tilts))
        joint_1 = tilted_component / (math.sin(alpha) * sin_x * sin_tilt)
        joint_2 = sin_tilt / (product * sin_x)
        joint_3 = -on_t / (math.sin(beta) * sin_x * sin_tilt)
    side = np.where(tilts < 0.0, -1.0, 1.0)
    return np.stack((joint_1, joint_2, joint_3), axis=-1) * side[..., np.newaxis]


def _tilts(value: ArrayLike) -> Array:
    """Return checked tilts, rad. Raises GeometryError if one is outside [−π, π]."""
    tilts = np.asarray(value, dtype=float)
    if not np.all(np.abs(tilts) <= math.pi + 1e-9):
        raise GeometryError(
            f"tilt of shape {tilts.shape}: must be finite and in [-pi, pi] rad, not degrees"
        )
    return tilts


@frozen
class TiltRateBound:
    """Bound on the tilt rate (rad/s), its tilt (rad) and the limiting joint."""

    rate: float
    tilt: float
    joint: str


def tilt_rate_bound(mechanism: Mechanism, ends: Range, acceleration: float) -> TiltRateBound:
    """Bound the tilt rate between two tilts (rad) at rest under a joint acceleration (rad/s²).

    Roll and spin are constant. A joint that starts or ends at rest satisfies q̇² ≤ 2·q̈_max·travel.
    Therefore φ̇ ≤ √(2·q̈_max·min(travel to either end)) / |dq/dφ| for joints 1 to 3. Raises
    GeometryError unless both tilts are inside the workspace, where the joint speeds are bounded.
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
    tilt = np.sort(np.append(tilt, half))  # joints are fastest half way
    slope, travel = _travel(mechanism, tilt)
    speed = np.sqrt(2 * acceleration * np.minimum(travel, travel[-1] - travel))
    rates = speed / np.maximum(slope, 1e-12)
    k = int(np.argmax(rates.min(axis=1)))
    return TiltRateBound(float(rates[k].min()), float(tilt[k]), JOINTS[int(np.argmin(rates[k]))])


def _travel(mechanism: Mechanism, tilt: Array) -> tuple[Array, Array]:
    """Return |dq/dφ| and the travel since the first tilt for joints 1 to 3, each (n, 3).

    The tilts `tilt` (n,) in rad are monotonic.
    """
    slope = np.abs(joint_speed_per_tilt_speed(mechanism, tilt, mechanism.home_branch))
    step = (slope[1:] + slope[:-1]) / 2 * np.abs(np.diff(tilt))[:, None]
    return slope, np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)])


ROUNDING = 1e-12
"""Largest distance in rad by which a corner may lie outside its region."""


@record
class DesignRegion(ShortRepr):
    """All angles (α, β), rad, whose workspace contains a tilt range with a margin.

    Examples
    --------
    >>> import numpy as np
    >>> import ssm_planner as ssm
    >>> region = ssm.design_region(*np.radians([-140.0, -80.0]))
    >>> region.empty
    False
    """

    tilt_range: Range
    margin: float
    vertices: Array
    """Corners (α, β) in order, (4, 2), the one with the smallest α first.

    The shape is (0, 2) for an empty region.
    """

    @property
    def empty(self) -> bool:
        """True if no angles reach the range with the margin."""
        return len(self.vertices) == 0

    @property
    def smallest_alpha(self) -> tuple[float, float]:
        """The (α, β) with the smallest α, which is the most compact design. (nan, nan) if empty."""
        if self.empty:
            return (math.nan, math.nan)
        return (float(self.vertices[0, 0]), float(self.vertices[0, 1]))

    def contains(self, alpha: float, beta: float) -> bool:
        """Return True if the angles (α, β) reach the range with the margin."""
        return design_margin(alpha, beta, self.tilt_range) >= self.margin - ROUNDING


@checked
def design_region(tilt_low: float, tilt_high: float, margin: float = 0.0) -> DesignRegion:
    """Return all (α, β) that reach the signed tilts [tilt_low, tilt_high].

    The corner with the smallest α is ((b − a)/2 + margin, (a + b)/2), for example (30°, 110°) for
    (−140°, −80°). A range through φ = 0 needs α = β. Without a margin, this corner has the ends of
    the range on the workspace boundary, where joint speeds are unbounded. A design that is to be
    built therefore needs a margin.

    Parameters
    ----------
    tilt_low, tilt_high : float
        Range of the signed tilt in rad.
    margin : float
        Required distance of both ends from the workspace boundary in rad.

    Returns
    -------
    DesignRegion

    Raises
    ------
    GeometryError
        If the range or the margin is not in [−π, π] or [0, π].

    Examples
    --------
    >>> import numpy as np
    >>> from ssm_planner import design_region
    >>> region = design_region(*np.radians([-140.0, -80.0]))
    >>> np.degrees(region.smallest_alpha).round(6).tolist()
    [30.0, 110.0]
    """
    low, high = magnitude_range("tilt range", (tilt_low, tilt_high))
    if not 0.0 <= margin <= math.pi:
        raise GeometryError(f"margin = {margin!r}: must be in [0, pi] rad")
    difference = low - margin
    low_sum = high + margin
    if difference < 0.0 or low_sum > math.pi:
        return DesignRegion((tilt_low, tilt_high), margin, np.empty((0, 2)))
    high_sum = 2.0 * math.pi - low_sum
    corners = (
        (low_sum, -difference),
        (low_sum, difference),
        (high_sum, difference),
        (high_sum, -difference),
    )
    vertices = np.array([((total + gap) / 2.0, (total - gap) / 2.0) for total, gap in corners])
    return DesignRegion((tilt_low, tilt_high), margin, vertices)


def design_margin(alpha: float, beta: float, tilt_range: Range) -> float:
    """Return the tilt in rad by which the workspace of (α, β) exceeds both ends of a range.

    The margin is negative if the range is not reached.
    """
    check_angles(alpha, beta)
    low, high = magnitude_range("tilt_range", tilt_range)
    smallest_tilt, largest_tilt = tilt_magnitudes(alpha, beta)
    return min(low - smallest_tilt, largest_tilt - high)
