"""Reasons why there is no motion for a problem.

A reason is a value, not an exception. It names the limit, the joint and the place, with the value
that the motion requires and the value that is available. `pipeline/relaxation.py` uses it to decide
which limit to change. The functions of this module create reasons.
"""

from typing import Any

from ssm_planner.planning.tolerances import ROUNDING_TOLERANCE
from ssm_planner.problem import ConstantSpeed, Duration, Limit, format_quantity
from ssm_planner.typing import frozen


@frozen
class Reason:
    """The limit that prevents a motion, with the required and the available value in SI units.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> reason = ssm.Reason(ssm.TipSpeed(25 * ssm.mm), required=0.03, available=0.025)
    >>> reason.constraint
    'tip speed'
    """

    limit: Limit | None = None
    """The limit. None if the solver found no motion, and no single limit is the cause."""
    where: str | None = None
    """Place on the motion in words. None if the reason concerns the whole motion."""
    required: float | None = None
    available: float | None = None
    """Required and available value of the limited quantity, in SI units. None without a limit."""
    message: str = ""
    """The reason as a sentence."""
    relaxation: str | None = None
    """Smallest change of a limit that makes the problem feasible, as a sentence. None if unknown.
    """

    @property
    def constraint(self) -> str:
        """Name of the limit, or "solver" if no limit is known."""
        return "solver" if self.limit is None else self.limit.name

    @property
    def joint(self) -> str | None:
        """Name of the limit's joint. None if the limit concerns the tool or the whole motion."""
        return None if self.limit is None else self.limit.joint

    @property
    def excess(self) -> float:
        """Amount by which the required value differs from the available one. 0 without values."""
        return abs((self.required or 0.0) - (self.available or 0.0))

    def to_dict(self) -> dict[str, Any]:
        """Return the object that `plan --json` prints under the key `reason`."""
        names = "constraint", "joint", "where", "required", "available", "relaxation", "message"
        return {name: getattr(self, name) for name in names}


def check_limit(
    limit: Limit,
    value: float,
    where: str | None,
    template: str,
    tolerance: float = ROUNDING_TOLERANCE,
) -> Reason | None:
    """Return a reason if a value exceeds a limit by more than a tolerance, else None.

    Parameters
    ----------
    limit : Limit
        The limit with a lower and an upper bound, one of which may be infinite.
    value : float
        Value of the limited quantity, in SI units.
    where : str or None
        Place on the motion in words, which is added to the message. None: the whole motion.
    template : str
        Message with the fields {value} and {bound}, which are replaced by the value and the bound
        with their unit.
    tolerance : float
        Excess that is allowed, in SI units.

    Returns
    -------
    Reason or None
        The limit and the place, with the required and the available value.
    """
    if limit.low - tolerance <= value <= limit.high + tolerance:
        return None
    bound = limit.bound(value)
    text = template.format(
        value=format_quantity(value, limit.unit), bound=format_quantity(bound, limit.unit)
    )
    if where is not None:
        text += f" ({where})"
    # A limit with only a lower bound is a clearance. The motion offers the value, and the limit
    # requires the bound.
    required, available = (bound, value) if limit.is_floor else (value, bound)
    return Reason(limit, where, required, available, text)


def short_duration_reason(name: str, requested: float, needed: float) -> Reason:
    """Return the reason for a requested duration that is shorter than the fastest motion.

    Parameters
    ----------
    name : str
        Name of the motion.
    requested, needed : float
        Requested duration, and duration of the fastest motion that the planner found, s.

    Returns
    -------
    Reason
        A reason whose limit is the requested duration.
    """
    text = (
        f"the fastest motion found for {name} takes {needed:.6g} s, "
        f"but the requested duration is {requested:.6g} s"
    )
    return Reason(Duration(requested, name), name, needed, requested, text)


def constant_speed_reason(name: str, requested: float, feasible: float) -> Reason:
    """Return the reason for a constant speed of the tip that other limits do not allow.

    Parameters
    ----------
    name : str
        Name of the motion.
    requested, feasible : float
        Requested speed, and largest speed that the tip can keep, m/s. The latter is 0 if no lower
        speed is feasible either.

    Returns
    -------
    Reason
        A reason whose limit is the constant speed.
    """
    able = (
        f"it can keep up to {1e3 * feasible:.4g} mm/s"
        if feasible
        else "it cannot keep a lower speed either"
    )
    text = (
        f"the tip cannot keep {1e3 * requested:.4g} mm/s between speeding up and slowing down "
        f"({name}); {able}"
    )
    return Reason(ConstantSpeed(feasible or requested), name, requested, feasible, text)


def duration_sum_reason(requested: float, total: float) -> Reason:
    """Return the reason for a total duration that differs from the sum of all durations.

    Parameters
    ----------
    requested : float
        Total duration that the problem requests, s.
    total : float
        Sum of the durations that it requests for its motions, s.

    Returns
    -------
    Reason
        A reason whose limit is the requested total duration.
    """
    text = (
        f"the durations of the motions add up to {total:.6g} s, "
        f"but the requested total duration is {requested:.6g} s"
    )
    return Reason(Duration(requested, exact=True), "the whole motion", total, requested, text)
