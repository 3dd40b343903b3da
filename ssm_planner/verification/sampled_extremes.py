"""Root mean square of the motor torques over a motion, from the instants that the scan looks at anyway.

What a motor may give for all time is a limit of its heat, which goes with the square of the torque. A start from rest
is an instant without duration: static friction there counts as a peak, not as heat.

Extremes of the quantities that are no polynomials: motor torques, nut contact, task coordinates and rates, the eye.

Each piece is looked at in intervals of four instants. The cubic through the four values bounds what happens between
them; intervals whose bound is worse than the worst value known are halved until none is left. A quantity with corners
may besides go on as steeply as it goes between two instants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from ssm_planner.codegen.namespace import casadi_namespace
from ssm_planner.codegen.vectorised import Vectorised, dense
from ssm_planner.dynamics.motors import motor_law
from ssm_planner.dynamics.transmission import nut_contact
from ssm_planner.kinematics.eye import eye_limits
from ssm_planner.kinematics.forward import tip_position_symbolic
from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.kinematics.solutions import nearest_turn
from ssm_planner.kinematics.task import task_from_joints_symbolic, task_rates_symbolic
from ssm_planner.kinematics.tool_speeds import JACOBIANS
from ssm_planner.problem.limits import ContinuousTorque, MotorTorque, NutContact, SpeedLimit, TaskRange, TaskRate
from ssm_planner.problem.problem import Eye
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, Indices
from ssm_planner.verification import prefilter as screen
from ssm_planner.verification.certificate import LimitCheck
from ssm_planner.verification.limits import Quantity, Worst
from ssm_planner.verification.pieces import Flags, Pieces, still

FOUR_EIGHTHS = np.array([1.0, 3.0, 3.0, 1.0])[:, None] / 8
"""Weights of four instants at equal distances: exact for cubics (Simpson's 3/8 rule)."""
WITHOUT_FIRST = np.array([0.0, 3.0, 0.0, 1.0])[:, None] / 4
"""The same without the first instant: exact for parabolas (Radau's rule of two points)."""


class MeanSquares:
    """∫ τ² dt of every motor torque among the quantities of a scan, stretch after stretch."""

    def __init__(self, quantities: Sequence[Quantity]) -> None:
        self.rows = [k for k, quantity in enumerate(quantities) if isinstance(quantity.limit, MotorTorque)]
        self.joints = [quantities[k].index for k in self.rows]
        self.integrals = np.zeros(len(self.rows))

    def add_intervals(self, values: Array, starting: Flags, duration: Array) -> None:
        """Intervals (n,) with values (k, 4, n) of the quantities at four instants; starting (4, n): the first is static."""
        weights = np.where(starting[self.joints][:, None], WITHOUT_FIRST, FOUR_EIGHTHS)
        self.integrals += np.sum(np.sum(weights * values[self.rows] ** 2, axis=1) * duration, axis=1)

    def add_middles(self, values: Array, duration: Array) -> None:
        """Short pieces (n,) with values (k, n) of the quantities at their middle."""
        self.integrals += values[self.rows] ** 2 @ duration

    def checks(self, robot: Robot, trajectory: Trajectory) -> list[LimitCheck]:
        """RMS torque against what the motor may give for all time, motor by motor; of the whole motion, so at its end."""
        checks = []
        for i, integral in zip(self.joints, self.integrals, strict=True):
            limit = robot.joints[i].limit(ContinuousTorque)
            rms, end = float(np.sqrt(integral / trajectory.duration)), float(trajectory.breaks[-1])
            margin = 1 - rms / limit.largest
            checks.append(LimitCheck(limit.name, limit.joint, rms, limit.largest, margin, end, limit.unit))
        return checks


CLOSE = 1e-8
"""Share of a limit below which a possible worse value is not searched for."""
CAUTION = 2.0
"""The overshoot of the cubic through four values counts so many times."""
HALVINGS = 10
MOST = 2048
"""Intervals of a block that are halved at a time, those first that may hold the worst."""
SHARES = np.array([0.0, 1.0, 2.0, 3.0])[:, None] / 3
LONG = 10.0
"""Mean lengths of a piece, beyond which one look at its middle does not stand for the whole of it."""


class Scan:
    """Looks for the worst values of the sampled quantities of one robot, block after block."""

    def __init__(
        self, trajectory: Trajectory, robot: Robot, worst: Sequence[Worst], rate: float, eye: Eye | None
    ) -> None:
        self.robot, self.rate, self.eye = robot, rate, eye
        self.worst = [each for each in worst if each.quantity.order is None]
        self.quantities = tuple(each.quantity for each in self.worst)
        self.kinked = np.array([quantity.kinked for quantity in self.quantities])
        self.heating = MeanSquares(self.quantities)
        self.instants = 0
        self.longest = LONG * trajectory.duration / (len(trajectory.breaks) - 1)
        self.slopes: Array | None = None
        if self.quantities and len(trajectory.breaks) > screen.WORTHWHILE:
            self.slopes = screen.sensitivity(trajectory, robot, lambda *at: self.law(*at)[0])

    @cached_property
    def law(self) -> Vectorised:
        return _law(self.robot, self.eye, self.quantities)

    def look(self, pieces: Pieces) -> None:
        """Bring the worst values up to date with these pieces."""
        if not self.quantities:
            return
        piece, begin, end = pieces.segments(self.robot)
        if self.slopes is not None:
            certain = pieces.length > self.longest
            certain[piece[end - begin < 1.0]] = True
            wanted = self._screened(pieces, self.slopes, certain)[piece]
            piece, begin, end = piece[wanted], begin[wanted], end[wanted]
        intervals = _intervals(pieces, self.robot, piece, begin, end, self.rate)
        for halving in range(HALVINGS):
            if not len(intervals.piece):
                break
            intervals = intervals.halves(self._evaluate(pieces, intervals, first=halving == 0))

    def _evaluate(self, pieces: Pieces, at: Intervals, *, first: bool) -> Indices:
        """Look at intervals; returns those that may hold something worse than what is known.

        first: the intervals have not been part of any looked at before, so that they add to the heating.
        """
        s = np.minimum(at.begin + SHARES * at.width, 1.0)
        state = pieces.at(at.piece, s)
        static = np.zeros(state[0].shape)
        static[:, 0] = at.starting
        directions = np.broadcast_to(at.direction[:, None], state[0].shape)
        q, qd, qdd, direction, breakaway = (x.reshape(4, -1) for x in (*state, directions, static))
        values = self._values(q, qd, qdd, direction, breakaway).reshape(len(self.quantities), 4, -1)
        self._offer(values, pieces.time(at.piece, s))
        if first:
            self.heating.add_intervals(values, at.starting, at.width * pieces.length[at.piece])
        near_start, near_end = _inner_control(values)
        highest, lowest = values.max(axis=1), values.min(axis=1)
        over = np.maximum(np.maximum(near_start, near_end) - highest, 0.0)
        under = np.maximum(lowest - np.minimum(near_start, near_end), 0.0)
        corner = self.kinked[:, None] * np.abs(np.diff(values, axis=1)).max(axis=1)
        gain = self._gain(lowest - CAUTION * under - corner, highest + CAUTION * over + corner)
        open_ = np.flatnonzero(gain > 0)
        return open_ if len(open_) <= MOST else open_[np.argsort(gain[open_])[-MOST:]]

    def _screened(self, pieces: Pieces, slopes: Array, certain: Flags) -> Flags:
        """(m,): the certain pieces, and those that may hold something worse than what is known, or friction at rest."""
        state = screen.middle(pieces)
        moving = pieces.moving(self.robot)
        q, qd, qdd = state
        values = self._values(q, qd, qdd, np.sign(qd) * moving, np.zeros_like(qd))
        self._offer(values, pieces.time(np.arange(len(pieces.start)), np.full(len(pieces.start), 0.5)))
        around = screen.spread(pieces, state, slopes)
        worse = self._gain(values - around, values + around) > 0
        wanted = np.asarray(certain | worse | screen.starting(pieces, self.robot))
        self.heating.add_middles(values, np.where(wanted, 0.0, pieces.length))
        return wanted

    def _values(self, q: Array, qd: Array, qdd: Array, direction: Array, breakaway: Array) -> Array:
        """The quantities (k, n) at q, qd, qdd (4, n)."""
        values = self.law(q, qd, qdd, direction, breakaway)[0]
        for k, quantity in enumerate(self.quantities):
            if isinstance(quantity.limit, TaskRange) and quantity.limit.coupled:
                values[k] = nearest_turn(values[k], 0.0)
            elif isinstance(quantity.limit, NutContact):
                drive = self.robot.joints[quantity.index].drive
                if drive is not None:
                    values[k] = nut_contact(drive, values[k], drive.ratio * qdd[quantity.index])
        return values

    def _offer(self, values: Array, time: Array) -> None:
        self.instants += time.size
        for each, value in zip(self.worst, values, strict=True):
            excess = each.quantity.excess(value, value)
            k = int(np.argmax(excess))
            each.offer(float(excess.flat[k]), float(value.flat[k]), float(time.flat[k]))

    def _gain(self, lowest: Array, highest: Array) -> Array:
        """(n,): by how much some quantity between these bounds (k, n) may exceed the worst known."""
        bounds = zip(self.worst, lowest, highest, strict=True)
        return np.max([w.quantity.excess(low, high) - w.excess - CLOSE for w, low, high in bounds], axis=0)


@dataclass(frozen=True, eq=False)
class Intervals:
    """Stretches of pieces without reversals, (k,) each."""

    piece: Indices
    begin: Array
    width: Array
    direction: Array
    """(4, k): in which the joints move; 0: they stand."""
    starting: Flags
    """(4, k): the joint starts from rest where the interval begins, so that friction there is static."""

    def halves(self, chosen: Indices) -> Intervals:
        """The two halves of each of the chosen intervals."""
        twice = np.repeat(chosen, 2)
        width, begin, starting = self.width[twice] / 2, self.begin[twice], self.starting[:, twice]
        begin[1::2] += width[1::2]
        starting[:, 1::2] = False
        return Intervals(self.piece[twice], begin, width, self.direction[:, twice], starting)


def _intervals(pieces: Pieces, robot: Robot, piece: Indices, begin: Array, end: Array, rate: float) -> Intervals:
    """Segments cut so that four instants in each interval make the rate."""
    # within a segment no joint turns back, so that its direction is that at the middle
    direction = np.sign(pieces.at(piece, (begin + end) / 2)[1]) * pieces.moving(robot)[:, piece]
    starting = (np.abs(pieces.at(piece, begin)[1]) <= still(robot)[:, None]) & (direction != 0)
    counts = np.maximum(np.ceil((end - begin) * pieces.length[piece] * rate / 3 - 1e-3).astype(int), 1)
    part = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    width = np.repeat((end - begin) / counts, counts)
    direction, starting = np.repeat(direction, counts, axis=1), np.repeat(starting, counts, axis=1)
    return Intervals(
        np.repeat(piece, counts), np.repeat(begin, counts) + part * width, width, direction, starting & (part == 0)
    )


def _inner_control(values: Array) -> tuple[Array, Array]:
    """Inner Bernstein coefficients, (k, n) each, of the cubics through values (k, 4, n) at the SHARES."""
    v0, v1, v2, v3 = (values[:, i] for i in range(4))
    return (-5 * v0 + 18 * v1 - 9 * v2 + 2 * v3) / 6, (2 * v0 - 9 * v1 + 18 * v2 - 5 * v3) / 6


@lru_cache(maxsize=8)
def _law(robot: Robot, eye: Eye | None, wanted: tuple[Quantity, ...]) -> Vectorised:
    """The wanted quantities as one function of (q, qd, qdd, direction, breakaway); of a nut contact its effort."""
    q, qd, qdd, direction, breakaway = (ca.SX.sym(name, 4) for name in ("q", "qd", "qdd", "direction", "breakaway"))
    mechanism = Mechanism.from_geometry(robot.geometry)
    _, torque, effort = motor_law(robot, q, qd, qdd, direction, breakaway)
    task = task_from_joints_symbolic(mechanism, q)
    rates = task_rates_symbolic(mechanism, q, qd)
    tip = tip_position_symbolic(mechanism, q)
    about_eye = {} if eye is None else eye_limits(casadi_namespace(), eye, (tip[0], tip[1], tip[2]))
    rows = []
    for quantity in wanted:
        limit = quantity.limit
        if isinstance(limit, MotorTorque):
            rows.append(torque[quantity.index])
        elif isinstance(limit, NutContact):
            rows.append(effort[quantity.index])
        elif isinstance(limit, SpeedLimit):
            rows.append(ca.norm_2(JACOBIANS[type(limit)](mechanism, q) @ qd))
        elif isinstance(limit, TaskRate):
            rows.append(rates[quantity.index])
        elif isinstance(limit, TaskRange):
            rows.append(task[quantity.index])
        else:
            rows.append(about_eye[limit.name][0])
    return Vectorised(dense("limits", [q, qd, qdd, direction, breakaway], [ca.vertcat(*rows)]))
