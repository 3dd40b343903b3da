"""Checks with margins, three-valued verdicts made of them, and the checks of a gear or screw by its ratings.

A verdict is yes, no, or not known. A gear is held against its speed, load, duty and self-locking, a screw against
whirling and buckling besides.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ssm_planner.dynamics.friction import friction_of
from ssm_planner.dynamics.transmission import self_locking_margin
from ssm_planner.problem.drive import Drive, Ratings, ScrewEnds
from ssm_planner.sizing.demand import Band, DemandName, FrictionSpread
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.motor_limits import Conditions

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
        """JSON types; SI."""
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
    return Check(
        name,
        margin,
        worst=worst,
        limit=limit,
        unit=unit,
        nominal=worst if nominal is None else nominal,
        probability=probability,
    )


def above(name: str, worst: float, limit: float, unit: str, nominal: float | None = None) -> Check:
    """A check of a lower limit > 0."""
    return Check(
        name,
        (worst - limit) / limit,
        worst=worst,
        limit=limit,
        unit=unit,
        nominal=worst if nominal is None else nominal,
        probability=1.0,
    )


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


def gear_checks(load: JointLoad, band: Band, spread: FrictionSpread, conditions: Conditions) -> tuple[Check, ...]:
    """Every check of a joint's gear or screw; those without figures say what they need."""
    drive = load.drive
    ratings = drive.ratings or Ratings()
    checks = [_speed(load, ratings), *_output(drive, ratings, band, conditions), _duty(load, ratings, conditions)]
    if drive.self_locking:
        checks.append(_locking(drive, spread, conditions))
    if drive.kind != "worm":
        checks += _screw(load, ratings, band, conditions)
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


def _output(drive: Drive, ratings: Ratings, band: Band, conditions: Conditions) -> Iterator[Check]:
    unit = "N·m" if drive.kind == "worm" else "N"
    pairs: tuple[tuple[str, DemandName, str], ...] = (
        ("gear_peak_output", "peak_effort", "peak_output"),
        ("gear_continuous_output", "continuous_effort", "continuous_output"),
    )
    for name, demand, key in pairs:
        limit = getattr(ratings, key)
        if limit is None:
            yield unchecked(name, f"ratings.{key}")
        else:
            probability = float(np.mean(getattr(band.worst, demand) <= limit)) if band.known else None
            yield below(
                name,
                band.high(demand, conditions.confidence),
                limit=limit,
                unit=unit,
                nominal=band.at(demand),
                probability=probability,
            )


def _duty(load: JointLoad, ratings: Ratings, conditions: Conditions) -> Check:
    if ratings.duty is None:
        return unchecked("gear_duty", "ratings.duty")
    share = load.moving_share * load.duration / (load.duration + conditions.pause)
    return below("gear_duty", share, ratings.duty, "")


def _locking(drive: Drive, spread: FrictionSpread, conditions: Conditions) -> Check:
    """μ against cos θ_n·tan λ at the lowest plausible friction; without knowing that, only the margin at μ is known."""
    friction = friction_of(drive)
    lowest = spread.lowest_mu(drive, conditions.confidence)
    spare, _ = self_locking_margin(drive, lowest)
    needed = lowest - float(spare)
    if friction.mu_lowest is None and "mu" not in spread.ranges and "mu" not in spread.names:
        needs = "friction.mu_lowest, or a range or covariance of mu"
        return Check("self_locking", limit=needed, unit="μ", nominal=friction.mu, needs=needs)
    if "mu" in spread.names:
        highest = spread.likely_mu(drive, conditions.confidence)
        if lowest < needed < highest:
            needs = (
                f"mu, which the data leave between {lowest:.3g} and {highest:.3g}: recordings with another payload, or "
                "friction.mu_lowest from a test of holding"
            )
            return Check("self_locking", limit=needed, unit="μ", nominal=friction.mu, needs=needs)
    return above("self_locking", lowest, needed, "μ", friction.mu)


def _screw(load: JointLoad, ratings: Ratings, band: Band, conditions: Conditions) -> list[Check]:
    length, diameter, ends = ratings.free_length, ratings.root_diameter, ratings.ends
    if length is None or diameter is None or ends is None:
        needs = [f"ratings.{k}" for k in ("free_length", "root_diameter", "ends") if getattr(ratings, k) is None]
        return [unchecked("critical_speed", *needs), unchecked("buckling", *needs)]
    whirl = OF_CRITICAL_SPEED * critical_speed(length, diameter, ends)
    column = OF_BUCKLING_LOAD * buckling_load(length, diameter, ends)
    probability = float(np.mean(band.worst.peak_effort <= column)) if band.known else None
    return [
        below("critical_speed", float(np.abs(load.speed()).max()), whirl, "rad/s"),
        below(
            "buckling",
            band.high("peak_effort", conditions.confidence),
            limit=column,
            unit="N",
            nominal=band.at("peak_effort"),
            probability=probability,
        ),
    ]
