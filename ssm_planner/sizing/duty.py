"""Define duty cycles, the motions for which motors are sized.

A duty cycle is either a planned motion or a set of strokes. A stroke moves one joint back and forth
at full acceleration, speed and deceleration. Its trajectory has a closed form.
"""

import math

import numpy as np

from ssm_planner.dynamics import with_payload
from ssm_planner.errors import ProblemError
from ssm_planner.problem import JOINTS, Motorisation, Problem, Robot, Stroke
from ssm_planner.sizing.joint_load import JointLoad, joint_loads
from ssm_planner.trajectory import DEGREE, Span, Trajectory
from ssm_planner.typing import record


def back_and_forth(stroke: Stroke) -> Trajectory:
    """Build the trajectory that moves a joint back and forth at full acceleration and speed.

    The joint moves from centre − reach to centre + reach and back, and all other joints are at
    rest. The phases are named "forth" and "back". Each has a trapezoidal velocity profile, or a
    triangular profile if the distance is too short to reach full speed.

    Parameters
    ----------
    stroke : Stroke
        Joint, centre and reach (rad or m), velocity, acceleration, and positions of the other
        joints.

    Returns
    -------
    Trajectory
        The motion forth and back, which starts at time 0.
    """
    joint = JOINTS.index(stroke.joint)
    acceleration = stroke.acceleration
    distance = 2 * stroke.reach
    # Durations of the acceleration and of the motion at constant speed.
    ramp = min(stroke.velocity / acceleration, math.sqrt(distance / acceleration))
    cruise = distance / stroke.velocity - ramp
    forth = [(ramp, acceleration), (cruise, 0.0), (ramp, -acceleration)]
    if cruise <= 0:
        del forth[1]
    pieces = forth + [(time, -value) for time, value in forth]
    breaks = np.cumsum([0.0, *(time for time, _ in pieces)])
    coefficients = np.zeros((len(pieces), DEGREE + 1, len(stroke.home)))
    coefficients[:, 0] = stroke.home
    position = stroke.centre - stroke.reach
    velocity = 0.0
    for piece, (time, value) in zip(coefficients, pieces, strict=True):
        piece[:3, joint] = position, velocity, value / 2
        position += velocity * time + value * time**2 / 2
        velocity += value * time
    middle = breaks[len(forth)]
    end = breaks[-1]
    phases = (Span("forth", 0.0, float(middle)), Span("back", float(middle), float(end)))
    return Trajectory(breaks, coefficients, phases)


PAUSE_OF_SINGLE_MOTION = 1e6
"""Pause after a motion that is performed only once, s. The motors cool down completely."""


def pause_after_motion(problem: Problem) -> float:
    """Return the pause after each repetition of a problem's motion.

    Parameters
    ----------
    problem : Problem
        Problem with its duty, which is None for a motion that is performed only once.

    Returns
    -------
    float
        Pause, s.
    """
    return PAUSE_OF_SINGLE_MOTION if problem.duty is None else problem.duty


@record
class DutyCycle:
    """Motions of one robot for which its motors are sized.

    In each entry of `runs`, the name None means that the motion sizes the motor of every joint with
    a drive.
    """

    name: str
    robot: Robot
    runs: tuple[tuple[Trajectory, str | None], ...]
    """Motions, each with the name of the joint whose motor it sizes."""
    notes: tuple[str, ...] = ()
    """Remarks on the motion for the reader of the result."""
    pause: float = 0.0
    """Pause between repetitions that the source of the motion states, s."""

    @classmethod
    def of_trajectory(
        cls, trajectory: Trajectory, robot: Robot, name: str = "motion"
    ) -> "DutyCycle":
        """Build a duty cycle from one motion, in which all joints are sized.

        Parameters
        ----------
        trajectory : Trajectory
            The motion.
        robot : Robot
            Robot that performs the motion.
        name : str
            Name for messages and results.

        Returns
        -------
        DutyCycle
            The duty cycle without a pause.
        """
        return cls(name, robot, ((trajectory, None),))

    @classmethod
    def of_motorisation(cls, motorisation: Motorisation) -> "DutyCycle":
        """Build a duty cycle that moves single joints back and forth.

        Parameters
        ----------
        motorisation : Motorisation
            Robot and strokes, that is, the joints with their ranges, speeds and accelerations.

        Returns
        -------
        DutyCycle
            The duty cycle with one motion for each stroke.
        """
        runs = tuple((back_and_forth(stroke), stroke.joint) for stroke in motorisation.strokes)
        return cls(motorisation.name, motorisation.robot, runs)

    def loads(self, payload: float = 0.0) -> tuple[JointLoad, ...]:
        """Compute the loads of all joints that the duty cycle sizes.

        Parameters
        ----------
        payload : float
            Point mass at the tool tip, kg.

        Returns
        -------
        tuple of JointLoad
            One load for each motion and each joint that the motion sizes.

        Raises
        ------
        ProblemError
            If a joint has a motor but no drive.
        """
        for joint in self.robot.joints:
            if joint.motor is not None and joint.drive is None:
                raise no_drive_error(joint.name, self.robot.file, joint.motor.name)
        robot = with_payload(self.robot, payload)
        return tuple(
            load
            for trajectory, joint in self.runs
            for load in joint_loads(trajectory, robot)
            if joint in (None, load.joint)
        )


def no_drive_error(joint: str, file: str | None = None, motor: str | None = None) -> ProblemError:
    """Build the error for a motor on a joint that has no drive or that does not exist.

    Parameters
    ----------
    joint : str
        Name of the joint.
    file : str, optional
        File of the robot.
    motor : str, optional
        Name of the motor.

    Returns
    -------
    ProblemError
        The error, which the caller raises.
    """
    if joint not in JOINTS:
        return ProblemError("no joint of this name", key=joint, allowed=", ".join(JOINTS))
    return ProblemError(
        "this joint has no drive, so no motor can move it",
        file=file,
        key=f"joints.{joint}.motor",
        value=motor,
        allowed="a joint with a drive",
    )
