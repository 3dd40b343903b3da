"""Plan: the outcome of planning, as every later stage takes it, to and from plan.json."""

from __future__ import annotations

import hashlib
import json
import math
import platform
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from functools import cache, cached_property
from importlib import metadata
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from ssm_planner.atomic import locked, replacing
from ssm_planner.errors import ExportError, ProblemError, TrajectoryError
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.loading.json_files import parse_json, read_json_in_parts
from ssm_planner.problem.limit import in_words
from ssm_planner.problem.limits import Limit, TaskRange
from ssm_planner.problem.motion import Free, Joints
from ssm_planner.problem.problem import Problem, TaskLimits
from ssm_planner.problem.robot import JOINTS, Robot
from ssm_planner.problem.serialization import plain, problem_from_plain
from ssm_planner.problem.value import built
from ssm_planner.publishing import check_generation, file_name
from ssm_planner.sizing.duty import pause_of
from ssm_planner.sizing.requirements import MotorRequirement
from ssm_planner.sizing.size import Sizing, size_motion
from ssm_planner.stopping import Stops, controlled_stops
from ssm_planner.trajectory import Trajectory
from ssm_planner.verification.certificate import Certificate, broken_seal

if TYPE_CHECKING:  # the check reads plans, and never loads the planner
    from ssm_planner.planning.reason import Reason

FORMAT = "ssm_planner plan"
VERSION = 1
FILE = "plan.json"
LARGEST_FILE = 2_000_000_000
"""Bytes."""
UNITS = {
    "time": "s",
    "q": ["rad", "rad", "rad", "m"],
    "coefficients": "q(t) = sum_k coefficients[piece][k][joint] * (t - breaks_s[piece])^k, in rad/s^k and m/s^k",
    "torque": "N*m on the motor side",
    "motor speed": "rad/s",
    "everything else": "SI, radians",
}


def software() -> dict[str, str]:
    """Versions of what makes a plan, by name."""
    versions = {"python": platform.python_version()}
    return versions | {name: _version(name) for name in ("ssm-planner", "casadi", "numpy", "scipy")}


@cache
def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "unknown"


@dataclass(frozen=True)
class PhaseSummary:
    """One phase of a plan: what it moves, how long it takes, and what it is measured against; s, rad, m."""

    name: str
    duration: float
    toppra_duration: float | None
    """TOPP-RA's for the same path and limits; None where it finds none, or where a duration was asked for."""
    lower_bound: float
    """A duration that no motion within the same limits can beat."""
    task_start: tuple[float, ...]
    """Roll, tilt, spin, depth."""
    task_end: tuple[float, ...]
    branch: int | None
    """Of the inverse kinematics, ±1; None for a phase without a path of its own."""
    iterations: int
    """Of the solvers."""
    solver: str = "Ipopt"
    """That found the motion: "Ipopt", "structured" (which Ipopt confirms, or `fast`), "TOPP-RA"; "" where the arm stands."""
    confirmation_iterations: int | None = None
    """In which Ipopt confirmed what the structured solver found; None where either solved alone."""
    confirmation_difference: float | None = None
    """Ipopt's duration of the fastest motion over the structured solver's, less 1; the shorter motion is taken."""
    corner_departure: float | None = None
    """Of a phase with rounded corners: largest distance of the tip from the lines between these, m."""
    corner_reach: float | None = None
    """Largest distance from a corner at which the tip is off these lines, m."""
    constant_speed: float | None = None
    """That the tip keeps but for ramps at both ends, m/s."""
    constant_from: float | None = None
    constant_to: float | None = None
    """Ends of that stretch, s from the start of the phase."""
    constant_error: float | None = None
    """Largest share by which the speed is off between them."""

    def to_dict(self) -> dict[str, Any]:
        """JSON types; what only some phases have is left out of the others."""
        found: dict[str, Any] = plain(asdict(self))
        return {
            name: value for name, value in found.items() if value is not None or name not in OF_SOME
        }

    @property
    def disagreement(self) -> str | None:
        """Why the cross-check by TOPP-RA failed; None where it passed or there is none."""
        if not self.toppra_duration:
            return None
        allowed = AGREES_FREE if self.branch is None else AGREES_STRAIGHT
        ratio = self.duration / self.toppra_duration
        if 1 / (1 + allowed) <= ratio <= 1 + allowed:
            return None
        what = (
            "the motion is slower than it need be"
            if ratio > 1
            else "TOPP-RA's grid is too coarse, or a limit is missed"
        )
        return (
            f"{self.name}: {self.duration:.4f} s, and {self.toppra_duration:.4f} s by TOPP-RA along the same path "
            f"({100 * (ratio - 1):+.2f} %, {100 * allowed:g} % are allowed): {what}"
        )


OF_SOME = (
    "corner_departure",
    "corner_reach",
    "constant_speed",
    "constant_from",
    "constant_to",
    "constant_error",
)
"""Fields of phases with rounded corners, or at constant speed."""
AGREES_STRAIGHT, AGREES_FREE = 3e-3, 1e-2
"""Share by which a phase's duration may differ from TOPP-RA's along its path, straight and free (docs/planning.md)."""


@dataclass(frozen=True, eq=False)
class Plan:
    """A planned motion with its certificate, or the reason why there is none; SI units, radians.

    What is not stored follows from the trajectory, the robot and the certificate, and is computed when it is first asked for.
    """

    problem: Problem
    status: str
    """"solved", "infeasible" or "not converged"."""
    trajectory: Trajectory | None
    """None unless solved."""
    phases: tuple[PhaseSummary, ...] = ()
    certificate: Certificate | None = None
    """Of the independent check; None unless solved, or where it is not that of this trajectory, robot and limits."""
    reason: Reason | None = None
    """Why there is no certified motion."""
    nominal_duration: float | None = None
    """Of the plan for friction as stated and an empty tip, s, where this one holds for a range of them."""
    solve_time: float | None = None
    """s; not stored: None for a plan that was loaded."""
    stopped: bool = False
    """The search for something faster was ended by the user."""
    software: Mapping[str, str] = field(default_factory=software)
    """Versions of what made the plan."""
    file: Path | None = field(default=None, init=False)
    """plan.json that it was loaded from; None for a plan that was made or changed in Python."""
    file_sha256: str | None = field(default=None, init=False)
    """Of the bytes of that file."""
    doubt: str | None = field(default=None, init=False)
    """Why a certificate that was given is not shown; see verification/certificate.py."""

    def __post_init__(self) -> None:
        if self.certificate is None or self.trajectory is None:
            object.__setattr__(self, "certificate", None)
            return
        doubt = broken_seal(self.certificate, self.trajectory, self.robot, self.limits)
        if doubt is not None:
            object.__setattr__(self, "doubt", doubt)
            object.__setattr__(self, "certificate", None)

    @property
    def robot(self) -> Robot:
        """The problem's robot."""
        return self.problem.robot

    @property
    def limits(self) -> TaskLimits:
        """The problem's limits of the task."""
        return self.problem.task_limits

    @property
    def motion(self) -> Trajectory:
        """The trajectory of a plan that must have one. Raises TrajectoryError where there is none."""
        if self.trajectory is None:
            where = self.problem.name if self.file is None else self.file
            raise TrajectoryError(f"{where}: this plan holds no trajectory (status: {self.status})")
        return self.trajectory

    @property
    def passed(self) -> bool:
        """The plan exists and the independent check found every limit kept."""
        return self.certificate is not None and self.certificate.passed

    @property
    def duration(self) -> float | None:
        """s; None without a trajectory."""
        return None if self.trajectory is None else self.trajectory.duration

    @property
    def toppra_duration(self) -> float | None:
        """TOPP-RA's for the same paths and limits, s; None unless known for every phase."""
        durations = [phase.toppra_duration for phase in self.phases]
        known = [duration for duration in durations if duration is not None]
        whole = self.trajectory is not None and 0 < len(known) == len(durations)
        return float(sum(known)) if whole else None

    @property
    def confirmation(self) -> tuple[int, float] | None:
        """Ipopt's iterations in the phases in which it confirmed the structured solver, and the largest difference."""
        found = [
            (phase.confirmation_iterations or 0, phase.confirmation_difference)
            for phase in self.phases
            if phase.confirmation_difference is not None
        ]
        if not found:
            return None
        return sum(iterations for iterations, _ in found), max(
            (difference for _, difference in found), key=abs
        )

    @property
    def lower_bound(self) -> float | None:
        """A duration that no motion along the same path within the same limits can beat, s."""
        whole = self.trajectory is not None and self.phases
        return float(sum(phase.lower_bound for phase in self.phases)) if whole else None

    @property
    def gap(self) -> float | None:
        """(duration − lower bound) / lower bound."""
        if self.duration is None or not self.lower_bound:
            return None
        return (self.duration - self.lower_bound) / self.lower_bound

    @cached_property
    def sizing(self) -> Sizing | None:
        """The robot's own motors and gears judged by the motion at 25 °C, repeated as the problem's duty says."""
        return (
            None
            if self.trajectory is None
            else size_motion(self.trajectory, self.robot, pause_of(self.problem))
        )

    @cached_property
    def stops(self) -> Stops | None:
        """The quickest controlled stop from a thousand instants; None for a plan that did not pass its check."""
        return controlled_stops(self.motion, self.robot, self.limits) if self.passed else None

    @property
    def requirements(self) -> tuple[MotorRequirement, ...]:
        """What the motion requires of the motor of every driven joint."""
        return (
            () if self.sizing is None else tuple(joint.requirement for joint in self.sizing.joints)
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """What the program does not know and the reader has to."""
        notes = [] if self.doubt is None else [f"not certified: {self.doubt}: plan it again"]
        for requirement in self.requirements:
            motor = requirement.motor
            if motor is None:
                notes.append(
                    f"joint {requirement.joint}: no motor given, its torque is not limited"
                )
            elif motor.placeholder:
                notes.append(
                    f"joint {requirement.joint}: motor {motor.name} has placeholder figures ({', '.join(motor.placeholders)})"
                )
            notes += _extrapolation(self.robot, requirement)
        notes += _wider_ranges(self.problem)
        stays = ", ".join(phase.name for phase in self.phases if not phase.duration)
        notes += [f"skipped, for the robot already is where they lead: {stays}"] if stays else []
        notes += _whole_turns(self.problem, self.trajectory)
        notes += (
            []
            if self.trajectory is None
            else _ways_round(self.problem, self.trajectory, self.phases)
        )
        notes += [f"cross-check failed: {text}" for text in self.disagreements]
        notes += ["the search was stopped: other joints may be faster"] if self.stopped else []
        if self.certificate is not None:
            notes += [f"not checked: {what}" for what in self.certificate.unchecked]
        return tuple(notes)

    def limits_unlike(self, robot: Robot) -> tuple[str, ...]:
        """In words: limits of joints, motors and robot that are not those of another robot."""
        of_robot = {limit.key: limit for limit in _limits_of(robot)}
        of_plan = {limit.key: limit for limit in _limits_of(self.robot)}
        notes = []
        for key in {**of_plan, **of_robot}:
            own, other = of_plan.get(key), of_robot.get(key)
            if own == other:
                continue
            what = f"{key[0]} of joint {key[1]}" if key[1] else key[0]
            shown = [
                f"{limit.low:.6g} to {limit.high:.6g} {limit.unit}" if limit else "none"
                for limit in (own, other)
            ]
            notes.append(
                f"the plan was made for another limit: {what}: {shown[0]}; the robot given has {shown[1]}"
            )
        return tuple(notes)

    @property
    def disagreements(self) -> tuple[str, ...]:
        """Of every phase whose cross-check by TOPP-RA failed; none where jerk is limited, of which TOPP-RA knows nothing."""
        if any(joint.jerk is not None for joint in self.robot.joints):
            return ()
        found = (phase.disagreement for phase in self.phases)
        return tuple(text for text in found if text is not None)

    @property
    def path(self) -> Path:
        """plan.json that it was loaded from, else where the command would write it."""
        return self.file or Path("results") / file_name(self.problem.name) / FILE

    @cached_property
    def sha256(self) -> str:
        """Of the plan.json that it was loaded from, else of what would be written; hexadecimal."""
        return self.file_sha256 or hashlib.sha256(self.to_json().encode()).hexdigest()

    def summary(self) -> dict[str, Any]:
        """The object that `plan --json` prints; SI units, radians."""
        return {
            "status": self.status,
            "duration": self.duration,
            "lower_bound": self.lower_bound,
            "gap": self.gap,
            "toppra_duration": self.toppra_duration,
            "nominal_duration": self.nominal_duration,
            "passed": self.passed,
            "solve_time": self.solve_time,
            "motors": [requirement.to_dict() for requirement in self.requirements],
            "sizing": None if self.sizing is None else self.sizing.to_dict(),
            "limits": []
            if self.certificate is None
            else [limit.to_dict() for limit in self.certificate.limits],
            "reason": None if self.reason is None else self.reason.to_dict(),
            "notes": list(self.notes),
            "phases": [phase.to_dict() for phase in self.phases],
            **({"stopped": True} if self.stopped else {}),
        }

    def to_dict(self) -> dict[str, Any]:
        """What plan.json holds: JSON types, SI units, radians. The same plan gives the same text whenever it is made."""
        summary = self.summary()
        phases = summary.pop("phases")
        return {
            "format": FORMAT,
            "version": VERSION,
            "units": UNITS,
            "software": dict(self.software),
            **summary,
            "solve_time": None,
            "problem": plain(self.problem),
            "phases": phases,
            "certificate": None if self.certificate is None else self.certificate.to_dict(),
            "stops": None if self.stops is None else self.stops.to_dict(),
            "trajectory": None if self.trajectory is None else self.trajectory.to_dict(),
        }

    @cached_property
    def document(self) -> dict[str, Any]:
        """`to_dict`, for pages."""
        return self.to_dict()

    def to_json(self) -> str:
        """The text of plan.json."""
        return json.dumps(self.document, indent=1, allow_nan=False) + "\n"

    @classmethod
    def from_json(cls, data: bytes, file: Path) -> Plan:
        """Read what `to_json` gave, or what earlier versions of this program wrote; file: named in messages.

        Raises TrajectoryError (not a plan of a known version, or no trajectory in it) or ProblemError.
        """
        return cls._of(parse_json(file, data), hashlib.sha256(data).hexdigest(), file)

    @classmethod
    def _of(cls, found: Any, sha256: str, file: Path) -> Plan:
        document = _document(found, file)
        problem = problem_from_plain(_mapping(document, "problem", file), file=str(file))
        if document.get("trajectory") is None:
            raise TrajectoryError(
                f"{file}: this plan holds no trajectory (status: {document.get('status')})"
            )
        try:
            stated = document.get("certificate")
            plan = cls(
                problem=problem,
                status=str(document.get("status")),
                trajectory=Trajectory.from_dict(_mapping(document, "trajectory", file)),
                phases=_phases(document.get("phases") or [], file),
                certificate=None if stated is None else Certificate.from_dict(stated),
                nominal_duration=_number(document.get("nominal_duration"), path=file),
                stopped=document.get("stopped") is True,
                software=document.get("software") or {},
            )
        except TrajectoryError as error:
            raise TrajectoryError(f"{file}: {error}") from error
        object.__setattr__(plan, "file", file)
        object.__setattr__(plan, "file_sha256", sha256)
        return plan

    def write(self, path: Path) -> Path:
        """Write plan.json alone. Raises ExportError."""
        with replacing(path) as temporary:
            temporary.write_text(self.to_json(), encoding="utf-8")
        return path

    def save(self, folder: str | Path) -> dict[str, Path]:
        """Write the result folder that `ssm-planner plan` writes: plan.json, report.html, trajectory.csv, figures.

        Returns the paths by name. Raises ExportError, also for a plan that did not pass its check: no unchecked motion
        leaves the program.
        """
        if not self.passed:
            raise ExportError(
                f"{self.problem.name}: the plan has no passed certificate (status: {self.status}): not written"
            )
        return _folder_writer(self, Path(folder))


FolderWriter = Callable[[Plan, Path], dict[str, Path]]
Writer = TypeVar("Writer", bound=Callable[..., dict[str, Path]])


def _no_folder_writer(plan: Plan, folder: Path) -> dict[str, Path]:
    raise RuntimeError(
        "ssm_planner.pipeline.folder, which writes result folders, has not been imported"
    )


_folder_writer: FolderWriter = _no_folder_writer


def use_folder_writer(write: Writer) -> Writer:
    """Name the function behind `Plan.save`: it stands above this module, because it knows pages and figures."""
    global _folder_writer
    _folder_writer = write
    return write


def load_plan(path: str | Path) -> Plan:
    """The plan in a plan.json, or in the result folder that holds one.

    Raises TrajectoryError (not a plan of a known version, no trajectory in it, or the files of its folder are not of one
    plan) or ProblemError.
    """
    path = Path(path)
    try:
        file = path / FILE if path.is_dir() else path
    except (OSError, ValueError) as error:
        raise TrajectoryError(f"{path}: cannot be read: {error}") from error
    with locked(file.parent):  # nobody puts other results in place meanwhile
        found, sha256 = read_json_in_parts(file, LARGEST_FILE, ("trajectory", "coefficients"))
        check_generation(file.parent)
    return Plan._of(found, sha256, file)


def _document(document: Any, path: Path) -> dict[str, Any]:
    """The mapping in a plan.json of this version. Raises TrajectoryError."""
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


def _number(value: Any, path: Path) -> float | None:
    if value is not None and (isinstance(value, bool) or not isinstance(value, (int, float))):
        raise TrajectoryError(f"{path}: nominal_duration is no number: not a whole plan.json")
    return value


def _phases(data: Any, path: Path) -> tuple[PhaseSummary, ...]:
    if not isinstance(data, list):
        raise TrajectoryError("phases is no list: not a whole plan.json")
    try:
        return tuple(built(PhaseSummary, phase, f"phases[{i}]") for i, phase in enumerate(data))
    except ProblemError as error:
        error.file = str(path)
        raise


def _limits_of(robot: Robot) -> list[Limit]:
    return [*(limit for joint in robot.joints for limit in joint.limits), *robot.limits]


def _wider_ranges(problem: Problem) -> list[str]:
    """Ranges asked for that the robot's own, or the travel of joint 4, narrow."""
    notes = []
    for name, asked in problem.wider.items():
        if (holds := problem.ranges.get(name)) is None:
            continue
        texts = (
            " to ".join(in_words(end, TaskRange(name, *ends).unit) for end in ends)
            for ends in (asked, holds)
        )
        notes.append(
            "range of {} of {} asked for: the robot allows {}, which holds".format(name, *texts)
        )
    return notes


def _whole_turns(problem: Problem, trajectory: Trajectory | None) -> list[str]:
    """Joints that start a whole turn away from their nearest position to zero, which the problem leaves open."""
    if trajectory is None or isinstance(problem.start, Joints):
        return []
    first = np.degrees(trajectory.sample(0.0).q[0])
    return [
        f"joint {joint.name} starts at {angle:.6g} deg, a whole turn from {angle - math.copysign(360.0, angle):.6g} deg: "
        "from there the motion would leave its range"
        for joint, angle in zip(problem.robot.joints, first, strict=True)
        if joint.kind == "revolute" and abs(angle) > 180.0 + 1e-6
    ]


def _ways_round(
    problem: Problem, trajectory: Trajectory, phases: tuple[PhaseSummary, ...]
) -> list[str]:
    """Phases that go over to the other branch of the inverse kinematics, and joints that turn by more than half a turn."""
    mechanism, joints = Mechanism.from_geometry(problem.robot.geometry), problem.robot.joints
    if not any(isinstance(entry, Free) for entry in problem.motion):
        return []
    instants = np.concatenate([[0.0], np.cumsum([phase.duration for phase in phases])])
    ends = trajectory.sample(trajectory.breaks[0] + np.minimum(instants, trajectory.duration)).q
    branches = mechanism.branch_of(ends)
    notes = []
    for phase, before, after, (first, last) in zip(
        phases, branches, branches[1:], pairwise(ends), strict=False
    ):
        if before != after:
            notes.append(
                f"{phase.name}: goes from branch {before:+d} of the inverse kinematics to branch {after:+d}"
            )
        notes += [
            f"{phase.name}: joint {joint.name} turns by {angle:.6g} deg, not by {angle - math.copysign(360.0, angle):.6g} deg"
            for joint, angle in zip(joints, np.degrees(last - first), strict=True)
            if joint.kind == "revolute" and abs(angle) > 180.0 + 1e-6
        ]
    return notes


def _extrapolation(robot: Robot, requirement: MotorRequirement) -> list[str]:
    """Whether friction is used beyond the speeds at which it was identified; or that it does not hold the joint."""
    drive = robot.joints[JOINTS.index(requirement.joint)].drive
    if drive is None or drive.friction is None:
        return []
    if not drive.threaded:
        return [
            f"joint {requirement.joint}: a {drive.kind} drive does not lock itself: without power its load moves it"
        ]
    known = drive.friction.identified_speed
    if known is None:
        return [
            f"joint {requirement.joint}: the drive file does not say up to which speed its friction was identified"
        ]
    if requirement.peak_speed <= known:
        return []
    return [
        f"joint {requirement.joint}: friction extrapolated {requirement.peak_speed / known:.1f}× beyond the identified "
        f"speeds ({known:.3g} rad/s, used up to {requirement.peak_speed:.3g} rad/s)"
    ]
