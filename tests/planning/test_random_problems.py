"""Random motions of random robots: each ends in a passed certificate or a named reason."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.workspace import tilt_interval
from ssm_planner.problem.values import Body, Geometry, Joint, Motion, Problem, Robot, Target, frozen
from ssm_planner.run import plan

NAMED = {"motor torque", "position"}


def random_problem(base: Problem, seed: int) -> Problem:
    """One or two motions; any angles, mounting, speeds, motors; jerk limits in two of five."""
    rng = np.random.default_rng(seed)
    mechanism = Mechanism.from_angles(rng.uniform(0.15, 1.4), rng.uniform(0.3, 2.6))
    robot = _robot(base.robot, mechanism, rng)
    low, high = tilt_interval(Mechanism.from_geometry(robot.geometry))
    inset = 0.02 * (high - low)

    def point() -> dict[str, float]:
        tilt, depth = rng.uniform(low + inset, high - inset), rng.uniform(0, 0.03)
        return {"roll": rng.uniform(-0.5, 0.5), "tilt": tilt, "spin": rng.uniform(-1, 1), "depth": depth}

    def motion() -> Motion:
        name, task = str(rng.choice(["straight", "free", "tilt", "insert"])), point()
        if name in ("tilt", "insert"):
            key = {"tilt": "tilt", "insert": "depth"}[name]
            task = {key: task[key]}
        return Motion("free" if name == "free" else "straight", name, Target(task=task))

    motions = tuple(motion() for _ in range(rng.integers(1, 3)))
    tip_speed = 0.02 if rng.random() < 0.2 else None
    start = Target(task=point())
    return dataclasses.replace(
        base, robot=robot, start=start, motion=motions, limits={"depth": (0.0, 0.03)}, tip_speed=tip_speed
    )


def _robot(base: Robot, mechanism: Mechanism, rng: np.random.Generator) -> Robot:
    axes = (mechanism.omega1, mechanism.omega2, mechanism.omega3, mechanism.omega3)
    gravity = rng.normal(size=3)
    gravity *= 9.81 / np.linalg.norm(gravity)
    jerk = rng.random() < 0.4
    return dataclasses.replace(
        base,
        geometry=Geometry(mechanism.omega1, mechanism.omega2, mechanism.omega3, mechanism.tool_home),
        bodies=tuple(_body(body, axis, rng) for body, axis in zip(base.bodies, axes, strict=True)),
        joints=tuple(_joint(joint, jerk, rng) for joint in base.joints),
        gravity=frozen(gravity, (3,)),
        limits={},
    )


def _body(body: Body, axis: np.ndarray, rng: np.random.Generator) -> Body:
    x = np.cross(axis, rng.normal(size=3))
    x /= np.linalg.norm(x)
    scale = rng.uniform(0.3, 1.5)
    frame = frozen(np.column_stack([x, np.cross(axis, x), axis]), (3, 3))
    return dataclasses.replace(body, mass=scale * body.mass, inertia=scale * body.inertia, frame=frame)


def _joint(joint: Joint, jerk: bool, rng: np.random.Generator) -> Joint:
    acceleration = joint.acceleration * 10 ** rng.uniform(-0.7, 0.5)
    motor = joint.motor
    if motor is not None:
        motor = dataclasses.replace(motor, max_torque=motor.max_torque * 10 ** rng.uniform(-0.5, 0.2))
    return dataclasses.replace(
        joint,
        position=(-6.5, 6.5) if joint.kind == "revolute" else joint.position,
        velocity=joint.velocity * 10 ** rng.uniform(-0.5, 0.3),
        acceleration=acceleration,
        jerk=acceleration * 10 ** rng.uniform(0.5, 2) if jerk else None,
        motor=motor,
    )


@pytest.mark.parametrize("seed", range(1000, 1016))
def test_a_certificate_or_a_named_reason(tilt_insert: Problem, seed: int) -> None:
    result = plan(random_problem(tilt_insert, seed))
    if result.passed:
        assert min(limit.margin for limit in result.certificate.limits) >= -1e-6
        assert result.duration >= result.lower_bound * (1 - 1e-6)
    else:
        assert result.status == "infeasible"
        assert result.reason.constraint in NAMED
        assert result.reason.required > result.reason.available
