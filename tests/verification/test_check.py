"""The check reports the worst value of every limit of a motion. The references are closed forms,
and dense evaluations with the functions of the model.
"""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ssm_planner.dynamics.motors import motion_directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.transmission import breakaway_torque, nut_contact_force
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.rotations import rotation
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.problem.limits import TASK_COORDINATES
from ssm_planner.problem.problem import Eye, Lens
from ssm_planner.problem.robot import Robot, read_only_array
from ssm_planner.sizing.joint_load import joint_loads
from ssm_planner.trajectory import Samples, Trajectory, quintic_coefficients
from ssm_planner.verification import sampled_extremes
from ssm_planner.verification.certificate import Certificate, LimitCheck
from ssm_planner.verification.check import check
from tests.support.cases import drawn
from tests.support.paths import ROOT
from tests.support.plans import SHARE, of_task, smooth, trapezoids, write_plan
from tests.support.seeded import tip_velocity


def limit_of(certificate: Certificate, name: str, joint: str | None = None) -> LimitCheck:
    return next(
        limit for limit in certificate.limits if limit.name == name and limit.joint == joint
    )


def wavy(rng: np.random.Generator, pieces: int = 6) -> Trajectory:
    """Return random quintics through random points, which reverse within pieces."""
    breaks = np.cumsum(np.append(0.0, rng.uniform(0.05, 0.4, pieces)))
    scale = np.array([1.0, 1.0, 1.0, 0.02])
    q = rng.normal(size=(pieces + 1, 4)) * 0.3 * scale + [0.0, 0.6, 0.0, -0.015]
    v, a = rng.normal(size=q.shape) * 0.6 * scale, rng.normal(size=q.shape) * 2 * scale
    v[0] = v[-1] = 0.0
    return Trajectory(
        breaks,
        quintic_coefficients(np.diff(breaks), (q[:-1], v[:-1], a[:-1]), (q[1:], v[1:], a[1:])),
        (),
    )


def screw(robot: Robot) -> Robot:
    """Return the robot with an antibacklash screw and Stribeck friction in joint 4."""
    joint = robot.joints[3]
    friction = dataclasses.replace(
        joint.drive.friction, law="stribeck_gaussian", mu_stribeck=0.05, stribeck_speed=3.0
    )
    drive = dataclasses.replace(
        joint.drive, kind="antibacklash_screw", preload=5.0, second_nut_mass=0.05, friction=friction
    )
    return dataclasses.replace(
        robot, joints=(*robot.joints[:3], dataclasses.replace(joint, drive=drive))
    )


def dense(
    trajectory: Trajectory, robot: Robot, per_piece: int = 4000
) -> dict[tuple[str, str | None], np.ndarray]:
    """Return every limited value at many instants of every piece, from the model's functions."""
    count = len(trajectory.breaks) - 1
    piece = np.repeat(np.arange(count), per_piece)
    # Just inside the ends of a piece, the directions of motion are those of the piece.
    share = np.tile(np.linspace(1e-7, 1 - 1e-7, per_piece), count)
    samples = trajectory.sample_pieces(piece, share * np.diff(trajectory.breaks)[piece])
    direction, breakaway = motion_directions(robot, samples, 1)
    motor = motor_motion(robot, RigidBody.from_robot(robot), samples, direction, breakaway)
    mechanism = Mechanism.from_geometry(robot.geometry)
    task = task_from_joints(mechanism, samples.q)
    values: dict[tuple[str, str | None], np.ndarray] = {
        ("tip speed", None): np.linalg.norm(tip_velocity(mechanism, samples.q, samples.qd), axis=1),
        ("insertion speed", None): samples.qd[:, 3],
    }
    for i, joint in enumerate(robot.joints):
        for name, field in (("position", "q"), ("velocity", "qd"), ("acceleration", "qdd")):
            values[name, joint.name] = getattr(samples, field)[:, i]
        if joint.drive is not None:
            values["motor speed", joint.name] = motor.speed[:, i]
            values["motor torque", joint.name] = motor.torque[:, i]
            values["nut contact", joint.name] = nut_contact_force(
                joint.drive, motor.effort[:, i], motor.acceleration[:, i]
            )
    ahead, behind = (
        task_from_joints(mechanism, samples.q + side * 1e-6 * samples.qd, near=task)
        for side in (1, -1)
    )
    for k, name in enumerate(TASK_COORDINATES):
        values[f"{name} range", None] = task[:, k]
        values[f"{name} rate", None] = (ahead - behind)[:, k] / 2e-6
    tip = tip_position(mechanism, samples.q)
    wall = EYE.radius - np.linalg.norm(tip - EYE.centre, axis=1)
    values["retina clearance", None] = np.maximum(
        wall, EYE.clearance + EYE.port - np.linalg.norm(tip, axis=1)
    )
    values["lens clearance", None] = along_the_shaft(tip)
    return values


RANGES = {"tilt": (-2.4, -1.4), "roll": (-0.5, 0.5), "spin": (-1.0, 1.0), "depth": (0.0, 0.03)}
RATES = {"roll": 0.5, "tilt": 0.6, "spin": 0.7, "depth": 0.01}
LENS = Lens(
    read_only_array([0.006, 0.001, -0.004], (3,)),
    read_only_array([0.004, 0.003, 0.0015], (3,)),
    read_only_array(rotation([0.6, 0.0, 0.8], 0.7), (3, 3)),
)
EYE = Eye(read_only_array([0.006, 0.0, -0.010], (3,)), 0.0115, 0.001, 0.003, 0.0002, LENS)
LIMITS = of_task(RANGES, 0.02, RATES, EYE)
LOW = ("nut contact", "retina clearance", "lens clearance")
"""These limits are lower bounds."""


def along_the_shaft(tip: np.ndarray) -> np.ndarray:
    """Return the least distance (n,) of the shaft from the lens, in sizes of the lens.

    The shaft goes from the origin to each tip (n, 3), and is sampled densely.
    """
    best, width = np.full(len(tip), 0.5), 0.5
    for _ in range(3):
        shares = np.clip(best[:, None] + width * np.linspace(-1, 1, 61), 0.0, 1.0)
        scaled = (shares[:, :, None] * tip[:, None] - LENS.centre) @ LENS.frame / LENS.semi_axes
        ratio = np.linalg.norm(scaled, axis=2)
        k = ratio.argmin(axis=1)
        best, width = shares[np.arange(len(tip)), k], width / 20
    return ratio.min(axis=1)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("change", [lambda robot: robot, screw], ids=["as shipped", "antibacklash"])
def test_worst_values_are_those_of_dense_evaluation_by_the_model(
    robot: Robot, seed: int, change
) -> None:
    robot = change(robot)
    trajectory = wavy(np.random.default_rng(seed))
    certificate = check(trajectory, robot, LIMITS)
    values = dense(trajectory, robot)
    compared = 0
    for limit in certificate.limits:
        result = values.get((limit.name, limit.joint))
        if result is None:
            continue
        compared += 1
        if limit.name in LOW:
            assert limit.worst == pytest.approx(result.min(), rel=1e-5, abs=1e-9)
            assert limit.worst <= result.min() + 1e-9
            continue
        bounds = RANGES.get(limit.name.removesuffix(" range"))
        joint = next((j for j in robot.joints if j.name == limit.joint), None)
        low, high = bounds or (
            joint.position if limit.name == "position" else (-limit.limit, limit.limit)
        )
        margin = float(np.minimum(high - result, result - low).min()) / ((high - low) / 2)
        # Dense samples may miss a little of a peak or the instant of a start. The check must not.
        assert limit.margin <= margin + 1e-9
        if limit.name != "motor torque":
            assert limit.margin == pytest.approx(margin, abs=2e-5 * max(1.0, abs(margin)))
    assert compared >= 27


def test_the_way_through_the_port_is_looked_at_where_port_and_retina_meet(robot: Robot) -> None:
    """The tool is inserted along its axis.

    Its least clearance is at a kink, where the distances from port and retina are equal.
    """
    q = np.array([[0.0, 0.55, 0.0, 0.0]])
    zero, end = np.zeros((1, 4)), q - [0.0, 0.0, 0.0, 0.012]
    breaks = np.array([0.0, 3.0])
    trajectory = Trajectory(
        breaks, quintic_coefficients(np.diff(breaks), (q, zero, zero), (end, zero, zero)), ()
    )
    result = limit_of(check(trajectory, robot, LIMITS), "retina clearance")
    direction = tip_position(Mechanism.from_geometry(robot.geometry), end)[0] / 0.012
    depth = np.linspace(0.0, 0.012, 1_000_001)[:, None]
    wall = EYE.radius - np.linalg.norm(depth * direction - EYE.centre, axis=1)
    kink = np.maximum(wall, EYE.clearance + EYE.port - depth[:, 0])
    assert 1000 < kink.argmin() < 990_000
    assert result.worst == pytest.approx(kink.min(), abs=3e-8)


def test_a_trapezoid_has_its_closed_form_extremes(robot: Robot) -> None:
    certificate = check(trapezoids(robot), robot)
    for joint in robot.joints:
        assert limit_of(certificate, "velocity", joint.name).worst <= joint.velocity * SHARE * (
            1 + 1e-9
        )
        assert limit_of(
            certificate, "acceleration", joint.name
        ).worst <= joint.acceleration * SHARE * (1 + 1e-9)
    fastest = [
        max(
            limit_of(certificate, n, j.name).worst
            / (j.velocity if n == "velocity" else j.acceleration)
            for j in robot.joints
        )
        for n in ("velocity", "acceleration")
    ]
    assert fastest == pytest.approx([SHARE, SHARE], rel=1e-9)
    assert certificate.passed
    # Positions are monotone in a trapezoidal motion, so the extremes are at the ends.
    assert limit_of(certificate, "position", "insertion").worst in (0.0, -0.012)


def test_a_rest_to_rest_quintic_has_its_closed_form_extremes(robot: Robot) -> None:
    move, duration = np.array([0.5, 0.0, 0.0, 0.0]), 2.0
    q = np.array([[0.0, 0.5, 0.0, 0.0]])
    zero = np.zeros((1, 4))
    coefficients = quintic_coefficients(
        np.diff(np.array([0.0, duration])), (q, zero, zero), (q + move, zero, zero)
    )
    certificate = check(Trajectory(np.array([0.0, duration]), coefficients, ()), robot)
    velocity = limit_of(certificate, "velocity", "roll")
    assert velocity.worst == pytest.approx(15 / 8 * 0.5 / duration, rel=1e-10)
    assert velocity.time == pytest.approx(duration / 2, abs=1e-4)
    acceleration = limit_of(certificate, "acceleration", "roll")
    assert acceleration.worst == pytest.approx(10 / np.sqrt(3) * 0.5 / duration**2, rel=1e-10)


def test_a_start_is_charged_with_static_friction(robot: Robot) -> None:
    """The torque at the start of a slow motion is the breakaway torque of the model."""
    drive = dataclasses.replace(
        robot.joints[0].drive,
        friction=dataclasses.replace(robot.joints[0].drive.friction, mu_static=0.4),
    )
    joints = (dataclasses.replace(robot.joints[0], drive=drive), *robot.joints[1:])
    robot = dataclasses.replace(robot, joints=joints)
    q = np.array([[0.3, 0.5, 0.0, 0.0]])
    zero = np.zeros((1, 4))
    end = q + [0.05, 0.0, 0.0, 0.0]
    trajectory = Trajectory(
        np.array([0.0, 4.0]),
        quintic_coefficients(np.diff(np.array([0.0, 4.0])), (q, zero, zero), (end, zero, zero)),
        (),
    )
    tau = RigidBody.from_robot(robot).gravity_load(q)[0, 0]
    result = limit_of(check(trajectory, robot), "motor torque", "roll")
    assert result.time == 0.0
    assert result.worst == pytest.approx(abs(float(breakaway_torque(drive, tau, 1.0))), rel=1e-9)


def test_a_held_joint_needs_no_torque_whatever_rounding_does_to_it(robot: Robot) -> None:
    """Coefficients of the size of rounding errors are not a motion.

    A self-locking drive holds its load without torque.
    """
    rng = np.random.default_rng(0)
    coefficients = np.zeros((20, 6, 4))
    coefficients[:, 0] = [0.2, 0.5, 0.1, -0.01]
    coefficients[:, 1:] = rng.normal(size=(20, 5, 4)) * 1e-13
    certificate = check(Trajectory(np.linspace(0, 1, 21), coefficients, ()), robot)
    for name in ("roll", "tilt", "insertion"):
        assert limit_of(certificate, "motor torque", name).worst == 0.0


def test_jumps_are_found_on_either_side_of_a_block(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Jumps inside blocks of pieces and between blocks are found."""
    monkeypatch.setattr("ssm_planner.verification.pieces.PIECES_PER_BLOCK", 4)
    trajectory = wavy(np.random.default_rng(1), pieces=11)
    assert limit_of(check(trajectory, robot), "position jump", "tilt").passed
    for k in range(1, 11):
        coefficients = trajectory.coefficients.copy()
        coefficients[k, 0, 1] += 1e-4
        result = limit_of(
            check(Trajectory(trajectory.breaks.copy(), coefficients, ()), robot),
            "position jump",
            "tilt",
        )
        assert not result.passed
        assert result.worst == pytest.approx(1e-4, rel=1e-6)
        assert result.time in trajectory.breaks[[k, min(k + 1, 10)]]


@pytest.mark.parametrize("seed", range(3))
def test_the_first_look_hides_nothing(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    """The coarse first pass finds the same worst values as a check at the full rate.

    This includes friction that changes quickly.
    """
    robot, trajectory = screw(robot), wavy(np.random.default_rng(seed))
    limits = dataclasses.replace(LIMITS, duty=0.0)
    result = check(trajectory, robot, limits)
    monkeypatch.setattr(sampled_extremes, "FIRST_PASS_PARTS", 1)
    complete = check(trajectory, robot, limits)
    assert result.instants < 0.7 * complete.instants
    for a, b in zip(result.limits, complete.limits, strict=True):
        # Near kinks of the friction, both means are exact to 1e-5.
        assert a.margin == pytest.approx(
            b.margin, abs=3e-5 if a.name == "continuous torque" else 3e-8
        ), a.name


def test_blocks_make_no_difference(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """The number of pieces in a block does not change the result."""
    trajectory = wavy(np.random.default_rng(2), pieces=10)
    complete = check(trajectory, robot, LIMITS)
    monkeypatch.setattr("ssm_planner.verification.pieces.PIECES_PER_BLOCK", 3)
    parts = check(trajectory, robot, LIMITS)
    for a, b in zip(complete.limits, parts.limits, strict=True):
        assert a.margin == pytest.approx(b.margin, abs=3e-8)


def test_a_jerk_limit_is_checked(robot: Robot) -> None:
    joints = tuple(dataclasses.replace(joint, jerk=50.0) for joint in robot.joints)
    certificate = check(smooth(robot), dataclasses.replace(robot, joints=joints))
    assert limit_of(certificate, "acceleration jump", "roll").passed
    trapezoid = check(trapezoids(robot), dataclasses.replace(robot, joints=joints))
    assert not limit_of(trapezoid, "acceleration jump", "roll").passed
    trajectory = smooth(robot)
    jerk = trajectory.sample(np.linspace(0, trajectory.duration, 20001)).qddd
    assert limit_of(certificate, "jerk", "roll").worst == pytest.approx(
        np.abs(jerk[:, 0]).max(), rel=1e-4
    )


def test_no_motor_no_torque_limit_and_it_is_said(robot: Robot) -> None:
    """Without motors, the check lacks limits on torques and lists the missing checks."""
    bare = dataclasses.replace(
        robot,
        joints=tuple(dataclasses.replace(joint, drive=None, motor=None) for joint in robot.joints),
    )
    certificate = check(smooth(bare), bare)
    assert {limit.name for limit in certificate.limits} == {
        "position",
        "velocity",
        "acceleration",
        "position jump",
        "velocity jump",
        "start velocity",
        "end velocity",
    }
    assert len(certificate.unchecked) == 4


def test_a_certificate_survives_json(robot: Robot) -> None:
    certificate = check(smooth(robot), robot, LIMITS)
    assert Certificate.from_dict(certificate.to_dict()) == certificate


def test_the_check_never_imports_the_planner(tmp_path: Path, robot: Robot) -> None:
    plan = write_plan(tmp_path / "plan.json", robot, smooth(robot))
    code = (
        "import argparse, sys; from ssm_planner.cli import check, shared; parser = argparse.ArgumentParser(); "
        "shared.add_arguments(parser, 'check'); status = check.run_check(parser.parse_args(sys.argv[1:])); "
        "assert not [m for m in sys.modules if m.startswith(('ssm_planner.planning', 'toppra', 'ssm_planner.pipeline'))]; "
        "sys.exit(status)"
    )
    result = subprocess.run(
        [sys.executable, "-c", code, str(plan)], capture_output=True, text=True, cwd=ROOT
    )
    assert result.returncode == 0, result.stderr
    assert "check: PASSED" in result.stdout


def test_the_samples_of_a_trajectory_are_not_changed(robot: Robot) -> None:
    trajectory = smooth(robot)
    before = trajectory.coefficients.copy()
    check(trajectory, robot)
    assert np.array_equal(before, trajectory.coefficients)
    assert isinstance(trajectory.sample(np.zeros(1)), Samples)


@pytest.mark.parametrize("seed", drawn(1, range(3)))
@pytest.mark.slow
def test_a_motion_of_an_hour_costs_what_its_pieces_cost(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    """The worst values equal those at many more instants, and dense samples do not exceed them."""
    robot, quick = screw(robot), wavy(np.random.default_rng(seed))
    slow = quick.slower(quick.duration / 3600)
    result, values = check(slow, robot, LIMITS), dense(slow, robot, 20_000)
    for i in (0, 1, 3):
        name = robot.joints[i].name
        assert limit_of(result, "motor torque", name).worst >= np.abs(
            values["motor torque", name]
        ).max() * (1 - 1e-9)
    monkeypatch.setattr(sampled_extremes, "PIECE_INTERVALS_RANGE", (8192, 8192))
    full = check(slow, robot, LIMITS)
    assert result.instants < full.instants / 8
    for a, b in zip(result.limits, full.limits, strict=True):
        assert a.margin == pytest.approx(b.margin, rel=3e-8, abs=3e-8), a.name


def test_a_long_rest_costs_no_more_than_a_short_one(robot: Robot) -> None:
    quick = wavy(np.random.default_rng(5))

    def resting(time: float) -> Trajectory:
        last = np.zeros((1, 6, 4))
        last[0, 0] = quick.sample(quick.breaks[-1]).q[0]
        return Trajectory(
            np.append(quick.breaks, quick.breaks[-1] + time),
            np.concatenate([quick.coefficients, last]),
            (),
        )

    short, long = (check(resting(time), robot, LIMITS) for time in (0.5, 3600.0))
    assert long.instants < 2 * short.instants
    sizes = [len(joint_loads(resting(time), robot)[0].t) for time in (0.5, 3600.0)]
    assert sizes[1] < 2 * sizes[0]
    for a, b in zip(short.limits, long.limits, strict=True):
        assert a.name == "continuous torque" or a.margin == pytest.approx(
            b.margin, rel=3e-8, abs=3e-8
        )
