"""The doors for Python callers that take a plan, a file or a trajectory, and give what a command says as values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ssm_planner import stopping
from ssm_planner.comparison.compare import LAG, Comparison
from ssm_planner.comparison.compare import compare as compare_recordings
from ssm_planner.comparison.measured import assign, read_measured
from ssm_planner.errors import TrajectoryError
from ssm_planner.formats.read import read_trajectory
from ssm_planner.loading.load import load_motor
from ssm_planner.plans import Plan, load_plan
from ssm_planner.problem.motor import Motor
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.sizing.duty import DutyCycle, pause_of
from ssm_planner.sizing.motor_limits import Conditions
from ssm_planner.sizing.size import Sizing
from ssm_planner.sizing.size import size as size_duty
from ssm_planner.stopping import INSTANTS, Stops
from ssm_planner.trajectory import Trajectory
from ssm_planner.verification import check as checking
from ssm_planner.verification.certificate import Certificate
from ssm_planner.verification.slower import SLOWEST, SpeedRange, check_slower
from ssm_planner.verification.slower import check_speeds as check_every_speed


def check(
    motion: Plan | Trajectory | str | Path,
    robot: Robot | None = None,
    limits: TaskLimits | None = None,
    speed: float = 1.0,
) -> Certificate:
    """Certificate of a motion, found by code that did not plan it.

    motion: a plan, a trajectory, or a file that `ssm-planner check` reads. robot and limits: those of the plan unless given;
    a motion that is no plan needs a robot, and has its limits. It is at rest at both ends, unless the plan, the file or
    `limits` declare rates there. speed: share of its speed at which the motion is played; a file must then be a plan. Raises
    TrajectoryError or ProblemError.
    """
    if speed != 1.0:
        return check_slower(*_smooth(motion, robot, limits), speed)
    if isinstance(motion, (str, Path)) and Path(motion).suffix.lower() != ".json":
        robot = _given(robot, motion)
        reading = read_trajectory(Path(motion), robot)
        limits = reading.ends_on(limits or TaskLimits(robot.limits))
        found = checking.check(
            reading.trajectory,
            robot,
            limits,
            interpolation=reading.interpolation,
            resolution=reading.resolution,
        )
        return found.with_more(reading.checks)
    if isinstance(motion, Trajectory):
        robot = _given(robot, "a trajectory")
        return checking.check(motion, robot, limits or TaskLimits(robot.limits), seal=True)
    plan = motion if isinstance(motion, Plan) else load_plan(motion)
    limits = limits or plan.limits
    return checking.check(
        plan.motion,
        robot or plan.robot,
        limits if robot is None else limits.within(robot),
        seal=True,
    )


def check_speeds(
    motion: Plan | Trajectory | str | Path,
    robot: Robot | None = None,
    limits: TaskLimits | None = None,
    slowest: float = SLOWEST,
) -> SpeedRange:
    """Certificate of a motion at every share of its speed from `slowest` to 1, and the worst speed of every motor limit.

    motion, robot, limits: as for `check`; a file must be a plan. Raises TrajectoryError or ProblemError.
    """
    return check_every_speed(*_smooth(motion, robot, limits), slowest)


def controlled_stops(
    motion: Plan | Trajectory | str | Path,
    robot: Robot | None = None,
    limits: TaskLimits | None = None,
    instants: int = INSTANTS,
) -> Stops:
    """The quickest controlled stop along its path from every one of so many instants of a motion, and their certificate.

    motion, robot, limits: as for `check`; a file must be a plan. Raises TrajectoryError or ProblemError.
    """
    return stopping.controlled_stops(*_smooth(motion, robot, limits), instants)


def size(
    plan: Plan | str | Path,
    motors: Mapping[str, Sequence[Motor | str | Path]] | None = None,
    payload: float = 0.0,
    **conditions: Any,
) -> Sizing:
    """Which motors and gears a plan, or the plan in a plan.json, needs.

    motors: candidates by joint name, motor files or what they hold; joints not named there are judged with their own.
    payload: point mass at the tip, kg. conditions: fields of Conditions, SI: ambient, supply_voltage, current_limit, pause,
    confidence, draws, spread; the pause is that of the plan's duty unless given. Raises TrajectoryError or ProblemError.
    """
    motion = plan if isinstance(plan, Plan) else load_plan(plan)
    candidates = {
        joint: [motor if isinstance(motor, Motor) else load_motor(motor) for motor in listed]
        for joint, listed in (motors or {}).items()
    }
    duty = DutyCycle.of_trajectory(
        motion.motion, motion.robot, motion.problem.name if motion is plan else str(plan)
    )
    return size_duty(
        duty, candidates, Conditions(**{"pause": pause_of(motion.problem), **conditions}), payload
    )


def compare(
    plan: Plan | str | Path,
    recordings: Mapping[str, str | Path],
    counts_per_turn: int | None = None,
    lag: float = LAG,
) -> Comparison:
    """A plan against recordings of its execution, one for each axis: held, not held, or cannot tell, with the findings.

    recordings: EPOS recorder exports or CSV files by joint name, on one clock. counts_per_turn: increments per motor turn
    of a position channel, where the motor file gives no encoder_counts. lag: time by which a joint may be behind at its
    largest speed, s; a larger tracking error does not hold. Raises RecordingError, TrajectoryError or ProblemError.
    """
    plan = plan if isinstance(plan, Plan) else load_plan(plan)
    named = assign([f"{joint}={path}" for joint, path in recordings.items()], plan.robot)
    measured = [read_measured(path, plan.robot, joint, counts_per_turn) for joint, path in named]
    return compare_recordings(plan.motion, plan.robot, plan.certificate, measured, lag)


def report(
    plan: Plan | str | Path, path: str | Path | None = None, other: Plan | str | Path | None = None
) -> Path:
    """Write the page of a plan, or with `other` the page that compares the two; returns its path.

    path: default report.html or comparison.html beside the plan's plan.json. Raises ExportError, TrajectoryError or
    ProblemError.
    """
    from ssm_planner.reporting.html.compare import write_comparison
    from ssm_planner.reporting.html.report import write_report

    plan = plan if isinstance(plan, Plan) else load_plan(plan)
    if other is None:
        return write_report(
            plan, plan.path.with_name("report.html") if path is None else Path(path)
        )
    other = other if isinstance(other, Plan) else load_plan(other)
    return write_comparison(
        plan, other, plan.path.with_name("comparison.html") if path is None else Path(path)
    )


def _smooth(
    motion: Plan | Trajectory | str | Path, robot: Robot | None, limits: TaskLimits | None
) -> tuple[Trajectory, Robot, TaskLimits]:
    if isinstance(motion, Trajectory):
        robot = _given(robot, "a trajectory")
        return motion, robot, limits or TaskLimits(robot.limits)
    plan = motion if isinstance(motion, Plan) else load_plan(motion)
    limits = limits or plan.limits
    return plan.motion, robot or plan.robot, limits if robot is None else limits.within(robot)


def _given(robot: Robot | None, motion: str | Path) -> Robot:
    if robot is None:
        raise TrajectoryError(f"{motion}: does not say which robot it is for: give one")
    return robot
