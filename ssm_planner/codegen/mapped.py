"""CasADi Functions at many points at once, called again and again: no object is made for a call."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.typing import Array, Indices


class Mapped:
    """A CasADi Function (z, *p, multipliers if any) at n elements, dense: (n, size) or (n, rows, columns)."""

    def __init__(self, function: ca.Function, parameters: Sequence[Array], count: int) -> None:
        mapped = _mapped(
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
        self._whole: Array | None = None
        self._outputs = [((count, *size), places) for size, places in _outputs(function)]

    def at(self, z: int, *others: int) -> None:
        """The same by addresses: of z, (n, size), of the multipliers where there are any, and of the last result, dense."""
        *multipliers, result = others
        for values, start in zip(
            (self._arguments[0], *self._arguments[-1:]), (z, *multipliers), strict=False
        ):
            ctypes.memmove(values.ctypes.data, start, values.nbytes)
        self._trigger()
        values, (shape, places) = self._results[-1], self._outputs[-1]
        if places is not None:
            if self._whole is None:
                self._whole = np.zeros((shape[0], shape[1] * shape[2]))
            self._whole[:, places] = values
            values = self._whole
        ctypes.memmove(result, values.ctypes.data, values.nbytes)

    def __call__(self, z: Array, multipliers: Array | None = None) -> list[Array]:
        self._arguments[0][...] = z[:, : self._arguments[0].shape[1]]
        if multipliers is not None:
            self._arguments[-1][...] = multipliers
        self._trigger()
        found = []
        for values, (shape, places) in zip(self._results, self._outputs, strict=True):
            if places is None:
                found.append(values.copy())
                continue
            whole = np.zeros((shape[0], shape[1] * shape[2]))
            whole[:, places] = values
            found.append(whole if shape[2] == 1 else whole.reshape(shape))
        return found


@lru_cache(maxsize=128)
def _mapped(function: ca.Function, count: int, shared: tuple[int, ...]) -> ca.Function:
    return function.map(function.name(), "serial", count, list(shared), [])


@lru_cache(maxsize=128)
def _outputs(function: ca.Function) -> list[tuple[tuple[int, int], Indices | None]]:
    """Shape of every output, and the places of its entries in it row by row; None where they are in order already."""
    found: list[tuple[tuple[int, int], Indices | None]] = []
    for i in range(function.n_out()):
        rows, columns = function.size_out(i)
        row, column = np.array(function.sparsity_out(i).get_triplet(), dtype=int)
        found.append(
            ((rows, columns), None if columns == 1 and len(row) == rows else row * columns + column)
        )
    return found
