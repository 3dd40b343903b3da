"""Recordings of the three test rigs: real ones if they are beside the project, or synthetic ones.

The synthetic recordings have the files, speeds, format and faults of the real ones. Their torque
follows the friction law with the identified parameters, a ripple in phase with the motor angle, a
scatter from file to file, and noise. Tests read them where the real ones are missing.
"""

from __future__ import annotations

import atexit
import shutil
import tempfile
from pathlib import Path

import numpy as np

from ssm_planner.identification.prediction import RecordedMotion, law_correction, predict_torque
from ssm_planner.loading.load import load_drive
from ssm_planner.problem.drive import Drive
from tests.support.paths import RESULTS, SHARED

SAMPLES = 500
RPM = 2 * np.pi / 60
SPEEDS = (1, 2, 4, 6, 8, 10, 13, 17, 20, 25, 40, 50, 60, 80, 90, 100, 140, 180, 200)
RIGS = {
    "drive1_lead_screw": ("rig1_lead_screw", (2, 10, 20, *SPEEDS[10:]), 50),
    "drive2_antibacklash_screw": ("rig2_antibacklash_screw", (10, 20, *SPEEDS[10:]), 50),
    "drive3_worm": ("rig3_worm", SPEEDS, 10),
}
"""Drive file, speeds of the steady recordings and speed of the start-stop recording, rpm."""
EDITED = {"drive3_worm": ("1", "2", "n1")}
"""Recordings whose first torque sample was overwritten by hand, as in the real files."""
SCATTER, RIPPLE, NOISE = 0.01, 0.08, 0.06
"""Standard deviations from file to file, of the ripple, and of single samples, as fractions."""
TURNS = 12.0
"""Number of motor turns in a recording, as far as its sampling period allows."""
HEADER = """Date:;2020-07-06 12:00:00
Firmware Version:;0x0120;0x6150;0x0000;0x0000
EPOS Studio Version:;3.6.1.0
Index:;0x30D3;0x30D2;0x0000;0x0000
Subindex:;0x01;0x01;0x00;0x00
Max. samples:;500
Recorded samples:;500
Sampling period:;{period:.3f}
;Velocity actual value averaged;Torque actual value averaged
ms;rpm;%"""


def write_recordings(folder: Path) -> Path:
    """Write synthetic recordings of all three rigs below a folder, and return the folder."""
    rng = np.random.default_rng(2020)
    for rig, (name, speeds, moving) in RIGS.items():
        drive = load_drive(RESULTS / name / f"{name}.yaml")
        for speed in (*speeds, *(-speed for speed in speeds)):
            file = folder / rig / "steady_state" / f"{speed}.csv".replace("-", "n")
            period = float(np.clip(TURNS * 60.0 / abs(speed) / SAMPLES, 0.0064, 0.256))
            time = period * np.arange(SAMPLES)
            w = speed * RPM * (1 + 0.06 * rng.uniform(-1, 1, SAMPLES))
            steady = np.full(SAMPLES, speed * RPM)
            _write(file, drive, time, (w, steady), rng, edited=file.stem in EDITED.get(rig, ()))
        time = 0.04 * np.arange(SAMPLES)
        w = moving * RPM * np.select([time < 2, time < 9, time < 12, time < 19], [0, 1, 0, -1], 0)
        _write(folder / rig / "start_stop" / f"{moving}.csv", drive, time, (w, w), rng)
    return folder


def _write(
    file: Path,
    drive: Drive,
    time: np.ndarray,
    speeds: tuple[np.ndarray, np.ndarray],
    rng: np.random.Generator,
    *,
    edited: bool = False,
) -> None:
    """Write one recording.

    `speeds` holds the recorded speed and the speed that determines the torque.
    """
    rig, (w, smooth) = drive.rig, speeds
    assert rig is not None
    motion, load = RecordedMotion.from_speed(time, smooth), rig.F_payload + rig.load_offset
    tau = predict_torque(drive, motion, load, rig.payload_inertia)
    tau = tau + law_correction(drive, motion, load)
    angle = np.cumsum(w) * (time[1] - time[0])
    wave = np.sqrt(2) * RIPPLE * np.cos(angle + rng.uniform(0, 2 * np.pi))
    size = np.abs(tau).mean() * (smooth != 0)
    tau = tau * (1 + SCATTER * rng.standard_normal())
    tau = tau + size * (wave + NOISE * rng.standard_normal(len(tau)))
    sign = rig.direction
    percent = 100 * sign * tau / rig.motor_nominal_torque
    rpm = np.round(sign * w / RPM)
    rows = [f"{1e3 * t:.3f};{v:.0f};{p:.1f}" for t, v, p in zip(time, rpm, percent, strict=True)]
    lines = [*HEADER.format(period=1e3 * (time[1] - time[0])).splitlines(), *rows]
    if edited:
        t, v, p = rows[0].split(";")
        lines[-SAMPLES] = f"{t};{v};-400,,was {p}"
        lines = [line if "was" in line else f"{line},," for line in lines]
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("\r\n".join(lines) + "\r\n", encoding="utf-8-sig")


def _synthetic() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="recordings"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return write_recordings(folder)


REAL = (SHARED / "recordings").is_dir()
"""True if the real recordings are beside the project."""
RECORDINGS = SHARED / "recordings" if REAL else _synthetic()
"""Folder of recordings, by rig and kind."""
