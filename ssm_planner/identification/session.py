"""Examine the order and the times of the recordings that an identification uses.

If the speeds of a session rise or fall with time, a change of friction with time (by warming up,
for example) cannot be told from a dependence of friction on speed.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from ssm_planner.identification.recordings import Recording
from ssm_planner.identification.torque_map import TorqueMap
from ssm_planner.typing import Array

FEWEST_DATED_RECORDINGS = 5
"""Smallest number of dated recordings whose order is examined."""
ORDERED_CORRELATION = 0.5
"""Magnitude of the rank correlation of |speed| and time above which a session counts as ordered."""
LONG_PAUSE = 1800.0
"""Time between two recordings above which the drive may have cooled down, s."""


def session_progress(times: Array) -> Array:
    """Return the times of recordings as shares of their session, from 0 to 1.

    A pause longer than `LONG_PAUSE` counts as `LONG_PAUSE`. The shares are the times at which a
    change of friction during the session is evaluated, see `MapModel.change`.

    Parameters
    ----------
    times : (recordings,) array
        Time of each recording (s since 1970). NaN without a date.

    Returns
    -------
    (recordings,) array
        Shares, 0 for the first and 1 for the last recording. They are NaN without a date, and for
        all recordings if fewer than `FEWEST_DATED_RECORDINGS` have a date or if all dates are
        equal.
    """
    share = np.full(len(times), np.nan)
    order = np.argsort(times)[: np.isfinite(times).sum()]
    if len(order) >= FEWEST_DATED_RECORDINGS and np.ptp(times[order]):
        gaps = np.diff(times[order], prepend=times[order[0]])
        elapsed = np.cumsum(np.minimum(gaps, LONG_PAUSE))
        share[order] = elapsed / elapsed[-1]
    return share


def session_notes(data: TorqueMap, moving: Sequence[Recording]) -> Iterator[str]:
    """Yield notes on the order of recordings, on missing dates, and on pauses.

    Parameters
    ----------
    data : TorqueMap
        Map of the recordings at constant speed.
    moving : sequence of Recording
        Recordings with starts and stops.

    Yields
    ------
    str
        One sentence for each finding.
    """
    is_dated = np.isfinite(data.times)
    if is_dated.sum() < FEWEST_DATED_RECORDINGS:
        yield (
            "too few recordings have a date: a change of friction during the session cannot be told "
            "from its dependence on speed, and no interval includes it"
        )
    else:
        correlation = _rank_correlation(data.times[is_dated], np.abs(data.w[is_dated]))
        if abs(correlation) > ORDERED_CORRELATION:
            order = "rise" if correlation > 0 else "fall"
            yield (
                f"the speeds of the recordings {order} with time (rank correlation "
                f"{correlation:.2f}): a change of friction during the session cannot be told from "
                "its dependence on speed, and widens the intervals. Record the speeds in random "
                "order"
            )
    recorded = list(zip(data.times.tolist(), data.names, strict=True))
    recorded += [(recording.date, recording.name) for recording in moving]
    dated = sorted((time, name) for time, name in recorded if np.isfinite(time))
    for (earlier_time, _), (later_time, name) in pairwise(dated):
        pause = later_time - earlier_time
        if pause > LONG_PAUSE:
            yield (
                f"{name} was recorded {_duration_text(pause)} after the recordings before it: the "
                "drive may have cooled down or changed in between"
            )


def _rank_correlation(a: Array, b: Array) -> float:
    """Compute Spearman's rank correlation of two quantities.

    Parameters
    ----------
    a, b : (n,) arrays
        Values of both quantities.

    Returns
    -------
    float
        1 if both quantities always rise together, −1 if one always falls when the other rises, and
        0 if one of them is constant.
    """
    from scipy.stats import spearmanr  # It takes long to import.

    if not (np.ptp(a) and np.ptp(b)):
        return 0.0
    return float(spearmanr(a, b).statistic)


def _duration_text(seconds: float) -> str:
    """Describe a duration in minutes, hours or days.

    Parameters
    ----------
    seconds : float
        Duration, s.

    Returns
    -------
    str
        Text such as "3 hours". The unit is the largest one that the duration contains at least
        twice, or minutes.
    """
    for unit, size in (("days", 86400.0), ("hours", 3600.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds / 60:.0f} minutes"
