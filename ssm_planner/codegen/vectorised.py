"""CasADi Functions over batches of samples; their scalar operations in order, to be run by NumPy or written as C.

NumPy runs them over many samples at once several times faster than CasADi's virtual machine.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import accumulate, pairwise
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.codegen.mapped import Mapped
from ssm_planner.errors import GeometryError
from ssm_planner.native import library
from ssm_planner.typing import Array


def _copy(source: Array, out: Array) -> None:
    out[...] = source


def _if_else_zero(condition: Array, value: Array, out: Array) -> None:
    out[...] = np.where(condition != 0, value, 0.0)


@dataclass(frozen=True)
class Operation:
    """What a CasADi operation computes, in NumPy and in C."""

    numpy: Callable[..., Any]
    """Of the operands and `out`, rows of one length."""
    c: str
    """An expression in the terms of `codegen.c.REAL`; {0} and {1} stand for the operands."""

    @property
    def operands(self) -> int:
        """How many it takes."""
        return 2 if "{1}" in self.c else 1


OPERATIONS = {
    "assign": Operation(_copy, "{0}"),
    "neg": Operation(np.negative, "-{0}"),
    "exp": Operation(np.exp, "SSM_F(exp)({0})"),
    "log": Operation(np.log, "SSM_F(log)({0})"),
    "sqrt": Operation(np.sqrt, "SSM_F(sqrt)({0})"),
    "sq": Operation(np.square, "{0} * {0}"),
    "twice": Operation(lambda a, out: np.add(a, a, out), "SSM_R(2.0) * {0}"),
    "inv": Operation(np.reciprocal, "SSM_R(1.0) / {0}"),
    "sin": Operation(np.sin, "SSM_F(sin)({0})"),
    "cos": Operation(np.cos, "SSM_F(cos)({0})"),
    "tan": Operation(np.tan, "SSM_F(tan)({0})"),
    "asin": Operation(np.arcsin, "SSM_F(asin)({0})"),
    "acos": Operation(np.arccos, "SSM_F(acos)({0})"),
    "atan": Operation(np.arctan, "SSM_F(atan)({0})"),
    "floor": Operation(np.floor, "SSM_F(floor)({0})"),
    "ceil": Operation(np.ceil, "SSM_F(ceil)({0})"),
    "fabs": Operation(np.abs, "SSM_F(fabs)({0})"),
    "sign": Operation(np.sign, "sign_of({0})"),
    "not": Operation(np.logical_not, "(ssm_real)({0} == SSM_R(0.0))"),
    "add": Operation(np.add, "{0} + {1}"),
    "sub": Operation(np.subtract, "{0} - {1}"),
    "mul": Operation(np.multiply, "{0} * {1}"),
    "div": Operation(np.divide, "{0} / {1}"),
    "pow": Operation(np.power, "SSM_F(pow)({0}, {1})"),
    "constpow": Operation(np.power, "SSM_F(pow)({0}, {1})"),
    "lt": Operation(np.less, "(ssm_real)({0} < {1})"),
    "le": Operation(np.less_equal, "(ssm_real)({0} <= {1})"),
    "eq": Operation(np.equal, "(ssm_real)({0} == {1})"),
    "ne": Operation(np.not_equal, "(ssm_real)({0} != {1})"),
    "and": Operation(np.logical_and, "(ssm_real)({0} != SSM_R(0.0) && {1} != SSM_R(0.0))"),
    "or": Operation(np.logical_or, "(ssm_real)({0} != SSM_R(0.0) || {1} != SSM_R(0.0))"),
    "fmin": Operation(np.fmin, "SSM_F(fmin)({0}, {1})"),
    "fmax": Operation(np.fmax, "SSM_F(fmax)({0}, {1})"),
    "if_else_zero": Operation(_if_else_zero, "({0} != SSM_R(0.0) ? {1} : SSM_R(0.0))"),
    "atan2": Operation(np.arctan2, "SSM_F(atan2)({0}, {1})"),
    "copysign": Operation(np.copysign, "SSM_F(copysign)({0}, {1})"),
    "fmod": Operation(np.fmod, "SSM_F(fmod)({0}, {1})"),
    "hypot": Operation(np.hypot, "SSM_F(hypot)({0}, {1})"),
}
"""By CasADi's name."""


@dataclass(frozen=True)
class Step:
    """One operation: `out` and `operands` are registers; an input or output is the element `index` of `argument`."""

    name: str
    out: int = -1
    operands: tuple[int, ...] = ()
    constant: float = 0.0
    argument: int = -1
    index: int = -1
    """Into the column-major dense elements of the argument or result."""


def steps(function: ca.Function) -> Iterator[Step]:
    """The operations of a Function of SX with dense inputs and outputs; NotImplementedError for others than known."""
    names = _names()
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        name = names.get(operation)
        if name is None:
            raise NotImplementedError(
                f"{function.name()}: CasADi operation {operation} is not known here"
            )
        if name == "const":
            yield Step(
                name,
                function.instruction_output(k)[0],
                constant=float(function.instruction_constant(k)),
            )
        elif name == "input":
            argument, index = function.instruction_input(k)[:2]
            yield Step(name, function.instruction_output(k)[0], argument=argument, index=index)
        elif name == "output":
            argument, index = function.instruction_output(k)[:2]
            yield Step(
                name, operands=(function.instruction_input(k)[0],), argument=argument, index=index
            )
        else:
            operands = tuple(function.instruction_input(k)[: OPERATIONS[name].operands])
            yield Step(name, function.instruction_output(k)[0], operands)


def dense(name: str, inputs: list[ca.SX], outputs: list[ca.SX]) -> ca.Function:
    """A Function whose elements are all stored, common subexpressions taken once."""
    shared = ca.cse([ca.densify(output) for output in outputs])
    return ca.Function(name, inputs, shared)


@cache
def _names() -> dict[int, str]:
    known = ("const", "input", "output", *OPERATIONS)
    return {
        getattr(ca, f"OP_{name.upper()}"): name
        for name in known
        if hasattr(ca, f"OP_{name.upper()}")
    }


MANY = 200
"""Samples from which on `call` runs a Function by `Vectorised`: the same numbers."""
BLOCK = 1024
"""Samples at a time: the registers stay in the cache."""
NATIVE = (
    *(
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
    ),
    *("lt", "le", "eq", "ne", "and", "or", "if_else_zero", "fmin", "fmax"),
)
"""Operations that native/vectorised.c does where it is compiled, in the order of its codes."""
_KEPT: list[Array] = []
"""Memory of registers, for the next call: to get it anew from the system takes as long as an eighth of the operations."""


class Vectorised:
    """A Function of dense SX as operations on whole rows of samples, by NumPy and in C: the same bits."""

    def __init__(self, function: ca.Function) -> None:
        self.name = function.name()
        self.rows_in = [function.numel_in(i) for i in range(function.n_in())]
        self.rows_out = [function.numel_out(i) for i in range(function.n_out())]
        self._registers = function.sz_w()
        named, constants = self._compile(function)
        self._constants = np.array(constants)
        self._program = [
            (OPERATIONS[name].numpy, one, other, out) for name, one, other, out in named
        ]
        codes = [
            (NATIVE.index(name) if name in NATIVE else -1, one, max(other, 0), out)
            for name, one, other, out in named
        ]
        self._codes = np.array(codes, dtype=np.dtype(ctypes.c_long)).reshape(-1, 4)
        bounds = np.flatnonzero(np.diff(self._codes[:, 0] < 0)) + 1
        self._parts = []
        """From where to where, and where the codes of operations begin that are all native, and how many these are."""
        for first, last in pairwise([0, *bounds.tolist(), len(codes)]):
            code = (
                ctypes.c_void_p(self._codes[first:].ctypes.data)
                if self._codes[first, 0] >= 0
                else None
            )
            self._parts.append((first, last, code, ctypes.c_long(last - first)))
        sizes = self._registers, len(constants), *self.rows_in, *self.rows_out
        self._table = np.repeat(np.arange(len(sizes)), sizes)
        self._row = np.concatenate([np.arange(size) for size in sizes])
        """Of every slot: registers, constants, arguments and results, which of these, and which row of it."""
        self._seen = sorted(
            {
                k
                for _, *slots in (codes[i] for i in np.flatnonzero(self._codes[:, 0] < 0))
                for k in slots
            }
        )
        """Slots of those that are not."""
        self._places = list(zip(self._table.tolist(), self._row.tolist(), strict=True))

    def __call__(self, *arguments: Array) -> list[Array]:
        """Results (n, elements) of arguments (n, elements).

        Fast where each element's n values lie together in memory (Fortran order), as they do in the results.
        """
        n = arguments[0].shape[0]
        for argument, rows in zip(arguments, self.rows_in, strict=True):
            if argument.shape != (n, rows):
                raise GeometryError(
                    f"{self.name}: argument of shape {argument.shape}, expected {(n, rows)}"
                )
        results = [np.empty((rows, n)) for rows in self.rows_out]
        size = self._registers * min(n, BLOCK)
        kept = _KEPT.pop() if _KEPT else np.empty(0)
        memory = kept if len(kept) >= size else np.empty(size)
        work = memory[:size].reshape(self._registers, min(n, BLOCK))
        self._run(work, [*(np.asarray(each, dtype=float).T for each in arguments), *results], n)
        _KEPT[:] = [memory]
        return [result.T for result in results]

    def _run(self, work: Array, given: list[Array], n: int) -> None:
        """All operations, block by block; work: the registers, given: rows (k, n) of the arguments and results."""
        tables = [work, self._constants, *given]
        starts = np.array([each.__array_interface__["data"][0] for each in tables])
        rows_apart, apart = np.array([(each.strides[0], each.strides[-1]) for each in tables]).T
        at = starts[self._table] + rows_apart[self._table] * self._row
        apart[1] = 0  # a constant is the same for all samples
        moves = apart[self._table]
        stride = moves // 8
        moves[: len(work)] = 0
        native = library.load()
        seen = range(len(at)) if native is None else self._seen
        steps = ctypes.c_void_p(stride.ctypes.data)
        with np.errstate(invalid="ignore", divide="ignore"):
            for start in range(0, n, BLOCK):
                count = min(BLOCK, n - start)
                places, samples = at + start * moves, ctypes.c_long(count)
                begin = ctypes.c_void_p(places.ctypes.data)
                rows = {k: tables[of][row] for k, (of, row) in ((k, self._places[k]) for k in seen)}
                if n > BLOCK:
                    chosen = [slice(count), (), *[slice(start, start + count)] * len(given)]
                    rows = {k: row[chosen[self._places[k][0]]] for k, row in rows.items()}
                for first, last, code, size in self._parts:
                    if native is not None and code is not None:
                        native.ssm_operations(code, begin, steps, size, samples)
                        continue
                    for operation, one, other, out in self._program[first:last]:
                        if other < 0:
                            operation(rows[one], rows[out])
                        else:
                            operation(rows[one], rows[other], rows[out])

    def _compile(
        self, function: ca.Function
    ) -> tuple[list[tuple[str, int, int, int]], list[float]]:
        """Operations on slots: registers, constants, rows of the arguments, rows of the results; and the constants."""
        sequence = list(steps(function))
        constants = [step.constant for step in sequence if step.name == "const"]
        first_in = self._registers + len(constants)
        firsts_in = first_in + np.cumsum([0, *self.rows_in])
        firsts_out = firsts_in[-1] + np.cumsum([0, *self.rows_out])
        place = list(range(self._registers))
        """Where the value of each register is to be found."""
        program: list[tuple[str, int, int, int]] = []
        used = 0
        for step in sequence:
            first, second = (*(place[k] for k in step.operands), -1, -1)[:2]
            if step.name == "const":
                place[step.out] = self._registers + used
                used += 1
            elif step.name == "input":
                place[step.out] = int(firsts_in[step.argument]) + step.index
            elif step.name == "output":
                program.append(("assign", first, -1, int(firsts_out[step.argument]) + step.index))
            else:
                program.append((step.name, first, second, step.out))
                place[step.out] = step.out
        return program, constants


def call(function: ca.Function, *arguments: Array) -> tuple[Array, ...]:
    """Evaluate a Function of column vectors over n samples.

    Each argument is (n, size of that input); each result is (n, size of that output). A bare Function takes a
    transposed batch without a word when it happens to be square, so the shapes are checked here.
    Raises GeometryError naming function, argument and both shapes.
    """
    sizes = _sizes(function)
    if len(arguments) != len(sizes):
        raise GeometryError(f"{function.name()} takes {len(sizes)} arguments, got {len(arguments)}")
    samples = np.shape(arguments[0])[0] if np.ndim(arguments[0]) == 2 else -1
    for i, (argument, size) in enumerate(zip(arguments, sizes, strict=True)):
        if np.shape(argument) != (samples, size):
            raise GeometryError(
                f"{function.name()}: argument {function.name_in(i)} has shape {np.shape(argument)}, expected (n, {size})"
                + ("" if i == 0 or samples < 0 else f" with n = {samples}")
            )
    if samples == 0:
        return tuple(np.zeros((0, function.size1_out(i))) for i in range(function.n_out()))
    vectorised = _vectorised(function) if samples >= MANY else None
    if vectorised is not None:
        return tuple(vectorised(*(np.asarray(a, dtype=float) for a in arguments)))
    first, *others = (np.asarray(argument, dtype=float) for argument in arguments)
    return tuple(Mapped(function, others, samples)(first))


@lru_cache(maxsize=256)
def _sizes(function: ca.Function) -> tuple[int, ...]:
    return tuple(function.size1_in(i) for i in range(function.n_in()))


@lru_cache(maxsize=64)
def _vectorised(function: ca.Function) -> Vectorised | None:
    """A Function for many samples; None where NumPy cannot run it."""
    if not function.is_a("SXFunction"):
        return None
    inputs = [ca.SX.sym(f"x{i}", function.size1_in(i)) for i in range(function.n_in())]
    try:
        return Vectorised(dense(function.name(), inputs, function.call(inputs)))
    except NotImplementedError:
        return None


class Layout:
    """Names and lengths of parameters that travel as one vector, in NumPy and in CasADi.

    Layout(gravity=3, scale=1) packs gravity (3,) and scale into (4,).
    """

    def __init__(self, **lengths: int) -> None:
        ends = accumulate(lengths.values(), initial=0)
        self.slices = {
            name: slice(*ends_) for name, ends_ in zip(lengths, pairwise(ends), strict=True)
        }
        self.size = sum(lengths.values())

    def pack(self, **values: Any) -> Array:
        """All parameters as one vector (size,); each value has as many numbers as its name, in any shape.

        Raises GeometryError for a missing or unknown name, or a wrong count of numbers.
        """
        parts = {name: np.ravel(value) for name, value in values.items()}
        wanted = {name: part.stop - part.start for name, part in self.slices.items()}
        if {name: part.size for name, part in parts.items()} != wanted:
            raise GeometryError(
                f"parameters {wanted} expected, got { {name: p.size for name, p in parts.items()} }"
            )
        return np.concatenate([parts[name] for name in self.slices])

    def unpack(self, vector: Any) -> SimpleNamespace:
        """The parameters by name: of a CasADi vector (size,), or of the last axis of an array (…, size)."""
        last_axis = isinstance(vector, np.ndarray)
        return SimpleNamespace(
            **{
                name: vector[..., part] if last_axis else vector[part]
                for name, part in self.slices.items()
            }
        )
