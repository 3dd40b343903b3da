"""The check selects cases from ranges of friction and payload. No other case in the ranges requires
more torque or heat from a motor.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from ssm_planner.dynamics.motors import drive_torque
from ssm_planner.dynamics.rigid_body import RigidBody, with_payload
from ssm_planner.dynamics.spread import drive_with_values
from ssm_planner.errors import ProblemError
from ssm_planner.problem.posterior import FRICTION_LAWS, LAW_COLUMN
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.verification import bernstein, cases
from ssm_planner.verification.check import check


def test_outermost_sets_are_those_that_no_other_exceeds_or_is_below() -> None:
    rng = np.random.default_rng(4)
    values = np.round(rng.uniform(0, 1, (40, 3)), 1)
    result = cases._extreme_parameter_sets(dict(zip("abc", values.T, strict=True)))
    assert list(result) == ["a", "b", "c"]
    remaining = set(map(tuple, np.column_stack(list(result.values())).tolist()))
    every = np.unique(values, axis=0)
    for row in every:
        others = every[np.any(every != row, axis=1)]
        above, below = np.all(others >= row, axis=1).any(), np.all(others <= row, axis=1).any()
        assert (tuple(row.tolist()) in remaining) == (not (above and below))


def test_a_smaller_friction_of_the_output_can_need_more_torque() -> None:
    """A self-locking drive lowers a load against its friction, and friction of the output carries a
    part of the load.

    A smaller friction of the output therefore leaves more load to the drive.
    """
    sets = {"mu": np.array([0.1, 0.2, 0.2]), "b_oc": np.array([0.2, 0.1, 0.2])}
    result = cases._extreme_parameter_sets(sets)
    assert set(zip(*result.values(), strict=True)) == {(0.1, 0.2), (0.2, 0.1), (0.2, 0.2)}


def motion() -> Trajectory:
    """Return a motion of two pieces, in which joints 1, 2 and 4 start from rest and stop."""
    coefficients = np.zeros((2, 6, 4))
    coefficients[:, 0] = [0.3, 1.15, 0.1, -0.01]
    way = np.array([0.5, -0.3, 0.0, 4e-3])
    coefficients[0, 2], coefficients[1, 1], coefficients[1, 2] = way, 2 * way, -way
    coefficients[1, 0] += way
    return Trajectory(np.array([0.0, 1.0, 2.0]), coefficients, ())


def test_joints_start_at_the_begin_of_the_motion_alone(robot: Robot) -> None:
    """Static friction counts where a joint starts from rest, and not where pieces join."""
    result = cases._SampledMotion(motion(), robot, [0.0])
    moving = np.array([True, True, False, True])
    assert np.array_equal(result.start[0], moving)
    assert not result.start[1:].any()
    assert np.array_equal(result.direction[1:-1], np.sign(result.qd[1:-1]))
    # At the end, each joint stops in the direction of its motion.
    assert np.array_equal(result.direction[-1], np.sign(result.qd[-2]))


def test_a_joint_rests_and_starts_by_the_rule_of_the_nominal_torque(robot: Robot) -> None:
    """A joint may start with a small jump of the velocity.

    A lower speed is noise of a joint at rest.
    """
    velocity = robot.velocities
    coefficients = np.zeros((2, 6, 4))
    coefficients[:, 0] = [0.3, 1.15, 0.1, -0.01]
    coefficients[1, 1:3, :2] = [[3e-8, 3e-8], [0.1, -0.05]] * velocity[:2]
    coefficients[:, 2, 3] = 4e-10 * velocity[3]
    coefficients[1, 1, 3] = 8e-10 * velocity[3]
    coefficients[1, 2, 3] *= -1
    result = cases._SampledMotion(
        Trajectory(np.array([0.0, 1.0, 2.0]), coefficients, ()), robot, [0.0]
    )
    jumped = np.abs(result.qd / velocity - 3e-8).min(axis=0) < 1e-12
    assert jumped.tolist() == [True, True, False, False]
    assert result.start.any(axis=0).tolist() == [True, True, False, False]
    assert result.direction.any(axis=0).tolist() == [True, True, False, False]
    # The second joint reverses and starts again.
    assert {-1.0, 1.0} <= set(result.direction[:, 1])


def test_friction_at_a_start_with_a_small_jump_is_a_case(robot: Robot) -> None:
    """The set with the largest static friction is a case if the nominal torque has a start."""
    joints = []
    for joint in robot.joints:
        if joint.drive is not None and joint.drive.friction is not None:
            mu = joint.drive.friction.mu
            drive = replace(joint.drive, friction_ranges={"mu_static": (mu, 4 * mu)})
            joint = replace(joint, drive=drive)
        joints.append(joint)
    stuck, tilt = replace(robot, joints=tuple(joints)), joints[1]
    coefficients = np.zeros((2, 6, 4))
    coefficients[:, 0] = [0.3, 1.15, 0.1, -0.01]
    worst = []
    for jump in (0.0, 3e-8):
        coefficients[1, 1:3, 1] = [jump * tilt.velocity, 0.05 * tilt.velocity]
        complete = Trajectory(np.array([0.0, 1.0, 2.0]), coefficients.copy(), ())
        worst.append(
            check(complete, stuck, TaskLimits(friction=0.95))["motor torque", "tilt"].worst
        )
    assert worst[1] == pytest.approx(worst[0], rel=1e-6)


def test_cases_are_named_by_their_parameters() -> None:
    assert cases._parameter_text("mu", 0.123456) == "mu 0.1235"
    for k, law in enumerate(FRICTION_LAWS):
        assert cases._parameter_text(LAW_COLUMN, float(k)) == f"{LAW_COLUMN} {law}"


def test_without_a_range_there_are_no_cases(robot: Robot) -> None:
    assert cases.worst_case_torques(motion(), robot, TaskLimits()) == []


def test_payloads_alone_are_named_and_keep_the_stated_friction(robot: Robot) -> None:
    result = cases.worst_case_torques(motion(), robot, TaskLimits(payload=(0.01, 0.05)))
    assert {quantity.index for quantity in result} == {0, 1, 3}
    masses = set()
    for quantity in result:
        case = quantity.case
        assert case is not None
        drive = robot.joints[quantity.index].drive
        assert drive is not None
        assert case.drive.friction.mu == pytest.approx(drive.friction.mu)  # type: ignore[union-attr]
        assert case.description == f"payload {1e3 * case.payload:g} g"
        masses.add(case.payload)
    assert masses == {0.0, 0.01, 0.05}


@pytest.mark.parametrize("lacking", ["motor", "drive"])
def test_a_joint_without_motor_or_drive_has_no_cases(robot: Robot, lacking: str) -> None:
    tilt = replace(robot.joints[1], **{lacking: None})
    lesser = replace(robot, joints=(robot.joints[0], tilt, *robot.joints[2:]))
    quantities = cases.worst_case_torques(motion(), lesser, TaskLimits(payload=(0.01, 0.05)))
    assert {quantity.index for quantity in quantities} == {0, 3}


def test_the_check_reports_the_worst_of_all_payloads(robot: Robot) -> None:
    """Each torque belongs to the payload that loads the motor most, in any order of payloads."""
    payloads = (0.0, 0.08, 0.03)
    certificate = check(motion(), robot, TaskLimits(payload=payloads))
    alone = [check(motion(), with_payload(robot, mass)) for mass in payloads]
    torques = 0
    for line in certificate.limits:
        same = [
            other.margin
            for single in alone
            for other in single.limits
            if (other.name, other.joint) == (line.name, line.joint)
        ]
        if line.name == "motor torque":
            torques += 1
            assert line.margin == pytest.approx(min(same), rel=1e-3)
            assert max(same) > min(same)
    assert torques == 3


def test_no_corner_of_the_ranges_asks_more_than_the_cases(robot: Robot) -> None:
    complete, masses, share = motion(), (0.0, 0.05), 0.95
    limits = TaskLimits(friction=share, payload=(0.0, 0.05))
    joints = []
    for joint in robot.joints:
        if joint.drive is not None and joint.drive.friction is not None:
            stated = joint.drive.friction
            ranges = {"mu": (0.8 * stated.mu, 1.1 * stated.mu), "b_c": (0.0, 2 * stated.b_c)}
            joint = replace(joint, drive=replace(joint.drive, friction_ranges=ranges))
        joints.append(joint)
    robot = replace(robot, joints=tuple(joints))
    result = cases.worst_case_torques(complete, robot, limits)
    t = np.linspace(0.01, 1.99, 100)
    samples = complete.sample(t)
    for i in (0, 1, 3):
        drive = robot.joints[i].drive
        assert drive is not None
        sets = cases.friction_spread(drive).within(share)

        def torque(of: object, mass: float, i: int = i) -> np.ndarray:
            body = RigidBody.from_robot(with_payload(robot, mass))
            tau = body.inverse_dynamics(samples.q, samples.qd, samples.qdd)[:, i]
            state = tau, samples.qd[:, i], samples.qdd[:, i], np.sign(samples.qd[:, i])
            return np.asarray(drive_torque(of, *state, breakaway=np.zeros(100))[0])  # type: ignore[arg-type]

        chosen = [torque(q.case.drive, q.case.payload) for q in result if q.index == i and q.case]
        ends = [sorted({float(column.min()), float(column.max())}) for column in sets.values()]
        for corner, mass in product(product(*ends), masses):
            one = torque(drive_with_values(drive, dict(zip(sets, corner, strict=True))), mass)
            assert one.max() <= max(item.max() for item in chosen) + 1e-12
            assert one.min() >= min(item.min() for item in chosen) - 1e-12
            square = np.mean(one**2)
            assert square <= max(np.mean(item**2) for item in chosen) * (1 + 1e-2)


def test_changes_of_sign_leave_zeros_out() -> None:
    rows = np.array([[1, 0, 2, 3], [1, -1, 1, -1], [1, 0, -1, 0], [-1, -2, 0, -3], [0, 1, 0, -1.0]])
    assert bernstein._count_sign_changes(rows).tolist() == [0, 3, 1, 0, 1]


@pytest.mark.parametrize("zeros", [[0.5], [0.25, 0.5], [0.5, 0.75, 0.3], [0.125, 0.25, 0.625]])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_zeros_on_the_ends_of_halves_are_found_once(zeros: list[float], sign: float) -> None:
    powers = sign * np.poly(zeros)[None, ::-1]
    few = np.repeat(powers, 3, axis=0)
    many = np.repeat(powers, 12, axis=0)
    for rows in (few, many):
        index, result = bernstein.find_sign_changes(
            bernstein.from_powers(rows), np.full(len(rows), 1e-12)
        )
        assert np.array_equal(index, np.repeat(np.arange(len(rows)), len(zeros)))
        assert result.reshape(len(rows), -1) == pytest.approx(
            np.tile(sorted(zeros), (len(rows), 1)), abs=1e-12
        )


@pytest.mark.parametrize("block", [1, 100_000])
def test_extreme_sets_ask_for_the_largest_torques_and_heat(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    """The selected sets have the largest torque, the smallest torque and the largest mean square.

    Blocks of any size give the same sets.
    """
    monkeypatch.setattr(cases, "TORQUES_PER_BLOCK", block)
    masses = [0.0, 0.05]
    coefficients = np.zeros((1, 6, 4))
    coefficients[0, 0], way = [0.3, 1.15, 0.1, -0.01], np.array([0.5, -0.3, 0.2, 4e-3])
    coefficients[0, 2], coefficients[0, 3] = way, -way  # The motion returns to its start.
    complete = cases._SampledMotion(
        Trajectory(np.array([0.0, 1.0]), coefficients, ()), robot, masses
    )
    sets = {"mu": np.array([0.06, 0.15, 0.09, 0.12, 0.07])}
    instants = np.arange(len(complete.qd))
    for i in (0, 1, 3):
        drive = robot.joints[i].drive
        assert drive is not None
        for load in range(len(masses)):
            torque = np.vstack(
                [
                    complete.torque(i, drive_with_values(drive, {"mu": mu}), load, instants)
                    for mu in sets["mu"]
                ]
            )
            expected = {
                (int(np.argmax(torque.max(axis=1))), load),
                (int(np.argmin(torque.min(axis=1))), load),
                (int(np.argmax(np.square(torque).mean(axis=1))), load),
            }
            assert complete.extreme_sets(i, drive, sets, load) == expected


def test_a_range_of_friction_needs_the_uncertainty_of_every_drive(robot: Robot) -> None:
    trajectory = Trajectory(np.array([0.0, 1.0]), np.zeros((1, 6, 4)), ())
    with pytest.raises(ProblemError, match=r"friction = 0\.95: .*joint roll.* has no uncertainty"):
        check(trajectory, robot, TaskLimits(friction=0.95))
