"""The structured interior point, in C (`native/solver.c`, with its mathematics), as Python asks for it.

A filter line search over Newton steps on a small positive definite band with a border. Without the compiled part nothing is
solved here (`available`): Ipopt then solves alone.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import numpy as np

from ssm_planner.interior.problem import Called, ElementGroup, Point, Program
from ssm_planner.native import library
from ssm_planner.typing import Array

TOLERANCE = 1e-8
LAST_BARRIER = 11.0
"""tolerance in the last μ."""
SUPERLINEAR = 1.5
"""Exponent of μ from one barrier problem to the next."""
BARRIER = 1e-4
"""First μ of a cold start."""


@dataclass(frozen=True, eq=False)
class State:
    """Where a solve ended; another one may start from there."""

    point: Point
    slacks: Array
    """Of all rows (`Program.sizes`), 1 where one does not count."""
    multipliers: Array
    """Likewise, 0 there."""
    equality_multipliers: Array

    def fits(self, program: Program) -> bool:
        """Whether it is a state of a program of this size."""
        sizes = (
            self.point.c.shape,
            len(self.point.times),
            (len(self.slacks), len(self.equality_multipliers)),
        )
        return sizes == (program.free.shape, program.spline.blocks, program.sizes)


@dataclass(frozen=True, eq=False)
class Outcome:
    """converged: the stopping test was met; else the state is the last one, and no solution."""

    converged: bool
    iterations: int
    state: State
    z: Array
    """The elements, (n, 5 m + 1)."""
    objective: float


def available() -> bool:
    """Whether programs can be solved here."""
    return library.load() is not None


def solve(
    program: Program,
    start: Point,
    *,
    warm: State | None = None,
    iterations: int = 300,
    tolerance: float = TOLERANCE,
    superlinear: float = SUPERLINEAR,
    barrier: float = BARRIER,
    off_centre: float = np.inf,
) -> Outcome:
    """A local minimum of the program from a point, or from where the solve of a neighbour ended, if that is of its size.

    superlinear: the exponent by which the barrier's weight falls at most; a smaller one takes more iterations. barrier: the
    first weight of a cold start; a large one leads away from a point that is nearly the minimum. off_centre: by which share
    slack times multiplier may be off the last weight, for multipliers that are to follow from slacks; not a condition of
    having converged.
    Raises RuntimeError without the compiled part.
    """
    native = library.load()
    if native is None:
        raise RuntimeError("the structured solver is not compiled here")
    if warm is not None and not warm.fits(program):
        warm = None
    first = start if warm is None else warm.point
    rows, equalities = program.sizes
    point = Point(np.array(first.c, dtype=float), np.array(first.times, dtype=float))
    state = State(point, np.empty(rows), np.zeros(rows), np.zeros(equalities))
    if warm is not None:
        state.multipliers[:], state.equality_multipliers[:] = (
            warm.multipliers,
            warm.equality_multipliers,
        )
    z = np.empty((program.spline.elements, 5 * program.spline.coordinates + 1))
    values = (point.c, point.times, state.slacks, state.multipliers, state.equality_multipliers, z)
    native_state = _State(*(each.ctypes.data for each in values))
    given = _Given(program)
    patience = _Patience(iterations, tolerance, superlinear, barrier, off_centre)
    pointers = (ctypes.byref(each) for each in (given.program, native_state))
    status = native.ssm_solve(*pointers, int(warm is not None), ctypes.byref(patience))
    given.raise_failure()
    if status > _CONVERGED:
        raise MemoryError("the structured solver")
    return Outcome(
        status == _CONVERGED,
        native_state.iterations,
        state,
        z,
        objective=native_state.objective,
    )


_CONVERGED = 1
_P, _L, _D = ctypes.c_void_p, ctypes.c_long, ctypes.c_double


class _Group(ctypes.Structure):
    _fields_ = (("functions", ElementGroup), ("elements", _P), ("bound", _P), ("cost_weight", _D))


class _Program(ctypes.Structure):
    _fields_ = (
        *((name, _L) for name in ("kind", "coordinates", "elements", "blocks", "linear_rows")),
        *(
            ("fractions", _P),
            ("block", _P),
            ("stretched_from", _D),
            ("matrix", _P),
            ("bound", _P),
            ("free", _P),
        ),
        *(("equal_count", _L), ("equal_at", _P), ("equal_entry", _P), ("equal_value", _P)),
        *(("least_times", _P), ("smoothing", _P)),
        *((name, _D) for name in ("low", "high", "time_weight", "even")),
        *(("group_count", _L), ("groups", _P)),
    )


class _Patience(ctypes.Structure):
    _fields_ = (
        ("iterations", _L),
        ("tolerance", _D),
        ("superlinear", _D),
        ("barrier", _D),
        ("off_centre", _D),
    )


class _State(ctypes.Structure):
    _fields_ = (
        *(
            (name, _P)
            for name in ("c", "times", "slacks", "multipliers", "equality_multipliers", "z")
        ),
        ("objective", _D),
        ("iterations", _L),
    )


class _Given:
    """A program as C reads it, and all that it points to."""

    def __init__(self, program: Program) -> None:
        self._kept: list[object] = []
        self._groups = [Called(group) for group in program.groups]
        groups = (_Group * len(self._groups))(
            *(
                _Group(
                    called.functions,
                    self._longs(group.elements),
                    self._doubles(group.bound),
                    group.cost_weight,
                )
                for group, called in zip(program.groups, self._groups, strict=True)
            )
        )
        self._kept.append(groups)
        spline, (at, entry, value) = program.spline, program.equal
        self.program = _Program(
            kind=("hermite", "bspline").index(spline.kind),
            coordinates=spline.coordinates,
            elements=spline.elements,
            blocks=spline.blocks,
            linear_rows=len(program.matrix),
            fractions=self._doubles(spline.fractions),
            block=self._longs(spline.block),
            stretched_from=spline.stretched_from or 0.0,
            matrix=self._doubles(program.matrix),
            bound=self._doubles(program.bound),
            free=self._keep(program.free, np.uint8),
            equal_count=len(value),
            equal_at=self._longs(at),
            equal_entry=self._longs(entry),
            equal_value=self._doubles(value),
            least_times=self._doubles(program.least_times),
            smoothing=self._doubles(program.smoothing),
            low=program.duration[0],
            high=program.duration[1],
            time_weight=program.time_weight,
            even=program.even,
            group_count=len(groups),
            groups=ctypes.addressof(groups),
        )

    def raise_failure(self) -> None:
        """What a function raised, for C passes no exceptions on."""
        for failure in (each for called in self._groups for each in called.failures):
            raise failure

    def _doubles(self, values: object) -> int:
        return self._keep(values, float)

    def _longs(self, values: object) -> int:
        return self._keep(values, np.dtype(ctypes.c_long))

    def _keep(self, values: object, kind: object) -> int:
        array = np.ascontiguousarray(values, dtype=kind)  # type: ignore[call-overload]
        self._kept.append(array)
        return array.ctypes.data
