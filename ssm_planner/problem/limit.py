"""Base classes of limits.

A limit is a value that bounds one quantity of a motion. It can move its bound, round it and
describe it.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import replace
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from ssm_planner.deprecation import Renamed
from ssm_planner.errors import ProblemError
from ssm_planner.problem.value import Value
from ssm_planner.typing import frozen
from ssm_planner.units import display_unit

if TYPE_CHECKING:
    from typing_extensions import Self

TIGHTENING_FACTOR = 1.5
"""Ratio of the amount by which a bound is tightened to the amount by which it was exceeded."""
MESSAGE_DIGITS = 6
"""Number of significant digits of a value in messages."""
CONVERSION_TOLERANCE = 1e-12
"""Relative error that a value may have after its conversion to another unit."""

P = TypeVar("P")
"""A Problem. Its module imports this one, so the class is not available for annotations."""


@frozen
class Limit(Value, ABC):
    """Bound on one quantity of a motion: `low` ≤ value ≤ `high` at every instant, in SI units.

    To write a new limit:

    1. Derive a frozen dataclass from `Limit`, or from one of the families `JointLimit` and
       `SpeedLimit`. The planner, the check, plan.json and the page treat all members of a family
       alike.
    2. Set `name` (results use it), `order` and `unit`, and define `low` and `high`.
    3. Define `on`, which stores the limit in a problem, and `relaxed` and `tightened`, which move
       its bound. `tightened` must never allow a value that the limit forbids. `relaxed(value)` must
       allow `value` and all values that the limit allows.
    4. Reject invalid fields in `_check` with a ProblemError that states field, value and allowed
       values.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> limit = ssm.TipSpeed(25 * ssm.mm)
    >>> limit.name, limit.unit, limit.contains(0.02)
    ('tip speed', 'm/s', True)
    """

    order: ClassVar[int] = 0
    """Highest time derivative of the joint positions that the value depends on."""

    words: ClassVar[str] = "{limit.name} of"
    """Template for the beginning of the sentence that `described` returns."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Name of the limit in results, unique together with `joint`."""

    @property
    def joint(self) -> str | None:
        """Name of the limited joint (the field `of`), or None for a limit on the tool."""
        return getattr(self, "of", None)

    @property
    def unit(self) -> str:
        """SI unit of the value."""
        return ""

    @property
    def low(self) -> float:
        """Smallest allowed value, −∞ without a lower bound."""
        return -math.inf

    @property
    def high(self) -> float:
        """Largest allowed value, ∞ without an upper bound."""
        return math.inf

    @property
    def key(self) -> tuple[str, str | None]:
        """Pair (name, joint) that identifies the limit in results."""
        return self.name, self.joint

    @property
    def half_width(self) -> float:
        """Divisor of margins: half the width of a range, or 1 for a one-sided limit."""
        width = self.high - self.low
        return width / 2 if math.isfinite(width) and width > 0 else 1.0

    @property
    def is_floor(self) -> bool:
        """True if the limit has a lower bound and no upper bound."""
        return math.isinf(self.high) and math.isfinite(self.low)

    def bound(self, value: float) -> float:
        """Return the bound that a value outside the range violates, or the only bound."""
        return self.low if value < self.low or math.isinf(self.high) else self.high

    def contains(self, value: float) -> bool:
        """Return True if a value in SI units is within the limit."""
        return self.low <= value <= self.high

    def tightened(self, worst: float, bound: float) -> "Self | None":
        """Return a stricter limit for another plan, or None if a stricter limit does not help.

        A plan may slightly violate a limit between the points at which the planner evaluates it.
        The planner then plans again with a limit that is stricter by `TIGHTENING_FACTOR` times the
        excess.

        Parameters
        ----------
        worst : float
            Value in the present plan that violates the limit, in SI units.
        bound : float
            Bound that it violates, which may be looser than this limit.

        Returns
        -------
        Limit or None
            The stricter limit. This base class returns None.
        """
        return None

    def relaxed(self, value: float) -> "Self | None":
        """Return a looser limit that allows a given value.

        The search for the reason of an infeasible problem uses it.

        Parameters
        ----------
        value : float
            Value in SI units.

        Returns
        -------
        Limit or None
            The looser limit, or None if no bound of this kind allows the value. This base class
            returns None.
        """
        return None

    def sufficient_bound(self, needed: float) -> float:
        """Return a bound with which the planner finds a motion.

        Parameters
        ----------
        needed : float
            Value that every motion needs at least, in SI units.

        Returns
        -------
        float
            The bound in SI units. Some limits add a reserve to the value, because a bound without a
            reserve would leave a single feasible motion.
        """
        return needed

    def trials(self) -> tuple[float, ...]:
        """Return looser bounds to try if the cause of infeasibility is unknown."""
        return ()

    def rounded(self, value: float) -> float:
        """Round a value to the digits that `described` prints, away from the bound.

        The printed value then suffices as a bound.

        Parameters
        ----------
        value : float
            Value in SI units.

        Returns
        -------
        float
            Rounded value in SI units.
        """
        _, scale = display_unit("" if self.unit == "μ" else self.unit)
        return round_away(scale * value, scale * self.bound(value)) / scale

    def described(self, value: float) -> str:
        """Return a text that states a sufficient bound and the present bound.

        An example is "velocity limit of joint roll of 60 deg/s instead of 50 deg/s".

        Parameters
        ----------
        value : float
            Bound that would suffice, in SI units.
        """
        return (
            f"{self.words.format(limit=self)} {format_quantity(value, self.unit)} "
            f"instead of {format_quantity(self.bound(value), self.unit)}"
        )

    def on(self, problem: P) -> P:
        """Return a copy of a problem in which this limit replaces the limit with the same key.

        Raises ProblemError if the problem cannot have this limit.
        """
        raise ProblemError(f"{self.name} cannot be set")

    allows = Renamed("contains")
    enough = Renamed("sufficient_bound")


class SymmetricLimit(Limit):
    """Base class of limits on a magnitude: |value| ≤ largest."""

    largest: float

    @property
    def low(self) -> float:
        return -self.largest

    @property
    def high(self) -> float:
        return self.largest

    def bound(self, value: float) -> float:
        return self.largest

    def tightened(self, worst: float, bound: float) -> "Self | None":
        """Return the limit multiplied by (bound / worst)^TIGHTENING_FACTOR.

        The factor is at most 1, and it is never 0, however large the excess is.
        """
        factor = abs(bound) / max(abs(bound), abs(worst))
        return replace_fields(self, largest=self.largest * factor**TIGHTENING_FACTOR)

    def relaxed(self, value: float) -> "Self | None":
        return replace_fields(self, largest=max(self.largest, abs(value)))

    def doubled(self) -> tuple[float, ...]:
        """Return twice the bound as the only result of `trials`."""
        return (2 * self.largest,)


class RangeLimit(Limit):
    """Base class of limits on a range: lower ≤ value ≤ upper."""

    lower: float
    upper: float

    def _check(self) -> None:
        if not self.lower < self.upper:
            raise ProblemError(
                "the lower bound is not below the upper one",
                key=f"{type(self).__name__}.lower",
                value=self.lower,
                allowed=f"below {self.upper:g}",
            )

    @property
    def low(self) -> float:
        return self.lower

    @property
    def high(self) -> float:
        return self.upper

    def relaxed(self, value: float) -> "Self | None":
        return replace_fields(self, lower=min(self.lower, value), upper=max(self.upper, value))


def replace_fields(value: P, **changes: Any) -> P:
    """Return dataclasses.replace(value, **changes), without a static check of the type.

    The module cannot import the type of the value, because the module of that type imports this
    one.
    """
    instance: Any = value
    return replace(instance, **changes)


def round_away(value: float, bound: float, digits: int = MESSAGE_DIGITS) -> float:
    """Round a value to a number of significant digits, away from a bound.

    A rounded value that a message suggests as a new bound must not be stricter than the exact one.
    A value that agrees with its rounded form up to `CONVERSION_TOLERANCE` is not moved away.

    Parameters
    ----------
    value : float
        Value that is rounded.
    bound : float
        Present bound. A larger value is rounded up, and a smaller value is rounded down.
    digits : int
        Number of significant digits.

    Returns
    -------
    float
        The rounded value.
    """
    rounded = float(f"{value:.{digits}g}")
    if not math.isfinite(value) or math.isclose(value, rounded, rel_tol=CONVERSION_TOLERANCE):
        return rounded
    decimal = Decimal(value)
    last_digit = Decimal(1).scaleb(decimal.adjusted() - digits + 1)
    rounding = ROUND_CEILING if value > bound else ROUND_FLOOR
    return float(decimal.quantize(last_digit, rounding=rounding))


def format_quantity(value: float, unit: str) -> str:
    """Format a value in SI units as text with the unit that messages use for it.

    For example, 0.02 with the unit "m" becomes "20 mm".
    """
    name, scale = display_unit("" if unit == "μ" else unit)
    return f"{scale * value:.{MESSAGE_DIGITS}g} {name}".rstrip()
