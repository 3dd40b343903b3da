"""One motor on one joint: every check that the figures allow, what binds first, and the verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ssm_planner.dynamics.friction import friction_of
from ssm_planner.dynamics.spread import FrictionSpread, spread_of
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.motor import Motor
from ssm_planner.sizing.checks import (
    TOLERANCE,
    Case,
    Check,
    all_of,
    below,
    binding,
    gear_checks,
    unchecked,
)
from ssm_planner.sizing.demand import (
    ELECTRICAL,
    Band,
    DemandName,
    Demands,
    linear_band,
    monte_carlo,
)
from ssm_planner.sizing.heat_check import Heat, heat_of
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.motor_limits import (
    MAGNET,
    Conditions,
    continuous_torque,
    missing,
    operating_shares,
    rotor_range,
    supply,
    torque_constant,
)
from ssm_planner.sizing.requirements import MotorRequirement, motor_requirement
from ssm_planner.sizing.thermal_network import FIGURES
from ssm_planner.typing import Range

CONFIDENCE = "confidence"


@dataclass(frozen=True, eq=False)
class MotorVerdict:
    """A motor on a joint. adequate: True, False, or None (not known); a True one holds at the stated confidence."""

    load: JointLoad
    """With the candidate's rotor in the drive."""
    motor: Motor
    requirement: MotorRequirement
    band: Band
    checks: tuple[Check, ...]
    """Of the motor."""
    gear: tuple[Check, ...]
    probability: float | None
    """That all limits of the motor hold together."""
    heat: Heat | None
    regions: dict[str, float] | None
    """Shares of the time in the continuous and the short-term region, and beyond."""
    notes: tuple[str, ...]

    @property
    def joint(self) -> str:
        """Name of the joint."""
        return self.load.joint

    @property
    def adequate(self) -> bool | None:
        """The motor's checks are all made and passed, and no check of its gear fails."""
        gear_fails = any(check.passed is False for check in self.gear)
        return False if gear_fails else all_of(check.passed for check in self.checks)

    @property
    def binds(self) -> str | None:
        """The limit with the smallest margin, of motor or gear."""
        first = binding(check for check in (*self.checks, *self.gear) if check.name != CONFIDENCE)
        failed = [
            check.name for check in self.checks if check.margin is not None and not check.passed
        ]
        if failed == [CONFIDENCE]:
            return CONFIDENCE
        return None if first is None else first.name

    def to_dict(self) -> dict[str, Any]:
        """An entry of `motors` in what `size --json` prints; SI."""
        checks = (*self.checks, *self.gear)
        return {
            "joint": self.joint,
            "motor": self.motor.name,
            "file": self.motor.file,
            "adequate": self.adequate,
            "binds": self.binds,
            "probability": self.probability,
            "margins": {check.name: check.margin for check in checks if check.name != CONFIDENCE},
            "not_checked": {check.name: check.needs for check in checks if check.passed is None},
            "checks": [check.to_dict() for check in checks],
            "heat": None if self.heat is None else self.heat.to_dict(),
            "regions": self.regions,
            "placeholder": self.motor.placeholder,
            "notes": list(self.notes),
        }


def assess(load: JointLoad, motor: Motor, conditions: Conditions) -> MotorVerdict:
    """Judge a motor on a joint by the motion in `load`, repeated for ever with the pause of the conditions."""
    drive, inertia, rotors = with_rotor(load, motor)
    load = replace(load, drive=drive, motor=motor)
    spread = replace(spread_of(drive, conditions.spread), inertia=inertia, rotors=rotors)
    case = Case(load, band_of(load, motor, spread, conditions), spread, conditions)
    share = math.sqrt(load.duration / (load.duration + conditions.pause))
    heat = heat_of(
        load, motor, conditions, share * case.band.high("rms_torque", conditions.confidence)
    )
    limits = limits_of(motor, conditions, share, heat)
    made = [_check(case, name, limit) for name, limit in limits.items()]
    made.insert(1, below("speed", float(np.abs(load.speed()).max()), motor.max_speed, "rad/s"))
    confidence = _confidence(case, limits)
    requirement = motor_requirement(load)
    notes = tuple(_notes(load, motor, conditions))
    if inertia is not None:
        ends = " to ".join(f"{1e7 * end:.3g}" for end in inertia)
        notes += (
            f"joint {load.joint}: {' and '.join(rotors)} not stated: input inertia {ends} g·cm², looked at whole",
        )
    return MotorVerdict(
        load=load,
        motor=motor,
        requirement=requirement,
        band=case.band,
        checks=(*made, confidence),
        gear=gear_checks(case),
        probability=confidence.worst,
        heat=heat,
        regions=operating_shares(
            motor, conditions, requirement.speed, requirement.torque, load.weight
        ),
        notes=notes,
    )


def band_of(
    load: JointLoad, motor: Motor | None, spread: FrictionSpread, conditions: Conditions
) -> Band:
    """Monte Carlo where the conditions ask for draws, else linearised."""
    if conditions.draws:
        return monte_carlo(load, load.drive, spread, conditions.draws, motor)
    return linear_band(load, load.drive, spread, motor)


def with_rotor(load: JointLoad, motor: Motor) -> tuple[Drive, Range | None, tuple[str, ...]]:
    """The joint's drive with the motor's rotor in place of the one that its input inertia includes.

    Where a rotor's inertia is not stated: the largest input inertia that there can be, the range of it (kg·m²), and the
    names of the figures that would settle it.
    """
    low, high = shaft_inertia(load, motor)
    original, drive = load.motor, load.drive
    if original is not None and _same_rotor(original, motor):
        return drive, None, ()
    missing_from = [
        each for each in (original, motor) if each is not None and each.rotor_inertia is None
    ]
    rotors = [f"rotor_inertia of {each.name}" for each in missing_from]
    if original is None:
        rotors.insert(0, "the motor whose rotor input_inertia includes")
    drive = replace(drive, input_inertia=high)
    return (drive, (low, high), tuple(rotors)) if rotors else (drive, None, ())


def shaft_inertia(load: JointLoad, motor: Motor) -> Range:
    """Smallest and largest inertia that there can be on the shaft with this motor, kg·m²."""
    original, inertia = load.motor, load.drive.input_inertia
    if original is not None and _same_rotor(original, motor):
        return inertia, inertia
    old = (0.0, inertia) if original is None else rotor_range(original)
    new = rotor_range(motor)
    return max(inertia - old[1], 0.0) + new[0], max(inertia - old[0], 0.0) + new[1]


def _same_rotor(one: Motor, other: Motor) -> bool:
    return (one.name, one.rotor_inertia) == (other.name, other.rotor_inertia)


Limit = tuple[DemandName, float, float | None, str, tuple[str, ...]]
"""Demand, factor on it, what it must not exceed (None: not known), unit, and what is missing."""


def limits_of(
    motor: Motor, conditions: Conditions, share: float, heat: Heat | None
) -> dict[str, Limit]:
    """The limits of a motor by the names of their checks; share: of the RMS over motion and pause by that of the motion."""
    torque, torque_needs = _peak_limit(motor, conditions)
    continuous = continuous_torque(motor, conditions.ambient)
    voltage_needs = missing(motor, *ELECTRICAL)
    voltage = supply(motor, conditions)
    if voltage is None:
        voltage_needs = (*voltage_needs, "nominal_voltage or a supply voltage")
    return {
        "torque": ("peak_torque", 1.0, torque, "N·m", torque_needs),
        "continuous_torque": ("rms_torque", share, continuous, "N·m", ("max_winding_temperature",)),
        "voltage": ("peak_voltage", 1.0, None if voltage_needs else voltage, "V", voltage_needs),
        "heat": (
            "rms_torque",
            share,
            None if heat is None else heat.capacity,
            "N·m",
            missing(motor, *FIGURES),
        ),
    }


def _peak_limit(motor: Motor, conditions: Conditions) -> tuple[float | None, tuple[str, ...]]:
    """Largest torque of motor and controller, with the magnets as hot as they may get."""
    if conditions.current_limit is None:
        return motor.max_torque, ()
    needs = missing(motor, "torque_constant", "max_winding_temperature")
    if needs or motor.max_winding_temperature is None:
        return None, needs
    hot = torque_constant(motor, motor.max_winding_temperature)
    return min(motor.max_torque, hot * conditions.current_limit), ()


def _check(case: Case, name: str, limit: Limit) -> Check:
    demand, factor, largest, unit, needs = limit
    return (
        unchecked(name, *needs)
        if largest is None
        else case.below(name, demand, largest, unit, factor)
    )


def _confidence(case: Case, limits: dict[str, Limit]) -> Check:
    """That all limits of the motor hold together with the stated confidence; `worst` is the probability."""
    least = case.conditions.confidence
    if not case.spread.known:
        needs = "posterior, covariance or friction_ranges in the drive file, or a stated spread of the friction"
        return unchecked(CONFIDENCE, needs)
    probability, at_best = (
        _together(demands, limits) for demands in (case.band.worst, case.band.best)
    )
    margin, best = (probability - least) / least, (at_best - (1 - least)) / least
    check = Check(
        CONFIDENCE,
        margin,
        worst=probability,
        limit=least,
        nominal=probability,
        best_margin=max(margin, best),
    )
    return (
        check
        if check.passed is not None
        else replace(check, needs="what decides the limits that are open")
    )


def _together(demands: Demands, limits: dict[str, Limit]) -> float:
    """Share of the draws in which every limit that is known holds."""
    kept = [
        factor * getattr(demands, name) <= limit * (1 + TOLERANCE)
        for name, factor, limit, _, _ in limits.values()
        if limit is not None
    ]
    return float(np.mean(np.all(np.broadcast_arrays(*kept), axis=0)))


def _notes(load: JointLoad, motor: Motor, conditions: Conditions) -> list[str]:
    notes = []
    if motor.placeholder:
        notes.append(f"motor {motor.name}: placeholder figures ({', '.join(motor.placeholders)})")
    known = friction_of(load.drive).identified_speed
    peak = float(np.abs(load.speed()).max())
    if known is None:
        notes.append(
            f"joint {load.joint}: the drive file does not say up to which speed friction was identified"
        )
    elif peak > known:
        notes.append(
            f"joint {load.joint}: friction extrapolated {peak / known:.1f}× beyond the identified speeds "
            f"({known:.3g} rad/s, used up to {peak:.3g} rad/s)"
        )
    if motor.torque_constant is not None and motor.torque_constant_per_kelvin is None:
        notes.append(f"assumed: the torque constant falls by {-100 * MAGNET:g} % per kelvin")
    if conditions.supply_voltage is None and motor.nominal_voltage is not None:
        notes.append("assumed: the controller's supply gives the motor's nominal voltage")
    if conditions.current_limit is None:
        notes.append("not looked at: the current limit of the controller, none is given")
    return notes
