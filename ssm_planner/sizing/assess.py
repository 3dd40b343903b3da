"""One motor on one joint: every check that the figures allow, what binds first, and the verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ssm_planner.dynamics.friction import friction_of
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.motor import Motor
from ssm_planner.sizing.checks import Check, above, all_of, below, binding, gear_checks, unchecked
from ssm_planner.sizing.demand import Band, DemandName, FrictionSpread, linear_band, monte_carlo, spread_of
from ssm_planner.sizing.heat_check import Heat, heat_of
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.motor_limits import (
    MAGNET,
    Conditions,
    continuous_torque,
    missing,
    operating_shares,
    supply,
    torque_constant,
)
from ssm_planner.sizing.requirements import MotorRequirement, motor_requirement
from ssm_planner.sizing.thermal_network import FIGURES
from ssm_planner.typing import Array

CONFIDENCE = "confidence"
ROTOR = "rotor_inertia"


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
        failed = [check.name for check in self.checks if check.passed is False]
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
            "margins": {check.name: check.margin for check in checks if check.name not in (CONFIDENCE, ROTOR)},
            "not_checked": {check.name: check.needs for check in checks if check.passed is None},
            "checks": [check.to_dict() for check in checks],
            "heat": None if self.heat is None else self.heat.to_dict(),
            "regions": self.regions,
            "placeholder": self.motor.placeholder,
            "notes": list(self.notes),
        }


def assess(load: JointLoad, motor: Motor, conditions: Conditions) -> MotorVerdict:
    """Judge a motor on a joint by the motion in `load`, repeated for ever with the pause of the conditions."""
    drive, rotor = with_rotor(load, motor)
    load = replace(load, drive=drive, motor=motor)
    spread = spread_of(drive, conditions.spread)
    band = band_of(load, motor, spread, conditions)
    share = math.sqrt(load.duration / (load.duration + conditions.pause))
    heat = heat_of(load, motor, conditions, share * band.high("rms_torque", conditions.confidence))
    limits = _limits(motor, conditions, share, heat)
    made = [_check(band, conditions, name, *limit) for name, limit in limits.items()]
    made.insert(1, below("speed", float(np.abs(load.speed()).max()), motor.max_speed, "rad/s"))
    probability = _together(band, limits) if spread.known else None
    confidence = (
        unchecked(
            CONFIDENCE,
            "posterior, covariance or friction_ranges in the drive file, or a stated spread of the friction",
        )
        if probability is None
        else above(CONFIDENCE, probability, conditions.confidence, "")
    )
    requirement = motor_requirement(load)
    return MotorVerdict(
        load=load,
        motor=motor,
        requirement=requirement,
        band=band,
        checks=(*made, *rotor, confidence),
        gear=gear_checks(load, band, spread, conditions),
        probability=probability,
        heat=heat,
        regions=operating_shares(motor, conditions, requirement.speed, requirement.torque, load.weight),
        notes=tuple(_notes(load, motor, conditions)),
    )


def band_of(load: JointLoad, motor: Motor | None, spread: FrictionSpread, conditions: Conditions) -> Band:
    """Monte Carlo where the conditions ask for draws, else linearised."""
    if conditions.draws:
        return monte_carlo(load, load.drive, spread, conditions.draws, motor)
    return linear_band(load, load.drive, spread, motor)


def with_rotor(load: JointLoad, motor: Motor) -> tuple[Drive, tuple[Check, ...]]:
    """The joint's drive with the motor's rotor in place of the one that its input inertia includes.

    Where a rotor inertia is missing the drive stays as it is, and a check says what is needed.
    """
    original = load.motor
    if original is not None and (original.name, original.rotor_inertia) == (motor.name, motor.rotor_inertia):
        return load.drive, ()
    needs = []
    if original is None:
        needs.append("the motor whose rotor input_inertia includes")
    elif original.rotor_inertia is None:
        needs.append(f"rotor_inertia of {original.name}")
    if motor.rotor_inertia is None:
        needs.append(f"rotor_inertia of {motor.name}")
    if needs or original is None or original.rotor_inertia is None or motor.rotor_inertia is None:
        return load.drive, (unchecked(ROTOR, *needs),)
    inertia = load.drive.input_inertia - original.rotor_inertia + motor.rotor_inertia
    return replace(load.drive, input_inertia=inertia), ()


Limit = tuple[DemandName, float, float | None, str, tuple[str, ...]]
"""Demand, factor on it, what it must not exceed (None: not known), unit, and what is missing."""


def _limits(motor: Motor, conditions: Conditions, share: float, heat: Heat | None) -> dict[str, Limit]:
    torque, torque_needs = _peak_limit(motor, conditions)
    continuous = continuous_torque(motor, conditions.ambient)
    voltage_needs = missing(motor, "torque_constant", "terminal_resistance", "max_winding_temperature")
    voltage = supply(motor, conditions)
    if voltage is None:
        voltage_needs = (*voltage_needs, "nominal_voltage or a supply voltage")
    return {
        "torque": ("peak_torque", 1.0, torque, "N·m", torque_needs),
        "continuous_torque": ("rms_torque", share, continuous, "N·m", ("max_winding_temperature",)),
        "voltage": ("peak_voltage", 1.0, None if voltage_needs else voltage, "V", voltage_needs),
        "heat": ("rms_torque", share, None if heat is None else heat.capacity, "N·m", missing(motor, *FIGURES)),
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


def _check(
    band: Band,
    conditions: Conditions,
    name: str,
    demand: DemandName,
    factor: float,
    limit: float | None,
    unit: str,
    needs: tuple[str, ...],
) -> Check:
    if limit is None:
        return unchecked(name, *needs)
    worst, nominal = factor * band.high(demand, conditions.confidence), factor * band.at(demand)
    if math.isinf(limit):
        return Check(name, 1.0, worst=worst, limit=None, unit=unit, nominal=nominal, probability=1.0)
    probability = float(np.mean(factor * getattr(band.worst, demand) <= limit)) if band.known else None
    return below(name, worst, limit=limit, unit=unit, nominal=nominal, probability=probability)


def _together(band: Band, limits: dict[str, Limit]) -> float:
    """Share of the draws in which every limit that is known holds."""
    holds: Array = np.ones(len(band.worst.peak_torque), dtype=bool)
    for demand, factor, limit, _, _ in limits.values():
        if limit is not None:
            holds = holds & (factor * getattr(band.worst, demand) <= limit)
    return float(np.mean(holds))


def _notes(load: JointLoad, motor: Motor, conditions: Conditions) -> list[str]:
    notes = []
    if motor.placeholder:
        notes.append(f"motor {motor.name}: placeholder figures ({', '.join(motor.placeholders)})")
    known = friction_of(load.drive).identified_speed
    peak = float(np.abs(load.speed()).max())
    if known is None:
        notes.append(f"joint {load.joint}: the drive file does not say up to which speed friction was identified")
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
