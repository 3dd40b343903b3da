"""A selection from catalogues gives each pair of motor and gear the verdict of `size`.

The pairs are ranked, and a faulty row is refused with the number of its line.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ssm_planner.cli import main
from ssm_planner.dynamics import drive_with_values
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.errors import ProblemError
from ssm_planner.loading.catalogues import CatalogueEntry, drives_with_gears, read_motors
from ssm_planner.loading.load import load_robot
from ssm_planner.sizing.duty import DutyCycle
from ssm_planner.sizing.motor_limits import Conditions
from ssm_planner.sizing.selection import (
    CornerTorques,
    energy_to_bus,
    load_inertias,
    select_motors,
)
from tests.support.paths import PROBLEMS
from tests.support.sizing_cases import COMPLETE, random_trajectory, with_covariance

MOTORS, WORMS, SCREWS = (Path(f"{name}.csv") for name in ("motors_24v", "worms", "screws"))
ANSWERS = {1: True, 0: None, -1: False}


@pytest.fixture(scope="module")
def duty():
    return DutyCycle.of_trajectory(random_trajectory(3, duration=2.0), load_robot("vitreoretinal"))


@pytest.fixture(scope="module")
def motors():
    """Return every ninth motor of the shipped catalogue.

    The first has no rotor inertia. The second has no winding time constant and no terminal
    resistance.
    """
    some = read_motors(MOTORS)[::9]
    first, second, *rest = some
    return [
        replace(first, of=replace(first.of, rotor_inertia=None)),
        replace(
            second, of=replace(second.of, time_constant_winding=None, terminal_resistance=None)
        ),
        *rest,
    ]


def gears(duty, covariance=False):
    result = {}
    for joint in duty.robot.joints:
        if joint.drive is not None:
            parts = [
                part for file in (WORMS, SCREWS) for part in drives_with_gears(file, joint.drive)
            ]
            result[joint.name] = [*parts[::6], CatalogueEntry("own", joint.drive)]
            if covariance:
                result[joint.name] = [CatalogueEntry("own", with_covariance(joint.drive))]
    return result


@pytest.mark.parametrize(
    ("conditions", "covariance"),
    [
        (Conditions(), False),
        (Conditions(spread=0.2, pause=1.0), False),
        (Conditions(ambient=340.0, supply_voltage=12.0, current_limit=0.6, spread=0.1), False),
        (Conditions(confidence=0.9), True),
    ],
)
@pytest.mark.slow
def test_every_pair_has_the_verdict_and_the_margins_of_size(duty, motors, conditions, covariance):
    answers = set()
    for joint in select_motors(duty, motors, gears(duty, covariance), conditions, payload=0.5):
        adequate = joint.adequate
        for g, m in np.ndindex(adequate.shape):
            verdict = joint.verdict(g, m)
            assert ANSWERS[int(adequate[g, m])] is verdict.adequate
            answers.add(verdict.adequate)
            passed = {check.name: check.passed for check in (*verdict.checks, *verdict.gear)}
            fails = {name for name, answer in passed.items() if answer is False}
            ruled_out = set(joint.checks_with(-1, g, m))
            assert ruled_out <= fails
            assert bool(ruled_out) == bool(fails)
            for check in verdict.checks:
                if check.name in joint.margins and np.isfinite(joint.margins[check.name][g, m]):
                    assert joint.margins[check.name][g, m] == pytest.approx(
                        check.margin, rel=1e-9, abs=1e-9
                    )
    assert len(answers) > 1


@pytest.mark.parametrize("seed", range(6))
def test_peaks_over_all_corners_are_those_of_a_search_through_all_corners(duty, seed):
    """The smallest peak is exact wherever it decides, and a lower bound elsewhere."""
    rng = np.random.default_rng(seed)
    load = duty.loads()[seed % 3]
    ranges = {"mu": (0.02, 0.3), "b_c": (0.0, 2e-3), "b_v": (0.0, 1e-5)}
    corners = [{name: rng.uniform(*ends) for name, ends in ranges.items()} for _ in range(5)]
    share = rng.uniform(0.1, 1.0, (2, 3, 4))
    inertia = rng.uniform(0.0, 3e-6, (2, 3, 4))
    friction = np.broadcast_to(rng.uniform(0.0, 3e-3, (3, 4)), (2, 3, 4))
    factors = np.stack([share, inertia, friction, rng.uniform(0.0, 1e-4, (2, 3, 4))], axis=-1)
    states = [factors, factors * [1.3, 1.3, 1.3, 0.8]]
    motion = [load.acceleration() * (load.direction != 0), load.direction, load.speed()]
    peaks = []
    for corner in corners:
        drive = drive_with_values(load.drive, {**corner, "input_inertia": 0.0})
        parts = np.stack([replace(load, drive=drive).torque(), *motion])
        peaks.append([np.abs(state @ parts).max(axis=-1) for state in states])
    by_corner = np.max(peaks, axis=1)
    exact = by_corner.min(axis=(0, 1))
    limit = exact * rng.uniform(0.9, 1.1, (3, 4))
    torques = CornerTorques(load, corners)
    largest, smallest = torques.peaks(states, torques.extremes, limit)
    assert largest == pytest.approx(by_corner.max(axis=(0, 1)), rel=1e-12)
    assert np.all(smallest <= exact * (1 + 1e-12))
    is_above = largest > limit
    assert np.any(is_above & (exact < limit))
    assert np.array_equal((smallest > limit)[is_above], (exact > limit)[is_above])
    is_reached = is_above & (exact <= limit)
    assert smallest[is_reached] == pytest.approx(exact[is_reached], rel=1e-12)


def test_pairs_are_ranked_by_what_is_asked_and_none_that_is_ruled_out_is_among_them(duty, motors):
    without_mass = 0
    for joint in select_motors(duty, motors, gears(duty)):
        pairs = joint.ranked("mass")
        assert all(joint.adequate[pair] >= 0 for pair in pairs)
        assert len(pairs) == int((joint.adequate >= 0).sum())
        # A gear of unknown mass must not count as a gear without mass.
        unknown = [joint.gears[g].gear.mass is None for g, _ in pairs]
        assert unknown == sorted(unknown)
        without_mass += sum(unknown)
        mass = [
            joint.motors[m].mass + joint.gears[g].gear.mass
            for g, m in pairs
            if joint.gears[g].gear.mass is not None
        ]
        assert mass == sorted(mass)
        # The smallest margin of a pair is unknown if any of its margins is unknown.
        worst = [
            np.min([margins[pair] for margins in joint.margins.values()])
            for pair in joint.ranked("margin")
        ]
        known = [margin for margin in worst if np.isfinite(margin)]
        assert known == sorted(known, reverse=True)
        assert np.isfinite(worst[: len(known)]).all()
    assert without_mass > 0


def test_a_mass_that_no_gear_states_leaves_the_rank_to_the_motors(duty, motors):
    """Motors are ranked by their own mass if no gear states a mass.

    Without the option --gears, every motor drives the present gear of the joint, whose mass no file
    states.
    """
    heavier = [replace(part, mass=1.0 + k) for k, part in enumerate(reversed(motors))]
    (joint, *_) = select_motors(duty, [*heavier, replace(motors[0], mass=None)], {})
    order = [m for _, m in joint.ranked("mass")]
    assert order == sorted(order)


def test_energy_to_the_bus_and_inertia_ratio_follow_from_their_definitions(duty):
    """With little resistance, the energy to the bus equals the returned mechanical energy.

    The load inertia of a joint is its largest effort per unit of acceleration.
    """
    motor = replace(COMPLETE, terminal_resistance=1e-9)
    for joint in select_motors(duty, [CatalogueEntry("complete", motor)], {}):
        verdict = joint.verdict(0, 0)
        assert energy_to_bus(verdict.load, motor) == pytest.approx(
            verdict.requirement.returned_energy, abs=1e-9
        )
        assert energy_to_bus(verdict.load, replace(motor, terminal_resistance=1e6)) == 0.0
        assert energy_to_bus(verdict.load, replace(motor, terminal_resistance=None)) is None
    inertias = load_inertias(duty)
    q = duty.runs[0][0].sample(np.linspace(0, 2, 200)).q
    for i, joint in enumerate(duty.robot.joints):
        push = np.zeros_like(q)
        push[:, i] = 1.0
        body = RigidBody.from_robot(duty.robot)
        effort = body.inverse_dynamics(q, 0 * q, push) - body.inverse_dynamics(q, 0 * q, 0 * q)
        assert inertias[joint.name] == pytest.approx(effort[:, i].max())


def test_a_gear_replaces_geometry_and_ratings_and_keeps_the_friction(tmp_path):
    own = load_robot("vitreoretinal").joints[0].drive
    file = tmp_path / "gears.csv"
    file.write_text(
        "name,geometry.ratio,geometry.worm_diameter,geometry.lead [mm],ratings.input_speed,mass [g]\n"
        "small,60,8 mm,1.25664,4000 rpm,12\n",
        encoding="utf-8",
    )
    (part,) = drives_with_gears(file, own)
    assert part.of.ratio == pytest.approx(60)
    assert part.of.gamma == pytest.approx(np.pi * 8 / (60 * 1.25664), rel=1e-5)
    assert part.of.friction.mu == own.friction.mu
    assert part.of.ratings.input_speed == pytest.approx(4000 * np.pi / 30)
    assert part.mass == pytest.approx(0.012)
    assert drives_with_gears(file, load_robot("vitreoretinal").joints[3].drive) == []


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("2.64 mN*m", "2.64 rpm", r"motors\.csv:2: nominal_torque = 2.64 rpm"),
        ("0.13 g*cm^2", "0.13 kg*m^2", r"motors\.csv:2: rotor_inertia = .*implausible"),
        ("ECXZ13M1VF40N1IL1D561A", "ECXZ13M3KN48K1ST1D497A", r"motors\.csv:3: .*occurs twice"),
    ],
)
def test_a_fault_in_a_row_is_named_with_its_line(tmp_path, old, new, message):
    file = tmp_path / "motors.csv"
    shipped = PROBLEMS / "catalogues" / "motors_24v.csv"
    file.write_text(shipped.read_text(encoding="utf-8").replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ProblemError, match=message):
        read_motors(file)


@pytest.mark.slow
def test_the_command_says_what_is_left_and_what_rules_out_the_others(tmp_path, capsys):
    motion = PROBLEMS / "motorisation" / "paper.yaml"
    words = [
        "size",
        str(motion),
        "--catalogue",
        "motors_24v.csv",
        "--gears",
        "worms.csv",
        "screws.csv",
    ]
    assert main([*words, "-o", str(tmp_path)]) in (0, 1)
    text = capsys.readouterr().out
    assert "roll: 48 motors × 30 gears" in text
    assert "insertion: 48 motors × 15 gears" in text
    document = json.loads((tmp_path / "selection.json").read_text(encoding="utf-8"))
    for joint in document["selection"]:
        assert np.shape(joint["adequate"]) == (len(joint["gears"]), 48)
        assert len(joint["best"]) <= 10
    assert main([*words, "--motor", "x.yaml"]) == 2
    assert main(["size", str(motion), "--catalogue", str(tmp_path / "none.csv")]) == 2
