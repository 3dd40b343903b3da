"""A URDF export carries the masses, kinematics, dynamics and limits of the robot. The independent
references are the readers Pinocchio, MuJoCo, PyBullet and yourdfpy.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.transmission import motor_torque, output_effort
from ssm_planner.formats.export import export
from ssm_planner.formats.urdf import (
    HARDWARE_PLUGIN,
    LINK_NAMES,
    SMALLEST_MASS,
    UNLIMITED_EFFORT,
    _format_triple,
    _link_values,
    effort_limit,
    robot_urdf,
    rpy_angles,
)
from ssm_planner.kinematics.forward import forward
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.rotations import rotation
from ssm_planner.plans import Plan
from ssm_planner.problem.robot import Body, Geometry, Robot, read_only_array

RNG = np.random.default_rng(11)
AGREEMENT = 1e-9
Evaluate = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, ...]]
"""Such a function maps q, qd, qdd (4,) to rotation and position of the tool and joint torques."""


def another_robot(robot: Robot, seed: int) -> Robot:
    """Return a robot with random axes and body frames.

    Its third body has a mass, and its tool is inclined.
    """
    rng = np.random.default_rng(seed)

    def turned() -> np.ndarray:
        axis = rng.normal(size=3)
        return rotation(axis / np.linalg.norm(axis), rng.uniform(-3, 3))

    tool = turned()
    axes = [vector / np.linalg.norm(vector) for vector in rng.normal(size=(2, 3))]
    geometry = Geometry(
        read_only_array(axes[0], (3,)),
        read_only_array(axes[1], (3,)),
        read_only_array(tool[:, 2], (3,)),
        read_only_array(tool, (3, 3)),
        1,
    )
    bodies = []
    for k in range(4):
        com, mass = rng.normal(size=3) * 0.1, rng.uniform(0.1, 1.0)
        spread = turned()
        about_com = spread @ np.diag([3.0, 4.0, 5.0]) @ spread.T * 1e-3 * mass
        inertia = about_com + mass * (com @ com * np.eye(3) - np.outer(com, com))
        bodies.append(
            Body(
                f"body {k}",
                mass,
                read_only_array(com, (3,)),
                read_only_array(inertia, (3, 3)),
                read_only_array(turned(), (3, 3)),
            )
        )
    return dataclasses.replace(robot, geometry=geometry, bodies=tuple(bodies))


def test_every_moving_link_has_an_inertia_and_the_massless_add_nothing(robot: Robot) -> None:
    """Without an inertia, MuJoCo refuses the link, and PyBullet assumes 1 kg."""
    links = ElementTree.fromstring(robot_urdf(robot)).findall("link")
    masses = {
        link.get("name"): link.find("inertial/mass") for link in links if link.get("name") != "base"
    }
    assert all(mass is not None and float(mass.get("value", 0)) > 0 for mass in masses.values())
    total = sum(float(mass.get("value", 0)) for mass in masses.values() if mass is not None)
    assert total == pytest.approx(sum(body.mass for body in robot.bodies), abs=1e-8)


@pytest.mark.parametrize("pitch", [0.3, -1.2, np.pi / 2, -np.pi / 2])
def test_roll_pitch_and_yaw_make_the_rotation_up_to_a_pitch_of_90_degrees(pitch: float) -> None:
    x, y, z = np.eye(3)
    for roll, yaw in ((0.4, -0.7), (-2.0, 2.5), (0.0, 0.0), (3.0, 1.0)):
        matrix = rotation(z, yaw) @ rotation(y, pitch) @ rotation(x, roll)
        result = rpy_angles(matrix)
        again = rotation(z, result[2]) @ rotation(y, result[1]) @ rotation(x, result[0])
        assert again == pytest.approx(matrix, abs=1e-12)
        if abs(pitch) < 1.5:
            assert result == pytest.approx([roll, pitch, yaw])
    exact = np.array([[0.0, 0.6, 0.8], [0.0, 0.8, -0.6], [-1.0, 0.0, 0.0]])
    assert rpy_angles(exact)[2] == 0.0  # only the difference of roll and yaw is defined


def pinocchio(path: Path, robot: Robot) -> tuple[dict[str, float], Evaluate]:
    pin = pytest.importorskip("pinocchio", reason="package pin, extra test")
    model = pin.buildModelFromUrdf(str(path))
    model.gravity.linear = np.array(robot.gravity)
    data, tool = model.createData(), model.getFrameId("tool")
    assert [model.names[k] for k in range(1, 5)] == [joint.name for joint in robot.joints]
    for k, joint in enumerate(robot.joints):
        assert (model.lowerPositionLimit[k], model.upperPositionLimit[k]) == pytest.approx(
            joint.position, abs=1e-12
        )
        assert model.velocityLimit[k] == pytest.approx(joint.velocity, abs=1e-12)

    def evaluate(q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> tuple[np.ndarray, ...]:
        pin.framesForwardKinematics(model, data, q)
        return (
            data.oMf[tool].rotation,
            data.oMf[tool].translation,
            pin.rnea(model, data, q, qd, qdd),
        )

    masses = {link: model.inertias[k + 1].mass for k, link in enumerate(LINK_NAMES)}
    masses["stage"] -= SMALLEST_MASS  # The stage is one body with the tool.
    return masses, evaluate


def mujoco(path: Path, robot: Robot) -> tuple[dict[str, float], Evaluate]:
    mj = pytest.importorskip("mujoco", reason="package mujoco, extra test")
    ending = '<mujoco><compiler fusestatic="false"/></mujoco></robot>'  # The tool remains a separate body.
    model = mj.MjModel.from_xml_string(path.read_text(encoding="utf-8").replace("</robot>", ending))
    model.opt.gravity[:] = robot.gravity
    model.opt.disableflags |= mj.mjtDisableBit.mjDSBL_CONSTRAINT  # without limits and contacts
    data, tool = mj.MjData(model), model.body("tool").id

    def evaluate(q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> tuple[np.ndarray, ...]:
        data.qpos[:], data.qvel[:], data.qacc[:] = q, qd, qdd
        mj.mj_inverse(model, data)
        return data.xmat[tool].reshape(3, 3), data.xpos[tool], data.qfrc_inverse

    return {link: float(model.body(link).mass[0]) for link in LINK_NAMES}, evaluate


def pybullet(path: Path, robot: Robot) -> tuple[dict[str, float], Evaluate]:
    bullet = pytest.importorskip(
        "pybullet", reason="package pybullet, extra test: wheels for Linux up to Python 3.11"
    )
    client = bullet.connect(bullet.DIRECT)
    bullet.setGravity(*robot.gravity, physicsClientId=client)
    flags = bullet.URDF_USE_INERTIA_FROM_FILE
    body = bullet.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=client)
    links = [bullet.getJointInfo(body, k, client)[12].decode() for k in range(5)]

    def evaluate(q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> tuple[np.ndarray, ...]:
        for k in range(4):
            bullet.resetJointState(body, k, q[k], qd[k], client)
        # This is the pose of the centre of mass, which is the origin of the tool. PyBullet returns
        # the pose of the frame in single precision.
        place, turn, *_ = bullet.getLinkState(body, links.index("tool"), 0, True, client)
        torque = bullet.calculateInverseDynamics(
            body, q.tolist(), qd.tolist(), qdd.tolist(), physicsClientId=client
        )
        return (
            np.reshape(bullet.getMatrixFromQuaternion(turn), (3, 3)),
            np.array(place),
            np.array(torque),
        )

    return {
        link: bullet.getDynamicsInfo(body, links.index(link), client)[0] for link in LINK_NAMES
    }, evaluate


def yourdfpy(path: Path, robot: Robot) -> tuple[dict[str, float], Evaluate]:
    model = pytest.importorskip("yourdfpy", reason="package yourdfpy, extra test").URDF.load(
        str(path)
    )

    def evaluate(q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> tuple[np.ndarray, ...]:
        model.update_cfg(q)
        placed = model.get_transform("tool", "base")
        return placed[:3, :3], placed[:3, 3]  # This reader does not compute dynamics.

    return {link: model.link_map[link].inertial.mass for link in LINK_NAMES}, evaluate


@pytest.mark.parametrize("reader", [pinocchio, mujoco, pybullet, yourdfpy])
@pytest.mark.parametrize("seed", [None, 1, 2, 3])
def test_other_people_s_readers_find_equal_masses_kinematics_and_dynamics(
    robot: Robot,
    tmp_path: Path,
    seed: int | None,
    reader: Callable[[Path, Robot], tuple[dict[str, float], Evaluate]],
) -> None:
    robot = robot if seed is None else another_robot(robot, seed)
    path = tmp_path / "robot.urdf"
    path.write_text(robot_urdf(robot), encoding="utf-8")
    masses, evaluate = reader(path, robot)
    body_masses = [body.mass or SMALLEST_MASS for body in robot.bodies]
    assert list(masses.values()) == pytest.approx(body_masses, rel=1e-12)
    mechanism, body = Mechanism.from_geometry(robot.geometry), RigidBody.from_robot(robot)
    q = RNG.uniform(-3, 3, (50, 4)) * [1, 1, 1, 0.05]
    qd, qdd = RNG.normal(size=(50, 4)), RNG.normal(size=(50, 4)) * 5
    rotations, positions = forward(mechanism, q)
    expected = zip(rotations, positions, body.inverse_dynamics(q, qd, qdd), strict=True)
    for k, ours in enumerate(expected):
        for mine, theirs in zip(ours, evaluate(q[k], qd[k], qdd[k]), strict=False):
            assert np.abs(mine - theirs).max() <= AGREEMENT


def test_rpy_is_accurate_next_to_its_singularity() -> None:
    """The pitch is 0, is ±90° as in the first frame of the shipped robot, or differs from 90° by
    1e-17 to 1 rad.
    """
    for pitch in (
        0.0,
        np.pi / 2,
        -np.pi / 2,
        *(np.pi / 2 + RNG.choice([-1, 1], 40) * 10.0 ** RNG.uniform(-17, 0, 40)),
    ):
        x, y = RNG.uniform(-3, 3, 2)
        matrix = rotation((0, 0, 1), x) @ rotation((0, 1, 0), pitch) @ rotation((1, 0, 0), y)
        roll, turned, yaw = rpy_angles(matrix)
        back = rotation((0, 0, 1), yaw) @ rotation((0, 1, 0), turned) @ rotation((1, 0, 0), roll)
        assert np.abs(back - matrix).max() <= 1e-12


def test_the_urdf_lists_the_data_that_it_cannot_contain(plan: Plan, tmp_path: Path) -> None:
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
    assert ElementTree.fromstring(robot_urdf(odd)).attrib["name"] == "a__robot___1_______more"


def test_the_effort_limit_is_what_the_motor_brings_through_its_drive(robot: Robot) -> None:
    for joint in robot.joints:
        if joint.drive is None:
            continue
        load = effort_limit(joint)
        effort = output_effort(joint.drive, load, 0.0, 0.0, 1.0)
        torque = motor_torque(joint.drive, effort, 0.0, 0.0, direction=1.0)
        assert float(torque) == pytest.approx(joint.motor.max_torque, rel=1e-12)


def test_a_motor_weaker_than_its_friction_provides_no_effort(robot: Robot) -> None:
    joint = robot.joints[0]
    assert joint.motor is not None
    motor = dataclasses.replace(joint.motor, nominal_torque=1e-9, max_torque=1e-9)
    weak = dataclasses.replace(joint, motor=motor)
    assert effort_limit(weak) == 0.0


def test_links_are_drawn_by_their_kind_and_without_mass_have_no_inertia(robot: Robot) -> None:
    bodies = (
        dataclasses.replace(robot.bodies[0], mass=0.0, inertia=np.zeros((3, 3))),
        *robot.bodies[1:],
    )
    links = list(_link_values(dataclasses.replace(robot, bodies=bodies)))
    assert [link["inertia"] is None for link in links] == [body.mass == 0.0 for body in bodies]
    assert links[0]["inertia"] is None is not links[1]["inertia"]
    sizes = {joint.slides: link["size"] for joint, link in zip(robot.joints, links, strict=True)}
    assert sizes[True][1] < sizes[False][1]
    assert len({link["size"] for link in links}) == 2


def test_notes_name_the_plugin_and_the_bodies_without_mass(
    plan: Plan, bad_plan: Plan, tmp_path: Path
) -> None:
    _, manifest = export(plan, "urdf", tmp_path)
    assert any(note.endswith(f"is a placeholder, {HARDWARE_PLUGIN}") for note in manifest["notes"])
    light = [body.name for body in plan.robot.bodies if body.mass == 0]
    assert light
    assert [
        note.split(" has no mass")[0] for note in manifest["notes"] if "has no mass" in note
    ] == [f"body {name}" for name in light]
    assert sum(note.startswith("not included: ") for note in manifest["notes"]) >= 4
    for source, mark in ((plan, ""), (bad_plan, "_unverified")):
        export(source, "urdf", tmp_path, force=True)
        for name in (f"robot{mark}.urdf", f"controllers{mark}.yaml"):
            assert ("UNVERIFIED" in (tmp_path / name).read_text(encoding="utf-8")) == bool(mark)


def test_numbers_have_all_digits_and_no_negative_zero(robot: Robot) -> None:
    values = np.array([1 / 3, -0.0, -5e-17, 2e-16, -1e22])
    assert _format_triple(values) == "0.3333333333333333 0.0 0.0 2e-16 -1e+22"
    assert not re.search(r'["\s]-0\.0["\s]', robot_urdf(robot))


def test_joints_without_a_motor_have_the_stated_effort(robot: Robot) -> None:
    efforts = [
        float(limit.get("effort", 0))
        for limit in ElementTree.fromstring(robot_urdf(robot)).iter("limit")
    ]
    for joint, effort in zip(robot.joints, efforts, strict=True):
        assert effort == effort_limit(joint)
        assert (effort == UNLIMITED_EFFORT) == (joint.motor is None or joint.drive is None)
    for lacking in ("motor", "drive"):
        bare = dataclasses.replace(robot.joints[0], **{lacking: None})
        assert effort_limit(bare) == UNLIMITED_EFFORT
