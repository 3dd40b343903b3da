"""Evaluation of CasADi Functions at many points in one call, with fixed buffers.

`vectorised.call` uses this module for few samples, and for Functions that contain an operation
which `vectorised` lacks. For many samples, `vectorised.VectorisedFunction` is faster.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.typing import Array, Indices


class MappedFunction:
    """CasADi Function that is evaluated at n samples in one call.

    The Function has the arguments z (which differs from sample to sample), parameters, and
    optionally one more argument, for example multipliers. CasADi reads and writes NumPy arrays that
    this object allocates once.
    """

    def __init__(self, function: ca.Function, parameters: Sequence[Array], count: int) -> None:
        """Allocate the buffers of all calls.

        Parameters
        ----------
        function : casadi.Function
            Function of column vectors: z, the parameters and optionally one more argument.
        parameters : sequence of (size,) or (count, size) arrays
            Values of the parameters. An array (size,) applies to all samples.
        count : int
            Number n of samples.
        """
        # Argument 0 is z, so the parameters are the arguments from 1 on.
        shared = tuple(i for i, values in enumerate(parameters, start=1) if values.ndim == 1)
        mapped = _map_function(function, count, shared)
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
        """Evaluate the Function at all samples.

        Parameters
        ----------
        z : (n, size) array
            First argument. Columns beyond the size of the argument are ignored.
        multipliers : (n, k) array, optional
            Last argument, if the Function has one after the parameters.

        Returns
        -------
        list of arrays
            One dense array for each output, (n, size) for a column vector and (n, rows, columns)
            for a matrix.
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
            # CasADi returns the structural nonzeros only.
            padded = np.zeros((shape[0], shape[1] * shape[2]))
            padded[:, positions] = values
            results.append(padded if shape[2] == 1 else padded.reshape(shape))
        return results


@lru_cache(maxsize=128)
def _map_function(function: ca.Function, count: int, shared: tuple[int, ...]) -> ca.Function:
    """Build a CasADi Function that evaluates another one at several samples, one after the other.

    Parameters
    ----------
    function : casadi.Function
        Function to evaluate.
    count : int
        Number of samples.
    shared : tuple of int
        Indices of the arguments that have one value for all samples.

    Returns
    -------
    casadi.Function
        Function with one column for each sample in its other arguments and in its results.
    """
    return function.map(function.name(), "serial", count, list(shared), [])


@lru_cache(maxsize=128)
def _output_layouts(function: ca.Function) -> list[tuple[tuple[int, int], Indices | None]]:
    """Determine the shape of every output, and the positions of its structural nonzeros.

    Parameters
    ----------
    function : casadi.Function
        The Function.

    Returns
    -------
    list of ((int, int), array of int or None)
        Shape of each output, and index of each nonzero in the output in row-major order. The
        indices are None for a dense column vector, whose nonzeros already have this order.
    """
    outputs: list[tuple[tuple[int, int], Indices | None]] = []
    for i in range(function.n_out()):
        rows, columns = function.size_out(i)
        row, column = np.array(function.sparsity_out(i).get_triplet(), dtype=int)
        is_dense_vector = columns == 1 and len(row) == rows
        positions = None if is_dense_vector else row * columns + column
        outputs.append(((rows, columns), positions))
    return outputs
