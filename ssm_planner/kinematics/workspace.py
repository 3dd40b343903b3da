"""Compute the workspace in closed form (paper, §II-B): extreme tilts, design regions, tilt rates.

The module `mechanism` explains the symbols. The tilt φ is the signed angle between ω1 and the tool.
It depends on θ2 alone. Each tilt inside the workspace has two solutions θ2, one on each branch. The
branches meet at the extremes of φ, where dφ/dθ2 = 0.

The magnitude |φ| ranges from |α − β| to α + β (eq. 9). A sum above π counts as 2π minus the sum. A
mechanism with the angles α and β therefore reaches all tilts with a ≤ |φ| ≤ b if |α − β| ≤ a and b
≤ α + β ≤ 2π − b. In the plane of α and β, these conditions describe a rectangle whose sides are at
45° to the axes.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.arguments import checked
from ssm_planner.codegen import NUMPY
from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.forward import space_jacobian
from ssm_planner.kinematics.mechanism import (
    PARALLEL_AXES_SINE,
    Mechanism,
    check_angles,
    elbow_half_angle_squares,
    tilt_magnitudes,
)
from ssm_planner.kinematics.task import task_rates_of_joints
from ssm_planner.typing import Array, Range, record


@record
class Extreme:
    """Configuration in which the tilt is smallest or largest (paper, eqs. 6–9).

    Examples
    --------
    >>> import numpy as np
    >>> import ssm_planner as ssm
    >>> extremes = ssm.workspace(ssm.load_robot("vitreoretinal")).extremes
    >>> np.degrees([extreme.tilt for extreme in extremes]).round(2).tolist()
    [79.78, 139.78]
    """

    theta2: float
    """Position θ_r of joint 2 in (−π, π] rad."""
    c1: float
    """Coefficient of ω1 in the tool axis c1 ω1 + c2 ω2."""
    c2: float
    """Coefficient of ω2 in the tool axis."""
    direction: Array
    """Tool axis for θ1 = 0 and θ2 = θ_r, a unit vector (3,) in the base frame."""
    tilt: float
    """Magnitude of the tilt in [0, π] rad."""


def tilt_interval(mechanism: Mechanism) -> Range:
    """Compute the range of the tilt, with the sign that the tilt has at home.

    Home is the configuration q = 0.

    For the vitreoretinal robot it is (−139.778°, −79.778°).

    Parameters
    ----------
    mechanism : Mechanism
        Axes of the robot.

    Returns
    -------
    (float, float)
        Smallest and largest signed tilt (rad).
    """
    low, high = tilt_magnitudes(mechanism.alpha, mechanism.beta)
    return (low, high) if mechanism.side > 0 else (-high, -low)


def extremes(mechanism: Mechanism) -> tuple[Extreme, Extreme]:
    """Compute the configurations with the smallest and the largest magnitude of the tilt.

    Source: paper, eq. 8.

    In these configurations, the axes of joints 1 and 2 and the tool axis lie in one plane. For θ1 =
    0, the tool axis is

        ± (sin β / sin α) ω1 + (sin(α ∓ β) / sin α) ω2,

    with the upper signs for the smallest |φ|, at θ2 = δ, and the lower signs for the largest |φ|,
    at θ2 = δ + π.

    Parameters
    ----------
    mechanism : Mechanism
        Axes of the robot.

    Returns
    -------
    smallest, largest : Extreme
        Configurations with the smallest and with the largest |φ|.

    Raises
    ------
    GeometryError
        If ω1 and ω2, or ω2 and ω3, are parallel, because φ is then constant.
    """
    alpha = mechanism.alpha
    beta = mechanism.beta
    if min(math.sin(alpha), math.sin(beta)) < PARALLEL_AXES_SINE:
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
    """Compute the positions θ2 of joint 2 for given tilts on one branch.

    `elbow_half_angle_squares` gives C² and S² for the tilt, and θ2 = δ + branch · 2 atan2(S, C).
    The result lies in the interval from δ (`Mechanism.delta`) to δ + branch · π.

    Parameters
    ----------
    mechanism : Mechanism
        Axes of the robot.
    tilt : (...) array-like
        Tilts of either sign (rad). A tilt outside the workspace gives the θ2 of the nearest tilt
        inside.
    branch : int
        Sign of sin(θ2 − δ), +1 or −1.

    Returns
    -------
    (...) array
        Positions θ2 (rad) in the shape of `tilt`.

    Raises
    ------
    GeometryError
        If the branch is neither +1 nor −1.
    """
    if branch not in (1, -1):
        raise GeometryError(
            f"branch = {branch!r}: must be 1 or -1, the sign of sin(theta2 - delta)"
        )
    low, high = tilt_magnitudes(mechanism.alpha, mechanism.beta)
    half = np.clip(np.abs(np.asarray(tilt, dtype=float)), low, high) / 2.0
    cosine2, sine2 = elbow_half_angle_squares(
        NUMPY, mechanism.alpha, mechanism.beta, np.cos(half), np.sin(half)
    )
    x = 2.0 * np.arctan2(np.sqrt(np.maximum(sine2, 0.0)), np.sqrt(np.maximum(cosine2, 0.0)))
    return mechanism.delta + branch * x


def magnitude_range(name: str, tilt_range: Range) -> Range:
    """Compute the smallest and the largest magnitude |φ| in a range of signed tilts.

    A range that contains tilts of both signs has the smallest magnitude 0.

    Parameters
    ----------
    name : str
        Name of the range. The error message contains it.
    tilt_range : (float, float)
        Smallest and largest signed tilt (rad).

    Returns
    -------
    (float, float)
        Smallest and largest magnitude (rad).

    Raises
    ------
    GeometryError
        If the range is reversed or outside [−π, π].
    """
    low, high = map(float, tilt_range)
    if not -math.pi <= low <= high <= math.pi:
        raise GeometryError(
            f"{name} = [{low:.6g}, {high:.6g}]: lower must not exceed upper, both in [-pi, pi] "
            "rad, not degrees"
        )
    smallest = 0.0 if low < 0.0 < high else min(abs(low), abs(high))
    return smallest, max(abs(low), abs(high))


def boundary_distance(mechanism: Mechanism, tilt: ArrayLike) -> Array:
    """Compute the angles from tilts to the nearer end of the tilt range of a mechanism.

    With the smallest and the largest magnitude a and b of the tilt (`tilt_magnitudes`), the angle
    is min(|φ| − a, b − |φ|).

    Parameters
    ----------
    mechanism : Mechanism
        Axes of the robot.
    tilt : (...) array-like
        Tilts φ of either sign (rad).

    Returns
    -------
    (...) array
        Angles (rad) in the shape of `tilt`. They are negative outside the workspace.

    Raises
    ------
    GeometryError
        If a tilt is outside [−π, π].
    """
    low, high = tilt_magnitudes(mechanism.alpha, mechanism.beta)
    magnitude = np.abs(_check_tilts(tilt))
    return np.minimum(magnitude - low, high - magnitude)


def smallest_singular_value(mechanism: Mechanism, q: ArrayLike) -> Array:
    """Compute the smallest singular value of the angular part of the Jacobian.

    The columns of the angular part are the three revolute axes, so the value is dimensionless and
    depends on θ2 alone. It is zero at the workspace boundary, where the axes are coplanar.

    Parameters
    ----------
    mechanism : Mechanism
        Axes of the robot.
    q : (n, 4) array
        Joint positions (rad, and m for joint 4).

    Returns
    -------
    (n,) array
        Smallest singular values.
    """
    values = np.linalg.svd(space_jacobian(mechanism, q)[:, 3:, :3], compute_uv=False)
    return np.asarray(values[:, 2], dtype=float)


def joint_speed_per_tilt_speed(mechanism: Mechanism, tilt: ArrayLike, branch: int) -> Array:
    """Compute the joint velocities per unit tilt velocity at constant roll and spin.

    The rates at which joint 2 alone changes roll, tilt and spin (`task_rates_of_joints`) give the
    velocity of joint 2, and those of joints 1 and 3 that keep roll and spin constant.
    For negative tilts, all three change their signs, because φ = −|φ|.

    Parameters
    ----------
    mechanism : Mechanism
        Axes of the robot.
    tilt : (...) array-like
        Tilts φ (rad).
    branch : int
        Sign of sin x, +1 or −1.

    Returns
    -------
    (..., 3) array
        Derivatives dθ1/dφ, dθ2/dφ and dθ3/dφ. They are infinite at the workspace boundary, and NaN
        outside the workspace.

    Raises
    ------
    GeometryError
        If the branch is neither +1 nor −1, or a tilt is outside [−π, π].
    """
    tilts = _check_tilts(tilt)
    theta2 = theta2_from_tilt(mechanism, tilts, branch)
    roll, tilt_rate, spin, _ = task_rates_of_joints(
        NUMPY, mechanism, (0.0, theta2, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)
    )
    speeds = np.stack((-roll, np.ones_like(roll), -spin), axis=-1)
    sign = np.where(tilts < 0.0, -mechanism.side, mechanism.side)
    # At a tilt on the boundary, rounding errors must not turn the infinite result into NaN.
    is_outside = boundary_distance(mechanism, tilts) < -1e-15
    with np.errstate(divide="ignore", invalid="ignore"):
        return speeds * np.where(is_outside, np.nan, sign / tilt_rate)[..., np.newaxis]


def _check_tilts(value: ArrayLike) -> Array:
    """Check tilts, and return them as an array.

    Parameters
    ----------
    value : (...) array-like
        Tilts (rad), of any shape.

    Returns
    -------
    (...) array
        The same tilts.

    Raises
    ------
    GeometryError
        If a tilt is outside [−π, π] or not finite.
    """
    tilts = np.asarray(value, dtype=float)
    if not np.all(np.abs(tilts) <= math.pi + 1e-9):
        raise GeometryError(
            f"tilt of shape {tilts.shape}: must be finite and in [-pi, pi] rad, not degrees"
        )
    return tilts


REGION_TOLERANCE = 1e-12
"""Rounding error (rad) by which a corner of a design region may miss the required margin."""


@record
class DesignRegion:
    """Region of all angles (α, β) of mechanisms that reach a tilt range with a margin, rad.

    Examples
    --------
    >>> import numpy as np
    >>> import ssm_planner as ssm
    >>> region = ssm.design_region(*np.radians([-140.0, -80.0]))
    >>> region.empty
    False
    """

    tilt_range: Range
    """Smallest and largest signed tilt, rad."""
    margin: float
    """Required distance of both tilts from the workspace boundary, rad."""
    vertices: Array
    """Corners (α, β) in rad in the order along the border, (4, 2), beginning at the smallest α.

    The shape is (0, 2) for an empty region.
    """

    @property
    def empty(self) -> bool:
        """True if no mechanism reaches the range with the margin."""
        return len(self.vertices) == 0

    @property
    def smallest_alpha(self) -> tuple[float, float]:
        """The corner (α, β) with the smallest α, rad, which is the most compact design.

        Both values are NaN if the region is empty.
        """
        if self.empty:
            return (math.nan, math.nan)
        alpha, beta = self.vertices[0].tolist()
        return alpha, beta

    def contains(self, alpha: float, beta: float) -> bool:
        """Return whether a mechanism reaches the tilt range with the margin.

        Parameters
        ----------
        alpha, beta : float
            Angles α between the axes of joints 1 and 2, and β between those of joints 2 and 3
            (rad).

        Returns
        -------
        bool
            True also on the border of the region, up to rounding.
        """
        return design_margin(alpha, beta, self.tilt_range) >= self.margin - REGION_TOLERANCE


@checked
def design_region(tilt_low: float, tilt_high: float, margin: float = 0.0) -> DesignRegion:
    """Compute all angles (α, β) of mechanisms that reach a range of tilts.

    α is the angle between the axes of joints 1 and 2, and β that between the axes of joints 2 and
    3. With the smallest and the largest magnitude a and b of the tilts in the range, the conditions
    are

        |α − β| ≤ a − margin,   b + margin ≤ α + β ≤ 2π − (b + margin).

    They describe a rectangle in the plane of α and β. Its corner with the smallest α is ((b − a)/2
    + margin, (a + b)/2), for example (30°, 110°) for the tilts (−140°, −80°) without a margin. A
    range that contains the tilt 0 needs α = β.

    Without a margin, this corner has both ends of the range on the workspace boundary, where joint
    speeds are unbounded. A design that is to be built therefore needs a margin.

    Parameters
    ----------
    tilt_low, tilt_high : float
        Smallest and largest signed tilt (rad).
    margin : float
        Required distance (rad) of both ends of the range from the workspace boundary.

    Returns
    -------
    DesignRegion
        Corners of the rectangle. There are none if no mechanism reaches the range with the margin.

    Raises
    ------
    GeometryError
        If the range is reversed or outside [−π, π], or the margin is outside [0, π].

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
    largest_difference = low - margin
    smallest_sum = high + margin
    if largest_difference < 0.0 or smallest_sum > math.pi:
        return DesignRegion((tilt_low, tilt_high), margin, np.empty((0, 2)))
    largest_sum = 2.0 * math.pi - smallest_sum
    corners = (
        (smallest_sum, -largest_difference),
        (smallest_sum, largest_difference),
        (largest_sum, largest_difference),
        (largest_sum, -largest_difference),
    )
    vertices = np.array(
        [((total + difference) / 2.0, (total - difference) / 2.0) for total, difference in corners]
    )
    return DesignRegion((tilt_low, tilt_high), margin, vertices)


def design_margin(alpha: float, beta: float, tilt_range: Range) -> float:
    """Compute the angle by which the workspace of (α, β) exceeds both ends of a tilt range.

    It is the smaller of the two distances at the smallest and the largest magnitude of the tilt.

    Parameters
    ----------
    alpha, beta : float
        Angles α between the axes of joints 1 and 2, and β between those of joints 2 and 3 (rad).
    tilt_range : (float, float)
        Smallest and largest signed tilt (rad).

    Returns
    -------
    float
        Angle (rad). It is negative if the workspace does not contain the range.

    Raises
    ------
    GeometryError
        If α or β is outside [0, π], or the range is reversed or outside [−π, π].
    """
    check_angles(alpha, beta)
    low, high = magnitude_range("tilt_range", tilt_range)
    smallest_tilt, largest_tilt = tilt_magnitudes(alpha, beta)
    return min(low - smallest_tilt, largest_tilt - high)
