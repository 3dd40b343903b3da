"""Motorisation runs as frozen values: single joints moved back and forth."""

from __future__ import annotations

from dataclasses import dataclass

from ssm_planner.problem.robot import Robot


@dataclass(frozen=True)
class Stroke:
    """One joint back and forth over centre ± reach; rad or m, and their rates."""

    joint: str
    centre: float
    reach: float
    velocity: float
    acceleration: float
    home: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    """Where the other joints are held."""


@dataclass(frozen=True, eq=False)
class Motorisation:
    """Strokes of a robot's joints, each a run of its own; no joint twice. The joints' limits do not apply."""

    name: str
    robot: Robot
    strokes: tuple[Stroke, ...]
    file: str | None = None
