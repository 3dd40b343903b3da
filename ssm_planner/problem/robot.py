"""Define geometry, bodies and joints of robots, in SI units and radians.

A `Robot` is a serial mechanism whose first three axes intersect in the remote centre. The fourth
joint moves the tool along the axis of the third. `loading/robots.py` reads robots from files.
"""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Annotated, Any, Literal, TypeVar

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.limits import (
    ContinuousTorque,
    JointAcceleration,
    JointJerk,
    JointPosition,
    JointVelocity,
    Limit,
    Limited,
    MotorSpeed,
    MotorTorque,
    NutContact,
    SelfLocking,
    sorted_task_limits,
)
from ssm_planner.problem.motor import Motor
from ssm_planner.problem.transmissions import TRANSMISSIONS
from ssm_planner.problem.value import (
    Interval,
    Mass,
    Matrix,
    NotNegative,
    Position,
    Positive,
    Sign,
    Value,
    Vector,
    check_name,
    uncompared_field,
)
from ssm_planner.problem.value import read_only_array as read_only_array
from ssm_planner.typing import Array, Range, record

L = TypeVar("L", bound=Limit)

JOINTS = ("roll", "tilt", "spin", "insertion")
"""Names of joints 1 to 4 in limits and results."""


UNIT_TOLERANCE = 1e-6
"""Largest difference of the length of a unit vector from 1, and of RᵀR from 1 for a rotation R."""
SMALLEST_AXIS_ANGLE = math.radians(0.1)
"""Smallest angle between neighbouring axes. They count as parallel below it."""
TRIANGLE_TOLERANCE = 1e-6
"""Tolerance of the triangle inequality for rounded figures, relative to the largest moment."""
MOMENT_CONDITION = (
    "positive principal moments about the centre of mass, none above the sum of the other two"
)
"""Condition on the principal moments of inertia of a rigid body, for messages."""


@record
class Geometry(Value):
    """Axes of the mechanism in the base frame at q = 0 (paper, eq. 1).

    The axes are unit vectors with the shape (3,).

    Examples
    --------
    >>> import numpy as np
    >>> import ssm_planner as ssm
    >>> geometry = ssm.load_robot("vitreoretinal").geometry
    >>> np.round(geometry.omega2, 3).tolist()
    [0.866, 0.5, 0.0]
    """

    omega1: Vector
    omega2: Vector
    omega3: Vector
    tool_home: Matrix
    """Rotation R_0 base ← tool at q = 0, (3, 3). Its z column is omega3."""
    insertion_sign: Sign = -1
    """Sign s in depth = s · θ4."""

    @property
    def axes(self) -> tuple[Array, Array, Array, Array]:
        """Axes of joints 1 to 4, (3,) each. The tool slides along the axis of joint 3."""
        return self.omega1, self.omega2, self.omega3, self.omega3

    def _check(self) -> None:
        """Raise ProblemError if the axes or the tool frame are invalid."""
        for name in ("omega1", "omega2", "omega3"):
            unit_vector(getattr(self, name), f"Geometry.{name}")
        for inner, outer in ((1, 2), (2, 3)):
            pair = getattr(self, f"omega{inner}"), getattr(self, f"omega{outer}")
            if np.linalg.norm(np.cross(*pair)) < math.sin(SMALLEST_AXIS_ANGLE):
                reason = f"the axes of joints {inner} and {outer} are parallel"
                raise self._field_error(
                    f"omega{outer}", reason, "at least 0.1 deg between neighbouring axes"
                )
        check_rotation(self, "tool_home")
        if np.linalg.norm(self.tool_home[:, 2] - self.omega3) > UNIT_TOLERANCE:
            actual, required = (
                np.array2string(vector, precision=5)
                for vector in (self.tool_home[:, 2], self.omega3)
            )
            raise self._field_error(
                "tool_home",
                f"the z axis of the tool is the tool axis, {required}, but the z axis of this "
                f"frame is {actual}",
                "rotations from the base to the tool at home, such as [y -113 deg, y 90 deg]",
            )


@record
class Body(Value):
    """Inertial data of one moving body in its own frame, whose origin is the remote centre.

    Examples
    --------
    >>> import numpy as np
    >>> import ssm_planner as ssm
    >>> ssm.Body("tool", 0.02, np.zeros(3), 1e-6 * np.eye(3), np.eye(3)).mass
    0.02
    """

    name: str
    """Name such as that of the CAD part."""
    mass: Mass
    """Mass, kg. It is 0 if the mass of another body includes it."""
    com: Position
    """Centre of mass in the body frame, m, (3,)."""
    inertia: Matrix
    """Inertia tensor about the origin of the body frame, kg·m², (3, 3).

    Products have the sign of −∫xy dm.
    """
    frame: Matrix
    """Rotation base ← body at q = 0, (3, 3)."""

    def _check(self) -> None:
        """Raise ProblemError if no rigid body can have this inertia tensor."""
        check_rotation(self, "frame")
        if self.mass == 0:
            if np.any(self.inertia):
                raise self._field_error(
                    "inertia", "a body without mass has no inertia", "zeros, or a mass"
                )
            return
        if not np.allclose(
            self.inertia, self.inertia.T, rtol=0, atol=1e-9 * float(np.abs(self.inertia).max())
        ):
            raise self._field_error("inertia", "not symmetric", "a symmetric tensor, kg·m²")
        moments = principal_moments(self.mass, self.com, self.inertia)
        if not is_possible_inertia(moments):
            moments_text = ", ".join(f"{moment:.4g}" for moment in moments)
            reason = (
                f"impossible principal moments about the centre of mass, ({moments_text}) kg*m^2"
            )
            raise self._field_error("inertia", reason, MOMENT_CONDITION)


@lru_cache(maxsize=1024)
def _cached_limit(limit_type: Callable[..., Limit], *values: Any) -> Limit:
    """Build a limit, or return the cached one, because plans and checks request it repeatedly."""
    return limit_type(*values)


@record
class Joint(Value):
    """Limits and actuation of one joint, in rad or m and their time derivatives.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> joint = ssm.Joint("roll", "revolute", (-1.0, 1.0), velocity=1.0, acceleration=3.0)
    >>> joint.slides, joint.unit
    (False, 'rad')
    """

    name: str
    kind: Literal["revolute", "prismatic"]
    position: Annotated[Interval, "angle or length"]
    """Range of the position."""
    velocity: Annotated[Positive, "angular_velocity or velocity"]
    """Largest |velocity|."""
    acceleration: Annotated[Positive, "angular_acceleration or acceleration"]
    """Largest |acceleration|."""
    jerk: Annotated[Positive, "angular_jerk or jerk"] | None = None
    """Largest |jerk|, or None if it is unlimited."""
    drive: Drive | None = None
    """Gear or screw with its friction.

    Without it, the torque and motor of the joint are not checked.
    """
    motor: Motor | None = None
    """Motor that turns the drive. Without it, motor torque and speed are unlimited."""
    alternatives: tuple[Motor, ...] = ()
    """Other motors that the robot may have at this joint. `size` checks them as well."""
    motor_direction: Sign = 1
    """Sign of the motor controller's position relative to the joint."""
    backlash: Annotated[NotNegative, "angle or length"] | None = None
    """Total play of the joint with the motor locked, without that of gear stages, which is added.

    None if it is unknown.
    """
    stiffness: Annotated[Positive, "rotary_stiffness or linear_stiffness"] | None = None
    """Effort per deflection of the joint with the motor locked. None if it is unknown."""
    homing_error: Annotated[NotNegative, "angle or length"] | None = None
    """Largest error of the joint's zero position. None if it is unknown."""
    tracking_error: Annotated[NotNegative, "angle or length"] | None = None
    """Largest difference between the set point and the encoder. None if it is unknown."""

    def _check(self) -> None:
        """Raise ProblemError if the drive or the motor does not fit the joint."""
        check_name(self.name, JOINTS, "Joint.name", "unknown joint")
        drive = self.drive
        motor = self.motor
        if drive is None:
            return
        if motor is not None and (motor.rotor_inertia or 0.0) > drive.input_inertia:
            reason = (
                f"the rotor of {motor.name} ({motor.rotor_inertia:.4g} kg*m^2) has more inertia "
                "than the input "
                f"side of the drive ({drive.input_inertia:.4g} kg*m^2), which includes it"
            )
            raise self._field_error(
                "motor", reason, "a drive whose input_inertia includes the rotor", motor.name
            )
        if self.alternatives and motor is None:
            raise self._field_error(
                "alternatives",
                "alternatives need a motor that they replace",
                "none, or a motor as well",
            )
        if drive.friction is None:
            raise self._field_error(
                "drive",
                "the friction of this drive has not been identified",
                "friction",
                drive.name,
            )
        if self.slides != drive.slides:
            kinds = [name for name, kind in TRANSMISSIONS.items() if kind.slides == self.slides]
            reason = f"a {drive.kind} drive does not fit a {self.kind} joint"
            raise self._field_error("drive", reason, ", ".join(kinds), drive.name)
        drive.check_travel(self.position[1] - self.position[0])

    def plays(self) -> dict[str, float | None]:
        """Return the play of the joint that is due to each gear stage.

        Returns
        -------
        dict of float or None
            Play in rad or m, by a name such as "gearhead backlash". It is None if the backlash is
            unknown or a placeholder.
        """
        plays: dict[str, float | None] = {}
        ratio = 1.0
        if self.drive is None:
            return plays
        # The play of the output of a stage is converted to the motor and then to the joint.
        for name, stage in self.drive.stages.items():
            ratio *= stage.ratio
            backlash = None if stage.placeholder else stage.backlash
            plays[f"{name} backlash"] = (
                None if backlash is None else backlash * ratio / self.drive.ratio
            )
        return plays

    @property
    def slides(self) -> bool:
        """True for a prismatic joint."""
        return self.kind == "prismatic"

    @property
    def unit(self) -> str:
        """Unit of the joint position: rad or m."""
        return "m" if self.slides else "rad"

    @property
    def limits(self) -> tuple[Limit, ...]:
        """All limits of this joint, its motor and its drive."""
        name = self.name
        slides = self.slides
        drive = self.drive
        motor = self.motor
        limits = [
            _cached_limit(JointPosition, name, *self.position, slides),
            _cached_limit(JointVelocity, name, self.velocity, slides),
            _cached_limit(JointAcceleration, name, self.acceleration, slides),
        ]
        if self.jerk is not None:
            limits.append(_cached_limit(JointJerk, name, self.jerk, slides))
        if drive is None:
            return tuple(limits)
        if motor is not None:
            limits += [
                _cached_limit(kind, name, getattr(motor, kind.field))
                for kind in (MotorSpeed, MotorTorque, ContinuousTorque)
            ]
        if drive.two_nuts:
            limits.append(_cached_limit(NutContact, name, drive.preload))
        if drive.self_locking and drive.friction is not None:
            lowest = drive.friction.mu_lowest
            limits.append(
                _cached_limit(SelfLocking, name, drive.friction.mu if lowest is None else lowest)
            )
        return tuple(limits)

    def limit(self, limit_type: type[L]) -> L:
        """Return the limit of a given class. Raise KeyError if the joint does not have one."""
        limit = self.find_limit(limit_type)
        if limit is None:
            raise KeyError(limit_type.__name__)
        return limit

    def find_limit(self, limit_type: type[L]) -> L | None:
        """Return the limit of a given class, or None if the joint does not have one."""
        return next((limit for limit in self.limits if isinstance(limit, limit_type)), None)


@record
class Robot(Value, Limited):
    """Serial spherical mechanism with geometry, bodies, joints, drives and motors, in SI units.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> robot = ssm.load_robot("vitreoretinal")
    >>> robot.name, len(robot.bodies)
    ('vitreoretinal', 4)
    """

    name: str
    """Name of the robot in results."""
    geometry: Geometry
    bodies: tuple[Body, Body, Body, Body]
    joints: tuple[Joint, Joint, Joint, Joint]
    gravity: Annotated[Vector, "acceleration"]
    """Acceleration of gravity in the base frame, m/s², (3,)."""
    limits: tuple[Limit, ...] = ()
    """Ranges of task coordinates that the robot itself declares."""
    corners: "tuple[Robot, ...]" = ()
    """Variants of the robot with other friction and tool mass.

    If there are any, the planner respects the driving torques of the motors for each of them.
    """
    lightest: "tuple[Robot, ...]" = ()
    """Variants for braking torques."""
    file: str | None = uncompared_field()

    def _check(self) -> None:
        """Raise ProblemError if the order of joints or the depth range is wrong."""
        sorted_task_limits(self.limits, "Robot.limits")
        for i, (joint, name) in enumerate(zip(self.joints, JOINTS, strict=True)):
            if joint.name != name:
                raise self._field_error(
                    f"joints[{i}].name", "wrong order of joints", name, joint.name
                )
            joint_kind = "prismatic" if name == "insertion" else "revolute"
            if joint.kind != joint_kind:
                raise self._field_error(
                    f"joints[{i}].kind", f"wrong kind for joint {name}", joint_kind, joint.kind
                )
        low, high = self.travel
        for name, (lower, upper) in self.ranges.items():
            if name == "depth" and not max(low, lower) < min(high, upper):
                allowed = f"within {low * 1e3:g} mm to {high * 1e3:g} mm"
                raise self._field_error(
                    "limits.depth", "outside the travel of joint 4", allowed, (lower, upper)
                )

    @property
    def velocities(self) -> Array:
        """Largest velocities of the joints, (4,), rad/s and m/s."""
        return np.array([joint.velocity for joint in self.joints])

    @property
    def accelerations(self) -> Array:
        """Largest accelerations of the joints, (4,), rad/s² and m/s²."""
        return np.array([joint.acceleration for joint in self.joints])

    @property
    def jerk_limited(self) -> tuple[str, ...]:
        """Names of the joints with a limit on their jerk."""
        return tuple(joint.name for joint in self.joints if joint.jerk is not None)

    @property
    def loads(self) -> "tuple[Robot, ...]":
        """This robot and its variants, one for each different set of bodies."""
        if not self.corners and not self.lightest:
            return (self,)
        different = {id(robot.bodies): robot for robot in (*self.lightest, *self.corners, self)}
        by_bodies: dict[tuple[Body, ...], Robot] = {}
        for robot in reversed(different.values()):
            by_bodies.setdefault(robot.bodies, robot)
        return tuple(by_bodies.values())

    def actuations(self, i: int) -> tuple[tuple[int, Drive, tuple[int, ...]], ...]:
        """Return the loads and friction laws that the motor of a joint must handle.

        A robot for a range of friction or payload has variants. `corners` are the variants that
        need the most torque to drive, and `lightest` are those that need the most torque to brake.
        Equal cases occur once. Without variants, the robot itself is the only case.

        Parameters
        ----------
        i : int
            Index of the joint, from 0.

        Returns
        -------
        tuple of (int, Drive, tuple of int)
            For each case, the index of its bodies in `loads`, the drive with its friction, and the
            torques that the motor must provide: +1 to drive and −1 to brake. The result is empty
            for a joint without a motor.
        """
        if self.joints[i].motor is None:
            return ()
        if not self.corners and not self.lightest:
            drive = self.joints[i].drive
            return () if drive is None else ((0, drive, (1, -1)),)
        bodies = [robot.bodies for robot in self.loads]
        load_indices: dict[int, int] = {}
        cases: dict[tuple[int, int], tuple[int, Drive, tuple[int, ...]]] = {}
        variants: list[tuple[Robot, tuple[int, ...]]] = [(corner, (1,)) for corner in self.corners]
        variants += [(corner, (-1,)) for corner in self.lightest]
        for robot, sides in variants:
            drive = robot.joints[i].drive
            if id(robot.bodies) not in load_indices:  # comparing bodies is slow
                load_indices[id(robot.bodies)] = bodies.index(robot.bodies)
            load = load_indices[id(robot.bodies)]
            if drive is not None:
                _, _, known_sides = cases.get((load, id(drive)), (load, drive, ()))
                merged_sides = tuple(dict.fromkeys(known_sides + sides))
                cases[load, id(drive)] = (load, drive, merged_sides)
        return tuple(cases.values())

    @property
    def travel(self) -> Range:
        """Range of depths that joint 4 allows, m."""
        low, high = sorted(
            self.geometry.insertion_sign * position + 0.0 for position in self.joints[3].position
        )
        return low, high


def unit_vector(vector: Array, location: str) -> Array:
    """Remove the rounding error from the length of a unit vector.

    Parameters
    ----------
    vector : (3,) array
        Vector with a length of about 1.
    location : str
        Key of the vector, for messages.

    Returns
    -------
    (3,) array
        Vector with the same direction and the length 1.

    Raises
    ------
    ProblemError
        If the length differs from 1 by more than `UNIT_TOLERANCE`.
    """
    length = float(np.linalg.norm(vector))
    if not abs(length - 1) <= UNIT_TOLERANCE:
        reason = f"the vector has length {length:.7g}"
        raise ProblemError(
            reason, key=location, value=vector.tolist(), allowed="a unit vector, within 1e-6"
        )
    return vector / length


def principal_moments(mass: float, com: Array, inertia: Array) -> Array:
    """Return the principal moments of inertia of a body about its centre of mass.

    Parameters
    ----------
    mass : float
        Mass, kg.
    com : (3,) array
        Centre of mass, m.
    inertia : (3, 3) array
        Inertia tensor about the origin, kg·m².

    Returns
    -------
    (3,) array
        Principal moments in ascending order, kg·m².
    """
    # Parallel axis theorem. The principal moments are the eigenvalues of the tensor.
    about_com = inertia - mass * (com @ com * np.eye(3) - np.outer(com, com))
    return np.asarray(np.linalg.eigvalsh(about_com), dtype=float)


def is_possible_inertia(moments: Array) -> bool:
    """Return True if a rigid body can have these principal moments of inertia.

    The moments must be positive, and none may exceed the sum of the other two.

    Parameters
    ----------
    moments : (3,) array
        Ascending principal moments about the centre of mass, kg·m².
    """
    low, middle, high = moments
    return bool(low > 0 and high <= low + middle + TRIANGLE_TOLERANCE * high)


def check_rotation(value: Value, name: str) -> None:
    """Raise ProblemError if a field of a value is not a rotation matrix.

    Parameters
    ----------
    value : Value
        Value with the field.
    name : str
        Name of the field, which contains a (3, 3) array.
    """
    matrix = getattr(value, name)
    if (
        not np.allclose(matrix.T @ matrix, np.eye(3), rtol=0, atol=UNIT_TOLERANCE)
        or np.linalg.det(matrix) < 0
    ):
        raise ProblemError(
            "not a rotation",
            key=f"{type(value).__name__}.{name}",
            value=matrix.tolist(),
            allowed="orthogonal unit columns, right-handed",
        )
