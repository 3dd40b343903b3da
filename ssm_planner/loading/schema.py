"""What a file may say: strict pydantic models made from the values they describe; everything wrong is one ProblemError.

A field of a value that is a key of a file carries its kind of quantity (`value.Quantity`), its bounds and its default;
`model_of` reads them there. What a file says in another way is declared beside what reads it.
"""

from __future__ import annotations

import copy
import dataclasses
import difflib
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, TypeVar, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationError, create_model, model_validator
from pydantic import Field as PydanticField
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from ssm_planner import units
from ssm_planner.errors import ProblemError
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.problem.robot import JOINTS
from ssm_planner.problem.value import Ascending, Bound, Quantity, Shape, bare, descriptions, hints
from ssm_planner.units import KINDS, NUMBER

M = TypeVar("M", bound="Model")
UNBOUND = Bound()
SHOWN = 10
"""Faults of one file."""


class Figure(NamedTuple):
    """A number with its origin."""

    value: float
    source: str | None = None
    placeholder: bool = False


class Model(BaseModel):
    """Frozen; unknown keys are errors that suggest the known ones."""

    # most models are not used by one command: each is built when it first is
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)
    of: ClassVar[tuple[Any, ...]] = ()
    """The values that it describes; the last one's word counts."""

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            raise wrong(
                f"{units.describe(data)} where a mapping is needed",
                "the keys " + ", ".join(cls.model_fields),
            )
        check_keys(data, list(cls.model_fields))
        return data

    @classmethod
    def about(cls) -> dict[str, str]:
        """What each key means, where that is said."""
        named = {
            name: info.description for name, info in cls.model_fields.items() if info.description
        }
        of_value = {name: text for each in cls.of for name, text in descriptions(each).items()}
        # shapes and None are Python's
        in_files = {
            name: re.sub(r",? ?\(3,\)", "", text).replace("None:", "left out:")
            for name, text in of_value.items()
        }
        return {**in_files, **descriptions(cls), **named}

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: Any) -> dict[str, Any]:
        schema = handler(core)
        keys_of = handler.resolve_ref_schema(schema).get("properties", {})
        about = cls.about()
        for name, entry in keys_of.items():
            entry.pop("title", None)
            if name in about:
                entry["description"] = about[name]
            if isinstance(entry.get("default"), float):
                entry["default"] = field_of(cls.model_fields[name]).written(entry["default"])
        return schema

    def figures(self) -> dict[str, Figure]:
        """The fields that hold a figure."""
        return {name: value for name, value in self if isinstance(value, Figure)}


def check_keys(data: dict[Any, Any], known: list[str]) -> None:
    """Raises for the first key that is not among the known ones, with the one probably meant."""
    for key in data:
        if key not in known:
            close = difflib.get_close_matches(str(key), known, n=1)
            reason = "unknown key" + (f"; did you mean {close[0]!r}?" if close else "")
            raise wrong(reason, ", ".join(known), key)
        if data[key] is None:
            raise wrong("nothing is given; leave the key out if there is nothing to say", None, key)


def wrong(reason: str, allowed: str | None = None, key: str | None = None) -> PydanticCustomError:
    """An error that the loader turns into a ProblemError; key: a key below the value being validated."""
    return PydanticCustomError(
        "problem", "see the context", {"reason": reason, "allowed": allowed, "key": key}
    )


@dataclasses.dataclass(frozen=True, eq=False)
class Field:
    """Metadata of an Annotated type: how its value is read, and how a JSON schema and a table describe it."""

    read: Callable[[Any], Any]
    json_schema: dict[str, Any]
    kinds: tuple[str, ...] = ()
    """In units.KINDS."""
    allowed: str = ""
    """Beside the unit."""

    @property
    def unit(self) -> str:
        """Such as it may be written."""
        return ", ".join(
            dict.fromkeys(KINDS.get(kind, NUMBER).example.partition(" ")[2] for kind in self.kinds)
        )

    def written(self, value: Any) -> str:
        """A default as a file would say it."""
        if not self.unit or not isinstance(value, float):
            return str(value)
        return f"{value / units.quantity(f'1 {self.unit}', self.kinds[0]):.6g} {self.unit}"

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(_guarded(self.read))

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return copy.deepcopy(self.json_schema)  # pydantic writes defaults into it


@dataclasses.dataclass(frozen=True, eq=False)
class Part:
    """Metadata of an Annotated type that a model describes which is made when the program runs."""

    model: Any

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        schema: CoreSchema = handler.generate_schema(self.model)
        return schema


def quantity(kind: str, bound: Bound = UNBOUND, whole: bool = False) -> Field:
    """One quantity of a kind in units.KINDS, SI; whole: an int where it is one."""

    def read(value: object) -> float:
        result = units.quantity(value, kind)
        if fault := bound.fault(result):
            raise units.BadQuantity(
                fault, allowed if whole else f"{KINDS.get(kind, NUMBER).name} {allowed}"
            )
        if whole and not result.is_integer():
            raise units.BadQuantity("not a whole number", allowed)
        return int(result) if whole else result

    allowed = f"a whole number {bound.allowed}" if whole else bound.allowed
    return Field(read, _json_schema(kind), (kind,), allowed)


def interval(kind: str) -> Field:
    """`[lower, upper]`."""
    schema = {"type": "array", "items": _json_schema(kind), "minItems": 2, "maxItems": 2}
    return Field(lambda value: units.interval(value, kind), schema, (kind,), "[lower, upper]")


def vector(*kinds: str) -> Field:
    """`[1 mm, 2 mm, 3 mm]` or `(1, 2, 3) mm`, one kind per component."""
    items = {
        "type": "array",
        "items": _json_schema(kinds[0]),
        "minItems": len(kinds),
        "maxItems": len(kinds),
    }
    if len(set(kinds)) > 1:
        items = {"type": "array", "prefixItems": [_json_schema(kind) for kind in kinds]}
    schema = {"anyOf": [items, {"type": "string"}]}
    return Field(lambda value: units.vector(value, kinds), schema, kinds, f"{len(kinds)} values")


def figure(of: Field) -> Field:
    """A Figure: a quantity, or `{value: quantity, source: text, placeholder: true}`."""

    def read(value: object) -> Figure:
        if not isinstance(value, dict):
            return Figure(of.read(value))
        check_keys(value, ["value", "source", "placeholder"])
        if "value" not in value:
            raise wrong("missing", "value: the figure itself", "value")
        source, placeholder = value.get("source"), value.get("placeholder", False)
        if source is not None and not (isinstance(source, str) and source.strip()):
            raise wrong(
                f"{units.describe(source)} where a text is needed",
                "where the figure comes from",
                "source",
            )
        return Figure(
            _guarded(of.read, "value")(value["value"]), source, _truth(placeholder, "placeholder")
        )

    parts = {
        "value": of.json_schema,
        "source": {"type": "string"},
        "placeholder": {"type": "boolean"},
    }
    full = {
        "type": "object",
        "properties": parts,
        "required": ["value"],
        "additionalProperties": False,
    }
    return dataclasses.replace(of, read=read, json_schema={"anyOf": [of.json_schema, full]})


def reading(cls: Any, name: str, slides: bool = False, figures: bool = False) -> Any:
    """How a file says what a field of a value holds; None where its type does not say it.

    slides: of a joint that slides. figures: a quantity may have a source.
    """
    kind, marks = bare(hints(cls)[name])
    if get_origin(kind) is Literal:
        return kind
    by_type = {type(mark): mark for mark in marks}
    if Quantity not in by_type:
        return {str: Text, bool: Truth}.get(kind)
    of = by_type[Quantity].kind(slides)
    if Ascending in by_type:
        return Annotated[Any, interval(of)]
    if Shape in by_type:
        return Annotated[Any, vector(*(of,) * by_type[Shape].shape[0])]
    field = quantity(of, by_type.get(Bound, UNBOUND), kind is int)
    return Annotated[Any, figure(field) if figures else field]


def model_of(
    cls: Any,
    more: Mapping[str, Any] | None = None,
    *,
    slides: bool = False,
    figures: bool = False,
    without: tuple[str, ...] = (),
    base: type[Model] = Model,
) -> Any:
    """The model of a value: kinds, bounds and defaults are those of its fields.

    more: keys that are read otherwise, as pydantic's (type, default). slides: of a joint that slides. figures: quantities
    may have sources; those left out are None, whatever the value's default. without: fields that are no keys.
    """
    own = {field.name: field for field in dataclasses.fields(cls)}
    given = dict(more or {})
    fields: dict[str, Any] = {}
    for field in own.values():
        if field.name in given:
            fields[field.name] = given.pop(field.name)
            continue
        if field.name in without or not field.compare:
            continue
        hint = reading(cls, field.name, slides, figures)
        if hint is None:
            continue
        if field.default is dataclasses.MISSING:
            fields[field.name] = (hint, ...)
        else:
            left_out = field.default is None or (figures and get_origin(hint) is Annotated)
            fields[field.name] = (hint | None, None) if left_out else (hint, field.default)
    return model_from({**fields, **given}, base, (cls,))


def model_from(
    fields: Mapping[str, Any], base: type[Model] = Model, of: tuple[Any, ...] = ()
) -> Any:
    """The model with these keys, each as pydantic's (type, default); of: values whose fields say what
    they mean; the last one's word counts."""
    made: Any = create_model
    model = made("KeysModel", __base__=base, **fields)
    model.of = of
    return model


def optional(hint: Any, description: str = "") -> Any:
    """A key that may be left out."""
    return hint | None, PydanticField(None, description=description)


def by_joint(turning: Any, sliding: Any, required: bool = False) -> Any:
    """The model of a mapping from joints to what a model says of one of them."""
    fields: dict[str, Any] = {}
    for i, name in enumerate(JOINTS, 1):
        part, text = (
            Annotated[Any, Part(sliding if name == "insertion" else turning)],
            f"Of joint {i}.",
        )
        fields[name] = (part, PydanticField(description=text)) if required else optional(part, text)
    return model_from(fields)


def _text(value: object) -> str:
    if not isinstance(value, str) or not value.strip():
        raise wrong(
            f"{units.describe(value)} where a text is needed", "a text of at least one character"
        )
    return value


_TRUTH = {True: True, False: False, "yes": True, "no": False, "on": True, "off": False}


def _truth(value: object, key: str | None = None) -> bool:
    if not isinstance(value, (bool, str)) or value not in _TRUTH:
        raise wrong(f"{units.describe(value)} where true or false is needed", "true or false", key)
    return _TRUTH[value]


def _axis(value: object) -> tuple[float, ...]:
    if not isinstance(value, list) or len(value) != 3:
        raise wrong("not an axis", "three numbers such as [1, 0, 0]")
    return tuple(units.number(part) for part in value)


def _reference(value: object) -> Any:
    if isinstance(value, dict) or (isinstance(value, str) and value.strip()):
        return value
    raise wrong(
        "neither a file name nor a mapping", "a file, relative to this one, or the file's content"
    )


_FILE = "a file, relative to this one"
Text = Annotated[str, Field(_text, {"type": "string", "minLength": 1}, allowed="a text")]
Truth = Annotated[bool, Field(_truth, {"type": "boolean"}, allowed="true or false")]
Axis = Annotated[
    tuple[float, ...],
    Field(_axis, {"type": "array", "items": {"type": "number"}}, allowed="three numbers"),
]
Reference = Annotated[
    Any,
    Field(
        _reference,
        {"anyOf": [{"type": "string", "description": _FILE}, {"type": "object"}]},
        allowed=f"{_FILE}, a shipped name, or what the file would hold",
    ),
]
SOURCE: Any = optional(Text, "Where the figures come from.")


def _guarded(reader: Callable[[Any], Any], key: str | None = None) -> Callable[[Any], Any]:
    def read(value: Any) -> Any:
        try:
            return reader(value)
        except units.BadQuantity as error:
            raise wrong(error.reason, error.allowed, key) from None

    return read


def _json_schema(kind: str) -> dict[str, Any]:
    if kind == "number":
        return {"type": "number"}
    return {
        "type": "string",
        "description": KINDS[kind].expected,
        "examples": [KINDS[kind].example],
    }


class Key(NamedTuple):
    """A key of a file, with what a table of keys says of it."""

    path: str
    """Such as joints.roll.velocity; `[]` stands for each entry of a list."""
    unit: str
    """Such as it may be written."""
    allowed: str
    default: str
    """Empty where there is none; "required" where the key may not be left out."""
    description: str


def keys(model: Any, path: str = "") -> Iterator[Key]:
    """Every key that a model knows, those of its parts below their own."""
    about = model.about()
    for name, info in model.model_fields.items():
        parts, field = list(_parts((info.annotation, *info.metadata))), field_of(info)
        choices = [
            repr(choice)
            for part in parts
            if get_origin(part) is Literal
            for choice in get_args(part)
        ]
        default = info.default
        if isinstance(default, (Model, tuple)) or default is None:
            default = ""
        yield Key(
            f"{path}{name}",
            field.unit,
            " or ".join(choices) or field.allowed,
            "required" if info.is_required() else field.written(default),
            about.get(name, ""),
        )
        inside = f"{path}{name}{'[]' * any(get_origin(part) in (list, tuple) for part in parts)}."
        for part in parts:
            if isinstance(part, type) and issubclass(part, Model):
                yield from keys(part, inside)


def field_of(info: Any) -> Field:
    """How a key's value is read, of pydantic's description of the key."""
    parts = _parts((info.annotation, *info.metadata))
    return next((part for part in parts if isinstance(part, Field)), Field(str, {}))


def _parts(hint: Any) -> Iterator[Any]:
    """A type and everything it is made of."""
    yield hint.model if isinstance(hint, Part) else hint
    for part in (
        hint
        if isinstance(hint, tuple)
        else get_args(hint)
        if get_origin(hint) is not Literal
        else ()
    ):
        yield from _parts(part)


def validated(section: Section, model: type[M]) -> M:
    """The section's value as an instance of the model. Raises ProblemError: the first fault, with the others in it."""
    try:
        return model.model_validate(section.value)
    except ValidationError as error:
        faults = [_fault(section, details) for details in error.errors(include_url=False)]
    first, *others = sorted(faults, key=lambda fault: fault.line or 0)
    first.others = tuple(others[: SHOWN - 1])
    first.unshown = len(others) - len(first.others)
    raise first


@contextmanager
def located(
    section: Section, places: Mapping[str, tuple[str | int, ...]] | None = None
) -> Iterator[None]:
    """Completes errors of values made within by file and line; places: of fields that the file calls otherwise."""
    try:
        yield
    except ProblemError as error:
        if error.file is not None or error.key is None:
            raise
        field = error.key.partition(".")[2]
        name, rest = next(
            ((name, path) for name, path in (places or {}).items() if field.startswith(name)),
            ("", ()),
        )
        parts = re.findall(r"[^.\[\]]+", field.removeprefix(name))
        path = (*rest, *(int(part) if part.isdecimal() else part for part in parts))
        raise section.error(error.reason, *path, allowed=error.allowed) from None


def _fault(section: Section, details: Any) -> ProblemError:
    context = details.get("ctx", {})
    path: tuple[str | int, ...] = ()
    for part in details["loc"]:  # of a pydantic location what names keys of the file
        if section.sub(*path).holds(part):
            path = (*path, part)
    kind = details["type"]
    if kind == "problem":
        key = context.get("key")
        return section.error(
            context["reason"], *path, *(() if key is None else (key,)), allowed=context["allowed"]
        )
    if kind == "missing":
        return section.error("missing: this key is required", *path, details["loc"][-1])
    if kind == "literal_error":
        return section.error("not one of the values known here", *path, allowed=context["expected"])
    if kind in ("too_short", "too_long"):
        side, bound = ("min", "at least") if kind == "too_short" else ("max", "at most")
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
