"""Verify the solver of the Newton system in native/band.c against dense linear algebra."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
import pytest

from ssm_planner.elements.compiled import compiled_library
from ssm_planner.native import library
from ssm_planner.typing import Array

pytestmark = pytest.mark.skipif(
    not compiled_library(), reason="the package is built without its compiled part"
)
P, L = ctypes.POINTER(ctypes.c_double), ctypes.c_long


class System(ctypes.Structure):
    """This class mirrors the C struct of the same name."""

    _fields_ = (
        *((name, L) for name in ("size", "wide", "high", "columns", "padded")),
        *(
            (name, P)
            for name in (
                "band",
                "border",
                "corner",
                "factor",
                "solved",
                "schur",
                "shifted",
                "right",
            )
        ),
        *(("pivots", ctypes.POINTER(L)), ("last", ctypes.c_double)),
    )


class Memory(ctypes.Structure):
    """This class mirrors the C struct of the same name."""

    _fields_ = (("last", ctypes.c_void_p), ("failed", ctypes.c_int))


def pointer(values: Array) -> Any:
    return values.ctypes.data_as(ctypes.c_void_p)


def solved(
    local: Array, border: Array, corner: Array, right: Array, free: Array, stride: int, blocks: int
) -> tuple[Array, float] | None:
    """Return the solution and the shift δ of the diagonal, or None if no shift helps.

    The matrix K of the system is the sum of the element matrices `local` (elements, 4 m, 4 m).
    """
    native, system, memory = library.load(), System(), Memory()
    assert native is not None
    (size, columns), pairs = border.shape, local.shape[1] // 4
    address = ctypes.byref(system)
    try:
        assert native.ssm_system_new(
            address, ctypes.byref(memory), *map(L, (size, columns, pairs, stride))
        )
        band = np.ctypeslib.as_array(system.band, (size, 4 * pairs))
        wide = stride * pairs
        for k, block in enumerate(local):
            for i, j in zip(*np.tril_indices(len(block)), strict=True):
                band[k * wide + j, i - j // wide * wide] += block[i, j]
        np.ctypeslib.as_array(system.border, (columns, system.padded))[:, :size] = border.T
        np.ctypeslib.as_array(system.corner, (columns, columns))[:] = corner
        if not native.ssm_factorise(address, pointer(free.astype(np.uint8)), L(blocks)):
            return None
        inner, rest = right[:size].copy(), right[size:].copy()
        native.ssm_solve_factors(address, pointer(inner), pointer(rest))
        return np.concatenate([inner, rest]), system.last
    finally:
        native.ssm_release(ctypes.byref(memory))


def whole_matrix(local: Array, border: Array, corner: Array, free: Array, stride: int) -> Array:
    """Return the dense matrix of the same system, without a shift."""
    size, pairs = len(border), local.shape[1] // 4
    complete = np.zeros((size + len(corner),) * 2)
    for k, block in enumerate(local):
        span = slice(k * stride * pairs, k * stride * pairs + len(block))
        complete[span, span] += block
    held = np.flatnonzero(~free)
    complete[held] = complete[:, held] = 0.0
    complete[held, held] = 1.0
    complete[:size, size:], complete[size:, :size], complete[size:, size:] = (
        border,
        border.T,
        corner,
    )
    return complete


@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize(("blocks", "equalities"), [(1, 0), (3, 0), (2, 3)])
@pytest.mark.parametrize("convex", [True, False])
def test_against_dense_linear_algebra(
    stride: int, blocks: int, equalities: int, convex: bool
) -> None:
    random, pairs, count = np.random.default_rng(stride + 10 * blocks), 3, 7
    factors = random.normal(size=(count, 4 * pairs, 20))
    local = factors @ factors.transpose(0, 2, 1) - (0.0 if convex else 10.0) * np.eye(4 * pairs)
    size, columns = (stride * (count - 1) + 4) * pairs, blocks + equalities
    free = random.uniform(size=size) < 0.9
    border = random.normal(size=(size, columns)) * free[:, None]
    corner = np.zeros((columns, columns))
    corner[:blocks, :blocks] = 100.0 * np.eye(blocks)
    corner[blocks:, :blocks] = random.normal(size=(equalities, blocks))
    corner[:blocks, blocks:] = corner[blocks:, :blocks].T
    for k, block in enumerate(local):  # Variables that are not free have no entries.
        mask = free[k * stride * pairs :][: 4 * pairs]
        block *= np.outer(mask, mask)
    right = random.normal(size=size + columns)
    result = solved(local, border, corner, right, free, stride, blocks)
    assert result is not None
    solution, delta = result
    assert (delta == 0.0) == convex
    complete = whole_matrix(local, border, corner, free, stride)
    raised = np.flatnonzero(np.append(free, np.arange(columns) < blocks))
    complete[raised, raised] += delta
    assert solution == pytest.approx(np.linalg.solve(complete, right), rel=1e-8, abs=1e-9)
    eigenvalues = np.linalg.eigvalsh(complete)
    assert np.count_nonzero(eigenvalues < 0) == equalities


def test_equalities_that_depend_on_one_another_have_no_step() -> None:
    """A system with linearly dependent equalities has no solution."""
    border = np.random.default_rng(1).normal(size=(8, 3))
    border[:, 2] = border[:, 1]
    assert (
        solved(
            np.eye(4)[None].repeat(3, 0),
            border[:6],
            np.diag([1.0, 0, 0]),
            np.ones(9),
            np.ones(6, bool),
            1,
            1,
        )
        is None
    )


@pytest.mark.parametrize("size", [1, 2, 5, 30])
def test_symmetric_factors(size: int) -> None:
    """The symmetric factorisation gives the inertia and the solution of dense linear algebra."""
    native, random = library.load(), np.random.default_rng(size)
    assert native is not None
    for _ in range(10):
        matrix = random.normal(size=(size, size)) * 10.0 ** random.uniform(-3, 3, size)
        matrix = matrix + matrix.T
        matrix[np.diag_indices(size)] *= random.uniform(size=size) < 0.5
        if np.linalg.cond(matrix) > 1e12:
            continue
        right, factors = random.normal(size=size), matrix.copy()
        pivots, inertia = np.zeros(size, dtype=np.int_), np.zeros(3, dtype=np.int_)
        assert native.ssm_symmetric_factor(
            pointer(factors), L(size), pointer(pivots), pointer(inertia)
        )
        eigenvalues = np.linalg.eigvalsh(matrix)
        assert inertia.tolist() == [
            np.count_nonzero(eigenvalues > 0),
            np.count_nonzero(eigenvalues < 0),
            0,
        ]
        solution = right.copy()
        native.ssm_symmetric_solve(pointer(factors), L(size), pointer(pivots), pointer(solution))
        assert matrix @ solution == pytest.approx(right, rel=1e-5, abs=1e-5)
