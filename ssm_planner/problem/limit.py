"""What every limit is: a value that bounds one quantity of a motion, and moves, rounds and describes itself."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from ssm_planner.errors import ProblemError
from ssm_planner.problem.value import Value
from ssm_planner.units import shown

if TYPE_CHECKING:
    from typing_extensions import Self

TIGHTENING = 1.5
"""Tightening per excess found."""
DIGITS = 6
"""Of a value in words."""
ROUNDING = 1e-12
"""Share by which a value differs from itself in another unit."""

P = TypeVar("P")
"""A Problem; limits stand below it in this room."""


@dataclass(frozen=True)
class Limit(Value, ABC):
    """One bound on a motion: `low` ≤ value ≤ `high` at every instant; SI units, radians.

    To write a new limit:

    1. Derive a frozen dataclass from `Limit`, or from one of the families `JointLimit` and `SpeedLimit`, whose members
       the planner, the check, plan.json and the page take as they come.
    2. Set `name` (by which results speak of it), `order` and `unit`; give `low` and `high`.
    3. Say in `on` where a problem holds it, and in `relaxed` and `tightened` how its bound moves. `tightened` may never
       allow what the limit forbids; `relaxed(value)` allows `value` and all that the limit allows.
    4. Refuse in `_check` what cannot be: ProblemError naming the field, its value and what is allowed.
    """

    order: ClassVar[int] = 0
    """Highest time derivative of the joints' positions that the value depends on."""

    @property
    @abstractmethod
    def name(self) -> str:
        """By which results speak of this limit; unique together with `joint`."""

    @property
    def joint(self) -> str | None:
        """The joint that is limited, which its limits hold as `of`; None where it is the tool."""
        return getattr(self, "of", None)

    @property
    def unit(self) -> str:
        """SI."""
        return ""

    @property
    def low(self) -> float:
        """Smallest value allowed; infinite where there is none."""
        return -math.inf

    @property
    def high(self) -> float:
        """Largest value allowed; infinite where there is none."""
        return math.inf

    @property
    def key(self) -> tuple[str, str | None]:
        """(name, joint), by which results tell limits apart."""
        return self.name, self.joint

    @property
    def half_width(self) -> float:
        """What margins are relative to: half the range, 1 where only one end is given."""
        width = self.high - self.low
        return width / 2 if math.isfinite(width) and width > 0 else 1.0

    @property
    def is_floor(self) -> bool:
        """It has a lowest value alone: a motion has less than the bound asks for."""
        return math.isinf(self.high) and math.isfinite(self.low)

    def bound(self, value: float) -> float:
        """The end of the range that is nearer to a value outside it, or the one that there is."""
        return self.low if value < self.low or math.isinf(self.high) else self.high

    def allows(self, value: float) -> bool:
        """Whether a value keeps the limit."""
        return self.low <= value <= self.high

    def tightened(self, worst: float, bound: float) -> Self | None:
        """Stricter by somewhat more than what `worst` exceeds `bound`; None where that does not help.

        bound: the end that `worst` was held against, which may be looser than this limit.
        """
        return None

    def relaxed(self, value: float) -> Self | None:
        """Moved so that `value` is allowed; None where no bound of this kind allows it."""
        return None

    def enough(self, needed: float) -> float:
        """A value with which a motion is found that needs at least `needed`."""
        return needed

    def trials(self) -> tuple[float, ...]:
        """Values to try where it is not known which limit stands in the way."""
        return ()

    @property
    def words(self) -> str:
        """Begins the sentence that `described` makes."""
        return f"{self.name} of"

    def rounded(self, value: float) -> float:
        """A value beyond the bound as `described` prints it, rounded so that it allows no less."""
        _, scale = shown("" if self.unit == "μ" else self.unit)
        return outwards(scale * value, scale * self.bound(value)) / scale

    def described(self, value: float) -> str:
        """In words: this limit moved to `value`, and where it stands."""
        return f"{self.words} {in_words(value, self.unit)} instead of {in_words(self.bound(value), self.unit)}"

    def on(self, problem: P) -> P:
        """The problem with this limit in the place of its own. Raises ProblemError where it has no such place."""
        raise ProblemError(f"{self.name} cannot be set")


class Symmetric(Limit):
    """|value| ≤ largest."""

    largest: float

    @property
    def low(self) -> float:
        return -self.largest

    @property
    def high(self) -> float:
        return self.largest

    def bound(self, value: float) -> float:
        return self.largest

    def tightened(self, worst: float, bound: float) -> Self | None:
        # (bound / worst)^TIGHTENING is never 0, however large the excess
        return replaced(self, largest=self.largest * min(abs(bound / worst), 1.0) ** TIGHTENING)

    def relaxed(self, value: float) -> Self | None:
        return replaced(self, largest=max(self.largest, abs(value)))


class Between(Limit):
    """lower ≤ value ≤ upper."""

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

    def relaxed(self, value: float) -> Self | None:
        return replaced(self, lower=min(self.lower, value), upper=max(self.upper, value))


def replaced(value: P, **changes: Any) -> P:
    """dataclasses.replace on a value whose fields are not known here."""
    whole: Any = value
    changed: P = replace(whole, **changes)
    return changed


def outwards(value: float, bound: float) -> float:
    """A value rounded to DIGITS, away from the bound."""
    nearest = float(f"{value:.{DIGITS}g}")
    if not math.isfinite(value) or math.isclose(value, nearest, rel_tol=ROUNDING):
        return nearest
    exact = Decimal(value)
    rounding = ROUND_CEILING if value > bound else ROUND_FLOOR
    return float(
        exact.quantize(Decimal(1).scaleb(exact.adjusted() - DIGITS + 1), rounding=rounding)
    )


def in_words(value: float, unit: str) -> str:
    """A value as people read it, in the unit in which they do."""
    name, scale = shown("" if unit == "μ" else unit)
    return f"{scale * value:.{DIGITS}g} {name}".rstrip()
