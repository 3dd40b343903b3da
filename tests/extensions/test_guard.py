"""The run-time guard raises an alarm within 20 ms after every kind of fault, and no alarm in
healthy runs. The guards in C and in Python raise the same alarms.
"""

from __future__ import annotations

import dataclasses
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ssm_planner.dynamics.robot_dynamics import motor_torque
from ssm_planner.errors import ExportError
from ssm_planner.formats.export import export
from ssm_planner.formats.format import FORMATS
from ssm_planner.plans import Plan
from ssm_planner.problem import JOINTS, Robot
from ssm_planner.registry import Registry
from ssm_planner.simulation.simulate import Scenario, simulate
from tests.support.executions import LEAD, Executions
from tests.support.playing import short_plan  # makes the next package importable

# isort: split
from ssm_planner_guard import (
    GUARD,
    Alarm,
    Cause,
    Guard,
    NativeGuard,
    Sample,
    Thresholds,
    guard_of,
    thresholds_of,
)

COMPILER = shutil.which("cc")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler (cc) on this machine")
EVERY_CASE = bool(os.environ.get("EVERY_CASE"))
STEP = 1e-3
SEEDS = 50 if EVERY_CASE else 10
WITHIN = 20
"""Ticks of 1 ms within which a fault must raise an alarm."""
BEFORE, AFTER = 60, 40
"""Ticks before and after the fault that the guard sees."""
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror", "-O2", "-c")


@dataclasses.dataclass
class Run:
    """A run has a clock (n,), and instants, positions, velocities and torques (n, 4) of the
    measurements.
    """

    clock: np.ndarray
    time: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    tau: np.ndarray

    def sample(self, i: int) -> Sample:
        return Sample(self.time[i], self.q[i], self.qd[i], self.tau[i])


class Bench:
    """A bench provides the set points of a plan, and measured runs of it."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.executions = Executions(plan, STEP)
        self.thresholds = thresholds_of(plan, STEP)
        t = np.arange(0.0, self.executions.duration + 2 * LEAD, STEP)
        self.reference = reference(plan, t - LEAD)

    def run(self, seed: int, healthy: bool) -> Run:
        """Return a measured run.

        If `healthy`, friction and lag differ a little from those of the plan.
        """
        rng = np.random.default_rng([seed, 7])
        it = self.executions
        measured = it.healthy(seed) if healthy else it.measured(it.run(), rng, 3.0, 0.01)
        clock = measured[0].time
        run = Run(clock, *(np.zeros((len(clock), 4)) for _ in range(4)))
        run.time[:] = clock[:, None]
        for recording in measured:
            k = JOINTS.index(recording.joint)
            assert recording.q is not None
            run.q[:, k], run.tau[:, k] = recording.q, recording.tau
            run.qd[:, k] = recording.w / it.plans[recording.joint].ratio
        return run

    def first_alarm(
        self, guard: Guard | NativeGuard, run: Run, rows: range | None = None
    ) -> tuple[int, Alarm] | None:
        """Return the row and the alarm of the first alarm in a run, or None."""
        for i in rows or range(len(run.clock)):
            point = tuple(column[i] for column in self.reference)
            alarm = guard.tick(float(run.clock[i]), point, run.sample(i))
            if alarm is not None:
                return i, alarm
        return None


def reference(plan: Plan, t: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return set points q, qd, qdd and motor torques (n, 4) at times (n,) from the start, s."""
    samples = plan.motion.sample(plan.motion.breaks[0] + np.clip(t, 0, plan.motion.duration))
    inside = ((t >= 0) & (t < plan.motion.duration))[:, None]
    qd, qdd = samples.qd * inside, samples.qdd * inside
    return samples.q, qd, qdd, motor_torque(plan.robot, samples.q, qd, qdd)


@pytest.fixture(scope="module")
def plan(robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> Plan:
    return short_plan(tmp_path_factory.mktemp("plan"), robot)


@pytest.fixture(scope="module")
def bench(plan: Plan) -> Bench:
    return Bench(plan)


# Faults. Each function changes the joint k of a run from the row i on.

Spoil = Callable[[Bench, Run, int, int, np.random.Generator], None]


def stalls(bench: Bench, run: Run, k: int, i: int, rng: np.random.Generator) -> None:
    run.q[i:, k], run.qd[i:, k] = run.q[i, k], 0.0
    run.tau[i:, k] = np.sign(run.tau[i, k]) * bench.thresholds.torque_max[k]


def too_fast(bench: Bench, run: Run, k: int, i: int, rng: np.random.Generator) -> None:
    excess = rng.uniform(0.1, 0.2) * np.sign(run.qd[i, k]) * bench.thresholds.velocity_max[k]
    run.qd[i:, k] += excess
    run.q[i:, k] += excess * STEP * np.arange(len(run.clock) - i)


def reversed_axis(bench: Bench, run: Run, k: int, i: int, rng: np.random.Generator) -> None:
    run.q[i:, k], run.qd[i:, k] = 2 * run.q[i, k] - run.q[i:, k], -run.qd[i:, k]


def lost_increments(bench: Bench, run: Run, k: int, i: int, rng: np.random.Generator) -> None:
    way = bench.thresholds.velocity_max[k] * bench.thresholds.lag
    run.q[i:, k] += rng.choice([-1, 1]) * rng.uniform(1.3, 4.0) * way


def half_counts(bench: Bench, run: Run, k: int, i: int, rng: np.random.Generator) -> None:
    run.q[i:, k], run.qd[i:, k] = (run.q[i, k] + run.q[i:, k]) / 2, run.qd[i:, k] / 2


def swapped(bench: Bench, run: Run, k: int, i: int, rng: np.random.Generator) -> None:
    other = int(rng.choice([j for j in np.flatnonzero(bench.thresholds.driven) if j != k]))
    for values in (run.q, run.qd, run.tau):
        values[i:, [k, other]] = values[i:, [other, k]]


def frozen(bench: Bench, run: Run, k: int, i: int, rng: np.random.Generator) -> None:
    for values in (run.q, run.qd, run.tau):
        values[i:, k] = values[i, k]


def not_a_number(bench: Bench, run: Run, k: int, i: int, rng: np.random.Generator) -> None:
    channel = (run.time, run.q, run.qd, run.tau)[rng.integers(4)]
    channel[i:, k] = rng.choice([np.nan, np.inf]) if channel is not run.time else np.nan


def no_samples(bench: Bench, run: Run, k: int, i: int, rng: np.random.Generator) -> None:
    run.time[i:, k] = run.time[i, k]


def clock_jumps(bench: Bench, run: Run, k: int, i: int, rng: np.random.Generator) -> None:
    jump = rng.choice([-1, 1]) * rng.uniform(0.02, 5.0)
    run.clock[i:] += jump
    run.time[i:] += jump


def torque_beyond_motor(bench: Bench, run: Run, k: int, i: int, rng: np.random.Generator) -> None:
    peak = bench.thresholds.torque_max[k] + bench.thresholds.torque_noise[k]
    run.tau[i:, k] = np.sign(run.tau[i, k]) * rng.uniform(1.05, 1.5) * peak


def collides(bench: Bench, run: Run, k: int, i: int, rng: np.random.Generator) -> None:
    share = rng.uniform(0.6, 1.2) * np.abs(bench.reference[3][:, k]).max()
    run.tau[i:, k] += share * np.sign(run.tau[i, k])


def coupling_lost(bench: Bench, run: Run, k: int, i: int, rng: np.random.Generator) -> None:
    run.tau[i:, k] *= rng.uniform(0.0, 0.3)


FAULTS: dict[str, tuple[Spoil, set[Cause]]] = {
    "stall": (stalls, {Cause.SPEED, Cause.PATH, Cause.TORQUE}),
    "too fast": (too_fast, {Cause.VELOCITY_LIMIT, Cause.SPEED, Cause.PATH}),
    "reversed axis": (reversed_axis, {Cause.SPEED, Cause.PATH}),
    "lost increments": (lost_increments, {Cause.PATH, Cause.POSITION_LIMIT}),
    "half counts per turn": (half_counts, {Cause.SPEED, Cause.PATH}),
    "swapped axes": (
        swapped,
        {Cause.PATH, Cause.SPEED, Cause.POSITION_LIMIT, Cause.VELOCITY_LIMIT, Cause.TORQUE_LIMIT},
    ),
    "frozen sensor": (frozen, {Cause.PATH, Cause.SPEED}),
    "not a number": (not_a_number, {Cause.NOT_A_NUMBER, Cause.LATE}),
    "no samples": (no_samples, {Cause.LATE}),
    "clock jumps": (clock_jumps, {Cause.CLOCK, Cause.LATE}),
    "torque beyond the motor's": (torque_beyond_motor, {Cause.TORQUE_LIMIT}),
    "collision": (collides, {Cause.TORQUE, Cause.TORQUE_LIMIT}),
    "coupling lost": (coupling_lost, {Cause.TORQUE}),
}
AT_FULL_SPEED = {"too fast"}
"""These faults begin while the joint moves almost at its largest speed."""


def faulty(bench: Bench, kind: str, seed: int) -> tuple[Run, int]:
    """Return a run with a fault, and the row at which the fault begins."""
    rng = np.random.default_rng([sorted(FAULTS).index(kind), seed])
    run = bench.run(seed, healthy=False)
    k = int(rng.choice(np.flatnonzero(bench.thresholds.driven)))
    speed = np.abs(bench.reference[1][:, k])
    torque = np.abs(bench.reference[3][:, k])
    share = 0.95 if kind in AT_FULL_SPEED else 0.3
    moving = (speed > share * speed.max()) & (torque > 0.3 * torque.max())
    # Only a moving joint shows the fault, so it keeps moving for longer than the guard may take.
    steady = [i for i in np.flatnonzero(moving) if moving[i - BEFORE // 3 : i + WITHIN + 5].all()]
    i = int(rng.choice(steady))
    FAULTS[kind][0](bench, run, k, i, rng)
    return run, i


@needs_compiler
@pytest.mark.parametrize("kind", FAULTS)
def test_every_fault_raises_an_alarm_within_20_ms(kind: str, bench: Bench) -> None:
    guard = NativeGuard(bench.plan, bench.thresholds)
    for seed in range(SEEDS):
        run, start = faulty(bench, kind, seed)
        guard.restart()
        seen = bench.first_alarm(guard, run, range(start - BEFORE, start + AFTER))
        assert seen is not None, seed
        row, alarm = seen
        assert 0 <= row - start <= WITHIN, (seed, alarm)
        assert alarm.cause in FAULTS[kind][1], (seed, alarm)


@needs_compiler
def test_healthy_runs_raise_no_alarm(bench: Bench) -> None:
    """The friction differs by up to 15 % from that of the plan, and the lag is up to 2 ms.

    The noise is up to 3 rpm and 3 %.
    """
    guard = NativeGuard(bench.plan, bench.thresholds)
    for seed in range(200 if EVERY_CASE else 5):
        guard.restart()
        assert bench.first_alarm(guard, bench.run(seed, healthy=True)) is None, seed


@needs_compiler
def test_c_and_python_raise_the_same_alarms(bench: Bench) -> None:
    native = NativeGuard(bench.plan, bench.thresholds)
    for seed, kind in enumerate(FAULTS):
        run, start = faulty(bench, kind, seed)
        rows = range(start - BEFORE, start + AFTER)
        native.restart()
        in_c = bench.first_alarm(native, run, rows)
        in_python = bench.first_alarm(Guard(bench.thresholds), run, rows)
        assert in_c is not None
        assert in_python is not None
        assert in_c[0] == in_python[0], kind
        assert in_c[1].cause == in_python[1].cause
        assert in_c[1].joint == in_python[1].joint
        values = [(alarm.value, alarm.bound) for _, alarm in (in_c, in_python)]
        assert values[0] == pytest.approx(values[1], rel=1e-9, abs=1e-12, nan_ok=True)


@pytest.mark.parametrize("friction", (0.85, 0.9, 1.0, 1.1, 1.15) if EVERY_CASE else (1.0,))
def test_a_simulated_arm_with_its_controllers_raises_no_alarm(plan: Plan, friction: float) -> None:
    """The simulation has elastic joints, backlash, breakaway, and controllers with encoders."""
    result = simulate(plan, Scenario(friction=friction))
    thresholds = thresholds_of(plan, STEP)
    guard, count = Guard(thresholds), int(plan.motion.duration / STEP)
    # Each row is the latest period of the position loop before a tick.
    rows = (np.arange(count) * STEP / (result.time[1] - result.time[0]) + 1e-9).astype(int)
    ratios = np.array([joint.drive.ratio if joint.drive else 1.0 for joint in plan.robot.joints])
    offsets = result.motor_angle[0] / ratios - plan.motion.sample(plan.motion.breaks[:1]).q[0]
    points = reference(plan, np.arange(count) * STEP)
    for i, row in enumerate(rows):
        sample = Sample(
            np.full(4, i * STEP),
            result.motor_angle[row] / ratios - offsets,
            result.w[row] / ratios,
            result.torque[row],
        )
        assert guard.tick(i * STEP, tuple(column[i] for column in points), sample) is None


def test_an_alarm_stays(bench: Bench) -> None:
    """After an alarm, the guard returns the same alarm for healthy measurements."""
    run, start = faulty(bench, "not a number", 0)
    guard = Guard(bench.thresholds)
    seen = bench.first_alarm(guard, run, range(start - BEFORE, start + AFTER))
    assert seen is not None
    healthy = bench.run(0, healthy=False)
    point = tuple(column[start] for column in bench.reference)
    assert guard.tick(float(healthy.clock[start]), point, healthy.sample(start)) is seen[1]


def test_without_a_compiler_the_guard_runs_in_python(
    plan: Plan, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    guard, note = guard_of(plan, bench.thresholds)
    assert isinstance(guard, Guard)
    assert "no-such-compiler" in note
    monkeypatch.setenv("CC", "false")
    assert "fails" in guard_of(plan, bench.thresholds)[1]


@pytest.mark.parametrize("rate", [50.0, 7000.0])
def test_a_rate_at_which_the_guard_cannot_judge_is_refused(plan: Plan, rate: float) -> None:
    with pytest.raises(ExportError, match="the guard cannot tick"):
        thresholds_of(plan, 1 / rate)


def test_the_band_of_a_posterior_replaces_the_assumed_one(
    plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A posterior of the friction gives the torque margin, and no spread is assumed."""
    from ssm_planner_guard import thresholds as module

    def with_posterior(*arguments: object) -> list[object]:
        (axis,) = predict(*arguments)
        margin = 2e-3
        changes = {"low": axis.torque - margin, "high": axis.torque + margin, "has_posterior": True}
        return [dataclasses.replace(axis, **changes)]

    predict = module.predict_axes
    assumed = thresholds_of(plan, STEP)
    monkeypatch.setattr(module, "predict_axes", with_posterior)
    known: Thresholds = thresholds_of(plan, STEP)
    driven = known.driven
    assert (known.torque_spread[driven] == 0).all()
    assert known.torque_margin[driven] == pytest.approx(assumed.torque_margin[driven] + 2e-3)


@needs_compiler
def test_the_export_compiles_strictly_and_is_small(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    formats = Registry("nobody.provides", "export format", *FORMATS.values(), GUARD)
    monkeypatch.setattr("ssm_planner.formats.export.FORMATS", formats)
    files, manifest = export(plan, "guard", tmp_path / "guard", rate=1000.0)
    assert {"guard.c", "guard.h", "ssm_trajectory.c"} <= set(files)
    assert manifest["guard"]["thresholds"]["lag"] == 0.01
    assert COMPILER is not None
    for flags in ((), ("-DSSM_FLOAT32",)):
        for name in ("guard", "ssm_robot", "ssm_trajectory"):
            source = str(tmp_path / "guard" / f"{name}.c")
            target = str(tmp_path / f"{name}.o")
            subprocess.run([COMPILER, *STRICT, *flags, source, "-o", target], check=True)
        sizes = [(tmp_path / f"{name}.o").stat().st_size for name in ("guard", "ssm_robot")]
        assert sum(sizes) <= 64_000
