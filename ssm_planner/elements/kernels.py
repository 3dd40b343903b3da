"""Generator of native/kernels.h, which contains the physical laws of an element as C code.

An element is an interval of time of a motion. The limits on it are called rows. The generator
writes each law from the same CasADi expressions that the element models use, so that C and CasADi
agree. The model is divided into parts. A part, for example the torque of a drive, computes a few
values from a few variables v. It consists of up to three C functions:

    NAME_at     computes the values
    NAME_by     computes the values, and their Jacobian with respect to v row by row
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
"""C expressions of CasADi's operations on vectors, which contain one number for each of 4 elements.

The keys are the names of the operations. A condition has the value 0 or 1 in each entry.
"""
# The first entry replaces powers of e, which the exponential laws of friction contain.
ABBREVIATIONS = {
    "SSM_F(pow)(SSM_R(2.718281828459045), ": "V(exp)(",
    "SSM_F(": "V(",
    "SSM_R(": "R(",
    "ssm_real": "real",
}
"""Texts in the generated functions, and the shorter texts that replace them.

The C sources define the shorter names as macros. The only purpose is a smaller file.
"""
MAX_LINE_LENGTH = 120
"""Largest number of characters in a generated line."""
Symbols = dict[str, ca.SX]
"""Inputs or outputs of a C function by name."""


@dataclass
class _KernelWriter:
    """Generator of C functions, which collects their texts."""

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
        """Append the C functions NAME_at, NAME_by and NAME_bend of one part of the model.

        The module's docstring states what they compute.

        Parameters
        ----------
        name : str
            Common beginning of the names, NAME.
        constants : dict of casadi.SX
            Inputs with respect to which the values are not differentiated, by name.
        v : (str, casadi.SX)
            Name and symbols of the variables with respect to which they are differentiated.
        values : sequence of casadi.SX
            Expressions of the values.
        kinds : str
            Endings of the functions that native/elements.c needs. NAME_by is always written.
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
        """Append one C function to `texts`.

        The outputs of the C function are dense arrays, row by row. It only writes the entries that
        are not structurally zero.

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
            # Positions of the nonzeros in the dense array.
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
        # The Hessian of a linear part is zero. Compilers would warn that its output `bend`
        # is not used.
        if not all(argument.size for argument in arguments):
            text = text.replace("{\n", "{\n    (void)bend;\n", 1)
        for long, short in ABBREVIATIONS.items():
            text = text.replace(long, short)
        self.texts.append(_pack_statements(text))


def _pack_statements(text: str) -> str:
    """Put as many statements of a C function on each line as `MAX_LINE_LENGTH` allows.

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
    """Generate the text of native/kernels.h, the C header with the physical laws.

    It consists of macros and of the C functions of all parts of the model. The macros contain the
    sizes of all arrays and the positions of their entries.
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
    """Write the C functions of the rows of a free motion that depend on positions and velocities.

    A row is one limit of the motion. Parts of the expressions depend only on the robot, the eye and
    the limits, which do not change during a solve. The C function `prepare` computes them once.

    Parameters
    ----------
    writer : _KernelWriter
        Generator to which the C functions are appended.

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
    # The rows still contain some entries of `everything` itself, so `prepare` copies them all.
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
    """Build the rows of a free motion that depend on positions and velocities as expressions.

    They are the rows (limits) of the tool speeds, the ranges and rates of task coordinates, the
    retina and the lens. All numbers of the robot are symbols, so that one C function serves all
    robots.

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
    # The y components of the axes of joints 2 and 3 are 0 in the frame of the C code.
    for name in ("omega2", "omega3"):
        x, z = ca.vertsplit(getattr(mechanism, name))
        setattr(mechanism, name, ca.vertcat(x, 0, z))
    mechanism.omega1 = ca.SX([0, 0, 1])
    mechanism.tool_home = ca.SX.eye(3)
    # The formulas of the package read the following attributes. The lens is not an attribute of the
    # eye here, because its row is a part of its own. The columns of its frame are already divided
    # by the semi-axes, which are therefore 1.
    eye.lens = None
    lens: Any = SimpleNamespace(
        centre=_object_array(eye.lens_centre), semi_axes=_object_array(ca.SX.ones(3))
    )
    lens.frame = _object_array(eye.lens_frame).reshape(3, 3)
    # The formulas of the task coordinates need the angle θ2 itself, without the frame's offset.
    angles = ca.vertcat(q[0], q[1] - mechanism.offset, q[2:])
    # The speeds do not depend on the rotation about the axis of joint 1, so it is set to 0.
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
    """Write the C functions of the torque rows of a motor, and of its torque in the cost ("pull").

    There is one part of each for every torque law (one mesh, or two nuts) and law of friction. The
    variables of the derivatives are the rigid-body torque, the velocity and the acceleration of the
    joint.

    Parameters
    ----------
    writer : _KernelWriter
        Generator to which the C functions are appended.
    """
    drive_symbols = _symbols("drive", DRIVE_LAYOUT.size)
    sigma = _symbols("sigma", 1)
    v = _symbols("v", 3)
    inputs = {"drive": drive_symbols, "sigma": sigma}
    for (two_nuts, mesh), law in product(enumerate(TORQUE_LAWS), FRICTION_LAWS):
        # The law of a `Drive` is evaluated with symbols in place of its fields. One vector contains
        # the fields of the drive and of its friction.
        drive: Any = DRIVE_LAYOUT.unpack(drive_symbols)
        drive.two_nuts = two_nuts
        drive.stages = {}  # `compiled` replaces gear stages by an equivalent thread.
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
    """Write the C functions of the motion and load of one joint, and of a tool speed, along a path.

    They are the parts "joint", "effort" and "speed". native/elements.c calls them for each joint,
    each payload and each tool speed.

    Parameters
    ----------
    writer : _KernelWriter
        Generator to which the C functions are appended.
    """
    x = _symbols("x", 5)
    packed = _symbols("limits", StraightElement.layout.size)
    fit_range = _symbols("place", 2)
    # Stands for a `StraightElement` with jerk and one payload.
    element: Any = SimpleNamespace(
        layout=StraightElement.layout, jerk=True, robot=SimpleNamespace(loads=(SimpleNamespace(),))
    )

    def instant(*names: str) -> tuple[Symbols, Instant]:
        """Build the motion of a path of which only some curves are not 0, for joint 1.

        Parameters
        ----------
        *names : str
            Names of these curves in `straight_element.curves_layout`.

        Returns
        -------
        inputs : dict of casadi.SX
            Symbols of the inputs of the C function. "curve" contains the coefficients of the named
            curves.
        motion : Instant
            Motion and load. Only the entries of joint 1, or of the first tool speed, are valid.
        """
        curves = curves_layout(1)
        coefficients = _symbols("curve", (FIT_DEGREE + 1) * len(names))
        fit = ca.SX.zeros(fit_layout(1).size)
        fit[:2] = fit_range
        for k, name in enumerate(names):
            for degree in range(FIT_DEGREE + 1):
                # The first two numbers of a fit are the centre and half width of its interval.
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
    """Write the C functions of the kinematic rows of one joint along a path.

    The part "sense" contains the rows of the velocity and of the distance to stop in one direction.
    The part "pace" contains the rows of acceleration and jerk in both directions.

    Parameters
    ----------
    writer : _KernelWriter
        Generator to which the C functions are appended.
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
    """Write the C functions of the state of one coordinate at a fraction of an element.

    The part "state" serves free motions, and "line" serves motions along a path. Both are functions
    of the vector z of the element. The input `share` is the fraction. The input `hull` is 1 if the
    middle Bernstein coefficient of the velocity takes the place of ṡ_b, and 0 if ṡ does.

    Parameters
    ----------
    writer : _KernelWriter
        Generator to which the C functions are appended.
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
        State of the four joints.

    Returns
    -------
    q, qd, qdd : (4,) casadi.SX
        Joint positions, velocities and accelerations.
    """
    return y[:4], y[4:8], y[8:12]


def _object_array(value: ca.SX) -> Any:
    """Convert a CasADi expression to a NumPy array of scalar expressions.

    The formulas of the package for NumPy arrays can then be applied to it.

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
