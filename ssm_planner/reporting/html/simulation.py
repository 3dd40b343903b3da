"""Write the HTML page of a simulated playback, that is, of the simulated execution of a plan.

The page shows the planned and the simulated arm in one view. It also plots the tracking errors, the
motor torques and the effect of power losses. As in `panels`, a panel is the description of a plot,
and a channel is a named series of plotted values.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from ssm_planner.display import format_number
from ssm_planner.kinematics import Mechanism, tip_position
from ssm_planner.plans import Plan
from ssm_planner.problem import JOINTS, MotorTorque
from ssm_planner.reporting.figures.style import COLOURS
from ssm_planner.reporting.html.channels import encode_channels, sample_channels, time_grid
from ssm_planner.reporting.html.page import render_page, write_page
from ssm_planner.reporting.html.panels import (
    Panel,
    convert_to_display_units,
    limit_entry,
    new_limit_entry,
    new_panel,
)
from ssm_planner.reporting.html.scene import robot_scene
from ssm_planner.reporting.text import simulation_tables
from ssm_planner.simulation.simulate import SimulationResult
from ssm_planner.typing import Array, Arrays, JsonObject

PLANNED, SIMULATED = range(2)
"""Indices of the two motions on the page."""


def write_simulation_page(plan: Plan, result: SimulationResult, path: Path) -> Path:
    """Write the page of a simulated playback, and return its path.

    Parameters
    ----------
    plan : Plan
        The plan that was simulated.
    result : SimulationResult
        Its simulation.
    path : Path
        File of the page.

    Raises
    ------
    ExportError
        If the file cannot be written.
    """
    return write_page(path, simulation_page(plan, result), plan.sha256)


def simulation_page(plan: Plan, result: SimulationResult) -> str:
    """Render the page of a simulated playback as an HTML document.

    Parameters
    ----------
    plan : Plan
        The plan that was simulated.
    result : SimulationResult
        Its simulation.

    Returns
    -------
    str
        Text of the page.
    """
    marks = [("good", "passed", "") if result.passed else ("bad", "not passed", "")]
    marks += [("bad", "", reason) for reason in result.reasons]
    losses = result.losses
    holding = "holds" if result.holds else "does not hold"
    standstill = f"the arm {holding}, and the tip travels {1e3 * result.travel:.4f} mm"
    return render_page(
        "simulation.html",
        simulation_data(plan, result),
        title=f"{plan.problem.name} – simulated playback",
        plan=plan,
        marks=marks,
        notes=result.notes,
        tip=format_number(1e3 * result.tip_error, 4),
        loss=f"{standstill} (power lost at {float(losses.time[losses.worst]):.3f} s)",
        tables=simulation_tables(result),
    )


def simulation_data(plan: Plan, result: SimulationResult) -> JsonObject:
    """Return the data for the scripts of the page as JSON types.

    Both motions are sampled on the same time grid. After its end, the plan keeps its last position.
    If the arm executed the plan at a lower speed in the simulation, the page shows the slower plan.

    Parameters
    ----------
    plan : Plan
        The plan that was simulated.
    result : SimulationResult
        Its simulation.

    Returns
    -------
    dict
        `duration` of the simulation and `ends` of both motions in s, `names` of the motions,
        `colours`, `panels` (the descriptions of the plots), and for each motion its 3D scene in
        `scenes` and its plotted values in `channels`. The planned motion is the first one.
    """
    if result.scenario.speed != 1.0:
        plan = replace(plan, trajectory=plan.motion.slower(result.scenario.speed))
    t = time_grid(float(result.time[-1]))
    channels = [sample_channels(plan, t), _simulated_channels(plan, result, t)]
    panels = list(_simulation_panels(plan, result))
    for panel in panels:
        convert_to_display_units(panel)
    return {
        "duration": float(t[-1]),
        "ends": [plan.motion.duration, float(t[-1])],
        "names": ["planned", "simulated"],
        "colours": list(COLOURS),
        "panels": panels,
        "scenes": [robot_scene(plan.robot, plan.limits)] * 2,
        "channels": [encode_channels(samples) for samples in channels],
    }


def _simulated_channels(plan: Plan, result: SimulationResult, t: Array) -> Arrays:
    """Sample the quantities of the simulated motion that the page plots over time.

    Parameters
    ----------
    plan : Plan
        Plan that was simulated.
    result : SimulationResult
        Result of the simulation.
    t : (n,) array
        Instants, s.

    Returns
    -------
    dict of (n,) arrays
        Values in SI units by name of the channel. "q", "qd" and "tau" with the index of a joint
        are its position, its velocity and its motor torque, and "tip0" to "tip2" the coordinates of
        the tip, as in `sample_channels`. "error" with the index of a joint is its simulated minus
        its planned position, and "tip_error" the distance of the tip from its planned position.
        "travel" is the travel of the tip after a loss of power at this instant.
    """

    def resample(values: Array) -> Array:
        """Interpolate each column of `values`, one row per simulated instant, at the instants t."""
        return np.column_stack([np.interp(t, result.time, column) for column in values.T])

    q = resample(result.q)
    tip = tip_position(Mechanism.from_robot(plan.robot), q)
    channels = {
        "t": t,
        "tip_error": resample(result.tip[:, None])[:, 0],
        "travel": np.interp(t, result.losses.time, result.losses.travel),
    }
    driven = [JOINTS.index(motor.joint) for motor in result.motors]
    for name, values, columns in (
        ("q", q, range(4)),
        ("qd", resample(result.qd), range(4)),
        ("error", resample(result.q - result.planned), range(4)),
        ("tip", tip, range(3)),
        ("tau", resample(result.torque), driven),
    ):
        channels |= {f"{name}{i}": values[:, i] for i in columns}
    return channels


def _simulation_panels(plan: Plan, result: SimulationResult) -> list[Panel]:
    """Build the plot descriptions (panels) of power losses, tip error, joint errors and torques.

    Parameters
    ----------
    plan : Plan
        The plan that was simulated.
    result : SimulationResult
        Its simulation. The travel after a loss of power is plotted only if the simulation contains
        losses at several instants.

    Returns
    -------
    list of Panel
        One plot of power losses, one of the tip error, and for each motor one plot of the error of
        its joint and one of its torque. Limits are in SI units.
    """
    tip = _single_channel_panel(
        "Tracking error", "Distance of the tip from the plan", "m", "tip_error"
    )
    tip["limits"] = [
        new_limit_entry("allowed", "", index=0, low=-np.inf, high=result.scenario.tip_error)
    ]
    losses = _single_channel_panel(
        "Power loss at this time", "Travel of the tip until standstill", "m", "travel"
    )
    errors = []
    torques = []
    for motor in result.motors:
        i = JOINTS.index(motor.joint)
        joint = plan.robot.joints[i]
        errors.append(_single_channel_panel("Tracking error", joint.name, joint.unit, f"error{i}"))
        panel = _single_channel_panel(
            "Motor torque", joint.name, "N·m", f"tau{i}", (PLANNED, SIMULATED)
        )
        limit = joint.find_limit(MotorTorque)
        panel["limits"] = [] if limit is None else [limit_entry(limit, i, f"tau{i}")]
        panel["missing"] = ["at rest, the controller’s integrator acts against static friction"]
        torques.append(panel)
    panels = [tip] + errors + torques
    return [losses] + panels if len(result.losses.time) > 1 else panels


def _single_channel_panel(
    section: str, title: str, unit: str, channel: str, sides: tuple[int, ...] = (SIMULATED,)
) -> Panel:
    """Build the description of a plot (panel) that shows one quantity of one or both motions.

    Parameters
    ----------
    section : str
        Heading under which the plot appears.
    title : str
        Title of the plot.
    unit : str
        SI unit of the quantity.
    channel : str
        Name of the plotted quantity, such as "tip_error" or "tau0".
    sides : tuple of int
        Motions whose curves are drawn, `PLANNED` or `SIMULATED`.

    Returns
    -------
    Panel
        Description of the plot without limits. Its keys "channel" and "sides" contain the last two
        arguments.
    """
    return {
        **new_panel(section, title, unit, [(channel, title, 0)]),
        "channel": channel,
        "sides": list(sides),
    }
