"""The certificate: for every named limit the worst value found, its margin, joint and time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from ssm_planner.errors import TrajectoryError
from ssm_planner.problem.limits import Limit

TOLERANCE = 1e-6
"""A limit counts as kept while it is exceeded by no more than this share of itself (rounding)."""


@dataclass(frozen=True)
class LimitCheck:
    """One limit over a whole motion; SI units.

    margin = (limit − worst)/limit, for a range the distance to its nearer end by half its width; negative: violated.
    """

    name: str
    joint: str | None
    worst: float
    limit: float
    margin: float
    time: float
    unit: str

    @classmethod
    def of(cls, limit: Limit, worst: float, time: float) -> LimitCheck:
        """A limit on a magnitude, with the largest one found and when."""
        bound = limit.high
        margin = (bound - worst) / bound
        return cls(limit.name, limit.joint, worst=worst, limit=bound, margin=margin, time=time, unit=limit.unit)

    @property
    def passed(self) -> bool:
        """The limit is kept, up to rounding."""
        return self.margin >= -TOLERANCE

    def to_dict(self) -> dict[str, Any]:
        """An entry of `limits` in what `check --json` prints; SI."""
        return {
            "name": self.name,
            "joint": self.joint,
            "worst": self.worst,
            "limit": self.limit,
            "margin": self.margin,
            "time": self.time,
            "unit": self.unit,
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> LimitCheck:
        """Read back what `to_dict` wrote. Raises TrajectoryError."""
        try:
            joint = None if data["joint"] is None else str(data["joint"])
            worst, limit, margin, time = (float(data[key]) for key in ("worst", "limit", "margin", "time"))
            unit = str(data["unit"])
            return cls(str(data["name"]), joint, worst=worst, limit=limit, margin=margin, time=time, unit=unit)
        except (KeyError, OverflowError, TypeError, ValueError) as error:
            raise TrajectoryError(f"not a line of a certificate: {error!r}") from error


@dataclass(frozen=True)
class Certificate:
    """Outcome of a check of one trajectory; `unchecked` names what could not be checked, and why."""

    limits: tuple[LimitCheck, ...]
    interpolation: str
    instants: int
    unchecked: tuple[str, ...] = ()
    sha256: str | None = None
    """Seal of what was checked and found (verification/seal.py); None where nobody asked for it."""

    def with_more(self, checks: tuple[LimitCheck, ...]) -> Certificate:
        """With further limits."""
        return replace(self, limits=(*self.limits, *checks)) if checks else self

    @property
    def passed(self) -> bool:
        """Every limit is kept, and there are some."""
        return bool(self.limits) and all(limit.passed for limit in self.limits)

    @property
    def worst(self) -> LimitCheck:
        """The limit with the smallest margin."""
        return min(self.limits, key=lambda limit: limit.margin)

    @property
    def violations(self) -> tuple[LimitCheck, ...]:
        """The limits that are not kept."""
        return tuple(limit for limit in self.limits if not limit.passed)

    def to_dict(self) -> dict[str, Any]:
        """What plan.json holds; SI."""
        return {
            "passed": self.passed,
            "interpolation": self.interpolation,
            "instants": self.instants,
            "limits": [limit.to_dict() for limit in self.limits],
            "unchecked": list(self.unchecked),
            "sha256": self.sha256,
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Certificate:
        """Read back what `to_dict` wrote. Raises TrajectoryError."""
        try:
            limits = tuple(LimitCheck.from_dict(limit) for limit in data["limits"])
            unchecked = tuple(str(what) for what in data["unchecked"])
            instants = data["instants"]
            if type(instants) is not int:
                raise TypeError(f"instants = {instants!r} is no whole number")
            found = cls(limits, str(data["interpolation"]), instants, unchecked)
            # one that contradicts itself has no seal
            seal = str(data["sha256"]) if data.get("sha256") and data.get("passed") is found.passed else None
            return replace(found, sha256=seal)
        except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
            raise TrajectoryError(f"not a certificate: {error!r}") from error
