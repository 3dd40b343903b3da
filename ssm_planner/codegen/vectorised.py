"""Evaluate CasADi Functions for many samples, operation by operation, by NumPy or in C.

For many samples, this is several times faster than CasADi's virtual machine.
"""

import ctypes
from collections.abc import Callable, Iterator, Sequence
from functools import cache, lru_cache
from itertools import accumulate, pairwise
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.codegen.mapped import MappedFunction
from ssm_planner.errors import GeometryError
from ssm_planner.native import library
from ssm_planner.typing import Array, frozen


def _copy(source: Array, result: Array) -> None:
    """Copy an operand to the result (n,)."""
    result[...] = source


def _if_else_zero(condition: Array, value: Array, result: Array) -> None:
    """Write the value if the condition is true, and otherwise 0, (n,) each."""
    result[...] = np.where(condition != 0, value, 0.0)


@frozen
class Operation:
    """Implementation of a CasADi operation in NumPy and in C."""

    numpy: Callable[..., Any]
    """Function of the operands and of `out`, which are rows (n,)."""
    c: str
    """C expression with the macros of `c.REAL_DEFINITIONS`, in which {0} and {1} are operands."""

    @property
    def operands(self) -> int:
        """Number of operands."""
        return 2 if "{1}" in self.c else 1


OPERATIONS = {
    "assign": Operation(_copy, "{0}"),
    "neg": Operation(np.negative, "-{0}"),
    "sq": Operation(np.square, "{0} * {0}"),
    "twice": Operation(lambda a, out: np.add(a, a, out), "SSM_R(2.0) * {0}"),
    "inv": Operation(np.reciprocal, "SSM_R(1.0) / {0}"),
    "sign": Operation(np.sign, "sign_of({0})"),
    "not": Operation(np.logical_not, "(ssm_real)({0} == SSM_R(0.0))"),
    "add": Operation(np.add, "{0} + {1}"),
    "sub": Operation(np.subtract, "{0} - {1}"),
    "mul": Operation(np.multiply, "{0} * {1}"),
    "div": Operation(np.divide, "{0} / {1}"),
    "constpow": Operation(np.power, "SSM_F(pow)({0}, {1})"),
    "lt": Operation(np.less, "(ssm_real)({0} < {1})"),
    "le": Operation(np.less_equal, "(ssm_real)({0} <= {1})"),
    "eq": Operation(np.equal, "(ssm_real)({0} == {1})"),
    "ne": Operation(np.not_equal, "(ssm_real)({0} != {1})"),
    "and": Operation(np.logical_and, "(ssm_real)({0} != SSM_R(0.0) && {1} != SSM_R(0.0))"),
    "or": Operation(np.logical_or, "(ssm_real)({0} != SSM_R(0.0) || {1} != SSM_R(0.0))"),
    "if_else_zero": Operation(_if_else_zero, "({0} != SSM_R(0.0) ? {1} : SSM_R(0.0))"),
}
"""Operations by the name that CasADi gives them."""
for _name in [
    "exp",
    "log",
    "sqrt",
    "sin",
    "cos",
    "tan",
    "asin",
    "acos",
    "atan",
    "floor",
    "ceil",
    "fabs",
]:
    OPERATIONS[_name] = Operation(getattr(np, _name), f"SSM_F({_name})({{0}})")
for _name in ["pow", "fmin", "fmax", "atan2", "copysign", "fmod", "hypot"]:
    OPERATIONS[_name] = Operation(getattr(np, _name), f"SSM_F({_name})({{0}}, {{1}})")
"""Operations by CasADi's name."""


@frozen
class Instruction:
    """One operation of a Function.

    An operation that reads an input or writes an output refers to the element `index` of
    `argument`.

    Attributes
    ----------
    name : str
        Name of the operation: "const", "input", "output" or a key of `OPERATIONS`.
    out : int
        Index of the register of the result.
    operands : tuple of int
        Indices of the registers of the operands.
    constant : float
        Value of a constant.
    argument : int
        Index of the input or output.
    """

    name: str
    out: int = -1
    operands: tuple[int, ...] = ()
    constant: float = 0.0
    argument: int = -1
    index: int = -1
    """Index into the elements of the argument or result in column-major order."""


def instructions(function: ca.Function) -> Iterator[Instruction]:
    """Yield the operations of a Function of SX with dense inputs and outputs, in their order.

    Raises NotImplementedError for an operation that is not in `OPERATIONS`.
    """
    names = _operation_names()
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        name = names.get(operation)
        if name is None:
            raise NotImplementedError(
                f"{function.name()}: CasADi operation {operation} is not supported"
            )
        if name == "const":
            yield Instruction(
                name,
                function.instruction_output(k)[0],
                constant=float(function.instruction_constant(k)),
            )
        elif name == "input":
            argument, index = function.instruction_input(k)[:2]
            yield Instruction(
                name, function.instruction_output(k)[0], argument=argument, index=index
            )
        elif name == "output":
            argument, index = function.instruction_output(k)[:2]
            yield Instruction(
                name, operands=(function.instruction_input(k)[0],), argument=argument, index=index
            )
        else:
            operands = tuple(function.instruction_input(k)[: OPERATIONS[name].operands])
            yield Instruction(name, function.instruction_output(k)[0], operands)


def dense_function(name: str, inputs: list[ca.SX], outputs: list[ca.SX]) -> ca.Function:
    """Return a Function with dense outputs and shared common subexpressions."""
    shared = ca.cse([ca.densify(output) for output in outputs])
    return ca.Function(name, inputs, shared)


@cache
def _operation_names() -> dict[int, str]:
    """Return the names of the operations by CasADi's numbers."""
    names = ("const", "input", "output", *OPERATIONS)
    return {
        getattr(ca, f"OP_{name.upper()}"): name
        for name in names
        if hasattr(ca, f"OP_{name.upper()}")
    }


MIN_VECTORISED_SAMPLES = 200
"""Smallest number of samples for which `call` uses `VectorisedFunction`."""
SAMPLES_PER_BLOCK = 1024
"""Number of samples in a block, so that the registers stay in the processor's cache."""
NATIVE_OPERATIONS = (
    "assign",
    "neg",
    "sqrt",
    "sq",
    "twice",
    "inv",
    "fabs",
    "sign",
    "not",
    "add",
    "sub",
    "mul",
    "div",
    "lt",
    "le",
    "eq",
    "ne",
    "and",
    "or",
    "if_else_zero",
    "fmin",
    "fmax",
)
"""Operations of native/vectorised.c in the order of their codes."""
_REGISTER_MEMORY: list[Array] = []
"""Memory for the registers of the next call.

A new allocation would take an eighth of the time of the operations.
"""


class VectorisedFunction:
    """Dense Function of SX that is evaluated operation by operation over rows of samples.

    NumPy and C give identical results.
    """

    def __init__(self, function: ca.Function) -> None:
        """Compile a dense Function of SX. Raises NotImplementedError for an unknown operation."""
        self.name = function.name()
        self.rows_in = [function.numel_in(i) for i in range(function.n_in())]
        self.rows_out = [function.numel_out(i) for i in range(function.n_out())]
        self._registers = function.sz_w()
        operations, constants = self._compile(function)
        self._constants = np.array(constants)
        self._program = [
            (OPERATIONS[name].numpy, operand, other_operand, result)
            for name, operand, other_operand, result in operations
        ]
        codes = [
            (
                NATIVE_OPERATIONS.index(name) if name in NATIVE_OPERATIONS else -1,
                operand,
                max(other_operand, 0),
                result,
            )
            for name, operand, other_operand, result in operations
        ]
        self._codes = np.array(codes, dtype=np.dtype(ctypes.c_long)).reshape(-1, 4)
        bounds = np.flatnonzero(np.diff(self._codes[:, 0] < 0)) + 1
        self._parts = []
        """Runs of operations: start, end, codes (None if C lacks an operation), and count."""
        for start, end in pairwise([0, *bounds.tolist(), len(codes)]):
            code = (
                ctypes.c_void_p(self._codes[start:].ctypes.data)
                if self._codes[start, 0] >= 0
                else None
            )
            self._parts.append((start, end, code, ctypes.c_long(end - start)))
        sizes = self._registers, len(constants), *self.rows_in, *self.rows_out
        self._table = np.repeat(np.arange(len(sizes)), sizes)
        self._row = np.concatenate([np.arange(size) for size in sizes])
        """Table (registers, constants, arguments, results) and row of every slot."""
        self._seen = sorted(
            {
                k
                for _, *slots in (codes[i] for i in np.flatnonzero(self._codes[:, 0] < 0))
                for k in slots
            }
        )
        """Slots of operations that are not native."""
        self._places = list(zip(self._table.tolist(), self._row.tolist(), strict=True))

    def __call__(self, *arguments: Array) -> list[Array]:
        """Evaluate the Function.

        Arrays in Fortran order, in which the n values of an element are adjacent, are fastest. The
        results have this order.

        Parameters
        ----------
        *arguments : (n, size) arrays
            One array for each input, with one row for each sample.

        Returns
        -------
        list of (n, size) arrays
            One array for each output.

        Raises
        ------
        GeometryError
            If a shape is wrong.
        """
        n = arguments[0].shape[0]
        for argument, rows in zip(arguments, self.rows_in, strict=True):
            if argument.shape != (n, rows):
                raise GeometryError(
                    f"{self.name}: argument of shape {argument.shape}, expected {(n, rows)}"
                )
        results = [np.empty((rows, n)) for rows in self.rows_out]
        size = self._registers * min(n, SAMPLES_PER_BLOCK)
        cached = _REGISTER_MEMORY.pop() if _REGISTER_MEMORY else np.empty(0)
        memory = cached if len(cached) >= size else np.empty(size)
        work = memory[:size].reshape(self._registers, min(n, SAMPLES_PER_BLOCK))
        self._run(work, [*(np.asarray(values, dtype=float).T for values in arguments), *results], n)
        _REGISTER_MEMORY[:] = [memory]
        return [result.T for result in results]

    def _run(self, work: Array, inputs: list[Array], n: int) -> None:
        """Execute all operations for n samples, block by block.

        Parameters
        ----------
        work : (registers, samples of a block) array
            Memory for the registers.
        inputs : list of (k, n) arrays
            Rows of the arguments and of the results.
        n : int
            Number of samples.
        """
        tables = [work, self._constants, *inputs]
        starts = np.array([table.__array_interface__["data"][0] for table in tables])
        row_bytes, stride_bytes = np.array(
            [(table.strides[0], table.strides[-1]) for table in tables]
        ).T
        addresses = starts[self._table] + row_bytes[self._table] * self._row
        stride_bytes[1] = 0  # Constants do not depend on the sample.
        moves = stride_bytes[self._table]
        stride = moves // 8
        moves[: len(work)] = 0
        native = library.load()
        indices = range(len(addresses)) if native is None else self._seen
        sample_strides = ctypes.c_void_p(stride.ctypes.data)
        with np.errstate(invalid="ignore", divide="ignore"):
            for start in range(0, n, SAMPLES_PER_BLOCK):
                count = min(SAMPLES_PER_BLOCK, n - start)
                pointers = addresses + start * moves
                samples = ctypes.c_long(count)
                slots = ctypes.c_void_p(pointers.ctypes.data)
                selections = [slice(count), (), *[slice(start, start + count)] * len(inputs)]
                rows = {}
                for k in indices:
                    index, row = self._places[k]
                    rows[k] = tables[index][row][selections[index]]
                for low, high, code, size in self._parts:
                    if native is not None and code is not None:
                        native.ssm_operations(code, slots, sample_strides, size, samples)
                        continue
                    for operation, *operands in self._program[low:high]:
                        operation(*(rows[k] for k in operands if k >= 0))

    def _compile(
        self, function: ca.Function
    ) -> tuple[list[tuple[str, int, int, int]], list[float]]:
        """Translate a Function to a list of operations.

        A *slot* is a register, a constant, or a row of an argument or result. Slots have
        consecutive indices in this order.

        Returns
        -------
        operations : list of tuple
            Name, slot of the first operand, slot of the second operand or −1, and slot of the
            result.
        constants : list of float
        """
        sequence = list(instructions(function))
        constants = [step.constant for step in sequence if step.name == "const"]
        first_in = self._registers + len(constants)
        firsts_in = first_in + np.cumsum([0, *self.rows_in])
        firsts_out = firsts_in[-1] + np.cumsum([0, *self.rows_out])
        slot = list(range(self._registers))
        """Slot that contains the value of each register."""
        program: list[tuple[str, int, int, int]] = []
        slot_count = 0
        for step in sequence:
            operand, other_operand = (*(slot[k] for k in step.operands), -1, -1)[:2]
            if step.name == "const":
                slot[step.out] = self._registers + slot_count
                slot_count += 1
            elif step.name == "input":
                slot[step.out] = int(firsts_in[step.argument]) + step.index
            elif step.name == "output":
                program.append(("assign", operand, -1, int(firsts_out[step.argument]) + step.index))
            else:
                program.append((step.name, operand, other_operand, step.out))
                slot[step.out] = step.out
        return program, constants


def call(function: ca.Function, *arguments: Array) -> tuple[Array, ...]:
    """Evaluate a Function of column vectors over n samples.

    A CasADi Function silently accepts a transposed batch if it is square. This function checks the
    shapes instead.

    Parameters
    ----------
    function : casadi.Function
    *arguments : (n, size) arrays
        One array for each input of the function, whose length is `size`.

    Returns
    -------
    tuple of (n, size) arrays
        One array for each output.

    Raises
    ------
    GeometryError
        If a shape is wrong. The message names the function, the argument and both shapes.
    """
    samples = _sample_count(function, arguments)
    if samples == 0:
        return tuple(np.zeros((0, function.size1_out(i))) for i in range(function.n_out()))
    arrays = [np.asarray(argument, dtype=float) for argument in arguments]
    vectorised = _vectorised_function(function) if samples >= MIN_VECTORISED_SAMPLES else None
    if vectorised is not None:
        return tuple(vectorised(*arrays))
    return tuple(MappedFunction(function, arrays[1:], samples)(arrays[0]))


def _sample_count(function: ca.Function, arguments: Sequence[Array]) -> int:
    """Return the number n of samples in arguments (n, size).

    Raises GeometryError if the shapes are wrong.
    """
    sizes = _input_sizes(function)
    if len(arguments) != len(sizes):
        raise GeometryError(f"{function.name()} takes {len(sizes)} arguments, got {len(arguments)}")
    samples = np.shape(arguments[0])[0] if np.ndim(arguments[0]) == 2 else -1
    for i, (argument, size) in enumerate(zip(arguments, sizes, strict=True)):
        if np.shape(argument) != (samples, size):
            raise GeometryError(
                f"{function.name()}: argument {function.name_in(i)} has shape "
                f"{np.shape(argument)}, expected (n, {size})"
                + ("" if i == 0 or samples < 0 else f" with n = {samples}")
            )
    return samples


@lru_cache(maxsize=256)
def _input_sizes(function: ca.Function) -> tuple[int, ...]:
    """Return the lengths of the inputs of a Function."""
    return tuple(function.size1_in(i) for i in range(function.n_in()))


@lru_cache(maxsize=64)
def _vectorised_function(function: ca.Function) -> VectorisedFunction | None:
    """Return a Function for many samples, or None if it contains an unknown operation."""
    if not function.is_a("SXFunction"):
        return None
    inputs = [ca.SX.sym(f"x{i}", function.size1_in(i)) for i in range(function.n_in())]
    try:
        return VectorisedFunction(dense_function(function.name(), inputs, function.call(inputs)))
    except NotImplementedError:
        return None


class Layout:
    """Names and lengths of parameters that form one vector, in NumPy and in CasADi.

    For example, Layout(gravity=3, scale=1) packs gravity (3,) and scale into a vector (4,).

    Attributes
    ----------
    slices : dict of slice
        Position of each parameter in the vector.
    size : int
        Length of the vector.
    """

    def __init__(self, **lengths: int) -> None:
        """Place parameters with these lengths one after the other."""
        ends = accumulate(lengths.values(), initial=0)
        self.slices = {
            name: slice(*ends_) for name, ends_ in zip(lengths, pairwise(ends), strict=True)
        }
        self.size = sum(lengths.values())

    def pack(self, **values: Any) -> Array:
        """Return all parameters as one vector (size,).

        Each value may have any shape with the right number of entries. Raises GeometryError if a
        name is missing or unknown, or if a size is wrong.
        """
        arrays = {name: np.ravel(value) for name, value in values.items()}
        expected = {name: item.stop - item.start for name, item in self.slices.items()}
        if {name: item.size for name, item in arrays.items()} != expected:
            raise GeometryError(
                f"parameters {expected} expected, got "
                f"{ {name: p.size for name, p in arrays.items()} }"
            )
        return np.concatenate([arrays[name] for name in self.slices])

    def unpack(self, vector: Any) -> SimpleNamespace:
        """Return the parameters by name.

        Parameters
        ----------
        vector : casadi.SX, (size,), or (…, size) array
            All parameters. The last axis of an array is divided.

        Returns
        -------
        SimpleNamespace
        """
        last_axis = isinstance(vector, np.ndarray)
        return SimpleNamespace(
            **{
                name: vector[..., block] if last_axis else vector[block]
                for name, block in self.slices.items()
            }
        )
