"""Seeded random problems over random robots, and conditions that every plan of them must meet."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.inverse import inverse_task
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.kinematics.workspace import tilt_interval
from ssm_planner.planning.reason import Reason
from ssm_planner.plans import Plan
from ssm_planner.problem.limits import TASK_COORDINATES, TaskRange, TaskRate, TipSpeed
from ssm_planner.problem.motion import Dwell, Free, Motion, Scan, Straight, Task
from ssm_planner.problem.problem import Eye, Lens, Problem
from ssm_planner.problem.robot import Body, Geometry, Joint, Robot, read_only_array
from ssm_planner.problem.value import unchecked_copy
from ssm_planner.typing import Array

NAMED = {
    "motor torque", "position", "velocity", "acceleration", "duration", "direction", "retina clearance", "lens clearance",
    "continuous torque", "self-locking",
}  # fmt: skip
"""Constraints that a reason may name."""
DEPTH = (0.0, 0.03)
Point = Callable[[], dict[str, float]]


def random_problem(base: Problem, seed: int, most: int = 3) -> Problem:
    """Return a problem with one to `most` motions.

    Angles, mounting, speeds and motors are random. Other features of a problem occur occasionally.
    """
    rng = np.random.default_rng(seed)
    mechanism = Mechanism.from_angles(rng.uniform(0.15, 1.4), rng.uniform(0.3, 2.6))
    robot = _robot(base.robot, mechanism, rng)
    mechanism = Mechanism.from_geometry(robot.geometry)
    eye = _eye(mechanism, rng) if rng.random() < 0.15 else None
    point = _points(mechanism, eye is not None, rng)
    motions = [_motion(point, rng) for _ in range(rng.integers(1, most + 1))]
    if rng.random() < 0.1:
        motions.insert(int(rng.integers(len(motions) + 1)), Dwell(0.1))
    if eye is not None and rng.random() < 0.3:
        motions = [*motions[:1], _scan(point(), rng)]
    problem = dataclasses.replace(
        base,
        name=f"random {seed}",
        robot=robot,
        start=Task(**point()),
        motion=tuple(motions),
        limits=(
            TaskRange("depth", *DEPTH),
            *([TipSpeed(0.02)] if rng.random() < 0.2 else []),
            *(TaskRate(name, _rate(name, rng)) for name in TASK_COORDINATES if rng.random() < 0.12),
        ),
        eye=eye,
        objective="time" if rng.random() < 0.35 else "time then heat",
        file=None,
    )
    if rng.random() < 0.2:
        # The duration ranges from barely possible to slow.
        duration, fixed = (
            float(3 * 10 ** rng.uniform(-0.5, 1)),
            sum(motion.duration or 0.0 for motion in motions),
        )
        if duration > fixed and any(motion.duration is None for motion in motions):
            problem = dataclasses.replace(problem, objective="effort", duration=duration)
    return _with_end_rates(problem, rng)


def _points(mechanism: Mechanism, within_eye: bool, rng: np.random.Generator) -> Point:
    low, high = tilt_interval(mechanism)
    inset = (0.3 if within_eye else 0.02) * (high - low)
    turn = 0.25 if within_eye else 0.5
    depth = (0.002, 0.02) if within_eye else DEPTH

    def point() -> dict[str, float]:
        tilt = rng.uniform(low + inset, high - inset)
        return {
            "roll": rng.uniform(-turn, turn),
            "tilt": tilt,
            "spin": rng.uniform(-1, 1),
            "depth": rng.uniform(*depth),
        }

    return point


def _motion(point: Point, rng: np.random.Generator) -> Motion:
    name, task = str(rng.choice(["straight", "free", "free", "tilt", "insert"])), point()
    duration = float(2 * 10 ** rng.uniform(-0.5, 0.8)) if rng.random() < 0.08 else None
    if name in ("tilt", "insert"):
        key = {"tilt": "tilt", "insert": "depth"}[name]
        task = {key: task[key]}
    if name != "free":
        return Straight(**task, duration=duration, name=name)
    passed = (
        tuple(Task(**point()) for _ in range(rng.integers(1, 5))) if rng.random() < 0.35 else ()
    )
    return Free(Task(**task), passed, duration)


def _rate(name: str, rng: np.random.Generator) -> float:
    return float((0.02 if name == "depth" else 0.8) * 10 ** rng.uniform(-0.7, 0.3))


def _scan(at: dict[str, float], rng: np.random.Generator) -> Motion:
    kind, dwell = (
        str(rng.choice(["ring", "triple ring", "raster"])),
        0.05 if rng.random() < 0.3 else 0.0,
    )
    diameters = {"ring": (1e-3,), "triple ring": (1e-3, 2e-3, 3e-3), "raster": ()}[kind]
    rows, columns = (int(n) for n in rng.integers(1, 4, size=2)) if kind == "raster" else (0, 0)
    return Scan(
        Task(**{**at, "depth": None}), 2.5e-3, diameters, rows, columns, 1e-3, dwell, name=kind
    )


def _eye(mechanism: Mechanism, rng: np.random.Generator) -> Eye:
    """Return an eye around the middle of the workspace. In half of the cases it has a lens."""
    low, high = tilt_interval(mechanism)
    middle = inverse_task(mechanism, np.array([[0.0, (low + high) / 2, 0.0, 1.0]])).joints[0, 0]
    axis = tip_position(mechanism, middle[None, :])[0]
    radius = rng.uniform(0.0105, 0.013)
    side = np.cross(axis, rng.normal(size=3))
    side /= np.linalg.norm(side)
    # The port lies beside the axis of the eye, as in surgery.
    centre = radius * (np.cos(0.5) * axis + np.sin(0.5) * side)
    lens = None
    if rng.random() < 0.5:
        to_front = np.cos(0.9) * -axis + np.sin(0.9) * side
        to_front /= np.linalg.norm(to_front)
        across = np.cross(to_front, axis)
        across /= np.linalg.norm(across)
        frame = np.column_stack([across, np.cross(to_front, across), to_front])
        place = centre + 0.5 * radius * to_front
        lens = Lens(
            read_only_array(place, (3,)),
            read_only_array([3e-3, 3e-3, 1.5e-3], (3,)),
            read_only_array(frame, (3, 3)),
        )
    return Eye(
        read_only_array(centre, (3,)),
        radius,
        clearance=5e-4,
        port=3e-3,
        shaft_radius=2.5e-4,
        lens=lens,
    )


def _with_end_rates(problem: Problem, rng: np.random.Generator) -> Problem:
    """Add rates at the start and at the end, each with a probability of at most 0.1."""
    first, last = problem.motion[0], problem.motion[-1]
    if rng.random() < 0.1 and isinstance(first, Straight):
        way = {
            name: value - problem.start.set_coordinates[name]
            for name, value in first.to.set_coordinates.items()
        }
        problem = dataclasses.replace(
            problem, start_rate={name: 0.3 * x for name, x in way.items()}
        )
    if rng.random() < 0.1 and last.kind == "free":
        problem = dataclasses.replace(
            problem, end_rate={"depth": float(rng.choice([-0.004, 0.004]))}
        )
    return problem


def _robot(base: Robot, mechanism: Mechanism, rng: np.random.Generator) -> Robot:
    axes = (mechanism.omega1, mechanism.omega2, mechanism.omega3, mechanism.omega3)
    gravity = rng.normal(size=3)
    gravity *= 9.81 / np.linalg.norm(gravity)
    jerk = rng.random() < 0.4
    bodies = [_body(body, axis, rng) for body, axis in zip(base.bodies, axes, strict=True)]
    joints = [_joint(joint, jerk, rng) for joint in base.joints]
    return dataclasses.replace(
        base,
        geometry=Geometry(
            mechanism.omega1, mechanism.omega2, mechanism.omega3, mechanism.tool_home
        ),
        bodies=(bodies[0], bodies[1], bodies[2], bodies[3]),
        joints=(joints[0], joints[1], joints[2], joints[3]),
        gravity=read_only_array(gravity, (3,)),
        limits=(),
    )


def _body(body: Body, axis: Array, rng: np.random.Generator) -> Body:
    x = np.cross(axis, rng.normal(size=3))
    x /= np.linalg.norm(x)
    scale = rng.uniform(0.3, 1.5)
    frame = read_only_array(np.column_stack([x, np.cross(axis, x), axis]), (3, 3))
    return dataclasses.replace(
        body, mass=scale * body.mass, inertia=scale * body.inertia, frame=frame
    )


def _joint(joint: Joint, jerk: bool, rng: np.random.Generator) -> Joint:
    acceleration = joint.acceleration * 10 ** rng.uniform(-0.7, 0.5)
    motor = joint.motor
    if motor is not None:
        motor = unchecked_copy(motor, max_torque=motor.max_torque * 10 ** rng.uniform(-0.5, 0.2))
    return dataclasses.replace(
        joint,
        position=(-6.5, 6.5) if joint.kind == "revolute" else joint.position,
        velocity=joint.velocity * 10 ** rng.uniform(-0.5, 0.3),
        acceleration=acceleration,
        jerk=acceleration * 10 ** rng.uniform(0.5, 2) if jerk else None,
        motor=motor,
    )


def faults(problem: Problem, result: Plan) -> list[str]:
    """Return the faults of a plan as texts.

    A plan without faults is a motion as requested or has a named reason.
    """
    if result.reason is not None:
        return _faults_of_reason(result.reason)
    if result.trajectory is None or result.certificate is None or not result.passed:
        return ["neither a certificate nor a reason"]
    texts = []
    if min(limit.margin for limit in result.certificate.limits) < -1e-6:
        texts.append("passed with a limit exceeded")
    if result.trajectory.duration < (result.lower_bound or 0.0) * (1 - 1e-6):
        texts.append("shorter than its lower bound")
    duration = problem.duration
    if duration is not None and abs(result.trajectory.duration / duration - 1) > 1e-6:
        texts.append(
            f"takes {result.trajectory.duration:.9g} s instead of the {duration:.9g} s asked for"
        )
    return texts + _faults_of_ends(problem, result)


def _faults_of_reason(reason: Reason) -> list[str]:
    if reason.constraint not in NAMED:
        return [f"no named reason: {reason.message}"]
    values = reason.required, reason.available
    if None in values or not np.all(np.isfinite(np.array(values, dtype=float))):
        return [f"a reason without values: {reason.message}"]
    everywhere = reason.constraint in ("continuous torque", "duration")
    return (
        []
        if everywhere or reason.where is not None
        else [f"a reason without a place: {reason.message}"]
    )


def _faults_of_ends(problem: Problem, result: Plan) -> list[str]:
    """Return faults if the motion does not start or end as the problem specifies."""
    trajectory: Any = result.trajectory
    mechanism = Mechanism.from_geometry(problem.robot.geometry)
    first = trajectory.sample(trajectory.breaks[:1])
    last = trajectory.sample(trajectory.breaks[-1:], side="left")
    texts = []
    start = task_from_joints(mechanism, first.q)[0]
    for name, value in problem.start.set_coordinates.items():
        if abs(np.sin((start[TASK_COORDINATES.index(name)] - value) / 2)) > 1e-9:
            texts.append(f"begins at another {name}")
    end = task_from_joints(mechanism, last.q)[0]
    last_motion = problem.motion[-1]
    goal = last_motion.to.set_coordinates if isinstance(last_motion, (Straight, Free)) else {}
    for name, value in goal.items():
        if abs(np.sin((end[TASK_COORDINATES.index(name)] - value) / 2)) > 1e-9:
            texts.append(f"ends at another {name}")
    if not problem.start_rate and np.abs(first.qd).max() > 1e-9:
        texts.append("does not begin at rest")
    if not problem.end_rate and np.abs(last.qd).max() > 1e-9:
        texts.append("does not end at rest")
    return texts
