"""Clocks of a playback: the time of the machine, or a simulated time that never waits."""

from __future__ import annotations

import time


class RealClock:
    """The monotonic clock of the machine. Changes of the time of day do not affect it."""

    def now(self) -> float:
        """Return the present instant, s."""
        return time.monotonic()

    def wait(self, seconds: float) -> None:
        """Wait."""
        if seconds > 0:
            time.sleep(seconds)


class SimulatedClock:
    """A clock that advances by exactly the time that somebody waits."""

    def __init__(self) -> None:
        """Start at 0."""
        self.time = 0.0

    def now(self) -> float:
        """Return the present instant, s."""
        return self.time

    def wait(self, seconds: float) -> None:
        """Advance the clock."""
        self.time += max(seconds, 0.0)


Clock = RealClock | SimulatedClock
