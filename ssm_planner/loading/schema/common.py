"""What all file schemas share: strict models, and fields that read quantities with units and figures with sources."""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, get_args, get_origin

from pydantic import BaseModel, ConfigDict, create_model, model_validator
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from ssm_planner import units
from ssm_planner.problem.value import Ascending, Bound, Shape, hint_of
from ssm_planner.units import KINDS


@dataclass(frozen=True)
class Figure:
    """A number with its origin."""

    value: float
    source: str | None = None
    placeholder: bool = False


class Model(BaseModel):
    """Frozen; unknown keys are errors that suggest the known ones."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            raise wrong(f"{units.describe(data)} where a mapping is needed", "the keys " + ", ".join(cls.model_fields))
        check_keys(data, list(cls.model_fields))
        return data

    def figures(self) -> Iterator[tuple[str, Figure]]:
        """Name and figure of every field that holds one."""
        for name in type(self).model_fields:
            value = getattr(self, name)
            if isinstance(value, Figure):
                yield name, value


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
    return PydanticCustomError("problem", "see the context", {"reason": reason, "allowed": allowed, "key": key})


class Field:
    """Metadata of an Annotated field: how its value is read, and how a JSON schema describes it."""

    def __init__(self, read: Callable[[Any], Any], json_schema: dict[str, Any]) -> None:
        self.read = read
        self.json_schema = json_schema

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.read)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return self.json_schema


def quantity(kind: str, *, above: float | None = None, at_least: float | None = None) -> Field:
    """One quantity of a kind in kinds.KINDS (or "number": dimensionless), SI."""
    return Field(_guarded(_bounded(kind, above, at_least)), _json_schema(kind))


def interval(kind: str) -> Field:
    """`[lower, upper]`."""
    schema = {"type": "array", "items": _json_schema(kind), "minItems": 2, "maxItems": 2}
    return Field(_guarded(lambda value: units.interval(value, kind)), schema)


def vector(*kinds: str) -> Field:
    """`[1 mm, 2 mm, 3 mm]` or `(1, 2, 3) mm`, one kind per component."""
    items = {"type": "array", "items": _json_schema(kinds[0]), "minItems": len(kinds), "maxItems": len(kinds)}
    if len(set(kinds)) > 1:
        items = {"type": "array", "prefixItems": [_json_schema(kind) for kind in kinds]}
    return Field(_guarded(lambda value: units.vector(value, kinds)), {"anyOf": [items, {"type": "string"}]})


def figure(kind: str, *, above: float | None = None, at_least: float | None = None) -> Field:
    """A Figure: a quantity, or `{value: quantity, source: text, placeholder: true}`."""
    reader = _bounded(kind, above, at_least)
    plain = _json_schema(kind)
    full = {
        "type": "object",
        "properties": {"value": plain, "source": {"type": "string"}, "placeholder": {"type": "boolean"}},
        "required": ["value"],
        "additionalProperties": False,
    }
    return Field(lambda value: _figure(value, reader), {"anyOf": [plain, full]})


def of(cls: Any, name: str, kind: str, figures: bool = False) -> Field:
    """How a quantity of this kind is read for a field of a value: within the field's bounds, as many as it holds.

    figures: it may have a source.
    """
    hint, marks = hint_of(cls, name)
    bounds: dict[str, float] = {}
    for mark in marks:
        if isinstance(mark, Ascending):
            return interval(kind)
        if isinstance(mark, Shape):
            return vector(*(kind,) * mark.shape[0])
        if isinstance(mark, Bound):
            limits = {"above": mark.above, "at_least": mark.at_least}
            bounds = {side: limit for side, limit in limits.items() if math.isfinite(limit)}
    if get_origin(hint) is tuple:
        return vector(*(kind,) * len(get_args(hint)))
    return figure(kind, **bounds) if figures else quantity(kind, **bounds)


class Part:
    """Metadata of an Annotated field that holds what a model made by `model_of` describes."""

    def __init__(self, model: Any) -> None:
        self.model = model

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        schema: CoreSchema = handler.generate_schema(self.model)
        return schema


def model_of(cls: Any, kinds: Mapping[str, Any], base: type[Model] = Model, figures: bool = False) -> Any:
    """The model of a value: bounds and defaults are the value's, so that neither stands twice.

    kinds: the kind of quantity by key, or the pydantic field (type, default) of a key that is read otherwise.
    figures: quantities may have sources; those left out are None, whatever the value's default.
    """
    defaults = {field.name: field.default for field in dataclasses.fields(cls)}
    fields: dict[str, Any] = {}
    for name, kind in kinds.items():
        if not isinstance(kind, str):
            fields[name] = kind
            continue
        hint: Any = Annotated[Any, of(cls, name, kind, figures)]
        default = defaults[name]
        if default is dataclasses.MISSING:
            fields[name] = (hint, ...)
        else:
            fields[name] = (hint | None, None) if figures or default is None else (hint, default)
    return create_model(f"{cls.__name__}Model", __base__=base, __doc__=f"See {cls.__name__}.", **fields)


def _figure(value: object, reader: Callable[[object], float]) -> Figure:
    if not isinstance(value, dict):
        return Figure(_guarded(reader)(value))
    check_keys(value, ["value", "source", "placeholder"])
    if "value" not in value:
        raise wrong("missing", "value: the figure itself", "value")
    source, placeholder = value.get("source"), value.get("placeholder", False)
    if source is not None and not (isinstance(source, str) and source.strip()):
        raise wrong(f"{units.describe(source)} where a text is needed", "where the figure comes from", "source")
    return Figure(_guarded(reader, "value")(value["value"]), source, _truth(placeholder, "placeholder"))


def _text(value: object) -> str:
    if not isinstance(value, str) or not value.strip():
        raise wrong(f"{units.describe(value)} where a text is needed", "a text of at least one character")
    return value


_TRUTH = {True: True, False: False, "yes": True, "no": False, "on": True, "off": False}


def _truth(value: object, key: str | None = None) -> bool:
    if not isinstance(value, (bool, str)) or value not in _TRUTH:
        raise wrong(f"{units.describe(value)} where true or false is needed", "true or false", key)
    return _TRUTH[value]


Text = Annotated[str, Field(_text, {"type": "string", "minLength": 1})]
Truth = Annotated[bool, Field(_truth, {"type": "boolean"})]


def _axis(value: object) -> tuple[float, ...]:
    if not isinstance(value, list) or len(value) != 3:
        raise wrong("not an axis", "three numbers such as [1, 0, 0]")
    try:
        return tuple(units.number(part) for part in value)
    except units.BadQuantity as error:
        raise wrong(error.reason, error.allowed) from None


Axis = Annotated[tuple[float, ...], Field(_axis, {"type": "array", "items": {"type": "number"}})]


def _reference(value: object) -> Any:
    if isinstance(value, dict) or (isinstance(value, str) and value.strip()):
        return value
    raise wrong("neither a file name nor a mapping", "a file, relative to this one, or the file's content")


_REFERENCE = {"anyOf": [{"type": "string", "description": "a file, relative to this one"}, {"type": "object"}]}
Reference = Annotated[Any, Field(_reference, _REFERENCE)]


def _bounded(kind: str, above: float | None, at_least: float | None) -> Callable[[object], float]:
    def read(value: object) -> float:
        result = units.number(value) if kind == "number" else units.quantity(value, kind)
        name = "a number" if kind == "number" else KINDS[kind].name
        if above is not None and not result > above:
            raise units.BadQuantity("not greater than zero" if above == 0 else "too small", f"{name} above {above:g}")
        if at_least is not None and not result >= at_least:
            raise units.BadQuantity("negative" if at_least == 0 else "too small", f"{name} of at least {at_least:g}")
        return result

    return read


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
    wanted = KINDS[kind]
    return {"type": "string", "description": wanted.expected, "examples": [wanted.example]}
