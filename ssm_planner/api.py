"""`check` and `size` as Python callers want them: of a plan, a file or a trajectory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ssm_planner.errors import TrajectoryError
from ssm_planner.formats.read import read_trajectory
from ssm_planner.loading.load import load_motor
from ssm_planner.plans import Plan, load_plan
from ssm_planner.problem.motor import Motor
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.sizing import size as sizing
from ssm_planner.sizing.duty import DutyCycle
from ssm_planner.sizing.motor_limits import Conditions
from ssm_planner.trajectory import Trajectory
from ssm_planner.verification import check as checking
from ssm_planner.verification.certificate import Certificate


def check(
    motion: Plan | Trajectory | str | Path, robot: Robot | None = None, limits: TaskLimits | None = None
) -> Certificate:
    """Certificate of a motion, found by code that did not plan it.

    motion: a plan, a trajectory, or a file that `ssm-planner check` reads. robot and limits: those of the plan unless given;
    a motion that is no plan needs a robot, and has its limits. Raises TrajectoryError or ProblemError.
    """
    if isinstance(motion, (str, Path)) and Path(motion).suffix.lower() != ".json":
        robot = _given(robot, motion)
        reading = read_trajectory(Path(motion), robot)
        limits = limits or TaskLimits(robot.limits)
        return checking.check(
            reading.trajectory, robot, limits, interpolation=reading.interpolation, resolution=reading.resolution
        )
    if isinstance(motion, Trajectory):
        robot = _given(robot, "a trajectory")
        return checking.check(motion, robot, limits or TaskLimits(robot.limits))
    plan = motion if isinstance(motion, Plan) else load_plan(motion)
    return checking.check(plan.motion, robot or plan.robot, limits or plan.limits)


def size(
    plan: Plan | str | Path,
    motors: Mapping[str, Sequence[Motor | str | Path]] | None = None,
    payload: float = 0.0,
    **conditions: Any,
) -> sizing.Sizing:
    """Which motors and gears a plan, or the plan in a plan.json, needs.

    motors: candidates by joint name, motor files or what they hold; joints not named there are judged with their own.
    payload: point mass at the tip, kg. conditions: fields of Conditions, SI: ambient, supply_voltage, current_limit, pause,
    confidence, draws, spread. Raises TrajectoryError or ProblemError.
    """
    motion = plan if isinstance(plan, Plan) else load_plan(plan)
    candidates = {
        joint: [motor if isinstance(motor, Motor) else load_motor(motor) for motor in listed]
        for joint, listed in (motors or {}).items()
    }
    duty = DutyCycle.of_trajectory(motion.motion, motion.robot, motion.problem.name if motion is plan else str(plan))
    return sizing.size(duty, candidates, Conditions(**conditions), payload)


def _given(robot: Robot | None, motion: str | Path) -> Robot:
    if robot is None:
        raise TrajectoryError(f"{motion}: does not say which robot it is for: give one")
    return robot
