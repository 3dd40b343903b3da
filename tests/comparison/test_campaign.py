"""`compare` reaches the right verdict and cause for healthy and faulty executions. The executions
vary the kind of fault, the seed, the sampling rate and the speed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ssm_planner.comparison.compare import Comparison, compare
from ssm_planner.comparison.measured import AxisRecording, read_axis_recording
from ssm_planner.errors import RecordingError
from ssm_planner.plans import load_plan
from ssm_planner.simulation.recorder import write_recordings
from ssm_planner.simulation.simulate import Scenario, SimulationResult, simulate
from tests.support.cases import drawn, selected
from tests.support.executions import (
    COUNTS,
    FAULTS,
    HIDDEN,
    LEAD,
    RPM,
    Executions,
    Recordings,
    add_rest,
    changed,
    decimated,
    in_milliseconds,
    kinds,
    swapped,
    taken,
    twice,
)
from tests.support.paths import RESULTS

RATE = 2000
"""Sampling rate of the executions in Hz, before samples are omitted."""


@pytest.fixture(scope="module")
def shipped() -> Executions:
    return Executions(load_plan(RESULTS / "tilt_insert" / "plan.json"), 1 / RATE)


def compared(it: Executions, recordings: Sequence[AxisRecording], **options: float) -> Comparison:
    plan = it.plan
    return compare(plan.motion, plan.robot, plan.certificate, recordings, **options)


def without_position(recordings: Sequence[AxisRecording]) -> Recordings:
    return [replace(item, q=None) for item in recordings]


@pytest.mark.parametrize("rate", [2000, 1000, 200, 100, 50, 20, 10, 5])
def test_a_healthy_run_is_not_called_faulty_at_any_rate(shipped: Executions, rate: int) -> None:
    """A healthy run is held if its samples are at most 10 ms apart.

    Otherwise the verdict is "cannot tell".
    """
    for seed in range(5):
        recordings = decimated(shipped.healthy(seed), RATE // rate, seed % (RATE // rate))
        for chosen in (recordings, without_position(recordings)):
            result = compared(shipped, chosen)
            assert result.verdict == ("held" if rate >= 100 else "cannot tell"), kinds(result)


@pytest.mark.parametrize("rate", [1000, 100, 50, 10])
@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_is_found_or_cannot_be_told(shipped: Executions, kind: str, rate: int) -> None:
    """From 100 Hz on, verdict and cause are right. Below 100 Hz, no faulty run is held."""
    for seed in range(2):
        recordings, verdict, cause = shipped.faulty(kind, seed)
        result = compared(shipped, decimated(recordings, RATE // rate, seed))
        # Among fewer samples, some missing ones are not noticed.
        if rate >= 100 and kind != "missing samples":
            assert (result.verdict, cause in kinds(result)) == (verdict, True), kinds(result)
        elif rate < 100:
            assert result.verdict != "held", kinds(result)


def test_a_burst_between_two_samples_is_not_held(shipped: Executions) -> None:
    """For 70 ms, the torque is 90 mN·m (limit 78 mN·m), and the speed is 1.8 times as high.

    Samples at 10 Hz can miss this burst, so the sampling begins at different phases.
    """
    run = shipped.run()
    fast = np.flatnonzero(np.abs(run.w["roll"]) > 0.9 * shipped.plans["roll"].peak)[100:240]
    run.tau["roll"][fast] = 90e-3 * np.sign(run.w["roll"][fast])
    run.w["roll"][fast] *= 1.8
    recordings = shipped.measured(run, np.random.default_rng(1))
    assert compared(shipped, decimated(recordings, 2)).verdict == "not held"
    for first in range(0, 200, 10):
        result = compared(shipped, decimated(recordings, 200, first))
        assert result.verdict != "held"
        assert result[0].visible["duration"] == pytest.approx(0.1)
        assert "sampling" in kinds(result)


@pytest.mark.parametrize("rate", [1000, 250, 100])
def test_the_stated_smallest_fault_is_found(shipped: Executions, rate: int) -> None:
    """A torque is not held if it exceeds its limit by 1.6 times the stated size, for the stated
    duration.
    """
    for seed in range(4):
        rng = np.random.default_rng(seed)
        run = shipped.run()
        healthy = compared(shipped, decimated(shipped.measured(run, rng), RATE // rate))[0]
        visible = healthy.visible
        limit = shipped.joints["roll"].motor.max_torque
        # The noise of the recording may lower a sample by some standard deviations, so the excess
        # is larger than the stated size.
        size = limit + 1.6 * visible["torque"]
        start = int(rng.choice(np.flatnonzero(run.w["roll"])[:-100]))
        length = int(np.ceil(visible["duration"] * RATE)) + 1
        run.tau["roll"][start : start + length] = size
        result = compared(shipped, decimated(shipped.measured(run, rng), RATE // rate))[0]
        torque = next(item for item in result.limits if item.name == "motor torque")
        assert torque.verdict == "not held", (torque, visible)


@pytest.mark.slow
@pytest.mark.parametrize("speed", drawn(2, [0.05, 0.1, 0.137, 0.5, 0.9]))
def test_a_slower_run_is_compared_at_its_speed(speed: float) -> None:
    """The speed is declared or estimated, with and without positions and other axes."""
    it = Executions(load_plan(RESULTS / "tilt_insert" / "plan.json"), 2e-3, speed)
    for seed in range(2):
        recordings = it.healthy(seed)
        alone = recordings[seed : seed + 1]
        for chosen in (recordings, without_position(recordings), alone):
            undeclared = compared(it, chosen)
            missing = {"missing recording"} if chosen is alone else set()
            assert (undeclared.verdict, kinds(undeclared)) == ("not held", {"speed"} | missing)
            assert undeclared.speed == pytest.approx(speed, rel=1e-3)
            text = f"played at {100 * speed:.3g} % of the plan's speed instead of 100 %"
            assert text in undeclared.findings[0].text
            declared = compared(it, chosen, speed=speed)
            assert all(axis.followed for axis in declared), kinds(declared)
            assert declared.verdict == ("cannot tell" if chosen is alone else "held")
        assert compared(it, decimated(recordings, 100), speed=speed).verdict == "cannot tell"
        other = compared(it, recordings, speed=0.9 if speed < 0.9 else 1.0)
        assert (other.verdict, "speed" in kinds(other)) == ("not held", True)


@pytest.mark.slow
def test_a_fault_of_a_slower_run_is_found() -> None:
    it = Executions(load_plan(RESULTS / "tilt_insert" / "plan.json"), 2e-3, 0.2)
    for kind in ("stall", "torque high", "torque burst", "lost increments", "truncated", "gap"):
        recordings, verdict, cause = it.faulty(kind, 1)
        result = compared(it, recordings, speed=0.2)
        assert (result.verdict, cause in kinds(result)) == (verdict, True), kinds(result)
        assert result.speed == pytest.approx(0.2, rel=1e-3)


@pytest.mark.parametrize("declared", [0.8, 0.9, 0.96, 0.5])
def test_a_run_at_the_planned_speed_is_not_the_declared_slower_one(
    shipped: Executions, declared: float
) -> None:
    result = compared(shipped, shipped.healthy(0), speed=declared)
    assert (result.verdict, "speed" in kinds(result)) == ("not held", True)


def test_a_run_that_is_too_fast_or_a_little_slow_is_not_held() -> None:
    for speed in (0.97, 1.1):
        it = Executions(load_plan(RESULTS / "tilt_insert" / "plan.json"), 2e-3, speed)
        result = compared(it, it.healthy(0))
        assert result.verdict == "not held"
        assert (
            f"{100 * speed:.3g} % of the plan's speed instead of 100 %" in result.findings[0].text
        )


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


SPOILT = [(cause, speed) for cause in CAUSES for speed in drawn(1, [1.0, 0.1], cause)]
"""Each cause is tested at one of the speeds."""


@pytest.mark.slow
@pytest.mark.parametrize(("cause", "speed"), SPOILT)
def test_a_wrong_recording_is_not_held_and_its_cause_is_named(cause: str, speed: float) -> None:
    it = Executions(load_plan(RESULTS / "tilt_insert" / "plan.json"), 5e-3, speed)
    if (cause, speed) == ("milliseconds", 0.1):
        speed = 1.0
        it = Executions(it.plan, 5e-3)
    spoil, text = CAUSES[cause]
    for seed in range(3):
        result = compared(it, spoil(it.healthy(seed), seed), speed=speed)
        assert result.verdict == "not held"
        texts = [item.text for axis in (result, *result) for item in axis.findings]
        assert text in " ".join(texts), texts


def test_a_part_of_a_motion_has_a_verdict(shipped: Executions) -> None:
    """A recording of a part of the motion has the verdict "cannot tell".

    A motor that never moves has the verdict "not held" and the cause "stall".
    """
    healthy = shipped.healthy(0)
    for share in (0.1, 0.4, 0.8):
        end = LEAD + share * shipped.duration
        for chosen in (healthy[0].time < end, healthy[0].time > end):
            result = compared(shipped, [taken(item, chosen) for item in healthy])
            assert result.verdict == "cannot tell", kinds(result)
            assert "coverage" in kinds(result)
    still = compared(shipped, [replace(item, w=0 * item.w, tau=0 * item.tau) for item in healthy])
    assert (still.verdict, "stall" in kinds(still)) == ("not held", True)


@pytest.mark.parametrize("speed", [0.0, -0.1, 1.5, np.nan])
def test_a_speed_that_no_run_can_have_is_refused(shipped: Executions, speed: float) -> None:
    with pytest.raises(RecordingError, match="allowed: above 0, up to 1"):
        compared(shipped, shipped.healthy(0), speed=speed)


@cache
def simulated(speed: float) -> SimulationResult:
    """Return the simulation of the shipped plan at a speed, relative to the planned speed."""
    plan = load_plan(RESULTS / "tilt_insert" / "plan.json")
    return simulate(plan, Scenario(speed=speed, instants=1))


@pytest.mark.slow
def test_a_simulated_commissioning_run_is_held(shipped: Executions, tmp_path: Path) -> None:
    """The simulation has controllers, encoders and friction, and shares no code with `compare`."""
    plan = shipped.plan
    result = simulated(0.1)
    recordings = [
        read_axis_recording(path, plan.robot, joint, COUNTS)
        for joint, path in write_recordings(result, tmp_path).items()
    ]
    outcome = compared(shipped, recordings, speed=0.1)
    assert outcome.verdict == "held", kinds(outcome)
    assert outcome.speed == pytest.approx(0.1, rel=5e-3)


@pytest.fixture(scope="module")
def executions(shipped: Executions) -> dict[tuple[float, float], Executions]:
    """Return executions by their sampling rate in Hz and their speed."""
    cases = ((1000, 1.0), (100, 1.0), (200, 0.1))
    return {(rate, speed): Executions(shipped.plan, 1 / rate, speed) for rate, speed in cases}


@pytest.mark.parametrize("fault", HIDDEN)
def test_a_fault_that_resembles_noise_is_never_held(
    executions: dict[tuple[float, float], Executions], fault: str
) -> None:
    for (rate, speed), it in executions.items():
        for seed in range(2):
            rng = np.random.default_rng([rate, seed])
            run = it.run()
            HIDDEN[fault](it, run, rng)
            recordings = it.measured(run, rng, rng.uniform(0.5, 3.0))
            result = compared(it, recordings, speed=speed)
            assert result.verdict != "held", (rate, speed, seed)
            if fault not in ("low_speed", "late_recorder"):
                result = compared(it, without_position(recordings), speed=speed)
                assert result.verdict != "held", (rate, speed, seed)


@pytest.mark.parametrize("rest", [1.0, 30.0])
def test_a_long_rest_is_no_fault(shipped: Executions, rest: float) -> None:
    it = Executions(shipped.plan, 2e-3)
    run = it.run()
    add_rest(it, run, rest)
    recordings = it.measured(run, np.random.default_rng(1), 1.0)
    for chosen in (recordings, without_position(recordings)):
        result = compared(it, chosen)
        assert result.verdict == "held", kinds(result)


def test_an_offset_below_the_resolution_is_no_fault(shipped: Executions) -> None:
    recordings = decimated(shipped.measured(shipped.run(), np.random.default_rng(1), 1.0), 2)
    shifted = [replace(item, w=item.w + 0.3 * RPM, q=None) for item in recordings]
    result = compared(shipped, shifted)
    assert result.verdict == "held", kinds(result)


def test_jitter_at_100_hz_is_no_fault_and_longer_intervals_are(shipped: Executions) -> None:
    it = Executions(shipped.plan, 0.01)
    for jitter, verdict in ((0.05e-3, "held"), (0.2e-3, "held"), (1e-3, "cannot tell")):
        rng = np.random.default_rng(1)
        times = 0.01 * np.arange(round((it.duration + 2 * LEAD) / 0.01))
        times += rng.uniform(-jitter, jitter, len(times))
        recordings = [
            replace(
                item,
                time=times,
                **{k: np.interp(times, item.time, getattr(item, k)) for k in ("w", "tau", "q")},
            )
            for item in shipped.healthy(0)
        ]
        result = compared(it, recordings)
        assert result.verdict == verdict, kinds(result)


def test_a_moving_axis_without_a_recording_is_named(shipped: Executions) -> None:
    recordings = decimated(shipped.healthy(0), 2)
    result = compared(shipped, recordings[:1])
    assert (result.verdict, result[0].verdict) == ("cannot tell", "held")
    assert result.findings[0].text == "no recording of tilt, insertion, which the plan moves"


def test_limits_that_are_not_judged_are_listed(shipped: Executions) -> None:
    result = compared(shipped, decimated(shipped.healthy(0), 2))
    judged = {(limit.name, axis.joint) for axis in result for limit in axis.limits}
    checks = shipped.plan.certificate.limits
    assert len(judged & {(check.name, check.joint) for check in checks}) == len(judged) == 15
    assert len(result.unjudged) == len(checks) - len(judged)
    assert {"velocity spin", "retina clearance", "continuous torque roll"} <= set(result.unjudged)
    assert result.to_dict()["unjudged"] == list(result.unjudged)


@pytest.mark.slow
@pytest.mark.parametrize("speed", selected([1.0, 0.1], every=[1.0, 0.5, 0.1, 0.05]))
def test_a_simulated_run_is_held_at_any_rate(
    shipped: Executions, tmp_path: Path, speed: float
) -> None:
    result = simulated(speed)
    for rate in (2000, 500, 100):
        recordings = [
            read_axis_recording(path, shipped.plan.robot, joint, COUNTS)
            for joint, path in write_recordings(result, tmp_path, 1 / rate).items()
        ]
        for chosen in (recordings, without_position(recordings)):
            outcome = compared(shipped, chosen, speed=speed)
            assert outcome.verdict == "held", (rate, kinds(outcome))


def test_a_wrong_homing_and_a_wrong_scale_are_named(shipped: Executions) -> None:
    """A constant error of the position suggests the homing. Otherwise, the travel is compared."""
    recordings = decimated(shipped.healthy(0), 2)
    offset = 20e-3 * shipped.joints["roll"].velocity
    homed = [replace(recordings[0], q=recordings[0].q + offset), *recordings[1:]]
    for chosen, text in (
        (homed, "the error is almost constant: is the homing wrong?"),
        (changed(recordings, 0, w=1.1, q=1.1), "its travel is 1.10 times the predicted"),
    ):
        result = compared(shipped, chosen)
        assert result[0].verdict == "not held"
        tracking = next(item for item in result[0].findings if item.kind == "tracking")
        assert text in tracking.text


@pytest.mark.parametrize("rate", [2000, 100])
def test_a_motor_that_never_moves_in_a_slow_run_stands_still(rate: int) -> None:
    """The noise of single samples is larger than the speed below which a motor counts as at rest.
    It is not a motion.
    """
    it = Executions(load_plan(RESULTS / "tilt_insert" / "plan.json"), 1 / rate, 0.05)
    run = it.run()
    run.w["insertion"][:] = run.tau["insertion"][:] = 0.0
    it.follow(run, "insertion")
    result = compared(it, it.measured(run, np.random.default_rng(0), rpm=2.0), speed=0.05)
    assert (result.verdict, "stall" in kinds(result)) == ("not held", True), kinds(result)
