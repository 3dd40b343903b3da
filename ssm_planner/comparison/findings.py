"""What speaks against "held": sampling, tracking, stalls, saturation, torque beside its band, and limits exceeded."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from ssm_planner.comparison.clock import Alignment, Clock, correlation
from ssm_planner.comparison.measured import Measured
from ssm_planner.comparison.noise import CERTAIN, longest, noise_of, smoothed, windows, worst_excess
from ssm_planner.comparison.predicted import PLAN_RATE, Predicted
from ssm_planner.formats.points import Flags
from ssm_planner.problem.limits import (
    JointLimit,
    JointPosition,
    JointVelocity,
    MotorSpeed,
    MotorTorque,
)
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import Certificate

STEP = 5e-3
"""Time by which axes may be out of step, s."""
DRIFT = 1e-3
"""Share by which the recordings' clock may be off; a crystal is off by less than a tenth of it."""
GAP = 20e-3
"""Longest time without a sample about which nothing is asked, s."""
MISSING = 0.005
"""Share of missing samples that is said."""
TOO_MANY = 0.2
"""Share of missing samples beyond which nothing is known."""
COVERED = 0.99
OUTSIDE = 0.05
"""Share of the moving time in which torque may lie outside its band."""
UNRESOLVED = 0.1
"""Share of a limit beyond which noise leaves nothing to say of it."""
STANDS = 0.02
"""Share of the largest planned speed below which a motor stands, or by which a saturated one sags."""
SHORT = 20e-3
"""s: shorter is no saturation."""
STALL = 0.1
"""s: shorter is no stall."""
ALIKE = 0.8
"""Correlation of the speeds below which a recording is not taken for one of this motion."""
NEAR = 15e-3
"""s: torque may be any that is predicted within this time, as it jumps at starts and stops."""

Verdict = Literal["held", "not held", "cannot tell"]


def worst_of(verdicts: Iterable[Verdict]) -> Verdict:
    """Not held before cannot tell before held."""
    order: tuple[Verdict, ...] = ("held", "cannot tell", "not held")
    return max(verdicts, key=order.index, default="held")


@dataclass(frozen=True)
class Finding:
    """Something that speaks against "held", or that is only to be known."""

    kind: str
    """tracking, out of step, stall, saturation, torque, gap, missing samples, coverage or clock."""
    verdict: Verdict
    text: str
    value: float
    allowed: float
    """Of the same unit, noise included: a fault larger than this is found."""


@dataclass(frozen=True)
class Kept:
    """One limit in reality beside the plan's margin."""

    name: str
    limit: float
    planned_margin: float | None
    measured: float
    """The worst value, a mean over `window`."""
    margin: float
    held: bool
    """Not exceeded by more than the noise, which is less than a tenth of the limit."""
    unit: str
    noise: float
    """What the recording's noise may add to the measured value."""
    window: float
    """s; 0: a single sample."""
    verdict: Verdict


@dataclass(frozen=True, eq=False)
class AlignedAxis:
    """One recording and its plan on one clock: planned times and planned values of every sample, (n,) each."""

    plan: Predicted
    measured: Measured
    clock: Clock
    alignment: Alignment
    t: Array
    """Planned time, s."""
    speed: Array
    """Planned."""
    q: Array
    """Measured joint position, or the integral of the speed."""
    integrated: bool
    step: float
    """Median distance of two samples, s."""

    @property
    def name(self) -> str:
        return self.plan.joint.name

    @property
    def moving(self) -> Flags:
        """(n,): the plan moves the joint; all of it where it does not move it at all."""
        peak = self.plan.peak
        moving: Flags = np.abs(self.speed) > STANDS * peak
        return (
            moving
            if moving.sum() > 8 * windows(self.step)[-1][0]
            else np.ones(len(self.t), dtype=bool)
        )

    @property
    def sigma(self) -> float:
        """Noise of a single sample of the speed, rad/s."""
        return noise_of(
            (self.measured.w - self.speed)[self.moving], 1, self.measured.speed_resolution
        )


def place(plan: Predicted, measured: Measured, clock: Clock, alignment: Alignment) -> AlignedAxis:
    """A recording on the common clock. Without a position channel the speed is integrated from the planned position at the
    start, and again after every gap."""
    t = clock.planned(measured.time)
    step = float(np.median(np.diff(measured.time)))
    q = measured.q
    if q is None:
        q = np.empty(len(t))
        begin = [0, *(np.flatnonzero(np.diff(t) > max(GAP, 3 * step)) + 1), len(t)]
        for first, end in pairwise(begin):
            w, part = measured.w[first:end], t[first:end]
            way = (
                np.concatenate([[0.0], np.cumsum(np.diff(part) * (w[1:] + w[:-1]) / 2)])
                / plan.ratio
            )
            # anchored at the motion's start if the part holds it
            anchor = int(np.clip(np.searchsorted(part, 0.0), 0, len(part) - 1))
            q[first:end] = way - way[anchor] + np.interp(part[anchor], plan.time, plan.position)
    speed = np.interp(t, plan.time, plan.speed, left=0.0, right=0.0)
    return AlignedAxis(
        plan,
        measured,
        clock,
        alignment,
        t=t,
        speed=speed,
        q=q,
        integrated=measured.q is None,
        step=step,
    )


def findings_of(axis: AlignedAxis, lag: float) -> tuple[Finding, ...]:
    """Everything that is to be said of one axis but for its limits."""
    stall = stalled(axis)
    found = [
        *sampling(axis),
        *tracking(axis, lag),
        *([stall] if stall is not None else saturated(axis)),
        *torque(axis),
    ]
    return tuple(found)


def sampling(axis: AlignedAxis) -> Iterator[Finding]:
    """Gaps, missing samples and what of the motion the recording does not hold."""
    t, step, duration = axis.t, axis.step, axis.plan.duration
    covered = (min(float(t[-1]), duration) - max(float(t[0]), 0.0)) / duration
    if covered < COVERED:
        text = f"the recording holds {100 * covered:.0f} % of the motion"
        yield Finding("coverage", "cannot tell", text, covered, COVERED)
    during = np.flatnonzero((t[1:] > 0) & (t[:-1] < duration))
    steps = np.diff(axis.measured.time)[during]
    if not len(steps):
        return
    gap, allowed = float(steps.max()), max(GAP, 3 * step)
    if gap > allowed:
        at = float(t[during[int(np.argmax(steps))]])
        text = f"no samples for {gap:.3g} s, {at:.3g} s after the motion's start"
        yield Finding("gap", "cannot tell", text, gap, allowed)
    missing = float(np.sum(np.rint(steps / step) - 1))
    share = missing / (missing + len(steps))
    if share > MISSING:
        verdict: Verdict = "cannot tell" if share > TOO_MANY else "held"
        yield Finding(
            "missing samples",
            verdict,
            f"{100 * share:.2g} % of the samples are missing",
            share,
            TOO_MANY,
        )


def tracking(axis: AlignedAxis, lag: float) -> Iterator[Finding]:
    """Position beside the planned one, averaged over the shortest window."""
    plan, joint = axis.plan, axis.plan.joint
    error = axis.q - np.interp(axis.t, plan.time, plan.position)
    n = windows(axis.step)[1][0]
    if len(error) < n:
        return
    noise = position_noise(axis)
    limit = lag * joint.velocity
    k = int(np.argmax(np.abs(smoothed(error, n))))
    worst = float(np.abs(smoothed(error, n)[k]))
    unit, scale = ("mm", 1e3) if joint.kind == "prismatic" else ("mrad", 1e3)
    allowed = limit + noise
    if worst > allowed:
        text = (
            f"{scale * worst:.3g} {unit} away from the plan {float(axis.t[k]):.3g} s after the start "
            f"(allowed: {scale * limit:.3g} {unit}, noise {scale * noise:.2g} {unit})"
        )
        yield Finding("tracking", "not held", text, worst, allowed)
    elif noise > limit:
        text = f"noise of {scale * noise:.3g} {unit} hides a tracking error of {scale * limit:.3g} {unit}"
        yield Finding("tracking", "cannot tell", text, noise, limit)


def position_noise(axis: AlignedAxis) -> float:
    """What noise may add to a measured position, rad or m: of its channel, or of the speed integrated over the motion."""
    if not axis.integrated:
        error = axis.q - np.interp(axis.t, axis.plan.time, axis.plan.position)
        resolution = axis.measured.position_resolution
        return max(CERTAIN * noise_of(error[axis.moving], 1, resolution), 2 * resolution)
    return CERTAIN * axis.sigma * float(np.sqrt(axis.step * axis.plan.duration)) / axis.plan.ratio


def agrees(axis: AlignedAxis) -> bool:
    """The speed is the planned one on the common clock, even where it tells of none: the motor mostly stands."""
    inside = (axis.t >= 0) & (axis.t <= axis.plan.duration)
    if axis.step * inside.sum() < 0.1 * axis.plan.duration:
        return False
    apart = float(np.sqrt(np.mean((axis.measured.w - axis.speed) ** 2)))
    return apart <= STANDS * axis.plan.peak + CERTAIN * axis.sigma


def stalled(axis: AlignedAxis) -> Finding | None:
    """The motor stands though the plan moves it on; None where it does not, or where it moves otherwise than planned."""
    w, planned, peak, n = axis.measured.w, axis.speed, axis.plan.peak, windows(axis.step)[1][0]
    if peak == 0.0 or len(w) < n:
        return None
    level = max(STANDS * peak, CERTAIN * noise_of(w - planned, n, axis.measured.speed_resolution))
    mean, meant, when = smoothed(np.abs(w), n), smoothed(np.abs(planned), n), smoothed(axis.t, n)
    still = smoothed(w, n)
    stands = (np.abs(still) < level) & (meant > 5 * level) & (mean < meant / 5)
    first, last, length = longest(stands, when)
    if length < STALL:
        return None
    rest = (np.abs(w) >= level) & ((axis.t < when[first] - NEAR) | (axis.t > when[last] + NEAR))
    if rest.sum() > n and correlation(planned[rest], w[rest]) < ALIKE:
        return None
    largest = float(np.abs(axis.measured.tau[first : last + n]).max())
    text = (
        f"the motor stands for {length:.3g} s, {float(when[first]):.3g} s after the start, where the plan moves it "
        f"(torque up to {1e3 * largest:.3g} mN·m)"
    )
    return Finding("stall", "not held", text, length, STALL)


def saturated(axis: AlignedAxis) -> Iterator[Finding]:
    """Torque stays at one largest value while the speed sags, or stays at the motor's own."""
    tau, w, motor = axis.measured.tau, axis.measured.w, axis.plan.joint.motor
    size = np.abs(tau)
    band = 2 * max(
        axis.measured.torque_resolution, noise_of(tau, 1, axis.measured.torque_resolution)
    )
    top = float(np.quantile(size, 0.995))
    if motor is not None and top >= 0.98 * motor.max_torque:
        first, last, length = longest(size >= 0.98 * motor.max_torque, axis.t)
        if length >= SHORT:
            text = f"the motor gives its largest torque for {length:.3g} s, from {float(axis.t[first]):.3g} s on"
            yield Finding("saturation", "not held", text, length, SHORT)
            return
    n = windows(axis.step)[1][0]
    near = size >= top - 2 * band
    first, last, length = longest(near, axis.t)
    if length < SHORT or last - first < n:
        return
    lack = float(
        np.mean((axis.speed[first:last] - w[first:last]) * np.sign(axis.speed[first:last]))
    )
    allowed = STANDS * axis.plan.peak + CERTAIN * noise_of(
        w - axis.speed, n, axis.measured.speed_resolution
    )
    needed = float(np.mean(np.abs(np.interp(axis.t[first:last], axis.plan.time, axis.plan.torque))))
    if lack > allowed and needed > top:
        text = (
            f"torque stays at {1e3 * top:.3g} mN·m for {length:.3g} s, from {float(axis.t[first]):.3g} s on, while the "
            f"speed sags by {100 * lack / axis.plan.peak:.2g} % of the largest: the torque is cut off"
        )
        yield Finding("saturation", "not held", text, lack, allowed)


def torque(axis: AlignedAxis) -> Iterator[Finding]:
    """Torque in motion beside the band that is predicted for it, averaged over the longest window."""
    plan, n = axis.plan, windows(axis.step)[-1][0]
    tau = axis.measured.tau
    moving = (
        (np.abs(axis.speed) > STANDS * plan.peak)
        if plan.peak > 0
        else np.zeros(len(tau), dtype=bool)
    )
    if len(tau) < 3 * n or moving.sum() < n:
        return
    reach = round((NEAR + n * axis.step / 2) * PLAN_RATE)
    low, high = (
        np.interp(axis.t, plan.time, each)
        for each in (_extreme(plan.low, reach, -1), _extreme(plan.high, reach, 1))
    )
    mean, expected = smoothed(tau, n), smoothed(np.interp(axis.t, plan.time, plan.torque), n)
    noise = CERTAIN * noise_of(
        (tau - np.interp(axis.t, plan.time, plan.torque))[axis.moving],
        n,
        axis.measured.torque_resolution,
    )
    whole = smoothed(moving.astype(float), n) > 1 - 0.5 / n
    low, high = smoothed(low, n), smoothed(high, n)
    outside = whole & ((mean > high + noise) | (mean < low - noise))
    share = float(outside.sum() / max(whole.sum(), 1))
    if share > OUTSIDE:
        ratio = float(
            np.median(np.abs(mean[outside]) / np.maximum(np.abs(expected[outside]), 1e-12))
        )
        source = "the drive's posterior" if plan.known else "assumed"
        text = f"torque is {ratio:.2f} times the predicted, outside its band ({source}) in {100 * share:.0f} % of the motion"
        yield Finding("torque", "not held", text, share, OUTSIDE)


def _extreme(values: Array, reach: int, sign: int) -> Array:
    """The largest (sign +1) or smallest (−1) of the values (n,) within `reach` samples on both sides."""
    padded = np.pad(sign * values, reach, mode="edge")
    return np.asarray(
        sign * np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1).max(axis=1)
    )


def limits_of(axis: AlignedAxis, certificate: Certificate | None) -> tuple[Kept, ...]:
    """Position, velocity, motor speed and motor torque against their limits."""
    plan, joint, measured = axis.plan, axis.plan.joint, axis.measured
    stated = (
        {c.name: c.margin for c in certificate.limits if c.joint == joint.name}
        if certificate is not None
        else {}
    )
    low, high = joint.position
    q = axis.q
    nearer, end = (
        (float(q.max()), high) if high - q.max() <= q.min() - low else (float(q.min()), low)
    )
    half = (high - low) / 2
    margin, noise = min(high - float(q.max()), float(q.min()) - low) / half, position_noise(axis)
    unit = joint.unit
    verdict: Verdict = (
        "not held"
        if margin * half < -noise
        else "held"
        if noise <= UNRESOLVED * half
        else "cannot tell"
    )
    found = [
        Kept(
            JointPosition.name,
            end,
            planned_margin=stated.get(JointPosition.name),
            measured=nearer,
            margin=margin,
            held=verdict == "held",
            unit=unit,
            noise=noise,
            window=0.0,
            verdict=verdict,
        )
    ]
    apart, resolution = measured.w - axis.speed, measured.speed_resolution

    def kept(limit: JointLimit, values: Array, departure: Array, resolution: float) -> Kept:
        largest = limit.largest
        worst, noise, window = worst_excess(
            values, departure[axis.moving], largest, axis.step, resolution
        )
        verdict: Verdict = "held" if noise <= UNRESOLVED * largest else "cannot tell"
        verdict = "not held" if worst > largest + noise else verdict
        return Kept(
            limit.name,
            largest,
            planned_margin=stated.get(limit.name),
            measured=worst,
            margin=1 - worst / largest,
            held=verdict == "held",
            unit=limit.unit,
            noise=noise,
            window=window,
            verdict=verdict,
        )

    ratio = plan.ratio
    found.append(
        kept(joint.limit(JointVelocity), measured.w / ratio, apart / ratio, resolution / ratio)
    )
    if joint.motor is not None:
        expected = np.interp(axis.t, plan.time, plan.torque)
        found.append(kept(joint.limit(MotorSpeed), measured.w, apart, resolution))
        found.append(
            kept(
                joint.limit(MotorTorque),
                measured.tau,
                measured.tau - expected,
                measured.torque_resolution,
            )
        )
    return tuple(found)


def of_the_clock(clock: Clock, axes: list[AlignedAxis]) -> Iterator[Finding]:
    """Axes out of step with the others, and a clock that is certainly off."""
    if clock.rate != 1.0:
        text = (
            f"the recordings' clock is off by {100 * (1 / clock.estimated_rate - 1):+.3g} %: their times, and what follows "
            "from them, are corrected by it"
        )
        yield Finding(
            "clock", "cannot tell", text, abs(clock.rate - 1), DRIFT + CERTAIN * clock.rate_error
        )
    if len(axes) < 2:
        return
    late = {
        axis.name: axis.alignment.delay - clock.delay
        for axis in axes
        if axis.alignment.correlation >= ALIKE
    }
    errors = [
        axis.alignment.delay_error for axis in axes if np.isfinite(axis.alignment.delay_error)
    ]
    apart, allowed = (
        float(np.ptp(list(late.values()))) if late else 0.0,
        STEP + CERTAIN * max(errors, default=0.0),
    )
    if apart > allowed:
        words = ", ".join(
            f"{name} {1e3 * (each - min(late.values())):.3g} ms" for name, each in late.items()
        )
        text = f"the joints are out of step, behind the first by: {words} (or their recordings do not share a clock)"
        yield Finding("out of step", "not held", text, apart, allowed)
