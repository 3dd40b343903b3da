"""Compare plans with recordings of faulty and healthy executions.

Every case draws a shipped plan, a speed from 5 to 100 %, a sampling rate from 5 Hz to 2 kHz, and a
kind of fault. The verdict is right if a fault is "not held" (or "cannot tell" for a recording that
does not suffice). With samples that are more than 10 ms apart, a fault may also be "cannot tell",
but never "held". The cause is right if one of the findings or limits names it.
"""

from __future__ import annotations

import functools
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.comparison.compare import compare
from ssm_planner.comparison.measured import AxisRecording, read_axis_recording
from ssm_planner.comparison.predicted import predict_axes
from ssm_planner.dynamics import with_payload
from ssm_planner.errors import RecordingError
from ssm_planner.plans import load_plan
from tests.support import executions as support
from tests.support.executions import COUNTS, LEAD, Executions, Run, decimated, kinds, taken
from tests.support.paths import RESULTS

from .rows import Count, Row

PLANS = ("tilt_insert", "eye_approach")
SPEEDS = (1.0, 0.5, 0.2, 0.1, 0.05)
RATES = (2000, 1000, 500, 200, 100, 50, 20, 10, 5)
BASE = 200
"""Sampling rate of an execution in Hz, of which every k-th sample is recorded."""
SLOWEST_WITH_VERDICT = 100
"""Sampling rate in Hz from which on a recording suffices for a verdict."""
Recordings = list[AxisRecording]


@dataclass
class Case:
    """A run that a fault changes, with the joint, the samples in motion and the rate in Hz."""

    it: Executions
    run: Run
    joint: str
    moving: np.ndarray
    rng: np.random.Generator
    rate: int

    def start(self, last: float = 0.8) -> int:
        """Return a random sample in the first part of the motion of the joint."""
        return int(self.rng.choice(self.moving[: max(1, int(last * len(self.moving)))]))

    def samples(self, seconds: float, last: float = 0.8) -> slice:
        start = self.start(last)
        return slice(start, start + max(1, round(seconds / self.it.step)))

    def describe(self) -> str:
        speed = self.it.plan.motion.duration / self.it.duration
        return f"{self.rate} Hz, speed {speed:.3g}, {self.joint}, {self.it.plan.problem.name}"

    @property
    def motor(self) -> Any:
        return self.it.joints[self.joint].motor


@dataclass(frozen=True)
class Kind:
    """A kind of fault: what it changes, the expected verdict, and the causes that are right."""

    change: Callable[[Case], None] | None
    verdict: str
    causes: tuple[str, ...]
    record: Callable[[Recordings, Case], Recordings] | None = None
    at_full_speed: bool = False
    """True for a fault that exceeds a limit only at the planned speed."""
    slowest: int = SLOWEST_WITH_VERDICT
    """Sampling rate from which on verdict and cause are determined, Hz."""
    needs_position: bool = False
    """True for a fault that is not made or shown without positions. Others are also tested so."""
    in_samples: bool = False
    """True for a fault of single samples, which a lower sampling rate would omit."""


def stall(seconds: tuple[float, float]) -> Callable[[Case], None]:
    """Stop the motor with its largest torque. Afterwards, it catches up within 0.3 s."""

    def change(case: Case) -> None:
        run, joint, it = case.run, case.joint, case.it
        stands = case.samples(case.rng.uniform(*seconds), 0.6)
        lost = float(np.sum(run.w[joint][stands]))
        sign = np.sign(run.w[joint][stands.start])
        run.w[joint][stands] = 0.0
        run.tau[joint][stands] = sign * case.motor.max_torque
        later = slice(stands.stop, stands.stop + round(0.3 / it.step))
        run.w[joint][later] += lost / len(run.w[joint][later])
        it.follow(run, joint)

    return change


def torque_overrun(seconds: float) -> Callable[[Case], None]:
    def change(case: Case) -> None:
        burst = case.rng.uniform(1.15, 1.6) * case.motor.max_torque
        samples = case.samples(seconds)
        case.run.tau[case.joint][samples] = burst * np.sign(case.run.w[case.joint][samples.start])

    return change


def too_fast(seconds: float) -> Callable[[Case], None]:
    def change(case: Case) -> None:
        run, joint, it = case.run, case.joint, case.it
        limit = it.joints[joint].velocity * it.plans[joint].ratio
        samples = case.samples(seconds)
        speed = case.rng.uniform(1.1, 1.5) * limit * np.sign(run.w[joint][samples.start])
        run.w[joint][samples] = speed
        it.follow(run, joint)

    return change


def scaled(name: str, low: float, high: float) -> Callable[[Case], None]:
    def change(case: Case) -> None:
        getattr(case.run, name)[case.joint] *= case.rng.uniform(low, high)

    return change


def homing(joint: str) -> Callable[[Case], None]:
    def change(case: Case) -> None:
        size = case.rng.uniform(1.5, 8.0) * 10e-3 * case.it.joints[joint].velocity
        case.run.q[joint] = case.run.q[joint] + case.rng.choice([-1, 1]) * size

    return change


def current_offset(case: Case) -> None:
    case.run.tau[case.joint] += 0.6 * np.abs(case.run.tau[case.joint]).max()


def encoder_scale(case: Case) -> None:
    factor = case.rng.choice([1 / 1.1, 1 / 1.06, 1.06, 1.1])
    start = case.run.q[case.joint][0]
    case.run.w[case.joint] *= factor
    case.run.q[case.joint] = start + factor * (case.run.q[case.joint] - start)


def payload(case: Case) -> None:
    """Carry the smallest payload that changes the torque of a joint by half in half of the time."""
    it = case.it
    for mass in np.geomspace(0.05, 20.0, 12):
        loaded = with_payload(it.plan.robot, float(mass))
        motion = it.plan.motion.slower(it.plan.motion.duration / it.duration)
        plans = predict_axes(motion, loaded, it.names)
        shares = []
        for plan, name in zip(plans, it.names, strict=True):
            planned = it.plans[name]
            moves = np.abs(planned.speed) > 0.02 * planned.peak
            change = np.abs(plan.torque - planned.torque) > 0.5 * np.abs(planned.torque)
            shares.append(float(np.mean(change[moves])))
        if max(shares) > 0.5:
            break
    for plan, name in zip(plans, it.names, strict=True):
        t = case.run.time[name] - LEAD
        case.run.tau[name] = np.interp(t, plan.time, plan.torque, left=0.0, right=0.0)


def first_phase_only(case: Case) -> None:
    """The motion stops for good after a part of it."""
    share = case.rng.uniform(0.3, 0.7)
    for name in case.it.names:
        stops = case.run.time[name] > LEAD + share * case.it.duration
        ramp = np.clip(1 - (case.run.time[name] - LEAD - share * case.it.duration) / 0.05, 0.0, 1.0)
        case.run.w[name] = np.where(stops, ramp * case.run.w[name], case.run.w[name])
        case.run.tau[name] = np.where(ramp > 0, case.run.tau[name], 0.0)
        case.it.follow(case.run, name)


def started_inside(case: Case) -> None:
    """The robot starts at rest from a point in the middle of the motion."""
    skipped = case.rng.uniform(0.3, 0.5) * case.it.duration
    later = case.it.run(lambda t: np.where(t < 0, skipped, t + skipped))
    for name in case.it.names:
        rests = later.time[name] < LEAD
        for channel, values in (("w", later.w), ("tau", later.tau), ("q", later.q)):
            changed = values[name].copy()
            if channel != "q":
                changed[rests] = 0.0
            getattr(case.run, channel)[name] = changed


def phases_swapped(case: Case) -> None:
    """The second half of the motion comes first."""
    it = case.it
    spans = it.plan.motion.phases
    share = spans[0].end / it.plan.motion.duration if len(spans) > 1 else 0.5
    cut = share * it.duration
    rest = it.duration - cut
    other = it.run(
        lambda t: np.where((t < 0) | (t > it.duration), t, np.where(t < rest, t + cut, t - rest))
    )
    case.run.w, case.run.tau, case.run.q = other.w, other.tau, case.run.q
    for name in it.names:
        it.follow(case.run, name)


def stuck(name: str) -> Callable[[Case], None]:
    """One channel keeps its value until the end of the motion, because its sensor is stuck."""

    def change(case: Case) -> None:
        values = getattr(case.run, name)[case.joint]
        start = case.start(0.6)
        values[start:] = values[start]

    return change


def no_motion(case: Case) -> None:
    for channel in (case.run.w, case.run.tau):
        channel[case.joint] = 0 * channel[case.joint]
    case.it.follow(case.run, case.joint)


def one_late(case: Case) -> None:
    support.out_of_step(case.it, case.run, case.joint, case.moving, case.rng)


def hidden(name: str) -> Callable[[Case], None]:
    return lambda case: support.HIDDEN[name](case.it, case.run, case.rng)


def plain(name: str) -> Callable[[Case], None]:
    def change(case: Case) -> None:
        run = support.FAULTS[name][0](case.it, case.run, case.joint, case.moving, case.rng)
        if run is not None:
            vars(case.run).update(vars(run))

    return change


def replayed(factor: Callable[[np.random.Generator], float]) -> Callable[[Case], None]:
    """Play the whole motion at another speed."""

    def change(case: Case) -> None:
        rate = factor(case.rng)
        it = Executions(
            case.it.plan, case.it.step, rate * case.it.plan.motion.duration / case.it.duration
        )
        vars(case.run).update(vars(it.run()))

    return change


def joints(first: int, second: int) -> Callable[[Recordings, Case], Recordings]:
    def record(recordings: Recordings, case: Case) -> Recordings:
        names = [item.joint for item in recordings]
        names[first], names[second] = names[second], names[first]
        return [replace(item, joint=name) for item, name in zip(recordings, names, strict=True)]

    return record


def factors(k: int | None = None, **changes: float) -> Callable[[Recordings, Case], Recordings]:
    def record(recordings: Recordings, case: Case) -> Recordings:
        index = case.it.names.index(case.joint) if k is None else k
        return support.changed(recordings, index, **changes)

    return record


def in_file(
    spoil: Callable[[list[str], Case], list[str]],
) -> Callable[[Recordings, Case], Recordings]:
    """Write the recordings to files, change the lines of one file, and read the files."""

    def record(recordings: Recordings, case: Case) -> Recordings:
        with tempfile.TemporaryDirectory() as folder:
            paths = support.write(case.it, recordings, Path(folder))
            path = paths[case.joint]
            head, *lines = path.read_text(encoding="utf-8").splitlines()
            unit, *rows = lines
            path.write_text("\n".join([head, unit, *spoil(rows, case)]) + "\n", encoding="utf-8")
            robot = case.it.plan.robot
            return [read_axis_recording(paths[name], robot, name, COUNTS) for name in case.it.names]

    return record


def nan_lines(rows: list[str], case: Case) -> list[str]:
    """Replace the values of 80 ms, but of 4 % of the lines at most, by NaN."""
    start = case.start() * len(rows) // len(case.run.time[case.joint])
    count = max(1, min(round(0.08 * case.rate), len(rows) // 25))
    blank = [row.split(";")[0] + ";nan;nan;nan" for row in rows[start : start + count]]
    return rows[:start] + blank + rows[start + count :]


def doubled_lines(rows: list[str], case: Case) -> list[str]:
    chosen = case.rng.random(len(rows)) < 0.05
    return [row for row, twice in zip(rows, chosen, strict=True) for row in [row] * (1 + twice)]


def jittered(recordings: Recordings, case: Case) -> Recordings:
    """Sample at irregular instants. All samples show the motion at their own times."""
    n = len(recordings[0].time)
    step = 1 / case.rate
    shift = case.rng.uniform(-0.2, 0.2, n) * min(step, 2e-3)
    result = []
    for item in recordings:
        time = item.time + shift
        values = {
            name: np.interp(time, item.time, getattr(item, name)) for name in ("w", "tau", "q")
        }
        result.append(replace(item, time=time, **values))
    return result


def without_one(recordings: Recordings, case: Case) -> Recordings:
    return [item for item in recordings if item.joint != case.joint]


def thinned(recordings: Recordings, case: Case) -> Recordings:
    return decimated(recordings, max(1, case.rate // 25))


def noisy_torque(case: Case) -> None:
    noise = 3.0 * np.abs(case.it.plans[case.joint].torque).max()
    case.run.tau[case.joint] += noise * case.rng.normal(size=len(case.run.tau[case.joint]))


def inside(recordings: Recordings, case: Case, low: float, high: float) -> Recordings:
    first, last = (LEAD + share * case.it.duration for share in (low, high))
    chosen = (recordings[0].time > first) & (recordings[0].time < last)
    return [taken(item, chosen) for item in recordings]


def part(low: float, high: float) -> Callable[[Recordings, Case], Recordings]:
    return lambda recordings, case: inside(recordings, case, low, high)


REFUSED = "refused"
"""Cause of a recording that is refused with a message."""
NOT, UNKNOWN, HELD = "not held", "cannot tell", "held"
KINDS: dict[str, Kind] = {
    "roll and tilt swapped": Kind(None, NOT, ("swapped",), joints(0, 1)),
    "roll and insertion swapped": Kind(None, NOT, ("swapped",), joints(0, 2)),
    "tilt and insertion swapped": Kind(None, NOT, ("swapped",), joints(1, 2)),
    "roll reversed": Kind(
        None, NOT, ("reversed",), factors(0, w=-1, tau=-1, q=-1), needs_position=True
    ),
    "tilt reversed": Kind(
        None, NOT, ("reversed",), factors(1, w=-1, tau=-1, q=-1), needs_position=True
    ),
    "insertion reversed": Kind(
        None, NOT, ("reversed",), factors(2, w=-1, tau=-1, q=-1), needs_position=True
    ),
    "homing of roll": Kind(homing("roll"), NOT, ("homing",), needs_position=True),
    "homing of tilt": Kind(homing("tilt"), NOT, ("homing",), needs_position=True),
    "homing of insertion": Kind(homing("insertion"), NOT, ("homing",), needs_position=True),
    "speed in rpm": Kind(None, NOT, ("rpm and rad/s",), factors(w=60 / (2 * np.pi))),
    "speed in rad/s": Kind(None, NOT, ("rpm and rad/s",), factors(w=2 * np.pi / 60)),
    "torque in mN·m": Kind(None, NOT, ("thousandths",), factors(tau=1000)),
    "torque in percent": Kind(None, NOT, ("percent",), factors(tau=0.01)),
    "position in degrees": Kind(
        None, NOT, ("degrees and radians",), factors(q=180 / np.pi), needs_position=True
    ),
    "time in ms": Kind(None, NOT, ("thousandths",), lambda r, case: support.in_milliseconds(r, 0)),
    "counts for increments": Kind(
        None, NOT, ("encoder counts",), factors(w=4, q=4), needs_position=True
    ),
    "encoder scale wrong": Kind(encoder_scale, NOT, ("its travel is",)),
    "sign of the current": Kind(None, NOT, ("its sign is wrong",), factors(tau=-1)),
    "scale of the current": Kind(scaled("tau", 1.8, 2.5), NOT, ("torque",)),
    "current halved": Kind(scaled("tau", 0.4, 0.6), NOT, ("torque",)),
    "offset of the current": Kind(current_offset, NOT, ("torque", "motor torque")),
    "stall of 0.03 s to 0.08 s": Kind(
        stall((0.03, 0.08)), NOT, ("stall", "motor torque", "saturation")
    ),
    "stall of 0.15 s to 0.3 s": Kind(stall((0.15, 0.3)), NOT, ("stall",)),
    "stall of 0.3 s to 0.6 s": Kind(stall((0.3, 0.6)), NOT, ("stall",)),
    "stall to the end": Kind(plain("stall"), NOT, ("stall",)),
    "motor never moves": Kind(no_motion, NOT, ("stall",)),
    "torque overrun of 12 ms": Kind(torque_overrun(0.012), NOT, ("motor torque",)),
    "torque overrun of 30 ms": Kind(torque_overrun(0.03), NOT, ("motor torque",)),
    "torque overrun of 100 ms": Kind(torque_overrun(0.1), NOT, ("motor torque",)),
    "torque overrun of 0.4 s": Kind(torque_overrun(0.4), NOT, ("motor torque",)),
    "torque spikes": Kind(hidden("spikes"), NOT, ("motor torque",), in_samples=True),
    "broken torque burst": Kind(hidden("broken_burst"), NOT, ("motor torque",), in_samples=True),
    "vibrating torque": Kind(
        hidden("vibrating_torque"), "any", ("motor torque", "torque"), in_samples=True
    ),
    "oscillating torque": Kind(hidden("oscillating_torque"), NOT, ("torque", "motor torque")),
    "saturated for 70 ms": Kind(hidden("saturated_after_a_rest"), NOT, ("saturation",)),
    "clipped torque": Kind(plain("clipped torque"), NOT, ("saturation",)),
    "overspeed of 30 ms": Kind(too_fast(0.03), NOT, ("velocity", "motor speed")),
    "overspeed of 100 ms": Kind(too_fast(0.1), NOT, ("velocity", "motor speed")),
    "vibrating speed": Kind(
        hidden("vibrating_speed"),
        "any",
        ("velocity", "motor speed", "other motion"),
        in_samples=True,
    ),
    "oscillating speed": Kind(hidden("oscillating_speed"), NOT, ("acceleration",)),
    "runaway": Kind(hidden("runaway"), NOT, ("motor torque", "velocity", "motor speed")),
    "lost increments": Kind(plain("lost increments"), NOT, ("tracking",), needs_position=True),
    "speed channel too low": Kind(
        hidden("low_speed"), "any", ("tracking", "contradiction"), needs_position=True
    ),
    "out of step": Kind(one_late, NOT, ("out of step",)),
    "friction +40 to 80 %": Kind(plain("torque high"), NOT, ("torque",)),
    "friction −40 to 70 %": Kind(plain("torque low"), NOT, ("torque",)),
    "wrong payload": Kind(payload, NOT, ("torque", "motor torque")),
    "played 1.5 to 4 % slower": Kind(plain("played slower"), NOT, ("speed",), at_full_speed=True),
    "played at 30 to 90 %": Kind(replayed(lambda rng: rng.uniform(0.3, 0.9)), NOT, ("speed",)),
    "played at 107 to 120 %": Kind(replayed(lambda rng: rng.uniform(1.07, 1.2)), NOT, ("speed",)),
    "stopped in the middle": Kind(first_phase_only, NOT, ("stall",)),
    "started in the middle": Kind(started_inside, NOT, ("tracking", "stall", "other motion")),
    "order of the phases": Kind(
        phases_swapped, NOT, ("tracking", "other motion", "stall", "out of step")
    ),
    "two motions": Kind(
        None, NOT, ("several motions",), lambda r, case: support.twice(r, 0), needs_position=True
    ),
    "stuck speed sensor": Kind(
        stuck("w"), "any", ("tracking", "contradiction"), needs_position=True
    ),
    "stuck position sensor": Kind(
        stuck("q"), "any", ("tracking", "contradiction"), needs_position=True
    ),
    "first half missing": Kind(None, UNKNOWN, ("coverage",), part(0.5, 9.0)),
    "last half missing": Kind(None, UNKNOWN, ("coverage",), part(-9.0, 0.5)),
    "middle part only": Kind(None, UNKNOWN, ("coverage",), part(0.2, 0.7)),
    "recorder starts late": Kind(hidden("late_recorder"), UNKNOWN, ("coverage",), slowest=500),
    "truncated": Kind(plain("truncated"), UNKNOWN, ("coverage",)),
    "gap": Kind(plain("gap"), UNKNOWN, ("gap",)),
    "gap of NaN": Kind(
        None, UNKNOWN, ("gap", "unread data"), in_file(nan_lines), needs_position=True
    ),
    "clock off": Kind(plain("clock off"), UNKNOWN, ("clock",)),
    "noise hides the torque": Kind(noisy_torque, "any", ("torque", "motor torque")),
    "axis without a recording": Kind(None, UNKNOWN, ("missing recording",), without_one),
    "decimated to 25 Hz": Kind(None, UNKNOWN, ("sampling",), thinned),
    "missing samples": Kind(plain("missing samples"), HELD, ("missing samples",), slowest=500),
    "repeated times": Kind(None, UNKNOWN, (REFUSED,), in_file(doubled_lines), needs_position=True),
    "jitter of the times": Kind(None, HELD, (), jittered, slowest=200, needs_position=True),
}
"""Kinds of faults. The verdict "any" stands for both "not held" and "cannot tell"."""


@functools.cache
def _executions(plan: str, speed: float, rate: int) -> Executions:
    return Executions(_plan(plan), 1 / rate, speed)


@functools.cache
def _plan(name: str) -> Any:
    return load_plan(RESULTS / name / "plan.json")


def faulty(kind: Kind, rng: np.random.Generator) -> tuple[Case, str, set[str]]:
    """Return a random case of a kind, its verdict, and the names and texts of its findings."""
    speed = 1.0 if kind.at_full_speed else float(rng.choice(SPEEDS))
    rate = int(rng.choice(RATES))
    is_fine = kind.in_samples and rate >= SLOWEST_WITH_VERDICT
    it = _executions(str(rng.choice(PLANS)), speed, rate if is_fine else max(rate, BASE))
    run = it.run()
    joint = str(rng.choice(it.names))
    moving = np.flatnonzero(np.abs(run.w[joint]) > 0.3 * it.plans[joint].peak)
    case = Case(it, run, joint, moving, rng, rate)
    if kind.change is not None:
        kind.change(case)
    recordings = it.measured(run, rng, rng.uniform(0.5, 3.0))
    factor = round(1 / (it.step * rate))
    recordings = decimated(recordings, factor, int(rng.integers(factor)))
    if not kind.needs_position and rng.random() < 0.3:
        recordings = [replace(item, q=None) for item in recordings]
    plan = it.plan
    try:
        recordings = kind.record(recordings, case) if kind.record else recordings
        result = compare(plan.motion, plan.robot, plan.certificate, recordings, speed=speed)
    except RecordingError:
        return case, UNKNOWN, {REFUSED}
    texts = [item.text for part in (result, *result) for item in part.findings]
    return case, result.verdict, {*kinds(result), *texts}


def judge(kind: Kind, rate: int, found: str, causes: set[str]) -> tuple[bool, str]:
    """Return whether a verdict is right, and "cause right", "cause wrong" or "no cause"."""
    allowed = {NOT, UNKNOWN} if kind.verdict == "any" else {kind.verdict}
    is_determined = rate >= max(SLOWEST_WITH_VERDICT, kind.slowest)
    if not is_determined:
        allowed |= {UNKNOWN} if kind.verdict == HELD else {NOT, UNKNOWN}
    if not kind.causes or not is_determined:
        return found in allowed, "no cause"
    is_named = any(cause in text for cause in kind.causes for text in causes)
    return found in allowed, "cause right" if is_named else "cause wrong"


def healthy(rng: np.random.Generator) -> tuple[str, str, bool, str]:
    """Return the name of the kind, the verdict of a random healthy run, whether it is right, and its findings."""
    speed, rate = float(rng.choice(SPEEDS)), int(rng.choice(RATES))
    it = _executions(str(rng.choice(PLANS)), speed, max(rate, BASE))
    factor = round(1 / (it.step * rate))
    recordings = decimated(
        it.healthy(int(rng.integers(1 << 30))), factor, int(rng.integers(factor))
    )
    if rng.random() < 0.5:
        recordings = [replace(item, q=None) for item in recordings]
    result = compare(it.plan.motion, it.plan.robot, it.plan.certificate, recordings, speed=speed)
    expected = HELD if rate >= SLOWEST_WITH_VERDICT else UNKNOWN
    text = f"{rate} Hz, speed {speed:g}: {sorted(kinds(result))}"
    return ("healthy", result.verdict, result.verdict == expected, text)


def run(count: int, seed: int) -> list[Row]:
    """Run `count` cases: one in four healthy, and the others of all kinds in turn.

    A row counts the cases of one kind with one verdict. Its name consists of the kind, the verdict,
    and of the words "cause right", "cause wrong" or "no cause".
    """
    rows: dict[str, Count] = {}
    names = list(KINDS)
    for k in range(count):
        rng = np.random.default_rng([36, seed, k])
        if k % 4 == 3:
            name, found, is_right, text = healthy(rng)
            cause = "no cause"
        else:
            name = names[(seed * (count - count // 4) + k - k // 4) % len(names)]
            case, found, causes = faulty(KINDS[name], rng)
            verdict_right, cause = judge(KINDS[name], case.rate, found, causes)
            is_right = verdict_right and cause != "cause wrong"
            text = f"{case.describe()}: {sorted(causes)}"
            if not verdict_right:
                name += WRONG
        key = f"{name} | {found} | {cause}"
        text = f"{name}, {found}, {cause}, case {k} of seed {seed}, {text}"
        rows.setdefault(key, Count(key)).add(None if is_right else text)
    return [count.row for count in rows.values()]


WRONG = " (wrong verdict)"
"""Text that marks rows with a wrong verdict."""


def section(rows: list[Row], seed: int) -> str:
    """Return the confusion table as Markdown."""
    table: dict[str, Counter[str]] = {}
    for row in rows:
        name, found, cause = row.kind.split(" | ")
        counts = table.setdefault(name.removesuffix(WRONG), Counter())
        counts["cases"] += row.cases
        counts[found] += row.cases
        counts[cause] += row.cases
        counts["wrong"] += row.cases * (
            name.endswith(WRONG) or (name == "healthy" and row.failures > 0)
        )
    total = sum((counts for name, counts in table.items() if name != "healthy"), Counter())
    columns = ("cases", NOT, UNKNOWN, HELD, "wrong", "cause right", "cause wrong")
    lines = [
        f"Seed {seed}. A fault is sampled at {RATES[-1]} Hz to {RATES[0]} Hz at 5 % to 100 % of the speed. "
        f'Below {SLOWEST_WITH_VERDICT} Hz, every verdict except "held" is right, and no cause is demanded.',
        "",
        "| fault | expected | cases | not held | cannot tell | held | wrong verdict | cause right | cause wrong |",
        "|---|---|" + "---:|" * len(columns),
    ]
    order = sorted(table, key=["healthy", *KINDS].index)
    for name in order:
        expected = KINDS[name].verdict if name in KINDS else HELD
        lines.append(
            f"| {name} | {expected} | " + " | ".join(str(table[name][c]) for c in columns) + " |"
        )
    lines.append("| all faults | | " + " | ".join(str(total[c]) for c in columns) + " |")
    lines.append("")
    lines += [f"* `{text}`" for row in rows for text in row.examples]
    return "\n".join(lines)
