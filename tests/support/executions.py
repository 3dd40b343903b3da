"""Executions of a plan as recorders of its axes show them, healthy and with seeded faults."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ssm_planner.comparison.measured import AxisRecording
from ssm_planner.comparison.predicted import predict_axes
from ssm_planner.plans import Plan

RPM = 2 * np.pi / 60
COUNTS = 4096
Recordings = list[AxisRecording]
LEAD = 0.3
"""Time of rest in s before and after the motion."""


@dataclass
class Run:
    """Channels of every driven joint by name: time (s), w (rad/s), tau (N·m), q (rad or m)."""

    time: dict[str, np.ndarray]
    w: dict[str, np.ndarray]
    tau: dict[str, np.ndarray]
    q: dict[str, np.ndarray]
    channels: tuple[str, ...] = field(default=("time", "w", "tau", "q"))

    def keep(self, joint: str, chosen: np.ndarray) -> None:
        for name in self.channels:
            getattr(self, name)[joint] = getattr(self, name)[joint][chosen]


class Executions:
    """Generator of runs of one plan. Each run is a fresh copy that a test may change."""

    def __init__(self, plan: Plan, step: float = 1e-3, speed: float = 1.0) -> None:
        self.plan, self.step = plan, step
        self.names = [joint.name for joint in plan.robot.joints if joint.drive is not None]
        self.joints = {joint.name: joint for joint in plan.robot.joints}
        self.plans = dict(
            zip(
                self.names,
                predict_axes(plan.motion.slower(speed), plan.robot, self.names),
                strict=True,
            )
        )
        self.duration = plan.motion.duration / speed

    def run(self, clock: Callable[[np.ndarray], np.ndarray] | None = None) -> Run:
        """Return a run as planned.

        `clock` maps the true time to the planned time and is the same for all joints.
        """
        time = np.arange(0.0, self.duration + 2 * LEAD, self.step)
        t = time - LEAD if clock is None else clock(time - LEAD)
        run = Run({}, {}, {}, {})
        for name, plan in self.plans.items():
            run.time[name] = time.copy()
            run.w[name] = np.interp(t, plan.time, plan.speed, left=0.0, right=0.0)
            run.tau[name] = np.interp(t, plan.time, plan.torque, left=0.0, right=0.0)
            run.q[name] = np.interp(t, plan.time, plan.position)
        return run

    def follow(self, run: Run, name: str) -> None:
        """Replace the position of a joint by the integral of its speed."""
        step = np.diff(run.time[name]) * (run.w[name][1:] + run.w[name][:-1]) / 2
        start = run.q[name][0]
        run.q[name] = start + np.concatenate([[0.0], np.cumsum(step)]) / self.plans[name].ratio

    def measured(
        self, run: Run, rng: np.random.Generator, rpm: float = 2.0, torque: float = 0.01
    ) -> list[AxisRecording]:
        """Return recordings with noise and the rounding of the recorder.

        The noise of the speed is uniform within ± rpm. The noise of the torque is normal, relative
        to the largest torque of the axis.
        """
        result = []
        for name in self.names:
            nominal, ratio = self.joints[name].motor.nominal_torque, self.joints[name].drive.ratio
            w = run.w[name] / RPM + rng.uniform(-rpm, rpm, len(run.w[name]))
            largest = np.abs(self.plans[name].torque).max()
            tau = (run.tau[name] + torque * largest * rng.normal(size=len(w))) / nominal
            increment = 2 * np.pi / COUNTS / ratio
            result.append(
                AxisRecording(
                    name,
                    f"{name}.csv",
                    time=run.time[name],
                    w=np.round(w) * RPM,
                    tau=np.round(tau, 3) * nominal,
                    q=np.round(run.q[name] / increment) * increment,
                    speed_resolution=RPM,
                    torque_resolution=1e-3 * nominal,
                    position_resolution=increment,
                )
            )
        return result

    def healthy(self, seed: int) -> list[AxisRecording]:
        """Return recordings of a healthy run.

        Friction differs from the plan by up to 15 %. The servo lags by up to 2 ms. The speed has
        noise of ±0.5 to ±3 rpm.
        """
        rng = np.random.default_rng(seed)
        lag = rng.uniform(0, 2e-3)
        run = self.run(lambda t: t - lag)
        for name in self.names:
            run.tau[name] *= rng.uniform(0.85, 1.15)
        return self.measured(run, rng, rng.uniform(0.5, 3.0), rng.uniform(0.002, 0.03))

    def faulty(self, kind: str, seed: int) -> tuple[list[AxisRecording], str, str]:
        """Return recordings with one seeded fault, and the expected verdict and finding."""
        rng = np.random.default_rng([sorted(FAULTS).index(kind), seed])
        run = self.run()
        joint = str(rng.choice(self.names))
        moving = np.flatnonzero(np.abs(run.w[joint]) > 0.3 * self.plans[joint].peak)
        spoil, verdict, finding = FAULTS[kind]
        run = spoil(self, run, joint, moving, rng) or run
        return self.measured(run, rng, rng.uniform(0.5, 3.0)), verdict, finding


def decimated(
    recordings: Sequence[AxisRecording], factor: int, first: int = 0
) -> list[AxisRecording]:
    """Return every `factor`-th sample of each recording."""
    return [taken(item, slice(first, None, factor)) for item in recordings]


def taken(recording: AxisRecording, chosen: slice | np.ndarray) -> AxisRecording:
    """Return the chosen samples of a recording."""
    channels = {name: getattr(recording, name) for name in ("time", "w", "tau", "q")}
    return replace(recording, **{k: v if v is None else v[chosen] for k, v in channels.items()})


def write(it: Executions, measured: Sequence[AxisRecording], folder: Path) -> dict[str, Path]:
    """Write EPOS recorder exports with a position channel, and return their paths by joint."""
    paths = {}
    for item in measured:
        joint = it.joints[item.joint]
        percent = 100 * item.tau / joint.motor.nominal_torque
        counts = item.q * joint.drive.ratio * COUNTS / (2 * np.pi)
        rows = np.column_stack([1000 * item.time, item.w / RPM, percent, counts])
        paths[item.joint] = folder / f"{item.joint}.csv"
        names = ";Velocity actual value averaged;Torque actual value averaged;Position actual value\nms;rpm;%;inc"
        np.savetxt(
            paths[item.joint],
            rows,
            fmt=("%.6f", "%.0f", "%.1f", "%.0f"),
            delimiter=";",
            header=names,
            comments="",
        )
    return paths


def clipped(
    it: Executions, run: Run, joint: str, moving: np.ndarray, rng: np.random.Generator
) -> None:
    """Limit the torque, and reduce the speed while the limit acts."""
    cut = rng.uniform(0.5, 0.8) * np.abs(run.tau[joint]).max()
    sag = np.abs(run.tau[joint]) > cut
    run.w[joint][sag] *= 1 - rng.uniform(0.1, 0.3)
    run.tau[joint] = np.clip(run.tau[joint], -cut, cut)
    it.follow(run, joint)


def out_of_step(
    it: Executions, run: Run, joint: str, moving: np.ndarray, rng: np.random.Generator
) -> None:
    late = round(rng.uniform(0.012, 0.2) / it.step)
    for channel in (run.w, run.tau, run.q):
        channel[joint] = np.concatenate([np.full(late, channel[joint][0]), channel[joint][:-late]])


def torque_high(
    it: Executions, run: Run, joint: str, moving: np.ndarray, rng: np.random.Generator
) -> None:
    run.tau[joint] *= rng.uniform(1.4, 1.8)


def torque_low(
    it: Executions, run: Run, joint: str, moving: np.ndarray, rng: np.random.Generator
) -> None:
    run.tau[joint] *= rng.uniform(0.3, 0.6)


def stall(
    it: Executions, run: Run, joint: str, moving: np.ndarray, rng: np.random.Generator
) -> None:
    """Block the motor from a random instant on.

    The motor gives its largest torque until the motion is over.
    """
    start = int(rng.choice(moving[: int(0.9 * len(moving))]))
    sign = np.sign(run.w[joint][start])
    end = int(np.flatnonzero(run.w[joint]).max())
    run.w[joint][start:] = 0.0
    run.tau[joint][start:end] = sign * it.joints[joint].motor.max_torque
    it.follow(run, joint)


def overspeed(
    it: Executions, run: Run, joint: str, moving: np.ndarray, rng: np.random.Generator
) -> None:
    """Exceed the velocity limit of a joint for 30 ms to 100 ms while it moves at its limit."""
    fast = np.flatnonzero(np.abs(run.w[joint]) > 0.995 * it.plans[joint].peak)
    start, length = int(rng.choice(fast[: len(fast) // 2])), round(rng.uniform(0.03, 0.1) / it.step)
    run.w[joint][start : start + length] *= 1 + rng.uniform(0.05, 0.15)
    it.follow(run, joint)


def torque_burst(
    it: Executions, run: Run, joint: str, moving: np.ndarray, rng: np.random.Generator
) -> None:
    start, length = int(rng.choice(moving)), round(rng.uniform(0.015, 0.06) / it.step)
    burst = rng.uniform(1.1, 1.4) * it.joints[joint].motor.max_torque
    run.tau[joint][start : start + length] = burst * np.sign(run.tau[joint][start])


def lost_increments(
    it: Executions, run: Run, joint: str, moving: np.ndarray, rng: np.random.Generator
) -> None:
    start = int(rng.choice(moving))
    run.q[joint][start:] += (
        rng.choice([-1, 1]) * rng.uniform(1.3, 4.0) * 10e-3 * it.joints[joint].velocity
    )


def slow(it: Executions, run: Run, joint: str, moving: np.ndarray, rng: np.random.Generator) -> Run:
    """Play the whole motion slower. The clock stays correct."""
    rate = 1 - rng.uniform(0.015, 0.04)
    run = it.run(lambda t: rate * t)
    for name in it.names:
        run.w[name] *= rate
    return run


def gap(it: Executions, run: Run, joint: str, moving: np.ndarray, rng: np.random.Generator) -> None:
    start, length = int(rng.choice(moving)), round(rng.uniform(0.03, 0.5) / it.step)
    keep = np.ones(len(run.time[joint]), dtype=bool)
    keep[start : start + length] = False
    run.keep(joint, keep)


def drift(
    it: Executions, run: Run, joint: str, moving: np.ndarray, rng: np.random.Generator
) -> None:
    rate = 1 + rng.choice([-1, 1]) * rng.uniform(0.003, 0.02)
    for name in it.names:
        run.time[name] = run.time[name] * rate


def missing(
    it: Executions, run: Run, joint: str, moving: np.ndarray, rng: np.random.Generator
) -> None:
    for name in it.names:
        run.keep(name, rng.random(len(run.time[name])) > rng.uniform(0.02, 0.1))


def truncated(
    it: Executions, run: Run, joint: str, moving: np.ndarray, rng: np.random.Generator
) -> None:
    end = LEAD + rng.uniform(0.6, 0.95) * it.duration
    for name in it.names:
        run.keep(name, run.time[name] < end)


FAULTS = {
    "clipped torque": (clipped, "not held", "saturation"),
    "out of step": (out_of_step, "not held", "out of step"),
    "torque high": (torque_high, "not held", "torque"),
    "torque low": (torque_low, "not held", "torque"),
    "stall": (stall, "not held", "stall"),
    "overspeed": (overspeed, "not held", "velocity"),
    "torque burst": (torque_burst, "not held", "motor torque"),
    "lost increments": (lost_increments, "not held", "tracking"),
    "played slower": (slow, "not held", "tracking"),
    "gap": (gap, "cannot tell", "gap"),
    "clock off": (drift, "cannot tell", "clock"),
    "missing samples": (missing, "held", "missing samples"),
    "truncated": (truncated, "cannot tell", "coverage"),
}
"""Function that changes a run, expected verdict, and expected finding or name of the limit."""


def kinds(found) -> set[str]:
    """Return the kinds of the findings and the names of the limits that are not held."""
    names = {item.kind for item in found.findings}
    for axis in found:
        names |= {item.kind for item in axis.findings} | {
            item.name for item in axis.limits if not item.held
        }
    return names


def changed(recordings: Recordings, k: int, **changes: float) -> Recordings:
    """Return recordings of which one has channels that are multiplied by factors."""
    scaled = {name: factor * getattr(recordings[k], name) for name, factor in changes.items()}
    return [*recordings[:k], replace(recordings[k], **scaled), *recordings[k + 1 :]]


def swapped(recordings: Recordings, k: int) -> Recordings:
    names = [recordings[k].joint, recordings[(k + 1) % 3].joint]
    names = dict(zip(names, names[::-1], strict=True))
    return [replace(item, joint=names.get(item.joint, item.joint)) for item in recordings]


def twice(recordings: Recordings, k: int) -> Recordings:
    return [
        replace(
            item,
            time=np.append(item.time, item.time + item.time[-1] + 2e-3),
            **{name: np.tile(getattr(item, name), 2) for name in ("w", "tau", "q")},
        )
        for item in recordings
    ]


def in_milliseconds(recordings: Recordings, k: int) -> Recordings:
    return [replace(item, time=1000 * item.time) for item in recordings]


def joint_and_begin(it: Executions, run: Run, rng: np.random.Generator) -> tuple[str, int]:
    """Return the name of a joint, and the index of a sample at which it moves fast."""
    joint = str(rng.choice(it.names))
    fast = np.flatnonzero(np.abs(run.w[joint]) > 0.3 * it.plans[joint].peak)
    return joint, int(rng.choice(fast[: len(fast) // 2]))


def alternating(count: int, period: int) -> np.ndarray:
    """Return a square wave (count,) of +1 and −1, with a period in samples."""
    return np.where(np.arange(count) % period < period // 2, 1.0, -1.0)


def runaway(it: Executions, run: Run, rng: np.random.Generator) -> None:
    """A motor runs away for 30 ms to 100 ms, during the motion or after it."""
    joint, start = joint_and_begin(it, run, rng)
    start = int(rng.choice([start, round((LEAD + it.duration + 0.1) / it.step)]))
    samples = slice(start, start + round(rng.uniform(0.03, 0.1) / it.step))
    run.w[joint][samples], run.tau[joint][samples] = 1500.0, 0.5
    it.follow(run, joint)


def spikes(it: Executions, run: Run, rng: np.random.Generator) -> None:
    """Some single samples show five times the largest torque."""
    joint, start = joint_and_begin(it, run, rng)
    run.tau[joint][start : start + 40 : 10] = 5 * it.joints[joint].motor.max_torque


def broken_burst(it: Executions, run: Run, rng: np.random.Generator) -> None:
    """The torque is too high for 43 samples, except in every tenth sample."""
    joint, start = joint_and_begin(it, run, rng)
    burst = np.array([k for k in range(start, start + 43) if k % 10])
    run.tau[joint][burst] = 6 * it.joints[joint].motor.max_torque


def vibrating_speed(it: Executions, run: Run, rng: np.random.Generator) -> None:
    """The speed vibrates around the plan and exceeds its limit, although its means are right."""
    joint, _ = joint_and_begin(it, run, rng)
    swing = alternating(len(run.w[joint]), int(rng.choice([2, 4, 8])))
    limit = it.joints[joint].velocity * it.plans[joint].ratio
    beyond = limit / it.plans[joint].peak - 1
    run.w[joint] *= 1 + (beyond + rng.choice([0.12, 0.3, 1.0, 5.0])) * swing
    it.follow(run, joint)


def vibrating_torque(it: Executions, run: Run, rng: np.random.Generator) -> None:
    joint, _ = joint_and_begin(it, run, rng)
    moves = np.abs(run.w[joint]) > 0.02 * it.plans[joint].peak
    swing = alternating(len(moves), int(rng.choice([2, 4, 8]))) * moves
    run.tau[joint] += it.joints[joint].motor.max_torque * rng.uniform(1.0, 3.0) * swing


def oscillating_torque(it: Executions, run: Run, rng: np.random.Generator) -> None:
    """The torque oscillates around the planned torque, and stays below its limit."""
    joint, _ = joint_and_begin(it, run, rng)
    swing = np.sign(np.sin(2 * np.pi * rng.uniform(3, 12) * run.time[joint]))
    run.tau[joint] *= 1 + rng.uniform(0.7, 1.0) * swing


def oscillating_speed(it: Executions, run: Run, rng: np.random.Generator) -> None:
    """The acceleration exceeds its limit several times, although position and speed keep theirs."""
    joint, _ = joint_and_begin(it, run, rng)
    t = run.time[joint] - LEAD
    inside = np.where((t > 0.1) & (t < it.duration - 0.1), np.sin(np.pi * t / it.duration) ** 2, 0)
    rate = 2 * np.pi * rng.uniform(10, 16)
    size = 3.5 * it.joints[joint].acceleration / rate**2
    offset = size * np.sin(rate * t) * inside
    run.q[joint] = run.q[joint] + offset
    run.w[joint] = run.w[joint] + np.gradient(offset, t) * it.plans[joint].ratio


def low_speed(it: Executions, run: Run, rng: np.random.Generator) -> None:
    """The speed is too low in the recording, although the position is right."""
    joint, _ = joint_and_begin(it, run, rng)
    run.w[joint] *= rng.uniform(0.7, 0.9)


def late_recorder(it: Executions, run: Run, rng: np.random.Generator) -> None:
    """The first 12 ms of a short motion, or the last 0.6 % of a long motion, are not recorded."""
    start, end = LEAD + 0.012, LEAD + 0.994 * it.duration
    for name in it.names:
        t = run.time[name]
        run.keep(name, t > start if it.duration < 10 else t < end)


def saturated_after_a_rest(it: Executions, run: Run, rng: np.random.Generator) -> None:
    """The torque is almost at its limit for 70 ms, in a recording with a long rest."""
    joint, start = joint_and_begin(it, run, rng)
    sign = np.sign(run.w[joint][start])
    run.tau[joint][start : start + round(0.07 / it.step)] = (
        0.999 * sign * it.joints[joint].motor.max_torque
    )
    add_rest(it, run, 7.0)


def add_rest(it: Executions, run: Run, duration: float) -> None:
    count = round(duration / it.step)
    for name in it.names:
        run.time[name] = it.step * np.arange(len(run.time[name]) + 2 * count)
        for channel in (run.w, run.tau):
            channel[name] = np.pad(channel[name], count)
        run.q[name] = np.pad(run.q[name], count, mode="edge")


HIDDEN: dict[str, Callable[[Executions, Run, np.random.Generator], None]] = {
    function.__name__: function
    for function in (
        runaway,
        spikes,
        broken_burst,
        vibrating_speed,
        vibrating_torque,
        oscillating_torque,
        oscillating_speed,
        low_speed,
        late_recorder,
        saturated_after_a_rest,
    )
}
"""These faults resemble spikes, noise or rest."""
