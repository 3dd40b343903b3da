"""The certificate: for every named limit the worst value found, its margin, joint and time; and its seal.

The seal is SHA-256 over what was checked and what was found, so that a change of either shows.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace
from operator import is_
from typing import Any
from weakref import ref

from ssm_planner.errors import TrajectoryError
from ssm_planner.problem.limits import PROMISES, Limit
from ssm_planner.problem.motion import Follow, Straight
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.problem.serialization import plain, robot_text
from ssm_planner.trajectory import BLOCK, Trajectory

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
    case: str | None = None
    """Friction and payload at which it is worst, where a range of them was looked at; of a promised path its phase."""

    @classmethod
    def of(cls, limit: Limit, worst: float, time: float) -> LimitCheck:
        """A limit on a magnitude, with the largest one found and when."""
        bound = limit.high
        margin = (bound - worst) / bound
        return cls(
            limit.name,
            limit.joint,
            worst=worst,
            limit=bound,
            margin=margin,
            time=time,
            unit=limit.unit,
        )

    @property
    def passed(self) -> bool:
        """The limit is kept, up to rounding."""
        return self.margin >= -TOLERANCE

    def to_dict(self) -> dict[str, Any]:
        """An entry of `limits` in what `check --json` prints; SI."""
        return dict(vars(self))

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> LimitCheck:
        """Read back what `to_dict` wrote. Raises TrajectoryError."""
        try:
            numbers = {key: float(data[key]) for key in ("worst", "limit", "margin", "time")}
            joint = None if data["joint"] is None else str(data["joint"])
            case = None if data.get("case") is None else str(data["case"])
            return cls(str(data["name"]), joint, **numbers, unit=str(data["unit"]), case=case)
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
    """Seal of what was checked and found (`sealed`); None where nobody asked for it."""

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
            seal = (
                str(data["sha256"])
                if data.get("sha256") and data.get("passed") is found.passed
                else None
            )
            return replace(found, sha256=seal)
        except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
            raise TrajectoryError(f"not a certificate: {error!r}") from error


def sealed(
    certificate: Certificate, trajectory: Trajectory, robot: Robot, limits: TaskLimits
) -> Certificate:
    """The certificate with the seal of what it was found for."""
    global _last
    found = replace(certificate, sha256=_digest(certificate, trajectory, robot, limits))
    _last = tuple(map(ref, (found, trajectory, robot, limits)))
    return found


_last: tuple[ref[Any], ...] = ()
"""The certificate that was sealed last, and for what: values never change, so that its seal holds for these objects."""


def broken_seal(
    certificate: Certificate, trajectory: Trajectory, robot: Robot, limits: TaskLimits
) -> str | None:
    """Why a certificate says nothing of this trajectory with this robot and these limits; None where it does."""
    if not certificate.limits:
        return "its certificate names no limits"
    if certificate.sha256 is None:
        return "its certificate has no seal (of an earlier version, or removed): it says nothing of this trajectory"
    sealed_for = tuple(each() for each in _last)
    if sealed_for and all(map(is_, sealed_for, (certificate, trajectory, robot, limits))):
        return None
    if certificate.sha256 != _digest(certificate, trajectory, robot, limits):
        return "the trajectory, the robot, a limit or the certificate was changed after the check"
    return None


def _digest(
    certificate: Certificate, trajectory: Trajectory, robot: Robot, limits: TaskLimits
) -> str:
    rates: dict[str, Any] = {"start_rate": limits.start_rate, "end_rate": limits.end_rate}
    if limits.duty != 0:  # a motion repeated without pause has the seal of one without the key
        rates["duty"] = limits.duty
    if any(each.name in PROMISES for each in certificate.limits):
        rates["promises"] = [
            _promise(entry) for entry in limits.motion if isinstance(entry, (Straight, Follow))
        ]
    found = {**certificate.to_dict(), "sha256": None}
    stated = json.dumps({"found": found, "limits": {**plain(limits), **rates}}, sort_keys=True)
    # one object with its keys in order; the robot's text is known from plan to plan
    digest = hashlib.sha256(f'{stated[:-1]}, "robot": {robot_text(robot)}}}'.encode())
    digest.update(trajectory.breaks.astype("<f8").tobytes())
    for first in range(0, len(trajectory.breaks) - 1, BLOCK):
        digest.update(trajectory.pieces(slice(first, first + BLOCK)).astype("<f8").tobytes())
    return digest.hexdigest()


def _promise(entry: Straight | Follow) -> dict[str, Any]:
    """What a motion says of its way."""
    return {
        key: value for key, value in plain(entry).items() if key not in ("duration", "line", "file")
    }
