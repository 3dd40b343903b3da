"""Where the published package departs from its own equations, with numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ssm_planner.dynamics.friction import stribeck_shape
from ssm_planner.paper.inputs import Inputs
from ssm_planner.paper.motions import SpeedRun
from ssm_planner.paper.package import (
    SPEEDS,
    StribeckForms,
    VelocitySign,
    body_moments,
    flipped,
    joint_inertia,
    largest_change,
    outside_bounds,
    stribeck_forms,
    torque_change,
    velocity_sign,
)
from ssm_planner.paper.payload import SPEEDS as RUNS
from ssm_planner.paper.published import DRIVEN, NUMBER
from ssm_planner.paper.rigs import RigResult
from ssm_planner.paper.section import NOTHING, Section, minus, number, percent, picture, table, text
from ssm_planner.problem.robot import JOINTS
from ssm_planner.reporting.figures.style import COLOURS, SIZE, finish, new_figure
from ssm_planner.sizing.duty import DutyCycle

if TYPE_CHECKING:
    from matplotlib.figure import Figure


FORMS = ("exp(−2x)", "exp(−x²)")


def departures_section(inputs: Inputs, runs: Sequence[SpeedRun], rigs: Sequence[RigResult]) -> Section:
    """Products of inertia, Stribeck's exponent, velocity product, torque at standstill, bounds of identification."""
    solved = [run for run in runs if run.loads]
    forms = [form for rig in rigs if (form := stribeck_forms(inputs.rigs[rig.name], rig)) is not None]
    lines = [
        *text(
            "The equations are the paper's and this program's alike; what follows is in the code that the paper cites, "
            "RViMLab/TRO2021-Dynamic-Modelling, and what it changes in numbers."
        ),
        *_inertia(inputs, solved),
        *_stribeck(forms),
        *_velocity(inputs, solved),
        *_standstill(solved),
        *_bounds(inputs),
    ]
    title = "Where the published package departs from its own equations"
    return Section(title, lines, {"stribeck_forms": _stribeck_figure()})


def _inertia(inputs: Inputs, runs: Sequence[SpeedRun]) -> list[str]:
    robot = inputs.robot
    rows = []
    for body in body_moments(robot):
        answers = ["possible" if answer else "**of no body**" for answer in body.possible]
        shown = [minus(", ".join(f"{1e3 * m:.3f}" for m in moments)) for moments in (body.as_tensor, body.as_cad)]
        rows.append((body.name, shown[0], answers[0], shown[1], answers[1]))
    head = ("principal moments about the centre of mass, 10⁻³ kg·m²", "package", "", "ours, products negated", "")
    ours, theirs = joint_inertia(robot), joint_inertia(flipped(robot))
    inertias = ", ".join(
        f"{1e3 * theirs[i]:.2f} instead of {1e3 * ours[i]:.2f} · 10⁻³ kg·m² at joint {NUMBER[joint]} "
        f"({percent(theirs[i] / ours[i] - 1.0, 0)})"
        for i, joint in enumerate(JOINTS[:2])
    )
    return [
        "### Sign of the products of inertia",
        "",
        *text(
            "The toolbox takes the last three inertias of a body as off-diagonal elements of the tensor, −∫xy dm, and "
            "wants the tensor positive definite; the package gives it those that CAD programs print, +∫xy dm. No body can "
            "have what results:"
        ),
        *table(head, rows, words=(2, 4)),
        *text(f"Inertia at home: {inertias}. Largest change of motor torque at any instant:"),
        *_inertia_changes(inputs, runs),
        *text(
            "Gravity does not depend on it, so the peaks of the payload curves, at constant speed, stay as they are."
        ),
    ]


def _inertia_changes(inputs: Inputs, runs: Sequence[SpeedRun]) -> list[str]:
    rows = []
    for run in runs:
        trajectory = run.plan.trajectory
        if trajectory is not None:
            peaks = {joint: max(abs(end) for end in run.envelope(joint)) for joint in DRIVEN}
            rows.append((run.row.label, *_of_peaks(torque_change(run.plan.problem.robot, trajectory), peaks)))
    for name, motorisation in inputs.motorisations.items():
        before = DutyCycle.of_motorisation(motorisation).loads()
        after = DutyCycle.of_motorisation(replace(motorisation, robot=flipped(motorisation.robot))).loads()
        peaks = {load.joint: float(np.abs(load.torque()).max()) for load in before}
        rows.append((f"payload curves, {RUNS[name]}", *_of_peaks(largest_change(before, after), peaks)))
    return table(("motion", *(f"joint {NUMBER[joint]}, of its peak (mN·m)" for joint in DRIVEN)), rows)


def _of_peaks(change: Mapping[str, float], peaks: Mapping[str, float]) -> tuple[str, ...]:
    return tuple(f"{number(1e3 * change[joint])} of {number(1e3 * peaks[joint])}" for joint in DRIVEN)


def _stribeck(forms: Sequence[StribeckForms]) -> list[str]:
    head = ("μ with the published parameters", *(f"{speed:g} w_s" for speed in SPEEDS), "farthest apart")
    rows, fitted = [], []
    for form in forms:
        for k, name in enumerate((f"{FORMS[0]}, the package", f"{FORMS[1]}, a Gaussian")):
            at = f"{form.largest[1 + k]:.4f} at {form.largest[0]:.2f} w_s"
            rows.append((f"{form.title}: {name}", *(f"{pair[k]:.4f}" for pair in form.mu), at))
            cells = (f"{form.published_nrmsd[k]:.4f}", f"{form.fitted_nrmsd[k]:.4f}", number(form.fitted_speed[k]))
            fitted.append((f"{form.title}: {name}", *cells, minus(f"{form.criterion[k]:.1f}")))
    preferred = ", ".join(f"{FORMS[int(np.argmin(form.criterion))]} for {form.title}" for form in forms)
    columns = ("map NRMSD, published parameters", "map NRMSD, fitted", "w_s fitted (rad/s)", "AICc")
    return [
        "### Stribeck's exponent",
        "",
        *text(
            "The code squares the exponential, exp(−x)² = exp(−2x) with x = |w|/w_s, where the usual Gaussian exp(−x²) "
            "squares the speed. The two agree at x = 0 and x = 2 only, so a Stribeck speed identified with one is another "
            "curve in the other; drive files name the form."
        ),
        *table(head, rows),
        *table(("rig and form", *columns), fitted),
        *text(f"By AICc (lower is better) the recordings prefer {preferred}; identification offers both."),
        *picture("stribeck_forms", "Stribeck's part of μ in the code and as a Gaussian"),
    ]


def _velocity(inputs: Inputs, runs: Sequence[SpeedRun]) -> list[str]:
    found = [(run.row.label, velocity_sign(run.loads)) for run in runs]
    single = [
        (f"payload curves, {RUNS[name]}", velocity_sign(DutyCycle.of_motorisation(run).loads()))
        for name, run in inputs.motorisations.items()
    ]
    rows = [(label, *_three(sign)) for label, sign in [*found, *single]]
    most = max((max(sign.torque.values()) for _, sign in single), default=0.0)
    head = (
        "motion: joints 1 / 2 / 4",
        "C q̇ (mN·m, mN·m, mN)",
        "gravity (mN·m, mN·m, mN)",
        "change of motor torque (mN·m)",
    )
    return [
        "### Sign of the velocity product",
        "",
        *text(
            "The package's payload subtracts the velocity product. The toolbox documents `velocityProduct` as the torques "
            "that cancel the velocity-induced ones, whose negative it is, and `gravityTorque` as those that compensate "
            "gravity: in M q̈ + C q̇ + g both count with the same sign. `Transmission.m` takes a payload that pushes forwards "
            "as positive, which is the negative of that sum, so subtracting the velocity product is right where gravity is "
            "subtracted too, and a departure where gravity is added. The sum is put together in a Simulink model "
            "(simINVD_ssm.slx) whose sign of gravity is not established here. What a wrong sign changes, largest at any "
            "instant:"
        ),
        *table(head, rows),
        *text(
            "In the payload curves one joint moves at a time. The inertia at a joint does not depend on that joint's own "
            "coordinate, so its own velocity product vanishes and the sign cannot show in the paper's choice of motors "
            f"(largest change {number(1e3 * most)} mN·m), only where several joints move together."
        ),
    ]


def _three(sign: VelocitySign) -> tuple[str, str, str]:
    def show(values: Mapping[str, float]) -> str:
        return " / ".join(number(1e3 * values[joint]) for joint in DRIVEN)

    return show(sign.effort), show(sign.gravity), show(sign.torque)


def _standstill(runs: Sequence[SpeedRun]) -> list[str]:
    rows = []
    for run in runs:
        starts = []
        for joint in DRIVEN:
            load = run.load(joint)
            torque = np.abs(load.torque()[load.breakaway > 0])
            starts.append(number(1e3 * float(torque.max())) if len(torque) else NOTHING)
        rows.append((run.row.label, "0 / 0 / 0", " / ".join(starts)))
    return [
        "### Torque at standstill",
        "",
        *text(
            "The code returns zero torque wherever the motor turns slower than 0.005 rad/s, also at the instant of a start, "
            "where the law asks for what breaks the drive loose (μ_s) and accelerates it:"
        ),
        *table(("motion: joints 1 / 2 / 4 (mN·m)", "package", "by the law, largest at a start"), rows),
    ]


def _bounds(inputs: Inputs) -> list[str]:
    found = [each for name, drive in inputs.rigs.items() for each in outside_bounds(name, drive)]
    rows = [
        (each.rig, each.parameter, number(each.value), " … ".join(number(end) for end in each.bounds)) for each in found
    ]
    return [
        "### Bounds of the identification",
        "",
        *text(
            "These published parameters of the rigs (sd_1dof.m) lie outside the bounds that the same file gives to the "
            "package's identification scripts, which can therefore not have returned them:"
        ),
        *table(("rig", "parameter", "published (SI)", "bounds"), rows, words=(1,)),
    ]


def _stribeck_figure() -> Figure:
    figure = new_figure(4.8, 3.2)
    axes = figure.subplots()
    x = np.linspace(0.0, 3.0, 301)
    shapes = (
        ("stribeck_exponential", f"{FORMS[0]}, the package", "-"),
        ("stribeck_gaussian", f"{FORMS[1]}, a Gaussian", "--"),
    )
    for k, (law, label, dash) in enumerate(shapes):
        axes.plot(x, stribeck_shape(law, x), dash, color=COLOURS[k], label=label)
    finish(axes, "x = |w| / w_s", "Stribeck's part of μ by its value at rest")
    axes.legend(fontsize=SIZE - 1, frameon=False)
    return figure
