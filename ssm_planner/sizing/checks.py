"""Check limits, compute their margins, and combine the answers.

An answer is True, False or None (not known). The module also contains the checks of gears: rated
speed, load, duty and self-locking. Screws are also checked for whirling, that is, the resonance of
a turning screw, and for buckling. `assess` runs the checks of motors, and `drive_checks` those of a
drive.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cached_property

import numpy as np

from ssm_planner.dynamics import (
    FrictionSpread,
    friction_spread,
    required_friction,
    self_locking_margin,
)
from ssm_planner.problem import Drive, Ratings, ScrewEnds
from ssm_planner.problem import unchecked_copy as changed
from ssm_planner.sizing.demand import Band, DemandName, linear_band, monte_carlo
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.motor_limits import Conditions
from ssm_planner.typing import Array, JsonObject, frozen, record
from ssm_planner.units import RPM

MARGIN_TOLERANCE = 1e-9
"""Relative excess of a limit that rounding errors can cause and that counts as kept."""


@frozen
class Check:
    """The comparison of one demand with its limit, in SI units.

    The margin is (limit − worst)/limit, where `worst` is the demand at the required confidence. For
    a lower limit, it is (worst − limit)/limit. A positive margin means that the limit is kept. The
    margin is None if data are missing. In this case, or if the check is undecided, `needs` names
    the data that would decide it.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> ssm.Check("torque", margin=0.2, worst=0.04, limit=0.05, unit="N·m").passed
    True
    """

    name: str
    """Name of the check."""
    margin: float | None = None
    worst: float | None = None
    limit: float | None = None
    unit: str = ""
    nominal: float | None = None
    """Demand at the stated friction."""
    probability: float | None = None
    """Probability that the limit is kept. None if the uncertainty of the friction is unknown."""
    needs: str | None = None
    """Data that would decide the check, or None if it is decided."""
    best_margin: float | None = None
    """Margin at the favourable end of the uncertain data. None if `margin` is certain."""

    @property
    def passed(self) -> bool | None:
        """True if the limit is kept, False if it is exceeded, None if the check is open.

        A check is open if data are missing or if the two ends of uncertain data give opposite
        answers.
        """
        if self.margin is None:
            return None
        optimistic = self.margin if self.best_margin is None else self.best_margin
        if self.margin >= -MARGIN_TOLERANCE:
            return True
        return False if optimistic < -MARGIN_TOLERANCE else None

    def to_dict(self) -> JsonObject:
        """Return the check as JSON types in SI units."""
        return {
            **vars(self),
            "passed": self.passed,
            "best_margin": self.margin if self.best_margin is None else self.best_margin,
        }


def open_check(name: str, *needs: str) -> Check:
    """Build a check that cannot be evaluated because data are missing.

    Parameters
    ----------
    name : str
        Name of the check.
    *needs : str
        Names of the missing data.

    Returns
    -------
    Check
        Check without a margin.
    """
    return Check(name, needs=" and ".join(needs))


def upper_limit_check(
    name: str, value: float, limit: float | None, unit: str, needs: str = ""
) -> Check:
    """Build a check of an upper limit on a quantity that does not depend on friction.

    Parameters
    ----------
    name : str
        Name of the check.
    value, limit : float, float or None
        The quantity and its upper limit, in `unit`. With None, the check is open.
    unit : str
        SI unit.
    needs : str
        Name of the figure that is missing if the limit is None.

    Returns
    -------
    Check
        Check with the margin (limit − value)/limit, or without a margin if the limit is None.
    """
    if limit is None:
        return open_check(name, needs)
    margin = float(relative_margin(value, limit))
    return Check(name, margin, value, limit, unit, nominal=value, probability=1.0)


def relative_margin(demand: Array | float, limit: Array | float) -> Array:
    """Compute the margin to an upper limit.

    The margin is (limit − demand)/limit.

    A limit of 0 permits nothing, so its margin is −1.

    Parameters
    ----------
    demand, limit : float or (m,) array
        Demand and limit in the same unit.

    Returns
    -------
    () or (m,) array
        Margins. They are negative if the demand exceeds the limit.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        margin = np.divide(np.subtract(limit, demand), limit)
    return np.where(np.less_equal(limit, 0), -1.0, margin)


@record
class JointCase:
    """The load, the demands and the conditions from which the checks of one joint are computed."""

    load: JointLoad
    band: Band
    """Demands and their range if friction is uncertain."""
    spread: FrictionSpread
    """Uncertainty of the friction."""
    conditions: Conditions

    @cached_property
    def shaft(self) -> "JointCase":
        """Case of the drive without inertia on its input shaft and without added motor friction.

        Its motor torque is thus the torque that passes through the gear stages between motor and
        drive.
        """
        drive = changed(self.load.drive, input_inertia=0.0)
        load = replace(self.load, drive=drive, motor_friction=(0.0, 0.0))
        return gear_case(load, self.conditions)

    def below(
        self,
        name: str,
        demand: DemandName,
        limit: float | None,
        unit: str,
        *,
        needs: Iterable[str],
        factor: float = 1.0,
    ) -> Check:
        """Compare a multiple of an uncertain demand with its upper limit.

        Parameters
        ----------
        name : str
            Name of the check.
        demand : DemandName
            Name of the demand.
        limit : float or None
            Upper limit, in the SI unit `unit`. Infinity means that nothing limits the demand. None
            means that the limit is not known, so the check is open.
        unit : str
            Unit of the limit.
        needs : iterable of str
            Names of the data without which the limit is not known.
        factor : float
            Factor on the demand.

        Returns
        -------
        Check
            Check with its margins at the required confidence, and with the probability that the
            limit is kept. If the check is undecided, it names the data that would decide it.
        """
        if limit is None:
            return open_check(name, *needs)
        band = self.band
        confidence = self.conditions.confidence
        demand_high = factor * band.high(demand, confidence)
        demand_low = factor * band.low(demand, confidence)
        nominal = factor * band.nominal_value(demand)
        if math.isinf(limit):
            return Check(name, 1.0, worst=demand_high, unit=unit, nominal=nominal, probability=1.0)
        samples = factor * getattr(band.worst, demand)
        check = Check(
            name,
            float(relative_margin(demand_high, limit)),
            worst=demand_high,
            limit=limit,
            unit=unit,
            nominal=nominal,
            probability=float(np.mean(samples <= limit)) if band.known else None,
            best_margin=float(relative_margin(demand_low, limit)),
        )
        if check.passed is not None:
            return check
        smooth = samples if band.smooth is None else factor * getattr(band.smooth, demand)
        return replace(check, needs=self.deciding(smooth, limit))

    def deciding(self, values: Array, limit: float) -> str:
        """Name the data or recordings that would decide whether a demand exceeds its limit.

        Parameters
        ----------
        values : (draws,) array
            Values of the demand for the draws of the friction, without the torque ripple of the
            drive.
        limit : float
            Upper limit in the same unit.

        Returns
        -------
        str
            Description for the reader of the result, such as "narrower ranges of mu".
        """
        spread = self.spread
        needs = list(spread.rotors)
        if spread.ranges:
            needs.append(f"narrower ranges of {', '.join(spread.ranges)}")
        if spread.names:
            needs.append(self._deciding_recordings(values, limit))
        return " and ".join(needs)

    def _deciding_recordings(self, values: Array, limit: float) -> str:
        """Describe the recordings that would decide whether a demand exceeds its limit.

        The distribution of the demand must become so narrow that its quantile at the required
        confidence lies on the same side of the limit as its median. The statistical error of n
        recordings is assumed to fall with 1/√n, which gives the number of recordings. If it exceeds
        99 times the present number, the answer states the factor on the width of the distribution
        instead. If the quantile is on the side of the median already, only the torque ripple of the
        drive is undecided.

        Parameters
        ----------
        values : (draws,) array
            Values of the demand for the draws of the friction, without the torque ripple of the
            drive.
        limit : float
            Upper limit in the same unit.

        Returns
        -------
        str
            Description for the reader of the result.
        """
        confidence = self.conditions.confidence
        posterior = self.spread.posterior
        middle = float(np.median(values))
        level = confidence if middle <= limit else 1 - confidence
        end = float(np.quantile(values, level))
        if (end - limit) * (middle - limit) > 0:
            return "more recordings of the ripple under this load"
        share = (limit - middle) / (end - middle)
        speed = f"at motor speeds up to {self.load.peak_speed * RPM:.0f} rpm"
        count = 0 if posterior is None else posterior.recordings
        # The width must shrink by the factor `share`, so 1/share² times as many recordings are
        # needed.
        if count and share**2 * 100 > 1:
            extra = math.ceil(count * (1 / share**2 - 1))
            return f"about {extra} recordings {speed} in addition to the {count} used"
        return f"recordings {speed} that multiply the spread by {share:.2g}"


def gear_case(load: JointLoad, conditions: Conditions) -> JointCase:
    """Return the load and the demands from which the checks of a joint's gear are computed.

    The checks of a gear do not depend on the electrical data of the motor. The demands are
    therefore computed without a motor, and their voltage is NaN.

    Parameters
    ----------
    load : JointLoad
        Motion and load of the joint.
    conditions : Conditions
        Operating conditions, which contain the pause and the required confidence.

    Returns
    -------
    JointCase
        Case with the given load, these demands, and the uncertainty of the friction.
    """
    spread = friction_spread(load.drive, conditions.spread)
    band = demand_band(replace(load, motor=None), spread, conditions)
    return JointCase(load, band, spread, conditions)


def demand_band(load: JointLoad, spread: FrictionSpread, conditions: Conditions) -> Band:
    """Compute the demands on a joint and their range.

    The computation is a Monte Carlo simulation if the conditions request draws. Otherwise, it is
    linearised.

    Parameters
    ----------
    load : JointLoad
        Motion and load of the joint.
    spread : FrictionSpread
        Uncertainty of the friction.
    conditions : Conditions
        Operating conditions with the number of draws.

    Returns
    -------
    Band
        Demands at the stated friction, and their range.
    """
    if conditions.draws:
        return monte_carlo(load, spread, conditions.draws)
    return linear_band(load, spread)


def tightest_check(checks: Iterable[Check]) -> Check | None:
    """Find the check that limits the design, that is, the one with the smallest margin.

    A failed check precedes all others, also an undecided check with a smaller margin.

    Parameters
    ----------
    checks : iterable of Check
        The checks.

    Returns
    -------
    Check or None
        The limiting check. None if no check has a margin.
    """
    evaluated = [check for check in checks if check.margin is not None]
    if evaluated:
        return min(evaluated, key=lambda check: (check.passed is not False, check.margin or 0.0))
    return None


def combine_answers(answers: Iterable[bool | None]) -> bool | None:
    """Combine the answers of several checks into one.

    Parameters
    ----------
    answers : iterable of bool or None
        Answers of the checks. None means not known.

    Returns
    -------
    bool or None
        False if one answer is False, otherwise None if one is None, otherwise True.
    """
    answers = list(answers)
    if any(answer is False for answer in answers):
        return False
    return None if any(answer is None for answer in answers) else True


YOUNG_MODULUS = 193e9
"""Young's modulus of stainless steel, Pa.

Of the usual screw materials, stainless steel has the lowest critical speed and buckling load.
"""
STEEL_DENSITY = 8000.0
"""Density of stainless steel, kg/m³."""
CRITICAL_SPEED_FRACTION = 0.8
"""Largest permitted speed of a screw divided by its critical speed."""
BUCKLING_LOAD_FRACTION = 0.5
"""Largest permitted load of a screw divided by Euler's buckling load."""
BENDING_ROOTS: dict[ScrewEnds, float] = {
    "fixed-free": 1.8751040687,
    "supported-supported": math.pi,
    "fixed-supported": 3.9266023120,
    "fixed-fixed": 4.7300407449,
}
"""First root βL of the beam's frequency equation, by the support of its ends."""
EFFECTIVE_LENGTH_FACTORS: dict[ScrewEnds, float] = {
    "fixed-free": 2.0,
    "supported-supported": 1.0,
    "fixed-supported": 0.6991556597,
    "fixed-fixed": 0.5,
}
"""Effective length divided by free length of a column (Euler), by the support of its ends."""


def gear_checks(case: JointCase) -> tuple[Check, ...]:
    """Run every check of a joint's gear or screw.

    The checks compare input speed, peak output, continuous output and duty with the manufacturer's
    ratings. Self-locking is checked for drives that are declared self-locking, and whirling and
    buckling for rotating screws. The duty is the fraction of the time in which the joint moves.

    Parameters
    ----------
    case : JointCase
        Load and demands of the joint.

    Returns
    -------
    tuple of Check
        A check that lacks data names them in `needs`.
    """
    load = case.load
    drive = load.drive
    ratings = drive.ratings or Ratings()
    unit = "N" if drive.slides else "N·m"
    share = load.moving_share * load.duration / (load.duration + case.conditions.pause)
    outputs: tuple[tuple[DemandName, str], ...] = (
        ("peak_effort", "peak_output"),
        ("continuous_effort", "continuous_output"),
    )
    speed = load.peak_speed / drive.stage_ratio
    checks = [
        upper_limit_check("gear_speed", speed, ratings.input_speed, "rad/s", "ratings.input_speed")
    ]
    for demand, key in outputs:
        limit = getattr(ratings, key)
        checks.append(case.below(f"gear_{key}", demand, limit, unit, needs=(f"ratings.{key}",)))
    checks.append(upper_limit_check("gear_duty", share, ratings.duty, "", "ratings.duty"))
    if drive.self_locking:
        checks.append(_self_locking_check(case))
    if drive.transmission.rotating_screw:
        checks += _screw_checks(case, ratings)
    return tuple(checks)


def drive_checks(case: JointCase, drive: Drive | None = None) -> tuple[Check, ...]:
    """Run the checks of a drive and of its gear stages.

    Parameters
    ----------
    case : JointCase
        Load and demands of the joint.
    drive : Drive, optional
        Drive whose gear stages are checked, if it has others than the drive of the case.

    Returns
    -------
    tuple of Check
        Checks of the gear or screw, followed by those of the gear stages.
    """
    drive = drive or case.load.drive
    checks = gear_checks(case)
    if drive.stages:
        checks += tuple(stage_checks(case.shaft, drive))
    return checks


def stage_checks(case: JointCase, drive: Drive) -> Iterator[Check]:
    """Check speed and output torque of every gear stage between motor and drive.

    The output torque of a stage follows from the torque of the motor by the efficiency of the
    stages. If the mesh of the drive is not self-locking, the backward efficiency applies, which
    overestimates the torque. The continuous torque is the root mean square over the time in motion.

    Parameters
    ----------
    case : JointCase
        Case of the torque that passes through the stages, see `JointCase.shaft`.
    drive : Drive
        Drive with the stages. If the drive of `case` lacks a stage, its torque is the one at the
        output of this stage.

    Yields
    ------
    Check
        Speed, peak torque and continuous torque of each stage, from the motor on.
    """
    load = case.load
    locks = is_certainly_self_locking(case)
    speed = load.peak_speed * drive.ratio / load.drive.ratio
    factor = 1.0
    # The ratings apply to the RMS over the time in motion, which exceeds that over the whole time.
    in_motion = 1.0 / math.sqrt(max(load.moving_share, 1e-300))
    for name, stage in drive.stages.items():
        ratings = stage.ratings or Ratings()
        if name in load.drive.stages:
            factor /= stage.forwards if locks else stage.backwards
        yield upper_limit_check(
            f"{name}_speed", speed, ratings.input_speed, "rad/s", f"{name}.ratings.input_speed"
        )
        outputs: tuple[tuple[DemandName, str, float], ...] = (
            ("peak_torque", "peak_output", factor),
            ("rms_torque", "continuous_output", factor * in_motion),
        )
        for demand, key, scale in outputs:
            limit = getattr(ratings, key)
            needs = (f"{name}.ratings.{key}",)
            yield case.below(f"{name}_{key}", demand, limit, "N·m", needs=needs, factor=scale)
        speed /= stage.ratio


def is_certainly_self_locking(case: JointCase) -> bool:
    """Return whether the mesh of a drive is self-locking even at its lowest plausible friction.

    The condition is μ/cos θ_n ≥ tan λ, where μ is the friction coefficient, θ_n the pressure angle
    of the thread in its normal section, and λ the lead angle.

    Parameters
    ----------
    case : JointCase
        Load of the joint with its drive, and the uncertainty of the friction.

    Returns
    -------
    bool
        True if the condition holds.
    """
    drive = case.load.drive
    lowest, _ = case.spread.mu_ends(drive, case.conditions.confidence)
    return lowest * drive.wedging >= drive.lead_slope


def critical_speed(length: float, diameter: float, ends: ScrewEnds) -> float:
    """Compute the first whirling speed of a slender round steel screw.

    The speed is (βL)²/L²·√(EI/(ρA)), with the free length L, the root βL of the frequency equation
    of a beam (`BENDING_ROOTS`), Young's modulus E, the density ρ, and √(I/A) = d/4 for the area A
    and the second moment of area I of a round section with the diameter d.

    Parameters
    ----------
    length : float
        Free length L, m.
    diameter : float
        Root diameter d, m.
    ends : ScrewEnds
        Support of both ends.

    Returns
    -------
    float
        Speed, rad/s.
    """
    wave_number = BENDING_ROOTS[ends] / length
    sound_speed = math.sqrt(YOUNG_MODULUS / STEEL_DENSITY)
    return wave_number**2 * diameter / 4 * sound_speed


def buckling_load(length: float, diameter: float, ends: ScrewEnds) -> float:
    """Compute Euler's buckling load of a slender round steel screw.

    The load is π²EI/(KL)², with Young's modulus E, the second moment of area I = πd⁴/64, the free
    length L and the factor K of the support (`EFFECTIVE_LENGTH_FACTORS`).

    Parameters
    ----------
    length : float
        Free length L, m.
    diameter : float
        Root diameter d, m.
    ends : ScrewEnds
        Support of both ends.

    Returns
    -------
    float
        Load, N.
    """
    area_moment = math.pi * diameter**4 / 64
    effective_length = EFFECTIVE_LENGTH_FACTORS[ends] * length
    return math.pi**2 * YOUNG_MODULUS * area_moment / effective_length**2


def _self_locking_check(case: JointCase) -> Check:
    """Check that a mesh is self-locking at its lowest plausible friction.

    The condition is μ > cos θ_n·tan λ, where μ is the friction coefficient, θ_n the pressure angle
    of the thread in its normal section, and λ the lead angle. If the lowest friction is unknown,
    the check is open: it contains only the stated μ and names the data that it needs.

    Parameters
    ----------
    case : JointCase
        Load of the joint with its drive, and the uncertainty of the friction.

    Returns
    -------
    Check
        Its margin is (μ − limit)/limit at the lowest plausible μ, with the limit cos θ_n·tan λ.
    """
    drive = case.load.drive
    spread = case.spread
    confidence = case.conditions.confidence
    friction = required_friction(drive)
    lowest, highest = spread.mu_ends(drive, confidence)
    limit = -float(self_locking_margin(drive, 0.0)[0])
    check = Check("self_locking", limit=limit, unit="μ", nominal=friction.mu)
    if friction.mu_lowest is None and "mu" not in spread.ranges and "mu" not in spread.names:
        return replace(check, needs="friction.mu_lowest, or a range or covariance of mu")
    low = (lowest - limit) / limit
    high = (highest - limit) / limit
    check = replace(check, margin=low, best_margin=high, worst=lowest)
    if "mu" in spread.names:
        check = replace(check, probability=float(np.mean(spread.draws("mu") > limit)))
    if check.passed is not None:
        return check
    needs = (
        f"mu, which lies between {lowest:.3g} and {highest:.3g}: "
        "a holding test (friction.mu_lowest)"
    )
    if "mu" in spread.names:
        needs += f", recordings with another payload, or {case.deciding(spread.draws('mu'), limit)}"
    return replace(check, needs=needs)


def _screw_checks(case: JointCase, ratings: Ratings) -> list[Check]:
    """Check the whirling speed and the buckling load of a screw.

    Parameters
    ----------
    case : JointCase
        Load and demands of the joint.
    ratings : Ratings
        Free length, root diameter and support of the screw. If one of them is missing, both checks
        are open.

    Returns
    -------
    list of two Check
        The checks "critical_speed" and "buckling".
    """
    length = ratings.free_length
    diameter = ratings.root_diameter
    ends = ratings.ends
    needs = [
        f"ratings.{key}"
        for key in ("free_length", "root_diameter", "ends")
        if getattr(ratings, key) is None
    ]
    speed = case.load.peak_speed / case.load.drive.stage_ratio
    whirl = column = None
    if length is not None and diameter is not None and ends is not None:
        whirl = CRITICAL_SPEED_FRACTION * critical_speed(length, diameter, ends)
        column = BUCKLING_LOAD_FRACTION * buckling_load(length, diameter, ends)
    return [
        upper_limit_check("critical_speed", speed, whirl, "rad/s", " and ".join(needs)),
        case.below("buckling", "peak_effort", column, "N", needs=needs),
    ]
