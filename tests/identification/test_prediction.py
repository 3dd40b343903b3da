"""The identified friction predicts the torque from the speed.

Further tests cover dynamic identification and the two commands that use these functions.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ssm_planner.dynamics.friction import required_friction
from ssm_planner.dynamics.transmission import breakaway_torque, motor_torque, output_effort
from ssm_planner.errors import ProblemError, RecordingError
from ssm_planner.identification.dynamic import fit_dynamic
from ssm_planner.identification.fit import fit_map
from ssm_planner.identification.identify import identify, predict
from ssm_planner.identification.prediction import (
    RecordedMotion,
    nrmsd,
    predict_recording,
    predict_torque,
)
from ssm_planner.identification.recordings import Recording
from ssm_planner.identification.torque_map import read_torque_map
from ssm_planner.loading.load import load_drive
from ssm_planner.problem.posterior import LAW_COLUMN
from ssm_planner.reporting.figures.sizing import map_figure, prediction_figure
from ssm_planner.units import RPM
from tests.support.paths import PROBLEMS
from tests.support.recordings import REAL, RECORDINGS
from tests.support.rig_figures import rig_map

DRIVES = PROBLEMS / "drives"
FOLDERS = {
    "rig1_lead_screw": "drive1_lead_screw",
    "rig2_antibacklash_screw": "drive2_antibacklash_screw",
    "rig3_worm": "drive3_worm",
}
needs_recordings = pytest.mark.skipif(not REAL, reason="the recordings are not beside the project")


@cache
def identified(name="rig3_worm"):
    drive = load_drive(DRIVES / f"{name}.yaml")
    data = read_torque_map(DRIVES / "rig_figures.csv", name)
    law = "stribeck_exponential"
    return fit_map(drive, data, drive.rig.F_payload, law=law, reference=drive.rig.published).drive


def start_stop(rest: float = 2.0, speed: float = 5.0, dt: float = 0.02):
    """Return time (s) and speed (rad/s) of a motion forwards and back with a rest around each."""
    time = np.arange(0.0, 4 * rest + 6.0, dt)
    w = np.interp(time, [rest, rest + 0.1, rest + 2.9, rest + 3.0], [0, speed, speed, 0])
    return time, w - np.interp(
        time, [2 * rest + 3, 2 * rest + 3.1, 2 * rest + 5.9, 2 * rest + 6.0], [0, speed, speed, 0]
    )


def test_the_prediction_of_steady_motion_is_the_inverse_law():
    drive = identified()
    time = np.arange(0.0, 3.0, 0.01)
    w = np.full_like(time, 7.0)
    tau = predict_torque(drive, RecordedMotion.from_speed(time, w), -0.0188, 0.0)
    expected = motor_torque(drive, output_effort(drive, -0.0188, 7.0 / drive.ratio, 0.0), 7.0, 0.0)
    np.testing.assert_allclose(tau, expected, rtol=1e-12)


def test_rest_needs_no_torque_and_starts_with_breakaway():
    drive = identified()
    drive = replace(drive, friction=replace(required_friction(drive), mu_static=0.3))
    time, w = start_stop()
    motion = RecordedMotion.from_speed(time, w)
    tau = predict_torque(drive, motion, -0.0188, 0.0)
    first = int(np.flatnonzero(w)[0])
    assert np.all(tau[: first - 3] == 0.0)
    assert tau[first - 1] == pytest.approx(float(breakaway_torque(drive, -0.0188, 1.0)), rel=0.01)
    assert np.all(
        np.sign(tau[motion.direction != 0]) == np.sign(motion.direction[motion.direction != 0])
    )


def test_nrmsd_is_scaled_by_the_measured_range():
    measured = np.array([0.0, 1.0, 2.0, 4.0])
    assert nrmsd(measured + 0.2, measured) == pytest.approx(0.05)
    with pytest.raises(RecordingError, match="constant"):
        nrmsd(measured, np.ones(4))


@pytest.mark.parametrize("truth", [(0.20, None, 0.0), (0.20, 1.0, 0.12)])
@pytest.mark.slow
def test_dynamic_identification_finds_breakaway_dwell_and_memory(truth):
    mu_static, dwell, memory = truth
    drive = identified()
    drive = replace(drive, friction=replace(required_friction(drive), posterior=None))
    friction = replace(
        required_friction(drive), mu_static=mu_static, dwell_constant=dwell, memory=memory
    )
    rng = np.random.default_rng(0)
    recordings = []
    for rest in (0.5, 1.0, 4.0):
        time, w = start_stop(rest)
        tau = predict_torque(
            replace(drive, friction=friction), RecordedMotion.from_speed(time, w), -0.0188, 0.0
        )
        recordings.append(Recording(f"{rest}", time, w, tau + rng.normal(0, 2e-5, len(tau))))
    fit = fit_dynamic(drive, recordings, -0.0188)
    assert fit.estimates["mu_static"].value == pytest.approx(mu_static, rel=0.01)
    assert fit.estimates["memory"].value == pytest.approx(memory, abs=0.006)
    if dwell is not None:
        assert fit.estimates["dwell_constant"].value == pytest.approx(dwell, rel=0.02)
    assert all(after < before for after, before in zip(fit.after, fit.before, strict=True))


@pytest.mark.parametrize("name", FOLDERS)
@pytest.mark.slow
@pytest.mark.usefixtures("few_points")
def test_start_stop_recordings_that_the_fit_has_not_seen(name, tmp_path):
    folder = RECORDINGS / FOLDERS[name]
    result = identify(DRIVES / f"{name}.yaml", [folder / "steady_state"])
    assert result.fit.nrmsd <= 0.02
    predicted = predict(result.save(tmp_path / "drive.yaml"), [folder / "start_stop"])
    assert [p.nrmsd <= 0.05 for p in predicted] == [True]
    result = identify(DRIVES / f"{name}.yaml", [folder])
    both = result.to_dict()
    assert all(item["nrmsd"] <= item["nrmsd_map_only"] for item in both["start_stop"])
    assert predict(result.save(tmp_path / "dynamic.yaml"), [folder / "start_stop"])[
        0
    ].nrmsd == pytest.approx(both["start_stop"][0]["nrmsd"], rel=1e-4)


@needs_recordings
@pytest.mark.parametrize("name", FOLDERS)
def test_shipped_figures_are_what_the_reader_computes(name):
    shipped = read_torque_map(DRIVES / "rig_figures.csv", name)
    computed = rig_map(DRIVES / f"{name}.yaml", RECORDINGS / FOLDERS[name] / "steady_state")
    np.testing.assert_allclose(shipped.w, computed.w, rtol=1e-8)
    np.testing.assert_allclose(shipped.tau, computed.tau, rtol=1e-8)


@pytest.mark.parametrize("name", FOLDERS)
@pytest.mark.slow
@pytest.mark.usefixtures("few_points")
def test_identification_from_a_fresh_clone_writes_a_drive_that_loads(name, tmp_path):
    outcome = identify(DRIVES / f"{name}.yaml")
    result = outcome.to_dict()
    outcome.save(tmp_path / "drive.yaml")
    json.dumps(result)
    drive = load_drive(tmp_path / "drive.yaml")
    assert drive.friction.law == result["law"]
    for parameter in ("mu", "b_c", "b_v", "b_oc"):
        estimate = result["parameters"][parameter]
        assert getattr(drive.friction, parameter) == pytest.approx(
            estimate["value"], rel=1e-6, abs=1e-12
        )
        assert estimate["low"] <= estimate["value"] <= estimate["high"]
    assert "steady-state recordings" in drive.friction.source
    assert drive.rig.load == pytest.approx(outcome.fit.load, rel=1e-6)
    assert np.array_equal(drive.friction.posterior.draws, outcome.drive.friction.posterior.draws)
    unused = (
        {LAW_COLUMN, "mu_stribeck", "stribeck_speed"}
        if drive.friction.law == "coulomb"
        else {LAW_COLUMN}
    )
    assert drive.friction.posterior.law_shares(drive.friction.law) == result["law_shares"]
    for name in set(drive.friction.posterior.names) - unused:
        entry, column = result["parameters"][name], drive.friction.posterior.column(name)
        tails = (np.mean(column < entry["low"]), np.mean(column > entry["high"]))
        for tail, end in zip(tails, ("low", "high"), strict=True):
            # About 25 ± 5 of 1000 sets lie beyond each end, or fewer if the end is the value.
            assert tail <= 0.045, (name, end)
            assert tail >= 0.005 or entry[end] == entry["value"], (name, end)


def test_commands_refuse_what_they_cannot_use(tmp_path):
    copy = tmp_path / "rig3_worm.yaml"
    shutil.copy(DRIVES / "rig3_worm.yaml", copy)
    with pytest.raises(RecordingError, match=r"\.yaml: no steady-state recording"):
        identify(copy)
    with pytest.raises(RecordingError, match="no recording to predict"):
        predict(copy, [])
    lines = "\n".join(f"{k},30,{1 + k % 3}" for k in range(20))
    (tmp_path / "one.csv").write_text(
        "time [s],velocity [rpm],torque [%]\n" + lines, encoding="utf-8"
    )
    with pytest.raises(RecordingError, match="direction"):
        identify(copy, [tmp_path / "one.csv"])
    still = "\n".join(f"{k},0,{1 + k % 3}" for k in range(20))
    (tmp_path / "still.csv").write_text(
        "time [s],velocity [rpm],torque [%]\n" + still, encoding="utf-8"
    )
    with pytest.raises(RecordingError, match="never moves"):
        identify(copy, [tmp_path / "still.csv"])
    with pytest.raises(ProblemError):
        identify(tmp_path / "absent.yaml")


@pytest.mark.usefixtures("few_points")
def test_figures_show_both_directions_and_the_prediction(tmp_path):
    drive = load_drive(DRIVES / "rig3_worm.yaml")
    data = read_torque_map(DRIVES / "rig_figures.csv", "rig3_worm")
    fit = fit_map(drive, data, drive.rig.F_payload, law="coulomb")
    axes = map_figure(fit, data, drive.rig.F_payload).axes[0]
    dashed = [line for line in axes.lines if line.get_linestyle() == "--"]
    assert sorted(np.sign(line.get_xdata()[0]) for line in dashed) == [-1, 1]
    time, w = start_stop()
    prediction = predict_recording(
        fit.drive, Recording("a", time, w, np.sign(w) * 1e-3), drive.rig.F_payload
    )
    figure = prediction_figure(prediction)
    assert len(figure.axes) == 2
    assert figure.axes[0].get_ylabel().endswith("(mN·m)")


@pytest.mark.usefixtures("few_points")
def test_the_map_shows_what_further_recordings_stay_within() -> None:
    """The figure of the map shows a wide band for samples and a narrow band for means.

    All measured means lie within the wide bands, and more than 90 % lie within the narrow bands.
    """
    result = identify("rig1_lead_screw")
    outlines = [
        band.get_paths()[0]
        for band in map_figure(result.fit, result.data, result.load).axes[0].collections
    ]
    speeds = np.abs(result.data.w)
    between = (speeds > speeds.min() * 1.1) & (speeds < speeds.max() * 0.99)
    points = np.column_stack([RPM * result.data.w, 1e3 * result.data.tau])[between]
    samples, means = (
        [path.contains_points(points) for path in outlines[kind::2]] for kind in (0, 1)
    )
    assert np.any(samples, axis=0).all()
    assert np.any(means, axis=0).mean() > 0.9
    for wide, narrow in zip(outlines[0::2], outlines[1::2], strict=True):
        assert np.ptp(wide.vertices[:, 1]) > 1.5 * np.ptp(narrow.vertices[:, 1])


@pytest.mark.usefixtures("few_points")
def test_a_shipped_drive_by_its_name_has_its_table_of_figures_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    steps: list[str] = []
    assert "rig_figures.csv" in identify("rig3_worm", progress=steps.append).evidence
    assert steps[0].message == "fitting the map of 38 points"
    assert [(step.done, step.total) for step in steps[1:]] == [(k, 13) for k in range(13)]
