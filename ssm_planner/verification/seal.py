"""The seal of a certificate: SHA-256 over what was checked and what was found, so that a change of either shows."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from typing import Any

from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.problem.serialization import plain
from ssm_planner.trajectory import Trajectory
from ssm_planner.verification.certificate import Certificate

BLOCK = 65_536
"""Pieces at a time."""


def sealed(certificate: Certificate, trajectory: Trajectory, robot: Robot, limits: TaskLimits) -> Certificate:
    """The certificate with the seal of what it was found for."""
    return replace(certificate, sha256=_digest(certificate, trajectory, robot, limits))


def broken_seal(certificate: Certificate, trajectory: Trajectory, robot: Robot, limits: TaskLimits) -> str | None:
    """Why a certificate says nothing of this trajectory with this robot and these limits; None where it does."""
    if not certificate.limits:
        return "its certificate names no limits"
    if certificate.sha256 is None:
        return "its certificate has no seal (of an earlier version, or removed): it says nothing of this trajectory"
    if certificate.sha256 != _digest(certificate, trajectory, robot, limits):
        return "the trajectory, the robot, a limit or the certificate was changed after the check"
    return None


def _digest(certificate: Certificate, trajectory: Trajectory, robot: Robot, limits: TaskLimits) -> str:
    rates = {"start_rate": limits.start_rate, "end_rate": limits.end_rate}
    found = {**certificate.to_dict(), "sha256": None}
    stated = {"robot": _without_files(plain(robot)), "limits": {**plain(limits), **rates}, "found": found}
    digest = hashlib.sha256(json.dumps(stated, sort_keys=True).encode())
    digest.update(trajectory.breaks.astype("<f8").tobytes())
    for first in range(0, len(trajectory.breaks) - 1, BLOCK):
        digest.update(trajectory.pieces(slice(first, first + BLOCK)).astype("<f8").tobytes())
    return digest.hexdigest()


def _without_files(data: Any) -> Any:
    """Resolved values, whatever files they came from."""
    if isinstance(data, dict):
        return {key: _without_files(item) for key, item in data.items() if key != "file"}
    return [_without_files(item) for item in data] if isinstance(data, list) else data
