"""Build strict pydantic models of files from the classes of the values that the files describe.

A field of a value that is also a key of a file states its kind of quantity (`value.unit_kind`), its
bounds and its default in its annotation. The function `build_class_model` reads these annotations,
so that the keys need not be listed a second time. The modules that read a file only declare keys
that have another form in the file. A `Reader` converts one value of a file to SI units and
documents it.
`validate_section` collects all faults of a file in one ProblemError.
"""

import copy
import dataclasses
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, TypeVar, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationError, create_model, model_validator
from pydantic import Field as PydanticField
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from ssm_planner import units
from ssm_planner.errors import ProblemError, suggestion
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.problem import (
    JOINTS,
    Ascending,
    Bound,
    Shape,
    field_descriptions,
    field_hints,
    strip_annotations,
    unit_kind,
)
from ssm_planner.typing import JsonObject, Keywords, record
from ssm_planner.units import NUMBER, QUANTITY_KINDS

M = TypeVar("M", bound="Model")
UNBOUNDED = Bound()
"""Bound that allows every number."""
POSITIVE = Bound(above=0.0)
"""Bound that allows numbers above 0."""
SI_UNIT_AT_END = re.compile(r", (rad|m|s|kg|N|V|A|K|Ω)\b[^ ,.]*( or [^ .]+)?(?=\.(\s|$)|$)")
"""SI unit at the end of a sentence of a docstring."""
MAX_FAULTS = 10
"""Largest number of faults of one file in a message."""


class Figure(NamedTuple):
    """Number of a file in SI units, with its source.

    Attributes
    ----------
    value : float
        The number.
    source : str or None
        Source of the number, such as a datasheet.
    placeholder : bool
        True if the true value is unknown and the number is assumed.
    """

    value: float
    source: str | None = None
    placeholder: bool = False


class Model(BaseModel):
    """Base class of all models, which are immutable. An unknown key is an error.

    The message suggests the most similar key.
    """

    # models are built on first use because one command needs few of them
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)
    value_types: ClassVar[tuple[Any, ...]] = ()
    """Classes whose fields document the keys. If several document a key, the last one applies."""

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: Any) -> Any:
        """Reject data that are not a mapping, and unknown keys.

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
            raise invalid_value(
                f"{units.describe(data)} instead of a mapping",
                "the keys " + ", ".join(cls.model_fields),
            )
        check_keys(data, list(cls.model_fields))
        return data

    @classmethod
    def key_descriptions(cls) -> dict[str, str]:
        """Return the description of each key, from the docstrings of the fields.

        The fields are those of the model and of the classes that the file describes. Shapes and SI
        units are removed, because values in files state their units.
        """
        own_texts = {
            name: info.description for name, info in cls.model_fields.items() if info.description
        }
        value_texts = {
            name: text
            for value_type in cls.value_types
            for name, text in field_descriptions(value_type).items()
        }
        return {
            name: SI_UNIT_AT_END.sub("", re.sub(r",? ?\(3,\)", "", text))
            for name, text in {**value_texts, **field_descriptions(cls), **own_texts}.items()
        }

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: Any) -> JsonObject:
        schema = handler(core)
        keys_of = handler.resolve_ref_schema(schema).get("properties", {})
        texts = cls.key_descriptions()
        for name, entry in keys_of.items():
            entry.pop("title", None)
            if name in texts:
                entry["description"] = texts[name]
            if isinstance(entry.get("default"), float):
                entry["default"] = reader_of_key(cls.model_fields[name]).format_default(
                    entry["default"]
                )
        return schema

    def sourced_figures(self) -> dict[str, Figure]:
        """Return the quantities of the file with their sources, by key."""
        return {name: value for name, value in self if isinstance(value, Figure)}

    def numbers(self) -> dict[str, float]:
        """Return the quantities of the file in SI units, by key."""
        return {name: item.value for name, item in self.sourced_figures().items()}


def check_keys(data: dict[Any, Any], allowed: list[str]) -> None:
    """Check the keys of a mapping.

    Parameters
    ----------
    data : dict
        Mapping in the file.
    allowed : list of str
        Allowed keys.

    Raises
    ------
    PydanticCustomError
        If a key is unknown or its value is empty. For an unknown key, the message suggests the most
        similar key.
    """
    for key in data:
        if key not in allowed:
            raise invalid_value(f"unknown key{suggestion(key, allowed)}", ", ".join(allowed), key)
        if data[key] is None:
            raise invalid_value("empty value: omit the key or give a value", None, key)


def invalid_value(
    reason: str, allowed: str | None = None, key: str | None = None
) -> PydanticCustomError:
    """Build a pydantic error for a wrong value, which the loader converts to a ProblemError.

    Parameters
    ----------
    reason : str
        Reason why the value is wrong.
    allowed : str, optional
        Description of the allowed values.
    key : str, optional
        Key of the wrong entry within the value that is validated.

    Returns
    -------
    PydanticCustomError
        Error that the caller raises.
    """
    return PydanticCustomError(
        "problem", "see the context", {"reason": reason, "allowed": allowed, "key": key}
    )


@record
class Reader:
    """Annotation of a type that reads, describes and documents one value of a file.

    Pydantic calls it to validate a value and to write the JSON schema.
    """

    read: Callable[[Any], Any]
    """Function that converts a value of the file, and raises BadQuantity if it is invalid."""
    json_schema: JsonObject
    """JSON schema of the value in the file."""
    kinds: tuple[str, ...] = ()
    """Kinds of quantities of the components, which are keys of units.QUANTITY_KINDS."""
    allowed: str = ""
    """Allowed values in addition to the unit."""

    @property
    def unit(self) -> str:
        """Unit in a form that files accept, or "" without a unit."""
        return ", ".join(
            dict.fromkeys(
                QUANTITY_KINDS.get(unit_kind, NUMBER).example.partition(" ")[2]
                for unit_kind in self.kinds
            )
        )

    def format_default(self, value: Any) -> str:
        """Return a default in SI units as text with a unit that files accept, such as "0.6 mm"."""
        if not self.unit or not isinstance(value, float):
            return str(value)
        return f"{value / units.parse_quantity(f'1 {self.unit}', self.kinds[0]):.6g} {self.unit}"

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(_with_pydantic_errors(self.read))

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> JsonObject:
        return copy.deepcopy(self.json_schema)  # pydantic writes defaults into it


@record
class Nested:
    """Annotation of a nested mapping, whose model is built at run time."""

    model: Any

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        return handler.generate_schema(self.model)


def nested_type(model: Any) -> Any:
    """Return the type of a nested mapping with the keys of `model`."""
    return Annotated[Any, Nested(model)]


def quantity_reader(unit_kind: str, bound: Bound = UNBOUNDED, integer: bool = False) -> Reader:
    """Build the reader of a quantity with a unit, which converts the quantity to SI units.

    Parameters
    ----------
    unit_kind : str
        Kind of quantity, a key of units.QUANTITY_KINDS such as "torque".
    bound : Bound
        Bounds of the value in SI units.
    integer : bool
        True if the value must be an integer.

    Returns
    -------
    Reader
        Reader that converts the quantity and checks its bounds.
    """

    def read(value: object) -> float:
        """Convert a value of the file to SI units. Raise BadQuantity if it is invalid."""
        result = units.parse_quantity(value, unit_kind)
        if fault := bound.violation(result):
            raise units.BadQuantity(
                fault,
                allowed if integer else f"{QUANTITY_KINDS.get(unit_kind, NUMBER).name} {allowed}",
            )
        if integer and not result.is_integer():
            raise units.BadQuantity("not a whole number", allowed)
        return int(result) if integer else result

    allowed = f"a whole number {bound.allowed}" if integer else bound.allowed
    return Reader(read, _quantity_schema(unit_kind), (unit_kind,), allowed)


def positive_type(unit_kind: str) -> Any:
    """Return the type of a key whose value is a quantity above zero.

    Parameters
    ----------
    unit_kind : str
        Kind of quantity, a key of units.QUANTITY_KINDS such as "torque".
    """
    return Annotated[Any, quantity_reader(unit_kind, POSITIVE)]


def interval_reader(unit_kind: str) -> Reader:
    """Build the reader of an interval, which a file states as [lower, upper].

    Parameters
    ----------
    unit_kind : str
        Kind of quantity of both bounds, a key of units.QUANTITY_KINDS such as "torque".
    """
    schema = {"type": "array", "items": _quantity_schema(unit_kind), "minItems": 2, "maxItems": 2}
    return Reader(
        lambda value: units.parse_interval(value, unit_kind), schema, (unit_kind,), "[lower, upper]"
    )


def vector_reader(*kinds: str) -> Reader:
    """Build the reader of a vector such as `[1 mm, 2 mm, 3 mm]` or `(1, 2, 3) mm`.

    Parameters
    ----------
    *kinds : str
        Kind of quantity of each component, a key of units.QUANTITY_KINDS such as "length".

    Returns
    -------
    Reader
        Reader that converts the components to SI units.
    """
    items = {
        "type": "array",
        "items": _quantity_schema(kinds[0]),
        "minItems": len(kinds),
        "maxItems": len(kinds),
    }
    if len(set(kinds)) > 1:
        items = {"type": "array", "prefixItems": [_quantity_schema(kind) for kind in kinds]}
    schema = {"anyOf": [items, {"type": "string"}]}
    return Reader(
        lambda value: units.parse_vector(value, kinds), schema, kinds, f"{len(kinds)} values"
    )


def sourced_reader(field: Reader) -> Reader:
    """Extend the reader of a quantity so that the file may also state a source of the quantity.

    The file then contains either the quantity itself, or a mapping with the keys `value`, `source`
    (a text) and `placeholder` (true for an assumed value). The new reader returns a `Figure`.

    Parameters
    ----------
    field : Reader
        Reader of the quantity.

    Returns
    -------
    Reader
        The extended reader.
    """

    def read(value: object) -> Figure:
        """Convert a quantity, or a mapping with a quantity and its source, to a Figure."""
        if not isinstance(value, dict):
            return Figure(field.read(value))
        check_keys(value, ["value", "source", "placeholder"])
        if "value" not in value:
            raise invalid_value("missing", "value: the figure", "value")
        source = value.get("source")
        placeholder = value.get("placeholder", False)
        if source is not None and not (isinstance(source, str) and source.strip()):
            raise invalid_value(
                f"{units.describe(source)} instead of text", "the source of the figure", "source"
            )
        return Figure(
            _with_pydantic_errors(field.read, "value")(value["value"]),
            source,
            _read_boolean(placeholder, "placeholder"),
        )

    properties = {
        "value": field.json_schema,
        "source": {"type": "string"},
        "placeholder": {"type": "boolean"},
    }
    mapping_schema = {
        "type": "object",
        "properties": properties,
        "required": ["value"],
        "additionalProperties": False,
    }
    return dataclasses.replace(
        field, read=read, json_schema={"anyOf": [field.json_schema, mapping_schema]}
    )


def field_type(cls: Any, name: str, slides: bool = False, sourced: bool = False) -> Any:
    """Return the type with which a model reads a field of a value.

    Parameters
    ----------
    cls : type
        Class of the value.
    name : str
        Name of the field.
    slides : bool
        True for the units of a prismatic joint.
    sourced : bool
        True if the file may state a source of the quantity.

    Returns
    -------
    type or None
        Annotated type. None if the annotation of the field does not determine it.
    """
    hint_type, marks = strip_annotations(field_hints(cls)[name])
    if get_origin(hint_type) is Literal:
        return hint_type
    by_type = {type(mark): mark for mark in marks}
    if str not in by_type:
        return {str: Text, bool: Boolean}.get(hint_type)
    quantity_kind = unit_kind(by_type[str], slides)
    if Ascending in by_type:
        return Annotated[Any, interval_reader(quantity_kind)]
    if Shape in by_type:
        return Annotated[Any, vector_reader(*(quantity_kind,) * by_type[Shape].shape[0])]
    field = quantity_reader(quantity_kind, by_type.get(Bound, UNBOUNDED), hint_type is int)
    return Annotated[Any, sourced_reader(field) if sourced else field]


def build_class_model(
    cls: Any,
    extra_keys: Mapping[str, Any] | None = None,
    *,
    slides: bool = False,
    sourced: bool = False,
    without: tuple[str, ...] = (),
    base: type[Model] = Model,
) -> Any:
    """Build the model of a file from the class of the value that the file describes.

    The fields of the class give the kinds, bounds and defaults of the keys.

    Parameters
    ----------
    cls : type
        Class of the value.
    extra_keys : Mapping, optional
        Additional keys, or keys that replace a field, each as a pair of type and default.
    slides : bool
        True for the units of a prismatic joint.
    sourced : bool
        True if quantities may have sources. Missing quantities are then None instead of the
        default.
    without : tuple of str
        Fields that are not keys.
    base : type
        Base class of the model.

    Returns
    -------
    type
        Subclass of `base` with a field for each key.
    """
    value_fields = {field.name: field for field in dataclasses.fields(cls)}
    model_fields = dict(extra_keys or {})
    fields: Keywords = {}
    for field in value_fields.values():
        if field.name in model_fields:
            fields[field.name] = model_fields.pop(field.name)
            continue
        if field.name in without or not field.compare:
            continue
        hint = field_type(cls, field.name, slides, sourced)
        if hint is None:
            continue
        if field.default is dataclasses.MISSING:
            fields[field.name] = (hint, ...)
        else:
            left_out = field.default is None or (sourced and get_origin(hint) is Annotated)
            fields[field.name] = (hint | None, None) if left_out else (hint, field.default)
    return build_keys_model({**fields, **model_fields}, base, (cls,))


def build_keys_model(
    fields: Mapping[str, Any], base: type[Model] = Model, value_types: tuple[Any, ...] = ()
) -> Any:
    """Build the model of a file or of a part of it from its keys.

    Parameters
    ----------
    fields : Mapping
        Pair of type and default by key, as `required_key` and `optional_key` return it.
    base : type
        Base class of the model.
    value_types : tuple of type
        Classes whose docstrings of the fields describe the keys. If several classes describe a key,
        the last one applies.

    Returns
    -------
    type
        Subclass of `base` with a field for each key.
    """
    created: Any = create_model
    model = created("KeysModel", __base__=base, **fields)
    model.value_types = value_types
    return model


def required_key(hint: Any, description: str) -> Any:
    """Return the type and the default of a key that a file must contain, as pydantic expects it."""
    return hint, PydanticField(description=description)


def optional_key(hint: Any, description: str = "") -> Any:
    """Return the type and the default of a key that may be missing, as pydantic expects it."""
    return hint | None, PydanticField(None, description=description)


def joint_mapping_model(build: Callable[[bool], Any], every: bool = False) -> Any:
    """Build the model of a mapping from joint names to values.

    Parameters
    ----------
    build : callable
        Function that builds the model of the value for a revolute joint or, if its argument is
        true, for the prismatic joint.
    every : bool
        True if the mapping must contain all joints.

    Returns
    -------
    type
        Model with a key for each joint.
    """
    turning, sliding = nested_type(build(False)), nested_type(build(True))
    key = required_key if every else optional_key
    return build_keys_model(
        {
            name: key(sliding if name == "insertion" else turning, f"Joint {i}.")
            for i, name in enumerate(JOINTS, 1)
        }
    )


def _read_text(value: object) -> str:
    """Read a text that is not empty."""
    if not isinstance(value, str) or not value.strip():
        is_empty = isinstance(value, str)
        reason = "an empty text" if is_empty else f"{units.describe(value)} instead of text"
        raise invalid_value(reason, "a text of at least one character")
    return value


_BOOLEANS = {True: True, False: False, "yes": True, "no": False, "on": True, "off": False}


def _read_boolean(value: object, key: str | None = None) -> bool:
    """Read true or false, for which yes, no, on and off are accepted as well."""
    if not isinstance(value, (bool, str)) or value not in _BOOLEANS:
        raise invalid_value(
            f"{units.describe(value)} instead of true or false", "true or false", key
        )
    return _BOOLEANS[value]


def _read_axis(value: object) -> tuple[float, ...]:
    """Read a direction, which is a list of three numbers."""
    if not isinstance(value, list) or len(value) != 3:
        raise invalid_value("invalid axis", "three numbers such as [1, 0, 0]")
    return tuple(units.parse_number(item) for item in value)


def _read_reference(value: object) -> Any:
    """Accept a file name or the content of the file as a mapping."""
    if isinstance(value, dict) or (isinstance(value, str) and value.strip()):
        return value
    raise invalid_value(
        "neither a file name nor a mapping", "a file, relative to this one, or the file's content"
    )


_FILE = "a file, relative to this one"
Text = Annotated[str, Reader(_read_text, {"type": "string", "minLength": 1}, allowed="a text")]
Boolean = Annotated[bool, Reader(_read_boolean, {"type": "boolean"}, allowed="true or false")]
Axis = Annotated[
    tuple[float, ...],
    Reader(_read_axis, {"type": "array", "items": {"type": "number"}}, allowed="three numbers"),
]
Reference = Annotated[
    Any,
    Reader(
        _read_reference,
        {"anyOf": [{"type": "string", "description": _FILE}, {"type": "object"}]},
        allowed=f"{_FILE}, a shipped name, or the content of a file",
    ),
]
SOURCE_KEY: Any = optional_key(Text, "Source of the figures.")


def _with_pydantic_errors(
    reader: Callable[[Any], Any], key: str | None = None
) -> Callable[[Any], Any]:
    """Convert a reader that raises BadQuantity to one that raises pydantic's error.

    Parameters
    ----------
    reader : callable
        Function that converts a value of the file.
    key : str, optional
        Key of the wrong entry within the value, for messages.

    Returns
    -------
    callable
        The converted reader.
    """

    def read(value: Any) -> Any:
        try:
            return reader(value)
        except units.BadQuantity as error:
            raise invalid_value(error.reason, error.allowed, key) from None

    return read


def _quantity_schema(unit_kind: str) -> JsonObject:
    """Return the JSON schema of a quantity: a number, or a text with an example of its unit.

    Parameters
    ----------
    unit_kind : str
        Kind of quantity, a key of units.QUANTITY_KINDS such as "torque".
    """
    if unit_kind == "number":
        return {"type": "number"}
    return {
        "type": "string",
        "description": QUANTITY_KINDS[unit_kind].expected,
        "examples": [QUANTITY_KINDS[unit_kind].example],
    }


class Key(NamedTuple):
    """Key of a file with its description for a table of keys."""

    path: str
    """Path such as joints.roll.velocity. `[]` represents each entry of a list."""
    unit: str
    """Unit in a form that files accept."""
    allowed: str
    default: str
    """Default, "required", or "" for an optional key without a default."""
    description: str


def describe_keys(model: Any, path: str = "") -> Iterator[Key]:
    """Yield a description of every key of a model, for tables of keys.

    The keys of nested models follow their own key.

    Parameters
    ----------
    model : type
        Model of a file.
    path : str
        Beginning of each path, such as "joints.".

    Yields
    ------
    Key
        Path, unit, allowed values, default and description of a key.
    """
    texts = model.key_descriptions()
    for name, info in model.model_fields.items():
        hints = list(_nested_hints((info.annotation, *info.metadata)))
        field = reader_of_key(info)
        choices = [
            repr(choice)
            for hint in hints
            if get_origin(hint) is Literal
            for choice in get_args(hint)
        ]
        default = info.default
        if isinstance(default, (Model, tuple)) or default is None:
            default = ""
        yield Key(
            f"{path}{name}",
            field.unit,
            " or ".join(choices) or field.allowed,
            "required" if info.is_required() else field.format_default(default),
            texts.get(name, ""),
        )
        prefix = f"{path}{name}{'[]' * any(get_origin(hint) in (list, tuple) for hint in hints)}."
        for hint in hints:
            if isinstance(hint, type) and issubclass(hint, Model):
                yield from describe_keys(hint, prefix)


def reader_of_key(info: Any) -> Reader:
    """Return the reader of a key, given pydantic's description of the key.

    The result is an empty reader if no part of the type is a `Reader`.
    """
    hints = _nested_hints((info.annotation, *info.metadata))
    return next((hint for hint in hints if isinstance(hint, Reader)), Reader(str, {}))


def _nested_hints(hint: Any) -> Iterator[Any]:
    """Yield a type, and then all types that it contains at any depth.

    For example, list[int] yields list[int] and int.

    Parameters
    ----------
    hint : type or tuple
        Annotated type, or a tuple of such types. The values of a Literal are not yielded, and an
        annotation `Nested` is replaced by its model.

    Yields
    ------
    type or annotation
        The type itself, and then its parts.
    """
    yield hint.model if isinstance(hint, Nested) else hint
    for inner in (
        hint
        if isinstance(hint, tuple)
        else get_args(hint)
        if get_origin(hint) is not Literal
        else ()
    ):
        yield from _nested_hints(inner)


def validate_section(section: Section, model: type[M]) -> M:
    """Check the value of a section, and convert it to an instance of a model.

    Parameters
    ----------
    section : Section
        File, or part of a file.
    model : type
        Model with the keys of this part.

    Returns
    -------
    Model
        Validated values in SI units.

    Raises
    ------
    ProblemError
        For the first fault in the file. The message also lists further faults, up to `MAX_FAULTS`
        in all.
    """
    try:
        return model.model_validate(section.value)
    except ValidationError as error:
        faults = [
            _to_problem_error(section, details) for details in error.errors(include_url=False)
        ]
    earliest, *faults_left = sorted(faults, key=lambda fault: fault.line or 0)
    earliest.others = tuple(faults_left[: MAX_FAULTS - 1])
    earliest.unshown = len(faults_left) - len(earliest.others)
    raise earliest


@contextmanager
def locate_errors(
    section: Section, locations: Mapping[str, tuple[str | int, ...]] | None = None
) -> Iterator[None]:
    """Add file and line to the errors of constructors that are called within a `with` statement.

    A constructor knows the name of the invalid field. This context manager finds the key of the
    file that belongs to the field. Errors that already name a file are raised unchanged.

    Parameters
    ----------
    section : Section
        Part of the file that describes the values.
    locations : Mapping, optional
        Path in the file by the name of a field, for fields whose key in the file has another name.
    """
    try:
        yield
    except ProblemError as error:
        if error.file is not None or error.key is None:
            raise
        field = error.key.partition(".")[2]
        name, base_path = next(
            ((name, path) for name, path in (locations or {}).items() if field.startswith(name)),
            ("", ()),
        )
        tokens = re.findall(r"[^.\[\]]+", field.removeprefix(name))
        path = (*base_path, *(int(token) if token.isdecimal() else token for token in tokens))
        raise section.error(error.reason, *path, allowed=error.allowed) from None


def _to_problem_error(section: Section, details: Any) -> ProblemError:
    """Convert one of pydantic's errors to a ProblemError with the file, the line and the key.

    Parameters
    ----------
    section : Section
        Part of the file that was validated.
    details : dict
        Entry of `ValidationError.errors()`.

    Returns
    -------
    ProblemError
        The error with a message for the user.
    """
    context = details.get("ctx", {})
    path: tuple[str | int, ...] = ()
    for entry in details["loc"]:  # the parts of a pydantic location that are keys of the file
        if section.sub(*path).has_key(entry):
            path = (*path, entry)
    fault_type = details["type"]
    if fault_type == "problem":
        key = context.get("key")
        return section.error(
            context["reason"], *path, *(() if key is None else (key,)), allowed=context["allowed"]
        )
    if fault_type == "missing":
        return section.error("missing: this key is required", *path, details["loc"][-1])
    if fault_type == "literal_error":
        return section.error("unknown value", *path, allowed=context["expected"])
    if fault_type in ("too_short", "too_long"):
        side, bound = ("min", "at least") if fault_type == "too_short" else ("max", "at most")
        reason = f"{context['actual_length'] or 'no'} entries"
        return section.error(
            reason, *path, allowed=f"{bound} {context[f'{side}_length']}", show=False
        )
    message = (
        details["msg"]
        .replace("Input should be a valid ", "not a ")
        .replace("Input should be ", "should be ")
    )
    message = message.replace("not a tuple", "not a list")
    return section.error(message[:1].lower() + message[1:], *path)
