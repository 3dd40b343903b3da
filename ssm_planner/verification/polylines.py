"""Check of a trajectory that consists of linear pieces between points.

The velocity jumps at every point, so acceleration and torque are undefined. However, every smooth
motion through three points has at some instant at least a certain acceleration. It is the jump of
the mean velocity divided by the mean length of both intervals (mean value theorem). At an end of
the motion, which rests there or has a declared speed, the length of the outer interval is 0. If
this acceleration exceeds the limit, every motion through the points violates the limit. The jump is
therefore compared with the limit times the mean length.

`check` calls `check_linear_pieces` for a table of points. The largest rounding error of a point is
called the resolution.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np

from ssm_planner.kinematics import Mechanism, task_rates, tool_speed
from ssm_planner.problem import Jump, Robot, SpeedLimit, TaskLimits
from ssm_planner.trajectory import DEGREE, Trajectory, blocks
from ssm_planner.typing import Array, Indices
from ssm_planner.verification.certificate import LimitCheck, Unjudged
from ssm_planner.verification.ends import declared_end_velocities
from ssm_planner.verification.limits import LimitedQuantity
from ssm_planner.verification.pieces import PIECES_PER_BLOCK

MIN_RESOLUTION = 1e-12
"""Smallest resolution of positions that the check assumes, rad or m."""
EXPLAINABLE_EXCESS = 1e-3
"""Largest relative excess of a speed that counts as kept if rounding can explain the excess.

A larger excess that rounding can explain is not judged.
"""


def check_linear_pieces(
    trajectory: Trajectory,
    robot: Robot,
    limits: TaskLimits,
    resolution: Array,
    checks: Mapping[LimitedQuantity, LimitCheck],
) -> tuple[list[LimitCheck], list[str], list[Unjudged]]:
    """Judge speeds and jumps of velocity on linear pieces, with regard to rounding of the points.

    A jump of the velocity does not count if rounding of the points can explain it. A speed above
    its limit is not judged if rounding can explain the excess.

    Parameters
    ----------
    trajectory : Trajectory
        Motion that is checked.
    robot : Robot
        Robot whose limits must hold.
    limits : TaskLimits
        Limits of the task.
    resolution : (4,) array
        Largest rounding error of a point, rad or m.
    checks : mapping of LimitedQuantity to LimitCheck
        Results for the linear pieces without regard to rounding.

    Returns
    -------
    checks : list of LimitCheck
        The results without the effect of rounding, and the jumps of the velocity.
    notes : list of str
        Assumptions of these results.
    unjudged : list of Unjudged
        Speeds that rounding may or may not explain.
    """
    resolution = np.maximum(resolution, MIN_RESOLUTION)
    start_velocity, end_velocity = declared_end_velocities(trajectory, robot, limits)
    speeds = _SpeedRecorder(robot, resolution, start_velocity)
    for block in blocks(len(trajectory.breaks) - 1, PIECES_PER_BLOCK):
        speeds.update(trajectory.breaks[block.start : block.stop + 1], trajectory.pieces(block))
    speeds.finish(end_velocity)
    results = []
    unjudged = []
    for quantity, limit in checks.items():
        result = _without_rounding(quantity, limit, trajectory, robot, speeds)
        if result.passed and limit.margin < -EXPLAINABLE_EXCESS:
            reason = f"{-100 * limit.margin:.3g} % above the limit, which rounding may explain"
            unjudged.append(Unjudged(limit.name, limit.joint, reason))
        results.append(result)
    results += speeds.results()
    note = "the velocity may jump by as much as the acceleration limit allows within one interval"
    if resolution.max() > MIN_RESOLUTION:
        note += ", and jumps that rounding of the positions can explain do not count"
    return results, [note], unjudged


class _SpeedRecorder:
    """Records the largest joint speeds on linear pieces and the worst jumps between them.

    Each speed and each jump is reduced by the part that rounding of the points can explain.

    Attributes
    ----------
    fastest, fastest_time : (4,) arrays
        Largest speed of each joint in rad/s or m/s, and its time in s.
    """

    def __init__(self, robot: Robot, resolution: Array, start: Array) -> None:
        """Start a record without speeds and jumps.

        Parameters
        ----------
        robot : Robot
            Robot whose limits must hold.
        resolution : (4,) array
            Largest rounding error of a point, rad or m.
        start : (4,) array
            Declared joint velocities at the start of the motion, rad/s, and m/s for joint 4.
        """
        self.robot = robot
        self.resolution = resolution
        self.allowed = robot.accelerations
        self.fastest = np.zeros(4)
        self.fastest_time = np.zeros(4)
        self.share = np.full(4, -np.inf)
        """Largest ratio of a jump to the allowed jump for each joint, (4,)."""
        self.worst_jump = np.zeros((3, 4))
        """Jump, allowed jump and time (rows) with this ratio for each joint, (3, 4)."""
        self._previous_velocity = start
        self._length = 0.0
        self._time = 0.0

    def update(self, breaks: Array, coefficients: Array) -> None:
        """Update the largest speeds and the worst jumps with the next pieces of the motion.

        Rounding moves each end of a piece by at most the resolution. It therefore explains a speed
        of two resolutions divided by the duration of the piece.

        Parameters
        ----------
        breaks : (m + 1,) array
            Start of each piece and end of the last one, s.
        coefficients : (m, 6, 4) array
            Coefficients of powers of the time since the start of the piece.
        """
        length = np.diff(breaks)
        speed = np.maximum(np.abs(coefficients[:, 1]) - 2 * self.resolution / length[:, None], 0.0)
        maximum = speed.max(axis=0)
        k = speed.argmax(axis=0)
        self.fastest_time = np.where(maximum > self.fastest, breaks[k], self.fastest_time)
        self.fastest = np.maximum(maximum, self.fastest)
        # The derivative of Σ a_k t^k at the end t = length of a piece is Σ k length^(k − 1) a_k.
        orders = np.arange(1, DEGREE + 1)
        powers = orders * length[:, None] ** (orders - 1)
        end_velocities = np.einsum("mk,mkj->mj", powers, coefficients[:, 1:])
        jumps = coefficients[:, 1] - np.vstack([self._previous_velocity, end_velocities[:-1]])
        self._update_jumps(breaks[:-1], np.append(self._length, length[:-1]), length, jumps)
        self._previous_velocity = end_velocities[-1]
        self._length = float(length[-1])
        self._time = float(breaks[-1])

    def finish(self, velocity: Array) -> None:
        """Add the jump from the last velocity to the declared velocity at the end of the motion.

        Call this method after the last piece.

        Parameters
        ----------
        velocity : (4,) array
            Declared joint velocities at the end of the motion, rad/s, and m/s for joint 4.
        """
        time = np.array([self._time])
        length = np.array([self._length])
        self._update_jumps(time, length, np.zeros(1), (velocity - self._previous_velocity)[None])

    def _update_jumps(
        self, time: Array, length_before: Array, length_after: Array, jump: Array
    ) -> None:
        """Update the worst jumps with the jumps of the velocity at n instants.

        Parameters
        ----------
        time : (n,) array
            Instants, s.
        length_before, length_after : (n,) arrays
            Lengths of the adjacent intervals, s. A length outside the motion is 0.
        jump : (n, 4) array
            Jumps of the joint velocities, rad/s, and m/s for joint 4.
        """
        # The inverse of a missing interval, which has the length 0, counts as 0.
        inverse = np.zeros(len(time))
        for length in (length_before, length_after):
            inverse += np.divide(1.0, length, out=np.zeros_like(length), where=length > 0)
        # Rounding of both ends of an interval changes its mean velocity by at most two resolutions
        # divided by its length.
        jump = np.maximum(np.abs(jump) - 2 * self.resolution * inverse[:, None], 0.0)
        allowed = self.allowed * ((length_before + length_after) / 2)[:, None]
        share = jump / allowed
        k = share.argmax(axis=0)
        joints = np.arange(4)
        is_worse = share[k, joints] > self.share
        candidate = np.array([jump[k, joints], allowed[k, joints], time[k]])
        self.worst_jump = np.where(is_worse, candidate, self.worst_jump)
        self.share = np.where(is_worse, share[k, joints], self.share)

    def results(self) -> list[LimitCheck]:
        """Return the worst jump of the velocity of each joint.

        Returns
        -------
        list of LimitCheck
            One result for each joint. Its limit is the jump that the acceleration limit allows.
        """
        checks = []
        for i, joint in enumerate(self.robot.joints):
            jump, allowed, time = self.worst_jump[:, i].tolist()
            limit = Jump(joint.name, allowed, joint.slides, derivative=1)
            checks.append(LimitCheck.from_extreme(limit, jump, time))
        return checks


def _without_rounding(
    quantity: LimitedQuantity,
    limit: LimitCheck,
    trajectory: Trajectory,
    robot: Robot,
    speeds: _SpeedRecorder,
) -> LimitCheck:
    """Reduce the worst value of a speed limit by the speed that rounding can explain.

    Parameters
    ----------
    quantity : LimitedQuantity
        The limited quantity.
    limit : LimitCheck
        Result for the linear pieces without regard to rounding.
    trajectory : Trajectory
        Motion that is checked.
    robot : Robot
        Robot whose limits must hold.
    speeds : _SpeedRecorder
        Largest joint speeds on the linear pieces.

    Returns
    -------
    LimitCheck
        The reduced result. Results of other limits, and of speeds at points that state velocities,
        remain unchanged.
    """
    if quantity.limit.order != 1:
        return limit
    if quantity.order is None:
        return _tool_speed_without_rounding(quantity, limit, trajectory, robot, speeds.resolution)
    if trajectory.pieces(_adjacent_pieces(trajectory, limit.time))[:, 2:].any():
        return limit  # points that state velocities, so rounding explains nothing
    scale = abs(quantity.scale)
    joint = quantity.index
    candidates = [(float(speeds.fastest[joint]), float(speeds.fastest_time[joint]))]
    if not limit.passed:
        bound = limit.limit / scale
        resolution = float(speeds.resolution[joint])
        candidates.append(_worst_window_speed(trajectory, joint, bound, resolution))
    speed, time = max(candidates)
    return _with_worst_value(limit, scale * speed, time)


def _worst_window_speed(
    trajectory: Trajectory, joint: int, bound: float, resolution: float
) -> tuple[float, float]:
    """Compute the mean speed of a joint over the window of points that is worst for a speed limit.

    A window contains all points between two points of the table. A motion with |q̇| ≤ bound that
    passes all points within their rounding exists if and only if

        |q(t) − q(s)| ≤ bound (t − s) + 2 resolution   for the times s < t of all pairs of points

    (McShane's extension). The worst window is the one that violates this inequality by most. Its
    mean speed, reduced by the effect of rounding, exceeds the bound if and only if no such motion
    exists. The window ends where q(t) − bound t is farthest above its lowest earlier value.

    Parameters
    ----------
    trajectory : Trajectory
        Motion that is checked.
    joint : int
        Index of the joint.
    bound : float
        Limit of the speed, rad/s or m/s.
    resolution : float
        Largest rounding error of a point, rad or m.

    Returns
    -------
    speed, start : float
        Mean speed without the effect of rounding, and start of the window in s.
    """
    t = trajectory.breaks
    q = np.concatenate(
        [trajectory.positions(t[block])[:, joint] for block in blocks(len(t), PIECES_PER_BLOCK)]
    )
    largest_rise = 0.0
    speed = 0.0
    start = 0.0
    for direction in (1.0, -1.0):
        # The rise of this function over a window is the travel beyond that at the largest speed.
        advance = direction * q - bound * (t - t[0])
        rise = advance - np.minimum.accumulate(advance)
        end_index = int(rise.argmax())
        start_index = int(advance[: end_index + 1].argmin())
        if rise[end_index] > largest_rise:
            largest_rise = rise[end_index]
            travel = abs(q[end_index] - q[start_index]) - 2 * resolution
            speed = float(travel / (t[end_index] - t[start_index]))
            start = float(t[start_index])
    return speed, start


def _tool_speed_without_rounding(
    quantity: LimitedQuantity,
    limit: LimitCheck,
    trajectory: Trajectory,
    robot: Robot,
    resolution: Array,
) -> LimitCheck:
    """Reduce the worst value of a tool speed by the speed that rounding can explain.

    The speed is evaluated at the start of every piece and at the worst sampled instant.

    Parameters
    ----------
    quantity : LimitedQuantity
        Speed of the tool, or rate of a task coordinate.
    limit : LimitCheck
        Result for the linear pieces without regard to rounding.
    trajectory : Trajectory
        Motion that is checked.
    robot : Robot
        Robot whose limits must hold.
    resolution : (4,) array
        Largest rounding error of a point, rad or m.

    Returns
    -------
    LimitCheck
        The reduced result. A result that keeps its limit remains unchanged.
    """
    if limit.passed:
        return limit
    mechanism = Mechanism.from_robot(robot)

    def tool_speeds(q: Array, qd: Array) -> Array:
        """Compute the limited speeds (n,) of the tool for joint positions and velocities (n, 4)."""
        if isinstance(quantity.limit, SpeedLimit):
            return tool_speed(type(quantity.limit), mechanism, q, qd)
        return np.abs(task_rates(mechanism, q, qd)[:, quantity.index])

    def unexplained(q: Array, speeds: Array, index: Indices) -> Array:
        """Compute tool speeds (n,), reduced by the part that rounding of the points can explain.

        `q` and `speeds` (n, 4) are the joint positions and velocities. `index` (n,) contains the
        indices of their pieces.
        """
        length = trajectory.breaks[index + 1] - trajectory.breaks[index]
        # Each end of a piece may be wrong by the resolution.
        speed_error = 2 * resolution / length[:, None]
        # The sum over the joints bounds the tool speed that the errors of all joints cause.
        explained = sum(tool_speeds(q, only_joint * speed_error) for only_joint in np.eye(4))
        return np.maximum(tool_speeds(q, speeds) - explained, 0.0)

    pieces = _adjacent_pieces(trajectory, limit.time)
    q_worst = trajectory.sample_pieces(pieces, limit.time - trajectory.breaks[pieces]).q
    speeds_left = unexplained(q_worst, trajectory.pieces(pieces)[:, 1], pieces)
    highest = float(speeds_left.max())
    time = limit.time
    for block in blocks(len(trajectory.breaks) - 1, PIECES_PER_BLOCK):
        coefficients = trajectory.pieces(block)
        q = coefficients[:, 0]
        speeds = coefficients[:, 1]
        # A speed that is lower even with the effect of rounding is not the largest.
        faster = tool_speeds(q, speeds) > highest
        if not faster.any():
            continue
        index = block.start + np.flatnonzero(faster)
        speeds_left = unexplained(q[faster], speeds[faster], index)
        k = int(np.argmax(speeds_left))
        if speeds_left[k] > highest:
            highest = float(speeds_left[k])
            time = float(trajectory.breaks[index[k]])
    return _with_worst_value(limit, highest, time)


def _adjacent_pieces(trajectory: Trajectory, time: float) -> Indices:
    """Find the two pieces of a trajectory that meet at a time.

    Parameters
    ----------
    trajectory : Trajectory
        The motion.
    time : float
        Time, s.

    Returns
    -------
    (2,) array
        Indices of the pieces before and after the time. Both are the same if the time is not a
        break.
    """
    instant = np.array([time])
    before = trajectory.piece_of(instant, "left")
    after = trajectory.piece_of(instant, "right")
    return np.concatenate([before, after])


def _with_worst_value(limit: LimitCheck, value: float, time: float) -> LimitCheck:
    """Return a copy of a result with another worst value and its margin.

    Parameters
    ----------
    limit : LimitCheck
        Result with an upper bound.
    value : float
        The worst value, in the unit of the limit.
    time : float
        Time of the worst value, s.

    Returns
    -------
    LimitCheck
        The copy.
    """
    margin = (limit.limit - value) / limit.limit
    return dataclasses.replace(limit, worst=value, margin=margin, time=time)
