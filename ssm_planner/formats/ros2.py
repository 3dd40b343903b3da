"""Export a plan to ROS 2, and read rosbags.

An export contains a JointTrajectory as YAML, an action goal, and a rosbag2 (MCAP). The bag contains
the trajectory, joint states, the description of the robot, and transforms.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.errors import ExportError, TrajectoryError
from ssm_planner.formats.joint_trajectory import (
    FIELDS,
    TICKS,
    Message,
    controller_faults,
    read_message,
    split_time,
    trajectory_message,
    write_yaml,
)
from ssm_planner.formats.points import Reading
from ssm_planner.formats.spline_points import at_times, spline_points
from ssm_planner.formats.urdf import LINKS, TOOL, urdf
from ssm_planner.kinematics import rotation
from ssm_planner.loading.json_files import read_bytes
from ssm_planner.plans import Plan
from ssm_planner.problem import Robot
from ssm_planner.publishing import one_line
from ssm_planner.typing import Array, JsonObject
from ssm_planner.verification.certificate import Certificate

LARGEST_RATE = 1000.0
"""Largest rate of joint states, Hz."""
LARGEST_METADATA = 10_000_000
"""Largest size of metadata.yaml, bytes."""
INSTALL = "reading and writing rosbags needs the package rosbags: pip install 'ssm-planner[ros2]'"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
STATE = "sensor_msgs/msg/JointState"
PUBLISH = (
    "Publish this file with ros2 topic pub --once /joint_trajectory_controller/joint_trajectory",
    "trajectory_msgs/msg/JointTrajectory and --yaml-file, if this option exists. The message is "
    "too",
    "long for a command line. The bag holds the same message:",
    "ros2 bag play bag --topics /joint_trajectory --remap \\",
    "  /joint_trajectory:=/joint_trajectory_controller/joint_trajectory",
)


def export_ros2(
    plan: Plan,
    certificate: Certificate,
    folder: Path,
    suffix: str,
    rate: float = 100.0,
    effort: bool = False,
    bag: bool | None = None,
) -> JsonObject:
    """Write joint_trajectory.yaml, goal.yaml and a rosbag2, and return the entries of the manifest.

    Parameters
    ----------
    plan : Plan
    certificate : Certificate
        Certificate of the plan.
    folder : Path
    suffix : str
        Text that marks unverified files, before the extension.
    rate : float
        Rate of the joint states and transforms in the bag, Hz.
    effort : bool
        Include the rigid-body efforts. A controller without an effort interface rejects them.
    bag : bool, optional
        Write the bag. By default, the bag is written if the package rosbags is installed.

    Raises
    ------
    ExportError
        If the rate is out of range, no spline keeps the limits, or rosbags is missing for
        `bag=True`.
    """
    if not 0 < rate <= LARGEST_RATE:
        raise ExportError(
            f"the rate {rate:g} Hz is out of range (allowed: above 0, up to {LARGEST_RATE:g} Hz)"
        )
    points = spline_points(plan, certificate)
    message = trajectory_message(plan, points, effort)
    faults, remarks = controller_faults(message, [joint.name for joint in plan.robot.joints])
    if faults:
        raise ExportError(
            f"{plan.path}: joint_trajectory_controller would reject the trajectory: {faults[0]}"
        )
    name = f"joint_trajectory{suffix}.yaml"
    marks = (
        ["UNVERIFIED: the plan has no passed certificate; do not run it on a machine."]
        if suffix
        else []
    )
    marks += [
        f"Plan {one_line(plan.path.name)}, SHA-256 {plan.sha256}; rad, m, N*m, N.",
        points.note + ".",
    ]
    write_yaml(folder / name, message, [*marks, *PUBLISH], "")
    goal = f"goal{suffix}.yaml"
    write_yaml(
        folder / goal,
        message,
        [*marks, "Goal of control_msgs/action/FollowJointTrajectory."],
        "trajectory",
    )
    if bag is None and find_spec("rosbags") is None:
        remarks = [*remarks, f"no rosbag2 was written: {INSTALL}"]
    elif bag is not False:
        write_bag(folder / f"bag{suffix}", plan, message, rate)
    return {
        "trajectory": name,
        "rate_hz": rate,
        "units": {"revolute": "rad", "prismatic": "m", "effort": "N*m, N", "time": "s and ns"},
        "stretch": points.stretch,
        "spline": {
            "interpolation": points.certificate.interpolation,
            "certificate": points.certificate.to_dict(),
        },
        "notes": [points.note, *remarks],
    }


def write_bag(folder: Path, plan: Plan, message: Message, rate: float) -> None:
    """Write a rosbag2 folder whose times begin at 0.

    `rate` is the rate of joint states and transforms, Hz. Raises ExportError if the package rosbags
    is not installed.
    """
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise ExportError(
            f"a rosbag cannot be written: {INSTALL} (or export without it: --no-bag)"
        ) from error
    store = get_typestore(Stores.ROS2_HUMBLE)
    messages = _Messages(store.types)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:

        def topic(name: str, message_type: str, latched: bool = False) -> Any:
            profiles = [_latched()] if latched else []
            return writer.add_connection(
                name, message_type, typestore=store, offered_qos_profiles=profiles
            )

        def put(connection: Any, t: float, content: Any) -> None:
            sec, nanosec = split_time(t)
            writer.write(
                connection, sec * TICKS + nanosec, store.serialize_cdr(content, connection.msgtype)
            )

        description = topic("/robot_description", "std_msgs/msg/String", latched=True)
        put(description, 0.0, messages.make("std_msgs/String", data=urdf(plan.robot)))
        trajectory = topic("/joint_trajectory", TRAJECTORY)
        put(trajectory, 0.0, messages.trajectory(message))
        states = topic("/joint_states", STATE)
        transforms = topic("/tf", "tf2_msgs/msg/TFMessage")
        s = at_times(plan, plan.motion.breaks[0] + state_times(plan.motion.duration, rate))
        for k, t in enumerate(s.t - plan.motion.breaks[0]):
            put(states, t, messages.state(t, message.names, s.q[k], s.qd[k]))
            put(transforms, t, messages.transforms(t, link_poses(plan.robot, s.q[k])))


def state_times(duration: float, rate: float) -> Array:
    """Return instants (n,) at a rate in Hz, from 0 to the end of the motion, s."""
    t = np.arange(int(np.floor(duration * rate * (1 + 1e-12))) + 1) / rate
    return t if duration - t[-1] < 1e-9 else np.append(t, duration)


def link_poses(robot: Robot, q: Array) -> list[tuple[str, str, Array, Array]]:
    """Return the pose of every link and of the tool in the frame of its parent, at joints q (4,).

    Each entry contains the name of the parent, the name of the child, the rotation matrix (3, 3)
    and the translation (3,) in m.
    """
    geometry = robot.geometry
    parent = "base"
    frame = np.eye(3)
    poses = []
    for i, (link, body) in enumerate(zip(LINKS, robot.bodies, strict=True)):
        # parent ← child = (parent frame)ᵀ e^{ξ̂ q} (child frame), both frames as placed at q = 0
        turn = rotation(geometry.axes[i], q[i]) if i < 3 else np.eye(3)
        shift = np.zeros(3) if i < 3 else frame.T @ (geometry.axes[i] * q[i])
        poses.append((parent, link, frame.T @ turn @ body.frame, shift))
        parent = link
        frame = body.frame
    poses.append((parent, TOOL, frame.T @ geometry.tool_home, np.zeros(3)))
    return poses


class _Messages:
    """Builder of ROS messages from the classes of a type store."""

    def __init__(self, types: Any) -> None:
        self.types = types

    def make(self, message_type: str, **fields: Any) -> Any:
        """Build a message of a type such as std_msgs/String."""
        return self.types[message_type.replace("/", "/msg/")](**fields)

    def time(self, message_type: str, t: float) -> Any:
        sec, nanosec = split_time(t)
        return self.make(f"builtin_interfaces/{message_type}", sec=sec, nanosec=nanosec)

    def header(self, t: float, frame: str) -> Any:
        return self.make("std_msgs/Header", stamp=self.time("Time", t), frame_id=frame)

    def trajectory(self, message: Message) -> Any:
        points = [
            self.make(
                "trajectory_msgs/JointTrajectoryPoint",
                **{field: np.array(getattr(message, field)[k], dtype=float) for field in FIELDS},
                time_from_start=self.time("Duration", float(t)),
            )
            for k, t in enumerate(message.time)
        ]
        header = self.header(0.0, "base")
        names = list(message.names)
        return self.make(
            "trajectory_msgs/JointTrajectory", header=header, joint_names=names, points=points
        )

    def state(self, t: float, names: tuple[str, ...], q: Array, qd: Array) -> Any:
        moving = {"position": np.array(q), "velocity": np.array(qd), "effort": np.zeros(0)}
        return self.make(
            "sensor_msgs/JointState", header=self.header(t, "base"), name=list(names), **moving
        )

    def transforms(self, t: float, poses: list[tuple[str, str, Array, Array]]) -> Any:
        transforms = []
        for parent, child, orientation, shift in poses:
            transform = self.make(
                "geometry_msgs/Transform",
                translation=self.make(
                    "geometry_msgs/Vector3", **dict(zip("xyz", shift, strict=True))
                ),
                rotation=self.make(
                    "geometry_msgs/Quaternion",
                    **dict(zip("xyzw", quaternion(orientation), strict=True)),
                ),
            )
            header = self.header(t, parent)
            transforms.append(
                self.make(
                    "geometry_msgs/TransformStamped",
                    header=header,
                    child_frame_id=child,
                    transform=transform,
                )
            )
        return self.make("tf2_msgs/TFMessage", transforms=transforms)


def quaternion(orientation: Array) -> Array:
    """Return the unit quaternion (x, y, z, w) of a rotation matrix (3, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(orientation).as_quat()


def _latched() -> Any:
    """Return the quality of service that delivers the robot description to late subscribers."""
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    never = QosTime(2147483647, 4294967295)
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=1,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL,
        deadline=never,
        lifespan=never,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=never,
        avoid_ros_namespace_conventions=False,
    )


def read_rosbag(path: Path, robot: Robot) -> Reading:
    """Read the JointTrajectory of a rosbag2. If it has none, its joint states form the trajectory.

    Raises TrajectoryError if the bag cannot be read, or if it has different trajectories, because
    only one of them was run.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise TrajectoryError(f"{path}: {INSTALL}") from error
    folder = path if path.is_dir() else path.parent
    if not (folder / "metadata.yaml").is_file():
        raise TrajectoryError(
            f"{path}: not a rosbag2: metadata.yaml is missing (give the folder of the bag)"
        )
    read_bytes(folder / "metadata.yaml", LARGEST_METADATA)
    try:
        with AnyReader([folder], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            connections = {
                message_type: [c for c in reader.connections if c.msgtype == message_type]
                for message_type in (TRAJECTORY, STATE)
            }
            message_type = TRAJECTORY if connections[TRAJECTORY] else STATE
            selected = connections[message_type]
            # Without a list of connections, the reader would return all messages.
            raws = reader.messages(selected) if selected else iter(())
            messages = [reader.deserialize(raw, c.msgtype) for c, _, raw in raws]
            converted = (
                [_of_message(message) for message in messages]
                if message_type == TRAJECTORY
                else _of_states(messages)
            )
    except TrajectoryError as error:
        raise TrajectoryError(f"{path}: {error}") from error
    except (Exception, RecursionError) as error:  # rosbags raises many types for damaged bags.
        reason = f"{type(error).__name__}: {str(error)[:200]}"
        raise TrajectoryError(f"{path}: not a rosbag2 that can be read: {reason}") from error
    if not messages:
        raise TrajectoryError(f"{path}: the bag contains no JointTrajectory and no JointState")
    if isinstance(converted, Message):
        return read_message(
            converted, robot, str(path), ("the JointStates of the bag are its points",)
        )
    if any(_differ(converted[0], later) for later in converted[1:]):
        raise TrajectoryError(
            f"{path}: the bag contains {len(converted)} different JointTrajectory messages: only "
            "one motion can be checked"
        )
    notes = (
        () if len(converted) == 1 else (f"{len(converted)} JointTrajectory messages, all the same",)
    )
    return read_message(converted[0], robot, str(path), notes)


def _differ(message: Message, reference: Message) -> bool:
    if message.names != reference.names or not np.array_equal(message.time, reference.time):
        return True
    return any(
        len(a) != len(b) or any(not np.array_equal(x, y) for x, y in zip(a, b, strict=True))
        for a, b in ((getattr(message, key), getattr(reference, key)) for key in FIELDS)
    )


def _of_message(message: Any) -> Message:
    time = [
        (p.time_from_start.sec * TICKS + p.time_from_start.nanosec) / TICKS for p in message.points
    ]
    fields = [[getattr(p, key) for p in message.points] for key in FIELDS]
    return Message(tuple(message.joint_names), np.array(time), *fields)


def _of_states(messages: list[Any]) -> Message | list[Message]:
    """Build a message from joint states, each of which may have its own order of joints.

    Raises TrajectoryError if their joints or the lengths of their lists differ.
    """
    if not messages:
        return []
    names = tuple(messages[0].name)
    stamps = [m.header.stamp.sec * TICKS + m.header.stamp.nanosec for m in messages]
    empty: list[Sequence[float]] = [[] for _ in messages]
    fields: dict[str, list[Sequence[float]]] = {"position": [], "velocity": []}
    for k, message in enumerate(messages):
        joints = list(message.name)
        if sorted(joints) != sorted(names) or len(set(joints)) != len(joints):
            raise TrajectoryError(
                f"JointState {k} has other joints ({', '.join(joints)[:80]}) than the first"
            )
        order = [joints.index(name) for name in names]
        for key, values in fields.items():
            entries = getattr(message, key)
            if len(entries) not in ({len(joints)} if key == "position" else {0, len(joints)}):
                raise TrajectoryError(
                    f"JointState {k}: {len(entries)} values of {key} for {len(joints)} joints"
                )
            values.append(np.asarray(entries)[order].tolist() if len(entries) else [])
    return Message(
        names,
        np.array([(stamp - stamps[0]) / TICKS for stamp in stamps]),
        positions=fields["position"],
        velocities=fields["velocity"],
        accelerations=empty,
        effort=empty,
    )
