"""Robots as frozen values: geometry, bodies, joints. SI floats and radians, arrays read-only."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Annotated, Any, Literal, TypeVar, get_args

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.problem.drive import TURNING, Drive, DriveKind
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
    task_limits,
)
from ssm_planner.problem.motor import Motor
from ssm_planner.problem.value import (
    Interval,
    Matrix,
    NotNegative,
    Positive,
    Quantity,
    Sign,
    Value,
    Vector,
    check_name,
)
from ssm_planner.problem.value import frozen as frozen
from ssm_planner.typing import Array, Range

L = TypeVar("L", bound=Limit)

JOINTS = ("roll", "tilt", "spin", "insertion")
"""Names by which limits and results speak of joints 1 to 4."""


UNIT_TOLERANCE = 1e-6
SMALLEST_ANGLE = math.radians(0.1)
"""Between neighbouring axes; below it they count as parallel."""
TRIANGLE_SLACK = 1e-6
"""Of the triangle inequality, relative to the largest moment: printed figures are rounded."""
POSSIBLE = "principal moments about the centre of mass that are positive, none above the sum of the other two"


@dataclass(frozen=True, eq=False)
class Geometry(Value):
    """Axes of the mechanism in the base frame at q = 0 (paper, eq. 1); unit vectors, shape (3,)."""

    omega1: Vector
    omega2: Vector
    omega3: Vector
    tool_home: Matrix
    """R_0, (3, 3), base ← tool at q = 0; its z column is omega3."""
    insertion_sign: Sign = -1
    """depth = insertion_sign · θ4."""

    def _check(self) -> None:
        for name in ("omega1", "omega2", "omega3"):
            unit_vector(getattr(self, name), f"Geometry.{name}")
        for first, second in ((1, 2), (2, 3)):
            pair = getattr(self, f"omega{first}"), getattr(self, f"omega{second}")
            if np.linalg.norm(np.cross(*pair)) < math.sin(SMALLEST_ANGLE):
                reason = f"the axes of joints {first} and {second} are parallel"
                raise self._wrong(
                    f"omega{second}", reason, "at least 0.1 deg between neighbouring axes"
                )
        check_rotation(self, "tool_home")
        if np.linalg.norm(self.tool_home[:, 2] - self.omega3) > UNIT_TOLERANCE:
            found, wanted = (
                np.array2string(vector, precision=5)
                for vector in (self.tool_home[:, 2], self.omega3)
            )
            raise self._wrong(
                "tool_home",
                f"the z axis of the tool is the tool axis, {wanted}, but this frame has its z along {found}",
                "rotations from the base to the tool at home, such as [y -113 deg, y 90 deg]",
            )


@dataclass(frozen=True, eq=False)
class Body(Value):
    """Inertial data of one moving body, in its own frame at the RCM."""

    name: str
    """Such as the CAD part's."""
    mass: Annotated[NotNegative, Quantity("mass")]
    """kg; 0 where it is counted in another body."""
    com: Annotated[Vector, Quantity("length")]
    """Centre of mass in the body frame, m, (3,)."""
    inertia: Matrix
    """Inertia tensor about the body frame's origin, kg·m², (3, 3), products with the tensor's sign (−∫xy dm)."""
    frame: Matrix
    """Rotation base ← body at q = 0, (3, 3)."""

    def _check(self) -> None:
        check_rotation(self, "frame")
        if self.mass == 0:
            if np.any(self.inertia):
                raise self._wrong(
                    "inertia", "a body without mass has no inertia", "zeros, or a mass"
                )
            return
        if not np.allclose(
            self.inertia, self.inertia.T, rtol=0, atol=1e-9 * float(np.abs(self.inertia).max())
        ):
            raise self._wrong("inertia", "not symmetric", "a symmetric tensor, kg·m²")
        moments = principal_moments(self.mass, self.com, self.inertia)
        if not possible(moments):
            listed = ", ".join(f"{moment:.4g}" for moment in moments)
            reason = f"no body can have this inertia: its principal moments about the centre of mass are ({listed}) kg*m^2"
            raise self._wrong("inertia", reason, POSSIBLE)


@lru_cache(maxsize=1024)
def _kept(kind: Callable[..., Limit], *values: Any) -> Limit:
    """A limit of these values: checks and plans ask for the same ones again and again."""
    return kind(*values)


@dataclass(frozen=True, eq=False)
class Joint(Value):
    """Limits and actuation of one joint; rad or m and their time derivatives."""

    name: str
    kind: Literal["revolute", "prismatic"]
    position: Annotated[Interval, Quantity("angle", "length")]
    """Range."""
    velocity: Annotated[Positive, Quantity("angular_velocity", "velocity")]
    """Largest, by magnitude."""
    acceleration: Annotated[Positive, Quantity("angular_acceleration", "acceleration")]
    """Largest, by magnitude."""
    jerk: Annotated[Positive, Quantity("angular_jerk", "jerk")] | None = None
    """Largest, by magnitude; without it jerk is not limited."""
    drive: Drive | None = None
    """Gear or screw with its friction; without it torque and motor of the joint are not checked."""
    motor: Motor | None = None
    """Motor that turns the drive; without it motor torque and speed are not limited."""
    alternatives: tuple[Motor, ...] = ()
    """Motors that it may be instead, where what is known of the robot leaves it open; `size` judges them beside."""
    motor_direction: Sign = 1
    """Sense in which the motor's controller counts when the joint moves forward."""

    def _check(self) -> None:
        check_name(self.name, JOINTS, "Joint.name", "not a joint known here")
        drive, motor = self.drive, self.motor
        if drive is None:
            return
        if motor is not None and (motor.rotor_inertia or 0.0) > drive.input_inertia:
            reason = (
                f"the rotor of {motor.name} ({motor.rotor_inertia:.4g} kg*m^2) has more inertia than the whole input "
                f"side of the drive ({drive.input_inertia:.4g} kg*m^2), which includes it"
            )
            raise self._wrong(
                "motor", reason, "a drive whose input_inertia counts the rotor in", motor.name
            )
        if self.alternatives and motor is None:
            raise self._wrong(
                "alternatives", "instead of which motor?", "none, or a motor beside them"
            )
        revolute = self.kind == "revolute"
        if drive.friction is None:
            raise self._wrong(
                "drive",
                "the friction of this drive is still to be identified",
                "friction",
                drive.name,
            )
        if revolute == drive.slides:
            kinds = [kind for kind in get_args(DriveKind) if (kind in TURNING) == revolute]
            reason = f"a {drive.kind} drive, but this joint {'turns' if revolute else 'slides'}"
            raise self._wrong("drive", reason, ", ".join(kinds), drive.name)

    @property
    def unit(self) -> str:
        """Of its positions: rad or m."""
        return "rad" if self.kind == "revolute" else "m"

    @property
    def limits(self) -> tuple[Limit, ...]:
        """Everything that limits this joint, its motor and its drive."""
        name, slides, drive, motor = self.name, self.kind == "prismatic", self.drive, self.motor
        found = [
            _kept(JointPosition, name, *self.position, slides),
            _kept(JointVelocity, name, self.velocity, slides),
            _kept(JointAcceleration, name, self.acceleration, slides),
        ]
        if self.jerk is not None:
            found.append(_kept(JointJerk, name, self.jerk, slides))
        if drive is None:
            return tuple(found)
        if motor is not None:
            found.append(_kept(MotorSpeed, name, motor.max_speed))
            found.append(_kept(MotorTorque, name, motor.max_torque))
            found.append(_kept(ContinuousTorque, name, motor.nominal_torque))
        if drive.kind == "antibacklash_screw":
            found.append(_kept(NutContact, name))
        if drive.self_locking and drive.friction is not None:
            lowest = drive.friction.mu_lowest
            found.append(_kept(SelfLocking, name, drive.friction.mu if lowest is None else lowest))
        return tuple(found)

    def limit(self, kind: type[L]) -> L:
        """The limit of one kind. Raises KeyError where there is none."""
        for limit in self.limits:
            if isinstance(limit, kind):
                return limit
        raise KeyError(kind.__name__)


@dataclass(frozen=True, eq=False)
class Robot(Value, Limited):
    """A serial spherical mechanism: geometry, bodies and joints with their limits, drives and motors; SI."""

    name: str
    """By which results speak of it."""
    geometry: Geometry
    bodies: tuple[Body, Body, Body, Body]
    joints: tuple[Joint, Joint, Joint, Joint]
    gravity: Annotated[Vector, Quantity("acceleration")]
    """Acceleration of gravity in the base frame, m/s², (3,)."""
    limits: tuple[Limit, ...] = ()
    """Ranges of task coordinates that the robot itself declares."""
    corners: tuple[Robot, ...] = ()
    """The same robot with other friction and tool mass: where there are some, a planner keeps its motors' driving torques
    with each of them."""
    lightest: tuple[Robot, ...] = ()
    """The same for braking torques."""
    file: str | None = field(default=None, compare=False)

    def _check(self) -> None:
        task_limits(self.limits, "Robot.limits")
        for i, (joint, name) in enumerate(zip(self.joints, JOINTS, strict=True)):
            if joint.name != name:
                raise self._wrong(f"joints[{i}].name", "not in this place", name, joint.name)
            kind = "prismatic" if name == "insertion" else "revolute"
            if joint.kind != kind:
                raise self._wrong(
                    f"joints[{i}].kind", f"not the kind of joint {name}", kind, joint.kind
                )
        low, high = self.travel
        for name, (lower, upper) in self.ranges.items():
            if name == "depth" and not max(low, lower) < min(high, upper):
                allowed = f"within {low * 1e3:g} mm to {high * 1e3:g} mm"
                raise self._wrong(
                    "limits.depth", "outside the travel of joint 4", allowed, (lower, upper)
                )

    @property
    def loads(self) -> tuple[Robot, ...]:
        """One robot for each set of bodies, of itself and its corners."""
        if not self.corners and not self.lightest:
            return (self,)
        different = {id(robot.bodies): robot for robot in (*self.lightest, *self.corners, self)}
        found: dict[tuple[Body, ...], Robot] = {}
        for robot in reversed(different.values()):
            found.setdefault(robot.bodies, robot)
        return tuple(found.values())

    def actuations(self, i: int) -> tuple[tuple[int, Drive, tuple[int, ...]], ...]:
        """(position in `loads`, drive, sides) with which the motor of joint i has to manage, each once; none without one.

        sides: +1 where it drives, −1 where it brakes; a robot with corners has to manage with these alone.
        """
        if self.joints[i].motor is None:
            return ()
        if not self.corners and not self.lightest:
            drive = self.joints[i].drive
            return () if drive is None else ((0, drive, (1, -1)),)
        bodies = [robot.bodies for robot in self.loads]
        position: dict[int, int] = {}
        found: dict[tuple[int, int], tuple[int, Drive, tuple[int, ...]]] = {}
        wanted: list[tuple[Robot, tuple[int, ...]]] = [(each, (1,)) for each in self.corners]
        wanted += [(each, (-1,)) for each in self.lightest]
        for robot, sides in wanted:
            drive = robot.joints[i].drive
            if id(robot.bodies) not in position:  # a comparison of bodies takes long
                position[id(robot.bodies)] = bodies.index(robot.bodies)
            load = position[id(robot.bodies)]
            if drive is not None:
                before = found.get((load, id(drive)), (load, drive, ()))[2]
                found[load, id(drive)] = (load, drive, tuple(dict.fromkeys((*before, *sides))))
        return tuple(found.values())

    @property
    def travel(self) -> Range:
        """Range of depth that joint 4 allows, m."""
        low, high = sorted(
            self.geometry.insertion_sign * position + 0.0 for position in self.joints[3].position
        )
        return low, high


def unit_vector(vector: Array, where: str) -> Array:
    """The vector (3,) at length 1. Raises ProblemError where its length differs by more than 1e-6."""
    length = float(np.linalg.norm(vector))
    if not abs(length - 1) <= UNIT_TOLERANCE:
        reason = f"the vector has length {length:.7g}"
        raise ProblemError(
            reason, key=where, value=vector.tolist(), allowed="a unit vector, within 1e-6"
        )
    return vector / length


def principal_moments(mass: float, com: Array, inertia: Array) -> Array:
    """Principal moments about the centre of mass, ascending, kg·m², (3,); inertia (3, 3) is about the origin."""
    about_com = inertia - mass * (com @ com * np.eye(3) - np.outer(com, com))
    return np.asarray(np.linalg.eigvalsh(about_com), dtype=float)


def possible(moments: Array) -> bool:
    """Whether a body can have these principal moments (3,), ascending: positive, none above the sum of the other two."""
    low, middle, high = moments
    return bool(low > 0 and high <= low + middle + TRIANGLE_SLACK * high)


def check_rotation(value: Value, name: str) -> None:
    """Raises ProblemError where the field holds no rotation."""
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
