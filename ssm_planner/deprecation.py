"""Keep old public names for one more release, with a warning."""

from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar
from warnings import warn

P = ParamSpec("P")
T = TypeVar("T")


class Renamed:
    """Descriptor for the old name of an attribute that was renamed.

    Access to the old name gives a DeprecationWarning, and returns the attribute with the new name.
    For example, the line `doubt = Renamed("uncertified_reason")` in a class keeps the old name
    `doubt`.

    Parameters
    ----------
    new : str
        New name of the attribute.

    Examples
    --------
    The line `doubt = Renamed("uncertified_reason")` in a class keeps the old name `doubt`.
    """

    def __init__(self, new: str) -> None:
        self.new = new

    def __set_name__(self, owner: type, old: str) -> None:
        self.old = old

    def __get__(self, instance: object, owner: type) -> Any:
        warn(f"{owner.__name__}.{self.old} is now {self.new}", DeprecationWarning, stacklevel=2)
        return getattr(owner if instance is None else instance, self.new)


def renamed_arguments(**names: str) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Return a decorator that also accepts old names of arguments, `old=new`, with a warning."""

    def decorate(function: Callable[P, T]) -> Callable[P, T]:
        """Return the function with the additional names of its arguments."""

        @wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> T:
            """Replace old names of arguments and call the function."""
            for old, new in names.items():
                if old in kwargs:
                    warn(f"{old}= is now {new}=", DeprecationWarning, stacklevel=2)
                    kwargs[new] = kwargs.pop(old)
            return function(*args, **kwargs)

        return call

    return decorate
