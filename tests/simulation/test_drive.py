"""The forward simulation of one drive inverts the inverse dynamics and balances the energy. A drive
that locks itself stands still, and fixed steps converge to an adaptive integration.
"""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssm_planner.dynamics.transmission import (
    breakaway_torque,
    effective_inertia,
    motor_acceleration,
    motor_torque,
    output_effort,
)
from ssm_planner.loading.load import load_drive
from ssm_planner.problem.drive import Friction
from ssm_planner.simulation.drive import drive_step, inertia_at_motor, with_blocked_motor
from tests.support.adaptive_drive import (
    breaks_away,
    friction_power,
    simulate_drive,
    simulate_drive_fixed,
    slip_acceleration,
    with_load,
)
from tests.support.arm_motion import NOT_UNIQUE, always_unique
from tests.support.paths import PROBLEMS
from tests.support.velocity_control import Servo, servo_for

DRIVES = PROBLEMS / "drives"
FRICTION = {
    "rig1_lead_screw": Friction(0.27, 0.3, 1e-3, 3e-5, 3e-2, 1e-3),
    "rig2_antibacklash_screw": Friction(0.2, 0.23, 2e-3, 3e-5, 2e-2),
    "rig3_worm": Friction(
        0.12,
        0.18,
        5.5e-4,
        1.15e-5,
        4e-3,
        law="stribeck_exponential",
        mu_stribeck=0.06,
        stribeck_speed=0.688,
    ),
}
RIGS = tuple(FRICTION)


def rig(name: str):
    """Return the drive of a rig, the load effort and the load inertia, in SI units."""
    drive = load_drive(DRIVES / f"{name}.yaml")
    return replace(drive, friction=FRICTION[name]), drive.rig.F_payload, drive.rig.payload_inertia


@pytest.mark.parametrize("name", RIGS)
@given(
    wd=st.floats(-2000, 2000),
    speed=st.floats(0.01, 50),
    sign=st.sampled_from([-1, 1]),
    load=st.floats(-1, 1),
)
def test_forward_dynamics_inverts_the_inverse_law(name, wd, speed, sign, load):
    drive, scale, inertia = rig(name)
    drive, load, w = with_load(drive, inertia), load * abs(scale), sign * speed
    effort = output_effort(drive, load, w / drive.ratio, wd / drive.ratio)
    tau = float(motor_torque(drive, effort, w, wd, mu=0.2))
    slip = slip_acceleration(drive, tau, w, load, sign, 0.2)
    assert slip.outcome == "unique"
    assert slip.wd == pytest.approx(wd, rel=1e-9, abs=1e-6)
    assert slip.effort == pytest.approx(effort, rel=1e-9, abs=1e-9)
    found = motor_acceleration(drive, tau, w, load, sign, 0.2)
    assert found == pytest.approx((slip.wd, slip.effort), rel=1e-12, abs=1e-12)
    assert friction_power(drive, w, slip.effort, sign, 0.2, slip.wd) >= -1e-15


def test_a_large_load_inertia_leaves_no_unique_motion():
    drive, load, _ = rig("rig3_worm")
    heavy = with_load(drive, 0.05)
    assert always_unique(with_load(drive, 1e-4))
    assert not always_unique(heavy)
    assert effective_inertia(heavy)[1] < 0 < effective_inertia(heavy)[0]
    mu = 0.12
    steady = float(motor_torque(heavy, output_effort(heavy, load, 5 / 60, 0), 5.0, 0.0, mu=mu))
    assert slip_acceleration(heavy, steady, 5.0, load, 1, mu).outcome == "several"
    assert slip_acceleration(heavy, 0.0, 5.0, load, 1, mu).outcome == "none"
    stopped = simulate_drive(
        drive, servo_for(drive, 0.02), lambda t: 5.0, 1.0, load=load, load_inertia=0.05
    )
    assert stopped.status == NOT_UNIQUE
    fixed = simulate_drive_fixed(drive, None, np.zeros(5), load=load, load_inertia=0.05)
    assert fixed.status == NOT_UNIQUE


@pytest.mark.parametrize("name", RIGS)
@pytest.mark.parametrize("w", [3.0, -3.0, 20.0])
def test_steady_state_is_the_inverse_law(name, w):
    drive, load, inertia = rig(name)
    servo = servo_for(drive, 0.02, bandwidth=200.0)
    adaptive = simulate_drive(
        drive, servo, lambda t: w, 2.0, load=load, load_inertia=inertia, rtol=1e-10
    )
    fixed = simulate_drive_fixed(drive, servo, np.full(2000, w), load=load, load_inertia=inertia)
    for motion in (adaptive, fixed):
        assert motion.status == "done"
        effort = output_effort(drive, load, motion.w[-1] / drive.ratio, 0.0)
        assert motion.tau[-1] == pytest.approx(
            float(motor_torque(drive, effort, motion.w[-1], 0.0)), rel=1e-6
        )
        assert motion.w[-1] == pytest.approx(w, rel=1e-6)


@pytest.mark.parametrize("name", RIGS)
def test_move_rest_move_back(name):
    """The drive starts, stops, starts backwards and stops. A start needs the breakaway torque."""
    drive, load, inertia = rig(name)
    servo = servo_for(drive, 0.02, bandwidth=200.0)

    def wanted(t: float) -> float:
        return 5.0 * (0.1 < t < 1.0) - 5.0 * (1.5 < t < 2.4)

    motion = simulate_drive(
        drive, servo, wanted, 3.0, load=load, load_inertia=inertia, max_step=0.05
    )
    assert [name for _, name in motion.events] == [
        "starts forwards",
        "stops",
        "starts backwards",
        "stops",
    ]
    assert motion.energy_error < 1e-7
    assert np.all(motion.w[motion.state == 0] == 0.0)
    assert np.all(np.diff(motion.dissipated) >= -1e-15)
    for time, name_of_event in motion.events:
        if name_of_event.startswith("starts"):
            k = int(np.searchsorted(motion.time, time))
            sign = 1.0 if name_of_event.endswith("forwards") else -1.0
            assert motion.tau[k] == pytest.approx(
                float(breakaway_torque(drive, load, sign)), rel=1e-5
            )


@pytest.mark.parametrize("name", RIGS)
def test_fixed_steps_tend_to_the_adaptive_motion(name):
    drive, load, inertia = rig(name)
    servo = servo_for(drive, 0.02, bandwidth=100.0)
    exact = simulate_drive(
        drive, servo, lambda t: 6.0 * math.sin(6 * t), 2.0, load=load, load_inertia=inertia
    )
    errors = []
    for period in (4e-3, 1e-3, 2.5e-4):
        time = np.arange(0.0, 2.0, period)
        motion = simulate_drive_fixed(
            drive, servo, 6.0 * np.sin(6 * time), period=period, load=load, load_inertia=inertia
        )
        assert motion.energy_error < 1e-3
        errors.append(np.max(np.abs(np.interp(time, exact.time, exact.angle) - motion.angle)))
    assert errors[2] < 0.35 * errors[1] < 0.15 * errors[0]


@pytest.mark.parametrize("name", RIGS)
def test_a_self_locking_drive_stays_without_power_and_a_slippery_one_runs(name):
    drive, load, inertia = rig(name)
    off = Servo(0.0, 0.0, 0.0)
    for motion in (
        simulate_drive(drive, off, lambda t: 0.0, 60.0, load=load, load_inertia=inertia),
        simulate_drive_fixed(drive, None, np.zeros(2000), load=load, load_inertia=inertia),
    ):
        assert np.all(motion.angle == 0.0)
        assert motion.energy_error == 0.0
    slippery = replace(
        drive, friction=Friction(0.01, 0.01, 0.0, 0.0), preload=0.0, self_locking=False
    )
    motion = simulate_drive(slippery, off, lambda t: 0.0, 0.5, load=load, load_inertia=inertia)
    loaded = with_load(slippery, inertia)
    expected = slip_acceleration(loaded, 0.0, 0.0, load, 1, 0.01).wd
    assert expected > 0
    assert motion.angle[-1] == pytest.approx(0.5 * expected * 0.5**2, rel=1e-6)
    assert motion.energy_error < 1e-8


def test_stick_slip_where_static_friction_exceeds_kinetic():
    """The drive sticks and slips only if its static friction exceeds the kinetic friction."""
    drive, load, inertia = rig("rig3_worm")
    soft = Servo(2e-5, 2e-3, 0.02)
    rough = replace(drive, friction=Friction(0.12, 0.3, 5.5e-4, 0.0, 4e-3))
    motion = simulate_drive(rough, soft, lambda t: -1.0, 30.0, load=load, load_inertia=inertia)
    names = [name for _, name in motion.events]
    assert names.count("stops") >= 3
    assert names.count("starts backwards") >= 3
    smooth = replace(rough, friction=replace(rough.friction, mu_static=0.12))
    calm = simulate_drive(smooth, soft, lambda t: -1.0, 30.0, load=load, load_inertia=inertia)
    assert len(calm.events) <= 2


def test_a_longer_rest_needs_more_torque_to_leave():
    drive, load, _ = rig("rig3_worm")
    drive = replace(
        drive, friction=replace(FRICTION["rig3_worm"], mu_static=0.5, dwell_constant=0.5)
    )
    servo = servo_for(drive, 0.02, bandwidth=200.0)
    torques = []
    for rest in (0.1, 0.5, 3.0):

        def wanted(t: float, rest: float = rest) -> float:
            return -5.0 if t < 0.5 or t > 0.5 + rest else 0.0

        motion = simulate_drive(drive, servo, wanted, rest + 1.0, load=load, max_step=0.02)
        start = next(
            time for time, name in motion.events if name == "starts backwards" and time > 0.5
        )
        torques.append(-motion.tau[np.searchsorted(motion.time, start)])
    assert torques[0] < torques[1] < torques[2]


def test_breakaway_is_exactly_at_its_torque():
    drive, load, _ = rig("rig3_worm")
    high, low = (float(breakaway_torque(drive, load, s)) for s in (1.0, -1.0))
    assert [
        breaks_away(drive, tau, load, 0.18)
        for tau in (low * 1.001, low * 0.999, high * 0.999, high * 1.001)
    ] == [
        -1,
        0,
        0,
        1,
    ]


@pytest.mark.parametrize("name", RIGS)
def test_a_step_of_a_drive_balances_its_energy_whether_it_slides_stops_or_stands(name):
    """The work of motor and load equals the gain of kinetic energy plus the friction loss.

    The drive slides through the step, stops within it, or stands during it.
    """
    drive, scale, _ = rig(name)
    w, rest, tau, load = (ca.SX.sym(item) for item in ("w", "rest", "tau", "load"))
    h = 4e-4
    moved = drive_step(drive, w, rest, tau, load, h=h)
    held = with_blocked_motor(drive, moved, ca.SX(1), w=w, load=load, tau=tau, h=h)
    free = with_blocked_motor(drive, moved, ca.SX(0), w=w, load=load, tau=tau, h=h)
    function = ca.Function(
        "step", [w, rest, tau, load], [ca.vertcat(*vars(x).values()) for x in (moved, held, free)]
    )
    twice = drive_step(drive, w, rest, tau, load, h=2 * h)
    longer = ca.Function("longer", [w, rest, tau, load], [ca.vertcat(*vars(twice).values())])
    inertia = drive.input_inertia + (drive.output_inertia + drive.second_nut_mass) / drive.ratio**2
    assert inertia_at_motor(drive) == pytest.approx(inertia)
    rng, seen = np.random.default_rng(2), set()
    strong = 2 * abs(float(breakaway_torque(drive, scale, 1.0)))
    for _ in range(400):
        speed = float(rng.choice([0.0, rng.normal(), 20 * rng.normal()]))
        torque, pull, since = strong * rng.normal(), scale * rng.normal(), rng.uniform(0, 2)
        steps = [x.full().ravel() for x in function(speed, since, torque, pull)]
        (after, mean, resting, loss), blocked, released = steps
        assert released == pytest.approx(steps[0])
        assert blocked[[0, 1, 2]] == pytest.approx([0.0, speed / 2, resting + h])
        for end, way, dissipated in ((after, mean, loss), (0.0, speed / 2, blocked[3])):
            work = h * way * (torque - pull / drive.ratio)
            gained = inertia / 2 * (end**2 - speed**2)
            assert work - gained - dissipated == pytest.approx(0.0, abs=1e-9 * (abs(work) + 1e-9))
        assert loss >= -1e-15
        assert resting == pytest.approx(since + h if after == 0 else 0.0)
        if speed == 0.0 and after == 0.0:
            kind = "stands"
            assert (mean, loss) == (0.0, 0.0)
            # The friction coefficient at rest lies between the kinetic and the static one.
            mu = [drive.friction.mu, drive.friction.mu_static + drive.friction.mu_stribeck]
            allowed = [float(breakaway_torque(drive, pull, s, m)) for s in (-1.0, 1.0) for m in mu]
            assert min(allowed) - 1e-12 <= torque <= max(allowed) + 1e-12
        elif after == 0.0:
            kind = "stops"
            # The drive brakes evenly and then stands for the rest of the step. A step of twice the
            # length therefore leads equally far.
            assert 0 < mean / speed <= 0.5
            again, further, *_ = np.ravel(longer(speed, since, torque, pull))
            assert again == 0.0
            assert 2 * further == pytest.approx(mean)
        else:
            kind = "slides"
            assert mean == pytest.approx((speed + after) / 2)
            assert speed * after >= 0
        seen.add(kind)
    assert seen == {"stands", "stops", "slides"}
