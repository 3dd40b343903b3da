"""Find faults of an executed motion, such as missing samples, stalls and exceeded limits.

`compare` aligns each recording with the plan (`AlignedAxis`) and passes it to `find_faults` and
`check_limits`. Each fault becomes a `Finding` with a verdict: "held" for a remark, "not held" for a
certain fault, and "cannot tell" if the recording does not suffice.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import chain
from typing import Literal, Protocol

import numpy as np

from ssm_planner.comparison.clock import (
    Alignment,
    Clock,
    SpeedMatch,
    match_speed,
    planned_speed_at,
    speed_correlation,
)
from ssm_planner.comparison.measured import AxisRecording
from ssm_planner.comparison.noise import (
    MAX_NOISE_RATIO,
    SIGNIFICANT_DEVIATIONS,
    SIGNIFICANT_SAMPLE_DEVIATIONS,
    averaging_windows,
    estimate_noise,
    longest_run,
    moving_means,
)
from ssm_planner.comparison.predicted import AxisPrediction
from ssm_planner.identification import largest_magnitude, rms, trapezoidal_integral
from ssm_planner.problem import (
    JointAcceleration,
    JointLimit,
    JointPosition,
    JointVelocity,
    Limit,
    MotorSpeed,
    MotorTorque,
)
from ssm_planner.typing import Array, Mask, frozen, record
from ssm_planner.verification import Certificate

MAX_START_DIFFERENCE = 5e-3
"""Largest permitted difference between the starts of the joints, s."""
MAX_CLOCK_DRIFT = 1e-3
"""Largest relative error of the recordings' clock. The error of a crystal is ten times smaller."""
MAX_SAMPLE_GAP = 10e-3
"""Longest permitted time without a sample, s. A fault that is shorter can lie between samples.

Times are rounded to 1 ms because sampling periods vary.
"""
REPORTED_MISSING_SHARE = 0.005
"""Share of missing samples above which they are reported."""
MAX_MISSING_SHARE = 0.2
"""Share of missing samples above which no verdict is possible."""
MAX_OUTSIDE_SHARE = 0.05
"""Largest permitted share of the moving time in which the torque is outside its predicted band."""
STANDSTILL_SPEED_RATIO = 0.02
"""Speed below which a motor counts as at rest, as a share of the largest planned speed.

It is also the smallest speed that a saturated motor loses.
"""
MIN_SATURATION_TIME = 20e-3
"""Shortest time at the largest torque that counts as saturation, s."""
ACCELERATION_WINDOW = 30e-3
"""Time between the two mean speeds whose difference gives an acceleration, s."""
MIN_STALL_TIME = 0.1
"""Shortest standstill against the plan that counts as a stall, s."""
MIN_UNIT_FACTOR = 3.5
"""Smallest ratio of measured and planned values that suggests a wrong unit."""
UNIT_FACTORS = {
    4.0: "increments and encoder counts",
    60 / (2 * np.pi): "rpm and rad/s",
    180 / np.pi: "degrees and radians",
    100.0: "percent and fractions",
    1000.0: "units and thousandths",
}
"""Pairs of units that are often confused, by the factor between both units."""
MIN_MOTION_CORRELATION = 0.8
"""Smallest correlation of measured and planned speed in a recording of the same motion."""
TORQUE_TIME_TOLERANCE = 15e-3
"""Tolerance in time for a predicted torque, s. The torque jumps at starts and stops."""

Verdict = Literal["held", "not held", "cannot tell"]


class HasVerdict(Protocol):
    """Any part of a comparison that has a verdict: a finding, the result of a limit, or an axis."""

    @property
    def verdict(self) -> Verdict: ...


def worst_verdict(*groups: Iterable[HasVerdict]) -> Verdict:
    """Return the worst verdict of the parts of a comparison.

    Parameters
    ----------
    *groups : iterables
        Parts with a verdict, such as findings or axes.

    Returns
    -------
    str
        "not held" if any part has it, otherwise "cannot tell" if any part has it, otherwise "held".
    """
    order: tuple[Verdict, ...] = ("held", "cannot tell", "not held")
    verdicts = [item.verdict for item in chain.from_iterable(groups)]
    return max(verdicts, key=order.index, default="held")


@frozen
class Finding:
    """A fault of the execution, or a remark if the verdict is "held".

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.Finding("limit", "exceeded", "the roll was too fast", value=1.2, allowed=1.1).kind
    'limit'
    """

    kind: str
    """Name of the fault.

    tracking, out of step, stall, saturation, torque, gap, sampling, missing samples, coverage,
    unread data, missing recording, contradiction, clock, speed, swapped, reversed, units, several
    motions or other motion.
    """
    verdict: Verdict
    text: str
    value: float
    """Size of the fault, in a unit that depends on the kind."""
    allowed: float
    """Largest permitted value, including noise."""


@frozen
class Kept:
    """The measured margin of one limit, and the margin in the plan.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> comparison = ssm.compare("results/tilt_insert", {"roll": "roll.csv"})  # doctest: +SKIP
    >>> [(limit.name, limit.held) for limit in comparison.axes[0].limits]  # doctest: +SKIP
    """

    name: str
    limit: float
    planned_margin: float | None
    """Margin in the plan's certificate. None without a certificate."""
    measured: float
    """Worst measured value, as a mean over `window`."""
    margin: float
    held: bool
    """True if the verdict is "held"."""
    unit: str
    noise: float
    """Possible contribution of noise to the measured value.

    For the acceleration, it includes the permitted ripple, which is a tenth of the limit.
    """
    window: float
    """Duration of the mean, s. 0 means a single sample."""
    verdict: Verdict


@record
class AlignedAxis:
    """A recording and its plan on the common clock. Arrays are (n,), one value per sample."""

    plan: AxisPrediction
    measured: AxisRecording
    alignment: Alignment
    t: Array
    """Planned time, s."""
    speed: Array
    """Planned speed, rad/s."""
    travelled: Array
    """Joint position from the integral of the measured speed, rad or m."""
    step: float
    """Median interval between two samples, s."""

    @property
    def covered(self) -> float:
        """Share of the motion that the recording contains."""
        duration = self.plan.duration
        covered = min(float(self.t[-1]), duration) - max(float(self.t[0]), 0.0)
        return max(covered, 0.0) / duration

    @property
    def window(self) -> int:
        """Number of samples in the shortest mean."""
        return averaging_windows(self.step)[1][0]

    @property
    def moving(self) -> Mask:
        """Mask (n,) of the samples in which the plan moves the joint.

        It selects all samples if the joint almost rests.
        """
        peak = self.plan.peak
        moving = np.abs(self.speed) > STANDSTILL_SPEED_RATIO * peak
        if moving.sum() > 8 * averaging_windows(self.step)[-1][0]:
            return moving
        return np.ones(len(self.t), dtype=bool)

    @property
    def sigma(self) -> float:
        """Standard deviation of the noise in a single sample of the speed, rad/s."""
        return estimate_noise(self.speed_error[self.moving], 1, self.measured.speed_resolution)

    @property
    def speed_noise(self) -> float:
        """Standard deviation of the speed that `mean_noise` returns, rad/s."""
        return self.mean_noise(self.speed_error, self.measured.speed_resolution)

    def mean_noise(self, error: Array, resolution: float) -> float:
        """Estimate the noise of a single sample from the noise of means.

        The result σ is such that a mean of n samples has the standard deviation σ/√n. It is the
        smallest value over all windows. Ripple that cancels in means increases the value of short
        windows, and a slow oscillation increases that of long windows.

        Parameters
        ----------
        error : (n,) array
            Difference between the measured and the planned values.
        resolution : float
            Resolution of the channel, in the unit of the error.

        Returns
        -------
        float
            Standard deviation in the unit of the error.
        """
        moving = error[self.moving]
        return min(
            estimate_noise(moving, n, resolution) * n**0.5 for n, _ in averaging_windows(self.step)
        )

    @property
    def q(self) -> Array:
        """Measured joint position (n,), or the integral of the measured speed, rad or m."""
        return self.travelled if self.measured.q is None else self.measured.q

    @property
    def integral_noise(self) -> tuple[float, float]:
        """Possible errors of the position that results from integrating the speed, rad or m.

        The first value is the error due to noise alone. The second value also contains the error of
        a speed that is wrong by half of its resolution.
        """
        duration = float(self.t[-1] - self.t[0])
        # The noise of single samples adds up like a random walk.
        root = (self.step * duration) ** 0.5
        noise = SIGNIFICANT_DEVIATIONS * self.speed_noise * root / self.plan.ratio
        offset = self.measured.speed_resolution / 2 * self.plan.duration / self.plan.ratio
        return noise, noise + offset

    @property
    def intervals(self) -> tuple[Array, Array]:
        """Intervals between consecutive samples during the motion.

        The first array contains the planned times at their starts, and the second array contains
        their durations, (k,) each, s.
        """
        during = (self.t[1:] > 0) & (self.t[:-1] < self.plan.duration)
        return self.t[:-1][during], np.diff(self.measured.time)[during]

    @property
    def visible(self) -> dict[str, float]:
        """Shortest and smallest faults that the recording can show.

        The entries are "duration" (s), "position" of the joint (rad or m), and "speed" (rad/s) and
        "torque" (N·m) of the motor.
        """
        _, durations = self.intervals
        speed_noise = SIGNIFICANT_SAMPLE_DEVIATIONS * self.sigma
        resolution = self.measured.torque_resolution
        torque_sigma = estimate_noise(self.torque_error[self.moving], 1, resolution)
        torque_noise = SIGNIFICANT_SAMPLE_DEVIATIONS * torque_sigma
        return {
            "duration": float(durations.max(initial=self.step)),
            "position": position_noise(self),
            "speed": speed_noise + self.measured.speed_resolution / 2,
            "torque": torque_noise + resolution / 2,
        }

    def interpolate_plan(self, values: Array) -> Array:
        """Interpolate planned values at the samples of the recording.

        Parameters
        ----------
        values : (m,) array
            Planned values at the instants of the prediction.

        Returns
        -------
        (n,) array
            Planned values at the samples.
        """
        return np.interp(self.t, self.plan.time, values)

    @property
    def still_level(self) -> float:
        """Speed below which the motor counts as at rest, rad/s.

        It applies to means over the shortest window.
        """
        noise = SIGNIFICANT_DEVIATIONS * self.speed_noise / self.window**0.5
        return max(STANDSTILL_SPEED_RATIO * self.plan.peak, noise)

    @property
    def position_error(self) -> Array:
        """Measured minus planned position (n,), rad or m."""
        return self.q - self.interpolate_plan(self.plan.position)

    @property
    def speed_error(self) -> Array:
        """Measured minus planned motor speed (n,), rad/s."""
        return self.measured.w - self.speed

    @property
    def torque_error(self) -> Array:
        """Measured minus planned motor torque (n,), N·m."""
        return self.measured.tau - self.interpolate_plan(self.plan.torque)


def map_to_clock(
    plan: AxisPrediction, measured: AxisRecording, alignment: Alignment, clock: Clock
) -> AlignedAxis:
    """Convert the times of a recording to the planned time, and add the planned values.

    The travelled position is the planned position plus the integral of the speed error since the
    start of the motion. An offset of the speed at rest, up to half of its resolution, is an error
    of the channel and is subtracted.

    Parameters
    ----------
    plan : AxisPrediction
        Predicted motion of the axis.
    measured : AxisRecording
        Recording of the axis.
    alignment : Alignment
        Position of the planned motion in the recording.
    clock : Clock
        Common clock of all recordings.

    Returns
    -------
    AlignedAxis
        Recording and plan on the common clock.
    """
    t = clock.planned_time(measured.time)
    step = float(np.median(np.diff(measured.time)))
    speed = planned_speed_at(plan.time, plan.speed, t)
    speed_error = measured.w - speed
    for is_resting in (t < 0, t > plan.duration):
        if is_resting.any():
            half = measured.speed_resolution / 2
            speed_error[is_resting] -= np.clip(np.mean(speed_error[is_resting]), -half, half)
    distance = trapezoidal_integral(t, speed_error / plan.ratio)
    distance -= np.interp(0.0, t, distance)  # 0 at the start of the motion
    return AlignedAxis(
        plan,
        measured,
        alignment,
        t,
        speed=speed,
        travelled=np.interp(t, plan.time, plan.position) + distance,
        step=step,
    )


def find_faults(axis: AlignedAxis, lag: float) -> Iterator[Finding]:
    """Yield the findings on one axis, except for its limits (`check_limits`).

    Parameters
    ----------
    axis : AlignedAxis
        Recording and plan of the axis.
    lag : float
        Delay (s) that is permitted at the largest speed. It determines the permitted tracking
        error.

    Yields
    ------
    Finding
        Faults and remarks: sampling, unread data, tracking, stall or saturation, torque, and
        further motions in the recording.
    """
    yield from check_sampling(axis)
    for text in axis.measured.doubts:
        yield Finding("unread data", "cannot tell", text, 1, 0)
    yield from check_tracking(axis, lag)
    stall = find_stall(axis)
    if stall is None:
        yield from find_saturation(axis)
    else:
        yield stall
    yield from check_torque(axis)
    yield from find_second_motion(axis)


def check_sampling(axis: AlignedAxis) -> Iterator[Finding]:
    """Check that a recording contains the whole motion without long gaps.

    Parameters
    ----------
    axis : AlignedAxis
        Recording and plan of the axis.

    Yields
    ------
    Finding
        Missing parts of the motion, the longest gap, and the share of missing samples.
    """
    step = axis.step
    outside = max(float(axis.t[0]), axis.plan.duration - float(axis.t[-1]))
    if round(outside, 3) > MAX_SAMPLE_GAP:
        text = (
            f"the recording holds {100 * axis.covered:.3g} % of the motion, and misses "
            f"{outside:.3g} s at one end"
        )
        yield Finding("coverage", "cannot tell", text, outside, MAX_SAMPLE_GAP)
    times, steps = axis.intervals
    if not len(steps):
        return
    gap = float(steps.max())
    if round(gap, 3) > MAX_SAMPLE_GAP:
        kind = "sampling"
        text = f"samples are up to {gap:.3g} s apart"
        if gap > 3 * step:
            kind = "gap"
            time = float(times[int(np.argmax(steps))])
            text = f"no samples for {gap:.3g} s, {time:.3g} s after the motion's start"
        text += (
            ": a fault that is shorter can be missing "
            f"(a verdict needs {1e3 * MAX_SAMPLE_GAP:.3g} ms)"
        )
        yield Finding(kind, "cannot tell", text, gap, MAX_SAMPLE_GAP)
    missing = float(np.sum(np.rint(steps / step) - 1))
    share = missing / (missing + len(steps))
    if share > REPORTED_MISSING_SHARE:
        verdict: Verdict = "cannot tell" if share > MAX_MISSING_SHARE else "held"
        yield Finding(
            "missing samples",
            verdict,
            f"{100 * share:.2g} % of the samples are missing",
            share,
            MAX_MISSING_SHARE,
        )


def check_tracking(axis: AlignedAxis, lag: float) -> Iterator[Finding]:
    """Yield a finding if the tracking error is too large, or if noise could hide such an error.

    The permitted error is the distance that the joint travels within the lag at its velocity limit,
    or the tracking error in the robot file if that is smaller. Another finding states that the
    measured position contradicts the integral of the speed.

    Parameters
    ----------
    axis : AlignedAxis
        Recording and plan of the axis.
    lag : float
        Permitted delay, s.

    Yields
    ------
    Finding
        First "contradiction", then "tracking", each only if it applies.
    """
    joint = axis.plan.joint
    noise = position_noise(axis)
    random_noise, integral_noise = axis.integral_noise
    limit = lag * joint.velocity
    if joint.tracking_error is not None:
        limit = min(limit, joint.tracking_error)
    unit = f"m{joint.unit}"  # mrad or mm
    allowed = limit + noise
    difference = largest_magnitude(axis.q - axis.travelled)
    if difference > allowed + integral_noise:
        text = (
            f"position and integral of the speed differ by {1e3 * difference:.3g} {unit}: one of "
            "the channels is wrong"
        )
        yield Finding("contradiction", "cannot tell", text, difference, allowed + integral_noise)
    error = np.abs(axis.position_error)
    k = int(np.argmax(error))
    max_error = float(error[k])
    possible_noise = random_noise if axis.measured.q is None else noise
    if max_error - limit <= possible_noise <= limit:
        return
    text = (
        f"{1e3 * max_error:.3g} {unit} away from the plan {float(axis.t[k]):.3g} s after "
        f"the start (allowed: {1e3 * limit:.3g} {unit}, noise {1e3 * noise:.2g} {unit})"
    )
    travel = float(np.ptp(axis.plan.position))
    if np.ptp(error) < max_error / 2:
        text += "; the error is almost constant: is the homing wrong?"
    elif travel > 0:
        text += f"; its travel is {describe_factor(float(np.ptp(axis.q)) / travel)}"
    verdict: Verdict = "not held" if max_error > allowed else "cannot tell"
    yield Finding("tracking", verdict, text, max_error, allowed)


def position_noise(axis: AlignedAxis) -> float:
    """Return the possible error of a measured or integrated joint position.

    Without a position channel, the position is the integral of the measured speed.

    Parameters
    ----------
    axis : AlignedAxis
        Recording and plan of the axis.

    Returns
    -------
    float
        Possible error, rad or m.
    """
    if axis.measured.q is None:
        return axis.integral_noise[1]
    resolution = axis.measured.position_resolution
    noise = estimate_noise(axis.position_error[axis.moving], 1, resolution)
    return max(SIGNIFICANT_DEVIATIONS * noise, 2 * resolution)


def find_other_motion(axis: AlignedAxis, plans: Sequence[AxisPrediction]) -> Finding | None:
    """Return a finding if the recording does not show the planned motion of its joint.

    The finding names the likely cause: swapped recordings, a wrong sign, a wrong unit, or another
    motion.

    Parameters
    ----------
    axis : AlignedAxis
        Recording and plan of the axis.
    plans : sequence of AxisPrediction
        Predictions of all joints, with which swapped recordings are recognised.

    Returns
    -------
    Finding or None
        Finding with the verdict "not held". None if the recording shows the planned motion.
    """
    measured = axis.measured
    likeness = axis.alignment.correlation
    noise = SIGNIFICANT_DEVIATIONS * axis.sigma

    def fit(plan: AxisPrediction, speed: float = 1.0) -> SpeedMatch:
        """Match the recording with a plan that is executed at a given speed.

        Parameters
        ----------
        plan : AxisPrediction
            Prediction of one of the axes.
        speed : float
            Speed of execution, as a multiple of the planned speed.

        Returns
        -------
        SpeedMatch
            Delay, cost and correlation of the best match.
        """
        return match_speed(plan.time, plan.speed, measured.time, measured.w, speed)

    own_fit = fit(axis.plan)
    best_plan = min(plans, key=lambda plan: fit(plan).cost)
    # A recording with times in ms instead of s, or the opposite, fits at one of these speeds.
    scale = max((1e-3, 1e3), key=lambda scale: fit(axis.plan, scale).correlation)
    is_proportional = 1 - abs(own_fit.correlation) < STANDSTILL_SPEED_RATIO
    text = f"its speed is not the planned one of joint {measured.joint}"
    if fit(best_plan).cost < min(own_fit.cost / 4, MAX_NOISE_RATIO):
        kind = "swapped"
        text += f", but that of joint {best_plan.joint.name}: are recordings or motors swapped?"
    elif is_proportional and not 1 / MIN_UNIT_FACTOR < abs(own_fit.factor) < MIN_UNIT_FACTOR:
        kind = "units"
        text = f"its speed is {describe_factor(own_fit.factor)}"
    elif max(own_fit.cost, 1 - likeness) < MAX_NOISE_RATIO or find_stall(axis) is not None:
        return None
    elif fit(axis.plan, scale).correlation >= MIN_MOTION_CORRELATION:
        kind = "units"
        text = f"its time is {describe_factor(1 / scale)}"
    elif (
        likeness >= MIN_MOTION_CORRELATION
        or rms(axis.speed_error) <= STANDSTILL_SPEED_RATIO * axis.plan.peak + noise
    ):
        # The second test also works for a motor that rests most of the time.
        return None
    elif own_fit.correlation < -MIN_MOTION_CORRELATION:
        kind = "reversed"
        text = (
            "the recording is reversed: motor_direction in the robot file, or the recording's "
            "sign, is wrong"
        )
    else:
        kind = "other motion"
        text += (
            f" (correlation {likeness:.2f}, at least {MIN_MOTION_CORRELATION:g} needed): "
            "is it another joint's or another motion's?"
        )
    return Finding(kind, "not held", text, likeness, MIN_MOTION_CORRELATION)


def describe_factor(factor: float) -> str:
    """Describe the ratio of a measured to a planned value, and name likely causes.

    Parameters
    ----------
    factor : float
        Measured value divided by the planned value.

    Returns
    -------
    str
        Part of a sentence, such as "57.30 times the predicted: are its units wrong (degrees and
        radians)?".
    """
    sign = ", so its sign is wrong" if factor < 0 else ""
    size = abs(np.log(max(abs(factor), 1e-9)))
    units = [text for ratio, text in UNIT_FACTORS.items() if abs(size - np.log(ratio)) < 0.2]
    hint = f": are its units wrong ({units[0]})?" if units else ""
    number = f"{factor:.2f}" if abs(factor) > STANDSTILL_SPEED_RATIO else f"{factor:.2g}"
    return f"{number} times the predicted{sign}{hint}"


def find_second_motion(axis: AlignedAxis) -> Iterator[Finding]:
    """Check if the motor also moves before or after the planned motion.

    Parameters
    ----------
    axis : AlignedAxis
        Recording and plan of the axis.

    Yields
    ------
    Finding
        The longest motion outside of the plan, if it is longer than `MIN_STALL_TIME`.
    """
    n = axis.window
    alignment = axis.alignment
    time = moving_means(alignment.rate * (axis.measured.time - alignment.delay), n)
    margin = MIN_STALL_TIME + n * axis.step
    outside = (time < -margin) | (time > axis.plan.duration + margin)
    moves = np.abs(moving_means(axis.measured.w, n)) > axis.still_level
    start, _, length = longest_run(outside & moves, time)
    if length >= MIN_STALL_TIME:
        text = (
            f"the motor also moves {float(time[start]):.3g} s after the start, outside of the "
            "planned motion: does the recording contain several motions?"
        )
        yield Finding("several motions", "not held", text, length, MIN_STALL_TIME)


def find_stall(axis: AlignedAxis) -> Finding | None:
    """Find the longest time for which the motor rests while the plan moves it.

    The motor must follow the plan before and after the stall. Otherwise, the recording may belong
    to another motion.

    Parameters
    ----------
    axis : AlignedAxis
        Recording and plan of the axis.

    Returns
    -------
    Finding or None
        The stall. None if it is shorter than `MIN_STALL_TIME`.
    """
    n = axis.window
    level = axis.still_level
    mean_time = moving_means(axis.t, n)
    planned_speed = moving_means(axis.speed, n)
    mean_speed = moving_means(axis.measured.w, n)
    is_still = np.abs(mean_speed) < level
    # A planned speed that is clearly above the level of rest excludes the starts and stops.
    is_stalled = is_still & (np.abs(planned_speed) > 5 * level)
    start, stop, length = longest_run(is_stalled, mean_time)
    if length < MIN_STALL_TIME:
        return None
    start_time = float(mean_time[start])
    time_from_middle = np.abs(mean_time - start_time - length / 2)
    is_outside = time_from_middle > length / 2 + TORQUE_TIME_TOLERANCE
    is_moving = ~is_still & is_outside
    if (
        is_moving.sum() > n
        and speed_correlation(planned_speed[is_moving], mean_speed[is_moving])
        < MIN_MOTION_CORRELATION
    ):
        return None
    torque = largest_magnitude(axis.measured.tau[start : stop + n])
    text = (
        f"the motor stands for {length:.3g} s, {start_time:.3g} s after the start, where "
        f"the plan moves it (torque up to {1e3 * torque:.3g} mN·m)"
    )
    return Finding("stall", "not held", text, length, MIN_STALL_TIME)


def find_saturation(axis: AlignedAxis) -> Iterator[Finding]:
    """Check if the motor torque is saturated.

    The torque is saturated if it stays at the largest torque of the motor, or if it stays at
    another value while the speed falls below the plan.

    Parameters
    ----------
    axis : AlignedAxis
        Recording and plan of the axis.

    Yields
    ------
    Finding
        The longest saturation, if any.
    """
    tau = axis.measured.tau
    motor = axis.plan.joint.motor
    max_torque = np.inf if motor is None else motor.max_torque
    n = 1 + round(MIN_SATURATION_TIME / axis.step)
    mean = np.abs(moving_means(np.clip(tau, -max_torque, max_torque), n))
    top = float(mean.max(initial=0.0))
    noise = estimate_noise(tau, 1, axis.measured.torque_resolution)
    # A mean within 2 % of the largest torque counts as the largest torque.
    level = min(0.98 * max_torque, top - 2 * noise)
    start, stop, length = longest_run(mean >= level, axis.t)
    during = f"for {length + MIN_SATURATION_TIME:.3g} s, from {float(axis.t[start]):.3g} s on"
    if top >= 0.98 * max_torque:
        text = f"the motor gives its largest torque {during}"
        yield Finding(
            "saturation", "not held", text, length + MIN_SATURATION_TIME, MIN_SATURATION_TIME
        )
        return
    allowed = axis.still_level
    saturated = slice(start, stop + n)
    direction = np.sign(axis.speed)[saturated]
    planned_torque = axis.interpolate_plan(axis.plan.torque)
    deficit = -float(np.mean(axis.speed_error[saturated] * direction))
    required = float(np.mean(planned_torque[saturated] * direction))
    if deficit > allowed and required > top:
        text = (
            f"torque stays at {1e3 * top:.3g} mN·m {during}, while the speed sags by "
            f"{100 * deficit / axis.plan.peak:.2g} % of the largest: the torque is cut off"
        )
        yield Finding("saturation", "not held", text, deficit, allowed)


def check_torque(axis: AlignedAxis) -> Iterator[Finding]:
    """Check that the torque in motion stays in its predicted band.

    The torque is averaged over the longest window (`averaging_windows`). It may leave the band for
    a share of `MAX_OUTSIDE_SHARE` of the moving time.

    Parameters
    ----------
    axis : AlignedAxis
        Recording and plan of the axis.

    Yields
    ------
    Finding
        Torque outside of its band, or noise that hides the band.
    """
    # SciPy's image module takes long to import, and other commands do not need it.
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    plan = axis.plan
    n = averaging_windows(axis.step)[-1][0]
    tau = axis.measured.tau
    # If the plan does not move the axis, both sides are 0 and no sample is selected.
    moving = np.abs(axis.speed) > STANDSTILL_SPEED_RATIO * plan.peak
    # The band covers jumps of the torque that happen earlier or later than planned. `reach` is an
    # odd number of planned samples.
    reach = 2 * round((TORQUE_TIME_TOLERANCE + n * axis.step / 2) / plan.time[1]) + 1
    lowest = minimum_filter1d(plan.low, reach, mode="nearest")
    highest = maximum_filter1d(plan.high, reach, mode="nearest")
    mean = moving_means(tau, n)
    expected = moving_means(axis.interpolate_plan(plan.torque), n)
    low = moving_means(axis.interpolate_plan(lowest), n)
    high = moving_means(axis.interpolate_plan(highest), n)
    resolution = axis.measured.torque_resolution
    noise = SIGNIFICANT_DEVIATIONS * axis.mean_noise(axis.torque_error, resolution) / n**0.5
    # Windows in which every sample moves
    moving_windows = moving_means(moving.astype(float), n) > 1 - 0.5 / n
    if not moving_windows.any():
        return
    width = float(np.median((high - low)[moving_windows]))
    outside = moving_windows & ((mean > high + noise) | (mean < low - noise))
    share = float(outside.sum() / moving_windows.sum())
    if share > MAX_OUTSIDE_SHARE:
        size = np.maximum(np.abs(expected), 1e-12)
        ratio = float(np.median((np.sign(expected) * mean / size)[outside]))
        source = "the drive's posterior" if plan.has_posterior else "assumed"
        text = (
            f"torque is {describe_factor(ratio)}, outside its band ({source}) in "
            f"{100 * share:.0f} % of the motion"
        )
        yield Finding("torque", "not held", text, share, MAX_OUTSIDE_SHARE)
    elif noise > width:
        text = f"noise of {1e3 * noise:.3g} mN·m hides its band of {1e3 * width:.3g} mN·m"
        yield Finding("torque", "cannot tell", text, noise, width)


def check_limits(axis: AlignedAxis, certificate: Certificate | None) -> tuple[Kept, ...]:
    """Compare the measured values with the limits of the joint and of its motor.

    Parameters
    ----------
    axis : AlignedAxis
        Recording and plan of the axis.
    certificate : Certificate or None
        Certificate of the plan, which provides the planned margins.

    Returns
    -------
    tuple of Kept
        Results for the position and the velocity of the joint, the speed and the torque of its
        motor, if any, and the acceleration of the joint.
    """
    joint = axis.plan.joint
    limits = [check_position_limit(axis), check_channel_limit(axis, JointVelocity)]
    if joint.motor is not None:
        limits.append(check_channel_limit(axis, MotorSpeed))
        limits.append(check_channel_limit(axis, MotorTorque))
    limits.append(check_acceleration_limit(axis))
    margins = {}
    if certificate is not None:
        for check in certificate.limits:
            if check.joint == joint.name:
                margins[check.name] = check.margin
    return tuple(replace(limit, planned_margin=margins.get(limit.name)) for limit in limits)


def check_position_limit(axis: AlignedAxis) -> Kept:
    """Compare the measured position of a joint with its limits.

    Parameters
    ----------
    axis : AlignedAxis
        Recording and plan of the axis.

    Returns
    -------
    Kept
        Result at the sample that is nearest to a limit, or farthest beyond it.
    """
    position = axis.plan.joint.limit(JointPosition)
    ends = position.low, position.high
    distance = np.minimum(axis.q - position.low, position.high - axis.q)
    k = int(np.argmin(distance))
    value = float(axis.q[k])
    bound = min(ends, key=lambda end: abs(value - end))
    return _limit_result(position, bound, value, float(distance[k]), noise=position_noise(axis))


def check_channel_limit(axis: AlignedAxis, limit_type: type[JointLimit]) -> Kept:
    """Compare the measured speed or torque of a motor with a limit of the motor or the joint.

    The result is that of the window in which the channel exceeds the limit most. A fast oscillation
    looks like noise. If no window exceeds the limit, but the noise of a single sample can hide that
    it does, the result is that of the single sample.

    Parameters
    ----------
    axis : AlignedAxis
        Recording and plan of the axis.
    limit_type : type
        Type of the limit: `JointVelocity`, `MotorSpeed` or `MotorTorque`.

    Returns
    -------
    Kept
        Result of the selected window.
    """
    # Measured values, their differences from the plan, and the resolution of the channel
    values = axis.measured.w
    departure = axis.speed_error
    resolution = axis.measured.speed_resolution
    if limit_type is MotorTorque:
        values = axis.measured.tau
        departure = axis.torque_error
        resolution = axis.measured.torque_resolution
    # The channel contains the speed of the motor, also for the limit of the joint.
    ratio = axis.plan.ratio if limit_type is JointVelocity else 1.0
    limit = axis.plan.joint.limit(limit_type)
    bound = limit.largest
    candidates = []
    for n, deviations in averaging_windows(axis.step):
        if len(values) >= n:
            sigma = estimate_noise(departure[axis.moving], n, resolution)
            # Rounding shifts a mean by up to half of the resolution if the noise is small.
            noise = (deviations * sigma + resolution / 2) / ratio
            value = largest_magnitude(moving_means(values, n)) / ratio
            candidates.append((value - noise, value, noise, n * axis.step if n > 1 else 0.0))
    result = max(candidates)  # the candidate that certainly exceeds the limit most
    single_sample = candidates[0]
    _, value, noise, _ = single_sample
    if result[0] <= bound < value + noise and noise > MAX_NOISE_RATIO * bound:
        result = single_sample
    _, value, noise, window = result
    return _limit_result(limit, bound, value, bound - value, noise=noise, window=window)


def check_acceleration_limit(axis: AlignedAxis) -> Kept:
    """Compare the measured acceleration of a joint with its limit.

    The acceleration is the difference of two mean speeds, divided by the time between them. A
    controller adds ripple to the planned acceleration. The limit may therefore be exceeded by a
    tenth.

    Parameters
    ----------
    axis : AlignedAxis
        Recording and plan of the axis.

    Returns
    -------
    Kept
        Result for the largest acceleration.
    """
    limit = axis.plan.joint.limit(JointAcceleration)
    n = max(1, round(ACCELERATION_WINDOW / axis.step))
    speed = moving_means(axis.measured.w, n) / axis.plan.ratio
    time = moving_means(axis.t, n)
    accelerations = (speed[n:] - speed[:-n]) / (time[n:] - time[:-n])
    value = float(np.abs(accelerations).max(initial=0.0))
    # The difference of two means of n samples has √(2/n) times the noise of a sample.
    change = SIGNIFICANT_DEVIATIONS * axis.speed_noise * (2 / n) ** 0.5
    change += axis.measured.speed_resolution
    window = n * axis.step
    return _limit_result(
        limit,
        limit.largest,
        value,
        limit.largest - value,
        noise=change / axis.plan.ratio / window,
        window=window,
        ripple=MAX_NOISE_RATIO * limit.largest,
    )


def _limit_result(
    limit: Limit,
    bound: float,
    value: float,
    distance: float,
    *,
    noise: float,
    window: float = 0.0,
    ripple: float = 0.0,
) -> Kept:
    """Build the result of one limit from the worst measured value and its possible noise.

    The verdict is "not held" if the value exceeds the bound by more than the noise and the ripple.
    It is "held" if the noise is small compared with the limit or with the distance to the bound.

    Parameters
    ----------
    limit : Limit
        The limit.
    bound : float
        End of the permitted range that is nearer to the value.
    value : float
        Worst measured value.
    distance : float
        Distance from the value to the bound, which is negative beyond the bound.
    noise : float
        Possible contribution of noise to the value.
    window : float
        Duration of the mean that gives the value, s. 0 means a single sample.
    ripple : float
        Permitted ripple of the value, which is added to the noise.

    Returns
    -------
    Kept
        Result without the planned margin.
    """
    verdict: Verdict = "cannot tell"
    if distance < -noise - ripple:
        verdict = "not held"
    elif noise <= max(MAX_NOISE_RATIO * limit.half_width, distance):
        verdict = "held"
    return Kept(
        limit.name,
        bound,
        planned_margin=None,
        measured=value,
        margin=distance / limit.half_width,
        held=verdict == "held",
        unit=limit.unit,
        noise=noise + ripple,
        window=window,
        verdict=verdict,
    )


def check_clock(clock: Clock, axes: list[AlignedAxis]) -> Iterator[Finding]:
    """Check the rate of the recordings' clock, and that all axes start at the same time.

    Parameters
    ----------
    clock : Clock
        Common clock of all recordings.
    axes : list of AlignedAxis
        Recordings and plans of the axes.

    Yields
    ------
    Finding
        First "clock", then "out of step", each only if it applies.
    """
    if clock.rate != 1.0:
        text = (
            f"the recordings' clock is off by {100 * (1 / clock.estimated_rate - 1):+.3g} %: their "
            "times, and what follows from them, are corrected by it"
        )
        yield Finding(
            "clock",
            "cannot tell",
            text,
            abs(clock.rate - 1),
            MAX_CLOCK_DRIFT + SIGNIFICANT_DEVIATIONS * clock.rate_error,
        )
    delays = {}
    max_error = 0.0
    for axis in axes:
        alignment = axis.alignment
        is_alike = min(alignment.correlation, alignment.agreement) >= MIN_MOTION_CORRELATION
        if is_alike and np.isfinite(alignment.delay_error):
            delay = alignment.delay_at(clock.estimated_rate) - clock.delay
            delays[axis.plan.joint.name] = delay
            max_error = max(max_error, alignment.delay_error)
    spread = float(np.ptp(list(delays.values()))) if delays else 0.0
    allowed = MAX_START_DIFFERENCE + SIGNIFICANT_DEVIATIONS * max_error
    if spread > allowed:
        start = min(delays.values())
        offsets = ", ".join(
            f"{name} {1e3 * (delay - start):.3g} ms" for name, delay in delays.items()
        )
        text = (
            f"the joints are out of step, behind the first by: {offsets} (or their recordings "
            "do not share a clock)"
        )
        yield Finding("out of step", "not held", text, spread, allowed)


def check_speed(clock: Clock, played: float, intended: float | None) -> Iterator[Finding]:
    """Compare the speed at which a motion was executed with the intended speed.

    Parameters
    ----------
    clock : Clock
        Common clock of all recordings.
    played : float
        Speed at which the axes are compared, as a multiple of the planned speed.
    intended : float or None
        Intended speed, as a multiple of the planned speed. None means the planned speed.

    Yields
    ------
    Finding
        A fault if the speeds differ, or a remark if they agree but differ from the planned speed.
    """
    speed = played * clock.estimated_rate if clock.slower else played
    allowed = intended or 1.0
    text = f"played at {100 * speed:.3g} % of the plan's speed"
    if speed != allowed:
        text += f" instead of {100 * allowed:.3g} %; --speed declares a speed"
        yield Finding("speed", "not held", text, speed, allowed)
    elif allowed != 1.0:
        yield Finding("speed", "held", text, speed, allowed)
