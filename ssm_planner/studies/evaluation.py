"""Evaluate one candidate robot: plan its motions, select motors and gears, check, and size."""

import ctypes
import gc
import mmap
import pickle
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.loading import (
    CatalogueEntry,
    drive_from,
    motor_from,
    problem_from_dict,
    section_from_data,
)
from ssm_planner.pipeline.run import plan
from ssm_planner.pipeline.thermal import with_fast_planner
from ssm_planner.plans import Plan
from ssm_planner.problem import Joint, Problem, unchecked_copy
from ssm_planner.sizing import (
    MARGINS,
    Conditions,
    JointLoad,
    JointSelection,
    MotorVerdict,
    Sizing,
    joint_loads,
    pause_of,
    select_joint,
    size_motion,
)
from ssm_planner.studies.provenance import describe_program
from ssm_planner.studies.store import Candidate
from ssm_planner.studies.study import PACE_PATH, Choice, Design, Study
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Fields, JsonObject, record
from ssm_planner.verification.check import check

CHECKS_WITH_MARGIN = (*MARGINS, "heat")
"""Motor checks whose margins must reach the required one."""
MARGIN_ALLOWANCE = 1e-4
"""Additional margin of motors, because planner and sizing evaluate different instants."""

MEMORY_THRESHOLD = 200e6
"""Memory above which a worker discards cached programs, bytes."""
MEMORY_GROWTH_THRESHOLD = 60e6
"""Growth of the memory above which it discards them again, bytes."""
_memory_after_release = [0]
SPEED_COUNT = 6
"""Number of speeds that are tried from the fastest motion to the candidate's pace."""

TrajectoryByMotion = Mapping[str, Trajectory]
"""Trajectories by name of the motion."""
ProblemByMotion = Mapping[str, Problem]
"""Problems by name of the motion."""


class CandidateRejected(Exception):
    """End of an evaluation that rejects a candidate, with the figures that were computed."""

    def __init__(self, stage: str, reason: str, figures: Fields | None = None) -> None:
        super().__init__(reason)
        self.stage = stage
        self.figures = figures or {}


@record
class Evaluation:
    """A function that evaluates a candidate with all motions of a study. It can be pickled."""

    study: Study

    def __call__(self, number: int, design: Design) -> Candidate:
        """Return the results of a candidate. A fault of this program gives the state "failed"."""
        try:
            return Candidate(number, "done", design, figures=self._evaluate(design))
        except CandidateRejected as error:
            return Candidate(
                number, "infeasible", design, error.stage, str(error), figures=error.figures
            )
        except ProblemError as error:
            return Candidate(number, "infeasible", design, "design", str(error))
        except Exception as error:  # noqa: BLE001 the fault of one candidate must not end the study
            return Candidate(number, "failed", design, None, f"{type(error).__name__}: {error}")

    def _evaluate(self, design: Design) -> JsonObject:
        """Evaluate a candidate in all stages: plan, select motors and gears, check and size.

        Returns the results by name, in SI units. Raises Rejected for an infeasible candidate, and
        ProblemError for invalid values.
        """
        study = self.study
        margin = study.require.motor_margin
        slowdown = float(design.get(PACE_PATH, 1.0))
        components: dict[str, str] = {}
        fast_motions: TrajectoryByMotion = {}
        if study.selected:
            original_problems = dict(candidate_problems(study, design))
            undriven = {
                name: _remove_selected_motors(study, problem)
                for name, problem in original_problems.items()
            }
            fast_motions = _plan_motions(undriven, {})
            components = select_components(study, original_problems, fast_motions, slowdown)
        problems = dict(candidate_problems(study, {**design, **components}))
        reduced_problems = {
            name: derate_motors(problem, margin) for name, problem in problems.items()
        }
        try:
            motions = _plan_motions(reduced_problems, fast_motions)
        except CandidateRejected as error:
            raise CandidateRejected(error.stage, str(error), components) from error
        results: JsonObject = components | _motion_results(problems, motions)
        results |= _geometry_results(next(iter(problems.values())))
        if slowdown > 1 and not _keeps_margin(results, margin):
            results |= _slower_motion_results(
                problems, reduced_problems, fast_motions, slowdown, margin=margin
            )
        if not _keeps_margin(results, margin):
            reason = (
                f"a motor margin of {100 * results['motor_margin']:.4g} %, required are "
                f"{100 * margin:.4g} %"
            )
            raise CandidateRejected("motors", reason, results)
        return results


def _slower_motion_results(
    problems: ProblemByMotion,
    reduced: ProblemByMotion,
    fast_motions: TrajectoryByMotion,
    slowdown: float,
    *,
    margin: float,
) -> JsonObject:
    """Return the results of the fastest slower motion that keeps the motor margin.

    The planner does not limit heat and voltage, so slower motions are tried for them. Without such
    a motion, the results are those of the slowest motion that passes the check, or empty.

    Parameters
    ----------
    problems, reduced : Problems
        Problem of each motion by name, with the motors of the candidate and with motors that are
        reduced by the margin.
    fast_motions : Motions
        Fastest trajectory of each motion by name.
    slowdown : float
        Largest factor on the durations.
    margin : float
        Required motor margin, as a share.
    """
    results: JsonObject = {}
    for speed in np.geomspace(1.0, 1.0 / slowdown, SPEED_COUNT)[1:]:
        slower = {name: motion.slower(float(speed)) for name, motion in fast_motions.items()}
        if all(_passes_check(slower[name], problem) for name, problem in reduced.items()):
            results = _motion_results(problems, slower)
            if _keeps_margin(results, margin):
                break
    return results


def evaluate_batch(
    pickled: bytes, candidates: Sequence[tuple[int, Design]]
) -> tuple[list[Candidate], float, dict[str, str]]:
    """Evaluate a batch of candidates in a worker process.

    Parameters
    ----------
    pickled : bytes
        Pickled `Evaluation`, which a worker reads only once.
    candidates : sequence of (int, Design)
        Number and design of each candidate.

    Returns
    -------
    rows
        Results of the candidates.
    seconds
        Duration of the evaluation, s.
    worker_program
        Description of the worker's program.
    """
    evaluation = _unpickle_evaluation(pickled)
    start = time.monotonic()
    rows = []
    for number, design in candidates:
        rows.append(evaluation(number, design))
        if _resident_memory() > max(
            MEMORY_THRESHOLD, _memory_after_release[0] + MEMORY_GROWTH_THRESHOLD
        ):
            _release_memory()
            _memory_after_release[0] = _resident_memory()
    return rows, time.monotonic() - start, describe_program()


def _resident_memory() -> int:
    """Return the memory of the process in bytes, or 0 if the system does not provide /proc."""
    try:
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * mmap.PAGESIZE
    except OSError:
        return 0


def _release_memory() -> None:
    """Discard the cached programs of earlier candidates, and return free memory to the system."""
    from ssm_planner.planning.ocp.transcription import clear_program_cache

    clear_program_cache()
    gc.collect()
    # Only the GNU C library has this function.
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


@lru_cache(maxsize=1)
def _unpickle_evaluation(pickled: bytes) -> Evaluation:
    """Unpickle an evaluation. The latest one is cached."""
    return pickle.loads(pickled)


def candidate_problems(study: Study, design: Design) -> Iterator[tuple[str, Problem]]:
    """Yield the name and the problem of each motion of a study, with a candidate as the robot.

    Raises ProblemError if the candidate is invalid.
    """
    tree = study.resolved(design)
    for name, motion in study.motions.items():
        yield name, problem_from_dict({"name": name, **motion, "robot": tree})


def plan_candidate(study: Study, row: Candidate) -> dict[str, Plan]:
    """Plan the motions of a candidate again, and return the plans by name of the motion.

    The robot has the motors and gears that were selected for the candidate. The plans keep the
    motor margin that the study requires.
    """
    plans = {}
    for name, problem in candidate_problems(study, study.complete_design(row.design, row.figures)):
        result = plan(with_fast_planner(derate_motors(problem, study.require.motor_margin)))
        if result.trajectory is not None:
            certificate = check(result.trajectory, problem.robot, problem.task_limits, seal=True)
            result = replace(result, problem=problem, certificate=certificate)
        plans[name] = result
    return plans


def _plan_motions(problems: ProblemByMotion, previous: TrajectoryByMotion) -> TrajectoryByMotion:
    """Plan a trajectory for each problem. Raises Rejected for the first one without a plan.

    A trajectory in `previous` is used again if it passes the check of the problem.
    """
    motions = {}
    for name, problem in problems.items():
        if name in previous and _passes_check(previous[name], problem):
            motions[name] = previous[name]
            continue
        result = plan(with_fast_planner(problem), relaxations=False)
        if not result.passed or result.trajectory is None:
            reason = "no motion found" if result.reason is None else result.reason.message
            raise CandidateRejected("plan", f"{name}: {reason}")
        motions[name] = result.trajectory
    return motions


def _passes_check(motion: Trajectory, problem: Problem) -> bool:
    """Return True if a trajectory passes the check with the robot and the limits of a problem."""
    return check(motion, problem.robot, problem.task_limits).passed


def derate_motors(problem: Problem, margin: float) -> Problem:
    """Reduce the torque, the continuous torque and the speed of all motors by a margin.

    `margin` is a share of these limits. The planner then keeps the margin.
    """
    if margin == 0:
        return problem
    share = 1 - margin - MARGIN_ALLOWANCE

    def reduced(joint: Joint) -> Joint:
        """Return a joint whose motor has the reduced limits."""
        motor = joint.motor
        if motor is None:
            return joint
        motor = unchecked_copy(
            motor,
            max_torque=share * motor.max_torque,
            nominal_torque=share * motor.nominal_torque,
            max_speed=share * motor.max_speed,
        )
        return unchecked_copy(joint, motor=motor)

    return _with_changed_joints(problem, reduced)


def _with_changed_joints(problem: Problem, change: Callable[[Joint], Joint]) -> Problem:
    """Return the problem in which a function has changed every joint of the robot."""
    joints = tuple(map(change, problem.robot.joints))
    return unchecked_copy(problem, robot=unchecked_copy(problem.robot, joints=joints))


def _remove_selected_motors(study: Study, problem: Problem) -> Problem:
    """Remove the motors of all joints whose motor or gear is selected."""
    selected_joints = {choice.path.split(".")[1] for choice in study.selected}

    def undriven(joint: Joint) -> Joint:
        """Return a joint without its motor if the motor or the gear is selected."""
        if joint.name in selected_joints:
            return replace(joint, motor=None, alternatives=())
        return joint

    return _with_changed_joints(problem, undriven)


def select_components(
    study: Study, problems: ProblemByMotion, motions: TrajectoryByMotion, slowdown: float
) -> dict[str, str]:
    """Select a motor and a gear for each joint with such a choice.

    The function selects the first pair by rank that keeps the study's margins in every motion. It
    evaluates the whole catalogue at once with arrays. Only the first pairs undergo all checks, such
    as the check of heat.

    Parameters
    ----------
    study : Study
        Study with the choices of motors and gears.
    problems : Problems
        Problem of each motion by name.
    motions : Motions
        Fastest trajectory of each motion by name.
    slowdown : float
        Factor on the durations of these motions.

    Returns
    -------
    dict
        Names of the selected motors and gears by path.

    Raises
    ------
    Rejected
        If no pair suits a joint.
    """
    loads = []
    for name, problem in problems.items():
        conditions = Conditions(pause=pause_of(problem))
        for load in joint_loads(motions[name].slower(1 / slowdown), problem.robot):
            loads.append((load, conditions))
    components: dict[str, str] = {}
    for joint in dict.fromkeys(choice.path.split(".")[1] for choice in study.selected):
        loads_of_joint = [item for item in loads if item[0].joint == joint]
        components |= _select_pair(study, joint, loads_of_joint)
    return components


def _select_pair(
    study: Study, joint: str, loads: Sequence[tuple[JointLoad, Conditions]]
) -> dict[str, str]:
    """Select the motor and the gear of one joint. Raises Rejected if no pair is suitable.

    Parameters
    ----------
    study : Study
        Study with the required margin.
    joint : str
        Name of the joint.
    loads : sequence of (JointLoad, Conditions)
        Load of the joint in each motion, with the operating conditions.

    Returns
    -------
    dict
        Label of the selected motor and of the selected gear by the path of their choice.
    """
    motor_choice, motors = _component_options(study, joint, "motor")
    gear_choice, gears = _component_options(study, joint, "drive")
    selections = [select_joint(load, motors, gears, conditions) for load, conditions in loads]
    rank = (motor_choice or gear_choice or study.selected[0]).select or "mass"
    margin = study.require.motor_margin
    indices = next(iter(_admissible_pairs(selections, rank, margin)), None)
    if indices is None:
        counts = selections[0].reasons().items()
        reasons = ", ".join(f"{name} {count}" for name, count in counts) or "their margins"
        pairs = f"{len(motors)} motors" + (f" with {len(gears)} gears" if gear_choice else "")
        text = f"joint {joint}: none of {pairs} holds with {100 * margin:.4g} % to spare"
        raise CandidateRejected("selection", f"{text} (ruled out by {reasons})")
    gear_index, motor_index = indices
    components = {}
    if gear_choice is not None:
        components[gear_choice.path] = gears[gear_index].label
    if motor_choice is not None:
        components[motor_choice.path] = motors[motor_index].label
    return components


def _admissible_pairs(
    selections: Sequence[JointSelection], rank: Any, margin: float
) -> Iterator[tuple[int, int]]:
    """Yield the pairs of gear and motor indices that keep the margin in every motion, by rank."""
    smallest = [np.nanmin(list(selection.margins.values()), axis=0) for selection in selections]
    not_excluded = np.all([selection.adequate >= 0 for selection in selections], axis=0)
    admissible = not_excluded & (np.min(smallest, axis=0) >= margin)
    for gear, motor in selections[0].ranked(rank):
        if not admissible[gear, motor]:
            continue
        for selection in selections:
            margins = _checked_margins(selection.verdict(gear, motor))
            if min(margins, default=margin) < margin:
                break
        else:
            yield gear, motor


def _checked_margins(verdict: MotorVerdict) -> list[float]:
    """Return the margins of the checks `CHECKS_WITH_MARGIN` of a motor that are evaluated."""
    margins = {
        check.name: check.margin for check in verdict.checks if check.name in CHECKS_WITH_MARGIN
    }
    return [margin for margin in margins.values() if margin is not None]


@lru_cache(maxsize=8)
def _component_options(
    study: Study, joint: str, component: str
) -> tuple[Choice | None, list[CatalogueEntry[Any]]]:
    """Return the options for the motor or the drive of a joint.

    Parameters
    ----------
    study : Study
        Study with the choices of motors and gears.
    joint : str
        Name of the joint.
    component : str
        "motor" or "drive".

    Returns
    -------
    choice
        The study's choice of the component, or None.
    options
        One part for each entry of the choice. Without a choice, the part in the robot file.
    """
    path = f"joints.{joint}.{component}"
    choice = next((choice for choice in study.selected if choice.path.startswith(path)), None)
    designs: dict[str, Design] = {"": {}}
    sizes: Mapping[str, Mapping[str, float]] = {}
    if choice is not None:
        designs = {label: {choice.path: label} for label in choice.contents}
        sizes = choice.beside
    read_component = motor_from if component == "motor" else drive_from
    options = []
    for label, design in designs.items():
        content = study.resolved(design)["joints"][joint].get(component)
        value: Any = read_component(section_from_data(content))
        size = {"mass": getattr(value, "mass", None), **sizes.get(label, {})}
        options.append(CatalogueEntry(label, value, **size))
    return choice, options


def _keeps_margin(results: Fields, margin: float) -> bool:
    """Return True if the results keep the motor margin, or if the margin is unknown."""
    available = results["motor_margin"]
    return available is None or available >= margin


def _motion_results(problems: ProblemByMotion, motions: TrajectoryByMotion) -> JsonObject:
    """Return the durations of the motions, and the results for the motors, in SI units."""
    results: JsonObject = {}
    sizings = []
    for name, motion in motions.items():
        problem = problems[name]
        results[f"duration.{name}"] = motion.duration
        sizings.append(size_motion(motion, problem.robot, pause_of(problem)))
    results["duration"] = sum(motion.duration for motion in motions.values())
    return results | _motor_results(sizings)


def _motor_results(sizings: Sequence[Sizing]) -> JsonObject:
    """Return the smallest motor margin, the largest torques and the mass of the motors.

    All values are in SI units. The mass is None if the mass of a motor is unknown.
    """
    results: JsonObject = {}
    margins: list[float] = []
    peak_torques = []
    masses: dict[str, float | None] = {}
    for sizing in sizings:
        for verdict in sizing.verdicts:
            margins += _checked_margins(verdict)
            peak_torques.append(verdict.requirement.peak_torque)
            masses[verdict.joint] = verdict.motor.mass
            for name in ("peak_torque", "rms_torque"):
                key = f"{name}.{verdict.joint}"
                results[key] = max(getattr(verdict.requirement, name), results.get(key, 0.0))
    known_masses = [mass for mass in masses.values() if mass is not None]
    results["motor_margin"] = min(margins, default=None)
    results["peak_torque"] = max(peak_torques, default=None)
    are_known = known_masses and len(known_masses) == len(masses)
    results["motor_mass"] = sum(known_masses) if are_known else None
    return results


def _geometry_results(problem: Problem) -> JsonObject:
    """Return α, β and the tilt range of a robot, rad."""
    from ssm_planner.kinematics import Mechanism, tilt_interval

    mechanism = Mechanism.from_robot(problem.robot)
    low, high = tilt_interval(mechanism)
    return {"alpha": mechanism.alpha, "beta": mechanism.beta, "tilt_low": low, "tilt_high": high}
