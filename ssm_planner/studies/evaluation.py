"""Evaluate one candidate robot: plan its motions, select motors and gears, check, and size.

The runner of a study sends an `Evaluation` to its workers, which call `evaluate_batch`. The
numerical results of a candidate, such as its duration and motor mass, are called figures. They are
plain values, so that they can be stored.
"""

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
    MARGIN_CHECKS,
    Conditions,
    JointLoad,
    JointSelection,
    MotorVerdict,
    joint_loads,
    pause_after_motion,
    select_joint,
    size_motion,
)
from ssm_planner.studies.provenance import describe_program
from ssm_planner.studies.store import Candidate
from ssm_planner.studies.study import PACE_PATH, Choice, Design, Study
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Fields, JsonObject, record
from ssm_planner.verification.check import check

CHECKS_WITH_MARGIN = (*MARGIN_CHECKS, "heat")
"""Checks of a motor whose margins must reach the required motor margin."""
MARGIN_ALLOWANCE = 1e-4
"""Additional motor margin for the planner, as a fraction of a limit.

The planner and the sizing evaluate different instants, so the sizing may find a slightly larger
load.
"""

MEMORY_THRESHOLD = 200e6
"""Memory of a worker above which it discards cached programs of the planner, bytes."""
MEMORY_GROWTH_THRESHOLD = 60e6
"""Growth of the memory since the last time after which a worker discards them again, bytes."""
_memory_after_release = 0
"""Memory of the process after it last discarded cached programs, bytes."""
SPEED_COUNT = 6
"""Number of speeds from the fastest motion to the candidate's pace, both included."""

TrajectoryByMotion = Mapping[str, Trajectory]
"""Trajectories by name of the motion."""
ProblemByMotion = Mapping[str, Problem]
"""Problems by name of the motion."""


class CandidateRejected(Exception):
    """Exception that ends the evaluation of an infeasible candidate.

    It contains the stage that rejected the candidate, the reason, and the figures that were
    computed before.
    """

    def __init__(self, stage: str, reason: str, figures: Fields | None = None) -> None:
        """Create the exception.

        Parameters
        ----------
        stage : str
            Stage that rejected the candidate, such as "plan".
        reason : str
            Reason in words.
        figures : mapping, optional
            Results that were computed before the rejection.
        """
        super().__init__(reason)
        self.stage = stage
        self.figures = figures or {}


@record
class Evaluation:
    """A function that evaluates one candidate with all motions of a study.

    It is an object, so that it can be pickled for worker processes.
    """

    study: Study

    def __call__(self, number: int, design: Design) -> Candidate:
        """Evaluate a candidate, and return its results. An error becomes a result as well.

        Parameters
        ----------
        number : int
            Number of the candidate.
        design : Design
            Values of the candidate by path.

        Returns
        -------
        Candidate
            Result with the state "done", "infeasible", or "failed" for a fault of this program.
        """
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
        """Plan the motions of a candidate, select its motors and gears, check, and size.

        If the study selects motors or gears, the motions are first planned without the motors of
        these joints. These fastest motions, slowed down by a factor called pace, determine the
        motors and gears. Each motion is then checked with them, and planned again if it violates a
        limit. Planning and check use motors whose limits are reduced by the motor margin, so that
        the motions keep this margin.

        Parameters
        ----------
        design : Design
            Values of the candidate by path.

        Returns
        -------
        dict
            Figures in SI units by name, and the names of the selected parts by path.

        Raises
        ------
        CandidateRejected
            If the candidate is infeasible.
        ProblemError
            If a value of the design is invalid.
        """
        study = self.study
        margin = study.require.motor_margin
        slowdown = float(design.get(PACE_PATH, 1.0))
        components: dict[str, str] = {}
        fast_motions: TrajectoryByMotion = {}
        if study.selected:
            original_problems = dict(candidate_problems(study, design))
            motorless_problems = {
                name: _remove_selected_motors(study, problem)
                for name, problem in original_problems.items()
            }
            fast_motions = _plan_motions(motorless_problems, {})
            components = select_components(study, original_problems, fast_motions, slowdown)
        problems = dict(candidate_problems(study, {**design, **components}))
        derated_problems = {
            name: derate_motors(problem, margin) for name, problem in problems.items()
        }
        try:
            motions = _plan_motions(derated_problems, fast_motions)
        except CandidateRejected as error:
            raise CandidateRejected(error.stage, str(error), components) from error
        results: JsonObject = components | _motion_results(problems, motions)
        results |= _geometry_results(next(iter(problems.values())))
        if slowdown > 1 and not _keeps_margin(results, margin):
            results |= _slower_motion_results(
                problems, derated_problems, fast_motions, slowdown, margin=margin
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
    derated: ProblemByMotion,
    fast_motions: TrajectoryByMotion,
    slowdown: float,
    *,
    margin: float,
) -> JsonObject:
    """Slow the fastest motions down until they keep the motor margin, and return the results.

    The planner does not limit the heat of a motor and the voltage. If the planned motions exceed
    these limits, slower motions may keep them.

    Parameters
    ----------
    problems : ProblemByMotion
        Problem of each motion by name, with the motors of the candidate.
    derated : ProblemByMotion
        The same problems with motors whose limits are reduced by the margin.
    fast_motions : TrajectoryByMotion
        Fastest trajectory of each motion by name.
    slowdown : float
        Largest factor by which the durations may grow.
    margin : float
        Required motor margin, as a fraction of the limit.

    Returns
    -------
    dict
        Results of the first of a few decreasing speeds that keeps the margin. If no speed keeps it,
        the results of the slowest motion that passes the check, or an empty dictionary.
    """
    results: JsonObject = {}
    for speed in np.geomspace(1.0, 1.0 / slowdown, SPEED_COUNT)[1:]:
        slower_motions = {
            name: motion.slower(float(speed)) for name, motion in fast_motions.items()
        }
        if all(_passes_check(slower_motions[name], problem) for name, problem in derated.items()):
            results = _motion_results(problems, slower_motions)
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
        Pickled `Evaluation`. A worker unpickles it only once.
    candidates : sequence of (int, Design)
        Number and design of each candidate.

    Returns
    -------
    rows : list of Candidate
        Results of the candidates, in their order.
    seconds : float
        Duration of the evaluation, s.
    worker_program : dict
        Description of the worker's program, which must equal that of the runner.
    """
    global _memory_after_release
    evaluation = _unpickle_evaluation(pickled)
    start = time.monotonic()
    rows = []
    for number, design in candidates:
        rows.append(evaluation(number, design))
        if _resident_memory() > max(
            MEMORY_THRESHOLD, _memory_after_release + MEMORY_GROWTH_THRESHOLD
        ):
            _release_memory()
            _memory_after_release = _resident_memory()
    return rows, time.monotonic() - start, describe_program()


def _resident_memory() -> int:
    """Return the resident memory of the process in bytes, or 0 on systems without /proc."""
    try:
        # The second number of this file is the number of resident memory pages.
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


_unpickle_evaluation = lru_cache(maxsize=1)(pickle.loads)
"""Unpickles an evaluation, and keeps it for the next batch of the same study."""


def candidate_problems(study: Study, design: Design) -> Iterator[tuple[str, Problem]]:
    """Yield the name and the problem of each motion of a study, with a candidate as the robot.

    Parameters
    ----------
    study : Study
        Study with the motions.
    design : Design
        Values of the candidate by path.

    Yields
    ------
    name : str
        Name of the motion.
    problem : Problem
        Problem with the robot of the candidate.

    Raises
    ------
    ProblemError
        If the candidate is not a valid robot.
    """
    tree = study.resolved(design)
    for name, motion in study.motions.items():
        yield name, problem_from_dict({"name": name, **motion, "robot": tree})


def plan_candidate(study: Study, row: Candidate) -> dict[str, Plan]:
    """Plan the motions of a candidate again, and return the plans by name of the motion.

    The study stores figures (numerical results such as durations) but no plans, so `study show`
    calls this function. The robot has the motors and gears that were selected for the candidate.
    The planner keeps the motor margin of the study, but a returned plan with a trajectory contains
    the problem with the full limits of the motors, and its certificate refers to them.

    Parameters
    ----------
    study : Study
        Study with the motions.
    row : Candidate
        Stored result of the candidate.

    Returns
    -------
    dict of Plan
        Plan of each motion by its name.
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
    """Plan a trajectory for each problem.

    Parameters
    ----------
    problems : ProblemByMotion
        Problem of each motion.
    previous : TrajectoryByMotion
        Earlier trajectories. Such a trajectory is used again if it passes the check of its problem.

    Returns
    -------
    TrajectoryByMotion
        Trajectory of each motion by its name.

    Raises
    ------
    CandidateRejected
        If a motion cannot be planned.
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
    """Return True if a trajectory keeps all limits of a problem and its robot."""
    return check(motion, problem.robot, problem.task_limits).passed


def derate_motors(problem: Problem, margin: float) -> Problem:
    """Reduce the limits of all motors, so that the planner keeps a margin.

    The limits become (1 − margin − MARGIN_ALLOWANCE) times the original limits.

    Parameters
    ----------
    problem : Problem
        Problem with the robot.
    margin : float
        Fraction by which the torque, the continuous torque and the speed are reduced. 0 leaves the
        problem unchanged.

    Returns
    -------
    Problem
        Problem whose robot has motors with the reduced limits.
    """
    if margin == 0:
        return problem
    remaining = 1 - margin - MARGIN_ALLOWANCE

    def derate(joint: Joint) -> Joint:
        """Reduce the limits of the motor of one joint.

        Parameters
        ----------
        joint : Joint
            Joint with or without a motor.

        Returns
        -------
        Joint
            Copy with a weaker motor, or the same joint if it has no motor.
        """
        motor = joint.motor
        if motor is None:
            return joint
        motor = unchecked_copy(
            motor,
            max_torque=remaining * motor.max_torque,
            nominal_torque=remaining * motor.nominal_torque,
            max_speed=remaining * motor.max_speed,
        )
        return unchecked_copy(joint, motor=motor)

    return _with_changed_joints(problem, derate)


def _with_changed_joints(problem: Problem, change: Callable[[Joint], Joint]) -> Problem:
    """Return the problem in which a function has changed every joint of the robot."""
    joints = tuple(map(change, problem.robot.joints))
    return unchecked_copy(problem, robot=unchecked_copy(problem.robot, joints=joints))


def _remove_selected_motors(study: Study, problem: Problem) -> Problem:
    """Remove the motors of those joints whose motor or gear is still unknown.

    The study selects some motors and gears only after the planning. The first plans therefore must
    not depend on the motors of these joints.

    Parameters
    ----------
    study : Study
        Study whose attribute `selected` lists these choices.
    problem : Problem
        Problem with the robot.

    Returns
    -------
    Problem
        Copy of the problem, whose robot lacks these motors.
    """
    selected_joints = {choice.joint for choice in study.selected}

    def without_motor(joint: Joint) -> Joint:
        """Return a joint, without its motor if the motor or the gear is selected."""
        if joint.name in selected_joints:
            return replace(joint, motor=None, alternatives=())
        return joint

    return _with_changed_joints(problem, without_motor)


def select_components(
    study: Study, problems: ProblemByMotion, motions: TrajectoryByMotion, slowdown: float
) -> dict[str, str]:
    """Select a motor and a gear for each joint whose motor or gear comes from a catalogue.

    For each joint, the function takes the first pair of motor and gear, in the order of the rank
    (such as mass), that keeps the motor margin of the study in every motion. It first judges all
    pairs of the catalogues at once by the checks that arrays permit. It then applies all checks,
    such as that of heat, to one remaining pair after the other until a pair passes.

    Parameters
    ----------
    study : Study
        Study with the choices of motors and gears.
    problems : ProblemByMotion
        Problem of each motion by name.
    motions : TrajectoryByMotion
        Fastest trajectory of each motion by name.
    slowdown : float
        Factor by which the durations of these motions grow.

    Returns
    -------
    dict
        Names of the selected motors and gears by path.

    Raises
    ------
    CandidateRejected
        If no pair suits a joint.
    """
    loads = []
    for name, problem in problems.items():
        conditions = Conditions(pause=pause_after_motion(problem))
        for load in joint_loads(motions[name].slower(1 / slowdown), problem.robot):
            loads.append((load, conditions))
    components: dict[str, str] = {}
    for joint in dict.fromkeys(choice.joint for choice in study.selected):
        loads_of_joint = [(load, conditions) for load, conditions in loads if load.joint == joint]
        components |= _select_pair(study, joint, loads_of_joint)
    return components


def _select_pair(
    study: Study, joint: str, loads: Sequence[tuple[JointLoad, Conditions]]
) -> dict[str, str]:
    """Select the motor and the gear of one joint.

    Parameters
    ----------
    study : Study
        Study with the required motor margin.
    joint : str
        Name of the joint.
    loads : sequence of (JointLoad, Conditions)
        Load of the joint in each motion, with the operating conditions.

    Returns
    -------
    dict
        Names of the selected motor and of the selected gear by the path of their choice.

    Raises
    ------
    CandidateRejected
        If no pair keeps the motor margin. The reason counts the pairs that each check rules out in
        the first motion.
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
    """Yield the pairs of motor and gear that keep the motor margin in every motion, by rank.

    Parameters
    ----------
    selections : sequence of JointSelection
        Judgement of all pairs for each motion.
    rank : str
        Quantity that ranks the pairs, such as "mass".
    margin : float
        Required motor margin, as a fraction of the limit.

    Yields
    ------
    gear, motor : int
        Indices of the pair in the lists of gears and motors.
    """
    # NaN marks a check whose margin is unknown.
    smallest = [np.nanmin(list(selection.margins.values()), axis=0) for selection in selections]
    # The value −1 marks a pair that a check excludes. 0 means unknown, and 1 means adequate.
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
    """Return the margins of those checks of a motor that must keep the required motor margin.

    A margin is the unused part of a limit, as a fraction of the limit. Checks whose margin could
    not be computed, for example because the motor file lacks a value, are left out.

    Parameters
    ----------
    verdict : MotorVerdict
        All checks of one motor in one motion.

    Returns
    -------
    list of float
        Margins of the checks `CHECKS_WITH_MARGIN`.
    """
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
    choice : Choice or None
        Choice of the study for this component.
    options : list of CatalogueEntry
        Name, motor or drive, and size of each entry of the choice. Without a choice, the only entry
        is the motor or drive of the robot file.
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
    """Return True if the results keep a motor margin, or if their motor margin is unknown.

    Parameters
    ----------
    results : mapping
        Results of a candidate. `motor_margin` is the smallest margin of its motors, or None.
    margin : float
        Required motor margin, as a fraction of the limit.
    """
    available = results["motor_margin"]
    return available is None or available >= margin


def _motion_results(problems: ProblemByMotion, motions: TrajectoryByMotion) -> JsonObject:
    """Return the durations of the motions, and the results for the motors, in SI units.

    Parameters
    ----------
    problems : ProblemByMotion
        Problem of each motion by name, with the robot that performs it.
    motions : TrajectoryByMotion
        Trajectory of each motion by name.

    Returns
    -------
    dict
        `duration.NAME` for each motion and their sum `duration` (s), the smallest motor margin, the
        largest peak and RMS torques (N·m) of each joint, the largest peak torque of all joints, and
        the mass of all motors (kg). Unknown values are None, for example the mass if one motor does
        not state it.
    """
    results: JsonObject = {}
    verdicts: list[MotorVerdict] = []
    for name, motion in motions.items():
        problem = problems[name]
        results[f"duration.{name}"] = motion.duration
        verdicts += size_motion(motion, problem.robot, pause_after_motion(problem)).verdicts
    results["duration"] = sum(motion.duration for motion in motions.values())
    margins: list[float] = []
    peak_torques = []
    masses: dict[str, float | None] = {}
    for verdict in verdicts:
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
    """Return the angles α and β between the joint axes and the ends of the tilt range, rad."""
    from ssm_planner.kinematics import Mechanism, tilt_interval

    mechanism = Mechanism.from_robot(problem.robot)
    low, high = tilt_interval(mechanism)
    return {"alpha": mechanism.alpha, "beta": mechanism.beta, "tilt_low": low, "tilt_high": high}
