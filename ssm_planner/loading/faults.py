"""A section of a file checked against its schema; everything wrong becomes one ProblemError."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar

from pydantic import ValidationError

from ssm_planner.errors import ProblemError
from ssm_planner.loading.schema.common import Model
from ssm_planner.loading.yaml_nodes import Section

M = TypeVar("M", bound=Model)
SHOWN = 10


def validated(section: Section, model: type[M]) -> M:
    """The section's value as an instance of the model. Raises ProblemError: the first fault, with the others in it."""
    try:
        return model.model_validate(section.value)
    except ValidationError as error:
        faults = [_fault(section, details) for details in error.errors(include_url=False)]
    raise combined(faults)


@contextmanager
def located(section: Section, keys: Mapping[str, tuple[str | int, ...]] | None = None) -> Iterator[None]:
    """Completes errors of values made within by file and line; keys: where a field stands that the file calls otherwise."""
    try:
        yield
    except ProblemError as error:
        if error.file is not None or error.key is None:
            raise
        field = error.key.partition(".")[2]
        name, rest = next(((name, path) for name, path in (keys or {}).items() if field.startswith(name)), ("", ()))
        parts = re.findall(r"[^.\[\]]+", field.removeprefix(name))
        path = (*rest, *(int(part) if part.isdecimal() else part for part in parts))
        raise section.error(error.reason, *path, allowed=error.allowed) from None


def combined(faults: list[ProblemError]) -> ProblemError:
    """One error for several faults, in the order of the file."""
    faults = sorted(faults, key=lambda fault: fault.line or 0)
    first, others = faults[0], faults[1:]
    first.others = tuple(others[: SHOWN - 1])
    first.unshown = len(others) - len(first.others)
    return first


def _fault(section: Section, details: Any) -> ProblemError:
    context = details.get("ctx", {})
    path = _existing(section, details["loc"])
    kind = details["type"]
    if kind == "problem":
        key = context.get("key")
        if key is not None:
            path = (*path, key)
        return section.error(context["reason"], *path, allowed=context["allowed"])
    if kind == "missing":
        return section.error("missing: this key is required", *path, details["loc"][-1])
    if kind == "literal_error":
        return section.error("not one of the values known here", *path, allowed=context["expected"])
    if kind in ("too_short", "too_long"):
        count = context.get("min_length" if kind == "too_short" else "max_length")
        bound = "at least" if kind == "too_short" else "at most"
        reason = f"{context['actual_length'] or 'no'} entries"
        return section.error(reason, *path, allowed=f"{bound} {count}", show=False)
    return section.error(_plain(details["msg"]), *path)


def _existing(section: Section, loc: tuple[str | int, ...]) -> tuple[str | int, ...]:
    """The part of a pydantic location that names keys of the file."""
    path: tuple[str | int, ...] = ()
    for part in loc:
        if section.sub(*path).holds(part):
            path = (*path, part)
    return path


def _plain(message: str) -> str:
    message = message.replace("Input should be a valid ", "not a ").replace("Input should be ", "should be ")
    message = message.replace("not a tuple", "not a list")
    return message[:1].lower() + message[1:]
