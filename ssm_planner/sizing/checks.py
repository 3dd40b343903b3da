"""Checks with margins, three-valued verdicts made of them, and the checks of a gear or screw by its ratings.

A verdict is yes, no, or not known. A gear is held against its speed, load, duty and self-locking, a screw against
whirling and buckling besides.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ssm_planner.dynamics.friction import friction_of
from ssm_planner.dynamics.spread import FrictionSpread
from ssm_planner.dynamics.transmission import self_locking_margin
from ssm_planner.problem.drive import Ratings, ScrewEnds
from ssm_planner.sizing.demand import Band, DemandName
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.motor_limits import Conditions
from ssm_planner.typing import Array
from ssm_planner.units import RPM

TOLERANCE = 1e-9


@dataclass(frozen=True)
class Check:
    """One limit: what is needed against what is allowed; SI.

    margin = (limit − worst)/limit with `worst` taken at the stated confidence; for a lower limit (worst − limit)/limit.
    A check that lacks a figure has no margin; `needs` names the figure, or what would decide an open answer.
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
    best_margin: float | None = None
    """At the favourable end of what is not known; None: nothing is open, it is `margin`."""

    @property
    def passed(self) -> bool | None:
        """None: lacks a figure, or holds at one end of what is not known and fails at the other."""
        if self.margin is None:
            return None
        best = self.margin if self.best_margin is None else self.best_margin
        return True if self.margin >= -TOLERANCE else False if best < -TOLERANCE else None

    def to_dict(self) -> dict[str, Any]:
        """JSON types; SI."""
        return {
            "name": self.name,
            "passed": self.passed,
            "margin": self.margin,
            "best_margin": self.margin if self.best_margin is None else self.best_margin,
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


def below(name: str, worst: float, limit: float, unit: str) -> Check:
    """A check of an upper limit against a figure of the motion alone, which is certain."""
    return Check(
        name, _margin(worst, limit), worst, limit=limit, unit=unit, nominal=worst, probability=1.0
    )


def _margin(worst: float, limit: float) -> float:
    """(limit − worst)/limit; where the limit is 0 nothing is allowed and the margin is −1."""
    return (limit - worst) / limit if limit > 0 else -1.0


@dataclass(frozen=True, eq=False)
class Case:
    """What the checks of one joint are made of."""

    load: JointLoad
    band: Band
    spread: FrictionSpread
    conditions: Conditions

    def below(
        self, name: str, demand: DemandName, limit: float, unit: str, factor: float = 1.0
    ) -> Check:
        """A check of an upper limit against a demand, times a factor, that is uncertain."""
        band, confidence = self.band, self.conditions.confidence
        worst, nominal = factor * band.high(demand, confidence), factor * band.at(demand)
        if math.isinf(limit):
            return Check(name, 1.0, worst=worst, unit=unit, nominal=nominal, probability=1.0)
        drawn = factor * getattr(band.worst, demand)
        made = Check(
            name,
            _margin(worst, limit),
            worst=worst,
            limit=limit,
            unit=unit,
            nominal=nominal,
            probability=float(np.mean(drawn <= limit)) if band.known else None,
            best_margin=_margin(factor * band.low(demand, confidence), limit),
        )
        if made.passed is not None:
            return made
        smooth = drawn if band.smooth is None else factor * getattr(band.smooth, demand)
        return replace(made, needs=self.deciding(smooth, limit))

    def deciding(self, values: Array, limit: float) -> str:
        """Which figure or recordings would decide whether values (draws,), without ripple, exceed a limit."""
        spread, confidence = self.spread, self.conditions.confidence
        needs = list(spread.rotors)
        if spread.ranges:
            needs.append(f"narrower ranges of {', '.join(spread.ranges)}")
        if not spread.names:
            return " and ".join(needs)
        posterior = spread.posterior
        middle = float(np.median(values))
        end = float(np.quantile(values, confidence if middle <= limit else 1 - confidence))
        if (end - limit) * (middle - limit) > 0:
            return " and ".join([*needs, "the ripple under this load: recordings with more of it"])
        share = (limit - middle) / (end - middle)
        speed = f"at motor speeds up to {float(np.abs(self.load.speed()).max()) * RPM:.0f} rpm"
        count = 0 if posterior is None else posterior.recordings
        if count and share**2 * 100 > 1:
            more = math.ceil(count * (1 / share**2 - 1))
            return " and ".join(
                [*needs, f"about {more} more recordings {speed} beside the {count} used"]
            )
        return " and ".join(
            [*needs, f"recordings {speed} that leave {share:.2g} of the spread of now"]
        )


def binding(checks: Iterable[Check]) -> Check | None:
    """Of the failing checks, else of all, the one with the smallest margin; None where none was made."""
    made = [check for check in checks if check.margin is not None]
    return (
        min(made, key=lambda check: (check.passed is not False, check.margin or 0.0))
        if made
        else None
    )


def all_of(answers: Iterable[bool | None]) -> bool | None:
    """False where any is False, else None where any is None, else True."""
    answers = list(answers)
    if any(answer is False for answer in answers):
        return False
    return None if any(answer is None for answer in answers) else True


YOUNG, DENSITY = 193e9, 8000.0
"""Stainless steel, Pa and kg/m³: of the usual screws the one that whirls and buckles first."""
OF_CRITICAL_SPEED = 0.8
"""Share of the critical speed that a screw may turn with."""
OF_BUCKLING_LOAD = 0.5
"""Share of Euler's load that a screw may carry."""
BENDING: dict[ScrewEnds, float] = {
    "fixed-free": 1.8751040687,
    "supported-supported": math.pi,
    "fixed-supported": 3.9266023120,
    "fixed-fixed": 4.7300407449,
}
"""First root βL of the beam's frequency equation."""
COLUMN: dict[ScrewEnds, float] = {
    "fixed-free": 2.0,
    "supported-supported": 1.0,
    "fixed-supported": 0.6991556597,
    "fixed-fixed": 0.5,
}
"""Effective by free length of a column (Euler)."""


def gear_checks(case: Case) -> tuple[Check, ...]:
    """Every check of a joint's gear or screw; those without figures say what they need."""
    load, drive = case.load, case.load.drive
    ratings = drive.ratings or Ratings()
    checks = [_speed(load, ratings), *_output(case, ratings), _duty(load, ratings, case.conditions)]
    if drive.self_locking:
        checks.append(_locking(case))
    if drive.slides and drive.kind != "cable_slide":
        checks += _screw(case, ratings)
    return tuple(checks)


def critical_speed(length: float, diameter: float, ends: ScrewEnds) -> float:
    """First whirling speed of a slender round steel screw, rad/s: (βL)²/L²·√(EI/(ρA)), √(I/A) = d/4; m."""
    return (BENDING[ends] / length) ** 2 * diameter / 4 * math.sqrt(YOUNG / DENSITY)


def buckling_load(length: float, diameter: float, ends: ScrewEnds) -> float:
    """Euler's load of a slender round steel screw, N: π²EI/(KL)²; m."""
    return math.pi**2 * YOUNG * (math.pi * diameter**4 / 64) / (COLUMN[ends] * length) ** 2


def _speed(load: JointLoad, ratings: Ratings) -> Check:
    if ratings.input_speed is None:
        return unchecked("gear_speed", "ratings.input_speed")
    return below("gear_speed", float(np.abs(load.speed()).max()), ratings.input_speed, "rad/s")


def _output(case: Case, ratings: Ratings) -> Iterator[Check]:
    unit = "N" if case.load.drive.slides else "N·m"
    pairs: tuple[tuple[str, DemandName, str], ...] = (
        ("gear_peak_output", "peak_effort", "peak_output"),
        ("gear_continuous_output", "continuous_effort", "continuous_output"),
    )
    for name, demand, key in pairs:
        limit = getattr(ratings, key)
        yield (
            unchecked(name, f"ratings.{key}")
            if limit is None
            else case.below(name, demand, limit, unit)
        )


def _duty(load: JointLoad, ratings: Ratings, conditions: Conditions) -> Check:
    if ratings.duty is None:
        return unchecked("gear_duty", "ratings.duty")
    share = load.moving_share * load.duration / (load.duration + conditions.pause)
    return below("gear_duty", share, ratings.duty, "")


def _locking(case: Case) -> Check:
    """μ against cos θ_n·tan λ at the lowest plausible friction; without knowing that, only the margin at μ is known."""
    drive, spread, confidence = case.load.drive, case.spread, case.conditions.confidence
    friction = friction_of(drive)
    lowest, highest = spread.mu_ends(drive, confidence)
    spare, _ = self_locking_margin(drive, friction.mu)
    needed = friction.mu - float(spare)
    check = Check("self_locking", limit=needed, unit="μ", nominal=friction.mu)
    if friction.mu_lowest is None and "mu" not in spread.ranges and "mu" not in spread.names:
        return replace(check, needs="friction.mu_lowest, or a range or covariance of mu")
    low, high = ((mu - needed) / needed for mu in (lowest, highest))
    check = replace(check, margin=low, best_margin=high, worst=lowest)
    if "mu" in spread.names:
        check = replace(check, probability=float(np.mean(spread.draws("mu") > needed)))
    if check.passed is not None:
        return check
    needs = f"mu, which is known to lie between {lowest:.3g} and {highest:.3g}: a test of holding (friction.mu_lowest)"
    if "mu" in spread.names:
        needs += (
            f", recordings with another payload, or {case.deciding(spread.draws('mu'), needed)}"
        )
    return replace(check, needs=needs)


def _screw(case: Case, ratings: Ratings) -> list[Check]:
    length, diameter, ends = ratings.free_length, ratings.root_diameter, ratings.ends
    if length is None or diameter is None or ends is None:
        needs = [
            f"ratings.{k}"
            for k in ("free_length", "root_diameter", "ends")
            if getattr(ratings, k) is None
        ]
        return [unchecked("critical_speed", *needs), unchecked("buckling", *needs)]
    whirl = OF_CRITICAL_SPEED * critical_speed(length, diameter, ends)
    column = OF_BUCKLING_LOAD * buckling_load(length, diameter, ends)
    return [
        below("critical_speed", float(np.abs(case.load.speed()).max()), whirl, "rad/s"),
        case.below("buckling", "peak_effort", column, "N"),
    ]
