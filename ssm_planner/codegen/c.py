"""Translate a CasADi Function to a C99 function, with one statement for each operation."""

import math
from collections.abc import Mapping, Sequence

import casadi as ca

from ssm_planner.codegen.vectorised import OPERATIONS, instructions
from ssm_planner.typing import frozen

REAL_DEFINITIONS = """\
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
"""Definitions of the type of all numbers and of macros for its constants and functions."""
SCALAR_EXPRESSIONS = {name: operation.c for name, operation in OPERATIONS.items()}
"""C expressions by operation."""
SIGN_FUNCTION = (
    "static ssm_real sign_of(ssm_real x) { return (ssm_real)((x > SSM_R(0.0)) - (x < "
    "SSM_R(0.0))); }\n"
)
"""Definition of the sign function."""


@frozen
class Argument:
    """Argument of a C function.

    Attributes
    ----------
    name : str
        Its name.
    size : int
        Number of values in the array. 0 means a single number that is not an array.
    """

    name: str
    size: int
    places: Sequence[int] | None = None
    """Positions in the array of the values of an output. None means consecutive ones."""
    adds: bool = False
    """True if the output is added to the content of the array."""

    def element(self, index: int) -> str:
        """Return the C expression of the value with an index."""
        if self.size == 0:
            return self.name
        return f"{self.name}[{index if self.places is None else self.places[index]}]"


def write_function(
    declaration: str,
    function: ca.Function,
    inputs: Sequence[Argument],
    outputs: Sequence[Argument],
    expressions: Mapping[str, str] = SCALAR_EXPRESSIONS,
) -> str:
    """Return the text of a C function.

    The text requires `REAL_DEFINITIONS` and `SIGN_FUNCTION` before it. The C function reads all
    inputs before it writes outputs, so inputs and outputs may overlap.

    Parameters
    ----------
    declaration : str
        Head of the C function.
    function : casadi.Function
        Function of SX with dense inputs and outputs.
    inputs, outputs : sequence of Argument
        C arguments, one for each input and output of the function.
    expressions : mapping of str to str
        C expressions by operation. The default is those of `OPERATIONS`.

    Returns
    -------
    str
        Text of the C function.
    """
    value_of: dict[int, str] = {}
    registers: set[int] = set()
    body: list[str] = []
    writes: list[str] = []
    inputs_read: set[int] = set()
    for step in instructions(function):
        operands = [value_of[k] for k in step.operands]
        if step.name == "const":
            value_of[step.out] = c_literal(step.constant)
        elif step.name == "input":
            value_of[step.out] = inputs[step.argument].element(step.index)
            inputs_read.add(step.argument)
        elif step.name == "output":
            output = outputs[step.argument]
            result = f"r{len(writes)}"
            body.append(f"{result} = {operands[0]};")
            assignment = "+=" if output.adds else "="
            writes.append(f"{output.element(step.index)} {assignment} {result};")
        else:
            registers.add(step.out)
            value_of[step.out] = f"w{step.out}"
            body.append(f"{value_of[step.out]} = {expressions[step.name].format(*operands)};")
    unused = [f"(void){inputs[i].name};" for i in sorted({*range(len(inputs))} - inputs_read)]
    names = [f"w{k}" for k in sorted(registers)] + [f"r{k}" for k in range(len(writes))]
    lines = [f"ssm_real {', '.join(names[i : i + 12])};" for i in range(0, len(names), 12)]
    lines += [*unused, *body, *writes]
    return "\n".join([declaration, "{", *(f"    {line}" for line in lines), "}", ""])


def c_literal(value: float) -> str:
    """Return a number as a C constant of the type `ssm_real`, with all digits."""
    if not math.isfinite(value):
        return "NAN" if math.isnan(value) else "INFINITY" if value > 0 else "(-INFINITY)"
    text = repr(abs(float(value)))
    text = f"SSM_R({text if any(c in text for c in '.e') else text + '.0'})"
    return f"(-{text})" if math.copysign(1.0, value) < 0 else text
