"""Translate a CasADi Function to a C99 function, with one statement for each operation.

`write_function` is the main entry. The export formats use it for code that runs on a controller,
and `elements.kernels` for the compiled part of the package. The operations and their C expressions
are those of `vectorised.OPERATIONS`, so a Function has the same meaning in NumPy and in C.
"""

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
"""C definitions that every generated file needs.

They define the number type `ssm_real` (double, or float if SSM_FLOAT32 is defined), the macro SSM_R
for constants of this type, and the macro SSM_F for the names of mathematical functions.
"""
SCALAR_EXPRESSIONS = {name: operation.c for name, operation in OPERATIONS.items()}
"""C expressions of the operations on single numbers, by CasADi's names of the operations."""
SIGN_FUNCTION = (
    "static ssm_real sign_of(ssm_real x) { return (ssm_real)((x > SSM_R(0.0)) - (x < "
    "SSM_R(0.0))); }\n"
)
"""C definition of the sign function, which the C library lacks. It requires `REAL_DEFINITIONS`."""


@frozen
class Argument:
    """Argument of a generated C function: an array of `ssm_real`, or a single number."""

    name: str
    """Name of the argument in C."""
    size: int
    """Number of values in the array. 0 means that the argument is a single number."""
    positions: Sequence[int] | None = None
    """Position of each value of an output in the array. None: the values are consecutive."""
    adds: bool = False
    """True if the function adds an output to the content of the array. False if it overwrites."""

    def element(self, index: int) -> str:
        """Return the C expression of one value, for example `q[2]`.

        Parameters
        ----------
        index : int
            Number of the value among those of the input or output, from 0.

        Returns
        -------
        str
            C expression.
        """
        if self.size == 0:
            return self.name
        position = index if self.positions is None else self.positions[index]
        return f"{self.name}[{position}]"


def write_function(
    declaration: str,
    function: ca.Function,
    inputs: Sequence[Argument],
    outputs: Sequence[Argument],
    expressions: Mapping[str, str] = SCALAR_EXPRESSIONS,
) -> str:
    """Return the definition of a C function that computes a CasADi Function.

    A generated file must contain `REAL_DEFINITIONS` and `SIGN_FUNCTION` before this text. The C
    function reads all inputs before it writes outputs, so the memory of inputs and outputs may
    overlap. Its local variables are w0, w1, … for intermediate values and r0, r1, … for results.

    Parameters
    ----------
    declaration : str
        Head of the C function, for example "static void f(const ssm_real *q, ssm_real *g)".
    function : casadi.Function
        Function of SX with dense inputs and outputs.
    inputs, outputs : sequence of Argument
        C arguments, one for each input and output of the CasADi Function, in the same order.
    expressions : mapping of str to str
        C expressions by CasADi's names of the operations, with {0} and {1} for the operands.

    Returns
    -------
    str
        Declaration and body of the C function.

    Raises
    ------
    NotImplementedError
        If the Function contains an operation that `vectorised.OPERATIONS` lacks.
    """
    # C expression of the value in each register of CasADi's virtual machine.
    register_text: dict[int, str] = {}
    registers: set[int] = set()
    body: list[str] = []
    writes: list[str] = []
    inputs_read: set[int] = set()
    for instruction in instructions(function):
        operands = [register_text[k] for k in instruction.operands]
        if instruction.name == "const":
            register_text[instruction.out] = c_literal(instruction.constant)
        elif instruction.name == "input":
            register_text[instruction.out] = inputs[instruction.argument].element(instruction.index)
            inputs_read.add(instruction.argument)
        elif instruction.name == "output":
            output = outputs[instruction.argument]
            result = f"r{len(writes)}"
            body.append(f"{result} = {operands[0]};")
            assignment = "+=" if output.adds else "="
            writes.append(f"{output.element(instruction.index)} {assignment} {result};")
        else:
            registers.add(instruction.out)
            register_text[instruction.out] = f"w{instruction.out}"
            expression = expressions[instruction.name].format(*operands)
            body.append(f"{register_text[instruction.out]} = {expression};")
    # Compilers warn of unused arguments unless the body names them.
    unused = [f"(void){item.name};" for i, item in enumerate(inputs) if i not in inputs_read]
    names = [f"w{k}" for k in sorted(registers)] + [f"r{k}" for k in range(len(writes))]
    # A declaration contains at most 12 variables.
    lines = [f"ssm_real {', '.join(names[i : i + 12])};" for i in range(0, len(names), 12)]
    indented = "".join(f"    {line}\n" for line in lines + unused + body + writes)
    return f"{declaration}\n{{\n{indented}}}\n"


def c_literal(value: float) -> str:
    """Convert a number to a C constant of the type `ssm_real`.

    Parameters
    ----------
    value : float
        The number.

    Returns
    -------
    str
        Constant with as many digits as the shortest text that gives the same double. Negative
        numbers are enclosed in parentheses. Infinity and NaN become the macros of <math.h>.
    """
    if math.isnan(value):
        return "NAN"
    # The text of a finite float contains a point or an exponent.
    text = f"SSM_R({abs(float(value))!r})"
    if math.isinf(value):
        text = "INFINITY"
    return f"(-{text})" if math.copysign(1.0, value) < 0 else text
