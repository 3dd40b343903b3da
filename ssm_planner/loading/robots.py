"""Read robot files with their drives and motors.

A file may state the axes of the joints as vectors or as angles, and inertias in either sign
convention. The mass and inertia of a body may also follow from its parts, such as rods and boxes.
The models describe the keys of the file, and `robot_from` builds the Robot.
"""

import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field as PydanticField

from ssm_planner import units
from ssm_planner.dynamics import shapes
from ssm_planner.errors import ProblemError
from ssm_planner.loading.drives import drive_from
from ssm_planner.loading.files import follow_reference
from ssm_planner.loading.motors import motor_from
from ssm_planner.loading.schema import (
    POSITIVE,
    SOURCE_KEY,
    Axis,
    Model,
    Nested,
    Reader,
    Reference,
    build_class_model,
    build_keys_model,
    interval_reader,
    invalid_value,
    joint_mapping_model,
    locate_errors,
    nested_type,
    optional_key,
    quantity_reader,
    required_key,
    validate_section,
    vector_reader,
)
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.problem import (
    JOINTS,
    SMALLEST_AXIS_ANGLE,
    TASK_COORDINATES,
    Body,
    Bound,
    Geometry,
    Joint,
    Robot,
    TaskRange,
    is_possible_inertia,
    principal_moments,
    read_only_array,
    unit_vector,
)
from ssm_planner.typing import Array, Keywords, record

ANGLE_NAMES = ("alpha", "home_tilt", "home_roll")
"""Angles of the geometry that a frame may name, so that the bodies depend on them."""


def _parse_rotations(value: object) -> tuple[tuple[str, float | str], ...]:
    """Read a chain of rotations, such as [x 90 deg, y alpha].

    Parameters
    ----------
    value : object
        Value in the file, which should be a list of texts.

    Returns
    -------
    tuple of pairs
        Axis x, y or z, and angle of each rotation. The angle is a number in rad, or the name of an
        angle of the geometry, possibly with a minus sign.
    """
    allowed = (
        "a list of rotations about the axes of the turned frame, such as [x 90 deg, y 30 "
        "deg] or [y alpha]"
    )
    if not isinstance(value, list):
        raise invalid_value("invalid chain of rotations", allowed)
    chain: list[tuple[str, float | str]] = []
    for item in value:
        axis, _, angle = item.strip().partition(" ") if isinstance(item, str) else ("", "", "")
        if axis not in ("x", "y", "z"):
            raise invalid_value(f"{item!r} does not start with x, y or z", allowed)
        is_name = angle.strip().removeprefix("-") in ANGLE_NAMES
        chain.append((axis, angle.strip() if is_name else units.parse_quantity(angle, "angle")))
    return tuple(chain)


_ROTATIONS_READER = Reader(
    _parse_rotations,
    {"type": "array", "items": {"type": "string"}},
    ("angle",),
    "such as [x 90 deg, y 30 deg]",
)
Rotations = Annotated[tuple[tuple[str, float | str], ...], _ROTATIONS_READER]
"""Chain of rotations about the axes of the turned frame."""
_Angle = Annotated[float, quantity_reader("angle")] | None
_PositiveAngle = Annotated[float, quantity_reader("angle", POSITIVE)] | None
_Position = Annotated[tuple[float, float, float], vector_reader("length", "length", "length")]
"""Position of a point, or lengths along the axes."""
_Length = Annotated[float, quantity_reader("length", POSITIVE)]
_Mass = Annotated[float, quantity_reader("mass", Bound(at_least=0.0))]
_Density = Annotated[float, quantity_reader("density", POSITIVE)]
_Side = Literal["positive", "negative"]
_MOTOR_MASSES = tuple(f"motor {name}" for name in JOINTS)
_MASS_READER = Reader(
    lambda value: value if value in _MOTOR_MASSES else units.parse_quantity(value, "mass"),
    {"type": "string"},
    ("mass",),
    f"or {', '.join(_MOTOR_MASSES)}",
)
_Moment = Annotated[float, quantity_reader("inertia", Bound(at_least=0.0))]
_Product = Annotated[float, quantity_reader("inertia")]


class AxesModel(Model):
    """Unit vectors in the base frame at q = 0."""

    joint1: Axis
    """First axis, about which the whole mechanism turns. It is the axis of roll."""
    joint2: Axis
    """Second axis, at the angle alpha to joint 1."""
    joint3: Axis
    """Axis of the tool, at the angle beta to joint 2."""


class GeometryModel(Model):
    """Geometry as axes or as angles."""

    axes: AxesModel | None = None
    """Unit vectors of joints 1 to 3 in the base frame at q = 0.

    The alternative is alpha and home_tilt.
    """
    alpha: _PositiveAngle = None
    """Angle between the axes of joints 1 and 2."""
    beta: _PositiveAngle = None
    """Angle between the axes of joints 2 and 3."""
    home_tilt: _Angle = None
    """Tilt of the tool at q = 0."""
    home_roll: _Angle = None
    """Roll of the tool at q = 0. The default follows from beta, or is 0."""
    insertion: Literal["negative", "positive"]
    """Direction of joint 4 that moves the tool inwards."""
    tool_home: Rotations | None = None
    """Rotation from base to tool at q = 0. The default is the frame of the last body."""


class InertiaModel(Model):
    """Inertia about the origin of the body frame."""

    xx: _Moment
    """Moment of inertia about x."""
    yy: _Moment
    """Moment of inertia about y."""
    zz: _Moment
    """Moment of inertia about z."""
    yz: _Product = 0.0
    """Product of inertia. Its sign follows products_of_inertia."""
    xz: _Product = 0.0
    """Product of inertia. Its sign follows products_of_inertia."""
    xy: _Product = 0.0
    """Product of inertia. Its sign follows products_of_inertia."""


class _Solid(Model):
    """Base of the models of all parts of a body."""

    frame: Literal["own", "next"] = "own"
    """Frame of the coordinates: the body's own, or that of the next body at q = 0.

    The frame of the next body depends on the geometry.
    """


class _PlacedMass(_Solid):
    """Base of the models of parts that state their mass instead of a density."""

    at: _Position
    """Position of the centre."""
    mass: Annotated[float | str, _MASS_READER]
    """Mass as a quantity, or the motor that has it: motor roll, motor tilt …"""


class ArcModel(Model):
    """Curved bar about the remote centre, from the joint's own axis to the next joint's axis."""

    shape: Literal["arc"]
    """Bar of rectangular section, bent to a circle about the remote centre."""
    radius: _Length
    """Radius of the centre line."""
    width: _Length
    """Width of the section in the plane of the arc."""
    height: _Length
    """Height of the section across that plane."""
    density: _Density
    """Density of the material."""
    sides: tuple[_Side, _Side] = ("positive", "positive")
    """Sides of the remote centre on which the bar starts on its own axis and ends on the next axis.
    """


class RodModel(_Solid):
    """Straight round bar."""

    shape: Literal["rod"]
    """Straight round bar between two points."""
    start: _Position
    """First end."""
    end: _Position
    """Second end."""
    diameter: _Length
    """Diameter of the section."""
    density: _Density
    """Density of the material."""


class BoxModel(_PlacedMass):
    """Box along the axes of its frame."""

    shape: Literal["box"]
    """Box along the axes of the frame."""
    size: _Position
    """Lengths along the axes."""


class PointModel(_PlacedMass):
    """Point mass."""

    shape: Literal["point"]
    """Mass at one point, such as a motor."""


class _BodyModel(Model):
    """Keys of a body that are not fields of Body."""

    parts: (
        list[
            Annotated[
                ArcModel | RodModel | BoxModel | PointModel, PydanticField(discriminator="shape")
            ]
        ]
        | None
    ) = None
    """Parts of the body. They replace mass, com and inertia."""
    com: _Position = (0.0, 0.0, 0.0)
    inertia: InertiaModel | None = None
    """Inertia about the origin of the body frame. A body without mass omits it."""
    products_of_inertia: Literal["cad", "tensor"] | None = None
    """Sign of the products: cad (∫xy dm, as CAD programs print) or tensor (−∫xy dm)."""
    frame: Rotations
    """Rotation relative to the previous body at q = 0."""


BodyModel = build_class_model(
    Body, {"mass": optional_key(_Mass, "Or parts.")}, base=_BodyModel, without=("com",)
)
_ACTUATION_KEYS: Keywords = {
    "drive": (Reference | None, None),
    "motor": (Reference | None, None),
    "alternatives": (list[Reference], []),
}


def _joint_model(slides: bool) -> Any:
    """Return the model of a joint that is revolute or, if `slides` is true, prismatic."""
    return build_class_model(Joint, _ACTUATION_KEYS, slides=slides, without=("name", "kind"))


JointsModel = joint_mapping_model(_joint_model, every=True)
RANGE_KEYS = {
    name: optional_key(
        Annotated[Any, interval_reader("length" if name == "depth" else "angle")],
        f"Range of the {name}.",
    )
    for name in TASK_COORDINATES
}
"""Keys of the ranges of the task coordinates."""
RangesModel = build_keys_model(RANGE_KEYS)
_BODIES_INFO = PydanticField(
    min_length=4, max_length=4, description="Bodies that joints 1 to 4 move, in this order."
)
RobotModel = build_class_model(
    Robot,
    {
        "source": SOURCE_KEY,
        "geometry": required_key(GeometryModel, "Axes of joints 1 to 3, as vectors or as angles."),
        "bodies": (list[Annotated[Any, Nested(BodyModel)]], _BODIES_INFO),
        "joints": required_key(nested_type(JointsModel), "Ranges, limits and actuation."),
        "limits": (nested_type(RangesModel), RangesModel()),
    },
)
"""Model of a robot file."""

BETA_TOLERANCE = math.radians(0.5)
"""Largest difference between a stated angle beta and the angle that follows from the others, rad.
"""
LARGEST_GYRATION = 1.0
"""Largest plausible radius of gyration of a link, m."""


def robot_from(section: Section) -> Robot:
    """Build the robot that a section describes, with its drives and motors.

    Parameters
    ----------
    section : Section
        Content of a robot file, or the part of a problem file that contains the robot.

    Returns
    -------
    Robot
        The robot.

    Raises
    ------
    ProblemError
        If a value is invalid. The error names the file, the line and the key.
    """
    model: Any = validate_section(section, RobotModel)
    omegas = _joint_axes(section.sub("geometry"), model.geometry)
    frames: list[Array] = []
    for i, body in enumerate(model.bodies):
        turn = _frame_from(section.sub("bodies", i), body.frame, model.geometry)
        frames.append((frames[-1] if frames else np.eye(3)) @ turn)
    geometry = _geometry_from(section.sub("geometry"), model.geometry, omegas, frames[-1])
    joints: Any = tuple(
        _joint_from(section.sub("joints", name), name, getattr(model.joints, name))
        for name in JOINTS
    )
    bodies: Any = []
    for i, body in enumerate(model.bodies):
        placement = _BodyPlacement(i, frames, geometry, joints)
        bodies.append(_body_from(section.sub("bodies", i), body, placement))
    with locate_errors(section):
        return Robot(
            name=model.name,
            geometry=geometry,
            bodies=tuple(bodies),
            joints=joints,
            gravity=read_only_array(model.gravity, (3,)),
            limits=ranges_from(model.limits),
            file=section.file_name,
        )


def ranges_from(model: Any) -> tuple[TaskRange, ...]:
    """Return the ranges of task coordinates that a robot or problem file states."""
    ranges = ((name, getattr(model, name)) for name in TASK_COORDINATES)
    return tuple(TaskRange(name, *ends) for name, ends in ranges if ends is not None)


def _joint_from(section: Section, name: str, model: Any) -> Joint:
    """Build a joint with its drive and motors, which the file names or contains.

    Parameters
    ----------
    section : Section
        Part of the file that describes the joint.
    name : str
        Name of the joint.
    model : object
        The validated section.

    Returns
    -------
    Joint
        The joint.

    Raises
    ------
    ProblemError
        If a value is invalid.
    """
    drive = None if model.drive is None else drive_from(follow_reference(section, "drive"))
    motor = None if model.motor is None else motor_from(follow_reference(section, "motor"))
    indices = range(len(model.alternatives))
    alternatives = tuple(
        motor_from(follow_reference(section, "alternatives", i, file_kind="motor")) for i in indices
    )
    joint_kind = "prismatic" if name == "insertion" else "revolute"
    with locate_errors(section):
        components = {"drive": drive, "motor": motor, "alternatives": alternatives}
        return Joint(**{**dict(model), "name": name, "kind": joint_kind, **components})


def _frame_from(
    section: Section, chain: tuple[tuple[str, float | str], ...], geometry: GeometryModel
) -> Array:
    """Return the rotation matrix of a chain of rotations that may name angles of the geometry.

    Parameters
    ----------
    section : Section
        Part of the file with the chain, for messages.
    chain : tuple of pairs
        Axis x, y or z, and angle of each rotation. The angle is a number in rad, or the name of an
        angle of the geometry, possibly with a minus sign.
    geometry : GeometryModel
        Geometry that states the named angles.

    Returns
    -------
    (3, 3) array
        Rotation matrix.

    Raises
    ------
    ProblemError
        If the file does not state such an angle.
    """
    angles = []
    for axis, angle in chain:
        if isinstance(angle, str):
            name = angle.removeprefix("-")
            value = getattr(geometry, name)
            if name == "home_roll" and geometry.beta is None:
                value = value or 0.0
            if value is None:
                raise section.error(
                    f"names {name}, which geometry does not give", "frame", allowed="angles"
                )
            angle = -value if angle.startswith("-") else value
        angles.append((axis, angle))
    return chain_rotation(tuple(angles))


def chain_rotation(chain: tuple[tuple[str, float], ...]) -> Array:
    """Return the product of rotations about coordinate axes.

    Parameters
    ----------
    chain : tuple of pairs
        Letter of the axis (x, y or z) and angle (rad) of each rotation. The axis belongs to the
        frame that the previous rotations have turned.

    Returns
    -------
    (3, 3) array
        Rotation matrix.
    """
    result = np.eye(3)
    for axis, angle in chain:
        # The rotation about the axis i turns the axis j towards the axis k.
        i = "xyz".index(axis)
        j = (i + 1) % 3
        k = (i + 2) % 3
        turn = np.eye(3)
        turn[j, j] = turn[k, k] = math.cos(angle)
        turn[k, j] = math.sin(angle)
        turn[j, k] = -math.sin(angle)
        result = result @ turn
    return result


def _joint_axes(section: Section, model: GeometryModel) -> list[Array]:
    """Return the axes of joints 1 to 3 in the base frame at q = 0.

    Parameters
    ----------
    section : Section
        Part of the file that describes the geometry.
    model : GeometryModel
        The validated section.

    Returns
    -------
    list of three (3,) arrays
        Unit vectors.

    Raises
    ------
    ProblemError
        If the file states both axes and angles, or too few of them.
    """
    angles = [
        name
        for name in ("alpha", "beta", "home_tilt", "home_roll")
        if getattr(model, name) is not None
    ]
    if model.axes is None:
        return _axes_from_angles(section, model)
    if angles:
        raise section.error(
            "redundant: axes are given", angles[0], allowed="either axes, or alpha with home_tilt"
        )
    with locate_errors(section.sub("axes")):
        return [unit_vector(np.array(axis), f"axes.{name}") for name, axis in model.axes]


def _geometry_from(
    section: Section, model: GeometryModel, omegas: Sequence[Array], last_frame: Array
) -> Geometry:
    """Build the geometry of the robot.

    Parameters
    ----------
    section : Section
        Part of the file that describes the geometry.
    model : GeometryModel
        The validated section.
    omegas : sequence of (3,)
        Axes of joints 1 to 3.
    last_frame : (3, 3)
        Rotation from the frame of the last body to the base frame at q = 0, which is the default of
        the tool frame.

    Returns
    -------
    Geometry
        The geometry.
    """
    locations: dict[str, tuple[str, ...]] = {f"omega{i}": ("axes", f"joint{i}") for i in (1, 2, 3)}
    if model.axes is None:
        locations = {"omega2": ("alpha",), "omega3": ("home_tilt",)}
    tool_home = (
        last_frame if model.tool_home is None else _frame_from(section, model.tool_home, model)
    )
    with locate_errors(section, locations):
        return Geometry(
            omegas[0], omegas[1], omegas[2], tool_home, -1 if model.insertion == "negative" else 1
        )


def _axes_from_angles(section: Section, model: GeometryModel) -> list[Array]:
    """Compute the axes of joints 1 to 3 from the angles in the file.

    They are ω1 = x, ω2 = (cos α, sin α, 0) and ω3 = Rx(home_roll) Ry(home_tilt) x, where α is the
    key alpha, and Rx and Ry are rotations about x and about the tilt axis y.

    Parameters
    ----------
    section : Section
        Part of the file that describes the geometry.
    model : GeometryModel
        The validated section.

    Returns
    -------
    list of three (3,) arrays
        Unit vectors in the base frame at q = 0.

    Raises
    ------
    ProblemError
        If an angle is missing, or if neighbouring axes would be parallel.
    """
    for name in ("alpha", "home_tilt"):
        if getattr(model, name) is None:
            allowed = "axes, or alpha and home_tilt with beta or home_roll"
            raise section.error("missing: this key is required", name, allowed=allowed)
    alpha = float(model.alpha or 0.0)
    tilt = float(model.home_tilt or 0.0)
    for name, angle in (("alpha", alpha), ("beta", model.beta)):
        if angle is not None and not SMALLEST_AXIS_ANGLE < angle < math.pi - SMALLEST_AXIS_ANGLE:
            raise section.error(
                "the axes would be parallel", name, allowed="between 0.1 and 179.9 deg"
            )
    roll = _home_roll(section, model, alpha, tilt)
    omega3 = chain_rotation((("x", roll), ("y", tilt)))[:, 0]
    return [np.array([1.0, 0, 0]), np.array([math.cos(alpha), math.sin(alpha), 0]), omega3]


def _home_roll(section: Section, model: GeometryModel, alpha: float, tilt: float) -> float:
    """Return the roll of the tool at q = 0.

    The roll is the key home_roll or, without this key, the roll that the key beta requires. If the
    file states neither key, the roll is 0.

    Parameters
    ----------
    section : Section
        Part of the file that describes the geometry.
    model : GeometryModel
        The validated section.
    alpha, tilt : float
        Angles alpha and home_tilt, rad.

    Returns
    -------
    float
        Roll, rad.

    Raises
    ------
    ProblemError
        If the stated angles contradict each other, or if no roll gives the stated beta.

    Notes
    -----
    The angles satisfy cos β = cos α cos φ_h + sin α sin φ_h sin ψ_h, where α is the angle between
    axes 1 and 2, β is the angle between axes 2 and 3, φ_h is home_tilt, and ψ_h is home_roll.
    """

    def angle(cosine: float) -> float:
        """Return the angle with a cosine, which rounding may have moved beyond ±1, rad."""
        return math.acos(max(-1.0, min(1.0, cosine)))

    roll = model.home_roll or 0.0
    # cos β = constant + amplitude · sin ψ_h
    constant = math.cos(alpha) * math.cos(tilt)
    amplitude = math.sin(alpha) * math.sin(tilt)
    beta = angle(constant + amplitude * math.sin(roll))
    if model.beta is None or abs(model.beta - beta) <= BETA_TOLERANCE:
        return roll
    if model.home_roll is not None:
        reason = f"alpha, home_tilt and home_roll give {math.degrees(beta):.4f} deg"
        raise section.error(reason, "beta", allowed="within 0.5 deg of it")
    difference = math.cos(model.beta) - constant
    if abs(difference) > abs(amplitude):
        low, high = (math.degrees(angle(constant + sign * abs(amplitude))) for sign in (1, -1))
        reason = "no home_roll gives this beta together with alpha and home_tilt"
        raise section.error(reason, "beta", allowed=f"{low:.4g} to {high:.4g} deg")
    return math.asin(difference / amplitude)


@record
class _BodyPlacement:
    """Position of a body in the chain, with the data of the robot that its parts may need."""

    index: int
    """Index of the body."""
    frames: Sequence[Array]
    """Rotations (3, 3) from all bodies to the base at q = 0."""
    geometry: Geometry
    joints: Sequence[Joint]

    @property
    def frame(self) -> Array:
        """Rotation (3, 3) from the body to the base at q = 0."""
        return self.frames[self.index]

    def axis(self, beyond: int) -> Array:
        """Return the unit vector (3,) of a joint axis in the frame of the body.

        Parameters
        ----------
        beyond : int
            0 for the joint that moves the body, and 1 for the next joint.
        """
        return self.frame.T @ self.geometry.axes[self.index + beyond]


def _body_from(section: Section, model: Any, placement: _BodyPlacement) -> Body:
    """Build a body from its mass, centre and inertia, or from its parts.

    Parameters
    ----------
    section : Section
        Part of the file that describes the body.
    model : object
        The validated section.
    placement : _BodyPlacement
        Position of the body in the robot.

    Returns
    -------
    Body
        The body.

    Raises
    ------
    ProblemError
        If a value is invalid.
    """
    if model.parts is not None:
        return _body_from_parts(section, model, placement)
    if model.mass is None:
        raise section.error(
            "missing: this key is required", "mass", allowed="mass with com and inertia, or parts"
        )
    tensor = _inertia_tensor(section, model)
    with locate_errors(section):
        try:
            body = Body(model.name, model.mass, np.array(model.com), tensor, placement.frame)
        except ProblemError as error:
            error.reason += _sign_hint(model, tensor) if model.mass > 0 else ""
            raise
    return _check_gyration(section, body)


def _check_gyration(section: Section, body: Body) -> Body:
    """Raise ProblemError if the inertia of a body is implausible for its mass.

    The radius of gyration of a link is at most `LARGEST_GYRATION`. A larger one suggests wrong
    units of mass or inertia.

    Parameters
    ----------
    section : Section
        Part of the file that describes the body, for messages.
    body : Body
        The body.

    Returns
    -------
    Body
        The body unchanged.
    """
    largest_moment = principal_moments(body.mass, body.com, body.inertia)[2]
    gyration = math.sqrt(largest_moment / body.mass) if body.mass else 0.0
    if gyration > LARGEST_GYRATION:
        reason = (
            f"implausible: a radius of gyration of {gyration:.3g} m; check the units of mass "
            "and inertia"
        )
        raise section.error(
            reason, "inertia", allowed=f"a radius of gyration up to {LARGEST_GYRATION:g} m"
        )
    return body


def _body_from_parts(section: Section, model: Any, placement: _BodyPlacement) -> Body:
    """Build a body whose mass and inertia are the sums over its parts.

    Parameters
    ----------
    section : Section
        Part of the file that describes the body.
    model : object
        Validated content of the section, with values in SI units.
    placement : _BodyPlacement
        Position of the body in the robot.

    Returns
    -------
    Body
        The body.

    Raises
    ------
    ProblemError
        If a value is invalid, or if the file also states the mass, the centre of mass or the
        inertia.
    """
    for key in ("mass", "com", "inertia", "products_of_inertia"):
        if section.has_key(key):
            raise section.error(
                "redundant: it follows from the parts",
                key,
                allowed="either parts, or mass, com and inertia",
            )
    solids = [
        _solid_moments(section.sub("parts", i), model_part, placement)
        for i, model_part in enumerate(model.parts)
    ]
    total = sum(solids, shapes.point_moments(0.0, np.zeros(3)))
    with locate_errors(section, {"inertia": ("parts",), "mass": ("parts",)}):
        body = Body(model.name, total.mass, total.com, total.inertia, placement.frame)
    return _check_gyration(section, body)


def _solid_moments(section: Section, model: Any, placement: _BodyPlacement) -> shapes.MassMoments:
    """Compute the mass of a part of a body, and the first and second moments of this mass.

    Parameters
    ----------
    section : Section
        Part of the file that describes the part of the body.
    model : object
        The validated section.
    placement : _BodyPlacement
        Position of the body in the robot.

    Returns
    -------
    MassMoments
        Moments about the origin of the body frame.

    Raises
    ------
    ProblemError
        If the shape is impossible.
    """
    is_last = placement.index == len(placement.frames) - 1
    if isinstance(model, ArcModel):
        if placement.index > 1:
            raise section.error(
                "an arc needs a further axis after this body", "shape", allowed="rod, box, point"
            )
        if model.width >= 2 * model.radius:
            raise section.error(
                "reaches beyond the remote centre", "width", allowed="less than twice the radius"
            )
        start, end = (
            (1 if side == "positive" else -1) * placement.axis(i)
            for i, side in enumerate(model.sides)
        )
        return shapes.arc_moments(
            start, end, model.radius, section=(model.width, model.height), density=model.density
        )
    if model.frame == "next" and is_last:
        raise section.error("the last body has no next frame", "frame", allowed="own")
    # Rotation from the frame of the coordinates in the file to the frame of the body.
    turn = (
        np.eye(3)
        if model.frame == "own"
        else placement.frame.T @ placement.frames[placement.index + 1]
    )
    if isinstance(model, RodModel):
        start = np.array(model.start)
        end = np.array(model.end)
        if not np.any(end - start):
            raise section.error(
                "the rod has no length", "end", allowed="a different point than start"
            )
        return shapes.rod_moments(start, end, model.diameter, model.density).rotated(turn)
    mass = _part_mass(section, model, placement.joints)
    size = np.array(model.size) if isinstance(model, BoxModel) else np.zeros(3)
    return shapes.box_moments(mass, np.array(model.at), size).rotated(turn)


def _part_mass(section: Section, model: Any, joints: Sequence[Joint]) -> float:
    """Return the mass of a part, which may be the mass of a joint's motor.

    Parameters
    ----------
    section : Section
        Part of the file that describes the part of the body.
    model : object
        The validated section. Its mass is a number in kg, or a text such as "motor roll".
    joints : sequence of Joint
        Joints with their motors.

    Returns
    -------
    float
        Mass, kg.

    Raises
    ------
    ProblemError
        If the mass is negative, or if the motor or its mass is missing.
    """
    if not isinstance(model.mass, str):
        if model.mass < 0:
            raise section.error("a mass cannot be negative", "mass", allowed="0 kg or more")
        return float(model.mass)
    motor = joints[_MOTOR_MASSES.index(model.mass)].motor
    if motor is None or motor.mass is None:
        reason = (
            "this joint has no motor" if motor is None else f"the file of {motor.name} has no mass"
        )
        raise section.error(
            reason, "mass", allowed="a quantity, or the motor of a joint with a mass in its file"
        )
    return motor.mass


def _inertia_tensor(section: Section, model: Any) -> Array:
    """Return the inertia tensor of a body in the sign convention of this package.

    The products of inertia are −∫xy dm. The file may state them with the opposite sign, as CAD
    programs do.

    Parameters
    ----------
    section : Section
        Part of the file that describes the body, for messages.
    model : object
        Validated content of the section.

    Returns
    -------
    (3, 3) array
        Inertia about the origin of the body frame, kg·m².

    Raises
    ------
    ProblemError
        If the inertia or the sign convention is missing.
    """
    inertia = model.inertia
    convention = model.products_of_inertia
    if inertia is None:
        if model.mass > 0:
            raise section.error("missing: a body with mass needs an inertia", "inertia")
        return np.zeros((3, 3))
    sign = -1.0 if convention == "cad" else 1.0
    xy = sign * inertia.xy
    xz = sign * inertia.xz
    yz = sign * inertia.yz
    if convention is None and any((xy, xz, yz)):
        reason = "missing: the sign convention of the products of inertia"
        allowed = "cad (∫xy dm, as CAD programs print) or tensor (−∫xy dm)"
        raise section.error(reason, "products_of_inertia", allowed=allowed)
    return np.array([[inertia.xx, xy, xz], [xy, inertia.yy, yz], [xz, yz, inertia.zz]])


def _sign_hint(model: Any, tensor: Array) -> str:
    """Return the end of the message about an impossible inertia tensor.

    The usual cause is the sign of the products of inertia. The text says whether the opposite sign
    gives a possible tensor.

    Parameters
    ----------
    model : object
        The validated section of the body.
    tensor : (3, 3) array
        Inertia about the origin of the body frame, kg·m².

    Returns
    -------
    str
        End of the message. Empty if the file does not state a sign convention.
    """
    convention = model.products_of_inertia
    if convention is None:
        return ""
    other_convention = "tensor" if convention == "cad" else "cad"
    hint = f"; the usual cause is the sign of the products of inertia (now {convention})"
    # This difference has the opposite sign outside the diagonal.
    flipped_tensor = 2 * np.diag(np.diag(tensor)) - tensor
    flipped = principal_moments(model.mass, read_only_array(model.com, (3,)), flipped_tensor)
    if is_possible_inertia(flipped):
        moments_text = ", ".join(f"{moment:.4g}" for moment in flipped)
        return f"{hint}, and {other_convention} gives possible moments, ({moments_text}) kg*m^2"
    return f"{hint}, but {other_convention} fails as well; check unit and reference point"
