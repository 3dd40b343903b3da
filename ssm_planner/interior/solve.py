"""Interface to the structured interior-point solver in C (native/solver.c).

An interior-point method adds μ times a logarithmic barrier of the inequality constraints to the
objective, and decreases the barrier weight μ step by step. The solver minimises each barrier
function by Newton steps with a filter line search. It is called structured because it makes use of
the structure of a motion. Each element (interval of time) depends only on unknowns of its
neighbours, so the linear systems are small positive definite band matrices with a border. If the
package was built without a C compiler, only Ipopt solves programs.
"""

import ctypes
from typing import Any

import numpy as np

from ssm_planner.interior.problem import ElementGroup, Point, Program, c_fields
from ssm_planner.native import library
from ssm_planner.typing import Array, record

OPTIMALITY_TOLERANCE = 1e-8
"""Largest residual of the optimality conditions (KKT) at a solution of this solver or of Ipopt."""
TOLERANCE_PER_BARRIER = 11.0
"""`OPTIMALITY_TOLERANCE` divided by the last barrier weight μ.

native/solver.c contains the same value. Ipopt uses the same weight μ when it confirms a solution.
"""
FIRST_BARRIER = 1e-4
"""First barrier weight μ of a solve without initial multipliers, in this solver and in Ipopt."""


@record
class State:
    """The last iterate of a solve, from which the solve of a similar program may start."""

    point: Point
    """Unknowns at the last iterate."""
    slacks: Array
    """Differences between bound and value of all r inequality constraints, (r,).

    They have the order of `Program.sizes`. The slack of a constraint without a finite bound is 1.
    """
    multipliers: Array
    """Lagrange multipliers of the inequality constraints, (r,), 0 without a finite bound."""
    equality_multipliers: Array
    """Lagrange multipliers of the e equality constraints, (e,)."""


@record
class Outcome:
    """The result of a solve."""

    converged: bool
    """True if the last iterate satisfies the optimality conditions within the tolerance."""
    iterations: int
    """Number of iterations."""
    state: State
    """State at the last iterate."""
    z: Array
    """Vectors z of all elements at the last iterate, (n, 5 m + 1)."""
    objective: float
    """Value of the objective at the last iterate."""


def solve(
    program: Program,
    start: Point,
    *,
    warm: State | None,
    iterations: int,
    barrier_exponent: float,
    centring_tolerance: float,
) -> Outcome:
    """Find a local minimum of a program (an optimisation problem of a motion).

    Parameters
    ----------
    program : Program
        The program.
    start : Point
        Initial values of the unknowns. They are not used with `warm`.
    warm : State or None
        Last iterate of a solve of the same dimensions, from which this solve starts. None: the
        solve starts from `start` without multipliers.
    iterations : int
        Largest number of iterations.
    barrier_exponent : float
        Largest exponent e with which the weight of the barrier decreases, μ → μ^e. A smaller
        exponent takes more iterations.
    centring_tolerance : float
        Largest relative deviation of slack times multiplier from the last barrier weight, for a
        caller that needs a solution close to the central path. Infinite for any other caller. To
        meet the tolerance, the solver computes multipliers from the slacks. The tolerance is not a
        condition of convergence.

    Returns
    -------
    Outcome
        The last iterate, and whether it converged.

    Raises
    ------
    RuntimeError
        If the package was built without a C compiler.
    MemoryError
        If the solver cannot allocate memory.
    """
    native = library.load()
    if native is None:
        raise RuntimeError("the structured solver is not compiled on this machine")
    # The solver writes its results to arrays that exist before the call.
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
    status = native.ssm_solve(
        ctypes.byref(native_program.program),
        ctypes.byref(native_state),
        int(warm is not None),
        ctypes.byref(options),
    )
    if status > _CONVERGED:
        raise MemoryError("the structured solver ran out of memory")
    return Outcome(
        status == _CONVERGED, native_state.iterations, state, z, objective=native_state.objective
    )


_CONVERGED = 1
"""Status that `ssm_solve` returns if it has converged.

It returns 0 if it has not converged, and a larger status if there is not enough memory.
"""
_P = ctypes.c_void_p
_L = ctypes.c_long
_D = ctypes.c_double


class _Group(ctypes.Structure):
    """A `RowGroup` in C: the struct of this name in native/interior.h."""

    _fields_ = (
        c_fields(ElementGroup, "functions")
        + c_fields(_P, "elements bound")
        + c_fields(_D, "cost_weight")
    )


class _Program(ctypes.Structure):
    """A `Program` in C: the struct of this name in native/interior.h."""

    _fields_ = (
        c_fields(_L, "kind coordinates elements blocks linear_rows")
        + c_fields(_P, "fractions block")
        + c_fields(_D, "stretched_from")
        + c_fields(_P, "matrix bound free")
        + c_fields(_L, "equal_count")
        + c_fields(_P, "equal_at equal_entry equal_value least_times smoothing")
        + c_fields(_D, "low high time_weight even")
        + c_fields(_L, "group_count")
        + c_fields(_P, "groups")
    )


class _Options(ctypes.Structure):
    """The options of a solve in C: the struct `Patience` in native/interior.h."""

    _fields_ = c_fields(_L, "iterations") + c_fields(_D, "tolerance superlinear barrier off_centre")


class _State(ctypes.Structure):
    """A `State` and further results in C: the struct `State` in native/interior.h."""

    _fields_ = (
        c_fields(_P, "c times slacks multipliers equality_multipliers z")
        + c_fields(_D, "objective")
        + c_fields(_L, "iterations")
    )


class _NativeProgram:
    """A program as a C struct, and all memory to which it points."""

    def __init__(self, program: Program) -> None:
        """Convert a program to a C struct.

        Parameters
        ----------
        program : Program
            The program. This object keeps the memory of all its arrays alive.
        """
        groups = (_Group * len(program.groups))()
        self._memory: list[object] = [program, groups]
        for k, group in enumerate(program.groups):
            elements = self._address(group.elements, ctypes.c_long)
            bound = self._address(group.bound)
            groups[k] = _Group(group.native.group, elements, bound, group.cost_weight)
        spline = program.spline
        element, entry, value = program.equal
        low, high = program.duration
        self.program = _Program(
            kind=("hermite", "bspline").index(spline.kind),
            coordinates=spline.coordinates,
            elements=spline.elements,
            blocks=spline.blocks,
            linear_rows=len(program.matrix),
            fractions=self._address(spline.fractions),
            block=self._address(spline.block, ctypes.c_long),
            stretched_from=spline.stretched_from or 0.0,
            matrix=self._address(program.matrix),
            bound=self._address(program.bound),
            free=self._address(program.free, np.uint8),
            equal_count=len(value),
            equal_at=self._address(element, ctypes.c_long),
            equal_entry=self._address(entry, ctypes.c_long),
            equal_value=self._address(value),
            least_times=self._address(program.least_times),
            smoothing=self._address(program.smoothing),
            low=low,
            high=high,
            time_weight=program.time_weight,
            even=program.block_variance_weight,
            group_count=len(groups),
            groups=ctypes.addressof(groups),
        )

    def _address(self, values: Any, dtype: Any = float) -> int:
        """Store values as a contiguous array in `_memory`, and return its address.

        Parameters
        ----------
        values : array-like
            Numbers of any shape. They are only copied if they are not such an array yet.
        dtype : dtype or ctypes type
            Type of the entries in C. The default is double.

        Returns
        -------
        int
            Address of the first entry.
        """
        array = np.ascontiguousarray(values, dtype=dtype)
        self._memory.append(array)
        return array.ctypes.data
