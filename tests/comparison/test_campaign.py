"""Kinds of fault × seeds × sampling rates × speeds: what `compare` may say of each, and its cause."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ssm_planner.comparison.compare import Comparison, compare
from ssm_planner.comparison.measured import Measured, read_measured
from ssm_planner.errors import RecordingError
from ssm_planner.plans import load_plan
from ssm_planner.simulation.recorder import write_recordings
from ssm_planner.simulation.simulate import Scenario, simulate
from tests.support.executions import COUNTS, FAULTS, LEAD, Executions, decimated, kinds, taken
from tests.support.paths import RESULTS

Recordings = list[Measured]
RATE = 2000
"""Hz of the executions before their samples are decimated."""


@pytest.fixture(scope="module")
def shipped() -> Executions:
    return Executions(load_plan(RESULTS / "tilt_insert" / "plan.json"), 1 / RATE)


def compared(it: Executions, recordings: Sequence[Measured], **options: float) -> Comparison:
    plan = it.plan
    return compare(plan.motion, plan.robot, plan.certificate, recordings, **options)


def without_position(recordings: Sequence[Measured]) -> Recordings:
    return [replace(each, q=None) for each in recordings]


@pytest.mark.parametrize("rate", [2000, 1000, 200, 100, 50, 20, 10, 5])
def test_a_healthy_run_is_not_called_faulty_at_any_rate(shipped: Executions, rate: int) -> None:
    """It is held where samples are at most 10 ms apart, and cannot be told below."""
    for seed in range(5):
        recordings = decimated(shipped.healthy(seed), RATE // rate, seed % (RATE // rate))
        for chosen in (recordings, without_position(recordings)):
            found = compared(shipped, chosen)
            assert found.verdict == ("held" if rate >= 100 else "cannot tell"), kinds(found)


@pytest.mark.parametrize("rate", [1000, 100, 50, 10])
@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_is_found_or_cannot_be_told(shipped: Executions, kind: str, rate: int) -> None:
    """A fault is never held. From 100 Hz on, its verdict and its cause are right."""
    for seed in range(2):
        recordings, verdict, cause = shipped.faulty(kind, seed)
        found = compared(shipped, decimated(recordings, RATE // rate, seed))
        if rate >= 100 and kind != "missing samples":
            assert (found.verdict, cause in kinds(found)) == (verdict, True), kinds(found)
        elif rate < 100:
            assert found.verdict != "held", kinds(found)


def test_a_burst_between_two_samples_is_not_held(shipped: Executions) -> None:
    """70 ms with 90 mN·m (limit 78) and 1.8 times the speed, sampled at 10 Hz in every phase."""
    run = shipped.run()
    fast = np.flatnonzero(np.abs(run.w["roll"]) > 0.9 * shipped.plans["roll"].peak)[100:240]
    run.tau["roll"][fast] = 90e-3 * np.sign(run.w["roll"][fast])
    run.w["roll"][fast] *= 1.8
    recordings = shipped.measured(run, np.random.default_rng(1))
    assert compared(shipped, decimated(recordings, 2)).verdict == "not held"
    for first in range(0, 200, 10):
        found = compared(shipped, decimated(recordings, 200, first))
        assert found.verdict != "held"
        assert found[0].visible["duration"] == pytest.approx(0.1)
        assert "sampling" in kinds(found)


@pytest.mark.parametrize("rate", [1000, 250, 100])
def test_the_stated_smallest_fault_is_found(shipped: Executions, rate: int) -> None:
    """A torque above its limit by the stated size, for the stated duration, is not held."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        run = shipped.run()
        healthy = compared(shipped, decimated(shipped.measured(run, rng), RATE // rate))[0]
        visible = healthy.visible
        limit = shipped.joints["roll"].motor.max_torque
        # The noise of the recording itself may lower a sample by some standard deviations.
        size = limit + 1.6 * visible["torque"]
        begin = int(rng.choice(np.flatnonzero(run.w["roll"])[:-100]))
        length = int(np.ceil(visible["duration"] * RATE)) + 1
        run.tau["roll"][begin : begin + length] = size
        found = compared(shipped, decimated(shipped.measured(run, rng), RATE // rate))[0]
        torque = next(each for each in found.limits if each.name == "motor torque")
        assert torque.verdict == "not held", (torque, visible)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [0.05, 0.1, 0.137, 0.5, 0.9])
def test_a_slower_run_is_compared_at_its_speed(speed: float) -> None:
    """Alone, with other axes, with and without positions, declared and estimated."""
    it = Executions(load_plan(RESULTS / "tilt_insert" / "plan.json"), 2e-3, speed)
    for seed in range(2):
        recordings = it.healthy(seed)
        for chosen in (recordings, without_position(recordings), recordings[seed : seed + 1]):
            undeclared = compared(it, chosen)
            assert (undeclared.verdict, [*kinds(undeclared)]) == ("not held", ["speed"])
            assert undeclared.speed == pytest.approx(speed, rel=1e-3)
            text = f"played at {100 * speed:.3g} % of the plan's speed instead of 100 %"
            assert text in undeclared.findings[0].text
            assert compared(it, chosen, speed=speed).verdict == "held"
        assert compared(it, decimated(recordings, 100), speed=speed).verdict == "cannot tell"
        other = compared(it, recordings, speed=0.9 if speed < 0.9 else 1.0)
        assert (other.verdict, "speed" in kinds(other)) == ("not held", True)


@pytest.mark.slow
def test_a_fault_of_a_slower_run_is_found() -> None:
    it = Executions(load_plan(RESULTS / "tilt_insert" / "plan.json"), 2e-3, 0.2)
    for kind in ("stall", "torque high", "torque burst", "lost increments", "truncated", "gap"):
        recordings, verdict, cause = it.faulty(kind, 1)
        found = compared(it, recordings, speed=0.2)
        assert (found.verdict, cause in kinds(found)) == (verdict, True), kinds(found)
        assert found.speed == pytest.approx(0.2, rel=1e-3)


@pytest.mark.parametrize("declared", [0.8, 0.9, 0.96, 0.5])
def test_a_run_at_the_planned_speed_is_not_the_declared_slower_one(
    shipped: Executions, declared: float
) -> None:
    found = compared(shipped, shipped.healthy(0), speed=declared)
    assert (found.verdict, "speed" in kinds(found)) == ("not held", True)


def test_a_run_that_is_too_fast_or_a_little_slow_is_not_held() -> None:
    for speed in (0.97, 1.1):
        it = Executions(load_plan(RESULTS / "tilt_insert" / "plan.json"), 2e-3, speed)
        found = compared(it, it.healthy(0))
        assert found.verdict == "not held"
        assert f"{100 * speed:.3g} % of the plan's speed instead of 100 %" in found.findings[0].text


def changed(recordings: Recordings, k: int, **changes: float) -> Recordings:
    """One recording with channels that are multiplied by factors."""
    scaled = {name: factor * getattr(recordings[k], name) for name, factor in changes.items()}
    return [*recordings[:k], replace(recordings[k], **scaled), *recordings[k + 1 :]]


def swapped(recordings: Recordings, k: int) -> Recordings:
    names = [recordings[k].joint, recordings[(k + 1) % 3].joint]
    names = dict(zip(names, names[::-1], strict=True))
    return [replace(each, joint=names.get(each.joint, each.joint)) for each in recordings]


def twice(recordings: Recordings, k: int) -> Recordings:
    return [
        replace(
            each,
            time=np.append(each.time, each.time + each.time[-1] + 2e-3),
            **{name: np.tile(getattr(each, name), 2) for name in ("w", "tau", "q")},
        )
        for each in recordings
    ]


def in_milliseconds(recordings: Recordings, k: int) -> Recordings:
    return [replace(each, time=1000 * each.time) for each in recordings]


CAUSES: dict[str, tuple[Callable[[Recordings, int], Recordings], str]] = {
    "swapped": (swapped, "swapped"),
    "reversed": (lambda r, k: changed(r, k, w=-1, tau=-1, q=-1), "motor_direction"),
    "current": (lambda r, k: changed(r, k, tau=-1), "its sign is wrong"),
    "rpm": (lambda r, k: changed(r, k, w=60 / (2 * np.pi)), "rpm and rad/s"),
    "rad/s": (lambda r, k: changed(r, k, w=2 * np.pi / 60), "rpm and rad/s"),
    "mN·m": (lambda r, k: changed(r, k, tau=1000), "thousandths"),
    "percent": (lambda r, k: changed(r, k, tau=0.01), "percent"),
    "degrees": (lambda r, k: changed(r, k, q=180 / np.pi), "degrees and radians"),
    "two motions": (twice, "several motions"),
    "milliseconds": (in_milliseconds, "thousandths"),
}


@pytest.mark.slow
@pytest.mark.parametrize("speed", [1.0, 0.1])
@pytest.mark.parametrize("cause", CAUSES)
def test_a_wrong_recording_is_not_held_and_its_cause_is_named(cause: str, speed: float) -> None:
    it = Executions(load_plan(RESULTS / "tilt_insert" / "plan.json"), 5e-3, speed)
    if (cause, speed) == ("milliseconds", 0.1):
        speed = 1.0
        it = Executions(it.plan, 5e-3)
    spoil, text = CAUSES[cause]
    for seed in range(3):
        found = compared(it, spoil(it.healthy(seed), seed), speed=speed)
        assert found.verdict == "not held"
        texts = [each.text for axis in (found, *found) for each in axis.findings]
        assert text in " ".join(texts), texts


def test_a_part_of_a_motion_has_a_verdict(shipped: Executions) -> None:
    """Any part of a recording cannot be told, and a motor at rest stands."""
    healthy = shipped.healthy(0)
    for share in (0.1, 0.4, 0.8):
        end = LEAD + share * shipped.duration
        for chosen in (healthy[0].time < end, healthy[0].time > end):
            found = compared(shipped, [taken(each, chosen) for each in healthy])
            assert found.verdict == "cannot tell", kinds(found)
            assert "coverage" in kinds(found)
    still = compared(shipped, [replace(each, w=0 * each.w, tau=0 * each.tau) for each in healthy])
    assert (still.verdict, "stall" in kinds(still)) == ("not held", True)


@pytest.mark.parametrize("speed", [0.0, -0.1, 1.5, np.nan])
def test_a_speed_that_no_run_can_have_is_refused(shipped: Executions, speed: float) -> None:
    with pytest.raises(RecordingError, match="allowed: above 0, up to 1"):
        compared(shipped, shipped.healthy(0), speed=speed)


@pytest.mark.slow
def test_a_simulated_commissioning_run_is_held(shipped: Executions, tmp_path: Path) -> None:
    """Controllers, encoders and friction of the simulation, which shares no code with `compare`."""
    plan = shipped.plan
    result = simulate(plan, Scenario(speed=0.1, instants=1))
    recordings = [
        read_measured(path, plan.robot, joint, COUNTS)
        for joint, path in write_recordings(result, tmp_path).items()
    ]
    found = compared(shipped, recordings, speed=0.1)
    assert found.verdict == "held", kinds(found)
    assert found.speed == pytest.approx(0.1, rel=5e-3)
