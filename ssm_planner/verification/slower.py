"""Checks of a motion that is played at a fraction of its speed.

At a fraction k of the speed, velocity, acceleration and jerk are k, k² and k³ times as large, and
positions do not change. If the motion keeps the limits of these quantities, the slower motion keeps
them as well. A motor torque may become larger. Friction may grow towards low speed (Stribeck
effect), and the inertia of the arm carries less of the load.
"""

from itertools import product

import numpy as np

from ssm_planner.dynamics import RigidBody, motion_directions, motor_motion, motorised_joints
from ssm_planner.errors import ProblemError
from ssm_planner.problem import ContinuousTorque, MotorTorque, Robot, TaskLimits
from ssm_planner.trajectory import Samples, Trajectory
from ssm_planner.typing import Array, JsonObject, frozen, record
from ssm_planner.verification.certificate import Certificate, LimitCheck
from ssm_planner.verification.check import SAMPLING_RATE, check

DEFAULT_SLOWEST_SPEED = 0.01
"""Default of the lowest speed in a check of all speeds, as a fraction of full speed."""
GRID_SPEEDS = 48
"""Number of speeds, in geometric progression, at which the search for the worst speed starts."""
TORQUE_INSTANTS = 1500
"""Number of instants at which the torque is evaluated for every speed.

Both sides of every break are added.
"""
SPEED_REFINEMENTS = 3
"""Number of refinements of the grid of speeds around the worst speed.

Each step of the refined grid is a sixth of a step of the previous one.
"""
SPEED_DEPENDENT_LIMITS = (MotorTorque.name, ContinuousTorque.name)
"""Names of the limits that a slower motion may violate although the motion keeps them."""


@frozen
class WorstSpeed:
    """The speed at which a limit has its smallest margin, and the result of the check there.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> worst = ssm.check_speeds("results/tilt_insert", slowest=0.5).worst[0]
    >>> worst.speed, worst.found.name
    (1.0, 'motor torque')
    """

    speed: float
    """Fraction of the speed of the motion."""
    found: LimitCheck
    """Result of the check of the limit at this speed."""


@record
class SpeedRange:
    """The result of checking all speeds from `slowest` to 1.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.check_speeds("results/tilt_insert", slowest=0.5).slowest
    0.5
    """

    slowest: float
    """Lowest fraction of the speed."""
    worst: tuple[WorstSpeed, ...]
    """Worst speed for motor torque and continuous torque of every joint with a motor."""
    certificates: tuple[tuple[float, Certificate], ...]
    """Pairs of a speed and its certificate.

    They include the worst speed of every limit, the slowest speed and the full speed.
    """

    @property
    def passed(self) -> bool:
        """True if every limit holds at every speed."""
        return all(certificate.passed for _, certificate in self.certificates)

    def to_dict(self) -> JsonObject:
        """Return the slowest speed, the verdict and the worst speeds as a dict, in SI units.

        The output of `check --json` contains this dict as its entry `speeds`.
        """
        checks = [{"speed": item.speed, **item.found.to_dict()} for item in self.worst]
        return {"slowest": self.slowest, "passed": self.passed, "worst": checks}


def check_slower(
    motion: Trajectory,
    robot: Robot,
    limits: TaskLimits,
    speed: float,
    interpolation: str = "quintic polynomial pieces",
) -> Certificate:
    """Check a motion that is played at a fraction of its speed.

    Parameters
    ----------
    motion : Trajectory
        Motion that is checked.
    robot : Robot
        Robot whose limits must hold.
    limits : TaskLimits
        Limits of the motion at full speed.
    speed : float
        Fraction of the speed, above 0 and at most 1.
    interpolation : str
        Description of the pieces for the certificate.

    Returns
    -------
    Certificate
        The result for the slower motion. Its times count in this motion.

    Raises
    ------
    ProblemError
        If the speed is out of range.
    """
    if not 0 < speed <= 1:
        raise ProblemError(
            "invalid speed", key="speed", value=speed, allowed="above 0 and up to 1 (100 %)"
        )
    slow = motion.slower(speed)
    return check(
        slow,
        robot,
        limits.slower(1 / speed),
        rate=SAMPLING_RATE * speed,
        interpolation=interpolation,
    )


def check_speeds(
    motion: Trajectory, robot: Robot, limits: TaskLimits, slowest: float = DEFAULT_SLOWEST_SPEED
) -> SpeedRange:
    """Check a motion at the speeds at which its motors need most torque, up to full speed.

    Each motor has two worst speeds, one with the largest peak torque and one with the largest RMS
    torque. The motion is checked at these speeds, at the slowest speed and at full speed.

    Parameters
    ----------
    motion : Trajectory
        Motion that is checked.
    robot : Robot
        Robot whose limits must hold.
    limits : TaskLimits
        Limits of the motion at full speed.
    slowest : float
        Lowest fraction of the speed, above 0 and below 1.

    Returns
    -------
    SpeedRange
        The worst speeds and the certificates at these speeds.

    Raises
    ------
    ProblemError
        If `slowest` is out of range.
    """
    if not 0 < slowest < 1:
        raise ProblemError(
            "invalid speed", key="speed", value=slowest, allowed="above 0 and below 1 (100 %)"
        )
    driven = [i for i, *_ in motorised_joints(robot.joints)]
    columns = list(product(range(len(SPEED_DEPENDENT_LIMITS)), driven))
    factors = np.geomspace(slowest, 1.0, GRID_SPEEDS)
    pause = limits.duty or 0.0
    torques = _peak_and_rms_torques(motion, robot, factors, pause)
    speeds = [
        _worst_speed(motion, robot, factors, torques[row][:, i], (row, i), pause=pause)
        for row, i in columns
    ]
    tested = sorted({slowest, 1.0}.union(speeds))
    certificates = {speed: check_slower(motion, robot, limits, speed) for speed in tested}
    worst_speeds = []
    for (row, i), speed in zip(columns, speeds, strict=True):
        key = (SPEED_DEPENDENT_LIMITS[row], robot.joints[i].name)
        worst_speeds += [
            WorstSpeed(speed, check)
            for check in certificates[speed].limits
            if (check.name, check.joint) == key
        ]
    return SpeedRange(slowest, tuple(worst_speeds), tuple(certificates.items()))


def _worst_speed(
    motion: Trajectory,
    robot: Robot,
    factors: Array,
    values: Array,
    column: tuple[int, int],
    pause: float,
) -> float:
    """Find the speed at which a motor has its largest peak torque or its largest RMS torque.

    The search starts on a grid of speeds and refines the grid around the speed with the largest
    torque.

    Parameters
    ----------
    motion : Trajectory
        Motion that is checked.
    robot : Robot
        Robot whose limits must hold.
    factors : (m,) array
        Speeds of the grid, as fractions of the speed of the motion.
    values : (m,) array
        Torques of the motor at these speeds, N·m.
    column : (int, int)
        0 for the peak torque or 1 for the RMS torque, and index of the joint.
    pause : float
        Time before the motion repeats, s.

    Returns
    -------
    float
        The speed, as a fraction of the speed of the motion.
    """
    row, joint = column
    for _ in range(SPEED_REFINEMENTS):
        worst = int(np.argmax(values))
        low = factors[max(worst - 1, 0)]
        high = factors[min(worst + 1, len(factors) - 1)]
        factors = np.geomspace(low, high, 13)  # six steps on either side of the worst speed
        values = _peak_and_rms_torques(motion, robot, factors, pause)[row][:, joint]
    return float(np.clip(factors[int(np.argmax(values))], 0.0, 1.0))


def _peak_and_rms_torques(
    motion: Trajectory, robot: Robot, factors: Array, pause: float
) -> tuple[Array, Array]:
    """Compute the peak and the RMS of the motor torques if a motion is played more slowly.

    Parameters
    ----------
    motion : Trajectory
        Motion that is checked.
    robot : Robot
        Robot whose limits must hold.
    factors : (m,) array
        Speeds as fractions of the speed of the motion.
    pause : float
        Time before the motion repeats, s. It counts as time without torque.

    Returns
    -------
    peak, rms : (m, 4) arrays
        Torques of the four motors at each speed, N·m. They are 0 for a joint without a drive.
    """
    # The samples on both sides of every break contribute only to the peak. 1 and −1 mean the values
    # just after and just before an instant.
    evenly_spaced = motion.sample(
        np.linspace(motion.breaks[0], motion.breaks[-1], TORQUE_INSTANTS + 1)
    )
    samples_by_side = [
        (evenly_spaced, 1),
        (motion.sample(motion.breaks[:-1]), 1),
        (motion.sample(motion.breaks[1:], "left"), -1),
    ]
    body = RigidBody.from_robot(robot)
    peak = np.zeros((len(factors), 4))
    rms = np.zeros((len(factors), 4))
    speed = factors[:, None, None]
    for samples, side in samples_by_side:
        slow = Samples(
            np.tile(samples.t, len(factors)),
            np.tile(samples.q, (len(factors), 1)),
            (speed * samples.qd).reshape(-1, 4),
            (speed**2 * samples.qdd).reshape(-1, 4),
            (speed**3 * samples.qddd).reshape(-1, 4),
        )
        sign, away = motion_directions(robot, slow, side)
        torque = motor_motion(robot, body, slow, sign, away).torque.reshape(len(factors), -1, 4)
        torque = np.nan_to_num(torque)  # joints without a drive
        peak = np.maximum(peak, np.abs(torque).max(axis=1))
        if samples is evenly_spaced:
            rms = np.sqrt(np.mean(torque**2, axis=1))
    # The motion takes duration/factor, so the torque acts for this share of the whole time.
    return peak, rms * np.sqrt(motion.duration / (motion.duration + factors * pause))[:, None]
