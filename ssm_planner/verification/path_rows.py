"""Limits of a robot along the path of a motion, as rows a s̈ + b ṡ² + c + k ṡ ≤ 1.

The modules `path_bound` and `second_opinion` use these rows, and the planner does not. The path
parameter s is the time of the motion. The derivatives q' and q'' with respect to s are therefore
the velocities and accelerations of the motion, and the motion itself has ṡ = 1. Another timing of
the path has q̇ = q' ṡ and q̈ = q' s̈ + q'' ṡ². A row is a limited quantity divided by its limit, so
it must be at most 1.
"""

import numpy as np

from ssm_planner.dynamics import RigidBody, motor_torque_rows, output_effort
from ssm_planner.kinematics import Mechanism, task_rates, tool_speed
from ssm_planner.problem import (
    TASK_COORDINATES,
    Drive,
    JointVelocity,
    Motor,
    MotorSpeed,
    Robot,
    TaskLimits,
    TaskRate,
)
from ssm_planner.trajectory import SHORTEST_PIECE, Trajectory, part_indices
from ssm_planner.typing import Array, Indices, Mask, record
from ssm_planner.verification.pieces import build_piece_block, rest_speeds

POINT_POSITIONS = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Positions of the points in an interval, from 0 at its start to 1 at its end."""
SIMPSON_WEIGHTS = np.array([[1.0, 0.0, 4.0, 0.0, 1.0], [0.5, 2.0, 1.0, 2.0, 0.5]]) / 6
"""Weights of Simpson's rule on an interval and on its halves."""
PATH_INTERVALS = 100
"""Approximate number of intervals of a smooth motion before refinement."""
SWITCH_REFINEMENT = 5.0
"""Factor by which intervals are shorter where an acceleration changes by its limit.

The error of a grid is largest at such changes. It is proportional to the change and to the squared
length of the interval, so the factor is proportional to the square root of the change.
"""
PIECES_PER_INTERVAL = 4
"""Largest average number of polynomial pieces in an interval before refinement.

The accelerations of a plan oscillate slightly, with a wavelength of about four pieces.
"""
SMOOTH_JUMP = 1e-4
"""Largest jump of an acceleration within an interval, as a share of its limit."""
MIN_SPEED_RATIO = 1e-9
"""Smallest result of `largest_speed_ratio`, which prevents a division by 0 where nothing moves."""
PROBE_STATES = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
"""Pairs (s̈, ṡ) at which the rows are evaluated.

The four values determine the coefficients a, b, c and k of a row (`row_coefficients`).
"""
LimitKey = tuple[str, str | None]
"""Name of a limit, and of its joint. The latter is None for limits of the tool and of the task."""


def row_coefficients(values: Array) -> tuple[Array, Array, Array, Array]:
    """Determine the coefficients of a row a s̈ + b ṡ² + c + k ṡ from its values.

    Parameters
    ----------
    values : (4, ...) array
        Values of the expression at the `PROBE_STATES`.

    Returns
    -------
    a, b, c, k : (...) arrays
        Coefficients in the shape of one value.
    """
    at_rest, pushed, forwards, backwards = values
    return (
        pushed - at_rest,
        (forwards + backwards) / 2 - at_rest,
        at_rest,
        (forwards - backwards) / 2,
    )


@record
class PathRows:
    """A path, sampled at m points in each of n intervals.

    Arrays list the first points of all intervals, then the second points, and so on. Velocity,
    acceleration and effort of the joints at the `PROBE_STATES` determine the rows.
    """

    robot: Robot
    lengths: Array
    """Lengths of the intervals, (n,), s."""
    moves: Mask
    """True at points of intervals in which a joint moves, (m n,)."""
    q: Array
    """Joint positions, (m n, 4), rad and m."""
    direction: Array
    """Direction of every joint, (m n, 4).

    It is 0 in an interval where the joint reverses or has the same position at both ends. Torque
    limits are left out there.
    """
    speed: Array
    acceleration: Array
    effort: Array
    """q̇, q̈ and joint efforts at the `PROBE_STATES`, (4, m n, 4) each."""

    @classmethod
    def from_trajectory(
        cls,
        trajectory: Trajectory,
        robot: Robot,
        span: tuple[float, float],
        refinement: int = 2,
    ) -> "PathRows":
        """Sample the path of a motion between two times.

        Parameters
        ----------
        trajectory : Trajectory
            The motion. Only its path counts, and not its timing.
        robot : Robot
            The robot with its limits.
        span : (float, float)
            Start and end of the path as times of the trajectory, s. Both are breaks.
        refinement : int
            Factor on the number of intervals, which is at least `PATH_INTERVALS` for a factor of 1.

        Returns
        -------
        PathRows
            The path at five points in each of n intervals.
        """
        first, last = np.searchsorted(trajectory.breaks, np.array(span) - SHORTEST_PIECE / 2)
        sections, moves, change = _smooth_sections(trajectory, robot, slice(first, last))
        knots = trajectory.breaks[np.append(sections, last)]
        lengths = np.diff(knots)
        density = PATH_INTERVALS * np.maximum(1.0, SWITCH_REFINEMENT * np.sqrt(change))
        density = np.maximum(density, (last - first) / PIECES_PER_INTERVAL)
        counts = refinement * np.ceil(density * lengths / lengths.sum()).astype(int)
        index, k = part_indices(counts)
        width = (lengths / counts)[index]
        starts = knots[index] + k * width
        positions = np.array(POINT_POSITIONS)
        times = (starts + np.multiply.outer(positions, width)).ravel()
        # At a break, the values are those of the piece within the interval, so the pieces are
        # searched slightly inside.
        inward = np.multiply.outer(0.5 - positions, 1e-6 * width).ravel()
        piece = trajectory.piece_of(times + inward)
        samples = trajectory.sample_pieces(piece, times - trajectory.breaks[piece])
        q = samples.q.reshape(len(positions), -1, 4)
        travel = q[-1] - q[0]
        direction = np.sign(travel) * (np.abs(travel) > rest_speeds(robot) * width[:, None])
        # A velocity against the direction shows that the joint reverses within the interval.
        direction[(direction * samples.qd.reshape(q.shape) < 0).any(axis=0)] = 0.0
        body = RigidBody.from_robot(robot)
        pushed, driven, load = body.path_load(samples.q, samples.qd, samples.qdd)
        u, rate = np.array(PROBE_STATES).T[..., None, None]
        return cls(
            robot,
            width,
            np.tile(moves[index], len(positions)),
            samples.q,
            direction=np.tile(direction, (len(positions), 1)),
            speed=rate * samples.qd,
            acceleration=u * samples.qd + rate**2 * samples.qdd,
            effort=u * pushed + rate**2 * driven + load,
        )

    @property
    def grid(self) -> Array:
        """Values of the path parameter at the ends of the n intervals, (n + 1,), s."""
        return np.append(0.0, np.cumsum(self.lengths))

    def acceleration_rows(self) -> list[Array]:
        """Compute the rows of the acceleration limits.

        Returns
        -------
        list of eight (4, m n) arrays
            Values at the `PROBE_STATES`. Each joint has two rows, one for either direction.
        """
        rows = []
        for joint, values in zip(self.robot.joints, self.acceleration.T, strict=True):
            rows += [values.T / joint.acceleration, -values.T / joint.acceleration]
        return rows

    def torque_rows(self, i: int, drive: Drive, motor: Motor, mu: Array) -> list[Array]:
        """Compute the two rows of the torque limit of one motor.

        The friction law is the larger of two linear functions of the joint effort. Each function
        gives one row. The motor torque in the direction of motion, as a share of its limit, is the
        larger of both rows.

        Parameters
        ----------
        i : int
            Index of the joint.
        drive : Drive
            Drive of the joint, with its friction.
        motor : Motor
            Motor of the joint.
        mu : (m n,) array
            Friction coefficients.

        Returns
        -------
        list of two (4, m n) arrays
            Values of the rows at the `PROBE_STATES`.
        """
        speed, acceleration = self.speed[..., i], self.acceleration[..., i]
        direction = self.direction[:, i]
        law = motor_torque_rows(drive, direction, mu)
        effort = output_effort(drive, self.effort[..., i], speed, acceleration, direction)
        motion = drive.ratio * speed, drive.ratio * acceleration
        return [
            direction * law.torque(slope * effort, *motion) / motor.max_torque
            for slope in law.slope
        ]

    def largest_speed_ratio(self, limits: TaskLimits) -> Array:
        """Compute the largest share of any speed limit that the motion itself uses.

        The motion has ṡ = 1. Another timing keeps all speed limits if its ṡ is at most the inverse
        of this share.

        Parameters
        ----------
        limits : TaskLimits
            Limits on task rates and on the speed of the tool.

        Returns
        -------
        (m n,) array
            The shares, which are at least `MIN_SPEED_RATIO`.
        """
        return np.maximum(MIN_SPEED_RATIO, np.max(list(self.speed_ratios(limits).values()), axis=0))

    def speed_ratios(self, limits: TaskLimits) -> dict[LimitKey, Array]:
        """Compute the share of every speed limit that the motion itself uses.

        The limits are those of joints, motors, tool and task. The motion has ṡ = 1, and the shares
        of another timing are ṡ times as large.

        Parameters
        ----------
        limits : TaskLimits
            Limits on task rates and on the speed of the tool.

        Returns
        -------
        dict of (m n,) arrays
            Shares by the name of the limit and the name of its joint or None.
        """
        # The third probe state has ṡ = 1.
        mechanism, qd = Mechanism.from_robot(self.robot), self.speed[2]
        ratios: dict[LimitKey, Array] = {}
        for joint, speed in zip(self.robot.joints, np.abs(qd.T), strict=True):
            ratios[JointVelocity.name, joint.name] = speed / joint.velocity
            if joint.drive is not None and joint.motor is not None:
                motor_speed = speed * joint.drive.ratio
                ratios[MotorSpeed.name, joint.name] = motor_speed / joint.motor.max_speed
        for bound in limits.speeds:
            speed = tool_speed(type(bound), mechanism, self.q, qd)
            ratios[bound.name, None] = speed / bound.largest
        rates = np.abs(task_rates(mechanism, self.q, qd)) if limits.rates else qd
        for name, rate in limits.rates.items():
            ratios[TaskRate.name_of(name), None] = rates[:, TASK_COORDINATES.index(name)] / rate
        return ratios


def _smooth_sections(
    trajectory: Trajectory, robot: Robot, pieces: slice
) -> tuple[Indices, Mask, Array]:
    """Divide a motion into sections of consecutive pieces between which the motion is smooth.

    A section ends where an acceleration jumps, where a joint starts, stops or reverses, or after
    about 1/`PATH_INTERVALS` of the pieces. Intervals for the rows may cross the breaks within a
    section.

    Parameters
    ----------
    trajectory : Trajectory
        The motion.
    robot : Robot
        The robot with its limits.
    pieces : slice
        Indices of the polynomial pieces of the motion.

    Returns
    -------
    first_pieces : (m,) array
        Index of the first piece of every section.
    moves : (m,) array of bool
        True if a joint moves in the section.
    changes : (m,) array
        Largest change of an acceleration from the piece before the section to the piece after it,
        as a share of its limit.
    """
    times = trajectory.breaks[pieces.start : pieces.stop + 1]
    block = build_piece_block(times[:-1], np.diff(times), trajectory.pieces(pieces))
    starts, ends = block.end_states
    moves = block.moving_joints(robot)
    directions = np.sign(ends[:, 0] - starts[:, 0]) * moves
    turns = np.diff(np.hstack([directions, moves]), axis=0)
    jumps = np.abs(starts[1:, 2] - ends[:-1, 2]) > SMOOTH_JUMP * robot.accelerations
    # The pieces are short where the motion changes quickly, so a limit on their number in a section
    # gives more sections there.
    group = np.arange(len(moves)) // max(1, len(moves) // PATH_INTERVALS)
    is_last = np.column_stack([turns, jumps, np.diff(group)]).any(axis=1)
    first_pieces = np.append(0, np.flatnonzero(is_last) + 1)
    # Accelerations before every section and after it.
    before = np.vstack([starts[:1, 2], ends[:-1, 2]])[first_pieces]
    after = np.vstack([starts[first_pieces[1:], 2], ends[-1:, 2]])
    changes = np.abs(after - before) / robot.accelerations
    return pieces.start + first_pieces, moves[first_pieces].any(axis=1), changes.max(axis=1)
