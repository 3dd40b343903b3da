"""The sign of the velocity product C(q, q̇) q̇ in the effort that the drives carry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ssm_planner.paper.inertia_sign import largest_change
from ssm_planner.paper.published import DRIVEN
from ssm_planner.sizing.joint_load import JointLoad


@dataclass(frozen=True)
class VelocitySign:
    """Over one motion, by driven joint: N·m or N for effort, N·m for torque."""

    effort: dict[str, float]
    """Largest |C q̇|."""
    gravity: dict[str, float]
    """Largest effort of gravity, for comparison."""
    torque: dict[str, float]
    """Largest change of motor torque where the velocity product is subtracted instead of added."""


def subtracted(load: JointLoad) -> JointLoad:
    """The load with M q̈ − C q̇ + g instead of M q̈ + C q̇ + g."""
    return replace(load, velocity=-load.velocity)


def velocity_sign(loads: Sequence[JointLoad]) -> VelocitySign:
    """What the sign changes over a motion."""
    effort, gravity = dict.fromkeys(DRIVEN, 0.0), dict.fromkeys(DRIVEN, 0.0)
    for load in loads:
        effort[load.joint] = max(effort[load.joint], float(np.abs(load.velocity).max()))
        gravity[load.joint] = max(gravity[load.joint], float(np.abs(load.gravity).max()))
    return VelocitySign(effort, gravity, largest_change(loads, [subtracted(load) for load in loads]))
