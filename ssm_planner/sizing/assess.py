"""Assess whether one motor suffices for one joint.

The assessment runs every check for which the files of motor, drive and controller contain the data.
It names the check with the smallest margin. The verdict is adequate, not adequate, or not known.
"""

import math
from dataclasses import replace

import numpy as np

from ssm_planner.dynamics import friction_spread, required_friction
from ssm_planner.problem import Drive, Motor, get_attributes
from ssm_planner.sizing.checks import (
    MARGIN_TOLERANCE,
    Check,
    JointCase,
    combine_answers,
    demand_band,
    drive_checks,
    open_check,
    tightest_check,
    upper_limit_check,
)
from ssm_planner.sizing.demand import Band, DemandName, Demands
from ssm_planner.sizing.heat_check import Heat, compute_heat
from ssm_planner.sizing.joint_load import JointLoad
from ssm_planner.sizing.motor_limits import (
    ELECTRICAL_DATA,
    MAGNET_COEFFICIENT,
    Conditions,
    available_voltage,
    continuous_torque,
    missing_data,
    no_load_torque,
    operating_region_shares,
    rotor_range,
    torque_constant,
)
from ssm_planner.sizing.requirements import MotorRequirement, motor_requirement
from ssm_planner.sizing.thermal_network import THERMAL_DATA
from ssm_planner.typing import JsonObject, Range, frozen, record

CONFIDENCE_CHECK = "confidence"
"""Name of the check that all limits are kept at once with the required confidence."""


@record
class MotorVerdict:
    """The assessment of one motor on one joint, in SI units.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> verdict = ssm.size("results/tilt_insert").verdicts[0]
    >>> verdict.joint, verdict.adequate, verdict.binds
    ('roll', None, 'continuous_torque')
    """

    load: JointLoad
    """Load of the joint. The input inertia of its drive includes the rotor of this motor."""
    motor: Motor
    requirement: MotorRequirement
    """Requirements of the motion on this motor at the stated friction."""
    band: Band
    """Demands on this motor and their range if friction is uncertain."""
    checks: tuple[Check, ...]
    """Checks of the motor."""
    gear: tuple[Check, ...]
    """Checks of the gear or screw."""
    probability: float | None
    """Probability that the motor keeps all its limits at once. None if it is unknown."""
    heat: Heat | None
    """Winding temperatures. None if the motor file lacks thermal data."""
    regions: dict[str, float] | None
    """Fractions of the time in the continuous region, in the short-term region, and beyond both.

    None if data are missing, see `operating_region_shares`.
    """
    notes: tuple[str, ...]
    """Remarks on assumptions for the reader of the result."""

    @property
    def joint(self) -> str:
        """Name of the joint."""
        return self.load.joint

    @property
    def all_checks(self) -> tuple[Check, ...]:
        """Checks of the motor, followed by those of its gear."""
        return self.checks + self.gear

    @property
    def adequate(self) -> bool | None:
        """True if every check of the motor and of its gear passes, False if a check fails.

        None if no check fails and at least one is open, for example because a figure is missing,
        or if a figure of the motor or its drive is a placeholder. The answer True has the
        confidence that `Conditions` states.
        """
        answers = [check.passed for check in self.all_checks]
        if self.motor.placeholder or self.load.drive.placeholders:
            answers.append(None)
        return combine_answers(answers)

    @property
    def binds(self) -> str | None:
        """Name of the check that limits the motor.

        It is the check with the smallest margin among the checks of the motor and its gear. The
        result is "confidence" if each limit is kept on its own but not all of them at once with the
        required confidence, and None if no check has a margin.
        """
        failed = [
            check.name for check in self.checks if check.margin is not None and not check.passed
        ]
        if failed == [CONFIDENCE_CHECK]:
            return CONFIDENCE_CHECK
        tightest = tightest_check(
            check for check in self.all_checks if check.name != CONFIDENCE_CHECK
        )
        return None if tightest is None else tightest.name

    def to_dict(self) -> JsonObject:
        """Return the verdict as a dict, in SI units.

        The output of `size --json` contains this dict as an entry of `motors`. `margins` and
        `checks` contain the checks of the motor and of its gear, and `not_checked` names the data
        that each undecided check needs.
        """
        margins = {check.name: check.margin for check in self.all_checks}
        margins.pop(CONFIDENCE_CHECK, None)
        return {
            **get_attributes(self, ("joint", "adequate", "binds", "probability", "regions")),
            **get_attributes(self.motor, ("file", "placeholder")),
            "motor": self.motor.name,
            "margins": margins,
            "not_checked": {
                check.name: check.needs for check in self.all_checks if check.passed is None
            },
            "checks": [check.to_dict() for check in self.all_checks],
            "heat": self.heat and self.heat.to_dict(),
            "placeholders": list(self.motor.placeholders),
            "notes": list(self.notes),
        }


def assess(load: JointLoad, motor: Motor, conditions: Conditions) -> MotorVerdict:
    """Assess a motor on a joint for a motion that repeats forever.

    Parameters
    ----------
    load : JointLoad
        Motion and load of the joint.
    motor : Motor
        The assessed motor.
    conditions : Conditions
        Operating conditions, which contain the pause after each repetition.

    Returns
    -------
    MotorVerdict
        Requirements, demands, checks of motor and gear, temperatures and remarks.
    """
    original = load.motor
    load, inertia, rotors = with_motor(load, motor)
    needs = rotors
    least_friction, largest_friction = load.motor_friction
    if least_friction < largest_friction:
        needs += (f"no_load_current of {original.name if original else 'the original motor'}",)
    spread = replace(friction_spread(load.drive, conditions.spread), inertia=inertia, rotors=needs)
    case = JointCase(load, demand_band(load, spread, conditions), spread, conditions)
    share = math.sqrt(load.duration / (load.duration + conditions.pause))
    heat = compute_heat(
        load, motor, conditions, share * case.band.high("rms_torque", conditions.confidence)
    )
    limits = motor_limits(motor, conditions, share, heat)
    checks = [
        case.below(name, item.demand, item.limit, item.unit, needs=item.needs, factor=item.factor)
        for name, item in limits.items()
    ]
    checks.insert(1, upper_limit_check("speed", load.peak_speed, motor.max_speed, "rad/s"))
    confidence = _confidence_check(case, limits)
    checks.append(confidence)
    requirement = motor_requirement(load)
    notes = tuple(_assumption_notes(load, motor, conditions))
    if largest_friction > 0:
        notes += (
            f"joint {load.joint}: friction of {motor.name} by its no-load current: up to "
            f"{1e3 * largest_friction:.3g} mN·m in addition to the friction of the drive",
        )
    elif no_load_torque(motor) is None and not _is_original_motor(original, motor):
        notes += (
            f"joint {load.joint}: no_load_current of {motor.name} not stated: its friction is "
            "assumed to be that of the original motor",
        )
    if inertia is not None:
        ends = " to ".join(f"{1e7 * end:.3g}" for end in inertia)
        notes += (
            f"joint {load.joint}: {' and '.join(rotors)} not stated: input inertia {ends} g·cm²; "
            "the whole range is checked",
        )
    return MotorVerdict(
        load,
        motor,
        requirement,
        case.band,
        checks=tuple(checks),
        gear=drive_checks(case),
        probability=confidence.worst,
        heat=heat,
        regions=operating_region_shares(
            motor, conditions, requirement.speed, requirement.torque, load.weight
        ),
        notes=notes,
    )


def with_motor(load: JointLoad, motor: Motor) -> tuple[JointLoad, Range | None, tuple[str, ...]]:
    """Replace the original motor of a joint by another one, with its rotor and its friction.

    The `input_inertia` of a drive includes the rotor of the joint's original motor, so the new
    rotor is added and the original one is subtracted.

    Parameters
    ----------
    load : JointLoad
        Load of the joint with its drive and original motor.
    motor : Motor
        The new motor. If it is the original one, only the motor of the load is set.

    Returns
    -------
    load
        Load with the new motor, its friction torque and the new input inertia. If a motor file does
        not state the rotor's inertia, the drive has the largest input inertia that is possible.
    inertia
        Range of the input inertia, kg·m². None if it is certain.
    rotors
        Descriptions of the rotor inertias that the motor files do not state.
    """
    low, high = shaft_inertia(load, motor)
    original = load.motor
    friction = motor_friction(load, motor)
    if _is_original_motor(original, motor):
        return replace(load, motor=motor), None, ()
    rotors = [
        f"rotor_inertia of {candidate.name}"
        for candidate in (original, motor)
        if candidate is not None and candidate.rotor_inertia is None
    ]
    if load.shaft is None and original is None:
        rotors.insert(0, "the motor whose rotor input_inertia includes")
    elif load.shaft is not None and load.shaft[0] < load.shaft[1]:
        rotors.insert(0, "rotor_inertia of the original motor")
    drive = replace(load.drive, input_inertia=high)
    load = replace(load, drive=drive, motor=motor, motor_friction=friction)
    return load, (low, high) if rotors else None, tuple(rotors)


def motor_friction(load: JointLoad, motor: Motor) -> Range:
    """Compute the friction torque that a motor adds to the friction of a drive.

    The friction of a drive was identified together with the joint's original motor and includes the
    friction of this motor. The result therefore depends on the no-load currents of both motors,
    from which their friction torques follow. If both are stated, the result is the increase, or 0.
    If only that of the new motor is stated, the range extends from 0 to the friction torque of the
    new motor. If that of the new motor is not stated, it is assumed to have the friction of the
    original motor.

    With a gearhead of a catalogue, the friction of the drive does not include a motor. Then the
    result is the friction torque of the new motor. If this torque is not known, the range extends
    from 0 to the Coulomb friction b_c on the input shaft of the drive behind its gear stages, which
    includes the original motor.

    Parameters
    ----------
    load : JointLoad
        Load of the joint with its drive and original motor.
    motor : Motor
        The new motor.

    Returns
    -------
    least, largest : float
        Range of the added friction torque, N·m.
    """
    torque = no_load_torque(motor)
    original = load.motor
    if load.shaft is not None:
        drive = load.drive
        if torque is not None:
            return torque, torque
        forwards = math.prod(stage.forwards for stage in drive.stages.values())
        return 0.0, required_friction(drive).b_c / forwards
    if torque is None or _is_original_motor(original, motor):
        return 0.0, 0.0
    included = no_load_torque(original)
    if included is None:
        return 0.0, torque
    increase = max(torque - included, 0.0)
    return increase, increase


def shaft_inertia(load: JointLoad, motor: Motor) -> Range:
    """Compute the range of the inertia on the shaft of a new motor.

    The input inertia of a drive includes the rotor of the joint's original motor, which the new
    rotor replaces. If a motor file does not state the inertia of its rotor, `rotor_range` gives its
    range.

    Parameters
    ----------
    load : JointLoad
        Load of the joint with its drive and original motor.
    motor : Motor
        The new motor.

    Returns
    -------
    smallest, largest : float
        Inertias on the motor shaft with the new rotor, kg·m².
    """
    original = load.motor
    inertia = load.drive.input_inertia
    if _is_original_motor(original, motor):
        return inertia, inertia
    old_low, old_high = (0.0, inertia) if original is None else rotor_range(original)
    without_rotor = max(inertia - old_high, 0.0), max(inertia - old_low, 0.0)
    shaft_low, shaft_high = load.shaft or without_rotor
    new_low, new_high = rotor_range(motor)
    return shaft_low + new_low, shaft_high + new_high


def _is_original_motor(original: Motor | None, motor: Motor) -> bool:
    """Return whether a motor is the original one, so that rotor and friction do not change.

    Motors are equal if their names and rotor inertias are equal.

    Parameters
    ----------
    original : Motor or None
        Motor of the joint. None if the joint has no motor.
    motor : Motor
        The assessed motor.

    Returns
    -------
    bool
        True if both are equal. False if the joint has no motor.
    """
    identity = motor.name, motor.rotor_inertia
    return original is not None and (original.name, original.rotor_inertia) == identity


@frozen
class DemandLimit:
    """Upper limit of a multiple of a demand."""

    demand: DemandName
    factor: float
    """Factor on the demand."""
    limit: float | None
    """The limit. None if it is unknown."""
    unit: str
    """SI unit of the limit."""
    needs: tuple[str, ...]
    """Names of the missing data."""


def motor_limits(
    motor: Motor, conditions: Conditions, share: float, heat: Heat | None
) -> dict[str, DemandLimit]:
    """Return the limits of a motor by name of the check.

    Parameters
    ----------
    motor, conditions : Motor, Conditions
        The motor and its operating conditions.
    share : float
        RMS torque over motion and pause, divided by the RMS torque over the motion alone.
    heat : Heat or None
        Temperatures in the repeated motion, or None if the motor file lacks thermal data.

    Returns
    -------
    dict of DemandLimit
        Limits of the checks "torque", "continuous_torque", "voltage" and "heat".
    """
    torque, torque_needs = _peak_torque_limit(motor, conditions)
    continuous = continuous_torque(motor, conditions.ambient)
    continuous_needs = ("max_winding_temperature",)
    voltage_needs = missing_data(motor, *ELECTRICAL_DATA)
    voltage = available_voltage(motor, conditions)
    if voltage is None:
        voltage_needs += ("nominal_voltage or a supply voltage",)
    if voltage_needs:
        voltage = None
    heat_needs = missing_data(motor, *THERMAL_DATA)
    capacity = None if heat is None else heat.capacity
    return {
        "torque": DemandLimit("peak_torque", 1.0, torque, "N·m", torque_needs),
        "continuous_torque": DemandLimit("rms_torque", share, continuous, "N·m", continuous_needs),
        "voltage": DemandLimit("peak_voltage", 1.0, voltage, "V", voltage_needs),
        "heat": DemandLimit("rms_torque", share, capacity, "N·m", heat_needs),
    }


def _peak_torque_limit(
    motor: Motor, conditions: Conditions
) -> tuple[float | None, tuple[str, ...]]:
    """Return the largest torque that the motor and the current limit of the controller permit.

    The magnets are assumed to be at the largest winding temperature, because heat weakens them.

    Parameters
    ----------
    motor, conditions : Motor, Conditions
        The motor and its operating conditions.

    Returns
    -------
    torque : float or None
        Torque, N·m. None if data for the current limit are missing.
    needs : tuple of str
        Names of the missing data.
    """
    if conditions.current_limit is None:
        return motor.max_torque, ()
    needs = missing_data(motor, "torque_constant", "max_winding_temperature")
    if needs or motor.max_winding_temperature is None:
        return None, needs
    hot = torque_constant(motor, motor.max_winding_temperature)
    return min(motor.max_torque, hot * conditions.current_limit), ()


def _confidence_check(case: JointCase, limits: dict[str, DemandLimit]) -> Check:
    """Check that the motor keeps all its limits at once with the required confidence.

    Each limit may be kept with this confidence although all of them together are not. If a limit is
    missing, the stated limits give an upper bound of the probability, so the check can fail but not
    pass.

    Parameters
    ----------
    case : JointCase
        Demands of the joint and their range.
    limits : dict of DemandLimit
        Limits of the motor by name of the check.

    Returns
    -------
    Check
        Its value `worst` is the probability that all limits are kept at once.
    """
    required = case.conditions.confidence
    missing_names: list[str] = []
    for item in limits.values():
        if item.limit is None:
            missing_names += [name for name in item.needs if name not in missing_names]
    if not case.spread.is_stated:
        return open_check(
            CONFIDENCE_CHECK,
            "posterior, covariance or friction_ranges in the drive file, "
            "or a stated spread of the friction",
        )
    probability = _joint_probability(case.band.worst, limits)
    best_probability = _joint_probability(case.band.best, limits)
    margin = (probability - required) / required
    # The least favourable ends of the ranges give `probability`, and the most favourable ones give
    # `best_probability`, which must fall below 1 − required before the check fails.
    optimistic = (best_probability - (1 - required)) / required
    check = Check(
        CONFIDENCE_CHECK,
        margin,
        worst=probability,
        limit=required,
        nominal=probability,
        best_margin=max(margin, optimistic),
    )
    if missing_names and check.passed is not False:
        return open_check(CONFIDENCE_CHECK, *missing_names)
    if check.passed is not None:
        return check
    return replace(check, needs="data that decide the open limits")


def _joint_probability(demands: Demands, limits: dict[str, DemandLimit]) -> float:
    """Compute the fraction of the draws of the friction in which every known limit is kept.

    Parameters
    ----------
    demands : Demands
        Demands (draws,) of the motor.
    limits : dict of DemandLimit
        Limits of the motor by name of the check. Limits of None are ignored.

    Returns
    -------
    float
        Fraction from 0 to 1.
    """
    is_satisfied = [
        item.factor * getattr(demands, item.demand) <= item.limit * (1 + MARGIN_TOLERANCE)
        for item in limits.values()
        if item.limit is not None
    ]
    return float(np.mean(np.all(np.broadcast_arrays(*is_satisfied), axis=0)))


def extrapolation_notes(joint: str, drive: Drive, peak_speed: float) -> list[str]:
    """Return a remark if friction is used beyond the speeds at which it was identified.

    Parameters
    ----------
    joint : str
        Name of the joint.
    drive : Drive
        Drive with its friction.
    peak_speed : float
        Largest speed of the motor, rad/s.

    Returns
    -------
    list of str
        The remark, also if these speeds are not stated. Empty if the speed is within the range.
    """
    identified_speed = required_friction(drive).identified_speed
    if identified_speed is None:
        reason = "the drive file does not say up to which speed friction was identified"
    elif peak_speed <= identified_speed:
        return []
    else:
        reason = (
            f"friction extrapolated {peak_speed / identified_speed:.1f}× beyond the identified "
            f"speeds ({identified_speed:.3g} rad/s, used up to {peak_speed:.3g} rad/s)"
        )
    return [f"joint {joint}: {reason}"]


def _assumption_notes(load: JointLoad, motor: Motor, conditions: Conditions) -> list[str]:
    """Return remarks on assumptions and on extrapolated friction for the reader of the result.

    Parameters
    ----------
    load : JointLoad
        Load of the joint, which gives the largest speed of the motor.
    motor : Motor
        The motor, whose file may have placeholder figures or lack data.
    conditions : Conditions
        Operating conditions, which may lack the supply voltage or the current limit.

    Returns
    -------
    list of str
        One sentence for each assumption.
    """
    notes = []
    if motor.placeholder:
        notes.append(f"motor {motor.name}: placeholder figures ({', '.join(motor.placeholders)})")
    notes += extrapolation_notes(load.joint, load.drive, load.peak_speed)
    if motor.torque_constant is not None and motor.torque_constant_per_kelvin is None:
        notes.append(
            f"assumed: the torque constant falls by {-100 * MAGNET_COEFFICIENT:g} % per kelvin"
        )
    if conditions.supply_voltage is None and motor.nominal_voltage is not None:
        notes.append("assumed: the controller's supply gives the motor's nominal voltage")
    if conditions.current_limit is None:
        notes.append("not looked at: the current limit of the controller, none is given")
    return notes
