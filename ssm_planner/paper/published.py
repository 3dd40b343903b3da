"""Define the published figures of paper and software package in SI units, and read the inputs.

The drive files contain the published parameters of the rigs.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from pathlib import Path

from ssm_planner.errors import ProblemError
from ssm_planner.loading import load_drive, load_motorisation, load_problem
from ssm_planner.problem import Drive, Eye, Motorisation, Problem, Robot, Task
from ssm_planner.typing import Range, frozen, record

DRIVEN = ("roll", "tilt", "insertion")
"""Joints 1, 2 and 4, which have a drive."""
NUMBER = {"roll": 1, "tilt": 2, "spin": 3, "insertion": 4}
"""Number of each joint in the paper."""

ALPHA = math.radians(30.0)
BETA = math.radians(110.0)
"""Angle β of §IV-B. It is about 110° and follows from the first position of the tool."""
FIRST_TILT = math.radians(-113.0)
"""First signed tilt (§IV-B). The tool is 23° beyond the normal of the plane of ω1 and ω2."""
REQUIRED_TILT = math.radians(50.0)
"""Required range of the tilt (§IV-A)."""
REQUIRED_ROLL = math.radians(60.0)
REQUIRED_SPIN = math.radians(360.0)
REQUIRED_TRAVEL = 0.030
TILT_AGREEMENT = 0.985
"""Agreement of measured and theoretical tilt range (§V-A)."""
TABLE_I_MEASURED = (math.radians(-138.6), math.radians(-79.5))
"""Tilt range measured on the prototype (paper, Table I)."""
TABLE_I = (math.radians(-140.0), math.radians(-80.0))
"""Theoretical tilt range as the paper prints it, with β rounded to 110°."""

ROTARY_SPEED = math.radians(65.0)
ROTARY_ACCELERATION = math.radians(200.0)
"""Approximate joint acceleration (§IV-C)."""
LINEAR_SPEED = 0.020
LINEAR_ACCELERATION = 0.100


@frozen
class FrictionRow:
    """Friction of one joint.

    The row contains the coefficients of the mesh, the Coulomb torque of the bearings in N·m, and
    their viscous coefficient in N·m·s/rad.
    """

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
"""Friction in the package's simulation of the arm (sd_ssm.m), used for the choice of motors."""


@frozen
class SpeedRow:
    """One row of Table III: printed speeds in rad/s and m/s, and NRMSD by joint."""

    tilt: float
    insertion: float
    nrmsd: Mapping[str, float]

    @property
    def label(self) -> str:
        """Both speeds as text."""
        return f"{math.degrees(self.tilt):.0f}°/s, {1e3 * self.insertion:.0f} mm/s"


def _row(tilt: float, insertion: float, *nrmsd: float) -> SpeedRow:
    """Return a row with a tilt speed in °/s, an insertion speed in mm/s, and NRMSDs by joint."""
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


@record
class Inputs:
    """Inputs of the document: problem of Table III, eye, motorisation runs and rigs by name."""

    folder: Path
    problem: Problem
    eye: Eye
    motorisations: dict[str, Motorisation]
    rigs: dict[str, Drive]
    recordings: Path

    @property
    def robot(self) -> Robot:
        """Robot of the problem."""
        return self.problem.robot


def read_inputs(problems: Path, recordings: Path) -> Inputs:
    """Read the shipped files below the folder `problems`. Raises ProblemError if a file is invalid.

    The folder `recordings` may be missing.
    """
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
        eye,
        motorisations={
            name: load_motorisation(problems / "motorisation" / f"{name}.yaml") for name in names
        },
        rigs={name: load_drive(problems / "drives" / f"{name}.yaml") for name in RIGS},
        recordings=recordings,
    )


def _check(problem: Problem) -> None:
    """Raise ProblemError if the problem lacks data that Tables II and III need.

    These are drives of joints 1, 2 and 4, a tilt range, and a start in task coordinates.
    """
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


BOUNDS: dict[str, dict[str, Range]] = {name: {} for name in RIGS}
"""Lower and upper bound in SI units, by rig and parameter (sd_1dof.m of the package)."""
with Path(__file__).with_name("bounds.csv").open(encoding="utf-8") as _table:
    for _rig, _parameter, *_ends in list(csv.reader(_table))[1:]:
        BOUNDS[_rig][_parameter] = float(_ends[0]), float(_ends[1])
