"""Worst cases of motor torques within a range of friction and payload.

A problem may require that the motor torques hold for uncertain friction and for a range of
payloads. A parameter set is one combination of values of the friction parameters of a drive. The
candidates for the worst case are the outermost parameter sets, each with an empty tip, the smallest
and the largest payload.

`worst_case_torques` evaluates the motor torques of all candidates at selected instants. It keeps
the candidates with the largest torque in either direction and those with the largest mean square
torque. `check` then evaluates these candidates as closely as the nominal robot. It does not use the
worst cases that the planner selects.
"""

from itertools import starmap

import numpy as np

from ssm_planner.dynamics import (
    RigidBody,
    drive_torque,
    drive_with_values,
    friction_spread,
    motorised_joints,
    with_payload,
)
from ssm_planner.errors import ProblemError
from ssm_planner.problem import (
    FRICTION_LAWS,
    LAW_COLUMN,
    Drive,
    Joint,
    MotorTorque,
    Robot,
    TaskLimits,
)
from ssm_planner.trajectory import Trajectory, blocks
from ssm_planner.typing import Array, Arrays, Indices
from ssm_planner.verification.limits import LimitedQuantity, WorstCase
from ssm_planner.verification.pieces import piece_blocks
from ssm_planner.verification.sampled_extremes import SampledIntervals

EVALUATED_INSTANTS = 250
"""Approximate number of evenly spaced instants at which every parameter set is evaluated.

As many instants with the largest nominal torque are added.
"""
MAX_SAMPLING_RATE = 1e6
"""Sampling rate that no piece of the motion exceeds, Hz. Very short pieces get fewer instants."""
INTERVAL_FRACTIONS = np.array([[0.0], [0.5], [1.0]])
"""Sampling instants in an interval without reversal of a joint, as fractions of its width."""
TORQUES_PER_BLOCK = 400_000
"""Approximate number of torques that are evaluated together, which bounds the memory."""


def worst_case_torques(
    trajectory: Trajectory, robot: Robot, limits: TaskLimits
) -> list[LimitedQuantity]:
    """Select the combinations of friction and payload with the largest torque of each motor.

    Parameters
    ----------
    trajectory : Trajectory
        The motion.
    robot : Robot
        The nominal robot. Its drives must state the uncertainty of their friction if a range of it
        is required.
    limits : TaskLimits
        The ranges of friction and payload that the motion must be valid for.

    Returns
    -------
    list of LimitedQuantity
        Motor torques with their `WorstCase`, which `check` evaluates like other quantities. The
        list is empty if the limits require no range of friction or payload.

    Raises
    ------
    ProblemError
        If a range of friction is required and a drive does not state its uncertainty.
    """
    if limits.friction is None and limits.payload is None:
        return []
    # Payloads in kg: an empty tip, and both ends of the range if the task states one.
    masses = sorted({0.0, *(limits.payload or ())})
    motion = _SampledMotion(trajectory, robot, masses)
    quantities: list[LimitedQuantity] = []
    for i, drive, _ in motorised_joints(robot.joints):
        joint = robot.joints[i]
        parameter_sets = _candidate_parameter_sets(drive, joint, limits.friction)
        extreme_sets: set[tuple[int, int]] = set()
        for payload_index in range(len(masses)):
            extreme_sets |= motion.extreme_sets(i, drive, parameter_sets, payload_index)
        for set_index, payload_index in sorted(extreme_sets):
            mass = masses[payload_index]
            values = {name: float(column[set_index]) for name, column in parameter_sets.items()}
            descriptions = []
            if limits.friction:
                descriptions.append(", ".join(starmap(_parameter_text, values.items())))
            if limits.payload:
                descriptions.append(f"payload {1e3 * mass:g} g")
            case = WorstCase(drive_with_values(drive, values), mass, "; ".join(descriptions))
            quantities.append(LimitedQuantity(joint.limit(MotorTorque), i, case=case))
    return quantities


def _candidate_parameter_sets(drive: Drive, joint: Joint, confidence: float | None) -> Arrays:
    """Return the friction parameters of a drive that are candidates for its worst case.

    Parameters
    ----------
    drive : Drive
        Drive of the joint.
    joint : Joint
        The joint, whose name an error message contains.
    confidence : float or None
        Confidence level of the friction range, such as 0.95. None means nominal friction.

    Returns
    -------
    dict of (sets,) arrays
        Values of the friction parameters by name, in SI units. The dict is empty if the friction is
        nominal and the drive lacks a friction model.

    Raises
    ------
    ProblemError
        If a range is required and the drive does not state the uncertainty of its friction.
    """
    if confidence is None:
        return {} if drive.friction is None else {"mu": np.array([drive.friction.mu])}
    uncertain = friction_spread(drive).within(confidence)
    if not uncertain:
        raise ProblemError(
            f"the friction of {drive.name} (joint {joint.name}) has no uncertainty",
            key="friction",
            value=confidence,
            allowed="drives with posterior, covariance or friction_ranges",
        )
    return _extreme_parameter_sets(uncertain)


def _parameter_text(name: str, value: float) -> str:
    """Describe the value of a friction parameter in words, such as “mu 0.12”.

    Parameters
    ----------
    name : str
        Name of the parameter. The value of `LAW_COLUMN` is the index of a friction law in
        `FRICTION_LAWS`, whose name is shown in its place.
    value : float
        Value of the parameter, in SI units.

    Returns
    -------
    str
        Name and value, with four significant digits.
    """
    if name == LAW_COLUMN:
        return f"{name} {FRICTION_LAWS[int(value)]}"
    return f"{name} {value:.4g}"


def _extreme_parameter_sets(parameter_sets: Arrays) -> Arrays:
    """Select the parameter sets that can cause the largest or the smallest torque.

    The torque in the direction of motion grows with every parameter except for `b_oc` and `b_ov`.
    They reduce a load in this direction, and a self-locking drive then needs less torque. A set can
    therefore have the largest torque only if no other set with the same `b_oc` and `b_ov` is larger
    in every other parameter, and the smallest torque only if no such set is smaller. The function
    keeps both kinds of sets. It does not compare sets with different friction laws.

    Parameters
    ----------
    parameter_sets : dict of (n,) arrays
        Values of each friction parameter in n sets, by name of the parameter.

    Returns
    -------
    dict of (k,) arrays
        The values in the k selected sets, in the same form.
    """
    values = np.unique(np.column_stack(list(parameter_sets.values())), axis=0)
    only_equal = LAW_COLUMN, "b_oc", "b_ov"
    # dominates[i, j] is True if no parameter of set j is larger than that of set i. A set is kept
    # if no other set dominates it, or if it dominates no other set.
    dominates = np.ones((len(values), len(values)), dtype=bool)
    for name, column in zip(parameter_sets, values.T, strict=True):
        compare = np.equal if name in only_equal else np.greater_equal
        dominates &= compare(column[:, None], column)
    np.fill_diagonal(dominates, False)
    is_not_dominated = ~dominates.any(axis=0)
    dominates_none = ~dominates.any(axis=1)
    outer = values[is_not_dominated | dominates_none]
    return dict(zip(parameter_sets, outer.T, strict=True))


class _SampledMotion:
    """A motion that is sampled at n instants, to compare the torques of many parameter sets.

    The instants include both ends of every piece and both sides of every reversal of a joint.

    Attributes
    ----------
    qd, qdd : (n, 4) arrays
        Joint velocities and accelerations at the n instants.
    direction : (n, 4) array
        Direction of each joint: −1, 0 or 1.
    start : (n, 4) array of bool
        True if the joint starts from rest at the instant. Its friction is then static.
    tau : list of (n, 4) arrays
        Efforts of the rigid-body dynamics on the joints for each payload, N·m and N.
    """

    def __init__(self, trajectory: Trajectory, robot: Robot, masses: list[float]) -> None:
        """Sample a motion, and compute the joint efforts for each payload.

        Parameters
        ----------
        trajectory : Trajectory
            The motion.
        robot : Robot
            The robot.
        masses : list of float
            Payloads at the tip, kg.
        """
        max_intervals = max(EVALUATED_INSTANTS // (len(trajectory.breaks) - 1), 1)
        blocks = []
        for pieces in piece_blocks(trajectory):
            segments = pieces.split_at_reversals(robot)
            intervals = SampledIntervals.from_segments(
                pieces, robot, *segments, rate=MAX_SAMPLING_RATE, max_intervals=max_intervals
            )
            s = intervals.begin + INTERVAL_FRACTIONS * intervals.width
            q, qd, qdd = pieces.evaluate(intervals.piece, s)
            # A joint that starts does so at the first instant of an interval.
            starting = intervals.starting * (INTERVAL_FRACTIONS[:, :, None] == 0)
            direction = np.broadcast_to(intervals.direction, starting.shape)
            blocks.append(np.stack([q, qd, qdd, direction, starting]).reshape(5, -1, 4))
        q, self.qd, self.qdd, self.direction, start = np.concatenate(blocks, axis=1)
        self.start = start > 0
        bodies = (RigidBody.from_robot(with_payload(robot, mass)) for mass in masses)
        self.tau = [body.inverse_dynamics(q, self.qd, self.qdd) for body in bodies]

    def torque(self, i: int, drive: Drive, payload_index: int, instants: Indices) -> Array:
        """Compute the motor torque of one joint for all parameter sets of its drive.

        Parameters
        ----------
        i : int
            Index of the joint.
        drive : Drive
            Drive of the joint. Its friction parameters are numbers, or columns (sets, 1).
        payload_index : int
            Index of the payload.
        instants : (m,) array
            Indices of the instants.

        Returns
        -------
        (sets, m) array
            Motor torques, N·m. Numbers as friction parameters give one row.
        """
        torque, *_ = drive_torque(
            drive,
            self.tau[payload_index][instants, i],
            self.qd[instants, i],
            self.qdd[instants, i],
            self.direction[instants, i],
            breakaway=self.start[instants, i],
        )
        return np.atleast_2d(torque)

    def extreme_sets(
        self, i: int, drive: Drive, parameter_sets: Arrays, payload_index: int
    ) -> set[tuple[int, int]]:
        """Select the parameter sets with extreme motor torques of one joint for one payload.

        The selected sets are those with the largest torque, the smallest torque and the largest
        mean square torque. The sets are evaluated at `EVALUATED_INSTANTS` evenly spaced instants,
        at as many instants with the largest nominal torque, and at all starts from rest.

        Parameters
        ----------
        i : int
            Index of the joint.
        drive : Drive
            Drive of the joint with nominal friction.
        parameter_sets : dict of (sets,) arrays
            Values of the friction parameters by name.
        payload_index : int
            Index of the payload.

        Returns
        -------
        set of (int, int)
            Pairs of the index of a parameter set and the index of the payload.
        """
        all_instants = np.arange(len(self.qd))
        nominal = np.abs(self.torque(i, drive, payload_index, all_instants)[0])
        evenly_spaced = all_instants[:: max(len(all_instants) // EVALUATED_INSTANTS, 1)]
        largest_torques = np.argsort(nominal)[-EVALUATED_INSTANTS:]
        starts = np.flatnonzero(self.start[:, i])
        instants = np.unique(np.concatenate([evenly_spaced, largest_torques, starts]))
        block_size = max(TORQUES_PER_BLOCK // len(instants), 1)
        set_count = len(next(iter(parameter_sets.values())))
        tables = []
        for block in blocks(set_count, block_size):
            columns = {name: column[block, None] for name, column in parameter_sets.items()}
            torque = self.torque(i, drive_with_values(drive, columns), payload_index, instants)
            mean_square = np.square(torque).mean(axis=1)
            tables.append(np.stack([torque.max(axis=1), -torque.min(axis=1), mean_square], axis=1))
        # Each of the three columns has its own extreme set.
        return {(int(k), payload_index) for k in np.argmax(np.concatenate(tables), axis=0)}
