"""The search for stops divides the path at its breaks, bounds the deceleration by accelerations and
torques, and gives the same stops in separate parts.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.verification import stops as module
from tests.support.plans import trapezoids


@pytest.fixture(scope="module")
def motion(robot: Robot) -> Trajectory:
    """Return a motion that starts at 3 s."""
    complete = trapezoids(robot)
    return Trajectory(complete.breaks + 3.0, complete.coefficients, ())


def test_instants_beside_a_break_add_no_node(robot: Robot, motion: Trajectory) -> None:
    """Other instants add a node. The path has the states on both sides of every node."""
    breaks = motion.breaks - 3.0
    plain = module._StopPath.from_motion(motion, robot, np.zeros(0), np.zeros(0))
    for shift in (-0.4 * module.MIN_BREAK_DISTANCE, 0.4 * module.MIN_BREAK_DISTANCE):
        near = np.clip(breaks + shift, 0.0, breaks[-1])
        path = module._StopPath.from_motion(motion, robot, near, np.zeros(0))
        assert np.array_equal(path.s, plain.s)
    apart = (breaks[1:] + 2 * breaks[:-1]) / 3
    path = module._StopPath.from_motion(motion, robot, apart, np.zeros(0))
    assert all(np.abs(path.s - instant).min() < 1e-12 for instant in (*breaks, *apart))
    assert np.diff(path.s).min() > module.MIN_BREAK_DISTANCE
    assert np.diff(plain.s).max() <= max(module.MAX_STEP, breaks[-1] / module.MAX_STEPS) * (
        1 + 1e-9
    )
    for end, (nodes, side) in enumerate(((path.s[:-1], "right"), (path.s[1:], "left"))):
        samples = motion.sample(3.0 + nodes, side)  # type: ignore[arg-type]
        for result, expected in zip(
            (path.q, path.dq, path.ddq), (samples.q, samples.qd, samples.qdd), strict=True
        ):
            assert result[end] == pytest.approx(expected)
    speeds = np.abs(motion.sample(3.0 + path.s).qd)
    slow = module.rest_speeds(robot)
    assert np.array_equal(path.rests, np.all(speeds <= slow, axis=1))
    assert path.rests[[0, -1]].all()


@pytest.mark.parametrize("varying", [(), (0,), (1,), (0, 3), (0, 1, 3)])
def test_torques_have_rows_unless_friction_depends_on_the_speed(
    robot: Robot, motion: Trajectory, varying: tuple[int, ...]
) -> None:
    """There are four rows of accelerations, and two driving and two braking rows of each motor."""
    joints = list(robot.joints)
    for i in varying:
        drive = joints[i].drive
        assert drive is not None
        assert drive.friction is not None
        friction = replace(
            drive.friction,
            law="stribeck_exponential",
            mu_stribeck=0.05,
            stribeck_speed=20.0,
            mu_static=drive.friction.mu + 0.05,
        )
        joints[i] = replace(joints[i], drive=replace(drive, friction=friction))
    changed = replace(robot, joints=tuple(joints))
    path = module._StopPath.from_motion(motion, changed, np.zeros(0), np.zeros(0))
    with np.errstate(divide="ignore", invalid="ignore"):
        bounds = module._DecelerationBounds.from_path(path, changed)
    others = 3 - len(varying)
    assert bounds.speed_dependent_joints == varying
    assert bounds.single_rows == 4 + 2 * others
    assert bounds.terms.shape == (3, 4 + 4 * others, 3 * (len(path.s) - 1))


def test_parts_between_rests_have_the_same_stops(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A long motion is searched in parts, because no stop passes a rest."""
    once = trapezoids(robot)
    length, pieces = once.duration, once.coefficients
    breaks = np.concatenate([once.breaks[:-1] + k * length for k in range(3)] + [[3 * length]])
    motion = Trajectory(breaks, np.concatenate([pieces] * 3), ())
    complete = module.quickest_stops(motion, robot, 200)
    searched = []
    original = module._stops_of_leg

    def search(part: Trajectory, *arguments: object) -> module.StopMotions:
        searched.append(part.duration)
        return original(part, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(module, "MIN_LEG_PIECES", 2)
    monkeypatch.setattr(module, "_stops_of_leg", search)
    parts = module.quickest_stops(motion, robot, 200)
    assert len(searched) >= 3
    assert np.allclose(parts.time, complete.time, atol=1e-12)
    assert np.allclose(parts.duration, complete.duration, atol=1e-9)
    assert np.allclose(parts.travel, complete.travel, atol=1e-12)
    assert np.array_equal(np.diff(parts.edges) > 0, np.diff(complete.edges) > 0)
    assert parts.ends_at_rest == complete.ends_at_rest
    assert parts.joined is not None
