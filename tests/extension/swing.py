"""An example of an external package adds a key of the motion list, which stands for motions to and
fro between two tilts.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

from ssm_planner.loading.motions import MotionKey
from ssm_planner.loading.schema import build_class_model, nested_type
from ssm_planner.loading.yaml_nodes import Section
from ssm_planner.problem import Bound, Straight
from ssm_planner.typing import record


@record
class Swing:
    """Value of the key."""

    low: Annotated[float, "angle"]
    """Lower end."""
    high: Annotated[float, "angle"]
    """Upper end."""
    times: Annotated[int, Bound(at_least=1, at_most=100), "number"] = 1
    """Number of motions to and fro."""


def motions(section: Section, swing: Any) -> Iterator[Straight]:
    """Yield the motions. Raises ProblemError if the ends are in the wrong order."""
    if not swing.low < swing.high:
        raise section.error("not above low", "high", allowed="an angle above low")
    for tilt in swing.times * (swing.low, swing.high):
        yield Straight(tilt=tilt, name="swing", line=section.line())


SWING = MotionKey(
    "swing", "Motions to and fro between two tilts.", nested_type(build_class_model(Swing)), motions
)
