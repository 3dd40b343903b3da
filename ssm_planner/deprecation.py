"""Keep old public names for one more release, with a warning."""

from typing import Any
from warnings import warn


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
