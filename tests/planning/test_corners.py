"""Verify plans for a range of friction and payload.

An independent computation of the motor torques covers every corner of the ranges and random values
inside.
"""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ssm_planner.dynamics.motors import drive_torque
from ssm_planner.dynamics.rigid_body import with_payload
from ssm_planner.dynamics.spread import drive_with_values, friction_spread
from ssm_planner.dynamics.transmission import self_locking_margin
from ssm_planner.errors import ProblemError
from ssm_planner.loading.load import load_problem
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.corners import bounding_drives, with_corners
from ssm_planner.planning.planner import plan_motion
from ssm_planner.plans import Plan, load_plan
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import Robot
from ssm_planner.reporting.text import solver_and_condition_lines
from ssm_planner.sizing.joint_load import joint_loads
from ssm_planner.typing import Array
from ssm_planner.verification.check import check
from tests.support.cases import selected
from tests.support.paths import PROBLEMS

PAYLOAD = (0.0, 0.03)
SLOW = pytest.mark.slow
RANGED = ("mu", "b_c", "b_v", "b_oc")


def with_ranges(drive: Drive) -> Drive:
    """Return the drive with ranges of ±15 % for its friction parameters."""
    stated = {name: getattr(drive.friction, name) for name in RANGED}
    return replace(
        drive,
        friction_ranges={name: (0.85 * value, 1.15 * value) for name, value in stated.items()},
    )


def with_covariance(drive: Drive) -> Drive:
    """Return the drive with a covariance of μ, b_c and b_v.

    The correlation of b_c with each of the other two is -0.6.
    """
    sigma = {name: 0.06 * getattr(drive.friction, name) for name in ("mu", "b_c", "b_v")}
    tied = {("mu", "b_c"): -0.6, ("b_c", "b_v"): -0.6}
    table = {
        a: {
            b: sigma[a] * sigma[b] * (1.0 if a == b else tied.get((a, b), tied.get((b, a), 0.0)))
            for b in sigma
        }
        for a in sigma
    }
    return replace(drive, friction=replace(drive.friction, covariance=table))


KINDS = {"ranges": with_ranges, "covariance": with_covariance}


def stated(name: str, kind: str) -> Problem:
    """Return a shipped problem whose drives state the uncertainty of their friction."""
    problem = load_problem(PROBLEMS / f"{name}.yaml")
    joints = (
        joint if joint.drive is None else replace(joint, drive=KINDS[kind](joint.drive))
        for joint in problem.robot.joints
    )
    return replace(problem, robot=replace(problem.robot, joints=tuple(joints)))


@cache
def weakened(name: str, kind: str, factor: float) -> Problem:
    """Return a shipped problem with motors of `factor` times the torque of the nominal motion."""
    problem = stated(name, kind)
    peaks = {
        load.joint: float(np.abs(load.torque()).max())
        for load in joint_loads(plan_motion(problem).trajectory, problem.robot)
    }
    joints = []
    for joint in problem.robot.joints:
        if joint.drive is not None:
            most = factor * peaks[joint.name]
            motor = replace(joint.motor, max_torque=most, nominal_torque=most)
            joint = replace(joint, motor=motor)
        joints.append(joint)
    return replace(problem, robot=replace(problem.robot, joints=tuple(joints)))


def draws(drive: Drive, rng: np.random.Generator, count: int = 1000) -> dict[str, Array]:
    """Return friction parameters by name, each an array of random values.

    For ranges, the arrays contain every corner and `count` uniform random values. For a covariance,
    they contain `count` samples of the 95 % region; the second half are mixtures of two samples.
    """
    if drive.friction_ranges:
        ends = list(drive.friction_ranges.values())
        rows = [*itertools.product(*ends), *(rng.uniform(*np.array(ends).T) for _ in range(count))]
        return dict(zip(drive.friction_ranges, np.array(rows).T, strict=True))
    inside = friction_spread(drive).within(0.95)
    pairs, share = rng.integers(len(inside["mu"]), size=(count, 2)), rng.uniform(size=count)
    share[: count // 2] = 0.0
    return {
        name: share * column[pairs[:, 0]] + (1 - share) * column[pairs[:, 1]]
        for name, column in inside.items()
    }


def largest_excess(made: Plan, robot: Robot, payload: tuple[float, ...]) -> float:
    """Return the largest excess of a motor torque over its limit, as a fraction of the limit.

    It covers the ends of the payload range, two random payloads, corners and random friction
    values. EVERY_CASE=1 uses five times as many random values.
    """
    rng = np.random.default_rng(4)
    worst = -np.inf
    for mass in (*payload, *rng.uniform(min(payload), max(payload), 2)):
        for load in joint_loads(made.motion, with_payload(robot, float(mass)), rate=200.0):
            sets = draws(load.drive, rng, selected(200, every=1000))
            for first in range(0, len(sets["mu"]), 50):
                part = {name: column[first : first + 50, None] for name, column in sets.items()}
                drawn_load = replace(load, drive=drive_with_values(load.drive, part))
                torque = np.abs(drawn_load.torque()).max()
                worst = max(worst, float(torque) / load.motor.max_torque - 1)
    return worst


@pytest.mark.parametrize("kind", KINDS)
def test_few_drives_bound_all_within_a_range(robot: Robot, kind: str) -> None:
    """At most eight drives with extreme friction bound the torque of all drives in the range."""
    rng = np.random.default_rng(2)
    for joint in robot.joints:
        if joint.drive is None:
            continue
        drive = KINDS[kind](joint.drive)
        speed, torque = joint.velocity * drive.ratio, joint.motor.max_torque / 3
        *upper, least = bounding_drives(drive, 0.95, speed=speed, torque=torque)
        assert len(upper) <= 8
        sets = {name: column[:, None] for name, column in draws(drive, rng).items()}
        way = rng.choice([-1.0, 1.0], 300)
        qd = way * rng.uniform(0, speed / drive.ratio, 300)
        effort = rng.uniform(-1, 1, 300) * torque / (drive.gamma * np.tan(drive.lead_angle + 0.1))
        for start in (False, True):
            motion = effort, np.where(start, 0.0, qd), np.zeros(300), way

            def taken(of: Drive, motion: tuple[Array, ...] = motion, start: bool = start) -> Array:
                return motion[3] * drive_torque(of, *motion, breakaway=np.full(300, start))[0]

            inside = taken(drive_with_values(drive, sets))
            bound = np.max([taken(item) for item in upper], axis=0)
            # The comparison covers torques up to that of the motor.
            assert np.all(np.minimum(inside.max(axis=0), torque) <= bound + 1e-6 * torque)
            assert np.all(np.minimum(bound, torque) <= inside.max(axis=0) + 0.05 * torque)
            assert np.all(inside.min(axis=0) >= np.minimum(taken(least), 0.0) - 1e-3 * torque)


@pytest.mark.parametrize(
    ("name", "kind", "factor", "planner", "payload"),
    [
        pytest.param("tilt_insert", "ranges", 1.12, "toppra", PAYLOAD, marks=SLOW),
        pytest.param("tilt_insert", "ranges", 1.12, "optimal", PAYLOAD, marks=SLOW),
        pytest.param("tilt_insert", "covariance", 1.03, "optimal", PAYLOAD, marks=SLOW),
        ("eye_approach", "ranges", 1.15, "optimal", None),
        pytest.param("waypoints", "ranges", 1.15, "optimal", PAYLOAD, marks=SLOW),
    ],
)
@pytest.mark.slow
def test_torques_hold_at_every_corner_and_draw(
    name: str, kind: str, factor: float, planner: str, payload: tuple[float, float] | None
) -> None:
    """No torque limit is exceeded at any corner or random value within the range."""
    problem = (
        replace(weakened(name, kind, factor), planner=planner)
        if planner == "toppra"
        else weakened(name, kind, factor)
    )
    ranged, masses = replace(problem, friction=0.95, payload=payload), payload or (0.0,)
    result = plan(ranged)
    assert result.passed, result.reason
    assert largest_excess(result, ranged.robot, masses) <= 1e-6
    torques = [limit for limit in result.certificate.limits if limit.name == "motor torque"]
    assert len(torques) == 3
    assert all(
        "mu " in limit.case and ("payload" in limit.case) == bool(payload) for limit in torques
    )
    assert min(limit.margin for limit in torques) < 0.02
    # With heat in the objective, a motion may be slightly longer than the fastest one.
    assert result.duration > result.nominal_duration * (1 - 5e-3)
    # The motion for the nominal friction exceeds a torque limit.
    nominal = plan(problem)
    assert nominal.duration == pytest.approx(result.nominal_duration, rel=1e-6)
    assert largest_excess(nominal, ranged.robot, masses) > 0.01


def test_toppra_keeps_the_rows_of_every_corner() -> None:
    """With weak motors, the constraints of other corners bind too.

    Therefore the motion takes longer than a motion for the first corner alone.
    """
    weak = replace(weakened("tilt_insert", "ranges", 1.12), planner="toppra")
    problem = replace(weak, friction=0.95, payload=PAYLOAD, motion=weak.motion[:1])
    result = plan(problem)
    assert result.passed
    robot = with_corners(problem, problem.robot)
    first = replace(problem, robot=robot.corners[0], friction=None, payload=None)
    assert plan_motion(first).phases[0].duration < (1 - 1e-4) * result.duration


def test_the_cost_and_the_worst_case_are_said_and_stored(tmp_path: Path) -> None:
    """The report states the cost and the worst case of a range, and the plan file stores both."""
    ranged = replace(weakened("tilt_insert", "ranges", 1.12), friction=0.95, payload=PAYLOAD)
    result = plan(ranged)
    said = "\n".join(solver_and_condition_lines(result))
    assert "friction within 95 %, payload up to 30 g: +" in said
    assert "joint tilt: worst, margin" in said
    again = load_plan(result.write(tmp_path / "plan.json"))
    assert again.passed
    assert (again.nominal_duration, again.problem.friction, again.problem.payload) == (
        result.nominal_duration,
        0.95,
        PAYLOAD,
    )
    assert [limit.case for limit in again.certificate.limits] == [
        limit.case for limit in result.certificate.limits
    ]
    # A plan file whose range was widened afterwards has no valid certificate.
    document = json.loads((tmp_path / "plan.json").read_text(encoding="utf-8"))
    document["problem"]["payload"] = [0.0, 0.05]
    (tmp_path / "plan.json").write_text(json.dumps(document), encoding="utf-8")
    assert not load_plan(tmp_path / "plan.json").passed


def test_the_range_of_friction_counts_for_self_locking(robot: Robot) -> None:
    """The check of self-locking uses the lower end of the friction range."""
    problem = load_problem(PROBLEMS / "tilt_insert.yaml")
    motion = plan_motion(problem).trajectory
    joint = robot.joints[0]
    needed = joint.drive.friction.mu - float(self_locking_margin(joint.drive)[0])
    for low, holds in ((1.05 * needed, True), (0.95 * needed, False)):
        friction = replace(
            joint.drive.friction, mu=1.5 * needed, mu_static=1.5 * needed, mu_lowest=None
        )
        drive = replace(joint.drive, friction=friction, friction_ranges={"mu": (low, 2 * needed)})
        others = (
            item if item.drive is None else replace(item, drive=with_ranges(item.drive))
            for item in robot.joints[1:]
        )
        judged = replace(robot, joints=(replace(joint, drive=drive), *others))
        for share in (None, 0.95):
            result = check(
                motion, judged, replace(problem.task_limits, friction=share, payload=None)
            )
            locking = next(
                item
                for item in result.limits
                if (item.name, item.joint) == ("self-locking", joint.name)
            )
            assert locking.passed == (holds or share is None)
            if share is not None:
                assert (locking.worst, locking.case) == (pytest.approx(low), f"mu {low:.4g}")


def test_a_problem_file_states_the_range(tmp_path: Path) -> None:
    text = (PROBLEMS / "tilt_insert.yaml").read_text(encoding="utf-8")
    robot = (PROBLEMS / "robots/vitreoretinal.yaml").as_posix()
    text = text.replace("robots/vitreoretinal.yaml", robot)

    def loaded(limits: str) -> Problem:
        file = tmp_path / "problem.yaml"
        file.write_text(text.replace("limits:\n", f"limits:\n  {limits}\n"), encoding="utf-8")
        return load_problem(file)

    assert loaded("payload: [0 g, 30 g]").payload == pytest.approx((0.0, 0.03))
    for limits, reason in (
        (
            "friction: 95 %",
            r"friction.*the friction of Ondrives P30-120, joint 1 .*has no uncertainty",
        ),
        ("friction: 95 mm", r"friction.*instead of a share"),
        ("friction: 120 %", r"friction.*not a valid confidence level"),
        ("payload: [30 g, 0 g]", r"payload"),
        ("payload: [-1 g, 30 g]", r"payload.*(negative|not a mass)"),
        ("payload: [0 mm, 30 mm]", r"payload"),
    ):
        with pytest.raises(ProblemError, match=rf"problem\.yaml:\d+: .*{reason}"):
            loaded(limits)
