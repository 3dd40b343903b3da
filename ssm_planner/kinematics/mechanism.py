"""The serial spherical mechanism: three revolute axes through the RCM and a translation along the third.

Its axes ω1, ω2 and the tool form a spherical triangle with the sides α (ω1 to ω2), β (ω2 to tool) and |φ| (ω1 to tool);
its angle at ω2 is |x|, x = θ2 − δ. With c = cos(x/2) and s = sin(x/2):
    cos φ = cos(α − β) c² + cos(α + β) s²,     the paper's f(θ2), eq. 4
    e^{ω̂2 θ2} ω3 = cos φ ω1 + P t + Q n,        P = sin(α − β) c² + sin(α + β) s²,   Q = −2 sin β s c
Seen from the tool, ω1 lies at the angle η = atan2(F, E) about the tool axis, counted from its place at θ2 = δ:
    E = sin(α − β) c² − sin(α + β) s²,   F = −2 sin α s c
so roll = θ1 + ζ ± 90° with ζ = atan2(Q, P), and spin = θ3 − η + constant: tilt depends on θ2 alone, roll and spin
are θ1 and θ3 plus functions of θ2. The functions of the triangle serve NumPy arrays and CasADi expressions (`xp`); they
are half-angle forms, atan2 of products, no acos, so that they are exact where the triangle degenerates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.codegen.namespace import NUMPY, Namespace
from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.rotations import exponential_terms, rotation, rotation_matrices
from ssm_planner.problem.robot import Geometry, frozen
from ssm_planner.typing import Array

PARALLEL = 1e-9
"""Sine of the angle below which two axes count as parallel."""


@dataclass(frozen=True, eq=False)
class Mechanism:
    """Axes at q = 0 in the base frame and all angles that follow from them; SI, radians.

    Build it with `from_geometry` or `from_angles`.
    """

    omega1: Array
    omega2: Array
    omega3: Array
    tool_home: Array
    """R_0, (3, 3), base ← tool at q = 0; its z column is omega3."""
    tilt_axis: Array
    """t: unit, perpendicular to omega1, in the plane of omega1 and omega2, on omega2's side."""
    side: int
    """Sign of the home tilt: task coordinates name a pose by its tilt on this side of ω1."""
    insertion_sign: int = -1
    """depth = insertion_sign · θ4."""

    def __post_init__(self) -> None:
        for array in (self.omega1, self.omega2, self.omega3, self.tool_home, self.tilt_axis):
            array.setflags(write=False)

    @classmethod
    def from_geometry(cls, geometry: Geometry) -> Mechanism:
        """The mechanism of a robot file, its axes of length 1 and its tool frame on the third to the last digit."""
        vectors = geometry.omega1, geometry.omega2, geometry.omega3, geometry.tool_home
        omega1, omega2, omega3, tool_home = (
            np.asarray(vector, dtype=float).tobytes() for vector in vectors
        )
        return _of_axes(
            omega1, omega2, omega3, tool_home=tool_home, insertion_sign=int(geometry.insertion_sign)
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
    ) -> Mechanism:
        """A mechanism for design studies: ω1 = x, t = y, ω2 = (cos α, sin α, 0), α and β in [0, π].

        At q = 0 the tool has the tilt `home_tilt`, in [−π, π] (None: the middle of the tilt range, negative side), and
        a roll in [−90°, 90°]. `tool_home` defaults to a tool whose y axis is the tilt axis at roll 0.
        """
        check_angles(alpha, beta)
        low, high = abs(alpha - beta), min(alpha + beta, 2.0 * math.pi - alpha - beta)
        tilt = -(low + high) / 2.0 if home_tilt is None else float(home_tilt)
        if not low - 1e-9 <= abs(tilt) <= high + 1e-9:
            raise GeometryError(
                f"home_tilt = {tilt!r} rad: |tilt| must be in [{low:.6g}, {high:.6g}] rad (paper, eq. 9)"
            )
        x, y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
        omega2, omega3 = (
            np.array([math.cos(alpha), math.sin(alpha), 0.0]),
            _omega3(alpha, beta, tilt),
        )
        sign = math.copysign(1.0, tilt)
        roll = math.atan2(sign * omega3[1], -sign * omega3[2])
        pointing = rotation(x, roll) @ rotation(y, tilt)
        default = pointing @ np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
        home = _tool_home(default if tool_home is None else tool_home, omega3)
        return cls(
            x, omega2, omega3, home, tilt_axis=y, side=int(sign), insertion_sign=insertion_sign
        )

    @cached_property
    def alpha(self) -> float:
        """Angle between ω1 and ω2, in [0, π]."""
        return _angle(self.omega1, self.omega2)

    @cached_property
    def beta(self) -> float:
        """Angle between ω2 and ω3, in [0, π]."""
        return _angle(self.omega2, self.omega3)

    @cached_property
    def frame(self) -> Array:
        """Rotation base ← (ω1, t, n) with n = ω1 × t, (3, 3)."""
        return frozen(
            np.column_stack((self.omega1, self.tilt_axis, np.cross(self.omega1, self.tilt_axis))),
            (3, 3),
        )

    @cached_property
    def tip_axes(self) -> Array:
        """ω1, t × ω1 and ω1 × (t × ω1), row by row, (3, 3): the tool at roll and tilt 0, and towards where it tilts."""
        across = np.cross(self.tilt_axis, self.omega1)
        return frozen([self.omega1, across, np.cross(self.omega1, across)], (3, 3))

    @cached_property
    def delta(self) -> float:
        """δ: the θ2, in [−π, π], at which cos φ is largest (the tool nearest to ω1), the zero of x = θ2 − δ."""
        toward_omega1 = math.sin(self.alpha) * self.omega1 - math.cos(self.alpha) * self.tilt_axis
        return -math.atan2(
            -float(self.omega3 @ self.frame[:, 2]), float(self.omega3 @ toward_omega1)
        )

    @cached_property
    def home_branch(self) -> int:
        """Branch (sign of sin(θ2 − δ)) of the home configuration; +1 where home is on the boundary."""
        return -1 if math.sin(self.delta) > 0.0 else 1

    def branch_of(self, q: Array) -> Array:
        """Branches of the inverse kinematics, ±1, that joints (…, 4) are on: the sign of sin(θ2 − δ)."""
        return np.where(np.sin(q[..., 1] - self.delta) > 0.0, 1, -1)

    @cached_property
    def home_roll(self) -> float:
        """ψ_h: ω3 = e^{ω̂1 ψ_h} e^{t̂ φ_h} ω1, in (−90°, 90°]."""
        along_t, along_n = self.omega3 @ self.tilt_axis, self.omega3 @ self.frame[:, 2]
        return math.atan2(self.side * along_t, -self.side * along_n) + 0.0

    @cached_property
    def home_tilt(self) -> float:
        """φ_h: signed angle from ω1 to ω3 about the tilt axis rolled by ψ_h."""
        return self.side * _angle(self.omega1, self.omega3)

    @cached_property
    def exponentials(self) -> Array:
        """E with e^{ω̂_i θ_i} = E[i, 0] + cos θ_i E[i, 1] + sin θ_i E[i, 2], (3, 3, 3, 3)."""
        terms = [exponential_terms(axis) for axis in (self.omega1, self.omega2, self.omega3)]
        return frozen(terms, (3, 3, 3, 3))

    @cached_property
    def orientation_terms(self) -> Array:
        """R, row by row, as a constant times the products of (1, cos θ_i, sin θ_i) of joints 1, 2, 3; (27, 9)."""
        one, two, three = self.exponentials
        terms = np.einsum("aij,bjk,ckl,lm->abcim", one, two, three, self.tool_home)
        return frozen(terms, (27, 9))

    @cached_property
    def tool_on_omega1(self) -> Array:
        """e^{−t̂ φ_h} e^{−ω̂1 ψ_h} R_0: the tool, without spin, pointing along ω1; (3, 3)."""
        back = rotation(self.tilt_axis, -self.home_tilt) @ rotation(self.omega1, -self.home_roll)
        return frozen(back @ self.tool_home, (3, 3))

    @cached_property
    def tool_angle(self) -> float:
        """ρ: angle about the tool axis from the side of ω2 that faces ω1, at θ2 = δ, to the tool's x axis."""
        toward_omega1 = math.sin(self.alpha) * self.omega1 - math.cos(self.alpha) * self.tilt_axis
        pointing = math.cos(self.beta) * self.omega2 + math.sin(self.beta) * toward_omega1
        zero = math.cos(self.beta) * toward_omega1 - math.sin(self.beta) * self.omega2
        tool_x = rotation(self.omega2, self.delta) @ self.tool_home[:, 0]
        return math.atan2(float(tool_x @ np.cross(pointing, zero)), float(tool_x @ zero))

    @cached_property
    def spin_offset(self) -> float:
        """The constant of spin = θ3 − η + constant (above), such that spin is 0 at home."""
        on_omega1 = self.frame.T @ self.tool_on_omega1[:, 0]
        kappa = math.atan2(float(on_omega1[2]), float(on_omega1[1]))
        half = -self.delta / 2.0
        eta = float(azimuths(NUMPY, self.alpha, self.beta, math.cos(half), math.sin(half))[1])
        return eta + math.remainder(
            self.side * math.pi / 2.0 + self.tool_angle - kappa - eta, 2.0 * math.pi
        )


def check_angles(alpha: float, beta: float) -> None:
    """Refuse angles between axes outside [0, π]. Raises GeometryError."""
    for name, angle in (("alpha", alpha), ("beta", beta)):
        if not 0.0 <= angle <= math.pi:
            raise GeometryError(
                f"{name} = {angle!r}: an angle between axes, in [0, pi] rad; degrees are not meant"
            )


@lru_cache(maxsize=32)
def _of_axes(*axes: bytes, tool_home: bytes, insertion_sign: int) -> Mechanism:
    """One object for all equal geometries, for what is kept with it; axes, tool_home: as bytes, for −0 is not 0."""
    vectors = map(np.frombuffer, axes)
    omega1, omega2, omega3 = (axis / np.linalg.norm(axis) for axis in vectors)
    home = _tool_home(np.frombuffer(tool_home).reshape(3, 3), omega3)
    normal = np.cross(omega1, omega2)
    normal = normal / np.linalg.norm(normal)
    tilt_axis = np.cross(normal, omega1)
    side = _side(float(omega3 @ tilt_axis), float(omega3 @ normal))
    tilt_axis = tilt_axis / np.linalg.norm(tilt_axis)
    return Mechanism(
        omega1, omega2, omega3, home, tilt_axis=tilt_axis, side=side, insertion_sign=insertion_sign
    )


def _tool_home(value: ArrayLike, omega3: Array) -> Array:
    """R_0 with its z column set to omega3 to the last digit."""
    matrix = rotation_matrices("tool_home", value)[0]
    if np.linalg.norm(matrix[:, 2] - omega3) > 1e-6:
        raise GeometryError(
            f"tool_home: its z column {matrix[:, 2].tolist()} must be omega3 = {omega3.tolist()} (the tool's axis)"
        )
    x = matrix[:, 0] - omega3 * (omega3 @ matrix[:, 0])
    x = x / np.linalg.norm(x)
    return np.column_stack((x, np.cross(omega3, x), omega3))


def _angle(a: Array, b: Array) -> float:
    """Angle between unit vectors, accurate near 0 and π."""
    return 2.0 * math.atan2(float(np.linalg.norm(a - b)), float(np.linalg.norm(a + b)))


def _side(along_t: float, along_n: float) -> int:
    """Sign of the tilt φ with sin φ (sin ψ, −cos ψ) along (t, n) and a roll ψ in (−90°, 90°]."""
    if abs(along_n) > PARALLEL:
        return -1 if along_n > 0.0 else 1
    return 1 if along_t > PARALLEL else -1


def _omega3(alpha: float, beta: float, tilt: float) -> Array:
    """The tool axis of a tilt at a roll in [−90°, 90°], for ω1 = x and t = y: e^{ω̂2 θ2} ω3 above."""
    half = abs(tilt) / 2.0
    cosine2, sine2 = elbow_squares(NUMPY, alpha, beta, math.cos(half), math.sin(half))
    x = math.copysign(
        2.0 * math.atan2(math.sqrt(max(sine2, 0.0)), math.sqrt(max(cosine2, 0.0))), tilt
    )
    on_omega1 = math.cos(alpha) * math.cos(beta) + math.sin(alpha) * math.sin(beta) * math.cos(x)
    on_t = math.sin(alpha) * math.cos(beta) - math.cos(alpha) * math.sin(beta) * math.cos(x)
    return np.array([on_omega1, on_t, -math.sin(beta) * math.sin(x)])


def tilt_magnitude(xp: Namespace, alpha: Any, beta: Any, x: Any) -> Any:
    """|φ| of x = θ2 − δ, in [0, π] (paper, eq. 4), to full accuracy at both ends."""
    c, s = xp.cos(x / 2.0), xp.sin(x / 2.0)
    less, more = (alpha - beta) / 2.0, (alpha + beta) / 2.0
    sine2 = xp.sin(less) ** 2 * (c * c) + xp.sin(more) ** 2 * (s * s)
    cosine2 = xp.cos(less) ** 2 * (c * c) + xp.cos(more) ** 2 * (s * s)
    return 2.0 * xp.arctan2(xp.sqrt(sine2), xp.sqrt(cosine2))


def elbow_squares(xp: Namespace, alpha: Any, beta: Any, cosine: Any, sine: Any) -> tuple[Any, Any]:
    """(C², S²), proportional to cos²(x/2) and sin²(x/2), of the cosine and sine of φ/2.

    C² = sin((α + β + φ)/2) sin((α + β − φ)/2) and S² = sin((φ + α − β)/2) sin((φ − α + β)/2): each vanishes at its end
    of the workspace and is negative beyond it. Their sum is sin α sin β times the scale of (cosine, sine) squared.
    """
    less, more = (alpha - beta) / 2.0, (alpha + beta) / 2.0
    far_a, far_b = xp.sin(more) * cosine, xp.cos(more) * sine
    near_a, near_b = xp.cos(less) * sine, xp.sin(less) * cosine
    return (far_a + far_b) * (far_a - far_b), (near_a + near_b) * (near_a - near_b)


def azimuths(xp: Namespace, alpha: Any, beta: Any, c: Any, s: Any) -> tuple[Any, Any]:
    """(ζ, η) of c and s, which may carry a common positive factor; continuous on a branch."""
    minus, plus = xp.sin(alpha - beta) * (c * c), xp.sin(alpha + beta) * (s * s)
    cross = -2.0 * (s * c)
    zeta = xp.arctan2(xp.sin(beta) * cross, minus + plus)
    eta = xp.arctan2(xp.sin(alpha) * cross, minus - plus)
    return zeta, eta
