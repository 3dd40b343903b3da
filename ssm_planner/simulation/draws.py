"""One playback under many frictions at once, each drawn from what the drive files know of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ssm_planner.codegen.vectorised import Vectorised
from ssm_planner.dynamics.spread import drawn, spread_of
from ssm_planner.kinematics.forward import tip_position
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.problem.robot import Robot
from ssm_planner.simulation.plant import FRICTION, Q, W
from ssm_planner.simulation.playback import CURRENT, TRIP, Commands, ControlledArm
from ssm_planner.typing import Array, Mask

SEED = 20_261_122
LOOKED = 5
"""Periods between two looks at where the tip is."""
TOLD = 1000
"""Periods between two reports of progress."""


@dataclass(frozen=True, eq=False)
class Draws:
    """What n frictions make of one playback; arrays (n,) and (n, 4), SI."""

    friction: Array
    """(n, 28) as `ArmPlant.friction` has it."""
    tip_error: Array
    peak_torque: Array
    """Of the motors; 0 without a drive."""
    following_error: Array
    """rad at the motor."""
    saturated: Mask
    tripped: Mask
    tip_limit: float

    @property
    def passed(self) -> Mask:
        """(n,): no motor saturates or trips, and the tip stays within its limit."""
        fine = np.logical_not(self.saturated.any(axis=1) | self.tripped.any(axis=1))
        passed: Mask = fine & (self.tip_error <= self.tip_limit)
        return passed

    def to_dict(self) -> dict[str, Any]:
        """`draws` in what `simulate --json` prints; SI. Quantiles: 2.5 %, median, 97.5 %."""

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
    """(count, 28) friction of every joint as `ArmPlant.friction` has it, and notes on what is not known.

    From the posterior or covariance of each drive file, uniform within its stated ranges; spread: range, as a share, of what
    a drive file says nothing of. The same draws every time. Raises ProblemError.
    """
    rng = np.random.default_rng(SEED)
    table, notes = np.zeros((count, 4, len(FRICTION))), []
    for k, joint in enumerate(robot.joints):
        if joint.drive is None:
            continue
        known = spread_of(joint.drive, spread)
        if not known.known:
            notes.append(
                f"joint {joint.name}: its drive file says nothing of how uncertain its friction is: as stated"
            )
        deviations = known.deviations(count)
        values: dict[str, Any] = known.values(deviations[np.arange(count) % len(deviations)])
        values |= {
            name: rng.uniform(low, high, count) for name, (low, high) in known.ranges.items()
        }
        friction = drawn(
            joint.drive, {name: value for name, value in values.items() if name in _TAKEN}
        ).friction
        table[:, k] = np.stack(
            [np.broadcast_to(getattr(friction, name), count) for name in FRICTION], axis=1
        )
    return table.reshape(count, -1), tuple(notes)


_TAKEN = (*FRICTION, "mu_lowest")


def play_draws(
    arm: ControlledArm,
    start: Array,
    told: Commands,
    *,
    offsets: Array,
    friction: Array,
    planned: Array,
    tip_limit: float,
    progress: Callable[[str], None] = lambda text: None,
) -> Draws:
    """From one state (44,) with the encoders' offsets (4,), the same commands (m periods) under frictions (n, 28).

    planned (m, 4): where the joints should be. The energy of each is not kept.
    """
    count = len(friction)
    whole, halves = Vectorised(arm.one), Vectorised(arm.one_in_halves)
    halved, table = arm.halved(told), told.table()
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
        if m % TOLD == 0:
            progress(f"{count} frictions, {100 * m // len(table)} %")
        if m % LOOKED == 0:
            there = tip_position(mechanism, planned[m : m + 1])
            tip = np.fmax(tip, np.linalg.norm(tip_position(mechanism, x[:, Q]) - there, axis=1))
        inputs[:, : table.shape[1]] = row
        x, following, cut = (halves if halved[m] else whole)(np.asfortranarray(x), inputs)
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
