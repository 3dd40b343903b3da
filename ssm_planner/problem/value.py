"""Define the base class of all public values, and convert data to the types of their fields.

A value is a frozen dataclass that derives from `Value`. Its constructor checks it, and it never
changes. Two values with the same content are equal. The type annotations of the fields state the
allowed values of each field, and the method `_check` rejects fields that contradict each other.
A text in an annotation is the physical quantity, a key of `units.QUANTITY_KINDS` such as "torque".
Lists become tuples. Arrays are copied and made read-only.
"""

import ast
import dataclasses
import inspect
import math
import textwrap
import types
import typing
from collections.abc import Iterable, Mapping
from functools import cache
from itertools import pairwise
from numbers import Real
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

import numpy as np

from ssm_planner.arguments import check_methods
from ssm_planner.errors import ProblemError, suggestion
from ssm_planner.typing import Array, JsonObject, Range, frozen

V = TypeVar("V", bound="Value")


def uncompared_field() -> Any:
    """Return a dataclass field with the default None that is ignored when values are compared."""
    return dataclasses.field(default=None, compare=False)


@frozen
class Bound:
    """Interval of the allowed values of a number."""

    above: float = -math.inf
    at_least: float = -math.inf
    at_most: float = math.inf

    @property
    def allowed(self) -> str:
        """Description such as "above 0" or "from 1 to 50", empty if every number is allowed."""
        bounds = {"above": self.above, "at least": self.at_least, "at most": self.at_most}
        if math.isfinite(self.at_least) and math.isfinite(self.at_most):
            return f"from {self.at_least:g} to {self.at_most:g}"
        return " and ".join(
            f"{phrase} {bound:g}" for phrase, bound in bounds.items() if math.isfinite(bound)
        )

    def violation(self, value: float) -> str | None:
        """Return a text that says why a number violates the bound, or None if it does not."""
        if not value > self.above:
            return "not greater than zero" if self.above == 0 else "too small"
        if not value >= self.at_least:
            return "negative" if self.at_least == 0 else "too small"
        return None if value <= self.at_most else "too large"


@frozen
class Shape:
    """Required shape of an array. The length −1 allows any length."""

    shape: tuple[int, ...]


@frozen
class Names:
    """Allowed keys of a mapping."""

    names: tuple[str, ...]


class Ascending:
    """Requirement that the first number of a pair is less than the second."""


Positive = Annotated[float, Bound(above=0.0)]
"""Number above 0."""
NotNegative = Annotated[float, Bound(at_least=0.0)]
"""Number of at least 0."""
Count = Annotated[int, Bound(at_least=0)]
"""Whole number of at least 0."""
Interval = Annotated[Range, Ascending()]
"""Pair of numbers, of which the first one is smaller."""
Vector = Annotated[Array, Shape((3,))]
"""Array (3,) of numbers."""
Matrix = Annotated[Array, Shape((3, 3))]
"""Array (3, 3) of numbers."""
Sign = Literal[-1, 1]
"""Direction, −1 or +1."""
Length = Annotated[Positive, "length"]
"""Positive length, m."""
Time = Annotated[Positive, "time"]
"""Positive time, s."""
Coefficient = Annotated[NotNegative, "number"]
"""Number without a unit, at least 0."""
Share = Annotated[float, Bound(above=0.0, at_most=1.0), "number"]
"""Number above 0 and at most 1."""
Position = Annotated[Vector, "length"]
"""Position or lengths along the axes, m, (3,)."""
Speed = Annotated[Positive, "motor_speed"]
"""Positive speed of a motor, rad/s."""
Delay = Annotated[NotNegative, "time"]
"""Time of at least 0, s."""
Torque = Annotated[Positive, "torque"]
"""Positive torque, N·m."""
Current = Annotated[Positive, "current"]
"""Positive current, A."""
Mass = Annotated[NotNegative, "mass"]
"""Mass of at least 0, kg."""


class Value:
    """Base class of the public values.

    A constructor converts and checks its arguments.

    Raises
    ------
    ProblemError
        If a field is invalid. The error states type, field, value and allowed values.
    """

    def __init_subclass__(cls) -> None:
        check_methods(cls)

    def __post_init__(self) -> None:
        cls: Any = type(self)
        for name, hint in field_hints(cls).items():
            key = f"{cls.__name__}.{name}"
            object.__setattr__(self, name, convert_value(hint, getattr(self, name), key))
        self._check()

    def _check(self) -> None:
        """Raise ProblemError if fields contradict each other."""

    def _field_error(
        self, field: str, reason: str, allowed: str, value: object = None
    ) -> ProblemError:
        """Build the error for an invalid field.

        Parameters
        ----------
        field : str
            Name of the field, or of an entry of it such as `strokes[2].joint`.
        reason : str
            Fault.
        allowed : str
            Allowed values.
        value : object, optional
            Invalid value. The default is the value of the field.
        """
        field_value = getattr(self, field, None) if value is None else value
        return ProblemError(
            reason, key=f"{type(self).__name__}.{field}", value=field_value, allowed=allowed
        )

    def __eq__(self, other: object) -> bool:
        """Return True if the other value has the same class and equal compared fields."""
        if type(self) is not type(other):
            return NotImplemented
        cls: Any = type(self)
        return all(
            _equal_values(getattr(self, name), getattr(other, name))
            for name in _compared_fields(cls)
        )

    def __hash__(self) -> int:
        """Return a hash of the class and of the compared fields."""
        cls: Any = type(self)
        return hash(
            (cls.__name__, *(_hashable(getattr(self, name)) for name in _compared_fields(cls)))
        )


def get_attributes(value: object, names: Iterable[str]) -> JsonObject:
    """Return the attributes of an object with the given names, as a dictionary by name."""
    return {name: getattr(value, name) for name in names}


def unchecked_copy(value: V, **changes: Any) -> V:
    """Return a copy of a value with changed fields, like dataclasses.replace, but without checks.

    The copy is needed for trial values of a fit, for arrays that represent many drives at once, for
    drives without friction, and for values that reproduce mistakes of other programs.

    Parameters
    ----------
    value : Value
        Value to copy.
    **changes
        New values by field.

    Returns
    -------
    Value
        The copy. Its fields may contradict each other.
    """
    cls: Any = type(value)
    copy = object.__new__(cls)
    fields = value.__dict__
    # cached properties are not copied because they may depend on the changed fields
    copy.__dict__.update({name: fields[name] for name in field_hints(cls)}, **changes)
    return copy


@cache
def field_hints(cls: Any) -> dict[str, Any]:
    """Return the type annotations of the fields of a dataclass, by field name."""
    types = typing.get_type_hints(cls, include_extras=True)
    return {field.name: types[field.name] for field in dataclasses.fields(cls)}


def strip_annotations(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    """Split a type into its core and its annotations.

    For example, Annotated[float, Bound(above=0.0)] | None gives float and (Bound(above=0.0),).

    Parameters
    ----------
    hint : type
        Type of a field, possibly with None as an alternative.

    Returns
    -------
    core : type
        The type without None and Annotated. A union of several types is returned unchanged.
    annotations : tuple
        Annotations of the type.
    """
    if get_origin(hint) in (typing.Union, types.UnionType):
        inner = [inner_hint for inner_hint in get_args(hint) if inner_hint is not type(None)]
        return strip_annotations(inner[0]) if len(inner) == 1 else (hint, ())
    if get_origin(hint) is Annotated:
        hint_type, *marks = get_args(hint)
        return hint_type, tuple(marks)
    return hint, ()


def unit_kind(quantity: str, slides: bool = False) -> str:
    """Return the kind of a physical quantity for a revolute or a prismatic joint.

    Parameters
    ----------
    quantity : str
        Key of `units.QUANTITY_KINDS`, or two of them, for revolute and prismatic joints, such as
        "angle or length".
    slides : bool
        True for a prismatic joint.

    Returns
    -------
    str
        Key of `units.QUANTITY_KINDS`, such as "length".
    """
    turning, _, sliding = quantity.partition(" or ")
    return sliding if slides and sliding else turning


def field_quantities(cls: Any) -> dict[str, str]:
    """Return the physical quantities of the numeric fields of a dataclass, by field name.

    The annotation of a field contains its quantity as a text such as "torque", or "angle or length"
    for a quantity that depends on the kind of joint.
    """
    marks = {name: strip_annotations(hint)[1] for name, hint in field_hints(cls).items()}
    return {name: mark for name in marks for mark in marks[name] if isinstance(mark, str)}


def field_descriptions(cls: type) -> dict[str, str]:
    """Read the docstrings below the fields of a class from its source code.

    Python itself does not keep these docstrings.

    Parameters
    ----------
    cls : type
        Class whose fields, and those of its base classes, are described.

    Returns
    -------
    dict of str
        Docstrings by field name, each as one line.
    """
    texts: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        if base.__module__.startswith(("builtins", "pydantic", "typing")):
            continue
        try:
            (tree,) = ast.parse(textwrap.dedent(inspect.getsource(base))).body
        except OSError:  # the source of a class made at run time is missing
            continue
        body = tree.body if isinstance(tree, ast.ClassDef) else []
        for field, docstring in pairwise(body):
            if isinstance(field, ast.AnnAssign) and isinstance(docstring, ast.Expr):
                texts[ast.unparse(field.target)] = " ".join(
                    str(ast.literal_eval(docstring.value)).split()
                )
    return texts


def read_only_array(value: object, shape: tuple[int, ...]) -> Array:
    """Return a read-only float array with the given shape, a copy of the value."""
    array = np.array(value, dtype=float).reshape(shape)
    array.setflags(write=False)
    return array


def build_value(
    cls: Any, data: object, location: str, known_values: Mapping[str, Any] | None = None
) -> Any:
    """Build a dataclass and its nested dataclasses from a mapping whose keys are the fields.

    Parameters
    ----------
    cls : type
        Dataclass to build.
    data : object
        Mapping with a value for each field without a default.
    location : str
        Key of the data, for messages.
    known_values : Mapping, optional
        Values of fields that are not in the data.

    Returns
    -------
    object
        Instance of the dataclass.

    Raises
    ------
    ProblemError
        If a key is unknown or missing, or a value is invalid.
    """
    fields = {field.name: field for field in dataclasses.fields(cls)}
    check_mapping(data, tuple(fields), location)
    assert isinstance(data, Mapping)
    types_of = field_hints(cls)
    values = dict(known_values or {})
    for name, field in fields.items():
        if name in values:
            continue
        if name in data:
            values[name] = convert_value(
                types_of[name], data[name], f"{location}.{name}", build=True
            )
        elif field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            raise ProblemError(
                "missing", key=f"{location}.{name}", allowed=f"the keys of {cls.__name__}"
            )
    try:
        return cls(**values)
    except ProblemError as error:
        error.key = location + str(error.key).removeprefix(cls.__name__)
        raise


def convert_value(hint: Any, value: Any, location: str, build: bool = False) -> Any:
    """Convert a value to the type of a field, and check it.

    Parameters
    ----------
    hint : type
        Annotated type of the field.
    value : object
        Value to convert.
    location : str
        Key of the value, for messages.
    build : bool
        True to build nested dataclasses from mappings.

    Returns
    -------
    object
        The value. Lists become tuples, and numbers become floats or read-only arrays.

    Raises
    ------
    ProblemError
        If the value does not have the required type or violates an annotation.
    """
    origin = get_origin(hint)
    arguments = get_args(hint)
    if origin is Annotated:
        return _convert_annotated(arguments, value, location, build)
    if origin is typing.Union or origin is types.UnionType:
        return _convert_union(arguments, value, location, build)
    if origin is Literal:
        is_scalar = isinstance(value, (str, Real)) and not isinstance(value, bool)
        if not is_scalar or value not in arguments:
            raise wrong_type_error(location, value, " or ".join(map(str, arguments)))
        return arguments[arguments.index(value)]
    if origin is tuple:
        return _convert_tuple(arguments, value, location, build)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        if not isinstance(value, Mapping):
            raise wrong_type_error(location, value, "a mapping")
        return {
            str(key): convert_value(arguments[1], item, f"{location}.{key}", build)
            for key, item in value.items()
        }
    if isinstance(hint, type) and dataclasses.is_dataclass(hint):
        if isinstance(value, hint):
            return value
        if build:
            return build_value(hint, value, location)
        raise wrong_type_error(location, value, f"a {hint.__name__}")
    return _convert_scalar(hint, value, location)


def check_name(name: object, names: tuple[str, ...], location: str, reason: str) -> None:
    """Raise ProblemError if a name is not one of the allowed names.

    Parameters
    ----------
    name : object
        Name to check.
    names : tuple of str
        Allowed names. The message suggests the most similar one.
    location : str
        Key of the name, for the message.
    reason : str
        Beginning of the message.
    """
    if name not in names:
        reason += suggestion(name, names)
        raise ProblemError(reason, key=location, value=name, allowed=", ".join(names))


def check_mapping(data: object, names: tuple[str, ...], location: str) -> None:
    """Raise ProblemError if data are not a mapping with allowed keys.

    Parameters
    ----------
    data : object
        Data to check.
    names : tuple of str
        Allowed keys.
    location : str
        Key of the data, for the message.
    """
    if not isinstance(data, Mapping):
        raise wrong_type_error(location, data, f"a mapping with the keys {', '.join(names)}")
    for key in data:
        check_name(key, names, f"{location}.{key}", "unknown key")


def wrong_type_error(location: str, value: object, allowed: str) -> ProblemError:
    """Build the error for a value of the wrong type.

    Parameters
    ----------
    location : str
        Key of the value.
    value : object
        The value.
    allowed : str
        Description of the allowed values.

    Returns
    -------
    ProblemError
        Error that the caller raises.
    """
    printed_value = "None" if value is None else value
    return ProblemError("wrong type of value", key=location, value=printed_value, allowed=allowed)


def _convert_annotated(arguments: tuple[Any, ...], value: Any, location: str, build: bool) -> Any:
    """Convert a value to an annotated type, and check the conditions in its annotations.

    Parameters
    ----------
    arguments : tuple
        Arguments of Annotated: the type itself, and then its annotations such as `Bound`.
    value : object
        Value to convert.
    location : str
        Key of the value, for messages.
    build : bool
        True to build nested dataclasses from mappings.

    Returns
    -------
    object
        The converted value.

    Raises
    ------
    ProblemError
        If the value does not have the type or violates an annotation.
    """
    hint_type, *marks = arguments
    for mark in marks:
        if isinstance(mark, Shape):
            return _convert_array(mark.shape, value, location)
        value = convert_value(hint_type, value, location, build)
        if isinstance(mark, Bound):
            if fault := mark.violation(value):
                raise ProblemError(fault, key=location, value=value, allowed=mark.allowed)
        elif isinstance(mark, Names):
            for key in value:
                check_name(key, mark.names, f"{location}.{key}", "unknown key")
        elif isinstance(mark, Ascending) and not value[0] < value[1]:
            raise ProblemError(
                "the lower bound is not below the upper one",
                key=location,
                value=value,
                allowed="(lower, upper)",
            )
    return value


def _convert_union(members: tuple[Any, ...], value: Any, location: str, build: bool) -> Any:
    """Convert a value to one of several types.

    Parameters
    ----------
    members : tuple of type
        The types. None is returned unchanged if the type of None is one of them.
    value : object
        Value to convert.
    location : str
        Key of the value, for messages.
    build : bool
        True to build nested dataclasses from mappings.

    Returns
    -------
    object
        The converted value.

    Raises
    ------
    ProblemError
        If the value has none of the types.
    """
    if value is None and type(None) in members:
        return None
    inner = [member for member in members if member is not type(None)]
    errors = []
    for member in inner:
        try:
            return convert_value(member, value, location, build)
        except ProblemError as error:
            errors.append(error)
    if len(errors) == 1:
        raise errors[0]
    raise wrong_type_error(location, value, " or ".join(str(error.allowed) for error in errors))


def _convert_tuple(
    members: tuple[Any, ...], value: Any, location: str, build: bool
) -> tuple[Any, ...]:
    """Convert a list, tuple or array to a tuple whose entries have given types.

    Parameters
    ----------
    members : tuple of type
        Type of each entry. If the last one is Ellipsis, all entries have the first type.
    value : object
        Value to convert.
    location : str
        Key of the value, for messages.
    build : bool
        True to build nested dataclasses from mappings.

    Returns
    -------
    tuple
        The converted entries.

    Raises
    ------
    ProblemError
        If the value is not a list of this length, or if an entry is invalid.
    """
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, (list, tuple)):
        raise wrong_type_error(location, value, "a list")
    hints = (members[0],) * len(value) if members[-1] is Ellipsis else members
    if len(hints) != len(value):
        raise wrong_type_error(location, value, f"a list of {len(hints)}")
    return tuple(
        convert_value(hint, item, f"{location}[{i}]", build)
        for i, (hint, item) in enumerate(zip(hints, value, strict=True))
    )


_SCALAR_DESCRIPTIONS = {
    float: "a finite number",
    int: "a whole number",
    str: "a text",
    bool: "true or false",
}
"""Descriptions of the types for messages."""


def _convert_scalar(hint: Any, value: Any, location: str) -> Any:
    """Convert a value to float, int, str or bool.

    Parameters
    ----------
    hint : type
        One of these four types.
    value : object
        Value to convert. Numbers of numpy are allowed.
    location : str
        Key of the value, for messages.

    Returns
    -------
    float, int, str or bool
        The value.

    Raises
    ------
    ProblemError
        If the value has another type or is not finite.
    """
    if hint in (str, bool) and isinstance(value, hint):
        return value
    # Python counts True and False as integers, but neither is a valid number.
    if not isinstance(value, bool):
        if hint is int and isinstance(value, (int, np.integer)):
            return int(value)
        number_types = (int, float, np.integer, np.floating)
        if hint is float and isinstance(value, number_types) and math.isfinite(value):
            return float(value)
    raise wrong_type_error(location, value, _SCALAR_DESCRIPTIONS[hint])


def _convert_array(shape: tuple[int, ...], value: Any, location: str) -> Array:
    """Convert a value to a read-only array of finite numbers, and check its shape.

    Parameters
    ----------
    shape : tuple of int
        Required shape. A length of −1 allows any length.
    value : object
        Value to convert.
    location : str
        Key of the value, for messages.

    Returns
    -------
    array
        The read-only copy.

    Raises
    ------
    ProblemError
        If the value is not an array of finite numbers with this shape.
    """
    allowed = f"finite numbers of shape {shape}"
    try:
        array = np.array(value)
    except (TypeError, ValueError) as error:
        raise wrong_type_error(location, value, allowed) from error
    has_shape = array.ndim == len(shape) and all(
        length in (-1, actual) for length, actual in zip(shape, array.shape, strict=True)
    )
    if array.dtype.kind not in "iuf" or not has_shape or not np.isfinite(array).all():
        raise wrong_type_error(location, value, allowed)
    return read_only_array(array, array.shape)


@cache
def _compared_fields(cls: type) -> tuple[str, ...]:
    """Return the names of the fields that determine whether two values are equal."""
    return tuple(field.name for field in dataclasses.fields(cls) if field.compare)


def _equal_values(a: Any, b: Any) -> bool:
    """Return True if two values of a field are equal. Arrays must have equal elements."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.array_equal(a, b)
    return bool(a == b)


def _hashable(value: Any) -> Any:
    """Return a hashable object for a value of a field. Equal values give equal objects."""
    if isinstance(value, np.ndarray):
        return (value.shape, *value.ravel().tolist())
    if isinstance(value, Mapping):
        return frozenset((key, _hashable(item)) for key, item in value.items())
    return value
