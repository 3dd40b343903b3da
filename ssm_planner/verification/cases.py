"""Of a range of friction and payload, the cases in which a motion asks most of its motors.

Every outermost set of friction parameters that spans the range (`FrictionSpread.within`), with an empty tip, the least and
the largest payload, at both ends of every piece and evenly between: the sets for which the torque of a motor, either way, or
its mean square is largest are then looked at as closely as the robot's own torques. The planner's corners are not used.
"""

from __future__ import annotations

from itertools import starmap

import numpy as np

from ssm_planner.dynamics.motors import directions, drive_torque
from ssm_planner.dynamics.rigid_body import RigidBody, with_payload
from ssm_planner.dynamics.spread import drawn, spread_of
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.limits import MotorTorque
from ssm_planner.problem.posterior import LAW, LAWS
from ssm_planner.problem.problem import TaskLimits
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, Indices
from ssm_planner.verification.limits import Case, Quantity

INSTANTS = 250
"""Looked at with every set: evenly spread ones, and as many at which the stated friction takes most."""
BLOCK = 400_000
"""Torques evaluated at once."""


def worst_cases(trajectory: Trajectory, robot: Robot, limits: TaskLimits) -> list[Quantity]:
    """Motor torques in the worst cases; none where no range is asked for."""
    if limits.friction is None and limits.payload is None:
        return []
    masses = sorted({0.0, *(limits.payload or ())})
    motion = _Motion(trajectory, robot, masses)
    found: list[Quantity] = []
    for i, joint in enumerate(robot.joints):
        if joint.drive is None or joint.motor is None:
            continue
        sets = (
            {"mu": np.array([joint.drive.friction.mu])} if joint.drive.friction is not None else {}
        )
        if limits.friction is not None:
            sets = _outermost(spread_of(joint.drive).within(limits.friction))
        for k, mass in sorted(
            {
                case
                for load in range(len(masses))
                for case in motion.worst(i, joint.drive, sets, load)
            }
        ):
            values = {name: float(column[k]) for name, column in sets.items()}
            words = ", ".join(starmap(_said, values.items())) if limits.friction else ""
            payload = f"payload {1e3 * masses[mass]:g} g" if limits.payload else ""
            case = Case(
                drawn(joint.drive, values), masses[mass], "; ".join(filter(None, (words, payload)))
            )
            found.append(Quantity(joint.limit(MotorTorque), i, case=case))
    return found


def _said(name: str, value: float) -> str:
    return f"{name} {LAWS[int(value)]}" if name == LAW else f"{name} {value:.4g}"


def _outermost(sets: dict[str, Array]) -> dict[str, Array]:
    """The sets of parameters (sets,) that no other exceeds in all of them, or none is below in all.

    The torque in the direction of motion grows with every one of them, by one law.
    """
    values = np.unique(np.column_stack(list(sets.values())), axis=0)
    more = np.ones((len(values), len(values)), dtype=bool)
    for name, column in zip(sets, values.T, strict=True):
        more &= column[:, None] == column if name == LAW else column[:, None] >= column
    np.fill_diagonal(more, False)
    outer = values[~more.any(axis=0) | ~more.any(axis=1)]
    return dict(zip(sets, outer.T, strict=True))


class _Motion:
    """A motion at instants of which the ends of every piece are some."""

    def __init__(self, trajectory: Trajectory, robot: Robot, masses: list[float]) -> None:
        lengths = np.diff(trajectory.breaks)
        inner = max(INSTANTS // len(lengths), 1)
        share = np.tile(
            np.concatenate([[0.0], np.arange(1, inner + 1) / (inner + 1), [1.0]]), len(lengths)
        )
        piece = np.repeat(np.arange(len(lengths)), inner + 2)
        samples = trajectory.sample_pieces(piece, share * lengths[piece])
        after, starting = directions(robot, samples, 1)
        before, _ = directions(robot, samples, -1)
        self.way = np.where(share[:, None] == 1.0, before, after)
        self.start = np.where(share[:, None] == 0.0, starting, 0.0) > 0
        self.qd, self.qdd = samples.qd, samples.qdd
        bodies = (RigidBody.from_robot(with_payload(robot, mass)) for mass in masses)
        self.tau = [body.inverse_dynamics(samples.q, samples.qd, samples.qdd) for body in bodies]

    def torque(self, i: int, drive: Drive, load: int, at: Indices) -> Array:
        """(sets, instants) of joint i; of a drive with columns (sets, 1)."""
        motion = self.tau[load][at, i], self.qd[at, i], self.qdd[at, i], self.way[at, i]
        return np.atleast_2d(drive_torque(drive, *motion, breakaway=self.start[at, i])[0])

    def worst(
        self, i: int, drive: Drive, sets: dict[str, Array], load: int
    ) -> set[tuple[int, int]]:
        """(set, load) at which the torque is largest, smallest, and largest in the mean."""
        whole = np.arange(len(self.qd))
        stated = np.abs(self.torque(i, drive, load, whole)[0])
        step = max(len(whole) // INSTANTS, 1)
        at = np.unique(
            np.concatenate(
                [whole[::step], np.argsort(stated)[-INSTANTS:], np.flatnonzero(self.start[:, i])]
            )
        )
        rows = max(BLOCK // len(at), 1)
        tables = []
        for first in range(0, len(next(iter(sets.values()))), rows):
            columns = {name: column[first : first + rows, None] for name, column in sets.items()}
            torque = self.torque(i, drawn(drive, columns), load, at)
            tables.append(
                np.column_stack(
                    [torque.max(axis=1), -torque.min(axis=1), np.square(torque).mean(axis=1)]
                )
            )
        return {(int(k), load) for k in np.argmax(np.concatenate(tables), axis=0)}
