"""The bound on the tip error is compared with closed forms and Monte Carlo draws.

The draws use the complete kinematics.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ssm_planner import Plan, fk, load_plan
from ssm_planner.dynamics import RigidBody
from ssm_planner.problem import Gearhead, Robot
from ssm_planner.problem.value import unchecked_copy
from ssm_planner.sizing.tip_error import tip_error
from tests.support.paths import ROOT

FIGURES = {
    "roll": (4e-4, 2e-4, 1e-4, 900.0),
    "tilt": (3e-4, 3e-4, 1e-4, 700.0),
    "spin": (1e-3, 1e-3, 1e-3, 20.0),
    "insertion": (3e-5, 2e-5, 1e-5, 2e5),
}
"""Backlash, homing error and tracking error (rad or m) and stiffness (N·m/rad or N/m) by joint."""


@cache
def made() -> Plan:
    return load_plan(ROOT / "results/tilt_insert")


def accurate(**changes: float) -> Robot:
    """Return the robot of the plan with stated error figures of all joints.

    The keyword arguments replace figures of every joint.
    """
    joints = []
    for joint in made().robot.joints:
        backlash, homing, tracking, stiffness = FIGURES[joint.name]
        motor = joint.motor and unchecked_copy(joint.motor, encoder_counts=500, placeholders=())
        values = {
            "backlash": backlash,
            "homing_error": homing,
            "tracking_error": tracking,
            "stiffness": stiffness,
        }
        joints.append(unchecked_copy(joint, motor=motor, **{**values, **changes}))
    return unchecked_copy(made().robot, joints=tuple(joints))


def monte_carlo(robot: Robot, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw random joint errors, and return the largest errors of tip position and orientation.

    Both results have the shape (count,). Positions are in m and angles in rad.
    """
    rng = np.random.default_rng(7)
    times = np.linspace(0.0, made().motion.duration, 60)
    samples = made().motion.sample(times)
    effort = RigidBody.from_robot(robot).inverse_dynamics(samples.q, samples.qd, samples.qdd)
    bent = samples.q + effort / np.array([joint.stiffness for joint in robot.joints])
    pose = fk(robot, samples.q)
    rotations, tips = pose.rotation, pose.position
    largest = np.zeros((2, count))
    for k in range(count):
        error = np.zeros(4)
        for i, joint in enumerate(robot.joints):
            halves = [joint.homing_error, joint.tracking_error]
            if joint.motor is not None:
                halves.append(np.pi / (4 * joint.motor.encoder_counts) / joint.drive.ratio)
            error[i] = sum(rng.uniform(-half, half) for half in halves)
            error[i] += joint.backlash / 2 * rng.choice([-1.0, 1.0])
        pose = fk(robot, bent + error)
        turned, moved = pose.rotation, pose.position
        largest[0, k] = np.linalg.norm(moved - tips, axis=1).max()
        cosine = (np.einsum("nij,nij->n", turned, rotations) - 1) / 2
        largest[1, k] = np.arccos(np.clip(cosine, -1.0, 1.0)).max()
    return largest[0], largest[1]


def test_99_of_100_errors_are_below_the_bound_and_the_bound_is_close() -> None:
    robot = accurate()
    result = tip_error(made().motion, robot)
    assert not result.missing
    for bound, errors in zip((result.bound, result.angle), monte_carlo(robot, 1000), strict=True):
        assert bound is not None
        assert np.mean(errors <= bound) >= 0.985
        assert bound <= 1.3 * np.quantile(errors, 0.99)


def test_a_homing_error_of_the_sliding_joint_is_the_tip_error() -> None:
    robot = accurate(backlash=0.0, homing_error=0.0, tracking_error=0.0, stiffness=1e12)
    joints = [
        unchecked_copy(
            joint, motor=joint.motor and unchecked_copy(joint.motor, encoder_counts=10**9)
        )
        for joint in robot.joints
    ]
    joints[3] = unchecked_copy(joints[3], homing_error=1e-4)
    result = tip_error(made().motion, unchecked_copy(robot, joints=tuple(joints)))
    assert result.sources[0].name == "homing error"
    assert result.sources[0].tip == pytest.approx(1e-4, rel=1e-9)
    assert result.bound == pytest.approx(1e-4, rel=0.02)
    assert result.angle == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize("factor", [0.5, 3.0])
def test_the_bound_is_proportional_to_the_errors(factor: float) -> None:
    base, scaled = accurate(), accurate()
    joints = tuple(
        unchecked_copy(
            joint,
            backlash=factor * joint.backlash,
            homing_error=factor * joint.homing_error,
            tracking_error=factor * joint.tracking_error,
            stiffness=joint.stiffness / factor,
            motor=joint.motor
            and unchecked_copy(joint.motor, encoder_counts=joint.motor.encoder_counts / factor),
        )
        for joint in scaled.joints
    )
    results = [
        tip_error(made().motion, robot) for robot in (base, unchecked_copy(scaled, joints=joints))
    ]
    assert results[1].bound == pytest.approx(factor * results[0].bound, rel=1e-9)


@pytest.mark.parametrize("figure", ["backlash", "homing_error", "tracking_error", "stiffness"])
def test_a_missing_figure_makes_the_bound_unknown(figure: str) -> None:
    robot = accurate()
    joints = (robot.joints[0], unchecked_copy(robot.joints[1], **{figure: None}), *robot.joints[2:])
    result = tip_error(made().motion, unchecked_copy(robot, joints=joints))
    assert result.missing == (f"tilt: {figure.replace('_', ' ')}",)
    assert result.bound is None
    assert result.stated > 0


def test_a_placeholder_of_the_encoder_counts_as_missing() -> None:
    result = made().tip_error
    assert result is not None
    assert "roll: encoder" in result.missing
    assert result.bound is None
    assert not any(source.name == "encoder" for source in result.sources)


def test_the_plan_states_the_tip_error() -> None:
    plan = replace(made(), problem=unchecked_copy(made().problem, robot=accurate()))
    entry = plan.summary()["tip_error"]
    assert entry["bound"] == plan.tip_error.bound
    assert entry["sources"][0]["tip"] >= entry["sources"][-1]["tip"]


def test_the_backlash_of_a_gearhead_counts_at_the_joint():
    robot = accurate()
    drive = robot.joints[0].drive
    head = Gearhead("head", 5.0, 0.8, backlash=0.2)
    staged = unchecked_copy(drive, gearhead=head, ratio=5.0 * drive.ratio)
    joints = (unchecked_copy(robot.joints[0], drive=staged), *robot.joints[1:])
    error = tip_error(made().motion, unchecked_copy(robot, joints=joints))
    (source,) = (source for source in error.sources if source.name == "gearhead backlash")
    assert source.error == pytest.approx(0.1 / drive.ratio)
    assert error.bound > tip_error(made().motion, robot).bound
    unknown = unchecked_copy(staged, gearhead=replace(head, backlash=None))
    joints = (unchecked_copy(robot.joints[0], drive=unknown), *robot.joints[1:])
    error = tip_error(made().motion, unchecked_copy(robot, joints=joints))
    assert error.bound is None
    assert error.missing == ("roll: gearhead backlash",)
