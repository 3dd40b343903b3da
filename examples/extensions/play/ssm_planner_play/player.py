"""Play a program on drives: one set point per period, a guard, and a soft stop on the path."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass

import numpy as np
from ssm_planner_guard import Guard, NativeGuard, Sample

from ssm_planner.typing import Array
from ssm_planner.units import rpm
from ssm_planner_play.client import (
    CSP,
    RESET,
    SYNC,
    Drive,
    DriveError,
    Interrupted,
    Link,
    disable_all,
)
from ssm_planner_play.log import Log
from ssm_planner_play.program import PlayError, Program, Rows
from ssm_planner_play.stops import StopTable

START_TOLERANCE = 2
"""Largest distance from the start of the plan, increments: rounding of target and measurement."""
LATE_SHARE = 0.5
"""Lateness from which a SYNC counts as late, as a share of the period.

Such a SYNC is closer to the instant of the next one than to its own.
"""
STREAMED = (0x607A, 0x60B1, 0x60B2)
"""Objects of a set point: target position, velocity offset and torque offset."""


@dataclass
class Outcome:
    """Result of a playback."""

    finished: bool = False
    """True if the drives reached the end of the plan, and no alarm occurred."""
    cause: str | None = None
    """Reason for an early end."""
    sent: int = 0
    """Number of set points that were sent."""
    late: int = 0
    """Number of set points whose SYNC was late."""
    latest_s: float = 0.0
    """Largest lateness, s."""
    stop_row: int | None = None
    """Row of the stream at which the controlled stop began."""
    disabled: bool = True
    """True if every drive has confirmed that it is disabled."""

    def to_dict(self) -> dict[str, object]:
        """Return the fields as JSON types."""
        return asdict(self)


class StopRequest:
    """A request to stop, which a signal handler or another thread may set."""

    def __init__(self) -> None:
        """Start without a request."""
        self.cause: str | None = None

    def set(self, cause: str) -> None:
        """Request a stop. Only the first cause counts."""
        self.cause = self.cause or cause

    def check(self) -> None:
        """Raise Interrupted if a stop is requested before the motion has started."""
        if self.cause is not None:
            raise Interrupted(f"{self.cause} before the motion started: nothing has moved")


class _Paused(Exception):
    """No set point could be sent for longer than the permitted lag."""


class Player:
    """Plays one program on one set of drives."""

    def __init__(
        self,
        program: Program,
        stops: StopTable,
        guard: Guard | NativeGuard,
        link: Link,
        drives: Sequence[Drive],
    ) -> None:
        """Prepare a playback. Nothing is sent."""
        self.program, self.stops, self.guard = program, stops, guard
        self.link, self.drives = link, drives
        self.request = StopRequest()
        self.outcome = Outcome()
        # After the last set point, the drives have this many periods to arrive.
        self.settling = guard.thresholds.rows
        spare = len(stops.rows) // max(len(stops.first) - 1, 1) + 4 * self.settling
        self.log = Log(program, spare + int(stops.longest / program.period) + 1)
        # Computed before the drives expect heartbeats.
        self._reference = program.reference(program.rows)
        self._begin = 0.0
        self._last: float | None = None
        self._targets = program.rows.counts[0]
        self._holding = False

    # --- before the motion ------------------------------------------------------------------------

    def inspect(self) -> list[str]:
        """Read the drives without writing anything, and return all differences from the export."""
        sentences = []
        for drive in self.drives:
            self.request.check()
            drive.require_at_rest()
            sentences += drive.differences(written=False)
        return sentences

    def set_up(self) -> None:
        """Write the settings of all drives and compare what the drives report.

        The drives stay disabled. Raises PlayError with all differences.
        """
        for drive in self.drives:
            self.request.check()
            drive.set_up()
        self.request.check()
        sentences = [sentence for drive in self.drives for sentence in drive.differences()]
        if sentences:
            raise PlayError("\n".join(sentences))

    def require_start(self) -> None:
        """Raise PlayError unless every axis stands at the first set point."""
        for k, drive in enumerate(self.drives):
            self.request.check()
            position, start = drive.position, int(self.program.rows.counts[0, k])
            if abs(position - start) > START_TOLERANCE:
                raise PlayError(
                    f"{drive} stands at {position} increments, but the plan starts at {start}: "
                    "move the arm to the start of the plan and home it there (--home)"
                )

    def run(self, home: bool = False) -> Outcome:
        """Enable the drives, play the program, and disable the drives in any case.

        Parameters
        ----------
        home : bool
            Declare first that all axes stand at the start of the plan.

        Returns
        -------
        Outcome
            What happened. Errors of drives and bus are part of it.
        """
        try:
            self._arm(home)
            with _without_garbage_collection():
                self._stream()
        except (DriveError, PlayError) as error:
            self._add_cause(str(error))
        finally:
            self._disarm()
        self.outcome.finished = self.outcome.cause is None and self.outcome.disabled
        return self.outcome

    def _arm(self, home: bool) -> None:
        """Enable all drives at their present positions."""
        for drive in self.drives:
            self.request.check()
            drive.expect_heartbeat()
            self.link.beating = True
            self.link.send(0, bytes([RESET["operational"], drive.node_id]))
            if home:
                drive.home()
        self.require_start()
        for k, drive in enumerate(self.drives):
            self.request.check()
            drive.write((0x607A, 0), int(self.program.rows.counts[0, k]))
            drive.set_mode(CSP)
            drive.enable()
            drive.require_reports()
        self.request.check()

    def _disarm(self) -> None:
        """Disable all drives, whatever has happened."""
        sentences = disable_all(self.drives)
        self.link.beating = False
        if sentences:
            self.outcome.disabled = False
            for sentence in sentences:
                self._add_cause(sentence)
            return
        for drive in self.drives:
            try:
                drive.forget_heartbeat()
            except DriveError:
                return  # a disabled drive that has lost the bus is in fault, which is safe

    # --- the motion -------------------------------------------------------------------------------

    def _stream(self) -> None:
        """Send all set points. A request or an alarm replaces the rest by a controlled stop."""
        due = self._start_measuring()
        program = self.program
        rows, reference = program.rows, self._reference
        row = 0
        while row < len(rows) + self.settling:
            index = min(row, len(rows) - 1)
            try:
                due = self._cycle(due, rows, index)
                self._supervise(tuple(column[index] for column in reference))
            except _Paused:
                # The drives stand already. They must not jump back to the speed of the motion.
                self._note_pause()
                rows, row, due = self._held(), 0, self.link.clock.now()
                reference = program.reference(rows)
                continue
            row += 1
            stop = self._stop_after(index) if rows is program.rows else None
            if stop is not None and row <= len(rows):
                self._note_stop(index)
                rows, row = stop, 0
                reference = program.reference(rows)
        self._finish(rows)

    def _has_paused(self) -> bool:
        """Return true if the latest SYNC is older than the permitted lag."""
        lag = self.guard.thresholds.lag
        return self._last is not None and self.link.clock.now() - self._last > lag

    def _note_pause(self) -> None:
        """Store that this program has paused, and let the drives hold their last set points."""
        text = f"this program paused for more than {1000 * self.guard.thresholds.lag:g} ms"
        self._add_cause(f"{text}: the drives hold their last set points")
        self._holding = True
        self._last = self.link.clock.now()

    def _held(self) -> Rows:
        """Return the latest targets as set points at rest."""
        counts = np.array([self._targets])
        return Rows(counts, np.zeros_like(counts), np.zeros_like(counts))

    def _start_measuring(self) -> float:
        """Take the present positions as the first measurements.

        Returns the instant of the first SYNC.
        """
        positions = [drive.position for drive in self.drives]
        now = self.link.clock.now()
        for drive, position in zip(self.drives, positions, strict=True):
            drive.values |= {0x6064: position, 0x606C: 0, 0x6077: 0}
            drive.measured = drive.synced = now
        self._begin = now + self.program.period
        return self._begin

    def _supervise(self, point: tuple[Array, Array, Array, Array]) -> None:
        """Compare the latest measurements with a set point, and look at the states of the drives.

        An alarm requests a stop. Raises DriveError if a drive no longer executes the motion.
        """
        if self.guard.alarm is None and not self._holding:
            alarm = self.guard.tick(self._last_time(), point, self._sample())
            if alarm is not None and alarm.stalled:
                raise _Paused
            if alarm is not None and self.request.cause is not None:
                self._add_cause(f"alarm: {alarm}")  # the stop has begun already
            elif alarm is not None:
                self.request.set(f"alarm: {alarm}")
        for drive in self.drives:
            trouble = drive.trouble
            if trouble is not None:
                raise DriveError(f"{trouble}: all drives are disabled at once")

    def _stop_after(self, row: int) -> Rows | None:
        """Return the set points of the requested stop after a row, or None.

        The result is also None if no stop begins at this row.
        """
        if self.request.cause is None:
            return None
        stop = self.stops.stop_at(row)
        if stop is not None and len(stop) == 0:  # all joints rest
            counts = self.program.rows.counts[row : row + 1]
            return Rows(counts, np.zeros_like(counts), np.zeros_like(counts))
        return stop

    def _add_cause(self, text: str) -> None:
        """Add a reason for the early end. A controlled stop may end early too."""
        cause = self.outcome.cause
        self.outcome.cause = text if cause is None else f"{cause}\nthen: {text}"
        self.log.event(self._last_time(), text)

    def _note_stop(self, row: int) -> None:
        """Store where a controlled stop begins."""
        self.outcome.stop_row = row
        self._add_cause(f"{self.request.cause}: controlled stop on the path from row {row}")

    def _finish(self, rows: Rows) -> None:
        """Check that all drives have reached their last target."""
        self.link.drain()
        bound = self.guard.thresholds.position_margin
        for k, drive in enumerate(self.drives):
            axis = drive.axis
            distance = abs(drive.values[0x6064] - int(rows.counts[-1, k]))
            if distance > bound[axis.index] * abs(axis.per_unit):
                self._add_cause(f"{drive} ends {distance} increments away from its target")
        if self.request.cause is not None and self.outcome.cause is None:
            self._add_cause(f"{self.request.cause} when the motion had ended")

    def _cycle(self, due: float, rows: Rows, index: int) -> float:
        """Send one set point and its SYNC at the instant `due`. Returns the next such instant."""
        link, period = self.link, self.program.period
        for k, drive in enumerate(self.drives):
            values = (int(column[index, k]) for column in (rows.counts, rows.velocity, rows.torque))
            drive.send(dict(zip(STREAMED, values, strict=True)))
        if due - link.clock.now() > 2 * period:
            raise DriveError("the clock jumped back: all drives are disabled at once")
        link.receive(due)
        link.drain()
        if self._has_paused() and not self._holding:
            raise _Paused
        link.send(SYNC)
        self._targets = rows.counts[index]
        sent = link.clock.now()  # a full bus may have kept the message until now
        measured = [
            [drive.values[name] for name in (0x6064, 0x606C, 0x6077)] for drive in self.drives
        ]
        # The measurements belong to the SYNC before.
        before = sent - period if self._last is None else self._last
        self.log.add(before - self._begin, np.array(measured, dtype=float))
        for drive in self.drives:
            drive.synced = sent
        self._last = sent
        late = sent - due
        self.outcome.sent += 1
        self.outcome.latest_s = max(self.outcome.latest_s, late)
        if late > LATE_SHARE * period:
            # A late set point delays the rest: a drive must never get two of them at once.
            self.outcome.late += 1
            return sent + period
        return due + period

    def _last_time(self) -> float:
        """Instant of the latest SYNC since the first one, s."""
        return 0.0 if self._last is None else self._last - self._begin

    def _sample(self) -> Sample:
        """Return the latest measurements on the side of the joints."""
        time, q, qd, tau = (np.zeros(4) for _ in range(4))
        for drive in self.drives:
            axis, values = drive.axis, drive.values
            time[axis.index] = drive.measured - self._begin
            q[axis.index] = values[0x6064] / axis.per_unit
            qd[axis.index] = axis.direction * values[0x606C] * rpm / 1000 / axis.ratio
            tau[axis.index] = axis.direction * values[0x6077] * axis.rated_torque / 1000
        return Sample(time, q, qd, tau)


@contextmanager
def _without_garbage_collection() -> Iterator[None]:
    """Keep the collector from delaying set points."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
