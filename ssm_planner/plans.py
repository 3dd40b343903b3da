"""The outcome of planning, as later stages take it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ssm_planner.planning.planner import PlannedPhase
from ssm_planner.planning.reason import Reason
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import JOINTS
from ssm_planner.sizing.requirements import MotorRequirement
from ssm_planner.sizing.size import Sizing
from ssm_planner.trajectory import Trajectory
from ssm_planner.verification.certificate import Certificate


@dataclass(frozen=True, eq=False)
class Plan:
    """A planned motion with its certificate, or the reason why there is none.

    status: "solved", "infeasible" or "not converged". trajectory, certificate and sizing are None unless solved.
    """

    problem: Problem
    status: str
    trajectory: Trajectory | None
    phases: tuple[PlannedPhase, ...]
    certificate: Certificate | None
    sizing: Sizing | None
    """Of the robot's own motors and gears, the motion repeated without pause at 25 °C."""
    reason: Reason | None
    solve_time: float

    @property
    def passed(self) -> bool:
        """The plan exists and the independent check found every limit kept."""
        return self.certificate is not None and self.certificate.passed

    @property
    def duration(self) -> float | None:
        return None if self.trajectory is None else self.trajectory.duration

    @property
    def requirements(self) -> tuple[MotorRequirement, ...]:
        """What the motion requires of the motor of every driven joint."""
        return () if self.sizing is None else tuple(joint.requirement for joint in self.sizing.joints)

    @property
    def toppra_duration(self) -> float | None:
        durations = [phase.toppra_duration for phase in self.phases]
        known = [duration for duration in durations if duration is not None]
        return float(sum(known)) if self.trajectory is not None and len(known) == len(durations) else None

    @property
    def lower_bound(self) -> float | None:
        """A duration that no motion along the same path within the same limits can beat."""
        return None if self.trajectory is None else float(sum(phase.lower_bound for phase in self.phases))

    @property
    def gap(self) -> float | None:
        """(duration − lower bound) / lower bound."""
        if self.duration is None or not self.lower_bound:
            return None
        return (self.duration - self.lower_bound) / self.lower_bound

    @property
    def notes(self) -> tuple[str, ...]:
        """What the program does not know and the reader has to."""
        notes = []
        for requirement in self.requirements:
            motor = requirement.motor
            if motor is None:
                notes.append(f"joint {requirement.joint}: no motor given, its torque is not limited")
            elif motor.placeholder:
                notes.append(
                    f"joint {requirement.joint}: motor {motor.name} has placeholder figures ({', '.join(motor.placeholders)})"
                )
            notes += _extrapolation(self.problem, requirement)
        if self.certificate is not None:
            notes += [f"not checked: {what}" for what in self.certificate.unchecked]
        return tuple(notes)

    def summary(self) -> dict[str, Any]:
        """The object that `plan --json` prints; SI units, radians."""
        limits = [] if self.certificate is None else [limit.to_dict() for limit in self.certificate.limits]
        return {
            "status": self.status,
            "duration": self.duration,
            "lower_bound": self.lower_bound,
            "gap": self.gap,
            "toppra_duration": self.toppra_duration,
            "passed": self.passed,
            "solve_time": self.solve_time,
            "motors": [requirement.to_dict() for requirement in self.requirements],
            "sizing": None if self.sizing is None else self.sizing.to_dict(),
            "limits": limits,
            "reason": None if self.reason is None else self.reason.to_dict(),
            "notes": list(self.notes),
        }


def _extrapolation(problem: Problem, requirement: MotorRequirement) -> list[str]:
    drive = problem.robot.joints[JOINTS.index(requirement.joint)].drive
    if drive is None or drive.friction is None:
        return []
    known = drive.friction.identified_speed
    if known is None:
        return [f"joint {requirement.joint}: the drive file does not say up to which speed its friction was identified"]
    if requirement.peak_speed <= known:
        return []
    return [
        f"joint {requirement.joint}: friction extrapolated {requirement.peak_speed / known:.1f}× beyond the identified "
        f"speeds ({known:.3g} rad/s, used up to {requirement.peak_speed:.3g} rad/s)"
    ]
