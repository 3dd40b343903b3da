"""Check the arguments of public functions against their type annotations.

Users who call the package from Python without a type checker then get a message about the wrong
argument instead of an error deep in the package. The decorator is `checked`.
"""

import inspect
import math
import types
from collections.abc import Callable, Mapping, Sequence
from functools import cache, wraps
from numbers import Integral, Real
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

from ssm_planner.errors import GeometryError, ProblemError

P = ParamSpec("P")
T = TypeVar("T")


class _ArrayLike:
    """Stand-in for the type ArrayLike, which isinstance does not accept."""


def checked(function: Callable[P, T]) -> Callable[P, T]:
    """Decorate a function so that it checks its arguments against their annotations.

    Numbers must be finite. An argument that is the default value is accepted without a check.

    Parameters
    ----------
    function : callable
        Function of a module with postponed annotations (`from __future__ import annotations`).

    Returns
    -------
    callable
        The function with the check. It raises GeometryError for a wrong argument that may be an
        array, and otherwise ProblemError. The message names the argument, its value and the allowed
        types.
    """
    signature = inspect.signature(function)
    hints = cache(lambda: get_type_hints(function, localns={"ArrayLike": _ArrayLike}))

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        """Check the arguments of a call, and then call the decorated function with them."""
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
    """Return True if a value has the type of an annotation.

    The function also examines the items of sequences and the values of mappings. Numbers must be
    finite, and True and False are not numbers.

    Parameters
    ----------
    hint : type or special form
        Annotation, such as `float | None` or `Sequence[Motor]`.
    value : object
        Argument to check.

    Returns
    -------
    bool
        True if the value is accepted.
    """
    value_type = get_origin(hint) or hint
    arguments = get_args(hint)
    if value_type is Any:
        return True
    if value_type in (Union, types.UnionType):
        is_accepted = any(_matches(member, value) for member in arguments)
        # An empty text would name the current folder.
        return is_accepted and not (Path in arguments and isinstance(value, str) and not value)
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
    """Return True if a value can be converted to an array of integers or floats.

    Parameters
    ----------
    value : object
        Value of any type, such as a nested list.

    Returns
    -------
    bool
        False for texts, booleans, complex numbers, other objects and lists of unequal length.
    """
    import numpy as np

    try:
        return np.asarray(value).dtype.kind in "fiu"
    except ValueError:
        return False
