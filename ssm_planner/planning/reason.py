"""Reasons why a problem has not been planned.

A reason is a value that names the constraint, the joint and the place, with the value that the
motion requires and the value that is available.
"""

from __future__ import annotations

from typing import Any

from ssm_planner.problem import Limit
from ssm_planner.representation import ShortRepr
from ssm_planner.typing import frozen


@frozen
class Reason(ShortRepr):
    """The limit that prevents a motion, with the required and the available value in SI units."""

    limit: Limit | None = None
    """None if no single limit is to blame: the solver found no motion."""
    where: str | None = None
    """Place on the motion. None if the reason concerns all of it."""
    required: float | None = None
    available: float | None = None
    message: str = ""
    relaxation: str | None = None

    @property
    def constraint(self) -> str:
        """Name of the limit, or "solver" if no limit is known."""
        return "solver" if self.limit is None else self.limit.name

    @property
    def joint(self) -> str | None:
        """Joint of the limit. None if it concerns the tool or the whole motion."""
        return None if self.limit is None else self.limit.joint

    def to_dict(self) -> dict[str, Any]:
        """Return the object that `plan --json` prints under the key `reason`."""
        return {
            "constraint": self.constraint,
            "joint": self.joint,
            "where": self.where,
            "required": self.required,
            "available": self.available,
            "relaxation": self.relaxation,
            "message": self.message,
        }
