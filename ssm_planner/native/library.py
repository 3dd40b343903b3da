"""Load the compiled part of the package.

Every function in it has an equivalent in Python or is optional.
"""

from __future__ import annotations

import ctypes
import os
from functools import cache

from ssm_planner.native import compiling


def load() -> ctypes.CDLL | None:
    """Return the library for this processor.

    Return None if no library matches the sources, or if SSM_PLANNER_NATIVE=0 disables the library.
    """
    return None if os.environ.get("SSM_PLANNER_NATIVE") == "0" else _loaded()


def has_avx2() -> bool:
    """Return True if the library is in use and the processor has AVX2."""
    library = load()
    return library is not None and bool(library.ssm_has_avx2())


@cache
def _loaded() -> ctypes.CDLL | None:
    portable = _open("portable")
    if portable is None or not portable.ssm_has_avx2():
        return portable
    return _open("avx2") or portable


def _open(variant: str) -> ctypes.CDLL | None:
    """Return a library, or None unless it was compiled from the current sources.

    Other libraries may contain outdated equations.
    """
    try:
        library = ctypes.CDLL(str(compiling.path_of(variant)))
        library.ssm_key.restype = ctypes.c_char_p
        return library if library.ssm_key() == compiling.key().encode() else None
    except (OSError, AttributeError):
        return None
