"""Table II: the friction of joints 1, 2 and 4 as torque–velocity maps, and the payload curves that follow from it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.transmission import breakaway_torque
from ssm_planner.identification.parameters import map_torque
from ssm_planner.kinematics.inverse import inverse_task
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.paper import published
from ssm_planner.paper.published import DRIVEN, NUMBER, PACKAGE_FRICTION, TABLE_II, FrictionRow, Inputs
from ssm_planner.paper.section import Section, number
from ssm_planner.problem.drive import Drive, Friction
from ssm_planner.problem.motorisation import Motorisation, Stroke
from ssm_planner.problem.robot import JOINTS, Joint, Robot
from ssm_planner.reporting.figures.sizing import payload_curves
from ssm_planner.reporting.figures.style import COLOURS, SIZE, finish, new_figure
from ssm_planner.sizing.duty import DutyCycle
from ssm_planner.sizing.requirements import MotorRequirement
from ssm_planner.sizing.size import Sizing, size
from ssm_planner.typing import Array
from ssm_planner.units import RPM

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from matplotlib.figure import Figure


MAP_SPEEDS = {"roll": published.ROTARY_SPEED, "tilt": published.ROTARY_SPEED, "insertion": published.LINEAR_SPEED}
"""Joint speed up to which a map is drawn: the one that the application requires."""
POINTS = 121
LOADS = 81
"""Samples of the range of gravity loads."""


@dataclass(frozen=True, eq=False)
class FrictionMap:
    """Model curve of one joint: motor speed (n,) rad/s, > 0 only; torques N·m."""

    joint: str
    drive: Drive
    w: Array
    unloaded: tuple[Array, Array]
    """Without load on the joint: forwards and backwards (at −w)."""
    package: tuple[Array, Array]
    """The same with the package's parameters."""
    loaded: tuple[tuple[Array, Array], tuple[Array, Array]]
    """Least and largest torque under the arm's weight, forwards and backwards."""
    gravity: tuple[float, float]
    """Range of the effort of gravity in the working range, N·m or N."""
    start: float
    """Breakaway torque without load."""

    @property
    def mesh(self) -> float:
        """Torque of the mesh without load, at the top speed."""
        row = TABLE_II[self.joint]
        return float(self.unloaded[0][-1] - row.b_c - row.b_v * self.w[-1])

    @property
    def largest(self) -> float:
        """Largest |torque| under the arm's weight, either way."""
        forwards, backwards = self.loaded
        return float(max(forwards[1].max(), -backwards[0].min()))


def driven(robot: Robot, joint: str) -> Drive:
    """The drive of a joint that has one."""
    drive = robot.joints[JOINTS.index(joint)].drive
    assert drive is not None, joint
    return drive


def with_friction(drive: Drive, row: FrictionRow) -> Drive:
    """The drive with Coulomb friction of a published row; its output side stays."""
    old = drive.friction or Friction(row.mu, row.mu_static, row.b_c, row.b_v)
    return replace(drive, friction=replace(old, mu=row.mu, mu_static=row.mu_static, b_c=row.b_c, b_v=row.b_v))


def gravity_ranges(robot: Robot) -> tuple[Array, Array]:
    """Least and largest joint effort of gravity over the robot's tilt range, ±30° of roll and its travel, (4,) each."""
    mechanism = Mechanism.from_geometry(robot.geometry)
    low, high = robot.ranges["tilt"]
    half = published.REQUIRED_ROLL / 2
    axes = (np.linspace(-half, half, 13), np.linspace(low, high, 60), [0.0], [0.0, published.REQUIRED_TRAVEL])
    task = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 4)
    solutions = inverse_task(mechanism, task)
    home = int(np.flatnonzero(solutions.branch[0] == mechanism.home_branch)[0])
    load = RigidBody.from_robot(robot).gravity_load(np.ascontiguousarray(solutions.joints[:, home]))
    return load.min(axis=0), load.max(axis=0)


def friction_maps(robot: Robot) -> tuple[FrictionMap, ...]:
    """The maps of joints 1, 2 and 4."""
    low, high = gravity_ranges(robot)
    maps = []
    for joint in DRIVEN:
        drive, i = driven(robot, joint), JOINTS.index(joint)
        paper = with_friction(drive, TABLE_II[joint])
        package = with_friction(drive, PACKAGE_FRICTION[joint])
        w = np.linspace(0.0, drive.ratio * MAP_SPEEDS[joint], POINTS)[1:]
        loads = np.linspace(low[i], high[i], LOADS)
        loads = np.append(loads, np.clip(0.0, low[i], high[i]))
        sheets = [np.array([map_torque(paper, sign * w, load) for load in loads]) for sign in (1.0, -1.0)]
        maps.append(
            FrictionMap(
                joint=joint,
                drive=paper,
                w=w,
                unloaded=(map_torque(paper, w, 0.0), map_torque(paper, -w, 0.0)),
                package=(map_torque(package, w, 0.0), map_torque(package, -w, 0.0)),
                loaded=(
                    (sheets[0].min(axis=0), sheets[0].max(axis=0)),
                    (sheets[1].min(axis=0), sheets[1].max(axis=0)),
                ),
                gravity=(float(low[i]), float(high[i])),
                start=float(breakaway_torque(paper, 0.0, 1.0)),
            )
        )
    return tuple(maps)


def friction_section(robot: Robot) -> Section:
    """Table II with the maps."""
    maps, (low, high) = friction_maps(robot), robot.ranges["tilt"]
    rows = [TABLE_II[joint] for joint in DRIVEN]
    torques = (
        ("top speed of the map (rpm)", *(f"{RPM * m.w[-1]:.0f}" for m in maps)),
        ("no load, slow", *(number(1e3 * m.unloaded[0][0]) for m in maps)),
        ("no load, top speed", *(number(1e3 * m.unloaded[0][-1]) for m in maps)),
        ("of which bearing, Coulomb", *(number(1e3 * row.b_c) for row in rows)),
        ("of which bearing, viscous", *(number(1e3 * row.b_v * m.w[-1]) for row, m in zip(rows, maps, strict=True))),
        ("of which mesh, by μ_c", *(number(1e3 * m.mesh) for m in maps)),
        ("no load, breakaway, by μ_s", *(number(1e3 * m.start) for m in maps)),
        ("the package's parameters, no load, top speed", *(number(1e3 * m.package[0][-1]) for m in maps)),
        ("effort of the arm's weight (N·m, N·m, N)", *(" … ".join(map(number, m.gravity)) for m in maps)),
        ("under the arm's weight, largest", *(number(1e3 * m.largest) for m in maps)),
    )
    parameters = (
        _parameter(robot, "mu", "μ_c", 1.0),
        _parameter(robot, "mu_static", "μ_s", 1.0),
        _parameter(robot, "b_c", "10³ b_c (N·m)", 1e3),
        _parameter(robot, "b_v", "10⁵ b_v (N·m·s/rad)", 1e5),
    )
    ratios = [PACKAGE_FRICTION[joint].b_c / TABLE_II[joint].b_c for joint in DRIVEN]
    values = {"parameters": parameters, "ratios": ratios, "torques": torques, "low": low, "high": high}
    return Section("friction", values, {"friction_maps": _maps_figure(maps)})


def _parameter(robot: Robot, name: str, symbol: str, scale: float) -> tuple[str, ...]:
    printed, package = ([getattr(rows[joint], name) for joint in DRIVEN] for rows in (TABLE_II, PACKAGE_FRICTION))
    ours = [float(getattr(driven(robot, joint).friction, name)) for joint in DRIVEN]
    difference = [mine - theirs for mine, theirs in zip(ours, printed, strict=True)]
    columns = (printed, ours, difference, package)
    return (symbol, *(" / ".join(number(scale * value) for value in values) for values in columns))


def _maps_figure(maps: tuple[FrictionMap, ...]) -> Figure:
    figure = new_figure(9.6, 3.6)
    panels = figure.subplots(1, len(maps))
    for axes, m in zip(panels, maps, strict=True):
        colour = COLOURS[JOINTS.index(m.joint)]
        for k, sign in enumerate((1.0, -1.0)):
            x = sign * RPM * m.w
            low, high = m.loaded[k]
            first = k == 0
            axes.fill_between(x, 1e3 * low, 1e3 * high, color="0.87", label="under the arm's weight" if first else None)
            axes.plot(
                x, 1e3 * m.unloaded[k], "--", color=colour, linewidth=1.6, label="Table II, no load" if first else None
            )
            axes.plot(x, 1e3 * m.package[k], ":", color="0.2", label="package, no load" if first else None)
            start = "breakaway, no load" if first else None
            axes.plot([0.0], [sign * 1e3 * m.start], "D", color=colour, markersize=4, label=start)
        axes.axhline(0.0, color="0.7", linewidth=0.6, zorder=0)
        axes.axvline(0.0, color="0.7", linewidth=0.6, zorder=0)
        axes.locator_params(axis="x", nbins=5)
        axes.set_title(f"joint {NUMBER[m.joint]} ({m.joint})", fontsize=SIZE)
        finish(axes, "motor speed (rpm)", "motor torque (mN·m)" if m is maps[0] else "")
    legend = panels[-1].get_legend_handles_labels()
    figure.legend(*legend, loc="outside upper center", ncols=4, fontsize=SIZE - 1, frameon=False)
    return figure


RUNS = {"paper": "the paper's speeds", "package": "the package's speeds"}
"""What the runs are called, by file name."""


@dataclass(frozen=True, eq=False)
class Payload:
    """One run at the friction of Table II and at the package's."""

    run: Motorisation
    identified: Sizing
    package: Sizing

    def rows(self) -> Iterator[tuple[str, MotorRequirement, MotorRequirement]]:
        """Every stroke: its name, what it requires at the friction of Table II and at the package's."""
        for stroke, ours, theirs in zip(self.run.strokes, self.identified.joints, self.package.joints, strict=True):
            yield _label(stroke), ours.requirement, theirs.requirement


def payloads(inputs: Inputs) -> tuple[Payload, ...]:
    """Both motorisation runs with both sets of friction."""
    return tuple(
        Payload(run, _sized(run, TABLE_II), _sized(run, PACKAGE_FRICTION)) for run in inputs.motorisations.values()
    )


def payload_section(results: tuple[Payload, ...]) -> Section:
    """Peaks of the payload curves, and the curves at the paper's speeds."""
    figures = {
        "payload_curves_package": payload_curves(results[0].package),
        "payload_curves_table_ii": payload_curves(results[0].identified),
    }
    return Section("payload", {"payloads": results}, figures)


def _label(stroke: Stroke) -> str:
    """Such as `joint 1, 65°/s, 200°/s²`."""
    scale, unit = (1e3, " mm") if stroke.joint == "insertion" else (180.0 / math.pi, "°")
    speed, bend = (f"{scale * value:.4g}{unit}" for value in (stroke.velocity, stroke.acceleration))
    return f"joint {NUMBER[stroke.joint]}, {speed}/s, {bend}/s²"


def _sized(run: Motorisation, rows: Mapping[str, FrictionRow]) -> Sizing:
    return size(DutyCycle.of_motorisation(replace(run, robot=with_rows(run.robot, rows))))


def with_rows(robot: Robot, rows: Mapping[str, FrictionRow]) -> Robot:
    """The robot with published friction in its drives, by joint name."""

    def changed(joint: Joint) -> Joint:
        row = rows.get(joint.name)
        return joint if joint.drive is None or row is None else replace(joint, drive=with_friction(joint.drive, row))

    first, second, third, fourth = (changed(joint) for joint in robot.joints)
    return replace(robot, joints=(first, second, third, fourth))
