"""An example of an external package adds a kind of drive, in which a pinion on the motor moves a
rack.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from ssm_planner.problem.transmissions import Transmission
from ssm_planner.problem.value import Positive
from ssm_planner.typing import record


@record
class Rack(Transmission):
    """Rack that a pinion on the motor moves."""

    name = "rack"
    slides = True
    pinion_diameter: Annotated[Positive, "length"]
    """Pitch diameter of the pinion."""

    @classmethod
    def motor_ratio(cls, dimensions: Mapping[str, float]) -> float:
        """Return the motor angle per travel of the rack, rad/m."""
        return 2 / dimensions["pinion_diameter"]
