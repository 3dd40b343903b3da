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
    from ssm_planner.loading.load import load_problem, load_robot
    from ssm_planner.pipeline.run import plan

__all__ = ["check", "export", "identify", "load_problem", "load_robot", "plan", "predict", "size"]

_HOMES = {
    "check": "ssm_planner.api",
    "export": "ssm_planner.formats.export",
    "identify": "ssm_planner.identification.identify",
    "load_problem": "ssm_planner.loading.load",
    "load_robot": "ssm_planner.loading.load",
    "plan": "ssm_planner.pipeline.run",
    "predict": "ssm_planner.identification.identify",
    "size": "ssm_planner.api",
}
"""No module of the package may have one of these names: importing it would put the module in the function's place."""


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return list(__all__)
