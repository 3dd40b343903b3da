"""Estimate the start of a planned motion in its recordings, and the rate of their clock."""

from collections.abc import Sequence

import numpy as np

from ssm_planner.comparison.noise import SIGNIFICANT_DEVIATIONS
from ssm_planner.deprecation import Renamed
from ssm_planner.typing import Array, frozen

ALIGNMENT_SAMPLES = 4000
"""Approximate number of samples to which a recording is reduced for an alignment."""
MAX_SPEED_DEVIATION = 0.3
"""Largest deviation of a sample that determines the clock, as a share of the planned peak speed."""
MAX_RATE_DIFFERENCE = 0.05
"""Largest relative difference between the rates of two clocks."""
MAX_SIZE_DIFFERENCE = 0.05
"""Largest relative difference in speed of an axis that determines the clock."""
MIN_CLOCK_CORRELATION = 0.98
"""Smallest correlation of measured and planned speed of an axis that determines the clock."""
END_SPEED_RATIO = 0.05
"""Speed below which a motion has ended, as a share of the planned peak speed."""
CANDIDATE_SPEEDS = np.union1d(np.arange(5, 126) / 100, np.geomspace(0.05, 1.25, 80))
"""Speeds of execution that `estimate_speed` tries, as multiples of the planned speed."""


@frozen
class Alignment:
    """The position of a planned motion in the recording of one axis.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.Alignment(delay=0.02, correlation=0.98).rate
    1.0
    """

    delay: float
    """Time of the recording at which the motion starts, s."""
    correlation: float
    """Correlation of the measured with the planned speed during the planned motion."""
    rate: float = 1.0
    """Planned time that passes in one second of the recording."""
    rate_error: float = np.inf
    """Standard deviation of the rate."""
    delay_error: float = np.inf
    """Standard deviation of the delay, s."""
    size: float = 1.0
    """Ratio of the measured to the planned speed."""
    agreement: float = 0.0
    """Correlation until the end of the measured motion, which may stop early."""
    middle: float = 0.0
    """Planned time, s, at which the delay does not depend on the rate."""

    def delay_at(self, rate: float) -> float:
        """Return the start of the motion in the recording for another rate of the clock.

        The planned time `middle` is reached at the same time of the recording for every rate.

        Parameters
        ----------
        rate : float
            Planned time that passes in one second of the recording.

        Returns
        -------
        float
            Time of the recording, s.
        """
        return self.delay + self.middle / self.rate - self.middle / rate

    @property
    def determines_clock(self) -> bool:
        """True if the measured speed agrees with the plan in shape and size."""
        is_alike = (
            self.agreement >= MIN_CLOCK_CORRELATION and abs(self.size - 1) <= MAX_SIZE_DIFFERENCE
        )
        return is_alike and bool(np.isfinite(self.rate_error))


@frozen
class Clock:
    """Common clock of all recordings, with its start and its rate.

    The planned time is rate · (time of the recordings − delay).

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.Clock(delay=0.0, rate=1.0, estimated_rate=1.0001, rate_error=1e-4, slower=False).rate
    1.0
    """

    delay: float
    """Time of the recordings at which the motion starts, s."""
    rate: float
    """Estimated rate if it differs significantly from 1, otherwise 1."""
    estimated_rate: float
    """Planned time that passes in one second of the recordings."""
    rate_error: float
    """Standard deviation of the rate."""
    slower: bool
    """True if the motion was played more slowly, so that speeds and rate are smaller alike."""

    def planned_time(self, time: Array) -> Array:
        """Convert times of the recordings to times of the plan.

        Parameters
        ----------
        time : (n,) array
            Times of the recordings, s.

        Returns
        -------
        (n,) array
            Times since the start of the plan, s.
        """
        return self.rate * (time - self.delay)

    planned = Renamed("planned_time")


def align_axis(
    planned_time: Array, planned_speed: Array, time: Array, measured: Array
) -> Alignment:
    """Find a planned motion in a recording.

    Parameters
    ----------
    planned_time : (m,) array
        Instants of the plan, s. The first one is 0.
    planned_speed : (m,) array
        Planned speed in any unit. The axis is at rest before and after the plan.
    time : (n,) array
        Instants of the recording, s.
    measured : (n,) array
        Measured speed in the unit of the planned speed.

    Returns
    -------
    Alignment
        Start of the motion in the recording, and rate of the recording's clock.
    """
    if not planned_speed.any() or not measured.any():
        both_rest = not planned_speed.any() and not measured.any()
        return Alignment(float(time[0]), correlation=1.0 if both_rest else 0.0)
    threshold = END_SPEED_RATIO * np.abs(planned_speed).max()
    first, stop = _motion_samples(measured, threshold)
    coarse = match_speed(planned_time, planned_speed, time[:stop], measured[:stop])
    # Samples of a long rest do not contribute. Means of `step` other samples contain less noise.
    end = coarse.delay + planned_time[-1]
    margin = MAX_SPEED_DEVIATION * planned_time[-1]
    start_index, end_index = np.searchsorted(time, [coarse.delay - margin, end + margin])
    start_index = min(start_index, first)
    end_index = min(max(end_index, stop), len(time))
    step = max(1, (end_index - start_index) // ALIGNMENT_SAMPLES)
    used = slice(start_index, end_index - (end_index - start_index) % step)
    t = time[used].reshape(-1, step).mean(axis=1)
    w = measured[used].reshape(-1, step).mean(axis=1)
    _, stop = _motion_samples(w, threshold)
    delay, rate, size, errors, middle = _refine_alignment(
        coarse.delay, planned_time, planned_speed, t[:stop], w[:stop]
    )
    planned_t = rate * (t - delay)
    expected = planned_speed_at(planned_time, planned_speed, planned_t)
    is_planned = (planned_t >= 0) & (planned_t <= planned_time[-1])
    return Alignment(
        delay,
        correlation=speed_correlation(expected, w * is_planned),
        rate=rate,
        rate_error=errors[1],
        delay_error=errors[0],
        size=size,
        agreement=speed_correlation(expected[:stop], w[:stop]),
        middle=middle,
    )


def _motion_samples(speed: Array, threshold: float) -> tuple[int, int]:
    """Find the samples between which an axis moves.

    Parameters
    ----------
    speed : (n,) array
        Measured speed.
    threshold : float
        Speed above which the axis moves, in the unit of the speed.

    Returns
    -------
    first, stop : int
        Index of the first moving sample, and end of a slice with one sample after the last moving
        one. Both are n if the axis rests.
    """
    moving = np.flatnonzero(np.abs(speed) > threshold)
    if not len(moving):
        return len(speed), len(speed)
    return int(moving[0]), int(moving[-1]) + 2


def estimate_speed(
    plans: Sequence[tuple[Array, Array]], recordings: Sequence[tuple[Array, Array]]
) -> float:
    """Estimate the speed of execution as a multiple of the planned speed.

    A speed other than 1 must explain the recordings much better. A recording may belong to any of
    the plans.

    Parameters
    ----------
    plans : sequence of pairs
        Times (n,) in s and planned motor speeds (n,) in rad/s of each axis.
    recordings : sequence of pairs
        Times (m,) in s and measured motor speeds (m,) in rad/s of each axis.

    Returns
    -------
    float
        Speed of execution. It is 1 if the difference from the planned speed is not significant.
    """

    def costs(speed: float) -> list[float]:
        """Return how badly the best plan explains each recording.

        Parameters
        ----------
        speed : float
            Speed of execution, as a multiple of the planned speed.

        Returns
        -------
        list of float
            Share of the squared speed that the best plan does not explain, for each recording.
        """
        results = []
        for time, measured in recordings:
            matches = [match_speed(t, planned, time, measured, speed) for t, planned in plans]
            results.append(min(candidate.cost for candidate in matches))
        return results

    planned_costs = costs(1.0)
    if min(planned_costs) <= MAX_SIZE_DIFFERENCE**2:
        return 1.0
    mean_costs = {speed: float(np.mean(costs(speed))) for speed in CANDIDATE_SPEEDS.tolist()}
    speed = min(mean_costs, key=lambda speed: mean_costs[speed])
    cost = mean_costs[speed]
    planned_cost = float(np.mean(planned_costs))
    # The other speed must divide the unexplained share by four, or multiply the explained share by
    # four, because a recording of two motions leaves half of its squared speed unexplained.
    explains = 4 * cost < planned_cost or 1 - cost > max(
        4 * (1 - planned_cost), 1 - MIN_CLOCK_CORRELATION**2
    )
    return speed if explains and abs(speed - 1) > MAX_RATE_DIFFERENCE else 1.0


@frozen
class SpeedMatch:
    """Comparison of a measured speed with a plan that is executed at another speed."""

    delay: float
    """Time of the recording at which the plan explains the speed best, s."""
    cost: float
    """Smallest share of the squared speed that the plan does not explain, in either direction."""
    correlation: float
    """Correlation of largest magnitude. It is negative if the recording is reversed."""
    factor: float
    """Measured speed as a multiple of the planned speed, for the correlation."""


def match_speed(
    planned_time: Array, planned_speed: Array, time: Array, measured: Array, speed: float = 1.0
) -> SpeedMatch:
    """Find the delay at which a plan explains a recording best, by cross-correlation.

    Parameters
    ----------
    planned_time : (n,) array
        Instants of the plan, s.
    planned_speed : (n,) array
        Planned motor speeds, rad/s.
    time : (m,) array
        Instants of the recording, s.
    measured : (m,) array
        Measured motor speeds, rad/s.
    speed : float
        Speed of execution, as a multiple of the planned speed.

    Returns
    -------
    SpeedMatch
        Delay, cost and correlation. The delay is the start of the recorded motion if the recording
        is too short for a comparison.
    """
    # SciPy's signal module takes long to import, and other commands do not need it.
    from scipy.signal import correlate

    moving = np.flatnonzero(np.abs(measured) > END_SPEED_RATIO * np.abs(measured).max(initial=0.0))
    start, end = time[moving[[0, -1]]] if len(moving) else time[[0, 0]]
    duration = float(planned_time[-1]) / speed
    step = max(end - start, duration) * 2 / ALIGNMENT_SAMPLES
    # w and v are the measured and the planned speed at equal time steps.
    w = np.interp(np.arange(start, end, step), time, measured)
    v = speed * np.interp(speed * np.arange(0.0, duration, step), planned_time, planned_speed)
    if len(w) < 8 or not (w.any() and v.any()):
        return SpeedMatch(float(start), float(len(moving) > 0), 0.0, 1.0)
    product = correlate(w, v, method="fft")
    shifts = np.arange(1 - len(v), len(w))
    # `product` is the scalar product of w and the shifted v, and `energy` is the sum of the squares
    # of the part of v that overlaps w, for each shift.
    sums = np.append(0.0, np.cumsum(v**2))
    energy = sums[np.minimum(len(v), len(w) - shifts)] - sums[np.maximum(0, -shifts)]
    # A short overlap does not determine a correlation, so its energy counts as 0.1 % of the total.
    least_energy = np.maximum(energy, 1e-3 * sums[-1])
    total = float(w @ w)
    correlation = product / np.sqrt(least_energy * total)
    k = int(np.argmax(np.abs(correlation)))
    # |w − v|² and |w + v|² without the constant w·w. A recording that fits both directions equally
    # well does not count as reversed.
    errors = min(
        energy - 2 * product, energy + 2 * product + (1 - MIN_CLOCK_CORRELATION) * total, key=np.min
    )
    return SpeedMatch(
        delay=float(start + step * shifts[int(np.argmin(errors))]),
        cost=1 + float(errors.min()) / total,
        correlation=float(correlation[k]),
        factor=float((product / least_energy)[k]),
    )


def estimate_clock(axes: Sequence[Alignment], drift: float) -> Clock:
    """Estimate one clock from the alignments of all axes.

    Only axes whose measured speed agrees with the plan in shape and size determine the clock.
    Without such an axis, the axis with the best agreement determines the delay.

    Parameters
    ----------
    axes : sequence of Alignment
        Alignment of each axis.
    drift : float
        Smallest deviation of the rate from 1 that is corrected. The uncertainty of the rate is
        added.

    Returns
    -------
    Clock
        Start, rate and uncertainty. The rate is 1 if the estimate does not differ significantly
        from 1, or if the motion was executed more slowly.
    """
    reliable_axes = [axis for axis in axes if axis.determines_clock]
    reliable = reliable_axes or [max(axes, key=lambda axis: axis.agreement)]
    rate, error = _common_rate(reliable_axes) if reliable_axes else (1.0, np.inf)
    is_significant = abs(rate - 1) > drift + SIGNIFICANT_DEVIATIONS * error
    size = float(np.median([axis.size for axis in reliable]))
    slower = is_significant and abs(size - rate) < abs(size - 1)
    used_rate = rate if is_significant and not slower else 1.0
    delay = float(np.median([axis.delay_at(used_rate) for axis in reliable]))
    return Clock(delay, used_rate, rate, error, slower)


def _common_rate(axes: Sequence[Alignment]) -> tuple[float, float]:
    """Combine the rates of several axes into the rate of one clock.

    Parameters
    ----------
    axes : sequence of Alignment
        Alignments with finite errors of their rates.

    Returns
    -------
    rate : float
        Mean of the rates, weighted by 1 / error², or their median if they contradict each other.
    error : float
        Standard deviation of the weighted mean.
    """
    rates = [axis.rate for axis in axes]
    errors = np.array([axis.rate_error for axis in axes])
    weights = 1 / errors**2
    agree = np.ptp(rates) <= SIGNIFICANT_DEVIATIONS * errors.max()
    rate = np.average(rates, weights=weights) if agree else np.median(rates)
    return float(rate), float(1 / np.sqrt(weights.sum()))


def planned_speed_at(planned_time: Array, planned_speed: Array, t: Array) -> Array:
    """Interpolate the planned speed, which is 0 outside of the motion.

    Parameters
    ----------
    planned_time : (m,) array
        Instants of the plan, s.
    planned_speed : (m,) array
        Planned speed at these instants, in any unit.
    t : (n,) array
        Planned times, s.

    Returns
    -------
    (n,) array
        Planned speed at the times `t`.
    """
    return np.interp(t, planned_time, planned_speed, left=0.0, right=0.0)


def speed_correlation(x: Array, y: Array) -> float:
    """Return the correlation of two speeds, which is their normalized scalar product.

    Parameters
    ----------
    x, y : (n,) arrays
        Speeds at the same instants.

    Returns
    -------
    float
        Correlation from −1 to 1. It is 0 if one of the speeds is always 0.
    """
    size = float(np.linalg.norm(x) * np.linalg.norm(y))
    return float(x @ y) / size if size > 0 else 0.0


def _refine_alignment(
    start: float, planned_time: Array, planned_speed: Array, t: Array, w: Array
) -> tuple[float, float, float, tuple[float, float], float]:
    """Refine the alignment of a recording by Gauss–Newton steps.

    The model of the measured speed is size · v(rate · (t − delay)) with the planned speed v.
    Samples that deviate far from the plan are ignored.

    Parameters
    ----------
    start : float
        Coarse estimate of the delay, s.
    planned_time, planned_speed : (m,)
        Instants of the plan in s, and planned speeds in any unit.
    t, w : (n,)
        Instants of the recording in s, and measured speeds in the same unit.

    Returns
    -------
    delay : float
        Time of the recording at which the motion starts, s. It is `start` if the samples do not
        determine the model.
    rate, size : float
        The other parameters of the model.
    errors : (float, float)
        Standard deviations of delay (s) and rate, which are infinite without a result.
    middle : float
        Planned time at which the delay does not depend on the rate, s.
    """
    no_result = start, 1.0, 1.0, (np.inf, np.inf), 0.0
    acceleration = np.gradient(planned_speed, planned_time)
    cutoff = MAX_SPEED_DEVIATION * np.abs(planned_speed).max()
    duration = float(planned_time[-1])
    # The planned time of the middle sample is almost independent of the rate.
    middle = float(np.clip(np.mean(t) - start, 0.0, duration))
    centre = start + middle
    rate = 1.0
    size = 1.0
    for _ in range(12):
        planned_t = rate * (t - centre) + middle
        speed = planned_speed_at(planned_time, planned_speed, planned_t)
        derivative = size * planned_speed_at(planned_time, acceleration, planned_t)
        residual = w - size * speed
        is_used = (np.abs(residual) < cutoff) & ((speed != 0) | (derivative != 0))
        # Derivatives of the model by `centre`, rate and size
        jacobian = np.stack([-rate * derivative, derivative * (t - centre), speed], axis=1)[is_used]
        normal_matrix = jacobian.T @ jacobian
        if is_used.sum() < 8 or np.linalg.cond(normal_matrix) > 1e14:
            return no_result
        change = np.linalg.solve(normal_matrix, jacobian.T @ residual[is_used])
        rate = float(np.clip(rate + change[1], 1 - MAX_RATE_DIFFERENCE, 1 + MAX_RATE_DIFFERENCE))
        centre += float(change[0])
        size += float(change[2])
    errors = np.sqrt(np.diag(np.linalg.inv(normal_matrix)) * float(np.mean(residual[is_used] ** 2)))
    delay = centre - middle / rate

    speed_before = planned_speed_at(planned_time, planned_speed, t - start)
    speed_after = size * planned_speed_at(planned_time, planned_speed, rate * (t - delay))
    is_improved = np.sum((w - speed_after) ** 2) <= np.sum((w - speed_before) ** 2)
    if not is_improved or abs(delay - start) > 0.1 * duration:
        return no_result
    return delay, rate, size, (float(errors[0]), float(errors[1])), middle
