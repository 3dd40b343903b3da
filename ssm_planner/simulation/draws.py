"""Simulate one playback under many frictions at once, drawn from the data of the drive files."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ssm_planner.codegen.vectorised import Vectorised
from ssm_planner.dynamics.spread import drive_with, spread_of
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.problem.robot import Robot
from ssm_planner.representation import ShortRepr
from ssm_planner.simulation.plant import FRICTION, Q, W
from ssm_planner.simulation.playback import CURRENT, TRIP, Commands, ControlledArm
from ssm_planner.typing import Array, Mask, record

SEED = 20_261_122
TIP_INTERVAL = 5
"""Number of periods between two evaluations of the tip position."""
PROGRESS_INTERVAL = 1000
"""Number of periods between two progress reports."""


@record
class Draws(ShortRepr):
    """Results of one playback under n frictions. Arrays are (n,) and (n, 4), in SI units."""

    friction: Array
    """Friction parameters (n, 28) in the layout of `ArmPlant.friction`."""
    tip_error: Array
    peak_torque: Array
    """Largest motor torques. 0 for joints without a drive."""
    following_error: Array
    """Largest following errors, rad at the motor."""
    saturated: Mask
    tripped: Mask
    tip_limit: float

    @property
    def passed(self) -> Mask:
        """(n,), True if no motor saturates or trips and the tip stays within its limit."""
        fine = np.logical_not(self.saturated.any(axis=1) | self.tripped.any(axis=1))
        passed: Mask = fine & (self.tip_error <= self.tip_limit)
        return passed

    def to_dict(self) -> dict[str, Any]:
        """Return `draws` in the output of `simulate --json`, in SI units.

        Quantiles are 2.5 %, median and 97.5 %.
        """

        def quantiles(values: Array) -> list[float]:
            return [float(x) for x in np.quantile(values, [0.025, 0.5, 0.975])]

        return {
            "count": len(self.tip_error),
            "passed": int(self.passed.sum()),
            "tip_error": quantiles(self.tip_error),
            "peak_torque": [quantiles(column) for column in self.peak_torque.T],
            "saturated": int(self.saturated.any(axis=1).sum()),
            "tripped": int(self.tripped.any(axis=1).sum()),
        }


def drawn_frictions(
    robot: Robot, count: int, spread: float | None = None
) -> tuple[Array, tuple[str, ...]]:
    """Draw the friction of every joint and return (count, 28) and notes on missing uncertainties.

    The draws follow the posterior or covariance of each drive file and are uniform within its
    stated ranges. They are the same at every call. Columns are in the layout of
    `ArmPlant.friction`. `spread` is the relative range of parameters without uncertainty in the
    drive file. Raises ProblemError.
    """
    rng = np.random.default_rng(SEED)
    table, notes = np.zeros((count, 4, len(FRICTION))), []
    for k, joint in enumerate(robot.joints):
        if joint.drive is None:
            continue
        uncertainty = spread_of(joint.drive, spread)
        if not uncertainty.is_stated:
            notes.append(
                f"joint {joint.name}: its drive file does not state the uncertainty of its "
                "friction, which is used as stated"
            )
        deviations = uncertainty.deviations(count)
        values: dict[str, Any] = uncertainty.values(deviations[np.arange(count) % len(deviations)])
        values |= {
            name: rng.uniform(low, high, count) for name, (low, high) in uncertainty.ranges.items()
        }
        friction = drive_with(
            joint.drive, {name: value for name, value in values.items() if name in _DRAWN}
        ).friction
        table[:, k] = np.stack(
            [np.broadcast_to(getattr(friction, name), count) for name in FRICTION], axis=1
        )
    return table.reshape(count, -1), tuple(notes)


_DRAWN = (*FRICTION, "mu_lowest")


def play_draws(
    arm: ControlledArm,
    start: Array,
    commands: Commands,
    *,
    offsets: Array,
    friction: Array,
    planned: Array,
    tip_limit: float,
    progress: Callable[[str], None] = lambda text: None,
) -> Draws:
    """Play the same commands from one state under many frictions.

    Parameters
    ----------
    arm
        The simulated arm.
    start
        Initial state, (44,).
    told
        Commands of m periods.
    offsets
        Offsets of the encoders, (4,), rad.
    friction
        Friction parameters, (n, 28).
    planned
        Planned joint positions, (m, 4), rad or m.
    tip_limit
        Permitted tip error, m.
    progress
        Called with progress messages.

    Returns
    -------
    Draws
        Results by draw, without energies.
    """
    count = len(friction)
    full_step, half_steps = Vectorised(arm.control_step), Vectorised(arm.control_step_in_halves)
    halved, table = arm.needs_half_steps(commands), commands.table()
    x = np.tile(start, (count, 1))
    inputs = np.empty((count, table.shape[1] + len(offsets) + friction.shape[1]), order="F")
    inputs[:, table.shape[1] : table.shape[1] + 4], inputs[:, table.shape[1] + 4 :] = (
        offsets,
        friction,
    )
    mechanism = Mechanism.from_geometry(arm.robot.geometry)
    constants = np.array(
        [arm.electrics[k].torque_constant if k in arm.electrics else 0.0 for k in range(4)]
    )
    tip, peak, error = np.zeros(count), np.zeros((count, 4)), np.zeros((count, 4))
    saturated = np.zeros((count, 4), dtype=bool)
    for m, row in enumerate(table):
        if m % PROGRESS_INTERVAL == 0:
            progress(f"{count} frictions, {100 * m // len(table)} %")
        if m % TIP_INTERVAL == 0:
            target = tip_position(mechanism, planned[m : m + 1])
            tip = np.fmax(tip, np.linalg.norm(tip_position(mechanism, x[:, Q]) - target, axis=1))
        inputs[:, : table.shape[1]] = row
        x, following, cut = (half_steps if halved[m] else full_step)(np.asfortranarray(x), inputs)
        peak = np.fmax(peak, np.abs(x[:, CURRENT]))
        error = np.fmax(error, np.abs(following))
        saturated |= cut > 0
    tip[~np.all(np.isfinite(x[:, W]), axis=1)] = np.inf
    return Draws(
        friction,
        tip,
        peak_torque=peak * constants,
        following_error=error,
        saturated=saturated,
        tripped=x[:, TRIP] > 0,
        tip_limit=tip_limit,
    )
