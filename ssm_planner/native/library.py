"""Load the compiled part of the package.

Every function in it has an equivalent in Python or is optional. `.native_build.py`, which the build
of the package runs, compiles it. Each library contains the key of its sources.
"""

import ctypes
import hashlib
import os
from functools import cache
from pathlib import Path

FOLDER = Path(__file__).parent
FLAGS = (
    *("-std=c99", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math"),
    *("-fPIC", "-shared", "-fvisibility=hidden"),
)
"""Compiler flags without optimisations that change rounding, so all variants give the same bits."""
VARIANTS = {"portable": (), "avx2": ("-mavx2",)}
"""Additional flags by variant. The variant avx2 runs only on processors with AVX2."""


def key() -> str:
    """Return a key that identifies the current sources and flags."""
    digest = hashlib.sha256("\n".join([*FLAGS, str(VARIANTS)]).encode())
    for path in sorted([*FOLDER.glob("*.c"), *FOLDER.glob("*.h")]):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:32]


def path_of(variant: str) -> Path:
    """Return the path of the library of a variant."""
    return FOLDER / "libraries" / f"{variant}.so"


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
        library = ctypes.CDLL(str(path_of(variant)))
        library.ssm_key.restype = ctypes.c_char_p
        return library if library.ssm_key() == key().encode() else None
    except (OSError, AttributeError):
        return None
