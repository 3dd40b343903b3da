"""How NumPy arrays reach a CasADi Function: batches of samples, and named parameters as one vector."""

from __future__ import annotations

from itertools import accumulate, pairwise
from types import SimpleNamespace
from typing import Any

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


class Layout:
    """Names and lengths of parameters that travel as one vector, in NumPy and in CasADi.

    Layout(gravity=3, scale=1) packs gravity (3,) and scale into (4,).
    """

    def __init__(self, **lengths: int) -> None:
        ends = accumulate(lengths.values(), initial=0)
        self.slices = {name: slice(*ends_) for name, ends_ in zip(lengths, pairwise(ends), strict=True)}
        self.size = sum(lengths.values())

    def pack(self, **values: Any) -> Array:
        """All parameters as one vector (size,); each value has as many numbers as its name, in any shape.

        Raises GeometryError for a missing or unknown name, or a wrong count of numbers.
        """
        parts = {name: np.ravel(value) for name, value in values.items()}
        wanted = {name: part.stop - part.start for name, part in self.slices.items()}
        if {name: part.size for name, part in parts.items()} != wanted:
            raise GeometryError(f"parameters {wanted} expected, got { {name: p.size for name, p in parts.items()} }")
        return np.concatenate([parts[name] for name in self.slices])

    def unpack(self, vector: Any) -> SimpleNamespace:
        """The parameters by name: of a CasADi vector (size,), or of the last axis of an array (…, size)."""
        last_axis = isinstance(vector, np.ndarray)
        return SimpleNamespace(
            **{name: vector[..., part] if last_axis else vector[part] for name, part in self.slices.items()}
        )
