"""Verify that the tip follows the curves of a problem within 2 µm.

Equivalent tables of task, joint and tip samples must give the same path. References are geometric
distances and closed-form times.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.planner import PlannerResult, plan_motion
from ssm_planner.plans import Plan
from ssm_planner.problem.limits import TipSpeed
from ssm_planner.problem.motion import Follow, Joints, Straight, Task, Tip
from ssm_planner.problem.problem import Problem
from ssm_planner.typing import Array

START = Task(0.0, np.radians(-95), 0.0, 0.005)


@pytest.fixture
def base(tilt_insert: Problem) -> Problem:
    return replace(tilt_insert, start=START)


def planned(problem: Problem) -> tuple[PlannerResult, Array]:
    """Return the planner's result and 2000 tip positions along its motion, (2000, 3) in m."""
    result = plan_motion(problem)
    assert result.trajectory is not None, result.reason
    q = result.trajectory.sample(np.linspace(0.0, result.trajectory.duration, 2000)).q
    return result, tip_position(Mechanism.from_geometry(problem.robot.geometry), q)


def test_the_tip_keeps_to_a_line_below_its_speed_and_the_plan_passes(base: Problem) -> None:
    line = Follow(Tip((0.002, -0.006, -0.012), 0.2), curve="line", name="line")
    problem = replace(base, motion=(line,), limits=(*base.limits, TipSpeed(0.008)))
    result, tips = planned(problem)
    way = tips[-1] - tips[0]
    assert tips[-1] == pytest.approx((0.002, -0.006, -0.012), abs=1e-9)
    off = np.linalg.norm(np.cross(tips - tips[0], way / np.linalg.norm(way)), axis=1)
    assert off.max() < 2e-6
    # Only the tip's speed and the ramps limit the motion, so it takes little longer than the line
    # at full speed.
    assert (
        np.linalg.norm(way) / 0.008
        < result.trajectory.duration
        < 1.1 * np.linalg.norm(way) / 0.008 + 0.3
    )  # type: ignore[union-attr]
    outcome = plan(problem)
    assert outcome.passed, outcome.reason


def test_the_tip_keeps_to_an_arc(base: Problem) -> None:
    start = replace(START, depth=0.012)
    first = 0.012 * np.array([-np.cos(np.radians(95)), 0.0, -np.sin(np.radians(95))])
    centre, radius, angle = (
        first + np.array([0.003, 0.0, 0.0]),
        0.003,
        np.array([0.75 * np.pi, 1.5 * np.pi]),
    )
    points = centre - radius * np.column_stack([np.cos(angle), 0 * angle, np.sin(angle)])
    middle, end = (Tip((x, y, z), 0.0) for x, y, z in points.tolist())
    result, tips = planned(
        replace(base, start=start, motion=(Follow(end, (middle,), curve="arc"),))
    )
    assert tips[0] == pytest.approx(first, abs=1e-9)
    assert np.abs(np.linalg.norm(tips - centre, axis=1) - radius).max() < 2e-6
    assert np.abs(tips[:, 1]).max() < 2e-6
    turned = np.unwrap(np.arctan2(centre[2] - tips[:, 2], centre[0] - tips[:, 0]))
    assert turned[-1] - turned[0] == pytest.approx(1.5 * np.pi, abs=1e-6)
    assert result.phases[0].phase.motion.name == "path"


def test_a_line_of_depth_is_the_insertion(base: Problem) -> None:
    """A line or a table that changes only the depth takes the time of the straight insertion."""
    straight, _ = planned(replace(base, motion=(Straight(depth=0.015),), planner="toppra"))
    line, _ = planned(replace(base, motion=(Follow(Task(depth=0.015), curve="line"),)))
    samples = tuple(Task(depth=depth) for depth in np.linspace(0.005, 0.015, 30).tolist())
    table, _ = planned(replace(base, motion=(Follow(samples[-1], samples[:-1], curve="samples"),)))
    durations = [result.trajectory.duration for result in (line, table)]  # type: ignore[union-attr]
    assert durations == pytest.approx([straight.trajectory.duration] * 2, rel=1e-4)  # type: ignore[union-attr]


def test_the_three_forms_of_a_table_are_one_path(base: Problem) -> None:
    """Tables of task coordinates, joints and tip positions give the same path and duration."""
    task = np.column_stack(
        [s := np.linspace(0, 0.3, 40), np.radians(-95) - 0.4 * s, s**2, 0.005 + 0.02 * s]
    )
    mechanism = Mechanism.from_geometry(base.robot.geometry)
    forms = [[Task(*row) for row in task.tolist()]]
    result, _ = planned(
        replace(base, motion=(Follow(forms[0][-1], tuple(forms[0][:-1]), curve="samples"),))
    )
    (phase,) = result.phases
    joints = phase.phase.path.points  # type: ignore[union-attr]
    assert task_from_joints(mechanism, joints) == pytest.approx(task, abs=1e-9)
    durations = [result.trajectory.duration]  # type: ignore[union-attr]
    tips = tip_position(mechanism, joints)
    for points in (
        [Joints((a, b, c, d)) for a, b, c, d in joints.tolist()],
        [
            Tip((x, y, z), spin)
            for (x, y, z), spin in zip(tips.tolist(), task[:, 2].tolist(), strict=True)
        ],
    ):
        again, _ = planned(
            replace(base, motion=(Follow(points[-1], tuple(points[:-1]), curve="samples"),))
        )
        assert len(again.phases) == 1
        durations.append(again.trajectory.duration)  # type: ignore[union-attr]
    assert durations == pytest.approx(durations[:1] * 3, rel=1e-6)


def test_samples_begin_elsewhere_and_turn(base: Problem) -> None:
    """A table that begins elsewhere gets an approach, and the robot stops at its corner."""
    places = ((-100, 5e-3), (-101, 5e-3), (-102, 5e-3), (-102, 6e-3), (-102, 7e-3))
    points = [Task(tilt=np.radians(tilt), depth=depth) for tilt, depth in places]
    result, _ = planned(
        replace(base, motion=(Follow(points[-1], tuple(points[:-1]), curve="samples"),))
    )
    assert [item.phase.motion.name for item in result.phases] == [
        "path, approach",
        "path 1",
        "path 2",
    ]
    assert result.phases[-1].phase.end == pytest.approx([0, np.radians(-102), 0, 0.007])
    speeds = result.trajectory.sample(np.cumsum([item.duration for item in result.phases])).qd  # type: ignore[union-attr]
    assert np.abs(speeds).max() < 1e-9


@pytest.mark.parametrize("curve", ["line", "arc"])
def test_a_constant_speed_is_kept_between_the_ramps(base: Problem, curve: Any) -> None:
    through = (Tip((0.002, -0.001, -0.009), 0.0),) if curve == "arc" else ()
    motion = Follow(
        Tip((0.004, -0.004, -0.012), 0.2), through, curve=curve, name=curve, constant_speed=4e-3
    )
    outcome = plan(replace(base, motion=(motion,)))
    assert outcome.passed, outcome.reason
    (phase,) = outcome.phases
    assert phase.constant_speed == 4e-3
    # The reference differs from the check's method: it takes finite differences of tip positions.
    start, end = phase.constant_from, phase.constant_to
    t, h = np.linspace(start + 1e-3, end - 1e-3, 500), 1e-5  # type: ignore[operator]
    mechanism = Mechanism.from_geometry(base.robot.geometry)
    before, behind = (
        tip_position(mechanism, outcome.motion.sample(t + side).q) for side in (-h, h)
    )
    assert np.linalg.norm(behind - before, axis=1) / (2 * h) == pytest.approx(4e-3, rel=1e-6)
    assert phase.constant_error < 1e-6  # type: ignore[operator]
    # The ramps are short, and a joint reaches its acceleration limit on the first one.
    assert 0 < start < 0.2 < phase.duration - 0.2 < end < phase.duration  # type: ignore[operator]
    ramp = np.abs(outcome.motion.sample(np.linspace(0.0, 0.8 * start, 50)).qdd)  # type: ignore[operator]
    assert (ramp / [joint.acceleration for joint in base.robot.joints]).max() == pytest.approx(
        1.0, abs=1e-3
    )
    again = Plan.from_json(outcome.to_json().encode(), Path("plan.json"))
    assert (again.phases, again.problem.motion[0].constant_speed) == (outcome.phases, 4e-3)  # type: ignore[union-attr]


def test_a_constant_speed_that_cannot_be_is_told_with_the_one_that_can(base: Problem) -> None:
    """The reason states the largest possible constant speed, within 1 %."""
    motion = Follow(
        Tip((0.004, -0.004, -0.012), 0.2), curve="line", name="line", constant_speed=0.2
    )
    result = plan_motion(replace(base, motion=(motion,)))
    assert result.reason is not None
    assert result.reason.available is not None
    assert (
        "the tip cannot keep 200 mm/s between speeding up and slowing down (line); it can keep up to"
        in result.reason.message
    )
    able = float(f"{1e3 * result.reason.available:.4g}") / 1e3
    assert (
        plan_motion(replace(base, motion=(replace(motion, constant_speed=0.999 * able),))).status
        == "solved"
    )
    assert (
        plan_motion(replace(base, motion=(replace(motion, constant_speed=1.01 * able),))).status
        == "infeasible"
    )
    slow = replace(
        base, motion=(replace(motion, constant_speed=0.01),), limits=(*base.limits, TipSpeed(0.008))
    )
    reason = plan_motion(slow).reason
    assert reason is not None
    assert reason.available == pytest.approx(0.008, rel=1e-3)


def test_a_constant_speed_goes_with_no_other_timing(base: Problem) -> None:
    line = Follow(Task(depth=0.015), curve="line", constant_speed=0.002)
    with pytest.raises(ProblemError, match="excludes a constant speed"):
        replace(line, duration=2.0)
    with pytest.raises(ProblemError, match="not allowed for curve"):
        replace(line, curve="spline")
    with pytest.raises(ProblemError, match="and does not support a duration"):
        replace(base, motion=(line,), duration=20.0)


BENT = tuple(
    Task(np.radians(3 * np.sin(k)), np.radians(-95 - 7 * k), 0.0, 0.005 + 0.0015 * k)
    for k in range(1, 5)
)


def test_a_spline_by_optimal_control_keeps_jerk_limits_and_durations(base: Problem) -> None:
    spline = Follow(BENT[-1], BENT[:-1], "spline")
    fastest = plan(replace(base, motion=(spline,), objective="time"))
    mechanism = Mechanism.from_geometry(base.robot.geometry)
    durations = []
    for jerk in (1e4, 20.0):
        joints = tuple(
            replace(joint, jerk=jerk * joint.acceleration) for joint in base.robot.joints
        )
        robot = replace(base.robot, joints=joints)
        result = plan(replace(base, robot=robot, motion=(spline,), objective="time"))
        assert result.passed, result.reason
        assert "jerk" in {limit.name for limit in result.certificate.limits}  # type: ignore[union-attr]
        durations.append(result.motion.duration)
        # The motion passes the points, within the spacing of the samples.
        tasks = task_from_joints(
            mechanism, result.motion.sample(np.linspace(0, durations[-1], 20_001)).q
        )
        for point in BENT:
            assert np.abs(tasks - list(point.set_coordinates.values())).max(axis=1).min() < 1e-4
    # For very large jerk limits, the duration approaches that of TOPP-RA.
    assert 1.0 <= durations[0] / fastest.motion.duration < 1.005
    assert durations[1] > 1.02 * durations[0]
    for timed in (
        replace(base, motion=(replace(spline, duration=2.0),)),
        replace(base, motion=(spline,), duration=2.0, objective="effort"),
    ):
        slow = plan(timed)
        assert slow.passed, slow.reason
        assert slow.duration == pytest.approx(2.0, rel=1e-6)


def test_what_toppra_alone_times_says_so_at_its_place(base: Problem) -> None:
    """Options that only optimal control supports are refused with the position of the motion."""
    joints = tuple(replace(joint, jerk=20 * joint.acceleration) for joint in base.robot.joints)
    jerky = replace(base, robot=replace(base.robot, joints=joints))
    points = tuple(Task(tilt=np.radians(-95 - k)) for k in range(1, 23))
    table = Follow(points[-1], points[:-1], "samples")
    long = Follow(points[-1], points[:-1], "spline")
    line = Follow(Task(depth=0.015), curve="line", constant_speed=0.002)
    for problem, motion, message in (
        (
            jerky,
            table,
            r"motion\[1\] = 22 points: .* a jerk limit of joint roll .* through 20 points at most",
        ),
        (jerky, long, r"motion\[1\] = 22 points: .* a jerk limit of joint roll"),
        (
            base,
            replace(long, duration=9.0),
            r"motion\[1\] = 22 points: .* does not support a duration",
        ),
        (jerky, line, r"motion\[1\]\.constant_speed: .* a jerk limit of joint roll"),
    ):
        with pytest.raises(ProblemError, match=message):
            replace(problem, motion=(Straight(tilt=np.radians(-95.5)), motion))


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        (Follow(Task(roll=np.pi), curve="line"), "along all of this line"),
        (Follow(Task(depth=0.015), (Task(depth=0.010),), curve="arc"), "lie on one line"),
        (Follow(Task(tilt=np.radians(-178)), (Task(depth=0.010),)), "cannot reach this tilt"),
        (Follow(Tip((0.01, 0.0, 0.0), 0.0), (Task(depth=0.010),)), "cannot bring the tip there"),
        (Follow(Task(spin=0.3), curve="line", constant_speed=1e-3), "the tip does not move"),
    ],
)  # fmt: skip
def test_what_no_joint_can_follow(base: Problem, motion: Follow, message: str) -> None:
    """A curve that the mechanism cannot follow is refused."""
    robot = replace(base.robot, limits=())
    with pytest.raises(ProblemError, match=message):
        plan_motion(replace(base, robot=robot, motion=(motion,), limits=()))


def test_a_curve_out_of_the_tilt_range_is_refused_before_it_is_timed(base: Problem) -> None:
    through = tuple(
        Task(roll=roll, tilt=np.radians(tilt))
        for tilt, roll in ((-90, 0.0), (-81.1, 0.0), (-81.1, 0.3))
    )
    # The spline overshoots between its points.
    beyond = Follow(Task(tilt=np.radians(-95)), through)
    result = plan_motion(replace(base, motion=(beyond,)))
    assert result.status == "infeasible"
    assert result.reason is not None
    assert "tilt would have to be" in result.reason.message


def test_along_the_retina_the_tip_keeps_its_distance(laser_scan: Problem) -> None:
    eye = laser_scan.eye
    assert eye is not None
    to = Task(roll=np.radians(6), tilt=np.radians(-119))
    motion = Follow(to, curve="retina", name="retina", distance=1.5e-3, constant_speed=2e-3)
    outcome = plan(replace(laser_scan, motion=(motion,)))
    assert outcome.passed, outcome.reason
    assert [phase.name for phase in outcome.phases] == ["retina, approach", "retina"]
    assert outcome.phases[1].task_end[:3] == pytest.approx((to.roll, to.tilt, 0.0), abs=1e-9)
    start = outcome.phases[0].duration
    t = np.linspace(start, start + outcome.phases[1].duration, 3000)
    tips = tip_position(
        Mechanism.from_geometry(laser_scan.robot.geometry), outcome.motion.sample(t).q
    )
    assert eye.radius - np.linalg.norm(tips - eye.centre, axis=1) == pytest.approx(1.5e-3, abs=1e-9)
    # The tip follows the shortest curve on the sphere.
    first, last = tips[[0, -1]] - eye.centre
    length = np.linalg.norm(np.diff(tips, axis=0), axis=1).sum()
    arc = (eye.radius - 1.5e-3) * np.arccos(
        first @ last / np.linalg.norm(first) / np.linalg.norm(last)
    )
    assert length == pytest.approx(arc, rel=1e-6)
    assert outcome.phases[1].constant_error < 1e-6  # type: ignore[operator]
    again = Plan.from_json(outcome.to_json().encode(), Path("plan.json"))
    assert again.problem.motion[0].distance == 1.5e-3  # type: ignore[union-attr]


def test_a_curve_along_the_retina_needs_one(base: Problem, laser_scan: Problem) -> None:
    motion = Follow(Task(tilt=-2.0), curve="retina", name="retina", distance=1.5e-3)
    with pytest.raises(ProblemError, match="needs an eye"):
        replace(base, motion=(motion,))
    with pytest.raises(ProblemError, match="smaller than the clearance from the retina"):
        replace(laser_scan, motion=(replace(motion, distance=0.5e-3),))
    with pytest.raises(ProblemError, match="farther from the retina than the centre of the eye"):
        replace(laser_scan, motion=(replace(motion, distance=30e-3),))
    with pytest.raises(ProblemError, match="distance already determines it"):
        replace(motion, to=Task(depth=0.01))
    with pytest.raises(ProblemError, match="required for curve retina"):
        Follow(Task(tilt=-2.0), distance=1e-3)
