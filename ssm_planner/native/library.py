"""Loader of the compiled part of the package, which is written in C.

Every C function has an equivalent in Python or is optional, so the package also works without a
compiler. `.native_build.py`, which the build of the package runs, compiles the sources in this
folder with the flags below. Each library contains the key of its sources, so that `load` recognises
an outdated one.
"""

import ctypes
import hashlib
import os
from functools import cache
from pathlib import Path

FOLDER = Path(__file__).parent
"""Folder of the C sources."""
FLAGS = (
    *("-std=c99", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math"),
    *("-fPIC", "-shared", "-fvisibility=hidden"),
)
"""Compiler flags of all variants.

They exclude optimisations that change rounding, so that all variants give the same bits.
"""
VARIANTS = {"portable": (), "avx2": ("-mavx2",)}
"""Additional compiler flags by the name of the variant.

The variant avx2 runs only on processors with these vector instructions.
"""


def key() -> str:
    """Return a hash of the present C sources and compiler flags, 32 hexadecimal digits."""
    digest = hashlib.sha256("\n".join([*FLAGS, str(VARIANTS)]).encode())
    for path in sorted([*FOLDER.glob("*.c"), *FOLDER.glob("*.h")]):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:32]


def path_of(variant: str) -> Path:
    """Return the path at which the build stores the library of a variant."""
    return FOLDER / "libraries" / f"{variant}.so"


def load() -> ctypes.CDLL | None:
    """Return the library for this processor, or None if the caller must use Python code instead.

    The result is None if no library was compiled from the present sources, or if the environment
    variable SSM_PLANNER_NATIVE is 0.
    """
    return None if os.environ.get("SSM_PLANNER_NATIVE") == "0" else _loaded()


def has_avx2() -> bool:
    """Return True if the package uses its library on a processor with AVX2 instructions."""
    library = load()
    return library is not None and bool(library.ssm_has_avx2())


@cache
def _loaded() -> ctypes.CDLL | None:
    """Open the fastest library that runs on this processor. None if there is no valid library."""
    portable = _open("portable")
    if portable is None or not portable.ssm_has_avx2():
        return portable
    return _open("avx2") or portable


def _open(variant: str) -> ctypes.CDLL | None:
    """Open the library of a variant, or return None unless it matches the present sources.

    A library from other sources may contain outdated equations.
    """
    try:
        library = ctypes.CDLL(str(path_of(variant)))
        library.ssm_key.restype = ctypes.c_char_p
        return library if library.ssm_key() == key().encode() else None
    except (OSError, AttributeError):
        return None
