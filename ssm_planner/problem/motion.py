"""Define points and motions of a tool, and strokes of single joints, in SI units and radians.

The motions of a `Problem` are Straight, Free, Follow, Dwell and Scan. Their ends are points of
three types: Task (task coordinates), Joints (joint positions) and Tip (position of the tip). A
`Motorisation` contains strokes of single joints, for which motors are sized without a plan.
"""

from typing import Annotated, Any, ClassVar, Literal

from ssm_planner.deprecation import Renamed
from ssm_planner.problem.limits import TASK_COORDINATES
from ssm_planner.problem.robot import JOINTS, Robot
from ssm_planner.problem.value import (
    Bound,
    Count,
    Delay,
    Length,
    Positive,
    Time,
    Value,
    check_name,
    uncompared_field,
)
from ssm_planner.typing import Array, record

LARGEST_SCAN_GRID = 50
"""Largest number of rows or columns of a scan."""
Line = Annotated[int, Bound(above=0)]
TIP_CURVES = ("line", "arc", "retina")
"""Values of `Follow.curve` whose curve the tip follows in space."""
SINGLE_COORDINATE_MOTIONS = ("roll", "tilt", "spin", "insert")
"""Names of straight motions that change only one task coordinate."""
SMALLEST_BLEND = 1e-5
"""Smallest blend distance, m.

At a smaller distance, the robot almost stops in the corner, and planning takes minutes.
"""


@record
class Task(Value):
    """Point in task coordinates, rad and m. A coordinate that is None keeps its value.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> point = ssm.Task(tilt=-95 * ssm.deg, depth=5 * ssm.mm)
    >>> sorted(point.set_coordinates)
    ['depth', 'tilt']
    """

    roll: Annotated[float, "angle"] | None = None
    """Rotation of the tilt plane about joint 1, rad."""
    tilt: Annotated[float, "angle"] | None = None
    """Signed angle from joint 1 to the tool about the tilt axis, rad."""
    spin: Annotated[float, "angle"] | None = None
    """Rotation of the tool about its own axis, rad."""
    depth: Annotated[float, "length"] | None = None
    """Distance of the tip beyond the remote centre, m."""
    line: Line | None = uncompared_field()
    """Line of the problem file, for messages."""

    @property
    def set_coordinates(self) -> dict[str, float]:
        """Coordinates that are not None, by name in `TASK_COORDINATES`."""
        return {
            name: value for name in TASK_COORDINATES if (value := getattr(self, name)) is not None
        }

    given = Renamed("set_coordinates")


@record
class Joints(Value):
    """Point given by joint positions in rad, rad, rad and m.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.Joints((0.0, 0.3, 0.0, -5 * ssm.mm)).values
    (0.0, 0.3, 0.0, -0.005)
    """

    values: tuple[float, float, float, float]
    line: Line | None = uncompared_field()

    @classmethod
    def from_array(cls, q: Array) -> "Joints":
        """Return the point with the joint positions (4,) in an array, rad and m for joint 4."""
        positions: Any = q
        return cls(positions)


@record
class Tip(Value):
    """Point given by the position of the tool tip in the base frame, m, and the spin, rad.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.Tip((0.0, 0.0, -5 * ssm.mm), spin=0.0).position
    (0.0, 0.0, -0.005)
    """

    position: tuple[float, float, float]
    spin: float
    line: Line | None = uncompared_field()

    def _check(self) -> None:
        """Raise ProblemError for a tip at the remote centre.

        There, the position of the tip does not determine the direction of the tool.
        """
        if sum(x * x for x in self.position) < 1e-12:
            reason = "the tip at the remote centre leaves roll and tilt open"
            raise self._field_error(
                "position", reason, "a point away from [0, 0, 0]; or roll, tilt, spin and depth"
            )


Point = Task | Joints | Tip


@record
class Straight(Value):
    """Straight motion in task coordinates, rad and m. A coordinate that is None keeps its value.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> motion = ssm.Straight(depth=20 * ssm.mm, duration=1.5)
    >>> motion.depth, motion.duration
    (0.02, 1.5)
    """

    kind: ClassVar[str] = "straight"
    roll: float | None = None
    tilt: float | None = None
    spin: float | None = None
    depth: float | None = None
    duration: Time | None = None
    """Requested duration, s. The motion then minimises effort."""
    name: str = ""
    """Name of the motion.

    The default is the coordinate that moves (insert for depth), or straight.
    """
    line: Line | None = uncompared_field()
    blend: Length | None = None
    """Tip distance from the end within which the corner to the next motion is rounded, m.

    At least 10 µm.
    """

    def _check(self) -> None:
        """Check the fields, and set the default name.

        Raises ProblemError if the end point is empty or the blend distance is too small.
        """
        _check_blend(self)
        if not self.to.set_coordinates:
            raise self._field_error("to", "the point is empty", "roll, tilt, spin or depth", "None")
        if not self.name:
            coordinates = tuple(self.to.set_coordinates)
            name = coordinates[0] if len(coordinates) == 1 else "straight"
            object.__setattr__(self, "name", "insert" if name == "depth" else name)

    @property
    def to(self) -> Task:
        """End point."""
        return Task(self.roll, self.tilt, self.spin, self.depth, self.line)


@record
class Free(Value):
    """Motion to a point along the fastest path that the planner finds.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> motion = ssm.Free(ssm.Task(tilt=-110 * ssm.deg, depth=5 * ssm.mm), spin_free=True)
    >>> motion.to.set_coordinates["depth"]
    0.005
    """

    kind: ClassVar[str] = "free"
    to: Point
    through: tuple[Point, ...] = ()
    """Points to pass without stopping, in order."""
    duration: Positive | None = None
    """Requested duration, s. The motion then minimises effort."""
    name: str = "free"
    line: Line | None = uncompared_field()
    spin_free: bool = False
    """True if the planner chooses the fastest final spin. The spin of `to` is then ignored."""

    def _check(self) -> None:
        """Raise ProblemError if a point is empty, or if joints contradict a free spin."""
        _check_stated_points(self)
        if self.spin_free and isinstance(self.to, Joints):
            raise self._field_error(
                "spin_free", "joints fix the spin", "a target in task coordinates, or a tip", "True"
            )


@record
class Follow(Value):
    """Motion along a prescribed curve from the present point to another one.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> path = ssm.Follow(ssm.Task(tilt=-95 * ssm.deg), through=[ssm.Task(tilt=-90 * ssm.deg)])
    >>> path.curve
    'spline'
    """

    kind: ClassVar[str] = "path"
    to: Point
    through: tuple[Point, ...] = ()
    """Points of the curve in order: exactly one for an arc, and 0 for a line or the retina."""
    name: str = "path"
    curve: Literal["spline", "samples", "line", "arc", "retina"] = "spline"
    """Name of the curve.

    A "spline" is a natural cubic spline in joint space. Its parameter is the distance between
    points in joint velocities. The curve "samples" is the same spline through samples. TOPP-RA
    times it, with stops at corners of more than 30°. A "line" and an "arc" are curves of the tip,
    along which the spin changes in proportion to the path length. The curve "retina" is a great
    circle at a constant distance from the retina.
    """
    file: str | None = uncompared_field()
    """Table that contains the points. Their lines refer to it."""
    line: Line | None = uncompared_field()
    duration: Positive | None = None
    """Requested duration, s. Not allowed for samples."""
    blend: Positive | None = None
    """Tip distance from the end of a line or arc within which the next corner is rounded, m."""
    constant_speed: Annotated[Positive, "velocity"] | None = None
    """Speed of the tip along a line or arc, except for the ramps at its ends, m/s."""
    distance: Length | None = None
    """Distance of the tip from the retina, m. `to` then gives the final direction of the tool."""

    def _check(self) -> None:
        """Raise ProblemError if a field does not fit the curve."""
        _check_blend(self)
        if self.constant_speed is not None:
            self._check_constant_speed()
        if (self.distance is None) == (self.curve == "retina"):
            raise self._field_error(
                "distance",
                "required for curve retina, and not allowed for other curves",
                "a length, or none",
            )
        if self.distance is not None and not (isinstance(self.to, Task) and self.to.depth is None):
            reason = "do not give depth: distance already determines it"
            raise self._field_error("to", reason, "roll, tilt, spin", type(self.to).__name__)
        if self.duration is not None and self.curve == "samples":
            raise self._field_error(
                "duration", "not allowed for samples because only TOPP-RA can time them", "None"
            )
        if self.blend is not None and not self.blends:
            raise self._field_error("blend", f"not allowed for curve {self.curve}", "None")
        counts = {"line": 0, "arc": 1, "retina": 0}
        required = counts.get(self.curve, len(self.through))
        if len(self.through) != required:
            raise self._field_error(
                "through", f"not allowed for curve {self.curve}", f"{required} points"
            )
        _check_stated_points(self)

    def _check_constant_speed(self) -> None:
        """Raise ProblemError if the curve or the timing excludes the constant speed."""
        speed = self.constant_speed
        if self.curve not in TIP_CURVES:
            reason = f"not allowed for curve {self.curve}"
            raise self._field_error("constant_speed", reason, "a line or an arc", speed)
        if self.duration is not None or self.blend is not None:
            reason = "a duration or a rounded corner excludes a constant speed"
            raise self._field_error(
                "constant_speed", reason, "none of these, or no constant_speed", speed
            )

    @property
    def blends(self) -> bool:
        """True if the corners at both ends may be rounded."""
        return self.curve in ("line", "arc") and self.constant_speed is None


def _check_blend(motion: Straight | Follow) -> None:
    """Raise ProblemError if the corner after a motion is rounded too tightly.

    Parameters
    ----------
    motion : Straight or Follow
        Motion whose blend distance, if it has one, must be at least `SMALLEST_BLEND`.
    """
    if motion.blend is not None and motion.blend < SMALLEST_BLEND:
        reason = "the robot would almost stop in such a tight corner"
        raise motion._field_error(
            "blend",
            reason,
            f"at least {1e3 * SMALLEST_BLEND:g} mm, or no blend",
            f"{1e3 * motion.blend:g} mm",
        )


def _check_stated_points(motion: Free | Follow) -> None:
    """Raise ProblemError if a point of a motion does not state any coordinate.

    Parameters
    ----------
    motion : Free or Follow
        Motion with an end point and possibly points before it.
    """
    for i, point in enumerate((*motion.through, motion.to)):
        if isinstance(point, Task) and not point.set_coordinates:
            key = "to" if i == len(motion.through) else f"through[{i}]"
            raise motion._field_error(
                key, "the point is empty", "roll, tilt, spin or depth; joints; or a tip", "Task()"
            )


@record
class Dwell(Value):
    """Pause at rest.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> dwell = ssm.Dwell(0.2)
    >>> dwell.duration
    0.2
    """

    kind: ClassVar[str] = "dwell"
    duration: Time
    """Duration of the pause, s."""
    name: str = "dwell"
    line: Line | None = uncompared_field()


@record
class Scan(Value):
    """Visit of many spots on the retina, which form a raster or concentric rings.

    The tool axis at the point `at` meets the retina in the centre of the pattern.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> grid = ssm.Scan(ssm.Task(tilt=-110 * ssm.deg), 2 * ssm.mm, rows=3, columns=4)
    >>> grid.rows * grid.columns
    12
    """

    kind: ClassVar[str] = "scan"
    at: Task
    """Direction of the tool to the centre of the pattern: tilt, and optionally roll and spin."""
    distance: Length
    """Distance of the tip from the retina, m."""
    diameters: tuple[Positive, ...] = ()
    """Increasing diameters of the rings, m. Empty for a raster."""
    rows: Annotated[Count, "number"] = 0
    """Rows of a raster, or 0 for rings."""
    columns: Annotated[Count, "number"] = 0
    """Columns of a raster, or 0 for rings."""
    spacing: Length = 0.6e-3
    """Distance between neighbouring spots, m.

    On a ring it is rounded to a whole number of spots.
    """
    dwell: Delay = 0.0
    """Pause at every spot, s. With 0 the tool passes the spots without stopping."""
    order: Literal["given", "fastest"] = "given"
    """Order of the spots: that of the pattern, or the fastest order of all spots of all rings."""
    name: str = "scan"
    line: Line | None = uncompared_field()
    duration: ClassVar[None] = None

    def _check(self) -> None:
        """Raise ProblemError if the direction is incomplete or the pattern is ambiguous."""
        if self.at.tilt is None:
            raise self._field_error("at", "missing: the pattern needs a tilt", "roll, tilt, spin")
        if self.at.depth is not None:
            raise self._field_error(
                "at", "do not give depth: distance already determines it", "roll, tilt, spin"
            )
        if list(self.diameters) != sorted(set(self.diameters)):
            raise self._field_error("diameters", "rings must be concentric", "increasing lengths")
        for name in ("rows", "columns"):
            count = getattr(self, name)
            if self.diameters and count:
                raise self._field_error(
                    name, "only for a raster, but diameters define rings", "0, or no diameters"
                )
            if not self.diameters and not 1 <= count <= LARGEST_SCAN_GRID:
                raise self._field_error(
                    name,
                    "not a count",
                    f"a whole number from 1 to {LARGEST_SCAN_GRID}; or diameters of rings",
                )


Motion = Straight | Free | Follow | Dwell | Scan


def motion_key(motion: Motion) -> str:
    """Return the key that represents a motion in a problem file, such as "tilt" or "scan"."""
    if isinstance(motion, Straight):
        return motion.name if motion.name in SINGLE_COORDINATE_MOTIONS else motion.kind
    return motion.curve.replace("samples", "path") if isinstance(motion, Follow) else motion.kind


@record
class Stroke(Value):
    """Motion of one joint back and forth over centre ± reach.

    Positions are in rad or m, and their derivatives in rad/s, rad/s², m/s or m/s².
    """

    joint: str
    centre: Annotated[float, "angle or length"]
    """Middle of the stroke."""
    reach: Annotated[Positive, "angle or length"]
    """Distance from the centre to either end."""
    velocity: Annotated[Positive, "angular_velocity or velocity"]
    """Velocity between the ramps."""
    acceleration: Annotated[Positive, "angular_acceleration or acceleration"]
    """Acceleration of the ramps."""
    home: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    """Positions of the other joints."""

    def _check(self) -> None:
        check_name(self.joint, JOINTS, "Stroke.joint", "unknown joint")


@record
class Motorisation(Value):
    """Back-and-forth strokes of a robot's joints, for which motors are sized.

    Each stroke is a separate run, and each joint has at most one. The limits of the joints do not
    apply.
    """

    name: str
    robot: Robot
    strokes: tuple[Stroke, ...]
    file: str | None = uncompared_field()

    def _check(self) -> None:
        """Raise ProblemError if a joint has no drive, or has two strokes."""
        drives = {joint.name: joint.drive for joint in self.robot.joints}
        for i, stroke in enumerate(self.strokes):
            field = f"strokes[{i}].joint"
            if drives[stroke.joint] is None:
                reason = "this joint has no drive, so there is no motor to size"
                raise self._field_error(field, reason, "a driven joint", stroke.joint)
            if any(earlier.joint == stroke.joint for earlier in self.strokes[:i]):
                raise self._field_error(
                    field, "this joint already has a run", "one run per joint", stroke.joint
                )
