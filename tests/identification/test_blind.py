"""Bands on recordings that the fit has not seen, over splits of whole files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ssm_planner.identification.fit import fit_map
from ssm_planner.identification.prediction import predict_recording
from ssm_planner.identification.recordings import read_recordings
from ssm_planner.identification.torque_map import torque_map
from ssm_planner.loading.load import load_drive

DRIVES = Path(__file__).parents[2] / "problems" / "drives"
RECORDINGS = Path(__file__).parents[3] / "shared" / "recordings"
RIGS = {
    "rig1_lead_screw": ("drive1_lead_screw", 0.035),
    "rig2_antibacklash_screw": ("drive2_antibacklash_screw", 0.035),
    "rig3_worm": ("drive3_worm", 0.045),
}
needs_recordings = pytest.mark.skipif(not RECORDINGS.is_dir(), reason="the recordings are not beside the project")


def recordings_of(rig: str, kind: str):
    drive = load_drive(DRIVES / f"{rig}.yaml")
    folder = RECORDINGS / RIGS[rig][0] / kind
    return drive, read_recordings(
        [folder], nominal_torque=drive.rig.motor_nominal_torque, direction=drive.rig.direction
    )


def split(recordings, count: int, seed: int):
    """A random part of the recordings with both directions, and the others."""
    rng = np.random.default_rng(seed)
    while True:
        order = rng.permutation(len(recordings))
        chosen = [recordings[k] for k in order[:count]]
        if abs(sum(np.sign(r.w.mean()) for r in chosen)) <= count - 2 * max(2, count // 3):
            return chosen, [recordings[k] for k in order[count:]]


def predicted(drive, fitted, blind):
    fit = fit_map(drive, torque_map(fitted), drive.rig.F_payload, reference=drive.rig.published)
    return [predict_recording(fit.drive, r, fit.load, drive.rig.payload_inertia) for r in blind]


@needs_recordings
@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("count", [6, 9, 14])
def test_bands_hold_what_the_fit_has_not_seen(rig, count):
    drive, steady = recordings_of(rig, "steady_state")
    found = [p for seed in range(4) for p in predicted(drive, *split(steady, count, seed))]
    assert np.mean([p.mean_inside for p in found]) >= 0.90
    assert 0.90 <= np.mean([p.sample_coverage for p in found]) <= 0.98
    assert np.mean([np.abs(p.recording.tau).max() <= p.band.peak for p in found]) >= 0.95


@needs_recordings
@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("first", [0, 1])
def test_every_second_recording_predicts_the_others(rig, first):
    drive, steady = recordings_of(rig, "steady_state")
    _, moving = recordings_of(rig, "start_stop")
    steady = sorted(steady, key=lambda r: r.w.mean())
    found = predicted(drive, steady[first::2], steady[1 - first :: 2] + moving)
    assert found.pop().nrmsd <= RIGS[rig][1]
    beyond = [np.sqrt(np.mean((p.tau - p.recording.tau) ** 2)) / p.recording.tau.std() - 1 for p in found]
    assert np.mean(beyond) <= 0.03
    assert np.mean([p.mean_inside for p in found]) >= 0.90
