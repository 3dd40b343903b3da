"""The torque of a transmission obeys the exact law, and two linear rows bound this law.

Further tests cover the friction laws by name, standstill, breakaway and the power in the mesh.
"""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssm_planner.dynamics import transmission as tr
from ssm_planner.dynamics.friction import (
    breakaway_coefficient,
    delayed_speed,
    friction_coefficient,
    static_coefficient,
)
from ssm_planner.errors import ProblemError
from ssm_planner.problem.drive import Drive, Friction

LAM = math.radians(2.8625)
FRICTION = Friction(mu=0.12, mu_static=0.15, b_c=5.5e-4, b_v=1.15e-5, b_oc=4e-3)


def worm(**changes) -> Drive:
    thread = math.radians(40)
    drive = Drive(
        name="worm",
        kind="worm",
        ratio=60.0,
        gamma=1.0 / (60.0 * math.tan(LAM)),
        lead_angle=LAM,
        pressure_angle=math.atan(math.tan(thread / 2) * math.cos(LAM)),
        input_inertia=6.5e-7,
        output_inertia=8.5e-6,
        friction=FRICTION,
    )
    return replace(drive, **changes)


def screw(kind: str = "lead_screw") -> Drive:
    lead, d = 2e-3, 11e-3
    lam = math.atan(lead / (math.pi * d))
    return Drive(
        name=kind,
        kind=kind,
        ratio=2 * math.pi / lead,
        gamma=d / 2,
        lead_angle=lam,
        pressure_angle=math.atan(math.tan(math.radians(15)) * math.cos(lam)),
        input_inertia=2.2e-6,
        output_inertia=0.18,
        friction=Friction(mu=0.2, mu_static=0.25, b_c=2e-3, b_v=3e-5, b_oc=2e-2, b_ov=1e-3),
        preload=0.8 if kind == "antibacklash_screw" else 0.0,
        second_nut_mass=0.05 if kind == "antibacklash_screw" else 0.0,
    )


DRIVES = [worm(), screw(), screw("antibacklash_screw")]
efforts = st.floats(-0.5, 0.5)
speeds = st.floats(0.01, 200.0)
signs = st.sampled_from([-1.0, 1.0])
mus = st.floats(0.0, 0.6)


@given(efforts, speeds, signs, st.floats(-500, 500))
def test_the_exact_law_is_the_formula(effort, speed, sign, wd):
    drive, f = worm(), FRICTION
    phi = math.atan(f.mu / math.cos(drive.pressure_angle))
    w = sign * speed
    branch = math.tan(drive.lead_angle + math.copysign(phi, effort * w))
    expected = drive.input_inertia * wd + f.b_c * sign + f.b_v * w + drive.gamma * branch * effort
    assert tr.motor_torque(drive, effort, w, wd) == pytest.approx(expected, rel=1e-12, abs=1e-18)


@pytest.mark.parametrize("drive", DRIVES, ids=lambda d: d.kind)
@given(effort=efforts, speed=speeds, sign=signs, wd=st.floats(-500, 500), mu=mus)
def test_two_linear_rows_bound_the_torque_exactly(drive, effort, speed, sign, wd, mu):
    rows = tr.motor_torque_rows(drive, int(sign), mu)
    each = (
        np.array(rows.slope) * effort
        + rows.inertia * wd
        + rows.coulomb
        + rows.viscous * sign * speed
    )
    exact = tr.motor_torque(drive, effort, sign * speed, wd, mu=mu)
    assert (each.max() if sign > 0 else each.min()) == pytest.approx(exact, rel=1e-12, abs=1e-16)


@pytest.mark.parametrize("drive", DRIVES[:2], ids=lambda d: d.kind)
@given(effort=efforts, sign=signs, low=mus, high=mus)
def test_torque_in_the_direction_of_motion_grows_with_mu(drive, effort, sign, low, high):
    low, high = min(low, high), max(low, high)
    few, many = (sign * tr.motor_torque(drive, effort, sign, 0.0, mu=mu) for mu in (low, high))
    assert many >= few - 1e-15


@pytest.mark.parametrize("drive", DRIVES, ids=lambda d: d.kind)
@pytest.mark.parametrize("law", ["coulomb", "stribeck_gaussian", "stribeck_exponential"])
def test_the_laws_have_the_same_values_in_casadi_and_numpy(drive, law):
    stribeck = {} if law == "coulomb" else {"mu_stribeck": 0.06, "stribeck_speed": 0.7}
    drive = replace(drive, friction=replace(drive.friction, law=law, **stribeck))
    rng = np.random.default_rng(1)
    F, w, wd = rng.normal(size=(3, 200)) * [[0.5], [5.0], [100.0]]
    w[:50] = 0.0
    sign = np.where(w == 0, rng.integers(-1, 2, 200), np.sign(w))

    def laws(F, w, wd, sign):
        return (
            tr.motor_torque(drive, F, w, wd),
            tr.motor_torque(
                drive, F, w, wd, direction=sign, mu=breakaway_coefficient(drive.friction, w)
            ),
            tr.breakaway_torque(drive, F, sign),
            tr.holding_torque(drive, F),
        )

    symbols = [ca.SX.sym(name) for name in ("F", "w", "wd", "sign")]
    expected = laws(F, w, wd, sign)
    for result, value in zip(
        ca.Function("laws", symbols, laws(*symbols)).map(200)(F, w, wd, sign), expected, strict=True
    ):
        assert result.full()[0] == pytest.approx(value, rel=1e-14, abs=1e-18)


def test_a_drive_starts_against_the_larger_of_static_and_kinetic_friction():
    stribeck = replace(FRICTION, law="stribeck_gaussian", mu_stribeck=0.2, stribeck_speed=0.7)
    assert breakaway_coefficient(FRICTION) == FRICTION.mu_static
    assert breakaway_coefficient(stribeck) == pytest.approx(0.32)
    assert breakaway_coefficient(stribeck, 1e3) == FRICTION.mu_static


def test_broadcasting_and_standstill():
    """The torque broadcasts its arguments and is zero at standstill without a direction.

    With a direction and static friction, it equals the breakaway torque.
    """
    drive = worm()
    tau = tr.motor_torque(drive, np.full((5, 1), 0.1), np.array([[-2.0, 0.0, 2.0]]), 0.0)
    assert tau.shape == (5, 3)
    assert np.all(tau[:, 1] == 0.0)
    about_to_move = tr.motor_torque(
        drive, 0.1, 0.0, 0.0, direction=1.0, mu=drive.friction.mu_static
    )
    assert about_to_move == pytest.approx(tr.breakaway_torque(drive, 0.1 - FRICTION.b_oc, 1.0))


@given(st.floats(-1.0, 1.0))
def test_a_self_locking_drive_holds_without_torque_and_another_does_not(load):
    assert tr.holding_torque(worm(), load) == 0.0
    slippery = worm(
        friction=replace(FRICTION, mu=0.01, mu_static=0.01, b_c=0.0, b_oc=0.0), self_locking=False
    )
    held = tr.holding_torque(slippery, load)
    down = slippery.gamma * math.tan(LAM - math.atan(0.01 / math.cos(slippery.pressure_angle)))
    assert held == pytest.approx(down * load, rel=1e-9, abs=1e-15)


@given(st.floats(-1.0, 1.0), mus)
def test_breakaway_torques_enclose_the_holding_torque(load, mu):
    low, high = (tr.breakaway_torque(worm(), load, s, mu) for s in (-1.0, 1.0))
    assert low < high
    assert low <= tr.holding_torque(worm(), load, mu) <= high


@pytest.mark.parametrize("drive", DRIVES[:2], ids=lambda d: d.kind)
@given(mu=mus)
def test_efficiencies_are_power_ratios_of_the_mesh(drive, mu):
    up, down = tr.mesh_coefficients(drive, mu)
    forward, backward = 1.0 / (drive.ratio * up), drive.ratio * down
    lam, phi = drive.lead_angle, float(tr.friction_angle(drive, mu))
    assert forward == pytest.approx(math.tan(lam) / math.tan(lam + phi), rel=1e-9)
    assert backward == pytest.approx(math.tan(lam - phi) / math.tan(lam), rel=1e-9, abs=1e-12)
    bare = replace(
        drive, friction=Friction(mu=mu, mu_static=mu, b_c=0.0, b_v=0.0), self_locking=False
    )
    power_in = tr.motor_torque(bare, 2.0, drive.ratio, 0.0) * drive.ratio
    assert 2.0 / power_in == pytest.approx(forward, rel=1e-9)


def test_self_locking_margin_changes_sign_where_tan_of_lead_meets_friction():
    drive = worm()
    critical = math.cos(drive.pressure_angle) * math.tan(drive.lead_angle)
    in_mu, in_angle = tr.self_locking_margin(drive, critical)
    assert in_mu == pytest.approx(0.0, abs=1e-15)
    assert in_angle == pytest.approx(0.0, abs=1e-15)
    assert (
        min(tr.self_locking_margin(drive, critical + 1e-6))
        > 0
        > max(tr.self_locking_margin(drive, critical - 1e-6))
    )
    assert tr.mesh_coefficients(drive, critical)[1] == pytest.approx(0.0, abs=1e-15)


@given(st.floats(-0.79, 0.79), signs, st.floats(-100, 100))
def test_antibacklash_screw_is_two_nuts_under_the_general_law(effort, sign, wd):
    drive = screw("antibacklash_screw")
    f = drive.friction
    second = drive.preload + drive.second_nut_mass * wd / drive.ratio
    each = Drive(
        **{
            **drive.__dict__,
            **{
                "kind": "lead_screw",
                "input_inertia": 0.0,
                "friction": replace(f, b_c=0.0, b_v=0.0),
            },
            **{"preload": 0.0, "second_nut_mass": 0.0},
        }
    )
    nuts = tr.motor_torque(each, effort - drive.preload, sign, 0.0) + tr.motor_torque(
        each, second, sign, 0.0
    )
    expected = nuts + drive.input_inertia * wd + f.b_c * sign + f.b_v * sign
    assert tr.motor_torque(drive, effort, sign, wd) == pytest.approx(expected, rel=1e-10)
    assert tr.nut_contact_force(drive, effort, wd) == pytest.approx(
        min(drive.preload - effort, second)
    )


def test_contact_is_lost_where_the_load_exceeds_the_preload():
    drive = screw("antibacklash_screw")
    assert tr.nut_contact_force(drive, 0.9, 0.0) < 0 < tr.nut_contact_force(drive, 0.7, 0.0)
    assert np.isinf(tr.nut_contact_force(worm(), 0.9, 0.0))


def test_friction_laws_by_name():
    assert friction_coefficient(FRICTION, 1.0) == 0.12
    exponential = replace(
        FRICTION, law="stribeck_exponential", mu_stribeck=0.05, stribeck_speed=2.0
    )
    gaussian = replace(exponential, law="stribeck_gaussian")
    assert friction_coefficient(exponential, -1.0) == pytest.approx(
        0.12 + 0.05 * math.exp(-2 * 0.5)
    )
    assert friction_coefficient(gaussian, 1.0) == pytest.approx(0.12 + 0.05 * math.exp(-0.25))
    for friction in (exponential, gaussian):
        assert friction_coefficient(friction, 0.0) == pytest.approx(0.17)


def test_friction_at_rest_grows_from_arrival_to_its_limit():
    friction = replace(FRICTION, dwell_constant=1.5)
    grown = static_coefficient(friction, np.array([0.0, 0.5, 2.0, 1e9]))
    assert grown[0] == friction.mu
    assert np.all(np.diff(grown) > 0)
    assert grown[-1] == pytest.approx(friction.mu_static)
    assert grown[2] == pytest.approx(0.12 + 0.03 * math.exp(-0.75))
    assert static_coefficient(FRICTION, 0.0) == FRICTION.mu_static


def test_memory_delays_the_speed_by_a_constant():
    time = np.linspace(0, 2, 201)
    w = np.sin(time)
    assert delayed_speed(replace(FRICTION, memory=0.5), time, w)[100] == pytest.approx(
        math.sin(0.5), abs=1e-6
    )


def test_unidentified_friction_and_bad_directions_are_refused():
    with pytest.raises(ProblemError, match="identified"):
        tr.motor_torque(worm(friction=None), 0.1, 1.0, 0.0)
    with pytest.raises(ValueError, match="direction"):
        tr.motor_torque_rows(worm(), 0)
