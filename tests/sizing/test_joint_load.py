"""The required motor torque equals an independent implementation of the law of the paper.

Pinocchio computes the rigid-body dynamics of this reference.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ssm_planner.dynamics.motors import motion_directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.robot import Robot
from ssm_planner.sizing import joint_load as module
from ssm_planner.sizing import requirements as requirements_module
from ssm_planner.sizing.joint_load import JOINT_COLUMNS, JointLoad, joint_loads
from ssm_planner.sizing.requirements import motor_requirement, motor_requirements
from ssm_planner.trajectory import Trajectory
from tests.support.pinocchio_model import build
from tests.support.sizing_cases import COMPLETE, random_trajectory

DRIVEN = (0, 1, 3)


def plain_law(drive: Drive, tau: float, qd: float, qdd: float, way: float, starts: bool) -> float:
    """Return the motor torque (N·m) at one instant by the law of the paper."""
    f = drive.friction
    if way == 0:
        return 0.0
    F = tau + drive.output_inertia * qdd + f.b_oc * way + f.b_ov * qd
    phi = math.atan((f.mu_static if starts else f.mu) / math.cos(drive.pressure_angle))
    mesh = drive.gamma * math.tan(drive.lead_angle + math.copysign(phi, F * way)) * F
    w, wd = drive.ratio * qd, drive.ratio * qdd
    return drive.input_inertia * wd + f.b_c * way + f.b_v * w + mesh


@pytest.mark.parametrize("seed", [3, 11])
def test_torque_is_the_law_over_pinocchio(robot: Robot, seed: int) -> None:
    import pinocchio as pin

    trajectory = random_trajectory(seed)
    model = build(robot)
    data = model.createData()
    loads = joint_loads(trajectory, robot, 200.0)
    worst = 0.0
    samples = trajectory.sample(loads[0].t)
    for n in range(0, len(loads[0].t), 3):
        piece_ends = np.any(np.abs(loads[0].t[n] - trajectory.breaks) < 1e-12)
        if piece_ends:
            # The derivatives have two one-sided values at a break of the trajectory.
            continue
        tau = pin.rnea(model, data, samples.q[n], samples.qd[n], samples.qdd[n])
        for i, load in zip(DRIVEN, loads, strict=True):
            turning = abs(samples.qd[n, i]) < 1e-9 * robot.joints[i].velocity
            way = load.direction[n] if turning else np.sign(samples.qd[n, i])
            expected = plain_law(
                load.drive, tau[i], samples.qd[n, i], samples.qdd[n, i], way, load.breakaway[n] > 0
            )
            worst = max(worst, abs(expected - load.torque()[n]))
    assert worst <= 1e-9


def test_torque_is_that_of_the_motor_side(
    robot: Robot, trajectory: Trajectory, loads: tuple[JointLoad, ...]
) -> None:
    """Away from breaks and reversals, the loads have the torque and effort of `motor_motion`."""
    t = loads[0].t
    inside = np.all(np.abs(t[:, None] - trajectory.breaks) > 1e-9, axis=1)
    samples = trajectory.sample(t[inside])
    motor = motor_motion(
        robot, RigidBody.from_robot(robot), samples, *motion_directions(robot, samples, 1)
    )
    for i, load in zip(DRIVEN, loads, strict=True):
        moving = np.abs(samples.qd[:, i]) > 1e-9 * robot.joints[i].velocity
        assert moving.sum() > 1000
        assert np.abs(load.torque()[inside] - motor.torque[:, i])[moving].max() < 1e-14
        assert np.abs(load.effort()[inside] - motor.effort[:, i])[moving].max() < 1e-12


def test_every_turn_is_an_instant_with_static_friction(
    robot: Robot, loads: tuple[JointLoad, ...]
) -> None:
    for load in loads:
        inner = np.flatnonzero(np.diff(np.sign(load.qd[np.abs(load.qd) > 1e-7])) != 0)
        # Static friction acts at the first start and at every reversal.
        assert load.breakaway.sum() == len(inner) + 1
        starts = np.flatnonzero(load.breakaway)
        limit = robot.joints[("roll", "tilt", "spin", "insertion").index(load.joint)].velocity
        assert np.abs(load.qd[starts]).max() < 1e-9 * limit
        # Breaking away needs at least the torque that continued motion needs.
        sign = load.direction[starts]
        assert np.all(load.torque()[starts] * sign >= load.torque()[starts + 1] * sign)


def test_figures_are_those_of_a_dense_quadrature(robot: Robot, trajectory: Trajectory) -> None:
    coarse, fine = (
        motor_requirements(trajectory, robot),
        motor_requirements(trajectory, robot, 20_000.0),
    )
    for a, b in zip(coarse, fine, strict=True):
        assert a.rms_torque == pytest.approx(b.rms_torque, rel=1e-5)
        assert a.mean_torque == pytest.approx(b.mean_torque, abs=1e-4 * b.rms_torque)
        assert a.peak_torque == pytest.approx(b.peak_torque, rel=1e-4)
        assert a.peak_speed == pytest.approx(b.peak_speed, rel=1e-4)
        assert a.energy == pytest.approx(b.energy, rel=1e-5)


def test_energy_balance(robot: Robot, trajectory: Trajectory) -> None:
    """The energy that the motor supplies equals the work of all parts of the torque.

    Friction in the mesh and the bearings takes energy. The input inertia takes no energy in total
    because the motion starts and ends at rest.
    """
    for load in joint_loads(trajectory, robot, 10_000.0):
        requirement = motor_requirement(load)
        w = load.speed()
        work = {
            name: load.weight @ (part * w) * load.duration
            for name, part in requirement.split.components()
        }
        total = requirement.energy - requirement.returned_energy
        assert sum(work.values()) == pytest.approx(total, rel=1e-9)
        assert requirement.mean_power * load.duration == pytest.approx(total, rel=1e-9)
        assert work["mesh_friction"] > 0
        assert work["bearing_friction"] > 0
        assert abs(work["input_inertia"]) < 1e-6 * total  # The motion starts and ends at rest.


def test_joule_heat_needs_constant_and_resistance(loads: tuple[JointLoad, ...]) -> None:
    load = replace(loads[0], motor=COMPLETE)
    requirement = motor_requirement(load)
    current = load.torque() / COMPLETE.torque_constant
    expected = load.weight @ (COMPLETE.terminal_resistance * current**2)
    assert requirement.joule_power == pytest.approx(expected, rel=1e-12)
    for missing in ("torque_constant", "terminal_resistance"):
        assert (
            motor_requirement(replace(load, motor=replace(COMPLETE, **{missing: None}))).joule_power
            is None
        )


def test_a_motion_at_rest_requires_nothing(robot: Robot) -> None:
    still = np.zeros((1, 6, 4))
    still[0, 0] = [0.3, -0.2, 0.1, -0.01]
    for requirement in motor_requirements(Trajectory(np.array([0.0, 1.0]), still, ()), robot):
        assert (
            requirement.peak_torque
            == requirement.rms_torque
            == requirement.peak_speed
            == requirement.energy
            == 0.0
        )


@pytest.mark.parametrize("section", [50, 333])
def test_loads_in_sections_are_the_loads(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, section: int
) -> None:
    """The division into sections only limits the memory that the computation needs.

    Loads, torques and requirements are equal to the last bit for every section size.
    """
    trajectory = random_trajectory(5)
    complete = joint_loads(trajectory, robot)
    requirements = [motor_requirement(load).to_dict() for load in complete]
    monkeypatch.setattr(module, "SECTION_SIZE", section)
    for load, other in zip(complete, joint_loads(trajectory, robot), strict=True):
        for name in ("t", *JOINT_COLUMNS, "weight"):
            assert np.array_equal(getattr(load, name), getattr(other, name)), name
        assert np.array_equal(load.torque(), other.torque())
    assert [motor_requirement(load).to_dict() for load in complete] == requirements


def test_a_motion_of_many_pieces_has_few_instants_in_each() -> None:
    most = [module._max_instants(count) for count in (2, 400, 2_000, 40_000, 100_000, 10**6)]
    assert most == [1000, 100, 40, 10, 4, 4]


@pytest.mark.parametrize("group", [3, 50])
def test_a_figure_shows_the_extremes_of_a_requirement(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, group: int
) -> None:
    for requirement in motor_requirements(random_trajectory(7), robot):
        torque = requirement.torque
        assert np.array_equal(requirement.figure_data().torque, torque)
        monkeypatch.setattr(requirements_module, "MOST_INSTANTS", len(torque) // group)
        few = requirement.figure_data()
        assert len(few.t) <= 2 * len(torque) / (group - 1) + 2
        assert (few.torque.min(), few.torque.max()) == (torque.min(), torque.max())
        assert np.all(np.isin(few.t, requirement.t))
        assert few.peak_torque == requirement.peak_torque
        monkeypatch.undo()
