"""plan.json: the whole plan in one self-contained, versioned file."""

from __future__ import annotations

import dataclasses
import json
import platform
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from ssm_planner.export.atomic import replacing
from ssm_planner.plan import Plan

VERSION = 1
UNITS = {
    "time": "s",
    "q": ["rad", "rad", "rad", "m"],
    "coefficients": "q(t) = sum_k coefficients[piece][k][joint] * (t - breaks_s[piece])^k, in rad/s^k and m/s^k",
    "torque": "N*m on the motor side",
    "motor speed": "rad/s",
    "everything else": "SI, radians",
}


def plan_document(plan: Plan) -> dict[str, Any]:
    """What plan.json holds; every value SI, angles in radians."""
    trajectory = plan.trajectory
    return {
        "format": "ssm_planner plan",
        "version": VERSION,
        "units": UNITS,
        "software": software(),
        **plan.summary(),
        "problem": plain(plan.problem),
        "phases": [
            {
                "name": leg.leg.motion.name,
                "duration": leg.duration,
                "toppra_duration": leg.toppra_duration,
                "lower_bound": leg.lower_bound,
                "task_start": leg.leg.start.tolist(),
                "task_end": leg.leg.end.tolist(),
                "branch": None if leg.leg.path is None else leg.leg.path.branch,
                "iterations": None if leg.phase is None else leg.phase.ocp.iterations,
            }
            for leg in plan.legs
        ],
        "certificate": None if plan.certificate is None else plan.certificate.to_dict(),
        "trajectory": None if trajectory is None else trajectory.to_dict(),
    }


def write_plan(path: Path, plan: Plan) -> Path:
    """Write plan.json. Raises ExportError."""
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(plan_document(plan), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return path


def software() -> dict[str, str]:
    """Versions of what made the plan."""
    names = ("ssm-planner", "casadi", "numpy", "scipy", "toppra")
    versions = {"python": platform.python_version()}
    for name in names:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "unknown"
    return versions


def plain(value: Any) -> Any:
    """Dataclasses, arrays and mappings as JSON types."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    return value
