"""Writes the C of what an element of a mesh is made of: native/kernels.h, from the laws, with a robot's figures as inputs.

Each part gives values of a few variables v: NAME_at their values, NAME_by these and their Jacobian (row by row), NAME_bend
adds the upper triangle of the Hessian of what the multipliers weigh. native/elements.c puts them together by the chain rule.
Run after a law has changed: python -m ssm_planner.planning.ocp.kernels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca

from ssm_planner.codegen.c import PLAIN, Argument, write_function
from ssm_planner.codegen.namespace import casadi_namespace
from ssm_planner.dynamics.rigid_body import LOAD, efforts_by_figures
from ssm_planner.kinematics.eye import lens_row
from ssm_planner.kinematics.forward import JACOBIANS, tip_position_symbolic
from ssm_planner.planning.ocp.constraints import (
    Instant,
    acceleration_rows,
    directed_torques,
    sense_rows,
    sides_of_torque,
    smooth_torque,
)
from ssm_planner.planning.ocp.models import (
    DEGREE,
    FreeElement,
    StraightElement,
    curves_of,
    fit_of,
    range_rows,
    rate_rows,
    seen_rows,
)
from ssm_planner.planning.ocp.natively import DRIVE, EYE, KINDS, MECHANISM
from ssm_planner.problem.posterior import LAWS
from ssm_planner.trajectory import Cubic

HEADER = Path(__file__).parents[2] / "native" / "kernels.h"
VECTOR = PLAIN | {
    "not": "SSM_F(is)({0} == SSM_R(0.0))",
    "lt": "SSM_F(is)({0} < {1})",
    "le": "SSM_F(is)({0} <= {1})",
    "eq": "SSM_F(is)({0} == {1})",
    "ne": "SSM_F(is)({0} != {1})",
    "and": "({0} * {1})",
    "or": "SSM_F(is)(({0} != SSM_R(0.0)) | ({1} != SSM_R(0.0)))",
    "if_else_zero": "SSM_F(where)({0} != SSM_R(0.0), {1})",
}
"""Expressions of operations on vectors; conditions are 0 or 1."""
# the first: the base of the exponential laws
SHORTER = {
    "SSM_F(pow)(SSM_R(2.718281828459045), ": "V(exp)(",
    "SSM_F(": "V(",
    "SSM_R(": "R(",
    "ssm_real": "real",
}
"""What stands for what in the text."""
WIDTH = 120
Symbols = dict[str, ca.SX]


@dataclass
class _Writer:
    """Functions in C."""

    texts: list[str] = field(default_factory=list)

    def part(
        self,
        name: str,
        figures: Symbols,
        v: tuple[str, ca.SX],
        values: Sequence[Any],
        kinds: str = "at by bend",
    ) -> None:
        """NAME_at, NAME_by and NAME_bend, or fewer; v: name and symbols of the variables."""
        symbols, given = v[1], {**figures, v[0]: v[1]}
        g = ca.cse(ca.vertcat(*values))
        lam = ca.SX.sym("lam", g.numel())
        if "at" in kinds:
            self.function(f"{name}_at", given, {"g": g})
        self.function(f"{name}_by", given, {"g": g, "by": ca.jacobian(g, symbols)})
        if "bend" in kinds:
            bend = ca.triu(ca.hessian(ca.dot(lam, g), symbols)[0])
            self.function(f"{name}_bend", {**given, "lam": lam}, {"bend": bend}, adds=True)

    def function(self, name: str, inputs: Symbols, outputs: Symbols, *, adds: bool = False) -> None:
        """The entries of the outputs that are not zero by structure are written, row by row, or added."""
        results, arguments = [], []
        for key, value in outputs.items():
            row, column = (list(each) for each in value.sparsity().get_triplet())
            places = [r * value.size2() + c for r, c in zip(row, column, strict=True)]
            results.append(ca.SX(len(places), 1) if not places else ca.SX(value.nz[:]))
            arguments.append(Argument(key, len(places), places, adds))
        function = ca.Function(name, list(inputs.values()), ca.cse(results))
        given = [f"const ssm_real *{key}" for key in inputs] + [
            f"ssm_real *restrict {key}" for key in outputs
        ]
        text = write_function(
            f"static void {name}({', '.join(given)})",
            function,
            [Argument(key, value.numel()) for key, value in inputs.items()],
            arguments,
            VECTOR,
        )
        if not all(each.size for each in arguments):
            text = text.replace("{\n", "{\n    (void)bend;\n", 1)
        for long, short in SHORTER.items():
            text = text.replace(long, short)
        self.texts.append(_packed(text))


def _packed(text: str) -> str:
    """Several statements in a line."""
    declaration, opening, *body, closing, _ = text.split("\n")
    lines, line = [declaration, opening], ""
    for statement in map(str.strip, body):
        if len(line) + len(statement) >= WIDTH:
            lines.append(line)
            line = ""
        line += f" {statement}"
    return "\n".join([*lines, line, closing, ""])


def kernels() -> str:
    """The text of native/kernels.h."""
    writer = _Writer()
    sizes = {
        "LOAD": LOAD.size,
        "MECHANISM": MECHANISM.size,
        "EYE": EYE.size,
        "DRIVE": DRIVE.size,
        "DEGREE": DEGREE,
    }
    for kind, layout in (("FREE", FreeElement.layout), ("STRAIGHT", StraightElement.layout)):
        sizes |= {f"{kind}_{name.upper()}": part.start for name, part in layout.slices.items()}
        sizes[f"{kind}_SIZE"] = layout.size
    sizes["PREPARED"] = _posture(writer)
    figures, y = _symbols("load", LOAD.size), _symbols("y", 12)
    writer.part("torques", {"load": figures}, ("y", y), [efforts_by_figures(figures, *_joints(y))])
    _drives(writer)
    _path(writer)
    _states(writer)
    defines = "".join(f"#define SSM_{name} {value}\n" for name, value in sizes.items())
    intro = f"/* Written by ssm_planner.planning.ocp.kernels with CasADi {ca.CasadiMeta.version()}: do not edit. */\n\n"
    return intro + defines + "\n" + "\n".join(writer.texts)


def _posture(writer: _Writer) -> int:
    """Rows of a free motion that depend on positions and velocities; the number of figures that they are prepared from."""
    y, xp = _symbols("y", 12), casadi_namespace()
    q, qd, _ = _joints(y)
    figures = {
        "mechanism": _symbols("mechanism", MECHANISM.size),
        "eye": _symbols("eye", EYE.size),
        "limits": _symbols("limits", FreeElement.layout.size),
    }
    mechanism: Any
    eye: Any
    mechanism, eye = MECHANISM.unpack(figures["mechanism"]), EYE.unpack(figures["eye"])
    limits = FreeElement.layout.unpack(figures["limits"])
    for name in ("omega2", "omega3"):
        x, z = ca.vertsplit(getattr(mechanism, name))
        setattr(mechanism, name, ca.vertcat(x, 0, z))
    mechanism.omega1, mechanism.tool_home = ca.SX([0, 0, 1]), ca.SX.eye(3)
    eye.lens = None
    lens: Any = SimpleNamespace(centre=_objects(eye.lens_centre), semi_axes=_objects(ca.SX.ones(3)))
    lens.frame = _objects(eye.lens_frame).reshape(3, 3)
    angles = ca.vertcat(q[0], q[1] - mechanism.offset, q[2:])  # θ2 itself
    # a turn about the first axis changes no speed
    turned = ca.vertcat(0, q[1:])
    speeds = [
        ca.sumsqr(ca.substitute(jacobian(mechanism, q) @ qd, q, turned))
        for jacobian in JACOBIANS.values()
    ]
    tip = tip_position_symbolic(mechanism, q)
    parts: dict[str, list[ca.SX]] = {
        "tip": [speed / limits.speeds[k] ** 2 for k, speed in enumerate(speeds)],
        "ranges": [row.value for row in range_rows(mechanism, angles, limits)],
        "rates": [row.value for row in rate_rows(mechanism, angles, qd, limits)],
        "retina": [row.value for row in seen_rows(eye, mechanism, q, limits.retina_easing)],
        "lens": [lens_row(xp, eye, lens, (tip[0], tip[1], tip[2])) + 1],
    }
    counts = [len(values) for values in parts.values()]
    everything = ca.vertcat(*figures.values())
    whole = ca.vertcat(*(value for values in parts.values() for value in values))
    # what depends on figures alone is worked out once
    found: Any
    parametric: Any
    whole, found, parametric = ca.extract_parametric(whole, everything)
    own = _symbols("own", everything.numel())
    whole = ca.substitute(whole, everything, own)
    symbols, prepared = ca.vertcat(*found, own), ca.vertcat(*parametric, everything)
    writer.function("prepare", figures, {"prepared": prepared})
    start = 0
    for name, count in zip(parts, counts, strict=True):
        writer.part(name, {"prepared": symbols}, ("y", y), [whole[start : start + count]])
        start += count
    return int(prepared.numel())


def _drives(writer: _Writer) -> None:
    """Rows of one motor's torque, and the torque itself over its nominal one, by kind of drive and law of friction."""
    figures, sigma, v = _symbols("drive", DRIVE.size), _symbols("sigma", 1), _symbols("v", 3)
    given = {"drive": figures, "sigma": sigma}
    for kind, law in product(KINDS, LAWS):
        drive: Any = DRIVE.unpack(figures)
        drive.kind, drive.friction = kind, DRIVE.unpack(figures)
        drive.friction.law = law
        if law == "coulomb":
            drive.friction.stribeck_speed = None
        at: Any = SimpleNamespace(tau_rigid=v[0], qd=v[1], qdd=v[2], sigma=sigma)
        sides = sides_of_torque(directed_torques(drive, at, 0, breakaway=False), drive.limit)
        writer.part(f"{kind}_{law}", given, ("v", v), [*sides[0], *sides[1]])
        writer.part(
            f"{kind}_{law}_pull", given, ("v", v), [smooth_torque(drive, at, 0, drive.nominal)]
        )


def _path(writer: _Writer) -> None:
    """What a joint, a load on it and the tool do on a straight path, by x of `StraightElement`; rows of one joint."""
    x, packed, place = (
        _symbols("x", 5),
        _symbols("limits", StraightElement.layout.size),
        _symbols("place", 2),
    )
    element: Any = SimpleNamespace(
        layout=StraightElement.layout, jerk=True, robot=SimpleNamespace(loads=(SimpleNamespace(),))
    )

    def instant(*names: str) -> tuple[Symbols, Instant]:
        """With the first of these curves alone; their coefficients."""
        curves, coefficients = curves_of(1), _symbols("curve", (DEGREE + 1) * len(names))
        fit = ca.SX.zeros(fit_of(1).size)
        fit[:2] = place
        for k, name in enumerate(names):
            for degree in range(DEGREE + 1):
                entry = 2 + degree * curves.size + curves.slices[name].start
                fit[entry] = coefficients[(DEGREE + 1) * k + degree]
        given = {"limits": packed, "place": place, "curve": coefficients}
        return given, StraightElement.instant(element, x, ca.SX.ones(4), fit, packed)

    given, at = instant("dq")
    writer.part("joint", given, ("x", x), [at.qd[0], at.qd_hull[0], at.qdd[0], at.qddd[0]])
    given, at = instant("inertia", "velocity", "gravity")
    writer.part("effort", given, ("x", x), [at.tau_rigid[0]])
    given, at = instant("speeds")
    writer.part("speed", given, ("x", x), [at.speeds[0]])
    v, sigma, bounds = _symbols("v", 3), _symbols("sigma", 1), _symbols("bounds", 4)
    limits = SimpleNamespace(
        velocity=bounds[0], acceleration=bounds[1], jerk=bounds[2], stop=bounds[3]
    )
    of_joint: Any = SimpleNamespace(qd_hull=v[0], qdd=v[1], speeds=v[2], limits=limits)
    writer.part(
        "sense",
        {"bounds": bounds, "sigma": sigma},
        ("v", v),
        [row.value for row in sense_rows(of_joint, 0, sigma)],
        "by bend",
    )
    v = _symbols("v", 2)
    of_joint = SimpleNamespace(qdd=v[0], qddd=v[1], limits=limits)
    writer.part(
        "pace",
        {"bounds": bounds},
        ("v", v),
        [row.value for row in acceleration_rows(of_joint, 0, True)],
        "by",
    )


def _states(writer: _Writer) -> None:
    """State of one coordinate at a share of an element, by its z; hull: 1 where ṡ_b is the middle Bernstein coefficient."""
    z, share, hull = _symbols("z", 5), _symbols("share", 1), _symbols("hull", 1)
    cubic = Cubic(*ca.vertsplit(z))
    position, velocity, acceleration = cubic.at(share)
    writer.part("state", {"share": share}, ("z", z), [position, velocity, acceleration], "by bend")
    bound = velocity + hull * (cubic.middle_velocity - velocity)
    line = [position, velocity, acceleration, cubic.jerk, bound]
    writer.part("line", {"share": share, "hull": hull}, ("z", z), line, "by bend")


def _symbols(name: str, size: int) -> ca.SX:
    return ca.SX.sym(name, size)


def _joints(y: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    return y[:4], y[4:8], y[8:12]


def _objects(value: ca.SX) -> Any:
    """As an array of expressions."""
    import numpy as np

    found = np.empty(value.numel(), dtype=object)
    found[:] = ca.vertsplit(ca.vec(value))
    return found


if __name__ == "__main__":
    HEADER.write_text(kernels(), encoding="utf-8")
