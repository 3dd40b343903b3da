"""The spherical triangle ω1, ω2, tool: sides α, β, |φ|; the angle at ω2 is |x|, x = θ2 − δ.

What inverse kinematics and task coordinates share, written once for NumPy arrays and CasADi expressions. All are
half-angle forms: no difference of nearly equal numbers, no acos.

With c = cos(x/2) and s = sin(x/2):
    cos φ = cos(α − β) c² + cos(α + β) s²,     the paper's f(θ2), eq. 4
    e^{ω̂2 θ2} ω3 = cos φ ω1 + P t + Q n,        P = sin(α − β) c² + sin(α + β) s²,   Q = −2 sin β s c
Seen from the tool, ω1 lies at the angle η = atan2(F, E) about the tool axis, counted from its place at θ2 = δ:
    E = sin(α − β) c² − sin(α + β) s²,   F = −2 sin α s c
so roll = θ1 + ζ ± 90° with ζ = atan2(Q, P), and spin = θ3 − η + constant: tilt depends on θ2 alone, roll and spin
are θ1 and θ3 plus functions of θ2.
"""

from __future__ import annotations

from typing import Any

from ssm_planner.codegen.namespace import Namespace


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
