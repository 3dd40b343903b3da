"""Examine the order and the times of the recordings that an identification uses.

If the speeds of a session rise or fall with time, a change of friction with time (by warming up,
for example) cannot be told from a dependence of friction on speed.
"""

from collections.abc import Sequence
from datetime import datetime, timezone
from itertools import pairwise

import numpy as np

from ssm_planner.identification.recordings import Recording
from ssm_planner.typing import Array

FEWEST = 5
"""Smallest number of dated recordings whose order is examined."""
ORDERED = 0.5
"""Rank correlation of speed and time above which a session counts as ordered by speed."""
PAUSE = 1800.0
"""Time between two recordings above which the drive may have cooled down, s."""


def session_notes(steady: Sequence[Recording], moving: Sequence[Recording]) -> tuple[str, ...]:
    """Return remarks on the order of recordings and on pauses between them.

    Recordings without a date in their header are ignored.

    Parameters
    ----------
    steady : sequence of Recording
        Recordings at constant speed.
    moving : sequence of Recording
        Recordings with starts and stops.
    """
    notes = []
    dated = [(time, recording) for recording in steady if (time := _time(recording)) is not None]
    times = np.array([time for time, _ in dated])
    speeds = np.array([abs(float(recording.w.mean())) for _, recording in dated])
    if len(times) >= FEWEST:
        correlation = _rank_correlation(times, speeds)
        if abs(correlation) > ORDERED:
            order = "rise" if correlation > 0 else "fall"
            notes.append(
                f"the speeds of the recordings {order} with time (rank correlation "
                f"{correlation:.2f}): a change of friction during the session cannot be told from "
                "its dependence on speed, and no interval includes it. Record the speeds in random "
                "order"
            )
    everything = sorted(
        (time, recording.name)
        for recording in (*steady, *moving)
        if (time := _time(recording)) is not None
    )
    for (before, _), (after, name) in pairwise(everything):
        if after - before > PAUSE:
            notes.append(
                f"{name} was recorded {_duration(after - before)} after the recordings before it: "
                "the drive may have cooled down or changed in between"
            )
    return tuple(notes)


def _time(recording: Recording) -> float | None:
    """Return the time of the recording's date in s. None without a valid date."""
    date = recording.header.get("date", "")[: len("2020-07-06 15:29:47")]
    try:
        # The drive states no time zone. UTC makes the differences the same on every computer.
        return datetime.fromisoformat(date).replace(tzinfo=timezone.utc).timestamp()
    except ValueError:
        return None


def _rank_correlation(a: Array, b: Array) -> float:
    """Return Spearman's rank correlation of two quantities (n,). It is 0 if one is constant."""
    from scipy.stats import spearmanr

    if not (np.ptp(a) and np.ptp(b)):
        return 0.0
    return float(spearmanr(a, b).statistic)


def _duration(seconds: float) -> str:
    """Describe a duration of minutes, hours or days."""
    for unit, size in (("days", 86400.0), ("hours", 3600.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds / 60:.0f} minutes"
