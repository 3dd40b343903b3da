"""A motion as one joint's drive sees it: what the joint does, and what it must hold, at every instant."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ssm_planner.dynamics.friction import breakaway_coefficient, friction_coefficient, friction_of
from ssm_planner.dynamics.motors import STILL, directions
from ssm_planner.dynamics.rigid_body import RigidBody
from ssm_planner.dynamics.transmission import motor_torque, output_effort
from ssm_planner.problem.drive import Drive
from ssm_planner.problem.motor import Motor
from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import DEGREE, Trajectory
from ssm_planner.typing import Array, Indices

RATE = 2000.0
INSTANTS, STRETCH = 40_000, (40, 1000)
"""Of a motion, and of a piece between two turns of a joint, at most: cost grows with pieces, not with seconds."""
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class JointLoad:
    """Motion and load of one driven joint at n instants; every array (n,), SI.

    The instants cover pieces of constant direction, both ends included; a start from rest is an instant of its own,
    with static friction and without duration.
    """

    joint: str
    drive: Drive
    motor: Motor | None
    alternatives: tuple[Motor, ...]
    t: Array
    q: Array
    qd: Array
    qdd: Array
    inertia: Array
    """M(q) q̈ of this joint, N·m or N."""
    velocity: Array
    """Coriolis and centrifugal effort."""
    gravity: Array
    direction: Array
    """+1, −1, or 0 where the drive stands."""
    breakaway: Array
    """1 where the joint starts from rest, else 0."""
    weight: Array
    """Share of the duration that each instant stands for (trapezoidal rule); their sum is 1."""
    duration: float

    @property
    def tau_rigid(self) -> Array:
        """Effort of the rigid bodies (n,), N·m or N."""
        return self.inertia + self.velocity + self.gravity

    @property
    def moving_share(self) -> float:
        """Share of the duration in which the joint moves."""
        return float(self.weight[self.direction != 0].sum())

    def speed(self, drive: Drive | None = None) -> Array:
        """Motor speed (n,), rad/s."""
        return (drive or self.drive).ratio * self.qd

    def acceleration(self, drive: Drive | None = None) -> Array:
        """Motor acceleration (n,), rad/s²."""
        return (drive or self.drive).ratio * self.qdd

    def effort(self, drive: Drive | None = None) -> Array:
        """Output effort F that the mesh carries, N·m or N; (draws, n) for a drive whose friction holds columns."""
        return np.asarray(
            output_effort(drive or self.drive, self.tau_rigid, self.qd, self.qdd, self.direction)
        )

    def torque(self, drive: Drive | None = None) -> Array:
        """Motor torque by the exact law, N·m; (draws, n) for a drive whose friction holds columns."""
        drive = drive or self.drive
        w, wd = self.speed(drive), self.acceleration(drive)
        return motor_torque(
            drive, self.effort(drive), w, wd, direction=self.direction, mu=self.coefficient(drive)
        )

    def coefficient(self, drive: Drive) -> Array:
        """μ at every instant, (n,) or (draws, n): kinetic, and at a start at least the static one."""
        friction = friction_of(drive)
        w = self.speed(drive)
        mu = friction_coefficient(friction, w)
        if not self.breakaway.any():
            return np.asarray(mu)
        return np.where(self.breakaway > 0, np.asarray(breakaway_coefficient(friction, w)), mu)

    def rms(self, value: Array) -> Array:
        """Root mean square over the motion, of (n,) or (draws, n)."""
        return np.sqrt(np.square(value) @ self.weight)

    def stretched(self, factor: float) -> JointLoad:
        """The same motion in `factor` times the time."""
        return replace(
            self,
            t=self.t[0] + factor * (self.t - self.t[0]),
            qd=self.qd / factor,
            qdd=self.qdd / factor**2,
            inertia=self.inertia / factor**2,
            velocity=self.velocity / factor**2,
            duration=factor * self.duration,
        )

    def plus(self, other: JointLoad, share: float) -> JointLoad:
        """The same motion with `share` times the load by which `other` exceeds this one (loads are linear in masses)."""
        names = ("inertia", "velocity", "gravity")
        return replace(
            self,
            **{
                name: getattr(self, name) + share * (getattr(other, name) - getattr(self, name))
                for name in names
            },
        )

    def at(self, keep: Indices) -> JointLoad:
        """Only the instants `keep` (m,), increasing; each stands for the time to its neighbours."""
        names = ("t", "q", "qd", "qdd", "inertia", "velocity", "gravity", "direction", "breakaway")
        parts = {name: getattr(self, name)[keep] for name in names}
        return replace(self, **parts, weight=_weights(parts["t"]))


def joint_loads(trajectory: Trajectory, robot: Robot, rate: float = RATE) -> tuple[JointLoad, ...]:
    """Loads of all driven joints over a motion, at least at `rate` (Hz) and wherever a joint starts, turns or arrives."""
    piece, local, first, last = _instants(trajectory, robot, rate)
    samples = trajectory.sample_pieces(piece, local)
    inertia, velocity, gravity = RigidBody.from_robot(robot).parts(
        samples.q, samples.qd, samples.qdd
    )
    after, starting = directions(robot, samples, 1)
    before, _ = directions(robot, samples, -1)
    direction = np.where(last[:, None], before, after)
    breakaway = np.where(first[:, None], starting, 0.0)
    weight = _weights(samples.t)
    return tuple(
        JointLoad(
            joint=joint.name,
            drive=joint.drive,
            motor=joint.motor,
            alternatives=joint.alternatives,
            t=samples.t,
            q=samples.q[:, i],
            qd=samples.qd[:, i],
            qdd=samples.qdd[:, i],
            inertia=inertia[:, i],
            velocity=velocity[:, i],
            gravity=gravity[:, i],
            direction=direction[:, i],
            breakaway=breakaway[:, i],
            weight=weight,
            duration=trajectory.duration,
        )
        for i, joint in enumerate(robot.joints)
        if joint.drive is not None
    )


def _instants(
    trajectory: Trajectory, robot: Robot, rate: float
) -> tuple[Indices, Array, Flags, Flags]:
    """Piece, local time, and whether an instant is the first or the last of a stretch in which no joint turns."""
    piece, start, end = _stretches(trajectory, robot, rate)
    counts = np.clip(np.ceil((end - start) * rate).astype(int), 2, _most(trajectory)) + 2
    of = np.repeat(np.arange(len(piece)), counts)
    k = np.arange(len(of)) - np.repeat(np.cumsum(counts) - counts, counts)
    # the first two instants are the same: just breaking away, and just after it
    share = np.maximum(k - 1, 0) / (counts[of] - 2)
    local = np.where(share == 1.0, end[of], start[of] + share * (end - start)[of])
    return piece[of], local, k == 0, k == counts[of] - 1


def _most(trajectory: Trajectory) -> int:
    """Instants of a piece, at most."""
    return int(np.clip(INSTANTS // len(trajectory.breaks), *STRETCH))


def _stretches(trajectory: Trajectory, robot: Robot, rate: float) -> tuple[Indices, Array, Array]:
    """Pieces cut where a joint turns back within them: piece, local start, local end."""
    lengths = np.diff(trajectory.breaks)
    counts = np.clip(np.ceil(lengths * rate).astype(int), 4, _most(trajectory)) + 1
    piece = np.repeat(np.arange(len(lengths)), counts)
    k = np.arange(len(piece)) - np.repeat(np.cumsum(counts) - counts, counts)
    local = k / (counts[piece] - 1) * lengths[piece]
    qd = trajectory.sample_pieces(piece, local).qd
    way = np.where(
        np.abs(qd) > STILL * np.array([joint.velocity for joint in robot.joints]), np.sign(qd), 0.0
    )
    # the last instant before each one at which the joint moved
    last = np.maximum.accumulate(np.where(way != 0, np.arange(len(way))[:, None], 0), axis=0)[:-1]
    joints = np.arange(way.shape[1])
    turned, joint = np.nonzero((piece[last] == piece[1:, None]) & (way[last, joints] * way[1:] < 0))
    found = last[turned, joint]
    cuts = _turns(trajectory, piece[found], local[found], local[turned + 1], joint)
    pieces, starts = (
        np.append(np.arange(len(lengths)), piece[found]),
        np.append(np.zeros(len(lengths)), cuts),
    )
    order = np.lexsort((starts, pieces))
    pieces, starts = pieces[order], starts[order]
    final = np.append(np.diff(pieces), 1) > 0
    return pieces, starts, np.where(final, lengths[pieces], np.append(starts[1:], 0.0))


def _turns(
    trajectory: Trajectory, piece: Indices, low: Array, high: Array, joint: Indices
) -> Array:
    """Local times between low and high at which joints turn back, to the last digit (bisection)."""
    coefficients = trajectory.pieces(piece)[np.arange(len(piece)), 1:, joint] * np.arange(
        1, DEGREE + 1
    )

    def ahead(t: Array) -> Array:
        value = np.zeros_like(t)
        for coefficient in coefficients.T[::-1]:
            value = value * t + coefficient
        return np.sign(value)

    sign = ahead(low)
    for _ in range(60 if len(piece) else 0):
        middle = (low + high) / 2
        before = ahead(middle) == sign
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return high


def _weights(t: Array) -> Array:
    step = np.diff(t)
    weight = np.zeros(len(t))
    weight[:-1] += step / 2
    weight[1:] += step / 2
    return weight / weight.sum()
