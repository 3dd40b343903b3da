"""A CasADi Function as the body of a C99 function: one statement for each operation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from ssm_planner.codegen.vectorised import OPERATIONS, steps


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
            body.append(f"{place[step.out]} = {OPERATIONS[step.name].c.format(*operands)};")
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
