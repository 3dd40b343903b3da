"""Where the published package departs from its own equations, with numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ssm_planner.model.friction import stribeck_shape
from ssm_planner.paper.inertia_sign import body_moments, flipped, joint_inertia, largest_change, torque_change
from ssm_planner.paper.inputs import Inputs
from ssm_planner.paper.motions import SpeedRun
from ssm_planner.paper.payload import SPEEDS as RUN_SPEEDS
from ssm_planner.paper.published import DRIVEN, NUMBER
from ssm_planner.paper.rigs import RigResult
from ssm_planner.paper.section import Section, number, percent, picture, table
from ssm_planner.paper.stribeck_form import SPEEDS, StribeckForms, stribeck_forms
from ssm_planner.paper.velocity_sign import VelocitySign, velocity_sign
from ssm_planner.problem.values import JOINTS
from ssm_planner.report.style import COLOURS, SIZE, finish, new_figure
from ssm_planner.sizing.duty import Duty

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def departures_section(inputs: Inputs, runs: Sequence[SpeedRun], rigs: Sequence[RigResult]) -> Section:
    """Products of inertia, Stribeck's exponent, velocity product, torque at standstill."""
    solved = [run for run in runs if run.loads]
    forms = [form for rig in rigs if (form := stribeck_forms(inputs.rigs[rig.name], rig)) is not None]
    lines = [
        "None of these is an error of the paper's equations; they are in the code that it cites "
        "(RViMLab/TRO2021-Dynamic-Modelling). This program follows the equations.",
        "",
        *_inertia(inputs, solved),
        *_stribeck(forms),
        *_velocity(inputs, solved),
        *_standstill(solved),
    ]
    return Section(
        "Where the published package departs from its own equations",
        "ssm-planner reproduce",
        lines,
        {"stribeck_forms": _stribeck_figure()},
    )


def _inertia(inputs: Inputs, runs: Sequence[SpeedRun]) -> list[str]:
    robot = inputs.robot
    rows = []
    for body in body_moments(robot):
        answers = ["possible" if answer else "**no body**" for answer in body.possible]
        shown = [", ".join(f"{1e3 * moment:.3f}" for moment in moments) for moments in (body.as_tensor, body.as_cad)]
        rows.append((body.name, shown[0], answers[0], shown[1], answers[1]))
    head = ("principal moments about the centre of mass, 10⁻³ kg·m²", "as published", "", "products negated", "")
    ours, theirs = joint_inertia(robot), joint_inertia(flipped(robot))
    inertias = ", ".join(
        f"joint {NUMBER[joint]} {1e3 * theirs[i]:.3f} instead of {1e3 * ours[i]:.3f} · 10⁻³ kg·m² "
        f"({percent(theirs[i] / ours[i] - 1.0, 0)})"
        for i, joint in enumerate(JOINTS[:2])
    )
    return [
        "### Sign of the products of inertia",
        "",
        "The toolbox takes the last three entries of a body's inertia as off-diagonal elements of the tensor, −∫xy dm; the "
        "package gives it those that CAD programs print, +∫xy dm. Taken as it stands, no body can have these inertias:",
        "",
        *table(head, rows),
        f"What it changes at home, seen by the joints: {inertias}. Motor torque, largest change at any instant:",
        "",
        *_changes(inputs, runs),
        "Gravity does not depend on it, so the peaks of the payload curves, reached at constant speed, stay.",
        "",
    ]


def _stribeck(forms: Sequence[StribeckForms]) -> list[str]:
    head = ("μ with the authors' parameters", *(f"at {speed:g} w_s" for speed in SPEEDS), "farthest apart")
    rows = []
    for form in forms:
        for k, name in enumerate(("exp(−2x), the package", "exp(−x²), a Gaussian")):
            at = f"{form.largest[1 + k]:.4f} at {form.largest[0]:.2f} w_s"
            rows.append((f"{form.title}: {name}", *(f"{pair[k]:.4f}" for pair in form.mu), at))
    fitted = [
        (
            form.title,
            *(f"{value:.4f}" for value in form.published_nrmsd),
            *(f"{value:.4f}" for value in form.fitted_nrmsd),
            *(number(value) for value in form.fitted_speed),
            *(f"{value:.1f}" for value in form.criterion),
        )
        for form in forms
    ]
    columns = ("published, exp(−2x)", "published, exp(−x²)", "fitted, exp(−2x)", "fitted, exp(−x²)")
    return [
        "### Stribeck's exponent",
        "",
        "The code squares the exponential, exp(−x)² = exp(−2x) with x = |w|/w_s, where the Gaussian exp(−x²) of the "
        "literature squares the speed. The two agree at x = 0 and x = 2 only. A Stribeck speed identified with one means "
        "another curve with the other, so the drive files name the form.",
        "",
        *table(head, rows),
        *table(
            ("NRMSD of the map", *columns, "w_s, exp(−2x)", "w_s, exp(−x²)", "AICc, exp(−2x)", "AICc, exp(−x²)"), fitted
        ),
        f"By AICc (lower is better) the recordings prefer {_preferred(forms)}; the identification offers both forms.",
        "",
        *picture("stribeck_forms", "Stribeck's part of μ by the code and as a Gaussian"),
    ]


def _preferred(forms: Sequence[StribeckForms]) -> str:
    names = ("exp(−2x)", "exp(−x²)")
    return ", ".join(f"{names[int(np.argmin(form.criterion))]} on {form.title}" for form in forms)


def _velocity(inputs: Inputs, runs: Sequence[SpeedRun]) -> list[str]:
    found = [(run.row.label, velocity_sign(run.loads)) for run in runs]
    single = _single(inputs)
    rows = [(label, *_three(sign)) for label, sign in [*found, *single]]
    most = max((max(sign.torque.values()) for _, sign in single), default=0.0)
    return [
        "### Sign of the velocity product",
        "",
        "The toolbox documents `velocityProduct` as the torques that cancel the velocity-induced ones, which equal its "
        "negative, and `gravityTorque` as those that compensate gravity: both enter M q̈ + C q̇ + g with the same sign, and "
        "the effort on a drive is that sum. In the package's payload the velocity product is subtracted. What the sign "
        "changes:",
        "",
        *table(
            (
                "motion",
                "largest C q̇: joints 1 / 2 (N·m) / 4 (N)",
                "largest gravity effort",
                "largest change of motor torque, joints 1 / 2 / 4 (mN·m)",
            ),
            rows,
        ),
        "In the payload curves only one joint moves at a time. The inertia seen by a joint does not depend on that joint's "
        f"own coordinate, so its own velocity product vanishes (largest change {number(1e3 * most)} mN·m): the sign cannot "
        "show in the paper's motor selection, only where several joints move together.",
        "",
    ]


def _standstill(runs: Sequence[SpeedRun]) -> list[str]:
    rows = []
    for run in runs:
        starts = []
        for joint in DRIVEN:
            load = run.load(joint)
            torque = np.abs(load.torque()[load.breakaway > 0])
            starts.append(number(1e3 * float(torque.max())) if len(torque) else "0")
        rows.append((run.row.label, "0 / 0 / 0", " / ".join(starts)))
    return [
        "### Torque at standstill",
        "",
        "The code returns a torque of zero wherever the motor turns slower than 0.005 rad/s, also at the instant of a "
        "start; by the law the drive must first be broken loose (μ_s, and the inertia at full acceleration).",
        "",
        *table(("motion", "the package, joints 1 / 2 / 4 (mN·m)", "by the law, largest at a start (mN·m)"), rows),
    ]


def _single(inputs: Inputs) -> list[tuple[str, VelocitySign]]:
    duties = [(name, Duty.of_motorisation(run)) for name, run in inputs.motorisations.items()]
    return [(f"payload curves, {RUN_SPEEDS[name]}", velocity_sign(duty.loads())) for name, duty in duties]


def _three(sign: VelocitySign) -> tuple[str, str, str]:
    def show(values: Mapping[str, float], scale: float = 1.0) -> str:
        return " / ".join(number(scale * values[joint]) for joint in DRIVEN)

    return show(sign.effort), show(sign.gravity), show(sign.torque, 1e3)


def _changes(inputs: Inputs, runs: Sequence[SpeedRun]) -> list[str]:
    rows = []
    for run in runs:
        trajectory = run.plan.trajectory
        if trajectory is not None:
            change = torque_change(run.plan.problem.robot, trajectory)
            peaks = {joint: max(abs(end) for end in run.envelope(joint)) for joint in DRIVEN}
            rows.append((run.row.label, *_of_peaks(change, peaks)))
    for name, motorisation in inputs.motorisations.items():
        before = Duty.of_motorisation(motorisation).loads()
        after = Duty.of_motorisation(replace(motorisation, robot=flipped(motorisation.robot))).loads()
        peaks = {load.joint: float(np.abs(load.torque()).max()) for load in before}
        rows.append((f"payload curves, {RUN_SPEEDS[name]}", *_of_peaks(largest_change(before, after), peaks)))
    return table(("motion", *(f"joint {NUMBER[joint]}, of its peak (mN·m)" for joint in DRIVEN)), rows)


def _of_peaks(change: Mapping[str, float], peaks: Mapping[str, float]) -> tuple[str, ...]:
    return tuple(f"{number(1e3 * change[joint])} of {number(1e3 * peaks[joint])}" for joint in DRIVEN)


def _stribeck_figure() -> Figure:
    figure = new_figure(4.8, 3.2)
    axes = figure.subplots()
    x = np.linspace(0.0, 3.0, 301)
    shapes = (
        ("stribeck_exponential", "exp(−2x), the package", "-"),
        ("stribeck_gaussian", "exp(−x²), a Gaussian", "--"),
    )
    for k, (law, label, dash) in enumerate(shapes):
        axes.plot(x, stribeck_shape(law, x), dash, color=COLOURS[k], label=label)
    finish(axes, "x = |w| / w_s", "Stribeck's part of μ, of its value at rest")
    axes.legend(fontsize=SIZE - 1, frameon=False)
    return figure
