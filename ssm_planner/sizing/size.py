"""Which motors and gears a motion needs: candidates on every joint, the smallest that suffices, one verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ssm_planner.errors import ProblemError
from ssm_planner.problem.motor import Motor
from ssm_planner.problem.robot import Robot
from ssm_planner.sizing.assess import MotorVerdict, assess, band_of
from ssm_planner.sizing.demand import Band, Name
from ssm_planner.sizing.duty import DutyCycle, no_drive
from ssm_planner.sizing.friction_spread import spread_of
from ssm_planner.sizing.gear import gear_checks
from ssm_planner.sizing.joint_load import JointLoad, joint_loads
from ssm_planner.sizing.motor_limits import Conditions
from ssm_planner.sizing.requirements import MotorRequirement, motor_requirement
from ssm_planner.sizing.verdict import Check, all_of, binding
from ssm_planner.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class JointSizing:
    """What one joint requires, its gear, and its candidates in order of nominal torque."""

    load: JointLoad
    requirement: MotorRequirement
    band: Band
    gear: tuple[Check, ...]
    candidates: tuple[MotorVerdict, ...]

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
        names: tuple[Name, ...] = ("peak_torque", "rms_torque", "peak_effort")
        bands = {
            name: [self.band.low(name, confidence), self.band.high(name, confidence)] if self.band.known else None
            for name in names
        }
        return {**self.requirement.to_dict(), "band": bands}


@dataclass(frozen=True, eq=False)
class Sizing:
    """The answer for a motion: one entry per driven joint that moves in it."""

    joints: tuple[JointSizing, ...]
    conditions: Conditions

    @property
    def adequate(self) -> bool | None:
        """Every joint has a motor that suffices, and every gear holds; None where that is not known."""
        gears = [check.passed for joint in self.joints for check in joint.gear]
        return all_of([*(joint.adequate for joint in self.joints), *gears])

    @property
    def verdicts(self) -> tuple[MotorVerdict, ...]:
        return tuple(verdict for joint in self.joints for verdict in joint.candidates)

    def to_dict(self) -> dict[str, Any]:
        """The object that `size --json` prints; SI units, radians, kelvin."""
        smallest = {joint.load.joint: joint.smallest for joint in self.joints}
        return {
            "adequate": self.adequate,
            "confidence": self.conditions.confidence,
            "motors": [verdict.to_dict() for verdict in self.verdicts],
            "gears": [joint.gear_dict() for joint in self.joints],
            "smallest": {name: None if best is None else best.motor.name for name, best in smallest.items()},
            "requirements": [joint.requirement_dict(self.conditions.confidence) for joint in self.joints],
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
            raise ProblemError(f"{duty.name} does not move this joint", key=joint, allowed=", ".join(sorted(moved)))
    return Sizing(tuple(_joint(load, given.get(load.joint), conditions) for load in loads), conditions)


def size_motion(trajectory: Trajectory, robot: Robot) -> Sizing:
    """Judge the robot's own motors by a motion repeated without pause at 25 °C; joints without a drive are not looked at."""
    conditions = Conditions()
    return Sizing(tuple(_joint(load, None, conditions) for load in joint_loads(trajectory, robot)), conditions)


def _joint(load: JointLoad, candidates: Sequence[Motor] | None, conditions: Conditions) -> JointSizing:
    if candidates is None:
        candidates = [] if load.motor is None else [load.motor]
    verdicts = [assess(load, motor, conditions) for motor in candidates]
    verdicts.sort(key=lambda verdict: (verdict.motor.nominal_torque, verdict.motor.max_torque))
    spread = spread_of(load.drive, conditions.spread)
    band = band_of(load, None, spread, conditions)
    return JointSizing(
        load, motor_requirement(load), band, gear_checks(load, band, spread, conditions), tuple(verdicts)
    )
