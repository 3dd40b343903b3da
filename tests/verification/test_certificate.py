"""A certificate states the worst value and the margin of each limit. Its seal detects every change
of the motion, the robot or the limits.
"""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from ssm_planner.errors import TrajectoryError
from ssm_planner.problem.limits import JointVelocity, TaskRange
from ssm_planner.problem.motion import Straight
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Span, Trajectory
from ssm_planner.verification.certificate import (
    ROUNDING_TOLERANCE,
    Certificate,
    LimitCheck,
    seal_error,
    with_seal,
)
from ssm_planner.verification.limits import LimitedQuantity, WorstValue

LINE = LimitCheck("velocity", "roll", 0.5, 2.0, 0.75, 1.5, "rad/s")


def motion(last: float = 1.0) -> Trajectory:
    coefficients = np.zeros((2, 6, 4))
    coefficients[1, 0, 0] = last
    return Trajectory(np.array([0.0, 1.0, 2.0]), coefficients, (Span("all", 0.0, 2.0),))


def test_margins_are_shares_of_the_limit(robot: Robot) -> None:
    """A margin is the unused fraction of a limit, and is negative for a violation."""
    limit = robot.joints[0].limit(JointVelocity)
    result = LimitCheck.from_extreme(limit, 0.25 * limit.high, 1.5)
    assert result.margin == pytest.approx(0.75)
    assert (result.worst, result.limit, result.time) == (0.25 * limit.high, limit.high, 1.5)
    assert LimitCheck.from_extreme(limit, 1.5 * limit.high, 0.0).margin == pytest.approx(-0.5)


def test_a_limit_is_kept_up_to_rounding() -> None:
    assert ROUNDING_TOLERANCE == 1e-6  # This is relative to the limit, as documented.
    assert replace(LINE, margin=-ROUNDING_TOLERANCE).passed
    assert not replace(LINE, margin=-1.01 * ROUNDING_TOLERANCE).passed
    good, bad = Certificate((LINE,), "x", 3), replace(LINE, margin=-0.1)
    assert good.passed
    assert not Certificate((), "x", 3).passed
    both = good.with_more((bad,))
    assert not both.passed
    assert both.worst == bad
    assert both.violations == (bad,)
    assert good.with_more(()) == good


def test_a_certificate_survives_json_and_refuses_what_is_none() -> None:
    certificate = Certificate((LINE, replace(LINE, joint=None, case="mu 0.1")), "cubic", 7, ("a",))
    data = json.loads(json.dumps(certificate.to_dict()))
    assert Certificate.from_dict(data) == certificate
    stamped = {**data, "sha256": "ab"}
    assert Certificate.from_dict(stamped).sha256 == "ab"
    assert Certificate.from_dict({**stamped, "passed": False}).sha256 is None
    for key in ("limits", "unchecked", "instants", "interpolation"):
        with pytest.raises(TrajectoryError, match="not a certificate"):
            Certificate.from_dict({name: data[name] for name in data if name != key})
    for instants in (7.0, True, "7"):
        with pytest.raises(TrajectoryError, match="not a certificate"):
            Certificate.from_dict({**data, "instants": instants})
    line = data["limits"][0]
    for key in ("worst", "limit", "margin", "time", "joint", "name", "unit"):
        with pytest.raises(TrajectoryError, match="not a line of a certificate"):
            LimitCheck.from_dict({name: line[name] for name in line if name != key})
    with pytest.raises(TrajectoryError, match="not a line of a certificate"):
        LimitCheck.from_dict({**line, "worst": "fast"})


def test_the_seal_breaks_with_whatever_it_was_given_for(robot: Robot) -> None:
    """The seal detects a change of the certificate, the motion, the robot or the limits."""
    limits, way = TaskLimits((TaskRange("tilt", -2.0, -1.5),)), motion()
    certificate = with_seal(Certificate((LINE,), "x", 3), way, robot, limits)
    other = with_seal(Certificate((LINE,), "x", 3), motion(2.0), robot, limits)
    assert certificate.sha256 != other.sha256
    assert seal_error(certificate, way, robot, limits) is None
    assert seal_error(certificate, motion(), robot, limits) is None
    joints = (replace(robot.joints[0], velocity=1.0), *robot.joints[1:])
    for changed in (
        (replace(certificate, instants=4), way, robot, limits),
        (replace(certificate, limits=(replace(LINE, margin=0.7),)), way, robot, limits),
        (certificate, motion(1.0 + 1e-15), robot, limits),
        (certificate, way, replace(robot, joints=joints), limits),
        (certificate, way, robot, TaskLimits((TaskRange("tilt", -2.0, -1.6),))),
        (certificate, way, robot, replace(limits, start_rate={"tilt": 0.1})),
        (certificate, way, robot, replace(limits, end_rate={"tilt": 0.1})),
        (certificate, way, robot, replace(limits, duty=1.0)),
    ):
        assert "changed after the check" in str(seal_error(*changed))
    longer = Trajectory(np.array([0.0, 1.0, 2.1]), way.coefficients, way.phases)
    assert seal_error(certificate, longer, robot, limits)
    assert "no seal" in str(seal_error(replace(certificate, sha256=None), way, robot, limits))
    assert "names no limits" in str(seal_error(replace(certificate, limits=()), way, robot, limits))


def test_promises_are_part_of_the_seal_of_those_who_made_them(robot: Robot) -> None:
    """The seal covers the motions of the problem if the certificate has promises about them."""
    way = motion()
    promise = replace(LINE, name="path departure", joint=None)
    one, other = (TaskLimits(motion=(Straight(tilt=tilt),)) for tilt in (-1.8, -1.9))
    again = TaskLimits(motion=(Straight(tilt=-1.8, duration=3.0),))
    for line, part in ((LINE, False), (promise, True)):
        certificate = with_seal(Certificate((line,), "x", 3), way, robot, one)
        assert (seal_error(certificate, way, robot, other) is not None) == part
        assert seal_error(certificate, way, robot, again) is None


@pytest.mark.parametrize("value", [-2.3, -2.0, -1.8, -1.6, -1.0, -0.2])
def test_a_range_is_judged_at_its_nearer_end(value: float) -> None:
    quantity = LimitedQuantity(TaskRange("tilt", -2.0, -1.0), 1)
    margin = min(value + 2.0, -1.0 - value) / 0.5
    (excess,) = quantity.excess(np.array([value]), np.array([value]))
    assert excess == pytest.approx(-margin)
    worst = WorstValue(quantity)
    worst.update(float(excess), value, 0.7)
    worst.update(float(excess) - 1.0, 5.0, 0.9)
    check = worst.to_limit_check()
    assert check.margin == pytest.approx(margin)
    assert (check.worst, check.time) == (value, 0.7)
    assert check.limit == (-1.0 if value >= -1.5 else -2.0)
    worst.update(float(excess), 6.0, 1.1)
    assert worst.value == value  # The first of equal values counts.


def test_a_magnitude_is_stated_without_its_sign(robot: Robot) -> None:
    limit = robot.joints[0].limit(JointVelocity)
    worst = WorstValue(LimitedQuantity(limit, 0, 1))
    worst.update(-0.5, -0.5 * limit.high, 2.0)
    check = worst.to_limit_check()
    assert (check.worst, check.limit, check.margin) == (0.5 * limit.high, limit.high, 0.5)
    assert not worst.quantity.has_kinks
