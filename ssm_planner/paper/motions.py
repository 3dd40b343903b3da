"""Table III: tilt and insertion at the printed speeds, planned within them, and the motor torques that this predicts."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.task import task_rates
from ssm_planner.outcome import Plan
from ssm_planner.paper.published import TABLE_III, SpeedRow
from ssm_planner.problem.values import TASK, Problem, Robot, Target
from ssm_planner.run import plan
from ssm_planner.sizing.joint_load import JointLoad, joint_loads


@dataclass(frozen=True, eq=False)
class SpeedRun:
    """One row of Table III, planned; loads are those of the driven joints, empty without a plan."""

    row: SpeedRow
    plan: Plan
    loads: tuple[JointLoad, ...]

    def envelope(self, joint: str) -> tuple[float, float]:
        """Least and largest motor torque while the joint moves, N·m."""
        load = self.load(joint)
        torque = load.torque()[load.direction != 0]
        return float(torque.min()), float(torque.max())

    def load(self, joint: str) -> JointLoad:
        return next(load for load in self.loads if load.joint == joint)

    def reaches(self) -> bool:
        """Whether a rotary joint and the translation both come up to the printed speeds."""
        trajectory = self.plan.trajectory
        if trajectory is None:
            return False
        fastest = np.abs(trajectory.uniform(1000.0).qd).max(axis=0)
        return bool(fastest[:3].max() > 0.999 * self.row.tilt and fastest[3] > 0.999 * self.row.insertion)

    def tilt_rate(self, robot: Robot) -> float:
        """Largest tilt rate, rad/s."""
        trajectory = self.plan.trajectory
        if trajectory is None:
            return math.nan
        samples = trajectory.uniform(1000.0)
        rates = task_rates(Mechanism.from_geometry(robot.geometry), samples.q, samples.qd)
        return float(np.abs(rates[:, TASK.index("tilt")]).max())


def at_speeds(problem: Problem, row: SpeedRow) -> Problem:
    """The problem with every rotary joint limited to the printed rotary speed and joint 4 to the printed translation."""
    speed = {"revolute": row.tilt, "prismatic": row.insertion}
    first, second, third, fourth = (replace(joint, velocity=speed[joint.kind]) for joint in problem.robot.joints)
    robot = replace(problem.robot, joints=(first, second, third, fourth))
    return replace(problem, name=f"Table III, {row.label}", robot=robot)


def speed_runs(problem: Problem, progress: Callable[[str], None] = lambda _: None) -> tuple[SpeedRun, ...]:
    """All rows of Table III, planned within the published accelerations."""
    runs = []
    for row in TABLE_III:
        progress(f"Table III: {row.label}")
        here = at_speeds(problem, row)
        outcome = plan(here)
        loads = () if outcome.trajectory is None else joint_loads(outcome.trajectory, here.robot)
        runs.append(SpeedRun(row, outcome, loads))
    return tuple(runs)


def tilts_of(problem: Problem) -> tuple[float, float]:
    """Lower and upper tilt that the problem names, rad."""
    values = _values(problem, "tilt")
    return min(values), max(values)


def depth_of(problem: Problem) -> float:
    """Largest depth that the problem names, m."""
    return max(_values(problem, "depth"))


def _values(problem: Problem, name: str) -> list[float]:
    targets: list[Target] = [problem.start, *(motion.target for motion in problem.motion if motion.target is not None)]
    return [target.task[name] for target in targets if target.task is not None and name in target.task]
