"""Compile the exported guard with the compiler of this machine, and call it by ctypes."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

from ssm_planner.errors import ExportError
from ssm_planner.formats.c import ROBOT_FILE, robot_code
from ssm_planner.plans import Plan
from ssm_planner.typing import Array
from ssm_planner_guard.export import FILE, c_guard
from ssm_planner_guard.thresholds import Thresholds
from ssm_planner_guard.twin import Alarm, Cause, Guard, Sample

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared")
"""Options of the compiler. Without contraction, C and Python round in the same way."""
SECONDS = 120
"""Time after which a compiler counts as broken, s."""
Row = ctypes.c_double * 4


class _Measured(ctypes.Structure):
    """The struct `ssm_guard_sample`."""

    _fields_ = [(name, Row) for name in ("time", "q", "qd", "tau")]


class NativeGuard:
    """The guard in C. It has the methods and the results of `Guard`."""

    def __init__(self, plan: Plan, thresholds: Thresholds, compiler: str | None = None) -> None:
        """Compile the guard.

        Parameters
        ----------
        plan : Plan
        thresholds : Thresholds
        compiler : str, optional
            C compiler. The default is that of the variable CC, or cc.

        Raises
        ------
        ExportError
            If no compiler exists, or if it fails.
        """
        self.thresholds = thresholds
        self.alarm: Alarm | None = None
        self._state = _state_of(thresholds.rows)
        self._sample = _Measured()
        self._reference = [Row() for _ in range(3)]
        library = _compiled(plan, thresholds, compiler)
        self._start = library.ssm_guard_start
        self._start.argtypes = (ctypes.c_void_p,)
        self._tick = library.ssm_guard_tick
        self._tick.argtypes = (
            ctypes.c_void_p,
            ctypes.c_double,
            *(ctypes.c_void_p,) * 3,
            ctypes.c_void_p,
        )
        self.restart()

    def restart(self) -> None:
        """Forget the alarm and all measurements."""
        self.alarm = None
        self._start(ctypes.byref(self._state))

    def tick(
        self, time: float, reference: tuple[Array, Array, Array, Array], sample: Sample
    ) -> Alarm | None:
        """Judge one tick like `Guard.tick`. The torques of the reference are computed in C."""
        for row, values in zip(self._reference, reference, strict=False):
            row[:] = values.tolist()
        for name, values in vars(sample).items():
            getattr(self._sample, name)[:] = values.tolist()
        pointers = [ctypes.byref(row) for row in self._reference]
        cause = self._tick(ctypes.byref(self._state), time, *pointers, ctypes.byref(self._sample))
        if cause != Cause.NONE and self.alarm is None:
            state = self._state
            self.alarm = Alarm(Cause(cause), state.joint, state.value, state.bound)
        return self.alarm


def _state_of(rows: int) -> ctypes.Structure:
    """Return an empty struct `ssm_guard` with a number of rows."""

    class State(ctypes.Structure):
        """The struct `ssm_guard`."""

        _fields_ = [
            ("cause", ctypes.c_int),
            ("joint", ctypes.c_int),
            ("value", ctypes.c_double),
            ("bound", ctypes.c_double),
            ("time", ctypes.c_double),
            ("ticks", ctypes.c_ulong),
            ("rows", Row * 6 * rows),
        ]

    return State()


def guard_of(plan: Plan, thresholds: Thresholds) -> tuple[Guard | NativeGuard, str]:
    """Return the guard in C, or the guard in Python if no compiler works, and a note on it."""
    try:
        return NativeGuard(plan, thresholds), "guard in C"
    except ExportError as error:
        return Guard(thresholds), f"guard in Python: {error}"


def _compiled(plan: Plan, thresholds: Thresholds, compiler: str | None) -> ctypes.CDLL:
    """Compile the functions of the robot and the guard. Raises ExportError."""
    command = compiler or os.environ.get("CC") or "cc"
    if shutil.which(command) is None:
        raise ExportError(f"no C compiler {command!r} on this machine")
    with TemporaryDirectory() as name:
        folder = Path(name)
        pairs = {
            ROBOT_FILE: robot_code(plan.robot),
            FILE: c_guard(thresholds, f"Plan {plan.sha256}."),
        }
        for stem, texts in pairs.items():
            for ending, text in zip("hc", texts, strict=True):
                (folder / f"{stem}.{ending}").write_text(text, encoding="utf-8")
        library = folder / "guard.so"
        sources = [str(folder / f"{stem}.c") for stem in pairs]
        words = [command, *FLAGS, *sources, "-o", str(library), "-lm"]
        try:
            done = subprocess.run(words, capture_output=True, text=True, timeout=SECONDS)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise ExportError(f"the C compiler {command!r} does not work: {error}") from error
        if done.returncode:
            raise ExportError(f"the C compiler {command!r} fails: {done.stderr[:200]}")
        try:
            return ctypes.CDLL(str(library))
        except OSError as error:
            raise ExportError(f"the compiled guard cannot be loaded: {error}") from error
