"""The parts of the required torque add up to the torque, and each part equals its formula."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssm_planner.problem.drive import Drive
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.requirements import TORQUE_COMPONENTS, torque_split


def antibacklash(drive: Drive) -> Drive:
    return replace(drive, kind="antibacklash_screw", preload=3.0, second_nut_mass=0.02)


def sloppy(drive: Drive) -> Drive:
    """Return a drive that does not lock itself, so that its motor needs torque at rest too."""
    return replace(
        drive, self_locking=False, lead_angle=0.6, friction=replace(drive.friction, mu_static=0.18)
    )


@pytest.mark.parametrize("change", [lambda drive: drive, sloppy])
def test_parts_sum_to_the_torque(loads: tuple[JointLoad, ...], change) -> None:
    for load in loads:
        _assert_sum(load, change(load.drive))


def test_parts_sum_with_two_nuts(loads: tuple[JointLoad, ...]) -> None:
    _assert_sum(loads[2], antibacklash(loads[2].drive))


def _assert_sum(load: JointLoad, drive: Drive) -> None:
    driven = replace(load, drive=drive)
    split, torque = torque_split(driven), driven.torque()
    total = sum(part for _, part in split.components())
    size = sum(np.abs(part) for _, part in split.components())
    assert np.abs(total - torque).max() <= 1e-12 * np.abs(torque).max()
    assert np.all(np.abs(total - torque) <= 1e-12 * size)
    assert set(split.to_dict()) == set(TORQUE_COMPONENTS)


def test_without_friction_nothing_is_lost(loads: tuple[JointLoad, ...]) -> None:
    for load in loads:
        none = replace(
            load.drive.friction, mu=0.0, mu_static=0.0, b_c=0.0, b_v=0.0, b_oc=0.0, b_ov=0.0
        )
        frictionless = replace(load.drive, friction=none, self_locking=False)
        split = torque_split(replace(load, drive=frictionless))
        assert np.abs(split.mesh_friction).max() < 1e-16
        assert np.abs(split.bearing_friction).max() == 0.0


def test_each_part_by_its_formula(loads: tuple[JointLoad, ...]) -> None:
    for load in loads:
        drive, f, split = load.drive, load.drive.friction, torque_split(load)
        arm = drive.gamma * np.tan(drive.lead_angle)
        moving = load.direction != 0
        assert split.input_inertia == pytest.approx(
            drive.input_inertia * drive.ratio * load.qdd, abs=1e-16
        )
        assert split.output_inertia == pytest.approx(
            arm * (load.inertia + drive.output_inertia * load.qdd), abs=1e-15
        )
        assert split.load == pytest.approx(arm * (load.gravity + load.velocity), abs=1e-15)
        bearing = f.b_c * load.direction + f.b_v * drive.ratio * load.qd
        bearing = bearing + arm * (f.b_oc * load.direction + f.b_ov * load.qd)
        assert split.bearing_friction[moving] == pytest.approx(bearing[moving], abs=1e-15)
        # Friction in the mesh always opposes the motion.
        assert np.all(split.mesh_friction[moving] * load.direction[moving] >= -1e-18)


def test_the_mesh_holds_the_load_at_rest(robot) -> None:
    from ssm_planner.sizing.joint_load import joint_loads
    from ssm_planner.trajectory import Trajectory

    still = np.zeros((1, 6, 4))
    still[0, 0] = [0.3, -0.2, 0.1, -0.01]
    for load in joint_loads(Trajectory(np.array([0.0, 1.0]), still, ()), robot):
        split = torque_split(load)
        assert np.abs(split.load).min() > 0
        assert split.mesh_friction == pytest.approx(-split.load)


def test_the_components_at_the_peak_add_up_to_the_peak(loads: tuple[JointLoad, ...]) -> None:
    for load in loads:
        split = torque_split(load)
        assert abs(sum(split.at_peak.values())) == pytest.approx(
            np.abs(load.torque()).max(), rel=1e-12
        )
        for name, part in split.components():
            assert split.rms[name] == pytest.approx(np.sqrt(load.weight @ part**2), rel=1e-12)
