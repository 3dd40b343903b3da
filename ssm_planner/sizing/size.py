"""Which motors and gears a motion needs, and what given ones allow.

Candidates on every joint, the smallest that suffices, one verdict; the largest payload at the tip and the shortest
duration of the motion with which every check still passes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ssm_planner.dynamics.spread import spread_of
from ssm_planner.errors import ProblemError
from ssm_planner.problem.motor import Motor
from ssm_planner.problem.robot import Robot
from ssm_planner.sizing.assess import CONFIDENCE, MotorVerdict, assess, band_of
from ssm_planner.sizing.checks import Case, Check, all_of, binding, gear_checks
from ssm_planner.sizing.demand import Band, DemandName
from ssm_planner.sizing.duty import DutyCycle, no_drive
from ssm_planner.sizing.joint_load import JointLoad, joint_loads
from ssm_planner.sizing.motor_limits import Conditions
from ssm_planner.sizing.requirements import MotorRequirement, motor_requirement
from ssm_planner.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class JointSizing:
    """What one joint requires, its gear, and its candidates in order of nominal torque."""

    load: JointLoad
    requirement: MotorRequirement
    band: Band
    gear: tuple[Check, ...]
    candidates: tuple[MotorVerdict, ...]
    alternatives: tuple[MotorVerdict, ...] = ()
    """Motors that the joint may have instead of its own: judged, but not part of the answer."""

    @property
    def smallest(self) -> MotorVerdict | None:
        """The candidate of least nominal torque that is shown to suffice."""
        return next((each for each in self.candidates if each.adequate is True), None)

    @property
    def adequate(self) -> bool | None:
        """Of the motors: True where one suffices, False where none can, None where that is not known."""
        answers = [each.adequate for each in self.candidates]
        if True in answers:
            return True
        return None if None in answers or not answers else False

    def gear_dict(self) -> dict[str, Any]:
        """An entry of `gears` in what `size --json` prints."""
        first = binding(self.gear)
        return {
            "joint": self.load.joint,
            "drive": self.load.drive.name,
            "adequate": all_of(check.passed for check in self.gear),
            "binds": None if first is None else first.name,
            "margins": {check.name: check.margin for check in self.gear},
            "not_checked": {check.name: check.needs for check in self.gear if check.passed is None},
            "placeholders": list(self.load.drive.placeholders),
        }

    def requirement_dict(self, confidence: float) -> dict[str, Any]:
        """An entry of `requirements` in what `size --json` prints; bands at a confidence."""
        names: tuple[DemandName, ...] = ("peak_torque", "rms_torque", "peak_effort")
        bands: dict[str, Any] = {
            name: [self.band.low(name, confidence), self.band.high(name, confidence)]
            if self.band.known
            else None
            for name in names
        }
        if self.band.smooth is not None:
            smooth = float(
                np.quantile(self.band.smooth.peak_torque, confidence, method="inverted_cdf")
            )
            bands["peak_torque_without_ripple"] = [self.band.low("peak_torque", confidence), smooth]
        return {**self.requirement.to_dict(), "band": bands}


@dataclass(frozen=True, eq=False)
class Sizing:
    """The answer for a motion: one entry per driven joint that moves in it."""

    joints: tuple[JointSizing, ...]
    conditions: Conditions

    @property
    def adequate(self) -> bool | None:
        """Every joint has a motor that suffices, and every gear holds; None where that is not known, or there is neither."""
        if not self.joints:
            return None
        gears = [check.passed for joint in self.joints for check in joint.gear]
        return all_of([*(joint.adequate for joint in self.joints), *gears])

    @property
    def verdicts(self) -> tuple[MotorVerdict, ...]:
        """Of every candidate on every joint."""
        return tuple(verdict for joint in self.joints for verdict in joint.candidates)

    @property
    def alternatives(self) -> tuple[MotorVerdict, ...]:
        """Of the motors that joints may have instead of their own."""
        return tuple(verdict for joint in self.joints for verdict in joint.alternatives)

    def to_dict(self) -> dict[str, Any]:
        """The object that `size --json` prints; SI units, radians, kelvin."""
        smallest = {joint.load.joint: joint.smallest for joint in self.joints}
        return {
            "adequate": self.adequate,
            "confidence": self.conditions.confidence,
            "motors": [verdict.to_dict() for verdict in self.verdicts],
            "alternatives": [verdict.to_dict() for verdict in self.alternatives],
            "gears": [joint.gear_dict() for joint in self.joints],
            "smallest": {
                name: None if best is None else best.motor.name for name, best in smallest.items()
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
    """Judge the motors of every joint that a duty moves, repeated for ever under the conditions.

    candidates: motors by joint name; joints not named there are judged with their own motor. payload: point mass at the
    tip, kg. Raises ProblemError for candidates of a joint without a drive.
    """
    conditions = conditions or Conditions()
    given = dict(candidates or {})
    loads = duty.loads(payload)
    moved, driven = (
        {load.joint for load in loads},
        {joint.name for joint in duty.robot.joints if joint.drive is not None},
    )
    for joint in given:
        if joint not in driven:
            raise no_drive(joint, duty.robot.file)
        if joint not in moved:
            raise ProblemError(
                f"{duty.name} does not move this joint", key=joint, allowed=", ".join(sorted(moved))
            )
    return Sizing(
        tuple(_joint(load, given.get(load.joint), conditions) for load in loads), conditions
    )


def size_motion(trajectory: Trajectory, robot: Robot, pause: float = 0.0) -> Sizing:
    """Judge the robot's own motors by a motion repeated after a pause (s) at 25 °C; joints without a drive are left out."""
    conditions = Conditions(pause=pause)
    return Sizing(
        tuple(_joint(load, None, conditions) for load in joint_loads(trajectory, robot)), conditions
    )


def _joint(
    load: JointLoad, candidates: Sequence[Motor] | None, conditions: Conditions
) -> JointSizing:
    others = load.alternatives if candidates is None else ()
    if candidates is None:
        candidates = [] if load.motor is None else [load.motor]
    verdicts, alternatives = (
        [assess(load, motor, conditions) for motor in each] for each in (candidates, others)
    )
    verdicts.sort(key=lambda verdict: (verdict.motor.nominal_torque, verdict.motor.max_torque))
    spread = spread_of(load.drive, conditions.spread)
    band = band_of(load, None, spread, conditions)
    gear = gear_checks(Case(load, band, spread, conditions))
    return JointSizing(
        load,
        motor_requirement(load),
        band,
        gear,
        candidates=tuple(verdicts),
        alternatives=tuple(alternatives),
    )


HEAVIEST = 50.0
"""kg at the tip; motors that carry more are not what limits a surgical tool."""
SLOWEST, FASTEST = 1e3, 1e-3
"""Factors on the duration between which an answer is looked for."""
HALVINGS = 16


@dataclass(frozen=True)
class WhatIf:
    """status: "found", "never" (the motors do not suffice for any value) or "unlimited" (nothing checked binds).

    value: kg, or factor on the duration; None unless found. joint, binds: what would be exceeded first beyond it.
    """

    status: str
    value: float | None
    joint: str | None
    binds: str | None
    not_checked: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        return {
            "status": self.status,
            "value": self.value,
            "joint": self.joint,
            "binds": self.binds,
            "not_checked": list(self.not_checked),
        }


def largest_payload(
    duty: DutyCycle, motors: Mapping[str, Motor], conditions: Conditions, payload: float = 0.0
) -> WhatIf:
    """The heaviest point mass at the tip, beside `payload` (kg), with which every check that can be made still passes."""
    empty, loaded = duty.loads(payload), duty.loads(payload + 1.0)

    def judge(mass: float) -> _Judgement:
        return _judge(
            [a.plus(b, mass) for a, b in zip(empty, loaded, strict=True)], motors, conditions
        )

    return _largest(judge, start=1e-3, most=HEAVIEST, least=0.0)


def shortest_duration(
    duty: DutyCycle, motors: Mapping[str, Motor], conditions: Conditions, payload: float = 0.0
) -> WhatIf:
    """The smallest factor on the duration, all of the motion faster alike, with which every check made still passes.

    The joints' own limits of speed and acceleration are left aside.
    """

    loads = duty.loads(payload)

    def judge(speed: float) -> _Judgement:
        return _judge([load.stretched(1.0 / speed) for load in loads], motors, conditions)

    found = _largest(judge, start=1.0, most=1.0 / FASTEST, least=1.0 / SLOWEST)
    return replace(found, value=None if found.value is None else 1.0 / found.value)


@dataclass(frozen=True)
class _Judgement:
    margin: float
    joint: str | None
    binds: str | None
    not_checked: tuple[str, ...]


def _judge(
    loads: Sequence[JointLoad], motors: Mapping[str, Motor], conditions: Conditions
) -> _Judgement:
    """The smallest margin of all checks that can be made."""
    worst: tuple[float, str | None, str | None] = (float("inf"), None, None)
    missing = []
    for load in loads:
        motor = motors.get(load.joint, load.motor)
        if motor is None:
            missing.append(f"{load.joint}: a motor")
            continue
        verdict = assess(load, motor, conditions)
        for check in (*verdict.checks, *verdict.gear):
            if check.margin is None:
                missing.append(f"{load.joint}: {check.name}")
            elif check.name != CONFIDENCE:
                worst = min(worst, (check.margin, load.joint, check.name), key=lambda each: each[0])
    return _Judgement(*worst, tuple(missing))


def _largest(
    judge: Callable[[float], _Judgement], start: float, most: float, least: float
) -> WhatIf:
    """Largest value up to which no margin is negative: doubled or halved from `start`, then bisected."""
    at = judge(start)
    low, high = start, start
    if at.margin < 0:
        while at.margin < 0:
            high, failed = low, at
            if low <= least:
                return WhatIf("never", None, at.joint, at.binds, at.not_checked)
            low = low / 2 if least > 0 or low > start / 64 else 0.0
            low = max(low, least)
            at = judge(low)
    else:
        while at.margin >= 0:
            low = high
            if high >= most:
                return WhatIf("unlimited", None, None, None, at.not_checked)
            high = min(2 * high, most)
            at = judge(high)
        failed = at
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        at = judge(middle)
        if at.margin < 0:
            high, failed = middle, at
        else:
            low = middle
    return WhatIf("found", low, failed.joint, failed.binds, failed.not_checked)
