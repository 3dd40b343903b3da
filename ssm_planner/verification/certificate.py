"""The certificate of a motion and its seal.

A certificate contains the worst value of every named limit with its margin, joint and time. The
seal is the SHA-256 of the checked motion and the result, so a change of either is detected.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import replace
from operator import is_
from typing import Any
from weakref import ref

from ssm_planner.deprecation import Renamed
from ssm_planner.errors import TrajectoryError
from ssm_planner.problem import (
    PROMISES,
    Follow,
    Limit,
    Robot,
    Straight,
    TaskLimits,
    plain,
    robot_text,
)
from ssm_planner.representation import ShortRepr, data_frame, html_table
from ssm_planner.trajectory import BLOCK, Trajectory, blocks
from ssm_planner.typing import JsonObject, frozen

TOLERANCE = 1e-6
"""Relative excess of a limit that counts as rounding."""
KEPT, VIOLATED, NOT_JUDGED = "kept", "violated", "not judged"
"""Verdicts on a limit and on a motion."""


@frozen
class LimitCheck(ShortRepr):
    """The result of checking one limit over a whole motion, in SI units.

    The margin is (limit − worst)/limit. For a range it is the distance to the nearer end divided by
    half the width. A negative margin means that the limit is violated.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> limit = ssm.LimitCheck("velocity", "roll", 0.9, 1.0, margin=0.1, time=0.5, unit="rad/s")
    >>> limit.passed
    True
    """

    name: str
    joint: str | None
    worst: float
    limit: float
    margin: float
    time: float
    unit: str
    case: str | None = None
    """Friction and payload of the worst case if a range was checked.

    For a path promise, it names the phase.
    """

    @classmethod
    def from_extreme(cls, limit: Limit, worst: float, time: float) -> LimitCheck:
        """Build the result for a limit on a magnitude from the largest value and its time."""
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
        """True if the limit is kept, up to rounding."""
        return self.margin >= -TOLERANCE

    def to_dict(self) -> JsonObject:
        """Return the entry of `limits` in the output of `check --json`, in SI units."""
        return dict(vars(self))

    @classmethod
    def from_dict(cls, data: JsonObject) -> LimitCheck:
        """Build a result from the output of `to_dict`. Raises TrajectoryError."""
        try:
            numbers = {key: float(data[key]) for key in ("worst", "limit", "margin", "time")}
            joint = None if data["joint"] is None else str(data["joint"])
            case = None if data.get("case") is None else str(data["case"])
            return cls(str(data["name"]), joint, **numbers, unit=str(data["unit"]), case=case)
        except (KeyError, OverflowError, TypeError, ValueError) as error:
            raise TrajectoryError(f"not a line of a certificate: {error!r}") from error

    of = Renamed("from_extreme")


@frozen
class Unjudged(ShortRepr):
    """A limit that the motion may violate, although no violation was found.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.Unjudged("motor torque", "roll", "the joint has no drive").reason
    'the joint has no drive'
    """

    name: str
    joint: str | None
    reason: str


@frozen
class Certificate(ShortRepr):
    """The result of checking one trajectory.

    `unchecked` lists quantities that this motion does not limit, and limits that the caller
    allowed to remain unjudged, with reasons.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> certificate = ssm.load_plan("results/tilt_insert").certificate
    >>> certificate.verdict, certificate["velocity", "tilt"].unit
    ('kept', 'rad/s')
    """

    limits: tuple[LimitCheck, ...]
    interpolation: str
    instants: int
    unchecked: tuple[str, ...] = ()
    sha256: str | None = None
    """Seal of the check (see `sealed`). None if no seal was requested."""
    unjudged: tuple[Unjudged, ...] = ()
    """Limits that count but could not be judged, with reasons.

    A limit may also have an entry in `limits`, which then covers the part that could be judged.
    """

    def __getitem__(self, key: tuple[str, str]) -> LimitCheck:
        """Return the check of a limit by its name and joint, such as ("velocity", "tilt").

        Raises KeyError if the certificate has none.
        """
        for limit in self.limits:
            if (limit.name, limit.joint) == key:
                return limit
        raise KeyError(key)

    def with_more(self, checks: tuple[LimitCheck, ...]) -> Certificate:
        """Return the certificate with further limits, which are judged then.

        They replace results for the same limits unless these are violated.
        """
        judged = {(limit.name, limit.joint) for limit in checks}
        limits = [c for c in self.limits if not c.passed or (c.name, c.joint) not in judged]
        unjudged = tuple(u for u in self.unjudged if (u.name, u.joint) not in judged)
        return replace(self, limits=(*limits, *checks), unjudged=unjudged)

    def allowing(self, *names: str) -> Certificate:
        """Return the certificate in which limits with these names may remain unjudged.

        A last word such as "torque" stands for all names that end with it.
        """
        allowed = [u for u in self.unjudged if any(f" {u.name}".endswith(f" {n}") for n in names)]
        return replace(
            self,
            unjudged=tuple(u for u in self.unjudged if u not in allowed),
            unchecked=(
                *self.unchecked,
                *(f"{subject}: {reason} (allowed)" for subject, reason in subjects(allowed)),
            ),
        )

    @property
    def verdict(self) -> str:
        """One of "kept", "violated" and "not judged".

        It is "violated" if a limit is violated, and "kept" if there are limits and each of them
        was judged and is kept.
        """
        unjudged = self.unjudged or not self.limits
        return VIOLATED if self.violations else NOT_JUDGED if unjudged else KEPT

    def verdict_of(self, limit: LimitCheck) -> str:
        """Return the verdict on one limit."""
        unjudged = [u for u in self.unjudged if (u.name, u.joint) == (limit.name, limit.joint)]
        return VIOLATED if not limit.passed else NOT_JUDGED if unjudged else KEPT

    @property
    def passed(self) -> bool:
        """True if the verdict is "kept"."""
        return self.verdict == KEPT

    @property
    def worst(self) -> LimitCheck:
        """The limit with the smallest margin."""
        return min(self.limits, key=lambda limit: limit.margin)

    def to_dataframe(self) -> Any:
        """Return a pandas DataFrame with a row for each limit, in SI units.

        Raises SsmPlannerError without pandas.
        """
        return data_frame([limit.to_dict() for limit in self.limits])

    def _repr_html_(self) -> str:
        return html_table([limit.to_dict() for limit in self.limits])

    @property
    def violations(self) -> tuple[LimitCheck, ...]:
        """The limits that are violated."""
        return tuple(limit for limit in self.limits if not limit.passed)

    def to_dict(self) -> JsonObject:
        """Return the certificate as plan.json stores it, in SI units."""
        return {
            "passed": self.passed,
            "verdict": self.verdict,
            "interpolation": self.interpolation,
            "instants": self.instants,
            "limits": [
                {**limit.to_dict(), "verdict": self.verdict_of(limit)} for limit in self.limits
            ],
            "unjudged": [dict(vars(u)) for u in self.unjudged],
            "unchecked": list(self.unchecked),
            "sha256": self.sha256,
        }

    @classmethod
    def from_dict(cls, data: JsonObject) -> Certificate:
        """Build a certificate from the output of `to_dict`. Raises TrajectoryError."""
        try:
            limits = tuple(LimitCheck.from_dict(limit) for limit in data["limits"])
            unchecked = tuple(str(text) for text in data["unchecked"])
            instants = data["instants"]
            if type(instants) is not int:
                raise TypeError(f"instants = {instants!r} is no whole number")
            unjudged = tuple(
                Unjudged(str(u["name"]), u["joint"] and str(u["joint"]), str(u["reason"]))
                for u in data.get("unjudged", ())
            )
            certificate = cls(
                limits, str(data["interpolation"]), instants, unchecked, unjudged=unjudged
            )
            # one that contradicts itself has no seal
            seal = (
                str(data["sha256"])
                if data.get("sha256") and data.get("passed") is certificate.passed
                else None
            )
            return replace(certificate, sha256=seal)
        except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
            raise TrajectoryError(f"not a certificate: {error!r}") from error


def worst_of_each(checks: Iterable[LimitCheck]) -> tuple[LimitCheck, ...]:
    """Return one result for each limit and joint: the worst of all cases."""
    tightest: dict[tuple[str, str | None], LimitCheck] = {}
    for check_ in checks:
        key = check_.name, check_.joint
        if key not in tightest or check_.margin < tightest[key].margin:
            tightest[key] = check_
    return tuple(tightest.values())


def subjects(unjudged: Iterable[Unjudged]) -> list[tuple[str, str]]:
    """Return pairs (limit with its joints, reason) in words, one for each name and reason."""
    joints: dict[tuple[str, str], list[str]] = {}
    for u in unjudged:
        joints.setdefault((u.name, u.reason), []).extend([u.joint] if u.joint else [])
    return [
        (f"{name} of {', '.join(of)}" if of else name, reason)
        for (name, reason), of in joints.items()
    ]


def sealed(
    certificate: Certificate, trajectory: Trajectory, robot: Robot, limits: TaskLimits
) -> Certificate:
    """Return the certificate with its seal for this trajectory, robot and limits."""
    global _recent_seal
    result = replace(certificate, sha256=_digest(certificate, trajectory, robot, limits))
    _recent_seal = tuple(map(ref, (result, trajectory, robot, limits)))
    return result


_recent_seal: tuple[ref[Any], ...] = ()
"""The most recently sealed certificate and its inputs.

They are immutable, so the seal stays valid.
"""


def broken_seal(
    certificate: Certificate, trajectory: Trajectory, robot: Robot, limits: TaskLimits
) -> str | None:
    """Return why a certificate does not apply to its input, or None if it does."""
    if not certificate.limits:
        return "its certificate names no limits"
    if certificate.sha256 is None:
        return (
            "its certificate has no seal (of an earlier version, or removed): it says nothing "
            "of this trajectory"
        )
    sealed_for = tuple(reference() for reference in _recent_seal)
    if sealed_for and all(map(is_, sealed_for, (certificate, trajectory, robot, limits))):
        return None
    if certificate.sha256 != _digest(certificate, trajectory, robot, limits):
        return "the trajectory, the robot, a limit or the certificate was changed after the check"
    return None


def _digest(
    certificate: Certificate, trajectory: Trajectory, robot: Robot, limits: TaskLimits
) -> str:
    rates: JsonObject = {"start_rate": limits.start_rate, "end_rate": limits.end_rate}
    if limits.duty != 0:  # a motion repeated without pause has the seal of one without the key
        rates["duty"] = limits.duty
    if any(limit.name in PROMISES for limit in certificate.limits):
        rates["promises"] = [
            _promise(entry) for entry in limits.motion if isinstance(entry, (Straight, Follow))
        ]
    content = {**certificate.to_dict(), "sha256": None}
    # verdicts follow from the rest; earlier versions wrote none
    del content["verdict"]
    content["limits"] = [limit.to_dict() for limit in certificate.limits]
    if not certificate.unjudged:
        del content["unjudged"]
    text = json.dumps({"found": content, "limits": {**plain(limits), **rates}}, sort_keys=True)
    # one object with its keys in order; the robot's text is known from plan to plan
    digest = hashlib.sha256(f'{text[:-1]}, "robot": {robot_text(robot)}}}'.encode())
    digest.update(trajectory.breaks.astype("<f8").tobytes())
    for block in blocks(len(trajectory.breaks) - 1, BLOCK):
        digest.update(trajectory.pieces(block).astype("<f8").tobytes())
    return digest.hexdigest()


def _promise(entry: Straight | Follow) -> JsonObject:
    """Return what a motion promises about the path of the tip."""
    return {
        key: value for key, value in plain(entry).items() if key not in ("duration", "line", "file")
    }
