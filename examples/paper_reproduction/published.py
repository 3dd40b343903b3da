"""Define the numbers that the paper and its software package publish, in SI units.

The module also reads the problem files of the project. The drive files contain the published
parameters of the test rigs.
"""

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
"""Angle α between the axes of joints 1 and 2 (§IV-B)."""
BETA = math.radians(110.0)
"""Angle β between the axes of joints 2 and 3 (§IV-B).

It is about 110° and follows from the first position of the tool.
"""
FIRST_TILT = math.radians(-113.0)
"""First signed tilt (§IV-B). The tool is 23° beyond the normal of the plane of ω1 and ω2."""
REQUIRED_TILT = math.radians(50.0)
"""Required range of the tilt (§IV-A)."""
REQUIRED_ROLL = math.radians(60.0)
"""Required range of the roll (§IV-A)."""
REQUIRED_SPIN = math.radians(360.0)
"""Required range of the spin (§IV-A)."""
REQUIRED_TRAVEL = 0.030
"""Required travel of the insertion, m (§IV-A)."""
TILT_AGREEMENT = 0.985
"""Agreement of measured and theoretical tilt range (§V-A)."""
TABLE_I_MEASURED = (math.radians(-138.6), math.radians(-79.5))
"""Tilt range measured on the prototype (paper, Table I)."""
TABLE_I = (math.radians(-140.0), math.radians(-80.0))
"""Theoretical tilt range as the paper prints it, with β rounded to 110°."""

ROTARY_SPEED = math.radians(65.0)
"""Required speed of the rotary joints, rad/s."""
ROTARY_ACCELERATION = math.radians(200.0)
"""Approximate acceleration of the rotary joints, rad/s² (§IV-C)."""
LINEAR_SPEED = 0.020
"""Required speed of joint 4, m/s."""
LINEAR_ACCELERATION = 0.100
"""Approximate acceleration of joint 4, m/s²."""


@frozen
class FrictionRow:
    """Friction of one joint, as a row of a published table."""

    mu: float
    """Sliding friction coefficient of the gear mesh."""
    mu_static: float
    """Static friction coefficient of the gear mesh."""
    b_c: float
    """Coulomb torque of the bearings, N·m."""
    b_v: float
    """Viscous coefficient of the bearings, N·m·s/rad."""


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
    """Row of Table III: printed joint speeds, and errors of the predicted torque."""

    tilt: float
    """Speed of the rotary joints, rad/s."""
    insertion: float
    """Speed of joint 4, m/s."""
    nrmsd: Mapping[str, float]
    """Relative error (NRMSD) of the torque by joint."""

    @property
    def label(self) -> str:
        """Both speeds as text, in °/s and mm/s."""
        return f"{math.degrees(self.tilt):.0f}°/s, {1e3 * self.insertion:.0f} mm/s"


def _row(tilt: float, insertion: float, *nrmsd: float) -> SpeedRow:
    """Build a row of Table III from speeds in °/s and mm/s, and an NRMSD for each driven joint."""
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
