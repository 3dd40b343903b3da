"""Motorisation runs as frozen values: single joints moved back and forth."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from ssm_planner.problem.robot import JOINTS, Robot
from ssm_planner.problem.value import Positive, Quantity, Value, check_name


@dataclass(frozen=True, eq=False)
class Stroke(Value):
    """One joint back and forth over centre ± reach; rad or m, and their rates."""

    joint: str
    centre: Annotated[float, Quantity("angle", "length")]
    reach: Annotated[Positive, Quantity("angle", "length")]
    velocity: Annotated[Positive, Quantity("angular_velocity", "velocity")]
    acceleration: Annotated[Positive, Quantity("angular_acceleration", "acceleration")]
    home: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    """Where the other joints are held."""

    def _check(self) -> None:
        check_name(self.joint, JOINTS, "Stroke.joint", "not a joint known here")


@dataclass(frozen=True, eq=False)
class Motorisation(Value):
    """Strokes of a robot's joints, each a run of its own; no joint twice. The joints' limits do not apply."""

    name: str
    robot: Robot
    strokes: tuple[Stroke, ...]
    file: str | None = field(default=None, compare=False)

    def _check(self) -> None:
        drives = {joint.name: joint.drive for joint in self.robot.joints}
        for i, stroke in enumerate(self.strokes):
            field = f"strokes[{i}].joint"
            if drives[stroke.joint] is None:
                reason = "this joint has no drive, so there is no motor to size"
                raise self._wrong(field, reason, "a driven joint", stroke.joint)
            if any(other.joint == stroke.joint for other in self.strokes[:i]):
                raise self._wrong(field, "a second run of this joint", "one run per joint", stroke.joint)
