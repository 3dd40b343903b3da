"""Evaluation of CasADi Functions for many samples, operation by operation, by NumPy or in C.

A CasADi Function of SX is a list of scalar operations. CasADi executes the whole list for one
sample after the other. `VectorisedFunction` executes one operation after the other, each for all
samples, which is several times faster for many samples. `call` chooses between both ways.

`OPERATIONS` is the only table of CasADi's operations in the package. `codegen.c` uses it too.
"""

import ctypes
from collections.abc import Callable, Iterator, Sequence
from functools import cache, lru_cache
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.codegen.mapped import MappedFunction
from ssm_planner.errors import GeometryError
from ssm_planner.native import library
from ssm_planner.typing import Array, frozen


def _if_else_zero(condition: Array, value: Array, result: Array) -> None:
    """Write a value where a condition holds, and 0 elsewhere.

    Parameters
    ----------
    condition : (n,) array
        0 where the condition does not hold.
    value : (n,) array
        Values where it holds.
    result : (n,) array
        Array that receives the result.
    """
    result[...] = np.where(condition != 0, value, 0.0)


@frozen
class Operation:
    """Implementation of one scalar operation of CasADi in NumPy and in C."""

    numpy: Callable[..., Any]
    """Function of one or two operands and of the result `out`, all of which have the shape (n,)."""
    c: str
    """C expression with the macros of `c.REAL_DEFINITIONS`, in which {0} and {1} are operands."""

    @property
    def operands(self) -> int:
        """Number of operands, 1 or 2."""
        return 2 if "{1}" in self.c else 1


OPERATIONS = {
    "assign": Operation(np.positive, "{0}"),
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
"""Supported operations by CasADi's names, which are those of its constants OP_… in lower case."""


@frozen
class Instruction:
    """One operation of a CasADi Function, which reads and writes registers.

    A register is a memory cell for one number of CasADi's virtual machine. −1 stands for an index
    that an instruction does not have.
    """

    name: str
    """Name of the operation: "const", "input", "output" or a key of `OPERATIONS`.

    "const" writes a constant to a register, "input" copies an entry of an argument to a register,
    and "output" copies a register to an entry of a result.
    """
    out: int = -1
    """Index of the register that receives the result. An output has none."""
    operands: tuple[int, ...] = ()
    """Indices of the registers of the operands."""
    constant: float = 0.0
    """Value of a constant."""
    argument: int = -1
    """Index of the argument of an input, or of the result of an output."""
    index: int = -1
    """Index of the entry of this argument or result, in column-major order."""


def instructions(function: ca.Function) -> Iterator[Instruction]:
    """Yield the operations of a Function in the order in which CasADi executes them.

    Parameters
    ----------
    function : casadi.Function
        Function of SX with dense inputs and outputs.

    Yields
    ------
    Instruction
        One operation.

    Raises
    ------
    NotImplementedError
        If the Function contains an operation that is not in `OPERATIONS`.
    """
    names = _operation_names()
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        name = names.get(operation)
        if name is None:
            raise NotImplementedError(
                f"{function.name()}: CasADi operation {operation} is not supported"
            )
        sources = function.instruction_input(k)
        targets = function.instruction_output(k)
        if name == "const":
            yield Instruction(name, targets[0], constant=float(function.instruction_constant(k)))
        elif name == "input":
            argument, index = sources[:2]
            yield Instruction(name, targets[0], argument=argument, index=index)
        elif name == "output":
            argument, index = targets[:2]
            yield Instruction(name, operands=(sources[0],), argument=argument, index=index)
        else:
            operands = tuple(sources[: OPERATIONS[name].operands])
            yield Instruction(name, targets[0], operands)


def dense_function(name: str, inputs: list[ca.SX], outputs: list[ca.SX]) -> ca.Function:
    """Build a CasADi Function whose outputs are dense and which computes no subexpression twice.

    Parameters
    ----------
    name : str
        Name of the Function.
    inputs : list of casadi.SX
        Symbols of the inputs.
    outputs : list of casadi.SX
        Expressions of the outputs.

    Returns
    -------
    casadi.Function
        The Function.
    """
    shared = ca.cse([ca.densify(output) for output in outputs])
    return ca.Function(name, inputs, shared)


@cache
def _operation_names() -> dict[int, str]:
    """Return CasADi's names of the operations by its numbers OP_…."""
    names = {}
    for name in ["const", "input", "output"] + list(OPERATIONS):
        number = getattr(ca, f"OP_{name.upper()}", None)
        if number is not None:
            names[number] = name
    return names


MIN_VECTORISED_SAMPLES = 200
"""Smallest number of samples for which `call` uses `VectorisedFunction`.

For fewer samples, CasADi's virtual machine is faster.
"""
SAMPLES_PER_BLOCK = 1024
"""Number of samples for which the list of operations is executed at once.

The registers of so many samples stay in the processor's cache.
"""
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
"""Operations that native/vectorised.c implements, in the order of their codes 0, 1, 2, …

IEEE 754 prescribes their results, so that C and NumPy give the same bits.
"""
_REGISTER_MEMORY: list[Array] = []
"""Memory of the registers, kept from one call to the next. The list has at most one array.

A new allocation in each call would take an eighth of the time of the operations.
"""


class VectorisedFunction:
    """CasADi Function of SX that executes one operation after the other, each for all samples.

    The C code executes the operations in `NATIVE_OPERATIONS`, and NumPy the others. Without the
    compiled part NumPy executes all of them, with identical results.

    The operations address their operands by *slots*. A slot is a register, a constant, or an entry
    of an argument or result, in this order. The object stores in which table each slot lies (0: the
    registers, 1: the constants, then the arguments and the results) and in which row of this table.
    """

    def __init__(self, function: ca.Function) -> None:
        """Translate a CasADi Function to lists of operations.

        Parameters
        ----------
        function : casadi.Function
            Function of SX with dense inputs and outputs, for example from `dense_function`.

        Raises
        ------
        NotImplementedError
            If the Function contains an operation that is not in `OPERATIONS`.
        """
        self.name = function.name()
        self.rows_in = [function.numel_in(i) for i in range(function.n_in())]
        self.rows_out = [function.numel_out(i) for i in range(function.n_out())]
        self._registers = function.sz_w()
        operations, constants = self._compile(function)
        self._constants = np.array(constants)
        self._program = []
        codes = []
        for name, operand, other_operand, result in operations:
            self._program.append((OPERATIONS[name].numpy, operand, other_operand, result))
            code = NATIVE_OPERATIONS.index(name) if name in NATIVE_OPERATIONS else -1
            codes.append((code, operand, max(other_operand, 0), result))
        self._codes = np.array(codes, dtype=ctypes.c_long).reshape(-1, 4)
        bounds = np.flatnonzero(np.diff(self._codes[:, 0] < 0)) + 1
        self._parts = []
        """Parts of the program of which either C or NumPy executes all operations.

        A part is a tuple of the indices of its first operation and of the operation after its last
        one, the address of its codes (None if NumPy executes it), and its number of operations.
        """
        for start, end in pairwise([0] + bounds.tolist() + [len(codes)]):
            address = None
            if self._codes[start, 0] >= 0:
                address = ctypes.c_void_p(self._codes[start:].ctypes.data)
            self._parts.append((start, end, address, ctypes.c_long(end - start)))
        sizes = [self._registers, len(constants)] + self.rows_in + self.rows_out
        self._table = np.repeat(np.arange(len(sizes)), sizes)
        self._row = np.concatenate([np.arange(size) for size in sizes])
        """Index of the table, and index of the row in this table, of every slot."""
        numpy_codes = self._codes[self._codes[:, 0] < 0]
        self._numpy_slots = np.unique(numpy_codes[:, 1:]).tolist()
        """Slots that the operations of NumPy read or write."""
        self._slot_positions = list(zip(self._table.tolist(), self._row.tolist(), strict=True))

    def __call__(self, *arguments: Array) -> list[Array]:
        """Evaluate the Function for n samples.

        Arguments in Fortran order, in which the n values of an entry are adjacent, are fastest. The
        results have this order too.

        Parameters
        ----------
        *arguments : (n, size) arrays
            One array for each input, with one row for each sample. A row contains the entries of
            the input in column-major order.

        Returns
        -------
        list of (n, size) arrays
            One array for each output, in the same form.

        Raises
        ------
        GeometryError
            If an argument has another shape.
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
        inputs = [np.asarray(values, dtype=float).T for values in arguments]
        self._run(work, inputs + results, n)
        _REGISTER_MEMORY[:] = [memory]
        return [result.T for result in results]

    def _run(self, work: Array, data: list[Array], n: int) -> None:
        """Execute all operations for n samples, block by block.

        Parameters
        ----------
        work : (registers, samples of a block) array
            Memory of the registers.
        data : list of (k, n) arrays
            Arguments, then results. The operations write to the latter.
        n : int
            Number of samples.
        """
        tables = [work, self._constants] + data
        starts = np.array([table.__array_interface__["data"][0] for table in tables])
        # Bytes from one row of a table to the next, and from one sample to the next.
        row_bytes = np.array([table.strides[0] for table in tables])
        stride_bytes = np.array([table.strides[-1] for table in tables])
        addresses = starts[self._table] + row_bytes[self._table] * self._row
        stride_bytes[1] = 0  # Constants do not depend on the sample.
        # Bytes, and numbers, from one sample to the next in each slot.
        moves = stride_bytes[self._table]
        stride = moves // 8  # A double has 8 bytes.
        moves[: len(work)] = 0  # Every block of samples uses the same registers.
        native = library.load()
        indices = range(len(addresses)) if native is None else self._numpy_slots
        sample_strides = ctypes.c_void_p(stride.ctypes.data)
        with np.errstate(invalid="ignore", divide="ignore"):
            for start in range(0, n, SAMPLES_PER_BLOCK):
                count = min(SAMPLES_PER_BLOCK, n - start)
                pointers = addresses + start * moves
                samples = ctypes.c_long(count)
                slots = ctypes.c_void_p(pointers.ctypes.data)
                # Samples of the block in each table.
                selections: list[Any] = [slice(count), ()]
                selections += [slice(start, start + count)] * len(data)
                # Memory of the slots that NumPy reads and writes.
                rows = {}
                for k in indices:
                    index, row = self._slot_positions[k]
                    rows[k] = tables[index][row][selections[index]]
                for low, high, address, size in self._parts:
                    if native is not None and address is not None:
                        native.ssm_operations(address, slots, sample_strides, size, samples)
                        continue
                    for operation, *operands in self._program[low:high]:
                        operation(*[rows[k] for k in operands if k >= 0])

    def _compile(
        self, function: ca.Function
    ) -> tuple[list[tuple[str, int, int, int]], list[float]]:
        """Translate a Function to a list of operations on slots.

        Reading an input or a constant needs no operation, because its slot can be an operand.

        Parameters
        ----------
        function : casadi.Function
            Function of SX with dense inputs and outputs.

        Returns
        -------
        operations : list of tuple
            Name, slot of the first operand, slot of the second operand or −1, and slot of the
            result.
        constants : list of float
            Values of the slots that are constants.
        """
        sequence = list(instructions(function))
        constants = [
            instruction.constant for instruction in sequence if instruction.name == "const"
        ]
        # First slot of each argument and of each result. The last entry of either is the end.
        first_slot = self._registers + len(constants)
        first_input_slots = first_slot + np.cumsum([0] + self.rows_in)
        first_output_slots = first_input_slots[-1] + np.cumsum([0] + self.rows_out)
        slot = list(range(self._registers))
        """Slot that contains the present value of each register."""
        program: list[tuple[str, int, int, int]] = []
        constant_count = 0
        for instruction in sequence:
            # An operation has at most two operands. −1 stands for a missing one.
            operands = [slot[k] for k in instruction.operands]
            operand, other_operand = (operands + [-1, -1])[:2]
            if instruction.name == "const":
                slot[instruction.out] = self._registers + constant_count
                constant_count += 1
            elif instruction.name == "input":
                first_input_slot = int(first_input_slots[instruction.argument])
                slot[instruction.out] = first_input_slot + instruction.index
            elif instruction.name == "output":
                result = int(first_output_slots[instruction.argument]) + instruction.index
                program.append(("assign", operand, -1, result))
            else:
                program.append((instruction.name, operand, other_operand, instruction.out))
                slot[instruction.out] = instruction.out
        return program, constants


def call(function: ca.Function, *arguments: Array) -> tuple[Array, ...]:
    """Evaluate a Function of column vectors for n samples.

    CasADi evaluates one column for each sample, and silently accepts a transposed array if it is
    square. This function takes one row for each sample, as everywhere in the package, and checks
    the shapes.

    Parameters
    ----------
    function : casadi.Function
        Function to evaluate.
    *arguments : (n, size) arrays
        One array for each input of the function, whose length is `size`.

    Returns
    -------
    tuple of (n, size) arrays
        One array for each output.

    Raises
    ------
    GeometryError
        If an argument has another shape. The message names the Function, the argument and
        both shapes.
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
    """Return the number of samples in the arguments of a Function.

    Parameters
    ----------
    function : casadi.Function
        Function of column vectors.
    arguments : sequence of (n, size) arrays
        One array for each input of the Function.

    Returns
    -------
    int
        Number n of samples.

    Raises
    ------
    GeometryError
        If the number of arguments or one of their shapes does not suit the Function.
    """
    sizes = _input_sizes(function)
    if len(arguments) != len(sizes):
        raise GeometryError(f"{function.name()} takes {len(sizes)} arguments, got {len(arguments)}")
    samples = len(arguments[0]) if np.ndim(arguments[0]) == 2 else -1
    for i, (argument, size) in enumerate(zip(arguments, sizes, strict=True)):
        if np.shape(argument) != (samples, size):
            count = "" if i == 0 or samples < 0 else f" with n = {samples}"
            raise GeometryError(
                f"{function.name()}: argument {function.name_in(i)} has shape "
                f"{np.shape(argument)}, expected (n, {size}){count}"
            )
    return samples


@lru_cache(maxsize=256)
def _input_sizes(function: ca.Function) -> tuple[int, ...]:
    """Return the number of rows of each input of a Function.

    Parameters
    ----------
    function : casadi.Function
        Function of column vectors.

    Returns
    -------
    tuple of int
        One number for each input.
    """
    return tuple(function.size1_in(i) for i in range(function.n_in()))


@lru_cache(maxsize=64)
def _vectorised_function(function: ca.Function) -> VectorisedFunction | None:
    """Build the vectorised form of a Function.

    Parameters
    ----------
    function : casadi.Function
        Function of column vectors.

    Returns
    -------
    VectorisedFunction or None
        The vectorised form. None if the Function contains an operation that is not in `OPERATIONS`,
        or if it is not a Function of SX.
    """
    if not function.is_a("SXFunction"):
        return None
    inputs = [ca.SX.sym(f"x{i}", function.size1_in(i)) for i in range(function.n_in())]
    try:
        return VectorisedFunction(dense_function(function.name(), inputs, function.call(inputs)))
    except NotImplementedError:
        return None


class Layout:
    """Names and lengths of parameters that form one vector.

    A program of CasADi or C takes its parameters as one vector. `pack` builds the vector from named
    values, and `unpack` returns the names, for numbers as well as for CasADi symbols. For example,
    Layout(gravity=3, scale=1) packs gravity (3,) and scale into a vector (4,).

    Attributes
    ----------
    slices : dict of slice
        Position of each parameter in the vector.
    size : int
        Length of the vector.
    """

    def __init__(self, **lengths: int) -> None:
        """Place the parameters one after the other in the order of the arguments.

        Parameters
        ----------
        **lengths : int
            Number of entries of each parameter.
        """
        self.slices = {}
        self.size = 0
        for name, length in lengths.items():
            self.slices[name] = slice(self.size, self.size + length)
            self.size += length

    def pack(self, **values: Any) -> Array:
        """Combine all parameters in one vector.

        Parameters
        ----------
        **values : array-like
            Value of each parameter, in any shape with the right number of entries.

        Returns
        -------
        (size,) array
            The vector.

        Raises
        ------
        GeometryError
            If a name is missing or unknown, or if a value has another number of entries.
        """
        arrays = {name: np.ravel(value) for name, value in values.items()}
        lengths = {name: array.size for name, array in arrays.items()}
        expected = {name: block.stop - block.start for name, block in self.slices.items()}
        if lengths != expected:
            raise GeometryError(f"parameters {expected} expected, got {lengths}")
        return np.concatenate([arrays[name] for name in self.slices])

    def unpack(self, vector: Any) -> SimpleNamespace:
        """Divide a vector into its parameters.

        Parameters
        ----------
        vector : (size,) casadi.SX or MX, or (…, size) array
            All parameters, for an array along its last axis.

        Returns
        -------
        SimpleNamespace
            Each parameter as an attribute, (length,) or (…, length).
        """
        parameters = SimpleNamespace()
        for name, block in self.slices.items():
            value = vector[..., block] if isinstance(vector, np.ndarray) else vector[block]
            setattr(parameters, name, value)
        return parameters
