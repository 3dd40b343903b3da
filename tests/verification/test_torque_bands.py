"""The check bounds the motor torques of tables from below and above. Its verdicts agree with the
independent oracle, which knows the exact motion.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from ssm_planner.problem.limits import MotorTorque
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Joint, Robot
from ssm_planner.problem.value import unchecked_copy
from ssm_planner.trajectory import Trajectory
from ssm_planner.verification import torque_bands
from ssm_planner.verification.certificate import Certificate
from ssm_planner.verification.check import check
from tests.campaign.adversary import varied
from tests.support import oracle
from tests.support.plans import smooth, trapezoids
from tests.verification.test_polylines import through

TORQUE = MotorTorque.name


def peaks(motion: Trajectory, robot: Robot) -> dict[str, float]:
    """Return the largest motor torques of a smooth motion by joint, N·m."""
    result = oracle.violations(oracle.from_pieces(motion.breaks, motion.coefficients), robot)
    return {
        joint.name: (1 + result[TORQUE, joint.name]) * joint.motor.max_torque
        for joint in robot.joints
        if joint.motor is not None and joint.drive is not None
    }


def with_torques(robot: Robot, largest: dict[str, float]) -> Robot:
    """Return the robot with other largest motor torques, N·m."""

    def weaker(joint: Joint) -> Joint:
        if joint.name not in largest or joint.motor is None:
            return joint
        torque = max(largest[joint.name], 1e-6)  # A motor must have a torque.
        nominal = min(joint.motor.nominal_torque, torque)
        motor = unchecked_copy(joint.motor, max_torque=torque, nominal_torque=nominal)
        return dataclasses.replace(joint, motor=motor)

    return dataclasses.replace(robot, joints=tuple(map(weaker, robot.joints)), limits=())


def verdicts(certificate: Certificate) -> dict[str, str]:
    """Return the verdicts on the torque by joint."""
    torques = {u.joint: "not judged" for u in certificate.unjudged if u.name == TORQUE}
    lines = [line for line in certificate.limits if line.name == TORQUE]
    assert not torques.keys() & {line.joint for line in lines}
    return torques | {line.joint: certificate.verdict_of(line) for line in lines}  # type: ignore[return-value]


def rows(motion: Trajectory, rng: np.random.Generator, digits: float) -> Trajectory:
    """Return a rounded table of the motion at even or uneven times."""
    count = int(np.exp(rng.uniform(np.log(40), np.log(1500))))
    t = np.linspace(motion.breaks[0], motion.breaks[-1], count)
    if rng.random() < 0.4:
        t[1:-1] += rng.uniform(-0.4, 0.4, count - 2) * (t[1] - t[0])
    q = motion.sample(t).q
    return through(np.round(q / digits) * digits if digits else q, t)


@pytest.mark.parametrize("seed", range(12))
def test_a_verdict_is_that_of_the_oracle(robot: Robot, seed: int) -> None:
    """A verdict never contradicts the oracle.

    The cases vary Stribeck friction, jerk limits, roundings and the density of the rows.
    """
    rng = np.random.default_rng(seed)
    stiff = rng.random() < 0.5
    joints = tuple(varied(joint, rng, stiff) for joint in robot.joints)
    robot = dataclasses.replace(robot, joints=joints, limits=())
    steps = rng.uniform((-0.5, -0.2, -0.5, -0.006), (0.5, 0.15, 0.5, -0.001), (2, 4))
    steps *= rng.random((2, 4)) < 0.8
    steps[0, 0] += 0.05
    make = smooth if stiff else trapezoids
    motion = make(robot, tuple(steps), float(rng.uniform(0.2, 0.9)))
    true = peaks(motion, robot)
    digits = float(rng.choice([0.0, 1e-9, 1e-6, 1e-5]))
    table = rows(motion, rng, digits)
    judged = set()
    for share in (0.2, 0.5, 2 / 3, 0.9, 0.999, 1.001, 1.1, 1.5, 3.0, 30.0):
        weak = with_torques(robot, {name: share * torque for name, torque in true.items()})
        result = verdicts(check(table, weak, resolution=np.full(4, digits / 2)))
        assert result.keys() == true.keys()
        wrong = "kept" if share < 1 else "violated"
        moving = {name for name in result if true[name] > 1e-9}
        assert not [name for name in moving if result[name] == wrong], share
        judged |= {result[name] for name in moving}
    assert {"kept", "not judged"} <= judged


@pytest.mark.parametrize("make", [smooth, trapezoids])
@pytest.mark.parametrize(("rate", "digits"), [(1000.0, 0.0), (1000.0, 1e-6), (200.0, 1e-6)])
def test_fine_tables_are_judged(
    robot: Robot, make: Callable[[Robot], Trajectory], rate: float, digits: float
) -> None:
    """A torque of 1.5 times the limit is violated, and a torque of half the limit is kept."""
    motion = make(robot)
    true = peaks(motion, robot)
    s = motion.uniform(rate)
    table = through(np.round(s.q / digits) * digits if digits else s.q, s.t)
    for share, expected in ((2 / 3, "violated"), (2.0, "kept")):
        weak = with_torques(robot, {name: share * torque for name, torque in true.items()})
        result = check(table, weak, resolution=np.full(4, digits / 2))
        assert set(verdicts(result).values()) == {expected}
        for line in result.limits:
            if line.name == TORQUE:
                assert line.worst == pytest.approx(true[str(line.joint)], rel=0.5)
                assert motion.breaks[0] <= line.time <= motion.breaks[-1]


@pytest.mark.parametrize(
    ("share", "jerk", "widths"),
    [(6.0, None, {64, 16}), (1.0, None, {64, 16, 4, 1}), (6.0, 1e6, {64, 16, 4, 1})],
)
def test_narrow_windows_bound_torques_that_wide_ones_do_not_decide(
    robot: Robot,
    monkeypatch: pytest.MonkeyPatch,
    share: float,
    jerk: float | None,
    widths: set[int],
) -> None:
    """Torques far below their limits are decided by the wide windows.

    A table that exceeds a jerk limit may show a torque in a narrow window alone.
    """
    motion = smooth(robot)
    limits = {name: share * torque for name, torque in peaks(motion, robot).items()}
    strong = with_torques(robot, limits)
    joints = tuple(dataclasses.replace(joint, jerk=jerk) for joint in strong.joints)
    used = set()
    bounds = torque_bands._window_bounds

    def recorded(t: np.ndarray, *values: object, with_torques: bool) -> np.ndarray:
        if with_torques:
            used.add(round(float(t[1, 0, 0] - t[0, 0, 0]) * 1000))
        return bounds(t, *values, with_torques=with_torques)

    monkeypatch.setattr(torque_bands, "_window_bounds", recorded)
    s = motion.uniform(1000.0)
    strong = dataclasses.replace(strong, joints=joints)
    result = check(through(s.q, s.t), strong, resolution=np.zeros(4))
    assert used == widths
    assert set(verdicts(result).values()) == {"kept" if share > 1 else "not judged"}


def test_a_band_that_contains_the_limit_is_stated(robot: Robot) -> None:
    motion = trapezoids(robot)
    true = peaks(motion, robot)
    s = motion.uniform(1000.0)
    result = check(through(s.q, s.t), with_torques(robot, true), resolution=np.zeros(4))
    reasons = {u.joint: u.reason for u in result.unjudged if u.name == TORQUE}
    assert reasons.keys() == true.keys()
    for name, reason in reasons.items():
        low, high = (
            float(reason.split(f"at {word} ")[1].split(" ")[0]) for word in ("least", "most")
        )
        assert 0 < low <= true[str(name)] * 1.01
        assert high >= true[str(name)] * 0.99


@pytest.mark.parametrize("cause", ["too fast", "range of payload"])
def test_a_band_has_no_upper_end_if_its_assumption_fails(robot: Robot, cause: str) -> None:
    """The upper end of a band assumes the limits of acceleration and the nominal payload."""
    motion = smooth(robot)
    s = motion.uniform(1000.0)
    strong = with_torques(robot, {name: 3 * x for name, x in peaks(motion, robot).items()})
    limits = TaskLimits(payload=(0.0, 0.05) if cause == "range of payload" else None)
    t = s.t / 5 if cause == "too fast" else s.t
    result = check(through(s.q, t), strong, limits, resolution=np.zeros(4))
    reasons = [u.reason for u in result.unjudged if u.name == TORQUE]
    assert reasons
    assert all("at least" in reason and "at most" not in reason for reason in reasons)


def test_a_range_of_friction_or_payload_is_never_kept_by_the_nominal_band(robot: Robot) -> None:
    motion = smooth(robot)
    s = motion.uniform(1000.0)
    strong = with_torques(robot, {name: 3 * x for name, x in peaks(motion, robot).items()})
    result = check(
        through(s.q, s.t), strong, TaskLimits(payload=(0.0, 0.05)), resolution=np.zeros(4)
    )
    assert set(verdicts(result).values()) == {"not judged"}


def test_rows_that_do_not_move_need_no_torque(robot: Robot) -> None:
    """A joint with equal rows rests, although its acceleration limit would permit a motion."""
    t = np.linspace(0.0, 1.0, 101)
    q = np.tile([0.3, 1.15, 0.1, -0.01], (101, 1))
    q[:, 3] -= 0.005 * (3 * t**2 - 2 * t**3)
    result = verdicts(check(through(q, t), robot, resolution=np.zeros(4)))
    assert result["roll"] == result["tilt"] == "kept"


@pytest.mark.parametrize(("factor", "violated"), [(1.5, True), (0.95, False)])
def test_rounding_hides_no_acceleration_over_longer_windows(
    robot: Robot, factor: float, violated: bool
) -> None:
    """Rounding explains the acceleration of three adjacent rows, but not that of distant rows."""
    joint, dt = robot.joints[1], 1e-3
    bend = factor * joint.acceleration
    quarter = 0.5 * joint.velocity / bend
    t = np.arange(0.0, 4 * quarter, dt)
    rise = np.minimum(t, quarter) ** 2 / 2 + quarter * np.maximum(t - quarter, 0.0)
    fall = np.clip(t - quarter, 0.0, 2 * quarter) ** 2 / 2
    later = 2 * quarter * np.maximum(t - 3 * quarter, 0.0)
    last = np.maximum(t - 3 * quarter, 0.0) ** 2 / 2
    q = np.tile([0.3, 1.15, 0.1, -0.01], (len(t), 1))
    q[:, 1] += bend * (rise - fall - later + last)
    digits = 2 * joint.acceleration * dt**2
    rounded = np.round(q / digits) * digits
    result = check(through(rounded, t), robot, resolution=np.full(4, digits / 2))
    lines = [line for line in result.violations if line.name == "acceleration"]
    assert [line.joint for line in lines] == ["tilt"] * violated
    assert len(result.violations) == len(lines)
    for line in lines:
        assert line.worst / line.limit == pytest.approx(factor, rel=0.3)
    open_end = TaskLimits(end_rate=None)
    close = check(through(rounded[:4], t[:4]), robot, open_end, resolution=np.full(4, digits / 2))
    assert not close.violations
