"""Tilt of a mechanism as a function of its second joint."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ssm_planner.codegen.namespace import NUMPY
from ssm_planner.kinematics.mechanism import Mechanism, tilt_magnitude
from ssm_planner.typing import Array


def tilt_from_theta2(mechanism: Mechanism, theta2: ArrayLike) -> Array:
    """Return the tilt φ(θ2) in rad on the home side, with the shape of theta2."""
    x = np.asarray(theta2, dtype=float) - mechanism.delta
    return np.asarray(mechanism.side * tilt_magnitude(NUMPY, mechanism.alpha, mechanism.beta, x))
