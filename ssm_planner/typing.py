"""Define types that many modules share, and the decorators of immutable classes."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from typing_extensions import dataclass_transform

from ssm_planner.arguments import check_methods
from ssm_planner.representation import short_repr

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]
Expression = Any
"""A float, an array or a CasADi expression."""
Arrays = dict[str, Array]
"""Arrays by name."""
Range = tuple[float, float]
JsonObject = dict[str, Any]
"""Object of a JSON or YAML file, with values of JSON types by key."""
Files = dict[str, Path]
"""Paths of written files by name."""
Keywords = dict[str, Any]
"""Arguments of a function by name."""
Fields = Mapping[str, Any]
"""Values of any type by name."""
Numbers = Mapping[str, float]
"""Numbers by name."""
C = TypeVar("C")


def _immutable(cls: type[C], **options: bool) -> type[C]:
    """Make a class an immutable dataclass with short texts, whose methods check their arguments.

    Parameters
    ----------
    cls : type
        Class with annotated fields.
    **options : bool
        Further arguments of `dataclasses.dataclass`.
    """
    cls.__repr__ = short_repr  # type: ignore[method-assign]
    return dataclass(frozen=True, repr=False, **options)(check_methods(cls))


@dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(field,))
def record(cls: type[C]) -> type[C]:
    """Make a class an immutable dataclass that does not define its own equality.

    A comparison field by field is not possible for arrays. A record has the equality of its base
    class, which is that of `Value` or identity.
    """
    return _immutable(cls, eq=False)


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def frozen(cls: type[C]) -> type[C]:
    """Make a class an immutable dataclass that compares and hashes field by field."""
    return _immutable(cls)


@dataclass_transform(
    frozen_default=True, eq_default=False, kw_only_default=True, field_specifiers=(field,)
)
def keyword_record(cls: type[C]) -> type[C]:
    """Make a class a record whose constructor accepts keyword arguments only."""
    return _immutable(cls, eq=False, kw_only=True)
