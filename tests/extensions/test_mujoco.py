"""The exported model for MuJoCo agrees with the torques of the C export, and follows a plan like
the simulation of the package.
"""

from __future__ import annotations

import ctypes
import importlib.util
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from ssm_planner.errors import ExportError
from ssm_planner.plans import Plan
from ssm_planner.simulation.simulate import simulate
from tests.support.cli import python
from tests.support.paths import ROOT

mujoco = pytest.importorskip("mujoco", reason="package mujoco, extra test")
pytestmark = pytest.mark.skipif(
    shutil.which("cc") is None, reason="no C compiler (cc) on this machine"
)
STATES = 10_000
AGREEMENT = 1e-9
"""Largest difference of motor torques, N·m."""
SHORT = 1e-6
"""Time step in which no motor stops, s."""
EXTENSION = '<extension><plugin plugin="ssm.drives"><instance name="ssm"/></plugin></extension>'


@pytest.fixture(scope="module")
def folder(exported: Callable[[str], Path]) -> Path:
    return exported("mujoco")


@pytest.fixture(scope="module")
def module(folder: Path) -> Iterator[Any]:
    """Yield the exported Python module."""
    spec = importlib.util.spec_from_file_location("ssm_mujoco", folder / "ssm_mujoco.py")
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    yield loaded
    mujoco.set_mjcb_passive(None)


@pytest.fixture(scope="module")
def arm(module: Any) -> Any:
    return module.Arm()


def random_states(plan: Plan, count: int) -> tuple[np.ndarray, ...]:
    """Return positions, velocities and accelerations (count, 4) within the limits of the joints.

    All joints move, with at least 1 % of their largest velocity.
    """
    rng = np.random.default_rng(7)
    joints = plan.robot.joints
    low, high = np.array([joint.position for joint in joints]).T
    velocity = np.array([joint.velocity for joint in joints])
    acceleration = np.array([joint.acceleration for joint in joints])
    shape = (count, 4)
    return (
        rng.uniform(low, high, shape),
        rng.choice([-1, 1], shape) * rng.uniform(0.01, 1, shape) * velocity,
        rng.uniform(-acceleration, acceleration, shape),
    )


def torque_errors(arm: Any, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, excess: float) -> Any:
    """Return the errors of the motor torques in MuJoCo (n, driven), N·m.

    The springs carry the efforts of the motion. The motors have the torques of the C export plus an
    excess, N·m. The error is the inertia of a motor shaft times the difference of its acceleration
    from that of the motion.
    """
    shafts = arm.model.jnt_dofadr[[arm.model.actuator(k).trnid[0] for k in arm.driven]]
    step, arm.model.opt.timestep = arm.model.opt.timestep, SHORT
    torque, zeros = np.zeros(4), np.zeros(4)
    errors = np.zeros((len(q), len(arm.driven)))
    for k in range(len(q)):
        arm.law.ssm_motor_torque(*map(pointer, (q[k], qd[k], qdd[k], zeros, torque)))
        arm.place(q[k], qd[k], qdd[k])
        arm.data.ctrl[:] = np.where(arm.ratio > 0, torque + excess, qd[k] + SHORT * qdd[k])
        mujoco.mj_forward(arm.model, arm.data)
        errors[k] = arm.data.qacc[shafts] - (arm.ratio * qdd[k])[arm.driven]
    arm.model.opt.timestep = step
    return errors * arm.inertia[arm.driven]


def pointer(values: np.ndarray) -> ctypes.c_void_p:
    return values.ctypes.data_as(ctypes.c_void_p)


def test_the_torque_of_the_c_export_gives_exactly_its_acceleration(arm: Any, shipped: Plan) -> None:
    """An error of the law, of a body or of the friction would change the acceleration."""
    errors = torque_errors(arm, *random_states(shipped, STATES), excess=0.0)
    assert np.abs(errors).max() <= AGREEMENT


def test_a_wrong_torque_is_noticed(arm: Any, shipped: Plan) -> None:
    """An excess of 1e-8 N·m shows in every motor."""
    errors = torque_errors(arm, *random_states(shipped, 100), excess=1e-8)
    assert errors == pytest.approx(1e-8, rel=0.05)


@pytest.fixture(scope="module")
def played(arm: Any) -> dict[str, np.ndarray]:
    return arm.play(rows=2000)


def test_the_arm_follows_the_plan_as_simulate_says(
    arm: Any, played: dict[str, np.ndarray], shipped: Plan
) -> None:
    """With fine encoders, tracking errors and torques agree within 1 %.

    MuJoCo knows the exact motor angles, and the usual encoder increments add noise to the torques.
    """
    joints = tuple(
        joint
        if joint.motor is None
        else replace(joint, motor=replace(joint.motor, encoder_counts=2**22))
        for joint in shipped.robot.joints
    )
    problem = replace(shipped.problem, robot=replace(shipped.robot, joints=joints))
    simulated = simulate(replace(shipped, problem=problem))
    moving = simulated.time <= arm.duration
    error = played["q"] - np.array([arm.sample(float(t))[0] for t in played["time"]])
    for k in arm.driven:
        assert np.abs(error[:, k]).max() == pytest.approx(simulated.tracking[k].worst, rel=0.01)
        torques = (simulated.torque[moving, k], played["torque"][:, k])
        mine, theirs = (np.sqrt(np.mean(torque**2)) for torque in torques)
        assert theirs == pytest.approx(mine, rel=0.01)
    assert np.abs(error[:, 2]).max() <= 1e-6  # a joint without a drive has the planned speed


def test_without_power_the_tip_stays(arm: Any, played: dict[str, np.ndarray]) -> None:
    """The tip moves by rounding errors only in 10 s."""
    assert len(played["time"])
    assert arm.switch_off(10.0) <= 1e-12


def test_a_drive_that_does_not_lock_lets_the_arm_fall(arm: Any) -> None:
    """Without the force of the drives, the arm moves, so the drives hold it otherwise."""
    arm.place(arm.sample(0.0)[0])
    start = arm.tip()
    mujoco.set_mjcb_passive(None)
    mujoco.mj_step(arm.model, arm.data, 1000)
    mujoco.set_mjcb_passive(arm.law.ssm_passive)
    assert np.linalg.norm(arm.tip() - start) > 1e-3


def test_other_models_are_not_affected(arm: Any) -> None:
    text = '<mujoco><worldbody><body><joint axis="0 1 0"/><geom size=".1" pos=".3 0 0"/></body></worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(text)
    speeds = []
    for callback in (arm.law.ssm_passive, None):
        mujoco.set_mjcb_passive(callback)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 100)
        speeds.append(float(data.qvel[0]))
    mujoco.set_mjcb_passive(arm.law.ssm_passive)
    assert speeds[0] == speeds[1] != 0


PLUGIN = """
import ctypes, sys
import mujoco
library, model = sys.argv[1:]
mujoco.mj_loadPluginLibrary(library)
model = mujoco.MjModel.from_xml_path(model)
for callback in (None, ctypes.CDLL(library).ssm_passive):
    mujoco.set_mjcb_passive(callback)
    data = mujoco.MjData(model)
    data.ctrl[0] = 0.05
    mujoco.mj_step(model, data, 100)
    print(repr(float(data.qvel[-3])), repr(float(data.qpos[0])))
"""


def test_the_plugin_and_the_callback_together_add_the_force_once(
    module: Any, arm: Any, folder: Path, tmp_path: Path
) -> None:
    """A callback that is installed in addition to the plugin does not add the force twice."""
    text = (folder / "robot.xml").read_text(encoding="utf-8")
    model = tmp_path / "robot.xml"
    model.write_text(text.replace("<worldbody>", f"{EXTENSION}<worldbody>"), encoding="utf-8")
    done = python("-c", PLUGIN, arm.law._name, model)
    assert done.returncode == 0, done.stderr
    mujoco.mj_resetData(arm.model, arm.data)
    arm.data.ctrl[0] = 0.05
    mujoco.mj_step(arm.model, arm.data, 100)
    values = [float(arm.data.qvel[-3]), float(arm.data.qpos[0])]
    assert [float(value) for value in done.stdout.split()] == 2 * values
    assert values[0] > 1


def test_the_model_has_the_bodies_of_the_robot(folder: Path, shipped: Plan) -> None:
    root = ElementTree.parse(folder / "robot.xml").getroot()
    masses = sum(float(e.get("mass", 0)) for e in root.iter("inertial"))
    assert masses == pytest.approx(sum(body.mass for body in shipped.robot.bodies), abs=1e-8)
    names = [joint.name for joint in shipped.robot.joints]
    assert [motor.get("name") for motor in root.iter("motor")] == names


def test_the_files_of_an_unverified_plan_compile(
    module: Any, shipped: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sys.modules["ssm_planner_mujoco"].write(shipped, None, tmp_path, "_unverified")
    monkeypatch.setattr(module, "FOLDER", tmp_path)
    assert module.compile_library().is_file()


def test_a_drive_without_inertia_can_be_simulated(folder: Path, shipped: Plan) -> None:
    """MuJoCo requires an inertia of the shaft. Its value has no effect, because the law moves the
    shaft.
    """
    assert folder.is_dir()
    joint = shipped.robot.joints[0]
    light = replace(joint, drive=replace(joint.drive, input_inertia=0.0))
    robot = replace(shipped.robot, joints=(light, *shipped.robot.joints[1:]))
    package = sys.modules["ssm_planner_mujoco"]
    model = mujoco.MjModel.from_xml_string(package.mjcf(robot, 4e-4))
    assert model.body("roll_motor").inertia.tolist() == [package.LIGHTEST_SHAFT] * 3


@pytest.mark.parametrize("step", ["fast", "0", "-1e-4", "1", "nan"])
def test_an_impossible_time_step_is_refused(
    step: str, exported: Callable[[str], Path], shipped: Plan, tmp_path: Path
) -> None:
    exported("mujoco")
    with pytest.raises(ExportError, match="timestep"):
        sys.modules["ssm_planner_mujoco"].write(shipped, None, tmp_path, "", step)
    assert not list(tmp_path.iterdir())


def test_the_c_example_of_the_guide_runs(folder: Path, tmp_path: Path) -> None:
    """The example needs two files of the export, and its drives come to rest."""
    guide = (ROOT / "docs/simulation.md").read_text(encoding="utf-8")
    (source,) = re.findall(r"```c\n(.*?)```", guide, re.S)
    (tmp_path / "main.c").write_text(source, encoding="utf-8")
    for name in ("ssm_drives.h", "ssm_robot.h"):
        shutil.copy(folder / name, tmp_path)
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-Wno-unused"]
    command = ["cc", *strict, "main.c", "-o", "main", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    done = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True)
    assert done.stdout == "0 0 0\n"
