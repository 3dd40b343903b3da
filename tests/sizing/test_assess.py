"""Verdicts on 48 real motors for the three driven axes are compared with a brute-force oracle.

The oracle computes every torque, voltage and winding temperature independently of the package.
"""

from __future__ import annotations

import csv
import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from ssm_planner import units
from ssm_planner.loading.load import load_problem
from ssm_planner.planning.planner import plan_motion
from ssm_planner.problem.motor import Motor
from ssm_planner.problem.robot import Robot
from ssm_planner.sizing.assess import MotorVerdict, assess
from ssm_planner.sizing.joint_load import JointLoad, joint_loads
from ssm_planner.sizing.motor_limits import Conditions
from ssm_planner.typing import Array
from tests.support.paths import PROBLEMS
from tests.support.sizing_cases import rated

KINDS = {
    "nominal_torque": "torque",
    "chart_max_torque": "torque",
    "max_speed": "motor_speed",
    "nominal_voltage": "voltage",
    "torque_constant": "torque_constant",
    "terminal_resistance": "resistance",
    "rotor_inertia": "inertia",
    "resistance_winding_housing": "thermal_resistance",
    "resistance_housing_ambient": "thermal_resistance",
    "time_constant_winding": "time",
    "time_constant_motor": "time",
    "max_winding_temperature": "temperature",
}
FRICTION = ("mu", "b_c", "b_v", "b_oc", "b_ov")
SPREADS = (0.0, 0.2)


def catalogue() -> Iterator[Motor]:
    with (PROBLEMS / "catalogues/motors_24v.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            figures = {name: units.parse_quantity(row[name], kind) for name, kind in KINDS.items()}
            yield Motor(
                name=row["order_number"], max_torque=figures.pop("chart_max_torque"), **figures
            )


@pytest.fixture(scope="module")
def motors() -> list[Motor]:
    result = list(catalogue())
    assert len(result) == 48
    return result


@pytest.fixture(scope="module")
def axes() -> tuple[JointLoad, ...]:
    """Return the loads of the three driven joints in the shipped motion, sampled at 50 Hz.

    The verdicts and the oracle use the same instants.
    """
    problem = load_problem(PROBLEMS / "tilt_insert.yaml")
    trajectory = plan_motion(problem).trajectory
    loads = joint_loads(trajectory, problem.robot, rate=50.0)
    return tuple(replace(load, drive=rated(load.drive)) for load in loads)


def reference_torque(load: JointLoad, inertia: float, values: dict[str, float]) -> Array:
    """Return the motor torque (n,) in N·m by the law of the paper.

    The static friction coefficient keeps its ratio to the kinetic coefficient.
    """
    drive, friction = load.drive, load.drive.friction
    way, w = load.direction, load.qd * drive.ratio
    mu = np.where(load.breakaway > 0, friction.mu_static / friction.mu, 1.0) * values["mu"]
    mu = np.where(load.breakaway > 0, np.maximum(mu, values["mu"]), mu)
    effort = (
        load.tau_rigid
        + drive.output_inertia * load.qdd
        + values["b_oc"] * way
        + values["b_ov"] * load.qd
    )
    phi = np.arctan(mu / np.cos(drive.pressure_angle))
    mesh = drive.gamma * np.tan(drive.lead_angle + np.sign(effort * way) * phi) * effort
    torque = inertia * load.qdd * drive.ratio + values["b_c"] * way + values["b_v"] * w + mesh
    return np.where(way == 0, 0.0, torque)


def holds(load: JointLoad, motor: Motor, torque: Array) -> Array:
    """Return for each case (cases,) whether the motor keeps all limits in the repeated motion.

    Each row of `torque` (cases, n) is the motor torque of one case in N·m. The limits apply to the
    peak torque, the RMS torque, the speed, the voltage and the winding temperature.
    """
    span = load.t[-1] - load.t[0]
    speed = np.abs(load.qd * load.drive.ratio)
    rms = np.sqrt(np.trapezoid(torque**2, load.t, axis=1) / span)
    is_kept = (np.abs(torque).max(axis=1) <= motor.max_torque) & (rms <= motor.nominal_torque)
    is_kept &= speed.max() <= motor.max_speed
    for temperature in (25.0, motor.max_winding_temperature - 273.15):
        k = motor.torque_constant * (1 - 0.0012 * (temperature - 25))
        ohm = motor.terminal_resistance * (1 + 0.00393 * (temperature - 25))
        volts = np.abs(ohm * torque / k + k * load.qd * load.drive.ratio)
        is_kept &= volts.max(axis=1) <= motor.nominal_voltage
    is_kept[is_kept] = (
        hottest(load, motor, torque[is_kept]) <= motor.max_winding_temperature - 273.15
    )
    return is_kept


def hottest(load: JointLoad, motor: Motor, torque: Array) -> Array:
    """Return the highest winding temperature (cases,) in °C of the repeated motion.

    Euler steps integrate the winding temperature over several repetitions of the motion. The
    integration starts at the steady-state temperature of the RMS torque. The housing keeps its
    steady-state temperature.
    """
    inner, outer = motor.resistance_winding_housing, motor.resistance_housing_ambient
    capacity = motor.time_constant_winding / inner

    def heat(tau: Array, winding: Array) -> Array:
        k = motor.torque_constant * np.maximum(1 - 0.0012 * (winding - 25), 0.05)
        return motor.terminal_resistance * (1 + 0.00393 * (winding - 25)) * (tau / k) ** 2

    span = load.t[-1] - load.t[0]
    rms = np.sqrt(np.trapezoid(torque**2, load.t, axis=1) / span)
    winding = np.full(len(torque), 25.0)
    for _ in range(200):
        winding = np.minimum(25 + (inner + outer) * heat(rms, winding), 2000.0)
    housing = 25 + outer / (inner + outer) * (winding - 25)
    peak = winding.copy()
    for _ in range(max(int(3 * motor.time_constant_winding / span), 2)):
        for k, step in enumerate(np.diff(load.t)):
            gained = (
                heat((torque[:, k] + torque[:, k + 1]) / 2, winding) - (winding - housing) / inner
            )
            winding = np.minimum(winding + step * gained / capacity, 2000.0)
            peak = np.maximum(peak, winding)
    return peak


def answers(load: JointLoad, motor: Motor) -> dict[float, bool | None]:
    """Return the answer for each relative uncertainty of the friction.

    The answer is True if every case keeps all limits, False if no case does, and None otherwise.
    The cases are combinations of possible rotor inertias and friction parameters.
    """
    own, drive = load.motor, load.drive
    stated = own.rotor_inertia
    most = min(own.nominal_torque / 2e4, drive.input_inertia) if stated is None else stated
    inertias = (
        np.linspace(drive.input_inertia - most, drive.input_inertia - (stated or 0.0), 5)
        + motor.rotor_inertia
    )
    stated_friction = np.array([getattr(drive.friction, name) for name in FRICTION])
    torque = {}
    for spread in SPREADS:
        rng = np.random.default_rng(7)
        factors = (
            [1 + spread * np.array(corner) for corner in itertools.product((-1, 1), repeat=5)]
            if spread
            else []
        )
        factors += [1 + spread * rng.uniform(-1, 1, 5) for _ in range(30 if spread else 1)]
        torque[spread] = [
            reference_torque(
                load, inertia, dict(zip(FRICTION, stated_friction * factor, strict=True))
            )
            for inertia in (inertias if stated is None else inertias[:1])
            for factor in factors
        ]
    # The cases of all uncertainties are computed together because the small time steps take long.
    is_kept = holds(load, motor, np.array([*itertools.chain(*torque.values())]))
    ends = np.cumsum([len(rows) for rows in torque.values()])[:-1]
    return {
        spread: True if part.all() else False if not part.any() else None
        for spread, part in zip(SPREADS, np.split(is_kept, ends), strict=True)
    }


def needed(verdict: MotorVerdict) -> str:
    return " ".join(check.needs for check in verdict.checks if check.passed is None)


@pytest.mark.slow
def test_no_verdict_is_wrong_and_only_what_is_missing_leaves_one_open(
    axes: tuple[JointLoad, ...], motors: list[Motor]
) -> None:
    """Every verdict equals the answer of the oracle.

    An open verdict names the missing rotor inertia or the ranges of friction that would decide it.
    """
    result: dict[float, list[bool | None]] = {spread: [] for spread in SPREADS}
    for load in axes:
        for motor in motors[::3]:
            expected = answers(load, motor)
            for spread in SPREADS:
                verdict = assess(load, motor, Conditions(spread=spread))
                result[spread].append(verdict.adequate)
                assert verdict.adequate is expected[spread], (load.joint, motor.name, spread)
                if verdict.adequate is None:
                    assert "rotor_inertia of" in needed(verdict) or "ranges of" in needed(verdict)
    for verdicts in result.values():
        assert verdicts.count(True) > 6
        assert verdicts.count(False) > 6


def test_a_figure_that_the_verdict_needs_is_named(
    axes: tuple[JointLoad, ...], motors: list[Motor], robot: Robot
) -> None:
    """A missing figure is named if the verdict depends on it.

    If other figures rule the motor out, the verdict is no. A missing rotor inertia does not change
    the verdict on a strong motor.
    """
    load = axes[1]
    strong = max(motors, key=lambda motor: motor.nominal_torque)
    weak = min(motors, key=lambda motor: motor.nominal_torque)
    for name in ("torque_constant", "time_constant_motor", "max_winding_temperature"):
        verdict = assess(load, replace(strong, **{name: None}), Conditions(spread=0.0))
        assert verdict.adequate is None
        assert name in needed(verdict)
        assert assess(load, replace(weak, **{name: None}), Conditions(spread=0.0)).adequate is False
    assert (
        assess(load, replace(strong, rotor_inertia=None), Conditions(spread=0.0)).adequate is True
    )
