"""Provide registries of objects, such as drives and formats, that other packages can extend."""

import logging
from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any, TypeVar

from ssm_planner.errors import ProblemError, suggestion

N = TypeVar("N", bound=Any)


class Registry(Mapping[str, N]):
    """Mapping of objects by name, to which other installed packages can add objects.

    Other packages declare their objects as entry points. The registry loads these when an unknown
    name is requested or when all objects are listed, so that they do not delay the start of the
    program. The objects of other packages are at the end of the registry.

    Parameters
    ----------
    group : str
        Group of the entry points, for example ssm_planner.drives.
    noun : str
        Word for one object in messages.
    *declared : object
        Objects of this package. Each has an attribute `name`.
    """

    def __init__(self, group: str, noun: str, *declared: N) -> None:
        self.group = group
        self.noun = noun
        self._declared = {item.name: item for item in declared}

    def add(self, item: N) -> N:
        """Add an object, and return it.

        Parameters
        ----------
        item : object
            Object with an attribute `name`.

        Raises
        ------
        ValueError
            If another object has this name already.
        """
        if self._declared.setdefault(item.name, item) is not item:
            raise ValueError(f"the {self.noun} {item.name!r} exists already")
        return item

    def find(self, name: object, key: str | None = None) -> N:
        """Return the object with a given name from a file or an argument.

        Parameters
        ----------
        name : object
            Requested name. None means that it is missing.
        key : str, optional
            Key of the name in its file, for the message.

        Returns
        -------
        object
            The object.

        Raises
        ------
        ProblemError
            If the name is unknown or missing. The message contains all known names.
        """
        if not isinstance(name, str) or name not in self:
            reason = f"unknown {self.noun}{suggestion(name, self)}"
            if name is None:
                reason = "missing: this key is required"
            raise ProblemError(reason, key=key, value=name, allowed=", ".join(self))
        return self[name]

    def __getitem__(self, name: str) -> N:
        return (self._declared if name in self._declared else self._objects)[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._objects)

    def __len__(self) -> int:
        return len(self._objects)

    @cached_property
    def _objects(self) -> dict[str, N]:
        """All objects by name, including those of other packages.

        The objects of other packages are loaded at the first access. An object that fails to load
        causes a warning.
        """
        from importlib.metadata import entry_points

        for point in entry_points(group=self.group):
            try:
                self.add(point.load())
            except Exception as error:  # noqa: BLE001 - another package may raise anything
                logging.getLogger("ssm_planner").warning(
                    f"the {self.noun} {point.name!r} of another package is not available: {error}"
                )
        return self._declared
