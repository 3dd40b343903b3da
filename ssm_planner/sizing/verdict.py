"""Checks with margins, and the three-valued verdicts made of them: yes, no, or not known."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

TOLERANCE = 1e-9


@dataclass(frozen=True)
class Check:
    """One limit: what is needed against what is allowed; SI.

    margin = (limit − worst)/limit with `worst` taken at the stated confidence; for a lower limit (worst − limit)/limit.
    A check that lacks a figure has no margin, and `needs` names the figure.
    """

    name: str
    margin: float | None = None
    worst: float | None = None
    limit: float | None = None
    unit: str = ""
    nominal: float | None = None
    """What is needed at the stated friction."""
    probability: float | None = None
    """That the limit holds; None where nothing is known of the friction's uncertainty."""
    needs: str | None = None

    @property
    def passed(self) -> bool | None:
        """None: not checked."""
        return None if self.margin is None else self.margin >= -TOLERANCE

    def to_dict(self) -> dict[str, Any]:
        return {
            "name": self.name,
            "passed": self.passed,
            "margin": self.margin,
            "worst": self.worst,
            "nominal": self.nominal,
            "limit": self.limit,
            "unit": self.unit,
            "probability": self.probability,
            "needs": self.needs,
        }


def unchecked(name: str, *needs: str) -> Check:
    """A check that cannot be made without the figures named."""
    return Check(name, needs=" and ".join(needs))


def below(
    name: str, worst: float, limit: float, unit: str, nominal: float | None = None, probability: float | None = 1.0
) -> Check:
    """A check of an upper limit; where the limit is 0 nothing is allowed and the margin is −1."""
    margin = (limit - worst) / limit if limit > 0 else -1.0
    return Check(name, margin, worst, limit, unit, worst if nominal is None else nominal, probability)


def above(name: str, worst: float, limit: float, unit: str, nominal: float | None = None) -> Check:
    """A check of a lower limit > 0."""
    return Check(name, (worst - limit) / limit, worst, limit, unit, worst if nominal is None else nominal, 1.0)


def binding(checks: Iterable[Check]) -> Check | None:
    """The check with the smallest margin; None where none was made."""
    made = [check for check in checks if check.margin is not None]
    return min(made, key=lambda check: check.margin or 0.0) if made else None


def all_of(answers: Iterable[bool | None]) -> bool | None:
    """False where any is False, else None where any is None, else True."""
    answers = list(answers)
    if any(answer is False for answer in answers):
        return False
    return None if any(answer is None for answer in answers) else True
