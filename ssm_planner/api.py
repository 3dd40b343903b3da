"""Provide the public functions that accept a plan, a file or a trajectory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ssm_planner import stopping
from ssm_planner.arguments import checked
from ssm_planner.comparison.compare import DEFAULT_LAG, Comparison
from ssm_planner.comparison.compare import compare as compare_recordings
from ssm_planner.comparison.measured import assign_recordings, read_axis_recording
from ssm_planner.errors import ProblemError, TrajectoryError
from ssm_planner.formats import read_trajectory
from ssm_planner.loading import load_motor
from ssm_planner.plans import Plan, as_plan
from ssm_planner.problem import Motor, Robot, TaskLimits, check_mapping, field_hints
from ssm_planner.publishing import PLAN_FILE
from ssm_planner.sizing import Conditions, DutyCycle, Sizing, pause_after_motion
from ssm_planner.sizing.size import size as size_duty
from ssm_planner.stopping import INSTANTS, MAX_INSTANTS, Stops
from ssm_planner.trajectory import Trajectory
from ssm_planner.verification import DEFAULT_SLOWEST_SPEED, Certificate, SpeedRange, check_slower
from ssm_planner.verification import check as checking
from ssm_planner.verification.slower import check_speeds as check_every_speed


@checked
def check(
    motion: Plan | Trajectory | str | Path,
    robot: Robot | None = None,
    limits: TaskLimits | None = None,
    speed: float = 1.0,
) -> Certificate:
    """Check a motion by code that is independent of the planner, and return its certificate.

    Parameters
    ----------
    motion : Plan, Trajectory, str or Path
        Plan, trajectory, or a file that `ssm-planner check` reads.
    robot : Robot, optional
        Robot whose limits apply. The default is the robot of the plan. A motion without a plan
        needs a robot.
    limits : TaskLimits, optional
        Limits of the task. The default is the limits of the plan, or the ranges of the robot. The
        motion must be at rest at both ends unless the plan, the file or `limits` declare rates
        there.
    speed : float
        Playback speed as a fraction of the planned speed. For a value other than 1, a file must be
        a plan.

    Returns
    -------
    Certificate
        Margin and verdict of every limit.

    Raises
    ------
    TrajectoryError or ProblemError
        If the motion, the robot or the limits cannot be read.

    Examples
    --------
    >>> import numpy as np
    >>> from ssm_planner import Trajectory, check, load_robot
    >>> t = np.linspace(0, 2, 101)
    >>> q = np.outer(0.05 * (1 - np.cos(np.pi * t / 2)), [1, 1, 0, 0])
    >>> motion = Trajectory.from_samples(t, q)
    >>> certificate = check(motion, load_robot("vitreoretinal"))
    >>> certificate.verdict, round(certificate["velocity", "tilt"].margin, 3)
    ('kept', 0.931)
    """
    if speed != 1.0:
        return check_slower(*_motion_to_check(motion, robot, limits), speed)
    if isinstance(motion, (str, Path)):
        path = Path(motion)
        if path.suffix.lower() != ".json" and not (path / PLAN_FILE).is_file():
            robot = _require_robot(robot, path)
            reading = read_trajectory(path, robot)
            limits = reading.add_declared_rates(limits or TaskLimits(robot.limits))
            return reading.check(robot, limits)
    return checking.check(*_motion_to_check(motion, robot, limits), seal=True)


@checked
def check_speeds(
    motion: Plan | Trajectory | str | Path,
    robot: Robot | None = None,
    limits: TaskLimits | None = None,
    slowest: float = DEFAULT_SLOWEST_SPEED,
) -> SpeedRange:
    """Check a motion at playback speeds from `slowest` to 1.

    Friction can require more torque at low speeds, so a motion may exceed the limits of a motor
    only when it is played more slowly.

    Parameters
    ----------
    motion : Plan, Trajectory, str or Path
        Plan, trajectory, or the file of a plan.
    robot : Robot, optional
        Robot whose limits apply. The default is the robot of the plan. A trajectory needs a robot.
    limits : TaskLimits, optional
        Limits of the task. The default is the limits of the plan, or the ranges of the robot.
    slowest : float
        Smallest playback speed as a fraction of the planned speed.

    Returns
    -------
    SpeedRange
        Certificates at several speeds, and the worst speed of every motor limit.

    Raises
    ------
    TrajectoryError or ProblemError
        If the motion, the robot or the limits cannot be read.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> speeds = ssm.check_speeds("results/tilt_insert", slowest=0.1)
    >>> speeds.passed
    True
    """
    return check_every_speed(*_motion_to_check(motion, robot, limits), slowest)


@checked
def controlled_stops(
    motion: Plan | Trajectory | str | Path,
    robot: Robot | None = None,
    limits: TaskLimits | None = None,
    instants: int = INSTANTS,
) -> Stops:
    """Compute the quickest controlled stops along the path of a motion, and check them.

    A stop may be necessary at any instant. Each result belongs to one of many instants, which are
    distributed over the motion.

    Parameters
    ----------
    motion : Plan, Trajectory, str or Path
        Plan, trajectory, or the file of a plan.
    robot : Robot, optional
        Robot whose limits apply. The default is the robot of the plan. A trajectory needs a robot.
    limits : TaskLimits, optional
        Limits of the task. The default is the limits of the plan, or the ranges of the robot.
    instants : int
        Number of instants at which a stop begins.

    Returns
    -------
    Stops
        Durations and travels of the stops, with their certificate.

    Raises
    ------
    TrajectoryError or ProblemError
        If the motion, the robot or the limits cannot be read.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> stops = ssm.controlled_stops("results/tilt_insert", instants=100)
    >>> stops.passed, stops.duration.shape
    (True, (100,))
    """
    if not 1 <= instants <= MAX_INSTANTS:
        allowed = f"at least 1 and at most {MAX_INSTANTS}"
        raise ProblemError("invalid number", key="instants", value=instants, allowed=allowed)
    return stopping.controlled_stops(*_motion_to_check(motion, robot, limits), instants)


@checked
def size(
    plan: Plan | str | Path,
    motors: Mapping[str, Sequence[Motor | str | Path]] | None = None,
    payload: float = 0.0,
    **conditions: Any,
) -> Sizing:
    """Check which motors and gears suffice for a plan.

    Parameters
    ----------
    plan : Plan, str or Path
        Plan, or its plan.json.
    motors : mapping, optional
        Candidate motors by joint name, as motor files or Motor values. A joint without an entry is
        assessed with its present motor.
    payload : float
        Point mass at the tip (kg).
    **conditions
        Operating conditions and required confidence. The names are those of the fields of
        `Conditions`: ambient, supply_voltage, current_limit, pause, confidence, draws and spread.
        The values are in SI units. The default pause is that of the problem's duty.

    Returns
    -------
    Sizing
        Requirements, checks and verdicts of every joint.

    Raises
    ------
    TrajectoryError or ProblemError
        If the plan, a motor or a condition is invalid.

    Examples
    --------
    >>> import numpy as np
    >>> from ssm_planner import Plan, Trajectory, load_robot, size
    >>> t = np.linspace(0, 2, 101)
    >>> q = np.outer(0.05 * (1 - np.cos(np.pi * t / 2)), [1, 1, 0, 0])
    >>> motion = Trajectory.from_samples(t, q)
    >>> sizing = size(Plan.from_trajectory(motion, load_robot("vitreoretinal")))
    >>> [(verdict.joint, verdict.binds) for verdict in sizing.verdicts][0]
    ('roll', 'continuous_torque')
    """
    motion = as_plan(plan)
    candidates = {}
    for joint, items in (motors or {}).items():
        candidates[joint] = [
            item if isinstance(item, Motor) else load_motor(item) for item in items
        ]
    name = motion.problem.name if isinstance(plan, Plan) else str(plan)
    duty = DutyCycle.of_trajectory(motion.motion, motion.robot, name)
    check_mapping(conditions, tuple(field_hints(Conditions)), "size")
    conditions.setdefault("pause", pause_after_motion(motion.problem))
    return size_duty(duty, candidates, Conditions(**conditions), payload)


@checked
def compare(
    plan: Plan | str | Path,
    recordings: Mapping[str, str | Path],
    counts_per_turn: int | None = None,
    lag: float = DEFAULT_LAG,
    speed: float | None = None,
) -> Comparison:
    """Compare a plan with recordings of its execution, one for each axis.

    The verdict for each limit is "held", "not held" or "cannot tell".

    Parameters
    ----------
    plan : Plan, str or Path
        Plan, or its plan.json.
    recordings : mapping
        EPOS recorder exports or CSV files by joint name, with a common clock.
    counts_per_turn : int, optional
        Increments per motor turn of a position channel, if the motor file omits encoder_counts.
    lag : float
        Allowed delay of a joint at its largest speed, s. It limits the tracking error.
    speed : float, optional
        Speed at which the motion was meant to be executed, as a multiple of the planned speed, at
        most 1. The default is the planned speed.

    Returns
    -------
    Comparison
        Differences, limits, findings and the verdict.

    Raises
    ------
    RecordingError, TrajectoryError or ProblemError
        If a recording or the plan cannot be used.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> comparison = ssm.compare("results/tilt_insert", {"roll": "roll.csv"})  # doctest: +SKIP
    >>> comparison.verdict  # doctest: +SKIP
    """
    plan = as_plan(plan)
    texts = [f"{joint}={path}" for joint, path in recordings.items()]
    measured = [
        read_axis_recording(path, plan.robot, joint, counts_per_turn)
        for joint, path in assign_recordings(texts, plan.robot)
    ]
    return compare_recordings(plan.motion, plan.robot, plan.certificate, measured, lag, speed=speed)


@checked
def report(
    plan: Plan | str | Path, path: str | Path | None = None, other: Plan | str | Path | None = None
) -> Path:
    """Write the page of a plan, or a page that compares two plans, and return its path.

    Parameters
    ----------
    plan : Plan, str or Path
        Plan, or its plan.json.
    path : str or Path, optional
        File of the page if its name ends with .html, otherwise the folder of report.html or
        comparison.html. The default is the folder of the plan's plan.json. Only an earlier page of
        this program is replaced.
    other : Plan, str or Path, optional
        Plan to compare with.

    Returns
    -------
    Path
        File of the page.

    Raises
    ------
    ExportError, TrajectoryError or ProblemError
        If the page cannot be written, or if a plan cannot be read.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> from tempfile import mkdtemp
    >>> ssm.report("results/tilt_insert", mkdtemp() + "/report.html").name
    'report.html'
    """
    from ssm_planner.atomic import output_file
    from ssm_planner.reporting import write_comparison, write_report

    plan = as_plan(plan)
    default = plan.path.with_name("report.html" if other is None else "comparison.html")
    page = output_file(None if path is None else Path(path), ".html", default)
    if other is None:
        return write_report(plan, page)
    return write_comparison(plan, as_plan(other), page)


def _motion_to_check(
    motion: Plan | Trajectory | str | Path, robot: Robot | None, limits: TaskLimits | None
) -> tuple[Trajectory, Robot, TaskLimits]:
    """Return the trajectory, the robot and the limits of a motion.

    Parameters
    ----------
    motion : Plan, Trajectory, str or Path
        Trajectory, plan or the file of a plan, but not a table of samples.
    robot : Robot or None
        Robot whose limits apply. Without it, the robot of the plan applies.
    limits : TaskLimits or None
        Limits of the task. Without them, the limits of the plan apply, or for a trajectory the
        ranges of the robot.

    Returns
    -------
    (Trajectory, Robot, TaskLimits)
        Values for the check. If `robot` is given, the limits of a plan are combined with its
        ranges.

    Raises
    ------
    TrajectoryError
        If a trajectory lacks a robot.
    """
    if isinstance(motion, Trajectory):
        robot = _require_robot(robot, "a trajectory")
        return motion, robot, limits or TaskLimits(robot.limits)
    plan = as_plan(motion)
    limits = limits or plan.limits
    return plan.motion, robot or plan.robot, limits if robot is None else limits.within(robot)


def _require_robot(robot: Robot | None, motion: str | Path) -> Robot:
    """Return the robot, or raise an error if it is missing.

    Parameters
    ----------
    robot : Robot or None
        Argument of a public function.
    motion : str or Path
        Name of the motion for the message.

    Raises
    ------
    TrajectoryError
        If the robot is None.
    """
    if robot is None:
        if isinstance(motion, Path) and not motion.exists():
            raise TrajectoryError(f"{motion}: no such file or folder")
        raise TrajectoryError(f"{motion}: the file does not name a robot: pass robot")
    return robot
