"""The trajectory as CSV at a fixed rate, units in the header names."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ssm_planner.export.atomic import replacing
from ssm_planner.model.actuation import directions, motor_motion
from ssm_planner.model.rigid_body import RigidBody
from ssm_planner.model.trajectory import Trajectory
from ssm_planner.problem.values import Array, Robot

RATE = 1000.0


def trajectory_table(trajectory: Trajectory, robot: Robot, rate: float = RATE) -> tuple[list[str], Array]:
    """Header and rows: time, q, qd, qdd of joints 1 to 4; angle, speed and torque of every motor.

    At a break the row holds what follows it; the last row is the end of the motion, whatever the rate.
    """
    samples = trajectory.uniform(rate)
    after, before = (directions(robot, samples, side) for side in (1, -1))
    at_end = (samples.t == trajectory.breaks[-1])[:, None]
    direction = np.where(at_end, before[0], after[0])
    motor = motor_motion(robot, RigidBody.from_robot(robot), samples, direction, after[1] & ~at_end)
    header, columns = ["time_s"], [samples.t]
    for symbol, values, per in (("q", samples.q, ""), ("qd", samples.qd, "_per_s"), ("qdd", samples.qdd, "_per_s2")):
        for i, joint in enumerate(robot.joints):
            header.append(f"{symbol}{i + 1}_{'rad' if joint.kind == 'revolute' else 'm'}{per}")
            columns.append(values[:, i])
    for symbol, values, unit in (
        ("angle", motor.angle, "rad"),
        ("speed", motor.speed, "rad_per_s"),
        ("torque", motor.torque, "Nm"),
    ):
        for i, joint in enumerate(robot.joints):
            if joint.drive is not None:
                header.append(f"motor{i + 1}_{symbol}_{unit}")
                columns.append(values[:, i])
    return header, np.stack(columns, axis=1)


def write_csv(path: Path, trajectory: Trajectory, robot: Robot, rate: float = RATE) -> Path:
    """Write the table; 12 significant digits. Raises ExportError."""
    header, rows = trajectory_table(trajectory, robot, rate)
    with replacing(path) as temporary:
        np.savetxt(temporary, rows, fmt="%.12g", delimiter=",", header=",".join(header), comments="")
    return path
