"""The check finds the farthest stop of a motion with a coarse and a closer search. It also handles
motions that are performed once, missing motors and drives, and the lowest friction of self-locking
drives.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ssm_planner.problem.limits import ContinuousTorque, SelfLocking, StopTravel
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory, quintic_coefficients
from ssm_planner.verification import check as module
from ssm_planner.verification.check import check
from ssm_planner.verification.stops import quickest_stops

START = np.array([0.3, 1.15, 0.1, -0.01])
WAY = np.array([0.1, -0.05, 0.0, 1e-3])


def motion(ends_at_rest: bool = True) -> Trajectory:
    """Return one quintic of 0.5 s that starts at rest at 1 s."""
    zero = np.zeros((1, 4))
    speed = zero if ends_at_rest else WAY[None]
    end = (START + WAY)[None]
    piece = quintic_coefficients(
        np.diff(np.array([0.0, 0.5])), (START[None], zero, zero), (end, speed, zero)
    )
    return Trajectory(np.array([1.0, 1.5]), piece, ())


def of_stop(trajectory: Trajectory, robot: Robot, way: float, **more: object) -> object:
    limits = TaskLimits((StopTravel(way),), **more)  # type: ignore[arg-type]
    return next(c for c in check(trajectory, robot, limits).limits if c.name == "stop travel")


def test_the_farthest_stop_is_that_of_a_closer_look(robot: Robot) -> None:
    """The reported travel is at least that of the coarse search."""
    complete = motion()
    stops = quickest_stops(complete, robot)
    line = of_stop(complete, robot, 0.01)
    k = int(np.argmax(stops.travel))
    assert stops.travel[k] <= line.worst <= 1.05 * stops.travel[k]
    assert line.time == pytest.approx(1.0 + stops.time[k], abs=2e-3)
    assert line.margin == pytest.approx(1 - line.worst / 0.01)
    assert line.case is None
    assert not of_stop(complete, robot, 0.9 * line.worst).passed


def test_a_motion_that_ends_moving_has_no_stops_to_rely_on(robot: Robot) -> None:
    """A motion that does not end at rest fails the limit on the stop travel."""
    line = of_stop(motion(ends_at_rest=False), robot, 0.01, end_rate=None)
    assert line.case == "the motion does not end at rest"
    assert line.margin == -1.0


def test_a_stop_that_exceeds_another_limit_says_which(robot: Robot) -> None:
    low, high = START[0] - 1.0, START[0] + 0.05
    joints = (replace(robot.joints[0], position=(low, high)), *robot.joints[1:])
    line = of_stop(motion(), replace(robot, joints=joints), 0.01)
    assert line.case == "a stop exceeds position of roll"
    assert line.margin < 0


def test_stops_are_joined_one_after_the_other(robot: Robot) -> None:
    stops = quickest_stops(motion(), robot, np.array([0.1, 0.25, 0.5]))
    assert stops.time == pytest.approx([0.1, 0.25, 0.5], abs=2e-3)
    assert stops.motions[2] is None
    assert stops.duration[2] == 0.0
    joined = stops.joined
    assert joined is not None
    assert joined.duration == pytest.approx(stops.duration.sum())
    for k, one in enumerate(stops.motions[:2]):
        assert one is not None
        assert one.duration == pytest.approx(stops.duration[k])
        last = one.sample(one.breaks[-1:], "left")
        assert np.abs(last.qd).max() < 1e-6
    rest = Trajectory(
        np.array([0.0, 1.0]), np.zeros((1, 6, 4)) + START * (np.arange(6) == 0)[:, None], ()
    )
    none = quickest_stops(rest, robot, 5)
    assert none.joined is None
    assert none.motions == (None,) * 5
    assert none.pieces[1].shape == (0, 6, 4)
    assert none.ends_at_rest
    assert not none.duration.any()
    assert not none.travel.any()


def test_a_motion_done_once_is_not_held_against_what_motors_give_for_all_time(robot: Robot) -> None:
    """The continuous torque is not checked for a motion that is performed once."""
    for duty, count in ((None, 0), (0.0, 3), (10.0, 3)):
        result = check(motion(), robot, TaskLimits(duty=duty))
        lines = [line for line in result.limits if line.name == ContinuousTorque.name]
        assert len(lines) == count
        assert any("continuous torque" in note for note in result.unchecked) == (count == 0)
    assert module.STOP_SAMPLING_RATE < module.SAMPLING_RATE


def test_missing_data_for_the_torque_of_a_joint_are_named(robot: Robot) -> None:
    joint = robot.joints[0]
    assert joint.motor is not None
    for changes, text in (
        ({"motor": None}, "names no motor for it"),
        ({"motor": None, "drive": None}, "names no drive and no motor for it"),
        ({"drive": None}, f"names no drive for it, so its motor {joint.motor.name} is ignored"),
    ):
        changed = replace(joint, **changes)
        result = check(motion(), replace(robot, joints=(changed, *robot.joints[1:])))
        notes = [note for note in result.unchecked if f"of joint {joint.name}:" in note]
        assert len(notes) == 1
        assert text in notes[0]
        judged = {(line.name, line.joint) for line in result.limits}
        assert ("motor torque", joint.name) not in judged
        assert ("self-locking", joint.name) not in judged or "drive" not in changes


def test_drives_that_lock_do_so_at_the_lowest_friction_of_their_range(robot: Robot) -> None:
    """The lowest friction of the range is compared with the friction that a drive needs to lock.

    The needed friction follows from the lead, and not from the range.
    """

    def lines(share: float | None, low: float) -> dict[str | None, object]:
        joints = []
        for joint in robot.joints:
            if joint.drive is not None and joint.drive.friction is not None:
                mu = joint.drive.friction.mu
                friction = replace(joint.drive.friction, mu_lowest=None)
                ranges = {"mu": (low * mu, 1.1 * mu)}
                drive = replace(joint.drive, friction=friction, friction_ranges=ranges)
                joint = replace(joint, drive=drive)
            joints.append(joint)
        changed = replace(robot, joints=tuple(joints))
        return {
            line.joint: line
            for line in module._check_self_locking(changed, share)
            if line.name == SelfLocking.name
        }

    complete, none, part = lines(1.0, 0.9), lines(None, 0.9), lines(1.0, 0.95)
    assert set(complete) == {j.name for j in robot.joints if j.drive and j.drive.self_locking}
    for name, line in complete.items():
        drive = robot.joints[[j.name for j in robot.joints].index(name)].drive
        mu = drive.friction.mu
        assert none[name].worst == pytest.approx(mu)
        assert none[name].case is None
        assert line.worst == pytest.approx(0.9 * mu)
        assert part[name].worst == pytest.approx(0.95 * mu)
        assert line.case == f"mu {0.9 * mu:.4g}"
        # The needed friction follows from the lead alone.
        assert line.limit == pytest.approx(none[name].limit) == pytest.approx(part[name].limit)
        for item in (line, none[name], part[name]):
            assert item.margin == pytest.approx(item.worst / item.limit - 1)


@pytest.mark.parametrize("k", [0, 1, 3, 4])
def test_the_closer_look_lies_between_the_neighbours_of_the_farthest_stop(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, k: int
) -> None:
    """A second search lies between the neighbours of the farthest stop.

    The farther stop of both searches is reported with its time.
    """
    coarse = np.array([0.0, 0.1, 0.15, 0.3, 0.5])
    looks = []

    def stops(_: Trajectory, __: Robot, time: np.ndarray = coarse) -> SimpleNamespace:
        looks.append(time)
        travel = np.full(len(time), 1e-3)
        travel[k if time is coarse else 1] = 2e-3 if time is coarse else closest
        return SimpleNamespace(time=time, travel=travel, ends_at_rest=True)

    passed = SimpleNamespace(worst=SimpleNamespace(passed=True, margin=0.5))
    monkeypatch.setattr(module, "quickest_stops", stops)
    monkeypatch.setattr(module, "check_stops", lambda *_: passed)
    for closest in (3e-3, 1.5e-3):
        looks.clear()
        (line,) = module._check_stop_travel(motion(), robot, TaskLimits((StopTravel(0.01),)))
        closer = looks[1]
        ends = coarse[max(k - 1, 0)], coarse[min(k + 1, 4)]
        assert (closer[0], closer[-1]) == ends
        assert len(closer) == module.REFINEMENT_INSTANTS
        assert np.diff(closer) == pytest.approx(
            (ends[1] - ends[0]) / (module.REFINEMENT_INSTANTS - 1)
        )
        assert line.worst == max(2e-3, closest)
        assert line.time == 1.0 + (closer[1] if closest > 2e-3 else coarse[k])


def test_straight_pieces_have_no_torque_in_any_case(robot: Robot) -> None:
    """Linear pieces have no defined acceleration, and therefore no torque for any payload."""
    line = Trajectory(
        np.array([0.0, 1.0]), np.zeros((1, 6, 4)) + START * (np.arange(6) == 0)[:, None], ()
    )
    limits = TaskLimits(payload=(0.0, 0.05))
    names = {c.name for c in check(line, robot, limits, resolution=np.zeros(4)).limits}
    assert "motor torque" not in names
    assert "acceleration" not in names
    assert {"position", "velocity"} <= names
    assert "motor torque" in {c.name for c in check(line, robot, limits).limits}


def test_a_certificate_is_sealed_on_demand(robot: Robot) -> None:
    assert check(motion(), robot).sha256 is None
    assert check(motion(), robot, seal=True).sha256 is not None
