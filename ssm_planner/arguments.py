"""Check the arguments of public functions against their type annotations."""

import inspect
import math
import types
from collections.abc import Callable, Mapping, Sequence
from functools import cache, wraps
from numbers import Integral, Real
from typing import Any, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

from ssm_planner.errors import GeometryError, ProblemError

P = ParamSpec("P")
T = TypeVar("T")


class _Numbers:
    """Stand-in for the type ArrayLike, which isinstance does not accept."""


def checked(function: Callable[P, T]) -> Callable[P, T]:
    """Decorate a function so that it checks its arguments against their annotations.

    Numbers must be finite. The error names the argument, its value and the allowed types. It is a
    GeometryError for arrays, and otherwise a ProblemError.
    """
    signature = inspect.signature(function)
    hints = cache(lambda: get_type_hints(function, localns={"ArrayLike": _Numbers}))

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        """Check the arguments, and call the function."""
        for name, value in signature.bind(*args, **kwargs).arguments.items():
            parameter = signature.parameters[name]
            if value is parameter.default:
                continue
            if not _matches(hints()[name], value):
                allowed = parameter.annotation.replace("ArrayLike", "array of numbers")
                allowed = allowed.replace(" | ", " or ")
                reason = f"no argument for {function.__name__}()"
                error = ProblemError(reason, key=name, value=str(value), allowed=allowed)
                raise GeometryError(str(error)) if "array" in allowed else error
        return function(*args, **kwargs)

    return call


def _matches(hint: Any, value: Any) -> bool:
    """Return True if a value has the type of an annotation."""
    kind = get_origin(hint) or hint
    arguments = get_args(hint)
    if kind is Any:
        return True
    if kind in (Union, types.UnionType):
        return any(_matches(member, value) for member in arguments)
    if kind is _Numbers:
        return _numeric(value)
    if kind in (float, int):
        number = isinstance(value, Real if kind is float else Integral)
        return number and type(value) is not bool and math.isfinite(value)
    if kind in (Mapping, Sequence):
        return _matches_items(kind, arguments[-1], value)
    return isinstance(value, kind)


def _matches_items(kind: type, hint: Any, value: Any) -> bool:
    """Return True if a value is a mapping or a sequence (`kind`) whose items have the type `hint`.

    A text is not a sequence.
    """
    if not isinstance(value, kind) or isinstance(value, (str, bytes)):
        return False
    items: Any = value.values() if isinstance(value, Mapping) else value
    return all(_matches(hint, item) for item in items)


def _numeric(value: Any) -> bool:
    """Return True if a value can be converted to an array of numbers."""
    import numpy as np

    try:
        return np.asarray(value).dtype.kind in "fiu"
    except ValueError:
        return False
