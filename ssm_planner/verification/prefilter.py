"""Exclusion of pieces of a very long trajectory by one evaluation in their middle.

A quantity differs from its value at the middle of a piece by at most Σ S·Δ. S is the largest change
per change of q, qd or qdd that was sampled along the trajectory. Δ is the largest change of these
within the piece according to their Bernstein coefficients.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.typing import Array, Mask
from ssm_planner.verification.pieces import Pieces, State, pieces_of, still

WORTHWHILE = 20_000
"""Number of pieces above which the prefilter saves time."""
PARTS = 8
"""Number of parts of a block of pieces."""
CAUTION = 2.0
STEP = 1e-4
"""Step of the differences for S, relative to the distance that a joint travels in one second."""

Evaluate = Callable[[State, Array, Array], Array]
"""Function from (q, qd, qdd), directions and breakaways, each (n, 4), to quantities (n, k)."""


def sensitivity(trajectory: Trajectory, robot: Robot, evaluate: Evaluate) -> Array:
    """Return the largest |∂quantity / ∂(q, qd, qdd)| along a trajectory, (3, 4, k).

    Central differences are taken where a joint has an extreme position, velocity or acceleration in
    a part of a block of pieces. A short move among many pieces at rest is therefore included.
    """
    return _slopes(np.concatenate(list(_extremes(trajectory)), axis=1), robot, evaluate)


def _extremes(trajectory: Trajectory) -> Iterator[Array]:
    """Return the extreme states (3, n, 4) in the PARTS of each block of pieces."""
    for pieces in pieces_of(trajectory):
        state = np.stack(middle(pieces))
        indices = [np.empty(0, dtype=np.intp)]
        for block in np.array_split(np.arange(state.shape[1]), PARTS):
            if len(block):
                values = state[:, block]
                indices += [
                    block[values.argmin(axis=1)].ravel(),
                    block[values.argmax(axis=1)].ravel(),
                ]
        yield state[:, np.unique(np.concatenate(indices))]


def _slopes(state: Array, robot: Robot, evaluate: Evaluate) -> Array:
    """Return the largest slopes (3, 4, k) at states (3, n, 4)."""
    direction = np.sign(state[1])
    breakaway = np.zeros_like(state[1])

    def slope(order: int, i: int) -> Array:
        step = np.zeros((3, 1, 4))
        step[order, 0, i] = STEP * robot.joints[i].velocity
        high, low = (
            evaluate(tuple(point), direction, breakaway) for point in (state + step, state - step)
        )
        return np.abs(high - low).max(axis=0) / (2 * step[order, 0, i])

    return np.array([[slope(order, i) for i in range(4)] for order in range(3)])


def middle(pieces: Pieces) -> State:
    """Return q, qd and qdd, each (m, 4), at s = 1/2."""
    return pieces.evaluate(slice(None), np.full(len(pieces.start), 0.5))


def spread(pieces: Pieces, state: State, slopes: Array) -> Array:
    """Return the largest change (m, k) of each quantity from its value at the middle.

    slopes: (3, 4, k).
    """
    pairs = zip(pieces.bernstein[:3], state, strict=True)
    distances = [
        np.abs(coefficients - values[:, None]).max(axis=1) for coefficients, values in pairs
    ]
    return CAUTION * sum(
        distance @ slope for distance, slope in zip(distances, slopes, strict=True)
    )


def starting(pieces: Pieces, robot: Robot) -> Mask:
    """Return whether friction may be static in each piece, (m,).

    It may be if a driven joint stands at an end of the piece and moves within it.
    """
    driven = np.array([joint.drive is not None for joint in robot.joints])
    speed = np.abs(pieces.bernstein[1])
    ends = np.minimum(speed[:, 0], speed[:, -1]) <= still(robot)
    return np.any((ends & pieces.moving(robot))[:, driven], axis=1)
