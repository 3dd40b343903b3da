"""The one way by which NumPy arrays reach a CasADi Function."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ssm_planner.errors import GeometryError
from ssm_planner.typing import Array


def call(function: ca.Function, *arguments: Array) -> tuple[Array, ...]:
    """Evaluate a Function of column vectors over n samples.

    Each argument is (n, size of that input); each result is (n, size of that output). A bare Function takes a
    transposed batch without a word when it happens to be square, so the shapes are checked here.
    Raises GeometryError naming function, argument and both shapes.
    """
    if len(arguments) != function.n_in():
        raise GeometryError(f"{function.name()} takes {function.n_in()} arguments, got {len(arguments)}")
    samples = np.shape(arguments[0])[0] if np.ndim(arguments[0]) == 2 else -1
    for i, argument in enumerate(arguments):
        expected = (samples, function.size1_in(i))
        if np.shape(argument) != expected:
            size = expected[1]
            raise GeometryError(
                f"{function.name()}: argument {function.name_in(i)} has shape {np.shape(argument)}, expected (n, {size})"
                + ("" if i == 0 or samples < 0 else f" with n = {samples}")
            )
    if samples == 0:
        return tuple(np.zeros((0, function.size1_out(i))) for i in range(function.n_out()))
    results = function.map(samples)(*(np.asarray(argument, dtype=float).T for argument in arguments))
    if function.n_out() == 1:
        results = (results,)
    return tuple(np.ascontiguousarray(result.full().T) for result in results)
