"""`check` must read healthy files of every format and report no violation.

A few motions are exported repeatedly with other speeds, rates, counts per turn and columns.
"""

from __future__ import annotations

import dataclasses
import shutil
import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from .adversary import random_plans
from .rows import ROBOT, Count, Hang, Row, watchdog

SHARES = {"csv": 0.45, "plan": 0.35, "epos4": 0.1, "ros2": 0.08, "pvt": 0.02}
"""Fraction of the cases by format. A PVT table needs a search, which takes most of the time."""
SEEDS = (0, 1, 2, 3, 5, 8)
"""Seeds of random problems that have a fast plan."""
PERIODS = (2, 4, 5, 8, 10, 16, 20, 25, 40, 50)
"""Time between setpoints in ms."""
COUNTS = (512, 1024, 2000, 4096, 20000, 65536)
"""Increments per motor turn."""
FINE = (4096, 20000, 65536)
"""Increments per turn that are fine enough for a PVT table or a stream at a high rate."""
TRIALS = 20
"""Number of exports tried for one file. An export refuses options that do not fit the motion."""


def run(count: int, seed: int) -> list[Row]:
    """Check `count` files, divided among the formats."""
    with tempfile.TemporaryDirectory() as name:
        healthy = Healthy(Path(name), np.random.default_rng(seed))
        for form, share in SHARES.items():
            for _ in range(max(round(share * count), 1)):
                healthy.case(form)
        return [item.row for item in healthy.rows.values()]


@lru_cache(maxsize=1)
def plans() -> tuple[tuple[Any, Any, Any], ...]:
    """Return robot, motion and limits of planned motions.

    They are the shipped plan, and random plans of the shipped robot and of other robots.
    """
    import ssm_planner as ssm
    from ssm_planner.pipeline.run import plan
    from ssm_planner.problem import unchecked_copy
    from tests.support.plans import NONE
    from tests.support.random_problems import random_problem

    robot = ssm.load_robot(ROBOT)
    base = ssm.load_problem(ROBOT.parents[1] / "tilt_insert.yaml")
    shipped = ssm.load_plan(ROBOT.parents[2] / "results/tilt_insert")
    output = [(robot, motion, NONE) for motion in (shipped.motion, *random_plans())]
    for seed in SEEDS:
        problem = unchecked_copy(random_problem(base, seed, most=2), planner="fast")
        result = plan(problem, relaxations=False)
        motors = [joint.motor for joint in result.robot.joints if joint.motor is not None]
        # a robot file requires this
        if all(motor.nominal_torque <= motor.max_torque for motor in motors):
            output.append((result.robot, result.motion, of_still(result.limits, at_ends=False)))
    return tuple(output)


def of_still(limits: Any, at_ends: bool = True) -> Any:
    """Return the limits without those of the kinds of motions, which rows cannot keep.

    `at_ends` also removes the rates at the start and the end.
    """
    more = {"start_rate": {}, "end_rate": {}} if at_ends else {}
    return dataclasses.replace(limits, motion=(), **more)


class Healthy:
    """Exports motions with random options and checks the files."""

    def __init__(self, folder: Path, rng: np.random.Generator) -> None:
        self.folder, self.rng = folder, rng
        self.rows = {form: Count(f"healthy: {form}") for form in SHARES}

    def case(self, form: str) -> None:
        """Export and check one file."""
        from ssm_planner.errors import ExportError

        for _ in range(TRIALS):
            plan = self.plan()
            options = self.options(form)
            target = self.folder / form
            shutil.rmtree(target, ignore_errors=True)
            try:
                path = self.written(plan, form, target, options)
            except (
                ExportError
            ):  # No table or stream of this motion keeps the limits, so there is no file.
                continue
            fault = self.judged(plan, path)
            text = f"{plan.problem.name}, {plan.motion.duration:.6f} s, {options}: {fault}"
            self.rows[form].add(fault and text)
            return
        self.rows[form].add(f"no export with {TRIALS} sets of options")

    def plan(self) -> Any:
        """Return a plan that was written and read again.

        It is a planned motion, possibly slowed down, or a simple move of the shipped robot.
        """
        from tests.support.plans import NONE, of_task, read_back, smooth, trapezoids

        rng, result = self.rng, plans()
        path = self.folder / "plan.json"
        if rng.random() < 0.5:
            robot, motion, limits = result[int(rng.integers(len(result)))]
            still = not (limits.start_rate or limits.end_rate)
            if still and rng.random() < 0.7:
                motion, limits = motion.slower(float(rng.uniform(0.3, 1.0))), of_still(limits)
            return read_back(path, robot, motion, limits=limits)
        robot = result[0][0]
        moves = rng.uniform((-0.5, -0.2, -0.5, -0.006), (0.5, 0.15, 0.5, -0.001), (2, 4))
        moves *= rng.random((2, 4)) < 0.7
        moves[0, 0] += 0.01
        make: Callable[..., Any] = trapezoids if rng.random() < 0.6 else smooth
        motion = make(
            robot, tuple(moves[np.abs(moves).max(axis=1) > 0]), float(rng.uniform(0.2, 0.6))
        )
        return read_back(
            path, robot, motion, limits=of_task(tip_speed=0.5) if rng.random() < 0.3 else NONE
        )

    def options(self, form: str) -> dict[str, Any]:
        """Return random options of an export."""
        rng = self.rng
        counts = int(rng.choice(COUNTS))
        if form == "csv":
            way = rng.random()
            groups = list(
                rng.permutation(["qd", "qdd", "qddd", "angle", "speed", "torque", "task"])
            )
            if way < 0.35:  # only the rows that the limits require, joined as the columns allow
                return {}
            if way < 0.7:  # rows at a rate, joined by straight lines
                return {
                    "rate": float(np.exp(rng.uniform(np.log(5), np.log(1000)))),
                    "columns": ["q"],
                }
            if way < 0.85:
                others = [str(g) for g in groups if g not in ("qd", "qdd", "qddd")]
                return {"columns": ["q", *others[: int(rng.integers(4))]]}
            return {
                "columns": ["q", "counts"],
                "counts_per_turn": counts,
                "rate": float(rng.choice((50.0, 100.0, 250.0))),
            }
        if form == "ros2":
            return {
                "bag": bool(rng.random() < 0.4),
                "rate": float(rng.choice((1.0, 5.0, 20.0))),
                "effort": bool(rng.random() < 0.3),
            }
        if form == "epos4":
            period = int(rng.choice(PERIODS))
            return {
                "rate": 1000 / period,
                "counts_per_turn": int(rng.choice(FINE)) if period < 4 else counts,
            }
        if form == "pvt":
            return {"counts_per_turn": int(rng.choice(FINE))}
        return {}

    def written(self, plan: Any, form: str, target: Path, options: dict[str, Any]) -> Path:
        """Write the file or folder, and return the path that is checked."""
        from ssm_planner.errors import ExportError
        from ssm_planner.formats.export import export

        if form == "plan":
            if not plan.passed:
                raise ExportError("not healthy")
            return self.folder / "plan.json"
        export(plan, form, target, **options)
        if form == "ros2":
            choices = [target, target / "goal.yaml", target / "joint_trajectory.yaml"]
            choices += [target / "bag"] * (target / "bag").exists()
            return choices[int(self.rng.integers(len(choices)))]
        return target

    def judged(self, plan: Any, path: Path) -> str | None:
        """Return the reason if a healthy file is not accepted, or None."""
        from ssm_planner.cli import check as command
        from ssm_planner.errors import SsmPlannerError
        from ssm_planner.formats.read import read_trajectory

        try:
            with watchdog():
                if path.suffix == ".json":
                    reading, robot, limits = command.read_with_robot(path, None)
                else:
                    robot = plan.robot
                    reading = read_trajectory(path, robot)
                    declared = plan.limits
                    if path.is_dir() and not (path / "metadata.yaml").exists():
                        declared = dataclasses.replace(declared, start_rate={}, end_rate={})
                    limits = declared
                certificate = reading.check(robot, reading.add_declared_rates(limits))
        except SsmPlannerError as error:
            return f"refused: {error}"
        except Hang:
            return "hangs"
        if not certificate.violations:
            return None
        worst = certificate.worst
        return f"{certificate.verdict}: {worst.name} of {worst.joint} {worst.margin:.3e} at {worst.time:.6f} s"
