"""Planning, verification and export for serial spherical mechanisms with self-locking drives.

`__all__` lists the public names. Each is loaded on first use, so the package imports quickly.
"""

from typing import Any

import lazy_loader

_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    """Return a public name or the version of the package."""
    if name == "__version__":
        from importlib.metadata import version

        return version("ssm-planner")
    return _load(name)
