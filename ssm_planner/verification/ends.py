"""Jumps at the breaks of a motion, and its velocities at both ends.

A break is an instant at which one polynomial piece ends and the next one begins. No controller can
follow a jump there. A motion must also start and end at rest unless the task declares velocities at
its ends. `check` calls `JumpRecorder` and `check_end_velocities` for every motion.
"""

from functools import lru_cache

import numpy as np

from ssm_planner.kinematics import Mechanism, joint_rates
from ssm_planner.problem import TASK_COORDINATES, EndVelocity, Jump, Robot, TaskLimits
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import LimitCheck
from ssm_planner.verification.limits import JUMP_DRIFT_RATE, JUMP_TOLERANCE
from ssm_planner.verification.pieces import PieceBlock, jerk_limits

# Limits with the same values occur in every check of a robot, so they are built once.
_cached_jump_limit = lru_cache(maxsize=256)(Jump)
_cached_end_velocity_limit = lru_cache(maxsize=256)(EndVelocity)


class JumpRecorder:
    """Records the worst jumps of position, velocity and acceleration of the four joints.

    A jump is the difference between the start of a piece and the end of the previous piece.

    Attributes
    ----------
    worst : (3, 4) array
        Largest jumps of position, velocity and acceleration (rows) of the joints.
    time : (3, 4) array
        Times of these jumps, s.
    """

    def __init__(self, robot: Robot) -> None:
        """Start a record without jumps.

        Parameters
        ----------
        robot : Robot
            Robot whose joint limits determine the tolerances of the jumps.
        """
        self.robot = robot
        self.worst = np.zeros((3, 4))
        self.time = np.zeros((3, 4))
        self._previous_end: Array | None = None
        velocity = robot.velocities
        acceleration = robot.accelerations
        # Without a jerk limit, jumps of the acceleration may add up to any value. The large number
        # replaces infinity, which would give NaN if it is multiplied by a time of 0.
        jerk = np.minimum(jerk_limits(robot), 1e100)
        self._tolerance = JUMP_TOLERANCE * np.array([np.ones(4), velocity, acceleration])
        self._tolerated_drift = JUMP_DRIFT_RATE * np.array([velocity, acceleration, jerk])
        self._previous_sum = np.zeros((3, 4))
        self._previous_time = 0.0

    def update(self, pieces: PieceBlock) -> None:
        """Update the worst jumps with the next pieces of the motion.

        Parameters
        ----------
        pieces : PieceBlock
            The polynomial pieces that follow those of the previous call.
        """
        starts, ends = pieces.end_states
        # The motion cannot jump before its first piece, which is compared with its own start.
        previous_end = starts[0] if self._previous_end is None else self._previous_end
        self._previous_end = ends[-1]
        jump = np.abs(starts - np.concatenate([previous_end[None], ends[:-1]]))
        level = self._accumulated_jumps(jump, pieces.start)
        # If a single jump exceeds its tolerance, the result is this jump and not the sum.
        added_up = (level > self._tolerance) & (jump <= self._tolerance)
        jump = np.where(added_up, level, jump)
        magnitude = jump.max(axis=0)
        k = jump.argmax(axis=0)
        self.time = np.where(magnitude > self.worst, pieces.start[k], self.time)
        self.worst = np.maximum(magnitude, self.worst)

    def _accumulated_jumps(self, jump: Array, time: Array) -> Array:
        """Return the largest sum of jumps that ends at each jump, reduced by the tolerated drift.

        Many small jumps, each within its tolerance, can add up to a large one. Their sum is
        therefore limited as well. For every interval of time, it must satisfy

            Σ jumps ≤ tolerance + JUMP_DRIFT_RATE · (limit of the next derivative) · time.

        The last term is the tolerated drift.

        Parameters
        ----------
        jump : (m, 3, 4) array
            Jumps of position, velocity and acceleration at the starts of m pieces.
        time : (m,) array
            Their times, s.

        Returns
        -------
        (m, 3, 4) array
            The largest left-hand side minus the tolerated drift, over all intervals of time that
            end at this jump.
        """
        rise = (
            np.cumsum(jump, axis=0)
            - self._tolerated_drift * (time - self._previous_time)[:, None, None]
        )
        # `rise` is the sum of all jumps so far minus the drift tolerated so far. The sum over an
        # interval that begins with jump i is the rise at its end minus the rise just before i. It
        # is largest for the smallest rise before.
        lowest = np.minimum.accumulate(np.concatenate([-self._previous_sum[None], rise - jump]))[1:]
        level = rise - lowest
        self._previous_sum = level[-1]
        self._previous_time = float(time[-1])
        return level

    def results(self, is_table: bool = False) -> list[LimitCheck]:
        """Return the results for the largest jumps of each joint.

        Jumps of the acceleration count only if the jerk of the joint is limited.

        Parameters
        ----------
        is_table : bool
            True if the motion consists of linear pieces between points. The velocity of such a
            motion jumps at every point, so only jumps of the position count.

        Returns
        -------
        list of LimitCheck
            One result for each joint and each derivative that counts.
        """
        checks = []
        for i, joint in enumerate(self.robot.joints):
            # Tolerances of position, velocity and acceleration, as multiples of JUMP_TOLERANCE.
            scales = [1.0]
            if not is_table:
                scales.append(joint.velocity)
                if joint.jerk is not None:
                    scales.append(joint.acceleration)
            for derivative, scale in enumerate(scales):
                limit = _cached_jump_limit(
                    joint.name, JUMP_TOLERANCE * scale, joint.slides, derivative=derivative
                )
                jump = float(self.worst[derivative, i])
                time = float(self.time[derivative, i])
                checks.append(LimitCheck.from_extreme(limit, jump, time))
        return checks


def end_velocities(trajectory: Trajectory) -> tuple[Array, Array]:
    """Return the joint velocities at the start and at the end of a trajectory.

    Parameters
    ----------
    trajectory : Trajectory
        The motion.

    Returns
    -------
    start, end : (4,) arrays
        Joint velocities, rad/s, and m/s for joint 4.
    """
    first_piece, last_piece = trajectory.pieces(np.array([0, len(trajectory.breaks) - 2]))
    length = trajectory.breaks[-1] - trajectory.breaks[-2]
    orders = np.arange(1, len(last_piece))
    # The derivative of Σ a_k t^k at t = length is Σ k length^(k − 1) a_k.
    end_velocity = (orders * length ** (orders - 1)) @ last_piece[1:]
    return first_piece[1], end_velocity


def declared_end_velocities(
    trajectory: Trajectory, robot: Robot, limits: TaskLimits
) -> tuple[Array, Array]:
    """Return the joint velocities that a task declares at the start and at the end of a motion.

    An empty mapping of rates declares rest. None accepts any velocity, so the result is then the
    velocity of the trajectory itself.

    Parameters
    ----------
    trajectory : Trajectory
        The motion.
    robot : Robot
        Robot whose kinematics convert the declared rates of task coordinates into joint velocities.
    limits : TaskLimits
        The declared rates of task coordinates, `start_rate` and `end_rate`.

    Returns
    -------
    start, end : (4,) arrays
        Joint velocities, rad/s, and m/s for joint 4.
    """
    velocities = list(end_velocities(trajectory))
    positions = trajectory.positions(trajectory.breaks[[0, -1]])
    for k, rate in enumerate((limits.start_rate, limits.end_rate)):
        if rate is not None:
            task_rate = np.array([rate.get(name, 0.0) for name in TASK_COORDINATES])
            mechanism = Mechanism.from_robot(robot)
            velocities[k] = joint_rates(mechanism, positions[k], task_rate)
    return velocities[0], velocities[1]


def check_end_velocities(
    trajectory: Trajectory, robot: Robot, limits: TaskLimits, is_table: bool
) -> list[LimitCheck]:
    """Check that each joint has the declared velocity at both ends.

    Parameters
    ----------
    trajectory : Trajectory
        Motion that is checked.
    robot : Robot
        Robot whose limits must hold.
    limits : TaskLimits
        The declared rates at both ends, see `declared_end_velocities`.
    is_table : bool
        True if the motion may consist of linear pieces between points. An end with a linear piece
        is skipped, because such a piece does not determine the velocity of the robot.

    Returns
    -------
    list of LimitCheck
        One result for each joint and end. Its worst value is the deviation from the declared
        velocity, which may be at most `JUMP_TOLERANCE` times the velocity limit of the joint.
    """
    checks = []
    declared = declared_end_velocities(trajectory, robot, limits)
    outer = trajectory.pieces(np.array([0, len(trajectory.breaks) - 2]))
    is_curved = [bool(coefficients[2:].any()) for coefficients in outer]
    for end, (velocity, declared_velocity) in enumerate(
        zip(end_velocities(trajectory), declared, strict=True)
    ):
        if is_table and not is_curved[end]:
            continue
        for i, joint in enumerate(robot.joints):
            limit = _cached_end_velocity_limit(
                joint.name, JUMP_TOLERANCE * joint.velocity, joint.slides, at_end=bool(end)
            )
            deviation = abs(float(velocity[i] - declared_velocity[i]))
            time = float(trajectory.breaks[-1 if end else 0])
            checks.append(LimitCheck.from_extreme(limit, deviation, time))
    return checks
