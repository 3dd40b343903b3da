"""Describe the geometry of the serial spherical mechanism.

Three revolute axes meet in one point, the remote centre of motion (RCM). The fourth joint
translates the tool along the third axis. The symbols of this package are:

    ω1, ω2, ω3   unit vectors of the revolute axes at q = 0, in the base frame
    θ1 … θ4      positions of the joints, rad and m
    α, β         angles between ω1 and ω2, and between ω2 and ω3
    ψ, φ, σ      roll, tilt and spin of the tool
    t            unit vector in the plane of ω1 and ω2, perpendicular to ω1, on the side of ω2
    n            ω1 × t

ω1, ω2 and the tool axis form a spherical triangle with the sides α, β and |φ|, where |φ| is the
angle between ω1 and the tool axis. The angle of the triangle at ω2 is |x| with x = θ2 − δ, and δ is
the θ2 with the smallest |φ|. With c = cos(x/2) and s = sin(x/2):

    cos φ = cos(α − β) c² + cos(α + β) s²          (f(θ2) in eq. 4 of the paper)
    e^{ω̂2 θ2} ω3 = cos φ ω1 + P t + Q n
    P = sin(α − β) c² + sin(α + β) s²,   Q = −2 sin β s c

In the tool frame, ω1 has the azimuth η = atan2(F, E) about the tool axis. The azimuth is zero at θ2
= δ:

    E = sin(α − β) c² − sin(α + β) s²,   F = −2 sin α s c

It follows that ψ = θ1 + ζ ± 90° with ζ = atan2(Q, P), and σ = θ3 − η + constant. The tilt depends
on θ2 alone. The functions of the triangle accept NumPy arrays and CasADi expressions; the argument
`xp` selects the library. They use half angles and atan2 instead of acos, so they stay accurate
where the triangle degenerates to an arc.
"""

import math
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.codegen import NUMPY, Namespace
from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.rotations import rodrigues_terms, rotation
from ssm_planner.problem import Geometry, Robot, read_only_array
from ssm_planner.typing import Array, Range, record

PARALLEL_AXES_SINE = 1e-9
"""Sine of the angle below which two axes count as parallel."""
ROTATION_TOLERANCE = 2.5e-7
"""Largest magnitude of the entries of RᵀR − 1 for a rotation matrix R."""


@record
class Mechanism:
    """Joint axes of the robot at q = 0 in the base frame, and the angles between them.

    Units are SI and radians. The symbols are explained at the top of this module. Build a mechanism
    with `from_robot`, `from_geometry` or `from_angles`.
    """

    omega1: Array
    """Unit vector ω1 (3,) of the axis of joint 1."""
    omega2: Array
    """Unit vector ω2 (3,) of the axis of joint 2."""
    omega3: Array
    """Unit vector ω3 (3,) of the axis of joint 3, which is the tool axis."""
    tool_home: Array
    """R_0 (3, 3), the rotation base ← tool at q = 0. Its z column is omega3."""
    tilt_axis: Array
    """Unit vector t (3,) in the plane of omega1 and omega2.

    It is perpendicular to omega1 and on the side of omega2.
    """
    side: int
    """Sign of the home tilt. Task coordinates describe each pose by the tilt that has this sign."""
    insertion_sign: int = -1
    """Sign in depth = insertion_sign · θ4."""

    def __post_init__(self) -> None:
        for array in (self.omega1, self.omega2, self.omega3, self.tool_home, self.tilt_axis):
            array.setflags(write=False)

    @classmethod
    def from_robot(cls, robot: Robot) -> "Mechanism":
        """Build the mechanism of a robot.

        Parameters
        ----------
        robot : Robot
            Robot with its geometry.

        Returns
        -------
        Mechanism
            The mechanism. Robots with equal geometry share one object.
        """
        return cls.from_geometry(robot.geometry)

    @classmethod
    def from_geometry(cls, geometry: Geometry) -> "Mechanism":
        """Build the mechanism from the `geometry` section of a robot file.

        The axes are normalised, and the z column of the tool frame is set to the third axis
        exactly.

        Parameters
        ----------
        geometry : Geometry
            Joint axes, tool frame at q = 0, and sign of the insertion.

        Returns
        -------
        Mechanism
            The mechanism. Equal geometries share one object.

        Raises
        ------
        GeometryError
            If `tool_home` is not a rotation, or its z column differs from the third axis.
        """
        axes = [np.asarray(axis, dtype=float).tobytes() for axis in geometry.axes[:3]]
        return _mechanism_from_axes(
            *axes,
            tool_home=np.asarray(geometry.tool_home, dtype=float).tobytes(),
            insertion_sign=int(geometry.insertion_sign),
        )

    @classmethod
    def from_angles(
        cls,
        alpha: float,
        beta: float,
        home_tilt: float | None = None,
        *,
        tool_home: ArrayLike | None = None,
        insertion_sign: int = -1,
    ) -> "Mechanism":
        """Build a mechanism from its angles, for design studies.

        The base frame is chosen such that ω1 = x, t = y and ω2 = (cos α, sin α, 0).

        Parameters
        ----------
        alpha, beta : float
            Angles between the axes of joints 1 and 2, and of joints 2 and 3, in [0, π] rad.
        home_tilt : float, optional
            Tilt at q = 0 in [−π, π] rad. The default is the middle of the tilt range on the
            negative side. The roll at q = 0 lies in [−90°, 90°].
        tool_home : (3, 3), optional
            Rotation from the tool frame to the base frame at q = 0. By default, the tool's y axis
            is the tilt axis at roll 0.
        insertion_sign : int
            Sign in depth = insertion_sign · θ4.

        Returns
        -------
        Mechanism
            Mechanism with these angles.

        Raises
        ------
        GeometryError
            If an angle is out of range or the mechanism cannot reach `home_tilt`.
        """
        check_angles(alpha, beta)
        low, high = tilt_magnitudes(alpha, beta)
        tilt = -(low + high) / 2.0 if home_tilt is None else float(home_tilt)
        if not low - 1e-9 <= abs(tilt) <= high + 1e-9:
            raise GeometryError(
                f"home_tilt = {tilt!r} rad: |tilt| must be in [{low:.6g}, {high:.6g}] rad (paper, "
                "eq. 9)"
            )
        x = np.array([1.0, 0.0, 0.0])
        y = np.array([0.0, 1.0, 0.0])
        omega2 = np.array([math.cos(alpha), math.sin(alpha), 0.0])
        omega3 = _third_axis(alpha, beta, tilt)
        sign = math.copysign(1.0, tilt)
        roll = math.atan2(sign * omega3[1], -sign * omega3[2])
        # The tool at roll and tilt 0 has its z axis along ω1 = x and its y axis along t = y.
        pointing = rotation(x, roll) @ rotation(y, tilt)
        default = pointing @ np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
        home = _check_tool_home(default if tool_home is None else tool_home, omega3)
        return cls(
            x, omega2, omega3, home, tilt_axis=y, side=int(sign), insertion_sign=insertion_sign
        )

    @cached_property
    def alpha(self) -> float:
        """Angle α between the axes of joints 1 and 2, in [0, π] rad."""
        return _angle_between(self.omega1, self.omega2)

    @cached_property
    def beta(self) -> float:
        """Angle β between the axes of joints 2 and 3, in [0, π] rad."""
        return _angle_between(self.omega2, self.omega3)

    @cached_property
    def frame(self) -> Array:
        """Rotation (3, 3) whose columns are ω1, t and n = ω1 × t in the base frame."""
        return read_only_array(
            np.column_stack((self.omega1, self.tilt_axis, np.cross(self.omega1, self.tilt_axis))),
            (3, 3),
        )

    @cached_property
    def tip_axes(self) -> Array:
        """Rows ω1, t × ω1 and ω1 × (t × ω1) in the base frame, (3, 3).

        The first row is the tool axis at roll 0 and tilt 0. The tool tilts from there in the
        direction of the second row.
        """
        across = np.cross(self.tilt_axis, self.omega1)
        return read_only_array([self.omega1, across, np.cross(self.omega1, across)], (3, 3))

    @cached_property
    def toward_omega1(self) -> Array:
        """Unit vector (3,) from the axis ω2 towards ω1, perpendicular to ω2."""
        return math.sin(self.alpha) * self.omega1 - math.cos(self.alpha) * self.tilt_axis

    @cached_property
    def delta(self) -> float:
        """Angle δ in [−π, π] rad: the θ2 with the smallest angle between ω1 and the tool axis."""
        return -math.atan2(
            -float(self.omega3 @ self.frame[:, 2]), float(self.omega3 @ self.toward_omega1)
        )

    @cached_property
    def home_branch(self) -> int:
        """Branch of the configuration q = 0: the sign of sin(θ2 − δ), or +1 if the sine is zero."""
        return -1 if math.sin(self.delta) > 0.0 else 1

    def branch_of(self, q: Array) -> Array:
        """Return the branch of the inverse kinematics on which joint positions lie.

        The branch is the sign of sin(θ2 − δ). A sine of zero counts as −1.

        Parameters
        ----------
        q : (..., 4) array
            Joint positions (rad, and m for joint 4).

        Returns
        -------
        (...) array
            Branches, +1 or −1.
        """
        return np.where(np.sin(q[..., 1] - self.delta) > 0.0, 1, -1)

    @cached_property
    def home_roll(self) -> float:
        """Roll ψ_h in (−90°, 90°] at q = 0, rad.

        It satisfies ω3 = e^{ω̂1 ψ_h} e^{t̂ φ_h} ω1, where φ_h is `home_tilt`.
        """
        along_t = self.omega3 @ self.tilt_axis
        along_n = self.omega3 @ self.frame[:, 2]
        return math.atan2(self.side * along_t, -self.side * along_n) + 0.0

    @cached_property
    def home_tilt(self) -> float:
        """Tilt φ_h at q = 0, rad.

        It is the signed angle from ω1 to ω3 about the axis t, which the roll ψ_h has turned about
        ω1.
        """
        return self.side * _angle_between(self.omega1, self.omega3)

    @cached_property
    def exponentials(self) -> Array:
        """Constant matrices E (3, 3, 3, 3) of the rotations about the axes of joints i = 1, 2, 3.

        They are those of `rodrigues_terms`, so that e^{ω̂_i θ_i} = E[i − 1, 0] + cos θ_i E[i − 1,
        1] + sin θ_i E[i − 1, 2].
        """
        terms = [rodrigues_terms(axis) for axis in (self.omega1, self.omega2, self.omega3)]
        return read_only_array(terms, (3, 3, 3, 3))

    @cached_property
    def orientation_terms(self) -> Array:
        """Constant factors (27, 9) that give the tool orientation R.

        Each of the nine entries of R is a linear combination of the 27 products of one term (1, cos
        θ_i or sin θ_i) for each joint i = 1, 2, 3.
        """
        term_1, term_2, term_3 = self.exponentials
        terms = np.einsum("aij,bjk,ckl,lm->abcim", term_1, term_2, term_3, self.tool_home)
        return read_only_array(terms, (27, 9))

    @cached_property
    def tool_on_omega1(self) -> Array:
        """Orientation (3, 3) of the tool at zero roll, tilt and spin, where it points along ω1.

        It is e^{−t̂ φ_h} e^{−ω̂1 ψ_h} R_0 with the home roll ψ_h, the home tilt φ_h and R_0 =
        `tool_home`.
        """
        back = rotation(self.tilt_axis, -self.home_tilt) @ rotation(self.omega1, -self.home_roll)
        return read_only_array(back @ self.tool_home, (3, 3))

    @cached_property
    def tool_angle(self) -> float:
        """Angle ρ about the tool axis at θ2 = δ, rad.

        It is measured from the direction in which ω1 lies, as seen from ω2, to the tool's x axis.
        """
        pointing = math.cos(self.beta) * self.omega2 + math.sin(self.beta) * self.toward_omega1
        zero = math.cos(self.beta) * self.toward_omega1 - math.sin(self.beta) * self.omega2
        tool_x = rotation(self.omega2, self.delta) @ self.tool_home[:, 0]
        return math.atan2(float(tool_x @ np.cross(pointing, zero)), float(tool_x @ zero))

    @cached_property
    def spin_offset(self) -> float:
        """Offset c (rad) in the spin σ = θ3 − η + c, which makes the spin zero at q = 0.

        η is the azimuth of ω1 about the tool axis (`azimuths`).
        """
        on_omega1 = self.frame.T @ self.tool_on_omega1[:, 0]
        kappa = math.atan2(float(on_omega1[2]), float(on_omega1[1]))
        half = -self.delta / 2.0
        eta = float(azimuths(NUMPY, self.alpha, self.beta, math.cos(half), math.sin(half))[1])
        return eta + math.remainder(
            self.side * math.pi / 2.0 + self.tool_angle - kappa - eta, 2.0 * math.pi
        )


def tilt_magnitudes(alpha: float, beta: float) -> Range:
    """Compute the smallest and the largest magnitude of the tilt (paper, eq. 9).

    The smallest magnitude is |α − β|, and the largest is α + β, or 2π − (α + β) if the sum exceeds
    π.

    Parameters
    ----------
    alpha, beta : float
        Angles α between the axes of joints 1 and 2, and β between those of joints 2 and 3, in [0,
        π] (rad). If one of them is 0 or π, the tilt is constant, and both results are equal.

    Returns
    -------
    (float, float)
        Smallest and largest magnitude in [0, π] (rad).
    """
    return abs(alpha - beta), min(alpha + beta, 2.0 * math.pi - (alpha + beta))


def check_angles(alpha: float, beta: float) -> None:
    """Raise an error unless both angles between the axes are in [0, π].

    Parameters
    ----------
    alpha, beta : float
        Angles α between the axes of joints 1 and 2, and β between those of joints 2 and 3 (rad).

    Raises
    ------
    GeometryError
        If an angle is outside [0, π] or NaN.
    """
    for name, angle in (("alpha", alpha), ("beta", beta)):
        if not 0.0 <= angle <= math.pi:
            raise GeometryError(
                f"{name} = {angle!r}: an angle between axes, in [0, pi] rad; degrees are not meant"
            )


@lru_cache(maxsize=32)
def _mechanism_from_axes(*axes: bytes, tool_home: bytes, insertion_sign: int) -> Mechanism:
    """Build a mechanism from its axes, or return the cached one for equal geometry.

    Other caches use the identity of a mechanism as their key, so equal geometry must give the same
    object. The arguments are the bytes of float arrays because −0.0 and 0.0 compare equal but give
    different results.

    Parameters
    ----------
    axes : bytes of (3,) arrays
        The axes ω1, ω2 and ω3. They need not be unit vectors.
    tool_home : bytes of a (3, 3) array
        Rotation from the tool frame to the base frame at q = 0.
    insertion_sign : int
        Sign in depth = insertion_sign · θ4.

    Returns
    -------
    Mechanism
        Mechanism with unit axes. Equal arguments give the same object.
    """
    vectors = [np.frombuffer(axis) for axis in axes]
    omega1, omega2, omega3 = [vector / np.linalg.norm(vector) for vector in vectors]
    home = _check_tool_home(np.frombuffer(tool_home).reshape(3, 3), omega3)
    normal = np.cross(omega1, omega2)
    normal = normal / np.linalg.norm(normal)
    tilt_axis = np.cross(normal, omega1)
    side = _home_tilt_sign(float(omega3 @ tilt_axis), float(omega3 @ normal))
    tilt_axis = tilt_axis / np.linalg.norm(tilt_axis)
    return Mechanism(
        omega1, omega2, omega3, home, tilt_axis, side=side, insertion_sign=insertion_sign
    )


def _check_tool_home(value: ArrayLike, omega3: Array) -> Array:
    """Check the orientation of the tool at home, and align it exactly with the third axis.

    Home is the configuration q = 0.

    Parameters
    ----------
    value : (3, 3)
        Rotation from the tool frame to the base frame.
    omega3 : (3,)
        Unit vector of the third axis.

    Returns
    -------
    (3, 3) array
        Rotation whose z column is ω3 and whose x column is made perpendicular to it.

    Raises
    ------
    GeometryError
        If `value` is not a rotation, or its z column differs from ω3 by more than 1e-6.
    """
    matrix = np.asarray(value, dtype=float)
    defect = np.abs(matrix.T @ matrix - np.eye(3)).max()
    if not (defect <= ROTATION_TOLERANCE and np.linalg.det(matrix) > 0.0):
        raise GeometryError(f"tool_home = {matrix.tolist()} is not a rotation")
    if np.linalg.norm(matrix[:, 2] - omega3) > 1e-6:
        raise GeometryError(
            f"tool_home: its z column {matrix[:, 2].tolist()} must be omega3 = {omega3.tolist()} "
            "(the tool's axis)"
        )
    x = matrix[:, 0] - omega3 * (omega3 @ matrix[:, 0])
    x = x / np.linalg.norm(x)
    return np.column_stack((x, np.cross(omega3, x), omega3))


def _angle_between(a: Array, b: Array) -> float:
    """Compute the angle between two unit vectors a and b, 2 atan2(|a − b|, |a + b|).

    Unlike acos(a · b), this formula stays accurate near 0 and π.

    Parameters
    ----------
    a, b : (3,) array
        Unit vectors.

    Returns
    -------
    float
        Angle in [0, π] (rad).
    """
    return 2.0 * math.atan2(float(np.linalg.norm(a - b)), float(np.linalg.norm(a + b)))


def _home_tilt_sign(along_t: float, along_n: float) -> int:
    """Determine the sign of the tilt at home.

    It is the sign for which the roll at q = 0 is in (−90°, 90°].

    The tool axis is cos φ ω1 + sin φ (sin ψ t − cos ψ n) with the roll ψ, the tilt φ, the first
    joint axis ω1, the normal n of the first two joint axes, and t = n × ω1. The poses (ψ, φ) and (ψ
    + π, −φ) are equal, so the interval of ψ determines the sign of φ.

    Parameters
    ----------
    along_t, along_n : float
        Components of the tool axis along t and n.

    Returns
    -------
    int
        Sign of the tilt φ, 1 or −1.
    """
    if abs(along_n) > PARALLEL_AXES_SINE:
        return -1 if along_n > 0.0 else 1
    return 1 if along_t > PARALLEL_AXES_SINE else -1


def _third_axis(alpha: float, beta: float, tilt: float) -> Array:
    """Compute the tool axis of a mechanism that has a given tilt at home.

    The mechanism has ω1 = x and t = y.

    The result is e^{ω̂2 θ2} ω3 of the equations at the top of this module, on the branch that gives
    a roll in [−90°, 90°].

    Parameters
    ----------
    alpha, beta : float
        Angles α between the axes of joints 1 and 2, and β between those of joints 2 and 3 (rad).
    tilt : float
        Signed tilt (rad) that the mechanism can reach.

    Returns
    -------
    (3,) array
        Unit vector.
    """
    half = abs(tilt) / 2.0
    cosine2, sine2 = elbow_half_angle_squares(NUMPY, alpha, beta, math.cos(half), math.sin(half))
    x = math.copysign(
        2.0 * math.atan2(math.sqrt(max(sine2, 0.0)), math.sqrt(max(cosine2, 0.0))), tilt
    )
    along_omega1 = math.cos(alpha) * math.cos(beta) + math.sin(alpha) * math.sin(beta) * math.cos(x)
    along_t = math.sin(alpha) * math.cos(beta) - math.cos(alpha) * math.sin(beta) * math.cos(x)
    return np.array([along_omega1, along_t, -math.sin(beta) * math.sin(x)])


def tilt_magnitude(xp: Namespace, alpha: Any, beta: Any, x: Any) -> Any:
    """Compute the magnitude of the tilt from the position of joint 2 (paper, eq. 4).

    |φ| is the side of a spherical triangle with the other sides α and β and the angle |x| between
    these two sides. The paper's equation cos φ = cos(α − β) cos²(x/2) + cos(α + β) sin²(x/2) is
    evaluated with half angles,

        sin²(φ/2) = sin²((α − β)/2) cos²(x/2) + sin²((α + β)/2) sin²(x/2)
        cos²(φ/2) = cos²((α − β)/2) cos²(x/2) + cos²((α + β)/2) sin²(x/2)
        |φ| = 2 atan2(sin(φ/2), cos(φ/2)).

    This form is accurate at both ends of the range, where acos would lose half of the digits.

    Parameters
    ----------
    xp : Namespace
        Elementary functions of NumPy or CasADi.
    alpha, beta : float or array
        Angles α between the axes of joints 1 and 2, and β between those of joints 2 and 3 (rad).
    x : array or expression
        Angle x = θ2 − δ (rad), where δ is `Mechanism.delta`.

    Returns
    -------
    array or expression with the shape of x
        Magnitudes in [0, π] (rad).
    """
    c = xp.cos(x / 2.0)
    s = xp.sin(x / 2.0)
    half_difference = (alpha - beta) / 2.0
    half_sum = (alpha + beta) / 2.0
    sine2 = xp.sin(half_difference) ** 2 * (c * c) + xp.sin(half_sum) ** 2 * (s * s)
    cosine2 = xp.cos(half_difference) ** 2 * (c * c) + xp.cos(half_sum) ** 2 * (s * s)
    return 2.0 * xp.arctan2(xp.sqrt(sine2), xp.sqrt(cosine2))


def elbow_half_angle_squares(
    xp: Namespace, alpha: Any, beta: Any, cosine: Any, sine: Any
) -> tuple[Any, Any]:
    """Compute the position of joint 2 for a tilt, as squares of cosine and sine of a half angle.

    The results are cos²(x/2) and sin²(x/2) for the tilt φ, up to a common factor, with x = θ2 − δ.

    This is the inverse of `tilt_magnitude`. The results are

        C² = sin((α + β + φ)/2) sin((α + β − φ)/2)
        S² = sin((φ + α − β)/2) sin((φ − α + β)/2).

    Each of the two vanishes at one end of the tilt range and is negative beyond it. Their sum is
    sin α sin β times the squared norm of (cosine, sine).

    Parameters
    ----------
    xp : Namespace
        Elementary functions of NumPy or CasADi.
    alpha, beta : float or array
        Angles α between the axes of joints 1 and 2, and β between those of joints 2 and 3 (rad).
    cosine, sine : array or expression
        cos(φ/2) and sin(φ/2), or both times a common factor.

    Returns
    -------
    cosine2, sine2 : array or expression
        C² and S², which are proportional to cos²(x/2) and sin²(x/2).
    """
    half_difference = (alpha - beta) / 2.0
    half_sum = (alpha + beta) / 2.0
    far_a = xp.sin(half_sum) * cosine
    far_b = xp.cos(half_sum) * sine
    near_a = xp.cos(half_difference) * sine
    near_b = xp.sin(half_difference) * cosine
    return (far_a + far_b) * (far_a - far_b), (near_a + near_b) * (near_a - near_b)


def azimuths(xp: Namespace, alpha: Any, beta: Any, c: Any, s: Any) -> tuple[Any, Any]:
    """Compute the azimuths ζ of the tool axis about ω1, and η of ω1 about the tool axis.

    With x = θ2 − δ, c = cos(x/2) and s = sin(x/2),

        ζ = atan2(−2 sin β s c, sin(α − β) c² + sin(α + β) s²)
        η = atan2(−2 sin α s c, sin(α − β) c² − sin(α + β) s²).

    These are atan2(Q, P) and atan2(F, E) of the text at the top of this module, which derives them
    from the spherical triangle of ω1, ω2 and the tool axis. Both azimuths are continuous on a
    branch.

    Parameters
    ----------
    xp : Namespace
        Elementary functions of NumPy or CasADi.
    alpha, beta : float or array
        Angles α between the axes of joints 1 and 2, and β between those of joints 2 and 3 (rad).
    c, s : array or expression
        cos(x/2) and sin(x/2). A common positive factor does not change the result.

    Returns
    -------
    zeta, eta : array or expression
        Azimuths ζ and η (rad).
    """
    minus = xp.sin(alpha - beta) * (c * c)
    plus = xp.sin(alpha + beta) * (s * s)
    cross = -2.0 * (s * c)
    zeta = xp.arctan2(xp.sin(beta) * cross, minus + plus)
    eta = xp.arctan2(xp.sin(alpha) * cross, minus - plus)
    return zeta, eta
