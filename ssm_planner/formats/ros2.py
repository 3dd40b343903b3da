"""Export a plan to ROS 2, and read rosbags.

`export_ros2` writes a JointTrajectory as YAML, an action goal, and a rosbag2 (MCAP). The bag
contains the trajectory, joint states, the description of the robot, and transforms. `read_ros2`
reads such an export, and `read_rosbag` reads a bag of any origin. The module `joint_trajectory`
contains the conversion of the messages.
"""

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import numpy as np

from ssm_planner.errors import ExportError, TrajectoryError
from ssm_planner.formats.agreement import (
    UNVERIFIED_WARNING,
    ExportContent,
    file_name_suffix,
    first_difference,
    read_rate,
)
from ssm_planner.formats.joint_trajectory import (
    NANOSECONDS_PER_SECOND,
    POINT_FIELDS,
    TrajectoryMessage,
    controller_rejections,
    interpolate_message,
    joint_efforts,
    read_yaml_content,
    read_yaml_message,
    split_time,
    trajectory_message,
    yaml_text,
)
from ssm_planner.formats.points import Reading
from ssm_planner.formats.spline_points import spline_points
from ssm_planner.formats.urdf import LINK_NAMES, TOOL_FRAME, robot_urdf
from ssm_planner.kinematics import rotation as rotation_matrix
from ssm_planner.loading.json_files import read_bytes
from ssm_planner.plans import Plan
from ssm_planner.problem import Robot, to_plain
from ssm_planner.publishing import one_line
from ssm_planner.typing import Array, JsonObject
from ssm_planner.verification import Certificate

LARGEST_STATE_RATE = 1000.0
"""Largest rate of joint states, Hz."""
LARGEST_METADATA = 10_000_000
"""Largest size of metadata.yaml, bytes."""
INSTALL_HINT = (
    "reading and writing rosbags needs the package rosbags: pip install 'ssm-planner[ros2]'"
)
"""Hint for the user if the optional package rosbags is missing."""
TRAJECTORY_TYPE = "trajectory_msgs/msg/JointTrajectory"
"""Type of a trajectory message in ROS 2."""
STATE_TYPE = "sensor_msgs/msg/JointState"
"""Type of a joint state message in ROS 2."""
PUBLISH_COMMENT = (
    "Publish this file with ros2 topic pub --once /joint_trajectory_controller/joint_trajectory",
    "trajectory_msgs/msg/JointTrajectory and --yaml-file, if this option exists. The message is "
    "too",
    "long for a command line. The bag holds the same message:",
    "ros2 bag play bag --topics /joint_trajectory --remap \\",
    "  /joint_trajectory:=/joint_trajectory_controller/joint_trajectory",
)
"""Comment lines in joint_trajectory.yaml that explain how to publish the message."""
GOAL_COMMENT = "Goal of control_msgs/action/FollowJointTrajectory."
"""Comment line in goal.yaml."""


def export_ros2(
    plan: Plan,
    certificate: Certificate,
    folder: Path,
    suffix: str,
    rate: float = 100.0,
    effort: bool = False,
    bag: bool | None = None,
    rigid_effort: bool = False,
) -> JsonObject:
    """Write joint_trajectory.yaml, goal.yaml and a rosbag2, and return the entries of the manifest.

    Parameters
    ----------
    plan : Plan
        Plan that is exported.
    certificate : Certificate
        Certificate of the plan.
    folder : Path
        Export folder.
    suffix : str
        Text before the extension of all file names: "" for a verified plan, or "_unverified".
    rate : float
        Rate of the joint states and transforms in the bag, Hz.
    effort : bool
        True to include efforts: the motor torque with exact friction, times the ratio of the drive.
        A controller without an effort interface rejects them.
    bag : bool, optional
        True to write the bag. By default, the bag is written if the package rosbags is installed.
    rigid_effort : bool
        True to include the efforts that move the rigid bodies instead, without drives and friction.

    Returns
    -------
    dict
        Entries that this format adds to the manifest, among them notes for the user.

    Raises
    ------
    ExportError
        If the rate is out of range, no spline keeps the limits, or rosbags is missing for
        `bag=True`.
    """
    if not 0 < rate <= LARGEST_STATE_RATE:
        raise ExportError(
            f"the rate {rate:g} Hz is out of range (allowed: above 0, up to "
            f"{LARGEST_STATE_RATE:g} Hz)"
        )
    law = partial(joint_efforts, plan.robot, rigid_effort) if effort or rigid_effort else None
    points = spline_points(plan, certificate, law=law)
    message = trajectory_message(plan, points, law)
    faults, remarks = controller_rejections(message, [joint.name for joint in plan.robot.joints])
    if faults:
        raise ExportError(
            f"{plan.path}: joint_trajectory_controller would reject the trajectory: {faults[0]}"
        )
    if bag is None and find_spec("rosbags") is None:
        remarks.append(f"no rosbag2 was written: {INSTALL_HINT}")
    elif bag is not False:
        write_bag(folder / f"bag{suffix}", plan.robot, message, rate)
    marks = []
    if suffix:
        marks.append(f"{UNVERIFIED_WARNING}.")
    marks.append(f"Plan {one_line(plan.path.name)}, SHA-256 {plan.sha256}; rad, m, N*m, N.")
    marks.append(f"{points.note}.")
    return {
        **_yaml_export(message, rate, suffix, tuple(marks)).write(folder),
        "stretch": points.stretch,
        "spline": {
            "interpolation": points.certificate.interpolation,
            "certificate": points.certificate.to_dict(),
        },
        "notes": [points.note] + remarks,
    }


def _yaml_export(
    message: TrajectoryMessage, rate: float, suffix: str, marks: tuple[str, ...] = ()
) -> ExportContent:
    """Return the two YAML files of an export and their entries of the manifest.

    The first file contains a JointTrajectory message, and the second file a goal with the same
    message for the action FollowJointTrajectory.

    Parameters
    ----------
    message : TrajectoryMessage
        Message with the points of the motion.
    rate : float
        Rate of the joint states in the bag, Hz.
    suffix : str
        Text before the extension of all file names: "" for a verified plan, or "_unverified".
    marks : tuple of str
        Comments at the beginning of each file.

    Returns
    -------
    ExportContent
        Texts of both files, and the entries trajectory, rate_hz and units of the manifest.
    """
    name = f"joint_trajectory{suffix}.yaml"
    return ExportContent(
        {
            "trajectory": name,
            "rate_hz": rate,
            "units": {"revolute": "rad", "prismatic": "m", "effort": "N*m, N", "time": "s and ns"},
        },
        {
            name: yaml_text(message, marks + PUBLISH_COMMENT, ""),
            f"goal{suffix}.yaml": yaml_text(message, marks + (GOAL_COMMENT,), "trajectory"),
        },
    )


def read_ros2(folder: Path, manifest: JsonObject, names: Collection[str], robot: Robot) -> Reading:
    """Read the JointTrajectory of an export, and check that its rosbag2 contains the same message.

    The check writes a bag for the message again and compares both bags.

    Parameters
    ----------
    folder : Path
        Export folder.
    manifest : dict
        Content of the manifest.json of the folder.
    names : Collection[str]
        Files of the manifest whose content is unchanged since the export.
    robot : Robot
        Robot that performs the motion.

    Returns
    -------
    Reading
        Trajectory of the message, and the content that the folder must have.

    Raises
    ------
    TrajectoryError
        If a file is damaged, the bag differs, or the package rosbags is missing although the export
        contains a bag.
    """
    suffix = file_name_suffix(manifest)
    path = folder / f"joint_trajectory{suffix}.yaml"
    if path.name not in names:
        raise TrajectoryError(f"{folder}: the manifest does not list {path.name}")
    message = read_yaml_message(path)
    reading = interpolate_message(message, robot, str(path))
    rate = read_rate(folder, manifest, LARGEST_STATE_RATE)
    content = _yaml_export(message, rate, suffix)
    bag = f"bag{suffix}"
    in_bag = {name for name in names if name.startswith(f"{bag}/")}
    if in_bag:
        with TemporaryDirectory() as temporary:
            expected = Path(temporary) / bag
            bag_content = _bag_content(folder / bag)
            write_bag(expected, robot, message, rate)
            fault = first_difference(bag_content, _bag_content(expected), bag)
            if fault:
                raise TrajectoryError(f"{folder}: changed after the export: {fault}")
            in_bag = {f"{bag}/{file.name}" for file in expected.iterdir()}
    files = {**content.files, **dict.fromkeys(in_bag)}
    return replace(reading, content=ExportContent(content.entries, files))


def _bag_content(folder: Path) -> JsonObject:
    """Return the metadata and the messages of a rosbag2 for a comparison.

    A rosbag2 is a folder with recorded ROS 2 messages. Raises TrajectoryError if it cannot be read.

    Parameters
    ----------
    folder : Path
        Folder of the bag.

    Returns
    -------
    dict
        Content of metadata.yaml under "metadata". "messages" is a list with the topic, the time in
        ns and the fields of each message.
    """
    with _bag_reader(folder) as reader:
        messages = [
            [connection.topic, time, to_plain(reader.deserialize(raw, connection.msgtype))]
            for connection, time, raw in reader.messages()
        ]
    return {"metadata": read_yaml_content(folder / "metadata.yaml"), "messages": messages}


def write_bag(folder: Path, robot: Robot, message: TrajectoryMessage, rate: float) -> None:
    """Write a rosbag2 folder whose times begin at 0.

    Parameters
    ----------
    folder : Path
        Folder of the bag, which must not exist.
    robot : Robot
        Robot whose description and transforms the bag contains.
    message : TrajectoryMessage
        Trajectory message. The states and transforms are those of a controller that executes it.
    rate : float
        Rate of the states and transforms, Hz.

    Raises
    ------
    ExportError
        If the package rosbags is not installed.
    """
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise ExportError(
            f"a rosbag cannot be written: {INSTALL_HINT} (or export without it: --no-bag)"
        ) from error
    store = get_typestore(Stores.ROS2_HUMBLE)
    samples = interpolate_message(message, robot, str(folder)).trajectory.uniform(rate)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:

        def topic(name: str, message_type: str, latched: bool = False) -> Any:
            """Add a topic to the bag, and return its connection.

            Subscribers of a latched topic also receive messages from before their subscription.
            """
            profiles = [_latched_qos()] if latched else []
            return writer.add_connection(
                name, message_type, typestore=store, offered_qos_profiles=profiles
            )

        def put(connection: Any, t: float, content: Any) -> None:
            """Write a message at time t, s."""
            data = store.serialize_cdr(content, connection.msgtype)
            writer.write(connection, round(t * NANOSECONDS_PER_SECOND), data)

        description = topic("/robot_description", "std_msgs/msg/String", latched=True)
        put(description, 0.0, SimpleNamespace(data=robot_urdf(robot)))
        put(topic("/joint_trajectory", TRAJECTORY_TYPE), 0.0, _ros_trajectory(message))
        states = topic("/joint_states", STATE_TYPE)
        transforms = topic("/tf", "tf2_msgs/msg/TFMessage")
        times = samples.t - samples.t[0]
        for t, q, qd in zip(times.tolist(), samples.q, samples.qd, strict=True):
            put(states, t, _ros_joint_state(t, message.names, q, qd))
            put(transforms, t, _ros_transforms(t, link_poses(robot, q)))


def _ros_trajectory(message: TrajectoryMessage) -> Any:
    """Convert a message to an object with the fields of a JointTrajectory in ROS 2.

    Parameters
    ----------
    message : TrajectoryMessage
        Message that is converted.

    Returns
    -------
    object
        Object with the fields of the ROS 2 message as attributes.
    """
    points = []
    for k, t in enumerate(message.time):
        fields = {name: np.array(getattr(message, name)[k], dtype=float) for name in POINT_FIELDS}
        points.append(SimpleNamespace(time_from_start=_ros_time(float(t)), **fields))
    return SimpleNamespace(
        header=_ros_header(0.0, "base"), joint_names=list(message.names), points=points
    )


def _ros_joint_state(t: float, names: Sequence[str], q: Array, qd: Array) -> Any:
    """Build a JointState message of ROS 2 without efforts.

    Parameters
    ----------
    t : float
        Time of the state, s.
    names : sequence of str
        Names of the joints.
    q, qd : (4,) arrays
        Positions (rad, m) and velocities (rad/s, m/s) of the joints.

    Returns
    -------
    object
        Object with the fields of the message as attributes.
    """
    return SimpleNamespace(
        header=_ros_header(t, "base"),
        name=list(names),
        position=np.array(q),
        velocity=np.array(qd),
        effort=np.zeros(0),
    )


def _ros_time(t: float) -> Any:
    """Convert a time in s to the fields of a Time or Duration in ROS 2."""
    sec, nanosec = split_time(t)
    return SimpleNamespace(sec=sec, nanosec=nanosec)


def _ros_header(t: float, frame: str) -> Any:
    """Build the header of a message at time t (s) in a coordinate frame."""
    return SimpleNamespace(stamp=_ros_time(t), frame_id=frame)


def _ros_transforms(t: float, poses: Iterator[tuple[str, str, Array, Array]]) -> Any:
    """Build the TFMessage of ROS 2 with the poses of all links at one time.

    Parameters
    ----------
    t : float
        Time of the poses, s.
    poses : iterator
        Result of `link_poses`: names of parent and child, rotation and translation of each link.

    Returns
    -------
    object
        Object with the fields of the message as attributes.
    """
    transforms = []
    for parent, child, turn, shift in poses:
        translation = SimpleNamespace(**dict(zip("xyz", shift, strict=True)))
        rotation = SimpleNamespace(**dict(zip("xyzw", quaternion(turn), strict=True)))
        transforms.append(
            SimpleNamespace(
                header=_ros_header(t, parent),
                child_frame_id=child,
                transform=SimpleNamespace(translation=translation, rotation=rotation),
            )
        )
    return SimpleNamespace(transforms=transforms)


def link_poses(robot: Robot, q: Array) -> Iterator[tuple[str, str, Array, Array]]:
    """Yield the pose of every link and of the tool relative to its parent link.

    Parameters
    ----------
    robot : Robot
        Robot with the geometry and the frames of the bodies.
    q : (4,) array
        Positions of joints 1 to 3 in rad, and of joint 4 in m.

    Yields
    ------
    parent, child : str
        Names of the two links.
    rotation : (3, 3) array
        Rotation parent ← child.
    translation : (3,) array
        Origin of the child in the frame of the parent, m.
    """
    geometry = robot.geometry
    parent = "base"
    frame = np.eye(3)
    for i, (link, body) in enumerate(zip(LINK_NAMES, robot.bodies, strict=True)):
        # The rotation parent ← child is (parent frame)ᵀ · R(axis, q) · (child frame), where both
        # frames are those at q = 0. Joints 1 to 3 turn, and joint 4 slides.
        turn = rotation_matrix(geometry.axes[i], q[i]) if i < 3 else np.eye(3)
        shift = np.zeros(3) if i < 3 else frame.T @ (geometry.axes[i] * q[i])
        yield parent, link, frame.T @ turn @ body.frame, shift
        parent = link
        frame = body.frame
    yield parent, TOOL_FRAME, frame.T @ geometry.tool_home, np.zeros(3)


def quaternion(orientation: Array) -> Array:
    """Return the unit quaternion (x, y, z, w) of a rotation matrix (3, 3)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(orientation).as_quat()


def _latched_qos() -> Any:
    """Return the quality of service with which ROS 2 delivers a message also to later subscribers.

    The robot description needs it, because programs usually subscribe after its publication.
    """
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    # ROS 2 encodes an infinite duration as the largest int32 (s) and the largest uint32 (ns).
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
    """Read the motion in a rosbag2, a folder with recorded ROS 2 messages.

    The motion is the JointTrajectory of the bag. If the bag contains no JointTrajectory, it is the
    sequence of joint states.

    Parameters
    ----------
    path : Path
        Folder of the bag, or a file in it.
    robot : Robot
        Robot with the joints of the messages.

    Returns
    -------
    Reading
        Trajectory that a controller executes for the JointTrajectory, or the trajectory through the
        joint states.

    Raises
    ------
    TrajectoryError
        If the bag cannot be read, or if it contains different trajectories, because only one of
        them can be checked.
    """
    with _bag_reader(path) as reader:
        message_types = [connection.msgtype for connection in reader.connections]
        selected_type = TRAJECTORY_TYPE if TRAJECTORY_TYPE in message_types else STATE_TYPE
        selected = [c for c in reader.connections if c.msgtype == selected_type]
        # Without a list of connections, the reader would return all messages.
        raws = reader.messages(selected) if selected else ()
        messages = [reader.deserialize(raw, selected_type) for _, _, raw in raws]
        if not messages:
            raise TrajectoryError("the bag contains no JointTrajectory and no JointState")
        if selected_type == STATE_TYPE:
            converted = [_message_from_states(messages)]
            notes = ["the JointStates of the bag are its points"]
        else:
            converted = [_message_from_ros(message) for message in messages]
            notes = []
    if any(
        first_difference(to_plain(later), to_plain(converted[0]), "") for later in converted[1:]
    ):
        raise TrajectoryError(
            f"{path}: the bag contains {len(converted)} different JointTrajectory messages: only "
            "one motion can be checked"
        )
    if len(converted) > 1:
        notes.append(f"{len(converted)} JointTrajectory messages, all the same")
    return interpolate_message(converted[0], robot, str(path), tuple(notes))


@contextmanager
def _bag_reader(path: Path) -> Iterator[Any]:
    """Open a rosbag2 for reading in a `with` statement.

    Parameters
    ----------
    path : Path
        Folder of the bag, or a file in it.

    Yields
    ------
    rosbags.highlevel.AnyReader
        Open reader of the messages.

    Raises
    ------
    TrajectoryError
        If the bag cannot be read. This also applies to faults of the bag that only become apparent
        in the body of the `with` statement.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise TrajectoryError(f"{path}: {INSTALL_HINT}") from error
    folder = path if path.is_dir() else path.parent
    if not (folder / "metadata.yaml").is_file():
        raise TrajectoryError(
            f"{path}: not a rosbag2: metadata.yaml is missing (give the folder of the bag)"
        )
    read_bytes(folder / "metadata.yaml", LARGEST_METADATA)
    try:
        with AnyReader([folder], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            yield reader
    except TrajectoryError as error:
        raise TrajectoryError(f"{path}: {error}") from error
    except (Exception, RecursionError) as error:  # rosbags raises many types for damaged bags.
        reason = f"{type(error).__name__}: {str(error)[:200]}"
        raise TrajectoryError(f"{path}: not a rosbag2 that can be read: {reason}") from error


def _message_from_ros(trajectory: Any) -> TrajectoryMessage:
    """Convert a JointTrajectory from a bag to a `TrajectoryMessage`.

    Parameters
    ----------
    trajectory : object
        Message that was read, with the fields of a JointTrajectory as attributes.

    Returns
    -------
    TrajectoryMessage
        Message with the same values. Times in whole seconds and nanoseconds become times in s.
    """
    points = trajectory.points
    time = np.array([_nanoseconds(point.time_from_start) for point in points])
    fields = {name: [getattr(point, name) for point in points] for name in POINT_FIELDS}
    names = tuple(trajectory.joint_names)
    return TrajectoryMessage(names, time / NANOSECONDS_PER_SECOND, **fields)


def _nanoseconds(stamp: Any) -> int:
    """Convert a Time or Duration of ROS 2 to nanoseconds."""
    return int(stamp.sec * NANOSECONDS_PER_SECOND + stamp.nanosec)


def _message_from_states(messages: list[Any]) -> TrajectoryMessage:
    """Build a trajectory message whose points are recorded joint states.

    Parameters
    ----------
    messages : list
        JointState messages in the order of the bag. Each message may list the joints in any order.
        The first message determines the order of the joints in the result, and its time is 0.

    Returns
    -------
    TrajectoryMessage
        Message with one point for each joint state.

    Raises
    ------
    TrajectoryError
        If the states have different joints, or a list has a wrong length.
    """
    names = tuple(messages[0].name)
    time = np.array([_nanoseconds(message.header.stamp) for message in messages])
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
            is_missing = key == "velocity" and not len(entries)
            if len(entries) != len(joints) and not is_missing:
                raise TrajectoryError(
                    f"JointState {k}: {len(entries)} values of {key} for {len(joints)} joints"
                )
            values.append([] if is_missing else np.asarray(entries)[order].tolist())
    return TrajectoryMessage(
        names,
        (time - time[0]) / NANOSECONDS_PER_SECOND,
        positions=fields["position"],
        velocities=fields["velocity"],
        accelerations=empty,
        effort=empty,
    )
