"""The scalar operations that a CasADi Function consists of, in order: to be run by NumPy, or written as C."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import casadi as ca

UNARY = (
    *("neg", "exp", "log", "sqrt", "sq", "twice", "inv", "sin", "cos", "tan", "asin", "acos", "atan"),
    *("floor", "ceil", "fabs", "sign", "not"),
)
BINARY = (
    *("add", "sub", "mul", "div", "pow", "constpow", "lt", "le", "eq", "ne", "and", "or"),
    *("fmin", "fmax", "if_else_zero", "atan2", "copysign", "fmod", "hypot"),
)


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
            raise NotImplementedError(f"{function.name()}: CasADi operation {operation} is not known here")
        if name == "const":
            yield Step(name, function.instruction_output(k)[0], constant=float(function.instruction_constant(k)))
        elif name == "input":
            argument, index = function.instruction_input(k)[:2]
            yield Step(name, function.instruction_output(k)[0], argument=argument, index=index)
        elif name == "output":
            argument, index = function.instruction_output(k)[:2]
            yield Step(name, operands=(function.instruction_input(k)[0],), argument=argument, index=index)
        else:
            count = 2 if name in BINARY else 1
            operands = tuple(function.instruction_input(k)[:count])
            yield Step(name, function.instruction_output(k)[0], operands)


def dense(name: str, inputs: list[ca.SX], outputs: list[ca.SX]) -> ca.Function:
    """A Function whose elements are all stored, common subexpressions taken once."""
    shared = ca.cse([ca.densify(output) for output in outputs])
    return ca.Function(name, inputs, shared)


@cache
def _names() -> dict[int, str]:
    known = ("const", "input", "output", "assign", *UNARY, *BINARY)
    return {getattr(ca, f"OP_{name.upper()}"): name for name in known if hasattr(ca, f"OP_{name.upper()}")}
