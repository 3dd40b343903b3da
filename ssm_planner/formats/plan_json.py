"""plan.json: the whole plan in one self-contained, versioned file."""

from __future__ import annotations

import hashlib
import json
import platform
from dataclasses import dataclass
from functools import cached_property
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from ssm_planner.atomic import replacing
from ssm_planner.errors import TrajectoryError
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.problem.serialization import plain, robot_from_plain, task_limits_from_plain
from ssm_planner.sizing.size import size_motion
from ssm_planner.trajectory import Trajectory
from ssm_planner.verification.certificate import Certificate

if TYPE_CHECKING:
    from ssm_planner.plans import Plan


FORMAT = "ssm_planner plan"
VERSION = 1
UNITS = {
    "time": "s",
    "q": ["rad", "rad", "rad", "m"],
    "coefficients": "q(t) = sum_k coefficients[piece][k][joint] * (t - breaks_s[piece])^k, in rad/s^k and m/s^k",
    "torque": "N*m on the motor side",
    "motor speed": "rad/s",
    "everything else": "SI, radians",
}


@dataclass(frozen=True, eq=False)
class PlanFile:
    """What later stages need of a plan, as read from plan.json: everything but the way it was found."""

    robot: Robot
    limits: TaskLimits
    trajectory: Trajectory
    certificate: Certificate | None
    document: dict[str, Any]
    """The whole file."""
    path: Path
    sha256: str
    """Of the file's bytes."""

    @cached_property
    def sizing(self) -> dict[str, Any]:
        """The object that `size --json` prints: as stated, or of a plan that states nothing of it found anew."""
        stated = self.document.get("sizing")
        return stated if isinstance(stated, dict) else size_motion(self.trajectory, self.robot).to_dict()


def read_plan(path: str | Path) -> PlanFile:
    """Read plan.json. Raises TrajectoryError (not a plan of a known version, or no trajectory in it) or ProblemError."""
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise TrajectoryError(f"{path}: cannot be read: {error.strerror or error}") from error
    return plan_from_bytes(data, path)


def plan_from_bytes(data: bytes, path: Path) -> PlanFile:
    """The plan in the content of a plan.json; path is named in messages. Raises as read_plan."""
    document = _document(data, path)
    problem = _mapping(document, "problem", path)
    robot = robot_from_plain(_mapping(problem, "robot", path), file=str(path))
    limits = task_limits_from_plain(problem, file=str(path))
    if document.get("trajectory") is None:
        raise TrajectoryError(f"{path}: this plan holds no trajectory (status: {document.get('status')})")
    try:
        trajectory = Trajectory.from_dict(_mapping(document, "trajectory", path))
        stated = document.get("certificate")
        certificate = None if stated is None else Certificate.from_dict(stated)
    except TrajectoryError as error:
        raise TrajectoryError(f"{path}: {error}") from error
    sha256 = hashlib.sha256(data).hexdigest()
    return PlanFile(robot, limits, trajectory, certificate, document, path, sha256)


def _document(data: bytes, path: Path) -> dict[str, Any]:
    def refuse(constant: str) -> NoReturn:
        raise TrajectoryError(f"{path}: holds {constant}; a plan holds only finite numbers")

    try:
        document = json.loads(data.decode("utf-8"), parse_constant=refuse)
    except UnicodeDecodeError as error:
        raise TrajectoryError(f"{path}: not a text file: not a plan.json") from error
    except json.JSONDecodeError as error:
        cut = error.pos >= len(data.decode("utf-8").rstrip())
        what = "ends in the middle: truncated" if cut and data.strip() else "not JSON"
        raise TrajectoryError(f"{path}:{error.lineno}: {what} ({error.msg})") from error
    except RecursionError as error:
        raise TrajectoryError(f"{path}: nested too deeply for a plan.json") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise TrajectoryError(f"{path}: not a plan.json (its format key is not {FORMAT!r})")
    if document.get("version") != VERSION:
        raise TrajectoryError(
            f"{path}: plan.json of version {document.get('version')!r}; this program reads version {VERSION}"
        )
    return document


def _mapping(data: dict[str, Any], key: str, path: Path) -> dict[str, Any]:
    value = data.get(key)
    if not isinstance(value, dict):
        raise TrajectoryError(f"{path}: {key} is missing or is no mapping: not a whole plan.json")
    return value


def plan_document(plan: Plan) -> dict[str, Any]:
    """What plan.json holds; every value SI, angles in radians."""
    trajectory = plan.trajectory
    return {
        "format": FORMAT,
        "version": VERSION,
        "units": UNITS,
        "software": software(),
        **plan.summary(),
        "problem": plain(plan.problem),
        "phases": [
            {
                "name": phase.phase.motion.name,
                "duration": phase.duration,
                "toppra_duration": phase.toppra_duration,
                "lower_bound": phase.lower_bound,
                "task_start": phase.phase.start.tolist(),
                "task_end": phase.phase.end.tolist(),
                "branch": phase.phase.branch,
                "iterations": phase.iterations,
            }
            for phase in plan.phases
        ],
        "certificate": None if plan.certificate is None else plan.certificate.to_dict(),
        "trajectory": None if trajectory is None else trajectory.to_dict(),
    }


def write_plan(path: Path, plan: Plan) -> Path:
    """Write plan.json. Raises ExportError."""
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(plan_document(plan), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return path


def software() -> dict[str, str]:
    """Versions of what made the plan."""
    names = ("ssm-planner", "casadi", "numpy", "scipy", "toppra")
    versions = {"python": platform.python_version()}
    for name in names:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "unknown"
    return versions
