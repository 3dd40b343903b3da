"""A plan for ROS 2: JointTrajectory as YAML and as action goal, and a rosbag2 (MCAP) that shows the motion; bags read.

A bag holds the trajectory, joint states, the robot's description and its transforms.
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
from ssm_planner.kinematics.rotations import rotation
from ssm_planner.loading.json_files import read_bytes
from ssm_planner.plans import Plan
from ssm_planner.problem.robot import Robot
from ssm_planner.publishing import one_line
from ssm_planner.typing import Array
from ssm_planner.verification.certificate import Certificate

LARGEST_RATE = 1000.0
LARGEST_METADATA = 10_000_000
"""Bytes."""
INSTALL = "reading and writing rosbags needs the package rosbags: pip install 'ssm-planner[ros2]'"
TRAJECTORY, STATE = "trajectory_msgs/msg/JointTrajectory", "sensor_msgs/msg/JointState"
PUBLISH = (
    "For ros2 topic pub --once /joint_trajectory_controller/joint_trajectory trajectory_msgs/msg/JointTrajectory, with",
    "--yaml-file where that option exists. Too long for a command line; the bag holds the same message:",
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
) -> dict[str, Any]:
    """Write joint_trajectory.yaml, goal.yaml and, with `bag`, a rosbag2 (MCAP); returns what the manifest says.

    rate: of the bag's joint states and transforms, Hz. effort: give the rigid-body efforts too, which a controller
    without an effort interface rejects. bag: None leaves it out where the package rosbags is missing, and says so. Raises
    ExportError.
    """
    if not 0 < rate <= LARGEST_RATE:
        raise ExportError(f"a rate of {rate:g} Hz (allowed: above 0, up to {LARGEST_RATE:g} Hz)")
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
    """Write a rosbag2 folder; times count from 0. Raises ExportError where the package rosbags is missing."""
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise ExportError(
            f"a rosbag cannot be written: {INSTALL} (or leave it out with --no-bag)"
        ) from error
    store = get_typestore(Stores.ROS2_HUMBLE)
    messages = _Messages(store.types)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:

        def topic(name: str, kind: str, latched: bool = False) -> Any:
            profiles = [_latched()] if latched else []
            return writer.add_connection(name, kind, typestore=store, offered_qos_profiles=profiles)

        def put(connection: Any, t: float, content: Any) -> None:
            sec, nanosec = split_time(t)
            writer.write(
                connection, sec * TICKS + nanosec, store.serialize_cdr(content, connection.msgtype)
            )

        description = topic("/robot_description", "std_msgs/msg/String", latched=True)
        put(description, 0.0, messages.make("std_msgs/String", data=urdf(plan.robot)))
        trajectory = topic("/joint_trajectory", TRAJECTORY)
        put(trajectory, 0.0, messages.trajectory(message))
        states, transforms = topic("/joint_states", STATE), topic("/tf", "tf2_msgs/msg/TFMessage")
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
        """kind: such as std_msgs/String."""
        return self.types[kind.replace("/", "/msg/")](**fields)

    def time(self, kind: str, t: float) -> Any:
        sec, nanosec = split_time(t)
        return self.make(f"builtin_interfaces/{kind}", sec=sec, nanosec=nanosec)

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
        header, names = self.header(0.0, "base"), list(message.names)
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
        for parent, child, turned, shift in poses:
            transform = self.make(
                "geometry_msgs/Transform",
                translation=self.make(
                    "geometry_msgs/Vector3", **dict(zip("xyz", shift, strict=True))
                ),
                rotation=self.make(
                    "geometry_msgs/Quaternion", **dict(zip("xyzw", quaternion(turned), strict=True))
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


def quaternion(turned: Array) -> Array:
    """Unit quaternion (x, y, z, w) of a rotation matrix (3, 3)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(turned).as_quat())


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
        raise TrajectoryError(
            f"{path}: not a rosbag2: no metadata.yaml beside it (give the bag's folder)"
        )
    read_bytes(folder / "metadata.yaml", LARGEST_METADATA)
    try:
        with AnyReader([folder], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            found = {
                kind: [c for c in reader.connections if c.msgtype == kind]
                for kind in (TRAJECTORY, STATE)
            }
            kind = TRAJECTORY if found[TRAJECTORY] else STATE
            wanted = found[kind]
            # without connections the reader gives the messages of all
            raws = reader.messages(wanted) if wanted else iter(())
            messages = [reader.deserialize(raw, c.msgtype) for c, _, raw in raws]
            converted = (
                [_of_message(message) for message in messages]
                if kind == TRAJECTORY
                else _of_states(messages)
            )
    except TrajectoryError as error:
        raise TrajectoryError(f"{path}: {error}") from error
    except (
        Exception,
        RecursionError,
    ) as error:  # of damaged bags the package raises whatever it meets
        what = f"{type(error).__name__}: {str(error)[:200]}"
        raise TrajectoryError(f"{path}: not a rosbag2 that can be read: {what}") from error
    if not messages:
        raise TrajectoryError(f"{path}: holds neither a JointTrajectory nor JointStates")
    if isinstance(converted, Message):
        return read_message(
            converted, robot, str(path), ("the JointStates of the bag are its points",)
        )
    if any(_differ(converted[0], other) for other in converted[1:]):
        raise TrajectoryError(
            f"{path}: holds {len(converted)} JointTrajectory messages that are not the same: a check takes one motion"
        )
    notes = (
        () if len(converted) == 1 else (f"{len(converted)} JointTrajectory messages, all the same",)
    )
    return read_message(converted[0], robot, str(path), notes)


def _differ(one: Message, other: Message) -> bool:
    if one.names != other.names or not np.array_equal(one.time, other.time):
        return True
    return any(
        len(a) != len(b) or any(not np.array_equal(x, y) for x, y in zip(a, b, strict=True))
        for a, b in ((getattr(one, key), getattr(other, key)) for key in FIELDS)
    )


def _of_message(message: Any) -> Message:
    time = [
        (p.time_from_start.sec * TICKS + p.time_from_start.nanosec) / TICKS for p in message.points
    ]
    fields = [[getattr(p, key) for p in message.points] for key in FIELDS]
    return Message(tuple(message.joint_names), np.array(time), *fields)


def _of_states(messages: list[Any]) -> Message | list[Message]:
    """Each message may list the joints in an order of its own. Raises TrajectoryError."""
    if not messages:
        return []
    names = tuple(messages[0].name)
    stamps = [m.header.stamp.sec * TICKS + m.header.stamp.nanosec for m in messages]
    empty: list[Sequence[float]] = [[] for _ in messages]
    fields: dict[str, list[Sequence[float]]] = {"position": [], "velocity": []}
    for k, message in enumerate(messages):
        own = list(message.name)
        if sorted(own) != sorted(names) or len(set(own)) != len(own):
            raise TrajectoryError(
                f"JointState {k} is of other joints ({', '.join(own)[:80]}) than the first"
            )
        order = [own.index(name) for name in names]
        for key, values in fields.items():
            given = getattr(message, key)
            if len(given) not in ({len(own)} if key == "position" else {0, len(own)}):
                raise TrajectoryError(
                    f"JointState {k}: {len(given)} values of {key} for {len(own)} joints"
                )
            values.append(np.asarray(given)[order].tolist() if len(given) else [])
    return Message(
        names,
        np.array([(stamp - stamps[0]) / TICKS for stamp in stamps]),
        positions=fields["position"],
        velocities=fields["velocity"],
        accelerations=empty,
        effort=empty,
    )
