"""Define the keys of the motion list of problem files, and build the motions from their values.

Each entry of the list has one key, such as `straight` or `scan`. `MOTIONS` contains a `MotionKey`
for each of these keys, which states the type of the value and the function that builds the motions.
`motion_list_type` returns the type of the whole list for validation, and `motions_from` builds the
motions of one entry.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import chain
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from ssm_planner import units
from ssm_planner.loading.missions import LONGEST_MOTION, RepeatModel
from ssm_planner.loading.path_file import path_from
from ssm_planner.loading.schema import (
    Model,
    Nested,
    Reader,
    Text,
    build_class_model,
    build_keys_model,
    field_type,
    invalid_value,
    locate_errors,
    nested_type,
    optional_key,
    positive_type,
    quantity_reader,
    required_key,
    vector_reader,
)
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.problem import (
    LARGEST_SCAN_GRID,
    TASK_COORDINATES,
    Bound,
    Dwell,
    Follow,
    Free,
    Joints,
    Motion,
    Point,
    Scan,
    Straight,
    Task,
    Tip,
    get_attributes,
)
from ssm_planner.registry import Registry
from ssm_planner.typing import JsonObject, Keywords, frozen

JointValues = Annotated[
    tuple[float, float, float, float], vector_reader("angle", "angle", "angle", "length")
]
"""Positions of the four joints, in rad (joints 1 to 3) and m (joint 4) after reading."""
MAX_POINTS = 200
"""Largest number of points that one motion of a problem file passes without stopping."""
PATTERN_KEYS = {"raster": ("rows", "columns"), "ring": ("diameter",), "triple ring": ("diameters",)}
"""Keys of each pattern of a scan in addition to the common ones."""
KeyPath = tuple[str | int, ...]
"""Keys and list positions that lead to a value of the file."""
_POINT_FORMS = (
    "task coordinates (roll, tilt, spin, depth), or joints: [four values], or tip: [x, y, z] "
    "with spin"
)


class _NamedModel(Model):
    """Base of the models of points. Instead of a point, a file may contain a name in `points`."""

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: Any) -> JsonObject:
        schema = super().__get_pydantic_json_schema__(core, handler)
        return {"anyOf": [schema, {"type": "string", "description": "A name among `points`."}]}


class _PointModel(_NamedModel):
    """Base of the model of points, which are task coordinates, joints, or tip and spin."""

    @model_validator(mode="before")
    @classmethod
    def _one_form(cls, data: Any) -> Any:
        """Reject an empty point, and a point that mixes keys of different forms.

        The forms are task coordinates, `joints`, and `tip` with `spin`.

        Parameters
        ----------
        data : object
            Value in the file.

        Returns
        -------
        object
            The unchanged value, whose keys pydantic validates afterwards.
        """
        if not isinstance(data, dict):
            return data
        if not data:
            raise invalid_value("the point is empty", _POINT_FORMS)
        if "joints" in data and len(data) > 1:
            other_key = next(key for key in data if key != "joints")
            raise invalid_value("redundant: joints determine the point", _POINT_FORMS, other_key)
        if "tip" in data:
            for key in ("roll", "tilt", "depth"):
                if key in data:
                    raise invalid_value(
                        "redundant: tip determines roll, tilt and depth", _POINT_FORMS, key
                    )
            if "spin" not in data:
                raise invalid_value(
                    "missing: a tip position does not determine the spin", _POINT_FORMS, "spin"
                )
        return data


class _ScanModel(Model):
    pattern: Literal["raster", "ring", "triple ring"]
    """Grid, or one or three circles of spots."""

    @model_validator(mode="before")
    @classmethod
    def _pattern_keys(cls, data: Any) -> Any:
        """Reject keys that only other patterns have, and require the keys of this pattern.

        Parameters
        ----------
        data : object
            Value of the key `scan` in the file.

        Returns
        -------
        object
            The unchanged value, whose keys pydantic validates afterwards.
        """
        pattern = str(data.get("pattern")) if isinstance(data, dict) else None
        if pattern not in PATTERN_KEYS:
            return data
        for key in chain.from_iterable(PATTERN_KEYS.values()):
            if key in data and key not in PATTERN_KEYS[pattern]:
                raise invalid_value(
                    f"not allowed for the pattern {pattern!r}",
                    f"for it: {', '.join(PATTERN_KEYS[pattern])}",
                    key,
                )
        for key in PATTERN_KEYS[pattern]:
            if key not in data and key != "diameters":  # diameters have a default
                raise invalid_value(f"missing: the pattern {pattern!r} needs it", None, key)
        return data


def accept_keyword(reader: Reader, keyword: str, allowed: str) -> Reader:
    """Extend the reader of a value so that it also accepts one word.

    Parameters
    ----------
    reader : Reader
        Reader of the other values, such as an angle.
    keyword : str
        The word. The new reader returns it unchanged.
    allowed : str
        Description of the allowed values for messages.

    Returns
    -------
    Reader
        Reader that accepts the word and all values of the given reader.
    """

    def read(value: object) -> object:
        try:
            return keyword if value == keyword else reader.read(value)
        except units.BadQuantity as error:
            raise units.BadQuantity(error.reason, f"{error.allowed}, or {keyword}") from None

    return replace(
        reader,
        read=read,
        json_schema={"anyOf": [reader.json_schema, {"const": keyword}]},
        allowed=allowed,
    )


TaskModel = build_class_model(Task, base=_NamedModel)
_Lengths = Annotated[Any, vector_reader("length", "length", "length")]
_POINT_KEYS = {
    "joints": optional_key(JointValues, "Positions of the four joints, instead of all other keys."),
    "tip": optional_key(
        _Lengths, "Position of the tool tip in the base frame, instead of roll, tilt and depth."
    ),
}
PointModel = build_class_model(Task, _POINT_KEYS, base=_PointModel)
FREE_SPIN = "free"
"""Spin of a target that the planner chooses."""
_SPIN_OR_FREE = accept_keyword(
    quantity_reader("angle"), FREE_SPIN, "an angle, or free to choose the fastest one"
)
FreeTargetModel = build_class_model(
    Task,
    {
        "spin": optional_key(
            Annotated[Any, _SPIN_OR_FREE], "Rotation of the tool about its own axis, or free."
        ),
        **_POINT_KEYS,
    },
    base=_PointModel,
)
_GridCount = Annotated[
    Any, quantity_reader("number", Bound(at_least=1, at_most=LARGEST_SCAN_GRID), integer=True)
]
ScanModel = build_class_model(
    Scan,
    {
        "at": (nested_type(TaskModel), ...),
        "diameter": optional_key(positive_type("length"), "Diameter of a ring."),
        "diameters": (_Lengths, (1e-3, 2e-3, 3e-3)),
        "rows": optional_key(_GridCount),
        "columns": optional_key(_GridCount),
    },
    without=("name",),
    base=_ScanModel,
)


class _EntryModel(Model):
    """Base of the model of an entry of the motion list, which must have exactly one key."""

    @model_validator(mode="before")
    @classmethod
    def _one_key(cls, data: Any) -> Any:
        """Reject an entry with no motion or with several motions."""
        if isinstance(data, dict) and len(data) != 1:
            several = f"{len(data)} motions in one entry ({', '.join(map(str, data))})"
            reason = several if data else "the entry has no motion"
            raise invalid_value(reason, f"one motion per list entry: {', '.join(cls.model_fields)}")
        return data


def _motion_type(
    to: Any, extra_keys: Mapping[str, Any] | None = None, without: tuple[str, ...] = ()
) -> Any:
    """Return the type of a motion with the keys `to`, `duration` and `blend`.

    Parameters
    ----------
    to : type
        Type of the end point.
    extra_keys : Mapping, optional
        Additional keys, each as a pair of type and default.
    without : tuple of str
        Keys among these three that are omitted.

    Returns
    -------
    type
        Type for pydantic models.
    """
    keys = {"to": required_key(to, "End point."), **(extra_keys or {})}
    return nested_type(
        build_class_model(Straight, keys, without=(*TASK_COORDINATES, "name", *without))
    )


def _through_key(model: Any, description: str) -> Keywords:
    """Return the key `through` for the optional points between the start and the end of a motion.

    Parameters
    ----------
    model : type
        Model of each point.
    description : str
        Description of the key for the schema and the reference.

    Returns
    -------
    dict
        Pair of type and default for the key `through`.
    """
    points = Annotated[tuple[Annotated[Any, Nested(model)], ...], Field(max_length=MAX_POINTS)]
    return {"through": (points, Field((), description=description))}


_WAYPOINTS = _through_key(PointModel, "Points passed without stopping, in order.")
_CORNERS = "Corners of the path, rounded according to `blend`."
_SPEED_KEY = {
    "constant_speed": optional_key(
        field_type(Follow, "constant_speed"), "Speed of the tip outside the ramps."
    )
}
_RETINA_KEYS = _SPEED_KEY | {
    "distance": required_key(positive_type("length"), "Distance of the tip from the retina.")
}
_ARC_KEYS = {"through": required_key(nested_type(PointModel), "Point that the arc passes.")}
_COORDINATE_BY_KEY = {"tilt": "tilt", "roll": "roll", "spin": "spin", "insert": "depth"}
"""Task coordinates that change, by the key of the motion."""


@frozen
class MotionKey:
    """Key of the motion list of problem files, which describes one or more motions.

    To add a key, create an object of this class and register it (docs/architecture.md).
    """

    name: str
    """Name of the key."""
    description: str
    """Meaning of the key, for schema and reference."""
    value_type: Any
    """Type of the value in the file, such as `nested_type(build_class_model(cls))`."""
    motions: Callable[[Section, Any], Iterable[Motion]]
    """Function that returns the motions that a value describes.

    Its arguments are the section of the file, for lines and messages, and the value in SI units.
    """


def _straight_motions(section: Section, model: Any) -> Iterator[Motion]:
    """Yield the straight motion of an entry of the motion list.

    An entry such as `tilt: {to: -100 deg}` changes one task coordinate, and an entry `straight`
    states several of them.

    Parameters
    ----------
    section : Section
        Part of the file below the key of the entry, which is `straight` or the name of a task
        coordinate such as `tilt`.
    model : object
        Validated content of the section, with values in SI units.

    Yields
    ------
    Straight
        Motion along a straight line in task coordinates.
    """
    name = str(section.path[-1])
    coordinate = _COORDINATE_BY_KEY.get(name)
    to = {coordinate: model.to} if coordinate else stated_coordinates(model.to)
    line = section.line()
    yield Straight(**to, duration=model.duration, name=name, line=line, blend=model.blend)


def _free_motions(section: Section, model: Any) -> Iterator[Motion]:
    """Yield the free motion that the value of a key describes.

    The planner chooses the path of a free motion.

    Parameters
    ----------
    section : Section
        Part of the file with the value. It gives lines and keys to messages.
    model : object
        Validated content of the section, with values in SI units.

    Yields
    ------
    Free
        Motion to a point, possibly through other points.
    """
    yield Free(
        point_from(section.sub("to"), model.to),
        _points_between(section, model),
        model.duration,
        line=section.line(),
        spin_free=model.to.spin == FREE_SPIN,
    )


def _points_between(section: Section, model: Any) -> tuple[Point, ...]:
    """Build the points in the key `through` of a motion.

    Parameters
    ----------
    section : Section
        Part of the file with the value. It gives lines and keys to messages.
    model : object
        Validated content of the section. The key contains a list of points or, for an arc, a single
        point.

    Returns
    -------
    tuple of Point
        Points between the start and the end of the motion.
    """
    if not isinstance(model.through, tuple):
        return (point_from(section.sub("through"), model.through),)
    return tuple(
        point_from(section.sub("through", k), point) for k, point in enumerate(model.through)
    )


def _curve_motions(section: Section, model: Any) -> Iterator[Motion]:
    """Yield the spline, line or arc that the value of a key describes.

    Parameters
    ----------
    section : Section
        Part of the file with the value. The last key of its path is the name of the curve.
    model : object
        Validated content of the section, with values in SI units.

    Yields
    ------
    Follow
        Motion along the curve.
    """
    name: Any = section.path[-1]
    end = point_from(section.sub("to"), model.to)
    between = _points_between(section, model)
    of_tip = get_attributes(model, () if name == "spline" else ("blend", "constant_speed"))
    yield Follow(end, between, name, name, line=section.line(), duration=model.duration, **of_tip)


def _retina_motions(section: Section, model: Any) -> Iterator[Motion]:
    """Yield the motion along the retina that the value of a key describes.

    Parameters
    ----------
    section : Section
        Part of the file with the value. It gives lines and keys to messages.
    model : object
        Validated content of the section, with values in SI units.

    Yields
    ------
    Follow
        Motion at a constant distance from the retina.

    Raises
    ------
    ProblemError
        If the end point states a depth, because the distance from the retina determines it.
    """
    if model.to.depth is not None:
        reason = "do not give depth: distance already determines it"
        raise section.error(reason, "to", "depth", allowed="roll, tilt, spin")
    yield Follow(
        Task(**stated_coordinates(model.to), line=section.line("to")),
        (),
        "retina",
        "retina",
        line=section.line(),
        duration=model.duration,
        constant_speed=model.constant_speed,
        distance=model.distance,
    )


def _path_motions(section: Section, file: str) -> Iterator[Motion]:
    """Yield the motion through the points of a table.

    The value of the key is the file name of the table, which `path_from` reads from the section.
    """
    yield path_from(section, "path", section.line())


def _dwell_motions(section: Section, duration: float) -> Iterator[Motion]:
    """Yield the pause that the value of a key describes. The value is its duration, s."""
    yield Dwell(duration, "dwell", section.line())


def _scan_motions(section: Section, model: Any) -> Iterator[Motion]:
    """Yield the motion of the key `scan`, which visits a pattern of spots on the retina.

    Parameters
    ----------
    section : Section
        Part of the file with the value, for messages.
    model : object
        Validated content of the section, with values in SI units.

    Yields
    ------
    Scan
        Motion to the spots with a pause at each of them.

    Raises
    ------
    ProblemError
        If the diameters of a triple ring do not increase.
    """
    low, middle, high = model.diameters
    if not 0 < low < middle < high:
        reason = "rings must be concentric"
        raise section.error(reason, "diameters", allowed="three increasing lengths")
    diameters = {"raster": (), "ring": (model.diameter,), "triple ring": model.diameters}[
        model.pattern
    ]
    yield Scan(
        Task(**stated_coordinates(model.at), line=section.line("at")),
        model.distance,
        diameters,
        rows=model.rows or 0,
        columns=model.columns or 0,
        spacing=model.spacing,
        dwell=model.dwell,
        order=model.order,
        name=model.pattern,
        line=section.line(),
    )


_BUILT_IN_MOTIONS = (
    *(
        MotionKey(
            key,
            f"Motion to a {coordinate}. The other task coordinates stay constant.",
            _motion_type(field_type(Task, coordinate)),
            _straight_motions,
        )
        for key, coordinate in _COORDINATE_BY_KEY.items()
    ),
    MotionKey(
        "straight",
        "Straight motion in task coordinates. Missing ones stay constant.",
        _motion_type(nested_type(TaskModel), _through_key(TaskModel, _CORNERS)),
        _straight_motions,
    ),
    MotionKey(
        "free",
        "Motion along the fastest path that the planner finds.",
        _motion_type(nested_type(FreeTargetModel), _WAYPOINTS, ("blend",)),
        _free_motions,
    ),
    MotionKey(
        "line",
        "Straight line of the tip, with proportional spin.",
        _motion_type(nested_type(PointModel), _through_key(PointModel, _CORNERS) | _SPEED_KEY),
        _curve_motions,
    ),
    MotionKey(
        "arc",
        "Circular arc of the tip, with proportional spin.",
        _motion_type(nested_type(PointModel), _ARC_KEYS | _SPEED_KEY),
        _curve_motions,
    ),
    MotionKey(
        "retina",
        "Motion along the retina at a constant distance.",
        _motion_type(nested_type(TaskModel), _RETINA_KEYS, ("blend",)),
        _retina_motions,
    ),
    MotionKey(
        "spline",
        "Smooth curve of the joints through points.",
        _motion_type(nested_type(PointModel), _WAYPOINTS, ("blend",)),
        _curve_motions,
    ),
    MotionKey(
        "path",
        "CSV with joints, task coordinates, or tip and spin, and units in the headings.",
        Text,
        _path_motions,
    ),
    MotionKey("dwell", "Pause at rest.", field_type(Dwell, "duration"), _dwell_motions),
    MotionKey("scan", "Spots on the retina.", nested_type(ScanModel), _scan_motions),
)
MOTIONS: Registry[MotionKey] = Registry("ssm_planner.motions", "motion", *_BUILT_IN_MOTIONS)
"""All keys that describe motions."""
BUILT_IN_KEYS = tuple(key.name for key in _BUILT_IN_MOTIONS)
"""Keys that this package defines. Other packages can register further keys."""
_EXPANDED_KEYS = {
    "repeat": optional_key(nested_type(RepeatModel), "Motions to repeat."),
    "include": optional_key(
        Text, "Problem file whose motions are inserted. It has separate names of points."
    ),
}
"""Keys that `missions` replaces by motions."""


def motion_list_type(names: tuple[str, ...]) -> Any:
    """Build the type of a motion list for validation.

    Parameters
    ----------
    names : tuple of str
        Keys that the entries may have, which are names in `MOTIONS`. The keys `repeat` and
        `include` are allowed in addition.
    """
    keys = {
        name: optional_key(MOTIONS[name].value_type, MOTIONS[name].description) for name in names
    }
    entry = Annotated[Any, Nested(build_keys_model(keys | _EXPANDED_KEYS, base=_EntryModel))]
    return Annotated[list[entry], Field(min_length=1, max_length=LONGEST_MOTION)]


def motions_from(section: Section, value: Any) -> tuple[Motion, ...]:
    """Build the motions that the value of a key describes.

    Parameters
    ----------
    section : Section
        Part of the file with the value. The last key of its path is a name in `MOTIONS`.
    value : object
        Validated value in SI units.

    Raises
    ------
    ProblemError
        If the value is invalid.
    """
    with locate_errors(section):
        return tuple(MOTIONS[str(section.path[-1])].motions(section, value))


def key_locations(field: str, key_path: KeyPath, value: Any) -> dict[str, KeyPath]:
    """Return the keys of a problem file that belong to the fields of a motion.

    The constructors of motions and problems raise errors that name a field, such as motion[2].to.
    The result translates this name to keys of the file.

    Parameters
    ----------
    field : str
        Name of the motion in errors, such as motion[2].
    key_path : tuple
        Keys and list positions that lead to the value of the motion's key.
    value : object
        Validated value of the key.

    Returns
    -------
    dict of tuple
        Keys and list positions that lead to a part, by name of the part in errors.
    """
    name = key_path[-1]
    keys = ("blend", "duration", "constant_speed", "distance")
    locations = {f"{field}.{key}": (*key_path, key) for key in keys}
    points: dict[str, KeyPath] = {f"{field}.to": (*key_path, "to")}
    if name in ("free", "spline"):
        indices = range(len(value.through))
        points |= {f"{field}.through[{k}]": (*key_path, "through", k) for k in indices}
    if name == "arc":
        points[f"{field}.through[0]"] = (*key_path, "through")
    for point, location in points.items():
        locations |= {
            f"{point}.values": (*location, "joints"),
            f"{point}.position": (*location, "tip"),
            point: location,
        }
    if name == "scan" and value.pattern == "ring":
        locations[f"{field}.diameters"] = (*key_path, "diameter")
    if name in _COORDINATE_BY_KEY:
        locations[f"{field}.{_COORDINATE_BY_KEY[str(name)]}"] = (*key_path, "to")
    locations[field] = (*key_path, "to") if name == "straight" else key_path
    return locations


def stated_coordinates(model: Any) -> dict[str, float]:
    """Return the task coordinates, or the rates of them, that a section of a file states.

    Coordinates that the section omits are absent from the result. So is the spin if the section
    leaves its value to the planner (`spin: free`).

    Parameters
    ----------
    model : object
        The validated section, with an attribute for each task coordinate.

    Returns
    -------
    dict of float
        Coordinates (rad, m) or rates (rad/s, m/s) by name.
    """
    return {
        name: value
        for name in TASK_COORDINATES
        if (value := getattr(model, name)) not in (None, FREE_SPIN)
    }


def point_from(section: Section, model: Any) -> Point:
    """Build the point that a section describes.

    Parameters
    ----------
    section : Section
        Part of the file that describes the point.
    model : object
        The validated section.

    Returns
    -------
    Task, Joints or Tip
        Point in task coordinates, joint positions, or tip position and spin.

    Raises
    ------
    ProblemError
        If a value is invalid.
    """
    line = section.line()
    with locate_errors(section, {"values": ("joints",), "position": ("tip",)}):
        if model.joints is not None:
            return Joints(model.joints, line)
        if model.tip is not None:
            return Tip(model.tip, 0.0 if model.spin == FREE_SPIN else model.spin, line)
        return Task(**stated_coordinates(model), line=line)
