"""What motors are sized for: a planned motion as a whole, or single joints moved one at a time."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ssm_planner.errors import ProblemError
from ssm_planner.model.trajectory import Trajectory
from ssm_planner.problem.motorisation import Motorisation
from ssm_planner.problem.values import JOINTS, Robot, frozen
from ssm_planner.sizing.joint_load import RATE, JointLoad, joint_loads
from ssm_planner.sizing.strokes import back_and_forth


@dataclass(frozen=True, eq=False)
class Duty:
    """Motions of one robot, each for one joint (by name) or for all that have a drive (None)."""

    name: str
    robot: Robot
    runs: tuple[tuple[Trajectory, str | None], ...]
    notes: tuple[str, ...] = ()
    """What the reader of the answer has to know of the motion."""

    @classmethod
    def of_trajectory(cls, trajectory: Trajectory, robot: Robot, name: str = "motion") -> Duty:
        """A whole motion."""
        return cls(name, robot, ((trajectory, None),))

    @classmethod
    def of_motorisation(cls, motorisation: Motorisation) -> Duty:
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


def with_payload(robot: Robot, mass: float) -> Robot:
    """The robot with a point mass (kg) at the tool tip, the origin of the last body's frame. Raises ProblemError."""
    if mass == 0.0:
        return robot
    if not mass > 0.0:
        raise ProblemError("not a mass", key="payload", value=mass, allowed="0 kg or more")
    first, second, third, tool = robot.bodies
    total = tool.mass + mass
    com = frozen(tool.com * tool.mass / total, (3,))
    return replace(robot, bodies=(first, second, third, replace(tool, mass=total, com=com)))


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
