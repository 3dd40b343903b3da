"""Verdicts on chains of motor, gearhead and worm are compared with a brute-force oracle.

Further tests read catalogues of gearheads. The environment variable CHAINS sets the number of
random chains, for example CHAINS=10000.
"""

from __future__ import annotations

import math
import os
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import ssm_planner as ssm
from ssm_planner.errors import ProblemError
from ssm_planner.loading import CatalogueEntry, read_gearheads, read_motors
from ssm_planner.problem import Drive, Gearhead, Motor
from ssm_planner.sizing import Conditions, JointLoad
from ssm_planner.sizing.chain import with_gearhead
from ssm_planner.sizing.selection import select_joint

CHAINS = int(os.environ.get("CHAINS", "600"))
BATCH = (12, 25)
"""Numbers of gearheads and motors in one random task."""
EXACT = Conditions(spread=0.0)
"""Conditions with friction that is exactly known."""


@cache
def motors() -> tuple[CatalogueEntry[Motor], ...]:
    return tuple(read_motors(Path("motors_24v")))


def random_drive(rng: np.random.Generator) -> Drive:
    """Return a self-locking worm whose file states every figure."""
    drive = ssm.load_drive("vitreoretinal_joint1_worm")
    mu = rng.uniform(0.08, 0.3)
    friction = replace(
        drive.friction,
        mu=mu,
        mu_static=mu * rng.uniform(1.0, 1.3),
        mu_lowest=0.9 * mu,
        b_c=rng.uniform(0, 4e-3),
        b_v=rng.uniform(0, 5e-5),
        identified_speed=1e4,
    )
    ratings = ssm.Ratings(
        continuous_output=rng.uniform(1, 20), peak_output=40.0, input_speed=600.0, duty=1.0
    )
    inertia = rng.uniform(1e-6, 3e-6)
    return replace(drive, friction=friction, ratings=ratings, input_inertia=inertia)


def random_load(rng: np.random.Generator) -> JointLoad:
    """Return the load of a joint that moves forth and back once and is at rest at both ends."""
    t = np.linspace(0.0, rng.uniform(0.5, 3.0), 300)
    phase = 2 * np.pi * t / t[-1]
    top = rng.uniform(0.3, 2.0)
    qd = top * np.sin(phase)
    zero = np.zeros_like(t)
    weight = np.full(len(t), 1.0 / len(t))
    return JointLoad(
        joint="roll",
        drive=random_drive(rng),
        motor=motors()[int(rng.integers(len(motors())))].of,
        alternatives=(),
        t=t,
        qd=qd,
        qdd=top * 2 * np.pi / t[-1] * np.cos(phase),
        inertia=rng.normal(0, 0.3) * np.cos(phase),
        velocity=zero,
        gravity=rng.normal(0, 2.0) + 0.3 * np.sin(phase / 2),
        direction=np.sign(np.where(np.abs(qd) < 1e-9, 0.0, qd)),
        breakaway=np.where(np.arange(len(t)) == 1, 1.0, 0.0),
        weight=weight,
        duration=float(t[-1]),
    )


def random_gearhead(rng: np.random.Generator) -> Gearhead:
    rated = ssm.Ratings(
        continuous_output=rng.uniform(0.01, 0.3),
        peak_output=rng.uniform(0.3, 0.6),
        input_speed=rng.uniform(200, 5000),
    )
    return Gearhead(
        "head",
        ratio=rng.uniform(1.5, 40),
        efficiency=rng.uniform(0.6, 0.95),
        backward_efficiency=rng.uniform(0.4, 0.95),
        inertia=rng.uniform(0, 1e-7),
        ratings=None if rng.random() < 0.1 else rated,
    )


def oracle(load: JointLoad, head: Gearhead, motor: Motor) -> tuple[dict[str, float], bool]:
    """Return for each check the largest ratio of demand to limit over all instants.

    The gearhead lies between the motor and the drive. The second result is true if the motor drives
    the gearhead at every instant.
    """
    drive, f = load.drive, load.drive.friction
    shaft = drive.input_inertia - load.motor.rotor_inertia
    own_friction = motor.no_load_current * motor.torque_constant
    torques, outputs, volts = [], [], []
    for i, sign in enumerate(load.direction):
        w, wd = drive.ratio * load.qd[i], drive.ratio * load.qdd[i]
        effort = load.inertia[i] + load.velocity[i] + load.gravity[i]
        effort += drive.output_inertia * load.qdd[i] + f.b_oc * sign + f.b_ov * load.qd[i]
        mu = max(f.mu, f.mu_static) if load.breakaway[i] else f.mu
        phi = math.atan(mu / math.cos(drive.pressure_angle))
        mesh = drive.gamma * math.tan(drive.lead_angle + math.copysign(phi, effort * sign)) * effort
        if sign == 0:
            torques.append(0.0)
            outputs.append(0.0)
            continue
        bearing = f.b_c * sign + f.b_v * w
        output = mesh + bearing + shaft * wd
        loss = 1 / head.efficiency if output * sign > 0 else head.backward_efficiency
        torque = output * loss / head.ratio + own_friction * sign
        torque += (motor.rotor_inertia + head.inertia) * head.ratio * wd
        torques.append(torque)
        outputs.append((mesh + bearing, output * sign))
        hot = motor.max_winding_temperature - 298.15
        for warm in (0.0, hot):
            k = motor.torque_constant * (1 - 0.0012 * warm)
            ohm = motor.terminal_resistance * (1 + 0.00393 * warm)
            volts.append(abs(torque / k * ohm + k * head.ratio * w))
    passing = np.abs([x[0] for x in outputs if x])
    speed = head.ratio * drive.ratio * np.abs(load.qd).max()
    ratings = head.ratings or ssm.Ratings(1e9, 1e9, 1e9)
    return {
        "torque": np.abs(torques).max() / motor.max_torque,
        "continuous_torque": math.sqrt(np.mean(np.square(torques))) / motor.nominal_torque,
        "speed": speed / motor.max_speed,
        "voltage": max(volts) / motor.nominal_voltage,
        "gearhead_speed": speed / ratings.input_speed,
        "gearhead_peak_output": passing.max() / ratings.peak_output,
        "gearhead_continuous_output": math.sqrt(np.mean(np.square(passing)))
        / ratings.continuous_output,
    }, all(x[1] >= 0 for x in outputs if x)


def test_chains_equal_a_brute_force_oracle():
    rng = np.random.default_rng(35)
    heads, chosen = BATCH
    answers = []
    for _ in range(-(-CHAINS // (heads * chosen))):
        load = random_load(rng)
        gearheads = [CatalogueEntry(f"head {k}", random_gearhead(rng)) for k in range(heads)]
        picked = [motors()[k] for k in rng.choice(len(motors()), chosen, replace=False)]
        selection = select_joint(
            load, picked, [CatalogueEntry("worm", load.drive)], EXACT, gearheads=gearheads
        )
        for g, m in np.ndindex(heads, chosen):
            adequate = selection.adequate[g + 1, m]
            ratios, driven = oracle(load, gearheads[g].of, picked[m].of)
            for name in ("torque", "continuous_torque", "voltage"):
                demand = 1 - selection.margins[name][g + 1, m]
                assert demand >= ratios[name] * (1 - 1e-9) or name == "voltage"
                if driven:
                    assert demand == pytest.approx(ratios[name], rel=1e-9)
            failed = {name for name, ratio in ratios.items() if ratio > 1 + 1e-9}
            assert not (adequate == 1 and failed), "a wrong yes"
            assert adequate < 1 or gearheads[g].of.ratings is not None
            ruled = set(selection.checks_with(-1, g + 1, m))
            if driven:
                assert failed == ruled & set(ratios)
            answers.append(adequate)
    assert {-1, 0, 1} <= set(answers)


@pytest.mark.parametrize("mu", [None, 0.01])
def test_a_selection_gives_the_answers_of_each_chain(mu: float | None):
    rng = np.random.default_rng(3)
    load = random_load(rng)
    if mu is not None:
        friction = replace(load.drive.friction, mu=mu, mu_lowest=mu, mu_static=mu)
        load = replace(load, drive=replace(load.drive, friction=friction, self_locking=False))
    gearheads = [CatalogueEntry(f"head {k}", random_gearhead(rng)) for k in range(4)]
    gearheads.append(CatalogueEntry("computed", replace(gearheads[0].of, placeholder=True)))
    selection = select_joint(
        load,
        motors()[::8],
        [CatalogueEntry("worm", load.drive)],
        Conditions(spread=0.1),
        gearheads=gearheads,
    )
    for g, m in np.ndindex(selection.adequate.shape):
        verdict = selection.verdict(g, m)
        assert {True: 1, None: 0, False: -1}[verdict.adequate] == selection.adequate[g, m]
        margins = {check.name: check.margin for check in verdict.checks}
        for name, values in selection.margins.items():
            assert margins[name] == pytest.approx(values[g, m], rel=1e-9, abs=1e-12)


def with_friction(load: JointLoad, **values: object) -> JointLoad:
    """Return the load with other values of the friction of its drive."""
    return replace(load, drive=replace(load.drive, friction=replace(load.drive.friction, **values)))


@pytest.mark.parametrize("seed", range(3))
def test_the_torque_of_an_identified_chain_is_that_of_its_worst_draw(seed: int):
    """With a confidence of 99 % and 12 draws, the demand is that of the worst draw.

    The draws are evaluated at selected instants, which changes the RMS torque by up to 0.5 %.
    """
    tolerances = {"torque": 1e-6, "continuous_torque": 5e-3, "speed": 1e-9}
    rng = np.random.default_rng(3500 + seed)
    load = random_load(rng)
    names = ("mu", "b_c", "b_v")
    nominal = np.array([getattr(load.drive.friction, name) for name in names])
    draws = nominal * rng.uniform(0.8, 1.25, (12, 3))
    posterior = ssm.Posterior(names, draws)
    head = replace(random_gearhead(rng), backward_efficiency=None)
    motor = motors()[int(rng.integers(len(motors())))]
    identified = select_joint(
        load,
        [motor],
        [CatalogueEntry("worm", with_friction(load, posterior=posterior).drive)],
        EXACT,
        gearheads=[CatalogueEntry("head", head)],
    )
    static = load.drive.friction.mu_static / load.drive.friction.mu
    demands: dict[str, list[float]] = {name: [] for name in tolerances}
    is_driven = True
    for mu, b_c, b_v in draws:
        drawn = with_friction(load, mu=mu, mu_static=static * mu, mu_lowest=mu, b_c=b_c, b_v=b_v)
        ratios, driven = oracle(drawn, head, motor.of)
        is_driven &= driven
        for name, values in demands.items():
            values.append(ratios[name])
    checks = {check.name: check for check in identified.verdict(1, 0).checks}
    for name, values in demands.items():
        demand = checks[name].worst / checks[name].limit
        tolerance = tolerances[name]
        assert demand >= max(values) * (1 - tolerance)
        assert demand == pytest.approx(max(values), rel=tolerance) or not is_driven
        assert identified.adequate[1, 0] < 1 or max(values) <= 1


def test_a_gearhead_scales_the_spread_and_the_ripple_of_friction():
    """Torques of the former shaft are divided by ratio and efficiency, slopes by ratio again."""
    rng = np.random.default_rng(35)
    load = random_load(rng)
    head = random_gearhead(rng)
    share = 1 / (head.ratio * head.efficiency)
    ripple = ssm.Ripple(torque=(0.01,), ripple=(1e-3,), noise=(1e-4,), peak=(2e-3,))
    names = ("mu", "b_c", "b_v", "stribeck_speed")
    posterior = ssm.Posterior(names, rng.uniform(0.1, 0.2, (5, 4)), forwards=ripple)
    factors = np.array([1.0, share, share / head.ratio, head.ratio])
    friction = with_gearhead(with_friction(load, posterior=posterior), head).drive.friction
    assert friction.posterior.draws == pytest.approx(posterior.draws * factors)
    assert friction.posterior.ripple(1).peak == pytest.approx([2e-3 * share])
    assert friction.posterior.ripple(-1) is None
    covariance = {"mu": {"mu": 4e-4, "b_c": 1e-6}, "b_c": {"mu": 1e-6, "b_c": 1e-8}}
    friction = with_gearhead(with_friction(load, covariance=covariance), head).drive.friction
    assert friction.covariance["mu"] == pytest.approx({"mu": 4e-4, "b_c": 1e-6 * share})
    assert friction.covariance["b_c"]["b_c"] == pytest.approx(1e-8 * share**2)


def test_a_light_chain_suffices_for_roll():
    load = ssm.size("results/tilt_insert").joints[0].load
    gearheads = read_gearheads(Path("gearheads"))
    selection = select_joint(
        load,
        motors(),
        [CatalogueEntry("worm", load.drive)],
        Conditions(spread=0.2),
        gearheads=gearheads[:9],
    )
    g, m = selection.ranked("mass")[0]
    chain = selection.gears[g]
    assert chain.gearhead.mass + selection.motors[m].mass <= 0.060
    checks = (*selection.verdict(g, m).checks, *selection.verdict(g, m).gear)
    assert all(check.passed for check in checks if check.margin is not None)
    # The gearheads have computed figures and are not products, so the answer stays open.
    assert selection.adequate[g, m] == 0


FAULTY = {
    "ratio": ("0", "-4", "1e6", "4 mm", "nan", "inf", "four"),
    "efficiency": ("0", "1.2", "80", "0.01"),
    "inertia [g*cm^2]": ("-1", "1e9", "5000", ""),
    "backlash [deg]": ("-1", "90"),
    "mass [g]": ("0", "-3", "90000", "0.01"),
    "ratings.input_speed [rpm]": ("0", "1e9", "8"),
    "ratings.continuous_output [mN*m]": ("0", "2e5", "1e-3", "700"),
    "ratings.peak_output [mN*m]": ("0", "200", "1e6"),
    "ratings.input_sped [rpm]": ("8000",),
}
GOOD = {
    "name": "planet",
    "ratio": "14",
    "efficiency": "0.8",
    "inertia [g*cm^2]": "0.4",
    "backlash [deg]": "1",
    "mass [g]": "24",
    "ratings.input_speed [rpm]": "8000",
    "ratings.continuous_output [mN*m]": "300",
    "ratings.peak_output [mN*m]": "500",
}


def written(folder: Path, cells: dict[str, str], separator: str = ",") -> Path:
    file = folder / "heads.csv"
    file.write_text(
        separator.join(cells) + "\n" + separator.join(cells.values()) + "\n", encoding="utf-8"
    )
    return file


def test_a_gearhead_is_read_in_either_notation(tmp_path: Path):
    (comma,) = read_gearheads(written(tmp_path, GOOD))
    cells = {name: cell.replace(".", ",") for name, cell in GOOD.items()}
    (semicolon,) = read_gearheads(written(tmp_path, cells, ";"))
    assert comma.of == semicolon.of
    assert comma.of.inertia == pytest.approx(4e-8)
    assert comma.of.ratings.peak_output == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("column", "cell"), [(column, cell) for column, cells in FAULTY.items() for cell in cells]
)
def test_a_faulty_gearhead_is_refused(tmp_path: Path, column: str, cell: str):
    with pytest.raises(ProblemError) as caught:
        read_gearheads(written(tmp_path, {**GOOD, column: cell}))
    assert caught.value.file is not None


def test_a_joint_has_one_gearhead(tmp_path: Path):
    load = random_load(np.random.default_rng(1))
    head = CatalogueEntry("head", random_gearhead(np.random.default_rng(2)))
    own = replace(load.drive, gearhead=replace(head.of, inertia=0.0))
    with pytest.raises(ProblemError, match="without gearhead"):
        select_joint(load, motors()[:1], [CatalogueEntry("worm", own)], EXACT, gearheads=[head])
