"""Where the prefilter looks: at the extremes of every state, and at slopes that are those of the quantities."""

from __future__ import annotations

import numpy as np
import pytest

from ssm_planner.problem.robot import Robot
from ssm_planner.trajectory import Trajectory
from ssm_planner.verification import prefilter
from ssm_planner.verification.pieces import pieces_of


def test_the_extremes_of_every_part_are_among_the_states() -> None:
    rng = np.random.default_rng(9)
    coefficients = rng.normal(size=(60, 6, 4))
    motion = Trajectory(np.arange(61.0), coefficients, ())
    (pieces,) = pieces_of(motion)
    every = np.stack(prefilter.middle(pieces))
    (found,) = prefilter._extremes(motion)
    assert found.shape[1] < 60
    for part in np.array_split(np.arange(60), prefilter.PARTS):
        for order in range(3):
            for joint in range(4):
                values = every[order, part, joint]
                assert {values.min(), values.max()} <= set(found[order, :, joint].tolist())


def test_the_slopes_of_linear_quantities_are_their_factors(robot: Robot) -> None:
    rng = np.random.default_rng(10)
    factors = rng.normal(size=(3, 4, 5))
    states = rng.normal(size=(3, 6, 4))

    def evaluate(state, direction, breakaway):  # type: ignore[no-untyped-def]
        assert np.array_equal(direction, np.sign(states[1]))
        assert not breakaway.any()
        return np.einsum("onj,ojk->nk", np.stack(state), factors)

    assert prefilter._slopes(states, robot, evaluate) == pytest.approx(np.abs(factors), rel=1e-6)
