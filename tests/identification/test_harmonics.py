"""Known harmonics of the torque are recovered with and without a position channel.

In real files, the first two turns predict the ripple of the rest.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ssm_planner.identification.harmonics import (
    Harmonics,
    _aligning_angle,
    _fit_orders,
    fit_harmonics,
    motor_angle,
)
from ssm_planner.identification.identify import identify, predict
from ssm_planner.identification.parameters import drive_with_parameters, map_torque
from ssm_planner.identification.prediction import nrmsd
from ssm_planner.identification.recordings import Recording, read_recording, read_recordings
from ssm_planner.loading.load import load_drive
from tests.support.paths import PROBLEMS
from tests.support.recordings import RECORDINGS

DRIVE = PROBLEMS / "drives" / "rig3_worm.yaml"
RATIO = 60.0
TURN = 2 * np.pi
SCREW = {1: 2e-4, 2: -1e-4, 3: 0.5e-4}


def start_in(harmonics: Harmonics, angle: np.ndarray, tau: np.ndarray) -> float:
    """Return the angle (rad) at which a recording began, from its motor angle and torque."""
    fitted = _fit_orders([(angle, tau)], harmonics.orders, phased=False)
    return _aligning_angle(harmonics.coefficients, fitted.coefficients)


def simulated(
    direction: int, start: float, position: bool, wheel: float = 0.0, turns: float = 80.0
) -> Recording:
    """Return a recording with known harmonics of the torque.

    The torque contains cosines of the screw angle, which change their sign with the direction, and
    a sine of the wheel angle.
    """
    rng = np.random.default_rng(int(10 * abs(start)) + direction + 1)
    time = np.linspace(0.0, turns * TURN / 10.0, 2000)
    w = np.full_like(time, direction * 10.0)
    angle = start + w * time
    tau = direction * 1e-3 + sum(a * np.cos(k * angle) for k, a in SCREW.items()) * direction
    tau += wheel * np.sin(angle / RATIO) + rng.normal(0, 1e-4, len(time))
    return Recording(f"{start:.1f}", time, w, tau, angle=angle if position else None)


@pytest.mark.parametrize("direction", [1, -1])
def test_recorded_angles_give_the_harmonics_of_screw_and_wheel_back(direction):
    recordings = [
        simulated(sign, start, True, 3e-4) for sign in (1, -1) for start in (0.3, 41.0, 200.0)
    ]
    result = fit_harmonics(recordings, direction, RATIO)
    assert result.phased
    assert result.orders == pytest.approx((1 / RATIO, 2 / RATIO, 3 / RATIO, 1.0, 2.0, 3.0))
    np.testing.assert_allclose(
        result.cosine[3:], direction * np.array(list(SCREW.values())), atol=1e-5
    )
    np.testing.assert_allclose(result.sine, [3e-4, 0, 0, 0, 0, 0], atol=1.5e-5)


def test_without_angles_amplitudes_are_found_and_the_phase_from_the_beginning():
    recordings = [simulated(1, start, False, turns=20.0) for start in (0.3, 1.7, 2.9, 4.4)]
    result = fit_harmonics(recordings, 1)
    assert not result.phased
    np.testing.assert_allclose(result.amplitudes, np.abs(list(SCREW.values())), atol=1.5e-5)
    other = simulated(1, 5.1, False, turns=20.0)
    angle = motor_angle(other)
    first = angle <= 2 * TURN
    wave = result.rotated(start_in(result, angle[first], other.tau[first])).torque(angle[~first])
    assert np.std(other.tau[~first] - wave) < 1.1e-4


def test_a_position_channel_is_read(tmp_path):
    lines = [f"{k};60;{20 + k % 3};{2048 * k}" for k in range(20)]
    header = ";Velocity actual value averaged;Torque actual value averaged;Position actual value\nms;rpm;%;inc\n"
    (tmp_path / "a.csv").write_text(header + "\n".join(lines), encoding="utf-8")
    read = read_recording(tmp_path / "a.csv", nominal_torque=0.01, direction=-1)
    np.testing.assert_allclose(read.angle, -np.pi * np.arange(20))


def file_of(path: Path, rpm: float, start: float, seed: int, position: bool) -> None:
    """Write a recording of steady motion of the worm rig with the harmonics SCREW.

    The recording covers four turns. All its channels have the opposite sign of the motion.
    """
    drive = load_drive(DRIVE)
    w = rpm * np.pi / 30
    time = np.linspace(0.0, 4 * TURN / abs(w), 500)
    angle = start + w * time
    truth = drive_with_parameters(
        drive, "coulomb", {"b_c": 5.5e-4, "b_v": 1.15e-5, "b_oc": 4e-3, "mu": 0.12}
    )
    tau = map_torque(truth, np.full_like(time, w), drive.rig.F_payload)
    tau = tau + sum(a * np.cos(k * angle) for k, a in SCREW.items())
    tau += np.random.default_rng(seed).normal(0, 2e-5, len(time))
    columns = [
        1e3 * time,
        np.full_like(time, -rpm),
        -100 * tau / drive.rig.motor_nominal_torque,
        -4096 * angle / TURN,
    ]
    names = [
        "",
        "Velocity actual value averaged",
        "Torque actual value averaged",
        "Position actual value",
    ]
    count = 4 if position else 3
    lines = [";".join(names[:count]), ";".join(["ms", "rpm", "%", "inc"][:count])]
    lines += [
        ";".join(f"{value:.7g}" for value in row[:count]) for row in zip(*columns, strict=True)
    ]
    path.write_text("\n".join(lines), encoding="utf-8")


@pytest.mark.usefixtures("few_points")
def test_harmonics_stand_in_the_drive_file_and_are_predicted_where_the_angle_is_recorded(tmp_path):
    (tmp_path / "fit").mkdir()
    for seed, rpm in enumerate((-200, -120, -60, -30, 30, 60, 120, 200)):
        file_of(tmp_path / "fit" / f"{rpm}.csv", rpm, start=0.7 * seed, seed=seed, position=True)
    result = identify(DRIVE, [tmp_path / "fit"])
    file = result.save(tmp_path / "drive.yaml")
    posterior = load_drive(file).friction.posterior
    stored_taps, taps = posterior.reaction.taps, result.drive.friction.posterior.reaction.taps
    np.testing.assert_allclose(stored_taps, taps, rtol=1e-5)
    for sign in (1, -1):
        stored = posterior.harmonics(sign)
        assert stored.phased
        np.testing.assert_allclose(stored.cosine[-3:], list(SCREW.values()), atol=1e-5)
        np.testing.assert_allclose(stored.sine[-3:], 0.0, atol=1e-5)
    file_of(tmp_path / "known.csv", 90, start=2.0, seed=20, position=True)
    file_of(tmp_path / "unknown.csv", 90, start=2.0, seed=20, position=False)
    file_of(tmp_path / "slow.csv", 5, start=2.0, seed=21, position=True)
    known, unknown, slow = predict(
        file, [tmp_path / f"{name}.csv" for name in ("known", "unknown", "slow")]
    )
    error, without = (float(np.std(p.tau - p.recording.tau)) for p in (known, unknown))
    assert error < 2.5e-5 < 1.5e-4 < without
    assert known.mean_inside
    assert 0.9 <= known.sample_coverage <= 1.0
    # The known phase makes the band of the samples narrower.
    width, wider = (float(np.mean(p.band.high - p.band.low)) for p in (known, unknown))
    assert width < 0.6 * wider
    assert known.unseen is None
    assert slow.unseen == pytest.approx(5 * np.pi / 30, rel=1e-3)
    assert any("extrapolated" in remark and "5 rpm" in remark for remark in slow.remarks)


@pytest.mark.parametrize(
    ("rig", "most"),
    [("drive1_lead_screw", 0.155), ("drive2_antibacklash_screw", 0.1185), ("drive3_worm", 0.118)],
)
def test_the_first_two_turns_of_a_file_tell_the_ripple_of_the_rest(rig, most):
    steady = read_recordings(
        [RECORDINGS / rig / "steady_state"], nominal_torque=9.84e-3, direction=-1
    )
    errors, constant = [], []
    for recording in steady:
        angle = motor_angle(recording)
        if np.ptp(angle) < 2.5 * TURN:
            continue
        others = [r for r in steady if r is not recording]
        result = fit_harmonics(others, int(np.sign(recording.w.mean())))
        first = np.abs(angle) <= 2 * TURN
        wave = result.rotated(start_in(result, angle[first], recording.tau[first])).torque(
            angle[~first]
        )
        mean, span = recording.tau.mean(), np.ptp(recording.tau) / np.ptp(recording.tau[~first])
        errors.append(nrmsd(mean + wave, recording.tau[~first]) / span)
        constant.append(nrmsd(np.full(len(wave), mean), recording.tau[~first]) / span)
    assert np.mean(errors) <= most < np.mean(constant)
