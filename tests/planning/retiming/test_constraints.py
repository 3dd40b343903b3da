"""Verify the linear constraints along a path against the dynamics of the motion on that path."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssm_planner.dynamics.motors import drive_torque, motion_directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.planning.retiming.constraints import (
    BINDING_SHARE,
    LinearConstraints,
    PathLimits,
    braking_travel,
)
from ssm_planner.planning.retiming.paths import PolylinePath, SplinePath
from ssm_planner.planning.retiming.reachability import fastest_profile
from ssm_planner.planning.retiming.retime import _grid, _passing_times, holds_tip_speed, retime
from ssm_planner.problem.limits import StopTravel, TaskRate, TipSpeed
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Samples

START = np.array([0.3, 1.15, 0.1, -0.01])
WAY = np.array([0.4, -0.2, 0.1, 0.004])
GRID = np.linspace(0.0, 1.0, 9)


@pytest.fixture(scope="module")
def path(robot: Robot) -> PolylinePath:
    mechanism = Mechanism.from_geometry(robot.geometry)
    return PolylinePath(mechanism, np.stack([START, START + WAY]))


def rows_at(path: PolylinePath, robot: Robot, x: float, **limits: object) -> LinearConstraints:
    """Return the constraints on GRID at the squared path speed x."""
    task_limits = TaskLimits(**limits)  # type: ignore[arg-type]
    along = PathLimits.on_grid(path, GRID, robot, task_limits, moving=True)
    return along.constraints(np.full(9, x))


def random_rows(seed: int) -> LinearConstraints:
    """Return nine rows of random coefficients, with k ≥ 0."""
    rng = np.random.default_rng(seed)
    a, b, c, k = rng.uniform(-0.3, 0.3, (4, 9, 5))
    k = np.abs(k)
    k[:, 1:3] = 0.0
    k[:4, 3] = 0.0  # This joint stands still at the first points.
    return LinearConstraints(a, b, c, k, np.full(9, 4.0))


def test_tangents_touch_and_over_estimate() -> None:
    """A tangent equals its row at the given squared speed and is nowhere below it."""
    rows, x0 = random_rows(1), np.linspace(0.2, 2.0, 9)
    linear = rows.tangent(x0)
    assert not linear.k.any()
    for x in (x0, 0.3 * x0, 3 * x0):
        root = np.sqrt(x)[:, None]
        value = rows.b * x[:, None] + rows.c + rows.k * root
        above = linear.b * x[:, None] + linear.c
        assert np.all(above >= value - 1e-12)
        assert (x is not x0) or above == pytest.approx(value)


def test_the_active_row_is_the_largest_in_the_middle() -> None:
    """The active row is the row with the largest value at the middle of an interval."""
    rows, grid = random_rows(2), np.array([0.0, 0.1, 0.2, 0.35, 0.5, 0.6, 0.8, 0.9, 1.0])
    x = np.linspace(0.5, 1.5, 9) ** 2
    u = np.diff(x) / (2 * np.diff(grid))

    def middle(values: np.ndarray) -> np.ndarray:
        return (values[1:] + values[:-1]) / 2

    mean = middle(x)[:, None]
    value = middle(rows.a) * u[:, None] + middle(rows.b) * mean + middle(rows.c)
    value = value + middle(rows.k) * np.sqrt(mean)
    scaled = LinearConstraints(*(part / value.max() for part in (rows.a, rows.b, rows.c, rows.k)), rows.ceiling)  # fmt: skip
    value = value / value.max()
    expected = np.where(value.max(axis=1) > BINDING_SHARE, value.argmax(axis=1), -1)
    assert np.array_equal(scaled.active(grid, x), expected)
    capped = replace(scaled, ceiling=middle(np.append(x, x[-1])) * 0.5)
    assert (capped.active(grid, x) == 5).all()
    # The ceiling binds where the squared speed reaches it, and not where it has a tenth to spare.
    free = replace(scaled, **{key: getattr(rows, key) * 0 for key in "abck"})
    for share, binding in ((1.0, 5), (0.9, -1)):
        reached = replace(free, ceiling=x / share)
        assert (reached.active(grid, x) == binding).all()


def test_acceleration_rows_are_the_joints(path: PolylinePath, robot: Robot) -> None:
    """The acceleration rows contain the path slope of each joint divided by its limit."""
    rows = rows_at(path, robot, 1.0)
    for i, joint in enumerate(robot.joints):
        for row, sign in ((2 * i, 1), (2 * i + 1, -1)):
            assert rows.a[:, row] == pytest.approx(np.full(9, sign * WAY[i] / joint.acceleration))
            assert not rows.b[:, row].any()
            assert not rows.c[:, row].any()


@pytest.mark.parametrize("u", [3.0, 0.0, -3.0])
def test_torque_rows_bound_the_motor_model(path: PolylinePath, robot: Robot, u: float) -> None:
    """While the motor drives, the largest row equals the torque of the motor model.

    While it brakes, its row is at least as strict as the model.
    """
    x = 0.8
    rows = rows_at(path, robot, x)
    values = rows.a * u + rows.b * x + rows.c + rows.k * np.sqrt(x)
    q = START + GRID[:, None] * WAY
    qd, qdd = np.tile(np.sqrt(x) * WAY, (9, 1)), np.tile(u * WAY, (9, 1))
    samples = Samples(GRID, q, qd, qdd, np.zeros_like(q))
    way, away = motion_directions(robot, samples, 1)
    torque = motor_motion(robot, RigidBody.from_robot(robot), samples, way, away).torque
    count = 8
    for i, joint in enumerate(robot.joints):
        if joint.motor is None:
            continue
        share = np.sign(WAY[i]) * torque[:, i] / joint.motor.max_torque
        driving, braking = values[:, count : count + 2], values[:, count + 2]
        assert driving.max(axis=1) == pytest.approx(share, rel=1e-6, abs=1e-9)
        assert np.all(braking >= -share - 1e-9)
        count += 3
    assert count == rows.a.shape[1]


def with_viscous_friction(robot: Robot, at_motor: float, at_output: float) -> Robot:
    """Return the robot with other viscous friction of its bearings, N·m·s/rad (screw: N·s/m)."""
    joints = []
    for joint in robot.joints:
        if joint.drive is not None:
            friction = replace(joint.drive.friction, b_v=at_motor, b_ov=at_output)
            joint = replace(joint, drive=replace(joint.drive, friction=friction))
        joints.append(joint)
    return replace(robot, joints=tuple(joints))


def test_viscous_friction_at_the_output_of_a_self_locking_drive_helps_to_brake(
    path: PolylinePath, robot: Robot
) -> None:
    """The braking row bounds the torque also if friction at the output carries a part of the load.

    The coefficient of the speed in the row is then negative.
    """
    robot, x, u = with_viscous_friction(robot, 0.0, 1e-3), 0.8, -400.0
    rows = rows_at(path, robot, x)
    values = rows.a * u + rows.b * x + rows.c + rows.k * np.sqrt(x)
    q = START + GRID[:, None] * WAY
    qd, qdd = np.tile(np.sqrt(x) * WAY, (9, 1)), np.tile(u * WAY, (9, 1))
    samples = Samples(GRID, q, qd, qdd, np.zeros_like(q))
    directions = motion_directions(robot, samples, 1)
    torque = motor_motion(robot, RigidBody.from_robot(robot), samples, *directions).torque
    for k, i in enumerate(i for i, joint in enumerate(robot.joints) if joint.motor is not None):
        share = np.sign(WAY[i]) * torque[:, i] / robot.joints[i].motor.max_torque
        assert np.all(values[:, 8 + 3 * k + 2] >= -share - 1e-12)


@pytest.mark.parametrize("way", [1, -1])
def test_at_a_steady_speed_a_braking_row_is_the_torque_itself(
    path: PolylinePath, robot: Robot, way: int
) -> None:
    """Without viscous friction, the braking row equals the negative torque at constant speed.

    This holds for both directions of the load. While a joint accelerates, the row is only a bound.
    """
    robot, pulls = with_viscous_friction(robot, 0.0, 0.0), set()
    line = PolylinePath(path.mechanism, path.points[::way])
    q = line.points[0] + GRID[:, None] * WAY * way
    for x, tilted in ((0.05, 0.0), (0.8, 2.0), (5.0, -1.2)):
        turned = PolylinePath(path.mechanism, line.points + [tilted, 0.0, 0.0, 0.0])
        along = PathLimits.on_grid(turned, GRID, robot, TaskLimits(), moving=True)
        rows = along.constraints(np.full(9, x))
        values = rows.b * x + rows.c + rows.k * np.sqrt(x)
        positions = q + [tilted, 0.0, 0.0, 0.0]
        qd = np.tile(np.sqrt(x) * WAY * way, (9, 1))
        samples = Samples(GRID, positions, qd, 0 * positions, 0 * positions)
        torque = motor_motion(
            robot, RigidBody.from_robot(robot), samples, *motion_directions(robot, samples, 1)
        ).torque
        count = 8
        for i, joint in enumerate(robot.joints):
            if joint.motor is None:
                continue
            share = np.sign(WAY[i] * way) * torque[:, i] / joint.motor.max_torque
            pulls |= set(np.sign(share).tolist())
            assert values[:, count : count + 2].max(axis=1) == pytest.approx(share)
            assert values[:, count + 2] == pytest.approx(-share)
            count += 3


def test_directions_and_starts_along_a_path_that_turns_back(robot: Robot) -> None:
    """Each grid point has the joint's direction after it, also where the joint reverses.

    A joint starts to move, with static friction, at s = 0 and where it reverses.
    """
    mechanism = Mechanism.from_geometry(robot.geometry)
    target, back = START + WAY, START + WAY * [-0.5, 2.0, 1.0, 1.0]
    path = PolylinePath(mechanism, np.stack([START, target, back, back + 0.5 * WAY]))
    grid = np.union1d(np.linspace(0.0, 1.0, 32), path.directions[0])
    along = PathLimits.on_grid(path, grid, robot, TaskLimits())
    ahead = path.sample(np.minimum(grid + 1e-6, 1 - 1e-9)).dq
    assert np.array_equal(along.directions, np.sign(ahead))
    assert {-1.0, 1.0} == set(along.directions[:, 0].tolist())
    moving = along.directions[1:] != 0
    starts = moving & (along.directions[1:] != along.directions[:-1])
    assert along.starts[0].all()
    assert np.array_equal(along.starts[1:], starts)
    # Joint 1 reverses twice, and two joints rest on the second line.
    assert starts.sum(axis=0).tolist() == [2, 0, 1, 1]


def test_a_joint_that_reverses_on_a_path_breaks_away_again(robot: Robot) -> None:
    """Where a joint reverses, a motor that it moves needs the torque of static friction."""
    path = SplinePath(
        Mechanism.from_geometry(robot.geometry),
        START + WAY * np.array([[0.0], [1.0], [0.4]]),
        np.array([1.0, 1.0, 1.0, 0.01]),
        True,
    )
    knots, signs = path.directions
    s, u, x = knots[1:-1], -0.3, 1e-6
    along = PathLimits.on_grid(path, s, robot, TaskLimits())
    rows = along.constraints(np.full(len(s), x))
    values = rows.a * u + rows.b * x + rows.c + rows.k * np.sqrt(x)
    samples = path.sample(s)
    load = RigidBody.from_robot(robot).inverse_dynamics(
        samples.q, samples.dq * np.sqrt(x), samples.dq * u + samples.ddq * x
    )
    reversed_joints, column = 0, 8
    for i, joint in enumerate(robot.joints):
        if joint.motor is None or joint.drive is None:
            continue
        for k in np.flatnonzero(signs[1:, i] != signs[:-1, i]):
            torque, _ = drive_torque(
                joint.drive,
                load[k, i],
                samples.dq[k, i] * np.sqrt(x),
                samples.dq[k, i] * u + samples.ddq[k, i] * x,
                signs[k + 1, i],
                breakaway=True,
            )
            share = signs[k + 1, i] * float(torque) / joint.motor.max_torque
            assert values[k, column : column + 2].max() == pytest.approx(share, rel=1e-6)
            reversed_joints += 1
        column += 3
    assert reversed_joints == 3


def test_ceilings_are_the_speed_limits(path: PolylinePath, robot: Robot) -> None:
    """The ceilings are the limits of joints, motors, tip speed, task rates and stop travel.

    Finite differences give the reference for the tip and the task coordinates.
    """
    limit = np.array([joint.velocity for joint in robot.joints])
    for i, joint in enumerate(robot.joints):
        if joint.motor is not None and joint.drive is not None:
            limit[i] = min(limit[i], joint.motor.max_speed / joint.drive.ratio)
    fastest_joint = (limit / np.abs(WAY)).min()
    assert rows_at(path, robot, 1.0).ceiling == pytest.approx(np.full(9, fastest_joint**2))
    h = 1e-6
    q = START + GRID[:, None] * WAY
    ahead, behind = (tip_position(path.mechanism, q + side * h * WAY) for side in (1, -1))
    tip = np.linalg.norm(ahead - behind, axis=1) / (2 * h)
    result = rows_at(path, robot, 1.0, limits=(TipSpeed(1e-3),)).ceiling
    assert result == pytest.approx((1e-3 / tip) ** 2, rel=1e-5)
    ahead, behind = (task_from_joints(path.mechanism, q + side * h * WAY) for side in (1, -1))
    rate = np.abs(ahead - behind)[:, 1] / (2 * h)
    result = rows_at(path, robot, 1.0, limits=(TaskRate("tilt", 1e-3),)).ceiling
    assert result == pytest.approx((1e-3 / rate) ** 2, rel=1e-4)
    travel = braking_travel(path.mechanism, robot, q, np.tile(WAY, (9, 1)))
    times = np.max(np.abs(WAY) / [joint.acceleration for joint in robot.joints])
    assert travel == pytest.approx(tip * times / 2, rel=1e-5)
    stopped = rows_at(path, robot, 1.0, limits=(StopTravel(1e-5),))
    assert stopped.ceiling == pytest.approx(np.minimum(1e-5 / travel, fastest_joint**2))
    assert stopped.a.shape[1] == rows_at(path, robot, 1.0).a.shape[1] + 4
    for i, joint in enumerate(robot.joints):
        row = 3 * i + 2
        assert stopped.a[:, row] == pytest.approx(np.full(9, -abs(WAY[i]) / joint.acceleration))
        expected = tip / 2e-5 * abs(WAY[i]) / joint.acceleration
        assert stopped.b[:, row] == pytest.approx(expected, rel=1e-5)


def test_grids_have_a_point_on_every_knot(path: PolylinePath, robot: Robot) -> None:
    knots = np.array([0.0, 0.31, 0.5004, 1.0])
    grid = _grid(knots, 20, None)
    assert set(knots.tolist()) <= set(grid.tolist())
    assert len(grid) == 21
    assert np.abs(grid - np.linspace(0, 1, 21)).max() < 0.025 + 1e-12
    assert np.count_nonzero(grid != np.linspace(0, 1, 21)) == 2
    tiny = _grid(np.array([0.0, 1e-4, 1 - 1e-4, 1.0]), 10, None)
    assert (tiny[0], tiny[1], tiny[-2], tiny[-1]) == (0.0, 1e-4, 1 - 1e-4, 1.0)
    rough = retime(path, robot, points=60)
    assert rough.solved
    fine = _grid(knots[[0, -1]], 200, rough)
    steps = np.diff(np.interp(fine, rough.s, rough.times))
    uniform = np.diff(np.interp(np.linspace(0, 1, 201), rough.s, rough.times))
    assert steps.max() < 0.5 * uniform.max()
    assert np.all(np.diff(fine) > 0)


def test_a_motion_within_acceleration_alone_is_the_triangle(
    path: PolylinePath, robot: Robot
) -> None:
    """Without motors, a motion from rest to rest takes T = 2 √(|Δq| / a) of its slowest joint."""
    joints = tuple(replace(joint, drive=None, motor=None, velocity=1e3) for joint in robot.joints)
    free = replace(robot, joints=joints)
    result = retime(path, free, points=300)
    share = max(abs(w) / j.acceleration for w, j in zip(WAY, joints, strict=True))
    assert result.duration == pytest.approx(2 * np.sqrt(share), rel=1e-4)
    assert result.times[-1] == pytest.approx(result.duration)
    slowest = int(np.argmax([abs(w) / j.acceleration for w, j in zip(WAY, joints, strict=True)]))
    half = len(result.active) // 2
    signs = (0, 1) if WAY[slowest] > 0 else (1, 0)
    assert (result.active[: half - 1] == 2 * slowest + signs[0]).all()
    assert (result.active[half + 1 :] == 2 * slowest + signs[1]).all()
    limits = TaskLimits((TipSpeed(2e-3),))
    steady = retime(path, free, limits, points=300)
    assert holds_tip_speed(steady, path, 2e-3 * 0.99)
    assert not holds_tip_speed(result, path, 10.0)
    moving = retime(path, free, points=300, speeds=(0.1, 0.2))
    assert moving.speed_squared[[0, -1]] == pytest.approx([0.01, 0.04])
    impossible = retime(path, free, points=60, speeds=(1e4, 0.0))
    assert not impossible.solved


def test_times_add_up_evenly_accelerated_intervals() -> None:
    grid, speed = np.array([0.0, 0.5, 2.0]), np.array([0.0, 1.0, 2.0])
    assert _passing_times(grid, speed**2) == pytest.approx([0.0, 1.0, 2.0])


def test_a_speed_at_an_end_may_be_rounded_but_not_more() -> None:
    """A speed at an end may exceed the possible speed by rounding, but not by 1e-6.

    The path has the length 1 and the constraints |s̈| ≤ 1 and ṡ² ≤ 1, so ṡ² ≤ min(1, 2 s, 2 (1 −
    s)) from rest to rest.
    """
    grid = np.linspace(0.0, 1.0, 101)
    one, zero = np.ones((101, 1)), np.zeros((101, 2))
    rows = LinearConstraints(np.hstack([one, -one]), zero, zero, zero, np.ones(101))
    for speeds, possible in (
        ((1.0, 0.0), True),
        ((1.0 + 1e-10, 0.0), True),
        ((1.0 + 1e-6, 0.0), False),
        ((0.0, 1.0 + 1e-10), True),
        ((0.0, 1.0 + 1e-6), False),
    ):
        assert (fastest_profile(grid, rows, speeds) is not None) == possible
    complete = fastest_profile(grid, rows, (0.0, 0.0))
    assert complete == pytest.approx(np.minimum(1.0, 2 * np.minimum(grid, 1 - grid)), abs=1e-9)


def with_stribeck(robot: Robot) -> Robot:
    """Return the robot with friction that decreases with the speed at its first joint."""
    joint = robot.joints[0]
    assert joint.drive is not None
    assert joint.drive.friction is not None
    friction = replace(
        joint.drive.friction,
        law="stribeck_exponential",
        mu_stribeck=0.05,
        stribeck_speed=20.0,
        mu_static=joint.drive.friction.mu + 0.05,
    )
    drive = replace(joint.drive, friction=friction)
    return replace(robot, joints=(replace(joint, drive=drive), *robot.joints[1:]))


def test_friction_is_static_at_a_start_and_falls_with_the_speed(
    path: PolylinePath, robot: Robot
) -> None:
    for of, falls in ((robot, False), (with_stribeck(robot), True)):
        in_motion, from_rest = (
            PathLimits.on_grid(path, GRID, of, TaskLimits(), moving=moving)
            for moving in (True, False)
        )
        drive = of.joints[0].drive
        assert drive is not None
        friction = drive.friction
        assert friction is not None
        x = np.linspace(0.1, 2.0, 9)
        w = drive.ratio * abs(WAY[0]) * np.sqrt(x)
        rise = friction.mu_stribeck * np.exp(-2 * w / 20.0) if falls else 0.0
        moving = in_motion._friction_coefficient(drive, 0, x)
        assert moving == pytest.approx(np.broadcast_to(friction.mu + rise, 9))
        starting = from_rest._friction_coefficient(drive, 0, x)
        assert starting[1:] == pytest.approx(moving[1:])
        assert starting[0] >= max(friction.mu_static, moving[0]) * (1 - 1e-12)
        one, other = in_motion.constraints(x), from_rest.constraints(x)
        assert not np.allclose(one.c[0], other.c[0])
        assert other.c[1:] == pytest.approx(one.c[1:])


def test_a_joint_without_motor_has_no_torque_rows(path: PolylinePath, robot: Robot) -> None:
    joints = tuple(replace(joint, motor=None, alternatives=()) for joint in robot.joints)
    assert rows_at(path, replace(robot, joints=joints), 1.0).a.shape[1] == 8
