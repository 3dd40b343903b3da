"""The motion that drives execute between the rows of a PVT table keeps the limits. The reference is
the cubic of maxon's application note on the interpolated position mode (IPM).
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog

from ssm_planner.dynamics.motors import motion_directions, motor_motion
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.errors import ExportError, TrajectoryError
from ssm_planner.formats.epos4_setup import drive_axes
from ssm_planner.formats.export import export
from ssm_planner.formats.pvt import (
    EXCESS_COST,
    INT24_MAX,
    LARGEST_ROW_MS,
    SLOWDOWNS,
    _candidate_tables,
    _RowFit,
)
from ssm_planner.formats.read import read_trajectory
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_rates
from ssm_planner.plans import Plan
from ssm_planner.problem.limits import TASK_COORDINATES
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Samples, Trajectory
from ssm_planner.verification.check import check
from tests.support.plans import certified

COUNTS = 4096
ROUNDING = 1e-9


def rows(folder: Path, joint: str) -> np.ndarray:
    """Return the columns time (ms), position and velocity of a table, (n,) each."""
    return np.loadtxt(folder / f"{joint}.csv", delimiter=",", skiprows=1).T


def run(table: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return position, velocity, acceleration and jerk of a drive at times t.

    They follow from maxon's IPM application note, with t0 at the end of the interval:

        P(t) = a (t − t0)³ + b (t − t0)² + c (t − t0) + d
    """
    time, position, velocity = table
    ends = np.cumsum(time) / 1000
    n = np.clip(np.searchsorted(ends, t, side="right"), 1, len(ends) - 1)
    h, s = time[n] / 1000, t - ends[n]
    p1, p0, v1, v0 = position[n], position[n - 1], velocity[n], velocity[n - 1]
    b = (-3 * (p1 - p0) + h * (2 * v1 + v0)) / h**2
    a = (-2 * (p1 - p0) + h * (v1 + v0)) / h**3
    return (
        a * s**3 + b * s**2 + v1 * s + p1,
        3 * a * s**2 + 2 * b * s + v1,
        6 * a * s + 2 * b,
        6 * a,
    )


@pytest.mark.parametrize("which", ["plan", "smooth_plan"])
def test_the_interpolated_table_keeps_the_limits(
    which: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    plan: Plan = request.getfixturevalue(which)
    _, manifest = export(plan, "pvt", tmp_path, counts_per_turn=COUNTS)
    robot = plan.robot
    first = rows(tmp_path, "roll")[0]
    assert first[0] == 0
    assert np.all(
        (first[1:] >= 1) & (first[1:] <= LARGEST_ROW_MS) & (first[1:] == np.round(first[1:]))
    )
    end = first.sum() / 1000
    t = np.unique(
        np.concatenate(
            [
                np.linspace(0, end, 50_001)[:-1],
                np.cumsum(first)[:-1] / 1000,
                np.cumsum(first)[1:] / 1000 - 1e-12,
            ]
        )
    )
    motion = np.empty((4, len(t), 4))
    for i, joint in enumerate(robot.joints):
        table = rows(tmp_path, joint.name)
        assert np.array_equal(table[0], first)
        per_unit = manifest["axes"][joint.name].get("increments_per_unit")
        if per_unit is not None:
            assert np.array_equal(table, np.round(table))
            assert np.abs(table[2]).max() <= INT24_MAX
            assert abs(
                table[1, -1] / per_unit
                - plan.trajectory.sample(plan.trajectory.breaks[-1:]).q[0, i]
            ) <= 0.5 / abs(per_unit)
        assert np.abs(table[2, [0, -1]]).max() <= 1e-12
        for order, values in enumerate(run(table, t)):
            motion[order, :, i] = values / (per_unit or 1.0)
        assert np.abs(motion[1, :, i]).max() <= joint.velocity * (1 + ROUNDING)
        assert np.abs(motion[2, :, i]).max() <= joint.acceleration * (1 + ROUNDING)
        slowed = plan.trajectory.sample(plan.trajectory.breaks[0] + t / manifest["stretch"]).q[:, i]
        assert (
            np.abs(motion[0, :, i] - slowed).max() <= 1e-3 * np.ptp(slowed) + 1e-4 * joint.velocity
        )
    samples = Samples(t, *motion)
    direction, breakaway = motion_directions(robot, samples, 1)
    torque = motor_motion(robot, RigidBody.from_robot(robot), samples, direction, breakaway).torque
    for i, joint in enumerate(robot.joints):
        if joint.drive is not None:
            assert np.abs(torque[:-1, i]).max() <= joint.motor.max_torque
    assert 1 <= manifest["stretch"] <= 1.05


def test_round_trip_with_the_same_verdict(
    plan: Plan, bad_plan: Plan, robot: Robot, tmp_path: Path
) -> None:
    for source, force in ((plan, False), (bad_plan, True)):
        folder = tmp_path / str(force)
        _, manifest = export(source, "pvt", folder, force=force, counts_per_turn=COUNTS)
        reading = read_trajectory(folder, robot)
        assert reading.resolution is None
        result = check(
            reading.trajectory, robot, source.limits, interpolation=reading.interpolation
        )
        assert result.passed is source.certificate.passed is not force
        assert manifest["spline"]["certificate"]["passed"] is result.passed
        assert "cubic" in result.interpolation


def test_other_encoders_and_directions(plan: Plan, tmp_path: Path) -> None:
    joints = tuple(dataclasses.replace(joint, motor_direction=-1) for joint in plan.robot.joints)
    robot = dataclasses.replace(plan.robot, joints=joints)
    turned = certified(
        dataclasses.replace(plan, problem=dataclasses.replace(plan.problem, robot=robot))
    )
    for counts in (2048, 65536):
        _, manifest = export(turned, "pvt", tmp_path / str(counts), counts_per_turn=counts)
        assert manifest["axes"]["roll"]["increments_per_unit"] < 0
        result = check(
            read_trajectory(tmp_path / str(counts), robot).trajectory, robot, plan.limits
        )
        assert result.passed


def test_a_jerk_limit_is_refused(smooth_plan: Plan, tmp_path: Path) -> None:
    """Cubics between whole increments jump in acceleration, which the message states."""
    joints = tuple(dataclasses.replace(joint, jerk=1e4) for joint in smooth_plan.robot.joints)
    robot = dataclasses.replace(smooth_plan.robot, joints=joints, limits=smooth_plan.robot.limits)
    limited = certified(
        dataclasses.replace(
            smooth_plan, problem=dataclasses.replace(smooth_plan.problem, robot=robot)
        )
    )
    assert limited.passed
    with pytest.raises(ExportError, match=r"no PVT table was found .*acceleration jump"):
        export(limited, "pvt", tmp_path / "x", counts_per_turn=COUNTS)


def test_tables_that_were_changed(plan: Plan, robot: Robot, tmp_path: Path) -> None:
    files, manifest = export(plan, "pvt", tmp_path, counts_per_turn=COUNTS)
    lines = files["tilt.csv"].read_text(encoding="utf-8").splitlines()
    for row, column, value, message in (
        (3, 2, "{:.0f}", None),
        (3, 0, "254", "the tables of the axes have different times"),
        (3, 1, "nan", "not finite"),
        (0, 1, "place", "no column position_inc"),
    ):
        changed = [line.split(",") for line in lines]
        old = changed[row][column]
        changed[row][column] = value.format(1.05 * float(old)) if message is None else value
        files["tilt.csv"].write_text("\n".join(map(",".join, changed)) + "\n", encoding="utf-8")
        files["manifest"].write_text(json.dumps(manifest), encoding="utf-8")
        with pytest.raises(
            TrajectoryError, match=r"tilt\.csv: the file was modified after the export"
        ):
            read_trajectory(tmp_path, robot)
        digest = hashlib.sha256(files["tilt.csv"].read_bytes()).hexdigest()
        mended = {**manifest, "files": {**manifest["files"], "tilt.csv": digest}}
        files["manifest"].write_text(json.dumps(mended), encoding="utf-8")
        if message is None:
            assert not check(read_trajectory(tmp_path, robot).trajectory, robot, plan.limits).passed
            continue
        with pytest.raises(TrajectoryError, match=message):
            read_trajectory(tmp_path, robot)


@pytest.mark.parametrize(("row", "step"), [(3, "0"), (3, "256"), (3, "1.5"), (1, "7")])
def test_times_are_steps_that_a_row_can_hold(
    plan: Plan, robot: Robot, tmp_path: Path, row: int, step: str
) -> None:
    files, manifest = export(plan, "pvt", tmp_path, counts_per_turn=COUNTS)
    for joint in robot.joints:
        name = f"{joint.name}.csv"
        lines = files[name].read_text(encoding="utf-8").splitlines()
        lines[row] = f"{step},{lines[row].partition(',')[2]}"
        files[name].write_text("\n".join(lines) + "\n", encoding="utf-8")
        manifest["files"][name] = hashlib.sha256(files[name].read_bytes()).hexdigest()
    files["manifest"].write_text(json.dumps(manifest), encoding="utf-8")
    with pytest.raises(TrajectoryError, match="0 in the first row and an integer from 1 to 255"):
        read_trajectory(tmp_path, robot)


def test_rows_keep_to_whole_increments_within_the_range_of_the_joint(plan: Plan) -> None:
    """Rounding of the bound by up to a millionth of an increment does not cost an increment."""
    t = np.linspace(0.0, 0.999 * plan.motion.duration, 9)
    low, high = plan.robot.joints[3].position
    assert (low, high) == (-0.03, 0.0)
    for unit, expected in (
        (-10_000.0, (0, 300)),
        (10_000.0 * (1 + 1e-9), (-300, 0)),
        (10_000.0 * (1 - 1e-9), (-300, 0)),
        (10_000.0 * (1 - 1e-7), (-299, 0)),
        (10_015.0, (-300, 0)),
        (9_999.0, (-299, 0)),
    ):
        assert _RowFit(plan, 3, t, 1.0, unit).range == expected


STRETCH = 1.03


@pytest.fixture(scope="module", params=[(13, -2e5), (13, 400.0), (4, -90.0)])
def fit(request: pytest.FixtureRequest, smooth_plan: Plan) -> tuple[_RowFit, np.ndarray, float]:
    """Return the linear program of a stretched table of joint 2, its times (s), and the increments
    per rad.
    """
    count, unit = request.param
    t = STRETCH * smooth_plan.motion.duration * np.linspace(0.0, 1.0, count)
    t[1:3] += [0.01, -0.012]
    return _RowFit(smooth_plan, 1, t, STRETCH, unit), t, unit


def test_the_rows_of_a_table_s_program_are_those_of_its_cubics(
    fit: tuple[_RowFit, np.ndarray, float],
) -> None:
    """Each row equals a derivative or a Bernstein coefficient of the cubic for any positions p and
    velocities v.
    """
    result, t, _ = fit
    tau = t[-1] / (len(t) - 1)
    assert result.rate == pytest.approx(1 / tau)
    rng = np.random.default_rng(5)
    p, v = rng.normal(size=(2, len(t)))
    rows = np.array(
        [a * p[:-1] + b * p[1:] + c * v[:-1] + d * v[1:] for (a, b, c, d), *_ in result.constraints]
    )
    for k, h in enumerate(np.diff(t) / tau):
        x = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [1, h, h**2, h**3], [0, 1, 2 * h, 3 * h**2]])
        a, b, c, d = np.linalg.solve(x, [p[k], v[k], p[k + 1], v[k + 1]])
        velocity_middle = b + c * h  # The quadratic b + 2 c s + 3 d s² in Bernstein form.
        position_inner = a + b * h / 3, a + 2 * b * h / 3 + c * h**2 / 3
        expected = [2 * c, 2 * c + 6 * d * h, velocity_middle, *position_inner]
        assert rows[:, k] == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_the_bounds_of_a_table_s_program_are_the_plan_s_extremes_nearby(
    fit: tuple[_RowFit, np.ndarray, float], smooth_plan: Plan
) -> None:
    """The bounds are the extremes of the plan within an interval and its neighbours.

    They may omit the last twentieth of that range.
    """
    result, t, unit = fit
    tau, n = t[-1] / (len(t) - 1), len(t) - 1
    joint, motion = smooth_plan.robot.joints[1], smooth_plan.motion
    limit = joint.acceleration * abs(unit) * tau**2

    def values(x: np.ndarray) -> tuple[np.ndarray, ...]:
        s = motion.sample(motion.breaks[0] + np.minimum(x / STRETCH, motion.duration))
        return s.q[:, 1] * unit, s.qd[:, 1] * unit * tau, s.qdd[:, 1] * unit * tau**2

    position, velocity, _ = values(t)
    assert result.positions == pytest.approx(position)
    assert result.velocities == pytest.approx(velocity / STRETCH, abs=1e-6 * np.abs(velocity).max())
    tolerances = [tolerance for _, _, tolerance in result.constraints]
    assert tolerances == pytest.approx([limit, limit, 0.0, 0.0, 0.0])
    largest = max(limit, np.abs(values(np.linspace(0, t[-1], 20_001))[2]).max())

    def bounds(begin: float, end: float, cap: float) -> list[tuple[float, float]]:
        q, qd, qdd = values(np.linspace(begin, end, 2001))
        low = max(min(qdd.min(), qdd.min() / STRETCH**2) - 0.01 * limit, -cap)
        high = min(max(qdd.max(), qdd.max() / STRETCH**2) + 0.01 * limit, cap)
        return [(low, high)] * 2 + [(qd.min(), qd.max())] + [(q.min(), q.max())] * 2

    for k in range(n):
        cap = largest - 3 / ((t[k + 1] - t[k]) / tau) ** 2
        begin, end = t[max(k - 1, 0)], t[min(k + 2, n)]
        last = 0.0 if k + 2 > n - 1 else (end - begin) / 20
        complete, part = bounds(begin, end, cap), bounds(begin, end - last, cap)
        spans = [limit, limit, np.abs(velocity).max(), np.ptp(position), np.ptp(position)]
        for (_, (low, high), _), outer, inner, span in zip(
            result.constraints, complete, part, spans, strict=True
        ):
            assert outer[0] - 2e-3 * span <= low[k] <= inner[0] + 2e-3 * span
            assert inner[1] - 2e-3 * span <= high[k] <= outer[1] + 2e-3 * span


def test_a_solution_keeps_fixed_positions_and_the_rows(
    fit: tuple[_RowFit, np.ndarray, float],
) -> None:
    """Rounded positions remain unchanged, and the velocities change so that every row holds."""
    result, t, _ = fit
    n = len(t)
    shift = np.round(result.positions) - result.positions
    free = np.zeros(n)
    d, w = result._solve(shift, free)
    assert d == pytest.approx(shift)
    assert np.abs(w[[0, -1]]).max() == pytest.approx(0.0, abs=1e-9)
    loose = np.pad(np.ones(n - 2), 1)
    d, w = result._solve(np.zeros(n), loose)
    p, v = result.positions + d, result.velocities + w
    for (a, b, c, e), (low, high), tolerance in result.constraints:
        value = a * p[:-1] + b * p[1:] + c * v[:-1] + e * v[1:]
        base = a * result.positions[:-1] + b * result.positions[1:]
        base = base + c * result.velocities[:-1] + e * result.velocities[1:]
        room = 1e-6 * (1 + np.abs(value).max()) + (0.0 if tolerance else np.zeros(n - 1))
        assert np.all(value <= np.maximum(high, base) + room)
        assert np.all(value >= np.minimum(low, base) - room)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_rows_are_the_nearest_to_the_plan(smooth_plan: Plan, sign: float) -> None:
    """An independent linear program with d = a − b and a, b ≥ 0 has the same smallest Σ |d|."""
    unit = sign * 5e4
    t = STRETCH * smooth_plan.motion.duration * np.linspace(0.0, 1.0, 9)
    result, n = _RowFit(smooth_plan, 1, t, STRETCH, unit), 9
    d, _ = result._solve(np.zeros(n), np.pad(np.ones(n - 2), 1))
    rows, room = [], []
    for (p0, p1, v0, v1), (low, high), tolerance in result.constraints:
        position = np.diag(p0) @ np.eye(n - 1, n) + np.diag(p1) @ np.eye(n - 1, n, k=1)
        velocity = np.diag(v0) @ np.eye(n - 1, n) + np.diag(v1) @ np.eye(n - 1, n, k=1)
        base = position @ result.positions + velocity @ result.velocities
        if not tolerance:
            low, high = np.minimum(low, base), np.maximum(high, base)
        complete = np.hstack([position, -position, velocity])
        excess = np.full((n - 1, 1), -tolerance)
        rows += [np.hstack([complete, excess]), np.hstack([-complete, excess])]
        room += [high - base, base - low]
    cost = np.r_[np.ones(2 * n), np.zeros(n), EXCESS_COST]
    still = np.r_[1.0, np.zeros(n - 2), 1.0]
    limits = [(0.0, 0.0 if end else None) for end in still] * 2
    limits += [(0.0, 0.0) if end else (None, None) for end in still] + [(0.0, None)]
    best = linprog(cost, np.vstack(rows), np.concatenate(room), bounds=limits)
    assert best.x[-1] == pytest.approx(0.0, abs=1e-9)
    assert best.fun > 0.1
    assert np.abs(d).sum() == pytest.approx(best.fun, rel=1e-6)


@pytest.mark.parametrize("unit", [-60.0, 2e3, 1e5])
@pytest.mark.parametrize("is_complete", [True, False])
def test_a_table_begins_and_ends_where_the_plan_does(
    smooth_plan: Plan, unit: float, is_complete: bool
) -> None:
    """The first and last rows match the plan.

    This holds also if the increments are too coarse for good rows in between, or if the motion ends
    moving.
    """
    motion = smooth_plan.motion
    end = STRETCH * motion.duration
    for t in (np.linspace(0.0, end, 8), np.linspace(0.1, 0.7, 8) * end):
        position, velocity = _RowFit(smooth_plan, 1, t, STRETCH, unit).rows(is_complete)
        s = motion.sample(motion.breaks[0] + t[[0, -1]] / STRETCH)
        exact = s.q[:, 1] * unit, s.qd[:, 1] * unit / STRETCH
        for result, expected in zip((position, velocity), exact, strict=True):
            ends = np.round(expected) if is_complete else expected
            assert result[[0, -1]] == pytest.approx(ends, rel=1e-6, abs=1e-6)
        if is_complete:
            assert np.array_equal(np.round([position, velocity]), [position, velocity])


def test_the_manifest_describes_the_rows(plan: Plan, tmp_path: Path) -> None:
    files, manifest = export(plan, "pvt", tmp_path, counts_per_turn=COUNTS)
    stretch = manifest["stretch"]
    for i, joint in enumerate(plan.robot.joints):
        axis = manifest["axes"][joint.name]
        time, position, velocity = rows(tmp_path, joint.name)
        assert axis["file"] == f"{joint.name}.csv"
        assert (axis["start"], axis["start_velocity"]) == (position[0], velocity[0])
        assert (axis["end"], axis["end_velocity"]) == (position[-1], velocity[-1])
        t = np.cumsum(time) / 1000
        assert t[-1] == pytest.approx(stretch * plan.motion.duration)
        exact = plan.motion.sample(np.minimum(t / stretch, plan.motion.duration)).q[:, i]
        header = files[f"{joint.name}.csv"].read_text(encoding="utf-8").splitlines()[0]
        if joint.drive is None:
            assert header == "time_ms,position_rad,velocity_rad_per_s"
            assert "no drive" in axis["note"]
            continue
        assert header == "time_ms,position_inc,velocity_inc_per_s"
        assert "note" not in axis
        error = np.abs(position / axis["increments_per_unit"] - exact).max()
        assert axis["deviation"] == pytest.approx(error, rel=1e-6)
        (note,) = (n for n in manifest["notes"] if n.startswith(f"joint {joint.name}: up to"))
        assert note.endswith(f"up to {error:.2g} {joint.unit} from the plan at the rows")
        assert axis["mrpm_per_inc_per_s"] * COUNTS == 60_000
    count, slower, text = re.match(
        r"(\d+) rows, (\S+) % slower than the plan; (.*)", manifest["notes"][0]
    ).groups()  # type: ignore[union-attr]
    assert int(count) == len(time)
    assert float(slower) == pytest.approx(100 * (stretch - 1), rel=0.06)
    assert text == manifest["spline"]["interpolation"]
    assert manifest["start_rate"] == manifest["end_rate"] == {}


@pytest.mark.parametrize("which", ["start", "end"])
def test_the_rates_at_moving_ends_are_those_of_the_rounded_rows(
    plan: Plan, robot: Robot, tmp_path: Path, which: str
) -> None:
    """The manifest declares the rates of the end at which a part of a motion moves. It declares no
    rates of the other end.
    """
    complete = plan.motion
    half = len(complete.breaks) // 3
    rows_, breaks = (
        (slice(None, half), complete.breaks[: half + 1])
        if which == "end"
        else (slice(half, None), complete.breaks[half:])
    )
    part = Trajectory(breaks, complete.coefficients[rows_], ())
    ends = part.sample(part.breaks[[0, -1]], "left" if which == "end" else "right")
    mechanism = Mechanism.from_geometry(robot.geometry)
    k = 0 if which == "start" else -1
    exact = dict(
        zip(TASK_COORDINATES, task_rates(mechanism, ends.q, ends.qd)[k].tolist(), strict=True)
    )
    problem = dataclasses.replace(plan.problem, **{f"{which}_rate": exact})
    cut = certified(dataclasses.replace(plan, problem=problem, trajectory=part))
    assert cut.passed
    _, manifest = export(cut, "pvt", tmp_path, counts_per_turn=1024)
    other = {"start": "end", "end": "start"}[which]
    assert manifest[f"{other}_rate"] == {}
    axes = manifest["axes"]
    states = np.array(
        [
            [
                rows(tmp_path, j.name)[n, k] / axes[j.name].get("increments_per_unit", 1.0)
                for j in robot.joints
            ]
            for n in (1, 2)
        ]
    )
    stated = manifest[f"{which}_rate"]
    rounded = task_rates(mechanism, states[:1], states[1:])[0]
    assert [stated[name] for name in TASK_COORDINATES] == pytest.approx(rounded, abs=1e-9)
    slowed = np.array([exact[name] for name in TASK_COORDINATES]) / manifest["stretch"]
    assert rounded == pytest.approx(slowed, abs=2e-2 * np.abs(slowed).max())
    assert check(
        read_trajectory(tmp_path, robot).trajectory,
        robot,
        read_trajectory(tmp_path, robot).add_declared_rates(plan.limits),
    ).passed


def test_a_table_needs_a_millisecond_for_each_of_its_two_intervals(plan: Plan) -> None:
    coefficients = np.zeros((1, 6, 4))
    coefficients[0, 0] = plan.motion.sample(np.zeros(1)).q[0]
    axes = drive_axes(plan.robot, COUNTS)
    for duration, count in ((0.002, 3), (0.041, 3), (0.08, 3), (0.081, 4), (0.001, 0)):
        short = dataclasses.replace(
            plan, trajectory=Trajectory(np.array([0.0, duration]), coefficients, ())
        )
        if not count:
            with pytest.raises(ExportError, match="the motion of 1 ms is too short for a table"):
                next(_candidate_tables(short, axes, (0.0,)))
            continue
        table = next(_candidate_tables(short, axes, (0.0,)))
        assert len(table.t) == count
        assert table.t[-1] == duration
        assert table.stretch == pytest.approx(1.0)


def test_only_tables_of_verified_plans_are_slower_than_rounding_asks(
    plan: Plan, bad_plan: Plan, tmp_path: Path
) -> None:
    _, manifest = export(plan, "pvt", tmp_path / "a", counts_per_turn=COUNTS)
    assert manifest["stretch"] - 1 >= min(SLOWDOWNS) * (1 - 1e-9)
    _, manifest = export(bad_plan, "pvt", tmp_path / "b", counts_per_turn=COUNTS, force=True)
    assert 0 <= manifest["stretch"] - 1 < 1e-3 / bad_plan.motion.duration
