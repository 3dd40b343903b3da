"""The torque of a drive with efficiencies depends on the direction of power.

Motions of robots with such drives are planned up to the limits of their motors.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.transmission import breakaway_torque, holding_torque, motor_torque
from ssm_planner.errors import ProblemError
from ssm_planner.loading.load import load_drive, load_problem, load_robot
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.planner import plan_motion
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.motion import Straight
from ssm_planner.problem.problem import Problem
from ssm_planner.sizing.joint_load import joint_loads
from ssm_planner.sizing.requirements import torque_split

COMMON = "name: {kind} drive\nkind: {kind}\nsource: assumed\ninput_inertia: 1e-6 kg*m^2\noutput_inertia: 0 {inertia}\n"


def drive(folder: Path, kind: str, more: str = "", inertia: str = "kg*m^2") -> Drive:
    (folder / "drive.yaml").write_text(
        COMMON.format(kind=kind, inertia=inertia) + more, encoding="utf-8"
    )
    return load_drive(folder / "drive.yaml")


@pytest.mark.parametrize(
    ("kind", "geometry", "ratio"),
    [
        ("gear", "geometry: {ratio: 111}", 111.0),
        ("belt", "geometry: {ratio: 4.5}", 4.5),
        ("cable", "geometry: {ratio: 20}", 20.0),
        ("ball_screw", "geometry: {lead: 2 mm}", 2 * np.pi / 0.002),
        ("cable_slide", "geometry: {pulley_diameter: 20 mm, ratio: 5}", 5 / 0.010),
        ("cable_slide", "geometry: {pulley_diameter: 20 mm}", 1 / 0.010),
    ],
)
def test_the_torque_by_the_direction_of_power(
    tmp_path: Path, kind: str, geometry: str, ratio: float
) -> None:
    friction = "\nfriction: {efficiency: 0.9, backward_efficiency: 0.7, b_c: 1 mN*m, b_v: 2e-6 N*m*s/rad}\n"
    result = drive(
        tmp_path, kind, geometry + friction, "kg" if kind.endswith(("screw", "slide")) else "kg*m^2"
    )
    assert result.ratio == pytest.approx(ratio)
    assert not result.self_locking
    rng = np.random.default_rng(3)
    F, w, wd = rng.uniform(-3, 3, 500), rng.uniform(-200, 200, 500), rng.uniform(-500, 500, 500)
    # Either the motor drives the load, or the load drives the motor.
    share = np.where(F * w > 0, 1 / 0.9, 0.7)
    expected = 1e-6 * wd + 1e-3 * np.sign(w) + 2e-6 * w + share * F / ratio
    assert np.asarray(motor_torque(result, F, w, wd)) == pytest.approx(expected, rel=1e-12)
    # Breakaway adds the losses to the load, and holding needs only the load minus the losses.
    assert breakaway_torque(result, 2.0, 1) == pytest.approx(2 / (0.9 * ratio) + 1e-3)
    assert holding_torque(result, 2.0) == pytest.approx(max(0.7 * 2 / ratio - 1e-3, 0.0))


def test_a_direct_drive_without_friction_gives_what_the_load_takes(tmp_path: Path) -> None:
    result = drive(tmp_path, "direct")
    assert (result.ratio, result.friction.mu) == (1.0, 0.0)  # type: ignore[union-attr]
    assert motor_torque(result, 0.3, -2.0, 5.0) == pytest.approx(0.3 + 5e-6)
    assert holding_torque(result, 0.3) == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("kind", "more", "message"),
    [
        ("gear", "", ":1: geometry: missing"),
        (
            "gear",
            "geometry: {ratio: 10}\nfriction: {efficiency: 1.1}\n",
            ":7: friction.efficiency = 1.1: too large",
        ),
        ("gear", "geometry: {ratio: 10}\nfriction: {efficiency: 0}\n", "not greater than zero"),
        ("gear", "geometry: {ratio: 10}\nfriction: {mu: 0.1}\n", "unknown key"),
        ("gear", "geometry: {ratio: 10}\nself_locking: required\n", "unknown key"),
        ("direct", "geometry: {ratio: 1}\n", "unknown key"),
        ("direct", "friction: {efficiency: 0.9}\n", "unknown key"),
        ("ball_screw", "geometry: {lead: 2 deg}\n", "geometry.lead"),
    ],
)
def test_mistakes_in_a_file(tmp_path: Path, kind: str, more: str, message: str) -> None:
    """A mistake in a drive file is refused with a message that describes it."""
    with pytest.raises(ProblemError) as caught:
        drive(tmp_path, kind, more, "kg" if kind == "ball_screw" else "kg*m^2")
    assert message in str(caught.value)


def test_no_such_drive_locks_itself_or_moves_a_joint_of_the_other_kind() -> None:
    robot = load_robot("raven_like")
    cable, slide = robot.joints[0].drive, robot.joints[3].drive
    assert cable is not None
    with pytest.raises(ProblemError, match="a cable drive is not self-locking"):
        replace(cable, self_locking=True)
    with pytest.raises(
        ProblemError,
        match=r"does not fit a revolute joint \(allowed: worm, direct, gear, belt, cable\)",
    ):
        replace(robot.joints[0], drive=slide)


def with_motors(problem: Problem, **largest: float) -> Problem:
    joints: list[Any] = [
        replace(
            joint,
            motor=replace(
                joint.motor, max_torque=largest[joint.name], nominal_torque=largest[joint.name]
            ),
        )
        if joint.name in largest and joint.motor is not None
        else joint
        for joint in problem.robot.joints
    ]
    return replace(problem, robot=replace(problem.robot, joints=tuple(joints)))


@pytest.mark.parametrize(
    ("name", "largest"),
    [
        ("raven_reach", {"roll": 0.010, "tilt": 0.005}),
        # The drive of joint spin states no friction.
        ("direct_reach", {"roll": 0.0055, "spin": 0.0001}),
    ],
)
def test_shipped_robots_are_planned_to_the_limits_of_weaker_motors(
    name: str, largest: dict[str, float]
) -> None:
    problem = replace(load_problem(name), planner="fast")
    weak = plan(with_motors(problem, **largest))
    assert weak.passed, weak.reason
    assert weak.trajectory is not None
    # The reference torque follows from rigid-body dynamics and the stated efficiencies alone.
    samples = weak.trajectory.sample(np.linspace(0.0, weak.trajectory.duration, 20001)[1:-1])
    robot = weak.problem.robot
    load = RigidBody.from_robot(robot).inverse_dynamics(samples.q, samples.qd, samples.qdd)
    for i, joint in enumerate(robot.joints):
        own = joint.drive
        assert own is not None
        assert own.friction is not None
        assert joint.motor is not None
        qd, qdd = samples.qd[:, i], samples.qdd[:, i]
        F = load[:, i] + own.output_inertia * qdd
        share = np.where(
            F * qd > 0, 1 / own.dimensions["efficiency"], own.dimensions["backward_efficiency"]
        )
        torque = (
            own.input_inertia * own.ratio * qdd
            + own.friction.b_c * np.sign(qd)
            + own.friction.b_v * own.ratio * qd
        )
        torque = np.where(np.abs(qd) > 1e-9, torque + share * F / own.ratio, 0.0)
        peak = float(np.abs(torque).max())
        assert peak <= joint.motor.max_torque * (1 + 1e-5)
        if joint.name in largest:
            assert peak > 0.98 * joint.motor.max_torque


def test_the_breakdown_of_the_torque_counts_lost_power_as_friction_of_the_mesh() -> None:
    result = plan_motion(
        replace(load_problem("raven_reach"), planner="toppra", motion=(Straight(roll=0.3),))
    )
    assert result.trajectory is not None
    load = joint_loads(result.trajectory, load_robot("raven_like"))[0]
    lost, effort, drive = torque_split(load).mesh_friction, load.effort(), load.drive
    opposing, driving = effort * load.direction > 0, effort * load.direction < 0
    assert opposing.any()
    assert driving.any()
    assert lost[opposing] == pytest.approx((1 / 0.80 - 1) * effort[opposing] / drive.ratio)
    assert lost[driving] == pytest.approx((0.75 - 1) * effort[driving] / drive.ratio)
