"""Fixtures with mechanisms for the tests of kinematics."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from ssm_planner.kinematics.mechanism import Mechanism
from ssm_planner.problem.robot import Geometry

RandomMechanism = Callable[..., Mechanism]


@pytest.fixture(scope="session")
def vitreoretinal() -> Mechanism:
    """Return the published robot: ω1 is horizontal, α = 30°, and ω3 is tilted by −113° about y."""
    sine, cosine = math.sin(math.radians(23.0)), math.cos(math.radians(23.0))
    return Mechanism.from_geometry(
        Geometry(
            omega1=np.array([1.0, 0.0, 0.0]),
            omega2=np.array([math.cos(math.pi / 6), math.sin(math.pi / 6), 0.0]),
            omega3=np.array([-sine, 0.0, cosine]),
            tool_home=np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]]),
        )
    )


@pytest.fixture(scope="session")
def random_mechanism() -> RandomMechanism:
    """Return a function that builds a random mechanism from a generator and optional angles in rad.

    The orientation, the home configuration and the insertion sign of the mechanism are random.
    """

    def make(
        rng: np.random.Generator, alpha: float | None = None, beta: float | None = None
    ) -> Mechanism:
        alpha = rng.uniform(0.02, math.pi - 0.02) if alpha is None else alpha
        beta = rng.uniform(0.02, math.pi - 0.02) if beta is None else beta
        turned, place = random_rotation(rng), rng.uniform(-math.pi, math.pi)
        omega2 = np.array([math.cos(alpha), math.sin(alpha), 0.0])
        toward = np.array([math.sin(alpha), -math.cos(alpha), 0.0])
        across = np.array([0.0, 0.0, -1.0])
        omega3 = math.cos(beta) * omega2 + math.sin(beta) * (
            math.cos(place) * toward + math.sin(place) * across
        )
        tool_z = turned @ omega3
        tool_x = np.cross(tool_z, random_rotation(rng)[:, 0])
        tool_x /= np.linalg.norm(tool_x)
        tool = np.column_stack((tool_x, np.cross(tool_z, tool_x), tool_z))
        return Mechanism.from_geometry(
            Geometry(
                turned[:, 0], turned @ omega2, tool_z, tool, insertion_sign=int(rng.choice([-1, 1]))
            )
        )

    return make


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    """Return a random rotation matrix (3, 3) from a QR decomposition."""
    matrix, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    return matrix * np.sign(np.linalg.det(matrix))
