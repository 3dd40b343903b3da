"""Evaluate CasADi Functions repeatedly at many points, without new Python objects in each call."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.typing import Array, Indices


class MappedFunction:
    """CasADi Function that is evaluated at n elements in one call.

    Its arguments are z, the parameters and, if the Function has another argument, multipliers.
    Results are dense, with the shape (n, size) or (n, rows, columns).
    """

    def __init__(self, function: ca.Function, parameters: Sequence[Array], count: int) -> None:
        """Allocate the buffers of all calls.

        Parameters
        ----------
        function : casadi.Function
            Function of z, the parameters and optionally multipliers.
        parameters : sequence of (size,) or (count, size) arrays
            Parameters, which may be common to all elements.
        count : int
            Number n of elements.
        """
        mapped = _map_function(
            function, count, tuple(i + 1 for i, values in enumerate(parameters) if values.ndim == 1)
        )
        buffer: Any
        buffer, self._trigger = mapped.buffer()
        self._arguments = [np.empty((count, function.size1_in(0)))]
        self._arguments += [np.ascontiguousarray(values, dtype=float) for values in parameters]
        if function.n_in() > len(self._arguments):
            self._arguments.append(np.empty((count, function.size1_in(len(self._arguments)))))
        self._results = [np.empty((count, function.nnz_out(i))) for i in range(function.n_out())]
        for i, values in enumerate(self._arguments):
            buffer.set_arg(i, values.data)
        for i, values in enumerate(self._results):
            buffer.set_res(i, values.data)
        self._buffer = buffer
        self._outputs = [
            ((count, *size), positions) for size, positions in _output_layouts(function)
        ]

    def __call__(self, z: Array, multipliers: Array | None = None) -> list[Array]:
        """Evaluate the Function.

        Parameters
        ----------
        z : (n, size) array
            First argument. Additional columns are ignored.
        multipliers : (n, k) array, optional
            Last argument.

        Returns
        -------
        list of arrays
            One array for each output, with n as its first length.
        """
        self._arguments[0][...] = z[:, : self._arguments[0].shape[1]]
        if multipliers is not None:
            self._arguments[-1][...] = multipliers
        self._trigger()
        results = []
        for values, (shape, positions) in zip(self._results, self._outputs, strict=True):
            if positions is None:
                results.append(values.copy())
                continue
            padded = np.zeros((shape[0], shape[1] * shape[2]))
            padded[:, positions] = values
            results.append(padded if shape[2] == 1 else padded.reshape(shape))
        return results


@lru_cache(maxsize=128)
def _map_function(function: ca.Function, count: int, shared: tuple[int, ...]) -> ca.Function:
    """Map a Function over several elements.

    Parameters
    ----------
    function : casadi.Function
    count : int
        Number of elements.
    shared : tuple of int
        Indices of the arguments that all elements have in common.
    """
    return function.map(function.name(), "serial", count, list(shared), [])


@lru_cache(maxsize=128)
def _output_layouts(function: ca.Function) -> list[tuple[tuple[int, int], Indices | None]]:
    """Return the shape of every output, and the row-major positions of its nonzeros.

    The positions are None if all entries are nonzeros in this order.
    """
    outputs: list[tuple[tuple[int, int], Indices | None]] = []
    for i in range(function.n_out()):
        rows, columns = function.size_out(i)
        row, column = np.array(function.sparsity_out(i).get_triplet(), dtype=int)
        outputs.append(
            ((rows, columns), None if columns == 1 and len(row) == rows else row * columns + column)
        )
    return outputs
