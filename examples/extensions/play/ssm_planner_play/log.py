"""Record what the drives did, in the format that `ssm-planner compare` reads."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.atomic import replacing
from ssm_planner.typing import Array
from ssm_planner_play.program import Program

CHANNELS = (
    "Velocity actual value averaged",
    "Torque actual value averaged",
    "Position actual value",
)
"""Names of the channels in a recording of the EPOS recorder."""


class Log:
    """Measurements of all axes, and what happened."""

    def __init__(self, program: Program, spare: int) -> None:
        """Reserve memory for all set points of a program and `spare` more."""
        self.program = program
        self.count = 0
        self._values = np.zeros((len(program.rows) + spare, 1 + 3 * len(program.axes)))
        self.events: list[dict[str, Any]] = []

    def add(self, time: float, measured: Array) -> None:
        """Add one row: the instant (s), and position, velocity and torque (m, 3) of all axes."""
        if self.count < len(self._values):
            self._values[self.count, 0] = time
            self._values[self.count, 1:] = measured.reshape(-1)
            self.count += 1

    def event(self, time: float, text: str) -> None:
        """Add an event."""
        self.events.append({"time_s": round(time, 6), "event": text})

    def write(self, folder: Path, outcome: dict[str, Any]) -> list[Path]:
        """Write one recording per axis and play.json, and return their paths."""
        folder.mkdir(parents=True, exist_ok=True)
        values = self._values[: self.count]
        paths = []
        for k, axis in enumerate(self.program.axes):
            position, velocity, torque = values[:, 1 + 3 * k : 4 + 3 * k].T
            rows = np.column_stack([1000 * values[:, 0], velocity / 1000, torque / 10, position])
            header = (
                f"Firmware Version:;ssm-planner-play\nRecorded samples:;{self.count}\n"
                f"Sampling period:;{1000 * self.program.period:.3f}\n"
                f";{';'.join(CHANNELS)}\nms;rpm;%;inc"
            )
            path = folder / f"{axis.name}.csv"
            with replacing(path) as temporary:
                np.savetxt(
                    temporary,
                    rows,
                    fmt=("%.3f", "%.3f", "%.1f", "%d"),
                    delimiter=";",
                    header=header,
                    comments="",
                )
            paths.append(path)
        path = folder / "play.json"
        with replacing(path) as temporary:
            text = json.dumps({**outcome, "events": self.events}, indent=1)
            temporary.write_text(text + "\n", encoding="utf-8")
        return [*paths, path]
