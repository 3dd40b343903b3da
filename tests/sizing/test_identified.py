"""Sizing uses drives that were identified from the figures of the test rigs.

The bands of the peak torque are compared with 20 000 independently computed draws.
"""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

from ssm_planner import identify
from ssm_planner.dynamics.spread import friction_spread
from ssm_planner.loading.files import shipped_files
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.motion import Motorisation, Stroke
from ssm_planner.problem.motor import Motor
from ssm_planner.problem.posterior import FRICTION_LAWS, LAW_COLUMN, Posterior, Ripple
from ssm_planner.problem.robot import JOINTS, Robot
from ssm_planner.sizing.duty import DutyCycle
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.size import size
from ssm_planner.typing import Array

RIGS = {
    "rig1_lead_screw": "insertion",
    "rig2_antibacklash_screw": "insertion",
    "rig3_worm": "tilt",
}
"""Name of a joint that the drive of each rig can move."""
STROKES = {
    "insertion": Stroke("insertion", -0.015, 0.01, 0.02, 0.1),
    "tilt": Stroke("tilt", 0.0, 1.5, 1.13, 3.49),
}
DRAWS = 20_000


def reference_peaks(load: JointLoad, drive: Drive, posterior: Posterior) -> Array:
    """Return DRAWS random values of the largest absolute motor torque in N·m, with ripple.

    The torque follows the law of the paper, with parameters drawn from the posterior. The ripple is
    the amount by which the peak of a further recording exceeds this torque.
    """
    rng = np.random.default_rng(11)
    rows = posterior.draws[rng.integers(len(posterior.draws), size=DRAWS)]
    moving = load.direction != 0
    # A subset of the instants suffices for the largest torque: 300 even steps and all starts.
    keep = np.unique(np.linspace(0, moving.sum() - 1, 300).astype(int))
    keep = np.append(keep, np.flatnonzero(load.breakaway[moving] > 0))
    way, qd, qdd, rigid, start = (
        part[moving][keep]
        for part in (load.direction, load.qd, load.qdd, load.tau_rigid, load.breakaway > 0)
    )
    peaks = np.empty(DRAWS)
    for n, row in enumerate(rows):
        values = {
            name: getattr(drive.friction, name)
            for name in ("mu", "mu_static", "b_c", "b_v", "b_oc", "b_ov")
        }
        values |= {
            "mu_stribeck": drive.friction.mu_stribeck,
            "stribeck_speed": drive.friction.stribeck_speed,
        }
        values |= {"preload": drive.preload} | dict(zip(posterior.names, row, strict=True))
        peaks[n] = np.abs(torque(drive, values, way, qd, qdd, rigid, start)).max()
    nominal = replace(load, drive=drive).torque()
    biggest = nominal[np.argmax(np.abs(nominal))]
    ripple = posterior.ripple(1 if biggest >= 0 else -1)
    return peaks if ripple is None else peaks + beyond(ripple, peaks, rng)


def torque(
    drive: Drive,
    values: dict[str, float],
    way: Array,
    qd: Array,
    qdd: Array,
    rigid: Array,
    start: Array,
) -> Array:
    """Return the motor torque (n,) in N·m.

    The static friction coefficient keeps its ratio to the kinetic coefficient at zero speed.
    """
    friction, w = drive.friction, drive.ratio * qd
    mu = np.full(len(w), values["mu"])
    law = FRICTION_LAWS[int(values[LAW_COLUMN])] if LAW_COLUMN in values else friction.law
    if law != "coulomb":
        x = np.abs(w) / values["stribeck_speed"]
        mu = mu + values["mu_stribeck"] * (
            np.exp(-2 * x) if law.endswith("exponential") else np.exp(-(x**2))
        )
    ratio = friction.mu_static / (friction.mu + friction.mu_stribeck)
    mu = np.where(start, np.maximum(mu, ratio * (values["mu"] + values["mu_stribeck"])), mu)
    effort = rigid + drive.output_inertia * qdd + values["b_oc"] * way + values["b_ov"] * qd
    phi, lead, gamma = np.arctan(mu / np.cos(drive.pressure_angle)), drive.lead_angle, drive.gamma
    own = drive.input_inertia * drive.ratio * qdd + values["b_c"] * way + values["b_v"] * w
    if drive.kind != "antibacklash_screw":
        return own + gamma * np.tan(lead + np.sign(effort * way) * phi) * effort
    second = values["preload"] + drive.second_nut_mass * qdd
    return own + gamma * (
        np.tan(lead - way * phi) * (effort - values["preload"]) + np.tan(lead + way * phi) * second
    )


def beyond(ripple: Ripple, peaks: Array, rng: np.random.Generator) -> Array:
    logs = np.log(ripple.peak)
    t = rng.standard_t(len(logs) - 1, size=len(peaks))
    departures = np.exp(logs.mean() + logs.std(ddof=1) * np.sqrt(1 + 1 / len(logs)) * t)
    return departures * np.maximum(peaks / np.median(ripple.torque), 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.usefixtures("few_points")
def test_peaks_of_identified_drives(rig: str, robot: Robot) -> None:
    joint = RIGS[rig]
    drive = identify(shipped_files("drives")[rig]).drive
    posterior = drive.friction.posterior
    assert posterior is not None
    i = JOINTS.index(joint)
    motor = Motor("any", nominal_torque=0.02, max_torque=0.05, max_speed=5000.0)
    joints = tuple(
        replace(item, drive=drive, motor=motor, alternatives=()) if k == i else item
        for k, item in enumerate(robot.joints)
    )
    duty = DutyCycle.of_motorisation(
        Motorisation("one axis", replace(robot, joints=joints), (STROKES[joint],))
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (result,) = size(duty).joints
        expected = reference_peaks(result.load, drive, posterior)
    band = result.band
    for confidence in (0.5, 0.9, 0.99):
        assert band.high("peak_torque", confidence) == pytest.approx(
            np.quantile(expected, confidence), rel=0.1
        )
    assert np.isfinite(expected).all()
    assert (
        band.nominal_value("peak_torque")
        < band.high("peak_torque", 0.99)
        < 20 * band.nominal_value("peak_torque")
    )
    # Every draw is an unchanged parameter set of the posterior, and no value is clipped.
    spread = friction_spread(drive)
    taken = spread.values(spread.deviations(len(posterior.draws)))
    for name, column in taken.items():
        assert column == pytest.approx(posterior.column(name), rel=1e-9, abs=1e-15)
        assert column.min() >= 0
