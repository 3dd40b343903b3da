"""A CasADi Function as the body of a C99 function, in double or single precision: one statement for each operation."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from ssm_planner.codegen.vectorised import OPERATIONS, steps

REAL = """\
#ifdef SSM_FLOAT32
typedef float ssm_real;
#define SSM_R(x) x##f
#define SSM_F(function) function##f
#else
typedef double ssm_real;
#define SSM_R(x) x
#define SSM_F(function) function
#endif
"""
"""The one type of all numbers, a constant of it, and a function of math.h for it."""
PLAIN = {name: operation.c for name, operation in OPERATIONS.items()}
"""Expressions of operations."""
SIGN = "static ssm_real sign_of(ssm_real x) { return (ssm_real)((x > SSM_R(0.0)) - (x < SSM_R(0.0))); }\n"


@dataclass(frozen=True)
class Argument:
    """A C argument: an array of `size` numbers, or one number where size is 0."""

    name: str
    size: int
    places: Sequence[int] | None = None
    """Of an output: where its numbers go in the array; None: one after the other."""
    adds: bool = False
    """An output is added to what is there."""

    def at(self, index: int) -> str:
        """A number of it."""
        return (
            self.name
            if self.size == 0
            else f"{self.name}[{index if self.places is None else self.places[index]}]"
        )


def write_function(
    declaration: str,
    function: ca.Function,
    inputs: Sequence[Argument],
    outputs: Sequence[Argument],
    expressions: Mapping[str, str] = PLAIN,
) -> str:
    """C text of a function; it needs REAL and SIGN.

    All inputs are read before any output is written, for they may overlap. expressions: in place of those of OPERATIONS.
    """
    place: dict[int, str] = {}
    used: dict[int, None] = {}
    body: list[str] = []
    results: list[tuple[str, str, int]] = []
    read: set[int] = set()
    for step in steps(function):
        operands = [place[k] for k in step.operands]
        if step.name == "const":
            place[step.out] = literal(step.constant)
        elif step.name == "input":
            place[step.out] = inputs[step.argument].at(step.index)
            read.add(step.argument)
        elif step.name == "output":
            output = outputs[step.argument]
            results.append(
                (f"{output.at(step.index)} {'+=' if output.adds else '='}", operands[0], len(body))
            )
            body.append("")
        else:
            used[step.out] = None
            place[step.out] = f"w{step.out}"
            body.append(f"{place[step.out]} = {expressions[step.name].format(*operands)};")
    for k, (target, value, at) in enumerate(results):
        body[at] = f"r{k} = {value};"
        body.append(f"{target} r{k};")
    unused = [f"(void){argument.name};" for i, argument in enumerate(inputs) if i not in read]
    names = [f"w{k}" for k in sorted(used)] + [f"r{k}" for k in range(len(results))]
    lines = [f"    ssm_real {', '.join(names[i : i + 12])};" for i in range(0, len(names), 12)]
    return "\n".join(
        [declaration, "{", *lines, *(f"    {line}" for line in (*unused, *body)), "}", ""]
    )


def literal(value: float) -> str:
    """A constant of type `ssm_real`."""
    if not math.isfinite(value):
        return "NAN" if math.isnan(value) else "INFINITY" if value > 0 else "(-INFINITY)"
    text = repr(abs(float(value)))
    text = f"SSM_R({text if any(c in text for c in '.e') else text + '.0'})"
    return f"(-{text})" if math.copysign(1.0, value) < 0 else text
