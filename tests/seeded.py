"""Trajectories with one limit that is exceeded between two samples only, found by dense evaluation with the model."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from ssm_planner.model.actuation import directions, motor_motion
from ssm_planner.model.forward import tip_velocity
from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.rigid_body import RigidBody
from ssm_planner.model.task import task_from_joints
from ssm_planner.model.trajectory import Samples, Trajectory
from ssm_planner.problem.values import Range, Robot
from ssm_planner.verify.interpolation import Points, join_points

EXCESS = 1e-3
KINDS = ["position", "velocity", "acceleration", "jerk", "motor speed", "motor torque", "tilt range", "tip speed"]
DRIVEN = (0, 1, 3)
SCALE = np.array([1.0, 1.0, 1.0, 0.03])
LOOSE = 1e3
"""Limits that are not meant are so many times as far."""
INTERVALS = 24
DENSE = 400


@dataclass(frozen=True, eq=False)
class Case:
    """A trajectory, the largest value of one limited quantity, and the interval of samples that holds it."""

    trajectory: Trajectory
    robot: Robot
    limit: tuple[str, str | None]
    joint: int
    largest: float
    interval: tuple[float, float]

    def with_limit(self, factor: float) -> Robot:
        """The robot with this limit at `factor` times the largest value, all others loose."""
        name, bound = self.limit[0], self.largest * factor
        joints = []
        for i, joint in enumerate(self.robot.joints):
            here = i == self.joint
            values = {
                "position": (-LOOSE, bound) if here and name == "position" else (-LOOSE, LOOSE),
                "velocity": bound if here and name == "velocity" else LOOSE,
                "acceleration": bound if here and name == "acceleration" else LOOSE,
                "jerk": bound if here and name == "jerk" else 1e6,
            }
            motor = joint.motor
            if motor is not None:
                speed = bound if here and name == "motor speed" else 1e6
                torque = bound if here and name == "motor torque" else LOOSE
                motor = dataclasses.replace(motor, max_speed=speed, max_torque=torque)
            joints.append(dataclasses.replace(joint, motor=motor, **values))
        return dataclasses.replace(self.robot, joints=tuple(joints))

    def task(self, factor: float) -> tuple[dict[str, Range], float | None]:
        """(ranges, tip speed); a range excess counts by its half width, here 1 rad."""
        bound = self.largest * factor
        if self.limit[0] == "tilt range":
            high = self.largest - (1 if factor < 1 else -1) * EXCESS
            return {"tilt": (high - 2.0, high)}, None
        return {}, bound if self.limit[0] == "tip speed" else None


def seeded(rng: np.random.Generator, robot: Robot, kind: str) -> Case:
    """A random motion through samples, one of them with an acceleration of its own, so that a value has its peak between."""
    joint = int(rng.choice(DRIVEN)) if kind.startswith("motor") else int(rng.integers(4))
    joint = -1 if kind in ("tilt range", "tip speed") else joint
    while True:
        trajectory = _motion(rng, robot)
        values = _values(trajectory, robot, kind, joint)
        k, s = np.unravel_index(int(np.argmax(values)), values.shape)
        at_samples = values[:, [0, -1]].max()
        largest = float(values[k, s])
        others = np.delete(values, k, axis=0).max()
        margin = EXCESS * (1.0 if kind in ("tilt range",) else abs(largest))
        # the peak is inside one interval, and that interval alone exceeds the limit
        if largest > 0 or kind == "tilt range":
            inside = largest - max(at_samples, others) > 1.5 * margin
            if kind == "jerk" or inside:
                pass
            else:
                continue
            if kind == "jerk" and largest - others <= 1.5 * margin:
                continue
            names = [each.name for each in robot.joints]
            interval = (float(trajectory.breaks[k]), float(trajectory.breaks[k + 1]))
            return Case(trajectory, robot, (kind, None if joint < 0 else names[joint]), joint, largest, interval)


def _motion(rng: np.random.Generator, robot: Robot) -> Trajectory:
    t = np.linspace(0.0, rng.uniform(0.3, 1.0), INTERVALS + 1)
    rate, phase = rng.uniform(1.0, 6.0, (2, 4)), rng.uniform(0, 2 * np.pi, (2, 4))
    angle = t[:, None, None] * rate + phase
    size = rng.uniform(0.1, 0.3, (2, 4)) * SCALE / 2
    q = (np.sin(angle) * size).sum(axis=1) + np.array([0.0, 0.6, 0.0, -0.015])
    qd = (np.cos(angle) * rate * size).sum(axis=1)
    qdd = -(np.sin(angle) * rate**2 * size).sum(axis=1)
    k = int(rng.integers(3, INTERVALS - 2))
    h = t[1]
    # a sample with a velocity and an acceleration of its own bends the intervals beside it
    qd[k] += rng.normal(size=4) * np.abs(q[k + 1] - q[k - 1]) / h * 0.3
    qdd[k] += rng.normal(size=4) * (np.abs(qdd).max(axis=0) + np.abs(qd).max(axis=0) / h)
    return join_points(Points(t, q, qd, qdd), robot).trajectory


def _values(trajectory: Trajectory, robot: Robot, kind: str, joint: int) -> np.ndarray:
    """What the limit bounds from above, (intervals, DENSE), by the model's own functions."""
    count = len(trajectory.breaks) - 1
    piece = np.repeat(np.arange(count), DENSE)
    local = np.tile(np.linspace(0.0, 1.0, DENSE), count) * np.diff(trajectory.breaks)[piece]
    s = trajectory.sample_pieces(piece, local)
    fields = {"velocity": s.qd, "acceleration": s.qdd, "jerk": s.qddd}
    if kind == "position":
        values = s.q[:, joint] - (0.0 if joint < 3 else -1.0)
        values = s.q[:, joint]
    elif kind in fields:
        values = np.abs(fields[kind][:, joint])
    elif kind.startswith("motor"):
        values = _motor(s, robot, kind, joint)
    elif kind == "tilt range":
        values = task_from_joints(Mechanism.from_geometry(robot.geometry), s.q)[:, 1]
    else:
        mechanism = Mechanism.from_geometry(robot.geometry)
        values = np.linalg.norm(tip_velocity(mechanism, s.q, s.qd), axis=1)
    return values.reshape(count, DENSE)


def _motor(s: Samples, robot: Robot, kind: str, joint: int) -> np.ndarray:
    direction, breakaway = directions(robot, s, 1)
    motor = motor_motion(robot, RigidBody.from_robot(robot), s, direction, breakaway)
    return np.abs((motor.speed if kind == "motor speed" else motor.torque)[:, joint])
