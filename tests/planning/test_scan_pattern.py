"""Verify scans, which move the tip over laser spots at a constant distance from the retina.

The references are the geometry of spheres and planes, and the best of all orders of a few spots.
"""

from __future__ import annotations

import dataclasses
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ssm_planner.errors import ProblemError
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.pipeline.run import plan
from ssm_planner.planning.feasibility import feasible_phases
from ssm_planner.planning.phases import Phase
from ssm_planner.planning.scan_pattern import search_short_tour
from ssm_planner.plans import Plan
from ssm_planner.problem.motion import Scan, Task
from ssm_planner.problem.problem import Problem
from ssm_planner.typing import Array

MACULA = {"roll": 0.0, "tilt": float(np.radians(-115.3))}
DISTANCE = 2e-3
RING = Scan(Task(**MACULA), DISTANCE, (2e-3,), spacing=1e-3)
THREE = Scan(Task(**MACULA), DISTANCE, (1e-3, 2e-3, 3e-3), spacing=1.5e-3)
RASTER = Scan(Task(**MACULA), DISTANCE, rows=3, columns=4, spacing=0.8e-3)


def scanning(laser_scan: Problem, scan: Scan, **changes: Any) -> Plan:
    """Return the plan of a scan, which must pass."""
    motion = dataclasses.replace(scan, name="pattern")
    problem = dataclasses.replace(laser_scan, motion=(motion,), objective="time", **changes)
    result = plan(problem)
    assert result.passed
    return result


def phases(result: Plan) -> tuple[Phase, ...]:
    """Return the phases of a plan with the points that they pass."""
    return feasible_phases(result.problem)[0]


def spots(result: Plan) -> list[Array]:
    """Return the tip positions (n, 3) in m at the spots of every free phase, including its end.

    The start of a phase is not included.
    """
    mechanism = Mechanism.from_geometry(result.problem.robot.geometry)
    return [
        tip_position(mechanism, phase.points[1:])
        for phase in phases(result)
        if phase.motion.kind == "free"
    ]


def on_retina(result: Plan, tips: Array) -> Array:
    """Return the points (n, 3) at which rays from the port through the tips meet the retina."""
    eye = result.problem.eye
    assert eye is not None
    axis = tips / np.linalg.norm(tips, axis=1, keepdims=True)
    along = axis @ eye.centre
    return axis * (along + np.sqrt(along**2 - eye.centre @ eye.centre + eye.radius**2))[:, None]


def in_plane(result: Plan, tips: Array) -> Array:
    """Return the spots (n, 3) in the tangent plane at the macula, relative to the macula, in m.

    The projection uses rays from the centre of the eye.
    """
    eye, mechanism = result.problem.eye, Mechanism.from_geometry(result.problem.robot.geometry)
    assert eye is not None
    macula = on_retina(result, _axis(mechanism)[None])[0]
    normal = (macula - eye.centre) / eye.radius
    outward = on_retina(result, tips) - eye.centre
    return eye.centre + eye.radius * outward / (outward @ normal)[:, None] - macula


def _axis(mechanism: Mechanism) -> Array:
    """Return the direction of the tool at MACULA, (3,).

    It lies in the plane of tilt, from the axis of joint 1 (x) towards −z.
    """
    tilt = MACULA["tilt"]
    return np.cos(tilt) * np.array([-1.0, 0, 0]) + np.sin(tilt) * np.array([0, 0, 1.0])


@pytest.mark.parametrize("scan", [RING, THREE, RASTER])
def test_every_spot_is_at_the_distance_and_passed_by_the_tip(
    laser_scan: Problem, scan: Scan
) -> None:
    result = scanning(laser_scan, scan)
    eye, mechanism = laser_scan.eye, Mechanism.from_geometry(laser_scan.robot.geometry)
    assert eye is not None
    at_breaks = tip_position(mechanism, result.trajectory.sample(result.trajectory.breaks).q)
    tips = np.concatenate(spots(result))
    assert np.linalg.norm(tips - eye.centre, axis=1) == pytest.approx(
        eye.radius - DISTANCE, abs=1e-9
    )
    for tip in tips:
        assert np.linalg.norm(at_breaks - tip, axis=1).min() < 1e-9
    tasks = np.concatenate(
        [task_from_joints(mechanism, phase.points[1:]) for phase in phases(result)]
    )
    assert tasks[:, 2] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("scan", [RING, THREE])
def test_rings_have_their_diameters_and_even_spacing(laser_scan: Problem, scan: Scan) -> None:
    result = scanning(laser_scan, scan)
    runs = spots(result)
    # The runs alternate between a motion to the first spot of a ring and a motion around the ring.
    assert len(runs) == 2 * len(scan.diameters)
    for diameter, first, ring in zip(scan.diameters, runs[::2], runs[1::2], strict=True):
        plane = in_plane(result, np.concatenate([first, ring]))
        assert np.linalg.norm(plane, axis=1) == pytest.approx(diameter / 2, abs=1e-9)
        assert plane[0] == pytest.approx(plane[-1], abs=1e-9)
        steps = np.linalg.norm(np.diff(plane, axis=0), axis=1)
        count = len(steps)
        assert steps == pytest.approx(diameter * np.sin(np.pi / count), abs=1e-9)
        # The number of spots is the integer that gives the spacing nearest to the requested one.
        assert abs(np.pi * diameter / scan.spacing - count) <= 0.5 or count == 3


def test_a_raster_goes_back_and_forth(laser_scan: Problem) -> None:
    result = scanning(laser_scan, RASTER)
    plane = in_plane(result, np.concatenate(spots(result)))
    assert len(plane) == 12
    assert plane.mean(axis=0) == pytest.approx(0.0, abs=1e-9)
    steps = np.diff(plane, axis=0)
    assert np.linalg.norm(steps, axis=1) == pytest.approx(RASTER.spacing, abs=1e-9)
    rows = plane.reshape(3, 4, 3)
    along = np.diff(rows, axis=1)
    assert along[0] == pytest.approx(-along[1], abs=1e-9)
    # The rows lie across the plane of tilt, as roll moves the tool.
    assert np.abs(along @ np.array([1.0, 0, 1.0])).max() < 1e-9


def test_with_a_dwell_the_tool_stands_at_every_spot_without_it_passes(laser_scan: Problem) -> None:
    """With a dwell, the tool rests at every spot. Without a dwell, it passes the spots."""
    standing = scanning(laser_scan, dataclasses.replace(RING, dwell=0.05))
    kinds = [phase.motion.kind for phase in phases(standing)]
    dwells = [phase for phase, kind in zip(standing.phases, kinds, strict=True) if kind == "dwell"]
    assert len(dwells) == 6
    assert [phase.duration for phase in dwells] == pytest.approx([0.05] * 6)
    passing = scanning(laser_scan, RING)
    assert passing.duration < standing.duration - 6 * 0.05
    points = phases(passing)[1].points
    way = np.diff(points, axis=0)
    way = np.sign(np.where(np.abs(way) > 1e-9, way, 0.0))
    going_on = way[1:] * way[:-1] > 0
    assert going_on.any(axis=1).sum() >= 3
    at_breaks = passing.trajectory.sample(passing.trajectory.breaks)
    # The ring is closed, so the tip passes its first spot at the beginning and at the end.
    first = int(np.searchsorted(at_breaks.t, passing.phases[0].duration))
    passed = [
        first,
        *(
            first + int(np.abs(at_breaks.q[first:] - point).max(axis=1).argmin())
            for point in points[1:-1]
        ),
        -1,
    ]
    for k, on, before, behind in zip(passed[1:-1], going_on, passed[:-2], passed[2:], strict=True):
        assert np.all(at_breaks.qd[k][on] != 0)
        # A joint that reverses does so at the point or near it.
        speeds = passing.trajectory.sample(
            np.linspace(at_breaks.t[before], at_breaks.t[behind], 400)
        ).qd[:, ~on]
        assert np.all((speeds.min(axis=0) <= 0) & (speeds.max(axis=0) >= 0))


def test_a_scan_beyond_the_reach_of_the_port_is_bad_input(laser_scan: Problem) -> None:
    """If the tool points away from the eye, no spot has the given distance from the retina."""
    eye = laser_scan.eye
    assert eye is not None
    turned = dataclasses.replace(eye, centre=-eye.centre, lens=None)
    with pytest.raises(ProblemError, match="the tool in the port cannot reach a spot of this scan"):
        scanning(laser_scan, RING, eye=turned)


def test_a_tilt_out_of_reach_is_bad_input(laser_scan: Problem) -> None:
    motion = dataclasses.replace(RING, at=Task(tilt=float(np.radians(-141))), name="ring")
    robot = dataclasses.replace(laser_scan.robot, limits=())
    problem = dataclasses.replace(laser_scan, robot=robot, motion=(motion,), limits=())
    with pytest.raises(
        ProblemError, match=r"cannot reach this tilt .allowed: -139\.778 deg to -79\.778 deg"
    ):
        plan(problem)


def test_the_fastest_order_of_few_places_is_the_best_of_all_orders() -> None:
    """For up to seven spots, the tour has the least time of all orders."""
    rng = np.random.default_rng(20)
    for case in range(40):
        places = rng.random((int(rng.integers(3, 8)), 2))
        between = places[:, None] - places
        times = np.abs(between).max(axis=2) if case % 2 else np.linalg.norm(between, axis=2)

        def total(order: Any, times: Array = times) -> float:
            return float(times[[0, *order[:-1]], order].sum())

        result = search_short_tour(times) + 1
        assert sorted(result) == list(range(1, len(places)))
        assert total(result) == pytest.approx(min(map(total, permutations(range(1, len(places))))))


def test_the_fastest_order_visits_every_spot_once_and_takes_less(laser_scan: Problem) -> None:
    scan = dataclasses.replace(THREE, dwell=0.02)
    given_order, fastest = (
        scanning(laser_scan, dataclasses.replace(scan, order=order))
        for order in ("given", "fastest")
    )
    own, other = (np.concatenate(spots(result)) for result in (given_order, fastest))
    assert len(own) == len(other)
    assert np.lexsort(own.T).tolist() != np.lexsort(other.T).tolist()
    assert np.linalg.norm(own[:, None] - other, axis=2).min(axis=1) == pytest.approx(0.0, abs=1e-9)
    assert fastest.duration < 0.97 * given_order.duration  # type: ignore[operator]
    again = Plan.from_json(fastest.to_json().encode(), Path("plan.json"))
    assert again.problem.motion[0].order == "fastest"  # type: ignore[union-attr]
    # Without a dwell, one motion passes all spots and does not return to the first one.
    (approach, around) = phases(scanning(laser_scan, dataclasses.replace(THREE, order="fastest")))
    assert len(around.points) == len(own)
    assert np.abs(approach.points[-1] - around.points[-1]).max() > 1e-3
