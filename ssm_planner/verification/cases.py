"""Worst cases within a range of friction and payload.

The candidates are the outermost sets of friction parameters (`FrictionSpread.within`), each with
an empty tip, the smallest and the largest payload. The module evaluates their motor torques at
both ends of every piece and at evenly spaced instants. It selects the candidates with the largest
torque in either direction, and those with the largest mean square torque. The check then
evaluates these candidates as closely as the nominal robot. It does not use the cases that the
planner selects.
"""

from itertools import starmap

import numpy as np

from ssm_planner.dynamics import (
    RigidBody,
    drive_torque,
    drive_with,
    motorised,
    spread_of,
    with_payload,
)
from ssm_planner.errors import ProblemError
from ssm_planner.problem import FRICTION_LAWS, LAW_COLUMN, Drive, MotorTorque, Robot, TaskLimits
from ssm_planner.trajectory import Trajectory, blocks
from ssm_planner.typing import Array, Arrays, Indices
from ssm_planner.verification.limits import LimitedQuantity, WorstCase
from ssm_planner.verification.pieces import piece_blocks
from ssm_planner.verification.sampled_extremes import SampledIntervals

EVALUATED_INSTANTS = 250
"""Number of evenly spaced instants that are evaluated with every set.

As many instants with the largest nominal torque are added.
"""
MAX_SAMPLING_RATE = 1e6
"""Largest sampling rate, Hz. It limits the number of instants in short pieces."""
INTERVAL_FRACTIONS = np.array([[0.0], [0.5], [1.0]])
"""Instants in every interval in which no joint reverses, as fractions of its width."""
TORQUES_PER_BLOCK = 400_000
"""Number of torques that are evaluated together."""


def worst_case_torques(
    trajectory: Trajectory, robot: Robot, limits: TaskLimits
) -> list[LimitedQuantity]:
    """Return the motor torques of the worst cases.

    Parameters
    ----------
    trajectory : Trajectory
        The motion.
    robot : Robot
        The nominal robot. Its drives state the uncertainty of their friction.
    limits : TaskLimits
        The ranges of friction and payload that the motion must be valid for.

    Returns
    -------
    list of LimitedQuantity
        Quantities with their case. The list is empty if the limits require no range.

    Raises
    ------
    ProblemError
        If a range of friction is required and a drive does not state its uncertainty.
    """
    if limits.friction is None and limits.payload is None:
        return []
    masses = sorted({0.0, *(limits.payload or ())})
    motion = _SampledMotion(trajectory, robot, masses)
    quantities: list[LimitedQuantity] = []
    for i, drive, _ in motorised(robot.joints):
        joint = robot.joints[i]
        sets = {} if drive.friction is None else {"mu": np.array([drive.friction.mu])}
        if limits.friction is not None:
            uncertain = spread_of(drive).within(limits.friction)
            if not uncertain:
                raise ProblemError(
                    f"the friction of {drive.name} (joint {joint.name}) has no uncertainty",
                    key="friction",
                    value=limits.friction,
                    allowed="drives with posterior, covariance or friction_ranges",
                )
            sets = _extreme_parameter_sets(uncertain)
        extreme_sets: set[tuple[int, int]] = set()
        for load in range(len(masses)):
            extreme_sets |= motion.extreme_sets(i, drive, sets, load)
        for k, load in sorted(extreme_sets):
            mass = masses[load]
            values = {name: float(column[k]) for name, column in sets.items()}
            texts = starmap(_parameter_text, values.items())
            descriptions = [", ".join(texts)] if limits.friction else []
            if limits.payload:
                descriptions.append(f"payload {1e3 * mass:g} g")
            case = WorstCase(drive_with(drive, values), mass, "; ".join(descriptions))
            quantities.append(LimitedQuantity(joint.limit(MotorTorque), i, case=case))
    return quantities


def _parameter_text(name: str, value: float) -> str:
    """Describe the value of a friction parameter, such as “mu 0.12”."""
    return f"{name} {FRICTION_LAWS[int(value)]}" if name == LAW_COLUMN else f"{name} {value:.4g}"


def _extreme_parameter_sets(sets: Arrays) -> Arrays:
    """Select the sets of friction parameters that can cause the largest or the smallest torque.

    The torque in the direction of motion grows with every parameter except for `b_oc` and `b_ov`.
    They reduce a load in this direction, and a self-locking drive then needs less torque. A set can
    therefore have the largest torque only if no other set with the same `b_oc` and `b_ov` is larger
    in every other parameter, and the smallest torque only if no such set is smaller. The function
    keeps both kinds of sets. It does not compare sets with different friction laws.

    Parameters
    ----------
    sets : dict of (n,) arrays
        Values of each friction parameter in n sets, by name of the parameter.

    Returns
    -------
    dict of (k,) arrays
        The values in the selected sets.
    """
    values = np.unique(np.column_stack(list(sets.values())), axis=0)
    only_equal = LAW_COLUMN, "b_oc", "b_ov"
    dominates = np.ones((len(values), len(values)), dtype=bool)
    for name, column in zip(sets, values.T, strict=True):
        dominates &= column[:, None] == column if name in only_equal else column[:, None] >= column
    np.fill_diagonal(dominates, False)
    outer = values[~dominates.any(axis=0) | ~dominates.any(axis=1)]
    return dict(zip(sets, outer.T, strict=True))


class _SampledMotion:
    """A motion that is sampled at n instants, to compare the torques of many friction sets.

    The instants include both ends of every piece.

    Attributes
    ----------
    qd, qdd : (n, 4) arrays
        Joint velocities and accelerations at the n instants.
    direction : (n, 4) array
        Direction of each joint: −1, 0 or 1.
    start : (n, 4) array of bool
        True if the joint starts from rest at the instant, where its friction is static.
    tau : list of (n, 4) arrays
        Joint torques without friction for each payload.
    """

    def __init__(self, trajectory: Trajectory, robot: Robot, masses: list[float]) -> None:
        """Sample a motion, and compute the joint torques for each payload in `masses`, kg."""
        max_intervals = max(EVALUATED_INSTANTS // (len(trajectory.breaks) - 1), 1)
        blocks = []
        for pieces in piece_blocks(trajectory):
            intervals = SampledIntervals.from_segments(
                pieces,
                robot,
                *pieces.split_at_reversals(robot),
                rate=MAX_SAMPLING_RATE,
                max_intervals=max_intervals,
            )
            s = intervals.begin + INTERVAL_FRACTIONS * intervals.width
            q, qd, qdd = pieces.evaluate(intervals.piece, s)
            starting = intervals.starting * (INTERVAL_FRACTIONS[:, :, None] == 0)
            direction = np.broadcast_to(intervals.direction, starting.shape)
            blocks.append(np.stack([q, qd, qdd, direction, starting]).reshape(5, -1, 4))
        q, self.qd, self.qdd, self.direction, start = np.concatenate(blocks, axis=1)
        self.start = start > 0
        bodies = (RigidBody.from_robot(with_payload(robot, mass)) for mass in masses)
        self.tau = [body.inverse_dynamics(q, self.qd, self.qdd) for body in bodies]

    def torque(self, i: int, drive: Drive, load: int, instants: Indices) -> Array:
        """Return the motor torque (sets, instants) of a joint.

        Parameters
        ----------
        i : int
            Index of the joint.
        drive : Drive
            Its drive. Its friction parameters may be columns (sets, 1).
        load : int
            Index of the payload.
        instants : (instants,) array
            Indices of the instants.
        """
        motion = (
            self.tau[load][instants, i],
            self.qd[instants, i],
            self.qdd[instants, i],
            self.direction[instants, i],
        )
        return np.atleast_2d(drive_torque(drive, *motion, breakaway=self.start[instants, i])[0])

    def extreme_sets(self, i: int, drive: Drive, sets: Arrays, load: int) -> set[tuple[int, int]]:
        """Return the cases with extreme motor torques of one joint.

        A case is a pair (index of the set, index of the payload). The result contains the cases
        with the largest torque, the smallest torque and the largest mean square torque for this
        payload. The sets are evaluated at `EVALUATED_INSTANTS` evenly spaced instants, at as many
        instants with the largest nominal torque, and at all starts from rest.

        Parameters
        ----------
        i : int
            Index of the joint.
        drive : Drive
            Its drive with nominal friction.
        sets : dict of (sets,) arrays
            Friction parameters by name.
        load : int
            Index of the payload.
        """
        all_instants = np.arange(len(self.qd))
        nominal = np.abs(self.torque(i, drive, load, all_instants)[0])
        evenly_spaced = all_instants[:: max(len(all_instants) // EVALUATED_INSTANTS, 1)]
        largest_torques = np.argsort(nominal)[-EVALUATED_INSTANTS:]
        starts = np.flatnonzero(self.start[:, i])
        instants = np.unique(np.concatenate([evenly_spaced, largest_torques, starts]))
        block_size = max(TORQUES_PER_BLOCK // len(instants), 1)
        set_count = len(next(iter(sets.values())))
        tables = []
        for block in blocks(set_count, block_size):
            columns = {name: column[block, None] for name, column in sets.items()}
            torque = self.torque(i, drive_with(drive, columns), load, instants)
            mean_square = np.square(torque).mean(axis=1)
            tables.append(np.stack([torque.max(axis=1), -torque.min(axis=1), mean_square], axis=1))
        return {(int(k), load) for k in np.argmax(np.concatenate(tables), axis=0)}
