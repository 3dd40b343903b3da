"""Bound the distance between the tip and its planned position, and the error of its direction.

The encoder measures the motor. Between motor and tip, the joints deviate from their planned
positions by errors δ that the robot file states. To first order, they displace the tip by Δp and
turn the tool by Δφ,

    (Δp, Δφ) = J(q) δ,

where J is the geometric Jacobian of the tip. Each joint has five errors:

* half an increment of the encoder, divided by the gear ratio,
* half of the backlash of the joint, and of each gear stage between motor and drive,
* the largest error of the zero position after homing,
* the largest tracking error,
* the deflection under load, effort / stiffness, which the dynamics determine.

The first four are independent and do not change during the motion. The joint touches one flank of
the backlash or the other. The other three are uniformly distributed within their limits. The bound
is a quantile, over many draws, of the largest error during the motion.
"""

from collections.abc import Iterator

import numpy as np

from ssm_planner.dynamics import RigidBody
from ssm_planner.kinematics import jacobian
from ssm_planner.problem import Joint, Robot, get_attributes
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, JsonObject, frozen

INSTANTS = 201
"""Number of instants of the motion at which the tip error is computed."""
ERROR_DRAWS = 4000
"""Number of draws of the errors."""
BOUND_QUANTILE = 0.995
"""Fraction of the draws below the bound. The bound holds with 99 %, since the draws are finite."""
NEEDED_FIGURES = ("backlash", "homing_error", "tracking_error", "stiffness")
"""Figures of a joint in the robot file that the tip error needs."""


@frozen
class ErrorSource:
    """One error of a joint, and the tip error that it causes alone.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.ErrorSource("roll", "backlash", error=1e-4, tip=2e-6).tip
    2e-06
    """

    joint: str
    name: str
    """encoder, backlash, homing error, tracking error or deflection."""
    error: float
    """Largest error of the joint, rad or m."""
    tip: float
    """Largest tip error that it causes, m."""


@frozen
class TipError:
    """Bound on the tip error of a motion.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> error = ssm.load_plan("results/tilt_insert").tip_error
    >>> error.bound is None, error.missing[0]
    (True, 'roll: backlash')
    """

    stated: float
    """Error of the tip that the stated figures cause, m. It is smaller with a probability of 99 %.
    """
    stated_angle: float
    """Error of the direction of the tool that the stated figures cause, rad.

    It is smaller with a probability of 99 %.
    """
    sources: tuple[ErrorSource, ...]
    """All stated errors, the largest first."""
    missing: tuple[str, ...]
    """Figures that the files do not state, such as "roll: backlash"."""

    @property
    def bound(self) -> float | None:
        """Bound on the tip error with a confidence of 99 %, m. None if figures are missing."""
        return None if self.missing else self.stated

    @property
    def angle(self) -> float | None:
        """Bound on the error of the direction, rad. None if figures are missing."""
        return None if self.missing else self.stated_angle

    @property
    def reason(self) -> str:
        """Sentence that names the missing figures and their joints. Empty without any."""
        joints: dict[str, list[str]] = {}
        for figure in self.missing:
            joint, name = figure.split(": ")
            joints.setdefault(name, []).append(joint)
        listing = "; ".join(f"{name} of {', '.join(names)}" for name, names in joints.items())
        return f"tip error not known, because the files do not state: {listing}" if listing else ""

    def to_dict(self) -> JsonObject:
        """Return the tip error as a dict, in SI units.

        plan.json contains this dict as its entry `tip_error`.
        """
        return {
            **get_attributes(self, ("bound", "angle", "stated", "stated_angle")),
            "sources": [vars(source) for source in self.sources],
            "missing": list(self.missing),
        }


def tip_error(trajectory: Trajectory, robot: Robot) -> TipError:
    """Compute the bound on the tip error of a motion.

    The errors of the joints are drawn at random and converted by the Jacobian of the tip, as the
    text at the top of this module describes.

    Parameters
    ----------
    trajectory : Trajectory
        The motion.
    robot : Robot
        Robot with the errors of its joints.

    Returns
    -------
    TipError
        Bound, contribution of each error, and figures that are missing.
    """
    times = np.linspace(trajectory.breaks[0], trajectory.breaks[-1], INSTANTS)
    samples = trajectory.sample(times)
    jacobians = jacobian(robot, samples.q)
    # Displacement of the tip per unit of each joint, (instants, 4).
    lengths = np.linalg.norm(jacobians[:, :3], axis=1)
    efforts = RigidBody.from_robot(robot).inverse_dynamics(samples.q, samples.qd, samples.qdd)
    sources = []
    deflections = np.zeros_like(samples.q)
    draws = np.zeros((4, ERROR_DRAWS))
    rng = np.random.default_rng(0)
    for i, joint in enumerate(robot.joints):
        for name, max_error in _random_errors(joint):
            sources.append(
                ErrorSource(joint.name, name, max_error, float(max_error * lengths[:, i].max()))
            )
            # The load presses the joint against one of both flanks.
            shares = rng.uniform(-1.0, 1.0, ERROR_DRAWS)
            draws[i] += max_error * (np.sign(shares) if name.endswith("backlash") else shares)
        if joint.stiffness is not None:
            deflections[:, i] = efforts[:, i] / joint.stiffness
            sizes = np.abs(deflections[:, i])
            tip = float((sizes * lengths[:, i]).max())
            sources.append(ErrorSource(joint.name, "deflection", float(sizes.max()), tip))
    return TipError(
        _error_quantile(jacobians[:, :3], deflections, draws),
        _error_quantile(jacobians[:, 3:], deflections, draws),
        tuple(sorted(sources, key=lambda source: -source.tip)),
        tuple(_missing_figures(robot)),
    )


def _error_quantile(rows: Array, deflections: Array, draws: Array) -> float:
    """Compute the quantile, over all draws, of the largest error during the motion.

    Parameters
    ----------
    rows : (instants, 3, 4) array
        Rows of the Jacobians for the position or for the direction.
    deflections : (instants, 4) array
        Deflections of the joints under load, rad, and m for joint 4.
    draws : (4, draws) array
        Sum of the random errors of each joint, rad, and m for joint 4.

    Returns
    -------
    float
        Quantile `BOUND_QUANTILE` of the norm of the error, m or rad.
    """
    max_errors = np.zeros(draws.shape[1])
    for row, deflection in zip(rows, deflections, strict=True):
        errors = row @ (draws + deflection[:, None])
        max_errors = np.maximum(max_errors, np.linalg.norm(errors, axis=0))
    return float(np.quantile(max_errors, BOUND_QUANTILE))


def _random_errors(joint: Joint) -> Iterator[tuple[str, float]]:
    """Yield the name and the largest value of each error of a joint that the robot file states.

    They are the first four errors in the text at the top of this module. The deflection under load
    is excluded, because the dynamics determine it.

    Parameters
    ----------
    joint : Joint
        Joint with its motor and drive.

    Yields
    ------
    name : str
        Such as "encoder", "backlash" or "homing error".
    largest : float
        Largest magnitude of the error, rad or m.
    """
    motor = joint.motor
    if motor is not None and joint.drive is not None and motor.encoder_known:
        assert motor.increments is not None
        increment = 2 * np.pi / motor.increments / joint.drive.ratio
        yield "encoder", increment / 2
    if joint.backlash is not None:
        yield "backlash", joint.backlash / 2
    for name, play in joint.plays().items():
        if play is not None:
            yield name, play / 2
    if joint.homing_error is not None:
        yield "homing error", joint.homing_error
    if joint.tracking_error is not None:
        yield "tracking error", joint.tracking_error


def _missing_figures(robot: Robot) -> Iterator[str]:
    """Yield the figures for the tip error that are missing or are placeholders.

    Parameters
    ----------
    robot : Robot
        Robot with its joints.

    Yields
    ------
    str
        Joint and figure, such as "roll: backlash". A motor without a known encoder gives "encoder".
    """
    for joint in robot.joints:
        for name in NEEDED_FIGURES:
            if getattr(joint, name) is None:
                yield f"{joint.name}: {name.replace('_', ' ')}"
        plays = joint.plays().items()
        yield from (f"{joint.name}: {name}" for name, play in plays if play is None)
        # The position of a joint without a drive is set by hand, without an encoder.
        if joint.drive is not None and not (joint.motor and joint.motor.encoder_known):
            yield f"{joint.name}: encoder"
