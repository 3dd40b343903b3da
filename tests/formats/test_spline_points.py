"""The points for a controller lie on a slowed plan at whole ticks, and a note states the slowdown.
The reference is the sampled plan.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from ssm_planner.errors import ExportError
from ssm_planner.formats import spline_points as module
from ssm_planner.formats.spline_points import sample_slowed_plan, spline_points
from ssm_planner.plans import Plan
from ssm_planner.trajectory import Trajectory


@pytest.mark.parametrize("stretch", [1.0, 1.25])
def test_samples_at_times_are_those_of_the_slower_motion_and_then_rest(
    plan: Plan, stretch: float
) -> None:
    start = 2.5
    motion = Trajectory(plan.motion.breaks + start, plan.motion.coefficients, ())
    moved, slow = replace(plan, trajectory=motion), motion.slower(1 / stretch)
    end = start + slow.duration
    t = np.linspace(start, end, 500)[:-1]
    result, expected = (
        sample_slowed_plan(moved, t, stretch),
        slow.sample(slow.breaks[0] + t - start),
    )
    for name in ("q", "qd", "qdd", "qddd"):
        assert getattr(result, name) == pytest.approx(getattr(expected, name), rel=1e-9, abs=1e-9)
    assert np.array_equal(result.t, t)
    after = np.array([end + 1e-3, end + 1.0])
    rest = sample_slowed_plan(moved, after, stretch)
    assert rest.q == pytest.approx(np.tile(motion.sample(motion.breaks[-1:]).q, (2, 1)))
    assert not any(getattr(rest, name).any() for name in ("qd", "qdd", "qddd"))
    # Instants that exceed the end by rounding have the values of the end.
    last = sample_slowed_plan(moved, np.array([end + 0.5e-9]), stretch)
    assert last.qdd == pytest.approx(slow.sample(slow.breaks[-1:], "left").qdd)


def test_points_lie_on_the_plan_at_whole_ticks(plan: Plan, smooth_plan: Plan) -> None:
    for of, by_quintics in ((plan, False), (smooth_plan, True)):
        points = spline_points(of, of.certificate, tick=1e-6)
        t, breaks = points.samples.t, of.motion.breaks
        assert points.has_accelerations is by_quintics
        assert points.certificate.passed
        assert np.abs(t / 1e-6 - np.round(t / 1e-6)).max() < 1e-6
        assert 1 <= points.stretch <= 1 + module.LARGEST_SLOWDOWN
        assert all(np.abs(t - time * points.stretch).min() <= 1e-6 for time in breaks)
        assert (t[0], t[-1]) == pytest.approx((0.0, of.motion.duration * points.stretch), abs=1e-6)
        exact = of.motion.sample(np.minimum(t / points.stretch, breaks[-1]))
        assert points.samples.q == pytest.approx(exact.q, abs=1e-8)
        assert not points.samples.qd[-1].any()
        assert points.note.startswith(f"{len(t)} points; {points.certificate.interpolation}")
        slower = replace(points, stretch=1 + 25e-6).note
        assert slower.endswith(
            "; slower than the plan by 25 ppm so that the spline keeps the limits"
        )
        assert "slower" not in replace(points, stretch=1.0).note
    unrounded = spline_points(plan, plan.certificate, tick=None).samples.t
    assert set(plan.motion.breaks) <= set(unrounded)


def test_an_uncertified_plan_gives_its_first_points(plan: Plan, bad_plan: Plan) -> None:
    points = spline_points(bad_plan, bad_plan.certificate)
    assert points.stretch == 1.0
    assert len(points.samples.t) == len(bad_plan.motion.breaks)
    assert not points.certificate.passed
    with pytest.raises(ExportError, match="no points that keep it were found"):
        spline_points(bad_plan, plan.certificate)


@pytest.mark.parametrize(("order", "name"), [(1, "velocity"), (2, "acceleration"), (3, "jerk")])
def test_a_slower_motion_makes_up_for_an_excess_of_its_order(
    plan: Plan, order: int, name: str
) -> None:
    joints = tuple(replace(joint, jerk=1e3) for joint in plan.robot.joints)
    jerky = replace(plan, problem=replace(plan.problem, robot=replace(plan.robot, joints=joints)))
    result = plan.certificate.limits[0]
    for excess in (1e-4, 1e-3):
        factor = module._stretch_factor(
            jerky, replace(result, name=name, joint="tilt", margin=-excess)
        )
        # Quantities of this order decrease by 1 to 1.5 times the excess.
        assert 1 + excess < factor**order < 1 + 1.5 * excess
    for without in (("position", "tilt"), ("continuous torque", "tilt"), ("velocity", "nobody")):
        other = replace(result, name=without[0], joint=without[1], margin=-1e-4)
        assert module._stretch_factor(jerky, other) == np.inf


def test_a_tiny_excess_is_made_up_for_too(plan: Plan) -> None:
    """The factor exceeds the smallest sufficient factor by a margin for rounding."""
    result = plan.certificate.limits[0]
    for excess in (1e-9, 1e-8):
        tiny = replace(result, name="velocity", joint="tilt", margin=-excess)
        assert 1 + 10 * excess < module._stretch_factor(plan, tiny) < 1 + 1e-6


def test_the_message_names_the_worst_limit_of_the_spline(plan: Plan, bad_plan: Plan) -> None:
    with pytest.raises(ExportError) as caught:
        spline_points(bad_plan, plan.certificate)
    stated = re.search(
        r"through (\d+) points exceeds the (.+) limit of (\S+) by (\S+) % at (\S+) s",
        str(caught.value),
    )
    assert stated is not None
    worst = bad_plan.certificate.worst
    assert int(stated.group(1)) in {
        count * (len(bad_plan.motion.breaks) - 1) + 1 for count in module.DIVISIONS
    }
    assert stated.group(2, 3) in {(v.name, v.joint) for v in bad_plan.certificate.violations}
    assert 0 < float(stated.group(4)) <= -100.5 * worst.margin
    assert 0 <= float(stated.group(5)) <= bad_plan.motion.duration * (1 + module.LARGEST_SLOWDOWN)


@pytest.mark.parametrize("divisions", [1, 2, 4])
def test_pieces_are_divided_into_equal_parts(plan: Plan, divisions: int) -> None:
    later = Trajectory(plan.motion.breaks + 3.0, plan.motion.coefficients, ())
    for source in (plan, replace(plan, trajectory=later)):
        points = module._try_points(source, divisions, True, 1.25, None)
        t = points.samples.t / 1.25
        breaks = plan.motion.breaks
        assert len(t) == divisions * (len(breaks) - 1) + 1
        assert t[::divisions] == pytest.approx(breaks, abs=1e-12)
        steps = np.diff(t).reshape(-1, divisions)
        assert steps == pytest.approx(np.tile(steps[:, :1], divisions))
        assert points.samples.q == pytest.approx(plan.motion.sample(t).q, abs=1e-9)
        assert (points.stretch, points.has_accelerations) == (1.25, True)


@pytest.mark.parametrize("which", ["begins", "ends"])
def test_a_motion_that_ends_at_speed_keeps_it_to_the_end_and_stops_there(
    plan: Plan, which: str
) -> None:
    complete = plan.motion
    k = len(complete.breaks) // 3
    rows = slice(k, None) if which == "begins" else slice(None, k)
    breaks = complete.breaks[k:] if which == "begins" else complete.breaks[: k + 1]
    cut = replace(plan, trajectory=Trajectory(breaks, complete.coefficients[rows], ()))
    points = module._try_points(cut, 1, False, 1.0, None)
    assert len(points.samples.t) == len(breaks)
    ends = cut.motion.sample(breaks[[0, -1]]).qd
    assert points.samples.qd[0] == pytest.approx(ends[0], abs=1e-12)
    assert points.samples.qd[-1] == pytest.approx(ends[1], abs=1e-9)
    assert points.samples.qd[0].any() == (which == "begins")
    assert points.samples.qd[-1].any() == (which == "ends")
    later = sample_slowed_plan(cut, breaks[-1] + np.array([1e-3, 1.0]))
    assert later.q == pytest.approx(np.tile(cut.motion.sample(breaks[-1:]).q, (2, 1)))
    assert not any(getattr(later, name).any() for name in ("qd", "qdd", "qddd"))


def test_smooth_plans_need_no_more_points_than_breaks(smooth_plan: Plan) -> None:
    points = spline_points(smooth_plan, smooth_plan.certificate)
    assert len(points.samples.t) == len(smooth_plan.motion.breaks)


def test_quintics_through_the_breaks_are_slowed_down_as_they_are(smooth_plan: Plan) -> None:
    """A velocity limit slightly below the largest velocity requires a slower motion.

    A jerk limit excludes cubics.
    """
    worst = max(limit.worst for limit in smooth_plan.certificate.limits if limit.name == "velocity")
    (joint,) = (
        limit.joint
        for limit in smooth_plan.certificate.limits
        if limit.name == "velocity" and limit.worst == worst
    )
    joints = tuple(
        replace(
            item, jerk=1e4, velocity=worst * (1 - 2e-4) if item.name == joint else item.velocity
        )
        for item in smooth_plan.robot.joints
    )
    robot = replace(smooth_plan.robot, joints=joints)
    tight = replace(smooth_plan, problem=replace(smooth_plan.problem, robot=robot))
    points = spline_points(tight, smooth_plan.certificate)
    assert points.certificate.passed
    assert points.has_accelerations
    assert len(points.samples.t) == len(smooth_plan.motion.breaks)
    assert 1 + 2e-4 < points.stretch < 1 + 3e-4
