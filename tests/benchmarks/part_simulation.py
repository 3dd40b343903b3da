"""Measure simulation, controlled stops, worst speeds and comparison of the shipped plans."""

from __future__ import annotations

import time

import numpy as np

from ssm_planner.comparison.compare import compare
from ssm_planner.errors import RecordingError
from ssm_planner.plans import Plan, load_plan
from ssm_planner.problem.controller import AxisController, Controller
from ssm_planner.simulation.plant import STATE_SIZE
from ssm_planner.simulation.simulate import Scenario, _Simulation, simulate
from ssm_planner.stopping import controlled_stops
from ssm_planner.verification.slower import check_speeds
from tests.benchmarks.section import Section
from tests.support.arm_motion import arm_motion, energy_error
from tests.support.executions import FAULTS, Executions, kinds
from tests.support.paths import RESULTS

SHIPPED = ("tilt_insert", "eye_approach")


def run(quick: bool) -> Section:
    section = Section("Before the robot runs it")
    plans = {name: load_plan(RESULTS / name / "plan.json") for name in SHIPPED}
    shipped = plans["tilt_insert"]
    _simulation(section, shipped)
    for name, plan in plans.items():
        _stops(section, name, plan, 100 if quick else 1000)
    began = time.process_time()
    result = check_speeds(shipped.motion, shipped.robot, shipped.limits)
    rows = [
        (item.found.name, item.found.joint or "", f"{100 * item.speed:.3g} %")
        for item in result.worst
    ]
    section.say(
        f"Worst speed of every motor limit from 1 % to 100 %, in {time.process_time() - began:.1f} s of one core:"
    )
    section.table(("limit", "joint", "at"), rows)
    _comparison(section, shipped, 4 if quick else 50, 10 if quick else 200)
    return section


def _simulation(section: Section, plan: Plan) -> None:
    stage = _Simulation(plan, Scenario(), Controller())
    stage.play()
    began = time.process_time()
    stage.play()
    factor = float(stage.time[-1]) / (time.process_time() - began)
    section.asked("arm with controllers", "≥ 20 × real time", f"{factor:.1f} ×", factor >= 20)
    axis = AxisController(p=0, i=0, d=0, ff_velocity=0, ff_acceleration=0, following_error=10.0)
    free = Controller(
        torque_offset=False, joints=dict.fromkeys(("roll", "tilt", "insertion"), axis)
    )
    off = _Simulation(plan, Scenario(), free)
    states = off.play().states[:, :STATE_SIZE]
    times = off.period * np.arange(len(states))
    error = energy_error(arm_motion(off.arm(0.0), times, states, np.zeros((1, 4))))
    section.asked("energy balance, motors without torque", "≤ 1e-6", f"{error:.1e}", error <= 1e-6)
    began = time.process_time()
    result = simulate(plan, Scenario(draws=1000, spread=0.15))
    seconds = time.process_time() - began
    section.asked(
        "1 000 friction draws, one core",
        "≤ 60 s",
        f"{seconds:.0f} s",
        seconds <= 60 and result.passed,
    )


def _stops(section: Section, name: str, plan: Plan, count: int) -> None:
    began = time.process_time()
    stops = controlled_stops(plan.motion, plan.robot, plan.limits, count)
    seconds = time.process_time() - began
    result = f"{count} certified in {seconds:.1f} s" if stops.passed else "not certified"
    section.asked(
        f"{name}: controlled stops", "all certified, < 20 s", result, stops.passed and seconds < 20
    )
    began = time.process_time()
    lost = simulate(plan, Scenario(power_loss="everywhere", instants=count))
    seconds = time.process_time() - began
    section.asked(
        f"{name}: power lost at {count} instants", "< 20 s", f"{seconds:.1f} s", seconds < 20
    )
    section.say(
        f"{name}: with power the arm stands within {1e3 * stops.duration.max():.0f} ms and {1e3 * stops.travel.max():.3g} mm "
        f"of the tip; without it {'within' if lost.holds else 'not, beyond'} {1e3 * lost.travel:.3g} mm."
    )


def _comparison(section: Section, plan: Plan, seeds: int, healthy: int) -> None:
    executions, rows, right, held = Executions(plan), [], 0, 0
    for kind in FAULTS:
        rightly = 0
        for seed in range(seeds):
            recordings, verdict, finding = executions.faulty(kind, seed)
            try:
                result = compare(plan.motion, plan.robot, plan.certificate, recordings)
            except RecordingError:
                continue
            rightly += result.verdict == verdict and finding in kinds(result)
            held += result.followed and verdict != "held"
        right += rightly
        rows.append((kind, FAULTS[kind][1], f"{rightly} of {seeds}"))
    section.say("Seeded faults of the shipped motion, and how many `compare` calls what they are:")
    section.table(("fault", "verdict", "called rightly"), rows)
    share = right / (seeds * len(FAULTS))
    section.asked("faults called rightly", "≥ 98 %", f"{100 * share:.1f} %", share >= 0.98)
    section.asked("faults called held", "0", str(held), held == 0)
    alarms = sum(
        not compare(plan.motion, plan.robot, plan.certificate, executions.healthy(seed)).followed
        for seed in range(healthy)
    )
    section.asked(
        f"alarms of {healthy} healthy runs", "≤ 2 %", str(alarms), alarms <= 0.02 * healthy
    )
