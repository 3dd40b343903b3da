"""The exported FMI unit is valid. It computes the plan, and its torques agree with the functions of
the package.
"""

from __future__ import annotations

import platform
import shutil
import subprocess
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ssm_planner.dynamics.robot_dynamics import inverse_dynamics, motor_torque
from ssm_planner.plans import Plan

fmpy = pytest.importorskip("fmpy", reason="package fmpy, extra test")
pytestmark = pytest.mark.skipif(
    shutil.which("cc") is None or platform.system() not in ("Linux", "Darwin"),
    reason="no C compiler (cc) on this machine",
)
STATES = 10_000
AGREEMENT = 1e-9
"""Largest difference of torques, N·m and N."""
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-c"]


@pytest.fixture(scope="module")
def unit(exported: Callable[[str], Path]) -> Path:
    return exported("fmu") / "ssm.fmu"


@pytest.fixture(scope="module")
def extracted(unit: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("unit")
    with zipfile.ZipFile(unit) as archive:
        archive.extractall(folder)
    return folder


@pytest.fixture
def instance(extracted: Path) -> Iterator[Any]:
    """Yield an initialised instance of the unit."""
    description = fmpy.read_model_description(str(extracted))
    loaded = fmpy.fmi3.FMU3Slave(
        guid=description.instantiationToken,
        unzipDirectory=str(extracted),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="test",
    )
    loaded.instantiate()
    loaded.enterInitializationMode(startTime=0.0)
    loaded.exitInitializationMode()
    yield loaded
    loaded.terminate()
    loaded.freeInstance()


def references(extracted: Path) -> dict[str, int]:
    """Return the value references by name."""
    variables = fmpy.read_model_description(str(extracted)).modelVariables
    return {variable.name: variable.valueReference for variable in variables}


def test_fmpy_finds_no_problem(unit: Path) -> None:
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(unit)) == []


def test_the_list_of_sources_follows_its_schema(extracted: Path) -> None:
    from lxml import etree

    schema = Path(fmpy.__file__).parent / "schema/fmi3/fmi3BuildDescription.xsd"
    etree.XMLSchema(etree.parse(schema)).assertValid(
        etree.parse(extracted / "sources/buildDescription.xml")
    )


def test_the_sources_compile_without_warnings(extracted: Path, tmp_path: Path) -> None:
    listed = [path.name for path in sorted((extracted / "sources").glob("*.c"))]
    assert listed == ["ssm_fmu.c", "ssm_robot.c", "ssm_trajectory.c"]
    for name in listed:
        command = ["cc", *STRICT, extracted / "sources" / name, "-o", tmp_path / "unit.o"]
        subprocess.run(command, check=True)


def test_the_torques_are_those_of_the_exact_law(
    extracted: Path, instance: Any, shipped: Plan
) -> None:
    rng = np.random.default_rng(8)
    joints = shipped.robot.joints
    low, high = np.array([joint.position for joint in joints]).T
    bounds = np.array([[joint.velocity, joint.acceleration] for joint in joints]).T
    shape = (STATES, 4)
    q = rng.uniform(low, high, shape)
    qd, qdd = (rng.uniform(-bound, bound, shape) for bound in bounds)
    of = references(extracted)
    inputs = [of[name] for name in ("q", "qd", "qdd")]
    outputs = [of["effort"], of["motor_torque"]]
    values = np.empty((STATES, 8))
    for k in range(STATES):
        instance.setFloat64(inputs, np.concatenate([q[k], qd[k], qdd[k]]))
        values[k] = instance.getFloat64(outputs, nValues=8)
    driven = [k for k, joint in enumerate(joints) if joint.drive is not None]
    torques = motor_torque(shipped.robot, q, qd, qdd)[:, driven]
    assert np.abs(values[:, :4] - inverse_dynamics(shipped.robot, q, qd, qdd)).max() <= AGREEMENT
    assert np.abs(values[:, 4:][:, driven] - torques).max() <= AGREEMENT
    assert np.ptp(torques) > 0.01


def test_a_simulation_gives_the_plan(unit: Path, shipped: Plan) -> None:
    result = fmpy.simulate_fmu(str(unit), output_interval=0.01)
    s = shipped.motion.sample(shipped.motion.breaks[0] + result["time"], clamp=True)
    assert result["time"][-1] == pytest.approx(shipped.motion.duration, abs=0.011)
    for name in ("q", "qd", "qdd"):
        inner = slice(1, -1)  # The sampler is at rest at both ends.
        assert np.abs(result[f"plan.{name}"] - getattr(s, name))[inner].max() <= AGREEMENT
    torque = motor_torque(shipped.robot, s.q, s.qd, s.qdd)
    for k, joint in enumerate(shipped.robot.joints):
        moving = np.abs(s.qd[:, k]) > 1e-6
        if joint.drive is not None:
            assert moving.sum() > 50
            difference = np.abs(result["plan.motor_torque"] - torque)[moving, k]
            assert difference.max() <= AGREEMENT


def test_wrong_calls_fail(extracted: Path, instance: Any) -> None:
    of = references(extracted)
    for call in (
        lambda: instance.setFloat64([of["plan.q"]], np.zeros(4)),
        lambda: instance.setFloat64([of["q"]], np.zeros(3)),
        lambda: instance.getFloat64([99], nValues=4),
        lambda: instance.getFloat64([of["q"]], nValues=3),
        lambda: instance.getFloat32([of["q"]], nValues=4),
    ):
        with pytest.raises(Exception, match="failed"):
            call()


def test_equal_plans_give_equal_units(
    exported: Callable[[str], Path], shipped: Plan, tmp_path: Path
) -> None:
    unit = exported("fmu") / "ssm.fmu"  # puts the folder of the package on the path
    import ssm_planner_fmu

    ssm_planner_fmu.write(shipped, None, tmp_path, "")
    with (
        zipfile.ZipFile(unit) as first,
        zipfile.ZipFile(tmp_path / "ssm.fmu") as second,
    ):
        names = [name for name in first.namelist() if not name.startswith("binaries")]
        assert first.namelist() == second.namelist()
        assert all(first.read(name) == second.read(name) for name in names)


def test_without_a_compiler_the_unit_has_sources_alone(
    exported: Callable[[str], Path], shipped: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    exported("fmu")
    import ssm_planner_fmu

    monkeypatch.setattr(shutil, "which", lambda name: None)
    details = ssm_planner_fmu.write(shipped, None, tmp_path, "")
    assert any("sources only" in note for note in details["notes"])
    with zipfile.ZipFile(tmp_path / "ssm.fmu") as archive:
        assert not any(name.startswith("binaries") for name in archive.namelist())
