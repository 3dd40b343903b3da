"""A CasADi Function as the body of a C99 function: one statement for each operation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from ssm_planner.codegen.vectorised import steps

OPERATIONS = {
    "assign": "{0}",
    "neg": "-{0}",
    "exp": "exp({0})",
    "log": "log({0})",
    "sqrt": "sqrt({0})",
    "sq": "{0} * {0}",
    "twice": "2.0 * {0}",
    "inv": "1.0 / {0}",
    "sin": "sin({0})",
    "cos": "cos({0})",
    "tan": "tan({0})",
    "asin": "asin({0})",
    "acos": "acos({0})",
    "atan": "atan({0})",
    "floor": "floor({0})",
    "ceil": "ceil({0})",
    "fabs": "fabs({0})",
    "sign": "sign_of({0})",
    "not": "(double)({0} == 0.0)",
    "add": "{0} + {1}",
    "sub": "{0} - {1}",
    "mul": "{0} * {1}",
    "div": "{0} / {1}",
    "pow": "pow({0}, {1})",
    "constpow": "pow({0}, {1})",
    "lt": "(double)({0} < {1})",
    "le": "(double)({0} <= {1})",
    "eq": "(double)({0} == {1})",
    "ne": "(double)({0} != {1})",
    "and": "(double)({0} != 0.0 && {1} != 0.0)",
    "or": "(double)({0} != 0.0 || {1} != 0.0)",
    "fmin": "fmin({0}, {1})",
    "fmax": "fmax({0}, {1})",
    "if_else_zero": "({0} != 0.0 ? {1} : 0.0)",
    "atan2": "atan2({0}, {1})",
    "copysign": "copysign({0}, {1})",
    "fmod": "fmod({0}, {1})",
    "hypot": "hypot({0}, {1})",
}


@dataclass(frozen=True)
class Argument:
    """A C argument: an array of `size` doubles, or one double where size is 0."""

    name: str
    size: int


def write_function(
    declaration: str, function: ca.Function, inputs: Sequence[Argument], outputs: Sequence[Argument]
) -> str:
    """C text of a function; all inputs are read before any output is written where they may overlap."""
    place: dict[int, str] = {}
    used: dict[int, None] = {}
    body: list[str] = []
    results: list[tuple[str, str, int]] = []
    read: set[int] = set()
    for step in steps(function):
        operands = [place[k] for k in step.operands]
        if step.name == "const":
            place[step.out] = _literal(step.constant)
        elif step.name == "input":
            argument = inputs[step.argument]
            place[step.out] = argument.name if argument.size == 0 else f"{argument.name}[{step.index}]"
            read.add(step.argument)
        elif step.name == "output":
            results.append((f"{outputs[step.argument].name}[{step.index}]", operands[0], len(body)))
            body.append("")
        else:
            used[step.out] = None
            place[step.out] = f"w{step.out}"
            body.append(f"{place[step.out]} = {OPERATIONS[step.name].format(*operands)};")
    for k, (target, value, at) in enumerate(results):
        body[at] = f"r{k} = {value};"
        body.append(f"{target} = r{k};")
    unused = [f"(void){argument.name};" for i, argument in enumerate(inputs) if i not in read]
    names = [f"w{k}" for k in sorted(used)] + [f"r{k}" for k in range(len(results))]
    lines = [f"    double {', '.join(names[i : i + 12])};" for i in range(0, len(names), 12)]
    return "\n".join([declaration, "{", *lines, *(f"    {line}" for line in (*unused, *body)), "}", ""])


def _literal(value: float) -> str:
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "(-INFINITY)"
    text = repr(float(value))
    text = text if any(c in text for c in ".e") else text + ".0"
    return f"({text})" if value < 0 or text.startswith("-") else text
