"""The compiled part of the package; whatever has it in C has it in Python too, or does without."""

from __future__ import annotations

import ctypes
import os
from functools import cache

from ssm_planner.native import compiling


def load() -> ctypes.CDLL | None:
    """The library for this processor; None where there is none, and where SSM_PLANNER_NATIVE=0 asks for none."""
    return None if os.environ.get("SSM_PLANNER_NATIVE") == "0" else _loaded()


@cache
def _loaded() -> ctypes.CDLL | None:
    portable = _open("portable")
    if portable is None or not portable.ssm_has_avx2():
        return portable
    return _open("avx2") or portable


def _open(variant: str) -> ctypes.CDLL | None:
    """A library made from the sources as they are: another would follow laws that were changed since."""
    try:
        library = ctypes.CDLL(str(compiling.path_of(variant)))
        library.ssm_key.restype = ctypes.c_char_p
        return library if library.ssm_key() == compiling.key().encode() else None
    except (OSError, AttributeError):
        return None
