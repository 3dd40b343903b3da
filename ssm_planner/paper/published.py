"""What the document starts from: figures that the paper and its software package print (SI), and the project's files.

The published parameters of the rigs are in their drive files.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ssm_planner.errors import ProblemError
from ssm_planner.loading.load import load_drive, load_motorisation, load_problem
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.motion import Motorisation, Task
from ssm_planner.problem.problem import Eye, Problem
from ssm_planner.problem.robot import Robot

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
TILT_AGREEMENT = 0.985
"""§V-A."""
TABLE_I_MEASURED = (math.radians(-138.6), math.radians(-79.5))
"""The tilt interval measured on the prototype (paper, Table I)."""
TABLE_I = (math.radians(-140.0), math.radians(-80.0))
"""The theoretical interval as the paper prints it, with β rounded to 110°."""

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


@dataclass(frozen=True, eq=False)
class Inputs:
    """Problem of Table III's motions with its robot, the eye, motorisation runs by name, rigs by name."""

    folder: Path
    problem: Problem
    eye: Eye
    motorisations: dict[str, Motorisation]
    rigs: dict[str, Drive]
    recordings: Path

    @property
    def robot(self) -> Robot:
        return self.problem.robot


def read_inputs(problems: Path, recordings: Path) -> Inputs:
    """The shipped files below `problems`; `recordings` need not exist. Raises ProblemError."""
    if not problems.is_dir():
        raise ProblemError(
            "no such folder: the document is computed from the project's problem files",
            key="--problems",
            value=str(problems),
            allowed="the project's folder problems/",
        )
    names = ("paper", "package")
    problem = load_problem(problems / "tilt_insert.yaml")
    _check(problem)
    eye = load_problem(problems / "eye_approach.yaml").eye
    if eye is None:
        raise ProblemError(
            "missing: the eye of §IV-A", file=problems / "eye_approach.yaml", key="eye"
        )
    return Inputs(
        problems,
        problem,
        eye=eye,
        motorisations={
            name: load_motorisation(problems / "motorisation" / f"{name}.yaml") for name in names
        },
        rigs={name: load_drive(problems / "drives" / f"{name}.yaml") for name in RIGS},
        recordings=recordings,
    )


def _check(problem: Problem) -> None:
    """The tables speak of the paper's robot: joints 1, 2 and 4 driven, a tilt range declared."""
    robot = problem.robot
    for joint in robot.joints:
        if joint.name in DRIVEN and joint.drive is None:
            raise ProblemError(
                "missing: Tables II and III need its friction",
                file=robot.file,
                key=f"joints.{joint.name}.drive",
            )
    if "tilt" not in robot.ranges:
        raise ProblemError(
            "missing: the range in which the arm works", file=robot.file, key="limits.tilt"
        )
    if not isinstance(problem.start, Task):
        raise ProblemError(
            "Table III's motion starts from task coordinates", file=problem.file, key="start"
        )


_COMMON = {
    "b_v": (1e-5, 1e-3),
    "b_ov": (0.0, 1e-5),
    "preload": (0.0, 0.0),
    "dwell_constant": (0.0, 0.0),
    "memory": (0.0, 0.0),
}

BOUNDS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "rig1_lead_screw": {
        **_COMMON,
        "b_c": (1e-3, 1e-2),
        "b_oc": (1e-3, 5e-2),
        "mu": (0.20, 0.21),
        "mu_stribeck": (0.0, 0.08),
        "stribeck_speed": (0.0, 15.0),
    },
    "rig2_antibacklash_screw": {
        **_COMMON,
        "preload": (0.5, 1.5),
        "b_c": (1e-5, 1e-2),
        "b_oc": (1e-5, 5e-2),
        "mu": (0.15, 0.27),
        "mu_stribeck": (0.0, 0.2),
        "stribeck_speed": (0.0, 15.0),
    },
    "rig3_worm": {
        **_COMMON,
        "b_c": (1e-4, 1e-3),
        "b_oc": (1e-5, 1e-2),
        "mu": (0.12, 0.16),
        "mu_stribeck": (0.0, 0.1),
        "stribeck_speed": (0.0, 1.0),
        "memory": (0.0, 0.25),
    },
}
"""Lower and upper bound by rig and parameter, SI (sd_1dof.m of the package)."""
