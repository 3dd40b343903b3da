"""Pieces of a very long trajectory that cannot hold the worst value of anything, told by one look at their middle.

A quantity moves from its value at the middle of a piece by no more than Σ S·Δ: S, the largest change per change of
q, qd or qdd found along the trajectory, Δ, how far these move within the piece by their Bernstein coefficients.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, Mask
from ssm_planner.verification.pieces import Pieces, State, pieces_of, still

WORTHWHILE = 20_000
"""Pieces above which the prefilter saves time."""
PARTS = 8
"""Of a block of pieces."""
CAUTION = 2.0
STEP = 1e-4
"""Of the differences that S is taken from, as a share of the joint's velocity (and the like) in a second."""

Evaluate = Callable[[State, Array, Array], Array]
"""State q, qd, qdd, directions and breakaways, (n, 4) each → quantities (n, k)."""


def sensitivity(trajectory: Trajectory, robot: Robot, evaluate: Evaluate) -> Array:
    """Largest |∂quantity / ∂(q, qd, qdd)| along a trajectory, (3, 4, k), by central differences.

    Taken where, in each part of each block of pieces, a joint is farthest, fastest or hardest accelerated either way: a short
    move among many pieces at rest is so found.
    """
    return _slopes(np.concatenate(list(_extremes(trajectory)), axis=1), robot, evaluate)


def _extremes(trajectory: Trajectory) -> Iterator[Array]:
    """States (3, n, 4) of the pieces of each block that are extreme in its PARTS."""
    for pieces in pieces_of(trajectory):
        state = np.stack(middle(pieces))
        chosen = [np.empty(0, dtype=np.intp)]
        for part in np.array_split(np.arange(state.shape[1]), PARTS):
            if len(part):
                values = state[:, part]
                chosen += [part[values.argmin(axis=1)].ravel(), part[values.argmax(axis=1)].ravel()]
        yield state[:, np.unique(np.concatenate(chosen))]


def _slopes(state: Array, robot: Robot, evaluate: Evaluate) -> Array:
    """Largest slopes (3, 4, k) at states (3, n, 4)."""
    direction, breakaway = np.sign(state[1]), np.zeros_like(state[1])

    def slope(order: int, i: int) -> Array:
        step = np.zeros((3, 1, 4))
        step[order, 0, i] = STEP * robot.joints[i].velocity
        high, low = (
            evaluate(tuple(at), direction, breakaway) for at in (state + step, state - step)
        )
        return np.abs(high - low).max(axis=0) / (2 * step[order, 0, i])

    return np.array([[slope(order, i) for i in range(4)] for order in range(3)])


def middle(pieces: Pieces) -> State:
    """q, qd, qdd, each (m, 4), at s = 1/2."""
    return pieces.at(slice(None), np.full(len(pieces.start), 0.5))


def spread(pieces: Pieces, state: State, slopes: Array) -> Array:
    """How far each quantity may be from its value at the middle, (m, k); slopes (3, 4, k)."""
    pairs = zip(pieces.bernstein[:3], state, strict=True)
    moved = [np.abs(coefficients - at[:, None]).max(axis=1) for coefficients, at in pairs]
    return CAUTION * sum(distance @ slope for distance, slope in zip(moved, slopes, strict=True))


def starting(pieces: Pieces, robot: Robot) -> Mask:
    """(m,): a driven joint stands at an end of the piece and moves within it, so that friction may be static."""
    driven = np.array([joint.drive is not None for joint in robot.joints])
    speed = np.abs(pieces.bernstein[1])
    ends = np.minimum(speed[:, 0], speed[:, -1]) <= still(robot)
    return np.asarray(np.any((ends & pieces.moving(robot))[:, driven], axis=1))
