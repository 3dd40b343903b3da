"""Independent judge of motions, used as the reference for the checks of the package.

The oracle is plain NumPy. It takes the numbers of a Robot and calls no code of the package.

The oracle plays the numbers of a file as the client of that file plays them: as quintics, cubics or
straight lines between rows, or as the pieces of a plan. It evaluates the motion at many instants of
every piece. Every value is a value of the motion, so a limit that the oracle calls violated is
violated. A larger value may lie between two instants.

The Newton–Euler equations about the remote centre of motion, through which every axis passes, give
the joint efforts. The friction laws of worm and screw give the motor torques.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

Array = np.ndarray
Key = tuple[str, str | None]
"""Name of a limit, and name of the joint or None."""

INSTANTS = 2400
"""Approximate number of instants at which a motion is evaluated."""
FEWEST, MOST = 8, 120
"""Smallest and largest number of instants in one piece."""
AT_REST = 1e-9
"""Speed, relative to its limit, below which a joint stands still and its drive holds it."""
STEP = 1e-6
"""Step that no client notices: of positions in rad or m, of velocities relative to their limit."""
WITH_STEPS = 1e-3
"""Fraction of a limit by which steps may increase the rate of change."""
TARGET = np.array([2e-4, 2e-4, 2e-4, 1e-5])
"""Tolerance of a target: 0.2 mrad (about 0.01°) and 10 µm."""
BISECTIONS = 45


@dataclass(frozen=True)
class Played:
    """A motion of m pieces. Each piece is a polynomial in s from 0 to 1."""

    breaks: Array
    """Breaks (m + 1,) in s."""
    powers: Array
    """Coefficients (m, 6, 4) of the powers of s, in rad and m."""
    curved: Array
    """Which pieces have an acceleration, (m,)."""


def from_pieces(breaks: Array, coefficients: Array) -> Played:
    """Return the motion of a plan.

    The coefficients (m, 6, 4) belong to the powers of the time since the start of each piece.
    """
    powers = coefficients * (np.diff(breaks)[:, None] ** np.arange(6))[:, :, None]
    return Played(np.asarray(breaks), powers, np.ones(len(breaks) - 1, dtype=bool))


def through(t: Array, q: Array, qd: Array | None = None, qdd: Array | None = None) -> Played:
    """Return the motion through the rows (n, 4) of a table. NaN marks a quantity that a row omits.

    A cubic joins two rows with velocities. A quintic joins two rows that also have accelerations. A
    straight line joins any other two rows.
    """
    none = np.full(q.shape, np.nan)
    qd, qdd = none if qd is None else qd, none if qdd is None else qdd
    h = np.diff(t)[:, None]
    step = np.diff(q, axis=0)
    known = ~np.isnan(qd).any(axis=1)
    bent = known & ~np.isnan(qdd).any(axis=1)
    cubic, quintic = known[:-1] & known[1:], bent[:-1] & bent[1:] & known[:-1] & known[1:]
    powers = np.zeros((len(step), 6, 4))
    powers[:, 1] = step
    zero = np.zeros_like(step)
    ends = [zero, h * qd[:-1], step, h * qd[1:]]
    powers[cubic, :4] = np.einsum("ab,bmj->maj", _inverse(2), np.array(ends))[cubic]
    ends = [zero, h * qd[:-1], h**2 * qdd[:-1], step, h * qd[1:], h**2 * qdd[1:]]
    powers[quintic] = np.einsum("ab,bmj->maj", _inverse(3), np.array(ends))[quintic]
    powers[:, 0] += q[:-1]
    return Played(t, powers, cubic)


@lru_cache(maxsize=2)
def _inverse(orders: int) -> Array:
    """Return the matrix (2 orders, 2 orders) from derivatives at s = 0 and 1 to powers of s."""
    size = 2 * orders
    rows = np.zeros((size, size))
    for order in range(orders):
        for power in range(order, size):
            factor = float(np.prod(np.arange(power - order + 1, power + 1)))
            rows[order, power] = factor if power == order else 0.0
            rows[orders + order, power] = factor
    return np.linalg.inv(rows)


@dataclass(frozen=True)
class Dense:
    """Values of a motion at k instants of each of m pieces.

    The instants include both ends of a piece. Every second instant lies midway between its
    neighbours.
    """

    s: Array
    """Instants (k,) from 0 to 1."""
    t: Array
    """Times (m, k) in s."""
    states: Array
    """Positions, velocities and accelerations (3, m, k, 4)."""


def sampled(motion: Played) -> Dense:
    """Sample the pieces. The instants are denser towards the ends of a piece."""
    count = int(np.clip(INSTANTS // len(motion.powers), FEWEST, MOST)) // 2
    s = (1 - np.cos(np.pi * np.arange(count + 1) / count)) / 2
    s = np.sort(np.append(s, (s[1:] + s[:-1]) / 2))
    h = np.diff(motion.breaks)[:, None]
    states = np.array([_values(motion, s, order) for order in range(3)])
    return Dense(s, motion.breaks[:-1, None] + s * h, states)


def _values(motion: Played, s: Array, order: int) -> Array:
    """Return a derivative (m, k, 4) of the motion at s (k,)."""
    powers = motion.powers
    for _ in range(order):
        powers = powers[:, 1:] * np.arange(1, powers.shape[1])[:, None]
    table = s[:, None] ** np.arange(powers.shape[1])
    return np.matmul(table, powers) / np.diff(motion.breaks)[:, None, None] ** order


def at(motion: Played, piece: Array, s: Array, order: int) -> Array:
    """Return a derivative (n, 4) of the motion at s (n,) of the pieces (n,)."""
    powers = motion.powers[piece]
    for _ in range(order):
        powers = powers[:, 1:] * np.arange(1, powers.shape[1])[:, None]
    table = s[:, None] ** np.arange(powers.shape[1])
    return np.einsum("nk,nkj->nj", table, powers) / np.diff(motion.breaks)[piece, None] ** order


# --- mechanism ---


def _turn(axis: Array, angle: Array) -> Array:
    """Return rotations (n, 3, 3) by angles (n,) about a unit vector."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return (
        np.eye(3)
        + np.sin(angle)[:, None, None] * cross
        + (1 - np.cos(angle))[:, None, None] * (cross @ cross)
    )


def _moved(robot: Any, q: Array, qd: Array, qdd: Array) -> list[dict[str, Array]]:
    """Return rotation, axis, angular velocity and angular acceleration of each link.

    The fourth link, which slides, also has a position, a velocity and an acceleration.
    """
    axes = [np.asarray(axis) for axis in robot.geometry.axes]
    turned = np.broadcast_to(np.eye(3), (len(q), 3, 3))
    w, alpha, links = np.zeros((len(q), 3)), np.zeros((len(q), 3)), []
    for i in range(3):
        axis = turned @ axes[i]
        alpha = alpha + axis * qdd[:, i, None] + np.cross(w, axis) * qd[:, i, None]
        w = w + axis * qd[:, i, None]
        turned = turned @ _turn(axes[i], q[:, i])
        links.append({"R": turned, "axis": axis, "w": w, "alpha": alpha})
    tool = turned @ axes[3]
    place = tool * q[:, 3, None]
    links.append({"R": turned, "axis": tool, "w": w, "alpha": alpha, "place": place})
    links[3]["v"] = tool * qd[:, 3, None] + np.cross(w, place)
    links[3]["a"] = (
        tool * qdd[:, 3, None]
        + 2 * np.cross(w, tool) * qd[:, 3, None]
        + np.cross(alpha, place)
        + np.cross(w, np.cross(w, place))
    )
    return links


def efforts(robot: Any, q: Array, qd: Array, qdd: Array) -> Array:
    """Return the joint efforts (n, 4), in N·m and N, that move the bodies.

    The Newton–Euler equations are taken about the common point of all axes.
    """
    links = _moved(robot, q, qd, qdd)
    gravity = np.asarray(robot.gravity)
    moment, result = np.zeros((len(q), 3)), np.zeros((len(q), 4))
    for i in (3, 2, 1, 0):
        link, body = links[i], robot.bodies[i]
        w, alpha = link["w"], link["alpha"]
        if body.mass:
            com, mass = np.asarray(body.com), body.mass
            about = body.inertia - mass * (com @ com * np.eye(3) - np.outer(com, com))
            frame = link["R"] @ body.frame
            arm = frame @ com
            inertia = frame @ about @ np.swapaxes(frame, 1, 2)
            force = (
                link.get("a", 0.0) + np.cross(alpha, arm) + np.cross(w, np.cross(w, arm)) - gravity
            ) * mass
            spin = np.einsum("nij,nj->ni", inertia, w)
            torque = np.einsum("nij,nj->ni", inertia, alpha) + np.cross(w, spin)
            moment = moment + torque + np.cross(arm + link.get("place", 0.0), force)
        else:
            force = np.zeros((len(q), 3))
        loaded = force if i == 3 else moment
        result[:, i] = (link["axis"] * loaded).sum(axis=1)
    return result


def tilt(robot: Any, q: Array) -> Array:
    """Return the signed angles (n,) from the first axis to the tool.

    The angle is positive if the tool is on the same side as in the home position.
    """
    home = np.asarray(robot.geometry.axes[2])
    tool = (_turn(robot.geometry.omega1, q[:, 0]) @ _turn(robot.geometry.omega2, q[:, 1])) @ home
    first = np.asarray(robot.geometry.omega1)
    across = np.asarray(robot.geometry.omega2) - (robot.geometry.omega2 @ first) * first
    side = np.sign(np.cross(first, home) @ across)
    return side * np.arctan2(np.linalg.norm(np.cross(first, tool), axis=1), tool @ first)


def tip_speed(robot: Any, q: Array, qd: Array) -> Array:
    """Return the speed of the tip (n,) in m/s."""
    return np.linalg.norm(_moved(robot, q, qd, np.zeros_like(q))[3]["v"], axis=1)


# --- motors ---


def motor_torque(
    drive: Any, effort: Array, qd: Array, qdd: Array, way: Array, static: Array | bool = False
) -> Array:
    """Return the torque (n,) in N·m of the motor of one joint.

    `way` is the direction ±1 of the motion, or 0 for a joint that is held and needs no torque.
    `static` marks a joint that starts, for which the friction coefficient is at least that at rest.
    """
    friction = drive.friction
    assert not drive.preload, "one nut only"
    w, wd = drive.ratio * qd, drive.ratio * qdd
    mu = np.full_like(w, friction.mu)
    if friction.stribeck_speed is not None:
        x = np.abs(w) / friction.stribeck_speed
        shape = {"stribeck_exponential": np.exp(-2 * x), "stribeck_gaussian": np.exp(-(x**2))}
        mu = mu + friction.mu_stribeck * shape.get(friction.law, 0.0)
    mu = np.where(static, np.maximum(mu, friction.mu_static), mu)
    phi = np.arctan(mu / np.cos(drive.pressure_angle))
    load = effort + drive.output_inertia * qdd + friction.b_oc * way + friction.b_ov * qd
    mesh = drive.gamma * np.tan(drive.lead_angle + np.sign(load * way) * phi) * load
    total = drive.input_inertia * wd + friction.b_c * way + friction.b_v * w + mesh
    return np.where(way == 0, 0.0, total)


def directions(motion: Played, dense: Dense, velocity: Array) -> Array:
    """Return the directions (m, k − 1, 4) between neighbouring instants. A joint at rest has 0."""
    middle = _values(motion, (dense.s[1:] + dense.s[:-1]) / 2, 1)
    return np.sign(middle) * (np.abs(middle) > AT_REST * velocity)


def _starts(motion: Played, ways: Array, s: Array, i: int, velocity: float) -> tuple[Array, ...]:
    """Return (piece, s, direction) of every instant at which joint i starts to move or reverses."""
    way = ways[:, :, i]
    before = np.concatenate([[0.0], way[:-1, -1]])
    slow = np.abs(at(motion, np.arange(len(way)), np.zeros(len(way)), 1)[:, i]) <= STEP * velocity
    first = np.flatnonzero((before != way[:, 0]) & (way[:, 0] != 0) & slow)
    piece, k = np.nonzero((way[:, 1:] * way[:, :-1]) < 0)
    low, high = (s[k] + s[k + 1]) / 2, (s[k + 1] + s[k + 2]) / 2
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        earlier = np.sign(at(motion, piece, middle, 1)[:, i]) == way[piece, k]
        low, high = np.where(earlier, middle, low), np.where(earlier, high, middle)
    return (
        np.concatenate([first, piece]),
        np.concatenate([np.zeros(len(first)), high]),
        np.concatenate([way[first, 0], way[piece, k + 1]]),
    )


def torques(motion: Played, dense: Dense, robot: Any) -> dict[int, tuple[Array, Array]]:
    """Return the motor torques in N·m by joint.

    The first array (m, k − 1, 2) holds the torques just after one instant and just before the next.
    The second array (n,) holds the torques at starts.
    """
    velocity = np.array([joint.velocity for joint in robot.joints])
    ways = directions(motion, dense, velocity)
    q, qd, qdd = dense.states.reshape(3, -1, 4)
    effort = efforts(robot, q, qd, qdd).reshape(dense.states.shape[1:])
    result = {}
    for i, joint in enumerate(robot.joints):
        if joint.drive is None or joint.motor is None:
            continue
        sides = [
            motor_torque(
                joint.drive,
                effort[:, side, i],
                dense.states[1][:, side, i],
                dense.states[2][:, side, i],
                ways[:, :, i],
            )
            for side in (slice(None, -1), slice(1, None))
        ]
        piece, s, way = _starts(motion, ways, dense.s, i, joint.velocity)
        state = [at(motion, piece, s, order) for order in range(3)]
        starting = motor_torque(
            joint.drive, efforts(robot, *state)[:, i], state[1][:, i], state[2][:, i], way, True
        )
        result[i] = np.stack(sides, axis=2), starting
    return result


# --- limits ---


def violations(
    motion: Played,
    robot: Any,
    *,
    ranges: dict[str, tuple[float, float]] | None = None,
    tip: float | None = None,
    pause: float | None = 0.0,
) -> dict[Key, float]:
    """Return the relative excess over each limit by limit and joint.

    The excess of a kept limit is negative. `ranges` holds the tilt range in rad. `tip` is the
    largest speed of the tip in m/s. `pause` is the time in s before the motion is repeated. None
    stands for a motion that runs once.
    """
    dense = sampled(motion)
    q, qd, qdd = dense.states
    result: dict[Key, float] = {}
    smooth = bool(motion.curved.all())
    for i, joint in enumerate(robot.joints):
        name = joint.name
        low, high = joint.position
        half = (high - low) / 2
        result["position", name] = max(q[..., i].max() - high, low - q[..., i].min()) / half
        fastest = np.abs(qd[..., i]).max()
        result["velocity", name] = fastest / joint.velocity - 1
        result["steps of position", name] = _steps(dense.t, q[..., i], joint.velocity, STEP, None)
        if motion.curved.any():
            result["acceleration", name] = (
                np.abs(qdd[motion.curved][..., i]).max() / joint.acceleration - 1
            )
        if smooth:
            result["steps of velocity", name] = _steps(
                dense.t, qd[..., i], joint.acceleration, STEP * joint.velocity, 0.0
            )
        if joint.jerk is not None and motion.curved.any():
            jerk = np.abs(_values(motion, dense.s, 3)[motion.curved][..., i]).max()
            result["jerk", name] = jerk / joint.jerk - 1
        if joint.motor is not None and joint.drive is not None:
            result["motor speed", name] = fastest * joint.drive.ratio / joint.motor.max_speed - 1
    if motion.curved.any():
        result |= _of_motors(motion, dense, robot, pause)
    flat = q.reshape(-1, 4), qd.reshape(-1, 4)
    if ranges and "tilt" in ranges:
        low, high = ranges["tilt"]
        angles = tilt(robot, flat[0])
        result["tilt range", None] = max(angles.max() - high, low - angles.min()) * 2 / (high - low)
    if tip is not None:
        result["tip speed", None] = tip_speed(robot, *flat).max() / tip - 1
    return {key: float(value) for key, value in result.items()}


def _of_motors(motion: Played, dense: Dense, robot: Any, pause: float | None) -> dict[Key, float]:
    part = motion
    if (
        not motion.curved.all()
    ):  # each piece is judged separately, because no joint starts where a straight line ends
        keep = motion.curved
        h = np.diff(motion.breaks)[keep]
        part = Played(np.append(0.0, np.cumsum(h)), motion.powers[keep], keep[keep])
        dense = sampled(part)
    result: dict[Key, float] = {}
    h = np.diff(part.breaks)
    for i, (moving, starting) in torques(part, dense, robot).items():
        motor, name = robot.joints[i].motor, robot.joints[i].name
        peak = max(np.abs(moving).max(), np.abs(starting).max(initial=0.0))
        result["motor torque", name] = peak / motor.max_torque - 1
        if pause is not None and motion.curved.all():
            # Simpson's rule, with the middle value taken from both sides
            left, right = np.moveaxis(moving**2, 2, 0)
            mean = (left[:, ::2] + 2 * right[:, ::2] + 2 * left[:, 1::2] + right[:, 1::2]) / 6
            rms = np.sqrt(mean @ np.diff(dense.s[::2]) @ h / (h.sum() + pause))
            result["continuous torque", name] = rms / motor.nominal_torque - 1
    return result


def _steps(t: Array, values: Array, rate: float, step: float, outside: float | None) -> float:
    """Return the relative excess of the mean rate of change over the worst interval of time.

    A change of one `step` is tolerated. `outside` is the value before and after the motion, if it
    is known. A motion that keeps the rate at every time has no interval in which it changes by more
    than rate × time.
    """
    t, values = t.ravel(), values.ravel()
    if outside is not None:
        t = np.concatenate([t[:1], t, t[-1:]])
        values = np.concatenate([[outside], values, [outside]])
    worst = -np.inf
    for way in (1.0, -1.0):
        ahead = way * values - rate * (1 + WITH_STEPS) * t
        rise = ahead - np.minimum.accumulate(ahead)
        last = int(rise.argmax())
        first = int(ahead[: last + 1].argmin())
        change = way * (values[last] - values[first]) - step
        if rise[last] > step:
            worst = max(worst, change / max(rate * (t[last] - t[first]), 1e-3 * step) - 1)
        else:
            worst = max(worst, rise[last] / step - 1)
    return min(worst, 1e3)


def missed(motion: Played, targets: list[Array]) -> float:
    """Return how far a motion misses joint positions that it should reach in order.

    The result is the distance in units of TARGET, minus 1. The motion must end at the last
    position.
    """
    q = sampled(motion).states[0].reshape(-1, 4)
    first, worst = 0, -1.0
    for target in targets[:-1]:
        off = np.linalg.norm((q[first:] - target) / TARGET, axis=1)
        first += int(off.argmin())
        worst = max(worst, float(off.min()) - 1)
    return max(worst, float(np.linalg.norm((q[-1] - targets[-1]) / TARGET)) - 1)
