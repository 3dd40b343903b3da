"""Simulate one playback many times at once, with random friction from the data of drive files."""

from __future__ import annotations

import numpy as np

from ssm_planner.codegen import Vectorised
from ssm_planner.dynamics import drive_with, spread_of
from ssm_planner.kinematics import Mechanism, tip_position
from ssm_planner.problem import Robot
from ssm_planner.progress import Progress, Step, silent
from ssm_planner.representation import ShortRepr
from ssm_planner.simulation.plant import FRICTION, Q, W
from ssm_planner.simulation.playback import CURRENT, TRIP, Commands, ControlledArm
from ssm_planner.typing import Array, JsonObject, Keywords, Mask, record

SEED = 20_261_122
TIP_INTERVAL = 5
"""Number of periods between two evaluations of the tip position."""
PROGRESS_INTERVAL = 1000
"""Number of periods between two progress reports."""


@record
class Draws(ShortRepr):
    """Results of n playbacks with random friction, in SI units.

    Examples
    --------
    >>> import numpy as np
    >>> import ssm_planner as ssm
    >>> draws = ssm.Draws(
    ...     friction=np.ones((3, 6)),
    ...     tip_error=np.array([1e-5, 2e-5, 4e-4]),
    ...     peak_torque=np.ones((3, 4)),
    ...     following_error=np.ones((3, 4)),
    ...     saturated=np.zeros((3, 4), dtype=bool),
    ...     tripped=np.zeros((3, 4), dtype=bool),
    ...     tip_limit=1e-4,
    ... )
    >>> draws.to_dict()["passed"]
    2
    """

    friction: Array
    """Friction parameters (n, 28) in the layout of `ArmPlant.friction`."""
    tip_error: Array
    """Largest tip errors (n,), m."""
    peak_torque: Array
    """Largest motor torques (n, 4), N·m. 0 for joints without a drive."""
    following_error: Array
    """Largest following errors (n, 4), rad at the motor."""
    saturated: Mask
    """Mask (n, 4) of motors that demanded too much current."""
    tripped: Mask
    """Mask (n, 4) of drives whose following error left its window."""
    tip_limit: float
    """Largest permitted tip error, m."""

    @property
    def passed(self) -> Mask:
        """Mask (n,) of playbacks without saturated motor, tripped drive and excessive tip error."""
        failed = self.saturated.any(axis=1) | self.tripped.any(axis=1)
        return ~failed & (self.tip_error <= self.tip_limit)

    def to_dict(self) -> JsonObject:
        """Return the object `draws` in the output of `simulate --json`, in SI units.

        Tip errors and torques are given by their quantiles at 2.5, 50 and 97.5 %.
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
    """Draw random friction parameters for every joint.

    The parameters follow the posterior or the covariance of each drive file. Parameters with a
    range have a uniform distribution. Every call returns the same numbers.

    Parameters
    ----------
    robot
        Robot with its drives.
    count
        Number of draws.
    spread
        Relative range of parameters whose uncertainty the drive file omits.

    Returns
    -------
    frictions : (count, 28)
        Parameters in the layout of `ArmPlant.friction`.
    notes
        Remarks on drive files that omit the uncertainty.

    Raises
    ------
    ProblemError
        If the uncertainty of a drive is invalid.
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
        values: Keywords = uncertainty.values(deviations[np.arange(count) % len(deviations)])
        values |= {
            name: rng.uniform(low, high, count) for name, (low, high) in uncertainty.ranges.items()
        }
        values = {name: value for name, value in values.items() if name in _VARIED}
        friction = drive_with(joint.drive, values).friction
        for i, name in enumerate(FRICTION):
            table[:, k, i] = getattr(friction, name)
    return table.reshape(count, -1), tuple(notes)


_VARIED = (*FRICTION, "mu_lowest")
"""Names of the random parameters that affect the simulation."""


def play_draws(
    arm: ControlledArm,
    start: Array,
    commands: Commands,
    *,
    offsets: Array,
    friction: Array,
    planned: Array,
    tip_limit: float,
    progress: Progress = silent,
) -> Draws:
    """Play the same commands from the same state with many sets of friction parameters.

    Parameters
    ----------
    arm
        The simulated arm.
    start
        Initial state, (44,).
    commands
        Commands of m periods.
    offsets
        Encoder offsets of `ControlledArm.offsets`, (4,), rad.
    friction
        Friction parameters, (n, 28).
    planned
        Planned joint positions, (m, 4), rad or m.
    tip_limit
        Permitted tip error, m.
    progress
        Called with each step.

    Returns
    -------
    Draws
        Result of each playback.
    """
    count = len(friction)
    full_step, half_steps = Vectorised(arm.control_step), Vectorised(arm.control_step_in_halves)
    needs_halves, table = arm.needs_half_steps(commands), commands.table()
    x = np.tile(start, (count, 1))
    width = table.shape[1]
    inputs = _inputs(width, offsets, friction)
    mechanism = Mechanism.from_robot(arm.robot)
    targets = tip_position(mechanism, planned[::TIP_INTERVAL])
    constants = [getattr(arm.electrics.get(k), "torque_constant", 0.0) for k in range(4)]
    tip, peak, error = np.zeros(count), np.zeros((count, 4)), np.zeros((count, 4))
    saturated = np.zeros((count, 4), dtype=bool)
    for m, row in enumerate(table):
        if m % PROGRESS_INTERVAL == 0:
            progress(Step(f"playing {count} frictions", m, len(table)))
        if m % TIP_INTERVAL == 0:
            departure = tip_position(mechanism, x[:, Q]) - targets[m // TIP_INTERVAL]
            tip = np.fmax(tip, np.linalg.norm(departure, axis=1))
        inputs[:, :width] = row
        step = half_steps if needs_halves[m] else full_step
        x, following, cut_current = step(np.asfortranarray(x), inputs)
        peak = np.fmax(peak, np.abs(x[:, CURRENT]))
        error = np.fmax(error, np.abs(following))
        saturated |= cut_current > 0
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


def _inputs(width: int, offsets: Array, friction: Array) -> Array:
    """Return the inputs (n, 57) of one period, whose first `width` columns are still to be set."""
    count = len(friction)
    columns = [np.empty((count, width)), np.tile(offsets, (count, 1)), friction]
    return np.asfortranarray(np.hstack(columns))
