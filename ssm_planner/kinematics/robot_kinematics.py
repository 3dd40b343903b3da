"""Compute tool poses, joint solutions and the workspace of a robot, for users of the package.

The public functions `fk`, `ik`, `jacobian` and `workspace` accept a `Robot` and arrays. They call
the functions of the other modules of this package, which work on a `Mechanism`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.arguments import checked
from ssm_planner.errors import GeometryError
from ssm_planner.kinematics.forward import forward, space_jacobian, tip_position
from ssm_planner.kinematics.inverse import inverse_task
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.task import task_from_joints
from ssm_planner.kinematics.workspace import Extreme, boundary_distance, extremes, tilt_interval
from ssm_planner.problem import Robot
from ssm_planner.typing import Array, JsonObject, Mask, Range, record

EQUAL_JOINTS = 1e-7
"""Largest difference (rad or m) of any joint between two solutions that count as equal."""


@record
class ToolPose:
    """Pose of the tool in the base frame, in one or in n configurations, rad and m.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> pose = ssm.fk(ssm.load_robot("vitreoretinal"), [[0.0, 0.0, 0.0, -0.01]] * 5)
    >>> pose.position.shape, pose.rotation.shape
    ((5, 3), (5, 3, 3))
    """

    rotation: Array
    """Rotation base ← tool, (3, 3) or (n, 3, 3)."""
    position: Array
    """Position of the tip, (3,) or (n, 3)."""
    task: Array
    """Roll, tilt, spin and depth, (4,) or (n, 4)."""


@record
class JointSolutions:
    """Joint solutions for one point in task coordinates, or for n points, rad and m.

    The array `joints` has the shape (k, 4) for the k distinct solutions of one point, and (n, 2, 4)
    for both solutions of n points. Solutions within the joint ranges come first.

    Examples
    --------
    >>> import numpy as np
    >>> import ssm_planner as ssm
    >>> solutions = ssm.ik(ssm.load_robot("vitreoretinal"), tilt=np.radians(-110))
    >>> solutions.joints.shape, solutions.reachable
    ((2, 4), True)
    """

    joints: Array
    """Joint positions, (k, 4) or (n, 2, 4), rad and m.

    For a point outside the workspace, they reach the nearest tilt inside.
    """
    in_limits: Mask
    """True if the solution is within the joint ranges, (k,) or (n, 2)."""
    reachable: bool | Mask
    """True if the point is in the workspace, for n points (n,)."""
    orientation_error: float | Array
    """Angle between the requested and the reached tool axis, for n points (n,), rad."""
    tip_error: float | Array
    """Distance between the requested and the reached tip position, for n points (n,), m."""
    boundary_distance: float | Array
    """Angle by which the tilt may change until it leaves the workspace, for n points (n,), rad.

    It is negative outside the workspace.
    """

    def to_dict(self) -> JsonObject:
        """Return the solutions as a dict of JSON types, in rad and m.

        The command `ik --json` prints this dict.
        """
        return {
            "reachable": self.reachable,
            "branches": self.joints.tolist(),
            "in_limits": self.in_limits.tolist(),
            "error": {"orientation": self.orientation_error, "tip": self.tip_error},
            "boundary_distance": self.boundary_distance,
        }


@record
class Workspace:
    """Range of the tilts that the tool of a robot reaches, and the angles that determine it, rad.

    Examples
    --------
    >>> import numpy as np
    >>> import ssm_planner as ssm
    >>> space = ssm.workspace(ssm.load_robot("vitreoretinal"))
    >>> np.degrees([space.alpha, space.beta]).round(2).tolist()
    [30.0, 109.78]
    """

    alpha: float
    """Angle between the axes of joints 1 and 2."""
    beta: float
    """Angle between the axis of joint 2 and the tool."""
    tilt_range: Range
    """Smallest and largest signed tilt."""
    home_roll: float
    """Roll at q = 0."""
    home_tilt: float
    """Tilt at q = 0."""
    extremes: tuple[Extreme, ...]
    """Configurations with the smallest and the largest magnitude of the tilt."""
    side: int
    """Sign of the tilt at q = 0, +1 or −1."""

    def to_dict(self) -> JsonObject:
        """Return the workspace as a dict of JSON types, in rad.

        The command `workspace --json` prints this dict. The tilts of the extremes have the sign of
        the home tilt.
        """
        return {
            "alpha": self.alpha,
            "beta": self.beta,
            "tilt_range": list(self.tilt_range),
            "home": {"roll": self.home_roll, "tilt": self.home_tilt},
            "extremes": [
                {
                    "theta2": extreme.theta2,
                    "tilt": self.side * extreme.tilt,
                    "c1": extreme.c1,
                    "c2": extreme.c2,
                }
                for extreme in self.extremes
            ],
        }


@checked
def fk(robot: Robot, q: ArrayLike) -> ToolPose:
    """Compute the tool pose for joint positions (forward kinematics; paper, eq. 2).

    Parameters
    ----------
    robot : Robot
        Robot whose tool is moved.
    q : (4,) or (n, 4)
        Joint positions in rad, and in m for joint 4.

    Returns
    -------
    ToolPose
        Orientation, tip position and task coordinates. Arrays have n rows for n configurations.

    Raises
    ------
    GeometryError
        If the shape is wrong or a value is not finite.

    Examples
    --------
    >>> from ssm_planner import fk, load_robot
    >>> pose = fk(load_robot("vitreoretinal"), [0.0, 0.0, 0.0, -0.01])
    >>> (pose.position.round(5) + 0.0).tolist()
    [0.00391, 0.0, -0.00921]
    """
    joints = np.asarray(q, dtype=float)
    mechanism = Mechanism.from_robot(robot)
    rows = joints[None] if joints.ndim == 1 else joints
    rotation, position = forward(mechanism, rows)
    task = task_from_joints(mechanism, rows)
    if joints.ndim == 1:
        return ToolPose(rotation[0], position[0], task[0])
    return ToolPose(rotation, position, task)


@checked
def jacobian(robot: Robot, q: ArrayLike) -> Array:
    """Return the geometric Jacobian of the tip in the base frame.

    The velocity of the tip is v = J[:3] q̇, and the angular velocity of the tool is ω = J[3:] q̇.
    The columns follow from the screws of the joints (Lynch and Park, Modern Robotics, 2017, §5.1).

    Parameters
    ----------
    robot : Robot
        Robot whose tool is moved.
    q : (4,) or (n, 4)
        Joint positions in rad, and in m for joint 4.

    Returns
    -------
    (6, 4) or (n, 6, 4) array
        Rows of v in m/s and of ω in rad/s for unit joint velocities.

    Raises
    ------
    GeometryError
        If the shape is wrong or a value is not finite.

    Examples
    --------
    >>> from ssm_planner import jacobian, load_robot
    >>> J = jacobian(load_robot("vitreoretinal"), [0.0, 0.0, 0.0, -0.01])
    >>> J[3:, 0].round(6).tolist()
    [1.0, 0.0, 0.0]
    """
    mechanism = Mechanism.from_robot(robot)
    screws = space_jacobian(mechanism, q)
    velocity = screws[:, :3]
    angular = screws[:, 3:]
    tips = tip_position(mechanism, q)[:, :, None]
    result = np.concatenate([velocity + np.cross(angular, tips, axis=1), angular], axis=1)
    return result if np.ndim(q) == 2 else result[0]


@checked
def ik(
    robot: Robot,
    roll: ArrayLike = 0.0,
    tilt: ArrayLike = 0.0,
    spin: ArrayLike = 0.0,
    depth: ArrayLike = 0.0,
    *,
    within_limits: bool = False,
    reference: ArrayLike | None = None,
) -> JointSolutions:
    """Compute every joint solution for points in task coordinates (paper, §II-C).

    Each point has two solutions, one on each branch of the inverse kinematics, that is, for each
    sign of sin(θ2 − δ) with δ of `Mechanism.delta`. For a point outside the workspace, the
    solutions reach the nearest tilt inside.

    Parameters
    ----------
    robot : Robot
        Robot whose joints are computed.
    roll, tilt, spin : float or (n,) array
        Angles of the tool (rad). For the coordinates of a Task, pass `**task.set_coordinates`.
    depth : float or (n,) array
        Distance of the tip beyond the remote centre (m).
    within_limits : bool
        True to leave out solutions beyond the joint ranges. For n points, these solutions become
        NaN.
    reference : (4,) array, optional
        Joint positions (rad, and m for joint 4). Solutions are sorted by their distance to it, and
        revolute joints are moved next to it by whole turns. The default is home (q = 0).

    Returns
    -------
    JointSolutions
        Distinct solutions of one point, or both branches of n points.

    Raises
    ------
    GeometryError
        If a value is not finite or the tilt is outside [−π, π].

    Examples
    --------
    >>> import numpy as np
    >>> from ssm_planner import fk, ik, load_robot
    >>> robot = load_robot("vitreoretinal")
    >>> solutions = ik(robot, tilt=np.radians(-110), depth=0.01)
    >>> solutions.joints.shape
    (2, 4)
    >>> fk(robot, solutions.joints).task.round(6)[:, 1].tolist()
    [-1.919862, -1.919862]
    >>> ik(robot, tilt=np.radians([-110, -100, -90])).joints.shape
    (3, 2, 4)
    """
    mechanism = Mechanism.from_robot(robot)
    try:
        points = np.stack(np.broadcast_arrays(roll, tilt, spin, depth), axis=-1)
    except ValueError:
        raise GeometryError("roll, tilt, spin and depth have different lengths") from None
    solutions = inverse_task(
        mechanism,
        points,
        limits=np.array([joint.position for joint in robot.joints]),
        reference=np.zeros(4) if reference is None else reference,
    )
    joints = solutions.joints
    in_limits = solutions.in_limits
    distance = boundary_distance(mechanism, points[..., 1])
    if points.ndim == 2:
        if within_limits:
            joints[~in_limits] = np.nan
        return JointSolutions(
            joints,
            in_limits,
            solutions.reachable,
            solutions.orientation_error,
            solutions.tip_error,
            boundary_distance=distance,
        )
    distinct: list[int] = []
    for k, solution in enumerate(joints[0]):
        allowed = bool(in_limits[0, k]) or not within_limits
        if allowed and not any(
            np.abs(solution - joints[0, earlier]).max() <= EQUAL_JOINTS for earlier in distinct
        ):
            distinct.append(k)
    return JointSolutions(
        joints=joints[0, distinct],
        in_limits=in_limits[0, distinct],
        reachable=bool(solutions.reachable[0]),
        orientation_error=float(solutions.orientation_error[0]),
        tip_error=float(solutions.tip_error[0]),
        boundary_distance=float(distance),
    )


@checked
def workspace(robot: Robot) -> Workspace:
    """Compute the range of tilts that a robot reaches, in closed form (paper, §II-B).

    `design_region` solves the inverse problem: it computes the robots that reach a given range.

    Parameters
    ----------
    robot : Robot
        Robot with its geometry.

    Returns
    -------
    Workspace
        Range of the tilts (rad), and the angles that determine it.

    Examples
    --------
    >>> import numpy as np
    >>> from ssm_planner import load_robot, workspace
    >>> np.degrees(workspace(load_robot("vitreoretinal")).tilt_range).round(3).tolist()
    [-139.778, -79.778]
    """
    mechanism = Mechanism.from_robot(robot)
    return Workspace(
        mechanism.alpha,
        mechanism.beta,
        tilt_range=tilt_interval(mechanism),
        home_roll=mechanism.home_roll,
        home_tilt=mechanism.home_tilt,
        extremes=tuple(extremes(mechanism)),
        side=int(mechanism.side),
    )
