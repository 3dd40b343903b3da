"""Where the published package departs from its own equations, with numbers: first the section, then what it computes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ssm_planner.dynamics.friction import friction_coefficient, friction_of, stribeck_shape
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.identification.fit import fit_map
from ssm_planner.paper.friction import RUNS
from ssm_planner.paper.motions import SpeedRun
from ssm_planner.paper.published import BOUNDS, DRIVEN, NUMBER, Inputs
from ssm_planner.paper.rigs import RigResult, published_drive
from ssm_planner.paper.section import NOTHING, Section, minus, number, percent, picture, table, text
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.robot import JOINTS, Body, Robot, frozen, possible, principal_moments
from ssm_planner.problem.value import unchecked
from ssm_planner.reporting.figures.style import COLOURS, SIZE, finish, new_figure
from ssm_planner.sizing.duty import DutyCycle
from ssm_planner.sizing.joint_load import JointLoad, joint_loads
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array

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
    head = ("μ with the published parameters", *(f"{speed:g} w_s" for speed in STRIBECK_SPEEDS), "farthest apart")
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


@dataclass(frozen=True)
class Outside:
    """A published parameter that the package's own identification cannot return; SI."""

    rig: str
    parameter: str
    value: float
    bounds: tuple[float, float]


def outside_bounds(name: str, drive: Drive) -> tuple[Outside, ...]:
    """Published parameters of a rig outside the package's bounds."""
    published = {} if drive.rig is None else drive.rig.published
    return tuple(
        Outside(drive.name, parameter, published[parameter], bounds)
        for parameter, bounds in BOUNDS[name].items()
        if parameter in published and not bounds[0] <= published[parameter] <= bounds[1]
    )


@dataclass(frozen=True, eq=False)
class BodyMoments:
    """Principal moments about the centre of mass, ascending, kg·m², (3,) each."""

    name: str
    as_tensor: Array
    """The published products taken as entries of the tensor, as the toolbox takes them."""
    as_cad: Array
    """Taken with the CAD program's sign, as the robot file does."""

    @property
    def possible(self) -> tuple[bool, bool]:
        """Whether a body can have them."""
        return possible(self.as_tensor), possible(self.as_cad)


def flipped(robot: Robot) -> Robot:
    """The robot with all products of inertia negated: the package's reading of its own figures."""
    first, second, third, fourth = (_flipped(body) for body in robot.bodies)
    return replace(robot, bodies=(first, second, third, fourth))


def body_moments(robot: Robot) -> tuple[BodyMoments, ...]:
    """Of every body with mass."""
    return tuple(
        BodyMoments(
            body.name,
            principal_moments(body.mass, body.com, _flipped(body).inertia),
            principal_moments(body.mass, body.com, body.inertia),
        )
        for body in robot.bodies
        if body.mass > 0
    )


def joint_inertia(robot: Robot) -> Array:
    """Diagonal of the mass matrix at home, (4,), kg·m² and kg."""
    return np.diagonal(RigidBody.from_robot(robot).mass_matrix(np.zeros((1, 4)))[0]).copy()


def torque_change(robot: Robot, trajectory: Trajectory) -> dict[str, float]:
    """Largest change of motor torque at any instant of a motion through the flipped sign, N·m, by driven joint."""
    return largest_change(joint_loads(trajectory, robot), joint_loads(trajectory, flipped(robot)))


def largest_change(before: Sequence[JointLoad], after: Sequence[JointLoad]) -> dict[str, float]:
    """Largest change of motor torque between loads of the same instants, N·m, by joint; 0 for joints without one."""
    change = dict.fromkeys(DRIVEN, 0.0)
    for a, b in zip(before, after, strict=True):
        change[a.joint] = max(change[a.joint], float(np.abs(b.torque() - a.torque()).max()))
    return change


def _flipped(body: Body) -> Body:
    diagonal = np.diag(np.diag(body.inertia))
    return unchecked(body, inertia=frozen(2 * diagonal - body.inertia, (3, 3)))


STRIBECK_SPEEDS = (0.25, 0.5, 1.0, 2.0)
"""Motor speed by Stribeck speed at which μ is shown."""


@dataclass(frozen=True, eq=False)
class StribeckForms:
    """Of one rig with a published Stribeck term. Each pair: the package's form, the Gaussian."""

    title: str
    mu: tuple[tuple[float, float], ...]
    """At STRIBECK_SPEEDS."""
    largest: tuple[float, float, float]
    """|w|/w_s at which the coefficients lie farthest apart, and both there."""
    published_nrmsd: tuple[float, float]
    """Of the map, with the published parameters."""
    fitted_nrmsd: tuple[float, float]
    fitted_speed: tuple[float, float]
    """w_s, rad/s."""
    criterion: tuple[float, float]
    """AICc of the two fits."""


def stribeck_forms(drive: Drive, result: RigResult) -> StribeckForms | None:
    """Both forms on one rig; None where its authors give no Stribeck speed."""
    pair = tuple(published_drive(drive, law) for law in ("stribeck_exponential", "stribeck_gaussian"))
    exponential, gaussian = pair
    speed = friction_of(exponential).stribeck_speed
    if not speed:
        return None
    x = np.linspace(0.0, 4.0, 4001)
    gap = np.abs(stribeck_shape("stribeck_gaussian", x) - stribeck_shape("stribeck_exponential", x))
    widest = float(x[int(np.argmax(gap))])
    other = fit_map(drive, result.data, result.rig.F_payload, law="stribeck_gaussian", reference=result.rig.published)
    fits = (result.fits["stribeck_exponential"], other)
    return StribeckForms(
        title=result.title,
        mu=tuple((_mu(exponential, s * speed), _mu(gaussian, s * speed)) for s in STRIBECK_SPEEDS),
        largest=(widest, _mu(exponential, widest * speed), _mu(gaussian, widest * speed)),
        published_nrmsd=(result.map_nrmsd(exponential), result.map_nrmsd(gaussian)),
        fitted_nrmsd=(fits[0].nrmsd, fits[1].nrmsd),
        fitted_speed=(fits[0].estimates["stribeck_speed"].value, fits[1].estimates["stribeck_speed"].value),
        criterion=(fits[0].criterion["stribeck_exponential"], fits[1].criterion["stribeck_gaussian"]),
    )


def _mu(drive: Drive, w: float) -> float:
    return float(friction_coefficient(friction_of(drive), w))


@dataclass(frozen=True)
class VelocitySign:
    """Over one motion, by driven joint: N·m or N for effort, N·m for torque."""

    effort: dict[str, float]
    """Largest |C q̇|."""
    gravity: dict[str, float]
    """Largest effort of gravity, for comparison."""
    torque: dict[str, float]
    """Largest change of motor torque where the velocity product is subtracted instead of added."""


def subtracted(load: JointLoad) -> JointLoad:
    """The load with M q̈ − C q̇ + g instead of M q̈ + C q̇ + g."""
    return replace(load, velocity=-load.velocity)


def velocity_sign(loads: Sequence[JointLoad]) -> VelocitySign:
    """What the sign changes over a motion."""
    effort, gravity = dict.fromkeys(DRIVEN, 0.0), dict.fromkeys(DRIVEN, 0.0)
    for load in loads:
        effort[load.joint] = max(effort[load.joint], float(np.abs(load.velocity).max()))
        gravity[load.joint] = max(gravity[load.joint], float(np.abs(load.gravity).max()))
    return VelocitySign(effort, gravity, largest_change(loads, [subtracted(load) for load in loads]))
