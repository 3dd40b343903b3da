"""Size the motors and gears of a robot for a motion.

The main entry, `size`, assesses candidates for every joint and finds the smallest adequate motor.
`largest_payload` and `shortest_duration` search for the largest payload and for the shortest
duration with which every check passes. `assess` and `checks` contain the checks themselves.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ssm_planner.errors import ProblemError
from ssm_planner.problem import Motor, Robot
from ssm_planner.sizing.assess import CONFIDENCE_CHECK, MotorVerdict, assess
from ssm_planner.sizing.checks import (
    Check,
    combine_answers,
    drive_checks,
    gear_case,
    tightest_check,
)
from ssm_planner.sizing.demand import Band, DemandName
from ssm_planner.sizing.duty import DutyCycle, no_drive_error
from ssm_planner.sizing.joint_load import JointLoad, joint_loads
from ssm_planner.sizing.motor_limits import Conditions
from ssm_planner.sizing.requirements import MotorRequirement, motor_requirement
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import JsonObject, frozen, record


@record
class JointSizing:
    """The requirements on one joint, the checks of its gear, and its assessed candidates.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> [joint.adequate for joint in ssm.size("results/tilt_insert").joints]
    [None, None, None]
    """

    load: JointLoad
    """Motion and load of the joint."""
    requirement: MotorRequirement
    band: Band
    """Demands on the drive and their range if its friction is uncertain."""
    gear: tuple[Check, ...]
    """Checks of the gear or screw."""
    candidates: tuple[MotorVerdict, ...]
    """Assessments of the candidate motors, in ascending order of their nominal torque."""
    alternatives: tuple[MotorVerdict, ...] = ()
    """Assessments of the joint's alternative motors. They do not affect the verdict."""

    @property
    def smallest(self) -> MotorVerdict | None:
        """The adequate candidate with the smallest nominal torque, or None."""
        return next((verdict for verdict in self.candidates if verdict.adequate is True), None)

    @property
    def adequate(self) -> bool | None:
        """True if a candidate is adequate, False if no candidate is adequate, None if unknown."""
        answers = [verdict.adequate for verdict in self.candidates]
        if True in answers:
            return True
        return None if None in answers or not answers else False

    def gear_dict(self) -> JsonObject:
        """Return the checks of the gear as a dict, in SI units.

        The output of `size --json` contains this dict as an entry of `gears`. It states the verdict
        on the gear, the check with the smallest margin (`binds`), all margins, and the data that
        undecided checks need.
        """
        drive = self.load.drive
        answers = [check.passed for check in self.gear]
        if drive.placeholders:
            answers.append(None)
        tightest = tightest_check(self.gear)
        return {
            "joint": self.load.joint,
            "drive": drive.name,
            "adequate": combine_answers(answers),
            "binds": tightest and tightest.name,
            "margins": {check.name: check.margin for check in self.gear},
            "not_checked": {check.name: check.needs for check in self.gear if check.passed is None},
            "placeholders": list(drive.placeholders),
        }

    def requirement_dict(self, confidence: float) -> JsonObject:
        """Return the requirements on the motor as a dict, in SI units.

        The output of `size --json` contains this dict as an entry of `requirements`. Its entry
        `band` contains the range of each demand at the given confidence, or None if the uncertainty
        of the friction is unknown.

        Parameters
        ----------
        confidence : float
            Probability with which a demand stays below the upper end of its range, and likewise
            above the lower end.

        Returns
        -------
        dict
            The requirement and the entry `band`.
        """
        band = self.band
        names: tuple[DemandName, ...] = ("peak_torque", "rms_torque", "peak_effort")
        ranges: JsonObject = dict.fromkeys(names)
        if band.known:
            for name in names:
                ranges[name] = [band.low(name, confidence), band.high(name, confidence)]
        if band.smooth is not None:
            smooth_torque = band.smooth.peak_torque
            high = float(np.quantile(smooth_torque, confidence, method="inverted_cdf"))
            ranges["peak_torque_without_ripple"] = [band.low("peak_torque", confidence), high]
        return {**self.requirement.to_dict(), "band": ranges}


@record
class Sizing:
    """The sizing result of a motion, with one entry for each driven joint that moves in it.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> sizing = ssm.size("results/tilt_insert")
    >>> [verdict.joint for verdict in sizing.verdicts]
    ['roll', 'tilt', 'insertion']
    """

    joints: tuple[JointSizing, ...]
    conditions: Conditions

    @property
    def adequate(self) -> bool | None:
        """True if every joint has an adequate motor and every gear passes its checks.

        None if that is unknown or if the result is empty.
        """
        if not self.joints:
            return None
        answers = []
        for joint in self.joints:
            answers.append(joint.adequate)
            answers += [check.passed for check in joint.gear]
        return combine_answers(answers)

    @property
    def verdicts(self) -> tuple[MotorVerdict, ...]:
        """Assessments of every candidate on every joint."""
        return tuple(verdict for joint in self.joints for verdict in joint.candidates)

    @property
    def alternatives(self) -> tuple[MotorVerdict, ...]:
        """Assessments of the alternative motors of all joints."""
        return tuple(verdict for joint in self.joints for verdict in joint.alternatives)

    def to_dict(self) -> JsonObject:
        """Return the sizing result as a dict, in SI units, radians and kelvin.

        The command `size --json` prints this dict. Its entry `smallest` contains the name of the
        smallest adequate motor of each joint, or None.
        """
        return {
            "adequate": self.adequate,
            "confidence": self.conditions.confidence,
            "motors": [verdict.to_dict() for verdict in self.verdicts],
            "alternatives": [verdict.to_dict() for verdict in self.alternatives],
            "gears": [joint.gear_dict() for joint in self.joints],
            "smallest": {
                joint.load.joint: joint.smallest and joint.smallest.motor.name
                for joint in self.joints
            },
            "requirements": [
                joint.requirement_dict(self.conditions.confidence) for joint in self.joints
            ],
        }


def size(
    duty: DutyCycle,
    candidates: Mapping[str, Sequence[Motor]] | None = None,
    conditions: Conditions | None = None,
    payload: float = 0.0,
) -> Sizing:
    """Assess motors for every joint that a duty cycle moves.

    The duty cycle repeats forever.

    Parameters
    ----------
    duty : DutyCycle
        Motions of one robot.
    candidates : mapping of str to sequence of Motor, optional
        Motors by joint name. A joint without an entry is assessed with its present motor.
    conditions : Conditions, optional
        Operating conditions. The default is `Conditions()`.
    payload : float
        Point mass at the tip, kg.

    Returns
    -------
    Sizing
        Requirements, checks and verdicts of every joint.

    Raises
    ------
    ProblemError
        If candidates are given for a joint that lacks a drive or does not move.
    """
    conditions = conditions or Conditions()
    motors = dict(candidates or {})
    loads = duty.loads(payload)
    moving = {load.joint for load in loads}
    driven = {joint.name for joint in duty.robot.joints if joint.drive is not None}
    for joint in motors:
        if joint not in driven:
            raise no_drive_error(joint, duty.robot.file)
        if joint not in moving:
            raise ProblemError(
                f"{duty.name} does not move this joint",
                key=joint,
                allowed=", ".join(sorted(moving)),
            )
    joints = tuple(_size_joint(load, motors.get(load.joint), conditions) for load in loads)
    return Sizing(joints, conditions)


def size_motion(trajectory: Trajectory, robot: Robot, pause: float = 0.0) -> Sizing:
    """Assess the motors of a robot for one motion that repeats forever, at an ambient of 25 °C.

    Joints without a drive are ignored.

    Parameters
    ----------
    trajectory : Trajectory
        The motion.
    robot : Robot
        Robot with its motors.
    pause : float
        Pause after each repetition, s.

    Returns
    -------
    Sizing
        Requirements, checks and verdicts of every joint with a drive.
    """
    conditions = Conditions(pause=pause)
    loads = joint_loads(trajectory, robot)
    return Sizing(tuple(_size_joint(load, None, conditions) for load in loads), conditions)


def _size_joint(
    load: JointLoad, candidates: Sequence[Motor] | None, conditions: Conditions
) -> JointSizing:
    """Compute the requirements and checks of one joint, and assess its candidate motors.

    Parameters
    ----------
    load : JointLoad
        Motion and load of the joint.
    candidates : sequence of Motor or None
        Candidate motors. With None, the present motor of the joint is assessed, and its alternative
        motors in addition.
    conditions : Conditions
        Operating conditions.

    Returns
    -------
    JointSizing
        Requirements and verdicts. The candidates are in ascending order of their nominal torque.
    """
    alternatives: list[MotorVerdict] = []
    if candidates is None:
        candidates = [] if load.motor is None else [load.motor]
        alternatives = [assess(load, motor, conditions) for motor in load.alternatives]
    verdicts = [assess(load, motor, conditions) for motor in candidates]
    verdicts.sort(key=lambda verdict: (verdict.motor.nominal_torque, verdict.motor.max_torque))
    case = gear_case(load, conditions)
    return JointSizing(
        load,
        motor_requirement(load),
        case.band,
        drive_checks(case),
        candidates=tuple(verdicts),
        alternatives=tuple(alternatives),
    )


LARGEST_PAYLOAD = 50.0
"""Largest payload in the search, kg. Surgical tools are much lighter."""
LARGEST_DURATION_FACTOR = 1e3
"""Largest factor on the duration in the search. The smallest one is its reciprocal."""
BISECTIONS = 20
"""Number of bisections in the search."""


@frozen
class WhatIf:
    """The result of a search for the largest payload or the shortest duration."""

    status: str
    """Outcome: "found", "never" (a check fails for every value) or "unlimited" (none ever fails).
    """
    value: float | None
    """Additional payload in kg, or factor on the duration. None unless the status is "found"."""
    joint: str | None
    """Joint of the check that fails first beyond this value, or None."""
    binds: str | None
    """Name of the check that fails first beyond this value, or None."""
    not_checked: tuple[str, ...]
    """Checks that could not be evaluated, such as "roll: heat"."""

    def to_dict(self) -> JsonObject:
        """Return the result as JSON types in SI units."""
        return {**vars(self), "not_checked": list(self.not_checked)}


def largest_payload(
    duty: DutyCycle, motors: Mapping[str, Motor], conditions: Conditions, payload: float = 0.0
) -> WhatIf:
    """Find the largest additional point mass at the tip with which every evaluated check passes.

    Parameters
    ----------
    duty : DutyCycle
        Motions of one robot.
    motors : mapping of str to Motor
        Motors by joint, which replace those of the robot.
    conditions : Conditions
        Operating conditions.
    payload : float
        Point mass that is at the tip already, kg.

    Returns
    -------
    WhatIf
        The largest additional mass, kg. The search ends at `LARGEST_PAYLOAD`.
    """
    empty = duty.loads(payload)
    loaded = duty.loads(payload + 1.0)

    def judge(mass: float) -> _SmallestMargin:
        """Find the smallest margin with an additional mass (kg) at the tip."""
        loads = [load.interpolate(target, mass) for load, target in zip(empty, loaded, strict=True)]
        return _find_smallest_margin(loads, motors, conditions)

    return _search_largest(judge, 1e-6, LARGEST_PAYLOAD)


def shortest_duration(
    duty: DutyCycle, motors: Mapping[str, Motor], conditions: Conditions, payload: float = 0.0
) -> WhatIf:
    """Find the smallest factor on the duration with which every evaluated check passes.

    The factor applies to the whole motion. The speed and acceleration limits of the joints are
    ignored.

    Parameters
    ----------
    duty : DutyCycle
        Motions of one robot.
    motors : mapping of str to Motor
        Motors by joint, which replace those of the robot.
    conditions : Conditions
        Operating conditions.
    payload : float
        Point mass at the tip, kg.

    Returns
    -------
    WhatIf
        The smallest factor, within the limits of `LARGEST_DURATION_FACTOR`.
    """

    loads = duty.loads(payload)

    def judge(speed: float) -> _SmallestMargin:
        """Find the smallest margin of the motion at a multiple of its speed."""
        stretched_loads = [load.stretched(1.0 / speed) for load in loads]
        return _find_smallest_margin(stretched_loads, motors, conditions)

    result = _search_largest(judge, 1.0 / LARGEST_DURATION_FACTOR, LARGEST_DURATION_FACTOR)
    if result.value is None:
        return result
    return replace(result, value=1.0 / result.value)


@frozen
class _SmallestMargin:
    """Smallest margin over all checks, its joint and check, and the checks without a margin."""

    margin: float
    joint: str | None
    binds: str | None
    not_checked: tuple[str, ...]


def _find_smallest_margin(
    loads: Sequence[JointLoad], motors: Mapping[str, Motor], conditions: Conditions
) -> _SmallestMargin:
    """Assess all loads and return the smallest margin of their checks.

    Parameters
    ----------
    loads : sequence of JointLoad
        Loads of the joints.
    motors : mapping of str to Motor
        Motors by joint, which replace those of the robot.
    conditions : Conditions
        Operating conditions.

    Returns
    -------
    _SmallestMargin
        The smallest margin, its joint and check, and the checks without a margin. The check of the
        confidence is excluded.
    """
    margin = float("inf")
    joint: str | None = None
    binds: str | None = None
    missing = []
    for load in loads:
        motor = motors.get(load.joint, load.motor)
        if motor is None:
            missing.append(f"{load.joint}: a motor")
            continue
        for check in assess(load, motor, conditions).all_checks:
            if check.margin is None:
                missing.append(f"{load.joint}: {check.name}")
            elif check.name != CONFIDENCE_CHECK and check.margin < margin:
                margin = check.margin
                joint = load.joint
                binds = check.name
    return _SmallestMargin(margin, joint, binds, tuple(missing))


def _search_largest(
    judge: Callable[[float], _SmallestMargin], lower: float, upper: float
) -> WhatIf:
    """Find the largest value with which no margin is negative, by bisection of its logarithm.

    The margins are assumed to decrease as the value increases.

    Parameters
    ----------
    judge : callable
        Function that returns the smallest margin for a value.
    lower, upper : float
        Ends of the search. The status is "never" if a margin is negative at `lower`, and
        "unlimited" if no margin is negative at `upper`.

    Returns
    -------
    WhatIf
        The value, and the check that fails just above it.
    """
    low = lower
    high = upper
    failed = judge(upper)
    if failed.margin >= 0:
        return WhatIf("unlimited", None, None, None, failed.not_checked)
    judgement = judge(lower)
    if judgement.margin < 0:
        return WhatIf("never", None, judgement.joint, judgement.binds, judgement.not_checked)
    for _ in range(BISECTIONS):
        middle = math.sqrt(low * high)
        judgement = judge(middle)
        if judgement.margin < 0:
            high = middle
            failed = judgement
        else:
            low = middle
    return WhatIf("found", low, failed.joint, failed.binds, failed.not_checked)
