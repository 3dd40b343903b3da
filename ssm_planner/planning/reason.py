"""Why there is no plan: a value that names constraint, joint, place, what is needed and what there is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ssm_planner.problem.limits import Limit


@dataclass(frozen=True)
class Reason:
    """What stands in the way of a motion; SI units."""

    limit: Limit | None
    """None where no limit is known to: the solver found no motion."""
    where: str | None
    """None where the whole motion is concerned."""
    required: float | None
    available: float | None
    message: str
    relaxation: str | None = None

    @property
    def constraint(self) -> str:
        """Name of the limit; "solver" where none is known."""
        return "solver" if self.limit is None else self.limit.name

    @property
    def joint(self) -> str | None:
        """Joint of the limit; None where it concerns the tool or the whole motion."""
        return None if self.limit is None else self.limit.joint

    def to_dict(self) -> dict[str, Any]:
        """The object under `reason` in what `plan --json` prints."""
        return {
            "constraint": self.constraint,
            "joint": self.joint,
            "where": self.where,
            "required": self.required,
            "available": self.available,
            "relaxation": self.relaxation,
            "message": self.message,
        }
