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


class _ArrayLike:
    """Stand-in for the type ArrayLike, which isinstance does not accept."""


def checked(function: Callable[P, T]) -> Callable[P, T]:
    """Decorate a function so that it checks its arguments against their annotations.

    Numbers must be finite. The error names the argument, its value and the allowed types. It is a
    GeometryError for arrays, and otherwise a ProblemError.
    """
    signature = inspect.signature(function)
    hints = cache(lambda: get_type_hints(function, localns={"ArrayLike": _ArrayLike}))

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
    value_type = get_origin(hint) or hint
    arguments = get_args(hint)
    if value_type is Any:
        return True
    if value_type in (Union, types.UnionType):
        return any(_matches(member, value) for member in arguments)
    if value_type is _ArrayLike:
        return _is_numeric(value)
    if value_type in (float, int):
        is_number = isinstance(value, Real if value_type is float else Integral)
        return is_number and type(value) is not bool and math.isfinite(value)
    if not isinstance(value, value_type):
        return False
    if value_type is Sequence:  # a text is not a sequence here
        is_text = isinstance(value, (str, bytes))
        return not is_text and all(_matches(arguments[0], item) for item in value)
    if value_type is Mapping:
        return all(_matches(arguments[1], item) for item in value.values())
    return True


def _is_numeric(value: Any) -> bool:
    """Return True if a value can be converted to an array of numbers."""
    import numpy as np

    try:
        return np.asarray(value).dtype.kind in "fiu"
    except ValueError:
        return False
