"""Draw docs/mechanism.png, the picture of the README, from a shipped plan; `make picture` runs it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, PathPatch
from matplotlib.path import Path as Outline

from ssm_planner import Robot, Trajectory, fk, load_plan
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.rotations import rotation
from ssm_planner.problem.problem import Eye, Lens
from ssm_planner.reporting.html.scene import link_sides
from ssm_planner.typing import Array

ROOT = Path(__file__).parent.parent
PLAN = ROOT / "results/eye_approach"
PICTURE = ROOT / "docs/mechanism.png"
WIDTH, HEIGHT, DPI = 10.0, 2.7, 120
LINK = 0.026
"""Radius of the link arcs in metres. Robot files give no shapes, so the picture chooses one."""
TAIL = 0.030
"""Length of the tool outside the eye, m."""
AZIMUTH, ELEVATION = np.radians(28.0), np.radians(20.0)
VIEW = np.array(
    [
        [np.cos(AZIMUTH), np.sin(AZIMUTH), 0.0],
        [
            -np.sin(AZIMUTH) * np.sin(ELEVATION),
            np.cos(AZIMUTH) * np.sin(ELEVATION),
            np.cos(ELEVATION),
        ],
    ]
)
"""Orthonormal rows (2, 3) that project base coordinates onto the picture."""
LINKS = ("#4d5966", "#8694a3")
TRACE = "#d55e00"


def main(path: Path = PICTURE) -> None:
    """Write to `path` the plan at its start, halfway and at its end, and its tightest quantities over time."""
    plan = load_plan(PLAN)
    robot, trajectory, eye = plan.robot, plan.motion, plan.problem.eye
    assert eye is not None
    assert plan.certificate is not None
    limits = {limit.name: limit.limit for limit in plan.certificate.limits}
    figure = Figure(figsize=(WIDTH, HEIGHT), dpi=DPI)
    FigureCanvasAgg(figure)
    times = np.array([0.0, trajectory.duration / 2, trajectory.duration])
    for k, time in enumerate(times):
        axes = figure.add_axes((0.005 + 0.228 * k, 0.01, 0.228, 0.91))
        draw_eye(axes, eye)
        draw_mechanism(axes, robot, trajectory, time)
        axes.set_title(f"{time:.2f} s", fontsize=11)
    panel = figure.add_axes((0.755, 0.17, 0.205, 0.66))
    draw_limits(panel, robot, trajectory, limits)
    figure.savefig(path, metadata={"Software": None})


def draw_mechanism(axes: Axes, robot: Robot, trajectory: Trajectory, time: float) -> None:
    """Draw the two links and the tool at `time` (s), and the path of the tip."""
    mechanism = Mechanism.from_geometry(robot.geometry)
    q = trajectory.sample(np.linspace(0.0, trajectory.duration, 200)).q
    path = fk(robot, q).position @ VIEW.T
    axes.plot(*path.T, color=TRACE, linewidth=1.4, zorder=6)
    axes.plot(*path[-1], marker="o", color=TRACE, markersize=4, zorder=6)
    for k in (0, 100, 199):
        draw_tool(axes, robot, q[k], alpha=0.14)
    joints = trajectory.sample([time]).q[0]
    draw_tool(axes, robot, joints, alpha=1.0)
    sides = link_sides(robot, mechanism)
    turn1 = rotation(mechanism.omega1, joints[0])
    axis1 = sides[0] * mechanism.omega1
    axis2 = turn1 @ (sides[1] * mechanism.omega2)
    outside = outward(robot, joints)
    for number, ends, colour in (
        (1, (axis1, axis2), LINKS[0]),
        (2, (axis2, outside), LINKS[1]),
    ):
        arc = LINK * between(*ends) @ VIEW.T
        axes.plot(*arc.T, color=colour, linewidth=6, solid_capstyle="round", zorder=4)
        centre = LINK * ends[0] @ VIEW.T
        axes.plot(*centre, "o", color="white", markeredgecolor=colour, markersize=9, zorder=5)
        axes.annotate(str(number), centre, ha="center", va="center", fontsize=7, zorder=6)
    axes.plot(0, 0, "o", color="black", markersize=6, zorder=8)
    axes.annotate("port", (0, 0), (-8, -3), textcoords="offset points", ha="right", fontsize=8)
    axes.set_xlim(-0.030, 0.024)
    axes.set_ylim(-0.022, 0.032)
    axes.set_aspect("equal")
    axes.set_axis_off()


def draw_tool(axes: Axes, robot: Robot, q: Array, alpha: float) -> None:
    """Draw the tool for joint positions q (4,) as a line through the port."""
    ends = np.array([TAIL * outward(robot, q), fk(robot, q).position]) @ VIEW.T
    axes.plot(*ends.T, color="black", linewidth=2.2, alpha=alpha, zorder=7)


def outward(robot: Robot, q: Array) -> Array:
    """Return the unit vector (3,) along the tool that points out of the eye."""
    position = fk(robot, q).position
    direction: Array = -position / np.linalg.norm(position)
    return direction


def draw_eye(axes: Axes, eye: Eye) -> None:
    """Draw the retina with its clearance, and the lens, as the plan gives them."""
    centre = VIEW @ np.array(eye.centre)
    for radius, style in (
        (eye.radius, {"facecolor": "#f6d9cf", "edgecolor": "#c98a76", "linewidth": 1.5}),
        (
            eye.radius - eye.clearance,
            {"fill": False, "edgecolor": "#c98a76", "linestyle": "--", "linewidth": 0.8},
        ),
    ):
        axes.add_patch(Circle((centre[0], centre[1]), radius, zorder=1, **style))
    if eye.lens is not None:
        axes.add_patch(
            PathPatch(Outline(lens_outline(eye.lens)), color="#8fb8de", alpha=0.85, zorder=2)
        )
        x, y = VIEW @ np.array(eye.lens.centre)
        axes.annotate("lens", (x, y), ha="center", va="center", fontsize=8, zorder=3)
    axes.annotate(
        "retina", (centre[0] + 0.0055, centre[1] - 0.004), ha="center", fontsize=8, zorder=3
    )


def lens_outline(lens: Lens) -> Array:
    """Return the outline (n, 2) of the ellipsoid in the picture, for a lens whose axis is z."""
    half = VIEW * np.array(lens.semi_axes)
    angles = np.linspace(0.0, 2 * np.pi, 90)
    values, vectors = np.linalg.eigh(half @ half.T)
    circle = np.stack([np.cos(angles), np.sin(angles)])
    outline: Array = (VIEW @ np.array(lens.centre))[:, None] + vectors @ (
        np.sqrt(values)[:, None] * circle
    )
    return outline.T


def between(first: Array, second: Array) -> Array:
    """Return unit vectors (n, 3) along the great circle from one unit vector (3,) to another."""
    angle = np.arccos(np.clip(first @ second, -1.0, 1.0))
    share = np.linspace(0.0, 1.0, 40)[:, None]
    arc: Array = np.sin((1 - share) * angle) * first + np.sin(share * angle) * second
    return arc / np.sin(angle)


def draw_limits(
    axes: Axes, robot: Robot, trajectory: Trajectory, limits: Mapping[str, float]
) -> None:
    """Draw the insertion speed and the rate of tilt as shares of their limits."""
    t = np.linspace(0.0, trajectory.duration, 400)
    task = fk(robot, trajectory.sample(t).q).task
    rates = np.abs(np.gradient(task, t, axis=0))
    for name, coordinate, colour in (
        ("tilt rate", 1, "#009e73"),
        ("insertion speed", 3, "#0072b2"),
    ):
        share = 100 * rates[:, coordinate] / limits[name]
        axes.plot(t, share, color=colour, linewidth=1.8, label=name)
    axes.axhline(100, color="0.35", linestyle="--", linewidth=1)
    axes.set_xlim(0, trajectory.duration)
    axes.set_ylim(0, 110)
    axes.set_xlabel("time, s", fontsize=8)
    axes.set_title("share of the limit, %", fontsize=10)
    axes.tick_params(labelsize=8)
    axes.legend(fontsize=8, loc="lower center", frameon=False)
    axes.spines[["top", "right"]].set_visible(False)


if __name__ == "__main__":
    main()
