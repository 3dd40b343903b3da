"""A short text for values that hold long arrays or many other values."""

from __future__ import annotations

import dataclasses
import reprlib
from typing import Any

import numpy as np

LONGEST = 400
LONGEST_FIELD = 60
"""Number of characters of the longest text, and of the longest text of a field."""


class ShortRepr:
    """Base of dataclasses whose repr names the fields and abbreviates their values.

    Arrays are shown by their shape, and long fields by their type.
    """

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        # a dataclass keeps a method that its class body defines, but replaces an inherited one
        cls.__repr__ = ShortRepr.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        cls: Any = type(self)
        fields_text = [
            f"{field.name}={_abbreviated(getattr(self, field.name))}"
            for field in dataclasses.fields(cls)
        ]
        text = f"{cls.__name__}({', '.join(fields_text)})"
        return text if len(text) <= LONGEST else text[: LONGEST - 2] + "…)"


def _abbreviated(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"<array {value.shape}>" if value.size > 4 else repr(value.tolist())
    text = repr(value) if dataclasses.is_dataclass(value) else reprlib.repr(value)
    return text if len(text) <= LONGEST_FIELD else f"<{type(value).__name__}>"
