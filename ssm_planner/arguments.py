"""Check the arguments of public functions and methods against their type annotations.

Users who call the package from Python without a type checker then get a message about the wrong
argument instead of an error deep in the package. `checked` decorates functions, and
`check_methods` the methods of a class.
"""

import builtins
import inspect
import math
import sys
import types
from collections.abc import Callable, Mapping, Sequence
from functools import cache, wraps
from numbers import Integral, Real
from pathlib import Path
from typing import (
    Any,
    Literal,
    ParamSpec,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np

from ssm_planner.errors import GeometryError, ProblemError, SsmPlannerError

P = ParamSpec("P")
T = TypeVar("T")
C = TypeVar("C")
UNCHECKED_CALLERS = ("ssm_planner.", "dataclasses")
"""Beginnings of the names of modules whose calls of methods are not checked.

mypy checks the calls within this package, and `dataclasses.replace` passes existing fields on.
"""
LARGEST_NUMBER = 1e15
"""Largest magnitude of a single number. No quantity in SI units is as large.

Arrays may contain larger numbers, for example coefficients of short polynomial pieces.
"""
ARRAY = "array of numbers"
"""Description of the type of an array in messages."""


class _ArrayLike:
    """Stand-in for the type ArrayLike, which isinstance does not accept."""


class _Names(dict[str, Any]):
    """Names in annotations, which may be public names that only type checkers import.

    Other names that only type checkers import stand for any type.
    """

    def __missing__(self, name: str) -> Any:
        return getattr(builtins, name, None) or getattr(sys.modules["ssm_planner"], name, object)


def checked(
    function: Callable[P, T],
    outside_only: bool = False,
    array_error: type[SsmPlannerError] = GeometryError,
) -> Callable[P, T]:
    """Decorate a function so that it checks its arguments against their annotations.

    Numbers must be finite, except that an infinite float is an argument of a method. An argument
    that is the default value is accepted without a check.

    Parameters
    ----------
    function : callable
        Function whose annotations are types or texts.
    outside_only : bool
        True for a method, of which only the calls from other packages are checked.
    array_error : type
        Class of the error about a wrong argument that may be an array.

    Returns
    -------
    callable
        The function with the check. It raises ProblemError for an argument that cannot be an array.
        The message names the argument, its value and the allowed types.
    """

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        """Check the arguments of a call, and then call the decorated function with them."""
        caller = sys._getframe(1).f_globals.get("__name__", "")
        if outside_only and caller.startswith(UNCHECKED_CALLERS):
            return function(*args, **kwargs)
        error = _argument_error(function, args, kwargs, outside_only)
        if error is not None:
            raise array_error(str(error)) if ARRAY in str(error.allowed) else error
        return function(*args, **kwargs)

    return call


def check_methods(cls: type[C]) -> type[C]:
    """Make the methods of a class check their arguments in calls from other packages.

    These are the public methods of a public class, and its constructor unless `cls` is not yet a
    dataclass.

    Parameters
    ----------
    cls : type
        Class to change. Its properties and its inherited methods remain unchanged. An attribute
        `_array_error` is the class of errors about arrays.

    Returns
    -------
    type
        The same class.
    """
    array_error = getattr(cls, "_array_error", GeometryError)
    members = [] if cls.__name__.startswith("_") else list(vars(cls).items())
    for name, member in members:
        function = getattr(member, "__func__", member)
        is_public = not name.startswith("_") or name == "__init__"
        if is_public and inspect.isfunction(function) and not hasattr(function, "__wrapped__"):
            method = checked(function, True, array_error)
            setattr(cls, name, method if member is function else type(member)(method))
    return cls


@cache
def _parameters(function: Callable[..., Any]) -> tuple[inspect.Signature, dict[str, Any]]:
    """Return the signature of a function, and the types of its parameters by name."""
    names = _Names({**function.__globals__, "ArrayLike": _ArrayLike})
    return inspect.signature(function), get_type_hints(function, None, names)


def _argument_error(
    function: Callable[..., Any], args: Sequence[Any], kwargs: Mapping[str, Any], is_method: bool
) -> ProblemError | None:
    """Return the error for an argument of a call that does not have its annotated type.

    Parameters
    ----------
    function : callable
        Function that is called.
    args : sequence
        Positional arguments.
    kwargs : mapping
        Keyword arguments by name.
    is_method : bool
        True to accept infinite floats.

    Returns
    -------
    ProblemError or None
        The error. None if all arguments have their types.

    Raises
    ------
    TypeError
        If an argument is missing, or if there are too many.
    """
    signature, hints = _parameters(function)
    for name, value in signature.bind(*args, **kwargs).arguments.items():
        parameter = signature.parameters[name]
        if value is parameter.default or name not in hints:
            continue
        is_infinite = (
            is_method and hints[name] is float and isinstance(value, float) and math.isinf(value)
        )
        items = value if parameter.kind is parameter.VAR_POSITIONAL else [value]
        if is_infinite or all(_matches(hints[name], item) for item in items):
            continue
        allowed = _description(hints[name])
        if isinstance(value, Real):
            allowed += f", numbers up to {LARGEST_NUMBER:g}"
        reason = f"wrong argument of {function.__qualname__}()"
        text = " ".join(str(value).split())
        return ProblemError(reason, key=name, value=text, allowed=allowed)
    return None


def _description(hint: Any) -> str:
    """Describe an annotated type for a message, such as "str or Path"."""
    value_type = get_origin(hint) or hint
    arguments = get_args(hint)
    if value_type in (Union, types.UnionType):
        return " or ".join(map(_description, arguments))
    if value_type is Literal:
        return " or ".join(map(repr, arguments))
    if value_type in (_ArrayLike, np.ndarray):
        return ARRAY
    if hint is type(None):
        return "None"
    name = getattr(value_type, "__name__", str(hint))
    if value_type in (Sequence, Mapping):
        return f"{name}[{', '.join(map(_description, arguments))}]"
    return name


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
    if value_type in (Union, types.UnionType):
        is_accepted = any(_matches(member, value) for member in arguments)
        # An empty text would name the current folder.
        return is_accepted and not (Path in arguments and isinstance(value, str) and not value)
    if value_type is Literal:
        return isinstance(value, (str, int)) and value in arguments
    if value_type is _ArrayLike:
        return _is_numeric(value)
    if value_type in (float, int):
        is_number = isinstance(value, Real if value_type is float else Integral)
        return is_number and type(value) is not bool and abs(value) <= LARGEST_NUMBER
    if value_type is Any or not isinstance(value_type, type):  # the latter is a type variable
        return True
    if value_type is np.ndarray:
        return _is_finite_array(value, get_args(arguments[1])[0])
    return isinstance(value, value_type) and _items_match(value_type, arguments, value)


def _items_match(value_type: type, arguments: Sequence[Any], value: Any) -> bool:
    """Return True if the items of a sequence or the values of a mapping have their types.

    Parameters
    ----------
    value_type : type
        Type of the value itself.
    arguments : sequence
        Arguments of the annotation. Empty if it does not describe items.
    value : object
        Value of this type.
    """
    if value_type is Sequence:  # a text is not a sequence here
        is_text = isinstance(value, (str, bytes))
        return not is_text and all(_matches(arguments[0], item) for item in value)
    if value_type is Mapping:
        return all(_matches(arguments[1], item) for item in value.values())
    if value_type is tuple and Ellipsis in arguments:
        return all(_matches(arguments[0], item) for item in value)
    return True


def _is_finite_array(value: Any, number_type: type) -> bool:
    """Return True for an array that is not empty, and whose items are finite numbers of a type.

    Integers are accepted as floats, and a single number as an array of floats.
    """
    if isinstance(value, Real) and number_type is np.float64:
        value = np.asarray(value)
    if not isinstance(value, np.ndarray) or not value.size:
        return False
    is_of_type = np.can_cast(value.dtype, number_type, "same_kind")
    return is_of_type and bool(np.isfinite(value).all())


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
    try:
        array = np.asarray(value)
    except ValueError:
        return False
    if array.dtype.kind not in "fiu":
        return False
    finite = array[np.isfinite(array)]  # NaN and infinity have messages of their own
    return bool((np.abs(finite) <= LARGEST_NUMBER).all())
