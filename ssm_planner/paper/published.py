"""What the paper and its software package print, SI and radians: the one place where published figures stand.

Tilt ranges (Table I) are in report/workspace_table.py; the parameters of the rigs are in their drive files.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

DRIVEN = ("roll", "tilt", "insertion")
"""Joints 1, 2 and 4, which have a drive."""
NUMBER = {"roll": 1, "tilt": 2, "spin": 3, "insertion": 4}
"""Number of each joint in the paper."""

ALPHA, BETA = math.radians(30.0), math.radians(110.0)
"""§IV-B; β ≈ 110°, from the tool's first position."""
FIRST_TILT = math.radians(-113.0)
"""§IV-B: the tool 23° beyond the perpendicular to the plane of ω1 and ω2, as a signed tilt."""
REQUIRED_TILT = math.radians(50.0)
"""§IV-A."""
REQUIRED_ROLL = math.radians(60.0)
REQUIRED_SPIN = math.radians(360.0)
REQUIRED_TRAVEL = 0.030
SEPARATION = 0.100
"""§IV-B: gap between the tool tip and the actuated parts, m, about."""
TILT_AGREEMENT = 0.985
"""§V-A."""

ROTARY_SPEED, ROTARY_ACCELERATION = math.radians(65.0), math.radians(200.0)
"""§IV-C, about."""
LINEAR_SPEED, LINEAR_ACCELERATION = 0.020, 0.100


@dataclass(frozen=True)
class FrictionRow:
    """Friction of one joint: mesh coefficients, bearing Coulomb torque N·m, bearing viscous coefficient N·m·s/rad."""

    mu: float
    mu_static: float
    b_c: float
    b_v: float


TABLE_II: Mapping[str, FrictionRow] = {
    "roll": FrictionRow(0.13, 0.15, 3.82e-3, 7.18e-5),
    "tilt": FrictionRow(0.12, 0.13, 3.54e-3, 3.69e-5),
    "insertion": FrictionRow(0.17, 0.17, 0.11e-3, 0.62e-5),
}
"""Identified on the prototype (paper, Table II)."""

PACKAGE_FRICTION: Mapping[str, FrictionRow] = {
    "roll": FrictionRow(0.12, 0.12, 5.5e-4, 1.15e-5),
    "tilt": FrictionRow(0.12, 0.12, 5.5e-4, 1.15e-5),
    "insertion": FrictionRow(0.14, 0.14, 5.5e-4, 3.5e-6),
}
"""With which the package simulates the arm (sd_ssm.m), no Stribeck term: what the motors were chosen with."""


@dataclass(frozen=True)
class SpeedRow:
    """One row of Table III: speeds as printed, rad/s and m/s, and NRMSD by joint."""

    tilt: float
    insertion: float
    nrmsd: Mapping[str, float]

    @property
    def label(self) -> str:
        return f"{math.degrees(self.tilt):.0f}°/s, {1e3 * self.insertion:.0f} mm/s"


def _row(tilt: float, insertion: float, *nrmsd: float) -> SpeedRow:
    return SpeedRow(math.radians(tilt), 1e-3 * insertion, dict(zip(DRIVEN, nrmsd, strict=True)))


TABLE_III = (
    _row(10, 10, 0.08, 0.12, 0.12),
    _row(20, 20, 0.11, 0.10, 0.13),
    _row(40, 40, 0.11, 0.11, 0.09),
    _row(80, 40, 0.09, 0.12, 0.10),
)

RIGS: Mapping[str, str] = {
    "rig1_lead_screw": "drive1_lead_screw",
    "rig2_antibacklash_screw": "drive2_antibacklash_screw",
    "rig3_worm": "drive3_worm",
}
"""Folder of each rig's recordings by the name of its drive file."""
