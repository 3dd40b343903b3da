"""A plan as rosbag2 in MCAP: the trajectory, joint states, the robot's description and its transforms."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.errors import ExportError, TrajectoryError
from ssm_planner.formats.joint_trajectory import (
    FIELDS,
    INSTALL,
    Message,
    read_message,
    split_time,
)
from ssm_planner.formats.points import Reading
from ssm_planner.formats.spline_points import at_times
from ssm_planner.formats.urdf import LINKS, TOOL, urdf
from ssm_planner.kinematics.rotations import rotation
from ssm_planner.loading.json_files import read_bytes
from ssm_planner.plans import Plan
from ssm_planner.problem.robot import Robot
from ssm_planner.typing import Array


def write_bag(folder: Path, plan: Plan, message: Message, rate: float) -> None:
    """Write a rosbag2 folder; times count from 0. Raises ExportError where the package rosbags is missing."""
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise ExportError(f"a rosbag cannot be written: {INSTALL} (or leave it out with --no-bag)") from error
    store = get_typestore(Stores.ROS2_HUMBLE)
    messages = _Messages(store.types)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:

        def topic(name: str, kind: str, latched: bool = False) -> Any:
            profiles = [_latched()] if latched else []
            return writer.add_connection(name, kind, typestore=store, offered_qos_profiles=profiles)

        def put(connection: Any, t: float, content: Any) -> None:
            sec, nanosec = split_time(t)
            writer.write(connection, sec * 10**9 + nanosec, store.serialize_cdr(content, connection.msgtype))

        description = topic("/robot_description", "std_msgs/msg/String", latched=True)
        put(description, 0.0, messages.make("std_msgs/msg/String", data=urdf(plan.robot)))
        trajectory = topic("/joint_trajectory", "trajectory_msgs/msg/JointTrajectory")
        put(trajectory, 0.0, messages.trajectory(message))
        states, transforms = (
            topic("/joint_states", "sensor_msgs/msg/JointState"),
            topic("/tf", "tf2_msgs/msg/TFMessage"),
        )
        s = at_times(plan, plan.motion.breaks[0] + state_times(plan.motion.duration, rate))
        for k, t in enumerate(s.t - plan.motion.breaks[0]):
            put(states, t, messages.state(t, message.names, s.q[k], s.qd[k]))
            put(transforms, t, messages.transforms(t, link_poses(plan.robot, s.q[k])))


def state_times(duration: float, rate: float) -> Array:
    """Instants (n,), s, at a rate in Hz from 0, and the end."""
    t = np.arange(int(np.floor(duration * rate * (1 + 1e-12))) + 1) / rate
    return t if duration - t[-1] < 1e-9 else np.append(t, duration)


def link_poses(robot: Robot, q: Array) -> list[tuple[str, str, Array, Array]]:
    """(parent, child, rotation, translation) of every link and of the tool at joints q (4,)."""
    geometry, parent, frame = robot.geometry, "base", np.eye(3)
    axes = (geometry.omega1, geometry.omega2, geometry.omega3, geometry.omega3)
    poses = []
    for i, (link, body) in enumerate(zip(LINKS, robot.bodies, strict=True)):
        # parent ← child = (parent frame)ᵀ e^{ξ̂ q} (child frame), both frames as placed at q = 0
        turn = rotation(axes[i], q[i]) if i < 3 else np.eye(3)
        shift = np.zeros(3) if i < 3 else frame.T @ (axes[i] * q[i])
        poses.append((parent, link, frame.T @ turn @ body.frame, shift))
        parent, frame = link, body.frame
    poses.append((parent, TOOL, frame.T @ geometry.tool_home, np.zeros(3)))
    return poses


class _Messages:
    """ROS messages from the type store's classes."""

    def __init__(self, types: Any) -> None:
        self.types = types

    def make(self, kind: str, **fields: Any) -> Any:
        return self.types[kind](**fields)

    def stamp(self, t: float) -> Any:
        sec, nanosec = split_time(t)
        return self.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)

    def header(self, t: float, frame: str) -> Any:
        return self.make("std_msgs/msg/Header", stamp=self.stamp(t), frame_id=frame)

    def trajectory(self, message: Message) -> Any:
        points = []
        for k, t in enumerate(message.time):
            sec, nanosec = split_time(float(t))
            points.append(
                self.make(
                    "trajectory_msgs/msg/JointTrajectoryPoint",
                    positions=np.array(message.positions[k], dtype=float),
                    velocities=np.array(message.velocities[k], dtype=float),
                    accelerations=np.array(message.accelerations[k], dtype=float),
                    effort=np.array(message.effort[k], dtype=float),
                    time_from_start=self.make("builtin_interfaces/msg/Duration", sec=sec, nanosec=nanosec),
                )
            )
        return self.make(
            "trajectory_msgs/msg/JointTrajectory",
            header=self.header(0.0, "base"),
            joint_names=list(message.names),
            points=points,
        )

    def state(self, t: float, names: tuple[str, ...], q: Array, qd: Array) -> Any:
        return self.make(
            "sensor_msgs/msg/JointState",
            header=self.header(t, "base"),
            name=list(names),
            position=np.array(q),
            velocity=np.array(qd),
            effort=np.zeros(0),
        )

    def transforms(self, t: float, poses: list[tuple[str, str, Array, Array]]) -> Any:
        transforms = []
        for parent, child, turned, shift in poses:
            x, y, z, w = quaternion(turned)
            transform = self.make(
                "geometry_msgs/msg/Transform",
                translation=self.make("geometry_msgs/msg/Vector3", x=shift[0], y=shift[1], z=shift[2]),
                rotation=self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w),
            )
            transforms.append(
                self.make(
                    "geometry_msgs/msg/TransformStamped",
                    header=self.header(t, parent),
                    child_frame_id=child,
                    transform=transform,
                )
            )
        return self.make("tf2_msgs/msg/TFMessage", transforms=transforms)


def quaternion(r: Array) -> Array:
    """Unit quaternion (x, y, z, w) of a rotation matrix, by its largest component (Shepperd)."""
    squares = np.array([1 + 2 * r[i, i] - np.trace(r) for i in range(3)] + [1 + np.trace(r)])
    k = int(np.argmax(squares))
    out = np.empty(4)
    out[k] = squares[k]
    odd = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    if k == 3:
        out[:3] = odd
    else:
        for j in range(3):
            out[j] = squares[k] if j == k else r[j, k] + r[k, j]
        out[3] = odd[k]
    return np.asarray(out / np.linalg.norm(out))


def _latched() -> Any:
    """The quality of service by which late subscribers still get the robot's description."""
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


LARGEST_METADATA = 10_000_000
"""Bytes."""
TRAJECTORY, STATE = "trajectory_msgs/msg/JointTrajectory", "sensor_msgs/msg/JointState"


def read_rosbag(path: Path, robot: Robot) -> Reading:
    """The JointTrajectory of a rosbag2, or else its JointStates. Raises TrajectoryError.

    A bag with different trajectories is refused: which one a controller ran is not known.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise TrajectoryError(f"{path}: {INSTALL}") from error
    folder = path if path.is_dir() else path.parent
    if not (folder / "metadata.yaml").is_file():
        raise TrajectoryError(f"{path}: not a rosbag2: no metadata.yaml beside it (give the bag's folder)")
    read_bytes(folder / "metadata.yaml", LARGEST_METADATA)
    try:
        with AnyReader([folder], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            found = {kind: [c for c in reader.connections if c.msgtype == kind] for kind in (TRAJECTORY, STATE)}
            kind = TRAJECTORY if found[TRAJECTORY] else STATE
            wanted = found[kind]
            # without connections the reader gives the messages of all
            raws = reader.messages(wanted) if wanted else iter(())
            messages = [reader.deserialize(raw, c.msgtype) for c, _, raw in raws]
            converted = [_of_message(message) for message in messages] if kind == TRAJECTORY else _of_states(messages)
    except TrajectoryError as error:
        raise TrajectoryError(f"{path}: {error}") from error
    except (Exception, RecursionError) as error:  # of damaged bags the package raises whatever it meets
        what = f"{type(error).__name__}: {str(error)[:200]}"
        raise TrajectoryError(f"{path}: not a rosbag2 that can be read: {what}") from error
    if not messages:
        raise TrajectoryError(f"{path}: holds neither a JointTrajectory nor JointStates")
    if isinstance(converted, Message):
        return read_message(converted, robot, str(path), ("the JointStates of the bag are its points",))
    if any(_differ(converted[0], other) for other in converted[1:]):
        raise TrajectoryError(
            f"{path}: holds {len(converted)} JointTrajectory messages that are not the same: a check takes one motion"
        )
    notes = () if len(converted) == 1 else (f"{len(converted)} JointTrajectory messages, all the same",)
    return read_message(converted[0], robot, str(path), notes)


def _differ(one: Message, other: Message) -> bool:
    if one.names != other.names or not np.array_equal(one.time, other.time):
        return True
    return any(
        len(a) != len(b) or any(not np.array_equal(x, y) for x, y in zip(a, b, strict=True))
        for a, b in ((getattr(one, key), getattr(other, key)) for key in FIELDS)
    )


def _of_message(message: Any) -> Message:
    time = [(p.time_from_start.sec * 10**9 + p.time_from_start.nanosec) / 1e9 for p in message.points]
    fields = [[getattr(p, key) for p in message.points] for key in FIELDS]
    return Message(tuple(message.joint_names), np.array(time), *fields)


def _of_states(messages: list[Any]) -> Message | list[Message]:
    """Each message may list the joints in an order of its own. Raises TrajectoryError."""
    if not messages:
        return []
    names = tuple(messages[0].name)
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in messages]
    empty: list[Sequence[float]] = [[] for _ in messages]
    fields: dict[str, list[Sequence[float]]] = {"position": [], "velocity": []}
    for k, message in enumerate(messages):
        own = list(message.name)
        if sorted(own) != sorted(names) or len(set(own)) != len(own):
            raise TrajectoryError(f"JointState {k} is of other joints ({', '.join(own)[:80]}) than the first")
        order = [own.index(name) for name in names]
        for key, values in fields.items():
            given = getattr(message, key)
            if len(given) not in ({len(own)} if key == "position" else {0, len(own)}):
                raise TrajectoryError(f"JointState {k}: {len(given)} values of {key} for {len(own)} joints")
            values.append(np.asarray(given)[order].tolist() if len(given) else [])
    return Message(
        names,
        np.array([(stamp - stamps[0]) / 1e9 for stamp in stamps]),
        positions=fields["position"],
        velocities=fields["velocity"],
        accelerations=empty,
        effort=empty,
    )
