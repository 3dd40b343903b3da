"""Identification of the three rigs: time, and error beside that of the published parameters."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.dynamics.transmission import motor_torque, output_effort
from ssm_planner.identification.identify import identify
from ssm_planner.identification.prediction import predict_recording
from ssm_planner.identification.recordings import read_recordings
from ssm_planner.identification.torque_map import TABLE, read_figures
from ssm_planner.loading.load import load_drive
from ssm_planner.paper.friction import published_drive
from tests.benchmarks.cases import ROOT
from tests.benchmarks.measuring import Spread, timed
from tests.benchmarks.section import Section

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
        "torque–velocity map that is fitted, and over the time of the start–stop recording. BAM "
        "(better-actuator-models) also fits load-dependent, directional and Stribeck friction, and is not measured here; "
        "the parameters that the rigs' authors published stand beside."
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
        "by published parameters",
        "start–stop error",
        "by published parameters",
    )
    section.table(head, rows)
    return section


def published_errors(file: Path, folder: Path) -> tuple[float, list[float]]:
    """NRMSD of the rig authors' parameters: over the map of figures, and of every start–stop recording that is here."""
    drive = published_drive(load_drive(file))
    rig = drive.rig
    assert rig is not None
    data = read_figures(file.parent / TABLE, file.stem)
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
