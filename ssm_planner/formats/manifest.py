"""The manifest that every export carries: what was exported, from which plan and robot, and how far it was verified."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from ssm_planner.plans import Plan, software
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.problem.serialization import plain
from ssm_planner.publishing import EXPORT, MANIFEST, hashes
from ssm_planner.verification.certificate import Certificate

VERSION = 1


def write_manifest(
    folder: Path, kind: str, plan: Plan, certificate: Certificate, verified: bool, details: dict[str, Any]
) -> dict[str, Any]:
    """Write manifest.json beside the files it lists; details: what the kind of export has to say."""
    manifest = {
        "format": EXPORT,
        "version": VERSION,
        "kind": kind,
        "verified": verified,
        **(
            {}
            if verified
            else {"warning": "UNVERIFIED: the plan has no passed certificate; do not run it on a machine"}
        ),
        "plan": {"file": plan.path.name, "sha256": plan.sha256, "duration_s": plan.motion.duration},
        "robot": {"name": plan.robot.name, "sha256": robot_hash(plan.robot)},
        "software": software(),
        **declared_rates(plan.limits.slower(details.get("stretch", 1.0))),
        **details,
        "certificate": certificate.to_dict(),
        "files": hashes(folder),
    }
    (folder / MANIFEST).write_text(json.dumps(manifest, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return manifest


def declared_rates(limits: TaskLimits) -> dict[str, dict[str, float]]:
    """Rates of task coordinates that the exported motion has at its ends, 0 where not named; rad/s, m/s."""
    return {"start_rate": dict(limits.start_rate or {}), "end_rate": dict(limits.end_rate or {})}


def robot_hash(robot: Robot) -> str:
    """SHA-256 of a robot's resolved values, whatever files they came from."""

    def values(data: Any) -> Any:
        if isinstance(data, dict):
            return {key: values(item) for key, item in data.items() if key != "file"}
        return [values(item) for item in data] if isinstance(data, list) else data

    return hashlib.sha256(json.dumps(values(plain(robot)), sort_keys=True).encode()).hexdigest()
