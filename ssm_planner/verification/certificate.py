"""The certificate of a motion and its seal.

A certificate contains the worst value of every limit with its margin, joint and time
(`LimitCheck`), and the limits that could not be judged (`Unjudged`). The seal is the SHA-256 hash
of the checked motion, the robot, the limits and the result. It detects a later change of any of
them. The module `check` creates certificates.
"""

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
    PATH_REQUIREMENTS,
    Follow,
    Limit,
    Robot,
    Straight,
    TaskLimits,
    robot_text,
    to_plain,
)
from ssm_planner.representation import data_frame, html_table
from ssm_planner.trajectory import PIECES_PER_BLOCK, Trajectory, blocks
from ssm_planner.typing import JsonObject, frozen

ROUNDING_TOLERANCE = 1e-6
"""Relative excess of a limit that counts as rounding."""
KEPT = "kept"
VIOLATED = "violated"
NOT_JUDGED = "not judged"
"""Verdicts on a limit and on a whole motion."""


@frozen
class LimitCheck:
    """The result of checking one limit over a whole motion, in SI units.

    The margin is (limit − worst)/limit. For a range, it is the distance to the nearer end divided
    by half the width. A negative margin means that the limit is violated.

    Attributes
    ----------
    name : str
        Name of the limit, such as "velocity" or "motor torque".
    joint : str or None
        Name of the joint. None for a limit of the tool or of the task.
    worst : float
        Value that is closest to the limit or exceeds it the most.
    limit : float
        The limit. For a range, the end that is nearer to the worst value.
    margin : float
        Margin as defined above, without unit.
    time : float
        Time of the worst value, s.
    unit : str
        Unit of `worst` and `limit`.

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
    """Circumstances of the worst value.

    For a motor torque within a range of friction or payload, they are the friction and the payload
    of the worst case. For a requirement on the path of the tip, they are the name of the phase.
    For the stop travel, they are the reason why no stop is valid.
    """

    @classmethod
    def from_extreme(
        cls, limit: Limit, worst: float, time: float, case: str | None = None
    ) -> "LimitCheck":
        """Build the result of a limit that has only an upper bound.

        Parameters
        ----------
        limit : Limit
            The limit.
        worst : float
            Largest magnitude, in the unit of the limit.
        time : float
            Time of the largest magnitude, s.
        case : str, optional
            The attribute `case`.

        Returns
        -------
        LimitCheck
            The result with the margin (bound − worst)/bound.
        """
        bound = limit.high
        return cls(
            limit.name,
            limit.joint,
            worst=worst,
            limit=bound,
            margin=(bound - worst) / bound,
            time=time,
            unit=limit.unit,
            case=case,
        )

    @property
    def passed(self) -> bool:
        """True if the limit is kept.

        A relative excess up to `ROUNDING_TOLERANCE` counts as rounding.
        """
        return self.margin >= -ROUNDING_TOLERANCE

    @property
    def excess(self) -> str:
        """Description of a violated limit with its excess in percent and its time.

        Error messages append it to "exceeds".
        """
        return (
            f"the {self.name} limit of {self.joint or 'the tool'} by {-100 * self.margin:.3g} % at "
            f"{self.time:.4f} s"
        )

    def to_dict(self) -> JsonObject:
        """Return the result as a dict of its attributes, in SI units.

        The command `check --json` prints this dict as an entry of `limits`.
        """
        return dict(vars(self))

    @classmethod
    def from_dict(cls, data: JsonObject) -> "LimitCheck":
        """Build a result from a dict, as a plan.json contains it.

        Parameters
        ----------
        data : dict
            Entry of `limits` in a plan.json. The key "case" is optional.

        Returns
        -------
        LimitCheck
            The result, equal to the one that was stored.

        Raises
        ------
        TrajectoryError
            If a key is missing or if a value has the wrong type.
        """
        try:
            numbers = {key: float(data[key]) for key in ("worst", "limit", "margin", "time")}
            joint = _optional_text(data["joint"])
            case = _optional_text(data.get("case"))
            return cls(str(data["name"]), joint, **numbers, unit=str(data["unit"]), case=case)
        except (KeyError, OverflowError, TypeError, ValueError) as error:
            raise TrajectoryError(f"not a line of a certificate: {error!r}") from error

    of = Renamed("from_extreme")


@frozen
class Unjudged:
    """A limit that the check could not judge.

    The motion may violate it, so a certificate with such an entry does not pass.

    Attributes
    ----------
    name : str
        Name of the limit.
    joint : str or None
        Name of the joint. None for a limit of the tool or of the task.
    reason : str
        Reason why the limit could not be judged.

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
class Certificate:
    """The result of checking one trajectory.

    Attributes
    ----------
    limits : tuple of LimitCheck
        The results.
    interpolation : str
        Description of the motion between the points of the trajectory.
    instants : int
        Number of sampled instants.
    unchecked : tuple of str
        Quantities that this motion does not limit, and limits that the caller allowed to remain
        unjudged, with reasons.

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
    """Seal of the check (see `with_seal`). None if the caller requested no seal."""
    unjudged: tuple[Unjudged, ...] = ()
    """Limits that could not be judged, with reasons.

    A limit may have an entry here and in `limits`. The entry in `limits` then covers the part of
    the motion that could be judged.
    """

    def __getitem__(self, key: tuple[str, str]) -> LimitCheck:
        """Return the result of one limit.

        Parameters
        ----------
        key : (str, str)
            Name of the limit and name of the joint, such as ("velocity", "tilt").

        Returns
        -------
        LimitCheck
            The first result with this name and joint.

        Raises
        ------
        KeyError
            If the certificate does not contain the limit.
        """
        for limit in self.limits:
            if (limit.name, limit.joint) == key:
                return limit
        raise KeyError(key)

    def with_more(self, checks: tuple[LimitCheck, ...]) -> "Certificate":
        """Return a copy of the certificate with further results.

        A new result replaces the earlier result for the same limit and joint, unless the limit was
        violated in the earlier result. A violation is never removed. A limit with a new result
        counts as judged.

        Parameters
        ----------
        checks : tuple of LimitCheck
            The further results.

        Returns
        -------
        Certificate
            The copy. The seal of this certificate does not apply to it.
        """
        judged_limits = {(limit.name, limit.joint) for limit in checks}
        retained = tuple(
            limit
            for limit in self.limits
            if not limit.passed or (limit.name, limit.joint) not in judged_limits
        )
        unjudged = tuple(
            item for item in self.unjudged if (item.name, item.joint) not in judged_limits
        )
        return replace(self, limits=retained + checks, unjudged=unjudged)

    def allowing(self, *names: str) -> "Certificate":
        """Return the certificate in which limits with these names may remain unjudged.

        Such limits move from `unjudged` to `unchecked`, so they do not prevent a pass.

        Parameters
        ----------
        *names : str
            Names of limits, such as "motor torque", or their last words. The word "torque" stands
            for all limits whose names end with it.

        Returns
        -------
        Certificate
            The copy. Each moved limit has a remark that it was allowed to remain unjudged.
        """
        endings = tuple(f" {name}" for name in names)
        allowed = [item for item in self.unjudged if f" {item.name}".endswith(endings)]
        remaining = tuple(item for item in self.unjudged if item not in allowed)
        remarks = [
            f"{subject}: {reason} (allowed)" for subject, reason in describe_unjudged(allowed)
        ]
        return replace(self, unjudged=remaining, unchecked=self.unchecked + tuple(remarks))

    @property
    def verdict(self) -> str:
        """One of "kept", "violated" and "not judged".

        The verdict is "violated" if any limit is violated. It is "kept" if the certificate contains
        limits, if each of them is kept, and if `unjudged` is empty. Otherwise, it is "not judged".
        """
        if self.violations:
            return VIOLATED
        return NOT_JUDGED if self.unjudged or not self.limits else KEPT

    def verdict_of(self, limit: LimitCheck) -> str:
        """Return the verdict on one limit.

        Parameters
        ----------
        limit : LimitCheck
            An entry of `limits`.

        Returns
        -------
        str
            "kept", "violated" or "not judged". A limit that is kept in the judged part of the
            motion is "not judged" if `unjudged` also contains it.
        """
        if not limit.passed:
            return VIOLATED
        key = (limit.name, limit.joint)
        is_unjudged = any((item.name, item.joint) == key for item in self.unjudged)
        return NOT_JUDGED if is_unjudged else KEPT

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

        Raises SsmPlannerError if pandas is not installed.
        """
        return data_frame([limit.to_dict() for limit in self.limits])

    def _repr_html_(self) -> str:
        """Return the table of all limits for a notebook."""
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
            "unjudged": [dict(vars(item)) for item in self.unjudged],
            "unchecked": list(self.unchecked),
            "sha256": self.sha256,
        }

    @classmethod
    def from_dict(cls, data: JsonObject) -> "Certificate":
        """Build a certificate from a dict, as a plan.json contains it.

        Parameters
        ----------
        data : dict
            The entry `certificate` of a plan.json.

        Returns
        -------
        Certificate
            The certificate. It has no seal if the stored value of `passed` contradicts the limits.

        Raises
        ------
        TrajectoryError
            If a key is missing or if a value has the wrong type.
        """
        try:
            limits = tuple(LimitCheck.from_dict(limit) for limit in data["limits"])
            unchecked = tuple(str(text) for text in data["unchecked"])
            instants = data["instants"]
            if type(instants) is not int:
                raise TypeError(f"instants = {instants!r} is not a whole number")
            unjudged = tuple(
                Unjudged(str(item["name"]), _optional_text(item["joint"]), str(item["reason"]))
                for item in data.get("unjudged", ())
            )
            certificate = cls(
                limits, str(data["interpolation"]), instants, unchecked, unjudged=unjudged
            )
            seal = data.get("sha256")
            # A certificate that contradicts itself loses its seal.
            if seal and data.get("passed") is certificate.passed:
                certificate = replace(certificate, sha256=str(seal))
            return certificate
        except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
            raise TrajectoryError(f"not a certificate: {error!r}") from error


def _optional_text(value: Any) -> str | None:
    """Convert a JSON value to text, and keep null as None.

    Parameters
    ----------
    value : JSON value
        Entry of a plan.json that may be null, such as the joint of a limit.

    Returns
    -------
    str or None
        The text. None for null.
    """
    return None if value is None else str(value)


def worst_result_per_limit(checks: Iterable[LimitCheck]) -> tuple[LimitCheck, ...]:
    """Select the result with the smallest margin for each pair of limit name and joint.

    Several results of one limit occur because worst cases and phases are checked separately.

    Parameters
    ----------
    checks : iterable of LimitCheck
        The results.

    Returns
    -------
    tuple of LimitCheck
        The selected results, in the order in which their pairs first occur in `checks`.
    """
    tightest: dict[tuple[str, str | None], LimitCheck] = {}
    for result in checks:
        key = result.name, result.joint
        if key not in tightest or result.margin < tightest[key].margin:
            tightest[key] = result
    return tuple(tightest.values())


def describe_unjudged(unjudged: Iterable[Unjudged]) -> list[tuple[str, str]]:
    """Describe unjudged limits in words.

    Joints that share a limit and a reason are joined in one description.

    Parameters
    ----------
    unjudged : iterable of Unjudged
        Limits that could not be judged.

    Returns
    -------
    list of (str, str)
        Pairs (limit with its joints, reason), such as ("motor torque of roll, tilt", "…"). Each
        pair of limit name and reason occurs once.
    """
    joints: dict[tuple[str, str], list[str]] = {}
    for item in unjudged:
        owners = joints.setdefault((item.name, item.reason), [])
        if item.joint:
            owners.append(item.joint)
    pairs = []
    for (name, reason), owners in joints.items():
        subject = f"{name} of {', '.join(owners)}" if owners else name
        pairs.append((subject, reason))
    return pairs


def with_seal(
    certificate: Certificate, trajectory: Trajectory, robot: Robot, limits: TaskLimits
) -> Certificate:
    """Return the certificate with a seal.

    The seal is a hash of the certificate and of the input of the check. `seal_error` detects later
    whether any of them has changed. The function also remembers the result and the input in
    `_last_sealed`, so that `seal_error` need not compute the hash again.

    Parameters
    ----------
    certificate : Certificate
        Result of the check.
    trajectory, robot, limits : Trajectory, Robot, TaskLimits
        Input of the check.

    Returns
    -------
    Certificate
        The same certificate with the hash in `sha256`.
    """
    global _last_sealed
    result = replace(certificate, sha256=_seal_hash(certificate, trajectory, robot, limits))
    _last_sealed = tuple(map(ref, (result, trajectory, robot, limits)))
    return result


_last_sealed: tuple[ref[Any], ...] = ()
"""Weak references to the most recently sealed certificate and to the input of its check.

These objects are immutable, so their seal stays valid and is not computed again.
"""


def seal_error(
    certificate: Certificate, trajectory: Trajectory, robot: Robot, limits: TaskLimits
) -> str | None:
    """Return the reason why a certificate does not apply to a motion, or None if it applies.

    A certificate applies if it contains limits and if its seal equals the hash of the certificate,
    the trajectory, the robot and the limits. A plan whose certificate does not apply counts as not
    certified.

    Parameters
    ----------
    certificate : Certificate
        The certificate, such as that of a plan.json.
    trajectory, robot, limits : Trajectory, Robot, TaskLimits
        Motion, robot and limits that the certificate should belong to.

    Returns
    -------
    str or None
        The reason as a sentence without a full stop.
    """
    if not certificate.limits:
        return "its certificate names no limits"
    if certificate.sha256 is None:
        return "its certificate has no seal: an earlier version wrote it, or the seal was removed"
    sealed_for = tuple(reference() for reference in _last_sealed)
    if sealed_for and all(map(is_, sealed_for, (certificate, trajectory, robot, limits))):
        return None
    if certificate.sha256 != _seal_hash(certificate, trajectory, robot, limits):
        return "the trajectory, the robot, a limit or the certificate was changed after the check"
    return None


def _seal_hash(
    certificate: Certificate, trajectory: Trajectory, robot: Robot, limits: TaskLimits
) -> str:
    """Compute the hash of a certificate and of the input of its check.

    Parameters
    ----------
    certificate : Certificate
        Result of the check. Its own seal and the verdicts do not count.
    trajectory : Trajectory
        Checked motion, whose polynomials are hashed as little-endian 64-bit floats.
    robot : Robot
        Robot of the check.
    limits : TaskLimits
        Limits of the task.

    Returns
    -------
    str
        SHA-256 hash in hexadecimal.
    """
    task: JsonObject = dict(to_plain(limits))
    task["start_rate"] = limits.start_rate
    task["end_rate"] = limits.end_rate
    # A motion that is repeated without pause has the same seal as one without this key.
    if limits.duty != 0:
        task["duty"] = limits.duty
    if any(limit.name in PATH_REQUIREMENTS for limit in certificate.limits):
        task["promises"] = [
            _path_keys(entry) for entry in limits.motion if isinstance(entry, (Straight, Follow))
        ]
    content = certificate.to_dict()
    content["sha256"] = None
    # Verdicts follow from the other values, and earlier versions did not write them.
    del content["verdict"]
    content["limits"] = [limit.to_dict() for limit in certificate.limits]
    if not certificate.unjudged:
        del content["unjudged"]
    text = json.dumps({"found": content, "limits": task}, sort_keys=True)
    # The text of the robot is cached, so it replaces the final brace as the last key.
    digest = hashlib.sha256(f'{text[:-1]}, "robot": {robot_text(robot)}}}'.encode())
    digest.update(trajectory.breaks.astype("<f8").tobytes())
    for block in blocks(len(trajectory.breaks) - 1, PIECES_PER_BLOCK):
        digest.update(trajectory.pieces(block).astype("<f8").tobytes())
    return digest.hexdigest()


def _path_keys(entry: Straight | Follow) -> JsonObject:
    """Return the keys of a motion that the seal covers.

    They constrain the path of the tip. The duration of the motion, and the file and line that
    define it, are left out.

    Parameters
    ----------
    entry : Straight or Follow
        Motion of a problem.

    Returns
    -------
    dict
        Keys and values as in the problem file, as JSON types.
    """
    return {
        key: value
        for key, value in to_plain(entry).items()
        if key not in ("duration", "line", "file")
    }
