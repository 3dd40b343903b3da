"""Simulate the same motion many times at once, each time with other friction drawn at random.

One drawn set of friction parameters of all drives is called a draw. Its distribution comes from the
drive files. `simulate` calls `draw_frictions` and `play_draws` if the scenario requests draws.
"""

import numpy as np

from ssm_planner.codegen import VectorisedFunction
from ssm_planner.dynamics import drive_with_values, friction_spread
from ssm_planner.kinematics import Mechanism, tip_position
from ssm_planner.problem import Robot
from ssm_planner.progress import Progress, Step, silent
from ssm_planner.simulation.plant import FRICTION_PARAMETERS, Q, W
from ssm_planner.simulation.playback import CURRENT, TRIP, Commands, ControlledArm
from ssm_planner.typing import Array, JsonObject, Keywords, Mask, record

RANDOM_SEED = 20_261_122
"""Seed of the random numbers. With a fixed seed, equal calls give equal results."""
TIP_INTERVAL = 5
"""Number of periods between two evaluations of the tip position."""
PROGRESS_INTERVAL = 1000
"""Number of periods between two progress reports."""


@record
class Draws:
    """Results of n simulations of the same motion (playbacks) with random friction, in SI units.

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
    """Friction parameters (n, 28): seven for each of the four joints, one row for each playback.

    `ArmPlant.friction_parameters` states their order.
    """
    tip_error: Array
    """Largest tip errors (n,), m."""
    peak_torque: Array
    """Largest motor torques (n, 4), N·m. 0 for joints without a drive."""
    following_error: Array
    """Largest following errors (demanded minus measured motor angle), (n, 4), rad."""
    saturated: Mask
    """True for each motor that demanded more current than it can receive, (n, 4)."""
    tripped: Mask
    """True for each drive whose following error exceeded its limit, (n, 4)."""
    tip_limit: float
    """Largest permitted tip error, m."""

    @property
    def passed(self) -> Mask:
        """Mask (n,) of the playbacks without saturated motor, tripped drive or large tip error."""
        failed = self.saturated.any(axis=1) | self.tripped.any(axis=1)
        return ~failed & (self.tip_error <= self.tip_limit)

    def to_dict(self) -> JsonObject:
        """Return the results as a dict, in SI units.

        The output of `simulate --json` contains this dict as its entry `draws`. Tip errors and
        torques are given by their quantiles at 2.5, 50 and 97.5 %.
        """

        def quantiles(values: Array) -> list[float]:
            """Compute the quantiles at 2.5, 50 and 97.5 % of the values (n,)."""
            return np.quantile(values, [0.025, 0.5, 0.975]).tolist()

        return {
            "count": len(self.tip_error),
            "passed": int(self.passed.sum()),
            "tip_error": quantiles(self.tip_error),
            "peak_torque": [quantiles(column) for column in self.peak_torque.T],
            "saturated": int(self.saturated.any(axis=1).sum()),
            "tripped": int(self.tripped.any(axis=1).sum()),
        }


def draw_frictions(
    robot: Robot, count: int, spread: float | None = None
) -> tuple[Array, tuple[str, ...]]:
    """Draw random friction parameters for every joint.

    The parameters follow the distribution that the drive file states: the samples of a posterior
    or a covariance. Parameters with a range have a uniform distribution. The seed is fixed, so
    every call returns the same numbers.

    Parameters
    ----------
    robot : Robot
        Robot with its drives.
    count : int
        Number of draws.
    spread : float, optional
        Relative range of parameters whose uncertainty the drive file omits. None keeps these
        parameters constant.

    Returns
    -------
    frictions : (count, 28) array
        Friction parameters, one row for each draw: the seven parameters `FRICTION_PARAMETERS` of
        joint 1, then those of joint 2, and so on. Joints without a drive have zeros.
    notes : tuple of str
        Remarks on drive files that omit the uncertainty.

    Raises
    ------
    ProblemError
        If the uncertainty of a drive is invalid.
    """
    rng = np.random.default_rng(RANDOM_SEED)
    table = np.zeros((count, 4, len(FRICTION_PARAMETERS)))
    notes = []
    for k, joint in enumerate(robot.joints):
        if joint.drive is None:
            continue
        uncertainty = friction_spread(joint.drive, spread)
        if not uncertainty.is_stated:
            notes.append(
                f"joint {joint.name}: its drive file does not state the uncertainty of its "
                "friction, which is used as stated"
            )
        deviations = uncertainty.deviations(count)
        repeated = deviations[np.arange(count) % len(deviations)]
        values: Keywords = uncertainty.values(repeated)
        for name, (low, high) in uncertainty.ranges.items():
            values[name] = rng.uniform(low, high, count)
        simulated = {name: value for name, value in values.items() if name in _SIMULATED_PARAMETERS}
        friction = drive_with_values(joint.drive, simulated).friction
        for i, name in enumerate(FRICTION_PARAMETERS):
            table[:, k, i] = getattr(friction, name)
    return table.reshape(count, -1), tuple(notes)


_SIMULATED_PARAMETERS = FRICTION_PARAMETERS + ("mu_lowest",)
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
    """Simulate the arm for the same commands and initial state with n sets of friction parameters.

    All playbacks advance together, one period of the position loop at a time.

    Parameters
    ----------
    arm : ControlledArm
        The simulated arm.
    start : (44,) array
        Initial state of the arm and its controllers, from `ControlledArm.initial_state`.
    commands : Commands
        Commands in m periods of the position loop.
    offsets : (4,) array
        Motor angles at which the encoders measure 0, see `ControlledArm.encoder_offsets`, rad.
    friction : (n, 28) array
        Friction parameters, one row for each playback, from `draw_frictions`.
    planned : (m, 4) array
        Planned joint positions, rad, and m for joint 4.
    tip_limit : float
        Largest permitted tip error, m.
    progress : callable
        Called with each step.

    Returns
    -------
    Draws
        Results of the n playbacks. A playback that diverges has an infinite tip error.
    """
    count = len(friction)
    full_step = VectorisedFunction(arm.control_step)
    half_steps = VectorisedFunction(arm.control_step_in_halves)
    needs_halves = arm.half_step_periods(commands)
    table = commands.table()
    states = np.tile(start, (count, 1))
    width = table.shape[1]
    # The inputs of a period are its commands, the encoder offsets and the friction. The loop below
    # writes the commands of each period into the first columns.
    columns = [np.empty((count, width)), np.tile(offsets, (count, 1)), friction]
    inputs = np.asfortranarray(np.hstack(columns))
    mechanism = Mechanism.from_robot(arm.robot)
    targets = tip_position(mechanism, planned[::TIP_INTERVAL])
    tip_error = np.zeros(count)
    peak_current = np.zeros((count, 4))
    following_error = np.zeros((count, 4))
    saturated = np.zeros((count, 4), dtype=bool)
    for period, row in enumerate(table):
        if period % PROGRESS_INTERVAL == 0:
            progress(Step(f"playing {count} frictions", period, len(table)))
        if period % TIP_INTERVAL == 0:
            tip_deviation = tip_position(mechanism, states[:, Q]) - targets[period // TIP_INTERVAL]
            tip_error = np.fmax(tip_error, np.linalg.norm(tip_deviation, axis=1))
        inputs[:, :width] = row
        step = half_steps if needs_halves[period] else full_step
        states, following, cut_current = step(np.asfortranarray(states), inputs)
        peak_current = np.fmax(peak_current, np.abs(states[:, CURRENT]))
        following_error = np.fmax(following_error, np.abs(following))
        saturated |= cut_current > 0
    has_diverged = ~np.all(np.isfinite(states[:, W]), axis=1)
    tip_error[has_diverged] = np.inf
    return Draws(
        friction,
        tip_error,
        peak_torque=peak_current * arm.torque_constants,
        following_error=following_error,
        saturated=saturated,
        tripped=states[:, TRIP] > 0,
        tip_limit=tip_limit,
    )
