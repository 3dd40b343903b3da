"""Verify that a Replanner returns the same bits as separate plans, in any order and thread."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import ssm_planner as ssm
from ssm_planner.planning.ocp.transcription import Transcription

TARGETS = [ssm.Task(depth=depth) for depth in (0.020, 0.017, 0.012)]


def content(plan: ssm.Plan) -> tuple[bytes, bytes]:
    """Return the bytes of the breaks and the coefficients of a plan."""
    assert plan.passed
    assert plan.trajectory is not None
    return plan.trajectory.breaks.tobytes(), plan.trajectory.coefficients.tobytes()


@pytest.fixture(scope="module")
def alone(tilt_insert: ssm.Problem) -> list[tuple[bytes, bytes]]:
    """Return the content of the plan to each target, made without cached programs."""
    result = []
    tilt, _ = tilt_insert.motion
    for target in TARGETS:
        Transcription.build.cache_clear()
        problem = replace(
            tilt_insert, motion=(tilt, ssm.Straight(depth=target.depth)), planner="fast"
        )
        result.append(content(ssm.plan(problem)))
    return result


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1)])
def test_the_same_bits_in_any_order(
    tilt_insert: ssm.Problem, alone: list[tuple[bytes, bytes]], order: tuple[int, ...]
) -> None:
    replanner = ssm.Replanner(tilt_insert)
    assert [content(replanner.plan(target=TARGETS[k])) for k in order] == [alone[k] for k in order]


def test_the_same_bits_from_threads(
    tilt_insert: ssm.Problem, alone: list[tuple[bytes, bytes]]
) -> None:
    replanner = ssm.Replanner(tilt_insert)
    with ThreadPoolExecutor(3) as threads:
        plans = list(threads.map(lambda target: replanner.plan(target=target), TARGETS * 2))
    assert [content(plan) for plan in plans] == alone * 2


def test_a_start_keeps_the_coordinates_that_it_does_not_name(tilt_insert: ssm.Problem) -> None:
    plan = ssm.Replanner(tilt_insert).plan(start=ssm.Task(tilt=np.radians(-90)))
    assert plan.passed
    assert plan.phases[0].task_start == pytest.approx((0.0, np.radians(-90), 0.0, 0.0))


def test_a_free_motion_goes_to_joints_too(tilt_insert: ssm.Problem) -> None:
    problem = replace(tilt_insert, motion=(ssm.Free(ssm.Task(depth=0.01)), ssm.Dwell(0.1)))
    first = ssm.Replanner(problem).plan()
    assert first.trajectory is not None
    end = first.trajectory.sample(first.trajectory.duration).q[0]
    plan = ssm.Replanner(problem).plan(target=ssm.Joints(tuple(end - [0.1, 0.0, 0.0, 0.0])))
    assert plan.trajectory is not None
    assert plan.trajectory.sample(plan.trajectory.duration).q[0] == pytest.approx(
        end - [0.1, 0.0, 0.0, 0.0], abs=1e-9
    )


def test_targets_that_cannot_be(tilt_insert: ssm.Problem) -> None:
    """A target that does not fit a motion of the problem is refused."""
    with pytest.raises(ssm.ProblemError, match="task coordinates"):
        ssm.Replanner(tilt_insert).plan(target=ssm.Joints((0.0, 0.0, 0.0, 0.0)))
    with pytest.raises(ssm.ProblemError, match="no motion of this problem has a target"):
        ssm.Replanner(replace(tilt_insert, motion=(ssm.Dwell(0.1),))).plan(
            target=ssm.Task(depth=0.01)
        )


def test_an_infeasible_replan_gives_its_reason_without_a_search(tilt_insert: ssm.Problem) -> None:
    """An infeasible problem gets a reason without a search for a relaxation."""
    plan = ssm.Replanner(replace(tilt_insert, duration=0.5, objective="effort")).plan()
    assert not plan.passed
    assert plan.reason is not None
    assert plan.reason.relaxation is None
