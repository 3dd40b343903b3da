"""Pieces of a very long trajectory that cannot hold the worst value of anything, told by one look at their middle.

A quantity moves from its value at the middle of a piece by no more than Σ S·Δ: S, the largest change per change of
q, qd or qdd found along the trajectory, Δ, how far these move within the piece by their Bernstein coefficients.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array
from ssm_planner.verification.pieces import Flags, Pieces, chosen_pieces, still

WORTHWHILE = 20_000
"""Pieces above which the screen saves time."""
SAMPLES = 500
CAUTION = 2.0
STEP = 1e-4
"""Of the differences that S is taken from, as a share of the joint's velocity (and the like) in a second."""

Evaluate = Callable[[Array, Array, Array, Array, Array], Array]
"""q, qd, qdd (4, n), direction, breakaway (4, n) → quantities (k, n)."""


def sensitivity(trajectory: Trajectory, robot: Robot, evaluate: Evaluate) -> Array:
    """Largest |∂quantity / ∂(q, qd, qdd)| along a trajectory, (quantities, 3, 4)."""
    count = len(trajectory.breaks) - 1
    chosen = np.unique(np.linspace(0, count - 1, SAMPLES).astype(int))
    state = middle(chosen_pieces(trajectory, chosen))
    direction, breakaway = np.sign(state[1]), np.zeros_like(state[1])
    base = list(state)
    unit = np.array([joint.velocity for joint in robot.joints])
    slopes = []
    for order in range(3):
        for i in range(4):
            step = STEP * unit[i]
            ahead, behind = list(base), list(base)
            ahead[order], behind[order] = base[order].copy(), base[order].copy()
            ahead[order][i] += step
            behind[order][i] -= step
            high, low = (evaluate(x[0], x[1], x[2], direction, breakaway) for x in (ahead, behind))
            slopes.append(np.abs(high - low).max(axis=1) / (2 * step))
    return np.stack(slopes, axis=1).reshape(-1, 3, 4)


def middle(pieces: Pieces) -> tuple[Array, Array, Array]:
    """q, qd, qdd, each (4, m), at s = 1/2."""
    return pieces.at(slice(None), np.full(len(pieces.start), 0.5))


def spread(pieces: Pieces, state: tuple[Array, ...], slopes: Array) -> Array:
    """How far each quantity may be from its value at the middle, (quantities, m)."""
    total = np.zeros((len(slopes), len(pieces.start)))
    for order in range(3):
        moved = np.abs(pieces.bernstein[order] - state[order]).max(axis=0)
        total += np.einsum("ki,im->km", slopes[:, order], moved)
    return CAUTION * total


def starting(pieces: Pieces, robot: Robot) -> Flags:
    """(m,): a driven joint stands at an end of the piece and moves within it, so that friction may be static."""
    driven = np.array([joint.drive is not None for joint in robot.joints])
    speed = np.abs(pieces.bernstein[1])
    ends = np.minimum(speed[0], speed[-1]) <= still(robot)[:, None]
    return np.asarray(np.any((ends & pieces.moving(robot))[driven], axis=0))
