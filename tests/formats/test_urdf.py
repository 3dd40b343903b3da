from __future__ import annotations

import dataclasses
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.transmission import motor_torque, output_effort
from ssm_planner.formats.export import export
from ssm_planner.formats.urdf import effort_limit, rpy, urdf
from ssm_planner.kinematics.forward import forward
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.rotations import rotation
from ssm_planner.plans import Plan
from ssm_planner.problem.robot import Body, Geometry, Robot, frozen

RNG = np.random.default_rng(11)
AGREEMENT = 1e-9


def another_robot(robot: Robot, seed: int) -> Robot:
    """Random axes, body frames not along them, a third body with mass, a tool with an angle of its own."""
    rng = np.random.default_rng(seed)

    def turned() -> np.ndarray:
        axis = rng.normal(size=3)
        return rotation(axis / np.linalg.norm(axis), rng.uniform(-3, 3))

    tool = turned()
    axes = [vector / np.linalg.norm(vector) for vector in rng.normal(size=(2, 3))]
    geometry = Geometry(frozen(axes[0], (3,)), frozen(axes[1], (3,)), frozen(tool[:, 2], (3,)), frozen(tool, (3, 3)), 1)
    bodies = []
    for k in range(4):
        com, mass = rng.normal(size=3) * 0.1, rng.uniform(0.1, 1.0)
        spread = turned()
        about_com = spread @ np.diag([3.0, 4.0, 5.0]) @ spread.T * 1e-3 * mass
        inertia = about_com + mass * (com @ com * np.eye(3) - np.outer(com, com))
        bodies.append(Body(f"body {k}", mass, frozen(com, (3,)), frozen(inertia, (3, 3)), frozen(turned(), (3, 3))))
    return dataclasses.replace(robot, geometry=geometry, bodies=tuple(bodies))


def test_every_moving_link_has_an_inertia_and_the_massless_add_nothing(robot: Robot) -> None:
    """Without one MuJoCo refuses the link, and PyBullet takes 1 kg for it."""
    links = ElementTree.fromstring(urdf(robot)).findall("link")
    masses = {link.get("name"): link.find("inertial/mass") for link in links if link.get("name") != "base"}
    assert all(mass is not None and float(mass.get("value", 0)) > 0 for mass in masses.values())
    total = sum(float(mass.get("value", 0)) for mass in masses.values() if mass is not None)
    assert total == pytest.approx(sum(body.mass for body in robot.bodies), abs=1e-8)


@pytest.mark.parametrize("seed", [None, 1, 2, 3])
def test_pinocchio_finds_equal_kinematics_and_dynamics(robot: Robot, tmp_path: Path, seed: int | None) -> None:
    pin = pytest.importorskip("pinocchio", reason="Pinocchio (package pin, extra test) is the independent reader")
    robot = robot if seed is None else another_robot(robot, seed)
    path = tmp_path / "robot.urdf"
    path.write_text(urdf(robot), encoding="utf-8")
    model = pin.buildModelFromUrdf(str(path))
    model.gravity.linear = np.array(robot.gravity)
    data = model.createData()
    assert [model.names[k] for k in range(1, 5)] == [joint.name for joint in robot.joints]
    assert model.nq == model.nv == 4
    mechanism, body = Mechanism.from_geometry(robot.geometry), RigidBody.from_robot(robot)
    q = RNG.uniform(-3, 3, (50, 4)) * [1, 1, 1, 0.05]
    qd, qdd = RNG.normal(size=(50, 4)), RNG.normal(size=(50, 4)) * 5
    rotations, positions = forward(mechanism, q)
    tau = body.inverse_dynamics(q, qd, qdd)
    tool = model.getFrameId("tool")
    for k in range(50):
        pin.framesForwardKinematics(model, data, q[k])
        assert np.abs(data.oMf[tool].rotation - rotations[k]).max() <= AGREEMENT
        assert np.abs(data.oMf[tool].translation - positions[k]).max() <= AGREEMENT
        assert np.abs(pin.rnea(model, data, q[k], qd[k], qdd[k]) - tau[k]).max() <= AGREEMENT
    for k, joint in enumerate(robot.joints):
        assert model.lowerPositionLimit[k] == pytest.approx(joint.position[0], abs=1e-12)
        assert model.upperPositionLimit[k] == pytest.approx(joint.position[1], abs=1e-12)
        assert model.velocityLimit[k] == pytest.approx(joint.velocity, abs=1e-12)


def test_rpy_is_accurate_next_to_its_singularity() -> None:
    """Also where the pitch is ±90° exactly, as in the shipped robot's first frame, and at all distances from it."""
    for pitch in (0.0, np.pi / 2, -np.pi / 2, *(np.pi / 2 + RNG.choice([-1, 1], 40) * 10.0 ** RNG.uniform(-17, 0, 40))):
        x, y = RNG.uniform(-3, 3, 2)
        matrix = rotation((0, 0, 1), x) @ rotation((0, 1, 0), pitch) @ rotation((1, 0, 0), y)
        roll, turned, yaw = rpy(matrix)
        back = rotation((0, 0, 1), yaw) @ rotation((0, 1, 0), turned) @ rotation((1, 0, 0), roll)
        assert np.abs(back - matrix).max() <= 1e-12


def test_what_urdf_cannot_carry_is_said(plan: Plan, tmp_path: Path) -> None:
    export(plan, "urdf", tmp_path)
    text = (tmp_path / "robot.urdf").read_text(encoding="utf-8")
    comment = text[text.index("<!--") : text.index("-->")]
    for word in ("friction", "worms and screws", "acceleration, jerk", "gravity", "-9.81"):
        assert word in comment
    root = ElementTree.fromstring(text)
    assert not root.findall(".//dynamics")
    assert len(root.findall("joint")) == 5


def test_names_that_xml_does_not_like(robot: Robot) -> None:
    odd = dataclasses.replace(robot, name='a "robot" <1> -- & more')
    assert ElementTree.fromstring(urdf(odd)).attrib["name"]


def test_the_effort_limit_is_what_the_motor_brings_through_its_drive(robot: Robot) -> None:
    for joint in robot.joints:
        if joint.drive is None:
            continue
        load = effort_limit(joint)
        effort = output_effort(joint.drive, load, 0.0, 0.0, 1.0)
        torque = motor_torque(joint.drive, effort, 0.0, 0.0, direction=1.0)
        assert float(torque) == pytest.approx(joint.motor.max_torque, rel=1e-12)
