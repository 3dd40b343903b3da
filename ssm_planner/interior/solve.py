"""Python interface of the structured interior-point solver in C (`native/solver.c`).

The solver minimises a sequence of barrier functions by Newton steps with a filter line search. Its
linear systems are small positive definite band matrices with a border. Without the compiled part
(`native.library`), only Ipopt solves programs.
"""

import ctypes

import numpy as np

from ssm_planner.interior.problem import ElementGroup, Point, Program
from ssm_planner.native import library
from ssm_planner.typing import Array, record

OPTIMALITY_TOLERANCE = 1e-8
"""Largest residual of the optimality conditions at the solution."""
TOLERANCE_PER_BARRIER = 11.0
"""Tolerance divided by the last weight μ of the barrier."""
FIRST_BARRIER = 1e-4
"""First weight μ of the barrier in a cold start."""


@record
class State:
    """The final state of a solve, from which another solve may start.

    Attributes
    ----------
    point : Point
        The last iterate.
    equality_multipliers : array
        Multipliers of the equalities.
    """

    point: Point
    slacks: Array
    """Slacks of all rows (`Program.sizes`). The slack of an unlimited row is 1."""
    multipliers: Array
    """Multipliers of all rows. The multiplier of an unlimited row is 0."""
    equality_multipliers: Array


@record
class Outcome:
    """The result of a solve.

    Attributes
    ----------
    converged : bool
        True if the stopping test was met.
    iterations : int
        Number of iterations.
    state : State
        The solution, or the last iterate.
    objective : float
        Value of the objective.
    """

    converged: bool
    iterations: int
    state: State
    z: Array
    """Elements, (n, 5 m + 1)."""
    objective: float


def solve(
    program: Program,
    start: Point,
    *,
    warm: State | None,
    iterations: int,
    barrier_exponent: float,
    centring_tolerance: float,
) -> Outcome:
    """Find a local minimum of a program.

    Parameters
    ----------
    program : Program
        The program.
    start : Point
        Initial point of a cold start.
    warm : State or None
        Final state of a solve of the same dimensions, which replaces `start`.
    iterations : int
        Largest number of iterations.
    barrier_exponent : float
        Largest exponent e with which the weight of the barrier decreases, μ → μ^e. A smaller
        exponent takes more iterations.
    centring_tolerance : float
        Relative deviation of slack times multiplier from the last weight of the barrier. The solver
        uses it for multipliers that it computes from slacks. It is not a condition of convergence.

    Returns
    -------
    Outcome
        The last iterate, and whether it converged.

    Raises
    ------
    RuntimeError
        Without the compiled part.
    MemoryError
        If the solver cannot allocate memory.
    """
    native = library.load()
    if native is None:
        raise RuntimeError("the structured solver is not compiled on this machine")
    initial = start if warm is None else warm.point
    rows, equalities = program.sizes
    point = Point(np.array(initial.c, dtype=float), np.array(initial.times, dtype=float))
    state = State(point, np.empty(rows), np.zeros(rows), np.zeros(equalities))
    if warm is not None:
        state.multipliers[:] = warm.multipliers
        state.equality_multipliers[:] = warm.equality_multipliers
    z = np.empty((program.spline.elements, 5 * program.spline.coordinates + 1))
    values = (point.c, point.times, state.slacks, state.multipliers, state.equality_multipliers, z)
    native_state = _State(*(array.ctypes.data for array in values))
    native_program = _NativeProgram(program)
    options = _Options(
        iterations, OPTIMALITY_TOLERANCE, barrier_exponent, FIRST_BARRIER, centring_tolerance
    )
    pointers = (ctypes.byref(array) for array in (native_program.program, native_state))
    status = native.ssm_solve(*pointers, int(warm is not None), ctypes.byref(options))
    if status > _CONVERGED:
        raise MemoryError("the structured solver ran out of memory")
    return Outcome(
        status == _CONVERGED, native_state.iterations, state, z, objective=native_state.objective
    )


_CONVERGED = 1
_P = ctypes.c_void_p
_L = ctypes.c_long
_D = ctypes.c_double


class _Group(ctypes.Structure):
    """A group of rows as C sees it, in the layout of `RowGroup` in native/interior.h."""

    _fields_ = (("functions", ElementGroup), ("elements", _P), ("bound", _P), ("cost_weight", _D))


class _Program(ctypes.Structure):
    """A program as C sees it, in the layout of `Program` in native/interior.h."""

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


class _Options(ctypes.Structure):
    """The options of a solve, in the layout of `Patience` in native/interior.h."""

    _fields_ = (
        ("iterations", _L),
        ("tolerance", _D),
        ("superlinear", _D),
        ("barrier", _D),
        ("off_centre", _D),
    )


class _State(ctypes.Structure):
    """The final state of a solve, in the layout of `State` in native/interior.h."""

    _fields_ = (
        *(
            (name, _P)
            for name in ("c", "times", "slacks", "multipliers", "equality_multipliers", "z")
        ),
        ("objective", _D),
        ("iterations", _L),
    )


class _NativeProgram:
    """A program in the layout of C, and all memory to which it points."""

    def __init__(self, program: Program) -> None:
        """Convert a program. The object keeps the memory alive."""
        self._kept: list[object] = []
        groups = (_Group * len(program.groups))(
            *(
                _Group(
                    group.native.group,
                    self._longs(group.elements),
                    self._doubles(group.bound),
                    group.cost_weight,
                )
                for group in program.groups
            )
        )
        self._kept += [program, groups]
        spline = program.spline
        element, entry, value = program.equal
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
            equal_at=self._longs(element),
            equal_entry=self._longs(entry),
            equal_value=self._doubles(value),
            least_times=self._doubles(program.least_times),
            smoothing=self._doubles(program.smoothing),
            low=program.duration[0],
            high=program.duration[1],
            time_weight=program.time_weight,
            even=program.block_variance_weight,
            group_count=len(groups),
            groups=ctypes.addressof(groups),
        )

    def _doubles(self, values: object) -> int:
        """Return the address of an array of doubles."""
        return self._keep(values, float)

    def _longs(self, values: object) -> int:
        """Return the address of an array of C longs."""
        return self._keep(values, np.dtype(ctypes.c_long))

    def _keep(self, values: object, dtype: object) -> int:
        """Return the address of a contiguous array, and keep its memory."""
        array = np.ascontiguousarray(values, dtype=dtype)  # type: ignore[call-overload]
        self._kept.append(array)
        return array.ctypes.data
