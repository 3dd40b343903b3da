"""Figures of a simulated playback: tracking, motor torque, the tip, and its way after a loss of power."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ssm_planner.problem.robot import JOINTS
from ssm_planner.reporting.figures.style import COLOURS, DASHES, LIMIT, SIZE, finish, new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ssm_planner.simulation.simulate import SimulationResult


def write_simulation_figures(result: SimulationResult, folder: Path) -> dict[str, Path]:
    """playback and, where power was lost at several instants, power_loss, as PNG and PDF; their paths by name."""
    paths = dict(save_figure(playback(result), folder / "playback"))
    if len(result.losses.time) > 1:
        paths |= save_figure(power_loss(result), folder / "power_loss")
    return paths


def playback(result: SimulationResult) -> Figure:
    """Following errors, motor torques with their limits, and the distance of the tip from the plan, over time."""
    figure = new_figure(7.2, 6.6)
    errors, torques, tip = figure.subplots(3, 1, sharex=True)
    shown = result.time
    for motor in result.motors:
        k = JOINTS.index(motor.joint)
        style = {"color": COLOURS[k], "linestyle": DASHES[k], "linewidth": 1.1, "label": motor.joint}
        counts = result.axes[motor.joint].counts_per_turn
        errors.plot(shown, result.following[:, k] * counts / (2 * np.pi), **style)
        torques.plot(shown, 100 * result.torque[:, k] / motor.limit, **style)
    for level in (-100, 100):
        torques.axhline(level, **LIMIT)
    tip.plot(shown, 1e3 * result.tip, color="black", linewidth=1.3)
    finish(errors, "", "following error\n(increments)")
    finish(torques, "", "motor torque\n(% of largest)")
    finish(tip, "time (s)", "tip away from\nthe plan (mm)")
    figure.legend(
        *errors.get_legend_handles_labels(), loc="outside upper center", ncols=4, fontsize=SIZE, frameon=False
    )
    return figure


def power_loss(result: SimulationResult) -> Figure:
    """Way of the tip and time until the arm stands, by the instant at which the power goes."""
    losses = result.losses
    figure = new_figure(7.2, 4.2)
    travel, standing = figure.subplots(2, 1, sharex=True)
    travel.plot(losses.time, 1e3 * losses.travel, color="black", linewidth=1.2)
    standing.plot(losses.time, 1e3 * np.where(np.isfinite(losses.standing), losses.standing, np.nan), color="black")
    finish(travel, "", "way of the tip (mm)")
    finish(standing, "power lost at (s)", "until it stands (ms)")
    return figure
