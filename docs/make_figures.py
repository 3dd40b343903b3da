"""Draw the figures of the documents with the laws of the package; `make picture` runs it.

Every function in FIGURES draws one figure. Its name is the name of the file in docs/figures.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner import Scenario, fk, load_plan, load_problem, load_robot, plan, simulate
from ssm_planner.dynamics.friction import static_coefficient, stribeck_shape
from ssm_planner.dynamics.transmission import mesh_coefficients
from ssm_planner.kinematics import Mechanism
from ssm_planner.kinematics.task import pose_from_task, task_from_joints
from ssm_planner.reporting.figures.style import (
    COLOURS,
    LIMIT_STYLE,
    LINE_DASHES,
    draw_legend,
    draw_legend_above,
    draw_zero_lines,
    finish_axes,
    new_figure,
    save_figure,
    shade_phases,
)
from ssm_planner.reporting.text import ACTIVE_MARGIN

HERE = Path(__file__).parent
SHIPPED = HERE.parent / "results" / "tilt_insert"
DPI = 130
TEXT: dict[str, Any] = {"fontsize": 8.5, "ha": "center", "va": "center"}
ARROW: dict[str, Any] = {"arrowstyle": "-|>", "color": "0.3", "linewidth": 1.2}


def panels(height: float, columns: int = 1, **options: Any) -> tuple[Any, Any]:
    """Create a figure with panels side by side."""
    figure = new_figure(6.6, height)
    figure.set_dpi(DPI)
    return figure, figure.subplots(1, columns, **options)


def sketch(height: float, x: tuple[float, float], y: tuple[float, float]) -> tuple[Any, Any]:
    """Create a figure for a sketch in equal units, without axes."""
    figure, axes = panels(height)
    axes.set(xlim=x, ylim=y, aspect="equal")
    axes.set_axis_off()
    return figure, axes


def box(axes: Any, x: float, y: float, text: str, width: float, colour: str = "#eaf1f7") -> None:
    """Draw a box with text around a centre."""
    from matplotlib.patches import FancyBboxPatch

    style = "round,pad=0.02,rounding_size=0.08"
    corner = x - width / 2, y - 0.33
    axes.add_patch(FancyBboxPatch(corner, width, 0.66, boxstyle=style, fc=colour, ec="0.45"))
    axes.text(x, y, text, **TEXT)


def arrow(axes: Any, start: tuple[float, float], end: tuple[float, float], **style: Any) -> None:
    """Draw an arrow."""
    axes.annotate("", end, start, arrowprops={**ARROW, **style})


def friction_law() -> Any:
    """Motor torque against load for both directions of motion: the outer one of two lines."""
    drive = load_robot("vitreoretinal").joints[0].drive
    assert drive is not None
    assert drive.friction is not None
    slopes = [1e3 * float(slope) for slope in mesh_coefficients(drive, drive.friction.mu)]
    load = np.linspace(-2.0, 2.0, 201)
    figure, both = panels(2.9, 2, sharey=True)
    for axes, sign, name in zip(both, (1.0, -1.0), ("forwards", "backwards"), strict=True):
        lines = slopes[0] * load, slopes[1] * load
        names = "γ tan(λ + φ) F", "γ tan(λ − φ) F"
        for line, label, colour in zip(lines, names, COLOURS, strict=False):
            axes.plot(load, line, "--", color=colour, linewidth=1.0, label=label)
        torque = sign * np.maximum(sign * lines[0], sign * lines[1])
        axes.plot(load, torque, color="black", linewidth=2.2, label="load term of the torque")
        axes.axvspan(*sorted((0.0, -2.0 * sign)), color="0.94", zorder=0)
        draw_zero_lines(axes, down=True)
        axes.text(-1.35 * sign, -8 * sign, "load helps,\nmotor still pushes", **TEXT)
        axes.text(1.4 * sign, 12 * sign, "load opposes", **TEXT)
        finish_axes(
            axes, "load F (N·m)", "load term (mN·m)" if sign > 0 else "", f"motor turns {name}"
        )
    draw_legend_above(figure, both[0], 3)
    return figure


def transmission() -> Any:
    """The parts of a drive from the motor to the joint, with the symbols of the torque law."""
    figure, axes = sketch(1.5, (-0.8, 9.4), (-0.9, 1.0))
    parts = (
        (0.0, "motor\n$\\tau_m$", 1.2),
        (2.2, "input side\n$J_{in},\\ b_c,\\ b_v$", 1.8),
        (4.7, "thread or teeth\n$\\gamma,\\ \\lambda,\\ \\mu$", 1.9),
        (7.0, "output side\n$J_{out},\\ b_{oc},\\ b_{ov}$", 1.8),
        (8.9, "link\n$\\tau$", 0.9),
    )
    for x, text, width in parts:
        box(axes, x, 0.0, text, width, "#fdf0e3" if "thread" in text else "#eaf1f7")
    for (left, _, before), (right, _, after) in pairwise(parts):
        arrow(axes, (left + before / 2, 0.0), (right - after / 2, 0.0))
    axes.text(1.1, -0.65, "speed $w = r\\,\\dot q$", **TEXT)
    axes.text(4.7, 0.7, "friction wedges here", **TEXT)
    axes.text(5.9, -0.65, "load F", **TEXT)
    axes.text(8.0, -0.65, "speed $\\dot q$", **TEXT)
    return figure


def low_speed() -> Any:
    """Friction coefficient against motor speed, and at the start after a rest."""
    drive = load_robot("vitreoretinal").joints[0].drive
    assert drive is not None
    assert drive.friction is not None
    friction = replace(drive.friction, mu=0.10, mu_static=0.16, dwell_constant=0.3)
    figure, (left, right) = panels(2.6, 2, sharey=True)
    x, rest = np.linspace(0.0, 3.0, 200), np.linspace(0.0, 3.0, 200)
    for law, dashes, colour in zip(("exponential", "gaussian"), LINE_DASHES, COLOURS, strict=False):
        mu = 0.10 + 0.05 * stribeck_shape(f"stribeck_{law}", x)
        left.plot(x, mu, dashes, color=colour, label=law)
    left.axhline(0.10, **LIMIT_STYLE)
    left.text(2.4, 0.1035, "$\\mu_k$", **TEXT)
    finish_axes(left, "speed w / $w_s$", "friction coefficient", "in motion")
    draw_legend(left)
    right.plot(rest, static_coefficient(friction, rest), color=COLOURS[2])
    for value, name in ((0.16, "$\\mu_{static}$"), (0.10, "$\\mu_0$")):
        right.axhline(value, **LIMIT_STYLE)
        right.text(2.7, value + 0.0035, name, **TEXT)
    finish_axes(right, "rest $t_d$ (s)", "", "at the start after a rest")
    left.set_ylim(0.09, 0.17)
    return figure


def self_locking() -> Any:
    """Friction coefficient against lead angle: where the load cannot turn the motor."""
    figure, axes = panels(2.7)
    lead = np.linspace(0.0, 12.0, 100)
    axes.plot(lead, np.tan(np.radians(lead)), color="black", linewidth=1.0)
    axes.fill_between(
        lead, np.tan(np.radians(lead)), 0.3, color=COLOURS[2], alpha=0.12, linewidth=0
    )
    axes.text(3.0, 0.24, "self-locking: λ < φ", **TEXT)
    axes.text(9.0, 0.10, "the load turns the motor", **TEXT)
    for joint, colour in zip(load_robot("vitreoretinal").joints, COLOURS, strict=True):
        drive = joint.drive
        if drive is not None and drive.friction is not None:
            angle, wedging = math.degrees(math.atan(drive.lead_slope)), drive.wedging
            mu = drive.friction.mu * wedging
            axes.plot(angle, mu, "o", color=colour, label=f"drive of {joint.name}")
    axes.set(ylim=(0.0, 0.3), xlim=(0.0, 12.0))
    finish_axes(axes, "lead angle λ (°)", "tan φ = μ / cos θₙ")
    draw_legend(axes, loc="lower right", ncols=3)
    return figure


def path_bound() -> Any:
    """Speed along a path: the curves that the joints allow, and the planned motion below them."""
    result = load_plan(SHIPPED)
    phase = result.motion.phases[0]
    mechanism = Mechanism.from_geometry(result.robot.geometry)
    t = np.linspace(phase.start, phase.end, 1200)
    samples = result.motion.sample(t)
    tilt = task_from_joints(mechanism, samples.q)[:, 1]
    speed = np.abs(np.gradient(tilt, t))
    figure, axes = panels(2.9)
    moving = speed > 0.02
    lowest = np.full(moving.sum(), np.inf)
    for joint, qd, colour, dashes in zip(
        result.robot.joints[:3], samples.qd.T, COLOURS, LINE_DASHES, strict=False
    ):
        allowed = joint.velocity * speed[moving] / np.maximum(np.abs(qd[moving]), 1e-9)
        lowest = np.minimum(lowest, allowed)
        axes.plot(*np.degrees([tilt[moving], allowed]), dashes, color=colour, label=joint.name)
    axes.fill_between(
        *np.degrees([tilt[moving], lowest]), 99.0, color="0.92", zorder=0, linewidth=0
    )
    axes.plot(*np.degrees([tilt, speed]), color="black", linewidth=2.2, label="planned motion")
    axes.set(ylim=(0.0, 75.0), xlim=(-84.0, -136.0))
    axes.text(-110.0, 62.0, "forbidden by the speed of a joint", **TEXT)
    finish_axes(axes, "tilt (°)", "tilt speed (°/s)")
    draw_legend(axes, loc="lower center", ncols=4)
    return figure


def lower_bound() -> Any:
    """Shortest motion of one joint: triangle or trapezoid, and its duration against the distance."""
    joint = load_robot("vitreoretinal").joints[0]
    fastest, steepest = math.degrees(joint.velocity), math.degrees(joint.acceleration)
    figure, (left, right) = panels(2.5, 2)
    for distance, colour, dashes in zip((10.0, 40.0), COLOURS, LINE_DASHES, strict=False):
        peak = min(fastest, math.sqrt(distance * steepest))
        duration = distance / peak + peak / steepest
        ramp = peak / steepest
        corners = [0.0, ramp, duration - ramp, duration]
        left.plot(corners, [0.0, peak, peak, 0.0], dashes, color=colour, label=f"{distance:.0f}°")
    left.axhline(fastest, **LIMIT_STYLE)
    finish_axes(left, "time (s)", "joint speed (°/s)", "fastest motion from rest to rest")
    draw_legend(left, loc="center right")
    d = np.linspace(0.0, 60.0, 200)
    peaks = np.minimum(fastest, np.sqrt(d * steepest) + 1e-12)
    right.plot(d, d / peaks + peaks / steepest, color="black")
    right.axvline(fastest**2 / steepest, **LIMIT_STYLE)
    right.text(fastest**2 / steepest + 1.5, 0.12, "$V^2/A$", fontsize=8.5, ha="left")
    finish_axes(right, "distance d (°)", "bound $t_i(d)$ (s)", "lower bound of the duration")
    return figure


def candidates() -> Any:
    """Lower bounds, estimates and durations of the candidates of two shipped problems."""
    figure, both = panels(2.2, 2)
    for axes, name in zip(both, ("waypoints", "eye_approach"), strict=True):
        entries = plan(load_problem(name)).candidates[0]
        for row, entry in enumerate(entries):
            values = [entry[key] for key in ("bound", "estimate", "duration")]
            seen = [value for value in values if value is not None]
            axes.plot([min(seen), max(seen)], [row, row], color="0.8", linewidth=4, zorder=0)
            for value, key, mark, colour in zip(
                values, ("lower bound", "estimate", "duration"), "|oD", COLOURS, strict=False
            ):
                if value is not None:
                    label = None if key in axes.get_legend_handles_labels()[1] else key
                    axes.plot(value, row, mark, color=colour, markersize=8, label=label)
        axes.set_yticks(range(len(entries)), [entry["kind"] for entry in entries])
        axes.set_ylim(len(entries) - 0.4, -1.1)
        finish_axes(axes, "duration (s)", "", f"first phase of {name}")
    draw_legend(both[0], loc="upper right", ncols=3, handletextpad=0.1, columnspacing=0.8)
    return figure


def corners() -> Any:
    """The same lines with stops and with rounded corners: path of the tip, and its speed."""
    rounded = load_problem("rounded_corners")
    lines: Any = rounded.motion
    stopping = replace(rounded, motion=tuple(replace(line, blend=None) for line in lines))
    figure, (left, right) = panels(2.8, 2)
    for problem, colour, dashes, name in (
        (stopping, COLOURS[1], "--", "with stops"),
        (rounded, COLOURS[0], "-", "blend: 0.5 mm"),
    ):
        motion = plan(problem).motion
        t = np.linspace(0.0, motion.duration, 2000)
        tip = 1e3 * fk(problem.robot, motion.sample(t).q).position
        speed = np.linalg.norm(np.gradient(tip, t, axis=0), axis=1)
        left.plot(tip[:, 0], tip[:, 2], dashes, color=colour, label=name)
        right.plot(t, speed, dashes, color=colour)
    right.axhline(25.0, **LIMIT_STYLE)
    left.set_aspect("equal", adjustable="datalim")
    finish_axes(left, "x (mm)", "z (mm)", "path of the tip, from the side")
    finish_axes(right, "time (s)", "tip speed (mm/s)", "speed; limit 25 mm/s")
    draw_legend(left)
    return figure


def eye_limits() -> Any:
    """Section of the eye with the keys of a problem file: retina, clearance, port, lens and shaft."""
    from matplotlib.patches import Circle, Ellipse

    eye = load_problem("eye_approach").eye
    assert eye is not None
    assert eye.lens is not None
    x, z = 1e3 * eye.centre[0], 1e3 * eye.centre[2]
    figure, axes = sketch(3.4, (-16.0, 36.0), (-20.5, 5.5))
    radius, clearance, port = (1e3 * size for size in (eye.radius, eye.clearance, eye.port))
    axes.add_patch(Circle((x, z), radius, fc="#fbeee9", ec="#a8482c", linewidth=2))
    axes.add_patch(Circle((x, z), radius - clearance, fill=False, ec="0.4", linestyle="--"))
    axes.add_patch(Circle((0.0, 0.0), port, fc="white", ec="0.4", linestyle=":"))
    lens_at = 1e3 * eye.lens.centre[0], 1e3 * eye.lens.centre[2]
    wide, high = 2e3 * np.asarray(eye.lens.semi_axes)[[0, 2]]
    scale = 1.0 + eye.shaft_radius / min(eye.lens.semi_axes)
    axes.add_patch(
        Ellipse(lens_at, wide * scale, high * scale, fill=False, ec="0.4", linestyle="--")
    )
    axes.add_patch(Ellipse(lens_at, wide, high, fc="#9dc3e6", ec="#1b6fa8"))
    tip = np.array([9.07, -17.66])
    axes.plot(*np.transpose([-0.28 * tip, tip]), color="black", linewidth=3)
    axes.plot(0.0, 0.0, "o", color="black", markersize=5)
    for text, place, at in (
        ("remote centre, origin", (-9.5, 3.5), (0.0, 0.0)),
        ("port: 3 mm", (-10.0, -4.0), (-2.7, -1.3)),
        ("lens: semi_axes, axis", (28.0, 1.5), (13.0, -1.4)),
        ("radius: 11.3 mm", (28.0, -5.0), (x + 11.2, -6.5)),
        ("clearance: 1 mm", (28.0, -12.5), (x + 9.0, -12.7)),
        ("tip", (18.0, -19.5), (9.2, -17.8)),
        ("shaft_radius", (-8.5, -11.0), (4.1, -8.0)),
        ("centre", (14.5, -9.5), (x, z)),
    ):
        style = {"arrowstyle": "-", "color": "0.5", "linewidth": 0.8}
        axes.annotate(text, at, place, arrowprops=style, **TEXT)
    axes.plot(x, z, "+", color="0.3")
    return figure


def task_coordinates() -> Any:
    """The four task coordinates on the arm: tilt and depth from the side, roll and spin as turns."""
    from matplotlib.patches import Arc, Circle

    figure, axes = sketch(3.4, (-64.0, 60.0), (-23.0, 41.0))
    mechanism = Mechanism.from_geometry(load_robot("vitreoretinal").geometry)
    task = np.array([[0.0, math.radians(-115.0), 0.0, 0.02]])
    inwards = pose_from_task(mechanism, task)[1][0, [0, 2]] / 0.02
    axes.add_patch(Circle((9.07, -7.86), 11.3, fc="#fbeee9", ec="#a8482c"))
    axes.plot([-48.0, 0.0], [0.0, 0.0], color=COLOURS[0], linewidth=5, solid_capstyle="round")
    axes.plot([0.0, 50.0], [0.0, 0.0], ":", color=COLOURS[0])
    outer = -34.0 * inwards
    axes.plot(*np.transpose([outer, 16.0 * inwards]), color="black", linewidth=3)
    down = math.degrees(math.atan2(*inwards[::-1]))
    axes.add_patch(Arc((0.0, 0.0), 34.0, 34.0, theta1=down, theta2=0, ec=COLOURS[1], lw=2))
    axes.plot(0.0, 0.0, "o", color="black", markersize=6)
    for at, text in (
        ((-24.0, 5.0), "axis of joint 1"),
        ((-36.0, 22.0), "tool, along the axis\nof joints 3 and 4"),
        ((32.0, -13.0), "tilt, from axis 1\nto the tool"),
        ((-20.0, -10.0), "depth, from the remote\ncentre to the tip"),
        ((14.0, 5.0), "remote centre"),
    ):
        axes.text(*at, text, **TEXT)
    for at, text in (((-48.0, 0.0), "roll"), (tuple(outer), "spin")):
        axes.add_patch(Arc(at, 7, 12, theta1=-140, theta2=140, ec=COLOURS[2], lw=2))
        axes.text(at[0] - 7.0, at[1] + 5.0, text, **TEXT)
    arrow(axes, (-2.5, -1.0), tuple(16.0 * inwards + [-2.5, -1.0]), color=COLOURS[3])
    return figure


def stalled() -> Any:
    """A motor that stalls: set point and simulated position, and the error that trips the drive."""
    result = simulate(load_plan(SHIPPED), Scenario(stall=("tilt", 1.0)))
    axis = result.axes["tilt"]
    figure, (left, right) = panels(2.6, 2)
    left.plot(result.time, np.degrees(result.planned[:, 1]), "--", color="0.4", label="set point")
    left.plot(result.time, np.degrees(result.q[:, 1]), color=COLOURS[1], label="simulated")
    left.axvline(1.0, **LIMIT_STYLE)
    finish_axes(left, "time (s)", "joint 2, tilt (°)", "the motor stalls at 1 s")
    draw_legend(left)
    increments = result.following[:, 1] * axis.counts_per_turn / (2 * np.pi)
    shown = np.flatnonzero(np.logical_and(result.powered, result.time > 0.98))
    (use,) = (motor for motor in result.motors if motor.joint == "tilt")
    right.plot(1e3 * (result.time[shown] - 1.0), np.abs(increments[shown]), color=COLOURS[1])
    right.axhline(use.window, **LIMIT_STYLE)
    finish_axes(
        right, "time after the stall (ms)", "following error (inc)", "the drive trips at its window"
    )
    return figure


def increments() -> Any:
    """The first set points of an export: exact positions, and whole increments of the encoder."""
    result = load_plan(SHIPPED)
    t = np.arange(0.0, 0.0121, 0.001)
    fine = np.linspace(0.0, 0.012, 400)
    joint = result.robot.joints[1]
    assert joint.drive is not None
    scale = joint.drive.ratio * 4096 / (2 * np.pi)
    begin = result.motion.sample([0.0]).q[0, 1]
    exact, points = (scale * (result.motion.sample(each).q[:, 1] - begin) for each in (fine, t))
    figure, axes = panels(2.4)
    axes.plot(1e3 * fine, exact, color=COLOURS[1], label="planned position")
    axes.plot(1e3 * t, np.round(points), "s", color="black", markersize=4, label="set point")
    axes.plot(1e3 * t, np.round(points), color="0.6", linewidth=0.8)
    finish_axes(axes, "time (ms)", "motor of joint 2 (increments)")
    draw_legend(axes)
    return figure


def certificate() -> Any:
    """The certificate of a plan: the share of every limit that the motion uses."""
    certificate = load_plan(SHIPPED).certificate
    assert certificate is not None
    rows = sorted(
        (limit for limit in certificate.limits if "jump" not in limit.name and limit.margin < 0.9),
        key=lambda limit: -limit.margin,
    )
    figure, axes = panels(0.6 + 0.17 * len(rows))
    for row, limit in enumerate(rows):
        by_design = limit.margin <= ACTIVE_MARGIN
        axes.barh(row, 100 * (1 - limit.margin), color=COLOURS[1] if by_design else COLOURS[0])
    axes.axvline(100.0, color="black", linewidth=1.2)
    axes.set_yticks(range(len(rows)), [", ".join(filter(None, (r.name, r.joint))) for r in rows])
    axes.set_xlim(0.0, 104.0)
    finish_axes(axes, "share of the limit that the motion uses (%); orange: binds by design", "")
    axes.tick_params(axis="y", labelsize=7)
    axes.set_axisbelow(True)
    return figure


def peaks() -> Any:
    """A peak between samples: the polynomials give the exact extreme, and samples miss it."""
    motion = load_plan(SHIPPED).motion
    fine, coarse = np.linspace(0.0, 3.3, 3000), np.arange(0.1, 3.35, 0.4)
    figure, axes = panels(2.4)
    speed, seen = (np.degrees(motion.sample(t).qd[:, 0]) for t in (fine, coarse))
    axes.plot(fine, speed, color=COLOURS[0], label="polynomials of joint 1")
    axes.plot(coarse, seen, "o", color=COLOURS[1], label="samples every 0.4 s")
    worst = np.argmax(np.abs(speed))
    axes.plot(fine[worst], speed[worst], "D", color="black", label="exact extreme")
    axes.axhline(65.0 * np.sign(speed[worst]), **LIMIT_STYLE)
    shade_phases(axes, motion, with_names=True)
    finish_axes(axes, "time (s)", "joint speed (°/s)")
    draw_legend(axes, loc="center right")
    return figure


def commands() -> Any:
    """The commands between the files: problem, plan, drive files and recordings."""
    figure, axes = sketch(2.6, (-1.1, 10.6), (-2.5, 1.7))
    files = "#eaf1f7"
    box(axes, 0.0, 0.0, "problem, robot\nand drives", 1.9, files)
    box(axes, 4.0, 0.0, "plan.json,\nreport", 1.6, files)
    box(axes, 8.0, 0.0, "set points\nand code", 1.6, files)
    box(axes, 8.0, -1.9, "recordings", 1.6, files)
    style = {**TEXT, "family": "monospace", "fontsize": 8}
    for start, end, text, at in (
        ((0.97, 0.0), (3.18, 0.0), "plan", (2.05, 0.22)),
        ((4.82, 0.0), (7.18, 0.0), "export", (6.0, 0.22)),
        ((8.0, -0.36), (8.0, -1.54), "play,\nthe robot", (8.9, -0.95)),
        ((7.18, -1.9), (0.0, -1.9), "identify, predict", (2.9, -1.68)),
        ((7.18, -1.75), (4.4, -0.36), "compare", (6.4, -1.0)),
    ):
        arrow(axes, start, end)
        axes.text(*at, text, **style)
    arrow(axes, (0.0, -1.9), (0.0, -0.36))
    axes.text(4.0, 1.1, "check  simulate  size\nreport  film", **style)
    arrow(axes, (4.0, 0.85), (4.0, 0.38))
    axes.text(0.0, 1.1, "new  schema\nworkspace  ik  view", **style)
    arrow(axes, (0.0, 0.85), (0.0, 0.38))
    axes.text(8.0, 1.1, "check", **style)
    arrow(axes, (8.0, 0.9), (8.0, 0.38))
    return figure


def joint_positions() -> Any:
    """What `plan.plot(axes)` draws."""
    figure, axes = panels(2.6)
    load_plan(SHIPPED).plot(axes)
    return figure


FIGURES: tuple[Callable[[], Any], ...] = (
    friction_law,
    transmission,
    low_speed,
    self_locking,
    path_bound,
    lower_bound,
    candidates,
    corners,
    eye_limits,
    task_coordinates,
    stalled,
    increments,
    certificate,
    peaks,
    commands,
    joint_positions,
)


def main(folder: Path = HERE / "figures") -> None:
    """Write every figure as PNG."""
    folder.mkdir(exist_ok=True)
    for draw in FIGURES:
        save_figure(draw(), folder / draw.__name__, pdf=False)


if __name__ == "__main__":
    main()
