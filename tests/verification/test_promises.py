"""The certificate contains the promises about the path of the tip.

Healthy plans keep them, and other motions do not.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ssm_planner.cli import main
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.pipeline.run import plan
from ssm_planner.plans import Plan, load_plan
from ssm_planner.problem.limits import PATH_REQUIREMENTS
from ssm_planner.problem.motion import (
    Dwell,
    Follow,
    Free,
    Joints,
    Motion,
    Scan,
    Straight,
    Task,
    Tip,
)
from ssm_planner.problem.problem import Problem, TaskLimits
from ssm_planner.trajectory import Span, Trajectory, quintic_coefficients
from ssm_planner.verification.check import check
from ssm_planner.verification.promises import check_path_promises

START = Task(0.0, np.radians(-95), 0.0, 0.005)
END = Tip((0.004, -0.004, -0.012), 0.2)
OVER = Task(roll=np.radians(6), tilt=np.radians(-119))


@pytest.fixture(scope="module")
def planned(tilt_insert: Problem, laser_scan: Problem) -> Callable[..., Plan]:
    """Return a function that plans motions with the structured solver, each motion only once."""
    known: dict[str, Plan] = {}

    def of(*motion: Motion, eye: bool = False) -> Plan:
        key = repr((motion, eye))
        if key not in known:
            base = laser_scan if eye else replace(tilt_insert, start=START)
            known[key] = plan(replace(base, motion=motion, objective="time", planner="fast"))
            assert known[key].passed, known[key].reason
        return known[key]

    return of


def cornered(blend: float) -> tuple[Motion, ...]:
    return Straight(tilt=-2.0, blend=blend), Straight(depth=0.009)


def line(**changes: Any) -> Follow:
    return Follow(END, **{"curve": "line", "name": "line", **changes})


def over_retina(distance: float) -> Follow:
    return Follow(OVER, curve="retina", name="retina", distance=distance)


def exceeded(motion: Trajectory, robot: Any, limits: TaskLimits) -> set[str]:
    """Return the names of the violated limits."""
    return {line.name for line in check(motion, robot, limits).violations}


@pytest.mark.slow
def test_healthy_plans_hold_their_promises(planned: Callable[..., Plan]) -> None:
    for output, names in (
        (planned(*cornered(3e-4)), ["path departure", "corner rounding"]),
        (planned(line(constant_speed=4e-3)), ["path departure", "constant speed"]),
        (
            planned(Free(Task(tilt=-1.9)), Straight(roll=0.1, depth=0.012), Dwell(0.1)),
            ["path departure"],
        ),
        (planned(over_retina(1.5e-3), eye=True), ["path departure", "retina distance"]),
        (planned(Free(Task(tilt=-1.9))), []),
    ):
        certificate = check(output.motion, output.robot, output.limits, seal=True)
        assert certificate.passed
        assert certificate.limits == output.certificate.limits  # type: ignore[union-attr]
        assert [line.name for line in certificate.limits if line.name in PATH_REQUIREMENTS] == names
        again = Plan.from_json(output.to_json().encode(), Path("plan.json"))
        assert (again.certificate, again.uncertified_reason) == (output.certificate, None)


def test_a_motion_that_departs_further_is_refused(planned: Callable[..., Plan]) -> None:
    """Each of these trajectories keeps every other limit, and is the plan of another problem."""
    aside = Task(roll=0.3, depth=0.012)
    cases: list[tuple[Plan, Plan, str]] = [
        (planned(*cornered(3e-4)), planned(*cornered(6e-4)), "corner rounding"),
        (planned(line()), planned(Free(END, name="line")), "path departure"),
        (planned(Straight(roll=0.3, depth=0.012)), planned(Free(aside, name="straight")), "path departure"),
        (planned(Straight(depth=0.012)), planned(Straight(depth=0.0119)), "path departure"),
        (planned(over_retina(1.5e-3), eye=True), planned(over_retina(1.6e-3), eye=True), "retina distance"),
        (planned(line(constant_speed=4e-3)), planned(line()), "constant speed"),
        (planned(line(constant_speed=4e-3)), planned(line(constant_speed=3.99e-3)), "constant speed"),
    ]  # fmt: skip
    for promise, other, name in cases:
        assert (
            name in exceeded(other.motion, promise.robot, promise.limits) <= set(PATH_REQUIREMENTS)
        )


def test_phases_that_are_moved_or_renamed_are_refused(planned: Callable[..., Plan]) -> None:
    result = planned(Straight(tilt=-2.0), line())
    (a, b), complete = result.motion.phases, result.motion
    for phases in (
        (replace(a, name="free"), b),
        (Span("tilt", 0.0, b.end), Span("line", b.end, b.end)),
        (Span("tilt", 0.0, a.end / 2), Span("line", a.end / 2, b.end)),
        (Span("all", 0.0, b.end),),
    ):
        other = Trajectory(complete.breaks, complete.coefficients, phases)
        assert exceeded(other, result.robot, result.limits) == {"path departure"}


def test_a_constant_speed_is_one_without_gaps_and_never_exceeded(
    planned: Callable[..., Plan],
) -> None:
    result = planned(line(constant_speed=4e-3))
    t = result.motion.breaks
    # The motion has the same path, but is 10 % faster or slower in its middle.
    for faster in (0.1, -0.1):
        times = np.linspace(0.0, t[-1], 2001)
        warped = times - faster * 0.1 * np.exp(-(((times - t[-1] / 2) / 0.1) ** 2)) * np.sin(
            (times - t[-1] / 2) / 0.1
        )
        samples = result.motion.sample(np.clip(warped, 0.0, t[-1]))
        rate = np.gradient(warped, times)[:, None]
        state = samples.q, samples.qd * rate, samples.qdd * rate**2
        pieces = quintic_coefficients(
            np.diff(times), tuple(x[:-1] for x in state), tuple(x[1:] for x in state)
        )  # type: ignore[arg-type]
        other = Trajectory(times, pieces, (Span("line", 0.0, float(times[-1])),))
        assert "constant speed" in exceeded(other, result.robot, result.limits)


def test_a_slower_playback_keeps_the_way_at_a_lower_constant_speed(
    planned: Callable[..., Plan],
) -> None:
    result = planned(line(constant_speed=4e-3))
    slow = result.motion.slower(0.5)
    assert exceeded(slow, result.robot, result.limits) == {"constant speed"}
    assert not exceeded(slow, result.robot, result.limits.slower(2.0))


def test_check_refuses_changed_plans_and_passes_others(
    planned: Callable[..., Plan], tmp_path: Path, capsys: Any
) -> None:
    output, file = planned(*cornered(3e-4)), tmp_path / "plan.json"
    file.write_text(output.to_json(), encoding="utf-8")
    assert main(["check", str(file)]) == 0
    assert "corner rounding" in capsys.readouterr().out
    document = json.loads(output.to_json())
    for change in ("blend", "target", "trajectory"):
        changed = json.loads(output.to_json())
        entries = changed["problem"]["motion"]
        if change == "blend":
            entries[0]["blend"] = 1e-4
        elif change == "target":
            entries[1]["target"]["task"]["depth"] = 0.0091
        else:
            changed["trajectory"] = planned(*cornered(6e-4)).motion.to_dict()
        file.write_text(json.dumps(changed), encoding="utf-8")
        assert load_plan(file).uncertified_reason is not None
        assert main(["check", str(file), "--json"]) == 1
        result = json.loads(capsys.readouterr().out)["limits"]
        assert min(result, key=lambda each: each["margin"])["name"] in PATH_REQUIREMENTS
    document["trajectory"]["phases"] = []
    file.write_text(json.dumps(document), encoding="utf-8")
    assert main(["check", str(file)]) == 2


def test_a_table_says_nothing_of_phases(planned: Callable[..., Plan]) -> None:
    """A table has no phases, so the promises about its path are not checked."""
    output = planned(line())
    bare = Trajectory(output.motion.breaks, output.motion.coefficients, ())
    result = check(bare, output.robot, output.limits)
    assert not {item.name for item in result.limits} & set(PATH_REQUIREMENTS)
    assert any("path of line" in text for text in result.unchecked)


def test_the_departure_is_measured_by_the_tip_alone(tilt_insert: Problem) -> None:
    """A straight motion is compared with promised lines that turn by 60° at 2 mm before its end."""
    mechanism = Mechanism.from_geometry(tilt_insert.robot.geometry)
    q = np.array([[0.0, 0.6, 0.0, -0.010], [0.0, 0.6, 0.0, -0.014]])
    breaks, rest = np.array([0.0, 1.0]), np.zeros((1, 4))
    span = (Span("path", 0.0, 1.0),)
    motion = Trajectory(
        breaks,
        quintic_coefficients(np.diff(breaks), (q[:1], rest, rest), (q[1:], rest, rest)),
        span,
    )
    first, last = tip_position(mechanism, q)
    middle, along = (first + last) / 2, (last - first) / 0.004

    def kept(end: Any) -> Any:
        corner, to = (Tip(tuple(place.tolist()), 0.0) for place in (middle, end))
        lines = Follow(corner, curve="line", blend=1e-4), Follow(to, curve="line")
        return check_path_promises(motion, mechanism, TaskLimits(motion=lines))[0]

    on = kept(last)
    assert (on.departure, on.corner_reach) == (pytest.approx(0.0, abs=1e-12), 0.0)
    across = np.cross(along, np.array([0.0, 1.0, 0.0]))
    off = kept(middle + 0.004 * (0.5 * along + np.sqrt(0.75) * across / np.linalg.norm(across)))
    assert (off.departure, off.corner_reach) == pytest.approx(
        (0.002 * np.sqrt(0.75), 0.002), rel=1e-6
    )
    assert not any(line.passed for line in off.checks)


def test_arcs_and_lines_after_tables_and_scans(
    planned: Callable[..., Plan], laser_scan: Problem
) -> None:
    """The check finds the phases of arcs and lines after other phases.

    An arc passes its intermediate point.
    """
    arc = Follow(
        Task(tilt=-1.9, depth=0.009),
        (Task(roll=0.1, tilt=-1.8, depth=0.008),),
        curve="arc",
        name="arc",
    )
    points = tuple(Task(tilt=-1.66 - 0.01 * k) for k in range(3)) + tuple(
        Task(tilt=-1.68, depth=0.006 + 0.001 * k) for k in range(3)
    )
    result = planned(
        Follow(points[-1], points[:-1], curve="samples", name="table"), arc, Straight(roll=0.0)
    )
    results = check_path_promises(
        result.motion, Mechanism.from_geometry(result.robot.geometry), result.limits
    )
    assert [item.promise.span.name for item in results] == ["arc", "roll"]
    assert max(item.departure for item in results) < 1e-8
    scan = next(entry for entry in laser_scan.motion if isinstance(entry, Scan))
    small = replace(scan, rows=2, columns=2, diameters=())
    scanned = planned(small, Straight(tilt=-2.05), eye=True)
    assert scanned.passed


def test_roll_beyond_half_a_turn(planned: Callable[..., Plan], tilt_insert: Problem) -> None:
    """A straight motion may roll by more than half a turn."""
    q = Joints((0.0, 0.6, 0.0, -0.010))
    robot = replace(tilt_insert.robot, limits=(), joints=tuple(
        replace(joint, position=(-7.0, 7.0)) if k in (0, 2) else joint for k, joint in enumerate(tilt_insert.robot.joints)
    ))  # fmt: skip
    limits = tuple(limit for limit in tilt_insert.limits if "roll" not in limit.name)
    problem = replace(
        tilt_insert,
        robot=robot,
        limits=limits,
        start=q,
        motion=(Straight(roll=3.5),),
        planner="fast",
    )
    result = plan(problem)
    assert result.passed, result.reason
