"""The surroundings of a one-joint test rig: what identification needs beyond the drive itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True)
class Rig:
    """Payload of a rig and the meaning of its recorded channels; SI."""

    payload_mass: float
    """kg, moved by the output; 0 without payload."""
    motor_nominal_torque: float
    """N·m; a recorder gives torque in percent of it."""
    payload_arm: float | None = None
    """Radius of the pulley that the payload hangs from, m (worm); None where it hangs on the nut itself (screws)."""
    payload_direction: Literal[-1, 1] = 1
    """+1: gravity pulls the output towards positive motion."""
    gravity: float = 9.81
    """m/s², positive."""
    direction: Literal[-1, 1] = 1
    """The rig's positive motion and torque are direction times the recorded channels."""
    published: Mapping[str, float] = field(default_factory=dict)
    """Parameters that others published for this drive, by name in Friction (and preload), SI: for comparison, and the
    reference nearest to which identification settles what its data leave open (it then says so)."""

    @property
    def F_payload(self) -> float:
        """Part of the output effort F that the payload's weight adds, N·m (worm) or N (screw): positive opposes
        positive motion."""
        return -self.payload_direction * self.payload_mass * self.gravity * (self.payload_arm or 1.0)

    @property
    def payload_inertia(self) -> float:
        """What the payload adds to the drive's output inertia, kg·m² (worm) or kg (screw)."""
        return self.payload_mass * (self.payload_arm or 1.0) ** 2
