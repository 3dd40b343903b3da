"""Planning, verification and export for serial spherical mechanisms with self-locking drives.

The names in `__all__` are what is public; each is loaded when it is first used, so that importing the package is instant.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ssm_planner.api import check, size
    from ssm_planner.formats.export import export
    from ssm_planner.identification.identify import identify, predict
    from ssm_planner.loading.load import load_drive, load_motor, load_problem, load_robot
    from ssm_planner.pipeline.run import plan
    from ssm_planner.units import deg, mm, mNm, ms, rpm

__all__ = [
    "check",
    "deg",
    "export",
    "identify",
    "load_drive",
    "load_motor",
    "load_problem",
    "load_robot",
    "mNm",
    "mm",
    "ms",
    "plan",
    "predict",
    "rpm",
    "size",
]

_HOMES = {
    "check": "ssm_planner.api",
    "export": "ssm_planner.formats.export",
    "identify": "ssm_planner.identification.identify",
    "load_drive": "ssm_planner.loading.load",
    "load_motor": "ssm_planner.loading.load",
    "load_problem": "ssm_planner.loading.load",
    "load_robot": "ssm_planner.loading.load",
    "plan": "ssm_planner.pipeline.run",
    "predict": "ssm_planner.identification.identify",
    "size": "ssm_planner.api",
    **dict.fromkeys(("deg", "mNm", "mm", "ms", "rpm"), "ssm_planner.units"),
}
"""No module of the package may have one of these names: importing it would put the module in the function's place."""


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return list(__all__)
