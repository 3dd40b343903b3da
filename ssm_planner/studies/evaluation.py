"""One candidate in full: planned over every motion, its motors and gears selected where the study says so, checked, sized."""

from __future__ import annotations

import ctypes
import gc
import mmap
import pickle
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.loading.catalogues import Part
from ssm_planner.loading.drives import drive_from
from ssm_planner.loading.files import of_data
from ssm_planner.loading.load import problem_from_dict
from ssm_planner.loading.motors import motor_from
from ssm_planner.pipeline.run import plan, quickly
from ssm_planner.plans import Plan
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.motor import Motor
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.value import unchecked
from ssm_planner.sizing.duty import pause_of
from ssm_planner.sizing.joint_load import joint_loads
from ssm_planner.sizing.motor_limits import Conditions
from ssm_planner.sizing.selection import MARGINS, JointSelection, select_joint
from ssm_planner.sizing.size import Sizing, size_motion
from ssm_planner.studies.screens import Fallen
from ssm_planner.studies.store import Candidate
from ssm_planner.studies.study import PACE, Choice, Design, Study
from ssm_planner.trajectory import Trajectory
from ssm_planner.verification.check import check

CHECKED = (*MARGINS, "heat")
"""Checks of a motor whose margins count."""
SPARE = 1e-4
"""Of a motor's limits beside the margin required, for what lies between the planner's and the sizing's instants."""

MEMORY = 200e6
"""Bytes a worker may hold after a candidate: beyond them it forgets the programs of the optimal control problems."""
GROWTH = 60e6
"""Bytes beyond what was left then before it does so again."""
_left = [0]
PACES = 6
"""Speeds that are tried from that of the fastest motion to that of the candidate's pace, both included."""

Motions = Mapping[str, Trajectory]
"""By the motion's name."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """One candidate planned over every motion, checked and sized. It travels as a pickle."""

    study: Study

    def __call__(self, number: int, design: Design) -> Candidate:
        """The candidate's row; a fault of this program becomes the state failed."""
        try:
            return self._row(number, design)
        except ProblemError as error:
            return Candidate(number, "infeasible", design, "design", str(error))
        except Exception as error:  # noqa: BLE001 one candidate's fault must not end the study
            return Candidate(number, "failed", design, None, f"{type(error).__name__}: {error}")

    def _row(self, number: int, design: Design) -> Candidate:
        study, margin = self.study, self.study.require.motor_margin
        chosen: dict[str, str] = {}
        pace = float(design.get(PACE, 1.0))
        fastest: Motions = {}
        if study.selected:
            originals = dict(problems_of(study, design))
            planned = _planned(
                {name: _undriven(study, problem) for name, problem in originals.items()}, {}
            )
            if isinstance(planned, Fallen):
                return Candidate(number, "infeasible", design, planned.stage, planned.reason)
            fastest, found = planned, selected(study, originals, planned, pace)
            if isinstance(found, Fallen):
                return Candidate(number, "infeasible", design, found.stage, found.reason)
            chosen = found
        problems = dict(problems_of(study, {**design, **chosen}))
        within = {name: sparing(problem, margin) for name, problem in problems.items()}
        motions = _planned(within, fastest)
        if isinstance(motions, Fallen):
            return Candidate(
                number, "infeasible", design, motions.stage, motions.reason, figures=chosen
            )
        figures = {
            **chosen,
            **_figures(problems, motions),
            **_of_geometry(next(iter(problems.values()))),
        }
        for speed in np.geomspace(1.0, 1.0 / pace, PACES)[1:] if pace > 1 else ():
            if _holds(figures, margin):
                break
            # heat and voltage are no limits of the planner: the fastest motion, slower, as the motors were selected for
            slower = {name: trajectory.slower(float(speed)) for name, trajectory in fastest.items()}
            if all(
                check(slower[name], each.robot, each.task_limits).passed
                for name, each in within.items()
            ):
                figures |= _figures(problems, slower)
        if not _holds(figures, margin):
            reason = f"a motor margin of {100 * figures['motor_margin']:.4g} %, required are {100 * margin:.4g} %"
            return Candidate(number, "infeasible", design, "motors", reason, figures=figures)
        return Candidate(number, "done", design, figures=figures)


def evaluated(
    pickled: bytes, candidates: Sequence[tuple[int, Design]]
) -> tuple[list[Candidate], float]:
    """What a worker is asked for: the rows of candidates (number, design), and the seconds that they took.

    pickled: the Evaluation, which a worker reads once.
    """
    evaluation, begin = _read(pickled), time.monotonic()
    rows = []
    for number, design in candidates:
        rows.append(evaluation(number, design))
        if _memory() > max(MEMORY, _left[-1] + GROWTH):
            _give_back()
            _left[:] = [_memory()]
    return rows, time.monotonic() - begin


def _memory() -> int:
    """Bytes that the process holds; 0 where the system does not say it this way."""
    try:
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * mmap.PAGESIZE
    except OSError:
        return 0


def _give_back() -> None:
    """Programs of earlier candidates, and what the allocator has kept of them, to the system."""
    from ssm_planner.planning.ocp.transcription import forget_programs

    forget_programs()
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # of the GNU library
    if trim is not None:
        trim(0)


@lru_cache(maxsize=1)
def _read(pickled: bytes) -> Evaluation:
    evaluation: Evaluation = pickle.loads(pickled)
    return evaluation


def problems_of(study: Study, design: Design) -> Iterator[tuple[str, Problem]]:
    """The motions of a study with a candidate as their robot. Raises ProblemError."""
    tree = study.resolved(design)
    for name, motion in study.motions.items():
        yield name, problem_from_dict({"name": name, **motion, "robot": tree})


def plans_of(study: Study, row: Candidate) -> dict[str, Plan]:
    """The candidate's plans, made again with the motors it has, by motion; they keep the margin required of these."""
    found = {}
    for name, problem in problems_of(study, study.whole(row.design, row.figures)):
        made = plan(quickly(sparing(problem, study.require.motor_margin)))
        if made.trajectory is not None:
            certificate = check(made.trajectory, problem.robot, problem.task_limits, seal=True)
            made = replace(made, problem=problem, certificate=certificate)
        found[name] = made
    return found


def _planned(problems: Mapping[str, Problem], known: Motions) -> Motions | Fallen:
    """A certified trajectory of each problem: the one that is known where it keeps the limits, else one planned."""
    found = {}
    for name, problem in problems.items():
        if name in known and check(known[name], problem.robot, problem.task_limits).passed:
            found[name] = known[name]
            continue
        made = plan(quickly(problem), relaxations=False)
        if not made.passed or made.trajectory is None:
            return Fallen(
                "plan",
                f"{name}: {'no motion found' if made.reason is None else made.reason.message}",
            )
        found[name] = made.trajectory
    return found


def sparing(problem: Problem, margin: float) -> Problem:
    """The problem with motors that may use what a margin, as a share, leaves of their torque, continuous torque and speed."""
    if margin == 0:
        return problem
    names = ("max_torque", "nominal_torque", "max_speed")
    less = 1 - margin - SPARE

    def spared(motor: Motor | None) -> Motor | None:
        return (
            None
            if motor is None
            else unchecked(motor, **{name: less * getattr(motor, name) for name in names})
        )

    joints = tuple(unchecked(joint, motor=spared(joint.motor)) for joint in problem.robot.joints)
    return unchecked(problem, robot=unchecked(problem.robot, joints=joints))


def _undriven(study: Study, problem: Problem) -> Problem:
    """The problem without the motors that are to be selected, or that drive a gear that is."""
    free = {choice.path.split(".")[1] for choice in study.selected}
    joints = tuple(
        replace(each, motor=None) if each.name in free else each for each in problem.robot.joints
    )
    return unchecked(problem, robot=unchecked(problem.robot, joints=joints))


def selected(
    study: Study, problems: Mapping[str, Problem], motions: Motions, pace: float
) -> dict[str, str] | Fallen:
    """The names of the motors and gears, by path: of each joint the first pair by rank that holds every motion at a pace.

    The whole catalogue is judged in one pass over arrays; heat and what else takes a closer look is asked of the first
    pairs alone. The margins are those required of the study.
    """
    chosen: dict[str, str] = {}
    loads = {}
    for name, problem in problems.items():
        loads_of = joint_loads(motions[name].slower(1 / pace), problem.robot)
        loads[name] = Conditions(pause=pause_of(problem)), {load.joint: load for load in loads_of}
    for joint in dict.fromkeys(choice.path.split(".")[1] for choice in study.selected):
        own = {
            choice.path.split(".")[-1]: choice
            for choice in study.selected
            if choice.path.split(".")[1] == joint
        }
        motor_choice = own.pop("motor", None)
        gear_choice = next(iter(own.values()), None)
        motors, gears = _motors(study, joint), _gears(study, joint, gear_choice)
        judged = [
            select_joint(by_joint[joint], motors, gears, conditions)
            for conditions, by_joint in loads.values()
            if joint in by_joint
        ]
        rank = (motor_choice or gear_choice or study.selected[0]).select or "mass"
        pair = next(iter(_holding(judged, rank, study.require.motor_margin)), None)
        if pair is None:
            reasons = ", ".join(f"{name} {count}" for name, count in judged[0].reasons().items())
            pairs = (
                f"{len(motors)} motors with {len(gears)} gears"
                if gear_choice
                else f"{len(motors)} motors"
            )
            text = f"joint {joint}: none of {pairs} holds with {100 * study.require.motor_margin:.4g} % to spare"
            return Fallen("selection", f"{text} (ruled out by {reasons or 'their margins'})")
        for choice, part in ((motor_choice, motors[pair[1]]), (gear_choice, gears[pair[0]])):
            if choice is not None:
                chosen[choice.path] = part.label
    return chosen


def _holding(
    judged: Sequence[JointSelection], rank: Any, margin: float
) -> Iterator[tuple[int, int]]:
    """The pairs (gear, motor) that hold every motion with a margin, by rank."""
    least = np.min([np.nanmin(list(each.margins.values()), axis=0) for each in judged], axis=0)
    holds = np.all([each.adequate >= 0 for each in judged], axis=0) & (least >= margin)
    for g, m in judged[0].ranked(rank):
        if not holds[g, m]:
            continue
        checks = [
            check for each in judged for check in each.verdict(g, m).checks if check.name in CHECKED
        ]
        if all(check.margin is None or check.margin >= margin for check in checks):
            yield g, m


@lru_cache(maxsize=8)
def _motors(study: Study, joint: str) -> list[Part[Motor]]:
    """The motors to select among; a joint's own where only its gear is selected."""
    choice = next((each for each in study.selected if each.path == f"joints.{joint}.motor"), None)
    own = study.robot["joints"][joint].get("motor")
    contents, beside = ({"": own}, {}) if choice is None else (choice.contents, choice.beside)
    motors = {label: motor_from(of_data(content)) for label, content in contents.items()}
    return [
        Part(label, motor, motor.mass, beside.get(label, {}).get("length"))
        for label, motor in motors.items()
    ]


def _gears(study: Study, joint: str, choice: Choice | None) -> list[Part[Drive]]:
    """The drives with each gear to select among; a joint's own drive where none is selected."""
    designs: dict[str, Design] = (
        {"": {}} if choice is None else {label: {choice.path: label} for label in choice.contents}
    )
    trees = {
        label: study.resolved(design)["joints"][joint]["drive"] for label, design in designs.items()
    }
    beside = {} if choice is None else choice.beside
    return [
        Part(label, drive_from(of_data(tree)), **beside.get(label, {}))
        for label, tree in trees.items()
    ]


def _holds(figures: Mapping[str, Any], margin: float) -> bool:
    reached = figures["motor_margin"]
    return reached is None or reached >= margin


def _figures(problems: Mapping[str, Problem], motions: Motions) -> dict[str, Any]:
    """Durations of the motions, and what they ask of the motors; SI."""
    durations = {f"duration.{name}": trajectory.duration for name, trajectory in motions.items()}
    sizings = [
        size_motion(motions[name], each.robot, pause_of(each)) for name, each in problems.items()
    ]
    return {**durations, "duration": sum(durations.values()), **_of_motors(sizings)}


def _of_motors(sizings: Sequence[Sizing]) -> dict[str, Any]:
    """Smallest margin of any motor in any motion, the largest torques by joint, and the mass of the motors; SI."""
    margins = []
    figures: dict[str, Any] = {}
    masses: dict[str, float | None] = {}
    for verdict in (verdict for sizing in sizings for verdict in sizing.verdicts):
        margins += [
            check.margin
            for check in verdict.checks
            if check.name in CHECKED and check.margin is not None
        ]
        for name, value in (
            ("peak_torque", verdict.requirement.peak_torque),
            ("rms_torque", verdict.requirement.rms_torque),
        ):
            key = f"{name}.{verdict.joint}"
            figures[key] = max(value, figures.get(key, 0.0))
        masses[verdict.joint] = verdict.motor.mass
    known = [mass for mass in masses.values() if mass is not None]
    figures["motor_margin"] = min(margins, default=None)
    figures["peak_torque"] = max(
        (value for key, value in figures.items() if key.startswith("peak_torque.")), default=None
    )
    figures["motor_mass"] = sum(known) if len(known) == len(masses) and known else None
    return figures


def _of_geometry(problem: Problem) -> dict[str, Any]:
    from ssm_planner.kinematics.mechanism import Mechanism
    from ssm_planner.kinematics.workspace import tilt_interval

    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    low, high = tilt_interval(mechanism)
    return {"alpha": mechanism.alpha, "beta": mechanism.beta, "tilt_low": low, "tilt_high": high}
