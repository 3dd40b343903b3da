"""Generator of native/kernels.h, which contains the physical laws of an element as C code.

The generator writes each law from the same CasADi expressions that the element models use, so that
C and CasADi agree. A part of the model, for example the torque of a drive, computes a few
values from a few variables v. It consists of up to three C functions:

    NAME_at     the values
    NAME_by     the values, and their Jacobian row by row
    NAME_bend   adds the upper triangle of the Hessian of Σ λ_i value_i, with multipliers λ

native/elements.c combines the parts by the chain rule. Run `python -m ssm_planner.elements.kernels`
after a change of a physical law. A test compares the file with the result of `kernels_text`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain, product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from ssm_planner.codegen import SCALAR_EXPRESSIONS, Argument, casadi_namespace, write_function
from ssm_planner.dynamics import LOAD_LAYOUT, efforts_from_parameters
from ssm_planner.elements.compiled import DRIVE_LAYOUT, EYE_LAYOUT, MECHANISM_LAYOUT, TORQUE_LAWS
from ssm_planner.elements.free_element import FreeElement, clearance_rows, range_rows, rate_rows
from ssm_planner.elements.rows import (
    Instant,
    acceleration_rows,
    directed_torques,
    smooth_torque,
    torque_row_values,
    velocity_and_stop_rows,
)
from ssm_planner.elements.straight_element import (
    FIT_DEGREE,
    StraightElement,
    curves_layout,
    fit_layout,
)
from ssm_planner.kinematics import SPEED_JACOBIANS, lens_constraint, tip_position_symbolic
from ssm_planner.problem import FRICTION_LAWS
from ssm_planner.trajectory import CubicPiece

KERNELS_HEADER = Path(__file__).parents[1] / "native" / "kernels.h"
"""Path of the generated file."""
VECTOR_EXPRESSIONS = SCALAR_EXPRESSIONS | {
    "not": "SSM_F(is)({0} == SSM_R(0.0))",
    "lt": "SSM_F(is)({0} < {1})",
    "le": "SSM_F(is)({0} <= {1})",
    "eq": "SSM_F(is)({0} == {1})",
    "ne": "SSM_F(is)({0} != {1})",
    "and": "({0} * {1})",
    "or": "SSM_F(is)(({0} != SSM_R(0.0)) | ({1} != SSM_R(0.0)))",
    "if_else_zero": "SSM_F(where)({0} != SSM_R(0.0), {1})",
}
"""C expressions of the operations on vectors, which contain one number for each of 4 elements.

A condition has the value 0 or 1 in each entry.
"""
# The first entry replaces powers of e, which the exponential laws of friction contain.
ABBREVIATIONS = {
    "SSM_F(pow)(SSM_R(2.718281828459045), ": "V(exp)(",
    "SSM_F(": "V(",
    "SSM_R(": "R(",
    "ssm_real": "real",
}
"""Text in the generated functions, and the shorter text that replaces it.

The C sources define the shorter names as macros.
"""
MAX_LINE_LENGTH = 120
"""Largest number of characters in a generated line."""
Symbols = dict[str, ca.SX]
"""Inputs or outputs of a C function by name."""


@dataclass
class _KernelWriter:
    """Collector of generated C functions."""

    texts: list[str] = field(default_factory=list)
    """Definitions of the C functions so far."""

    def add_part(
        self,
        name: str,
        constants: Symbols,
        v: tuple[str, ca.SX],
        values: Sequence[Any],
        kinds: str = "at by bend",
    ) -> None:
        """Add the C functions of one part of the model.

        Their names are NAME_at, NAME_by and NAME_bend.

        Parameters
        ----------
        name : str
            Common beginning of the names, NAME.
        constants : dict of casadi.SX
            Inputs that are not differentiated, by name.
        v : (str, casadi.SX)
            Name and symbols of the variables of the derivatives.
        values : sequence of casadi.SX
            Expressions of the values.
        kinds : str
            Endings of those of the three functions that native/elements.c needs.
        """
        variable_name, symbols = v
        inputs = {**constants, variable_name: symbols}
        g = ca.cse(ca.vertcat(*values))
        lam = ca.SX.sym("lam", g.numel())
        if "at" in kinds:
            self.function(f"{name}_at", inputs, {"g": g})
        self.function(f"{name}_by", inputs, {"g": g, "by": ca.jacobian(g, symbols)})
        if "bend" in kinds:
            bend = ca.triu(ca.hessian(ca.dot(lam, g), symbols)[0])
            self.function(f"{name}_bend", {**inputs, "lam": lam}, {"bend": bend}, adds=True)

    def function(self, name: str, inputs: Symbols, outputs: Symbols, *, adds: bool = False) -> None:
        """Add one C function.

        Its outputs are dense arrays, row by row.

        The function only writes entries that are not structurally zero.

        Parameters
        ----------
        name : str
            Name of the C function.
        inputs, outputs : dict of casadi.SX
            Symbols of the inputs and expressions of the outputs, by name.
        adds : bool
            True if the function adds its results to the content of the outputs.
        """
        results = []
        arguments = []
        for key, value in outputs.items():
            rows, columns = value.sparsity().get_triplet()
            indices = [r * value.size2() + c for r, c in zip(rows, columns, strict=True)]
            results.append(ca.SX(value.nz[:]) if indices else ca.SX(0, 1))
            arguments.append(Argument(key, len(indices), indices, adds))
        function = ca.Function(name, list(inputs.values()), ca.cse(results))
        declarations = [f"const ssm_real *{key}" for key in inputs]
        declarations += [f"ssm_real *restrict {key}" for key in outputs]
        text = write_function(
            f"static void {name}({', '.join(declarations)})",
            function,
            [Argument(key, value.numel()) for key, value in inputs.items()],
            arguments,
            VECTOR_EXPRESSIONS,
        )
        # Compilers warn of an output without nonzeros, which only a linear part has (`bend`).
        if not all(argument.size for argument in arguments):
            text = text.replace("{\n", "{\n    (void)bend;\n", 1)
        for long, short in ABBREVIATIONS.items():
            text = text.replace(long, short)
        self.texts.append(_pack_statements(text))


def _pack_statements(text: str) -> str:
    """Put as many statements of a C function on each line as fit.

    A line has at most `MAX_LINE_LENGTH` characters.

    Parameters
    ----------
    text : str
        Definition of the function with one statement on each line.

    Returns
    -------
    str
        The same definition with fewer lines.
    """
    statements = text.split("\n")
    # The first two lines are the declaration and the opening brace, and the last two are the
    # closing brace and an empty line.
    lines = statements[:2]
    line = ""
    for statement in map(str.strip, statements[2:-2]):
        if len(line) + len(statement) >= MAX_LINE_LENGTH:
            lines.append(line)
            line = ""
        line += f" {statement}"
    return "\n".join(lines + [line] + statements[-2:])


def kernels_text() -> str:
    """Generate the text of the C header with the physical laws.

    The header is native/kernels.h.

    It consists of the sizes of all arrays and the positions of their entries as macros, and of the
    C functions of all parts of an element.
    """
    writer = _KernelWriter()
    sizes = {
        "LOAD": LOAD_LAYOUT.size,
        "MECHANISM": MECHANISM_LAYOUT.size,
        "EYE": EYE_LAYOUT.size,
        "DRIVE": DRIVE_LAYOUT.size,
        "DEGREE": FIT_DEGREE,
    }
    for prefix, layout in (("FREE", FreeElement.layout), ("STRAIGHT", StraightElement.layout)):
        sizes |= {
            f"{prefix}_{name.upper()}": field_slice.start
            for name, field_slice in layout.slices.items()
        }
        sizes[f"{prefix}_SIZE"] = layout.size
    sizes["PREPARED"] = _write_posture_rows(writer)
    load = _symbols("load", LOAD_LAYOUT.size)
    y = _symbols("y", 12)
    writer.add_part(
        "torques", {"load": load}, ("y", y), [efforts_from_parameters(load, *_split_state(y))]
    )
    _write_drive_torques(writer)
    _write_path_motion(writer)
    _write_joint_limits(writer)
    _write_states(writer)
    defines = "".join(f"#define SSM_{name} {value}\n" for name, value in sizes.items())
    version = f"CasADi {ca.CasadiMeta.version()}"
    intro = f"/* Written by ssm_planner.elements.kernels with {version}: do not edit. */\n\n"
    return intro + defines + "\n" + "\n".join(writer.texts)


def _write_posture_rows(writer: _KernelWriter) -> int:
    """Add the rows of a free motion that depend on the positions and velocities of the joints.

    Subexpressions that depend only on the robot, the eye and the limits do not change during a
    solve. The C function `prepare` computes them once.

    Parameters
    ----------
    writer : _KernelWriter
        Collector of the C functions, which is extended.

    Returns
    -------
    int
        Number of values that `prepare` computes.
    """
    y = _symbols("y", 12)
    inputs = {
        "mechanism": _symbols("mechanism", MECHANISM_LAYOUT.size),
        "eye": _symbols("eye", EYE_LAYOUT.size),
        "limits": _symbols("limits", FreeElement.layout.size),
    }
    groups = _posture_rows(inputs, y)
    everything = ca.vertcat(*inputs.values())
    expression = ca.vertcat(*chain.from_iterable(groups.values()))
    # `parametric` are the subexpressions that depend on `everything` alone, and `shared` are the
    # symbols that replace them in the rows.
    shared: Any
    parametric: Any
    expression, shared, parametric = ca.extract_parametric(expression, everything)
    local_symbols = _symbols("own", everything.numel())
    expression = ca.substitute(expression, everything, local_symbols)
    symbols = ca.vertcat(*shared, local_symbols)
    prepared = ca.vertcat(*parametric, everything)
    writer.function("prepare", inputs, {"prepared": prepared})
    start = 0
    for name, values in groups.items():
        rows = [expression[start : start + len(values)]]
        writer.add_part(name, {"prepared": symbols}, ("y", y), rows)
        start += len(values)
    return int(prepared.numel())


def _posture_rows(inputs: Symbols, y: ca.SX) -> dict[str, list[ca.SX]]:
    """Build the rows of a free motion that depend on the positions and velocities of the joints.

    Parameters
    ----------
    inputs : dict of casadi.SX
        Symbols "mechanism", "eye" and "limits" of the numbers in `MECHANISM_LAYOUT`, `EYE_LAYOUT`
        and `FreeElement.layout`.
    y : (12,) casadi.SX
        Joint positions, velocities and accelerations, in the frames of `rigid_body.axis_frames`.

    Returns
    -------
    dict of list of casadi.SX
        Values of the rows by the names of their C functions.
    """
    xp = casadi_namespace()
    q, qd, _ = _split_state(y)
    mechanism: Any = MECHANISM_LAYOUT.unpack(inputs["mechanism"])
    eye: Any = EYE_LAYOUT.unpack(inputs["eye"])
    limits = FreeElement.layout.unpack(inputs["limits"])
    for name in ("omega2", "omega3"):
        x, z = ca.vertsplit(getattr(mechanism, name))
        setattr(mechanism, name, ca.vertcat(x, 0, z))
    mechanism.omega1 = ca.SX([0, 0, 1])
    mechanism.tool_home = ca.SX.eye(3)
    # The formulas of the package read these attributes. The lens has its own part, and its frame
    # is already divided by the semi-axes, which are therefore 1.
    eye.lens = None
    lens: Any = SimpleNamespace(
        centre=_object_array(eye.lens_centre), semi_axes=_object_array(ca.SX.ones(3))
    )
    lens.frame = _object_array(eye.lens_frame).reshape(3, 3)
    angles = ca.vertcat(q[0], q[1] - mechanism.offset, q[2:])  # These functions take θ2 itself.
    # The speeds do not depend on a rotation about the first axis.
    rotated = ca.vertcat(0, q[1:])
    speeds = [
        ca.sumsqr(ca.substitute(jacobian(mechanism, q) @ qd, q, rotated))
        for jacobian in SPEED_JACOBIANS.values()
    ]
    tip = tip_position_symbolic(mechanism, q)
    return {
        "tip": [speed / limits.speeds[k] ** 2 for k, speed in enumerate(speeds)],
        "ranges": [row.value for row in range_rows(mechanism, angles, limits)],
        "rates": [row.value for row in rate_rows(mechanism, angles, qd, limits)],
        "retina": [row.value for row in clearance_rows(eye, mechanism, q, limits.retina_easing)],
        "lens": [lens_constraint(xp, eye, lens, (tip[0], tip[1], tip[2])) + 1],
    }


def _write_drive_torques(writer: _KernelWriter) -> None:
    """Add the rows of a motor's torque, and the torque relative to its nominal value ("pull").

    There is one part of each for every torque law (one mesh, or two nuts) and law of friction.

    Parameters
    ----------
    writer : _KernelWriter
        Collector of the C functions, which is extended.
    """
    drive_symbols = _symbols("drive", DRIVE_LAYOUT.size)
    sigma = _symbols("sigma", 1)
    v = _symbols("v", 3)
    inputs = {"drive": drive_symbols, "sigma": sigma}
    for (two_nuts, mesh), law in product(enumerate(TORQUE_LAWS), FRICTION_LAWS):
        drive: Any = DRIVE_LAYOUT.unpack(drive_symbols)
        drive.two_nuts = two_nuts
        drive.stages = {}  # the values of the thread contain them
        drive.friction = DRIVE_LAYOUT.unpack(drive_symbols)
        drive.friction.law = law
        if law == "coulomb":
            drive.friction.stribeck_speed = None
        instant: Any = SimpleNamespace(tau_rigid=v[0], qd=v[1], qdd=v[2], sigma=sigma)
        torques = directed_torques(drive, instant, 0, breakaway=False)
        driving, braking = torque_row_values(torques, drive.limit)
        writer.add_part(f"{mesh}_{law}", inputs, ("v", v), driving + braking)
        pull = smooth_torque(drive, instant, 0, drive.nominal)
        writer.add_part(f"{mesh}_{law}_pull", inputs, ("v", v), [pull])


def _write_path_motion(writer: _KernelWriter) -> None:
    """Add the motion, the load and the tool speed of one joint along a path.

    Parameters
    ----------
    writer : _KernelWriter
        Collector of the C functions, which is extended.
    """
    x = _symbols("x", 5)
    packed = _symbols("limits", StraightElement.layout.size)
    fit_range = _symbols("place", 2)
    element: Any = SimpleNamespace(
        layout=StraightElement.layout, jerk=True, robot=SimpleNamespace(loads=(SimpleNamespace(),))
    )

    def instant(*names: str) -> tuple[Symbols, Instant]:
        """Return the C inputs, and an instant whose fit contains only the named curves."""
        curves = curves_layout(1)
        coefficients = _symbols("curve", (FIT_DEGREE + 1) * len(names))
        fit = ca.SX.zeros(fit_layout(1).size)
        fit[:2] = fit_range
        for k, name in enumerate(names):
            for degree in range(FIT_DEGREE + 1):
                entry = 2 + degree * curves.size + curves.slices[name].start
                fit[entry] = coefficients[(FIT_DEGREE + 1) * k + degree]
        inputs = {"limits": packed, "place": fit_range, "curve": coefficients}
        return inputs, StraightElement.instant(element, x, ca.SX.ones(4), fit, packed)

    inputs, motion = instant("dq")
    writer.add_part(
        "joint", inputs, ("x", x), [motion.qd[0], motion.qd_hull[0], motion.qdd[0], motion.qddd[0]]
    )
    inputs, motion = instant("inertia", "velocity", "gravity")
    writer.add_part("effort", inputs, ("x", x), [motion.tau_rigid[0]])
    inputs, motion = instant("speeds")
    writer.add_part("speed", inputs, ("x", x), [motion.speeds[0]])


def _write_joint_limits(writer: _KernelWriter) -> None:
    """Add the rows of velocity, stop, acceleration and jerk of one joint along a path.

    The part "sense" contains the rows of one direction, and "pace" those of acceleration and jerk.

    Parameters
    ----------
    writer : _KernelWriter
        Collector of the C functions, which is extended.
    """
    v = _symbols("v", 3)
    sigma = _symbols("sigma", 1)
    bounds = _symbols("bounds", 4)
    limits = SimpleNamespace(
        velocity=bounds[0], acceleration=bounds[1], jerk=bounds[2], stop=bounds[3]
    )
    instant: Any = SimpleNamespace(qd_hull=v[0], qdd=v[1], speeds=v[2], limits=limits)
    writer.add_part(
        "sense",
        {"bounds": bounds, "sigma": sigma},
        ("v", v),
        [row.value for row in velocity_and_stop_rows(instant, 0, sigma)],
        "by bend",
    )
    v = _symbols("v", 2)
    instant = SimpleNamespace(qdd=v[0], qddd=v[1], limits=limits)
    writer.add_part(
        "pace",
        {"bounds": bounds},
        ("v", v),
        [row.value for row in acceleration_rows(instant, 0, True)],
        "by",
    )


def _write_states(writer: _KernelWriter) -> None:
    """Add the state of one coordinate at a fraction of an element, as a function of z.

    The part "state" serves free motions, and "line" serves motions along a path. The input `hull`
    is 1 if the middle Bernstein coefficient replaces the velocity ṡ_b, and otherwise 0.

    Parameters
    ----------
    writer : _KernelWriter
        Collector of the C functions, which is extended.
    """
    z = _symbols("z", 5)
    share = _symbols("share", 1)
    hull = _symbols("hull", 1)
    cubic = CubicPiece(*ca.vertsplit(z))
    position, velocity, acceleration = cubic.evaluate(share)
    writer.add_part(
        "state", {"share": share}, ("z", z), [position, velocity, acceleration], "by bend"
    )
    bound = velocity + hull * (cubic.middle_velocity - velocity)
    line = [position, velocity, acceleration, cubic.jerk, bound]
    writer.add_part("line", {"share": share, "hull": hull}, ("z", z), line, "by bend")


def _symbols(name: str, size: int) -> ca.SX:
    """Create the symbols of a vector.

    Parameters
    ----------
    name : str
        Name of the symbols.
    size : int
        Length of the vector.

    Returns
    -------
    (size,) casadi.SX
        The symbols.
    """
    return ca.SX.sym(name, size)


def _split_state(y: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Divide the state of a free motion into positions, velocities and accelerations.

    Parameters
    ----------
    y : (12,) casadi.SX
        State.

    Returns
    -------
    q, qd, qdd : (4,) casadi.SX
        Joint positions, velocities and accelerations.
    """
    return y[:4], y[4:8], y[8:12]


def _object_array(value: ca.SX) -> Any:
    """Convert an expression to a NumPy array of expressions.

    The kinematic formulas for arrays then apply to it.

    Parameters
    ----------
    value : casadi.SX
        Expression with n entries.

    Returns
    -------
    (n,) array of casadi.SX
        The entries in column-major order.
    """
    array = np.empty(value.numel(), dtype=object)
    array[:] = ca.vertsplit(ca.vec(value))
    return array


if __name__ == "__main__":
    KERNELS_HEADER.write_text(kernels_text(), encoding="utf-8")
