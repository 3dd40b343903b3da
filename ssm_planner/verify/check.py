"""Independent check of any trajectory against every limit, with the exact friction law, densely in time.

It knows nothing of how the trajectory came about: it takes polynomials in time, evaluates them at 10 kHz and at both sides
of every break, refines around the worst instants, and treats starts and reversals with static friction.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from ssm_planner.model.actuation import directions, motor_motion
from ssm_planner.model.forward import tip_velocity
from ssm_planner.model.friction import friction_of
from ssm_planner.model.mechanism import Mechanism
from ssm_planner.model.rigid_body import RigidBody
from ssm_planner.model.task import task_from_joints
from ssm_planner.model.trajectory import Samples, Trajectory
from ssm_planner.model.transmission import nut_contact, self_locking_margin
from ssm_planner.problem.values import TASK, Array, Indices, Range, Robot
from ssm_planner.verify.certificate import Certificate, LimitCheck

RATE = 10_000.0
CANDIDATES = 8
REFINEMENT = 64
"""Around each of the worst instants of a limit the neighbouring intervals are sampled this many times finer, twice."""
JUMP = 1e-6
"""Largest jump of position (rad, m) or velocity (share of its limit) at a break."""


@dataclass(frozen=True, eq=False)
class Quantity:
    """A limited value along the motion: `value` maps instants to (n,) numbers that must stay in [low, high]."""

    name: str
    joint: str | None
    value: Callable[[Instants], Array]
    low: float
    high: float
    unit: str


@dataclass(frozen=True, eq=False)
class Instants:
    """Instants of a trajectory with all that the limits look at, evaluated once."""

    samples: Samples
    task: Array
    tip_speed: Array
    motor_speed: Array
    motor_torque: Array
    """(n, 4); of the directions possible at an instant the one that needs most."""
    contact: Array


def check(
    trajectory: Trajectory,
    robot: Robot,
    ranges: dict[str, Range] | None = None,
    tip_speed: float | None = None,
    rate: float = RATE,
    interpolation: str = "quintic polynomial pieces",
) -> Certificate:
    """Certificate of a trajectory: every limit of the robot, and the task ranges and tip speed given.

    ranges: by name in TASK, rad or m. rate: sampling rate of the check in Hz.
    """
    look = _Evaluator(robot, trajectory)
    piece, local = _instants(trajectory, rate)
    instants = look(piece, local)
    limits = [
        _worst(quantity, instants, piece, local, look) for quantity in _quantities(robot, ranges or {}, tip_speed)
    ]
    limits += _jumps(trajectory, robot)
    limits += _locking(robot)
    unchecked = tuple(
        f"motor torque and speed of joint {joint.name}: the robot file names no drive or no motor for it"
        for joint in robot.joints
        if joint.drive is None or joint.motor is None
    )
    return Certificate(tuple(limits), interpolation, len(piece), unchecked)


def _quantities(robot: Robot, ranges: dict[str, Range], tip_speed: float | None) -> Iterable[Quantity]:
    for i, joint in enumerate(robot.joints):
        unit = "rad" if joint.kind == "revolute" else "m"
        derivatives = [("velocity", "qd", joint.velocity, "/s"), ("acceleration", "qdd", joint.acceleration, "/s²")]
        if joint.jerk is not None:
            derivatives.append(("jerk", "qddd", joint.jerk, "/s³"))
        yield Quantity("position", joint.name, _of_samples("q", i), *joint.position, unit)
        for name, field, limit, per in derivatives:
            yield Quantity(name, joint.name, _of_samples(field, i), -limit, limit, unit + per)
        if joint.drive is not None and joint.motor is not None:
            speed, torque = joint.motor.max_speed, joint.motor.max_torque
            yield Quantity("motor speed", joint.name, _of("motor_speed", i), -speed, speed, "rad/s")
            yield Quantity("motor torque", joint.name, _of("motor_torque", i), -torque, torque, "N·m")
        if joint.drive is not None and joint.drive.kind == "antibacklash_screw":
            yield Quantity("nut contact", joint.name, _of("contact", i), 0.0, np.inf, "N")
    for k, name in enumerate(TASK):
        if name in ranges:
            unit = "m" if name == "depth" else "rad"
            yield Quantity(f"{name} range", None, _of("task", k), *ranges[name], unit)
    if tip_speed is not None:
        yield Quantity("tip speed", None, lambda at: at.tip_speed, -tip_speed, tip_speed, "m/s")


def _of_samples(field: str, i: int) -> Callable[[Instants], Array]:
    def value(at: Instants) -> Array:
        return np.asarray(getattr(at.samples, field)[:, i])

    return value


def _of(field: str, i: int) -> Callable[[Instants], Array]:
    def value(at: Instants) -> Array:
        return np.asarray(getattr(at, field)[:, i])

    return value


class _Evaluator:
    """Evaluates trajectory, task coordinates and motors at instants given as (piece, local time)."""

    def __init__(self, robot: Robot, trajectory: Trajectory) -> None:
        self.robot, self.trajectory = robot, trajectory
        self.mechanism = Mechanism.from_geometry(robot.geometry)
        self.body = RigidBody.from_robot(robot)

    def __call__(self, piece: Indices, local: Array) -> Instants:
        samples = self.trajectory.sample_pieces(piece, local)
        torque = speed = contact = np.full(samples.q.shape, np.inf)
        for side in (1, -1):
            direction, breakaway = directions(self.robot, samples, side)
            motor = motor_motion(self.robot, self.body, samples, direction, breakaway)
            harder = np.abs(motor.torque) > np.abs(torque)
            torque = np.where(harder, motor.torque, torque) if side < 0 else motor.torque
            contact = np.minimum(contact, self._contact(motor.effort, motor.acceleration))
            speed = motor.speed
        task = task_from_joints(self.mechanism, samples.q)
        tip = np.linalg.norm(tip_velocity(self.mechanism, samples.q, samples.qd), axis=1)
        return Instants(samples, task, tip, speed, torque, contact)

    def _contact(self, effort: Array, acceleration: Array) -> Array:
        contact = np.full(effort.shape, np.inf)
        for i, joint in enumerate(self.robot.joints):
            if joint.drive is not None:
                contact[:, i] = nut_contact(joint.drive, effort[:, i], acceleration[:, i])
        return contact


def _instants(trajectory: Trajectory, rate: float) -> tuple[Indices, Array]:
    """Piece and local time of what is looked at: every piece densely, and where a joint turns back within a piece."""
    piece, local = _dense(trajectory, rate)
    turned_piece, turned_local = _reversals(trajectory, piece, local)
    piece, local = np.append(piece, turned_piece), np.append(local, turned_local)
    order = np.lexsort((local, piece))
    return piece[order], local[order]


def _reversals(trajectory: Trajectory, piece: Indices, local: Array) -> tuple[Indices, Array]:
    """Where a joint's velocity passes through zero between two samples of one piece, to the last digit (bisection)."""
    qd = trajectory.sample_pieces(piece, local).qd
    same = piece[1:] == piece[:-1]
    turns = same[:, None] & (qd[1:] * qd[:-1] < 0)
    before, joint = np.nonzero(turns)
    low, high = local[before], local[before + 1]
    sign = np.sign(qd[before, joint])
    each = np.arange(len(before))
    for _ in range(60):
        middle = (low + high) / 2
        ahead = np.sign(trajectory.sample_pieces(piece[before], middle).qd[each, joint]) == sign
        low, high = np.where(ahead, middle, low), np.where(ahead, high, middle)
    return piece[before], high


def _dense(trajectory: Trajectory, rate: float) -> tuple[Indices, Array]:
    """Instants that cover every piece from its start to its end, both included."""
    lengths = np.diff(trajectory.breaks)
    counts = np.maximum(np.ceil(lengths * rate).astype(int), 4) + 1
    piece = np.repeat(np.arange(len(lengths)), counts)
    first = np.repeat(np.cumsum(counts) - counts, counts)
    share = (np.arange(len(piece)) - first) / (np.repeat(counts, counts) - 1)
    return piece, share * lengths[piece]


def _worst(quantity: Quantity, instants: Instants, piece: Indices, local: Array, look: _Evaluator) -> LimitCheck:
    """The worst instant of one quantity, refined between the samples."""
    value = quantity.value(instants)
    step = float(np.diff(local).max())
    margin = _margins(value, quantity)
    best = int(np.argmin(margin))
    found = (float(margin[best]), float(value[best]), float(instants.samples.t[best]))
    if np.ptp(value) == 0.0:
        return _as_check(quantity, *found)
    candidates = _local_minima(margin)
    for _ in range(2):
        centres = candidates[np.argsort(margin[candidates])[:CANDIDATES]]
        offset = np.linspace(-step, step, 2 * REFINEMENT + 1)
        end = np.diff(look.trajectory.breaks)[piece[centres]]
        finer = np.clip(local[centres][:, None] + offset, 0.0, end[:, None])
        piece, local = np.repeat(piece[centres], len(offset)), finer.ravel()
        instants = look(piece, local)
        value = quantity.value(instants)
        margin = _margins(value, quantity)
        best = int(np.argmin(margin))
        found = min(found, (float(margin[best]), float(value[best]), float(instants.samples.t[best])))
        step /= REFINEMENT
        candidates = np.array([best])
    return _as_check(quantity, *found)


def _margins(value: Array, quantity: Quantity) -> Array:
    half = _half_width(quantity)
    return np.minimum(quantity.high - value, value - quantity.low) / half


def _half_width(quantity: Quantity) -> float:
    width = quantity.high - quantity.low
    return width / 2 if np.isfinite(width) and width > 0 else 1.0


def _local_minima(margin: Array) -> Array:
    inner = (margin[1:-1] <= margin[:-2]) & (margin[1:-1] <= margin[2:])
    return np.concatenate([[0], np.flatnonzero(inner) + 1, [len(margin) - 1]])


def _as_check(quantity: Quantity, margin: float, worst: float, time: float) -> LimitCheck:
    high_side = quantity.high - worst <= worst - quantity.low
    symmetric = quantity.low == -quantity.high
    limit = quantity.high if high_side else quantity.low
    if symmetric:
        worst, limit = abs(worst), quantity.high
    return LimitCheck(quantity.name, quantity.joint, worst, limit, margin, time, quantity.unit)


def _jumps(trajectory: Trajectory, robot: Robot) -> list[LimitCheck]:
    """Continuity of position and velocity at the breaks."""
    inner = np.arange(1, len(trajectory.breaks) - 1)
    left = trajectory.sample(trajectory.breaks[inner], side="left")
    right = trajectory.sample(trajectory.breaks[inner], side="right")
    checks = []
    for i, joint in enumerate(robot.joints):
        unit = "rad" if joint.kind == "revolute" else "m"
        for name, jump, limit, per in (
            ("position jump", np.abs(right.q - left.q)[:, i], JUMP, ""),
            ("velocity jump", np.abs(right.qd - left.qd)[:, i], JUMP * joint.velocity, "/s"),
        ):
            k = int(np.argmax(jump)) if len(jump) else -1
            worst, time = (float(jump[k]), float(trajectory.breaks[inner[k]])) if k >= 0 else (0.0, 0.0)
            checks.append(LimitCheck(name, joint.name, worst, limit, (limit - worst) / limit, time, unit + per))
    return checks


def _locking(robot: Robot) -> list[LimitCheck]:
    """φ_f > λ at the lowest plausible friction, for every drive the robot relies on to hold."""
    checks = []
    for joint in robot.joints:
        drive = joint.drive
        if drive is None or not drive.self_locking:
            continue
        friction = friction_of(drive)
        lowest = friction.mu if friction.mu_lowest is None else friction.mu_lowest
        in_mu, _ = self_locking_margin(drive, lowest)
        needed = lowest - float(in_mu)
        checks.append(LimitCheck("self-locking", joint.name, lowest, needed, float(in_mu) / needed, 0.0, "μ"))
    return checks
