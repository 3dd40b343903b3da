"""Points and motions as frozen values, SI and radians: what a tool does one entry after the other, or single joints."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

from ssm_planner.problem.limits import TASK
from ssm_planner.problem.robot import JOINTS, Robot
from ssm_planner.problem.value import (
    Bound,
    Count,
    NotNegative,
    Positive,
    Quantity,
    Value,
    check_name,
)

LARGEST_GRID = 50
"""Rows or columns of a scan."""
Line = Annotated[int, Bound(above=0)]
OF_TIP = ("line", "arc", "retina")
"""Curves that the tip follows in space."""
ALONE = ("roll", "tilt", "spin", "insert")
"""Straight motions of one coordinate."""
SMALLEST_BLEND = 1e-5
"""m: below it the robot all but stops in a corner, and a motion takes minutes to be found."""


@dataclass(frozen=True, eq=False)
class Task(Value):
    """A point in task coordinates, rad and m; those left out are held."""

    roll: Annotated[float, Quantity("angle")] | None = None
    """Turn of the plane of tilt about joint 1, rad."""
    tilt: Annotated[float, Quantity("angle")] | None = None
    """Signed angle from joint 1 to the tool about the tilt axis, rad."""
    spin: Annotated[float, Quantity("angle")] | None = None
    """Turn of the tool about itself, rad."""
    depth: Annotated[float, Quantity("length")] | None = None
    """How far the tip is beyond the remote centre, m."""
    line: Line | None = field(default=None, compare=False)
    """Line of the problem file, for messages."""

    @property
    def given(self) -> dict[str, float]:
        """The coordinates that are not held, by name in TASK."""
        return {name: value for name in TASK if (value := getattr(self, name)) is not None}


@dataclass(frozen=True, eq=False)
class Joints(Value):
    """A point as joint values; rad, rad, rad, m."""

    values: tuple[float, float, float, float]
    line: Line | None = field(default=None, compare=False)


@dataclass(frozen=True, eq=False)
class Tip(Value):
    """A point as position of the tool's tip in the base frame, m, and spin, rad."""

    position: tuple[float, float, float]
    spin: float
    line: Line | None = field(default=None, compare=False)

    def _check(self) -> None:
        if sum(x * x for x in self.position) < 1e-12:
            reason = "the tip at the remote centre leaves roll and tilt open"
            raise self._wrong(
                "position", reason, "a point away from [0, 0, 0]; or roll, tilt, spin and depth"
            )


Point = Task | Joints | Tip


@dataclass(frozen=True, eq=False)
class Straight(Value):
    """Straight in task coordinates to those named, rad and m; those left out are held."""

    kind: ClassVar[str] = "straight"
    roll: float | None = None
    tilt: float | None = None
    spin: float | None = None
    depth: float | None = None
    duration: Annotated[Positive, Quantity("time")] | None = None
    """Asked for; the motion then takes it with the least motor heat, s."""
    name: str = ""
    """By default the coordinate that moves (insert: depth), or straight."""
    line: Line | None = field(default=None, compare=False)
    blend: Annotated[Positive, Quantity("length")] | None = None
    """Distance of the tip from the end within which the corner to the next motion is rounded, 10 µm or more."""

    def _check(self) -> None:
        _check_blend(self)
        if not self.to.given:
            raise self._wrong("to", "no point is given", "roll, tilt, spin or depth", "None")
        if not self.name:
            given = tuple(self.to.given)
            name = given[0] if len(given) == 1 else "straight"
            object.__setattr__(self, "name", "insert" if name == "depth" else name)

    @property
    def to(self) -> Task:
        """Where it ends."""
        return Task(self.roll, self.tilt, self.spin, self.depth, self.line)


@dataclass(frozen=True, eq=False)
class Free(Value):
    """To a point, on whatever way the planner finds fastest."""

    kind: ClassVar[str] = "free"
    to: Task | Joints | Tip
    through: tuple[Task | Joints | Tip, ...] = ()
    """Points passed without stopping, in order."""
    duration: Positive | None = None
    """Asked for; the motion then takes it with the least motor heat, s."""
    name: str = "free"
    line: Line | None = field(default=None, compare=False)
    spin_free: bool = False
    """The spin at the end is whatever makes the motion fastest; that of `to` does not count."""

    def _check(self) -> None:
        _check_given(self)
        if self.spin_free and isinstance(self.to, Joints):
            raise self._wrong(
                "spin_free", "joints fix the spin", "a target in task coordinates, or a tip", "True"
            )


@dataclass(frozen=True, eq=False)
class Follow(Value):
    """Along a given curve, from where the motion is to a point."""

    kind: ClassVar[str] = "path"
    to: Task | Joints | Tip
    through: tuple[Task | Joints | Tip, ...] = ()
    """Points of the curve in order; of an arc the one that it passes, of a line none."""
    name: str = "path"
    curve: Literal["spline", "samples", "line", "arc", "retina"] = "spline"
    """A natural cubic spline in joint space, over the distance from point to point in joint velocities; the same through
    samples, at rest where these turn by more than 30°, timed by TOPP-RA; a line or an arc of the tip, spin in
    proportion to the way; or along the retina on a great circle, the tip at a distance from it."""
    file: str | None = field(default=None, compare=False)
    """Table that the points come from, whose lines are theirs."""
    line: Line | None = field(default=None, compare=False)
    duration: Positive | None = None
    """Asked for, s; not of samples."""
    blend: Positive | None = None
    """Of a line or an arc: distance of the tip from its end within which the corner to the next motion is rounded, m."""
    constant_speed: Annotated[Positive, Quantity("velocity")] | None = None
    """Speed that the tip keeps all along a line or an arc, but for the ramps at its ends."""
    distance: Annotated[Positive, Quantity("length")] | None = None
    """Of the tip from the retina, along which it goes; `to` says where the tool then points."""

    def _check(self) -> None:
        _check_blend(self)
        if self.constant_speed is not None:
            self._check_constant()
        if (self.distance is None) == (self.curve == "retina"):
            raise self._wrong(
                "distance", "of a curve along the retina, and of none but that", "a length, or none"
            )
        if self.distance is not None and not (isinstance(self.to, Task) and self.to.depth is None):
            reason = "how deep the tip goes is what distance says"
            raise self._wrong("to", reason, "roll, tilt, spin", type(self.to).__name__)
        if self.duration is not None and self.curve == "samples":
            raise self._wrong("duration", "not for samples, which TOPP-RA alone times", "None")
        if self.blend is not None and not self.blends:
            raise self._wrong("blend", f"not for a curve of this kind ({self.curve})", "None")
        counts = {"line": 0, "arc": 1, "retina": 0}
        wanted = counts.get(self.curve, len(self.through))
        if len(self.through) != wanted:
            raise self._wrong(
                "through", f"not for a curve of this kind ({self.curve})", f"{wanted} points"
            )
        _check_given(self)

    def _check_constant(self) -> None:
        speed = self.constant_speed
        if self.curve not in OF_TIP:
            reason = f"not for a curve of this kind ({self.curve})"
            raise self._wrong("constant_speed", reason, "a line or an arc", speed)
        if self.duration is not None or self.blend is not None:
            reason = "a duration or a rounded corner leaves no constant speed"
            raise self._wrong(
                "constant_speed", reason, "none of these, or no constant_speed", speed
            )

    @property
    def blends(self) -> bool:
        """Corners at its ends may be rounded."""
        return self.curve in ("line", "arc") and self.constant_speed is None


def _check_blend(motion: Straight | Follow) -> None:
    if motion.blend is not None and motion.blend < SMALLEST_BLEND:
        reason = "so near to its corner the robot all but stops"
        raise motion._wrong(
            "blend",
            reason,
            f"at least {1e3 * SMALLEST_BLEND:g} mm, or no blend",
            f"{1e3 * motion.blend:g} mm",
        )


def _check_given(motion: Free | Follow) -> None:
    """Every point says something."""
    for i, point in enumerate((*motion.through, motion.to)):
        if isinstance(point, Task) and not point.given:
            place = "to" if i == len(motion.through) else f"through[{i}]"
            raise motion._wrong(
                place, "no point is given", "roll, tilt, spin or depth; joints; or a tip", "Task()"
            )


@dataclass(frozen=True, eq=False)
class Dwell(Value):
    """At rest for a while."""

    kind: ClassVar[str] = "dwell"
    duration: Annotated[Positive, Quantity("time")]
    """s."""
    name: str = "dwell"
    line: Line | None = field(default=None, compare=False)


@dataclass(frozen=True, eq=False)
class Scan(Value):
    """Spots on the retina: a raster, or rings one after the other, about the point where the tool's axis meets it."""

    kind: ClassVar[str] = "scan"
    at: Task
    """Where the tool points to the middle of the pattern: tilt, and roll and spin where they are not 0."""
    distance: Annotated[Positive, Quantity("length")]
    """Of the tip from the retina, m."""
    diameters: tuple[Positive, ...] = ()
    """Of the rings, m, growing; none for a raster."""
    rows: Annotated[Count, Quantity("number")] = 0
    """Of a raster; 0 for rings."""
    columns: Annotated[Count, Quantity("number")] = 0
    """Of a raster; 0 for rings."""
    spacing: Annotated[Positive, Quantity("length")] = 0.6e-3
    """Between neighbouring spots, m; on a ring as nearly as a whole number of spots allows."""
    dwell: Annotated[NotNegative, Quantity("time")] = 0.0
    """At every spot, s; 0: the spots are passed without stopping."""
    order: Literal["given", "fastest"] = "given"
    """Of the spots: as the pattern gives them, or that in which all of them, of all rings, are visited soonest."""
    name: str = "scan"
    line: Line | None = field(default=None, compare=False)
    duration: ClassVar[None] = None

    def _check(self) -> None:
        if self.at.tilt is None:
            raise self._wrong(
                "at", "missing: no pattern is there without a tilt", "roll, tilt, spin"
            )
        if self.at.depth is not None:
            raise self._wrong(
                "at", "how deep the tip goes is what distance says", "roll, tilt, spin"
            )
        if list(self.diameters) != sorted(set(self.diameters)):
            raise self._wrong("diameters", "not rings one around the other", "growing lengths")
        for name in ("rows", "columns"):
            count = getattr(self, name)
            if self.diameters and count:
                raise self._wrong(
                    name, "of a raster, but there are rings as well", "0, or no diameters"
                )
            if not self.diameters and not 1 <= count <= LARGEST_GRID:
                raise self._wrong(
                    name,
                    "not a count",
                    f"a whole number from 1 to {LARGEST_GRID}; or diameters of rings",
                )


Motion = Straight | Free | Follow | Dwell | Scan


def key_of(motion: Motion) -> str:
    """The key of a problem file under which it stands."""
    if isinstance(motion, Straight):
        return motion.name if motion.name in ALONE else motion.kind
    return motion.curve.replace("samples", "path") if isinstance(motion, Follow) else motion.kind


@dataclass(frozen=True, eq=False)
class Stroke(Value):
    """One joint back and forth over centre ± reach; rad or m, and their rates."""

    joint: str
    centre: Annotated[float, Quantity("angle", "length")]
    """Middle of the stroke."""
    reach: Annotated[Positive, Quantity("angle", "length")]
    """To either side of the centre."""
    velocity: Annotated[Positive, Quantity("angular_velocity", "velocity")]
    """Between the ramps."""
    acceleration: Annotated[Positive, Quantity("angular_acceleration", "acceleration")]
    """Of the ramps."""
    home: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    """Where the other joints are held."""

    def _check(self) -> None:
        check_name(self.joint, JOINTS, "Stroke.joint", "not a joint known here")


@dataclass(frozen=True, eq=False)
class Motorisation(Value):
    """Strokes of a robot's joints, each a run of its own; no joint twice. The joints' limits do not apply."""

    name: str
    robot: Robot
    strokes: tuple[Stroke, ...]
    file: str | None = field(default=None, compare=False)

    def _check(self) -> None:
        drives = {joint.name: joint.drive for joint in self.robot.joints}
        for i, stroke in enumerate(self.strokes):
            field = f"strokes[{i}].joint"
            if drives[stroke.joint] is None:
                reason = "this joint has no drive, so there is no motor to size"
                raise self._wrong(field, reason, "a driven joint", stroke.joint)
            if any(other.joint == stroke.joint for other in self.strokes[:i]):
                raise self._wrong(
                    field, "a second run of this joint", "one run per joint", stroke.joint
                )
