"""One joint back and forth at full acceleration, full speed, full deceleration: a trajectory in closed form.

What motors are sized for: a planned motion as a whole, or single joints moved one at a time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ssm_planner.dynamics.rigid_body import with_payload
from ssm_planner.errors import ProblemError
from ssm_planner.problem.motion import Motorisation, Stroke
from ssm_planner.problem.problem import Problem
from ssm_planner.problem.robot import JOINTS, Robot
from ssm_planner.sizing.joint_load import RATE, JointLoad, joint_loads
from ssm_planner.trajectory import DEGREE, Span, Trajectory
from ssm_planner.typing import Array


def back_and_forth(stroke: Stroke) -> Trajectory:
    """From centre − reach to centre + reach and back, all other joints held; two phases, "forth" and "back".

    Each way is a trapezoid of speed, or a triangle where the distance is too short to reach full speed.
    """
    joint = JOINTS.index(stroke.joint)
    times, distance = (
        _timing(2 * stroke.reach, stroke.velocity, stroke.acceleration),
        2 * stroke.reach,
    )
    home = np.array(stroke.home, dtype=float)
    home[joint] = stroke.centre - stroke.reach
    forth = _way(home, joint, times, stroke.acceleration)
    turned = home.copy()
    turned[joint] += distance
    back = _way(turned, joint, times, -stroke.acceleration)
    breaks = np.concatenate([[0.0], np.cumsum(np.concatenate([times, times]))])
    middle, end = float(breaks[len(times)]), float(breaks[-1])
    phases = (Span("forth", 0.0, middle), Span("back", middle, end))
    return Trajectory(breaks, np.concatenate([forth, back]), phases)


def _timing(distance: float, velocity: float, acceleration: float) -> Array:
    """Durations of accelerating, cruising (left out where there is none) and decelerating, s."""
    ramp = velocity / acceleration
    cruise = distance / velocity - ramp
    if cruise <= 0:
        ramp = math.sqrt(distance / acceleration)
        return np.array([ramp, ramp])
    return np.array([ramp, cruise, ramp])


def _way(start: Array, joint: int, times: Array, acceleration: float) -> Array:
    """Coefficients (pieces, 6, 4) of one way, from rest to rest."""
    signs = np.array([1.0, -1.0]) if len(times) == 2 else np.array([1.0, 0.0, -1.0])
    coefficients = np.zeros((len(times), DEGREE + 1, len(start)))
    coefficients[:, 0] = start
    position, velocity = start[joint], 0.0
    for i, (sign, time) in enumerate(zip(signs, times, strict=True)):
        bend = sign * acceleration
        coefficients[i, :3, joint] = position, velocity, bend / 2
        position += velocity * time + bend * time**2 / 2
        velocity += bend * time
    return coefficients


ONCE = 1e6
"""Pause, s, after which motors are as cold as their surroundings: of a motion that is done once."""


def pause_of(problem: Problem) -> float:
    """The pause that a problem's duty leaves its motors, s."""
    return ONCE if problem.duty is None else problem.duty


@dataclass(frozen=True, eq=False)
class DutyCycle:
    """Motions of one robot, each for one joint (by name) or for all that have a drive (None)."""

    name: str
    robot: Robot
    runs: tuple[tuple[Trajectory, str | None], ...]
    notes: tuple[str, ...] = ()
    """What the reader of the answer has to know of the motion."""
    pause: float = 0.0
    """Before the motion repeats, where what it was read from says so, s."""

    @classmethod
    def of_trajectory(cls, trajectory: Trajectory, robot: Robot, name: str = "motion") -> DutyCycle:
        """A whole motion."""
        return cls(name, robot, ((trajectory, None),))

    @classmethod
    def of_motorisation(cls, motorisation: Motorisation) -> DutyCycle:
        """Single joints back and forth."""
        runs = tuple((back_and_forth(stroke), stroke.joint) for stroke in motorisation.strokes)
        return cls(motorisation.name, motorisation.robot, runs)

    def loads(self, payload: float = 0.0, rate: float = RATE) -> tuple[JointLoad, ...]:
        """Loads of the joints, with a point mass (kg) at the tool tip.

        Raises ProblemError for a motor on a joint without a drive: nothing connects it to the joint.
        """
        for joint in self.robot.joints:
            if joint.motor is not None and joint.drive is None:
                raise no_drive(joint.name, self.robot.file, joint.motor.name)
        robot = with_payload(self.robot, payload)
        return tuple(
            load
            for trajectory, joint in self.runs
            for load in joint_loads(trajectory, robot, rate)
            if joint in (None, load.joint)
        )


def no_drive(joint: str, file: str | None = None, motor: str | None = None) -> ProblemError:
    """The error for a motor on a joint that has no drive."""
    if joint not in JOINTS:
        return ProblemError("no joint of this name", key=joint, allowed=", ".join(JOINTS))
    return ProblemError(
        "this joint has no drive, so no motor can move it",
        file=file,
        key=f"joints.{joint}.motor",
        value=motor,
        allowed="a joint with a drive",
    )
