"""Convert, write and read JointTrajectory messages of ROS 2.

`trajectory_message` builds a message from the points of a plan, and `yaml_text` writes it in the
form that `ros2 topic pub` or an action goal requires. `read_yaml` reads such a file. The reader
interpolates the points as joint_trajectory_controller does. It raises an error with the reason of
the controller if the controller would reject the message.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.dynamics import RigidBody
from ssm_planner.errors import ProblemError, TrajectoryError
from ssm_planner.formats.csv import motor_states
from ssm_planner.formats.points import Points, Reading, interpolate_points
from ssm_planner.formats.spline_points import Law, SplinePoints
from ssm_planner.loading.json_files import read_bytes
from ssm_planner.loading.yaml_nodes import parse_yaml
from ssm_planner.plans import Plan
from ssm_planner.problem import Robot
from ssm_planner.trajectory import Samples
from ssm_planner.typing import Array, JsonObject, record

NANOSECONDS_PER_SECOND = 10**9
"""Nanoseconds per second."""
LARGEST_FILE = 100_000_000
"""Largest size of a YAML file, bytes."""
LARGEST_TREE = 7_000_000
"""Largest number of values in a YAML file, which bounds the memory that its parser needs."""
LARGEST_SECONDS = 10**9
"""Largest absolute number of seconds that is accepted in a time."""
CONTROLLER_REST_SPEED = 1.2e-7
"""Largest final velocity that joint_trajectory_controller accepts by default, rad/s or m/s."""
POINT_FIELDS = ("positions", "velocities", "accelerations", "effort")
"""Names of the lists in a trajectory point."""


@record
class TrajectoryMessage:
    """A JointTrajectory message of ROS 2 with n points.

    A point states the positions of all joints at one time, and optionally their velocities,
    accelerations and efforts.

    Attributes
    ----------
    names : tuple of str
        Names of the joints in the order of the lists.
    time : (n,) array
        Times of the points since the start, s.
    positions, velocities, accelerations, effort : list of n sequences of float
        Values of all joints for each point, in SI units. The sequence of a point is empty if the
        point does not state the quantity.
    """

    names: tuple[str, ...]
    time: Array
    positions: list[Sequence[float]]
    velocities: list[Sequence[float]]
    accelerations: list[Sequence[float]]
    effort: list[Sequence[float]]


def joint_efforts(robot: Robot, rigid: bool, samples: Samples) -> Array:
    """Compute the efforts that joint_trajectory_controller may send to the joints.

    Parameters
    ----------
    robot : Robot
        Robot that performs the motion.
    rigid : bool
        True for the efforts of the rigid bodies. Otherwise, the efforts are the motor torques with
        exact friction times the ratios of the drives. A joint without a drive always has its
        rigid-body effort.
    samples : Samples
        n samples of the motion.

    Returns
    -------
    (n, 4) array
        Efforts, N·m and N.
    """
    efforts = RigidBody.from_robot(robot).inverse_dynamics(samples.q, samples.qd, samples.qdd)
    if not rigid:
        torque = motor_states(samples, robot).torque
        for i, joint in enumerate(robot.joints):
            if joint.drive is not None:
                efforts[:, i] = torque[:, i] * joint.drive.ratio
    return efforts


def trajectory_message(
    plan: Plan, points: SplinePoints, law: Law | None = None
) -> TrajectoryMessage:
    """Build the JointTrajectory message with the points of an exported plan.

    Parameters
    ----------
    plan : Plan
        Plan that is exported.
    points : SplinePoints
        Points of the plan between which the controller interpolates.
    law : callable, optional
        Law of the efforts. By default, the message contains no efforts.

    Returns
    -------
    TrajectoryMessage
        Message with one point for each spline point. It contains accelerations only if the
        controller must join the points by quintics.
    """
    samples = points.samples
    empty: list[Sequence[float]] = [[] for _ in samples.t]
    return TrajectoryMessage(
        tuple(joint.name for joint in plan.robot.joints),
        samples.t,
        positions=samples.q.tolist(),
        velocities=samples.qd.tolist(),
        accelerations=samples.qdd.tolist() if points.has_accelerations else empty,
        effort=empty if law is None else law(samples).tolist(),
    )


def split_time(t: float) -> tuple[int, int]:
    """Split a time in s into whole seconds and remaining nanoseconds, as ROS 2 states times."""
    ticks = round(t * NANOSECONDS_PER_SECOND)
    return ticks // NANOSECONDS_PER_SECOND, ticks % NANOSECONDS_PER_SECOND


def yaml_text(message: TrajectoryMessage, comments: Sequence[str], under: str) -> str:
    """Return a message as YAML text.

    Parameters
    ----------
    message : TrajectoryMessage
        Message that is written.
    comments : sequence of str
        Comment lines at the beginning.
    under : str
        Key under which the message is written. If it is "", the message is at the top level.

    Returns
    -------
    str
        Text of the YAML file.
    """
    indent = "  " if under else ""
    lines = [f"# {comment}" for comment in comments]
    lines += [f"{under}:"] if under else []
    lines += [f"{indent}header: {{stamp: {{sec: 0, nanosec: 0}}, frame_id: base}}"]
    lines += [f"{indent}joint_names: {json.dumps(list(message.names))}", f"{indent}points:"]
    for k, t in enumerate(message.time):
        sec, nanosec = split_time(float(t))
        values = ", ".join(
            f"{field}: {_yaml_list(getattr(message, field)[k])}" for field in POINT_FIELDS
        )
        lines.append(f"{indent}- {{{values}, time_from_start: {{sec: {sec}, nanosec: {nanosec}}}}}")
    return "\n".join(lines) + "\n"


def _yaml_list(values: Sequence[float] | Array) -> str:
    """Format numbers as a YAML list.

    YAML 1.1 would read 1e-05 as text, so it becomes 1.0e-05. A negative zero becomes 0.0.
    """
    return "[" + ", ".join(_yaml_number(float(value) + 0.0) for value in np.asarray(values)) + "]"


def _yaml_number(value: float) -> str:
    """Format a number for YAML 1.1, which requires a decimal point before an exponent."""
    text = repr(value)
    mantissa, e, exponent = text.partition("e")
    return text if not e or "." in mantissa else f"{mantissa}.0e{exponent}"


def read_yaml(path: Path, robot: Robot) -> Reading:
    """Read a JointTrajectory or a FollowJointTrajectory goal from a YAML file.

    Parameters
    ----------
    path : Path
        YAML file that is read.
    robot : Robot
        Robot with the joints of the message.

    Returns
    -------
    Reading
        The trajectory that a controller executes.

    Raises
    ------
    TrajectoryError
        If the file does not contain such a message, or if a controller would reject it.
    """
    return interpolate_message(read_yaml_message(path), robot, str(path))


def read_yaml_message(path: Path) -> TrajectoryMessage:
    """Read the JointTrajectory message in a YAML file.

    Parameters
    ----------
    path : Path
        File with the message at the top level, or under the keys `goal` and `trajectory`, as in the
        goal of a ROS 2 action.

    Returns
    -------
    TrajectoryMessage
        The message. The lengths of its lists are not checked.

    Raises
    ------
    TrajectoryError
        If the file does not contain a message.
    """
    content = read_yaml_content(path)
    for key in ("goal", "trajectory"):
        if isinstance(content, dict) and isinstance(content.get(key), dict):
            content = content[key]
    return parse_message(content, str(path))


def read_yaml_content(path: Path) -> Any:
    """Return the content of a YAML file as dictionaries and lists.

    Parameters
    ----------
    path : Path
        File that is read.

    Returns
    -------
    dict, list, str, float, int, bool or None
        Content of the file.

    Raises
    ------
    TrajectoryError
        If the file cannot be read, is not valid, or is larger than `LARGEST_FILE`.
    """
    data = read_bytes(path, LARGEST_FILE)
    try:
        text = data.decode("utf-8-sig")
        return parse_yaml(path, text, LARGEST_TREE, trailing=True, tree=False).value
    except UnicodeDecodeError as error:
        raise TrajectoryError(f"{path}: not a text file") from error
    except ProblemError as error:
        raise TrajectoryError(str(error)) from error


def parse_message(data: Any, location: str) -> TrajectoryMessage:
    """Build a message from the dictionaries and lists of a YAML file, and check their types.

    Parameters
    ----------
    data : Any
        Part of the content that should be a message.
    location : str
        Beginning of error messages, such as the path of the file.

    Returns
    -------
    TrajectoryMessage
        The message. The lengths of its lists are not checked.

    Raises
    ------
    TrajectoryError
        If a key is missing or has a wrong type.
    """
    points = data.get("points") if isinstance(data, dict) else None
    if not isinstance(points, list) or "joint_names" not in data:
        raise TrajectoryError(
            f"{location}: not a JointTrajectory (it needs joint_names and points)"
        )
    names = data["joint_names"]
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise TrajectoryError(f"{location}: joint_names is not a list of names")
    time = np.array([_parse_time(point, k, location) for k, point in enumerate(points)])
    fields = [
        [_parse_numbers(point, key, k, location) for k, point in enumerate(points)]
        for key in POINT_FIELDS
    ]
    return TrajectoryMessage(tuple(names), time, *fields)


def interpolate_message(
    message: TrajectoryMessage, robot: Robot, location: str, notes: tuple[str, ...] = ()
) -> Reading:
    """Return the trajectory that a controller executes for a message.

    Parameters
    ----------
    message : TrajectoryMessage
        Message that is read.
    robot : Robot
        Robot with the joints of the message, in any order.
    location : str
        Beginning of error messages, such as the path of the file.
    notes : tuple of str
        Notes that are added to the result.

    Returns
    -------
    Reading
        Trajectory through the points, with remarks on the behaviour of the controller.

    Raises
    ------
    TrajectoryError
        If joint_trajectory_controller would reject the message.
    """
    faults, remarks = controller_rejections(message, [joint.name for joint in robot.joints])
    if faults:
        others = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        raise TrajectoryError(f"{location}: {faults[0]}{others}")
    order = [message.names.index(joint.name) for joint in robot.joints]
    (q, _), (qd, has_qd), (qdd, has_qdd) = (
        _reorder_rows(rows, order)
        for rows in (message.positions, message.velocities, message.accelerations)
    )
    points = Points(
        message.time,
        q,
        qd=qd,
        qdd=qdd,
        has_qd=has_qd,
        has_qdd=has_qdd,
        point_name=lambda k: f"{location}: point {k}",
    )
    return interpolate_points(points, robot, notes + tuple(remarks))


def controller_rejections(
    message: TrajectoryMessage, joints: Sequence[str]
) -> tuple[list[str], list[str]]:
    """Find the reasons for which joint_trajectory_controller of ROS 2 rejects a message.

    Parameters
    ----------
    message : TrajectoryMessage
        Message that is checked.
    joints : sequence of str
        Names of the joints of the robot.

    Returns
    -------
    faults : list of str
        Reasons for which the controller rejects the message in every configuration.
    remarks : list of str
        Notes for the user on reactions of the controller that depend on its configuration, and on
        its motion before the first point.
    """
    names = message.names
    time = message.time
    known_names = ", ".join(joints)
    faults = [f"joint {name!r} is not one of {known_names}" for name in names if name not in joints]
    repeated = [name for name in sorted(set(names)) if names.count(name) > 1]
    faults += [f"joint {name!r} is named twice" for name in repeated]
    faults += [f"joint {name!r} is missing" for name in joints if name not in names]
    if not len(time):
        return faults + ["no points"], []
    if time[0] < 0:
        faults.append(f"point 0: time_from_start is negative: {time[0]:.12g} s")
    for k in np.flatnonzero(np.diff(time) <= 0)[:1]:
        faults.append(
            f"point {k + 1}: time_from_start does not increase ({time[k + 1]:.12g} s after "
            f"{time[k]:.12g} s)"
        )
    for field in POINT_FIELDS:
        may_be_empty = field != "positions"
        for k, values in enumerate(getattr(message, field)):
            if len(values) != len(names) and not (may_be_empty and not len(values)):
                faults.append(f"point {k}: {len(values)} {field} for {len(names)} joints")
                break
    remarks = []
    final_speed = max((abs(float(velocity)) for velocity in message.velocities[-1]), default=0.0)
    if final_speed > CONTROLLER_REST_SPEED:
        remarks.append(
            f"the last velocity is {final_speed:.3g}, not zero: the controller rejects this "
            "unless allow_nonzero_velocity_at_trajectory_end is set"
        )
    if any(len(values) for values in message.effort):
        remarks.append(
            "the message contains efforts: a controller without an effort interface rejects it"
        )
    if time[0] > 0:
        remarks.append(
            f"the controller moves the robot to the first point until {time[0]:.6g} s; this motion "
            "is not checked"
        )
    return faults, remarks


def _reorder_rows(rows: list[Sequence[float]], order: list[int]) -> tuple[Array, Any]:
    """Reorder the values of all points from the order of a message to that of the robot's joints.

    Parameters
    ----------
    rows : list of n sequences of float
        Values of each point in the order of the message. A sequence may be empty.
    order : list of four int
        Index in the message of each joint of the robot.

    Returns
    -------
    values : (n, 4) array
        Values in SI units. Missing values are 0.
    has_values : (n,) array of bool
        True for points with values.
    """
    has_values = np.array([len(row) > 0 for row in rows])
    zeros = [0.0] * len(order)
    values = np.array([row if len(row) else zeros for row in rows])
    return values[:, order], has_values


def _parse_time(point: Any, k: int, location: str) -> float:
    """Return the time of a point in seconds since the start of the motion.

    Parameters
    ----------
    point : Any
        The point as read from a file.
    k : int
        Index of the point, for messages.
    location : str
        Beginning of error messages, such as the path of the file.

    Returns
    -------
    float
        Time, s.

    Raises
    ------
    TrajectoryError
        If the time is missing or invalid.
    """
    stamp = point.get("time_from_start") if isinstance(point, dict) else None
    if isinstance(stamp, dict) and stamp.keys() <= {"sec", "nanosec"}:
        sec = stamp.get("sec", 0)
        nanosec = stamp.get("nanosec", 0)
        is_integer = type(sec) is int and type(nanosec) is int
        if is_integer and abs(sec) <= LARGEST_SECONDS and 0 <= nanosec < NANOSECONDS_PER_SECOND:
            return float((sec * NANOSECONDS_PER_SECOND + nanosec) / NANOSECONDS_PER_SECOND)
    raise TrajectoryError(
        f"{location}: point {k}: time_from_start is {str(stamp)[:80]}, but it must have whole "
        f"numbers sec and nanosec, with nanosec from 0 to {NANOSECONDS_PER_SECOND - 1}"
    )


def _parse_numbers(point: JsonObject, key: str, k: int, location: str) -> Sequence[float]:
    """Return the list of numbers under a key of a point.

    Parameters
    ----------
    point : dict
        One point of the message.
    key : str
        Key of the list, such as "positions".
    k : int
        Index of the point, for messages.
    location : str
        Beginning of error messages, such as the path of the file.

    Returns
    -------
    list of float or int
        Numbers of the list, or an empty list if the key is missing.

    Raises
    ------
    TrajectoryError
        If the entry is not a list of numbers.
    """
    values = point.get(key) or []
    if not isinstance(values, list) or not all(type(value) in (int, float) for value in values):
        raise TrajectoryError(f"{location}: point {k}: {key} is not a list of numbers")
    return values
