"""Loader of the compiled part of the package, which is written in C.

Every C function has an equivalent in Python or is optional, so the package also works without a
compiler. `CMakeLists.txt` in this folder compiles the sources when the package is built. Each
library contains the key of its sources, so that `load` recognises an outdated one.
"""

import ctypes
import hashlib
import os
from functools import cache
from pathlib import Path

FOLDER = Path(__file__).parent
"""Folder of the C sources."""


def key() -> str:
    """Compute a hash of the present C sources and of their build file.

    `CMakeLists.txt` computes the same hash and compiles it into the libraries.

    Returns
    -------
    str
        SHA-256 hash, 64 hexadecimal digits.
    """
    inputs = [*FOLDER.glob("*.c"), *FOLDER.glob("*.h"), FOLDER / "CMakeLists.txt"]
    hashes = [(path.name, hashlib.sha256(path.read_bytes()).hexdigest()) for path in inputs]
    text = "".join(f"{name} {digest}\n" for name, digest in sorted(hashes))
    return hashlib.sha256(text.encode()).hexdigest()


def path_of(variant: str) -> Path:
    """Return the path at which the build stores the library of a variant.

    Parameters
    ----------
    variant : str
        "portable" for any processor, or "avx2" for processors with AVX2 instructions.

    Returns
    -------
    Path
        Path of the library, which need not exist.
    """
    return FOLDER / "libraries" / f"{variant}.so"


def load() -> ctypes.CDLL | None:
    """Return the compiled library for this processor.

    Returns
    -------
    ctypes.CDLL or None
        The library. None if no library was compiled from the present sources, or if the environment
        variable SSM_PLANNER_NATIVE is 0. The caller must then use Python code.
    """
    return None if os.environ.get("SSM_PLANNER_NATIVE") == "0" else _loaded()


def has_avx2() -> bool:
    """Return whether the package uses its library on a processor with AVX2 instructions."""
    library = load()
    return library is not None and bool(library.ssm_has_avx2())


@cache
def _loaded() -> ctypes.CDLL | None:
    """Open the fastest library that runs on this processor. None without a valid library."""
    portable = _open("portable")
    if portable is None or not portable.ssm_has_avx2():
        return portable
    return _open("avx2") or portable


def _open(variant: str) -> ctypes.CDLL | None:
    """Open the library of a variant.

    Parameters
    ----------
    variant : str
        "portable" or "avx2".

    Returns
    -------
    ctypes.CDLL or None
        The library. None if it is missing or was compiled from other sources, because it may then
        contain outdated equations.
    """
    try:
        library = ctypes.CDLL(str(path_of(variant)))
        library.ssm_key.restype = ctypes.c_char_p
        return library if library.ssm_key() == key().encode() else None
    except (OSError, AttributeError):
        return None
