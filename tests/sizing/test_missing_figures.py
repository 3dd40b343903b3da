"""Verdicts on random catalogues with missing figures are compared with a brute-force oracle.

No pair of motor and gear passes unless every necessary figure is stated.
"""

from __future__ import annotations

import itertools
import json
import math
import random
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ssm_planner.loading.catalogues import drives_with_gears, read_motors
from ssm_planner.loading.load import load_robot
from ssm_planner.sizing.joint_load import JointLoad, joint_loads
from ssm_planner.sizing.motor_limits import Conditions
from ssm_planner.sizing.selection import JointSelection, select_joint
from tests.support.cases import drawn
from tests.support.sizing_cases import random_trajectory

SPREAD, SUPPLY, PAUSE = 0.2, 24.0, 1.0
MOTOR = {
    "nominal_torque": "N*m",
    "max_torque": "N*m",
    "max_speed": "rad/s",
    "nominal_voltage": "V",
    "nominal_current": "A",
    "no_load_current": "A",
    "torque_constant": "N*m/A",
    "terminal_resistance": "ohm",
    "rotor_inertia": "kg*m^2",
    "resistance_winding_housing": "K/W",
    "resistance_housing_ambient": "K/W",
    "time_constant_winding": "s",
    "time_constant_motor": "s",
    "max_winding_temperature": "K",
    "mass": "kg",
}
REQUIRED = ("nominal_torque", "max_torque", "max_speed")
GEAR = {
    "geometry.ratio": "",
    "geometry.worm_diameter": "m",
    "geometry.lead": "m",
    "ratings.continuous_output": "N*m",
    "ratings.peak_output": "N*m",
    "ratings.input_speed": "rad/s",
    "ratings.duty": "",
    "friction.mu_lowest": "",
    "mass": "kg",
}
Figures = dict[str, float | None]


def random_motor(rng: random.Random) -> Figures:
    """Return figures of a motor that are consistent with each other.

    Each optional figure is missing with a probability of 5 %.
    """
    rise, r_inner = 130.0, 10 ** rng.uniform(-0.8, 0.5)
    slow = rng.uniform(300.0, 700.0)
    mass = slow / (10 * r_inner) / 450
    nominal = mass / rng.uniform(3.0, 10.0)
    resistance = 10 ** rng.uniform(-0.7, 0.6)
    current = math.sqrt(rise / (resistance * 14 * r_inner)) * rng.uniform(0.7, 1.0)
    no_load = rng.uniform(0.02, 0.1) * current
    constant = nominal / (current - no_load)
    if not (SUPPLY / constant < 5000.0 and resistance * current < SUPPLY / 2):
        return random_motor(rng)
    figures: Figures = {
        "nominal_torque": nominal,
        "max_torque": rng.uniform(1.2, 3.0) * nominal,
        "max_speed": SUPPLY / constant * rng.uniform(0.8, 1.6),
        "nominal_voltage": SUPPLY,
        "nominal_current": current,
        "no_load_current": no_load,
        "torque_constant": constant,
        "terminal_resistance": resistance,
        "rotor_inertia": rng.uniform(2e-3, 8e-3) * constant**2 / resistance,
        "resistance_winding_housing": r_inner,
        "resistance_housing_ambient": 10 * r_inner,
        "time_constant_winding": 30 * mass * r_inner,
        "time_constant_motor": slow,
        "max_winding_temperature": 298.15 + rise,
        "mass": mass,
    }
    return {
        name: None if name not in REQUIRED and rng.random() < 0.05 else value
        for name, value in figures.items()
    }


def random_gear(rng: random.Random) -> Figures:
    ratio = rng.choice([40.0, 60.0, 100.0])
    diameter = rng.uniform(8e-3, 12e-3)
    strength = 10 ** rng.uniform(0.0, 2.0)
    figures: Figures = {
        "geometry.ratio": ratio,
        "geometry.worm_diameter": diameter,
        "geometry.lead": rng.uniform(0.02, 0.05) * math.pi * diameter,
        "ratings.continuous_output": strength,
        "ratings.peak_output": 2 * strength,
        "ratings.input_speed": 10 ** rng.uniform(2.3, 3.3),
        "ratings.duty": rng.choice([0.5, 0.8, 1.0]),
        "friction.mu_lowest": 0.08,
        "mass": rng.uniform(0.01, 0.1),
    }
    return {
        name: None if "ratings" in name and rng.random() < 0.15 else value
        for name, value in figures.items()
    }


def written(file: Path, units: dict[str, str], rows: list[Figures]) -> Path:
    lines = [",".join(["name", *units])]
    for k, row in enumerate(rows):
        cells = ("" if (x := row[name]) is None else f"{x!r} {units[name]}" for name in units)
        lines.append(",".join([f"part{k}", *cells]))
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def torques(load: JointLoad, gear: Figures, inertia: float, motor_friction: float) -> Any:
    """Yield the motor torque (n,) and the absolute effort in the mesh (n,) by the law of the paper.

    There is one result for each combination of extreme values of the five friction parameters.
    """
    drive, friction = load.drive, load.drive.friction
    assert friction is not None
    geometry: Any = gear
    ratio, diameter, lead = (
        geometry[f"geometry.{name}"] for name in ("ratio", "worm_diameter", "lead")
    )
    slope = lead / (math.pi * diameter)
    arm = 1 / (ratio * slope)
    cosine = math.cos(
        math.atan(math.tan(drive.dimensions["thread_angle"] / 2) / math.hypot(1, slope))
    )
    way, w, wd = load.direction, ratio * load.qd, ratio * load.qdd
    for ends in itertools.product((1 - SPREAD, 1 + SPREAD), repeat=5):
        mu, b_c, b_v, b_oc, b_ov = (
            end * getattr(friction, name)
            for end, name in zip(ends, ("mu", "b_c", "b_v", "b_oc", "b_ov"), strict=True)
        )
        mu = np.where(load.breakaway > 0, mu * friction.mu_static / friction.mu, mu)
        effort = load.tau_rigid + drive.output_inertia * load.qdd + b_oc * way + b_ov * load.qd
        angle = math.atan(slope) + np.sign(effort * way) * np.arctan(mu / cosine)
        torque = inertia * wd + (b_c + motor_friction) * way + b_v * w
        torque = np.where(way == 0, 0.0, torque + arm * np.tan(angle) * effort)
        yield torque, np.abs(effort)


def passes(load: JointLoad, motor: Figures, gear: Figures) -> bool:
    """Return whether every necessary figure is stated and every limit is kept.

    The limits must be kept for every combination of extreme friction parameters. The winding
    temperature is the steady-state temperature of the RMS torque, which is a lower bound of the
    peak temperature.
    """
    needed = [name for name in MOTOR if name not in ("nominal_current", "no_load_current", "mass")]
    needed.remove("rotor_inertia")  # Its bound follows from the nominal torque.
    if any(motor[name] is None for name in needed) or any(x is None for x in gear.values()):
        return False
    m: Any = motor
    g: Any = gear
    original = load.motor
    assert original is not None
    rotor = m["rotor_inertia"] or m["nominal_torque"] / 2e4
    inertia = load.drive.input_inertia + rotor
    extra = (m["no_load_current"] or 0.0) * m["torque_constant"]
    span, moving = load.duration + PAUSE, load.direction != 0
    speed = np.abs(g["geometry.ratio"] * load.qd)
    is_kept = speed.max() <= min(m["max_speed"], g["ratings.input_speed"]) * (1 + 1e-9)
    is_kept &= load.weight[moving].sum() * load.duration / span <= g["ratings.duty"] * (1 + 1e-9)
    is_kept &= g["friction.mu_lowest"] > g["geometry.lead"] / (
        math.pi * g["geometry.worm_diameter"]
    )
    hottest = m["max_winding_temperature"]
    for torque, effort in torques(load, gear, inertia, extra):
        rms = math.sqrt(load.weight @ torque**2 * load.duration / span)
        is_kept &= np.abs(torque).max() <= m["max_torque"] * (1 + 1e-9)
        is_kept &= rms <= m["nominal_torque"] * (1 + 1e-9)
        for t in (298.15, hottest):
            k = m["torque_constant"] * (1 - 0.0012 * (t - 298.15))
            ohm = m["terminal_resistance"] * (1 + 0.00393 * (t - 298.15))
            volts = ohm * torque / k + k * g["geometry.ratio"] * load.qd
            is_kept &= np.abs(volts).max() <= SUPPLY * (1 + 1e-9)
        mean = math.sqrt(load.weight @ torque**2 * load.duration / span)
        r = m["resistance_winding_housing"] + m["resistance_housing_ambient"]
        t = 298.15
        for _ in range(300):
            k = m["torque_constant"] * max(1 - 0.0012 * (t - 298.15), 0.05)
            ohm = m["terminal_resistance"] * (1 + 0.00393 * (t - 298.15))
            t = min(298.15 + r * ohm * (mean / k) ** 2, 2000.0)
        is_kept &= t <= hottest + 1e-6  # The mean temperature does not exceed the peak.
        is_kept &= effort.max() <= g["ratings.peak_output"] * (1 + 1e-9)
        share = load.weight[moving]
        cube = (share @ effort[moving] ** 3 / share.sum()) ** (1 / 3)
        is_kept &= cube <= g["ratings.continuous_output"] * (1 + 1e-9)
    return bool(is_kept)


@pytest.fixture(scope="module")
def axes() -> tuple[JointLoad, ...]:
    return joint_loads(random_trajectory(3, duration=6.0), load_robot("vitreoretinal"), rate=30.0)


@pytest.mark.slow
def test_no_pair_of_a_random_catalogue_passes_without_a_figure(
    axes: tuple[JointLoad, ...], tmp_path: Path
) -> None:
    answers: Counter[tuple[bool | None, bool]] = Counter()
    # The two seeds of a pair select different axes.
    pairs = [(0, 1), (2, 3), (4, 5)]
    for seed in itertools.chain(*drawn(1, pairs)):
        answers += compared(axes, tmp_path, seed)
    assert answers[True, True] > 20
    assert answers[False, False] > 20
    assert answers[None, False] > 20


def compared(
    axes: tuple[JointLoad, ...], tmp_path: Path, seed: int
) -> Counter[tuple[bool | None, bool]]:
    """Count the answers on one random catalogue by answer of the package and answer of the oracle.

    A yes or a no of the package must agree with the oracle.
    """
    rng = random.Random(seed)
    motors = [random_motor(rng) for _ in range(40)]
    gears = [random_gear(rng) for _ in range(8)]
    load = axes[seed % 2]
    conditions = Conditions(spread=SPREAD, supply_voltage=None, pause=PAUSE)
    selection = select_joint(
        load,
        read_motors(written(tmp_path / "motors.csv", MOTOR, motors)),
        drives_with_gears(written(tmp_path / "gears.csv", GEAR, gears), load.drive),
        conditions,
        inertia=0.01,
    )
    answers: Counter[tuple[bool | None, bool]] = Counter()
    table = selection.to_dict("mass", 4)
    json.dumps(table, allow_nan=False)
    for g, m in np.ndindex(selection.adequate.shape):
        answer, right = table["adequate"][g][m], passes(load, motors[m], gears[g])
        answers[answer, right] += 1
        assert not (answer is True and not right), (motors[m], gears[g])
        assert not (answer is False and right), (motors[m], gears[g])
        assert bool(table["open"][g][m]) is (answer is None)
        assert bool(table["ruled_out_by"][g][m]) is (answer is False)
    assert_ranked(selection)
    for pair in table["best"]:
        if pair["adequate"] is None:
            assert all(pair["not_checked"].values())
            assert pair["not_checked"]
    return answers


def assert_ranked(selection: JointSelection) -> None:
    """Assert that pairs that pass come before open pairs.

    Among pairs of equal rank, those with a stated mass precede those without.
    """
    adequate = selection.adequate
    pairs = selection.ranked("mass")
    ranks = [int(adequate[pair]) for pair in pairs]
    assert ranks == sorted(ranks, reverse=True)
    for answer in (0, 1):
        group = [pair for pair in pairs if adequate[pair] == answer]
        own = [min(a[pair] for a in selection.answers.values()) for pair in group]
        assert own == sorted(own, reverse=True)
        for value in set(own):
            stated = [
                selection.motors[m].mass is not None and selection.gears[g].gear.mass is not None
                for (g, m), answer_of_motor in zip(group, own, strict=True)
                if answer_of_motor == value
            ]
            assert stated == sorted(stated, reverse=True)
