"""Measure time and error of the identification of the three rigs.

The error of the published parameters is the reference.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from ssm_planner.dynamics.transmission import motor_torque, output_effort
from ssm_planner.identification.identify import identify
from ssm_planner.identification.prediction import predict_recording
from ssm_planner.identification.recordings import read_recordings
from ssm_planner.identification.torque_map import TABLE_NAME, read_torque_map
from ssm_planner.loading.load import load_drive
from ssm_planner.reproduction import EXAMPLES_FOLDER
from tests.benchmarks.cases import ROOT
from tests.benchmarks.measuring import Spread, timed
from tests.benchmarks.section import Section

sys.path.append(str(EXAMPLES_FOLDER))
from paper_reproduction.friction import published_drive

RECORDINGS = "BENCH_RECORDINGS"
"""Environment variable with the folder of the rigs' recordings, which may be absent."""
NOT_HERE = "recordings not here"
RIGS = (
    ("rig1_lead_screw", "drive1_lead_screw"),
    ("rig2_antibacklash_screw", "drive2_antibacklash_screw"),
    ("rig3_worm", "drive3_worm"),
)


def run(quick: bool) -> Section:
    section = Section("Identification of the three rigs")
    folder = Path(os.environ[RECORDINGS])
    section.say(
        "Public recordings of an EPOS4 drive on three one-joint rigs. *Error* is the NRMSD of the motor torque: over the "
        "torque–velocity map that is fitted, and over the time of the start–stop recording. BAM (Better Actuator Models) "
        "identifies load-dependent, directional and Stribeck friction, too. Its model M5 has nine parameters, and is fitted "
        "here to the same points by least squares from twelve starts. Neither model is closer on all rigs. M5 does not use "
        "the geometry of worm or screw, and a single load per rig cannot separate its four load coefficients from its "
        "constant friction, so that it says little about other loads. The parameters that the rigs' authors "
        "published stand beside."
    )
    rows = []
    for rig, recorded in RIGS:
        drive = ROOT / "problems/drives" / f"{rig}.yaml"
        sources = [folder / recorded] if (folder / recorded).is_dir() else []
        seconds: list[float] = []
        result: dict[str, Any] = {}
        for _ in range(1 if quick else 3):
            took, result = timed(
                lambda drive=drive, sources=sources: identify(drive, sources).to_dict()
            )  # type: ignore[misc]
            seconds.append(took)
        fitted = [row["nrmsd"] for row in result["start_stop"]]
        published_map, published_motion = published_errors(drive, folder / recorded / "start_stop")
        rows.append(
            [
                rig,
                f"{result['points']} points, {len(fitted)} start–stop"
                if sources
                else f"{result['points']} points (table)",
                Spread.of(seconds).seconds(),
                f"{result['nrmsd']:.4f} ({result['law']})",
                f"{bam_error(drive):.4f}",
                f"{published_map:.4f}",
                Spread.of(fitted).text() if fitted else NOT_HERE,
                Spread.of(published_motion).text() if published_motion else NOT_HERE,
            ]
        )
    head = (
        "rig",
        "data",
        "our time",
        "map error",
        "by BAM's M5",
        "by published parameters",
        "start–stop error",
        "by published parameters",
    )
    section.table(head, rows)
    return section


def bam_error(file: Path) -> float:
    """Return the NRMSD of BAM's model M5, fitted to the map of figures.

    With the external torque e at the motor shaft, steady motion needs the motor torque
    τ = e + sign(w) f(τ, e, w), where f is the friction of M5.
    """
    drive = load_drive(file)
    assert drive.rig is not None
    data = read_torque_map(file.parent / TABLE_NAME, file.stem)
    external = drive.rig.F_payload / drive.ratio
    scale, fastest = float(np.abs(data.tau).max()), float(np.abs(data.w).max())
    upper = np.array([1, 1, 0.9, 0.9, 0.9, 0.9, 1, 1, 10.0])
    lower = np.array([0, 0, 0, 0, 0, 0, 0, 1e-3, 1.0])

    def torque(x: np.ndarray) -> np.ndarray:
        base, stribeck, by_load, by_motor, load_stribeck, motor_stribeck, viscous, speed, power = x
        fraction = np.abs(data.w) / fastest
        slow = np.exp(-((fraction / speed) ** power))
        tau = data.tau.copy()
        for _ in range(100):  # The friction depends on the torque that it changes.
            friction = scale * (base + slow * stribeck + viscous * fraction)
            friction += np.abs(by_load * external - by_motor * tau)
            friction += slow * np.abs(load_stribeck * external - motor_stribeck * tau)
            tau = (tau + external + np.sign(data.w) * friction) / 2
        return tau

    rng = np.random.default_rng(0)
    costs = [
        least_squares(
            lambda x: (torque(x) - data.tau) / scale,
            lower + (upper - lower) * rng.uniform(0.0, 0.6, len(lower)),
            bounds=(lower, upper),
            max_nfev=300,
        ).cost
        for _ in range(12)
    ]
    error = scale * np.sqrt(2 * min(costs) / len(data.tau))
    return float(error / np.ptp(data.tau))


def published_errors(file: Path, folder: Path) -> tuple[float, list[float]]:
    """Return the NRMSD of the rig authors' parameters over the map of figures and per recording.

    The list has one entry for every available start–stop recording.
    """
    drive = published_drive(load_drive(file))
    rig = drive.rig
    assert rig is not None
    data = read_torque_map(file.parent / TABLE_NAME, file.stem)
    effort = output_effort(drive, rig.F_payload, data.w / drive.ratio, 0.0)
    error = motor_torque(drive, effort, data.w, 0.0) - data.tau
    recordings = (
        read_recordings([folder], nominal_torque=rig.motor_nominal_torque, direction=rig.direction)
        if folder.is_dir()
        else []
    )
    motion = [
        predict_recording(drive, recording, rig.F_payload, rig.payload_inertia).nrmsd
        for recording in recordings
    ]
    return float(np.sqrt(np.mean(error**2)) / np.ptp(data.tau)), motion
