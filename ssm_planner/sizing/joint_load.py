"""Compute the load of each joint's drive over a motion: speed, acceleration and effort.

The main entry, `joint_loads`, samples a motion and evaluates the rigid-body dynamics. Its result,
`JointLoad`, gives the exact motor torque at every instant. All other modules of this package start
from it.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.polynomial.polynomial import polyval

from ssm_planner.deprecation import Renamed
from ssm_planner.dynamics import (
    REST_FRACTION,
    RigidBody,
    breakaway_coefficient,
    friction_coefficient,
    motion_directions,
    required_friction,
)
from ssm_planner.dynamics.transmission import motor_torque, output_effort
from ssm_planner.problem import Drive, Motor, Robot
from ssm_planner.trajectory import DEGREE, Trajectory, blocks, part_indices
from ssm_planner.typing import Array, Indices, Keywords, Mask, Range, record

SAMPLING_RATE = 2000.0
"""Default sampling rate, Hz."""
MOST_INSTANTS = 40_000
"""Approximate largest number of instants of a motion with few pieces."""
INSTANTS_PER_PIECE = (4, 40, 1000)
"""Limits of the number of instants per piece.

A piece has at most 1000 instants, so the cost depends on the number of pieces and not on the
duration. It may have 40 or more if the motion has fewer than 10 × `MOST_INSTANTS` instants in
total, and 4 in any motion.
"""
SECTION_SIZE = 4096
"""Number of pieces or instants that are evaluated together, which bounds the memory in use."""
JOINT_COLUMNS = ("qd", "qdd", "inertia", "velocity", "gravity", "direction", "breakaway")
"""Fields of a load that differ between the joints."""


@record
class JointLoad:
    """Motion and load of one driven joint at n instants. All arrays are (n,), in SI units.

    The motion is divided wherever a joint reverses, and both ends of each part are instants. A
    start from rest with static friction is an additional instant of zero duration.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> load = ssm.size("results/tilt_insert").joints[0].load
    >>> load.joint, load.t.shape == load.inertia.shape
    ('roll', True)
    """

    joint: str
    drive: Drive
    motor: Motor | None
    alternatives: tuple[Motor, ...]
    t: Array
    """Instants, s."""
    qd: Array
    """Velocity of the joint, rad/s or m/s."""
    qdd: Array
    """Acceleration of the joint, rad/s² or m/s²."""
    inertia: Array
    """Effort that accelerates the bodies, the row of M(q) q̈ of this joint, N·m or N.

    M is the mass matrix and q̈ the acceleration of all joints.
    """
    velocity: Array
    """Coriolis and centrifugal effort, N·m or N."""
    gravity: Array
    """Effort of gravity, N·m or N."""
    direction: Array
    """Direction of motion: +1, −1, or 0 while the drive rests."""
    breakaway: Array
    """1 at instants at which the joint starts from rest, else 0."""
    weight: Array
    """Fraction of the duration that each instant represents (trapezoidal rule). The sum is 1."""
    duration: float
    """Duration of the motion, s."""
    motor_friction: Range = (0.0, 0.0)
    """Least and largest friction torque of the motor that the friction of the drive omits, N·m."""
    shaft: Range | None = None
    """Least and largest inertia on the motor shaft without a rotor, kg·m².

    None if the input inertia and the friction of the drive include the motor of the joint.
    """

    @property
    def tau_rigid(self) -> Array:
        """Effort of the rigid bodies (n,), N·m or N."""
        return self.inertia + self.velocity + self.gravity

    @property
    def moving_share(self) -> float:
        """Fraction of the duration in which the joint moves."""
        return float(self.weight[self.direction != 0].sum())

    def speed(self) -> Array:
        """Compute the motor speed (n,) from the joint velocity, rad/s."""
        return self.drive.ratio * self.qd

    @property
    def peak_speed(self) -> float:
        """Largest motor speed, rad/s."""
        return float(np.abs(self.speed()).max())

    def acceleration(self) -> Array:
        """Compute the motor acceleration (n,) from the joint acceleration, rad/s²."""
        return self.drive.ratio * self.qdd

    def effort(self) -> Array:
        """Compute the effort in the mesh of the drive at every instant.

        The effort is the force of a nut or the torque of a wheel. It moves the bodies, and it
        overcomes the friction and the inertia of the output side of the drive.

        Returns
        -------
        (n,) or (draws, n) array
            Efforts, N·m or N. The second shape applies if friction parameters of the drive are
            random draws.
        """
        return output_effort(self.drive, self.tau_rigid, self.qd, self.qdd, self.direction)

    def torque(self) -> Array:
        """Compute the exact motor torque at every instant.

        It includes the largest friction torque of the motor that the friction of the drive omits.

        Returns
        -------
        (n,) or (draws, n) array
            Torques, N·m. The second shape applies if friction parameters of the drive are random
            draws.
        """
        return self.by_parts(JointLoad._torque)

    def by_parts(self, function: Callable[["JointLoad"], Array]) -> Array:
        """Evaluate a function of the instants block by block, to save memory.

        Each block has `SECTION_SIZE` instants.

        Parameters
        ----------
        function : callable
            Function of a load with m instants that returns an array (…, m).

        Returns
        -------
        (…, n) array
            Values at all n instants of this load.
        """
        result = np.empty(0)
        for rows in blocks(len(self.t), SECTION_SIZE):
            values = function(replace(self, **self._columns(rows)))
            if rows.start == 0:
                result = np.empty((*values.shape[:-1], len(self.t)))
            result[..., rows] = values
        return result

    def _torque(self) -> Array:
        """Compute the exact motor torque of all instants at once.

        Returns
        -------
        (n,) or (draws, n) array
            Torques, N·m.
        """
        torque = motor_torque(
            self.drive,
            self.effort(),
            self.speed(),
            self.acceleration(),
            direction=self.direction,
            mu=self.coefficient(),
        )
        _, largest_friction = self.motor_friction
        return torque + largest_friction * self.direction

    def coefficient(self) -> Array:
        """Compute the kinetic friction coefficient μ of the mesh at every instant.

        At a start from rest, the result is at least the static coefficient.

        Returns
        -------
        (n,) or (draws, n) array
            Coefficients. The second shape applies if friction parameters of the drive are random
            draws.
        """
        friction = required_friction(self.drive)
        w = self.speed()
        mu = friction_coefficient(friction, w)
        if not self.breakaway.any():
            return mu
        return np.where(self.breakaway > 0, np.asarray(breakaway_coefficient(friction, w)), mu)

    def rms(self, value: Array) -> Array:
        """Compute the root mean square of a quantity over the motion.

        Parameters
        ----------
        value : (n,) or (draws, n) array
            Values at the instants.

        Returns
        -------
        () or (draws,) array
            Root mean squares.
        """
        return np.sqrt(np.square(value) @ self.weight)

    def stretched(self, factor: float) -> "JointLoad":
        """Return the load of the same motion with a longer or shorter duration.

        The path stays the same. Velocities are divided by the factor, and accelerations and the
        efforts of inertia and velocity by its square.

        Parameters
        ----------
        factor : float
            New duration divided by the present one.

        Returns
        -------
        JointLoad
            Load of the stretched motion.
        """
        return replace(
            self,
            t=self.t[0] + factor * (self.t - self.t[0]),
            qd=self.qd / factor,
            qdd=self.qdd / factor**2,
            inertia=self.inertia / factor**2,
            velocity=self.velocity / factor**2,
            duration=factor * self.duration,
        )

    def interpolate(self, target: "JointLoad", share: float) -> "JointLoad":
        """Interpolate or extrapolate linearly between this load and another one.

        Efforts are linear in the masses, so the interpolation between two payloads is exact.

        Parameters
        ----------
        target : JointLoad
            Load of the same motion with another payload.
        share : float
            Position between both loads: 0 gives this load and 1 gives `target`. Values above 1
            extrapolate.

        Returns
        -------
        JointLoad
            Load with interpolated efforts. Its other fields are those of this load.
        """
        names = ("inertia", "velocity", "gravity")
        efforts: Keywords = {}
        for name in names:
            start = getattr(self, name)
            efforts[name] = start + share * (getattr(target, name) - start)
        return replace(self, **efforts)

    def subset(self, keep: Indices) -> "JointLoad":
        """Return the load at some of its instants, with new weights.

        Parameters
        ----------
        keep : (m,) array of int
            Increasing indices of the instants.

        Returns
        -------
        JointLoad
            Load at m instants.
        """
        columns = self._columns(keep)
        columns["weight"] = _trapezoidal_weights(columns["t"])
        return replace(self, **columns)

    def _columns(self, rows: slice | Indices) -> Keywords:
        """Return the arrays of some instants by the name of the field.

        Parameters
        ----------
        rows : slice or (m,) array of int
            The instants.

        Returns
        -------
        dict of arrays
            Arrays at the selected instants.
        """
        return {name: getattr(self, name)[rows] for name in ("t", *JOINT_COLUMNS, "weight")}

    at = Renamed("subset")


def joint_loads(
    trajectory: Trajectory, robot: Robot, rate: float = SAMPLING_RATE
) -> tuple[JointLoad, ...]:
    """Compute the loads of all driven joints over a motion.

    Parameters
    ----------
    trajectory : Trajectory
        The motion.
    robot : Robot
        Robot whose joints move.
    rate : float
        Sampling rate (Hz). The instants have at least this rate, within the limits of
        `MOST_INSTANTS` and `INSTANTS_PER_PIECE`. They include every start, turn and arrival of a
        joint.

    Returns
    -------
    tuple of JointLoad
        One load with arrays (n,) for each joint that has a drive.
    """
    driven = [i for i, joint in enumerate(robot.joints) if joint.drive is not None]
    sections = blocks(len(trajectory.breaks) - 1, SECTION_SIZE)
    instants = [_sampling_instants(trajectory, robot, rate, section) for section in sections]
    index, local, is_first, is_last = map(np.concatenate, zip(*instants, strict=True))
    t = trajectory.breaks[index] + local
    # Arrays of their final size, because parts that are joined later would need twice the memory.
    columns = {name: np.empty((len(driven), len(t))) for name in JOINT_COLUMNS}
    body = RigidBody.from_robot(robot)
    for block in blocks(len(t), SECTION_SIZE):
        samples = trajectory.sample_pieces(index[block], local[block])
        efforts = body.effort_parts(samples.q, samples.qd, samples.qdd)
        direction_after, starting = motion_directions(robot, samples, 1)
        direction_before, _ = motion_directions(robot, samples, -1)
        direction = np.where(is_last[block, None], direction_before, direction_after)
        breakaway = np.where(is_first[block, None], starting, 0.0)
        values = (samples.qd, samples.qdd, *efforts, direction, breakaway)
        for column, value in zip(columns.values(), values, strict=True):
            column[:, block] = value.T[driven]
    weight = _trapezoidal_weights(t)
    loads = []
    for k, i in enumerate(driven):
        joint = robot.joints[i]
        assert joint.drive is not None
        load = JointLoad(
            joint=joint.name,
            drive=joint.drive,
            motor=joint.motor,
            alternatives=joint.alternatives,
            t=t,
            **{name: column[k] for name, column in columns.items()},
            weight=weight,
            duration=trajectory.duration,
        )
        loads.append(load)
    return tuple(loads)


def _sampling_instants(
    trajectory: Trajectory, robot: Robot, rate: float, section: slice
) -> tuple[Indices, Array, Mask, Mask]:
    """Choose the instants at which the loads of a motion are computed.

    The polynomial pieces of the trajectory are divided into parts wherever a joint reverses. The
    first two instants of each part coincide: the first one represents the start with static
    friction, and the second one the motion just after it.

    Parameters
    ----------
    trajectory : Trajectory
        The motion.
    robot : Robot
        Robot with the velocity limits of the joints.
    rate : float
        Sampling rate, Hz.
    section : slice
        Indices of the pieces to divide.

    Returns
    -------
    index : (n,) array of int
        Piece of each instant.
    local : (n,) array
        Time since the start of this piece, s.
    is_first, is_last : (n,) arrays of bool
        True at the first and at the last instant of each part.
    """
    index, start, end = _split_at_reversals(trajectory, robot, rate, section)
    max_count = _max_instants(len(trajectory.breaks))
    counts = np.clip(np.ceil((end - start) * rate).astype(int), 2, max_count) + 2
    part, k = part_indices(counts)
    # The first two instants coincide: breakaway, and the motion just after it.
    share = np.maximum(k - 1, 0) / (counts[part] - 2)
    local = np.where(share == 1.0, end[part], start[part] + share * (end - start)[part])
    return index[part], local, k == 0, k == counts[part] - 1


def _max_instants(breaks: int) -> int:
    """Compute the largest number of instants per piece of a motion.

    Parameters
    ----------
    breaks : int
        Number of breaks of the motion, that is, of its pieces plus 1.

    Returns
    -------
    int
        The number, within the limits that `INSTANTS_PER_PIECE` describes.
    """
    smallest_count, usual_count, largest_count = INSTANTS_PER_PIECE
    count = max(MOST_INSTANTS // breaks, min(usual_count, 10 * MOST_INSTANTS // breaks))
    return int(np.clip(count, smallest_count, largest_count))


def _split_at_reversals(
    trajectory: Trajectory, robot: Robot, rate: float, section: slice
) -> tuple[Indices, Array, Array]:
    """Divide the polynomial pieces of a trajectory wherever a joint reverses.

    Samples at `rate` show between which two of them the velocity of a joint changes its sign.
    Bisection then finds the exact time of each reversal.

    Parameters
    ----------
    trajectory : Trajectory
        The motion.
    robot : Robot
        Robot with the velocity limits of the joints, which define the speeds that count as rest.
    rate : float
        Sampling rate, Hz.
    section : slice
        Indices of the pieces to divide.

    Returns
    -------
    index : (parts,) array of int
        Piece of each part.
    start, end : (parts,) arrays
        Start and end of each part since the start of its piece, s.
    """
    all_lengths = np.diff(trajectory.breaks)
    lengths = all_lengths[section]
    max_count = _max_instants(len(trajectory.breaks))
    counts = np.clip(np.ceil(lengths * rate).astype(int), 4, max_count) + 1
    piece, k = part_indices(counts)
    local = k / (counts[piece] - 1) * lengths[piece]
    index = section.start + piece
    qd = trajectory.sample_pieces(index, local).qd
    sign = np.where(np.abs(qd) > REST_FRACTION * robot.velocities, np.sign(qd), 0.0)
    # Index of the last instant, before each one, at which the joint moved.
    moving_index = np.where(sign != 0, np.arange(len(sign))[:, None], 0)
    last_moving = np.maximum.accumulate(moving_index, axis=0)[:-1]
    in_same_piece = index[last_moving] == index[1:, None]
    reverses = sign[last_moving, np.arange(sign.shape[1])] * sign[1:] < 0
    turns, joint = np.nonzero(in_same_piece & reverses)
    before_turn = last_moving[turns, joint]
    cuts = _reversal_times(
        trajectory, index[before_turn], local[before_turn], local[turns + 1], joint
    )
    pieces = np.append(np.arange(section.start, section.stop), index[before_turn])
    starts = np.append(np.zeros(len(lengths)), cuts)
    order = np.lexsort((starts, pieces))
    pieces = pieces[order]
    starts = starts[order]
    is_final = np.append(np.diff(pieces), 1) > 0
    ends = np.where(is_final, all_lengths[pieces], np.append(starts[1:], 0.0))
    return pieces, starts, ends


def _reversal_times(
    trajectory: Trajectory, index: Indices, low: Array, high: Array, joint: Indices
) -> Array:
    """Find by bisection the times at which joints reverse.

    Parameters
    ----------
    trajectory : Trajectory
        The motion.
    index : (n,) array of int
        Polynomial piece in which each reversal occurs.
    low, high : (n,) arrays
        Times before and after each reversal since the start of the piece, s.
    joint : (n,) array of int
        Index of the joint that reverses.

    Returns
    -------
    (n,) array
        Times of the reversals since the start of the piece, s.
    """
    powers = trajectory.pieces(index)[np.arange(len(index)), 1:, joint]
    # The velocity is Σ k a_k t^(k − 1).
    coefficients = powers * np.arange(1, DEGREE + 1)

    def direction(t: Array) -> Array:
        """Return the direction (n,) of each joint at the times t (n,)."""
        return np.sign(polyval(t, coefficients.T, tensor=False))

    if not len(index):
        return high
    sign = direction(low)
    # After 60 bisections, the interval is below the resolution of the times.
    for _ in range(60):
        middle = (low + high) / 2
        unturned = direction(middle) == sign
        low = np.where(unturned, middle, low)
        high = np.where(unturned, high, middle)
    return high


def _trapezoidal_weights(t: Array) -> Array:
    """Compute the fraction of the duration that each instant represents.

    The trapezoidal rule gives each instant half of both adjacent intervals.

    Parameters
    ----------
    t : (n,) array
        Instants in ascending order, s.

    Returns
    -------
    (n,) array
        Fractions with the sum 1.
    """
    half = np.diff(t, prepend=t[0], append=t[-1]) / 2
    weight = half[1:] + half[:-1]
    return weight / weight.sum()
